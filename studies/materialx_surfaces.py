"""Do the surfaces that MaterialX defines conserve energy?

Command: ``brdfcheck study materialx_surfaces``. Needs the extra ``materialx``.

Answer: none of the five does with the light held. As they come, colours white, they reach 1.024 (disney_principled, at 82
degrees), 1.186 (UsdPreviewSurface), 1.374 (open_pbr_surface), 1.551 (standard_surface) and 2.185 (gltf_pbr, which is a metal as
it comes), the last four at grazing incidence; as white metals 2.158 or 2.185, by the compensation for what is reflected several
times, a fit in the view direction alone. None is reciprocal as it comes.

Each surface is checked as it comes, colours white, and as a white metal over all of its roughnesses: the light is held, what
leaves is added up. Seconds are CPU time of one check in a process that has checked nothing of the kind before: most of it is
compiling and on one core.
"""

from __future__ import annotations

import time
from typing import Any

import brdfcheck
from _instruments.bars import COLOURS, plot, told
from brdfcheck.output import records
from brdfcheck.studies import table

__all__ = ["plot", "run", "summary"]

# The inputs that make a surface a metal, and the one that is its roughness.
METALS = {
    "UsdPreviewSurface": ("metallic", "roughness"),
    "disney_principled": ("metallic", "roughness"),
    "gltf_pbr": ("metallic", "roughness"),
    "open_pbr_surface": ("base_metalness", "specular_roughness"),
    "standard_surface": ("metalness", "specular_roughness"),
}


def run(size: str = "full") -> dict[str, Any]:
    """Verdict, largest albedo and its place of each surface; small: of one at its defaults, quickly."""
    results = []
    for name, (metal, roughness) in METALS.items() if size == "full" else [("gltf_pbr", METALS["gltf_pbr"])]:
        results.append(_checked(name, "as it comes", size, {}))
        if size == "full":
            results.append(_checked(name, "white metal", size, {metal: (1.0, 1.0), roughness: (0.0, 1.0)}))
    counts = {verdict: sum(row["verdict"] == verdict for row in results) for verdict in COLOURS}
    return {"settings": {"surfaces": len(results)}, "results": results, "summary": counts}


def _checked(surface: str, state: str, size: str, ranges: dict[str, Any]) -> dict[str, Any]:
    began = time.process_time()  # whatever else runs beside it
    report = brdfcheck.check(f"materialx:{surface}", effort="normal" if size == "full" else "quick", **ranges)
    seconds = round(time.process_time() - began, 1)
    return {**records.to_json_object(report), "name": f"{surface}, {state}", "seconds": seconds, "varied": [*ranges][1:]}


def summary(record: dict[str, Any]) -> str:
    """A table: verdict, largest albedo, where, what failed, and seconds of CPU time."""
    rows = []
    for row in record["results"]:
        place = ", ".join(f"{name} = {float(row['parameters'][name]):.4g}" for name in row["varied"])
        failed = ", ".join(check["name"] for check in row["checks"] if not check["passed"])
        angle = f"{float(row['angle_degrees']):.3g}°"
        rows.append((row["name"], row["verdict"], told(row).split(", ")[1], place, angle, failed, f"{row['seconds']:.1f}"))
    found = record["summary"]
    return f"Conserve {found['CONSERVES']}, violate the law {found['VIOLATES']}, undecided {found['UNDECIDED']}.\n\n" + table(
        ("surface", "verdict", "largest albedo", "at", "angle of incidence", "fails besides", "CPU seconds"), rows
    )
