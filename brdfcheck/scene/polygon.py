r"""A polygon as a point sees it: Lambert's sum over its edges, with what is below the horizon cut off.

From a point with the normal n, $\sum_i \gamma_i (\Gamma_i \cdot n)$, where $\gamma_i$ is the angle under which the edge i is
seen and $\Gamma_i$ the unit normal of the plane through the point and the edge (Lambert 1760; Nishita & Nakamae 1983), is twice
the irradiance by a radiance of 1 and 2 pi times the form factor. It holds for the part above the horizon only.
"""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.scene.vectors import TINY, Vector, choose, cross, dot


def whole(corners: Sequence[Vector], normal: Vector) -> Float[Array, "..."]:
    """The sum over all edges of a polygon whose `corners` are seen from the points: right where all of it is above."""
    return functools.reduce(operator.add, (_edge(a, b, normal) for a, b in itertools.pairwise((*corners, corners[0]))))


def above_horizon(corners: Sequence[Vector], normal: Vector) -> Float[Array, "..."]:
    """The sum over the part above the horizon; positive where the corners run clockwise as seen from the point."""
    heights = [_height(corner, normal) for corner in corners]
    total = jnp.zeros_like(heights[0])
    pieces = [_above(i, (i + 1) % len(corners), corners, heights) for i in range(len(corners))]
    # Where the polygon goes below the horizon it is closed along it. The last way out before the first corner is
    # that of the last edge that has one: one round to find it, one to add up.
    out = Vector(*(jnp.zeros_like(total) for _ in range(3)))
    for _, end, _, _, leaves in pieces:
        out = choose(leaves, end, out)
    for start, end, seen, enters, leaves in pieces:
        total = total + jnp.where(seen, _edge(start, end, normal, seen), 0)
        total = total + jnp.where(enters, _edge(out, start, normal, enters), 0)
        out = choose(leaves, end, out)
    return total


def _height(corner: Vector, normal: Vector) -> Array:
    """Over the horizon; 0 where rounding alone decides the side: a compiled program may round it differently at each use."""
    height, size = dot(corner, normal), abs(corner.x) + abs(corner.y) + abs(corner.z)
    return jnp.where(abs(height) > 8 * jnp.finfo(height.dtype).eps * size, height, 0)


def _above(i: int, j: int, corners: Sequence[Vector], heights: Sequence[Array]) -> tuple[Vector, Vector, Array, Array, Array]:
    """What of an edge is above the horizon: from where, to where, whether any is, whether the edge enters or leaves there."""
    high, low = heights[i] > 0, heights[j] > 0
    crosses = high != low
    at = heights[i] / jnp.where(crosses, heights[i] - heights[j], 1)
    crossing = corners[i] + (corners[j] - corners[i]) * at
    start, end = choose(high, corners[i], crossing), choose(low, corners[j], crossing)
    return start, end, high | low, crosses & low, crosses & high


def _edge(a: Vector, b: Vector, normal: Vector, real: Array | bool = True) -> Array:
    """gamma (Gamma . n) for the edge from a to b, of any lengths: the angle they subtend, about the plane through them."""
    turn = cross(a, b)
    square = dot(turn, turn)
    along = dot(a, b)
    spans = real & (square > TINY * along * along)
    sine = jnp.sqrt(jnp.where(spans, square, 1))
    angle = jnp.arctan2(sine, jnp.where(spans, along, 1))
    return jnp.where(spans, angle / sine * dot(turn, normal), 0)


def fault(corners: np.ndarray) -> str:
    """What is wrong with a polygon, shape (k, 3), in words; nothing if it is one."""
    corners = corners - corners.mean(0)
    size = np.abs(corners).max()
    corners = corners / (size or 1)
    area = np.sum(np.cross(corners, np.roll(corners, -1, 0)), 0) / 2
    length = np.linalg.norm(area)
    if not length > 1e-9:
        return "vertices span no area"
    normal = area / length
    if np.abs(corners @ normal).max() > 1e-4:
        return "vertices do not lie in a plane"
    # Between the abscissas of corners and crossings, edges lie over one another in one order: from below, each that goes
    # right adds one turn around the points above it and each that goes left takes one away. Inside there is one turn.
    right = np.cross(normal, corners[np.argmax(np.linalg.norm(corners, axis=1))])
    right /= np.linalg.norm(right)
    x, y = corners @ right, corners @ np.cross(normal, right)
    run, rise = np.roll(x, -1) - x, np.roll(y, -1) - y
    turn = run[:, None] * rise - rise[:, None] * run
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel edges cross nowhere
        along = ((x - x[:, None]) * rise - (y - y[:, None]) * run) / turn
    met = (along > 0) & (along < 1)
    stops = np.unique(np.concatenate([x, (x[:, None] + along * run[:, None])[met & met.T]]))
    for low, high in itertools.pairwise(stops):
        middle = (low + high) / 2
        spans = (np.minimum(x, x + run) < middle) & (middle < np.maximum(x, x + run))
        height = y[spans] + (middle - x[spans]) * rise[spans] / run[spans]
        order = np.argsort(height)
        turns = np.cumsum(np.sign(run[spans][order]))[:-1]
        wrong = np.diff(height[order])[(turns != 0) & (turns != 1)]
        if np.any(wrong * (high - low) > 1e-6 * length):
            return "edges cross one another"
    return ""
