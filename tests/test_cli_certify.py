"""``brdfcheck certify``: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from brdfcheck.cli import ExitCode
from brdfcheck.cli.process import run

MINE = """
import brdfcheck as b

def glossy(n):
    return b.Normalized(b.BlinnPhong(n), b.Factor(6, 25.2))

def rising(n):
    return b.Normalized(b.BinomialPower(n, clamped=False), b.Factor(6, 1e30))

def dull(wi, wo):
    return 0.3 + 0 * wi[..., 2]
"""


def test_a_proof_is_written_and_verified(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["certify", "blinn-phong-6", "--over", "n=0:inf", "-o", "c.json"]) == ExitCode.PASSED
    out = capsys.readouterr().out
    assert out == (
        "blinn-phong-6  CONSERVES: The directional albedo of (n + 6)/(8 pi) (N.H)^n is at most 1 for every n from 0 to inf at"
        " every angle of incidence.\n"
    )
    assert run(["certify", "--verify", "c.json"]) == ExitCode.PASSED
    assert capsys.readouterr().out.startswith("c.json  VERIFIED  CONSERVES: The directional albedo of")
    Path("c.json").write_text(Path("c.json").read_text().replace('"A": "6"', '"A": "6.5"'))
    assert run(["certify", "--verify", "c.json"]) == ExitCode.FAILED
    assert capsys.readouterr().out.startswith("c.json  REJECTED: ")


def test_the_certificate_alone_on_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["certify", "binomial-power-published", "-o", "-"]) == ExitCode.FAILED
    captured = capsys.readouterr()
    record = json.loads(captured.out)
    assert (record["verdict"], record["point"]["n"]) == ("VIOLATES", "17.85")
    assert captured.err.startswith("binomial-power-published  VIOLATES: ")


def test_a_users_file(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.py").write_text(MINE)
    assert run(["certify", "mine.py:glossy", "--over", "n=1:1000"]) == ExitCode.PASSED
    assert "(n + 6)/25.2 (N.H)^n" in capsys.readouterr().out
    assert run(["certify", "mine.py:rising", "--over", "n=1:1000", "-o", "c.json"]) == ExitCode.FAILED
    assert capsys.readouterr().out.startswith("mine.py:rising  UNDECIDED: the theorem on normal incidence does not apply")
    assert not Path("c.json").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mine.py:dull"], "mine.py:dull is no formula that certify knows; it knows Lambert"),
        (["phong", "--over", "m=1"], "phong has no parameter 'm'; its parameters: n"),
        (["phong", "--verify", "c.json"], "give a BRDF to certify, or --verify FILE, but not both"),
        (["--verify", "c.json", "-o", "d.json"], "--verify takes nothing but the certificate"),
        (["--verify", "c.json"], "--verify: cannot read 'c.json': No such file"),
        (["phong", "-o", "no/c.json"], "cannot write 'no/c.json': the folder"),
    ],
)
def test_mistakes(here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str) -> None:
    Path("mine.py").write_text(MINE)
    assert run(["certify", *arguments]) == ExitCode.USAGE_ERROR
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
