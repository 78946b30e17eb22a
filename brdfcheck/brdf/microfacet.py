"""Lobes made of facets: distribution D, masking G, Fresnel F about the half vector.

``f = F D G / (4 (N.L)(N.V))`` with D normalised so that the facets' projected area is 1. `CookTorrance` also offers the
form in which it was published, ``F D' G / (pi (N.L)(N.V))`` with D' = pi D, which is four times as large.

The masking terms are written as G / ((N.L)(N.V)) with the cosines cancelled, so nothing is 0/0 at grazing angles.
"""

from __future__ import annotations

import abc
from typing import ClassVar, Literal, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.scipy.special import erf
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.brdf.base import AbstractMicrofacetLobe, checked_number
from brdfcheck.messages import one_of

Masking = Literal["v-cavities", "smith-separable", "smith-correlated", "none"]
MASKINGS: tuple[Masking, ...] = ("v-cavities", "smith-separable", "smith-correlated", "none")
Convention = Literal["correct", "published"]
CONVENTIONS: tuple[Convention, ...] = ("correct", "published")

# exp(-40) = 4e-18 of the distribution's peak.
_NEGLIGIBLE = 40.0
# Kept off exact zeros; its square is a normal float32 number.
_TINY = 1e-18


def fresnel_dielectric(cosine: Float[Array, "..."], f0: Float[Array, "..."]) -> Float[Array, "..."]:
    r"""Unpolarised Fresnel reflectance, with eta from the reflectance `f0` at normal incidence; exactly 1 for f0 = 1.

    $F = \frac12 \left(\frac{g-c}{g+c}\right)^2 \left\{1 + \left[\frac{c(g+c)-1}{c(g-c)+1}\right]^2\right\}$ with
    $g^2 = \eta^2 + c^2 - 1$, $\eta = (1+\sqrt{F_0})/(1-\sqrt{F_0})$ (Cook & Torrance 1982). Shapes broadcast.
    """
    # With r = sqrt(F0) and everything times 1 - r nothing is a difference of large or of nearly equal numbers, and r = 1 is no
    # pole: u = (1 - r)(g + c), and g - c = 4 r / ((1 - r) u), so that the first quotient is 4 r / u and its square 16 F0 / u^2.
    # F0 itself stands there, not the square of its root: so the derivative at F0 = 0 is the limit.
    root = geometry.safe_root(f0)
    missing = (1 - f0) / (1 + root)  # 1 - r, with its digits
    near = missing * cosine
    g = jnp.sqrt(jnp.maximum(near * near + 4 * root, _TINY * _TINY))
    u = g + near
    # Kept off 0, where F0 and c are both all but 0: the derivative of a quotient squares its denominator.
    smallest = float(jnp.finfo(u.dtype).tiny)
    share = 4 / jnp.maximum(u * u, smallest**0.4)
    # 1 for a mirror at 90 degrees, where both parts are 0.
    along = (u * (cosine * u - missing) + smallest**0.5) / (4 * root * cosine + missing * u + smallest**0.5)
    return f0 * share * share * (1 + along**2) / 2


def fresnel_schlick(cosine: Float[Array, "..."], f0: Float[Array, "..."]) -> Float[Array, "..."]:
    r"""$F_0 + (1 - F_0)(1 - \cos)^5$ (Schlick 1994). Shapes broadcast."""
    return f0 + (1 - f0) * (1 - cosine) ** 5


def boundary_reflectance(cosine: Float[Array, "..."], index: Float[Array, "..."]) -> Float[Array, "..."]:
    """Unpolarised reflectance of a smooth boundary at the cosine on the near side; 1 past total internal reflection.

    `index`: of the far side over that of the near side, > 0. Shapes broadcast.
    """
    square = 1 - (1 - cosine * cosine) / (index * index)
    passes = square > 0
    behind = jnp.sqrt(jnp.where(passes, square, 1))
    # The same from both sides: a function of the cosine on the thinner one, which is the smaller.
    share = fresnel_dielectric(jnp.minimum(cosine, behind), ((index - 1) / (index + 1)) ** 2)
    return jnp.where(passes, share, 1)


FRESNELS = {"dielectric": fresnel_dielectric, "schlick": fresnel_schlick}


def _reflects_at_most_all(f0: object, weights: object) -> bool:
    """True where reflectances lie in [0, 1] and weights add up to 1 at most, as far as known: what is traced is not."""
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((f0, weights))):
        return False
    reflectances, shares = np.asarray(0.0 if f0 is None else f0), np.asarray(weights)
    rounding = 4 * np.finfo(float).eps
    return bool(np.all((reflectances >= 0) & (reflectances <= 1)) and np.all(shares >= 0) and np.sum(shares) <= 1 + rounding)


