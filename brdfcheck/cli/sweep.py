"""``brdfcheck sweep``: albedos over a grid, into a Zarr store."""

from __future__ import annotations

import contextlib
import re
import sys
import time
from collections.abc import Callable, Iterator
from datetime import timedelta
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli.app import PLAIN, ExitCode, command, start
from brdfcheck.cli.output import Output, moving
from brdfcheck.cli.reports import Html, versions
from brdfcheck.interruption import Cleanup, say
from brdfcheck.messages import UsageError

if TYPE_CHECKING:
    from brdfcheck.sweep import Plan, Progress, Summary

# Without a terminal, a line so often (seconds).
_EVERY = 10.0
_KEPT = "the chunks computed so far are kept: the same command goes on from here"


@command(
    "sweep",
    epilog="""\b
Examples:
  brdfcheck sweep config.toml --dry-run
  brdfcheck sweep config.toml --out albedo.zarr
  brdfcheck sweep config.toml --out albedo.zarr --html albedo.html
  brdfcheck sweep config.toml --out albedo.zarr --scheduler tcp://10.0.0.1:8786

\b
config.toml:
  brdf = "binomial-power-half"       # or mine.py:glossy, disney.brdf, or a list of names
  precision = ["float32", "float64"] # optional, like rule and rtol
  [axes]
  n = { geomspace = [1, 1000, 400] } # first, last, how many
  cos_theta = { linspace = [0.05, 1, 90] }
  k = [8, 16]                        # or one value: k = 16
  [reading]                          # optional: -D, -I, --args and --returns
  returns = "brdf*cos"               # and args = "N,L,V", defines = {}, folders = []

If it was interrupted or killed, run the same command again: it resumes, and the result is byte-identical.
A cluster is started with: dask scheduler; dask worker ADDRESS (extra "cluster").

\b
Exit codes:
  0  the store is complete          3  disk full, damaged store, lost cluster
  1  no albedo in it is a number    4  usage error
  2  interrupted""",
)
def _sweep(
    config: Annotated[str, typer.Argument(metavar="CONFIG.toml", help="What to sweep over; see below.")],
    out: Annotated[str | None, typer.Option(metavar="STORE", help="Folder of the Zarr store; begun or continued.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Compute on the Dask cluster of this scheduler.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print size, cells and an estimate; create nothing.")] = False,
    repair: Annotated[bool, typer.Option("--repair", help="Write again what is damaged in the store.")] = False,
    html: Html = None,
    how: Reading = PLAIN,
) -> int:
    """Albedos over a grid of parameters and angles, into a Zarr store.

    The store holds albedo, error, evaluations, and seconds per chunk; xarray.open_zarr opens it.
    """
    if html is not None and dry_run:
        raise UsageError("--html is made of a store that is filled; --dry-run fills none")
    if out is None and not dry_run:
        raise UsageError("--out: say where the store shall be, as in --out albedo.zarr")
    if out is not None and not out.strip():
        raise UsageError("--out: the name is empty")
    from brdfcheck.sweep.config import read_config

    settings = read_config(config, how)
    start()
    output = Output(None)
    from brdfcheck.sweep import Plan, estimate, fill

    try:
        plan = Plan(settings)
        start()  # a user's file may have changed the precision
        for line in _description(plan):
            output.line(line)
        if dry_run:
            guess = estimate(plan, out)
            output.line(f"memory    {_bytes(guess.memory)} of results at a time")
            if guess.found:
                output.line(f"found     {guess.found} of {plan.chunks} chunks are in {out}")
            compiling = f", {_time(guess.compiling)} of it compiling" if guess.compiling >= 1 else ""
            output.line(f"estimate  {_time(guess.seconds)} on this machine{compiling} (measured on a few cells)")
            return ExitCode.PASSED
        assert out is not None
        with Cleanup(lambda: say(_KEPT)), _progress(output, plan) as progress:
            summary = fill(plan, out, scheduler=scheduler, repair=repair, progress=progress)
    except KeyboardInterrupt:
        if not dry_run:
            with contextlib.suppress(OSError, ValueError):
                print(_KEPT, file=sys.stderr)
        raise
    rate = f", {summary.cells / summary.seconds:.3g} cells/s" if summary.cells else ""
    before = f", {summary.found} were there" if summary.found else ""
    numbers = plan.cells * (plan.channels or 1)
    faults = _faults(numbers, summary)
    without = summary.not_a_number + summary.infinite == numbers
    output.line(
        f"{out}: {faults if without else 'complete'};"
        f" {summary.computed} of {plan.chunks} chunks computed in {_time(summary.seconds)}{rate}{before}"
    )
    if summary.repaired:
        output.line(f"repaired  {summary.repaired} damaged or missing parts")
    if faults and not without:
        output.line(f"{out}: {faults}")
    if html is not None:
        from brdfcheck.sweep.pages import sweep_page

        assert out is not None
        output.save(html, sweep_page(out, provenance=versions()), "--html")
    return ExitCode.FAILED if without else ExitCode.PASSED


