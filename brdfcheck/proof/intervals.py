"""Interval arithmetic in integers: every result contains the true value.

An `Interval` has its ends in units of 2^-BITS, rounded outwards. What is exact stays a `Fraction`: the two mix, and an
expression is an interval only once something irrational has come into it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from fractions import Fraction

BITS = 256
_ONE = 1 << BITS


@dataclass(frozen=True, slots=True)
class Interval:
    """All numbers from `low` to `high`, both in units of 2^-BITS."""

    low: int
    high: int

    @staticmethod
    def of(value: Number | int) -> Interval:
        """The narrowest interval around an exact number; an interval as it is."""
        if isinstance(value, Interval):
            return value
        above, below = value.numerator << BITS, value.denominator
        return Interval(above // below, -(-above // below))

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __add__(self, other: Number | int) -> Interval:
        other = Interval.of(other)
        return Interval(self.low + other.low, self.high + other.high)

    __radd__ = __add__

    def __sub__(self, other: Number | int) -> Interval:
        return self + -other

    def __rsub__(self, other: Number | int) -> Interval:
        return -self + other

    def __mul__(self, other: Number | int) -> Interval:
        if isinstance(other, Interval):
            products = [a * b for a in (self.low, self.high) for b in (other.low, other.high)]
            return Interval(min(products) >> BITS, -(-max(products) >> BITS))
        above, below = other.numerator, other.denominator
        ends = (self.low * above, self.high * above) if above >= 0 else (self.high * above, self.low * above)
        return Interval(ends[0] // below, -(-ends[1] // below))

    __rmul__ = __mul__

    def __truediv__(self, other: Number | int) -> Interval:
        if not isinstance(other, Interval):
            return self * (1 / Fraction(other))
        if other.low <= 0 <= other.high:
            raise ZeroDivisionError("the divisor contains 0")
        pairs = [(a << BITS, b) for a in (self.low, self.high) for b in (other.low, other.high)]
        return Interval(min(a // b for a, b in pairs), max(-(-a // b) for a, b in pairs))

    def __rtruediv__(self, other: Number | int) -> Interval:
        return Interval.of(other) / self

    def __pow__(self, power: int) -> Interval:
        if power < 0:
            raise ValueError(f"the power must be >= 0; got {power}")
        if self.low >= 0:
            return Interval(_power(self.low, power, False), _power(self.high, power, True))
        if self.high <= 0:
            return (-self) ** power * (-1) ** power
        least = -_power(-self.low, power, True)
        most = _power(self.high, power, True)
        return Interval(least, most) if power % 2 else Interval(0 if power else _ONE, max(-least, most))

    def clipped(self) -> Interval:
        """max(0, .) of it."""
        return Interval(max(self.low, 0), max(self.high, 0))


Number = Fraction | Interval


def _power(base: int, power: int, up: bool) -> int:
    """base^power for base >= 0, rounded down or up."""
    result = _ONE
    while power:
        if power & 1:
            result = _shifted(result * base, up)
        power >>= 1
        if power:
            base = _shifted(base * base, up)
    return result


def _shifted(value: int, up: bool) -> int:
    return -(-value >> BITS) if up else value >> BITS


def lower(value: Number) -> Fraction:
    """The lower end, exactly."""
    return Fraction(value.low, _ONE) if isinstance(value, Interval) else value


def upper(value: Number) -> Fraction:
    """The upper end, exactly."""
    return Fraction(value.high, _ONE) if isinstance(value, Interval) else value


def sqrt(value: Number | int) -> Interval:
    """The square root. ValueError below 0."""
    value = Interval.of(value)
    if value.low < 0:
        raise ValueError("the square root of a number that may be negative")
    low, high = math.isqrt(value.low << BITS), math.isqrt(value.high << BITS)
    return Interval(low, high + (high * high < value.high << BITS))


def _inverse_tangent(whole: int) -> Interval:
    """atan(1/whole): an alternating series, which lies between any two of its neighbouring sums."""
    total, term, index = Interval.of(0), Interval.of(Fraction(1, whole)), 0
    while term.high > 1:
        total += term * Fraction((-1) ** index, 2 * index + 1)
        term, index = term * Fraction(1, whole * whole), index + 1
    return total + Interval(-term.high, term.high)


@functools.cache
def pi() -> Interval:
    """Pi, as 16 atan(1/5) - 4 atan(1/239) (Machin 1706)."""
    return 16 * _inverse_tangent(5) - 4 * _inverse_tangent(239)


def log(value: Number | int) -> Interval:
    """The natural logarithm, by 2 atanh((m - 1)/(m + 1)) for value = m 2^e with m in [1, 2). ValueError at or below 0."""
    value = Interval.of(value)
    if value.low <= 0:
        raise ValueError("the logarithm of a number that may be 0 or negative")
    return Interval(_log(value.low).low, _log(value.high).high)


def _log(point: int) -> Interval:
    exponent = point.bit_length() - 1 - BITS
    mantissa = Fraction(point, 1 << (point.bit_length() - 1))
    total = _twice_artanh(Interval.of((mantissa - 1) / (mantissa + 1)))
    return total + exponent * _log_of_2() if exponent else total


@functools.cache
def _log_of_2() -> Interval:
    return _twice_artanh(Interval.of(Fraction(1, 3)))


def _twice_artanh(ratio: Interval) -> Interval:
    """2 atanh for 0 <= ratio <= 1/3: the terms left out are together at most 9/8 of the first of them."""
    total, term, square, index = Interval.of(0), 2 * ratio, ratio * ratio, 1
    while term.high > 1:
        total += term * Fraction(1, index)
        term, index = term * square, index + 2
    return total + Interval(0, 2 * term.high)


def cos(value: Fraction) -> Interval:
    """The cosine of an exact number: a series that alternates, and its terms fall once they are past the number."""
    square, total, term, index = Interval.of(value * value), Interval.of(0), Interval.of(1), 0
    while term.high > 1 or index < abs(value):
        total += term * (-1) ** (index // 2)
        index += 2
        term = term * square * Fraction(1, index * (index - 1))
    return total + Interval(-term.high, term.high)


def exp2(value: Number | int) -> Interval:
    """2^value for value <= 0. ValueError above."""
    value = Interval.of(value)
    if value.high > 0:
        raise ValueError("2^x is for x <= 0")
    return Interval(_exp2(value.low).low, _exp2(value.high).high)


def _exp2(point: int) -> Interval:
    # 2^-(whole + part) with 0 <= part < 1; the series of exp(-part log 2) alternates and its terms fall.
    whole, part = divmod(-point, _ONE)
    exponent, total, term, index = Interval(part, part) * _log_of_2(), Interval.of(0), Interval.of(1), 0
    while term.high > 1:
        total += term * (-1) ** index
        index += 1
        term = term * exponent * Fraction(1, index)
    total += Interval(-term.high, term.high)
    return Interval(total.low >> whole, -(-total.high >> whole))
