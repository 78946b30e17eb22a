#!/usr/bin/env python3
"""How many facets, which interpolation and which precision does a glossy sphere need?

Command: ``brdfcheck study shading_cost`` (or ``python studies/shading_cost.py``).
10 seconds on two cores, 2 minutes before its programs are compiled.

Answer: none: the exact sphere takes a seventh of the time of 1280 Phong-shaded faces (2.5 for 17 ms) and errs by 3e-7, where no
mesh up to 20,480 faces comes below 2e-3. Of meshes, Phong shading costs a tenth more than Gouraud's and errs by half up to 320
faces; flat shading takes half the time and needs 16 times the faces. float64 takes a third longer and buys nothing.

One sphere of Lambert and Blinn-Phong (n = 30) under two distant lights, 512 x 512 pixels. Meshes are icospheres of 20 to
20,480 faces. Errors are those of linear RGB to the exact sphere in float64, over the disc: what the silhouette loses is in.
"""

from __future__ import annotations

import itertools
import time
from typing import Any

SHADINGS = {"flat": ("#999999", "s"), "gouraud": ("#E69F00", "^"), "phong": ("#0072B2", "o"), "exact sphere": ("#000000", "*")}
METHODS, MIDDLE = ("area", "oblique", "scan-line"), 3  # of interpolation; on a mesh of 1280 faces
FLOOR = 1e-7  # of the chart


def run(size: str = "full") -> dict[str, Any]:
    """Milliseconds of a warm image, and its errors, for each number of faces, shading and precision."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from brdfcheck.scene.cameras import Orthographic
    from brdfcheck.scene.lights import Distant
    from brdfcheck.scene.materials import Surface, Term
    from brdfcheck.scene.meshes import icosphere
    from brdfcheck.scene.smooth import render_mesh
    from brdfcheck.scene.sphere import sphere_image

    full = size == "full"
    pixels, levels, rounds = ((512, 512), range(6), 5) if full else ((64, 64), range(1, 3), 1)
    material = Surface(Term("lambert", (0.5, 0.4, 0.3)), Term("blinn-phong", 0.2, n=30.0))
    lights = (Distant((0.5, 0.6, 0.62), (3.0, 2.8, 2.5)), Distant((-0.7, 0.1, 0.7), (0.9, 1.0, 1.2)))
    camera = Orthographic()
    exact = np.asarray(sphere_image(material, lights, camera, size=pixels, dtype=jnp.float64))
    disc = np.any(exact > 0, axis=0)
    jobs: dict[tuple[str, int, str], Any] = {}
    for dtype in (jnp.float32, jnp.float64):
        precision = jnp.dtype(dtype).name
        jobs["exact sphere", 0, precision] = lambda dtype=dtype: sphere_image(
            material, lights, camera, size=pixels, dtype=dtype
        )
        for level in levels:
            mesh = icosphere(level, dtype)
            for shading in ("flat", "gouraud", "phong"):
                jobs[shading, 20 * 4**level, precision] = lambda mesh=mesh, shading=shading: render_mesh(
                    mesh, camera, material, lights, size=pixels, shading=shading
                )
    mesh = icosphere(MIDDLE, jnp.float32)
    for shading, way in itertools.product(("gouraud", "phong"), METHODS):
        jobs[f"{shading}, {way}", len(mesh.faces), "float32"] = lambda shading=shading, way=way: render_mesh(
            mesh, camera, material, lights, size=pixels, shading=shading, interpolation=way
        )
    images = {key: np.asarray(job(), float) for key, job in jobs.items()}
    best = dict.fromkeys(jobs, float("inf"))
    for _ in range(rounds):
        for key, job in jobs.items():
            began = time.perf_counter()
            jax.block_until_ready(job())
            best[key] = min(best[key], time.perf_counter() - began)
    rows = []
    for (shading, faces, precision), image in images.items():
        error = np.abs(image - exact)[:, disc]
        rows.append({"shading": shading, "faces": faces, "precision": precision,
                     "milliseconds": 1e3 * best[shading, faces, precision], "rms": float(np.sqrt(np.mean(error**2))),
                     "share": float(np.mean(np.any(error > 0.5 / 255, axis=0)))})  # fmt: skip
    results = [row for row in rows if row["shading"] in SHADINGS]
    methods = [row for row in rows if row["shading"] not in SHADINGS]
    return {"settings": {"pixels": list(pixels), "rounds": rounds}, "results": results, "summary": {"methods": methods}}


def plot(record: dict[str, Any]) -> Any:
    """Error against time; numbers are faces; float64 is hollow, and on the sphere the reference itself: on the lower edge."""
    from brdfcheck import plots
    from brdfcheck.plots.paper import plain_log
    from brdfcheck.plots.precision import frontier

    results = [result for result in record["results"] if result["rms"] > 0]
    with plots.house_style():
        figure = plots.empty(8.0, 6.4)
        axes = figure.subplots()
        axes.set(xscale="log", yscale="log")
        edge = frontier([(result["milliseconds"], result["rms"]) for result in results])
        axes.plot(*zip(*edge, strict=True), color="#888888", linewidth=3, alpha=0.5, zorder=1, drawstyle="steps-post")
        for (shading, (color, marker)), precision in itertools.product(SHADINGS.items(), ("float32", "float64")):
            own = [r for r in record["results"] if (r["shading"], r["precision"]) == (shading, precision)]
            places = [(result["milliseconds"], max(result["rms"], FLOOR)) for result in own]
            look: dict[str, Any] = {"color": color, "marker": marker, "linewidth": 0.8, "clip_on": False}
            look["markerfacecolor"] = color if precision == "float32" else "white"
            axes.plot(*zip(*places, strict=True), label=f"{shading}, {precision}", **look)
            for result, place in zip(own, places, strict=True):
                left = (shading, precision) == ("flat", "float32")
                if left or (shading, precision) == ("phong", "float64"):
                    text, offset = f"{result['faces']:,} faces", (-7, -2) if left else (7, -2)
                    side = "right" if left else "left"
                    axes.annotate(text, place, offset, textcoords="offset points", fontsize=7, ha=side)
                if not result["rms"]:
                    axes.annotate("the reference", place, (8, 3), textcoords="offset points", fontsize=7)
        plain_log(axes.yaxis)
        ticks = [1, 2, 5, 10, 20, 50, 100]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.set(xlim=(1, 100), ylim=(FLOOR, 1))
        axes.set(xlabel="milliseconds for one image, warm", ylabel="root mean square error of linear RGB")
        axes.grid(True)
        axes.legend(fontsize=8, loc="center right")
    return figure


def summary(record: dict[str, Any]) -> str:
    """The tables behind the figure, and of the three ways of interpolation."""
    from brdfcheck.studies import table

    def rows(found: list[dict[str, Any]]) -> list[tuple[str, ...]]:
        return [
            (r["shading"], f"{r['faces']:,}" if r["faces"] else "", r["precision"], f"{r['milliseconds']:.2f}",
             f"{r['rms']:.2g}", f"{100 * r['share']:.1f} %")
            for r in found
        ]  # fmt: skip

    header = ("shading", "faces", "precision", "ms", "rms error", "pixels off by more than half an 8-bit step")
    return (
        f"Of {record['settings']['pixels'][0]} x {record['settings']['pixels'][1]} pixels:\n\n"
        f"{table(header, rows(record['results']))}\n\nInterpolation in the triangle by three methods:\n\n"
        f"{table(header, rows(record['summary']['methods']))}"
    )


if __name__ == "__main__":
    from brdfcheck.studies import main

    main(__file__)
