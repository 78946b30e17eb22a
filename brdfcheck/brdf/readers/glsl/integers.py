"""The built-in functions of whole numbers, on 32 bits."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.readers.glsl.arithmetic import convert, known


def _unsigned(value: Any) -> Any:
    return convert(value, "uint")


def _count(value: Any) -> Any:
    value = _unsigned(value)
    if known(value):
        return np.int32(int(value).bit_count())
    return jax.lax.population_count(value).astype(jnp.int32)


def _reverse(value: Any) -> Any:
    kind = "int" if value.dtype == np.int32 else "uint"
    bits = _unsigned(value)
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF)):
        mask, shift = np.uint32(mask), np.uint32(shift)
        bits = ((bits >> shift) & mask) | ((bits & mask) << shift)
    return convert(bits, kind)


def _lowest(value: Any) -> Any:
    value = _unsigned(value)
    if known(value):
        return np.int32((int(value) & -int(value)).bit_length() - 1)
    alone = value & (~value + np.uint32(1))
    return jnp.where(value == 0, -1, 31 - jax.lax.clz(alone).astype(jnp.int32)).astype(jnp.int32)


def _highest(value: Any) -> Any:
    signed = value.dtype == np.int32
    if known(value):
        number = int(value)
        return np.int32((~number if number < 0 else number).bit_length() - 1)
    bits = _unsigned(jnp.where(value < 0, ~value, value) if signed else value)
    return 31 - jax.lax.clz(bits).astype(jnp.int32)


def _field(bits: Any) -> Any:
    """A mask of so many low bits; of all 32 too."""
    one, full = np.uint32(1), np.uint32(0xFFFFFFFF)
    count = _unsigned(bits)
    inside = (one << (count & np.uint32(31))) - one
    return (full if count >= 32 else inside) if known(count) else jnp.where(count >= 32, full, inside)


def _extract(value: Any, offset: Any, bits: Any) -> Any:
    kind = "int" if value.dtype == np.int32 else "uint"
    start = _unsigned(offset) & np.uint32(31)
    found = (_unsigned(value) >> start) & _field(bits)
    if kind == "uint":
        return found
    count = _unsigned(bits)
    sign = np.uint32(1) << ((count - np.uint32(1)) & np.uint32(31))
    filled = (found ^ sign) - sign
    if known(filled, count):
        return convert(filled if count else found, kind)
    return convert(jnp.where(count == 0, found, filled), kind)


def _insert(base: Any, insert: Any, offset: Any, bits: Any) -> Any:
    kind = "int" if base.dtype == np.int32 else "uint"
    start = _unsigned(offset) & np.uint32(31)
    mask = _field(bits) << start
    return convert((_unsigned(base) & ~mask) | ((_unsigned(insert) << start) & mask), kind)


FUNCTIONS: tuple[tuple[str, Any], ...] = (
    ("I bitCount(I)", _count),
    ("I bitCount(U)", _count),
    ("I bitfieldReverse(I)", _reverse),
    ("U bitfieldReverse(U)", _reverse),
    ("I findLSB(I)", _lowest),
    ("I findLSB(U)", _lowest),
    ("I findMSB(I)", _highest),
    ("I findMSB(U)", _highest),
    ("I bitfieldExtract(I, int, int)", _extract),
    ("U bitfieldExtract(U, int, int)", _extract),
    ("I bitfieldInsert(I, I, int, int)", _insert),
    ("U bitfieldInsert(U, U, int, int)", _insert),
)
"""Signatures and what computes them, of one whole number or of one component."""
