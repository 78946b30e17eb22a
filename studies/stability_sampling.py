"""Where do rules of samples hold, lose digits, lie or break, over every kind of lobe, exponent, angle and precision?

Command: ``brdfcheck study stability_sampling``. A minute on two cores.

Answer: hardly anywhere to 8 digits: in float64 the Gauss product rule in 154 of 592 cells, Sobol's sequence in 13, all others
in 2 or less. All but lobe-importance Monte Carlo break in 63 to 82 cells, the needles, where no sample meets the lobe.
Lobe-importance sampling breaks in none, but Monte Carlo lies in 136 to 156 cells: its standard error is taken from samples that
missed the peak. Lattices and product rules claim no error, so they cannot lie.

Matrix and references are those of the study stability, which has the rules that know the lobe; of its lobes one of each kind,
in float32 a power and facets. The rules here: 4,096 samples each by chance, from a Sobol sequence or an R2 lattice, and product
rules of 32 x 64 directions.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from _instruments.outcome_charts import CELLS, page, pictures, plot
from _instruments.stability import survey
from _instruments.stability.references import KINDS, read_references

__all__ = ["pictures", "plot", "run", "summary"]

SMALL = ("phong", "kb", "ggx")
SINGLE = ("phong", "ggx")  # in float32 too: to rules of samples it is noise


def run(size: str = "full") -> dict[str, Any]:
    """Outcomes of rules whose samples do not follow the lobe, and of lobe-importance Monte Carlo."""
    references = read_references(KINDS if size == "full" else SMALL)
    jobs = survey.of_rules(survey.SAMPLING if size == "full" else {"gauss-product": 32}, references)
    wide = [dataclasses.replace(job, precisions=(np.float64,)) for job in jobs if job.lobe not in SINGLE]
    return survey.measured([*wide, *(job for job in jobs if job.lobe in SINGLE)], references)


def summary(record: dict[str, Any]) -> str:
    """Counts by rule and precision, and the maps."""
    return page(record, f"{CELLS} In float32 they are of Phong's lobe and GGX alone.")
