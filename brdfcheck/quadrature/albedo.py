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
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from brdfcheck.brdf.base import AbstractBRDF, AbstractMicrofacetLobe, AbstractZonalLobe, Form
from brdfcheck.brdf.callables import Evaluator, constant
from brdfcheck.brdf.factors import has_engine, peel, refuse_batched
from brdfcheck.quadrature.adaptive import integrate_hemisphere
from brdfcheck.quadrature.boxes import Mesh
from brdfcheck.quadrature.half_vector import HalfVectorOrder, half_vector_albedo
from brdfcheck.quadrature.limit import grazing_limit
from brdfcheck.quadrature.polar import Order
from brdfcheck.quadrature.zonal import weighted_sums, zonal_weights

# Rounding of a weighted sum in units of the machine epsilon: nodes, weights and profile each contribute a few.
ROUNDING = 32
# Incidences integrated together; bounds the memory of large requests.
_BATCH = 256
_BATCH_2D = 1  # one incidence fills the cache; measured three times faster than sixteen at once
# How much larger than the difference of two rules the error of engine 2 may be: measured up to 3.4 for very rough facets.
_CAUTION = 6


class Albedo(eqx.Module):
    """Directional albedo with its error bar.

    `value` has the shape of cos_theta (tables: (n, cos_theta)), with a trailing channel axis for RGB; it is never
    clamped. `error`, same shape, bounds the absolute error. `evaluations` counts evaluations of the BRDF for one
    incidence (engines 1 and 2) or over all of them (engine 3). `engine` names the engine.
    """

    value: Float[Array, "..."]
    error: Float[Array, "..."]
    evaluations: Int[Array, "..."]
    engine: str = eqx.field(static=True)

    def __repr__(self) -> str:
        return f"Albedo(value={self.value}, error={self.error}, evaluations={self.evaluations}, engine={self.engine!r})"


def _digits(rtol: float | None, default: float, dtype: Any) -> float:
    if rtol is not None and (not isinstance(rtol, (int, float, np.floating)) or not 0 < rtol < 1):
        raise ValueError(f"rtol must be a number between 0 and 1; got {rtol!r}")
    digits = -math.log10(default if rtol is None else rtol)
    return min(digits, -math.log10(float(jnp.finfo(dtype).eps)) - 1)


def _zonal_orders(digits: float) -> tuple[Order, Order]:
    # The counts at which the worst lobe of the catalogue (Schlick at n = 1e7, cos^0.05) has that many digits.
    coarse = (math.ceil(4 * digits), math.ceil(14 + 5.5 * digits))
    return Order(coarse[0] + 16, coarse[1] + 16), Order(*coarse)


def _half_vector_orders(digits: float, sharp: bool) -> tuple[HalfVectorOrder, HalfVectorOrder]:
    if sharp:  # V-cavities: six panels, square roots at their ends, up to three smooth pieces in azimuth
        circle, cut, azimuth, grading = 4 * digits, 4.8 * digits, 1.4 * digits, (2, 3)
    else:
        circle, cut, azimuth, grading = 4.8 * digits, 9.6 * digits + 12, 4 * digits, (1, 3)
    fine, coarse = (
        HalfVectorOrder(Order(math.ceil(part * circle), math.ceil(part * cut), grading, (3, 3)), math.ceil(part * azimuth))
        for part in (1.0, 0.86)
    )
    return fine, coarse


def one(core: AbstractBRDF, mu: Array, rtol: float | None) -> tuple[Array, Array, int]:
    """Engine 1 or 2 for a lobe without wrappers and a scalar cosine: (value, error, evaluations)."""
    if isinstance(core, AbstractZonalLobe):
        orders = _zonal_orders(_digits(rtol, 1e-12, mu.dtype))
        versine, weight = zonal_weights(core.form, mu, core.breaks(), core.width(), orders)
        value, error = _weighted(jnp, core.profile(versine), versine, weight)
        amplitude = core.amplitude()
        return value * amplitude, error * jnp.abs(amplitude), versine.size
    assert isinstance(core, AbstractMicrofacetLobe)
    digits = _digits(rtol, 2.5e-10, mu.dtype)
    sharp = getattr(core, "masking", "") == "v-cavities"
    (fine, coarse), count = half_vector_albedo(core, mu, _half_vector_orders(digits, sharp))
    # In two dimensions the difference of two rules may vanish by chance; never claim more than what was aimed at.
    return fine, _bar(jnp, fine, coarse, 10**-digits * jnp.abs(fine), _CAUTION), count


