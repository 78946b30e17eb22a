"""What do four solvers say of an integrating sphere as its wall nears and passes loss-free, and what if the wall is glossy?

Command: ``brdfcheck study integrating_sphere``. Under a minute on two cores.

Answer: below 1 all are right, LU and conjugate gradients to 1e-14, shooting and the series to the 1e-8 and 1e-10 asked for,
paths to 0.4 to 0.8 % of the multiplied light on the worst of 24 patches (up to 2.2 standard errors). At rho = 1 and 1.01
series, shooting and paths refuse; LU returns 1e16, then -101 everywhere. A glossy wall makes no integrating sphere: of 0.9
times Phong's BRDF, n = 10, it holds 2.07 where Lambert's holds 9, uneven by -17 to +43 %.

The exact answer is B(x) = E(x) + rho mean(E)/(1 - rho); the light is a spot at the pole, the wall has 24 bands of equal area.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from _instruments import transport as measure
from _instruments.transport import SOLVERS
from brdfcheck import Normalized, Phong, PhongExact, transport
from brdfcheck.output import records
from brdfcheck.plots import paper
from brdfcheck.studies import table

RHO = (0.5, 0.9, 0.99, 1.0, 1.01)
# (label, exponent of a Phong lobe with its exact factor; None: Lambert)
WALLS = (("Lambert", None), ("Phong, n = 2", 2.0), ("Phong, n = 10", 10.0), ("Phong, n = 50", 50.0))
GLOSSY = 0.9  # what the walls of the second panel reflect of what their BRDF reflects


def run(size: str = "full") -> dict[str, Any]:
    """All solvers at all reflectances, and the light over the sphere for glossy walls (small: fewer paths and walls)."""
    paths, walls = (2**18, WALLS) if size == "full" else (2**12, WALLS[:2])
    room = transport.sphere(24)
    spot = np.zeros(room.patches)
    spot[0] = room.patches  # the mean over the sphere is 1
    key = jax.random.key(1)
    levels = measure.levels(room, spot, RHO, key=key, paths=paths)
    results = []
    for level in records.plain(levels):
        rho = level["reflectance"]
        scale = abs(1 - rho) if rho != 1 else 1.0
        exact = spot + rho / (1 - rho) if rho < 1 else spot + np.nan
        value = np.array([float(part) for part in level.pop("value")])
        error = records.plain(float(np.max(np.abs(value - exact))) * scale)
        opposite, claimed = records.plain((float(value[-1]), float(level["error"]) * scale))
        results.append({**level, "opposite": opposite, "error": error, "claimed": claimed})
    curves = []
    for label, n in walls:
        brdf = None if n is None else Normalized(Phong(n), PhongExact())
        found = transport.trace(room, spot, GLOSSY, brdf=brdf, key=key, paths=paths)
        value, error, mean = np.asarray(found.value)[1:], np.asarray(found.error)[1:], float(np.mean(found.value[1:]))
        curves.append({"label": label, "mean": mean, "share": (value / mean).tolist(), "error": (error / mean).tolist(),
                       "lowest": float(np.min(value) / mean), "highest": float(np.max(value) / mean)})  # fmt: skip
    cosines = (1 - (2 * np.arange(1, room.patches) + 1) / room.patches).tolist()
    return {
        "settings": {"patches": room.patches, "paths": paths, "reflectance_of_glossy_walls": GLOSSY},
        "results": results,
        "summary": {"curves": curves, "cosines": cosines},
    }


def plot(record: dict[str, Any]) -> Any:
    """Left: error of each solver against the reflectance; right: how even the light is."""
    with paper.house_style():
        figure = paper.empty(9.6, 4.3)
        left, right = figure.subplots(1, 2)
        for j, (name, (label, color, marker)) in enumerate(SOLVERS.items()):
            own = [r for r in record["results"] if r["method"] == name and r["reflectance"] < 1]
            x = [i + 0.13 * (j - 2) for i in range(len(own))]
            left.vlines(
                x, [max(float(r["error"]), 1e-16) for r in own], [float(r["claimed"]) for r in own], color=color, linewidth=1
            )
            left.plot(x, [float(r["claimed"]) for r in own], color=color, marker="_", markersize=8, linestyle="")
            left.plot(x, [max(float(r["error"]), 1e-16) for r in own], color=color, marker=marker, linestyle="", label=label)
        direct = {r["reflectance"]: float(r["opposite"]) for r in record["results"] if r["method"] == "direct"}
        for i, rho in enumerate(RHO[3:], 3):
            left.axvspan(i - 0.45, i + 0.45, color="#D55E00", alpha=0.10, linewidth=0)
            text = f"LU returns\n{paper.text_of(direct[rho], 3)},\nthe series,\nshooting and\npaths refuse"
            left.text(i, 1e-8, text, ha="center", va="center", fontsize=7, color="#8A3C00")
        left.set(yscale="log", ylim=(3e-17, 1), xlim=(-0.5, 4.5), xlabel="reflectance ρ of the wall")
        left.set(ylabel="largest relative error; bar: claimed", title="diffuse wall")
        left.set_xticks(range(5), [f"{rho:g}" for rho in RHO])
        paper.decades(left.set_yticks, (-16, -12, -8, -4, 0))
        left.minorticks_off()
        figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=5, handlelength=1.2)
        left.grid(True, axis="y")
        shades = ("#545454", "#56B4E9", "#0072B2", "#00314D")
        for curve, color in zip(record["summary"]["curves"], shades, strict=False):
            x = record["summary"]["cosines"]
            right.errorbar(x, curve["share"], curve["error"], color=color, linewidth=1.4, elinewidth=0.8, label=curve["label"])
        right.set(xlim=(1, -1), xlabel="cos of the angle from the spot", ylabel="radiosity by its mean over the sphere")
        right.set(title=f"wall of {GLOSSY} times a BRDF")
        right.legend(loc="upper center", title="BRDF", title_fontsize=8)
        right.grid(True)
    return figure


def summary(record: dict[str, Any]) -> str:
    """All solvers at all reflectances, and how even the light is."""
    rows = [
        (f"{r['reflectance']:g}", f"`{r['method']}`", f"{float(r['opposite']):.8g}", f"{float(r['error']):.1e}",
         f"{float(r['claimed']):.1e}", f"{float(r['residual']):.1e}", f"{r['cost']:.3g}", r["status"])
        for r in record["results"]
    ]  # fmt: skip
    even = [(c["label"], f"{c['mean']:.4f}", f"{c['lowest']:.4f}", f"{c['highest']:.4f}") for c in record["summary"]["curves"]]
    header = ("ρ", "solver", "B opposite the spot", "relative error", "claimed", "residual", "cost", "status")
    messages = dict.fromkeys(f"- {r['status']}: {r['message']}" for r in record["results"] if r["reflectance"] >= 1)
    return (
        "The exact radiosity away from the spot is ρ/(1 − ρ). Cost: products of a form factor with a radiosity, for paths"
        f" rays; errors of paths are standard errors.\n\n{table(header, rows)}\n\nWhat the solvers say at 1 and above:\n\n"
        + "\n".join(messages)
        + "\n\nWalls that reflect 0.9 of what their BRDF does, away from the spot:\n\n"
        + table(("BRDF", "mean radiosity", "lowest by mean", "highest by mean"), even)
    )
