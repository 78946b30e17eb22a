r"""Functions on the whole sphere as BSDFs, and a BSDF as what engines take: BRDFs for light from above and from below.

The transmitted half is folded up without a loss: the energy is $\int f |N \cdot w_o|\, dw_o$, an integral over the unit disc of
(x, y), and the disc goes onto itself by $z \mapsto (z + a) / (1 + \bar a z)$, $z = x + i y$, with the density
$(1 - |a|^2)^2 / |1 + \bar a z|^4$. The number a is chosen so that the mirror direction goes to the refracted one: so
engine 3, which looks for needles there, finds those of what is transmitted. With equal indices a is 0, and the fold is the
mirror image in the surface.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from brdfcheck.brdf.base import PARTS, SCALES, AbstractBSDF, Part, Scale
from brdfcheck.brdf.calling import directional, name_of
from brdfcheck.brdf.family import Family
from brdfcheck.messages import UsageError, one_of

BELOW = "below"
"""The parameter of what transmits: 0 for light from above, 1 for light from below the surface."""
# Towards grazing light the fold stops moving: at the rim of the disc it would have a pole.
_FARTHEST = 0.98


@final
class FunctionBSDF(AbstractBSDF):
    """A user's function f(wi, wo), perhaps with parameters after these, on the whole sphere. Made by `bsdf`."""

    function: Callable[..., Any] = eqx.field(static=True)
    eta: Any
    scale: Scale = eqx.field(static=True)
    held: tuple[tuple[str, Any], ...] = ()

    @property
    def __name__(self) -> str:
        return name_of(self.function)

    @property
    def __wrapped__(self) -> Callable[..., Any]:  # where its signature and its source are
        return self.function

    def holding(self, **parameters: Any) -> FunctionBSDF:
        """The function with these parameters."""
        return dataclasses.replace(self, held=(*self.held, *parameters.items()))

    def __call__(self, wi: Any, wo: Any) -> Any:
        return self.function(wi, wo, **dict(self.held))

    def lit(self, below: Any = 0.0, part: str = "both") -> Folded:
        return Folded(self, below, one_of(part, PARTS, "part"))


def bsdf(function: Any = None, *, eta: Any = 1.0, scale: str = "flux") -> Any:
    """A function f(wi, wo) on the whole sphere as a BSDF: ``bsdf(f, eta=1.5)``, or ``@bsdf(eta=1.5)`` above its definition.

    `eta`: index of refraction below the surface (z < 0) over that above it, 1 for thin sheets. `scale`: "flux" where wi is the
    light and f the radiance towards wo by the irradiance from wi; "radiance" where f is what a renderer evaluates that follows
    rays from the eye, along wi (see `AbstractBSDF`). Where eta is a parameter, write a factory that returns
    ``bsdf(f, eta=eta)``.
    Raises TypeError where it is no function, ValueError for an eta that is not finite and > 0 or an unknown scale.
    """
    if not isinstance(eta, Tracer):
        number = isinstance(eta, (int, float, np.number, np.ndarray, jax.Array)) and np.ndim(eta) == 0
        if isinstance(eta, bool) or not number or not (np.isfinite(eta) and eta > 0):
            raise ValueError(f"eta must be a finite number > 0; got {eta!r}")
    one_of(scale, SCALES, "scale")
    if function is None:
        return lambda written: bsdf(written, eta=eta, scale=scale)
    call = directional(function)
    if isinstance(call, (type, AbstractBSDF)) or not callable(call):
        raise TypeError(f"bsdf takes a function f(wi, wo); got {function!r}")
    return FunctionBSDF(function=call, eta=eta, scale=scale)  # pyright: ignore[reportArgumentType]


class Folded:
    """The BRDF f(wi, wo) on the upper hemisphere whose albedo is the energy R + T of a BSDF for light from one side.

    Calls the BSDF with JAX arrays where it is given such, else with numpy arrays.
    """

    def __init__(self, surface: AbstractBSDF, below: Any, part: Part):
        self.surface, self.below, self.part = surface, below, part
        self.__name__ = name_of(surface)

    def __call__(self, wi: Any, wo: Any) -> Any:
        traced = any(isinstance(leaf, jax.Array) for leaf in (wi, wo, self.below, self.surface.eta))
        xp: Any = jnp if traced else np
        wi, wo = xp.asarray(wi), xp.asarray(wo)
        side = 1 - 2 * xp.asarray(self.below, wi.dtype)
        value = 0.0
        if self.part != "transmitted":
            value = self.surface(_turned(xp, wi, side), _turned(xp, wo, side))
        if self.part == "reflected":
            return value
        eta = xp.asarray(self.surface.eta, wi.dtype)
        ratio = xp.where(side > 0, eta, 1 / eta)
        through, density = _through(xp, wi, wo, ratio)
        density = density * ratio**2 if self.surface.scale == "radiance" else density
        passing = xp.asarray(self.surface(_turned(xp, wi, side), _turned(xp, through, side)))
        return value + passing * (density[..., None] if passing.ndim > density.ndim else density)


