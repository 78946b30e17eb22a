"""``brdfcheck plot``: albedos and factors as figures for a paper."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli import words
from brdfcheck.cli.app import PLAIN, CosTheta, ExitCode, Json, Over, asked, command, start
from brdfcheck.cli.output import Output, has_display
from brdfcheck.messages import UsageError, one_line, written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from brdfcheck.brdf.family import Family
    from brdfcheck.brdf.subject import Target

Curve = dict[str, Any]
Kind = Literal["albedo-vs-n", "albedo-vs-angle", "heatmap", "factor"]

_MOST_CURVES = 12  # over angles, where the values of the parameter are ours to choose


@dataclass(frozen=True)
class _Settings:
    """What was asked for, as it is recorded. `values`: of n, one curve over angles each."""

    kind: Kind
    names: Sequence[str]
    over: Mapping[str, words.Interval]
    values: Sequence[float] | None
    cos_theta: words.Interval | None
    scale: str | None
    y: words.Interval | None
    samples: int | None
    title: str | None
    output: str | None
    how: Reading


@command(
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
  albedo-vs-angle  the albedo against cos theta, for a few values of the parameter
  heatmap          the albedo over both
  factor           factors divided by the largest one that conserves energy

\b
Where a lobe exceeds 1, the interval is shaded and its ends are printed. A FILE is what
plot --json, fit --json or study wrote, or the folder of a sweep.""",
)
def _plot(
    kind: Annotated[Kind, typer.Argument(metavar="KIND", help="What to plot; see below.", show_default=False)],
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME|FILE",
            help="Catalogue names (brdfcheck list), path/to/file.py:object, shader files, or files with results; see below.",
            show_default=False,
        ),
    ],
    output: Annotated[
        str | None,
        words.file(
            "-o",
            "--output",
            ends=(".svg", ".png", ".pdf"),
            help="Where the figure goes: .svg, .png or .pdf. [default: KIND.svg]",
        ),
    ] = None,
    over: Over = None,
    n: Annotated[
        words.Exponents | None,
        typer.Option(
            "--n",
            metavar="LO:HI",
            parser=words.exponent_list,
            help="Short for --over n=LO:HI; for albedo-vs-angle also a list, as in 1,10,100.",
        ),
    ] = None,
    cos_theta: CosTheta = None,
    how: Reading = PLAIN,
    scale: Annotated[
        Literal["log", "linear"] | None,
        typer.Option(help="Axis of the parameter. [default: log where the range is long]"),
    ] = None,
    y: Annotated[
        words.Interval | None,
        typer.Option(
            "--y", metavar="LO:HI", parser=words.interval, help="Ends of the albedo axis. [default: those of the curves]"
        ),
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option(metavar="N", min=3, max=20_000, help="Points along the axis. [default: as many as are quickly computed]"),
    ] = None,
    title: Annotated[str | None, typer.Option(metavar="TEXT", help="A title above the figure.")] = None,
    json: Json = None,
    show: Annotated[
        bool, typer.Option("--show", help="Show the figure in a window; a file is then written only with -o.")
    ] = False,
) -> int:
    """Figures for a paper: albedos as curves and heat maps, factors."""
    ranges = words.together(over)
    if n is not None:
        if "n" in ranges:
            raise UsageError("--n and --over n=... cannot go together: give one of them")
        if n.values is not None and kind != "albedo-vs-angle":
            raise UsageError(f"--n: a list of exponents is for albedo-vs-angle; {kind} takes LO:HI")
        ranges["n"] = n.bounds
    if y is not None and y.low == y.high:
        raise UsageError(f"--y: LO must be below HI; got {written(y.low)}")
    target = output
    if show and not has_display():
        raise UsageError("--show: there is no display; leave it out and open the file that is written")
    if not show and output is None:
        target = f"{kind}.svg"
        trouble = words.trouble_with(target)
        if trouble:
            raise UsageError(f"--output: {trouble}")
    words.refuse_same({"--output": target, "--json": json})
    values = None if n is None else n.values
    settings = _Settings(kind, names, ranges, values, cos_theta, scale, y, samples, title, target, how)
    told = Output(json)
    curves = _curves(settings, told)
    from brdfcheck import plots
    from brdfcheck.output import records

    with asked():
        figure = plots.figure(kind, curves, scale=scale, limits=y, title=title)
        image = None if target is None else plots.to_bytes(figure, Path(target).suffix.lower())
    for curve in curves:
        told.line(_line(curve))
    if target is not None and image is not None:
        told.save(target, image, "--output")
        told.line(f"wrote {target}")
    summary = {"curves": len(curves), "above_1": sum(bool(curve["above"]) for curve in curves)}
    shown = {**vars(settings), "precision": "float64"}
    shown |= shown.pop("how").record
    told.write_json(lambda: records.document("plot", curves, settings=shown, summary=summary))
    if json not in (None, "-"):
        told.line(f"wrote {json}")
    if show:
        _show(figure)
    return ExitCode.PASSED


