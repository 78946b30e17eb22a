"""``brdfcheck check`` and ``brdfcheck audit``: verdicts, on validated or your own BRDFs and on the literature."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli import project, words
from brdfcheck.cli.app import PLAIN, CosTheta, ExitCode, Filter, Json, Over, command, filtered, start
from brdfcheck.cli.output import Output
from brdfcheck.cli.reports import Badge, Files, Html, JUnit, Sarif
from brdfcheck.cores import available_cores
from brdfcheck.gate.cache import Verdicts
from brdfcheck.gate.requests import Case, Request, evaluated
from brdfcheck.gate.requests import cases as cases_of
from brdfcheck.messages import UsageError

if TYPE_CHECKING:
    from brdfcheck.gate.config import Gate, Known
    from brdfcheck.verdict import Report

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
    Literal["quick", "normal", "thorough"] | None,  # `EFFORTS` of the search, which is imported later
    typer.Option(
        help="How many points the search looks at: quick before a commit, thorough before a release. [default: normal]"
    ),
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
  brdfcheck check mine.py:* --over n=1,10,100 --quiet
  brdfcheck check mine.py:measured --cos-theta 0.02:1 --json -
  brdfcheck check disney.brdf --over metallic=1
  brdfcheck check shader.glsl:BRDF --over n=1:100 -D FAST=0 -I include
  brdfcheck check mitsuba:principled --over roughness=0.1:1
  brdfcheck check gold-paint.binary --cos-theta 0.1:1

A BRDF of your own is a function f(wi, wo) of unit vectors (..., 3), or of one pair (3,),
with the normal along +z, in 1/sr; or one of angles (theta_i, phi_i, theta_o, phi_o) or
(theta_h, theta_d, phi_d); or a class or a factory that takes parameters and makes one; or a
shader file (.brdf, .glsl, .frag, .hlsl, .slang), whose parameters run over the ranges
that the file gives, or over yours; or a measured one (MERL .binary, RGL .bsdf).

\b
Exit codes:
  0  all conserve energy            3  internal error
  1  some violate the law, are      4  usage error, or some could not
     undecided, or have findings       be read, whatever the others do
  2  interrupted                    5  nothing to check""",
)
def check_command(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Catalogue names (brdfcheck list), path/to/file.py:object, shader files FILE.brdf, FILE.glsl:FUNCTION,"
            " measured files FILE.binary, FILE.bsdf, or plug-ins of Mitsuba 3, mitsuba:NAME, mitsuba:FILE.xml#ID. FILE.py:* is"
            " all that a file offers. [default: those of the project, otherwise the validated catalogue]",
            show_default=False,
        ),
    ] = None,
    over: Over = None,
    cos_theta: CosTheta = None,
    how: Reading = PLAIN,
    tolerance: Tolerance = None,
    rtol: Rtol = None,
    substring: Filter = "",
    json: Json = None,
    junitxml: JUnit = None,
    sarif: Sarif = None,
    badge: Badge = None,
    html: Html = None,
    effort: Effort = None,
    jobs: Jobs = None,
    config: project.Config = None,
    no_config: project.NoConfig = False,
    update_baseline: project.UpdateBaseline = False,
    no_cache: project.NoCache = False,
    quiet: project.Quiet = False,
    watch: project.Watch = False,
) -> int:
    """The gate: do these BRDFs conserve energy?

    Finds the largest directional albedo over all parameters and angles, with an error bar, and says what the answer rests on:
    a proof, a theorem, or a search and the width of what it could have missed. UNDECIDED means that the error bar contains 1,
    or that the search did not settle. Also checks reciprocity, sign and finiteness. Without names it checks
    what the project's pyproject.toml or brdfcheck.toml lists (brdfcheck init writes one), or the validated catalogue.
    """
    files = Files(json, junitxml, sarif, badge, html)
    ranges = words.together(over, lists=True)
    options = {"tolerance": tolerance, "rtol": rtol, "effort": effort}
    gate = None if names else project.gate(config, no_config)
    if gate is not None:
        project.refuse_options(
            {"--over": ranges, "--cos-theta": cos_theta, "-D, -I, --args or --returns": not how.is_plain}, gate
        )
        requests = gate.requests(**options)
    else:
        project.refuse_options_of_projects(names, config, update_baseline)
        own = {**options, "effort": effort or "normal"}
        wanted = tuple(dict.fromkeys(names or project.validated()))
        requests = Request(wanted, ranges, cos_theta, how, **own).apart()
    if watch:
        return project.watched(project.filtered(requests, substring), gate, substring)
    modules: dict[str, Any] = {}
    requests = project.filtered(requests, substring, modules)
    settings = _settings(
        substring,
        tolerance,
        rtol,
        effort,
        jobs,
        names=names or [],
        over=ranges,
        cos_theta=cos_theta,
        config=None if gate is None else gate.path.name,
        **how.record,
    )
    output = Output(json, quiet=quiet)
    verdicts = Verdicts(not no_cache and (gate is None or gate.document.cache))
    known = [verdicts.found(request) for request in requests]
    if None in known:  # JAX takes a second, which verdicts that are known do not need
        start()
    cases = [
        case
        for request, found in zip(requests, known, strict=True)
        for case in (cases_of(request, modules, others_go_on=True) if found is None else found)
    ]
    if None in known:
        start()  # a user's file may have changed the precision
    changed = gate if update_baseline else None
    return _run(cases, settings, output, files, quiet=quiet, verdicts=verdicts, gate=changed)


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
    tolerance: Tolerance = None,
    rtol: Rtol = None,
    effort: Effort = None,
    jobs: Jobs = None,
) -> int:
    """What the literature claims about its BRDFs, and what is measured."""
    files = Files(json=json, html=html)
    output = Output(json)
    start()
    from brdfcheck.brdf import catalog
    from brdfcheck.brdf.subject import Target

    names = filtered([entry.name for entry in catalog.entries() if not entry.validated], substring)
    options: Any = {"tolerance": tolerance, "rtol": rtol, "effort": effort or "normal"}
    cases = [Case(Request((name,), **options), name, None, None, name, Target(catalog.entry(name).family)) for name in names]
    settings = _settings(substring, tolerance, rtol, effort, jobs)
    return _run(cases, settings, output, files, audit=True)


