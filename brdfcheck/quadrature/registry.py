"""All rules by name, and the engine that a BRDF gets."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

from brdfcheck.brdf.base import core_of
from brdfcheck.quadrature.closed_form import ClosedForm
from brdfcheck.quadrature.functions import Adaptive
from brdfcheck.quadrature.half_vector import HalfVector
from brdfcheck.quadrature.product import GaussProduct, MidpointProduct
from brdfcheck.quadrature.rule import AbstractEngine, RuleKind
from brdfcheck.quadrature.sampling import CosineMonteCarlo, LobeMonteCarlo, R2Lattice, Sobol, UniformMonteCarlo
from brdfcheck.quadrature.warped import LobeWarpedGauss, TanhSinh
from brdfcheck.quadrature.zonal import Zonal

# In the order of charts: from what knows nothing to what knows all.
RULES: MappingProxyType[str, RuleKind] = MappingProxyType(
    {
        rule.name: rule
        for rule in (
            UniformMonteCarlo,
            CosineMonteCarlo,
            LobeMonteCarlo,
            Sobol,
            R2Lattice,
            MidpointProduct,
            GaussProduct,
            LobeWarpedGauss,
            TanhSinh,
            Adaptive,
            Zonal,
            HalfVector,
            ClosedForm,
        )
    }
)

# The first one that takes a BRDF is its engine.
ENGINES: tuple[type[AbstractEngine], ...] = (Zonal, HalfVector, Adaptive)


def engine_of(brdf: Any) -> type[AbstractEngine]:
    """The engine of a BRDF: of a lobe, with or without factors around it, or of a function f(wi, wo)."""
    return next(engine for engine in ENGINES if engine().applies(core_of(brdf), None))  # pyright: ignore[reportCallIssue]
