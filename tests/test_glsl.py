"""Shader files as families of BRDFs: parameters, directions, options, verdicts, and the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shaders import FRAME, LIGHT, VIEW, family, folded, traced, write
from shared import Run

import brdfcheck
from brdfcheck import load
from brdfcheck.brdf.callables import Evaluator
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.subject import resolve
from brdfcheck.messages import UsageError
from brdfcheck.verdict.box import Box

HALVED = """analytic
# a comment
::begin parameters
float n 1 20 4      // with a comment
float k 0 2 0.5
color tint 0.9 0.5 0.1
bool halved 1
::end parameters
::begin shader
vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y)
{
    vec3 f = k * tint * n * L.x;
    if (halved) f *= 0.5;
    return f + V.y * X.x + Y.y * N.z;
}
::end shader
"""


def at(built: Any) -> list[float]:
    return np.asarray(built(LIGHT, VIEW))[0].tolist()


# --- parameters ---


def test_parameters_of_a_brdf_file_run_over_their_ranges(tmp_path: Path) -> None:
    found = load(write(tmp_path, HALVED, "a.brdf"))
    assert dict(found.ranges) == {"n": (1, 20), "k": (0, 2), "halved": (0, 1)}
    assert found.switches == {"halved"}
    assert dict(found.held) == {"tint": 1}
    assert dict(found.defaults) == {"n": 4, "k": 0.5, "halved": 1}
    assert at(found.build(n=2.0, k=1.0, halved=0.0)) == pytest.approx([2 * 0.6 + 1.28] * 3)
    assert at(found.build(n=2.0, k=1.0, halved=1.0)) == pytest.approx([0.6 + 1.28] * 3)


def test_parameters_are_held_by_over(tmp_path: Path) -> None:
    path = write(tmp_path, HALVED, "a.brdf")
    held = load(path, n=(2, 2), k=(1, 1), halved=(0, 0), tint=(0.5, 0.2, 0.1))
    assert not held.ranges
    assert dict(held.held) == {"n": 2, "k": 1, "halved": 0, "tint.r": 0.5, "tint.g": 0.2, "tint.b": 0.1}
    assert at(held.build()) == pytest.approx([0.6 + 1.28, 0.24 + 1.28, 0.12 + 1.28])
    grey = load(path, n=(2, 2), k=(1, 1), halved=(0, 0), tint=(0, 1))
    assert dict(grey.ranges) == {"tint": (0, 1)}
    assert at(grey.build(tint=0.25)) == pytest.approx([0.3 + 1.28] * 3)
    one = load(path, n=(2, 2), k=(1, 1), halved=(0, 0), **{"tint.g": (0, 1)})
    assert at(one.build(**{"tint.g": 0.25})) == pytest.approx([1.2 + 1.28, 0.3 + 1.28, 1.2 + 1.28])


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"m": (0, 1)}, "has no parameter 'm'; its parameters: n, k, tint, halved"),
        ({"halved": (0, 0.5)}, "halved is a bool: 0, 1 or 0:1; got 0:0.5"),
        ({"n": (3, 2)}, "the range of n is empty"),
    ],
)
def test_ranges_that_do_not_belong(tmp_path: Path, ranges: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        load(write(tmp_path, HALVED, "a.brdf"), **ranges)


def test_uniforms_arguments_and_macros_are_parameters(tmp_path: Path) -> None:
    text = (
        "#define GAIN 3.0\n#define STEPS 2\nuniform float a;\nuniform float b = 7.0;\nuniform vec3 c = vec3(1, 2, 3);\n"
        "uniform mat4 unused;\nuniform float idle;\n"
        "vec3 f(vec3 L, vec3 V, vec3 N, float d, out float pdf) { float s = 0.0; for (int i = 0; i < STEPS; i++) s += 1.0;"
        " pdf = 1.0; return GAIN * (a + b + c + d) * s; }\n"
    )
    with pytest.raises(UsageError, match=r"the parameters a, d must be given a range: --over a=LO:HI --over d=LO:HI"):
        family(tmp_path, text)
    found = family(tmp_path, text, a=(0, 1), d=(2, 2))
    assert dict(found.ranges) == {"a": (0, 1)}
    assert at(found.build(a=0.5)) == pytest.approx([6 * (0.5 + 7 + c + 2) for c in (1, 2, 3)])
    more = family(tmp_path, text, a=(0, 0), d=(0, 1), GAIN=(1, 2), STEPS=(5, 5), b=(1, 1), c=(0, 0, 4), idle=(0, 0))
    assert dict(more.ranges) == {"d": (0, 1), "GAIN": (1, 2)}
    assert at(more.build(d=0.5, GAIN=1.5)) == pytest.approx([1.5 * 1.5 * 5] * 2 + [1.5 * 5.5 * 5])
    assert at(family(tmp_path, text, a=(0, 0), d=(0, 0), defines={"GAIN": "1.0"}).build()) == pytest.approx([16, 18, 20])


def test_fields_of_structs_are_parameters(tmp_path: Path) -> None:
    text = (
        "struct Coat { float weight; };\nstruct Surface { vec3 albedo; Coat coat; };\n"
        "uniform Surface base = Surface(vec3(1, 2, 3), Coat(0.5));\n"
        "vec3 f(vec3 L, vec3 V, vec3 N, Surface s) { return s.albedo * s.coat.weight + base.albedo * base.coat.weight; }\n"
    )
    with pytest.raises(UsageError, match=r"the parameters s\.albedo, s\.coat\.weight must be given a range"):
        family(tmp_path, text)
    ranges: dict[str, Any] = {"s.albedo": (10, 20, 30), "s.coat.weight": (0, 1), "base.albedo.g": (4, 4)}
    found = family(tmp_path, text, **ranges)
    assert dict(found.ranges) == {"s.coat.weight": (0, 1)}
    assert at(found.build(**{"s.coat.weight": 0.1})) == pytest.approx([1.5, 4, 4.5])


def test_whole_numbers_are_held(tmp_path: Path) -> None:
    text = "uniform int n;\nuniform bool b;\nfloat f(vec3 L, vec3 V) { return b ? float(n / 2) : 0.0; }"
    found = family(tmp_path, text, n=(7, 7), b=(0, 1))
    assert np.asarray(found.build(b=1.0)(LIGHT, VIEW)).tolist() == [3.0]
    with pytest.raises(UsageError, match="n is a whole number: give one, as in --over n=2; got 1:3"):
        family(tmp_path, text, n=(1, 3), b=(0, 1))


# --- directions and options ---


@pytest.mark.parametrize(
    "arguments",
    [
        "vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y",
        "vec3 wi, vec3 wo, vec3 n, vec3 t, vec3 b",
        "vec3 lightDir, vec3 viewDir, vec3 normal, vec3 tangent, vec3 bitangent",
        "vec3 u_light, vec3 toEye, vec3 n, vec3 X, vec3 Y",
    ],
)
def test_directions_are_known_by_their_names(tmp_path: Path, arguments: str) -> None:
    light, view, normal, x, y = (word.split()[-1] for word in arguments.split(","))
    text = f"vec3 f({arguments}) {{ return vec3({light}.x + {view}.y, {normal}.z, {x}.x + 2.0 * {y}.y); }}"
    assert at(family(tmp_path, text).build()) == pytest.approx([0.88, 1, 3])


def test_a_name_that_only_resembles_a_role_gives_way(tmp_path: Path) -> None:
    found = family(tmp_path, "vec3 f(vec3 V, vec3 L, vec3 N, vec3 e, vec3 i) { return e + i + L.x; }", e=(1, 1), i=(0, 1, 2))
    assert at(found.build()) == pytest.approx([1.6, 2.6, 3.6])


def test_directions_are_told_by_args(tmp_path: Path) -> None:
    text = "float f(vec3 p, float g, vec3 q, vec3 r) { return p.x + 10.0 * q.x + 100.0 * r.z + g; }"
    found = family(tmp_path, text, args="V,g,L,N", g=(0, 0))
    assert np.asarray(found.build()(LIGHT, VIEW)).tolist() == [106.0]
    with pytest.raises(UsageError, match="--args names 2 arguments"):
        family(tmp_path, text, args="V,L", g=(0, 0))
    with pytest.raises(UsageError, match="L and V among them"):
        family(tmp_path, text, args="V,g,N,N", g=(0, 0))
    with pytest.raises(UsageError, match="L is a vec3; the argument 'g'"):
        family(tmp_path, text, args="V,L,N,L", g=(0, 0))


def test_a_function_may_include_the_cosine(tmp_path: Path) -> None:
    text = f"{FRAME} {{ return vec3(0.25) * dot(N, L); }}"
    assert at(family(tmp_path, text, returns="brdf*cos").build()) == pytest.approx([0.25] * 3)
    below = np.array([[0.6, 0.0, -0.8]])
    assert np.asarray(family(tmp_path, text, returns="brdf*cos").build()(below, VIEW)).tolist() == [[0.0, 0.0, 0.0]]
    with pytest.raises(UsageError, match=r"brdf or brdf\*cos"):
        family(tmp_path, text, returns="cos")


def test_includes_and_macros(tmp_path: Path) -> None:
    write(tmp_path, "#ifndef ONCE\n#define ONCE\n#define PI 3.0\nfloat g(float x) { return x * PI; }\n#endif\n", "lib/a.inc")
    write(tmp_path, '#include "a.inc"\n', "lib/b.inc")
    text = '#include "a.inc"\n#include "b.inc"\n#ifdef FAST\n#define K 1.0\n#else\n#define K 2.0\n#endif\n'
    text += "#define SQ(x) ((x)*(x))\n"
    text += (
        "#define JOIN(a, b) a##b\nfloat f(vec3 L, vec3 V) {\n float JOIN(va, lue) = SQ(K + 1.0) \\\n  + g(1.0); return value; }"
    )
    folders = [str(tmp_path / "lib")]
    assert np.asarray(family(tmp_path, text, folders=folders).build()(LIGHT, VIEW)) == 12
    assert np.asarray(family(tmp_path, text, folders=folders, defines={"FAST": ""}).build()(LIGHT, VIEW)) == 7
    with pytest.raises(UsageError, match=r"shader.glsl:1:1: error: cannot find 'a.inc'.*-I FOLDER"):
        family(tmp_path, text)


def test_options_belong_to_shaders(tmp_path: Path) -> None:
    python = write(tmp_path, "def f(wi, wo): return wi[..., 2]\n", "mine.py")
    for name in ("phong", f"{python}:f"):
        with pytest.raises(UsageError, match="-D, -I and --args are for shader files"):
            resolve([name], {}, None, Reading(folders=("include",)))
    with pytest.raises(UsageError, match="--returns is for functions in files; got phong, ggx"):
        resolve(["phong", "ggx"], {}, None, Reading(returns="brdf*cos"))


def test_a_range_may_belong_to_one_of_several(tmp_path: Path) -> None:
    path = write(tmp_path, HALVED, "a.brdf")
    shader, lobe = resolve([path, "phong-classical"], {"k": (0.5, 0.5), "n": (2.0, 3.0)}, None)
    assert dict(shader.family.ranges) == {"n": (2, 3), "halved": (0, 1)}
    assert dict(lobe.family.ranges) == {"n": (2, 3)}
    with pytest.raises(UsageError, match="has no parameter 'zzz'"):
        resolve([path], {"zzz": (0.5, 0.5)}, None)


# --- other languages ---


@pytest.mark.parametrize("name", ["shader.hlsl", "shader.slang"])
def test_hlsl(tmp_path: Path, name: str) -> None:
    text = """
