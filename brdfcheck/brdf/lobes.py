"""The power-like lobes of the literature, one final class each. Peak value 1; a factor makes a BRDF of it.

``c`` is the cosine of the lobe's angle ``a``: ``R.V`` in the mirror form (0 where c <= 0), ``N.H`` in the half form.
Every profile takes the versine ``1 - c``. Parameters are leaves of the module, so ``jax.vmap`` over a lobe with batched
leaves evaluates a batch of lobes, and no exponent ever causes a recompilation.
"""

from __future__ import annotations

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractZonalLobe, Form, as_parameter, checked_form
from brdfcheck.brdf.exact_factors import KuijkBlakeExact, SchlickExact, TruncatedPowerExact
from brdfcheck.brdf.factors import AbstractFactor, BlinnPhongExact, PhongExact

# exp(-40) = 4e-18: what lies beyond adds less than the rounding of the sum.
_NEGLIGIBLE = 40.0
_TINY = 1e-30
# Up to this power a truncated power is a product, which is cheaper than an exponential and loses fewer roundings than that.
_LARGEST_PRODUCT = 64
# Up to here all whole numbers are floating-point numbers.
_LARGEST_POWER = 2**53


def _checked_exponent(n: object, name: str = "n") -> Array:
    array = as_parameter(n, name)
    if not isinstance(array, Tracer):
        values = np.asarray(array)
        if not np.all(np.isfinite(values) & (values >= 0)):
            raise ValueError(f"{name} must be a finite number >= 0; got {n}")
    return array


def _angle(versine: Float[Array, "..."]) -> Float[Array, "..."]:
    # asin has no derivative at 0 under AD although everything built on it does: keep away from the exact zero.
    return 2 * jnp.arcsin(jnp.sqrt(jnp.clip(versine / 2, _TINY, 1)))


def _power_support(n: Array) -> Array:
    """The versine at which cos^n is negligible."""
    return -jnp.expm1(-_NEGLIGIBLE / jnp.maximum(n, 1e-2))[None]


def _power_width(n: Array) -> Array:
    # cos^n ~ exp(-n a^2 / 2), and Schlick's pole lies at a = i sqrt(2/n): both have this width.
    return 1 / jnp.sqrt(n + 0.05)


def _cosine_power(versine: Array, n: Array) -> Array:
    # exp(n log(1 - v)) keeps its relative error at large n, where pow in float32 does not.
    inside = versine < 1
    return jnp.where(inside, jnp.exp(n * jnp.log1p(-jnp.where(inside, versine, 0))), jnp.where(n > 0, 0.0, 1.0))


@final
class Lambert(AbstractZonalLobe):
    r"""Perfectly diffuse, $f = k_d / \pi$ (Lambert 1760). `reflectance`: a number, or one number for each channel.

    Raises ValueError where the reflectance is negative or not finite.
    """

    reflectance: Float[Array, "..."]
    form: Form = eqx.field(static=True, default="half")

    def __init__(self, reflectance: object = 1.0):
        self.reflectance = _checked_exponent(reflectance, "reflectance")
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


@final
class Phong(AbstractZonalLobe):
    r"""Cosine power about the mirror direction, $(R \cdot V)^n$ (Phong 1975). ValueError for n < 0."""

    n: Float[Array, ""]
    form: Form = eqx.field(static=True)

    def __init__(self, n: object):
        self.n = _checked_exponent(n)
        self.form = "mirror"

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        return _cosine_power(versine, self.n)

    def exact_factor(self) -> AbstractFactor:
        return PhongExact()

    def width(self) -> Float[Array, ""]:
        return _power_width(self.n)

    def breaks(self) -> Float[Array, " breaks"]:
        return _power_support(self.n)

    @property
    def monotone(self) -> bool:
        return True

    def smoothness(self) -> float:
        return np.inf


@final
class BlinnPhong(AbstractZonalLobe):
    r"""Cosine power of the half vector, $(N \cdot H)^n$ (Blinn 1977). ValueError for n < 0."""

    n: Float[Array, ""]
    form: Form = eqx.field(static=True)

    def __init__(self, n: object):
        self.n = _checked_exponent(n)
        self.form = "half"

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        return _cosine_power(versine, self.n)

    def exact_factor(self) -> AbstractFactor:
        return BlinnPhongExact()

    def width(self) -> Float[Array, ""]:
        return _power_width(self.n)

    def breaks(self) -> Float[Array, " breaks"]:
        return _power_support(self.n)

    @property
    def monotone(self) -> bool:
        return True

    def smoothness(self) -> float:
        return np.inf


@final
class Schlick(AbstractZonalLobe):
    r"""Rational stand-in for the power, $c / (n - n c + c)$ (Schlick 1994). ValueError for n < 0 or an unknown form.

    Its tail falls like $1/(n a^2)$ only, so no factor of the form (n+A)/B holds its energy for all n.
    """

    n: Float[Array, ""]
    form: Form = eqx.field(static=True)

    def __init__(self, n: object, form: str = "mirror"):
        self.n = _checked_exponent(n)
        self.form = checked_form(form)

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        c = jnp.maximum(1 - versine, 0)  # a versine may exceed 1 by its rounding
        # At n = 0 and c = 0 the quotient is 0/0; the lobe is then 1 everywhere.
        denominator = self.n * versine + c
        return jnp.where(denominator > 0, c / jnp.where(denominator > 0, denominator, 1), 1)

    def exact_factor(self) -> AbstractFactor:
        return SchlickExact(self.form)

    def width(self) -> Float[Array, ""]:
        return _power_width(self.n)

    def breaks(self) -> Float[Array, " breaks"]:
        return jnp.ones_like(self.n)[None]

    @property
    def monotone(self) -> bool:
        return True

    def smoothness(self) -> float:
        return np.inf


