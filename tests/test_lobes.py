"""The lobes as functions of two directions, against their formulas in plain numpy, and what they may never do."""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from selection import few
from shared import direction
from test_geometry import near_mirror, random_directions

from brdfcheck.brdf.factors import BlinnPhongExact, Normalized
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lambert, Lyon, Phong, Schlick
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.pointwise import PointwiseAlbedo

# --- the formulas, written again: functions of c = cos of the lobe's angle, and n ---


def kuijk_blake(c: np.ndarray, n: float) -> np.ndarray:
    a = np.arccos(np.clip(c, -1, 1))
    p = (n + 5.6) / (n * (0.09 * n + 5.2))
    q = (n + 65) / (5 * n + 31.7)
    return np.where(a < p, 1 - a**2 / (p * q), np.where(a < q, (a - q) ** 2 / (q * (q - p)), 0))


def lyon(w: int) -> Callable[[np.ndarray, float], np.ndarray]:
    return lambda c, n: np.maximum(0, 1 - n * (2 - 2 * c) / 2 ** (w + 1)) ** 2**w


def binomial(k: int, least: float = 0.0) -> Callable[[np.ndarray, float], np.ndarray]:
    return lambda c, n: np.maximum(least, 1 + n / k * (c - 1)) ** k


FORMULAS: dict[str, tuple[Callable, str, Callable]] = {
    "phong": (Phong, "mirror", lambda c, n: c**n),
    "blinn-phong": (BlinnPhong, "half", lambda c, n: c**n),
    "schlick-mirror": (Schlick, "mirror", lambda c, n: c / (n - n * c + c)),
    "schlick-half": (lambda n: Schlick(n, "half"), "half", lambda c, n: c / (n - n * c + c)),
    "kuijk-blake-mirror": (KuijkBlake, "mirror", kuijk_blake),
    "kuijk-blake-half": (lambda n: KuijkBlake(n, "half"), "half", kuijk_blake),
    **{f"lyon-{w}-half": (lambda n, w=w: Lyon(n, w), "half", lyon(w)) for w in (1, 2, 3, 4)},
    **{f"lyon-{w}-mirror": (lambda n, w=w: Lyon(n, w, "mirror"), "mirror", lyon(w)) for w in (1, 2, 3, 4)},
    "binomial-half": (BinomialPower, "half", binomial(16)),
    "binomial-mirror": (lambda n: BinomialPower(n, form="mirror"), "mirror", binomial(16)),
    "binomial-8": (lambda n: BinomialPower(n, 8), "half", binomial(8)),
    "unclamped": (lambda n: BinomialPower(n, clamped=False), "half", binomial(16, -np.inf)),
    "unclamped-mirror": (lambda n: BinomialPower(n, form="mirror", clamped=False), "mirror", binomial(16, -np.inf)),
}
# One of each lobe.
FAST = ("phong", "lyon-2-mirror", "unclamped")
CLAMPED = [name for name in FORMULAS if "unclamped" not in name]


