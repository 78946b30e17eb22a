"""Error against cost on double logarithmic axes, the Pareto frontier bold."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from _instruments.peers import PEERS
from brdfcheck.plots import paper

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colour and marker of each rule, for life: lattices share a colour, as do plain Monte Carlo rules. Peers are hollow.
RULES: dict[str, tuple[str, str]] = {
    "uniform-monte-carlo": ("#CC79A7", "v"),
    "cosine-monte-carlo": ("#CC79A7", "^"),
    "lobe-monte-carlo": ("#882255", "D"),
    "sobol": ("#56B4E9", "<"),
    "r2-lattice": ("#56B4E9", ">"),
    "midpoint-product": ("#E69F00", "s"),
    "gauss-product": ("#A6C100", "P"),
    "lobe-warped-gauss": ("#009E73", "h"),
    "tanh-sinh": ("#999999", "d"),
    "adaptive": ("#0072B2", "o"),
    "zonal": ("#D55E00", "*"),
    "half-vector": ("#8C2D04", "p"),
    "closed-form": ("#000000", "X"),
    "scipy-quad": ("#117733", "^"),
    "scipy-dblquad": ("#44AA99", "s"),
    "scipy-cubature": ("#808000", "D"),
    "quadax-nested": ("#332288", "o"),
    "quadax-cubature": ("#6666CC", "h"),
    "torchquad-gauss": ("#AA4499", "P"),
    "mitsuba": ("#661100", "v"),
}
# Where errors below the rounding of a double are drawn.
FLOOR = 1e-17
_NO_DIGIT = 0.5
_COLUMNS = 3
# Sixteen units in the last place: which error below is the smallest is luck.
ROUNDING = {"float64": 2.0**-48, "float32": 2.0**-19}
_COSTS = {
    "warm_seconds": "seconds for one albedo, warm",
    "batched_seconds": "seconds for each albedo of a batch",
    "evaluations": "evaluations of the BRDF",
}


def frontier(points: Sequence[tuple[float, float]], rounding: float = 0.0, most: float = math.inf) -> list[tuple[float, float]]:
    """The points (cost, error) that no other one beats in both, by rising cost; errors above `most` do not count.

    Which of several errors below `rounding` is the smallest is luck: they count as equal.
    """
    kept: list[tuple[float, float]] = []
    for cost, error in sorted((cost, max(error, rounding)) for cost, error in points if math.isfinite(error) and error <= most):
        if not kept or error < kept[-1][1]:
            kept.append((cost, error))
    return kept


def apart(rising: Sequence[float], factor: float) -> list[float]:
    """Numbers on a logarithmic axis moved apart to a factor at least: neighbours keep the middle of their bunch."""
    places = [math.log(value) for value in rising]
    return [math.exp(place) for place in paper.apart(places, math.log(factor), -math.inf, math.inf)]


def label_places(
    points: Sequence[tuple[float, float, str]], columns: Mapping[str, Callable[[Iterable[float]], float]], factor: float
) -> list[tuple[float, float]]:
    """Where to label points (x, y, kind) on a logarithmic y axis: there; of the kinds in `columns` at one x, moved `apart`.

    `columns`: which x of a kind's points is that of its column, `min` or `max`.
    """
    places = [(x, y) for x, y, _ in points]
    for kind, column in columns.items():
        own = sorted((y, i) for i, (_, y, of) in enumerate(points) if of == kind)
        for (_, i), y in zip(own, apart([y for y, _ in own], factor), strict=True):
            places[i] = (column(points[j][0] for _, j in own), y)
    return places


def figure(records: Sequence[Mapping[str, Any]], cost: str = "warm_seconds") -> Figure:
    """One panel for each case of the records: each rule's errors joined faintly, the frontier of all of them bold.

    `records`: of `_instruments.work_precision.measure`. `cost`: one of `_COSTS`.
    """
    from matplotlib.lines import Line2D

    cases = list(dict.fromkeys(record["case"] for record in records))
    lines, columns = -(-len(cases) // _COLUMNS), min(_COLUMNS, len(cases))
    drawn = paper.empty(3.3 * columns + 0.4, 2.75 * lines + 0.4)
    with paper.house_style():
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
        handles = [Line2D([], [], linewidth=1, markersize=6, label=name, **_look(name)) for name in names]
        handles.append(Line2D([], [], color="black", linewidth=2.6, alpha=0.8, label="Pareto frontier"))
        look: dict[str, Any] = {"handles": handles, "fontsize": 8, "frameon": False}
        if empty := list(grid.flat)[len(cases) :]:
            drawn.tight_layout()
            first, last = empty[0].get_position(), empty[-1].get_position()
            place = (first.x0, first.y0, last.x1 - first.x0, first.height)
            drawn.legend(loc="center", bbox_to_anchor=place, ncols=min(len(empty), 3) if len(empty) > 1 else 2, **look)
        else:
            drawn.set_figheight(2.75 * lines + 1.5)
            drawn.legend(loc="lower center", ncols=min(5, len(handles)), **look)
            drawn.tight_layout(rect=(0, (0.15 + 0.21 * -(-len(handles) // 5)) / (2.75 * lines + 1.5), 1, 1))
    return drawn


def _look(name: str) -> dict[str, Any]:
    color, marker = RULES[name]
    return {"color": color, "marker": marker, "markerfacecolor": "white" if name in PEERS else color}


def _panel(axes: Axes, records: Sequence[Mapping[str, Any]], cost: str) -> None:
    points: list[tuple[float, float]] = []
    for name in RULES:
        own = [
            (max(float(record[cost]), 1.0 if cost == "evaluations" else 0.0), max(float(record["error"]), FLOOR))
            for record in records
            if record["rule"] == name and math.isfinite(float(record["error"]))
        ]
        if own:
            axes.plot(*zip(*own, strict=True), markersize=4.5, linewidth=0.8, alpha=0.75, **_look(name))
            points += own
    best = frontier(points, ROUNDING[records[0]["dtype"]], _NO_DIGIT)
    axes.plot(
        *zip(*best or [(1.0, math.nan)], strict=True),
        color="black",
        linewidth=2.6,
        alpha=0.8,
        zorder=1,
        drawstyle="steps-post",
        marker="s",
        markersize=3,
    )
    axes.set(xscale="log", yscale="log", ylim=(FLOOR / 3, 30))
    paper.decades(axes.set_yticks, (-16, -12, -8, -4, 0))
    axes.set_yticks([], minor=True)
    low, high = (math.log10(end) for end in axes.get_xlim())
    decades = [place for place in range(math.ceil(low), math.floor(high) + 1) if high - low < 5 or place % 2 == 0]
    paper.decades(axes.set_xticks, decades)
    axes.set_xticks([], minor=True)
    axes.grid(True)
