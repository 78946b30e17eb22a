r"""Interval arithmetic in floating point, over many boxes at once: every result contains the true value, and its slopes.

An `Enclosed` holds the ends of intervals, and the ends of intervals for the derivatives by the variables of a box. IEEE 754
rounds each operation to nearest; each end is then moved outwards by four times that error. Functions of numpy's and scipy's
libraries (exp, log, power, sin, cos, tanh, arctan, arcsin, arccos, erf) are assumed to be right to 2^-48 of their value, which
is 16 to 32 times what their makers state. A function that is undefined on a part of a box is enclosed on the rest of it, and
the box is marked.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

Pair = tuple[np.ndarray, np.ndarray]
"""The lower and the upper ends of intervals."""
Mask = np.ndarray | None
"""True for some boxes; None: for none."""

_ROUNDING, _LIBRARY, _TINY = 2.0**-51, 2.0**-47, 1e-300
_PI = (np.array([[3.141592653589793]]), np.array([[3.1415926535897936]]))
_HALF_PI = float(np.pi / 2)


def out(low: np.ndarray, high: np.ndarray, relative: float = _ROUNDING) -> Pair:
    """The ends, moved outwards by the error of one operation; an end that is not a number becomes infinite."""
    # fmax and fmin return the other value in place of NaN.
    low = np.fmax(low - (np.abs(low) * relative + _TINY), -np.inf)
    return low, np.fmin(high + (np.abs(high) * relative + _TINY), np.inf)


def add(a: Pair, b: Pair) -> Pair:
    """a + b."""
    return out(a[0] + b[0], a[1] + b[1])


def negative(a: Pair) -> Pair:
    """-a."""
    return -a[1], -a[0]


def times(a: Pair, b: Pair) -> Pair:
    """The product; 0 times infinity is any number."""
    if b[0].size > a[0].size or a[0].min() >= 0:
        a, b = b, a
    if b[0].min() >= 0:
        if a[0].min() >= 0:
            return out(a[0] * b[0], a[1] * b[1])
        if b[0].size == 1 and b[0] == b[1]:
            return out(a[0] * b[0], a[1] * b[0])
        return out(np.minimum(a[0] * b[0], a[0] * b[1]), np.maximum(a[1] * b[0], a[1] * b[1]))
    p, q, r, s = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return out(np.minimum(np.minimum(p, q), np.minimum(r, s)), np.maximum(np.maximum(p, q), np.maximum(r, s)))


def square(a: Pair) -> Pair:
    """a^2, which is not negative."""
    least = np.maximum(np.maximum(a[0], -a[1]), 0)
    most = np.maximum(-a[0], a[1])
    low, high = out(least * least, most * most)
    return np.maximum(low, 0), high


def inverse(a: Pair) -> tuple[Pair, Mask]:
    """1/a, and where a may be 0: there it is infinite, of either sign if a may be negative or -0."""
    low, high = a
    zero = (low <= 0) & (high >= 0)
    ends = np.where(zero & np.signbit(low) | (high == 0), -np.inf, 1 / high), np.where(zero, np.inf, 1 / low)
    return out(*ends), _some(zero)


def hull(a: Pair, b: Pair) -> Pair:
    """The narrowest intervals around both."""
    return np.minimum(a[0], b[0]), np.maximum(a[1], b[1])


def _some(mask: np.ndarray) -> Mask:
    return mask if mask.any() else None


def either(*masks: Mask) -> Mask:
    """True where one of them is."""
    found: Mask = None
    for mask in masks:
        found = mask if found is None else found if mask is None else found | mask
    return found


@dataclass(frozen=True)
class Enclosed:
    """Intervals of shape (numbers, boxes), `boxes` perhaps 1, with the ends of their slopes by each variable (None: 0).

    `jumps`: where the function may not be continuous on a box, so that its slopes say nothing; `undefined`: where it may have
    no value on a part of a box.
    """

    ends: Pair
    slopes: tuple[Pair | None, ...] = ()
    jumps: Mask = None
    undefined: Mask = None

    def chained(self, ends: Pair, derivative: Callable[[], Pair], undefined: Mask = None) -> Enclosed:
        """A function of this: its enclosure, and what encloses its derivative, asked only where there are slopes."""
        slopes = self.slopes
        if any(slope is not None for slope in slopes):
            rate = derivative()
            slopes = tuple(None if slope is None else times(rate, slope) for slope in slopes)
        return Enclosed(ends, slopes, self.jumps, either(self.undefined, undefined))

    def joined(self, other: Enclosed, ends: Pair, slope: Callable[[Pair | None, Pair | None], Pair | None]) -> Enclosed:
        """What two make together; `slope` from their two slopes."""
        width = max(len(self.slopes), len(other.slopes))
        mine, others = (part.slopes + (None,) * (width - len(part.slopes)) for part in (self, other))
        slopes = tuple(None if a is None and b is None else slope(a, b) for a, b in zip(mine, others, strict=True))
        return Enclosed(ends, slopes, either(self.jumps, other.jumps), either(self.undefined, other.undefined))


def _sum(a: Pair | None, b: Pair | None) -> Pair | None:
    return b if a is None else a if b is None else add(a, b)


def _product(a: Pair | None, b: Pair) -> Pair | None:
    return None if a is None else times(a, b)


ZERO: Pair = (np.zeros((1, 1)), np.zeros((1, 1)))
ONE: Pair = (np.ones((1, 1)), np.ones((1, 1)))


def _exact(value: float) -> Pair:
    number = np.full((1, 1), float(value))
    return number, number


def point(value: np.ndarray | float) -> Enclosed:
    """Exact numbers (numbers,) as intervals without width; NaN is any number, or none."""
    ends = np.atleast_1d(np.asarray(value, float)).reshape(-1, 1)
    missing = np.isnan(ends)
    if missing.any():
        return Enclosed((np.where(missing, -np.inf, ends), np.where(missing, np.inf, ends)), (), None, missing)
    return Enclosed((ends, ends))


PI = Enclosed(_PI)


def plus(a: Enclosed, b: Enclosed) -> Enclosed:
    """a + b."""
    return a.joined(b, add(a.ends, b.ends), _sum)


def minus(a: Enclosed) -> Enclosed:
    """-a."""
    return Enclosed(negative(a.ends), tuple(None if s is None else negative(s) for s in a.slopes), a.jumps, a.undefined)


def multiply(a: Enclosed, b: Enclosed) -> Enclosed:
    """a b; of two times the same, its square."""
    if a is b:
        return a.chained(square(a.ends), lambda: add(a.ends, a.ends))
    return a.joined(b, times(a.ends, b.ends), lambda s, t: _sum(_product(s, b.ends), _product(t, a.ends)))


def reciprocal(a: Enclosed) -> Enclosed:
    """1/a, undefined where a may be 0."""
    ends, zero = inverse(a.ends)
    return a.chained(ends, lambda: negative(square(ends)), zero)


def integer_power(a: Enclosed, power: int) -> Enclosed:
    """a^power for a whole number."""
    if power < 0:
        return reciprocal(integer_power(a, -power))
    if power == 0:
        return point(np.ones(len(a.ends[0])))
    return a.chained(_power(a.ends, power), lambda: times(_exact(power), _power(a.ends, power - 1)))


def _power(a: Pair, power: int) -> Pair:
    """a^power for a whole number >= 0: from powers of the sizes, which are multiplied out."""
    if power == 0:
        return ONE
    if power % 2 and power > 1:
        # Odd powers rise: at each end the power of its size, with its sign.
        low, high = (np.copysign(1.0, end) for end in a)
        least, most = (_sizes((np.abs(end), np.abs(end)), power) for end in a)
        return np.where(low > 0, least[0], -least[1]), np.where(high > 0, most[1], -most[0])
    if power == 1:
        return a
    return _sizes((np.maximum(np.maximum(a[0], -a[1]), 0), np.maximum(-a[0], a[1])), power)


def _sizes(a: Pair, power: int) -> Pair:
    result = None
    while power:
        if power & 1:
            result = a if result is None else times(result, a)
        power >>= 1
        if power:
            a = square(a)
    assert result is not None
    return np.maximum(result[0], 0), result[1]


def _library(function: Callable[[np.ndarray], np.ndarray], a: Pair) -> Pair:
    """A function that rises, at both ends."""
    return out(function(a[0]), function(a[1]), _LIBRARY)


def _clipped(a: Pair, low: float, high: float) -> tuple[Pair, Mask]:
    """The part of intervals in a function's domain, and where there is another part."""
    mask = _some((a[0] < low) | (a[1] > high))
    return (a if mask is None else (np.clip(a[0], low, high), np.clip(a[1], low, high))), mask


