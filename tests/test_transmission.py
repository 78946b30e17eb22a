"""Surfaces that transmit: values, energy on both sides, the engine for refracting facets, and the door for functions."""

# pyright: reportArgumentType=false
from __future__ import annotations

import functools
import importlib.util

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_shader import normalised
from selection import few
from shared import fresnel

import brdfcheck
from brdfcheck.brdf.subject import load
from brdfcheck.brdf.transmission import LambertTransmission, RoughDielectric, SmoothDielectric, ThinSheet
from brdfcheck.brdf.two_sides import Folded, bsdf, reciprocal_form
from brdfcheck.messages import UsageError
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.functions import adaptive_albedo
from brdfcheck.quadrature.half_vector import HalfVector
from brdfcheck.verdict import Verdict, check

KINDS = ("ggx", "beckmann")
needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed: pip install brdfcheck[mitsuba]"
)


# Compiled whole: operation by operation, each shape would compile dozens of small programs.
values = eqx.filter_jit(lambda surface, wi, wo: (surface(wi, wo), reciprocal_form(surface)(wi, wo)))
weights = eqx.filter_jit(lambda surface, cosine, below: surface.weights(cosine, below))


def sampled(kind: str, alpha: float, ratio: float, cosine: float, count: int = 400_000) -> tuple[np.ndarray, np.ndarray]:
    """(R, T) and their standard errors by Monte Carlo over normals drawn from D (h.N), as in Walter et al. (2007)."""
    random = np.random.default_rng(5)
    u, azimuth = random.uniform(size=count), random.uniform(0, 2 * np.pi, count)
    tangent = alpha * np.sqrt(u / (1 - u)) if kind == "ggx" else alpha * np.sqrt(-np.log1p(-u))
    up = 1 / np.sqrt(1 + tangent**2)
    out = np.sqrt(1 - up**2)
    h = np.stack([out * np.cos(azimuth), out * np.sin(azimuth), up], axis=1)
    wi = np.array([np.sqrt(1 - cosine**2), 0, cosine])
    c = h @ wi

    def masked(z: np.ndarray | float) -> np.ndarray:
        from scipy.special import erf

        tan = np.sqrt(1 - np.minimum(z, 1) ** 2) / np.maximum(z, 1e-12)
        if kind == "ggx":
            return 2 / (1 + np.sqrt(1 + (alpha * tan) ** 2))
        a = 1 / np.maximum(alpha * tan, 1e-12)
        slope = np.exp(-(a**2)) / (a * np.sqrt(np.pi))
        return 2 / (1 + erf(a) + slope)

    inner = np.sqrt(np.maximum(1 - (1 - c**2) / ratio**2, 0))
    reflected = 2 * c[:, None] * h - wi
    refracted = -wi / ratio + (c / ratio - inner)[:, None] * h
    share = fresnel(np.clip(c, 0, 1), ratio)
    weight = np.where(c > 0, c, 0) / (cosine * up) * masked(cosine)  # D (h.N) is the density
    r = np.where(reflected[:, 2] > 0, weight * share * masked(np.abs(reflected[:, 2])), 0)
    t = np.where(refracted[:, 2] < 0, weight * (1 - share) * masked(np.abs(refracted[:, 2])), 0)
    return np.array([r.mean(), t.mean()]), np.array([r.std(), t.std()]) / np.sqrt(count)


def shares(surface, cosine: float, below: float = 0.0) -> np.ndarray:
    return np.array([float(albedo(surface.lit(below, part), cosine).value) for part in ("reflected", "transmitted")])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("alpha", "eta", "cosine", "below"), [(0.3, 1.5, 0.6, 0.0), (0.5, 1.5, 0.7, 1.0), (0.2, 1.33, 0.2, 1.0)]
)
def test_rough_boundary_against_monte_carlo_over_facets(kind, alpha, eta, cosine, below):
    found = shares(RoughDielectric(alpha, eta, kind), cosine, below)
    mean, error = sampled(kind, alpha, 1 / eta if below else eta, cosine)
    assert np.all(np.abs(found - mean) <= 5 * error + 1e-9)  # too rare to be drawn
    assert np.all(error < 2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "below", "cosine"), [("ggx", 0.0, 0.7), ("beckmann", 1.0, 0.85), ("ggx", 1.0, 0.4)])
