"""Shaders that mean harm, or that something has damaged: one line, no traceback, in little time and memory."""

from __future__ import annotations

import contextlib
import random
import re
import resource
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from selection import few
from shaders import write
from test_glsl_text import SLANG, SPACES

from brdfcheck import load
from brdfcheck.messages import UsageError

_MAIN = "float f(vec3 L, vec3 V) { return 1.0; }\n"


def _inside(statements: str, before: str = "") -> str:
    return f"uniform float one = 1.0;\n{before}\nfloat f(vec3 L, vec3 V) {{ {statements} return 1.0; }}\n"


def _calls(depth: int, width: int) -> str:
    functions = ["float g0(float x) { return x * 1.5 + L0; }"]
    for i in range(1, depth):
        functions.append(f"float g{i}(float x) {{ return {' + '.join([f'g{i - 1}(x)'] * width)}; }}")
    return "uniform float L0 = 1.0;\n" + "\n".join(functions) + f"\nfloat f(vec3 L, vec3 V) {{ return g{depth - 1}(L.x); }}"


REFUSED: dict[str, tuple[str, str]] = {
    "parentheses": (_inside(f"float a = {'(' * 5000}1.0{')' * 5000};"), "nested more than"),
    "minus": (_inside(f"float a = {'- ' * 5000}1.0;"), "nested more than"),
    "blocks": (_inside("{" * 5000 + "}" * 5000), "nested more than"),
    "ternaries": (_inside("float a = " + "true ? 1.0 : " * 5000 + "1.0;"), "nested more than"),
    "ifs": (_inside("if (true) " * 5000 + ";"), "nested more than"),
    "elses": (_inside("if (true) ; " + "else if (true) ; " * 5000), "nested more than"),
    "indices": (_inside("float a = L" + "[0]" * 5000 + ";"), "nested more than"),
    "calls": (_inside("float a = " + "sin(" * 5000 + "1.0" + ")" * 5000 + ";"), "nested more than"),
    "braces": (_inside("float a[1] = " + "{" * 5000 + "}" * 5000 + ";"), "nested more than"),
    "operators": (_inside("float a = 1.0" + " + 1.0" * 5000 + ";"), "operators in a row"),
    "arrays": (_inside("float a" + "[9]" * 5000 + ";"), "larger than|nested"),
    "structs": (
        "struct S0 { float a[100]; };\n"
        + "\n".join(f"struct S{i} {{ S{i - 1} a[100]; }};" for i in range(1, 50))
        + _inside("S49 s;"),
        "larger than",
    ),
    "macros": (
        "#define A0 1.0 + 1.0\n"
        + "\n".join(f"#define A{i} A{i - 1} + A{i - 1}" for i in range(1, 60))
        + _inside("float a = A59;"),
        "macros expand",
    ),
    "macros with arguments": (
        "#define B0(x) x + x\n"
        + "\n".join(f"#define B{i}(x) B{i - 1}(B{i - 1}(x))" for i in range(1, 30))
        + _inside("float a = B29(1.0);"),
        "macros expand",
    ),
    "deep calls": (_calls(200, 1), "more than 30 deep"),
    "wide calls": (_calls(25, 3), "too large"),
    "loops that count": (
        _inside("float s = 0.0;" + "".join(f"for (int i{k} = 0; i{k} < 500; i{k}++) " for k in range(4)) + "s += 1.0;"),
        "too large",
    ),
    "a million rounds": (_inside("float s = 0.0; for (int i = 0; i < 1000000; i++) s += one;"), "more than 4096 rounds"),
    "parameters": (
        f"float f(vec3 L, vec3 V{''.join(f', mat4 m{i}' for i in range(500))}) {{ return 1.0; }}",
        "only directions",
    ),
}
ACCEPTED: dict[str, str] = {
    "a thousand rounds": _inside("float s = 0.0; for (int i = 0; i < 1000; i++) s += one;"),
    "a loop without an end": _inside("float s = 0.0; while (one > 0.5) s += one;"),
    "a loop over data without an end": _inside("float s = L.x; while (true) s += one;"),
    "many statements": _inside("float s = L.x;" + "s += one;" * 3000),
    "a macro of itself": "#define A A + A\n#define A1 A2\n#define A2 A1\n" + _MAIN,
    "a long comment": "/*" + "x" * 300_000 + "*/" + _MAIN,
    "many lines": "\n" * 100_000 + _MAIN,
    "a huge shift": "#if 1 << 3\n" + _MAIN + "#endif\n",
}


@contextmanager
def _within(seconds: float) -> Iterator[None]:
    """TimeoutError where the block takes longer."""

    def over(*_: object) -> None:
        raise TimeoutError(f"more than {seconds} seconds")

    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", few(REFUSED, set(REFUSED).difference(("wide calls", "macros", "loops that count"))))
def test_what_asks_for_too_much_is_refused(tmp_path: Path, name: str) -> None:
    text, message = REFUSED[name]
    path = write(tmp_path, text)
    with _within(30), pytest.raises(UsageError, match=message) as caught:
        load(f"{path}:f")
    assert re.match(rf"{re.escape(path)}:\d+:\d+: error: ", str(caught.value))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ACCEPTED)
def test_what_only_looks_large_is_read(tmp_path: Path, name: str) -> None:
    with _within(60):
        load(f"{write(tmp_path, ACCEPTED[name])}:f")


