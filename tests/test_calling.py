"""BRDFs as people write them: for one pair of directions, of angles, as methods, with the cosine; and what mistakes say."""

from __future__ import annotations

import functools
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_geometry import random_directions

import brdfcheck
from brdfcheck.brdf.blame import Finding, place_of, told
from brdfcheck.brdf.branches import TooManyWays, by_branches
from brdfcheck.brdf.callables import Evaluator, constant
from brdfcheck.brdf.calling import angle_of, directional, over_cosine
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.subject import as_target
from brdfcheck.messages import UsageError
from brdfcheck.verdict.supremum import affordable

WI, WO = random_directions(300, 1), random_directions(300, 2)


def array_version(wi, wo):
    """Phong's lobe, n = 10, with the factor that makes its albedo 1 at normal incidence."""
    c = wi[..., 2] * wo[..., 2] - wi[..., 0] * wo[..., 0] - wi[..., 1] * wo[..., 1]
    return 12 / (2 * np.pi) * jnp.maximum(c, 0) ** 10


def unpacks(wi, wo):
    (x, y, z), (a, b, c) = wi, wo
    return 12 / (2 * jnp.pi) * jnp.maximum(z * c - x * a - y * b, 0) ** 10


def branches(wi, wo):
    x, y, z = wi
    if z <= 0 or wo[2] <= 0:
        return 0.0
    c = z * wo[2] - x * wo[0] - y * wo[1]
    if c < 0:
        return 0
    return 12 / (2 * math.pi) * c**10


def with_math(wi, wo):
    c = wi[2] * wo[2] - wi[0] * wo[0] - wi[1] * wo[1]
    return 12 / (2 * math.pi) * math.pow(max(c, 0.0), 10)


def sums_all(wi, wo):
    return 12 / (2 * jnp.pi) * jnp.maximum(jnp.sum(wi * wo * jnp.array([-1, -1, 1.0])), 0) ** 10


@pytest.mark.parametrize(
    ("function", "slow"), [(unpacks, False), (branches, False), (with_math, True), (sums_all, False)], ids=lambda x: str(x)[:19]
)
def test_one_pair_is_what_arrays_are(function, slow):
    evaluator = Evaluator(constant(function), {})
    assert (evaluator.single, evaluator.slow, evaluator.channels) == (True, slow, None)
    np.testing.assert_allclose(evaluator.bind({})(WI, WO), array_version(WI, WO), rtol=1e-13)
    assert evaluator.disagreement({}) is None
    assert ("called for each pair" if slow else "jax.vmap") in (evaluator.note or "")


def test_verdicts_are_those_of_the_array_version():
    expected = brdfcheck.check(array_version, effort="quick")
    for function in (unpacks, branches):
        report = brdfcheck.check(function, effort="quick")
        assert (report.verdict, report.passed, report.angle) == (expected.verdict, True, expected.angle)
        assert report.albedo == pytest.approx(expected.albedo, abs=1e-12)
        assert report.error == pytest.approx(expected.error, rel=0.5)
        assert any("jax.vmap" in note for note in report.notes)


@pytest.mark.slow
def test_the_verdict_of_a_loop_is_that_of_the_array_version():
    expected, report = brdfcheck.check(array_version), brdfcheck.check(with_math)
    assert (report.verdict, report.effort) == (expected.verdict, "quick")
    assert report.albedo == pytest.approx(expected.albedo, abs=1e-9)
    assert "made the effort 'quick'" in "".join(report.notes)
    assert report.engine == "adaptive (one pair at a time)"
    too_bright = brdfcheck.check(lambda wi, wo: 1.01 * with_math(wi, wo))
    assert too_bright.verdict.name == "VIOLATES"
    assert too_bright.albedo == pytest.approx(1.01, abs=1e-9)


def test_a_loop_makes_less_of_an_effort():
    class Albedo:
        one_by_one = True

    assert [affordable(effort, Albedo()) for effort in ("quick", "normal", "thorough")] == ["quick", "quick", "normal"]  # pyright: ignore[reportArgumentType]


