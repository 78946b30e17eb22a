"""The search: of all combinations of rungs, the cheapest one whose error is within the tolerance. No picture is made here.

Every combination has one fixed place in an order of cost and one fixed error, found when it is first asked for. The choice is
the first one in that order that is good enough. So it is monotone by construction: what is good enough for a tolerance is
good enough for a looser one, which therefore never costs more; and were the choice for a tighter tolerance to err more than
the one for a looser, the latter would be good enough for the tighter one too, and come first there.

The error of a combination is the largest of that of its own picture and those of its rungs, each alone in the full model:
errors that happen to cancel in this one picture are not counted on. It also saves pictures: a combination with a rung that
is too bad by itself needs none.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
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
    `allowed`: whether a combination may be chosen at all, called once for each that is good enough; by default any may.
    `errors`: those that are known.
    """

    own: Sequence[Sequence[Fault]]
    cost: Callable[[Combination], float]
    picture: Callable[[Combination], Fault]
    allowed: Callable[[Combination], bool] = field(default=lambda _: True)
    errors: dict[Combination, Fault] = field(default_factory=dict)
    _verdicts: dict[Combination, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
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

    def best(self, tolerance: Fault) -> Combination | None:
        """The first in the order of cost that is within the tolerance; None where none is."""
        for combination in self.order:
            if self.least(combination).within(tolerance) and self.error(combination).within(tolerance):
                if combination not in self._verdicts:
                    self._verdicts[combination] = self.allowed(combination)
                if self._verdicts[combination]:
                    return combination
        return None

    def frontier(self) -> list[Combination]:
        """Of the combinations with known errors that may be chosen: those with no other that costs and errs no more."""
        known = [
            one
            for one in self.order
            if one in self.errors and np.isfinite(self.errors[one].pixel) and self._verdicts.get(one, True)
        ]
        kept: list[Combination] = []
        for one in sorted(known, key=lambda one: (self._key(one)[0], self.errors[one].pixel)):
            if not kept or self.errors[one].pixel < self.errors[kept[-1]].pixel:
                kept.append(one)
        return kept