# --- the curves ---


def _curves(settings: _Settings, output: Output) -> list[Curve]:
    """The curves in the order of the names. Files come first to be read: a mistake there is said before anything long."""
    from brdfcheck.output import curve_files

    found: dict[str, list[Curve]] = {}
    fits: dict[str, list[dict[str, Any]]] = {}
    everything = list(dict.fromkeys(settings.names))
    files = [name for name in everything if curve_files.is_curve_file(name)]
    for file in files:
        if os.path.isdir(file):
            wanted, bounds = settings.values, settings.over.get("n")
            if wanted is None and settings.kind == "albedo-vs-angle" and bounds and bounds.low == bounds.high:
                wanted = [bounds.low]
            n = bounds if wanted is None else None
            found[file] = curve_files.from_store(file, settings.kind, wanted=wanted, n=n, cos_theta=settings.cos_theta)
        else:
            found[file], fits[file] = curve_files.read(file, settings.kind)
    names = [name for name in everything if name not in files]
    if files and not names and not any(os.path.isdir(file) for file in files):
        _refuse_options(settings, fits)
    if names or any(fits.values()):
        from brdfcheck.brdf.subject import spread

        start()
        modules: dict[str, ModuleType] = {}
        everything = list(dict.fromkeys(part for name in everything for part in spread(name, modules)))
        found |= _computed([name for name in everything if name not in files], modules, fits, settings, output)
    return [curve for name in everything for curve in found[name]]


def _refuse_options(settings: _Settings, fits: Mapping[str, Sequence[Any]]) -> None:
    """What was computed when a file was written cannot be asked for any more."""
    given = {"--over or --n": settings.over, "--cos-theta": settings.cos_theta}
    if not any(fits.values()):
        given["--samples"] = settings.samples
    for option, value in given.items():
        if value:
            raise UsageError(f"{option}: a record holds what was computed; give the names of the BRDFs to compute them anew")


def _computed(
    names: Sequence[str],
    modules: dict[str, ModuleType],
    fits: Mapping[str, Sequence[Mapping[str, Any]]],
    settings: _Settings,
    output: Output,
) -> dict[str, list[Curve]]:
    """The curves of BRDFs, whose users' files are in `modules` if they are loaded, and of fitted factors."""
    from brdfcheck.brdf.subject import resolve
    from brdfcheck.output import curves

    targets = resolve(names, settings.over, settings.cos_theta, settings.how, modules) if names else []
    start()  # a user's file may have changed the precision
    for target in targets:
        if target.finding is not None:
            raise UsageError(f"{target.family.name}: {one_line(target.finding)}")
    families = [target.family for target in targets]
    if settings.kind == "albedo-vs-angle":
        members = [_over_angles(family, len(families), settings) for family in families]
    else:
        members = [list(curves.switched(family).items()) for family in _common_ranges(families, settings, output)]
    compute = partial(curves.KINDS[settings.kind], samples=settings.samples)
    jobs: dict[str, list[Callable[[], Curve]]] = {
        name: [partial(_of_target, compute, member, target, which) for which, member in parts]
        for name, target, parts in zip(names, targets, members, strict=True)
    }
    jobs |= {file: [partial(_of_fit, file, result, settings) for result in results] for file, results in fits.items()}
    found: dict[str, list[Curve]] = {}
    with output.progress("computing", sum(map(len, jobs.values()))) as advance:
        for name, parts in jobs.items():
            found[name] = []
            for part in parts:
                found[name].append(_asked(part, name, settings))
                advance()
    return found


def _of_target(compute: Callable[..., Curve], member: Family, target: Target, which: str) -> Curve:
    curve = compute(member)
    curve |= {"label": f"{curve['name']} {which}"} if which else {}
    return {**curve, "held": {**target.family.held, **curve["held"]}, "origin": "user" if target.file else "catalog"}


