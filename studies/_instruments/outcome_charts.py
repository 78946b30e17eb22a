"""Maps of what became of a matrix of albedos and derivatives, and the shares of each outcome."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from brdfcheck import plots
from brdfcheck.plots import paper
from brdfcheck.plots.styles import superscript
from brdfcheck.studies import table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# By the codes of `_instruments.stability.outcomes.Outcome`.
OUTCOMES = {"holds": "#DDEBDD", "loses digits": "#F5C86E", "lies": "#882255", "breaks": "#222222"}
CELLS = (
    "Cells of the matrix by outcome. Holds: relative error at most 1e-8 in float64, 1e-4 in float32. Lies: wrong by more"
    " than the rule's own claim. Breaks: not finite, or wrong by half. Left out: cells for which a rule has no formula."
)
"""What the outcomes of albedos mean, for a page."""
_PRECISIONS = ("float64", "float32")
_LEFT_OUT = "left out"
_ACROSS = 4
_ROW = 0.13  # inches, as are the next two
_PANEL = 2.1
_LEAST_WIDTH = 6.6  # for the legend
_WIDEST = 800  # pixels: flat colours and few words need no more


def _short(value: float) -> str:
    """A parameter as a tick: 17.85, 10⁵."""
    exponent = f"{value:e}".partition("e")
    if value >= 1e3 and float(exponent[0]) == 1:
        return f"10{superscript(int(exponent[2]))}"
    return f"{value:g}"


def _legend(figure: Figure, others: Mapping[str, str] = MappingProxyType({})) -> None:
    """What the colours mean; `others`: more of them."""
    from matplotlib.patches import Patch

    known = {**OUTCOMES, **others}
    handles = [Patch(facecolor=color, edgecolor="#888888", label=name) for name, color in known.items()]
    figure.legend(handles=handles, loc="lower center", ncols=len(known), frameon=False, fontsize=9, handlelength=2.4)


def plot(record: Mapping[str, Any]) -> Figure:
    """A bar for each method, precision and quantity: which part of its cells became what.

    The results of the record: mappings with method, dtype, `of` ("value", "d/dn", "d/dtheta") and outcomes, strings of digits,
    "-" for a cell that is left out.
    """
    results = record["results"]
    methods = list(dict.fromkeys(result["method"] for result in results))
    quantities = list(dict.fromkeys(result["of"] for result in results))
    inches = 0.36 * len(methods) + 1.5
    figure = paper.empty(max(3.1 * len(quantities) + 1.4, _LEAST_WIDTH), inches)
    with paper.house_style():
        grid = figure.subplots(1, len(quantities), sharey=True, squeeze=False)[0]
        for axes, quantity in zip(grid, quantities, strict=True):
            for place, method in enumerate(methods):
                for shift, dtype in zip((-0.2, 0.2), _PRECISIONS, strict=True):
                    own = [r for r in results if (r["method"], r["of"], r["dtype"]) == (method, quantity, dtype)]
                    cells = "".join(row for result in own for row in result["outcomes"]).replace("-", "")
                    left = 0.0
                    for code, color in enumerate(OUTCOMES.values()):
                        part = 100 * cells.count(str(code)) / max(len(cells), 1)
                        axes.barh(place + shift, part, 0.36, left=left, color=color, edgecolor="#888888", linewidth=0.3)
                        left += part
            axes.set(title=quantity.replace("theta", "θ"), xlim=(0, 100), xlabel="% of the cells")
        grid[0].set_yticks(range(len(methods)), methods, fontsize=8)
        grid[0].set_ylim(len(methods) - 0.5, -0.5)
        grid[0].set_ylabel("above: float64\nbelow: float32", fontsize=7)
        _legend(figure)
        figure.tight_layout(rect=(0, 0.35 / inches, 1, 1))
    return figure


def pictures(record: Mapping[str, Any]) -> dict[str, bytes]:
    """An `outcome_map` as PNG for each method of the record of which not everything holds."""
    results, settings = record["results"], record["settings"]
    return {
        _file_of(method): plots.to_bytes(
            outcome_map(method, results, settings["lobes"], settings["angles"]), ".png", widest=_WIDEST
        )
        for method in dict.fromkeys(result["method"] for result in results if set("".join(result["outcomes"])) - {"0", "-"})
    }


def page(record: Mapping[str, Any], *words: str) -> str:
    """The counts of a record below the first of these words, the others, and the map of each method; or that all holds."""
    counts = record["summary"]["counts"]
    rows = [(f"`{row['method']}`", *(str(value) for key, value in row.items() if key != "method")) for row in counts]
    failed = dict.fromkeys((row["method"] for row in counts), 0)
    for row in counts:
        failed[row["method"]] += sum(row[name] for name in OUTCOMES if name != "holds")
    maps = (
        f"`{method}`:\n\n![{method}]({_file_of(method)})" if count else f"`{method}`: all that was looked at holds."
        for method, count in failed.items()
    )
    return "\n\n".join((words[0], table(("method", "of", "precision", *OUTCOMES), rows), *words[1:], *maps))


def _file_of(method: str) -> str:
    return method.replace(", ", "-").replace(" ", "-") + ".png"


def outcome_map(
    method: str, results: Sequence[Mapping[str, Any]], lobes: Mapping[str, Mapping[str, Any]], angles: Sequence[float]
) -> Figure:
    """A panel for each lobe of which not all holds: parameters down; across, the angles of each quantity and precision.

    What was left out is white. The lobes of which all holds are named below.

    `results` as in `plot`, with the lobe of each; `lobes`: label and parameters by name; `angles` in degrees.
    """
    own = [result for result in results if result["method"] == method]
    failed = {result["lobe"] for result in own if set("".join(result["outcomes"])) - {"0", "-"}}
    every = list(dict.fromkeys(result["lobe"] for result in own))
    names = [name for name in every if name in failed] or every
    whole = [lobes[name]["label"].replace(" = ", "\u00a0=\u00a0") for name in every if name not in names]
    blocks = list(dict.fromkeys((result["of"], result["dtype"]) for result in own))
    blocks.sort(key=lambda block: (["value", "d/dn", "d/dtheta"].index(block[0]), _PRECISIONS.index(block[1])))
    count, holes = len(angles), False
    across = min(_ACROSS, len(names))
    down = -(-len(names) // across)
    width = max(across * _PANEL + 0.4, _LEAST_WIDTH)
    head = paper.wrapped(f"{method}: exponent n (or slope m) down; in each column the angles {_listed(angles)}°", width, 9)
    foot = paper.wrapped(f"All holds for {'; '.join(whole)}.", width, 7.5) if whole else ""
    above, below = 0.17 * (head.count("\n") + 1) + 0.1, 0.35 + (0.14 * (foot.count("\n") + 1) + 0.1 if foot else 0)
    inches = down * (12 * _ROW + 0.75) + above + below
    figure = paper.empty(width, inches)
    with paper.house_style():
        from matplotlib.colors import ListedColormap

        colors = ListedColormap(list(OUTCOMES.values()))
        grid = figure.subplots(down, across, squeeze=False).ravel()
        for axes, name in zip(grid, names, strict=False):
            parameters = lobes[name]["parameters"]
            picture = [[float("nan")] * (count * len(blocks)) for _ in parameters]
            for result in own:
                if result["lobe"] == name and (result["of"], result["dtype"]) in blocks:
                    shift = count * blocks.index((result["of"], result["dtype"]))
                    for line, cells in enumerate(result["outcomes"]):
                        for column, cell in enumerate(cells):
                            picture[line][shift + column] = float("nan") if cell == "-" else float(cell)
            holes = holes or any(cell != cell for line in picture for cell in line)
            axes.imshow(picture, aspect="auto", cmap=colors, vmin=-0.5, vmax=3.5, interpolation="nearest")
            for block in range(1, len(blocks)):
                axes.axvline(block * count - 0.5, color="black" if block % 2 == 0 else "#888888", linewidth=0.7)
            axes.set_title(lobes[name]["label"], fontsize=8)
            axes.set_yticks(range(len(parameters)), [_short(value) for value in parameters], fontsize=6.5)
            labels = [f"{of.replace('theta', 'θ')}\n{dtype}" for of, dtype in blocks]
            axes.set_xticks([block * count + (count - 1) / 2 for block in range(len(blocks))], labels, fontsize=6.5)
            axes.tick_params(length=1.5)
        for axes in grid[len(names) :]:
            axes.axis("off")
        figure.set_layout_engine("none")
        figure.text(0.5, 1 - 0.06 / inches, head, ha="center", va="top", fontsize=9)
        if foot:
            figure.text(0.5, 0.37 / inches, foot, ha="center", va="bottom", fontsize=7.5, color="#444444")
        _legend(figure, {_LEFT_OUT: "white"} if holes else {})
        figure.tight_layout(rect=(0, below / inches, 1, 1 - above / inches))
    return figure


def _listed(angles: Sequence[float]) -> str:
    return ", ".join(f"{angle:g}" for angle in angles)