def test_half_vectors_against_directions(kind, below, cosine):
    """The engine for facets against engine 3 over directions, which knows nothing of half vectors and their Jacobian."""
    surface = RoughDielectric(0.5, 1.5, kind)
    for part in ("reflected", "transmitted"):
        exact = albedo(surface.lit(below, part), cosine)
        folded = jax.jit(Folded(surface, below, part))
        found = adaptive_albedo(lambda wi, wo, f=folded: np.asarray(f(wi, wo)), cosine, 0.0, 1e-6)
        assert abs(float(exact.value) - float(found.value)) <= float(exact.error) + float(found.error)
        assert float(found.error) < 1e-5
        assert float(exact.error) < 1e-8


@functools.partial(jax.jit, static_argnums=(0, 1))
def integrated(digits, kind, alpha, eta, below, cosine):
    found = HalfVector(digits).integrate(RoughDielectric(alpha, eta, kind).lit(below), cosine)
    return found.value, found.error


@pytest.mark.parametrize("kind", few(KINDS, ("ggx",)))
@pytest.mark.parametrize(
    ("alpha", "eta", "below", "cosine"),
    [(0.05, 1.5, 0.0, 0.3), (0.05, 2.5, 1.0, 0.93), (0.3, 1.5, 1.0, 0.745), (1.0, 1.1, 0.0, 0.05), (1.0, 2.5, 1.0, 0.6)],
)
def test_error_bar_of_the_facet_rule(kind, alpha, eta, below, cosine):
    """Against the same integral with two thirds more digits, near the critical angle (0.745 for 1.5) too."""
    place = (kind, alpha, eta, below, cosine)
    (usual, error), (finer, _) = integrated(9.6, *place), integrated(15.9, *place)
    assert abs(float(usual) - float(finer)) <= float(error) < 1e-8


@pytest.mark.parametrize("kind", few(KINDS, ("ggx",)))
def test_furnace_closes_up_to_masking(kind):
    """R + T = 1 - what masking loses: smooth facets lose nothing, rough ones some, none gain."""
    for cosine in (1.0, 0.8, 0.5):  # along the normal, too, where the circles about it are no circles about the light
        assert float(albedo(RoughDielectric(1e-3, 1.5, kind).lit(), cosine).value) == pytest.approx(1, abs=1e-5)
        for below in (0.0, 1.0):
            assert 0.5 < float(albedo(RoughDielectric(0.6, 1.5, kind).lit(below), cosine).value) < 1 - 1e-4


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("eta", [1.5, 0.75])
def test_reciprocity_on_the_whole_sphere(kind, eta):
    random = np.random.default_rng(1)
    wi, wo = normalised(random.normal(size=(2, 4000, 3)))
    surface = RoughDielectric(0.4, eta, kind)
    (plain, there), (swapped, back) = (map(np.asarray, values(surface, *pair)) for pair in ((wi, wo), (wo, wi)))
    np.testing.assert_allclose(there, back, rtol=1e-9, atol=1e-12)
    through = wi[:, 2] * wo[:, 2] < 0
    assert np.count_nonzero(there[through]) > 200
    assert not np.allclose(plain[through], swapped[through])


@needs_mitsuba
@pytest.mark.parametrize("kind", few(KINDS, ("beckmann",)))
def test_rough_dielectric_is_mitsubas(kind):
    """Values to 1e-5. Of Beckmann's masking Mitsuba has Walter's rational fit, put in here in place of the exact one."""
    words = f'mitsuba:{{"type": "roughdielectric", "distribution": "{kind}", "int_ior": 1.5, "ext_ior": 1.0}}'
    family, alpha, random = load(words, alpha=(0.3, 0.3)), 0.3, np.random.default_rng(0)
    surface = RoughDielectric(alpha, 1.5, kind)

    def masking(z: np.ndarray) -> np.ndarray:
        top, bottom = surface.facets.shadowing(jnp.asarray(np.abs(z)))
        return np.abs(z) * np.asarray(top / bottom)

    def fitted(z: np.ndarray) -> np.ndarray:
        a = np.abs(z) / np.sqrt(1 - z**2) / alpha
        return np.where(a >= 1.6, 1.0, (3.535 * a + 2.181 * a**2) / (1 + 2.276 * a + 2.577 * a**2))

    for below in (0.0, 1.0):
        theirs = family.build(below=below)
        wi, wo = normalised(random.normal(size=(2, 400, 3)))
        wi[:, 2] = np.abs(wi[:, 2]) * (1 - 2 * below)
        theirs.plugin.put(theirs._values)
        expected = theirs.plugin.cosine_values(wi, wo, 1)[:, 0]
        ours = np.asarray(values(surface, wi, wo)[0]) * np.abs(wo[:, 2])
        if kind == "beckmann":
            ours = ours * fitted(wi[:, 2]) * fitted(wo[:, 2]) / (masking(wi[:, 2]) * masking(wo[:, 2]))
        np.testing.assert_allclose(ours, expected, rtol=1e-5, atol=1e-5)
        if kind == "ggx":
            for cosine in (0.95, 0.4):
                total = adaptive_albedo(theirs, cosine, 0.0, 1e-5, slow=True)
                assert float(albedo(surface.lit(below), cosine).value) == pytest.approx(float(total.value), abs=1e-5)


