"""Interval arithmetic in floating point, against 60 digits: values and slopes are contained, and a wrong rounding is caught."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from decimal import Decimal, getcontext
from typing import Any

import numpy as np
import pytest

from brdfcheck.proof import enclosures as e
from brdfcheck.proof import intervals
from brdfcheck.proof.enclosures import Enclosed
from brdfcheck.proof.operations import OPERATIONS

PI = Decimal(intervals.pi().low) / Decimal(2**intervals.BITS)


@pytest.fixture(autouse=True)
def digits() -> Any:
    before = getcontext().prec
    getcontext().prec = 60
    yield
    getcontext().prec = before


def series(first: Decimal, ratio: Callable[[int], Decimal]) -> Decimal:
    total, term, k = first, first, 0
    while abs(term) > Decimal(10) ** -70 or k < 4:
        term *= ratio(k)
        total += term
        k += 1
    return total


def sine(x: Decimal) -> Decimal:
    return series(x, lambda k: -x * x / ((2 * k + 2) * (2 * k + 3)))


def cosine(x: Decimal) -> Decimal:
    return series(Decimal(1), lambda k: -x * x / ((2 * k + 1) * (2 * k + 2)))


def arctangent(x: Decimal) -> Decimal:
    for _ in range(4):
        x = x / (1 + (1 + x * x).sqrt())
    total, term, k = x, x, 0
    while abs(term) > Decimal(10) ** -70:
        term *= -x * x
        k += 1
        total += term / (2 * k + 1)
    return 16 * total


def error_function(x: Decimal) -> Decimal:
    total, term, k = x, x, 0
    while abs(term) > Decimal(10) ** -70:
        k += 1
        term *= -x * x / k
        total += term / (2 * k + 1)
    return 2 * total / PI.sqrt()


def hyperbolic_tangent(x: Decimal) -> Decimal:
    return 1 - 2 / ((2 * x).exp() + 1)


def to_the(a: Decimal, b: Decimal) -> Decimal:
    return (b * a.ln()).exp() if a else Decimal(b == 0)


# Name: (the domain of each argument, reference, further parameters).
WIDE, POSITIVE, UNIT, SMALL = (-20.0, 20.0), (0.0, 30.0), (-1.0, 1.0), (-4.0, 4.0)
CASES: dict[str, tuple[tuple[tuple[float, float], ...], Callable[..., Decimal], dict[str, int]]] = {
    "add": ((WIDE, WIDE), lambda a, b: a + b, {}),
    "sub": ((WIDE, WIDE), lambda a, b: a - b, {}),
    "mul": ((WIDE, WIDE), lambda a, b: a * b, {}),
    "div": ((WIDE, (0.1, 9.0)), lambda a, b: a / b, {}),
    "neg": ((WIDE,), lambda a: -a, {}),
    "max": ((WIDE, WIDE), max, {}),
    "min": ((WIDE, WIDE), min, {}),
    "abs": ((WIDE,), lambda a: abs(a), {}),
    "square": ((WIDE,), lambda a: a * a, {}),
    "integer_pow": ((SMALL,), lambda a: a**7, {"y": 7}),
    "sqrt": ((POSITIVE,), lambda a: a.sqrt(), {}),
    "rsqrt": (((0.01, 30.0),), lambda a: 1 / a.sqrt(), {}),
    "exp": ((WIDE,), lambda a: a.exp(), {}),
    "exp2": ((WIDE,), lambda a: (a * Decimal(2).ln()).exp(), {}),
    "expm1": ((WIDE,), lambda a: a.exp() - 1, {}),
    "log": (((1e-3, 30.0),), lambda a: a.ln(), {}),
    "log1p": (((-0.9, 30.0),), lambda a: (1 + a).ln(), {}),
    "logistic": ((WIDE,), lambda a: 1 / (1 + (-a).exp()), {}),
    "sin": ((WIDE,), sine, {}),
    "cos": ((WIDE,), cosine, {}),
    "tan": (((-1.5, 1.5),), lambda a: sine(a) / cosine(a), {}),
    "tanh": ((WIDE,), hyperbolic_tangent, {}),
    "atan": ((WIDE,), arctangent, {}),
    "atan2": ((WIDE, (0.1, 9.0)), lambda y, x: arctangent(y / x), {}),
    "cbrt": (((0.01, 30.0),), lambda a: to_the(a, Decimal(1) / 3), {}),
    "sinh": ((SMALL,), lambda a: (a.exp() - (-a).exp()) / 2, {}),
    "cosh": ((SMALL,), lambda a: (a.exp() + (-a).exp()) / 2, {}),
    "asin": (((-0.99, 0.99),), lambda a: arctangent(a / (1 - a * a).sqrt()), {}),
    "acos": (((-0.99, 0.99),), lambda a: PI / 2 - arctangent(a / (1 - a * a).sqrt()), {}),
    "erf": ((SMALL,), error_function, {}),
    "pow": (((0.0, 3.0), (0.0, 40.0)), to_the, {}),
    "clamp": ((SMALL, WIDE, (5.0, 9.0)), lambda low, x, high: min(max(x, low), high), {}),
}
EACH = 380


def escapes(name: str, count: int, seed: int) -> list[str]:
    """Values, and quotients of differences, that are not where their enclosures say: of random intervals, narrow and wide."""
    domains, reference, parameters = CASES[name]
    numbers = random.Random(seed)
    ends, points, others = [], [], []
    for low, high in domains:
        rows = []
        for _ in range(count):
            size = (high - low) * 10 ** numbers.uniform(-12, 0)
            first = numbers.uniform(low, high - size)
            last = min(first + size, high)
            rows.append(
                (first, last, numbers.choice((first, last, numbers.uniform(first, last))), numbers.uniform(first, last))
            )
        columns = np.array(rows).T
        ends.append((columns[:1], columns[1:2]))
        points.append(columns[2])
        others.append(columns[3])
    width = len(domains)
    given = [Enclosed(pair, tuple(e.ONE if i == j else None for j in range(width))) for i, pair in enumerate(ends)]
    with np.errstate(all="ignore"):
        found = OPERATIONS[name](*given, **parameters)
    low, high = (np.broadcast_to(x, (1, count))[0] for x in found.ends)
    wrong = []
    for k in range(count):
        place = [Decimal(float(column[k])) for column in points]
        value = reference(*place)
        if not Decimal(float(low[k])) <= value <= Decimal(float(high[k])):
            wrong.append(f"{name}{tuple(map(float, place))} = {value} is not in [{low[k]!r}, {high[k]!r}]")
        for i, slope in enumerate(found.slopes):
            other = list(place)
            other[i] = Decimal(float(others[i][k]))
            if other[i] == place[i]:
                continue
            quotient = (reference(*other) - value) / (other[i] - place[i])
            first, last = (0.0, 0.0) if slope is None else (float(np.broadcast_to(x, (1, count))[0, k]) for x in slope)
            noise = Decimal(10) ** -35 * (1 + abs(value)) / abs(other[i] - place[i])  # of the reference
            if not Decimal(first) - noise <= quotient <= Decimal(last) + noise:
                wrong.append(f"the slope {quotient} of {name}{tuple(map(float, place))} is not in [{first!r}, {last!r}]")
    return wrong


@pytest.mark.parametrize("name", CASES)
def test_values_and_slopes_are_contained(name):
    assert not escapes(name, EACH, 1)


def test_ten_thousand_operations():
    assert len(CASES) * EACH >= 10_000


@pytest.mark.parametrize("name", ["add", "mul", "div", "sqrt", "exp", "sin", "pow"])
def test_an_operation_that_rounds_inwards_is_caught(name, monkeypatch):
    true = e.out

    def inwards(low: np.ndarray, high: np.ndarray, relative: float = 2.0**-51) -> tuple[np.ndarray, np.ndarray]:
        wide = true(low, high, relative)
        return 2 * low - wide[0], 2 * high - wide[1]

    monkeypatch.setattr(e, "out", inwards)
    assert escapes(name, 200, 2)


def test_a_wrong_derivative_is_caught(monkeypatch):
    monkeypatch.setitem(OPERATIONS, "tanh", lambda a: a.chained(e.tanh(a).ends, lambda: e.square(e.tanh(a).ends)))
    assert any("slope" in line for line in escapes("tanh", 100, 3))


def test_pi_is_enclosed():
    low, high = (Decimal(float(x[0, 0])) for x in e.PI.ends)
    assert low < PI < high
    assert math.nextafter(float(low), 4) == float(high)


def interval(low: float, high: float) -> Enclosed:
    return Enclosed((np.array([[low]]), np.array([[high]])), (e.ONE,))


def only(a: Enclosed) -> tuple[float, float]:
    return float(a.ends[0].item()), float(a.ends[1].item())


def test_what_may_be_undefined_is_marked():
    with np.errstate(all="ignore"):
        root, quotient, log = e.sqrt(interval(-1, 4)), e.reciprocal(interval(0, 2)), e.log(interval(0, 1))
        wild = e.reciprocal(interval(-1, 2))
        base = e.power(interval(-0.1, 0.5), e.point(1.5))
    assert all(part.undefined is not None and part.undefined.all() for part in (root, quotient, log, wild, base))
    assert (only(root)[0], round(only(root)[1], 9)) == (0, 2)
    assert only(quotient)[0] == pytest.approx(0.5)
    assert only(quotient)[1] == math.inf
    assert only(wild) == (-math.inf, math.inf)
    assert e.sqrt(interval(1, 4)).undefined is None
    assert e.power(interval(-0.1, 0.5), e.point(3.0)).undefined is None


def test_a_condition_of_what_may_be_undefined_is_open():
    """NaN compares false: nothing may be concluded from the part that is defined."""
    with np.errstate(all="ignore"):
        truth = e.less(e.point(-1.0), e.sqrt(interval(-1, 4)))
    assert truth.may_hold.all()
    assert truth.may_fail.all()
    chosen = e.select(truth, e.point(1.0), e.point(2.0))
    assert only(chosen) == (1, 2)
    assert chosen.jumps is not None
    assert chosen.jumps.all()
    sure = e.select(e.less(e.point(0.0), interval(1, 4)), e.point(1.0), e.point(2.0))
    assert (only(sure), sure.jumps) == ((1, 1), None)


def test_steps_jump():
    stepped = OPERATIONS["floor"](interval(0.5, 1.5))
    assert only(stepped) == (0, 1)
    assert stepped.jumps is not None
    assert OPERATIONS["floor"](interval(0.5, 0.75)).jumps is None
    halves = Enclosed((np.array([[-0.5, 0.49999999999999994]]), np.array([[2.5, 0.5]])))
    away = OPERATIONS["round"](halves, rounding_method=0)
    assert (away.ends[0].tolist(), away.ends[1].tolist()) == ([[-1, 0]], [[3, 1]])


def test_the_inverse_of_0_has_the_sign_of_0():
    with np.errstate(all="ignore"):
        below, above, minus_0 = (only(e.reciprocal(interval(*ends))) for ends in ((-2, 0), (0, 2), (-0.0, 2)))
    assert below == minus_0 == (-math.inf, math.inf)
    assert above == (pytest.approx(0.5), math.inf)
