"""Presets: every picture renders, the same each time, and the numbers behind it are those of its equation."""

from __future__ import annotations

import functools
import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck import albedo
from brdfcheck.brdf import catalog
from brdfcheck.scene import canvas, failures, images, meshes, presets, smooth_shading, white_furnace
from brdfcheck.scene.cameras import Orthographic, Perspective
from brdfcheck.scene.lights import Ambient, Distant, Environment
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.smooth import shadings_of
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.tracing import composed, trace


@pytest.mark.slow
@pytest.mark.parametrize("name", presets.PRESETS)
def test_every_preset_renders_and_gives_the_same_bytes(name):
    first = presets.render_preset(name, 17, "draft")
    assert first.dtype == np.float32
    assert first.shape[0] == 3
    assert np.all(np.isfinite(first))
    assert first.min() >= 0
    assert np.ptp(first) > 0.1
    assert images.png_bytes(presets.render_preset(name, 17, "draft")) == images.png_bytes(first)


def test_unknown_names_and_bad_numbers_are_refused_in_one_line():
    with pytest.raises(KeyError, match="unknown preset 'figure9'; did you mean figure-9"):
        presets.render_preset("figure9")
    with pytest.raises(KeyError, match="the presets are figure-5, "):
        presets.named("@")
    with pytest.raises(ValueError, match="quality must be one of draft, normal, high; got 'best'"):
        presets.render_preset("figure-5", quality="best")
    with pytest.raises(ValueError, match="size must be"):
        presets.render_preset("figure-5", 0)


def test_more_samples_smooth_the_edge_and_nothing_else():
    white = Surface(Term("lambert", 1.0))
    draft, high = (canvas.Canvas(24, samples).sphere(white, [Ambient(1.0)]) for samples in (1, 4))
    assert draft.shape == high.shape == (3, 24, 24)
    np.testing.assert_array_equal(np.unique(draft.round(6)), [0, 1])
    rows, columns = np.nonzero(np.abs(draft - high).max(axis=0) > 1e-6)
    radius = np.hypot(rows - 11.5, columns - 11.5)
    assert 10.5 < radius.min() < radius.max() < 12.4  # the sphere's is 24 / 2.1
    # Each pixel is the share that the disk covers.
    assert high[0].sum() == pytest.approx(np.pi * (24 / 2.1) ** 2, rel=2e-3)


@pytest.mark.parametrize("count", [4, 5])
def test_no_validated_brdf_is_left_out_of_the_furnace(monkeypatch, count):
    entries = [entry for entry in catalog.entries() if entry.validated][:count]
    drawn = []

    def furnace_pair(canvas, name, parameters):
        drawn.append(name)
        return [np.full((3, 9, 9), 0.1 + 0.1 * len(drawn), np.float32)] * 2

    monkeypatch.setattr(white_furnace, "_furnace_pair", furnace_pair)
    monkeypatch.setattr(white_furnace.catalog, "entries", lambda: entries)
    sheet = white_furnace.furnace_validated(canvas.Canvas(9, 1))
    assert drawn == [entry.name for entry in entries]
    for number in range(1, count + 1):  # each is there, twice
        assert np.count_nonzero(np.isclose(sheet[0], 0.1 + 0.1 * number)) >= 2 * 81, number


# --- numbers behind the figures ---


@pytest.mark.slow
@pytest.mark.parametrize("camera", [Perspective((0.0, 0.0, 9.0)), Orthographic()], ids=["perspective", "orthographic"])
def test_figure_9_is_the_same_by_equation_and_by_rays_and_its_spheres_are_apart(camera):
    spheres, lights = presets.figure_9_spheres(), [Distant((1.0, 1.0, 1.0)), Distant((-1.0, 0.2, 0.5), 0.4)]
    for one, other in itertools.combinations(spheres, 2):
        apart = np.linalg.norm(np.asarray(one.center) - np.asarray(other.center))
        assert apart > float(one.radius) + float(other.radius)
    options = {"size": (64, 80), "background": (0.2, 0.3, 0.5), "dtype": jnp.float64}
    painted = np.asarray(composed(spheres, lights, camera, **options))
    assert np.ptp(painted) > 0.7
    traced = functools.partial(trace, spheres, lights, camera, least_weight=0.0, **options)
    unshadowed = np.asarray(traced(depth=4, shadows=False))
    np.testing.assert_allclose(unshadowed, painted, atol=1e-12)
    # Three lie over one another somewhere: one ray too few and the two differ.
    assert np.abs(np.asarray(traced(depth=1, shadows=False)) - painted).max() > 0.05
    assert np.max(unshadowed - np.asarray(traced(depth=4))) > 0.05  # the small opaque one stands in the light of the large one