cbuffer Material : register(b0) { float one; };
static const float PI = 3.0;
struct Surface { float3 albedo; float rough; };
static float3 table[2] = { float3(1, 2, 3), { 4, 5, 6 } };
Surface make(in float3 a) { Surface s = (Surface)0; s.albedo = a; return s; }
[noinline] float3 f(float3 L : TEXCOORD0, float3 V : TEXCOORD1, float3 N) : SV_Target
{
    float3 v = 0.5 * one;
    float2x3 m = float2x3(1, 2, 3, 4, 5, 6);
    float2 r = mul(m, float3(one, 0, 1));
    float3 c = mul(float2(1, one), m);
    float s, co; sincos(0.0, s, co);
    half h = lerp(0.0h, 2.0h, 0.25) + frac(1.25) + saturate(3.0 * one) + rsqrt(4.0) + fmod(-5.5, 2.0);
    int i = (int)(2.9 * one) % 3;
    float3 w = make((float3)one).albedo + table[1];
    bool big = all(v > 0.25) && any(float2(0, one));
    [unroll] for (uint k = 0; k < 2; ++k) w.x += m[k][1];
    return float3(r.x + r.y * 10 + c.y, h + co + i, big ? w.x : 0) / PI;
}
"""
    expected = pytest.approx([(4 + 100 + 7) / 3, (0.5 + 0.25 + 1 + 0.5 - 1.5 + 1 + 2) / 3, (5 + 2 + 5) / 3])
    assert folded(tmp_path, text, name) == expected
    assert traced(tmp_path, {"": text}, name)[""] == expected


# --- numbers ---


def test_lanes_part_and_meet_again(tmp_path: Path) -> None:
    """Different ways through one program: each lane has what it would have alone."""
    text = """
