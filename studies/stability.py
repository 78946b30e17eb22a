#!/usr/bin/env python3
"""Where do quadrature rules hold, lose digits, lie or break, over every lobe, exponent, angle and precision?

Command: ``brdfcheck study stability`` (or ``python studies/stability.py``). Four minutes on two cores.

Answer: `brdfcheck.albedo` holds in every cell of both precisions, and so do its derivatives, but for dE/dtheta of the
unclamped power in float32; `check` calls none of the cells and none of 2,000 factors within 1e-6 of the exact one wrongly.
Rules that know nothing of the lobe break on needles and on metal at small m; Monte Carlo says more than it knows; tanh-sinh
and the warped rule lose digits at kinks; derivatives of fixed rules break in more cells than their values.

The matrix: 28 lobes about an axis at 12 exponents from 0.01 to 10^7 and 4 microfacet lobes at 7 slopes from 0.001 to 2, at 8
angles from 0 to 90 degrees, in float64 and float32. References: ball arithmetic, slope-space integrals and, for microfacets at
90 degrees, the limit, in stability.csv beside this file: albedos to 1e-10 or better, derivatives to 1e-12, of microfacets to
1e-5. The production rule is shown for every lobe, the others for one of each kind; derivatives of the others, or in float32,
and eager programs for two lobes; verdicts are those of every fourth cell. The tests have the rest.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

SETTINGS = {
    "uniform-monte-carlo": 4096, "cosine-monte-carlo": 4096, "lobe-monte-carlo": 4096, "sobol": 4096, "r2-lattice": 4096,
    "midpoint-product": 32, "gauss-product": 32, "lobe-warped-gauss": 64, "tanh-sinh": 3, "adaptive": 1e-3, "zonal": 24,
    "half-vector": 24, "closed-form": 64,
}  # fmt: skip
SMALL, SLOPES = ("phong", "kb", "ggx"), ("phong", "ggx")


def run(size: str = "full") -> dict[str, Any]:
    """Outcomes of the production rule and of the others over the matrix, and false verdicts."""
    import jax
    import numpy as np

    from brdfcheck import stability
    from brdfcheck.quadrature import RULES

    references = stability.read_references(Path(__file__).with_name("stability.csv"))
    names = [name for name in references if size == "full" or name in SMALL]
    methods: dict[str, Any] = {"production": stability.production}
    for rule, setting in SETTINGS.items() if size == "full" else [("gauss-product", 32)]:
        methods[f"{rule} {setting}"] = stability.of_rule(RULES[rule](setting))

    def written(found: Any) -> list[str]:
        return ["".join("-" if cell < 0 else str(cell) for cell in row) for row in found]

    def outcomes(task: tuple[str, str]) -> list[dict[str, Any]]:
        method, name = task
        reference, found = references[name], []
        on_host = method.startswith("adaptive")
        mode = "eager" if method.endswith("eager") else "host" if on_host else "jit"
        for dtype in (np.float64, np.float32):
            rule = methods[method.split(",")[0]]
            got = stability.run(rule, name, reference.parameters, reference.cosines, dtype, mode=mode)
            cells = [("value", stability.outcomes(got, reference, dtype))]
            if mode == "jit" and (name in SLOPES or (method == "production" and dtype == np.float64)):
                slopes = stability.gradients_of(reference, rule, dtype)
                cells += [(f"d/d{by}", stability.gradient_outcomes(one, dtype)) for by, one in slopes.items()]
            same = {"method": method, "lobe": name, "dtype": dtype.__name__}
            found += [{**same, "of": of, "outcomes": written(one)} for of, one in cells]
        return found

    def takes(method: str, name: str) -> bool:
        rule = method.split()[0]
        if method != "production" and name not in (SLOPES if method.endswith("eager") else stability.KINDS):
            return False
        at = 1.0 if rule == "closed-form" else None  # of most lobes at normal incidence only
        return rule not in RULES or bool(RULES[rule](SETTINGS[rule]).takes(stability.LOBES[name](1.0), at))

    # On two cores: the verdicts mostly wait for Python, the rules for compiled programs.
    with ThreadPoolExecutor(3) as pool:
        matrix = pool.submit(stability.matrix_verdicts, [references[name] for name in names], every=4)
        factors = pool.submit(stability.false_verdicts, 2000 if size == "full" else 40)
        results = []
        for method in (*methods, "production, eager"):
            for part in pool.map(outcomes, [(method, name) for name in names if takes(method, name)]):
                results += part
            jax.clear_caches()  # a process may have 65,530 memory maps, and programs take tens each
    lobes = {name: {"label": stability.label(name), "parameters": references[name].parameters.tolist()} for name in names}
    angles = [float(f"{angle:.4g}") for angle in np.degrees(np.arccos(references[names[0]].cosines))]
    found = {"matrix": matrix.result(), "factors": factors.result()}
    return {"settings": {"lobes": lobes, "angles": angles}, "results": results, "summary": found}


def plot(record: dict[str, Any]) -> Any:
    """What part of the cells of each method holds, loses digits, lies and breaks: of values and of both derivatives."""
    from brdfcheck.plots.outcomes import shares

    return shares(record["results"])


def pictures(record: dict[str, Any]) -> dict[str, bytes]:
    """A map for each method: lobes and exponents down, angles across."""
    from brdfcheck import plots
    from brdfcheck.plots.outcomes import file_of, outcome_map

    settings = record["settings"]
    return {
        file_of(method): plots.to_bytes(outcome_map(method, record["results"], settings["lobes"], settings["angles"]), ".png")
        for method in dict.fromkeys(result["method"] for result in record["results"])
    }


def summary(record: dict[str, Any]) -> str:
    """Counts by method and precision, the maps, and the known failures with cause and remedy."""
    from brdfcheck.plots.outcomes import OUTCOMES, file_of
    from brdfcheck.stability import KNOWN_FAILURES
    from brdfcheck.studies import table

    cells: dict[tuple[str, str, str], str] = {}
    for result in record["results"]:
        place = (result["method"], result["of"], result["dtype"])
        cells[place] = cells.get(place, "") + "".join(result["outcomes"]).replace("-", "")
    rows = [
        (f"`{method}`", of, dtype, str(len(found)), *(str(found.count(str(code))) for code in range(4)))
        for (method, of, dtype), found in cells.items()
    ]
    counts = table(("method", "of", "precision", "cells", *OUTCOMES), rows)
    matrix, factors = record["summary"]["matrix"], record["summary"]["factors"]
    methods = dict.fromkeys(result["method"] for result in record["results"])
    return "\n\n".join((
        "Cells of the matrix by outcome. Holds: relative error at most 1e-8 in float64, 1e-4 in float32; of n dE/dn (m dE/dm)"
        " and dE/dtheta at most 1e-3 and 1e-2 of the larger of themselves and E. Lies: wrong by more than the rule's own claim."
        " Breaks: not finite, or wrong by half. Left out: cells without a formula, derivatives beyond the precision.",
        counts,
        f"False verdicts of `check` in float64: {matrix['false']} of {matrix['cells']} in the cells of the matrix, on the line"
        f" at 1 and on one within 1e-6 of the albedo ({matrix['undecided']} undecided); {factors['false']} of"
        f" {factors['factors']} random factors within 1e-6 of the exact one ({factors['undecided']} undecided). In float32,"
        " whose error bars are 4e-6 or more, such factors are all undecided.",
        "What fails, with cause and remedy:", table(("what fails", "cause", "remedy"), KNOWN_FAILURES),
        *(f"`{method}`:\n\n![{method}]({file_of(method)})" for method in methods),
    ))  # fmt: skip


if __name__ == "__main__":
    from brdfcheck.studies import main

    main(__file__)
