"""Constructors: ``vec3(0.5)``, ``mat2(a, b)``, ``float[](1, 2)``, a struct of its fields; and lists in braces."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.arithmetic import convert
from brdfcheck.brdf.readers.glsl.context import converting
from brdfcheck.brdf.readers.glsl.expressions import Expressions
from brdfcheck.brdf.readers.glsl.kinds import Array, Matrix, Scalar, Struct, Type, Vector, kind_of
from brdfcheck.brdf.readers.glsl.machine import Machine, Run
from brdfcheck.brdf.readers.glsl.scopes import Typed


class Constructors(Expressions):
    """Compiles what makes values of a type."""

    def construct(self, kind: Type, arguments: list[Typed], node: syntax.Node) -> Typed:
        """The constructor of a type with these arguments."""
        if not arguments:
            raise self.mistake(node.at, f"{kind}() needs arguments")
        for argument in arguments:
            if argument.type == Scalar("void"):
                raise self.mistake(node.at, f"{kind}() cannot take what returns nothing")
        if isinstance(kind, Array):
            return self._array(kind, arguments, node)
        if isinstance(kind, Struct):
            return self._struct(kind, arguments, node)
        if kind_of(kind) in (None, "void"):
            raise self.mistake(node.at, f"{kind} has no constructor")
        for argument in arguments:
            if kind_of(argument.type) in (None, "void"):
                raise self.mistake(node.at, f"{kind}() cannot be made of {argument.type}")
        if isinstance(kind, Matrix):
            return self._matrix(kind, arguments, node)
        scalar = str(kind_of(kind))
        size = kind.size if isinstance(kind, Vector) else 1
        if isinstance(kind, Scalar):
            if len(arguments) != 1:
                raise self.mistake(node.at, f"{kind}() takes one value; got {len(arguments)}")
            inner = arguments[0].run
            return Typed(kind, lambda m: convert(jax.tree.leaves(inner(m))[0], scalar))
        if len(arguments) == 1 and isinstance(arguments[0].type, Scalar):
            return Typed(kind, converting(arguments[0], kind))
        self._enough(kind, size, arguments, node)
        runs = [argument.run for argument in arguments]

        def run(machine: Machine) -> Any:
            leaves = [leaf for part in runs for leaf in jax.tree.leaves(part(machine))]
            return tuple(convert(leaf, scalar) for leaf in leaves[:size])

        return Typed(kind, run)

    def _enough(self, kind: Type, size: int, arguments: list[Typed], node: syntax.Node) -> None:
        given = 0
        for argument in arguments:
            if given >= size:
                raise self.mistake(node.at, f"{kind}() has more arguments than it takes: {size} numbers")
            given += argument.type.leaves
        if given < size:
            raise self.mistake(node.at, f"{kind}() takes {size} numbers; got {given}")

    def _matrix(self, kind: Matrix, arguments: list[Typed], node: syntax.Node) -> Typed:
        columns, rows = kind.columns, kind.rows
        first = arguments[0]
        inner = first.run
        if len(arguments) == 1 and isinstance(first.type, Scalar):
            zero, spread = np.float64(0), self.dialect.spread

            def diagonal(machine: Machine) -> Any:
                value = convert(inner(machine), "float")
                return tuple(tuple(value if i == j or spread else zero for j in range(rows)) for i in range(columns))

            return Typed(kind, diagonal)
        if len(arguments) == 1 and isinstance(first.type, Matrix):
            given = first.type

            def resized(machine: Machine) -> Any:
                value = inner(machine)
                return tuple(
                    tuple(value[i][j] if i < given.columns and j < given.rows else np.float64(i == j) for j in range(rows))
                    for i in range(columns)
                )

            return Typed(kind, resized)
        if any(isinstance(argument.type, Matrix) for argument in arguments):
            raise self.mistake(node.at, f"{kind}() takes one matrix, or numbers and vectors")
        self._enough(kind, columns * rows, arguments, node)
        runs = [argument.run for argument in arguments]

        def run(machine: Machine) -> Any:
            leaves = [convert(leaf, "float") for part in runs for leaf in jax.tree.leaves(part(machine))]
            return tuple(tuple(leaves[i * rows : (i + 1) * rows]) for i in range(columns))

        return Typed(kind, run)

    def _array(self, kind: Array, arguments: list[Typed], node: syntax.Node) -> Typed:
        if kind.size is not None and kind.size != len(arguments):
            raise self.mistake(node.at, f"{kind} takes {kind.size} elements; got {len(arguments)}")
        element = kind.element
        if isinstance(element, Array) and element.size is None:
            element = arguments[0].type
        runs = [self.converted(argument, element, node.at, "an element") for argument in arguments]
        return Typed(Array(element, len(runs)), _gathered(runs))

    def _struct(self, kind: Struct, arguments: list[Typed], node: syntax.Node) -> Typed:
        if len(arguments) != len(kind.fields):
            names = ", ".join(f"{field} {name}" for name, field in kind.fields)
            raise self.mistake(node.at, f"{kind}() takes {len(kind.fields)} fields ({names}); got {len(arguments)}")
        runs = [
            self.converted(argument, field, node.at, f"the field {name!r}")
            for argument, (name, field) in zip(arguments, kind.fields, strict=True)
        ]
        return Typed(kind, _gathered(runs))

    def _construct(self, node: syntax.Construct) -> Typed:
        kind = self.type_of(node.type)
        arguments = [self.value(argument) for argument in node.arguments]
        if self.dialect.spread and len(arguments) == 1 and not isinstance(kind, Array):
            if isinstance(kind, Struct):  # (Surface)0 fills a struct with zeros
                value = kind.zero()
                return Typed(kind, lambda m: value)
            return Typed(kind, self.converted(arguments[0], kind, node.at, "what is cast"))
        return self.construct(kind, arguments, node)

    def initial(self, node: syntax.Node, wanted: Type) -> Typed:
        """What a variable of this type begins with. The sizes of arrays that are open are those of the value."""
        if isinstance(node, syntax.Braces):
            return self._listed(node, wanted)
        typed = self.value(node)
        if isinstance(wanted, Array) and isinstance(typed.type, Array) and _opened(typed.type, wanted) == wanted:
            wanted = typed.type
        return Typed(wanted, self.converted(typed, wanted, node.at, "what it begins with"))

    def _listed(self, node: syntax.Braces, wanted: Type) -> Typed:
        if isinstance(wanted, Array):
            parts = [self.initial(part, wanted.element) for part in node.parts]
            if not parts or (wanted.size is not None and wanted.size != len(parts)):
                raise self.mistake(node.at, f"{wanted} takes {wanted.size or 'some'} elements; got {len(parts)}")
            return Typed(Array(parts[0].type, len(parts)), _gathered([part.run for part in parts]))
        if isinstance(wanted, Struct):
            if len(node.parts) != len(wanted.fields):
                raise self.mistake(node.at, f"{wanted} takes {len(wanted.fields)} fields; got {len(node.parts)}")
            parts = [self.initial(part, kind) for part, (_, kind) in zip(node.parts, wanted.fields, strict=True)]
            return Typed(wanted, _gathered([part.run for part in parts]))
        if isinstance(wanted, Matrix) and any(isinstance(part, syntax.Braces) for part in node.parts):
            columns = [self.initial(part, wanted.column) for part in node.parts]
            return Typed(wanted, self.construct(wanted, columns, node).run)
        return Typed(wanted, self.construct(wanted, [self.value(part) for part in node.parts], node).run)


def _gathered(runs: list[Run]) -> Run:
    return lambda m: tuple(run(m) for run in runs)


def _opened(given: Type, wanted: Type) -> Type:
    """The type of a value with open sizes where those of the other type are open."""
    if isinstance(given, Array) and isinstance(wanted, Array):
        return Array(_opened(given.element, wanted.element), None if wanted.size is None else given.size)
    return given
