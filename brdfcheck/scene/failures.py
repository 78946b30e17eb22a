"""Where smooth shading fails, by number: what the exact surface shows and the interpolated mesh does not, and the reverse.

Each function measures one failure on a mesh that is given; the light is white, the surface matt where nothing else is said.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import as_parameter
from brdfcheck.messages import one_of
from brdfcheck.scene.cameras import Orthographic
from brdfcheck.scene.meshes import Mesh, border, face_normals, vertex_normals
from brdfcheck.scene.raster import interpolated, rasterise, scan_line_weights
from brdfcheck.scene.smooth import SHADINGS
from brdfcheck.scene.vectors import unit, vector_of

# 2 sin(25 deg) sin(atan .9) = .5654: the contrast of the default zigzag by facets.
_TILTED = (float(np.sin(np.radians(25))), 0.0, float(np.cos(np.radians(25))))
# A face seen at a smaller sine covers no pixel.
_EDGE_ON = 1e-5


def _unit(vector: Any, dtype: Any) -> Array:
    return jnp.stack(unit(vector_of(vector, "the direction").astype(dtype)))


@eqx.filter_jit
def facet_circumradius(mesh: Mesh) -> Float[Array, ""]:
    """Largest angle (radians) between the centre of a facet's circumscribed circle and its vertices, on the unit sphere."""
    # The sphere's centre lies on the circle's axis: the cross product with the axis is a sine.
    across = jnp.linalg.norm(jnp.cross(face_normals(mesh)[:, None], mesh.vertices[mesh.faces]), axis=-1)
    return jnp.max(jnp.arcsin(jnp.minimum(across, 1)))


def lost_highlight(mesh: Mesh, n: object) -> Float[Array, "..."]:
    """What Gouraud shading leaves of a highlight cos^n of peak 1 that falls on the centre of the worst facet.

    Interpolation never exceeds the vertices: the peak is cos^n of the angle to the nearest of them, at most the facet's
    circumradius. The mesh is on the unit sphere, with exact normals; `n` of any shape.
    """
    nearest = jnp.max(face_normals(mesh) @ mesh.vertices.T, axis=1)
    return jnp.exp(as_parameter(n).astype(nearest.dtype) * jnp.log(jnp.min(nearest)))


def silhouette_bleed(mesh: Mesh, towards_eye: object = (0.3, 0.2, 1.0)) -> Float[Array, ""]:
    """The brightest vertex on a face that is seen, under a light straight behind the object: 0 on any exact closed surface.

    Faces on the silhouette have vertices behind it, whose colour interpolation (of colours and of normals) brings into
    sight. Parallel projection along `towards_eye`; an icosphere seen along an axis has edges all along its silhouette, and
    no bleed.
    """
    view = _unit(towards_eye, mesh.vertices.dtype)
    seen = face_normals(mesh) @ view > _EDGE_ON
    lit = jnp.maximum(-(vertex_normals(mesh) @ view), 0)
    return jnp.max(jnp.where(seen[:, None], lit[mesh.faces], 0))


class SlopeProfile(NamedTuple):
    """Shading along a line across the image: position, value, slope between samples; edges crossed, with what jumps there."""

    position: np.ndarray
    value: np.ndarray
    slope: np.ndarray
    edge: np.ndarray
    value_jump: np.ndarray
    slope_jump: np.ndarray

    def largest(self, kind: Literal["value", "slope"], within: float = 0.8) -> float:
        """The largest jump of the value or the slope, by size, at the edges with |x| < `within`; 0 where there is none.

        Towards the silhouette the slope of the exact surface is without bound, and so are the jumps there.
        """
        jump = np.abs(self.value_jump if kind == "value" else self.slope_jump)[np.abs(self.edge) < within]
        return float(jump.max(initial=0))


