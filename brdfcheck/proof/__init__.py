"""Proofs that BRDFs conserve energy, or do not: exact arithmetic, theorems whose premises are checked, small certificates."""

from brdfcheck.names import lazy

__getattr__, __dir__ = lazy(__name__, __file__)