def test_what_works_on_arrays_is_called_with_arrays():
    """Where arrays have other values than their directions alone, that is the finding, as it was; nothing is guessed."""

    def norm_of_all(wi, wo):
        half = wi + wo
        return (half / jnp.linalg.norm(half))[..., 2]

    evaluator = Evaluator(constant(norm_of_all), {})
    assert not evaluator.single
    assert "other values than one by one" in (evaluator.disagreement({}) or "")
    for function in (array_version, lambda wi, wo: 0.3, lambda wi, wo: np.asarray(wi)[..., 2].copy()):
        assert not Evaluator(constant(function), {}).single


def test_random_values_of_one_pair_are_told():
    random = np.random.default_rng(1)
    with pytest.raises(Finding, match="random, or keeps state"):
        Evaluator(constant(lambda wi, wo: wi[2] * random.uniform() if wi[2] > 0 else 0.0), {}).disagreement({})


def test_channels_of_one_pair():
    def mixed(wi, wo):
        return 0.0 if wi[2] < 0.5 else [0.1, 0.2, wo[2]]

    def mixed_math(wi, wo):
        return 0.0 if wi[2] < 0.5 else (0.1, 0.2, math.fabs(wo[2]))

    for function in (mixed, mixed_math):
        evaluator = Evaluator(constant(function), {})
        assert evaluator.channels == 3
        lit = (WI[:, 2] >= 0.5)[:, None]
        expected = np.where(lit, np.stack([0.1 + 0 * WO[:, 2], 0.2 + 0 * WO[:, 2], WO[:, 2]], axis=1), 0)
        np.testing.assert_allclose(evaluator.bind({})(WI, WO), expected, rtol=1e-14)


def test_parameters_may_choose_branches():
    def family(wi, wo, k):
        return k / math.pi if k < 0.5 and wi[2] > 0 else 0.25

    evaluator = Evaluator(as_target(family, {"k": (0.0, 1.0)}).family.build, {"k": 0.5})
    assert (evaluator.single, evaluator.slow) == (True, False)
    for k in (0.2, 0.8):
        np.testing.assert_allclose(evaluator.bind({"k": k})(WI, WO), k / math.pi if k < 0.5 else 0.25)


# --- branches ---


def test_branches_are_chosen_for_each_direction():
    def sign(a, b):
        assert a > -10
        if a > 0 and b > 0:
            return max(a, b)
        return -1.0 if a < 0 else min(a, b)

    random = np.random.default_rng(2).normal(size=(2, 200))
    found = jax.jit(jax.vmap(by_branches(sign)))(*random)
    np.testing.assert_array_equal(found, [sign(*pair) for pair in random.T])
    assert np.isnan(jax.vmap(by_branches(sign))(np.array([-20.0]), np.array([1.0])))
    assert jax.vmap(by_branches(lambda a: jnp.float32(1) if a > 0 else 0.0))(random[0]).dtype == np.float32


def test_what_goes_on_and_on_is_not_followed():
    def endless(a):
        while a < 1:
            a = 2 * a
        return a

    with pytest.raises(TooManyWays):
        jax.vmap(by_branches(endless))(jnp.ones(2))
    with pytest.raises(jax.errors.TracerBoolConversionError):
        jax.jit(lambda a: 1 if a > 0 else 0)(1.0)  # elsewhere nothing has changed


# --- signatures ---


@pytest.mark.parametrize(
    ("name", "angle"),
    [
        ("theta_i", "theta_i"), ("thetaIn", "theta_i"), ("theta_in", "theta_i"), ("phiOut", "phi_o"), ("theta_r", "theta_o"),
        ("θ_h", "theta_h"), ("phi_d", "phi_d"), ("theta_diff", "theta_d"), ("phi", None), ("theta", None), ("thing", None),
    ],
)  # fmt: skip
def test_names_of_angles(name, angle):
    assert angle_of(name) == angle


