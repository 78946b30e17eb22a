"""The types of a shader, and how their values are kept.

A scalar is a numpy number where it is known while JAX traces, else an array of any shape. A vector is a tuple of scalars, a
matrix a tuple of columns, an array a tuple of elements, a struct a tuple of fields: a structure of arrays, never changed in
place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

KINDS: dict[str, Any] = {"float": np.float64, "int": np.int32, "uint": np.uint32, "bool": np.bool_}
"""The scalar types, and what a known number of each is."""
_PREFIX = {"float": "", "int": "i", "uint": "u", "bool": "b"}
MOST_LEAVES = 16384
"""Numbers that one variable may hold."""


@dataclass(frozen=True)
class Scalar:
    """float, int, uint, bool; and void, which has no values."""

    kind: str

    @property
    def leaves(self) -> int:
        """How many numbers a value holds."""
        return 1

    def zero(self) -> Any:
        """The value of zeros."""
        return KINDS[self.kind](0)

    def __str__(self) -> str:
        return self.kind


@dataclass(frozen=True)
class Vector:
    """vec2 to vec4 and their like."""

    kind: str
    size: int

    @property
    def leaves(self) -> int:
        """How many numbers a value holds."""
        return self.size

    def zero(self) -> Any:
        """The value of zeros."""
        return (KINDS[self.kind](0),) * self.size

    def __str__(self) -> str:
        return f"{_PREFIX[self.kind]}vec{self.size}"


@dataclass(frozen=True)
class Matrix:
    """mat2 to mat4 and matCxR: `columns` of `rows` floats."""

    columns: int
    rows: int

    @property
    def leaves(self) -> int:
        """How many numbers a value holds."""
        return self.columns * self.rows

    @property
    def column(self) -> Vector:
        """The type of a column."""
        return Vector("float", self.rows)

    def zero(self) -> Any:
        """The value of zeros."""
        return (self.column.zero(),) * self.columns

    def __str__(self) -> str:
        return f"mat{self.columns}" if self.columns == self.rows else f"mat{self.columns}x{self.rows}"


@dataclass(frozen=True)
class Array:
    """`size` elements; None where the initial value says how many."""

    element: Type
    size: int | None

    @property
    def leaves(self) -> int:
        """How many numbers a value holds."""
        return (self.size or 0) * self.element.leaves

    def zero(self) -> Any:
        """The value of zeros."""
        return (self.element.zero(),) * (self.size or 0)

    def __str__(self) -> str:
        inner, sizes = self.element, f"[{self.size or ''}]"
        while isinstance(inner, Array):
            inner, sizes = inner.element, sizes + f"[{inner.size or ''}]"
        return f"{inner}{sizes}"


@dataclass(frozen=True)
class Struct:
    """Named fields. Two structs are the same type where they are the same definition: `identity` tells them apart."""

    name: str
    fields: tuple[tuple[str, Type], ...]
    identity: int

    @property
    def leaves(self) -> int:
        """How many numbers a value holds."""
        return sum(kind.leaves for _, kind in self.fields)

    def zero(self) -> Any:
        """The value of zeros."""
        return tuple(kind.zero() for _, kind in self.fields)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Opaque:
    """Samplers: they may be declared and passed on, and have no values."""

    name: str

    @property
    def leaves(self) -> int:
        """How many numbers a value holds."""
        return 0

    def zero(self) -> Any:
        """There is nothing to hold."""
        return ()

    def __str__(self) -> str:
        return self.name


Type = Scalar | Vector | Matrix | Array | Struct | Opaque

FLOAT, INT, UINT, BOOL, VOID = (Scalar(kind) for kind in ("float", "int", "uint", "bool", "void"))


def _named() -> dict[str, Type]:
    found: dict[str, Type] = {kind: Scalar(kind) for kind in (*KINDS, "void")}
    found["double"] = FLOAT
    for size in (2, 3, 4):
        found |= {f"{prefix}vec{size}": Vector(kind, size) for kind, prefix in _PREFIX.items()}
        found[f"dvec{size}"] = Vector("float", size)
        found[f"mat{size}"] = Matrix(size, size)
        found |= {f"mat{size}x{rows}": Matrix(size, rows) for rows in (2, 3, 4)}
    return found


NAMED = _named()
"""The types that have names of their own."""


def kind_of(kind: Type) -> str | None:
    """float, int, uint or bool for scalars, vectors and matrices."""
    if isinstance(kind, (Scalar, Vector)):
        return kind.kind
    return "float" if isinstance(kind, Matrix) else None


def numeric(kind: Type) -> bool:
    """True for what arithmetic is done with."""
    return kind_of(kind) in ("float", "int", "uint")


def with_kind(kind: Type, scalar: str) -> Type:
    """The scalar or vector of the same shape with other components."""
    return Vector(scalar, kind.size) if isinstance(kind, Vector) else Scalar(scalar)


def vector(scalar: str, size: int) -> Type:
    """A vector, or for a size of 1 a scalar."""
    return Scalar(scalar) if size == 1 else Vector(scalar, size)


# What a whole number may become without being asked, and how far that is.
_STEPS = {("int", "uint"): 1, ("int", "float"): 2, ("uint", "float"): 2}


def conversion(given: Type, wanted: Type) -> int | None:
    """How far it is from one type to another without a constructor: 0 for the same type, None where it is not allowed."""
    if given == wanted:
        return 0
    same_shape = (isinstance(given, Scalar) and isinstance(wanted, Scalar)) or (
        isinstance(given, Vector) and isinstance(wanted, Vector) and given.size == wanted.size
    )
    if not same_shape:
        return None
    return _STEPS.get((str(kind_of(given)), str(kind_of(wanted))))


def rebuilt(value: Any, leaves: Any) -> Any:
    """A value of the same shape with other numbers, taken from an iterator."""
    return jax.tree.map(lambda _: next(leaves), value)
