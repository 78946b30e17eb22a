"""Factors against the exponent, divided by the largest factor that conserves energy: all of them are close to a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from brdfcheck.plots import exponent, paper
from brdfcheck.plots.styles import styles


def figure(
    curves: Sequence[Mapping[str, Any]], *, scale: str | None, limits: tuple[float, float] | None, title: str | None
) -> Figure:
    """The ratio to the largest conserving factor, and below it the factors themselves."""
    with paper.house_style():
        look = [styles(curve["name"] for curve in curves)[curve["name"]] for curve in curves]
        shown = [{**curve, "ratio": _ratio(curve)} for curve in curves]
        edges = [(float(curve["range"][0]), float(curve["range"][1])) for curve in curves]
        found = paper.violations(curves, look, edges)
        main, low = min(max(3.6, 0.17 * len(curves) + 0.6), 7.5), 1.7
        strip_height = 0.30 * len(found) + 0.05
        whole = Figure(figsize=(paper.WIDTH, main + low + (strip_height if found else 0)))
        heights = [strip_height, main, low] if found else [main, low]
        grid = whole.add_gridspec(len(heights), 1, height_ratios=heights, hspace=0.03)
        axes = whole.add_subplot(grid[-2])
        below = whole.add_subplot(grid[-1], sharex=axes)
        strip = whole.add_subplot(grid[0], sharex=axes) if found else None
        parameter, _, _ = paper.parameter_axis(axes, curves, scale)
        below.set_xlabel(axes.get_xlabel())
        axes.set_xlabel("")
        axes.tick_params(axis="x", which="both", labelbottom=False)
        axes.set_ylabel("factor / largest conserving factor")
        lines = paper.albedo_axis(axes, shown, limits, key="ratio")
        exponent.draw(axes, shown, look, "ratio")
        for index, (curve, style) in enumerate(zip(curves, look, strict=True)):
            x, y = paper.floats(curve["x"]), paper.floats(curve["factor"])
            paper.line_of(below, x, y, style, index, len(curves), linewidth=1.2)
        if all(np.nanmin(paper.floats(curve["factor"])) > 0 for curve in curves):
            below.set_yscale("log")
        below.set_ylabel("factor, 1/sr")
        below.grid(True)
        paper.plain_log(below.yaxis)
        paper.note(below, lines)
        if title:
            (strip or axes).set_title(title, pad=10)
        paper.direct_labels(axes, exponent.labels(shown, look, "ratio"))
        paper.show_intervals(axes, strip, found, f"E > 1\nfor {parameter}")
        return whole


def _ratio(curve: Mapping[str, Any]) -> list[float]:
    with np.errstate(all="ignore"):
        return (paper.floats(curve["factor"]) / paper.floats(curve["exact"])).tolist()
