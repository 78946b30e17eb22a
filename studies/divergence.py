"""When does an albedo above 1 at one angle make the light in a closed enclosure grow without end?

Command: ``brdfcheck study divergence``. Under two minutes on two cores.

Answer: when the spectral radius of the wall's transport over all angles exceeds 1; one angle is not enough. The 16th power with
(n+6)/24.55 at n = 17.85 returns 1.0016 of a beam along the normal, Blinn-Phong with (n+8)/8pi 1.0752, but their radii are 0.707
and 0.762: by the second bounce energy falls, as with validated factors. Where the wall gives back what the lobe loses it grows
with every bounce by 1.4e-6 (doubled after 496,000) and by 0.37 % (after 187); validated ones then stay at 1 for ever. Alone
diverge: the raw 16th power below n = 11.18 (albedo above 1 up to 18.59), Schlick's and Kuijk-Blake's lobes with the power's
factor above 4.35 and 116.7, and the factor of the facet distribution at every n from 1.

In a sphere light arrives at the angle at which it left: transport is an operator on angles, and no enclosure whose other
walls are loss-free mirrors has a larger spectral radius. "Otherwise loss-free": the wall gives back what the lobe loses,
max(0, 1 - E), as a mirror. The beam arrives along the normal, the angle of the largest albedo.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from matplotlib.lines import Line2D

from _instruments import transport as measure
from brdfcheck import catalog, transport
from brdfcheck.plots import paper
from brdfcheck.plots.styles import ink, style_of
from brdfcheck.studies import table

# (published, validated, exponent of the largest albedo)
EXHIBITS = (("binomial-power-published", "binomial-power-half", 17.85), ("blinn-phong-8", "blinn-phong-fitted", 8.76))
CLAIMS = ("binomial-power-raw", "binomial-power-published", "blinn-phong-8", "blinn-phong-ndf", "blinn-phong-linear",
          "phong-pdf", "schlick-phong-factor", "kuijk-blake-phong-factor")  # fmt: skip
EXPONENTS = (1, 2, 4, 7, 10, 14, 20, 40, 70, 100, 300, 1000)
BEAM = 12  # bounces of the first panel


def run(size: str = "full") -> dict[str, Any]:
    """Energy after bounces of two published factors and their validated ones; the spectral radius of all claims."""
    full = size == "full"
    paths, exponents = (2**17, EXPONENTS) if full else (2**12, EXPONENTS[::7])
    nodes = {} if full else {"nodes": 64, "azimuths": 128}
    bounces = np.unique(np.round(2 ** np.arange(0, 20.01, 0.25)).astype(int))
    results = []
    for name, n in ((name, n) for *pair, n in EXHIBITS for name in pair):
        brdf = catalog.exponent_family(name)(n)
        bare = transport.angular_operator(brdf, **nodes)
        walls = {"alone": bare, "mirror": bare.completed("mirror"), "diffuse": bare.completed("diffuse")}
        radii = {kind: float(part.spectral_radius().upper) for kind, part in walls.items()}
        kept = bounces[bounces * np.log(max(radii["mirror"], 1)) < 20]  # beyond, the figure ends and numbers overflow
        traced = {}
        for room, enclosure in (("sphere", transport.sphere(2)), ("cube", transport.box())):
            found = transport.energy_after_bounces(enclosure, brdf, BEAM, key=jax.random.key(3), paths=paths, beam=True)
            traced[room] = {"mean": np.asarray(found.mean).tolist(), "error": np.asarray(found.error).tolist()}
        evenly = 2 * bare.weight * bare.cos_theta
        late = walls["mirror"].energy(kept) @ evenly
        results.append({
            "name": name, "n": n, "largest_albedo": float(bare.albedo()[-1]), "mean_albedo": float(bare.albedo() @ evenly),
            "radii": radii, "beam": np.asarray(bare.energy(np.arange(BEAM + 1)))[:, -1].tolist(), "traced": traced,
            "bounces": kept.tolist(), "late": np.asarray(late).tolist(),
        })  # fmt: skip
    claims = [{"name": name, **measure.radii(catalog.exponent_family(name), exponents, **nodes)} for name in CLAIMS]
    return {"settings": {"paths": paths, **nodes}, "results": results, "summary": {"claims": claims}}


def plot(record: dict[str, Any]) -> Any:
    """Energy of a beam; energy between otherwise loss-free walls; below, the radius against the exponent."""
    published = {name for name, _, _ in EXHIBITS}
    with paper.house_style():
        figure = paper.empty(8.2, 8.0)
        grid = figure.add_gridspec(2, 2)
        beam, late, radius = (figure.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, :]))
        handles = []
        for result in record["results"]:
            style = style_of(result["name"])
            look = {"color": style.color, "dashes": style.dashes or (1, 0), "linewidth": 1.5}
            beam.plot(range(BEAM + 1), result["beam"], **look)
            handles.append(Line2D([], [], label=f"{result['name']}, n = {result['n']:g}", **look))
            inside = style.color if result["name"] in published else "white"
            for room, marker in (("sphere", "o"), ("cube", "s")):
                traced = result["traced"][room]
                point = {"color": style.color, "marker": marker, "markerfacecolor": inside, "linestyle": "", "zorder": 3}
                beam.errorbar(range(BEAM + 1), traced["mean"], traced["error"], markersize=3.6, elinewidth=0.8, **point)
            late.plot(result["bounces"], result["late"], **look)
            growth = result["radii"]["mirror"] - 1
            if growth > 1e-9:
                place = next(i for i, energy in enumerate(result["late"]) if energy > 2)
                text = f"doubles in\n{float(f'{0.6931 / growth:.3g}'):,.0f} bounces"
                late.annotate(text, (result["bounces"][place], result["late"][place]), (-6, 4), textcoords="offset points",
                              ha="right", fontsize=8, color=ink(style.color))  # fmt: skip
        for label, marker in (("traced in a sphere (hollow: validated)", "o"), ("traced in a cube (hollow: validated)", "s")):
            handles.append(Line2D([], [], color="#666666", linestyle="", markersize=4.5, label=label, marker=marker))
        for claim in record["summary"]["claims"]:
            style = style_of(claim["name"])
            look = {"color": style.color, "dashes": style.dashes or (1, 0), "linewidth": 1.3, "marker": style.marker}
            radius.plot(claim["parameters"], claim["radii"], markersize=4, **look)
        beam.set(yscale="log", ylim=(7e-4, 1.6), title="the lobe alone, a beam along the normal", xlabel="bounces")
        late.set(xscale="log", yscale="log", ylim=(0.5, 100), xlabel="bounces", title="walls otherwise loss-free (mirror)")
        radius.set(xscale="log", yscale="log", ylim=(0.018, 6), xlabel="exponent n", title="the lobe alone")
        radius.axhspan(1, 6, color="#D55E00", alpha=0.08, linewidth=0)
        radius.annotate("energy grows with every bounce", (0.012, 0.955), xycoords="axes fraction", ha="left", va="top",
                        fontsize=8, color="#444444")  # fmt: skip
        beam.set_xticks(range(0, BEAM + 1, 2))
        late.set_xticks([1, 100, 1e4, 1e6], ["1", "100", "10⁴", "10⁶"])
        for axes, what, ticks in (
            (beam, "energy left", (0.001, 0.01, 0.1, 1)),
            (late, "energy left", (1, 10, 100)),
            (radius, "spectral radius of a sphere", (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)),
        ):
            axes.set_ylabel(what)
            axes.set_yticks(ticks, [paper.text_of(tick) for tick in ticks])
            axes.minorticks_off()
            axes.axhline(1, color="black", linewidth=0.9)
            axes.grid(True)
        radius.set_xticks([1, 10, 100, 1000], ["1", "10", "100", "1000"])
        figure.legend(handles=handles, loc="outside upper center", ncol=3)
        ends = [(claim["name"], claim["radii"][-1]) for claim in record["summary"]["claims"]]
        paper.direct_labels(radius, [paper.Label(name, style_of(name), end) for name, end in ends])
    return figure


def summary(record: dict[str, Any]) -> str:
    """Radii, growth, and what diverges."""
    exhibits = [
        (f"`{r['name']}`", f"{r['n']:g}", f"{r['largest_albedo']:.5f}", f"{r['mean_albedo']:.4f}", f"{r['radii']['alone']:.6f}",
         *(f"{r['radii'][kind] - 1:.2e}" for kind in ("mirror", "diffuse")), *(f"{r['beam'][m]:.4f}" for m in (1, 2, BEAM)),
         *(f"{r['traced'][room]['mean'][BEAM]:.4f} ± {r['traced'][room]['error'][BEAM]:.4f}" for room in r["traced"]))
        for r in record["results"]
    ]  # fmt: skip
    claims = [(f"`{c['name']}`", f"{max(c['largest']):.4f}", f"{min(c['radii']):.4f}", f"{max(c['radii']):.4f}",
               ", ".join(f"{n:.2f}" for n in c["crossings"]) or "-") for c in record["summary"]["claims"]]  # fmt: skip
    header = ("BRDF", "n", "largest albedo", "mean albedo", "spectral radius", "radius − 1, otherwise loss-free (mirror)",
              "(diffuse)", "beam: energy after 1", "2", f"{BEAM} bounces", "paths, sphere", "paths, cube")  # fmt: skip
    return (
        f"{table(header, exhibits)}\n\nThe spectral radius is that of a sphere of these walls, and an upper bound for every"
        " enclosure whose other walls are loss-free mirrors: the paths in a cube lose more.\n\n"
        "Lobes of published factors alone, over the exponents of the figure:\n\n"
        + table(("BRDF", "largest albedo", "smallest radius", "largest radius", "radius = 1 at n"), claims)
    )
