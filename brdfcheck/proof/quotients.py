r"""Components of normalised vectors, which interval arithmetic does not know to be at most 1 where the length may be 0.

x/b is in [-1, 1] wherever it is defined if $b \ge \sqrt{x^2 + \dots}$ with nothing but squares and numbers that are not
negative under the root. The terms of a program are compared as terms: nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from brdfcheck.proof.programs import Program, Step, rows_of, taken

Term = tuple[Any, ...]


class _Terms:
    """Terms for `Program.run`; equal terms are the same number."""

    def __init__(self) -> None:
        self.terms: list[Term] = []
        self._known: dict[Term, int] = {}
        self.bounded: dict[int, np.ndarray] = {}

    def term(self, *of: Any) -> int:
        if of not in self._known:
            self._known[of] = len(self.terms)
            self.terms.append(of)
        return self._known[of]

    def constant(self, value: np.ndarray) -> list[int]:
        return [self.term("number", float(x)) for x in value]

    def apply(self, step: Step, arguments: list[list[int]]) -> list[int]:
        rows = rows_of(arguments)
        if step.name in ("div", "mul"):
            bounded = np.array([self._is_unit(step.name, *row) for row in rows])
            if bounded.any():
                self.bounded[step.out] = bounded
        return [self._made(step, row) for row in rows]

    def _made(self, step: Step, row: tuple[int, ...]) -> int:
        is_square = step.name == "square" or (step.name == "integer_pow" and step.parameters.get("y") == 2)
        if is_square or (step.name == "mul" and row[0] == row[1]):
            return self.term("square", row[0])
        return self.term(step.name, str(step.parameters) if step.name not in ("add", "mul", "max") else "", *row)

    def _is_unit(self, name: str, a: int, b: int) -> bool:
        try:
            return self._exceeds(b, a) if name == "div" else self._holds_length(a, b) or self._holds_length(b, a)
        except RecursionError:  # of a sum of a thousand terms nothing is known
            return False

    def _holds_length(self, part: int, x: int) -> bool:
        """Is `part` the inverse of something that is at least |x|?"""
        name, *of = self.terms[part]
        if name == "rsqrt":
            return self._holds_square(of[-1], x)
        return name == "div" and self.terms[of[-2]] == ("number", 1.0) and self._exceeds(of[-1], x)

    def _exceeds(self, bound: int, x: int) -> bool:
        """Is `bound` at least |x|, wherever both are defined?"""
        name, *parts = self.terms[bound]
        return self._holds_square(parts[-1], x) if name == "sqrt" else self._by_parts(self._exceeds, name, parts, x)

    def _holds_square(self, total: int, x: int) -> bool:
        """Is `total` at least x^2?"""
        name, *parts = self.terms[total]
        return parts[0] == x if name == "square" else self._by_parts(self._holds_square, name, parts, x)

    def _by_parts(self, holds: Callable[[int, int], bool], name: str, parts: Sequence[Any], x: int) -> bool:
        """Is a maximum, or a sum with what is not negative, large enough since a part of it is?"""
        if name == "max":
            return any(holds(part, x) for part in parts[1:])
        if name == "add":
            a, b = parts[1:]
            return (holds(a, x) and self._never_negative(b)) or (holds(b, x) and self._never_negative(a))
        return False

    def _never_negative(self, of: int) -> bool:
        name, *parts = self.terms[of]
        if name == "number":
            return parts[0] >= 0
        if name in ("square", "abs", "exp", "sqrt"):
            return True
        if name == "max":
            return any(map(self._never_negative, parts[1:]))
        return name == "add" and all(map(self._never_negative, parts[1:]))


def unit_quotients(program: Program) -> dict[int, np.ndarray]:
    """For steps of which some numbers are in [-1, 1] wherever they are defined: which of them."""
    terms = _Terms()
    inputs = [[terms.term("input", i, j) for j in range(3 if i < 2 else 1)] for i in range(2 + len(program.names))]
    program.run(inputs, terms.constant, taken, terms.apply)
    return terms.bounded
