"""The way up the crest of a kink: it arrives at the top whatever way the crest runs, and says what may be left."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from brdfcheck.verdict.box import Box
from brdfcheck.verdict.kinks import is_kinked, top_of_crest

TOP = 1.00000003

# Across the crest (u), along it (v), and from its top: (slope across, slope along) -> the fall below the top.
CRESTS: dict[str, Callable[..., np.ndarray]] = {
    "round": lambda u, v, r, a, b: a * np.abs(u) + b * r**2,
    "peak": lambda u, v, r, a, b: a * np.abs(u) + 0.3 * b * np.maximum(v, -0.2 * v) + 0.05 * b * r**2,
    "two kinks": lambda u, v, r, a, b: a * np.maximum(u, -0.1 * u) + 0.3 * a * np.abs(v - 0.5 * u) + b * r**2,
    "curved": lambda u, v, r, a, b: a * np.abs(u - 0.4 * v**2) + b * r**2,
}


def planted(kind: str, seed: int) -> tuple[Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], Box, np.ndarray]:
    """A surface over 2 or 3 parameters and an angle that does not matter, its box, and a place on the crest, off the top."""
    random = np.random.default_rng(seed)
    dimension = int(random.integers(2, 4))
    slope = 10 ** random.uniform(-5, -2)
    along = slope * 10 ** random.uniform(-2, 0)
    across, crest = np.linalg.qr(random.normal(size=(dimension, 2)))[0].T
    top = random.uniform(0.15, 0.85, dimension)

    def surface(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        apart = points[:, :dimension] - top
        fall = CRESTS[kind](apart @ across, apart @ crest, np.linalg.norm(apart, axis=1), slope, along)
        return TOP - fall, np.zeros(len(points))

    off = random.uniform(0.02, 0.1)
    start = top + off * crest + (0.4 * off**2 * across if kind == "curved" else 0)
    box = Box({f"p{i}": (0.0, 1.0) for i in range(dimension)}, (0.0, 1.0), turning=False)
    return surface, box, np.append(np.clip(start, 0.01, 0.99), 0.5)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("kind", CRESTS)
def test_the_top_of_a_crest_is_reached(kind: str, seed: int):
    surface, box, start = planted(kind, seed)
    below = TOP - float(surface(start[None])[0][0])
    top = top_of_crest(surface, box, start)
    assert top.value == surface(top.place[None])[0][0]
    # A curved crest is none of a concave surface: its gap is that of the last steps.
    assert TOP - top.value <= top.gap + (1e-9 if kind == "curved" else 1e-11)
    assert TOP - top.value < (1 if kind == "curved" else 0.01) * below


def test_a_kink_is_told_from_a_bend():
    box = Box({"p": (0.0, 1.0), "q": (0.0, 1.0)}, (1.0, 1.0), turning=False)
    place = np.array([0.4, 0.6])
    across = np.array([0.6, 0.8])

    def kink(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 1 - 1e-5 * np.abs((points - place) @ across), np.zeros(len(points))

    def bend(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.exp(-10 * ((points - place) @ across) ** 2), np.zeros(len(points))

    assert is_kinked(kink, box, place, 1e-9)
    assert not is_kinked(bend, box, place, 1e-9)
    # What rises and falls by less than a rule errs is not seen.
    assert not is_kinked(lambda points: (kink(points)[0], np.full(len(points), 1e-3)), box, place, 1e-9)
