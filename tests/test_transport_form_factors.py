"""Form factors: closed forms against known values and brute force, the clipped polygon against facts, honest error bars."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from brdfcheck import transport

UNIT = (0.0, 1.0)
BOTTOM = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]], float)  # counterclockwise from below: it looks up
TOP = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
SIDE = np.array([[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]], float)
# The square x = 1, y and z in [-1, 1], clockwise as seen from the origin.
WALL = np.array([[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]], float)


def brute(x, y, third, other_y, distance=None, nodes=10):
    """The form factor of two rectangles by Gauss nodes in four dimensions; what it takes is what the closed forms take.

    The first lies in z = 0 and looks up. With a distance, the second lies that high, over `third` in x, and looks down; without
    one it stands in x = 0, over `third` in z.
    """
    place, w = np.polynomial.legendre.leggauss(nodes)
    s, t = (part.ravel() for part in np.meshgrid((place + 1) / 2, (place + 1) / 2))
    weight = np.outer(w, w).ravel() / 4

    def between(ends, share):
        return ends[0] + share * (ends[1] - ends[0])

    first, along, across = np.stack([between(x, s), between(y, t), 0 * s], axis=-1), between(third, s), between(other_y, t)
    if distance is None:
        second, normal = np.stack([0 * s, across, along], axis=-1), np.array([1, 0, 0])
    else:
        second, normal = np.stack([along, across, distance + 0 * s], axis=-1), np.array([0, 0, -1])
    arm = second[None] - first[:, None]
    kernel = np.maximum(arm[..., 2], 0) * np.maximum(-(arm @ normal), 0) / (np.pi * np.sum(arm**2, axis=-1) ** 2)
    return weight @ kernel @ weight * (third[1] - third[0]) * (other_y[1] - other_y[0])


# --- closed forms ---


def test_the_known_values():
    assert transport.parallel_rectangles(UNIT, UNIT, UNIT, UNIT, 1.0).value == pytest.approx(0.1998248957, abs=5e-11)
    assert transport.perpendicular_rectangles(UNIT, UNIT, UNIT, UNIT).value == pytest.approx(0.2000437761, abs=5e-11)
    assert transport.coaxial_disks(1, 1, 1).value == pytest.approx(0.3819660, abs=5e-8)
    assert transport.coaxial_disks(1, 1, 1).value == pytest.approx((3 - np.sqrt(5)) / 2, rel=1e-15)
    assert transport.inside_sphere(np.pi, 0.5).value == pytest.approx(1.0, rel=1e-15)


@given(
    st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.lists(st.floats(0.1, 1.5), min_size=4, max_size=4), st.floats(2, 6)
)
def test_parallel_rectangles_anywhere(starts, lengths, distance):
    sides = [(start, start + length) for start, length in zip(starts, lengths, strict=True)]
    found, expected = transport.parallel_rectangles(*sides, distance), brute(*sides, distance)
    assert abs(found.value - expected) < 1e-12 * expected + found.error
    assert found.error < 1e-10


@given(st.lists(st.floats(1.5, 3), min_size=4, max_size=4), st.lists(st.floats(0.1, 1.2), min_size=4, max_size=4))
def test_perpendicular_rectangles_anywhere(starts, lengths):
    sides = [(start, start + length) for start, length in zip(starts, lengths, strict=True)]
    found, expected = transport.perpendicular_rectangles(*sides), brute(*sides)
    assert abs(found.value - expected) < 1e-9 * expected + found.error


# Squares of the side 2^-k that begin at these places; parallel ones a distance apart. From mpmath: the alternating sums with
# 80 digits. At the distance 1 the logarithm of the antiderivative is next to 0, its rounding is not; small rectangles far
# apart lose all digits of the closed form.
EXACT = [
    ((0, 0, 0, 0), 3, 1.0, 0.0049224614929023035),
    ((0, 0, 0, 0), 6, 1.0, 7.7699728682312501e-5),
    ((0, 0, 0, 0), 10, 1.0, 3.0356377011106426e-7),
    ((0, 0, 0, 0), 14, 1.0, 1.1857967279600334e-9),
    ((0, 0, 0, 0), 14, 2.0, 2.9644918254218798e-10),
    ((0, 0, 0, 0), 20, 1.0, 2.8950115500592589e-13),
    ((1, 0, 1, 0), 3, None, 0.0010988836725523955),
    ((1, 0, 1, 0), 6, None, 1.9127284098707975e-5),
    ((0.5, 0, 0.75, 0), 10, None, 1.7220138188717942e-7),
    ((1, 0, 1, 1), 14, None, 1.3175251171562679e-10),
    ((0, 0, 1, 0.5), 17, None, 4.5234175846767928e-17),
    ((0, 0, 0, 0), 2, None, 0.20004377607540315),
]


@pytest.mark.parametrize(("starts", "power", "distance", "exact"), EXACT)
def test_small_and_far_rectangles_against_80_digits(starts, power, distance, exact):
    sides = [(start, start + 2.0**-power) for start in starts]
    if distance is None:
        found = transport.perpendicular_rectangles(*sides)
    else:
        found = transport.parallel_rectangles(*sides, distance)
    assert abs(found.value - exact) <= found.error + 2e-16 * exact


@pytest.mark.parametrize("rectangles", [transport.parallel_rectangles, transport.perpendicular_rectangles])
def test_errors_hold_for_far_rectangles_of_any_size(rectangles):
    generator = np.random.default_rng(3)
    for _ in range(200):
        lengths = 10 ** generator.uniform(-5, -1) * generator.uniform(0.3, 1, 4)
        starts = generator.uniform(1, 2, 4)
        sides = [(start, start + length) for start, length in zip(starts, lengths, strict=True)]
        distance = generator.choice([1.0, 0.7, 3.0])
        given = (*sides, distance) if rectangles is transport.parallel_rectangles else sides
        found, expected = rectangles(*given), brute(*given, nodes=6)
        # The points of the brute force are rounded where the rectangles are.
        assert abs(found.value - expected) <= found.error + 1e-12 * expected


def test_disks_against_quadrature():
    # Of the exchange between rings of two disks only the angle between them is left: elementary.
    x, w = np.polynomial.legendre.leggauss(60)
    a, b, d = 0.7, 1.3, 0.9
    s, t = (x + 1) / 2 * a, (x + 1) / 2 * b
    q = s[:, None] ** 2 + t[None, :] ** 2 + d * d
    p = 2 * s[:, None] * t[None, :]
    ring = 2 * np.pi * q / (q * q - p * p) ** 1.5  # the integral of 1 / (q - p cos)^2
    exchange = np.sum(np.outer(w * a / 2 * s, w * b / 2 * t) * 2 * np.pi * d * d / np.pi * ring)
    assert transport.coaxial_disks(a, b, d).value == pytest.approx(exchange / (np.pi * a * a), rel=1e-12)
    # Far away the textbook form would cancel to nothing.
    assert transport.coaxial_disks(1e-4, 1.0, 1e6).value == pytest.approx(1e-12, rel=1e-11)


def test_arrays_and_errors_that_hold():
    edges = np.linspace(0, 1, 101)
    cells = np.stack([edges[:-1], edges[1:]], axis=-1)
    found = transport.parallel_rectangles(cells[:, None], UNIT, cells[None, :], UNIT, 1.0)
    assert found.value.shape == found.error.shape == (100, 100)
    whole = transport.parallel_rectangles(UNIT, UNIT, UNIT, UNIT, 1.0)
    off = np.abs(np.sum(found.value, axis=1).mean() - whole.value)
    assert off < np.max(np.sum(found.error, axis=1)) + whole.error
    assert np.max(np.abs(found.value - found.value.T)) <= 2 * np.max(found.error)


# --- polygons ---


@pytest.mark.slow
@pytest.mark.parametrize(("other", "name"), [(TOP, "parallel"), (SIDE, "sharing an edge")])
@pytest.mark.parametrize("order", [4, 8, 12, 16])
def test_patches_with_an_honest_error(other, name, order):
    closed = transport.parallel_rectangles if name == "parallel" else transport.perpendicular_rectangles
    exact = closed(UNIT, UNIT, UNIT, UNIT, *([1.0] if name == "parallel" else []))
    found = transport.patch_form_factor(BOTTOM, other, order)
    assert abs(found.value - exact.value) <= found.error
    assert found.error < {4: 0.05, 8: 1e-3, 12: 1e-5, 16: 1e-7}[order]


@pytest.mark.slow
def test_patches_that_cut_each_others_horizon():
    # Half of the wall lies below the floor's plane and sees nothing of it.
    wall = np.array([[1.5, 0, -1], [1.5, 1, -1], [1.5, 1, 1], [1.5, 0, 1]], float)
    found = transport.patch_form_factor(BOTTOM, wall, 16)
    exact = transport.perpendicular_rectangles((0.5, 1.5), UNIT, UNIT, UNIT)
    assert abs(found.value - exact.value) <= found.error < 1e-3
    # Seen from the wall the integrand has a kink, seen from the floor it has none: that one is believed.
    assert abs(found.value - exact.value) < 1e-8


# --- bad input ---


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: transport.parallel_rectangles((1, 0), UNIT, UNIT, UNIT, 1), "x must be two finite rising numbers"),
        (lambda: transport.parallel_rectangles(UNIT, UNIT, UNIT, (0, np.nan), 1), "other_y must be two finite rising"),
        (lambda: transport.parallel_rectangles(UNIT, UNIT, UNIT, UNIT, 0), "distance must be finite and > 0; got 0"),
        (lambda: transport.perpendicular_rectangles((-1, 1), UNIT, UNIT, UNIT), "distance from the line .* got -1"),
        (lambda: transport.coaxial_disks(-1, 1, 1), "radius must be finite and >= 0; got -1"),
        (lambda: transport.inside_sphere(1, np.inf), "radius must be finite and > 0; got inf"),
        (lambda: transport.patch_form_factor(BOTTOM[:2], TOP), "the first polygon must have at least 3 vertices"),
        (lambda: transport.patch_form_factor(BOTTOM, TOP * [1, 0, 1]), "the second polygon has no area"),
        (lambda: transport.patch_form_factor(BOTTOM, TOP + np.eye(4, 3)), "the second polygon is not flat"),
        (lambda: transport.patch_form_factor(TOP[[0, 2, 1, 3]], BOTTOM), "the first polygon"),
        (lambda: transport.patch_form_factor(BOTTOM, TOP, 1), "order must be a whole number >= 2; got 1"),
    ],
)
def test_wrong_arguments(call, says):
    with pytest.raises(ValueError, match=says) as caught:
        call()
    assert "\n" not in str(caught.value)
