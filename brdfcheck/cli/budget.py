"""``brdfcheck budget``: the cheapest models whose picture of a scene is within a tolerance of the full one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from brdfcheck.cli import words
from brdfcheck.cli.app import ExitCode, Json, command, start
from brdfcheck.cli.output import Output
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.budgets.measure import Budget

# Seconds between two lines about how far it is, where there is no terminal.
_EVERY = 10


@command(
    "budget",
    epilog="""\b
Examples:
  brdfcheck budget scene.toml
  brdfcheck budget scene.toml --tolerance 2/255 -o chart.png --images images.png
  brdfcheck budget scene.toml --json -

\b
SCENE.toml is a file for brdfcheck render (see its --help). It may also hold these tables:
  [output]
  bits = 8                          # or 16
  transfer = "srgb"                 # or linear
  [matters]
  pixel = "0.5/255"                 # tolerance of a pixel; by default half a step of the output
  energy = 0.01                     # tolerance of the sum of all pixels; by default any
  silhouette = false                # leave out pixels that only one of two pictures covers
  [room]                            # closed cube with the object in its middle
  reflectance = 0.7
  emission = 1.5                    # of its ceiling, at +y

Each model is varied by itself, from the cheapest version to the full one; each version is rendered
against the full picture and its operations are counted, so that every run chooses the same. The
choice is verified by rendering it, and timed beside the full model.

\b
Exit codes:
  0  the choice is within the tolerance     3  internal error
  1  no choice is                           4  usage error
  2  interrupted""",
)
def _budget(
    scene: Annotated[str, typer.Argument(metavar="SCENE.toml", help="The scene; see below.", show_default=False)],
    tolerance: Annotated[
        float | None,
        typer.Option(
            metavar="ERROR",
            parser=words.share,
            help="The largest error of a pixel, as a part of full scale: 0.5/255, say. [default: the scene's own]",
        ),
    ] = None,
    json: Json = None,
    chart: Annotated[
        str | None,
        words.file(
            "-o", "--output", ends=(".png", ".svg", ".pdf"), help="Draw a chart of error against work: .png, .svg or .pdf."
        ),
    ] = None,
    images: Annotated[
        str | None,
        words.file("--images", ends=(".png",), help="Write both pictures and their difference, side by side: .png."),
    ] = None,
) -> int:
    """Find out how much of the model a scene needs."""
    words.refuse_same({"--json": json, "--output": chart, "--images": images})
    output = Output(json)
    start()
    from brdfcheck.budgets.knobs import knobs_of
    from brdfcheck.budgets.measure import BudgetError, measure
    from brdfcheck.budgets.scenes import read_scene

    read = read_scene(scene)
    try:
        rungs = sum(len(knob.rungs) for knob in knobs_of(read))
        with output.progress(f"measuring {read.label}", rungs, every=_EVERY) as progress:

            def watch(name: str) -> None:
                progress.say(f"with {name}")
                progress()

            measured = measure(read, watch)
    except ValueError as error:  # what is right by itself and wrong together, as a camera inside the object
        raise UsageError(f"{one_line(scene)}: {one_line(error).removeprefix(f'{read.label}: ')}") from error
    try:
        with output.progress(f"choosing for {read.label}", every=_EVERY) as progress:
            budget = measured.choose(tolerance, lambda names: progress.say(f"choosing for {read.label}: {names}"))
    except BudgetError as error:
        output.line(one_line(error))
        return ExitCode.FAILED
    _write(budget, output, chart, images)
    return ExitCode.PASSED


def _write(budget: Budget, output: Output, chart: str | None, images: str | None) -> None:
    from brdfcheck import plots
    from brdfcheck.budgets import report
    from brdfcheck.output.text import columns
    from brdfcheck.scene.images import png_bytes

    record = report.document(budget)
    output.write_json(lambda: record)
    header, rows = report.cells(record)
    for line in (*columns([header, *rows]), *report.sentences(record)):
        output.line(line)
    if chart is not None:
        output.save(chart, plots.to_bytes(report.chart(record), Path(chart).suffix.lower()), "--output")
        output.line(f"wrote {chart}")
    if images is not None:
        output.save(images, png_bytes(report.pictures(budget), 8), "--images")
        output.line(f"wrote {images}")
