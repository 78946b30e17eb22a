"""D, G and F one by one, and the lobes made of them, against their formulas in plain numpy."""

from __future__ import annotations

import decimal
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few
from shared import fresnel as exact_fresnel
from test_geometry import near_mirror, random_directions

from brdfcheck.brdf.microfacet import GGX, MASKINGS, CookTorrance, fresnel_dielectric, fresnel_schlick

LIGHT = random_directions(600, 11)
WI = LIGHT[LIGHT[:, 2] > 1e-3]
WO = np.concatenate([random_directions(900, 12), near_mirror(WI, 13)])
WO = WO[WO[:, 2] > 1e-3][-len(WI) :][::-1].copy()
WO[::2] = near_mirror(WI, 14)[::2]
WO[:, 2] = np.maximum(WO[:, 2], 1e-3)
WO /= np.linalg.norm(WO, axis=-1, keepdims=True)


def half(wi: np.ndarray, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """N.H, tan^2 of its angle, V.H."""
    h = wi + wo
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    return h[..., 2], (h[..., 0] ** 2 + h[..., 1] ** 2) / h[..., 2] ** 2, np.sum(h * wo, axis=-1)


def beckmann(m: float) -> np.ndarray:
    n_h, tangent2, _ = half(WI, WO)
    return np.exp(-tangent2 / m**2) / (np.pi * m**2 * n_h**4)


def trowbridge_reitz(alpha: float) -> np.ndarray:
    n_h, tangent2, _ = half(WI, WO)
    return alpha**2 / (np.pi * n_h**4 * (alpha**2 + tangent2) ** 2)


def hidden(kind: str, slope: float, cosine: np.ndarray) -> np.ndarray:
    """Smith's Lambda."""
    tangent = np.sqrt(1 - cosine**2) / cosine
    if kind == "ggx":
        return (np.sqrt(1 + slope**2 * tangent**2) - 1) / 2
    a = 1 / (slope * np.maximum(tangent, 1e-12))
    complement = np.array([math.erfc(x) for x in a])
    return np.exp(-np.minimum(a * a, 700)) / (2 * a * math.sqrt(math.pi)) - complement / 2


def masking(kind: str, masked: str, slope: float) -> np.ndarray:
    mu_i, mu_o = WI[:, 2], WO[:, 2]
    n_h, _, v_h = half(WI, WO)
    if masked == "none":
        return np.ones_like(mu_i)
    if masked == "v-cavities":
        return np.minimum(1, np.minimum(2 * n_h * mu_o / v_h, 2 * n_h * mu_i / v_h))
    here, there = hidden(kind, slope, mu_i), hidden(kind, slope, mu_o)
    return 1 / ((1 + here) * (1 + there)) if masked == "smith-separable" else 1 / (1 + here + there)


BUILD = {"beckmann": CookTorrance, "ggx": GGX}
DENSITY = {"beckmann": beckmann, "ggx": trowbridge_reitz}


@pytest.mark.parametrize("kind", BUILD)
@pytest.mark.parametrize("masked", MASKINGS)
@pytest.mark.parametrize("slope", [0.08, 0.4, 1.0, 2.5])
def test_values_are_the_formula(kind: str, masked: str, slope: float) -> None:
    shadow = masking(kind, masked, slope)
    assert np.all((shadow >= 0) & (shadow <= 1))
    if masked != "none":
        assert np.ptp(shadow) > 0.1
    expected = DENSITY[kind](slope) * shadow / (4 * WI[:, 2] * WO[:, 2])
    found = np.asarray(BUILD[kind](slope, masking=masked)(WI, WO))
    assert np.count_nonzero(expected > 1e-10 * np.max(expected)) > 150
    # exp(-tan^2 / m^2) magnifies the rounding of the tangent.
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.max(expected))
    assert np.all(found <= np.asarray(BUILD[kind](slope, masking="none")(WI, WO)) * (1 + 1e-14))  # masking only takes away


