"""What does a table of GGX for renderers cost, and how far off are the formulas that are used in its place?

Command: ``brdfcheck study renderer_tables``. A minute on two cores.

Answer: 0.4 seconds of one core for 64 x 64 albedos of GGX, off by 4e-14 with bars of 8e-9. A plain Gauss rule in numpy has
four digits in twice as long, Mitsuba's sampling two in ten times. Of the formulas in place of a table MaterialX's rational fit
is off by 0.11, with 203 of 4,096 cells above 1, the approximation for mobile hardware by 0.51 at grazing incidence; the
functions that `brdfcheck table` writes, with 50 coefficients, by 0.011.

Height-correlated Smith masking, alpha = roughness^2, nodes in the middle of 64 x 64 texels. Errors of the ways to make a table
are those on 32 cells of roughness 0.32 and more, where the rule in numpy with 600 nodes an axis is a reference; times are
seconds of CPU on one core, programs compiled, and of Mitsuba those of 24 cells one by one. The formulas are measured against
the table of `brdfcheck table`. Peers take part where they are installed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _instruments import renderer
from _instruments.peers import PEERS, metal_table
from brdfcheck import GGX, albedo_table
from brdfcheck.cores import on_one_core
from brdfcheck.fits.compact import compact_fits
from brdfcheck.fits.renderer import renderer_table
from brdfcheck.plots import paper
from brdfcheck.studies import table

ORDERS = (16, 32, 64)
# Rows and columns of the 64 at which ways to make a table are compared.
ROWS, COLUMNS = (20, 34, 48, 63), (0, 2, 5, 11, 23, 32, 48, 63)


def run(size: str = "full") -> dict[str, Any]:
    """Times and errors of ways to make the table of E; errors of formulas for the split sum (small: 16 x 16, ours alone)."""
    full = size == "full"
    count = 64 if full else 16
    nodes = (np.arange(count) + 0.5) / count
    few = np.ix_(*(np.unique(np.array(part) * count // 64) for part in (ROWS, COLUMNS)))
    rows, columns = nodes[few[0][:, 0]], nodes[few[1][0]]
    exact = renderer.numpy_table(rows**2, columns, 600 if full else 64)
    results: list[dict[str, Any]] = []

    def add(way: str, setting: str, seconds: float, values: Any, claimed: float | None = None) -> None:
        error = float(np.max(np.abs(np.asarray(values) - exact)))
        results.append({"way": way, "setting": setting, "seconds": seconds, "error": error, "claimed": claimed})

    with on_one_core():
        for rtol in (1e-6, None):

            def table(rtol: float | None = rtol) -> tuple[Any, Any]:
                found = albedo_table(GGX, nodes**2, nodes, rtol=rtol)
                return np.asarray(found.value), np.asarray(found.error)

            seconds = min([renderer.seconds(table) for _ in range(4)][1:])
            value, error = table()
            add("brdfcheck", "best" if rtol is None else f"rtol {rtol:g}", seconds, value[few], float(np.max(error)))
        for order in ORDERS if full else ORDERS[:1]:
            seconds = renderer.seconds(lambda order=order: renderer.numpy_table(nodes**2, nodes, order))
            add("numpy", f"{order} x 2 x {order}", seconds, renderer.numpy_table(rows**2, columns, order))
        missing = {"mitsuba": PEERS["mitsuba"].missing(), "scipy with numba": metal_table.missing()}
        if full and missing["mitsuba"] is None:
            results += renderer.mitsuba(PEERS["mitsuba"], rows, columns)
    ours = renderer_table("ggx", {"roughness": (0, 1)}, size=(count, count))
    roughness, mu = np.meshgrid(nodes, nodes, indexing="ij")
    fits = compact_fits(ours, None if full else (2, 1))
    assert fits.share is not None
    white, share = fits.albedo(roughness, mu), fits.share(roughness, mu)
    pairs = {name: fit(roughness, mu) for name, fit in renderer.FITS.items()} | {
        "brdfcheck": (white * (1 - share), white * share)
    }
    formulas = [renderer.formula(name, *pair, ours, nodes) for name, pair in pairs.items()]
    summary = {"formulas": formulas, "coefficients": fits.albedo.coefficients + fits.share.coefficients}
    return {"settings": {"count": count, "missing_peers": missing}, "results": results, "summary": summary}


def plot(record: dict[str, Any]) -> Any:
    """Left: error against seconds of the ways to make a table. Right: the largest error of E at each roughness by formulas."""
    colors = {"brdfcheck": "#8C2D04", "numpy": "#0072B2", "Mitsuba": "#661100", "MaterialX, rational": "#009E73"}
    with paper.house_style():
        figure = paper.empty(8.0, 3.6)
        left, right = figure.subplots(1, 2)
        for way in dict.fromkeys(result["way"] for result in record["results"]):
            own = [result for result in record["results"] if result["way"] == way]
            left.plot([r["seconds"] for r in own], [r["error"] for r in own], "o-", color=colors[way], label=way)
        left.set(xscale="log", yscale="log", xlabel="seconds for one table of E, one core", ylabel="largest error")
        paper.decades(left.set_xticks, range(-1, 4))
        paper.decades(left.set_yticks, range(-14, 0, 2))
        count = record["settings"]["count"]
        nodes = [(k + 0.5) / count for k in range(count)]
        for formula in record["summary"]["formulas"]:
            label = f"{formula['name']}{', functions' if formula['name'] == 'brdfcheck' else ''}"
            right.plot(nodes, formula["by_row"], color=colors.get(formula["name"], "#CC79A7"), label=label)
        right.set(yscale="log", xlabel="roughness", ylabel="largest error of scale + bias = E")
        paper.decades(right.set_yticks, range(-4, 1))
        for axes in (left, right):
            axes.minorticks_off()
            axes.grid(True)
            axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return figure


def summary(record: dict[str, Any]) -> str:
    """The ways to make a table, and the formulas."""
    ways = [
        (
            r["way"],
            r["setting"],
            f"{r['seconds']:.2g}",
            f"{r['error']:.1e}",
            "-" if r["claimed"] is None else f"{r['claimed']:.1e}",
        )
        for r in record["results"]
    ]
    formulas = [
        (
            f["name"],
            f"{f['scale']:.2g}",
            f"{f['bias']:.2g}",
            f"{f['E']:.2g}",
            f"{f['rms']:.1e}",
            f"roughness {f['roughness']:.3g}, cos θ {f['cos_theta']:.3g}",
            str(f["above_1"]),
        )
        for f in record["summary"]["formulas"]
    ]
    count = record["settings"]["count"]
    absent = "; ".join(f"{message}" for message in record["settings"]["missing_peers"].values() if message) or "none"
    return (
        f"A table of E, {count} x {count} cells, in seconds of CPU on one core; the largest bar beside the largest error:\n\n"
        f"{table(('way', 'setting', 'seconds', 'error', 'claimed'), ways)}\n\n"
        "Formulas for the split sum against the table, with error bars of 1e-8:\n\n"
        f"{table(('formula', 'scale', 'bias', 'E', 'rms of E', 'worst at', 'cells above 1'), formulas)}\n\n"
        f"The functions of brdfcheck have {record['summary']['coefficients']} coefficients together.\n\n"
        f"Peers that were not installed: {absent}."
    )
