"""Lights. Each is a colour (3,) times a field over the points: a light's numbers are leaves, its kind is structure.

Parameters carry the names of OpenGL. `intensity` is a number or RGB, linear. With BRDFs in 1/sr a white matt surface facing
a light of irradiance pi has the radiance 1. Which lights a scene has is known when it is compiled, so what it lacks costs
nothing.
"""

from __future__ import annotations

import abc
import functools
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.scene import polygon
from brdfcheck.scene.vectors import TINY, Vector, checked, color_of, dot, polar, power, scalar, unit, vector_of

_INTENSITY = functools.partial(color_of, name="intensity")
_CONSTANT, _LINEAR, _QUADRATIC, _EXPONENT = (
    functools.partial(scalar, name=name)
    for name in ("constant_attenuation", "linear_attenuation", "quadratic_attenuation", "spot_exponent")
)


class AbstractLight(eqx.Module):
    """Something that shines: a colour times a field."""

    @property
    @abc.abstractmethod
    def intensity(self) -> Float[Array, " 3"]:
        """The colour."""


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

    direction: Float[Array, " 3"] = eqx.field(converter=functools.partial(vector_of, name="direction"))
    intensity: Float[Array, " 3"] = eqx.field(converter=_INTENSITY, default=1.0)

    def arriving(self, point: Vector) -> tuple[Vector, Float[Array, "..."]]:
        return unit(Vector(*self.direction)), jnp.ones_like(self.direction[0])


class _Attenuated(AbstractRayLight):
    """A light at a place, dimmer the farther."""

    position: Float[Array, " 3"] = eqx.field(converter=functools.partial(vector_of, name="position", zero=True))
    constant_attenuation: Float[Array, ""] = eqx.field(converter=_CONSTANT, default=1.0, kw_only=True)
    linear_attenuation: Float[Array, ""] = eqx.field(converter=_LINEAR, default=0.0, kw_only=True)
    quadratic_attenuation: Float[Array, ""] = eqx.field(converter=_QUADRATIC, default=0.0, kw_only=True)

    def __check_init__(self) -> None:
        arrays = (self.constant_attenuation, self.linear_attenuation, self.quadratic_attenuation)
        if not any(isinstance(array, Tracer) or np.any(np.asarray(array)) for array in arrays):
            raise ValueError("constant_attenuation, linear_attenuation, quadratic_attenuation must not all be 0")

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

    intensity: Float[Array, " 3"] = eqx.field(converter=_INTENSITY, default=1.0)


@final
class Spot(_Attenuated):
    r"""A point light in a cone: times $\max(v \cdot d, 0)^e$ within `spot_cutoff` degrees of `spot_direction`, else 0 (OpenGL).

    v is the direction from the light to the point, e the `spot_exponent`. A cutoff of 180 is no cone: an ordinary point
    light. ValueError for a cutoff outside [0, 90] other than 180, an exponent < 0 or a direction of length 0.
    """

    spot_direction: Float[Array, " 3"] = eqx.field(converter=functools.partial(vector_of, name="spot_direction"))
    intensity: Float[Array, " 3"] = eqx.field(converter=_INTENSITY, default=1.0)
    spot_cutoff: Float[Array, ""] = eqx.field(
        converter=functools.partial(scalar, name="spot_cutoff", high=180), default=45.0, kw_only=True
    )
    spot_exponent: Float[Array, ""] = eqx.field(converter=_EXPONENT, default=0.0, kw_only=True)

    def __check_init__(self) -> None:
        if not isinstance(self.spot_cutoff, Tracer) and 90 < float(self.spot_cutoff) < 180:
            raise ValueError(f"spot_cutoff must be in [0, 90] degrees, or 180 for no cone; got {float(self.spot_cutoff):g}")

    def arriving(self, point: Vector) -> tuple[Vector, Float[Array, "..."]]:
        direction, irradiance = super().arriving(point)
        cosine = -dot(direction, unit(Vector(*self.spot_direction)))
        inside = (cosine > 0) & (cosine >= jnp.cos(jnp.deg2rad(self.spot_cutoff)))
        share = power(cosine, self.spot_exponent)
        return direction, irradiance * jnp.where(self.spot_cutoff >= 180, 1, jnp.where(inside, share, 0))


def _corners(vertices: Any) -> Float[Array, "k 3"]:
    """The corners of a polygon, checked."""
    corners = checked(vertices, "vertices", -np.inf, shapes=[(None, 3)], what="at least 3 rows of three numbers")
    if len(corners) < 3:
        raise ValueError(f"a polygon needs at least 3 vertices; got {len(corners)}")
    if not isinstance(corners, Tracer) and (fault := polygon.fault(np.asarray(corners, float))):
        raise ValueError(f"the polygon's {fault}")
    return corners


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

    vertices: Float[Array, "k 3"] = eqx.field(converter=_corners)
    intensity: Float[Array, " 3"] = eqx.field(converter=_INTENSITY, default=1.0)
    two_sided: bool = eqx.field(static=True, converter=bool, default=True, kw_only=True)
    horizon_clipping: bool = eqx.field(static=True, converter=bool, default=True, kw_only=True)
    matt_only: bool = eqx.field(static=True, converter=bool, default=False, kw_only=True)

    def irradiance(self, point: Vector, normal: Vector) -> Float[Array, "..."]:
        """The irradiance at the points over `intensity`: pi times the form factor, >= 0."""
        corners = [Vector(*vertex) - point for vertex in self.vertices]
        if not self.horizon_clipping:
            # Which side the point is on follows from the polygon's plane: the sum's own sign says so only of what is above.
            arms = self.vertices[1:] - self.vertices[0]
            area = jnp.sum(jnp.cross(arms[:-1], arms[1:]), axis=0)
            counterclockwise, total = dot(area, corners[0]) < 0, polygon.whole(corners, normal)
            above = jnp.where(counterclockwise, -total, total if self.two_sided else 0)
            return jnp.maximum(above, 0) / 2
        total = polygon.above_horizon(corners, normal)
        return (jnp.abs(total) if self.two_sided else jnp.maximum(-total, 0)) / 2