def exp(a: Enclosed) -> Enclosed:
    """e^a."""
    low, high = _library(np.exp, a.ends)
    ends = np.maximum(low, 0), high
    return a.chained(ends, lambda: ends)


def log(a: Enclosed) -> Enclosed:
    """The natural logarithm, undefined at and below 0."""
    inside, outside = _clipped(a.ends, 0, np.inf)
    slope, zero = inverse(inside)
    return a.chained(_library(np.log, inside), lambda: slope, either(outside, zero))


def sqrt(a: Enclosed) -> Enclosed:
    """The square root, undefined below 0."""
    inside, outside = _clipped(a.ends, 0, np.inf)
    low, high = out(np.sqrt(inside[0]), np.sqrt(inside[1]))
    ends = np.maximum(low, 0), high
    return a.chained(ends, lambda: times(_exact(0.5), inverse(ends)[0]), outside)


def _turning(a: Pair, quarter: float) -> Pair:
    """cos(a - quarter): by its ends, and by the multiples of pi that a may contain."""
    function = np.cos if quarter == 0 else np.sin
    one, two = function(a[0]), function(a[1])
    low, high = out(np.minimum(one, two), np.maximum(one, two), _LIBRARY)
    # Near a turning point, or with many turns, the end is taken as 1: a little wider, never narrower.
    first, last = (a[0] - quarter) / np.pi, (a[1] - quarter) / np.pi
    slack = 1e-9 * (1 + np.maximum(np.abs(first), np.abs(last)))
    with np.errstate(invalid="ignore"):
        even = np.floor((last + slack) / 2) >= np.ceil((first - slack) / 2)
        odd = np.floor((last + slack - 1) / 2) >= np.ceil((first - slack - 1) / 2)
    wide = ~(slack < 1e-3)
    high = np.where(even | wide, 1.0, np.minimum(high, 1.0))
    return np.where(odd | wide, -1.0, np.maximum(low, -1.0)), high


