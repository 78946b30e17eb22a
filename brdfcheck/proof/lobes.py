r"""The lobes that proofs know: their albedo at normal incidence in closed form, enclosed, and what the theorems ask of them.

All are in units of pi: $e(n) = \frac1\pi \int f (N \cdot V)\, dV$ of the lobe without its factor. With the versine v = 1 - c
it is $\int_0^1 g\, 2(1-v)\, dv$ in the mirror form and $8 \int_0^{1-1/\sqrt2} g\, (1 - 5v + 6v^2 - 2v^3)\, dv$ in the half
form. These weights are not negative, and each profile g falls with n and is convex in n at a fixed angle, being $c^n$, the
power k >= 1 of max(0, affine) or 1/affine: so e falls with n and is convex, which is all that `cover` needs. (An even power
without the max is convex, too, but rises again. Of Kuijk and Blake's lobe e is convex though g is not: `docs/proofs.md`.)
"""

from __future__ import annotations

import abc
import functools
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, final

from brdfcheck.proof.intervals import Interval, Number, cos, exp2, log, pi, sqrt, upper

# The weight under the integral over the versine, and its derivatives, from the lowest power on.
_WEIGHTS = {
    "mirror": ((2, -2), (-2,)),
    "half": ((8, -40, 48, -16), (-40, 96, -48), (96, -96), (-96,)),
}


@functools.cache
def _end(form: str) -> Number:
    """The versine of the last direction above the horizon."""
    return Fraction(1) if form == "mirror" else 1 - sqrt(Fraction(1, 2))


@dataclass(frozen=True)
class Profile(abc.ABC):
    """A lobe with peak value 1. `form`: "mirror" or "half"."""

    form: str

    def __post_init__(self) -> None:
        if self.form not in _WEIGHTS:
            raise ValueError(f"form must be one of {', '.join(_WEIGHTS)}; got {self.form!r}")

    @abc.abstractmethod
    def albedo(self, n: Fraction) -> Number:
        """e(n) for n >= 0: exact where it is rational, else enclosed."""

    @property
    @abc.abstractmethod
    def formula(self) -> str:
        """The lobe in words."""

    @property
    def record(self) -> dict[str, Any]:
        """The lobe in a certificate."""
        return {"kind": _KIND_OF[type(self)], **vars(self)}

    def falls_until(self) -> float:
        """Up to which n the profile nowhere rises with its angle, which the theorem on normal incidence asks."""
        return math.inf

    def stays_below(self, slope: Number, offset: Number, n: Fraction) -> bool:
        """True where (slope m + offset) e(m) <= 1 is shown for all m >= n at once, for a factor that rises with m."""
        return False

    @property
    def axis(self) -> str:
        """The cosine of the lobe's angle."""
        return "R.V" if self.form == "mirror" else "N.H"


@final
@dataclass(frozen=True)
class Constant(Profile):
    """The same in all directions: Lambert's, with the reflectance over pi as its factor."""

    def albedo(self, n: Fraction) -> Number:
        return Fraction(1)

    @property
    def formula(self) -> str:
        return ""


@final
@dataclass(frozen=True)
class Power(Profile):
    """The cosine power, c^n: Phong's lobe in the mirror form, Blinn and Phong's in the half form."""

    def albedo(self, n: Fraction) -> Number:
        if self.form == "mirror":
            return 2 / (n + 2)
        return (n + exp2(-n / 2)) * (8 / ((n + 2) * (n + 4)))

    @property
    def formula(self) -> str:
        return f"({self.axis})^n"

    def stays_below(self, slope: Number, offset: Number, n: Fraction) -> bool:
        if self.form == "mirror":
            # (slope m + offset) 2/(m + 2) is monotone in m, with the limit 2 slope.
            return upper(2 * slope) <= 1 and upper((slope * n + offset) * self.albedo(n)) <= 1
        # (m + 2)(m + 4) - 8 (slope m + offset)(m + u) >= 0 with u = 2^(-m/2). Here (slope m + offset) u falls once
        # (m + offset/slope) log(2)/2 >= 1, so that its value at n is a bound: what is left is quadratic in m - n.
        if upper(3 * slope - (slope * n + offset)) > 0:
            return False
        square, linear = 1 - 8 * slope, 6 - 8 * offset
        constant = 8 - 8 * (slope * n + offset) * exp2(-n / 2)
        shifted = (square, 2 * n * square + linear, n * n * square + n * linear + constant)
        return all(upper(-coefficient) <= 0 for coefficient in shifted)


