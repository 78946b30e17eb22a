"""``brdfcheck fit``: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import Factor, Normalized
from brdfcheck.cli import ExitCode
from brdfcheck.verdict import Verdict, check

Run = Callable[..., tuple[int, str, str]]

MINE = """
    import numpy as np
    from brdfcheck import Phong

    def glossy(n, ks):
        return lambda wi, wo: ks * Phong(n)(wi, wo)

    def plain(n):
        return Phong(n)

    def raises(n):
        raise RuntimeError("boom")

    def negative(n):
        return lambda wi, wo: -1.0 + 0 * wi[..., 2]
"""


@pytest.fixture
def mine(here: Path) -> str:
    path = here / "mine.py"
    path.write_text(textwrap.dedent(MINE))
    return str(path)


def test_plain_text(run: Run) -> None:
    code, out, err = run("fit", "binomial-power-half")
    assert (code, err) == (ExitCode.PASSED, "")
    assert "factor (n + 7.24267604)/26.17000503  (minimax over n=1:1000)" in out
    assert "smallest  albedo 0.9063806983  at n=1, normal incidence" in out
    assert "verdict   CONSERVES over all angles" in out


@pytest.mark.parametrize("name", ["binomial-power-half", "schlick-mirror", "lyon-1-mirror", "phong"])
def test_the_constants_to_copy_conserve(run: Run, name: str) -> None:
    found = re.search(r"A = (-?[\d.]+), B = ([\d.]+)", run("fit", name)[1])
    assert found
    a, b = float(found[1]), float(found[2])
    brdf = catalog.entry(name).family.build(n=1.0)

    def build(n):
        lobe = catalog.entry(name).family.build(n=n)
        return Normalized(lobe.lobe, Factor(a, b))

    assert isinstance(brdf, Normalized)
    report = check(build, n=(1, 1000))
    assert report.verdict is Verdict.CONSERVES
    assert report.albedo > 1 - 1e-4


def test_a_falling_factor_to_copy_conserves(run: Run) -> None:
    out = run("fit", "binomial-power-unclamped", "--n", "100:130")[1]
    assert "factor (133.5" in out
    assert re.search(r"smallest  albedo 6\.18\d+e-13 ", out)
    found = re.search(r"A = (-[\d.]+), B = (-[\d.]+)", out)
    assert found
    factor = Factor(float(found[1]), float(found[2]))
    report = check(lambda n: Normalized(catalog.entry("binomial-power-unclamped").family.build(n=n).lobe, factor), n=(100, 130))
    assert report.verdict is Verdict.CONSERVES
    assert 1 - 1e-3 < report.albedo <= 1


def test_wide_and_narrow_ranges(run: Run) -> None:
    code, out, _ = run("fit", "phong", "--n", "1:1e10", "--ladder")
    assert code == ExitCode.PASSED
    assert "factor (n + 2)/6.283185307  (minimax over n=1:1e10)" in out
    assert re.search(r"^ +\(n\+A\)/B .* none  +-  CONSERVES", out, re.MULTILINE)
    for n in ("100000:100000.000001", "1000:1000.0000001"):
        code, out, err = run("fit", "phong", "--n", n)
        assert (code, err) == (ExitCode.PASSED, "")
        assert "smallest  albedo 1.0000000000" in out


def test_a_factor_beyond_float_is_refused_by_glsl(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "factor.glsl"
    code, _, err = run("fit", "binomial-power-unclamped", "--n", "1:100000", "--export", "glsl", str(path))
    assert (code, err.count("\n")) == (ExitCode.USAGE_ERROR, 1)
    assert "cannot be held by a float" in err
    assert not path.exists()


def test_json_holds_the_fit_and_its_verdict(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    code, _, _ = run("fit", "blinn-phong", "--n", "1:100", "--objective", "reciprocal", "--ladder", "--json", str(path))
    record = json.loads(path.read_text())
    assert code == ExitCode.PASSED
    assert record["command"] == "fit"
    assert record["settings"]["objective"] == "reciprocal"
    (result,) = record["results"]
    assert result["report"]["verdict"] == "CONSERVES"
    assert result["factor"]["form"] == "Factor"
    assert result["fitted"]["B"] < result["factor"]["B"]
    assert [rung["form"] for rung in result["ladder"]][-1] == "closed form"
    assert record["versions"]["lineax"]


def test_json_alone_on_stdout(run: Run) -> None:
    code, out, err = run("fit", "phong", "--n", "1:10", "--json", "-")
    assert code == ExitCode.PASSED
    assert json.loads(out)["results"][0]["factor"]["A"] == pytest.approx(2)
    assert "CONSERVES" in err


@pytest.mark.parametrize("kind", ["glsl", "c", "csv", "npy", "exr"])
def test_exports(run: Run, tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"table.{kind}"
    code, out, _ = run("fit", "lyon-2-half", "--n", "1:200", "--export", kind, str(path))
    assert code == ExitCode.PASSED
    assert f"exported  {path}" in out
    if kind in ("glsl", "c"):
        text = path.read_text()
        assert "brdfcheck fit lyon-2-half --n 1:200 --objective minimax" in text
        assert "lyon_2_half_factor" in text
        assert "lyon_2_half_albedo" in text
    if kind == "csv":
        table = np.loadtxt(path, delimiter=",")
        assert table.shape == (64, 65)
        assert np.all(table[:, 1:] <= 1)
    if kind == "npy":
        metadata = json.loads(Path(f"{path}.json").read_text())
        assert metadata["command"] == "brdfcheck fit lyon-2-half --n 1:200 --objective minimax"
        assert np.load(path).shape == (64, 64)


def test_source_text_on_stdout(run: Run) -> None:
    code, out, err = run("fit", "phong", "--n", "1:100", "--export", "glsl", "-")
    assert code == ExitCode.PASSED
    assert out.startswith("//")
    assert "exported  stdout" in err


def test_your_own_lobe(run: Run, mine: str) -> None:
    code, out, _ = run("fit", f"{mine}:plain", "--n", "1:50")
    assert code == ExitCode.PASSED
    assert "factor (n + 2)/6.283185307" in out
    code, out, _ = run("fit", f"{mine}:glossy", "--n", "1:3", "--over", "ks=0.5")
    assert code == ExitCode.PASSED
    assert "factor (n + 2)/3.141592654" in out
    code, out, _ = run("fit", f"{mine}:negative", "--n", "1:3")
    assert code == ExitCode.USAGE_ERROR


def test_least_squares_says_that_b_was_enlarged(run: Run) -> None:
    _, out, _ = run("fit", "binomial-power-raw", "--objective", "least-squares", "--sampling", "integers")
    assert "as fitted (n + 5.992119078)/23.78081092  reaches 1.0336561323: B was enlarged until it conserves" in out
    assert "factor (n + 5.992119078)/24.58118104" in out


def test_waste_is_remarked(run: Run) -> None:
    assert "grows like 6.281 ln n" in run("fit", "schlick-mirror", "--n", "1:100000")[1]


def test_a_family_with_free_parameters_is_refused(run: Run, mine: str) -> None:
    code, _, err = run("fit", f"{mine}:glossy", "--over", "ks=0:1")
    assert code == ExitCode.USAGE_ERROR
    assert "hold ks at one value" in err
    code, _, err = run("fit", f"{mine}:glossy")
    assert code == ExitCode.USAGE_ERROR
    assert "ks must be given" in err
    code, _, err = run("fit", f"{mine}:raises")
    assert code == ExitCode.USAGE_ERROR
    assert "boom" in err


def test_the_lobe_is_the_catalogues(run: Run) -> None:
    """The factor that an entry carries is taken off: three entries of one lobe give one fit."""
    lines = {run("fit", name)[1].splitlines()[0].split("  ")[1] for name in ("binomial-power-half", "binomial-power-raw")}
    assert len(lines) == 1
