"""Tables: the same numbers as cell by cell, in one program, with bars that hold."""

from __future__ import annotations

import math
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from brdfcheck import Factor, Family, Normalized, albedo, albedo_table, load
from brdfcheck.brdf import catalog
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lambert, Lyon, Phong, Schlick
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.quadrature import tables
from brdfcheck.quadrature.half_vector import HalfVector
from brdfcheck.quadrature.zonal import Zonal

FAMILIES = {
    "phong": Phong,
    "blinn-phong": BlinnPhong,
    "schlick": Schlick,
    "schlick-half": lambda n: Schlick(n, "half"),
    "binomial-power": BinomialPower,
    "binomial-power-mirror": lambda n: BinomialPower(n, form="mirror"),
    "lyon-2": lambda n: Lyon(n, 2),
    "kuijk-blake": KuijkBlake,
    "unclamped": lambda n: BinomialPower(n, clamped=False),
    "factor": lambda n: Normalized(BlinnPhong(n), Factor(6, 25)),
}


@pytest.mark.parametrize("name", few(FAMILIES, ("unclamped",)))
@pytest.mark.parametrize("n", few([np.geomspace(1, 1000, 150), np.linspace(1, 40, 20)], (150,), len))
def test_a_table_is_its_cells(name, n):
    mu = np.array([1.0, 0.9, 0.5, 0.1, 0.02, 1e-4, 0.0])
    table = albedo_table(FAMILIES[name], n, mu)
    assert table.value.shape == table.error.shape == (len(n), len(mu))
    for i in (0, 1, len(n) // 2, len(n) - 1):
        row = albedo(FAMILIES[name](n[i]), mu)
        error = np.abs(np.asarray(table.value[i]) - np.asarray(row.value))
        assert np.max(error / np.asarray(row.value)) <= (1e-12 if name != "unclamped" else 1e-10)
        assert np.all(error <= np.asarray(table.error[i]))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["phong", "blinn-phong", "schlick", "binomial-power"])
def test_wide_ranges(name):
    n = np.geomspace(0.01 if "phong" in name else 1, 1e7, 400)
    mu = np.append(np.geomspace(1e-6, 1, 7), 0.3)
    table = albedo_table(FAMILIES[name], n, mu)
    for i in (0, 57, 133, 201, 399):
        row = np.asarray(albedo(FAMILIES[name](n[i]), mu).value)
        error = np.abs(np.asarray(table.value[i]) - row)
        assert np.max(error / row) <= 1e-12
        assert np.all(error <= np.asarray(table.error[i]))


@pytest.mark.parametrize("name", few(["phong", "lyon-2-half", "cook-torrance"], ("phong", "cook-torrance")))
def test_a_table_by_name_is_compiled_once(name, monkeypatch):
    traced = []
    monkeypatch.setattr(tables, "_block", lambda *given, original=tables._block: traced.append(1) or original(*given))
    for engine in (Zonal, HalfVector):
        one = engine.integrate
        monkeypatch.setattr(engine, "integrate", lambda *given, one=one: traced.append(1) or one(*given))
    mu = np.array([0.2, 0.3, 0.9])
    albedo_table(name, [1.0, 1.2, 1.9], mu)
    first = len(traced)
    albedo_table(name, [1.0, 1.3, 1.8], mu)
    assert len(traced) == first > 0


@pytest.mark.slow
def test_other_families():
    rough = albedo_table(GGX, np.array([0.1, 0.5]), np.array([1.0, 0.3]))
    assert rough.engine == "half-vector"
    np.testing.assert_allclose(rough.value[1], albedo(GGX(0.5), np.array([1.0, 0.3])).value, rtol=1e-10)
    flat = albedo_table(lambda k: Lambert(jnp.stack([k, 0.5 * k])), np.array([0.2, 1.0]), np.array([0.4]))
    assert flat.value.shape == (2, 1, 2)
    np.testing.assert_allclose(flat.value[:, 0], [[0.2, 0.1], [1.0, 0.5]], rtol=1e-12)
    named = albedo_table("phong", np.array([3.0]), np.array([1.0]))
    np.testing.assert_allclose(named.value, 1, rtol=1e-13)
    function = albedo_table(lambda n: lambda wi, wo: Phong(n)(wi, wo), np.array([3.0]), np.array([0.7, 1.0]))
    assert function.engine == "adaptive"
    np.testing.assert_allclose(function.value[0], albedo(Phong(3.0), np.array([0.7, 1.0])).value, atol=1e-7)


@pytest.mark.parametrize(
    ("n", "mu", "message"),
    [
        ([], [1.0], "n must"),
        ([1.0], [], "cos_theta"),
        ([-1.0], [1.0], "-1"),
        ([np.nan], [1.0], "nan"),
        ([[1.0]], [1.0], "shape"),
    ],
)
def test_bad_axes_are_refused(n, mu, message):
    with pytest.raises(ValueError, match=message):
        albedo_table(Phong, n, mu)


