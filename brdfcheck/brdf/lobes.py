"""The power-like lobes of the literature, one final class each. Peak value 1; a factor makes a BRDF of it.

``c`` is the cosine of the lobe's angle ``a``: ``R.V`` in the mirror form (0 where c <= 0), ``N.H`` in the half form.
Every profile takes the versine ``1 - c``. Parameters are leaves of the module, so ``jax.vmap`` over a lobe with batched
leaves evaluates a batch of lobes, and no exponent ever causes a recompilation.
"""

from __future__ import annotations

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import FORMS, AbstractZonalLobe, Form, checked_number
from brdfcheck.brdf.factors import (
    AbstractFactor,
    BlinnPhongExact,
    KuijkBlakeExact,
    PhongExact,
    SchlickExact,
    TruncatedPowerExact,
)
from brdfcheck.messages import one_of

# exp(-40) = 4e-18: what lies beyond adds less than the rounding of the sum.
_NEGLIGIBLE = 40.0
_TINY = 1e-30
# Up to this power a truncated power is a product, which is cheaper than an exponential and loses fewer roundings than that.
_LARGEST_PRODUCT = 64
# Up to here all whole numbers are floating-point numbers.
_LARGEST_POWER = 2**53


def _angle(versine: Float[Array, "..."]) -> Float[Array, "..."]:
    # asin has no derivative at 0 under AD although everything built on it does: keep away from the exact zero.
    return 2 * jnp.arcsin(jnp.sqrt(jnp.clip(versine / 2, _TINY, 1)))


@final
class Lambert(AbstractZonalLobe):
    r"""Perfectly diffuse, $f = k_d / \pi$ (Lambert 1760). `reflectance`: a number, or one number for each channel.

    Raises ValueError where the reflectance is negative or not finite.
    """

    reflectance: Float[Array, "..."]
    form: Form = eqx.field(static=True, default="half")

    def __init__(self, reflectance: object = 1.0):
        self.reflectance = checked_number(reflectance, "reflectance")
        self.form = "half"

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        return jnp.ones_like(versine)

    def width(self) -> Float[Array, ""]:
        return jnp.full((), np.pi, self.reflectance.dtype)

    def breaks(self) -> Float[Array, " breaks"]:
        return jnp.ones(1, self.reflectance.dtype)

    @property
    def monotone(self) -> bool:
        return True

    def smoothness(self) -> float:
        return np.inf

    def amplitude(self) -> Float[Array, "..."]:
        return self.reflectance / np.pi


class _OfExponent(AbstractZonalLobe):
    """What the other lobes share: an exponent, the width of its power, a profile that nowhere rises."""

    n: Float[Array, ""]
    form: Form = eqx.field(static=True)

    def width(self) -> Float[Array, ""]:
        # cos^n ~ exp(-n a^2 / 2), and Schlick's pole lies at a = i sqrt(2/n): both have this width.
        return 1 / jnp.sqrt(self.n + 0.05)

    @property
    def monotone(self) -> bool:
        return True

    def smoothness(self) -> float:
        return np.inf


class _CosinePower(_OfExponent):
    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        # exp(n log(1 - v)) keeps its relative error at large n, where pow in float32 does not.
        inside = versine < 1
        power = jnp.exp(self.n * jnp.log1p(-jnp.where(inside, versine, 0)))
        return jnp.where(inside, power, jnp.where(self.n > 0, 0.0, 1.0))

    def breaks(self) -> Float[Array, " breaks"]:
        return -jnp.expm1(-_NEGLIGIBLE / jnp.maximum(self.n, 1e-2))[None]


@final
class Phong(_CosinePower):
    r"""Cosine power about the mirror direction, $(R \cdot V)^n$ (Phong 1975). ValueError for n < 0."""

    def __init__(self, n: object):
        self.n, self.form = checked_number(n, "n"), "mirror"

    def exact_factor(self) -> AbstractFactor:
        return PhongExact()


@final
class BlinnPhong(_CosinePower):
    r"""Cosine power of the half vector, $(N \cdot H)^n$ (Blinn 1977). ValueError for n < 0."""

    def __init__(self, n: object):
        self.n, self.form = checked_number(n, "n"), "half"

    def exact_factor(self) -> AbstractFactor:
        return BlinnPhongExact()


@final
class Schlick(_OfExponent):
    r"""Rational stand-in for the power, $c / (n - n c + c)$ (Schlick 1994). ValueError for n < 0 or an unknown form.

    Its tail falls like $1/(n a^2)$ only, so no factor of the form (n+A)/B holds its energy for all n.
    """

    def __init__(self, n: object, form: str = "mirror"):
        self.n, self.form = checked_number(n, "n"), one_of(form, FORMS, "form")

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        c = jnp.maximum(1 - versine, 0)  # a versine may exceed 1 by its rounding
        # At n = 0 and c = 0 the quotient is 0/0; the lobe is then 1 everywhere.
        denominator = self.n * versine + c
        return jnp.where(denominator > 0, c / jnp.where(denominator > 0, denominator, 1), 1)

    def exact_factor(self) -> AbstractFactor:
        return SchlickExact(self.form)

    def breaks(self) -> Float[Array, " breaks"]:
        return jnp.ones_like(self.n)[None]


