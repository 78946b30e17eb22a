"""The rule that an adaptive integral leaves: right at its own incidence, and moving smoothly with the light."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import Phong
from brdfcheck.brdf.microfacet import CookTorrance
from brdfcheck.quadrature.adaptive import integrate_hemisphere
from brdfcheck.quadrature.boxes import Grid, Mesh, initial_boxes
from brdfcheck.quadrature.pointwise import PointwiseAlbedo

COSINES = (1.0, 0.9, 0.71, 0.5, 0.1, 1e-3, 1e-7)


def mesh_of(f: Callable[[np.ndarray], np.ndarray], cosine: float) -> Mesh:
    return integrate_hemisphere(f, cosine, tolerance=1e-9).mesh


def lobe(cosine: float, power: float) -> Callable[[np.ndarray], np.ndarray]:
    mirror = np.array([-np.sqrt((1 - cosine) * (1 + cosine)), 0, cosine])
    return lambda wo: (power + 2) / (2 * np.pi) * np.maximum(wo @ mirror, 0) ** power


def filled(mesh: Mesh, cosine: float) -> tuple[np.ndarray, np.ndarray]:
    """wo (3, size) and weight (size,) at one cosine."""
    wo, weight = np.empty((3, 1, mesh.size)), np.empty((1, mesh.size))
    mesh.fill(np.array([cosine]), wo, weight)
    return wo[:, 0], weight[0]


def summed(mesh: Mesh, cosine: float, power: float) -> float:
    wo, weight = filled(mesh, cosine)
    return float(lobe(cosine, power)(wo.T) @ weight)


@pytest.mark.parametrize("cosine", COSINES)
@pytest.mark.parametrize("power", [2.0, 60.0, 1e4])
def test_at_its_own_incidence_it_gives_the_integral(cosine: float, power: float):
    found = integrate_hemisphere(lobe(cosine, power), cosine, tolerance=1e-9)
    assert found.mesh.size == filled(found.mesh, cosine)[1].size
    assert found.mesh.near(np.array([cosine])).all()
    assert summed(found.mesh, cosine, power) == pytest.approx(float(found.value), abs=1e-14)


@pytest.mark.parametrize("cosine", COSINES[1:-1])
def test_beside_it_the_sum_is_as_accurate(cosine: float):
    mesh = mesh_of(lobe(cosine, 60.0), cosine)
    for moved, power in ((cosine, 60.5), (1.003 * cosine, 60.0), (0.997 * cosine, 59.7)):
        exact = integrate_hemisphere(lobe(moved, power), moved, tolerance=1e-9)
        assert mesh.near(np.array([moved])).all()
        assert abs(summed(mesh, moved, power) - float(exact.value)) <= 2 * float(exact.error)


@pytest.mark.parametrize("cosine", COSINES[1:])
def test_the_boxes_fill_the_hemisphere_wherever_they_move(cosine: float):
    mesh = mesh_of(lobe(cosine, 60.0), cosine)
    for moved in (0.8 * cosine, cosine, min(1.2 * cosine, (1 + cosine) / 2)):
        if mesh.near(np.array([moved])).all():
            wo, weight = filled(mesh, moved)
            assert weight.sum() == pytest.approx(np.pi, rel=1e-9)
            assert np.linalg.norm(wo, axis=0) == pytest.approx(1.0, abs=1e-12)
            assert wo[2].min() >= 0


def test_it_moves_smoothly():
    mesh = mesh_of(lobe(0.6, 60.0), 0.6)
    cosines = 0.6 + 1e-4 * np.arange(-2, 3)
    values = np.array([summed(mesh, cosine, 60.0) for cosine in cosines])
    assert abs(np.diff(values, 4)[0]) < 1e-13  # an adaptive integral jumps by its error from one mesh to another


def test_where_the_seeds_change_their_order_it_says_so():
    # The light passes the circle at right angles to the mirror direction at 45 degrees; at the normal the seeds are one.
    mesh = mesh_of(lobe(0.8, 60.0), 0.8)
    assert mesh.near(np.array([0.75, 0.7, 0.8, 1.0])).tolist() == [True, False, True, False]


def test_the_albedo_beside_a_place():
    def build(n):
        return lambda wi, wo: Phong(n)(wi, wo) * 0.9

    albedo = PointwiseAlbedo(Family("phong", build, {"n": (1.0, 100.0)}))
    assert albedo.evaluator is not None
    for cosine in (1.0, 0.6, 1e-9):
        frozen = albedo.frozen(np.array([30.0]), cosine, 0.3, 1e-9)
        places = np.array([[30.0], [30.3]]), np.full(2, cosine), np.full(2, 0.3)
        (value, error), (exact, bar) = frozen(*places), albedo(*places, rtol=1e-9)
        assert np.all(np.abs(value - exact) <= error + 2 * bar)
        assert frozen.value == pytest.approx(exact[0], abs=1e-14)
        assert np.all(error < 1e-14)


def test_the_limit_beside_a_place_is_that_of_all_its_cosines():
    def build(n):
        return lambda wi, wo: (0.5 + 0.1 * jnp.sqrt(wi[..., 2])) / jnp.pi * n + 0 * wo[..., 2]

    albedo = PointwiseAlbedo(Family("root", build, {"n": (0.5, 1.0)}))
    frozen = albedo.frozen(np.array([0.7]), 0.0, 0.0, 1e-9)
    value, error = frozen(np.array([[0.7], [0.8]]), np.zeros(2), np.zeros(2))
    assert np.all(np.abs(value - 0.5 * np.array([0.7, 0.8])) <= error + 1e-8)
    assert np.all(error < 1e-6)


def test_metal_at_grazing_incidence():
    def build(m):
        metal = CookTorrance(m, masking="smith-separable")
        return lambda wi, wo: metal(wi, wo)

    albedo = PointwiseAlbedo(Family("metal", build, {"m": (0.2, 1.0)}))
    assert albedo.evaluator is not None
    frozen = albedo.frozen(np.array([0.4]), 1e-4, 0.0, 1e-8)
    place = np.array([[0.404]]), np.array([1.01e-4]), np.zeros(1)
    exact, bar = albedo(*place, rtol=1e-8)
    assert abs(frozen(*place)[0] - exact) <= 2 * bar


@pytest.mark.parametrize("cosine", [0.4227, 0.3837, 0.55])
def test_pieces_without_width_move_too(cosine: float):
    sine = float(np.sqrt((1 - cosine) * (1 + cosine)))
    boxes = initial_boxes(sine, cosine)
    for axis in (0, 1, 0):
        boxes = boxes.pieces(np.full(len(boxes.low), axis), np.array([0, 0.5, 1]))
    mesh = Mesh(boxes, cosine, Grid(np.array([[0.3, 0.6]])), np.ones(1))
    for moved in (0.999 * cosine, 1.001 * cosine):
        assert all(np.isfinite(part).all() for part in filled(mesh, moved))


# --- kinks of max(N.L, N.V): boxes are cut along the circle as high as the light, and the bars hold down to grazing light ---


WEIGHT = 0.45


def rough(cosine: float) -> Callable[[np.ndarray], np.ndarray]:
    """Oren-Nayar's profile, s / max(N.L, N.V) towards the light and s away from it, at azimuth 0."""
    sine = np.sqrt((1 - cosine) * (1 + cosine))

    def f(wo: np.ndarray) -> np.ndarray:
        s = sine * wo[:, 0]
        return (1 + WEIGHT * s / np.where(s > 0, np.maximum(cosine, wo[:, 2]), 1)) / np.pi

    return f


