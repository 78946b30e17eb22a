"""A z-buffer rasteriser: which face is seen in each pixel, and the weights of its three vertices there.

Visibility is settled by a loop over the faces, in windows of fixed size that walk over the box around each face: the work
is the area of the boxes, and a loop of any length is one compiled program. The weights are computed afterwards, from the
faces that are seen, in one fused pass over the image; gradients flow through them and, there being none, not through
visibility.

There are three ways to interpolate inside a polygon on the screen: scan-line bilinear, oblique coordinates, area ratios. Each
gives the weights of the corners at a point, so that colours, normals and positions are all interpolated alike. On a triangle
the three agree to rounding: it has only one affine interpolation. On a quadrilateral only the scan line is defined, and what it
gives depends on how the quadrilateral is turned against the scan lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from brdfcheck.messages import one_of
from brdfcheck.scene.cameras import WHOLE, AbstractCamera, Part, Projected, Size, checked_size, pixel_centres
from brdfcheck.scene.meshes import Mesh

WINDOW = 16
"""Side of a window in pixels. Of 8 to 64, 16 was fastest for 1280 faces at 512 x 512: a window costs about 0.5 us."""
# Face numbers share a float buffer with the nearness: one buffer is updated in place, two were copied at every step.
_MOST_FACES = 2**24


def _cross(a: Array, b: Array) -> Array:
    return a[0] * b[1] - a[1] * b[0]


def _aligned(corners: Array, at: Array) -> Array:
    """The corners with as many dimensions as a field of points needs: one polygon for all points, or one for each."""
    return corners.reshape(corners.shape + (1,) * (at.ndim + 1 - corners.ndim))


def _over(numerator: Array, denominator: Array) -> Array:
    """The quotient, and 0 where the denominator is 0, with finite derivatives."""
    return jnp.where(denominator != 0, numerator / jnp.where(denominator != 0, denominator, 1), 0)


def oblique_weights(corners: Float[Array, "3 2 ..."], at: Float[Array, "2 ..."]) -> Float[Array, "3 ..."]:
    """Weights (1 - u - v, u, v): the coordinates of the point along the two edges from the first corner of a triangle.

    u = (dx y_v - dy x_v)/(x_u y_v - x_v y_u), v = (dy x_u - dx y_u)/(the same); u = v = 0 in a triangle without area.
    """
    corners = _aligned(corners, at)
    along_u, along_v, offset = corners[1] - corners[0], corners[2] - corners[0], at - corners[0]
    determinant = _cross(along_u, along_v)
    u, v = _over(_cross(offset, along_v), determinant), _over(_cross(along_u, offset), determinant)
    return jnp.stack([1 - u - v, u, v])


def area_weights(corners: Float[Array, "3 2 ..."], at: Float[Array, "2 ..."]) -> Float[Array, "3 ..."]:
    """Weights S_i / S: the areas of the triangles that the point makes with each opposite edge (barycentric coordinates).

    The first weight is 1 minus the other two; all of (1, 0, 0) in a triangle without area.
    """
    corners = _aligned(corners, at)
    whole = _cross(corners[1] - corners[0], corners[2] - corners[0])
    u = _over(_cross(corners[2] - at, corners[0] - at), whole)
    v = _over(_cross(corners[0] - at, corners[1] - at), whole)
    return jnp.stack([1 - u - v, u, v])


def scan_line_weights(corners: Float[Array, "k 2 ..."], at: Float[Array, "2 ..."]) -> Float[Array, "k ..."]:
    """Weights of two linear interpolations: along the two edges that the point's horizontal line cuts, then between them.

    For a convex polygon of k >= 3 corners, and points inside it; 0 for all corners where the line misses the polygon.
    """
    corners = _aligned(corners, at)
    count = len(corners)
    x, y = corners[:, 0], corners[:, 1]
    next_x, next_y = jnp.roll(x, -1, axis=0), jnp.roll(y, -1, axis=0)
    rise = next_y - y
    # A horizontal edge is cut by no line; its ends are cut with the neighbouring edges.
    cut = (rise != 0) & (jnp.minimum(y, next_y) <= at[1]) & (at[1] <= jnp.maximum(y, next_y))
    share = _over(at[1] - y, rise)
    crossing = x + share * (next_x - x)
    far = jnp.asarray(jnp.inf, crossing.dtype)
    sides = []
    for side in (jnp.argmin(jnp.where(cut, crossing, far), axis=0), jnp.argmax(jnp.where(cut, crossing, -far), axis=0)):
        chosen = (jnp.arange(count).reshape(-1, *[1] * side.ndim) == side) & cut
        towards = jnp.where(chosen, share, 0)
        weights = jnp.where(chosen, 1 - share, 0) + jnp.roll(towards, 1, axis=0)
        sides.append((jnp.sum(jnp.where(chosen, crossing, 0), axis=0), weights))
    (left, left_weights), (right, right_weights) = sides
    along = _over(at[0] - left, right - left)
    return (1 - along) * left_weights + along * right_weights


INTERPOLATIONS: Mapping[str, Callable[[Array, Array], Array]] = MappingProxyType(
    {"area": area_weights, "oblique": oblique_weights, "scan-line": scan_line_weights}
)


def interpolated(weights: Float[Array, "k ..."], values: Float[Array, "k ..."]) -> Float[Array, "..."]:
    """The values at the corners, shape (k, *channels), weighed at every point: shape (*channels, ...)."""
    return jnp.tensordot(values, weights, axes=(0, 0))


class Fragments(eqx.Module):
    """What is seen in each pixel: the face, -1 where there is none, and its vertices' weights, in space, not on screen."""

    face: Int[Array, "height width"]
    weights: Float[Array, "3 height width"]

    @property
    def covered(self) -> Bool[Array, "height width"]:
        """True where a face is seen."""
        return self.face >= 0

    def interpolate(
        self, faces: Int[Array, "faces 3"], values: Float[Array, "channels vertices"]
    ) -> Float[Array, "channels height width"]:
        """Values given at the vertices, at every pixel. Clear pixels have that of the first vertex of face 0."""
        corners = [faces[:, corner][self._seen()] for corner in range(3)]
        return jnp.stack([sum(self.weights[i] * channel[corners[i]] for i in range(3)) for channel in values])

    def of_face(self, values: Float[Array, "channels faces"]) -> Float[Array, "channels height width"]:
        """One value for each face, at every pixel."""
        return jnp.stack([channel[self._seen()] for channel in values])

    def _seen(self) -> Array:
        return jnp.maximum(self.face, 0)