def sin(a: Enclosed) -> Enclosed:
    """The sine."""
    return a.chained(_turning(a.ends, _HALF_PI), lambda: _turning(a.ends, 0.0))


def cos(a: Enclosed) -> Enclosed:
    """The cosine."""
    return a.chained(_turning(a.ends, 0.0), lambda: negative(_turning(a.ends, _HALF_PI)))


def tanh(a: Enclosed) -> Enclosed:
    """The hyperbolic tangent."""
    low, high = _library(np.tanh, a.ends)
    ends = np.maximum(low, -1), np.minimum(high, 1)
    return a.chained(ends, lambda: add(ONE, negative(square(ends))))


def arctan(a: Enclosed) -> Enclosed:
    """The inverse tangent."""
    return a.chained(_library(np.arctan, a.ends), lambda: inverse(add(ONE, square(a.ends)))[0])


def arcsin(a: Enclosed) -> Enclosed:
    """The inverse sine, undefined beyond -1 and 1."""
    inside, outside = _clipped(a.ends, -1, 1)
    rest = add(ONE, negative(square(inside)))
    return a.chained(_library(np.arcsin, inside), lambda: inverse(sqrt(Enclosed(rest)).ends)[0], outside)


def arccos(a: Enclosed) -> Enclosed:
    """The inverse cosine, undefined beyond -1 and 1."""
    return plus(multiply(PI, point(0.5)), minus(arcsin(a)))


