"""What leaves for other programs is what it says: compiled, run and read back, and held against the table."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shutil
import stat
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selection import few
from shared import compiled

from brdfcheck import BinomialPower, Factor, Family, Normalized
from brdfcheck.brdf.factors import (
    AbstractFactor,
    BlinnPhongExact,
    Constant,
    PhongExact,
    Proportional,
    RationalFactor,
    TruncatedPowerExact,
)
from brdfcheck.fits.compact import CompactFits
from brdfcheck.fits.grids import AlbedoGrid, tabulate
from brdfcheck.fits.surface import AlbedoFit, fit_albedo
from brdfcheck.output.source import identifier, source_text
from brdfcheck.output.table_files import KINDS, table_metadata, write_table
from brdfcheck.output.text import describe

C_COMPILER = shutil.which("cc") or shutil.which("gcc")
CPP_COMPILER = shutil.which("c++") or shutil.which("g++")
VALIDATOR = shutil.which("glslangValidator")
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
# Smooth, kinked, a polynomial, with a layer, a roughness. Small ones: what is tested is the text, not the fit.
FITS = {
    "phong": {"n": (0.01, 1000), "degree": (3, 2)},
    "blinn-phong": {"n": (1, 1000), "degree": (2, 1)},
    "lyon-1-mirror": {"degree": (3, 2)},
    "kuijk-blake-half": {"degree": (4, 3)},
    "binomial-power-mirror": {"n": (1, 200), "degree": (4, 0)},
    "phong-classical": {"n": (1, 50), "degree": (3, 2)},
    "ggx": {"degree": (4, 2)},
    "lambert": {"degree": (1, 0)},
}

FAST = ("kuijk-blake-half", "ggx")


class Lazy(dict):
    """Fits and tables by name, made when they are first asked for: a worker makes only what its tests need."""

    def __missing__(self, name: str) -> tuple[AlbedoFit, AlbedoGrid]:
        ranges = {key: value for key, value in FITS[name].items() if key != "degree"}
        self[name] = fit_albedo(name, **FITS[name]), tabulate(name, count=(24, 16), **ranges)
        return self[name]


@pytest.fixture(scope="module")
def exported() -> Lazy:
    return Lazy()


def text_of(kind: str, fit: AlbedoFit, factor: AbstractFactor | None = None, **options: Any) -> str:
    """The text of a fit with a factor, by default its own."""
    return source_text(kind, CompactFits(fit), factor=factor or fit.factor, **options)


def evaluated(compiler: list[str], source: str, folder: Path, points: np.ndarray) -> np.ndarray:
    """What a program prints that reads pairs (parameter, cosine) and calls `brdf_factor` and `brdf_albedo`."""
    return compiled([*compiler, *STRICT], source, folder / "program.c", points)


def main_program(snippet: str, name: str) -> str:
    factor = f"(double){name}_factor(p)" if f"{name}_factor(" in re.sub("//.*", "", snippet) else "0.0"
    return (
        "#include <stdio.h>\n" + snippet + "int main(void) {\n    double p, mu;\n"
        '    while (scanf("%lf %lf", &p, &mu) == 2)\n'
        f'        printf("%.17g %.17g\\n", {factor}, (double){name}_albedo(p, mu));\n    return 0;\n}}\n'
    )


def nodes(table: AlbedoGrid) -> np.ndarray:
    return np.array([(p, mu) for p in table.nodes for mu in table.cos_theta])


def assert_is_fit(
    found: np.ndarray, fit: AlbedoFit, table: AlbedoGrid, points: np.ndarray, *, rounding: float, of_factor: float
) -> None:
    """What a program printed at `points`, those of the table first: the factor and the albedo."""
    assert np.max(np.abs(found[:, 1] - fit(*points.T))) <= rounding
    error = np.abs(found[: table.values.size, 1].reshape(table.values.shape) - table.values)
    assert np.max(error) <= fit.max_error * 1.02 + rounding
    if fit.factor is not None:
        expected = np.asarray(fit.factor(np.clip(points[:, 0], *fit.parameter_range)))
        assert found[:, 0] == pytest.approx(expected, rel=of_factor)


@pytest.mark.skipif(C_COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("name", few(FITS, ("ggx",)))
def test_the_compiled_c_is_the_fit_and_reproduces_the_table(exported, name, tmp_path):
    fit, table = exported[name]
    points = np.concatenate(
        [nodes(table), [(1e9, 2.0), (-5.0, -1.0), *((p, mu) for p in fit.parameter_range for mu in (0, 1))]]
    )
    found = evaluated([str(C_COMPILER), "-std=c99"], main_program(text_of("c", fit, name="brdf"), "brdf"), tmp_path, points)
    assert_is_fit(found, fit, table, points, rounding=1e-12, of_factor=1e-14)


@pytest.mark.slow
@pytest.mark.skipif(CPP_COMPILER is None, reason="no C++ compiler")
def test_the_c_is_also_c_plus_plus(exported, tmp_path):
    for name in ("phong", "ggx"):
        fit, _ = exported[name]
        source = main_program(text_of("c", fit, name="brdf"), "brdf")
        compiled([str(CPP_COMPILER), "-std=c++11", *STRICT], source, tmp_path / "program.cpp", np.empty((0, 2)))


@pytest.mark.skipif(C_COMPILER is None, reason="no C compiler")
def test_a_range_of_one_exponent_leaves_no_unused_variable(tmp_path):
    """Nothing depends on the exponent then; with a layer, the cosine's variable still does."""
    for name, degree in (("phong", (3, 2)), ("blinn-phong", (2, 0)), ("lyon-1-mirror", (0, 0))):
        fit = fit_albedo(name, n=(5, 5), degree=degree)
        points = np.array([[5.0, mu] for mu in np.linspace(0, 1, 9)])
        found = evaluated([str(C_COMPILER), "-std=c99"], main_program(text_of("c", fit, name="brdf"), "brdf"), tmp_path, points)
        assert np.max(np.abs(found[:, 1] - fit(*points.T))) <= 1e-12


