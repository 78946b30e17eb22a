"""Where do derivatives of an albedo hold, lose digits or break, over every lobe, exponent, angle and precision?

Command: ``brdfcheck study stability_derivatives``. Two minutes on two cores.

Answer: those of `brdfcheck.albedo` hold in all 2,912 cells of float64; of float32 two, dE/dtheta of unclamped powers, are off
by more than 1e-2, and 78 do not fit into the precision. Rules whose nodes follow lobe and horizon, zonal and half-vector, hold
or lose digits, in 4 of 304 cells of float64; Monte Carlo, lattices and product rules hold in 10 to 73 % and break in 17 to 24 %
but for lobe-importance sampling, which breaks in none, because their samples do not move with the lobe.

The matrix and its references are those of the study stability: derivatives to 1e-12, of microfacets to 1e-5. n dE/dn (m dE/dm)
and dE/dtheta by reverse-mode differentiation of the production rule for every lobe; of the other rules, whose programs take
longest to compile, for Phong's lobe, or GGX where a rule takes only facets.
"""

from __future__ import annotations

from typing import Any

from _instruments import stability
from _instruments.outcome_charts import page, pictures, plot

__all__ = ["pictures", "plot", "run", "summary"]

OTHERS = ("phong", "ggx")
SMALL = ("phong",)


def run(size: str = "full") -> dict[str, Any]:
    """Outcomes of the derivatives of the production rule and of the others."""
    references = stability.read_references(None if size == "full" else SMALL)
    # To 1e-3 it does not matter in which instructions float64 computes; in float32 it does: these are the ones of production.
    jobs = [stability.Job("production", stability.production, name, "derivatives", every=True) for name in references]
    rules = stability.SAMPLING | stability.FOLLOWING if size == "full" else {"gauss-product": 32}
    others = stability.of_rules(rules, [name for name in OTHERS if name in references], "derivatives")
    jobs += {job.name: job for job in reversed(others)}.values()  # of each rule the first lobe that it takes
    return stability.measured(jobs, references)


def summary(record: dict[str, Any]) -> str:
    """Counts by method, derivative and precision, and the maps."""
    return page(
        record,
        "Cells of the matrix by outcome. Holds: n dE/dn (m dE/dm) or dE/dtheta is off by at most 1e-3 in float64, 1e-2 in"
        " float32, of the larger of itself and E. Breaks: not finite, or wrong by half. No rule claims an error of a"
        " derivative, so none lies. Left out: cells without a formula, and derivatives beyond the precision.",
    )