@pytest.mark.parametrize("cores", few([2, 3], (3,)))
@pytest.mark.parametrize(
    "family",
    [
        pytest.param(Phong, id="nodes", marks=pytest.mark.slow),
        pytest.param(lambda n: Lyon(n, 2), id="breaks"),
        pytest.param(CookTorrance, id="cells", marks=pytest.mark.slow),
    ],
)
def test_threads_change_nothing(monkeypatch, family, cores):
    """Columns shared out among threads, the last part overlapping the one before."""
    n = np.geomspace(1, 900, 11) if family is not CookTorrance else np.array([0.2, 0.6])
    mu = np.linspace(0.02, 1, 11)
    monkeypatch.setattr(tables, "_LEAST", 1)
    monkeypatch.setattr(tables, "available_cores", lambda: range(1))
    alone = albedo_table(family, n, mu)
    used = []
    monkeypatch.setattr(tables, "available_cores", lambda: range(cores))
    pool = tables.threads(cores, tables._COLUMNS)
    original = pool.submit
    monkeypatch.setattr(pool, "submit", lambda run, piece: used.append(piece.size) or original(run, piece))
    albedo_table(family, n, mu)  # compiles
    together = albedo_table(family, n, mu)
    assert len(used) == cores - 1  # one share is done by the caller's own thread
    np.testing.assert_allclose(together.value, alone.value, rtol=4e-15)
    np.testing.assert_allclose(together.error, alone.error, rtol=1e-2, atol=1e-15)
    assert together.evaluations == alone.evaluations


@pytest.mark.slow
def test_threads_keep_the_callers_precision(monkeypatch):
    monkeypatch.setattr(tables, "_LEAST", 1)
    monkeypatch.setattr(tables, "available_cores", lambda: range(2))
    mu = np.array([0.1, 0.7])
    with jax.enable_x64(False):
        for _ in range(2):
            assert albedo_table(Phong, [1.0, 4.0], mu).value.dtype == jnp.float32
    assert albedo_table(Phong, [1.0, 4.0], mu).value.dtype == jnp.float64


def elements(program):
    """Elements that a traced program without open loops computes, by primitive; loops as often as they run."""
    total = Counter()
    for equation in program.eqns:
        parts = [getattr(part, "jaxpr", part) for part in equation.params.values()]
        inner = [part for part in parts if hasattr(part, "eqns")]
        assert equation.primitive.name != "while"
        for name, count in (pair for part in inner for pair in elements(part).items()):
            total[name] += count * equation.params.get("length", 1)
        if not inner:
            total[equation.primitive.name] += sum(math.prod(variable.aval.shape) for variable in equation.outvars)
    return total


# Elements of exp and log in the traced program of a table of 1,000 x 90 cells, a cell, with nodes, error estimate and
# interpolation: counted, not timed. What is aimed at is the time of 40 exps a cell.
@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("phong", 20),
        ("blinn-phong", 20),
        ("schlick-mirror", 2),
        ("binomial-power-half", 3),
    ],
)
def test_few_exps_a_cell(name, most):
    n, mu = np.geomspace(1, 1000, 1000), np.linspace(1 / 90, 1, 90)
    family = catalog.exponent_family(name)
    plan = tables._plan(tables._structure(family, np.dtype(float)).core)
    blocks = tables._blocks(n, plan)
    traced = jax.make_jaxpr(lambda mu: tables._shared_nodes(family, plan, jnp.asarray(n), blocks, mu))(jnp.asarray(mu))
    count = elements(traced.jaxpr)
    functions = sum(count[part] for part in ("exp", "exp2", "expm1", "log", "log1p", "pow"))
    assert 0.3 < functions / n.size / mu.size <= most
    assert sum(count[part] for part in ("sin", "cos", "tan", "atan2", "acos", "asin", "erf")) / n.size / mu.size <= 3


def test_what_check_takes_by_name_a_table_takes(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("import brdfcheck\n\ndef glossy(m):\n    return brdfcheck.catalog.entry('phong').family.build(n=m)\n")
    found = albedo_table(f"{path}:glossy", [1.0, 10.0], [1.0, 0.5])
    family = load(f"{path}:glossy", m=(1, 10))
    wanted = albedo_table("phong", [1.0, 10.0], [1.0, 0.5])
    for table in (found, albedo_table(family, [1.0, 10.0], [1.0, 0.5])):
        np.testing.assert_allclose(table.value, wanted.value, rtol=1e-12)
    with pytest.raises(ValueError, match="has 0 parameters; a table needs exactly one"):
        albedo_table(Family("flat", lambda: None), [1.0], [1.0])
    with pytest.raises(KeyError, match="unknown BRDF 'nope'"):
        albedo_table("nope", [1.0], [1.0])
