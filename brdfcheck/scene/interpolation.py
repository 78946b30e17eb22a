"""Three ways to interpolate inside a polygon on the screen: scan-line bilinear, oblique coordinates, area ratios.

Each gives the weights of the corners at a point, so that colours, normals and positions are all interpolated alike. On a
triangle the three agree to rounding: it has only one affine interpolation. On a quadrilateral only the scan line is
defined, and what it gives depends on how the quadrilateral is turned against the scan lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import jax.numpy as jnp
from jaxtyping import Array, Float


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
