"""How much of the full model does a scene need, and what does leaving out the rest save?

Command: ``brdfcheck study scene_budget``. A minute and a half on two cores.

Answer: of nine scenes five take 12 to 37 times less time than the full model, the others 1.3 to 3.6 times less; the work is 2.5
to 1,100 times less, in six at least 5 times. What saves most is what need not be found in each pixel: the albedo under a sky,
from a table of 32 angles; the light of a window, a room or 20 lamps on a sphere, at a grid of 24 x 24 to 72 x 72 points; the
light in a room, between 2 x 2 patches of a wall for 10 x 10; and the facet that is seen, 5,120 facets whose outline does not
matter being the sphere itself. Where there is little but the shading of each pixel, float32 is what is left. A matt sphere far
away needs a distant light and the box of pixels in which it lies; in 16 bits a glossy one needs its point light and the power
itself (every stand-in errs by 200 steps or more). Mirror-like metal close up needs its facets (a power errs by 11 steps of 8
bits) but no Fresnel term (0.03). A translucent sphere within 3 steps takes Lyon's lobe (2.0) for the power. The room needs 8
bounces. Of 20 lamps 14 are enough. Of 5,120 facets under three lights, whose outline matters, all are needed. float32 is enough
in all nine, float16 is chosen in none.

Each rung of each knob is rendered by itself against the full model, which is in float64 with all that the scene has; of all
combinations within the tolerance the one with the fewest operations is rendered again and timed beside the full model. Half a
step of the output is allowed, where nothing else is said, and one step in the last four scenes. An error is the largest of all
pixels, after the transfer curve. Time saves less than work does: float32 is counted as a quarter to a half of float64's work
and takes half of its time or more, and no program takes less than some 20 microseconds, however little it does. Times
are on one core.
"""

from __future__ import annotations

import base64
import io
import textwrap
from typing import Any

from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.image import imread

from _instruments.budget_scenes import SCENES
from brdfcheck import budget
from brdfcheck.budgets import report
from brdfcheck.budgets.report import cells, sentences
from brdfcheck.cores import on_one_core
from brdfcheck.plots import paper, with_few_colours
from brdfcheck.scene.images import png_bytes
from brdfcheck.studies import table