def cosine_of(form: str, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    if form == "mirror":
        normal = np.array([0.0, 0.0, 1.0])
        return np.sum((2 * wi[..., 2:] * normal - wi) * wo, axis=-1)
    total = wi + wo
    return total[..., 2] / np.linalg.norm(total, axis=-1)


@eqx.filter_jit
def compiled(lobe: Callable, wi: np.ndarray, wo: np.ndarray) -> jax.Array:
    """lobe(wi, wo) as one program, which all exponents share."""
    return lobe(jnp.asarray(wi), jnp.asarray(wo))


PAIRS = (
    np.concatenate([random_directions(900, 1), random_directions(300, 3)]),
    np.concatenate([random_directions(900, 2), near_mirror(random_directions(300, 3), 4)]),
)


@pytest.mark.parametrize("name", FORMULAS)
@pytest.mark.parametrize("n", [0.7, 5.0, 40.0, 900.0])
def test_values_are_the_formula(name: str, n: float) -> None:
    build, form, formula = FORMULAS[name]
    wi, wo = PAIRS
    c = cosine_of(form, wi, wo)
    if form == "mirror":
        expected = np.where(c > 0, formula(np.maximum(c, 1e-9), n), 0)
        inside = np.abs(c) > 1e-9
    else:
        expected, inside = formula(c, n), c > 0
    found = np.asarray(compiled(build(n), wi, wo))
    assert found.shape == (1200,)
    assert np.count_nonzero(expected[inside]) > 100  # the lobe has been seen
    # The cosine itself has an error of 1e-16, which the power magnifies n times and arccos near 1 more than that.
    slack = 1e-7 if "kuijk" in name else 1e-11
    np.testing.assert_allclose(found[inside], expected[inside], rtol=1e-10, atol=slack)


@pytest.mark.parametrize("name", few(FORMULAS, FAST))
def test_peak_is_one_and_nothing_lies_below_the_horizon(name: str) -> None:
    build, form, _ = FORMULAS[name]
    lobe = build(30.0)
    wi = random_directions(200, 8)
    mirror = wi * [-1, -1, 1]
    np.testing.assert_allclose(compiled(lobe, wi, mirror), 1, rtol=1e-13)
    assert np.asarray(compiled(lobe, wi, wi[::-1] * [1, 1, -1])) == pytest.approx(0, abs=0)
    assert np.asarray(compiled(lobe, wi * [1, 1, -1], wi[::-1])) == pytest.approx(0, abs=0)
    everywhere = np.asarray(compiled(lobe, *PAIRS))
    if form == "mirror":
        behind = cosine_of(form, *PAIRS) < 0
        assert np.count_nonzero(behind) > 100
        assert not np.any(everywhere[behind])
    if name in CLAMPED:
        assert np.max(everywhere) <= 1


def test_lyon_4_is_the_binomial_power_16() -> None:
    for form in ("mirror", "half"):
        for n in (0.5, 17.0, 1e5):
            ours, theirs = Lyon(n, 4, form)(*PAIRS), BinomialPower(n, 16, form)(*PAIRS)
            np.testing.assert_array_equal(ours, theirs)
            assert np.count_nonzero(np.asarray(ours)) > 10


def test_the_unclamped_lobe_rises_again() -> None:
    # Past c0 = 1 - 16/n the even power comes back: (1 - n/16)^16 at 90 degrees from the axis.
    wi, wo = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    c = np.sqrt(0.5)
    for n in (40.0, 1000.0):
        expected = (1 + n / 16 * (c - 1)) ** 16
        assert float(BinomialPower(n, clamped=False)(wi, wo)) == pytest.approx(expected, rel=1e-12)
        assert (expected > 1) == (n == 1000.0)
    assert float(BinomialPower(1000.0)(wi, wo)) == 0
    assert float(BinomialPower(40.0, clamped=False).profile(jnp.asarray(16 / 40))) == pytest.approx(0, abs=1e-60)
    assert float(BinomialPower(64.0, clamped=False).profile(jnp.asarray(0.5))) == pytest.approx(1)


def test_exponent_zero_is_a_constant() -> None:
    wi, wo = PAIRS
    inside = cosine_of("mirror", wi, wo) > 1e-9
    for lobe in (Phong(0.0), BlinnPhong(0.0), Schlick(0.0), Schlick(0.0, "half"), Lyon(0.0), BinomialPower(0.0)):
        value = np.asarray(compiled(lobe, wi, wo))
        np.testing.assert_allclose(value[inside], 1, rtol=1e-15, err_msg=type(lobe).__name__)
    # The formula of Kuijk and Blake has 1/(p q) = 0 there as well.
    np.testing.assert_allclose(compiled(KuijkBlake(0.0, "half"), wi, wo), 1, rtol=1e-15)
    # c = 0 and n = 0: 0^0 is 1 on the closed domain of the profile, and Schlick's 0/0 as well.
    one = jnp.asarray(1.0)
    assert BlinnPhong(0.0).profile(one) == Schlick(0.0, "half").profile(one) == 1
    assert BlinnPhong(2.0).profile(one) == Schlick(2.0, "half").profile(one) == 0


@pytest.mark.parametrize("name", few(FORMULAS, FAST))
def test_shapes_broadcast(name: str) -> None:
    lobe = FORMULAS[name][0](12.0)
    wi, wo = random_directions(6, 1).reshape(2, 3, 3), random_directions(3, 2)
    value = np.asarray(compiled(lobe, wi, wo))
    assert value.shape == (2, 3)
    assert compiled(lobe, wi[0, 1], wo[1]).shape == ()
    assert float(compiled(lobe, wi[1, 2], wo[2])) == pytest.approx(value[1, 2], rel=1e-14)
    assert compiled(lobe, wi[:, :, None], wo).shape == (2, 3, 3)
    assert compiled(lobe, wi[0, 0], wo).shape == (3,)


@pytest.mark.parametrize("name", few(FORMULAS, FAST))
def test_a_batch_of_lobes_is_the_loop(name: str) -> None:
    build = FORMULAS[name][0]
    n = np.array([0.5, 8.0, 300.0])
    wi, wo = PAIRS[0][::20], PAIRS[1][::20]
    batch = jax.vmap(lambda lobe: lobe(wi, wo))(build(n))
    loop = np.stack([compiled(build(value), wi, wo) for value in n])
    np.testing.assert_allclose(batch, loop, rtol=1e-12, atol=1e-14)


def test_lambert() -> None:
    wi, wo = PAIRS
    np.testing.assert_allclose(Lambert(0.6)(wi, wo), 0.6 / np.pi, rtol=1e-15)
    np.testing.assert_allclose(Lambert()(wi, wo), 1 / np.pi, rtol=1e-15)
    rgb = np.asarray(Lambert(jnp.asarray([0.0, 0.5, 1.0]))(wi, wo))
    assert rgb.shape == (1200, 3)
    np.testing.assert_allclose(rgb, np.broadcast_to([0, 0.5 / np.pi, 1 / np.pi], rgb.shape), rtol=1e-15)
    assert not np.any(Lambert(0.6)(wi, wo * [1, 1, -1]))


# --- parameters ---


@pytest.mark.parametrize(
    "build",
    [Phong, BlinnPhong, Schlick, KuijkBlake, Lyon, BinomialPower],
)
@pytest.mark.parametrize("n", [-1e-9, -3, np.nan, np.inf, -np.inf, [1.0, -2.0]])
def test_bad_exponents_are_refused(build, n) -> None:
    with pytest.raises(ValueError, match="n must be finite and >= 0; got") as caught:
        build(n)
    assert str(n) in str(caught.value)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Lambert(-0.1), "reflectance must be finite and >= 0; got -0.1"),
        (lambda: Lambert([0.5, np.nan]), "reflectance must be finite and >= 0"),
        (lambda: Schlick(1.0, "Half"), "form must be one of mirror, half; got 'Half'"),
        (lambda: KuijkBlake(1.0, ""), "form must be one of mirror, half; got ''"),
        (lambda: Lyon(1.0, 2, "retro"), "form must be one of mirror, half; got 'retro'"),
        (lambda: BinomialPower(1.0, form="both"), "form must be one of mirror, half; got 'both'"),
        *((lambda w=w: Lyon(1.0, w), f"w must be an integer from 1 to 16; got {w!r}") for w in (0, -1, 17, 2.0, True, "2")),
        *(
            (lambda k=k: BinomialPower(1.0, k), f"k must be a positive even integer; got {k!r}")
            for k in (0, -2, 15, 16.0, True, "16", None)
        ),
    ],
)
def test_other_bad_parameters_are_refused(build, message) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        build()
    assert message in str(caught.value)