def mach_bands(
    mesh: Mesh, shading: str = "gouraud", light: object = (0.3, 0.2, 1.0), *, height: float = 0.1, samples: int = 4096
) -> SlopeProfile:
    """Lambert shading along the line y = `height`, |x| < .9, seen along -z: jumps of the slope are the Mach bands that remain.

    The eye enhances a jump of the value (flat shading) and, less, one of the slope; the exact sphere has neither. A jump is
    the difference of the slopes of the samples on the two sides of an edge, which are linear fits over one step.
    """
    one_of(shading, SHADINGS, "shading")
    towards = _unit(light, mesh.vertices.dtype)
    reach = 0.9
    camera = Orthographic((0.0, height, 5.0), (0.0, height, 0.0), half_height=reach / samples)
    values, face = (np.asarray(part) for part in _line(mesh, camera, towards, samples))
    value = values[list(SHADINGS).index(shading)]
    position = ((np.arange(samples) + 0.5) / samples * 2 - 1) * reach
    slope = np.diff(value) / np.diff(position)
    inner = (face[:-1] == face[1:]) & (face[1:] >= 0)
    # An edge between samples i and i + 1, with a pair of samples inside a face on either side.
    edge = 1 + np.nonzero(~inner[1:-1] & inner[:-2] & inner[2:])[0]
    jump = slope[edge + 1] - slope[edge - 1]
    return SlopeProfile(position, value, slope, (position[edge] + position[edge + 1]) / 2, np.diff(value)[edge], jump)


@eqx.filter_jit
def _line(mesh: Mesh, camera: Orthographic, towards: Array, samples: int) -> tuple[Array, Array]:
    """(values of each of `SHADINGS`, faces) along the line: one program, most of which is the rasteriser."""
    fragments, normals = rasterise(mesh, camera, (1, samples)), vertex_normals(mesh)

    def lambert(point: Array, normal: Array, view: Array) -> Array:
        return jnp.maximum(jnp.tensordot(towards, normal, 1), 0)[None]

    images = [shading(mesh, camera, fragments, normals, lambert) for shading in SHADINGS.values()]
    return jnp.stack([image[0, 0] for image in images]).astype(float), fragments.face[0]


def facet_contrast(mesh: Mesh) -> Float[Array, ""]:
    """Brightest minus darkest facet, N.L of the facets' own normals: what an unsmoothed sheet shows of its folds."""
    lit = jnp.maximum(face_normals(mesh) @ _unit(_TILTED, mesh.vertices.dtype), 0)
    return jnp.max(lit) - jnp.min(lit)


def interpolated_contrast(mesh: Mesh) -> Float[Array, ""]:
    """Brightest minus darkest vertex inside the sheet, N.L of averaged normals; 0 where all of these are parallel.

    Vertices on the border average the faces of one side only and are left out. ValueError where there are no others.
    """
    inner = np.setdiff1d(np.arange(len(mesh.vertices)), border(mesh))
    if not inner.size:
        raise ValueError("every vertex of the mesh lies on its border: there is nothing to compare; use more rows")
    lit = jnp.maximum(vertex_normals(mesh)[inner] @ _unit(_TILTED, mesh.vertices.dtype), 0)
    return jnp.max(lit) - jnp.min(lit)


def turned_quadrilateral(
    corners: Float[Array, "k 2"], values: Float[Array, " k"], at: Float[Array, "2"], angle: Float[Array, "..."]
) -> Float[Array, "..."]:
    """The scan-line value at the point `at` of a convex polygon when polygon and point are turned by `angle` (radians).

    A triangle gives one value for all angles. A square with the values 0, 1, 0, 1 gives at its centre 1/2, and 0 or 1 when
    it stands on a corner.
    """
    cosine, sine = jnp.cos(angle), jnp.sin(angle)

    def turned(points: Array) -> Array:
        x, y = points[..., 0].reshape(-1, *[1] * angle.ndim), points[..., 1].reshape(-1, *[1] * angle.ndim)
        return jnp.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)

    return interpolated(scan_line_weights(turned(corners), turned(at[None])[0]), values)
