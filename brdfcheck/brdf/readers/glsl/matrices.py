"""Linear algebra on structures of arrays: vectors are tuples of scalars, matrices tuples of columns."""

from __future__ import annotations

from functools import reduce
from typing import Any

from brdfcheck.brdf.readers.glsl.arithmetic import Masked, add, divide, multiply, root, subtract

Columns = tuple[tuple[Any, ...], ...]


def dot(a: Any, b: Any) -> Any:
    """a . b, of vectors or of scalars."""
    if not isinstance(a, tuple):
        return multiply(a, b)
    return reduce(add, (multiply(x, y) for x, y in zip(a, b, strict=True)))


def cross(a: Any, b: Any) -> Any:
    """a x b."""
    return tuple(subtract(multiply(a[i], b[j]), multiply(a[j], b[i])) for i, j in ((1, 2), (2, 0), (0, 1)))


def scaled(a: Any, factor: Any) -> Any:
    """A vector or scalar times a number."""
    return tuple(multiply(x, factor) for x in a) if isinstance(a, tuple) else multiply(a, factor)


def minus(a: Any, b: Any) -> Any:
    """a - b, of vectors or of scalars."""
    return tuple(subtract(x, y) for x, y in zip(a, b, strict=True)) if isinstance(a, tuple) else subtract(a, b)


def length(machine: Masked, a: Any) -> Any:
    """The length; of a scalar its absolute value."""
    return root(machine, dot(a, a)) if isinstance(a, tuple) else abs(a)


def normalized(machine: Masked, a: Any) -> Any:
    """The unit vector."""
    size = length(machine, a)
    return tuple(divide(machine, x, size) for x in a) if isinstance(a, tuple) else divide(machine, a, size)


def transposed(matrix: Columns) -> Columns:
    """Rows for columns."""
    return tuple(zip(*matrix, strict=True))


def times_vector(matrix: Columns, vector: tuple[Any, ...]) -> tuple[Any, ...]:
    """M v."""
    return tuple(dot(row, vector) for row in transposed(matrix))


def vector_times(vector: tuple[Any, ...], matrix: Columns) -> tuple[Any, ...]:
    """v M, v as a row."""
    return tuple(dot(vector, column) for column in matrix)


def product(a: Columns, b: Columns) -> Columns:
    """A B."""
    return tuple(times_vector(a, column) for column in b)


def outer(a: tuple[Any, ...], b: tuple[Any, ...]) -> Columns:
    """a as a column times b as a row."""
    return tuple(tuple(multiply(x, y) for x in a) for y in b)


def _minor(matrix: Columns, column: int, row: int) -> Columns:
    return tuple(tuple(x for j, x in enumerate(values) if j != row) for i, values in enumerate(matrix) if i != column)


def determinant(matrix: Columns) -> Any:
    """The determinant, by expansion along the first column."""
    if len(matrix) == 1:
        return matrix[0][0]
    if len(matrix) == 2:
        return subtract(multiply(matrix[0][0], matrix[1][1]), multiply(matrix[1][0], matrix[0][1]))
    terms = [multiply(matrix[0][row], determinant(_minor(matrix, 0, row))) for row in range(len(matrix))]
    return reduce(lambda total, item: (subtract if item[0] % 2 else add)(total, item[1]), list(enumerate(terms))[1:], terms[0])


def inverse(machine: Masked, matrix: Columns) -> Columns:
    """The inverse, by cofactors."""
    whole, size = determinant(matrix), len(matrix)

    def entry(column: int, row: int) -> Any:
        cofactor = determinant(_minor(matrix, row, column))
        return divide(machine, -cofactor if (row + column) % 2 else cofactor, whole)

    return tuple(tuple(entry(column, row) for row in range(size)) for column in range(size))
