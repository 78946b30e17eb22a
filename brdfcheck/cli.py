"""The command line: ``brdfcheck check | audit | list``.

typer reads the words; the work runs outside of it, so that every way a command can end is decided here, by `run`. What
is expensive to import (JAX, the catalogue) is imported once the words are known to be right.
"""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import math
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TextIO

import typer

import brdfcheck
from brdfcheck.messages import UsageError, one_line
from brdfcheck.user_brdf import parse_cosines, parse_number, parse_over

if TYPE_CHECKING:
    from brdfcheck.user_brdf import Target
    from brdfcheck.verdict import Report


class ExitCode(IntEnum):
    """How a command ended; the same numbers as pytest's."""

    PASSED = 0
    FAILED = 1
    INTERRUPTED = 2
    INTERNAL_ERROR = 3
    USAGE_ERROR = 4
    NOTHING_TO_CHECK = 5


class _NothingToCheck(Exception):
    """No BRDF is left to check; the message says why."""


@dataclass(frozen=True)
class _Task:
    """What the words ask for: run once they have been read."""

    work: Callable[[], int]
    debug: bool


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


app = typer.Typer(
    name="brdfcheck",
    help="Does this BRDF conserve energy?",
    epilog="""\b
Examples:
  brdfcheck check                        the gate: every validated BRDF
  brdfcheck check phong ggx              two of them
  brdfcheck check mine.py:glossy         a BRDF of your own
  brdfcheck audit                        what the literature claims, measured
  brdfcheck list                         names, formulas and sources

brdfcheck COMMAND --help shows the options of a command.""",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

_EXIT_CODES = """\b
Exit codes:
  0  all conserve energy            3  internal error
  1  some violate the law, are      4  usage error
     undecided, or have findings    5  nothing to check
  2  interrupted"""


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"brdfcheck {brdfcheck.__version__}")
        raise typer.Exit()


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", is_eager=True, callback=_show_version)
    ] = False,
) -> None:
    pass


_Filter = Annotated[str, typer.Option("-k", "--filter", metavar="SUBSTRING", help="Only the BRDFs whose names contain this.")]
_Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help='Write the results as JSON; "-" is stdout.')]
_Tolerance = Annotated[str, typer.Option(metavar="NUMBER", help="How far above 1 an albedo may lie and still conserve.")]
_Rtol = Annotated[str | None, typer.Option(metavar="NUMBER", help="Relative accuracy of the albedos. [default: the best]")]
_Jobs = Annotated[
    str | None,
    typer.Option("-j", "--jobs", metavar="N", help="BRDFs evaluated at a time. [default: 4, or the number of CPUs]"),
]
_Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an internal error.")]


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

{_EXIT_CODES}""",
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
    substring: _Filter = "",
    json: _Json = None,
    junitxml: Annotated[str | None, typer.Option("--junitxml", metavar="FILE", help="Write the results as JUnit XML.")] = None,
    jobs: _Jobs = None,
    debug: _Debug = False,
) -> _Task:
    """The gate: do these BRDFs conserve energy?

    Finds the largest directional albedo over all parameters and angles, with an error bar. CONSERVES and VIOLATES are
    certain within it; UNDECIDED means that the error bar contains 1. Also looks for negative values, NaN, and a lack of
    reciprocity.
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
        )
        return _run_check(settings, debug)

    return _Task(work, debug)


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
    substring: _Filter = "",
    json: _Json = None,
    tolerance: _Tolerance = "1e-9",
    rtol: _Rtol = None,
    jobs: _Jobs = None,
    debug: _Debug = False,
) -> _Task:
    """What the literature claims about its BRDFs, and what is measured."""
    return _Task(lambda: _run_audit(_settings(tolerance, rtol, jobs, substring, json), debug), debug)


@app.command(
    "list",
    epilog="""\b
Examples:
  brdfcheck list
  brdfcheck list -k half
  brdfcheck list | grep Blinn""",
)
def _list(substring: _Filter = "", json: _Json = None, debug: _Debug = False) -> _Task:
    """The catalogue: names, ranges, formulas, sources."""
    return _Task(lambda: _run_list(substring, json), debug)


# --- from words to settings ---


