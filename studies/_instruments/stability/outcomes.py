"""Methods over the grid of a lobe, and what became of each value and derivative."""

from __future__ import annotations

import contextlib
import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from _instruments.stability.references import LOBES, Reference
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.rule import NOT_KNOWN, AbstractRule


class Outcome(enum.IntEnum):
    """What became of one albedo, from good to bad."""

    HOLDS = 0
    LOSES_DIGITS = 1
    LIES = 2
    BREAKS = 3


# Relative errors up to which a result holds: what each precision should give.
HOLDS = {"float64": 1e-8, "float32": 1e-4}
# From this relative error on the result has nothing to do with the albedo.
_BROKEN = 0.5
# The same for derivatives.
GRADIENT_HOLDS = {"float64": 1e-3, "float32": 1e-2}
NOT_ASKED = -1
"""In place of an `Outcome`: a rule without a formula there, or a derivative that no number of the precision can hold."""


@dataclass(frozen=True)
class Result:
    """What a method says over a lobe's grid: values and claimed absolute errors, both (parameter, cos_theta).

    `known`: False where it says that it knows nothing (a closed form that does not exist).
    """

    value: np.ndarray
    claimed: np.ndarray
    known: np.ndarray


Method = Callable[[Any, Any], tuple[Any, Any, Any]]
"""(BRDF, cosines (cos_theta,)) -> (values, claimed errors, known), all (cos_theta,)."""


def production(brdf: Any, cos_theta: Any) -> tuple[Any, Any, Any]:
    """The package's own rule: `brdfcheck.albedo`."""
    answer = albedo(brdf, cos_theta)
    return answer.value, answer.error, jnp.ones(answer.value.shape, bool)


def of_rule(rule: AbstractRule) -> Method:
    """A rule of the registry as a method; rules with chance in them get one and the same key."""

    def method(brdf: Any, cos_theta: Any) -> tuple[Any, Any, Any]:
        answer = rule(brdf, cos_theta, key=jax.random.key(0) if rule.random else None)
        return answer.value, answer.error, answer.status != NOT_KNOWN

    return method


Mode = Literal["jit", "eager", "host"]


def run(method: Method, lobe: str, parameters: np.ndarray, cosines: np.ndarray, dtype: Any, *, mode: Mode = "jit") -> Result:
    """A method over a lobe's grid in one precision.

    `mode`: "jit", one compiled program; "eager", operation by operation; "host", for rules that call programs of their own.
    """
    build = LOBES[lobe]
    mu = jnp.asarray(cosines, dtype)

    def row(parameter: Any, mu: Any) -> tuple[Any, Any, Any]:
        # All numbers of the BRDF in this precision: one wide one would make the whole computation wide.
        return method(jax.tree.map(lambda leaf: leaf.astype(dtype), build(parameter)), mu)

    values = jnp.asarray(parameters, dtype)
    if mode == "jit":
        found = _over_rows(row, values, mu)
    else:
        with jax.disable_jit() if mode == "eager" else contextlib.nullcontext():
            rows = [row(one, mu) for one in values]
        found = (np.stack([np.asarray(part) for part in column]) for column in zip(*rows, strict=True))
    value, claimed, known = found
    return Result(np.asarray(value, float), np.asarray(claimed, float), np.asarray(known))


@eqx.filter_jit
def _over_rows(row: Callable[[Any, Any], tuple[Any, Any, Any]], values: Any, mu: Any) -> tuple[Any, Any, Any]:
    return jax.lax.map(lambda one: row(one, mu), values)


