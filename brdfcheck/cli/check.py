"""``brdfcheck check`` and ``brdfcheck audit``: verdicts, on validated or your own BRDFs and on the literature."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdfcheck.cli.app import EXIT_CODES, Debug, ExitCode, Filter, Json, Task, app, filtered, refuse_outputs, start
from brdfcheck.cli.output import Output, save
from brdfcheck.cli.words import parse_cosines, parse_number, parse_over
from brdfcheck.cores import available_cores
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.brdf.subject import Target
    from brdfcheck.verdict import Report


class Effort(StrEnum):
    """How many points the search looks at; `EFFORTS` of the search."""

    quick = "quick"
    normal = "normal"
    thorough = "thorough"


@dataclass(frozen=True)
class _Settings:
    """The options that `check` and `audit` share, already understood."""

    tolerance: float
    rtol: float | None
    jobs: int
    filter: str
    json: str | None
    junit: str | None = None
    names: Sequence[str] = ()
    over: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    cos_theta: tuple[float, float] | None = None
    effort: str = "normal"


_Tolerance = Annotated[str, typer.Option(metavar="NUMBER", help="How far above 1 an albedo may lie and still conserve.")]
_Rtol = Annotated[str | None, typer.Option(metavar="NUMBER", help="Relative accuracy of the albedos. [default: the best]")]
_Effort = Annotated[
    Effort,
    typer.Option(help="How many points the search looks at: quick before a commit, thorough before a release."),
]
_Jobs = Annotated[
    str | None,
    typer.Option("-j", "--jobs", metavar="N", help="BRDFs evaluated at a time. [default: 4, or the number of CPUs]"),
]


@app.command(
    "check",
    epilog=f"""\b
Examples:
  brdfcheck check
  brdfcheck check blinn-phong --over n=1:50
  brdfcheck check -k phong --json results.json --junitxml results.xml
  brdfcheck check mine.py:glossy --over n=1:1000 --over ks=0:1
  brdfcheck check mine.py:measured --cos-theta 0.02:1 --json -

A BRDF of your own is a function f(wi, wo) of unit vectors (..., 3) with the normal
along +z, in 1/sr; or a class or a factory that takes parameters and makes one.

{EXIT_CODES}""",
)
def _check(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Catalogue names (brdfcheck list) or path/to/file.py:object. [default: the validated catalogue]",
            show_default=False,
        ),
    ] = None,
    over: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LO:HI", help="Let a parameter run over a range, or hold it: NAME=VALUE. Repeatable."),
    ] = None,
    cos_theta: Annotated[
        str | None, typer.Option(metavar="LO:HI", help="Cosines of incidence to look at. [default: 0:1]")
    ] = None,
    tolerance: _Tolerance = "1e-9",
    rtol: _Rtol = None,
    substring: Filter = "",
    json: Json = None,
    junitxml: Annotated[str | None, typer.Option("--junitxml", metavar="FILE", help="Write the results as JUnit XML.")] = None,
    effort: _Effort = Effort.normal,
    jobs: _Jobs = None,
    debug: Debug = False,
) -> Task:
    """The gate: do these BRDFs conserve energy?

    Finds the largest directional albedo over all parameters and angles, with an error bar, and says what the answer rests on:
    a theorem, or a search and the width of what it could have missed. UNDECIDED means that the error bar contains 1, or that
    the search did not settle. Also checks reciprocity, sign and finiteness.
    """

    def work() -> int:
        settings = _settings(
            tolerance,
            rtol,
            jobs,
            substring,
            json,
            junit=junitxml,
            names=tuple(names or ()),
            over=parse_over(over or ()),
            cos_theta=parse_cosines(cos_theta),
            effort=effort.value,
        )
        return _run_check(settings, debug)

    return Task(work, debug)


@app.command(
    "audit",
    epilog="""\b
Examples:
  brdfcheck audit
  brdfcheck audit -k cook-torrance
  brdfcheck audit --json audit.json

