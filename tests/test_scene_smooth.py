"""Flat, Gouraud and Phong shading: against plain numpy, against the exact sphere, and where they fail in the image."""

from __future__ import annotations

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import numpy_raster as plain
import pytest

from brdfcheck.scene import failures
from brdfcheck.scene.cameras import Orthographic, Perspective
from brdfcheck.scene.lights import Distant, Point
from brdfcheck.scene.materials import Highlight, Surface, Term
from brdfcheck.scene.meshes import Mesh, corrugated, deformed, face_normals, icosphere, vertex_normals, zigzag
from brdfcheck.scene.smooth import render_mesh, shade_mesh

LIGHT, COLOR, GLOSS, N = np.array([0.3, 0.5, 0.8]), np.array([0.6, 0.3, 0.1]), 0.4, 20.0
CAMERAS = {
    "orthographic": (Orthographic, {"half_height": 1.3}),
    "perspective": (Perspective, {"field_of_view": 40.0}),
}
PLACE = {"eye": (1.5, 1.1, 3.0), "target": (0.1, -0.05, 0.0), "up": (0.2, 1.0, 0.1)}


def blinn(point, normal, view, light=LIGHT, n=N):
    """The shader of `numpy_raster.blinn`, component-first."""
    light = jnp.asarray(light / np.linalg.norm(light), normal.dtype)
    lit = jnp.tensordot(light, normal, 1)
    half = view + light.reshape(3, *[1] * (view.ndim - 1))
    cosine = jnp.sum(normal * half, axis=0) / jnp.sqrt(jnp.sum(half * half, axis=0))
    gloss = GLOSS * jnp.exp(n * jnp.log(jnp.maximum(cosine, 1e-12)))
    return jnp.stack([jnp.where(lit > 0, lit * part + gloss, 0) for part in COLOR.tolist()])


image_of = eqx.filter_jit(shade_mesh)


def plain_blinn(point, normal, view):
    return plain.blinn(normal, view, LIGHT, COLOR, GLOSS, N)


@pytest.mark.parametrize("kind", CAMERAS)
@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong"])
def test_images_are_those_of_plain_numpy(shading, kind):
    camera, opening = CAMERAS[kind]
    mesh, size = deformed(icosphere(1), lambda vertices: vertices * np.array([1.2, 1.0, 0.7])), (45, 60)
    background = np.array([0.1, 0.2, 0.3])
    found = image_of(mesh, camera(**PLACE, **opening), blinn, size=size, shading=shading, background=background)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    normals = plain.averaged_normals(vertices, faces, by_area=False)
    rays = plain.camera_rays(*PLACE.values(), size, **opening)
    expected, margin = plain.image(vertices, faces, normals, *rays, plain_blinn, shading, background=background)
    clear = margin > 1e-9
    assert clear.mean() > 0.99
    assert np.ptp(expected) > 0.7
    np.testing.assert_allclose(np.moveaxis(found, 0, -1)[clear], expected[clear], atol=1e-11)


def test_single_precision_is_close_to_double():
    arguments = {"size": (96, 96), "shading": "phong"}
    double, single = (image_of(icosphere(2, dtype), Perspective(), blinn, **arguments) for dtype in (None, jnp.float32))
    assert single.dtype == jnp.float32
    # A few pixels on edges fall to another face; all others agree to the digits of float32.
    difference = np.abs(np.asarray(double) - np.asarray(single)).max(0)
    assert np.mean(difference > 2e-5) < 2e-3


@pytest.mark.parametrize("level", [0, 2])
def test_phong_with_exact_normals_is_the_exact_sphere(level):
    # A vertex at its own normal: what is interpolated and made unit again points from the centre through the facet.
    mesh, camera = icosphere(level), Orthographic()
    seen = []

    def normal_shader(point, normal, view):
        seen.append(point)
        radius = jnp.sqrt(jnp.sum(point * point, axis=0))
        return jnp.abs(normal - point / radius)

    difference = shade_mesh(mesh, camera, normal_shader, size=(64, 64), normals=mesh.vertices)
    assert float(difference.max()) < 1e-14
    # So the image is the exact sphere's, shaded where the ray to the facet meets the sphere along the radius.
    image = image_of(mesh, camera, blinn, size=(64, 64), normals=mesh.vertices)
    point = np.moveaxis(np.asarray(seen[0]), 0, -1)
    normal = plain.unit(point)
    exact = plain.blinn(normal, np.broadcast_to([0.0, 0, 1], normal.shape), LIGHT, COLOR, GLOSS, N)
    covered = np.asarray(image).max(0) > 0
    np.testing.assert_allclose(np.moveaxis(image, 0, -1)[covered], exact[covered], atol=1e-13)


