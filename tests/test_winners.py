"""What confirmed places say together: who wins, how high the others may be, and which climbs were not finished."""

from __future__ import annotations

import numpy as np
import pytest

from brdfcheck.verdict.box import Box
from brdfcheck.verdict.winners import Winners


@pytest.fixture
def winners() -> Winners:
    return Winners(Box({"a": (0.0, 1.0), "b": (0.0, 1.0)}, (1.0, 1.0), turning=False))


def put(winners: Winners, place: tuple[float, float], value: float, error: float = 1e-9, asked: float = 1e-9, **more) -> None:
    winners.add(np.array([place]), np.array([value]), np.array([error]), asked, **more)


def test_of_values_that_are_equal_within_their_errors_the_best_known_wins(winners: Winners):
    put(winners, (0.1, 0.1), 0.9 + 1e-6, 1e-5)
    put(winners, (0.9, 0.9), 0.9, 1e-9)
    assert winners.top == 1
    assert winners.best == 0.9 + 1e-6
    assert winners.least == 0.9 - 1e-9
    assert winners.reach().max() == pytest.approx(0.9 + 1.1e-5)


def test_a_place_that_is_asked_twice_is_one(winners: Winners):
    put(winners, (0.1, 0.1), 0.9, 1e-5, 1e-5, gaps=1e-3, settled=False, climbed=True)
    put(winners, (0.1, 0.1), 0.900001, 1e-9)
    assert len(winners) == 1
    assert (winners.values[0], winners.errors[0], winners.asked[0]) == (0.900001, 1e-9, 1e-9)
    assert (winners.gaps[0], bool(winners.settled[0]), bool(winners.climbed[0])) == (1e-3, False, True)
    # The limit there is another number.
    put(winners, (0.1, 0.1), 0.95, 1e-7, limit=True)
    assert len(winners) == 2
    # Of two that exclude each other the larger one, whatever its bar.
    put(winners, (0.1, 0.1), 0.91, 1e-4)
    assert winners.values[0] == 0.91
    put(winners, (0.1, 0.1), 0.90, 1e-12)
    assert winners.values[0] == 0.91


def test_neighbours_on_a_steep_slope_are_two(winners: Winners):
    put(winners, (0.1, 0.1), 0.9, gaps=1e-6, climbed=True)
    put(winners, (0.1 + 1e-9, 0.1), 0.9 + 1e-8, climbed=True)
    assert len(winners) == 2
    assert winners.reach().max() == pytest.approx(0.9 + 1.1e-8, abs=1e-13)


def test_what_a_climb_left_counts_where_nothing_better_is_known(winners: Winners):
    put(winners, (0.1, 0.1), 0.9, climbed=True)
    put(winners, (0.8, 0.8), 0.8999, asked=1e-5, gaps=5e-3, settled=False, climbed=True)
    assert winners.reach().max() == pytest.approx(0.9049)
    assert winners.open().tolist() == [1]
    assert winners.unsettled(0.94)
    assert not winners.unsettled(1.0)  # not with ten times what it promises
    # Too low to matter; beside the winner; beside one with all digits.
    for place, value in (((0.5, 0.1), 0.85), ((0.13, 0.1), 0.8999), ((0.8011, 0.8), 0.8999)):
        put(winners, place, value, asked=1e-5, gaps=5e-3, settled=False, climbed=True)
    put(winners, (0.8001, 0.8), 0.89995, gaps=1e-12, climbed=True)
    assert winners.open().tolist() == []
    assert winners.reach().max() == pytest.approx(0.9 + 1e-9, abs=1e-12)


def test_the_winners_own_climb_counts(winners: Winners):
    put(winners, (0.1, 0.1), 0.9, gaps=2e-4, settled=False, climbed=True)
    assert winners.open().tolist() == [0]
    assert winners.reach()[0] == pytest.approx(0.9002)
    assert winners.unsettled(0.9015)


def test_more_digits_are_asked_of_what_may_be_the_highest_by_its_error_alone(winners: Winners):
    put(winners, (0.1, 0.1), 0.9)
    for value, error, asked in ((0.89999, 1e-4, 1e-5), (0.89998, 1e-4, 1e-9), (0.8, 1e-4, 1e-5), (0.89999, 1e-3, 1e-5)):
        put(winners, (value, error), value, error, asked)
    put(winners, (0.3, 0.3), 0.9, 1e-3, 1e-5, limit=True)
    assert winners.loose(1e-9).tolist() == [4, 1]


def test_nothing_is_known(winners: Winners):
    assert (len(winners), winners.best, winners.least, winners.open().tolist()) == (0, -np.inf, -np.inf, [])
    assert not winners.broken
    put(winners, (0.1, 0.1), np.nan, np.inf)
    assert winners.broken
    assert winners.open().tolist() == []
    put(winners, (0.2, 0.1), np.inf, np.inf)
    assert winners.best == -np.inf
