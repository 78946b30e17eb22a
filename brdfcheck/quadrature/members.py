"""Many members of a family as one BRDF, whose numbers are those of all of them."""

from __future__ import annotations

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
        # By the precision of JAX, in which constants are.
        self._wires: dict[Any, tuple[Any, list[tuple[int | None, Any]]] | None] = {}

    def __call__(self, parameters: np.ndarray) -> Any:
        count = len(parameters)

        def repeated(value: Any) -> np.ndarray:
            return np.broadcast_to(value, (count, *np.shape(value)))

        if not self._names:
            return jax.tree.map(repeated, self._build())
        precision = jnp.zeros((), float).dtype
        if precision not in self._wires:
            self._wires[precision] = self._traced()
        found = self._wires[precision]
        if found is None:
            columns = {name: parameters[:, i] for i, name in enumerate(self._names)}
            return jax.tree.map(np.asarray, jax.vmap(lambda values: self._build(**values))(columns))
        structure, wires = found
        leaves = [repeated(value) if column is None else parameters[:, column] for column, value in wires]
        return jax.tree.unflatten(structure, leaves)

    def _traced(self) -> tuple[Any, list[tuple[int | None, Any]]] | None:
        """The structure of a member, and which parameter each of its numbers is, or its value; None where one is computed."""
        scalars = [jnp.zeros((), float)] * len(self._names)
        program, shape = jax.make_jaxpr(
            lambda *values: self._build(**dict(zip(self._names, values, strict=True))), return_shape=True
        )(*scalars)
        constants: dict[Any, Any] = dict(zip(program.jaxpr.constvars, program.consts, strict=True))
        columns: dict[Any, int] = {variable: i for i, variable in enumerate(program.jaxpr.invars)}
        wires: list[tuple[int | None, Any]] = []
        for part in program.jaxpr.outvars:
            if isinstance(part, Literal):
                wires.append((None, np.asarray(part.val, part.aval.dtype)))  # pyright: ignore[reportAttributeAccessIssue]
            elif part in constants:
                wires.append((None, np.asarray(constants[part])))
            elif part in columns:
                wires.append((columns[part], None))
            else:
                return None
        return jax.tree.structure(shape), wires
