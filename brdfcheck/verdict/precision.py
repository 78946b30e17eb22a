"""How far the rounding of a function that computes in single precision moves its albedo."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from brdfcheck.numerics import unit_vectors
from brdfcheck.quadrature.graded import GradedRule
from brdfcheck.quadrature.pointwise import GRAZING, PointwiseAlbedo

_TREMORS = 3
_RULE = GradedRule(20, 8, 7, 10, 1e-4)


def is_single(albedo: PointwiseAlbedo) -> bool:
    """True where the values of a function are float32."""
    return albedo.evaluator is not None and albedo.epsilon > 1e-10


def rounding(albedo: PointwiseAlbedo, parameters: Mapping[str, float], cosine: float, azimuth: float) -> float:
    """The integral of |change| cos over the hemisphere where directions move by a rounding of float32: the largest of a few.

    The function rounds its directions, and loses as many digits on the way as its formula makes it lose: near the peak of a
    sharp lobe, thousands of roundings. Changes are not let cancel, so this bounds more than the random part of the error.
    """
    evaluator = albedo.evaluator
    assert evaluator is not None
    bound = evaluator.bind({name: parameters[name] for name in albedo.swept})
    mu = max(cosine, GRAZING)
    wo, share = np.empty((3, 1, _RULE.size)), np.empty((1, _RULE.size))
    _RULE.fill(np.array([mu]), wo, share)
    c, s = np.cos(azimuth), np.sin(azimuth)
    out = np.stack([c * wo[0, 0] - s * wo[1, 0], s * wo[0, 0] + c * wo[1, 0], wo[2, 0]], axis=1)
    light = np.tile(unit_vectors(mu, azimuth), (len(out), 1))
    random = np.random.default_rng(29)
    still = bound(light, out).reshape(len(out), -1)
    largest = 0.0
    for _ in range(_TREMORS):
        moved = out * (1 + albedo.epsilon * random.uniform(-1, 1, out.shape))
        change = np.abs(bound(light, moved).reshape(len(out), -1) - still)
        largest = max(largest, float(np.max(share[0] @ np.where(np.isfinite(change), change, 0))))
    return largest
