"""SciPy: nested `quad` with the mirror direction pointed out, `dblquad` without, and `cubature`."""

from __future__ import annotations

import math
import warnings
from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Array, Float

from _instruments.peers.peer import AbstractAdaptivePeer, BudgetSpent, Integrand, load
from brdfcheck.quadrature.rule import NOT_REACHED, OK, Raw


@final
class ScipyQuad(AbstractAdaptivePeer):
    """`scipy.integrate.quad` over the polar angle of `quad` over the azimuth, told where the mirror direction is."""

    name: ClassVar[str] = "scipy-quad"
    package: ClassVar[str] = "scipy"
    needs: ClassVar[str] = "a scalar function f(wi, wo)"

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        quad = load("scipy.integrate").quad
        integrand = Integrand(core, mu)
        goal = {"epsabs": self.tolerance, "epsrel": self.tolerance}

        def ring(theta: float) -> float:
            return quad(lambda phi: integrand.scalar(theta, phi), 0, 2 * math.pi, points=[math.pi], **goal)[0]

        hint = [integrand.theta] if 0 < integrand.theta < math.pi / 2 else None
        return _watched(integrand, lambda: quad(ring, 0, math.pi / 2, points=hint, **goal)[:2])


@final
class ScipyDblquad(AbstractAdaptivePeer):
    """`scipy.integrate.dblquad` over the polar angle and the azimuth."""

    name: ClassVar[str] = "scipy-dblquad"
    package: ClassVar[str] = "scipy"
    needs: ClassVar[str] = "a scalar function f(wi, wo)"

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        dblquad = load("scipy.integrate").dblquad
        integrand = Integrand(core, mu)

        def run() -> tuple[float, float]:
            return dblquad(
                lambda phi, theta: integrand.scalar(theta, phi),
                0,
                math.pi / 2,
                0,
                2 * math.pi,
                epsabs=self.tolerance,
                epsrel=self.tolerance,
            )

        return _watched(integrand, run)


@final
class ScipyCubature(AbstractAdaptivePeer):
    """`scipy.integrate.cubature` (SciPy 1.15 or newer), 21-point Gauss-Kronrod products, on arrays of points."""

    name: ClassVar[str] = "scipy-cubature"
    package: ClassVar[str] = "scipy"

    @classmethod
    def missing(cls) -> str | None:
        return None if hasattr(load("scipy.integrate"), "cubature") else "scipy.integrate.cubature needs SciPy 1.15 or newer"

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        cubature = load("scipy.integrate").cubature
        integrand = Integrand(core, mu)
        goal = {"atol": self.tolerance, "rtol": self.tolerance}
        try:
            found = cubature(lambda x: integrand(x[:, 0], x[:, 1]), [0.0, 0.0], [math.pi / 2, 2 * math.pi], **goal)
        except BudgetSpent:
            return Raw(np.nan, np.inf, integrand.evaluations, NOT_REACHED)
        return Raw(found.estimate, found.error, integrand.evaluations, OK if found.status == "converged" else NOT_REACHED)


def _watched(integrand: Integrand, run: Any) -> Raw:
    """Runs a scalar integrator; its warnings and its budget become a status."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            value, error = run()
        except BudgetSpent:
            return Raw(np.nan, np.inf, integrand.evaluations, NOT_REACHED)
    trouble = [warning for warning in caught if issubclass(warning.category, load("scipy.integrate").IntegrationWarning)]
    return Raw(value, error, integrand.evaluations, NOT_REACHED if trouble else OK)
