"""Shaders that cannot be read: one line with file, line, column and what is allowed, as a compiler says it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from shaders import FRAME, write

from brdfcheck import load
from brdfcheck.messages import UsageError

# Lines of a shader after `float PI = 3.14;` in line 1; the line and the column of the mistake in the file, and what is said.
SHADERS: dict[str, tuple[str, str, str]] = {
    "no semicolon": ("float f(vec3 L, vec3 V) { float a = 1.0\n return a; }", "3:2", "expected ';' before 'return'"),
    "no parenthesis": ("float f(vec3 L, vec3 V) { return max(1.0, 2.0; }", "2:46", r"expected '\)' before ';'"),
    "no brace": ("float f(vec3 L, vec3 V) { return 1.0;", "2:37", "expected '}' before the end of the file"),
    "no expression": ("float f(vec3 L, vec3 V) { return 1.0 + ; }", "2:40", "expected an expression before ';'"),
    "a strange character": ("float f(vec3 L, vec3 V) { return 1.0 @ 2.0; }", "2:38", "unexpected character '@'"),
    "no number": ("float f(vec3 L, vec3 V) { return 1.0x; }", "2:34", "'1.0x' is no number"),
    "no octal number": ("float f(vec3 L, vec3 V) { return float(09); }", "2:40", "'09' is no octal number"),
    "too large": ("float f(vec3 L, vec3 V) { return float(4294967296); }", "2:40", "does not fit into 32 bits"),
    "no type": ("foo g;\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "there is no type 'foo'"),
    "no type inside": ("float f(vec3 L, vec3 V) { vex3 a; return 1.0; }", "2:27", "there is no type 'vex3'"),
    "undefined": ("float f(vec3 L, vec3 V) { float rough = 1.0; return ruogh; }", "2:53", "not defined; did you mean 'rough'"),
    "undefined function": (
        "float f(vec3 L, vec3 V) { return normalise(L).x; }",
        "2:34",
        "no function 'normalise'; did you mean",
    ),
    "out of scope": ("float f(vec3 L, vec3 V) { { float a; } return a; }", "2:47", "'a' is not defined"),
    "used before": ("float f(vec3 L, vec3 V) { return a; }\nfloat a = 1.0;", "2:34", "'a' is not defined"),
    "twice": ("float f(vec3 L, vec3 V) { float a; int a; return 1.0; }", "2:40", "'a' is declared twice"),
    "function twice": (
        "float g() { return 1.; }\nfloat g() { return 2.; }\nfloat f(vec3 L, vec3 V) { return g(); }",
        "3:7",
        "twice",
    ),
    "argument count": ("float f(vec3 L, vec3 V) { return dot(L); }", "2:34", r"dot\(\) takes 2 arguments; got 1"),
    "argument type": ("float f(vec3 L, vec3 V) { return dot(L, 1.0); }", "2:34", r"no form of dot\(\) takes \(vec3, float\)"),
    "own argument type": (
        "float g(vec2 a) { return 1.; }\nfloat f(vec3 L, vec3 V) { return g(L); }",
        "3:34",
        r"takes \(vec2\); got",
    ),
    "own argument count": (
        "float g(vec2 a) { return 1.; }\nfloat f(vec3 L, vec3 V) { return g(); }",
        "3:34",
        r"1 argument \(vec2\); got 0",
    ),
    "ambiguous": (
        "float g(float a, int b) { return 1.; } float g(int a, float b) { return 2.; }\n"
        "float f(vec3 L, vec3 V) { return g(1, 2); }",
        "3:34",
        "ambiguous",
    ),
    "declared only": ("float g(float a);\nfloat f(vec3 L, vec3 V) { return g(1.0); }", "3:34", "nowhere defined"),
    "recursion": (
        "float g(float a) { return g(a); }\nfloat f(vec3 L, vec3 V) { return g(1.); }",
        "2:27",
        "calls itself; GLSL has no",
    ),
    "round about": (
        "float h(float a);\nfloat g(float a) { return h(a); }\nfloat h(float a) { return g(a); }\n"
        "float f(vec3 L, vec3 V) { return g(1.); }",
        "4:27",
        "no recursion",
    ),
    "recursion behind a global": (
        "float g(float a) { return g(a); }\nfloat K = g(1.0);\nfloat f(vec3 L, vec3 V) { return K; }",
        "2:27",
        r"g\(\) calls itself",
    ),
    "mismatch": ("float f(vec3 L, vec3 V) { return (vec2(1) + vec3(1)).x; }", "2:43", r"'\+' does not take vec2 and vec3"),
    "no implicit int": ("float f(vec3 L, vec3 V) { int a = 1.5; return 1.0; }", "2:35", "must be int; got float"),
    "bool arithmetic": ("float f(vec3 L, vec3 V) { return true + 1.0; }", "2:39", r"'\+' does not take bool and float"),
    "no condition": ("float f(vec3 L, vec3 V) { if (1.0) return 1.0; return 2.0; }", "2:31", "must be bool; got float"),
    "ternary": ("float f(vec3 L, vec3 V) { return true ? 1.0 : L; }", "2:39", "two values of one type"),
    "returns a vector": ("float f(vec3 L, vec3 V) { return L; }", "2:34", r"what f\(\) returns must be float; got vec3"),
    "returns nothing": ("float f(vec3 L, vec3 V) { return; }", "2:27", "a value is missing"),
    "never returns": ("float f(vec3 L, vec3 V) { float a = 1.0; }", "2:7", "there is no return in it"),
    "void value": ("void g() {}\nfloat f(vec3 L, vec3 V) { float a = g(); return a; }", "3:37", "returns nothing"),
    "swizzle": ("float f(vec3 L, vec3 V) { return L.w; }", "2:36", "vec3 has no component 'w'"),
    "mixed swizzle": ("float f(vec3 L, vec3 V) { return L.xg; }", "2:36", "vec3 has no 'xg'"),
    "field": ("struct S { float a; };\nfloat f(vec3 L, vec3 V) { S s; return s.b; }", "3:41", "has no field 'b'.*it has a"),
    "constant": ("float f(vec3 L, vec3 V) { const float a = 1.0; a = 2.0; return a; }", "2:50", "'a' is constant"),
    "constant parameter": (
        "float g(const in float a) { a = 2.0; return a; }\nfloat f(vec3 L, vec3 V) { return g(1.0); }",
        "2:31",
        "the parameter 'a' is constant",
    ),
    "input": ("in vec3 u;\nfloat f(vec3 L, vec3 V) { u.x = 2.0; return u.x; }", "3:31", "the input 'u' cannot be assigned to"),
    "reserved": ("float f(vec3 L, vec3 V) { float for = 2.0; return 1.0; }", "2:33", "'for' is a word of the language"),
    "open comment": ("float f(vec3 L, vec3 V) { return 1.0; }\n /* no end\n#", "3:2", "this comment has no end"),
    "macro arguments": (
        "#define G(x, y) (x + y)\nfloat f(vec3 L, vec3 V) {\n return 1.0 + G(2.0); }",
        "4:15",
        "macro G requires 2 arguments but was passed 1",
    ),
    "no macro name": ("#define 3 4\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "'3' is no name of a macro"),
    "no file to include": ("#include\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "an include is written"),
    "uniform inside": ("float f(vec3 L, vec3 V) { uniform float a; return a; }", "2:41", "'uniform' belongs outside"),
    "uniform": ("uniform float u;\nfloat f(vec3 L, vec3 V) { u = 2.0; return u; }", "3:29", "'u' cannot be assigned to"),
    "no variable": ("float f(vec3 L, vec3 V) { 1.0 = 2.0; return 1.0; }", "2:31", "this is no variable"),
    "twice the same": ("float f(vec3 L, vec3 V) { vec3 a; a.xx = vec2(1); return a.x; }", "2:40", "names a component twice"),
    "out needs a variable": ("void g(out float a) {}\nfloat f(vec3 L, vec3 V) { g(1.0); return 1.0; }", "3:29", "no variable"),
    "index": (
        "float f(vec3 L, vec3 V) { float a[3]; return a[3]; }",
        "2:48",
        r"the index 3 lies outside of float\[3\]: from 0 to 2",
    ),
    "index type": ("float f(vec3 L, vec3 V) { return L[1.0]; }", "2:36", "an index must be int or uint; got float"),
    "size": ("float f(vec3 L, vec3 V) { int n = 2; float a[n]; return 1.0; }", "2:46", "must be a constant whole number"),
    "no size": ("float f(vec3 L, vec3 V) { float a[0]; return 1.0; }", "2:35", "must be from 1 to"),
    "giant": ("float f(vec3 L, vec3 V) { float a[100][100][100]; return 1.0; }", "2:27", "is larger than"),
    "constructor": ("float f(vec3 L, vec3 V) { return vec3(1.0, 2.0).x; }", "2:34", r"vec3\(\) takes 3 numbers; got 2"),
    "constructor with more": ("float f(vec3 L, vec3 V) { return vec2(L, 1.0).x; }", "2:34", "more arguments than it takes"),
    "break": ("float f(vec3 L, vec3 V) { break; return 1.0; }", "2:27", "stands in no loop or switch"),
    "discard": ("float f(vec3 L, vec3 V) { discard; return 1.0; }", "2:27", "no meaning"),
    "case": ("float f(vec3 L, vec3 V) { switch (1) { case 1: case 1: return 1.0; } return 1.0; }", "2:53", "two labels are 1"),
    "texture": (
        "uniform sampler2D t;\nfloat f(vec3 L, vec3 V) { return texture(t, L.xy).r; }",
        "3:34",
        r"texture\(\) cannot be evaluated",
    ),
    "derivative": ("float f(vec3 L, vec3 V) { return dFdx(L.x); }", "2:34", "no neighbouring pixels"),
    "pixel": ("float f(vec3 L, vec3 V) { return gl_FragCoord.x; }", "2:34", "gl_FragCoord has no value here"),
    "result": ("vec4 f(vec3 L, vec3 V) { return vec4(1.0); }", "2:6", r"f\(\) returns vec4; a BRDF returns float or vec3"),
    "roles": ("float f(vec3 a, vec3 b) { return 1.0; }", "2:7", "--args L,V,N"),
    "two lights": ("float f(vec3 wi, vec3 light, vec3 V) { return 1.0; }", "2:7", "both 'wi' and 'light' look like L"),
    "matrix parameter": ("float f(vec3 L, vec3 V, mat3 m) { return m[0].x; }", "2:30", "only directions, numbers, vectors"),
    "matrix uniform": ("uniform mat3 m;\nfloat f(vec3 L, vec3 V) { return m[0].x; }", "2:14", "is a mat3"),
    "include": ('#include "no.glsl"\nfloat f(vec3 L, vec3 V) { return 1.0; }', "2:1", "cannot find 'no.glsl'"),
    "condition": ("#if 1 +\n#endif\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "cannot be evaluated"),
    "no end": ("#ifdef A\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "unterminated"),
    "directive": ("#defin A 1\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "there is no directive #defin"),
    "bare directive": ("#ifdef\n#endif\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "malformed"),
    "error": ("#error not for this\nfloat f(vec3 L, vec3 V) { return 1.0; }", "2:1", "#error not for this"),
    "inside a macro": (
        "#define G(x) (x + undefined)\nfloat f(vec3 L, vec3 V) {\n return 1.0 + G(2.0); }",
        "4:15",
        "'undefined' is not",
    ),
}


@pytest.mark.parametrize("name", SHADERS)
def test_a_mistake_has_a_place_and_says_what_is_allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    text, place, message = SHADERS[name]
    monkeypatch.chdir(tmp_path)
    write(tmp_path, f"float PI = 3.14;\n{text}", "bad.glsl")
    with pytest.raises(UsageError, match=message) as caught:
        load("bad.glsl:f")
    assert str(caught.value).startswith(f"bad.glsl:{place}: error: ")
    assert "\n" not in str(caught.value)


BLOCKS: dict[str, tuple[str, int, str]] = {
    "first line": ("anisotropic\n::begin shader\n::end shader", 1, "begins with 'analytic'"),
    "empty": ("", 1, "begins with 'analytic'"),
    "no shader": ("analytic\n::begin parameters\n::end parameters\n", 0, "has no '::begin shader'"),
    "open parameters": (
        "analytic\n::begin parameters\nfloat a 0 1 0\n::begin shader\n::end shader",
        2,
        "has no '::end parameters'",
    ),
    "open shader": ("analytic\n::begin shader\nfloat BRDF() {}", 2, "has no '::end shader'"),
    "two shaders": ("analytic\n::begin shader\n::end shader\n::begin shader\n::end shader", 4, "two '::begin shader'"),
    "wrong end": ("analytic\n::begin shader\n::end parameters", 3, "ends nothing: '::begin shader' is open"),
    "unknown block": ("analytic\n::begin shaders\n", 2, "did you mean 'shader'"),
    "stray text": ("analytic\nhello\n", 2, "expected '::begin parameters'"),
    "kind": ("analytic\n::begin parameters\nvec3 a 1 1 1\n", 3, "float NAME MIN MAX DEFAULT"),
    "count": ("analytic\n::begin parameters\nfloat a 0 1\n", 3, "float NAME MIN MAX DEFAULT; got 'float a 0 1'"),
    "number": ("analytic\n::begin parameters\nfloat a 0 one 1\n", 3, "'one' is no finite number"),
    "infinite": ("analytic\n::begin parameters\nfloat a 0 inf 1\n", 3, "'inf' is no finite number"),
    "bounds": ("analytic\n::begin parameters\nfloat a 2 1 1\n", 3, "MIN must not exceed MAX; got 2 > 1"),
    "bool": ("analytic\n::begin parameters\nbool a 2\n", 3, "a bool is 0 or 1; got 2"),
    "name": ("analytic\n::begin parameters\nbool 2a 1\n", 3, "'2a' is no name"),
    "reserved name": ("analytic\n::begin parameters\nbool for 1\n", 3, "'for' is no name"),
    "name of a type": ("analytic\n::begin parameters\nfloat vec3 0 1 0\n", 3, "'vec3' is no name"),
    "twice": ("analytic\n::begin parameters\nbool a 1\nfloat a 0 1 0\n", 4, "two parameters 'a'"),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_mistake_outside_of_the_shader(tmp_path: Path, name: str) -> None:
    text, line, message = BLOCKS[name]
    path = write(tmp_path, text, "bad.brdf")
    with pytest.raises(UsageError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}:{line}:" if line else f"{path}: error: ")


def test_which_function_is_meant(tmp_path: Path) -> None:
    body = "(vec3 L, vec3 V, vec3 N) { return vec3(1.0); }"
    two = write(tmp_path, f"vec3 matte{body}\nvec3 shiny{body}")
    with pytest.raises(UsageError, match="two functions could be the BRDF, 'matte' and 'shiny': name one, as in"):
        load(two)
    assert load(f"{two}:shiny").build()([[0, 0, 1.0]], [[0, 0, 1.0]]).tolist() == [[1, 1, 1]]
    with pytest.raises(UsageError, match=r"there is no function 'shinny'; did you mean 'shiny'\?"):
        load(f"{two}:shinny")
    with pytest.raises(UsageError, match=r"no function takes a light and a view direction.*the file has a, b"):
        load(write(tmp_path, "float a(float x) { return x; } float b(float x) { return x; }", "none.glsl"))
    with pytest.raises(UsageError, match="there is no function 'BRDF'; the file has 'brdf'"):
        load(write(tmp_path, f"analytic\n::begin shader\nvec3 brdf{body}\n::end shader", "case.brdf"))
    # A function that the other one calls is not meant.
    helped = write(tmp_path, f"vec3 lobe{body}\nvec3 whole(vec3 L, vec3 V) {{ return lobe(L, V, V) * 2.0; }}", "helped.glsl")
    assert load(helped).name == f"{helped}:whole"


def test_what_nobody_calls_may_hold_anything(tmp_path: Path) -> None:
    text = f"uniform sampler2D t;\nvec3 g() {{ return texture(t, gl_FragCoord.xy).rgb; }}\n{FRAME} {{ return vec3(0.5); }}"
    assert load(f"{write(tmp_path, text)}:f").build()([[0, 0, 1.0]], [[0, 0, 1.0]]).tolist() == [[0.5] * 3]


@pytest.mark.parametrize("spec", ["some.osl", "some.osl:f", "folder/some.txt:f", "noending:f"])
def test_an_unknown_ending_says_which_readers_there_are(spec: str) -> None:
    with pytest.raises(UsageError) as caught:
        load(spec)
    for words in ("there is no reader", "Python (.py)", ".brdf", ".glsl", ".hlsl", ".slang"):
        assert words in str(caught.value)
    assert "phong" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [("absent.glsl", "there is no file"), ("folder.glsl", "is a folder"), ("zeros.glsl", "is not text")],
)
def test_files_that_cannot_be_read(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "folder.glsl").mkdir()
    (tmp_path / "zeros.glsl").write_bytes(b"float\0")
    with pytest.raises(UsageError, match=re.escape(message)):
        load(str(tmp_path / name))
