"""What all parts of the compiler share: names, types as they are written, conversions, and one way to refuse."""

from __future__ import annotations

import abc
from typing import Any

import jax

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.arithmetic import convert
from brdfcheck.brdf.readers.glsl.dialect import Dialect
from brdfcheck.brdf.readers.glsl.errors import ShaderError, did_you_mean, mistake
from brdfcheck.brdf.readers.glsl.kinds import (
    BOOL,
    MOST_LEAVES,
    NAMED,
    VOID,
    Array,
    Matrix,
    Opaque,
    Scalar,
    Type,
    Vector,
    conversion,
    kind_of,
)
from brdfcheck.brdf.readers.glsl.machine import Machine, Run
from brdfcheck.brdf.readers.glsl.preprocessor import Source
from brdfcheck.brdf.readers.glsl.scopes import Names, Typed, constant_of


class Context(abc.ABC):
    """The program that is being compiled."""

    def __init__(self, source: Source, dialect: Dialect):
        self.source, self.dialect = source, dialect
        self.names = Names()

    def mistake(self, at: int, message: str) -> ShaderError:
        """What is wrong at this place of the text, to be raised."""
        return mistake(self.source.position(at), message)

    # --- types ---

    def type_of(self, written: syntax.TypeName, sizes: list[syntax.Node | None] | None = None) -> Type:
        """A type as it is written; `sizes`: those behind the name of the variable, which come first."""
        kind = NAMED.get(written.name) or self.names.struct(written.name)
        if kind is None:
            if "sampler" in written.name:
                kind = Opaque(written.name)
            else:
                raise self.mistake(written.at, f"there is no type {written.name!r}{did_you_mean(written.name, NAMED)}")
        every: list[syntax.Node | None] = [*(sizes or []), *written.sizes]
        for size in reversed(every):
            if isinstance(kind, Opaque):  # what has no value has no elements
                continue
            if kind == VOID:
                raise self.mistake(written.at, f"there are no arrays of {kind}")
            kind = Array(kind, None if size is None else self._size(size))
            if kind.leaves > MOST_LEAVES:
                raise self.mistake(written.at, f"{kind} is larger than {MOST_LEAVES} numbers")
        return kind

    def _size(self, node: syntax.Node) -> int:
        typed = self.typed(node)
        value = constant_of(typed.run) if kind_of(typed.type) in ("int", "uint") else None
        if value is None or not isinstance(typed.type, Scalar):
            raise self.mistake(node.at, "the size of an array must be a constant whole number")
        if not 0 < int(value) <= MOST_LEAVES:
            raise self.mistake(node.at, f"the size of an array must be from 1 to {MOST_LEAVES}; got {int(value)}")
        return int(value)

    # --- conversions ---

    def fits(self, given: Type, wanted: Type) -> int | None:
        """How far it is from one type to another without a constructor; None where that is not allowed."""
        steps = conversion(given, wanted)
        if steps is not None or not self.dialect.spread:
            return steps
        if kind_of(given) is None or kind_of(wanted) is None:
            return None
        if isinstance(given, Scalar):
            return 10 + abs(_ORDER.index(given.kind) - _ORDER.index(str(kind_of(wanted))))
        if isinstance(given, Vector) and isinstance(wanted, (Vector, Scalar)):
            size = wanted.size if isinstance(wanted, Vector) else 1
            return 20 + given.size - size if size <= given.size else None
        return 5 if isinstance(given, Matrix) and isinstance(wanted, Matrix) and given == wanted else None

    def converted(self, typed: Typed, wanted: Type, at: int, what: str) -> Run:
        """What gives a value as another type, which must be allowed; `what` is it for?"""
        if self.fits(typed.type, wanted) is None:
            raise self.mistake(at, f"{what} must be {wanted}; got {typed.type}")
        return converting(typed, wanted)

    def condition(self, node: syntax.Node, what: str) -> Run:
        """A truth value."""
        typed = self.typed(node)
        if typed.type == BOOL or (isinstance(typed.type, Scalar) and typed.type != VOID and self.dialect.spread):
            return converting(typed, BOOL)
        raise self.mistake(node.at, f"{what} must be bool; got {typed.type}")

    # --- expressions ---

    def typed(self, node: syntax.Node) -> Typed:
        """An expression, compiled."""
        return getattr(self, f"_{type(node).__name__.lower()}")(node)

    def value(self, node: syntax.Node) -> Typed:
        """An expression that has a value."""
        typed = self.typed(node)
        if typed.type == VOID:
            raise self.mistake(node.at, "this function returns nothing")
        return typed

    @abc.abstractmethod
    def call(self, node: syntax.Call) -> Typed:
        """A call of a function or of a constructor, compiled."""


_ORDER = ["bool", "int", "uint", "float"]


def converting(typed: Typed, wanted: Type) -> Run:
    """What gives a value with the components of another type: a number for all of them, or as many as are wanted."""
    run, kind = typed.run, str(kind_of(wanted))
    if typed.type == wanted:
        return run
    if isinstance(typed.type, Scalar) and isinstance(wanted, Vector):
        size = wanted.size
        return lambda m: (convert(run(m), kind),) * size
    if isinstance(typed.type, Scalar) and isinstance(wanted, Matrix):
        rows, columns = wanted.rows, wanted.columns
        return lambda m: ((convert(run(m), kind),) * rows,) * columns
    if isinstance(typed.type, Vector) and isinstance(wanted, Scalar):
        return lambda m: convert(run(m)[0], kind)
    if isinstance(typed.type, Vector) and isinstance(wanted, Vector) and wanted.size < typed.type.size:
        size = wanted.size
        return lambda m: jax.tree.map(lambda x: convert(x, kind), run(m)[:size])
    return lambda m: jax.tree.map(lambda x: convert(x, kind), run(m))


def literal(value: Any) -> Run:
    """What gives this value."""

    def run(machine: Machine) -> Any:
        del machine
        return value

    return run
