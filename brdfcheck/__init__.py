"""Does this BRDF conserve energy? Directional albedos with error bars, and verdicts on whole families of BRDFs.

The public names are imported when they are first used, so that ``import brdfcheck`` costs nothing.
"""

from __future__ import annotations

import importlib

# Type checkers take it for true. That of `typing` would be the dearest import of a command that has only begun.
TYPE_CHECKING = False

__version__ = "0.1.0"

if TYPE_CHECKING:
    from brdfcheck import catalog as catalog
    from brdfcheck.budgets.measure import Budget as Budget
    from brdfcheck.budgets.measure import budget as budget
    from brdfcheck.callables import Finding as Finding
    from brdfcheck.directional import Albedo as Albedo
    from brdfcheck.directional import albedo as albedo
    from brdfcheck.factors import BlinnPhongExact as BlinnPhongExact
    from brdfcheck.factors import Factor as Factor
    from brdfcheck.factors import Normalized as Normalized
    from brdfcheck.factors import PerCosine as PerCosine
    from brdfcheck.factors import PhongExact as PhongExact
    from brdfcheck.family import Family as Family
    from brdfcheck.fit import FactorFit as FactorFit
    from brdfcheck.fit import fit_factor as fit_factor
    from brdfcheck.ladder import factor_ladder as factor_ladder
    from brdfcheck.lobes import BinomialPower as BinomialPower
    from brdfcheck.lobes import BlinnPhong as BlinnPhong
    from brdfcheck.lobes import KuijkBlake as KuijkBlake
    from brdfcheck.lobes import Lambert as Lambert
    from brdfcheck.lobes import Lyon as Lyon
    from brdfcheck.lobes import Phong as Phong
    from brdfcheck.lobes import Schlick as Schlick
    from brdfcheck.microfacet import GGX as GGX
    from brdfcheck.microfacet import CookTorrance as CookTorrance
    from brdfcheck.precision import use_x64 as use_x64
    from brdfcheck.tables import albedo_table as albedo_table
    from brdfcheck.verdict import Report as Report
    from brdfcheck.verdict import Verdict as Verdict
    from brdfcheck.verdict import assert_conserves as assert_conserves
    from brdfcheck.verdict import check as check

_HOME = {
    "Albedo": "directional",
    "BinomialPower": "lobes",
    "BlinnPhong": "lobes",
    "BlinnPhongExact": "factors",
    "Budget": "budgets.measure",
    "CookTorrance": "microfacet",
    "Factor": "factors",
    "FactorFit": "fit",
    "Family": "family",
    "Finding": "callables",
    "GGX": "microfacet",
    "KuijkBlake": "lobes",
    "Lambert": "lobes",
    "Lyon": "lobes",
    "Normalized": "factors",
    "PerCosine": "factors",
    "Phong": "lobes",
    "PhongExact": "factors",
    "Report": "verdict",
    "Schlick": "lobes",
    "Verdict": "verdict",
    "albedo": "directional",
    "albedo_table": "tables",
    "assert_conserves": "verdict",
    "budget": "budgets.measure",
    "check": "verdict",
    "factor_ladder": "ladder",
    "fit_factor": "fit",
    "use_x64": "precision",
}

__all__ = [
    "GGX",
    "Albedo",
    "BinomialPower",
    "BlinnPhong",
    "BlinnPhongExact",
    "Budget",
    "CookTorrance",
    "Factor",
    "FactorFit",
    "Family",
    "Finding",
    "KuijkBlake",
    "Lambert",
    "Lyon",
    "Normalized",
    "PerCosine",
    "Phong",
    "PhongExact",
    "Report",
    "Schlick",
    "Verdict",
    "__version__",
    "albedo",
    "albedo_table",
    "assert_conserves",
    "budget",
    "catalog",
    "check",
    "factor_ladder",
    "fit_factor",
    "use_x64",
]


def __getattr__(name: str) -> object:
    if name == "catalog":
        return importlib.import_module("brdfcheck.catalog")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"brdfcheck.{_HOME[name]}"), name)
    globals()[name] = value  # the next look-up does not come here
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
