"""Engine 1 against values that were computed independently, and the ways in which it must fail."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import LOBES, PHONG_POLYNOMIALS, brute_force, slope_at_normal, zonal_tables
from selection import few

from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lambert, Lyon, Phong, Schlick
from brdfcheck.numerics import gauss
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.polar import Order, graded_gauss
from brdfcheck.quadrature.zonal import zonal_weights

TABLES = zonal_tables()


# One of each lobe, and of each form; Lyon's are binomial powers.
FAST = ("phong", "blinn", "schlick_half", "kb", "binomial16_unclamped")


@pytest.mark.parametrize("name", few(LOBES, FAST))
def test_accuracy_and_honest_error_bar(name):
    table = TABLES[name]
    result = jax.vmap(albedo)(LOBES[name](table.n), jnp.asarray(table.cos_theta))
    error = np.abs(np.asarray(result.value) - table.albedo)
    assert np.max(error / table.albedo) <= (1e-13 if name in ("schlick", "kb_half") else 1e-12)
    assert np.all(error <= np.asarray(result.error))
    # An error bar that is always huge would be honest and useless.
    tight = 1e-12 if "unclamped" not in name else 1e-11
    assert np.max(np.asarray(result.error) / table.albedo) <= tight


@pytest.mark.parametrize("name", few(LOBES, ("binomial16_unclamped",)))
def test_looser_requests_are_honest_and_cheaper(name):
    table = TABLES[name]
    lobe = LOBES[name](table.n)
    costs = []
    for rtol in (1e-2, 1e-3, 1e-6, 1e-12):
        result = jax.vmap(lambda lobe, mu, rtol=rtol: albedo(lobe, mu, rtol=rtol))(lobe, jnp.asarray(table.cos_theta))
        error = np.abs(np.asarray(result.value) - table.albedo)
        assert np.max(error / table.albedo) <= rtol
        assert np.all(error <= np.asarray(result.error))
        costs.append(int(result.evaluations[0]))
    assert costs[0] < costs[1] < costs[2] < costs[3]


@pytest.mark.parametrize("name", few([name for name in LOBES if "unclamped" not in name], ("phong",)))
def test_float32(name):
    table = TABLES[name]
    keep = (table.n <= 1e5) & (table.cos_theta >= 1e-3)
    n, mu = (jnp.asarray(column[keep], jnp.float32) for column in (table.n, table.cos_theta))
    # The reference belongs to the float64 arguments; take those that float32 holds, moved by their own rounding.
    exact = jax.vmap(albedo)(LOBES[name](n.astype(jnp.float64)), mu.astype(jnp.float64)).value
    lobe = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), LOBES[name](n))
    result = jax.vmap(albedo)(lobe, mu)
    assert result.value.dtype == jnp.float32
    error = np.abs(np.asarray(result.value, float) - np.asarray(exact))
    relative = error / np.asarray(exact)
    assert np.median(relative) <= 1e-6
    assert np.max(relative) <= 1e-4
    assert np.all(error <= np.asarray(result.error, float))


@pytest.mark.parametrize("n", PHONG_POLYNOMIALS)
def test_phong_at_even_exponents_is_a_polynomial(n):
    mu = jnp.concatenate([jnp.zeros(1), jnp.geomspace(1e-8, 1, 60)])
    expected = PHONG_POLYNOMIALS[n](np.asarray(mu)) * 2 * np.pi / (n + 2)
    np.testing.assert_allclose(albedo(Phong(float(n)), mu).value, expected, rtol=1e-13)


@pytest.mark.slow
def test_lambert_reflects_its_reflectance_at_every_angle():
    mu = jnp.linspace(0, 1, 33)
    np.testing.assert_allclose(albedo(Lambert(0.7), mu).value, 0.7, rtol=1e-13)
    rgb = albedo(Lambert(jnp.array([0.1, 0.5, 0.9])), mu)
    assert rgb.value.shape == (33, 3)
    np.testing.assert_allclose(rgb.value, np.broadcast_to([0.1, 0.5, 0.9], (33, 3)), rtol=1e-13)


WIDE = ["phong", "blinn", "schlick_half", "kb", "lyon2", "binomial16_unclamped"]


@pytest.mark.slow
@pytest.mark.parametrize("name", WIDE)
def test_against_brute_force_over_the_outgoing_hemisphere(name):
    # Ties the albedo to the function f(wi, wo) that users call, not only to the reduced integral.
    lobe = LOBES[name](5.0)
    for mu in (0.9, 0.35):
        assert albedo(lobe, mu).value == pytest.approx(brute_force(lobe, mu), abs=2e-5)


def test_a_rule_fails_past_its_degree():
    x, w = gauss(6)
    for degree in range(12):
        assert np.sum(w * x**degree) == pytest.approx(1 / (degree + 1), rel=1e-14)
    assert np.sum(w * x**12) != pytest.approx(1 / 13, rel=1e-9)
    y, v = graded_gauss(40, 3, 4)
    assert np.sum(v) == pytest.approx(1, rel=1e-14)
    assert np.sum(v * y**1.5) == pytest.approx(1 / 2.5, rel=1e-12)


@pytest.mark.parametrize("count", [1, 2, 7, 34, 200])
def test_gauss_weights_have_all_their_digits(count):
    x, w = gauss(count)
    degree = 2 * count - 2
    # All of it rests on the outermost nodes, whose weights numpy has to 3e-13 for 34 nodes.
    for ends in (x, 1 - x):
        assert np.sum(w * ends**degree) == pytest.approx(1 / (degree + 1), rel=3e-16 * (1 + degree))
    assert np.sum(w) == pytest.approx(1, rel=4e-16)
    with pytest.raises(ValueError, match="read-only"):
        w[0] = 0


def test_too_few_nodes_are_noticed_by_the_error_bar():
    # A rule with 4 nodes for a lobe that needs 40: wrong by percents, and its bar says so.
    lobe = Schlick(1e5)

    @jax.jit
    def sums(lobe, mu):
        versine, weight = zonal_weights("mirror", mu, lobe.breaks(), lobe.width(), (Order(4, 4), Order(3, 3)))
        return weight @ lobe.profile(versine)

    few, fewer = np.asarray(sums(lobe, jnp.asarray(0.7)))
    exact = float(albedo(lobe, 0.7).value)
    assert abs(few / exact - 1) > 1e-3
    assert abs(few - fewer) >= abs(few - exact) / 3


SLOPES = {  # at normal incidence, by ball arithmetic
    "binomial-power-half": (BinomialPower(1.0), 0.8074859717),
    "blinn-phong-0.01": (BlinnPhong(0.01), 0.0114038988),
    "blinn-phong-10": (BlinnPhong(10.0), 2.3421695230),
    "lambert": (Lambert(0.7), 0.0),
    "a hemisphere": (Phong(0.0), np.pi / 2),  # E = pi (1 + mu) / 2
    **{f"phong-{n:g}": (Phong(n), 2 * np.pi / (n + 2)) for n in (0.05, 0.3, 1.0, 10.0, 1e5)},
}


def value(mu, lobe):
    return albedo(lobe, mu).value


# The lobe is an argument: those of one class are one program.
BACKWARDS, FORWARDS = jax.jit(jax.grad(value)), jax.jit(jax.jacfwd(value))


# Of the half form `test_rules` has one every time.
@pytest.mark.parametrize("kind", few(["Phong", "BinomialPower", "BlinnPhong", "Lambert"], ("Phong",)))
def test_the_derivative_at_normal_incidence_is_the_limit(kind):
    chosen = [(lobe, right) for lobe, right in SLOPES.values() if type(lobe).__name__ == kind]
    assert chosen
    for lobe, right in chosen:
        assert float(BACKWARDS(1.0, lobe)) == pytest.approx(right, rel=1e-9, abs=1e-10)
        assert float(FORWARDS(1.0, lobe)) == pytest.approx(right, rel=1e-9, abs=1e-10)
        single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), lobe)
        assert float(BACKWARDS(jnp.float32(1), single)) == pytest.approx(right, rel=2e-5, abs=1e-5)


STEEP = {
    f"{name}-{form}": build(form)
    for form in ("mirror", "half")
    for name, build in {
        "binomial-1": lambda form: BinomialPower(1.0, form=form),
        "unclamped": lambda form: BinomialPower(20.0, form=form, clamped=False),
        "kb-1": lambda form: KuijkBlake(1.0, form),
        "kb-0": lambda form: KuijkBlake(0.0, form),
        "lyon-2": lambda form: Lyon(6.0, 2, form),
        "schlick": lambda form: Schlick(0.0 if form == "mirror" else 5.0, form),
    }.items()
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STEEP)
def test_the_derivative_at_normal_incidence_is_the_slope_of_the_values(name):
    lobe = STEEP[name]
    right = slope_at_normal(lambda mu: value(mu, lobe))
    assert float(BACKWARDS(1.0, lobe)) == pytest.approx(right, rel=1e-7, abs=1e-7)
    # Nothing jumps on the way there.
    assert float(BACKWARDS(1 - 2.0**-53, lobe)) == pytest.approx(right, rel=1e-6, abs=1e-6)


HUGE_POWERS = [
    (BinomialPower(10.0, 2**31, "half"), 0.5, 0.652639530780980840),
    # The next test has this form each time.
    pytest.param(BinomialPower(10.0, 2**40, "mirror"), 1.0, 0.565489530207478883, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("lobe", "mu", "right"), HUGE_POWERS)
def test_huge_powers_keep_their_digits(lobe, mu, right):
    found = albedo(lobe, mu)
    assert abs(float(found.value) - right) <= float(found.error) <= 1e-13
    single = albedo(jax.tree.map(lambda leaf: leaf.astype(jnp.float32), lobe), np.float32(mu))
    assert abs(float(single.value) - right) <= float(single.error) <= 1e-4


@pytest.mark.parametrize("form", few(["mirror", "half"], ("mirror",)))
@pytest.mark.parametrize("power", few([1, 3, 5, 6, 7, 10, 14, 21, 31, 40, 53], (53,)))
def test_bars_of_any_power_contain_the_closed_form(power, form):
    # At normal incidence, for lobes that end inside: (1 - v/e)^k with e = k/n times a polynomial in v.
    k = 2**power
    n = np.geomspace(4, 1e6, 40)
    n = n[n * (1.0 if form == "mirror" else 1 - np.sqrt(0.5)) > k] if k < 1e7 else n[n > 200]
    if not n.size:
        n = np.array([8.0 * k])
    e = k / n
    # int (1 - v/e)^k v^j dv = e^(j+1) j! k!/(k+j+1)!, the reciprocal of (k+1)...(k+j+1).
    moments, share = [], np.ones_like(e)
    for j in range(4):
        share = share * e * max(j, 1) / (k + j + 1)
        moments.append(share)
    coefficients = 2 * np.pi * np.array([1, -1]) if form == "mirror" else 8 * np.pi * np.array([1, -5, 6, -2])
    right = sum(c * part for c, part in zip(coefficients, moments, strict=False))
    found = jax.vmap(lambda n: albedo(BinomialPower(n, k, form), 1.0))(jnp.asarray(n))
    # Beyond the end the integral goes on for the largest powers: by exp(-n) and less.
    assert np.all(np.abs(np.asarray(found.value) - right) <= np.asarray(found.error))
    assert np.all(np.asarray(found.error) <= 1e-12 * right)
