"""The command line: what it prints, what it writes, how it ends."""

from __future__ import annotations

import importlib
import io
import json
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console
from shared import Run, process, shown_by, strict_json

from brdfcheck import cli
from brdfcheck.brdf import catalog
from brdfcheck.cli import ExitCode, output
from brdfcheck.cli import process as running
from brdfcheck.output import text as console
from brdfcheck.verdict import words
from brdfcheck.verdict.supremum import NORMAL_IS_WORST

MINE = """
    import sys
    import numpy as np
    from brdfcheck import Factor, Normalized, Phong

    print("printed on import")

    def planted(n):
        return Normalized(Phong(n), Factor(2.0, 2 * np.pi / 1.01))  # one per cent too large

    def exact(n):
        return Normalized(Phong(n), Factor(2.0, 2 * np.pi))

    def diffuse(wi, wo):
        return 0.5 / np.pi + 0 * wi[..., 2]

    def raises(wi, wo):
        raise RuntimeError("boom")

    def leaves(wi, wo):
        sys.exit(7)
"""


# --- exit codes ---


def test_0_where_all_conserve(run: Run) -> None:
    lines = run.silent("check", "phong").splitlines()
    assert "tolerance 1e-9" in lines[0]
    assert lines[1].startswith("phong  CONSERVES  albedo 1.0000000000 +- ")
    assert "  proof: at most 1 in exact arithmetic (brdfcheck certify), " in lines[1]
    assert "angle=" in lines[1]
    assert lines[-1].startswith("1 conserves, 0 violate, 0 undecided in ")


def test_1_where_a_planted_factor_is_one_per_cent_too_large(run: Run, mine: str) -> None:
    out = run.failed("check", f"{mine}:planted", "--over", "n=1:50")
    assert "VIOLATES   albedo 1.0100000000" in out
    assert "exceeds 1 for n=1..50" in out
    run.passed("check", f"{mine}:exact", "--over", "n=1:50")


@pytest.mark.parametrize(("name", "finding"), [("raises", "raised RuntimeError: boom"), ("leaves", "SystemExit: 7")])
def test_1_where_a_brdf_has_a_defect(run: Run, mine: str, name: str, finding: str) -> None:
    code, out, err = run("check", f"{mine}:{name}", "--effort", "quick")
    assert code == ExitCode.FAILED
    lines = [line for line in out.splitlines() if line.startswith(f"finding: {mine}:{name}: ")]
    assert any(finding in line for line in lines)
    assert "Traceback" not in err


def test_a_function_that_conserves_passes(run: Run, mine: str) -> None:
    code, out, err = run("check", f"{mine}:diffuse", "--effort", "quick", "--cos-theta", "0.5")
    assert code == ExitCode.PASSED
    assert "printed on import" not in out
    assert "printed on import" in err


