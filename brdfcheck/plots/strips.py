"""The strip above a figure: which BRDFs exceed 1, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from brdfcheck.plots.paper import along, apart, degrees, keep_width, name_beside, text_of
from brdfcheck.plots.styles import Style, ink

Curves = Sequence[Mapping[str, Any]]
Interval = tuple[float, float]

_WIDTH = 7.0  # inches: the text width of a paper
_ROW = 0.30  # inches a row


@dataclass
class Violation:
    """A BRDF that exceeds 1 and where; the ends that are ends of the range, not of the violation, are `edges`."""

    sampled: bool  # not where it is the only one that does
    style: Style
    intervals: list[Interval]
    edges: Interval  # ends of the range
    largest: str


class Frame:
    """A figure with its main `axes`; above them a `strip` with a row for each BRDF that exceeds 1 (None where none does).

    Inches of the main axes: `least`, and more where many curves have names; `below`: of axes below them, which are then the
    `lowest`. `key`: where a curve has the range that its axis runs over.
    """

    def __init__(self, curves: Curves, look: Sequence[Style], key: str, least: float, below: float = 0.0):
        self.angles = key == "cos_theta"
        violating = [(curve, style) for curve, style in zip(curves, look, strict=True) if curve.get("above")]
        self.found = [
            Violation(
                len(violating) > 1,
                style,
                [(float(low), float(high)) for low, high in curve["above"]],
                (float(curve[key][0]), float(curve[key][1])),
                text_of(float(curve["largest"]["albedo"]), 5) if curve.get("largest") else "",
            )
            for curve, style in violating
        ]
        heights = [_ROW * len(violating) + 0.05] if violating else []
        heights += [min(max(least, 0.17 * len(curves) + 0.6), 7.5), *([below] if below else [])]
        self.figure = Figure(figsize=(_WIDTH, sum(heights)))
        grid = self.figure.add_gridspec(len(heights), 1, height_ratios=heights, hspace=0.03 if below else 0.02)
        self.axes = self.figure.add_subplot(grid[1 if violating else 0])
        self.lowest = self.figure.add_subplot(grid[-1], sharex=self.axes) if below else self.axes
        self.strip = self.figure.add_subplot(grid[0], sharex=self.axes) if violating else None

    def show_intervals(self, words: str) -> None:
        """Shade where the law is broken, and draw the strip that gives the ends. Limits must be set, labels drawn before."""
        axes, strip, found = self.axes, self.strip, self.found
        if strip is None:
            return
        strip.set_ylim(len(found), 0)
        strip.set_yticks([])
        strip.tick_params(axis="x", which="both", length=0, labelbottom=False)
        for spine in strip.spines.values():
            spine.set_visible(False)
        strip.set_facecolor("none")
        strip.text(-0.012, 0.5, words, transform=strip.transAxes, ha="right", va="center", fontsize=7.5, color="#333333")
        few = len(found) <= 3
        rows = [
            _row(axes, strip, row, violation, few, few and _tinted(violation, found), self.angles)
            for row, violation in enumerate(found)
        ]
        keep_width(axes)
        # The texts are as wide as they are: they can be kept inside and apart only once the layout is known.
        inverted = axes.get_xlim()[0] > axes.get_xlim()[1]
        for texts in rows:
            _settle(strip, texts[::-1] if inverted else texts)


def _tinted(violation: Violation, found: Sequence[Violation]) -> bool:
    """Whether a tint says where: not over the whole range, and not where one tint would lie on another."""
    if violation.intervals == [violation.edges]:
        return False
    others = [interval for other in found if other is not violation for interval in other.intervals]
    return not any(low < last and first < high for low, high in violation.intervals for first, last in others)


def _row(axes: Axes, strip: Axes, row: int, violation: Violation, few: bool, tinted: bool, angles: bool) -> list[Any]:
    """The bars of one BRDF, a sample of its line on the right, the shading below; returns the texts over the bars."""
    color = violation.style.color
    narrow = 0.004 * abs(np.subtract(*axes.get_xlim())) if axes.get_xscale() == "linear" else 0.0
    texts = []
    for low, high in violation.intervals:
        ends = (low - narrow / 2, high + narrow / 2) if high - low < narrow else (low, high)
        strip.plot(ends, [row + 0.80] * 2, linewidth=3.4, solid_capstyle="butt", color=color, zorder=3)
        if low == high:
            strip.plot([low], [row + 0.80], marker="s", markersize=4, color=color, zorder=3)
        for end in {low, high} - set(violation.edges):
            strip.plot([end] * 2, [row + 0.62, row + 0.98], color=color, linewidth=1.0, zorder=3)
            if few:
                axes.axvline(end, color=color, linewidth=0.7, linestyle=(0, (2, 2)), zorder=1.5)
        if tinted:
            axes.axvspan(*ends, color=color, alpha=0.10, linewidth=0, zorder=0.5)
        text = _ends(low, high, violation.edges, angles)
        if len(violation.intervals) == 1 and violation.largest:
            text += f", up to {violation.largest}"
        texts.append(
            strip.annotate(
                text, ((along(axes, low) + along(axes, high)) / 2, row + 0.60), xycoords=("axes fraction", "data"),
                ha="center", va="bottom", fontsize=7.5, color=ink(color), annotation_clip=False,
            )
        )  # fmt: skip
    if violation.sampled:  # its name is at the end of its curve, and once is enough
        name_beside(strip, "", violation.style, 1 - (row + 0.80) / strip.get_ylim()[0])
    return texts


def _ends(low: float, high: float, edges: Interval, angles: bool) -> str:
    if angles:  # as the axis runs: from normal incidence to grazing, which are ends by nature
        cosines = text_of(low, 4) if low == high else f"{text_of(high, 4)} … {text_of(low, 4)}"
        both = [degrees(value) + (" (edge)" if value in edges and value not in (0, 1) else "") for value in (high, low)]
        return f"{' … '.join(both)}, cos θ = {cosines}"
    if low == high:
        return text_of(low)
    if (low, high) == edges:
        return f"{text_of(low)} … {text_of(high)} (all)"
    return " … ".join(text_of(value) + (" (edge)" if value in edges else "") for value in (low, high))


def _settle(strip: Axes, texts: list[Any]) -> None:
    """Move the texts of a row as little as need be to stand inside and apart; where they cannot, one speaks for all."""
    frame = strip.get_window_extent()
    widths = [text.get_window_extent().width / frame.width + 0.03 for text in texts]
    if len(texts) > 1 and sum(widths) > 1:
        first, *others = texts
        first.set_text(f"{len(texts)} intervals: {texts[0].get_text()}, …, {texts[-1].get_text()}")
        for text in others:
            text.remove()
        widths, texts = [first.get_window_extent().width / frame.width], [first]
    half = np.array(widths) / 2
    place = apart([text.xy[0] for text in texts], half[:-1] + half[1:], half[0], 1 - half[-1])
    for text, centre in zip(texts, place, strict=True):
        text.xy = (centre, text.xy[1])
        text.set_position(text.xy)
