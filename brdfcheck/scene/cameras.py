"""Orthographic and perspective cameras: points to pixels for the rasteriser, pixels to rays for the tracer.

Vector fields are component-first: points of shape (3, ...). Screen coordinates are in pixels, x to the right and y down; the
pixel in row i and column j has its centre at (j + 1/2, i + 1/2). A size is (height, width), and the height of the image is
what the camera's opening says.
"""

from __future__ import annotations

import abc
import functools
from typing import Any, NamedTuple, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from brdfcheck.scene.vectors import polar, scalar, unit, vector_of

Size = tuple[int, int]
Part = tuple[slice, slice]
"""Rows and columns of an image."""

WHOLE: Part = (slice(None), slice(None))

Field = Float[Array, "3 height width"]

# Nothing is seen that is nearer to the eye than this part of the distance to the target.
_NEAR = 1e-3


class Projected(NamedTuple):
    """Points on the screen (2, ...); their nearness (...), affine on the screen, larger in front; what is before the eye."""

    screen: Float[Array, "2 ..."]
    nearness: Float[Array, "..."]
    in_front: Bool[Array, "..."]


def checked_size(size: Size) -> Size:
    """`size` itself; ValueError unless it is (height, width) in whole pixels from 1 to 16384."""
    whole = (isinstance(n, (int, np.integer)) and not isinstance(n, bool) and 1 <= n <= 16384 for n in size)
    if len(size) != 2 or not all(whole):
        raise ValueError(f"size must be (height, width), each from 1 to 16384 pixels; got {size}")
    return int(size[0]), int(size[1])


def pixel_centres(size: Size, dtype: Any, part: Part = WHOLE) -> Float[Array, "2 height width"]:
    """The screen coordinates (x, y) of every pixel in a part of an image."""
    y, x = (jnp.arange(n, dtype=dtype)[some] + 0.5 for n, some in zip(size, part, strict=True))
    return jnp.stack(jnp.broadcast_arrays(x[None, :], y[:, None]))


_EYE, _TARGET = (functools.partial(vector_of, name=name, zero=True) for name in ("eye", "target"))
_UP = functools.partial(vector_of, name="up")


