"""Climbs: they arrive on what is smooth, on ridges, kinks and ends of the box, and say honestly what may be left."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from brdfcheck.verdict.box import Box
from brdfcheck.verdict.climb import Climbs, climb

Surface = Callable[[np.ndarray], np.ndarray]


def cube(dimension: int, *, turning: bool = False) -> Box:
    """A box of as many parameters; with `turning` one of them is the azimuth."""
    return Box({f"p{i}": (0.0, 1.0) for i in range(dimension - turning)}, (1.0, 1.0), turning=turning)


def climbed(surface: Surface, starts: np.ndarray, box: Box | None = None, error: float = 1e-15, **options) -> Climbs:
    def function(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return surface(points), np.full(len(points), error)

    settings = {"goal": 1e-12, "rounds": 60, "smallest": 1e-12, **options}
    return climb(function, box or cube(starts.shape[1]), starts, 0.05, **settings)


def honest(ends: Climbs, top: float) -> None:
    """What the climbs left is no more than they say, and values are those of their places."""
    assert np.all(ends.values <= top + 1e-14)
    assert np.all(top - ends.values <= ends.gaps + 1e-13)


STARTS = {dimension: np.random.default_rng(dimension).uniform(0, 1, (12, dimension)) for dimension in (1, 2, 3, 6, 8)}


@pytest.mark.parametrize("dimension", STARTS)
def test_a_smooth_hill_with_mixed_terms(dimension: int):
    random = np.random.default_rng(10 + dimension)
    place = random.uniform(0.2, 0.8, dimension)
    factor = random.normal(0, 1, (dimension, dimension))
    matrix = factor @ factor.T + 0.1 * np.eye(dimension)

    def hill(points: np.ndarray) -> np.ndarray:
        x = points - place
        return np.exp(-np.einsum("ci,ij,cj->c", x, matrix, x) / dimension)

    ends = climbed(hill, STARTS[dimension])
    honest(ends, 1.0)
    assert np.max(ends.values) == pytest.approx(1, abs=1e-13)
    assert np.all(ends.values[ends.settled] > 1 - 1e-11)
    assert np.count_nonzero(ends.settled) >= 10
    np.testing.assert_allclose(ends.places[np.argmax(ends.values)], place, atol=1e-5)


def test_a_bent_ridge():
    """Rosenbrock's, whose ridge is a parabola: 1 at (1/2, 1/2)."""

    def ridge(points: np.ndarray) -> np.ndarray:
        x, y = 4 * points.T - 1
        return 1 - 0.01 * ((1 - x) ** 2 + 100 * (y - x**2) ** 2)

    ends = climbed(ridge, STARTS[2], rounds=150)
    honest(ends, 1.0)
    assert np.max(ends.values) == pytest.approx(1, abs=1e-11)
    assert np.all(ends.values[ends.settled] > 1 - 1e-9)


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_a_ridge_that_is_a_kink_across_the_axes(dimension: int):
    def roof(points: np.ndarray) -> np.ndarray:
        return 1 - np.abs(points.sum(axis=1) - 0.45 * dimension) - 0.1 * np.sum((points - 0.45) ** 2, axis=1)

    ends = climbed(roof, STARTS[dimension], rounds=150)
    honest(ends, 1.0)
    assert np.max(ends.values) > 1 - 1e-3


@pytest.mark.parametrize("dimension", [1, 2])
def test_a_kink_along_the_axes_is_closed_in_on(dimension: int):
    place = np.array([0.387, 0.651])[:dimension]

    def tent(points: np.ndarray) -> np.ndarray:
        return 1 - np.sum(np.abs(points - place), axis=1)

    ends = climbed(tent, STARTS[dimension], rounds=150)
    honest(ends, 1.0)
    assert np.max(ends.values) > 1 - 1e-9


@pytest.mark.parametrize("dimension", [1, 3, 6])
def test_at_a_corner_and_on_a_face_of_the_box(dimension: int):
    def corner(points: np.ndarray) -> np.ndarray:
        return np.exp(points - 1).mean(axis=1)

    ends = climbed(corner, STARTS[dimension])
    honest(ends, 1.0)
    np.testing.assert_array_equal(ends.places, 1.0)
    assert np.all(ends.settled)

    def face(points: np.ndarray) -> np.ndarray:
        return 1 - points[:, 0] - np.sum((points[:, 1:] - 0.4) ** 2, axis=1)

    ends = climbed(face, STARTS[dimension])
    honest(ends, 1.0)
    np.testing.assert_array_equal(ends.places[:, 0], 0.0)
    np.testing.assert_allclose(ends.places[:, 1:], 0.4, atol=1e-5)


def test_a_square_root_at_the_end_of_the_box():
    """As albedos behave at grazing incidence: steeper and steeper towards the end."""
    ends = climbed(lambda points: 1 - np.sqrt(points[:, 0]), np.array([[0.4], [0.03], [1e-4]]), rounds=100)
    honest(ends, 1.0)
    np.testing.assert_array_equal(ends.places, 0.0)