def test_integers_of_numpy_are_integers() -> None:
    assert BinomialPower(np.int64(3), np.int64(8)).k == 8
    assert Lyon(3, np.int32(4)).w == 4
    assert Phong(3).n.dtype == jnp.float64
    assert Phong(jnp.asarray(3, jnp.float32)).n.dtype == jnp.float32


def test_exponents_are_leaves_and_the_rest_is_structure() -> None:
    structures = {jax.tree.structure(lobe) for lobe in (Lyon(2.0), Lyon(3.0), Lyon(2.0, 3), Lyon(2.0, 2, "mirror"))}
    assert len(structures) == 3
    assert jax.tree.leaves(BinomialPower(5.0)) == [5.0]
    traces = []
    evaluate = eqx.filter_jit(lambda lobe, wi, wo: traces.append(None) or lobe(wi, wo))
    for n in (1.0, 30.0, 1e5):
        evaluate(BinomialPower(n), *PAIRS)
    assert len(traces) == 1


# --- large exponents, single precision ---


@pytest.mark.parametrize(
    ("build", "formula"),
    [
        (Phong, lambda v, n: np.exp(n * np.log1p(-v))),
        (BlinnPhong, lambda v, n: np.exp(n * np.log1p(-v))),
        (lambda n: Lyon(n, 4), lambda v, n: np.maximum(0, 1 - v * n / 16) ** 16),
        (BinomialPower, lambda v, n: np.maximum(0, 1 - v * n / 16) ** 16),
        (lambda n: Schlick(n, "half"), lambda v, n: (1 - v) / (n * v + 1 - v)),
    ],
    ids=["phong", "blinn-phong", "lyon", "binomial", "schlick"],
)
@pytest.mark.parametrize("n", [1e3, 1e5, 1e7])
def test_single_precision_keeps_its_digits_at_large_exponents(build, formula, n) -> None:
    # From directions, not from the versine: what a user of the lobe sees. The half vector lies 1/sqrt(n) off the normal.
    n32 = np.float32(n)
    tilt = (np.linspace(0.05, 2, 60) / np.sqrt(n)).astype(np.float32)
    lobe = build(jnp.asarray(n32))
    side = np.float32(0.0) if lobe.form == "mirror" else np.float32(0.6)
    wi = np.tile(np.array([side, 0, np.sqrt(1 - side**2)], np.float32), (60, 1))
    wo = wi * np.array([-1, -1, 1], np.float32) + np.stack([tilt, 0 * tilt, 0 * tilt], axis=-1).astype(np.float32)
    a, b = wi.astype(float), wo.astype(float)
    if lobe.form == "mirror":
        versine = np.sum((a * [-1, -1, 1] - b) ** 2, axis=-1) / 2
    else:
        h = (a + b) / np.linalg.norm(a + b, axis=-1, keepdims=True)
        versine = np.sum((h - [0, 0, 1]) ** 2, axis=-1) / 2
    expected = formula(versine, float(n32))
    found = compiled(lobe, wi, wo)
    assert found.dtype == jnp.float32
    keep = expected > 1e-2
    assert np.count_nonzero(keep) >= 15
    relative = np.abs(np.asarray(found, float) / np.maximum(expected, 1e-30) - 1)[keep]
    assert np.max(relative) <= 4e-6
    if lobe.form == "half" and n >= 1e5:  # what the plain formula in single precision makes of it
        h32 = (wi + wo) / np.linalg.norm(wi + wo, axis=-1, keepdims=True)
        plain = h32[:, 2].astype(float) ** float(n32)
        assert np.max(np.abs(plain / np.exp(-n * versine) - 1)[keep]) > 1e-3


