"""Which cells of the tables and formulas that renderers ship are off, and by how much?

Command: ``brdfcheck study published_tables``: five formulas, and a table by its method. For other tables, which are not part of
this package, give their files: ``--given FILE``, as often as there are files. A file is .npy, .csv, C source or a bare list of
numbers; of several arrays in it the first square one counts, or FILE#ARRAY.

Answer: the formulas are off by 0.06 (Unreal Engine 5), 0.10 (MaterialX, with 203 of 4,096 cells above 1), 0.17 (Narkowicz),
0.20 (Karis, for mobile hardware) and 0.23 (Lazarov's form), the function of `brdfcheck table` by 0.0033, which never exceeds 1.
Filament's table, made again by its method, is off by 0.013 with 358 of 4,096 cells above 1, for 1,024 half vectors are few; its
rows are computed for the roughness one texel further on, and at the middles of texels it is off by 0.046. Of tables, from their
files: Cycles' 1,024 cells of GGX by at most 1e-6; OpenPBR's of metal by 0.0014, and by up to 0.046 in the column of cos theta
= 0, with 16 cells off by more than 0.001.

All are of GGX with F = 1. Formulas are compared in the middles of 64 x 64 texels, with what `brdfcheck table` writes beside
them; tables at their own nodes. Each is read in the way that fits it best, which is told: separable or height-correlated
masking, roughness or alpha, where nodes lie. What they are compared with has error bars of at most 1e-8.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm

from _instruments import published
from brdfcheck.fits.compact import compact_fits
from brdfcheck.fits.renderer import renderer_table
from brdfcheck.plots import paper
from brdfcheck.studies import table

GIVEN = "files of tables: .npy, .csv, C source or a bare list of numbers; FILE#ARRAY"


def run(size: str = "full", given: Sequence[str] = ()) -> dict[str, Any]:
    """How far formulas, our own functions and the given files are off; small: 16 x 16 cells, two formulas."""
    full = size == "full"
    count, names = (64, list(published.FITS)) if full else (16, list(published.FITS)[:2])
    results = [{"kind": "formula", **published.of_formula(name, count)} for name in names]
    results += [{"kind": "method", **found} for found in published.sampled(count, 1024 if full else 64)]
    ours = renderer_table("ggx", {"roughness": (0, 1)}, size=(count, count))
    fits = compact_fits(ours, None if full else (2, 1))
    nodes = published.nodes_of(count, "centres")
    values = fits.albedo(*np.meshgrid(nodes, nodes, indexing="ij"))
    own = published.Reading(
        "roughness, smith-correlated", values, published.exact(count, "centres", True, "smith-correlated", 1), nodes
    )
    results.append({"kind": "formula", **published.told("brdfcheck, functions", own), "bias": None})
    results += [{"kind": "table", **published.of_file(path)} for path in given]
    return {
        "settings": {"count": count, "limits": published.LIMITS, "coefficients": fits.albedo.coefficients},
        "results": results,
        "summary": {result["name"]: result["largest"] for result in results},
    }


def plot(record: dict[str, Any]) -> Any:
    """A map for each: the largest error in 16 x 16 squares over cos theta and roughness."""
    results = record["results"]
    columns = min(3, len(results))
    rows = -(-len(results) // columns)
    with paper.house_style():
        figure = paper.empty(8.6, 0.5 + 2.75 * rows)
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes, result in zip(grid.flat, results, strict=False):
            values = np.maximum(np.array(result["map"]), 1e-7)
            image = axes.imshow(
                values, norm=LogNorm(1e-6, 1), cmap="plasma", origin="lower", extent=(0, 1, 0, 1), interpolation="nearest"
            )
            # Names of files are long, and break at their underscores.
            name = "\n".join(textwrap.wrap(result["name"].replace("_", "_ "), 28)).replace("_ ", "_")
            axes.set_title(f"{name}\nup to {result['largest']:.2g}", fontsize=9)
            axes.grid(False)
        for axes in list(grid.flat)[len(results) :]:
            axes.set_axis_off()
        for axes in grid[:, 0]:
            axes.set_ylabel("roughness")
        for axes in list(grid.flat)[max(len(results) - columns, 0) : len(results)]:  # the lowest of each column
            axes.set_xlabel("cos θ")
            axes.tick_params(labelbottom=True)
        scale = figure.colorbar(image, ax=grid, aspect=40, extend="min")
        paper.decades(scale.ax.set_yticks, range(-6, 1))
        scale.minorticks_off()
        scale.set_label("largest error of E in each square")
    return figure


def summary(record: dict[str, Any]) -> str:
    """How many cells are off by how much, where most, and as what each was read."""
    rows = []
    for result in record["results"]:
        place = f"roughness {result['roughness']:.3g}, cos θ {result['cos_theta']:.3g}"
        off = [f"{count}" for count in result["off"]]
        bias = "-" if result["bias"] is None else f"{result['bias']:.2g}"
        row = (result["name"], f"{result['cells']}", *off, f"{result['largest']:.2g}", f"{result['inside']:.2g}")
        rows.append((*row, f"{result['rms']:.1e}", place, f"{result['above_1']}", bias, result["reading"]))
    limits = [f"off by more than {limit:g}" for limit in record["settings"]["limits"]]
    header = ("", "cells", *limits, "largest error", "inside", "rms", "worst at", "above 1", "bias", "read as")
    files = sum(result["kind"] == "table" for result in record["results"])
    return (
        "Errors of the directional albedo E of GGX with F = 1, in cells; 'inside' leaves out the first row and the first"
        " column, where tables with nodes at 0 hold what they like; 'bias' is the largest error at F0 = 0:\n\n"
        f"{table(header, rows)}\n\nThe functions of brdfcheck have {record['settings']['coefficients']} coefficients for E."
        f" Tables are not part of this package, and are compared where their files are given: here {files}. Filament's is made"
        " again by its method, of Hammersley points in double precision. OSPRay's (32 x 32 cells, Monte Carlo) is not compared:"
        " its samples are not known, so that there is no more of it than its file; `--given FILE` takes it."
    )
