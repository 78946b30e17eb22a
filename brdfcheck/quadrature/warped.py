r"""Rules whose nodes follow the lobe by a change of variable.

Lobe-warped Gauss: the variable is what the lobe's own density integrates to, $u = \cos^{n+1}$ for the power-like lobes, so
that the lobe becomes flat; but $\cos = u^{1/(n+1)}$ then has a singularity at u = 0, which a Gauss rule never sees
through: with 64 nodes an exactly normalised Phong lobe of n = 10 comes out as 1.0000059.

Tanh-sinh: nodes that crowd double exponentially towards the ends of an interval (Takahasi & Mori 1974), here on the
panels into which the polar angle of the light and the plane of incidence cut the hemisphere. The mirror direction, the
normal and the light are corners of panels, where a needle of any width is seen.
"""

from __future__ import annotations

import functools
from typing import Any, ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.numerics import gauss
from brdfcheck.quadrature.product import circle
from brdfcheck.quadrature.proposals import LobeGeometry, has_axis
from brdfcheck.quadrature.rule import (
    AbstractLightRule,
    Raw,
    bar,
    block_count,
    by_blocks,
    checked_count,
    evaluate,
    on_sphere,
)


@final
class LobeWarpedGauss(AbstractLightRule):
    """Gauss-Legendre in what the lobe's density integrates to, `order` nodes, and midpoints in 2 order azimuths.

    About the mirror direction, or of the half vector about N. Nodes below the horizon count as evaluations. Claims
    nothing. Derivatives in the incidence know which nodes are above the horizon, not that others rise: towards normal
    incidence, where all is of second order, they lack what a lobe that is not 0 at the horizon gains there. ValueError for an
    order below 1.
    """

    order: int = eqx.field(static=True)
    name: ClassVar[str] = "lobe-warped-gauss"
    family: ClassVar[str] = "warped"
    ladder: ClassVar[tuple[Any, ...]] = (4, 8, 16, 32, 64, 128, 256, 512)
    needs: ClassVar[str] = "a lobe about an axis or a microfacet lobe"
    symmetric: ClassVar[bool] = True

    def __init__(self, order: int = 64):
        self.order = checked_count(order, "order")

    def applies(self, core: Any, cos_theta: Any) -> bool:
        return has_axis(core)

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        mu = wi[2]
        lobe = LobeGeometry(core, mu, wi)
        around = 2 * self.order
        azimuth = jnp.asarray(circle(around), mu.dtype)

        def rings(u: Array, share: Array) -> Array:
            versine = lobe.versine(u)
            density = lobe.density(versine)
            wo, jacobian = lobe.directions(versine[:, None], azimuth)
            useful = (jacobian > 0) & (density > 0)[:, None]
            weight = (share / around / jnp.where(density > 0, density, 1))[:, None] * wo[..., 2] * jacobian
            weight = jnp.where(useful, weight, 0)
            wo = jnp.where(useful[..., None], wo, jnp.array([0, 0, 1], wo.dtype))
            return jnp.sum(evaluate(core, lobe.wi, wo.reshape(-1, 3), weight.reshape(-1)), axis=0)

        tables = tuple(jnp.asarray(table, mu.dtype) for table in gauss(self.order))
        return Raw(by_blocks(rings, tables, block_count(self.order, around)), jnp.inf, self.order * around)


@functools.cache
def tanh_sinh(step: float, epsilon: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(distance from the left end, distance from the right end, weight) on [0, 1], at multiples of `step`.

    The middle node is the first; the others follow in pairs. Weights below `epsilon` are left out.
    """
    count = int(np.arcsinh(-np.log(epsilon) / np.pi) / step)
    t = np.concatenate([[0.0], *([k * step, -k * step] for k in range(1, count + 1))])
    reach = np.pi * np.sinh(t)
    left, right = 1 / (1 + np.exp(-reach)), 1 / (1 + np.exp(reach))
    return left, right, step * np.pi * np.cosh(t) * left * right


@final
class TanhSinh(AbstractLightRule):
    """Tanh-sinh in the polar angle, cut at that of the light, and in the azimuth, cut at the plane of incidence.

    The step is 2^-level. The error is the difference from twice the step, whose nodes are among these. ValueError for a
    level below 1.
    """

    level: int = eqx.field(static=True)
    name: ClassVar[str] = "tanh-sinh"
    family: ClassVar[str] = "warped"
    ladder: ClassVar[tuple[Any, ...]] = (1, 2, 3, 4, 5, 6)
    symmetric: ClassVar[bool] = True

    def __init__(self, level: int = 4):
        self.level = checked_count(level, "level")
        if self.level > 10:
            raise ValueError(f"level must be at most 10; got {level}")

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        mu = wi[2]
        left, right, weight = tanh_sinh(2.0**-self.level, float(jnp.finfo(mu.dtype).eps) / 64)
        # Nodes at even multiples of the step: the middle one and every second pair.
        pair = (np.arange(left.size) + 1) // 2
        coarse = np.where(pair % 2 == 0, 2 * weight, 0)
        theta = jnp.arctan2(wi[0], mu)
        elevation = jnp.arctan2(mu, wi[0])
        # Panels in the polar angle: N to the light's angle, and on to the horizon. Sines from the nearer end.
        x, y = (jnp.asarray(table, mu.dtype) for table in (left, right))
        angle = jnp.concatenate([theta * x, theta + elevation * x])
        height = jnp.concatenate([elevation + theta * y, elevation * y])
        shares = jnp.concatenate([theta * jnp.ones_like(x), elevation * jnp.ones_like(x)])
        rows = jnp.stack([jnp.asarray(np.tile(table, 2), mu.dtype) for table in (weight, coarse)], axis=-1) * shares[:, None]
        # In azimuth both halves of the circle are two panels that meet in the plane of incidence.
        azimuth = jnp.asarray(np.pi * np.concatenate([left, left + 1]), mu.dtype)
        columns = jnp.asarray(np.pi * np.stack([np.tile(weight, 2), np.tile(coarse, 2)], axis=-1), mu.dtype)

        def rings(angle: Array, height: Array, rows: Array) -> Array:
            sine, cosine = jnp.sin(angle), jnp.sin(height)
            wo = on_sphere(sine[:, None], cosine[:, None], azimuth).reshape(-1, 3)
            values = evaluate(core, wi, wo, jnp.repeat(sine * cosine, azimuth.size))
            values = values.reshape(angle.size, azimuth.size, *values.shape[1:])
            return jnp.einsum("ij...,ir,jr->r...", values, rows, columns)

        fine, rough = by_blocks(rings, (angle, height, rows), block_count(angle.size, azimuth.size))
        return Raw(fine, bar(fine, rough), angle.size * azimuth.size)
