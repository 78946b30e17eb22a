"""Functions are asked on one side of the plane of incidence where both are the same, and on both where they are not."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.microfacet import GGX
from brdfcheck.quadrature import pointwise
from brdfcheck.quadrature.adaptive import integrate_hemisphere
from brdfcheck.quadrature.pointwise import PointwiseAlbedo, TwoSided
from brdfcheck.verdict.supremum import supremum


def lopsided(sign: float, width: float = np.inf):
    """0.9, and beside p = 0.6 up to 0.15 more, all of which is reflected to one side: the left, or for -1 the right."""

    def build(p):
        def brdf(wi, wo):
            side = (1 + jnp.tanh(20 * sign * (wi[..., 0] * wo[..., 1] - wi[..., 1] * wo[..., 0]))) / 2
            return (0.9 + 0.3 * jnp.maximum(1 - ((p - 0.6) / width) ** 2, 0) * side) / jnp.pi

        return brdf

    return PointwiseAlbedo(Family("lopsided", build, {"p": (0.0, 1.0)}, (0.4, 0.6)))  # few angles, none of which matters


@pytest.mark.parametrize(
    ("sign", "width"),
    [(-1.0, 0.01), *(pytest.param(*one, marks=pytest.mark.slow) for one in ((1.0, np.inf), (-1.0, np.inf), (1.0, 0.01)))],
)
def test_what_is_reflected_to_one_side(sign: float, width: float):
    albedo = lopsided(sign, width)
    found = supremum(albedo, intervals=False)
    assert (albedo.anisotropic, albedo.two_sided, albedo.mirrored) == (False, True, False)
    assert abs(found.value - 1.05) <= found.error < 1e-6


def test_what_is_found_out_late(monkeypatch: pytest.MonkeyPatch):
    """The side that is asked has all of it, which the albedo of both sides at the winner tells."""
    searches = []

    def sees_nothing(albedo: PointwiseAlbedo) -> None:
        albedo.two_sided, albedo.mirrored = False, not searches
        searches.append(albedo)

    monkeypatch.setattr(PointwiseAlbedo, "look_at_sides", sees_nothing)
    albedo = lopsided(1.0, 0.3)
    found = supremum(albedo, intervals=False)
    assert len(searches) == 2
    assert abs(found.value - 1.05) <= found.error < 1e-6


@pytest.mark.parametrize("sign", few([1.0, -1.0], (1.0,)))  # the side that is not asked
def test_a_window_that_every_fourth_point_of_a_scan_misses(sign: float):
    # 10 % of p by 8 degrees: 0.999 it was for the side that is not asked.
    def build(p):
        def brdf(wi, wo):
            theta = jnp.degrees(jnp.arccos(jnp.clip(wi[..., 2], -1, 1)))
            inside = (jnp.abs(p - 0.2282) < 0.05) & (jnp.abs(theta - 59.45) < 4)
            side = sign * (wi[..., 1] * wo[..., 0] - wi[..., 0] * wo[..., 1])
            return jnp.where(inside, 1.05 * (1 + 0.9 * side), 0.999) / jnp.pi

        return brdf

    found = supremum(PointwiseAlbedo(Family("window", build, {"p": (0.0, 1.0)})), intervals=False)
    assert abs(found.value - 1.05) <= found.error + 1e-9 < 1e-6


def test_a_later_scan_that_sees_two_sides():
    albedo = lopsided(1.0, 0.3)
    albedo.mirrored = True
    place = np.array([[0.6]]), np.array([0.5]), np.zeros(1)
    albedo.estimate(*place, 0)
    with pytest.raises(TwoSided):
        albedo.estimate(*place, 0, both=True)


def test_both_sides_are_told_apart_at_a_place(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(pointwise, "has_two_sides", lambda *_: False)
    albedo = lopsided(1.0, 0.3)
    albedo.look_at_sides()
    assert albedo.mirrored
    place = np.array([[0.1]]), np.array([0.5]), np.zeros(1)
    albedo.confirm_sides(*place)  # there is nothing there
    with pytest.raises(TwoSided):
        albedo.confirm_sides(np.array([[0.6]]), *place[1:])


def test_one_side_costs_half_and_says_the_same():
    lobe = GGX(0.3)

    def build(k):
        return lambda wi, wo: k * lobe(wi, wo)

    place = np.array([[0.8]]), np.array([0.4]), np.array([0.7])
    answers = {}
    for mirrored in (False, True):
        albedo = PointwiseAlbedo(Family("ggx", build, {"k": (0.0, 1.0)}))
        if mirrored:
            albedo.look_at_sides()
        assert albedo.mirrored is mirrored
        value, error = albedo(*place)
        asked = albedo.evaluations
        quick = [albedo.estimate(*place, level)[0] for level in range(albedo.levels)]
        answers[mirrored] = value, error, asked, *quick
    whole, half = answers[False], answers[True]
    assert abs(whole[0] - half[0]) <= whole[1] < 1e-8
    assert half[2] == pytest.approx(whole[2] / 2, rel=0.01)
    np.testing.assert_allclose(half[3], whole[3], rtol=1e-12)  # others have rules of their own
    np.testing.assert_allclose(half[4:], whole[4:], rtol=1e-4)


def test_an_integral_of_one_side_has_the_bar_of_both():
    def value(wo):
        return np.exp(-40 * (wo[:, 0] + 0.3) ** 2 - 10 * np.abs(wo[:, 1]))

    whole, half = (integrate_hemisphere(value, 0.6, tolerance=1e-7, half=half) for half in (False, True))
    assert abs(half.value - whole.value) <= half.error < 1e-7
    assert half.error > whole.error / 4
    assert half.evaluations == pytest.approx(whole.evaluations / 2, rel=0.01)
