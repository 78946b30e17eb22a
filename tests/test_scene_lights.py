"""Lights: their fields against closed forms and brute force, their gradients, and what they refuse."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpy_shader
import pytest

from brdfcheck.brdf.microfacet import boundary_reflectance
from brdfcheck.scene.lights import Ambient, Distant, Environment, Point, Polygon, Spot
from brdfcheck.scene.vectors import Vector

ORIGIN = Vector(*jnp.zeros(3))
UP = Vector(*jnp.array([0.0, 0.0, 1.0]))
SQUARE = np.array([[-1.0, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
WALL = np.array([[1.0, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]])


def factor(vertices, point=ORIGIN, normal=UP, **options):
    return float(Polygon(vertices, **options).irradiance(point, normal) / np.pi)


@pytest.mark.parametrize("seed", range(6))
def test_polygon_against_brute_force_wherever_the_horizon_cuts_it(seed):
    rng = np.random.default_rng(seed)
    point, normal = rng.normal(size=3) * 0.5, numpy_shader.normalised(rng.normal(size=3))
    spot = numpy_shader.normalised(rng.normal(size=3)) * 2 + point
    a, b = rng.normal(size=(2, 3))
    corners = np.array([spot, spot + a, spot + a + b, spot + b])
    expected = numpy_shader.polygon_irradiance(corners, point, normal, 1000)
    for order in (corners, corners[::-1], np.roll(corners, 1, 0)):
        found = Polygon(order).irradiance(Vector(*jnp.asarray(point)), Vector(*jnp.asarray(normal)))
        np.testing.assert_allclose(found, expected, atol=2e-5)


def test_polygon_that_is_not_convex_is_the_sum_of_its_parts():
    # An L on the wall, cut by the horizon in two places, against two rectangles.
    bent = [[1, 0, -1], [1, 3, -1], [1, 3, 2], [1, 2, 2], [1, 2, -0.5], [1, 1, -0.5], [1, 1, 2], [1, 0, 2]]
    parts = ([[1, 0, -1], [1, 1, -1], [1, 1, 2], [1, 0, 2]], [[1, 2, -1], [1, 3, -1], [1, 3, 2], [1, 2, 2]])
    assert factor(np.array(bent, float)) == pytest.approx(sum(factor(np.array(part, float)) for part in parts), abs=1e-14)


def test_polygon_shines_on_the_side_from_which_it_runs_counterclockwise():
    seen_clockwise = factor(SQUARE, two_sided=False)
    assert seen_clockwise == 0
    assert factor(SQUARE[::-1], two_sided=False) == pytest.approx(0.554126423979572, abs=1e-14)


@pytest.mark.slow
def test_polygon_differentiates_in_its_vertices_and_is_finite_in_float32():
    def value(vertices):
        return Polygon(vertices).irradiance(ORIGIN, UP)

    slope = jax.grad(value)(jnp.asarray(WALL))
    step = 1e-6
    for i in np.ndindex(WALL.shape):
        shift = np.zeros_like(WALL)
        shift[i] = step
        central = (value(jnp.asarray(WALL + shift)) - value(jnp.asarray(WALL - shift))) / (2 * step)
        assert float(slope[i]) == pytest.approx(float(central), abs=1e-8)
    # Points all over, in the plane of the polygon and at a corner of it too.
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(size=(60, 3)), [[1, 0.3, 0.2], [1, 1, 1], [1, 5, 0]]]).astype(np.float32).T
    normals = numpy_shader.normalised(rng.normal(size=(63, 3))).astype(np.float32).T

    def field(vertices):
        light = Polygon(vertices)
        return light.irradiance(Vector(*jnp.asarray(points)), Vector(*jnp.asarray(normals)))

    values, slopes = jax.jvp(field, (jnp.asarray(WALL, jnp.float32),), (jnp.ones((4, 3), jnp.float32),))
    assert values.dtype == jnp.float32
    assert np.all(np.isfinite(values))
    assert np.all(np.isfinite(slopes))


def test_point_and_spot_follow_opengl():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(50, 3))
    fall = {"constant_attenuation": 0.5, "linear_attenuation": 0.2, "quadratic_attenuation": 0.1}
    plain = {"position": (0.5, 2, 3), "constant": 0.5, "linear": 0.2, "quadratic": 0.1}
    cone = {"spot_direction": (0, -2, -3.2), "cutoff": 25, "exponent": 7.5}
    lights = (
        (Point((0.5, 2, 3), **fall), plain),
        (Spot((0.5, 2, 3), (0, -2, -3.2), spot_cutoff=25, spot_exponent=7.5, **fall), plain | cone),
        (Spot((0.5, 2, 3), (0, -2, -3.2), spot_cutoff=180, spot_exponent=7.5, **fall), plain),
    )
    for light, description in lights:
        direction, falloff = light.arriving(Vector(*jnp.asarray(points.T)))
        expected_direction, expected = numpy_shader.light_at(description, points)
        np.testing.assert_allclose(np.stack(direction, -1), expected_direction, atol=1e-15)
        np.testing.assert_allclose(falloff, expected[:, 0], rtol=1e-13)
    dark = np.sum(expected[:, 0] == 0)
    assert dark == 0  # no cone at 180
    inside = np.asarray(lights[1][0].arriving(Vector(*jnp.asarray(points.T)))[1]) > 0
    assert 0 < inside.sum() < 50


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 0.3, 1.57])
@pytest.mark.parametrize("size", [1e-12, 1.0, 1e12])
def test_polygons_with_a_hole_a_notch_and_many_corners_are_polygons(turn, size):
    ring = np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 2 * np.pi, 60, endpoint=False)])
    star = ring * np.where(np.arange(60) % 2, 1, 0.4)[:, None]
    hole = 0.5 * ring[::10][::-1]
    slit = np.concatenate([ring, ring[:1], hole, hole[:1]])  # out, and in along a line that is gone twice
    tilt = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    comb = [[0, 0, 0], [7, 0, 0], [7, 2, 0], [5, 2, 0], [5, 1, 0], [3, 1, 0], [3, 2, 0], [1, 2, 0], [1, 1, 0], [0, 1, 0]]
    for corners in (ring, star, slit, np.array(comb, float)):
        for order in (corners, corners[::-1]):
            Polygon(size * (order @ tilt.T + [1, 2, 3]))
    crossed = np.concatenate([ring[:30], ring[:29:-1]])
    with pytest.raises(ValueError, match="edges cross"):
        Polygon(size * ((crossed + [0, 0.2, 0] * (ring[:, :1] > 0)) @ tilt.T))
    # The outside less the hole.
    whole, less = (Polygon(part @ tilt.T + [0, 0, 2]) for part in (ring, 0.5 * ring[::10]))
    found = Polygon(slit @ tilt.T + [0, 0, 2]).irradiance(ORIGIN, UP)
    assert float(found) == pytest.approx(float(whole.irradiance(ORIGIN, UP) - less.irradiance(ORIGIN, UP)), abs=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e-12, 1e12, 1e25])
def test_lamps_at_any_distance_in_single_precision(distance):
    origin = Vector(*jnp.zeros(3, jnp.float32))
    falls = {"constant_attenuation": 1.0}, {"constant_attenuation": 0.0, "linear_attenuation": 0.5 / distance}
    for fall, expected in zip(falls, (1.0, 2.0), strict=True):
        for lamp in (Point((0, 0, distance), **fall), Spot((0, 0, distance), (0, 0, -1), **fall)):
            lamp = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), lamp)
            direction, share = lamp.arriving(origin)
            np.testing.assert_allclose(np.stack(direction), [0, 0, 1], atol=1e-6)
            assert float(share) == pytest.approx(expected, rel=1e-5)
            slopes = jax.grad(lambda lamp: lamp.arriving(origin)[1])(lamp)
            assert np.all(np.isfinite(slopes.position))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Distant((0, 0, 0)), "direction must not have length 0"),
        (lambda: Distant((0, 0, float("nan"))), "direction must be finite"),
        (lambda: Distant((0, 1)), "three components"),
        (lambda: Distant((0, 0, 1), -1), "intensity must be finite and >= 0; got -1"),
        (lambda: Ambient((1, 2)), "R, G and B"),
        (lambda: Environment("white"), "intensity must be a number"),
        (lambda: Point((0, 0, 1), linear_attenuation=-1), "linear_attenuation must be finite and >= 0"),
        (lambda: Point((0, 0, 1), constant_attenuation=0), "must not all be 0"),
        (lambda: Spot((0, 0, 1), (0, 0, 0)), "spot_direction must not have length 0"),
        (lambda: Spot((0, 0, 1), (0, 0, -1), spot_cutoff=120), r"in \[0, 90\] degrees, or 180"),
        (lambda: Spot((0, 0, 1), (0, 0, -1), spot_exponent=-2), "spot_exponent must be finite and >= 0"),
        (lambda: Polygon([[0, 0, 1], [1, 0, 1]]), "at least 3 vertices"),
        (lambda: Polygon([[0, 0, 1], [1, 0, 1], [2, 0, 1]]), "span no area"),
        (lambda: Polygon([[0, 0, 1], [1, 0, 1], [1, 1, 2], [0, 1, 1]]), "do not lie in a plane"),
        (lambda: Polygon([[0, 0, 1], [1, 0, np.inf], [2, 1, 1]]), r"vertices must be finite; got \[1.0, 0.0, inf\] in row 1"),
        (lambda: Polygon([[-1, -1, 2], [1, 1, 2], [1, -1, 2], [-1, 0.2, 2]]), "edges cross one another"),
        # A bow tie that meets itself in a corner, and a square gone round twice.
        (lambda: Polygon([[0, 0, 1], [2, -2, 1], [2, 2, 1], [0, 0, 1], [-1, -1, 1], [-1, 1, 1]]), "edges cross one another"),
        (lambda: Polygon([*SQUARE, *SQUARE]), "edges cross one another"),
        (lambda: Distant((0, 0, 1), 1e39), "intensity must be finite in single precision"),
    ],
)
def test_bad_lights_are_refused_in_one_line(build, words):
    with pytest.raises(ValueError, match=words) as caught:
        build()
    assert "\n" not in str(caught.value)


def test_fresnel_reflects_all_past_the_critical_angle():
    eta = jnp.asarray(1 / 1.5)
    critical = float(jnp.sqrt(1 - eta**2))
    assert float(boundary_reflectance(jnp.asarray(critical * 0.999), eta)) == 1
    assert 0.04 < float(boundary_reflectance(jnp.asarray(critical * 1.01), eta)) < 1
    slopes = jax.vmap(jax.grad(boundary_reflectance), (0, None))(jnp.linspace(0, 1, 101), eta)
    assert np.all(np.isfinite(slopes))
