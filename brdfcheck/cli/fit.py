"""``brdfcheck fit``: the factor that normalises a lobe, its verdict, and what can be taken into a renderer."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdfcheck.cli.app import Debug, ExitCode, Json, Task, app, refuse_outputs, start
from brdfcheck.cli.output import Output, save
from brdfcheck.cli.words import Range, parse_over, parse_range
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.brdf.subject import Target
    from brdfcheck.fits.factor import FactorFit
    from brdfcheck.fits.ladder import Rung

# As in `brdfcheck.fits.factor` and `brdfcheck.output`, which are not imported before the words are known to be right.
_OBJECTIVES = ("minimax", "least-squares", "reciprocal")
_SAMPLINGS = ("geometric", "linear", "integers")
_KINDS = ("glsl", "c", "csv", "npy", "exr")


@app.command(
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
  1  it does not, or cannot be evaluated     4  usage error
  2  interrupted""",
)
def _fit(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="A catalogue name or path/to/file.py:object.", show_default=False)
    ],
    n: Annotated[str, typer.Option("--n", metavar="LO:HI", help="The exponents to normalise over.")] = "1:1000",
    objective: Annotated[str, typer.Option(metavar="|".join(_OBJECTIVES), help="What the factor is to do best.")] = "minimax",
    sampling: Annotated[
        str, typer.Option(metavar="|".join(_SAMPLINGS), help="The exponents that the least squares see.")
    ] = "geometric",
    over: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Hold another parameter at a value. Repeatable.")
    ] = None,
    show_ladder: Annotated[
        bool, typer.Option("--ladder", help="Also compare cheaper and tighter forms of factor: their cost, the energy lost.")
    ] = False,
    json: Json = None,
    export: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar=f"{'|'.join(_KINDS)} FILE", help='Write the fitted BRDF\'s albedo; the file "-" is stdout for text.'
        ),
    ] = None,
    debug: Debug = False,
) -> Task:
    """The factor (n+A)/B that normalises a lobe, and whether it conserves energy.

    A factor that the lobe carries already is taken off first. The verdict holds over all exponents of the range and all
    angles.
    """

    def work() -> int:
        _refuse_choice("--objective", objective, _OBJECTIVES)
        _refuse_choice("--sampling", sampling, _SAMPLINGS)
        if export is not None:
            _refuse_choice("--export", export[0], _KINDS)
            if export[1] == "-" and export[0] not in ("glsl", "c"):
                raise UsageError(f"--export {export[0]}: needs a file name; only source text can be written to stdout")
            if export[1] == "-" and json == "-":
                raise UsageError("--export and --json cannot both write to stdout")
        exponents = parse_range(n, f"--n {one_line(n)}")
        if exponents[0] < 0:
            raise UsageError(f"--n {one_line(n)}: exponents must be >= 0")
        held = parse_over(over or ())
        if "n" in held:
            raise UsageError("--over n=...: the exponents are given with --n")
        refuse_outputs({"--json": json, "--export": None if export is None else export[1]})
        words = [name, "--n", n, "--objective", objective]
        return _run_fit(name, exponents, objective, sampling, held, show_ladder, json, export, words)

    return Task(work, debug)


def _refuse_choice(option: str, value: str, allowed: Sequence[str]) -> None:
    if value not in allowed:
        raise UsageError(f"{option}: must be one of {', '.join(allowed)}; got {value!r}")


