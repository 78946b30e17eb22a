"""Lights. Each is a colour (3,) times a field over the points: a light's numbers are leaves, its kind is structure.

Parameters carry the names of OpenGL. `intensity` is a number or RGB, linear. With BRDFs in 1/sr a white matt surface facing
a light of irradiance pi has the radiance 1. Which lights a scene has is known when it is compiled, so what it lacks costs
nothing.
"""

from __future__ import annotations

import abc
import functools
import itertools
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.scene import polygon
from brdfcheck.scene.vectors import TINY, Vector, checked, color_of, cross, dot, polar, power, scalar, unit, vector_of

_INTENSITY = functools.partial(color_of, name="intensity")


class AbstractLight(eqx.Module):
    """Something that shines: a colour times a field."""

    intensity: eqx.AbstractVar[Array]


class AbstractRayLight(AbstractLight):
    """A light that reaches each point from one direction."""

    @abc.abstractmethod
    def arriving(self, point: Vector) -> tuple[Vector, Float[Array, "..."]]:
        """(unit vector towards the light, irradiance of a surface that faces it over `intensity`) at the points."""


@final
class Ambient(AbstractLight):
    """The same radiance from everywhere for the matt part of a material only: OpenGL's ambient term.

    `intensity`: radiance. `Environment` is the light that glossy parts see too. ValueError for a bad intensity.
    """

    intensity: Float[Array, " 3"] = eqx.field(converter=_INTENSITY, default=1.0)


@final
class Environment(AbstractLight):
    """A uniform surrounding of radiance `intensity`: the white furnace. Glossy parts are integrated at each pixel.

    ValueError for a bad intensity.
    """

    intensity: Float[Array, " 3"] = eqx.field(converter=_INTENSITY, default=1.0)


@final
class Distant(AbstractRayLight):
    """A directional light, OpenGL's position with w = 0. `direction`: towards the light; `intensity`: irradiance.

    ValueError for a direction of length 0 or a bad intensity.
    """

    direction: Float[Array, " 3"]
    intensity: Float[Array, " 3"]

    def __init__(self, direction: Any, intensity: Any = 1.0):
        self.direction = vector_of(direction, "direction")
        self.intensity = _INTENSITY(intensity)

    def arriving(self, point: Vector) -> tuple[Vector, Float[Array, "..."]]:
        return unit(Vector(*self.direction)), jnp.ones_like(self.direction[0])


class _Attenuated(AbstractRayLight):
    """A light at a place, dimmer the farther."""

    position: Float[Array, " 3"]
    constant_attenuation: Float[Array, ""]
    linear_attenuation: Float[Array, ""]
    quadratic_attenuation: Float[Array, ""]

    def _place(self, position: Any, intensity: Any, *attenuations: Any) -> None:
        """The fields that all have, checked."""
        self.position = vector_of(position, "position", zero=True)
        self.intensity = _INTENSITY(intensity)
        names = ("constant_attenuation", "linear_attenuation", "quadratic_attenuation")
        arrays = [scalar(value, name) for value, name in zip(attenuations, names, strict=True)]
        if not any(isinstance(array, Tracer) or np.any(np.asarray(array)) for array in arrays):
            raise ValueError(f"{', '.join(names)} must not all be 0")
        self.constant_attenuation, self.linear_attenuation, self.quadratic_attenuation = arrays

    def arriving(self, point: Vector) -> tuple[Vector, Float[Array, "..."]]:
        distance, direction = polar(Vector(*self.position) - point)
        # No square of the distance by itself, which single precision may not hold where the coefficient is 0.
        a, b, c = self.constant_attenuation, self.linear_attenuation, self.quadratic_attenuation
        return direction, 1 / jnp.maximum(a + distance * (b + distance * c), TINY)


@final
class Point(_Attenuated):
    r"""A point light, $1/(a + b d + c d^2)$ at the distance d (OpenGL). `intensity`: irradiance where that is 1.

    a, b, c are `constant_attenuation`, `linear_attenuation`, `quadratic_attenuation`; (0, 0, 1) is a physical lamp of that
    radiant intensity. ValueError where one is negative or all are 0.
    """

    intensity: Float[Array, " 3"]

    def __init__(
        self,
        position: Any,
        intensity: Any = 1.0,
        *,
        constant_attenuation: Any = 1.0,
        linear_attenuation: Any = 0.0,
        quadratic_attenuation: Any = 0.0,
    ):
        self._place(position, intensity, constant_attenuation, linear_attenuation, quadratic_attenuation)


