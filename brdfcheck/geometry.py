"""Directions in the local frame of a surface point, and the angles between them.

The normal is ``N = +z``. ``wi`` points to the light, ``wo`` to the viewer; both are unit vectors of shape ``(..., 3)``.
Angles close to zero are handled as *versines*, ``1 - cos(angle)``: the cosine of a small angle keeps no digits of the
angle, the versine keeps all of them.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

# Smaller squared lengths than this are the zero vector: its direction is undefined. Representable in float32.
_TINY = 1e-30


def safe_root(square: Array) -> Array:
    """sqrt with the derivative 0 at 0 and below, where it is 0."""
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1)), 0)


def direction(cos_theta: Float[Array, "..."], azimuth: Float[Array, "..."] | float = 0.0) -> Float[Array, "... 3"]:
    """Unit vectors at the polar angle acos(cos_theta) and the azimuth (radians); shapes broadcast to ``(..., 3)``."""
    cos_theta, azimuth = jnp.broadcast_arrays(jnp.asarray(cos_theta), jnp.asarray(azimuth))
    sin_theta = jnp.sqrt(jnp.maximum((1 - cos_theta) * (1 + cos_theta), 0))
    return jnp.stack([sin_theta * jnp.cos(azimuth), sin_theta * jnp.sin(azimuth), cos_theta], axis=-1)


def frame_about(x: Array, y: Array, z: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Two unit vectors, by their components, that are orthogonal to (x, y, z) of length 1 and to each other.

    For any vector, without a special case (Duff et al. 2017, Building an orthonormal basis, revisited).
    """
    sign = jnp.where(z < 0, -1, 1).astype(z.dtype)
    a = -1 / (sign + z)
    b = x * y * a
    return (1 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


def mirror_direction(wi: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """The mirror direction R = 2 (N.L) N - L, shape ``(..., 3)``."""
    return wi * jnp.array([-1, -1, 1], wi.dtype)


def mirror_versine(wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
    """1 - R.V for the mirror direction R of `wi`, in [0, 2]. Equal to |R - V|^2 / 2, which keeps small angles."""
    difference = mirror_direction(wi) - wo
    return jnp.sum(difference * difference, axis=-1) / 2


def half_versine(wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
    """1 - N.H for the half vector H, in [0, 1] for directions above the surface.

    Two opposite directions along the surface have no half vector; they are the limit of mirror pairs, so the value
    there is 0.
    """
    total = wi + wo
    across = total[..., 0] ** 2 + total[..., 1] ** 2
    square = across + total[..., 2] ** 2
    length = jnp.sqrt(jnp.where(square > _TINY, square, 1))
    return jnp.minimum(jnp.where(square > _TINY, across / (length * (length + total[..., 2])), 0), 1)


def half_cosine(wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
    """wi.H = wo.H = |wi + wo| / 2, in [0, 1]."""
    total = wi + wo
    square = jnp.sum(total * total, axis=-1)
    return jnp.where(square > _TINY, jnp.sqrt(jnp.where(square > _TINY, square, 1)) / 2, 0)


def above_horizon(wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Array:
    """True where neither direction lies below the surface, shape ``(...)``."""
    return (wi[..., 2] >= 0) & (wo[..., 2] >= 0)


def reflected(travel: Float[Array, "..."], normal: Float[Array, "..."], axis: int = -1) -> Float[Array, "..."]:
    """Where light that travels along `travel` goes after a mirror with the unit normal `normal`: d - 2 (d.N) N.

    The components lie along `axis`, the last one or the first.
    """
    return travel - 2 * jnp.sum(travel * normal, axis=axis, keepdims=True) * normal


def refracted(
    travel: Float[Array, "..."], normal: Float[Array, "..."], ratio: Float[Array, "..."], axis: int = -1
) -> tuple[Float[Array, "..."], Array]:
    r"""Snell's law: (unit direction behind the boundary, whether there is one).

    Unit `travel` towards the boundary, unit `normal` against it (d.N < 0), `ratio` the index of the near side over that of
    the far side, of the shape of one component. $t = e\,d + (e c - \sqrt{1 - e^2 (1 - c^2)}) N$, $c = -d \cdot N$. Where the
    radicand is negative all light is reflected: the flag is False, and the direction the mirror's, which is finite.
    """
    cosine = -jnp.sum(travel * normal, axis=axis)
    # 1 - e^2 (1 - c^2), written so that grazing rays keep their digits where e is 1 or nearly so.
    radicand = (1 - ratio) * (1 + ratio) + (ratio * cosine) ** 2
    passes = radicand > 0
    far_cosine = jnp.sqrt(jnp.where(passes, radicand, 1))
    along = jnp.expand_dims(jnp.where(passes, ratio, 1), axis)
    across = jnp.expand_dims(jnp.where(passes, ratio * cosine - far_cosine, 2 * cosine), axis)
    return along * travel + across * normal, passes
