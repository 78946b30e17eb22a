"""Sums of BRDFs that conserve because their parts do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import jax.numpy as jnp
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF, as_parameter
from brdfcheck.brdf.microfacet import fresnel_schlick


def _checked(part: Any) -> AbstractBRDF:
    if not isinstance(part, AbstractBRDF):
        raise TypeError(f"a part must be a BRDF of this package; got {type(part).__name__}")
    return part


@final
class Mixture(AbstractBRDF):
    r"""$\sum_j w_j f_j$: BRDFs of this package with weights, which conserves if all parts do, $w_j \ge 0$ and $\sum w_j \le 1$.

    TypeError where a part is no BRDF of this package, ValueError where there is not one weight for each part.
    """

    parts: tuple[AbstractBRDF, ...]
    weights: Float[Array, " parts"]

    def __init__(self, parts: Sequence[AbstractBRDF], weights: object):
        self.parts = tuple(map(_checked, parts))
        self.weights = as_parameter(weights, "weights")
        if not self.parts or self.weights.shape != (len(self.parts),):
            raise ValueError(f"there must be a weight for each part; got {len(self.parts)} parts, weights {weights!r}")

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        total = self.weights[0] * self.parts[0](wi, wo)
        for weight, part in zip(self.weights[1:], self.parts[1:], strict=True):
            total = total + weight * part(wi, wo)
        return total


@final
class FresnelBlend(AbstractBRDF):
    r"""$\min(F_i, F_o)\, f_s + (1 - \max(F_i, F_o))\, f_d$, with Schlick's $F = F_0 + (1 - F_0)(1 - \cos\theta)^5$.

    Reciprocal where its parts are. It conserves if both do and $0 \le F_0 \le 1$: for light from $\omega_i$ the first weight is
    at most $F_i$ and the second at most $1 - F_i$, whatever $\omega_o$. `coat` is f_s, `base` is f_d, `f0` the reflectance at
    normal incidence. TypeError where a part is no BRDF of this package.
    """

    coat: AbstractBRDF
    base: AbstractBRDF
    f0: Array

    def __init__(self, coat: AbstractBRDF, base: AbstractBRDF, f0: object = 0.04):
        self.coat, self.base = _checked(coat), _checked(base)
        self.f0 = as_parameter(f0, "f0")

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        light, view = (fresnel_schlick(jnp.clip(jnp.asarray(w)[..., 2], 0, 1), self.f0) for w in (wi, wo))
        return jnp.minimum(light, view) * self.coat(wi, wo) + (1 - jnp.maximum(light, view)) * self.base(wi, wo)
