"""Do the published two-constant factors conserve energy, and what do the best ones lose?

Command: ``brdfcheck study normalized_albedo``. 4 s on two cores.

Answer: the 16th-power lobe with (n+6)/24.55, published as conserving, exceeds 1 for n in [14.303, 23.056], by up to 0.16 %
at n = 17.85. Blinn-Phong with (n+6)/8pi conserves, but reflects only 0.797 at n = 1. The factors that maximise the
minimum albedo conserve and reflect at least 0.9064 and 0.9424 on n in [1, 1000].

This is Fig. 4 of the proposal of the lobe, with the fitted factors beside the published ones.
"""

from __future__ import annotations

from typing import Any

import brdfcheck
from brdfcheck import plots
from brdfcheck.output import curves
from brdfcheck.plots import paper
from brdfcheck.plots.styles import ink, style_of
from brdfcheck.studies import table

NAMES = {
    "binomial-power-published": "binomial power, (n+6)/24.55",
    "blinn-phong-6": "Blinn-Phong, (n+6)/8π",
    "binomial-power-half": "binomial power, minimax",
    "blinn-phong-fitted": "Blinn-Phong, minimax",
}
FITTED = ("binomial-power-half", "blinn-phong-fitted")


def run(size: str = "full") -> dict[str, Any]:
    """The largest albedo over all angles against the exponent, and the best factors fitted anew."""
    samples = 241 if size == "full" else 41
    drawn = [{**curves.albedo_vs_n(name, samples=samples, n=(1.0, 1000.0)), "label": NAMES[name]} for name in NAMES]
    fits = {}
    for name in FITTED if size == "full" else FITTED[:1]:
        fit: Any = brdfcheck.fit_factor(name, n=(1, 1000), objective="minimax")
        fits[name] = {"A": float(fit.factor.A), "B": float(fit.factor.B), "peak": fit.peak, "smallest": fit.smallest}
    return {"settings": {"n": [1, 1000], "samples": samples}, "results": drawn, "summary": {"fits": fits}}


def plot(record: dict[str, Any]) -> Any:
    """The four curves, and the neighbourhood of the line at 1 enlarged."""
    figure = plots.figure("albedo-vs-n", record["results"])
    axes = figure.axes[0]
    with paper.house_style():
        near = axes.inset_axes((0.57, 0.07, 0.42, 0.36))
        for curve in record["results"]:
            style = style_of(curve["name"])
            (line,) = near.plot(curve["x"], curve["albedo"], color=style.color, linewidth=1.6)
            if style.dashes:
                line.set_dashes(style.dashes)
        published, style = record["results"][0], style_of("binomial-power-published")
        above = [(n, value) for n, value in zip(published["x"], published["albedo"], strict=True) if value >= 1]
        near.fill_between([n for n, _ in above], 1, [value for _, value in above], color=style.color, alpha=0.3, linewidth=0)
        near.axhline(1, color="black", linewidth=1.0)
        peak = published["largest"]
        near.annotate(
            f"{peak['albedo']:.5f} at n = {peak['at']['n']:.2f}", (peak["at"]["n"], peak["albedo"]), (0, 5),
            textcoords="offset points", ha="center", fontsize=7.5, color=ink(style.color),
        )  # fmt: skip
        near.set(xscale="log", xlim=(6, 36), ylim=(0.9955, 1.0027), yticks=[0.996, 0.998, 1, 1.002])
        near.set_xticks([6, 10, 20, 30], ["6", "10", "20", "30"])
        near.set_xticks([], minor=True)
        near.tick_params(labelsize=7.5)
        near.grid(True)
        # The frame alone: lines from it to the inset would cross the curves.
        for line in axes.indicate_inset_zoom(near, edgecolor="#888888").connectors or ():
            line.set_visible(False)
    return figure


def summary(record: dict[str, Any]) -> str:
    """Verdicts and the fitted constants."""
    rows = []
    for curve in record["results"]:
        most, least = curve["largest"], min(zip(curve["albedo"], curve["x"], strict=True))
        above = ", ".join(f"[{low:.3f}, {high:.3f}]" for low, high in curve["above"]) or "-"
        largest = f"{most['albedo']:.10f} ± {most['error']:.1e} at n = {most['at']['n']:.2f}"
        rows.append(
            (curve["label"], f"`{curve['name']}`", curve["verdict"], largest, above, f"{least[0]:.4f} at n = {least[1]:g}")
        )
    header = ("factor", "name", "verdict", "largest albedo", "above 1 for n in", "smallest of them")
    text = f"Largest albedo over all angles, for n in [1, 1000]:\n\n{table(header, rows)}\n\n"
    fits = record["summary"]["fits"]
    lines = [(f"`{name}`", f"{fit['A']:.6f}", f"{fit['B']:.6f}", f"{fit['smallest']:.6f}") for name, fit in fits.items()]
    best = table(("lobe of", "A", "B", "smallest albedo"), lines)
    return f"{text}The best factors (n+A)/B, fitted anew; the catalogue has them rounded to the safe side:\n\n{best}"
