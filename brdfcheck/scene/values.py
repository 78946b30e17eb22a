"""Numbers, colours and vectors of a scene, and what is refused about them.

Vectors that differ from pixel to pixel are component-first, three arrays of one shape: XLA fuses and vectorises that
layout. Components that do not differ are plain scalars; what follows from scalars alone is computed once, not per pixel.
"""

from __future__ import annotations

import functools
import operator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.brdf import as_parameter

TINY = 1e-18
"""Kept off exact zeros; its square is a normal float32 number."""


class Vector(NamedTuple):
    """Three components, whose shapes broadcast: arrays or Python numbers."""

    x: Any
    y: Any
    z: Any

    def __add__(self, other: Any) -> Vector:
        return Vector(*(a + b for a, b in zip(self, other, strict=True)))

    def __sub__(self, other: Any) -> Vector:
        return Vector(*(a - b for a, b in zip(self, other, strict=True)))

    def __mul__(self, number: Any) -> Vector:
        return Vector(*(a * number for a in self))


def dot(a: Any, b: Any) -> Array:
    """The scalar product of component-first vectors; a component that is the Python number 0 costs nothing."""
    terms = [p * q for p, q in zip(a, b, strict=True) if not any(isinstance(part, float) and part == 0 for part in (p, q))]
    return functools.reduce(operator.add, terms)


def cross(a: Any, b: Any) -> Vector:
    """The vector product of component-first vectors."""
    return Vector(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a: Any) -> Vector:
    """The vector at length 1, whatever its length; the zero vector stays zero."""
    # Over its largest component first, so that no square leaves the range of float32. The result does not depend on that
    # number, nor do derivatives.
    largest = jax.lax.stop_gradient(functools.reduce(jnp.maximum, (jnp.abs(part) for part in a)))
    a = Vector(*a) * (1 / jnp.where(largest > 0, largest, 1))
    square = dot(a, a)
    return a * (1 / jnp.sqrt(jnp.where(square > 0, square, 1)))


def choose(condition: Array, a: Any, b: Any) -> Vector:
    """Component-first ``where``."""
    return Vector(*(jnp.where(condition, p, q) for p, q in zip(a, b, strict=True)))


def power(base: Float[Array, "..."], n: Float[Array, "..."]) -> Float[Array, "..."]:
    """max(base, 0)^n with 0^0 = 1, as exp(n log base), which XLA vectorises where it does not pow. Finite gradients."""
    positive = base > 0
    return jnp.where(positive, jnp.exp(n * jnp.log(jnp.where(positive, base, 1))), jnp.where(n > 0, 0, 1).astype(base.dtype))


def spread(color: Float[Array, "..."], dimensions: int) -> Float[Array, "..."]:
    """A colour (3,) so that it multiplies fields of so many dimensions; a coloured field (3, ...) as it is."""
    return color.reshape(color.shape + (1,) * dimensions) if color.ndim == 1 else color


def strong(array: Array) -> Array:
    """The array with a type of its own: 10 and 10.0 are the same to a compiled program."""
    return array.astype(array.dtype)


def checked(value: Any, name: str, low: float = 0.0, high: float = np.inf, *, above: bool = False) -> Array:
    """`value` as an array leaf; ValueError where it is not finite or outside [low, high] (`above`: low itself too)."""
    try:
        if isinstance(value, str) or jnp.asarray(value).dtype == bool:
            raise TypeError
        array = strong(as_parameter(value))
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a number; got {value!r}") from None
    if not isinstance(array, Tracer):
        values = np.asarray(array)
        good = np.isfinite(values) & (values <= high) & ((values > low) if above else (values >= low))
        if values.size == 0 or not np.all(good):
            bounds = [f"{'>' if above else '>='} {low:g}"] if low > -np.inf else []
            bounds += [f"<= {high:g}"] if high < np.inf else []
            raise ValueError(f"{name} must be {' and '.join(['finite', *bounds])}; got {value}")
    return array


def scalar(value: Any, name: str, low: float = 0.0, high: float = np.inf, *, above: bool = False) -> Float[Array, ""]:
    """`checked`, and ValueError where it is not one number."""
    array = checked(value, name, low, high, above=above)
    if array.ndim:
        raise ValueError(f"{name} must be one number; got {value if array.size <= 4 else f'shape {array.shape}'}")
    return array


def color_of(value: Any, name: str, high: float = np.inf) -> Float[Array, " 3"]:
    """A number or RGB as shape (3,), linear; ValueError where it is negative, not finite, above `high` or of another shape."""
    array = checked(value, name, 0.0, high)
    if array.shape not in ((), (3,)):
        raise ValueError(f"{name} must be a number or three, R, G and B; got shape {array.shape}")
    return jnp.broadcast_to(array, (3,))


def vector_of(value: Any, name: str, *, zero: bool = False) -> Float[Array, " 3"]:
    """Three finite components; ValueError for anything else and, unless `zero`, for length 0 in single precision."""
    array = checked(value, name, -np.inf)
    if array.shape != (3,):
        raise ValueError(f"{name} must have three components, x, y and z; got shape {array.shape}")
    if not isinstance(array, Tracer):
        largest, single = np.max(np.abs(np.asarray(array))), np.finfo(np.float32)
        if largest > single.max:
            raise ValueError(f"{name} must be finite in single precision, <= {single.max:.3g}; got {value}")
        if not zero and largest < single.tiny:
            raise ValueError(f"{name} must not have length 0, in single precision at least {single.tiny:.3g}; got {value}")
    return array


def plain(value: Any, name: str, allowed: str) -> Any:
    """A JAX array as it is, anything else as numbers in numpy; ValueError, with what is allowed, where it is not numbers."""
    if isinstance(value, jax.Array):
        return value
    try:
        array = np.asarray(value)
        if array.dtype == bool:
            raise TypeError
        return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be {allowed}; got {value!r}") from None


def backdrop_of(value: Any, size: tuple[int, int]) -> Any:
    """What is behind an object: a number, RGB or an image (3, height, width), linear, as an array.

    ValueError for another shape, for a number or RGB that is negative and, unless it is traced, for what is not finite.
    """
    array = plain(value, "background", "a number, RGB or an image")
    if array.shape not in ((), (3,), (3, *size)):
        raise ValueError(f"background must be a number, RGB or {(3, *size)}; got shape {array.shape}")
    if not isinstance(array, Tracer):
        # Images may come from the artistic models, which go below 0 under strong lights.
        if not np.all(np.isfinite(np.asarray(array))):
            raise ValueError(f"background must be finite; got {value if array.ndim < 2 else 'an image with NaN or infinities'}")
        if array.ndim < 2 and np.any(np.asarray(array) < 0):
            raise ValueError(f"background must be finite and >= 0; got {value}")
    return array
