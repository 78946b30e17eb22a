"""The door to the three engines: shapes, transformations, refusals."""

from __future__ import annotations

import logging

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from brdfcheck import Factor, Normalized, PerCosine, PhongExact, albedo
from brdfcheck.brdf.base import AbstractZonalLobe
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lambert, Lyon, Phong, Schlick
from brdfcheck.brdf.microfacet import GGX, CookTorrance

SAMPLES = [
    Lambert(0.5),
    Phong(20.0),
    BlinnPhong(20.0),
    Schlick(20.0),
    Schlick(20.0, "half"),
    KuijkBlake(20.0),
    KuijkBlake(20.0, "half"),
    Lyon(20.0, 2),
    Lyon(20.0, 2, "mirror"),
    BinomialPower(20.0),
    BinomialPower(20.0, clamped=False),
    CookTorrance(0.3),
    CookTorrance(0.3, masking="smith-separable"),
    GGX(0.3),
    Normalized(Phong(20.0), PhongExact()),
]
# One of each engine and form.
FAST = ("Lambert-mirror", "BlinnPhong-half", "KuijkBlake-mirror", "GGX-smith-correlated", "Normalized")


def kind(lobe):
    words = [getattr(lobe, name) for name in ("form", "masking") if hasattr(lobe, name)]
    return "-".join([type(lobe).__name__, *words, *(["unclamped"] if not getattr(lobe, "clamped", True) else [])])


@pytest.mark.parametrize("lobe", few(SAMPLES, FAST, kind))
def test_any_shape_and_vmap_is_the_loop(lobe):
    mu = jnp.asarray([[1.0, 0.6, 0.3], [0.1, 0.01, 0.0]])
    whole = albedo(lobe, mu)
    assert whole.value.shape == whole.error.shape == (2, 3)
    loop = np.array([[float(albedo(lobe, float(m)).value) for m in row] for row in mu])
    np.testing.assert_allclose(whole.value, loop, rtol=1e-13)
    mapped = jax.vmap(jax.vmap(lambda m: albedo(lobe, m).value))(mu)
    np.testing.assert_allclose(mapped, loop, rtol=1e-13)


@pytest.mark.parametrize("lobe", few([Phong(7.0), KuijkBlake(7.0), CookTorrance(0.5)], FAST, kind))
def test_jit_is_eager(lobe):
    with jax.disable_jit():
        eager = albedo(lobe, 0.4).value
    np.testing.assert_allclose(albedo(lobe, 0.4).value, eager, rtol=1e-12)


def test_a_batch_of_lobes():
    n = jnp.asarray([1.0, 10.0, 100.0])
    mu = jnp.asarray([1.0, 0.5])
    batch = jax.vmap(albedo, (0, None))(Phong(n), mu)
    assert batch.value.shape == (3, 2)
    np.testing.assert_allclose(batch.value[1], albedo(Phong(10.0), mu).value, rtol=1e-14)


def test_no_retrace_for_another_exponent():
    traces = 0

    class Counting(AbstractZonalLobe):
        form: str = eqx.field(static=True)
        n: jax.Array

        def profile(self, versine):
            nonlocal traces
            traces += 1
            return jnp.exp(-self.n * versine)

        def width(self):
            return 1 / jnp.sqrt(self.n)

        def breaks(self):
            return jnp.minimum(40 / self.n, 1.0)[None]

    mu = jnp.asarray([0.3, 0.9])
    for n in (3.0, 5.0, 700.0):
        albedo(Counting("mirror", jnp.asarray(n)), mu)
    assert traces == 1


