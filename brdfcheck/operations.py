"""The work of a program, counted in its operations: the same number in every process, whatever else the machine does.

Combinations are ranked by it: times of small pictures on a shared machine come out in another order each time. It is a model:
an operation has one price for each element, whatever it is fused with, and moving data costs nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

# Prices for one element by the bytes of its type, over a multiplication in float64 (about 0.3 ns here): measured with XLA on
# x86-64 over fields that stay in the cache, and rounded. float16 is computed in float32 and rounded after each operation.
_PLAIN = {8: 1.0, 4: 1 / 3, 2: 3.0}
_ROOTS = {8: 2.0, 4: 0.5, 2: 6.0}
_FUNCTIONS = {8: 24.0, 4: 4.0, 2: 8.0}
_ANGLES = {8: 60.0, 4: 30.0, 2: 40.0}
_POWERS = {8: 120.0, 4: 12.0, 2: 16.0}
_PRICES: Mapping[str, Mapping[int, float]] = MappingProxyType({
    **dict.fromkeys(("div", "sqrt", "rsqrt"), _ROOTS),
    **dict.fromkeys(("exp", "exp2", "expm1", "log", "log1p", "sin", "cos", "tan", "tanh", "erf", "logistic"), _FUNCTIONS),
    **dict.fromkeys(("acos", "asin", "atan", "atan2"), _ANGLES),
    **dict.fromkeys(("pow", "lgamma", "digamma"), _POWERS),
})  # fmt: skip
# What moves or renames data is done where it is read.
_MOVES = frozenset({
    "broadcast_in_dim", "concatenate", "convert_element_type", "copy", "iota", "pad", "reshape", "rev", "slice", "split",
    "squeeze", "stop_gradient", "transpose",
})  # fmt: skip
# An addition or multiplication in a product of matrices: by routines made for it.
_IN_PRODUCTS = 0.2
# Primitives of a compiled program that compute nothing.
_FREE = _MOVES | {"select_n", "pjit", "jit"}


def operations(function: Callable[[Any], Any]) -> Counter[str]:
    """Arithmetic operations and elementary functions in one evaluation of a function of one number, by primitive.

    Counted in the traced program with the constants folded in, as a shader compiler would. An integer power counts as the
    multiplications (``mul``, and a ``div`` if negative) of its squarings; a choice between two values (``select``) is free.
    """
    return _count(jax.make_jaxpr(function)(jnp.asarray(2.0)).jaxpr)


def _count(jaxpr: Any) -> Counter[str]:
    # What depends on constants only is computed once, by the compiler.
    varying = set(map(id, jaxpr.invars))
    total: Counter[str] = Counter()
    for equation in jaxpr.eqns:
        if not any(id(variable) in varying for variable in equation.invars):
            continue
        varying.update(map(id, equation.outvars))
        inner = [part for part in equation.params.values() if hasattr(part, "jaxpr")]
        if inner:
            for part in inner:
                total += _count(part.jaxpr)
        elif equation.primitive.name == "integer_pow":
            power = abs(int(equation.params["y"]))
            total["mul"] += power.bit_length() - 1 + power.bit_count() - 1
            total["div"] += int(equation.params["y"] < 0)
        elif equation.primitive.name not in _FREE:
            total[equation.primitive.name] += int(np.prod(equation.outvars[0].aval.shape))
    return +total


def program_of(function: Any, *arguments: Any) -> core.Jaxpr:
    """The traced program of a function at arguments of these shapes. Nothing is computed."""
    return jax.make_jaxpr(function)(*arguments).jaxpr


def work_of(program: core.Jaxpr, loops: tuple[float, ...] = (), size: int = 0) -> float:
    """The work of a program, in multiplications of float64; with a `size` as if its numbers had so many bytes.

    `loops`: how often loops go round of which that is known only when they run, from the outermost inwards; once by default.
    Of branches the dearest counts.
    """
    return sum(_one(equation, loops, size) for equation in program.eqns)


def _one(equation: Any, loops: tuple[float, ...], size: int) -> float:
    name, parameters = equation.primitive.name, equation.params
    if name == "while":
        rounds, inside = (loops[0], loops[1:]) if loops else (1.0, ())
        return rounds * sum(work_of(parameters[part].jaxpr, inside, size) for part in ("cond_jaxpr", "body_jaxpr"))
    if name == "scan":
        return parameters["length"] * work_of(parameters["jaxpr"].jaxpr, loops, size)
    if name == "cond":
        return max(work_of(branch.jaxpr, loops, size) for branch in parameters["branches"])
    for part in parameters.values():  # a function that is called, or one with a derivative of its own
        if isinstance(part, core.ClosedJaxpr | core.Jaxpr):
            return work_of(part.jaxpr if isinstance(part, core.ClosedJaxpr) else part, loops, size)
    shapes = [variable.aval for variable in (*equation.invars, *equation.outvars)]
    numbers = [shape for shape in shapes if jax.numpy.issubdtype(shape.dtype, np.inexact)]
    bytes_each = size if size and numbers else max(np.dtype(shape.dtype).itemsize for shape in numbers or shapes)
    price = _PRICES.get(name, _PLAIN).get(bytes_each, 1.0)
    return price * _elements(name, parameters, [shape.shape for shape in shapes])


def _elements(name: str, parameters: Mapping[str, Any], shapes: list[tuple[int, ...]]) -> float:
    """How many elements a primitive computes; `shapes`: of its arguments, then of its results."""
    if name in _MOVES:
        return 0.0
    most, last = max(map(math.prod, shapes)), math.prod(shapes[-1])
    if name == "dot_general":
        (contracted, _), _ = parameters["dimension_numbers"]
        return 2 * _IN_PRODUCTS * last * math.prod(shapes[0][axis] for axis in contracted)
    if name == "lu":
        return 2 / 3 * _IN_PRODUCTS * most**1.5
    if name == "triangular_solve":
        return _IN_PRODUCTS * math.prod(shapes[0]) * shapes[1][-1]
    if name in ("gather", "dynamic_slice"):  # what is read, not what it is read from
        return last
    if name == "dynamic_update_slice":
        return math.prod(shapes[1])
    if name == "integer_pow":  # by squaring
        exponent = abs(parameters["y"])
        return most * (exponent.bit_length() + exponent.bit_count() - 2)
    return most
