"""The built-in functions, against numpy and against values worked out by hand; folded and traced."""

from __future__ import annotations

import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shaders import LIGHT, VIEW, family, folded, traced

# Expressions in which `one` is a uniform of value 1; of a vector, the components are added with weights 1, 10, 100, 1000.
VALUES: dict[str, float] = {
    "radians(180.0 * one)": math.pi,
    "degrees(one)": 180 / math.pi,
    "sin(one)": math.sin(1),
    "cos(vec2(one, 2)).y": math.cos(2),
    "tan(one)": math.tan(1),
    "asin(0.5 * one)": math.asin(0.5),
    "acos(0.5 * one)": math.acos(0.5),
    "atan(one, -2.0)": math.atan2(1, -2),
    "atan(2.0 * one)": math.atan(2),
    "sinh(one)": math.sinh(1),
    "cosh(one)": math.cosh(1),
    "tanh(one)": math.tanh(1),
    "asinh(one)": math.asinh(1),
    "acosh(2.0 * one)": math.acosh(2),
    "atanh(0.5 * one)": math.atanh(0.5),
    "pow(2.0, 0.5 * one)": math.sqrt(2),
    "pow(3.0 * one, 4.0)": 81,
    "pow(3.0 * one, -2.0)": 1 / 9,
    "pow(3.0 * one, 0.0)": 1,
    "pow(vec2(2, 3) * one, vec2(3, 2)).y": 9,
    "pow(0.0 * one, 2.5)": 0,
    "pow(2, 3) * one": 8,
    "exp(one)": math.e,
    "log(3.0 * one)": math.log(3),
    "exp2(3.0 * one)": 8,
    "log2(8.0 * one)": 3,
    "sqrt(2.0 * one)": math.sqrt(2),
    "sqrt(0.0 * one)": 0,
    "inversesqrt(4.0 * one)": 0.5,
    "abs(-3.5 * one)": 3.5,
    "float(abs(-3 * int(one)))": 3,
    "sign(-2.0 * one) + 10.0 * sign(0.0 * one)": -1,
    "float(sign(ivec2(-4, 4) * int(one)).x)": -1,
    "floor(-1.5 * one)": -2,
    "ceil(-1.5 * one)": -1,
    "trunc(-1.5 * one)": -1,
    "round(1.4 * one)": 1,
    "roundEven(2.5 * one)": 2,
    "fract(-1.25 * one)": 0.75,
    "mod(-1.0 * one, 3.0)": 2,
    "mod(vec2(5, 7) * one, 3.0).y": 1,
    "min(one, 2.0) + 10.0 * max(one, 2.0)": 21,
    "max(vec3(1, 5, 2) * one, 3.0).z": 3,
    "float(max(3, 4 * int(one)))": 4,
    "float(min(3u, 4u * uint(one)))": 3,
    "clamp(5.0 * one, 0.0, 2.0)": 2,
    "clamp(vec2(-1, 0.5) * one, 0.0, 1.0).y": 0.5,
    "float(clamp(7 * int(one), 1, 5))": 5,
    "mix(2.0, 4.0, 0.25 * one)": 2.5,
    "mix(vec2(2), vec2(4, 6), vec2(0.5 * one, 1)).y": 6,
    "mix(vec3(1), vec3(3), 0.5 * one).z": 2,
    "mix(vec2(1, 2), vec2(3, 4), bvec2(true, false)).x * one": 3,
    "step(0.5, one) + 10.0 * step(vec2(2), vec2(one, 3)).x": 1,
    "step(1.0, vec2(one, 0.5)).x": 1,
    "smoothstep(0.0, 2.0, one)": 0.5,
    "smoothstep(0.0, 4.0, vec2(one, 5)).x": 0.15625,
    "float(isnan(one)) + float(isinf(one / 0.0)) * 10.0": 10,
    "float(floatBitsToInt(one))": 1065353216,
    "float(floatBitsToUint(-one))": 3212836864,
    "intBitsToFloat(1065353216 * int(one))": 1,
    "uintBitsToFloat(0x40490FDBu) * one": float(np.float32(np.pi)),
    "length(vec2(3, 4) * one) + length(-2.0 * one)": 7,
    "distance(vec3(1, 2, 3) * one, vec3(1, 2, 8))": 5,
    "dot(vec3(1, 2, 3) * one, vec3(4, 5, 6))": 32,
    "cross(vec3(1, 2, 3) * one, vec3(4, 5, 6)).y": 6,
    "normalize(vec2(3, 4) * one).y": 0.8,
    "faceforward(vec3(1, 2, 3) * one, vec3(0, 0, 1), vec3(0, 0, 1)).z": -3,
    "reflect(vec3(1, -2, 0) * one, vec3(0, 1, 0)).y": 2,
    "refract(vec3(0, -1, 0) * one, vec3(0, 1, 0), 0.5).y": -1,
    "refract(normalize(vec3(1, -1, 0) * one), vec3(0, 1, 0), 0.5).x": math.sqrt(0.5) * 0.5,
    "refract(normalize(vec3(1, -0.1, 0) * one), vec3(0, 1, 0), 1.5).x": 0,
    "float(bitCount(255 * int(one)))": 8,
    "float(bitfieldExtract(0xF0u * uint(one), 4, 3))": 7,
    "float(bitfieldExtract(-8 * int(one), 1, 4))": -4,
    "float(bitfieldInsert(0u, 5u * uint(one), 4, 3))": 80,
    "float(bitfieldReverse(1u * uint(one)))": 2147483648,
    "float(findLSB(40 * int(one))) + 10.0 * float(findMSB(40u * uint(one)))": 53,
    "float(findMSB(-1 * int(one)))": -1,
    "fma(2.0, 3.0, one)": 7,
    "ldexp(3.0 * one, 2)": 12,
}


