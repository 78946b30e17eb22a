"""The best factors: against linear programs on dense grids, known optima, and the alternation that marks an optimum."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from brdfcheck.fits.minimax import Ceiling, best_rational, extrema, spread


def blinn(n):
    return 8 * np.pi * (2 ** (-n / 2) + n) / ((n + 2) * (n + 4))


def test_spread_has_the_ends_exactly():
    for low, high in ((1, 1000), (0, 1e5), (3, 3)):
        n = spread(low, high, 17)
        assert n[0] == low
        assert n[-1] == high
        assert np.all(np.diff(n) > 0)
    assert spread(3, 3, 17).size == 1


def test_extrema_between_grid_points_and_at_kinks():
    grid = np.linspace(0, 10, 30)

    def smooth(x):
        return np.sin(x)

    place, value = extrema(smooth, grid, smooth(grid), 9)
    assert value.max() == pytest.approx(1, abs=1e-14)
    assert value.min() == pytest.approx(-1, abs=1e-14)
    assert np.min(np.abs(place - np.pi / 2)) < 1e-6

    def kinked(x):
        return -np.abs(x - np.sqrt(7))

    place, value = extrema(kinked, grid, kinked(grid), 12)
    assert place[np.argmax(value)] == pytest.approx(np.sqrt(7), abs=1e-9)


@pytest.mark.parametrize("limits", [(1.0, 1000.0), (0.0, 30.0), (5.0, 1e5), (100.0, 101.0)])
@pytest.mark.parametrize("exponent", [0.7, 1.0, 1.3])
def test_two_constants_against_a_dense_linear_program(limits, exponent):
    """The same optimum without exchange: one program on 20,000 exponents, in other variables."""
    low, high = limits

    def raw(n):
        return (1 + n) ** -exponent * (1.2 + np.sin(np.log1p(n)))

    best, _ = best_rational(raw, spread(low, high, 129), (1, 0))
    n = spread(low, high, 20_000)
    albedo, ones = raw(n), np.ones(n.size)
    rows = np.block(
        [[(n / high * albedo)[:, None], albedo[:, None], 0 * ones[:, None]],
         [-(n / high * albedo)[:, None], -albedo[:, None], ones[:, None]]]
    )  # fmt: skip
    dense = linprog([0, 0, -1], rows, np.r_[ones, 0 * ones], bounds=(None, None), method="highs")
    assert best.smallest == pytest.approx(dense.x[2], abs=2e-7)
    assert best.largest <= 1 + 1e-11


@pytest.mark.parametrize("width", [1e-8, 1e-6, 1e-4, 1e-2, 1.0, 1e4, 1e8, 1e12])
@pytest.mark.parametrize("low", [0.0, 1.0, 1000.0])
def test_ranges_of_any_width(low, width):
    """A lobe whose exact factor is a line: found however narrow or wide the range."""
    high = low + width * max(low, 1)
    for degrees in ((1, 0), (2, 1), (3, 2)):
        best, _ = best_rational(lambda n: 2 * np.pi / (n + 2), spread(low, high, 129), degrees)
        assert best.smallest == pytest.approx(1, abs=1e-8)
        assert best.largest <= 1 + 1e-9


def test_a_raw_albedo_that_rises_steeply_takes_the_best_falling_line():
    """The tangent of exp(-n): the line below it whose smallest product with exp(n) is largest, in closed form.

    Below exp(-n) on [30, 32] the best line is its tangent at some n = c, and the smallest product is at one of the ends,
    (1 + c - n) exp(n - c): equal at both where (1 + x) exp(-x) = (x - 1) exp(2 - x), x = c - 30.
    """
    best, _ = best_rational(lambda n: np.exp(n), spread(30, 32, 257), (1, 0))
    x = (np.e**2 + 1) / (np.e**2 - 1)
    assert best.numerator[1] < 0
    assert best.smallest == pytest.approx((1 + x) * np.exp(-x), abs=1e-9)
    assert -best.numerator[0] / best.numerator[1] == pytest.approx(31 + x, abs=1e-4)
    # The same over 60 decades, where no smallest albedo is worth having, is at least positive and below the line at 1.
    for high in (60.0, 140.0):
        best, _ = best_rational(lambda n: np.exp(n), spread(1, high, 257), (1, 0))
        assert 0 < best.smallest <= best.largest <= 1 + 1e-9
        assert best.smallest > np.exp(1 - high) * 1.01  # a constant gives exp(1 - high)


def test_the_optimum_alternates():
    """Chebyshev's mark: 1 and the smallest albedo in turn, at one place more than there are constants."""
    best, _ = best_rational(blinn, spread(1, 1000, 257), (2, 1))
    n = spread(1, 1000, 200_001)
    albedo = best(n) * blinn(n)
    touches = []
    for value in albedo:
        mark = 1 if value > 1 - 1e-6 else -1 if value < best.smallest + 1e-6 else 0
        if mark and (not touches or touches[-1] != mark):
            touches.append(mark)
    assert len(touches) >= 5  # four free constants
    assert np.all(np.diff(touches) != 0)


def test_denominators_have_no_pole_in_the_range():
    for form in ((2, 1), (3, 2), (4, 3)):
        best, _ = best_rational(blinn, spread(1, 1000, 257), form)
        n = spread(1, 1000, 100_001)
        denominator = np.polyval(best.denominator[::-1], n)
        assert np.all(denominator * denominator[0] > 0)


def test_a_ceiling_is_kept():
    grid = spread(1, 1000, 129)
    ceiling = Ceiling(np.array([50.0]), blinn(np.array([50.0])) * 1.5)
    free, _ = best_rational(blinn, grid, (1, 0))
    held, _ = best_rational(blinn, grid, (1, 0), ceiling)
    assert free(np.array([50.0]))[0] * ceiling.albedo[0] > 1
    assert held(np.array([50.0]))[0] * ceiling.albedo[0] <= 1 + 1e-10
    assert held.smallest < free.smallest


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf])
def test_a_raw_albedo_that_cannot_be_normalised(wrong):
    with pytest.raises(ValueError, match="raw albedo must be finite and > 0"):
        best_rational(lambda n: np.where(n > 50, wrong, 1 / n), spread(1, 100, 33), (1, 0))
