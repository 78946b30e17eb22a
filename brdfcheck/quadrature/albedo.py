r"""The directional albedo $E(w_i) = \int f(w_i, w_o)(N \cdot w_o)\, dw_o$: where a BRDF and a quadrature rule meet.

One door, three engines, chosen by what the BRDF offers:

1. a lobe about one axis: exact azimuth, one-dimensional (`quadrature.zonal`);
2. a microfacet lobe: two-dimensional over the half vector (`quadrature.half_vector`);
3. anything else that can be called: adaptive over the hemisphere (`quadrature.adaptive`).

Engines 1 and 2 are pure JAX: they may be jitted, batched with `jax.vmap` and differentiated. Every result carries an
error bar: the difference between two rules of different order plus a bound on the rounding.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF, AbstractZonalLobe, Form
from brdfcheck.brdf.callables import Evaluator, constant
from brdfcheck.brdf.factors import has_engine, refuse_batched
from brdfcheck.quadrature.functions import Albedo, adaptive_albedo
from brdfcheck.quadrature.registry import engine_of
from brdfcheck.quadrature.zonal import Zonal, weighted, zonal_weights


def batched(function: Callable, arguments: Any, size: int, batch: int) -> Any:
    """`function` over the leading axis of `arguments`, at most `batch` rows at a time."""
    if size <= batch:
        return jax.vmap(function)(arguments)
    return jax.lax.map(function, arguments, batch_size=batch)


@eqx.filter_jit
def _shared_lobe(brdf: AbstractBRDF, cos_theta: Array, rtol: float | None) -> tuple[Array, Array, int]:
    """One BRDF, cosines of any shape."""
    engine = engine_of(brdf).at(rtol)
    flat = cos_theta.reshape(-1)
    count = 0

    def cell(mu: Array) -> tuple[Array, Array]:
        nonlocal count
        found = engine.integrate(brdf.core, mu)
        count, factor = found.evaluations, brdf.gain(mu)
        return found.value * factor, found.error * jnp.abs(factor)

    value, error = batched(cell, flat, flat.size, engine.batch)
    shape = cos_theta.shape + value.shape[1:]
    return value.reshape(shape), error.reshape(shape), count


def paired_lobes(
    cores: AbstractBRDF, cos_theta: np.ndarray, rtol: float | None, count: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Lobes with leaves batched over the same axis as the cosines, without their factors: (value, error, evaluations).

    Of the rows, which are as many each time, the first `count` are wanted; the rest may be anything.
    `evaluations` counts those for one incidence. For lobes about an axis the work is split: the largest program, the
    nodes, serves all lobes of a form, so a process that looks at many lobes compiles a fraction of what it would.
    """
    if not isinstance(cores, AbstractZonalLobe):
        value, error, evaluations = _paired_facets(cores, cos_theta, rtol, np.asarray(count))
        return np.asarray(value), np.asarray(error), evaluations
    breaks, width, amplitude = (np.asarray(part) for part in _extents(cores))
    versine, weight = _nodes(cores.form, cos_theta, breaks, width, rtol)
    profile = np.asarray(_profiles(cores, versine))
    with np.errstate(all="ignore"):
        value, error = weighted(np, profile, np.asarray(versine), np.asarray(weight))
    if amplitude.ndim > 1:
        value, error = value[:, None], error[:, None]
    return value * amplitude, error * np.abs(amplitude), versine.shape[-1]


@jax.jit
def _extents(cores: AbstractZonalLobe) -> tuple[Array, Array, Array]:
    return jax.vmap(lambda core: (core.breaks(), core.width(), core.amplitude()))(cores)


@functools.partial(jax.jit, static_argnums=(0, 4))
def _nodes(form: Form, cos_theta: Any, breaks: Any, width: Any, rtol: float | None) -> tuple[Array, Array]:
    orders = Zonal.at(rtol).orders(cos_theta.dtype)
    return jax.vmap(lambda mu, breaks, width: zonal_weights(form, mu, breaks, width, orders))(cos_theta, breaks, width)


@jax.jit
def _profiles(cores: AbstractZonalLobe, versine: Array) -> Array:
    return jax.vmap(lambda core, versine: core.profile(versine))(cores, versine)


