r"""The exact-azimuth rule: the albedo of a lobe about one axis is a one-dimensional integral.

E = int g(x) M(x) sin x dx, where M is the azimuth integral of the cosine (and of the Jacobian of the half vector),
elementary in terms of the azimuth half range p of `polar`:

* mirror form: M = 2 (p cos(theta) cos x + h), h = cos(d) sin(f);
* half form, x = 2 gamma:
  M = 2 {p [cos^2(theta) cos x + sin^2(theta) sin^2 gamma] + cos(theta) h (2 + 3 cos x)/(4 cos^2 gamma)}.

Both are derived from int (N.V) dwo in coordinates about the axis; for the half form dwo = 4 (wi.H) dH and
N.V = 2 (wi.H) (N.H) - cos(theta).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractZonalLobe, Form
from brdfcheck.quadrature.polar import EDGE_SHARE, Order, grazing_safe, polar_nodes
from brdfcheck.quadrature.rule import AbstractDigits, Raw, bar


@final
class Zonal(AbstractDigits):
    """Engine 1: exact azimuth, one-dimensional, for lobes about an axis.

    `digits`: the decimal digits aimed at, 12 by default. The error is the difference of two rules, and rounding.
    """

    name: ClassVar[str] = "zonal"
    family: ClassVar[str] = "zonal"
    ladder: ClassVar[tuple[Any, ...]] = (1, 2, 3, 4, 6, 8, 10, 12)
    needs: ClassVar[str] = "a lobe about an axis"
    best: ClassVar[float] = 1e-12
    effort: ClassVar[int] = 0
    batch: ClassVar[int] = 256
    chunk: ClassVar[int] = 64

    def applies(self, core: Any, cos_theta: Any) -> bool:
        return isinstance(core, AbstractZonalLobe)

    def orders(self, dtype: Any) -> tuple[Order, Order]:
        """Nodes inside the full circles and past the horizon, of the fine rule and of the coarse one."""
        # The counts at which the worst lobe of the catalogue (Schlick at n = 1e7, cos^0.05) has that many digits.
        digits = self.within(dtype)
        coarse = (math.ceil(4 * digits), math.ceil(14 + 5.5 * digits))
        return Order(coarse[0] + 16, coarse[1] + 16), Order(*coarse)

    def integrate(self, core: AbstractZonalLobe, mu: Float[Array, ""], key: Any = None) -> Raw:
        versine, weight = zonal_weights(core.form, mu, core.breaks(), core.width(), self.orders(mu.dtype))
        value, error = weighted(jnp, core.profile(versine), versine, weight)
        amplitude = core.amplitude()
        return Raw(value * amplitude, error * jnp.abs(amplitude), versine.size)


def weighted(xp: Any, profile: Any, versine: Any, weight: Any) -> tuple[Any, Any]:
    """(albedo, error) from the nodes of two rules, with `xp` numpy or jax.numpy.

    Shapes: (..., nodes) twice, (..., rules, nodes) -> (...) twice.
    """
    epsilon = float(xp.finfo(versine.dtype).eps)
    # An overflow of the profile meets weights that are 0, those of the other rule; the sum is infinite all the same, not NaN.
    sums = (weight @ profile[..., None])[..., 0]
    sums = xp.where(xp.any(xp.isinf(profile), axis=-1)[..., None], xp.inf, sums)
    # Towards 90 degrees the nodes keep absolute, not relative, accuracy in cos: only the unclamped lobe notices.
    rounding = xp.sum(xp.abs(weight[..., 0, :] * profile / xp.maximum(1 - versine, epsilon)), axis=-1)
    return sums[..., 0], bar(sums[..., 0], sums[..., 1], 4 * epsilon * rounding, xp=xp)


def zonal_weights(
    form: Form, cos_theta: Float[Array, ""], breaks: Float[Array, " breaks"], width: Array, orders: tuple[Order, ...]
) -> tuple[Float[Array, " nodes"], Float[Array, "rules nodes"]]:
    """Versines and, for each rule, weights such that the albedo of a lobe is the sum of weight * profile(versine).

    `cos_theta` is a scalar; `breaks` (versines), `width` (radians) and `orders` as in `polar_nodes`. The derivative in it at
    normal incidence is the limit of those beside it, for profiles that are continuous next to the horizon.
    """
    mu, sine = grazing_safe(cos_theta)
    node, owner = polar_nodes(form, cos_theta, breaks, width, orders)
    member = jnp.asarray(owner == np.arange(len(orders))[:, None], mu.dtype)
    if form == "mirror":
        weight = node.weight * 2 * (node.azimuth * mu * node.cos + node.horizon)
        return node.versine, member * weight + _edge(form, mu, sine, breaks, owner, orders)
    cos_squared, sin_squared = node.coversine / 2, node.versine / 2  # of gamma = x / 2
    # The square of the sine has a derivative at normal incidence, where that of the sine has none.
    full = node.azimuth * (mu * mu * node.cos + (1 - mu) * (1 + mu) * sin_squared)
    # Kept above the root of the smallest number: the derivative of a quotient squares its denominator.
    least = 4 * float(jnp.finfo(mu.dtype).tiny) ** 0.5
    kernel = full + mu * node.horizon * (2 + 3 * node.cos) / (4 * jnp.maximum(cos_squared, least))
    weight = member * (node.weight * 2 * kernel) + _edge(form, mu, sine, breaks, owner, orders)
    return sin_squared / (1 + jnp.sqrt(cos_squared)), weight


def _edge(form: Form, mu: Array, sine: Array, breaks: Array, owner: np.ndarray, orders: tuple[Order, ...]) -> Array:
    """Weights that are 0 and whose derivatives at normal incidence are those of the circles past the horizon.

    There these circles have shrunk to one, where the cut nodes all lie; the last of them, one for each rule, speaks for all.
    """
    last = np.stack([np.arange(owner.size) == np.flatnonzero(owner == rule)[-1] for rule in range(len(orders))])
    horizon = 1.0 if form == "mirror" else 1 - float(np.sqrt(0.5))
    reached = breaks[-1] >= horizon - 8 * float(jnp.finfo(mu.dtype).eps)
    share = jnp.where((sine == 0) & reached, EDGE_SHARE[form] * (1 - mu) * (1 + mu), 0)
    return jnp.asarray(last, mu.dtype) * share
