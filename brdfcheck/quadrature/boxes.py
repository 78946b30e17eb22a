r"""The hemisphere cut into boxes about the places where lobes sit, and a fixed rule made of such boxes.

Directions are written about the axis *across* the plane of incidence, not about the normal:

    wo = (cos b sin t, sin b, cos b cos t),  -pi/2 < t, b < pi/2,  (N.wo) dwo = cos^2 b cos t db dt.

The hemisphere is then a square without a pole, the weight vanishes on its rim, and every place where lobes sit lies on
the line b = 0: the mirror direction (t = -theta), the normal (0) and the light (theta). The great circle at 90 degrees
from the mirror direction, where a cut lobe has its kink, is the straight line t = pi/2 - theta. These four are *seeds*.

Each seed is the corner of squares that reach half way to the next seed. A square is two triangles with their apex at
the seed, in the coordinates (r, q): the offsets along and across are (r, r q) or (r q, r), with r = `CENTRE` sinh(u)
and q = v^2. In u a lobe of any width down to `CENTRE` is a bump of length one, so a few panels see every needle about
a seed, and v crowds the nodes where grazing light makes a needle long and thin. The rest is cut into rectangles that
grow away from the seeds, up to `_LONGEST`. Boxes that the circle as high as the light crosses are cut along it
(`quadrature.circle`).
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from brdfcheck.numerics import Columns, sine_cosine
from brdfcheck.quadrature import circle

CENTRE = 1e-6
"""The radius (radians) about a seed inside which nodes are spread evenly."""
# The longest side of an initial box.
_LONGEST = 0.4
# Seeds closer together than this are one.
_SAME = 1e-7
# At how many directions the widest gap between nodes is looked for.
_LOOKED = 20_000
# Lengths of the first panels in u, from r = _LONGEST inwards: short in u where they would be long in radians. One more
# panel has the rest, if any.
_PANELS = (1.2, 2.4, 5.0, 5.0)


@dataclass(frozen=True)
class Boxes(Columns):
    """Boxes [low, low + size] of the coordinates (u, v) of a corner, or of (along, across) where it is plain."""

    low: np.ndarray  # (boxes, 2)
    size: np.ndarray  # (boxes, 2)
    # Columns: the half of the plane of incidence (+1: the light's), the elevation of the seed, whether the elevation
    # rises or falls (+1, -1) away from it, the sign of b, the kind: 0 plain, 1 first triangle, 2 second triangle; the number
    # of the corner; which coordinate is bent (0 none, 1, 2; negative: from the far edge down), from what edge; and the cosine
    # of the light.
    patch: np.ndarray  # (boxes, 9)

    def pieces(self, axis: np.ndarray, stops: np.ndarray) -> Boxes:
        """The boxes cut across their `axis` (boxes,) at parts of their size (0 to 1): all first pieces, then all second."""
        cut = axis[:, None] == np.arange(2)
        low = [np.where(cut, self.low + stop * self.size, self.low) for stop in stops[:-1]]
        size = [np.where(cut, part * self.size, self.size) for part in np.diff(stops)]
        return Boxes(np.concatenate(low), np.concatenate(size), np.tile(self.patch, (len(size), 1)))


def _of_rows(table: np.ndarray) -> Boxes:
    """Boxes of rows of low, size and patch."""
    return Boxes(table[:, 0:2], table[:, 2:4], table[:, 4:])


class _Corner(NamedTuple):
    """What lies on one side of a seed, up to half way to the next one or to the horizon."""

    seed: int  # 0 normal, 1 mirror direction, 2 light, 3 the great circle
    side: float
    height: float  # the elevation of the seed
    rise: float
    reach: float


def _corners(sine: float, cosine: float) -> list[_Corner]:
    theta, elevation = np.arctan2(sine, cosine), np.arctan2(cosine, sine)
    # (t, elevation, seed): the elevation on its own keeps its digits near the horizon.
    seeds = [(0.0, np.pi / 2, 0)]
    for seed in ((-theta, elevation, 1), (theta, elevation, 2), (elevation, theta, 3)):
        if all(abs(seed[0] - other[0]) > _SAME for other in seeds):
            seeds.append(seed)
    seeds.sort()
    corners = []
    for index, (angle, height, seed) in enumerate(seeds):
        for way in (-1, 1):
            neighbour = index + way
            reach = abs(seeds[neighbour][0] - angle) / 2 if 0 <= neighbour < len(seeds) else height
            side = float(np.sign(angle)) or way
            corners.append(_Corner(seed, side, height, -1 if side == way else 1, reach))
    return corners


@functools.lru_cache(maxsize=64)
def initial_boxes(sine: float, cosine: float, half: bool = False) -> Boxes:
    """The boxes with which an integral begins, for light at this sine and cosine of the polar angle. Not to be written to.

    `half`: those on one side of the plane of incidence.
    """
    rows = [
        (*box, corner.side, corner.height, corner.rise, sign, kind, number, 0, 0, cosine)
        for number, corner in enumerate(_corners(sine, cosine))
        for *box, kind in _cut(corner.reach)
        for sign in ((1,) if half else (-1, 1))
    ]
    boxes = _of_rows(np.array(rows))
    crossed = circle.crossed(*boxes)
    boxes = boxes.taken(~crossed).joined(_of_rows(circle.cut(*boxes.taken(crossed))))
    for column in boxes:
        column.flags.writeable = False
    return boxes


def _cut(reach: float) -> list[tuple[float, float, float, float, int]]:
    """Boxes (low, low, size, size, kind) that fill the rectangle [0, reach] x [0, pi/2] with a seed at its corner."""
    if reach <= 0:
        return []
    core = min(reach, _LONGEST)
    stops = np.arcsinh(_LONGEST / CENTRE) - np.cumsum([0.0, *_PANELS])
    stops = np.unique(np.clip([*stops, 0.0], 0, np.arcsinh(core / CENTRE)))
    boxes = [(low, 0.0, high - low, 1.0, kind) for low, high in pairwise(stops) for kind in (1, 2)]
    # Beside the square, across the plane: a ladder of rectangles that grow with their distance from the seed.
    rungs = [core]
    while rungs[-1] < np.pi / 2:
        rung = min(max(4 * rungs[-1], CENTRE), rungs[-1] + _LONGEST)
        rungs.append(rung if rung < np.pi / 2 - _LONGEST / 2 else np.pi / 2)
    boxes += [(0.0, low, core, high - low, 0) for low, high in pairwise(rungs)]
    if reach > core:
        # Beyond it, along the plane. An angle along the plane is shorter by cos b than it reads.
        rungs = list(np.linspace(0, np.pi / 2, int(np.ceil(np.pi / 2 / _LONGEST)) + 1))
        for low, high in pairwise(rungs):
            count = int(np.ceil((reach - core) * np.cos(low) / _LONGEST))
            size = (reach - core) / count
            boxes += [(core + i * size, low, size, high - low, 0) for i in range(count)]
    return boxes


class Grid:
    """Points (points, 2) of the unit square, of which many share a coordinate: what hangs on one of them is computed once."""

    def __init__(self, points: np.ndarray):
        self.count = len(points)
        self.first, self._of_first = np.unique(points[:, 0], return_inverse=True)
        self.second, self._of_second = np.unique(points[:, 1], return_inverse=True)

    def by_first(self, *values: np.ndarray) -> list[np.ndarray]:
        """What hangs on the first coordinate, (boxes, distinct values) each, at all points: (boxes, points)."""
        return [np.take(part, self._of_first, axis=1) for part in values]

    def by_second(self, *values: np.ndarray) -> list[np.ndarray]:
        """What hangs on the second one."""
        return [np.take(part, self._of_second, axis=1) for part in values]


def directions(boxes: Boxes, grid: Grid, wo: np.ndarray, weight: np.ndarray) -> None:
    """Write wo for light at azimuth 0 at the points of a grid in each box, and (N.wo) dwo over the box.

    Into arrays of shape (3, boxes, points) and (boxes, points).
    """
    bend, plain = np.abs(boxes.patch[:, 6]), boxes.patch[:, 4] == 0
    for which, write in (
        (plain & (bend == 0), _straight),
        (plain & (bend == 1), _level),
        (plain & (bend == 2), _upright),
        (boxes.patch[:, 4] == 1, _first),
        (boxes.patch[:, 4] == 2, _second),
    ):
        rows = np.flatnonzero(which)
        if rows.size == len(which):
            rows = slice(None)
        elif not rows.size:
            continue
        some = boxes.taken(rows)
        along = some.low[:, :1] + some.size[:, :1] * grid.first
        across = some.low[:, 1:] + some.size[:, 1:] * grid.second
        (up, flat), (y, cosine), density = write(some, grid, along, across)
        side, sign = some.patch[:, 0, None], some.patch[:, 3, None]
        wo[0, rows] = flat * (side * cosine)
        wo[1, rows] = sign * y
        normal = up * cosine
        wo[2, rows] = normal
        normal *= cosine
        normal *= density
        weight[rows] = normal


# What each kind of box makes of the coordinates along and across (boxes, distinct values): sine and cosine of the elevation in
# the plane, those of the angle across it, and the density of the points; all (boxes, points), or (boxes, 1).
_Made = tuple[Iterable[np.ndarray], Iterable[np.ndarray], np.ndarray]


def _straight(boxes: Boxes, grid: Grid, along: np.ndarray, across: np.ndarray) -> _Made:
    density = boxes.size[:, :1] * boxes.size[:, 1:]
    return grid.by_first(*_elevated(boxes, along)), grid.by_second(*sine_cosine(across)), density


def _level(boxes: Boxes, grid: Grid, along: np.ndarray, across: np.ndarray) -> _Made:
    edge, span = circle.along(boxes.patch, across)
    density = boxes.size[:, :1] * boxes.size[:, 1:] * np.sign(boxes.patch[:, 6, None]) * span
    (share,), (span, density) = grid.by_first(along), grid.by_second(span, density)
    return _elevated(boxes, edge + share * span), grid.by_second(*sine_cosine(across)), density


def _upright(boxes: Boxes, grid: Grid, along: np.ndarray, across: np.ndarray) -> _Made:
    edge, span = circle.across(boxes.patch, along)
    density = boxes.size[:, :1] * boxes.size[:, 1:] * np.sign(boxes.patch[:, 6, None]) * span
    (span, density), (share,) = grid.by_first(span, density), grid.by_second(across)
    return grid.by_first(*_elevated(boxes, along)), sine_cosine(edge + share * span), density


def _first(boxes: Boxes, grid: Grid, along: np.ndarray, across: np.ndarray) -> _Made:
    radius, lag, density = _triangle(boxes, grid, along, across)
    return grid.by_first(*_elevated(boxes, radius)), sine_cosine(lag), density


def _second(boxes: Boxes, grid: Grid, along: np.ndarray, across: np.ndarray) -> _Made:
    radius, lag, density = _triangle(boxes, grid, along, across)
    return _elevated(boxes, lag), grid.by_first(*sine_cosine(radius)), density


def _triangle(boxes: Boxes, grid: Grid, along: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The distance from the apex (boxes, distinct values), and the offset beside it and the density at all points."""
    radius = CENTRE * np.sinh(along)
    density = 2 * boxes.size[:, :1] * boxes.size[:, 1:] * radius * np.sqrt(radius * radius + CENTRE**2)
    edge, span = np.zeros((len(radius), 1)), np.ones_like(radius)
    bent = boxes.patch[:, 6] != 0
    if np.any(bent):
        edge[bent], span[bent] = circle.beside(boxes.patch[bent], radius[bent])
        density[bent] *= np.sign(boxes.patch[bent, 6, None]) * span[bent]
    density, span, far = grid.by_first(density, span, radius)
    (share,) = grid.by_second(across)
    share = edge + share * span
    return radius, far * (share * share), density * share


