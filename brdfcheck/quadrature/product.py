r"""Product rules on the hemisphere: what anybody writes first. They know nothing of the BRDF, and claim nothing.

$E = \int_0^{2\pi}\int f \cos\theta_o \sin\theta_o\, d\theta_o\, d\phi$. Exact for polynomials in the direction up to their
degree; blind to a lobe narrower than their mesh, which they report as 0, or too large where a node meets its peak.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.numerics import gauss
from brdfcheck.quadrature.rule import AbstractLightRule, Raw, block_count, by_blocks, checked_count, evaluate, on_sphere


def circle(count: int) -> np.ndarray:
    """Azimuths at the middles of `count` equal arcs; each has the weight 2 pi / count."""
    return 2 * np.pi * (np.arange(count) + 0.5) / count


def _product(brdf: Callable[..., Any], wi: Array, sine: np.ndarray, cosine: np.ndarray, weight: np.ndarray, around: int) -> Raw:
    """The sum over rings of `around` directions each; `weight` is that of a ring, N.wo and 2 pi included."""
    azimuth = jnp.asarray(circle(around), wi.dtype)

    def rings(sine: Array, cosine: Array, weight: Array) -> Array:
        wo = on_sphere(sine[:, None], cosine[:, None], azimuth)
        shares = jnp.broadcast_to(weight[:, None] / around, wo.shape[:-1])
        return jnp.sum(evaluate(brdf, wi, wo.reshape(-1, 3), shares.reshape(-1)), axis=0)

    tables = tuple(jnp.asarray(table, wi.dtype) for table in (sine, cosine, weight))
    return Raw(by_blocks(rings, tables, block_count(len(sine), around)), jnp.inf, len(sine) * around)


@final
class MidpointProduct(AbstractLightRule):
    """Midpoints: `order` polar angles, 2 order azimuths, all evenly spaced. ValueError for an order below 1."""

    order: int = eqx.field(static=True)
    name: ClassVar[str] = "midpoint-product"
    family: ClassVar[str] = "product"
    ladder: ClassVar[tuple[Any, ...]] = (4, 8, 16, 32, 64, 128, 256, 512)
    symmetric: ClassVar[bool] = True

    def __init__(self, order: int = 64):
        self.order = checked_count(order, "order")

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        angle = np.pi / 2 * (np.arange(self.order) + 0.5) / self.order
        sine, cosine = np.sin(angle), np.cos(angle)
        return _product(core, wi, sine, cosine, np.pi**2 / self.order * sine * cosine, 2 * self.order)


@final
class GaussProduct(AbstractLightRule):
    """Gauss-Legendre in N.wo with `order` nodes, midpoints in 2 order azimuths. ValueError for an order below 1."""

    order: int = eqx.field(static=True)
    name: ClassVar[str] = "gauss-product"
    family: ClassVar[str] = "product"
    ladder: ClassVar[tuple[Any, ...]] = (4, 8, 16, 32, 64, 128, 256, 512)
    symmetric: ClassVar[bool] = True

    def __init__(self, order: int = 32):
        self.order = checked_count(order, "order")

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        z, weight = gauss(self.order)
        return _product(core, wi, np.sqrt((1 - z) * (1 + z)), z, 2 * np.pi * weight * z, 2 * self.order)
