"""What a BRDF offers to an integrator. The abstract classes; their final ones are in `lobes`, `microfacet` and `transmission`.

Three levels, from the least to the most that is known about a BRDF:

* `AbstractBRDF`: it can be called, ``f(wi, wo)`` in 1/sr.
* `AbstractMicrofacetLobe`: it is a product of terms around the half vector, D(h) G F.
* `AbstractZonalLobe`: it depends on one angle only, to the mirror direction or between normal and half vector.

A surface that lets light through is an `AbstractBSDF`, on the whole sphere; lit from one side it is a BRDF that reflects what
the surface sends to both.

A lobe says where it lives (its width, its support, the angles at which its formula changes). It knows no quadrature.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any, ClassVar, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck import geometry

Form = Literal["mirror", "half"]
FORMS: tuple[Form, ...] = ("mirror", "half")
Part = Literal["both", "reflected", "transmitted"]
PARTS: tuple[Part, ...] = get_args(Part)
Scale = Literal["flux", "radiance"]
SCALES: tuple[Scale, ...] = get_args(Scale)


def as_parameter(value: object, name: str = "a parameter") -> Array:
    """`value` as a floating-point array leaf: a traced value stays as it is, a number takes JAX's default precision.

    TypeError, with `name` in the message, for whatever is not made of real numbers: complex numbers, truth values, text, times,
    None. None of them is converted: a lost imaginary part would be a wrong answer.
    """
    wrong = f"{name} must be a real number, or an array of real numbers; got {value!r}"
    if any(isinstance(leaf, (bool, np.bool_)) for leaf in jax.tree.leaves(value)):
        raise TypeError(wrong)
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError) as error:  # of what no JAX array can be made
        raise TypeError(wrong) from error
    if jnp.issubdtype(array.dtype, jnp.floating):
        return array
    if not jnp.issubdtype(array.dtype, jnp.integer):
        raise TypeError(wrong)
    return array.astype(float)


def checked_number(value: object, name: str, low: float = 0.0, high: float = np.inf, *, above: bool = False) -> Array:
    """`as_parameter`; ValueError where it is not finite, outside of [`low`, `high`], or, with `above`, `low` itself."""
    array = as_parameter(value, name)
    if not isinstance(array, Tracer):
        values = np.asarray(array)
        good = np.isfinite(values) & (values <= high) & ((values > low) if above else (values >= low))
        if values.size == 0 or not np.all(good):
            bounds = f"{'>' if above else '>='} {low:g}{'' if high == np.inf else f' and <= {high:g}'}"
            raise ValueError(f"{name} must be finite and {bounds}; got {value}")
    return array


def of_type(tree: Any, dtype: Any) -> Any:
    """A BRDF, or what else holds arrays, with its floating-point numbers in the type `dtype`: all is in one precision then."""
    return jax.tree.map(lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf, tree)


def structure_of(build: Callable[..., Any], /, *numbers: Any, **parameters: Any) -> Any:
    """What a factory builds, with shapes in place of numbers; None where it needs numbers, or fails."""
    try:
        return eqx.filter_eval_shape(build, *numbers, **parameters)
    except Exception:  # whatever it does with numbers that tracers are not
        return None


class _Whole(eqx.Module):
    """What has a lobe inside, or is one. What wraps another BRDF (a factor) answers for itself: nobody takes it apart."""

    @property
    def core(self) -> Any:
        """The lobe that is integrated, which holds the parameters: this one, or what is inside where a factor is around it."""
        return self

    def with_core(self, core: Any) -> Any:
        """The same with another lobe inside."""
        return core


class AbstractBRDF(_Whole):
    """A BRDF f(wi, wo) in 1/sr, for unit vectors of shape (..., 3) with N = +z. Returns shape (...), or (..., channels)."""

    @abc.abstractmethod
    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """The value of the BRDF in 1/sr; 0 where a direction lies below the surface."""

    def gain(self, cos_theta: Any) -> Any:
        """What the albedo of the core is multiplied by at cosines of incidence, in numpy or JAX as these are."""
        return 1.0

    @property
    def monotone(self) -> bool:
        """True where no incidence reflects more than the normal one, by theorem."""
        return False

    @property
    def bounded(self) -> bool:
        """True where no albedo exceeds 1, whatever the parameters, by theorem."""
        return False


def core_of(brdf: Any) -> Any:
    """What is integrated of a BRDF: the lobe inside its factors, or the function as it is."""
    return brdf.core if isinstance(brdf, AbstractBRDF) else brdf


class AbstractZonalLobe(AbstractBRDF):
    """A BRDF that depends on one angle: from the mirror direction ("mirror") or from N to the half vector ("half").

    In the mirror form the lobe is 0 at 90 degrees from the mirror direction and beyond.
    """

    form: eqx.AbstractVar[Form]

    @abc.abstractmethod
    def profile(self, versine: Float[Array, "..."]) -> Float[Array, "..."]:
        """g as a function of 1 - cos(angle), with the versine in [0, 1]; 1 at 0."""

    @abc.abstractmethod
    def width(self) -> Float[Array, ""]:
        """The angle (radians) over which the profile changes near its centre."""

    @abc.abstractmethod
    def breaks(self) -> Float[Array, " breaks"]:
        """Rising versines where the formula changes; the last one is where the lobe ends or falls below 1e-17."""

    def smoothness(self) -> float:
        """The order of the sharpest break inside the profile's domain: the power with which it sets in; inf for none."""
        return 0.0

    @property
    def monotone(self) -> bool:
        r"""True for a lobe whose profile nowhere rises with its angle; then no incidence reflects more than the normal one.

        Theorem: $E(\theta) \le E(0)$ for such a lobe, in either form. By its level sets such a profile is a mixture of
        indicators of {angle < G}, so that it is enough to show it for these.

        Mirror form: a cap of directions about R, cut at the horizon. Of all sets of one solid angle the cap about N has the
        largest projection $\int (N \cdot V)\, dV$, because it takes the directions with the largest N.V first.

        Half form: the albedo is the area on the surface under the reflected directions of {angle(N, H) < G}. From $G = 45°$ on
        light along the normal already fills the unit disc, whose area $\pi$ nothing exceeds. Below, with $x = \sin^2 G < 1/2$,
        it fills a disc of area $\pi \sin^2 2G$; tilted light makes a limaçon of it, with the signed area
        $\pi \cos^2\theta \sin^2 2G + 2\pi \sin^2\theta \sin^4 G$, which is smaller by $2\pi x (2 - 3x) \sin^2\theta$. What lies
        below the horizon counts negatively there and not at all in the albedo. It is at most $\frac\pi2 \sin^2\theta$, which is
        enough for $x \ge 1/6$; for smaller x it is at most $3\pi x \sin^2\theta$, reached only by light from
        beyond 41.8°.
        """
        return False

    def exact_factor(self) -> Any:
        """The factor in closed form with which the lobe reflects exactly 1 at normal incidence; None where there is none."""
        return None

    def amplitude(self) -> Float[Array, "..."]:
        """What the profile is multiplied by, in 1/sr: a number, or one number for each channel."""
        return jnp.ones_like(self.width())

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """The value of the lobe in 1/sr, shape (...), or (..., channels) where the amplitude has channels."""
        wi, wo = jnp.asarray(wi), jnp.asarray(wo)
        if self.form == "mirror":
            versine = geometry.mirror_versine(wi, wo)
            visible = geometry.above_horizon(wi, wo) & (versine < 1)
        else:
            versine = geometry.half_versine(wi, wo)
            visible = geometry.above_horizon(wi, wo)
        # The profile is never shown a versine outside its domain: a masked branch would still poison the gradient.
        value = jnp.where(visible, self.profile(jnp.where(visible, versine, 0)), 0)
        amplitude = self.amplitude()
        return value[..., None] * amplitude if amplitude.ndim else value * amplitude


