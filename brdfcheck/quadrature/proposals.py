r"""Where a lobe is: ways to draw directions, made from nothing but the width and the support that the lobe offers.

A proposal takes u in (0, 1] to an angle about the lobe's axis, as a versine v, and has a density in solid angle about it:

* a power of the cosine, $(s+1)/(2\pi)\cos^s$ with s = 1/width^2, which is the exponent of the power-like lobes;
* a tail, $\propto 1/(\mathrm{width}^2 + v)$ up to where the lobe ends;
* slopes of facets, $D \cos a$: Beckmann's where the distribution ends before 90 degrees, else Trowbridge and Reitz's.

In the mirror form the axis is the mirror direction. In the half form and for microfacets the angle is that of the half
vector about N, and dwo = 4 (wi.H) dH.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.brdf.base import AbstractMicrofacetLobe, AbstractZonalLobe
from brdfcheck.geometry import safe_root
from brdfcheck.quadrature.rule import light

# The power-like lobes say width = 1/sqrt(n + 0.05).
_WIDTH_OFFSET = 0.05
_TINY = 1e-18


def has_axis(core: Any) -> bool:
    """True where the proposals of this file apply."""
    return isinstance(core, (AbstractZonalLobe, AbstractMicrofacetLobe))


class LobeGeometry:
    """The axis of a lobe seen from one direction of light: `wi`, at the azimuth 0 or 180 degrees, or the cosine `mu`."""

    def __init__(self, core: AbstractZonalLobe | AbstractMicrofacetLobe, mu: Float[Array, ""], wi: Array | None = None):
        self.core, self.mu = core, mu
        self.wi = light(mu) if wi is None else wi
        self.facets = isinstance(core, AbstractMicrofacetLobe)
        self.about_mirror = isinstance(core, AbstractZonalLobe) and core.form == "mirror"
        breaks = core.breaks(mu) if isinstance(core, AbstractMicrofacetLobe) else core.breaks()
        self.end = jnp.minimum(breaks[-1], 1)
        self.square = core.width() ** 2 if not self.facets else jnp.tan(core.width()) ** 2
        self.exponent = jnp.maximum(1 / self.square - _WIDTH_OFFSET, 0)

    # The main proposal: the power of the cosine, or the slopes of facets.

    def versine(self, u: Float[Array, " k"]) -> Float[Array, " k"]:
        """The angle at which the main proposal has the share u of its weight outside."""
        if not self.facets:
            return -jnp.expm1(jnp.log(u) / (self.exponent + 1))
        slopes = self.square * jnp.where(self.end < 1, -jnp.log(u), (1 - u) / u)  # tan^2
        cosine = 1 / jnp.sqrt(1 + slopes)
        return slopes * cosine**2 / (1 + cosine)

    def density(self, versine: Array) -> Array:
        """Of the main proposal, in 1/sr about the axis; 0 at 90 degrees and beyond."""
        cosine = jnp.maximum(1 - versine, 0)
        safe = jnp.maximum(cosine, _TINY)
        if not self.facets:
            power = jnp.exp(self.exponent * jnp.log(safe))
            return jnp.where(cosine > 0, (self.exponent + 1) / (2 * np.pi) * power, 0)
        slopes = versine * (2 - versine) / (safe * safe * self.square)
        shape = jnp.where(self.end < 1, jnp.exp(-slopes), 1 / (1 + slopes) ** 2)
        return jnp.where(cosine > 1e-6, shape / (np.pi * self.square * jnp.maximum(cosine, 1e-6) ** 3), 0)

    # The tail.

    def tail_versine(self, u: Array) -> Array:
        """The angle up to which the tail proposal has the share u of its weight."""
        scale = self._tail_scale()
        return scale * jnp.expm1(u * jnp.log1p(self.end / scale))

    def tail_density(self, versine: Array) -> Array:
        """Of the tail proposal, in 1/sr about the axis; 0 beyond the lobe's end."""
        scale = self._tail_scale()
        return jnp.where(versine <= self.end, 1 / (2 * np.pi * jnp.log1p(self.end / scale) * (scale + versine)), 0)

    def _tail_scale(self) -> Array:
        return jnp.minimum(self.square, 1)

    # Directions.

    def directions(self, versine: Array, azimuth: Array) -> tuple[Array, Array]:
        """wo at an angle and an azimuth about the axis (the azimuth 0 leads to +x in the half form), and the Jacobian.

        That takes a density about the axis to one in wo, and is 0 where wo is useless.
        """
        versine, azimuth = jnp.broadcast_arrays(versine, azimuth)
        sine, cosine = safe_root(versine * (2 - versine)), 1 - versine
        x, y = sine * jnp.cos(azimuth), sine * jnp.sin(azimuth)
        mu, root = self.mu, self.wi[0]
        if self.about_mirror:
            wo = jnp.stack([mu * x - root * cosine, y, root * x + mu * cosine], axis=-1)
            return wo, jnp.where(wo[..., 2] > 0, 1, 0).astype(mu.dtype)
        half = jnp.stack([x, y, cosine], axis=-1)
        incident = x * root + cosine * mu
        wo = 2 * incident[..., None] * half - self.wi
        useful = (incident > 0) & (wo[..., 2] > 0)
        return wo, jnp.where(useful, 4 * incident, 0)

    def angle(self, wo: Array) -> tuple[Array, Array]:
        """For given directions: their versines about the axis, and the Jacobian."""
        wi = jnp.broadcast_to(self.wi, wo.shape)
        if self.about_mirror:
            versine = geometry.mirror_versine(wi, wo)
            return versine, jnp.ones_like(versine)
        return geometry.half_versine(wi, wo), 4 * geometry.half_cosine(wi, wo)
