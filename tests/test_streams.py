"""Standard streams that are closed, full, unread, or in an encoding that lacks a name: never a verdict, never a traceback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from selection import few
from shared import ROOT, python

from brdfcheck import cli
from brdfcheck.cli import ExitCode
from brdfcheck.messages import one_line

posix = pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")
# No locale at all, and Python not told to take UTF-8 for it.
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def shell(words: str, folder: Path, **environment: str) -> tuple[int, str, str]:
    """(exit code, stdout, stderr) of a line in which $B is the command."""
    variables = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    command = ["sh", "-c", words.replace("$B", f"'{sys.executable}' -m brdfcheck")]
    done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, timeout=120, check=False)
    return done.returncode, done.stdout.decode(), done.stderr.decode()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    text = "def f(wi, wo):\n    print('seen')\n    return 0.1 + 0 * wi[..., 2]\nprint('read')\n"
    (tmp_path / "mine.py").write_text(text)
    return tmp_path


CLOSED = {
    "$B check lambert >&-": ExitCode.PASSED,
    "$B check lambert 2>&-": ExitCode.PASSED,
    "$B list <&-": ExitCode.PASSED,
    "$B list </dev/null": ExitCode.PASSED,
    "$B list --json - >&-": ExitCode.PASSED,
    "$B check phong-classical >&- 2>&- <&-": ExitCode.FAILED,
    "$B list 2>/dev/full": ExitCode.PASSED,
    "$B --help >&-": ExitCode.PASSED,
    "$B check -k nothing-like-this >&-": ExitCode.NOTHING_TO_CHECK,
    "$B chekc >&- 2>&-": ExitCode.USAGE_ERROR,
}


@posix
@pytest.mark.parametrize(
    "words", few(CLOSED, ("$B check phong-classical >&- 2>&- <&-", "$B list 2>/dev/full", "$B --help >&-", "$B chekc >&- 2>&-"))
)
def test_what_is_closed_changes_no_exit_code(folder: Path, words: str) -> None:
    code = CLOSED[words]
    got, out, err = shell(words, folder)
    assert got == code, err
    assert err == ("brdfcheck: nothing to check: no name contains 'nothing-like-this'; brdfcheck list shows all names\n"
                   if code == ExitCode.NOTHING_TO_CHECK else "")  # fmt: skip
    assert bool(out) == (">&-" not in words.replace("2>&-", ""))


@posix
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize(
    "words", few(["--help", "check --help", "--version", "list", "list --json -", "study list"], ("--help", "list --json -"))
)
def test_a_full_disk_is_a_usage_error(folder: Path, words: str) -> None:
    code, _, err = shell(f"$B {words} >/dev/full", folder)
    assert (code, err) == (ExitCode.USAGE_ERROR, "brdfcheck: cannot write to <stdout>: No space left on device\n")


@pytest.mark.slow
@posix
@pytest.mark.parametrize("closed", [">&- 2>&- <&-", ">&- 2>&-", "2>&-"])
def test_no_file_takes_the_place_of_a_closed_stream(folder: Path, closed: str) -> None:
    """Messages, and what a user's file prints, would be written into it."""
    code, _, _ = shell(f"$B check mine.py:f --effort quick --json out.json {closed}", folder)
    assert code == ExitCode.PASSED
    assert json.loads((folder / "out.json").read_text())["summary"]["conserve"] == 1
    assert sorted(os.listdir(folder)) in (["mine.py", "out.json"], ["__pycache__", "mine.py", "out.json"])


@pytest.mark.slow
@posix
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("unwritable", ["2>/dev/full", "2>&-"])
def test_what_a_file_prints_is_no_finding_where_it_cannot_be_written(folder: Path, unwritable: str) -> None:
    code, out, err = shell(f"$B check mine.py:f --effort quick {unwritable}", folder)
    assert (code, err) == (ExitCode.PASSED, "")
    assert out.splitlines()[-1].startswith("1 conserves, ")
    assert "seen" not in out


@pytest.mark.slow
@posix
def test_what_a_file_prints_is_no_finding_where_nobody_reads_it(folder: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    code, out, _ = python("-m", "brdfcheck", "check", "mine.py:f", "--debug", cwd=folder, stderr=writing)
    os.close(writing)
    assert code == ExitCode.PASSED
    assert out.splitlines()[-1].startswith("1 conserves, ")


def test_a_process_without_streams(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["brdfcheck", "list"])
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    assert cli.main() == ExitCode.PASSED
    assert cli.run(["list", "--json", "-"]) == ExitCode.PASSED
    assert cli.run(["chekc"]) == ExitCode.USAGE_ERROR
    assert (sys.stdout, sys.stderr) == (None, None)


@posix
@pytest.mark.parametrize(
    "words",
    few(
        ["--help", "check --help", "list", "list -k ö", "audit -k phong-pdf", "study list", "render --list"],
        ("check --help", "list -k ö"),
    ),
)
def test_a_locale_without_letters(folder: Path, words: str) -> None:
    code, out, err = shell(f"$B {words}", folder, **ASCII)
    assert code == (ExitCode.NOTHING_TO_CHECK if "ö" in words else ExitCode.PASSED)
    assert "Error" not in err
    assert (out + err).isascii()


@pytest.mark.slow
@posix
def test_names_in_a_locale_without_letters(folder: Path) -> None:
    (folder / "größe.py").write_text("def f(wi, wo):\n    raise ValueError('größer → kleiner')\n", encoding="utf-8")
    code, out, err = shell("$B check größe.py:f --json ä.json --junitxml ä.xml", folder, **ASCII)
    assert (code, err) == (ExitCode.FAILED, "")
    assert "f raised ValueError: gr\\xf6\\xdfer \\u2192 kleiner" in out
    assert json.loads((folder / "ä.json").read_text())["summary"]["undecided"] == 1
    assert "größer → kleiner" in (folder / "ä.xml").read_text(encoding="utf-8")
    assert shell("$B render ö.toml -o ö.png", folder, **ASCII) == (
        ExitCode.USAGE_ERROR,
        "",
        "brdfcheck: there is no file '\\xf6.toml'\n",
    )


def test_one_line_shows_what_the_encoding_lacks() -> None:
    assert one_line("ö.toml".encode().decode("ascii", "surrogateescape")) == "ö.toml"
    assert one_line(b"\xf6.toml".decode("utf-8", "surrogateescape")) == "\\xf6.toml"
    assert one_line("\ud800 x") == "\\ud800 x"
    assert one_line("größer\n →\t1\x1b[31m") == "größer → 1[31m"
