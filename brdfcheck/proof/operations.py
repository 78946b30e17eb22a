"""The operations of a program on enclosures: one row for each primitive of JAX that is covered."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from brdfcheck.proof import enclosures as e
from brdfcheck.proof.enclosures import Enclosed, Truth
from brdfcheck.proof.programs import Program, Step

Value = Enclosed | Truth


def as_truth(value: Value) -> Truth:
    """A condition; a number that stands for one is 0 or 1, or lies between them where it may be either."""
    if isinstance(value, Truth):
        return value
    low, high = value.ends
    return Truth((low != 0) | (high != 0), (low <= 0) & (high >= 0))


def _and(a: Value, b: Value) -> Truth:
    a, b = as_truth(a), as_truth(b)
    return Truth(a.may_hold & b.may_hold, a.may_fail | b.may_fail)


def _not(a: Value) -> Truth:
    a = as_truth(a)
    return Truth(a.may_fail, a.may_hold)


def _equal(a: Value, b: Value) -> Truth:
    if isinstance(a, Truth) and isinstance(b, Truth):
        both = (a.may_hold & b.may_hold) | (a.may_fail & b.may_fail)
        return Truth(both, (a.may_hold & b.may_fail) | (a.may_fail & b.may_hold))
    a, b = as_number(a), as_number(b)  # a condition that is used as a number is 1 or 0, whatever it meets
    if a is b and a.undefined is None:  # x == x asks for NaN
        return Truth(np.full(a.ends[0].shape, True), np.full(a.ends[0].shape, False))
    return _and(e.less(a, b, equal=True), e.less(b, a, equal=True))


def as_number(value: Value) -> Enclosed:
    """A condition as a number: 1 or 0."""
    return e.select(value, e.point(1.0), e.point(0.0)) if isinstance(value, Truth) else value


def _finite(a: Enclosed) -> Truth:
    sure = np.isfinite(a.ends[0]) & np.isfinite(a.ends[1])
    if a.undefined is not None:
        sure = sure & ~a.undefined
    return Truth(np.full(sure.shape, True), ~sure)


def _clamp(low: Enclosed, x: Enclosed, high: Enclosed) -> Enclosed:
    return e.minimum(e.maximum(x, low), high)


def _away(x: np.ndarray) -> np.ndarray:
    """The nearest whole numbers, halves away from 0."""
    whole = np.trunc(x)
    return whole + np.where(np.abs(x - whole) >= 0.5, np.sign(x), 0)


def _rounded(a: Enclosed, rounding_method: Any) -> Enclosed:
    return e.steps(np.rint if int(rounding_method) == 1 else _away, a)


def _remainder(a: Enclosed, b: Enclosed) -> Enclosed:
    """What is left of a after as many b as go into it, with the sign of a."""
    return e.plus(a, e.minus(e.multiply(b, e.steps(np.trunc, e.multiply(a, e.reciprocal(b))))))


def _angle(y: Enclosed, x: Enclosed) -> Enclosed:
    """The angle of (x, y), from the tangent of its half, which the negative x axis does not have."""
    length = e.sqrt(e.plus(e.multiply(x, x), e.multiply(y, y)))
    half = e.arctan(e.multiply(y, e.reciprocal(e.plus(length, x))))
    return e.plus(half, half)


def _cube_root(a: Enclosed) -> Enclosed:
    third = Enclosed((np.array([[np.nextafter(1 / 3, 0)]]), np.array([[np.nextafter(1 / 3, 1)]])))
    return e.multiply(e.steps(np.sign, a), e.power(e.absolute(a), third))


_LOG2 = np.log(2.0)


def _scaled(a: Enclosed, low: float, high: float) -> Enclosed:
    return e.multiply(a, Enclosed((np.array([[low]]), np.array([[high]]))))


_ONE, _HALF = e.point(1.0), e.point(0.5)
OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": e.plus,
    "add_any": e.plus,
    "sub": lambda a, b: e.plus(a, e.minus(b)),
    "mul": e.multiply,
    "div": lambda a, b: e.multiply(a, e.reciprocal(b)),
    "rem": _remainder,
    "neg": e.minus,
    "max": e.maximum,
    "min": e.minimum,
    "abs": e.absolute,
    "exp": e.exp,
    "exp2": lambda a: e.exp(_scaled(a, np.nextafter(_LOG2, 0), np.nextafter(_LOG2, 1))),
    "expm1": lambda a: e.plus(e.exp(a), e.point(-1.0)),
    "log": e.log,
    "log1p": lambda a: e.log(e.plus(a, _ONE)),
    "sqrt": e.sqrt,
    "cbrt": _cube_root,
    "rsqrt": lambda a: e.reciprocal(e.sqrt(a)),
    "sin": e.sin,
    "cos": e.cos,
    "tan": lambda a: e.multiply(e.sin(a), e.reciprocal(e.cos(a))),
    "asin": e.arcsin,
    "acos": e.arccos,
    "atan": e.arctan,
    "atan2": _angle,
    "sinh": lambda a: e.multiply(e.plus(e.exp(a), e.minus(e.exp(e.minus(a)))), _HALF),
    "cosh": lambda a: e.multiply(e.plus(e.exp(a), e.exp(e.minus(a))), _HALF),
    "tanh": e.tanh,
    "asinh": lambda a: e.log(e.plus(a, e.sqrt(e.plus(e.multiply(a, a), _ONE)))),
    "acosh": lambda a: e.log(e.plus(a, e.sqrt(e.plus(e.multiply(a, a), e.minus(_ONE))))),
    "atanh": lambda a: e.multiply(_HALF, e.log(e.multiply(e.plus(_ONE, a), e.reciprocal(e.plus(_ONE, e.minus(a)))))),
    "logistic": lambda a: e.reciprocal(e.plus(_ONE, e.exp(e.minus(a)))),
    "erf": e.erf,
    "erfc": lambda a: e.plus(_ONE, e.minus(e.erf(a))),
    "square": lambda a: e.multiply(a, a),
    "integer_pow": lambda a, y: e.integer_power(a, y),
    "pow": e.power,
    "clamp": _clamp,
    "sign": lambda a: e.steps(np.sign, a),
    "floor": lambda a: e.steps(np.floor, a),
    "ceil": lambda a: e.steps(np.ceil, a),
    "round": _rounded,
    "lt": e.less,
    "le": lambda a, b: e.less(a, b, equal=True),
    "gt": lambda a, b: e.less(b, a),
    "ge": lambda a, b: e.less(b, a, equal=True),
    "eq": _equal,
    "ne": lambda a, b: _not(_equal(a, b)),
    "and": _and,
    "or": lambda a, b: _not(_and(_not(a), _not(b))),
    "not": _not,
    "xor": lambda a, b: _not(_equal(as_truth(a), as_truth(b))),
    "is_finite": _finite,
    "select_n": lambda condition, no, yes: (
        _not(_and(_not(_and(condition, yes)), _not(_and(_not(condition), no))))
        if isinstance(yes, Truth) and isinstance(no, Truth)
        else e.select(as_truth(condition), as_number(yes), as_number(no))
    ),
    "convert_element_type": lambda a: as_number(a),
}
COVERED = frozenset(OPERATIONS)
_KEPT = frozenset(("y", "rounding_method"))
# What takes conditions as they are; to anything else they are 1 or 0.
_OF_CONDITIONS = frozenset(("eq", "ne", "and", "or", "not", "xor", "select_n"))


def apply(step: Step, arguments: list[Value], units: Mapping[int, np.ndarray]) -> Value:
    """What a step makes of its arguments. `units`: for steps by their results, which numbers are known to lie in [-1, 1]
    (`quotients`)."""
    if step.name not in _OF_CONDITIONS:
        arguments = [as_number(value) for value in arguments]
    found = OPERATIONS[step.name](*arguments, **{key: value for key, value in step.parameters.items() if key in _KEPT})
    known = units.get(step.out)
    if known is None or not isinstance(found, Enclosed):
        return found
    low, high = found.ends
    mask = known[:, None]
    return replace(found, ends=(np.where(mask, np.clip(low, -1, 1), low), np.where(mask, np.clip(high, -1, 1), high)))


def taken(parts: list[Value], places: np.ndarray) -> Value:
    """Numbers, or conditions, of several values: those at `places`, as one."""
    truths = [part for part in parts if isinstance(part, Truth)]
    if len(truths) == len(parts):
        counts = [len(part.may_hold) for part in truths]
        return Truth(*e.pairs_at([(part.may_hold, part.may_fail) for part in truths], counts, places))
    return e.take([as_number(part) for part in parts], places)


def evaluate(
    program: Program, units: Mapping[int, np.ndarray], wi: Enclosed, wo: Enclosed, parameters: Sequence[Enclosed]
) -> Enclosed:
    """The enclosure of a program's result on boxes of directions and parameters; `units` as for `apply`."""
    with np.errstate(all="ignore"):
        return as_number(
            program.run([wi, wo, *parameters], e.point, taken, lambda step, arguments: apply(step, arguments, units))
        )
