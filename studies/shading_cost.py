"""How many facets, which interpolation and which precision does a glossy sphere need?

Command: ``brdfcheck study shading_cost``. A minute on two cores.

Answer: none: the exact sphere takes a quarter of the time of 1280 Phong-shaded faces and errs by 3e-7, where no mesh up to
20,480 faces comes below 2e-3. Of meshes, Phong shading errs 0.61 and 0.79 times as much as Gouraud's at 320 and 1280 faces, in
two thirds of the time; flat shading takes 0.6 to 0.8 of the time, and up to 3.3 times the faces for Gouraud's error. float64
takes 1.3 to 1.7 times as long, 2.7 times for the exact sphere, and buys nothing.

One sphere of Lambert and Blinn-Phong (n = 30) under two distant lights; meshes are icospheres. Errors: of linear RGB to the
exact sphere in float64, over its whole disc, lit or not. Every round renders each setting once; times and ratios are medians.
"""

from __future__ import annotations

import functools
import itertools
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

from _instruments.charts import frontier
from brdfcheck.cores import available_cores
from brdfcheck.plots import paper
from brdfcheck.scene.cameras import Orthographic
from brdfcheck.scene.lights import Distant
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.meshes import icosphere
from brdfcheck.scene.smooth import render_mesh
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.studies import table

ALONE = True  # times programs on all cores
SHADINGS = {"flat": ("#999999", "s"), "gouraud": ("#E69F00", "^"), "phong": ("#0072B2", "o"), "exact sphere": ("#000000", "*")}
METHODS, MIDDLE, FLOOR = ("area", "oblique", "scan-line"), 3, 1e-3  # of interpolation, on 1280 faces; of the chart
RATIOS = ("time, Phong to Gouraud", "error", "time, flat to Gouraud", "error", "faces of flat for Gouraud's error, times",
          "time, float64 to float32, Phong", "time, exact to Phong")  # fmt: skip


def run(size: str = "full") -> dict[str, Any]:
    """Milliseconds of a warm image, and its errors, for each number of faces, shading and precision."""
    pixels, levels, rounds = ((512, 512), range(2, 6), 15) if size == "full" else ((64, 64), range(1, 3), 3)
    material = Surface(Term("lambert", (0.5, 0.4, 0.3)), Term("blinn-phong", 0.2, n=30))
    lights = (Distant((0.5, 0.6, 0.62), (3.0, 2.8, 2.5)), Distant((-0.7, 0.1, 0.7), (0.9, 1.0, 1.2)))
    scene, ball = (Orthographic(), material, lights), functools.partial(sphere_image, material, lights, Orthographic())
    jobs: dict[tuple[str, int, str], Any] = {}
    for precision, shadings in (("float32", ("flat", "gouraud", "phong")), ("float64", ("phong",))):
        jobs["exact sphere", 0, precision] = functools.partial(ball, size=pixels, dtype=precision)
        for level, shading in itertools.product(levels, shadings):
            drawn = functools.partial(render_mesh, icosphere(level, precision), *scene, size=pixels, shading=shading)
            jobs[shading, 20 * 4**level, precision] = drawn
    for shading, way in itertools.product(("gouraud", "phong"), METHODS):
        drawn = functools.partial(render_mesh, icosphere(MIDDLE, "float32"), *scene, size=pixels, shading=shading)
        jobs[f"{shading}, {way}", 20 * 4**MIDDLE, "float32"] = functools.partial(drawn, interpolation=way)
    with ThreadPoolExecutor(len(available_cores())) as pool:  # compiling takes longer than all rounds together
        images = dict(zip(jobs, pool.map(lambda job: np.asarray(job(), float), jobs.values()), strict=True))
    times: dict[tuple[str, int, str], list[float]] = {key: [] for key in jobs}
    for number in range(rounds):  # there and back, so that no setting always comes after the same one
        for key in list(jobs)[:: 1 - 2 * (number % 2)]:
            began = time.perf_counter()
            jax.block_until_ready(jobs[key]())
            times[key].append(1e3 * (time.perf_counter() - began))
    y, x = (1.05 * ((np.arange(count) + 0.5) / count * 2 - 1) for count in pixels)  # the camera sees 2.1 of space
    disc, rows = x**2 + y[:, None] ** 2 < 1, []
    for key, image in images.items():
        error = np.abs(image - images["exact sphere", 0, "float64"])[:, disc]
        low, middle, high = np.quantile(times[key], (0.25, 0.5, 0.75))
        rows.append({"shading": key[0], "faces": key[1], "precision": key[2], "milliseconds": middle, "spread": high - low,
                     "rms": np.sqrt(np.mean(error**2)), "share": np.mean(np.any(error > 0.5 / 255, axis=0))})  # fmt: skip
    rms = {(row["shading"], row["faces"], row["precision"]): row["rms"] for row in rows}
    counts, ratios = [20 * 4**level for level in levels], {}
    for faces in counts:
        flat, gouraud, phong, double, exact = (("flat", faces, "float32"), ("gouraud", faces, "float32"),
            ("phong", faces, "float32"), ("phong", faces, "float64"), ("exact sphere", 0, "float32"))  # fmt: skip
        coarse = [np.log(rms["flat", count, "float32"]) for count in counts[::-1]]  # rising
        same = np.exp(np.interp(np.log(rms[gouraud]), coarse, np.log(counts[::-1]), left=np.nan)) / faces
        paired = [np.median(np.divide(times[one], times[other])) for one, other in
                  ((phong, gouraud), (flat, gouraud), (double, phong), (exact, phong))]  # fmt: skip
        found = (paired[0], rms[phong] / rms[gouraud], paired[1], rms[flat] / rms[gouraud], same, *paired[2:])
        ratios[f"{faces}"] = [float(x) if x == x else None for x in found]
    results, methods = ([row for row in rows if (row["shading"] in SHADINGS) is plain] for plain in (True, False))
    found = {"methods": methods, "ratios": ratios}
    return {"settings": {"pixels": pixels, "rounds": rounds}, "results": results, "summary": found}


