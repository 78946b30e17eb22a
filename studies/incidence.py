"""For which lobes is normal incidence not the worst angle?

Command: ``brdfcheck study incidence``. 20 s on two cores.

Answer: for the microfacet lobes, whose albedo at grazing is up to 2.0 (Smith), 2.2 (V-cavities, Smith correlated) and
3.3 times (GGX) that at normal incidence; for the 16th power without max(0, .) (1.5e12 times), classical Phong divided by
N.L (18.7) and Cook-Torrance without masking (26.4). For the 14 clamped lobes it is the worst, for Lambert as bad as any.

Published checks look at normal incidence only. Here: the albedo over all angles of every lobe of the catalogue (factors
that change neither the lobe nor the worst angle left out), and the largest ratio to normal incidence over the parameter.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import brdfcheck
from brdfcheck.output import curves
from brdfcheck.plots import paper
from brdfcheck.plots.styles import looks
from brdfcheck.studies import table

# Of the published claims those that are other functions of the directions than the validated lobes.
OTHERS = ("binomial-power-unclamped", "phong-classical", "cook-torrance-no-masking")
TOP = 1.3  # the axis of albedos ends here
_EQUAL = 1e-6  # a ratio that is one for the eye


def _names(size: str) -> list[str]:
    if size == "small":
        return ["lambert", "phong", "binomial-power-half", "binomial-power-unclamped", "phong-classical", "beckmann-smith"]
    opaque = [entry for entry in brdfcheck.catalog.entries() if entry.family.surface is None]
    known = [entry.name for entry in opaque if entry.validated and entry.name != "blinn-phong-fitted"]
    return [*known, *OTHERS]


def run(size: str = "full") -> dict[str, Any]:
    """Curves over the angles for a few values of the parameter; and for all of them, how much worse the worst angle is."""
    results, ratios, points = [], {}, 65 if size == "full" else 17
    for name in _names(size):
        family = brdfcheck.catalog.entry(name).family
        ((parameter, bounds),) = family.ranges.items()
        low, high = (max(bounds[0], 1.0), min(bounds[1], 1000.0)) if parameter == "n" else bounds
        values = curves.round_values(low, high, 4 if size == "full" else 2)
        for value in values if parameter != "reflectance" else [1.0]:
            at: Any = {parameter: value}
            results.append(curves.albedo_vs_angle(name, samples=points, **at))
        options: Any = {"samples": 61 if size == "full" else 9, parameter: (low, high)}
        worst, normal = curves.albedo_vs_n(name, **options), curves.albedo_vs_n(name, cos_theta=(1.0, 1.0), **options)
        # The two have their own extra places: compare where both are.
        there = dict(zip(normal["x"], normal["albedo"], strict=True))
        rows = [
            (albedo / there[x], x, cosine)
            for x, albedo, cosine in zip(worst["x"], worst["albedo"], worst["worst_cos_theta"], strict=True)
            if there.get(x)
        ]
        ratio, x, cosine = max(rows)
        ratios[name] = {"parameter": parameter, "ratio": ratio, "at": x, "angle_degrees": math.degrees(math.acos(cosine))}
    return {"settings": {"samples": points}, "results": results, "summary": {"ratios": ratios}}


def plot(record: dict[str, Any]) -> Any:
    """A panel a lobe, light to dark along the parameter, a dot at the worst angle of each curve."""
    ratios = record["summary"]["ratios"]
    columns = min(len(ratios), 4)
    rows = math.ceil(len(ratios) / columns)
    with paper.house_style():
        figure = paper.empty(2.0 * columns + 0.3, 1.95 * rows + 0.7)
        panels = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel()
        for axes, name in zip(panels, ratios, strict=False):
            curves = [curve for curve in record["results"] if curve["name"] == name]
            above = []
            for curve, style in zip(curves, looks(curves), strict=True):
                x, y = np.array(curve["x"], float), np.array(curve["albedo"], float)
                violates = bool(np.max(y) > 1 + _EQUAL)
                axes.plot(x, y, color=style.color, linewidth=2.2 if violates else 1.3)
                worst = int(np.flatnonzero(y >= np.max(y) - 1e-9)[-1])  # of equal ones the nearest to normal incidence
                if y[worst] <= TOP:
                    axes.plot([x[worst]], [y[worst]], marker="o", markersize=3.6, color=style.color, clip_on=False, zorder=4)
                if violates:
                    above.append(f"{next(iter(curve['at'].values())):g}")
            axes.axhline(1, color="black", linewidth=0.8)
            axes.axhspan(1, TOP, color="#D55E00", alpha=0.07, linewidth=0)
            found = ratios[name]
            elsewhere = found["ratio"] > 1 + _EQUAL
            # Above the axes: within them there is always a curve in the way.
            values = ", ".join(f"{next(iter(curve['at'].values())):g}" for curve in curves)
            lines = [f"{found['parameter']} = {values}"]
            lines += [f"×{paper.text_of(found['ratio'], 3)} at {found['angle_degrees']:.3g}°"] if elsewhere else []
            lines += ["violates: all" if len(above) == len(curves) else f"violates: {', '.join(above)}"] if above else []
            axes.set_title(name, fontsize=8, fontweight="bold" if elsewhere else "normal", pad=4 + 9.5 * len(lines))
            for line, text in enumerate(reversed(lines)):
                color = "#A34700" if text.startswith("violates") else "#333333"
                place: Any = {"xycoords": "axes fraction", "textcoords": "offset points", "ha": "center", "va": "bottom"}
                axes.annotate(text, (0.5, 1), (0, 2 + 9.5 * line), fontsize=7, color=color, **place)
            axes.grid(True)
        for axes in panels[len(ratios) :]:
            axes.set_visible(False)
        panels[0].set(xlim=(1, 0), ylim=(0, TOP), yticks=[0, 0.5, 1])
        panels[0].set_xticks([1, 0.5, 0], ["1", "0.5", "0"])
        for axes in panels[len(ratios) - columns : len(ratios)]:  # those with nothing below them
            axes.tick_params(labelbottom=True)
        where = "cos θ, from normal (left) to grazing; light to dark in the order of the values listed; dot: the worst angle"
        what = "bold name: some value's worst angle is not the normal, and by what factor; thick line: the albedo exceeds 1"
        figure.supxlabel(f"{where}\n{what}", fontsize=8.5)
        figure.supylabel("directional albedo E", fontsize=9)
    return figure


def summary(record: dict[str, Any]) -> str:
    """Which lobes are worst elsewhere, and by how much."""
    ratios = record["summary"]["ratios"]
    rows = [
        (f"`{name}`", f"{found['ratio']:.6g}", f"{found['parameter']} = {found['at']:.4g}", f"{found['angle_degrees']:.4g}°")
        for name, found in sorted(ratios.items(), key=lambda item: -item[1]["ratio"])
        if found["ratio"] > 1 + _EQUAL
    ]
    others = ", ".join(f"`{name}`" for name, found in ratios.items() if found["ratio"] <= 1 + _EQUAL)
    header = ("BRDF", "worst albedo / albedo at normal incidence", "largest at", "worst angle")
    text = f"Normal incidence is not the worst angle for {len(rows)} of {len(ratios)} lobes:"
    return f"{text}\n\n{table(header, rows)}\n\nIt is for {others}."