@pytest.mark.parametrize("lobe", few([lobe for lobe in SAMPLES if hasattr(lobe, "n")], FAST, kind))
def test_derivatives_are_finite_and_right(lobe):
    value = jax.jit(lambda n, mu: albedo(eqx.tree_at(lambda leaf: leaf.n, lobe, n), mu).value)
    slopes = jax.jit(jax.grad(value, (0, 1)))
    for mu in (1.0, 0.7, 0.05, 0.0):
        by_n, by_mu = slopes(lobe.n, mu)
        assert np.isfinite(by_n)
        assert np.isfinite(by_mu)
        if 0 < mu < 1:
            step = 1e-5
            central = (value(lobe.n * (1 + step), mu) - value(lobe.n * (1 - step), mu)) / (2 * step * lobe.n)
            assert by_n == pytest.approx(float(central), rel=1e-5, abs=1e-9)
            central = (value(lobe.n, mu * (1 + step)) - value(lobe.n, mu * (1 - step))) / (2 * step * mu)
            assert by_mu == pytest.approx(float(central), rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("lobe", SAMPLES, ids=kind)
def test_every_lobe_has_finite_derivatives_in_both_directions(lobe):
    wi = jnp.asarray([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.6, 0.0, 0.8], [0.8, 0.0, 0.6]])
    wo = jnp.asarray([[0.0, 0.0, 1.0], [-0.6, 0.0, 0.8], [0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    gradients = jax.grad(lambda wi, wo: jnp.sum(lobe(wi, wo)), (0, 1))(wi, wo)
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


def test_factors_scale_the_albedo():
    raw = albedo(Phong(5.0), 0.6)
    scaled = albedo(Normalized(Phong(5.0), Factor(2, 3)), 0.6)
    assert scaled.value == pytest.approx(float(raw.value) * 7 / 3, rel=1e-14)
    assert scaled.error > 0
    assert albedo(PerCosine(Phong(5.0)), 0.5).value == pytest.approx(2 * float(albedo(Phong(5.0), 0.5).value))
    assert np.isinf(albedo(PerCosine(Phong(5.0)), 0.0).value)


@pytest.mark.parametrize("wrong", [-0.1, 1.1, float("nan"), [0.2, 2.0], 1j, "0.5"])
def test_cosines_outside_the_domain_are_refused(wrong):
    with pytest.raises(ValueError, match="cos_theta"):
        albedo(Phong(5.0), wrong)


@pytest.mark.parametrize("rtol", [0.0, -1.0, 2.0, float("nan"), "fine"])
def test_bad_accuracies_are_refused(rtol):
    with pytest.raises(ValueError, match="rtol"):
        albedo(Phong(5.0), 0.5, rtol=rtol)


def test_things_that_are_not_brdfs_are_refused():
    with pytest.raises(TypeError, match="callable"):
        albedo(3, 0.5)
    with pytest.raises(ValueError, match=r"vmap"):
        albedo(Phong(jnp.asarray([1.0, 2.0])), 0.5)
    with pytest.raises(TypeError, match="outside jit"):
        jax.jit(lambda mu: albedo(lambda wi, wo: wo[..., 2], mu).value)(0.5)


def test_a_function_goes_to_the_adaptive_engine():
    lobe = Phong(30.0)
    result = albedo(lambda wi, wo: lobe(wi, wo), jnp.asarray([0.9, 0.3]))
    exact = albedo(lobe, jnp.asarray([0.9, 0.3]))
    assert result.engine == "adaptive"
    assert np.all(np.abs(result.value - np.asarray(exact.value)) <= np.asarray(result.error))
    assert np.all(np.abs(result.value - np.asarray(exact.value)) <= 1e-7)


def test_a_numpy_function_says_that_it_is_slow(caplog):
    def plain(wi, wo):
        return np.where(np.asarray(wo)[..., 2] > 0, 1 / np.pi, 0.0)

    with caplog.at_level(logging.WARNING, logger="brdfcheck"):
        result = albedo(plain, 0.5)
    assert result.engine == "adaptive (numpy)"
    assert "numpy" in caplog.text
    assert result.value == pytest.approx(1, abs=1e-8)


@pytest.mark.parametrize("mu", [1.0, 0.5, 1 / 64])
def test_needles_of_a_users_own_ggx(mu):
    own = lambda wi, wo: GGX(0.01)(wi, wo)  # noqa: E731
    result = albedo(own, mu, rtol=1e-7)
    exact = float(albedo(GGX(0.01), mu).value)
    assert abs(float(result.value) - exact) <= 1e-6
    assert abs(float(result.value) - exact) <= float(result.error) + 2e-9


def test_anisotropic_albedo_depends_on_the_azimuth():
    def brushed(wi, wo):
        half = wi + wo
        half = half / jnp.linalg.norm(half, axis=-1, keepdims=True)
        exponent = (50 * half[..., 0] ** 2 + 2 * half[..., 1] ** 2) / jnp.maximum(half[..., 2] ** 2, 1e-9)
        return jnp.exp(-exponent)

    along, across = (float(albedo(brushed, 0.5, azimuth=turn).value) for turn in (0.0, np.pi / 2))
    assert abs(along - across) > 0.01
    both = albedo(brushed, 0.5, azimuth=np.array([0.0, np.pi / 2]))
    np.testing.assert_allclose(both.value, [along, across], rtol=1e-7)


@pytest.mark.parametrize("power", [0.1, 0.3, 0.5, 1.0])
def test_grazing_incidence_is_the_limit(power):
    result = albedo(lambda wi, wo: (1.02 - 0.1 * wi[..., 2] ** power) / jnp.pi + 0 * wo[..., 2], np.array([0.0, 1e-3]))
    assert abs(float(result.value[0]) - 1.02) <= float(result.error[0]) < 1e-4
    assert float(result.value[1]) == pytest.approx(1.02 - 0.1 * 1e-3**power, abs=1e-8)


@pytest.mark.parametrize(
    "growth", [lambda mu: mu**-0.5, lambda mu: 0.1 * mu**-0.1, lambda mu: -jnp.log(mu), lambda mu: 0.5 - 0.01 * jnp.log(mu)]
)
def test_grazing_incidence_without_bound(growth):
    result = albedo(lambda wi, wo: growth(wi[..., 2]) / jnp.pi + 0 * wo[..., 2], 0.0)
    assert np.isposinf(result.value)
    assert np.isposinf(result.error)


def test_single_directions_that_are_not_finite_are_taken_beside():
    def divided(wi, wo):  # 0/0 for light along N
        return (wi[..., 0] ** 2 + wi[..., 1] ** 2) / (wi[..., 0] ** 2 + wi[..., 1] ** 2) * 0.5 / jnp.pi + 0 * wo[..., 2]

    result = albedo(divided, jnp.asarray([1.0, 0.5]))
    np.testing.assert_allclose(result.value, 0.5, atol=1e-7)