def rasterise(
    mesh: Mesh,
    camera: AbstractCamera,
    size: Size,
    *,
    cull: bool = True,
    interpolation: str = "area",
    part: Part = WHOLE,
) -> Fragments:
    """The faces that `camera` sees in an image of `size` = (height, width).

    A pixel shows the nearest face that contains its centre; a centre on the common edge of two faces is in both, so a closed
    mesh has no holes. With `cull`, faces seen from behind are dropped. So are faces with a vertex behind the eye. Clear pixels
    have the face -1 and the weights (1, 0, 0). `interpolation` is one of `INTERPOLATIONS`. Not differentiable in visibility.
    `part`: of the image, which alone is told.

    Raises ValueError for a size that is no size, an unknown interpolation, and more than 2^24 faces.
    """
    size = checked_size(size)
    one_of(interpolation, INTERPOLATIONS, "interpolation")
    if len(mesh.faces) > _MOST_FACES:
        raise ValueError(f"a mesh may have {_MOST_FACES} faces; got {len(mesh.faces)}")
    projected = camera.project(mesh.vertices.T, size)
    face = _visible(jax.lax.stop_gradient(projected), mesh.faces, size, cull)[part]
    at = pixel_centres(size, mesh.vertices.dtype, part)
    corners = [mesh.faces[:, corner][jnp.maximum(face, 0)] for corner in range(3)]
    screen = jnp.stack([jnp.stack([axis[corner] for axis in projected.screen]) for corner in corners])
    weights = INTERPOLATIONS[interpolation](screen, jnp.where(face >= 0, at, screen[0]))
    nearness = jnp.stack([projected.nearness[corner] for corner in corners])
    clear = jnp.asarray([1, 0, 0], weights.dtype)[:, None, None]
    # Before the correction too: nothing that a clear pixel computes may spoil a gradient.
    weights = camera.corrected(jnp.where(face >= 0, weights, clear), nearness)
    return Fragments(face, weights)


