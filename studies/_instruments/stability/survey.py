"""Many methods over many lobes in both precisions, as a record keeps them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import jax
import numpy as np

from _instruments.stability.outcomes import Method, Mode, Outcome, gradient_outcomes, gradients_of, of_rule, outcomes, run
from _instruments.stability.references import LOBES, Reference, label
from brdfcheck.quadrature import RULES

# Settings of the rules of samples, and of those that know where the lobe is.
SAMPLING = {
    "uniform-monte-carlo": 4096, "cosine-monte-carlo": 4096, "lobe-monte-carlo": 4096, "sobol": 4096, "r2-lattice": 4096,
    "midpoint-product": 32, "gauss-product": 32,
}  # fmt: skip
FOLLOWING = {"lobe-warped-gauss": 64, "tanh-sinh": 3, "zonal": 6, "half-vector": 5, "closed-form": 64}
# So many programs keep well below the 65,530 memory maps that a process may have: each takes tens.
_PROGRAMS = 64


@dataclass(frozen=True)
class Job:
    """A method, under the name that figures show, over the grid of a lobe: its values, or its derivatives."""

    name: str
    method: Method
    lobe: str
    of: Literal["values", "derivatives"] = "values"
    mode: Mode = "jit"
    precisions: tuple[Any, ...] = (np.float64, np.float32)


def of_rules(settings: Mapping[str, float], lobes: Iterable[str], of: Literal["values", "derivatives"] = "values") -> list[Job]:
    """Jobs for rules of the registry with a setting each, for the lobes that they take.

    Left out are derivatives of the adaptive rule, which works on the host.
    """
    lobes, jobs = list(lobes), []
    for name, setting in settings.items():
        rule = RULES[name](setting)
        mode: Mode = "host" if name == "adaptive" else "jit"
        at = 1.0 if name == "closed-form" else None  # of most lobes at normal incidence only
        if mode != "host" or of == "values":
            taken = [lobe for lobe in lobes if rule.takes(LOBES[lobe](1.0), at)]
            jobs += [Job(f"{name} {setting:g}", of_rule(rule), lobe, of, mode) for lobe in taken]
    return jobs


def survey(jobs: Sequence[Job], references: Mapping[str, Reference]) -> list[dict[str, Any]]:
    """What became of each cell: mappings with method, lobe, dtype, of ("value", "d/dn", "d/dtheta") and outcomes.

    `outcomes`: a string for each parameter, a digit of `Outcome` for each angle, "-" for a cell that is left out. Two threads
    compile; a third has what runs on the host.
    """
    compiled, host = ([job for job in jobs if (job.mode == "host") is wanted] for wanted in (False, True))
    found: dict[Job, list[dict[str, Any]]] = {}
    with ThreadPoolExecutor(2) as pool, ThreadPoolExecutor(1) as beside:
        pending = [beside.submit(_cells, job, references[job.lobe]) for job in host]
        for start in range(0, len(compiled), _PROGRAMS):
            batch = compiled[start : start + _PROGRAMS]
            found.update(zip(batch, pool.map(lambda job: _cells(job, references[job.lobe]), batch), strict=True))
            jax.clear_caches()
        found.update(zip(host, (future.result() for future in pending), strict=True))
    return [cells for job in jobs for cells in found[job]]


def _cells(job: Job, reference: Reference) -> list[dict[str, Any]]:
    found = []
    for dtype in job.precisions:
        if job.of == "values":
            got = run(job.method, job.lobe, reference.parameters, reference.cosines, dtype, mode=job.mode)
            grids = {"value": outcomes(got, reference, dtype)}
        else:
            slopes = gradients_of(reference, job.method, dtype)
            grids = {f"d/d{by}": gradient_outcomes(one, dtype) for by, one in slopes.items()}
        for of, grid in grids.items():
            rows = ["".join("-" if cell < 0 else str(cell) for cell in row) for row in grid]
            found.append({"method": job.name, "lobe": job.lobe, "dtype": dtype.__name__, "of": of, "outcomes": rows})
    return found


def counted(results: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """How many cells had each outcome: mappings with method, of, dtype, and a count by the name of the outcome.

    What was left out is not counted.
    """
    found: dict[tuple[str, str, str], dict[str, int]] = {}
    for result in results:
        place = (result["method"], result["of"], result["dtype"])
        counts = found.setdefault(place, {outcome.name.lower().replace("_", " "): 0 for outcome in Outcome})
        for outcome, name in zip(Outcome, counts, strict=True):
            counts[name] += sum(row.count(str(outcome.value)) for row in result["outcomes"])
    return [{"method": method, "of": of, "dtype": dtype, **counts} for (method, of, dtype), counts in found.items()]


def measured(jobs: Sequence[Job], references: Mapping[str, Reference]) -> dict[str, Any]:
    """What a study gives: the `survey`, as `settings` label and parameters of the lobes and the `angles` in degrees, counts."""
    results = survey(jobs, references)
    lobes = {name: {"label": label(name), "parameters": one.parameters.tolist()} for name, one in references.items()}
    cosines = next(iter(references.values())).cosines
    angles = [float(f"{angle:.4g}") for angle in np.degrees(np.arccos(cosines))]
    summary = {"counts": counted(results)}
    return {"settings": {"lobes": lobes, "angles": angles}, "results": results, "summary": summary}
