"""The exact image of a sphere: its normal is computed in every pixel, no mesh comes between."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from brdfcheck.scene.cameras import WHOLE, AbstractCamera, Orthographic, Part, Size, checked_size
from brdfcheck.scene.lights import AbstractLight
from brdfcheck.scene.shading import AbstractMaterial, shade
from brdfcheck.scene.vectors import Vector, backdrop_of, dot, spread, verified

_USUAL_EYE = (0.0, 0.0, 5.0)


def sphere_image(
    material: AbstractMaterial,
    lights: Sequence[AbstractLight],
    camera: AbstractCamera | None = None,
    *,
    size: Size = (512, 512),
    center: Any = (0.0, 0.0, 0.0),
    radius: Any = 1.0,
    background: Any = 0.0,
    dtype: Any = jnp.float32,
) -> Float[Array, "3 height width"]:
    """Linear RGB of a sphere, shape (3, height, width), top row first, computed in `dtype`; one compiled program.

    A pixel shows what its centre sees. `camera`: by default `Orthographic()`, which sees the unit sphere with a margin.
    `background`: a number, RGB or an image (3, height, width). Under `jax.vmap` over materials, lights or positions a
    contact sheet is one program too. Raises ValueError for a camera inside the sphere or bad values, and what `shade` raises.
    """
    size = checked_size(size)
    center = verified(center, "center", -np.inf, shapes=[(3,)], what="three components, x, y and z")
    radius = verified(radius, "radius", above=True, shapes=[()], what="one number")
    background = backdrop_of(background, size)
    refuse_inside(_USUAL_EYE if camera is None else camera.eye, center, radius, "the sphere")
    return _image(material, tuple(lights), camera, (center, radius, background), size, jnp.dtype(dtype))


def refuse_inside(eye: Any, center: Any, radius: Any, what: str) -> None:
    """ValueError where the eye is inside a sphere."""
    if not any(isinstance(part, Tracer) for part in (center, radius, eye)):
        distance = float(np.linalg.norm(np.asarray(eye, float) - np.asarray(center, float)))
        if not distance > float(radius):
            raise ValueError(f"the camera is inside {what}: {distance:.4g} from its center, radius {float(radius):.4g}")


def seen_sphere(
    camera: AbstractCamera | None, center: Float[Array, " 3"], radius: Float[Array, ""], size: Size, part: Part = WHOLE
) -> tuple[Bool[Array, "height width"], Vector, Vector, Vector]:
    """(hit, point, normal, view) in a part of the image: fields (height, width), or numbers where all pixels have the same.

    Where the sphere is missed the normal is finite and means nothing.
    """
    dtype = center.dtype
    if camera is None or isinstance(camera, Orthographic):
        usual = Orthographic() if camera is None else camera
        (right, up, depth), _ = usual.in_frame(center)
        height, width = size
        scale = 2 * usual.half_height.astype(dtype) / height
        x = (jnp.arange(width, dtype=dtype)[part[1]][None, :] + (0.5 - width / 2)) * scale - right
        y = ((height / 2 - 0.5) - jnp.arange(height, dtype=dtype)[part[0]][:, None]) * scale - up
        square, root = _half_chord(radius, x * x + y * y)
        # The usual camera looks along z: Python numbers, of which the program has no trace.
        view = Vector(0.0, 0.0, 1.0)
        normal = Vector(x, y, root)
        if camera is not None:
            axes = camera.frame(dtype)[1].T
            view = Vector(*axes[:, 2])
            normal = Vector(*(dot(row, normal) for row in axes))
    else:
        origin, way = (Vector(*part) for part in camera.rays(size, dtype, part))
        arm = origin - Vector(*center)
        depth = -dot(arm, way)
        off = arm + way * depth  # from the center to the ray, square to it
        square, root = _half_chord(radius, dot(off, off))
        view = way * -1
        normal = off + view * root
    normal = normal * (1 / radius)
    return (square > 0) & (depth > root), Vector(*center) + normal * radius, normal, view


def _half_chord(radius: Array, square: Array) -> tuple[Array, Array]:
    """Of a ray at the squared distance `square` from the center: its square, and itself; a safe value where it misses."""
    left = radius * radius - square
    return left, jnp.sqrt(jnp.where(left > 0, left, radius * radius))


@functools.partial(jax.jit, static_argnums=(4, 5))
def _image(
    material: AbstractMaterial,
    lights: tuple[AbstractLight, ...],
    camera: AbstractCamera | None,
    numbers: tuple[Any, Any, Any],
    size: Size,
    dtype: Any,
) -> Array:
    center, radius, background = (jnp.asarray(part, dtype) for part in numbers)
    hit, point, normal, view = seen_sphere(camera, center, radius, size)
    background = background if background.ndim else background[None]
    return jnp.where(hit, shade(material, lights, point, normal, view), spread(background, 2))