class AbstractCamera(eqx.Module):
    """An eye that looks at a target, `up` upright in the image. All computing is in the type of the points."""

    eye: Float[Array, "3"] = eqx.field(converter=_EYE, default=(0.0, 0.0, 5.0))
    target: Float[Array, "3"] = eqx.field(converter=_TARGET, default=(0.0, 0.0, 0.0))
    up: Float[Array, "3"] = eqx.field(converter=_UP, default=(0.0, 1.0, 0.0))

    def __check_init__(self) -> None:
        parts = (self.eye, self.target, self.up)
        if not any(isinstance(part, Tracer) for part in parts):
            eye, target, upright = (np.asarray(part, float) for part in parts)
            back = eye - target
            if not np.linalg.norm(np.cross(upright, back)) > 1e-6 * np.linalg.norm(upright) * np.linalg.norm(back):
                given = ", ".join(str(np.asarray(part).tolist()) for part in parts)
                raise ValueError(f"eye, target and up must not lie on one line; got {given}")

    @abc.abstractmethod
    def project(self, points: Float[Array, "3 ..."], size: Size) -> Projected:
        """Where the points lie on the screen."""

    @abc.abstractmethod
    def corrected(self, weights: Float[Array, "3 ..."], nearness: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
        """Weights of the corners of a triangle in space, from those on the screen and the nearness of the corners."""

    @abc.abstractmethod
    def view(self, points: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
        """Unit vectors from the points to the eye."""

    @abc.abstractmethod
    def rays(self, size: Size, dtype: Any, part: Part = WHOLE) -> tuple[Field, Field]:
        """Origins and unit directions of the rays through the pixels of a part of the image."""

    def frame(self, dtype: Any) -> tuple[Float[Array, "3"], Float[Array, "3 3"], Float[Array, ""]]:
        """The eye, the unit vectors to the right, up and from target to eye (the rows of a matrix), the distance between."""
        eye, target, up = (part.astype(dtype) for part in (self.eye, self.target, self.up))
        distance, towards = polar(eye - target)
        back = jnp.stack(towards)
        right = jnp.stack(unit(jnp.cross(jnp.stack(unit(up)), back)))
        return eye, jnp.stack([right, jnp.cross(back, right), back]), distance

    def in_frame(self, points: Float[Array, "3 ..."]) -> tuple[Float[Array, "3 ..."], Float[Array, ""]]:
        """The points from the eye in the camera's axes (right, up, depth before the eye), and the distance to the target."""
        eye, axes, distance = self.frame(points.dtype)
        right, up, back = jnp.tensordot(axes, points - eye.reshape(3, *[1] * (points.ndim - 1)), 1)
        return jnp.stack([right, up, -back]), distance


def _screen(right: Array, up: Array, half_height: Array, size: Size) -> Array:
    height, width = size
    scale = height / (2 * half_height)
    return jnp.stack([width / 2 + right * scale, height / 2 - up * scale])


@final
class Orthographic(AbstractCamera):
    """Parallel rays; the image is 2 `half_height` high in space. ValueError unless the numbers are finite and make a frame."""

    half_height: Float[Array, ""] = eqx.field(converter=functools.partial(scalar, name="half_height", above=True), default=1.05)

    def project(self, points: Float[Array, "3 ..."], size: Size) -> Projected:
        (right, up, depth), distance = self.in_frame(points)
        return Projected(_screen(right, up, self.half_height.astype(points.dtype), size), -depth, depth > _NEAR * distance)

    def corrected(self, weights: Float[Array, "3 ..."], nearness: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
        return weights

    def view(self, points: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
        back = self.frame(points.dtype)[1][2]
        return jnp.broadcast_to(back.reshape(3, *[1] * (points.ndim - 1)), points.shape)

    def rays(self, size: Size, dtype: Any, part: Part = WHOLE) -> tuple[Field, Field]:
        eye, axes, _ = self.frame(dtype)
        across = _across(self.half_height.astype(dtype), size, dtype, part)
        origins = eye[:, None, None] + jnp.tensordot(axes[:2].T, across, 1)
        return origins, jnp.broadcast_to(-axes[2][:, None, None], origins.shape)


@final
class Perspective(AbstractCamera):
    """Rays from the eye; `field_of_view` is the full vertical angle in degrees. ValueError as for `Orthographic`."""

    # Half of it is below 90 degrees in single precision too.
    field_of_view: Float[Array, ""] = eqx.field(
        converter=functools.partial(scalar, name="field_of_view", high=179.99, above=True), default=25.0
    )

    def _half_height(self, dtype: Any) -> Array:
        return jnp.tan(self.field_of_view.astype(dtype) * (np.pi / 360))

    def project(self, points: Float[Array, "3 ..."], size: Size) -> Projected:
        (right, up, depth), distance = self.in_frame(points)
        in_front = depth > _NEAR * distance
        nearness = 1 / jnp.where(in_front, depth, 1)
        return Projected(_screen(right * nearness, up * nearness, self._half_height(points.dtype), size), nearness, in_front)

    def corrected(self, weights: Float[Array, "3 ..."], nearness: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
        # What is affine in space, divided by depth, is affine on the screen; so is 1 / depth itself.
        shares = weights * nearness
        return shares / jnp.sum(shares, axis=0)

    def view(self, points: Float[Array, "3 ..."]) -> Float[Array, "3 ..."]:
        return jnp.stack(unit(self.eye.astype(points.dtype).reshape(3, *[1] * (points.ndim - 1)) - points))

    def rays(self, size: Size, dtype: Any, part: Part = WHOLE) -> tuple[Field, Field]:
        eye, axes, _ = self.frame(dtype)
        across = _across(self._half_height(dtype), size, dtype, part)
        directions = jnp.tensordot(axes[:2].T, across, 1) - axes[2][:, None, None]
        directions = directions / jnp.sqrt(jnp.sum(directions * directions, axis=0))
        return jnp.broadcast_to(eye[:, None, None], directions.shape), directions


def _across(half_height: Array, size: Size, dtype: Any, part: Part) -> Array:
    """Right and up of every pixel from the centre of the image, in units of space."""
    height, width = size
    x, y = pixel_centres(size, dtype, part)
    return jnp.stack([x - width / 2, height / 2 - y]) * (2 * half_height / height)
