"""``brdfcheck budget``: the cheapest models whose picture of a scene is within a tolerance of the full one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from brdfcheck.cli.app import Debug, ExitCode, Json, Task, app, refuse_outputs, start
from brdfcheck.cli.output import Output, save
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.budgets.measure import Budget


@app.command(
    "budget",
    epilog="""\b
Examples:
  brdfcheck budget scene.toml
  brdfcheck budget scene.toml --tolerance 2/255 -o chart.png --images images.png
  brdfcheck budget scene.toml --json -

\b
scene.toml is that of brdfcheck render, and may say besides:
  [output]
  bits = 8                          # or 16
  transfer = "srgb"                 # or linear
  [matters]
  pixel = "0.5/255"                 # by default half a step of the output
  energy = 0.01                     # of the sum of all pixels; by default any
  silhouette = false                # leave out pixels that one picture only covers
  [room]                            # closed cube with the object in its middle
  reflectance = 0.7
  emission = 1.5                    # of its ceiling, at +y

Each rung of each knob is rendered against the full model and its operations are counted, so that
the choice is the same at every run; it is verified by rendering it, and timed beside the full
model. Where it misses the tolerance the exit code is 1.""",
)
def _budget(
    scene: Annotated[str | None, typer.Argument(metavar="SCENE.toml", help="The scene.", show_default=False)] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            metavar="ERROR", help="Largest error of a pixel in units of full scale, as in 0.5/255. [default: its own]"
        ),
    ] = None,
    json: Json = None,
    output: Annotated[
        str | None, typer.Option("-o", "--output", metavar="FILE", help="Chart of error against work: .png, .svg or .pdf.")
    ] = None,
    images: Annotated[
        str | None, typer.Option("--images", metavar="FILE", help="Both pictures and their difference: .png.")
    ] = None,
    debug: Debug = False,
) -> Task:
    """Find out how much of the model a scene needs."""
    return Task(lambda: _run(scene, tolerance, json, output, images), debug)


def _run(scene: str | None, tolerance: str | None, json: str | None, chart: str | None, images: str | None) -> int:
    if scene is None:
        raise UsageError("say which scene: a TOML file, as in brdfcheck budget scene.toml")
    for option, path, suffixes in (("--output", chart, (".png", ".svg", ".pdf")), ("--images", images, (".png",))):
        if path is not None and Path(path).suffix.lower() not in suffixes:
            raise UsageError(f"{option}: the file must end in {', '.join(suffixes)}; got {one_line(path)!r}")
    refuse_outputs({"--json": json, "--output": chart, "--images": images})
    target = Output(json)
    start()
    from brdfcheck.budgets.measure import BudgetError, measure
    from brdfcheck.budgets.scenes import read_scene, tolerance_of

    try:
        wanted = None if tolerance is None else tolerance_of(tolerance, "--tolerance:")
    except ValueError as error:
        raise UsageError(one_line(error)) from None
    read = read_scene(scene)
    try:
        with target.waiting(f"measuring {read.label}: every rung of every knob is rendered"):
            measured = measure(read)
    except ValueError as error:  # what is right by itself and wrong together, as a camera inside the object
        raise UsageError(f"{one_line(scene)}: {one_line(error).removeprefix(f'{read.label}: ')}") from None
    try:
        with target.waiting(f"rendering the choice for {read.label}"):
            budget = measured.choose(wanted)
    except BudgetError as error:
        target.line(one_line(error))
        return ExitCode.FAILED
    _write(budget, target, json, chart, images)
    return ExitCode.PASSED


def _write(budget: Budget, target: Output, json: str | None, chart: str | None, images: str | None) -> None:
    from brdfcheck import plots
    from brdfcheck.budgets import report
    from brdfcheck.output.records import to_json

    record = report.document(budget)
    if json is not None:
        text = to_json(record)
        target.stdout(text) if json == "-" else save(json, text, "--json")
    header, rows = report.cells(record)
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
    for row in (header, *rows):
        target.line("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    for line in report.sentences(record):
        target.line(line)
    if chart is not None:
        save(chart, plots.to_bytes(report.chart(record), Path(chart).suffix.lower()), "--output")
        target.line(f"wrote {chart}")
    if images is not None:
        from brdfcheck.scene.images import png_bytes

        save(images, png_bytes(report.pictures(budget), 8), "--images")
        target.line(f"wrote {images}")