@final
class KuijkBlake(AbstractZonalLobe):
    r"""Piecewise quadratic in the angle (Kuijk & Blake 1989); ValueError for n < 0 or an unknown form.

    $1 - a^2/(pq)$ for a < p, $(a-q)^2/(q(q-p))$ for p <= a < q, else 0, with
    $p = (n+5.6)/(n(0.09n+5.2))$ and $q = (n+65)/(5n+31.7)$ radians. q never falls below 0.2, so the fit to
    $c^n$ breaks down at large n.
    """

    n: Float[Array, ""]
    form: Form = eqx.field(static=True)

    def __init__(self, n: object, form: str = "mirror"):
        self.n = _checked_exponent(n)
        self.form = checked_form(form)

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

    @property
    def monotone(self) -> bool:
        return True


def _truncated_power(versine: Array, n: Array, k: int, clamped: bool) -> Array:
    if k <= _LARGEST_PRODUCT:
        base = 1 - versine * n / k
        return jnp.maximum(base, 0) ** k if clamped else base**k
    # The rounding of the base would be raised to the k-th power.
    part = versine * (n / float(k))
    inside = part < 1
    return jnp.where(inside, jnp.exp(float(k) * jnp.log1p(-jnp.where(inside, part, 0))), 0)


def _truncated_support(n: Array, k: int) -> Array:
    # A high power is below exp(-n v), that is negligible, long before its end.
    reach = float(k) if k <= _LARGEST_PRODUCT else _NEGLIGIBLE
    return jnp.minimum(reach / jnp.maximum(n, 0.5), 1)[None]


@final
class Lyon(AbstractZonalLobe):
    r"""Chord-length lobe, $\max(0, 1 - n\, D \cdot D / 2^{w+1})^{2^w}$ with D = R - V or N - H (Lyon 1993).

    $D \cdot D = 2(1-c)$, so w = 4 is the binomial power with k = 16. ValueError for n < 0, w not a positive integer, or
    an unknown form.
    """

    n: Float[Array, ""]
    w: int = eqx.field(static=True)
    form: Form = eqx.field(static=True)

    def __init__(self, n: object, w: int = 2, form: str = "half"):
        if isinstance(w, bool) or not isinstance(w, (int, np.integer)) or not 1 <= w <= 16:
            raise ValueError(f"w must be an integer from 1 to 16; got {w!r}")
        self.n = _checked_exponent(n)
        self.w = int(w)
        self.form = checked_form(form)

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        return _truncated_power(versine, self.n, 2**self.w, clamped=True)

    def exact_factor(self) -> AbstractFactor:
        return TruncatedPowerExact(2**self.w, self.form)

    def width(self) -> Float[Array, ""]:
        return _power_width(self.n)

    def breaks(self) -> Float[Array, " breaks"]:
        return _truncated_support(self.n, 2**self.w)

    @property
    def monotone(self) -> bool:
        return True

    def smoothness(self) -> float:
        return float(2**self.w)


@final
class BinomialPower(AbstractZonalLobe):
    r"""Binomial approximation of the power, $\max(0, 1 + (n/k)(c-1))^k$.

    $(1 + x/k)^k$ tends to $e^x$. Without the clamp (`clamped=False`, an exhibit of the proposal as it was printed) an
    even power rises again past its first zero at c = 1 - k/n. ValueError for n < 0, k not an even integer from 2 to 2^53 (to 64
    without the clamp: a higher power of its base would not keep the digits that the error bar promises), or an unknown form.
    """

    n: Float[Array, ""]
    k: int = eqx.field(static=True)
    form: Form = eqx.field(static=True)
    clamped: bool = eqx.field(static=True)

    def __init__(self, n: object, k: int = 16, form: str = "half", clamped: bool = True):
        if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or k <= 0 or k % 2:
            raise ValueError(f"k must be a positive even integer; got {k!r}")
        largest = _LARGEST_POWER if clamped else _LARGEST_PRODUCT
        if k > largest:
            raise ValueError(f"k must be at most {largest}{'' if clamped else ' without the clamp'}; got {k!r}")
        self.n = _checked_exponent(n)
        self.k = int(k)
        self.form = checked_form(form)
        self.clamped = bool(clamped)

    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        return _truncated_power(versine, self.n, self.k, self.clamped)

    def exact_factor(self) -> AbstractFactor:
        return TruncatedPowerExact(self.k, self.form, self.clamped)

    def width(self) -> Float[Array, ""]:
        return _power_width(self.n)

    def breaks(self) -> Float[Array, " breaks"]:
        if not self.clamped:
            # The rebound peaks at 90 degrees: a panel of its own from 45 degrees on.
            return jnp.asarray([1 - np.sqrt(0.5), 1.0], self.n.dtype)
        return _truncated_support(self.n, self.k)

    @property
    def monotone(self) -> bool:
        return self.clamped

    def smoothness(self) -> float:
        return float(self.k) if self.clamped else 0.0  # the rebound needs a panel of its own
