"""Arithmetic on scalars: numbers that are known are folded as numpy numbers, everything else is traced by JAX.

Functions that have a place without a value or without a slope (division, roots, powers, logarithms...) take the machine: what
its mask excludes is replaced before the operation, so that neither the value nor the derivative of a lane that does not count
can spoil the others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.readers.glsl.kinds import KINDS

Mask = Any
"""True, False, or an array of truth values."""


class Masked(Protocol):
    """What the operations want to know of the machine."""

    active: Mask


def known(*values: Any) -> bool:
    """True where all of these scalars are numbers already."""
    return not any(isinstance(value, jax.Array) for value in values)


def both(first: Mask, second: Mask) -> Mask:
    """Where both masks hold."""
    if known(first):
        return second if first else False
    if known(second):
        return first if second else False
    return first & second


def either(first: Mask, second: Mask) -> Mask:
    """Where one of the masks holds."""
    if known(first):
        return True if first else second
    if known(second):
        return True if second else first
    return first | second


def opposite(mask: Mask) -> Mask:
    """Where a mask does not hold."""
    return not mask if known(mask) else ~mask


def where(mask: Any, yes: Any, no: Any) -> Any:
    """One or the other scalar, of one kind. What jnp.where does, without a function of its own in the program each time."""
    shape = np.broadcast_shapes(np.shape(mask), np.shape(yes), np.shape(no))
    kind = jax.dtypes.canonicalize_dtype(yes.dtype) if known(yes, no) else (no if known(yes) else yes).dtype
    return jax.lax.select(_filled(mask, shape, np.dtype(bool)), _filled(yes, shape, kind), _filled(no, shape, kind))


def _filled(value: Any, shape: tuple[int, ...], kind: Any) -> Any:
    if known(value):
        return jax.lax.full(shape, value, kind)
    return value if value.shape == shape else jnp.broadcast_to(value, shape)


def choose(mask: Mask, yes: Any, no: Any) -> Any:
    """A scalar: `yes` where the mask holds, else `no`."""
    if yes is no:
        return yes
    if known(mask):
        return yes if mask else no
    if known(yes, no) and (yes == no or (yes != yes and no != no)):
        return yes
    return where(mask, yes, no)


def safe(machine: Masked, value: Any, harmless: float) -> Any:
    """The scalar where it counts, and a harmless number elsewhere."""
    mask = machine.active
    if known(mask) or known(value):
        return value
    return where(mask, value, value.dtype.type(harmless))


def convert(value: Any, kind: str) -> Any:
    """A scalar as another kind of scalar, as constructors do it: towards zero, and by 32 bits."""
    if known(value):
        if kind == "bool":
            return np.bool_(value != 0)
        if isinstance(value, np.floating) and kind in ("int", "uint"):
            number = int(value) if np.isfinite(value) else 0
            return _wrapped(number, kind)
        return _wrapped(int(value), kind) if kind in ("int", "uint") else np.float64(value)
    if kind == "bool":
        return value if value.dtype == bool else value != 0
    if kind == "float":
        return value.astype(float)
    wide = value.dtype.kind == "f"
    if wide and kind == "uint":  # by way of 64 bits, as a negative number wraps round
        return jnp.where(value < 0, value.astype(jnp.int32).astype(jnp.uint32), value.astype(jnp.uint32))
    return value.astype(KINDS[kind])


def _wrapped(number: int, kind: str) -> Any:
    number &= 0xFFFFFFFF
    if kind == "uint":
        return np.uint32(number)
    return np.int32(number - 2**32 if number >= 2**31 else number)


def _is(value: Any, number: float) -> bool:
    return known(value) and value == number


def add(a: Any, b: Any) -> Any:
    """a + b."""
    return b if _is(a, 0) else a if _is(b, 0) else a + b


def subtract(a: Any, b: Any) -> Any:
    """a - b."""
    return a if _is(b, 0) else a - b


def multiply(a: Any, b: Any) -> Any:
    """a b."""
    return b if _is(a, 1) else a if _is(b, 1) else a * b


@jax.custom_jvp
def _quotient(a: Any, b: Any) -> Any:
    return a / b


@_quotient.defjvp
def _quotient_slope(values: Any, slopes: Any) -> tuple[Any, Any]:
    """Where b is 0 the slope counts as 0: shaders often divide first and choose another value there afterwards."""
    (a, b), (da, db) = values, slopes
    found, zero = a / b, b == 0
    return found, jnp.where(zero, 0.0, da - jnp.where(zero, 0.0, found) * db) / jnp.where(zero, 1.0, b)


def divide(machine: Masked, a: Any, b: Any) -> Any:
    """a / b; of whole numbers towards zero."""
    if a.dtype.kind == "f":
        return a if _is(b, 1) else a / b if known(b) else _quotient(a, safe(machine, b, 1))
    if known(a, b):
        return _divided(int(a), int(b), a.dtype.type)[0]
    a, b = _whole_pair(a, b)
    return jax.lax.div(a, jnp.where(b == 0, b.dtype.type(1), b))


def remainder(machine: Masked, a: Any, b: Any) -> Any:
    """a % b of whole numbers, with the sign of a; of floats, as HLSL has it."""
    del machine
    if known(a, b):
        if a.dtype.kind == "f":
            return np.fmod(a, b)
        return _divided(int(a), int(b), a.dtype.type)[1]
    a, b = _whole_pair(a, b)
    return jax.lax.rem(a, b if b.dtype.kind == "f" else jnp.where(b == 0, b.dtype.type(1), b))


def _divided(a: int, b: int, number: Any) -> tuple[Any, Any]:
    if b == 0:
        return number(0), number(0)
    quotient = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
    kind = "int" if number is np.int32 else "uint"
    return _wrapped(quotient, kind), _wrapped(a - quotient * b, kind)


def _whole_pair(a: Any, b: Any) -> tuple[Any, Any]:
    return tuple(jnp.broadcast_arrays(jnp.asarray(a), jnp.asarray(b)))  # pyright: ignore[reportReturnType]


def shift_left(a: Any, b: Any) -> Any:
    """a << b."""
    count = (b & b.dtype.type(31)).astype(a.dtype)
    return a << count if known(a, b) else jnp.left_shift(a, count)


def shift_right(a: Any, b: Any) -> Any:
    """a >> b; the sign stays."""
    count = (b & b.dtype.type(31)).astype(a.dtype)
    return a >> count if known(a, b) else jnp.right_shift(a, count)


def least(a: Any, b: Any) -> Any:
    """The smaller one: b < a ? b : a."""
    return np.where(b < a, b, a)[()] if known(a, b) else jnp.minimum(a, b)


def most(a: Any, b: Any) -> Any:
    """The larger one: a < b ? b : a."""
    return np.where(a < b, b, a)[()] if known(a, b) else jnp.maximum(a, b)


def folded(numpy_function: Callable[..., Any], jax_function: Callable[..., Any]) -> Callable[..., Any]:
    """The numpy function on what is known, the one of JAX on everything else."""

    def function(*values: Any) -> Any:
        return numpy_function(*values) if known(*values) else jax_function(*values)

    return function


def guarded(numpy_function: Callable[..., Any], jax_function: Callable[..., Any], harmless: float) -> Callable[..., Any]:
    """Like `folded`, of the machine and one scalar, which is harmless where the mask excludes it."""

    def function(machine: Masked, value: Any) -> Any:
        return numpy_function(value) if known(value) else jax_function(safe(machine, value, harmless))

    return function


def root(machine: Masked, value: Any) -> Any:
    """The square root. At 0 its slope counts as 0: it stands behind max(0, x) nearly always."""
    if known(value):
        return np.sqrt(value)
    value = safe(machine, value, 1)
    positive = value > 0
    one, nan = np.float64(1), np.float64(np.nan)
    return where(positive, jnp.sqrt(where(positive, value, one)), where(value < 0, nan, value))


# Whole powers up to this one are products.
_PRODUCTS = 16


def power(machine: Masked, base: Any, exponent: Any) -> Any:
    """base to the exponent."""
    if known(base, exponent):
        return np.power(base, exponent)
    if known(exponent) and exponent == np.trunc(exponent) and abs(exponent) <= _PRODUCTS:
        whole = int(exponent)
        return (
            jax.lax.integer_pow(base, whole) if whole >= 0 else divide(machine, np.float64(1), power(machine, base, -exponent))
        )
    base = safe(machine, base, 1)
    if known(base):
        return jnp.power(base, exponent)
    # No slope at 0: x^y there is that of a clamped cosine, and 0^y log 0 has none.
    nonzero = base != 0
    zero, one, infinite = np.float64(0), np.float64(1), np.float64(np.inf)
    raised = jnp.power(where(nonzero, base, one), exponent)
    return where(nonzero, raised, choose(exponent > 0, zero, choose(exponent == 0, one, infinite)))


def _logarithm(numpy_function: Callable[..., Any], jax_function: Callable[..., Any]) -> Callable[..., Any]:
    """A logarithm. At 0 its slope counts as 0, as that of a quotient does."""

    def function(machine: Masked, value: Any) -> Any:
        if known(value):
            return numpy_function(value)
        value = safe(machine, value, 1)
        nonzero = value != 0
        return choose(nonzero, jax_function(choose(nonzero, value, np.float64(1))), np.float64(-np.inf))

    return function


log, log2 = _logarithm(np.log, jnp.log), _logarithm(np.log2, jnp.log2)
exp = guarded(np.exp, jnp.exp, 0)
exp2 = guarded(np.exp2, jnp.exp2, 0)