def test_a_surface_that_returns_all_light_vanishes_to_1e4():
    for n in (1.0, 17.85, 900.0):  # at normal incidence only
        assert white_furnace.furnace_excess("phong", {"n": n}, 9)[0][4, 4] == pytest.approx(0, abs=1e-4)
    assert np.abs(white_furnace.furnace_excess("lambert", {"reflectance": 1.0}, 9)[0]).max() < 1e-4


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("blinn-phong-8", {"n": 8.76}),
        pytest.param("binomial-power-published", {"n": 17.85}, marks=pytest.mark.slow),
        pytest.param("binomial-power-half", {"n": 17.85}, marks=pytest.mark.slow),
    ],
)
def test_a_pixel_of_the_furnace_exceeds_its_surroundings_by_the_albedo(name, parameters):
    side = 13
    excess, _ = white_furnace.furnace_excess(name, parameters, side)
    brdf = catalog.entry(name).family.build(**parameters)
    across = (np.arange(side) + 0.5) / side * 2.1 - 1.05
    for row, column in ((6, 6), (6, 9), (3, 4)):
        mu = np.sqrt(1 - across[row] ** 2 - across[column] ** 2)
        assert excess[row, column] == pytest.approx(float(albedo(brdf, mu).value) - 1, abs=1e-4)
    published = not catalog.entry(name).validated
    assert bool(excess.max() > 1e-3) is published


@pytest.mark.parametrize(
    ("name", "parameters", "side"),
    [("blinn-phong", {"n": 20.0}, 33), pytest.param("cook-torrance", {"m": 0.4}, 14, marks=pytest.mark.slow)],
)
def test_a_furnace_is_what_every_pixel_integrated_gives(name, parameters, side):
    surface = Surface(Term(catalog.entry(name).family.build(**parameters)))
    every = np.asarray(sphere_image(surface, [Environment(0.4)], size=(side, side), background=0.4))
    tile, _ = white_furnace._furnace_pair(canvas.Canvas(side, 1), name, parameters)
    np.testing.assert_allclose(tile, every, atol=1e-6)
    # More samples: the pixels inside are the same numbers, those at the edge are between the two sides of it.
    fine, _ = white_furnace._furnace_pair(canvas.Canvas(side, 4), name, parameters)
    across = np.abs((np.arange(side) + 0.5) / side * 2.1 - 1.05)
    far = np.hypot(*np.meshgrid(across + 1.05 / side, across + 1.05 / side))
    near = np.hypot(*np.meshgrid(*[np.maximum(across - 1.05 / side, 0)] * 2))
    np.testing.assert_allclose(fine[:, far < 0.999], tile[:, far < 0.999], rtol=1e-6)
    np.testing.assert_allclose(fine[:, near > 1.001], 0.4, rtol=1e-6)
    edge = (far > 1.001) & (near < 0.999)
    assert np.abs(fine - tile)[:, edge].max() > 1e-3
    # Inside it is more by the excess, which is that of the albedo. Each pixel of the edge is covered as a disc covers it.
    excess, covered = white_furnace.furnace_excess(name, parameters, side, 4)
    assert np.abs(0.4 * (1 + excess) - every)[:, far < 0.999].max() < 1e-6
    assert covered.sum() == pytest.approx(np.pi * (side / 2.1) ** 2, rel=5e-3)


def test_a_large_furnace_integrates_each_angle_once():
    square, number = white_furnace._distances(512)
    assert number.size > 19 * square.size
    assert np.all(np.diff(square) > 0)
    x = (np.arange(512) + 0.5) / 512 * 2.1 - 1.05
    distance = x[:, None] ** 2 + x**2
    np.testing.assert_allclose(square[number][number >= 0], distance[number >= 0], rtol=1e-12)
    assert np.all(distance[number < 0] >= 1)
    assert np.all(distance[number >= 0] < 1)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [1, 2, 4])
def test_false_colours_are_on_their_scale_and_a_thin_rim_is_seen(samples):
    _, tile = white_furnace._furnace_pair(canvas.Canvas(49, samples), "binomial-power-unclamped", {"n": 40})
    tile = tile.reshape(3, -1, 1)
    excess = np.concatenate([np.linspace(-1, 0, 400), np.geomspace(1e-4, 4, 4000)])
    ground = np.array(canvas.GROUND)[:, None]
    scale = np.concatenate([canvas.false_color(excess), ground], axis=1)[:, None]
    assert np.abs(tile - scale).max(axis=0).min(axis=1).max() < 0.01
    away = np.abs(tile[..., 0] - ground).max(axis=0) > 1e-6
    assert away.sum() == pytest.approx(np.pi * (49 / 2.1) ** 2, rel=0.02)
    red, _, blue = tile[..., 0]
    assert ((red > 0.6) & (blue < 0.2)).sum() > 20  # the rim, which returns several times what it gets


