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

from brdfcheck.brdf import Form
from brdfcheck.quadrature.polar import Order, grazing_safe, polar_nodes


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

    `cos_theta` is a scalar; `breaks` (versines), `width` (radians) and `orders` as in `polar_nodes`.
    """
    mu, sine = grazing_safe(cos_theta)
    node, owner = polar_nodes(form, cos_theta, breaks, width, orders)
    member = jnp.asarray(owner == np.arange(len(orders))[:, None], mu.dtype)
    if form == "mirror":
        return node.versine, member * (node.weight * 2 * (node.azimuth * mu * node.cos + node.horizon))
    cos_squared, sin_squared = node.coversine / 2, node.versine / 2  # of gamma = x / 2
    full = node.azimuth * (mu * mu * node.cos + sine * sine * sin_squared)
    # Kept above the root of the smallest number: the derivative of a quotient squares its denominator.
    least = 4 * float(jnp.finfo(mu.dtype).tiny) ** 0.5
    kernel = full + mu * node.horizon * (2 + 3 * node.cos) / (4 * jnp.maximum(cos_squared, least))
    return sin_squared / (1 + jnp.sqrt(cos_squared)), member * (node.weight * 2 * kernel)
