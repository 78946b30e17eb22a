"""What a peer is: a rule that belongs to somebody else, and may not be installed."""

from __future__ import annotations

import abc
import importlib
import importlib.util
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any, ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.quadrature.functions import host_evaluator
from brdfcheck.quadrature.rule import AbstractRule, Raw, checked_accuracy

# A peer that is given a needle may refine without end: where to stop it.
MAX_EVALUATIONS = 400_000


class PeerMissing(ImportError):
    """A peer's package is not installed; the message says what to do."""


class BudgetSpent(Exception):
    """A peer asked for more evaluations than it is allowed."""


class AbstractPeer(AbstractRule):
    """An integrator of another package. `package` is the name under which it is installed and imported.

    `compiles`: whether its first call on a BRDF compiles a program, which takes seconds.
    """

    package: eqx.AbstractClassVar[str]
    family: ClassVar[str] = "peers"
    on_host: ClassVar[bool] = True
    compiles: ClassVar[bool] = False

    @classmethod
    def missing(cls) -> str | None:
        """None where the peer can run; else a message that says what is missing."""
        return not_installed(cls.package)

    @abc.abstractmethod
    def compute(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        """As `integrate`, with the package there."""

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        message = self.missing()
        if message is not None:
            raise PeerMissing(message)
        return self.compute(core, mu, key)


class AbstractAdaptivePeer(AbstractPeer):
    """A peer that refines until it has reached a tolerance. ValueError for one outside (0, 1)."""

    tolerance: float = eqx.field(static=True)
    ladder: ClassVar[tuple[Any, ...]] = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)

    def __init__(self, tolerance: float = 1e-6):
        self.tolerance = checked_accuracy(tolerance, "tolerance")


def not_installed(package: str) -> str | None:
    """None where `package` can be imported; else what to install. Nothing is imported."""
    if importlib.util.find_spec(package) is not None:
        return None
    return f"{package} is not installed: pip install 'brdfcheck[peers]'"


def load(package: str) -> ModuleType:
    """The package itself."""
    return importlib.import_module(package)


class Integrand:
    """f cos(theta) sin(theta) in numpy, at polar angles and azimuths; counts, and stops what runs away."""

    def __init__(self, core: Callable[..., Any], mu: Float[Array, ""]):
        self.theta = math.acos(float(mu))
        wi, evaluate = np.array([math.sin(self.theta), 0.0, float(mu)]), host_evaluator(core, mu.dtype)
        self._evaluate = lambda wo: evaluate(np.broadcast_to(wi, wo.shape), wo)
        self.evaluations = 0

    def __call__(self, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Values of shape (k,) or (k, channels) at angles of shape (k,)."""
        if self.evaluations + len(theta) > MAX_EVALUATIONS:
            raise BudgetSpent
        self.evaluations += len(theta)
        sine, cosine = np.sin(theta), np.cos(theta)
        values = self._evaluate(np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1)).astype(float)
        weight = sine * cosine
        return values * (weight if values.ndim == 1 else weight[:, None])

    def scalar(self, theta: float, phi: float) -> float:
        """The value at one point; TypeError for a BRDF with channels."""
        value = self(np.array([theta]), np.array([phi]))
        if value.ndim != 1:
            raise TypeError("this peer integrates scalar functions; the BRDF has channels")
        return float(value[0])
