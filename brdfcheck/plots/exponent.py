"""Albedo against an exponent (or a slope): how the largest albedo over the angles moves with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from brdfcheck.plots import paper
from brdfcheck.plots.styles import Style, styles


def figure(
    curves: Sequence[Mapping[str, Any]], *, scale: str | None, limits: tuple[float, float] | None, title: str | None
) -> Figure:
    """One curve a BRDF; a strip above says for which exponents which of them exceed 1."""
    with paper.house_style():
        look = [styles(curve["name"] for curve in curves)[curve["name"]] for curve in curves]
        found = _violations(curves, look)
        whole, axes, strip = paper.frame(len(found), height=_height(len(curves)))
        parameter, _, _ = paper.parameter_axis(axes, curves, scale)
        axes.set_ylabel(_quantity(curves))
        lines = paper.albedo_axis(axes, curves, limits)
        draw(axes, curves, look, "albedo")
        paper.note(axes, lines)
        if title:
            (strip or axes).set_title(title, pad=10)
        paper.direct_labels(axes, labels(curves, look, "albedo"))
        paper.show_intervals(axes, strip, found, f"E > 1\nfor {parameter}")
        return whole


def draw(axes: Axes, curves: Sequence[Mapping[str, Any]], look: Sequence[Style], key: str) -> None:
    """The curves, and what of each is above 1 shaded."""
    # Many shaded areas on top of each other would be mud.
    alpha = 0.22 if sum(bool(curve.get("above")) for curve in curves) <= 3 else 0.07
    for index, (curve, style) in enumerate(zip(curves, look, strict=True)):
        x, y = paper.floats(curve["x"]), paper.floats(curve[key])
        paper.line_of(axes, x, y, style, index, len(curves))
        if len(x) > 1:
            seen = np.clip(np.where(np.isnan(y), 1.0, y), 1.0, axes.get_ylim()[1])
            above = (seen > 1 + 1e-9).tolist()
            axes.fill_between(x, 1.0, seen, where=above, color=style.color, alpha=alpha, linewidth=0, zorder=2)


def labels(curves: Sequence[Mapping[str, Any]], look: Sequence[Style], key: str) -> list[paper.Label]:
    """The names at the ends of the curves; equal ends are ranked by where the curves come from."""
    found = []
    for curve, style in zip(curves, look, strict=True):
        values = paper.floats(curve[key])
        known = values[~np.isnan(values)]
        middle = float(np.mean(np.clip(known, -10, 10))) if known.size else 0.0
        found.append(paper.Label(paper.label_of(curve), style, float(known[-1]) if known.size else float("nan"), middle))
    return found


def _violations(curves: Sequence[Mapping[str, Any]], look: Sequence[Style]) -> list[paper.Violation]:
    edges = [(float(curve["range"][0]), float(curve["range"][1])) for curve in curves]
    return paper.violations(curves, look, edges)


def _height(count: int) -> float:
    """Inches: room for the names of many curves."""
    return min(max(4.0, 0.17 * count + 0.6), 7.5)


def _quantity(curves: Sequence[Mapping[str, Any]]) -> str:
    bounds = {(float(curve["cos_theta"][0]), float(curve["cos_theta"][1])) for curve in curves}
    if bounds == {(1.0, 1.0)}:
        return "albedo E at normal incidence"
    if len(bounds) == 1 and len(set(*bounds)) == 1:
        return f"albedo E at cos θ = {paper.text_of(next(iter(bounds))[0], 3)}"
    if bounds == {(0.0, 1.0)}:
        return "largest albedo E over all angles"
    return "largest albedo E over the angles"