@final
@dataclass(frozen=True)
class TruncatedPower(Profile):
    """(1 - n (1-c)/k)^k, 0 beyond its first zero if `clamped`: the binomial power, and Lyon's lobe with k = 2^w."""

    k: int
    clamped: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if type(self.k) is not int or type(self.clamped) is not bool or self.k < 1 or (self.k % 2 and not self.clamped):
            raise ValueError(f"k must be a whole number >= 1, and even without the clamp; got {self.k!r}")

    def albedo(self, n: Fraction) -> Number:
        """By repeated integration by parts, which takes as many terms for every k."""
        if n == 0:
            return Fraction(1)
        rate, end = n / self.k, _end(self.form)
        rest = Interval.of(1 - rate * end)
        if self.clamped:
            rest = rest.clipped() if rest.high > 0 else Fraction(0)  # exact past the first zero
        last, divisor = rest ** (self.k + 1), Fraction(1)
        total: Number = Fraction(0)
        for order, weight in enumerate(_WEIGHTS[self.form]):
            divisor *= rate * (self.k + 1 + order)
            value: Number = Fraction(0)
            for coefficient in reversed(weight):
                value = value * end + coefficient
            total += (weight[0] - value * last) * (1 / divisor)
            last = last * rest
        return total

    @property
    def formula(self) -> str:
        base = f"1 - n (1 - {self.axis})/{self.k}"
        return f"max(0, {base})^{self.k}" if self.clamped else f"({base})^{self.k}"

    def falls_until(self) -> float:
        return math.inf if self.clamped else self.k

    def stays_below(self, slope: Number, offset: Number, n: Fraction) -> bool:
        # The weight is largest at the angle 0, so that e(m) <= w k/((k + 1) m): what is left falls or rises to its limit.
        if not self.clamped or n == 0:
            return False
        limit = Fraction(_WEIGHTS[self.form][0][0] * self.k, self.k + 1)
        return upper(limit * slope) <= 1 and upper(limit * (slope + offset * (1 / n))) <= 1


@final
@dataclass(frozen=True)
class Rational(Profile):
    """Schlick's lobe, c/(n - n c + c)."""

    def albedo(self, n: Fraction) -> Number:
        """By division with a remainder: a polynomial, and the remainder times a logarithm."""
        if n == 0:
            return Fraction(1)
        start = 1 - _end(self.form)
        # c times the weight, from the lowest power of c on.
        above = [Fraction(a) for a in ((0, 0, 2) if self.form == "mirror" else (0, 0, -8, 0, 16))]
        if n == 1:
            return _integral(above, start)
        pole = n / (n - 1)
        quotient: list[Fraction] = []
        for coefficient in reversed(above):
            quotient.append(coefficient + (quotient[-1] * pole if quotient else 0))
        remainder = quotient.pop()
        whole = _integral(quotient[::-1], start)
        return (remainder * log(n - (n - 1) * start) - whole) / (n - 1)

    @property
    def formula(self) -> str:
        return f"c/(n - n c + c) with c = {self.axis}"


@final
@dataclass(frozen=True)
class Quadratics(Profile):
    """Kuijk and Blake's lobe: quadratic in the angle up to p, another quadratic up to q, then 0."""

    def albedo(self, n: Fraction) -> Number:
        """Both pieces integrated by parts, against half a sine up to pi of the double or, in the half form, fourfold angle."""
        if n == 0:
            return Fraction(1)
        scale = {"mirror": 2, "half": 4}[self.form]
        p = scale * (n + Fraction("5.6")) / (n * (Fraction("0.09") * n + Fraction("5.2")))
        q = scale * (n + 65) / (5 * n + Fraction("31.7"))
        if p >= upper(pi()):
            return 1 - (pi() * pi() - 4) * (1 / (2 * p * q))
        # Where q lies past pi by less than 2^-250, not to cut there changes less than 2^-500.
        end, cut = (Fraction(-1), (q - pi()) ** 2) if q >= upper(pi()) else (cos(q), Fraction(0))
        return Fraction(1, 2) + (1 - cos(p)) / (p * q) + (cut * Fraction(1, 2) + end - cos(p)) / (q * (q - p))

    @property
    def formula(self) -> str:
        return f"Kuijk and Blake's lobe of {self.axis}"


KINDS: dict[str, type[Profile]] = {
    "constant": Constant,
    "power": Power,
    "truncated-power": TruncatedPower,
    "schlick": Rational,
    "kuijk-blake": Quadratics,
}
_KIND_OF = {kind: name for name, kind in KINDS.items()}


def _integral(coefficients: list[Fraction], start: Number) -> Number:
    """The integral of a polynomial (lowest power first) from `start` to 1."""
    total: Number = Fraction(0)
    for order, coefficient in reversed(list(enumerate(coefficients))):
        total = total * start + coefficient / (order + 1)
    return sum((a / (order + 1) for order, a in enumerate(coefficients)), Fraction(0)) - total * start
