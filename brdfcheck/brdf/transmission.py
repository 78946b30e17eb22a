r"""Surfaces that let light through: matte sheets, clear panes, boundaries of two media, smooth and rough.

All are BSDFs in the scale of flux, f(wi, wo) as Walter et al. (2007) print it: wi towards the light. For light from one side
`lit` gives a BRDF with the same energy, R + T, which every engine takes. Energy:

* rough boundary: with $F + (1 - F) = 1$ and a masking G that is at most Smith's $G_1(\omega_i)$,
  $R + T \le \int G_1(\omega_i) D(h) (\omega_i \cdot h)^+ dh / (N \cdot \omega_i) = 1$ for every roughness and index, from both
  sides: what is seen of the facets covers the surface exactly, whatever each of them does with its light;
* smooth boundary: $R = F$, $T = 1 - F$;
* clear pane, with the share a that one crossing leaves: $R = F + (1-F)^2 F a^2 / (1 - F^2 a^2)$,
  $T = (1-F)^2 a / (1 - F^2 a^2)$, so that $R + T = F + (1-F)^2 a / (1 - F a) \le 1$.

These last two are deltas, which have no value f; `weights` has their R and T.
"""

from __future__ import annotations

import abc
from typing import Any, ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.brdf.base import (
    PARTS,
    AbstractBRDF,
    AbstractBSDF,
    AbstractHalves,
    AbstractMicrofacetLobe,
    Part,
    Scale,
    checked_number,
)
from brdfcheck.brdf.lobes import Lambert
from brdfcheck.brdf.microfacet import GGX, CookTorrance, boundary_reflectance
from brdfcheck.messages import one_of

DISTRIBUTIONS = ("beckmann", "ggx")
_TINY = 1e-18


def _checked_index(value: object, name: str = "eta") -> Array:
    array = checked_number(value, name, above=True)
    if not isinstance(array, Tracer) and np.any(np.asarray(array) == 1):
        raise ValueError(f"{name} must not be 1: there is no boundary between equal media; got {value}")
    return array


def _seen_from(eta: Any, below: Any) -> Any:
    """The index on the far side over that on the side of the light."""
    return jnp.where(jnp.asarray(below, float) < 0.5, eta, 1 / eta)


def _refracted_cosine(cosine: Array, ratio: Array) -> tuple[Array, Array]:
    """The cosine behind a boundary, and whether light passes; `ratio`: the index of the far side over that of the near one."""
    square = 1 - (1 - cosine) * (1 + cosine) / (ratio * ratio)
    passes = square > 0
    return jnp.where(passes, jnp.sqrt(jnp.where(passes, square, 1)), 0), passes


# --- matte ---


@final
class LambertTransmission(AbstractBSDF):
    r"""A sheet that is matte on both sides: $f = R/\pi$ where light is reflected, $T/\pi$ where it is transmitted.

    `reflectance`, `transmittance`: numbers, or one for each channel. ValueError where one is negative or not finite.
    """

    reflectance: Float[Array, "..."]
    transmittance: Float[Array, "..."]
    eta: ClassVar[float] = 1.0
    scale: ClassVar[Scale] = "flux"

    def __init__(self, reflectance: object = 0.5, transmittance: object = 0.5):
        self.reflectance = checked_number(reflectance, "reflectance")
        self.transmittance = checked_number(transmittance, "transmittance")

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        through = jnp.asarray(wi)[..., 2] * jnp.asarray(wo)[..., 2] < 0
        through = through[..., None] if self.reflectance.ndim or self.transmittance.ndim else through
        return jnp.where(through, self.transmittance, self.reflectance) / np.pi

    def lit(self, below: Any = 0.0, part: str = "both") -> AbstractBRDF:
        parts = {
            "both": self.reflectance + self.transmittance,
            "reflected": self.reflectance,
            "transmitted": self.transmittance,
        }
        return Lambert(parts[one_of(part, PARTS, "part")])


# --- deltas ---


class _Lit(AbstractBRDF):
    """A `part` of what a surface sends out of light from one side.

    `folded`: it has the energy of what transmits, lit from wi, and owes no reciprocity.
    """

    surface: Any
    below: Float[Array, ""]
    part: Part = eqx.field(static=True)
    folded: ClassVar[bool] = True

    @property
    def bounded(self) -> bool:
        """True for every surface here: the theorems at the head of `brdfcheck.brdf.transmission`."""
        return True