def _weighted(xp: Any, profile: Any, versine: Any, weight: Any) -> tuple[Any, Any]:
    """(albedo, error) from the nodes of two rules, with `xp` numpy or jax.numpy.

    Shapes: (..., nodes) twice, (..., rules, nodes) -> (...) twice.
    """
    epsilon = float(xp.finfo(versine.dtype).eps)
    sums = weighted_sums(xp, profile, weight)
    # Towards 90 degrees the nodes keep absolute, not relative, accuracy in cos: only the unclamped lobe notices.
    rounding = xp.sum(xp.abs(weight[..., 0, :] * profile / xp.maximum(1 - versine, epsilon)), axis=-1)
    return sums[..., 0], _bar(xp, sums[..., 0], sums[..., 1], 4 * epsilon * rounding)


def _bar(xp: Any, fine: Any, coarse: Any, more: Any, caution: float = 1) -> Any:
    """The error bar: `caution` times the difference of two rules and the rounding of the sum, and `more`."""
    error = caution * (xp.abs(fine - coarse) + ROUNDING * float(xp.finfo(fine.dtype).eps) * xp.abs(fine)) + more
    return xp.where(xp.isfinite(error), error, xp.inf)  # overflow: the value is unknown


def batched(function: Callable, arguments: Any, size: int, batch: int) -> Any:
    """`function` over the leading axis of `arguments`, at most `batch` rows at a time."""
    if size <= batch:
        return jax.vmap(function)(arguments)
    return jax.lax.map(function, arguments, batch_size=batch)


def batch_size(core: AbstractBRDF) -> int:
    """Incidences integrated together, which bounds the memory of a large request."""
    return _BATCH if isinstance(core, AbstractZonalLobe) else _BATCH_2D


@eqx.filter_jit
def _shared_lobe(brdf: AbstractBRDF, cos_theta: Array, rtol: float | None) -> tuple[Array, Array, int]:
    """One BRDF, cosines of any shape."""
    core, scale = peel(brdf)
    flat = cos_theta.reshape(-1)
    count = 0

    def cell(mu: Array) -> tuple[Array, Array]:
        nonlocal count
        value, error, count = one(core, mu, rtol)
        factor = scale(mu)
        return value * factor, error * jnp.abs(factor)

    value, error = batched(cell, flat, flat.size, batch_size(core))
    shape = cos_theta.shape + value.shape[1:]
    return value.reshape(shape), error.reshape(shape), count


def paired_lobes(cores: AbstractBRDF, cos_theta: Any, rtol: float | None) -> tuple[np.ndarray, np.ndarray, int]:
    """Lobes with leaves batched over the same axis as the cosines, without their factors: (value, error, evaluations).

    `evaluations` counts those for one incidence. For lobes about an axis the work is split: the largest program, the
    nodes, serves all lobes of a form, so a process that looks at many lobes compiles a fraction of what it would.
    """
    if not isinstance(cores, AbstractZonalLobe):
        value, error, count = _paired_facets(cores, cos_theta, rtol)
        return np.asarray(value), np.asarray(error), count
    breaks, width, amplitude = (np.asarray(part) for part in _extents(cores))
    versine, weight = _nodes(cores.form, cos_theta, breaks, width, rtol)
    profile = np.asarray(_profiles(cores, versine))
    with np.errstate(all="ignore"):
        value, error = _weighted(np, profile, np.asarray(versine), np.asarray(weight))
    if amplitude.ndim > 1:
        value, error = value[:, None], error[:, None]
    return value * amplitude, error * np.abs(amplitude), versine.shape[-1]


