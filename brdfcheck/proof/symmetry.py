r"""Does a program depend on the azimuth of the light, and on the side of the plane of incidence? An algebraic answer.

Every value is a polynomial, with exact coefficients, in the components of wi and wo and in numbers that are known not to
change when both directions are turned about the normal. A polynomial p does not change if $\sum x\, \partial_y p - y\,
\partial_x p = 0$ (the sum over both directions) holds identically, nor under reflection if odd powers of y cancel. What an
operation that is no polynomial makes of such values is a new number of that kind. Nothing is sampled, and the answer errs on
one side only: what is not shown is taken to depend.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from brdfcheck.proof.programs import Program, Step, rows_of, taken

_MOST_TERMS = 500
# Components of wi and wo by their place in a monomial's powers: x, y, z of each. What follows are unchanging numbers.
_PLANES = ((0, 1), (3, 4))
Poly = dict[tuple[tuple[int, int], ...], Fraction]


class _Depends(Exception):
    """Something that is no polynomial is made of what changes."""


def _variable(index: int) -> Poly:
    return {((index, 1),): Fraction(1)}


def _number(value: float) -> Poly:
    return {(): Fraction(float(value))} if value else {}


def _add(a: Poly, b: Poly) -> Poly:
    total = dict(a)
    for powers, value in b.items():
        total[powers] = total.get(powers, Fraction(0)) + value
    return {powers: value for powers, value in total.items() if value}


def _multiply(a: Poly, b: Poly) -> Poly:
    if len(a) * len(b) > _MOST_TERMS:
        raise _Depends
    total: Poly = {}
    for p, x in a.items():
        for q, y in b.items():
            powers = dict(p)
            for index, power in q:
                powers[index] = powers.get(index, 0) + power
            key = tuple(sorted(powers.items()))
            total[key] = total.get(key, Fraction(0)) + x * y
    return {powers: value for powers, value in total.items() if value}


def _turned(a: Poly) -> Poly:
    """How fast it changes when both directions are turned about the normal."""
    total: Poly = {}
    for powers, value in a.items():
        known = dict(powers)
        for x, y in _PLANES:
            for source, target, sign in ((y, x, 1), (x, y, -1)):
                power = known.get(source, 0)
                if power:
                    changed = {**known, source: power - 1, target: known.get(target, 0) + 1}
                    key = tuple(sorted((index, p) for index, p in changed.items() if p))
                    total[key] = total.get(key, Fraction(0)) + sign * power * value
    return {powers: value for powers, value in total.items() if value}


def _odd(a: Poly) -> bool:
    """True where it changes when both y components change their sign."""
    return any(sum(power for index, power in powers if index in (1, 4)) % 2 for powers in a)


class _Values:
    """The arithmetic of polynomials, for `Program.run`. `mirror`: reflections are asked about, too."""

    def __init__(self, mirror: bool):
        self.mirror, self._known = mirror, {}

    def made(self, *of: Any) -> Poly:
        """An unchanging number that this is made of; the same number for the same."""
        key = tuple(frozenset(part.items()) if isinstance(part, dict) else part for part in of)
        return _variable(6 + self._known.setdefault(key, len(self._known)))

    def unchanging(self, a: Poly) -> bool:
        return not _turned(a) and not (self.mirror and _odd(a))

    def constant(self, value: np.ndarray) -> list[Poly]:
        return [_number(x) if np.isfinite(x) else self.made(str(x)) for x in value]

    def apply(self, step: Step, arguments: list[list[Poly]]) -> list[Poly]:
        return [self._one(step, row) for row in rows_of(arguments)]

    def _product(self, a: Poly, b: Poly) -> Poly:
        """Their product; of too many terms it is a new number, if neither changes."""
        if len(a) * len(b) > _MOST_TERMS and self.unchanging(a) and self.unchanging(b):
            return self.made("mul", a, b)
        return _multiply(a, b)

    def _one(self, step: Step, row: tuple[Poly, ...]) -> Poly:
        if step.name in ("add", "add_any"):
            return _add(*row)
        if step.name == "sub":
            return _add(row[0], _multiply(_number(-1), row[1]))
        if step.name == "neg":
            return _multiply(_number(-1), row[0])
        if step.name == "mul":
            return self._product(*row)
        power = {"square": 2}.get(step.name, step.parameters.get("y") if step.name == "integer_pow" else None)
        if power is not None and 0 < power <= 8:
            result = row[0]
            for _ in range(power - 1):
                result = self._product(result, row[0])
            return result
        if step.name == "div" and self.unchanging(row[1]):
            return _multiply(row[0], self.made("1/", row[1]))
        if step.name == "select_n" and self.unchanging(row[0]):
            if all(map(self.unchanging, row)):
                return self.made(step.name, *row)
            share = self.made("share", row[0])  # 1 or 0
            return _add(_multiply(share, row[2]), _multiply(_add(_number(1), _multiply(_number(-1), share)), row[1]))
        if not all(map(self.unchanging, row)):
            raise _Depends
        return self.made(step.name, str(step.parameters), *row)


def _run(program: Program, values: _Values) -> list[Poly] | None:
    """The results of a program as polynomials; None where there are none."""
    directions = [[_variable(3 * i + j) for j in range(3)] for i in range(2)]
    parameters = [[values.made(name)] for name in program.names]
    run: Callable[..., Any] = program.run
    try:
        return run([*directions, *parameters], values.constant, taken, values.apply)
    except _Depends:
        return None


def _holds(program: Program, mirror: bool) -> bool:
    values = _Values(mirror)
    result = _run(program, values)
    return result is not None and all(map(values.unchanging, result))


class _Decimals(_Values):
    """Numbers are the decimals that they are written as."""

    def constant(self, value: np.ndarray) -> list[Poly]:
        return [{(): Fraction(str(float(x)))} if x else {} for x in value]


def polynomials(program: Program) -> list[dict[tuple[str, ...], Fraction]] | None:
    """The results of a program as polynomials in its parameters: coefficients by products of their names; None for others."""
    names = dict(enumerate(program.names, 6))
    found = _run(program, _Decimals(False))
    if found is None or any(index not in names for poly in found for powers in poly for index, _ in powers):
        return None
    return [
        {tuple(names[index] for index, power in powers for _ in range(power)): value for powers, value in poly.items()}
        for poly in found
    ]


def symmetry(program: Program) -> str:
    """ "mirror" where the program depends neither on the azimuth of the light nor on the side of the plane of incidence,
    "turn" where it does not depend on that azimuth, else "none": as far as it can be shown."""
    return "mirror" if _holds(program, True) else "turn" if _holds(program, False) else "none"
