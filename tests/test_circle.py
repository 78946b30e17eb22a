"""Kinks of max(N.L, N.V): boxes are cut along the circle as high as the light, and the bars hold down to grazing light."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from brdfcheck.quadrature.adaptive import integrate_hemisphere
from brdfcheck.quadrature.boxes import Mesh

WEIGHT = 0.45


def rough(cosine: float) -> Callable[[np.ndarray], np.ndarray]:
    """Oren-Nayar's profile, s / max(N.L, N.V) towards the light and s away from it, at azimuth 0."""
    sine = np.sqrt((1 - cosine) * (1 + cosine))

    def f(wo: np.ndarray) -> np.ndarray:
        s = sine * wo[:, 0]
        return (1 + WEIGHT * s / np.where(s > 0, np.maximum(cosine, wo[:, 2]), 1)) / np.pi

    return f


def exact(cosine: float) -> float:
    """Its albedo: the azimuth integrates to +-2 and the polar angle from 0 to the light's and from there to 90 degrees."""
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    rest = cosine * (1 + sine + sine**2) / (3 * (1 + sine))  # (1 - sine^3) / (3 cosine)
    return 1 + WEIGHT * sine / np.pi * (np.arctan2(sine, cosine) - sine * cosine + 2 * rest - 2 / 3)


@pytest.mark.parametrize("cosine", [1e-9, 1e-7, 1e-6, 1e-5, 1e-3, 0.02, 0.3, 0.69, 0.7071, 0.9, 0.9999, 1 - 1e-12])
def test_the_bar_holds_and_costs_little(cosine: float):
    for tolerance in (1e-6, 4e-10, 1e-11):
        found = integrate_hemisphere(rough(cosine), cosine, tolerance=tolerance)
        assert abs(float(found.value) - exact(cosine)) <= float(found.error)
        assert found.converged
        # 3.6 million where boxes are halved across the kink; the seeds at 45 degrees are close together.
        assert found.evaluations < (300_000 if tolerance == 4e-10 else 1_000_000)


def mesh_of(cosine: float) -> Mesh:
    return integrate_hemisphere(rough(cosine), cosine, tolerance=1e-9).mesh


def filled(mesh: Mesh, cosine: float) -> tuple[np.ndarray, np.ndarray]:
    wo, weight = np.empty((3, 1, mesh.size)), np.empty((1, mesh.size))
    mesh.fill(np.array([cosine]), wo, weight)
    return wo[:, 0].T, weight[0]


@pytest.mark.parametrize("cosine", [1e-4, 0.05, 0.3, 0.75, 0.95])
def test_the_pieces_fill_the_hemisphere_and_move_with_the_light(cosine: float):
    mesh = mesh_of(cosine)
    for moved in (cosine, 0.998 * cosine, min(1.001 * cosine, (1 + cosine) / 2)):
        assert mesh.near(np.array([moved])).all()
        wo, weight = filled(mesh, moved)
        assert weight.sum() == pytest.approx(np.pi, rel=1e-12)
        assert np.linalg.norm(wo, axis=1) == pytest.approx(1.0, abs=1e-12)
        assert wo[:, 2].min() >= 0
        assert rough(moved)(wo) @ weight == pytest.approx(exact(moved), abs=1e-8)


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
