"""Light meets a surface: the shader, and BRDFs at component-first directions.

A material sees each light as a `Meeting`, whose angles are computed when they are asked for and once: a scene without a
highlight computes no half vector, one without microfacets no square root for it. What transmits is lit from both sides. Rays
of light that go on in one direction, `AbstractMaterial.glass`, are for who traces them.
"""

from __future__ import annotations

import abc
import functools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF, AbstractMicrofacetLobe, AbstractZonalLobe
from brdfcheck.brdf.lobes import BlinnPhong, Lambert, Phong
from brdfcheck.brdf.microfacet import fresnel_dielectric, fresnel_schlick
from brdfcheck.brdf.transmission import AbstractSmooth
from brdfcheck.scene.lights import AbstractLight, AbstractRayLight
from brdfcheck.scene.vectors import TINY, Vector, choose, cross, dot, power, spread, unit

FRESNELS = {"exact": fresnel_dielectric, "schlick": fresnel_schlick}
"""By name: functions of (cosine, reflectance at normal incidence), each in [0, 1]."""


class Place:
    """Points of a surface and from where they are seen. All angles have the shape of the image, or of what they depend on.

    `normal`: on the side that is seen. `below`: True where that is the lower side of the surface; None: nowhere.
    """

    def __init__(self, point: Vector, normal: Vector, view: Vector, below: Array | None = None):
        self.point, self.normal, self.view, self.below = point, normal, view, below
        self.shape = jnp.broadcast_shapes(*(jnp.shape(part) for part in (*point, *normal, *view)))

    @functools.cached_property
    def cos_view(self) -> Array:
        """N.V as it is: interpolated normals may make it negative at a silhouette."""
        return dot(self.normal, self.view)

    @functools.cached_property
    def seen(self) -> Array:
        """N.V > 0: what is drawn is seen, so where a normal says otherwise grazing is meant."""
        return jnp.maximum(self.cos_view, TINY)

    @functools.cached_property
    def _frame(self) -> tuple[Vector, Vector, Vector]:
        """The axes x, y, z of the surface: z the normal, x level, square to the y axis of space."""
        level = Vector(self.normal.z, 0.0, -self.normal.x)
        flat = dot(level, level) > TINY
        x = choose(flat, unit(level), Vector(1.0, 0.0, 0.0))
        return x, cross(self.normal, x), self.normal

    def local(self, direction: Vector) -> Float[Array, "... 3"]:
        """A direction in the axes of the surface."""
        parts = [jnp.broadcast_to(dot(axis, direction), self.shape) for axis in self._frame]
        return jnp.stack(parts, axis=-1)

    @property
    def turn(self) -> Float[Array, "2 ..."]:
        """Cosine and sine of the azimuth of the view in the axes of the surface; 1 and 0 where it has none."""
        view = self.local(self.view)
        square = view[..., 0] ** 2 + view[..., 1] ** 2
        length = jnp.sqrt(jnp.where(square > TINY, square, 1))
        return jnp.stack(
            [jnp.where(square > TINY, view[..., 0] / length, 1), jnp.where(square > TINY, view[..., 1] / length, 0)]
        )


class Meeting:
    """One light at a place: `direction` towards it, and the `falloff` its intensity is multiplied by."""

    def __init__(self, place: Place, light: AbstractRayLight):
        self.place, self.intensity = place, light.intensity
        self.direction, self.falloff = light.arriving(place.point)

    @functools.cached_property
    def normal_light(self) -> Array:
        """N.L, negative where the light is below the horizon."""
        return dot(self.place.normal, self.direction)

    @functools.cached_property
    def cos_light(self) -> Array:
        """max(N.L, 0)."""
        return jnp.maximum(self.normal_light, 0)

    @functools.cached_property
    def light_view(self) -> Array:
        """L.V."""
        return dot(self.direction, self.place.view)

    @functools.cached_property
    def light_half(self) -> Array:
        """L.H = V.H = |L + V| / 2, > 0."""
        return jnp.sqrt(jnp.maximum((1 + self.light_view) / 2, TINY))

    @functools.cached_property
    def normal_half(self) -> Array:
        """N.H = (N.L + N.V) / |L + V|: without the half vector itself."""
        return (self.normal_light + self.place.cos_view) * (0.5 / self.light_half)

    @functools.cached_property
    def mirror_view(self) -> Array:
        """R.V = 2 (N.L)(N.V) - L.V."""
        return 2 * self.normal_light * self.place.cos_view - self.light_view


def reflected(brdf: AbstractBRDF | AbstractBSDF, meeting: Meeting) -> Float[Array, "..."]:
    """f(L, V) |N.L| in 1/sr: a field, or (3, ...) where the BRDF has channels. Of a BRDF 0 for light from below.

    Lobes that say what they are made of are computed from the angles of the meeting, any other BRDF from its directions.
    """
    if isinstance(brdf, AbstractBSDF):
        return _any(brdf, meeting)
    core = brdf.core
    if hasattr(core, "facet_kernel"):
        value = _facets(core, meeting)
    elif hasattr(core, "profile"):
        value = _zonal(core, meeting)
    else:
        value = _any(core, meeting)
    cosine = jnp.where(meeting.cos_light > 0, meeting.cos_light, 1)  # some published forms divide by it
    return brdf.gain(cosine) * value


