"""A budget as a record, a table, a chart of error against work, and pictures side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from brdfcheck.budgets.measure import Budget, Rung
from brdfcheck.output import records
from brdfcheck.scene.canvas import color_scale, false_color, stacked
from brdfcheck.scene.images import contact_sheet

_LEAST, _MOST = 1e-8, 1.0
_COLOR, _GREY = "#D55E00", "#888888"


def steps(budget: Budget) -> int:
    """Steps of the output in full scale, in which errors are told: 255 or 65535."""
    return 2**budget.scene.bits - 1


def _rung(rung: Rung) -> dict[str, Any]:
    return {"rung": rung.name, "error": rung.fault._asdict(), "cost": rung.cost, "refused": rung.refused}


def document(budget: Budget) -> dict[str, Any]:
    """The record of a budget: errors of pixels in units of full scale, costs as shares of the full model's work."""
    scene = budget.scene
    rows = [
        {
            "knob": row.knob.name,
            "title": row.knob.title,
            **_rung(row.chosen),
            "dearer": None if row.dearer is None else _rung(row.dearer),
            "ladder": [_rung(rung) for rung in budget.ladders[row.knob.name]],
        }
        for row in budget.rows
    ]
    settings = {
        "scene": scene.label, "size": list(scene.picture.size), "bits": scene.bits, "transfer": scene.transfer,
        "silhouette": scene.silhouette, "tolerance": budget.tolerance._asdict(), "precision": "float64",
    }  # fmt: skip
    summary = {
        "chosen": budget.chosen, "predicted": budget.predicted._asdict(), "error": budget.error._asdict(),
        "verified": budget.verified._asdict(), "cost": budget.cost, "seconds": budget.seconds,
        "full_seconds": budget.full_seconds, "saving": budget.saving, "ratios": list(budget.ratios),
        "combinations": budget.combinations, "points": [list(point) for point in budget.points],
    }  # fmt: skip
    return records.document(f"budget {scene.label}", rows, settings=settings, summary=summary)


def in_steps(error: float, full: int) -> str:
    """An error of a pixel in steps of the output, as one writes it; "refused" where it is infinite."""
    return f"{error * full:.3g}" if np.isfinite(error) else "refused"


def cells(record: Mapping[str, Any]) -> tuple[Sequence[str], list[Sequence[str]]]:
    """The header and the rows of the table, for a person."""
    full = 2 ** record["settings"]["bits"] - 1
    header = ("knob", "chosen", f"error, 1/{full}", "energy", "work", "the next dearer rung would buy")
    rows = []
    for row in record["results"]:
        dearer = row["dearer"]
        buys = "nothing: no rung errs less"
        if dearer is not None:
            more = dearer["cost"] / row["cost"] - 1
            price = f"{more:.0%} more work" if more > 0.005 else "hardly more work"
            buys = f"{dearer['rung']}: error {in_steps(dearer['error']['pixel'], full)} for {price}"
        error = row["error"]
        rows.append(
            (row["title"], row["rung"], in_steps(error["pixel"], full), f"{error['energy']:.2g}", f"{row['cost']:.2f}", buys)
        )
    return header, rows


def sentences(record: Mapping[str, Any]) -> list[str]:
    """What holds of the whole, a line each."""
    settings, summary = record["settings"], record["summary"]
    full, tolerance = 2 ** settings["bits"] - 1, settings["tolerance"]
    bound = float(tolerance["energy"])  # "inf" where it is read from JSON
    energy = f", energy {bound:.2g}" if np.isfinite(bound) else ""
    taken = f"{1e3 * summary['seconds']:.3g} ms beside {1e3 * summary['full_seconds']:.3g} ms of the full model: "
    if summary["saving"] > 1:
        taken += f"{summary['saving']:.3g} times faster"
    else:
        taken += "nothing saved that can be measured"
    refused = [(row["title"], rung) for row in record["results"] for rung in row["ladder"] if rung["refused"]]
    return [
        f"tolerance  {in_steps(tolerance['pixel'], full)}/{full} of a pixel{energy}",
        f"predicted  {in_steps(summary['predicted']['pixel'], full)}/{full}, energy {summary['predicted']['energy']:.2g}",
        f"verified   {in_steps(summary['verified']['pixel'], full)}/{full}, energy {summary['verified']['energy']:.2g}"
        " (rendered)",
        f"work       {summary['cost']:.2g} of the full model's (counted)",
        f"time       {taken} (measured)",
        *(f"refused    {title} {rung['rung']}: {rung['refused']}" for title, rung in refused),
    ]


