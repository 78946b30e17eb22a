"""What a point of a scene looks like under a plan, and what of that is looked up in a grid of points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe, of_type
from brdfcheck.brdf.lobes import Lambert
from brdfcheck.budgets.grid import Grid, kept
from brdfcheck.budgets.knobs import Plan
from brdfcheck.budgets.room import irradiance
from brdfcheck.quadrature.polar import Order
from brdfcheck.quadrature.zonal import zonal_weights
from brdfcheck.scene.lights import AbstractLight, Environment, Polygon
from brdfcheck.scene.materials import Surface
from brdfcheck.scene.shading import shade
from brdfcheck.scene.vectors import Vector, dot, spread

# Of points, normals and views in three fields each, or arrays of the shape (3, ...).
Shader = Callable[[Any, Any, Any], Array]
Lights = tuple[AbstractLight, ...]

# Points that are shaded at once.
BLOCK = 2**14


def split(plan: Plan, lights: Sequence[AbstractLight], room: bool) -> tuple[Lights, Lights]:
    """The lights that are looked up in the plan's grid, as a room is, and those that are computed in each pixel.

    What comes from areas is smooth and dear. Rays are looked up only where there is nothing else: they end at a terminator,
    and have sharp highlights.
    """
    if plan.grid is None:
        return (), tuple(lights)
    areas = tuple(light for light in lights if isinstance(light, Polygon | Environment))
    if not areas and not room:
        return tuple(lights), ()
    return areas, tuple(light for light in lights if not isinstance(light, Polygon | Environment))


def shader_of(plan: Plan, numbers: Mapping[str, Any], moments: Array | None) -> Shader:
    """What a point looks like, in a room whose radiance at the object has these `moments`, if there is one."""
    if plan.grid is None:
        return point_shader(plan, numbers["material"], numbers["lights"], moments)
    coarse, fine = split(plan, numbers["lights"], moments is not None)
    grid = Grid.of(numbers, plan.grid)

    def shader(point: Any, normal: Any, view: Any) -> Array:
        colours = point_shader(plan, numbers["material"], coarse, moments)(*grid.places())
        color = grid.between(colours, Vector(*normal))
        return color + point_shader(plan, numbers["material"], fine, None)(point, normal, view) if fine else color

    return shader


def point_shader(plan: Plan, material: Any, lights: Sequence[AbstractLight], moments: Array | None) -> Shader:
    """The same, of some lights and without a grid."""
    simpler = plan.quadrature is not None or plan.table is not None
    surroundings = [light for light in lights if isinstance(light, Environment) and simpler]
    others = [light for light in lights if not any(light is one for one in surroundings)]

    def shader(point: Any, normal: Any, view: Any) -> Array:
        color = shade(material, others, point, normal, view)
        if surroundings and plan.table is not None:
            color = color + _looked_up(material, surroundings, dot(normal, view), plan.table)
        elif surroundings:
            for light in surroundings:
                color = color + _surrounded(material, light, dot(normal, view), plan.quadrature or 0)
        if moments is not None:
            arriving = irradiance(moments, Vector(*normal)) / np.pi
            matt = sum((term.albedo() for term in material.terms if term.matt), jnp.zeros((), arriving.dtype))
            color = color + spread(matt, arriving.ndim) * arriving
        return color

    return shader


def _looked_up(material: Surface, lights: Sequence[Environment], cosine: Array, entries: int) -> Array:
    """What a surface reflects of uniform surroundings, between its values at `entries` equidistant cosines of the view."""
    mu = jnp.linspace(0, 1, entries, dtype=cosine.dtype)
    zero, one = jnp.zeros_like(mu), jnp.ones_like(mu)
    view = Vector(jnp.sqrt(1 - mu * mu), zero, mu)
    table = kept(shade(material, lights, Vector(zero, zero, zero), Vector(zero, zero, one), view))
    place = jnp.clip(cosine, 0, 1) * (entries - 1)
    below = jnp.minimum(place.astype(jnp.int32), entries - 2)
    share = place - below.astype(place.dtype)
    return table[:, below] * (1 - share) + table[:, below + 1] * share


def _surrounded(material: Surface, light: Environment, cosine: Array, nodes: int) -> Array:
    """What a surface reflects of a uniform surrounding: the albedos of its terms, by a rule in one dimension."""
    total = jnp.zeros((3,) + (1,) * cosine.ndim, cosine.dtype)
    for term in material.terms:
        brdf, core = term.brdf, term.brdf.core
        if isinstance(core, Lambert):
            total = total + spread(light.intensity * term.albedo().astype(cosine.dtype), cosine.ndim)
        elif isinstance(core, AbstractZonalLobe) and isinstance(brdf, AbstractBRDF):
            core = of_type(core, cosine.dtype)

            def albedo(mu: Array, core: AbstractZonalLobe = core) -> Array:
                order = Order(nodes, nodes)
                versines, weights = zonal_weights(core.form, mu, core.breaks(), core.width(), (order,))
                return jnp.sum(weights[0] * core.profile(versines)) * core.amplitude()

            flat = jnp.clip(cosine, 0, 1).reshape(-1)
            value = jax.lax.map(albedo, flat, batch_size=min(BLOCK, flat.size)).reshape(cosine.shape)
            factor = jnp.asarray(brdf.gain(jnp.ones((), cosine.dtype)), cosine.dtype)
            total = total + spread(light.intensity * term.tint, cosine.ndim) * (factor * value)
    return total
