"""Does a function change when both directions turn about the normal together; does it when one goes to the other side?"""

from __future__ import annotations

import numpy as np

from brdfcheck.brdf.callables import BLOCK, Evaluator
from brdfcheck.brdf.family import examples
from brdfcheck.numerics import unit_vectors

TREMORS = np.array([0, 3e-7, 1e-6, -2e-6, -5e-7, 2.3e-6, -3.1e-6, 1.7e-6])
"""Turns (radians) that change nothing but how values round."""
CLEAN = 3e-10
"""Changes below this part of a value do not matter to a verdict."""
# Those above this part are seen at once.
_CLEAR = 1e-6
# Pairs that change in a way that rounding cannot: fewer are an accident.
_SECTOR = 4


def apart(first: np.ndarray, second: np.ndarray, least: float) -> np.ndarray:
    """Where values at two angles, each at several `TREMORS`, (tremors, ...) both, differ by more than they round.

    There the distance between the two groups is larger than both of them together, and than the part `least` of the values.
    """
    low, high = (np.stack([part(first, axis=0), part(second, axis=0)]) for part in (np.min, np.max))
    between, wide = np.max(low, axis=0) - np.min(high, axis=0), np.sum(high - low, axis=0)
    return between > wide + least * np.maximum(np.abs(high).max(axis=0), np.abs(low).max(axis=0))


class _Pairs:
    """Seeded pairs of directions at several places of a box of parameters."""

    def __init__(self, evaluator: Evaluator, ranges: list[tuple[float, float]]):
        chosen = examples(ranges)
        places = np.array(chosen, float).reshape(len(chosen), len(ranges))
        random = np.random.default_rng(20)
        rows = max(2, 48 // len(places))
        shape = (len(places) * rows, BLOCK)
        self.evaluator = evaluator
        self.cosine, other = random.uniform(0.02, 1, (2, *shape))
        self.azimuth, away = random.uniform(0, 2 * np.pi, (2, *shape))
        # A third is near the mirror direction, where a sharp lobe is not zero, a third near the light.
        kind = np.arange(BLOCK) % 3
        near = np.clip(self.cosine + random.normal(0, 0.03, shape), 0.01, 1)
        self.other = np.where(kind == 0, other, near)
        self.away = np.where(kind == 0, away, self.azimuth + np.pi * (kind == 1) + random.normal(0, 0.03, shape))
        self.turn = random.uniform(0.2, 2 * np.pi - 0.2, shape)
        self.parameters = np.repeat(places, rows, axis=0)

    def turned(self, angle: np.ndarray | float) -> np.ndarray:
        """The values with both directions turned by an angle."""
        return self._values(self.away + angle, angle)

    def opposite(self, angle: float) -> np.ndarray:
        """The same with the second direction on the other side of the plane of the first one."""
        return self._values(2 * self.azimuth - self.away + angle, angle)

    def _values(self, away: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
        wi, wo = unit_vectors(self.cosine, self.azimuth + angle, axis=0), unit_vectors(self.other, away, axis=0)
        return self.evaluator.rows(self.parameters, wi, wo)


class _Change:
    """How values differ, and what of that can be told: arrays of the values' shape, `peak` by channel."""

    def __init__(self, evaluator: Evaluator, first: np.ndarray, second: np.ndarray):
        self.scale = np.maximum(np.abs(first), np.abs(second))
        self.peak = np.max(self.scale, axis=(0, 1), where=np.isfinite(self.scale), initial=0.0)
        self.size = np.abs(first - second)
        self.clean = max(CLEAN, 32 * evaluator.epsilon)
        self.told = (self.scale > 1e-12 * self.peak) & np.isfinite(self.scale)

    def above(self, part: float) -> np.ndarray:
        """Where it is above this part of the values."""
        return self.size > part * self.scale + 1e-12 * self.peak


def has_two_sides(evaluator: Evaluator, ranges: list[tuple[float, float]]) -> bool:
    """True where f is not the same on both sides of the plane of incidence, on seeded pairs at several places."""
    pairs = _Pairs(evaluator, ranges)
    with np.errstate(all="ignore"):
        change = _Change(evaluator, pairs.turned(0.0), pairs.opposite(0.0))
        if not np.any(change.above(change.clean)):
            return False
        here, there = (np.stack([side(step) for step in TREMORS]) for side in (pairs.turned, pairs.opposite))
        return bool(np.any(apart(here, there, change.clean) & change.told))


def turns_with_the_surface(evaluator: Evaluator, ranges: list[tuple[float, float]]) -> bool:
    """True where f changes when both directions turn about N together, on seeded pairs at several places: anisotropic.

    What rounds a lot (float32 near a pole) changes as much when it turns by next to nothing; such pairs are judged by their
    number, the others one by one. In single precision all round: there pairs are asked several times.
    """
    pairs = _Pairs(evaluator, ranges)
    with np.errstate(all="ignore"):
        first = pairs.turned(0.0)
        change = _Change(evaluator, first, pairs.turned(pairs.turn))
        if not np.any(change.above(change.clean)):
            return False
        noise = np.maximum.reduce([np.abs(pairs.turned(step) - first) for step in (3e-7, 1e-6, -2e-6)])
        scale, told = change.scale, change.told
        if evaluator.epsilon > 1e-10:
            # Single precision: rounding changes all values, most of them a little and some a lot; compare the usual changes.
            usual, least = (float(np.median((part / scale)[told])) if np.any(told) else 0.0 for part in (change.size, noise))
            turns = usual > 5 * least + 4 * evaluator.epsilon
        else:
            clear = change.above(_CLEAR) & (change.size > 10 * noise)
            turns = np.any(clear & (noise <= 1e-4 * scale)) or np.count_nonzero(clear) > 0.02 * np.count_nonzero(told)
        if turns:
            return True
        here, there = (np.stack([pairs.turned(angle + step) for step in TREMORS]) for angle in (0.0, pairs.turn))
        return bool(np.count_nonzero(apart(here, there, change.clean) & told) >= _SECTOR)
