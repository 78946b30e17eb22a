"""Where do derivatives of an albedo hold, lose digits or break, over lobes of each kind, exponents, angles and precisions?

Command: ``brdfcheck study stability_derivatives``. A minute and a half on two cores.

Answer: those of `brdfcheck.albedo` hold in all 440 cells of float64; of float32 two, dE/dtheta of an unclamped power, are off
by more than 1e-2, and 24 do not fit into the precision. Rules whose nodes follow lobe and horizon, zonal and half-vector, hold
or lose digits, in 4 of 304 cells of float64; Monte Carlo, Sobol's sequence and the product rule hold in 13 to 73 % and break
in 17 to 24 % but for lobe-importance sampling, which breaks in none, because their samples do not move with the lobe.

The matrix and its references are those of the study stability: derivatives to 1e-12, of microfacets to 1e-5. n dE/dn (m dE/dm)
and dE/dtheta by reverse-mode differentiation of the production rule for one lobe of each kind, and for the one that loses
digits; the slow tests have those of all lobes. Of the other rules, whose programs take longest to compile, in float64 for
Phong's lobe, or GGX where a rule takes only facets.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from _instruments.outcome_charts import page, pictures, plot
from _instruments.stability import outcomes, survey
from _instruments.stability.references import read_references

__all__ = ["pictures", "plot", "run", "summary"]

# A power, a tail, kinks, facets, and the one that loses digits.
LOBES = ("phong", "schlick", "kb_half", "ggx", "binomial16_mirror_unclamped")
OTHERS = ("phong", "ggx")
SMALL = ("phong",)
# Of rules of samples one of each kind: by chance, where the lobe is, from a sequence, products.
SAMPLING = ("cosine-monte-carlo", "lobe-monte-carlo", "sobol", "gauss-product")


def run(size: str = "full") -> dict[str, Any]:
    """Outcomes of the derivatives of the production rule and of the others."""
    references = read_references(LOBES if size == "full" else SMALL)
    jobs = [survey.Job("production", outcomes.production, name, "derivatives") for name in references]
    rules = {name: survey.SAMPLING[name] for name in SAMPLING} | survey.FOLLOWING if size == "full" else {"gauss-product": 32}
    others = survey.of_rules(rules, [name for name in OTHERS if name in references], "derivatives")
    first = {job.name: job for job in reversed(others)}.values()  # of each rule the first lobe that it takes
    jobs += [dataclasses.replace(job, precisions=(np.float64,)) for job in first]
    return survey.measured(jobs, references)


def summary(record: dict[str, Any]) -> str:
    """Counts by method, derivative and precision, and the maps."""
    return page(
        record,
        "Cells of the matrix by outcome. Holds: n dE/dn (m dE/dm) or dE/dtheta is off by at most 1e-3 in float64, 1e-2 in"
        " float32, of the larger of itself and E. Breaks: not finite, or wrong by half. No rule claims an error of a"
        " derivative, so none lies. Left out: cells without a formula, and derivatives beyond the precision.",
    )
