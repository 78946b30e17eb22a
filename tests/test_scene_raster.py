"""The rasteriser against rays through every pixel in plain numpy, and against closed forms."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy_raster import camera_rays, seen
from selection import few

from brdfcheck.scene import raster
from brdfcheck.scene.cameras import Orthographic, Perspective, pixel_centres
from brdfcheck.scene.meshes import Mesh, corrugated, icosphere, latitude_longitude_sphere, zigzag

# Compiled whole: operation by operation, each size of mesh would compile dozens of small programs.
rasterise = eqx.filter_jit(raster.rasterise)

CAMERAS = {
    "orthographic": (Orthographic, {"half_height": 1.3}),
    "perspective": (Perspective, {"field_of_view": 40.0}),
}
PLACE = {"eye": (1.5, 1.1, 3.0), "target": (0.1, -0.05, 0.0), "up": (0.2, 1.0, 0.1)}
MESHES = {
    "icosphere": (lambda: icosphere(1), True),
    "globe": (lambda: latitude_longitude_sphere(4, 5), True),
    "zigzag from both sides": (lambda: zigzag(2, slope=2.0, rows=1), False),
    "corrugated": (lambda: corrugated(2, slope=1.5, segments=5, rows=2), False),
}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        pytest.param("icosphere", "orthographic", marks=pytest.mark.slow),
        ("icosphere", "perspective"),
        pytest.param("globe", "perspective", marks=pytest.mark.slow),
        pytest.param("zigzag from both sides", "perspective", marks=pytest.mark.slow),
        pytest.param("corrugated", "orthographic", marks=pytest.mark.slow),
    ],
)
def test_faces_and_weights_are_those_that_rays_hit(name, kind):
    size = (41, 57) if MESHES[name][1] else (64, 30)
    build, cull = MESHES[name]
    mesh = build()
    camera, opening = CAMERAS[kind]
    found = rasterise(mesh, camera(**PLACE, **opening), size, **({} if cull else {"cull": False}))
    rays = camera_rays(*PLACE.values(), size, **opening)
    face, weights, margin = seen(np.asarray(mesh.vertices), np.asarray(mesh.faces), *rays, cull=cull)
    # Rays within rounding of an edge may fall on either side of it.
    clear = margin > 1e-9
    assert clear.mean() > 0.99
    assert 0.2 < np.mean(face >= 0) < 0.9
    np.testing.assert_array_equal(np.asarray(found.face)[clear], face[clear])
    covered = clear & (face >= 0)
    np.testing.assert_allclose(np.moveaxis(found.weights, 0, -1)[covered], weights[covered], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("level", "dtype"), [(0, jnp.float64), (4, jnp.float32)])
def test_closed_meshes_have_no_holes(level, dtype):
    # Edges straight through pixel centres: an even size, and vertices on the axes.
    for camera in (Orthographic(), Orthographic((0, 0, 5), (0, 0, 0), (1, 1, 0)), Perspective((3.0, 0, 0), field_of_view=50.0)):
        mesh = icosphere(level, dtype)
        covered = np.asarray(rasterise(mesh, camera, (128, 128)).covered)
        for line in (covered, covered.T):
            # In each row, from the first covered pixel to the last one, none is clear: the mesh is convex.
            first, last = line.argmax(1), line.shape[1] - line[:, ::-1].argmax(1)
            assert np.all(line.sum(1) == np.where(line.any(1), last - first, 0))
        assert covered.sum() > 5000


SHEET = Mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]], [[0, 1, 2], [0, 2, 3]])


def test_every_pixel_on_a_common_edge_belongs_to_someone():
    # Two triangles over the whole image whose common diagonal passes through the pixel centres.
    found = rasterise(SHEET, Orthographic(half_height=1.0), (64, 64))
    assert np.all(np.asarray(found.covered))
    assert set(np.asarray(found.face)[::-1].diagonal()) <= {0, 1}


@pytest.mark.slow
@pytest.mark.parametrize("size", [(256, 256), (200, 512)])
def test_area_and_position(size):
    # The silhouette of a fine sphere covers pi r^2, in whatever format.
    mesh = icosphere(4)
    found = rasterise(mesh, Orthographic(half_height=1.25), size)
    pixels = np.asarray(found.covered).sum()
    assert pixels == pytest.approx(np.pi * (size[0] / 2.5) ** 2, rel=3e-3)
    # Interpolated positions lie on the sphere, to the depth of a facet, and on the pixel's ray.
    points = np.asarray(found.interpolate(mesh.faces, mesh.vertices.T))[:, np.asarray(found.covered)]
    radius = np.linalg.norm(points, axis=0)
    assert 0.998 < radius.min() < radius.max() <= 1 + 1e-12
    centres = np.asarray(pixel_centres(size, float))[:, np.asarray(found.covered)]
    np.testing.assert_allclose(points[0], (centres[0] - size[1] / 2) * 2.5 / size[0], atol=1e-12)
    np.testing.assert_allclose(points[1], (size[0] / 2 - centres[1]) * 2.5 / size[0], atol=1e-12)
    assert points[2].min() > 0


@pytest.mark.slow
def test_perspective_sees_a_smaller_cap():
    # From the distance d the silhouette of the sphere has the angle asin(1/d).
    found = rasterise(icosphere(4), Perspective((0.0, 0.0, 2.0), field_of_view=80.0), (400, 400))
    radius = np.tan(np.arcsin(0.5)) / np.tan(np.radians(40)) * 200
    assert np.asarray(found.covered).sum() == pytest.approx(np.pi * radius**2, rel=4e-3)


@pytest.mark.parametrize("kind", few(CAMERAS, ("perspective",)))
def test_rays_pass_through_the_pixels_that_project(kind):
    camera, opening = CAMERAS[kind]
    camera, size = camera(**PLACE, **opening), (20, 31)

    @eqx.filter_jit
    def there_and_back(camera, distance):
        origins, directions = camera.rays(size, jnp.float64)
        points = origins + distance * directions
        return origins, directions, camera.project(points, size).screen, camera.view(points)

    origins, directions, screen, view = there_and_back(camera, np.random.default_rng(3).uniform(1, 6, size))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=0), 1, rtol=1e-14)
    np.testing.assert_allclose(screen, pixel_centres(size, float), atol=1e-11)
    np.testing.assert_allclose(view, -directions, atol=1e-14)
    for mine, theirs in zip((origins, directions), camera_rays(*PLACE.values(), size, **opening), strict=True):
        np.testing.assert_allclose(np.moveaxis(mine, 0, -1), theirs, atol=1e-13)


@pytest.mark.slow
def test_culling_drops_back_faces_and_nothing_else():
    mesh = icosphere(1)
    camera = Orthographic()
    np.testing.assert_array_equal(rasterise(mesh, camera, (64, 64)).face, rasterise(mesh, camera, (64, 64), cull=False).face)
    inside_out = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    behind = rasterise(inside_out, camera, (64, 64))
    points = np.asarray(behind.interpolate(inside_out.faces, inside_out.vertices.T))[2]
    assert np.all(points[np.asarray(behind.covered)] < 0)  # the far side, through the open front


def test_faces_behind_the_eye_are_not_drawn():
    for mesh, camera, size in ((SHEET, Orthographic(), (64, 64)), (icosphere(1), Perspective(), (41, 57))):
        assert np.any(rasterise(mesh, camera, size).covered)
        for faces in (mesh.faces, mesh.faces[:, ::-1]):
            assert not np.any(rasterise(Mesh(mesh.vertices + np.array([0, 0, 10.0]), faces), camera, size).covered)


@pytest.mark.slow
def test_windows_reach_over_every_border():
    # A face much larger than the image, and one that barely touches each corner of it.
    big = Mesh([[-50, -60, 0], [70, -50, 0], [0, 90, 0.0]], [[0, 1, 2]])
    assert np.all(rasterise(big, Orthographic(), (37, 50)).covered)
    for x, y, corner in ((-1, 1, (0, 0)), (1, 1, (0, -1)), (-1, -1, (-1, 0)), (1, -1, (-1, -1))):
        # |x| + |y| >= 1.93: of 32 x 32 pixels, the one in the corner, whose centre has 1.9375.
        faces = [[0, 1, 2]] if x * y > 0 else [[0, 2, 1]]
        mesh = Mesh([[3 * x, 3 * y, 0], [-1.07 * x, 3 * y, 0], [3 * x, -1.07 * y, 0.0]], faces)
        covered = np.asarray(rasterise(mesh, Orthographic(half_height=1.0), (32, 32)).covered)
        assert covered[corner]
        assert covered.sum() == 1


@pytest.mark.slow
def test_one_program_for_all_numbers_and_all_coverings():
    traces = []

    @eqx.filter_jit
    def faces(mesh, camera):
        traces.append(1)
        return rasterise(mesh, camera, (32, 32))

    covered = [int(faces(icosphere(1), Orthographic(half_height=h)).covered.sum()) for h in (0.3, 1.0, 20.0)]
    faces(icosphere(1), Orthographic((3.0, 1.0, 1.0)))
    assert covered[0] == 32 * 32 > covered[1] > covered[2] > 0
    assert len(traces) == 1


@pytest.mark.slow
def test_types_follow_the_mesh_and_gradients_are_finite():
    mesh = icosphere(1, jnp.float32)
    found = rasterise(mesh, Perspective(), (32, 32))
    assert found.weights.dtype == jnp.float32
    assert found.face.dtype == jnp.int32

    @jax.jit
    def total(vertices):
        moved = Mesh(vertices, mesh.faces)
        fragments = rasterise(moved, Perspective(), (32, 32))
        return jnp.sum(jnp.where(fragments.covered, fragments.interpolate(moved.faces, vertices.T) ** 2, 0))

    assert np.all(np.isfinite(jax.jit(jax.grad(total))(mesh.vertices)))
    # Depth of a plane under a perspective camera, against central differences: nothing moves over an edge.
    sheet = Mesh([[-3, -3, 0], [3, -3, 0.2], [3, 3, 0.4], [-3, 3, 0.0]], [[0, 1, 2], [0, 2, 3]])
    move = np.random.default_rng(4).normal(size=(4, 3))

    @jax.jit
    def depth(vertices):
        moved = Mesh(vertices, sheet.faces)
        fragments = rasterise(moved, Perspective(), (8, 11))  # no centre on the diagonal
        return jnp.sum(fragments.interpolate(moved.faces, vertices.T)[2] ** 2)

    central = (depth(sheet.vertices + 1e-6 * move) - depth(sheet.vertices - 1e-6 * move)) / 2e-6
    assert np.sum(jax.jit(jax.grad(depth))(sheet.vertices) * move) == pytest.approx(float(central), rel=1e-7)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rasterise(icosphere(0), Orthographic(), (0, 5)), "size must be"),
        (lambda: rasterise(icosphere(0), Orthographic(), (5.0, 5)), "size must be"),  # pyright: ignore[reportArgumentType]
        (
            lambda: rasterise(icosphere(0), Orthographic(), (5, 5), interpolation="cubic"),
            "must be one of area",
        ),
        (lambda: Orthographic((0, 0, np.nan)), "eye must be finite; got"),
        (lambda: Orthographic((0, 1)), "eye must be"),
        (lambda: Perspective((0, 0, 1), (0, 0, 1)), "must not lie on one line"),
        (lambda: Perspective((0, 3, 0), (0, 0, 0), (0, 1, 0)), "must not lie on one line"),
        (lambda: Perspective(up=(0, 0, 0)), "up must not have length 0"),
        (lambda: Perspective(field_of_view=180.0), "field_of_view must be"),
        (lambda: Orthographic(half_height=-1.0), "half_height must be finite and > 0"),
        (lambda: Orthographic(half_height=np.inf), "half_height"),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
