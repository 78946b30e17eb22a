"""How much of the full model does a scene need, and what does leaving out the rest save?

Command: ``brdfcheck study scene_budget``. Under two minutes on two cores.

Answer: six scenes need six models, with 3.6 to 38 times less work than the full one and 2 to 4 times faster. A matt sphere far
away needs a distant light, float32 and the box of pixels in which it lies; in 16 bits a glossy one needs its point light and
the power itself (every stand-in errs by 200 steps or more). Mirror-like metal close up needs its facets (a power errs by 11
steps of 8 bits) but no Fresnel term (0.03). A translucent sphere within 3 steps takes Lyon's lobe (2.0) for the power. A window
in a room needs 16 bounces (0.1; 8 err by 1.9). An icon of 5,120 facets needs 1,280 (6.6). float32 is enough in all six, float16
in none.

Each rung of each knob is rendered by itself against the full model, which is in float64 with all that the scene has; of all
combinations within the tolerance the one with the fewest operations is rendered again and timed beside the full model. Half a
step of the output is allowed, where nothing else is said. An error is the largest of all pixels, after the transfer curve.
"""

from __future__ import annotations

import base64
import io
from typing import Any

from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.image import imread

from brdfcheck import budget
from brdfcheck.budgets import report
from brdfcheck.budgets.report import cells, sentences
from brdfcheck.plots import paper, with_few_colours
from brdfcheck.scene.images import png_bytes
from brdfcheck.studies import table

ALONE = True  # times programs on all cores
BASE = {"brdf": "lambert", "tint": [0.6, 0.3, 0.1]}
MATT = {"kind": "surface", "terms": [BASE]}
GLOSSY = {"kind": "surface", "terms": [BASE, {"brdf": "blinn-phong", "tint": 0.1, "n": 30}]}
SHINY = {"brdf": "cook-torrance", "tint": [0.95, 0.75, 0.4], "m": 0.12, "fresnel": "exact"}
WINDOW = {"kind": "polygon", "vertices": [[2, -1, -0.5], [2, 1, -0.5], [2, 1, 1.5], [2, -1, 1.5]], "intensity": 1.5}
LAMP = {"kind": "point", "constant_attenuation": 0, "quadratic_attenuation": 1}
SUN = {"kind": "distant", "direction": [1, 1, 1], "intensity": 3}

# What is said of a scene, and the scene.
SCENES: dict[str, dict[str, Any]] = {
    "a matt sphere far away": {
        "size": 256, "camera": {"kind": "orthographic", "half_height": 4}, "material": MATT,
        "lights": [{**LAMP, "position": [3000, 3000, 4000], "intensity": 1e8}],
    },
    "glossy, in 16 bits": {
        "size": 256, "material": GLOSSY, "output": {"bits": 16}, "lights": [{**LAMP, "position": [3, 3, 4], "intensity": 70}],
    },
    "mirror-like metal close up": {
        "size": 256, "camera": {"kind": "orthographic", "half_height": 0.6},
        "material": {"kind": "surface", "terms": [SHINY]}, "lights": [{**LAMP, "position": [1, 1, 2.5], "intensity": 1.2}],
    },
    "translucent, 3 steps": {
        "size": 256, "background": [0.1, 0.1, 0.12], "lights": [{"kind": "distant", "direction": [1, 1, 1]}],
        "material": {"kind": "translucent", "base": [0.3, 0.6, 0.9], "behind": 0.1}, "matters": {"pixel": "3/255"},
    },
    "lit by a window, in a room": {
        "size": 160, "material": MATT, "lights": [WINDOW],
        "room": {"reflectance": 0.7, "emission": 0.6, "cells": 12},
    },
    "an icon of 32 pixels, of facets, 8 steps": {
        "size": 32, "geometry": {"kind": "icosphere", "level": 4}, "material": MATT, "lights": [SUN],
        "matters": {"pixel": "8/255", "silhouette": False},
    },
}  # fmt: skip


