"""Factors against their formulas and closed forms, and what is refused."""

from __future__ import annotations

import datetime

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck.brdf.factors import (
    BlinnPhongExact,
    Constant,
    Factor,
    Normalized,
    PerCosine,
    PhongExact,
    Proportional,
    RationalFactor,
)
from brdfcheck.brdf.lobes import Lambert, Phong
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.quadrature.tables import albedo_table

N = np.array([0.0, 0.5, 1.0, 2.0, 17.85, 1000.0, 1e7])
WI = np.array([[0.6, 0.0, 0.8], [0.0, 0.0, 1.0], [0.0, 0.8, 0.6]])
WO = np.array([[-0.48, 0.36, 0.8], [0.6, 0.0, 0.8], [0.0, -0.6, 0.8]])


def test_formulas():
    np.testing.assert_allclose(Factor(6, 24.55)(N), (N + 6) / 24.55, rtol=1e-15)
    np.testing.assert_allclose(PhongExact()(N), (N + 2) / (2 * np.pi), rtol=1e-15)
    giesen = (N + 2) * (N + 4) / (8 * np.pi * (2 ** (-N / 2) + N))
    np.testing.assert_allclose(BlinnPhongExact()(N), giesen, rtol=1e-14)
    # n = 0 is Lambert's 1/pi in both; the exact factor of Blinn-Phong at n = 1 is 0.350.
    assert PhongExact()(jnp.asarray(0.0)) == pytest.approx(1 / np.pi)
    assert BlinnPhongExact()(jnp.asarray(0.0)) == pytest.approx(1 / np.pi)
    assert BlinnPhongExact()(jnp.asarray(1.0)) == pytest.approx(0.350, abs=5e-4)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_precision_of_the_exponent_is_kept(dtype):
    for factor in (PhongExact(), BlinnPhongExact()):
        assert factor(jnp.asarray(5.0, dtype)).dtype == dtype


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.nan, 1.0, "A must be finite; got nan"),
        (np.inf, 1.0, "A must be finite; got inf"),
        (1.0, 0.0, "B must be finite and > 0; got 0"),
        (1.0, -2.5, r"B must be finite and > 0; got -2\.5"),
        (0.0, -2.5, r"B must be finite and > 0; got -2\.5"),
        (-1.0, 0.0, "B must be finite and not 0; got 0"),
        (1.0, np.inf, "B must be finite and > 0; got inf"),
        (1.0, np.nan, "B must be finite and > 0; got nan"),
    ],
)
def test_bad_constants_are_refused(a, b, message):
    with pytest.raises(ValueError, match=message):
        Factor(a, b)


def test_a_factor_may_fall_with_the_exponent():
    assert Factor(-30.0, -5.0)(jnp.asarray(20.0)) == 2
    assert Factor(-30.0, -5.0)(jnp.asarray(25.0)) == 1


def test_constants_may_be_traced():
    value = jax.jit(lambda a, b: Factor(a, b)(jnp.asarray(2.0)))(1.0, 4.0)
    assert value == 0.75
    slope = jax.grad(lambda b: Factor(1.0, b)(jnp.asarray(2.0)))(4.0)
    assert slope == pytest.approx(-3 / 16)


def test_a_factor_scales_the_lobe():
    brdf = Normalized(Phong(9.0), Factor(3, 5))
    assert brdf.scale() == pytest.approx(12 / 5)
    np.testing.assert_allclose(brdf(WI, WO), 12 / 5 * np.asarray(Phong(9.0)(WI, WO)), rtol=1e-15)
    below = brdf(WI, WO * [1, 1, -1])
    np.testing.assert_array_equal(below, 0)


@pytest.mark.parametrize("lobe", [Lambert(0.5), GGX(0.3), lambda wi, wo: wo[..., 2]], ids=["Lambert", "GGX", "function"])
def test_a_factor_needs_an_exponent(lobe):
    with pytest.raises(TypeError, match=f"exponent n; got {type(lobe).__name__}"):
        Normalized(lobe, PhongExact())


@pytest.mark.parametrize("factor", [3.0, None, "exact"])
def test_a_factor_is_callable(factor):
    with pytest.raises(TypeError, match="factor must be a Factor or a closed form"):
        Normalized(Phong(2.0), factor)


def test_per_cosine_divides_by_the_cosine_of_the_light():
    lobe = Phong(4.0)
    np.testing.assert_allclose(PerCosine(lobe)(WI, WO), np.asarray(lobe(WI, WO)) / WI[:, 2], rtol=1e-15)
    rgb = Lambert(jnp.asarray([0.2, 0.4, 0.8]))
    assert PerCosine(rgb)(WI, WO).shape == (3, 3)
    np.testing.assert_allclose(PerCosine(rgb)(WI, WO), np.asarray(rgb(WI, WO)) / WI[:, 2:], rtol=1e-15)
    flat = np.array([[1.0, 0.0, 0.0]])
    assert np.all(np.isfinite(PerCosine(lobe)(flat, WO[:1])))
    # Not reciprocal: that is the defect it exhibits.
    assert not np.allclose(PerCosine(lobe)(WI, WO), PerCosine(lobe)(WO, WI))


@pytest.mark.parametrize(
    "wrong",
    [
        1 + 5j,
        np.complex64(3),
        jnp.asarray([1.0 + 2.0j]),
        np.array([0.1, 1j]),
        True,
        np.bool_(True),
        np.array([True]),
        [True, 2.0],
        "5",
        np.array("5"),
        b"5",
        np.timedelta64(5, "s"),
        np.array([5], "m8[s]"),
        np.datetime64("2020-01-01"),
        datetime.timedelta(days=3),
        [None],
        object(),
    ],
    ids=lambda wrong: type(wrong).__name__,
)
def test_parameters_that_are_not_real_numbers_are_refused(wrong):
    makers = {
        "n": Phong,
        "reflectance": Lambert,
        "alpha": GGX,
        "m": CookTorrance,
        "f0": lambda value: GGX(0.3, value),
        "weights": lambda value: CookTorrance(0.3, weights=value),
        "A": lambda value: Factor(value, 2),
        "B": lambda value: Proportional(value),
        "the constant": Constant,
        "numerator": lambda value: RationalFactor(value, [1.0]),
    }
    for name, make in makers.items():
        with pytest.raises(TypeError, match=rf"{name} must be a real number"):
            make(wrong)
    with pytest.raises(TypeError, match="n must be a list of real numbers"):
        albedo_table(Phong, [wrong] if np.ndim(wrong) == 0 else wrong, [0.5])
