r"""The light of a room at the object in it.

A room is a cube with the object, which is small against it, in its middle: it neither shades nor lights the walls, and what
arrives at all its points is what arrives there. Of the radiance L(w) the irradiance of a surface with the normal n keeps its
mean, its direction and its second moments, the first three terms of the cosine lobe in Legendre polynomials,
$\max(x, 0) = 1/4 + x/2 + \frac{5}{32}(3x^2 - 1) + ...$, x = w.n: all but about 1 % of it (Ramamoorthi & Hanrahan 2001).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.budgets.scenes import Room
from brdfcheck.numerics import gauss
from brdfcheck.scene.vectors import Vector
from brdfcheck.transport import box

# The wall y = b of the box: upwards in the image of the usual camera.
_CEILING = 3
_NODES = 16
# Products of two components, by their places in a symmetric matrix.
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def room_numbers(room: Room) -> dict[str, Any]:
    """Form factors, emission and reflectance of the walls; the moments of each patch over the sphere of directions.

    `moments`, shape (patches, 10): the integrals of 1, of x, y, z and of xx, yy, zz, xy, xz, yz over the solid angle that the
    patch fills as seen from the middle, over pi: what a radiosity of 1 contributes to those of the radiance.
    """
    cube = box(cells=room.cells)
    nodes, weights = gauss(_NODES)
    u = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 2)
    each = (weights[:, None] * weights).reshape(-1)
    patches = np.repeat(np.arange(cube.patches, dtype=np.int32), len(u))
    point, normal = cube.point(jnp.asarray(patches), jnp.asarray(np.tile(u, (cube.patches, 1)), cube.areas.dtype))
    way = np.asarray(point, float) - 0.5
    distance = np.linalg.norm(way, axis=-1, keepdims=True)
    solid = -np.sum(np.asarray(normal, float) * way, axis=-1) / distance[:, 0] ** 3
    way = way / distance
    terms = np.stack([np.ones(len(way)), *way.T, *(way[:, i] * way[:, j] for i, j in _PAIRS)], axis=-1)
    sums = np.einsum("pq,pqm->pm", solid.reshape(-1, len(u)) * each, terms.reshape(cube.patches, len(u), -1))
    return {
        "factors": cube.form_factors,
        "emission": cube.on_wall(_CEILING, room.emission),
        "reflectance": jnp.asarray(room.reflectance, cube.areas.dtype),
        "moments": jnp.asarray(sums * np.asarray(cube.areas)[:, None] / np.pi),
    }


def radiosity(numbers: Mapping[str, Any], bounces: Any) -> Float[Array, " patches"]:
    """B = E + rho F B after so many bounces (a number that may be traced), or solved for all of them where it is None."""
    factors, emission = numbers["factors"], numbers["emission"]
    if bounces is None:
        return jnp.linalg.solve(jnp.eye(len(emission), dtype=emission.dtype) - numbers["reflectance"] * factors, emission)
    return jax.lax.fori_loop(0, bounces, lambda _, value: emission + numbers["reflectance"] * (factors @ value), emission)


def at_middle(numbers: Mapping[str, Any], bounces: Any) -> Float[Array, " 10"]:
    """The moments of the radiance in the middle of the room after so many bounces, or after all of them."""
    return radiosity(numbers, bounces) @ numbers["moments"]


def irradiance(moments: Float[Array, " 10"], normal: Vector) -> Float[Array, "..."]:
    """The irradiance at unit normals, from the moments of the radiance in the middle."""
    whole, first, second = moments[0], Vector(*moments[1:4]), moments[4:]
    square = sum(second[k] * (1 if i == j else 2) * (normal[i] * normal[j]) for k, (i, j) in enumerate(_PAIRS))
    along = first.x * normal.x + first.y * normal.y + first.z * normal.z
    return jnp.maximum((3 * whole + 15 * square) / 32 + along / 2, 0)