@jax.jit
def _extents(cores: AbstractZonalLobe) -> tuple[Array, Array, Array]:
    return jax.vmap(lambda core: (core.breaks(), core.width(), core.amplitude()))(cores)


@functools.partial(jax.jit, static_argnums=(0, 4))
def _nodes(form: Form, cos_theta: Any, breaks: Any, width: Any, rtol: float | None) -> tuple[Array, Array]:
    orders = _zonal_orders(_digits(rtol, 1e-12, cos_theta.dtype))
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
    width = breaks.shape[-1] * sum(order.circle + order.cut for order in _zonal_orders(_digits(None, 1e-12, versine.dtype)))
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
def _paired_facets(cores: AbstractBRDF, cos_theta: Any, rtol: float | None) -> tuple[Array, Array, int]:
    dynamic, static = eqx.partition(cores, eqx.is_array)
    count = 0

    def cell(pair: tuple[Any, Array]) -> tuple[Array, Array]:
        nonlocal count
        leaves, mu = pair
        value, error, count = one(eqx.combine(leaves, static), mu, rtol)
        return value, error

    value, error = batched(cell, (dynamic, cos_theta), cos_theta.size, _BATCH_2D)
    return value, error, count


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
    that JAX can trace, or a numpy function (slower; a log message says so). `azimuth`: incidence azimuth (radians) for
    anisotropic BRDFs; broadcasts with cos_theta. `rtol`: the accuracy aimed at; by default the best of the engine (1e-12
    for lobes about an axis, 2.5e-10 for microfacets, 1e-8 for functions).

    Lobes with batched parameters are evaluated by ``jax.vmap(albedo, (0, None))(lobe, cos_theta)``.
    Raises ValueError for cosines outside [0, 1] or a bad rtol, TypeError for something that cannot be called.
    """
    mu = checked_cosines(cos_theta)
    if has_engine(brdf):
        _digits(rtol, 1e-12, mu.dtype)
        refuse_batched(brdf)
        lobe, mu = _of_one_type(brdf, mu)
        mu = jnp.broadcast_to(mu, jnp.broadcast_shapes(mu.shape, jnp.shape(azimuth)))
        value, error, count = _shared_lobe(lobe, mu, None if rtol is None else float(rtol))
        core = peel(lobe)[0]
        engine = "zonal" if isinstance(core, AbstractZonalLobe) else "half-vector"
        return Albedo(value, error, jnp.asarray(count), engine)
    if not callable(brdf):
        raise TypeError(f"a BRDF must be callable, f(wi, wo); got {type(brdf).__name__}")
    if isinstance(mu, Tracer) or isinstance(azimuth, Tracer):
        raise TypeError("the adaptive engine runs on the host: call albedo outside jit, vmap and grad for a function")
    evaluator = Evaluator(constant(brdf), {})
    return adaptive_albedo(evaluator.bind({}), mu, azimuth, 1e-8 if rtol is None else rtol, slow=evaluator.slow)


def adaptive_albedo(
    evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray],
    cos_theta: object,
    azimuth: object,
    rtol: float,
    *,
    slow: bool = False,
    max_evaluations: int = 4_000_000,
    keep: Callable[[float, Mesh], object] = lambda mu, mesh: None,
) -> Albedo:
    """Engine 3 for a bound `Evaluator`: integrates each incidence by itself. Results are numpy arrays.

    At a cosine of 0 it is the limit, inf where the albedo grows without bound. Where single directions are not finite the
    BRDF is taken beside them; where many are, the albedo is not a number. `keep` gets the rule that each integral ended with.
    """
    cosines, azimuths = np.broadcast_arrays(np.asarray(cos_theta, float), np.asarray(azimuth, float))
    values, errors, count = [], [], 0
    for mu, turn in zip(cosines.ravel(), azimuths.ravel(), strict=True):
        answer = evaluate(_light(0.5, turn), np.array([[0.0, 0.0, 1.0]]))
        # A function that computes in float32 cannot be integrated to 1e-8; trying would only cost evaluations.
        tolerance = max(rtol, ROUNDING * float(jnp.finfo(answer.dtype).eps))

        def at(mu: float, turn: float = float(turn), tolerance: float = tolerance) -> tuple[np.ndarray, np.ndarray]:
            nonlocal count
            wi = _light(mu, turn)
            beside = _Beside(evaluate, wi)
            result = integrate_hemisphere(beside, mu, turn, tolerance=tolerance, max_evaluations=max_evaluations)
            count += result.evaluations
            keep(mu, result.mesh)
            if beside.broken or result.nonfinite:  # the integral is unknown, whatever the rule says about the rest
                return np.full_like(result.value, np.nan), np.full_like(result.error, np.inf)
            return result.value, result.error

        value, error = at(float(mu)) if mu > 0 else grazing_limit(at)
        values.append(value)
        errors.append(error)
    shape = cosines.shape + np.shape(values[0]) if values else cosines.shape
    engine = "adaptive (numpy)" if slow else "adaptive"
    return Albedo(np.reshape(values, shape), np.reshape(errors, shape), np.asarray(count), engine)  # pyright: ignore[reportArgumentType]


def _light(mu: float, azimuth: float) -> np.ndarray:
    sine = math.sqrt((1 - mu) * (1 + mu))
    return np.array([[sine * math.cos(azimuth), sine * math.sin(azimuth), mu]])


class _Beside:
    """f(wi, .) for one wi, taken a little beside the directions where it is not finite, as long as these are few.

    A BRDF that is not finite at single directions (a division by zero at the mirror direction, say) has an albedo all the same.
    Where all directions are concerned it is wi that is special, at normal incidence mostly: then wi is taken beside.
    `broken` is set where that does not help.
    """

    def __init__(self, evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray], wi: np.ndarray):
        self._evaluate, self._wi = evaluate, wi
        self.broken = False

    def __call__(self, wo: np.ndarray) -> np.ndarray:
        values = self._evaluate(np.broadcast_to(self._wi, wo.shape), wo)
        # Weights vanish on the horizon itself: what happens there does not count.
        bad = ~np.isfinite(values if values.ndim == 1 else values.sum(axis=1)) & (wo[:, 2] > 0)
        if not np.any(bad):
            return np.where(np.isfinite(values), values, 0).astype(values.dtype)
        if np.count_nonzero(bad) > len(bad) / 2:
            values = self._evaluate(np.broadcast_to(_nudged(self._wi), wo.shape), wo)
            bad = ~np.isfinite(values if values.ndim == 1 else values.sum(axis=1)) & (wo[:, 2] > 0)
        if np.any(bad) and np.count_nonzero(bad) <= max(16, len(bad) / 50):
            values = values.copy()
            values[bad] = self._evaluate(np.broadcast_to(self._wi, wo.shape)[bad], _nudged(wo[bad]))
            bad = ~np.isfinite(values if values.ndim == 1 else values.sum(axis=1)) & (wo[:, 2] > 0)
        self.broken |= bool(np.any(bad))
        return np.where(np.isfinite(values), values, 0).astype(values.dtype)


def _nudged(directions: np.ndarray) -> np.ndarray:
    """Unit vectors turned by a ten millionth of a radian, up rather than down."""
    moved = directions + np.array([6e-8, 7e-8, 1e-8])
    return moved / np.linalg.norm(moved, axis=-1, keepdims=True)


def _of_one_type(brdf: Any, mu: Array) -> tuple[Any, Array]:
    """Parameters and cosines in the wider of their types, so that a rule runs in one precision throughout."""
    leaves = [leaf.dtype for leaf in jax.tree.leaves(brdf) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    dtype = np.result_type(mu.dtype, *leaves)
    return jax.tree.map(lambda leaf: leaf.astype(dtype), brdf), mu.astype(dtype)
