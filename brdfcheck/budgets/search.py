"""The cheapest combination of rungs that is good enough.

Every combination has one fixed place in an order of cost and one fixed error, found when it is first asked for; the choice is
the first one in that order that is good enough. So it is monotone by construction: what is good enough for a tolerance is good
enough for a looser one, which therefore never costs more. The error of a combination is the largest of that of its own picture
and those of its rungs, each alone in the full model: errors that happen to cancel in this one picture are not counted on, and
a combination with a rung that is too bad by itself needs no picture.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

Combination = tuple[int, ...]


class Fault(NamedTuple):
    """The error of a pixel (units of full scale) and of the energy (relative); inf where a picture is refused."""

    pixel: float
    energy: float

    def within(self, tolerance: Fault) -> bool:
        """True where neither exceeds its tolerance."""
        return self.pixel <= tolerance.pixel and self.energy <= tolerance.energy

    def worse(self, other: Fault) -> Fault:
        """The larger of each."""
        return Fault(max(self.pixel, other.pixel), max(self.energy, other.energy))


REFUSED = Fault(np.inf, np.inf)


@dataclass
class Search:
    """Combinations of rungs, one of each ladder, in their order of cost.

    `own`: for each ladder the errors of its rungs alone. `cost`: of a combination, a fixed number; of equal costs the smaller
    sum of the rungs' errors comes first. `picture`: the error of a combination's picture, called once for each that is needed.
    `program`: the error of its own program's picture, `REFUSED` where it may not be chosen; called once for each whose picture
    is good enough. `errors`: those that are known.
    """

    own: Sequence[Sequence[Fault]]
    cost: Callable[[Combination], float]
    picture: Callable[[Combination], Fault]
    program: Callable[[Combination], Fault] = field(default=lambda _: Fault(0.0, 0.0))
    errors: dict[Combination, Fault] = field(default_factory=dict)
    _final: set[Combination] = field(default_factory=set)

    def __post_init__(self) -> None:
        # The full model is what all are compared with.
        self._final.add(tuple(len(ladder) - 1 for ladder in self.own))
        self.order = sorted(itertools.product(*(range(len(ladder)) for ladder in self.own)), key=self._key)

    def _key(self, combination: Combination) -> tuple[float, float, Combination]:
        # Sums that differ by rounding are equal.
        return float(f"{self.cost(combination):.9e}"), self.predicted(combination).pixel, combination

    def least(self, combination: Combination) -> Fault:
        """The worst of its rungs alone: its error is at least that."""
        worst = Fault(0.0, 0.0)
        for ladder, i in zip(self.own, combination, strict=True):
            worst = worst.worse(ladder[i])
        return worst

    def predicted(self, combination: Combination) -> Fault:
        """The sum of the errors of its rungs."""
        parts = [ladder[i] for ladder, i in zip(self.own, combination, strict=True)]
        return Fault(sum(part.pixel for part in parts), sum(part.energy for part in parts))

    def error(self, combination: Combination) -> Fault:
        """Its error; its picture is made if it was not."""
        if combination not in self.errors:
            self.errors[combination] = self.picture(combination).worse(self.least(combination))
        return self.errors[combination]

    def within(self, tolerance: Fault) -> Iterator[Combination]:
        """Those whose pictures are within the tolerance, in the order of cost."""
        return (one for one in self.order if self.least(one).within(tolerance) and self.error(one).within(tolerance))

    def best(self, tolerance: Fault) -> Combination | None:
        """The first in the order of cost that is within the tolerance, by its own program too; None where none is."""
        for combination in self.within(tolerance):
            if combination not in self._final:
                self._final.add(combination)
                self.errors[combination] = self.error(combination).worse(self.program(combination))
            if self.error(combination).within(tolerance):
                return combination
        return None

    def frontier(self) -> list[Combination]:
        """Of the combinations with known errors that may be chosen: those with no other that costs and errs no more."""
        known = [one for one in self.order if one in self.errors and np.isfinite(self.errors[one].pixel)]
        kept: list[Combination] = []
        for one in sorted(known, key=lambda one: (self._key(one)[0], self.errors[one].pixel)):
            if not kept or self.errors[one].pixel < self.errors[kept[-1]].pixel:
                kept.append(one)
        return kept