def chart(record: Mapping[str, Any]) -> Any:
    """Error against work: all that was rendered, the frontier, the chosen one."""
    from brdfcheck.plots import paper

    with paper.house_style():
        figure = paper.empty(7.0, 4.6)
        draw(figure.subplots(), record)
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncol=5, handlelength=2.0)
    return figure


def draw(axes: Any, record: Mapping[str, Any]) -> None:
    """The chart on axes of one's own, within the house's style, their labels short."""
    from brdfcheck.plots import paper

    full, summary = 2 ** record["settings"]["bits"] - 1, record["summary"]
    tolerance = record["settings"]["tolerance"]["pixel"] * full
    floor = max(min(tolerance, 1.0) * 1e-4, 1e-7)

    def shown(error: float) -> float:
        return max(error * full, floor)

    rungs = [rung for row in record["results"] for rung in row["ladder"] if not rung["refused"]]
    points = [(cost, shown(error), kind) for cost, error, kind in summary["points"]]
    others = [(x, y) for x, y, kind in points if kind == "other"]
    if others:
        axes.plot(*zip(*others, strict=True), "o", color=_GREY, markersize=3.5, alpha=0.7, label="rendered")
    frontier = [(x, y) for x, y, kind in points if kind == "frontier"]
    axes.plot(*zip(*frontier, strict=True), "-s", color="#0072B2", markersize=4, drawstyle="steps-post", label="frontier")
    chosen = (summary["cost"], shown(summary["error"]["pixel"]))
    axes.plot(*chosen, "*", color=_COLOR, markersize=13, markeredgecolor="white", zorder=5, label="chosen", clip_on=False)
    axes.axhspan(floor / 3, tolerance, color="#009E73", alpha=0.08, linewidth=0)
    axes.axhline(tolerance, color="#009E73", linewidth=1, dashes=(4, 2), label="tolerance")
    look = {"textcoords": "offset points", "ha": "right", "va": "bottom", "fontsize": 7.5, "color": "#006B4E"}
    axes.annotate(paper.text_of(tolerance, 3), (1, tolerance), (-2, 1), xycoords=("axes fraction", "data"), **look)
    top = max([shown(rung["error"]["pixel"]) for rung in rungs] + [tolerance]) * 4
    low = min([rung["cost"] for rung in rungs] + [x for x, _, _ in points])
    high = max([rung["cost"] for rung in rungs] + [1.0])
    axes.set(xscale="log", yscale="log", ylim=(floor / 3, top), xlim=(low / 1.3, high * 1.3))
    steps_of_decade = ((1,), (1, 2, 5), (1, 1.5, 2, 3, 5, 7), (1, 1.2, 1.4, 1.6, 1.8, *(k / 2 for k in range(4, 20))))
    for marks in steps_of_decade:
        ticks = [mark * 10.0**k for k in range(-5, 3) for mark in marks if low / 1.3 <= mark * 10.0**k <= high * 1.3]
        if len(ticks) >= 3:
            break
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    decades = [k for k in range(-9, 6) if floor * 3 < 10.0**k < top]
    decades = decades[:: 1 + len(decades) // 6]
    axes.set_yticks([floor, *(10.0**k for k in decades)], ["0", *(paper.text_of(10.0**k, 3) for k in decades)])
    axes.minorticks_off()
    axes.grid(True)
    axes.set(xlabel="work, share of the full model's", ylabel=f"pixel error, 1/{full}")


def difference(budget: Budget) -> Float[np.ndarray, "3 height width"]:
    """The difference of both pictures in each pixel, after the transfer curve, in false colour: white below 1e-8."""
    return false_color(_apart(budget), _LEAST, _MOST)


def _apart(budget: Budget) -> Float[np.ndarray, "height width"]:
    shown = [budget.scene.shown(np.asarray(image, float)) for image in (budget.reference, budget.image)]
    return np.max(np.abs(shown[0] - shown[1]), axis=0)


def pictures(budget: Budget) -> Float[np.ndarray, "3 height width"]:
    """The full picture, the budgeted one and their difference in false colour, with its scale, as one linear image."""
    images = [np.clip(np.asarray(image, float), 0, None) for image in (budget.reference, budget.image)]
    columns = ("full model", "budget", f"difference, at most {np.max(_apart(budget)):.2g}")
    # Small pictures are enlarged, so that their captions fit.
    times = max(1, -(-200 // images[0].shape[2]))
    large = [np.repeat(np.repeat(image, times, 1), times, 2) for image in (*images, difference(budget))]
    sheet = contact_sheet([large], columns=columns)
    return stacked(sheet, color_scale(sheet.shape[2], "difference of a pixel in units of full scale", _LEAST, _MOST))
