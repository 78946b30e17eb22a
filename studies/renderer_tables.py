"""What does a table of albedos for renderers cost, in seconds and in digits, by us and by others?

Command: ``brdfcheck study renderer_tables``. Two minutes on two cores.

Answer: 0.5 seconds of one core for 64 x 64 albedos of GGX, off by 4e-14 with bars of 8e-9; a plain Gauss rule in numpy has
four digits in 0.7 seconds, Mitsuba's sampling two in 6. For Beckmann metal the strongest of the others, scipy's dblquad
compiled by numba, takes 12 times as long in the same run on all cores, and errs 20 times as much (4e-11, ours 2e-12).

How much faster than the rule in numpy at a tenth of its error depends on how much that is: 2.2 times at 5e-4, 4.1 at 1e-4,
18 at 2e-5, for that rule's error falls as a power of its nodes, ours exponentially. What keeps it from ten times at 1e-4: all
cells have the nodes that the least roughness needs at grazing incidence (where roughness is 0.32 and more the error is a
thousandth of the largest), and the rule that the bars come from has 0.43 of the nodes. Tried: rows from roughness 0.32 on with
a hundredth of the accuracy (0.63 of the time was expected for the same largest error, 0.5 to 0.8 measured; not kept, for the
bars of these rows would be a hundred times wider), and E and bias as two channels of one program (0.7 of the time expected, 2.3
measured).

Left: GGX, height-correlated Smith masking, alpha = roughness^2, nodes in the middle of 64 x 64 texels. The best table is
compared on 32 cells of roughness 0.32 and more, where the rule in numpy with 600 nodes an axis is a reference, and others with
it in all cells; of Mitsuba 24 cells one by one.
Right: the job that others do too, Beckmann metal with F = 1 and separable Smith masking, 32 x 32 slopes and cosines, all cells
against a Gauss rule over slopes that is good to 1e-13. Times of GGX are seconds of CPU on one core, of Beckmann seconds on all
cores; programs are compiled before. Peers take part where they are installed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from _instruments import renderer
from _instruments.peers import PEERS
from brdfcheck import GGX, albedo_table
from brdfcheck.cores import on_one_core
from brdfcheck.plots import paper
from brdfcheck.studies import table

ORDERS = (16, 32, 64, 128)
ACCURACIES = (None, 1e-6, 1e-5, 1e-4)
# Rows and columns of the 64 at which ways to make a table are compared.
ROWS, COLUMNS = (20, 34, 48, 63), (0, 2, 5, 11, 23, 32, 48, 63)


def run(size: str = "full") -> dict[str, Any]:
    """Times and errors of ways to make both tables (small: 16 x 16 cells of GGX, ours and numpy's)."""
    full = size == "full"
    count = 64 if full else 16
    nodes = (np.arange(count) + 0.5) / count
    few = np.ix_(*(np.unique(np.array(part) * count // 64) for part in (ROWS, COLUMNS)))
    rows, columns = nodes[few[0][:, 0]], nodes[few[1][0]]
    results: list[dict[str, Any]] = []

    def add(way: str, setting: str, seconds: float, error: Any, claimed: float | None = None) -> None:
        worst = float(np.max(np.abs(error)))
        results.append({"way": way, "setting": setting, "seconds": seconds, "error": worst, "claimed": claimed, "job": "GGX"})

    # First: the threads of Mitsuba go on looking for work.
    others, scipy_missing = renderer.metal() if full else ([], None)
    with on_one_core():
        best = np.zeros(0)
        for rtol in ACCURACIES:

            def table(rtol: float | None = rtol) -> tuple[Any, Any]:
                found = albedo_table(GGX, nodes**2, nodes, rtol=rtol)
                return np.asarray(found.value), np.asarray(found.error)

            seconds = min([renderer.seconds(table) for _ in range(4)][1:])
            value, claimed = table()
            if rtol is None:
                best, off = value, value[few] - renderer.numpy_table(rows**2, columns, 600 if full else 64)
            else:
                off = value - best
            add("brdfcheck", "best" if rtol is None else f"rtol {rtol:g}", seconds, off, float(np.max(claimed)))
        for order in ORDERS if full else ORDERS[:1]:
            seconds = renderer.seconds(lambda order=order: renderer.numpy_table(nodes**2, nodes, order))
            add("numpy", f"{order} x 2 x {order}", seconds, renderer.numpy_table(nodes**2, nodes, order) - best)
        missing = {"mitsuba": PEERS["mitsuba"].missing(), **({"scipy with numba": scipy_missing} if full else {})}
        if full and missing["mitsuba"] is None:
            results += renderer.mitsuba(PEERS["mitsuba"], rows, columns)
    results += others
    *own, last = [result for result in results if result["job"] == "Beckmann"] or [{"way": "brdfcheck"}]
    times = {} if last["way"] == "brdfcheck" else {result["setting"]: last["seconds"] / result["seconds"] for result in own}
    return {
        "settings": {"count": count, "missing_peers": missing},
        "results": results,
        "summary": {"times_scipy": times, "times_numpy": _faster(results)},
    }


def _faster(results: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """By each setting of the rule in numpy how much longer it takes than ours that errs a tenth as much at most."""
    own, other = ([r for r in results if r["job"] == "GGX" and r["way"] == way] for way in ("brdfcheck", "numpy"))
    found = {}
    for peer in other:
        good = [r["seconds"] for r in own if r["error"] <= peer["error"] / 10]
        if good:
            found[peer["setting"]] = peer["seconds"] / min(good)
    return found


def plot(record: dict[str, Any]) -> Any:
    """Error against seconds of the ways to make each table."""
    colors = {"brdfcheck": "#8C2D04", "numpy": "#0072B2", "Mitsuba": "#CC79A7", "scipy with numba": "#009E73"}
    jobs = {"GGX": f"GGX, {record['settings']['count']} x {record['settings']['count']}", "Beckmann": "Beckmann metal, 32 x 32"}
    cores = {"GGX": "one core", "Beckmann": "all cores"}
    with paper.house_style():
        figure = paper.empty(8.0, 3.6)
        for job, axes in zip(jobs, figure.subplots(1, 2), strict=True):
            results = [result for result in record["results"] if result["job"] == job]
            for way in dict.fromkeys(result["way"] for result in results):
                own = [result for result in results if result["way"] == way]
                axes.plot([r["seconds"] for r in own], [r["error"] for r in own], "o-", color=colors[way], label=way)
            axes.set(xscale="log", yscale="log", xlabel=f"seconds, {cores[job]}", title=jobs[job])
            axes.set(xlim=(0.01, 1000), ylim=(1e-15, 1), ylabel="largest error" if job == "GGX" else "")
            paper.decades(axes.set_xticks, range(-2, 4))
            paper.decades(axes.set_yticks, range(-14, 1, 2))
            axes.minorticks_off()
            axes.grid(True)
            if results:
                axes.legend(fontsize=8)
    return figure


def summary(record: dict[str, Any]) -> str:
    """The ways to make each table."""
    ways = [
        (
            r["job"],
            r["way"],
            r["setting"],
            f"{r['seconds']:.2g}",
            f"{r['error']:.1e}",
            "-" if r["claimed"] is None else f"{r['claimed']:.1e}",
        )
        for r in record["results"]
    ]
    count = record["settings"]["count"]
    absent = "; ".join(f"{message}" for message in record["settings"]["missing_peers"].values() if message) or "none"
    times = [f"{ratio:.0f} at {setting}" for setting, ratio in record["summary"]["times_scipy"].items()]
    faster = [f"{ratio:.2g} of {setting}" for setting, ratio in record["summary"]["times_numpy"].items()]
    header = ("table", "way", "setting", "seconds", "error", "claimed")
    return (
        f"Tables of E, of GGX {count} x {count} cells (seconds of CPU on one core) and of Beckmann metal, 32 x 32 (seconds on"
        f" all cores); the largest bar beside the largest error:\n\n{table(header, ways)}\n\n"
        + (f"Times faster than scipy with numba in this run: {', '.join(times)}.\n\n" if times else "")
        + f"Times faster than numpy at a tenth of its error or less: {', '.join(faster) or 'none'}.\n\n"
        + f"Peers that were not installed: {absent}."
    )
