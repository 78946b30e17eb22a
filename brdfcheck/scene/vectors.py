"""Numbers, colours and vectors of a scene, and what is refused about them.

Vectors that differ from pixel to pixel are component-first, three arrays of one shape: XLA fuses and vectorises that
layout. Components that do not differ are plain scalars; what follows from scalars alone is computed once, not per pixel.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.documents import shown

TINY = 1e-18
"""Kept off exact zeros; its square is a normal float32 number."""

SMOOTHEST = 1e-9
"""The least slope of facets: its square stays far from the least number of single precision."""


# Of single precision.
_LEAST, _LARGEST = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)


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


def polar(a: Any) -> tuple[Float[Array, "..."], Vector]:
    """(length, vector at length 1), whatever the length; the zero vector stays zero."""
    # Over its largest component first, so that no square leaves the range of float32. The results do not depend on that
    # number, nor do derivatives.
    largest = jax.lax.stop_gradient(functools.reduce(jnp.maximum, (jnp.abs(part) for part in a)))
    a = Vector(*a) * (1 / jnp.where(largest > 0, largest, 1))
    square = dot(a, a)
    root = jnp.sqrt(jnp.where(square > 0, square, 1))
    return largest * root, a * (1 / root)


def unit(a: Any) -> Vector:
    """The vector at length 1, whatever its length; the zero vector stays zero."""
    return polar(a)[1]


def choose(condition: Array, a: Any, b: Any) -> Vector:
    """Component-first ``where``."""
    return Vector(*(jnp.where(condition, p, q) for p, q in zip(a, b, strict=True)))


def power(base: Float[Array, "..."], n: Float[Array, "..."]) -> Float[Array, "..."]:
    """c^n with 0^0 = 1 and c = `base` between 0 and 1, as exp(n log c), which XLA vectorises where it does not pow.

    Gradients are finite. A cosine that rounding puts above 1 counts as 1: a large n would make anything of it.
    """
    positive = base > 0
    exponent = n * jnp.log(jnp.where(positive, base, 1))
    exponent = jnp.where(exponent > 0, 0, exponent)
    return jnp.where(positive, jnp.exp(exponent), jnp.where(n > 0, 0, 1).astype(base.dtype))


def spread(color: Float[Array, "..."], dimensions: int) -> Float[Array, "..."]:
    """A colour (3,) so that it multiplies fields of so many dimensions; a coloured field (3, ...) as it is."""
    return color.reshape(color.shape + (1,) * dimensions) if color.ndim == 1 else color


def strong(array: Array) -> Array:
    """The array with a type of its own: 10 and 10.0 are the same to a compiled program."""
    return array.astype(array.dtype) if array.weak_type else array


def _numbers(value: Any) -> Any:
    """An array of floating-point numbers: of JAX where it is one or holds traced values, else of numpy, never traced."""
    if isinstance(value, jax.Array) or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(value)):
        array: Any = jnp.asarray(value)
    else:
        array = np.asarray(value)
    if jnp.issubdtype(array.dtype, jnp.floating):
        return array
    # numpy calls integers objects where they are long; some texts it would read as numbers.
    long = array.dtype == object and all(type(part) is int for part in array.flat)
    if not (long or jnp.issubdtype(array.dtype, jnp.integer)):
        raise TypeError
    return array.astype(float)


def verified(
    value: Any,
    name: str,
    low: float = 0.0,
    high: float = np.inf,
    *,
    above: bool = False,
    shapes: Sequence[tuple[int | None, ...]] = (),
    what: str = "a number",
) -> Any:
    """`value` as an array: one of JAX or traced stays as it is, numbers are in numpy, ready for a compiled program.

    ValueError, in one line, for what is not numbers of one of the `shapes` (None: any length; no shapes: any shape), which
    the message calls `what`; for what is not finite in single precision; for what is outside [low, high], or with `above` is
    low itself or not told from it in single precision. Traced values are not checked.
    """
    range_of_single = f"finite in single precision, <= {_LARGEST:.3g}"

    def refusal(allowed: str, bad: np.ndarray | None = None) -> ValueError:
        known = isinstance(value, np.ndarray | jax.Array) and not isinstance(value, Tracer)
        given, where = value.tolist() if known else value, ""
        if bad is not None and bad.ndim == 2:
            row = int(np.argmax(np.any(bad, axis=1)))
            given, where = np.asarray(value)[row].tolist(), f" in row {row}"
        return ValueError(f"{name} must be {allowed}; got {shown(given)}{where}")

    try:
        array = _numbers(value)
    except OverflowError:
        raise refusal(range_of_single) from None
    except (TypeError, ValueError):
        raise refusal(what) from None
    fits = (
        len(shape) == array.ndim and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True)) for shape in shapes
    )
    if not array.size or (shapes and not any(fits)):
        raise refusal(what)
    if not isinstance(array, Tracer):
        numbers = np.asarray(array).astype(float)
        good = (numbers >= (low + _LEAST if above else low)) & (numbers <= high) & np.isfinite(numbers)
        if not np.all(good):
            bounds = [f"{'>' if above else '>='} {low:g}"] if low > -np.inf else []
            bounds += [f"<= {high:g}"] if high < np.inf else []
            raise refusal(" and ".join(["finite", *bounds]), ~good)
        large = np.abs(numbers) > _LARGEST
        if np.any(large):
            raise refusal(range_of_single, large)
    return strong(array) if isinstance(array, jax.Array) else array


def checked(value: Any, name: str, low: float = 0.0, high: float = np.inf, **options: Any) -> Array:
    """`verified`, as an array leaf: numbers take JAX's default precision."""
    return jnp.asarray(verified(value, name, low, high, **options))


def scalar(value: Any, name: str, low: float = 0.0, high: float = np.inf, *, above: bool = False) -> Float[Array, ""]:
    """`checked`, one number."""
    return checked(value, name, low, high, above=above, shapes=[()], what="one number")


def integer(value: Any, name: str, least: int, most: int) -> int:
    """`value` as an int; ValueError where it is not a whole number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
        raise ValueError(f"{name} must be an integer from {least} to {most}; got {value!r}")
    return int(value)


def color_of(value: Any, name: str, high: float = np.inf) -> Float[Array, " 3"]:
    """`checked`, a number or RGB as shape (3,), linear, from 0 to `high`."""
    array = checked(value, name, 0.0, high, shapes=[(), (3,)], what="a number or three, R, G and B")
    return jnp.broadcast_to(array, (3,))


def vector_of(value: Any, name: str, *, zero: bool = False) -> Float[Array, " 3"]:
    """`checked`, three components; ValueError, unless `zero`, for length 0 in single precision."""
    array = checked(value, name, -np.inf, shapes=[(3,)], what="three components, x, y and z")
    if not zero and not isinstance(array, Tracer) and np.max(np.abs(np.asarray(array))) < _LEAST:
        raise ValueError(f"{name} must not have length 0, in single precision at least {_LEAST:.3g}; got {shown(value)}")
    return array


def backdrop_of(value: Any, size: tuple[int, int]) -> Any:
    """`verified`, what is behind an object: a number or RGB, linear, >= 0, or an image (3, height, width)."""
    what = f"a number, RGB or an image of shape {(3, *size)}"
    array = verified(value, "background", -np.inf, shapes=[(), (3,), (3, *size)], what=what)
    # Images may come from the artistic models, which go below 0 under strong lights.
    return array if array.ndim > 1 else verified(value, "background")