def test_smooth_boundary_is_fresnels_on_both_sides():
    surface, cosines = SmoothDielectric(1.5), np.linspace(0, 1, 41)
    for below, ratio in ((0.0, 1.5), (1.0, 1 / 1.5)):
        reflected, passing = weights(surface, jnp.asarray(cosines), jnp.asarray(below))
        np.testing.assert_allclose(reflected, fresnel(cosines, ratio), atol=1e-14)
        np.testing.assert_allclose(reflected + passing, 1, atol=1e-15)
    # A ray and the one it is refracted to see the same boundary.
    inner = np.sqrt(1 - (1 - 0.4**2) / 1.5**2)
    outside, inside = (np.array(weights(surface, *map(jnp.asarray, ray))) for ray in ((0.4, 0.0), (inner, 1.0)))
    assert outside[0] == pytest.approx(inside[0])
    np.testing.assert_allclose(shares(surface, 0.4), outside, rtol=1e-12)


@pytest.mark.parametrize(("index", "clear"), [(1.5, 1.0), (1.5, 0.8), (1 / 1.3, 0.5), (1.5, 0.0)])
def test_thin_sheet_sums_its_reflections(index, clear):
    """Ray by ray: what leaves the pane above and below after each crossing."""
    sheet = ThinSheet(index, clear)
    for cosine in (1.0, 0.7, 0.3, 0.0):
        share = float(fresnel(np.array(cosine), index))
        inside = 1 - (1 - cosine**2) / index**2
        left = clear ** (1 / np.sqrt(inside)) if inside > 0 and clear else 0.0
        reflected, passing, ray = share, 0.0, 1 - share
        for _ in range(400):
            ray *= left
            passing, ray = passing + ray * (1 - share), ray * share * left
            reflected, ray = reflected + ray * (1 - share), ray * share
        np.testing.assert_allclose(np.array(sheet.weights(jnp.asarray(cosine))), (reflected, passing), atol=1e-12)


def test_matte_sheet():
    sheet = LambertTransmission(0.2, 0.7)
    np.testing.assert_allclose(shares(sheet, 0.3), (0.2, 0.7), rtol=1e-12)
    up, down = np.array([[0.0, 0, 1]]), np.array([[0.6, 0, -0.8]])
    assert float(sheet(up, down)[0]) == pytest.approx(0.7 / np.pi)
    assert float(sheet(up, up)[0]) == pytest.approx(0.2 / np.pi)
    assert not check(LambertTransmission(0.4, 0.7)).passed


def test_fold_keeps_energy_whatever_the_index():
    """A constant on the lower hemisphere integrates to pi, by the mirror image or by the fold along refraction."""
    for eta, scale, factor in ((1.5, "flux", 1.0), (0.6, "flux", 1.0), (1.5, "radiance", 1.5**2)):
        sheet = bsdf(lambda wi, wo: np.where(wi[..., 2] * wo[..., 2] < 0, 1 / np.pi, 0), eta=eta, scale=scale)
        for cosine in (1.0, 0.6, 0.05):
            found = adaptive_albedo(sheet.lit(0.0), cosine, 0.4, 1e-7, slow=True)
            assert float(found.value) == pytest.approx(factor, abs=2e-7)


@brdfcheck.bsdf(eta=1.0)
def paper(wi, wo, through):
    return jnp.where(wi[..., 2] * wo[..., 2] < 0, through, 1 - through) / jnp.pi


@pytest.mark.slow
def test_a_function_with_parameters_is_checked_on_both_sides():
    report = check(paper, through=(0.0, 1.0), effort="quick")
    assert report.verdict is Verdict.CONSERVES
    assert report.passed
    assert dict(report.ranges) == {"through": (0.0, 1.0), "below": (0.0, 1.0)}
    sides = next(found for found in report.checks if found.name == "sides")
    assert sides.value == pytest.approx(1, abs=1e-6)
    assert any(note.startswith("light from above: R = ") and "from below: R = " in note for note in report.notes)


