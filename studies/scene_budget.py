#!/usr/bin/env python3
"""How much of the full model does a scene need, and what does leaving out the rest save?

Command: ``brdfcheck study scene_budget`` (or ``python studies/scene_budget.py``). Under two minutes on two cores.

Answer: six scenes need six models, 1.6 to more than 4 times faster than the full one. A matt sphere far away needs Lyon's lobe
in place of the power and a distant light; in 16 bits it needs the power and the point light. Mirror-like metal close up needs
its facets (a power errs by 11 steps of 8 bits) but no Fresnel term (0.03); a window in a room needs 16 bounces (8 err by 1.5);
an icon of 32 pixels 1280 faces with Phong's interpolation (5.7). float32 is enough in all six, float16 in none.

Each rung of each knob is rendered and timed by itself against the full model; the cheapest combination within the tolerance is
rendered again beside the full model, which is in float64 with all that the scene has. Half a step of the output is allowed,
where nothing else is said. An error is the largest of all pixels, after the transfer curve; a cost a share of the full model's.
"""

from __future__ import annotations

import base64
import io
from typing import Any

GLOSSY = [{"brdf": "lambert", "tint": [0.6, 0.3, 0.1]}, {"brdf": "blinn-phong", "tint": 0.01, "n": 15}]
SHINY = {"brdf": "cook-torrance", "tint": [0.95, 0.75, 0.4], "m": 0.12, "fresnel": "exact"}
MATT = {"kind": "surface", "terms": GLOSSY[:1]}
WINDOW = {"kind": "polygon", "vertices": [[2, -1, -0.5], [2, 1, -0.5], [2, 1, 1.5], [2, -1, 1.5]], "intensity": 1.5}


def lamp(position: list[float], intensity: float) -> dict[str, Any]:
    """A point light of that radiant intensity."""
    return {
        "kind": "point",
        "position": position,
        "intensity": intensity,
        "constant_attenuation": 0,
        "quadratic_attenuation": 1,
    }


# What is said of a scene, and the scene.
SCENES: dict[str, dict[str, Any]] = {
    "a matt sphere far away": {
        "size": 256, "camera": {"kind": "orthographic", "half_height": 4}, "lights": [lamp([3000, 3000, 4000], 1e8)],
        "material": {"kind": "surface", "terms": GLOSSY},
    },
    "the same in 16 bits": {
        "size": 256, "camera": {"kind": "orthographic", "half_height": 4}, "lights": [lamp([3000, 3000, 4000], 1e8)],
        "material": {"kind": "surface", "terms": GLOSSY}, "output": {"bits": 16},
    },
    "mirror-like metal close up": {
        "size": 256, "camera": {"kind": "orthographic", "half_height": 0.6}, "lights": [lamp([1, 1, 2.5], 1.2)],
        "material": {"kind": "surface", "terms": [SHINY]},
    },
    "translucent, 6 steps of 8 bits": {
        "size": 256, "background": [0.1, 0.1, 0.12], "lights": [{"kind": "distant", "direction": [1, 1, 1]}],
        "material": {"kind": "translucent", "base": [0.3, 0.6, 0.9], "behind": 0.1}, "matters": {"pixel": "6/255"},
    },
    "lit by a window, in a room": {
        "size": 160, "material": MATT, "lights": [WINDOW], "room": {"reflectance": 0.7, "emission": 0.6},
    },
    "an icon of 32 pixels, 8 steps of 8 bits": {
        "size": 32, "geometry": {"kind": "icosphere"}, "material": MATT,
        "lights": [{"kind": "distant", "direction": [1, 1, 1], "intensity": 3}],
        "matters": {"pixel": "8/255", "silhouette": False},
    },
}  # fmt: skip


def run(size: str = "full") -> dict[str, Any]:
    """The budget of every scene (small: of two, in few pixels)."""
    from brdfcheck import budget
    from brdfcheck.budgets import report
    from brdfcheck.scene.images import png_bytes

    full, results = size == "full", []
    for name, scene in SCENES.items() if full else list(SCENES.items())[3:5]:
        found = budget(scene if full else {**scene, "size": 24})
        images = [report.thumbnail(image) for image in (found.reference, found.image, report.difference(found))]
        codes = [base64.b64encode(png_bytes(image)).decode() for image in images]
        results.append({"name": name, **report.brief(report.document(found)), "images": codes})
    savings = {result["name"]: result["summary"]["saving"] for result in results}
    return {"settings": {"scenes": len(results)}, "results": results, "summary": {"savings": savings}}


def plot(record: dict[str, Any]) -> Any:
    """A row a scene: the full picture, the budgeted one, their difference, and error against cost."""
    from matplotlib.image import imread

    from brdfcheck import plots
    from brdfcheck.budgets import report

    results = record["results"]
    with plots.house_style():
        figure = plots.empty(10.5, 0.6 + 2.55 * len(results))
        rows = figure.subfigures(len(results), 1, squeeze=False)[:, 0]
        for number, (row, result) in enumerate(zip(rows, results, strict=True)):
            chosen = ", ".join(f"{part['title']}: {part['rung']}" for part in result["results"])
            row.suptitle(f"{result['name']}: {result['summary']['saving']:.1f} times faster\n{chosen}", fontsize=9)
            grid = row.subplots(1, 4, width_ratios=(1, 1, 1, 1.9))
            for axes, code, title in zip(grid, result["images"], ("full", "budget", "difference, 10⁻⁸ to 1"), strict=False):
                axes.imshow(imread(io.BytesIO(base64.b64decode(code))), interpolation="nearest")
                axes.set_axis_off()
                axes.set_title(title if number == 0 else "", fontsize=8)
            report.draw(grid[3], result)
            grid[3].set_xlabel(grid[3].get_xlabel() if number == len(results) - 1 else "")
        handles = rows[0].axes[3].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncol=5, handlelength=2.0)
    return figure


def summary(record: dict[str, Any]) -> str:
    """What each scene needs, and all rungs."""
    from brdfcheck.budgets.report import cells, sentences
    from brdfcheck.studies import table

    parts = []
    for result in record["results"]:
        lines = "\n".join(f"- {line}" for line in sentences(result))
        parts.append(f"## {result['name'][:1].upper()}{result['name'][1:]}\n\n{table(*cells(result))}\n\n{lines}")
    return (
        "Costs are shares of the full model's time, measured with one knob turned; the last column is what the next dearer rung"
        " with a smaller error would buy. The difference is white below 10⁻⁸ of full scale, then purple to yellow at 1.\n\n"
        + "\n\n".join(parts)
    )


if __name__ == "__main__":
    from brdfcheck.studies import main

    main(__file__)
