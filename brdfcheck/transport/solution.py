r"""What every solver of B = E + K B returns, and the spectral radius that decides whether the sum over bounces exists.

On a closed enclosure of diffuse patches $K_{kj} = \rho_k F_{kj}$: B is the radiosity (what leaves a patch, per area), E the
emitted one, in one unit of power per area. The light's own answer is $B = \sum_m K^m E$, which exists exactly when the
spectral radius of K is below 1; $(1 - K)^{-1} E$ is a number also when it is not.
"""

from __future__ import annotations

import enum
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from brdfcheck.transport.enclosures import AbstractEnclosure

_ITERATIONS = 1000
# Relative distance of the bounds of a spectral radius at which the iteration stops.
_ENOUGH = 1e-12
# The vector of the power iteration is kept off 0, that of the error bounds further off, where it divides.
_FLOOR = 1e-6
_MIXED = 1e-3
# Rounding of a sum over patches in units of the machine epsilon.
_ROUNDING = 16


class Status(enum.IntEnum):
    """What became of a solve; the text says what to try."""

    SOLVED = 0
    NOT_REACHED = 1
    DIVERGES = 2
    MEANINGLESS = 3
    UNDECIDED = 4
    NOT_FINITE = 5
    STILL_MOVING = 6
    HEAVY = 7


_TEXTS = {
    Status.SOLVED: "solved",
    Status.NOT_REACHED: "the tolerance was not reached: allow more steps, loosen the tolerance, or solve directly",
    Status.DIVERGES: "no sum is reported: each bounce returns at least as much light as it got, so the sum over bounces has"
    " no limit; find the wall whose albedo exceeds 1 (brdfcheck check) and give it a validated factor",
    Status.MEANINGLESS: "the linear system has a solution, the light has none: the sum over bounces has no limit, and this"
    " finite answer means nothing; find the wall whose albedo exceeds 1 (brdfcheck check)",
    Status.UNDECIDED: "the bounds of the spectral radius contain 1, so it is not known whether the sum over bounces has a"
    " limit; lower the reflectance, or use float64",
    Status.NOT_FINITE: "the result is not finite, so it means nothing: look for an albedo at or above 1 (brdfcheck check)",
    Status.STILL_MOVING: "no mean is reported: paths were still under way when the bounces ran out; allow more bounces, or look"
    " for an albedo at or above 1 (brdfcheck check)",
    Status.HEAVY: "single paths weigh more than 32 others, so the standard error is not to be trusted: sample by lobe, or lower"
    " the reflectance",
}


class Radius(eqx.Module):
    """The spectral radius of a transport operator, measured by power iteration.

    `lower` (a Rayleigh quotient) and `upper` (Collatz & Wielandt: the largest ratio (K w)/w over all patches) enclose that of
    the discrete operator up to rounding, however far the iteration came; that of a BRDF's angular operator is enclosed with
    what its nodes may have missed (see `AngularOperator.spectral_radius`). `vector` is the positive w, (patches,), and bounds
    errors; `iterations` the number of products.
    """

    lower: Float[Array, ""]
    upper: Float[Array, ""]
    vector: Float[Array, " patches"]
    iterations: Int[Array, ""]

    @property
    def value(self) -> Float[Array, ""]:
        """The middle of the bounds."""
        return (self.lower + self.upper) / 2

    def __repr__(self) -> str:
        return f"Radius({float(self.lower):.12g} to {float(self.upper):.12g}, {int(self.iterations)} iterations)"


class Solution(eqx.Module):
    """The radiosity of each patch, `value` (patches,), as one solver has it (`method`), in the unit of the emission.

    `error`, (patches,): a bound on the distance to the solution of the discrete equation, the form factors' own error included;
    for Monte Carlo one standard error; inf where there is nothing to be near to. That radiosity varies within a patch is not
    part of it: refine the patches to see that. `residual`: max |E + K B - B|; for paths it holds their noise. `cost`: products
    of a form factor with a radiosity (n^2 for a gathering bounce, n^3/3 for the direct solve); for paths the rays. `steps`:
    bounces, iterations, shots, or paths. `radius`: bounds of the spectral radius. `code`: the number of `status`.
    """

    value: Float[Array, " patches"]
    error: Float[Array, " patches"]
    residual: Float[Array, ""]
    cost: Float[Array, ""]
    steps: Int[Array, ""]
    radius: Radius
    code: Int[Array, ""]
    method: str = eqx.field(static=True)

    @property
    def status(self) -> Status:
        """What became of the solve."""
        return Status(int(self.code))

    @property
    def ok(self) -> bool:
        """True where the value may be used."""
        return self.status is Status.SOLVED

    @property
    def message(self) -> str:
        """The status in words, and what to try."""
        text = _TEXTS[self.status]
        if self.status in (Status.DIVERGES, Status.MEANINGLESS, Status.UNDECIDED):
            return f"spectral radius {float(self.radius.lower):.9g} to {float(self.radius.upper):.9g}: {text}"
        return text

    def __repr__(self) -> str:
        return (
            f"Solution({self.method}: value={self.value}, largest error={float(jnp.max(self.error)):.3g},"
            f" residual={float(self.residual):.3g}, cost={float(self.cost):.6g}, {self.message!r})"
        )


