"""The largest albedo over a box: known maxima of lobes, and planted ones that a grid does not see."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import Factor, Normalized, PerCosine
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, Phong
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.functions import Adaptive
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.zonal import Zonal
from brdfcheck.verdict import Verdict, check, judge
from brdfcheck.verdict.climb import climb
from brdfcheck.verdict.supremum import EFFORTS, NEVER_ABOVE_ONE, Supremum, supremum

Surface = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def largest(build: Callable, cos_theta: tuple[float, float] = (0.0, 1.0), **ranges: tuple[float, float]) -> Supremum:
    return supremum(PointwiseAlbedo(Family("test", build, ranges, cos_theta)), effort="quick", intervals=False)


def scaled(lobe: Callable, a: float, b: float) -> Callable:
    return lambda n: Normalized(lobe(n), Factor(a, b))


class Beside(NamedTuple):
    """What is known at a place, and the surface beside it."""

    value: float
    error: float
    surface: PointwiseAlbedo
    size: int = 0

    def gap(self):
        return 0.0

    def __call__(self, parameters, cos_theta, azimuth):
        return self.surface(parameters, cos_theta, azimuth)


class Planted(PointwiseAlbedo):
    """An albedo that is a given function of (parameters, cosine, azimuth), as if an engine had computed it.

    With `function` as that of a user's function is computed, azimuth and all; its quick rules err by up to `coarse`, 30 times
    less from level to level, and say so, and to them what is not finite is 0.
    """

    fast = property(lambda self: not self._function)
    levels = property(lambda self: 3 if self._function else 1)
    monotone = bounded = proved = one_by_one = one_of_many = two_sided = mirrored = False
    table = None

    def __init__(
        self,
        surface: Surface,
        ranges: dict,
        cos_theta=(0.0, 1.0),
        *,
        function: bool = False,
        anisotropic: bool = False,
        error: float = 1e-14,
        coarse: float = 0.0,
    ):
        self.family = Family("planted", lambda **_: None, ranges, cos_theta)
        self.names = tuple(ranges)
        self.swept = tuple(name for name, (low, high) in ranges.items() if low < high)
        self.evaluations = 0
        self.epsilon = 2.2e-16
        self.anisotropic = anisotropic
        self.evaluator = None
        self._function = function or anisotropic  # the exact engines know no azimuth
        self.engine = Adaptive if self._function else Zonal
        self._surface, self._error, self._coarse = surface, error, coarse

    def __call__(self, parameters, cos_theta, azimuth, *, rtol=None):
        self.evaluations += len(cos_theta)
        value = self._surface(parameters, cos_theta, azimuth)
        return value, np.full(len(cos_theta), self._error)

    def frozen(self, parameters, cos_theta, azimuth, rtol):
        value, error = self(parameters[None], np.array([cos_theta]), np.array([azimuth]))
        return Beside(float(value[0]), float(error[0]), self)

    def channels(self, parameters, cos_theta, azimuth, *, rtol=None):
        return self(parameters, cos_theta, azimuth)

    def estimated_channels(self, parameters, cos_theta, azimuth, level, *, both=False):
        value, error = self(parameters, cos_theta, azimuth)
        if not self._function:
            return value, error
        wave = self._coarse / 30**level * np.cos(7 * cos_theta + 3 * parameters.sum(axis=1) + 1)
        value = np.where(np.isfinite(value), value + wave, np.nan)
        return value, np.full(len(value), self._coarse if level == 0 else 0.0)


# --- planted maxima ---


@pytest.mark.parametrize("seed", range(12))
def test_a_bump_between_grid_points(seed: int):
    # As wide as two grid steps, centred anywhere: on the grid its peak is lost.
    random = np.random.default_rng(seed)
    n0, mu0 = 10 ** random.uniform(0.1, 2.9), random.uniform(0.03, 0.97)
    ridge = random.uniform(-3, 3)

    def surface(parameters, mu, _):
        x, y = np.log(parameters[:, 0] / n0) / 0.3, (np.sqrt(mu) - np.sqrt(mu0)) / 0.08
        return 0.9 + 0.13 * np.exp(-(x * x + y * y + ridge / 2 * x * y / 2)) + 0.02 * np.sin(3 * y) * np.exp(-x * x - y * y)

    albedo = Planted(surface, {"n": (1.0, 1000.0)})
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 801), np.linspace(-0.5, 0.5, 801))
    brute = np.max(surface((n0 * np.exp(0.3 * x)).reshape(-1, 1), (np.sqrt(mu0) + 0.08 * y).ravel().clip(0, 1) ** 2, None))
    found = supremum(albedo, intervals=False)
    assert found.value >= brute - 1e-12
    assert found.value <= brute + 2e-6
    assert found.value == surface(np.array([[found.parameters["n"]]]), np.array([found.cos_theta]), None)[0]
    assert found.error <= 1e-12
    coarse = surface(np.geomspace(1, 1000, 41).repeat(25)[:, None], np.tile(np.linspace(0, 1, 25) ** 2, 41), None)
    assert found.value > np.max(coarse)


@pytest.mark.parametrize("function", [False, True])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_a_peak_in_several_parameters(count: int, function: bool):
    place = np.array([0.31, 0.77, 0.52, 0.18, 0.66])[:count]

    def surface(parameters, mu, _):
        return 1.25 - np.sum((parameters - place) ** 2, axis=1) - (mu - 0.4) ** 2

    found = supremum(Planted(surface, {f"p{i}": (0.0, 1.0) for i in range(count)}, function=function, coarse=1e-3))
    assert found.value == pytest.approx(1.25, abs=1e-12)
    assert found.error < 1e-9
    assert found.settled
    assert list(found.parameters.values()) == pytest.approx(place, abs=1e-6)
    assert found.cos_theta == pytest.approx(0.4, abs=1e-6)
    assert found.above is None


def test_the_azimuth_of_an_anisotropic_family():
    def surface(_, mu, azimuth):
        return 0.8 + 0.3 * np.exp(np.cos(azimuth - 4.4) - 1) - (mu - 0.6) ** 2

    found = supremum(Planted(surface, {}, anisotropic=True))
    assert found.value == pytest.approx(1.1, abs=1e-9)
    assert found.azimuth == pytest.approx(4.4, abs=1e-4)
    still = supremum(Planted(surface, {}))
    assert still.azimuth == 0
    assert still.value == pytest.approx(0.8 + 0.3 * np.exp(np.cos(4.4) - 1), abs=1e-12)


def test_a_kink_is_climbed_and_its_uncertainty_is_in_the_bar():
    found = supremum(Planted(lambda p, mu, _: 1 - np.abs(np.log(p[:, 0]) - 2.7182) / 5 + 0 * mu, {"n": (1.0, 1000.0)}))
    assert 1 - found.value <= max(found.error, 1e-3)
    assert found.value > 1 - 1e-3


def test_a_ridge_across_the_axes_is_followed():
    # Level within 1e-3 along p + q = 1.1 and 1e4 times as steep across: zigzags along the axes would not arrive.
    def surface(parameters, mu, _):
        along, across = parameters[:, 0] - parameters[:, 1] - 0.4, parameters.sum(axis=1) - 1.1
        return 1.1 - 1e-3 * along**2 - 10 * across**2 - 0.01 * (mu - 0.7) ** 2

    found = supremum(Planted(surface, {"p": (0.0, 1.0), "q": (0.0, 1.0)}))
    assert found.value == pytest.approx(1.1, abs=1e-11)
    assert list(found.parameters.values()) == pytest.approx([0.75, 0.35], abs=1e-4)


def test_of_two_peaks_the_higher_one_though_it_is_narrow():
    def surface(parameters, mu, _):
        x = parameters[:, 0]
        wide = 1 - (x - 0.2) ** 2 - 0.1 * (mu - 0.5) ** 2
        return np.maximum(wide, 1.2 - ((x - 0.83) / 0.02) ** 2 - ((mu - 0.3) / 0.02) ** 2)

    found = supremum(Planted(surface, {"x": (0.0, 1.0)}))
    assert found.value == pytest.approx(1.2, abs=1e-11)
    assert found.parameters["x"] == pytest.approx(0.83, abs=1e-6)


@pytest.mark.parametrize("effort", few(["quick", "normal", "thorough"], ("quick",)))
@pytest.mark.parametrize("function", [False, True])
def test_nothing_wider_than_it_says_is_missed(effort: str, function: bool):
    """Slabs a little wider than `width` in one coordinate, wherever they are."""
    ranges = {"a": (0.0, 1.0), "b": (-2.0, 2.0)}
    flat = supremum(Planted(lambda p, mu, _: np.full(len(mu), 0.5), ranges, function=function), effort=effort)
    assert set(flat.width) == {"a", "b", "angle", "cell", *(["view"] if function else [])}
    random = np.random.default_rng(8)
    for place in random.uniform(0.05, 0.95, 4):
        half_a, half_angle = 0.51 * flat.width["a"], 0.51 * flat.width["angle"]

        def slab_of_a(p, mu, _, place=place, half=half_a):
            return np.where(np.abs(p[:, 0] - place) < half, 1.5, 0.5)

        def slab_of_angle(p, mu, _, place=place, half=half_angle):
            return np.where(np.abs(np.degrees(np.arccos(mu)) - 90 * place) < half, 1.5, 0.5)

        for surface in (slab_of_a, slab_of_angle):
            assert supremum(Planted(surface, ranges, function=function), effort=effort).value == 1.5


def test_more_effort_looks_at_more_points_and_misses_less():
    def surface(parameters, mu, _):
        return 0.9 - (parameters[:, 0] - 0.3) ** 2 - (mu - 0.6) ** 2

    found = [supremum(Planted(surface, {"a": (0.0, 1.0)}), effort=effort) for effort in EFFORTS]
    assert [one.value for one in found] == pytest.approx([0.9] * 3, abs=1e-12)
    assert 1000 < found[0].points < found[1].points < found[2].points
    assert found[0].width["a"] > found[1].width["a"] > found[2].width["a"]
    assert all(one.climbs > 0 for one in found)


def test_what_the_answer_rests_on():
    for lobe in (Phong, BlinnPhong, BinomialPower):
        exact = largest(scaled(lobe, 2.0, 30.0), n=(1.0, 1000.0))
        assert exact.basis == "theorem"
        assert set(exact.width) == {"n"}
        assert exact.settled
    one = largest(lambda: Phong(7.0))
    assert (one.basis, one.width, one.settled) == ("theorem", {}, True)
    unclamped = largest(scaled(lambda n: BinomialPower(n, clamped=False), 6.0, 24.55), n=(30.0, 100.0))
    assert unclamped.basis == "search"
    # The theorem is about light along N: elsewhere the angle is looked for.
    beside = largest(scaled(BlinnPhong, 8.0, 8 * np.pi), (0.1, 0.9), n=(1.0, 100.0))
    assert beside.basis == "search"
    assert set(beside.width) == {"n", "angle", "cell"}


@pytest.mark.parametrize("build", [lambda n: Phong(n), lambda n: CookTorrance(1 / n)], ids=["lobe", "facets"])
def test_at_a_single_place_there_is_nothing_to_climb(build: Callable):
    family = Family("test", build, {"n": (9.0, 9.0)}, (0.3, 0.3))
    found = supremum(PointwiseAlbedo(family))
    exact = albedo(build(9.0), 0.3)
    value, error = (float(np.max(part)) for part in (exact.value, exact.error))
    assert found.climbs == 0
    assert found.settled
    assert found.parameters == {"n": 9.0}
    assert found.cos_theta == 0.3
    assert abs(found.value - value) <= found.error + error
    assert found.error < 1e-9
    coarse = supremum(PointwiseAlbedo(family), rtol=1e-2)  # which is for what costs more than these
    assert coarse.error < 1e-9


def test_at_a_single_place_rules_of_a_function_are_to_agree():
    """Dents of one thousandth: the rule of a verdict alone claims nine digits, and is off by 1e-4."""

    def dent(z):
        return -3 * jnp.exp(-(((z - 0.1328) / 1e-3) ** 2))

    family = Family("dents", lambda: lambda wi, wo: 0.2 + dent(wo[..., 2]) + dent(wi[..., 2]), {}, (0.95, 0.95))
    found = supremum(PointwiseAlbedo(family))
    assert found.error > 1e-5


@pytest.mark.parametrize("name", few(catalog.names(), ("blinn-phong-8", "kuijk-blake-mirror", "binomial-power-unclamped")))
def test_the_theorem_says_what_the_full_search_finds(name: str, monkeypatch: pytest.MonkeyPatch):
    family = catalog.entry(name).family
    short = supremum(PointwiseAlbedo(family), intervals=False)
    if not PointwiseAlbedo(family).monotone:
        assert short.basis == ("theorem" if PointwiseAlbedo(family).bounded else "search")
        return
    monkeypatch.setattr(PointwiseAlbedo, "monotone", False)
    full = supremum(PointwiseAlbedo(family), intervals=False)
    assert (short.basis, full.basis) == ("theorem", "search")
    assert abs(short.value - full.value) <= short.error + full.error
    assert short.points < full.points or not family.ranges


FACETS = ["cook-torrance", "beckmann-smith", "beckmann-smith-correlated", "ggx"]


@pytest.mark.parametrize("name", few(FACETS, ("ggx",)))
def test_masked_facets_are_never_above_one(name: str, monkeypatch: pytest.MonkeyPatch):
    family = catalog.entry(name).family
    short = supremum(PointwiseAlbedo(family))
    assert (short.basis, short.theorem, short.settled) == ("theorem", NEVER_ABOVE_ONE, True)
    assert judge(short.value, short.error, settled=short.settled) is Verdict.CONSERVES
    monkeypatch.setattr(PointwiseAlbedo, "bounded", False)
    full = supremum(PointwiseAlbedo(family))
    assert full.basis == "search"
    assert abs(short.value - full.value) <= short.error + full.error
    assert 2 * short.points < full.points


def test_the_theorem_on_facets_asks_for_its_premises():
    half = np.array([0.5, 0.5])
    assert CookTorrance(half, weights=half).bounded
    assert GGX(0.3, f0=[0.2, 1.0, 0.5], masking="smith-separable").bounded
    for lobe in (
        CookTorrance(0.3, masking="none"),
        CookTorrance(0.3, convention="published"),
        CookTorrance(half, weights=[0.5, 0.6]),
    ):
        assert not lobe.bounded
    # What is not known when a family is traced is no premise: weights that run beyond 1 violate.
    family = Family("glows", lambda w: CookTorrance(0.3, weights=w), {"w": (0.5, 1.5)})
    found = supremum(PointwiseAlbedo(family), effort="quick")
    assert found.basis == "search"
    assert found.value == pytest.approx(1.5 * float(albedo(CookTorrance(0.3), found.cos_theta).value), rel=1e-6)


def test_the_theorem_on_facets_asks_what_a_lobe_holds_now():
    """A premise that was true once: the search still looks."""
    made = GGX(0.3, 0.5, fresnel="schlick")
    lobe = eqx.tree_at(lambda lobe: lobe.f0, made, jnp.asarray(1.3))
    assert made.bounded
    assert not lobe.bounded
    report = check(lobe, effort="quick")
    assert report.basis == "search"
    assert report.verdict is Verdict.VIOLATES


def test_the_search_tells_how_far_it_is():
    told: list[tuple[int, float]] = []
    albedo = Planted(lambda p, mu, _: 0.9 - (p[:, 0] - 0.3) ** 2 - (mu - 0.6) ** 2, {"a": (0.0, 1.0)})
    found = supremum(albedo, watch=lambda points, best: told.append((points, best)))
    points = [count for count, _ in told]
    assert len(told) > 3
    assert points == sorted(points)
    assert points[-1] <= found.points
    assert told[-1][1] == pytest.approx(0.9, abs=1e-9)
    assert all(best <= 0.9 for _, best in told)


# --- without bound ---


@pytest.mark.parametrize("function", [False, True])
@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("kind", ["line", "point", "end"])
def test_a_pole_is_no_number(kind: str, power: float, function: bool):
    """For one value of a parameter at all angles, inside the box or at its end, and at one angle only."""
    place = 1.0 if kind == "end" else 0.371

    def surface(parameters, mu, _):
        with np.errstate(divide="ignore"):
            return 0.1 * np.hypot(parameters[:, 0] - place, mu - 0.6 if kind == "point" else 0.0) ** -power

    found = supremum(Planted(surface, {"a": (0.0, 1.0)}, function=function))
    assert (found.value, found.least) == (np.inf, np.inf)
    assert found.unbounded is not None
    assert kind == "end" or found.unbounded.startswith("towards a=0.371")
    assert found.parameters["a"] == pytest.approx(place, abs=1e-3)
    if kind == "point":
        assert found.cos_theta == pytest.approx(0.6, abs=1e-3)


@pytest.mark.parametrize("function", [False, True])
def test_a_tall_peak_is_a_number(function: bool):
    def surface(parameters, mu, _):
        return 1e4 / (1 + ((parameters[:, 0] - 0.371) / 3e-3) ** 2 + ((mu - 0.6) / 3e-2) ** 2)

    found = supremum(Planted(surface, {"a": (0.0, 1.0)}, function=function))
    assert found.value == pytest.approx(1e4, rel=1e-9)
    assert found.unbounded is None


@pytest.mark.slow
def test_grazing_light_without_bound():
    found = largest(lambda: PerCosine(Phong(5.0)))
    assert (found.value, found.unbounded, found.cos_theta) == (np.inf, "towards grazing incidence", 0.0)
    # Like 1 / mu until the rounding of the engine holds it.
    found = largest(lambda alpha: GGX(alpha, masking="none"), alpha=(0.05, 1.0))
    assert (found.value, found.unbounded, found.cos_theta) == (np.inf, "towards grazing incidence", 0.0)
    # E = k mu^(-k/4): of a function only its limit tells.
    found = largest(lambda k: lambda wi, wo: k / jnp.pi * wi[..., 2] ** (-k / 4) + 0 * wo[..., 2], k=(0.0, 1.0))
    assert (found.value, found.unbounded, found.cos_theta) == (np.inf, "towards grazing incidence", 0.0)
    assert found.parameters["k"] > 0


@pytest.mark.slow
def test_the_limit_at_grazing_incidence_is_the_supremum():
    # E = (1.02 - 0.1 mu^0.3) (1 - (k - 0.4)^2): 2e-4 above its value at a cosine of 1e-9.
    def build(k):
        return lambda wi, wo: (1.02 - 0.1 * wi[..., 2] ** 0.3) * (1 - (k - 0.4) ** 2) / jnp.pi + 0 * wo[..., 2]

    found = largest(build, k=(0.0, 1.0))
    assert abs(found.value - 1.02) <= found.error
    assert found.error < 1e-6
    assert (found.cos_theta, found.unbounded) == (0.0, None)
    assert found.parameters["k"] == pytest.approx(0.4, abs=1e-3)


@pytest.mark.parametrize(
    ("count", "function"),
    [
        (1, False),
        (3, True),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((1, True), (2, False), (2, True), (3, False))),
    ],
)  # fmt: skip
def test_a_kink_across_the_axes_is_in_the_bar(count: int, function: bool):
    # A roof whose crest is no axis: 1.05 in the middle of it.
    def surface(parameters, mu, _):
        x = np.column_stack([parameters, mu]) - 0.45
        return 1.05 - np.abs(np.sum(x, axis=1)) - 0.1 * np.sum(x**2, axis=1)

    found = supremum(Planted(surface, {f"p{i}": (0.0, 1.0) for i in range(count)}, function=function), intervals=False)
    assert found.value + found.error >= 1.05
    assert found.value > 1.04


@pytest.mark.slow
def test_a_needle_that_the_quick_rules_blur_has_no_kink():
    # Their noise looks like one: 0.999 +- 0.002 it was, which decides nothing.
    def needle(wi, wo, n):
        return 0.999 * (n + 2) / (2 * jnp.pi) * jnp.maximum(jnp.sum(wi * jnp.array([-1.0, -1.0, 1.0]) * wo, -1), 0) ** n

    found = supremum(PointwiseAlbedo(Family("needle", lambda n: lambda wi, wo: needle(wi, wo, n), {"n": (1.0, 1e4)})))
    assert abs(found.value - 0.999) <= found.error < 1e-4


def test_a_quick_search_resolves_what_the_second_rule_does_not():
    # Phong to 200: more points are in doubt than a quick search takes by the third rule, which tells that none is higher.
    def phong(n):
        return lambda wi, wo: (n + 2) / (2 * jnp.pi) * jnp.maximum(jnp.sum(wi * jnp.array([-1.0, -1.0, 1.0]) * wo, -1), 0) ** n

    found = supremum(PointwiseAlbedo(Family("phong", phong, {"n": (1.0, 200.0)})), effort="quick")
    assert abs(found.value - 1) <= found.error < 1e-9
    assert found.width["n"] < 0.005
    assert found.width["angle"] < 1


@pytest.mark.slow  # like the next one
def test_a_weak_kink_across_the_axes_is_in_the_bar():
    # Its slope is 5e-3, and that of its crest 1.5e-5: 4e-8 were missed with a bar of 2e-10.
    def build(p, q):
        u, v = -0.294 * (p - 0.4) - 0.956 * (q - 0.7), 0.956 * (p - 0.4) - 0.294 * (q - 0.7)
        value = 1 + 2.4e-7 - 0.00492 * jnp.abs(u) - 1.5e-5 * jnp.maximum(v, -0.2 * v) - 2.5e-6 * (u**2 + v**2)
        return lambda wi, wo: value / jnp.pi + 0 * wo[..., 2]

    found = supremum(PointwiseAlbedo(Family("kink", build, {"p": (0.0, 1.0), "q": (0.0, 1.0)})))
    assert found.value + found.error >= 1 + 2.4e-7


@pytest.mark.slow  # a steeper one beside a corner runs every time
def test_the_crest_of_a_weak_kink_is_followed_to_its_top():
    # It was called conserving: the climbs took its slope of 3.5e-4 for a bend.
    def build(p, q):
        x, y = p - 0.5904583781437073, q - 0.5098823526196596
        u, v = -0.9778511644988944 * x - 0.209301457443937 * y, 0.209301457443937 * x - 0.9778511644988944 * y
        fall = 3.5048259910162e-4 * jnp.abs(u) + 3.4547237975913e-5 * (0.3 * jnp.maximum(v, -0.2 * v) + 0.05 * (u**2 + v**2))
        return lambda wi, wo: (1.000000004 - fall) / jnp.pi + 0 * wo[..., 2]

    found = supremum(PointwiseAlbedo(Family("kink", build, {"p": (0.0, 1.0), "q": (0.0, 1.0)})))
    assert abs(found.value - 1.000000004) <= found.error < 2e-9


def test_a_top_where_three_kinks_meet():
    # It was known to 0.002 only, which does not tell it from 1.
    def build(p):
        def value(wi):
            x, y = p - 0.77, wi[..., 2] - 0.185
            return 0.999 + jnp.minimum(jnp.minimum(0.15 * x + 0.036 * y, 0.22 * y - 0.043 * x), -0.028 * x - 0.156 * y)

        return lambda wi, wo: value(wi) / jnp.pi + 0 * wo[..., 2]

    found = supremum(PointwiseAlbedo(Family("planes", build, {"p": (0.0, 1.0)})))
    assert abs(found.value - 0.999) <= found.error < 1e-7


@pytest.mark.slow
def test_a_curved_crest_that_hardly_rises_is_in_the_bar():
    # Its slope is 0.39 across and 2.5e-6 along: 4e-8 were missed with a bar of 6e-9.
    def build(p, q):
        x, y = p - 0.256, q - 0.279
        v = -0.374 * x - 0.927 * y
        fall = 0.39 * jnp.abs(-0.927 * x + 0.374 * y + 0.39 * v * v) + 2.5e-6 * (jnp.abs(v) + 0.1 * v * v)
        return lambda wi, wo: jnp.maximum(1.000000004 - fall, 0.05) / jnp.pi + 0 * wo[..., 2]

    found = supremum(PointwiseAlbedo(Family("crest", build, {"p": (0.0, 1.0), "q": (0.0, 1.0)})))
    assert found.value + found.error >= 1.000000004


@pytest.mark.parametrize("count", few([2, 3], [2]))
def test_the_top_of_a_channel_that_another_surrounds(count: int):
    # Red is above green on 1 % (4 %) of each range: the largest of both is level but there, and CONSERVES it was.
    top, level = (1.00001, 0.999995) if count == 2 else (1.0001, 0.9999)

    def build(**values):
        red = top - 0.5 * sum((value - x) ** 2 for value, x in zip(values.values(), (0.371, 0.613, 0.44), strict=False))
        return lambda wi, wo: jnp.stack([red, level, 0.5], -1) / jnp.pi + 0 * wo[..., 2:]

    # Of few angles, none of which matters.
    family = Family("red", build, {f"p{i}": (0.0, 1.0) for i in range(count)}, (0.4, 0.6))
    found = supremum(PointwiseAlbedo(family), intervals=False)
    assert abs(found.value - top) <= found.error < 1e-9
    assert found.channel == 0


@pytest.mark.parametrize("near", few([(1e-5, 3e-5), (2.7e-6, 0.0)], [(1e-5, 3e-5)]))
def test_the_crest_of_a_kink_beside_a_corner(near: tuple[float, float]):
    # It was called conserving: climbs ended in the corner, 2e-5 below the crest that passes it.
    def build(p, q):
        u, v = p - near[0], q - near[1]
        fall = jnp.abs(0.6 * u - 0.8 * v) + 0.05 * (jnp.abs(u) + jnp.abs(v))
        return lambda wi, wo: (1.000015 - fall) / jnp.pi + 0 * wo[..., 2]

    # Of few angles, none of which matters.
    found = supremum(PointwiseAlbedo(Family("kink", build, {"p": (0.0, 1.0), "q": (0.0, 1.0)}, (0.4, 0.6))), intervals=False)
    assert found.value == pytest.approx(1.000015, abs=1e-9)
    assert abs(found.value - 1.000015) <= found.error


@pytest.mark.parametrize("centres", few([(0.3456, 0.7123), (0.105, 0.2003, 0.9051)], [(0.105, 0.2003, 0.9051)]))
def test_each_narrow_interval_of_violation_is_named(centres: tuple[float, ...]):
    # Each as wide as 0.4 % of the range, and about another angle: one alone was named, that of the winner.
    def build(p):
        def value(wi):
            heights = [
                0.1 * jnp.exp(-(((p - centre) / 0.002) ** 4) - (wi[..., 2] - 0.2 - 0.6 * centre) ** 2) for centre in centres
            ]
            return 0.95 + sum(heights)

        return lambda wi, wo: value(wi) / jnp.pi + 0 * wo[..., 2]

    above = supremum(PointwiseAlbedo(Family("bumps", build, {"p": (0.0, 1.0)}))).above
    half = 0.002 * np.log(2) ** 0.25
    np.testing.assert_allclose(above, [(centre - half, centre + half) for centre in centres], atol=1e-5)


def not_finite(value: float) -> Surface:
    def surface(parameters, mu, _):
        return np.where((parameters[:, 0] > 500) & (mu < 0.1), value, 0.5)

    return surface


def test_what_is_infinite_is_returned_with_its_place():
    found = supremum(Planted(not_finite(np.inf), {"n": (1.0, 1000.0)}))
    assert (found.value, found.error, found.least) == (np.inf, np.inf, np.inf)
    assert found.unbounded is not None
    assert found.parameters["n"] > 500
    assert found.cos_theta < 0.1


@pytest.mark.parametrize("function", [False, True])
def test_where_the_albedo_is_not_a_number_it_is_not_known(function: bool):
    found = supremum(Planted(not_finite(np.nan), {"n": (1.0, 1000.0)}, function=function))
    assert np.isnan(found.value) or np.isinf(found.error)
    everywhere = supremum(Planted(lambda p, mu, _: np.full(len(mu), np.nan), {"n": (1.0, 1000.0)}, function=function))
    assert np.isnan(everywhere.value)
    assert not everywhere.settled


def test_intervals_of_a_wave():
    # 1 + 0.01 sin(4 log n) exceeds 1 on three intervals of [1, 1000].
    def surface(parameters, mu, _):
        return 1 + 0.01 * np.sin(4 * np.log(parameters[:, 0])) - 0.2 * (mu - 0.35) ** 2

    found = supremum(Planted(surface, {"n": (1.0, 1000.0)}), threshold=1.0)
    expected = [(np.exp(2 * k * np.pi / 4), min(np.exp((2 * k + 1) * np.pi / 4), 1000)) for k in range(5)]
    assert found.above is not None
    assert len(found.above) == len(expected)
    np.testing.assert_allclose(found.above, expected, rtol=1e-5)
    none = supremum(Planted(surface, {"n": (1.0, 1000.0)}), threshold=1.02)
    assert none.above == ()
    assert supremum(Planted(surface, {"n": (1.0, 1000.0)}), intervals=False).above is None


def test_an_interval_narrower_than_the_grid():
    def surface(parameters, mu, _):
        return 1.001 - (np.log(parameters[:, 0] / 77.7) / 0.3) ** 2 - 0.1 * (1 - mu)

    found = supremum(Planted(surface, {"n": (1.0, 1000.0)}), threshold=1.0)
    half_width = 0.3 * np.sqrt(0.001)
    assert found.above is not None
    np.testing.assert_allclose(found.above, [(77.7 * np.exp(-half_width), 77.7 * np.exp(half_width))], rtol=1e-6)


@pytest.mark.slow
def test_the_interval_of_a_spot_that_the_quick_rules_do_not_see():
    axis, height = np.array([np.sin(0.8), 0.0, np.cos(0.8)]), 1 - np.cos(0.01)
    share = 2 * np.pi * (height / 3 - height**2 / 12) * axis[2]

    def spot(p):
        def brdf(wi, wo):
            cap = jnp.maximum(1 - jnp.sum((wo - axis) ** 2, -1) / 2 / height, 0) ** 2
            return 0.7 / jnp.pi + 0.6 * jnp.maximum(1 - ((p - 0.37) / 0.07) ** 2, 0) * cap / share + 0 * wi[..., 2]

        return brdf

    found = supremum(PointwiseAlbedo(Family("spot", spot, {"p": (0.0, 1.0)})))
    assert found.above is not None
    half = 0.07 * np.sqrt(0.5)
    np.testing.assert_allclose(found.above, [(0.37 - half, 0.37 + half)], atol=1e-5)


@pytest.mark.parametrize("function", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_a_narrow_violation_that_shows_at_few_angles(seed: int, function: bool):
    """A bump 1 % by 20 % of two parameters wide, beside one without effect; the albedo falls with the angle, to 3 %."""
    random = np.random.default_rng(seed)
    a, b = random.uniform(0.1, 0.9, 2)

    def surface(parameters, mu, _):
        bump = np.maximum(1 - ((parameters[:, 0] - a) / 0.005) ** 2, 0) * np.maximum(1 - ((parameters[:, 1] - b) / 0.1) ** 2, 0)
        return (0.9 + 0.1000001 * bump) * (0.03 + 0.97 * mu**2)

    ranges = {"a": (0.0, 1.0), "b": (0.0, 1.0), "idle": (0.0, 1.0)}
    found = supremum(Planted(surface, ranges, function=function, coarse=1e-3))
    assert found.value == pytest.approx(1.0000001, abs=1e-9)


def test_a_climb_that_was_not_finished_does_not_conserve(monkeypatch: pytest.MonkeyPatch):
    """With rounds for a few steps only, up a bent ridge that ends beyond the line."""

    def surface(parameters, mu, _):
        x, y = parameters.T
        return 1.00001 - 0.02 * (1 - x) ** 2 - 40 * (y - 0.3 * np.sin(3 * x)) ** 2 + 0 * mu

    planted = Planted(surface, {"x": (0.0, 1.0), "y": (-1.0, 1.0)}, (1.0, 1.0), function=True)
    whole = supremum(planted, effort="quick")
    assert whole.value + whole.error >= 1.00001 - 1e-9
    assert whole.least > 1
    for module in ("brdfcheck.verdict.supremum.climb", "brdfcheck.verdict.confirm.climb"):
        monkeypatch.setattr(module, lambda *given, **options: climb(*given, **{**options, "rounds": 1}))
    cut = supremum(planted, effort="quick")
    verdict = judge(cut.value, cut.error, least=cut.least, settled=cut.settled)
    assert verdict is not Verdict.CONSERVES
