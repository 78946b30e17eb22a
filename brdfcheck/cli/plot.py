"""``brdfcheck plot``: albedos and factors as figures for a paper."""

from __future__ import annotations

import contextlib
import difflib
import os
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from brdfcheck.cli.app import Debug, ExitCode, Json, Task, app, refuse_outputs, start
from brdfcheck.cli.output import Output, save
from brdfcheck.cli.words import Range, parse_cosines, parse_number, parse_over, parse_range
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from brdfcheck.brdf.subject import Target

Curve = dict[str, Any]

_KINDS = ("albedo-vs-n", "albedo-vs-angle", "heatmap", "factor")
_SUFFIXES = (".svg", ".png", ".pdf")
_MOST_CURVES = 12  # over angles, where the values of the parameter are ours to choose


@dataclass(frozen=True)
class _Settings:
    """The options of `plot`, already understood."""

    kind: str
    words: Sequence[str]
    output: str | None
    over: Mapping[str, Range]
    values: Sequence[float] | None  # of n, one curve over angles each
    cos_theta: Range | None
    scale: str | None
    limits: Range | None
    samples: int | None
    title: str | None
    json: str | None
    show: bool
    debug: bool


@app.command(
    "plot",
    epilog="""\b
Examples:
  brdfcheck plot albedo-vs-n binomial-power-published blinn-phong-6
  brdfcheck plot albedo-vs-n binomial-power-published --n 10:30 --y 0.995:1.005 -o zoom.pdf
  brdfcheck plot albedo-vs-angle phong-classical --n 1,10,100
  brdfcheck plot heatmap cook-torrance -o metal.png
  brdfcheck plot factor blinn-phong blinn-phong-8 fit.json
  brdfcheck plot albedo-vs-n mine.py:glossy --over n=1:1000
  brdfcheck plot heatmap sweep.zarr

\b
Kinds:
  albedo-vs-n      the largest albedo over all angles against the parameter
  albedo-vs-angle  the albedo against cos theta, a few values of the parameter
  heatmap          the albedo over both
  factor           factors divided by the largest one that conserves energy

\b
Where a lobe exceeds 1, the interval is shaded and its ends are printed. A FILE is
what plot --json, fit --json or study wrote, or the folder of a sweep.""",
)
def _plot(
    kind: Annotated[str, typer.Argument(metavar="KIND", help=", ".join(_KINDS) + ".", show_default=False)],
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE|NAME...", help="Records, stores, catalogue names, path/to/file.py:object.", show_default=False
        ),
    ] = None,
    output: Annotated[
        str | None, typer.Option("-o", "--output", metavar="FILE", help="Ends in .svg, .png or .pdf. [default: KIND.svg]")
    ] = None,
    over: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LO:HI", help="Let a parameter run over a range, or hold it: NAME=VALUE. Repeatable."),
    ] = None,
    n: Annotated[
        str | None, typer.Option("--n", metavar="LO:HI", help="Short for --over n=LO:HI; over angles also a list, 1,10,100.")
    ] = None,
    cos_theta: Annotated[
        str | None, typer.Option(metavar="LO:HI", help="Cosines of incidence; 1 is normal incidence. [default: 0:1]")
    ] = None,
    scale: Annotated[
        str | None, typer.Option(metavar="log|linear", help="Axis of the parameter. [default: log where the range is long]")
    ] = None,
    y: Annotated[str | None, typer.Option("--y", metavar="LO:HI", help="Ends of the albedo axis.")] = None,
    samples: Annotated[
        str | None, typer.Option(metavar="NUMBER", help="Points along the axis. [default: what the engine affords]")
    ] = None,
    title: Annotated[str | None, typer.Option(metavar="TEXT", help="A title above the figure.")] = None,
    json: Json = None,
    show: Annotated[bool, typer.Option("--show", help="Open a window, where there is a display.")] = False,
    debug: Debug = False,
) -> Task:
    """Figures for a paper: albedo against exponent or angle, heat maps, factors."""

    def work() -> int:
        _refuse_kind(kind)
        ranges = parse_over(over or ())
        values = None
        if n is not None:
            if "n" in ranges:
                raise UsageError(f"--n {one_line(n)}: n is also given with --over")
            ranges["n"], values = _exponents(n, kind)
        limits = None if y is None else parse_range(y, f"--y {one_line(y)}")
        if limits is not None and limits[0] == limits[1]:
            raise UsageError(f"--y {one_line(y)}: LO must be below HI")
        if scale not in (None, "log", "linear"):
            raise UsageError(f"--scale: must be log or linear; got {one_line(scale)!r}")
        target = output if output is not None or show else f"{kind}.svg"
        _refuse_suffix(target)
        refuse_outputs({"--output": target, "--json": json})
        if show:
            _refuse_show()
        settings = _Settings(
            kind, tuple(names or ()), target, ranges, values, parse_cosines(cos_theta), scale, limits, _count(samples), title,
            json, show, debug,
        )  # fmt: skip
        return _run_plot(settings)

    return Task(work, debug)


