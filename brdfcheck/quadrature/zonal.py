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

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import Form
from brdfcheck.quadrature.polar import EDGE_SHARE, Order, grazing_safe, polar_nodes


def weighted_sums(xp: Any, profile: Any, weight: Any) -> Any:
    """The albedo by each rule, with `xp` numpy or jax.numpy: (..., nodes), (..., rules, nodes) -> (..., rules).

    An overflow of the profile meets weights that are 0, those of the other rule; the sum is infinite all the same, not NaN.
    """
    sums = (weight @ profile[..., None])[..., 0]
    return xp.where(xp.any(xp.isinf(profile), axis=-1)[..., None], xp.inf, sums)


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
