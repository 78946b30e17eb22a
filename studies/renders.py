"""Does a picture show what its equation says?

Command: ``brdfcheck study renders``. About two minutes on two cores.

Answer: yes, also where the equation is wrong. In the white furnace no validated BRDF outshines its surrounding; published ones
do, by 0.16 % ((n+6)/24.55) and 298 % (Cook-Torrance as printed). Of a highlight on a facet Gouraud shading leaves 84, 17, 0 %
(320 faces; n = 10, 100, 1000). Slopes jump by 0.32 (Gouraud) and 0.21 (Phong). Averaged normals take a zigzag's contrast from
0.565 to 0; a corrugation keeps its 0.56. A square's centre is between 0.5 and 1 by scan lines, as it is turned.

Every picture is a preset of ``brdfcheck render``, at that size. Furnace: a sphere in a uniform surrounding, integrated in
every pixel; the excess is the largest of 0 to 89 degrees. Smooth shading: icospheres, averaged normals; jumps at |x| < 0.8.
"""

from __future__ import annotations

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np

from brdfcheck.plots import paper
from brdfcheck.scene import failures, images, meshes, presets, white_furnace
from brdfcheck.studies import table

SMALL = ("figure-6", "figure-10")
SHOWN = {
    "figure-10": "metal of facets, two lights",
    "figure-12": "metal by powers of N·H",
    "glass": "mirror and glass, by rays",
}
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
EXPONENTS, DEGREES = (10, 100, 1000), (0, 15, 30, 45)


def run(size: str = "full") -> dict[str, Any]:
    """The numbers behind the pictures (small: of the icosahedron and one BRDF), and which pictures there are."""

    def normal_error(mesh: meshes.Mesh) -> float:
        """The largest angle (radians) between the averaged normals of a mesh on the unit sphere and the sphere's own."""
        # By the sine: the cosine of a small angle has no digits of it.
        across = np.linalg.norm(np.cross(meshes.vertex_normals(mesh), mesh.vertices), axis=1)
        return float(np.arcsin(np.minimum(across, 1)).max())

    full = size == "full"
    names = list(presets.PRESETS) if full else SMALL
    results = [{"name": n, "caption": presets.named(n).caption, "side": presets.named(n).side if full else 16} for n in names]
    for row in results:
        _picture(row["name"], row["side"])
    smooth = []
    for mesh in map(meshes.icosphere, range(4 if full else 1)):
        samples = 4096 if full else 512
        bands = {shading: failures.mach_bands(mesh, shading, samples=samples) for shading in ("flat", "gouraud", "phong")}
        smooth.append({
            "faces": len(mesh.faces), "left": [float(x) for x in failures.lost_highlight(mesh, np.array(EXPONENTS, float))],
            "bleed": float(failures.silhouette_bleed(mesh)), "normal_error": normal_error(mesh),
            "value_jump": bands["flat"].largest("value"),
            "slope_jumps": {shading: bands[shading].largest("slope") for shading in ("gouraud", "phong")},
        })  # fmt: skip
    sheets = {name: [float(f(mesh)) for f in (failures.facet_contrast, failures.interpolated_contrast)]
              for name, mesh in (("zigzag", meshes.zigzag()), ("corrugated", meshes.corrugated()))}  # fmt: skip
    square = jnp.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]), jnp.array([0.0, 1, 0, 1]), jnp.zeros(2)
    turned = failures.turned_quadrilateral(*square, jnp.radians(jnp.array(DEGREES, float))).tolist()
    furnace = []
    for name, parameters, validated in white_furnace.PAIRS[: None if full else 1]:
        excess, other = (white_furnace.furnace_largest(brdf, parameters) - 1 for brdf in (name, validated))
        row = {"published": name, "parameters": parameters, "excess": excess, "validated": validated, "of_validated": other}
        furnace.append(row)
    found = {"smooth": smooth, "sheets": sheets, "turned": turned, "furnace": furnace}
    return {"settings": {"pictures": len(names)}, "results": results, "summary": found}


@functools.cache
def _picture(name: str, side: int) -> Any:
    """A picture as the command renders it: once in a process, which is most of the time that the study takes."""
    return presets.render_preset(name, side)


def pictures(record: dict[str, Any]) -> dict[str, bytes]:
    """Every picture, as a file."""
    return {f"{row['name']}.png": images.png_bytes(_picture(row["name"], row["side"])) for row in record["results"]}


