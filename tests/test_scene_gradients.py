"""Derivatives of images: both modes, in float32, for every BRDF of the catalogue, with respect to all its numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck.brdf import catalog
from brdfcheck.brdf.microfacet import CookTorrance
from brdfcheck.scene.cameras import Orthographic
from brdfcheck.scene.furnace import directional_albedo
from brdfcheck.scene.lights import Distant
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.meshes import icosphere
from brdfcheck.scene.smooth import render_mesh
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.tracing import Sphere, trace


def image_sum(name, dtype, drawings):
    """(parameter, direction, intensity) -> the sum of images of 16 by 16 pixels, drawn in the ways that are named."""
    (parameter,) = catalog.entry(name).family.ranges

    def total(value, direction, intensity):
        surface = Surface(Term(name, 0.5, **{parameter: value}), allow_unvalidated=True)
        light, camera, size = [Distant(direction, intensity)], Orthographic(), (16, 16)
        body = Sphere((0.0, 0.0, 0.0), 0.8, surface)
        ways = {
            "sphere": lambda: sphere_image(surface, light, size=size, dtype=dtype),
            "mesh": lambda: render_mesh(icosphere(1, dtype), camera, surface, light, size=size),
            "trace": lambda: trace([body], light, camera, size=size, depth=0, dtype=dtype),
        }
        return sum((jnp.sum(ways[way]()) for way in drawings), jnp.zeros((), dtype))

    return total


def numbers(name, dtype):
    ((low, high),) = catalog.entry(name).family.ranges.values()
    value = jnp.asarray(min(0.3 * high, 30.0) + 0.2 * low, dtype)
    return value, jnp.asarray([1, 1, 1], dtype), jnp.asarray([1, 2, 0.5], dtype)


def both_modes(name, drawings):
    total, given = image_sum(name, jnp.float32, drawings), numbers(name, jnp.float32)
    along = tuple(jnp.asarray(part, jnp.float32) for part in (0.7, (0.3, -1, 0.4), (1, 0.2, -0.5)))
    slopes, forward = jax.jit(lambda *given: (jax.grad(total, (0, 1, 2))(*given), jax.jvp(total, given, along)[1]))(*given)
    parts = np.array([float(jnp.sum(slope * way)) for slope, way in zip(slopes, along, strict=True)])
    assert np.all(np.isfinite(np.concatenate([np.ravel(slope) for slope in slopes])))
    assert np.all(parts[1:] != 0)  # there is something to be seen
    assert float(forward) == pytest.approx(parts.sum(), abs=1e-4 * np.abs(parts).max())


@pytest.mark.parametrize("name", catalog.names())
def test_reverse_mode_in_float32_is_finite_and_is_forward_mode(name):
    both_modes(name, ["sphere"])


@pytest.mark.parametrize(
    "name",
    [name if name in ("cook-torrance", "phong") else pytest.param(name, marks=pytest.mark.slow) for name in catalog.names()],
)
def test_reverse_mode_through_meshes_and_rays(name):
    both_modes(name, ["mesh", "trace"])


def test_reverse_mode_with_several_slopes():
    def total(slopes):
        lobe = CookTorrance(slopes, weights=jnp.asarray([0.3, 0.7], jnp.float32))
        return jnp.sum(sphere_image(Surface(Term(lobe, 0.5)), [Distant((1.0, 1.0, 1.0))], size=(16, 16)))

    given = jnp.asarray([0.05, 0.6], jnp.float32)
    slopes = jax.jit(jax.grad(total))(given)
    assert np.all(np.isfinite(slopes))
    np.testing.assert_allclose(slopes, jax.jit(jax.jacfwd(total))(given), rtol=1e-4)


@pytest.mark.parametrize("name", ["phong", "cook-torrance", "beckmann-smith-correlated"])
def test_reverse_mode_is_the_central_difference(name):
    total = jax.jit(image_sum(name, jnp.float64, ["sphere"]))
    value, direction, intensity = numbers(name, jnp.float64)
    slopes = jax.grad(total, (0, 1))(value, direction, intensity)
    turn, step = jnp.asarray([0.0, 0.3, -0.2]), 1e-5
    for slope, way in ((slopes[0], (1.0, 0 * turn)), (jnp.dot(slopes[1], turn), (0.0, turn))):
        ends = [total(value + sign * step * way[0], direction + sign * step * way[1], intensity) for sign in (1, -1)]
        assert float(slope) == pytest.approx(float(ends[0] - ends[1]) / (2 * step), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("name", ["phong", "cook-torrance", "beckmann-smith-correlated"])
def test_both_modes_through_the_furnace_in_float32(name):
    value = numbers(name, jnp.float32)[0]
    cosine = jnp.asarray([0.02, 0.3, 0.8, 1.0], jnp.float32)

    def albedo(value):
        return directional_albedo(catalog.exponent_family(name)(value), cosine)

    backward, forward = jax.jit(lambda value: (jax.jacrev(albedo)(value), jax.jacfwd(albedo)(value)))(value)
    assert backward.dtype == jnp.float32
    assert np.all(np.isfinite(backward))
    np.testing.assert_allclose(backward, forward, rtol=1e-3, atol=1e-6)
