"""What does a stand-in for the cosine power save, and how far is it from the power?

Command: ``brdfcheck study lobe_cost``. Under a minute on two cores.

Answer: the 16th power takes 7 operations and a ninth of the time of exp(n log c), in float64 a 23rd; for n = 10, 100, 1000 it
is within 0.011, 0.015, 0.017 of c^n (3 to 5 steps of 8 bits) and keeps its energy to 3 to 6 %. Schlick's quotient takes as
long (in float64 1.5 times), is off by 0.20, in the centre by 18 % where 10 % was claimed, and spreads to 6 times the angle.
Kuijk-Blake's acos may be a polynomial (0.1 to 0.2 of c^n's time), good up to n = 100. A whole n makes c^n 4, 8, 14 products.

Cost: nanoseconds of one evaluation from the cosine, summed over 10^7 cosines in a fused loop on one core, fastest of 5 to 150
rounds. Errors are to c^n, angles evenly from 0 to 90 degrees. Energy: with the factor that makes c^n's albedo 1 at 0 degrees.
"""

from __future__ import annotations

import itertools
from typing import Any

import jax.numpy as jnp

from _instruments import charts, lobe_error, timing
from brdfcheck.plots import paper
from brdfcheck.plots.styles import LOBES, ink
from brdfcheck.studies import table

EXPONENTS = (10, 100, 1000)
MOST = 1.6  # nanoseconds; what takes longer is drawn at the edge
# A row of panels: what it shows, where 0 is drawn, the top, the ticks.
# Three of six: errors in the centre and in the falloff differ little from the largest; the page has them all.
ROWS = {
    "max": ("largest error", 5e-4, 1, (1e-3, 0.01, 0.1)),
    "mean": ("mean error over 0 to 90°", 5e-5, 0.25, (1e-4, 1e-3, 0.01, 0.1)),
    "energy": ("energy error |E − 1|, mirror form", 2e-3, 12, (0.01, 0.1, 1)),
}
STEP = 1 / 255  # of 8 bits
SHIFTS, COLUMNS = {"right": (-5, 0), "left": (5, 0), "center": (0, 7)}, {"binomial power": min, "Lyon": max}  # of labels
BESIDE = {"binomial power": 0.78, "Lyon": 1.14}  # a label's column, times the nearest marker
KINDS = {
    "Phong": "cⁿ by exp and log; hollow: n whole and compiled in", "Schlick": "Schlick", "Lyon": "Lyon, w",
    "Kuijk-Blake": "Kuijk-Blake by acos (at the edge) or a polynomial", "binomial power": "binomial power, k",
}  # fmt: skip


def run(size: str = "full") -> dict[str, Any]:
    """Errors, energies, operations and times of all formulas (small: of a few, on fewer angles)."""
    full, few = size == "full", ("power", "power-fixed", "schlick", "lyon-4", "binomial-16")
    forms = [form for form in lobe_error.FORMS if full or form.name in few]
    evaluations, rounds, samples = (10_000_000, 150, 90_001) if full else (200_000, 3, 9_001)
    kernels = {(form.name, n): form.kernel(n) for form in forms for n in (EXPONENTS if form.fixed else EXPONENTS[1:2])}
    timed = {f"{name} {n}": kernel for (name, n), kernel in kernels.items()}
    times = {}
    for dtype in ("float32", "float64"):
        taken = timing.nanoseconds({**lobe_error.REFERENCES, **timed}, evaluations, jnp.dtype(dtype), rounds=rounds)
        times[dtype] = {name: [time.best, time.median] for name, time in taken.items()}
    results = []
    for form in forms:
        energies = lobe_error.energies(form, EXPONENTS)
        for i, n in enumerate(EXPONENTS):
            key = f"{form.name} {n if form.fixed else EXPONENTS[1]}"
            results.append({
                "name": form.name, "kind": form.kind, "label": form.label, "n": n, "fixed": form.fixed,
                "nanoseconds": {dtype: times[dtype][key][0] for dtype in times},
                "median_nanoseconds": {dtype: times[dtype][key][1] for dtype in times},
                "operations": lobe_error.flops(form, n),
                "errors": {**lobe_error.errors(form, n, samples), "energy": abs(energies["mirror"][i] - 1)},
                "energies": {name: values[i] for name, values in energies.items()},
            })  # fmt: skip
    single = {name: {dtype: times[dtype][name][0] for dtype in times} for name in lobe_error.REFERENCES}
    summary = {"nanoseconds": single, "claims": lobe_error.claims(results) if full else [["-", "1.00", "-"]]}
    settings = {"evaluations": evaluations, "rounds": rounds, "angles": samples, "exponents": EXPONENTS}
    return {"settings": settings, "results": results, "summary": summary}


