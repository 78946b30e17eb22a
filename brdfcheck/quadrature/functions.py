"""Engine 3: the albedo of anything that can be called, adaptive over the hemisphere; and what an albedo is."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ClassVar, Self, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from brdfcheck.brdf.base import AbstractBRDF
from brdfcheck.brdf.callables import Evaluator, constant
from brdfcheck.numerics import unit_vectors
from brdfcheck.quadrature.adaptive import integrate_hemisphere
from brdfcheck.quadrature.boxes import Mesh
from brdfcheck.quadrature.limit import grazing_limit
from brdfcheck.quadrature.rule import (
    NOT_FINITE,
    NOT_REACHED,
    OK,
    ROUNDING,
    AbstractEngine,
    Raw,
    checked_accuracy,
)

# Directions given to a compiled program at a time: few sizes, so that few programs are compiled.
_SIZES = (1, 1024, 8192, 32768, 131072)


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


@final
class Adaptive(AbstractEngine):
    """Engine 3: adaptive over the hemisphere, for anything that can be called; runs on the host, up to 4 million evaluations.

    `tolerance` is absolute below 1 and relative above, and never finer than 32 roundings of what the BRDF computes in.
    ValueError for a tolerance outside (0, 1).
    """

    tolerance: float = eqx.field(static=True)
    name: ClassVar[str] = "adaptive"
    family: ClassVar[str] = "adaptive"
    ladder: ClassVar[tuple[Any, ...]] = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
    on_host: ClassVar[bool] = True
    best: ClassVar[float] = 1e-8
    effort: ClassVar[int] = 2
    batch: ClassVar[int] = 1
    chunk: ClassVar[int] = 1

    def __init__(self, tolerance: float = 1e-8):
        self.tolerance = checked_accuracy(tolerance, "tolerance")

    @classmethod
    def at(cls, rtol: float | None) -> Self:
        return cls(cls.best if rtol is None else checked_accuracy(rtol))

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any = None) -> Raw:
        tolerance = max(self.tolerance, ROUNDING * float(jnp.finfo(mu.dtype).eps))
        found = adaptive_albedo(host_evaluator(core, mu.dtype), float(mu), 0.0, tolerance)
        value, error = np.asarray(found.value), np.asarray(found.error)
        reached = bool(np.all(error <= tolerance * np.maximum(np.abs(value), 1)))
        status = NOT_FINITE if not np.all(np.isfinite(value)) else OK if reached else NOT_REACHED
        return Raw(value, error, int(found.evaluations), status)


@functools.lru_cache(maxsize=64)
def _program(structure: Any) -> Callable[..., Array]:
    """One compiled program for all BRDFs of one structure: (leaves, wi (3,), wo (k, 3)) -> values."""

    @jax.jit
    def values(leaves: list[Any], wi: Array, wo: Array) -> Array:
        return jax.tree.unflatten(structure, leaves)(jnp.broadcast_to(wi, wo.shape), wo)

    return values


def host_evaluator(core: Any, dtype: Any) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """(wi, wo), of shape (k, 3) both and wi the same in all rows -> f(wi, wo) as numpy, evaluated in `dtype`.

    Lobes share their programs, whatever their parameters.
    """
    leaves, structure = jax.tree.flatten(core)
    if not isinstance(core, AbstractBRDF) or not all(eqx.is_array_like(leaf) for leaf in leaves):
        return Evaluator(constant(core), {}).bind({})
    program = _program(structure)

    def evaluate(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        rows = len(wo)
        size = next((size for size in _SIZES if size >= rows), rows)
        padded = wo.astype(dtype) if size == rows else np.pad(wo, ((0, size - rows), (0, 0)), mode="edge").astype(dtype)
        return np.asarray(program(leaves, wi[0].astype(dtype), padded))[:rows]

    return evaluate


def adaptive_albedo(
    evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray],
    cos_theta: object,
    azimuth: object,
    rtol: float,
    *,
    slow: bool = False,
    max_evaluations: int = 4_000_000,
    keep: Callable[[float, Mesh], object] = lambda mu, mesh: None,
    half: bool = False,
) -> Albedo:
    """Engine 3 for a bound `Evaluator`: integrates each incidence by itself. Results are numpy arrays.

    At a cosine of 0 it is the limit, inf where the albedo grows without bound. Where single directions are not finite the
    BRDF is taken beside them; where many are, the albedo is not a number. `keep` gets the rule that each integral ended with;
    `half` is that of `integrate_hemisphere`.
    """
    cosines, azimuths = np.broadcast_arrays(np.asarray(cos_theta, float), np.asarray(azimuth, float))
    values, errors, count = [], [], 0
    for mu, turn in zip(cosines.ravel(), azimuths.ravel(), strict=True):
        answer = evaluate(unit_vectors(0.5, turn)[None], np.array([[0.0, 0.0, 1.0]]))
        # A function that computes in float32 cannot be integrated to 1e-8; trying would only cost evaluations.
        tolerance = max(rtol, ROUNDING * float(jnp.finfo(answer.dtype).eps))

        def at(mu: float, turn: float = float(turn), tolerance: float = tolerance) -> tuple[np.ndarray, np.ndarray]:
            nonlocal count
            beside = _Beside(evaluate, unit_vectors(mu, turn)[None])
            result = integrate_hemisphere(beside, mu, turn, tolerance=tolerance, max_evaluations=max_evaluations, half=half)
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
        if np.all(np.isfinite(values)):
            return values
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
