"""The checks beside the albedo: a function for each, which says what it measured, whether that passes, and both in words.

A new check is a function and its row in `CHECKS`; text, JSON and JUnit show it without being touched. What computes is imported
where it is used: configurations read the names of checks without it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

from brdfcheck.verdict.parts import Check, SideChecks, Witness

if TYPE_CHECKING:
    from brdfcheck.quadrature.pointwise import PointwiseAlbedo


class Evidence:
    """What checks look at: the albedo of a family, where it is largest, and values at pairs of directions."""

    def __init__(self, albedo: PointwiseAlbedo, parameters: Mapping[str, float], cos_theta: float = 1.0, azimuth: float = 0.0):
        self.albedo, self.parameters, self.cos_theta, self.azimuth = albedo, dict(parameters), cos_theta, azimuth

    @cached_property
    def side(self) -> SideChecks:
        """The BRDF at pairs of directions and at all that the search saw; made once for all checks."""
        from brdfcheck.verdict.side_checks import side_checks

        return side_checks(self.albedo, self.parameters)

    def where(self, witness: Witness | None) -> str:
        """The place of a witness in words; nothing where there is none."""
        if witness is None:
            return ""
        wi, wo = (f"({', '.join(f'{part + 0.0:.6g}' for part in direction)})" for direction in (witness.wi, witness.wo))
        pairs = zip(self.albedo.family.ranges, witness.parameters, strict=True)
        folded = " (what is transmitted is folded up)" if witness.folded else ""
        return f" at {''.join(f'{name}={value:.6g}, ' for name, value in pairs)}wi={wi}, wo={wo}{folded}"


def _reciprocal(evidence: Evidence) -> Check:
    side = evidence.side
    ours, theirs = "f(wi, wo)", "f(wo, wi)"
    if evidence.albedo.family.surface is not None:
        ours, theirs = "f(wi, wo) / eta_o^2", "f(wo, wi) / eta_i^2"
    words = f"reciprocal: {ours} and {theirs} differ by {side.reciprocity:.2g} of the larger"
    words = words if side.reciprocal else f"not {words}"
    if not side.reciprocal and side.unequal is not None:
        values = f"{side.unequal.value:.6g} and {side.unequal.swapped:.6g} / sr"
        words += f": {values}{evidence.where(side.unequal)}"
    if side.cosine:
        say = '--returns "brdf*cos", in Python brdfcheck.load(..., returns="brdf*cos")'
        also = f"or say {say}"
        if side.cosine == "wo":
            also = f"or, where wo is the light, call the arguments (view, light) and say {say}"
        words += (
            f" (divided by the cosine of {side.cosine} it is: return the BRDF alone, without the cosine of the rendering"
            f" equation, {also})"
        )
    return Check("reciprocal", side.reciprocity, side.reciprocal, words)


def _positive(evidence: Evidence) -> Check:
    side = evidence.side
    words = f"the smallest value seen is {side.minimum:.3g} / sr"
    if not side.positive:
        words = f"negative: {words}{evidence.where(side.lowest)}"
    return Check("positive", side.minimum, side.positive, words)


def _finite(evidence: Evidence) -> Check:
    side = evidence.side
    if not side.nonfinite:
        return Check("finite", 0, True, f"finite at {side.pairs} values")
    what = "NaN everywhere" if math.isnan(side.minimum) else f"{side.nonfinite} of {side.pairs} values are NaN or Inf"
    kind = f", {side.broken.value}" if side.broken is not None and not math.isnan(side.minimum) else ""
    return Check("finite", side.nonfinite, False, f"not finite: {what}{kind}{evidence.where(side.broken)}")


def _pdf(evidence: Evidence) -> Check | None:
    """The density of samples integrates to at most 1, and to nothing below the surface of what is opaque."""
    from brdfcheck.verdict import sampling_checks as sampling

    albedo = evidence.albedo
    if sampling.sampler_of(albedo, evidence.parameters) is None:
        return None
    worst = (-1.0, "", 0.0, 0.0, True)
    for place in sampling.places(albedo, evidence.parameters):
        brdf = sampling.sampler_of(albedo, place)
        for cosine in sampling.COSINES:
            above, below, error = sampling.density_integrals(brdf, cosine)
            leak = 0.0 if brdf.transmits else below  # pyright: ignore[reportOptionalMemberAccess]
            excess = max(above + below - 1, leak) - error
            shown = "".join(f"{name}={value:.6g}, " for name, value in place.items())
            if not excess <= worst[0]:
                worst = (excess, f"{shown}cosine {cosine:g}", above, below, excess <= sampling.PDF_LIMIT)
    _, where, above, below, passed = worst
    words = f"the integral of pdf is {above + below:.6g} at {where}: {above:.6g} above the surface and {below:.6g} below"
    return Check("pdf", above + below, passed, words if passed else f"pdf is no density: {words}")


def _weight(evidence: Evidence) -> Check | None:
    """The weight of a sample is f |cos| over its density."""
    from brdfcheck.verdict import sampling_checks as sampling

    albedo = evidence.albedo
    if sampling.sampler_of(albedo, evidence.parameters) is None:
        return None
    gap, where = 0.0, ""
    for place in sampling.places(albedo, evidence.parameters):
        for cosine in sampling.COSINES:
            found = sampling.weight_gap(sampling.sampler_of(albedo, place), cosine)
            if not found <= gap:
                shown = "".join(f"{name}={value:.6g}, " for name, value in place.items())
                gap, where = found, f" at {shown}cosine {cosine:g}"
    passed = gap <= sampling.WEIGHT_LIMIT
    words = f"the weight of samples and eval / pdf differ by {gap:.2g} in the median{where}"
    return Check("weight", gap, passed, words)


def _sides(evidence: Evidence) -> Check | None:
    """What is reflected and transmitted of light from either side: told, not judged, for the albedo holds it."""
    from brdfcheck.verdict import sampling_checks as sampling

    albedo, brdf = evidence.albedo, sampling.sampler_of(evidence.albedo, evidence.parameters)
    if albedo.family.surface is not None:
        found, passing = sampling.shares(albedo, evidence.parameters, evidence.cos_theta, evidence.azimuth), "T"
    elif brdf is not None and brdf.transmits:
        found, passing = sampling.sides(albedo, evidence.parameters, evidence.cos_theta), "(eta_t/eta_i)^2 T"
    else:
        return None
    parts = [f"{side}: R = {reflected:.5f}, {passing} = {through:.5f}" for side, reflected, through in found]
    most = max(reflected + through for _, reflected, through in found)
    return Check("sides", most, True, f"light {'; '.join(parts)} at cosine {evidence.cos_theta:.4g}")


CHECKS: dict[str, Callable[[Evidence], Check | None]] = {
    "reciprocal": _reciprocal,
    "positive": _positive,
    "finite": _finite,
    "pdf": _pdf,
    "weight": _weight,
    "sides": _sides,
}
"""By name, in the order in which reports tell them. None: it has no meaning for this BRDF."""
TOLD = ("sides",)
"""Those whose words are a note of the report, though they passed."""