@pytest.mark.parametrize("lobe", few([CookTorrance(0.01), GGX(3.0)], ("GGX",), lambda lobe: type(lobe).__name__))
def test_facets_have_a_projected_area_of_one(lobe) -> None:
    # tan = slope x / (1 - x): the needle and the tail have the same share of the nodes.
    slope = float(lobe.m if isinstance(lobe, CookTorrance) else lobe.alpha)
    x, w = np.polynomial.legendre.leggauss(400)
    x, w = (1 + x) / 2, w / 2
    tangent = slope * x / (1 - x)
    jacobian = slope / (1 - x) ** 2
    cosine2 = 1 / (1 + tangent**2)
    sine2 = tangent**2 * cosine2
    # D cos dw = D cos sin 2 pi da, da = cos^2 dtan
    integrand = np.asarray(lobe.distribution(np.sqrt(cosine2), sine2)) * np.sqrt(cosine2 * sine2) * cosine2
    assert 2 * np.pi * np.sum(w * jacobian * integrand) == pytest.approx(1, abs=1e-9)


# --- Fresnel ---

COSINES = np.concatenate([np.linspace(0, 1, 301), np.geomspace(1e-6, 1e-2, 50)])


@pytest.mark.parametrize("eta", [1.0001, 1.33, 1.5, 2.5, 20.0])
def test_dielectric_fresnel_is_that_of_the_amplitudes(eta: float) -> None:
    f0 = ((eta - 1) / (eta + 1)) ** 2
    found = np.asarray(fresnel_dielectric(jnp.asarray(COSINES), jnp.asarray(f0)))
    np.testing.assert_allclose(found, exact_fresnel(COSINES, eta), rtol=1e-9, atol=1e-12)
    assert found[300] == pytest.approx(f0, rel=1e-9)
    assert found[0] == pytest.approx(1)
    assert np.all((found >= 0) & (found <= 1 + 1e-15))


def test_fresnel_at_the_ends() -> None:
    cosine = jnp.asarray(COSINES)
    for fresnel in (fresnel_dielectric, fresnel_schlick):
        np.testing.assert_allclose(fresnel(cosine, jnp.asarray(1.0)), 1, rtol=1e-15)
        assert fresnel(jnp.asarray(0.0), jnp.asarray(0.04)) == pytest.approx(1)
        assert fresnel(jnp.asarray(1.0), jnp.asarray(0.3)) == pytest.approx(0.3, rel=1e-12)
    # No surface at all reflects nothing, but for the very last angle.
    np.testing.assert_allclose(fresnel_dielectric(jnp.asarray([0.1, 0.5, 1.0]), jnp.asarray(0.0)), 0, atol=1e-12)


@pytest.mark.parametrize("fresnel", ["dielectric", "schlick"])
def test_the_fresnel_term_depends_on_the_angle_to_the_half_vector(fresnel: str) -> None:
    _, _, v_h = half(WI, WO)
    f0 = 0.09
    term = exact_fresnel(v_h, 1.3 / 0.7) if fresnel == "dielectric" else f0 + (1 - f0) * (1 - v_h) ** 5
    for build in (CookTorrance, GGX):
        bare, tinted = np.asarray(build(0.5)(WI, WO)), np.asarray(build(0.5, f0, fresnel=fresnel)(WI, WO))
        np.testing.assert_allclose(tinted, bare * term, rtol=1e-9)
        rgb = np.asarray(build(0.5, [0.04, f0, 1.0], fresnel=fresnel)(WI, WO))
        assert rgb.shape == (len(WI), 3)
        np.testing.assert_allclose(rgb[:, 1], tinted, rtol=1e-12)
        np.testing.assert_allclose(rgb[:, 2], bare, rtol=1e-12)


# --- combinations ---


