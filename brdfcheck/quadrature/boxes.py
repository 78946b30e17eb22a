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

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from brdfcheck.numerics import sine_cosine
from brdfcheck.quadrature import circle

CENTRE = 1e-6
"""The radius (radians) about a seed inside which nodes are spread evenly."""
# The longest side of an initial box.
_LONGEST = 0.4
# Seeds closer together than this are one.
_SAME = 1e-7
# Lengths of the first panels in u, from r = _LONGEST inwards: short in u where they would be long in radians. One more
# panel has the rest, if any.
_PANELS = (1.2, 2.4, 5.0, 5.0)


class Boxes(NamedTuple):
    """Boxes [low, low + size] of the coordinates (u, v) of a corner, or of (along, across) where it is plain."""

    low: np.ndarray  # (boxes, 2)
    size: np.ndarray  # (boxes, 2)
    # Columns: the half of the plane of incidence (+1: the light's), the elevation of the seed, whether the elevation
    # rises or falls (+1, -1) away from it, the sign of b, the kind: 0 plain, 1 first triangle, 2 second triangle; the number
    # of the corner; which coordinate is bent (0 none, 1, 2; negative: from the far edge down), from what edge; and the cosine
    # of the light.
    patch: np.ndarray  # (boxes, 9)

    def taken(self, which: np.ndarray | slice) -> Boxes:
        """Some of the boxes."""
        return Boxes(*(column[which] for column in self))

    def joined(self, other: Boxes) -> Boxes:
        """These boxes, then the others."""
        return Boxes(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def halves(self, axis: np.ndarray) -> Boxes:
        """The lower halves of all boxes across their `axis` (boxes,), then the upper ones."""
        cut = axis[:, None] == np.arange(2)
        size = np.where(cut, self.size / 2, self.size)
        upper = np.where(cut, self.low + size, self.low)
        return Boxes(np.concatenate([self.low, upper]), np.tile(size, (2, 1)), np.tile(self.patch, (2, 1)))


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


def initial_boxes(sine: float, cosine: float) -> Boxes:
    """The boxes with which an integral begins, for light at this sine and cosine of the polar angle."""
    rows = [
        (*box, corner.side, corner.height, corner.rise, sign, kind, number, 0, 0, cosine)
        for number, corner in enumerate(_corners(sine, cosine))
        for *box, kind in _cut(corner.reach)
        for sign in (-1, 1)
    ]
    boxes = _of_rows(np.array(rows))
    crossed = circle.crossed(*boxes)
    pieces = [circle.cut(*(column[i] for column in boxes)) for i in np.flatnonzero(crossed)]
    return boxes.taken(~crossed).joined(_of_rows(np.concatenate(pieces))) if pieces else boxes


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


def directions(boxes: Boxes, points: np.ndarray, wo: np.ndarray, weight: np.ndarray) -> None:
    """Write wo for light at azimuth 0 at points (points, 2) of the unit square in each box, and (N.wo) dwo over the box.

    Into arrays of shape (3, boxes, points) and (boxes, points).
    """
    along = boxes.low[:, :1] + boxes.size[:, :1] * points[:, 0]
    across = boxes.low[:, 1:] + boxes.size[:, 1:] * points[:, 1]
    side, height, rise, sign, kind = (column[:, None] for column in boxes.patch.T[:5])
    plain = kind == 0
    # Of triangles: the distance from the apex, and how far they reach beside it there.
    radius = CENTRE * np.sinh(np.where(plain, 0, along))
    stretch = boxes.size[:, :1] * boxes.size[:, 1:]
    bent = boxes.patch[:, 6] != 0
    if np.any(bent):
        stretch = stretch * np.ones_like(along)
        rows = along[bent], across[bent]
        stretch[bent] *= circle.unbend(boxes.patch[bent], *rows, radius[bent])
        along[bent], across[bent] = rows
    density = stretch * np.where(plain, 1, radius * np.sqrt(radius * radius + CENTRE**2) * (2 * across))
    radius, lag = np.where(plain, along, radius), np.where(plain, across, radius * (across * across))
    second = kind == 2
    # Rounding must not push a direction below the horizon.
    up, flat = sine_cosine(np.maximum(height + rise * np.where(second, lag, radius), 0))
    y, cosine = sine_cosine(np.where(second, radius, lag))
    np.multiply(side * flat, cosine, out=wo[0])
    np.multiply(sign, y, out=wo[1])
    normal = np.multiply(up, cosine, out=wo[2])
    np.multiply(density, cosine * normal, out=weight)


class Mesh:
    """The boxes of an integral at one cosine of incidence as a fixed rule, which moves smoothly with the light.

    For cosines that are `near`; nodes are written as those of a `GradedRule`, their weights times those of the rule. `points`
    (points, 2) and `weights` (points,) are the rule of one box.
    """

    def __init__(self, boxes: Boxes, cosine: float, points: np.ndarray, weights: np.ndarray):
        self._boxes, self._points, self._weights = boxes, points, weights
        self._corners = _corners(*_angle(cosine))

    @property
    def size(self) -> int:
        """How many nodes the rule has."""
        return len(self._boxes.low) * len(self._points)

    def near(self, cosines: np.ndarray) -> np.ndarray:
        """True for the cosines (m,) at which the seeds have the same order: only there can the boxes move along."""
        order = [corner.seed for corner in self._corners]
        return np.array([order == [corner.seed for corner in _corners(*_angle(cosine))] for cosine in cosines], bool)

    def fill(self, cos_theta: np.ndarray, wo: np.ndarray, weight: np.ndarray) -> None:
        """Write the nodes for light at azimuth 0 and the cosines (m,): wo, shape (3, m, size), and weight, shape (m, size)."""
        shape = len(self._boxes.low), len(self._points)
        for number, cosine in enumerate(cos_theta):
            share = weight[number].reshape(shape)
            directions(self._moved(float(cosine)), self._points, wo[:, number].reshape(3, *shape), share)
            share *= self._weights

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
            beyond = plain & np.where(bend == -1, begin > core, begin >= core)
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
