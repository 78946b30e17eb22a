#!/usr/bin/env python3
"""How far are the ways to an albedo from what this machine can do?

Command: ``brdfcheck study limit`` (or ``python studies/limit.py``). Half a minute on two cores once it is compiled.

Answer: tables of smooth lobes take 1 to 2.3 times their exps, 20 to 42 exps a cell, error estimate included; truncated powers 4
to 15 times their multiplications; Beckmann metal 10 to 16 times the exps of its needle (masking wants a root, an erf and a
division besides): 33 ms for 1,024 cells at 5e-10. The second core gives 1.9 times for metal, 1.3 to 1.7 for tables of 5 ms.

The floor of a path is the number of its evaluations times the time of the dearest operation in one of them, from the same
run: an exp for power lobes and Beckmann's needle; for truncated powers a multiply-add each for the ratio and every squaring.
A table has 1,000 exponents from 1 to 1000 and 90 cosines; the microfacet table 32 x 32 cells at (i + 1/2)/32.
"""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Callable
from typing import Any

FAMILIES = ("phong", "blinn-phong", "schlick-mirror", "binomial-power-half", "lyon-1-half", "lyon-3-half", "kuijk-blake-half")
SQUARINGS = {"lyon-1-half": 1, "lyon-3-half": 3, "kuijk-blake-half": 1}
LOOKS: tuple[dict[str, Any], ...] = (
    {"marker": "|", "color": "black", "markersize": 13, "markeredgewidth": 2}, {"marker": "o", "color": "#0072B2"},
    {"marker": "o", "color": "white", "markeredgecolor": "#0072B2"},
)  # fmt: skip
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-8, 1e-10)


def fastest(job: Callable[[], Any], rounds: int) -> float:
    """Seconds of the fastest round, after the two in which programs are compiled."""

    def taken() -> float:
        began = time.perf_counter()
        job().value.block_until_ready()
        return time.perf_counter() - began

    return min([taken() for _ in range(rounds + 2)][2:])


def run(size: str = "full") -> dict[str, Any]:
    """Times of the machine's operations, of tables on one core and on all, and of the microfacet table by tolerance."""
    import jax.numpy as jnp
    import numpy as np

    from brdfcheck import CookTorrance, albedo_table, catalog, costs, lobe_error, tables

    rounds, count = (9, 1000) if (full := size == "full") else (1, 60)
    references = {name: lobe_error.REFERENCES[name] for name in ("multiply-add", "exp", "log")}
    n, mu = np.geomspace(1, 1000, count), np.linspace(1 / 90, 1, 90 if full else 5)
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else {0}
    operations = {}
    for dtype in (jnp.float32, jnp.float64):
        times = costs.nanoseconds(references, 10**7 if full else 10**5, dtype, rounds=rounds)
        operations[dtype.__name__] = {name: time.best for name, time in times.items()}
    slope = (np.arange(32 if full else 4) + 0.5) / (32 if full else 4)

    metal = functools.partial(CookTorrance, masking="smith-separable")

    def on(some: set[int], job: Callable[[], Any]) -> float:
        (pin := getattr(os, "sched_setaffinity", lambda *_: None))(0, some)
        try:
            return fastest(job, rounds)
        finally:
            pin(0, cores)

    results = []
    for name in FAMILIES if full else FAMILIES[::4]:
        family = catalog.exponent_family(name)
        evaluations, kind = tables.profile_evaluations(family, n)
        multiply_add, exp = operations["float64"]["multiply-add"], operations["float64"]["exp"]
        unit = multiply_add * (2 + SQUARINGS[name]) if kind == "power" else exp
        one, every = (on(some, lambda family=family: albedo_table(family, n, mu)) for some in ({min(cores)}, cores))
        each = 1e9 / n.size / mu.size
        results.append({"path": f"table of {name}", "cells": n.size * mu.size, "evaluations": evaluations / n.size,
                        "floor": evaluations / n.size * unit, "one_core": one * each, "all_cores": every * each})  # fmt: skip
    exact = np.asarray(albedo_table(metal, slope, slope, rtol=1e-13).value)
    for rtol in TOLERANCES if full else TOLERANCES[:1]:
        job = lambda rtol=rtol: albedo_table(metal, slope, slope, rtol=rtol)  # noqa: E731
        one, every = (on(some, job) for some in ({min(cores)}, cores))
        table, each = job(), 1e9 / slope.size**2
        results.append({"path": f"Beckmann metal, rtol {rtol:g}", "cells": slope.size**2, "evaluations": int(table.evaluations),
                        "floor": int(table.evaluations) * operations["float64"]["exp"],
                        "one_core": one * each, "all_cores": every * each,
                        "error": float(np.max(np.abs(np.asarray(table.value) - exact)))})  # fmt: skip
    return {"settings": {"cores": len(cores), "rounds": rounds}, "results": results, "summary": {"nanoseconds": operations}}