def test_phong_tends_to_the_exact_sphere_in_every_pixel():
    size, half = (128, 128), 1.05
    x, y = ((np.arange(128) + 0.5) / 64 - 1) * half, (1 - (np.arange(128) + 0.5) / 64) * half
    square = 1 - x[None] ** 2 - y[:, None] ** 2
    inside = square > 0.05
    normal = np.stack(np.broadcast_arrays(x[None], y[:, None], np.sqrt(np.maximum(square, 0))), axis=-1)
    exact = plain.blinn(normal, np.broadcast_to([0.0, 0, 1], normal.shape), LIGHT, COLOR, GLOSS, N)
    errors = {}
    for shading in ("flat", "gouraud", "phong"):
        errors[shading] = [
            np.abs(np.moveaxis(image_of(icosphere(level), Orthographic(), blinn, size=size, shading=shading), 0, -1) - exact)[
                inside
            ].max()
            for level in (2, 3, 4)
        ]
    # Flat shading is of first order in the size of a facet, the other two of second.
    assert errors["flat"][0] / errors["flat"][2] == pytest.approx(4, rel=0.35)
    for shading in ("gouraud", "phong"):
        assert errors[shading][0] / errors[shading][2] > 7
        assert errors[shading][2] < errors["flat"][2] / 5


def test_the_lost_highlight_in_the_image():
    # A light and an eye over the centre of the worst facet.
    mesh = icosphere(2)
    nearest = np.asarray(face_normals(mesh)) @ np.asarray(mesh.vertices).T
    axis = np.asarray(face_normals(mesh))[nearest.max(1).argmin()]
    camera = Orthographic(5 * axis, half_height=0.1)

    for n, expected in ((10.0, 0.836), (100.0, 0.167), (1000.0, 0.0)):

        def highlight(point, normal, view, n=n):
            # Mirror-like about the axis: R.V with L = V = axis is 2 (N.A)^2 - 1; here cos^n of the angle to N itself.
            return jnp.exp(n * jnp.log(jnp.maximum(jnp.tensordot(axis, normal, 1), 1e-9)))[None]

        gouraud, phong = (
            image_of(mesh, camera, highlight, size=(65, 65), shading=shading, normals=mesh.vertices)
            for shading in ("gouraud", "phong")
        )
        assert float(gouraud[0, 32, 32]) == pytest.approx(expected, abs=5e-4)
        assert float(gouraud[0, 32, 32]) == pytest.approx(float(failures.lost_highlight(mesh, n)), abs=1e-12)
        assert float(phong[0, 32, 32]) == pytest.approx(1, abs=1e-12)


def test_the_silhouette_bleeds_in_the_image():
    mesh, axis = icosphere(2), plain.unit(np.array([0.3, 0.2, 1.0]))
    camera = Orthographic(5 * axis)

    def from_behind(point, normal, view):
        return jnp.maximum(-jnp.tensordot(axis, normal, 1), 0)[None]

    bound = float(failures.silhouette_bleed(mesh, axis))
    for shading in ("gouraud", "phong"):
        image = np.asarray(image_of(mesh, camera, from_behind, size=(256, 256), shading=shading))
        assert 0.5 * bound < image.max() <= bound
    assert np.asarray(image_of(mesh, camera, from_behind, size=(256, 256), shading="flat")).max() == 0


def test_sheets_in_the_image():
    light = np.array([np.sin(np.radians(25)), 0, np.cos(np.radians(25))])

    def matt(point, normal, view):
        return jnp.maximum(jnp.tensordot(light, normal, 1), 0)[None]

    def contrast(mesh, shading):
        # From above, without the outermost wave, whose border vertices have one side only.
        image = image_of(mesh, Orthographic(half_height=0.8), matt, size=(200, 200), shading=shading)
        return float(image.max() - image.min())

    assert round(contrast(zigzag(), "flat"), 3) == 0.565
    assert contrast(zigzag(), "gouraud") == pytest.approx(0, abs=1e-14)
    assert contrast(zigzag(), "phong") == pytest.approx(0, abs=1e-14)
    assert contrast(corrugated(), "gouraud") > 0.5
    assert contrast(corrugated(), "phong") > 0.5


def test_a_deformed_mesh_is_shaded_with_its_new_normals():
    flat_sheet = deformed(corrugated(4), lambda vertices: vertices * np.array([1.0, 1.0, 1e-3]))
    waves = image_of(corrugated(4), Orthographic(half_height=0.8), blinn, size=(64, 64))
    sheet = image_of(flat_sheet, Orthographic(half_height=0.8), blinn, size=(64, 64))
    assert np.ptp(np.asarray(waves[0])) > 0.3
    assert np.ptp(np.asarray(sheet[0])) < 0.01


MATERIAL = functools.cache(lambda: Surface(Term("lambert", (0.5, 0.3, 0.1)), Term("phong", 0.3, n=30)))


