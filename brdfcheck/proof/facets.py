r"""Proofs without boxes: facets by the theorem on masked projected areas, and single points of BRDFs that break the law.

For Smith's masking of the distribution D, and for V-cavities with any symmetric D, the facets that are seen from wi have the
projected area $\int G_1(w_i)\, D(h)\, (w_i \cdot h)^+\, dh = N \cdot w_i$. With G <= G1, F <= 1 and the convention
$F D G / (4 (N \cdot L)(N \cdot V))$ the albedo is at most 1 for every parameter; `docs/proofs.md` has the proofs. Certificates
are made of a plain record of the BRDF, so that one is checked by making it again.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from brdfcheck.brdf.factors import Normalized, PerCosine, PhongExact
from brdfcheck.brdf.lobes import Phong
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.proof.certificate import CONSERVES, VIOLATES, Certificate, Ends, bound, document, over, range_record
from brdfcheck.proof.cover import NotProved, written
from brdfcheck.proof.intervals import lower, pi, sqrt

_MASKED = ("v-cavities", "smith-separable", "smith-correlated")
_FRESNELS = {"1": "F = 1", "dielectric": "Fresnel's F of a dielectric", "schlick": "Schlick's F"}
_PREMISES = [
    "convention F D G/(4 (N.L)(N.V))",
    "the masking G is at most G1, which makes the projected areas seen from each direction add up to its cosine",
    "0 <= F <= 1",
    "the distribution D is not negative, symmetric about N, and its projected area is at most 1",
]


def facets_of(brdf: Any) -> dict[str, Any] | None:
    """The plain record of facets of this package; None for anything else."""
    if type(brdf) not in (CookTorrance, GGX):
        return None
    held = isinstance(brdf.f0, (float, np.ndarray, jax.Array)) and not isinstance(brdf.f0, Tracer)
    if held and not np.all((np.asarray(brdf.f0) >= 0) & (np.asarray(brdf.f0) <= 1)):
        raise NotProved(f"the theorem on masked projected areas needs f0 in [0, 1]; the lobe holds {brdf.f0}")
    found = {
        "kind": "facets",
        "distribution": "GGX" if type(brdf) is GGX else "Beckmann",
        "convention": "correct",
        "masking": brdf.masking,
        "fresnel": "1" if brdf.f0 is None else brdf.fresnel,
        "weights": ["1"],
    }
    if type(brdf) is CookTorrance:
        if isinstance(brdf.weights, Tracer):
            raise NotProved("the theorem on masked projected areas needs weights that are numbers, with a sum of at most 1")
        weights = np.atleast_1d(np.asarray(brdf.weights))
        found |= {"convention": brdf.convention, "weights": [written(Fraction(str(weight))) for weight in weights]}
    return found


def point_of(brdf: Any) -> dict[str, Any] | None:
    """The plain record of a BRDF of which one point is known; None for anything else."""
    base = brdf.base if type(brdf) is PerCosine else None
    if type(base) is Normalized and type(base.lobe) is Phong and type(base.factor) is PhongExact:
        return {"kind": "phong without cosine"}
    return None


def certificate(lobe: Mapping[str, Any], ranges: Mapping[str, Ends], cosine: Fraction) -> Certificate:
    """The certificate of facets, or of a BRDF with a known point, from its record.

    `ranges`: of the parameters; `cosine`: the smallest cosine of incidence asked about. NotProved where a premise fails and no
    point is known at which the law is broken.
    """
    if lobe["kind"] != "facets":
        return _point(lobe, ranges, *_POINTS[lobe["kind"]](ranges, cosine))
    for name, (low, high) in ranges.items():
        if name not in ("m", "alpha", "f0"):
            raise NotProved(f"the theorem on masked projected areas is for ranges of m, alpha and f0; got {name}")
        good = low >= 0 and high is not None and high <= 1 if name == "f0" else low > 0
        if not good:
            raise NotProved(f"{name} must be {'from 0 to 1' if name == 'f0' else '> 0'}; got {written(low)} to {bound(high)}")
    weights = sum(map(Fraction, lobe["weights"]), Fraction(0))
    wrong = {
        "the convention is not F D G/(4 (N.L)(N.V))": lobe["convention"] != "correct",
        "the distribution is not one of those that are proved normalised": lobe["distribution"] not in ("Beckmann", "GGX"),
        "there is no masking": lobe["masking"] not in _MASKED,
        "the weights of the slopes add up to more than 1": weights > 1
        or any(Fraction(weight) < 0 for weight in lobe["weights"]),
        "Smith's masking belongs to one slope": lobe["masking"] != "v-cavities" and len(lobe["weights"]) > 1,
    }
    failed = [words for words, fails in wrong.items() if fails]
    if not failed:
        return document(
            CONSERVES,
            f"The directional albedo of {_facets(lobe)} is at most 1 for {over(ranges)} at every angle of incidence.",
            formula=_facets(lobe),
            lobe=dict(lobe),
            range=range_record(ranges),
            theorems=["masked projected areas"],
            premises=list(_PREMISES),
        )
    plain = (lobe["distribution"], lobe["fresnel"], lobe["weights"]) == ("Beckmann", "1", ["1"])
    known = {("published", "v-cavities"): _published, ("correct", "none"): _unmasked}.get((lobe["convention"], lobe["masking"]))
    if not plain or known is None or tuple(ranges) != ("m",):
        raise NotProved(f"the theorem on masked projected areas does not apply: {'; '.join(failed)}")
    return _point(lobe, ranges, *known(ranges, cosine))


def _facets(lobe: Mapping[str, Any]) -> str:
    """The facets in words."""
    published = lobe["convention"] == "published"
    form = "F D G/(pi (N.L)(N.V)), D without its 1/pi" if published else "F D G/(4 (N.L)(N.V))"
    slopes = "" if lobe["weights"] == ["1"] else f" in parts of {', '.join(lobe['weights'])}"
    masking = "no masking" if lobe["masking"] == "none" else f"masking {lobe['masking']}"
    return f"{form} with {lobe['distribution']}'s D{slopes}, {masking} and {_FRESNELS[lobe['fresnel']]}"


def _point(
    lobe: Mapping[str, Any], ranges: Mapping[str, Ends], place: Mapping[str, Fraction], least: Fraction, why: str
) -> Certificate:
    """The certificate of a BRDF that exceeds 1 at one point; NotProved where it is not in the ranges."""
    for name, (low, high) in ranges.items():
        if not low <= place[name] or (high is not None and place[name] > high):
            raise NotProved(f"the point above 1 that is known, {name} = {written(place[name])}, is out of range")
    brdf = _facets(lobe) if lobe["kind"] == "facets" else "(n + 2)/(2 pi) (R.V)^n/(N.L)"
    spots = " and ".join(f"{'cos(theta)' if name == 'cos_theta' else name} = {written(value)}" for name, value in place.items())
    return document(
        VIOLATES,
        f"The directional albedo of {brdf} is at least {written(least)} for {spots}.",
        formula=brdf,
        lobe=dict(lobe),
        range=range_record(ranges),
        theorems=[why],
        point={**{name: written(value) for name, value in place.items()}, "albedo at least": written(least)},
    )


def _within(ends: Ends, most: Fraction) -> Fraction:
    return most if ends[1] is None or ends[1] > most else ends[1]


def _rounded(value: Fraction) -> Fraction:
    """A decimal number of 12 places at or below it. NotProved where that is not above 1."""
    found = value * 10**12 // 1 / Fraction(10**12)
    if found <= 1:
        raise NotProved("no point above 1 is known in these ranges")
    return found


def _published(ranges: Mapping[str, Ends], cosine: Fraction) -> tuple[dict[str, Fraction], Fraction, str]:
    # Along the normal no facet within 30 degrees is masked, and these have the part 1 - exp(-1/(3 m^2)) of the projected area.
    m = ranges["m"][0]
    x = 1 / (3 * m * m)
    return {"m": m, "cos_theta": Fraction(1)}, _rounded(4 * (1 - 1 / (1 + x + x * x / 2))), "unmasked facets"


def _unmasked(ranges: Mapping[str, Ends], cosine: Fraction) -> tuple[dict[str, Fraction], Fraction, str]:
    # Of the slopes towards the light those of less than m <= 1 alone reflect (4 m/(15 pi)) tan(theta), all above the horizon.
    m, cosine = _within(ranges["m"], Fraction(1)), max(cosine, Fraction(1, 50))
    least = lower(sqrt(1 / cosine**2 - 1) * (4 * m / 15) / pi())
    return {"m": m, "cos_theta": cosine}, _rounded(least), "unmasked facets"


def _phong(ranges: Mapping[str, Ends], cosine: Fraction) -> tuple[dict[str, Fraction], Fraction, str]:
    # For n = 2 the albedo of the lobe with its factor is (1 + cos)^2/4.
    mu = max(cosine, Fraction(1, 2))
    return {"n": Fraction(2), "cos_theta": mu}, _rounded((1 + mu) ** 2 / (4 * mu)), "square of the cosine"


_POINTS = {"phong without cosine": _phong}
