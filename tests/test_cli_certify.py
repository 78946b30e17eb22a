"""``brdfcheck certify``: what it prints and writes, and how it ends."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from shared import Run

from brdfcheck.cli import ExitCode

MINE = """
import brdfcheck as b
import jax.numpy as jnp
import numpy as np

def glossy(n):
    return b.Normalized(b.BlinnPhong(n), b.Factor(6, 25.2))

def rising(n):
    return b.Normalized(b.BinomialPower(n, clamped=False), b.Factor(6, 1e30))

def dull(wi, wo):
    return 0.3 + 0 * wi[..., 2]

def bright(wi, wo, k):
    return k * wi[..., 2] * wo[..., 2]

def middle(wi, wo):
    return jnp.median(wi, axis=-1)

def quits(n):
    if not isinstance(n, float):
        raise SystemExit(3)
    return b.Phong(n)

def slow(wi, wo):
    return np.asarray(wi)[..., 2]
"""


def test_a_proof_is_written_and_verified(run: Run, here: Path) -> None:
    assert run.passed("certify", "blinn-phong-6", "--over", "n=0:inf", "-o", "c.json") == (
        "blinn-phong-6  CONSERVES: The directional albedo of (n + 6)/(8 pi) (N.H)^n is at most 1 for every n from 0 to inf at"
        " every angle of incidence.\n"
    )
    assert run.passed("certify", "--verify", "c.json").startswith("c.json  VERIFIED  CONSERVES: The directional albedo of")
    Path("c.json").write_text(Path("c.json").read_text().replace('"A": "6"', '"A": "6.5"'))
    assert run.failed("certify", "--verify", "c.json").startswith("c.json  REJECTED: ")


def test_the_certificate_alone_on_stdout(run: Run) -> None:
    code, out, err = run("certify", "binomial-power-published", "-o", "-")
    assert code == ExitCode.FAILED
    record = json.loads(out)
    assert (record["verdict"], record["point"]["n"]) == ("VIOLATES", "17.85")
    assert err.startswith("binomial-power-published  VIOLATES: ")


def test_a_users_file(run: Run, mine: str) -> None:
    assert "(n + 6)/25.2 (N.H)^n" in run.passed("certify", "mine.py:glossy", "--over", "n=1:1000")
    out = run.failed("certify", "mine.py:rising", "--over", "n=1:1000", "-o", "c.json")
    assert out.startswith("mine.py:rising  UNDECIDED: the theorem on normal incidence does not apply")
    assert not Path("c.json").exists()


def test_a_users_function(run: Run, mine: str) -> None:
    program = "The directional albedo of the program of mine.py:bright (6 operations) is at"
    out = run.passed("certify", "mine.py:bright", "--over", "k=0:0.45", "-o", "c.json")
    assert f"CONSERVES: {program} most 1 for every k from 0 to" in out
    record = json.loads(Path("c.json").read_text())
    assert (record["range"], record["lobe"]["kind"]) == ({"k": ["0", "0.45"], "cos_theta": ["0", "1"]}, "program")
    needed = "which must be given too: brdfcheck certify FILE.py:OBJECT --verify CERTIFICATE"
    assert needed in run.failed("certify", "--verify", "c.json")
    assert "VERIFIED  CONSERVES" in run.passed("certify", "mine.py:bright", "--verify", "c.json")
    assert "mine.py:dull has no parameter" in run.refused("certify", "mine.py:dull", "--verify", "c.json")
    assert f"VIOLATES: {program} least 1.0" in run.failed("certify", "mine.py:bright", "--over", "k=0:0.5")
    out = run.passed("certify", "mine.py:bright", "--over", "k=0:0.5", "--cos-theta", "0:0.9")
    assert "for every k from 0 to 0.5 at every cos(theta) from 0 to 0.9." in out
    # 3/(2 pi): the albedo along the normal is 1, and rounding stands between it and a proof.
    out = run.failed("certify", "mine.py:bright", "--over", "k=0.477464829275686", "--seconds", "0.5")
    assert "UNDECIDED: after" in out
    assert re.search(r"the albedo is proved to be at most 1\.\d{4} for k = 0.477464829275686 at every angle", out)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mine.py:dull", "--seconds", "0"], "certify has no exact proof for mine.py:dull; it has proofs for Lambert"),
        (["mine.py:middle"], "of whole numbers that depend on directions or parameters is not covered by the arithmetic"),
        (["mine.py:slow"], "mine.py:slow cannot be traced by JAX, and certify proves what can be"),
        (["mine.py:bright", "--over", "k=1:inf"], "mine.py:bright: for a proof of a function the range of k must be finite"),
        (["mine.py:quits", "--over", "n=1:2"], "mine.py:quits ends the process while JAX traces it"),
        (["phong", "--over", "m=1"], "phong has no parameter 'm'; its parameters: n"),
        (["--verify", "c.json", "-o", "d.json"], "--verify takes the ranges from the certificate"),
        (["--verify", "c.json"], "there is no file 'c.json'"),
        (["phong", "-o", "c.png"], "--output: must end in .json; got 'c.png'"),
        (["phong", "-o", "no/c.json"], "cannot write 'no/c.json': the folder"),
    ],
)
def test_mistakes(run: Run, mine: str, arguments: list[str], message: str) -> None:
    assert message in run.refused("certify", *arguments)
