"""The built-in functions of GLSL that have a meaning for one pair of directions, and why the others have none."""

from __future__ import annotations

import functools
import itertools
import operator
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.readers.glsl import arithmetic, integers, matrices
from brdfcheck.brdf.readers.glsl.arithmetic import (
    add,
    choose,
    convert,
    divide,
    folded,
    guarded,
    known,
    least,
    most,
    multiply,
    power,
    root,
    subtract,
)
from brdfcheck.brdf.readers.glsl.kinds import NAMED, Matrix, Type, vector


class Builtin(NamedTuple):
    """One form of a built-in function. `ways`: "in" or "out" for each parameter; what goes out is returned behind the value."""

    types: tuple[Type, ...]
    result: Type
    run: Callable[..., Any]
    ways: tuple[str, ...]


def lanes(function: Callable[..., Any], machine: bool = False) -> Callable[..., Any]:
    """A function of scalars on components; scalars beside vectors are given to each. `machine`: it takes the machine first."""

    def run(owner: Any, *values: Any) -> Any:
        first = (owner,) if machine else ()
        size = next((len(value) for value in values if isinstance(value, tuple)), 0)
        if not size:
            return function(*first, *values)
        columns = [value if isinstance(value, tuple) else (value,) * size for value in values]
        return tuple(function(*first, *parts) for parts in zip(*columns, strict=True))

    return run


_GENERIC = {"F": "float", "I": "int", "U": "uint", "B": "bool"}


def forms(signature: str, run: Callable[..., Any]) -> list[tuple[str, Builtin]]:
    """The forms of ``F pow(F, F)``: F, I, U and B stand for a scalar or any vector, VF... for a vector, M for a matrix."""
    result, name, inside = re.fullmatch(r"(\w+) (\w+)\((.*)\)", signature).groups()  # pyright: ignore[reportOptionalMemberAccess]
    words = [word.split() for word in inside.split(", ")] if inside else []
    every = [result, *(word[-1] for word in words)]
    if "M" in every:
        choices: list[Any] = list(itertools.product((2, 3, 4), (2, 3, 4)))
    elif any(word[-1] in _GENERIC and word[0] in (*_GENERIC, "V") for word in every if len(word) <= 2):
        choices = [2, 3, 4] if any(word[0] == "V" for word in every if len(word) == 2) else [1, 2, 3, 4]
    else:
        choices = [0]

    def of(word: str, choice: Any) -> Type:
        if word == "M":
            return Matrix(*choice)
        if len(word) <= 2 and word[-1] in _GENERIC:
            return vector(_GENERIC[word[-1]], choice)
        return NAMED[word]

    ways = tuple(word[0] if len(word) > 1 else "in" for word in words)
    return [(name, Builtin(tuple(of(word[-1], choice) for word in words), of(result, choice), run, ways)) for choice in choices]