def _over_angles(family: Family, count: int, settings: _Settings) -> list[tuple[str, Family]]:
    """One curve for each value of the parameter: those asked for, or a few round ones."""
    from brdfcheck.output import curves

    with asked():
        parameter = curves.swept_parameter(family)
    if settings.values is not None and "n" in family.ranges:
        parameter, chosen = "n", settings.values
    elif parameter is None:
        return [("", family)]
    else:
        most = max(_MOST_CURVES // count, 1)
        low, high = family.ranges[parameter]
        chosen = [low, high] if parameter in family.switches else curves.round_values(low, high, min(max(most, 3), 5))
        if most < 3:
            chosen = chosen[:most] if most == 2 else chosen[len(chosen) // 2 :][:1]
    return [("", replace(family, ranges={**family.ranges, parameter: (value, value)})) for value in chosen]


def _common_ranges(families: Sequence[Family], settings: _Settings, output: Output) -> list[Family]:
    """The families over the part of the parameter's range that all of them have, where no range was asked for."""
    parameters = {name for family in families for name, (low, high) in family.ranges.items() if low < high}
    if len(families) < 2 or len(parameters) != 1 or settings.kind == "heatmap" or parameters & set(settings.over):
        return list(families)
    (parameter,) = parameters
    ranges = {family.ranges[parameter] for family in families if parameter in family.ranges}
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if len(ranges) < 2 or low >= high:
        return list(families)
    output.line(f"{parameter}={low:g}:{high:g}, the range that all have (--over {parameter}=LO:HI for another one)")
    return [replace(family, ranges={**family.ranges, parameter: (low, high)}) for family in families]


def _of_fit(file: str, result: Mapping[str, Any], settings: _Settings) -> Curve:
    from brdfcheck.brdf.subject import as_target
    from brdfcheck.output import curves

    try:
        name, n = str(result["name"]), (float(result["n"][0]), float(result["n"][1]))
        if n[0] == n[1]:
            raise UsageError(f"{file}: the fit of {name} is one constant: there is no range of n to plot it over")
        said = result.get("settings") or {}
        ranges = {key: (float(low), float(high)) for key, (low, high) in said.get("over", {}).items()} | {"n": n}
        how: dict[str, Any] = said.get("reading", {})
        given: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in how.items()}
        target = as_target(name, ranges, None, Reading(**given)).family
        return curves.fitted(settings.kind, target, result, samples=settings.samples)
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise UsageError(f"{file}: the fit is damaged: {type(error).__name__}: {one_line(error)}") from error


def _asked(job: Callable[[], Curve], name: str, settings: _Settings) -> Curve:
    """The curve; what is wrong with a BRDF, or with what was asked of it, in one line."""
    from brdfcheck.brdf.blame import Finding

    with asked(brdf=name):
        try:
            curve = job()
        except Finding as finding:
            raise UsageError(f"{name}: {one_line(finding)}") from finding
    if settings.kind != "heatmap" and all(value == "NaN" for value in curve["albedo"]):
        raise UsageError(f"{name}: its albedo is not a number anywhere: there is nothing to plot")
    return curve


def _line(curve: Curve) -> str:
    """One curve in one line: where it exceeds 1."""
    parts = [" ".join((curve.get("label") or curve["name"], *_assigned(curve.get("at") or {})))]
    if curve["above"]:
        axis = "cos_theta" if curve["kind"] == "albedo-vs-angle" else curve["parameter"]
        parts.append(
            f"exceeds 1 for {axis}={', '.join(f'{float(low):.6g}..{float(high):.6g}' for low, high in curve['above'])}"
        )
    else:
        parts.append("UNDECIDED" if curve.get("verdict") == "UNDECIDED" else "nowhere above 1")
    if largest := curve.get("largest"):
        angle = math.degrees(math.acos(min(max(float(largest["cos_theta"]), 0.0), 1.0)))
        place = " ".join((*_assigned(largest["at"]), f"angle={angle:.5g} deg"))
        parts.append(f"largest {float(largest['albedo']):.10g} at {place}")
    return "  ".join(parts)


def _assigned(values: Mapping[str, Any]) -> list[str]:
    return [f"{name}={float(value):.6g}" for name, value in values.items()]


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
