"""How far the production paths are from their floor: the number of their evaluations times the time of an operation.

The floor of a path counts the dearest operation in one evaluation: an exp for powers, Beckmann's needle, functions and checks;
a division for Schlick, V-cavities and GGX; for the 16th power a multiply-add each for the ratio and every squaring.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from _instruments import timing
from _instruments.peers import metal_table
from brdfcheck.brdf import catalog
from brdfcheck.brdf.lobes import BlinnPhong, Phong
from brdfcheck.brdf.microfacet import CookTorrance
from brdfcheck.cores import available_cores, on_one_core
from brdfcheck.quadrature import albedo as directional
from brdfcheck.quadrature import tables
from brdfcheck.verdict import check

# What one evaluation of a table's profile takes: one of an operation, or a ratio and so many squarings.
FAMILIES: dict[str, str | int] = {
    "phong": "exp",
    "blinn-phong": "exp",
    "schlick-mirror": "division",
    "binomial-power-half": 4,
}
METAL = functools.partial(CookTorrance, masking="smith-separable")
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
# What is aimed at: exps in the time of a cell of a zonal table; the peer's seconds over ours, and its error over ours; the
# share of what threads can gain.
EXPS, FASTER, CLOSER, SHARE = 40, 50, 10, 0.9
Times = Mapping[str, float]


def unit(name: str, times: Times) -> float:
    """Nanoseconds of one evaluation of the profile of a family in `FAMILIES`, from those of single operations."""
    kind = FAMILIES[name]
    return times[kind] if isinstance(kind, str) else times["multiply-add"] * (2 + kind)


def _path(path: str, job: Callable[[], Any], cells: int, evaluations: float, unit: float, rounds: int) -> dict[str, Any]:
    """One path: nanoseconds a cell of its floor, on one core and on all."""
    wait = lambda: jax.block_until_ready(job())  # noqa: E731
    every = timing.fastest(wait, rounds)
    with on_one_core():
        one = timing.fastest(wait, rounds)
    scale = 1e9 / cells
    return {
        "path": path,
        "cells": cells,
        "evaluations": evaluations,
        "floor": evaluations * unit,
        "one_core": one * scale,
        "all_cores": every * scale,
    }


def _evaluations(family: Any, n: np.ndarray, dtype: Any) -> int:
    """How often a column of a table with shared nodes evaluates the profile, error estimate included; n >= 1, rising."""
    plan = tables._plan(tables._structure(family, np.dtype(dtype)).core)
    assert plan is not None
    total = 0
    for part in np.split(n, tables._blocks(n, plan)):
        nodes = min(plan.exponents, len(part))
        total += nodes * (plan.fine.circle + plan.fine.cut)
        total += -(-nodes // tables._CHECKED) * (plan.coarse.circle + plan.coarse.cut)
    return total


def zonal(name: str, n: np.ndarray, mu: np.ndarray, times: Times, rounds: int) -> dict[str, Any]:
    """The table of a family in `FAMILIES` over exponents and cosines, in the precision of the cosines."""
    family, at = catalog.exponent_family(name), jnp.asarray(mu)
    evaluations = _evaluations(family, n, mu.dtype)
    job = lambda: tables.albedo_table(family, n, at).value  # noqa: E731
    path = f"table of {name}" + (", float32" if mu.dtype == np.float32 else "")
    found = _path(path, job, n.size * mu.size, evaluations / n.size, unit(name, times), rounds)
    return {**found, "exps": found["one_core"] / times["exp"]}


def facets(
    path: str, family: Any, axis: np.ndarray, unit: float, rounds: int, rtol: float | None = None, exact: Any = None
) -> dict[str, Any]:
    """A table over slopes and cosines, both `axis`, in its precision; with `exact` its largest error too."""
    at = jnp.asarray(axis)
    table = tables.albedo_table(family, axis, at, rtol=rtol)
    job = lambda: tables.albedo_table(family, axis, at, rtol=rtol).value  # noqa: E731
    found = _path(path, job, axis.size**2, int(table.evaluations), unit, rounds)
    return found if exact is None else {**found, "error": float(np.max(np.abs(np.asarray(table.value) - exact)))}


def singles(times: Times, rounds: int) -> list[dict[str, Any]]:
    """One albedo of a lobe and of a function, and one check."""
    lobe, function = Phong(100.0), lambda wi, wo: BlinnPhong(100.0)(wi, wo)
    jobs: dict[str, Callable[[], Any]] = {
        "one albedo of phong": lambda: directional.albedo(lobe, 0.7),
        "one albedo of a function": lambda: directional.albedo(function, 0.7),
        "check of blinn-phong": lambda: check("blinn-phong"),
    }
    return [
        _path(path, lambda job=job: job().error, 1, int(job().evaluations), times["exp"], rounds) for path, job in jobs.items()
    ]


def peer(axis: np.ndarray, exact: np.ndarray) -> dict[str, Any]:
    """Seconds and largest error of the strongest peer for Beckmann metal; or what is missing."""
    message = metal_table.missing()
    if message is not None:
        return {"missing": message}
    table, seconds = metal_table.scipy_table(axis, axis, len(available_cores()))
    return {"seconds": seconds, "error": float(np.max(np.abs(table - exact)))}


def accelerator(n: np.ndarray, mu: np.ndarray, axis: np.ndarray, rounds: int) -> list[dict[str, Any]]:
    """Two tables on the first device that is not a CPU, in both precisions; nothing where there is none."""
    found = []
    for device in [device for device in jax.devices() if device.platform != "cpu"][:1]:
        for dtype in ("float32", "float64"):
            jobs: dict[str, Callable[[], Any]] = {
                "table of phong": lambda dtype=dtype: tables.albedo_table("phong", n, jnp.asarray(mu, dtype)).value,
                "Beckmann metal": lambda dtype=dtype: tables.albedo_table(METAL, axis, jnp.asarray(axis, dtype)).value,
            }
            for path, job in jobs.items():
                with jax.default_device(device):
                    seconds = timing.fastest(lambda job=job: jax.block_until_ready(job()), rounds)
                found.append({"path": path, "dtype": dtype, "device": device.device_kind, "seconds": seconds})
    return found


def targets(record: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """What the record of the study says of each target: (target, measured, "met" or "missed")."""
    results, found, cores = record["results"], record["summary"], record["settings"]["cores"]

    def said(target: str, measured: str, met: bool) -> tuple[str, str, str]:
        return target, measured, "met" if met else "missed"

    rows = [
        said(f"{result['path']}: {EXPS} exps a cell", f"{result['exps']:.0f}", result["exps"] <= EXPS)
        for result in results
        if "exps" in result
    ]
    gains = [result["one_core"] / result["all_cores"] for result in results if result["cells"] > 1]
    near = sum(gain >= SHARE * found["gain"] for gain in gains)
    target = f"near-linear use of {cores} cores: {SHARE:g} of what exps gain on as many threads, {found['gain']:.2f} times"
    measured = f"{near} of {len(gains)} tables; {min(gains):.2f} to {max(gains):.2f} times"
    rows.append(said(target, measured, near == len(gains)))
    if "seconds" in (peer := found["peer"]):
        good = [result for result in results if CLOSER * result.get("error", math.inf) <= peer["error"]]
        best = min((1e-9 * result["all_cores"] * result["cells"] for result in good), default=math.inf)
        target = f"Beckmann metal in 1/{FASTER} of the peer's time at 1/{CLOSER} of its error"
        rows.append(said(target, f"1/{peer['seconds'] / best:.0f}", FASTER * best <= peer["seconds"]))
    return rows


def remarks(record: Mapping[str, Any]) -> str:
    """What was measured of the peer and of an accelerator, or why not."""
    found, name = record["summary"], "scipy's dblquad with a C callback by numba"
    peer, batches = found["peer"], found["accelerator"]
    if "seconds" in peer:
        theirs = f"in {record['settings']['cores']} processes takes {peer['seconds']:.3g} s, largest error {peer['error']:.1e}."
        text = f"The peer, in the same run: {name} {theirs}"
    else:
        text = f"The peer ({name}) was not measured: {peer['missing']}."
    if not batches:
        return (
            f"{text} Batches on an accelerator were not measured: none was present (where one is, the tests run such tables)."
        )
    times = (f"{b['path']}, {b['dtype']}: {b['seconds']:.3g} s" for b in batches)
    return f"{text} On the accelerator ({batches[0]['device']}): {'; '.join(times)}."
