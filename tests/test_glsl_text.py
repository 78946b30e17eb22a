"""What stands around the language: macros, conditions, comments, qualifiers and blocks of uniforms, as real files have them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shaders import LIGHT, VIEW, family

from brdfcheck import load
from brdfcheck.messages import UsageError

_F = "float f(vec3 L, vec3 V) { return "
# Shaders, the parameters that are given, and the value.
TEXTS: dict[str, tuple[str, dict[str, Any], float | list[float]]] = {
    "conditions": (
        "#define A\n#define B 3\n#if defined(A) && B > 2 && !defined C\n#define K 1.0\n#else\n#error no\n#endif\n"
        + _F
        + "K; }",
        {},
        1,
    ),
    "nested conditions": (
        "#if 1\n#if 0\n#if 1\n#error x\n#endif\n#else\n#define K 4.\n#endif\n#endif\n" + _F + "K; }",
        {},
        4,
    ),
    "long macros": (
        "#define SQR(x) ((x)*(x))\n#define MAD(a, b, c) \\\n  ((a) * (b) \\\n   + (c))\n"
        + _F
        + "MAD(SQR(2.0 + 1.0), max(1.0, 2.0), SQR(SQR(2.))); }",
        {},
        34,
    ),
    "negative macro": ("#define EPS -1e-3\n" + _F + "1.0-EPS; }", {}, 1.001),
    "macro without its parenthesis": (
        "#define sat(x) clamp(x, 0., 1.)\nfloat g(float sat) { return sat; }\n" + _F + "g(sat(5.)); }",
        {},
        1,
    ),
    "odd text": ("// don't\n/* it's \" odd */\n#if 0\ndon't \" parse @ this `\n#endif\n" + _F + "2.0; }//x", {}, 2),
    "comments in directives": (
        "#define K /* c */ 3.0 // more\n#ifdef K // yes\n#define Q(x) (x /* in */ + 1.) // don't\n#endif /* K */\n"
        + _F
        + "Q(K/**/)/*x*/+/*y*/1.; }",
        {},
        5,
    ),
    "spaces": ("#\n#  define\tK 2.0\n  #\tifdef K\n" + _F + "K; }\n # endif", {}, 2),
    "qualifiers": (
        "#version 330 core\nprecision highp float;\nlayout(location=0) in vec3 pos;\nlayout(location = 0) out vec4 o;\n"
        "smooth in vec2 uv; flat in int k; uniform sampler2D t;\nvec3 h() { return texture(t, uv).rgb; }\n"
        + _F
        + "2.0; }\nvoid main() { o = vec4(h(), 1.0); discard; }",
        {},
        2,
    ),
    "block": (
        "layout(std140) uniform Material { float r; vec3 c; };\nvec3 f(vec3 L, vec3 V) { return c * r; }",
        {"r": (0.5, 0.5), "c": (1, 2, 3)},
        [0.5, 1, 1.5],
    ),
    "block with a name": (
        "layout(std140) uniform Material { float r; vec3 c; } mat;\nvec3 f(vec3 L, vec3 V) { return mat.c * mat.r; }",
        {"mat.r": (0.5, 0.5), "mat.c": (1, 2, 3)},
        [0.5, 1, 1.5],
    ),
    "uniform of a struct without a name": (
        "uniform struct { float r; vec3 c; } mat;\nvec3 f(vec3 L, vec3 V) { return mat.c * mat.r; }",
        {"mat.r": (0.5, 0.5), "mat.c": (1, 2, 3)},
        [0.5, 1, 1.5],
    ),
}


@pytest.mark.parametrize("name", TEXTS)
def test_what_stands_around_the_language(tmp_path: Path, name: str) -> None:
    text, ranges, expected = TEXTS[name]
    assert np.asarray(family(tmp_path, text, **ranges).build()(LIGHT, VIEW))[0] == pytest.approx(expected, rel=1e-14)


# What f(float3 L, float3 V) returns in HLSL, and its value.
HLSL: dict[str, float] = {
    "asfloat(asuint(1.5)) + asfloat(asint(2.0)) + reversebits(1u) / 2147483648.0 + countbits(7u)": 7.5,
    "dot(L > 0.1 ? 1.0 : float3(1, 2, 3), float3(1, 10, 100))": 121,
    "(L.x > 0.1 ? 1 : 2) + fmod(-5.5, 2.0)": -0.5,
}


@pytest.mark.parametrize("expression", HLSL)
def test_what_hlsl_has_besides(tmp_path: Path, expression: str) -> None:
    text = f"float f(float3 L, float3 V) {{ return {expression}; }}"
    assert np.asarray(family(tmp_path, text, "shader.hlsl").build()(LIGHT, VIEW))[0] == pytest.approx(HLSL[expression])


SLANG = """
import Utils.Math;
__exported import Materials.Fresnel;
typedef float3 Direction;
typealias Number = float;
Texture2D<float4> picture[2] : register(t0);
SamplerState state : register(s0);
static const float scale = 100;
interface ILobe { float eval(const float3 L, const float3 V); }
struct Lobe : ILobe
{
    static const float half_of = 0.5;
    float k;
    [mutating] void twice() { k *= 2; }
    Number own(float scale) { return k * scale; }
    Number eval(const Direction L, const float3 V) { float x = half_of; return own(x) + scale; }
    float3 seen(float2 uv) { return picture[1].Sample(state, uv).rgb; }
};
float f(Direction lightDirWS, float3 viewDirectionWS)
{
    Lobe lobe; lobe.k = 3;
    lobe.twice();
    let all = lobe.eval(lightDirWS, viewDirectionWS);
    var one : float = 1;
    return all + one;
}
"""


def test_what_slang_has_besides(tmp_path: Path) -> None:
    assert np.asarray(family(tmp_path, SLANG, "shader.slang").build()(LIGHT, VIEW))[0] == 104
    path = str(tmp_path / "shader.slang")
    for name in ("eval", "Lobe.eval"):  # a method, with the fields of its struct as parameters
        assert np.asarray(load(f"{path}:{name}", **{"this.k": (8.0, 8.0)}).build()(LIGHT, VIEW))[0] == 104
    for old, new, message in (
        ("[mutating] ", "", "the parameter 'this' is constant"),
        ("own(x) + scale", "seen(V.xy).x", "Sample() cannot be evaluated: a BRDF may depend only on"),
    ):
        with pytest.raises(UsageError, match=re.escape(message)):
            family(tmp_path, SLANG.replace(old, new), "wrong.slang")


SPACES = """
namespace util { float square(float x) { return x * x; } namespace deep { float cube(float x) { return x * square(x); } } }
using namespace util;
namespace models::matt
{
    static const float K = util::deep::cube(2.0);
    class Half { float eval(float3 L, float3 V) { return K; } };
}
float f(float3 L, float3 V)
{
    models::matt::Half half_of;
    return half_of.eval(L, V) + (L.x > 0 ? util::square(3.0) : util::deep::cube(5.0));
}
"""


def test_namespaces_are_read_as_one(tmp_path: Path) -> None:
    for name in ("shader.slang", "shader.hlsl"):
        assert np.asarray(family(tmp_path, SPACES, name).build()(LIGHT, VIEW))[0] == 17
    f = "\nfloat f(float3 L, float3 V) { return a::g(1); }"
    for text, message in (
        (
            "namespace a { float g(int x) { return 1; } } float g(float x) { return 2; }" + f,
            "1:52: error: 'g' is in two namespaces",
        ),
        ("namespace a { float g(int x); } namespace a::b { float g(float x); }" + f, "1:56: error: 'g' is in two namespaces"),
        ("namespace a { float g(int x) { return 1; }" + f, "expected '}' before the end of the file"),
        ("struct A<T> { T k; };" + f, "1:9: error: generics are not read: write the struct"),
        ("T g<T>(T x) { return x; }" + f, "1:1: error: generics are not read"),
        ("enum A { B };" + f, "1:1: error: enums are not read"),
        ("struct A { };" + f, "1:8: error: the struct 'A' has no fields"),
    ):
        with pytest.raises(UsageError, match=re.escape(message)):
            family(tmp_path, text, "wrong.slang")
