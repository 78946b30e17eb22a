"""The white furnace: what a pixel reflects of a uniform surrounding, integrated at that pixel from the BRDF's own values.

An independent eye on energy: f(wi, wo) (N.wi) is summed over directions of the light, with nodes that follow the lobe and
end at the horizon. For a reciprocal BRDF the pixel is its directional albedo at the pixel's angle; where that is 1 the
surface vanishes into its surroundings, where it is more the surface glows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.brdf.base import AbstractBRDF, AbstractHalves, AbstractMicrofacetLobe, of_type
from brdfcheck.geometry import safe_root
from brdfcheck.numerics import gauss
from brdfcheck.quadrature.half_vector import HalfVector
from brdfcheck.quadrature.polar import Order, grazing_safe, polar_nodes
from brdfcheck.quadrature.proposals import LobeGeometry
from brdfcheck.quadrature.warped import TanhSinh
from brdfcheck.scene.shading import FRESNELS
from brdfcheck.scene.vectors import TINY

# Nodes for 1e-5 with the catalogue's lobes: polar ones in each smooth piece, and in azimuth in each piece of half a circle.
_POLAR, _AZIMUTH = Order(20, 40), 8
_FACET_POLAR, _FACET_AZIMUTH = Order(24, 40), 14
_SHARP_POLAR, _SHARP_AZIMUTH = Order(18, 24), 5  # V-cavities: six panels, three pieces
_HALVES = 5.0  # digits, for what transmits
_LEVEL = 3  # of BRDFs that do not say where they live
# Evaluations at once: what stays in a processor's cache.
_BLOCK = 2**17


def directional_albedo(
    brdf: AbstractBRDF,
    cosine: Float[Array, "..."],
    fresnel: str = "none",
    tint: Any = 1.0,
    turn: Float[Array, "2 ..."] | None = None,
) -> Float[Array, "..."]:
    """The integral of f(wi, wo) (N.wi) over wi at each cosine N.wo, > 0: a field of that shape, or (3, ...) with channels.

    With `fresnel`, one of `FRESNELS`, the BRDF is multiplied by it, `tint` at normal incidence. Accurate to 1e-5 for the
    catalogue in float64, to 1e-4 in float32. Of a BRDF that does not say where it lives the nodes crowd about the mirror
    direction, and `turn` is the cosine and sine of the azimuth of wo, by default 0.

    Of what transmits it is R + T for light from wo: what a furnace shows whose radiance over the square of the index is the
    same on both sides.
    """
    brdf = of_type(brdf, cosine.dtype)
    core: Any = brdf.core
    if fresnel == "none" and isinstance(core, AbstractHalves):
        engine = HalfVector(_HALVES)
        return _at_each(lambda mu: engine.integrate(core, mu).value, (cosine,), _BLOCK // 8)
    if not hasattr(core, "breaks"):
        return _of_any(brdf, cosine, fresnel, tint, turn)
    facets = isinstance(core, AbstractMicrofacetLobe)
    form = "half" if facets else core.form
    polar, around = (_FACET_POLAR, _FACET_AZIMUTH) if facets else (_POLAR, _AZIMUTH)
    if getattr(core, "masking", "") == "v-cavities":
        polar, around = _SHARP_POLAR, _SHARP_AZIMUTH
    turn, share = (jnp.asarray(table, cosine.dtype) for table in gauss(around))

    def pixel(mu: Array) -> Array:
        mu, sine = grazing_safe(mu)
        lobe = LobeGeometry(core, mu)  # `wi` of it is the view: the light lies about it
        breaks = core.breaks(mu) if isinstance(core, AbstractMicrofacetLobe) else core.breaks()
        node, _ = polar_nodes(form, mu, breaks, core.width(), (polar,))
        stops = jnp.stack([jnp.zeros_like(node.azimuth), node.azimuth])
        if isinstance(core, AbstractMicrofacetLobe):  # masking has kinks in azimuth, known as values of V.H
            up, out = safe_root(node.coversine / 2), safe_root(node.versine / 2)
            kinks = (core.azimuth_breaks(up, mu) - up * mu) / jnp.maximum(out * sine, TINY)
            inside = jnp.abs(kinks) < 1  # elsewhere the derivative of the arc cosine is infinite
            turns = jnp.where(inside, jnp.arccos(jnp.where(inside, kinks, 0)), jnp.where(kinks < 0, np.pi, 0.0))
            stops = jnp.insert(stops, 1, jnp.minimum(turns.astype(mu.dtype), node.azimuth), axis=0)
        length = jnp.maximum(stops[1:] - stops[:-1], 0)[..., None]
        # (nodes, azimuths of all pieces)
        azimuth, weight = (
            jnp.moveaxis(part, 0, 1).reshape(node.weight.size, -1)
            for part in (stops[:-1, :, None] + length * turn, 2 * node.weight[:, None] * length * share)
        )
        if form == "mirror":  # the sine from the versine: from the cosine, sharp lobes would keep three digits in float32
            across, along = safe_root(node.versine * node.coversine)[:, None], node.cos[:, None]
            x, y = across * jnp.cos(azimuth), across * jnp.sin(azimuth)
            light = jnp.stack([mu * x - sine * along, y, sine * x + mu * along], axis=-1)
            useful = light[..., 2] > 0
        else:  # x is twice the angle of H, and dH = sin x dx dphi / (4 cos x/2)
            up = safe_root(node.coversine / 2)[:, None]
            light, jacobian = lobe.directions(node.versine[:, None] / 2 / (1 + up), azimuth)
            useful, weight = jacobian > 0, weight * jacobian / (4 * up)
        light = jnp.where(useful[..., None], light, jnp.array([0, 0, 1], mu.dtype))
        value = _seen(brdf, light, jnp.broadcast_to(lobe.wi, light.shape))
        value = _times_fresnel(value, light, lobe.wi, fresnel, tint)
        weight = jnp.where(useful, weight * light[..., 2], 0)
        return jnp.sum(value * (weight[..., None] if value.ndim > weight.ndim else weight), axis=(0, 1))

    nodes = 3 * around * sum(polar[:2]) * jax.eval_shape(core.breaks, *([cosine.reshape(-1)[0]] if facets else [])).size
    return _at_each(pixel, (cosine,), nodes)


def _seen(brdf: AbstractBRDF, light: Array, view: Array) -> Array:
    """f(light, view); of what has the energy of a BSDF lit from one side, what becomes of light from the view."""
    return brdf(view, light) if getattr(brdf, "folded", False) else brdf(light, view)


def _times_fresnel(value: Array, light: Array, view: Array, fresnel: str, tint: Any) -> Array:
    if fresnel == "none":
        return value
    cosine = geometry.half_cosine(light, view)
    return (value if value.ndim > cosine.ndim else value[..., None]) * FRESNELS[fresnel](cosine[..., None], tint)


def _of_any(brdf: AbstractBRDF, cosine: Array, fresnel: str, tint: Any, turn: Array | None) -> Array:
    rule = TanhSinh(_LEVEL)
    turns = jnp.stack([jnp.ones_like(cosine), jnp.zeros_like(cosine)]) if turn is None else turn

    def pixel(mu: Array, c: Array, s: Array) -> Array:
        mu, sine = grazing_safe(mu)

        def gathered(view: Array, light: Array) -> Array:
            """The rule sums over its second direction; the view is at the azimuth 0 of the rule."""
            light, view = (
                jnp.stack([c * one[..., 0] - s * one[..., 1], s * one[..., 0] + c * one[..., 1], one[..., 2]], axis=-1)
                for one in (light, view)
            )
            return _times_fresnel(_seen(brdf, light, view), light, view, fresnel, tint)

        return rule.seen(gathered, jnp.stack([sine, 0 * mu, mu]), None).value

    return _at_each(pixel, (cosine, *turns), 2 ** (2 * _LEVEL + 7))


def _at_each(pixel: Callable[..., Array], fields: tuple[Array, ...], nodes: int) -> Array:
    """The pixel's value, or its channels first, at all pixels: as many at once as `nodes` each allow."""
    flat = [field.reshape(-1) for field in fields]
    batch = max(min(_BLOCK // nodes, flat[0].size), 1)
    # Whole batches: the program of a remainder would be compiled besides.
    padded = [jnp.pad(field, (0, -field.size % batch), mode="edge") for field in flat]
    found = jax.lax.map(lambda one: pixel(*one), tuple(padded), batch_size=batch)[: flat[0].size]
    return jnp.moveaxis(found, 0, -1).reshape(*found.shape[1:], *fields[0].shape)
