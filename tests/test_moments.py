"""Truncated powers from one function for each cosine: the same numbers as cell by cell, in all of its pieces."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import slope_at_normal

from brdfcheck import Factor, Normalized, albedo_table
from brdfcheck.brdf.lobes import BinomialPower, KuijkBlake, Lyon, Phong
from brdfcheck.quadrature.moments import MomentOrder, prepare, truncated_powers
from brdfcheck.quadrature.polar import Order
from brdfcheck.quadrature.zonal import zonal_weights

FAMILIES = {
    **{f"lyon-{w}-{form}": lambda n, w=w, form=form: Lyon(n, w, form) for w in (1, 2, 3) for form in ("half", "mirror")},
    "binomial-4": lambda n: BinomialPower(n, 4),
    "kuijk-blake": KuijkBlake,
    "kuijk-blake-half": lambda n: KuijkBlake(n, "half"),
}
FEW = ("lyon-1-mirror", "lyon-3-half", "kuijk-blake-half")
COSINES = np.array([1.0, 1 - 1e-12, 0.999, 0.9, 0.5, 0.2, 0.05, 1e-2, 3.1e-3, 2.9e-3, 1e-3, 1e-4, 1e-6, 0.0])


def cells(family, n, mu):
    """Each cell by a rule of its own, finer than that of `albedo`."""

    def cell(n, mu):
        lobe = family(n)
        versine, weight = zonal_weights(lobe.form, mu, lobe.breaks(), lobe.width(), (Order(140, 180),))
        return weight[0] @ lobe.profile(versine)

    rows = jax.jit(lambda n, mu: jax.lax.map(lambda n: jax.vmap(lambda mu: cell(n, mu))(mu), n))
    return np.asarray(rows(jnp.asarray(n), jnp.asarray(mu)))


def compare(family, n, mu, tolerance=1e-12):
    table = albedo_table(family, n, mu)
    value, bar = np.asarray(table.value), np.asarray(table.error)
    reference = cells(family, n, mu)
    error = np.abs(value - reference)
    assert np.all(np.isfinite(value))
    assert np.all(np.isfinite(bar))
    assert np.max(error / reference) <= tolerance
    assert np.all(error <= bar + 2e-14 * reference)  # the reference rounds too
    assert np.median(bar / value) <= 1e-12
    assert np.max(bar / value) <= 1e-10  # Kuijk-Blake's lobe of the half vector at n = 1e7 and grazing incidence
    return table


def kinks(name, mu):
    """Exponents at which an end of the lobe meets the kink or the end of the horizon."""
    theta = np.arccos(mu)
    low, high = np.pi / 4 - theta / 2, np.pi / 4 + theta / 2
    if "mirror" in name:
        low, high = np.pi / 2 - theta, [np.pi / 2]
    angles = np.concatenate([low, high])
    angles = angles[angles > 1e-3]
    if "kuijk" not in name:
        k = 4 if "binomial" in name else 2 ** int(name.split("-")[1])
        return k / (2 * np.sin(angles / 2) ** 2)
    angles = angles if name.endswith("half") else np.concatenate([np.pi / 2 - theta, [np.pi / 2]])
    angles = angles[(angles > 0.21) & (angles < 1.7)]
    second = (65 - 31.7 * angles) / (5 * angles - 1)  # q = angle
    b = 5.2 * angles - 1  # p = angle: angle n (0.09 n + 5.2) = n + 5.6
    first = (-b + np.sqrt(b * b + 4 * 0.09 * angles * 5.6)) / (2 * 0.09 * angles)
    return np.concatenate([first, second])


@pytest.mark.parametrize("name", FAMILIES)
def test_all_pieces(name):
    compare(FAMILIES[name], np.geomspace(1, 1000, 120), COSINES)


@pytest.mark.parametrize("name", FEW)
def test_ends_at_the_kinks(name):
    mu = COSINES[3:8]
    n = kinks(name, mu)
    n = n[(n >= 1) & (n <= 1e5)]
    n = np.concatenate([n, n * (1 + 1e-15), n * (1 - 1e-15), n * (1 + 1e-9), n * (1 - 1e-6)])
    assert len(n) >= 15
    compare(FAMILIES[name], n[n >= 1], np.append(mu, [1.0, 0.0]))


@pytest.mark.parametrize("name", FEW)
def test_wide_ranges_and_exponents_below_one(name):
    n = np.concatenate([[0.0, 1e-3, 0.4, 0.999999, 1.0, 1.000001], np.geomspace(2, 1e7, 100)])
    compare(FAMILIES[name], n, COSINES)


@pytest.mark.parametrize("name", ["lyon-1-half", "kuijk-blake"])
def test_random_cells(name):
    rng = np.random.default_rng(7)
    mu = np.append(rng.uniform(0, 1, 30), 10.0 ** rng.uniform(-6, 0, 20))
    compare(FAMILIES[name], np.exp(rng.uniform(0, np.log(2000), 60)), mu)


@pytest.mark.parametrize("n", [[7.0], [7.0, 7.0], [300.0, 2.0, 2.0, 40.0, 1.0]], ids=str)
def test_few_unsorted_and_repeated_exponents(n):
    for name in ("lyon-2-half", "kuijk-blake"):
        compare(FAMILIES[name], np.array(n), COSINES)


def test_factors_and_channels():
    n, mu = np.array([1.0, 9.0, 77.0]), np.array([0.8, 0.1])
    raw = albedo_table(lambda n: Lyon(n, 1), n, mu)
    wrapped = albedo_table(lambda n: Normalized(Lyon(n, 1), Factor(6, 25)), n, mu)
    np.testing.assert_allclose(wrapped.value, np.asarray(raw.value) * (n[:, None] + 6) / 25, rtol=1e-14)
    np.testing.assert_allclose(wrapped.error, np.asarray(raw.error) * (n[:, None] + 6) / 25, rtol=1e-10)


def test_one_program_for_all_exponents():
    traces = 0

    def family(n):
        nonlocal traces
        traces += 1
        return Lyon(n, 2)

    mu = np.array([0.3, 0.6])
    albedo_table(family, np.geomspace(1, 500, 11), mu)
    before = traces
    albedo_table(family, np.geomspace(2, 300, 11), mu)
    assert traces == before


def test_float32_is_still_cell_by_cell():
    mu = jnp.asarray([0.5, 0.1], jnp.float32)
    table = albedo_table(lambda n: Lyon(n, 1), np.array([2.0, 30.0]), mu)
    assert table.value.dtype == jnp.float32
    exact = albedo_table(lambda n: Lyon(n, 1), np.array([2.0, 30.0]), np.asarray(mu, float))
    np.testing.assert_allclose(table.value, exact.value, rtol=1e-5)


def test_a_lobe_is_its_truncated_powers():
    versine = jnp.linspace(0, 1, 50)
    angle = 2 * jnp.arcsin(jnp.sqrt(versine / 2))
    for family in FAMILIES.values():
        for n in (1.0, 6.0, 200.0):
            powers = family(n).truncated_powers()
            x = versine if powers.measure == "versine" else angle
            terms = powers.coefficients * jnp.maximum(1 - x[:, None] * powers.reciprocal_ends, 0) ** powers.power
            np.testing.assert_allclose(jnp.sum(terms, axis=1), family(n).profile(versine), atol=2e-15)
    assert Phong(3.0).truncated_powers() is None
    assert BinomialPower(3.0, 4, clamped=False).truncated_powers() is None


@pytest.mark.parametrize("form", ["mirror", "half"])
def test_without_an_end_it_is_the_hemisphere(form):
    """(1 - x/X)^k tends to 1: the projected solid angle, pi, or pi (1 + mu)/2 about the mirror direction."""
    orders = (MomentOrder(40, 12, 44, 6), MomentOrder(8, 10, 38, 12))
    ends = prepare(form, "versine", 2, jnp.array([0.0, 1.0]))
    rule = jax.jit(lambda mu: truncated_powers(form, "versine", 2, ends, mu, orders))
    for mu in COSINES:
        value, _, _ = rule(jnp.asarray(mu))
        np.testing.assert_allclose(value[0], np.pi if form == "half" else np.pi * (1 + mu) / 2, rtol=1e-13)


def test_too_few_intervals_are_admitted_by_the_bar():
    n, mu = jnp.geomspace(1, 1000, 200), jnp.asarray(0.2)
    ends = prepare("half", "versine", 2, n / 2)

    @functools.partial(jax.jit, static_argnums=0)
    def rule(orders):
        return truncated_powers("half", "versine", 2, ends, mu, orders)

    exact, _, _ = rule((MomentOrder(48, 12, 44, 6), MomentOrder(8, 10, 38, 12)))
    few_points = MomentOrder(12, 12, 44, 12), MomentOrder(4, 10, 38, 16)
    few_nodes = MomentOrder(40, 12, 8, 1), MomentOrder(8, 10, 6, 2)
    for orders in (few_points, few_nodes):
        value, relative, absolute = rule(orders)
        bar = relative * value + absolute
        error = np.abs(np.asarray(value - exact))
        assert np.max(error / exact) > 1e-9
        assert np.all(error <= np.asarray(bar) + 1e-13 * exact)


@pytest.mark.parametrize(
    ("form", "measure"), [("half", "angle"), ("half", "versine"), ("mirror", "angle"), ("mirror", "versine")]
)
def test_derivatives_at_normal_incidence(form, measure):
    # One end beyond the horizon, where the circles past it count, and one inside.
    ends = jnp.asarray([0.5, 5.0])
    orders = (MomentOrder(40, 12, 44, 6), MomentOrder(8, 10, 38, 12))

    @jax.jit
    def values(mu):
        return truncated_powers(form, measure, 2, prepare(form, measure, 2, ends), mu, orders)[0]

    forward = np.asarray(jax.jit(jax.jacfwd(values))(1.0))
    right = [slope_at_normal(lambda mu, end=end: np.asarray(jax.vmap(values)(mu))[:, end], 0.2) for end in (0, 1)]
    assert forward == pytest.approx(right, rel=1e-6)
    assert np.asarray(jax.jit(jax.jacrev(values))(1.0)) == pytest.approx(forward, rel=1e-12)
