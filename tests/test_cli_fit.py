"""``brdfcheck fit``: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from selection import few
from shared import Run

from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import Factor, Normalized
from brdfcheck.proof import certify
from brdfcheck.verdict import Verdict, check

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

    def grey(wi, wo):
        return 0.1 + 0 * wi[..., 2]
"""


def test_plain_text(run: Run) -> None:
    out = run.silent("fit", "binomial-power-half")
    assert "factor (n + 7.24267604)/26.17000503  (minimax over n=1:1000)" in out
    assert "smallest  albedo 0.9063806983  at n=1, normal incidence" in out
    assert "verdict   CONSERVES over all angles" in out


def test_what_has_no_exponent_gets_a_constant(run: Run, mine: str) -> None:
    out = run.silent("fit", f"{mine}:grey")
    assert re.search(r"grey  constant 3\.1830988\d+  \(minimax\)\n  to copy   the constant 3\.183  ", out)
    assert "n=1" not in out


@pytest.mark.parametrize("name", ["binomial-power-half", "schlick-mirror", "kuijk-blake-mirror"])
def test_a_factor_near_the_optimum_is_proved(run: Run, name: str) -> None:
    """The optimum touches 1: which side its digits are on is chance. The factor printed as proved has a certificate."""
    out = run("fit", name)[1]
    best = re.search(r"factor \(n \+ ([\d.]+)\)/([\d.]+)", out)
    safe = re.search(r"  proved    \(n \+ ([\d.]+)\)/([\d.]+)  has E <= 1 at every angle and n of the range", out)
    a, b = float(safe[1]), float(safe[2])
    assert np.allclose([a, b], [float(best[1]), float(best[2])], rtol=2e-9)
    lobe = type(catalog.entry(name).family.build(n=1.0).core)
    assert certify(lambda n: Normalized(lobe(n), Factor(a, b)), n=(1, 1000))


def test_no_proof_is_claimed_where_there_is_none(run: Run) -> None:
    assert "proved" not in run("fit", "binomial-power-unclamped", "--over", "n=1:20")[1]


@pytest.mark.parametrize("name", few(["binomial-power-half", "schlick-mirror", "lyon-1-mirror", "phong"], ("schlick-mirror",)))
def test_the_constants_to_copy_conserve(run: Run, name: str) -> None:
    found = re.search(r"A = (-?[\d.]+), B = ([\d.]+)", run("fit", name)[1])
    a, b = float(found[1]), float(found[2])
    brdf = catalog.entry(name).family.build(n=1.0)

    def build(n):
        lobe = catalog.entry(name).family.build(n=n)
        return Normalized(lobe.lobe, Factor(a, b))

    assert isinstance(brdf, Normalized)
    report = check(build, n=(1, 1000))
    assert report.verdict is Verdict.CONSERVES
    assert report.albedo > 1 - 1e-4


@pytest.mark.slow
def test_json_holds_the_fit_and_its_verdict(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    run.passed("fit", "blinn-phong", "--n", "1:100", "--objective", "reciprocal", "--ladder", "--json", str(path))
    record = json.loads(path.read_text())
    assert record["command"] == "fit"
    assert record["settings"]["objective"] == "reciprocal"
    (result,) = record["results"]
    assert result["report"]["verdict"] == "CONSERVES"
    assert result["factor"]["form"] == "Factor"
    assert result["fitted"]["B"] < result["factor"]["B"]
    assert [rung["form"] for rung in result["ladder"]][-1] == "closed form"
    assert record["versions"]["optimistix"]


@pytest.mark.parametrize("kind", few(["glsl", "c", "csv", "npy", "exr"], ("npy",)))
def test_exports(run: Run, tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"table.{kind}"
    given = f"brdfcheck fit lyon-2-half --n 1:200 --export {kind} {path}"
    assert f"exported  {path}" in run.passed(*given.split()[1:])
    if kind in ("glsl", "c"):
        text = path.read_text()
        assert given in " ".join(text.replace("//", " ").split())
        assert "lyon_2_half_factor" in text
        assert "lyon_2_half_albedo" in text
    if kind == "csv":
        table = np.loadtxt(path, delimiter=",")
        assert table.shape == (64, 65)
        assert np.all(table[:, 1:] <= 1)
    if kind == "npy":
        metadata = json.loads(Path(f"{path}.json").read_text())
        assert metadata["command"] == given
        assert np.load(path).shape == (64, 64)


def test_your_own_lobe(run: Run, mine: str) -> None:
    assert "factor (n + 2)/6.283185307" in run.passed("fit", f"{mine}:plain", "--n", "1:50")
    run.refused("fit", f"{mine}:negative", "--n", "1:3")


def test_least_squares_says_that_b_was_enlarged(run: Run) -> None:
    _, out, _ = run("fit", "binomial-power-raw", "--objective", "least-squares", "--sampling", "integers")
    assert "as fitted (n + 5.992119078)/23.78081092  reaches 1.0336561323: B was enlarged until it conserves" in out
    assert "factor (n + 5.992119078)/24.58118104" in out


def test_a_family_with_free_parameters_is_refused(run: Run, mine: str) -> None:
    assert "hold ks at one value" in run.refused("fit", f"{mine}:glossy", "--over", "ks=0:1")
    assert "ks must be given" in run.refused("fit", f"{mine}:glossy")
    assert "boom" in run.refused("fit", f"{mine}:raises")