def _elevated(boxes: Boxes, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sine and cosine of the elevation in the plane, at an offset along it from the seed."""
    # Rounding must not push a direction below the horizon.
    return sine_cosine(np.maximum(boxes.patch[:, 1, None] + boxes.patch[:, 2, None] * offset, 0))


class Mesh:
    """The boxes of an integral at one cosine of incidence as a fixed rule, which moves smoothly with the light.

    For cosines that are `near`; nodes are written as those of a `GradedRule`, their weights times those of the rule. `grid` and
    `weights` (points,) are the rule of one box.
    """

    def __init__(self, boxes: Boxes, cosine: float, grid: Grid, weights: np.ndarray):
        self._boxes, self._grid, self._weights = boxes, grid, weights
        self._corners = _corners(*_angle(cosine))

    @property
    def size(self) -> int:
        """How many nodes the rule has."""
        return len(self._boxes.low) * self._grid.count

    def near(self, cosines: np.ndarray) -> np.ndarray:
        """True for the cosines (m,) at which the seeds have the same order: only there can the boxes move along."""
        order = [corner.seed for corner in self._corners]
        return np.array([order == [corner.seed for corner in _corners(*_angle(cosine))] for cosine in cosines], bool)

    def fill(self, cos_theta: np.ndarray, wo: np.ndarray, weight: np.ndarray) -> None:
        """Write the nodes for light at azimuth 0 and the cosines (m,): wo, shape (3, m, size), and weight, shape (m, size)."""
        shape = len(self._boxes.low), self._grid.count
        for number, cosine in enumerate(cos_theta):
            share = weight[number].reshape(shape)
            directions(self._moved(float(cosine)), self._grid, wo[:, number].reshape(3, *shape), share)
            share *= self._weights

    def gap(self, cosine: float, mirrored: bool) -> float:
        """The angle (radians) of the widest cone of directions without a node, for light at a cosine.

        `mirrored`: what is on one side of the plane of incidence is taken on the other.
        """
        from scipy.spatial import KDTree

        nodes, weight = np.empty((3, 1, self.size)), np.empty((1, self.size))
        self.fill(np.array([cosine]), nodes, weight)
        every = nodes[:, 0].T
        if mirrored:
            every = np.concatenate([every, every * [1, -1, 1]])
        # Evenly over the hemisphere, on a spiral in steps of the golden angle.
        height, turn = (np.arange(_LOOKED) + 0.5) / _LOOKED, np.arange(_LOOKED) * np.pi * (3 - 5**0.5)
        ring = np.sqrt(1 - height * height)
        chord, _ = KDTree(every).query(np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1))
        return 4 * float(np.arcsin(np.max(chord) / 2))

    def _moved(self, cosine: float) -> Boxes:
        low, size, patch = (column.copy() for column in self._boxes)
        for number, (old, new) in enumerate(zip(self._corners, _corners(*_angle(cosine)), strict=True)):
            mine = patch[:, 5] == number
            core = min(old.reach, _LONGEST)
            moved = new.reach if core == old.reach else min(new.reach, core)  # without boxes beyond the core it is all there is
            if old.reach <= 0 or not np.any(mine):
                continue
            plain = mine & (patch[:, 4] == 0)
            # Where a box begins along the plane; one that is bent from its far edge ends there.
            bend, edge = patch[:, 6], patch[:, 7]
            begin = np.where(np.abs(bend) == 1, edge, low[:, 0])
            # A piece without width may lie at the end of a core beyond which there is nothing.
            beyond = plain & (old.reach > core) & np.where(bend == -1, begin > core, begin >= core)
            beside = plain & ~beyond
            _stretch(low, size, patch, 0, mine & ~plain, np.arcsinh(moved / CENTRE) / np.arcsinh(core / CENTRE))
            _stretch(low, size, patch, 0, beside, moved / core)
            _stretch(low, size, patch, 1, beside, (np.pi / 2 - moved) / (np.pi / 2 - core), core, moved)
            if np.any(beyond):
                _stretch(low, size, patch, 0, beyond, (new.reach - moved) / (old.reach - core), core, moved)
            patch[mine, 1] = new.height
        patch[:, 8] = cosine
        return Boxes(low, size, patch)


def _stretch(
    low: np.ndarray,
    size: np.ndarray,
    patch: np.ndarray,
    axis: int,
    which: np.ndarray,
    scale: float,
    start: float = 0.0,
    moved: float = 0.0,
) -> None:
    """Map x to moved + scale (x - start) along an axis of some boxes, in place."""
    bent = np.abs(patch[:, 6]) == axis + 1
    straight, edged = which & ~bent, which & bent
    low[straight, axis] = moved + (low[straight, axis] - start) * scale
    size[straight, axis] *= scale
    patch[edged, 7] = moved + (patch[edged, 7] - start) * scale


def _angle(cosine: float) -> tuple[float, float]:
    """Sine and cosine."""
    return float(np.sqrt((1 - cosine) * (1 + cosine))), float(cosine)
