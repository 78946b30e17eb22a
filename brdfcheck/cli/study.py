"""``brdfcheck study``: questions answered by a run, a figure and a page of numbers."""

from __future__ import annotations

import contextlib
import difflib
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from brdfcheck.cli.app import Debug, ExitCode, NothingToCheck, Task, app, start
from brdfcheck.cli.output import Output
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.studies import Study

_SIZES = ("small", "full")


@app.command(
    "study",
    epilog="""\b
Examples:
  brdfcheck study list
  brdfcheck study raw_albedo
  brdfcheck study all --size small --out quick

Writes FOLDER/NAME/ (record.json, figure.png, figure.svg, summary.md) and the gallery
FOLDER/README.md. The full sizes take less than two minutes each on two cores, all of them
less than a quarter of an hour: each is a process of its own, and those that time nothing on
all cores run side by side.""",
)
def _study(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="list|all|NAME...", help="Which studies to run.", show_default=False)
    ] = None,
    size: Annotated[
        str, typer.Option(metavar="small|full", help="How much to compute: small is a matter of seconds.")
    ] = "full",
    out: Annotated[str, typer.Option("--out", metavar="FOLDER", help="Where the reports go.")] = "reports",
    debug: Debug = False,
) -> Task:
    """Run a study: a question, its figure and its numbers."""
    return Task(lambda: _run_study(tuple(names or ()), size, out, debug), debug)


def _run_study(names: Sequence[str], size: str, out: str, debug: bool) -> int:
    if size not in _SIZES:
        raise UsageError(f"--size: must be small or full; got {one_line(size)!r}")
    if not names:
        raise UsageError("say which study: a name, all, or list (brdfcheck study list)")
    if len(names) > 1 and {"list", "all"} & set(names):
        raise UsageError("list and all stand alone: give either one of them or names of studies")
    from brdfcheck import studies

    known = studies.find()
    output = Output(None)
    if names == ("list",):
        return _list(known, output)
    if not known:
        raise NothingToCheck("this installation has no studies; they are in the repository's folder studies/")
    chosen = list(known.values()) if names == ("all",) else [_named(name, known) for name in dict.fromkeys(names)]
    reports = Path(out)
    _refuse_folder(reports, out)
    if len(chosen) > 1:
        return _run_several(chosen, size, reports, out, debug, output)
    start()
    (study,) = chosen
    began = time.perf_counter()
    try:
        with contextlib.redirect_stdout(sys.stderr):
            place = studies.write_report(study, studies.record_of(study, size), reports)
    except OSError as error:
        raise _unwritable(out, error) from None
    _wrote(study.name, time.perf_counter() - began, place, output)
    _write_gallery(reports, out, output)
    return ExitCode.PASSED


def _run_several(chosen: list[Study], size: str, reports: Path, out: str, debug: bool, output: Output) -> int:
    from brdfcheck import studies

    began, failed = time.perf_counter(), 0
    # What is left when this is interrupted, or told to end, ends with it.
    with _ended_is_interrupted(), contextlib.closing(studies.run_all(chosen, size, reports)) as ends:
        for end in ends:
            if end.code:
                failed += 1
                output.line(f"{end.name}  failed: {one_line(end.last_words)}")
                if debug:
                    with contextlib.suppress(OSError, ValueError):
                        sys.stderr.write(end.output)
            else:
                _wrote(end.name, end.seconds, reports / end.name, output)
    minutes = (time.perf_counter() - began) / 60
    output.line(f"{len(chosen) - failed} of {len(chosen)} studies in {minutes:.1f} minutes")
    _write_gallery(reports, out, output)
    return ExitCode.FAILED if failed else ExitCode.PASSED


@contextlib.contextmanager
def _ended_is_interrupted() -> Iterator[None]:
    """SIGTERM as KeyboardInterrupt, in the thread that may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _wrote(name: str, seconds: float, place: Path, output: Output) -> None:
    from brdfcheck import studies

    output.line(f"{name}  {seconds:.1f} s  wrote {place}: {', '.join(studies.FILES)}")


def _write_gallery(reports: Path, out: str, output: Output) -> None:
    from brdfcheck import studies

    try:
        output.line(f"wrote {studies.write_gallery(reports)}")
    except OSError as error:
        raise _unwritable(out, error) from None


def _unwritable(out: str, error: OSError) -> UsageError:
    return UsageError(f"--out: cannot write to {out!r}: {error.strerror or one_line(error)}")


def _list(known: dict[str, Study], output: Output) -> int:
    if not known:
        raise NothingToCheck("this installation has no studies; they are in the repository's folder studies/")
    width = max(map(len, known))
    for study in known.values():
        output.line(f"{study.name:<{width}}  {study.question}")
    return ExitCode.PASSED


def _named(name: str, known: dict[str, Study]) -> Study:
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name.replace("-", "_"), known, n=2, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"the studies are {', '.join(known)}"
    raise UsageError(f"unknown study {one_line(name)!r}; {hint}")


def _refuse_folder(reports: Path, out: str) -> None:
    """UsageError where the folder of reports cannot be made or written to."""
    import os

    place = reports
    if not out.strip():
        raise UsageError("--out: the folder's name is empty")
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise UsageError(f"--out: {place} is not a folder")
    if not os.access(place, os.W_OK):
        raise UsageError(f"--out: cannot write to {str(place)!r}: the folder is not writable")