def _settings(tolerance: str, rtol: str | None, jobs: str | None, substring: str, json: str | None, **others: Any) -> _Settings:
    allowed = parse_number(tolerance, "--tolerance")
    if not 0 <= allowed < 1:
        raise UsageError(f"--tolerance: must be at least 0 and below 1; got {tolerance}")
    accuracy = None if rtol is None else parse_number(rtol, "--rtol")
    if accuracy is not None and not 0 < accuracy < 1:
        raise UsageError(f"--rtol: must be above 0 and below 1; got {rtol}")
    workers = _default_jobs() if jobs is None else parse_number(jobs, "--jobs")
    if workers < 1 or workers != int(workers):
        raise UsageError(f"--jobs: must be a whole number, at least 1; got {jobs}")
    settings = _Settings(allowed, accuracy, int(workers), substring, json, **others)
    _refuse_outputs(settings.json, settings.junit)
    return settings


def _default_jobs() -> int:
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(4, count)


def _refuse_outputs(json: str | None, junit: str | None) -> None:
    from brdfcheck.records import refuse_output

    if junit == "-":
        raise UsageError("--junitxml: needs a file name; only --json can write to stdout")
    for option, path in (("--json", json), ("--junitxml", junit)):
        trouble = None if path is None or path == "-" else refuse_output(path)
        if trouble:
            raise UsageError(f"{option}: cannot write {path!r}: {one_line(trouble)}")
    if json and junit and os.path.realpath(json) == os.path.realpath(junit):
        raise UsageError(f"--json and --junitxml name the same file: {json}")


# --- output ---


