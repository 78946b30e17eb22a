"""What a plug-in that samples owes besides its BRDF: a density that is one, and weights that are f |cos| over the density."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family, corners
from brdfcheck.brdf.two_sides import BELOW, sides_of
from brdfcheck.numerics import unit_vectors
from brdfcheck.quadrature.albedo import albedo as integrated
from brdfcheck.quadrature.functions import adaptive_albedo
from brdfcheck.quadrature.pointwise import PointwiseAlbedo

# At how many corners of the box, besides the worst place, and at which cosines of incidence.
_CORNERS = 4
COSINES = (1.0, 0.8, 0.3, 0.05)
# The accuracy of the integrals, and how far above 1 they may lie: fits and tables in plug-ins are good to that.
_ACCURACY = 1e-4
PDF_LIMIT = 1e-3
# Samples at each place, and by what share weight x density may differ from f |cos| in single precision: their median, which
# rounding in a few sharp places leaves alone.
_SAMPLES = 256
WEIGHT_LIMIT = 1e-3
_DOWN = np.array([1.0, 1.0, -1.0])
# The lowest cosine at which R and T are told apart, and the accuracy of a BSDF's.
_NEAR_GRAZING, _SHARES = 1e-3, 1e-6


def sampler_of(albedo: PointwiseAlbedo, parameters: Mapping[str, float]) -> Any | None:
    """The BRDF for these parameters where it can be sampled (it has `density` and `samples`), else None."""
    if albedo.evaluator is None or not albedo.evaluator.slow:
        return None
    brdf = albedo.family.build(**parameters)
    return brdf if hasattr(brdf, "density") and hasattr(brdf, "samples") else None


def places(albedo: PointwiseAlbedo, worst: Mapping[str, float]) -> list[dict[str, float]]:
    """Where samplers are looked at: the worst place and some corners of the box."""
    ranges = albedo.family.ranges
    found = [tuple(worst[name] for name in ranges), *corners(ranges.values(), max(_CORNERS, 2))]
    return [dict(zip(ranges, values, strict=True)) for values in dict.fromkeys(found)]


def density_integrals(brdf: Any, cosine: float) -> tuple[float, float, float]:
    """The integral of the density above the surface, the one below, and the error bar of their sum."""

    def half(side: np.ndarray) -> tuple[float, float]:
        def over_cosine(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            return (brdf.density(wi, wo * side) / wo[:, 2]).astype(np.float32)

        found = adaptive_albedo(over_cosine, cosine, 0.0, _ACCURACY, slow=True, max_evaluations=200_000)
        return float(found.value), float(found.error)

    (above, first), (below, second) = half(np.ones(3)), half(_DOWN)
    return above, below, first + second


def weight_gap(brdf: Any, cosine: float) -> float:
    """The median of |weight x density - f |cos|| over samples, as a share of f |cos|; 0 where nothing is sampled."""
    numbers = np.random.default_rng(17).uniform(0, 1, (_SAMPLES, 3))
    out, weight, density, flux = brdf.samples(np.tile(unit_vectors(cosine), (_SAMPLES, 1)), numbers)
    with np.errstate(all="ignore"):
        scale = np.max(np.abs(flux), axis=1)
        gap = np.max(np.abs(weight * density[:, None] - flux), axis=1) / np.maximum(scale, 1e-30)
        told = (density > 0) & np.any(weight > 0, axis=1) & np.isfinite(out).all(axis=1)
    return float(np.median(gap[told])) if np.any(told) else 0.0


def shares(
    albedo: PointwiseAlbedo, parameters: Mapping[str, float], cosine: float, azimuth: float
) -> list[tuple[str, float, float]]:
    """What a BSDF reflects and transmits of light from above and from below: (which, R, T) of the channel with most.

    Only the sides that the family looks at.
    """
    family, found = albedo.family, []
    for below in sides_of(family):
        numbers = {**parameters, BELOW: below} if BELOW in family.ranges else dict(parameters)
        assert family.surface is not None
        surface = family.surface(**numbers)
        mu = max(cosine, _NEAR_GRAZING)
        part = surface.lit(below, "reflected")
        # By programs that the search has compiled; one for what is transmitted would be another.
        if albedo.fast:
            of_part = PointwiseAlbedo(Family(family.name, lambda part=part: part))
            reflected, _ = of_part.channels(np.zeros((1, 0)), np.array([mu]), np.array([azimuth]))
        else:
            reflected = integrated(part, mu, azimuth=azimuth, rtol=_SHARES).value
        place = np.array([[numbers[name] for name in albedo.names]]), np.array([mu]), np.array([azimuth])
        both, _ = albedo.channels(*place, rtol=None if albedo.fast else _SHARES)
        reflected, both = np.ravel(reflected), np.ravel(both)
        passing, channel = np.maximum(both - reflected, 0), int(np.argmax(both))
        found.append(("from below" if below else "from above", float(reflected[channel]), float(passing[channel])))
    return found


def sides(albedo: PointwiseAlbedo, parameters: Mapping[str, float], cosine: float) -> list[tuple[str, float, float]]:
    """What a plug-in that transmits does with light from above and from below: (which, R, (eta_t / eta_i)^2 T) of each.

    Of the channel that reflects and transmits most. Only the sides that the family looks at.
    """
    family, found = albedo.family, []
    wi = unit_vectors(max(cosine, _NEAR_GRAZING))[None]
    for below in sides_of(family):
        numbers = {**parameters, BELOW: below} if BELOW in family.ranges else dict(parameters)
        brdf, reflection = family.build(**numbers), (family.pointwise or family.build)(**numbers)
        mirrored, _ = brdf.deltas(wi)
        total, reflected = (
            np.atleast_1d(adaptive_albedo(part, wi[0, 2], 0.0, _ACCURACY, slow=True, max_evaluations=200_000).value)
            for part in (brdf, reflection)
        )
        channel = int(np.argmax(total))
        share = float(reflected[channel] + mirrored[0, channel])
        found.append(("from below" if below else "from above", share, float(total[channel]) - share))
    return found