def _turned(xp: Any, direction: Any, side: Any) -> Any:
    """The direction itself for `side` 1, its mirror image in the surface for -1."""
    return xp.stack([direction[..., 0], direction[..., 1], side * direction[..., 2]], axis=-1)


def _through(xp: Any, wi: Any, wo: Any, ratio: Any) -> tuple[Any, Any]:
    """The direction below the surface that wo above it stands for, and its density in |N.wo| dwo."""
    sine = xp.sqrt(xp.maximum(wi[..., 0] ** 2 + wi[..., 1] ** 2, 1e-36))
    mirror, refracted = xp.minimum(sine, _FARTHEST), xp.minimum(sine / ratio, _FARTHEST)
    shift = (mirror - refracted) / (1 - mirror * refracted) / sine
    a, b = shift * wi[..., 0], shift * wi[..., 1]
    x, y = wo[..., 0], wo[..., 1]
    # (z + a) / (1 + conj(a) z), and 1 - |.|^2 of it without a difference.
    real, imaginary = 1 + a * x + b * y, a * y - b * x
    square = real * real + imaginary * imaginary
    less = 1 - a * a - b * b
    up = ((x + a) * real + (y + b) * imaginary) / square, ((y + b) * real - (x + a) * imaginary) / square
    return xp.stack([*up, -wo[..., 2] * xp.sqrt(less / square)], axis=-1), (less / square) ** 2


def below_surface(directions: np.ndarray) -> np.ndarray:
    """Mirror images of directions (..., 3) in the surface."""
    return directions * np.array([1.0, 1.0, -1.0])


def both_sides(family: Family, sides: Any = None) -> Family:
    """A family of BSDFs as one of BRDFs that have their energy, lit from above and from below; any other as it is.

    Its parameter `below` takes the values 0 and 1, or what `sides` holds it at. `Family.pointwise` is what is the same for
    exchanged directions. UsageError where `sides` is something else, or the family has but one side.
    """
    lowest = {name: low for name, (low, _) in family.ranges.items()}
    try:
        surface = family.build(**lowest)
    except (Exception, SystemExit):  # told by whoever builds the family's corners
        return family
    if not isinstance(surface, AbstractBSDF):
        if sides is not None:
            raise UsageError(f"{family.name} has no parameter {BELOW!r}: that is for what transmits; light comes from above")
        return family
    if BELOW in family.ranges:
        raise UsageError(f"{family.name}: the parameter {BELOW} is the side of the light; call the BSDF's own something else")
    return transmitting(family, (0.0, 1.0) if sides is None else checked_sides(family.name, sides))


def transmitting(family: Family, bounds: tuple[float, float]) -> Family:
    """`both_sides` of a family that is known to build BSDFs; `bounds`: the range of `below`."""

    def build(below: Any = bounds[0], **parameters: Any) -> Any:
        return surface(**parameters).lit(below)

    def surface(below: Any = None, **parameters: Any) -> AbstractBSDF:
        return family.build(**parameters)  # the same from both sides

    def exchanged(below: Any = 0.0, **parameters: Any) -> Any:
        return reciprocal_form(surface(**parameters))

    build.__name__ = exchanged.__name__ = getattr(family.build, "__name__", family.name)
    held = bounds[0] == bounds[1]
    return dataclasses.replace(
        family,
        build=build,
        ranges=family.ranges if held else {**family.ranges, BELOW: bounds},
        held={**family.held, BELOW: bounds[0]} if held else family.held,
        switches=family.switches if held else family.switches | {BELOW},
        pointwise=exchanged,
        surface=surface,
    )


def checked_sides(name: str, bounds: Any) -> tuple[float, float]:
    """The range of `below` as two numbers. UsageError where it is not 0, 1 or both."""
    try:
        low, high = (float(bound) for bound in bounds)
    except (TypeError, ValueError):
        low = high = np.nan
    if (low, high) not in ((0.0, 0.0), (1.0, 1.0), (0.0, 1.0)):
        raise UsageError(f"{name}: {BELOW} is 0 (light from above), 1 (from below) or 0:1 (both)")
    return low, high


def reciprocal_form(surface: AbstractBSDF) -> Callable[[Any, Any], Any]:
    """f(wi, wo) on the whole sphere over the square of an index, which reciprocity makes the same for exchanged directions.

    The index is that on the side of wo in the scale of flux, of wi in that of radiance; above the surface it is 1.
    """
    flux = surface.scale == "flux"

    def exchanged(wi: Any, wo: Any) -> Any:
        value = surface(wi, wo)
        xp: Any = jnp if isinstance(value, jax.Array) or isinstance(wi, jax.Array) else np
        below = (wo if flux else wi)[..., 2] < 0
        share = xp.where(below, 1 / surface.eta**2, 1.0)
        value = xp.asarray(value)
        return value * (share[..., None] if value.ndim > share.ndim else share)

    exchanged.__name__ = name_of(surface)
    return exchanged


def sides_of(family: Family) -> tuple[float, ...]:
    """The sides that light comes from in a family: 0, 1, or both."""
    low, high = family.ranges.get(BELOW, (family.held.get(BELOW, 0.0),) * 2)
    return tuple(sorted({low, high}))
