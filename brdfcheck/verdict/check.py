"""The answer to the question: does this BRDF conserve energy?"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy
import numpy as np

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import AbstractBRDF
from brdfcheck.brdf.callables import Finding, constant, name_of
from brdfcheck.brdf.factors import Normalized, PerCosine
from brdfcheck.brdf.family import Family, refusal
from brdfcheck.quadrature.albedo import refuse_batched
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.verdict.report import TOLERANCE as TOLERANCE
from brdfcheck.verdict.report import Report as Report
from brdfcheck.verdict.report import Verdict as Verdict
from brdfcheck.verdict.report import judge as judge
from brdfcheck.verdict.side_checks import SideChecks, Witness, side_checks
from brdfcheck.verdict.supremum import EFFORTS, Supremum, Watch, supremum

# What a parameter runs over when a class is given without ranges.
_USUAL_RANGES = {"n": (1.0, 1000.0), "m": (0.05, 1.0), "alpha": (0.05, 1.0)}


def as_family(target: Any, ranges: Mapping[str, tuple[float, float]], cos_theta: tuple[float, float] | None) -> Family:
    """What `check` accepts as a `Family`.

    A catalogue name, a `Family`, a BRDF, a function f(wi, wo), or a class or factory whose parameters run over `ranges`.
    Raises KeyError for an unknown name, TypeError for something that is not a BRDF, ValueError for bad ranges.
    """
    angles = (0.0, 1.0) if cos_theta is None else cos_theta
    if isinstance(target, str):
        target = catalog.entry(target).family
    if isinstance(target, Family):
        unknown = [name for name in ranges if name not in target.ranges]
        if unknown:
            known = ", ".join(target.ranges) or "none"
            raise ValueError(f"{target.name} has no parameter {unknown[0]!r}; its parameters: {known}")
        return Family(
            target.name,
            target.build,
            {**target.ranges, **ranges},
            target.cos_theta if cos_theta is None else cos_theta,
        )
    if not callable(target):
        raise TypeError(f"a BRDF must be callable, f(wi, wo), or a catalogue name; got {type(target).__name__}")
    if isinstance(target, AbstractBRDF):
        refuse_batched(target)
        if ranges:
            return Family(name_of(target), _varied(target, tuple(ranges)), ranges, angles)
        return Family(name_of(target), constant(target), {}, angles)
    names = _parameter_names(target)
    if ranges and names is not None and set(ranges) <= set(names[2:]) and _takes_directions(target, names[:2], ranges):

        def of_parameters(**parameters: Any) -> Callable[..., Any]:
            return lambda wi, wo: target(wi, wo, **parameters)

        of_parameters.__name__ = name_of(target)
        return Family(name_of(target), of_parameters, ranges, angles)
    if ranges and names is not None and _takes_directions(target, names) and not set(names) <= set(ranges):
        raise ValueError(
            f"{name_of(target)}({', '.join(names)}) is one BRDF: to let {next(iter(ranges))} run over a range, give a"
            " function of the parameter that returns a BRDF"
        )
    if not ranges and names is not None and not _takes_directions(target, names):
        ranges = {name: _USUAL_RANGES[name] for name in names if name in _USUAL_RANGES}
        if not ranges or not _required(target) <= set(ranges):
            raise ValueError(f"{name_of(target)} takes {', '.join(names) or 'no arguments'}: give the ranges to run over")
    if not ranges:
        return Family(name_of(target), constant(target), {}, angles)
    unknown = [name for name in ranges if names is not None and name not in names]
    if unknown:
        raise ValueError(f"{name_of(target)} has no parameter {unknown[0]!r}; it takes {', '.join(names or ())}")
    return Family(name_of(target), target, ranges, angles)


def _varied(brdf: AbstractBRDF, names: tuple[str, ...]) -> Callable[..., AbstractBRDF]:
    """One BRDF as a family: its parameters `names` replaced. ValueError where it has no such number."""

    def owner(brdf: Any) -> Any:
        return owner(brdf.lobe) if isinstance(brdf, Normalized) else owner(brdf.base) if isinstance(brdf, PerCosine) else brdf

    core = owner(brdf)
    for name in names:
        if not isinstance(getattr(core, name, None), jax.Array):
            known = [field for field in core.__dataclass_fields__ if isinstance(getattr(core, field), jax.Array)]
            raise ValueError(f"{name_of(core)} has no parameter {name!r}; its parameters: {', '.join(known) or 'none'}")

    def build(**values: Any) -> AbstractBRDF:
        # The lobe's own constructor would check the domain, but may not know all its fields by these names.
        for name, value in values.items():
            if not isinstance(value, jax.core.Tracer):
                if value < 0 or (name in ("m", "alpha") and value == 0):
                    raise ValueError(f"{name} must be {'> 0' if name in ('m', 'alpha') else '>= 0'}; got {value:g}")
                if name == "f0" and value > 1:
                    raise ValueError(f"f0 must be >= 0 and <= 1; got {value:g}")
        replaced = [jax.numpy.asarray(values[name]) for name in names]
        return eqx.tree_at(lambda tree: [getattr(owner(tree), name) for name in names], brdf, replaced)

    return build


def _parameter_names(target: Callable[..., Any]) -> list[str] | None:
    """Names of the arguments, or None where they cannot be known or are open-ended."""
    try:
        parameters = inspect.signature(target).parameters.values()
    except (TypeError, ValueError):
        return None
    if any(parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD) for parameter in parameters):
        return None
    return [parameter.name for parameter in parameters]


def _takes_directions(target: Callable[..., Any], names: list[str], given: Collection[str] = ()) -> bool:
    """True for f(wi, wo), whatever the two are called: two arguments that must be given and no usual parameter.

    `given`: further arguments that have values.
    """
    if inspect.isclass(target):
        return False
    directions = _required(target) - set(given)
    return directions == {"wi", "wo"} or (len(directions) == 2 and not directions & set(_USUAL_RANGES))


def _required(target: Callable[..., Any]) -> set[str]:
    """Names of the arguments that must be given."""
    parameters = inspect.signature(target).parameters.values()
    return {parameter.name for parameter in parameters if parameter.default is parameter.empty}


def check(
    target: Any,
    *,
    cos_theta: tuple[float, float] | None = None,
    tolerance: float = TOLERANCE,
    rtol: float | None = None,
    intervals: bool = True,
    effort: str = "normal",
    watch: Watch | None = None,
    **ranges: tuple[float, float],
) -> Report:
    """Does this BRDF, or every member of this family, conserve energy?

    `target`: a catalogue name, a BRDF, a function ``f(wi, wo)``, or a class or factory whose keyword parameters run over
    the given ranges, as in ``check(Phong, n=(1, 1000))``; a range of one value holds a parameter. The largest directional
    albedo over all parameters in the ranges and all cosines of incidence in `cos_theta` (by default [0, 1]; and all azimuths
    where the BRDF is anisotropic) is a continuous maximum with an error bar. `tolerance`: how far above 1 still conserves.
    `rtol`: the accuracy of the albedo, by default the best. `intervals`: find where a violating one-parameter family
    violates. `effort`: "quick", "normal" or "thorough", how many points the search looks at; the verdicts mean the same.
    `watch` is called with the number of points looked at and the largest albedo seen so far.

    Raises ValueError for bad ranges, KeyError for an unknown name, TypeError for something that is not a BRDF. A function
    that raises or returns nonsense is reported as a finding.
    """
    if not (isinstance(tolerance, (int, float)) and 0 <= tolerance < 1):
        raise ValueError(f"tolerance must be a number in [0, 1); got {tolerance!r}")
    if rtol is not None and not (isinstance(rtol, (int, float)) and 0 < rtol < 1):
        raise ValueError(f"rtol must be a number between 0 and 1; got {rtol!r}")
    if effort not in EFFORTS:
        raise ValueError(f"effort must be one of {', '.join(EFFORTS)}; got {effort!r}")
    family = as_family(target, ranges, cos_theta)
    refused = refusal(family)
    # A defect of a user's factory is a finding, not a wrong argument.
    if refused is not None and refused.ours and isinstance(refused.error, ValueError):
        raise refused.error
    return check_family(family, tolerance=tolerance, rtol=rtol, intervals=intervals, effort=effort, watch=watch)


def assert_conserves(brdf: Any, **options: Any) -> Report:
    """`check`, for tests: AssertionError where the BRDF does not pass, with verdict, albedo, place, error bar and findings.

    `brdf` and `options` are those of `check`, ranges of parameters included. Raises what `check` raises; returns its report.
    """
    report = check(brdf, **options)
    if not report.passed:
        raise AssertionError(str(report))
    return report


def check_family(
    family: Family,
    *,
    tolerance: float = TOLERANCE,
    rtol: float | None = None,
    intervals: bool = True,
    effort: str = "normal",
    watch: Watch | None = None,
) -> Report:
    """`check` for a `Family`."""
    start = time.perf_counter()
    findings: list[str] = []
    notes: list[str] = []
    worst: Supremum | None = None
    side: SideChecks | None = None
    albedo: PointwiseAlbedo | None = None
    try:
        albedo = PointwiseAlbedo(family)
        if albedo.engine == "adaptive (numpy)":
            notes.append("JAX cannot trace this function: evaluated with numpy, which is slower")
        if albedo.evaluator is not None:
            findings += _batches(albedo)
        worst = supremum(albedo, threshold=1 + tolerance, rtol=rtol, intervals=intervals, effort=effort, watch=watch)
        if albedo.anisotropic:
            notes.append("anisotropic: the maximum runs over the azimuth of incidence too")
        side = side_checks(albedo, worst.parameters)
    except Finding as finding:
        findings.append(str(finding))
    if side is not None:
        findings += _defects(side, tuple(family.ranges))
    # Where no value of the BRDF is a number, that has been said.
    if worst is not None and np.isnan(worst.value) and not (side is not None and np.isnan(side.minimum)):
        findings.append("the albedo is not a number where the BRDF is not finite")
    verdict = Verdict.UNDECIDED
    if worst is not None:
        verdict = judge(worst.value, worst.error, tolerance, least=worst.least, settled=worst.settled)
        if verdict is Verdict.CONSERVES and worst.value < -worst.error:
            verdict = Verdict.UNDECIDED  # nothing that is negative throughout conserves or violates anything
    if verdict is Verdict.UNDECIDED and worst is not None:
        if jax.numpy.zeros(0).dtype == np.float32:
            notes.append("computed in float32: call brdfcheck.use_x64() first for an error bar below 1e-9")
        if not worst.settled and np.isfinite(worst.value):
            notes.append("the search did not settle: narrow the ranges, or give it more effort")
    report = Report(
        name=family.name,
        verdict=verdict,
        albedo=np.nan,
        error=np.nan,
        parameters={},
        cos_theta=np.nan,
        azimuth=np.nan,
        tolerance=tolerance,
        ranges=dict(family.ranges),
        above=None,
        side=side,
        engine="none" if albedo is None else albedo.engine,
        anisotropic=albedo is not None and albedo.anisotropic,
        evaluations=0 if albedo is None else albedo.evaluations,
        seconds=time.perf_counter() - start,
        findings=tuple(findings),
        notes=tuple(notes),
        effort=effort,
    )
    if worst is None:
        return report
    return replace(
        report,
        albedo=worst.value,
        error=worst.error,
        parameters=worst.parameters,
        cos_theta=worst.cos_theta,
        azimuth=worst.azimuth,
        above=worst.above,
        basis=worst.basis,
        points=worst.points,
        climbs=worst.climbs,
        settled=worst.settled,
        width=worst.width,
        unbounded=worst.unbounded,
        channel=worst.channel,
        channels=worst.channels,
    )


def _batches(albedo: PointwiseAlbedo) -> list[str]:
    """What is wrong where directions given together are not what they are one by one; they are taken one by one then.

    Raises Finding where that is not possible.
    """
    evaluator = albedo.evaluator
    assert evaluator is not None
    middle = {name: 0.5 * low + 0.5 * high for name, (low, high) in albedo.family.ranges.items() if low < high}
    trouble = evaluator.disagreement(middle)
    if trouble is None:
        return []
    if not evaluator.evaluated_alone():
        raise Finding(trouble)
    return [f"{trouble}. The albedo is that of directions taken one by one"]


def _defects(side: SideChecks, names: tuple[str, ...]) -> list[str]:
    """The side checks that failed, in words, each with the place where it shows."""
    found = []
    if not side.reciprocal:
        text = f"not reciprocal: f(wi, wo) and f(wo, wi) differ by {side.reciprocity:.2g} of the larger"
        if side.unequal is not None:
            text += f": {side.unequal.value:.6g} and {side.unequal.swapped:.6g} / sr {_where(side.unequal, names)}"
        found.append(text)
    if not side.positive:
        found.append(f"negative: the smallest value seen is {side.minimum:.3g} / sr{_where(side.lowest, names, ' ')}")
    if side.nonfinite:
        what = "NaN everywhere" if np.isnan(side.minimum) else f"{side.nonfinite} of {side.pairs} values are NaN or Inf"
        kind = " " if np.isnan(side.minimum) else f", {side.broken.value} " if side.broken is not None else ""
        found.append(f"not finite: {what}{kind}{_where(side.broken, names)}")
    return found


def _where(witness: Witness | None, names: tuple[str, ...], before: str = "") -> str:
    if witness is None:
        return ""
    wi, wo = (f"({', '.join(f'{part:.6g}' for part in direction)})" for direction in (witness.wi, witness.wo))
    parameters = "".join(f"{name}={value:.6g}, " for name, value in zip(names, witness.parameters, strict=True))
    return f"{before}at {parameters}wi={wi}, wo={wo}"
