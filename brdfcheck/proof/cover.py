r"""Proofs that the albedo of a lobe with a linear factor stays at or below 1, or above it, over ranges of n.

At normal incidence the albedo is (slope n + offset) e(n), where e falls with n and is convex (`lobes`). On a box [a, b]:

* e lies below its chord, so the albedo lies below a quadratic, whose Bernstein coefficients are the products at the two ends
  and the mean of the two mixed products. If none of these exceeds 1, neither does the albedo.
* e lies above each chord prolonged: from the middle to b above the one of [a, middle], from a to the middle above the one of
  [middle, b]. The albedo lies above two products of positive lines. Such a product is monotone or concave, so that it is least
  at an end. If these products exceed 1 at a, b and the middle, so does the albedo between.

Both lose h^2, so that a few boxes do. Past some n one test may do for all that follow (`Profile.stays_below`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from brdfcheck.proof.intervals import Number, lower, pi, upper
from brdfcheck.proof.lobes import Power, Profile

BELOW, ABOVE = "at most 1", "above 1"
# A crossing of 1 is enclosed between neighbours on this grid.
_GRID = 10**10
# A box this small in relation to n, or this many boxes, and there is no proof.
_SMALLEST = Fraction(1, 2**44)
MOST_BOXES = 3000
# An unbounded range must be done by then.
_FARTHEST = 10**9


class NotProved(ValueError):
    """Neither a proof nor a counterexample was found. One line that says where and why."""


@dataclass(frozen=True)
class LinearFactor:
    """(n + A)/(B pi^power), or A where it is `constant`: what a lobe is multiplied by, in 1/sr. `power` is 0 or 1."""

    A: Fraction
    B: Fraction = Fraction(1)
    power: int = 0
    constant: bool = False

    def __post_init__(self) -> None:
        if type(self.power) is not int or self.power not in (0, 1) or type(self.constant) is not bool or self.B <= 0:
            raise ValueError(f"a factor is (n + A)/B or (n + A)/(B pi) with B > 0, or a constant; got {self}")

    @property
    def record(self) -> dict[str, str | int]:
        """The factor in a certificate."""
        if self.constant:
            return {"constant": written(self.A)}
        return {"A": written(self.A), "B": written(self.B), "pi": self.power}

    @staticmethod
    def of(record: Mapping[str, Any]) -> LinearFactor:
        """The factor of a certificate."""
        if "constant" in record:
            return LinearFactor(Fraction(record["constant"]), constant=True)
        return LinearFactor(Fraction(record["A"]), Fraction(record["B"]), record["pi"])

    @property
    def formula(self) -> str:
        """The factor in words."""
        if self.constant:
            return written(self.A)
        return f"(n + {written(self.A)})/{f'({written(self.B)} pi)' if self.power else written(self.B)}"


@dataclass(frozen=True)
class Piece:
    """A range of n with its boxes: the albedo is `side` on all of [nodes[0], nodes[-1]], and if `onwards` for all larger n."""

    side: str
    nodes: tuple[Fraction, ...]
    onwards: bool = False


@dataclass(frozen=True)
class Claim:
    """A lobe with a factor, as a function of n at normal incidence."""

    profile: Profile
    factor: LinearFactor

    @functools.cached_property
    def line(self) -> tuple[Number, Number]:
        """Slope and offset of pi times the factor; exact where pi cancels."""
        scale: Number = 1 / self.factor.B
        scale = scale if self.factor.power else pi() * scale
        return Fraction(0) if self.factor.constant else scale, scale * self.factor.A

    @functools.cached_property
    def _raw(self) -> Callable[[Fraction], Number]:
        return functools.cache(self.profile.albedo)

    def gain(self, n: Fraction) -> Number:
        """pi times the factor."""
        slope, offset = self.line
        return slope * n + offset

    def albedo(self, n: Fraction) -> Number:
        """The directional albedo at normal incidence."""
        return self.gain(n) * self._raw(n)

    def side(self, n: Fraction) -> str | None:
        """On which side of 1 the albedo is; None where the enclosure contains 1."""
        value = self.albedo(n)
        return BELOW if upper(value) <= 1 else ABOVE if lower(value) > 1 else None

    def below(self, a: Fraction, b: Fraction) -> bool:
        """True where the albedo is shown to be at most 1 on [a, b]; where the factor is negative, so is the albedo."""
        if self.side(a) != BELOW or self.side(b) != BELOW:
            return False
        if isinstance(self.profile, Power) and self.profile.form == "mirror":
            return True  # (n + A)/(n + 2) is monotone
        return upper(self.gain(a) * self._raw(b) + self.gain(b) * self._raw(a)) <= 2

    def above(self, a: Fraction, b: Fraction) -> bool:
        """True where the albedo is shown to exceed 1 on [a, b]: then the factor is positive at both ends and between."""
        if self.side(a) != ABOVE or self.side(b) != ABOVE:
            return False
        if isinstance(self.profile, Power) and self.profile.form == "mirror":
            return True
        middle = (a + b) / 2
        centre = self._raw(middle)
        at_ends = (self.gain(end) * (2 * centre - self._raw(other)) for end, other in ((a, b), (b, a)))
        return all(lower(value) > 1 for value in (self.albedo(middle), *at_ends))

    def onwards(self, n: Fraction) -> bool:
        """True where the albedo is shown to be at most 1 from n on, for every larger n."""
        slope, offset = self.line
        if upper(slope) <= 0:  # then the factor falls, as e does but for what rebounds
            return self.side(n) == BELOW and self.profile.falls_until() == math.inf
        return self.profile.stays_below(slope, offset, n)


def cover(claim: Claim, low: Fraction, high: Fraction | None, most: int = MOST_BOXES) -> list[Piece]:
    """The range [low, high] (None: unbounded) in pieces on either side of 1, with gaps of 2e-10 where the albedo crosses it.

    Raises NotProved where the albedo touches 1 within what the arithmetic tells apart, where `most` boxes are not enough, and
    for unbounded ranges in which no one test does for the rest.
    """
    _refuse_negative(claim, low, high)
    pieces: list[Piece] = []
    start, boxes = low, 0
    while True:
        side = claim.side(start)
        if side is None:
            raise NotProved(f"at n = {written(start)} the albedo cannot be told from 1")
        nodes, limit, after = [start], high, None
        step = high - low if high is not None else max(start, Fraction(1))
        onwards = False
        while limit is None or nodes[-1] < limit:
            a = nodes[-1]
            onwards = side == BELOW and claim.onwards(a)
            if onwards:
                break
            b = limit if limit is not None and a + step >= limit else _short(a, step)
            if claim.side(b) not in (side, None):
                limit, after = _crossing(claim, side, a, b)
                continue
            if (claim.below if side == BELOW else claim.above)(a, b):
                nodes.append(b)
                step, boxes = 2 * step, boxes + 1
            else:
                step /= 2
            if limit is None and a > _FARTHEST:
                raise NotProved("no proof found for an unbounded range: give the range an upper end")
            if step < _SMALLEST * max(a, Fraction(1)) or boxes > most:
                raise NotProved(f"no proof found: near n = {float(a):g} the albedo is too close to 1 for this method")
        pieces.append(Piece(side, tuple(nodes), onwards))
        if after is None or onwards:
            return pieces
        start = after


def _refuse_negative(claim: Claim, low: Fraction, high: Fraction | None) -> None:
    """NotProved where the factor is negative somewhere in the range: it is linear, so its ends tell."""
    ends = [claim.gain(low)] + ([claim.gain(high)] if high is not None else [claim.line[0]])
    if any(lower(end) < 0 for end in ends):
        raise NotProved("the factor is negative for some n of the range")


def _short(a: Fraction, step: Fraction) -> Fraction:
    """A number of few binary digits between a and a + step, the latter included; not far from the latter."""
    grid = Fraction(2) ** (math.floor(math.log2(step)) - 2)
    return (a + step) // grid * grid


def _crossing(claim: Claim, side: str, a: Fraction, b: Fraction) -> tuple[Fraction, Fraction]:
    """Two neighbours of the grid between a, on `side`, and b, on the other; or a and b where they are as near."""
    while b - a > Fraction(2, _GRID):
        middle = Fraction(round((a + b) / 2 * _GRID), _GRID)
        found = claim.side(middle)
        if found is None:
            raise NotProved(f"at n = {written(middle)} the albedo cannot be told from 1")
        a, b = (middle, b) if found == side else (a, middle)
    return a, b


def peak(claim: Claim, pieces: Sequence[Piece]) -> Fraction:
    """A number of few digits at which the albedo exceeds 1 by about as much as anywhere in the pieces above 1."""

    def value(n: Fraction) -> Fraction:
        return lower(claim.albedo(n))

    nodes = [node for piece in pieces if piece.side == ABOVE for node in piece.nodes]
    place = max(range(len(nodes)), key=lambda index: value(nodes[index]))
    a, b = nodes[max(place - 1, 0)], nodes[min(place + 1, len(nodes) - 1)]
    for _ in range(24):  # the ratio (2/3)^24 is 6e-5
        third = (b - a) / 3
        a, b = (a + third, b) if value(a + third) < value(b - third) else (a, b - third)
    rounded = Fraction(f"{float(a + b) / 2:.4g}")
    return rounded if nodes[0] <= rounded <= nodes[-1] and value(rounded) > value(nodes[place]) else nodes[place]


def written(value: Fraction) -> str:
    """An exact number as text: its decimals where they end, else a quotient."""
    twos, fives, rest = 0, 0, value.denominator
    while rest % 2 == 0:
        rest, twos = rest // 2, twos + 1
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    if rest != 1 or max(twos, fives) > 60:
        return f"{value.numerator}/{value.denominator}"
    places = max(twos, fives)
    digits = f"{abs(value.numerator) * 10**places // value.denominator:0{places + 1}d}"
    text = f"{digits[:-places]}.{digits[-places:]}" if places else digits
    return f"-{text}" if value < 0 else text
