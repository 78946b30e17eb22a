"""What a report is made of. Imports nothing that computes: a report that is kept is read again without it."""

from __future__ import annotations

import math
from dataclasses import dataclass


def degrees(cosine: float) -> float:
    """The angle of a cosine in degrees; NaN where that is no cosine."""
    return math.degrees(math.acos(cosine)) if abs(cosine) <= 1 else math.nan


@dataclass(frozen=True)
class Witness:
    """Where a defect shows: the parameters, a pair of directions, f(wi, wo) in 1/sr, and f(wo, wi) where that matters.

    `folded`: the value is that of a sum, of what goes to wo and what goes through the surface (see `brdfcheck.brdf.two_sides`).
    """

    parameters: tuple[float, ...]
    wi: tuple[float, ...]
    wo: tuple[float, ...]
    value: float
    swapped: float | None = None
    folded: bool = False


@dataclass(frozen=True)
class SideChecks:
    """Over the seeded pairs and the sampled parameters; the sign and finiteness also over all values that a scan saw.

    `reciprocity`: largest |f(wi,wo) - f(wo,wi)| relative to the larger value, of those that rounding cannot explain if there
    are such; `minimum`: smallest value in 1/sr (nan where no value is finite); `nonfinite`: how many values are NaN or Inf;
    `pairs`: how many values were looked at. The witnesses say where (None: nothing is wrong). `cosine`: all that is not
    reciprocal would be, divided by the cosine of this direction, "wi" or "wo" (empty: it would not).
    """

    reciprocity: float
    minimum: float
    nonfinite: int
    pairs: int
    reciprocal: bool
    positive: bool
    unequal: Witness | None = None
    lowest: Witness | None = None
    broken: Witness | None = None
    cosine: str = ""

    @property
    def passed(self) -> bool:
        """True where the BRDF is reciprocal, nowhere negative and everywhere finite."""
        return self.reciprocal and self.positive and self.nonfinite == 0


@dataclass(frozen=True)
class Check:
    """What a check says: `value` is what it measured, `words` are a finding where it did not pass."""

    name: str
    value: float
    passed: bool
    words: str


@dataclass(frozen=True)
class Doubt:
    """What is not known of the albedo of a table, because its values are known at samples only.

    `linear` and `nearest` are the albedos by the two look-ups at the worst place, by one rule; `quadrature` is what the bar of
    the report holds besides `TIMES` their difference. `reach`: what the albedo may be at any angle, with the bar there;
    `reach_cos_theta`: where. `layout`: what the samples are; `missing` of `samples` have no data, most of them `where`.
    `filled`: what the albedo may be where these have a value that errs on the high side, `guess` (None: all have data).
    `channel`: what the worst channel is called, nothing where that is known.
    """

    layout: str
    quadrature: float
    linear: float
    nearest: float
    reach: float
    reach_cos_theta: float
    samples: int
    missing: int
    where: str
    guess: str
    filled: float | None
    channel: str

    @property
    def most(self) -> float:
        """What the albedo may be at any angle, whatever the samples without data are."""
        return self.reach if self.filled is None else max(self.reach, self.filled)

    @property
    def findings(self) -> list[str]:
        """What is wrong with the data."""
        if not self.missing:
            return []
        share = 100 * self.missing / self.samples
        return [
            f"no data: {self.missing} of the {self.samples} samples that a light and a viewer above the surface can meet"
            f" ({share:.2g} %), {self.where}. They count as 0, so that the albedo is a lower bound; with {self.guess} in their"
            f" place it may reach {self.filled:.4g}"
        ]

    @property
    def notes(self) -> list[str]:
        """What the error bar holds, and what the worst channel is called."""
        from brdfcheck.quadrature.samples import TIMES

        angle = degrees(self.reach_cos_theta)
        channel = [f"the channel is {self.channel}"] if self.channel else []
        return [
            f"a table ({self.layout}): the albedo there is {self.linear:.6g} by linear and {self.nearest:.6g} by nearest"
            f" look-up; the error bar holds {TIMES} times their difference and {self.quadrature:.2g} of the quadrature. With"
            f" such bars it may reach {self.reach:.4g}, at {angle:.3g} deg",
            *channel,
        ]
