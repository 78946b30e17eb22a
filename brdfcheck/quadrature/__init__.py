"""Quadrature rules, one file per family, and the registry that names them all.

`RULES` maps a name to the constructor of a rule; ``RULES[name].ladder`` is a range of settings from cheap to accurate:

    rule = RULES["gauss-product"](32)
    estimate = rule(brdf, cos_theta)             # value, error, evaluations, status
    RULES["uniform-monte-carlo"](4096)(brdf, cos_theta, key=jax.random.key(0))
"""

from brdfcheck.names import lazy

__getattr__, __dir__ = lazy(__name__, __file__)