class _FacetLobe(AbstractMicrofacetLobe):
    """What lobes share whose distribution has slopes of one shape: kernels, masking, kinks."""

    f0: Float[Array, "..."] | None
    masking: str = eqx.field(static=True)
    fresnel: str = eqx.field(static=True)
    passive: bool = eqx.field(static=True)

    def _settle(self, f0: object, masking: str, fresnel: str, weights: object = 1.0) -> None:
        """The fields that all have, checked."""
        self.f0 = None if f0 is None else checked_number(f0, "f0", high=1)
        self.passive = _reflects_at_most_all(f0, weights)
        self.masking, self.fresnel = one_of(masking, MASKINGS, "masking"), one_of(fresnel, FRESNELS, "fresnel")

    @property
    def bounded(self) -> bool:
        r"""True in the correct convention, with masking, Fresnel terms and weights known to be at most 1.

        Theorem: then $E(\omega_i) \le 1$. What is seen of the facets covers the surface exactly,
        $\int G_1(\omega_i) D(h) (\omega_i \cdot h)^+ dh = N \cdot \omega_i$, with Smith's $G_1$ (which is made for it) and with
        that of V-cavities. With $d\omega_o = 4 (\omega_i \cdot h)\, dh$ the albedo is
        $\int F G D (\omega_i \cdot h)^+ dh / (N \cdot \omega_i)$ over those h that reflect above the horizon, and
        $G \le G_1(\omega_i)$, $F \le 1$ (Heitz 2014, Understanding the Masking-Shadowing Function).
        """
        leaves = self.f0, getattr(self, "weights", 1.0)
        abstract = any(isinstance(leaf, (Tracer, jax.ShapeDtypeStruct)) for leaf in jax.tree.leaves(leaves))
        # Of a lobe, which is a pytree, they may be others than it was made with.
        passive = self.passive and (abstract or _reflects_at_most_all(*leaves))
        return self.masking != "none" and self.scale() == 1 and passive

    @abc.abstractmethod
    def distribution(self, half_cosine: Float[Array, "..."], half_sine_squared: Float[Array, "..."]) -> Float[Array, "..."]:
        """D(h) in 1/sr, normalised to a projected area of 1 where the weights are."""

    @abc.abstractmethod
    def shadowing(self, cosine: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """Smith's (numerator, denominator) with G1 = cosine * numerator / denominator, finite down to cosine 0.

        The denominator is 1 + Lambda times the same positive quantity that scales the numerator.
        """

    def scale(self) -> float:
        """What the published convention multiplies the correct one by."""
        return 1.0

    def _masking_over_cosines(self, n_h: Array, mu_i: Array, mu_o: Array, i_h: Array) -> Array:
        """G / (mu_i mu_o), with the cosines cancelled."""
        if self.masking == "none":
            return 1 / (mu_i * mu_o)
        if self.masking == "v-cavities":
            # min{1, 2 (N.H) mu_o / i_h, 2 (N.H) mu_i / i_h}: the smaller cosine cancels, the larger one is divided by.
            smaller, larger = jnp.minimum(mu_i, mu_o), jnp.maximum(mu_i, mu_o)
            return jnp.minimum(i_h / smaller, 2 * n_h) / (jnp.maximum(i_h, _TINY) * larger)
        top_i, bottom_i = self.shadowing(mu_i)
        top_o, bottom_o = self.shadowing(mu_o)
        if self.masking == "smith-separable":
            return top_i / bottom_i * top_o / bottom_o
        # 1/G = 1 + Lambda_i + Lambda_o = 1/G1_i + 1/G1_o - 1, everything times mu_i mu_o top_i top_o.
        one, two = mu_i * top_i, mu_o * top_o
        return top_i * top_o / (bottom_i * two + bottom_o * one - one * two)

    def facet_kernel(self, n_h: Array, sine_squared: Array, mu_i: Array, mu_o: Array, i_h: Array) -> Array:
        if self.masking == "v-cavities":
            # G (wi.H) / mu_i = min{wi.H / mu_i, 2 (N.H) mu_o / mu_i, 2 (N.H)}: finite at grazing incidence.
            geometric = jnp.minimum(jnp.minimum(i_h, 2 * n_h * mu_o) / mu_i, 2 * n_h)
        elif self.masking == "none":
            geometric = i_h / mu_i
        else:
            geometric = self._masking_over_cosines(n_h, mu_i, mu_o, i_h) * mu_o * i_h
        return self._times_fresnel(self.scale() * self.distribution(n_h, sine_squared) * geometric, i_h)

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """The value of the BRDF in 1/sr, shape (...), or (..., channels) where f0 has channels."""
        wi, wo = jnp.asarray(wi), jnp.asarray(wo)
        versine = geometry.half_versine(wi, wo)
        n_h = 1 - versine
        i_h = geometry.half_cosine(wi, wo)
        mu_i, mu_o = jnp.maximum(wi[..., 2], _TINY), jnp.maximum(wo[..., 2], _TINY)
        masked = self._masking_over_cosines(n_h, mu_i, mu_o, i_h)
        density = self.scale() * self.distribution(n_h, versine * (2 - versine)) * masked / 4
        density = jnp.where(geometry.above_horizon(wi, wo), density, 0)
        return self._times_fresnel(density, i_h)

    def _times_fresnel(self, density: Array, i_h: Array) -> Array:
        if self.f0 is None:
            return density
        fresnel = FRESNELS[self.fresnel]
        return density[..., None] * fresnel(i_h[..., None], self.f0) if self.f0.ndim else density * fresnel(i_h, self.f0)

    def breaks(self, cos_theta: Float[Array, ""]) -> Float[Array, " breaks"]:
        support = self.support()[None]
        if self.masking != "v-cavities":
            return support
        # Where 2 (N.H)(N.V) = V.H, 2 (N.H)(N.L) = V.H or N.V = N.L pass through the plane of incidence; 45 degrees is
        # where the unmasked facets disappear.
        elevation = jnp.arcsin(jnp.minimum(cos_theta, 1 - float(jnp.finfo(cos_theta.dtype).eps)))
        angles = jnp.stack(
            [
                elevation / 3,
                elevation,
                jnp.full_like(elevation, np.pi / 4),
                (np.pi - elevation) / 3,
                np.pi / 2 - elevation,
            ]
        )
        versines = jnp.sort(2 * jnp.sin(angles / 2) ** 2)
        return jnp.concatenate([jnp.minimum(versines, support), support])

    def azimuth_breaks(self, half_cosine: Float[Array, " h"], cos_theta: Float[Array, ""]) -> Float[Array, "kinks h"]:
        if self.masking != "v-cavities":
            return jnp.zeros((0, *half_cosine.shape), half_cosine.dtype)
        # Facets within 45 degrees: unmasked between the two values. Steeper ones: both terms meet at N.V = N.L.
        flat = 2 * half_cosine**2 > 1
        both = cos_theta / half_cosine
        masked_light = jnp.where(flat, 2 * half_cosine * cos_theta, both)
        masked_view = jnp.where(flat, 2 * half_cosine * cos_theta / jnp.where(flat, 4 * half_cosine**2 - 1, 1), both)
        return jnp.stack([masked_light, masked_view])

    @abc.abstractmethod
    def support(self) -> Float[Array, ""]:
        """The versine 1 - N.H beyond which the distribution is below 1e-17 of its peak."""


@final
class CookTorrance(_FacetLobe):
    r"""Metal of Beckmann facets in V-cavities, with the exact Fresnel term (Cook & Torrance 1982).

    $D = \sum_j w_j \exp(-\tan^2 a / m_j^2) / (\pi m_j^2 \cos^4 a)$,
    $G = \min\{1, 2(N \cdot H)(N \cdot V)/(V \cdot H), 2(N \cdot H)(N \cdot L)/(V \cdot H)\}$.

    `m`: the slope, or several slopes of shape (k,) with `weights` of the same shape. `f0`: reflectance at normal
    incidence, a number or one number a channel; by default None, which is F = 1 and costs nothing.
    `convention="published"` is the printed form, D without
    its 1/pi over pi instead of 4: four times the correct one. `masking`: "v-cavities", "smith-separable",
    "smith-correlated" or "none". `fresnel`: "dielectric" (exact) or "schlick".

    Raises ValueError for m <= 0, f0 outside [0, 1], negative weights, unknown names, or Smith masking with several slopes.
    """

    m: Float[Array, "..."]
    weights: Float[Array, "..."]
    convention: str = eqx.field(static=True)

    def __init__(
        self,
        m: object,
        f0: object = None,
        *,
        weights: object = 1.0,
        convention: str = "correct",
        masking: str = "v-cavities",
        fresnel: str = "dielectric",
    ):
        self.m = checked_number(m, "m", above=True)
        self.weights = checked_number(weights, "weights")
        self._settle(f0, masking, fresnel, weights)
        if self.m.shape != self.weights.shape or self.m.ndim > 1:
            raise ValueError(
                f"m and weights must both be numbers or both have shape (k,); got {self.m.shape} and {self.weights.shape}"
            )
        self.convention = one_of(convention, CONVENTIONS, "convention")
        if self.m.ndim and self.masking.startswith("smith"):
            raise ValueError("Smith masking belongs to one slope; with several slopes use masking='v-cavities'")

    def scale(self) -> float:
        return 4.0 if self.convention == "published" else 1.0

    def distribution(self, half_cosine: Float[Array, "..."], half_sine_squared: Float[Array, "..."]) -> Float[Array, "..."]:
        square = jnp.maximum(half_cosine**2, float(jnp.finfo(half_cosine.dtype).tiny) ** 0.5)
        exponent = half_sine_squared / square
        # Divided twice: in float32 the square of a slope below 1e-19 is 0.
        exponent = (exponent if not self.m.ndim else exponent[..., None]) / self.m / self.m
        # Where the exponential is 0 in this precision anything harmless stands in for its argument and the cosine: the
        # derivative would be 0 over 0, the square of cos^4 being 0 too.
        seen = exponent < -float(np.log(jnp.finfo(exponent.dtype).tiny))
        slopes = self.weights * jnp.where(seen, jnp.exp(-jnp.where(seen, exponent, 1)), 0) / self.m / self.m
        if self.m.ndim:
            seen, slopes = jnp.any(seen, axis=-1), jnp.sum(slopes, axis=-1)
        return slopes / (np.pi * jnp.where(seen, square, 1) ** 2)

    def shadowing(self, cosine: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        # With a = cot(theta)/m: 1 + Lambda = (1 + erf a)/2 + exp(-a^2)/(2 a sqrt pi); both sides times 2 sqrt(pi) cos(theta),
        # so that nothing is large: the derivative of a quotient squares its denominator, which float32 must hold.
        # Kept off 0 with the slope in it: that of the sine alone would count for the steepest facets.
        spread = jnp.sqrt(jnp.maximum(self.m * self.m * (1 - cosine) * (1 + cosine), _TINY * _TINY))
        # Beyond 30 all is 1 or 0; squares, and with them derivatives, would overflow.
        a = jnp.minimum(cosine / spread, 30)
        root = float(np.sqrt(np.pi))
        return jnp.full_like(cosine, 2 * root), root * cosine * (1 + erf(a)) + spread * jnp.exp(-a * a)

    def width(self) -> Float[Array, ""]:
        return jnp.arctan(jnp.min(self.m))

    def support(self) -> Float[Array, ""]:
        # tan^2 = m^2 log(1/negligible); with c = cos: 1 - c = tan^2 c^2 / (1 + c).
        square = _NEGLIGIBLE * jnp.max(self.m) ** 2
        cosine = 1 / jnp.sqrt(1 + square)
        return square * cosine**2 / (1 + cosine)


@final
class GGX(_FacetLobe):
    r"""Facets with a long tail, $D = \alpha^2 / (\pi \cos^4 a\, (\alpha^2 + \tan^2 a)^2)$ (Trowbridge & Reitz 1975).

    `alpha`: roughness; `f0`, `masking`, `fresnel` as for `CookTorrance`. ValueError for alpha <= 0, f0 outside [0, 1] or
    unknown names.
    """

    alpha: Float[Array, ""]
    # The half-vector rule asks: derivatives at 90 degrees have no limit.
    long_tail: ClassVar[bool] = True

    def __init__(self, alpha: object, f0: object = None, *, masking: str = "smith-correlated", fresnel: str = "dielectric"):
        self.alpha = checked_number(alpha, "alpha", above=True)
        self._settle(f0, masking, fresnel)

    def distribution(self, half_cosine: Float[Array, "..."], half_sine_squared: Float[Array, "..."]) -> Float[Array, "..."]:
        # cos^2 (alpha^2 + tan^2) = alpha^2 cos^2 + sin^2, over alpha: no tangent, no fourth power of alpha.
        return 1 / (np.pi * (self.alpha * half_cosine**2 + half_sine_squared / self.alpha) ** 2)

    def shadowing(self, cosine: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        # 1 + Lambda = (1 + sqrt(1 + alpha^2 tan^2)) / 2; both sides times 2 cos.
        square = cosine**2
        return jnp.full_like(cosine, 2.0), cosine + jnp.sqrt(square + self.alpha**2 * (1 - square))

    def width(self) -> Float[Array, ""]:
        return jnp.arctan(self.alpha)

    def support(self) -> Float[Array, ""]:
        return jnp.ones_like(self.alpha)
