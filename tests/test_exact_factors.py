"""Closed forms against the quadrature: the albedo at normal incidence is 1."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from _instruments.stability.references import LOBES, MICROFACETS
from brdfcheck.brdf.factors import KuijkBlakeExact, SchlickExact, TruncatedPowerExact, exact_factor
from brdfcheck.brdf.lobes import Lambert
from brdfcheck.quadrature.tables import albedo_table

ZONAL = [name for name in LOBES if name not in MICROFACETS]
# Where formulas change: Schlick's antiderivative at 1/4 and 4, the first zeros at k and at k/(1 - 1/sqrt 2).
N = np.array([0.0, 0.01, 0.25, 0.251, 1.0, 2.0, 3.999, 4.001, 7.9, 16.0, 16.001, 54.62, 54.64, 100.0, 1e3, 1e5, 1e7])


@pytest.mark.parametrize("name", few(ZONAL, ("kb",)))
def test_normal_incidence_reflects_one(name):
    lobe = LOBES[name]
    factor = exact_factor(lobe(1.0))
    raw = np.asarray(albedo_table(lobe, N, [1.0]).value)[:, 0]
    np.testing.assert_allclose(np.asarray(factor(jnp.asarray(N))) * raw, 1, rtol=1e-12)


@pytest.mark.parametrize("name", few(ZONAL, ("blinn", "schlick_half")))
def test_single_precision_keeps_its_digits(name):
    factor = exact_factor(LOBES[name](1.0))
    n = np.concatenate([np.geomspace(0.01, 10, 300), np.geomspace(10, 1e4 if "unclamped" not in name else 100, 300)])
    wide, narrow = (np.asarray(factor(jnp.asarray(n, dtype)), float) for dtype in (np.float64, np.float32))
    np.testing.assert_allclose(narrow, wide, rtol=4e-6)


@pytest.mark.parametrize("name", few(ZONAL, ("kb", "blinn")))
def test_gradients_are_finite(name):
    factor = exact_factor(LOBES[name](1.0))
    slope = jax.vmap(jax.grad(lambda n: factor(n)))(jnp.asarray(N[1:]))
    assert np.all(np.isfinite(np.asarray(slope)))


@pytest.mark.parametrize("k", [4, 16, 32, 64])
def test_high_powers_keep_their_digits(k):
    """Of a lobe that ends near its axis: 2 pi (k/n) (1/(k+1) - (k/n)/((k+1)(k+2))) in the mirror form."""
    n = np.array([100.0, 1e3, 1e7])
    albedo = 2 * np.pi * k / n * (1 / (k + 1) - k / n / ((k + 1) * (k + 2)))
    np.testing.assert_allclose(1 / np.asarray(TruncatedPowerExact(k, "mirror")(jnp.asarray(n))), albedo, rtol=3e-15)


def test_lobes_without_a_closed_form():
    assert exact_factor(Lambert()) is None
    assert exact_factor(object()) is None


def test_refusals():
    for form in (SchlickExact, KuijkBlakeExact):
        with pytest.raises(ValueError, match="form must be one of"):
            form("diagonal")
    with pytest.raises(ValueError, match="k must be at least 1; got 0"):
        TruncatedPowerExact(0)
