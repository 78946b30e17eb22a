"""Functions of users: two ways to evaluate them, what is wrong with them, and whether they turn with the surface."""

from __future__ import annotations

import logging
import threading

import jax.numpy as jnp
import numpy as np
import pytest
from test_geometry import random_directions

from brdfcheck.brdf.blame import Finding
from brdfcheck.brdf.callables import ALIGNED, BLOCK, Evaluator, in_rows
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BlinnPhong, Phong
from brdfcheck.brdf.microfacet import GGX
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.verdict import check

WI, WO = random_directions(300, 1), random_directions(300, 2)


def traceable(n):
    return lambda wi, wo: jnp.exp(-n * (1 - wi[..., 2] * wo[..., 2]))


def wants_a_number(n):
    power = int(n)  # a tracer has no int
    return lambda wi, wo: (wi[..., 2] * wo[..., 2]) ** power


def plain_numpy(n):
    return lambda wi, wo: np.exp(-float(n) * (1 - np.asarray(wi)[..., 2] * np.asarray(wo)[..., 2]))


def scalar_logic(n):
    def brdf(wi, wo):
        return np.array([float(n) if a[2] > b[2] else 0.5 for a, b in zip(wi, wo, strict=True)])

    return brdf


# --- two paths ---


def test_one_program_serves_all_parameters():
    built = []

    def build(n):
        built.append(n)
        return traceable(n)

    evaluator = Evaluator(build, {"n": 1.0})
    assert not evaluator.slow
    for n in (0.5, 2.0, 30.0):
        np.testing.assert_allclose(evaluator.bind({"n": n})(WI, WO), traceable(n)(WI, WO), rtol=1e-14)
    assert len(built) <= 4  # three shapes to look at, and the program


def test_a_factory_that_needs_a_number_is_called_with_one():
    evaluator = Evaluator(wants_a_number, {"n": 2.0})
    assert evaluator.slow
    first, second = evaluator.bind({"n": 2.0}), evaluator.bind({"n": 3.0})
    for n, bound in ((2.0, first), (3.0, second), (2.0, evaluator.bind({"n": 2.0}))):
        np.testing.assert_allclose(bound(WI, WO), wants_a_number(n)(WI, WO), rtol=1e-14)


@pytest.mark.parametrize("build", [plain_numpy, scalar_logic])
def test_plain_numpy_is_slow_and_says_so(build, caplog):
    with caplog.at_level(logging.WARNING, logger="brdfcheck"):
        evaluator = Evaluator(build, {"n": 2.0})
    assert evaluator.slow
    assert f"{build.__name__} cannot be traced by JAX" in caplog.text
    for n in (2.0, 5.0, 2.0):
        np.testing.assert_array_equal(evaluator.bind({"n": n})(WI, WO), build(n)(WI, WO))


@pytest.mark.parametrize("rows", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 9000, 131073])
@pytest.mark.parametrize("build", [traceable, wants_a_number], ids=["program", "calls"])
def test_padding_does_not_show(build, rows):
    bound = Evaluator(build, {"n": 2.0}).bind({"n": 4.0})
    wi, wo = np.resize(WI, (rows, 3)), np.resize(WO, (rows, 3))
    found = bound(wi, wo)
    assert found.shape == (rows,)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, np.resize(bound(WI, WO), rows), rtol=1e-15)


def test_channels_constants_booleans_and_single_precision():
    rgb = Evaluator(lambda: lambda wi, wo: jnp.ones(3) * wo[..., 2:], {}).bind({})
    assert rgb(WI, WO).shape == (300, 3)
    constant = Evaluator(lambda: lambda wi, wo: 0.25, {}).bind({})
    np.testing.assert_array_equal(constant(WI, WO), np.full(300, 0.25))
    mask = Evaluator(lambda: lambda wi, wo: wo[..., 2] > 0.5, {}).bind({})
    np.testing.assert_array_equal(mask(WI, WO), (WO[:, 2] > 0.5) * 1.0)
    single = Evaluator(lambda: lambda wi, wo: jnp.asarray(wo[..., 2], jnp.float32), {}).bind({})
    assert single(WI, WO).dtype == np.float32  # says how far the values are rounded
    np.testing.assert_allclose(single(WI, WO), WO[:, 2], rtol=1e-7)
    nan = Evaluator(lambda: lambda wi, wo: jnp.where(wo[..., 2] > 0.5, jnp.nan, -1.0), {}).bind({})
    np.testing.assert_array_equal(nan(WI, WO), np.where(WO[:, 2] > 0.5, np.nan, -1.0))


