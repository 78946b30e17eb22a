"""How far are the ways to an albedo from what this machine can do?

Command: ``brdfcheck study limit``. A minute on two cores once it is compiled.

Answer: 40 exps a cell are met by tables of powers (33, 34) and Schlick's lobe (19), missed by the 16th power (41), Lyon's (59,
98) and Kuijk-Blake's (117): beside its evaluations a cell takes a log, three roots and a sum of 41 terms at each end. Beckmann
metal takes 33 ms for 1,024 cells at 5e-10, a 28th of the peer's time; but the peer's error is 4e-11, and at a tenth of that
ours takes a twelfth, not a fiftieth. The second core gains 1.6 to 2.6 times for metal and truncated powers, 0.9 to 1.4 for
tables of 3 ms. At rtol 1e-4 and 1e-5 metal takes longer than at 1e-6: XLA joins small kernels so that an evaluation takes 45
ns, not 14; barriers, a product of matrices and compiling for one thread did not help.

Predicted: each sum done once, not again for the error bar, halves what a cell of Kuijk-Blake's takes; measured: 331 to 154 ns.

The floor is the number of evaluations times the time of the dearest operation in one of them (`_instruments.limits`), from the
same run. A table has 1,000 exponents from 1 to 1000 and 90 cosines; microfacet tables 32 x 32 cells at (i + 1/2)/32. One core:
all threads of the process are bound to it. Errors of metal are against a Gauss rule in numpy over the slopes of the facets,
good to 1e-13 (`_instruments.peers.metal_table`).
"""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from _instruments import limits, lobe_error, timing
from _instruments.peers import metal_table
from brdfcheck import GGX, CookTorrance
from brdfcheck.cores import available_cores
from brdfcheck.plots import paper
from brdfcheck.plots.styles import superscript
from brdfcheck.studies import table

ALONE = True  # times programs on all cores
LOOKS: tuple[dict[str, Any], ...] = (
    {"marker": "|", "color": "black", "markersize": 13, "markeredgewidth": 2}, {"marker": "o", "color": "#0072B2"},
    {"marker": "o", "color": "white", "markeredgecolor": "#0072B2"},
)  # fmt: skip


def run(size: str = "full") -> dict[str, Any]:
    """Times of the machine's operations, of every production path on one core and on all, and of the peer's table."""
    rounds, count = (5, 1000) if (full := size == "full") else (1, 60)
    references = {name: lobe_error.REFERENCES[name] for name in ("multiply-add", "division", "exp", "log")}
    n, mu = np.geomspace(1, 1000, count), np.linspace(1 / 90, 1, 90 if full else 5)
    axis = (np.arange(32 if full else 4) + 0.5) / (32 if full else 4)
    times = {}
    for dtype in ("float32", "float64"):
        taken = timing.nanoseconds(references, 10**7 if full else 10**5, jnp.dtype(dtype), rounds=rounds)
        times[dtype] = {name: time.best for name, time in taken.items()}
    wide, narrow = times["float64"], times["float32"]
    exact = metal_table.slope_table(axis, axis)
    results = [
        limits.zonal(name, n, mu, wide, rounds) for name in (list(limits.FAMILIES) if full else ["phong", "schlick-mirror"])
    ]
    for rtol in limits.TOLERANCES if full else limits.TOLERANCES[:1]:
        path = f"Beckmann metal, rtol 10{superscript(round(math.log10(rtol)))}"
        results.append(limits.facets(path, limits.METAL, axis, wide["exp"], rounds, rtol, exact))
    if full:
        results.append(limits.zonal("phong", n, mu.astype("float32"), narrow, rounds))
        path, single = "Beckmann metal, float32", axis.astype("float32")
        results.append(limits.facets(path, limits.METAL, single, narrow["exp"], rounds, None, exact))
        results.append(limits.facets("V-cavities", CookTorrance, axis, wide["division"], rounds))
        results.append(limits.facets("GGX", GGX, axis, wide["division"], rounds))
        results += limits.singles(wide, rounds)
    peer = limits.peer(axis, exact) if full else {"missing": "small size"}
    gain = timing.gain(references["exp"], len(available_cores()), 10**7 if full else 10**5, jnp.float64, rounds=rounds)
    summary = {"nanoseconds": times, "gain": gain, "peer": peer, "accelerator": limits.accelerator(n, mu, axis, rounds)}
    settings = {"cores": len(available_cores()), "rounds": rounds}
    return {"settings": settings, "results": results, "summary": summary, "packages": ["numba"] if "seconds" in peer else []}


def plot(record: dict[str, Any]) -> Any:
    """For each path three marks on a logarithmic axis: the floor, all cores, one core; labels say the ratio to the floor."""
    results, cores = record["results"], record["settings"]["cores"]
    with paper.house_style():
        figure = paper.empty(8.0, 0.36 * len(results) + 1.6)
        axes = figure.subplots()
        for line, result in enumerate(results):
            floor, one, every = (max(result[key], 1e-3) for key in ("floor", "one_core", "all_cores"))
            axes.plot([min(floor, every), max(one, every)], [line, line], color="#CCCCCC", linewidth=1.2, zorder=1)
            for value, look in zip((floor, one, every), LOOKS, strict=True):
                axes.plot(value, line, **look)
            axes.annotate(
                f"{paper.text_of(float(f'{one / floor:.2g}'))} ×",
                (max(one, every), line),
                (8, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
            )
        axes.set_yticks(range(len(results)), [result["path"] for result in results], fontsize=9)
        axes.set(xscale="log", xlabel="nanoseconds for a cell of a table, an albedo or a check, with its error estimate")
        low, high = (
            end(max(r[key], 1e-3) for r in results for key in ("floor", "one_core", "all_cores")) for end in (min, max)
        )
        decades = range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
        paper.decades(axes.set_xticks, decades)
        axes.set_xlim(low / 2, high * 8)  # room for the last label
        axes.minorticks_off()
        axes.invert_yaxis()
        axes.grid(True, axis="x")
        marks = [axes.plot([], [], linestyle="", **look)[0] for look in LOOKS]
        names = ("the evaluations alone, one core", "one core (label: times the floor)", f"all {cores} cores")
        figure.legend(marks, names, loc="outside upper center", ncols=3, fontsize=9)
    return figure


def summary(record: dict[str, Any]) -> str:
    """The targets, met or missed, and the table behind the figure."""
    results, found = record["results"], record["summary"]
    exp = found["nanoseconds"]["float64"]["exp"]
    rows = [
        (r["path"], str(r["cells"]), f"{r['evaluations']:.4g}", f"{r['floor']:.3g}", f"{r['one_core']:.3g}",
         f"{r['one_core'] / max(r['floor'], 1e-3):.2g}", f"{r['one_core'] / r['all_cores']:.2f}",
         f"{r['one_core'] / exp:.3g}", f"{1e-9 * r['all_cores'] * r['cells']:.3g}",
         f"{r['error']:.1e}" if "error" in r else "")
        for r in results
    ]  # fmt: skip
    header = ("path", "cells", "evaluations a cell", "floor, ns a cell", "one core, ns a cell", "times the floor",
              "gain of all cores", "cost in exps", "seconds, all cores", "largest error")  # fmt: skip
    times = found["nanoseconds"].values()
    single = [(name, *(f"{of[name]:.3f}" for of in times)) for name in next(iter(times))]
    targets = table(("target", "measured", "in this run"), limits.targets(record))
    return (
        f"{targets}\n\n{limits.remarks(record)}\n\n{table(header, rows)}\n\n"
        f"Nanoseconds of single operations in the same run:\n\n{table(('', *found['nanoseconds']), single)}"
    )
