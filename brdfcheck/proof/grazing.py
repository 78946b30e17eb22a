r"""Enclosures near grazing directions, where BRDFs divide by cosines that may be 0.

Interval arithmetic does not see that co/max(ci, co) is at most 1, nor that co/(ci + co) is, where both cosines may be 0. So
each value x comes with enclosures of $x\, c_i^a c_o^b$ for small whole a and b, each made where it is asked for: for ci itself
that is 1 for a = -1 and b = 0, for a sum the sum of both, for a quotient x/y that for x times the inverse of that for y with
-a and -b. Every way to an enclosure is valid, so that what several have in common is one, too. An albedo asks for a = 0, b = 1.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from brdfcheck.proof import enclosures as e
from brdfcheck.proof.enclosures import Enclosed, Pair, Truth
from brdfcheck.proof.operations import OPERATIONS, Value, apply, as_number, as_truth, taken
from brdfcheck.proof.programs import Program, Step

_HIGHEST = 2
Powers = tuple[int, int]
# How a power of a product may be shared out among its factors.
_SHARES = {0: ((0, 0), (1, -1), (-1, 1)), 1: ((1, 0), (0, 1)), -1: ((-1, 0), (0, -1)), 2: ((1, 1), (2, 0), (0, 2)),
           -2: ((-1, -1), (-2, 0), (0, -2))}  # fmt: skip
# What these do to values they do to their products with what is not negative.
_HOMOGENEOUS = frozenset(("add", "add_any", "sub", "neg", "abs", "max", "min", "clamp"))


class Graded:
    """A value; `rule` encloses its products with powers of the cosines better than factor by factor (None: there is none)."""

    def __init__(self, cosines: Callable[[Powers], Pair], value: Value, rule: Callable[[Powers], Pair] | None = None):
        self._cosines, self.value, self.rule = cosines, value, rule
        self._known: dict[Powers, Pair] = {}

    def times(self, powers: Powers) -> Pair:
        """The value times these powers of the cosines."""
        if powers not in self._known:
            ends = as_number(self.value).ends
            found = e.times(ends, self._cosines(powers)) if any(powers) else ends
            if self.rule is not None and max(map(abs, powers)) <= _HIGHEST:
                found = _common(found, self.rule(powers))
            self._known[powers] = found
        return self._known[powers]


def _common(a: Pair, b: Pair) -> Pair:
    return np.maximum(a[0], b[0]), np.minimum(a[1], b[1])


def _opposite(powers: Powers) -> Powers:
    return -powers[0], -powers[1]


def _inverse(times: Callable[[Powers], Pair]) -> Callable[[Powers], Pair]:
    return lambda powers: e.inverse(times(_opposite(powers)))[0]


def _root(x: Graded) -> Callable[[Powers], Pair]:
    def found(powers: Powers) -> Pair:
        return e.sqrt(Enclosed(x.times((2 * powers[0], 2 * powers[1])))).ends

    return found


def _product(first: Callable[[Powers], Pair], second: Callable[[Powers], Pair]) -> Callable[[Powers], Pair]:
    def found(powers: Powers) -> Pair:
        best: Pair | None = None
        for light, view in itertools.product(*(_SHARES[power] for power in powers)):
            pair = e.times(first((light[0], view[0])), second((light[1], view[1])))
            best = pair if best is None else _common(best, pair)
        assert best is not None
        return best

    return found


def _each(function: Callable[..., Enclosed], *parts: Graded) -> Callable[[Powers], Pair]:
    """What a function does to values it does to their products with what is not negative."""
    return lambda powers: function(*(Enclosed(part.times(powers)) for part in parts)).ends


def _nothing(x: Graded) -> np.ndarray:
    """Where a value is 0, exactly."""
    low, high = as_number(x.value).ends
    return (low == 0) & (high == 0)


def _rule(step: Step, parts: Sequence[Graded]) -> Callable[[Powers], Pair] | None:
    """How products with powers of the cosines are enclosed for the result of a step; None: no better than factor by factor."""
    if all(part.rule is None for part in parts):
        return None
    x, y = parts[0], parts[-1]
    name, power = step.name, step.parameters.get("y", 2)
    if name in _HOMOGENEOUS:
        return _each(OPERATIONS[name], *parts)
    if name == "select_n":
        condition = as_truth(parts[0].value)
        return _each(lambda no, yes: e.select(condition, yes, no), *parts[1:])
    if name == "sqrt":
        return _root(x)
    if name == "rsqrt":
        return _inverse(_root(x))
    if (
        name == "mul" and (zero := _nothing(x) | _nothing(y)).any()
    ):  # whatever it is multiplied by, as of N.L with N = (0, 0, 1)
        inner = _product(x.times, y.times)
        return lambda powers: tuple(np.where(zero, 0.0, end) for end in inner(powers))  # pyright: ignore[reportReturnType]
    if name in ("mul", "div"):
        second = _inverse(y.times) if name == "div" else y.times
        if y.rule is None:  # then all powers are better off with the first
            return lambda powers: e.times(x.times(powers), second((0, 0)))
        return _product(x.times, second) if x.rule is not None else lambda powers: e.times(x.times((0, 0)), second(powers))
    if name == "square" or (name == "integer_pow" and power == 2):
        return _product(x.times, x.times)
    return _inverse(x.times) if name == "integer_pow" and power == -1 else None


def enclose(
    program: Program,
    units: Mapping[int, np.ndarray],
    wi: Enclosed,
    wo: Enclosed,
    parameters: Sequence[Enclosed],
) -> Pair:
    """The enclosure of a program's result times the cosine of the view."""
    both = [Enclosed((part.ends[0][2:], part.ends[1][2:])) for part in (wi, wo)]

    @functools.cache
    def cosines(powers: Powers) -> Pair:
        """The product of these powers of the two cosines, which are not negative."""
        low, high = e.times(*(e.integer_power(one, power).ends for one, power in zip(both, powers, strict=True)))
        return np.maximum(low, 0), high

    def direction(part: Enclosed, own: Powers) -> Graded:
        def found(powers: Powers) -> Pair:
            last = cosines((powers[0] + own[0], powers[1] + own[1]))
            return e.pairs_at([e.times(part.ends, cosines(powers)), last], [3, 1], np.array([0, 1, 3]))

        return Graded(cosines, part, found)

    def constant(value: np.ndarray) -> Graded:
        return Graded(cosines, e.point(value))

    def take(parts: list[Graded], places: np.ndarray) -> Graded:
        value = taken([part.value for part in parts], places)
        if isinstance(value, Truth) or all(part.rule is None for part in parts):
            return Graded(cosines, value)
        counts = [len(as_number(part.value).ends[0]) for part in parts]
        return Graded(cosines, value, lambda powers: e.pairs_at([part.times(powers) for part in parts], counts, places))

    def one(step: Step, parts: list[Graded]) -> Graded:
        value = apply(step, [part.value for part in parts], units)
        return Graded(cosines, value, None if isinstance(value, Truth) else _rule(step, parts))

    with np.errstate(all="ignore"):
        inputs = [direction(wi, (1, 0)), direction(wo, (0, 1)), *(Graded(cosines, part) for part in parameters)]
        try:
            return program.run(inputs, constant, take, one).times((0, 1))
        except RecursionError:  # of a program of many steps nothing is known
            return np.array([[-np.inf]]), np.array([[np.inf]])
