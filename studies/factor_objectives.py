"""Which fit could the published factor (n+6)/24.55 have come from, and what do the usual fits do to energy?

Command: ``brdfcheck study factor_objectives``. 10 s on two cores.

Answer: least squares of the albedo against 1 over the integers 1 to 1000 gives (n + 5.992)/23.781, which exceeds 1 by 3.4 %;
enlarged until it conserves it is (n + 5.992)/24.581, next to the published (6, 24.55): rounding A up and B down is what breaks
the law. The minimax factor (n + 7.243)/26.170 reflects at least 0.9064 of the light where that one drops to 0.8186.

Each objective (least squares of the albedo against 1, a straight line through 1/E, minimax) with each sampling of the
exponents of the 16th-power lobe, as fitted and after B has been enlarged until the factor conserves over all angles.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import brdfcheck
from brdfcheck.fits.factor import SAMPLINGS
from brdfcheck.plots import paper
from brdfcheck.studies import table

NAME = "binomial-power-raw"
SEED = (6.0, 24.55)
RANGES = ((1, 1000), (1, 100), (10, 1000))


def run(size: str = "full") -> dict[str, Any]:
    """All fits, with their distance to the published constants."""
    ranges = RANGES if size == "full" else RANGES[1:2]
    samplings = SAMPLINGS if size == "full" else SAMPLINGS[:1]
    results = []
    for limits in ranges:
        for objective in ("least-squares", "reciprocal", "minimax"):
            for sampling in samplings if objective != "minimax" else ("continuous",):
                options: Any = {"sampling": sampling} if objective != "minimax" else {}
                fit: Any = brdfcheck.fit_factor(NAME, limits, objective, **options)
                fitted, factor = ((float(part.A), float(part.B)) for part in (fit.fitted, fit.factor))
                results.append(
                    {
                        "n": list(limits),
                        "objective": objective,
                        "sampling": sampling,
                        "fitted": list(fitted),
                        "fitted_peak": fit.history[0].peak if objective != "minimax" else fit.peak,
                        "certified": list(factor),
                        "smallest": fit.smallest,
                        "smallest_n": fit.smallest_n,
                        "verdict": fit.verdict.name,
                        "distance": {"fitted": math.dist(fitted, SEED), "certified": math.dist(factor, SEED)},
                    }
                )
    nearest = min(results, key=lambda result: min(result["distance"].values()))
    return {"settings": {"published": list(SEED)}, "results": results, "summary": {"nearest": nearest}}


def plot(record: dict[str, Any]) -> Any:
    """The plane of A and B: each fit, its way to the certified factor, and the published constants."""
    colors = {"least-squares": "#0072B2", "reciprocal": "#E69F00", "minimax": "#009E73"}
    markers = {"geometric": "o", "linear": "s", "integers": "^", "continuous": "D"}
    figure = paper.empty(7.2, 5.0)
    with paper.house_style():
        axes = figure.subplots()
        wanted = record["results"][0]["n"]
        for result in record["results"]:
            if result["n"] != wanted:
                continue
            color, marker = colors[result["objective"]], markers[result["sampling"]]
            (a, low), (_, high) = result["fitted"], result["certified"]
            label = result["objective"] + (f", {result['sampling']}" if result["objective"] != "minimax" else "")
            axes.annotate("", (a, high), (a, low), arrowprops={"arrowstyle": "->", "color": color, "linewidth": 1.2})
            size = 11 if marker == "^" else 7  # it may have another one on it
            axes.plot(a, low, marker=marker, color="white", markeredgecolor=color, markersize=size, linestyle="none")
            look = {"markeredgecolor": "white", "markeredgewidth": 0.6, "zorder": 2.5 if marker == "^" else 3}
            axes.plot(a, high, marker=marker, color=color, markersize=size, linestyle="none", label=label, **look)
        for one, other in itertools.combinations([r for r in record["results"] if r["n"] == wanted], 2):
            (a, b), (c, d) = one["certified"], other["certified"]
            if abs(a - c) < 0.02 and abs(b - d) < 0.02:
                text = f"{one['objective']}, {one['sampling']}\nand {other['sampling']}: nearly the same"
                axes.annotate(text, (max(a, c), b), (9, 0), textcoords="offset points", va="center", fontsize=8)
        star = {"marker": "*", "markersize": 24, "color": "none", "markeredgecolor": "#D55E00"}  # one of the fits is inside
        axes.plot(*record["settings"]["published"], **star, zorder=5)
        axes.annotate(
            "published: (6, 24.55)", record["settings"]["published"], (-13, 2), textcoords="offset points", ha="right",
            color="#A34700",
        )  # fmt: skip
        axes.set(xlabel="A", ylabel="B", title=f"(n+A)/B for the 16th-power lobe, n in [{wanted[0]}, {wanted[1]}]")
        axes.margins(0.12)
        axes.grid(True)
        axes.legend(
            title="open: as fitted; filled: enlarged until it conserves", fontsize=8, title_fontsize=8, loc="upper left"
        )
        figure.tight_layout()
    return figure


def summary(record: dict[str, Any]) -> str:
    """All fits as a table, and the nearest."""
    rows = []
    for result in record["results"]:
        (a, b), (c, d) = result["fitted"], result["certified"]
        rows.append(
            (
                f"[{result['n'][0]}, {result['n'][1]}]",
                result["objective"],
                result["sampling"],
                f"({a:.4f}, {b:.4f})",
                f"{result['fitted_peak']:.5f}",
                f"({c:.4f}, {d:.4f})",
                f"{result['smallest']:.4f} at n = {result['smallest_n']:.3g}",
                f"{result['distance']['fitted']:.3f} / {result['distance']['certified']:.3f}",
            )
        )
    near = record["summary"]["nearest"]
    stage = min(near["distance"], key=near["distance"].get)
    a, b = near[stage]
    header = (
        "n", "objective", "sampling", "(A, B) as fitted", "its peak", "(A, B) that conserves", "smallest albedo",
        "distance to (6, 24.55): as fitted / that conserves",
    )  # fmt: skip
    return (
        f"Nearest to the published (6, 24.55): {near['objective']}, {near['sampling']} sampling of n in [{near['n'][0]},"
        f" {near['n'][1]}], {stage}: ({a:.4f}, {b:.4f}), {near['distance'][stage]:.3f} away.\n\n{table(header, rows)}"
    )
