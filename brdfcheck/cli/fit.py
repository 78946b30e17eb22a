"""``brdfcheck fit``: the factor that normalises a lobe, its verdict, and what can be taken into a renderer."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli import words
from brdfcheck.cli.app import PLAIN, ExitCode, Hold, Json, asked, command, start
from brdfcheck.cli.output import Output, refused
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.fits.factor import FactorFit

Objective = Literal["minimax", "least-squares", "reciprocal"]
Sampling = Literal["geometric", "linear", "integers"]
Kind = StrEnum("Kind", ["glsl", "c", "csv", "npy", "exr"])
_SOURCE = ("glsl", "c")


@command(
    "fit",
    epilog="""\b
Examples:
  brdfcheck fit binomial-power-half
  brdfcheck fit blinn-phong --n 1:100000 --ladder
  brdfcheck fit lyon-2-half --objective least-squares --json fit.json
  brdfcheck fit schlick-mirror --export glsl schlick.glsl
  brdfcheck fit mine.py:glossy --n 1:200 --over ks=0.5

\b
Objectives:
  minimax        albedo <= 1 at every angle, and the smallest albedo at normal
                 incidence as large as a factor (n+A)/B allows
  least-squares  sum of (albedo - 1)^2, then B enlarged until it conserves
  reciprocal     straight line through 1/albedo, then B enlarged likewise

\b
Exports, of the albedo with the fitted factor over n and cos theta:
  glsl, c        the factor and a small rational function for the albedo
  csv, npy, exr  64 x 64 table; npy has its provenance in FILE.json beside it

\b
Exit codes:
  0  the fitted BRDF conserves energy        3  internal error
  1  it does not                             4  usage error, or it cannot be
  2  interrupted                                evaluated""",
)
def _fit(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="A catalogue name, path/to/file.py:object, or a shader file.", show_default=False),
    ],
    n: Annotated[
        words.Interval | None,
        typer.Option("--n", metavar="LO:HI", parser=words.within(0), help="The exponents to normalise over. [default: 1:1000]"),
    ] = None,
    objective: Annotated[Objective, typer.Option(help="What the factor is to do best; see below.")] = "minimax",
    sampling: Annotated[
        Sampling | None,
        typer.Option(help="Spacing of the exponents that least-squares and reciprocal look at. [default: geometric]"),
    ] = None,
    over: Hold = None,
    how: Reading = PLAIN,
    ladder: Annotated[
        bool,
        typer.Option("--ladder", help="Also compare forms of factor, from cheap to tight: their cost and the energy lost."),
    ] = False,
    json: Json = None,
    export: Annotated[
        tuple[Kind, str] | None,
        typer.Option(
            metavar=f"{'|'.join(Kind)} FILE",
            help='Write the albedo of the fitted BRDF; "-" writes source text to standard output.',
        ),
    ] = None,
) -> int:
    """The factor (n+A)/B that normalises a lobe, and the verdict on it.

    A factor that the lobe carries already is taken off first. The verdict holds over all exponents of the range and all
    angles. What has no exponent gets one constant.
    """
    held = words.together(over)
    if "n" in held:
        raise UsageError("--over n=...: give the exponents with --n")
    for key, (low, high) in held.items():
        if low != high:
            raise UsageError(f"--over {key}={low:g}:{high:g}: a factor depends on n alone; hold {key} at one value")
    if sampling is not None and objective == "minimax":
        raise UsageError("--sampling goes with --objective least-squares or reciprocal; minimax looks at all exponents")
    if export is not None:
        _refuse(export, json)
    settings = {
        "name": name,
        "n": n or words.Interval(1.0, 1000.0),
        "objective": objective,
        "sampling": sampling or "geometric",
        "over": held,
        "precision": "float64",
    }
    output = Output(json, alone=export is not None and export[1] == "-")
    return _run(settings | how.record, how, ladder, output, export)


def _refuse(export: tuple[Kind, str], json: str | None) -> None:
    """UsageError where the export cannot be written, or where ``--json`` goes to the same file."""
    kind, path = export
    files = [path, f"{path}.json"] if kind == "npy" else [path]
    for file in files:
        words.refuse_same({"--export": file, "--json": json})
        if kind not in _SOURCE or file != "-":
            trouble = words.trouble_with(file)
            if trouble:
                raise UsageError(f"--export {kind}: {trouble}")


def _run(settings: Mapping[str, Any], how: Reading, ladder: bool, output: Output, export: tuple[Kind, str] | None) -> int:
    start()
    from brdfcheck.fits.factor import fit_factor
    from brdfcheck.fits.ladder import factor_ladder
    from brdfcheck.fits.raw import of_exponent
    from brdfcheck.output import records
    from brdfcheck.output import text as console

    name, n = settings["name"], settings["n"]
    target = of_exponent(name, n, settings["over"], how)
    start()  # a user's file may have changed the precision
    text = f"fitting {name} over n={n.low:g}:{n.high:g}; about 30 s for a plain Python function"
    try:
        with output.progress(text) as progress, asked():
            fit = fit_factor(target.family, n, settings["objective"], sampling=settings["sampling"])
            progress.say("climbing the ladder of factors" if ladder else "writing down the fit")
            rungs = factor_ladder(target.family, n) if ladder else ()
            content = _exported(export[0], fit) if export is not None else None
    except UsageError:
        raise
    except (Exception, SystemExit) as error:
        if target.file is None:
            raise
        output.line(f"{name}  cannot be fitted: {type(error).__name__}: {one_line(error)}")
        return ExitCode.FAILED
    for line in (*console.fit_lines(fit), *console.ladder_lines(rungs)):
        output.line(line)
    if export is not None:
        with asked():
            output.line(_write(export, content, fit, output))
    code = ExitCode.PASSED if fit.report.passed else ExitCode.FAILED
    result = records.fit_object(fit)
    if rungs:
        result["ladder"] = [vars(rung) | {"factor": records.factor_object(rung.factor), "lost": rung.lost} for rung in rungs]
    summary = {"seconds": output.seconds, "exit_code": int(code)}
    output.write_json(lambda: records.document("fit", [result], settings=settings, summary=summary))
    return code


def _exported(kind: str, fit: FactorFit) -> Any:
    """What is exported: a small rational function for source text, a grid for tables."""
    from brdfcheck.fits.grids import tabulate
    from brdfcheck.fits.surface import fit_albedo

    content = fit_albedo(fit.family) if kind in _SOURCE else tabulate(fit.family)
    # Of a function it cannot be seen that a factor is on it.
    return dataclasses.replace(content, factor=fit.factor, factored=True)


def _write(export: tuple[Kind, str], content: Any, fit: FactorFit, output: Output) -> str:
    """Write the export, and say what was written."""
    from brdfcheck.fits.compact import CompactFits
    from brdfcheck.output.source import source_text
    from brdfcheck.output.table_files import write_table

    kind, path = export
    if kind in _SOURCE:
        output.save(path, source_text(kind, CompactFits(content), factor=fit.factor, command=output.command), "--export")
        what = f"the factor; the albedo by {content.coefficients} coefficients, within {content.max_error:.2g}"
        return f"  exported  {'stdout' if path == '-' else path}: {what}"
    with refused("--export", path):
        write_table(path, content, kind, command=output.command)
    rows, columns = content.values.shape
    what = f"the albedo of {rows} exponents by {columns} cosines, error bar at most {content.errors.max():.2g}"
    return f"  exported  {path}: {what}"