def _faults(numbers: int, summary: Summary) -> str:
    """In words, how many of so many albedos are no finite numbers; nothing where all are."""
    found = []
    for count, what in ((summary.not_a_number, "not a number"), (summary.infinite, "infinite")):
        if count == numbers:
            found.append(f"all {numbers} albedos are {what}" if numbers > 1 else f"the only albedo is {what}")
        elif count:
            found.append(f"{count} of {numbers} albedos {'is' if count == 1 else 'are'} {what}")
    return ", ".join(found)


def _description(plan: Plan) -> Iterator[str]:
    shape = " x ".join(f"{axis.name} {len(axis)}" for axis in plan.dimensions) or "one cell"
    held = "".join(f", {axis.name} = {axis.values[0]}" for axis in plan.held)
    pieces = " x ".join(str(axis.chunk) for axis in plan.dimensions) or "1"
    channels = "" if plan.channels is None else f", {plan.channels} channels"
    yield f"axes      {shape}{channels}{held}"
    yield f"cells     {plan.cells} in {plan.chunks} {'chunk' if plan.chunks == 1 else 'chunks'} of {pieces}"
    yield f"size      {_bytes(plan.size(plan.cells))}"


def _bytes(count: int) -> str:
    amount, units = float(count), ["bytes", "kB", "MB", "GB", "TB", "PB"]
    while amount >= 1000 and len(units) > 1:
        amount /= 1000
        units.pop(0)
    return f"{amount:.3g} {units[0]}"


def _time(seconds: float) -> str:
    if seconds < 99.5:
        return f"{seconds:.2g} s" if seconds < 9.95 else f"{seconds:.0f} s"
    return re.sub(r" days?,", " d", str(timedelta(seconds=round(seconds))))


@contextlib.contextmanager
def _progress(output: Output, plan: Plan) -> Iterator[Callable[[Progress], None]]:
    """A bar with rate and time left on a terminal, elsewhere a line from time to time and at the end."""
    began = said = time.monotonic()
    task: Any = None

    def columns(parts: Any) -> tuple[Any, ...]:
        left = parts.TimeRemainingColumn(), parts.TextColumn("left,")
        return parts.TextColumn("sweeping"), parts.BarColumn(bar_width=32), parts.TaskProgressColumn(), *left

    with moving(output.terminal(), columns, speed_estimate_period=300) as bar:

        def show(progress: Progress) -> None:
            nonlocal said, task
            now, done = time.monotonic(), progress.cells - progress.cells_before
            rate = f"{done / (now - began):.3g} cells/s" if done and now > began else "starting"
            if bar is not None:
                text = f"{progress.chunks}/{plan.chunks} chunks, {rate}"
                task = bar.add_task(text, total=plan.cells, completed=progress.cells) if task is None else task
                bar.update(task, completed=progress.cells, description=text)
            elif now - said >= _EVERY or (progress.cells == plan.cells and done):
                said = now
                left = (plan.cells - progress.cells) * (now - began) / done if done else 0.0
                with contextlib.suppress(OSError, ValueError):
                    text = f"{progress.chunks} of {plan.chunks} chunks, {rate}, {_time(left)} left"
                    print(text, file=sys.stderr, flush=True)

        yield show