def by_frames(wi, wo):
    """Rusinkiewicz's angles by two turns of the light, as they are defined."""
    half = (wi + wo) / np.linalg.norm(wi + wo)
    theta_h, phi_h = np.arccos(half[2]), np.arctan2(half[1], half[0])
    c, s = np.cos(-phi_h), np.sin(-phi_h)
    about_normal = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = np.cos(-theta_h), np.sin(-theta_h)
    about_binormal = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    x, y, z = about_binormal @ about_normal @ wi
    return theta_h, phi_h, np.arccos(z), np.arctan2(y, x)


def test_angles_are_those_of_the_directions():
    def four(theta_i, phi_i, theta_o, phi_o):
        return [theta_i, phi_i, theta_o, phi_o]

    def half(theta_h, phi_h, theta_d, phi_d):
        return [theta_h, phi_h, theta_d, phi_d]

    for wi, wo in zip(WI[:40], WO[:40], strict=True):
        angles = [np.arccos(wi[2]), np.arctan2(wi[1], wi[0]), np.arccos(wo[2]), np.arctan2(wo[1], wo[0])]
        for function, expected in ((four, angles), (half, by_frames(wi, wo))):
            brdf = directional(function)
            for found in (brdf(wi, wo), np.array(brdf(wi[None], wo[None]))[:, 0], brdf(jnp.asarray(wi), jnp.asarray(wo))):
                np.testing.assert_allclose(np.array(found), expected, atol=1e-7)
    # The light changes place with the view: the half vector stays, the difference turns by half a turn.
    first, second = (np.array(directional(half)(*pair)) for pair in ((WI, WO), (WO, WI)))
    np.testing.assert_array_equal(first[:3], second[:3])
    np.testing.assert_allclose(np.cos(first[3] - second[3]), -1)
    assert directional(half)(WI[0], WI[0])[2] == 0


def test_functions_of_angles_are_families():
    def by_half(theta_h, theta_d, phi_d, n=10):
        return (n + 6) * jnp.cos(theta_h) ** n / (8 * jnp.pi)

    def with_math(theta_i, phi_i, theta_o, phi_o):
        return 0.3 if math.cos(theta_i) > 0 else 0.0

    family = as_target(by_half, {"n": (1.0, 50.0)}).family
    assert family.ranges == {"n": (1.0, 50.0)}
    half = (WI + WO) / np.linalg.norm(WI + WO, axis=-1, keepdims=True)
    np.testing.assert_allclose(family.build(n=8)(WI, WO), 14 * half[:, 2] ** 8 / (8 * np.pi), atol=1e-14)
    assert Evaluator(as_target(with_math).family.build, {}).single
    lobe = brdfcheck.Normalized(brdfcheck.BlinnPhong(10.0), brdfcheck.Factor(6.0, 8 * np.pi))
    assert float(brdfcheck.albedo(by_half, 0.7).value) == pytest.approx(float(brdfcheck.albedo(lobe, 0.7).value), abs=1e-7)
    for function in (lambda theta_i, theta_o, phi: 0.1, lambda theta_i, theta_o, phi_d: 0.1):
        with pytest.raises(UsageError, match=r"known by their names: \(theta_i, phi_i, theta_o, phi_o\), \(theta_h"):
            as_target(function)


@pytest.mark.parametrize(
    "names", ["cos_i, cos_o", "NdotL, NdotV", "mu_i, mu_o", "theta, phi", "cosThetaIn, cosThetaOut", "nl, nv"]
)
def test_angles_and_cosines_are_not_taken_for_directions(names):
    with pytest.raises(UsageError, match=r"write f\(wi, wo\), with wi\[\.\.\., 2\] a cosine"):
        as_target(eval(f"lambda {names}: 0.3"))  # both would be arrays of three numbers: their product is a colour


