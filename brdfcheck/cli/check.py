"""``brdfcheck check`` and ``brdfcheck audit``: verdicts, on validated or your own BRDFs and on the literature."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from brdfcheck.cli import words
from brdfcheck.cli.app import (
    CosTheta,
    Debug,
    Define,
    ExitCode,
    Filter,
    Include,
    Json,
    Over,
    Returns,
    Roles,
    command,
    filtered,
    reading,
    start,
)
from brdfcheck.cli.output import Output
from brdfcheck.cli.reports import Badge, Files, Html, JUnit, Sarif
from brdfcheck.cores import available_cores

if TYPE_CHECKING:
    from brdfcheck.brdf.subject import Target
    from brdfcheck.verdict import Report

_log = logging.getLogger("brdfcheck")
_Effort = Literal["quick", "normal", "thorough"]  # `EFFORTS` of the search, which is imported later

Tolerance = Annotated[
    float | None,
    typer.Option(
        metavar="NUMBER",
        min=0,
        max=0.5,
        help="How far above 1 an albedo may lie and still conserve energy. [default: 1e-9, 1e-5 for plug-ins of Mitsuba]",
    ),
]
Rtol = Annotated[
    float | None,
    typer.Option(metavar="NUMBER", min=1e-16, max=0.5, help="Relative accuracy of the albedos. [default: the best]"),
]
Effort = Annotated[
    _Effort,
    typer.Option(help="How many points the search looks at: quick before a commit, thorough before a release."),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        "-j", "--jobs", metavar="N", min=1, help="BRDFs evaluated at a time. [default: 4, or the number of CPUs if fewer]"
    ),
]


@command(
    "check",
    epilog="""\b
Examples:
  brdfcheck check
  brdfcheck check blinn-phong --over n=1:50
  brdfcheck check -k phong --json results.json --junitxml results.xml
  brdfcheck check mine.py:glossy --over n=1:1000 --html report.html --sarif results.sarif
  brdfcheck check mine.py:glossy --over n=1:1000 --over ks=0:1
  brdfcheck check mine.py:measured --cos-theta 0.02:1 --json -
  brdfcheck check disney.brdf --over metallic=1
  brdfcheck check shader.glsl:BRDF --over n=1:100 -D FAST=0 -I include
  brdfcheck check mitsuba:principled --over roughness=0.1:1

A BRDF of your own is a function f(wi, wo) of unit vectors (..., 3), or of one pair (3,),
with the normal along +z, in 1/sr; or one of angles (theta_i, phi_i, theta_o, phi_o) or
(theta_h, theta_d, phi_d); or a class or a factory that takes parameters and makes one; or a
shader file (.brdf, .glsl, .frag, .hlsl, .slang), whose parameters run over the ranges
that the file gives, or over yours.

\b
Exit codes:
  0  all conserve energy            3  internal error
  1  some violate the law, are      4  usage error
     undecided, or have findings    5  nothing to check
  2  interrupted""",
)
def check_command(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Catalogue names (brdfcheck list), path/to/file.py:object, or shader files: FILE.brdf, FILE.glsl:FUNCTION;"
            " or plug-ins of Mitsuba 3, mitsuba:NAME, mitsuba:FILE.xml#ID."
            " [default: the validated catalogue]",
            show_default=False,
        ),
    ] = None,
    over: Over = None,
    cos_theta: CosTheta = None,
    define: Define = None,
    include: Include = None,
    args: Roles = None,
    returns: Returns = "brdf",
    tolerance: Tolerance = None,
    rtol: Rtol = None,
    substring: Filter = "",
    json: Json = None,
    junitxml: JUnit = None,
    sarif: Sarif = None,
    badge: Badge = None,
    html: Html = None,
    effort: Effort = "normal",
    jobs: Jobs = None,
    debug: Debug = False,
) -> int:
    """The gate: do these BRDFs conserve energy?

    Finds the largest directional albedo over all parameters and angles, with an error bar, and says what the answer rests on:
    a theorem, or a search and the width of what it could have missed. UNDECIDED means that the error bar contains 1, or that
    the search did not settle. Also checks reciprocity, sign and finiteness.
    """
    files = Files(json, junitxml, sarif, badge, html)
    how = reading(define, include, args, returns)
    own = {"names": names or [], "over": words.together(over), "cos_theta": cos_theta, **how.record}
    settings = _settings(substring, tolerance, rtol, effort, jobs, **own)
    began = time.perf_counter()
    start()
    from brdfcheck.brdf import catalog
    from brdfcheck.brdf.subject import resolve

    wanted = filtered(names or [entry.name for entry in catalog.entries() if entry.validated], substring)
    with contextlib.redirect_stdout(sys.stderr):
        targets = resolve(wanted, settings["over"], cos_theta, how)
        start()  # a user's file may have changed the precision
    if tolerance is None:  # where BRDFs differ, each report says its own
        settings["tolerance"] = min(target.family.tolerance for target in targets)
        settings["own_tolerances"] = len({target.family.tolerance for target in targets}) > 1
    return run_checks("check", targets, settings, Output(json), began, files)


@command(
    "audit",
    epilog="""\b
Examples:
  brdfcheck audit
  brdfcheck audit -k cook-torrance
  brdfcheck audit --json audit.json
  brdfcheck audit --html audit.html

