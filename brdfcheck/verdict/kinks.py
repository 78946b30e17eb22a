"""How much a kink of the surface may hide: a crest that runs across the axes, where the surface falls along each of them.

And the way up such a crest: by tangents on both sides of it, as in bundle methods (Lemarechal 1975) and gradient sampling
(Burke, Lewis and Overton 2005). Where the least of them is the highest is the next place to go, and how high that is a bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from brdfcheck.numerics import Columns
from brdfcheck.verdict.box import Box
from brdfcheck.verdict.climb import Climbs, Function
from brdfcheck.verdict.surface import Surface

# How near to a kink the surface is looked at, how many times as far where nothing is seen there, and how far away at most.
_STEP, _LONGER, _FAR = 6e-5, 16, 0.05
# How near an end of the box a place has no room for that; and how near an end kinks are looked for from there.
_SHORTEST, _CLOSE = 1e-8, 10.0 ** np.arange(-8, -2.9, 0.5)
# How neighbouring values round, relative to them; and what is seen of a kink: so, relative to their errors (which are alike),
# and to the bend at the longer step.
_ROUNDING, _SEEN, _ALIKE, _KINKED = 4e-15, 1e-12, 1e-3, 0.02
# The way up a crest: how near tangents are taken at first and at last, and over which part of that; how far they are trusted,
# in that; which part of the steepest slope is none; and the parts of a step that are tried.
_NEAR, _NEAREST, _ARM = 1e-3, 1e-7, 1 / 300
_TRUST, _LEVEL, _STEPS = 10, 1e-6, 10.0 ** np.arange(-2, 2, 0.5)
# How much a tangent may bend, and the surface rise above it, relative to its slope; what is left for a top to be one, at least
# and as a part of the error; and how much may be left where it is none, in gains of the last rounds.
_BENT, _TOP, _PART, _UNFINISHED = 0.01, 1e-10, 0.1, 3
# How many rounds there are at least, and otherwise how many points in them, about.
_LEAST, _POINTS = 12, 2000
# How many tangents are kept, and how far from a place, or above it, they still serve, in what they are taken within.
_KEPT, _SERVES = 200, 20


class Top(NamedTuple):
    """Where a way up a crest ended: the place (dimension,), its value, and how much higher the crest may still go."""

    place: np.ndarray
    value: float
    gap: float


def crest(surface: Surface, place: np.ndarray, radius: float, error: float) -> tuple[float, bool]:
    """How much higher a kink at a place may go, by the rule of a verdict, and whether one is seen.

    `radius`: how near it is; `error`: how well the albedo there is known, for its neighbours are not known better.

    Where the surface falls on both sides along every axis, no direction d rises from it faster than the sum over all axes but
    one of |d_i| times the jump of the slope there (for the least of smooth functions: of their superadditive derivative g,
    g(d) <= g(d - d_i e_i) - g(-d_i e_i), and g <= 0 along the axis that is left: one at whose end the place lies, and which has
    no jump, or the one with the largest); and a direction is no longer than the cube.
    """
    step = max(_STEP, 5 * radius)
    rtol = max(surface.rtol or 0, error)
    bound, seen = _jumps(surface, place, step, rtol)
    if seen:
        return bound, seen
    # Where rounding is all that is seen, longer steps say more, if they stay inside the box.
    farther, seen = _jumps(surface, place, _LONGER * step, rtol)
    return min(bound, farther), seen and bool(np.isfinite(farther))


def _jumps(surface: Surface, place: np.ndarray, step: float, rtol: float) -> tuple[float, bool]:
    """The bound, and whether a jump is told from rounding, by second differences at a step and at four times that.

    Curvature adds to these in proportion to the step.
    """
    steps, places, free = _crossed(surface.box, place, step)
    if 4 * step > _FAR or not np.any(free):
        return np.inf, True
    value, error = surface.produce(places, rtol)
    beside, bars = (part[1:].reshape(2, 2, -1).sum(axis=1) for part in (value, error))
    jump, noise = (2 * value[0] - beside) / steps, (2 * error[0] + bars) / steps
    sharp, rounding = 4 * jump[1] - jump[0], 4 * noise[1] + noise[0]
    largest = (np.maximum(sharp, 0) + rounding) / 3
    # Twice, because the kink may be off the place by a part of the shorter step.
    bound = 2 * float(np.sum(largest) - (np.max(largest) if np.all(free) else 0))
    return (bound if np.isfinite(bound) else np.inf), bool(np.any(sharp > rounding))


def is_kinked(function: Function, box: Box, place: np.ndarray, radius: float) -> bool:
    """Whether a kink is seen near a place from which two axes or more go both ways, so that its crest may run across them.

    By a function whose neighbouring values err alike. Along one axis climbs close in on a kink.
    """
    step = max(_STEP, 5 * radius)
    _, places, free = _crossed(box, place, step)
    if 4 * step > _FAR or np.count_nonzero(free) < 2:
        return False
    value, error = function(places)
    seen = max(_SEEN * max(1, abs(value[0])), _ALIKE * error[0])
    bend = 2 * value[0] - value[1:].reshape(2, 2, -1).sum(axis=1)
    # Curvature grows with the square of the step, a kink with the step.
    sharp = bend[1] - bend[0] / 16
    return bool(np.any(sharp > np.maximum(_KINKED * np.abs(bend[0]), seen)))


def up_crests(function: Function, box: Box, ends: Climbs, which: np.ndarray, most: float) -> None:
    """Where climbs by `function` ended on kinks, or beside them at an end of a range, go up the crests: of these, in place.

    `most`: how much higher a crest may go where its way does not tell, relative to the value.
    """
    for index in which if box.dimension else ():
        place = _inwards(function, box, ends.places[index], float(ends.values[index]))
        moved = np.any(place != ends.places[index])
        if moved or is_kinked(function, box, place, float(ends.radii[index])):
            ends.places[index], ends.values[index], gap = top_of_crest(function, box, place)
            ends.gaps[index] = min(gap, most * max(abs(ends.values[index]), 1))
            ends.kinked[index] = ends.settled[index] = True


def _inwards(function: Function, box: Box, place: np.ndarray, value: float) -> np.ndarray:
    """A place that is higher, close to one at ends of the ranges of parameters; or that itself.

    The crest of a kink may pass by so closely that no stencil has met it.
    """
    swept = np.arange(box.dimension) < len(box.swept)
    inwards = np.where(place <= 0, 1.0, -1.0) * (swept & ((place <= 0) | (place >= 1)))
    if not np.any(inwards):
        return place
    random = np.random.default_rng(box.dimension)
    ways = random.uniform(0, 1, (2 * box.dimension, box.dimension)) * np.where(inwards, inwards, random.choice([-1, 1]))
    ways = np.concatenate([np.diag(inwards)[inwards != 0], ways])
    places = box.kept((place + _CLOSE[:, None, None] * ways).reshape(-1, box.dimension))
    found, _ = function(places)
    best = int(np.argmax(np.where(np.isnan(found), -np.inf, found)))
    return places[best] if found[best] > value + _SEEN * max(1, abs(value)) else place


def top_of_crest(function: Function, box: Box, place: np.ndarray, error: float = 0.0) -> Top:
    """Go up the crest of a kink from a place (dimension,) of the box.

    Neighbouring values of `function` err alike, by about `error`: a gap that is small beside it is small enough. The gap is
    that of a surface that is concave from there on: it lies below all its tangents, and so below any mean of them.
    """
    dimension = len(place)
    random, near = np.random.default_rng(dimension), _NEAR
    rounds = max(_LEAST, _POINTS // (2 * dimension + 1) ** 2)
    low, high = np.where(box.periodic, -np.inf, 0.0), np.where(box.periodic, np.inf, 1.0)
    value = float(function(place[None])[0][0])
    rounding = _ROUNDING * max(1, abs(value))
    enough = max(_TOP, _PART * error)
    # How high the crest may go, by the tangents of each round: two of them must agree.
    tops, gains, way = [np.inf, np.inf], [0.0, 0.0], np.zeros(dimension)
    known = _Tangents(np.zeros((0, dimension)), np.zeros(0), np.zeros((0, dimension)))
    while len(gains) < rounds and near >= _NEAREST and max(tops) - value > enough:
        around = np.concatenate([[0 * way, 0.5 * way, way], random.uniform(-1, 1, (2 * dimension - 1, dimension))])
        fresh = _Tangents.near(function, box, np.clip(place + near * around, low, high), near * _ARM, rounding)
        known = fresh.joined(known).taken(slice(_KEPT))
        tangents = known.touching(place, value, near, rounding)
        trials, found = fresh.places, fresh.values
        if len(tangents.values):
            room = np.where(box.periodic, 0.5, 1.0)
            gap = tangents.highest(place, value, near, np.maximum(place - room, low), np.minimum(place + room, high))[1]
            steepest = np.max(np.abs(tangents.slopes), axis=0)
            # The surface may rise a little above these tangents; where it does by more, it is not concave.
            gap += _BENT * near * float(np.max(steepest)) + rounding
            tops = [tops[1], value + gap if gap >= 0 else np.inf]
            reach = _TRUST * near * (steepest > _LEVEL * np.max(steepest))
            way = tangents.highest(place, value, near, np.maximum(place - reach, low), np.minimum(place + reach, high))[0]
            steps = np.clip(place + _STEPS[:, None] * way, low, high)
            trials, found = np.concatenate([trials, steps]), np.concatenate([found, function(box.kept(steps))[0]])
            way = way / near / _TRUST
        found = np.where(np.isnan(found), -np.inf, found)
        gain, moved = 0.0, 0.0
        if len(found) and np.max(found) > value + rounding:
            best = int(np.argmax(found))
            gain, moved = float(found[best]) - value, float(np.max(np.abs(trials[best] - place)))
            place, value = trials[best], float(found[best])
        # Where the tangents misled, one of them is known now that will do so no more.
        near = float(np.clip(2 * moved, near / 5, 5 * near)) if gain or not gains[-1] else near
        gains.append(gain)
    gap = max(*tops, value) - value
    return Top(box.kept(place[None])[0], value, gap if gap <= enough else max(gap, _UNFINISHED * sum(gains[-2:])))


@dataclass(frozen=True)
class _Tangents(Columns):
    """Tangents of a surface: where they touch it (tangents, dimension), its values there, and their slopes."""

    places: np.ndarray
    values: np.ndarray
    slopes: np.ndarray

    @classmethod
    def near(cls, function: Function, box: Box, places: np.ndarray, arm: float, rounding: float) -> _Tangents:
        """Those at some places, by differences over `arm` on both sides; none of which crosses a kink."""
        count, dimension = places.shape
        inner = np.where(box.periodic, places, np.clip(places, arm, 1 - arm))
        beside = inner[:, None, None] + _arms(np.full((1, dimension), arm))[0]
        value, _ = function(box.kept(np.concatenate([inner, beside.reshape(-1, dimension)])))
        middle, (up, down) = value[:count], np.moveaxis(value[count:].reshape(count, 2, dimension), 1, 0)
        slopes = (up - down) / (2 * arm)
        bent = np.max(np.abs(up + down - 2 * middle[:, None]), axis=1)
        smooth = bent <= _BENT * arm * np.max(np.abs(slopes), axis=1) + 2 * rounding
        return cls(inner[smooth], middle[smooth], slopes[smooth])

    def touching(self, place: np.ndarray, value: float, near: float, rounding: float) -> _Tangents:
        """Those that pass closely above a place with a value.

        No place near it rises above them: one that was taken across a kink says nothing.
        """
        size = near * np.linalg.norm(self.slopes, axis=1) + rounding
        above = self.values - value - np.einsum("ik,ik->i", self.slopes, self.places - place)
        beside = np.max(np.abs(self.places - place), axis=1) < _SERVES * near
        apart = self.places[beside] - self.places[:, None]
        rise = self.values[beside] - self.values[:, None] - np.einsum("ik,ijk->ij", self.slopes, apart)
        highest = np.maximum(np.max(rise, axis=1, initial=-np.inf), -above)
        # From afar nothing else is believed than what has no curvature, or a curved crest would look like a top.
        allowed = np.where(beside, _BENT * size, _PART * _TOP) + rounding
        return self.taken((above < _SERVES * size) & (highest <= allowed))

    def highest(
        self, place: np.ndarray, value: float, near: float, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Where the least of them is the highest between two corners of a box, seen from a place with a value, and how much.

        In units of `near` and of the slopes, for linear programs have tolerances of their own.
        """
        from scipy.optimize import linprog  # a fifth of a second, which is for those who need it

        size = float(np.max(np.abs(self.slopes))) or 1.0
        above = self.values - value - np.einsum("ik,ik->i", self.slopes, self.places - place)
        found = linprog(
            np.append(np.zeros(len(place)), -1),
            np.column_stack([-self.slopes / size, np.ones(len(above))]),
            above / (size * near),
            bounds=[*zip((low - place) / near, (high - place) / near, strict=True), (None, None)],
        )
        if found.x is None:
            return np.zeros(len(place)), np.inf
        return found.x[:-1] * near, float(found.x[-1]) * size * near


def _crossed(box: Box, place: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Steps (2, free axes), a place and those so far from it, and which axes are free (dimension,).

    Four times `step` and `step` itself, shorter where the box ends, along the axes at whose ends the place does not lie: first
    the place, then (2 steps, 2 sides, free axes) of them.
    """
    room = np.where(box.periodic, np.inf, np.minimum(place, 1 - place))
    free = room > _SHORTEST
    steps = np.array([4.0, 1.0])[:, None] * np.minimum(step, room / 4)
    beside = (place + _arms(steps))[:, :, free].reshape(-1, len(place))
    return steps[:, free], np.concatenate([place[None], box.kept(beside)]), free


def _arms(steps: np.ndarray) -> np.ndarray:
    """Steps (k, dimension) along each axis in both directions: (k, 2, dimension, dimension)."""
    return np.array([1, -1])[:, None, None] * (steps[:, None, None, :] * np.eye(steps.shape[1]))