def run(size: str = "full") -> dict[str, Any]:
    """The budget of every scene (small: of two, in few pixels)."""

    def thumbnail(image: Any) -> Any:
        """Every k-th pixel of an image, so that no side has more than 128."""
        step = -(-max(image.shape[1:]) // 128)
        return image[:, ::step, ::step]

    full, results = size == "full", []
    for name, scene in SCENES.items() if full else list(SCENES.items())[3:5]:
        with on_one_core():
            found = budget(scene if full else {**scene, "size": 24})
        images = (found.reference, found.image, report.difference(found))
        codes = [base64.b64encode(with_few_colours(png_bytes(thumbnail(image)))).decode() for image in images]
        told = report.document(found)
        results.append({"name": name, **{key: told[key] for key in ("settings", "summary", "results")}, "images": codes})
    savings = {result["name"]: [result["summary"]["saving"], 1 / result["summary"]["cost"]] for result in results}
    return {"settings": {"scenes": len(results)}, "results": results, "summary": {"savings": savings}}


def plot(record: dict[str, Any]) -> Any:
    """What is saved; a row a scene: the full picture, the budgeted one, their difference, and error against cost."""
    results = record["results"]
    with paper.house_style():
        figure = paper.empty(9.4, 3.6 + 1.75 * len(results))
        halves: Any = figure.subfigures(2, 1, height_ratios=(2.8, 0.8 + 1.75 * len(results)))
        upper, lower = halves
        _savings(upper.subplots(), results)
        grid = lower.subplots(len(results), 4, squeeze=False, width_ratios=(1, 1, 1, 1.7))
        figure.set_layout_engine("constrained", h_pad=0.2, rect=(0.005, 0, 0.99, 0.995))
        for number, (row, result) in enumerate(zip(grid, results, strict=True)):
            for axes, code, title in zip(row, result["images"], ("full", "budget", "difference"), strict=False):
                axes.imshow(imread(io.BytesIO(base64.b64decode(code))), interpolation="nearest")
                axes.set_axis_off()
                axes.set_title(title if number == 0 else "", fontsize=9)
            report.draw(row[3], result)
            row[3].set_xlabel(row[3].get_xlabel() if number == len(results) - 1 else "")
            row[3].yaxis.label.set_size(7.5)
            # What is as in the full model needs no words.
            turned = [part for part in result["results"] if part["rung"] != part["ladder"][-1]["rung"]]
            chosen = ", ".join(f"{part['title']} {part['rung']}" for part in turned)
            text = f"{result['name']}: {result['summary']['saving']:.1f} times faster with {chosen}"
            text = textwrap.fill(text.replace(" x ", "\u00a0x\u00a0"), 118)
            place = {"xycoords": "axes fraction", "textcoords": "offset points"}
            row[0].annotate(text, (0, 1), (0, 20 if number == 0 else 7), fontsize=9, weight="bold", **place).set_in_layout(
                False
            )
        # Below the last chart, beside the scale of the differences.
        known: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.38), "ncol": 4, "handlelength": 1.6}
        grid[-1, 3].legend(*grid[1, 3].get_legend_handles_labels(), columnspacing=1.0, **known)
        scale = lower.colorbar(ScalarMappable(LogNorm(1e-8, 1), "plasma"), ax=grid[-1, :3], location="bottom", aspect=40)
        scale.set_ticks([1e-8, 1e-6, 1e-4, 1e-2, 1], labels=["10⁻⁸", "10⁻⁶", "10⁻⁴", "10⁻²", "1"])
        scale.minorticks_off()
        scale.set_label("difference of a pixel in units of full scale; white: below 10⁻⁸", fontsize=9)
    return figure


def _savings(axes: Any, results: list[dict[str, Any]]) -> None:
    """How many times less time and work, a line a scene."""
    rows = range(len(results))
    columns = [
        ("time, measured", "o", "#D55E00", [result["summary"]["saving"] for result in results]),
        ("work, counted", "s", "#0072B2", [1 / result["summary"]["cost"] for result in results]),
    ]
    for label, marker, color, values in columns:
        axes.plot(values, rows, marker, color=color, markersize=5, label=label)
    axes.axvline(5, color="#444444", linewidth=1, dashes=(4, 2))
    axes.set(xscale="log", xlabel="times less than the full model", ylim=(len(results) - 0.5, -0.5))
    axes.set_yticks(rows, [result["name"] for result in results])
    ticks = [1, 2, 5, 10, 100, 1000, 10000]
    axes.set_xticks(ticks, [f"{tick:,}" for tick in ticks])
    axes.minorticks_off()
    axes.grid(True, axis="x")
    axes.legend(loc="upper right")


def summary(record: dict[str, Any]) -> str:
    """What each scene needs, and all rungs."""
    parts, saved = [], []
    for result in record["results"]:
        told = result["summary"]
        low, high = (f"{1 / told['ratios'][k]:.1f}" for k in (2, 0))
        times = (f"{1e3 * told[name]:.3g}" for name in ("full_seconds", "seconds"))
        saved.append((result["name"], *times, f"{told['saving']:.1f}", f"{low} to {high}", f"{1 / told['cost']:.1f}"))
        lines = "\n".join(f"- {line}" for line in sentences(result))
        parts.append(f"## {result['name'][:1].upper()}{result['name'][1:]}\n\n{table(*cells(result))}\n\n{lines}")
    header = ("scene", "full model, ms", "budget, ms", "times faster", "middle half of the rounds", "times less work")
    return (
        f"{table(header, saved)}\n\n"
        "Work is a share of the full model's operations, counted with one knob turned; the last column is what the next dearer"
        " rung that errs less would buy. The difference is white below 10⁻⁸ of full scale, then purple to yellow at 1.\n\n"
        + "\n\n".join(parts)
    )
