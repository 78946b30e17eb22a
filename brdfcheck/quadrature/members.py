"""Many members of a family as one BRDF, whose numbers are those of all of them."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from brdfcheck.brdf.family import Family


class Members:
    """Callable: parameters (points, names) -> BRDF with leaves of numpy, batched over the points.

    For families that JAX can trace. Where each number of a member is a parameter or the same for all, as in the catalogue, the
    batch is put together from them; else it is traced each time, which takes one or two milliseconds more.
    """

    def __init__(self, family: Family):
        self._build, self._names = family.build, tuple(family.ranges)

    def __call__(self, parameters: np.ndarray) -> Any:
        if self._wires is None:
            columns = {name: parameters[:, i] for i, name in enumerate(self._names)}
            return jax.tree.map(np.asarray, jax.vmap(lambda values: self._build(**values))(columns))
        structure, wires = self._wires
        leaves = [
            parameters[:, wire].astype(kind.dtype)
            if isinstance(wire, int)
            else np.broadcast_to(wire, (len(parameters), *kind.shape))
            for wire, kind in wires
        ]
        return jax.tree.unflatten(structure, leaves)

    @functools.cached_property
    def _wires(self) -> tuple[Any, list[tuple[Any, Any]]] | None:
        """The structure of a member; which parameter, or else which value, each of its numbers is, and the type of that.

        None where a number is computed from the parameters.
        """
        scalars = [jnp.zeros((), float)] * len(self._names)
        program, shape = jax.make_jaxpr(
            lambda *values: self._build(**dict(zip(self._names, values, strict=True))), return_shape=True
        )(*scalars)
        given: dict[Any, Any] = dict(zip(program.jaxpr.constvars, map(np.asarray, program.consts), strict=True))
        given |= {variable: i for i, variable in enumerate(program.jaxpr.invars)}
        wires = [(part.val if isinstance(part, Literal) else given.get(part), part.aval) for part in program.jaxpr.outvars]
        return None if any(wire is None for wire, _ in wires) else (jax.tree.structure(shape), wires)
