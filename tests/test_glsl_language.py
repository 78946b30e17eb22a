"""What GLSL means, construct by construct, against values worked out by hand; folded and traced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shaders import folded, traced

# The body of `float f(vec3 L, vec3 V, vec3 N)`, in which `one` is a uniform of value 1; before "###" is what is before f.
CASES: dict[str, tuple[str, float]] = {
    "precedence": ("return one + 2.0 * 3.0 - 8.0 / 4.0;", 5),
    "left to right": ("return 10.0 - one - 2.0 - 3.0;", 4),
    "unary minus": ("return -one * -3.0;", 3),
    "ternary": ("return one > 0.5 ? 2.0 : 3.0;", 2),
    "nested ternary": ("return one > 2.0 ? 1.0 : one > 0.5 ? 5.0 : 3.0;", 5),
    "comma": ("float a; return (a = one, a + 1.0);", 2),
    "logic": ("return (one > 0.0 && !(one > 2.0)) || false ? 1.0 : 0.0;", 1),
    "exclusive or": ("return (one > 0.0 ^^ one > 2.0) ? 1.0 : 0.0;", 1),
    "short circuit": ("int i = 0; bool b = one > 5.0 && i++ == 0; return float(i);", 0),
    "short circuit or": ("int i = 0; bool b = one > 0.5 || i++ == 0; return float(i);", 0),
    "increments": ("float a = one; float b = a++; float c = --a; return a * 100.0 + b * 10.0 + c;", 111),
    "compound": ("float a = one; a += 3.0; a *= 5.0; a -= 2.0; a /= 6.0; return a;", 3),
    "vector compound": ("vec3 a = vec3(one); a *= vec3(2, 3, 4); a.xy += a.yz; return a.x * 100.0 + a.y * 10.0 + a.z;", 574),
    "scopes": ("float a = one; { float a = 5.0; a += 1.0; } return a;", 1),
    "for scope": ("float i = 7.0; for (int i = 0; i < 3; i++) {} return i * one;", 7),
    "constant": ("const float k = 3.0; const float j = k * 2.0; return j * one;", 6),
    "swizzle": ("vec4 a = vec4(1, 2, 3, 4) * one; return a.wzyx.y * 10.0 + a.gb.x;", 32),
    "swizzle stpq": ("vec4 a = vec4(1, 2, 3, 4) * one; return a.q * 10.0 + a.ts.x;", 42),
    "swizzle target": ("vec3 a = vec3(0); a.zx = vec2(one, 2.0); return a.x * 100.0 + a.y * 10.0 + a.z;", 201),
    "swizzle of swizzle": ("vec4 a = vec4(0); a.wzy.xz = vec2(one, 2.0); return a.w * 10.0 + a.y;", 12),
    "vector index": ("vec3 a = vec3(1, 2, 3) * one; a[1] = 9.0; int i = 1; return a[i] * 10.0 + a[2];", 93),
    "data index": ("vec4 a = vec4(5, 6, 7, 8); int i = int(one + 1.5); return a[i];", 7),
    "data index target": ("vec3 a = vec3(0); int i = int(one); a[i] = 4.0; return a.x * 100.0 + a.y * 10.0 + a.z;", 40),
    "array": ("float a[3]; a[0] = one; a[1] = 2.0; a[2] = a[0] + a[1]; return a[2] * 10.0 + float(a.length());", 33),
    "array constructor": ("float a[] = float[](one, 2.0, 4.0); return a[2] + float(a.length());", 7),
    "array of its type": ("float[2] a = float[2](one, 2.0); return a[1];", 2),
    "array copy": ("float a[2] = float[2](one, 2.0); float b[2] = a; b[0] = 5.0; return a[0] * 10.0 + b[0];", 15),
    "nested array": ("float a[2][3]; a[1][2] = one; a[0][0] = 3.0; return a[1][2] + a[0][0] + float(a[0].length());", 7),
    "constant table": ("const float t[5] = float[5](2., 3., 5., 7., 11.); int i = int(one * 3.2); return t[i];", 7),
    "long table": (
        "const float t[8] = float[8](2., 3., 5., 7., 11., 13., 17., 19.); return t[int(one * 6.1)] + t[7];",
        36,
    ),
    "traced table": ("float t[6]; for (int i = 0; i < 6; ++i) t[i] = one * float(i * i); return t[int(one * 4.0)];", 16),
    "traced table target": (
        "float t[6]; for (int i = 0; i < 6; ++i) t[i] = one; t[int(one * 4.0)] = 9.0; return t[4] + t[3];",
        10,
    ),
    "table of vectors": (
        "const vec2 t[5] = vec2[](vec2(1), vec2(2), vec2(3), vec2(4, 6), vec2(5)); return t[int(one * 3.)].y;",
        6,
    ),
    "struct": ("struct S { float a; vec3 b; }; ### S s = S(one, vec3(2, 3, 4)); s.b.y = 9.0; return s.a * 10.0 + s.b.y;", 19),
    "struct in struct": (
        "struct I { float a[2]; }; struct O { I i; float c; }; ### O o; o.i.a[1] = one; o.c = 2.0; O p = o; p.c = 3.0;"
        " return o.i.a[1] * 100.0 + o.c * 10.0 + p.c;",
        123,
    ),
    "structs are equal": ("struct S { float a; vec2 b; }; ### S s = S(one, vec2(2)); S t = s; return s == t ? 1.0 : 0.0;", 1),
    "array of structs": ("struct S { float a; }; ### S s[2]; s[1].a = one; s[0].a = 4.0; return s[1].a * 10.0 + s[0].a;", 14),
    "local struct": ("struct T { int n; } t; t.n = int(one) + 4; return float(t.n);", 5),
    "vectors are equal": ("return vec3(one) == vec3(1) && vec2(one) != vec2(1, 2) ? 1.0 : 0.0;", 1),
    "overloads": (
        "float g(float x) { return 1.0; } float g(vec2 x) { return 2.0; } ### return g(vec2(one)) * 10.0 + g(one);",
        21,
    ),
    "overload of a built-in": ("float mix(float a) { return a * 7.0; } ### return mix(one) + mix(0.0, 2.0, one);", 9),
    "overload by conversion": ("float g(float x) { return x * 2.0; } ### return g(3) * one;", 6),
    "nearest overload": ("float g(float x) { return 1.0; } float g(uint x) { return 2.0; } ### return g(3) * one;", 2),
    "prototype": ("float g(float x); ### return g(one); } float g(float x) { return x + 2.0;", 3),
    "out": ("void g(out float a, float b) { a = b * 2.0; } ### float x = 5.0; g(x, one); return x;", 2),
    "inout": ("void g(inout float a) { a = a * 3.0; a += 1.0; } ### float x = one; g(x); g(x); return x;", 13),
    "inout swizzle": (
        "void g(inout vec2 a) { a = a.yx; } ### vec3 v = vec3(one, 2, 3); g(v.xz); return v.x * 100. + v.y * 10. + v.z;",
        321,
    ),
    "out converts": ("void g(out int a) { a = 3; } ### float x; g(x); return x * one;", 3),
    "parameters are copies": ("float g(float a) { a = a + 1.0; return a; } ### float x = one; g(x); return x;", 1),
    "early return": ("float g(float x) { if (x > 0.5) return 1.0; return 2.0; } ### return g(one) * 10.0 + g(one - 1.0);", 12),
    "return in a loop": (
        "float g(float x) { for (int i = 0; i < 9; i++) { if (x * float(i) > 3.5) return float(i); } return"
        " -1.; } ### return g(one);",
        4,
    ),
    "global": ("float total = 0.0; void add(float x) { total += x; } ### add(one); add(2.0); return total;", 3),
    "global table": ("const float T[3] = float[3](1.0, 20.0, 300.0); ### return T[0] + T[1] + T[2] * one;", 321),
    "global of a global": ("const float A = 2.0; const float B = A * A + 1.0; ### return B * one;", 5),
    "for": ("float s = 0.0; for (int i = 0; i < 5; i++) s += float(i) * one; return s;", 10),
    "for with a step": ("float s = 0.0; for (int i = 10; i > 0; i -= 3) s += float(i); return s * one;", 22),
    "while": ("int i = 0; while (i < 4) { i++; } return float(i) * one;", 4),
    "do": ("int i = 9; do { i++; } while (i < 4); return float(i) * one;", 10),
    "nested loops": ("float s = 0.0; for (int i = 0; i < 3; i++) for (int j = 0; j < i; j++) s += one; return s;", 3),
    "break": ("float s = 0.0; for (int i = 0; i < 9; i++) { if (i == 4) break; s += one; } return s;", 4),
    "continue": ("float s = 0.0; for (int i = 0; i < 6; i++) { if (i % 2 == 0) continue; s += float(i) * one; } return s;", 9),
    "break on data": ("float s = 0.0; for (int i = 0; i < 9; i++) { if (s > 3.5 * one) break; s += one; } return s;", 4),
    "continue on data": (
        "float s = 0.; for (int i = 0; i < 4; i++) { if (float(i) == one) continue; s += float(i); } return s;",
        5,
    ),
    "data loop": ("float s = 0.0, x = one; while (x < 100.0) { x *= 2.0; s += 1.0; } return s;", 7),
    "data loop with break": (
        "float x = one; int n = 0; while (true) { x *= 3.0; n++; if (x > 50.0) break; } return float(n);",
        4,
    ),
    "data do": ("float x = one; int n = 0; do { x += 1.5; ++n; } while (x < 5.0); return float(n) * 10.0 + x;", 35.5),
    "data for": ("float s = 0.; for (float t = 0.; t < one; t += 0.25) s += t; return s;", 1.5),
    "endless for": ("int n = 0; for (;;) { if (float(n) > 2.5 * one) break; n += 1; } return float(n);", 3),
    "data loop in a function": (
        "float g(float x) { while (x < 9.0) { if (x > 6.0) return -x; x += 1.0; } return x; } ### return g(one);",
        -7,
    ),
    "data loop with an array": (
        "float a[3]; float x = one; int i = 0; while (x < 4.) { a[i] = x; x += 1.; i++; } return a[0] + a[1]"
        " * 10. + a[2] * 100.;",
        321,
    ),
    "loop changes a global": (
        "float n = 0.0; void up() { n += 1.0; } ### float x = one; while (x < 4.0) { up(); x += 1.0; } return n;",
        3,
    ),
    "nested data loops": (
        "float s = 0.; float x = one; while (x < 3.5) { float y = 0.; while (y < x) { y += 1.; s += 1.; } x += 1.; } return s;",
        6,
    ),
    "switch": (
        "int i = int(one) + 1; switch (i) { case 1: return 10.; case 2: return 20.; default: return 30.; } return 0.;",
        20,
    ),
    "switch falls through": (
        "float s = 0.; switch (int(one)) { case 0: s += 1.; case 1: s += 10.; case 2: s += 100.; break; case"
        " 3: s += 1000.; } return s;",
        110,
    ),
    "switch default": (
        "float s = 0.; switch (int(one) + 6) { case 0: s = 1.; break; default: s = 5.; break; case 2: s = 9.; } return s;",
        5,
    ),
    "switch labels": (
        "float s = 1.; switch (int(one)) { case 5: case 1: case 7: s = 3.; break; default: s = 4.; } return s;",
        3,
    ),
    "switch misses": ("float s = 2.; switch (int(one)) { case 5: s = 3.; } return s;", 2),
    "switch in a loop": (
        "float s = 0.; for (int i = 0; i < 4; i++) { switch (i) { case 1: continue; case 2: break; default:"
        " s += 10.; } s += one; } return s;",
        23,
    ),
    "int division": ("int a = -7; return float(a / 2) * 10. + float(a % 2) * one;", -31),
    "int of float": ("return float(int(-2.7 * one)) * 10. + float(int(2.7 * one));", -18),
    "wraps round": ("int a = 2147483647; a += int(one); return float(a);", -2147483648),
    "unsigned wraps round": ("uint a = 0u; a -= uint(one); return float(a);", 4294967295),
    "unsigned product": ("uint a = 65537u * uint(one); return float(a * a);", 131073),
    "bits": ("int a = 12 * int(one); return float((a & 10) * 10000 + (a | 3) * 100 + (a ^ 5));", 81509),
    "not": ("return float(~(5 * int(one)));", -6),
    "shifts": ("int a = -16 * int(one); return float(a >> 2) + float(1 << (4 * int(one)));", 12),
    "unsigned shift": ("uint a = 0xF0000000u * uint(one); return float(a >> 28u);", 15),
    "hexadecimal": ("return float(0xFF) + float(0x10u) * one;", 271),
    "octal": ("return float(017) * one;", 15),
    "hash": ("uint x = 7u * uint(one); x ^= x << 13; x ^= x >> 17; x ^= x << 5; return float(x);", 1892583.0),
    "bool numbers": ("return float(one > 0.5) + float(int(true)) * 10. + float(bool(2));", 12),
    "matrix by columns": ("mat2 m = mat2(1, 2, 3, 4) * one; return m[0].y * 100. + m[1].x * 10. + m[1][1];", 234),
    "matrix times vector": ("mat2 m = mat2(1, 2, 3, 4); vec2 v = m * vec2(one, 2.0); return v.x * 100. + v.y;", 710),
    "vector times matrix": ("mat2 m = mat2(1, 2, 3, 4); vec2 v = vec2(one, 2.0) * m; return v.x * 100. + v.y;", 511),
    "matrix product": ("mat2 a = mat2(1, 2, 3, 4) * one; mat2 b = a * mat2(0, 1, 1, 0); return b[0].x * 10. + b[1].y;", 32),
    "oblong": ("mat2x3 m = mat2x3(1, 2, 3, 4, 5, 6); vec3 v = m * vec2(one, 1.); return v.x * 100. + v.y * 10. + v.z;", 579),
    "diagonal": ("mat3 m = mat3(2.0 * one); return m[0][0] + m[1][0] * 7. + m[2][2];", 4),
    "matrix of matrix": ("mat3 m = mat3(mat2(1, 2, 3, 4) * one); return m[0][1] * 100. + m[2][2] * 10. + m[2][0];", 210),
    "matrix of columns": (
        "mat2 m = mat2(vec2(one, 2), vec2(3, 4)); m[1] = vec2(8, 9); m[0][1] += 5.; return m[0].y * 10. + m[1].x;",
        78,
    ),
    "transpose": ("mat2x3 m = mat2x3(1, 2, 3, 4, 5, 6) * one; mat3x2 t = transpose(m); return t[0].y * 10. + t[2].x;", 43),
    "determinant 2": ("return determinant(mat2(3, 1, 4, 2) * one);", 2),
    "determinant 3": ("return determinant(mat3(2, 0, 1, 1, 3, 2, 1, 1, 4) * one);", 18),
    "determinant 4": ("return determinant(mat4(1, 0, 2, 0, 0, 3, 0, 1, 1, 0, 1, 0, 0, 2, 0, 1) * one);", -1),
    "inverse": (
        "mat3 m = mat3(2, 0, 1, 1, 3, 2, 1, 1, 4) * one; vec3 v = inverse(m) * (m * vec3(1, 2, 3)); return"
        " v.x + v.y * 10. + v.z * 100.;",
        321,
    ),
    "inverse 4": (
        "mat4 m = mat4(1, 0, 2, 0, 0, 3, 0, 1, 1, 0, 1, 0, 0, 2, 0, 1) * one; mat4 e = inverse(m) * m;"
        " return e[0][0] + e[3][3] + e[1][2];",
        2,
    ),
    "outer product": ("mat3x2 m = outerProduct(vec2(one, 2), vec3(3, 4, 5)); return m[2].y * 10. + m[0].x;", 103),
    "entry by entry": (
        "mat2 m = matrixCompMult(mat2(1, 2, 3, 4), mat2(5, 6, 7, 8) * one); return m[1].x + m[0].y * 100.;",
        1221,
    ),
    "whole numbers mix": ("return (1 + 2.5) * one + float(7 / 2);", 6.5),
    "whole vectors": ("ivec3 a = ivec3(1, 2, 3) * int(one); vec3 b = a * 2.5; return b.z;", 7.5),
    "any and all": ("bvec2 b = lessThan(vec2(one, 3), vec2(2)); return any(b) && !all(b) && not(b).y ? 1. : 0.;", 1),
    "relations": (
        "ivec3 a = ivec3(1, 2, 3) * int(one); bvec3 b = greaterThanEqual(a, ivec3(2)); return float(b.x) *"
        " 100. + float(b.y) * 10. + float(b.z);",
        11,
    ),
    "equal": (
        "bvec2 b = equal(vec2(one, 2), vec2(1)); bvec2 c = notEqual(bvec2(true), b); return float(b.x) * 10. + float(c.y);",
        11,
    ),
    "length of a vector": ("vec3 a = vec3(one); return float(a.length());", 3),
    "directions": ("return L.x + V.z + N.z * one;", 2.56),
    "float forms": ("return 1. + .5 + 1e1 + 2.5e-1 + 1.0f * one;", 12.75),
    "spaced": ("return\n/* a\ncomment */ one // another\n;", 1),
    "unused void": ("void nothing(void) {} ### nothing(); return one;", 1),
    "built-ins with whole numbers": (
        "return clamp(one * 5.0, 0, 3) + max(vec3(-one), 0).x + max(0, one) * 10. + mix(one, 3, 1) * 100. + step(0, one);",
        314,
    ),
    "condition that declares": (
        "int n = 0; while (bool b = n < 3) n++; for (int i = 0; bool c = i < 4; i++) n += c ? 10 : 0; return float(n) * one;",
        43,
    ),
    "condition on data that declares": ("float x = one; while (bool b = x < 3.) x += 1.; return x;", 3),
    "constant by a function": ("float h(float x) { return x * 2.; } const float K = h(3.); ### return K * one;", 6),
    "struct without a name": ("struct { float a; vec2 b; } m; ### m.a = one; m.b = vec2(2); return m.a + m.b.y;", 3),
    "return on some ways": ("float g(float x) { if (x > 0.5) return 1.; } ### return g(L.x) * one;", 1),
    "no return on some ways": ("float g(float x) { if (x > 0.5) return 1.; } ### return g(V.y) * one;", float("nan")),
    "swizzle times matrix": ("vec2 v = vec2(1, 2) * one; v.yx *= mat2(0, 1, 1, 0); return v.x * 10. + v.y;", 21),
    "ternaries change things": (
        "int i = 0; float a = L.x * one > 0.5 ? float(i++) : float(i += 10); float b = L.x < 0.5 * one ? float(++i) :"
        " float(i -= 5); return a * 100. + b * 10. + float(i);",
        -44,
    ),
    "const in": ("float g(const in float x) { return x; } ### return g(one);", 1),
    "lowp": ("highp float a = one; mediump vec2 b = vec2(a); return b.x;", 1),
}


def shader(name: str) -> str:
    before, _, inside = CASES[name][0].rpartition("###")
    return f"uniform float one;\n{before}\nfloat f(vec3 L, vec3 V, vec3 N)\n{{\n{inside}\n}}\n"


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    return traced(tmp_path_factory.mktemp("traced"), {name: shader(name) for name in CASES})


@pytest.mark.parametrize("name", CASES)
def test_a_construct_means_what_the_specification_says(tmp_path: Path, values: dict[str, np.ndarray], name: str) -> None:
    expected = pytest.approx(CASES[name][1], rel=1e-13, abs=1e-13, nan_ok=True)
    assert folded(tmp_path, shader(name)) == expected
    assert values[name] == expected


def test_hash_by_hand() -> None:
    x = np.uint32(7)
    for left, shift in ((True, 13), (False, 17), (True, 5)):
        x ^= (x << np.uint32(shift)) if left else (x >> np.uint32(shift))
    assert float(x) == CASES["hash"][1]