def _run_fit(
    name: str,
    exponents: Range,
    objective: str,
    sampling: str,
    held: dict[str, Range],
    show_ladder: bool,
    json: str | None,
    export: tuple[str, str] | None,
    words: Sequence[str],
) -> int:
    began = time.perf_counter()
    start()
    from brdfcheck.brdf.callables import Finding
    from brdfcheck.fits.factor import fit_factor, to_json_object
    from brdfcheck.fits.ladder import factor_ladder
    from brdfcheck.output import records

    output = Output("-" if export is not None and export[1] == "-" else json)
    with contextlib.redirect_stdout(sys.stderr):
        target = _target(name, exponents, held)
        start()  # a user's file may have changed the precision
        try:
            with output.waiting(
                f"fitting {name} over n={exponents[0]:g}:{exponents[1]:g}; of plain functions half a minute"
            ) as show:
                fit = _asked(lambda: fit_factor(target.family, exponents, objective, sampling=sampling))  # pyright: ignore[reportArgumentType]
                show("climbing the ladder of factors" if show_ladder else "writing down the fit")
                rungs = _asked(lambda: factor_ladder(target.family, exponents)) if show_ladder else ()
                content = _asked(lambda: _exported(export[0], fit)) if export is not None else None
        except Finding as finding:
            return _complain(output, name, str(finding))
        except (Exception, SystemExit) as error:
            if target.file is None or isinstance(error, UsageError):
                raise
            return _complain(output, name, f"{type(error).__name__}: {one_line(error)}")
    for line in _lines(fit):
        output.line(line)
    for line in _ladder_lines(rungs):
        output.line(line)
    if export is not None and content is not None:
        output.line(_asked(lambda: _write(export, content, fit, words, output)))
    code = ExitCode.PASSED if fit.report.passed else ExitCode.FAILED
    if json:
        result = {**to_json_object(fit), "report": records.to_json_object(fit.report)}
        if rungs:
            result["ladder"] = [_rung_json(rung) for rung in rungs]
        settings = {
            "name": name,
            "n": list(exponents),
            "objective": objective,
            "sampling": sampling,
            "over": {key: list(bounds) for key, bounds in held.items()},
            "precision": "float64",
        }
        summary = {"seconds": time.perf_counter() - began, "exit_code": int(code)}
        text = records.to_json(records.document("fit", [result], settings=settings, summary=summary))
        if json == "-":
            output.stdout(text)
        else:
            save(json, text, "--json")
    return code


def _target(name: str, exponents: Range, held: dict[str, Range]) -> Target:
    from brdfcheck.brdf.readers.python import is_file_spec
    from brdfcheck.brdf.subject import resolve

    if not is_file_spec(name):
        from brdfcheck.brdf import catalog

        # A lobe without an exponent is told so, rather than that the option --over knows no n.
        with contextlib.suppress(KeyError):
            ranges = catalog.entry(name).family.ranges
            if "n" not in ranges:
                raise UsageError(f"{name} has no exponent n to normalise over; it has {', '.join(ranges) or 'no parameters'}")
    for key, (low, high) in held.items():
        if low != high:
            raise UsageError(f"--over {key}={low:g}:{high:g}: a factor is a function of n alone; hold {key} at one value")
    (target,) = resolve([name], {"n": exponents, **held}, None)
    if target.finding is not None:
        raise UsageError(target.finding)
    return target


def _asked(work: Callable[[], Any]) -> Any:
    """What the fit refuses (ValueError) is a usage error."""
    try:
        return work()
    except ValueError as error:
        raise UsageError(one_line(error)) from error


def _complain(output: Output, name: str, text: str) -> int:
    output.line(f"{name}  cannot be fitted: {text}")
    return ExitCode.FAILED


def _lines(fit: FactorFit) -> list[str]:
    from brdfcheck.fits.factor import describe
    from brdfcheck.output import text as console

    report = fit.report
    swept = f"n={console.exact(fit.n[0])}:{console.exact(fit.n[1])}"
    sampled = "" if fit.objective == "minimax" else f", {fit.sampling} sampling"
    smallest = f"{fit.smallest:.10f}" if fit.smallest >= 1e-4 else f"{fit.smallest:.5g}"
    lines = [
        f"{fit.name}  factor {describe(fit.factor, 10)}  ({fit.objective}{sampled} over {swept})",
        f"  to copy   {_copied(fit)}",
        f"  largest   albedo {console.albedo_text(report)}  at {console.place_text(report)}",
        f"  smallest  albedo {smallest}  at n={fit.smallest_n:.6g}, normal incidence",
        f"  verdict   {report.verdict.name} over all angles (tolerance {console.exact(report.tolerance)})",
    ]
    if fit.objective != "minimax":
        first = fit.history[0]
        lines.insert(2, f"  as fitted {describe(fit.fitted, 10)}  reaches {first.peak:.10f}: B was enlarged until it conserves")
        if not first.peak > 1 + report.tolerance:
            lines[2] = f"  as fitted {describe(fit.fitted, 10)}  conserves already"
    if fit.remark:
        lines.append(f"  remark    {fit.remark}")
    return [*lines, *(f"  {line}" for line in console.remark_lines([report]))]