def erf(a: Enclosed) -> Enclosed:
    """The error function."""
    from scipy.special import erf  # a tenth of a second, which is for those who need it

    def bell() -> Pair:
        scale = times(_exact(2), inverse(sqrt(PI).ends)[0])
        return times(scale, exp(Enclosed(negative(square(a.ends)))).ends)

    return a.chained(_library(erf, a.ends), bell)


def absolute(a: Enclosed) -> Enclosed:
    """|a|."""
    low, high = a.ends
    least, most = np.maximum(np.maximum(low, -high), 0), np.maximum(-low, high)
    return a.chained((least, most), lambda: (np.where(low >= 0, 1.0, -1.0), np.where(high <= 0, -1.0, 1.0)))


def maximum(a: Enclosed, b: Enclosed) -> Enclosed:
    """The larger; where either may be the larger, its slope is one of both or lies between."""
    ends = np.maximum(a.ends[0], b.ends[0]), np.maximum(a.ends[1], b.ends[1])
    first, second = a.ends[0] >= b.ends[1], b.ends[0] >= a.ends[1]

    def slope(s: Pair | None, t: Pair | None) -> Pair:
        s, t = s or ZERO, t or ZERO
        low, high = hull(s, t)
        return (np.where(first, s[0], np.where(second, t[0], low)), np.where(first, s[1], np.where(second, t[1], high)))

    return a.joined(b, ends, slope)


def minimum(a: Enclosed, b: Enclosed) -> Enclosed:
    """The smaller; see `maximum`."""
    return minus(maximum(minus(a), minus(b)))


def steps(function: Callable[[np.ndarray], np.ndarray], a: Enclosed) -> Enclosed:
    """A function that is constant but for steps upwards: floor, ceil, sign, rounding to whole numbers."""
    low, high = function(a.ends[0]), function(a.ends[1])
    return Enclosed((low, high), (), either(a.jumps, _some(low != high)), a.undefined)


def power(a: Enclosed, b: Enclosed) -> Enclosed:
    """a^b for a >= 0; of a base that may be negative it is undefined, but for whole numbers as exponents."""
    if b.ends[0] is b.ends[1] and b.ends[0].size == 1 and float(b.ends[0].item()).is_integer() and abs(b.ends[0].item()) < 4096:
        return integer_power(a, int(b.ends[0].item()))
    inside, outside = _clipped(a.ends, 0, np.inf)

    def corners(exponent: Pair, bases: Pair = inside) -> Pair:
        powers = exponent[:1] if exponent[0] is exponent[1] else exponent
        values = [np.power(base, end) for base in bases for end in powers]
        low, high = values[0], values[0]
        for value in values[1:]:
            low, high = np.minimum(low, value), np.maximum(high, value)
        low, high = out(low, high, _LIBRARY)
        return np.maximum(low, 0), high

    ends = corners(b.ends)
    if outside is not None:
        # Exponents that are whole numbers are single points, but a parameter may be there: the power or its opposite.
        most = corners(b.ends, absolute(a).ends)[1]
        some = outside & (np.floor(b.ends[1]) >= np.ceil(b.ends[0]))
        ends = np.where(some, np.minimum(ends[0], -most), ends[0]), np.where(some, np.maximum(ends[1], most), ends[1])

    def by_base() -> Pair:
        # Between 1/2 and 2 the difference has no error.
        low, high = (end - 1 for end in b.ends)
        wider = out(low, high)
        low, high = (np.where((end >= 0.5) & (end <= 2), x, w) for end, x, w in zip(b.ends, (low, high), wider, strict=True))
        return times(b.ends, corners((low, high)))

    def by_exponent() -> Pair:
        low, high = times(ends, _library(np.log, inside))
        # For exponents >= least > 0: x^b log x >= -1/(e b), and > 0 only for x > 1.
        least = np.maximum(b.ends[0], 0)
        low = np.maximum(low, -0.3678794411714424 * (1 + 1e-12) / np.maximum(least, _TINY))
        return low, np.where((inside[1] <= 1) & (least > 0), 0.0, high)

    zero = _some((inside[0] <= 0) & (b.ends[0] < 0))
    first, second = (replace(x, jumps=None, undefined=None) for x in (a.chained(ends, by_base), b.chained(ends, by_exponent)))
    found = first.joined(second, ends, _sum)
    return replace(found, jumps=either(a.jumps, b.jumps), undefined=either(a.undefined, b.undefined, outside, zero))