def test_catalogue_materials_on_meshes():
    light = np.array([1.0, 2.0, 4.0])
    image = render_mesh(icosphere(2), Orthographic(), MATERIAL(), (Distant(light, 2.0),), size=(64, 64), shading="flat")

    # (kd / pi + ks (n+2)/(2 pi) (R.V)^n) (N.L) E, written out.
    def shader(point, normal, view):
        towards = plain.unit(light)
        lit = np.maximum(normal @ towards, 0)
        mirrored = np.maximum(np.sum((2 * (normal @ towards)[..., None] * normal - towards) * view, axis=-1), 0)
        value = np.array([0.5, 0.3, 0.1]) / np.pi + (0.3 * 32 / (2 * np.pi) * mirrored**30)[..., None]
        return 2 * lit[..., None] * value

    mesh = icosphere(2)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    rays = plain.camera_rays((0, 0, 5), (0, 0, 0), (0, 1, 0), (64, 64), half_height=1.05)
    expected, margin = plain.image(vertices, faces, vertices, *rays, shader, "flat")
    clear = margin > 1e-9
    np.testing.assert_allclose(np.moveaxis(image, 0, -1)[clear], expected[clear], atol=1e-12)


def test_one_program_for_all_numbers(monkeypatch):
    traces = []
    from brdfcheck.scene import smooth

    monkeypatch.setattr(smooth, "shade", lambda *arguments: traces.append(1) or jnp.ones((3, *arguments[3].shape[1:])))
    for value in (0.2, 0.5, 0.9):
        lights = (Distant((value, 1.0, 1.0), value), Point((1.0, 1.0, 4 + value), value))
        mesh = deformed(icosphere(0), lambda vertices, value=value: vertices * np.array([1.0, value, 1.0]))
        material, camera = Highlight(value, n=10 * value), Perspective((value, 0.0, 4.0))
        image = smooth.render_mesh(mesh, camera, material, lights, size=(23, 29), background=value)
        assert float(image.min()) == pytest.approx(value)
    assert len(traces) == 1


def test_gradients_in_material_light_and_shape():
    mesh, camera = icosphere(1), Perspective()
    start = {"base": np.array([0.7, 0.4, 0.2]), "n": np.array(12.0), "light": np.array([0.4, 0.7, 1.0]), "a": np.array(1.1)}
    random = np.random.default_rng(5)
    move = {name: random.normal(size=value.shape) for name, value in start.items()}
    step = 1e-6
    there, back = ({name: value + s * move[name] for name, value in start.items()} for s in (step, -step))

    @functools.partial(jax.jit, static_argnames="shading")
    def energy(numbers, shading):
        material = Highlight(numbers["base"], n=numbers["n"])
        lights = (Distant(numbers["light"]), Point((2.0, 1.0, 3.0), numbers["a"], quadratic_attenuation=0.1))
        return jnp.mean(render_mesh(mesh, camera, material, lights, size=(24, 24), shading=shading) ** 2)

    for shading in ("flat", "gouraud", "phong"):
        gradient = jax.grad(energy)(start, shading)
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))
        along = sum(np.sum(gradient[name] * move[name]) for name in move)
        central = float(energy(there, shading) - energy(back, shading)) / (2 * step)
        assert along == pytest.approx(central, rel=1e-6)

    @jax.jit
    def of_shape(vertices):
        return jnp.mean(shade_mesh(Mesh(vertices, mesh.faces), camera, blinn, size=(24, 24)) ** 2)

    assert np.all(np.isfinite(jax.grad(of_shape)(mesh.vertices)))


def test_parallel_normals_that_cancel_do_not_become_nan():
    # Interpolated between two opposite normals, half way, there is no direction.
    mesh = Mesh([[-1, -1, 0], [1, -1, 0], [0, 2, 0.0]], [[0, 1, 2]])
    normals = jnp.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 1.0]])
    image = image_of(mesh, Orthographic(), lambda p, n, v: n, size=(32, 32), normals=normals)
    assert np.all(np.isfinite(image))


@pytest.mark.parametrize(
    ("camera", "options", "message"),
    [
        (Orthographic(), {"shading": "toon"}, "shading must be one of flat, gouraud, phong"),
        (Orthographic(), {"size": (8, -8)}, "size must be"),
        (Orthographic(), {"weighting": "angle"}, "weighting must be unit or area"),
        (Perspective((0.0, 0.0, 0.5)), {}, "the camera at .* is inside the mesh or beyond it"),
        (Perspective((0.0, 0.0, 3.0), (0.0, 0.0, 9.0)), {}, "12 of 12 vertices are behind it"),
        (Orthographic((0.3, 0.0, 0.2)), {}, "inside the mesh"),
    ],
)
def test_bad_arguments_are_refused(camera, options, message):
    with pytest.raises(ValueError, match=message):
        render_mesh(icosphere(0), camera, Highlight(0.5), (Distant((0.0, 0.0, 1.0)),), **{"size": (8, 8), **options})


def test_vertex_normals_stand_behind_the_default():
    mesh, camera = corrugated(2, rows=2), Orthographic((1.0, 0.5, 4.0))
    for weighting in ("unit", "area"):
        given = image_of(mesh, camera, blinn, size=(32, 32), normals=vertex_normals(mesh, weighting))
        np.testing.assert_allclose(image_of(mesh, camera, blinn, size=(32, 32), weighting=weighting), given, atol=1e-15)
