"""A map of what became of a matrix of albedos: lobes and exponents down, angles across."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from brdfcheck import plots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# By the codes of `brdfcheck.stability.Outcome`.
OUTCOMES = {"holds": "#DDEBDD", "loses digits": "#F5C86E", "lies": "#882255", "breaks": "#222222"}
_INCHES = 0.052  # a line
_FOOT = 0.6


def outcome_map(results: Sequence[Mapping[str, Any]], lobes: Sequence[str]) -> Figure:
    """One panel for each method, float64 left and float32 right.

    `results`: mappings with method, lobe, dtype ("float64" or "float32") and outcomes, a string of digits for each exponent,
    one digit an angle (0 to 90 degrees, eight of them). `lobes`: those of the results, from the top.
    """
    methods = list(dict.fromkeys(result["method"] for result in results))
    rows = {lobe: max(len(result["outcomes"]) for result in results if result["lobe"] == lobe) for lobe in lobes}
    height = sum(rows.values())
    inches = _INCHES * height + 1.6
    figure = plots.empty(1.35 * len(methods) + 2.2, inches)
    with plots.house_style():
        from matplotlib.colors import ListedColormap
        from matplotlib.patches import Patch

        grid = figure.subplots(1, len(methods), sharey=True, squeeze=False)[0]
        for axes, method in zip(grid, methods, strict=True):
            picture = [[float("nan")] * 16 for _ in range(height)]
            for result in results:
                if result["method"] == method:
                    top = sum(rows[lobe] for lobe in lobes[: lobes.index(result["lobe"])])
                    shift = 0 if result["dtype"] == "float64" else 8
                    for line, cells in enumerate(result["outcomes"]):
                        for column, cell in enumerate(cells):
                            picture[top + line][shift + column] = float(cell)
            colors = ListedColormap(list(OUTCOMES.values()))
            axes.imshow(picture, aspect="auto", cmap=colors, vmin=-0.5, vmax=3.5, interpolation="nearest")
            axes.axvline(7.5, color="black", linewidth=0.8)
            place = 0
            for lobe in lobes:
                place += rows[lobe]
                axes.axhline(place - 0.5, color="white", linewidth=0.8)
            axes.set_title(method.replace(" ", "\n").replace("-", "-\n", 1) if "-" in method else f"{method}\n", fontsize=8)
            axes.set_xticks([0, 2, 7, 8, 10, 15], ["0", "45", "", "0", "45", "90°"], fontsize=6)
            axes.set_xlabel("f64     f32", fontsize=8)
        middles = [sum(rows[other] for other in lobes[:index]) + rows[lobe] / 2 - 0.5 for index, lobe in enumerate(lobes)]
        grid[0].set_yticks(middles, lobes, fontsize=7.5)
        grid[0].set_ylabel("within each lobe: n from 0.01 (top) to 10⁷, or m from 0.001 to 2", fontsize=9)
        handles = [Patch(facecolor=color, edgecolor="#888888", label=name) for name, color in OUTCOMES.items()]
        figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False, fontsize=9)
        figure.tight_layout(rect=(0, _FOOT / inches, 1, 1))
    return figure
