"""Engine 2 against slope-space integrals and the figures of the literature."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import brute_force, facet_lobe, facet_tables, slope_at_normal
from selection import few

from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.quadrature.albedo import albedo

TABLES = facet_tables()
# Each distribution and each masking once, with and without a Fresnel term.
FAST = ("beckmann-v-cavities-0.04",)


@pytest.mark.parametrize("kind", few(TABLES, FAST, lambda kind: "-".join(map(str, kind))))
def test_accuracy_and_honest_error_bar(kind):
    table = TABLES[kind]
    lobes = jax.vmap(facet_lobe(*kind))(jnp.asarray(table.m))
    result = jax.lax.map(lambda pair: albedo(*pair), (lobes, jnp.asarray(table.cos_theta)), batch_size=8)
    error = np.abs(np.asarray(result.value) - table.albedo)
    assert np.max(error) <= 5e-10
    assert np.all(error <= np.asarray(result.error))
    assert np.max(np.asarray(result.error)) <= 1e-7


@pytest.mark.parametrize(
    ("m", "expected"),
    [
        (0.1, {0.8: 0.999999778, 0.5: 0.999071, 0.2: 0.950302, 0.05: 0.956725}),
        (0.4, {1.0: 0.963521, 0.8: 0.925339, 0.5: 0.901405, 0.2: 0.945439, 0.05: 0.985634}),
        (1.0, {1.0: 0.453447, 0.8: 0.572333, 0.5: 0.791715, 0.2: 0.928711, 0.05: 0.982550}),
    ],
)
def test_published_figures_of_the_correct_cook_torrance_form(m, expected):
    for mu, value in expected.items():
        assert albedo(CookTorrance(m), mu).value == pytest.approx(value, abs=1.1e-6)


def test_ggx_closed_form():
    assert albedo(GGX(1.0), 1.0).value == pytest.approx(1 - np.log(2), abs=1e-10)
    assert albedo(GGX(1.0, masking="v-cavities"), 1.0).value == pytest.approx(0.375, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    "lobe",
    [
        CookTorrance(0.6),
        CookTorrance(0.6, 0.04),
        CookTorrance(0.5, masking="smith-separable"),
        GGX(0.7, 0.3, fresnel="schlick"),
        CookTorrance(jnp.array([0.4, 0.8]), weights=jnp.array([0.3, 0.7])),
    ],
    ids=["v-cavities", "dielectric", "smith", "ggx-schlick", "two-slopes"],
)
def test_against_brute_force_over_the_outgoing_hemisphere(lobe):
    for mu in (0.95, 0.4):
        assert albedo(lobe, mu).value == pytest.approx(brute_force(lobe, mu, count=800), abs=2e-4)


@pytest.mark.slow
def test_float32_is_honest():
    m = jnp.asarray([0.1, 0.3, 1.0], jnp.float32)
    mu = jnp.asarray([0.2, 0.9, 0.5], jnp.float32)
    build = facet_lobe("ggx", "smith-correlated", 1.0)
    lobes = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), jax.vmap(build)(m))
    single = jax.vmap(albedo)(lobes, mu)
    double = jax.vmap(albedo)(jax.vmap(build)(m.astype(jnp.float64)), mu.astype(jnp.float64))
    error = np.abs(np.asarray(single.value, float) - np.asarray(double.value))
    assert single.value.dtype == jnp.float32
    assert np.all(error <= np.asarray(single.error))
    assert np.max(error) <= 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    "lobe",
    [
        *(
            lobe
            for masking in ("v-cavities", "smith-separable", "smith-correlated", "none")
            for lobe in (CookTorrance(0.6, 0.5, masking=masking), GGX(0.4, 0.04, masking=masking))
        ),
        CookTorrance(0.2),
    ],
    ids=str,
)
def test_the_derivative_at_normal_incidence_is_the_slope_of_the_values(lobe):
    def value(mu):
        return albedo(lobe, mu).value

    right = slope_at_normal(value, 0.2)
    assert float(jax.grad(value)(1.0)) == pytest.approx(right, abs=3e-7)
    assert float(jax.jacfwd(value)(1.0)) == pytest.approx(right, abs=3e-7)
    assert float(jax.grad(value)(1 - 2.0**-53)) == pytest.approx(right, abs=3e-7)


@pytest.mark.parametrize(
    ("eta", "right"),
    [(1.0001, 1.960504168552696e-08), (1.00001, 1.9627115304507542e-10), (1.000001, 1.962932553730925e-12), (1.0, 0.0)],
)
def test_a_faint_surface_reflects_what_it_should(eta, right):
    found = albedo(GGX(0.3, ((eta - 1) / (eta + 1)) ** 2), 0.5)
    assert abs(float(found.value) - right) <= float(found.error) <= 1e-9 * right


def test_without_masking_the_cosine_of_grazing_light_has_all_its_digits():
    # Goes like 1/cos: whatever is added to the cosine is seen.
    found = albedo(GGX(2.4e-4, masking="none"), 1e-9)
    assert abs(float(found.value) - 120000.50000075155) <= float(found.error)
    near, nearer = (float(albedo(CookTorrance(0.3, masking="none"), mu).value) for mu in (1e-6, 1e-16))
    assert nearer * 1e-16 == pytest.approx(near * 1e-6, rel=1e-5)
