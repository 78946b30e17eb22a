"""Quadrature rules, one file per family, and the registry that names them all.

`RULES` maps a name to the constructor of a rule; ``RULES[name].ladder`` is a range of settings from cheap to accurate:

    rule = RULES["gauss-product"](32)
    estimate = rule(brdf, cos_theta)             # value, error, evaluations, status
    RULES["uniform-monte-carlo"](4096)(brdf, cos_theta, key=jax.random.key(0))
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from brdfcheck.quadrature.registry import RULES as RULES
    from brdfcheck.quadrature.rule import AbstractRule as AbstractRule
    from brdfcheck.quadrature.rule import Estimate as Estimate

_HOME = {"AbstractRule": "rule", "Estimate": "rule", "RULES": "registry"}

__all__ = ["RULES", "AbstractRule", "Estimate"]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"brdfcheck.quadrature.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
