"""What does a proof cost, the closer the factor is to the best one?

Command: ``brdfcheck study certificates``. Under a minute, on one core.

Answer: a few boxes a decade. The 16th power about N takes 12 boxes at a slack of 1e-2, 38 at 1e-6 and 77 at 1e-12, 0.05 s; the
other powers 42 to 81 at 1e-12, at most 0.2 s. Schlick's lobes touch 1 at the ends of the range alone: 8 or 9 boxes for
any slack. Of the 13 claims of the literature in the catalogue 10 are proved false and 3 true, each in at most 0.2 s.

The best factor (n+A)/B of each lobe on n in [1, 1000] is the minimax one of `fit`, which touches 1; B is enlarged by the slack.
Boxes are those of the certificate: intervals of n on which a chord of the convex albedo is compared with 1. The report has
every BRDF of the catalogue too, the claims of the literature included, with what is proved of it and its certificate.
"""

from __future__ import annotations

import json
import time
from typing import Any

from _instruments import theorems
from brdfcheck import Factor, Normalized, NotProved, catalog, certify, fit_factor
from brdfcheck.plots import paper
from brdfcheck.plots.styles import style_of
from brdfcheck.studies import table

LOBES = ("binomial-power-half", "blinn-phong-fitted", "schlick-mirror", "schlick-half", "lyon-1-half", "lyon-3-half",
         "binomial-power-mirror")  # fmt: skip
SLACKS = tuple(10.0**-k for k in range(2, 13))


def run(size: str = "full") -> dict[str, Any]:
    """Boxes and seconds of a proof for each lobe and slack; the certificates of the catalogue."""

    def proved(what: Any, **ranges: Any) -> tuple[Any, int | None, float]:
        """A certificate, or why there is none, with its boxes and the time on one core."""
        began = time.process_time()
        try:
            found = certify(what, seconds=0, **ranges)
        except (NotProved, ValueError) as error:
            return str(error), None, time.process_time() - began
        boxes = sum(len(piece["nodes"]) - 1 for piece in found.record.get("cover", ()))
        return found, boxes, time.process_time() - began

    full = size == "full"
    results = []
    for name in LOBES if full else LOBES[:2]:
        best = fit_factor(name).factor
        lobe = catalog.entry(name).family.build
        a, b = float(best.A), float(best.B)  # pyright: ignore[reportAttributeAccessIssue]
        for slack in SLACKS if full else SLACKS[::5]:

            def member(n: Any, b: float = b * (1 + slack), lobe: Any = lobe, a: float = a) -> Any:
                return Normalized(lobe(n=n).core, Factor(a, b))

            _, boxes, seconds = proved(member, n=(1, 1000))
            results.append({"name": name, "slack": slack, "boxes": boxes, "seconds_on_one_core": seconds})
    entries = []
    for entry in catalog.entries() if full else catalog.entries()[:3]:
        found, boxes, seconds = proved(entry.name)
        known = not isinstance(found, str)
        entries.append({
            "name": entry.name, "claim": entry.claim, "boxes": boxes, "seconds_on_one_core": seconds,
            "certificate": dict(found.record) if known else None, "why_not": None if known else found,
        })  # fmt: skip
    return {"settings": {"range": [1, 1000]}, "results": results, "summary": {"catalogue": entries}}


def pictures(record: dict[str, Any]) -> dict[str, bytes]:
    """The certificates of the catalogue, each in a file of its own; the figure of docs/proofs.md."""
    entries = [entry for entry in record["summary"]["catalogue"] if entry["certificate"]]
    files = {f"{entry['name']}.json": (json.dumps(entry["certificate"], indent=1) + "\n").encode() for entry in entries}
    return {**files, "theorems.png": theorems.picture()}


def plot(record: dict[str, Any]) -> Any:
    """Boxes, and seconds, against the slack."""
    with paper.house_style():
        figure = paper.empty(8.2, 3.8)
        panels = figure.subplots(1, 2, sharex=True)
        for name in dict.fromkeys(row["name"] for row in record["results"]):
            rows = [row for row in record["results"] if row["name"] == name and row["boxes"] is not None]
            style = style_of(name)
            look = {"color": style.color, "dashes": style.dashes or (1, 0), "marker": style.marker, "markersize": 4}
            for axes, key in zip(panels, ("boxes", "seconds_on_one_core"), strict=True):
                axes.plot([row["slack"] for row in rows], [row[key] for row in rows], label=name, **look)
        for axes, what in zip(panels, ("boxes of the proof", "seconds on one core"), strict=True):
            axes.set(xscale="log", xlabel="slack: B over the best B, minus 1", ylabel=what)
            axes.set_xticks(SLACKS[::2], [f"1e-{k}" for k in range(2, 13, 2)])
            axes.minorticks_off()
            axes.grid(True)
        panels[0].invert_xaxis()  # both: they share it
        panels[0].set_ylim(bottom=0)
        panels[1].set_yscale("log")
        panels[1].set_yticks((0.01, 0.03, 0.1), ("0.01", "0.03", "0.1"))
        panels[1].minorticks_off()
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncol=3)
    return figure


def summary(record: dict[str, Any]) -> str:
    """Boxes lobe by lobe; what is proved of the catalogue."""
    names = list(dict.fromkeys(row["name"] for row in record["results"]))
    cost = {(row["name"], row["slack"]): row for row in record["results"]}
    slacks = sorted({row["slack"] for row in record["results"]}, reverse=True)

    def cell(row: dict[str, Any]) -> str:
        return "-" if row["boxes"] is None else f"{row['boxes']} ({row['seconds_on_one_core']:.2g} s)"

    rows = [(f"{slack:.0e}", *(cell(cost[name, slack]) for name in names)) for slack in slacks]
    found = [
        (*((f"[`{name}`]({name}.json)", entry["claim"] or "conserves", known["verdict"], known["statement"]) if known else
           (f"`{name}`", entry["claim"] or "conserves", "not proved", entry["why_not"])),
         "-" if entry["boxes"] is None else str(entry["boxes"]),
         f"{entry['seconds_on_one_core']:.2g}")
        for entry in record["summary"]["catalogue"] for name, known in [(entry["name"], entry["certificate"])]
    ]  # fmt: skip
    return (
        f"Boxes of the proof, and seconds on one core:\n\n{table(('slack', *(f'`{name}`' for name in names)), rows)}\n\n"
        "Left, the theorem on normal incidence; right, the boxes of a proof:\n\n![theorem and proof](theorems.png)\n\n"
        "The catalogue: what is claimed, and what is proved. Names lead to the certificates, for"
        " `brdfcheck certify --verify`.\n\n"
        + table(("BRDF", "claim", "verdict", "statement proved", "boxes", "seconds"), found)
    )
