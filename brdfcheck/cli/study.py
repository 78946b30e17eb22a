"""``brdfcheck study``: questions answered by a run, a figure and a page of numbers."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from brdfcheck.cli.app import ExitCode, NothingToCheck, command, start
from brdfcheck.cli.output import Output, refused
from brdfcheck.messages import UsageError, did_you_mean, one_line

if TYPE_CHECKING:
    from brdfcheck.studies import Study

Size = Literal["small", "full"]


@command(
    "study",
    epilog="""\b
Examples:
  brdfcheck study list
  brdfcheck study raw_albedo
  brdfcheck study all --size small --out quick
  brdfcheck study shader_corpus --given my_shaders --out mine

Writes FOLDER/NAME/ (record.json, figure.png, figure.svg, summary.md) and the gallery
FOLDER/README.md. At full size most studies take less than two minutes on two cores, the longest
three, and all of them together about 15: each runs in a process of its own, several side by
side unless they measure times.""",
)
def _study(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="list|all|NAME", help="'list' shows the studies; 'all' or names run them.", show_default=False),
    ] = None,
    size: Annotated[Size, typer.Option(help="How much to compute: small takes a few seconds.")] = "full",
    out: Annotated[str, typer.Option("--out", metavar="FOLDER", help="Where the reports go.")] = "reports",
    given: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH", help="A file or folder of yours, for studies that take some; may be repeated.", show_default=False
        ),
    ] = None,
) -> int:
    """Run a study: a question, its figure and its numbers."""
    names = list(dict.fromkeys(names or ()))
    if not names:
        raise UsageError("say which study: a name, all, or list (brdfcheck study list)")
    if len(names) > 1 and {"list", "all"} & set(names):
        raise UsageError("give 'list', 'all', or study names, not a mixture")
    from brdfcheck import studies

    known = studies.find()
    output = Output()
    if not known:
        raise NothingToCheck("this installation has no studies; they are in the repository's folder studies/")
    if names == ["list"]:
        width = max(map(len, known))
        for study in known.values():
            output.line(f"{study.name:<{width}}  {study.question}")
        return ExitCode.PASSED
    chosen = list(known.values()) if names == ["all"] else [_named(name, known) for name in names]
    if given and (len(chosen) > 1 or not chosen[0].given):
        takers = "; ".join(f"{study.name} ({study.given})" for study in known.values() if study.given)
        raise UsageError(f"--given: is for one of the studies {takers}")
    if missing := [path for path in given or () if not Path(path.partition("#")[0]).exists()]:
        raise UsageError(f"--given: there is no {one_line(missing[0])!r}")
    reports, failed = _folder(out), 0
    if len(chosen) == 1:
        began = time.perf_counter()
        start()
        (study,) = chosen
        record = studies.record_of(study, size, given or ())
        with refused("--out", str(reports)):
            place = studies.write_report(study, record, reports)
        _wrote(study.name, time.perf_counter() - began, place, output)
    else:
        failed = _run_several(chosen, size, reports, output)
    with refused("--out", str(reports)):
        output.line(f"wrote {studies.write_gallery(reports)}")
    return ExitCode.FAILED if failed else ExitCode.PASSED


def _run_several(chosen: list[Study], size: str, reports: Path, output: Output) -> int:
    """Run these, each in a process of its own. Returns how many failed."""
    from brdfcheck import studies

    began, failed = time.perf_counter(), 0
    # What is left when this is interrupted, or told to end, ends with it.
    with _ended_is_interrupted(), contextlib.closing(studies.run_all(chosen, size, reports)) as ends:
        for end in ends:
            if end.code:
                failed += 1
                output.line(f"{end.name}  failed: {one_line(end.last_words)}")
                logging.getLogger("brdfcheck").debug("%s", end.output)
            else:
                _wrote(end.name, end.seconds, reports / end.name, output)
    minutes = (time.perf_counter() - began) / 60
    output.line(f"{len(chosen) - failed} of {len(chosen)} studies in {minutes:.1f} minutes")
    return failed


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


def _named(name: str, known: dict[str, Study]) -> Study:
    if name in known:
        return known[name]
    hint = did_you_mean(name.replace("-", "_"), known, f"the studies are {', '.join(known)}", cutoff=0.5)
    raise UsageError(f"unknown study {one_line(name)!r}; {hint}")


def _folder(out: str) -> Path:
    """The folder of reports. UsageError where it cannot be made or written to."""
    place = reports = Path(out)
    if not out.strip() or "\0" in out:
        raise UsageError(f"--out: must be the name of a folder; got {one_line(out)!r}")
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise UsageError(f"--out: {one_line(place)} is not a folder")
    if not os.access(place, os.W_OK):
        raise UsageError(f"--out: cannot write to {one_line(place)!r}: the folder is not writable")
    return reports
