"""What a peer is: a rule that belongs to somebody else, and may not be installed."""

from __future__ import annotations

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
from brdfcheck.quadrature.rule import AbstractRule

# A peer that is given a needle may refine without end: where to stop it.
MAX_EVALUATIONS = 400_000


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


class AbstractAdaptivePeer(AbstractPeer):
    """A peer that refines until it has reached a tolerance."""

    tolerance: float = eqx.field(static=True)
    ladder: ClassVar[tuple[Any, ...]] = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)

    def __init__(self, tolerance: float = 1e-6):
        self.tolerance = tolerance


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
        """Values at angles, all of shape (k,)."""
        if self.evaluations + len(theta) > MAX_EVALUATIONS:
            raise BudgetSpent
        self.evaluations += len(theta)
        sine, cosine = np.sin(theta), np.cos(theta)
        return self._evaluate(np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1)).astype(float) * sine * cosine

    def scalar(self, theta: float, phi: float) -> float:
        """The value at one point."""
        return float(self(np.array([theta]), np.array([phi]))[0])