@pytest.mark.slow
def test_the_scale_decides():
    """Walter's formula, wi the light, is in the scale of flux; with the two exchanged it is what an eye's ray sees."""
    lobe = RoughDielectric(0.3, 1.5)
    right = check(bsdf(lambda wi, wo: lobe(wo, wi), eta=1.5, scale="radiance"), below=(0.0, 0.0), effort="quick")
    exact = float(albedo(lobe.lit(), 1.0).value)
    assert right.passed
    assert right.albedo == pytest.approx(exact, abs=1e-6)
    assert dict(right.ranges) == {"below": (0.0, 0.0)}
    wrong = check(bsdf(lambda wi, wo: lobe(wi, wo), eta=1.5, scale="radiance"), below=(0.0, 0.0), effort="quick")
    assert wrong.verdict is Verdict.VIOLATES
    assert wrong.albedo == pytest.approx(shares(lobe, 1.0) @ np.array([1, 1.5**2]), abs=1e-5)
    assert any(text.startswith("not reciprocal: f(wi, wo) / eta_o^2") for text in wrong.findings)


@pytest.mark.slow
def test_what_comes_from_below_is_looked_at():
    """Conserves from above, not from below."""

    def sheet(wi, wo):
        return jnp.where(wi[..., 2] < 0, 1.2, 0.5) / (2 * jnp.pi)

    report = check(bsdf(sheet), effort="quick")
    assert report.verdict is Verdict.VIOLATES
    assert report.albedo == pytest.approx(1.2, abs=1e-7)
    assert report.parameters["below"] == 1
    assert any("not reciprocal" in text for text in report.findings)


@pytest.mark.slow
def test_theorem():
    report = check("rough-dielectric-ggx", alpha=(0.4, 0.6), eta=(1.5, 1.5), effort="quick")
    assert (report.basis, report.passed) == ("proof", True)
    assert "reflects and transmits" in (report.theorem or "")


def test_premises_of_the_theorem():
    for kind in KINDS:
        assert RoughDielectric(0.3, 1.5, kind).lit().bounded
    assert SmoothDielectric(1.5).lit(1.0).bounded
    assert not LambertTransmission(0.7, 0.7).lit().bounded


@pytest.mark.slow
def test_derivatives_are_those_of_differences():
    def total(alpha, eta, mu):
        return HalfVector().integrate(RoughDielectric(alpha, eta).lit(1.0), mu).value

    at, step = (0.4, 1.5, 0.6), 1e-4
    for place in range(3):
        slope = float(jax.grad(total, place)(*map(jnp.asarray, at)))
        ends = [float(total(*(jnp.asarray(x + sign * step * (i == place)) for i, x in enumerate(at)))) for sign in (1, -1)]
        assert slope == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: bsdf(lambda wi, wo: 0.0, eta=0.0), "eta must be a finite number > 0; got 0.0"),
        (lambda: bsdf(lambda wi, wo: 0.0, eta="glass"), "eta must be a finite number > 0; got 'glass'"),
        (lambda: bsdf(lambda wi, wo: 0.0, scale="power"), "scale must be one of flux, radiance; got 'power'"),
        (lambda: RoughDielectric(0.3, 1.0), "eta must not be 1: there is no boundary between equal media; got 1.0"),
        (lambda: RoughDielectric(0.0), "alpha must be finite and > 0; got 0.0"),
        (lambda: RoughDielectric(0.3, distribution="phong"), "distribution must be one of beckmann, ggx; got 'phong'"),
        (lambda: ThinSheet(1.5, 1.2), "transmittance must be finite and >= 0 and <= 1; got 1.2"),
        (lambda: RoughDielectric(0.3).lit(part="lost"), "part must be one of both, reflected, transmitted; got 'lost'"),
    ],
)
def test_bad_values(call, words):
    with pytest.raises(ValueError, match="must") as caught:
        call()
    assert str(caught.value) == words


def test_bad_sides_are_refused_in_one_line():
    with pytest.raises(UsageError, match=r"below is 0 \(light from above\), 1 \(from below\) or 0:1"):
        load("rough-dielectric-ggx", below=(0.2, 0.7))
    with pytest.raises(UsageError, match=r"below is 0 \(light from above\)"):
        load(paper, through=(0, 1), below=(0.5, 0.5))
    with pytest.raises(UsageError, match="has no parameter 'below'"):
        load(lambda wi, wo: wo[..., 2], below=(0, 1))
    with pytest.raises(TypeError, match="bsdf takes a function"):
        bsdf(3)
