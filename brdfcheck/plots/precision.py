"""Error against cost on double logarithmic axes, the Pareto frontier bold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from brdfcheck import plots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colour and marker of each rule, for life: families share a colour. Peers are hollow.
RULES: dict[str, tuple[str, str]] = {
    "uniform-monte-carlo": ("#CC79A7", "v"),
    "cosine-monte-carlo": ("#CC79A7", "^"),
    "lobe-monte-carlo": ("#882255", "D"),
    "sobol": ("#56B4E9", "<"),
    "r2-lattice": ("#56B4E9", ">"),
    "midpoint-product": ("#E69F00", "s"),
    "gauss-product": ("#E69F00", "P"),
    "lobe-warped-gauss": ("#009E73", "h"),
    "tanh-sinh": ("#999999", "d"),
    "adaptive": ("#0072B2", "o"),
    "zonal": ("#D55E00", "*"),
    "half-vector": ("#D55E00", "*"),
    "closed-form": ("#000000", "X"),
    "scipy-quad": ("#117733", "1"),
    "scipy-dblquad": ("#117733", "2"),
    "scipy-cubature": ("#117733", "3"),
    "quadax-nested": ("#332288", "1"),
    "quadax-cubature": ("#332288", "2"),
    "torchquad-gauss": ("#AA4499", "1"),
    "mitsuba": ("#661100", "1"),
}
# Where errors below the rounding of a double are drawn.
FLOOR = 1e-17
_COSTS = {"warm_seconds": "seconds for one albedo, warm", "evaluations": "evaluations of the BRDF"}


def frontier(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points (cost, error) that no other one beats in both, by rising cost."""
    kept: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if math.isfinite(error) and (not kept or error < kept[-1][1]):
            kept.append((cost, error))
    return kept


def figure(records: Sequence[Mapping[str, Any]], cost: str = "warm_seconds", columns: int = 3) -> Figure:
    """One panel for each case of the records: each rule's errors joined faintly, the frontier of all of them bold.

    `records`: objects of `WorkPrecision.to_json_object`. `cost`: "warm_seconds" or "evaluations".
    """
    from matplotlib.lines import Line2D

    cases = list(dict.fromkeys(record["case"] for record in records))
    lines = -(-len(cases) // columns)
    columns = min(columns, len(cases))
    drawn = plots.empty(3.3 * columns + 0.4, 2.75 * lines + 1.5)
    with plots.house_style():
        grid = drawn.subplots(lines, columns, squeeze=False, sharey=True)
        for axes, case in zip(grid.flat, cases, strict=False):
            _panel(axes, [record for record in records if record["case"] == case], cost)
            axes.set_title(case, fontsize=9)
        for axes in list(grid.flat)[len(cases) :]:
            axes.axis("off")
        for axes in grid[:, 0]:
            axes.set_ylabel("relative error")
        for axes in list(grid.flat)[max(len(cases) - columns, 0) : len(cases)]:
            axes.set_xlabel(_COSTS[cost], fontsize=9)
        names = [name for name in RULES if any(record["rule"] == name for record in records)]
        handles = [
            Line2D([], [], color=RULES[name][0], marker=RULES[name][1], linewidth=1, markersize=6, label=name) for name in names
        ]
        handles.append(Line2D([], [], color="black", linewidth=2.6, alpha=0.8, label="Pareto frontier"))
        drawn.legend(handles=handles, loc="lower center", ncols=min(5, len(handles)), fontsize=8, frameon=False)
        drawn.tight_layout(rect=(0, (0.15 + 0.21 * -(-len(handles) // 5)) / (2.75 * lines + 1.5), 1, 1))
    return drawn


def _panel(axes: Axes, records: Sequence[Mapping[str, Any]], cost: str) -> None:
    points: list[tuple[float, float]] = []
    for name, (color, marker) in RULES.items():
        own = [
            (max(float(record[cost]), 1.0 if cost == "evaluations" else 0.0), max(float(record["error"]), FLOOR))
            for record in records
            if record["rule"] == name and math.isfinite(float(record["error"]))
        ]
        if own:
            axes.plot(*zip(*own, strict=True), color=color, marker=marker, markersize=4.5, linewidth=0.8, alpha=0.75)
            points += own
    best = frontier(points)
    axes.plot(*zip(*best, strict=True), color="black", linewidth=2.6, alpha=0.8, zorder=1, drawstyle="steps-post")
    axes.set(xscale="log", yscale="log", ylim=(FLOOR / 3, 30))
    axes.set_yticks([1e-16, 1e-12, 1e-8, 1e-4, 1], [_power(place) for place in (-16, -12, -8, -4, 0)])
    axes.set_yticks([], minor=True)
    low, high = (math.log10(end) for end in axes.get_xlim())
    decades = [place for place in range(math.ceil(low), math.floor(high) + 1) if high - low < 5 or place % 2 == 0]
    axes.set_xticks([10.0**place for place in decades], [_power(place) for place in decades])
    axes.set_xticks([], minor=True)
    axes.grid(True)


def _power(exponent: int) -> str:
    """A power of ten in plain characters, which any output format draws as text."""
    return "1" if exponent == 0 else f"10{plots.superscript(exponent)}"