def rough_albedo(cosine: float) -> float:
    """Its albedo: the azimuth integrates to +-2 and the polar angle from 0 to the light's and from there to 90 degrees."""
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    rest = cosine * (1 + sine + sine**2) / (3 * (1 + sine))  # (1 - sine^3) / (3 cosine)
    return 1 + WEIGHT * sine / np.pi * (np.arctan2(sine, cosine) - sine * cosine + 2 * rest - 2 / 3)


@pytest.mark.parametrize("cosine", [1e-9, 1e-7, 1e-6, 1e-5, 1e-3, 0.02, 0.3, 0.69, 0.7071, 0.9, 0.9999, 1 - 1e-12])
def test_the_bar_holds_and_costs_little(cosine: float):
    for tolerance in (1e-6, 4e-10, 1e-11):
        found = integrate_hemisphere(rough(cosine), cosine, tolerance=tolerance)
        assert abs(float(found.value) - rough_albedo(cosine)) <= float(found.error)
        assert found.converged
        # 3.6 million where boxes are halved across the kink; the seeds at 45 degrees are close together.
        assert found.evaluations < (300_000 if tolerance == 4e-10 else 1_000_000)


@pytest.mark.parametrize("cosine", [1e-4, 0.05, 0.3, 0.75, 0.95])
def test_the_pieces_fill_the_hemisphere_and_move_with_the_light(cosine: float):
    mesh = mesh_of(rough(cosine), cosine)
    for moved in (cosine, 0.998 * cosine, min(1.001 * cosine, (1 + cosine) / 2)):
        assert mesh.near(np.array([moved])).all()
        wo, weight = filled(mesh, moved)
        assert weight.sum() == pytest.approx(np.pi, rel=1e-12)
        assert np.linalg.norm(wo, axis=0) == pytest.approx(1.0, abs=1e-12)
        assert wo[2].min() >= 0
        assert rough(moved)(wo.T) @ weight == pytest.approx(rough_albedo(moved), abs=1e-8)


@pytest.mark.parametrize("cosine", [0.0906, 0.02, 0.5, 0.8])
@pytest.mark.parametrize("width", [0.004, 0.002])
def test_a_ring_on_the_circle_is_seen(cosine: float, width: float):
    # What a reciprocal BRDF that is high at one angle of incidence has in wo. A piece was missed: 9e-7 with a bar of 8e-9.
    theta = np.arccos(cosine)
    found = integrate_hemisphere(
        lambda wo: np.maximum(1 - np.abs(np.arccos(wo[:, 2]) - theta) / width, 0) / np.pi, cosine, tolerance=1e-7
    )
    # 2 int (1 - |x - theta| / w) cos x sin x dx = sin(2 theta) w sinc(w)^2
    exact = np.sin(2 * theta) * width * np.sinc(width / np.pi) ** 2
    assert abs(float(found.value) - exact) <= float(found.error)
    assert float(found.error) < 2e-7


@pytest.mark.parametrize("beside", [0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, -1e-7, -1e-6])
@pytest.mark.parametrize("cosine", [1e-3, 0.05, 0.5, 0.9])
def test_a_jump_beside_the_circle_is_in_the_bar(cosine: float, beside: float):
    # Between the circle and such a jump there are no nodes: 1.5e-6 were missed with a bar of 1e-8.
    edge = cosine * (1 + beside)
    found = integrate_hemisphere(
        lambda wo: (wo[:, 2] < edge) / (np.pi * edge**2), cosine, tolerance=1e-8, max_evaluations=500_000
    )
    assert abs(float(found.value) - 1) <= float(found.error)
    assert found.converged or beside != 0