def test_includes_that_go_round(tmp_path: Path) -> None:
    write(tmp_path, '#include "b.glsl"\n', "a.glsl")
    write(tmp_path, '#include "a.glsl"\n', "b.glsl")
    path = write(tmp_path, '#include "a.glsl"\n' + _MAIN)
    with _within(30), pytest.raises(UsageError, match=r"b?a?\.glsl:1:1: error: includes are nested more than"):
        load(f"{path}:f")
    write(tmp_path, '#include "c.glsl"\n#include "c.glsl"\n#include "c.glsl"\n', "c.glsl")
    with _within(30), pytest.raises(UsageError, match="includes are nested"):
        load(write(tmp_path, '#include "c.glsl"\n' + _MAIN, "d.glsl"))
    with _within(30), pytest.raises(UsageError, match="cannot find '/dev/zero'"):
        load(write(tmp_path, '#include "/dev/zero"\n' + _MAIN, "e.glsl"))


def test_a_large_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is larger than"):
        load(f"{write(tmp_path, _MAIN + ' ' * 3_000_000)}:f")


# --- damaged files ---

_SEED = """analytic
::begin parameters
float n 1 100 10
color ks 1 1 1
bool half_ 0
::end parameters
::begin shader
#define PI 3.14159265
#define SQUARE(x) ((x) * (x))
#ifdef GL_ES
precision highp float;
#endif
struct S { vec3 a; float b[2]; };
const float T[3] = float[3](1.0, 2.0, 3.0);
float lobe(float c, in float k);
void twist(inout vec3 v, out float s) { s = v.x; v.xy = v.yx * mat2(1, 2, 3, 4); }
vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y)
{
    vec3 H = normalize(L + V);
    S s; s.a = H; s.b[1] = 2.0;
    float t; twist(s.a, t);
    int i = int(n) % 3;
    uint bits = 0xFFu << 2 ^ 3u;
    for (int j = 0; j < 4; j++) { if (j == 2) continue; t += T[i] * float(j); }
    while (t > 1.0) { t *= 0.5; if (t < 0.1) break; }
    switch (i) { case 0: t += 1.0; break; default: t -= 1.0; }
    if (half_) return ks * 0.5 / PI;
    return ks * lobe(max(dot(N, H), 0.0), n) * SQUARE(t) * (bits > 2u ? 1.0 : 0.0);
}
float lobe(float c, in float k) { return (k + 2.0) / (2.0 * PI) * pow(c, k); }
::end shader
"""
_TOKENS = """
( ) { } [ ] [] ; , . # ## /* */ // " ' ? : = == << % ~ float vec3 mat2 int uint void struct const in out return if else for
while do switch case break discard #include #if #endif #else ::end 1e999 0x 08 1. .5f 4294967295u é nan -1 PI BRDF L N ks
"""
_WORDS = (*_TOKENS.split(), "\\\n", "#define A(x) x A(", "::begin shader", "\x00", "\x1c", "\ud7ff")


def _damaged(number: random.Random, text: str) -> str:
    """A text with a few characters, words or lines lost, doubled, moved or put in."""
    for _ in range(number.choice((1, 1, 1, 2, 3, 8))):
        text = _hurt(number, text) or " "
    return text


def _hurt(number: random.Random, text: str) -> str:
    at, to = sorted(number.randrange(len(text) + 1) for _ in range(2))
    short = min(to, at + number.choice((1, 1, 2, 5, 20, 200)))
    lines = text.split("\n")
    row, other = number.randrange(len(lines)), number.randrange(len(lines))
    strange = chr(number.choice((number.randrange(32, 127), number.randrange(0x2FF))))
    return number.choice(
        (
            text[:at] + text[short:],
            text[:at] + number.choice(_WORDS) + text[at:],
            text[:at] + number.choice(_WORDS) + text[short:],
            text[:at] + text[at:short] * 2 + text[short:],
            text[:at] + strange + text[at:],
            "\n".join([*lines[:row], *lines[row + 1 :]]),
            "\n".join([*lines[:row], lines[other], *lines[row:]]),
            text[:at],
        )
    )


SHADERS = {"brdf": (_SEED, ""), "slang": (SLANG + SPACES.replace("float f(", "float g("), ":f")}


@pytest.mark.parametrize("kind", SHADERS)
@pytest.mark.parametrize(("count", "seed"), [(300, 1), pytest.param(10_000, 2, marks=pytest.mark.slow)])
def test_damaged_files_are_read_or_refused(tmp_path: Path, kind: str, count: int, seed: int) -> None:
    """Never another exception, nor more than 20 s."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    whole, function = SHADERS[kind]
    path = tmp_path / f"damaged.{kind}"
    refused = 0
    for number in range(count):
        text = _damaged(random.Random(seed * 1_000_003 + number), whole)
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        began = time.monotonic()
        said = ""
        try:
            with _within(20):
                load(f"{path}{function}")
        except UsageError as error:
            refused, said = refused + 1, str(error)
        except BaseException as error:
            raise AssertionError(f"number {number} of seed {seed}, after {time.monotonic() - began:.1f} s:\n{text}") from error
        assert "\n" not in said
        assert not said or said.startswith(str(path)), said
    assert refused > count / 2
    assert count - refused > max(10, 0.03 * count)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1_500_000  # kilobytes


@pytest.mark.parametrize("name", ["open.slang", "open.hlsl"])
def test_what_is_open_at_the_end_is_refused(tmp_path: Path, name: str) -> None:
    whole = SLANG + SPACES
    for at in range(0, len(whole), 11):
        (tmp_path / name).write_text(whole[:at])
        with contextlib.suppress(UsageError), _within(20):
            load(str(tmp_path / name))
    for text in ("struct A : B", "namespace a", "interface A", "[a", "struct A {", "cbuffer A : register("):
        (tmp_path / name).write_text(f"float f(float3 L, float3 V) {{ return 1; }} {text}")
        with pytest.raises(UsageError, match="end of the file"), _within(20):
            load(str(tmp_path / name))
