"""Where do rules that know the lobe hold, lose digits, lie or break, over every lobe, exponent, angle and precision?

Command: ``brdfcheck study stability``. Two minutes on two cores.

Answer: `brdfcheck.albedo` holds in all 2,912 cells of both precisions, and where it runs operation by operation. Of 592 cells
of one lobe of each kind the warped rule breaks in 94, of unclamped powers, Schlick's tail and Kuijk-Blake's kinks, and holds in
37 of float64; tanh-sinh lies in 21 and holds in 157. The zonal rule asked for 6 digits holds in all 480 cells, the half-vector
rule asked for 5 loses digits in 41 of 112 of float64 and says so. The adaptive rule, asked for 1e-3 of Phong's lobe and GGX,
never lies in float64; in float32 it lies in 1 of 152 cells. Closed forms hold.

The matrix: 28 lobes about an axis at 12 exponents from 0.01 to 10^7 and 4 microfacet lobes at 7 slopes from 0.001 to 2, at 8
angles from 0 to 90 degrees, in float64 and float32: the production rule for all of them, others for one lobe of each kind.
References: ball arithmetic, slope-space integrals and, for microfacets at 90 degrees, the limit, in stability.csv beside this
file: albedos to 1e-10 or better. `production` is `brdfcheck.albedo`; as an eager program, operation by operation, it is shown
for Phong's lobe. Rules of samples have a study of their own (stability_sampling), as have derivatives
(stability_derivatives) and verdicts.
"""

from __future__ import annotations

from typing import Any

from _instruments.outcome_charts import CELLS, page, pictures, plot
from _instruments.stability import failures, outcomes, survey
from _instruments.stability.references import KINDS, read_references
from brdfcheck.studies import table

__all__ = ["pictures", "plot", "run", "summary"]

EAGER = "phong"
ADAPTIVE = ("phong", "ggx")
SMALL = ("phong", "kb", "ggx")


def run(size: str = "full") -> dict[str, Any]:
    """Outcomes of the production rule and of others that know where the lobe is."""
    references = read_references(None if size == "full" else SMALL)
    jobs = [survey.Job("production", outcomes.production, name) for name in references]
    kinds = [name for name in KINDS if name in references]
    jobs += survey.of_rules(survey.FOLLOWING if size == "full" else {"zonal": 6}, kinds)
    jobs += survey.of_rules({"adaptive": 1e-3}, ADAPTIVE if size == "full" else ())
    jobs.append(survey.Job("production, eager", outcomes.production, EAGER, mode="eager"))
    return survey.measured(jobs, references)


def summary(record: dict[str, Any]) -> str:
    """Counts by method and precision, the known failures with cause and remedy, and the maps."""
    known = table(("what fails", "cause", "remedy"), failures.KNOWN_FAILURES)
    return page(record, CELLS, f"What fails, with cause and remedy:\n\n{known}")
