"""From whatever names a BRDF to a certificate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.subject import as_target
from brdfcheck.brdf.two_sides import BELOW
from brdfcheck.messages import UsageError
from brdfcheck.proof import facets, mixtures, surfaces
from brdfcheck.proof.certificate import Certificate, Ends, of_lobe, reciprocal
from brdfcheck.proof.cover import ABOVE, MOST_BOXES, Claim, LinearFactor, NotProved, cover, peak, written
from brdfcheck.proof.facets import facets_of, point_of
from brdfcheck.proof.lobes import Profile
from brdfcheck.proof.reading import Unknown, built, exact, lobe_of

_FIRST_PART = 1000


def certify(
    target: Any,
    *,
    seconds: float = 60.0,
    cos_theta: tuple[float, float] | None = None,
    reading: Reading | None = None,
    **ranges: Any,
) -> Certificate:
    """A proof that a BRDF, or every member of a family, conserves energy; or that it does not.

    `target` as for `brdfcheck.check`: a catalogue name, ``file.py:object``, a shader file, a family, a BRDF, a class,
    a function. Lobes and facets of this package are proved by theorems, in exact arithmetic; for any other function that JAX
    can trace boxes are searched for, for about so many `seconds` (0: not at all), in interval arithmetic. `ranges`: closed
    intervals of its parameters, ``n=(1, 1000)``; of lobes the upper end may be infinite, ``n=(0, math.inf)``. `cos_theta`:
    the cosines of incidence, by default 0 to 1. `reading`: how a file is read (see `brdfcheck.load`). Numbers are the
    decimals that they are written as.

    Raises UsageError (a ValueError) for unknown names, bad ranges, what is neither a formula that the theorems know nor a
    function that JAX can trace, and for operations that are not covered, which are named; NotProved (a ValueError) where there
    is neither a proof nor a counterexample, with the bound that is proved, or where a theorem's premise fails.
    """
    return certificate_of(target, ranges, seconds, cos_theta, reading)


def certificate_of(
    target: Any,
    ranges: Mapping[str, Any],
    seconds: float,
    cos_theta: tuple[float, float] | None = None,
    reading: Reading | None = None,
) -> Certificate:
    """`certify`, with the `ranges` together: a parameter may be called like an argument of that. Raises what it raises."""
    if not (isinstance(seconds, (int, float)) and 0 <= seconds < math.inf):
        raise UsageError(f"seconds must be a number >= 0; got {seconds!r}")
    finite = {name: _finite(name, bounds) for name, bounds in ranges.items()}
    subject = as_target(target, finite, cos_theta, reading)
    if subject.finding is not None:
        raise UsageError(subject.finding)
    try:
        return certify_family(subject.family, {name: bounds for name, bounds in ranges.items() if name in finite})
    except Unknown:
        if seconds == 0:
            raise
    unbounded = [name for name, bounds in ranges.items() if finite[name] is not bounds]
    if unbounded:
        raise UsageError(f"{subject.family.name}: for a proof of a function the range of {unbounded[0]} must be finite")
    from brdfcheck.proof import functions  # which takes a while, and theorems do without

    return functions.certificate(subject.family, seconds)


def _finite(name: str, bounds: Any) -> Any:
    """The bounds, with a finite upper end in place of an infinite one."""
    try:
        low, high = bounds
        unbounded = high == math.inf
    except (TypeError, ValueError):
        return bounds  # whoever reads ranges says what is wrong
    return (low, low) if unbounded else bounds


def certify_family(family: Family, ranges: Mapping[str, Any] | None = None, *, most: int = MOST_BOXES) -> Certificate:
    """`certify` by theorems for a `Family`; `ranges` in place of its own, at `most` so many boxes.

    Raises Unknown for what is no formula of the theorems.
    """
    ends: dict[str, Ends] = {}
    for name, (low, high) in family.ranges.items():
        low, high = (ranges or {}).get(name, (low, high))
        ends[name] = exact(low, name), None if high == math.inf else exact(high, name)
    if family.surface is not None:
        return surfaces.certificate(surfaces.record_of(family), {name: pair for name, pair in ends.items() if name != BELOW})
    try:
        whole = mixtures.certificate(family, ends, lambda part: certify_family(part, ranges, most=most))
    except NotProved as error:  # boxes may tell
        raise Unknown(f"{family.name}: {error}") from None
    if whole is not None:
        return whole
    brdf = built(family)
    known = facets_of(brdf) or point_of(brdf)
    if known is not None:
        if not ends and known["kind"] != "facets":
            n = exact(brdf.core.n, "n")
            ends["n"] = n, n
        found = facets.certificate(known, ends, exact(family.cos_theta[0], "cos_theta"))
        if not found and Fraction(found.record["point"]["cos_theta"]) > exact(family.cos_theta[1], "cos_theta"):
            raise NotProved("the point above 1 that is known is at an incidence that the range of cos_theta leaves out")
        return found
    if len(ends) > 1:
        raise Unknown(f"{family.name}: one parameter may run over a range; got {', '.join(ends)}")
    parameter = next(iter(ends), None) or ("n" if hasattr(brdf.core, "n") else "reflectance")
    profile, factor = lobe_of(brdf, family.name)
    if not ends:
        values = np.asarray(getattr(brdf.core, parameter))  # of several channels from the least to the largest
        ends[parameter] = exact(values.min(), parameter), exact(values.max(), parameter)
    return _lobe(profile, factor, parameter, ends[parameter], normal=family.cos_theta[1] == 1, most=most)


def _lobe(profile: Profile, factor: LinearFactor | None, parameter: str, ends: Ends, *, normal: bool, most: int) -> Certificate:
    """The certificate of a lobe. `normal`: normal incidence is one of the angles asked about."""
    low, high = ends
    if low < 0:
        raise UsageError(f"{parameter} must be >= 0; got {written(low)}")
    rises = None
    if profile.falls_until() < (math.inf if high is None else high):
        rises = NotProved(
            f"the theorem on normal incidence does not apply: {profile.formula} rises with its angle past its first zero"
            f" for n > {profile.falls_until():g}"
        )
    if factor is None:
        if rises:
            raise rises
        return reciprocal(profile, parameter, ends)
    claim = Claim(profile, factor)
    try:
        pieces = cover(claim, low, high, most)
    except NotProved:
        # For a violation a part of an unbounded range is enough.
        pieces = cover(claim, low, max(2 * low, Fraction(_FIRST_PART)), most) if high is None else []
        if not any(piece.side == ABOVE for piece in pieces):
            raise
    if any(piece.side == ABOVE for piece in pieces):
        if not normal:
            raise NotProved("it exceeds 1 at normal incidence, which the range of cos_theta leaves out")
        return of_lobe(claim, parameter, ends, pieces, peak(claim, pieces))
    if rises:
        raise rises
    return of_lobe(claim, parameter, ends, pieces)
