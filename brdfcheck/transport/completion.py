r"""A BRDF whose missing light is given back, so that a wall is loss-free wherever the BRDF does not reflect too much."""

from __future__ import annotations

from typing import Any, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF
from brdfcheck.numerics import gauss
from brdfcheck.quadrature.albedo import albedo

_NODES = 4097


@final
class Completed(AbstractBRDF):
    r"""$f + c(\mu_i)\,c(\mu_o) / (\pi\, \bar c)$: what f loses, $c = \max(0, 1 - E)$, is given back.

    $\bar c = \int_0^1 c\, 2\mu\, d\mu$. Reciprocal; its albedo is max(E, 1): 1 where f conserves, and f's own excess where
    it does not (after Kulla & Conty 2017, who give back what scattering between facets keeps). Made by `completed`.
    """

    brdf: AbstractBRDF
    lost: Float[Array, " nodes"]
    mean: Float[Array, ""]

    def share(self, cos_theta: Float[Array, "..."]) -> Float[Array, "..."]:
        """c: what f loses at this incidence, interpolated between cosines evenly spaced in their square root."""
        place = jnp.sqrt(jnp.clip(cos_theta, 0, 1)) * (self.lost.size - 1)
        low = jnp.clip(place.astype(int), 0, self.lost.size - 2)
        part = place - low.astype(place.dtype)
        return self.lost[low] * (1 - part) + self.lost[low + 1] * part

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        above = (wi[..., 2] >= 0) & (wo[..., 2] >= 0)
        given = self.share(wi[..., 2]) * self.share(wo[..., 2]) / (np.pi * jnp.where(self.mean > 0, self.mean, 1))
        return self.brdf(wi, wo) + jnp.where(above, given, 0)


def completed(brdf: Any) -> Completed:
    """The BRDF (of one parameter set, one channel) with its loss given back diffusely; the loss from `brdfcheck.albedo`.

    ValueError for a BRDF that is already loss-free, or has channels.
    """
    roots = np.linspace(0, 1, _NODES)
    value = albedo(brdf, jnp.asarray(roots**2)).value
    if value.ndim != 1:
        raise ValueError(f"only a BRDF of one channel can be completed; got the albedo's shape {value.shape}")
    lost = jnp.maximum(1 - value, 0)
    # c is linear in the root s of the cosine: the integral of c 4 s^3 ds is exact with three Gauss nodes a step.
    part, w = gauss(3)
    s = roots[:-1, None] + part / (_NODES - 1)
    weight = 4 * s**3 * w / (_NODES - 1)
    exact = np.asarray(lost, float)
    mean = float(np.sum(weight * (exact[:-1, None] * (1 - part) + exact[1:, None] * part)))
    if not mean > 1e-6:
        raise ValueError("this BRDF loses nothing: there is nothing to complete")
    return Completed(brdf, lost, jnp.asarray(mean, lost.dtype))