def test_lyon_at_ten_million_in_single_precision() -> None:
    versine = jnp.asarray(np.linspace(0, 1.5e-6, 4001)[1:], jnp.float32)
    exact = np.maximum(0, 1 - np.asarray(versine, float) * 1e7 / 16) ** 16
    found = np.asarray(Lyon(jnp.asarray(1e7, jnp.float32), 4).profile(versine), float)
    keep = exact > 0.1
    assert np.max(np.abs(found / exact - 1)[keep]) <= 3e-6
    plain = np.float32(1) + np.float32(1e7 / 16) * ((np.float32(1) - np.asarray(versine)) - np.float32(1))
    assert np.max(np.abs(plain.astype(float) ** 16 / exact - 1)[keep]) > 0.2


# --- whatever the parameters ---

ALL: dict[str, Callable] = {
    **{name: FORMULAS[name][0] for name in CLAMPED if name[:6] not in ("lyon-1", "lyon-3", "lyon-4")},
    "lambert": lambda n: Lambert(n / (n + 1)),
    "cook-torrance": lambda n: CookTorrance((n + 1) ** -0.5),
    "cook-torrance-dielectric": lambda n: CookTorrance((n + 1) ** -0.5, n / (n + 5)),
    "beckmann-separable": lambda n: CookTorrance((n + 1) ** -0.5, masking="smith-separable"),
    "beckmann-correlated": lambda n: CookTorrance((n + 1) ** -0.5, masking="smith-correlated"),
    "no-masking": lambda n: CookTorrance((n + 1) ** -0.5, masking="none"),
    "ggx": lambda n: GGX((n + 1) ** -0.5),
    "ggx-schlick": lambda n: GGX((n + 1) ** -0.5, n / (n + 1), fresnel="schlick"),
    "normalized": lambda n: Normalized(BlinnPhong(n), BlinnPhongExact()),
}


@eqx.filter_jit
def _both_ways(names: tuple[str, ...], n: jax.Array, wi: jax.Array, wo: jax.Array) -> dict[str, jax.Array]:
    """Of each of these lobes f(wi, wo) and f(wo, wi)."""
    there, back = jnp.stack([wi, wo]), jnp.stack([wo, wi])
    return {name: ALL[name](n)(there, back) for name in names}


