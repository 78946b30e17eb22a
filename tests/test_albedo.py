"""The door to the three engines: shapes, transformations, refusals."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck import Factor, Normalized, PerCosine, PhongExact, albedo
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
def kind(lobe):
    words = [getattr(lobe, name) for name in ("form", "masking") if hasattr(lobe, name)]
    return "-".join([type(lobe).__name__, *words, *(["unclamped"] if not getattr(lobe, "clamped", True) else [])])


@pytest.mark.slow
@pytest.mark.parametrize("lobe", SAMPLES, ids=kind)
def test_any_shape_and_vmap_is_the_loop(lobe):
    mu = jnp.asarray([[1.0, 0.6, 0.3], [0.1, 0.01, 0.0]])
    whole = albedo(lobe, mu)
    assert whole.value.shape == whole.error.shape == (2, 3)
    loop = np.array([[float(albedo(lobe, float(m)).value) for m in row] for row in mu])
    np.testing.assert_allclose(whole.value, loop, rtol=1e-13)
    mapped = jax.vmap(jax.vmap(lambda m: albedo(lobe, m).value))(mu)
    np.testing.assert_allclose(mapped, loop, rtol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("lobe", [Phong(7.0), KuijkBlake(7.0), CookTorrance(0.5)], ids=kind)
def test_jit_is_eager(lobe):
    with jax.disable_jit():
        eager = albedo(lobe, 0.4).value
    np.testing.assert_allclose(albedo(lobe, 0.4).value, eager, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("lobe", [lobe for lobe in SAMPLES if hasattr(lobe, "n")], ids=kind)
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


@pytest.mark.slow
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
