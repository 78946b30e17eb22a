"""Presets: every picture renders, the same each time, and the numbers behind it are those of its equation."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck import albedo, catalog
from brdfcheck.scene import drawing, failures, images, meshes, presets
from brdfcheck.scene.cameras import Orthographic
from brdfcheck.scene.lights import Ambient, Distant
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.smooth import shade_mesh
from brdfcheck.scene.tracing import Sphere, composed, trace

# Many programs to compile.
LONG = {"furnace", "furnace-validated", "gouraud-phong", "lobes", "lights"}
LONG |= {"silhouette-bleed", "mach-bands", "sheets", "polygon-light"}


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in presets.PRESETS])
def test_every_preset_renders_and_gives_the_same_bytes(name):
    first = presets.render_preset(name, 17, "draft")
    assert first.dtype == np.float32
    assert first.shape[0] == 3
    assert np.all(np.isfinite(first))
    assert first.min() >= 0
    assert np.ptp(first) > 0.1
    presets.furnace_tile.cache_clear()
    assert images.png_bytes(presets.render_preset(name, 17, "draft")) == images.png_bytes(first)


def test_a_caption_fits_in_a_line_and_the_figures_of_the_seed_are_there():
    assert {f"figure-{number}" for number in range(5, 14)} <= set(presets.PRESETS)
    assert all(20 < len(preset.caption) < 90 for preset in presets.PRESETS.values())


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
    draft, high = (presets.Canvas(24, samples).sphere(white, [Ambient(1.0)]) for samples in (1, 4))
    assert draft.shape == high.shape == (3, 24, 24)
    np.testing.assert_array_equal(np.unique(draft.round(6)), [0, 1])
    rows, columns = np.nonzero(np.abs(draft - high).max(axis=0) > 1e-6)
    radius = np.hypot(rows - 11.5, columns - 11.5)
    assert 10.5 < radius.min() < radius.max() < 12.4  # the sphere's is 24 / 2.1
    # Each pixel is the share that the disk covers.
    assert high[0].sum() == pytest.approx(np.pi * (24 / 2.1) ** 2, rel=2e-3)


# --- numbers behind the figures ---


def tile(sheet, column, side=17):
    """A square of a sheet of one row with column labels."""
    top = sheet.shape[1] - 8 - side
    left = sheet.shape[2] - 8 - side
    return sheet[:, top : top + side, left - (9 - column) * (side + 8) :][:, :, :side]


def test_the_highlights_centre_is_white_and_narrows_with_n():
    sheet = presets.render_preset("figure-5", 65, "draft")
    bright = [float((tile(sheet, i, 65).min(axis=0) > 0.5).sum()) for i in range(10)]
    assert bright == sorted(bright, reverse=True)
    assert bright[0] > 10 * bright[-1] > 0
    assert tile(sheet, 4, 65).min(axis=0).max() > 0.97


def test_figure_9_is_the_same_by_equation_and_by_rays_and_its_spheres_are_apart():
    spheres, lights, camera = presets.figure_9_spheres(), [Distant((1.0, 1.0, 1.0))], Orthographic()
    for i, one in enumerate(spheres):
        for other in spheres[:i]:
            apart = np.linalg.norm(np.asarray(one.center) - np.asarray(other.center))
            assert apart > float(one.radius) + float(other.radius)
    options = {"size": (33, 33), "background": 0.5, "dtype": jnp.float64}
    painted, traced = composed(spheres, lights, camera, **options), trace(spheres, lights, camera, shadows=False, **options)
    np.testing.assert_allclose(painted, traced, atol=1e-12)
    shadowed = trace(spheres, lights, camera, **options)
    assert float(jnp.max(traced - shadowed)) > 0.05  # the small opaque one stands in the light of the large one
    assert isinstance(spheres[0], Sphere)


def test_a_surface_that_returns_all_light_vanishes_to_1e4():
    for n in (1.0, 17.85, 900.0):  # at normal incidence only
        assert presets.furnace_excess("phong", {"n": n}, 9)[4, 4] == pytest.approx(0, abs=1e-4)
    assert np.abs(presets.furnace_excess("lambert", {"reflectance": 1.0}, 9)).max() < 1e-4


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("blinn-phong-8", {"n": 8.76}), ("binomial-power-published", {"n": 17.85}), ("binomial-power-half", {"n": 17.85})],
)
def test_a_pixel_of_the_furnace_exceeds_its_surroundings_by_the_albedo(name, parameters):
    side = 13
    excess = presets.furnace_excess(name, parameters, side)
    brdf = catalog.entry(name).family.build(**parameters)
    across = (np.arange(side) + 0.5) / side * 2.1 - 1.05
    for row, column in ((6, 6), (6, 9), (3, 4)):
        mu = np.sqrt(1 - across[row] ** 2 - across[column] ** 2)
        assert excess[row, column] == pytest.approx(float(albedo(brdf, mu).value) - 1, abs=1e-4)
    published = not catalog.entry(name).validated
    assert bool(excess.max() > 1e-3) is published


@pytest.mark.parametrize(("n", "left"), [(10.0, 0.836), (100.0, 0.167)])
def test_gouraud_shading_leaves_of_the_highlight_what_the_label_says(n, left):
    mesh = meshes.icosphere(2)
    view, light = presets.towards_facet(mesh)
    half = (view + light) / np.linalg.norm(view + light)
    np.testing.assert_allclose(half, presets.worst_facet(mesh), atol=1e-14)
    camera = Orthographic(5 * view, up=np.cross(view, light))

    def gloss(point, normal, view):
        return jnp.broadcast_to(jnp.maximum(jnp.tensordot(half, normal, 1), 0) ** n, normal.shape)

    picture, smooth = (
        np.asarray(shade_mesh(mesh, camera, gloss, size=(65, 65), shading=shading, normals=mesh.vertices))
        for shading in ("gouraud", "phong")
    )
    assert smooth.max() == pytest.approx(1, abs=0.03)
    assert picture.max() == pytest.approx(left, abs=1e-3)
    assert float(failures.lost_highlight(mesh, n)) == pytest.approx(left, abs=5e-4)


# --- drawing ---


def test_false_colours_tell_loss_from_excess():
    black, grey, white, purple, yellow = drawing.false_color([-1.0, -0.5, 0.0, 1e-4, 4.0]).T
    assert np.all(black == 0)
    assert np.ptp(grey) == 0
    assert np.all(white == 1)
    assert purple[2] > purple[0] > purple[1]
    assert yellow[0] > 0.8 > 0.1 > yellow[2]
    np.testing.assert_allclose(drawing.false_color([100.0]).T[0], yellow)
    np.testing.assert_allclose(drawing.false_color([np.nan]).T[0], black)


def test_a_scale_shows_its_colours_and_a_curve_its_points():
    scale = drawing.color_scale(400, "excess")
    row = scale[:, 29]
    np.testing.assert_allclose(row[:, 400 - 42], drawing.false_color(4.0), atol=1e-6)
    square = drawing.curve(65, [0.0, 1.0], [0.0, 1.0], 0, 1)
    assert square.shape == (3, 65, 65)
    assert all(square[0, 64 - i, i] == 0 for i in range(20, 60))
    assert drawing.stacked(np.zeros((3, 2, 5)), np.zeros((3, 3, 4))).shape == (3, 5, 5)