float f(vec3 L, vec3 V, vec3 N)
{
    float s = 0.0;
    int rounds = 0;
    if (L.x < -0.5) return -1.0;
    for (int i = 0; i < 8; i++) {
        if (V.x > 0.3 && i > 3) break;
        if (i == 2 && L.y > 0.0) continue;
        s += L.x * float(i);
    }
    float x = abs(V.y) + 0.1;
    while (x < 5.0) {
        x *= 2.0;
        if (x > 3.0 && L.z > 0.7) return s + 100.0;
        rounds++;
    }
    switch (rounds) { case 2: s += 1000.0; case 3: s += 2000.0; break; case 4: return 7.0; default: s -= x; }
    return s;
}
"""

    def alone(light: np.ndarray, view: np.ndarray) -> float:
        s, rounds = 0.0, 0
        if light[0] < -0.5:
            return -1.0
        for i in range(8):
            if view[0] > 0.3 and i > 3:
                break
            if i == 2 and light[1] > 0:
                continue
            s += light[0] * i
        x = abs(view[1]) + 0.1
        while x < 5:
            x *= 2
            if x > 3 and light[2] > 0.7:
                return s + 100
            rounds += 1
        if rounds == 4:
            return 7.0
        return s + 3000 if rounds == 2 else s + 2000 if rounds == 3 else s - x

    random = np.random.default_rng(2)
    wi, wo = random.normal(size=(2, 400, 3))
    wi, wo = (part / np.linalg.norm(part, axis=1, keepdims=True) for part in (wi, wo))
    found = np.asarray(jax.jit(family(tmp_path, text).build())(wi, wo))
    expected = np.array([alone(a, b) for a, b in zip(wi, wo, strict=True)])
    assert len({round(value, 3) for value in expected}) > 100
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-14)


# Expressions of x = L.x - 0.6, which is 0, that have no value or no slope there, each behind a mask.
_POISON = {
    "division": "1.0 / x",
    "root": "sqrt(x - 0.1)",
    "root at 0": "sqrt(x)",
    "inverse root": "inversesqrt(x)",
    "power": "pow(x, 0.5)",
    "negative power": "pow(x, -2.0)",
    "logarithm": "log(x) + log2(x)",
    "arc": "asin(x + 1.5) + acos(x + 1.0)",
    "angle": "atan(x, x)",
    "length": "length(vec2(x, 0.0)) + normalize(vec2(x, 0.0)).x",
    "overflow": "exp(1.0 / x) + cosh(1e4 + x)",
    "remainder": "mod(1.0, x)",
    "step": "smoothstep(x, x, x)",
    "inverse": "inverse(mat2(x, 0.0, 0.0, x))[0].x",
}


@pytest.mark.parametrize("name", _POISON)
@pytest.mark.parametrize("shape", ["if (x > 0.1) s = {0};", "s = x > 0.1 ? {0} : 2.0;", "if (x <= 0.1) return 2.0; s = {0};"])
def test_what_a_mask_excludes_spoils_neither_value_nor_derivative(tmp_path: Path, name: str, shape: str) -> None:
    text = (
        "uniform float scale;\nfloat f(vec3 L, vec3 V, vec3 N) { float x = (L.x - 0.6) * scale; float s = 2.0; "
        + shape.format(_POISON[name])
        + " return s; }"
    )
    built = family(tmp_path, text, scale=(0, 2)).build

    def value(scale: Any, light: Any) -> Any:
        return built(scale=scale)(light, VIEW)[0]

    assert value(jnp.asarray(1.0), LIGHT) == 2
    slope, turned = jax.grad(value, argnums=(0, 1))(jnp.asarray(1.0), jnp.asarray(LIGHT))
    assert slope == 0
    assert np.all(np.asarray(turned) == 0)


def test_derivatives_are_those_of_the_formula(tmp_path: Path) -> None:
    text = f"uniform float n;\n{FRAME} {{ return vec3(pow(max(dot(N, normalize(L + V)), 0.0), n)); }}"
    built = family(tmp_path, text, n=(1, 50)).build
    cosine = 1.76 / np.linalg.norm([0.6, 0.28, 1.76])
    slope = jax.grad(lambda n: built(n=n)(LIGHT, VIEW)[0, 0])(jnp.asarray(9.0))
    assert slope == pytest.approx(cosine**9 * np.log(cosine), rel=1e-13)


def test_a_loop_without_an_end_has_no_value(tmp_path: Path) -> None:
    text = "float f(vec3 L, vec3 V, vec3 N) { float s = L.x; while (s > 0.0) { s += 1.0; } return s; }"
    wi = np.array([[0.6, 0, 0.8], [-0.6, 0, 0.8]])
    found = np.asarray(jax.jit(family(tmp_path, text).build())(wi, np.repeat(VIEW, 2, axis=0)))
    assert np.isnan(found[0])
    assert found[1] == -0.6


def test_the_program_is_small_where_much_is_known(tmp_path: Path) -> None:
    """Tables that a loop fills from numbers, and branches on them, are folded: nothing of them is left to the compiler."""
    text = """