def run(size: str = "full") -> dict[str, Any]:
    """The budget of every scene (small: of two, in few pixels)."""

    def thumbnail(image: Any) -> Any:
        """Every k-th pixel of an image, so that no side has more than 128."""
        step = -(-max(image.shape[1:]) // 128)
        return image[:, ::step, ::step]

    full, results = size == "full", []
    for name, scene in SCENES.items() if full else list(SCENES.items())[3:5]:
        found = budget(scene if full else {**scene, "size": 24})
        images = (found.reference, found.image, report.difference(found))
        codes = [base64.b64encode(with_few_colours(png_bytes(thumbnail(image)))).decode() for image in images]
        told = report.document(found)
        results.append({"name": name, **{key: told[key] for key in ("settings", "summary", "results")}, "images": codes})
    savings = {result["name"]: result["summary"]["saving"] for result in results}
    return {"settings": {"scenes": len(results)}, "results": results, "summary": {"savings": savings}}


def plot(record: dict[str, Any]) -> Any:
    """A row a scene: the full picture, the budgeted one, their difference, and error against cost."""
    results = record["results"]
    with paper.house_style():
        figure = paper.empty(9.4, 0.8 + 2.15 * len(results))
        grid = figure.subplots(len(results), 4, squeeze=False, width_ratios=(1, 1, 1, 1.7))
        figure.set_layout_engine("constrained", h_pad=0.22, rect=(0.005, 0, 0.99, 0.995))
        for number, (row, result) in enumerate(zip(grid, results, strict=True)):
            for axes, code, title in zip(row, result["images"], ("full", "budget", "difference"), strict=False):
                axes.imshow(imread(io.BytesIO(base64.b64decode(code))), interpolation="nearest")
                axes.set_axis_off()
                axes.set_title(title if number == 0 else "", fontsize=9)
            report.draw(row[3], result)
            row[3].set_xlabel(row[3].get_xlabel() if number == len(results) - 1 else "")
            # What is as in the full model needs no words.
            turned = [part for part in result["results"] if part["rung"] != part["ladder"][-1]["rung"]]
            chosen = ", ".join(f"{part['title']} {part['rung']}" for part in turned)
            text = f"{result['name']}: {result['summary']['saving']:.1f} times faster with {chosen}"
            place = {"xycoords": "axes fraction", "textcoords": "offset points"}
            row[0].annotate(text, (0, 1), (0, 20 if number == 0 else 7), fontsize=9, weight="bold", **place).set_in_layout(
                False
            )
        # Below the last chart, beside the scale of the differences.
        known: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.38), "ncol": 4, "handlelength": 1.6}
        grid[-1, 3].legend(*grid[1, 3].get_legend_handles_labels(), columnspacing=1.0, **known)
        scale = figure.colorbar(ScalarMappable(LogNorm(1e-8, 1), "plasma"), ax=grid[-1, :3], location="bottom", aspect=40)
        scale.set_ticks([1e-8, 1e-6, 1e-4, 1e-2, 1], labels=["10⁻⁸", "10⁻⁶", "10⁻⁴", "10⁻²", "1"])
        scale.minorticks_off()
        scale.set_label("difference of a pixel in units of full scale; white: below 10⁻⁸", fontsize=9)
    return figure


def summary(record: dict[str, Any]) -> str:
    """What each scene needs, and all rungs."""
    parts = []
    for result in record["results"]:
        lines = "\n".join(f"- {line}" for line in sentences(result))
        parts.append(f"## {result['name'][:1].upper()}{result['name'][1:]}\n\n{table(*cells(result))}\n\n{lines}")
    return (
        "Work is a share of the full model's operations, counted with one knob turned; the last column is what the next dearer"
        " rung that errs less would buy. The difference is white below 10⁻⁸ of full scale, then purple to yellow at 1.\n\n"
        + "\n\n".join(parts)
    )