def _visible(projected: Projected, faces: Array, size: Size, cull: bool) -> Int[Array, "height width"]:
    height, width = size
    dtype = projected.screen.dtype
    x, y = projected.screen[:, faces.T]
    # Each edge is written from its lower vertex number to the higher, whichever face it serves: the two faces then compute
    # the very same number with opposite signs, and no pixel falls between them.
    first, second = faces.T[jnp.array([1, 2, 0])], faces.T[jnp.array([2, 0, 1])]
    low, high = jnp.minimum(first, second), jnp.maximum(first, second)
    (low_x, low_y), (high_x, high_y) = projected.screen[:, low], projected.screen[:, high]
    doubled = (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])
    # y points down: a face seen from its front has a negative area, and its edge functions are turned to be >= 0 inside.
    sign = jnp.sign(doubled) * jnp.where(first < second, 1, -1).astype(dtype)
    along_x, along_y = sign * (low_y - high_y), sign * (high_x - low_x)
    area = jnp.where(doubled != 0, jnp.abs(doubled), 1)
    table = jnp.concatenate([along_x, along_y, low_x, low_y, projected.nearness[faces.T] / area]).T

    drawn = jnp.all(projected.in_front[faces], axis=1) & ((doubled < 0) if cull else (doubled != 0))
    boxes = []
    for corners, end in ((x, width), (y, height)):
        start = jnp.clip(jnp.ceil(jnp.min(corners, axis=0) - 0.5), 0, end).astype(jnp.int32)
        stop = jnp.clip(jnp.floor(jnp.max(corners, axis=0) - 0.5) + 1, 0, end).astype(jnp.int32)
        boxes += [start, -((start - stop) // WINDOW)]
    left, columns, top, rows = boxes
    windows = jnp.where(drawn, columns * rows, 0)
    order = jnp.nonzero(windows, size=len(faces), fill_value=0)[0].astype(jnp.int32)
    inside = jnp.arange(WINDOW, dtype=jnp.int32)

    def draw_window(face: Array, step: Array, buffer: Array) -> Array:
        i, j = top[face] + step // columns[face] * WINDOW, left[face] + step % columns[face] * WINDOW
        row = table[face]
        px, py = (j + inside).astype(dtype) + 0.5, (i + inside).astype(dtype) + 0.5
        edges = [
            (row[k] * (px - row[6 + k]))[None, :] + (row[3 + k] * (py - row[9 + k]))[:, None]
            for k in range(3)
        ]  # fmt: skip
        nearness = edges[0] * row[12] + edges[1] * row[13] + edges[2] * row[14]
        start = (jnp.zeros_like(i), i, j)
        old = jax.lax.dynamic_slice(buffer, start, (2, WINDOW, WINDOW))
        hit = (edges[0] >= 0) & (edges[1] >= 0) & (edges[2] >= 0) & (nearness > old[0])
        new = jnp.where(hit, jnp.stack([nearness, jnp.full_like(nearness, face.astype(dtype))]), old)
        return jax.lax.dynamic_update_slice(buffer, new, start)

    def draw_face(place: Array, buffer: Array) -> Array:
        face = order[place]
        return jax.lax.fori_loop(0, windows[face], lambda step, inner: draw_window(face, step, inner), buffer)

    # The margin takes the windows that reach over the edge of the image: a slice is never moved to fit.
    clear = jnp.stack([jnp.full((height + WINDOW, width + WINDOW), value, dtype) for value in (-jnp.inf, -1)])
    buffer = jax.lax.fori_loop(0, jnp.count_nonzero(windows).astype(jnp.int32), draw_face, clear)
    return buffer[1, :height, :width].astype(jnp.int32)