# --- from words to settings ---


def _refuse_kind(kind: str) -> None:
    if kind in _KINDS:
        return
    near = difflib.get_close_matches(kind, _KINDS, n=2, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else f"the kinds are {', '.join(_KINDS)}"
    raise UsageError(f"unknown kind of plot {one_line(kind)!r}; {hint}")


def _exponents(text: str, kind: str) -> tuple[Range, list[float] | None]:
    what = f"--n {one_line(text)}"
    if "," not in text:
        return parse_range(text, what), None
    if kind != "albedo-vs-angle":
        raise UsageError(f"{what}: a list of exponents is for albedo-vs-angle; {kind} takes LO:HI")
    values = [parse_number(part, what) for part in text.split(",")]
    return (min(values), max(values)), list(dict.fromkeys(values))


def _count(text: str | None) -> int | None:
    if text is None:
        return None
    value = parse_number(text, "--samples")
    if value != int(value) or not 3 <= value <= 20_000:
        raise UsageError(f"--samples: must be a whole number from 3 to 20000; got {text}")
    return int(value)


def _refuse_suffix(path: str | None) -> None:
    if path is not None and Path(path).suffix.lower() not in _SUFFIXES:
        raise UsageError(f"--output {one_line(path)!r}: must end in {', '.join(_SUFFIXES[:-1])} or {_SUFFIXES[-1]}")


def _refuse_show() -> None:
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError("--show: there is no display; leave it out and open the file that is written")


# --- the work ---


def _run_plot(settings: _Settings) -> int:
    if not settings.words:
        raise UsageError("nothing to plot: give names of the catalogue (brdfcheck list), files, or file.py:object")
    output = Output(settings.json)
    with contextlib.redirect_stdout(sys.stderr):
        curves = _curves(settings, output)
        from brdfcheck import plots

        try:
            figure = plots.figure(settings.kind, curves, scale=settings.scale, limits=settings.limits, title=settings.title)
            image = None if settings.output is None else plots.to_bytes(figure, Path(settings.output).suffix.lower())
        except ValueError as error:
            raise _usage(error, settings) from None
    for curve in curves:
        output.line(_line(curve))
    if settings.output is not None and image is not None:
        save(settings.output, image, "--output")
        output.line(f"wrote {settings.output}")
    if settings.json:
        text = _record(curves, settings)
        if settings.json == "-":
            output.stdout(text)
        else:
            save(settings.json, text, "--json")
            output.line(f"wrote {settings.json}")
    if settings.show:
        _show(figure)
    return ExitCode.PASSED


def _curves(settings: _Settings, output: Output) -> list[Curve]:
    """The curves in the order of the words. Files come first to be read: a mistake there is said before anything long."""
    from brdfcheck.output import curve_files

    found: dict[str, list[Curve]] = {}
    fits: dict[str, list[dict[str, Any]]] = {}
    words = list(dict.fromkeys(settings.words))
    files = [word for word in words if _is_file(word)]
    for word in files:
        if os.path.isdir(word):
            bounds = settings.over.get("n")
            if settings.values is None and settings.kind == "albedo-vs-angle" and bounds and bounds[0] == bounds[1]:
                wanted, bounds = [bounds[0]], None
            else:
                wanted, bounds = settings.values, bounds if settings.values is None else None
            found[word] = curve_files.from_store(word, settings.kind, wanted=wanted, n=bounds, cos_theta=settings.cos_theta)
        else:
            found[word], fits[word] = curve_files.read(word, settings.kind)
    names = [word for word in words if word not in files]
    if files and not names and not any(os.path.isdir(word) for word in files):
        _refuse_options(settings, fits)
    if names or any(fits.values()):
        start()
        found |= _computed(names, fits, settings, output)
    return [curve for word in words for curve in found[word]]


def _is_file(word: str) -> bool:
    from brdfcheck.output.curve_files import is_curve_file

    if word.endswith((".json", ".zarr", ".zarr/")):
        return True
    if not is_curve_file(word):
        return False
    from brdfcheck.brdf import catalog  # a folder may have the name of a lobe

    return word not in catalog.names()


def _refuse_options(settings: _Settings, fits: Mapping[str, Sequence[Any]]) -> None:
    """What was computed when a file was written cannot be asked for any more."""
    given = {"--over": settings.over, "--cos-theta": settings.cos_theta}
    if not any(fits.values()):
        given["--samples"] = settings.samples
    for option, value in given.items():
        if value:
            shown = "--over or --n" if option == "--over" else option
            raise UsageError(f"{shown}: a record holds what was computed; give the names of the BRDFs to compute them anew")


def _computed(
    names: Sequence[str], fits: Mapping[str, Sequence[Mapping[str, Any]]], settings: _Settings, output: Output
) -> dict[str, list[Curve]]:
    """The curves of BRDFs and of fitted factors."""
    from brdfcheck.brdf.subject import resolve
    from brdfcheck.output import curves

    targets = resolve(names, settings.over, settings.cos_theta) if names else []
    start()  # a user's file may have changed the precision
    for target in targets:
        if target.finding is not None:
            raise UsageError(f"{target.family.name}: {one_line(target.finding)}")
    if settings.kind == "albedo-vs-angle":
        jobs = [(name, _over_angles(target, len(targets), settings)) for name, target in zip(names, targets, strict=True)]
    else:
        families = _common_ranges([target.family for target in targets], settings, output)
        compute = curves.KINDS[settings.kind]
        jobs = [
            (name, [_job(compute, family, target, samples=settings.samples)])
            for name, family, target in zip(names, families, targets, strict=True)
        ]
    for word, results in fits.items():
        jobs.append((word, [_fit_job(word, result, settings) for result in results]))
    found: dict[str, list[Curve]] = {}
    with output.progress(sum(len(parts) for _, parts in jobs), "computing") as advance:
        for word, parts in jobs:
            found[word] = []
            for part in parts:
                found[word].append(_asked(part, word, settings))
                advance()
    return found


def _job(compute: Callable[..., Curve], family: Any, target: Target, **options: Any) -> Callable[[], Curve]:
    held = dict(target.family.held)

    def job() -> Curve:
        curve = compute(family, **options)
        return {**curve, "held": {**held, **curve["held"]}, "origin": "user" if target.file else "catalog"}

    return job


def _over_angles(target: Target, count: int, settings: _Settings) -> list[Callable[[], Curve]]:
    """One curve for each value of the parameter: those asked for, or a few round ones."""
    from brdfcheck.output import curves

    family = target.family
    try:
        parameter = curves.swept_parameter(family)
    except ValueError as error:
        raise UsageError(one_line(error)) from None
    values: list[dict[str, float]] = [{}]
    if settings.values is not None and "n" in family.ranges:
        values = [{"n": value} for value in settings.values]
    elif parameter is not None:
        most = max(_MOST_CURVES // count, 1)
        low, high = family.ranges[parameter]
        chosen = curves.round_values(low, high, 5 if most >= 5 else max(most, 3))
        chosen = chosen[len(chosen) // 2 :][:1] if most < 2 else chosen[:most] if most < 3 else chosen
        values = [{parameter: value} for value in chosen]
    return [_job(curves.albedo_vs_angle, family, target, samples=settings.samples, **value) for value in values]


def _common_ranges(families: Sequence[Any], settings: _Settings, output: Output) -> list[Any]:
    """The families over the part of the parameter's range that all of them have, where no range was asked for."""
    import dataclasses

    parameters = {name for family in families for name, (low, high) in family.ranges.items() if low < high}
    if len(families) < 2 or len(parameters) != 1 or settings.kind == "heatmap" or parameters & set(settings.over):
        return list(families)
    (parameter,) = parameters
    ranges = {family.ranges[parameter] for family in families if parameter in family.ranges}
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if len(ranges) < 2 or low >= high:
        return list(families)
    output.line(f"{parameter}={low:g}:{high:g}, the range that all have (--over {parameter}=LO:HI for another one)")
    return [dataclasses.replace(family, ranges={**family.ranges, parameter: (low, high)}) for family in families]


def _fit_job(word: str, result: Mapping[str, Any], settings: _Settings) -> Callable[[], Curve]:
    from brdfcheck.brdf.readers.python import is_file_spec
    from brdfcheck.brdf.subject import resolve
    from brdfcheck.output import curves

    def job() -> Curve:
        try:
            name, n = str(result["name"]), (float(result["n"][0]), float(result["n"][1]))
            target: Any = resolve([name], {"n": n}, None)[0].family if is_file_spec(name) else name
            return curves.fitted(settings.kind, target, result, samples=settings.samples)
        except (KeyError, TypeError, IndexError) as error:
            raise UsageError(f"{word}: the fit is damaged: {type(error).__name__}: {one_line(error)}") from None

    return job


def _asked(job: Callable[[], Curve], word: str, settings: _Settings) -> Curve:
    """The curve; what is wrong with a BRDF, or with what was asked of it, in one line."""
    from brdfcheck.brdf.callables import Finding

    try:
        curve = job()
    except UsageError:
        raise
    except Finding as finding:
        raise UsageError(f"{word}: {one_line(finding)}") from None
    except ValueError as error:
        raise _usage(error, settings) from None
    except (Exception, SystemExit) as error:
        if not word.endswith(".py") and ":" not in word:
            raise
        if settings.debug:
            traceback.print_exc()
        raise UsageError(f"{word}: cannot be evaluated: {type(error).__name__}: {one_line(error)}") from None
    if settings.kind != "heatmap" and all(value == "NaN" for value in curve["albedo"]):
        raise UsageError(f"{word}: its albedo is not a number anywhere: there is nothing to plot")
    return curve


def _usage(error: ValueError, settings: _Settings) -> UsageError:
    if settings.debug:
        traceback.print_exc()
    return UsageError(one_line(error))


# --- what is said and written ---


def _line(curve: Curve) -> str:
    """One curve in one line: where it exceeds 1."""
    name = curve.get("label") or curve["name"]
    at = " ".join(f"{key}={float(value):.6g}" for key, value in (curve.get("at") or {}).items())
    largest = curve.get("largest") or {}
    place = ""
    if largest:
        import math

        words = [f"{key}={float(value):.6g}" for key, value in largest["at"].items()]
        words.append(f"angle={math.degrees(math.acos(min(max(float(largest['cos_theta']), 0.0), 1.0))):.5g} deg")
        place = f"  largest {float(largest['albedo']):.10g} at {' '.join(words)}"
    axis = "cos_theta" if curve["kind"] == "albedo-vs-angle" else curve["parameter"]
    if curve["above"]:
        ends = ", ".join(f"{float(low):.6g}..{float(high):.6g}" for low, high in curve["above"])
        verdict = f"exceeds 1 for {axis}={ends}"
    else:
        verdict = "UNDECIDED" if curve.get("verdict") == "UNDECIDED" else "nowhere above 1"
    return f"{name}{' ' + at if at else ''}  {verdict}{place}"


def _record(curves: Sequence[Curve], settings: _Settings) -> str:
    from brdfcheck.output import records

    shown = {
        "kind": settings.kind,
        "names": list(settings.words),
        "over": {name: list(bounds) for name, bounds in settings.over.items()},
        "values": None if settings.values is None else list(settings.values),
        "cos_theta": None if settings.cos_theta is None else list(settings.cos_theta),
        "scale": settings.scale,
        "y": None if settings.limits is None else list(settings.limits),
        "samples": settings.samples,
        "title": settings.title,
        "output": settings.output,
        "precision": "float64",
    }
    summary = {"curves": len(curves), "above_1": sum(bool(curve["above"]) for curve in curves)}
    return records.to_json(records.document("plot", curves, settings=shown, summary=summary))


def _show(figure: Figure) -> None:
    """The figure in a window, until it is closed. UsageError where no toolkit can open one."""
    try:
        import matplotlib.pyplot as plt

        if plt.get_backend().lower() in ("agg", "svg", "pdf", "ps", "cairo", "template"):
            raise UsageError("--show: matplotlib has no toolkit for windows; install one (python3-tk, PyQt6)")
        window = plt.figure(figsize=figure.get_size_inches())
        manager: Any = window.canvas.manager
        manager.canvas.figure = figure
        figure.set_canvas(manager.canvas)
        plt.show()
        plt.close(manager.num)
    except UsageError:
        raise
    except Exception as error:  # whatever a toolkit raises where its display has gone
        raise UsageError(f"--show: cannot open a window: {type(error).__name__}: {one_line(error)}") from None
