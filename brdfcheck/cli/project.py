"""What of ``brdfcheck check`` concerns a project: its subjects, known violations, and checking again when a file is saved."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdfcheck.cli.app import NothingToCheck, start
from brdfcheck.cli.output import Output, refused
from brdfcheck.gate.requests import Case, Request
from brdfcheck.gate.sources import watched as files_of
from brdfcheck.interruption import Cleanup
from brdfcheck.messages import UsageError

if TYPE_CHECKING:
    from brdfcheck.gate.config import Gate, Known
    from brdfcheck.verdict import Report

Config = Annotated[
    str | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help="Check the subjects of this pyproject.toml or brdfcheck.toml. [default: the nearest one up to the root of the"
        " project]",
    ),
]
NoConfig = Annotated[bool, typer.Option("--no-config", help="Look for no such file: without names check the catalogue.")]
UpdateBaseline = Annotated[
    bool, typer.Option("--update-baseline", help="Write what the subjects violate now into their file, as known.")
]
NoCache = Annotated[bool, typer.Option("--no-cache", help="Check again what has not changed, and keep no verdict.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Say only what does not pass.")]
Watch = Annotated[bool, typer.Option("--watch", help="Check again whenever a file is saved, until Ctrl-C.")]

# Milliseconds after which files are looked at whatever their folders said.
_EVERY = 1000


def gate(config: str | None, no_config: bool) -> Gate | None:
    """The subjects of the project: of the file that is named, or of the nearest one. UsageError where it is wrong."""
    from brdfcheck.gate.config import SHARED, find, read

    if config is not None and no_config:
        raise UsageError("--config and --no-config cannot go together")
    if no_config:
        return None
    if config is None:
        return find()
    found = read(config)
    if found is None:
        raise UsageError(f"--config: {config} has no [tool.brdfcheck]; brdfcheck init adds one to {SHARED}")
    return found


def refuse_options(given: Mapping[str, Any], gate: Gate) -> None:
    """UsageError for options that are for BRDFs named on the command line."""
    wrong = next((option for option, value in given.items() if value), None)
    if wrong is not None:
        raise UsageError(
            f"{wrong}: without names the subjects of {gate.path.name} are checked, which have ranges and options of their own"
            " (--no-config for the catalogue)"
        )


def refuse_options_of_projects(names: Sequence[str] | None, config: str | None, update_baseline: bool) -> None:
    """UsageError for options that are for the subjects of a file."""
    if names and config is not None:
        raise UsageError("--config is for the subjects of a file; give no names")
    if update_baseline:
        raise UsageError(
            "--update-baseline is for the subjects of pyproject.toml or brdfcheck.toml; "
            + ("give no names" if names else "there is none (brdfcheck init writes one)")
        )


def validated() -> list[str]:
    """The names of the validated catalogue."""
    from brdfcheck.brdf import catalog

    return [entry.name for entry in catalog.entries() if entry.validated]


def filtered(requests: Sequence[Request], substring: str, modules: dict[str, Any] | None = None) -> list[Request]:
    """The requests of which a name contains the text, in either case, and of these those names. NothingToCheck for none.

    What ``file.py:*`` names is looked up in `modules`, users' files loaded so far; where they are None, or the file cannot be
    read, it is kept as it is.
    """
    from dataclasses import replace

    found = []
    for request in requests:
        every = request.names
        if substring and modules is not None and any(name.endswith(":*") for name in every):
            start()
            every = tuple(part for name in every for part in _spread(name, modules))
        kept = (name for name in every if substring.lower() in name.lower() or name.endswith(":*"))
        names = tuple(dict.fromkeys(kept))
        if names:
            found.append(request if names == request.names else replace(request, names=names, part=names != tuple(every)))
    if not found:
        listed = "; brdfcheck list shows all names" if all(request.index is None for request in requests) else ""
        raise NothingToCheck(f"nothing to check: no name contains {substring!r}{listed}")
    return found


def _spread(name: str, modules: dict[str, Any]) -> list[str]:
    """All that ``file.py:*`` names; the name itself where the file cannot be read, which is said where it is checked."""
    from brdfcheck.brdf.subject import spread

    try:
        return spread(name, modules)
    except UsageError:
        return [name]


def update(gate: Gate, cases: Sequence[Case], reports: Sequence[Report], output: Output) -> list[Known | None]:
    """Write what the subjects violate into the project's file. Returns what each case is expected to violate now."""
    from brdfcheck.gate.baseline import needed, updated

    found: dict[int | None, Known | None] = {}
    for index, request in {case.request.index: case.request for case in cases}.items():
        own = [report for case, report in zip(cases, reports, strict=True) if case.request.index == index]
        found[index] = needed(own, request.expect, part=request.part)
    changed = {case.request.index for case in cases if found[case.request.index] != case.request.expect}
    if changed:
        text = updated(gate, {index: found[index] for index in changed if index is not None})
        with refused("--update-baseline", str(gate.path)):
            output.save(str(gate.path), text, "--update-baseline")
    count = sum(value is not None for value in found.values())
    output.line(f"{gate.path.name}: {count} known, {len(changed)} changed")
    return [found[case.request.index] for case in cases]