@final
class Spot(_Attenuated):
    r"""A point light in a cone: times $\max(v \cdot d, 0)^e$ within `spot_cutoff` degrees of `spot_direction`, else 0 (OpenGL).

    v is the direction from the light to the point, e the `spot_exponent`. A cutoff of 180 is no cone: an ordinary point
    light. ValueError for a cutoff outside [0, 90] other than 180, an exponent < 0 or a direction of length 0.
    """

    spot_direction: Float[Array, " 3"]
    intensity: Float[Array, " 3"]
    spot_cutoff: Float[Array, ""]
    spot_exponent: Float[Array, ""]

    def __init__(
        self,
        position: Any,
        spot_direction: Any,
        intensity: Any = 1.0,
        *,
        spot_cutoff: Any = 45.0,
        spot_exponent: Any = 0.0,
        constant_attenuation: Any = 1.0,
        linear_attenuation: Any = 0.0,
        quadratic_attenuation: Any = 0.0,
    ):
        self._place(position, intensity, constant_attenuation, linear_attenuation, quadratic_attenuation)
        self.spot_direction = vector_of(spot_direction, "spot_direction")
        self.spot_cutoff = scalar(spot_cutoff, "spot_cutoff", 0, 180)
        if not isinstance(self.spot_cutoff, Tracer) and 90 < float(self.spot_cutoff) < 180:
            raise ValueError(f"spot_cutoff must be in [0, 90] degrees, or 180 for no cone; got {spot_cutoff}")
        self.spot_exponent = scalar(spot_exponent, "spot_exponent")

    def arriving(self, point: Vector) -> tuple[Vector, Float[Array, "..."]]:
        direction, irradiance = super().arriving(point)
        cosine = -dot(direction, unit(Vector(*self.spot_direction)))
        inside = (cosine > 0) & (cosine >= jnp.cos(jnp.deg2rad(self.spot_cutoff)))
        share = power(cosine, self.spot_exponent)
        return direction, irradiance * jnp.where(self.spot_cutoff >= 180, 1, jnp.where(inside, share, 0))


@final
class Polygon(AbstractLight):
    r"""A plane polygon of radiance `intensity`, for matt surfaces: exact, $E = \frac L2 \sum_i \gamma_i (\Gamma_i \cdot n)$.

    `vertices`: shape (k, 3), k >= 3, in order around it; their number is structure. It shines on both sides, or only on the
    side from which they run counter-clockwise (`two_sided=False`). The part below a point's horizon is cut off;
    `horizon_clipping=False` leaves that out, which is cheaper and right only where all of it is above: what is below counts
    as negative, and a sum below 0 as 0. A surface with other terms than matt ones refuses the light, for which these have
    no closed form, unless `matt_only` says that it is to reach the matt ones alone.

    ValueError for fewer than three vertices, ones that span no area or do not lie in a plane (1e-4 of the size), edges that
    cross one another, or a bad intensity.
    """

    vertices: Float[Array, "k 3"]
    intensity: Float[Array, " 3"]
    two_sided: bool = eqx.field(static=True)
    horizon_clipping: bool = eqx.field(static=True)
    matt_only: bool = eqx.field(static=True)

    def __init__(
        self,
        vertices: Any,
        intensity: Any = 1.0,
        *,
        two_sided: bool = True,
        horizon_clipping: bool = True,
        matt_only: bool = False,
    ):
        what = "at least 3 rows of three numbers"
        self.vertices = checked(vertices, "vertices", -np.inf, shapes=[(None, 3)], what=what)
        if len(self.vertices) < 3:
            raise ValueError(f"a polygon needs at least 3 vertices; got {len(self.vertices)}")
        if not isinstance(self.vertices, Tracer):
            fault = polygon.fault(np.asarray(self.vertices, float))
            if fault:
                raise ValueError(f"the polygon's {fault}")
        self.intensity = _INTENSITY(intensity)
        self.two_sided, self.horizon_clipping, self.matt_only = bool(two_sided), bool(horizon_clipping), bool(matt_only)

    def irradiance(self, point: Vector, normal: Vector) -> Float[Array, "..."]:
        """The irradiance at the points over `intensity`: pi times the form factor, >= 0."""
        corners = [Vector(*vertex) - point for vertex in self.vertices]
        if not self.horizon_clipping:
            # Which side the point is on follows from the polygon's plane: the sum's own sign says so only of what is above.
            first, *others = (Vector(*vertex) for vertex in self.vertices)
            area = Vector(0.0, 0.0, 0.0)
            for a, b in itertools.pairwise(others):
                area = area + cross(a - first, b - first)
            counterclockwise, total = dot(area, corners[0]) < 0, polygon.whole(corners, normal)
            above = jnp.where(counterclockwise, -total, total if self.two_sided else 0)
            return jnp.maximum(above, 0) / 2
        total = polygon.above_horizon(corners, normal)
        return (jnp.abs(total) if self.two_sided else jnp.maximum(-total, 0)) / 2