def outcomes(result: Result, reference: Reference, dtype: Any) -> np.ndarray:
    """An `Outcome` for each cell, or `NOT_ASKED`.

    BREAKS: not finite, or wrong by half. LIES: wrong by more than the claimed error and the reference's. LOSES_DIGITS: wrong by
    more than the precision should give. What no float of this precision can hold counts as holding where it is reported as inf
    of unknown error, and what is smaller than all its floats where nothing but a number as small is reported.
    """
    limits = jnp.finfo(dtype)
    exact, slack = reference.albedo, reference.radius
    with np.errstate(all="ignore"):
        error = np.abs(result.value - exact)
        relative = (error - slack) / np.abs(exact)
        claims = np.isfinite(result.claimed)
        found = np.full(exact.shape, Outcome.HOLDS, int)
        found[relative > HOLDS[np.dtype(dtype).name]] = Outcome.LOSES_DIGITS
        found[claims & (error > result.claimed + slack + float(limits.tiny))] = Outcome.LIES
        found[~np.isfinite(result.value) | (relative > _BROKEN)] = Outcome.BREAKS
        overflow = (exact > float(limits.max) / 1e4) & np.isposinf(result.value) & np.isposinf(result.claimed)
        underflow = (np.abs(exact) < float(limits.tiny) * 1e4) & (np.abs(result.value) < float(limits.tiny) * 2e4)
    found[overflow | underflow] = Outcome.HOLDS
    return np.where(result.known, found, NOT_ASKED)


@dataclass(frozen=True)
class Gradients:
    """A derivative over a lobe's grid: of a method by differentiation, the reference's, and E, all (parameter, cos_theta)."""

    automatic: np.ndarray
    exact: np.ndarray
    scale: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Their difference relative to the larger of the exact one and E."""
        with np.errstate(all="ignore"):
            return np.abs(self.automatic - self.exact) / np.maximum(np.abs(self.exact), np.abs(self.scale))


def gradients_of(reference: Reference, method: Method = production, dtype: Any = np.float64) -> dict[str, Gradients]:
    """Both derivatives of a method over the grid of a reference, by what is varied: "n" (or the slope m) and "theta"."""
    build = LOBES[reference.lobe]

    def one(parameter: Any, mu: Any) -> Any:
        return method(jax.tree.map(lambda leaf: leaf.astype(dtype), build(parameter)), mu[None])[0][0]

    grid = _over_grid(
        jax.grad(one, argnums=(0, 1)), jnp.asarray(reference.parameters, dtype), jnp.asarray(reference.cosines, dtype)
    )
    by_parameter, by_cosine = (np.asarray(part, float) for part in grid)
    # Through cosines: in float32 the cosine of 90 degrees would be negative.
    sine = np.sqrt((1 - reference.cosines) * (1 + reference.cosines))
    with np.errstate(all="ignore"):
        automatic = {"n": by_parameter * reference.parameters[:, None], "theta": -sine * by_cosine}
    return {by: Gradients(part, reference.slope(by, dtype), reference.albedo) for by, part in automatic.items()}


@eqx.filter_jit
def _over_grid(gradient: Callable[[Any, Any], tuple[Any, Any]], parameters: Any, cosines: Any) -> tuple[Any, Any]:
    return jax.lax.map(lambda a: jax.vmap(lambda b: gradient(a, b))(cosines), parameters)


def gradient_outcomes(gradients: Gradients, dtype: Any = np.float64) -> np.ndarray:
    """An `Outcome` for each derivative, or `NOT_ASKED` where E or the derivative does not fit into the precision."""
    deviation, limits = gradients.deviation, jnp.finfo(dtype)
    found = np.where(deviation > GRADIENT_HOLDS[np.dtype(dtype).name], Outcome.LOSES_DIGITS, Outcome.HOLDS)
    found = np.where(~np.isfinite(gradients.automatic) | (deviation > _BROKEN), Outcome.BREAKS, found)
    size = np.maximum(np.abs(gradients.exact), np.abs(gradients.scale))
    # Reverse mode carries squares of what it differentiates.
    fits = (size < float(limits.max) ** 0.5) & (np.abs(gradients.scale) > float(limits.tiny) * 1e4)
    return np.where(fits, found, NOT_ASKED)
