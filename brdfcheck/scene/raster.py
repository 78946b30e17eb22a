"""A z-buffer rasteriser: which face is seen in each pixel, and the weights of its three vertices there.

Visibility is settled by a loop over the faces, in windows of fixed size that walk over the box around each face: the work
is the area of the boxes, and a loop of any length is one compiled program. The weights are computed afterwards, from the
faces that are seen, in one fused pass over the image; gradients flow through them and, there being none, not through
visibility.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from brdfcheck.scene.cameras import AbstractCamera, Projected, Size, checked_size, pixel_centres
from brdfcheck.scene.interpolation import INTERPOLATIONS
from brdfcheck.scene.meshes import Mesh

# Side of a window in pixels. Of 8 to 64, 16 was fastest for 1280 faces at 512 x 512: a window costs about 0.5 us.
_WINDOW = 16
# Face numbers share a float buffer with the nearness: one buffer is updated in place, two were copied at every step.
_MOST_FACES = 2**24


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


def rasterise(mesh: Mesh, camera: AbstractCamera, size: Size, *, cull: bool = True, interpolation: str = "area") -> Fragments:
    """The faces that `camera` sees in an image of `size` = (height, width).

    A pixel shows the nearest face that contains its centre; a centre on the common edge of two faces is in both, so a closed
    mesh has no holes. With `cull`, faces seen from behind are dropped. So are faces with a vertex behind the eye. Clear pixels
    have the face -1 and the weights (1, 0, 0). `interpolation` is one of `INTERPOLATIONS`. Not differentiable in visibility.

    Raises ValueError for a size that is no size, an unknown interpolation, and more than 2^24 faces.
    """
    size = checked_size(size)
    if interpolation not in INTERPOLATIONS:
        raise ValueError(f"interpolation must be one of {', '.join(INTERPOLATIONS)}; got {interpolation!r}")
    if len(mesh.faces) > _MOST_FACES:
        raise ValueError(f"a mesh may have {_MOST_FACES} faces; got {len(mesh.faces)}")
    projected = camera.project(mesh.vertices.T, size)
    face = _visible(jax.lax.stop_gradient(projected), mesh.faces, size, cull)
    at = pixel_centres(size, mesh.vertices.dtype)
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
        boxes += [start, -((start - stop) // _WINDOW)]
    left, columns, top, rows = boxes
    windows = jnp.where(drawn, columns * rows, 0)
    order = jnp.nonzero(windows, size=len(faces), fill_value=0)[0].astype(jnp.int32)
    inside = jnp.arange(_WINDOW, dtype=jnp.int32)

    def draw_window(face: Array, step: Array, buffer: Array) -> Array:
        i, j = top[face] + step // columns[face] * _WINDOW, left[face] + step % columns[face] * _WINDOW
        row = table[face]
        px, py = (j + inside).astype(dtype) + 0.5, (i + inside).astype(dtype) + 0.5
        edges = [
            (row[k] * (px - row[6 + k]))[None, :] + (row[3 + k] * (py - row[9 + k]))[:, None]
            for k in range(3)
        ]  # fmt: skip
        nearness = edges[0] * row[12] + edges[1] * row[13] + edges[2] * row[14]
        start = (jnp.zeros_like(i), i, j)
        old = jax.lax.dynamic_slice(buffer, start, (2, _WINDOW, _WINDOW))
        hit = (edges[0] >= 0) & (edges[1] >= 0) & (edges[2] >= 0) & (nearness > old[0])
        new = jnp.where(hit, jnp.stack([nearness, jnp.full_like(nearness, face.astype(dtype))]), old)
        return jax.lax.dynamic_update_slice(buffer, new, start)

    def draw_face(place: Array, buffer: Array) -> Array:
        face = order[place]
        return jax.lax.fori_loop(0, windows[face], lambda step, inner: draw_window(face, step, inner), buffer)

    # The margin takes the windows that reach over the edge of the image: a slice is never moved to fit.
    clear = jnp.stack([jnp.full((height + _WINDOW, width + _WINDOW), value, dtype) for value in (-jnp.inf, -1)])
    buffer = jax.lax.fori_loop(0, jnp.count_nonzero(windows).astype(jnp.int32), draw_face, clear)
    return buffer[1, :height, :width].astype(jnp.int32)
