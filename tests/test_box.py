"""The box of parameters and angles: its ends are met exactly, and its points leave no slab of a hundredth of it out."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial import KDTree

from brdfcheck.verdict.box import DECADES, Box, _sequence, cosine_at, place_of
from brdfcheck.verdict.scan import _POINTS

RANGES = {"n": (1.0, 1000.0), "f0": (0.0, 1.0), "held": (2.5, 2.5), "shift": (-3.0, 7.0)}


def box(ranges=RANGES, cos_theta=(0.0, 1.0), *, turning=True, **options) -> Box:
    return Box(ranges, cos_theta, turning=turning, **options)


# --- the map ---


def test_axes_are_the_swept_parameters_and_the_angles():
    assert box().names == ("n", "f0", "shift", "angle", "azimuth")
    assert box().swept == ("n", "f0", "shift")
    assert box().periodic.tolist() == [False, False, False, False, True]
    assert box(turning=False).names == ("n", "f0", "shift", "angle")
    assert box(fixed_angle=True, turning=False).names == ("n", "f0", "shift")
    assert box(cos_theta=(0.5, 0.5), turning=False).dimension == 3
    assert box({}, (1.0, 1.0), turning=False).dimension == 0
    # A parameter of that name is no azimuth.
    assert box({"azimuth": (0.0, 1.0)}, turning=False).periodic.tolist() == [False, False]


def test_ends_are_met_exactly():
    ends = np.array(list(itertools.product((0.0, 1.0), repeat=4)))
    places = np.insert(ends, 4, 0.25, axis=1)
    parameters, mu, azimuth = box(cos_theta=(0.1, 0.7)).physical(places)
    for column, (low, high) in zip((0, 1, 3), ((1.0, 1000.0), (0.0, 1.0), (-3.0, 7.0)), strict=True):
        expected = np.where(places[:, {0: 0, 1: 1, 3: 2}[column]] == 0, low, high)
        np.testing.assert_array_equal(parameters[:, column], expected)
    np.testing.assert_array_equal(parameters[:, 2], 2.5)
    np.testing.assert_array_equal(mu, np.where(places[:, 3] == 0, 0.1, 0.7))
    np.testing.assert_allclose(azimuth, np.pi / 2)


def test_inside_the_ends_and_in_order():
    unit = np.linspace(0, 1, 1001)
    for ranges in ({"x": (1e-3, 1e3)}, {"x": (0.0, 1e300)}, {"x": (-1e308, 1e308)}, {"x": (1e-300, 1e300)}, {"x": (1.0, 1.1)}):
        ((low, high),) = ranges.values()
        values = box(ranges, (1.0, 1.0), turning=False).physical(unit[:, None])[0][:, 0]
        assert (values[0], values[-1]) == (low, high)
        assert np.all(np.isfinite(values))
        assert np.all(np.diff(values) > 0)
    # A wide range of positive numbers runs geometrically, a narrow one evenly.
    middle = box({"x": (1.0, 100.0), "y": (1.0, 10.0)}, (1.0, 1.0), turning=False).physical(np.full((1, 2), 0.5))[0]
    assert middle[0] == pytest.approx([10.0, 5.5])


def test_the_coordinate_of_the_angle():
    mu = np.concatenate([[0.0, 1.0], 10.0 ** -np.arange(1, 16.0), np.linspace(0.01, 0.99, 37)])
    np.testing.assert_allclose(cosine_at(place_of(mu)), mu, rtol=1e-12, atol=1e-17)
    for ends in ((0.0, 1.0), (0.2, 0.9)):
        one = box({}, ends, turning=False)
        inside = mu[(mu >= ends[0]) & (mu <= ends[1])]
        np.testing.assert_allclose(one.physical(one.angle_at(inside)[:, None])[1], inside, rtol=1e-9, atol=1e-15)
    assert box({}, (0.2, 0.9), turning=False).angle_at(0.05) == 0
    # Half a degree is at least 0.0039 of it, at either end too: the steps of the quickest scan.
    theta = np.radians(np.linspace(0, 90, 1801))
    t = place_of(np.cos(theta))
    assert np.min(np.abs(t[10:] - t[:-10])) > 1 / 256


def test_what_lies_outside_is_brought_back_and_the_azimuth_goes_round():
    kept = box().kept(np.array([[-0.1, 0.5, 1.2, 2.0, 1.3], [0.3, -9.0, 0.0, -0.5, -0.2]]))
    np.testing.assert_allclose(kept, [[0, 0.5, 1, 1, 0.3], [0.3, 0, 0, 0, 0.8]])


# --- points ---


def gaps(values: np.ndarray, low: float, high: float) -> float:
    """The widest interval without a value."""
    return float(np.max(np.diff(np.concatenate([[low], np.unique(values), [high]]))))


def searched(one: Box, effort: float) -> np.ndarray:
    """The points at which a search of a function looks in any case: the scan, the landmarks, a quarter as many points again."""
    count = int((2048, 4096, 8192, 9216)[min(len(one.swept) + one.turning, 3)] * effort)
    levels = max(int(513 * min(1, 2 * effort)), 257)
    return np.concatenate([one.landmarks(), one.scan(count, 0, levels), one.scan(count // 4, count, levels)])


@pytest.mark.parametrize("effort", [0.25, 1.0])
@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 6])
def test_a_search_meets_every_slab(count: int, turning: bool, effort: float):
    """A hundredth of each coordinate, half a degree of the angle."""
    one = box({f"p{i}": (0.0, 1.0) for i in range(count)}, turning=turning)
    points = searched(one, effort)
    assert points.min() >= 0
    assert points.max() <= 1
    parameters, mu, azimuth = one.physical(points)
    for column in parameters.T:
        assert gaps(column, 0, 1) <= 0.01
    assert gaps(np.degrees(np.arccos(mu)), 0, 90) <= 0.5
    assert {0.0, 1.0} <= set(mu)
    if turning:
        assert gaps(azimuth, 0, 2 * np.pi) <= 0.02 * np.pi


@pytest.mark.parametrize("count", [1, 2, 3])
def test_every_cell_holds_a_point(count: int):
    """No cube is empty whose side is that for which a report vouches as "cell"."""
    one = box({f"p{i}": (0.0, 1.0) for i in range(count)}, turning=False)
    points = searched(one, 1.0)
    side = 2.5 * len(points) ** (-1 / one.dimension)
    corners = np.random.default_rng(4).uniform(0, 1 - side, (2000, one.dimension))
    empty = [corner for corner in corners if not np.any(np.all((points >= corner) & (points <= corner + side), axis=1))]
    assert not empty, (len(empty), empty[0])


def test_scans_are_repeatable_and_disjoint():
    one = box()
    first, second = one.scan(1000, 0, 513), one.scan(1000, 1000, 513)
    np.testing.assert_array_equal(first, one.scan(1000, 0, 513))
    inside = [points[np.all((points[:, :3] > 0) & (points[:, :3] < 1), axis=1)] for points in (first, second)]
    assert not {tuple(row) for row in inside[0]} & {tuple(row) for row in inside[1]}
    # Few different angles, others than before: their tables of directions are made once.
    angles = [np.unique(points[:, 3]) for points in (first, second)]
    assert max(map(len, angles)) <= 514
    assert not set(angles[0][1:-1]) & set(angles[1][1:-1])


@pytest.mark.parametrize("count", [0, 1, 2, 4, 5])
def test_landmarks_hold_corners_edges_and_both_ends_of_the_angle(count: int):
    one = box({f"p{i}": (0.0, 1.0) for i in range(count)}, turning=False)
    points = {tuple(np.round(row, 12)) for row in one.landmarks()}
    for corner in itertools.product((0.0, 1.0), repeat=count + 1):
        assert corner in points
    for axis in range(count):
        for rest in itertools.product((0.0, 1.0), repeat=count):
            middle = (*rest[:axis], 0.5, *rest[axis:])
            assert (*middle[:count], rest[-1]) in points
    near = np.array(sorted(points))
    for axis in range(count):
        assert np.any((near[:, axis] > 0) & (near[:, axis] <= 1e-6))
        assert np.any((near[:, axis] < 1) & (near[:, axis] >= 1 - 1e-6))


def test_grazing_ladders_keep_their_parameters():
    ladder = box().grazing(64)
    places, decades, dimension = ladder.shape
    assert (decades, dimension) == (len(DECADES), 5)
    assert places >= 64 + 8
    parameters, mu, azimuth = box().physical(ladder.reshape(-1, dimension))
    np.testing.assert_allclose(mu.reshape(places, decades), np.tile(DECADES, (places, 1)), rtol=1e-9)
    for part in (parameters.reshape(places, decades, -1), azimuth.reshape(places, decades, 1)):
        assert np.all(part == part[:, :1])
    assert len(box(cos_theta=(0.1, 1.0)).grazing(64)) == 0
    assert len(box(fixed_angle=True).grazing(64)) == 0


@pytest.mark.parametrize(("first", "second"), list(itertools.combinations(range(4), 2)))
def test_points_leave_no_holes_in_pairs_of_coordinates(first: int, second: int):
    """Boxes of any shape in which 2.7 of n points lie on average; random points miss 7 % of them."""
    random = np.random.default_rng(0)
    for count in (2731, 5461, 10923):
        points = _sequence(count, 4, 0)[:, [first, second]]
        for ratio in (0.2, 0.5, 1, 2, 5):
            sides = np.sqrt(2.7 / count) * np.array([ratio**0.5, ratio**-0.5])
            centres = random.uniform(0.05, 0.95, (1000, 2))
            nearest, _ = KDTree(points / sides).query(centres / sides, p=np.inf)
            assert np.mean(nearest > 0.5) < 0.067, (count, ratio)


def test_a_scan_meets_what_is_narrow_in_two_parameters():
    """A hundredth of one of two ranges by a twentieth of the other."""
    scan = Box({"p": (0.0, 1.0), "q": (0.0, 1.0)}, (0, 1), turning=True).scan(_POINTS[2], 0, 513)[:, :2]
    for sides in ((0.01, 0.05), (0.05, 0.01)):
        centres = np.random.default_rng(1).uniform(0.05, 0.95, (20_000, 2))
        nearest, _ = KDTree(scan / sides).query(centres / sides, p=np.inf)
        assert np.max(nearest) <= 0.5