def test_the_place_of_directions_and_methods():
    def backwards(view, light):
        return light[..., 2]

    class Material:
        def __init__(self, k):
            self.k = k

        def eval(self, wo, wi):
            return self.k * wi[..., 2]

    class Other:
        def f(self, wi, wo):
            return wi[2] if wo[2] > 0 else 0.0

    def later(k, L, V, *, gain=1.0):
        return k * L[..., 2] * V[..., 0] * gain

    np.testing.assert_array_equal(directional(backwards)(WI, WO), WI[:, 2])
    np.testing.assert_array_equal(as_target(later, {"k": (0.0, 1.0)}).family.build(k=0.5)(WI, WO), 0.5 * WI[:, 2] * WO[:, 0])
    np.testing.assert_array_equal(as_target(Material(0.5)).family.build()(WI, WO), 0.5 * WI[:, 2])
    made = Evaluator(as_target(Material, {"k": (0.0, 1.0)}).family.build, {"k": 0.5})
    np.testing.assert_allclose(made.bind({"k": 0.25})(WI, WO), 0.25 * WI[:, 2])
    np.testing.assert_allclose(Evaluator(as_target(Other()).family.build, {}).bind({})(WI, WO), WI[:, 2])
    with pytest.raises(TypeError, match="a BRDF must be callable"):
        as_target(object())


def test_a_normal_beside_two_directions():
    def arrays(N, V, L, n):
        return np.sum(N * L, axis=-1) ** n * V[..., 0]

    def one_pair(wi, wo, normal):
        return float(np.dot(normal, wi))

    def framed(L, V, N, X, Y):
        return np.sum(L * (N + 2 * X + 3 * Y), axis=-1)

    def exponent(wi, wo, N):
        return wi[..., 2] ** N

    np.testing.assert_allclose(as_target(framed).family.build()(WI, WO), WI @ np.array([2.0, 3.0, 1.0]))
    family = as_target(arrays, {"n": (2.0, 2.0)}).family
    np.testing.assert_allclose(family.build(n=2.0)(WI, WO), WI[:, 2] ** 2 * WO[:, 0])
    assert family.notes == ("N is given the normal (0, 0, 1): with a range it is a parameter",)
    np.testing.assert_allclose(Evaluator(as_target(one_pair).family.build, {}).bind({})(WI, WO), WI[:, 2])
    np.testing.assert_allclose(as_target(exponent, {"N": (3.0, 3.0)}).family.build(N=3.0)(WI, WO), WI[:, 2] ** 3)
    # An exponent N would answer for each component of the normal, and a lone n is a parameter.
    for function in (exponent, lambda wi, wo, n: wi[..., 2] ** n, lambda a, b, normal: a[..., 2]):
        with pytest.raises(UsageError, match=r"must be given a range: .*; the normal is known by its name, N, Ng, Ns, normal"):
            as_target(function)


# --- the cosine ---


@pytest.mark.parametrize("function", [array_version, unpacks, with_math], ids=["arrays", "vmap", "loop"])
def test_functions_may_hold_the_cosine(function):
    def held(wi, wo):
        return function(wi, wo) * wi[..., 2]

    family = brdfcheck.load(held, returns="brdf*cos")
    np.testing.assert_allclose(Evaluator(family.build, {}).bind({})(WI, WO), array_version(WI, WO), rtol=1e-12)
    below = WI * [1, 1, -1]
    assert np.all(Evaluator(family.build, {}).bind({})(below, WO) == 0)


def test_the_cosine_of_a_lobe_and_of_what_has_been_read():
    lobe = over_cosine(brdfcheck.Phong(3.0))
    assert isinstance(lobe, brdfcheck.PerCosine)
    for value in (brdfcheck.load("phong"), brdfcheck.load(array_version)):
        with pytest.raises(UsageError, match="--returns: a Family has been read already"):
            as_target(value, reading=Reading(returns="brdf*cos"))


@pytest.mark.parametrize(
    ("index", "advice"),
    [(0, 'or say --returns "brdf*cos"'), (1, "call the arguments (view, light)")],
)
def test_a_finding_names_the_option_where_the_cosine_is_in_it(index, advice):
    def rendered(wi, wo, k):
        return k * (wi, wo)[index][..., 2]

    one_angle = {"cos_theta": (0.5, 0.5), "effort": "quick"}
    report = brdfcheck.check(rendered, k=(0.1, 0.3), **one_angle)
    assert report.verdict.name == "CONSERVES"
    (finding,) = report.findings
    assert "not reciprocal" in finding
    assert "return the BRDF alone, without the cosine of the rendering equation" in finding
    assert f"(divided by the cosine of {('wi', 'wo')[index]} it is: " in finding
    assert advice in finding
    if index == 0:
        assert brdfcheck.check(brdfcheck.load(rendered, returns="brdf*cos", k=(0.1, 0.3)), **one_angle).passed


