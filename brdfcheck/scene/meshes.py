"""Triangle meshes as shared vertices and faces (vertex lists): spheres, sheets, files; the normals of faces and vertices.

A mesh holds positions and topology only. Normals are computed from the positions whenever they are asked for, so a
deformed mesh cannot keep the normals of its old shape.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from brdfcheck.messages import one_line
from brdfcheck.scene.vectors import checked, integer, scalar, unit

Weighting = Literal["unit", "area"]


@final
class Mesh(eqx.Module):
    """Vertices of shape (vertices, 3) and faces of shape (faces, 3): vertex numbers, counterclockwise seen from outside.

    Raises ValueError where a coordinate is not finite, a face names a vertex that is not there, a triangle is degenerate
    (two equal vertices, or no area to working precision) or a vertex belongs to no face. Traced values are not checked.
    """

    vertices: Float[Array, "vertices 3"]
    faces: Int[Array, "faces 3"]

    def __init__(self, vertices: object, faces: object):
        rows = {"shapes": [(None, 3)], "what": "a table of rows of three numbers"}
        self.vertices = checked(vertices, "vertices", -np.inf, **rows)
        checked(faces, "faces", -np.inf, **rows)
        self.faces = jnp.asarray(faces)
        if not jnp.issubdtype(self.faces.dtype, jnp.integer):
            raise ValueError(f"faces must hold vertex numbers, which are integers; got {self.faces.dtype}")
        self.faces = self.faces.astype(jnp.int32)
        if not isinstance(self.vertices, Tracer) and not isinstance(self.faces, Tracer):
            _check(np.asarray(self.vertices), np.asarray(self.faces))


def _check(vertices: np.ndarray, faces: np.ndarray) -> None:
    if faces.min() < 0 or faces.max() >= len(vertices):
        worst = int(np.argmax(np.any((faces < 0) | (faces >= len(vertices)), axis=1)))
        raise ValueError(f"faces must name vertices 0 to {len(vertices) - 1}; face {worst} is {faces[worst].tolist()}")
    corners = vertices[faces].astype(float)
    edges = corners - np.roll(corners, 1, axis=1)
    longest = np.max(np.sum(edges**2, axis=-1), axis=-1)
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)
    flat = ~(area > 8 * np.finfo(vertices.dtype).eps * longest)
    if np.any(flat):
        worst = int(np.argmax(flat))
        raise ValueError(f"triangles must have an area; face {worst}, vertices {faces[worst].tolist()}, has none")
    unused = np.setdiff1d(np.arange(len(vertices)), faces)
    if unused.size:
        raise ValueError(f"every vertex must belong to a face; vertex {unused[0]} belongs to none")


def _normalised(vectors: Array) -> Array:
    return jnp.stack(unit(vectors.T), axis=-1)


def face_vectors(mesh: Mesh) -> Float[Array, "faces 3"]:
    """Twice the area of each face times its unit normal: the cross product of two of its edges."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return jnp.cross(b - a, c - a)


@jax.jit
def face_normals(mesh: Mesh) -> Float[Array, "faces 3"]:
    """Unit normals of the faces, towards the side from which their vertices run counterclockwise."""
    return _normalised(face_vectors(mesh))


def vertex_normals(mesh: Mesh, weighting: Weighting = "unit") -> Float[Array, "vertices 3"]:
    """The normalised sum of the normals of the faces around each vertex (Gouraud 1971).

    "unit" adds unit normals, "area" weighs them by the area of their faces. ValueError for another weighting, and where the
    normals around a vertex cancel (in a traced mesh, that normal is the zero vector).
    """
    if weighting not in ("unit", "area"):
        raise ValueError(f"weighting must be unit or area; got {weighting!r}")
    normals = _summed_normals(mesh, weighting)
    if not isinstance(normals, Tracer) and not np.all(np.any(np.asarray(normals), axis=1)):
        worst = int(np.argmin(np.any(np.asarray(normals), axis=1)))
        raise ValueError(f"the normals of the faces around vertex {worst} cancel: it has no normal")
    return normals


@eqx.filter_jit
def _summed_normals(mesh: Mesh, weighting: Weighting) -> Array:
    vectors = face_normals(mesh) if weighting == "unit" else face_vectors(mesh)
    return _normalised(jnp.zeros_like(mesh.vertices).at[mesh.faces.T].add(vectors))


def border(mesh: Mesh) -> Int[np.ndarray, " k"]:
    """The numbers of the vertices on edges that belong to one face only: none of a closed mesh."""
    corners, vertices = np.sort(np.asarray(mesh.faces, np.int64), axis=1), len(mesh.vertices)
    edges, count = np.unique(corners[:, [0, 0, 1]] * vertices + corners[:, [1, 2, 2]], return_counts=True)
    return np.unique(np.divmod(edges[count == 1], vertices))


def _positive(value: Any, name: str) -> float:
    scalar(value, name, above=True)
    return float(value)


def _mesh(vertices: np.ndarray, faces: np.ndarray, dtype: Any) -> Mesh:
    return Mesh(jnp.asarray(np.asarray(vertices), dtype), np.asarray(faces))


