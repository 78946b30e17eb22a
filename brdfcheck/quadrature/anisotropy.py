"""Does a function change when both directions turn about the normal together?"""

from __future__ import annotations

import numpy as np

from brdfcheck.brdf.callables import BLOCK, Evaluator
from brdfcheck.brdf.family import examples

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


def turns_with_the_surface(evaluator: Evaluator, ranges: list[tuple[float, float]]) -> bool:
    """True where f changes when both directions turn about N together, on seeded pairs at several places: anisotropic.

    What rounds a lot (float32 near a pole) changes as much when it turns by next to nothing; such pairs are judged by their
    number, the others one by one. In single precision all round: there pairs are asked several times.
    """
    chosen = examples(ranges)
    places = np.array(chosen, float).reshape(len(chosen), len(ranges))
    random = np.random.default_rng(20)
    rows = max(2, 48 // len(places))
    shape = (len(places) * rows, BLOCK)
    cosine, other = random.uniform(0.02, 1, (2, *shape))
    azimuth, away = random.uniform(0, 2 * np.pi, (2, *shape))
    # A third is near the mirror direction, where a sharp lobe is not zero, a third near the light.
    kind = np.arange(BLOCK) % 3
    near = np.clip(cosine + random.normal(0, 0.03, shape), 0.01, 1)
    other = np.where(kind == 0, other, near)
    away = np.where(kind == 0, away, azimuth + np.pi * (kind == 1) + random.normal(0, 0.03, shape))
    turn = random.uniform(0.2, 2 * np.pi - 0.2, shape)
    parameters = np.repeat(places, rows, axis=0)

    def turned(angle: np.ndarray | float) -> np.ndarray:
        return evaluator.rows(parameters, _directions(cosine, azimuth + angle), _directions(other, away + angle))

    with np.errstate(all="ignore"):
        first, second = turned(0.0), turned(turn)
        scale = np.maximum(np.abs(first), np.abs(second))
        peak = np.max(scale, axis=(0, 1), where=np.isfinite(scale), initial=0.0)
        change = np.abs(first - second)
        clean = max(CLEAN, 32 * evaluator.epsilon)
        if not np.any(change > clean * scale + 1e-12 * peak):
            return False
        noise = np.maximum.reduce([np.abs(turned(step) - first) for step in (3e-7, 1e-6, -2e-6)])
        told = (scale > 1e-12 * peak) & np.isfinite(scale)
        if evaluator.epsilon > 1e-10:
            # Single precision: rounding changes all values, most of them a little and some a lot; compare the usual changes.
            usual, least = (float(np.median((part / scale)[told])) if np.any(told) else 0.0 for part in (change, noise))
            turns = usual > 5 * least + 4 * evaluator.epsilon
        else:
            clear = (change > _CLEAR * scale + 1e-12 * peak) & (change > 10 * noise)
            turns = np.any(clear & (noise <= 1e-4 * scale)) or np.count_nonzero(clear) > 0.02 * np.count_nonzero(told)
        if turns:
            return True
        here, there = (np.stack([turned(angle + step) for step in TREMORS]) for angle in (0.0, turn))
        return bool(np.count_nonzero(apart(here, there, clean) & told) >= _SECTOR)


def _directions(cosine: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors, shape (3, rows, directions)."""
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])
