"""torchquad: Gauss-Legendre product over the polar angle and the azimuth, in torch where it is installed, else numpy."""

from __future__ import annotations

import importlib.util
import math
from typing import Any, ClassVar, final

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from _instruments.peers.peer import AbstractPeer, Integrand, load
from brdfcheck.quadrature.rule import Raw, checked_count


@final
class TorchquadGauss(AbstractPeer):
    """`torchquad.GaussLegendre` with `order` nodes in either angle. It claims nothing. ValueError for an order below 1."""

    order: int = eqx.field(static=True)
    name: ClassVar[str] = "torchquad-gauss"
    package: ClassVar[str] = "torchquad"
    ladder: ClassVar[tuple[Any, ...]] = (8, 16, 32, 64, 128, 256, 512)
    needs: ClassVar[str] = "a scalar function f(wi, wo)"

    def __init__(self, order: int = 64):
        self.order = checked_count(order, "order")

    def compute(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        integrand = Integrand(core, mu)
        bounds = np.array([[0.0, math.pi / 2], [0.0, 2 * math.pi]])
        if importlib.util.find_spec("torch") is not None:
            torch = load("torch")

            def values(x: Any) -> Any:
                points = x.detach().cpu().numpy()
                return torch.from_numpy(np.ascontiguousarray(integrand(points[:, 0], points[:, 1])))

            domain: Any = torch.from_numpy(bounds)
        else:
            domain = bounds

            def values(x: Any) -> Any:
                return integrand(x[:, 0], x[:, 1])

        found = load("torchquad").GaussLegendre().integrate(values, dim=2, N=self.order**2, integration_domain=domain)
        return Raw(float(found), np.inf, integrand.evaluations)
