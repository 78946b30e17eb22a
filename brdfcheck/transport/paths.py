r"""Monte Carlo paths inside a sphere or a box: the same light, without patches on the way, for any lobe of the catalogue.

A path begins on a patch with a chance in proportion to its emitted power, leaves with the density (N.w)/pi, and at each
meeting with the wall is multiplied by f (N.wo)/p for a direction wo of density p. What it reflects at a patch is counted
there (the collision estimator). Between bounces Russian roulette ends paths with the chance that their weight lacks to 1, so
the mean stays what it is. All randomness comes from the key.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF, core_of, of_type
from brdfcheck.brdf.lobes import BlinnPhong, Lambert, Phong, Schlick
from brdfcheck.geometry import frame_about
from brdfcheck.messages import one_of
from brdfcheck.quadrature.proposals import LobeGeometry, has_axis
from brdfcheck.quadrature.rule import checked_count
from brdfcheck.transport.angular import angular_operator
from brdfcheck.transport.enclosures import Box, Sphere
from brdfcheck.transport.solution import Problem, Radius, Solution, Status, problem, radius_of, standing

Sampling = Literal["lobe", "cosine"]
Equation = Literal["continuous", "patches"]
# Groups of paths whose scatter gives the standard error, and rays that travel together in a group.
_GROUPS, _LANES = 32, 128
# How directions are shared out between the lobe's main proposal, its tail and the cosine. Each share that is not where the
# lobe is multiplies the variance with every bounce.
_SHARES = {"tail": (0.1, 0.8, 0.1), "zonal": (0.8, 0.1, 0.1), "facets": (0.9, 0.0, 0.1)}
# Rounding of a sum over rays, in units of the machine epsilon; and of the few dozen that make a radiosity.
_ROUNDING, _SUMS = 8, 8
# What the angular operator is made of where only a bound is wanted.
_NODES, _AZIMUTHS = 96, 192
# A path that weighs more than so many others.
_HEAVY = 32
_TINY = 1e-18


class Energy(eqx.Module):
    """Mean energy after 0, 1, 2, ... bounces of light that began with 1, and its standard error; (bounces + 1,) each."""

    mean: Float[Array, " bounces"]
    error: Float[Array, " bounces"]


def trace(
    enclosure: Sphere | Box,
    emission: Any,
    reflectance: Any = 1.0,
    *,
    key: Any,
    brdf: AbstractBRDF | None = None,
    paths: int = 2**16,
    sampling: str = "lobe",
    equation: str = "continuous",
    max_bounces: int = 2000,
) -> Solution:
    """The radiosity of each patch by path tracing, with standard errors (at least one emitting patch).

    `emission` (power per area, diffuse) and `reflectance` as for `direct`; the walls' BRDF is `reflectance` times `brdf`
    (Lambert's by default). `paths` is rounded up to a multiple of 4096. `sampling`: "lobe" draws where the lobe is, "cosine"
    never, which for a sharp lobe ends in the status HEAVY. `equation`: "continuous" is the light itself; "patches" draws the
    place on a patch anew at each bounce, which makes it the discrete equation that the other solvers solve (diffuse walls
    only). The spectral radius is that of the form factors for diffuse walls; else it lies below that of the angular operator
    (the largest albedo, if the BRDF is not reciprocal and the enclosure no sphere) times the largest reflectance. Refuses
    where it is 1 or more, and where paths are under way after `max_bounces` reflections each: value NaN, error inf. The
    residual is that of the equation of patches; NaN for walls that are not diffuse, which have none.
    Raises ValueError for bad values, counts and words, no light or no key, TypeError for an enclosure without geometry or a
    BRDF that is neither about an axis nor made of facets.
    """
    _checked(enclosure, key, sampling)
    one_of(equation, get_args(Equation), "equation")
    diffuse = brdf is None or isinstance(brdf, Lambert)
    if equation == "patches" and not diffuse:
        raise ValueError("the equation of patches is for diffuse walls: with other BRDFs light has a direction")
    lanes = _GROUPS * _LANES
    each = -(-checked_count(paths, "paths") // lanes)
    posed = problem(enclosure, emission, reflectance)
    if not float(jnp.sum(posed.emission)) > 0:
        raise ValueError("nothing emits: at least one patch must have an emission above 0")
    wall = _wall(Lambert(1.0) if brdf is None else brdf, posed.areas.dtype)
    most, each = jnp.asarray(checked_count(max_bounces, "max_bounces") * each), jnp.asarray(each)
    # With a diffuse brdf of another reflectance than 1 the walls reflect that times `reflectance`.
    shown = eqx.tree_at(lambda p: p.reflectance, posed, posed.reflectance * wall.reflectance) if diffuse else posed
    radius = radius_of(shown) if diffuse else _bounds(enclosure, posed, wall)
    code = standing(radius, refuses=True)
    if not ((code == Status.SOLVED) | ((code == Status.UNDECIDED) & (not diffuse))):  # nothing is compiled either
        nothing = jnp.full_like(posed.areas, jnp.nan)
        return Solution(
            nothing, jnp.full_like(nothing, jnp.inf), nothing[0], 0 * posed.areas[0], each * lanes, radius, code, "paths"
        )
    walked = _walk(enclosure, posed, wall, key, each, most, sampling, equation, diffuse)
    return _told(shown, radius, code, each, walked, diffuse)


class _Walked(NamedTuple):
    """Reflected weight by group and patch, paths left in each lane, the heaviest weight, bounces of all lanes."""

    tally: Array
    left: Array
    heaviest: Array
    steps: Array


@eqx.filter_jit
def _walk(
    enclosure: Any, posed: Problem, brdf: Any, key: Any, each: Array, most: Array, sampling: str, equation: str, diffuse: bool
) -> _Walked:
    dtype, patches, lanes = posed.areas.dtype, posed.areas.size, _GROUPS * _LANES
    group = jnp.asarray(np.repeat(np.arange(_GROUPS, dtype=np.int32), _LANES))
    power = posed.areas * posed.emission
    ladder = jnp.cumsum(power) / jnp.sum(power)

    def bounce(state: Any) -> Any:
        point, direction, weight, walked = state
        u = jax.random.uniform(jax.random.fold_in(key, walked.steps), (lanes, 12), dtype)
        # A lane whose path has ended begins its next one.
        begun = weight == 0
        source = jnp.minimum(jnp.searchsorted(ladder, u[:, 7], side="right"), patches - 1)
        fresh, upright = enclosure.point(source, u[:, 8:10])
        point = jnp.where(begun[:, None], fresh, point)
        direction = jnp.where(begun[:, None], _to_world(upright, _cosine(u[:, 10:])), direction)
        weight = jnp.where(begun, 1, weight)
        point, normal, patch = enclosure.hit(point, direction)
        if equation == "patches":
            point, normal = enclosure.point(patch, u[:, 4:6])
        if diffuse:
            # (N.w)/pi is the diffuse wall's own density: what is left is the reflectance, wherever the ray comes from.
            leaving, factor = _to_world(normal, _cosine(u[:, :2])), brdf.reflectance
        else:
            leaving, factor = _scatter(brdf, direction, normal, u[:, :4], sampling)
        alive = walked.left > 0
        weight = jnp.where(alive, weight * factor * posed.reflectance[patch], 0)
        tally = walked.tally.at[group * patches + patch].add(weight)
        survives = u[:, 6] < weight
        weight = jnp.where(survives, jnp.maximum(weight, 1), 0)
        left = walked.left - jnp.where(alive & ~survives, 1, 0).astype(walked.left.dtype)
        heaviest = jnp.maximum(walked.heaviest, jnp.max(weight))
        return point, leaving, weight, _Walked(tally, left, heaviest, walked.steps + 1)

    def goes_on(state: Any) -> Array:
        return jnp.any(state[3].left > 0) & (state[3].steps < most)

    nowhere = jnp.zeros((lanes, 3), dtype)
    walked = _Walked(jnp.zeros(_GROUPS * patches, dtype), jnp.full(lanes, each), jnp.asarray(0.0, dtype), jnp.asarray(0))
    return jax.lax.while_loop(goes_on, bounce, (nowhere, nowhere, nowhere[:, 0], walked))[3]


@eqx.filter_jit
def _told(posed: Problem, radius: Radius, code: Any, each: Array, walked: _Walked, diffuse: bool) -> Solution:
    dtype, patches, lanes = posed.areas.dtype, posed.areas.size, _GROUPS * _LANES
    # Each path carries the same power; a group's tally is an estimate of its own.
    share = jnp.sum(posed.areas * posed.emission) / ((each * _LANES).astype(dtype) * posed.areas)
    groups = posed.emission + walked.tally.reshape(_GROUPS, patches) * share
    done = jnp.all(walked.left == 0)
    value = jnp.where(done, jnp.mean(groups, axis=0), jnp.nan)
    error = jnp.where(done, _standard_error(groups), jnp.inf)
    code = jnp.where(done, code, int(Status.STILL_MOVING))
    code = jnp.where(done & (walked.heaviest > _HEAVY), int(Status.HEAVY), code)
    residual = jnp.max(jnp.abs(posed.residual(value))) if diffuse else jnp.asarray(jnp.nan, dtype)
    return Solution(value, error, residual, walked.steps.astype(dtype) * lanes, each * lanes, radius, code, "paths")


def _standard_error(groups: Float[Array, "groups ..."], sums: Any = _SUMS) -> Float[Array, "..."]:
    """By the scatter of the groups, and at least the rounding of so many sums: where nothing is left to chance it is all."""
    rounding = _ROUNDING * sums * float(jnp.finfo(groups.dtype).eps) * jnp.abs(jnp.mean(groups, axis=0))
    return jnp.maximum(jnp.std(groups, axis=0, ddof=1) / _GROUPS**0.5, rounding)


def _bounds(enclosure: Sphere | Box, posed: Problem, brdf: Any) -> Radius:
    """Of the spectral radius with walls that are not diffuse: that of the sphere is the largest for reciprocal BRDFs.

    For others the largest albedo bounds it: no bounce can raise the largest radiance by more.
    """
    operator = angular_operator(brdf, nodes=_NODES, azimuths=_AZIMUTHS)
    found, sphere = operator.spectral_radius(), isinstance(enclosure, Sphere)
    lower = found.lower * jnp.min(posed.reflectance) if sphere else 0 * found.lower
    upper = found.upper if sphere or operator.reciprocal() else jnp.max(operator.albedo() + operator.error)
    return Radius(lower, upper * jnp.max(posed.reflectance), jnp.ones_like(posed.areas), found.iterations)


def energy_after_bounces(
    enclosure: Sphere | Box,
    brdf: AbstractBRDF,
    bounces: int,
    *,
    key: Any,
    paths: int = 2**16,
    sampling: str = "lobe",
    beam: bool = False,
) -> Energy:
    """The energy of light after each of `bounces` in an enclosure whose walls all have the BRDF `brdf`.

    The light begins evenly on the walls, with the density (N.w)/pi, or, as a `beam`, along the normal. `key`: of jax.random;
    `sampling`: as for `trace`. `paths`, how many are followed, is rounded up to a multiple of 4096. After a bounce as many
    rays are drawn from those that there are, in proportion to their weights, so that none outweighs the others however many
    bounces. Errors are one standard error. Raises as `trace` does.
    """
    _checked(enclosure, key, sampling)
    each = -(-checked_count(paths, "paths") // (_GROUPS * _LANES)) * _LANES
    wall = _wall(brdf, enclosure.areas.dtype)
    return _energy(enclosure, wall, key, checked_count(bounces, "bounces"), each, sampling, jnp.asarray(bool(beam)))


@eqx.filter_jit
def _energy(enclosure: Any, brdf: Any, key: Any, bounces: int, each: int, sampling: str, beam: Array) -> Energy:
    dtype = enclosure.areas.dtype
    ladder = jnp.cumsum(enclosure.areas) / jnp.sum(enclosure.areas)

    def group(key: Any) -> Array:
        draws = jax.random.uniform(jax.random.fold_in(key, 0), (each, 5), dtype)
        patch = jnp.minimum(jnp.searchsorted(ladder, draws[:, 0], side="right"), ladder.size - 1)
        point, normal = enclosure.point(patch, draws[:, 1:3])
        direction = jnp.where(beam, normal, _to_world(normal, _cosine(draws[:, 3:])))

        def bounce(state: Any, step: Array) -> tuple[Any, Array]:
            point, direction, energy = state
            point, normal, _ = enclosure.hit(point, direction)
            u = jax.random.uniform(jax.random.fold_in(key, step), (each, 5), dtype)
            direction, weight = _scatter(brdf, direction, normal, u[:, :4], sampling)
            # A comb with one tooth for each ray: the mean number of copies is the weight by the mean weight.
            heap = jnp.cumsum(weight)
            teeth = (jnp.arange(each).astype(dtype) + u[0, 4]) * (heap[-1] / each)
            chosen = jnp.minimum(jnp.searchsorted(heap, teeth, side="right"), each - 1)
            energy = energy * heap[-1] / each
            return (point[chosen], direction[chosen], energy), energy

        _, energies = jax.lax.scan(bounce, (point, direction, jnp.asarray(1.0, dtype)), jnp.arange(1, bounces + 1))
        return energies

    groups = jax.lax.map(group, jax.random.split(key, _GROUPS))
    one = jnp.ones(1, dtype)
    mean, error = jnp.mean(groups, axis=0), _standard_error(groups, 1 + jnp.arange(1, bounces + 1).astype(dtype))
    return Energy(jnp.concatenate([one, mean]), jnp.concatenate([0 * one, error]))


# --- directions ---


def _cosine(u: Float[Array, "rays 2"]) -> Float[Array, "rays 3"]:
    """Directions about +z of density (N.w)/pi."""
    ring, azimuth = jnp.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    return jnp.stack([ring * jnp.cos(azimuth), ring * jnp.sin(azimuth), jnp.sqrt(1 - u[:, 0])], axis=-1)


def _to_world(normal: Array, local: Array) -> Array:
    """From the frame of the normal, at any azimuth."""
    first, second = (jnp.stack(axis, axis=-1) for axis in frame_about(*normal.T))
    return local[:, :1] * first + local[:, 1:2] * second + local[:, 2:] * normal


def _scatter(brdf: Any, direction: Array, normal: Array, u: Array, sampling: str) -> tuple[Array, Array]:
    """Where rays that arrive along `direction` go, in the world, and f (N.wo) / p: (rays, 3), (rays,)."""
    to_light = -direction
    mu = jnp.clip(jnp.sum(to_light * normal, axis=-1), 1e-6, 1)
    across = to_light - mu[:, None] * normal
    length = jnp.linalg.norm(across, axis=-1, keepdims=True)
    fallback = _to_world(normal, jnp.zeros_like(normal).at[:, 0].set(1))
    first = jnp.where(length > 1e-6, across / jnp.where(length > 1e-6, length, 1), fallback)
    wo, weight = jax.vmap(lambda mu, u: _leave(brdf, mu, u, sampling))(mu, u)
    leaving = wo[:, :1] * first + wo[:, 1:2] * jnp.cross(normal, first) + wo[:, 2:] * normal
    # What comes from above leaves above, in spite of rounding.
    below = jnp.sum(leaving * normal, axis=-1) <= 0
    return jnp.where(below[:, None], normal, leaving / jnp.linalg.norm(leaving, axis=-1, keepdims=True)), weight


def _leave(brdf: Any, mu: Array, u: Array, sampling: str) -> tuple[Array, Array]:
    """A direction in the frame where the light is at azimuth 0, and f (N.wo) / p, for one ray."""
    core = brdf.core
    about_normal = _cosine(u[None, 1:3])[0]
    wi = jnp.stack([jnp.sqrt((1 - mu) * (1 + mu)), jnp.zeros_like(mu), mu])
    if sampling == "cosine" or isinstance(core, Lambert):  # a diffuse wall's lobe is the cosine itself
        return about_normal, np.pi * brdf(wi, about_normal)
    lobe = LobeGeometry(core, mu)
    if isinstance(core, (Phong, BlinnPhong)):
        # A power of the cosine is its main proposal, and about the normal where the exponent is so small that it has no lobe.
        cosine = 1 / (1 + lobe.exponent)
        main, tail = 1 - cosine, 0.0
    else:
        main, tail, cosine = _SHARES["facets" if lobe.facets else "tail" if isinstance(core, Schlick) else "zonal"]
    azimuth = 2 * np.pi * u[2]
    versine = jnp.where(u[0] < main, lobe.versine(1 - u[1]), lobe.tail_versine(u[1]))
    wo, useful = lobe.directions(versine, azimuth)
    drawn_about_normal = u[0] >= main + tail
    wo = jnp.where(drawn_about_normal, about_normal, wo)
    useful = (drawn_about_normal | (useful > 0)) & (wo[2] > 0)
    wo = jnp.where(useful, wo, jnp.asarray([0, 0, 1], wo.dtype))
    # The balance heuristic: by the density of all proposals together (Veach 1997).
    versine, jacobian = lobe.angle(wo)
    density = main * lobe.density(versine) + tail * lobe.tail_density(versine)
    density = density / jnp.maximum(jacobian, _TINY) + cosine * wo[2] / np.pi
    return wo, jnp.where(useful & (density > 0), brdf(wi, wo) * wo[2] / jnp.where(density > 0, density, 1), 0)


def _checked(enclosure: Any, key: Any, sampling: str) -> None:
    if not isinstance(enclosure, (Sphere, Box)):
        raise TypeError(f"paths need a sphere or a box, whose walls are known; got {type(enclosure).__name__}")
    if key is None or not jnp.issubdtype(getattr(key, "dtype", np.dtype(float)), jax.dtypes.prng_key) or key.shape:
        raise ValueError(f"key must be one key of jax.random.key; got {key!r}")
    one_of(sampling, get_args(Sampling), "sampling")


def _wall(brdf: Any, dtype: Any) -> Any:
    """The BRDF in the precision of the enclosure. TypeError where its directions cannot be drawn."""
    core = core_of(brdf)
    if not has_axis(core):
        raise TypeError(f"paths need a lobe about an axis or one made of facets; got {type(core).__name__}")
    up = jnp.asarray([0.0, 0.0, 1.0])
    shape = jax.eval_shape(lambda: jnp.asarray(brdf(up, up))).shape
    if shape:
        raise ValueError(f"paths carry one channel; this BRDF has values of the shape {shape}")
    return of_type(brdf, dtype)
