"""All rules by name."""

from __future__ import annotations

from types import MappingProxyType

from brdfcheck.quadrature.closed_form import ClosedForm
from brdfcheck.quadrature.exact import Adaptive, HalfVector, Zonal
from brdfcheck.quadrature.product import GaussProduct, MidpointProduct
from brdfcheck.quadrature.rule import RuleKind
from brdfcheck.quadrature.sampling import CosineMonteCarlo, LobeMonteCarlo, R2Lattice, Sobol, UniformMonteCarlo
from brdfcheck.quadrature.warped import LobeWarpedGauss, TanhSinh

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