def lobe_values(cores: AbstractZonalLobe, versine: np.ndarray, batch: int) -> np.ndarray:
    """Values of a few lobes (batched leaves) at versines (k,): shape (lobes, k), or (lobes, k, channels).

    Goes through the programs that `paired_lobes` compiles for `batch` cosines, so that looking at values costs nothing
    more: the versines are folded into the shape of the nodes.
    """
    count = len(jax.tree.leaves(cores)[0])
    cells = jax.tree.map(lambda leaf: np.asarray(leaf)[np.minimum(np.arange(batch), count - 1)], cores)
    breaks, _, amplitude = (np.asarray(part) for part in _extents(cells))
    width = breaks.shape[-1] * sum(order.circle + order.cut for order in Zonal.at(None).orders(versine.dtype))
    blocks = -(-len(versine) // width)
    folded = np.pad(versine, (0, blocks * width - len(versine))).reshape(blocks, width)
    rows = []
    for start in range(0, count * blocks, batch):
        cell = np.minimum(np.arange(start, start + batch), count * blocks - 1)
        part = jax.tree.map(lambda leaf, cell=cell: np.asarray(leaf)[cell // blocks], cores)
        rows.append(np.asarray(_profiles(part, folded[cell % blocks])))
    profile = np.concatenate(rows)[: count * blocks].reshape(count, -1)[:, : len(versine)]
    amplitude = amplitude[:count]
    return profile[..., None] * amplitude[:, None, :] if amplitude.ndim > 1 else profile * amplitude[:, None]


@eqx.filter_jit
def _paired_facets(cores: AbstractBRDF, cos_theta: Any, rtol: float | None, count: Any) -> tuple[Array, Array, int]:
    """One row after the other, up to `count`: a small request costs what it asks for, and all share a program."""
    dynamic, static = eqx.partition(cores, eqx.is_array)
    engine = engine_of(cores).at(rtol)
    evaluations = 0

    def cell(index: Any) -> tuple[Array, Array]:
        nonlocal evaluations
        leaves, mu = jax.tree.map(lambda part: part[index], (dynamic, cos_theta))
        found = engine.integrate(eqx.combine(leaves, static), mu)
        evaluations = found.evaluations
        return found.value, found.error

    def step(index: Any, found: tuple[Array, Array]) -> tuple[Array, Array]:
        return jax.tree.map(lambda rows, row: rows.at[index].set(row), found, cell(index))

    one = jax.eval_shape(cell, 0)
    empty = jax.tree.map(lambda part: jnp.zeros((cos_theta.size, *part.shape), part.dtype), one)
    value, error = jax.lax.fori_loop(0, count, step, empty)
    return value, error, evaluations


def checked_cosines(cos_theta: Any) -> Array:
    """`cos_theta` as a floating-point array; ValueError where a value is not in [0, 1]. Traced values pass."""
    if isinstance(cos_theta, Tracer):
        return cos_theta
    values = np.asarray(cos_theta)
    if not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        raise ValueError(f"cos_theta must be real numbers in [0, 1]; got {cos_theta!r}")
    if not np.all((values >= 0) & (values <= 1)):  # also refuses NaN
        wrong = values[~((values >= 0) & (values <= 1))].flat[0]
        raise ValueError(f"cos_theta must lie in [0, 1]; got {wrong:g}")
    array = jnp.asarray(cos_theta)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def albedo(
    brdf: Callable[..., Any],
    cos_theta: Float[Array, "..."] | float,
    *,
    azimuth: Float[Array, "..."] | float = 0.0,
    rtol: float | None = None,
) -> Albedo:
    """The directional albedo of a BRDF at the cosines of incidence `cos_theta`, any shape, in [0, 1]; 0 is the limit.

    `brdf`: a lobe of this package, or any function ``f(wi, wo)`` on unit vectors (..., 3) with N = +z, in 1/sr: one
    that JAX can trace, or a numpy function (slower; a log message says so); of a BSDF lit from above it is R + T, and that of
    ``bsdf.lit(below=1, part="transmitted")`` the T of light from below. `azimuth`: incidence azimuth (radians) for
    anisotropic BRDFs; broadcasts with cos_theta. `rtol`: the accuracy aimed at; by default the best of the engine (1e-12
    for lobes about an axis, 2.5e-10 for microfacets, 1e-8 for functions).

    Lobes with batched parameters are evaluated by ``jax.vmap(albedo, (0, None))(lobe, cos_theta)``.
    Raises ValueError for cosines outside [0, 1] or a bad rtol, TypeError for something that cannot be called.
    """
    mu = checked_cosines(cos_theta)
    if isinstance(brdf, AbstractBSDF):
        brdf = brdf.lit()
    if has_engine(brdf):
        engine = engine_of(brdf).at(rtol)
        refuse_batched(brdf)
        lobe, mu = _of_one_type(brdf, mu)
        mu = jnp.broadcast_to(mu, jnp.broadcast_shapes(mu.shape, jnp.shape(azimuth)))
        value, error, count = _shared_lobe(lobe, mu, None if rtol is None else float(rtol))
        return Albedo(value, error, jnp.asarray(count), engine.name)
    if not callable(brdf):
        raise TypeError(f"a BRDF must be callable, f(wi, wo); got {type(brdf).__name__}")
    if isinstance(mu, Tracer) or isinstance(azimuth, Tracer):
        raise TypeError("the adaptive engine runs on the host: call albedo outside jit, vmap and grad for a function")
    evaluator = Evaluator(constant(brdf), {})
    return adaptive_albedo(evaluator.bind({}), mu, azimuth, 1e-8 if rtol is None else rtol, slow=evaluator.slow)


def _of_one_type(brdf: Any, mu: Array) -> tuple[Any, Array]:
    """Parameters and cosines in the wider of their types, so that a rule runs in one precision throughout."""
    leaves = [leaf.dtype for leaf in jax.tree.leaves(brdf) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    dtype = np.result_type(mu.dtype, *leaves)
    return jax.tree.map(lambda leaf: leaf.astype(dtype), brdf), mu.astype(dtype)