def _settings(
    substring: str, tolerance: float | None, rtol: float | None, effort: str | None, jobs: int | None, **own: Any
) -> dict[str, Any]:
    """The options as they are recorded; `own`: those of `check` alone."""
    return {
        "names": [],
        "filter": substring or None,
        "over": {},
        "cos_theta": None,
        "tolerance": 1e-9 if tolerance is None else tolerance,
        "rtol": rtol,
        "effort": effort or "normal",
        "jobs": jobs or min(4, len(available_cores())),
        "precision": "float64",
        **own,
    }


def _run(
    cases: Sequence[Case],
    settings: dict[str, Any],
    output: Output,
    files: Files,
    *,
    audit: bool = False,
    quiet: bool = False,
    verdicts: Verdicts | None = None,
    gate: Gate | None = None,
) -> int:
    """Evaluate, print and write. An audit says what was claimed besides, and never fails.

    `verdicts`: the cache; `gate`: where the known violations are brought up to date. Raises UsageError where there is one BRDF
    only and it cannot be read, once the files are written that say so.
    """
    from brdfcheck.gate.baseline import judged
    from brdfcheck.output import records
    from brdfcheck.output import text as console
    from brdfcheck.verdict.words import message

    claims: dict[str, str] = {}
    if audit:
        from brdfcheck.brdf import catalog

        claims = {case.name: catalog.entry(case.name).claim for case in cases}
    width = max(len(case.name) for case in cases)
    tolerances = {case.tolerance for case in cases}
    settings |= {"tolerance": min(tolerances), "own_tolerances": len(tolerances) > 1}  # each report says its own

    def line(report: Report, expect: Known | None) -> None:
        (report,) = judged([report], expect, part=True)
        if not (output.is_terminal or (quiet and report.passed) or lost):
            output.line(console.plain_line(report, width, claims.get(report.name)))

    lost = len(cases) == 1 and cases[0].target is not None and cases[0].target.unread
    if not (output.is_terminal or quiet or lost):
        output.line(console.tolerance_line(settings["tolerance"]))
    expected = [case.request.expect for case in cases]
    # What is accepted from now on is known only once all are evaluated.
    told_at_once = (lambda index, report: line(report, expected[index])) if gate is None else (lambda index, report: None)
    found = _evaluate(cases, settings["jobs"], output, verdicts, told_at_once)
    if gate is not None and not lost:
        expected = project.update(gate, cases, found, output)
        for report, expect in zip(found, expected, strict=True):
            line(report, expect)
    reports: list[Report] = []
    for _, own in itertools.groupby(range(len(cases)), lambda index: id(cases[index].request)):
        indices = list(own)
        reports += judged([found[index] for index in indices], expected[indices[0]], part=cases[indices[0]].request.part)
    told = [report for report in reports if not lost and (not quiet or not report.passed or report.stale)]
    if output.is_terminal and told:
        console.report_table(output.console, told, list(claims.values()) or None)
        output.line()
        console.remarks(output.console, told)
    elif not output.is_terminal:
        for text in console.remark_lines(told):
            output.line(text)
    seconds, counts = output.seconds, records.count(reports)
    code = ExitCode.FAILED if counts["failed"] and not audit else ExitCode.PASSED
    code = ExitCode.USAGE_ERROR if counts["unread"] else code
    if told:
        summary = console.summary_line(counts, seconds, settings["tolerance"])
        known = sum(case.report is not None for case in cases)
        cached = f"; {'all' if known == len(cases) else f'{known} of {len(cases)}'} from the cache" if known else ""
        output.line(f"{'published claims: ' if audit else ''}{summary}{cached}")
    if os.environ.get("GITHUB_ACTIONS") and not audit:
        for case, report in zip(cases, reports, strict=True):
            if not report.passed or report.stale:
                file, line_ = case.request.place if report.passed else case.place
                kind, text = ("warning", report.notes[-1]) if report.passed else ("error", message(report))
                output.line(records.github_error(f"brdfcheck: {report.name}", text, file=file, line=line_, kind=kind))
    files.write(output, cases, reports, jobs=settings["jobs"], seconds=seconds, exit_code=code, claims=claims or None)
    pairs = list(zip(cases, reports, strict=True))
    summary = {**counts, "seconds": seconds, "exit_code": int(code)}
    output.write_json(
        lambda: records.document(
            "audit" if audit else "check",
            [records.to_json_object(report) | _origin(case, claims) for case, report in pairs],
            settings=settings,
            summary=summary,
        )
    )
    if lost:
        raise UsageError(reports[0].findings[0])
    return code