@pytest.mark.parametrize("masked", ["v-cavities", "none"])
def test_several_slopes_add_up(masked: str) -> None:
    slopes, weights = [0.2, 0.4, 0.9], [0.5, 0.3, 0.1]
    sum_of_parts = sum(w * np.asarray(CookTorrance(m, masking=masked)(WI, WO)) for m, w in zip(slopes, weights, strict=True))
    both = CookTorrance(jnp.asarray(slopes), weights=jnp.asarray(weights), masking=masked)
    np.testing.assert_allclose(both(WI, WO), sum_of_parts, rtol=1e-12)
    one = CookTorrance(0.2, weights=0.5, masking=masked)
    np.testing.assert_allclose(one(WI, WO), 0.5 * np.asarray(CookTorrance(0.2, masking=masked)(WI, WO)), rtol=1e-14)


@pytest.mark.parametrize("masked", MASKINGS)
def test_the_published_form_is_four_times_the_correct_one(masked: str) -> None:
    for m, f0 in ((0.2, 1.0), (0.8, 0.05)):
        correct = np.asarray(CookTorrance(m, f0, masking=masked)(WI, WO))
        published = np.asarray(CookTorrance(m, f0, masking=masked, convention="published")(WI, WO))
        np.testing.assert_allclose(published, 4 * correct, rtol=1e-15)
    assert np.max(correct) > 0
    # As printed: F D' G / (pi (N.L)(N.V)) with D' = exp(-tan^2/m^2)/(m^2 cos^4).
    printed = np.pi * beckmann(0.2) * masking("beckmann", masked, 0.2) / (np.pi * WI[:, 2] * WO[:, 2])
    found = np.asarray(CookTorrance(0.2, masking=masked, convention="published")(WI, WO))
    np.testing.assert_allclose(found, printed, rtol=1e-9, atol=1e-12 * np.max(printed))


@pytest.mark.parametrize("masked", MASKINGS)
@pytest.mark.parametrize("build", [CookTorrance, GGX], ids=["beckmann", "ggx"])
def test_finite_and_reciprocal_at_grazing_directions(build, masked: str) -> None:
    flat = [np.array([np.sqrt(1 - c * c) * np.cos(p), np.sqrt(1 - c * c) * np.sin(p), c])
            for c in (0.0, 1e-18, 1e-9, 1e-4, 1.0) for p in (0.0, np.pi, 1.0)]  # fmt: skip
    wi, wo = (part.reshape(-1, 3) for part in np.broadcast_arrays(np.array(flat)[:, None], np.array(flat)[None]))
    for slope in (0.05, 1.0):
        there, back = np.asarray(build(slope, masking=masked)(wi, wo)), np.asarray(build(slope, masking=masked)(wo, wi))
        assert np.all(np.isfinite(there))
        assert np.all(there >= 0)
        np.testing.assert_allclose(there, back, rtol=1e-9, atol=1e-300)