@final
class KuijkBlake(_OfExponent):
    r"""Piecewise quadratic in the angle (Kuijk & Blake 1989); ValueError for n < 0 or an unknown form.

    $1 - a^2/(pq)$ for a < p, $(a-q)^2/(q(q-p))$ for p <= a < q, else 0, with
    $p = (n+5.6)/(n(0.09n+5.2))$ and $q = (n+65)/(5n+31.7)$ radians. q never falls below 0.2, so the fit to
    $c^n$ breaks down at large n.
    """

    def __init__(self, n: object, form: str = "mirror"):
        self.n, self.form = checked_number(n, "n"), one_of(form, FORMS, "form")

    def _reciprocal_p(self) -> Array:
        return self.n * (0.09 * self.n + 5.2) / (self.n + 5.6)

    def _q(self) -> Array:
        return (self.n + 65) / (5 * self.n + 31.7)

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        angle = _angle(versine)
        reciprocal_p, q = self._reciprocal_p(), self._q()
        near = 1 - angle * angle * reciprocal_p / q
        # (a-q)^2 / (q (q-p)) with numerator and denominator over p; q < p only where p > pi/2, so it is not used there.
        spread = q * reciprocal_p - 1
        far = (angle - q) ** 2 * reciprocal_p / (q * jnp.where(spread > 0, spread, 1))
        return jnp.where(angle * reciprocal_p < 1, near, jnp.where(angle < q, far, 0))

    def exact_factor(self) -> AbstractFactor:
        return KuijkBlakeExact(self.form)

    def width(self) -> Float[Array, ""]:
        return 1 / jnp.maximum(self._reciprocal_p(), 0.5)

    def breaks(self) -> Float[Array, " breaks"]:
        right = np.pi / 2
        p = jnp.minimum(1 / jnp.maximum(self._reciprocal_p(), 0.5), right)
        return 2 * jnp.sin(jnp.stack([p, jnp.clip(self._q(), p, right)]) / 2) ** 2

    def smoothness(self) -> float:
        return 0.0


class _TruncatedPower(_OfExponent):
    k: eqx.AbstractVar[int]
    clamped: eqx.AbstractVar[bool]

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        if self.k <= _LARGEST_PRODUCT:
            base = 1 - versine * self.n / self.k
            return jnp.maximum(base, 0) ** self.k if self.clamped else base**self.k
        # The rounding of the base would be raised to the k-th power.
        part = versine * (self.n / float(self.k))
        inside = part < 1
        return jnp.where(inside, jnp.exp(float(self.k) * jnp.log1p(-jnp.where(inside, part, 0))), 0)

    def exact_factor(self) -> AbstractFactor:
        return TruncatedPowerExact(self.k, self.form, self.clamped)

    def breaks(self) -> Float[Array, " breaks"]:
        if not self.clamped:
            # The rebound peaks at 90 degrees: a panel of its own from 45 degrees on.
            return jnp.asarray([1 - np.sqrt(0.5), 1.0], self.n.dtype)
        # A high power is below exp(-n v), that is negligible, long before its end.
        reach = float(self.k) if self.k <= _LARGEST_PRODUCT else _NEGLIGIBLE
        return jnp.minimum(reach / jnp.maximum(self.n, 0.5), 1)[None]

    @property
    def monotone(self) -> bool:
        return self.clamped

    def smoothness(self) -> float:
        return float(self.k) if self.clamped else 0.0  # the rebound needs a panel of its own


@final
class Lyon(_TruncatedPower):
    r"""Chord-length lobe, $\max(0, 1 - n\, D \cdot D / 2^{w+1})^{2^w}$ with D = R - V or N - H (Lyon 1993).

    $D \cdot D = 2(1-c)$, so w = 4 is the binomial power with k = 16. ValueError for n < 0, w not a positive integer, or
    an unknown form.
    """

    w: int = eqx.field(static=True)
    clamped: ClassVar[bool] = True

    def __init__(self, n: object, w: int = 2, form: str = "half"):
        if isinstance(w, bool) or not isinstance(w, (int, np.integer)) or not 1 <= w <= 16:
            raise ValueError(f"w must be an integer from 1 to 16; got {w!r}")
        self.n, self.form = checked_number(n, "n"), one_of(form, FORMS, "form")
        self.w = int(w)

    @property
    def k(self) -> int:
        return 2**self.w


@final
class BinomialPower(_TruncatedPower):
    r"""Binomial approximation of the power, $\max(0, 1 + (n/k)(c-1))^k$.

    $(1 + x/k)^k$ tends to $e^x$. Without the clamp (`clamped=False`, an exhibit of the proposal as it was printed) an
    even power rises again past its first zero at c = 1 - k/n. ValueError for n < 0, k not an even integer from 2 to 2^53 (to 64
    without the clamp: a higher power of its base would not keep the digits that the error bar promises), or an unknown form.
    """

    k: int = eqx.field(static=True)
    clamped: bool = eqx.field(static=True)

    def __init__(self, n: object, k: int = 16, form: str = "half", clamped: bool = True):
        if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or k <= 0 or k % 2:
            raise ValueError(f"k must be a positive even integer; got {k!r}")
        largest = _LARGEST_POWER if clamped else _LARGEST_PRODUCT
        if k > largest:
            raise ValueError(f"k must be at most {largest}{'' if clamped else ' without the clamp'}; got {k!r}")
        self.n, self.form = checked_number(n, "n"), one_of(form, FORMS, "form")
        self.k, self.clamped = int(k), bool(clamped)