def _evaluate(
    cases: Sequence[Case], jobs: int, output: Output, verdicts: Verdicts | None, line: Callable[[int, Report], None]
) -> list[Report]:
    """The reports in the order of the cases, a few at a time; `line` is called with the place of each and with it in turn."""
    from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

    pool = ThreadPoolExecutor(jobs, thread_name_prefix="brdfcheck")
    try:
        # The dear ones, in two dimensions, stand last in the catalogue: begun first, they leave no worker idle.
        step = -1 if all(case.file is None for case in cases) else 1
        waiting, written = set[Any](), 0
        with output.progress("checking", len(cases), every=10) as advance:
            futures = [pool.submit(evaluated, case, advance.say) for case in cases[::step]][::step]
            waiting.update(futures)
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()  # an internal error ends the command at once
                    advance()
                    request = cases[futures.index(future)].request
                    own = [(case, one) for case, one in zip(cases, futures, strict=True) if case.request is request]
                    # Once all BRDFs of a request are evaluated, their verdicts go into the cache.
                    if verdicts is not None and all(one.done() and case.report is None for case, one in own):
                        verdicts.keep(request, [case for case, _ in own], [one.result() for _, one in own])
                while written < len(futures) and futures[written].done():
                    line(written, futures[written].result())
                    written += 1
        return [future.result() for future in futures]
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _origin(case: Case, claims: Mapping[str, str]) -> dict[str, Any]:
    """Where a checked BRDF comes from, for the record."""
    cached = {"cached": case.report is not None}
    if case.file is not None:
        return {"origin": "user", "file": case.file, "line": case.line, **cached}
    if case.entry is None:  # a class of this package, or what another program knows
        return {"origin": "name", **cached}
    from brdfcheck.brdf import catalog

    entry = catalog.entry(case.entry)
    claim = {"claim": entry.claim} if claims else {}
    return {"origin": "catalog", "formula": entry.formula, "source": entry.source, **claim, **cached}
