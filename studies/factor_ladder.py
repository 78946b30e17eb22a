"""How much energy does a cheaper normalisation factor lose, lobe by lobe?

Command: ``brdfcheck study factor_ladder``. Under a minute on two cores.

Answer: two constants lose 6 % (Blinn-Phong) to 14 % (Lyon, w = 1), 33 to 40 % for Schlick's heavy tail and two thirds or more
for Kuijk and Blake's; nothing for Phong, whose exact factor they are. Five more operations, a rational factor of degrees 2/1,
bring that below 1.4 % for all but these two (6.4 and 12 %), four more to 0.2 % (0.8 and 4.7 %). A closed form loses nothing;
for Blinn-Phong it takes 9 operations, for the piecewise lobes 35 to 274.

Cost is that of the factor alone, once a material: operations, and nanoseconds on one core. Loss is the
largest 1 - E at normal incidence over n in [1, 1000]. Every rung is the best of its form under E <= 1 over all angles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

import brdfcheck
from _instruments import charts
from brdfcheck.fits.ladder import cost
from brdfcheck.output.text import describe
from brdfcheck.plots import paper
from brdfcheck.plots.styles import ink, style_of
from brdfcheck.studies import table

NAMES = (
    "phong", "blinn-phong", "schlick-mirror", "schlick-half", "kuijk-blake-mirror", "kuijk-blake-half",
    "lyon-1-mirror", "lyon-1-half", "lyon-3-half",
    "binomial-power-mirror", "binomial-power-half",
)  # fmt: skip
LETTERS = {"constant": "c", "n/B": "n", "(n+A)/B": "A", "rational 2/1": "2", "rational 3/2": "3", "closed form": "="}
# What is lost less than this is rounding and the search's accuracy.
FLOOR = 1e-7


def run(size: str = "full") -> dict[str, Any]:
    """The ladders of all lobes that have an exponent, and what an exp costs in the same run."""
    results = []
    for name in NAMES if size == "full" else NAMES[:2]:
        rungs = [
            {
                "form": rung.form,
                "factor": describe(rung.factor, 8),
                "operations": rung.operations,
                "nanoseconds": round(rung.nanoseconds, 3),
                "lost": rung.lost,
                "at_n": rung.smallest_n,
                "verdict": rung.verdict.name,
            }
            for rung in brdfcheck.factor_ladder(name)
        ]
        results.append({"name": name, "rungs": rungs})
    return {
        "settings": {"n": [1, 1000]},
        "results": results,
        "summary": {"nanoseconds_of_an_exp": round(cost(lambda n: jnp.exp(-n / 1000)), 3)},
    }


def plot(record: dict[str, Any]) -> Any:
    """One panel a lobe: operations to the right, lost light upwards, a letter for each form."""
    results = record["results"]
    columns = min(len(results), 4)
    lines = -(-(len(results) + (len(results) > 4)) // columns)
    figure = paper.empty(2.75 * columns + 0.6, 2.3 * lines + 0.5)
    with paper.house_style():
        grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
        for axes, result in zip(grid.flat, results, strict=False):
            color = style_of(result["name"]).color
            places = [(rung["operations"] + 1, max(rung["lost"], FLOOR)) for rung in result["rungs"]]
            axes.plot(*zip(*charts.frontier(places), strict=True), color=color, linewidth=1.6, zorder=2)
            letters: dict[tuple[float, float], str] = {}
            for rung, place in zip(result["rungs"], places, strict=True):  # an exact factor may be two forms
                letters[place] = letters.get(place, "") + LETTERS[rung["form"]]
            for place, letter in letters.items():
                axes.plot(*place, marker="o", markersize=8 + 3 * len(letter), color="white", markeredgecolor=color, zorder=3)
                look = {"ha": "center", "va": "center_baseline", "color": ink(color), "zorder": 4}
                axes.annotate(letter, place, fontsize=9 - 1.5 * len(letter), **look)
            axes.set_title(result["name"], fontsize=9)
            axes.grid(True, which="major")
            axes.set(xscale="log", yscale="log", xlim=(0.6, 400), ylim=(FLOOR / 3, 3))
            axes.set_xticks([1, 2, 3, 8, 12, 101], ["0", "1", "2", "7", "11", "100"], fontsize=7)
            axes.set_yticks([1e-7, 1e-6, 1e-4, 1e-2, 1], ["0", "0.0001 %", "0.01 %", "1 %", "100 %"])
            axes.minorticks_off()
        spare = list(grid.flat)[len(results) :]
        for axes in spare:
            axes.axis("off")
        for axes in list(grid.flat)[max(len(results) - columns, 0) : len(results)]:
            axes.tick_params(labelbottom=True)
        figure.supxlabel("operations of the factor", fontsize=10)
        figure.supylabel("largest share of light lost at normal incidence, n in [1, 1000]", fontsize=10)
        words = "\n".join(f"{letter}   {form}" for form, letter in LETTERS.items())
        words += "\n\noff the line: a cheaper form\nloses no more"
        if spare:
            spare[0].annotate(words, (0.05, 0.95), xycoords="axes fraction", va="top", fontsize=9, linespacing=1.5)
        figure.tight_layout()
    return figure


def summary(record: dict[str, Any]) -> str:
    """The losses and the costs as tables."""
    results = record["results"]
    forms = list(LETTERS)

    def rows(told: Callable[[dict[str, Any]], str]) -> str:
        """A line a lobe, with what is told of each form that it has."""
        lines = []
        for result in results:
            rungs = {rung["form"]: told(rung) for rung in reversed(result["rungs"])}
            lines.append((f"`{result['name']}`", *(rungs.get(form, "-") for form in forms)))
        return table(("lobe", *forms), lines)

    losses = rows(lambda rung: "0" if rung["lost"] < 1e-12 else f"{rung['lost']:.2g}")
    costs = rows(lambda rung: f"{rung['operations']} / {rung['nanoseconds']:.1f}")
    factors = table(
        ("lobe", "form", "factor"),
        [(f"`{result['name']}`", rung["form"], f"`{rung['factor']}`") for result in results for rung in result["rungs"]],
    )
    return (
        "Largest share of the light lost at normal incidence, n in [1, 1000]; every factor conserves over all angles:"
        f"\n\n{losses}\n\nOperations / nanoseconds for one factor, float64, fused, over 10^6 exponents; an exp costs"
        f" {record['summary']['nanoseconds_of_an_exp']:.2f} ns in the same run:\n\n{costs}\n\nThe factors:\n\n{factors}"
    )
