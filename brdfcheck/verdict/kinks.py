"""How much a kink of the surface may hide: a crest that runs across the axes, where the surface falls along each of them.

And the way up such a crest: by gradients on both sides of it, as in bundle methods and gradient sampling (Burke, Lewis and
Overton 2005). The shortest vector of their convex hull points along the crest, and where it vanishes is a top.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from brdfcheck.verdict.box import Box
from brdfcheck.verdict.climb import Climbs, Function
from brdfcheck.verdict.surface import Surface

# How near to a kink the surface is looked at, how many times as far where nothing is seen there, and how far away at most.
_STEP, _LONGER, _FAR = 6e-5, 16, 0.05
# How neighbouring values round, relative to them; and what is seen of a kink: so, relative to their errors (which are alike),
# and to the bend at the longer step.
_ROUNDING, _SEEN, _ALIKE, _KINKED = 4e-15, 1e-13, 1e-3, 0.02
# The way up a crest: how near gradients are taken at first and at last, over which part of that, and how far steps go in it.
_NEAR, _NEAREST, _ARM = 1e-3, 1e-7, 1 / 300
_STEPS = 10.0 ** np.arange(-1.5, 2.6, 0.5)
# How much a gradient taken across a kink bends, or rises above the surface, relative to itself; what is left for a top to be
# one; and how much may be left at least, in gains of the last rounds.
_BENT, _TOP, _UNFINISHED, _LAST = 0.01, 1e-10, 3, 5
# How many rounds there are at least, and otherwise how many points in them, about.
_LEAST, _POINTS = 12, 2000
# How far from a place gradients of the round before still serve, in the distance at which they are taken.
_SERVES = 20
# The row of ones that makes weights sum to 1, against vectors of size 1.
_HEAVY = 10


class Top(NamedTuple):
    """Where a way up a crest ended: the place (dimension,), its value, and how much higher the crest may still go."""

    place: np.ndarray
    value: float
    gap: float


def crest(surface: Surface, place: np.ndarray, radius: float) -> tuple[float, bool]:
    """How much higher a kink at a place may go, by the rule of a verdict, and whether one is seen. `radius`: how near it is.

    Where the surface falls on both sides along every axis, no direction d rises from it faster than the sum over all axes but
    one of |d_i| times the jump of the slope there (for the least of smooth functions: of their superadditive derivative g,
    g(d) <= g(d - d_i e_i) - g(-d_i e_i), and g <= 0 along the axis that is left: one at whose end the place lies, and which has
    no jump, or the one with the largest); and a direction is no longer than the cube.
    """
    step = max(_STEP, 5 * radius)
    bound, seen = _jumps(surface, place, step)
    if seen:
        return bound, seen
    # Where rounding is all that is seen, longer steps say more, if they stay inside the box.
    farther, seen = _jumps(surface, place, _LONGER * step)
    return min(bound, farther), seen and bool(np.isfinite(farther))


def _jumps(surface: Surface, place: np.ndarray, step: float) -> tuple[float, bool]:
    """The bound, and whether a jump is told from rounding, by second differences at a step and at four times that.

    Curvature adds to these in proportion to the step.
    """
    dimension = len(place)
    steps = np.array([4.0, 1.0]) * step
    places = place + _arms(steps, dimension)  # (steps, sides, axes, dimension)
    outside = np.any((places < 0) | (places > 1), axis=-1) & ~surface.box.periodic
    free = ~np.any(outside, axis=(0, 1))
    if 4 * step > _FAR or not np.any(free):
        return np.inf, True
    asked = np.concatenate([place[None], surface.box.kept(places[:, :, free].reshape(-1, dimension))])
    value, error = surface.produce(asked, surface.rtol)
    beside, bars = (part[1:].reshape(2, 2, -1).sum(axis=1) for part in (value, error))
    jump, noise = (2 * value[0] - beside) / steps[:, None], (2 * error[0] + bars) / steps[:, None]
    sharp, rounding = 4 * jump[1] - jump[0], 4 * noise[1] + noise[0]
    largest = (np.maximum(sharp, 0) + rounding) / 3
    # Twice, because the kink may be off the place by a part of the shorter step.
    bound = 2 * float(np.sum(largest) - (np.max(largest) if np.all(free) else 0))
    return (bound if np.isfinite(bound) else np.inf), bool(np.any(sharp > rounding))


def is_kinked(function: Function, box: Box, place: np.ndarray, radius: float) -> bool:
    """Whether a kink is seen along some axis near a place, by a function whose neighbouring values err alike."""
    step, dimension = max(_STEP, 5 * radius), len(place)
    places = place + _arms(np.array([4.0, 1.0]) * step, dimension)
    inside = np.all((places >= 0) & (places <= 1) | box.periodic, axis=(0, 1, 3))
    if 4 * step > _FAR or not np.any(inside):
        return False
    value, error = function(np.concatenate([place[None], box.kept(places[:, :, inside].reshape(-1, dimension))]))
    seen = max(_SEEN * max(1, abs(value[0])), _ALIKE * error[0])
    bend = 2 * value[0] - value[1:].reshape(2, 2, -1).sum(axis=1)
    # Curvature grows with the square of the step, a kink with the step.
    sharp = bend[1] - bend[0] / 16
    return bool(np.any(sharp > np.maximum(_KINKED * np.abs(bend[0]), seen)))


def up_crests(function: Function, box: Box, ends: Climbs, which: np.ndarray) -> None:
    """Where climbs by `function` ended on kinks, go on along the crests of these: of those climbs, in place."""
    for index in which if box.dimension > 1 else ():
        if is_kinked(function, box, ends.places[index], float(ends.radii[index])):
            ends.places[index], ends.values[index], ends.gaps[index] = top_of_crest(function, box, ends.places[index])
            ends.kinked[index] = ends.settled[index] = True


def top_of_crest(function: Function, box: Box, place: np.ndarray) -> Top:
    """Go up the crest of a kink from a place (dimension,) of the box.

    Neighbouring values of `function` err alike. The gap is that of
    a surface that is concave from there on: it lies below all its tangents, and so below any mean of them.
    """
    dimension = len(place)
    random, near = np.random.default_rng(dimension), _NEAR
    rounds = max(_LEAST, _POINTS // (2 * dimension + 1) ** 2)
    low, high = np.where(box.periodic, -np.inf, 0.0), np.where(box.periodic, np.inf, 1.0)
    value = float(function(place[None])[0][0])
    rounding = _ROUNDING * max(1, abs(value))
    gaps, gains = [np.inf], [0.0]
    before = _Tangents.none(dimension)
    while len(gaps) <= rounds and near >= _NEAREST and max(gaps[-2:]) > _TOP:
        around = np.concatenate([np.zeros((1, dimension)), random.uniform(-1, 1, (2 * dimension, dimension))])
        fresh = _Tangents.taken(function, box, np.clip(place + near * around, low, high), near * _ARM, rounding)
        serves = box.distance(before.places, place) < _SERVES * near if len(before.values) else np.zeros(0, bool)
        tangents = fresh.joined(before.of(serves)).below(near, rounding)
        before = fresh
        gap, trials = np.inf, fresh.places
        found = fresh.values
        if len(tangents.values):
            # At an end of the box from which the surface falls inwards, there is no way along that axis.
            slopes = tangents.slopes
            pressed = ((place <= low) & np.all(slopes <= 0, axis=0)) | ((place >= high) & np.all(slopes >= 0, axis=0))
            weights, along = _shortest(np.where(pressed, 0, slopes))
            above = tangents.values - value - np.einsum("ti,ti->t", slopes, tangents.places - place)
            room = np.where(box.periodic, 0.5, np.where(along > 0, 1 - place, place))
            gap = float(weights @ np.maximum(above, 0) + np.abs(along) @ room)
            if np.any(along):
                steps = near * _STEPS[:, None] * along / np.linalg.norm(along)
                steps = np.clip(place + steps, low, high)
                trials = np.concatenate([trials, steps])
                found = np.concatenate([found, function(box.kept(steps))[0]])
        found = np.where(np.isnan(found), -np.inf, found)
        gain, moved = 0.0, 0.0
        if len(found) and np.max(found) > value + rounding:
            best = int(np.argmax(found))
            gain, moved = float(found[best]) - value, float(np.max(np.abs(trials[best] - place)))
            place, value = trials[best], float(found[best])
        near = float(np.clip(2 * moved, near / 5, 5 * near))
        gaps.append(max(gap - gain, 0.0))
        gains.append(gain)
    return Top(box.kept(place[None])[0], value, max(*gaps[-2:], _UNFINISHED * sum(gains[-_LAST:])))


class _Tangents(NamedTuple):
    """Tangents of a surface: where they touch it (tangents, dimension), its values there, and their slopes."""

    places: np.ndarray
    values: np.ndarray
    slopes: np.ndarray

    @classmethod
    def none(cls, dimension: int) -> _Tangents:
        return cls(np.zeros((0, dimension)), np.zeros(0), np.zeros((0, dimension)))

    @classmethod
    def taken(cls, function: Function, box: Box, places: np.ndarray, arm: float, rounding: float) -> _Tangents:
        """Those at some places, by differences over `arm` on both sides; none of which crosses a kink."""
        count, dimension = places.shape
        inner = np.where(box.periodic, places, np.clip(places, arm, 1 - arm))
        beside = inner[:, None, None] + _arms(np.array([arm]), dimension)[0]
        value, _ = function(box.kept(np.concatenate([inner, beside.reshape(-1, dimension)])))
        middle, (up, down) = value[:count], np.moveaxis(value[count:].reshape(count, 2, dimension), 1, 0)
        slopes = (up - down) / (2 * arm)
        bent = np.max(np.abs(up + down - 2 * middle[:, None]), axis=1)
        smooth = bent <= _BENT * arm * np.max(np.abs(slopes), axis=1) + 2 * rounding
        return cls(inner[smooth], middle[smooth], slopes[smooth])

    def of(self, which: np.ndarray) -> _Tangents:
        return _Tangents(*(part[which] for part in self))

    def joined(self, other: _Tangents) -> _Tangents:
        return _Tangents(*(np.concatenate(parts) for parts in zip(self, other, strict=True)))

    def below(self, near: float, rounding: float) -> _Tangents:
        """Those that no other of these places rises above: one that was taken across a kink says nothing."""
        apart = self.places[None] - self.places[:, None]
        above = self.values[None] - self.values[:, None] - np.einsum("ik,ijk->ij", self.slopes, apart)
        allowed = _BENT * near * np.linalg.norm(self.slopes, axis=1) + rounding
        return self.of(np.max(above, axis=1, initial=-np.inf) <= allowed)


def _arms(steps: np.ndarray, dimension: int) -> np.ndarray:
    """Steps (k,) along each axis in both directions: (k, 2, dimension, dimension)."""
    return steps[:, None, None, None] * np.array([1, -1])[:, None, None] * np.eye(dimension)


def _shortest(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The weights of the shortest vector of a convex hull (vectors, dimension), and that vector."""
    size = np.max(np.abs(vectors)) or 1.0
    # Weights that sum to 1, but for a small part, which is made good afterwards.
    rows = np.vstack([vectors.T / size, np.full(len(vectors), _HEAVY)])
    weights, _ = nnls(rows, np.append(np.zeros(vectors.shape[1]), _HEAVY))
    weights = weights / np.sum(weights)
    return weights, weights @ vectors