def _copied(fit: FactorFit) -> str:
    """Constants with few digits that still conserve: the factor falls with B and rises with A; where B < 0, the reverse."""
    a, b = float(fit.factor.A), float(fit.factor.B)  # pyright: ignore[reportAttributeAccessIssue]
    if a > 1e5 * max(fit.n[1], 1):
        value = (fit.n[0] + a) / b
        step = 10.0 ** (math.floor(math.log10(value)) - 4)
        return f"the constant {math.floor(value / step + 1e-9) * step:.5g}  (rounded to the safe side; n makes no difference)"
    # Of n + A so many digits are kept at the end of the range where it is smallest.
    least = -a - fit.n[1] if b < 0 else a + fit.n[0]
    large = _rounded(abs(b), 5, up=True)
    digits = math.floor(math.log10(abs(a))) - math.floor(math.log10(least)) + 4 if a and least > 0 else 5
    offset = _rounded(abs(a), digits, up=b > 0 > a)
    return f"A = {'-' if a < 0 else ''}{offset}, B = {'-' if b < 0 else ''}{large}  (rounded to the safe side)"


def _rounded(value: float, digits: int, *, up: bool) -> str:
    """`value` >= 0 with so many digits after its first, rounded up or down."""
    if value == 0:
        return "0"
    places = digits - math.floor(math.log10(value))
    # What a constant lies off a round number by rounding must not cost a digit.
    scaled = value * 10.0**places
    whole = math.ceil(scaled - 1e-6) if up else math.floor(scaled + 1e-6)
    text = f"{whole / 10.0**places:.{max(places, 0)}f}"
    return text if len(text) < 20 else f"{whole / 10.0**places:.{max(digits, 1)}e}"


def _ladder_lines(rungs: Sequence[Rung]) -> list[str]:
    from brdfcheck.fits.factor import describe

    if not rungs:
        return []
    rows = [("form", "constants", "operations", "ns", "largest loss", "at n", "verdict", "factor")]
    for rung in rungs:
        lost = "none" if rung.lost < 1e-12 else f"{rung.lost:.3g}"
        rows.append(
            (
                rung.form,
                str(rung.constants),
                str(rung.operations),
                f"{rung.nanoseconds:.1f}" if rung.nanoseconds >= 0.1 else "<0.1",
                lost,
                "-" if lost == "none" else f"{rung.smallest_n:.5g}",
                rung.verdict.name,
                describe(rung.factor),
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    numeric = {1, 2, 3, 4, 5}
    lines = ["  ladder"]
    for row in rows:
        cells = [
            cell.rjust(width) if column in numeric else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("    " + "  ".join(cells).rstrip())
    return lines


def _exported(kind: str, fit: FactorFit) -> Any:
    """What is exported: a small rational function for source text, a grid for tables."""
    from brdfcheck.fits.grids import tabulate
    from brdfcheck.fits.surface import fit_albedo

    content = fit_albedo(fit.family) if kind in ("glsl", "c") else tabulate(fit.family)
    # Of a function it cannot be seen that a factor is on it.
    return dataclasses.replace(content, factor=fit.factor, factored=True)


def _write(export: tuple[str, str], content: Any, fit: FactorFit, words: Sequence[str], output: Output) -> str:
    from brdfcheck.output.source import c_snippet, glsl_snippet
    from brdfcheck.output.table_files import write_table

    kind, path = export
    command = shlex.join(["brdfcheck", "fit", *words])
    if kind in ("glsl", "c"):
        snippet = glsl_snippet if kind == "glsl" else c_snippet
        text = snippet(content, fit.factor, command=command)
        if path == "-":
            output.stdout(text)
        else:
            save(path, text, "--export")
        where = "stdout" if path == "-" else path
        error = f"{content.max_error:.2g}"
        return f"  exported  {where}: the factor; the albedo by {content.coefficients} coefficients, within {error}"
    rows, columns = content.values.shape
    try:
        write_table(path, content, kind, command=command)
    except OSError as error:
        raise UsageError(f"--export: cannot write {path!r}: {error.strerror or error}") from None
    return (
        f"  exported  {path}: the albedo of {rows} exponents by {columns} cosines, error bar at most {content.errors.max():.2g}"
    )


def _rung_json(rung: Rung) -> dict[str, Any]:
    from brdfcheck.fits.factor import factor_json

    return {
        "form": rung.form,
        "factor": factor_json(rung.factor),
        "constants": rung.constants,
        "operations": rung.operations,
        "nanoseconds": rung.nanoseconds,
        "smallest": rung.smallest,
        "smallest_n": rung.smallest_n,
        "lost": rung.lost,
        "peak": rung.peak,
        "verdict": rung.verdict,
    }