@final
class Spread(_Lit):
    """What a smooth surface sends out of light from one side, as a matte reflection of the same albedo at each incidence."""

    @property
    def core(self) -> Any:
        return Lambert(jnp.ones_like(self.below))

    def gain(self, cos_theta: Any) -> Any:
        reflected, passing = self.surface.weights(jnp.asarray(cos_theta), self.below)
        return {"both": reflected + passing, "reflected": reflected, "transmitted": passing}[self.part]

    def with_core(self, core: AbstractBRDF) -> AbstractBRDF:
        return self

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        wi = jnp.asarray(wi)
        return self.core(wi, wo) * self.gain(jnp.clip(wi[..., 2], 0, 1))


class AbstractSmooth(AbstractBSDF):
    """A surface of which the light leaves in two directions: the mirror's, and one on the other side."""

    @abc.abstractmethod
    def weights(self, cosine: Float[Array, "..."], below: Any = 0.0) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """R and T at cosines of incidence in [0, 1], for light from above (`below` 0) or from below (1)."""

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """0: everything is in the two deltas."""
        return jnp.zeros(jnp.broadcast_shapes(jnp.shape(wi), jnp.shape(wo))[:-1], jnp.asarray(wi).dtype)

    def lit(self, below: Any = 0.0, part: str = "both") -> AbstractBRDF:
        return Spread(self, jnp.asarray(below, float), one_of(part, PARTS, "part"))


@final
class SmoothDielectric(AbstractSmooth):
    """A smooth boundary with the unpolarised Fresnel reflectance and total reflection; `eta`: index below over index above.

    ValueError for eta that is not finite and > 0, or 1.
    """

    eta: Float[Array, ""]
    scale: ClassVar[Scale] = "flux"

    def __init__(self, eta: object = 1.5):
        self.eta = _checked_index(eta)

    def weights(self, cosine: Float[Array, "..."], below: Any = 0.0) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        share = boundary_reflectance(cosine, _seen_from(self.eta, below))
        return share, 1 - share


@final
class ThinSheet(AbstractSmooth):
    """A clear pane of parallel faces with the same medium on both sides; all reflections between the faces are added.

    `index`: that of the pane over that of its surroundings; `transmittance`: the share that a crossing along the normal leaves
    (Bouguer: its logarithm grows with the path). ValueError for an index that is not finite and > 0, or 1, and a transmittance
    outside [0, 1].
    """

    index: Float[Array, ""]
    transmittance: Float[Array, ""]
    eta: ClassVar[float] = 1.0
    scale: ClassVar[Scale] = "flux"

    def __init__(self, index: object = 1.5, transmittance: object = 1.0):
        self.index = _checked_index(index, "index")
        self.transmittance = checked_number(transmittance, "transmittance", high=1)

    def weights(self, cosine: Float[Array, "..."], below: Any = 0.0) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        share = boundary_reflectance(cosine, self.index)
        inner, passes = _refracted_cosine(cosine, self.index)
        # 0 ** x has no derivative in x at 0.
        clear = jnp.maximum(self.transmittance, _TINY) ** (1 / jnp.where(passes, inner, 1))
        left = jnp.where(passes & (self.transmittance > 0), clear, 0)
        # (1 - F)^2 / (1 - F^2 a^2), where F = 1 at grazing incidence: the limit is 0.
        denominator = 1 - (share * left) ** 2
        through = jnp.where(denominator > 0, (1 - share) ** 2 / jnp.where(denominator > 0, denominator, 1), 0)
        return share + through * share * left**2, through * left


# --- rough boundaries ---


