"""What does float32 cost in accuracy, and are its error bars honest?

Command: ``brdfcheck study precision_f32``. A minute on two cores.

Answer: about one digit of seven, and yes. Of 710 albedos of 21 lobes (n from 1 to 10^7, five angles, three engines) 691 are
finite, and all of these lie within their bars: off by at most 6e-7, the unclamped 16th power by 1.7e-6, with bars of 4e-6 to
5e-5 (adaptive engine: to 7e-4). Values are off by 3e-5 for Kuijk-Blake, 6e-6 at most for the others. Naive forms lose
n 2^-25: at n = 10^7 pow is off by 35 %, the 16th power from its cosine by 49 %, ours by 5e-7 and 1e-6. acos returns 0 up
to 2e-4 radians. c^n vanishes beyond 65.3, 23.6, 7.6 degrees for n = 100, 1000, 10^4.

Every lobe of the catalogue, without its factor, in both precisions with the same float32 numbers as parameters, versines and
cosines. Profiles count where they are at least 10^-4 of the peak. Naive forms form the cosine first, as textbooks do.
"""

from __future__ import annotations

import itertools
from typing import Any

from _instruments import single
from brdfcheck.brdf import catalog
from brdfcheck.output import records
from brdfcheck.plots import paper
from brdfcheck.plots.styles import LOBES, VARIANTS, ink, style_of
from brdfcheck.studies import table

EXPONENTS = tuple(10.0**power for power in range(8))
WIDTHS = (0.05, 0.1, 0.3, 1.0)
ANGLES = (0, 30, 60, 80, 89)
# Forms of the power and the 16th power in float32: lobe, label.
NAIVE = {
    "pow": ("Phong", "pow(c, n)"), "exp-log": ("Phong", "exp(n log c)"), "power": ("Phong", "cⁿ, ours"),
    "sum": ("binomial power", "(1 + (n/16)(c−1))¹⁶"), "binomial": ("binomial power", "16th power, ours"),
}  # fmt: skip


def run(size: str = "full") -> dict[str, Any]:
    """Errors of profiles and albedos by lobe, parameter and angle (small: four lobes), and of the naive forms."""
    names = ["phong", "schlick-mirror", "binomial-power-half", "ggx"] if size == "small" else single.distinct()
    results = []
    for name in names:
        family = catalog.entry(name).family
        (parameter,) = family.ranges
        values = {"n": EXPONENTS, "reflectance": (0.5,)}.get(parameter, WIDTHS)
        for value in values if size == "full" else values[1:3]:
            pair = single.both(family.build(**{parameter: value}))
            found = {"name": name, "parameter": parameter, "value": value, "profile": single.profile_error(*pair)}
            results.append({**found, **single.albedo_errors(*pair, ANGLES)})
    ours, true = single.both(catalog.entry("blinn-phong").family.build(n=100.0))
    adaptive = single.albedo_errors(lambda wi, wo: ours(wi.astype("float32"), wo.astype("float32")), true, ANGLES, rtol=1e-5)
    results.append({"name": "blinn-phong", "parameter": "n", "value": 100.0, "profile": None, **adaptive})
    cells = [cell for result in results for cell in zip(result["error"], result["bar"], strict=True)]
    known = [error <= bar for error, bar in cells if error < float("inf")]
    naive = single.naive_forms(EXPONENTS, 90_001 if size == "full" else 9_001)
    summary = {"cells": len(cells), "overflow": len(cells) - len(known), "honest": sum(known), **naive}
    results = records.plain(results)  # infinities are words in strict JSON
    return {"settings": {"angles": list(ANGLES), "exponents": list(EXPONENTS)}, "results": results, "summary": summary}