def test_a_constant_that_a_float_cannot_hold_is_refused(exported):
    fit, _ = exported["phong"]
    for factor in (Factor(2.0, 2e70), Factor(-2e40, -3.0), Constant(1e-50), RationalFactor([1.0, 1e60], [1.0])):
        with pytest.raises(ValueError, match="cannot be held by a float"):
            text_of("glsl", fit, factor)
        assert "_factor(double n)" in text_of("c", fit, factor)
    assert "/2e+30" in text_of("glsl", fit, Factor(0.0, 2e30))


# What C lacks of GLSL; with -fsingle-precision-constant its literals are float, as they are there.
GLSL_IN_C = """#include <math.h>
static inline float clamp(float x, float low, float high) { return fminf(fmaxf(x, low), high); }
#define sqrt sqrtf
#define log logf
#define exp2 exp2f
"""


@pytest.mark.skipif(C_COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("name", few(FITS, FAST))
def test_the_glsl_in_single_precision_reproduces_the_table(exported, name, tmp_path):
    fit, table = exported[name]
    text = re.sub(r"^float ", "static float ", text_of("glsl", fit, name="brdf"), flags=re.MULTILINE)
    source = main_program(GLSL_IN_C + text, "brdf")
    compiler = [str(C_COMPILER), "-std=c99", "-fsingle-precision-constant", "-ffp-contract=off"]
    points = np.concatenate([nodes(table), [(1e6, 2.0), (-5.0, -1.0)]])
    found = evaluated(compiler, source, tmp_path, points)
    assert_is_fit(found, fit, table, points, rounding=1e-5 * max(1.0, float(np.max(table.values))), of_factor=1e-6)


@pytest.mark.skipif(VALIDATOR is None, reason="glslangValidator is not installed")
@pytest.mark.parametrize("version", ["#version 330\n", "#version 450\n", "#version 100\nprecision highp float;\n"])
def test_the_glsl_is_valid(exported, version, tmp_path):
    calls, texts = [], []
    for name in ("phong", "blinn-phong", "kuijk-blake-half", "phong-classical", "ggx"):
        fit = exported[name][0]
        texts.append(text_of("glsl", fit))
        calls += [f"{identifier(name)}_albedo(20.0, 0.5)", *([f"{identifier(name)}_factor(20.0)"] if fit.factor else [])]
    old = "100" in version
    output = "" if old else "layout(location = 0) out vec4 colour;\n"
    target = "gl_FragColor" if old else "colour"
    shader = f"{version}{output}{''.join(texts)}void main() {{ {target} = vec4({' + '.join(calls)}); }}\n"
    file = tmp_path / "shader.frag"
    file.write_text(shader)
    checked = subprocess.run([str(VALIDATOR), str(file)], capture_output=True, text=True, timeout=60, check=False)
    assert checked.returncode == 0, checked.stdout
    # It notices what is wrong: a test that cannot fail proves nothing.
    file.write_text(shader.replace("return p / q;", "return p / ;", 1))
    assert subprocess.run([str(VALIDATOR), str(file)], capture_output=True, timeout=60, check=False).returncode != 0


def test_the_header_says_where_it_comes_from(exported):
    fit, _ = exported["lyon-1-mirror"]
    text = text_of("c", fit, command="brdfcheck fit lyon-1-mirror --export c out.h")
    comment = " ".join(line.removeprefix("//").strip() for line in text.splitlines() if line.startswith("//"))
    for words in (
        "lyon-1-mirror", "max(0, 1 - n |R-V|^2/4)^2", "mirror form", "n in [1, 1000]", "cos_theta in [0, 1]", "Within [0, 1]",
        "wi fixed", "with its factor (n + 0.8831)/4.537", f"{fit.max_error:.3g}", "brdfcheck 0.",
        "brdfcheck fit lyon-1-mirror --export c out.h", "no pole", f"{fit.coefficients} coefficients",
    ):  # fmt: skip
        assert words in comment
    assert text == text_of("c", fit, command="brdfcheck fit lyon-1-mirror --export c out.h")
    assert "no factor" in text_of("c", exported["ggx"][0]).replace("\n//", "")
    assert "_factor(" not in text_of("c", exported["ggx"][0])
    assert all(len(line) <= 112 for line in text.splitlines() if line.startswith("//"))


@pytest.mark.skipif(C_COMPILER is None, reason="no C compiler")
def test_a_hostile_name_stays_in_its_comment(exported, tmp_path):
    name = "*/ int main??/ \\\nif(1) ünï__code 1\\"
    fit = dataclasses.replace(exported["ggx"][0], name=name, formula="*/ ??/\\", parameter="double")
    text = text_of("c", fit, command="x\\\n#error y")
    prefix = identifier(name)
    found = evaluated([str(C_COMPILER), "-std=c99"], main_program(text, prefix), tmp_path, np.array([[0.5, 0.5]]))
    assert found[0, 1] == pytest.approx(float(fit(0.5, 0.5)), abs=1e-14)


def test_identifiers():
    assert identifier("binomial-power-half") == "binomial_power_half"
    assert identifier("9 lives") == "brdf_9_lives"
    assert identifier("gl_x") == "brdf_gl_x"
    assert identifier("a__b--c_") == "a_b_c"
    assert identifier("---") == "brdf"


@pytest.mark.skipif(C_COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize(
    "factor",
    [
        Factor(7.5, 25),
        Factor(-0.5, 25),
        Factor(-1e3, -25),
        Constant(0.25),
        Proportional(3),
        RationalFactor([1.0, 2, 3], [4.0, 1]),
        PhongExact(),
        BlinnPhongExact(),
    ],
    ids=lambda factor: type(factor).__name__,
)
def test_factors(exported, factor, tmp_path):
    fit = exported["phong"][0]
    n = np.array([0.5, 1, 20, 900.0])
    source = main_program(text_of("c", fit, factor, name="brdf"), "brdf")
    found = evaluated([str(C_COMPILER), "-std=c99"], source, tmp_path, np.stack([n, 0 * n], axis=1))
    assert found[:, 0] == pytest.approx(np.asarray(factor(n)), rel=1e-14)
    assert "n" in describe(factor) or isinstance(factor, Constant)


def test_a_factor_without_a_formula(exported):
    with pytest.raises(ValueError, match="no formula for a factor of type TruncatedPowerExact"):
        text_of("c", exported["phong"][0], TruncatedPowerExact(2))


# --- tables ---


@pytest.fixture(scope="module")
def table() -> AlbedoGrid:
    published = Family("published", lambda n: Normalized(BinomialPower(n), Factor(6, 15.0)), {"n": (1, 40)})
    return tabulate(published, count=(6, 4))


def test_csv(table, tmp_path):
    file = tmp_path / "table.csv"
    write_table(file, table, command="the command")
    data = np.loadtxt(file, delimiter=",")
    assert np.array_equal(data[:, 0], table.nodes)
    assert np.array_equal(data[:, 1:], table.values)
    comments = [line for line in file.read_text().splitlines() if line.startswith("#")]
    assert comments[-1].startswith("# n,0.125,")
    assert np.array_equal([float(word) for word in comments[-1].split(",")[1:]], table.cos_theta)
    assert "# clamp: none: values above 1 are values above 1" in comments
    assert "# factor: included: (n + 6)/15" in comments
    assert "# command: the command" in comments


def test_npy(table, tmp_path):
    file = tmp_path / "table.npy"
    write_table(file, table)
    data = np.load(file, allow_pickle=False)
    assert data.dtype == np.float64
    assert np.array_equal(data, table.values)
    metadata = json.loads((tmp_path / "table.npy.json").read_text())
    assert metadata == json.loads(json.dumps(table_metadata(table)))
    assert metadata["nodes_0"] == table.nodes.tolist()
    assert metadata["nodes_1"] == table.cos_theta.tolist()
    assert metadata["axis_0"] == "n"
    assert 0 < metadata["max_error"] < 1e-10
    assert metadata["largest_value"] > 1  # the published factor: never clamped


def test_exr(table, tmp_path):
    import OpenEXR

    file = tmp_path / "table.exr"
    write_table(file, table)
    with OpenEXR.File(str(file)) as image:
        pixels = image.channels()["Y"].pixels
        header = dict(image.header())  # emptied when the file is closed
    assert pixels.dtype == np.float32
    assert np.array_equal(pixels, table.values.astype(np.float32))
    assert np.max(pixels) > 1
    metadata = table_metadata(table)
    assert json.loads(header["brdfcheck.nodes_1"]) == metadata["nodes_1"]
    assert header["brdfcheck.clamp"] == metadata["clamp"]
    assert json.loads(header["brdfcheck.versions"])["brdfcheck"] == metadata["versions"]["brdfcheck"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_bytes_each_time_and_nothing_besides(table, kind, tmp_path):
    first, second = tmp_path / "a" / "table", tmp_path / "b" / "table"
    for file in (first, second):
        file.parent.mkdir()
        write_table(file, table, kind)
    assert first.read_bytes() == second.read_bytes()
    beside = {"table.json"} if kind == "npy" else set()
    assert set(os.listdir(tmp_path / "a")) == {"table"} | beside
    assert stat.S_IMODE(os.stat(first).st_mode) & 0o111 == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_command_may_hold_bytes_of_no_encoding(table, kind, tmp_path):
    write_table(tmp_path / "table", table, kind, command="brdfcheck fit mine\udcff.py:f")
    assert (tmp_path / "table").stat().st_size > 0


def test_bad_output(table, tmp_path):
    with pytest.raises(ValueError, match="csv, npy, exr; got 'png'"):
        write_table(tmp_path / "table.png", table)
    with pytest.raises(ValueError, match="got 'xyz'"):
        write_table(tmp_path / "table.csv", table, "xyz")
    for kind in KINDS:
        with pytest.raises(OSError, match="missing"):
            write_table(tmp_path / "missing" / "table", table, kind)