class _Output:
    """Where results go: a table for a person, plain lines for a file or a pipe, JSON alone on stdout for ``--json -``.

    While it is open, whatever a user's code prints goes to stderr.
    """

    def __init__(self, json: str | None):
        self._stdout = sys.stdout
        self.human: TextIO = sys.stderr if json == "-" else sys.stdout
        self.is_terminal = self.human.isatty()
        self._console: Any = None

    @property
    def console(self) -> Any:
        """The terminal, for tables."""
        if self._console is None:
            from rich.console import Console

            self._console = Console(file=self.human, markup=False, highlight=False, emoji=False, soft_wrap=False)
        return self._console

    def line(self, text: str = "") -> None:
        """One line for a person or for grep."""
        self._write(self.human, text + "\n")

    def stdout(self, text: str) -> None:
        """Text for stdout, whoever reads it."""
        self._write(self._stdout, text)

    @staticmethod
    def _write(stream: TextIO, text: str) -> None:
        try:
            with _quiet_when_unread(stream):
                stream.write(text)
                stream.flush()
        except OSError as error:
            raise UsageError(f"cannot write to {stream.name}: {error.strerror or error}") from None

    @contextlib.contextmanager
    def progress(self, count: int) -> Iterator[Callable[[], None]]:
        """A bar with the time left, on a terminal; gives what to call for each BRDF that is done."""
        stream = next((stream for stream in (sys.stderr, self._stdout) if stream.isatty()), None)
        if stream is None:
            yield lambda: None
            return
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeRemainingColumn,
        )

        bar: Progress = Progress(
            SpinnerColumn(),
            TextColumn("checking"),
            BarColumn(bar_width=32),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=Console(file=stream),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        with bar:
            task = bar.add_task("", total=count)
            yield lambda: bar.advance(task)


@contextlib.contextmanager
def _quiet_when_unread(stream: TextIO) -> Iterator[None]:
    """Where the reader has gone (``| head``), the work goes on and the output goes nowhere."""
    try:
        yield
    except BrokenPipeError:
        _discard(stream)


def _discard(stream: TextIO) -> None:
    """Let what is still to be written to a stream go nowhere, also what Python itself writes at its end."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


# --- the work ---


def _start() -> None:
    """Double precision and the compilation cache, before anything is computed."""
    from brdfcheck.precision import use_compilation_cache, use_x64

    use_x64()
    use_compilation_cache()
    # What is logged is also in the notes of a report.
    logging.getLogger("brdfcheck").addHandler(logging.NullHandler())


def _filtered(names: Sequence[str], substring: str) -> list[str]:
    kept = [name for name in names if substring.lower() in name.lower()]
    if not kept:
        raise _NothingToCheck(f"nothing to check: no name contains {substring!r}; brdfcheck list shows all names")
    return kept


def _run_check(settings: _Settings, debug: bool) -> int:
    start = time.perf_counter()
    _start()
    from brdfcheck import catalog, console, records
    from brdfcheck.user_brdf import resolve

    output = _Output(settings.json)
    names = settings.names or [entry.name for entry in catalog.entries() if entry.validated]
    names = _filtered(names, settings.filter)
    with contextlib.redirect_stdout(sys.stderr):
        targets = resolve(names, settings.over, settings.cos_theta)
        _start()  # a user's file may have changed the precision
        if not output.is_terminal:
            output.line(console.tolerance_line(settings.tolerance))
        width = max(len(target.family.name) for target in targets)
        reports = _evaluate(targets, settings, output, debug, lambda report: console.plain_line(report, width))
    seconds = time.perf_counter() - start
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
        _save(settings.junit, text, "--junitxml")
    if settings.json:
        results = [
            {**records.to_json_object(report), **_origin(target)} for target, report in zip(targets, reports, strict=True)
        ]
        summary = {**counts, "seconds": seconds, "exit_code": int(code)}
        _write_json("check", results, settings, summary, output)
    return code


def _run_audit(settings: _Settings, debug: bool) -> int:
    start = time.perf_counter()
    _start()
    from brdfcheck import catalog, console, records
    from brdfcheck.user_brdf import Target

    output = _Output(settings.json)
    published = {entry.name: entry for entry in catalog.entries() if not entry.validated}
    entries = [published[name] for name in _filtered(tuple(published), settings.filter)]
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
    seconds = time.perf_counter() - start
    counts = records.count(reports)
    output.line(f"published claims: {console.summary_line(counts, seconds, settings.tolerance)}")
    if settings.json:
        results = [
            {**records.to_json_object(report), "claim": entry.claim, "formula": entry.formula, "source": entry.source}
            for report, entry in zip(reports, entries, strict=True)
        ]
        _write_json("audit", results, settings, {**counts, "seconds": seconds, "exit_code": 0}, output)
    return ExitCode.PASSED


def _run_list(substring: str, json: str | None) -> int:
    from brdfcheck import records

    _refuse_outputs(json, None)
    from brdfcheck import catalog, console

    output = _Output(json)
    kept = set(_filtered(catalog.names(), substring))
    groups = [
        [entry for entry in catalog.entries() if entry.name in kept and entry.validated is validated]
        for validated in (True, False)
    ]
    if json:
        entries = [
            {
                "name": entry.name,
                "validated": entry.validated,
                "ranges": {name: list(bounds) for name, bounds in entry.family.ranges.items()},
                "cos_theta": list(entry.family.cos_theta),
                "formula": entry.formula,
                "source": entry.source,
                "claim": entry.claim or None,
            }
            for group in groups
            for entry in group
        ]
        text = records.to_json(
            {
                "schema": "brdfcheck-catalog",
                "schema_version": records.SCHEMA_VERSION,
                "brdfcheck": brdfcheck.__version__,
                "entries": entries,
            }
        )
        if json == "-":
            output.stdout(text)
            return ExitCode.PASSED
        _save(json, text, "--json")
    if not output.is_terminal:
        width = max(len(name) for name in kept)
        for entry in (*groups[0], *groups[1]):
            output.line(console.entry_line(entry, width))
        return ExitCode.PASSED
    titles = ("Validated: must conserve energy (brdfcheck check)", "Published claims (brdfcheck audit)")
    for title, group in zip(titles, groups, strict=True):
        if group:
            output.console.print(title, style="bold")
            output.line()
            console.entry_table(output.console, group)
            output.line()
    return ExitCode.PASSED


def _evaluate(
    targets: Sequence[Target], settings: _Settings, output: _Output, debug: bool, line: Callable[[Report], str]
) -> list[Report]:
    """The reports in the order of the targets, a few at a time; plain lines are written as soon as their turn comes."""
    from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

    pool = ThreadPoolExecutor(settings.jobs, thread_name_prefix="brdfcheck")
    try:
        # The dear ones, in two dimensions, stand last in the catalogue: begun first, they leave no worker idle.
        step = -1 if all(target.file is None for target in targets) else 1
        futures = [pool.submit(_report, target, settings, debug) for target in targets[::step]][::step]
        waiting, written = set(futures), 0
        with output.progress(len(futures)) as advance:
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


def _report(target: Target, settings: _Settings, debug: bool) -> Report:
    """`check_family`; for a user's BRDF, whatever it raises becomes a finding."""
    from brdfcheck.verdict import check_family

    family = target.family
    start = time.perf_counter()
    if target.finding is not None:
        report = _unusable(target, settings, target.finding, start)
    else:
        try:
            report = check_family(family, tolerance=settings.tolerance, rtol=settings.rtol)
        except (Exception, SystemExit) as error:
            if target.file is None:
                raise
            if debug:
                traceback.print_exc()
            text = f"cannot be evaluated: {type(error).__name__}: {one_line(error)}"
            report = _unusable(target, settings, text, start)
    if target.fixed:
        report = dataclasses.replace(
            report,
            parameters={**target.fixed, **report.parameters},
            ranges={**{name: (value, value) for name, value in target.fixed.items()}, **report.ranges},
        )
    return report


def _unusable(target: Target, settings: _Settings, finding: str, start: float) -> Report:
    from brdfcheck.verdict import Report, Verdict

    return Report(
        name=target.family.name,
        verdict=Verdict.UNDECIDED,
        albedo=math.nan,
        error=math.nan,
        parameters={},
        cos_theta=math.nan,
        azimuth=math.nan,
        tolerance=settings.tolerance,
        ranges=dict(target.family.ranges),
        above=None,
        side=None,
        engine="none",
        anisotropic=False,
        evaluations=0,
        seconds=time.perf_counter() - start,
        findings=(finding,),
    )


def _origin(target: Target) -> dict[str, Any]:
    """Where a checked BRDF comes from, for the record."""
    if target.file is not None:
        return {"origin": "user", "file": target.file, "line": target.line}
    from brdfcheck import catalog

    entry = catalog.entry(target.family.name)
    return {"origin": "catalog", "formula": entry.formula, "source": entry.source}


def _write_json(
    command: str, results: list[dict[str, Any]], settings: _Settings, summary: Mapping[str, Any], output: _Output
) -> None:
    from brdfcheck import records

    shown = {
        "names": list(settings.names),
        "filter": settings.filter or None,
        "over": {name: list(bounds) for name, bounds in settings.over.items()},
        "cos_theta": None if settings.cos_theta is None else list(settings.cos_theta),
        "tolerance": settings.tolerance,
        "rtol": settings.rtol,
        "jobs": settings.jobs,
        "precision": "float64",
    }
    text = records.to_json(records.document(command, results, settings=shown, summary=summary))
    assert settings.json is not None
    if settings.json == "-":
        output.stdout(text)
    else:
        _save(settings.json, text, "--json")


def _save(path: str, text: str, option: str) -> None:
    from brdfcheck.records import write_atomically

    try:
        write_atomically(path, text)
    except OSError as error:
        raise UsageError(f"{option}: cannot write {path!r}: {error.strerror or error}") from None


# --- the ends ---


def run(arguments: Sequence[str]) -> int:
    """The command with these arguments. Returns the exit code; raises nothing."""
    debug = os.environ.get("BRDFCHECK_DEBUG", "0") not in ("", "0")
    try:
        if not arguments:
            raise UsageError("no command given; the commands are check, audit and list (see brdfcheck --help)")
        try:
            command = typer.main.get_command(app)
            task = command.main(list(arguments), prog_name="brdfcheck", standalone_mode=False)
        except Exception as error:
            # What typer raises for words it does not understand; the classes moved between its releases.
            if not hasattr(error, "format_message"):
                raise
            return _usage_error(error)
        if not isinstance(task, _Task):  # --help and --version have said what they have to say
            return int(task or 0)
        debug = debug or task.debug
        return int(task.work())
    except UsageError as error:
        return _complain(str(error), ExitCode.USAGE_ERROR)
    except _NothingToCheck as error:
        return _complain(str(error), ExitCode.NOTHING_TO_CHECK)
    except KeyboardInterrupt:
        return _complain("interrupted", ExitCode.INTERRUPTED)
    except BrokenPipeError:
        return ExitCode.PASSED
    except SystemExit as error:  # rich and typer leave this way when the reader of their help has gone
        return error.code if isinstance(error.code, int) else ExitCode.INTERNAL_ERROR
    except Exception as error:
        if debug:
            traceback.print_exc()
        hint = "" if debug else " (--debug shows the traceback)"
        return _complain(f"internal error: {type(error).__name__}: {one_line(error)}{hint}", ExitCode.INTERNAL_ERROR)


def _usage_error(error: Any) -> int:
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "brdfcheck"
    text = one_line(error.format_message()).rstrip(".")
    return _complain(f"{text} (see {path} --help)", ExitCode.USAGE_ERROR)


def _complain(text: str, code: ExitCode) -> int:
    with contextlib.suppress(OSError, ValueError):
        print(f"brdfcheck: {text}", file=sys.stderr, flush=True)
    return code


def main() -> int:
    """`run` on the arguments of the process, with output that survives odd terminals and readers that have gone."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a name that the terminal's encoding lacks is no reason to fail
            stream.reconfigure(errors="backslashreplace")  # pyright: ignore[reportAttributeAccessIssue]
    code = run(sys.argv[1:])
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # the reader has gone, or the disk is full, which has been said
            _discard(stream)
    return code


def script() -> NoReturn:
    """The console script: `main`, and out at once.

    Everything is written and flushed by then. An orderly end of the interpreter would wait for evaluations that still
    run after an interruption, and takes JAX 0.8 s to take its compiler down.
    """
    os._exit(main())