def plot(record: dict[str, Any]) -> Any:
    """Three pictures, what smooth shading loses against the number of faces, and the excess in the furnace."""
    smooth, furnace = record["summary"]["smooth"], record["summary"]["furnace"]
    faces, sides = [row["faces"] for row in smooth], {row["name"]: row["side"] for row in record["results"]}
    with paper.house_style():
        figure = paper.empty(10.0, 6.8)
        top, (left, middle, right) = figure.subplots(2, 3)
        for axes, (name, title) in zip(top, SHOWN.items(), strict=True):
            image = _picture(name, sides.get(name, 16))
            axes.imshow(images.encode_srgb(image).transpose(1, 2, 0), interpolation="antialiased")
            axes.set_title(title)
            axes.axis("off")
        for i, n in enumerate(EXPONENTS):
            left.plot(faces, [row["left"][i] for row in smooth], marker="o", color=PALETTE[i], label=f"n = {n}")
        left.set(title="what Gouraud shading leaves of a highlight", ylabel="share of the exact highlight", ylim=(-0.03, 1.03))
        curves = {
            "bleed at the silhouette": [row["bleed"] for row in smooth],
            "jump of the value, flat": [row["value_jump"] for row in smooth],
            "of the slope, Gouraud": [row["slope_jumps"]["gouraud"] for row in smooth],
            "of the slope, Phong": [row["slope_jumps"]["phong"] for row in smooth],
        }
        for color, (label, values) in zip(PALETTE, curves.items(), strict=True):
            middle.plot(faces, values, marker="s", color=color, label=label)
        middle.set(title="bleed and jumps", ylabel="size", yscale="log", ylim=(0.02, 4))
        middle.set_yticks((0.03, 0.1, 0.3, 1, 3), ("0.03", "0.1", "0.3", "1", "3"))
        for axes in (left, middle):
            axes.set(xscale="log", xlabel="faces")
            axes.set_xticks(faces, [str(count) for count in faces])
            axes.minorticks_off()
            axes.legend(fontsize=7.5)
            axes.grid(True)
        for i, row in enumerate(furnace[::-1]):  # names stand in the panel: beside it they would push the others aside
            if row["excess"] > 1e-4:  # a place on a logarithmic axis, which has no 0 for a bar to start at
                right.plot(row["excess"], i, marker="o", color=PALETTE[1], markersize=4)
            right.hlines(i, 1e-3, 40, color="#DDDDDD", linewidth=0.5, zorder=0)
            right.text(1.3e-8, i, row["published"], va="center", fontsize=7)
            right.text(600, i, f"{row['excess']:.2g}" if row["excess"] > 1e-4 else "none", va="center", ha="right", fontsize=7)
        right.set(xscale="log", xlim=(1e-8, 900), title="excess in the white furnace", yticks=())
        right.set(xlabel="largest albedo − 1, of 0 to 89°, logarithmic")
        right.set_xticks((1e-3, 0.1, 10), ("0.001", "0.1", "10"))
        right.minorticks_off()
    return figure


def summary(record: dict[str, Any]) -> str:
    """All numbers, and all pictures with their captions."""
    found = record["summary"]
    smooth = [
        (f"{row['faces']}", *(f"{x:.3f}" for x in row["left"]), f"{row['bleed']:.3f}", f"{row['value_jump']:.3f}",
         *(f"{x:.3f}" for x in row["slope_jumps"].values()), f"{57.29578 * row['normal_error']:.2f}")
        for row in found["smooth"]
    ]  # fmt: skip
    header = ("faces", *(f"highlight left, n = {n}" for n in EXPONENTS), "bleed", "jump of value, flat", "of slope, Gouraud")
    furnace = [
        (f"`{row['published']}`", ", ".join(f"{k} = {v:g}" for k, v in row["parameters"].items()), f"{row['excess']:.5f}",
         f"`{row['validated']}`", f"{row['of_validated']:.5f}")
        for row in found["furnace"]
    ]  # fmt: skip
    sheets = [(name, *(f"{x:.3f}" for x in values)) for name, values in found["sheets"].items()]
    shown = [f"`{r['name']}`: {r['caption']}\n\n![{r['caption']}]({r['name']}.png)" for r in record["results"]]
    return "\n\n".join((
        "What smooth shading loses, on icospheres:", table((*header, "of slope, Phong", "error of normals, degrees"), smooth),
        "Contrast of folded sheets:", table(("sheet", "of facets", "of averaged normals"), sheets),
        "The centre of a square, its corners 0, 1, 0, 1, by scan lines:",
        table(("degrees turned", *map(str, DEGREES)), [("centre", *(f"{x:.3f}" for x in found["turned"]))]),
        "The most that is reflected beyond 1 in the white furnace, of 0 to 89 degrees:",
        table(("published", "at", "excess", "validated", "excess"), furnace), *shown,
    ))  # fmt: skip
