"""Convex polyhedra as enclosures, and the form factor between two polygons: that of a point, integrated over one of them."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from brdfcheck.numerics import gauss
from brdfcheck.quadrature.rule import checked_count
from brdfcheck.runtime import double_precision
from brdfcheck.scene.polygon import above_horizon
from brdfcheck.scene.vectors import Vector
from brdfcheck.transport.enclosures import Enclosure, closed
from brdfcheck.transport.form_factors import FormFactor

# Pairs of patches further apart than so many radii need no graded nodes, and fewer.
_APART = 2.0
_PLAIN = 6
# Pairs of patches worked off together.
_CHUNK, _BATCH = 64, 8
# The grading of the nodes towards the rim of a patch: near an edge shared with its neighbour the factor has a kink.
_GRADING = 3


def polyhedron(vertices: Any, faces: Sequence[Sequence[int]], *, divisions: int = 1, order: int = 16) -> Enclosure:
    """A convex polyhedron from vertices (v, 3) and faces, each a list of vertices counterclockwise as seen from outside.

    `divisions` k divides triangles and quadrilaterals into k^2 patches, in the order of the faces. Form factors by the clipped
    point-to-polygon formula over graded Gauss nodes, `order` a direction (see `patch_form_factor`), both ways. Nothing hides
    anything in a convex solid; others need form factors with visibility, which `enclosure` takes.
    Raises ValueError for a surface that is open (the leak is stated), not convex, or wrongly turned, and for bad faces.
    """
    corners, divisions = np.asarray(vertices, float), checked_count(divisions, "divisions")
    if corners.ndim != 2 or corners.shape[1] != 3 or not np.all(np.isfinite(corners)):
        raise ValueError(f"vertices must be finite, of the shape (vertices, 3); got the shape {corners.shape}")
    walls = _walls(corners, faces)
    gaps = _gaps(faces)
    _refuse_dents(corners, walls)
    patches = [patch for wall in walls for patch in _divided(wall, divisions)]
    shapes = padded(patches)
    areas, normals = measures(shapes)
    matrix, error = _between_patches(shapes, areas, normals, checked_count(order, "order", 2))
    if gaps:
        leak = np.sum(areas * (1 - np.sum(matrix, axis=1))) / np.sum(areas)
        raise ValueError(
            f"the enclosure is open along {len(gaps)} edges, the first between the vertices {gaps[0][0]} and {gaps[0][1]}:"
            f" of what its walls send out, {leak:.3g} escapes; add the missing face"
        )
    return Enclosure(*closed(matrix, areas, error))


def _walls(corners: np.ndarray, faces: Sequence[Sequence[int]]) -> list[np.ndarray]:
    if len(faces) < 2:
        raise ValueError(f"an enclosure has at least 2 faces; got {len(faces)}")
    walls = []
    for i, face in enumerate(faces):
        indices = np.asarray(face)
        if indices.ndim != 1 or not np.issubdtype(indices.dtype, np.integer) or len(set(indices.tolist())) != len(indices):
            raise ValueError(f"face {i} must be a list of different vertex numbers; got {face!r}")
        if np.any((indices < 0) | (indices >= len(corners))):
            raise ValueError(f"face {i} names a vertex that does not exist; there are {len(corners)}, got {list(face)}")
        walls.append(checked_polygon(corners[indices], f"face {i}"))
    return walls


def _gaps(faces: Sequence[Sequence[int]]) -> list[tuple[int, int]]:
    """Edges that belong to one face only. ValueError for faces that are turned against each other."""
    seen: dict[tuple[int, int], int] = {}
    for i, face in enumerate(faces):
        for a, b in itertools.pairwise([*face, face[0]]):
            if (a, b) in seen:
                raise ValueError(f"the faces {seen[a, b]} and {i} run along the edge {a} to {b} the same way: turn one of them")
            seen[int(a), int(b)] = i
    return [(a, b) for a, b in seen if (b, a) not in seen]


def _refuse_dents(corners: np.ndarray, walls: Sequence[np.ndarray]) -> None:
    used = np.concatenate(list(walls))
    size = float(np.max(np.ptp(used, axis=0)))
    for i, wall in enumerate(walls):
        normal = measures(wall[None])[1][0]
        heights = (used - wall[0]) @ normal / size
        if np.max(heights) > 1e-9:
            inside_out = np.min(heights) > -1e-9
            reason = (
                "turn it: counterclockwise from outside"
                if inside_out
                else "it must be convex: all walls see each other (for others give form factors to transport.enclosure)"
            )
            raise ValueError(f"a vertex lies outside face {i} by {np.max(heights):.3g} of the size of the enclosure: {reason}")


def _divided(wall: np.ndarray, divisions: int) -> list[np.ndarray]:
    if divisions == 1:
        return [wall]
    if len(wall) > 4:
        raise ValueError(f"only triangles and quadrilaterals can be divided; a face has {len(wall)} vertices")
    steps = np.arange(divisions + 1) / divisions
    if len(wall) == 4:
        u, v = np.meshgrid(steps, steps, indexing="ij")
        grid = np.einsum("cij,cx->ijx", [(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], wall)
        quads = itertools.product(range(divisions), repeat=2)
        return [grid[[i, i + 1, i + 1, i], [j, j, j + 1, j + 1]] for i, j in quads]

    def at(i: int, j: int) -> np.ndarray:
        return wall[0] + steps[i] * (wall[1] - wall[0]) + steps[j] * (wall[2] - wall[0])

    found = []
    for i, j in itertools.product(range(divisions), repeat=2):
        if i + j < divisions:
            found.append(np.stack([at(i, j), at(i + 1, j), at(i, j + 1)]))
        if i + j < divisions - 1:
            found.append(np.stack([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]))
    return found


def _between_patches(shapes: np.ndarray, areas: np.ndarray, normals: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    count = len(shapes)
    centres = np.mean(shapes, axis=1)
    reach = np.max(np.linalg.norm(shapes - centres[:, None], axis=-1), axis=1)
    first, second = np.triu_indices(count, 1)
    gap = np.linalg.norm(centres[first] - centres[second], axis=-1) / (reach[first] + reach[second])
    flat = np.einsum("ij,ij->i", normals[first], normals[second]) > 1 - 1e-12  # of one wall: nothing is exchanged
    exchange, error = np.zeros((count, count)), np.zeros((count, count))
    for chosen, nodes, graded in ((~flat & (gap < _APART), order, True), (~flat & (gap >= _APART), _PLAIN, False)):
        pairs = np.stack([first[chosen], second[chosen]], axis=-1)
        if len(pairs):
            found, doubt = pair_exchange(shapes, normals, pairs, nodes, graded)
            for i, j in ((0, 1), (1, 0)):
                exchange[pairs[:, i], pairs[:, j]] = found
                error[pairs[:, i], pairs[:, j]] = doubt
    return exchange / areas[:, None], error / areas[:, None]


# --- between two polygons ---


def patch_form_factor(first: Any, second: Any, order: int = 12) -> FormFactor:
    """From one flat convex polygon to another: the point formula integrated over the first, and checked over the second.

    `first`, `second`: vertices of shape (m, 3), counterclockwise from behind, as the faces of a solid seen from outside; they
    must see each other unhindered but may cut each other's horizon and share edges. `order`: Gauss nodes a direction, >= 2,
    graded towards the rim. The value is the mean of the two reciprocal estimates, weighted by how little each changes with
    fewer nodes; the error is that change, and what of their disagreement it leaves unexplained. Raises ValueError for bad
    polygons or orders.
    """
    first, second = checked_polygon(first, "the first polygon"), checked_polygon(second, "the second polygon")
    order = checked_count(order, "order", 2)
    vertices = padded([first, second])
    areas, normals = measures(vertices)
    exchange, error = pair_exchange(vertices, normals, np.array([[0, 1]]), order)
    return FormFactor(exchange[0] / areas[0], error[0] / areas[0])


def checked_polygon(polygon: Any, name: str) -> np.ndarray:
    """The vertices as floats (m, 3); ValueError unless they are a flat convex polygon with an area."""
    vertices = np.asarray(polygon, float)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 3:
        raise ValueError(f"{name} must have at least 3 vertices, shape (vertices, 3); got the shape {vertices.shape}")
    if not np.all(np.isfinite(vertices)):
        raise ValueError(f"{name} must have finite vertices; got {vertices.tolist()}")
    area, normal = (part[0] for part in measures(vertices[None]))
    size = float(np.max(np.ptp(vertices, axis=0)))
    if not area > 1e-12 * size * size:
        raise ValueError(f"{name} has no area: {vertices.tolist()}")
    off = np.max(np.abs((vertices - vertices[0]) @ normal)) / size
    if off > 1e-6:
        raise ValueError(f"{name} is not flat: a vertex is off its plane by {off:.1g} of its size")
    edges = np.roll(vertices, -1, axis=0) - vertices
    turns = np.cross(np.roll(edges, 1, axis=0), edges) @ normal
    if np.min(turns) < -1e-9 * size * size:
        raise ValueError(f"{name} is not convex: it turns the other way at {vertices[int(np.argmin(turns))].tolist()}")
    return vertices


def padded(polygons: list[np.ndarray]) -> np.ndarray:
    """Polygons as one array (count, most vertices, 3); a last vertex that is repeated changes nothing."""
    most = max(map(len, polygons))
    return np.stack([np.concatenate([polygon, np.repeat(polygon[-1:], most - len(polygon), axis=0)]) for polygon in polygons])


def measures(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Areas (count,) and unit normals (count, 3) of polygons (count, m, 3), towards where they run counterclockwise."""
    arms = vertices - vertices[:, :1]
    vector = np.sum(np.cross(arms, np.roll(arms, -1, axis=1)), axis=1) / 2
    length = np.linalg.norm(vector, axis=-1)
    return length, vector / np.where(length > 0, length, 1)[:, None]