class Library(dict[str, list[Builtin]]):
    """The forms of functions, by their names."""

    def put(self, signature: str, run: Callable[..., Any]) -> None:
        """Add the `forms` of a signature."""
        for name, form in forms(signature, run):
            known_forms = self.setdefault(name, [])
            # "F max(F, F)" and "F max(F, float)" are the same for scalars.
            if all(form.types != other.types for other in known_forms):
                known_forms.append(form)


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that needs no machine."""
    return lambda machine, *values: function(*values)


def _clamp(value: Any, low: Any, high: Any) -> Any:
    return least(most(value, low), high)


def _mix(a: Any, b: Any, share: Any) -> Any:
    return add(multiply(a, subtract(np.float64(1), share)), multiply(b, share))


def _smoothstep(machine: Any, low: Any, high: Any, value: Any) -> Any:
    t = _clamp(divide(machine, subtract(value, low), subtract(high, low)), np.float64(0), np.float64(1))
    return t * t * (3.0 - 2.0 * t)


def _mod(machine: Any, a: Any, b: Any) -> Any:
    return subtract(a, multiply(b, _floor(divide(machine, a, b))))


def _atan2(machine: Any, y: Any, x: Any) -> Any:
    if known(x, y):
        return np.arctan2(y, x)
    x = arithmetic.safe(machine, x, 1)
    # At (0, 0), where GLSL has no value, it is 0, and its slope counts as 0: phi is not needed at the pole.
    pole, one, zero = (x == 0) & (y == 0), np.float64(1), np.float64(0)
    return choose(pole, zero, jnp.arctan2(y, choose(pole, one, x)))


def _edged(numpy_function: Any, jax_function: Any) -> Callable[..., Any]:
    """An inverse of the sine or cosine. At -1 and 1 its slope counts as 0: it stands behind clamp(x, -1, 1) nearly always."""

    def function(machine: Any, value: Any) -> Any:
        if known(value):
            return numpy_function(value)
        value = arithmetic.safe(machine, value, 0)
        inside, zero = abs(value) < 1, np.float64(0)
        edge = choose(value > 0, np.float64(numpy_function(1.0)), np.float64(numpy_function(-1.0)))
        edge = choose(abs(value) == 1, edge, np.float64(np.nan))
        return choose(inside, jax_function(choose(inside, value, zero)), edge)

    return function


def _refract(machine: Any, ray: Any, normal: Any, eta: Any) -> Any:
    cosine = matrices.dot(normal, ray)
    k = subtract(np.float64(1), multiply(multiply(eta, eta), subtract(np.float64(1), multiply(cosine, cosine))))
    inside = k < 0
    part = add(multiply(eta, cosine), root(machine, most(k, np.float64(0))))
    whole = matrices.minus(matrices.scaled(ray, eta), matrices.scaled(normal, part))
    zero = np.float64(0)
    return tuple(choose(inside, zero, x) for x in whole) if isinstance(whole, tuple) else choose(inside, zero, whole)


def _reflect(machine: Any, ray: Any, normal: Any) -> Any:
    del machine
    return matrices.minus(ray, matrices.scaled(normal, multiply(np.float64(2), matrices.dot(normal, ray))))


def _faceforward(machine: Any, normal: Any, ray: Any, reference: Any) -> Any:
    del machine
    facing = matrices.dot(reference, ray) < 0
    pick = lanes(lambda x: choose(facing, x, -x))
    return pick(None, normal)


def _whole(numpy_function: Any, jax_function: Any) -> Any:
    return folded(lambda x: np.float64(numpy_function(x)), jax_function)


_floor, _ceil = _whole(np.floor, jnp.floor), _whole(np.ceil, jnp.ceil)
_trunc, _round = _whole(np.trunc, jnp.trunc), _whole(np.round, jnp.round)
_sign = folded(np.sign, jnp.sign)
any_of = folded(lambda *parts: np.bool_(any(parts)), lambda *parts: functools.reduce(operator.or_, parts))
all_of = folded(lambda *parts: np.bool_(all(parts)), lambda *parts: functools.reduce(operator.and_, parts))


def _modf(value: Any) -> tuple[Any, Any]:
    whole = _trunc(value)
    return subtract(value, whole), whole


def _frexp(value: Any) -> tuple[Any, Any]:
    if known(value):
        part, exponent = np.frexp(value)
        return np.float64(part), np.int32(exponent)
    part, exponent = jnp.frexp(value)
    return part, exponent.astype(jnp.int32)


def _pairs(function: Callable[[Any], tuple[Any, Any]]) -> Callable[..., Any]:
    """A function of one scalar that has two results, on components."""

    def run(machine: Any, value: Any) -> Any:
        del machine
        if not isinstance(value, tuple):
            return function(value)
        return tuple(zip(*(function(part) for part in value), strict=True))

    return run


def bits(value: Any, kind: Any) -> Any:
    """The bits of a number of single precision as a whole number."""
    return np.float32(value).view(kind) if known(value) else jax.lax.bitcast_convert_type(value.astype(jnp.float32), kind)


def from_bits(value: Any) -> Any:
    """The number of single precision with the bits of a whole number."""
    return (
        np.float64(value.view(np.float32)) if known(value) else jax.lax.bitcast_convert_type(value, jnp.float32).astype(float)
    )


_TRIGONOMETRY = {
    "sin": folded(np.sin, jnp.sin),
    "cos": folded(np.cos, jnp.cos),
    "radians": lambda x: x * np.float64(np.pi / 180),
    "degrees": lambda x: x * np.float64(180 / np.pi),
    "tanh": folded(np.tanh, jnp.tanh),
    "asinh": folded(np.arcsinh, jnp.arcsinh),
    "floor": _floor,
    "ceil": _ceil,
    "trunc": _trunc,
    "round": _round,
    "roundEven": _round,
    "fract": lambda x: subtract(x, _floor(x)),
    "abs": abs,
    "sign": _sign,
}
_GUARDED = {
    "tan": guarded(np.tan, jnp.tan, 0),
    "asin": _edged(np.arcsin, jnp.arcsin),
    "acos": _edged(np.arccos, jnp.arccos),
    "atan": guarded(np.arctan, jnp.arctan, 0),
    "sinh": guarded(np.sinh, jnp.sinh, 0),
    "cosh": guarded(np.cosh, jnp.cosh, 0),
    "acosh": guarded(np.arccosh, jnp.arccosh, 2),
    "atanh": guarded(np.arctanh, jnp.arctanh, 0),
    "exp": arithmetic.exp,
    "exp2": arithmetic.exp2,
    "log": arithmetic.log,
    "log2": arithmetic.log2,
    "sqrt": root,
    "inversesqrt": lambda machine, x: divide(machine, np.float64(1), root(machine, x)),
}
_COMPARED = {
    "lessThan": lambda a, b: a < b,
    "lessThanEqual": lambda a, b: a <= b,
    "greaterThan": lambda a, b: a > b,
    "greaterThanEqual": lambda a, b: a >= b,
    "equal": lambda a, b: a == b,
    "notEqual": lambda a, b: a != b,
}


def _table() -> Library:
    found = Library()
    put = found.put
    for name, function in _TRIGONOMETRY.items():
        put(f"F {name}(F)", lanes(function))
    for name in ("abs", "sign"):
        put(f"I {name}(I)", lanes(_TRIGONOMETRY[name]))
    for name, function in _GUARDED.items():
        put(f"F {name}(F)", lanes(function, machine=True))
    put("F atan(F, F)", lanes(_atan2, machine=True))
    put("F pow(F, F)", lanes(power, machine=True))
    for form in ("F mod(F, F)", "F mod(F, float)"):
        put(form, lanes(_mod, machine=True))
    put("F modf(F, out F)", _pairs(_modf))
    put("F frexp(F, out I)", _pairs(_frexp))
    put("F ldexp(F, I)", lanes(lambda x, n: multiply(x, folded(np.exp2, jnp.exp2)(convert(n, "float")))))
    put("F fma(F, F, F)", lanes(lambda a, b, c: add(multiply(a, b), c)))
    for letter, scalar in (("F", "float"), ("I", "int"), ("U", "uint")):
        for name, function in (("min", least), ("max", most)):
            put(f"{letter} {name}({letter}, {letter})", lanes(function))
            put(f"{letter} {name}({letter}, {scalar})", lanes(function))
        put(f"{letter} clamp({letter}, {letter}, {letter})", lanes(_clamp))
        put(f"{letter} clamp({letter}, {scalar}, {scalar})", lanes(_clamp))
        put(f"{letter} mix({letter}, {letter}, B)", lanes(lambda a, b, chosen: choose(chosen, b, a)))
    put("B mix(B, B, B)", lanes(lambda a, b, chosen: choose(chosen, b, a)))
    put("F mix(F, F, F)", lanes(_mix))
    put("F mix(F, F, float)", lanes(_mix))
    for form in ("F step(F, F)", "F step(float, F)"):
        put(form, lanes(lambda edge, x: choose(x < edge, np.float64(0), np.float64(1))))
    for form in ("F smoothstep(F, F, F)", "F smoothstep(float, float, F)"):
        put(form, lanes(_smoothstep, machine=True))
    put("B isnan(F)", lanes(folded(np.isnan, jnp.isnan)))
    put("B isinf(F)", lanes(folded(np.isinf, jnp.isinf)))
    put("I floatBitsToInt(F)", lanes(lambda x: bits(x, np.int32)))
    put("U floatBitsToUint(F)", lanes(lambda x: bits(x, np.uint32)))
    put("F intBitsToFloat(I)", lanes(from_bits))
    put("F uintBitsToFloat(U)", lanes(from_bits))
    # Geometry.
    put("float length(F)", matrices.length)
    put("float distance(F, F)", lambda machine, a, b: matrices.length(machine, matrices.minus(a, b)))
    put("float dot(F, F)", plain(matrices.dot))
    put("vec3 cross(vec3, vec3)", plain(matrices.cross))
    put("F normalize(F)", matrices.normalized)
    put("F faceforward(F, F, F)", _faceforward)
    put("F reflect(F, F)", _reflect)
    put("F refract(F, F, float)", _refract)
    # Matrices.
    put("M matrixCompMult(M, M)", lambda machine, a, b: jax.tree.map(multiply, a, b))
    for columns, rows in itertools.product((2, 3, 4), (2, 3, 4)):
        put(f"mat{columns}x{rows} outerProduct(vec{rows}, vec{columns})", plain(matrices.outer))
        put(f"mat{columns}x{rows} transpose(mat{rows}x{columns})", plain(matrices.transposed))
    for size in (2, 3, 4):
        put(f"float determinant(mat{size})", plain(matrices.determinant))
        put(f"mat{size} inverse(mat{size})", matrices.inverse)
    # Comparisons of vectors.
    for name, function in _COMPARED.items():
        for letter in "FIU":
            put(f"VB {name}(V{letter}, V{letter})", lanes(function))
    for name in ("equal", "notEqual"):
        put(f"VB {name}(VB, VB)", lanes(_COMPARED[name]))
    put("bool any(VB)", lambda machine, a: any_of(*a))
    put("bool all(VB)", lambda machine, a: all_of(*a))
    put("VB not(VB)", lanes(arithmetic.opposite))
    for signature, function in integers.FUNCTIONS:
        put(signature, lanes(function))
    return found


BUILTINS = _table()
"""All forms of all built-in functions, by name."""

_NEIGHBOURS = "there are no neighbouring pixels for one pair of directions"
_TEXTURES = "a BRDF may depend only on directions and parameters, and what the texture holds is in no file"
MEANINGLESS = {
    **dict.fromkeys(
        ("dFdx", "dFdy", "fwidth", "dFdxFine", "dFdyFine", "dFdxCoarse", "dFdyCoarse", "fwidthFine", "fwidthCoarse"),
        _NEIGHBOURS,
    ),
    **{
        name + ending: _TEXTURES
        for name in ("texture", "textureProj", "textureLod", "textureGrad", "texelFetch", "textureProjLod", "textureProjGrad")
        for ending in ("", "Offset")
    },
    **dict.fromkeys(("textureSize", "textureGather", "textureQueryLod", "textureQueryLevels"), _TEXTURES),
    **{
        f"{name}{ending}": _TEXTURES
        for name in ("texture1D", "texture2D", "texture3D", "textureCube", "shadow1D", "shadow2D", "texture2DRect")
        for ending in ("", "Lod", "Proj", "ProjLod", "LodEXT", "GradARB")
    },
    **dict.fromkeys(
        ("ftransform", "EmitVertex", "EndPrimitive", "noise1", "noise2", "noise3", "noise4"),
        "it belongs to a stage of a pipeline",
    ),
    **dict.fromkeys(("imageLoad", "imageStore", "imageSize"), _TEXTURES),
}
"""Functions of GLSL that cannot be evaluated for one pair of directions, and why."""
