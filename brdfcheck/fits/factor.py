r"""Normalisation factors fitted to a lobe, each with the verdict of `check` over all angles.

Two of the objectives are what people do: least squares of the albedo against 1, and a straight line through 1/E, which is what
a curve-fitting package makes of the question. Both overshoot, so both are certified afterwards: B is enlarged by the largest
albedo that `check` finds. The third is what they want: E <= 1 everywhere and the smallest albedo as large as possible, a linear
program (`minimax`).

The albedo at normal incidence is what a factor of n can level; the constraint E <= 1 holds at every angle all the same, because
the worst angle that `check` finds is put into the program until there is none above 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
import optimistix as optx

from brdfcheck.brdf.factors import AbstractFactor, Constant, Factor, Proportional, RationalFactor
from brdfcheck.brdf.family import Family
from brdfcheck.fits.minimax import Ceiling, Rational, best_rational, spread
from brdfcheck.fits.raw import RawAlbedo
from brdfcheck.messages import UsageError, one_of
from brdfcheck.proof.certify import certify_family
from brdfcheck.proof.cover import NotProved
from brdfcheck.runtime import double_precision
from brdfcheck.verdict import TOLERANCE, Report, Verdict, check_family

Objective = Literal["minimax", "least-squares", "reciprocal"]
OBJECTIVES: tuple[Objective, ...] = ("minimax", "least-squares", "reciprocal")
Sampling = Literal["geometric", "linear", "integers"]
SAMPLINGS: tuple[Sampling, ...] = ("geometric", "linear", "integers")

# Rounds in which the worst angle may be put into the program.
_ROUNDS = 8
# In units of the largest exponent. Beyond it (n+A)/B is a constant in all but name.
_LARGEST_A = 1e6
# Below this a factor loses so much of the light that the reader is told why.
_WASTEFUL = 0.7
# Of the factor that is proved: digits of its constants.
_DIGITS = 10
# By how much B is enlarged, at first by the rounding of its digits alone; where the albedo comes that close to 1, a proof of so
# many boxes takes a second at most.
_MARGINS = (0.0, 1e-9, 1e-8, 1e-7, 1e-6)
_BOXES = 1000


@dataclass(frozen=True)
class Step:
    """A factor on the way to the fit: its largest and smallest albedo at normal incidence (or over all angles: see `note`)."""

    factor: AbstractFactor
    peak: float
    smallest: float
    note: str


@dataclass(frozen=True)
class FactorFit:
    """A fitted factor and what it does to the albedo of its lobe, called `name`: by an `objective`, over exponents `n`.

    `sampling`: how the exponents of a least-squares fit lie. `peak` +- `peak_error` is the largest albedo over the range of n
    and all angles, `at` says where (n, cos_theta). `smallest` is the smallest albedo at normal incidence, at the exponent
    `smallest_n`. `history`: the steps of the fit. `report`: the verdict of `check`. `remark`: why the factor wastes much of the
    light; empty where it does not. `fitted` is the factor before it was certified, `family` the family with the factor on it.
    `proved`: a factor of 10 digits beside it whose albedo is proved to be at most 1; None where the proofs do not know the
    lobe. `constant`: there is no exponent, and the factor is the one at n = 1.
    """

    name: str
    family: Family
    factor: AbstractFactor
    peak: float
    peak_error: float
    at: Mapping[str, float]
    smallest: float
    smallest_n: float
    history: tuple[Step, ...]
    objective: str
    sampling: str
    n: tuple[float, float]
    fitted: AbstractFactor
    report: Report
    remark: str
    proved: Factor | None = None
    constant: bool = False

    @property
    def verdict(self) -> Verdict:
        """Whether the lobe with this factor conserves energy, over all angles."""
        return self.report.verdict


def certify(raw: RawAlbedo, factor: Factor, *, tolerance: float = TOLERANCE) -> tuple[Factor, Report]:
    """The factor with B enlarged by the largest albedo over all angles, so that it conserves; and the verdict on it.

    `raw`: the lobe without a factor, over its exponents; `tolerance`: how far above 1 still conserves. ValueError where the
    largest albedo is not finite.
    """
    report = check_family(raw.with_factor(factor), tolerance=tolerance, intervals=False)
    excess = report.albedo + report.error
    if not math.isfinite(excess):
        raise ValueError(f"{raw.name}: the largest albedo is not finite, so no factor normalises it")
    if not _kept(report):
        factor = Factor(factor.A, factor.B * excess)
        report = check_family(raw.with_factor(factor), tolerance=tolerance)
    return factor, report


def _kept(report: Report) -> bool:
    """Whether the factor may stay as it is. A bar that contains 1 may be rounding alone: exact factors stay."""
    return report.albedo - report.error <= 1 and report.verdict is Verdict.CONSERVES


def fit_factor(
    family: Any,
    n: tuple[float, float] = (1, 1000),
    objective: Objective = "minimax",
    *,
    sampling: Sampling = "geometric",
    samples: int = 400,
    tolerance: float = TOLERANCE,
) -> FactorFit:
    """The factor (n+A)/B that normalises a lobe on a range of exponents, and the verdict on the result over all angles.

    `family`: a name that `check` takes, a `Family`, or a class or function n -> BRDF; a factor that it already carries is taken
    off. `n`: the exponents; `tolerance`: how far above 1 still conserves.
    `objective`: "minimax" keeps E <= 1 at every angle and makes the smallest albedo at normal incidence as large as a factor
    of this form can (B < 0, a line that falls with n, where the raw albedo rises); "least-squares" (sum of (E - 1)^2) and
    "reciprocal" (sum of ((n+A)/B - 1/E)^2) are certified afterwards. These two see `samples` exponents spaced as `sampling`
    says: geometric, linear, or every integer of the range.

    What has no exponent, as a table or a family whose parameters are held, has one constant as its factor, n/B at n = 1,
    whatever `n` and the `objective` are.

    Raises ValueError for a bad range, objective or sampling, for parameters other than n that run over ranges, for what
    transmits, and where no factor of this form conserves; KeyError for an unknown name.
    """
    one_of(objective, OBJECTIVES, "objective")
    one_of(sampling, SAMPLINGS, "sampling")
    if not isinstance(samples, int) or isinstance(samples, bool) or samples < 2:
        raise ValueError(f"samples must be a whole number, at least 2; got {samples!r}")
    with double_precision():
        raw = RawAlbedo(family, n)
        if raw.constant:
            return _constant(raw, objective, tolerance)
        if objective == "minimax":
            return fit_form(raw, (1, 0), tolerance=tolerance)
        places = _samples(raw, sampling, samples)
        fitted = _least_squares(raw, places, objective)
        factor, report = certify(raw, fitted, tolerance=tolerance)
        return _result(raw, factor, report, [_step(raw, fitted, f"{objective}, {len(places)} exponents")], objective, sampling)


def _constant(raw: RawAlbedo, objective: Objective, tolerance: float) -> FactorFit:
    """The largest constant with which a BRDF conserves at every angle, whatever the samples of a table leave open."""
    tolerance = max(tolerance, raw.family.tolerance)
    report = check_family(raw.family, tolerance=tolerance, intervals=False)
    most = max(report.albedo + report.error, -math.inf if report.doubt is None else report.doubt.most)
    if not 0 < most < math.inf:
        raise ValueError(f"{raw.name}: the largest albedo must be finite and > 0 to be normalised; got {most:g}")
    factor = Factor(0.0, most)
    history = [Step(factor, report.albedo / most, raw.lowest(factor)[0], "one constant: there is no exponent")]
    return _result(raw, factor, check_family(raw.with_factor(factor), tolerance=tolerance), history, objective, "continuous")


def _samples(raw: RawAlbedo, sampling: Sampling, count: int) -> np.ndarray:
    if raw.single:
        return np.array([raw.low])
    if sampling == "integers":
        whole = np.arange(math.ceil(raw.low), math.floor(raw.high) + 1, dtype=float)
        if whole.size < 2:
            raise ValueError(f"there are fewer than two integers in {raw.low:g}:{raw.high:g}; choose another sampling")
        if whole.size > 100_000:
            raise ValueError(f"there are {whole.size} integers in {raw.low:g}:{raw.high:g}, at most 100000 can be sampled")
        return whole
    if sampling == "linear":
        return np.linspace(raw.low, raw.high, count)
    return np.geomspace(raw.low, raw.high, count) if raw.low > 0 else spread(raw.low, raw.high, count)


def _least_squares(raw: RawAlbedo, n: np.ndarray, objective: Objective) -> Factor:
    """The least squares of either objective."""
    albedo = raw(n)
    if not np.all(np.isfinite(albedo) & (albedo > 0)):
        raise ValueError(f"{raw.name}: the raw albedo must be finite and > 0 to be normalised")
    if n.size == 1:
        return _one_point(float(n[0]), float(albedo[0]))
    scale = float(n[-1])
    # Both unknowns are of the order of 1/E(n) at the upper end.
    size = 1 / albedo[-1]

    def residual(unknowns: Any, _: Any) -> Any:
        line = size * (unknowns[0] * jnp.asarray(n) / scale + unknowns[1])
        return (
            line * jnp.asarray(albedo) - 1 if objective == "least-squares" else line / size - 1 / (size * jnp.asarray(albedo))
        )

    # Linear, so a Gauss-Newton step with little damping ends it; the tolerance is on the scaled unknowns.
    solver = optx.LevenbergMarquardt(rtol=1e-13, atol=1e-15)
    solution = optx.least_squares(residual, solver, jnp.asarray([1.0, 0.0]), max_steps=400, throw=False)
    slope, offset = (float(part) for part in solution.value)
    return _two_constants(raw, offset * size, slope * size / scale)


def _one_point(n: float, albedo: float) -> Factor:
    """A range of one exponent leaves A free: the plainest factor."""
    return Factor(0.0, n * albedo) if n > 0 else Factor(1.0, albedo)


def _one_point_form(degrees: tuple[int, ...], n: float, albedo: float) -> AbstractFactor:
    """Any form of factor over a range of one exponent, where its value there is all that counts."""
    if degrees == (0, 0) or (degrees == (1, 0, 1) and n == 0):
        return Constant(1 / albedo)
    if degrees == (1, 0, 1):
        return Proportional(n * albedo)
    if degrees == (1, 0):
        return _one_point(n, albedo)
    return RationalFactor([1 / albedo] + [0.0] * degrees[0], [1.0] + [0.0] * degrees[1])


def _step(raw: RawAlbedo, factor: AbstractFactor, note: str) -> Step:
    _, values = raw.extrema(factor, 4 if raw.fast else 1)
    return Step(factor, float(values.max()), float(values.min()), note)


def fit_form(raw: RawAlbedo, degrees: tuple[int, int] | tuple[int, int, int], *, tolerance: float = TOLERANCE) -> FactorFit:
    """The minimax factor of another form: P(n)/Q(n) of degrees (p, q), or (p, q, r) where P starts at the power r.

    (0, 0) is a constant, (1, 0, 1) is n/B, (1, 0) is (n+A)/B. ValueError where no such factor conserves.
    """
    history: list[Step] = []
    ceiling = _ceiling(raw)
    factor: AbstractFactor | None = None
    best_of_its_form = True
    for _ in range(_ROUNDS):
        if raw.single:
            ends = raw(np.array([raw.low, raw.high]))
            factor = _one_point_form(degrees, raw.low, float(max(np.append(ceiling.albedo, ends))))
            history.append(_step(raw, factor, "one exponent"))
        else:
            best, steps = best_rational(raw, raw.grid(), degrees, ceiling, rounds=8 if raw.fast else 2)
            factor = _as_factor(raw, degrees, best)
            history += [Step(_as_factor(raw, degrees, step), step.largest, step.smallest, "exchange") for step in steps]
        report = check_family(raw.with_factor(factor), tolerance=tolerance)
        if not math.isfinite(report.albedo + report.error):
            raise ValueError(f"{raw.name}: the largest albedo is not finite, so no factor normalises it")
        if _kept(report):
            break
        if not report.albedo > 1 + 1e-6:  # what is left is the accuracy of the search: take it off the factor
            factor = _shrunk(factor, report.albedo + report.error)
            report = check_family(raw.with_factor(factor), tolerance=tolerance)
            if _kept(report):
                break
        # The worst place over all angles joins the program.
        place = np.array([report.parameters["n"]])
        roof = raw.at(place, np.array([report.cos_theta]))
        ceiling = Ceiling(np.append(ceiling.n, place), np.append(ceiling.albedo, roof))
        history.append(Step(factor, report.albedo, history[-1].smallest, f"check: worst at {report.angle:.4g} degrees"))
    else:
        assert factor is not None
        best_of_its_form = False
        factor = _shrunk(factor, report.albedo + report.error)
        report = check_family(raw.with_factor(factor), tolerance=tolerance)
    return _result(raw, factor, report, history, "minimax", "continuous", best_of_its_form)


def _shrunk(factor: AbstractFactor, by: float) -> AbstractFactor:
    if isinstance(factor, Factor):
        return Factor(factor.A, factor.B * by)
    if isinstance(factor, Constant):
        return Constant(factor.value / by)
    if isinstance(factor, Proportional):
        return Proportional(factor.B * by)
    assert isinstance(factor, RationalFactor)
    return RationalFactor(factor.numerator / by, factor.denominator)


def _ceiling(raw: RawAlbedo) -> Ceiling:
    """Raw albedos away from normal incidence: the worst cosine for some exponents, where it is not the normal one."""
    low, high = raw.family.cos_theta
    if low == high:
        return Ceiling(np.zeros(0), np.zeros(0))
    n = raw.grid()[:: 8 if raw.fast else 16]
    cosines = low + (high - low) * np.linspace(0, 1, 17 if raw.fast else 5) ** 2
    table = raw.at(np.repeat(n, cosines.size), np.tile(cosines, n.size)).reshape(n.size, cosines.size)
    worst = table.max(axis=1)
    steeper = worst > table[:, -1] * (1 + 1e-12)
    return Ceiling(n[steeper], worst[steeper])


def _as_factor(raw: RawAlbedo, degrees: tuple[int, ...], best: Rational) -> AbstractFactor:
    numerator, denominator = best.numerator, best.denominator
    if len(denominator) > 1:
        scale = denominator[np.argmax(np.abs(denominator))]
        return RationalFactor(numerator / scale, denominator / scale)
    if degrees == (0, 0):
        return Constant(numerator[0])
    if degrees == (1, 0, 1):
        return Proportional(1 / numerator[1])
    return _two_constants(raw, numerator[0], numerator[1])


def _two_constants(raw: RawAlbedo, intercept: float, slope: float) -> Factor:
    """(n+A)/B for the line intercept + slope n.

    A level line has no such form: then A and B are so large that the factor is a constant in all but name. So it is where the
    line falls below 0 within the range, which only a curve fit without constraints does.
    """
    largest = _LARGEST_A * raw.high
    steep = abs(slope) * largest > abs(intercept)
    if steep and (slope > 0 or intercept + slope * raw.high > 0):
        return Factor(intercept / slope, 1 / slope)
    return Factor(largest, (largest + raw.high) / abs(intercept))


def _result(
    raw: RawAlbedo,
    factor: AbstractFactor,
    report: Report,
    history: list[Step],
    objective: str,
    sampling: str,
    best_of_its_form: bool = False,
) -> FactorFit:
    smallest, where = raw.lowest(factor)
    fitted = history[0].factor if objective != "minimax" else history[-1].factor
    history.append(Step(factor, report.albedo, smallest, "certified over all angles"))
    found = {
        "objective": objective,
        "at": {"n": report.parameters["n"], "cos_theta": report.cos_theta},
        "smallest": smallest,
        "smallest_n": where,
    }
    return FactorFit(
        name=raw.name,
        family=raw.with_factor(factor),
        factor=factor,
        peak=report.albedo,
        peak_error=report.error,
        history=tuple(history),
        sampling=sampling,
        n=(raw.low, raw.high),
        fitted=fitted,
        report=report,
        remark=_remark(raw, found, best_of_its_form) if smallest < _WASTEFUL else "",
        proved=proved_factor(raw, factor),
        constant=raw.constant,
        **found,
    )


def _remark(raw: RawAlbedo, fit: dict[str, Any], best_of_its_form: bool) -> str:
    """Why a factor wastes: an angle or a growth of the raw albedo that no factor of this form can follow."""
    smallest, where, at = fit["smallest"], fit["smallest_n"], fit["at"]
    best = "even the best factor of this form" if best_of_its_form else "this factor"
    text = f"{best} reflects only {smallest:.4g} of the light{'' if raw.constant else f' at n={where:.5g}'}"
    place = at["n"]
    worst = np.array([place])
    normal = float(raw(worst)[0])
    tilted = float(raw.at(worst, np.array([at["cos_theta"]]))[0])
    if tilted > 1.5 * normal:
        angle = math.degrees(math.acos(at["cos_theta"]))
        return (
            f"{text}: at {angle:.4g} degrees the lobe reflects {tilted / normal:.4g} times what it reflects at normal incidence"
            f"{'' if raw.constant else f' (n={place:.5g})'}, and a factor of n alone cannot level angles"
        )
    if raw.constant:
        return text
    low, high = (float(value) for value in raw(np.array([raw.low, raw.high])))
    if high > low:
        return (
            f"{text}: the raw albedo does not fall with n ({low:.4g} at n={raw.low:g}, {high:.4g} at n={raw.high:g}), and a"
            " straight line cannot fall as it rises"
        )
    places = np.unique([raw.low, where, raw.high])
    products = places * raw(places)
    shown = ", ".join(f"{product:.4g} at n={place:.5g}" for place, product in zip(places, products, strict=True))
    text += f": n times the raw albedo is {shown}, and a factor that grows like n can only follow where that is level"
    # Two octaves at the far end tell a logarithm from a power.
    far = raw.high / np.array([4.0, 2.0, 1.0])
    if far[0] > raw.low and far[0] > 0:
        rise = np.diff(far * raw(far)) / np.log(2)
        if rise[1] > 0 and abs(rise[1] / rise[0] - 1) < 0.1:
            text += f"; it grows like {rise[1]:.4g} ln n, the mark of a tail that falls too slowly"
        elif rise[1] > 0 and rise[1] > 1.5 * rise[0]:
            text += "; it grows like a power of n: the lobe stops getting narrower"
    return text


def proved_factor(raw: RawAlbedo, factor: AbstractFactor) -> Factor | None:
    """(n+A)/B with constants of 10 digits, near `factor`, whose albedo is proved to be at most 1 on the range of `raw`.

    The optimum itself touches 1, and rounds to either side.

    None for lobes and factors that the theorems do not know, and where none so near is proved.
    """
    if not isinstance(factor, Factor) or float(factor.B) <= 0:
        return None
    offset = float(_rounded(float(factor.A), ROUND_FLOOR))
    for margin in _MARGINS:
        near = Factor(offset, float(_rounded(float(factor.B) * (1 + margin), ROUND_CEILING)))
        try:
            if certify_family(raw.with_factor(near), most=_BOXES):
                return near
        except NotProved:
            continue
        except UsageError:
            return None
    return None


def _rounded(value: float, how: str) -> Decimal:
    """`value` with 10 digits, rounded down or up."""
    exact = Decimal(value)
    return exact if not exact else exact.quantize(Decimal(1).scaleb(exact.adjusted() - _DIGITS + 1), rounding=how)
