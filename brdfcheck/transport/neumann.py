r"""The Neumann series $B = \sum_m K^m E$, bounce by bounce, with a bound on what is left out; refused where it has no limit."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from brdfcheck.transport.enclosures import AbstractEnclosure
from brdfcheck.transport.radiosity import checked_steps, checked_tolerance, finished, refused
from brdfcheck.transport.solution import Problem, Radius, Solution, Status, problem, radius_of, standing


def neumann_series(
    enclosure: AbstractEnclosure,
    emission: Any,
    reflectance: Any,
    *,
    terms: int | None = None,
    tolerance: float = 1e-10,
    max_terms: int = 100_000,
) -> Solution:
    r"""The sum over bounces: the emission and the light after 1, 2, ... reflections.

    `terms`: how many of them, the emission included; by default as many as make the bound on the rest fall below `tolerance`
    times the largest radiosity. Where the spectral radius, measured by power iteration, is 1 or more, no sum is reported: the
    value is NaN, the error inf, and the message gives the reason. The error is $\theta/(1-\theta)$ times the last term, in the
    norm in which K shrinks by $\theta$, which for one reflectance rho is never above `truncation_bound`.
    ValueError for bad emissions and reflectances, counts below 1, or a tolerance outside (0, 1).
    """
    most = checked_steps(max_terms, "max_terms") if terms is None else checked_steps(terms, "terms")
    aim = checked_tolerance(tolerance) if terms is None else 0.0
    return _neumann(problem(enclosure, emission, reflectance), jnp.asarray(aim), jnp.asarray(most))


def truncation_bound(reflectance: float, terms: int, emission: float = 1.0) -> float:
    r"""$\rho^M/(1-\rho) \max E$: what M terms of the series leave out at most, for one reflectance below 1.

    ValueError for a reflectance outside [0, 1), where there is no bound, or terms below 1.
    """
    if not 0 <= reflectance < 1:
        raise ValueError(f"reflectance must lie in [0, 1) for the series to have a bound; got {reflectance!r}")
    return reflectance ** checked_steps(terms, "terms") / (1 - reflectance) * emission


@jax.jit
def _neumann(problem: Problem, tolerance: Array, max_terms: Array) -> Solution:
    radius = radius_of(problem)
    code = standing(radius, refuses=True)
    dtype = problem.areas.dtype
    tolerance = tolerance.astype(dtype)
    shrinking = _shrinking(problem, radius)

    def rest(term: Array) -> Array:
        norm, theta = jnp.max(term / shrinking[0]), shrinking[1]
        return jnp.where(theta < 1, norm * theta / jnp.where(theta < 1, 1 - theta, 1), jnp.inf)

    def bounce(state: Any) -> Any:
        value, term, _, count = state
        term = problem.apply(term)
        value = value + term
        return value, term, rest(term) <= tolerance * jnp.max(value), count + 1

    def goes_on(state: Any) -> Array:
        return ~state[2] & (state[3] < max_terms) & (code == Status.SOLVED)

    enough = rest(problem.emission) <= tolerance * jnp.max(problem.emission)
    value, _, enough, count = jax.lax.while_loop(goes_on, bounce, (problem.emission, problem.emission, enough, jnp.asarray(1)))
    cost = (count - 1).astype(dtype) * problem.areas.size**2
    # A number of terms that was asked for is always reached.
    return finished(problem, radius, refused(value, code), code, enough | (tolerance == 0), cost, count, "neumann")


def _shrinking(problem: Problem, radius: Radius) -> tuple[Array, Array]:
    """A positive vector w of largest entry 1 and the largest theta of K w <= theta w."""
    w = radius.vector / jnp.maximum(jnp.max(radius.vector), 1e-6) + 1e-3
    w = w / jnp.max(w)
    return w, jnp.max(problem.apply(w) / w)
