"""The white furnace: what a pixel reflects of a uniform surrounding, integrated at that pixel from the BRDF's own values.

An independent eye on energy: f(wi, wo) (N.wi) is summed over directions of the light, with nodes that follow the lobe and
end at the horizon. For a reciprocal BRDF the pixel is its directional albedo at the pixel's angle; where that is 1 the
surface vanishes into its surroundings, where it is more the surface glows.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.brdf.base import AbstractBRDF, AbstractMicrofacetLobe, AbstractZonalLobe
from brdfcheck.brdf.factors import peel
from brdfcheck.geometry import safe_root
from brdfcheck.numerics import gauss
from brdfcheck.quadrature.polar import Order, grazing_safe, polar_nodes
from brdfcheck.scene.fresnel import FRESNELS
from brdfcheck.scene.vectors import TINY

# Nodes for 1e-5 with the catalogue's lobes: polar ones in each smooth piece, and in azimuth in each piece of half a circle.
_POLAR, _AZIMUTH = Order(20, 40), 8
_FACET_POLAR, _FACET_AZIMUTH = Order(24, 40), 14
_SHARP_POLAR, _SHARP_AZIMUTH = Order(18, 24), 5  # V-cavities: six panels, three pieces
# Evaluations at once: what stays in a processor's cache.
_BLOCK = 2**17


def directional_albedo(
    brdf: AbstractBRDF, cosine: Float[Array, "..."], fresnel: str = "none", tint: Any = 1.0
) -> Float[Array, "..."]:
    """The integral of f(wi, wo) (N.wi) over wi at each cosine N.wo, > 0: a field of that shape, or (3, ...) with channels.

    With `fresnel`, one of `brdfcheck.scene.fresnel.FRESNELS`, the BRDF is multiplied by it, `tint` at normal incidence.
    Accurate to 1e-5 for the catalogue in float64, to 1e-4 in float32. TypeError for a BRDF of no known kind.
    """
    brdf = jax.tree.map(lambda leaf: leaf.astype(cosine.dtype) if eqx.is_inexact_array(leaf) else leaf, brdf)
    core = peel(brdf)[0]
    if not isinstance(core, (AbstractZonalLobe, AbstractMicrofacetLobe)):
        raise TypeError(f"a furnace integrates lobes of this package; got {type(core).__name__}")
    facets = isinstance(core, AbstractMicrofacetLobe)
    form = "half" if isinstance(core, AbstractMicrofacetLobe) else core.form
    polar, around = (_FACET_POLAR, _FACET_AZIMUTH) if facets else (_POLAR, _AZIMUTH)
    if getattr(core, "masking", "") == "v-cavities":
        polar, around = _SHARP_POLAR, _SHARP_AZIMUTH
    turn, share = (jnp.asarray(table, cosine.dtype) for table in gauss(around))

    def pixel(mu: Array) -> Array:
        mu, sine = grazing_safe(mu)
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
        if form == "mirror":  # about R, from the side of the normal
            axis, up = jnp.stack([-sine, 0 * mu, mu]), jnp.stack([mu, 0 * mu, sine])
            # The sine from the versine: from the cosine, a sharp lobe's angles would keep three digits in float32.
            first, second = node.cos, safe_root(node.versine * node.coversine)
        else:
            axis, up = jnp.array([0, 0, 1], mu.dtype), jnp.array([1, 0, 0], mu.dtype)
            first, second = safe_root(node.coversine / 2), safe_root(node.versine / 2)
        side = jnp.array([0, 1, 0], mu.dtype)
        across = jnp.cos(azimuth)[..., None] * up + jnp.sin(azimuth)[..., None] * side
        light = first[:, None, None] * axis + second[:, None, None] * across
        view = jnp.stack([sine, 0 * mu, mu])
        if form == "half":  # L = 2 (V.H) H - V, dL = 4 (V.H) dH, dH = sin x dx / (4 cos x/2)
            view_half = light @ view
            weight = weight * jnp.maximum(view_half, 0) / first[:, None]
            light = 2 * view_half[..., None] * light - view
        up_light = jnp.maximum(light[..., 2], 0)
        useful = up_light > 0
        light = jnp.where(useful[..., None], light, jnp.array([0, 0, 1], mu.dtype))
        value = brdf(light, jnp.broadcast_to(view, light.shape))
        if fresnel != "none":
            share_reflected = FRESNELS[fresnel](geometry.half_cosine(light, view)[..., None], tint)
            value = (value if value.ndim > weight.ndim else value[..., None]) * share_reflected
        weight = jnp.where(useful, weight * up_light, 0)
        return jnp.sum(value * (weight[..., None] if value.ndim > weight.ndim else weight), axis=(0, 1))

    flat = cosine.reshape(-1)
    nodes = 3 * around * sum(polar[:2]) * jax.eval_shape(core.breaks, *([flat[0]] if facets else [])).size
    batch = max(min(_BLOCK // nodes, flat.size), 1)
    # Whole batches: the program of a remainder would be compiled besides.
    padded = jnp.pad(flat, (0, -flat.size % batch), mode="edge")
    found = jax.lax.map(pixel, padded, batch_size=batch)[: flat.size]
    return jnp.moveaxis(found, 0, -1).reshape(*found.shape[1:], *cosine.shape)
