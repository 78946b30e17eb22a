"""Does `check` ever call a conserving BRDF violating, or a violating one conserving?

Command: ``brdfcheck study verdicts``. A minute on two cores.

Answer: no. Of 500 random factors within 1e-6 of the exact one all are judged rightly, none is undecided; of 1,184 verdicts in
the cells of the matrix in float64, half of them on a line within 1e-6 of the albedo, 39 are undecided and none is false; of
592 in float32 11 are undecided and none is false.

Every cell of the stability matrix for one lobe of each kind (5 about an axis at 12 exponents, 2 of facets at 7 slopes, 8 angles
each) is judged on the line at 1, in either precision, and in float64 on a line that is off the reference albedo by a random
relative 1e-12 to 1e-6; the slow tests judge those of all lobes.

The random factors are the exact one times 1 + e with |e| from 1e-12 to 1e-6, over random ranges of the exponent: they conserve
if and only if e is within the tolerance. One search is judged with ten factors (any of them makes the albedo the same number
at every exponent), and in a cell on both lines, except of facets. UNDECIDED is never false: it says that the error bar reaches
the line.
"""

from __future__ import annotations

from typing import Any

from _instruments.outcome_charts import OUTCOMES
from _instruments.stability.references import KINDS, read_references
from _instruments.stability.verdicts import all_verdicts
from brdfcheck.cores import available_cores
from brdfcheck.plots import paper
from brdfcheck.studies import table

SMALL = ("phong",)
LABELS = {
    "factors": "random factors near the exact one, float64",
    "matrix, float64": "cells of the matrix, float64",
    "matrix, float32": "cells of the matrix, float32",
}


def run(size: str = "full") -> dict[str, Any]:
    """Counts of right, undecided and false verdicts."""
    full = size == "full"
    chosen = list(read_references(KINDS if full else SMALL).values())
    found = all_verdicts(chosen, 500 if full else 20, processes=min(2, len(available_cores())) if full else 1)
    results = [{"of": of, **found[of]} for of in LABELS]
    summary = {key: sum(found[of][key] for of in LABELS) for key in ("verdicts", "false", "undecided")}
    return {"settings": {"factors": found["factors"]["verdicts"]}, "results": results, "summary": summary}


def plot(record: dict[str, Any]) -> Any:
    """A bar for each set of verdicts: right, undecided, false."""
    colors = (OUTCOMES["holds"], OUTCOMES["loses digits"], OUTCOMES["lies"])
    figure = paper.empty(7.2, 2.4)
    with paper.house_style():
        axes = figure.subplots()
        for place, result in enumerate(record["results"]):
            undecided, false = result["undecided"], result["false"]
            left = 0.0
            for count, color in zip((result["verdicts"] - undecided - false, undecided, false), colors, strict=True):
                part = 100 * count / result["verdicts"]
                axes.barh(place, part, 0.6, left=left, color=color, edgecolor="#888888", linewidth=0.5)
                left += part
            words = f"{result['verdicts']:,} verdicts: {undecided:,} undecided, {false:,} false"
            axes.text(1, place, words, va="center", fontsize=8)
        axes.set_yticks(range(len(LABELS)), [LABELS[result["of"]] for result in record["results"]], fontsize=8)
        axes.set(
            xlim=(0, 100), ylim=(len(LABELS) - 0.5, -0.5), xlabel="% of the verdicts (pale green: right, yellow: undecided)"
        )
        figure.tight_layout()
    return figure


def summary(record: dict[str, Any]) -> str:
    """The counts."""
    rows = []
    for row in record["results"]:
        undecided = f"{row['undecided']:,} ({100 * row['undecided'] / row['verdicts']:.2f} %)"
        rows.append((LABELS[row["of"]], f"{row['verdicts']:,}", undecided, str(row["false"])))
    return table(("verdicts of `check`", "count", "undecided", "false"), rows)
