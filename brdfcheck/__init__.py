"""Does this BRDF conserve energy? Directional albedos with error bars, and verdicts on whole families of BRDFs.

The public names are imported when they are first used, so that ``import brdfcheck`` costs nothing.
"""

from __future__ import annotations

import importlib

# Type checkers take it for true. That of `typing` would be the dearest import of a command that has only begun.
TYPE_CHECKING = False

__version__ = "0.1.0"

if TYPE_CHECKING:
    from brdfcheck.brdf import catalog as catalog
    from brdfcheck.brdf.callables import Finding as Finding
    from brdfcheck.brdf.factors import BlinnPhongExact as BlinnPhongExact
    from brdfcheck.brdf.factors import Factor as Factor
    from brdfcheck.brdf.factors import Normalized as Normalized
    from brdfcheck.brdf.factors import PerCosine as PerCosine
    from brdfcheck.brdf.factors import PhongExact as PhongExact
    from brdfcheck.brdf.family import Family as Family
    from brdfcheck.brdf.lobes import BinomialPower as BinomialPower
    from brdfcheck.brdf.lobes import BlinnPhong as BlinnPhong
    from brdfcheck.brdf.lobes import KuijkBlake as KuijkBlake
    from brdfcheck.brdf.lobes import Lambert as Lambert
    from brdfcheck.brdf.lobes import Lyon as Lyon
    from brdfcheck.brdf.lobes import Phong as Phong
    from brdfcheck.brdf.lobes import Schlick as Schlick
    from brdfcheck.brdf.microfacet import GGX as GGX
    from brdfcheck.brdf.microfacet import CookTorrance as CookTorrance
    from brdfcheck.brdf.subject import load as load
    from brdfcheck.budgets.measure import Budget as Budget
    from brdfcheck.budgets.measure import budget as budget
    from brdfcheck.fits.factor import FactorFit as FactorFit
    from brdfcheck.fits.factor import fit_factor as fit_factor
    from brdfcheck.fits.ladder import factor_ladder as factor_ladder
    from brdfcheck.quadrature.albedo import Albedo as Albedo
    from brdfcheck.quadrature.albedo import albedo as albedo
    from brdfcheck.quadrature.tables import albedo_table as albedo_table
    from brdfcheck.runtime import use_x64 as use_x64
    from brdfcheck.verdict import Report as Report
    from brdfcheck.verdict import Verdict as Verdict
    from brdfcheck.verdict import assert_conserves as assert_conserves
    from brdfcheck.verdict import check as check

_HOME = {
    "Albedo": "quadrature.albedo",
    "BinomialPower": "brdf.lobes",
    "BlinnPhong": "brdf.lobes",
    "BlinnPhongExact": "brdf.factors",
    "Budget": "budgets.measure",
    "CookTorrance": "brdf.microfacet",
    "Factor": "brdf.factors",
    "FactorFit": "fits.factor",
    "Family": "brdf.family",
    "Finding": "brdf.callables",
    "GGX": "brdf.microfacet",
    "KuijkBlake": "brdf.lobes",
    "Lambert": "brdf.lobes",
    "Lyon": "brdf.lobes",
    "Normalized": "brdf.factors",
    "PerCosine": "brdf.factors",
    "Phong": "brdf.lobes",
    "PhongExact": "brdf.factors",
    "Report": "verdict",
    "Schlick": "brdf.lobes",
    "Verdict": "verdict",
    "albedo": "quadrature.albedo",
    "albedo_table": "quadrature.tables",
    "assert_conserves": "verdict",
    "budget": "budgets.measure",
    "check": "verdict",
    "factor_ladder": "fits.ladder",
    "fit_factor": "fits.factor",
    "load": "brdf.subject",
    "use_x64": "runtime",
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
    "load",
    "use_x64",
]


def __getattr__(name: str) -> object:
    if name == "catalog":
        return importlib.import_module("brdfcheck.brdf.catalog")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"brdfcheck.{_HOME[name]}"), name)
    globals()[name] = value  # the next look-up does not come here
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