def plot(record: dict[str, Any]) -> Any:
    """A column an exponent, a row an error; the frontier of what no other formula beats is grey."""
    loop = record["summary"]["nanoseconds"]["loop alone"]["float32"]
    with paper.house_style():
        figure = paper.empty(8.6, 9.4)
        grid = figure.subplots(len(ROWS), len(EXPONENTS), sharex=True, sharey="row")
        for (i, row), (j, n) in itertools.product(enumerate(ROWS), enumerate(EXPONENTS)):
            axes, results = grid[i][j], [result for result in record["results"] if result["n"] == n]
            label, least, ceiling, ticks = ROWS[row]
            points = [(min(r["nanoseconds"]["float32"], MOST), max(r["errors"][row], least), r) for r in results]
            best = charts.frontier([(x, y) for x, y, result in points if not result["fixed"]])
            axes.plot(*zip(*best, strict=True), color="#888888", linewidth=3, alpha=0.5, zorder=1)
            axes.axvline(loop, color="#888888", linewidth=0.8, dashes=(3, 2))
            where = [(x, y, r["kind"]) for x, y, r in points]
            places = charts.label_places(where, COLUMNS, (ceiling / least) ** 0.052)
            for (x, y, result), place in zip(points, places, strict=True):
                color, marker = LOBES[kind := result["kind"]]
                look = {"color": "white" if result["fixed"] else color, "markeredgecolor": color, "markersize": 5}
                axes.plot(x, y, marker=">" if x == MOST else marker, clip_on=False, zorder=3, **look)
                text = result["label"] + (f" {result['nanoseconds']['float32']:.0f} ns" if x == MOST else "")
                side = "right" if x == MOST or kind == "binomial power" else "center" if kind == "Schlick" else "left"
                look = {"ha": side, "va": "center", "fontsize": 7.5, "color": ink(color)}
                if kind in BESIDE:  # in a column, with a line to its marker
                    away = (place[0] * BESIDE[kind], place[1])
                    line = {"arrowstyle": "-", "color": color, "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2}
                    axes.annotate(text, (x, y), away, arrowprops=line, **look)
                else:
                    axes.annotate(text, place, SHIFTS[side], textcoords="offset points", **look)
            axes.set(xscale="log", yscale="log", xlim=(loop / 1.1, MOST), ylim=(least / 1.8, ceiling))
            axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1], ["0.05", "0.1", "0.2", "0.5", "1"])
            axes.set_yticks([least, *ticks], ["0", *(paper.text_of(tick) for tick in ticks)])
            axes.minorticks_off()
            axes.grid(True)
            if row == "max":
                axes.axhline(STEP, color="#888888", linewidth=0.8, dashes=(1, 2))
            axes.set(title=f"n = {n}" if i == 0 else "", ylabel=label if j == 0 else "")
        handles = [axes.plot([], [], marker=LOBES[kind][1], linestyle="", color=LOBES[kind][0])[0] for kind in KINDS]
        figure.legend(handles, KINDS.values(), loc="outside upper center", ncol=3, handlelength=1.2, columnspacing=1.6)
        figure.supxlabel(
            "nanoseconds of one evaluation, float32; dashed: the loop alone; dotted: one step of 8 bits; grey: the frontier",
            fontsize=9,
        )
    return figure


def summary(record: dict[str, Any]) -> str:
    """The claims, and all numbers as tables."""
    claims = table(("claim", "measured, n = 10 / 100 / 1000", "holds"), record["summary"]["claims"])
    keys = list((results := record["results"])[0]["errors"])
    errors = [
        (f"`{r['name']}`", f"{r['n']}", *(f"{r['errors'][k]:.2g}" for k in keys), *(f"{e:.4f}" for e in r["energies"].values()))
        for r in results
    ]
    costs = [
        (f"`{r['name']}`", str(r["n"]) if r["fixed"] else "any", *(f"{v:.3f}" for v in r["nanoseconds"].values()),
         *(f"{v:.3f}" for v in r["median_nanoseconds"].values()), *map(str, r["operations"].values()))
        for r in results if r["fixed"] or r["n"] == 100
    ]  # fmt: skip
    single = [(name, f"{t['float32']:.3f}", f"{t['float64']:.3f}") for name, t in record["summary"]["nanoseconds"].items()]
    header = ("formula", "n", "ns, float32", "float64", "median, float32", "float64", "arithmetic", "divisions", "functions")
    return (
        "What the proposal of the 16th power (seed 001) says of itself and of others. Times are shares of that of exp(n log c):"
        f"\n\n{claims}\n\nTimes of single operations in the same run, ns:\n\n{table(('', 'float32', 'float64'), single)}"
        f"\n\nTimes and operations of one evaluation:\n\n{table(header, costs)}\n\nErrors (as `_instruments.lobe_error.errors`"
        " has them), and the albedo at normal incidence with the power's factor:"
        f"\n\n{table(('formula', 'n', *keys, 'E mirror', 'E half'), errors)}"
    )