def plot(record: dict[str, Any]) -> Any:
    """For each path three marks on a logarithmic axis: the floor, all cores, one core; labels say the ratio to the floor."""
    from brdfcheck import plots

    results, cores = record["results"], record["settings"]["cores"]
    with plots.house_style():
        figure = plots.empty(8.0, 0.36 * len(results) + 1.6)
        axes = figure.subplots()
        for line, result in enumerate(results):
            floor, one, every = (max(result[key], 1e-3) for key in ("floor", "one_core", "all_cores"))
            axes.plot([min(floor, every), max(one, every)], [line, line], color="#CCCCCC", linewidth=1.2, zorder=1)
            for value, look in zip((floor, one, every), LOOKS, strict=True):
                axes.plot(value, line, **look)
            axes.annotate(
                f"{one / floor:.2g}x", (max(one, every), line), (8, 0), textcoords="offset points", va="center", fontsize=8
            )
        axes.set_yticks(range(len(results)), [result["path"] for result in results], fontsize=9)
        axes.set(xscale="log", xlabel="nanoseconds for one cell of the table (error estimate included)")
        axes.set_xticks([10.0**k for k in range(1, 6)], [plots.text_of(10.0**k) for k in range(1, 6)])
        axes.minorticks_off()
        axes.invert_yaxis()
        axes.grid(True, axis="x")
        marks = [axes.plot([], [], linestyle="", **look)[0] for look in LOOKS]
        names = ("the evaluations alone, one core", "one core (label: times the floor)", f"all {cores} cores")
        figure.legend(marks, names, loc="outside upper center", ncols=3, fontsize=9)
    return figure


def summary(record: dict[str, Any]) -> str:
    """The table behind the figure."""
    from brdfcheck.studies import table

    rows = [
        (r["path"], str(r["cells"]), f"{r['evaluations']:.4g}", f"{r['floor']:.3g}", f"{r['one_core']:.3g}",
         f"{r['one_core'] / max(r['floor'], 1e-3):.2g}", f"{r['one_core'] / r['all_cores']:.2f}",
         f"{r['one_core'] / record['summary']['nanoseconds']['float64']['exp']:.3g}",
         f"{1e-9 * r['all_cores'] * r['cells']:.3g}", f"{r['error']:.1e}" if "error" in r else "")
        for r in record["results"]
    ]  # fmt: skip
    header = ("path", "cells", "evaluations a cell", "floor, ns a cell", "one core, ns a cell", "times the floor",
              "gain of all cores", "cost in exps", "table, s, all cores", "largest error")  # fmt: skip
    times = record["summary"]["nanoseconds"].values()
    operations = table(("", "float32", "float64"), [(name, *(f"{of[name]:.3f}" for of in times)) for name in next(iter(times))])
    return f"{table(header, rows)}\n\nNanoseconds of single operations in the same run:\n\n{operations}"


if __name__ == "__main__":
    from brdfcheck.studies import main

    main(__file__)