@final
class RoughDielectric(AbstractBSDF):
    r"""A boundary of facets that reflect and refract (Walter et al. 2007), Smith's separable masking.

    $f_r = F D G / (4 |N \cdot w_i| |N \cdot w_o|)$ and
    $f_t = \frac{|w_i \cdot h_t| |w_o \cdot h_t|}{|N \cdot w_i| |N \cdot w_o|}
    \frac{\eta_o^2 (1 - F) D G}{(\eta_i (w_i \cdot h_t) + \eta_o (w_o \cdot h_t))^2}$, with
    $h_t$ along $-(\eta_i w_i + \eta_o w_o)$ and F the unpolarised reflectance of a smooth boundary. `alpha`: roughness;
    `eta`: index below over index above; `distribution`: "ggx" or "beckmann".
    ValueError for alpha <= 0, eta that is not finite and > 0, or 1, or an unknown name.
    """

    alpha: Float[Array, ""]
    eta: Float[Array, ""]
    distribution: str = eqx.field(static=True)
    scale: ClassVar[Scale] = "flux"

    def __init__(self, alpha: object, eta: object = 1.5, distribution: str = "ggx"):
        self.alpha = checked_number(alpha, "alpha", above=True)
        self.eta = _checked_index(eta)
        self.distribution = one_of(distribution, DISTRIBUTIONS, "distribution")

    @property
    def facets(self) -> GGX | CookTorrance:
        """Their distribution and masking."""
        kind = GGX if self.distribution == "ggx" else CookTorrance
        return kind(self.alpha, masking="smith-separable")

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        wi, wo = jnp.asarray(wi), jnp.asarray(wo)
        # Everything is seen from the side of the light.
        down, up = jnp.array([1, 1, -1], wi.dtype), jnp.array([0, 0, 1], wi.dtype)
        side = jnp.where(wi[..., 2:] < 0, down, down * down)
        light, view = wi * side, wo * side
        ratio = _seen_from(self.eta, wi[..., 2] < 0)
        through = view[..., 2] < 0
        seen = jnp.where(through[..., None], up, view)
        mirror = self.facets(light, seen) * boundary_reflectance(geometry.half_cosine(light, seen), ratio)
        return jnp.where(through, self._refracted(light, jnp.where(through[..., None], view, -light), ratio), mirror)

    def _refracted(self, light: Array, view: Array, ratio: Array) -> Array:
        total = light + ratio[..., None] * view
        total = jnp.where(total[..., 2:] < 0, -total, total)  # h_t is the side of it that is up
        square = jnp.sum(total * total, axis=-1)
        h = total / jnp.sqrt(jnp.where(square > 0, square, 1))[..., None]
        c, behind = jnp.sum(light * h, axis=-1), -jnp.sum(view * h, axis=-1)
        mu, mu_o = jnp.maximum(light[..., 2], _TINY), jnp.maximum(-view[..., 2], _TINY)
        top, bottom = self.facets.shadowing(mu)
        top_o, bottom_o = self.facets.shadowing(mu_o)
        versine = (h[..., 0] ** 2 + h[..., 1] ** 2) / (1 + h[..., 2])
        density = self.facets.distribution(h[..., 2], versine * (2 - versine)) * (top / bottom) * (top_o / bottom_o)
        met = (c > 0) & (behind > 0) & (square > 0)  # both see the facet from its two sides
        # eta_i (wi.h) + eta_o (wo.h) is the length of the sum, without its sign.
        value = density * c * behind * ratio**2 / jnp.where(met, square, 1)
        return jnp.where(met, value * (1 - boundary_reflectance(jnp.clip(c, 0, 1), ratio)), 0)

    def lit(self, below: Any = 0.0, part: str = "both") -> LitFacets:
        return LitFacets(self, jnp.asarray(below, float), one_of(part, PARTS, "part"))


@final
class LitFacets(_Lit, AbstractHalves):
    """A rough boundary lit from one side: what it reflects, and at the mirror image of its direction what it transmits."""

    def halves(self) -> tuple[AbstractMicrofacetLobe, ...]:
        facets, ratio = self.surface.facets, _seen_from(self.surface.eta, self.below)
        reflected, refracted = _Reflecting(facets, ratio), _Refracting(facets, ratio)
        return {"both": (reflected, refracted), "reflected": (reflected,), "transmitted": (refracted,)}[self.part]

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        wi, wo = jnp.asarray(wi), jnp.asarray(wo)
        down = jnp.array([1, 1, -1], wi.dtype)
        side = jnp.where(self.below < 0.5, jnp.ones_like(down), down)
        value = 0.0
        if self.part != "transmitted":
            value = self.surface(wi * side, wo * side)
        if self.part != "reflected":
            value = value + self.surface(wi * side, wo * side * down)
        return jnp.where(geometry.above_horizon(wi, wo), value, 0)


class _FacetsOfBoundary(AbstractMicrofacetLobe):
    """Facets seen from the side of the light; `ratio`: the index on the far side over that on the near one."""

    facets: Any
    ratio: Array

    rooted: ClassVar[bool] = True
    # Derivatives at 90 degrees have no limit, as for a long tail.
    long_tail: ClassVar[bool] = True

    def width(self) -> Float[Array, ""]:
        return self.facets.width()

    def breaks(self, cos_theta: Float[Array, ""]) -> Float[Array, " breaks"]:
        support = self.facets.support()[None]
        angles = self.critical_angles(cos_theta)
        # Panels that total reflection does not need cut the distribution evenly.
        even = support * (jnp.arange(1, angles.size + 1, dtype=support.dtype) / (angles.size + 1)) ** 2
        versines = jnp.where(self.ratio < 1, 2 * jnp.sin(jnp.clip(angles, 0, np.pi / 2) / 2) ** 2, even)
        return jnp.concatenate([jnp.sort(jnp.minimum(jnp.concatenate([versines, 0.16 * support]), support)), support])

    def critical_cosine(self) -> Array:
        """wi.H at which total reflection begins; 0 where there is none."""
        square = (1 - self.ratio) * (1 + self.ratio)
        return geometry.safe_root(square)

    @abc.abstractmethod
    def critical_angles(self, cos_theta: Array) -> Array:
        """The angles of H from N (radians) at which circles of H touch the edges of `azimuth_breaks`, or these meet."""


