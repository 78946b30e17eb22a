"""torchquad: Gauss-Legendre product over the polar angle and the azimuth, in numpy."""

from __future__ import annotations

import math
from typing import Any, ClassVar, final

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from _instruments.peers.peer import AbstractPeer, Integrand, load
from brdfcheck.quadrature.rule import Raw


@final
class TorchquadGauss(AbstractPeer):
    """`torchquad.GaussLegendre` with `order` nodes in either angle. It claims nothing."""

    order: int = eqx.field(static=True)
    name: ClassVar[str] = "torchquad-gauss"
    package: ClassVar[str] = "torchquad"
    ladder: ClassVar[tuple[Any, ...]] = (8, 16, 32, 64, 128, 256, 512)
    needs: ClassVar[str] = "a scalar function f(wi, wo)"

    def __init__(self, order: int = 64):
        self.order = order

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        integrand = Integrand(core, mu)
        bounds = np.array([[0.0, math.pi / 2], [0.0, 2 * math.pi]])

        def values(x: Any) -> Any:
            return integrand(x[:, 0], x[:, 1])

        found = load("torchquad").GaussLegendre().integrate(values, dim=2, N=self.order**2, integration_domain=bounds)
        return Raw(float(found), np.inf, integrand.evaluations)