const float T[4] = float[4](0.1, 0.2, 0.3, 0.4);
uniform bool rough = true;
float weight(int i) { float s = 0.0; for (int k = 0; k <= i; k++) s += sqrt(T[k]) * pow(2.0, float(k)); return s; }
float f(vec3 L, vec3 V, vec3 N) { float s = 0.0; for (int i = 0; i < 4; i++) s += weight(i); return rough ? s * L.x : V.x; }
"""
    program = jax.make_jaxpr(family(tmp_path, text).build())(LIGHT, VIEW)
    assert len(program.jaxpr.eqns) < 15


def test_float32_where_the_process_has_it(tmp_path: Path) -> None:
    built = family(tmp_path, f"{FRAME} {{ return vec3(L.x * 0.5); }}").build()
    with jax.enable_x64(False):
        assert built(jnp.asarray(LIGHT, jnp.float32), jnp.asarray(VIEW, jnp.float32)).dtype == jnp.float32


def test_the_evaluator_takes_it_as_a_program(tmp_path: Path) -> None:
    found = load(write(tmp_path, HALVED, "a.brdf"))
    evaluator = Evaluator(found.build, dict(found.defaults))
    assert not evaluator.slow
    assert evaluator.channels == 3
    assert evaluator.disagreement(dict(found.defaults)) is None


def test_a_switch_takes_its_two_ends_only() -> None:
    box = Box({"b": (0.0, 1.0), "x": (0.0, 1.0)}, (0.0, 1.0), turning=False, switches=frozenset({"b"}))
    parameters = box.physical(box.scan(200, 0, 65))[0]
    assert set(parameters[:, 0]) == {0.0, 1.0}
    assert len(set(parameters[:, 1])) > 50


# --- verdicts and the command line ---


def test_the_worst_of_both_switches_and_all_channels_is_found(tmp_path: Path) -> None:
    """(n + 2) / (2 pi) cos^n about the mirror has albedo 1 at normal incidence, times the gain of the switch and the colour."""
    text = """analytic