def _facets(core: AbstractMicrofacetLobe, meeting: Meeting) -> Array:
    versine = jnp.clip(1 - meeting.normal_half, 0, 1)
    sine_squared = versine * (2 - versine)
    i_h, view, light = meeting.light_half, meeting.place.seen, meeting.cos_light

    def kernel(lobe: AbstractMicrofacetLobe) -> Array:
        # By reciprocity: f (N.V) 4 (V.H) with the two directions exchanged, finite where the view is grazing.
        return lobe.facet_kernel(1 - versine, sine_squared, view, light, i_h)

    tint = getattr(core, "f0", None)
    if tint is not None and tint.ndim:
        lobes = [eqx.tree_at(lambda lobe: lobe.f0, core, part) for part in tint]
        value = jnp.stack([jnp.broadcast_to(kernel(lobe), meeting.place.shape) for lobe in lobes])
    else:
        value = kernel(core)
    return jnp.where(light > 0, value / (4 * i_h), 0)


def _zonal(core: AbstractZonalLobe, meeting: Meeting) -> Array:
    value = meeting.cos_light
    if not isinstance(core, Lambert):
        cosine = meeting.normal_half if core.form == "half" else meeting.mirror_view
        if isinstance(core, (Phong, BlinnPhong)):  # from the cosine itself: half the time of log1p
            profile = power(cosine, core.n)
        else:
            # Never a versine outside its domain: a masked branch would still poison the gradient.
            profile = core.profile(jnp.clip(1 - cosine, 0, 1))
        value = value * (jnp.where(cosine > 0, profile, 0) if core.form == "mirror" else profile)
    return spread(core.amplitude(), len(meeting.place.shape)) * value


def _any(brdf: AbstractBRDF | AbstractBSDF, meeting: Meeting) -> Array:
    place, transmits = meeting.place, isinstance(brdf, AbstractBSDF)
    # Light along the surface brings nothing, nor does light from below where nothing is transmitted: there, the normal keeps
    # the function in its domain.
    lit = meeting.normal_light != 0 if transmits else meeting.normal_light > 0
    light, view = place.local(meeting.direction), place.local(place.view)
    light = jnp.where(lit[..., None], light, jnp.array([0, 0, 1], light.dtype))
    view = view.at[..., 2].set(jnp.maximum(view[..., 2], TINY))
    if transmits and place.below is not None:
        light, view = (one.at[..., 2].multiply(jnp.where(place.below, -1, 1)) for one in (light, view))
    # In the scale of radiance values are those of a ray from the eye.
    value = brdf(view, light) if isinstance(brdf, AbstractBSDF) and brdf.scale == "radiance" else brdf(light, view)
    if value.ndim > view.ndim - 1:
        value = jnp.moveaxis(value, -1, 0)
    return jnp.where(lit, value * jnp.abs(meeting.normal_light), 0)


class AbstractMaterial(eqx.Module):
    """What turns light into the colour of a point."""

    @property
    def glass(self) -> tuple[Float[Array, " 3"], AbstractSmooth] | None:
        """A smooth surface whose light goes on as rays, and its tint; what `color` leaves to those who trace rays."""
        return None

    @property
    def matter(self) -> AbstractMaterial | None:
        """The material without `glass`; None where nothing is left."""
        return self

    @abc.abstractmethod
    def color(self, lights: Sequence[AbstractLight], place: Place) -> Float[Array, "3 ..."]:
        """Linear RGB at the place; the shape broadcasts with (3, *place.shape). ValueError for a light it cannot see."""


def meetings(lights: Sequence[AbstractLight], place: Place, owner: str) -> list[Meeting]:
    """Each light at the place; ValueError where one of them has no direction."""
    for number, light in enumerate(lights):
        if not isinstance(light, AbstractRayLight):
            kind = type(light).__name__
            raise ValueError(f"lights[{number}]: {owner} is lit by Distant, Point and Spot lights only; got {kind}")
    return [Meeting(place, light) for light in lights if isinstance(light, AbstractRayLight)]


def shade(
    material: AbstractMaterial,
    lights: Sequence[AbstractLight],
    point: Any,
    normal: Any,
    view: Any,
    below: Array | None = None,
) -> Float[Array, "3 ..."]:
    """Linear RGB of the points of a surface, shape (3, ...), in the precision of `normal`.

    `point`, `normal` and `view` have shape (3, ...), or are three arrays whose shapes broadcast: what is the same for all
    pixels may be scalars, and is then computed once. `normal` and `view` are unit vectors, `view` towards the eye, `normal` on
    its side of the surface; `below`: True where that is the lower side, for what transmits (None: nowhere). With
    radiometric materials the result is the reflected radiance, with the artistic ones their colour in [0, 1].

    Pure: jit, vmap and grad go through it in all numbers of the material and the lights. Raises ValueError for a light
    that the material cannot be lit by, and a material with `glass`; TypeError for something that is no material or no light.
    """
    if not isinstance(material, AbstractMaterial):
        raise TypeError(f"a material of brdfcheck.scene.materials is needed; got {type(material).__name__}")
    for light in lights:
        if not isinstance(light, AbstractLight):
            raise TypeError(f"lights are those of brdfcheck.scene.lights; got {type(light).__name__}")
    dtype = jnp.asarray(normal[0]).dtype

    def cast(leaf: Any) -> Any:
        return jnp.asarray(leaf, dtype) if jnp.issubdtype(jnp.result_type(leaf), jnp.floating) else leaf

    material, lights = jax.tree.map(cast, (material, tuple(lights)))

    def vector(parts: Any) -> Vector:
        return Vector(*(part if isinstance(part, float) else jnp.asarray(part, dtype) for part in parts))

    if material.glass is not None:
        kind = type(material.glass[1]).__name__
        raise ValueError(
            f"{kind} sends light on in one direction: brdfcheck.scene.tracing.trace follows it, on spheres and planes"
        )
    place = Place(vector(point), vector(normal), vector(view), below)
    return jnp.broadcast_to(material.color(lights, place), (3, *place.shape))
