r"""Transport inside a sphere, where it depends on one angle alone, and what that says of every other enclosure.

A ray in a sphere arrives at the angle at which it left. So what a bounce does to light depends on the angle of incidence
alone, $(T h)(\mu_i) = \int_0^1 \bar f(\mu_i, \mu_o)\, h(\mu_o)\, \mu_o\, d\mu_o$,
with $\bar f$ the BRDF integrated over the azimuth. T applied to 1 is the directional albedo; T^m applied to 1 is the energy
that is left, m bounces later, of light that arrives at that angle.

The sphere is the worst case. In any enclosure whose other walls are loss-free mirrors, what happens between two meetings
with the BRDF preserves the measure cos(theta) dw dA: an isometry M of the square-integrable functions. The spectral radius of
(T M) is at most the norm of T, which for a reciprocal BRDF is T's own spectral radius, and the largest one belongs to
functions of the angle alone, since the kernel is positive: to the sphere. An albedo above 1 at some angle makes a scene
diverge only if that radius exceeds 1.

The rule for T takes what varies slowly, and the directional albedo E, which `brdfcheck.albedo` knows to twelve digits, what
does not: $(T h)(\mu_i) = E(\mu_i) h(\mu_i) + \int_0^1 \bar f(\mu_i, \mu_o) [h(\mu_o) - h(\mu_i)] \mu_o d\mu_o$ (singularity
subtraction, Kantorovich & Krylov 1958). So a lobe too narrow for the nodes is a mirror of its own albedo, and not whatever
the nodes happened to hit. How far the rule alone was from E enters the bounds of the radius, which in any case lies between
the root of the mean square of E and its largest value.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.messages import one_of
from brdfcheck.numerics import gauss
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.rule import checked_count
from brdfcheck.transport.solution import Radius, power_iteration

Remainder = Literal["diffuse", "mirror"]
_ITERATIONS = 2000
# Azimuths: steps of at most so many e-folds towards both ends, over so many of them where there are nodes enough.
_STEP, _DEPTH = 0.3, 18.0


class AngularOperator(eqx.Module):
    """T as a matrix on cosines of incidence, `cos_theta` (nodes,); the last node is normal incidence, with the weight 0.

    `matrix` acts on values at the nodes, its rows add up to the directional albedo; `weight` integrates over the cosine.
    `defect`: by how much the rule alone would have missed the albedo at each node; `error`: a bound on the albedo's own error.
    """

    cos_theta: Float[Array, " nodes"]
    weight: Float[Array, " nodes"]
    matrix: Float[Array, "nodes nodes"]
    defect: Float[Array, " nodes"]
    error: Float[Array, " nodes"]

    def albedo(self) -> Float[Array, " nodes"]:
        """T 1: the directional albedo at the nodes."""
        return jnp.sum(self.matrix, axis=1)

    def reciprocal(self) -> bool:
        """True where the BRDF is, as far as the nodes show it."""
        flow = (self.weight * self.cos_theta)[:, None] * self.matrix
        return bool(jnp.max(jnp.abs(flow - flow.T)) <= 1e3 * jnp.finfo(flow.dtype).eps * jnp.max(flow))

    def spectral_radius(self) -> Radius:
        """By power iteration, with bounds; that of the sphere, and the largest of any enclosure with loss-free other walls.

        The latter, and that the bounds are close, holds for reciprocal BRDFs. The bounds contain what the nodes may have
        missed, estimated from `defect`; they are never wider than what the albedo at the nodes alone allows.
        """
        return _radius(self, self.reciprocal())

    def energy(self, bounces: Any) -> Float[Array, "bounces nodes"]:
        """What is left of unit light after these numbers of bounces (rising, any size), by the angle at which it came.

        ValueError unless they are whole numbers >= 0 that rise.
        """
        counts = np.atleast_1d(np.asarray(bounces))
        if counts.ndim != 1 or not np.issubdtype(counts.dtype, np.integer) or np.any(counts < 0) or np.any(np.diff(counts) < 0):
            raise ValueError(f"bounces must be whole numbers >= 0 that rise; got {bounces!r}")
        rows, energy, at = [], jnp.ones_like(self.cos_theta), 0
        powers = [self.matrix]
        for count in counts.tolist():
            for bit in range((count - at).bit_length()):
                while len(powers) <= bit:
                    powers.append(powers[-1] @ powers[-1])
                if (count - at) >> bit & 1:
                    energy = powers[bit] @ energy
            at = count
            rows.append(energy)
        return jnp.stack(rows)

    def completed(self, remainder: Remainder) -> AngularOperator:
        """The same wall, loss-free otherwise: what it loses, max(0, 1 - E), is given back as a mirror would, or diffusely.

        ValueError for another word.
        """
        one_of(remainder, get_args(Remainder), "remainder")
        lost = jnp.maximum(1 - self.albedo(), 0)
        mass = self.weight * self.cos_theta * lost
        diffuse = lost[:, None] * mass / jnp.maximum(jnp.sum(mass), jnp.finfo(mass.dtype).tiny)
        given = jnp.diag(lost) if remainder == "mirror" else diffuse  # a mirror: at the angle at which it came
        return AngularOperator(self.cos_theta, self.weight, self.matrix + given, self.defect, self.error)


@eqx.filter_jit
def _radius(operator: AngularOperator, reciprocal: bool) -> Radius:
    matrix, product, albedo = operator.matrix, operator.weight * operator.cos_theta, operator.albedo()
    start = jnp.ones_like(albedo)
    found = power_iteration(lambda values: matrix @ values, start, product if reciprocal else None, _ITERATIONS)
    if reciprocal:
        # What changes the rows changes the quotient of the vector by their mean in it, to first order.
        share = product * found.vector**2
        missed = jnp.sum(share * operator.defect) / jnp.sum(share)
        # |T 1| <= |T| |1| in the product in which T is symmetric.
        least = jnp.sqrt(jnp.sum(2 * product * jnp.maximum(albedo - operator.error, 0) ** 2))
    else:  # between the least and the largest sum of a row
        missed, least = jnp.max(operator.defect), jnp.min(albedo - operator.error)
    most = jnp.max(albedo + operator.error)
    least, rounding = jnp.minimum(least, most), 1 + 16 * jnp.finfo(albedo.dtype).eps
    lower = jnp.clip(found.lower - missed, least, most) / rounding
    return Radius(lower, jnp.clip(found.upper + missed, least, most) * rounding, found.vector, found.iterations)


def angular_operator(brdf: Callable[..., Any], *, nodes: int = 192, azimuths: int = 512) -> AngularOperator:
    """T of `brdf`, which JAX can trace, isotropic and of one channel, in the precision of its parameters.

    Gauss-Legendre `nodes` over the cosine (normal incidence is added) and `azimuths` over half a turn, which crowd towards
    both of its ends, where needles are. The rows add up to `brdfcheck.albedo` whatever the lobe; for exponents above about
    10,000 at the defaults the nodes are too few for more, and `defect` and the bounds of the radius say so.
    Raises ValueError for counts that are not positive, TypeError for something that cannot be called.
    """
    if not callable(brdf):
        raise TypeError(f"a BRDF must be callable, f(wi, wo); got {type(brdf).__name__}")
    x, w = gauss(checked_count(nodes, "nodes"))
    leaves = [leaf for leaf in jax.tree.leaves(brdf) if eqx.is_inexact_array(leaf)]
    dtype = jnp.result_type(*leaves) if leaves else jnp.asarray(0.0).dtype
    cosines, weights = np.append(x, 1.0), np.append(w, 0.0)
    turns = _azimuths(checked_count(azimuths, "azimuths"))
    mu, weight, *turns = (jnp.asarray(part, dtype) for part in (cosines, weights, *turns))
    found = albedo(brdf, mu)
    value, error = jnp.asarray(found.value, dtype), jnp.asarray(found.error, dtype)
    matrix, defect = _subtracted(_kernel(brdf, mu, *turns) * mu * weight, value)
    return AngularOperator(mu, weight, matrix, defect, error)


@jax.jit
def _subtracted(matrix: Array, albedo: Array) -> tuple[Array, Array]:
    """(matrix, defect) with the row sums `albedo`; what was missing or too much is on the diagonal, where the needles are."""
    missing = albedo - jnp.sum(matrix, axis=1)
    return matrix + jnp.diag(missing), jnp.abs(missing)


def _azimuths(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths in (0, pi) and their weights: evenly spaced in the middle, in e-folds towards the ends.

    The trapezoidal rule in t for phi = pi/T (log(1 + e^t) - log(1 + e^(t-T))). Spectrally accurate for needles of any width
    at the azimuths 0 and pi: seen at grazing incidence those of half vectors are as narrow as the cosine is small.
    """
    step = min(_STEP, 4 * _DEPTH / count)
    depth, middle = count / 4 * step, count / 2 * step
    t = (np.arange(count) + 0.5) * step - depth
    phi = np.pi / middle * (np.logaddexp(0, t) - np.logaddexp(0, t - middle))
    weight = step * np.pi / middle * (1 / (1 + np.exp(-t)) - 1 / (1 + np.exp(middle - t)))
    # Beyond the ends the weights go on in a geometric series, on directions that are no others any more.
    weight[[0, -1]] *= 1 + 1 / np.expm1(step)
    return phi, weight * np.pi / np.sum(weight)


@eqx.filter_jit
def _kernel(brdf: Callable[..., Any], mu: Array, azimuths: Array, weights: Array) -> Array:
    wi = geometry.direction(mu)[:, None]
    shape = (mu.size, mu.size, 3)

    def add(total: Array, node: tuple[Array, Array]) -> tuple[Array, None]:
        azimuth, weight = node
        wo = geometry.direction(mu, azimuth)[None]
        value = brdf(jnp.broadcast_to(wi, shape), jnp.broadcast_to(wo, shape)).astype(total.dtype)
        return total + 2 * weight * value, None

    return jax.lax.scan(add, jnp.zeros((mu.size, mu.size), mu.dtype), (azimuths, weights))[0]