Exits with 0 whatever the verdicts are: it reports on the literature.""",
)
def _audit(
    substring: Filter = "",
    json: Json = None,
    html: Html = None,
    tolerance: Tolerance = 1e-9,
    rtol: Rtol = None,
    effort: Effort = "normal",
    jobs: Jobs = None,
    debug: Debug = False,
) -> int:
    """What the literature claims about its BRDFs, and what is measured."""
    files = Files(json=json, html=html)
    began = time.perf_counter()
    start()
    from brdfcheck.brdf import catalog
    from brdfcheck.brdf.subject import Target

    names = filtered([entry.name for entry in catalog.entries() if not entry.validated], substring)
    targets = [Target(catalog.entry(name).family) for name in names]
    settings = _settings(substring, tolerance, rtol, effort, jobs)
    return run_checks("audit", targets, settings, Output(json), began, files)


def _settings(
    substring: str, tolerance: float | None, rtol: float | None, effort: str, jobs: int | None, **own: Any
) -> dict[str, Any]:
    """The options as they are recorded; `own`: those of `check` alone."""
    return {
        "names": [],
        "filter": substring or None,
        "over": {},
        "cos_theta": None,
        "tolerance": 1e-9 if tolerance is None else tolerance,
        "rtol": rtol,
        "effort": effort,
        "jobs": jobs or min(4, len(available_cores())),
        "precision": "float64",
        **own,
    }


def run_checks(
    command: str,
    targets: Sequence[Target],
    settings: Mapping[str, Any],
    output: Output,
    began: float,
    files: Files,
) -> int:
    """Evaluate, print and write what `files` says. An audit says what was claimed besides, and never fails."""
    from brdfcheck.brdf import catalog
    from brdfcheck.output import records
    from brdfcheck.output import text as console

    audit = command == "audit"
    claims = {target.family.name: catalog.entry(target.family.name).claim for target in targets} if audit else {}
    width = max(len(target.family.name) for target in targets)
    if not output.is_terminal:
        output.line(console.tolerance_line(settings["tolerance"]))
    with contextlib.redirect_stdout(sys.stderr):
        reports = _evaluate(
            targets, settings, output, lambda report: console.plain_line(report, width, claims.get(report.name))
        )
    if output.is_terminal:
        console.report_table(output.console, reports, list(claims.values()) or None)
        output.line()
        console.remarks(output.console, reports)
    else:
        for line in console.remark_lines(reports):
            output.line(line)
    seconds, counts = time.perf_counter() - began, records.count(reports)
    code = ExitCode.FAILED if counts["failed"] and not audit else ExitCode.PASSED
    output.line(f"{'published claims: ' if audit else ''}{console.summary_line(counts, seconds, settings['tolerance'])}")
    if os.environ.get("GITHUB_ACTIONS") and not audit:
        for target, report in zip(targets, reports, strict=True):
            if not report.passed:
                place = {"file": target.file, "line": target.line}
                output.line(records.github_error(f"brdfcheck: {report.name}", console.message(report), **place))
    with contextlib.redirect_stdout(sys.stderr):  # a user's code may print while it is drawn
        files.write(output, targets, reports, settings=settings, seconds=seconds, exit_code=code, claims=claims or None)
    pairs = zip(targets, reports, strict=True)
    results = [records.to_json_object(report) | _origin(target, claims) for target, report in pairs]
    summary = {**counts, "seconds": seconds, "exit_code": int(code)}
    output.write_json(lambda: records.document(command, results, settings=settings, summary=summary))
    return code


def _evaluate(
    targets: Sequence[Target], settings: Mapping[str, Any], output: Output, line: Callable[[Report], str]
) -> list[Report]:
    """The reports in the order of the targets, a few at a time; plain lines are written as soon as their turn comes."""
    from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

    pool = ThreadPoolExecutor(settings["jobs"], thread_name_prefix="brdfcheck")
    try:
        # The dear ones, in two dimensions, stand last in the catalogue: begun first, they leave no worker idle.
        step = -1 if all(target.file is None for target in targets) else 1
        waiting, written = set[Any](), 0
        with output.progress(len(targets), "checking", every=10) as advance:
            futures = [pool.submit(_report, target, settings, advance.say) for target in targets[::step]][::step]
            waiting.update(futures)
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()  # an internal error ends the command at once
                    advance()
                while written < len(futures) and futures[written].done():
                    if not output.is_terminal:
                        output.line(line(futures[written].result()))
                    written += 1
        return [future.result() for future in futures]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _report(target: Target, settings: Mapping[str, Any], say: Callable[[str], None]) -> Report:
    """`check`; for a user's BRDF, whatever it raises becomes a finding. `say`: what to call with how far it is."""
    from brdfcheck.brdf.blame import told
    from brdfcheck.verdict.check import check, unusable

    def watch(points: int, best: float) -> None:
        so_far = f", largest albedo so far {best:.6g}" if math.isfinite(best) else ""
        say(f"{target.family.name}: {points} points{so_far}")

    began = time.perf_counter()
    own = settings.get("own_tolerances", False)
    options: Any = {
        "tolerance": target.family.tolerance if own else settings["tolerance"],
        "effort": settings["effort"],
    }
    try:
        return check(target, rtol=settings["rtol"], watch=watch, **options)
    except (Exception, SystemExit) as error:
        if target.file is None:
            raise
        _log.debug("%s cannot be evaluated", target.family.name, exc_info=True)
        text = f"cannot be evaluated: {told(error)}"
        return unusable(target.family, text, seconds=time.perf_counter() - began, **options)


def _origin(target: Target, claims: Mapping[str, str]) -> dict[str, Any]:
    """Where a checked BRDF comes from, for the record."""
    if target.file is not None:
        return {"origin": "user", "file": target.file, "line": target.line}
    from brdfcheck.brdf import catalog

    entry = catalog.entry(target.family.name)
    claim = {"claim": entry.claim} if claims else {}
    return {"origin": "catalog", "formula": entry.formula, "source": entry.source, **claim}