def test_3_for_an_internal_error(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr(importlib.import_module("brdfcheck.verdict.checking"), "check_family", fail)
    code, _, err = run("check", "phong")
    assert code == ExitCode.INTERNAL_ERROR
    assert err == "brdfcheck: internal error: ZeroDivisionError: planted (--debug shows the traceback)\n"
    code, _, err = run("check", "phong", "--debug")
    assert code == ExitCode.INTERNAL_ERROR
    assert "Traceback" in err
    monkeypatch.setenv("BRDFCHECK_DEBUG", "1")
    assert "Traceback" in run("check", "phong")[2]


def test_4_where_a_file_cannot_be_written_in_the_end(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    assert "No space left on device" in run.refused("list", "--json", str(tmp_path / "out.json"))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("command", ["check", "audit", "list"])
def test_5_where_nothing_is_left(run: Run, tmp_path: Path, command: str) -> None:
    code, out, err = run(command, "-k", "nothing-like-this", "--json", str(tmp_path / "out.json"))
    assert (code, out) == (ExitCode.NOTHING_TO_CHECK, "")
    assert "no name contains 'nothing-like-this'" in err
    assert os.listdir(tmp_path) == []


# --- files ---


def test_json(run: Run, mine: str, tmp_path: Path) -> None:
    run.failed("check", "lambert", f"{mine}:raises", "--tolerance", "1e-8", "--json", str(tmp_path / "results.json"))
    record = strict_json((tmp_path / "results.json").read_text())
    assert record["schema_version"] == 1
    assert record["settings"]["tolerance"] == 1e-8
    assert record["summary"]["conserve"] == 1
    assert record["summary"]["exit_code"] == 1
    lambert, raises = record["results"]
    assert (lambert["verdict"], lambert["origin"], lambert["formula"]) == ("CONSERVES", "catalog", "k_d / pi")
    assert (raises["albedo"], raises["origin"], raises["file"]) == ("NaN", "user", mine)


def test_json_on_stdout_stands_alone(run: Run, mine: str) -> None:
    code, out, err = run("check", f"{mine}:exact", "--over", "n=1:2", "--json", "-")
    assert code == ExitCode.PASSED
    assert strict_json(out)["settings"]["over"] == {"n": [1.0, 2.0]}
    assert "1 conserves" in err


def test_github_annotations(run: Run, mine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    out = run.failed("check", "lambert", f"{mine}:raises")
    (line,) = [line for line in out.splitlines() if line.startswith("::error")]
    number = Path(mine).read_text().splitlines().index("def raises(wi, wo):") + 1
    escaped = mine.replace(":", "%3A").replace(",", "%2C")
    assert line.startswith(
        f"::error file=mine.py,line={number},title=brdfcheck%3A {escaped}%3Araises::UNDECIDED: albedo unknown"
    )
    assert "raised RuntimeError: boom" in line


def test_results_do_not_depend_on_the_number_of_workers(run: Run) -> None:
    results = []
    for jobs in "14":
        out = run.passed("check", "-k", "lyon-1", "--jobs", jobs, "--json", "-")
        results.append(json.loads(out)["results"])
        for result in results[-1]:
            del result["seconds"]
    assert [result["name"] for result in results[0]] == ["lyon-1-half", "lyon-1-mirror"]
    assert results[0] == results[1]


# --- audit and list ---


def test_audit_reports_and_passes(run: Run, tmp_path: Path) -> None:
    out = run.passed("audit", "-k", "binomial-power-published", "--json", str(tmp_path / "audit.json"))
    line = out.splitlines()[1]
    assert "VIOLATES   albedo 1.0016005217" in line
    assert "at n=17.85" in line
    assert "exceeds 1 for n=14.303..23.0561" in line
    assert 'claimed "conserves for n in [1, 1000]"' in line
    (result,) = json.loads((tmp_path / "audit.json").read_text())["results"]
    assert result["claim"] == "conserves for n in [1, 1000]"


def test_list_names_everything(run: Run, tmp_path: Path) -> None:
    out = run.passed("list", "--json", str(tmp_path / "list.json"))
    assert [line.split()[0] for line in out.splitlines()] == list(catalog.names())
    record = json.loads((tmp_path / "list.json").read_text())
    assert [entry["name"] for entry in record["entries"]] == list(catalog.names())
    assert json.loads(run("list", "--json", "-")[1]) == record


def test_the_script_is_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[int] = []
    monkeypatch.setattr(running, "leave", ended.append)
    monkeypatch.setattr(running, "run", lambda _: ExitCode.INTERRUPTED)
    cli.script()
    assert ended == [ExitCode.INTERRUPTED]


# --- as a stranger sees it ---


def test_python_dash_m_and_a_reader_that_goes_away() -> None:
    with process("-m", "brdfcheck", "list") as command:
        command.stdout.close()
        assert command.stderr.read() == ""
    assert command.returncode == ExitCode.PASSED


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_terminal_shows_progress_and_a_table() -> None:
    import pty

    leader, follower = pty.openpty()
    terminal = {"TERM": "xterm-256color", "COLUMNS": "100"}
    with process("-m", "brdfcheck", "check", "lambert", environment=terminal, stdout=follower, stderr=follower) as command:
        os.close(follower)
        seen = shown_by(leader)
    assert command.returncode == ExitCode.PASSED
    for text in (b"checking", b"0/1", b"Largest albedo", b"1 conserves, 0 violate, 0 undecided"):
        assert text in seen


class Terminal(io.StringIO):
    """A terminal for a test that stays in its process."""

    def isatty(self) -> bool:
        return True


def terminals(monkeypatch: pytest.MonkeyPatch) -> tuple[Terminal, Terminal]:
    """Standard output and error of this process, from now on."""
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    out, err = Terminal(), Terminal()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    return out, err


@pytest.mark.parametrize("words", [("check", "phong-classical"), ("audit", "-k", "phong-pdf"), ("list", "-k", "phong")])
def test_commands_on_a_terminal(monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]) -> None:
    out, err = terminals(monkeypatch)
    assert cli.run(words) in (ExitCode.PASSED, ExitCode.FAILED)
    assert "BRDF" in out.getvalue()
    assert ("checking" in err.getvalue()) == (words[0] != "list")
    assert "checking" not in out.getvalue()
    assert ("finding: phong-classical: not reciprocal" in out.getvalue()) == (words[0] == "check")


def test_what_takes_its_time_says_so_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    out, err = terminals(monkeypatch)
    assert cli.run(("fit", "phong", "--n", "1:10")) == ExitCode.PASSED
    assert "fitting phong over n=1:10" in err.getvalue()
    assert "fitting" not in out.getvalue()
    assert "verdict   CONSERVES" in out.getvalue()


def test_how_far_a_command_is_says_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr(output.time, "monotonic", lambda: now)
    with output.Output(None).progress("checking", 3, every=10) as advance:
        for now in (1.0, 9.9, 10.1, 12.0, 20.0, 20.2):
            advance.say(f"at {now}")
            advance()
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == ["checking at 10.1", "checking at 20.2"]


def shown(width: int, show: Callable[[Console], None], encoding: str = "utf-8") -> str:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    show(Console(file=stream, width=width, force_terminal=True, color_system=None, markup=False, highlight=False))
    stream.flush()
    return raw.getvalue().decode(encoding)


@pytest.fixture(scope="module")
def reports() -> list:
    from brdfcheck.verdict import check

    return [check("phong", n=(1, 10)), check("binomial-power-published"), check("phong-classical", n=(1, 10))]


@pytest.mark.parametrize("width", [50, 80, 120, 200])
@pytest.mark.parametrize("claimed", [False, True])
def test_tables_fit_the_terminal(reports: list, width: int, claimed: bool) -> None:
    claims = ["one", "two", "three"] if claimed else None
    text = shown(width, lambda terminal: console.report_table(terminal, reports, claims))
    assert max(map(len, text.splitlines())) <= width
    words = ("phong", "VIOLATES", "1.0016005217 ± ", "n=17.8512", "angle=0°", "14.303..23.0561", "zonal")
    for word in (*words, *(claims or ())):
        assert word in text
    text = shown(width, lambda terminal: console.remarks(terminal, reports))
    assert "not reciprocal" in " ".join(text.split())


def test_tables_in_an_encoding_without_signs(reports: list) -> None:
    text = shown(200, lambda terminal: console.report_table(terminal, reports), "ascii")
    assert "1.0016005217 +- " in text


@pytest.mark.parametrize("width", [50, 120, 200])
def test_the_catalogue_fits_the_terminal(width: int) -> None:
    text = shown(width, lambda terminal: console.entry_table(terminal, catalog.entries()))
    assert max(map(len, text.splitlines())) <= width
    assert all(name in text for name in catalog.names())


def test_plain_lines_are_plain(reports: list) -> None:
    for report in reports:
        line = console.plain_line(report)
        assert line.isascii()
        assert line.isprintable()
    assert words.exact(1e-9) == "1e-9"
    assert words.exact(0.25) == "0.25"
    assert [words.count_text(count) for count in (7, 78_000, 1_200_000, 3e9)] == ["7", "78k", "1.2M", "3G"]


def test_what_an_answer_rests_on_in_words(reports: list) -> None:
    report = replace(reports[0], basis="search", points=12_345, climbs=1, settled=True, width={})
    assert words.basis_text(report) == "search, 12.3k points, 1 climb"
    width = {"n": 1e-3, "angle": 0.25, "azimuth": 1.5, "cell": 0.02}
    assert words.basis_text(replace(report, settled=False, width=width)) == (
        "search, 12.3k points, 1 climb, not settled, could miss 0.1 % of n, 0.25 deg of the angle, 1.5 deg of the azimuth"
        " or 2 % of all at once"
    )
    assert words.basis_text(replace(report, width={"n": 1e-3, "cell": 1.0})).endswith(" or 100 % of all at once")
    proof = replace(report, basis="proof", settled=False, width=width)  # which nothing can slip through
    assert words.basis_text(proof) == "proof: at most 1 in exact arithmetic (brdfcheck certify), 12.3k points for the largest"
    assert words.basis_text(replace(report, basis="none")) == "nothing could be evaluated"
    theorem = f"theorem: {NORMAL_IS_WORST}, 12.3k points over the parameters"
    assert words.basis_text(replace(report, basis="theorem", width={"n": 0.01})) == f"{theorem}, could miss 1 % of n"


def test_channels_and_growth_without_bound_in_words(reports: list) -> None:
    for channel, count, text in ((0, 3, "channel=red"), (2, 3, "channel=blue"), (5, 8, "channel=5")):
        report = replace(reports[0], channel=channel, channels=count)
        assert words.place_text(report).endswith(f"{text} angle=0 deg")
    assert "channel" not in words.place_text(reports[0])
    endless = replace(reports[0], albedo=float("inf"), error=float("inf"), unbounded="towards n=3 cos=0.5")
    assert words.albedo_text(endless) == "grows without bound towards n=3 cos=0.5"
    assert words.albedo_text(replace(endless, unbounded=None)) == "infinite"
    assert words.albedo_text(replace(endless, albedo=float("nan"))) == "not a number"