# --- findings ---


def test_what_is_wrong_with_a_factory():
    with pytest.raises(Finding, match="returned int, which is not a function"):
        Evaluator(lambda n: 3, {"n": 1.0})

    def picky(n):
        if n > 5:
            raise ValueError("too large")
        return traceable(n)

    with pytest.raises(Finding, match=r"picky\(n=7\) raised ValueError: too large"):
        Evaluator(picky, {"n": 7.0})
    evaluator = Evaluator(picky, {"n": 2.0})
    assert evaluator.bind({"n": 5.0})(WI, WO).shape == (300,)
    with pytest.raises(Finding, match=r"picky\(n=6\) raised ValueError: too large"):
        evaluator.bind({"n": 6.0})(WI, WO)


def flattened(x):
    flat = x.reshape(-1)  # of arrays in the usual order a view
    flat[flat > 0.99] = 0.99
    return x


def bounded(wi, wo):
    return flattened(np.asarray(wo))[:, 2]


def test_numpy_gets_its_directions_component_by_component_where_it_takes_them():
    orders = set()

    def build(strict):
        def f(wi, wo):
            wi, wo = np.asarray(wi), np.asarray(wo)  # which JAX cannot trace
            if len(wi) > 1:
                orders.add(np.isfortran(wi))
            if strict and np.isfortran(wi):
                raise TypeError("expected C-contiguous arrays")
            return np.sum(wi * wo, axis=-1)

        return f

    values = []
    for strict in (False, True):
        bound = Evaluator(lambda strict=strict: build(strict), {}).bind({})
        orders.clear()
        values.append(bound(WI, WO))
        assert orders == {not strict}
    np.testing.assert_array_equal(*values)


def test_functions_of_numpy_may_call_themselves():
    def recursive(wi, wo, times=2):
        return np.asarray(wo)[:, 2] if times == 0 else 0.5 * recursive(wi, wo, times - 1)

    np.testing.assert_allclose(Evaluator(lambda: recursive, {}).bind({})(WI, WO), WO[:, 2] / 4)


def test_who_may_look_at_how_arrays_lie_gets_them_in_the_usual_order():
    up = np.tile([0.0, 0.0, 1.0], (300, 1))
    np.testing.assert_array_equal(Evaluator(lambda: bounded, {}).bind({})(WI, up), 0.99)


def test_a_function_that_fails_later():
    def late(wi, wo):
        if len(np.asarray(wi)) > 3:
            raise OSError("late")
        return np.ones(len(wi))

    bound = Evaluator(lambda: late, {}).bind({})
    with pytest.raises(Finding, match="raised OSError: late"):
        bound(WI, WO)


# --- sums over tables of directions ---