def plot(record: dict[str, Any]) -> Any:
    """Profiles, albedos and their bars, and naive forms beside ours."""
    found, exponents = record["summary"], record["settings"]["exponents"]
    dashes = {"pow": (5, 1.6), "exp-log": (1.2, 1.4), "sum": (5, 1.6)}
    with paper.house_style():
        figure = paper.empty(10.5, 7.0)
        (profile, value, bars), (naive, angle, flush) = figure.subplots(2, 3)
        kinds = dict.fromkeys(VARIANTS[result["name"]][0] for result in record["results"])
        for (axes, key), kind in itertools.product(((profile, "profile"), (value, "error")), kinds):
            worst: dict[float, float] = {}  # of all forms of the lobe
            for r in record["results"]:
                if VARIANTS[r["name"]][0] == kind and r["engine"] != "adaptive" and r["parameter"] == "n":
                    errors = map(float, r[key] if key == "error" else [r[key]])
                    found_here = [error for error in errors if error < 1]
                    worst[r["value"]] = max([*found_here, worst.get(r["value"], 0.0)])
            points = sorted((n, error) for n, error in worst.items() if error)
            axes.plot(*zip(*points or [(1, float("nan"))], strict=True), color=LOBES[kind][0], marker=LOBES[kind][1], ms=3.5)
        for r in record["results"]:
            color, marker = ("white", "s") if r["engine"] == "adaptive" else (style_of(r["name"]).color, "o")
            cells = [(max(float(e), 1e-9), b) for e, b in zip(r["error"], r["bar"], strict=True) if float(e) < 1]
            edge = style_of(r["name"]).color
            bars.plot(*zip(*cells or [(1e-9, float("nan"))], strict=True), marker, color=color, markeredgecolor=edge, ms=3)
        bars.plot([1e-10, 1], [1e-10, 1], color="black", linewidth=1)
        bars.annotate("bar = error", (3e-6, 3e-6), (4, -8), textcoords="offset points", va="top", fontsize=7.5)
        bars.plot([], [], "s", color="white", markeredgecolor="#444444", ms=4, label="adaptive rule")
        bars.plot([], [], "o", color="#444444", ms=4, label="other rules")
        bars.legend(loc="upper left", fontsize=7)
        for name, (lobe, label) in NAIVE.items():
            naive.plot(exponents, found["power"][name], color=LOBES[lobe][0], dashes=dashes.get(name, (1, 0)), label=label)
        naive.legend(loc="upper left", fontsize=7)
        for key, label, line in (("acos", "acos(c)", (5, 1.6)), ("asin", "2 asin √(versine/2), ours", (1, 0))):
            angle.plot(found["angle"], found[key], color=LOBES["Kuijk-Blake"][0], dashes=line, label=label)
        angle.legend(loc="upper right", fontsize=7, borderaxespad=0)
        flush.plot(exponents, found["flushed"], color=LOBES["Phong"][0], marker="o", markersize=4)
        for n, degrees in zip(exponents, found["flushed"], strict=True):
            flush.annotate(
                f"{degrees:.3g}°", (n, degrees), (4, 2), textcoords="offset points", fontsize=7, color=ink("#0072B2")
            )
        for axes in figure.axes:
            axes.set(xscale="log", yscale="log")
            axes.xaxis.set_major_formatter(lambda tick, _: paper.power_tick(tick))
            axes.yaxis.set_major_formatter(lambda tick, _: paper.power_tick(tick))
            axes.minorticks_off()
            axes.grid(True)
        curves = {
            VARIANTS[r["name"]][0] for r in record["results"] if r["parameter"] == "n"
        }  # the others are points on the right
        points, curve = {"marker": "o", "ms": 4, "linestyle": ""}, {"ms": 3.5}
        looks = {kind: {"marker": LOBES[kind][1], **curve} if kind in curves else points for kind in kinds}
        lines = [profile.plot([], [], color=LOBES[kind][0], **look)[0] for kind, look in looks.items()]
        figure.legend(lines, list(kinds), loc="outside lower center", ncol=10, handlelength=1.4, columnspacing=1.4)
        low = {"ylim": (2e-8, 1e-4), "xlabel": "n"}
        profile.set(title="values of the lobe, worst form", ylabel="relative error where g ≥ 10⁻⁴", **low)
        value.set(title="albedo, worst form of five angles", ylabel="relative error", **low)
        bars.set(
            title="error bar of each albedo",
            xlabel="relative error",
            ylabel="its error bar",
            xlim=(8e-10, 2e-5),
            ylim=(1e-7, 2e-3),
        )
        naive.set(title="the power, naive and ours", xlabel="n", ylabel="relative error where cⁿ ≥ 1/255", ylim=(3e-8, 3))
        angle.set(title="the angle, naive and ours", xlabel="angle (radians)", ylabel="relative error", ylim=(3e-9, 100))
        flush.set(title="cⁿ is 0 beyond this angle", xlabel="n", ylabel="degrees", ylim=(0.1, 200))
    return figure


def summary(record: dict[str, Any]) -> str:
    """The errors by lobe and angle, and the naive forms."""
    found, rows = record["summary"], []
    for name, engine in dict.fromkeys((r["name"], r["engine"]) for r in record["results"]):
        runs = [r for r in record["results"] if (r["name"], r["engine"]) == (name, engine)]
        profile = max((float(r["profile"]) for r in runs if r["profile"] is not None), default=float("nan"))
        angles = zip(*(r["error"] for r in runs), strict=True)
        bars = [float(bar) for r in runs for bar, error in zip(r["bar"], r["error"], strict=True) if float(error) < 1]
        errors = [max((float(e) for e in each if float(e) < 1), default=float("nan")) for each in angles]
        rows.append((f"`{name}`", engine, *(f"{error:.1e}" for error in (profile, *errors, max(bars)))))
    header = ("lobe of", "engine", "values", *(f"albedo, {angle}°" for angle in record["settings"]["angles"]), "largest bar")
    exponents = record["settings"]["exponents"]
    forms = [(f"{lobe}: {label}", *(f"{error:.1e}" for error in found["power"][k])) for k, (lobe, label) in NAIVE.items()]
    forms.append(("cⁿ is 0 beyond, degrees", *(f"{degrees:.2f}" for degrees in found["flushed"])))
    return (
        f"{found['honest']} of {found['cells']} albedos lie within their error bar; {found['overflow']} overflow, and say so."
        f" Largest relative errors over all parameters:\n\n{table(header, rows)}\n\nNaive forms and ours, largest relative"
        f" error where c^n >= 1/255, by n:\n\n{table(('form', *(f'{n:g}' for n in exponents)), forms)}"
    )
