"""How much light does a closed box hold, which of four solvers gets there fastest, and what do more patches cost?

Command: ``brdfcheck study enclosure``. Under two minutes on two cores.

Answer: the cube's glowing wall (rho = 0.7) sends out 1.2865 by one patch a wall and 1.3131 by 1,536 (paths: 1.3134 +- 0.0003).
Conjugate gradients win at every accuracy: 13 digits for 1,024 patches in 4 ms, where the series takes 30 ms and shooting 1 s;
LU gives 15 in 26 ms, 262,144 paths one and a half in 0.8 s. Form factors and direct solve take 0.07 s for 1,024 patches (8 MiB
of form factors, 24 MiB in all) and 3 s for 4,096 (128 and 384 MiB; the whole process 1.2 GiB). At rho = 1.01 LU returns -16;
series and shooting refuse.

Left: a half cube of 1,024 patches (rho = 0.9) whose answer is known because its emission was made from it. Middle: half cubes
of 16 to 4,096 patches, rho = 0.7. Right: the cube with one glowing wall, by k x k patches a wall and without patches by paths.
Times of solvers are on one core.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from _instruments import transport as measure
from _instruments.transport import SOLVERS
from brdfcheck import transport
from brdfcheck.cores import on_one_core
from brdfcheck.output import records
from brdfcheck.plots import paper
from brdfcheck.studies import table

RHO = (0.5, 0.9, 0.99, 1.0, 1.01)
HALF_CUBE = (1.0, 1.0, 0.5)
WALLS = {"glowing": "#D55E00", "opposite": "#0072B2", "sides": "#009E73"}


def run(size: str = "full") -> dict[str, Any]:
    """Speed against accuracy, growth, and refinement (small: fewer patches and paths)."""
    full, key = size == "full", jax.random.key(2)
    many, few = (3, 8) if full else (1, 2)
    room = transport.box(HALF_CUBE, (16, 16, 8) if full else (4, 4, 2))
    wanted = 1 + 0.05 * np.sin(0.37 * np.arange(room.patches))
    emission = wanted - 0.9 * (np.asarray(room.form_factors) @ wanted)
    cells = (1, 4, 8, 16) if full else (1, 2)
    with on_one_core():
        points = measure.work_precision(room, emission, 0.9, wanted, key=key, settings=few, repeats=many)
        costs = measure.growth([(2 * k, 2 * k, k) for k in cells], size=HALF_CUBE, repeats=many)
    refined, light = measure.refinement(cells, 0.7, key=key, paths=2**21 if full else 2**14)
    cube = transport.box()
    levels = measure.levels(cube, cube.on_wall(4, 1.0), RHO)
    balance = {name: float(getattr(room.balance, name)) for name in ("reciprocity", "row_sums", "change")}
    told = {"growth": costs, "refined": refined, "light": light, "levels": levels, "balance": balance}
    settings = {"rho": 0.9, "patches": room.patches}
    return {"settings": settings, "results": records.plain(points), "summary": records.plain(told)}


def plot(record: dict[str, Any]) -> Any:
    """Error against seconds; seconds against patches; radiosity against patches."""
    told = record["summary"]
    with paper.house_style():
        figure = paper.empty(12.6, 4.4)
        work, growth, refine = figure.subplots(1, 3)
        patches = [cost["patches"] for cost in told["growth"]]
        for name, (label, color, marker) in SOLVERS.items():
            own = [point for point in record["results"] if point["method"] == name]
            x, y = [p["seconds"] * 1e3 for p in own], [max(p["error"], 1e-16) for p in own]
            work.plot(x, y, color=color, marker=marker, linewidth=1, label=label)
            if name != "paths":
                y = [cost["solver_seconds"][name] for cost in told["growth"]]
                growth.plot(patches, y, color=color, marker=marker, linewidth=1)
        y = [cost["form_factor_seconds"] for cost in told["growth"]]
        (line,) = growth.plot(patches, y, color="#777777", marker="_", dashes=(3, 2))
        work.set(xscale="log", yscale="log", xlabel="milliseconds, warm", ylabel="largest relative error")
        work.set(title=f"{record['settings']['patches']:,} patches, ρ = {record['settings']['rho']}")
        growth.set(xscale="log", yscale="log", xlabel="patches", ylabel="seconds", title="growth, ρ = 0.7, tolerance 10⁻⁶")
        refine.set(xscale="log", xlabel="patches", ylabel="change from one patch a wall, %")
        refine.set(title="cube, ρ = 0.7; bands: paths ± 1 σ")
        x = [step["patches"] for step in told["refined"]]
        for i, (wall, color) in enumerate(WALLS.items()):
            first, last = (told["refined"][place][wall] for place in (0, -1))
            changes = [100 * (step[wall] / first - 1) for step in told["refined"]]
            refine.plot(x, changes, color=color, marker="o")
            middle, error = 100 * (told["light"][wall] / first - 1), 100 * told["light"]["errors"][i] / first
            refine.axhspan(middle - error, middle + error, color=color, alpha=0.25, linewidth=0)
            look = {"textcoords": "offset points", "ha": "right", "fontsize": 7.5, "color": color}
            refine.annotate(f"{wall}: {first:.5f} → {last:.5f}", (x[-1], changes[-1]), (0, (7, 20, -13)[i]), **look)
        for axes, places in ((growth, patches), (refine, x)):
            axes.set_xticks(places, [f"{count:,}" for count in places])
        for axes in (work, growth, refine):
            axes.minorticks_off()
            axes.grid(True)
        paper.decades(work.set_yticks, (-16, -12, -8, -4, 0))
        for axis in (work.xaxis, growth.yaxis):
            axis.set_major_formatter(lambda value, _: paper.text_of(value, 3))
        handles, labels = work.get_legend_handles_labels()
        figure.legend([*handles, line], [*labels, "form factors"], loc="outside upper center", ncols=6, handlelength=2)
    return figure


def summary(record: dict[str, Any]) -> str:
    """Tables of all three, and the reflectances up to and beyond 1."""
    told, best = record["summary"], {}
    for point in sorted(record["results"], key=lambda point: -point["error"]):
        best[point["method"]] = point
    work = [(f"`{name}`", f"{p['error']:.1e}", f"{float(p['claimed']):.1e}", f"{1e3 * p['seconds']:.2f}", f"{p['cost']:.3g}")
            for name, p in best.items()]  # fmt: skip
    held = ("matrix_bytes", "direct_bytes", "process_bytes")
    growth = [(f"{g['patches']:,}", f"{g['form_factor_seconds']:.4f}", *(f"{s:.4f}" for s in g["solver_seconds"].values()),
               *(f"{g[name] / 2**20:.4g}" for name in held)) for g in told["growth"]]  # fmt: skip
    refined = [(f"{step['patches']:,}", *(f"{step[wall]:.8f}" for wall in WALLS)) for step in told["refined"]]
    errors = zip((told["light"][wall] for wall in WALLS), told["light"]["errors"], strict=True)
    refined.append(("none, by paths", *(f"{value:.5f} ± {error:.5f}" for value, error in errors)))
    # Of the cube's six walls: the glowing one, the one opposite, a side.
    levels = [(f"{r['reflectance']:g}", f"`{r['method']}`", *(f"{float(r['value'][i]):.8g}" for i in (4, 5, 0)),
               f"{float(r['error']):.1e}", r["status"]) for r in told["levels"]]  # fmt: skip
    balance = ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in told["balance"].items())
    return (
        "Smallest error of each solver and what it took (cost: products of a form factor with a radiosity, for paths rays):\n\n"
        + table(("solver", "relative error", "claimed", "ms", "cost"), work)
        + f"\n\nForm factors were off before they were balanced by: {balance}.\n\nSeconds by patches, and MiB of the form"
        " factors, of all that the direct solve's program holds at once, and of the process at its peak so far:\n\n"
        + table(("patches", "form factors", *told["growth"][0]["solver_seconds"], "matrix", "direct solve", "process"), growth)
        + "\n\nMean radiosity of the walls of a cube, ρ = 0.7, one wall emitting 1:\n\n"
        + table(("patches", *WALLS), refined)
        + "\n\nOne patch a wall, up to and beyond ρ = 1:\n\n"
        + table(("ρ", "solver", *WALLS, "error", "status"), levels)
    )
