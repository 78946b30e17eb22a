"""The limit at grazing incidence: powers of the cosine, growth without bound, and growth that is held somewhere."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest

from brdfcheck.quadrature.limit import grazing_limit


def limit(function: Callable[[float], float], error: float = 1e-12) -> tuple[float, float]:
    value, bar = grazing_limit(lambda mu: (np.asarray(function(mu)), np.full(np.shape(function(mu)), error)))
    return float(value), float(bar)


POWERS = np.round(np.arange(0.1, 1.01, 0.1), 1)


@pytest.mark.parametrize("slope", [0.8, -0.8, 1e-3, -1e-6])
@pytest.mark.parametrize("power", POWERS)
def test_a_power_of_the_cosine(power: float, slope: float):
    value, bar = limit(lambda mu: 0.7 + slope * mu**power)
    assert abs(value - 0.7) <= bar
    assert bar < 1e-9


@pytest.mark.parametrize("error", [1e-12, 1e-9])
@pytest.mark.parametrize("power", [*POWERS, 0.02, 0.05])
def test_a_power_of_any_size_is_in_the_bar(power: float, error: float):
    """Also where the differences are as small as the errors."""
    for size in np.geomspace(1e-13, 1, 200):
        value, bar = limit(lambda mu, size=size: 0.7 - size * mu**power, error)
        assert abs(value - 0.7) <= bar, size


@pytest.mark.parametrize("slope", [0.9, -0.9, 0.01, -1e-4])
@pytest.mark.parametrize("power", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("offset", [0.3, 1.0, 5.0])
def test_a_power_of_the_logarithm(offset: float, power: float, slope: float):
    value, bar = limit(lambda mu: 0.7 - slope / (offset - np.log(mu)) ** power, 1e-11)
    assert abs(value - 0.7) <= bar
    assert bar < 0.15 * abs(slope)
    assert abs(value - 0.7) < abs(slope) / (offset - np.log(1e-9)) ** power  # nearer than the last decade


@pytest.mark.parametrize("function", [lambda mu: np.log(1 - np.log(mu)), lambda mu: np.sqrt(1 - np.log(mu))])
def test_growth_slower_than_a_logarithm_has_no_limit(function: Callable[[float], float]):
    assert limit(function) == (np.inf, np.inf)


def test_where_the_square_of_the_cosine_underflows_the_decades_count():
    value, bar = limit(lambda mu: 0.7 - 0.3 / (1 - np.log(mu)) if mu > 1e-100 else 0.0, 1e-11)
    assert abs(value - 0.7) <= bar


# What is left when the first power is gone, for a first power p: another power, and logarithms.
NEXT: dict[str, Callable] = {
    "another power": lambda mu, p, b, c, q: b * mu**p + c * mu ** (p * q),
    "half a power more": lambda mu, p, b, c, q: b * mu**p + c * mu ** (p + 0.5),
    "a logarithm": lambda mu, p, b, c, q: (b - c * np.log(mu)) * mu**p,
    "a root with a logarithm": lambda mu, p, b, c, q: b * np.sqrt(mu) * np.log(mu) + c * (mu + np.sqrt(mu)),
    "a fraction": lambda mu, p, b, c, q: b * mu**p / (1 + c * c * mu ** (p * (q - 1))),
}


@pytest.mark.parametrize("powers", [(0.3, 1.2), (0.15, 0.35)])
@pytest.mark.parametrize("name", NEXT)
def test_what_comes_next_is_in_the_bar(name: str, powers: tuple[float, float]):
    """One difference may be small by chance; of these the bars that took it for a bound were up to 200 times too short."""
    random, far = np.random.default_rng(7), []
    for _ in range(1000):
        p, q = random.choice([random.uniform(*powers), powers[0] + 0.2, powers[1] - 0.2]), random.uniform(1.1, 3)
        b, c, error = random.normal(), random.normal() * 10 ** random.uniform(-2, 1), 10 ** random.uniform(-12, -9)
        found = functools.partial(NEXT[name], p=p, b=b, c=c, q=q)
        value, bar = limit(lambda mu, found=found, off=0.3 * error: found(mu) + off * random.uniform(-1, 1), error)
        far.append(abs(value) / bar)
    assert max(far) <= 1
    assert np.median(far) > 1e-3  # nor are they long


@pytest.mark.parametrize("power", [0.2, 0.3, 0.5])
def test_two_powers(power: float):
    value, bar = limit(lambda mu: 1.02 - 0.3 * mu**power + 0.2 * mu ** (2 * power) + 0.1 * mu)
    assert abs(value - 1.02) <= bar
    assert bar < 1e-2
    assert abs(value - 1.02) < 0.1 * abs(0.3 * 1e-9**power)  # much better than the last value


@pytest.mark.parametrize("error", [1e-14, 1e-10, 1e-7])
def test_a_constant_takes_two_values(error: float):
    asked = []

    def flat(mu: float) -> float:
        asked.append(mu)
        return 0.4

    value, bar = grazing_limit(lambda mu: (np.asarray(flat(mu)), np.asarray(error)))
    assert (value, bar) == (0.4, error)
    assert len(asked) == 2


def test_values_that_differ_by_their_errors_only():
    for seed in range(50):
        random = np.random.default_rng(seed)
        seen: dict[float, float] = {}
        value, bar = limit(lambda mu: seen.setdefault(mu, 0.4 + random.uniform(-1e-7, 1e-7)), 1e-7)  # noqa: B023
        assert abs(value - 0.4) <= bar
        assert bar < 5e-6  # 25 times the last change: a slow power might hide in it


GROWTH = {
    "logarithm": lambda mu: 0.3 - 0.01 * np.log(mu),
    "logarithm squared": lambda mu: 0.01 * np.log(mu) ** 2,
    "power 1": lambda mu: 1e-3 / mu,
    "power 1/2": lambda mu: mu**-0.5,
    "power 1/20": lambda mu: mu**-0.05,
    "at last": lambda mu: 0.5 + 1e-5 * mu**-0.5,
    "infinite": lambda mu: np.inf,
    "infinite from somewhere on": lambda mu: 1e290 / mu**2 if mu > 1e-8 else np.inf,
}


@pytest.mark.parametrize("name", GROWTH)
def test_growth_without_bound(name: str):
    assert limit(GROWTH[name]) == (np.inf, np.inf)


@pytest.mark.parametrize("held", [1e-6, 1e-12])
@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("growth", [lambda mu: -0.1 * np.log(mu), lambda mu: mu**-0.25])
def test_growth_that_is_held_somewhere(growth: Callable, smooth: bool, held: float):
    """By a guard of the form max(mu, 1e-12), or mu + 1e-12: the limit is what it is there."""
    value, bar = limit(lambda mu: float(growth(mu + held if smooth else max(mu, held))))
    assert np.isfinite(value)
    assert abs(value - growth(held)) <= bar
    assert bar <= 2e-3 * value


def test_a_fall_without_bound_is_not_known():
    value, bar = limit(lambda mu: 0.3 + 0.01 * np.log(mu))
    assert np.isfinite(value)
    assert np.isinf(bar)


@pytest.mark.parametrize("from_", [1.0, 3e-9])
def test_what_is_not_a_number(from_: float):
    value, bar = limit(lambda mu: np.nan if mu < from_ else 0.5)
    assert np.isnan(value)
    assert np.isinf(bar)


def test_channels_have_limits_of_their_own():
    value, bar = grazing_limit(
        lambda mu: (np.array([0.25, 0.5 - mu**0.5, mu**-0.5, max(mu, 1e-12) ** -0.25]), np.full(4, 1e-12))
    )
    assert value.shape == bar.shape == (4,)
    np.testing.assert_allclose(value, [0.25, 0.5, np.inf, 1e3], rtol=1e-9)
    assert np.all(bar[[0, 1]] < 1e-9)