def stepped(wi, wo):
    return 0.5 / jnp.pi if wo[..., 2] > 0.5 else 0.25 / jnp.pi


@pytest.mark.parametrize("function", [lambda wi, wo: 0.1 + 0.1 * wo[..., 2], stepped])
def test_the_cosine_is_no_excuse_for_other_faults(function):
    (finding,) = brdfcheck.check(function, effort="quick", rtol=1e-4, cos_theta=(0.8, 0.8)).findings
    assert "not reciprocal" in finding
    assert "cosine" not in finding


# --- mistakes ---


def beyond(wi, wo):
    return math.acos(1 + wi[2])


def nothing(wi, wo):
    if wi[2] > 0.6:
        return 0.1
    return None


def out_of_bounds(wi, wo):
    return wi[5] if wo[2] > 0 else 0.0


class Unarray:
    def __array__(self, *_, **__):
        raise TypeError("no")


def pairs_of_angles(wi, wo):
    (theta_i, _), (theta_o, _) = wi, wo
    return 0.8 / np.pi * (np.cos(theta_i) * np.cos(theta_o)) ** 0.2


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (beyond, r"beyond raised ValueError: .* \(.*test_calling.py:\d+: rounding takes a cosine beyond 1.*clamp it first"),
        (nothing, r"nothing returned None for wi=\(.*\), wo=\(.*\): is there a way through it without a return\?"),
        (out_of_bounds, r"IndexError: .*test_calling.py:\d+: directions come as arrays"),
        (lambda wi, wo: wi.x, r"AttributeError.*its x is wi\[..., 0\]"),
        (pairs_of_angles, r"to unpack.*index the last axis"),
        (lambda wi, wo: 1 / 0, "raised ZeroDivisionError: division by zero"),
        (lambda wi, wo: wo[..., None], r"returned shape \(1, 3, 1\) .* index the last axis, wi\[..., 2\]"),
        (lambda wi, wo: wo[..., :2][None], r"returned shape \(1, 1, 2\) for directions of shape \(1, 3\)"),
        (lambda wi, wo: wo[..., :0], r"returned shape \(1, 0\)"),
        (lambda wi, wo: "text", "returned|raised"),
        (lambda wi, wo: Unarray(), "Unarray, not an array of numbers"),
        (lambda wi, wo: {"value": 1.0}, "returned|raised"),
        (lambda wi: wi, "raised TypeError"),
        (lambda wi, wo: jnp.ones((len(wi), 257)), "returned 257 channels; at most 256"),
    ],
)
def test_mistakes_have_a_place_and_a_remedy(function, message):
    with pytest.raises(Finding, match=message) as caught:
        Evaluator(constant(function), {})
    assert "\n" not in str(caught.value)


def test_the_place_of_an_error_is_in_the_users_code(monkeypatch):
    monkeypatch.chdir(Path(__file__).parent)
    with pytest.raises(TypeError) as caught:
        jnp.dot(jnp.ones((1, 3)), jnp.ones((1, 3)))
    line = test_the_place_of_an_error_is_in_the_users_code.__code__.co_firstlineno + 3
    assert place_of(caught.value) == f"test_calling.py:{line}"
    assert told(ValueError("two\nlines")) == "ValueError: two lines"


def test_a_wrapper_is_called_as_what_it_wraps_says() -> None:
    @functools.wraps(lambda wo, wi: None)
    def wrapper(*directions: np.ndarray, **named: np.ndarray) -> np.ndarray:
        given = dict(zip(("wo", "wi"), directions, strict=False)) | named
        return given["wi"][..., 0] + 10 * given["wo"][..., 0]

    wi, wo = np.array([[0.1, 0, 1]]), np.array([[0.2, 0, 1]])
    np.testing.assert_allclose(directional(wrapper)(wi, wo), 0.1 + 10 * 0.2)