exponents = st.floats(-2, 7).map(lambda x: 10.0**x)
cosines = st.one_of(
    st.sampled_from([0.0, 1.0]),
    st.floats(0, 1),
    st.floats(-12, 0).map(lambda x: 10.0**x),
    st.floats(-12, -1).map(lambda x: 1 - 10.0**x),
)
azimuths = st.one_of(
    st.sampled_from([0.0, np.pi / 2, np.pi]), st.floats(-np.pi, np.pi), st.floats(-9, -1).map(lambda x: np.pi + 10**x)
)


# A failure names its lobe and its directions: nothing to shrink, which would take minutes.
UNSHRUNK = settings(phases=[Phase.explicit, Phase.generate])


PARTS = {f"{place + 1} of 4": tuple(ALL)[place::4] for place in range(4)}


@pytest.mark.parametrize("part", few(PARTS, ("1 of 4",)))
@UNSHRUNK
@given(exponents, st.lists(st.tuples(cosines, cosines, azimuths), min_size=8, max_size=8))
def test_reciprocal_positive_and_finite(part: str, n: float, pairs: list[tuple[float, float, float]]) -> None:
    wi = np.stack([direction(i, 0.3) for i, _, _ in pairs])
    wo = np.stack([direction(o, 0.3 + azimuth) for _, o, azimuth in pairs])
    for name, (there, back) in _both_ways(PARTS[part], np.asarray(n), wi, wo).items():
        there, back = np.asarray(there), np.asarray(back)
        assert np.all(np.isfinite(there)), name
        assert np.all(there >= -1e-13), name  # Schlick: (1 - versine) / n, and 1 - versine rounds
        np.testing.assert_allclose(there, back, rtol=1e-9, atol=1e-300, err_msg=name)


RAW = {name: PointwiseAlbedo(Family(name, ALL[name], {"n": (0.01, 1e7)})) for name in ALL if name in CLAMPED}


@UNSHRUNK
@given(st.lists(st.tuples(exponents, cosines), min_size=1, max_size=64))
def test_raw_albedo_of_a_lobe_with_peak_one_lies_between_zero_and_pi(points: list[tuple[float, float]]) -> None:
    n, mu = np.array(points).T
    for name, evaluate in RAW.items():
        value, error = evaluate(n[:, None], mu, np.zeros_like(mu))
        assert np.all(value >= 0), name
        assert np.all(value <= np.pi * (1 + 1e-12)), name
        assert np.all(error <= 1e-11 * value), name


EXPONENTS = np.array([0.0, 1e-9, 1e-3, 0.1, 0.3, 0.5, 0.62, 0.63, 0.7, 0.999, 1.0, 1.5, 7.0, 16.0, 54.6, 300.0, 1e4, 1e7])


@pytest.mark.parametrize("name", few(FORMULAS, FAST))
def test_a_lobe_that_says_it_does_not_rise_does_not(name: str) -> None:
    build = FORMULAS[name][0]
    assert build(1.0).monotone == (name in CLAMPED)
    versine = np.unique(np.concatenate([np.geomspace(1e-12, 1, 4000), np.linspace(0, 1, 4001)]))
    rises = 0.0
    for n in EXPONENTS:
        profile = np.asarray(build(n).profile(jnp.asarray(versine)))
        rises = max(rises, float(np.max(np.diff(profile))))
    if name not in CLAMPED:
        assert rises > 1
        return
    assert rises <= 16 * np.finfo(float).eps
    # The theorem: no incidence reflects more than the normal one.
    cosines = jnp.asarray([1.0, 1 - 1e-9, 0.99, 0.9, 0.7, 0.5, 0.3, 0.1, 0.01, 1e-4, 0.0])
    found = jax.vmap(albedo, (0, None))(build(jnp.asarray(EXPONENTS)), cosines)
    value, error = np.asarray(found.value), np.asarray(found.error)
    assert np.all(value <= value[:, :1] + error + error[:, :1])


@pytest.mark.parametrize(("k", "clamped"), [(2**53 + 2, True), (66, False)])
def test_powers_that_would_lose_their_digits_are_refused(k: int, clamped: bool) -> None:
    with pytest.raises(ValueError, match="k must be at most"):
        BinomialPower(5.0, k, clamped=clamped)
    BinomialPower(5.0, 2**53 if clamped else 64, clamped=clamped)
