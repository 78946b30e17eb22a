"""Flat, Gouraud and Phong shading: against plain numpy, against the exact sphere, and where they fail in the image."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import numpy_raster as plain
import pytest
from selection import few
from test_scene_raster import CAMERAS, PLACE

from brdfcheck.scene.artistic import Highlight
from brdfcheck.scene.cameras import Orthographic, Perspective
from brdfcheck.scene.lights import Distant, Point
from brdfcheck.scene.meshes import Mesh, icosphere
from brdfcheck.scene.raster import rasterise
from brdfcheck.scene.smooth import SHADINGS, render_mesh, shadings_of

LIGHT, COLOR, GLOSS, N = np.array([0.3, 0.5, 0.8]), np.array([0.6, 0.3, 0.1]), 0.4, 20.0


def blinn(point, normal, view, light=LIGHT, n=N):
    """The shader of `numpy_raster.blinn`, component-first."""
    light = jnp.asarray(light / np.linalg.norm(light), normal.dtype)
    lit = jnp.tensordot(light, normal, 1)
    half = view + light.reshape(3, *[1] * (view.ndim - 1))
    cosine = jnp.sum(normal * half, axis=0) / jnp.sqrt(jnp.sum(half * half, axis=0))
    gloss = GLOSS * jnp.exp(n * jnp.log(jnp.maximum(cosine, 1e-12)))
    return jnp.stack([jnp.where(lit > 0, lit * part + gloss, 0) for part in COLOR.tolist()])


@eqx.filter_jit
def each_shading(mesh, camera, shader, shadings=("flat", "gouraud", "phong"), **options):
    """The images of all three shadings as one program: flat, gouraud, phong."""
    return shadings_of(mesh, camera, shader, shadings, **options)


def image_of(mesh, camera, shader, **options):
    return each_shading(mesh, camera, shader, ("phong",), **options)[0]


def stretched(mesh, *factors):
    return Mesh(mesh.vertices * np.array(factors), mesh.faces)


def plain_blinn(point, normal, view):
    return plain.blinn(normal, view, LIGHT, COLOR, GLOSS, N)


@pytest.mark.parametrize("kind", few(CAMERAS, ("perspective",)))
def test_images_are_those_of_plain_numpy(kind):
    camera, opening = CAMERAS[kind]
    mesh, size = stretched(icosphere(1), 1.2, 1.0, 0.7), (45, 60)
    background = np.array([0.1, 0.2, 0.3])
    images = each_shading(mesh, camera(**PLACE, **opening), blinn, size=size, background=background)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    normals = plain.averaged_normals(vertices, faces, by_area=False)
    rays = plain.camera_rays(*PLACE.values(), size, **opening)
    for found, shading in zip(images, ("flat", "gouraud", "phong"), strict=True):
        expected, margin = plain.image(vertices, faces, normals, *rays, plain_blinn, shading, background=background)
        clear = margin > 1e-9
        assert clear.mean() > 0.99
        assert np.ptp(expected) > 0.7
        np.testing.assert_allclose(np.moveaxis(found, 0, -1)[clear], expected[clear], atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("level", [0, 2])
def test_phong_with_exact_normals_is_the_exact_sphere(level):
    # A vertex at its own normal: what is interpolated and made unit again points from the centre through the facet.
    mesh, camera = icosphere(level), Orthographic()

    def everything(point, normal, view):
        return jnp.concatenate([point, normal, blinn(point, normal, view)])

    image = np.moveaxis(np.asarray(image_of(mesh, camera, everything, size=(64, 64), normals=mesh.vertices)), 0, -1)
    image = image[np.any(image != 0, axis=-1)]
    assert len(image) > 2000
    normal = plain.normalised(image[:, :3])
    np.testing.assert_allclose(image[:, 3:6], normal, atol=1e-14)
    # So the image is the exact sphere's, shaded where the radius through the facet meets the sphere.
    exact = plain.blinn(normal, np.broadcast_to([0.0, 0, 1], normal.shape), LIGHT, COLOR, GLOSS, N)
    np.testing.assert_allclose(image[:, 6:], exact, atol=1e-13)


@pytest.mark.slow
def test_phong_tends_to_the_exact_sphere_in_every_pixel():
    size, half = (128, 128), 1.05
    x, y = ((np.arange(128) + 0.5) / 64 - 1) * half, (1 - (np.arange(128) + 0.5) / 64) * half
    square = 1 - x[None] ** 2 - y[:, None] ** 2
    inside = square > 0.05
    normal = np.stack(np.broadcast_arrays(x[None], y[:, None], np.sqrt(np.maximum(square, 0))), axis=-1)
    exact = plain.blinn(normal, np.broadcast_to([0.0, 0, 1], normal.shape), LIGHT, COLOR, GLOSS, N)
    images = [each_shading(icosphere(level), Orthographic(), blinn, size=size) for level in (2, 4)]
    errors = np.array([[np.abs(np.moveaxis(i, 0, -1) - exact)[inside].max() for i in per_level] for per_level in images])
    # Flat shading is of first order in the size of a facet, the other two of second.
    flat, *smooth = errors[0] / errors[1]
    assert flat == pytest.approx(4, rel=0.35)
    assert min(smooth) > 7
    assert errors[1, 1:].max() < errors[1, 0] / 5


@pytest.mark.slow
def test_one_program_for_all_numbers(monkeypatch):
    traces = []
    from brdfcheck.scene import smooth

    monkeypatch.setattr(smooth, "shade", lambda *arguments: traces.append(1) or jnp.ones((3, *arguments[3].shape[1:])))
    for value in (0.2, 0.5, 0.9):
        lights = (Distant((value, 1.0, 1.0), value), Point((1.0, 1.0, 4 + value), value))
        mesh = stretched(icosphere(0), 1.0, value, 1.0)
        material, camera = Highlight(value, n=10 * value), Perspective((value, 0.0, 4.0))
        image = smooth.render_mesh(mesh, camera, material, lights, size=(23, 29), background=value)
        assert float(image.min()) == pytest.approx(value)
    assert len(traces) == 1


@pytest.mark.slow
def test_several_shadings_are_one_program_with_one_rasteriser(monkeypatch):
    from brdfcheck.scene import smooth

    calls = []
    monkeypatch.setattr(smooth, "rasterise", lambda *a, **o: calls.append(1) or rasterise(*a, **o))
    arguments = (icosphere(0), Orthographic(), Highlight(0.5), (Distant((0.2, 0.4, 1.0)),))
    images = smooth.render_shadings(*arguments, size=(21, 27), background=0.1)
    assert len(calls) == 1
    for shading, image in zip(SHADINGS, images, strict=True):
        np.testing.assert_allclose(image, render_mesh(*arguments, size=(21, 27), shading=shading, background=0.1), atol=1e-15)


@pytest.mark.slow
def test_gradients_in_material_light_and_shape():
    mesh, camera = icosphere(1), Perspective()
    start = {"base": np.array([0.7, 0.4, 0.2]), "n": np.array(12.0), "light": np.array([0.4, 0.7, 1.0]), "a": np.array(1.1)}
    random = np.random.default_rng(5)
    move = {name: random.normal(size=value.shape) for name, value in start.items()}
    step = 1e-6
    there, back = ({name: value + s * move[name] for name, value in start.items()} for s in (step, -step))

    @jax.jit
    def energies(numbers):
        material = Highlight(numbers["base"], n=numbers["n"])
        lights = (Distant(numbers["light"]), Point((2.0, 1.0, 3.0), numbers["a"], quadratic_attenuation=0.1))
        images = [render_mesh(mesh, camera, material, lights, size=(24, 24), shading=shading) for shading in SHADINGS]
        return jnp.stack([jnp.mean(image**2) for image in images])

    gradients = jax.jit(jax.jacrev(energies))(start)
    central = np.asarray(energies(there) - energies(back)) / (2 * step)
    along = sum(np.sum(np.reshape(gradients[name] * move[name], (3, -1)), axis=1) for name in move)
    np.testing.assert_allclose(along, central, rtol=1e-6)

    @jax.jit
    def of_shape(vertices):
        return jnp.mean(image_of(Mesh(vertices, mesh.faces), camera, blinn, size=(24, 24)) ** 2)

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