Exits with 0 whatever the verdicts are: it reports on the literature.""",
)
def _audit(
    substring: Filter = "",
    json: Json = None,
    tolerance: _Tolerance = "1e-9",
    rtol: _Rtol = None,
    effort: _Effort = Effort.normal,
    jobs: _Jobs = None,
    debug: Debug = False,
) -> Task:
    """What the literature claims about its BRDFs, and what is measured."""
    return Task(lambda: _run_audit(_settings(tolerance, rtol, jobs, substring, json, effort=effort.value), debug), debug)


# --- from words to settings ---


def _settings(tolerance: str, rtol: str | None, jobs: str | None, substring: str, json: str | None, **others: Any) -> _Settings:
    allowed = parse_number(tolerance, "--tolerance")
    if not 0 <= allowed < 1:
        raise UsageError(f"--tolerance: must be at least 0 and below 1; got {tolerance}")
    accuracy = None if rtol is None else parse_number(rtol, "--rtol")
    if accuracy is not None and not 0 < accuracy < 1:
        raise UsageError(f"--rtol: must be above 0 and below 1; got {rtol}")
    workers = min(4, len(available_cores())) if jobs is None else parse_number(jobs, "--jobs")
    if workers < 1 or workers != int(workers):
        raise UsageError(f"--jobs: must be a whole number, at least 1; got {jobs}")
    settings = _Settings(allowed, accuracy, int(workers), substring, json, **others)
    if settings.junit == "-":
        raise UsageError("--junitxml: needs a file name; only --json can write to stdout")
    refuse_outputs({"--json": settings.json, "--junitxml": settings.junit})
    return settings


# --- the work ---


def _run_check(settings: _Settings, debug: bool) -> int:
    began = time.perf_counter()
    start()
    from brdfcheck.brdf import catalog
    from brdfcheck.brdf.subject import resolve
    from brdfcheck.output import records
    from brdfcheck.output import text as console

    output = Output(settings.json)
    names = settings.names or [entry.name for entry in catalog.entries() if entry.validated]
    names = filtered(names, settings.filter)
    with contextlib.redirect_stdout(sys.stderr):
        targets = resolve(names, settings.over, settings.cos_theta)
        start()  # a user's file may have changed the precision
        if not output.is_terminal:
            output.line(console.tolerance_line(settings.tolerance))
        width = max(len(target.family.name) for target in targets)
        reports = _evaluate(targets, settings, output, debug, lambda report: console.plain_line(report, width))
    seconds = time.perf_counter() - began
    counts = records.count(reports)
    code = ExitCode.FAILED if counts["failed"] else ExitCode.PASSED
    if output.is_terminal:
        console.report_table(output.console, reports)
        output.line()
        console.remarks(output.console, reports)
    else:
        for line in console.remark_lines(reports):
            output.line(line)
    output.line(console.summary_line(counts, seconds, settings.tolerance))
    if os.environ.get("GITHUB_ACTIONS"):
        for target, report in zip(targets, reports, strict=True):
            if not report.passed:
                title = f"brdfcheck: {report.name}"
                place = {"file": target.file, "line": target.line}
                output.line(records.github_error(title, console.message(report), **place))
    if settings.junit:
        messages = [console.message(report) for report in reports]
        classes = ["brdfcheck.user" if target.file else "brdfcheck.catalog" for target in targets]
        text = records.to_junit(reports, messages, seconds=seconds, classnames=classes)
        save(settings.junit, text, "--junitxml")
    if settings.json:
        results = [
            {**records.to_json_object(report), **_origin(target)} for target, report in zip(targets, reports, strict=True)
        ]
        summary = {**counts, "seconds": seconds, "exit_code": int(code)}
        _write_json("check", results, settings, summary, output)
    return code


def _run_audit(settings: _Settings, debug: bool) -> int:
    began = time.perf_counter()
    start()
    from brdfcheck.brdf import catalog
    from brdfcheck.brdf.subject import Target
    from brdfcheck.output import records
    from brdfcheck.output import text as console

    output = Output(settings.json)
    published = {entry.name: entry for entry in catalog.entries() if not entry.validated}
    entries = [published[name] for name in filtered(tuple(published), settings.filter)]
    if not output.is_terminal:
        output.line(console.tolerance_line(settings.tolerance))
    width = max(len(entry.name) for entry in entries)
    claims = {entry.name: entry.claim for entry in entries}

    def line(report: Report) -> str:
        return console.audit_line(report, claims[report.name], width)

    reports = _evaluate([Target(entry.family) for entry in entries], settings, output, debug, line)
    if output.is_terminal:
        console.report_table(output.console, reports, [entry.claim for entry in entries])
        output.line()
        console.remarks(output.console, reports)
    else:
        for text in console.remark_lines(reports):
            output.line(text)
    seconds = time.perf_counter() - began
    counts = records.count(reports)
    output.line(f"published claims: {console.summary_line(counts, seconds, settings.tolerance)}")
    if settings.json:
        results = [
            {**records.to_json_object(report), "claim": entry.claim, "formula": entry.formula, "source": entry.source}
            for report, entry in zip(reports, entries, strict=True)
        ]
        _write_json("audit", results, settings, {**counts, "seconds": seconds, "exit_code": 0}, output)
    return ExitCode.PASSED


def _evaluate(
    targets: Sequence[Target], settings: _Settings, output: Output, debug: bool, line: Callable[[Report], str]
) -> list[Report]:
    """The reports in the order of the targets, a few at a time; plain lines are written as soon as their turn comes."""
    from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

    pool = ThreadPoolExecutor(settings.jobs, thread_name_prefix="brdfcheck")
    try:
        # The dear ones, in two dimensions, stand last in the catalogue: begun first, they leave no worker idle.
        step = -1 if all(target.file is None for target in targets) else 1
        waiting, written = set[Any](), 0
        with output.progress(len(targets), "checking", every=10) as advance:
            futures = [pool.submit(_report, target, settings, debug, advance.say) for target in targets[::step]][::step]
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


def _report(target: Target, settings: _Settings, debug: bool, say: Callable[[str], None]) -> Report:
    """`check`; for a user's BRDF, whatever it raises becomes a finding. `say`: what to call with how far it is."""
    from brdfcheck.verdict.check import check, unusable

    def watch(points: int, best: float) -> None:
        so_far = f", largest albedo so far {best:.6g}" if math.isfinite(best) else ""
        say(f"{target.family.name}: {points} points{so_far}")

    began = time.perf_counter()
    options: Any = {"tolerance": settings.tolerance, "effort": settings.effort}
    try:
        return check(target, rtol=settings.rtol, watch=watch, **options)
    except (Exception, SystemExit) as error:
        if target.file is None:
            raise
        if debug:
            traceback.print_exc()
        text = f"cannot be evaluated: {type(error).__name__}: {one_line(error)}"
        return unusable(target.family, text, seconds=time.perf_counter() - began, **options)


def _origin(target: Target) -> dict[str, Any]:
    """Where a checked BRDF comes from, for the record."""
    if target.file is not None:
        return {"origin": "user", "file": target.file, "line": target.line}
    from brdfcheck.brdf import catalog

    entry = catalog.entry(target.family.name)
    return {"origin": "catalog", "formula": entry.formula, "source": entry.source}


def _write_json(
    command: str, results: list[dict[str, Any]], settings: _Settings, summary: Mapping[str, Any], output: Output
) -> None:
    from brdfcheck.output import records

    shown = {
        "names": list(settings.names),
        "filter": settings.filter or None,
        "over": {name: list(bounds) for name, bounds in settings.over.items()},
        "cos_theta": None if settings.cos_theta is None else list(settings.cos_theta),
        "tolerance": settings.tolerance,
        "rtol": settings.rtol,
        "effort": settings.effort,
        "jobs": settings.jobs,
        "precision": "float64",
    }
    text = records.to_json(records.document(command, results, settings=shown, summary=summary))
    assert settings.json is not None
    if settings.json == "-":
        output.stdout(text)
    else:
        save(settings.json, text, "--json")
