"""Functions of users: three ways to evaluate them, what is wrong with them, and whether they turn with the surface."""

from __future__ import annotations

import logging

import jax.numpy as jnp
import numpy as np
import pytest
from test_geometry import random_directions

from brdfcheck.callables import Evaluator, Finding
from brdfcheck.family import Family
from brdfcheck.lobes import BlinnPhong, Phong
from brdfcheck.microfacet import GGX
from brdfcheck.pointwise import PointwiseAlbedo

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


# --- three paths ---


def test_one_program_serves_all_parameters():
    built = []

    def build(n):
        built.append(n)
        return traceable(n)

    evaluator = Evaluator(build, {"n": 1.0})
    assert not evaluator.slow
    for n in (0.5, 2.0, 30.0):
        np.testing.assert_allclose(evaluator.bind({"n": n})(WI, WO), traceable(n)(WI, WO), rtol=1e-14)
    assert len(built) <= 2  # the trial's shape and that of the requests


def test_a_program_for_each_set_of_parameters():
    evaluator = Evaluator(wants_a_number, {"n": 2.0})
    assert not evaluator.slow
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


@pytest.mark.parametrize("rows", [1, 2, 1023, 1024, 1025, 9000, 131073])
@pytest.mark.parametrize("build", [traceable, wants_a_number], ids=["shared", "each"])
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


def raises(wi, wo):
    raise RuntimeError("boom")


class Unarray:
    def __array__(self, *_, **__):
        raise TypeError("no")


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (raises, "raised RuntimeError: boom"),
        (lambda wi, wo: wo[2], r"returned shape \(3,\) .* Index the last axis: wi\[..., 2\]"),
        (lambda wi, wo: wo[..., :2][None], r"returned shape \(1, 2, 2\)"),
        (lambda wi, wo: wo[..., :0], r"returned shape \(2, 0\)"),
        (lambda wi, wo: wo[..., 2] + 1j, "complex values"),
        (lambda wi, wo: np.array(["a", "b"]), "not numbers"),
        (lambda wi, wo: "text", "returned|raised"),
        (lambda wi, wo: None, "returned|raised"),
        (lambda wi, wo: Unarray(), "Unarray, not an array of numbers"),
        (lambda wi, wo: {"value": 1.0}, "returned|raised"),
        (lambda wi: wi, "raised TypeError"),
    ],
)
def test_what_is_wrong_with_a_function(function, message):
    with pytest.raises(Finding, match=message):
        Evaluator(lambda: function, {})


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
        evaluator.bind({"n": 6.0})


def test_a_function_that_fails_later():
    def late(wi, wo):
        if len(np.asarray(wi)) > 2:
            raise OSError("late")
        return np.ones(2)

    bound = Evaluator(lambda: late, {}).bind({})
    with pytest.raises(Finding, match="raised OSError: late"):
        bound(WI, WO)


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
        assert albedo.engine == engine
        assert albedo.fast == (engine in ("zonal", "half-vector"))
    with pytest.raises(Finding):
        PointwiseAlbedo(Family("raises", lambda: raises))


def test_points_are_evaluated_in_any_number_and_order():
    albedo = PointwiseAlbedo(Family("phong", lambda n: Phong(n), {"n": (1.0, 100.0)}))
    n = np.random.default_rng(3).uniform(1, 100, 300)
    value, error = albedo(n[:, None], np.ones(300), np.zeros(300))
    np.testing.assert_allclose(value, 2 * np.pi / (n + 2), rtol=1e-13)
    assert np.all(error > 0)
    assert albedo.evaluations % 300 == 0
    single, _ = albedo(n[7:8, None], np.ones(1), np.zeros(1))
    assert single == pytest.approx(value[7], rel=1e-15)


def test_the_worst_channel_counts():
    from brdfcheck.lobes import Lambert

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
