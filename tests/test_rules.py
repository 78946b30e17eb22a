"""Every rule against integrals with known values: accuracy, honest claims, counts, randomness, precision, derivatives."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from problems import LOBES, PHONG_POLYNOMIALS, facet_lobe, facet_tables, zonal_tables
from selection import few

import brdfcheck.quadrature
from brdfcheck.brdf.base import AbstractMicrofacetLobe, AbstractZonalLobe, core_of
from brdfcheck.brdf.factors import BlinnPhongExact, Normalized, PhongExact
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lambert, Phong
from brdfcheck.brdf.microfacet import CookTorrance
from brdfcheck.quadrature import RULES, closed_form, functions, half_vector, product, sampling, warped, zonal
from brdfcheck.quadrature import rule as rules
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.closed_form import ClosedForm, phong_albedo

KEY = jax.random.key(7)
TRACED = {name: rule for name, rule in RULES.items() if not rule.on_host}
# A setting at which a rule is good for `within` (relative) on smooth lobes.
GOOD = {
    "uniform-monte-carlo": (2**14, 0.1),
    "cosine-monte-carlo": (2**14, 0.1),
    "lobe-monte-carlo": (2**14, 0.05),
    "sobol": (2**12, 1e-3),
    "r2-lattice": (2**12, 5e-3),
    "midpoint-product": (64, 1e-3),
    "gauss-product": (48, 1e-9),
    "lobe-warped-gauss": (64, 2e-3),
    "tanh-sinh": (4, 1e-9),
    "adaptive": (1e-9, 1e-9),
    "zonal": (12, 1e-13),
    "half-vector": (9, 1e-9),
    "closed-form": (64, 1e-13),
}


def value_of_phong(n: int, mu: float) -> float:
    """From the table of polynomials, no quadrature at all."""
    return float(PHONG_POLYNOMIALS[n](np.float64(mu))) * 2 * np.pi / (n + 2)


SLOPES = facet_tables()["beckmann", "smith-correlated", 1.0]
WIDEST = int(np.argmax(np.where(SLOPES.cos_theta < 0.8, SLOPES.m, 0)))
# name: (BRDF, cos theta, known value)
PROBLEMS = {
    "phong 6": (Phong(6.0), 0.4, value_of_phong(6, 0.4)),
    "blinn-phong at normal incidence": (Normalized(BlinnPhong(7.0), BlinnPhongExact()), 1.0, 1.0),
    "beckmann": (
        facet_lobe("beckmann", "smith-correlated", 1.0)(SLOPES.m[WIDEST]),
        float(SLOPES.cos_theta[WIDEST]),
        float(SLOPES.albedo[WIDEST]),
    ),
}


@functools.cache
def compiled(name: str, setting: object):
    return eqx.filter_jit(lambda brdf, mu, key: RULES[name](setting)(brdf, mu, key=key))


def run(name: str, setting: object, brdf: object, mu: float, key: object = None):
    rule = RULES[name]
    if key is None and rule.random:
        key = KEY
    if rule.on_host:
        return rule(setting)(brdf, mu, key=key)
    return compiled(name, setting)(brdf, jnp.asarray(mu), key)


def test_every_family_of_the_registry_is_there_and_tested():
    assert list(RULES) == list(GOOD)
    families = {"montecarlo", "quasi-montecarlo", "product", "warped", "adaptive", "zonal", "half-vector", "closed-form"}
    assert {rule.family for rule in RULES.values()} == families
    assert brdfcheck.quadrature.RULES is RULES
    assert "RULES" in dir(brdfcheck.quadrature)
    with pytest.raises(AttributeError, match="no attribute 'rule_book'"):
        brdfcheck.quadrature.rule_book  # noqa: B018


def test_a_rule_knows_nothing_of_lobes():
    """But the closed forms."""
    for path in set(Path(brdfcheck.quadrature.__file__).parent.glob("*.py")) - {Path(closed_form.__file__)}:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert node.module not in ("brdfcheck.brdf.lobes", "brdfcheck.brdf.microfacet"), path.name


@pytest.mark.parametrize("name", RULES)
def test_ladders_rise_and_settings_are_fields(name):
    rule = RULES[name]
    made = [rule(setting) for setting in rule.ladder]
    assert [one.setting for one in made] == list(rule.ladder)
    assert len(set(made)) == len(made)
    assert made[0].setting_name in ("samples", "points", "order", "level", "digits", "tolerance", "roundings")
    assert rule().name == name


# One rule of each family is tried each time, and the one that samples the lobe; the one for facets on those, too.
TRIED = [(name, problem) for name in RULES for problem in PROBLEMS]
REPEATING = ("uniform-monte-carlo", "r2-lattice", "midpoint-product", "lobe-warped-gauss")
EACH_TIME = {f"{name}-phong 6" for name in RULES if name not in REPEATING} | {"half-vector-beckmann"}


@pytest.mark.parametrize("tried", few(TRIED, EACH_TIME, "-".join))
def test_value_and_claim(tried):
    name, problem = tried
    brdf, mu, expected = PROBLEMS[problem]
    setting, within = GOOD[name]
    rule = RULES[name](setting)
    if not rule.takes(brdf, mu):
        core = core_of(brdf)
        offered = {"zonal": AbstractZonalLobe, "half-vector": AbstractMicrofacetLobe}
        assert name == "closed-form" or not isinstance(core, offered[name])
        with pytest.raises(TypeError, match=f"{name} needs"):
            rule(brdf, mu)
        return
    found = run(name, setting, brdf, mu)
    if problem == "beckmann" and np.isinf(found.error):
        within = max(within, 1e-2)  # not smooth at the horizon
    error = abs(float(found.value) - expected)
    assert error <= within * expected
    assert error <= float(found.error) * (4 if rule.random else 1) + 1e-14
    assert found.value.dtype == found.error.dtype == jnp.float64
    assert int(found.status) == rules.OK
    assert rules.MESSAGES[int(found.status)] == "ok"


def test_phong_in_closed_form_at_every_exponent_and_angle():
    table = zonal_tables()["phong"]
    batch = jax.jit(jax.vmap(phong_albedo))
    rows = len(table.n)
    values = batch(jnp.asarray(table.n), jnp.asarray(table.cos_theta))
    assert table.n.max() >= 1e6
    assert np.max(np.abs(np.asarray(values) / table.albedo - 1)) < 3e-15
    for n, polynomial in PHONG_POLYNOMIALS.items():
        mu = jnp.linspace(0, 1, rows)  # as many: the same program
        scaled = batch(np.full(rows, float(n)), mu) * (n + 2) / (2 * np.pi)
        assert np.max(np.abs(scaled - polynomial(np.asarray(mu)))) < 1e-15
    single = batch(jnp.asarray(table.n, jnp.float32), jnp.asarray(table.cos_theta, jnp.float32))
    assert single.dtype == jnp.float32
    assert np.max(np.abs(np.asarray(single) / table.albedo - 1)) < 5e-6


@pytest.mark.parametrize("name", ["kb", "schlick_half", "lyon2", "binomial16_unclamped", "blinn"])
def test_closed_forms_at_normal_incidence_only(name):
    table = zonal_tables()[name]
    for n, expected in zip(table.n[table.cos_theta == 1], table.albedo[table.cos_theta == 1], strict=True):
        found = ClosedForm()(LOBES[name](n), 1.0)
        assert abs(float(found.value) - expected) <= float(found.error) <= 2e-14 * expected
        assert int(found.evaluations) == 0
    lobe = LOBES[name](3.0)
    assert ClosedForm().takes(lobe, 1.0)
    assert not ClosedForm().takes(lobe)
    assert not ClosedForm().takes(lobe, 0.5)
    with pytest.raises(TypeError, match="closed-form needs"):
        ClosedForm()(lobe, 0.5)
    # Under tracing nobody knows the angle: the status says what became of it.
    traced = jax.jit(lambda mu: ClosedForm()(lobe, mu))
    assert int(traced(1.0).status) == rules.OK
    beside = traced(0.5)
    assert int(beside.status) == rules.NOT_KNOWN
    assert np.isinf(beside.error)


def counted(monkeypatch, kind, method):
    """How many values each call of a method of a lobe gives from now on."""
    seen: list[int] = []
    original = getattr(kind, method)

    def counting(self, *arguments):
        value = original(self, *arguments)
        seen.append(value.size)
        return value

    monkeypatch.setattr(kind, method, counting)
    return seen


@pytest.mark.parametrize("name", [name for name in TRACED if name not in ("half-vector", "closed-form")])
def test_evaluations_are_counted_exactly(name, monkeypatch):
    rule, seen = RULES[name](RULES[name].ladder[1]), counted(monkeypatch, Phong, "profile")
    claimed = []
    jax.eval_shape(lambda mu: claimed.append(rule.integrate(Phong(5.0), mu, KEY if rule.random else None).evaluations), 0.6)
    assert sum(seen) == claimed[0] > 0  # traced, not run


def test_evaluations_of_the_rules_over_half_vectors_and_on_the_host_are_counted_exactly(monkeypatch):
    seen, claimed = counted(monkeypatch, CookTorrance, "facet_kernel"), []
    lobe = CookTorrance(0.5, masking="smith-separable")
    jax.eval_shape(lambda mu: claimed.append(half_vector.HalfVector(2).integrate(lobe, mu, None).evaluations), 0.5)
    assert sum(seen) == claimed[0]

    def function(wi, wo):
        wo = np.array(wo)  # numpy: no JAX program stands between
        rows.append(len(wo))
        return np.full(len(wo), 1 / np.pi)

    rows: list[int] = []
    found = functions.Adaptive(1e-4)(function, 0.5)
    assert sum(count for count in rows if count > 3) == int(found.evaluations)  # up to three: looked at beforehand


@pytest.mark.slow
def test_blocks_cover_fine_settings_and_bound_the_memory():
    lobe = Phong(10.0)
    expected = float(albedo(lobe, 0.7).value)
    for rule, within in ((product.GaussProduct(256), 1e-13), (sampling.Sobol(2**18), 1e-5)):
        found = jax.jit(lambda mu, rule=rule: rule(lobe, mu))(0.7)
        assert int(found.evaluations) > 2**16
        assert float(found.value) == pytest.approx(expected, rel=within)
    for name in ("cosine-monte-carlo", "lobe-monte-carlo"):
        fine, rough = run(name, 2**18, lobe, 0.7), run(name, 2**14, lobe, 0.7)
        assert abs(float(fine.value) - expected) < 4 * float(fine.error)
        assert float(fine.error) == pytest.approx(float(rough.error) / 4, rel=0.1)
    assert rules.block_count(100, 2**20) == 100


# Randomness.


@pytest.mark.parametrize("name", few([name for name, rule in RULES.items() if rule.random], ("cosine-monte-carlo", "sobol")))
def test_randomness_comes_from_the_key_alone(name):
    rule = RULES[name](256)
    lobe = BlinnPhong(10.0)
    with pytest.raises(ValueError, match=r"key=jax\.random\.key"):
        rule(lobe, 0.5)
    for wrong in (3, np.zeros(3), jax.random.split(KEY)):
        with pytest.raises(TypeError, match="key must be"):
            rule(lobe, 0.5, key=wrong)
    made = [jax.random.key(1), jax.random.key(1), jax.random.key(2), jax.random.PRNGKey(1)]
    first, again, other, raw = (compiled(name, 256)(lobe, jnp.array([0.5, 0.5]), key) for key in made)
    assert np.all(first.value == again.value)
    assert np.all(first.value != other.value)
    assert np.all(first.error == again.error)
    assert np.all(first.value == raw.value)
    # Different cosines of one request do not share their directions.
    assert first.value[0] != first.value[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, rule in RULES.items() if rule.random])
def test_the_error_of_random_rules_is_their_standard_error(name):
    keys = jax.random.split(KEY, 400)
    for brdf, mu in ((BlinnPhong(10.0), 0.7), (CookTorrance(0.5), 0.4))[: 2 if name == "lobe-monte-carlo" else 1]:
        found = eqx.filter_jit(jax.vmap(lambda key, brdf=brdf, mu=mu: RULES[name](512)(brdf, mu, key=key)))(keys)
        score = (np.asarray(found.value) - float(albedo(brdf, mu).value)) / np.asarray(found.error)
        # Eight shifts make a Student distribution of seven degrees of freedom.
        assert 0.8 < np.std(score) < (1.5 if name in ("sobol", "r2-lattice") else 1.2)
        assert abs(np.mean(score)) < 0.25


# Convergence.


def _errors(name: str, settings: tuple[int, ...], brdf: object, mu: float) -> np.ndarray:
    expected = float(albedo(brdf, mu).value)
    return np.array([abs(float(run(name, setting, brdf, mu).value) / expected - 1) for setting in settings])


@pytest.mark.slow
def test_orders_of_convergence():
    smooth = BlinnPhong(10.0)
    midpoint = _errors("midpoint-product", (32, 64), smooth, 0.7)
    assert np.log2(midpoint[0] / midpoint[1]) == pytest.approx(2, abs=0.05)
    gauss = _errors("gauss-product", (8, 16), smooth, 0.7)
    assert gauss[1] < gauss[0] / 100
    doubled = _errors("tanh-sinh", (2, 3), smooth, 0.7)
    assert doubled[1] < doubled[0] ** 1.5
    sobol = _errors("sobol", (2**8, 2**14), smooth, 0.7)
    assert sobol[1] < sobol[0] / 2**5  # random: 2^3
    # A kink takes the exponential convergence away: about second order is left.
    kinked = _errors("gauss-product", (32, 128), KuijkBlake(10.0), 0.7)
    assert 1e-9 < kinked[1] < kinked[0] < 1e-2


@pytest.mark.parametrize("degree", [5, 6])
def test_gauss_product_is_exact_to_its_degree_and_no_further(degree):
    # 3 nodes: exact for the degree 5 in N.wo, cosine included.
    found = product.GaussProduct(3)(lambda wi, wo: wo[..., 2] ** (degree - 1), 0.5)
    exact_value = 2 * np.pi / (degree + 1)
    assert (abs(float(found.value) - exact_value) < 1e-14) == (degree == 5)


# One signature: shapes, precision, tracing, derivatives.


@pytest.mark.parametrize("name", few(RULES, ("sobol", "gauss-product", "adaptive", "zonal", "half-vector", "closed-form")))
def test_arrays_of_cosines_and_channels(name):
    rule = RULES[name](RULES[name].ladder[min(2, len(RULES[name].ladder) - 1)])
    if name == "half-vector":
        brdf, expected = CookTorrance(0.5, jnp.array([1.0, 0.5, 0.0]), fresnel="schlick"), None
    else:
        brdf, expected = Lambert(jnp.array([0.2, 0.5, 1.0])), np.array([0.2, 0.5, 1.0])
    found = run(name, rule.setting, brdf, np.array([[0.3, 0.9]]))
    assert found.value.shape == found.error.shape == (1, 2, 3)
    assert found.evaluations.shape == found.status.shape == (1, 2)
    if expected is not None:
        assert np.max(np.abs(found.value / expected - 1)) < 0.5


@pytest.mark.parametrize("name", few(TRACED, ("sobol", "gauss-product", "lobe-warped-gauss", "zonal")))
def test_jit_vmap_and_one_compilation_for_all_exponents(name):
    setting = RULES[name].ladder[0]
    rule = RULES[name](setting)
    build = (lambda x: CookTorrance(1 / x, masking="smith-separable")) if name == "half-vector" else Phong
    traces = []

    def found(x, mu):
        traces.append(1)
        return rule(build(x), mu, key=KEY if rule.random else None).value

    program = jax.jit(jax.vmap(found))
    exponents, cosines = jnp.array([3.0, 30.0, 300.0]), jnp.array([0.9, 0.4, 1.0])
    values = program(exponents, cosines)
    program(exponents * 2, cosines / 2)
    assert len(traces) == 1
    assert np.all(np.isfinite(values))
    assert np.asarray(program(exponents[::-1], cosines[::-1])) == pytest.approx(np.asarray(values)[::-1], rel=1e-12)


@pytest.mark.parametrize("name", few(TRACED, ("tanh-sinh", "zonal", "half-vector")))
def test_single_precision_throughout(name):
    setting, within = GOOD[name]
    rule = RULES[name](setting)
    brdf = CookTorrance(np.float32(0.5)) if name == "half-vector" else Normalized(Phong(np.float32(20)), PhongExact())
    brdf = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), brdf)
    # A Python number takes the type of the lobe.
    found = eqx.filter_jit(lambda brdf: rule(brdf, 0.75, key=KEY if rule.random else None))(brdf)
    assert found.value.dtype == found.error.dtype == jnp.float32
    reference = float(albedo(CookTorrance(0.5) if name == "half-vector" else Normalized(Phong(20.0), PhongExact()), 0.75).value)
    assert float(found.value) == pytest.approx(reference, rel=max(2 * within, 5e-6))
    if not rule.random and name != "half-vector":
        assert abs(float(found.value) - reference) <= float(found.error)


_PHONG_SLOPES = jax.jit(jax.grad(phong_albedo, (0, 1)))


@pytest.mark.parametrize(
    "name",
    few([name for name in TRACED if name not in ("half-vector", "closed-form")], ("zonal",)),
)
def test_derivatives_in_the_exponent_and_the_angle(name):
    setting, within = GOOD[name]
    rule = RULES[name](min(setting, 2**12))
    slopes = jax.jit(jax.grad(lambda n, mu: rule(Phong(n), mu, key=KEY if rule.random else None).value, argnums=(0, 1)))
    for mine, theirs in zip(slopes(6.0, 0.4), _PHONG_SLOPES(6.0, 0.4), strict=True):
        assert float(mine) == pytest.approx(float(theirs), rel=max(within * 20, 1e-8), abs=0.1 * (within > 1e-2))
    for found in (slopes, _PHONG_SLOPES):
        assert np.all(np.isfinite(found(6.0, 1.0)))
        assert np.all(np.isfinite(found(6.0, 1e-4)))


@pytest.mark.parametrize("mode", few([jax.jacrev, jax.jacfwd], (jax.jacrev,)))
@pytest.mark.parametrize("name", few(TRACED, ("zonal", "closed-form")))
def test_derivatives_at_normal_incidence_are_the_limit(name, mode):
    setting, within = GOOD[name]
    rule = RULES[name](setting)
    lobe, right = {
        "half-vector": (CookTorrance(0.6, 0.5, masking="smith-correlated"), 0.0979796805),  # the slope of the values
        "closed-form": (Phong(6.0), np.pi / 4),
        "lobe-warped-gauss": (Phong(6.0), np.pi / 4),  # see its docstring
    }.get(name, (BlinnPhong(10.0), 2.3421695230))
    slope = jax.jit(mode(lambda mu: rule(lobe, mu, key=KEY if rule.random else None).value))
    for mu in (1.0, 1 - 2.0**-53):
        assert float(slope(mu)) == pytest.approx(right, rel=max(within, 1e-7))


@pytest.mark.slow
def test_closed_forms_know_their_derivatives_or_say_so():
    rule = ClosedForm()
    assert float(jax.grad(lambda mu: rule(Phong(0.0), mu).value)(1.0)) == pytest.approx(np.pi / 2, rel=1e-14)
    by_n, by_mu = jax.jit(jax.grad(lambda n, mu: rule(BinomialPower(n), mu).value, (0, 1)))(20.0, 1.0)
    expected = jax.grad(lambda n: albedo(BinomialPower(n), 1.0).value)(20.0)
    assert float(by_n) == pytest.approx(float(expected), rel=1e-10)
    assert np.isnan(by_mu)


@pytest.mark.slow
def test_derivatives_of_the_half_vector_rule():
    rule = half_vector.HalfVector(7)
    program = jax.jit(lambda m, mu: rule(CookTorrance(m, masking="smith-correlated"), mu).value)
    slopes = jax.jit(jax.grad(program, argnums=(0, 1)))(0.5, 0.4)
    step = 1e-4
    assert float(slopes[0]) == pytest.approx(float(program(0.5 + step, 0.4) - program(0.5 - step, 0.4)) / (2 * step), rel=1e-5)
    assert float(slopes[1]) == pytest.approx(float(program(0.5, 0.4 + step) - program(0.5, 0.4 - step)) / (2 * step), rel=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: product.GaussProduct(0), "order must be a whole number >= 1; got 0"),
        (lambda: product.MidpointProduct(2.5), "order must be a whole number"),
        (lambda: sampling.Sobol(1000), "points must be a power of 2; got 1000"),
        (lambda: sampling.R2Lattice(1001), "points must be a multiple of 8; got 1001"),
        (lambda: sampling.LobeMonteCarlo(100), "samples must be a multiple of 8; got 100"),
        (lambda: warped.TanhSinh(11), "level must be at most 10; got 11"),
        (lambda: functions.Adaptive(0), "tolerance must be a number between 0 and 1; got 0"),
        (lambda: zonal.Zonal()(Phong(3.0), 1.5), r"cos_theta must lie in \[0, 1\]; got 1.5"),
        (lambda: zonal.Zonal()(Phong(3.0), np.nan), "cos_theta must lie"),
        (lambda: zonal.Zonal()(Phong(3.0), "a"), "cos_theta must be real numbers"),
    ],
)
def test_wrong_arguments_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Where rules fail, and must.


def test_a_fixed_product_rule_loses_sharp_lobes():
    mu = float(np.cos(np.pi / 4))
    for n, loss in ((1e3, 0.022), (1e4, 0.970), (1e5, 1.0)):
        brdf = Normalized(Phong(n), PhongExact())
        found = run("gauss-product", 32, brdf, mu)
        assert 1 - float(found.value) / float(albedo(brdf, mu).value) == pytest.approx(loss, abs=2e-3)
        assert np.isinf(found.error)  # and claims nothing
        assert int(found.evaluations) == 32 * 64


@pytest.mark.parametrize(
    ("n", "nodes"), [pytest.param(10, 20, marks=pytest.mark.slow), (100, 60), pytest.param(1000, 184, marks=pytest.mark.slow)]
)
def test_schlicks_pole_asks_for_many_gauss_nodes(n, nodes):
    table = zonal_tables()["schlick"]
    row = np.flatnonzero((table.n == n) & (table.cos_theta == 1))
    expected = table.albedo[row[0]] if row.size else float(ClosedForm()(LOBES["schlick"](float(n)), 1.0).value)
    errors = [
        abs(float(run("gauss-product", count, LOBES["schlick"](float(n)), 1.0).value) / expected - 1)
        for count in (nodes, nodes // 2)
    ]
    assert errors[0] < 3e-10
    assert errors[1] > 1e-7
    assert abs(float(run("zonal", 12, LOBES["schlick"](float(n)), 1.0).value) / expected - 1) < 1e-12


def test_gauss_in_the_power_of_the_cosine_raises_a_false_alarm():
    found = run("lobe-warped-gauss", 64, Normalized(Phong(10.0), PhongExact()), 1.0)
    assert float(found.value) == pytest.approx(1.0000059128, abs=1e-9)
    # And a tail that is heavier than the density it was made for is lost.
    heavy = LOBES["schlick"](100.0)
    assert float(run("lobe-warped-gauss", 64, heavy, 1.0).value) < 0.8 * float(ClosedForm()(heavy, 1.0).value)


@pytest.mark.slow
def test_the_grazing_needle_is_missed_by_all_that_do_not_look_for_it():
    needle = CookTorrance(1 / 64, masking="smith-separable")
    known = 0.9136679212
    for name, setting in (("midpoint-product", 64), ("gauss-product", 64), ("sobol", 2**12), ("cosine-monte-carlo", 2**14)):
        assert float(run(name, setting, needle, 1 / 64).value) < 0.1
    missed = run("cosine-monte-carlo", 2**14, needle, 1 / 64)
    assert abs(float(missed.value) - known) > 100 * float(missed.error)  # the standard error knows nothing of it
    for name, setting, within in (("half-vector", 9, 1e-9), ("adaptive", 1e-8, 1e-8), ("tanh-sinh", 4, 1e-5)):
        found = run(name, setting, needle, 1 / 64)
        assert float(found.value) == pytest.approx(known, abs=within)
        assert abs(float(found.value) - known) <= float(found.error) + 1e-9
    followed = run("lobe-monte-carlo", 2**14, needle, 1 / 64)
    assert float(followed.value) == pytest.approx(known, abs=4 * float(followed.error))


@pytest.mark.slow
def test_the_adaptive_rule_says_when_it_is_not_done():
    found = functions.Adaptive(1e-12)(CookTorrance(0.3), 0.4)
    assert int(found.status) == rules.NOT_REACHED
    assert abs(float(found.value) - float(albedo(CookTorrance(0.3), 0.4).value)) <= float(found.error)
    broken = functions.Adaptive(1e-4)(lambda wi, wo: jnp.where(wo[..., 0] > 0.5, jnp.nan, 1.0), 0.4)
    assert int(broken.status) == rules.NOT_FINITE
    assert np.isinf(broken.error)
    overflow = product.GaussProduct(8)(lambda wi, wo: jnp.exp(1e4 * wo[..., 2]), 0.4)
    assert int(overflow.status) == rules.NOT_FINITE
    assert np.isinf(overflow.error)