# --- the operator ---


class Problem(eqx.Module):
    """Form factors, areas, reflectances and emission in one precision, with the errors of the form factors."""

    form_factors: Float[Array, "patches patches"]
    areas: Float[Array, " patches"]
    uncertainty: Float[Array, ""]
    reflectance: Float[Array, " patches"]
    emission: Float[Array, " patches"]

    def apply(self, radiosity: Float[Array, " patches"]) -> Float[Array, " patches"]:
        """K B: one bounce."""
        return self.reflectance * (self.form_factors @ radiosity)

    def residual(self, radiosity: Float[Array, " patches"]) -> Float[Array, " patches"]:
        """E + K B - B."""
        return self.emission + self.apply(radiosity) - radiosity


def problem(enclosure: AbstractEnclosure, emission: Any, reflectance: Any) -> Problem:
    """The checked problem in the precision of the enclosure.

    ValueError for values that are negative or not finite, TypeError for something that is no enclosure.
    """
    if not isinstance(enclosure, AbstractEnclosure):
        raise TypeError(
            f"an enclosure is made by transport.sphere, box, cylinder, polyhedron or enclosure; got {type(enclosure).__name__}"
        )
    return Problem(
        enclosure.form_factors,
        enclosure.areas,
        enclosure.uncertainty,
        per_patch(reflectance, "reflectance", enclosure),
        per_patch(emission, "emission", enclosure),
    )


def per_patch(value: Any, name: str, enclosure: AbstractEnclosure) -> Float[Array, " patches"]:
    """A number, or one for each patch, as (patches,) in the enclosure's precision. ValueError unless finite and >= 0."""
    areas = enclosure.areas
    values = np.asarray(value)
    if not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
        raise ValueError(f"{name} must be real numbers >= 0; got {value!r}")
    if values.ndim > 1 or (values.ndim == 1 and values.shape != areas.shape):
        raise ValueError(f"{name} must be one number or one for each of the {areas.size} patches; got the shape {values.shape}")
    wrong = values[~(np.isfinite(values) & (values >= 0))]
    if wrong.size:
        raise ValueError(f"{name} must be finite and >= 0; got {wrong.flat[0]:g}")
    return jnp.broadcast_to(jnp.asarray(values, areas.dtype), areas.shape)


def spectral_radius(enclosure: AbstractEnclosure, reflectance: Any, *, iterations: int = _ITERATIONS) -> Radius:
    """The spectral radius of diffuse transport between patches of these reflectances (a number, or one each; above 1 too).

    For one reflectance it is that reflectance. At most so many `iterations`; the bounds hold in any case.
    ValueError for reflectances that are negative or not finite.
    """
    return radius_of(problem(enclosure, 0.0, reflectance), iterations)


@jax.jit
def radius_of(problem: Problem, iterations: Any = _ITERATIONS) -> Radius:
    """`spectral_radius` of a checked problem."""
    # In the product weighted with area / reflectance K is symmetric: there the Rayleigh quotient is a lower bound.
    weight = jnp.where(problem.reflectance > 0, problem.areas / jnp.where(problem.reflectance > 0, problem.reflectance, 1), 0)
    # A black patch has no part in it.
    start = jnp.where(problem.reflectance > 0, 1, 0).astype(problem.areas.dtype)
    return power_iteration(problem.apply, start, weight, iterations)


