"""What of the literature's claims about normalised BRDFs holds?

Command: ``brdfcheck study published_claims``. 8 s on two cores.

Answer: 3 of 13 hold. The 16th-power lobe with (n+6)/24.55 misses by 0.16 %, Blinn-Phong with (n+8)/8pi by 7.5 %; the
factor of the facet distribution makes it 3.98, Schlick's lobe with the power's factor 5.44, classical Phong read as a
BRDF 18.7, Cook-Torrance as printed 4 and without its masking 16.7; the 16th power without max(0, .) reaches 6.7e28.

The audit of the catalogue (``brdfcheck audit``) as a figure: the largest albedo over all angles and the whole range.
"""

from __future__ import annotations

import math
from typing import Any

import brdfcheck
from brdfcheck.output import records
from brdfcheck.plots import paper
from brdfcheck.plots.styles import style_of
from brdfcheck.studies import table

MOST = 30.0  # the axis of albedos ends here


def run(size: str = "full") -> dict[str, Any]:
    """The verdict on every published claim of the catalogue (small: on four of them)."""
    claims = [entry for entry in brdfcheck.catalog.entries() if entry.claim]
    results = []
    for entry in claims if size == "full" else claims[:4]:
        report = records.to_json_object(brdfcheck.check(entry.name))
        results.append({**report, "claim": entry.claim, "formula": entry.formula, "source": entry.source, "seconds": None})
    violate = sum(result["verdict"] == "VIOLATES" for result in results)
    return {"results": results, "summary": {"claims": len(results), "violate": violate, "hold": len(results) - violate}}


def plot(record: dict[str, Any]) -> Any:
    """A row a claim: the exponents for which it fails, and the largest albedo."""
    claims = sorted(record["results"], key=lambda claim: -float(claim["albedo"]))
    with paper.house_style():
        figure = paper.empty(8.0, 0.42 * len(claims) + 0.8)
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1, 1.05))
        for row, claim in enumerate(claims):
            color, _, marker = style_of(claim["name"])
            bar = {"linewidth": 5, "solid_capstyle": "butt"}
            left.plot([0, 1], [row, row], color="#DDDDDD", **bar)
            ((low, high),) = claim["ranges"].values()
            for start, end in claim["above"] or ():
                place = [_along(value, low, high) for value in (start, end)]
                left.plot([place[0], max(place[1], place[0] + 0.008)], [row, row], color=color, **bar)
            left.text(0, row - 0.2, _ends(claim, 4), fontsize=7, va="bottom", color="#333333")
            albedo, filled = float(claim["albedo"]), claim["verdict"] == "VIOLATES"
            shown, far = min(albedo, MOST), albedo > 5
            right.plot([1, shown], [row, row], color=color, linewidth=1.4)
            look = {"color": color, "markerfacecolor": color if filled else "white", "clip_on": False, "zorder": 3}
            right.plot([shown], [row], marker=">" if albedo > MOST else marker, markersize=7, **look)
            text = f"{paper.text_of(albedo, 5)} at {_place(claim, 4)}"
            shift, across, up = ((-6, 6), "right", "bottom") if far else ((8, 0), "left", "center")
            right.annotate(text, (shown, row), shift, textcoords="offset points", fontsize=7.5, ha=across, va=up)
        right.axvline(1, color="black", linewidth=1.0)
        right.set(xscale="log", xlim=(0.85, MOST), xlabel="largest albedo E over all angles\n(hollow: conserves)")
        right.set_xticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
        right.set_xticks([], minor=True)
        right.grid(True, axis="x")
        left.set(xlim=(0, 1), ylim=(len(claims) - 0.4, -0.75), xticks=[])
        left.set_xlabel("where E > 1 in the range claimed,\nn in [1, 1000] or m in [0.05, 1]")
        left.set_yticks(range(len(claims)), [f"{claim['name']}\n“{claim['claim']}”" for claim in claims], fontsize=7.5)
        for axes in (left, right):
            axes.tick_params(axis="y", length=0)
            axes.spines["left"].set_visible(False)
        left.spines["bottom"].set_visible(False)
    return figure


def _along(value: float, low: float, high: float) -> float:
    """A place in the parameter's range from 0 to 1, logarithmic where the range is long."""
    return math.log(value / low) / math.log(high / low) if high / low > 25 else (value - low) / (high - low)


def _place(claim: dict[str, Any], digits: int) -> str:
    ((name, value),) = claim["parameters"].items()
    return f"{name} = {value:.{digits}g}, {claim['angle_degrees']:.3g}°"


def _ends(claim: dict[str, Any], digits: int) -> str:
    ((parameter, bounds),) = claim["ranges"].items()
    if not claim["above"]:
        return "nowhere"
    if claim["above"] == [bounds]:
        return f"for all {parameter}"
    return f"{parameter} = " + ", ".join(f"{start:.{digits}g} … {end:.{digits}g}" for start, end in claim["above"])


def summary(record: dict[str, Any]) -> str:
    """The audit as a table."""
    rows = []
    for claim in record["results"]:
        albedo = f"{float(claim['albedo']):.8g} ± {claim['error']:.0e}"
        where = _place(claim, 5)
        rows.append((f"`{claim['name']}`", claim["claim"], claim["verdict"], albedo, where, _ends(claim, 5)))
    found = record["summary"]
    text = f"{found['violate']} of {found['claims']} published claims do not hold, {found['hold']} do."
    return f"{text}\n\n{table(('BRDF', 'claimed', 'verdict', 'largest albedo', 'at', 'above 1'), rows)}"