TWO_RESULTS = (
    "uniform float one;\nvec3 f(vec3 L, vec3 V, vec3 N) {"
    "float w; vec2 v; int e; float a = modf(-2.75 * one, w); vec2 b = modf(vec2(1.5, 3.25) * one, v);"
    " float m = frexp(12.0 * one, e); return vec3(a * 10.0 + w, b.y * 10.0 + v.y, m * 10.0 + float(e)); }"
)
SHADERS = {
    **{name: f"uniform float one;\nfloat f(vec3 L, vec3 V, vec3 N) {{ return {name}; }}\n" for name in VALUES},
    "two results": TWO_RESULTS,
}


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    return traced(tmp_path_factory.mktemp("traced"), SHADERS)


@pytest.mark.parametrize("name", SHADERS)
def test_a_function_has_the_value_it_should(tmp_path: Path, values: dict[str, np.ndarray], name: str) -> None:
    expected = pytest.approx(VALUES.get(name, [-9.5, 5.5, 11.5]), rel=4e-15, abs=1e-15)
    assert folded(tmp_path, SHADERS[name]) == expected
    assert values[name] == expected


@pytest.mark.parametrize(
    "body",
    [
        "float z = one / zero; return zero > 0.0 ? z : one;",
        "float z = log(zero) + inversesqrt(zero) + pow(zero, -2.0); return zero > 0.0 ? z : one;",
        "vec2 z = normalize(vec2(zero)); return zero > 0.0 ? z.x : one;",
        "return one + atan(zero, zero);",
        "return one + acos(min(1.5 + zero, 1.0)) + asin(max(-1.5 + zero, -1.0)) + 1.5707963267948966;",
    ],
)
def test_slopes_where_a_function_has_none_do_not_spread(tmp_path: Path, body: str) -> None:
    text = f"uniform float one;\nfloat f(vec3 L, vec3 V) {{ float zero = one * L.y; {body} }}\n"
    built = family(tmp_path, text, one=(0.0, 2.0)).build
    value, slope = jax.value_and_grad(lambda one: built(one=one)(LIGHT, VIEW)[0])(jnp.asarray(1.0))
    assert (float(value), float(slope)) == pytest.approx((1.0, 1.0), abs=1e-15)