def plot(record: dict[str, Any]) -> Any:
    """Error against time; numbers are faces; float64 is hollow. The exact sphere, far below, stands on the lower edge."""
    with paper.house_style():
        figure = paper.empty(8.0, 5.6)
        axes = figure.subplots()
        axes.set(xscale="log", yscale="log")
        edge = frontier([(result["milliseconds"], result["rms"]) for result in record["results"] if result["faces"]])
        look: dict[str, Any] = {"color": "#888888", "linewidth": 4, "alpha": 0.5, "drawstyle": "steps-post", "zorder": 1}
        axes.plot(*zip(*edge, strict=True), label="frontier of meshes", **look)
        for (shading, (color, marker)), precision in itertools.product(SHADINGS.items(), ("float32", "float64")):
            own = [r for r in record["results"] if (r["shading"], r["precision"]) == (shading, precision)]
            if not own:
                continue
            look = {"color": color, "marker": marker, "linewidth": 0.8, "clip_on": False}
            look["markerfacecolor"] = color if precision == "float32" else "white"
            places = [(result["milliseconds"], max(result["rms"], FLOOR)) for result in own]
            axes.plot(*zip(*places, strict=True), label=f"{shading}, {precision}", **look)
            for result, place in zip(own, places, strict=True):
                here: dict[str, Any] = {"xy": place, "textcoords": "offset points", "fontsize": 7}
                if not result["faces"]:
                    below = f"{result['rms']:.1e}" if result["rms"] else "0: the reference"
                    axes.annotate(f"{precision}: {below}", xytext=(0, 8), ha="center", **here)
                elif (shading, precision) == ("phong" if result is own[-1] else "flat", "float32"):  # where there is room
                    place = {"xytext": (0, -13), "ha": "center"} if result is own[-1] else {"xytext": (-7, -2), "ha": "right"}
                    axes.annotate(f"{result['faces']:,} faces", **place, **here)
        ticks, decades = [1, 2, 5, 10, 20, 50], range(-3, 1)
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        paper.decades(axes.set_yticks, decades)
        axes.minorticks_off()
        axes.set(xlim=(1, 50), ylim=(FLOOR, 1), xlabel="milliseconds for one image, warm", ylabel="rms error of linear RGB")
        axes.grid(True)
        axes.legend(fontsize=8, loc="upper right")
    return figure


def summary(record: dict[str, Any]) -> str:
    """The tables behind the figure, their ratios, and the three ways of interpolation."""
    header = ("shading", "faces", "precision", "ms", "quartiles apart", "rms error", "pixels off by half a step of 8 bit")

    def rows(found: list[dict[str, Any]]) -> str:
        return table(header, [(r["shading"], f"{r['faces']:,}" if r["faces"] else "", r["precision"],
                               f"{r['milliseconds']:.2f}", f"{r['spread']:.2f}", f"{r['rms']:.2g}", f"{100 * r['share']:.1f} %")
                              for r in found])  # fmt: skip

    measured = record["summary"]["ratios"].items()
    ratios = [(faces, *(f"{x:.2f}" if x else "none here" for x in values)) for faces, values in measured]
    pixels, rounds = record["settings"]["pixels"], record["settings"]["rounds"]
    return "\n\n".join((f"Of {pixels[0]} x {pixels[1]} pixels, medians of {rounds} rounds:", rows(record["results"]),
                        "Ratios, in float32 where nothing else is said:", table(("faces", *RATIOS), ratios),
                        "Interpolation in the triangle by three methods:", rows(record["summary"]["methods"])))  # fmt: skip
