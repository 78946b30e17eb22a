"""Verdicts of many BRDFs side by side."""

from __future__ import annotations

from typing import Any

from brdfcheck.plots import paper

COLOURS = {"CONSERVES": "#009E73", "VIOLATES": "#D55E00", "UNDECIDED": "#777777"}
CEILING = 4.0  # of the axis, which may end sooner; what lies above is an arrow


def plot(record: dict[str, Any]) -> Any:
    """The largest albedo of each result of a record, with the line at 1."""

    rows = [row for row in record["results"] if row["verdict"]]
    with paper.house_style():
        figure = paper.empty(7.0, 0.28 * len(rows) + 1.0)
        axes = figure.subplots()
        most = min(1.1 * max([1.0, *(float(row["albedo"]) for row in rows)]), CEILING)
        for place, row in enumerate(rows):
            value, colour = float(row["albedo"]), COLOURS[row["verdict"]]
            shown = min(value, CEILING)
            axes.plot([0, shown], [place, place], color=colour, linewidth=2.5, solid_capstyle="butt")
            axes.plot([shown], [place], marker=">" if value > CEILING else "o", color=colour, markersize=6)
            axes.text(1.01, place, told(row), transform=axes.get_yaxis_transform(), fontsize=7, va="center", color=colour)
        axes.axvline(1, color="black", linewidth=1.0)
        axes.set(xlim=(0, most * 1.03), ylim=(len(rows) - 0.4, -0.6), xlabel="largest directional albedo")
        axes.set_yticks(range(len(rows)), [row["name"] for row in rows], fontsize=7.5)
        axes.tick_params(axis="y", length=0)
    return figure


def told(row: dict[str, Any]) -> str:
    """The verdict on a row of results and its largest albedo."""
    value = float(row["albedo"])
    return f"{row['verdict']}, {'no bound' if value == float('inf') else f'{value:.6f}'}"
