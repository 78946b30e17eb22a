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
from brdfcheck.transport.radiosity import checked_steps
from brdfcheck.transport.solution import Radius, power_iteration

Remainder = Literal["diffuse", "mirror"]
_ITERATIONS = 2000


class AngularOperator(eqx.Module):
    """T as a matrix on cosines of incidence, (nodes,); the last node is normal incidence, with the weight 0.

    `matrix` acts on values at the nodes, `weight` integrates over the cosine.
    """

    cos_theta: Float[Array, " nodes"]
    weight: Float[Array, " nodes"]
    matrix: Float[Array, "nodes nodes"]

    def albedo(self) -> Float[Array, " nodes"]:
        """T 1: the directional albedo at the nodes, as this rule sees it."""
        return jnp.sum(self.matrix, axis=1)

    def mean_albedo(self) -> Float[Array, ""]:
        """The albedo of light that comes evenly from everywhere."""
        return jnp.sum(2 * self.weight * self.cos_theta * self.albedo())

    def spectral_radius(self) -> Radius:
        """By power iteration, with bounds; that of the sphere, and the largest of any enclosure with loss-free other walls.

        The latter, and that the bounds are close, holds for reciprocal BRDFs.
        """
        product = self.weight * self.cos_theta
        flow = product[:, None] * self.matrix
        reciprocal = jnp.max(jnp.abs(flow - flow.T)) <= 1e3 * jnp.finfo(flow.dtype).eps * jnp.max(flow)
        return _radius(self.matrix, product if bool(reciprocal) else None)

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
        if remainder not in get_args(Remainder):
            raise ValueError(f"remainder must be one of {', '.join(get_args(Remainder))}; got {remainder!r}")
        lost = jnp.maximum(1 - self.albedo(), 0)
        if remainder == "mirror":  # arrives at the angle at which it left
            return AngularOperator(self.cos_theta, self.weight, self.matrix + jnp.diag(lost))
        mass = self.weight * self.cos_theta * lost
        given = lost[:, None] * mass / jnp.maximum(jnp.sum(mass), jnp.finfo(mass.dtype).tiny)
        return AngularOperator(self.cos_theta, self.weight, self.matrix + given)


@jax.jit
def _radius(matrix: Array, product: Array | None) -> Radius:
    return power_iteration(lambda values: matrix @ values, jnp.ones_like(matrix[0]), product, _ITERATIONS)


def angular_operator(brdf: Callable[..., Any], *, nodes: int = 192, azimuths: int = 512) -> AngularOperator:
    """T of a BRDF that JAX can trace, isotropic and of one channel, in the precision of its parameters.

    Gauss-Legendre `nodes` over the cosine (normal incidence is added) and midpoints over the `azimuths` of half a turn; the
    defaults serve exponents up to about 1000, and `albedo` compared with `brdfcheck.albedo` shows whether they do.
    Raises ValueError for counts that are not positive, TypeError for something that cannot be called.
    """
    if not callable(brdf):
        raise TypeError(f"a BRDF must be callable, f(wi, wo); got {type(brdf).__name__}")
    x, w = np.polynomial.legendre.leggauss(checked_steps(nodes, "nodes"))
    leaves = [leaf for leaf in jax.tree.leaves(brdf) if eqx.is_inexact_array(leaf)]
    dtype = jnp.result_type(*leaves) if leaves else jnp.asarray(0.0).dtype
    cosines, weights = np.append((1 + x) / 2, 1.0), np.append(w / 2, 0.0)
    turns = (np.arange(checked_steps(azimuths, "azimuths")) + 0.5) * np.pi / azimuths
    mu, weight, turn = (jnp.asarray(part, dtype) for part in (cosines, weights, turns))
    return AngularOperator(mu, weight, _kernel(brdf, mu, turn) * mu * weight)


@eqx.filter_jit
def _kernel(brdf: Callable[..., Any], mu: Array, azimuths: Array) -> Array:
    wi = geometry.direction(mu)[:, None]
    shape = (mu.size, mu.size, 3)

    def add(total: Array, azimuth: Array) -> tuple[Array, None]:
        wo = geometry.direction(mu, azimuth)[None]
        return total + brdf(jnp.broadcast_to(wi, shape), jnp.broadcast_to(wo, shape)).astype(total.dtype), None

    total, _ = jax.lax.scan(add, jnp.zeros((mu.size, mu.size), mu.dtype), azimuths)
    return total * (2 * np.pi / azimuths.size)