@pytest.mark.parametrize(
    ("name", "parameters", "largest"),
    [
        pytest.param("cook-torrance-no-masking", {"m": 0.4}, 6.97, marks=pytest.mark.slow),
        ("blinn-phong-8", {"n": 8.76}, 1.0752),
        ("lambert", {"reflectance": 1.2}, 1.2),
    ],
)
def test_the_number_beside_a_furnace_is_the_albedo_at_stated_angles(name, parameters, largest):
    found = white_furnace.furnace_largest(name, parameters)
    assert found == pytest.approx(largest, rel=1e-3)
    brdf = catalog.entry(name).family.build(**parameters)
    every = [float(albedo(brdf, np.cos(np.radians(angle))).value) for angle in (0.0, 45.0, 89.0)]
    assert found == pytest.approx(max(every), rel=1e-4)


@pytest.mark.slow
def test_lobes_of_one_kind_are_one_program_of_the_furnace(monkeypatch):
    traces = []
    real = white_furnace.directional_albedo
    monkeypatch.setattr(white_furnace, "_integrated", eqx.filter_jit(lambda brdf, mu: traces.append(1) or real(brdf, mu)))
    for name in ("blinn-phong", "blinn-phong-6", "blinn-phong-fitted"):
        for side, n in ((5, 20), (7, 2.5)):
            white_furnace.furnace_excess(name, {"n": n}, side, 2)
            white_furnace.furnace_largest(name, {"n": n})
    assert len(traces) == 1


def test_a_turned_square_has_in_its_middle_what_its_title_says():
    for degrees in (0.0, 20.0, 45.0):
        inside, lines, halves = smooth_shading._turned_square(jnp.zeros((2, 1, 1)), jnp.asarray(np.radians(degrees)))
        assert bool(inside[0, 0])
        assert float(lines[0, 0]) == pytest.approx((1 + np.tan(np.radians(degrees))) / 2, abs=1e-12)
        assert float(halves[0, 0]) == pytest.approx(0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "left"), [(10.0, 0.836), (100.0, 0.167)])
def test_gouraud_shading_leaves_of_the_highlight_what_the_label_says(n, left):
    mesh = meshes.icosphere(2)
    view, light = smooth_shading.towards_facet(mesh)
    half = (view + light) / np.linalg.norm(view + light)
    np.testing.assert_allclose(half, smooth_shading.worst_facet(mesh), atol=1e-14)
    camera = Orthographic(5 * view, up=np.cross(view, light))

    def gloss(point, normal, view):
        return jnp.broadcast_to(jnp.maximum(jnp.tensordot(half, normal, 1), 0) ** n, normal.shape)

    shadings = ("gouraud", "phong")
    picture, smooth = map(np.asarray, shadings_of(mesh, camera, gloss, shadings, size=(65, 65), normals=mesh.vertices))
    assert smooth.max() == pytest.approx(1, abs=0.03)
    assert picture.max() == pytest.approx(left, abs=1e-3)
    assert float(failures.lost_highlight(mesh, n)) == pytest.approx(left, abs=5e-4)


# --- drawing ---


def test_false_colours_tell_loss_from_excess():
    black, grey, white, purple, yellow = canvas.false_color([-1.0, -0.5, 0.0, 1e-4, 4.0]).T
    assert np.all(black == 0)
    assert np.ptp(grey) == 0
    assert np.all(white == 1)
    assert purple[2] > purple[0] > purple[1]
    assert yellow[0] > 0.8 > 0.1 > yellow[2]
    np.testing.assert_allclose(canvas.false_color([100.0]).T[0], yellow)
    np.testing.assert_allclose(canvas.false_color([np.nan]).T[0], black)


def test_a_scale_shows_its_colours_and_a_curve_its_points():
    scale = canvas.color_scale(400, "excess")
    row = scale[:, 29]
    np.testing.assert_allclose(row[:, 400 - 42], canvas.false_color(4.0), atol=1e-6)
    square = canvas.curve(65, [0.0, 1.0], [0.0, 1.0], 0, 1)
    assert square.shape == (3, 65, 65)
    assert all(square[0, 64 - i, i] == 0 for i in range(20, 60))
    # A narrower span leaves room beside the curve, and a number is written over it.
    inside = canvas.curve(65, [-0.5, 0.5], [0.5, 0.5], 0, 1, span=(-1.0, 1.0))
    dark = np.nonzero((inside[0] == 0).any(axis=0))[0]
    assert (dark.min(), dark.max()) == (16, 48)
    stacked = canvas.stacked(np.zeros((3, 2, 5)), np.zeros((3, 3, 3)))
    assert stacked.shape == (3, 5, 5)
    np.testing.assert_array_equal(stacked[0, 2:], [[1, 0, 0, 0, 1]] * 3)
    title = "a title that is much wider than its picture"
    short = canvas.color_scale(40, title)
    assert short.shape[2] > 200
    assert short[:, :20, 0].min() == short[:, :20, -1].min() == 1  # nothing of it is cut