@final
class _Reflecting(_FacetsOfBoundary):
    """What the facets reflect: all of it past the critical angle."""

    def facet_kernel(self, *cosines: Array) -> Array:
        return self.facets.facet_kernel(*cosines) * boundary_reflectance(cosines[-1], self.ratio)

    def azimuth_breaks(self, half_cosine: Float[Array, " h"], cos_theta: Float[Array, ""]) -> Float[Array, "kinks h"]:
        return jnp.broadcast_to(self.critical_cosine(), half_cosine.shape)[None]

    def critical_angles(self, cos_theta: Array) -> Array:
        theta, edge = _angle(cos_theta), _angle(self.critical_cosine())
        meets_horizon = _angle(cos_theta / jnp.maximum(2 * self.critical_cosine(), _TINY))
        return jnp.stack([jnp.abs(theta - edge), theta + edge, meets_horizon])

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        return self.facets(wi, wo) * boundary_reflectance(geometry.half_cosine(wi, wo), self.ratio)


@final
class _Refracting(_FacetsOfBoundary):
    """What the facets let through: nothing past the critical angle, nor what they would refract to above the horizon."""

    refracts: ClassVar[bool] = True

    def facet_kernel(self, n_h: Array, sine_squared: Array, mu_i: Array, mu_o: Array, i_h: Array) -> Array:
        behind, passes = _refracted_cosine(i_h, self.ratio)
        # Snell's law: wo = -wi / ratio + (c / ratio - behind) h.
        mu_o = (mu_i - i_h * n_h) / self.ratio + behind * n_h
        seen = passes & (mu_o > 0)
        mu_o = jnp.where(seen, mu_o, 1)
        top, bottom = self.facets.shadowing(mu_i)
        top_o, bottom_o = self.facets.shadowing(jnp.minimum(mu_o, 1))
        masked = (top / bottom) * (mu_o * top_o / bottom_o)
        value = self.facets.distribution(n_h, sine_squared) * masked * i_h
        return jnp.where(seen, value * (1 - boundary_reflectance(i_h, self.ratio)), 0)

    def azimuth_breaks(self, half_cosine: Float[Array, " h"], cos_theta: Float[Array, ""]) -> Float[Array, "kinks h"]:
        # Refracted along the horizon: c = (k^2 + 1 - ratio^2) / (2 k) with k = N.wi / N.H, as long as k^2 < 1 - ratio^2.
        edge = self.critical_cosine()
        k = cos_theta / jnp.maximum(half_cosine, _TINY)
        low = k < edge
        horizon = (k * k + edge * edge) / (2 * jnp.where(low, jnp.maximum(k, _TINY), 1))
        return jnp.where(low, horizon, edge)[None]

    def critical_angles(self, cos_theta: Array) -> Array:
        theta, edge = _angle(cos_theta), _angle(self.critical_cosine())
        sine, mu = jnp.sin(theta), jnp.maximum(cos_theta, _TINY)
        # In the plane of incidence h lies along wi + ratio wo with wo along the horizon.
        along = [jnp.arctan2(jnp.abs(sine + way * self.ratio), mu) for way in (-1, 1)]
        meet = _angle(mu / jnp.maximum(self.critical_cosine(), _TINY))
        return jnp.stack([jnp.abs(theta - edge), theta + edge, *along, meet])

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        surface = RoughDielectric(
            self.facets.alpha if isinstance(self.facets, GGX) else self.facets.m,
            self.ratio,
            "ggx" if isinstance(self.facets, GGX) else "beckmann",
        )
        return LitFacets(surface, jnp.zeros_like(self.ratio), "transmitted")(wi, wo)


def _angle(cosine: Array) -> Array:
    """The arc cosine with a finite derivative; 0 for cosines above 1."""
    inside = cosine < 1
    return jnp.where(inside, jnp.arccos(jnp.where(inside, jnp.maximum(cosine, 0), 0)), 0)
