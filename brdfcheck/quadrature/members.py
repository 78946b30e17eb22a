"""Many members of a family as one BRDF, whose numbers are those of all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from brdfcheck.brdf.base import AbstractBRDF, structure_of
from brdfcheck.brdf.blame import Finding, told
from brdfcheck.brdf.calling import name_of
from brdfcheck.brdf.factors import has_engine, refuse_batched
from brdfcheck.brdf.family import Family, examples


class OtherKind(Finding):
    """A factory that builds one kind of lobe for most parameters builds another one for some."""


def _form(brdf: Any) -> tuple[Any, list[tuple[int, ...]]]:
    """The structure of a lobe, and the shapes of its numbers."""
    leaves, structure = jax.tree.flatten(brdf)
    return structure, [np.shape(leaf) for leaf in leaves]


class Members:
    """Callable: parameters (points, names) -> BRDF with leaves of numpy, batched over the points.

    `kind` is the structure of a member, without numbers; None where it has none that engines 1 and 2 take, or several. `traced`
    says that JAX can trace the factory. Where each number of a member is a parameter then, or the same for all, as in the
    catalogue, the batch is put together from them; else it is traced each time, which takes one or two milliseconds more.
    Of a factory that needs numbers, because it checks them, say, members are built one by one; OtherKind where one of these is
    not of the `kind`.
    """

    def __init__(self, family: Family):
        self._build, self._names = family.build, tuple(family.ranges)
        self.traced = True
        self.kind: AbstractBRDF | None = None
        self._find_kind(family)
        refuse_batched(self.kind)
        # By the precision of JAX, in which constants are.
        self._wires: dict[Any, tuple[Any, list[tuple[int | None, Any]]] | None] = {}

    def _find_kind(self, family: Family) -> None:
        scalars = {name: jnp.asarray(0.5 * low + 0.5 * high, float) for name, (low, high) in family.ranges.items()}
        kind = structure_of(self._build, **scalars)
        if kind is not None:
            self.kind = kind if has_engine(kind) else None
            return
        self.traced = False
        try:
            for place in examples(list(family.ranges.values())):
                self.kind = self._member(place)
        except Exception:  # some members are functions, or of another kind, or their code raises: engine 3 decides
            self.kind = None

    def _member(self, place: Any) -> AbstractBRDF:
        """One that is built of numbers. OtherKind where it is not of the kind, Finding where the factory raises."""
        numbers = dict(zip(self._names, map(float, place), strict=True))
        try:
            brdf = self._build(**numbers)
        except (Exception, SystemExit) as error:
            raise Finding(f"{self._called(numbers)} raised {told(error)}") from error
        if not has_engine(brdf) or (self.kind is not None and _form(brdf) != _form(self.kind)):
            raise OtherKind(f"{self._called(numbers)} is of another kind than what is built elsewhere: {name_of(brdf)}")
        return brdf

    def _called(self, numbers: Mapping[str, float]) -> str:
        return f"{name_of(self._build)}({', '.join(f'{name}={value:.6g}' for name, value in numbers.items())})"

    def _one_by_one(self, parameters: np.ndarray) -> Any:
        places, which = np.unique(parameters, axis=0, return_inverse=True)
        leaves = [jax.tree.leaves(self._member(place)) for place in places]
        batches = [np.stack([np.asarray(leaf) for leaf in column])[which.ravel()] for column in zip(*leaves, strict=True)]
        return jax.tree.unflatten(jax.tree.structure(self.kind), batches)

    def __call__(self, parameters: np.ndarray) -> Any:
        count = len(parameters)
        if not self.traced:
            return self._one_by_one(parameters)

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
