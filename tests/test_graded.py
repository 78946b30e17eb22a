"""The fixed rule of scans: its nodes fill the hemisphere at every angle, move smoothly with it, and resolve needles."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

import brdfcheck
from brdfcheck.brdf.lobes import Phong
from brdfcheck.brdf.microfacet import GGX
from brdfcheck.quadrature.graded import GradedRule

RULES = (
    GradedRule(7, 3, 3, 3, 1e-3),
    GradedRule(10, 4, 4, 5, 1e-3),
    GradedRule(20, 8, 7, 9, 1e-4),
    GradedRule(39, 14, 12, 18, 1e-6),
    GradedRule(22, 8, 9, 10, 1e-4),
    GradedRule(42, 14, 12, 18, 1e-6),
)
COSINES = np.concatenate([10.0 ** -np.arange(0, 10.0), np.linspace(0.01, 0.999, 30)])


def filled(rule: GradedRule, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """wo (3, m, size) and weight (m, size), written into the middle of larger arrays."""
    wo, weight = np.full((3, len(mu), rule.size + 9), np.nan), np.full((len(mu), rule.size + 9), np.nan)
    rule.fill(mu, wo[..., 4:-5], weight[:, 4:-5])
    assert np.isnan(wo[..., :4]).all()
    assert np.isnan(wo[..., -5:]).all()
    return wo[..., 4:-5], weight[:, 4:-5]


def summed(rule: GradedRule, brdf, mu: np.ndarray) -> np.ndarray:
    wo, weight = filled(rule, mu)
    wi = np.stack([np.sqrt((1 - mu) * (1 + mu)), 0 * mu, mu], axis=-1)[:, None]
    wo = np.moveaxis(wo, 0, 2)
    return np.sum(weight * np.asarray(brdf(jnp.asarray(np.broadcast_to(wi, wo.shape)), jnp.asarray(wo))), axis=1)


@pytest.mark.parametrize("rule", RULES)
def test_nodes_fill_the_hemisphere_at_every_angle(rule: GradedRule):
    wo, weight = filled(rule, COSINES)
    np.testing.assert_allclose(np.linalg.norm(wo, axis=0), 1, rtol=1e-13)
    assert np.all(wo[2] > 0)
    assert np.all(weight >= 0)
    tolerance = {7: 2e-2, 10: 5e-3, 20: 2e-5, 22: 2e-5, 39: 1e-7, 42: 1e-7}[rule.radial]
    np.testing.assert_allclose(weight.sum(axis=1), np.pi, rtol=tolerance)
    # Moments: each half, each side of the plane of incidence, cos^2.
    x, y, z = wo
    for values, exact in (((y > 0), np.pi / 2), (z, 2 * np.pi / 3), (x, 0.0), (y, 0.0), (x * x, np.pi / 4), (y * y, np.pi / 4)):
        np.testing.assert_allclose(np.sum(weight * values, axis=1), exact, atol=np.pi * tolerance)


@pytest.mark.slow
def test_it_converges_for_microfacets_of_any_roughness():
    mu = np.array([1.0, 0.9, 0.5, 0.2, 0.05, 1e-3])
    for alpha, bound in ((0.01, 5e-3), (0.1, 1e-4), (0.5, 1e-4), (1.0, 1e-4)):
        exact = np.asarray(brdfcheck.albedo(GGX(alpha), mu).value)
        coarse, *both_sides, middle, fine = (np.max(np.abs(summed(rule, GGX(alpha), mu) - exact)) for rule in RULES[1:])
        assert 2 * fine < middle < coarse / 2, (alpha, coarse, middle, fine)
        assert fine < bound, (alpha, fine)
        # On both sides of the plane of incidence there is a node less across: of the sharpest 0.6 of the coarse error is left.
        middle, fine = both_sides
        assert 3 * fine < middle < coarse / (1 if alpha == 0.01 else 2), (alpha, coarse, middle, fine)
        assert fine < bound, (alpha, fine)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1.0, 100.0, 1e4, 1e6])
def test_it_resolves_lobes_down_to_its_scale(n: float):
    mu = np.array([1.0, 0.7, 0.3, 0.05])
    exact = np.asarray(brdfcheck.albedo(Phong(n), mu).value)
    finest = np.abs(summed(RULES[3], Phong(n), mu) / exact - 1)
    assert np.max(finest) < (5e-5 if n <= 1e4 else 5e-4)
    if n <= 1e4:  # wider than 1e-3 radians
        assert np.max(np.abs(summed(RULES[1], Phong(n), mu) / exact - 1)) < 0.05


def test_sums_are_smooth_in_the_angle():
    """No node jumps: third differences of the sum are as small as those of a smooth function."""
    theta = np.linspace(0.02, 1.55, 400)
    values = summed(RULES[1], GGX(0.3), np.cos(theta))
    step = theta[1] - theta[0]
    third = np.abs(np.diff(values, 3))
    assert np.max(third) < 2e3 * step**3
    alone, both = filled(RULES[1], np.array([0.3]))[0], filled(RULES[1], np.array([0.8, 0.3]))[0]
    np.testing.assert_allclose(alone[:, 0], both[:, 1], rtol=0, atol=1e-15)