# --- watching ---


def watched(requests: Sequence[Request], gate: Gate | None, substring: str = "") -> int:
    """Run the command, and again whenever a file has changed that may change a verdict, until the process is interrupted.

    `gate`: where the requests are from, read again whenever it may have changed; `substring`: which of them are wanted.

    Each run is a process of its own, so that nothing of an older version of a file is left in it; what has not changed comes
    from the cache.
    """
    command = [sys.executable, "-m", "brdfcheck", *(word for word in sys.argv[1:] if word != "--watch")]

    def files() -> set[Path]:
        nonlocal requests
        if gate is not None:
            from brdfcheck.gate.config import read

            # While it is being edited it may be wrong, or gone: then what it said before counts.
            with contextlib.suppress(UsageError, NothingToCheck):
                now = read(gate.path)
                requests = requests if now is None else filtered(now.requests(), substring)
        named = {path for request in requests for path in files_of(request.names, request.reading.folders)}
        return named | ({gate.path} if gate is not None else set())

    if not files():
        raise UsageError("--watch: BRDFs of the catalogue are in no file that could be saved")
    again(lambda: _run(command), files, lambda: _saved(files()))
    return 0


def _run(command: Sequence[str]) -> None:
    """Run a command that ends with this one, and leaves it to say so."""
    with subprocess.Popen(command, process_group=0) as child, Cleanup(child.kill):
        child.wait()


def _saved(files: set[Path]) -> None:
    """Wait until something happens in the folders of the files, or `_EVERY` is over."""
    from watchfiles import watch

    folders = {file.absolute().parent for file in files if file.absolute().parent.is_dir()}
    if not folders:
        time.sleep(_EVERY / 1000)
        return
    next(watch(*folders, recursive=False, step=20, rust_timeout=_EVERY, yield_on_timeout=True), None)


def again(run: Callable[[], object], files: Callable[[], set[Path]], pause: Callable[[], object]) -> None:
    """Call `run`, and again each time that one of the files has changed; `pause` between two looks. Ends with an exception."""
    while True:
        before = _stamps(files())
        run()
        count = "1 file" if len(before) == 1 else f"{len(before)} files"
        print(f"brdfcheck: watching {count}; Ctrl-C ends", file=sys.stderr, flush=True)
        while _stamps(files()) == before:
            pause()


def _stamps(files: set[Path]) -> dict[Path, tuple[int, int] | None]:
    """When each file was changed, and its size; None for one that is not there."""
    found: dict[Path, tuple[int, int] | None] = {}
    for file in files:
        try:
            state = os.stat(file)
            found[file] = (state.st_mtime_ns, state.st_size)
        except OSError:
            found[file] = None
    return found