def power_iteration(apply: Any, start: Array, weight: Array | None = None, iterations: Any = _ITERATIONS) -> Radius:
    """Bounds of the spectral radius of a non-negative operator from a start >= 0, whose zeros must stay zeros.

    `weight`: the product in which the operator is symmetric; None: it is not, and the smallest ratio is the lower bound.
    """
    tolerance = max(8 * float(jnp.finfo(start.dtype).eps), _ENOUGH)
    tiny = float(jnp.finfo(start.dtype).tiny)
    taking_part = start > 0

    def quotients(w: Array, image: Array) -> tuple[Array, Array]:
        ratio = jnp.where(taking_part, image / jnp.where(taking_part, w, 1), 0)
        upper = jnp.max(ratio)
        if weight is None:
            return jnp.minimum(jnp.min(jnp.where(taking_part, ratio, jnp.inf)), upper), upper
        norm = jnp.sum(weight * w * w)
        # A quotient of a positive vector, so a lower bound of the largest eigenvalue.
        return jnp.where(norm > 0, jnp.sum(weight * w * image) / jnp.where(norm > 0, norm, 1), 0), upper

    def step(state: Any) -> Any:
        w, image, lower, upper, count = state
        # Half a step back: two plates that see only each other would swap for ever.
        w = image + upper / 2 * w
        w = jnp.where(taking_part, jnp.maximum(w / jnp.maximum(jnp.max(w), tiny), _FLOOR), 0)
        image = apply(w)
        low, high = quotients(w, image)
        return w, image, jnp.maximum(lower, low), jnp.minimum(upper, high), count + 1

    def goes_on(state: Any) -> Array:
        _, _, lower, upper, count = state
        return (count < iterations) & (upper - lower > tolerance * upper)

    image = apply(start)
    state = (start, image, *quotients(start, image), jnp.asarray(1))
    w, _, lower, upper, count = jax.lax.while_loop(goes_on, step, state)
    # A Rayleigh quotient may round above what it is below.
    return Radius(jnp.minimum(lower, upper), upper, w, count)


# --- errors ---


def shrinking(problem: Problem, radius: Radius) -> tuple[Array, Array]:
    """A positive vector w of largest entry 1 and the largest theta of K w <= theta w."""
    w = radius.vector / jnp.maximum(jnp.max(radius.vector), _FLOOR) + _MIXED
    w = w / jnp.max(w)
    return w, jnp.max(problem.apply(w) / w)


def bounded(problem: Problem, radius: Radius, value: Array) -> tuple[Array, Array]:
    r"""(error, residual) of a value: $|B - B^*| \le \max_k(|r_k|/w_k)\, w/(1-\theta)$ for any w > 0 with $K w \le \theta w$.

    r is the residual, with its rounding and what the form factors' errors may add; inf where no such bound exists.
    """
    epsilon = float(jnp.finfo(value.dtype).eps)
    size = problem.emission + problem.apply(jnp.abs(value)) + jnp.abs(value)
    residual = jnp.abs(problem.residual(value))
    doubtful = residual + _ROUNDING * epsilon * size + problem.reflectance * problem.uncertainty * jnp.max(jnp.abs(value))
    w, theta = shrinking(problem, radius)
    bound = jnp.max(doubtful / w) * w / jnp.where(theta < 1, 1 - theta, 1)
    known = (theta < 1) & jnp.all(jnp.isfinite(value))
    return jnp.where(known, bound, jnp.inf), jnp.max(residual)


def standing(radius: Radius, *, refuses: bool) -> Int[Array, ""]:
    """SOLVED below 1; at 1 and above what a method that refuses, or one that does not, has to say."""
    above = Status.DIVERGES if refuses else Status.MEANINGLESS
    # Equality counts as above: closed and loss-free. The lower bound of one reflectance is that reflectance to rounding.
    slack = _ROUNDING * float(jnp.finfo(radius.upper.dtype).eps)
    return jnp.where(
        radius.upper < 1 - slack, int(Status.SOLVED), jnp.where(radius.lower >= 1 - slack, int(above), int(Status.UNDECIDED))
    )


def judged(code: Array, value: Array, reached: Bool[Array, ""] | bool = True) -> Int[Array, ""]:
    """The status after the solve: a solved one may not be finite, or not have reached its tolerance."""
    solved = code == Status.SOLVED
    code = jnp.where(solved & ~jnp.asarray(reached), int(Status.NOT_REACHED), code)
    finite = jnp.all(jnp.isfinite(value))
    # Where the radius is 1 or more the reason is known already, with its bounds.
    return jnp.where((code != Status.DIVERGES) & (code != Status.MEANINGLESS) & ~finite, int(Status.NOT_FINITE), code)
