"""The largest albedo over a box: known maxima of lobes, and planted ones that a grid does not see."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from brdfcheck.factors import Factor, Normalized, PerCosine
from brdfcheck.family import Family
from brdfcheck.lobes import BinomialPower, BlinnPhong, Phong
from brdfcheck.microfacet import CookTorrance
from brdfcheck.pointwise import PointwiseAlbedo
from brdfcheck.verdict.supremum import Supremum, supremum

Surface = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def largest(build: Callable, cos_theta: tuple[float, float] = (0.0, 1.0), **ranges: tuple[float, float]) -> Supremum:
    return supremum(PointwiseAlbedo(Family("test", build, ranges, cos_theta)))


def scaled(lobe: Callable, a: float, b: float) -> Callable:
    return lambda n: Normalized(lobe(n), Factor(a, b))


class Planted(PointwiseAlbedo):
    """An albedo that is a given function of (parameters, cosine, azimuth), as if an engine had computed it."""

    def __init__(
        self, surface: Surface, ranges: dict, cos_theta=(0.0, 1.0), *, anisotropic: bool = False, error: float = 1e-14
    ):
        self.family = Family("planted", lambda **_: None, ranges, cos_theta)
        self.names = tuple(ranges)
        self.evaluations = 0
        self.anisotropic = anisotropic
        self.evaluator = None
        self.engine = "adaptive" if anisotropic else "zonal"  # the exact engines know no azimuth
        self._surface, self._error = surface, error

    def __call__(self, parameters, cos_theta, azimuth, *, rtol=None):
        self.evaluations += len(cos_theta)
        value = self._surface(parameters, cos_theta, azimuth)
        return value, np.full(len(cos_theta), self._error)


# --- lobes ---


def test_the_sixteenth_power_with_its_published_factor():
    found = largest(scaled(BinomialPower, 6.0, 24.55), n=(1.0, 1000.0))
    assert found.value == pytest.approx(1.0016005217, abs=1e-10)
    assert found.parameters["n"] == pytest.approx(17.8511976, abs=1e-4)
    assert found.cos_theta == 1
    assert found.error <= 1e-12
    assert found.above is not None
    # The reference crosses 1 itself, ours 1 + 1e-9: 1e-5 apart.
    assert found.above == (pytest.approx((14.303004, 23.056070), abs=1e-5),)


def test_blinn_phong_with_eight():
    found = largest(scaled(BlinnPhong, 8.0, 8 * np.pi), n=(1.0, 1000.0))
    assert found.value == pytest.approx(1.0752011615, abs=1e-10)
    assert found.parameters["n"] == pytest.approx(8.7637414, abs=1e-4)
    assert found.above == ((1.0, 1000.0),)


def test_the_raw_sixteenth_power_conserves_from_18_6():
    found = largest(BinomialPower, n=(1.0, 1000.0))
    assert (found.parameters, found.cos_theta) == ({"n": 1.0}, 1.0)
    assert found.value == pytest.approx(2.8777046827, abs=1e-9)
    assert found.above is not None
    assert found.above[0] == pytest.approx((1.0, 18.588159660), abs=1e-6)
    beyond = largest(BinomialPower, n=(18.5882, 1000.0))
    assert beyond.value < 1
    assert beyond.above == ()


def test_normal_incidence_is_not_the_worst_for_the_unclamped_lobe():
    unclamped = scaled(lambda n: BinomialPower(n, clamped=False), 6.0, 24.55)
    found = largest(unclamped, n=(30.0, 100.0))
    assert found.cos_theta < 0.05
    assert found.above is not None
    assert found.above[0] == pytest.approx((36.27819, 100.0), abs=1e-5)
    # At normal incidence alone it is innocent up to n = 110.4.
    straight = largest(unclamped, (1.0, 1.0), n=(30.0, 200.0))
    assert straight.above is not None
    assert straight.above[0] == pytest.approx((110.4, 200.0), abs=0.05)


def test_a_restricted_range_of_cosines():
    mu = float(np.cos(np.radians(89)))
    found = largest(lambda n: PerCosine(Normalized(Phong(n), Factor(2, 2 * np.pi))), (mu, 1.0), n=(1.0, 1000.0))
    assert found.value == pytest.approx(18.7415167, abs=1e-6)
    assert (found.cos_theta, found.parameters) == (mu, {"n": 1.0})
    middle = largest(lambda n: PerCosine(Normalized(Phong(n), Factor(2, 2 * np.pi))), (np.cos(np.radians(75)), 1.0), n=(1, 1))
    assert middle.value == pytest.approx(1.77, abs=5e-3)
    below = largest(scaled(BinomialPower, 6.0, 24.55), (0.2, 0.9), n=(1.0, 1000.0))
    assert below.cos_theta == pytest.approx(0.9, rel=1e-15)
    assert below.value < 1


def test_grazing_is_the_worst_of_rough_metal():
    found = largest(CookTorrance, m=(0.8, 1.0))
    assert found.cos_theta < 0.01
    assert 0.98 < found.value <= 1 + 1e-9
    assert largest(CookTorrance, (1.0, 1.0), m=(1.0, 1.0)).value == pytest.approx(0.453447, abs=1.1e-6)


def test_two_parameters():
    # A factor (n + A)/24.55 on n in [1, 1000], A in [5, 6]: the same peak, at the upper end of A.
    found = largest(lambda n, A: Normalized(BinomialPower(n), Factor(A, 24.55)), n=(1.0, 1000.0), A=(5.0, 6.0))
    assert found.value == pytest.approx(1.0016005217, abs=1e-9)
    assert found.parameters["n"] == pytest.approx(17.8511976, abs=1e-3)
    assert found.parameters["A"] == 6
    assert found.above is None


def test_no_parameter():
    found = largest(lambda: Normalized(Phong(50.0), Factor(2, 2 * np.pi)))
    assert found.value == pytest.approx(1, abs=1e-12)
    assert (found.parameters, found.cos_theta, found.above) == ({}, 1.0, None)


# --- planted maxima ---


@pytest.mark.parametrize("seed", range(20))
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


@pytest.mark.parametrize("count", [2, 3])
def test_a_peak_in_several_parameters(count: int):
    place = np.array([0.31, 0.77, 0.52])[:count]

    def surface(parameters, mu, _):
        return 1.25 - np.sum((parameters - place) ** 2, axis=1) - (mu - 0.4) ** 2

    found = supremum(Planted(surface, {f"p{i}": (0.0, 1.0) for i in range(count)}))
    assert found.value == pytest.approx(1.25, abs=1e-12)
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


def test_the_error_bar_is_that_of_the_albedo():
    found = supremum(Planted(lambda p, mu, _: 1 - (mu - 0.5) ** 2, {}, error=1e-5))
    assert 1e-5 <= found.error < 2e-5
    assert found.value == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_what_is_not_finite_is_returned_with_its_place(value: float):
    def surface(parameters, mu, _):
        return np.where((parameters[:, 0] > 500) & (mu < 0.1), value, 0.5)

    found = supremum(Planted(surface, {"n": (1.0, 1000.0)}))
    assert found.value == pytest.approx(value, nan_ok=True)
    assert found.parameters["n"] > 500
    assert found.cos_theta < 0.1


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


def test_a_flat_surface():
    found = supremum(Planted(lambda p, mu, _: np.full(len(mu), 0.75), {"a": (0.0, 1.0)}))
    assert found.value == 0.75
    assert found.error == pytest.approx(1e-14)
