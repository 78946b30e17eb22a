"""Which BRDFs of the literature conserve energy as people ship them, as shader files?

Command: ``brdfcheck study shader_corpus``: the twelve files of ``_instruments/shaders``, written from the papers. For files of
your own, ``--given FOLDER``.

Answer: 6 of 12 do, 5 do not: Ward 1992 has no bound towards grazing, the principled model reaches 1.885 with everything turned
up, Blinn-Phong with n + 8 reaches 1.0752, Oren and Nayar's model 1.0152, EON's approximate form 1.000146. Cook-Torrance comes
to 1 within its error bar.

Each file is checked over the ranges that it declares, colours white: what `brdfcheck check FILE` says. ``eon.glsl`` runs over
its roughness. Three are also compiled as C++ where there is a compiler, and both programs are timed on one core, on the
same directions.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import brdfcheck
from _instruments import shader_speed
from _instruments.bars import COLOURS, plot, told
from brdfcheck.output import records
from brdfcheck.studies import table

__all__ = ["plot", "run", "summary"]

OURS = Path(__file__).resolve().parent / "_instruments" / "shaders"
GIVEN = "a folder of .brdf and .glsl files"
SMALL = ("eon.glsl", "lambert.brdf")
TIMED = ("ggx.brdf", "cook_torrance.brdf", "principled.brdf")
RANGES: dict[str, dict[str, Any]] = {"eon.glsl": {"roughness": (0.0, 1.0)}}


def run(size: str = "full", given: Sequence[str] = ()) -> dict[str, Any]:
    """Verdict, largest albedo and its place of each file; small: two of them, quickly."""
    folder = Path(given[0]) if given else OURS
    files = sorted(path for path in folder.iterdir() if path.suffix in (".brdf", ".glsl"))
    if folder == OURS and size == "small":
        files = [path for path in files if path.name in SMALL]
    if not files:
        raise ValueError(f"{folder} holds no .brdf or .glsl file")
    results = [_checked(path, "normal" if size == "full" else "quick") for path in files]
    counts = {verdict: sum(row["verdict"] == verdict for row in results) for verdict in COLOURS}
    rounds = 30 if size == "full" else 2
    timed = [OURS / name for name in (TIMED if size == "full" else TIMED[:1])] if folder == OURS else []
    return {
        "settings": {"files": [path.name for path in files], "ours": folder == OURS},
        "results": results,
        "summary": {"files": len(files), **counts, "refused": sum(row["verdict"] is None for row in results)}
        | {"speed": [shader_speed.measured(path, rounds) for path in timed]},
    }


def _checked(path: Path, effort: str) -> dict[str, Any]:
    began = time.perf_counter()
    try:
        family = brdfcheck.load(str(path), **RANGES.get(path.name, {}))
    except ValueError as error:
        return {"name": path.name, "verdict": None, "message": str(error).replace(f"{path.parent}{os.sep}", "")}
    report = brdfcheck.check(family, effort=effort)
    return {**records.to_json_object(report), "name": path.name, "seconds": round(time.perf_counter() - began, 1)}


def summary(record: dict[str, Any]) -> str:
    """A table, and what was refused."""
    found, rows = record["summary"], []
    for row in record["results"]:
        if row["verdict"]:
            place = ", ".join(f"{name} = {float(value):.4g}" for name, value in row["parameters"].items())
            angle = f"{float(row['angle_degrees']):.3g}°"
            rows.append((row["name"], row["verdict"], told(row).split(", ")[1], place, angle))
        else:
            rows.append((row["name"], "refused", "", row["message"], ""))
    told_all = (
        f"{found['files']} files over the ranges that they declare: conserve {found['CONSERVES']}, violate the law"
        f" {found['VIOLATES']}, undecided {found['UNDECIDED']}.\n\n"
        + table(("file", "verdict", "largest albedo", "at", "angle of incidence"), rows)
    )
    return "\n\n".join([told_all, *([_speeds(found["speed"])] if found["speed"] else [])])


def _speeds(speed: list[dict[str, Any]]) -> str:
    compiler = next((row["compiler"] for row in speed if row["compiler"]), None)
    rows = []
    for row in speed:
        ours, theirs = row["per_second"], row["compiler_per_second"]
        other = (f"{theirs / 1e6:.0f}", f"{ours / theirs:.1f}", f"{row['apart']:.0e}") if theirs else ("-", "-", "-")
        rows.append((row["name"], f"{ours / 1e6:.0f}", *other))
    head = ("file", "million evaluations a second of CPU", "as C++", "ratio", "largest relative difference")
    about = f"As `check` evaluates them, and compiled by `{compiler or 'no compiler'}` (in double, white):"
    return about + "\n\n" + table(head, rows)
