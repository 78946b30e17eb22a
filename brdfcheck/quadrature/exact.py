"""The rules of this package as rules like any other: exact azimuth, half vector, adaptive."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF, AbstractMicrofacetLobe, AbstractZonalLobe
from brdfcheck.brdf.callables import Evaluator, constant
from brdfcheck.quadrature.adaptive import integrate_hemisphere
from brdfcheck.quadrature.half_vector import HalfVectorOrder, half_vector_albedo
from brdfcheck.quadrature.polar import Order
from brdfcheck.quadrature.rule import NOT_FINITE, NOT_REACHED, OK, AbstractRule, Raw, bar, checked_count, checked_tolerance
from brdfcheck.quadrature.zonal import weighted_sums, zonal_weights

# The second rule, from which the difference is the error, has this part of the nodes.
_COARSE = 0.5
# Directions given to a compiled program at a time: few sizes, so that few programs are compiled.
_SIZES = (1, 1024, 8192, 32768, 131072)


def _zonal_order(order: int) -> Order:
    # Past the horizon kink more nodes are needed than inside the full circles.
    return Order(order, math.ceil(1.4 * order) + 2)


@final
class Zonal(AbstractRule):
    """The exact-azimuth rule for lobes about an axis: `order` nodes inside the full circles, 1.4 order past the horizon.

    The error is the difference from a rule of half the order, and rounding. ValueError for an order below 4.
    """

    order: int = eqx.field(static=True)
    name: ClassVar[str] = "zonal"
    family: ClassVar[str] = "zonal"
    ladder: ClassVar[tuple[Any, ...]] = (4, 8, 12, 16, 24, 32, 48, 64, 96)
    needs: ClassVar[str] = "a lobe about an axis"
    random: ClassVar[bool] = False
    on_host: ClassVar[bool] = False

    def __init__(self, order: int = 64):
        self.order = checked_count(order, "order", 4)

    def applies(self, core: Any, cos_theta: Any) -> bool:
        return isinstance(core, AbstractZonalLobe)

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        orders = _zonal_order(self.order), _zonal_order(math.ceil(_COARSE * self.order))
        versine, weight = zonal_weights(core.form, mu, core.breaks(), core.width(), orders)
        profile = core.profile(versine)
        fine, coarse = weighted_sums(jnp, profile, weight)
        epsilon = float(jnp.finfo(mu.dtype).eps)
        # Towards 90 degrees the nodes keep absolute, not relative, accuracy in the cosine.
        rounding = 4 * epsilon * jnp.sum(jnp.abs(weight[0] * profile / jnp.maximum(1 - versine, epsilon)))
        amplitude = core.amplitude()
        return Raw(fine * amplitude, (bar(fine, coarse, epsilon) + rounding) * jnp.abs(amplitude), versine.size)


@final
class HalfVector(AbstractRule):
    """The half-vector rule for microfacet lobes: `order` polar nodes inside the full circles of H, more past the horizon.

    The error is the difference from a rule of half the order, and rounding. ValueError for an order below 4.
    """

    order: int = eqx.field(static=True)
    name: ClassVar[str] = "half-vector"
    family: ClassVar[str] = "half-vector"
    ladder: ClassVar[tuple[Any, ...]] = (4, 8, 12, 16, 24, 32, 48, 64)
    needs: ClassVar[str] = "a microfacet lobe"
    random: ClassVar[bool] = False
    on_host: ClassVar[bool] = False

    def __init__(self, order: int = 48):
        self.order = checked_count(order, "order", 4)

    def applies(self, core: Any, cos_theta: Any) -> bool:
        return isinstance(core, AbstractMicrofacetLobe)

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        # Where the azimuth is cut at kinks, its pieces are short.
        cut = core.azimuth_breaks(jnp.ones(1, mu.dtype), mu).shape[0] > 0
        orders = _half_vector_order(self.order, cut), _half_vector_order(math.ceil(_COARSE * self.order), cut)
        (fine, coarse), count = half_vector_albedo(core, mu, orders)
        return Raw(fine, bar(fine, coarse, float(jnp.finfo(mu.dtype).eps)), count)


def _half_vector_order(order: int, cut: bool) -> HalfVectorOrder:
    if cut:
        return HalfVectorOrder(Order(order, math.ceil(1.2 * order), (2, 3), (3, 3)), math.ceil(0.35 * order))
    return HalfVectorOrder(Order(order, math.ceil(1.5 * order) + 2, (1, 3), (3, 3)), math.ceil(0.85 * order))


@functools.lru_cache(maxsize=64)
def _program(structure: Any) -> Callable[..., Array]:
    """One compiled program for all BRDFs of one structure: (leaves, wi (3,), wo (k, 3)) -> values."""

    @jax.jit
    def values(leaves: list[Any], wi: Array, wo: Array) -> Array:
        return jax.tree.unflatten(structure, leaves)(jnp.broadcast_to(wi, wo.shape), wo)

    return values


@final
class Adaptive(AbstractRule):
    """The adaptive rule for anything that can be called; runs on the host, up to 4 million evaluations.

    `tolerance` is absolute below 1 and relative above, and never finer than 32 roundings of what the BRDF computes in.
    ValueError for a tolerance outside (0, 1).
    """

    tolerance: float = eqx.field(static=True)
    name: ClassVar[str] = "adaptive"
    family: ClassVar[str] = "adaptive"
    ladder: ClassVar[tuple[Any, ...]] = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
    needs: ClassVar[str] = "a function f(wi, wo)"
    random: ClassVar[bool] = False
    on_host: ClassVar[bool] = True

    def __init__(self, tolerance: float = 1e-8):
        self.tolerance = checked_tolerance(tolerance)

    def applies(self, core: Any, cos_theta: Any) -> bool:
        return True

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        cosine = float(mu)
        wi = np.array([math.sqrt((1 - cosine) * (1 + cosine)), 0.0, cosine])
        evaluate = host_evaluator(core, wi, mu.dtype)
        result = integrate_hemisphere(
            evaluate, cosine, tolerance=max(self.tolerance, 32 * float(jnp.finfo(mu.dtype).eps)), max_evaluations=4_000_000
        )
        status = NOT_FINITE if result.nonfinite else OK if result.converged else NOT_REACHED
        error = result.error if not result.nonfinite else np.full_like(result.error, np.inf)
        return Raw(result.value, error, result.evaluations, status)


def host_evaluator(core: Any, wi: np.ndarray, dtype: Any) -> Callable[[np.ndarray], np.ndarray]:
    """wo (k, 3) -> f(wi, wo) as numpy, evaluated in `dtype`. Lobes share their programs, whatever their parameters."""
    leaves, structure = jax.tree.flatten(core)
    if not isinstance(core, AbstractBRDF) or not all(eqx.is_array_like(leaf) for leaf in leaves):
        bound = Evaluator(constant(core), {}).bind({})
        return lambda wo: bound(np.broadcast_to(wi, wo.shape), wo)
    program, light = _program(structure), wi.astype(dtype)

    def evaluate(wo: np.ndarray) -> np.ndarray:
        rows = len(wo)
        size = next((size for size in _SIZES if size >= rows), rows)
        padded = wo.astype(dtype) if size == rows else np.pad(wo, ((0, size - rows), (0, 0)), mode="edge").astype(dtype)
        return np.asarray(program(leaves, light, padded))[:rows]

    return evaluate
