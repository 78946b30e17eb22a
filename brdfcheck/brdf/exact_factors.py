r"""Factors that make the albedo at normal incidence exactly 1: the reciprocals of closed forms.

At normal incidence the albedo of a lobe g(c) is one elementary integral: $2\pi\int_0^1 g\,c\,dc$ in the mirror form,
$8\pi\int_{1/\sqrt2}^1 g\,(2c^3-c)\,dc$ in the half form. Rational, polynomial and trigonometric lobes have a closed form of it;
those of the cosine powers are in `factors`.
"""

from __future__ import annotations

import math
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import FORMS, AbstractZonalLobe, Form
from brdfcheck.brdf.factors import AbstractFactor
from brdfcheck.messages import one_of
from brdfcheck.numerics import gauss

# The versine (the cosine) at which the lobe meets the horizon.
_END = {"mirror": 1.0, "half": 1 - math.sqrt(0.5)}
# Between these exponents Schlick's antiderivative cancels, and its pole is so far away that 24 Gauss nodes give 1e-15.
_FAR_POLE = (0.25, 4.0)


def _weight(form: Form, versine: Any) -> Any:
    """What the profile is multiplied by under the integral over the versine, at normal incidence."""
    c = 1 - versine
    return 2 * np.pi * c if form == "mirror" else 8 * np.pi * c * (2 * c * c - 1)


@final
class TruncatedPowerExact(AbstractFactor):
    r"""For $\max(0, 1 - n(1-c)/k)^k$: the binomial power, and Lyon's lobe with k = 2^w.

    The integrand is a polynomial of degree k+1 (mirror) or k+3 (half) up to the first zero of the lobe, so a Gauss rule of
    that degree is a closed form. ValueError for an unknown form or k < 1.
    """

    k: int = eqx.field(static=True)
    form: Form = eqx.field(static=True)
    clamped: bool = eqx.field(static=True)

    def __init__(self, k: int, form: str = "half", clamped: bool = True):
        if k < 1:
            raise ValueError(f"k must be at least 1; got {k}")
        self.k, self.form, self.clamped = int(k), one_of(form, FORMS, "form"), bool(clamped)

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        n, end = jnp.asarray(n), _END[self.form]
        if self.clamped:
            end = jnp.minimum(end, self.k / jnp.maximum(n, self.k))
        total = jnp.zeros_like(n)
        for node, weight in zip(*gauss((self.k + 5) // 2), strict=True):
            versine = end * float(node)
            total = total + float(weight) * _weight(self.form, versine) * (1 - n * versine / self.k) ** self.k
        return 1 / (end * total)


@final
class SchlickExact(AbstractFactor):
    r"""For $c/(n - nc + c)$. With A = n/(n-1), mirror: $(n-1)/(2\pi(A^2\ln n - A - 1/2))$; half: by partial fractions.

    ValueError for an unknown form.
    """

    form: Form = eqx.field(static=True)

    def __init__(self, form: str = "mirror"):
        self.form = one_of(form, FORMS, "form")

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        n = jnp.asarray(n)
        low, high = _FAR_POLE
        if self.form == "half":  # starts at c = 1/sqrt 2: no pole comes near for small n
            low = 0.0
        by_nodes = (n >= low) & (n <= high)
        large = jnp.where(by_nodes, 2 * high, jnp.maximum(n, 1e-30))
        pole = large / (large - 1)
        if self.form == "mirror":
            closed = 2 * np.pi / (large - 1) * (pole**2 * jnp.log(large) - pole - 0.5)
        else:
            # p(c) = 2 c^4 - c^2 = p(A) - (A - c) (2 (A^3 + A^2 c + A c^2 + c^3) - (A + c)), integrated from 1/sqrt 2 to 1.
            start = math.sqrt(0.5)
            moments = [(1 - start**j) / j for j in range(1, 5)]  # of 1, c, c^2, c^3
            quotient = (
                (2 * pole**3 - pole) * moments[0] + (2 * pole**2 - 1) * moments[1] + 2 * pole * moments[2] + 2 * moments[3]
            )
            logarithm = jnp.log(jnp.abs((pole - start) * (large - 1)))  # A - 1 = 1/(n-1)
            closed = 8 * np.pi / (large - 1) * ((2 * pole**4 - pole**2) * logarithm - quotient)
        small, end, near = jnp.where(by_nodes, n, high), _END[self.form], jnp.zeros_like(n)
        for node, weight in zip(*gauss(24), strict=True):
            versine = end * float(node)
            near = near + end * float(weight) * _weight(self.form, versine) * (1 - versine) / (small * versine + 1 - versine)
        return 1 / jnp.where(by_nodes, near, closed)


@final
class KuijkBlakeExact(AbstractFactor):
    r"""For Kuijk and Blake's piecewise quadratic in the angle a.

    The albedo is $\pi\int g \sin 2a\,da$ in the mirror form and $2\pi\int g \sin 4a\,da$ in the half form. Over at most half a
    wave, 12 Gauss nodes give each piece to rounding, where the antiderivatives cancel.

    ValueError for an unknown form.
    """

    form: Form = eqx.field(static=True)

    def __init__(self, form: str = "mirror"):
        self.form = one_of(form, FORMS, "form")

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        n = jnp.asarray(n)
        wave = 2.0 if self.form == "mirror" else 4.0
        p = (n + 5.6) / (jnp.maximum(n, 1e-14) * (0.09 * n + 5.2))
        q = (n + 65) / (5 * n + 31.7)
        near_end = jnp.minimum(p, np.pi / wave)
        far_end = jnp.clip(q, near_end, np.pi / wave)
        # Where p lies beyond q there is no second piece; the safe value keeps its gradient finite.
        spread = jnp.where(q > p, q * (q - p), 1)
        near, far = jnp.zeros_like(n), jnp.zeros_like(n)
        for node, weight in zip(*gauss(12), strict=True):
            a = near_end * float(node)
            near = near + float(weight) * (1 - a * a / (p * q)) * jnp.sin(wave * a)
            b = near_end + (far_end - near_end) * float(node)
            far = far + float(weight) * (q - b) ** 2 / spread * jnp.sin(wave * b)
        return 1 / (wave / 2 * np.pi * (near_end * near + (far_end - near_end) * far))


def exact_factor(lobe: object) -> AbstractFactor | None:
    """The factor in closed form with which `lobe` reflects exactly 1 at normal incidence; None where there is none."""
    return lobe.exact_factor() if isinstance(lobe, AbstractZonalLobe) else None
