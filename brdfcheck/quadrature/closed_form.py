r"""The closed forms: rules that know which lobe they look at.

Phong's lobe at any incidence and any n >= 0, with $q = 1 - \mu^2$ and I the regularised incomplete beta function:

$E = \frac{1}{n+2}\left[\pi\mu\,(1 + I_{\mu^2}(\tfrac12, \tfrac n2 + 1))
 + \sqrt\pi\,\frac{\Gamma(\frac{n+1}2)}{\Gamma(\frac n2 + 1)}\,q^{n/2+1}\right]$,

which is the formula of Mallett & Yuksel (2020) with its difference carried out: all terms are positive, nothing cancels.
At normal incidence the other lobes have the closed forms of `factors`; Lambert's albedo is its reflectance.
"""

from __future__ import annotations

import functools
import math
from typing import Any, ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.scipy.special import erf
from jaxtyping import Array, Float

from brdfcheck.brdf.factors import exact_factor
from brdfcheck.brdf.lobes import Lambert, Phong
from brdfcheck.quadrature.rule import NOT_KNOWN, OK, AbstractRule, Raw

# Gamma(x + 1/2)/Gamma(x + 1) sqrt(x) in powers of 1/x.
_RATIO = (1, -1 / 8, 1 / 128, 5 / 1024, -21 / 32768, -399 / 262144, 869 / 4194304, 39325 / 33554432)
# From what argument on expansions are used, and how many terms then give all digits.
_SHIFT = 32
_TERMS = 12


@functools.cache
def _root_series() -> tuple[float, ...]:
    """Coefficients of (w / (1 - exp(-w)))^(1/2) in powers of w."""
    base = [(-1) ** k / math.factorial(k + 1) for k in range(_TERMS)]
    power = [1.0]
    for k in range(1, _TERMS):
        power.append(sum((0.5 * j - k) * base[j] * power[k - j] for j in range(1, k + 1)) / k)
    return tuple(power)


def phong_albedo(n: Float[Array, ""], mu: Float[Array, ""]) -> Float[Array, ""]:
    """The albedo of the mirror-form cosine power with peak 1, at any n >= 0 and cos theta in [0, 1].

    To a few roundings at any n: with b = n/2 + 32 the beta function is Gamma ratios times incomplete gammas (DLMF 8.18),
    and I comes down to n/2 + 1 by its recurrence.
    """
    b, square = n / 2, mu * mu
    slanted = square < 1
    logarithm = jnp.log1p(-jnp.where(slanted, square, 0))  # of q: as a difference q would lose b roundings
    # Gamma(x + 1/2)/Gamma(x + 1) at x = b, b + 1, ..., b + shift.
    large = b + _SHIFT
    series = jnp.zeros_like(b)
    for coefficient in reversed(_RATIO):
        series = series / large + coefficient
    top = series / jnp.sqrt(large)
    steps = jnp.arange(_SHIFT, dtype=mu.dtype)
    ratios = top * jnp.cumprod(((b + steps + 1) / (b + steps + 0.5))[::-1])[::-1]
    # Of q = 0 the first power alone has a derivative that matters: that of lower ones is lost with the term itself.
    upright = jnp.where(b + steps == 1, 1 - square, jnp.where(b + steps > 0, 0, 1))
    powers = jnp.where(slanted, jnp.exp((b + steps) * logarithm), upright)
    terms = ratios * powers
    rest = terms[0] - square * jnp.sum(terms)
    return (np.pi * mu * (1 + _beta_share(large, top, mu)) + math.sqrt(math.pi) * rest) / (n + 2)


def _beta_share(b: Array, ratio: Array, mu: Array) -> Array:
    r"""$I_{\mu^2}(1/2, b)$ for b >= 32, from its expansion in incomplete gamma functions of -b log(1 - mu^2)."""
    inside = (mu > 0) & (mu * mu < 1)
    square = jnp.where(inside, mu * mu, 0.5)
    z = -b * jnp.log1p(-square)
    fall = jnp.exp(-z)
    gamma = math.sqrt(math.pi) * erf(jnp.sqrt(z))
    grown = jnp.sqrt(z) * fall  # z^(k + 1/2) exp(-z)
    total, share = jnp.zeros_like(z), jnp.ones_like(b)  # share: b^-k, which falls to 0 where b^k would overflow
    for k, coefficient in enumerate(_root_series()):
        total = total + coefficient * gamma * share
        gamma, grown, share = (k + 0.5) * gamma - grown, grown * z, share / b
    return jnp.where(inside, total * ratio * jnp.sqrt(b / np.pi), jnp.where(mu > 0, 1.0, 0.0))


@final
class ClosedForm(AbstractRule):
    """The albedo by formula, where one exists: Phong and Lambert at any incidence, other lobes at normal incidence.

    No evaluations; the error is a bound on rounding. Under tracing, where the incidence is not known in advance, the
    status says where there was no formula. The setting is the number of roundings that the error allows.
    """

    roundings: int = eqx.field(static=True)
    name: ClassVar[str] = "closed-form"
    family: ClassVar[str] = "closed-form"
    ladder: ClassVar[tuple[Any, ...]] = (64,)
    needs: ClassVar[str] = "a lobe and an incidence with a closed form (Phong: any; other lobes: cos_theta = 1)"

    def __init__(self, roundings: int = 64):
        self.roundings = int(roundings)

    def applies(self, core: Any, cos_theta: Any) -> bool:
        if isinstance(core, (Phong, Lambert)):
            return True
        normal = cos_theta is not None and (isinstance(cos_theta, Tracer) or bool(np.all(np.asarray(cos_theta) == 1)))
        return normal and exact_factor(core) is not None

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any = None) -> Raw:
        status = jnp.asarray(OK)
        if isinstance(core, Lambert):
            value = core.reflectance * jnp.ones_like(mu)
        elif isinstance(core, Phong):
            value = phong_albedo(core.n, mu)
        else:
            factor = exact_factor(core)
            assert factor is not None
            normal = mu == 1
            # The square root is 0, and its derivative infinite: that of the albedo is not known, and must not look like 0.
            value = jnp.where(normal, 1 / factor(core.n), jnp.nan) + 0 * jnp.sqrt(1 - mu)
            status = jnp.where(normal, OK, NOT_KNOWN)
        return Raw(value, self.roundings * jnp.finfo(mu.dtype).eps * jnp.abs(value), 0, status)
