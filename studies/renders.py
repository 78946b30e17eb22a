#!/usr/bin/env python3
"""Does a picture show what its equation says?

Command: ``brdfcheck study renders`` (or ``python studies/renders.py``). About two minutes on two cores.

Answer: yes, also where the equation is wrong. In the white furnace no validated BRDF outshines its surrounding; published ones
do, by 0.16 % ((n+6)/24.55) and 297 % (Cook-Torrance as printed). Of a highlight on a facet Gouraud shading leaves 84, 17, 0 %
(320 faces; n = 10, 100, 1000). Slopes jump by 0.73 (Gouraud) and 0.65 (Phong). Averaged normals take a zigzag's contrast from
0.565 to 0; a corrugation keeps its 0.56.

Every picture is a preset of ``brdfcheck render``, at that size. Furnace: a sphere in a uniform surrounding, integrated in
every pixel; the excess is the brightest pixel over the surrounding. Smooth shading: icospheres, averaged normals of the faces.
"""

from __future__ import annotations

from typing import Any

SMALL = ("figure-6", "figure-10")
SHOWN = ("figure-10", "figure-12", "glass")
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
EXPONENTS = (10, 100, 1000)


def run(size: str = "full") -> dict[str, Any]:
    """The numbers behind the pictures (small: of the icosahedron and one BRDF), and which pictures there are."""
    import numpy as np

    from brdfcheck.scene import failures, meshes, presets

    full = size == "full"
    names = list(presets.PRESETS) if full else SMALL
    results = [{"name": n, "caption": presets.named(n).caption, "side": presets.named(n).side if full else 16} for n in names]
    smooth = []
    for level in range(4 if full else 1):
        mesh = meshes.icosphere(level)
        samples, shadings = 4096 if full else 512, ("flat", "gouraud", "phong")
        bands = {shading: failures.mach_bands(mesh, shading, samples=samples) for shading in shadings}
        smooth.append({
            "faces": len(mesh.faces), "left": [float(x) for x in failures.lost_highlight(mesh, np.array(EXPONENTS, float))],
            "bleed": float(failures.silhouette_bleed(mesh)), "normal_error": float(failures.vertex_normal_error(mesh)),
            "value_jump": float(np.abs(bands["flat"].value_jump).max()),
            "slope_jumps": {shading: float(np.abs(bands[shading].slope_jump).max()) for shading in shadings[1:]},
        })  # fmt: skip
    sheets = {
        name: [float(failures.facet_contrast(mesh)), float(failures.interpolated_contrast(mesh))]
        for name, mesh in (("zigzag", meshes.zigzag()), ("corrugated", meshes.corrugated()))
    }
    side = presets.named("furnace").side if full else 9
    furnace = []
    for name, parameters, validated in presets.PAIRS if full else presets.PAIRS[:1]:
        both = [presets.furnace_excess(brdf, parameters, side) for brdf in (name, validated)]
        row = dict(zip(("excess", "of_validated"), (float(excess.max()) for excess in both), strict=True))
        furnace.append({"published": name, "parameters": parameters, "validated": validated, **row})
    settings = {"pictures": len(names), "samples of a pixel": 4, "thumbnails": 256 if full else 16, "furnace": side}
    return {"settings": settings, "results": results, "summary": {"smooth": smooth, "sheets": sheets, "furnace": furnace}}


def pictures(record: dict[str, Any]) -> dict[str, bytes]:
    """Every picture as the command renders it."""
    from brdfcheck.scene import images, presets

    sides = {row["name"]: row["side"] for row in record["results"]}
    return {f"{name}.png": images.png_bytes(presets.render_preset(name, side)) for name, side in sides.items()}


def plot(record: dict[str, Any]) -> Any:
    """Three pictures, what smooth shading loses against the number of faces, and the excess in the furnace."""
    from brdfcheck import plots
    from brdfcheck.scene.colour import encode_srgb
    from brdfcheck.scene.presets import render_preset

    smooth, furnace = record["summary"]["smooth"], record["summary"]["furnace"]
    faces = [row["faces"] for row in smooth]
    with plots.house_style():
        figure = plots.empty(10.0, 6.8)
        top, (left, middle, right) = figure.subplots(2, 3)
        for axes, name in zip(top, SHOWN, strict=True):
            image = render_preset(name, record["settings"]["thumbnails"])
            axes.imshow(encode_srgb(image).transpose(1, 2, 0), interpolation="none")
            axes.set_title(name)
            axes.axis("off")
        left.plot(faces, [row["left"] for row in smooth], marker="o", label=[f"n = {n}" for n in EXPONENTS])
        left.set(title="highlight left, Gouraud", ylim=(-0.03, 1.03))
        curves = {
            "bleed at the silhouette": [row["bleed"] for row in smooth],
            "jump of the value, flat": [row["value_jump"] for row in smooth],
            "of the slope, Gouraud": [row["slope_jumps"]["gouraud"] for row in smooth],
            "of the slope, Phong": [row["slope_jumps"]["phong"] for row in smooth],
        }
        for color, (label, values) in zip(PALETTE, curves.items(), strict=True):
            middle.plot(faces, values, marker="s", color=color, label=label)
        middle.set(title="bleed and jumps", yscale="log", ylim=(0.02, 4))
        middle.set_yticks((0.03, 0.1, 0.3, 1, 3), ("0.03", "0.1", "0.3", "1", "3"))
        for axes in (left, middle):
            axes.set(xscale="log", xlabel="faces")
            axes.set_xticks(faces, [str(count) for count in faces])
            axes.minorticks_off()
            axes.legend(fontsize=7.5)
            axes.grid(True)
        for i, row in enumerate(furnace[::-1]):
            excess = max(row["excess"], 1e-4)
            right.barh(i, excess - 1e-4, left=1e-4, color=PALETTE[0])
            right.text(excess * 1.15, i, "none" if excess == 1e-4 else f"{excess:.2g}", va="center", fontsize=7)
        right.set(xscale="log", xlim=(1e-4, 100), title="excess in the white furnace")
        right.set_xticks((1e-4, 1e-2, 1), ("0.0001", "0.01", "1"))
        right.set_yticks(range(len(furnace)), [row["published"] for row in furnace[::-1]], fontsize=7)
    return figure


def summary(record: dict[str, Any]) -> str:
    """All numbers, and all pictures with their captions."""
    from brdfcheck.studies import table

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
        "The brightest pixel of the white furnace over its surrounding:",
        table(("published", "at", "excess", "validated", "excess"), furnace), *shown,
    ))  # fmt: skip


if __name__ == "__main__":
    from brdfcheck.studies import main

    main(__file__)