@dataclass(frozen=True)
class Truth:
    """What a condition may be on each box: shape (numbers, boxes) each."""

    may_hold: np.ndarray
    may_fail: np.ndarray


def less(a: Enclosed, b: Enclosed, *, equal: bool = False) -> Truth:
    """a < b, or a <= b if `equal`. Where one of them may be undefined, either answer is possible."""
    unknown = either(a.undefined, b.undefined)
    compare = np.less_equal if equal else np.less
    hold, fail = compare(a.ends[0], b.ends[1]), ~compare(a.ends[1], b.ends[0])
    return Truth(hold, fail) if unknown is None else Truth(hold | unknown, fail | unknown)


def select(condition: Truth, yes: Enclosed, no: Enclosed) -> Enclosed:
    """`yes` where the condition holds, `no` where it fails; both, and perhaps a jump, where it may do either."""
    hold, fail = condition.may_hold, condition.may_fail
    both = _some(hold & fail)

    def chosen(a: Pair, b: Pair) -> Pair:
        low, high = hull(a, b)
        return np.where(~fail, a[0], np.where(~hold, b[0], low)), np.where(~fail, a[1], np.where(~hold, b[1], high))

    def mask(a: Mask, b: Mask) -> Mask:
        return either(None if a is None else _some(a & hold), None if b is None else _some(b & fail))

    found = yes.joined(no, chosen(yes.ends, no.ends), lambda s, t: chosen(s or ZERO, t or ZERO))
    jumps = either(mask(yes.jumps, no.jumps), both)
    return Enclosed(found.ends, found.slopes, jumps, mask(yes.undefined, no.undefined))


def rows_at(arrays: Sequence[np.ndarray], counts: Sequence[int], places: np.ndarray) -> np.ndarray:
    """Rows of several arrays, one after the other: those at `places`. `counts`: their rows, of which one may stand for all."""
    width = max(array.shape[1] for array in arrays)
    rows = [np.broadcast_to(array, (count, width)) for array, count in zip(arrays, counts, strict=True)]
    return (rows[0] if len(rows) == 1 else np.concatenate(rows))[places]


def pairs_at(pairs: Sequence[Pair | None], counts: Sequence[int], places: np.ndarray) -> Pair:
    """`rows_at` of intervals (None: 0); what has no width has none afterwards."""
    given = [ZERO if pair is None else pair for pair in pairs]
    low = rows_at([pair[0] for pair in given], counts, places)
    return low, low if all(a is b for a, b in given) else rows_at([pair[1] for pair in given], counts, places)


def take(parts: list[Enclosed], places: np.ndarray) -> Enclosed:
    """Numbers of several enclosures, one after the other: those at `places`, as one."""
    counts = [len(part.ends[0]) for part in parts]

    def slope(pairs: Sequence[Pair | None]) -> Pair | None:
        return None if all(pair is None for pair in pairs) else pairs_at(pairs, counts, places)

    def mask(masks: Sequence[Mask]) -> Mask:
        if all(one is None for one in masks):
            return None
        return _some(rows_at([np.zeros((1, 1), bool) if one is None else one for one in masks], counts, places))

    slopes = tuple(map(slope, itertools.zip_longest(*(part.slopes for part in parts))))
    jumps, undefined = mask([part.jumps for part in parts]), mask([part.undefined for part in parts])
    return Enclosed(pairs_at([part.ends for part in parts], counts, places), slopes, jumps, undefined)
