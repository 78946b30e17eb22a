"""``brdfcheck certify``: a proof that a BRDF conserves energy, or that it does not, as a certificate that anyone can check."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli import words
from brdfcheck.cli.app import PLAIN, CosTheta, ExitCode, asked, command, start
from brdfcheck.cli.output import Output
from brdfcheck.folders import readable
from brdfcheck.messages import UsageError


@command(
    "certify",
    epilog="""\b
Examples:
  brdfcheck certify binomial-power-half -o certificate.json
  brdfcheck certify blinn-phong-6 --over n=0:inf
  brdfcheck certify binomial-power-published
  brdfcheck certify mine.py:glossy --over n=1:1000
  brdfcheck certify mine.py:function --over n=1:20 --seconds 120
  brdfcheck certify shader.glsl:BRDF --over n=1:20
  brdfcheck certify --verify certificate.json
  brdfcheck certify mine.py:function --verify function.json

Of formulas that the package knows (its lobes with a factor (n+A)/B, a constant or an exact
one, and its facets) proofs are exact. Of any other function that JAX can trace, shader files
included, they are interval arithmetic: where the albedo leaves some room below 1 or rises
above it, else the answer is the bound that is proved. The theorems are in docs/proofs.md.

\b
Exit codes:
  0  proved: it conserves energy, or the    2  interrupted
     certificate holds                      3  internal error
  1  proved: it does not; or no proof       4  usage error
     was found; or the certificate
     does not hold""",
)
def _certify(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="A catalogue name or path/to/file.py:object.", show_default=False),
    ] = None,
    over: Annotated[
        list[words.Setting] | None,
        typer.Option(
            "--over",
            "--set",
            metavar="NAME=LO:HI",
            parser=words.open_setting,
            help="Let a parameter run over a range, whose upper end may be inf, or hold it with NAME=VALUE. Repeatable.",
        ),
    ] = None,
    cos_theta: CosTheta = None,
    seconds: Annotated[
        float,
        typer.Option(metavar="NUMBER", min=0, max=1e6, help="How long to look for the proof of a function; 0: not at all."),
    ] = 60.0,
    how: Reading = PLAIN,
    out: Annotated[
        str | None,
        words.file(
            "-o",
            "--output",
            ends=(".json",),
            bare=True,
            stdout=True,
            help='Write the certificate as JSON; "-" writes it to standard output.',
        ),
    ] = None,
    check: Annotated[
        str | None,
        typer.Option("--verify", metavar="FILE", help="Check a certificate again; one of a function together with its NAME."),
    ] = None,
) -> int:
    """A proof that a BRDF conserves energy, or that it does not.

    For every value of the range and every angle of incidence, in exact or interval arithmetic; nothing is sampled. Where the
    law is broken, the certificate has a point at which the albedo lies above 1, and of lobes the intervals of violation.
    """
    if check is not None:
        if over or out or cos_theta:
            raise UsageError("--verify takes the ranges from the certificate: give no --over, --cos-theta or --output")
        return _verified(check, name, how)
    if name is None:
        raise UsageError("give a BRDF to certify, or --verify FILE")
    output = Output(alone=out == "-")
    start()
    from brdfcheck.proof.certify import certificate_of
    from brdfcheck.proof.cover import NotProved

    certificate, trouble = None, None
    with asked():
        try:
            certificate = certificate_of(name, words.together(over), seconds, cos_theta, how)
        except NotProved as error:
            trouble = error
    if certificate is None:
        output.line(f"{name}  UNDECIDED: {trouble}")
        return ExitCode.FAILED
    output.line(f"{name}  {certificate}")
    if out is not None:
        output.save(out, certificate.to_json(), "--output")
    return ExitCode.PASSED if certificate else ExitCode.FAILED


def _verified(path: str, name: str | None, how: Any) -> int:
    """Check the certificate in a file, of a program that is named, too."""
    output = Output()
    start()
    from brdfcheck.proof.verify import Rejected, read, verify

    with readable(path, "a certificate", pipes=True), open(path, encoding="utf-8") as file:
        text = file.read()
    with asked():
        try:
            certificate, trouble = read(text), None
            verify(certificate, name, how)
        except Rejected as error:
            certificate, trouble = None, error
    if certificate is None:
        output.line(f"{path}  REJECTED: {trouble}")
        return ExitCode.FAILED
    output.line(f"{path}  VERIFIED  {certificate}")
    return ExitCode.PASSED
