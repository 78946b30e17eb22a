r"""From a point, or from a patch, to a polygon: Lambert's formula with the horizon cut off.

From a point with normal n to a polygon with the vertices $V_i$, $F = \frac{1}{2\pi}\sum_i \gamma_i\,(\Gamma_i \cdot n)$, where
$\gamma_i$ is the angle under which the edge i is seen and $\Gamma_i$ the unit normal of the plane through the point and the
edge (Lambert 1760; Nishita & Nakamae 1983). It holds for the part above the horizon only, so the polygon is cut there first.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.numerics import gauss
from brdfcheck.runtime import double_precision
from brdfcheck.transport.form_factors import FormFactor

# Squared lengths below this are no edge. Representable in float32.
_TINY = 1e-30
# Pairs of patches worked off together.
_CHUNK, _BATCH = 64, 8
# The grading of the nodes towards the rim of a patch: near an edge shared with its neighbour the factor has a kink.
_GRADING = 3


def point_to_polygon(
    points: Float[Array, "... 3"], normals: Float[Array, "... 3"], polygon: Float[Array, "vertices 3"]
) -> Float[Array, "..."]:
    """The form factor from points with unit normals to a flat polygon, the part below the horizon cut off.

    Positive where the vertices run clockwise as seen from the point, negative where it sees the back. The irradiance by a
    polygon of radiance L is pi L times this. Pure JAX in the precision of the arguments: jit, vmap and grad go through.
    Raises ValueError for fewer than 3 vertices, numbers that are not finite, zero normals, or shapes that do not fit.
    """
    points, normals, polygon = (jnp.asarray(part) for part in (points, normals, polygon))
    if polygon.ndim != 2 or polygon.shape[-1] != 3 or polygon.shape[0] < 3:
        raise ValueError(f"a polygon has at least 3 vertices, shape (vertices, 3); got the shape {polygon.shape}")
    for name, part in (("points", points), ("normals", normals), ("polygon", polygon)):
        if part.shape[-1:] != (3,):
            raise ValueError(f"{name} must have the shape (..., 3); got {part.shape}")
        if not isinstance(part, Tracer) and not np.all(np.isfinite(np.asarray(part))):
            raise ValueError(f"{name} must be finite; got {np.asarray(part).tolist()}")
    if not isinstance(normals, Tracer):
        lengths = np.linalg.norm(np.asarray(normals, float), axis=-1)
        if np.any(np.abs(lengths - 1) > 1e-3):
            raise ValueError(
                f"normals must be unit vectors; got one of the length {lengths.flat[np.argmax(abs(lengths - 1))]:g}"
            )
    shape = jnp.broadcast_shapes(points.shape, normals.shape)
    return _factor(jnp.broadcast_to(points, shape), jnp.broadcast_to(normals, shape), polygon)


@jax.jit
def _factor(points: Array, normals: Array, polygon: Array) -> Array:
    # The vertices are the first axis.
    lead = (slice(None),) + (None,) * (points.ndim - 1)
    arms = polygon[lead] - points
    units = _unit(_cut(arms, jnp.sum(arms * normals, axis=-1)))
    following = jnp.roll(units, -1, axis=0)
    cross = jnp.cross(units, following)
    square = jnp.sum(cross * cross, axis=-1)
    is_edge = square > _TINY
    length = jnp.sqrt(jnp.where(is_edge, square, 1))
    angle = jnp.arctan2(length, jnp.sum(units * following, axis=-1))
    along = jnp.where(is_edge, angle / length * jnp.sum(cross * normals, axis=-1), 0)
    return jnp.sum(along, axis=0) / (2 * np.pi)


def _cut(arms: Array, heights: Array) -> Array:
    """The corners above the horizon (Sutherland & Hodgman 1974), always two for an edge: (2 vertices, ..., 3).

    Those that do not exist repeat the one before them, which makes edges of no length.
    """
    ends, high = jnp.roll(arms, -1, axis=0), jnp.roll(heights, -1, axis=0)
    crosses = (heights > 0) != (high > 0)
    share = heights / jnp.where(crosses, heights - high, 1)
    corners = jnp.stack([arms + share[..., None] * (ends - arms), ends], axis=1).reshape(-1, *arms.shape[1:])
    exist = jnp.stack([crosses, high > 0], axis=1).reshape(-1, *heights.shape[1:])
    number = jnp.arange(len(corners)).reshape((-1,) + (1,) * (heights.ndim - 1))
    latest = jax.lax.cummax(jnp.where(exist, number, -1), axis=0)
    latest = jnp.where(latest < 0, latest[-1:], latest)  # before the first one comes the last
    found = jnp.take_along_axis(corners, jnp.maximum(latest, 0)[..., None], axis=0)
    return jnp.where(latest[..., None] < 0, 0, found)


def _unit(vector: Array) -> Array:
    square = jnp.sum(vector * vector, axis=-1, keepdims=True)
    return jnp.where(square > _TINY, vector / jnp.sqrt(jnp.where(square > _TINY, square, 1)), 0)


# --- patches ---


def patch_form_factor(first: Any, second: Any, order: int = 12) -> FormFactor:
    """From one flat convex polygon to another: the point formula integrated over the first, and checked over the second.

    `first`, `second`: vertices of shape (m, 3), counterclockwise from behind, as the faces of a solid seen from outside; they
    must see each other unhindered but may cut each other's horizon and share edges. `order`: Gauss nodes a direction, >= 2,
    graded towards the rim. The value is the mean of the two reciprocal estimates, weighted by how little each changes with
    fewer nodes; the error is that change, and what of their disagreement it leaves unexplained. Raises ValueError for bad
    polygons or orders.
    """
    first, second = checked_polygon(first, "the first polygon"), checked_polygon(second, "the second polygon")
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < 2:
        raise ValueError(f"order must be a whole number >= 2; got {order!r}")
    vertices = padded([first, second])
    areas, normals = measures(vertices)
    exchange, error = pair_exchange(vertices, normals, np.array([[0, 1]]), int(order))
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
        seen = jnp.maximum(_factor(points, jnp.broadcast_to(-normal, points.shape), other), 0)
        return jnp.sum((areas[:, None] * weight).reshape(-1) * seen)

    return jax.lax.map(one, (first, normals, second), batch_size=_BATCH)
