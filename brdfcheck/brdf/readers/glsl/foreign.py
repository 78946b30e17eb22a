"""Functions that HLSL and Slang have besides those of GLSL."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.readers.glsl import arithmetic, matrices
from brdfcheck.brdf.readers.glsl.arithmetic import add, convert, folded, least, most, multiply
from brdfcheck.brdf.readers.glsl.library import Library, all_of, any_of, bits, from_bits, lanes, plain


def _sincos(machine: Any, angle: Any) -> Any:
    sine = lanes(folded(np.sin, jnp.sin))(machine, angle)
    return (), sine, lanes(folded(np.cos, jnp.cos))(machine, angle)


def _of_parts(joined: Callable[..., Any]) -> Callable[..., Any]:
    """`any` and `all`, which take numbers here, and a scalar too."""

    def function(machine: Any, value: Any) -> Any:
        del machine
        return joined(*(convert(part, "bool") for part in (value if isinstance(value, tuple) else (value,))))

    return function


def _table() -> Library:
    found = Library()
    put = found.put
    zero, one = np.float64(0), np.float64(1)
    put("F saturate(F)", lanes(lambda x: least(most(x, zero), one)))
    put("F rcp(F)", lanes(lambda m, x: arithmetic.divide(m, one, x), machine=True))
    put("F mad(F, F, F)", lanes(lambda a, b, c: add(multiply(a, b), c)))
    put("F fmod(F, F)", lanes(arithmetic.remainder, machine=True))
    put("F log10(F)", lanes(arithmetic.guarded(np.log10, jnp.log10, 1), machine=True))
    for whole, kind in (("I", np.int32), ("U", np.uint32)):
        name = "asint" if whole == "I" else "asuint"
        put(f"{whole} {name}(F)", lanes(lambda x, kind=kind: bits(x, kind)))
        put(f"F asfloat({whole})", lanes(from_bits))
    put("void sincos(F, out F, out F)", _sincos)
    for letter in "FIUB":
        put(f"bool any({letter})", _of_parts(any_of))
        put(f"bool all({letter})", _of_parts(all_of))
    # A matrix is kept by rows here, so that what stands on the left in HLSL stands on the right.
    put("float mul(float, float)", plain(multiply))
    for size in (2, 3, 4):
        put(f"float mul(vec{size}, vec{size})", plain(matrices.dot))
        put(f"vec{size} mul(vec{size}, float)", plain(matrices.scaled))
        put(f"vec{size} mul(float, vec{size})", plain(lambda a, b: matrices.scaled(b, a)))
    for rows, columns in itertools.product((2, 3, 4), (2, 3, 4)):
        matrix = f"mat{rows}x{columns}"
        put(f"vec{rows} mul({matrix}, vec{columns})", plain(lambda a, b: matrices.vector_times(b, a)))
        put(f"vec{columns} mul(vec{rows}, {matrix})", plain(lambda a, b: matrices.times_vector(b, a)))
        for other in (2, 3, 4):
            put(f"mat{rows}x{other} mul({matrix}, mat{columns}x{other})", plain(lambda a, b: matrices.product(b, a)))
    return found


FOREIGN = _table()
"""All their forms, by name."""