class AbstractMicrofacetLobe(AbstractBRDF):
    """A BRDF made of a facet distribution D, a masking term G and a Fresnel term F, all about the half vector.

    `refracts`: the facets send light through the surface, not back; past its last kink in azimuth the kernel is 0. `rooted`: it
    sets in like a square root at its kinks.
    """

    refracts: ClassVar[bool] = False
    rooted: ClassVar[bool] = False

    @abc.abstractmethod
    def facet_kernel(
        self,
        half_cosine: Float[Array, "..."],
        half_sine_squared: Float[Array, "..."],
        cos_theta_i: Float[Array, "..."],
        cos_theta_o: Float[Array, "..."],
        incident_half_cosine: Float[Array, "..."],
    ) -> Float[Array, "..."]:
        """f(wi, wo) (N.wo) 4 (wi.H): what is integrated over the solid angle of H. Finite at grazing incidence.

        The arguments are N.H, 1 - (N.H)^2, N.wi > 0, N.wo and wi.H; RGB lobes return a trailing channel axis.
        """

    @abc.abstractmethod
    def width(self) -> Float[Array, ""]:
        """The angle (radians) over which the facet distribution changes near its centre."""

    @abc.abstractmethod
    def breaks(self, cos_theta: Float[Array, ""]) -> Float[Array, " breaks"]:
        """Rising versines 1 - N.H where the kernel changes form for this incidence; the last one ends the distribution."""

    @abc.abstractmethod
    def azimuth_breaks(self, half_cosine: Float[Array, " h"], cos_theta: Float[Array, ""]) -> Float[Array, "kinks h"]:
        """Falling values of wi.H at which the kernel changes form while H turns about N at a fixed N.H."""


class AbstractHalves(AbstractBRDF):
    """What facets reflect and what they let through, lit from one side: a sum of lobes, integrated one after the other."""

    @abc.abstractmethod
    def halves(self) -> tuple[AbstractMicrofacetLobe, ...]:
        """The lobes whose albedos are added."""


class AbstractBSDF(_Whole):
    r"""A surface that reflects and transmits: f(wi, wo) in 1/sr for unit vectors (..., 3) on the whole sphere, N = +z.

    Directions point away from the surface; where wi and wo lie on different sides the light is transmitted. `eta` is the index
    of refraction below the surface over that above it, 1 for thin sheets. `scale` says what a value is:

    * "flux": the radiance towards wo by the irradiance from wi, as printed by Walter et al. (2007). The energy of light from wi
      is $R + T$, the integrals of $f |N \cdot w_o|$ over wo above and below, and
      $f(w_i, w_o) / \eta_o^2 = f(w_o, w_i) / \eta_i^2$ with the indices on the sides of the two directions.
    * "radiance": what a renderer evaluates that follows rays from the eye, which look at the surface along wi: the same with
      wi and wo exchanged. The energy is $R + (\eta_t / \eta_i)^2 T$, and $f(w_i, w_o) / \eta_i^2 = f(w_o, w_i) / \eta_o^2$.

    With `eta` 1 the two are one.
    """

    eta: eqx.AbstractVar[Any]
    scale: eqx.AbstractVar[Scale]

    @abc.abstractmethod
    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """The value in 1/sr, shape (...), or (..., channels); mirrors and clear panes, which have none, are left out."""

    @abc.abstractmethod
    def lit(self, below: Any = 0.0, part: str = "both") -> Any:
        """The BRDF f(wi, wo) on the upper hemisphere whose albedo is the energy R + T, or a `part` of it, for light from above.

        `below` 1: for light from below. ValueError for an unknown part.
        """
