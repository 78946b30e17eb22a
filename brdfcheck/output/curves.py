"""The numbers behind a figure: albedo against an exponent, against the angle, over both, and factors.

Each function takes what `check` takes (a catalogue name, a family, a BRDF, a function or a factory) and returns one
curve: a dict of plain numbers, ready for JSON and for `brdfcheck.plots`, which draws it and computes nothing. Everything
is sampled at points that matter for the eye and, besides, exactly where the law is broken: ends of violating intervals
and the largest albedo come from the same continuous search as the verdict, not from the sampling.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from brdfcheck.brdf import catalog, factors
from brdfcheck.brdf.factors import Normalized
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.subject import as_family
from brdfcheck.fits.raw import RawAlbedo
from brdfcheck.output.curve_files import rounded, stretches
from brdfcheck.output.records import number
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.samples import bars
from brdfcheck.verdict import TOLERANCE, judge
from brdfcheck.verdict.measured import doubted
from brdfcheck.verdict.supremum import Supremum, supremum

Curve = dict[str, Any]


@dataclass(frozen=True)
class _Effort:
    """How many points: what an engine's evaluations cost decides. `turns`: azimuths of an anisotropic BRDF at first.

    An odd number: of the many that are the same half a turn away twice as many are seen then.
    """

    exponents: int
    cosines: int
    angles: int
    rounds: int
    turns: int
    rtol: float | None


# By so many parabolas the largest of all azimuths is found: to 2e-5 of how much it varies, if it does so twice in a turn.
_TURNED = 3
# Cosines of a heat map at least, but of a function that is called pair by pair: with fewer its contours are polygons.
_MAP_COSINES = 17
_MOST_SWITCHES = 3  # eight curves of one BRDF
# By `PointwiseAlbedo.effort`.
_EFFORTS = (
    _Effort(241, 33, 129, 3, 1, None),
    _Effort(61, 21, 97, 2, 1, None),
    _Effort(49, 9, 97, 1, 7, 1e-6),
    _Effort(17, 7, 25, 1, 7, 1e-6),
)


# --- the four kinds ---


def albedo_vs_n(
    target: Any, *, samples: int | None = None, cos_theta: tuple[float, float] | None = None, **ranges: tuple[float, float]
) -> Curve:
    """The largest albedo over the cosines `cos_theta` (default: the family's, else all) against the one swept parameter.

    ``cos_theta=(1, 1)`` is normal incidence. `samples`: points along the parameter, to which the ends of violating
    intervals and the place of the maximum are added. Raises ValueError where not exactly one parameter runs over a range,
    and what `check` raises for bad targets; `Finding` where a user's function fails.
    """
    family = as_family(target, ranges, cos_theta)
    sampled = _Sampled(family, _swept(family))
    x = sampled.values(sampled.effort.exponents if samples is None else samples)
    value, error, at = sampled.largest(x)
    columns = {"x": rounded(x), "albedo": rounded(value), "worst_cos_theta": rounded(at)}
    return sampled.curve("albedo-vs-n", columns, error, sampled.above(x, value, error))


def factor(target: Any, **options: Any) -> Curve:
    """`albedo_vs_n` of a normalised lobe, with its factor (1/sr) and the largest factor that conserves energy, 1/E.

    The ratio of the two is the largest albedo. Takes the options of `albedo_vs_n`. ValueError for a BRDF without a factor.
    """
    ranges = {name: value for name, value in options.items() if name not in ("samples", "cos_theta")}
    family = as_family(target, ranges, options.get("cos_theta"))
    return _with_scale(albedo_vs_n(family, samples=options.get("samples")), _scale_of(family))


def _with_scale(curve: Curve, scale: Callable[[float], float]) -> Curve:
    scales = np.array([scale(float(value)) for value in curve["x"]])
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = scales / np.array(curve["albedo"], float)
    return {**curve, "kind": "factor", "factor": rounded(scales), "exact": rounded(exact)}


def albedo_vs_angle(
    target: Any, *, samples: int | None = None, cos_theta: tuple[float, float] | None = None, **values: float
) -> Curve:
    """The albedo against the cosine of incidence for one BRDF: the family's member at the parameters `values`.

    `above` are intervals of the cosine. For anisotropic BRDFs the largest over the azimuth. Raises as `albedo_vs_n`.
    """
    family = as_family(target, {name: (value, value) for name, value in values.items()}, cos_theta)
    for name, (low, high) in family.ranges.items():
        if low != high:
            raise ValueError(f"{family.name}: {name} runs over {low:g}:{high:g}; a curve over angles needs one value of it")
    sampled = _Sampled(family)
    albedo, worst = sampled.albedo, sampled.worst
    place = np.array([[low for low, _ in family.ranges.values()]])

    def at(mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, error = sampled.over_azimuths(np.repeat(place, len(mu), axis=0), mu)
        return value, error + bars(albedo, mu, np.zeros(len(mu))).max(axis=1)

    mu = _cosines(family.cos_theta, sampled.effort.angles if samples is None else samples)
    mu = np.unique(np.append(mu, np.clip(worst.cos_theta, mu[0], mu[-1])))
    value, error = at(mu)
    above = _intervals(mu, value, error, at, sampled.xtol)
    ends = np.setdiff1d([end for interval in above for end in interval], mu)
    if len(ends):
        found = zip((mu, value, error), (ends, *at(ends)), strict=True)
        order = np.argsort(np.append(mu, ends), kind="stable")
        mu, value, error = (np.append(old, new)[order] for old, new in found)
    member = {name: number(low) for name, (low, _) in family.ranges.items()}
    columns = {"at": member, "x": rounded(mu), "albedo": rounded(value)}
    return sampled.curve("albedo-vs-angle", columns, error, above)


def heatmap(
    target: Any, *, samples: int | None = None, cos_theta: tuple[float, float] | None = None, **ranges: tuple[float, float]
) -> Curve:
    """The albedo over the swept parameter and the cosine of incidence, rows of `albedo` along the parameter.

    `samples`: points along the parameter. Raises as `albedo_vs_n`, and ValueError where a range holds a single value.
    """
    family = as_family(target, ranges, cos_theta)
    parameter = _swept(family)
    low, high = family.ranges[parameter]
    if low == high or family.cos_theta[0] == family.cos_theta[1]:
        what = parameter if low == high else "cos theta"
        raise ValueError(f"{family.name}: a heat map needs a range of {what}, not a single value")
    sampled = _Sampled(family, parameter)
    effort = sampled.effort
    x = sampled.values((effort.exponents + 1) // 2 if samples is None else samples)
    cosines = effort.cosines if sampled.albedo.one_by_one else max(effort.cosines, _MAP_COSINES)
    mu = np.unique(np.append(_cosines(family.cos_theta, cosines), sampled.worst.cos_theta))
    value, error = sampled.over_azimuths(sampled.places(np.repeat(x, len(mu))), np.tile(mu, len(x)))
    value, error = value.reshape(len(x), len(mu)), error.reshape(len(x), len(mu))
    best = np.argmax(np.where(np.isnan(value), -np.inf, value), axis=1)[:, None]
    top, bar = (np.take_along_axis(table, best, 1)[:, 0] for table in (value, error))
    columns = {"x": rounded(x), "cosines": rounded(mu), "albedo": [rounded(row, 10) for row in value]}
    return sampled.curve("heatmap", columns, error, sampled.above(x, top, bar))


KINDS: dict[str, Callable[..., Curve]] = {
    "albedo-vs-n": albedo_vs_n,
    "albedo-vs-angle": albedo_vs_angle,
    "heatmap": heatmap,
    "factor": factor,
}


def fitted(kind: str, target: Any, result: Mapping[str, Any], *, samples: int | None = None) -> Curve:
    """The curve of `kind` (``factor`` or ``albedo-vs-n``) of a family with the factor of a fit, as `brdfcheck fit` records it.

    A factor that the family has already is taken off. ValueError for a form of factor that is not known, KeyError where
    `result` is not of a fit.
    """
    described = dict(result["factor"])
    form = described.pop("form")
    if form not in _FORMS:
        raise ValueError(f"unknown form of factor {form!r}; known: {', '.join(_FORMS)}")
    known: Any = getattr(factors, form)(**{name: np.asarray(value, float) for name, value in described.items()})
    raw = RawAlbedo(target, (float(result["n"][0]), float(result["n"][1])))
    family = replace(raw.with_factor(known), name=f"{raw.name}, {result['objective']}")
    curve = albedo_vs_n(family, samples=samples)
    return curve if kind == "albedo-vs-n" else _with_scale(curve, lambda n: float(np.asarray(known(np.asarray(n)))))


_FORMS = ("Factor", "Constant", "Proportional", "RationalFactor", "PhongExact", "BlinnPhongExact")


# --- values to draw a curve at ---


def round_values(low: float, high: float, most: int = 5) -> list[float]:
    """A few round numbers in [low, high]: powers of ten, or 1-2-5 steps where those are too few; else even steps."""
    if low == high:
        return [low]
    for steps in ((1,), (1, 2, 5)):
        if low <= 0:
            break
        first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
        values = [float(f"{step}e{power}") for power in range(first, last + 1) for step in steps]
        inside = [value for value in values if low <= value <= high]
        if len(inside) >= 3:
            keep = np.unique(np.linspace(0, len(inside) - 1, most).round().astype(int))
            return [inside[i] for i in keep]
    return np.linspace(low, high, most).tolist()


def switched(family: Family) -> dict[str, Family]:
    """The family at each end of its switches (the side of the light, a bool), where another parameter runs over a range.

    By what tells them apart, as in ``below=0``; nothing where there are no switches to hold.
    """
    running = {name for name, (low, high) in family.ranges.items() if low < high}
    switches = sorted(running & family.switches)
    if len(running - family.switches) != 1 or len(switches) > _MOST_SWITCHES:
        return {"": family}
    found = {}
    for ends in product(*(family.ranges[name] for name in switches)):
        held = dict(zip(switches, ends, strict=True))
        text = " ".join(f"{name}={end:g}" for name, end in held.items())
        found[text] = replace(family, ranges={**family.ranges, **{name: (end, end) for name, end in held.items()}})
    return found


def swept_parameter(family: Family) -> str | None:
    """The one parameter that runs over a range; None where none does. ValueError for several."""
    swept = [name for name, (low, high) in family.ranges.items() if low < high]
    if len(swept) > 1:
        shown = sorted(swept, key=lambda name: name in family.switches)
        shown = shown[: max(2, len(set(swept) - family.switches))]
        raise ValueError(f"{family.name}: {', '.join(shown)} run over ranges; hold all but one, as in --over {shown[-1]}=VALUE")
    return swept[0] if swept else None


# --- pieces ---


def _swept(family: Family) -> str:
    swept = swept_parameter(family)
    if swept is None and not family.ranges:
        raise ValueError(f"{family.name} has no parameter to run over; its albedo against the angle can be plotted")
    return swept if swept is not None else next(iter(family.ranges))


class _Sampled:
    """A family whose albedo is sampled along its `parameter`, or at one member of it.

    `effort`: how many points; `worst`: what the search behind the verdict finds; `xtol`: how well ends of intervals are known.
    """

    def __init__(self, family: Family, parameter: Any = None):
        self.family, self.parameter = family, parameter
        self.albedo = PointwiseAlbedo(family)
        self.effort = _EFFORTS[self.albedo.effort]
        self.xtol = 1e-12 if self.albedo.fast else 1e-5
        found = supremum(self.albedo, threshold=1 + TOLERANCE, rtol=None, intervals=True)
        if self.albedo.table is not None:
            found, doubt = doubted(self.albedo, self.albedo.table, found)
            found = replace(found, error=max(found.error, doubt.most - found.value))
        self.worst: Supremum = found

    def values(self, count: int) -> np.ndarray:
        """`count` values of the parameter, geometric where its range is long; the worst and the ends of violating intervals."""
        low, high = self.family.ranges[self.parameter]
        if low == high:
            return np.array([low])
        if low > 0 and high / low >= 10:
            values = np.geomspace(low, high, count)
        elif low >= 0 and high >= 10 * max(low, 1e-3):  # from 0: dense there, on a logarithmic axis and on a linear one
            values = low + (high - low) * np.linspace(0, 1, count) ** 3
        else:
            values = np.linspace(low, high, count)
        values[0], values[-1] = low, high
        marks = [self.worst.parameters[self.parameter], *(end for interval in self.worst.above or () for end in interval)]
        return np.unique(np.append(values, [mark for mark in marks if low <= mark <= high]))

    def places(self, x: np.ndarray) -> np.ndarray:
        """The parameters (points, names) at these values of the one."""
        ranges = self.family.ranges.items()
        return np.stack([x if name == self.parameter else np.full(len(x), low) for name, (low, _) in ranges], axis=1)

    def over_azimuths(self, places: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and errors at (place, cosine); for anisotropic BRDFs the largest over the azimuth.

        A few turns away from the azimuth of the worst, then parabolas around the best.
        """

        def at(turns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self.albedo(places, mu, turns, rtol=self.effort.rtol)

        count = self.effort.turns if self.albedo.anisotropic else 1
        turns = self.worst.azimuth + np.arange(count) * 2 * np.pi / count
        found = [at(np.full(len(mu), turn)) for turn in turns]
        values, errors = (np.array(part).T for part in zip(*found, strict=True))  # (points, turns)
        every, best = np.arange(len(mu)), np.argmax(np.where(np.isnan(values), np.inf, values), axis=1)
        top = values[every, best], errors[every, best], turns[best]
        if count == 1:
            return top[:2]
        beside = best[:, None] + np.array([-1, 0, 1])
        x, y = self.worst.azimuth + beside * 2 * np.pi / count, np.take_along_axis(values, beside % count, axis=1)
        return _climbed(at, x, y, top, _TURNED)[:2]

    def largest(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Largest albedo over the cosines at each value: (value, error, cosine). A grid, then parabolas around its best."""
        mu = _cosines(self.family.cos_theta, self.effort.cosines)
        places, rows, columns = self.places(x), len(x), len(mu)
        value, error = self.over_azimuths(np.repeat(places, columns, axis=0), np.tile(mu, rows))
        value, error = value.reshape(rows, columns), error.reshape(rows, columns)
        known = np.where(np.isnan(value), -np.inf, value)
        best, every = np.argmax(known, axis=1), np.arange(rows)
        top = value[every, best], error[every, best], mu[best]
        if columns < 3:
            return top
        beside = np.clip(best, 1, columns - 2)[:, None] + np.array([-1, 0, 1])
        around = mu[beside], np.take_along_axis(known, beside, axis=1)
        return _climbed(lambda cosines: self.over_azimuths(places, cosines), *around, top, self.effort.rounds)

    def above(self, x: np.ndarray, value: np.ndarray, error: np.ndarray) -> tuple[tuple[float, float], ...]:
        """Where the largest albedo exceeds 1: as the verdict says, or found here where its search has no intervals.

        That search is for lobes with one parameter; this one serves functions and held parameters too.
        """
        low, high = self.family.ranges[self.parameter]
        if low == high:
            return ((low, high),) if judge(self.worst.value, self.worst.error).name == "VIOLATES" else ()
        if self.worst.above is not None:
            return self.worst.above
        return _intervals(x, value, error, lambda x: self.largest(x)[:2], self.xtol)

    def curve(self, kind: str, columns: Mapping[str, Any], error: np.ndarray, above: Sequence[tuple[float, float]]) -> Curve:
        """A curve of its `columns`, with what it is of, and where it is largest and above 1."""
        family, parameter, worst = self.family, self.parameter, self.worst
        held = {name: number(low) for name, (low, high) in family.ranges.items() if name != parameter and low == high}
        return {
            "kind": kind,
            "name": family.name,
            "formula": catalog.entry(family.name).formula if family.name in catalog.names() else None,
            "engine": self.albedo.engine_name,
            "parameter": parameter,
            "range": None if parameter is None else [number(bound) for bound in family.ranges[parameter]],
            "held": {} if parameter is None else held,
            "cos_theta": [number(bound) for bound in family.cos_theta],
            **columns,
            "error": number(float(f"{np.max(error):.3g}")),
            "above": [[number(start), number(end)] for start, end in above],
            "verdict": judge(worst.value, worst.error).name,
            "largest": {
                "albedo": number(worst.value),
                "error": number(worst.error),
                "at": {name: number(value) for name, value in worst.parameters.items()},
                "cos_theta": number(worst.cos_theta),
            },
        }


def _scale_of(family: Family) -> Callable[[float], float]:
    """n -> factor of the family's lobe. ValueError where its members are not lobes with a factor."""
    parameter = _swept(family)
    held = {name: low for name, (low, high) in family.ranges.items() if name != parameter}

    def build(value: float) -> Any:
        return family.build(**{parameter: value}, **held)

    member = build(family.ranges[parameter][0])
    while not isinstance(member, Normalized) and hasattr(member, "base"):
        member = member.base
    if not isinstance(member, Normalized):
        raise ValueError(f"{family.name} has no factor: it is not a lobe times a function of its exponent")
    return lambda value: float(np.asarray(build(value).gain(1.0)))


def _cosines(bounds: tuple[float, float], count: int) -> np.ndarray:
    """Cosines that are dense at both ends: at grazing incidence for the layer there, at normal incidence for the peak."""
    low, high = (float(bound) for bound in bounds)
    if low == high:
        return np.array([low])
    values = low + (high - low) * np.sin(np.linspace(0, np.pi / 2, count)) ** 2
    values[0], values[-1] = low, high
    return values


def _climbed(
    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    x: np.ndarray,
    y: np.ndarray,
    top: tuple[np.ndarray, np.ndarray, np.ndarray],
    rounds: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The highest points (value, error, place) that parabolas find between three places x and values y of each row.

    `top`: the highest so far. Not a number stays what it is.
    """
    value, error, place = top
    for _ in range(rounds):
        candidate = _vertex(x, y)
        fresh, fresh_error = at(candidate)
        better = fresh > value
        value, error, place = (
            np.where(better, new, old) for new, old in ((fresh, value), (fresh_error, error), (candidate, place))
        )
        # The three points around the best of the four.
        points, heights = np.append(x, candidate[:, None], axis=1), np.append(y, fresh[:, None], axis=1)
        order = np.argsort(points, axis=1)
        points, heights = np.take_along_axis(points, order, 1), np.take_along_axis(heights, order, 1)
        centre = np.clip(np.argmax(np.where(np.isnan(heights), -np.inf, heights), axis=1), 1, 2)
        around = centre[:, None] + np.array([-1, 0, 1])
        x, y = np.take_along_axis(points, around, 1), np.take_along_axis(heights, around, 1)
    return value, error, place


def _vertex(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The place of the maximum of the parabola through three points a row, kept between them; else the wider middle."""
    left, right = x[:, 1] - x[:, 0], x[:, 2] - x[:, 1]
    with np.errstate(all="ignore"):
        up, down = (y[:, 1] - y[:, 0]) / left, (y[:, 2] - y[:, 1]) / right
        vertex = (x[:, 0] + x[:, 1]) / 2 + up * (x[:, 2] - x[:, 0]) / 2 / (up - down)
    # Halving the cell beside the best point where a parabola knows nothing: the maximum is at an end, or values are not finite.
    upper = y[:, 2] > y[:, 0]
    halving = np.where(upper, (x[:, 1] + x[:, 2]) / 2, (x[:, 0] + x[:, 1]) / 2)
    inside = np.isfinite(vertex) & (vertex > x[:, 0]) & (vertex < x[:, 2]) & (up > down) & (vertex != x[:, 1])
    return np.where(inside, vertex, halving)


def _intervals(
    x: np.ndarray,
    value: np.ndarray,
    error: np.ndarray,
    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    xtol: float,
) -> tuple[tuple[float, float], ...]:
    """Where the albedo exceeds 1, as intervals of x whose ends are found to `xtol` between the samples."""

    def excess(place: float) -> float:
        value, _ = at(np.array([place]))
        return float(value[0]) - 1 - TOLERANCE

    from scipy.optimize import brentq

    def edge(i: int) -> float:
        ends = value[i : i + 2] - 1 - TOLERANCE
        crosses = np.all(np.isfinite(ends)) and ends[0] * ends[1] < 0
        root: Any = brentq  # its stub knows numpy scalars only
        return root(excess, x[i], x[i + 1], xtol=xtol, rtol=1e-12, maxiter=60, disp=False) if crosses else x[i + 1]

    with np.errstate(invalid="ignore"):  # where it grows without bound so does its error
        least = np.where(value == np.inf, np.inf, value - error)
    return tuple(stretches(x, least > 1 + TOLERANCE, edge))
