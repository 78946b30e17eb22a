"""For which exponents does the raw 16th-power lobe reflect more than it receives?

Command: ``brdfcheck study raw_albedo``. 3 s on two cores.

Answer: for n below 18.588, not 17: at n = 17 the albedo of max(0, 1 + (n/16)(N.H - 1))^16 is still 1.0690. It falls
from 2.8777 at n = 1 to 0.02355 at n = 1000.

This is Fig. 3 of the proposal of the lobe: albedo at normal incidence, its worst angle, against the exponent.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import brdfcheck
from brdfcheck import plots
from brdfcheck.output import curves
from brdfcheck.plots import paper
from brdfcheck.plots.styles import ink, style_of
from brdfcheck.studies import table

NAME = "binomial-power-raw"
CLAIMED = 17.0
EXPONENTS = (1, 2, 5, 10, 17, 18, 19, 20, 50, 100, 200, 500, 1000)


def run(size: str = "full") -> dict[str, Any]:
    """The albedo over all angles and at normal incidence, and at the exponents of the table."""
    samples = 241 if size == "full" else 41
    normal = curves.albedo_vs_n(NAME, samples=samples, cos_theta=(1.0, 1.0))
    anywhere = curves.albedo_vs_n(NAME, samples=samples)
    table = brdfcheck.albedo_table(NAME, np.array(EXPONENTS, float), np.array([1.0]))
    values = np.asarray(table.value)[:, 0]
    return {
        "settings": {"n": [1, 1000], "samples": samples, "claimed": CLAIMED},
        "results": [{**normal, "label": "raw lobe, factor 1"}],
        "summary": {
            "crossing": normal["above"][0][1],
            "crossing_over_all_angles": anywhere["above"][0][1],
            "exponents": list(EXPONENTS),
            "albedo": values.tolist(),
            "largest_error": float(np.max(np.asarray(table.error))),
        },
    }


def plot(record: dict[str, Any]) -> Any:
    """The curve with the claimed end of the violation beside the true one, and the two enlarged."""
    figure = plots.figure("albedo-vs-n", record["results"])
    axes, (curve,), style = figure.axes[0], record["results"], style_of(NAME)
    crossing, claimed = record["summary"]["crossing"], record["settings"]["claimed"]
    at_claim = dict(zip(record["summary"]["exponents"], record["summary"]["albedo"], strict=True))[int(claimed)]
    with paper.house_style():
        near = axes.inset_axes((0.58, 0.44, 0.40, 0.50))
        near.plot(curve["x"], curve["albedo"], color=style.color, linewidth=1.8)
        near.axhline(1, color="black", linewidth=1.0)
        near.axvspan(near.get_xlim()[0], crossing, color=style.color, alpha=0.10, linewidth=0)
        near.axvline(crossing, color=style.color, linewidth=0.8, linestyle=(0, (2, 2)))
        for panel in (axes, near):
            panel.axvline(claimed, color="#333333", linewidth=1.0, linestyle=(0, (5, 2)))
        near.plot([claimed], [at_claim], marker="o", markersize=4.5, color="#333333")
        near.plot([crossing], [1], marker="o", markersize=4.5, color=style.color)
        left = {"fontsize": 8, "va": "center", "ha": "left"}
        arrow = {"arrowstyle": "-", "color": "#777777", "linewidth": 0.7, "shrinkB": 3}
        words = f"claimed: n = {claimed:g},\nwhere E = {at_claim:.4f}"
        near.annotate(words, (claimed, at_claim), (18.85, 1.085), arrowprops=arrow, **left)
        near.text(18.85, 1.018, f"true: n = {crossing:.3f}", color=ink(style.color), **left)
        near.set(xlim=(16, 21.5), ylim=(0.92, 1.12), xticks=[16, 17, 18, 19, 20, 21], yticks=[0.95, 1, 1.05, 1.1])
        near.tick_params(labelsize=7.5)
        near.grid(True)
        axes.indicate_inset_zoom(near, edgecolor="#BBBBBB")
    return figure


def summary(record: dict[str, Any]) -> str:
    """The crossing and a table."""
    found = record["summary"]
    rows = [(f"{n:g}", f"{value:.6f}") for n, value in zip(found["exponents"], found["albedo"], strict=True)]
    return (
        f"The raw albedo equals 1 at n = {found['crossing']:.6f}; the proposal of the lobe says that it breaks the law up to"
        f" n = {record['settings']['claimed']:g}. Over all angles the end is the same, {found['crossing_over_all_angles']:.6f}:"
        f" normal incidence is the worst. Albedos to ± {found['largest_error']:.1g}:\n\n"
        + table(("n", "albedo at normal incidence"), rows)
    )