def icosphere(level: int = 2, dtype: Any = None) -> Mesh:
    """The icosahedron with each face cut in four `level` times and its vertices on the unit sphere: 20 * 4^level faces.

    ValueError unless `level` is an integer from 0 to 8.
    """
    import trimesh  # here and below: takes half a second, and most scenes have no mesh

    made = trimesh.creation.icosphere(integer(level, "level", 0, 8))
    return _mesh(made.vertices, made.faces, dtype)


def latitude_longitude_sphere(rows: int, columns: int, dtype: Any = None) -> Mesh:
    """The unit sphere cut into `rows` bands of latitude and `columns` of longitude: 2 columns (rows - 1) faces, poles +-z.

    ValueError unless there are at least 2 rows and 3 columns.
    """
    import trimesh

    polar = np.linspace(0, np.pi, integer(rows, "rows", 2, 4096) + 1)
    outline = np.stack([np.sin(polar), -np.cos(polar)], axis=1)
    outline[-1, 0] = 0  # sin(pi) is not
    # Large, because triangles below an area of 1e-8 are left out: at the poles those that are none, and no others.
    made = trimesh.creation.revolve(1e4 * outline, sections=integer(columns, "columns", 3, 4096))
    return _mesh(made.vertices / 1e4, made.faces, dtype)


def read_mesh(file: str | Path, dtype: Any = None) -> Mesh:
    """The triangles of a file that trimesh reads, as OBJ, PLY, STL or GLB: all its meshes as one, in their places.

    Vertices at one place are one vertex, whatever normals or textures the file has for them. A closed mesh whose faces look
    inwards is turned. ValueError, in one line, where there is no such file, it cannot be read or has no triangles, and as for
    `Mesh`.
    """
    import trimesh

    label = repr(one_line(file))
    if not Path(file).is_file():
        raise ValueError(f"there is no file {label}")
    try:
        made = trimesh.load_scene(Path(file)).to_mesh()
        found = len(made.faces)
    except Exception as error:  # readers of many formats: a broken file raises anything
        raise ValueError(f"cannot read {label} as a mesh: {one_line(error) or type(error).__name__}") from None
    if not found:
        raise ValueError(f"{label} has no triangles")
    made.merge_vertices(merge_tex=True, merge_norm=True)
    made.remove_unreferenced_vertices()
    if made.is_watertight and made.is_winding_consistent and made.volume < 0:
        made.invert()
    try:
        return _mesh(made.vertices, made.faces, dtype)
    except ValueError as error:
        raise ValueError(f"{label}: {error}") from None


def _sheet(x: np.ndarray, z: np.ndarray, rows: int, dtype: Any) -> Mesh:
    # Heights over x, drawn out along y. The diagonals of neighbouring columns mirror each other: the faces left and right of
    # a ridge then weigh the same in the normals of its vertices, also at the ends of the ridge.
    columns = len(x) - 1
    y = np.linspace(-1, 1, rows + 1)
    vertices = np.stack([np.tile(x, rows + 1), np.repeat(y, columns + 1), np.tile(z, rows + 1)], axis=1)
    corner = np.arange((columns + 1) * (rows + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    rising = (np.arange(columns) % 2 == 0)[None]
    first = np.where(rising, [a, b, d], [a, b, c])
    second = np.where(rising, [a, d, c], [b, d, c])
    return _mesh(vertices, np.concatenate([first, second], axis=1).reshape(3, -1).T, dtype)


def zigzag(waves: int = 8, slope: float = 0.9, rows: int = 8, dtype: Any = None) -> Mesh:
    """A sheet over [-1, 1]^2 folded along lines parallel to y: facets of the slopes +slope and -slope in turn.

    Its inner vertex normals are all parallel to z: interpolation shows nothing of the folds. ValueError unless `waves` and
    `rows` are integers >= 1 and the slope is > 0.
    """
    waves, rows = integer(waves, "waves", 1, 4096), integer(rows, "rows", 1, 4096)
    x = np.linspace(-1, 1, 2 * waves + 1)
    return _sheet(x, _positive(slope, "slope") / waves * (np.arange(2 * waves + 1) % 2), rows, dtype)


def corrugated(waves: int = 8, slope: float = 0.9, segments: int = 8, rows: int = 8, dtype: Any = None) -> Mesh:
    """A sheet over [-1, 1]^2 in sine waves along x, of the steepest slope `slope`, with `segments` facets to a wave.

    With 4 facets to a wave and more, vertex normals on the flanks differ and interpolation keeps the waves. ValueError unless
    `waves` and `rows` are integers >= 1, `segments` is one >= 3 and the slope is > 0.
    """
    waves, rows = integer(waves, "waves", 1, 4096), integer(rows, "rows", 1, 4096)
    x = np.linspace(-1, 1, waves * integer(segments, "segments", 3, 4096) + 1)
    return _sheet(x, _positive(slope, "slope") / (np.pi * waves) * np.sin(np.pi * waves * (x + 1)), rows, dtype)