def test_nothing_below_the_horizon() -> None:
    for lobe in (CookTorrance(0.5), CookTorrance(0.5, masking="smith-separable"), GGX(0.5, [0.1, 0.2])):
        values = jax.jit(lobe.__call__)
        assert not np.any(values(WI, WO * [1, 1, -1]))
        assert not np.any(values(WI * [1, 1, -1], WO))
        assert np.any(values(WI, WO))
    assert jax.eval_shape(CookTorrance(0.5), WI[0], WO[0]).shape == ()
    assert jax.eval_shape(CookTorrance(0.5), WI[:, None], WO[:7]).shape == (len(WI), 7)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: CookTorrance(0.0), "m must be finite and > 0; got 0.0"),
        (lambda: CookTorrance(-0.2), "m must be finite and > 0; got -0.2"),
        (lambda: CookTorrance(np.nan), "m must be finite and > 0; got nan"),
        (lambda: CookTorrance(np.inf), "m must be finite and > 0; got inf"),
        (lambda: CookTorrance([]), "m must be finite and > 0; got []"),
        (lambda: GGX(0), "alpha must be finite and > 0; got 0"),
        (lambda: GGX(np.nan), "alpha must be finite and > 0; got nan"),
        (lambda: GGX(0.3, 1.01), "f0 must be finite and >= 0 and <= 1; got 1.01"),
        (lambda: CookTorrance(0.3, -0.01), "f0 must be finite and >= 0 and <= 1; got -0.01"),
        (lambda: CookTorrance(0.3, [0.1, np.nan]), "f0 must be finite and >= 0 and <= 1"),
        (lambda: CookTorrance(0.3, weights=-1.0), "weights must be finite and >= 0; got -1.0"),
        (lambda: CookTorrance(0.3, weights=[0.5, 0.5]), "got () and (2,)"),
        (lambda: CookTorrance([[0.3]], weights=[[1.0]]), "got (1, 1) and (1, 1)"),
        (lambda: CookTorrance(0.3, convention="wrong"), "convention must be one of correct, published; got 'wrong'"),
        (lambda: CookTorrance(0.3, masking="smith"), "masking must be one of v-cavities, smith-separable"),
        (lambda: GGX(0.3, masking=""), "got ''"),
        (lambda: GGX(0.3, fresnel="metal"), "fresnel must be one of dielectric, schlick; got 'metal'"),
        (
            lambda: CookTorrance([0.2, 0.4], weights=[0.5, 0.5], masking="smith-correlated"),
            "Smith masking belongs to one slope",
        ),
    ],
)
def test_bad_parameters_are_refused(build, message: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        build()
    assert message in str(caught.value)


def fresnel_to_many_digits(cosine: float, f0: float) -> decimal.Decimal:
    """The formula with 200 digits."""
    with decimal.localcontext(decimal.Context(prec=200)):
        c, root = decimal.Decimal(cosine), decimal.Decimal(f0).sqrt()
        if root in (0, 1):
            return root
        g = (((1 + root) / (1 - root)) ** 2 + c * c - 1).sqrt()
        return ((g - c) / (g + c)) ** 2 / 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)


@pytest.mark.parametrize("f0", [0.0, 1e-40, 1e-18, 1e-8, 0.04, 0.999, 1 - 1e-6, 1 - 1e-12, 1 - 2.0**-53, 1.0])
def test_dielectric_fresnel_keeps_its_digits_near_no_surface_and_near_a_mirror(f0: float) -> None:
    for cosine in (1.0, 1 - 1e-10, 0.5, 1e-3, 1e-6, 1e-9):
        right = fresnel_to_many_digits(cosine, f0)
        found = decimal.Decimal(float(fresnel_dielectric(jnp.asarray(cosine), jnp.asarray(f0))))
        assert abs(found - right) <= decimal.Decimal("1e-14") * right
        slopes = jax.grad(fresnel_dielectric, (0, 1))(jnp.asarray(cosine, jnp.float32), jnp.asarray(f0, jnp.float32))
        assert np.all(np.isfinite(slopes))


@pytest.mark.parametrize("cosine", [1.0, 0.5, 0.1])
def test_derivatives_of_fresnel_where_there_is_no_surface_and_at_a_mirror(cosine: float) -> None:
    slope = jax.grad(fresnel_dielectric, 1)
    assert float(slope(cosine, 0.0)) == pytest.approx((1 + (2 * cosine**2 - 1) ** 2) / (2 * cosine**4), rel=1e-13)
    assert float(slope(cosine, 1.0)) == pytest.approx((cosine + 1 / cosine) / 2, rel=1e-13)


def test_smith_masking_of_the_steepest_facets_is_none_along_the_normal() -> None:
    top, bottom = CookTorrance(1e9, masking="smith-separable").shadowing(jnp.asarray(1.0))
    assert float(top / bottom) == pytest.approx(1, rel=1e-15)


def test_the_distribution_of_the_steepest_facets_has_no_floor() -> None:
    m, cosine = 1e10, 1e-11
    found = CookTorrance(m).distribution(jnp.asarray(cosine), jnp.asarray(1.0))
    assert float(found) == pytest.approx(math.exp(-1 / (cosine * m) ** 2) / (math.pi * m**2 * cosine**4), rel=1e-12)
