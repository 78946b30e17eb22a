"""The arithmetic of proofs contains the true values, and no more than rounding asks for."""

from __future__ import annotations

import math
import random
from decimal import Decimal, localcontext
from fractions import Fraction

import pytest

from brdfcheck.proof.intervals import BITS, Interval, cos, exp2, log, lower, pi, sqrt, upper

ULP = Fraction(1, 1 << BITS)


def decimal(value: Fraction) -> Decimal:
    return Decimal(value.numerator) / value.denominator


def test_ten_thousand_operations_contain_the_value():
    """Exact values of the four operations and powers, 50 digits of roots, logarithms and powers of 2."""
    chance = random.Random(7)

    def number(low: float = -40.0, high: float = 40.0) -> Fraction:
        return Fraction(chance.uniform(low, high)) * Fraction(10) ** chance.randint(-12, 4)

    def around(point: Fraction, positive: bool = False) -> Interval:
        width = Fraction(chance.choice([0, 0, 1])) * abs(point) * Fraction(chance.random() * 0.4)
        found = Interval(Interval.of(point - width).low, Interval.of(point + width / 3).high)
        return Interval(max(found.low, 1), found.high) if positive else found

    for _ in range(10_000):
        a, b, power = number(), number(), chance.randint(0, 9)
        x, y = around(a), around(b)
        kind = chance.choice("+-*/^srle")
        if kind == "+":
            assert lower(x + y) <= a + b <= upper(x + y)
        elif kind == "-":
            assert lower(x - y) <= a - b <= upper(x - y)
        elif kind == "*":
            assert lower(x * y) <= a * b <= upper(x * y)
            assert lower(x * b) <= a * b <= upper(b * x)
        elif kind == "/" and not y.low <= 0 <= y.high:
            assert lower(x / y) <= a / b <= upper(x / y)
            assert lower(a / y) <= a / b <= upper(x / b)
        elif kind == "^":
            assert lower(x**power) <= a**power <= upper(x**power)
        elif kind in "srle":
            point = -abs(a) if kind == "e" else abs(a)
            box = -around(-point) if kind == "e" else around(point, positive=True)
            with localcontext() as context:
                context.prec = 60
                number_of = decimal(point)
                if kind == "s":
                    truth, enclosed = number_of.sqrt(), sqrt(box)
                elif kind == "r":
                    truth, enclosed = 1 / number_of.sqrt(), 1 / sqrt(box)
                elif kind == "l":
                    truth, enclosed = number_of.ln(), log(box)
                else:
                    truth, enclosed = (number_of * Decimal(2).ln()).exp(), exp2(Interval(box.low, min(box.high, 0)))
            slack = abs(Fraction(truth)) / 10**50
            assert lower(enclosed) - slack <= Fraction(truth) <= upper(enclosed) + slack, (kind, point)


def test_enclosures_of_points_are_tight():
    for value in (Fraction(1, 3), Fraction(7), Fraction(10**6, 7)):
        for enclosed in (sqrt(value), log(value), exp2(-value)):
            assert upper(enclosed) - lower(enclosed) < 2**14 * ULP
    for value in (Fraction(0), Fraction(1, 7), Fraction(22, 7), Fraction(-33, 5)):
        twice, rest = 2 * cos(value) ** 2 - 1, cos(2 * value)
        assert lower(twice - rest) <= 0 <= upper(twice - rest)
        assert upper(rest) - lower(rest) < 2**18 * ULP
        assert float(lower(rest)) == pytest.approx(math.cos(2 * value), abs=1e-15)
    assert upper(pi()) - lower(pi()) < 2**12 * ULP
    digits = Fraction("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")
    assert lower(pi()) < digits + Fraction(1, 10**70)
    assert upper(pi()) > digits - Fraction(1, 10**70)


def test_powers_of_intervals_around_zero():
    x = Interval.of(Fraction(-2)).low, Interval.of(Fraction(3)).high
    assert (lower(Interval(*x) ** 2), upper(Interval(*x) ** 2)) == (0, 9)
    assert (lower(Interval(*x) ** 3), upper(Interval(*x) ** 3)) == (-8, 27)
    assert lower(Interval(*x) ** 0) == upper(Interval(*x) ** 0) == 1
    assert (lower((-Interval.of(2)) ** 5), upper((-Interval.of(2)) ** 4)) == (-32, 16)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Interval.of(1) / Interval(-1, 1),
        lambda: sqrt(Fraction(-1)),
        lambda: log(0),
        lambda: exp2(1),
        lambda: Interval.of(2) ** -1,
    ],
)
def test_what_has_no_value_is_refused(wrong):
    with pytest.raises((ValueError, ZeroDivisionError)):
        wrong()