@pytest.mark.parametrize("build", [traceable, plain_numpy], ids=["program", "calls"])
@pytest.mark.parametrize("points", [1, 7, 130])
def test_sums_are_those_of_the_values(build, points):
    random = np.random.default_rng(points)
    tables = -(-points // 3)
    space = Evaluator(build, {"n": 1.0}).space(2 * tables)
    wo = in_rows(random_directions(2 * tables * BLOCK, 5), space)
    weight = random.uniform(0, 1, (tables, 2, 3, BLOCK))
    wi, turn = random_directions(points, 6), random.uniform(0, 2 * np.pi, points)
    n, which = np.sort(random.choice([0.5, 2.0, 30.0], points)), random.integers(0, tables, points)
    sums = Evaluator(build, {"n": 1.0}).sums(n[:, None], wi, turn, wo, weight, which, nothing_noted)
    assert sums.shape == (points, 2, 3, 1)
    for i in range(0, points, 9):
        c, s = np.cos(turn[i]), np.sin(turn[i])
        table = wo[:, 2 * which[i] : 2 * which[i] + 2]
        turned = np.einsum("ij,jbk->bki", [[c, -s, 0], [s, c, 0], [0, 0, 1]], table)
        values = np.asarray(build(n[i])(np.broadcast_to(wi[i], turned.shape), turned))
        np.testing.assert_allclose(sums[i, ..., 0], np.sum(weight[which[i]] * values[:, None], axis=-1), rtol=1e-12)


def test_rows_are_read_where_they_lie():
    # Others are copied before each call: a third of the time of a scan.
    space = Evaluator(traceable, {"n": 1.0}).space(3)
    assert [row.ctypes.data % ALIGNED for row in space[0, :3]] == [0, 0, 0]


@pytest.mark.parametrize(("tables", "blocks"), [(1, 600), (150, 4)])
def test_tables_may_have_more_rows_than_a_program_takes(tables, blocks):
    random = np.random.default_rng(tables)
    evaluator = Evaluator(traceable, {"n": 1.0})
    wo = in_rows(random_directions(blocks * tables * BLOCK, 5), evaluator.space(blocks * tables))
    weight = random.uniform(0, 1, (tables, blocks, 1, BLOCK))
    which = random.permutation(tables)[:40]
    wi, still = random_directions(len(which), 6), np.zeros(len(which))
    sums = evaluator.sums(np.full((len(which), 1), 2.0), wi, still, wo, weight, which, nothing_noted)
    directions = np.moveaxis(wo[:, : tables * blocks].reshape(3, tables, blocks, BLOCK)[:, which], 0, -1)
    values = np.asarray(traceable(2.0)(np.broadcast_to(wi[:, None, None], directions.shape), directions))
    np.testing.assert_allclose(sums[..., 0], np.sum(weight[which] * values[:, :, None], axis=-1), rtol=1e-12)


def test_programs_are_traced_by_the_thread_that_asks():
    mine = threading.local()
    mine.reflectance = 0.3

    def lambert(wi, wo):
        return mine.reflectance / np.pi * jnp.ones_like(wo[..., 2])

    albedo = PointwiseAlbedo(Family("lambert", lambda: lambert))
    values, _ = albedo.estimate(np.zeros((2000, 0)), np.linspace(0.1, 1, 2000), np.zeros(2000), 1)
    np.testing.assert_allclose(values, 0.3, rtol=1e-3)


def nothing_noted(*_):
    raise AssertionError("all values are finite and positive")


def test_sums_leave_out_and_note_what_is_not_finite_and_what_is_negative():
    def build():
        return lambda wi, wo: jnp.where(wo[..., 0] > 0.9, jnp.nan, jnp.where(wo[..., 1] > 0.9, -1.0, 1.0))

    wo = in_rows(random_directions(BLOCK, 5))
    noted = []
    sums = Evaluator(build, {}).sums(
        np.zeros((1, 0)),
        WI[:1],
        np.zeros(1),
        wo,
        np.ones((1, 1, 1, BLOCK)),
        np.zeros(1, int),
        lambda *found: noted.append(found),
    )
    x, y, _ = wo[:, 0]
    bad, negative = x > 0.9, (y > 0.9) & (x <= 0.9)
    assert sums.item() == BLOCK - np.count_nonzero(bad) - 2 * np.count_nonzero(negative)
    ((points, directions, values, finite, weight),) = noted
    assert points.tolist() == [0]
    np.testing.assert_allclose(directions[0], wo[:, 0], atol=1e-15)
    np.testing.assert_array_equal(finite[0, :, 0], ~bad)
    np.testing.assert_array_equal(values[0, :, 0] < 0, negative)
    assert weight.shape == (1, BLOCK)


# --- directions given together ---


def normalised_by_the_batch(wi, wo):
    half = wi + wo
    return (half / jnp.linalg.norm(half))[..., 2]


def random_values(wi, wo, random=np.random.default_rng(1)):  # noqa: B008 - one for all calls
    return random.uniform(0, 1, len(np.asarray(wo)))


@pytest.mark.parametrize(("weight", "least"), [(lambda c: c, -1.0), (lambda c: jnp.maximum(c - 0.6, 0), 0.0)])
def test_it_is_told_where_the_term_at_fault_is_nothing_in_the_middle(weight, least):
    def family(c):
        return lambda wi, wo: (0.9 + 0.25 * weight(c) * normalised_by_the_batch(wi, wo)) / np.pi

    report = check(family, c=(least, 1.0), effort="quick")
    # Light along the normal: the half vector's cosine is that of half the angle.
    u = 0.5**0.5
    mean = 8 * ((u**3 - 1) / 3 - 2 * (u**5 - 1) / 5)
    assert report.albedo == pytest.approx(0.9 + 0.25 * float(weight(1.0)) * mean, rel=1e-8)
    assert any("other values than one by one" in finding for finding in report.findings), report.findings


def test_an_answer_in_room_that_is_written_to_again_is_kept():
    room = np.empty(10**5)

    def f(wi, wo):
        return np.power(np.maximum(wi[:, 2] * wo[:, 2], 0), 2, out=room[: len(wo)])

    def fresh(wi, wo):
        return np.power(np.maximum(wi[:, 2] * wo[:, 2], 0), 2)

    parameters = np.linspace(0, 1, 9)[:, None]
    points = parameters, np.linspace(0.1, 1, 9), np.zeros(9)
    kept, right = (PointwiseAlbedo(Family("f", lambda k, one=one: one, {"k": (0.0, 1.0)})) for one in (f, fresh))
    np.testing.assert_array_equal(kept.estimate(*points, 0), right.estimate(*points, 0))
    np.testing.assert_array_equal(kept(*points, rtol=1e-5), right(*points, rtol=1e-5))


def test_directions_can_be_taken_one_by_one():
    evaluator = Evaluator(lambda: normalised_by_the_batch, {})
    assert evaluator.evaluated_alone()
    assert evaluator.alone
    half = WI + WO
    expected = (half / np.linalg.norm(half, axis=-1, keepdims=True))[:, 2]
    np.testing.assert_allclose(evaluator.bind({})(WI, WO), expected, rtol=1e-14)
    slow = Evaluator(lambda: random_values, {})
    assert not slow.evaluated_alone()
    assert not slow.alone


# --- does it turn with the surface? ---


def ward(along: float, across: float):
    def brdf(wi, wo):
        h = wi + wo
        slope = (h[..., 0] / along) ** 2 + (h[..., 1] / across) ** 2
        return jnp.exp(-slope / jnp.maximum(h[..., 2] ** 2, 1e-12))

    return brdf


@pytest.mark.parametrize(
    "brdf",
    [
        *(lambda wi, wo, n=n: Phong(n)(wi, wo) for n in (1.0, 1e3, 2e5, 1e7)),
        *(lambda wi, wo, n=n: BlinnPhong(n)(wi, wo) for n in (1.0, 1e5)),
        *(lambda wi, wo, a=a: GGX(a)(wi, wo) for a in (0.001, 0.01, 1.0)),
        ward(0.2, 0.2),
        lambda wi, wo: 0.0 * wo[..., 2],
        lambda wi, wo: jnp.full_like(wo[..., 2], jnp.nan),
        lambda wi, wo: jnp.ones(3) * Phong(30.0)(wi, wo)[..., None],
    ],
)
def test_isotropic_functions(brdf):
    assert not PointwiseAlbedo(Family("isotropic", lambda: brdf)).anisotropic


@pytest.mark.parametrize(
    "brdf",
    [
        ward(0.1, 0.5),
        ward(0.01, 0.02),
        ward(0.3, 0.3003),
        lambda wi, wo: wi[..., 0] ** 2,
        lambda wi, wo: 1 + 1e-3 * wi[..., 0],
        lambda wi, wo: Phong(2e5)(wi, wo) * (1 + 0.5 * wi[..., 1]),
        lambda wi, wo: jnp.stack([jnp.ones_like(wi[..., 2]), 1 + wi[..., 0]], axis=-1),
        lambda wi, wo: np.asarray(wi)[..., 0] ** 2,
    ],
)
def test_anisotropic_functions(brdf):
    assert PointwiseAlbedo(Family("anisotropic", lambda: brdf)).anisotropic


# --- pointwise albedo ---


def test_engines_are_chosen_by_what_a_brdf_offers():
    kinds = {
        "zonal": lambda n: Phong(n),
        "half-vector": lambda n: GGX(1 / n),
        "adaptive": lambda n: lambda wi, wo: Phong(n)(wi, wo),
        "adaptive (numpy)": plain_numpy,
    }
    for engine, build in kinds.items():
        albedo = PointwiseAlbedo(Family(engine, build, {"n": (2.0, 4.0)}))
        assert albedo.engine_name == engine
        assert albedo.fast == (engine in ("zonal", "half-vector"))
    with pytest.raises(Finding):
        PointwiseAlbedo(Family("raises", lambda: lambda wi, wo: 1 / 0))


def test_held_parameters_are_numbers_and_swept_ones_are_not():
    def build(power, scale):
        return lambda wi, wo: scale * (wi[..., 2] * wo[..., 2]) ** int(power)

    held = PointwiseAlbedo(Family("held", build, {"power": (2.0, 2.0), "scale": (0.0, 1.0)}))
    assert held.engine_name == "adaptive"
    assert (held.names, held.swept) == (("power", "scale"), ("scale",))
    # E = scale mu^2 2 pi / 4.
    value, error = held(np.array([[2.0, 0.5], [2.0, 1.0]]), np.array([0.5, 1.0]), np.zeros(2))
    expected = np.array([0.5 * 0.25, 1.0]) * np.pi / 2
    assert np.all(np.abs(value - expected) <= error)
    np.testing.assert_allclose(value, expected, rtol=1e-8)
    assert PointwiseAlbedo(Family("swept", build, {"power": (2.0, 3.0), "scale": (0.0, 1.0)})).engine_name == "adaptive (numpy)"


@pytest.mark.parametrize(
    "build",
    [
        pytest.param(lambda n: Phong(n), id="1", marks=pytest.mark.slow),
        pytest.param(lambda n: GGX(1 / n), id="2", marks=pytest.mark.slow),
        pytest.param(lambda n: lambda wi, wo: GGX(1 / n)(wi, wo), id="3"),
    ],
)
def test_the_estimates_of_all_levels_are_near_the_albedo(build):
    albedo = PointwiseAlbedo(Family("levels", build, {"n": (1.5, 20.0)}))
    random = np.random.default_rng(3)
    n, mu = random.uniform(1.5, 20, (40, 1)), random.uniform(0, 1, 40) ** 2
    value, _ = albedo(n, mu, np.zeros(40))
    bounds = {1: (1e-12,), 2: (1e-5, 1e-9), 3: (0.05, 5e-3, 5e-5)}[albedo.levels]
    for level, bound in enumerate(bounds):
        estimate, error = albedo.estimate(n, mu, np.zeros(40), level)
        assert np.max(np.abs(estimate - value)) <= bound, level
        if level == 0:
            assert np.all(np.abs(estimate - value) <= 2 * error + 2e-3)


def test_what_a_scan_sees_of_a_function_is_kept():
    def function(wi, wo):
        return jnp.where(wo[..., 0] > 0.95, jnp.inf, jnp.where(wi[..., 2] < 0.5, -0.25, 0.5)) + 0 * wo[..., 2]

    albedo = PointwiseAlbedo(Family("seen", lambda: function))
    assert (albedo.seen.smallest, albedo.seen.nonfinite) == (None, 0)
    albedo.estimate(np.zeros((2, 0)), np.array([0.8, 0.3]), np.zeros(2), 0)
    low, bad = albedo.seen.smallest, albedo.seen.first_nonfinite
    assert (low.value, low.parameters) == (-0.25, ())
    assert low.wi[2] == pytest.approx(0.3)
    assert bad.wo[0] > 0.95
    assert 0 < albedo.seen.nonfinite < albedo.seen.values


def test_the_worst_channel_counts():
    from brdfcheck.brdf.lobes import Lambert

    zonal = PointwiseAlbedo(Family("rgb", lambda k: Lambert(jnp.stack([k / 4, k, k / 2])), {"k": (0.0, 1.0)}))
    value, error = zonal(np.array([[0.2], [0.8]]), np.array([1.0, 0.3]), np.zeros(2))
    np.testing.assert_allclose(value, [0.2, 0.8], rtol=1e-13)
    assert error.shape == (2,)
    function = PointwiseAlbedo(Family("rgb", lambda: lambda wi, wo: jnp.asarray([0.1, 0.2, 0.3]) / jnp.pi * wo[..., 2:] ** 0))
    value, _ = function(np.zeros((1, 0)), np.array([0.5]), np.zeros(1))
    assert value == pytest.approx(0.3, abs=1e-8)
    broken = PointwiseAlbedo(Family("nan", lambda: lambda wi, wo: jnp.asarray([0.1, jnp.nan, 0.3]) * wo[..., 2:] ** 0))
    value, _ = broken(np.zeros((1, 0)), np.array([0.5]), np.zeros(1))
    assert np.isnan(value[0])
