"""The figures, one for each kind of curve: albedo against a parameter or the angle, factors, heat maps.

Each takes the curves, the scale of the parameter's axis, the limits of the albedo's, and a title; and is drawn within the
house style, which is its caller's to set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from brdfcheck.plots import paper
from brdfcheck.plots.strips import Frame
from brdfcheck.plots.styles import Style, looks, styles
from brdfcheck.verdict.report import TOLERANCE

Curves = Sequence[Mapping[str, Any]]
Limits = tuple[float, float] | None

_ABOVE = 1 + TOLERANCE
_MOST = 1e30
_MOST_CURVES = 40  # over angles: labels of more find no place beside the axes
# Above the line nothing is fine: a few steps, in colours and with hatching that nothing below has.
_EXCESS = (1.001, 1.01, 1.1, 2.0, 10.0, math.inf)
_RED = ("#FDDBC7", "#F4A582", "#E0714F", "#C63A32", "#94142A", "#5C0A1E")


# --- curves ---


def exponent(curves: Curves, scale: str | None, limits: Limits, title: str | None) -> Figure:
    """Albedo against a parameter: one curve a BRDF; a strip above says for which values which of them exceed 1."""
    look = _look(curves)
    frame = Frame(curves, look, "range", 4.0)
    parameter = paper.parameter_axis(frame.axes, curves, scale)
    frame.axes.set_ylabel(_quantity(curves))
    return _drawn(frame, curves, look, "albedo", limits, title, parameter)


def angle(curves: Curves, scale: str | None, limits: Limits, title: str | None) -> Figure:
    """Albedo against cos theta: one curve a BRDF and value of its parameter, from light to dark along the parameter."""
    if scale == "log":
        raise ValueError("the cosine of incidence has a linear axis: it starts at 0")
    if len(curves) > _MOST_CURVES:
        raise ValueError(
            f"{len(curves)} curves do not fit into one figure of angles, at most {_MOST_CURVES} do: choose some of them"
        )
    look = looks(curves)
    # The right end is grazing incidence: the samples come in rising cosines.
    turned = [
        {**curve, "label": _label(curve, curves), "x": curve["x"][::-1], "albedo": curve["albedo"][::-1]} for curve in curves
    ]
    frame = Frame(turned, look, "cos_theta", 4.0)
    paper.cosine_axis(frame.axes, frame.strip or frame.axes, curves)
    frame.axes.set_ylabel("directional albedo E")
    return _drawn(frame, turned, look, "albedo", limits, title, "θ")


def factor(curves: Curves, scale: str | None, limits: Limits, title: str | None) -> Figure:
    """Factors against the exponent, divided by the largest one that conserves energy; below them the factors themselves."""
    look = _look(curves)
    factors = [paper.floats(curve["factor"]) for curve in curves]
    with np.errstate(all="ignore"):
        ratios = [value / paper.floats(curve["exact"]) for curve, value in zip(curves, factors, strict=True)]
    shown = [{**curve, "ratio": ratio.tolist()} for curve, ratio in zip(curves, ratios, strict=True)]
    frame = Frame(curves, look, "range", 3.6, below=1.7)
    axes, below = frame.axes, frame.lowest
    parameter = paper.parameter_axis(axes, curves, scale)
    below.set_xlabel(axes.get_xlabel())
    axes.set_xlabel("")
    axes.tick_params(axis="x", which="both", labelbottom=False)
    axes.set_ylabel("factor / largest conserving factor")
    for index, (curve, value, style) in enumerate(zip(curves, factors, look, strict=True)):
        paper.line_of(below, paper.floats(curve["x"]), value, style, index, len(curves), linewidth=1.2)
    if all(np.nanmin(value) > 0 for value in factors):
        below.set_yscale("log")
    below.set_ylabel("factor, 1/sr")
    below.grid(True)
    below.yaxis.set_major_formatter(FuncFormatter(lambda value, _: paper.text_of(value, 4)))
    below.yaxis.set_minor_formatter(NullFormatter())
    return _drawn(frame, shown, look, "ratio", limits, title, parameter)


def _look(curves: Curves) -> list[Style]:
    known = styles(curve["name"] for curve in curves)
    return [known[curve["name"]] for curve in curves]


def _drawn(
    frame: Frame, curves: Curves, look: Sequence[Style], key: str, limits: Limits, title: str | None, parameter: str
) -> Figure:
    """The albedo axis, the curves with what of each is above 1 shaded, names at their right ends, the title and the strip."""
    axes = frame.axes
    lines = paper.albedo_axis(axes, curves, limits, key)
    # Many shaded areas on top of each other would be mud.
    alpha = 0.22 if sum(bool(curve.get("above")) for curve in curves) <= 3 else 0.07
    labels = []
    for index, (curve, style) in enumerate(zip(curves, look, strict=True)):
        x, y = paper.floats(curve["x"]), paper.floats(curve[key])
        paper.line_of(axes, x, y, style, index, len(curves))
        if len(x) > 1:
            seen = np.clip(np.where(np.isnan(y), 1.0, y), 1.0, axes.get_ylim()[1])
            axes.fill_between(
                x, 1.0, seen, where=(seen > _ABOVE).tolist(), color=style.color, alpha=alpha, linewidth=0, zorder=2
            )
        known = y[~np.isnan(y)]
        # Equal ends are ranked by where the curves come from.
        middle = float(np.mean(np.clip(known, -10, 10))) if known.size else 0.0
        labels.append(paper.Label(paper.label_of(curve), style, float(known[-1]) if known.size else math.nan, middle))
    paper.note(frame.lowest, lines)
    paper.direct_labels(axes, labels)
    if title:
        paper.title_above(frame.strip or axes, title)
    frame.show_intervals(f"E > 1\nfor {parameter}")
    return frame.figure


def _label(curve: Mapping[str, Any], curves: Curves) -> str:
    at = ", ".join(f"{name} = {paper.text_of(float(value), 4)}" for name, value in curve["at"].items())
    if len({other["name"] for other in curves}) == 1 and at and len(curves) > 1:
        return at
    return f"{paper.label_of(curve)}, {at}" if at else paper.label_of(curve)


def _quantity(curves: Curves) -> str:
    bounds = {(float(curve["cos_theta"][0]), float(curve["cos_theta"][1])) for curve in curves}
    if bounds == {(1.0, 1.0)}:
        return "albedo E at normal incidence"
    if len(bounds) == 1 and len(set(*bounds)) == 1:
        return f"albedo E at cos θ = {paper.text_of(next(iter(bounds))[0], 3)}"
    if bounds == {(0.0, 1.0)}:
        return "largest albedo E over all angles"
    return "largest albedo E over the angles"


# --- heat maps ---


def heatmap(curves: Curves, scale: str | None, limits: Limits, title: str | None) -> Figure:
    """Filled contours up to 1 in one scale of colours, above 1 in another one, hatched. `limits`: ends of the colours."""
    columns = min(len(curves), 1 if len(curves) == 1 else 2 if len(curves) < 5 else 3 if len(curves) < 10 else 4)
    rows = math.ceil(len(curves) / columns)
    size = (5.6, 3.9) if len(curves) == 1 else (max(3.0 * columns + 0.9, 6.9), 2.5 * rows + 0.5)
    whole = Figure(figsize=size)
    levels, colors = _levels(curves, limits)
    norm, cmap = BoundaryNorm(levels, len(colors)), ListedColormap(colors)
    panels: list[Axes] = []
    for index, curve in enumerate(curves):
        axes = whole.add_subplot(rows, columns, index + 1)
        panels.append(axes)
        _panel(axes, curve, scale, levels, colors)
        if index % columns:
            axes.set_ylabel("")
        if index + columns < len(curves):
            axes.set_xlabel("")
        name = paper.label_of(curve)
        axes.set_title(title if title and len(curves) == 1 else name, fontsize=10 if len(curves) == 1 else 8.5)
    if title and len(curves) > 1:
        whole.suptitle(title)
    bar = whole.colorbar(ScalarMappable(norm, cmap), ax=panels, spacing="uniform", fraction=0.06, pad=0.02, aspect=28)
    bar.set_ticks(levels)
    bar.set_ticklabels([_tick(level, curves) for level in levels])
    bar.ax.tick_params(length=2, labelsize=7.5)
    bar.set_label("directional albedo E")
    if levels[-1] > 1:
        bar.ax.axhline(1.0, color="black", linewidth=1.6)
        bar.ax.axhspan(1.0, levels[-1], facecolor="none", edgecolor="#333333", hatch="////", linewidth=0)
    return whole


def _grid(curve: Mapping[str, Any]) -> np.ndarray:
    rows = [paper.floats(row) for row in curve["albedo"]]
    return np.clip(np.array(rows), -_MOST, _MOST)


def _tick(level: float, curves: Curves) -> str:
    if level < _MOST:
        return paper.text_of(round(level, 6), 4)
    return paper.text_of(max(float(np.nanmax(_grid(curve))) for curve in curves), 2)


def _logarithm(values: Any) -> Any:
    """The excess over 1 by its power of ten, cut off where rounding begins."""
    return np.log10(np.maximum(values - 1, 1e-14))


def _panel(axes: Axes, curve: Mapping[str, Any], scale: str | None, levels: Sequence[float], colors: Sequence[str]) -> None:
    parameter = paper.parameter_axis(axes, [curve], scale)
    x, mu, values = paper.floats(curve["x"]), paper.floats(curve["cosines"]), np.ma.masked_invalid(_grid(curve)).T
    below = [level for level in levels if level < 1]
    if below:
        axes.contourf(x, mu, values, levels=[*below, _MOST], colors=colors[: len(below)])
    inner = [level for level in below[1:] if values.min() < level < values.max()]
    if inner:
        half = len(below) / 2
        inks = ["white" if below.index(level) < half else "#222222" for level in inner]
        lines = axes.contour(x, mu, values, levels=inner, colors=inks, linewidths=0.5)
        every = np.asarray(lines.levels)[:: 1 + len(inner) // 6]
        axes.clabel(lines, every, fmt=lambda value: paper.text_of(round(value, 6), 3), fontsize=6.5)
    if values.max() > _ABOVE:
        # Where the albedo dies away towards exactly 1, as it does for exact factors, straight lines between samples would
        # make stairs of the border; in a logarithmic measure of the excess they follow it.
        plateau = np.mean(np.abs(values - 1) < 1e-9) > 0.05
        measure = _logarithm if plateau else np.asarray
        excess = measure(values)
        bounds = [float(measure(level)) for level in (_ABOVE, *(level for level in levels if level > 1))]
        axes.contourf(x, mu, excess, levels=bounds, colors=colors[len(below) :])
        if values.min() < _ABOVE:
            axes.contour(x, mu, excess, levels=bounds[:1], colors="black", linewidths=1.3, linestyles="solid")
        hatching = axes.contourf(x, mu, excess, levels=[bounds[0], 2 * _MOST], colors="none", hatches=["////"])
        hatching.set_edgecolor("#333333")
        hatching.set_linewidth(0.0)
        _largest(axes, curve, parameter)
    axes.set_ylim(float(mu[0]), float(mu[-1]))
    axes.set_ylabel("cos θ")
    axes.yaxis.set_major_locator(MaxNLocator(6))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: paper.text_of(round(value, 9), 6)))


def _largest(axes: Axes, curve: Mapping[str, Any], parameter: str) -> None:
    """Where the albedo is largest, and for which exponents it exceeds 1."""
    largest = curve.get("largest")
    if not largest or parameter not in largest["at"]:
        return
    x, y = float(largest["at"][parameter]), float(largest["cos_theta"])
    axes.plot([x], [y], marker="o", markersize=5, color="white", markeredgecolor="black", clip_on=False, zorder=5)
    lines = [f"largest {paper.text_of(float(largest['albedo']), 5)} at {parameter} = {paper.text_of(x, 4)}, {paper.degrees(y)}"]
    if curve.get("above"):
        ends = ", ".join(f"{paper.text_of(float(low))} … {paper.text_of(float(high))}" for low, high in curve["above"][:3])
        lines.append(f"E > 1 for {parameter} = {ends}")
    # In the half where the marker is not.
    place, where = ((0.03, 0.04), "bottom") if y > sum(axes.get_ylim()) / 2 else ((0.03, 0.96), "top")
    axes.text(
        *place, "\n".join(lines), transform=axes.transAxes, va=where, ha="left", fontsize=7, zorder=6,
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.5},
    )  # fmt: skip


def _levels(curves: Curves, limits: Limits) -> tuple[list[float], list[str]]:
    """Boundaries of the colours and the colours between them; 1 is a boundary."""
    values = np.concatenate([grid[np.isfinite(grid)] for grid in map(_grid, curves)])
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    if limits is not None:
        low, high = max(low, limits[0]), min(high, limits[1])
    steps: list[float] = []
    if low < 1:
        step = next(step for step in (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, math.inf) if (1 - low) / step <= 11)
        if math.isinf(step):
            step = 10 ** math.ceil(math.log10((1 - low) / 10))
        first = math.floor(low / step + 1e-9)
        steps = [round(i * step, 9) for i in range(first, round(1 / step))]
    above: list[float] = []
    if high > _ABOVE:
        above = _excess(values[values > _ABOVE], high)
    elif not steps:
        steps = [0.9]
    shades = colormaps["cividis"](np.linspace(0.02, 0.98, max(len(steps), 1)))
    # All of the reds where the excess is many steps, the lighter ones where it is few.
    reds = LinearSegmentedColormap.from_list("excess", _RED)(np.linspace(0, 1, len(_RED)))[: len(above)]
    if len(above) > len(_RED):
        reds = LinearSegmentedColormap.from_list("excess", _RED)(np.linspace(0, 1, len(above)))
    return [*steps, 1.0, *above], [to_hex(shade) for shade in (*shades[: len(steps)], *reds)]


def _excess(values: np.ndarray, high: float) -> list[float]:
    """Boundaries above 1: by the power of ten of the excess, or by the values where most of them would have one colour."""
    fixed = [level for level in _EXCESS if math.isfinite(level)]
    fixed = fixed[: next((i + 1 for i, level in enumerate(fixed) if level >= high), len(fixed))]
    bands = np.digitize(values, fixed)
    crowded = values.size and np.bincount(bands).max() > 0.7 * values.size
    low = float(np.quantile(values, 0.25)) if values.size else 1.0
    if high > 2 and crowded and high < 100 * low:  # even steps where the values are, wider ones towards 1
        decade = 10.0 ** math.floor(math.log10(max(high - low, 0.01) / 5))
        step = next(step for step in (decade, 2 * decade, 5 * decade, 10 * decade) if (high - low) / step <= 5)
        first, last = math.floor(low / step), math.ceil(high / step - 1e-9)
        levels, gap = [i * step for i in range(first, last + 1)], 2 * step
        while levels[0] - gap > 1:
            levels.insert(0, levels[0] - gap)
            gap *= 2
        return [round(level, 9) for level in levels if level > 1]
    return fixed if fixed[-1] >= high else [*fixed, _MOST]
