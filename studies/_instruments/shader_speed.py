"""Evaluations a second of CPU time: a shader as `check` evaluates it, and as a C++ compiler compiles it, in double."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import brdfcheck
from brdfcheck.brdf.callables import BLOCK, Evaluator

ROWS = 64
_COMPILER = shutil.which("c++") or shutil.which("g++")
_FLAGS = ("-std=c++17", "-O3", "-march=native")
# As much of GLSL as the files need that are compiled here.
_PRELUDE = r"""
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <vector>
using std::pow; using std::log; using std::exp; using std::sqrt;
struct vec3 {
    union { double x, r; }; union { double y, g; }; union { double z, b; };
    vec3(double v = 0) : x(v), y(v), z(v) {}
    vec3(double a, double b, double c) : x(a), y(b), z(c) {}
};
#define BINARY(op) \
    inline vec3 operator op(vec3 a, vec3 b) \
    { return vec3(a.x op b.x, a.y op b.y, a.z op b.z); } \
    inline vec3 operator op(vec3 a, double b) { return a op vec3(b); } \
    inline vec3 operator op(double a, vec3 b) { return vec3(a) op b; }
BINARY(+) BINARY(-) BINARY(*) BINARY(/)
inline double min(double a, double b) { return b < a ? b : a; }
inline double max(double a, double b) { return a < b ? b : a; }
inline double clamp(double v, double low, double high) { return min(max(v, low), high); }
inline double mix(double a, double b, double t) { return a * (1 - t) + b * t; }
inline vec3 mix(vec3 a, vec3 b, double t) { return a * (1 - t) + b * t; }
inline double dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline vec3 normalize(vec3 a) { return a / sqrt(dot(a, a)); }
"""
_MAIN = r"""
int main(int, char** words) {
    long count = atol(words[1]), rounds = atol(words[2]);
    std::vector<double> given(6 * count), found(3 * count);
    if (fread(given.data(), 48, count, stdin) != size_t(count)) return 1;
    double fastest = 1e9;
    for (long round = 0; round < rounds; ++round) {
        std::clock_t began = std::clock();
        for (long i = 0; i < count; ++i) {
            const double* d = &given[6 * i];
            vec3 f = BRDF(vec3(d[0], d[1], d[2]), vec3(d[3], d[4], d[5]), vec3(0, 0, 1), vec3(1, 0, 0), vec3(0, 1, 0));
            found[3 * i] = f.x, found[3 * i + 1] = f.y, found[3 * i + 2] = f.z;
        }
        asm volatile("" : : "r"(found.data()) : "memory");  // each round is needed
        fastest = std::min(fastest, double(std::clock() - began) / CLOCKS_PER_SEC);
    }
    fwrite(&fastest, 8, 1, stdout);
    fwrite(found.data(), 24, count, stdout);
}
"""


def measured(path: Path, rounds: int) -> dict[str, Any]:
    """Evaluations a second of CPU time of ours and of the compiler's program; how far they are apart.

    `rounds`: how many times ROWS x BLOCK pairs of directions are evaluated; the fastest counts. Parameters stand in the middle
    of their ranges, colours are white. Without a compiler its numbers are None.
    """
    family = brdfcheck.load(str(path))
    values = {name: 0.5 * (low + high) for name, (low, high) in family.ranges.items()}
    directions = np.random.default_rng(7).normal(size=(2, 3, ROWS, BLOCK))
    directions[:, 2] = np.abs(directions[:, 2])
    wi, wo = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    evaluator = Evaluator(family.build, values)
    space = evaluator.space(ROWS)
    space[:, :ROWS] = wo
    parameters = np.tile(np.array(list(values.values())), (ROWS, 1))
    ours = evaluator.rows(parameters, wi, space)
    fastest = np.inf
    for _ in range(rounds):
        began = time.process_time()
        evaluator.rows(parameters, wi, space)
        fastest = min(fastest, time.process_time() - began)
    row: dict[str, Any] = {"name": path.name, "per_second": ROWS * BLOCK / fastest}
    row |= {"compiler": None, "compiler_per_second": None, "apart": None}
    if _COMPILER is None:
        return row
    pairs = np.concatenate([wi, wo]).reshape(6, -1).T
    seconds, theirs = _compiled(path.read_text(encoding="utf-8"), values, np.ascontiguousarray(pairs), rounds)
    apart = np.abs(ours.reshape(-1, 3) - theirs) / np.maximum(np.abs(theirs), 1e-12)
    told = {"compiler": " ".join(("c++", *_FLAGS)), "compiler_per_second": len(pairs) / seconds}
    return row | told | {"apart": float(np.max(apart))}


def _compiled(text: str, values: dict[str, float], pairs: np.ndarray, rounds: int) -> tuple[float, np.ndarray]:
    """Seconds and values of the file's BRDF as a program of the compiler: (pairs, 3)."""
    declared = re.search(r"::begin parameters\n(.*?)::end parameters", text, re.S)
    shader = re.search(r"::begin shader\n(.*?)::end shader", text, re.S)
    assert declared
    assert shader
    assert _COMPILER
    kinds = dict(line.split()[1::-1] for line in declared[1].splitlines() if line.strip())
    lines = [f"static {'vec3' if kind == 'color' else 'double'} {name};" for name, kind in kinds.items()]
    # They are read at run time: what is known when it compiles would be folded.
    volatile = [f"volatile double given_{name} = {values.get(name, 1.0)!r}; " for name in kinds]
    setters = " ".join(f"{name} = given_{name};" for name in kinds)
    body = re.sub(r"\bfloat\b", "double", shader[1])
    main = _MAIN.replace("int main(int, char** words) {", f"int main(int, char** words) {{ {setters}")
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder, "shader.cpp"), Path(folder, "shader")
        source.write_text("\n".join([_PRELUDE, *lines, *volatile, body, main]), encoding="utf-8")
        subprocess.run([_COMPILER, *_FLAGS, str(source), "-o", str(program)], check=True, capture_output=True)
        command = [str(program), str(len(pairs)), str(rounds)]
        answer = subprocess.run(command, input=pairs.tobytes(), check=True, capture_output=True).stdout
    numbers = np.frombuffer(answer)
    return float(numbers[0]), numbers[1:].reshape(-1, 3)