def pair_exchange(
    vertices: np.ndarray, normals: np.ndarray, pairs: np.ndarray, order: int, graded: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """area times form factor for pairs of polygons, (pairs, 2) indices: value and error, (pairs,) each. In float64.

    `graded`: nodes crowd towards the rim, for pairs that touch or nearly do.
    """
    found = []
    with double_precision():
        for nodes in (order, max(order * 3 // 4, 1)):
            rule = _rule(nodes, graded)
            ways = ((pairs[:, 0], pairs[:, 1]), (pairs[:, 1], pairs[:, 0]))
            found.append([_by_chunks(vertices[i], normals[i], vertices[j], rule) for i, j in ways])
    fine, coarse = (np.stack(part) for part in found)
    # The way whose integrand is the smoother one knows better: where a patch cuts the other's horizon, only one has a kink.
    doubt = np.abs(fine - coarse) + 1e-15 * np.abs(fine)
    trust = 1 / np.maximum(doubt, np.finfo(float).tiny ** 0.25) ** 2
    trust = trust / np.sum(trust, axis=0)
    value = np.sum(trust * fine, axis=0)
    unexplained = np.maximum(np.abs(fine[0] - fine[1]) - np.sum(doubt, axis=0), 0)
    error = np.sum(trust * doubt, axis=0) + unexplained
    return value, error


def _by_chunks(first: np.ndarray, normals: np.ndarray, second: np.ndarray, rule: tuple[np.ndarray, ...]) -> np.ndarray:
    """Chunks of one size, so that one program serves any number of pairs."""
    count = len(first)
    padding = np.zeros(-count % _CHUNK, int)
    chosen = np.concatenate([np.arange(count), padding]).reshape(-1, _CHUNK)
    rows = [_exchange(first[chunk], normals[chunk], second[chunk], *rule) for chunk in chosen]
    return np.concatenate([np.asarray(row) for row in rows])[:count]


@functools.lru_cache(maxsize=8)
def _rule(order: int, graded: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes on a triangle from the centre of a patch to an edge: (share of the way out, share along the edge, weight)."""
    x, w = gauss(order)
    out, d_out, along, d_along = x, np.ones_like(x), x, np.ones_like(x)
    if graded:
        out, d_out = 1 - (1 - x) ** _GRADING, _GRADING * (1 - x) ** (_GRADING - 1)
        for _ in range(2):  # to both ends of the edge alike
            along, d_along = along * along * (3 - 2 * along), 6 * along * (1 - along) * d_along
    s, t = np.meshgrid(out, along, indexing="ij")
    return s.ravel(), t.ravel(), (np.outer(w * d_out * 2 * out, w * d_along)).ravel()


@jax.jit
def _exchange(first: Any, normals: Any, second: Any, out: Any, along: Any, weight: Any) -> Array:
    def one(pair: tuple[Array, Array, Array]) -> Array:
        corners, normal, other = pair
        centre = jnp.mean(corners, axis=0)
        following = jnp.roll(corners, -1, axis=0)
        rim = corners[:, None] + along[None, :, None] * (following - corners)[:, None]
        points = (centre + out[None, :, None] * (rim - centre)).reshape(-1, 3)
        areas = jnp.sqrt(jnp.sum(jnp.cross(corners - centre, following - centre) ** 2, axis=-1)) / 2
        # A face runs counterclockwise from behind and looks the other way.
        place = Vector(*points.T)
        seen = jnp.maximum(above_horizon([Vector(*vertex) - place for vertex in other], Vector(*-normal)), 0) / (2 * np.pi)
        return jnp.sum((areas[:, None] * weight).reshape(-1) * seen)

    return jax.lax.map(one, (first, normals, second), batch_size=_BATCH)
