"""Derivatives of images: both modes, in float32, for every BRDF of the catalogue, with respect to all its numbers."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import Constant, Normalized
from brdfcheck.brdf.microfacet import CookTorrance
from brdfcheck.scene.cameras import Orthographic
from brdfcheck.scene.furnace import directional_albedo
from brdfcheck.scene.lights import Distant
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.meshes import icosphere
from brdfcheck.scene.smooth import render_mesh
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.tracing import Sphere, trace


def image_sum(drawings, brdf, direction, intensity):
    """The sum of images of 16 by 16 pixels, drawn in the ways that are named, in the precision of the direction."""
    surface, light = Surface(Term(brdf, 0.5), allow_unvalidated=True), [Distant(direction, intensity)]
    options = {"size": (16, 16), "dtype": direction.dtype}
    ways = {
        "sphere": lambda: sphere_image(surface, light, **options),
        "mesh": lambda: render_mesh(icosphere(1, direction.dtype), Orthographic(), surface, light, size=(16, 16)),
        "trace": lambda: trace([Sphere((0.0, 0.0, 0.0), 0.8, surface)], light, Orthographic(), depth=0, **options),
    }
    return sum((jnp.sum(ways[way]()) for way in drawings), jnp.zeros((), direction.dtype))


# The BRDF is an argument: those of one kind are one program.
slopes_of = jax.jit(jax.grad(image_sum, (1, 2, 3)), static_argnums=0)
forward_of = jax.jit(
    lambda drawings, given, along: jax.jvp(functools.partial(image_sum, drawings), given, along)[1], static_argnums=0
)


def numbers(name, dtype):
    """A BRDF of the catalogue with its factor as a number, the direction and the intensity of a light."""
    ((low, high),) = catalog.entry(name).family.ranges.values()
    brdf = catalog.exponent_family(name)(jnp.asarray(min(0.3 * high, 30.0) + 0.2 * low, dtype))
    if isinstance(brdf, Normalized):
        brdf = Normalized(brdf.lobe, Constant(brdf.scale()))
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), (brdf, jnp.asarray([1.0, 1, 1]), jnp.asarray([1, 2, 0.5])))


def kind(name):
    core = catalog.exponent_family(name)(0.5).core
    return type(core), getattr(core, "form", "")


NAMES = tuple(entry.name for entry in catalog.entries() if entry.family.surface is None)
KINDS = list({kind(name): name for name in reversed(NAMES)}.values())
"""One BRDF of each kind."""


@pytest.mark.parametrize("name", few(NAMES, KINDS[::4]))
def test_reverse_mode_in_float32_is_finite(name):
    slopes = slopes_of(("sphere",), *numbers(name, jnp.float32))
    assert np.all(np.isfinite(np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(slopes)])))
    assert np.any(np.asarray(slopes[1]))  # there is something to be seen
    assert np.all(np.asarray(slopes[2]))


@pytest.mark.slow
@pytest.mark.parametrize("drawings", [("sphere",), ("mesh", "trace")])
@pytest.mark.parametrize("name", KINDS)
def test_reverse_mode_is_forward_mode(name, drawings):
    given = numbers(name, jnp.float32)
    along = jax.tree.map(lambda leaf: jnp.linspace(0.4, 0.9, leaf.size, dtype=leaf.dtype).reshape(leaf.shape), given)
    parts = jax.tree.map(lambda slope, way: float(jnp.sum(slope * way)), slopes_of(drawings, *given), along)
    parts = np.array(jax.tree.leaves(parts))
    assert np.all(np.isfinite(parts))
    assert float(forward_of(drawings, given, along)) == pytest.approx(parts.sum(), abs=1e-4 * np.abs(parts).max())


def test_reverse_mode_with_several_slopes():
    def total(slopes):
        lobe = CookTorrance(slopes, weights=jnp.asarray([0.3, 0.7], jnp.float32))
        return jnp.sum(sphere_image(Surface(Term(lobe, 0.5)), [Distant((1.0, 1.0, 1.0))], size=(16, 16)))

    given = jnp.asarray([0.05, 0.6], jnp.float32)
    slopes = jax.jit(jax.grad(total))(given)
    assert np.all(np.isfinite(slopes))
    np.testing.assert_allclose(slopes, jax.jit(jax.jacfwd(total))(given), rtol=1e-4)


@pytest.mark.parametrize("name", few(["phong", "cook-torrance", "beckmann-smith-correlated"], ("cook-torrance",)))
def test_reverse_mode_is_the_central_difference(name):
    (parameter,) = catalog.entry(name).family.ranges
    total = jax.jit(lambda value, way: image_sum(("sphere",), catalog.exponent_family(name)(value), way, jnp.ones(3)))
    value, way = jnp.asarray({"n": 30.0}.get(parameter, 0.3)), jnp.asarray([1.0, 1, 1])
    slopes = jax.jit(jax.grad(total, (0, 1)))(value, way)
    turn, step = jnp.asarray([0.0, 0.3, -0.2]), 1e-5
    for slope, move in ((slopes[0], (1.0, 0 * turn)), (jnp.dot(slopes[1], turn), (0.0, turn))):
        ends = [total(value + sign * step * move[0], way + sign * step * move[1]) for sign in (1, -1)]
        assert float(slope) == pytest.approx(float(ends[0] - ends[1]) / (2 * step), rel=1e-5, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["phong", "cook-torrance", "beckmann-smith-correlated"])
def test_both_modes_through_the_furnace_in_float32(name):
    value = jnp.asarray(9.2 if name == "phong" else 0.3, jnp.float32)
    cosine = jnp.asarray([0.02, 0.3, 0.8, 1.0], jnp.float32)

    def albedo(value):
        return directional_albedo(catalog.exponent_family(name)(value), cosine)

    backward, forward = jax.jit(lambda value: (jax.jacrev(albedo)(value), jax.jacfwd(albedo)(value)))(value)
    assert backward.dtype == jnp.float32
    assert np.all(np.isfinite(backward))
    np.testing.assert_allclose(backward, forward, rtol=1e-3, atol=1e-6)
