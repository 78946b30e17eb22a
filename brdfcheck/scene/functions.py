"""BRDFs and BSDFs of users as terms of a surface: whatever `brdfcheck.check` takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF, Scale
from brdfcheck.brdf.callables import Evaluator, constant
from brdfcheck.brdf.family import NoRange
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.subject import as_target
from brdfcheck.brdf.two_sides import BELOW, Folded, FunctionBSDF
from brdfcheck.brdf.values import Range
from brdfcheck.messages import UsageError, one_line


@final
class Function(AbstractBRDF):
    """Any ``f(wi, wo)``: in a compiled program where JAX can trace it, else called with numpy arrays, without derivatives.

    ValueError for a function that does not return a number, or three for R, G and B, for each direction.
    """

    call: Callable[..., Any] = eqx.field(static=True)
    many: Callable[..., Any] = eqx.field(static=True)  # the same, for arrays of directions
    name: str = eqx.field(static=True)
    traced: bool = eqx.field(static=True)
    folded: bool = eqx.field(static=True)  # has the energy of what transmits, lit from wi
    colored: bool = eqx.field(static=True)

    def __init__(self, call: Callable[..., Any], name: str):
        found = Evaluator(constant(call), {})
        if found.channels not in (None, 1, 3):
            raise ValueError(f"{name} has {found.channels} channels; a scene takes 1, or 3: R, G and B")
        self.call, self.many, self.name = call, found.brdf(()), name
        self.folded = isinstance(call, Folded)
        self.traced, self.colored = not found.slow, found.channels == 3

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """The function's value in 1/sr, shape (...), or (..., 3) where it has channels."""
        wi, wo = jnp.broadcast_arrays(jnp.asarray(wi), jnp.asarray(wo))
        dtype, flat = wi.dtype, (wi.reshape(-1, 3).astype(float), wo.reshape(-1, 3).astype(float))  # as the checks call it
        rows = (len(flat[0]), 3) if self.colored else (len(flat[0]),)
        if self.traced:
            found = jnp.asarray(self.many(*flat)).astype(dtype)
            found = found[:, 0] if found.ndim == 2 and not self.colored else found
            value = jnp.broadcast_to(found, rows)
        else:
            value = jax.pure_callback(
                lambda *given: self._called(*given).astype(dtype),
                jax.ShapeDtypeStruct(rows, dtype),
                *flat,
                vmap_method="broadcast_all",  # all pixels of a batch in one call
            )
        return value.reshape(wi.shape[:-1] + rows[1:])

    def _called(self, wi: Any, wo: Any) -> np.ndarray:
        wi, wo = np.array(wi, float), np.array(wo, float)
        with np.errstate(all="ignore"):
            found = np.asarray(self.many(wi.reshape(-1, 3), wo.reshape(-1, 3)), float)
        found = found[:, 0] if found.ndim == 2 and not self.colored else found
        tail = (3,) if self.colored else ()
        return np.broadcast_to(found, (wi[..., 0].size, *tail)).reshape(wi.shape[:-1] + tail)


@final
class FunctionSurface(AbstractBSDF):
    """A `FunctionBSDF` for pictures: its function as a `Function`, on the whole sphere."""

    function: Function
    eta: Any
    scale: Scale = eqx.field(static=True)

    def __init__(self, surface: FunctionBSDF, name: str):
        self.function, self.eta, self.scale = Function(surface, name), jnp.asarray(surface.eta, float), surface.scale

    @property
    def __name__(self) -> str:
        return self.function.name

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        return self.function(wi, wo)

    def lit(self, below: Any = 0.0, part: str = "both") -> Function:
        return Function(self.function.call.lit(below, part), self.function.name)  # pyright: ignore[reportFunctionMemberAccess]


def brdf_of(
    value: Any, parameters: Mapping[str, float | Range], reading: Reading | None = None, *, furnace: bool = False
) -> AbstractBRDF | AbstractBSDF:
    """Whatever `brdfcheck.check` takes, with numbers for its parameters, as a BRDF or BSDF; `reading`: how files are read.

    A number may be given as a range of no length.
    `furnace`: for a white furnace, in which a BSDF is the BRDF that has its energy, lit from one side (from above, by default).
    Raises ValueError where a parameter is missing or unknown, or the BRDF cannot be called; TypeError where it is none.
    """
    try:
        held = {name: number if isinstance(number, tuple) else (number, number) for name, number in parameters.items()}
        target = as_target(value, held, None, reading)
    except NoRange as error:
        words, _, _ = one_line(error).partition(" must be given a range")
        raise NoRange(f"{words} must be given as a number", error.names) from None
    if target.finding is not None:
        raise ValueError(one_line(target.finding))
    family = target.family
    if family.surface is not None and not furnace and BELOW in parameters:
        raise UsageError(f"{family.name}: {BELOW} is for the white furnace; under lights each side has its own")
    known = {*family.defaults, *({BELOW} & family.switches)}
    missing = [name for name, (low, high) in family.ranges.items() if low < high and name not in known]
    if missing:
        plural = "s" if len(missing) > 1 else ""
        raise NoRange(f"{family.name}: the parameter{plural} {', '.join(missing)} must be given as a number", missing)
    build = family.build if family.surface is None or furnace else family.surface
    brdf = build(**{name: family.defaults.get(name, low) for name, (low, _) in family.ranges.items()})
    if not furnace and (getattr(brdf, "transmits", False) or getattr(brdf, "mirrors", False)):
        raise UsageError(
            f"{family.name} has what the plug-in alone can follow, mirrors or what it transmits: it is shown in the white"
            " furnace (brdfcheck render furnace --brdf NAME), not under lights"
        )
    if isinstance(brdf, FunctionBSDF):
        return FunctionSurface(brdf, family.name)
    return brdf if isinstance(brdf, (AbstractBRDF, AbstractBSDF)) else Function(brdf, family.name)
