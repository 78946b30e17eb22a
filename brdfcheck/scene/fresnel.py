"""How much of the light a smooth boundary reflects: exact, and Schlick's stand-in. Plain functions of arrays."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from brdfcheck.brdf.microfacet import fresnel_dielectric as exact_of_f0
from brdfcheck.brdf.microfacet import fresnel_schlick as schlick
from brdfcheck.scene.vectors import TINY

FRESNELS = {"exact": exact_of_f0, "schlick": schlick}
"""By name: functions of (cosine, reflectance at normal incidence), each in [0, 1]."""


def exact(cosine: Float[Array, "..."], eta: Float[Array, "..."]) -> Float[Array, "..."]:
    r"""Unpolarised reflectance of a dielectric boundary, at the cosine on the near side; 1 past total internal reflection.

    $F = \frac12 (\frac{g-c}{g+c})^2 \{1 + [\frac{c(g+c)-1}{c(g-c)+1}]^2\}$, $g^2 = \eta^2 + c^2 - 1$ (Cook & Torrance
    1982), `eta` the index of the far side over that of the near side, > 0. Shapes broadcast.
    """
    c, square = cosine, eta * eta + cosine * cosine - 1
    passes = square > 0
    g = jnp.sqrt(jnp.where(passes, square, 1))  # a safe value before the root: the branch not taken has a gradient too
    across = (g - c) / jnp.maximum(g + c, TINY)
    along = (c * (g + c) - 1) / (c * (g - c) + 1)
    return jnp.where(passes, across**2 * (1 + along**2) / 2, 1)