def test_a_plateau_is_left_at_once():
    calls = 0

    def flat(points: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        return np.full(len(points), 0.75)

    ends = climbed(flat, STARTS[3])
    assert np.all(ends.settled)
    np.testing.assert_array_equal(ends.values, 0.75)
    np.testing.assert_array_equal(ends.gaps, 0)
    assert calls < 20


def test_a_hill_on_a_plateau_is_climbed_from_its_foot():
    ends = climbed(lambda points: np.maximum(0.5, 1 - ((points[:, 0] - 0.3) / 0.1) ** 2), np.array([[0.24], [0.37]]))
    honest(ends, 1.0)
    np.testing.assert_allclose(ends.places, 0.3, atol=1e-6)


def test_over_the_seam_of_the_azimuth():
    def wave(points: np.ndarray) -> np.ndarray:
        return np.cos(2 * np.pi * (points[:, 1] - 0.98)) - (points[:, 0] - 0.5) ** 2

    ends = climbed(wave, np.array([[0.4, 0.05], [0.6, 0.9]]), cube(2, turning=True))
    honest(ends, 1.0)
    np.testing.assert_allclose(ends.places, [[0.5, 0.98]] * 2, atol=1e-5)
    # A parameter does not go round: its climb ends at the end.
    ends = climbed(lambda points: np.cos(2 * np.pi * (points[:, 0] - 0.98)), np.array([[0.05]]))
    assert ends.places[0, 0] == 0


def test_what_only_rounds_is_no_hill():
    """Values that err by 1e-6 each in their own way: what is left is within some of these errors."""

    def rough(points: np.ndarray) -> np.ndarray:
        noise = np.sin(1e7 * points.sum(axis=1)) * 1e-6
        return 1 - np.sum((points - 0.4) ** 2, axis=1) + noise

    ends = climbed(rough, STARTS[2], error=1e-6)
    assert np.all(ends.values > 1 - 1e-4)
    assert np.all(ends.values <= 1 + 1e-6)


def test_jumps_are_survived():
    def step(points: np.ndarray) -> np.ndarray:
        return np.where(points[:, 0] < 0.4, 1 + points[:, 0], 0.5)

    ends = climbed(step, np.array([[0.2], [0.35]]), rounds=100)
    assert np.all(ends.values > 1.4 - 1e-6)
    assert np.all(np.isfinite(ends.gaps))


def test_what_is_no_number_is_not_climbed_to():
    def hole(points: np.ndarray) -> np.ndarray:
        return np.where(points[:, 0] > 0.5, np.nan, points[:, 0])

    ends = climbed(hole, np.array([[0.2], [0.9]]), rounds=100)
    assert ends.values[0] == pytest.approx(0.5, abs=1e-5)
    assert ends.places[0, 0] <= 0.5
    assert np.isnan(ends.values[1])
    assert not ends.settled[1]


def test_mixed_derivatives_are_found_and_can_be_given():
    def hill(points: np.ndarray) -> np.ndarray:
        x, y = points.T - 0.45
        return 1 - x * x - y * y - 1.7 * x * y

    found = climbed(hill, STARTS[2])
    best = np.argmax(found.values)
    np.testing.assert_allclose(found.mixed[best], [[-2, -1.7], [-1.7, -2]], atol=1e-2)
    counted = []

    def count(points: np.ndarray) -> np.ndarray:
        counted.append(len(points))
        return hill(points)

    again = climbed(count, STARTS[2][:1], mixed=np.array([[[-2.0, -1.7], [-1.7, -2.0]]]))
    honest(again, 1.0)
    assert again.values == pytest.approx(1, abs=1e-13)
    assert counted[1] == 4  # two points an axis, none for the pair


def test_hopeless_climbs_are_given_up():
    def two(points: np.ndarray) -> np.ndarray:
        x = points[:, 0]
        return np.maximum(1 - 30 * (x - 0.2) ** 2, 0.4 - 30 * (x - 0.8) ** 2)

    ends = climbed(two, np.array([[0.25], [0.85]]), drop=1e-2)
    assert ends.values[0] == pytest.approx(1, abs=1e-12)
    assert not ends.settled[1]
    both = climbed(two, np.array([[0.25], [0.85]]))
    assert both.values == pytest.approx([1, 0.4], abs=1e-11)


def test_nothing_to_climb():
    ends = climb(lambda points: (np.ones(len(points)), np.zeros(len(points))), cube(0), np.zeros((2, 0)), 0.1,
                 goal=1e-9, rounds=5, smallest=1e-9)  # fmt: skip
    assert ends.values.tolist() == [1, 1]
    assert ends.gaps.tolist() == [0, 0]
    assert ends.settled.all()


def test_an_observer_is_called_once_a_round():
    rounds = []
    climbed(lambda points: 1 - (points[:, 0] - 0.3) ** 2, STARTS[1], rounds=3, check=lambda: rounds.append(1))
    assert 1 <= len(rounds) <= 3
