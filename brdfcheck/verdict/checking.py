"""The answer to the question: does this BRDF conserve energy?"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import jax
import jax.core
import jax.numpy
import numpy as np

from brdfcheck.brdf.blame import Finding
from brdfcheck.brdf.family import Family, examples
from brdfcheck.brdf.subject import as_target
from brdfcheck.messages import UsageError
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.verdict.checks import CHECKS, TOLD, Evidence
from brdfcheck.verdict.measured import doubted, searched
from brdfcheck.verdict.parts import Check, Doubt
from brdfcheck.verdict.precision import is_single, rounding
from brdfcheck.verdict.report import TOLERANCE, Report, Verdict, judge, reported
from brdfcheck.verdict.supremum import EFFORTS, Supremum, affordable, supremum
from brdfcheck.verdict.surface import Watch

_log = logging.getLogger("brdfcheck")

# By how much a quick estimate is above a line where the albedo surely is.
_FAR = 0.01
# A proof of so many boxes takes 0.2 s at most.
_BOXES = 100


def check(
    target: Any,
    *,
    cos_theta: tuple[float, float] | None = None,
    tolerance: float | None = None,
    rtol: float | None = None,
    intervals: bool = True,
    effort: str = "normal",
    watch: Watch | None = None,
    **ranges: tuple[float, float],
) -> Report:
    """Does this BRDF, or every member of this family, conserve energy?

    `target`: a catalogue name, ``file.py:object``, a BRDF, a function ``f(wi, wo)``, or a function with more parameters, a
    class or a factory whose keyword parameters run over the given ranges, as in ``check(Phong, n=(1, 1000))``; a range of one
    value holds a parameter. The largest directional albedo over all parameters in the ranges and all cosines of incidence in
    `cos_theta` (by default [0, 1]; and all azimuths where the BRDF is anisotropic) is a continuous maximum with an error bar.
    `tolerance`: how far above 1 still conserves, by default 1e-9, for plug-ins that compute in single precision 1e-5.
    `rtol`: the accuracy of the albedo, by default the best. `intervals`: find where a violating one-parameter family
    violates. `effort`: "quick", "normal" or "thorough", how many points the search looks at; the verdicts mean the same.
    `watch` is called with the number of points looked at and the largest albedo seen so far.

    Raises ValueError for bad ranges and for unknown names (which are a KeyError, too), TypeError for something that is not a
    BRDF. A function that raises or returns nonsense is reported as a finding.
    """
    __tracebackhide__ = True
    if tolerance is not None and not (isinstance(tolerance, (int, float)) and 0 <= tolerance < 1):
        raise ValueError(f"tolerance must be a number in [0, 1); got {tolerance!r}")
    if rtol is not None and not (isinstance(rtol, (int, float)) and 0 < rtol < 1):
        raise ValueError(f"rtol must be a number between 0 and 1; got {rtol!r}")
    if effort not in EFFORTS:
        raise ValueError(f"effort must be one of {', '.join(EFFORTS)}; got {effort!r}")
    subject = as_target(target, ranges, cos_theta)
    limit = subject.family.tolerance if tolerance is None else tolerance
    if subject.finding is not None:
        return unusable(subject.family, subject.finding, tolerance=limit, effort=effort)
    return check_family(subject.family, tolerance=limit, rtol=rtol, intervals=intervals, effort=effort, watch=watch)


def assert_conserves(brdf: Any, **options: Any) -> Report:
    """`check`, for tests: AssertionError where the BRDF does not pass, with verdict, albedo, place, error bar and findings.

    `brdf` and `options` are those of `check`, ranges of parameters included. Raises what `check` raises; returns its report.
    """
    __tracebackhide__ = True
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
    """`check` for a `Family`: `tolerance`, `rtol`, `intervals`, `effort` and `watch` are those of `check`. It raises nothing
    for what the family's own code does: that is a finding.
    """
    start = time.perf_counter()
    findings: list[str] = []
    notes = list(family.notes)
    worst: Supremum | None = None
    evidence: Evidence | None = None
    checks: list[Check] = []
    albedo: PointwiseAlbedo | None = None
    doubt: Doubt | None = None
    # What is proved of the family: False before that is asked.
    proof: Verdict | Literal[False] | None = False
    try:
        albedo = PointwiseAlbedo(family)
        provable = albedo.evaluator is None and not albedo.one_of_many and tolerance >= 0
        if provable and (albedo.bounded or not _far_above(albedo, 1 + tolerance)):
            proof = _proof(family)
            albedo.proved = proof is Verdict.CONSERVES
        if albedo.evaluator is not None:
            # What reads a family says itself how it is evaluated.
            notes += [albedo.evaluator.note] if albedo.evaluator.note and not family.notes else []
            if effort != (effort := affordable(effort, albedo)):
                notes.append(f"the search made the effort {effort!r}, for a call for each pair is slow")
            findings += _batches(albedo)
        every = albedo.evaluator.channels if albedo.evaluator is not None else None
        albedo, channels = searched(albedo)
        engine = albedo.engine
        worst = supremum(albedo, threshold=1 + tolerance, rtol=rtol, intervals=intervals, effort=effort, watch=watch)
        if albedo.engine is not engine:  # what was met late
            notes += [albedo.evaluator.note] if albedo.evaluator and albedo.evaluator.note else []
        if albedo.anisotropic:
            notes.append("anisotropic: the maximum runs over the azimuth of incidence too")
        if is_single(albedo) and np.isfinite(worst.value):
            noise = rounding(albedo, worst.parameters, worst.cos_theta, worst.azimuth)
            basis = "single precision" if worst.basis == "search" else worst.basis
            worst = replace(worst, error=worst.error + noise, least=worst.least - noise, basis=basis)
        if albedo.table is not None:
            worst, doubt = doubted(albedo, albedo.table, worst)
            findings += doubt.findings
            notes += doubt.notes
        if worst.channel is not None and every is not None and len(channels) < every:
            worst = replace(worst, channel=channels[worst.channel], channels=every)
            notes.append(f"of {every} channels the {len(channels)} that reflect most were searched")
        evidence = Evidence(albedo, worst.parameters, worst.cos_theta, worst.azimuth)
        checks = [found for made in CHECKS.values() if (found := made(evidence)) is not None]
        notes += [found.words for found in checks if found.name in TOLD]
    except Finding as finding:
        _log.debug("%s", family.name, exc_info=True)
        findings.append(str(finding))
    findings += [found.words for found in checks if not found.passed]
    side = evidence.side if evidence is not None and checks else None
    # Where no value of the BRDF is a number, that has been said.
    if worst is not None and np.isnan(worst.value) and not (side is not None and np.isnan(side.minimum)):
        findings.append("the albedo is not a number where the BRDF is not finite")
    verdict = Verdict.UNDECIDED
    if worst is not None:
        error = worst.error if doubt is None else max(worst.error, doubt.most - worst.value)
        verdict = judge(worst.value, error, tolerance, least=worst.least, settled=worst.settled)
        if verdict is Verdict.CONSERVES and worst.value < -worst.error:
            verdict = Verdict.UNDECIDED  # nothing that is negative throughout conserves or violates anything
        elif tolerance >= 0 and albedo is not None and albedo.evaluator is None:
            # Of what is above 1, or not: a proof says nothing about a lower line. For a violation one point is enough.
            of_one = _proof(family, worst.parameters) if verdict is Verdict.VIOLATES and not proof else None
            proof = of_one or (_proof(family) if proof is False else proof)
            if verdict is Verdict.VIOLATES and proof is Verdict.VIOLATES:
                worst = replace(worst, basis="proof")
            elif verdict is not Verdict.VIOLATES and np.isfinite(worst.value) and proof is Verdict.CONSERVES:
                verdict, worst = proof, replace(worst, basis="proof")
    if verdict is Verdict.UNDECIDED and worst is not None:
        if jax.numpy.zeros(0).dtype == np.float32:
            notes.append("computed in float32: call brdfcheck.use_x64() first for an error bar below 1e-9")
        if not worst.settled and np.isfinite(worst.value):
            notes.append("the search did not settle: narrow the ranges, or give it more effort")
    return reported(
        family,
        verdict,
        worst,
        albedo,
        side=side,
        doubt=doubt,
        checks=tuple(checks),
        findings=tuple(findings),
        notes=tuple(notes),
        tolerance=tolerance,
        effort=effort,
        seconds=time.perf_counter() - start,
    )


def _far_above(albedo: PointwiseAlbedo, line: float) -> bool:
    """True where a few members of a family are so far above a line that no proof of the contrary need be tried."""
    places = np.array(examples(list(albedo.family.ranges.values())))
    low, high = albedo.family.cos_theta
    cosines = np.repeat([high, (low + high) / 2, low + (high - low) / 20], len(places))
    with np.errstate(all="ignore"):
        value, _ = albedo.estimate(np.tile(places, (3, 1)), cosines, np.zeros(len(cosines)), 0)
    return bool(np.any(value > line + _FAR))


def _proof(family: Family, place: Mapping[str, float] | None = None) -> Verdict | None:
    """What is proved of the family, or of its member at `place`, in little time.

    None where nothing is, or it is none of the formulas that proofs know.
    """
    from brdfcheck.proof.certify import certify_family  # a quarter of a second, which functions do without
    from brdfcheck.proof.cover import NotProved

    try:
        ranges = {name: (value, value) for name, value in (place or {}).items() if name in family.ranges}
        return Verdict[certify_family(family, ranges, most=_BOXES).verdict]
    except (NotProved, UsageError):
        return None


def unusable(
    family: Family, finding: str, *, tolerance: float = TOLERANCE, effort: str = "normal", seconds: float = 0.0
) -> Report:
    """The report on a family that cannot be evaluated: undecided, and `finding` says why."""
    findings = (finding,)
    return reported(family, Verdict.UNDECIDED, findings=findings, tolerance=tolerance, effort=effort, seconds=seconds)


def _batches(albedo: PointwiseAlbedo) -> list[str]:
    """What is wrong where directions given together are not what they are one by one; they are taken one by one then.

    Raises Finding where that is not possible.
    """
    evaluator = albedo.evaluator
    assert evaluator is not None
    places = examples([albedo.family.ranges[name] for name in albedo.swept])
    trouble = evaluator.disagreement(*(dict(zip(albedo.swept, place, strict=True)) for place in places))
    if trouble is None:
        return []
    if not evaluator.evaluated_alone():
        raise Finding(trouble)
    return [f"{trouble}. The albedo is that of directions taken one by one"]
