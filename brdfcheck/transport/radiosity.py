r"""Radiosity: B = E + rho F B solved directly, by conjugate gradients, by shooting, and bounce by bounce.

Linear algebra is lineax's. Conjugate gradients take the symmetric form: with G the exchange areas and D = sqrt(rho/A) the
reflected part is D y, (1 - D G D) y = D G E, positive definite exactly when the spectral radius is below 1.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import lineax
from jaxtyping import Array

from brdfcheck.quadrature.rule import checked_accuracy, checked_count
from brdfcheck.transport.enclosures import AbstractEnclosure
from brdfcheck.transport.solution import Problem, Solution, Status, bounded, judged, problem, radius_of, shrinking, standing

_STABILISE = 10
_MOST_SHOTS = 3000  # times the number of patches


def direct(enclosure: AbstractEnclosure, emission: Any, reflectance: Any) -> Solution:
    """The radiosity of the patches of `enclosure` by LU factorisation (lineax.LU).

    `emission` (power per area) and `reflectance`: a number, or one for each patch. At a spectral radius of 1 or more it still
    returns the number that solves the linear system, with the status MEANINGLESS and the error inf.
    ValueError for values that are negative or not finite, or of another shape.
    """
    return solve_directly(problem(enclosure, emission, reflectance))


@jax.jit
def solve_directly(problem: Problem) -> Solution:
    """`direct` for a checked problem: the compiled program."""
    radius = radius_of(problem)
    count = problem.areas.size
    matrix = jnp.eye(count, dtype=problem.areas.dtype) - problem.reflectance[:, None] * problem.form_factors
    solved = lineax.linear_solve(lineax.MatrixLinearOperator(matrix), problem.emission, lineax.LU(), throw=False)
    cost = jnp.asarray(count**3 / 3, problem.areas.dtype)
    return finished(problem, radius, solved.value, standing(radius, refuses=False), True, cost, jnp.asarray(1), "direct")


def krylov(
    enclosure: AbstractEnclosure, emission: Any, reflectance: Any, *, tolerance: float = 1e-10, max_steps: int = 1000
) -> Solution:
    """The radiosity by conjugate gradients on the symmetric form (lineax.CG), to a relative `tolerance` of its residual.

    `enclosure`, `emission`, `reflectance`, errors and what happens at a spectral radius of 1 or more as for `direct`; also
    ValueError for a tolerance outside (0, 1) or `max_steps` below 1. float32 reaches about 1e-6.
    """
    steps = jnp.asarray(checked_count(max_steps, "max_steps"))
    return _krylov(problem(enclosure, emission, reflectance), jnp.asarray(checked_accuracy(tolerance, "tolerance")), steps)


@jax.jit
def _krylov(problem: Problem, tolerance: Array, max_steps: Any) -> Solution:
    radius = radius_of(problem)
    dtype, reflectance, areas = problem.areas.dtype, problem.reflectance, problem.areas
    out, back = jnp.sqrt(reflectance / areas), jnp.sqrt(reflectance * areas)

    def apply(y: Array) -> Array:
        return y - back * (problem.form_factors @ (out * y))

    operator = lineax.FunctionLinearOperator(
        apply, jax.eval_shape(lambda: areas), tags=frozenset({lineax.positive_semidefinite_tag})
    )
    gathered = back * (problem.form_factors @ problem.emission)
    relative: Any = tolerance.astype(dtype)
    # Against the largest entry: an entry that is 0 has no relative accuracy.
    solver = lineax.CG(
        rtol=relative, atol=relative * jnp.max(jnp.abs(gathered)), stabilise_every=_STABILISE, max_steps=max_steps
    )
    solved = lineax.linear_solve(operator, gathered, solver, throw=False)
    steps = jnp.asarray(solved.stats["num_steps"])
    reached = solved.result == lineax.RESULTS.successful
    cost = (steps + steps // _STABILISE + 2).astype(dtype) * areas.size**2
    value = problem.emission + out * solved.value
    return finished(problem, radius, value, standing(radius, refuses=False), reached, cost, steps, "krylov")


def progressive(
    enclosure: AbstractEnclosure,
    emission: Any,
    reflectance: Any,
    *,
    tolerance: float = 1e-8,
    max_steps: int | None = None,
) -> Solution:
    """The radiosity by progressive refinement: the patch with the most unshot power shoots it, again and again.

    Ends when the unshot power is below `tolerance` times the emitted, or after `max_steps` shots (3,000 for each patch by
    default) (Cohen, Chen, Wallace & Greenberg 1988). Refuses at a spectral radius of 1 or more: value NaN, status DIVERGES.
    `enclosure`, `emission` and `reflectance` as for `direct`, ValueError as for `krylov`.
    """
    posed = problem(enclosure, emission, reflectance)
    steps = _MOST_SHOTS * posed.areas.size if max_steps is None else checked_count(max_steps, "max_steps")
    return _progressive(posed, jnp.asarray(checked_accuracy(tolerance, "tolerance")), jnp.asarray(steps))


@jax.jit
def _progressive(problem: Problem, tolerance: Array, max_steps: Array) -> Solution:
    radius = radius_of(problem)
    code = standing(radius, refuses=True)
    areas, dtype = problem.areas, problem.areas.dtype
    enough = tolerance.astype(dtype) * jnp.sum(areas * problem.emission)

    def shoot(state: Any) -> Any:
        value, unshot, _, count = state
        chosen = jnp.argmax(areas * unshot)
        # By reciprocity what j gets of it is F_kj A_k / A_j: the row of the shooting patch, not a column.
        received = problem.reflectance * problem.form_factors[chosen] * (areas[chosen] / areas) * unshot[chosen]
        unshot = unshot.at[chosen].set(0) + received
        return value + received, unshot, jnp.sum(areas * unshot), count + 1

    def goes_on(state: Any) -> Array:
        return (state[2] > enough) & (state[3] < max_steps) & (code == Status.SOLVED)

    start = (problem.emission, problem.emission, jnp.sum(areas * problem.emission), jnp.asarray(0))
    value, _, left, count = jax.lax.while_loop(goes_on, shoot, start)
    cost = count.astype(dtype) * areas.size
    return finished(problem, radius, refused(value, code), code, left <= enough, cost, count, "progressive")


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
    norm in which K shrinks by $\theta$; for one reflectance rho never above $\rho^M/(1-\rho)$ times the largest emission.
    `enclosure`, `emission` and `reflectance` as for `direct`. ValueError for bad ones, for `terms` or `max_terms` below 1, and
    for a tolerance outside (0, 1).
    """
    most = checked_count(max_terms, "max_terms") if terms is None else checked_count(terms, "terms")
    aim = checked_accuracy(tolerance, "tolerance") if terms is None else 0.0
    return _neumann(problem(enclosure, emission, reflectance), jnp.asarray(aim), jnp.asarray(most))


@jax.jit
def _neumann(problem: Problem, tolerance: Array, max_terms: Array) -> Solution:
    radius = radius_of(problem)
    code = standing(radius, refuses=True)
    dtype = problem.areas.dtype
    tolerance = tolerance.astype(dtype)
    w, theta = shrinking(problem, radius)

    def rest(term: Array) -> Array:
        return jnp.where(theta < 1, jnp.max(term / w) * theta / jnp.where(theta < 1, 1 - theta, 1), jnp.inf)

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


# --- what the solvers share ---


def finished(
    problem: Problem, radius: Any, value: Array, code: Array, reached: Any, cost: Array, steps: Array, method: str
) -> Solution:
    """The solution of a solver that ended with `value`: with its error bound, its residual and what is to be said of it."""
    error, residual = bounded(problem, radius, value)
    return Solution(value, error, residual, cost, steps, radius, judged(code, value, reached), method)


def refused(value: Array, code: Array) -> Array:
    """The value, or NaN where the status says that there is none."""
    return jnp.where(code == Status.SOLVED, value, jnp.nan)
