r"""The half-vector rule for microfacet lobes: two-dimensional, over the direction of H.

With dwo = 4 (wi.H) dH the albedo is an integral over H of a kernel that lives near the normal whatever the incidence, so
the needle that grazing light makes around the mirror direction is never missed. In the polar angle the nodes are those
of `polar` (split where masking changes form); in azimuth the circle is cut where the kernel has kinks, all known in
closed form as values of wi.H = cos(gamma) cos(theta) + sin(gamma) sin(theta) cos(phi), and at the horizon.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractHalves, AbstractMicrofacetLobe
from brdfcheck.geometry import safe_root
from brdfcheck.quadrature.polar import Order, graded_gauss, grazing_safe, polar_nodes
from brdfcheck.quadrature.rule import AbstractDigits, Raw, bar

_TINY = 1e-18
# How much larger than the difference of two rules the error may be: measured up to 3.4 for very rough facets.
_CAUTION = 6


class HalfVectorOrder(NamedTuple):
    """Nodes in the polar angle of H, and in azimuth for each smooth piece of the circle; how the latter crowd at its ends."""

    polar: Order
    azimuth: int
    grading: tuple[int, int] = (1, 1)


@final
class HalfVector(AbstractDigits):
    """Engine 2: two-dimensional over the half vector, for microfacet lobes.

    `digits`: the decimal digits aimed at, 9.6 by default. The error is six times the difference of two rules, and what was
    aimed at.
    """

    name: ClassVar[str] = "half-vector"
    family: ClassVar[str] = "half-vector"
    ladder: ClassVar[tuple[Any, ...]] = (1, 2, 3, 4, 5, 6, 8, 9)
    needs: ClassVar[str] = "a microfacet lobe"
    best: ClassVar[float] = 2.5e-10
    effort: ClassVar[int] = 1
    batch: ClassVar[int] = 1  # one incidence fills the cache; measured three times faster than sixteen at once
    chunk: ClassVar[int] = 64

    def applies(self, core: Any, cos_theta: Any) -> bool:
        return isinstance(core, (AbstractMicrofacetLobe, AbstractHalves))

    def orders(self, dtype: Any, cut: bool, rooted: bool = False) -> tuple[HalfVectorOrder, HalfVectorOrder]:
        """The fine rule and the coarse one. `cut`: the circle is cut at kinks, so that its pieces are short.

        `rooted`: the kernel is a square root at one end of them.
        """
        digits = self.within(dtype)
        ends = (2, 2) if rooted else (1, 1)
        if rooted:  # five to seven panels, with logarithms where a circle touches that of total reflection
            circle, past, azimuth, grading = 2.8 * digits + 2, 3 * digits + 2, 2.6 * digits + 2, (3, 3)
        elif cut:  # six panels, square roots at their ends, up to three smooth pieces in azimuth
            circle, past, azimuth, grading = 4 * digits, 4.8 * digits, 1.4 * digits, (2, 3)
        else:
            circle, past, azimuth, grading = 4.8 * digits, 9.6 * digits + 12, 4 * digits, (1, 3)
        fine, coarse = (
            HalfVectorOrder(
                Order(math.ceil(part * circle), math.ceil(part * past), grading, (3, 3)), math.ceil(part * azimuth), ends
            )
            for part in (1.0, 0.86)
        )
        return fine, coarse

    def integrate(self, core: AbstractMicrofacetLobe | AbstractHalves, mu: Float[Array, ""], key: Any = None) -> Raw:
        lobes = core.halves() if isinstance(core, AbstractHalves) else (core,)
        value, error, evaluations = jax.tree.map(
            lambda *parts: sum(parts[1:], parts[0]), *(self._one(lobe, mu) for lobe in lobes)
        )
        return Raw(value, error, evaluations)

    def _one(self, lobe: AbstractMicrofacetLobe, mu: Float[Array, ""]) -> tuple[Array, Array, int]:
        cut = lobe.azimuth_breaks(jnp.ones(1, mu.dtype), mu).shape[0] > 0
        (fine, coarse), count = half_vector_albedo(lobe, mu, self.orders(mu.dtype, cut, lobe.rooted))
        # In two dimensions the difference of two rules may vanish by chance; never claim more than what was aimed at.
        aimed = 10 ** -self.within(mu.dtype) * jnp.abs(fine)
        return fine, bar(fine, coarse, aimed, caution=_CAUTION), count


def half_vector_albedo(
    lobe: AbstractMicrofacetLobe, cos_theta: Float[Array, ""], orders: tuple[HalfVectorOrder, ...]
) -> tuple[Float[Array, "rules ..."], int]:
    """(albedo by each rule, kernel evaluations) for one incidence; the albedo has shape (rules,) or (rules, channels).

    At 90 degrees what kinks do as the angle changes is lost in rounding, though not their place: below a cosine of
    epsilon^(3/4), 1.8e-12 in float64 and 6.4e-6 in float32, derivatives are those at that cosine. For Beckmann's facets they
    are the limits from below up to the cosine over m. Under a long tail (GGX) dE/dtheta grows like log(cos theta) and has no
    limit, and below 1e-6 the nodes no longer follow it: there all are those at 6.4e-6 in either precision.

    At normal incidence the derivative of sin(theta) is infinite and what it is multiplied by goes to 0, so that rounding and
    the error of the rule are divided by sin(theta). There, from sqrt(epsilon)/4 below 1 on (4e-9 in float64), derivatives are
    those at that distance, which is where the two errors are of one size.
    """
    count = 0
    precision = jnp.float32 if getattr(lobe, "long_tail", False) else cos_theta.dtype
    before = float(jnp.finfo(precision).eps) ** 0.75
    beside = 1 - float(jnp.finfo(cos_theta.dtype).eps) ** 0.5 / 4

    def integral(lobe: AbstractMicrofacetLobe, cosine: Array) -> Array:
        nonlocal count
        values, count = _integral(lobe, cosine, orders)
        return values

    values = eqx.filter_custom_jvp(integral)

    @values.def_jvp
    def _(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
        lobe, cosine = primals
        shifted = jnp.clip(cosine, before, beside)
        return integral(lobe, cosine), eqx.filter_jvp(integral, (lobe, shifted), tangents)[1]

    return values(lobe, cos_theta), count


def _integral(
    lobe: AbstractMicrofacetLobe, cos_theta: Float[Array, ""], orders: tuple[HalfVectorOrder, ...]
) -> tuple[Float[Array, "rules ..."], int]:
    mu, sine = grazing_safe(cos_theta)
    form = "mirror" if lobe.refracts else "half"
    node, owner = polar_nodes(form, mu, lobe.breaks(mu), lobe.width(), tuple(order.polar for order in orders))
    if lobe.refracts:
        half_cosine, sin_squared = node.cos, node.versine * node.coversine
    else:
        half_cosine, sin_squared = jnp.sqrt(node.coversine / 2), node.versine / 2
    across = half_cosine * mu
    along = safe_root(sin_squared) * sine
    # The kinks in azimuth: wi.H falls while H turns from the light's side (phi = 0) to the other.
    values = lobe.azimuth_breaks(half_cosine, mu)  # (kinks, nodes)
    cosine = (values - across) / jnp.where(along > _TINY, along, 1)
    inside = jnp.abs(cosine) < 1
    kink = jnp.where(inside, jnp.arccos(jnp.where(inside, cosine, 0)), jnp.where(cosine < 0, np.pi, 0))
    if lobe.refracts:  # along the normal a circle lies on one side of the edge as a whole
        kink = jnp.where(along > _TINY, kink, jnp.where(values < across, np.pi, 0.0).astype(kink.dtype))
    zero = jnp.zeros_like(node.azimuth[None])
    stops = jnp.concatenate([zero, jnp.minimum(kink, node.azimuth)])
    if not lobe.refracts:  # past its last kink that one is 0
        stops = jnp.concatenate([stops, node.azimuth[None]])
    # Each piece runs in t = tan(phi/4), as far from the poles at +-i as the angle itself from nothing: the cosine is then
    # arithmetic, where XLA takes longer for a cos than for all the rest of the kernel.
    quarter = jnp.tan(stops / 4)
    low, length = quarter[:-1], jnp.maximum(quarter[1:] - quarter[:-1], 0)

    # Each node takes the azimuth table of its rule, filled up with nodes of weight 0: (azimuths, 1, nodes).
    most = max(order.azimuth for order in orders)
    tables = [
        [np.pad(part, (0, most - order.azimuth)) for part in graded_gauss(order.azimuth, *order.grading)] for order in orders
    ]
    x, w = (jnp.asarray(np.stack(column)[owner].T[:, None], mu.dtype) for column in zip(*tables, strict=True))
    t = low + length * x
    reciprocal = 1 / (1 + t * t)
    half = (1 - t) * (1 + t) * reciprocal  # cos(phi/2)
    incident = jnp.maximum(across + along * (2 * half * half - 1), 0)
    cos_theta_o = jnp.maximum(2 * incident * half_cosine - mu, 0)
    kernel = lobe.facet_kernel(half_cosine, sin_squared, mu, cos_theta_o, incident)
    # Both halves of the circle; where x = 2 gamma, sin(gamma) dgamma = sin x dx / (4 cos gamma).
    weight = w * 4 * length * reciprocal * (2 * node.weight if lobe.refracts else node.weight / (2 * half_cosine))
    if kernel.ndim > weight.ndim:
        weight = weight[..., None]
    terms = jnp.sum(kernel * weight, axis=(0, 1))  # (nodes,) or (nodes, channels)
    member = jnp.asarray(owner == np.arange(len(orders))[:, None], mu.dtype)
    return member @ terms, kernel.size
