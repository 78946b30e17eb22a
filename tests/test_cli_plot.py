"""``brdfcheck plot`` and ``brdfcheck study``: what they say, what they write, how they end."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
from pathlib import Path

import pytest
from selection import few
from shared import Run, process, python, wait_for

from brdfcheck import cli
from brdfcheck.cli import ExitCode

SMALL = ("--samples", "5")

MINE = """
    import jax.numpy as jnp

    print("printed on import")

    def not_a_number(wi, wo):
        return jnp.nan * wi[..., 2]

    def raises(wi, wo):
        raise RuntimeError("boom")
"""


@pytest.fixture(autouse=True)
def _no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


# --- what is written ---


def test_the_default_is_an_svg_of_the_kinds_name(run: Run, here: Path) -> None:
    line, wrote = run.silent("plot", "albedo-vs-n", "binomial-power-published", *SMALL).splitlines()
    assert line == ("binomial-power-published  exceeds 1 for n=14.303..23.0561  largest 1.001600522 at n=17.8512 angle=0 deg")
    assert wrote == "wrote albedo-vs-n.svg"
    text = (here / "albedo-vs-n.svg").read_text()
    assert "14.303 … 23.056" in text
    assert os.listdir(here) == ["albedo-vs-n.svg"]


@pytest.mark.parametrize(("suffix", "head"), [(".pdf", b"%PDF"), (".PNG", b"\x89PNG")])
def test_the_suffix_chooses_the_format(run: Run, here: Path, suffix: str, head: bytes) -> None:
    words = ("plot", "albedo-vs-angle", "phong", "--n", "1,10", *SMALL, "-o", f"x{suffix}")
    run.passed(*words)
    first = (here / f"x{suffix}").read_bytes()
    assert first.startswith(head)
    run(*words)
    assert (here / f"x{suffix}").read_bytes() == first


@pytest.mark.parametrize("kind", few(["albedo-vs-n", "albedo-vs-angle", "heatmap", "factor"], ("factor",)))
def test_every_kind_from_names_and_again_from_its_record(run: Run, here: Path, kind: str) -> None:
    words = ("plot", kind, "blinn-phong-8", "binomial-power-half", "--n", "1:100", *SMALL)
    assert run.silent(*words, "--json", "r.json").splitlines()[-2:] == [f"wrote {kind}.svg", "wrote r.json"]
    record = json.loads((here / "r.json").read_text())
    assert record["settings"]["over"] == {"n": [1.0, 100.0]}
    assert {result["kind"] for result in record["results"]} == {kind}
    run.passed("plot", kind, "r.json", "-o", "again.svg")
    assert (here / "again.svg").read_bytes() == (here / f"{kind}.svg").read_bytes()


def test_a_record_is_plotted_without_jax(here: Path) -> None:
    assert cli.run(("plot", "albedo-vs-n", "phong", "--n", "1:10", *SMALL, "--json", "r.json")) == ExitCode.PASSED
    program = "import sys\nfrom brdfcheck import cli\ncode = cli.run(['plot', 'albedo-vs-n', 'r.json'])\n"
    program += "sys.exit(code or 10 * ('jax' in sys.modules))"
    assert python("-c", program, cwd=here)[::2] == (0, "")


def test_names_with_different_ranges_share_one(run: Run, here: Path) -> None:
    out = run.passed("plot", "albedo-vs-n", "phong", "binomial-power-half", *SMALL)
    assert out.startswith("n=1:1000, the range that all have")


def test_all_that_a_file_offers(run: Run, here: Path) -> None:
    """As `check` takes it; what is named twice is there once."""
    flat = "def {}(wi, wo):\n    return 0.25 + 0 * wo[..., 2]\n"
    (here / "flat.py").write_text(flat.format("one") + flat.format("two"))
    out = run.silent("plot", "albedo-vs-angle", "flat.py:*", "phong", "flat.py:two", "--n", "3", *SMALL, "--json", "r.json")
    assert [line.split("  ")[0] for line in out.splitlines()[:-2]] == ["flat.py:one", "flat.py:two", "phong n=3"]


def test_a_fit_and_a_sweep(run: Run, here: Path) -> None:
    result = {"name": "blinn-phong", "objective": "minimax", "n": [1, 100], "factor": {"form": "Factor", "A": 8.0, "B": 26.7}}
    document = {"schema": "brdfcheck-results", "schema_version": 1, "command": "fit", "results": [result]}
    (here / "fit.json").write_text(json.dumps(document))
    out = run.passed("plot", "factor", "fit.json", "blinn-phong-6", "--n", "1:100", *SMALL)
    assert out.splitlines()[0].startswith("blinn-phong, minimax  exceeds 1 for n=")
    (here / "sweep.toml").write_text(
        'brdf = "binomial-power-published"\n[axes]\nn = { geomspace = [1, 100, 25] }\ncos_theta = [0.0, 0.5, 1.0]\n'
    )
    run.passed("sweep", "sweep.toml", "--out", "s.zarr")
    assert "exceeds 1 for n=14." in run.passed("plot", "albedo-vs-n", "s.zarr")
    run.passed("plot", "heatmap", "s.zarr")
    out = run.passed("plot", "albedo-vs-angle", "s.zarr", "--n", "1,100")
    assert [line.split("  ")[0].rpartition(" ")[2] for line in out.splitlines()[:2]] == ["n=1", "n=100"]


# --- --show ---


def test_show_needs_a_display(run: Run, here: Path) -> None:
    if sys.platform.startswith("linux"):
        said = run.refused("plot", "albedo-vs-n", "phong", "--show")
        assert said == "brdfcheck: --show: there is no display; leave it out and open the file that is written"
        assert os.listdir(here) == []


def test_show_opens_a_window_and_writes_nothing(run: Run, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib.pyplot as plt

    shown = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(plt, "get_backend", lambda: "TkAgg")
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.gcf().canvas.manager.canvas.figure.axes[0].get_xlabel()))
    words = ("plot", "albedo-vs-n", "phong", "--n", "1:10", *SMALL, "--show")
    assert "wrote" not in run.passed(*words)
    assert shown == ["exponent n"]
    assert os.listdir(here) == []
    assert plt.get_fignums() == []
    monkeypatch.setattr(plt, "get_backend", lambda: "agg")
    code, _, err = run(*words, "-o", "x.svg")
    assert code == ExitCode.USAGE_ERROR
    assert "no toolkit for windows" in err
    assert os.listdir(here) == ["x.svg"]


# --- bad words ---


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("albedo-vs-angle", "mine.py:not_a_number", *SMALL), "not a number anywhere"),
        (("albedo-vs-angle", "mine.py:raises"), "RuntimeError: boom"),
        (("albedo-vs-n", "mine.json"), "not JSON"),
        (("albedo-vs-n", "plain.txt"), "not JSON"),
        (("albedo-vs-n", "bytes.json"), "it is not a text file"),
        (("albedo-vs-n", "list.json"), "not a record of brdfcheck, but a JSON list"),
    ],
)
def test_4_for_what_cannot_be_plotted(run: Run, mine: str, here: Path, words: tuple[str, ...], message: str) -> None:
    for name, data in (("mine.json", b"{"), ("plain.txt", b"hello"), ("bytes.json", b"\xff\xfe\x00"), ("list.json", b"[]")):
        (here / name).write_bytes(data)
    before = set(os.listdir(here))
    code, out, err = run("plot", *words)
    assert (code, out) == (ExitCode.USAGE_ERROR, "")
    assert message in err.splitlines()[-1]
    assert err.splitlines()[-1].startswith("brdfcheck: ")
    assert set(os.listdir(here)) - {"__pycache__"} == before


def test_options_that_a_record_cannot_answer(run: Run, here: Path) -> None:
    run("plot", "albedo-vs-n", "phong", "--n", "1:10", *SMALL, "--json", "r.json")
    for option in (("--n", "1:2"), ("--cos-theta", "1"), ("--samples", "9")):
        assert "a record holds what was computed" in run.refused("plot", "albedo-vs-n", "r.json", *option)


# --- studies ---


def test_study_list(run: Run, here: Path) -> None:
    first = run.silent("study", "list").splitlines()
    assert {"raw_albedo", "normalized_albedo", "published_claims", "incidence"} <= {line.split()[0] for line in first}
    (line,) = [line for line in first if line.startswith("raw_albedo ")]
    assert "reflect more than it receives?" in line
    assert len(line) < 128
    assert os.listdir(here) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_studies_end_with_their_command(tmp_path: Path, number: signal.Signals) -> None:
    """Whoever ends the command, by Ctrl-C or kill, leaves no study behind."""
    (tmp_path / "studies").mkdir()
    for name in ("one", "two"):
        slow = f"import os, time\n    open({str(tmp_path / name)!r}, 'w').write(str(os.getpid()))\n    time.sleep(60)"
        text = f'"""Why?\n\nAnswer: because.\n"""\ndef run(size):\n    {slow}\nplot = summary = run\n'
        (tmp_path / "studies" / f"{name}.py").write_text(text)
    program = "import sys, pathlib\nfrom brdfcheck import cli, studies\n"
    program += f"studies.folder = lambda: pathlib.Path({str(tmp_path)!r}, 'studies')\n"
    program += "sys.exit(cli.run(['study', 'all', '--size', 'small']))"
    command = process("-c", program, cwd=tmp_path)
    wait_for(tmp_path / "one")
    command.send_signal(number)
    _, errors = command.communicate(timeout=60)
    assert (command.returncode, errors) == (ExitCode.INTERRUPTED, "brdfcheck: interrupted\n")
    for file in (tmp_path / "one", tmp_path / "two"):
        if file.exists():
            with pytest.raises(ProcessLookupError):
                os.kill(int(file.read_text()), 0)


@pytest.mark.slow
def test_one_study_that_fails_does_not_stop_the_others(run: Run, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from brdfcheck import studies

    known = studies.find()
    bad = here / "bad.py"
    bad.write_text('"""Why?\n\nAnswer: because.\n"""\ndef run(size):\n    raise RuntimeError("boom")\nplot = summary = run\n')
    chosen = {"bad": studies.Study("bad", bad, "Why?", "because."), "raw_albedo": known["raw_albedo"]}
    monkeypatch.setattr(studies, "find", lambda: chosen)
    out = run.failed("study", "all", "--size", "small")
    assert "bad  failed: RuntimeError: boom\n" in out
    assert "wrote reports/raw_albedo: record.json" in out
    assert re.search(r"^1 of 2 studies in 0\.\d minutes$", out, re.MULTILINE)
    assert os.listdir("reports/raw_albedo")
    _, _, err = run("study", "all", "--size", "small", "--debug")
    assert "Traceback" in err
    assert run("study", "bad")[0] == ExitCode.INTERNAL_ERROR
    monkeypatch.setattr(studies, "find", dict)
    for word in ("list", "all"):
        assert run("study", word)[0] == ExitCode.NOTHING_TO_CHECK