::begin parameters
float n 2 10 4
color tint 0.5 0.5 0.5
bool gain 0
::end parameters
::begin shader
vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y)
{
    float c = max(dot(reflect(-L, N), V), 0.0);
    return tint * (gain ? 1.25 : 0.5) * (n + 2.0) / 6.283185307179586 * pow(c, n);
}
::end shader
"""
    path = write(tmp_path, text, "a.brdf")
    report = brdfcheck.check(load(path, n=(3, 3), tint=(0.2, 0.9, 0.4)), effort="quick")
    assert report.verdict.name == "VIOLATES"
    assert report.albedo == pytest.approx(1.125, abs=1e-9)
    assert report.parameters["gain"] == 1
    assert set(report.width) == {"angle", "cell", "view"}, "between the two values of a switch there is nothing to miss"
    quiet = brdfcheck.check(path, n=(3, 3), gain=(0, 0), cos_theta=(1, 1), effort="quick")
    assert quiet.verdict.name == "CONSERVES"
    assert quiet.albedo == pytest.approx(0.5, abs=1e-9)


def test_check_on_the_command_line(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path, HALVED.replace("* L.x", "/ 64.0").replace("+ V.y * X.x + Y.y * N.z", ""), "a.brdf")
    held = ("--over", "n=4", "--over", "halved=0", "--over", "tint=1,0.5,0.25", "--effort", "quick")
    record = json.loads(run.passed("check", path, *held, "--json", "-"))
    (result,) = record["results"]
    assert (result["file"], result["line"], result["verdict"]) == (path, 10, "CONSERVES")
    assert result["albedo"] == pytest.approx(2 * 4 / 64 * np.pi, rel=1e-9)  # k = 2 of its range
    assert record["settings"]["over"]["tint"] == [1, 0.5, 0.25]  # as it was asked


def test_check_of_a_function_with_options(tmp_path: Path, run: Run) -> None:
    text = '#include "pi.inc"\nvec3 f(vec3 a, vec3 b, float k) { return vec3(k / PI * b.z * TWICE); }'
    write(tmp_path, "#define PI 3.141592653589793\n", "inc/pi.inc")
    path = write(tmp_path, text)
    words = ["check", f"{path}:f", "--over", "k=0:0.75", "--args", "V,L,k", "--returns", "brdf*cos", "-D", "TWICE=2.0"]
    words += ["-I", str(tmp_path / "inc"), "--effort", "quick", "--cos-theta", "0.5", "--json", "-"]
    record = json.loads(run.failed(*words))
    assert record["results"][0]["albedo"] == pytest.approx(1.5, rel=1e-9)
    assert record["settings"]["reading"]["returns"] == "brdf*cos"


def test_mistakes_on_the_command_line(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path, f"{FRAME} {{ return vec3(1.0; }}")
    for words, message in (
        ((f"{path}:f",), f"{path}:1:49: error: expected ')' before ';'"),
        ((f"{path}:f", "--args", "L,N"), "--args: must name the arguments in order, L and V among them"),
        ((f"{path}:f", "-D", "2x"), "must be NAME or NAME=VALUE"),
    ):
        assert message in run.refused("check", *words)


def test_line_ends_of_any_system(tmp_path: Path) -> None:
    for number, ends in enumerate(("\r\n", "\r", "\n")):
        path = tmp_path / f"{number}.brdf"
        path.write_bytes(b"\xef\xbb\xbf" + HALVED.replace("\n", ends).encode())
        found = load(str(path), n=(2, 2), k=(1, 1), halved=(0, 0))
        assert at(found.build()) == pytest.approx([2.48] * 3)
        path.write_bytes(HALVED.replace("L.x;", "L.w;").replace("\n", ends).encode())
        with pytest.raises(UsageError, match=r"\.brdf:12:31: error: vec3 has no component 'w'"):
            load(str(path))
