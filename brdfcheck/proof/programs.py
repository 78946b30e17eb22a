"""A user's BRDF as a list of steps, from its jaxpr: what is evaluated on enclosures (`enclosures`) and on polynomials.

All values are columns of numbers: what only moves numbers (slices, reshapes, concatenations) is run once, on places, and is
an index from then on. What depends on no direction and no parameter and is a whole number or a truth value is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Literal

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.ways import Caller
from brdfcheck.messages import UsageError, one_line
from brdfcheck.runtime import double_precision

# Primitives that only move numbers, and those that are another jaxpr.
_MOVES = frozenset(
    (
        "broadcast_in_dim", "concatenate", "dynamic_slice", "dynamic_update_slice", "expand_dims", "gather", "pad", "rev",
        "reshape", "scatter", "slice", "split", "squeeze", "stack", "transpose",
    )
)  # fmt: skip
# Of moves at places that are arguments: which arguments these are.
_PLACES = {
    "gather": slice(1, 2),
    "scatter": slice(1, 2),
    "dynamic_slice": slice(1, None),
    "dynamic_update_slice": slice(2, None),
}
_REDUCTIONS = {
    "reduce_sum": "add", "reduce_max": "max", "reduce_min": "min", "reduce_prod": "mul", "reduce_and": "and", "reduce_or": "or",
}  # fmt: skip
_RUNNING = {"cumsum": "add", "cumprod": "mul", "cummax": "max", "cummin": "min"}
_CALLS = frozenset(("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "checkpoint", "remat2"))
_INNER = ("jaxpr", "call_jaxpr", "fun_jaxpr")
_SAME = frozenset(("convert_element_type", "copy", "copy_p", "stop_gradient", "reduce_precision", "optimization_barrier"))
_MOST_STEPS = 20_000
_UNCOVERED = "is not covered by the arithmetic of proofs"


class Uncovered(UsageError):
    """A program does something that the arithmetic of proofs does not know."""


@dataclass(frozen=True)
class Step:
    """values[out] = operation(*values[arguments]); `places`: of a move, which numbers of its arguments."""

    name: str
    arguments: tuple[int, ...]
    out: int
    parameters: dict[str, Any]
    places: np.ndarray | None = None


class Program:
    """A family's f(wi, wo) as steps. The inputs are wi and wo, three numbers each, and the parameters `names`.

    Raises UsageError where JAX cannot trace the function, Uncovered where it uses a primitive that is not covered.
    """

    def __init__(self, family: Family, covered: frozenset[str]):
        self.names = tuple(family.ranges)
        self.steps: list[Step] = []
        self.constants: dict[int, np.ndarray] = {}
        self._covered, self._first = covered, dict[int, list[int]]()
        self._count = 2 + len(self.names)
        middle = {name: (low + high) / 2 for name, (low, high) in family.ranges.items()}
        caller = Caller(family.build, middle)
        if caller.slow:
            raise UsageError(
                f"{family.name} cannot be traced by JAX, and certify proves what can be: a lobe of this package,"
                " a function written with jax.numpy, or a GLSL file"
            )

        def values(wi: Any, wo: Any, *parameters: Any) -> Any:
            return caller.brdf(parameters)(wi, wo)

        with double_precision():
            direction, number = jax.ShapeDtypeStruct((1, 3), np.float64), jax.ShapeDtypeStruct((), np.float64)
            closed = jax.make_jaxpr(values)(direction, direction, *[number] * len(self.names))
            self._known: dict[int, np.ndarray] = {}
            (self.result,) = self._inline(closed.jaxpr, closed.consts, list(range(self._count)))
        if self.result in self._known:
            self.result = self._constant(self._known[self.result])
        self.text = str(closed)

    def _new(self) -> int:
        self._count += 1
        return self._count - 1

    def _constant(self, value: Any) -> int:
        index = self._new()
        self.constants[index] = np.asarray(value, float).reshape(-1)
        return index

    def _know(self, value: Any) -> int:
        index = self._new()
        self._known[index] = np.asarray(value)
        return index

    def _given(self, value: Any) -> int:
        """A constant of the program: a number, or what is known."""
        return self._constant(value) if np.issubdtype(np.asarray(value).dtype, np.floating) else self._know(value)

    def _inline(self, jaxpr: Any, constants: Sequence[Any], arguments: Sequence[int]) -> list[int]:
        """The steps of a jaxpr; its results."""
        where: dict[Any, int] = dict(zip(jaxpr.invars, arguments, strict=True))
        where |= {variable: self._given(value) for variable, value in zip(jaxpr.constvars, constants, strict=True)}

        def at(atom: Any) -> int:
            return self._given(atom.val) if isinstance(atom, Literal) else where[atom]

        for equation in jaxpr.eqns:
            where.update(zip(equation.outvars, self._equation(equation, [at(atom) for atom in equation.invars]), strict=True))
            if len(self.steps) > _MOST_STEPS:
                raise Uncovered(f"the program has more than {_MOST_STEPS} operations: too many for a proof")
        return [at(atom) for atom in jaxpr.outvars]

    def _equation(self, equation: Any, arguments: list[int]) -> list[int]:
        name, parameters = equation.primitive.name, equation.params
        if all(index in self._known for index in arguments) and not np.issubdtype(equation.outvars[0].aval.dtype, np.floating):
            with jax.ensure_compile_time_eval():
                found = equation.primitive.bind(*(self._known[index] for index in arguments), **parameters)
            return [self._know(value) for value in (found if equation.primitive.multiple_results else [found])]
        inner = next((parameters[key] for key in _INNER if key in parameters), None)
        if inner is not None and name in _CALLS:
            inner = inner if hasattr(inner, "consts") else ClosedJaxpr(inner, ())
            return self._inline(inner.jaxpr, inner.consts, arguments)
        shapes = [atom.aval.shape for atom in equation.invars]
        kinds = [atom.aval.dtype.kind for atom in (*equation.invars, *equation.outvars)]
        if name == "argmax" and kinds[0] == "b":  # jnp.select: the first of several conditions that holds, or 0
            self._first[self._new()] = self._columns(arguments[0], shapes[0], parameters["axes"])
            return [self._count - 1]
        if name == "select_n" and arguments[0] in self._first:
            chosen = arguments[1]
            for condition, case in reversed(list(zip(self._first[arguments[0]], arguments[1:], strict=True))):
                chosen = self._step("select_n", [condition, chosen, case], {})
            return [chosen]
        if any(index in self._first for index in arguments):
            raise Uncovered(f"{one_line(name)} of argmax {_UNCOVERED}")
        # Whole numbers would be divided otherwise, and overflow; only truth values become some.
        if kinds[-1] in "iu" and not (name in _MOVES or (name == "convert_element_type" and kinds[0] == "b")):
            raise Uncovered(f"{one_line(name)} of whole numbers that depend on directions or parameters {_UNCOVERED}")
        if "c" in kinds or (name == "convert_element_type" and kinds[-1] == "b" != kinds[0]):
            types = f"from {equation.invars[0].aval.dtype} to {equation.outvars[0].aval.dtype}"
            raise Uncovered(f"{one_line(name)} {types} {_UNCOVERED}")
        if name in _SAME and np.issubdtype(equation.outvars[0].aval.dtype, np.floating):
            return [self._constant(self._known[index]) if index in self._known else index for index in arguments]
        if name in _MOVES:
            return self._moved(equation, arguments, shapes)
        if name == "iota" and np.issubdtype(equation.outvars[0].aval.dtype, np.floating):
            with jax.ensure_compile_time_eval():
                return [self._constant(equation.primitive.bind(**parameters))]
        if name in _REDUCTIONS:
            return [self._folded(_REDUCTIONS[name], self._columns(arguments[0], shapes[0], parameters["axes"]))]
        if name in _RUNNING:
            return [self._running(_RUNNING[name], arguments[0], shapes[0], parameters["axis"], parameters["reverse"])]
        if name == "sort" and len(arguments) == 1:
            return [self._sorted(arguments[0], shapes[0], parameters["dimension"])]
        if name == "cond" and arguments[0] in self._known:
            branches = parameters["branches"]
            branch = branches[min(max(int(self._known[arguments[0]]), 0), len(branches) - 1)]
            return self._inline(branch.jaxpr, branch.consts, arguments[1:])
        if name == "cond" and len(parameters["branches"]) == 2:
            results = [self._inline(branch.jaxpr, branch.consts, arguments[1:]) for branch in parameters["branches"]]
            return [self._step("select_n", [arguments[0], no, yes], {}) for no, yes in zip(*results, strict=True)]
        if name == "scan":
            return self._scan(equation, arguments)
        if name == "dot_general":
            return [self._dot(arguments, shapes, parameters["dimension_numbers"])]
        if name == "select_n" and (len(arguments) != 3 or kinds[0] not in "bi"):
            raise Uncovered(f"select_n of more than two cases {_UNCOVERED}")
        return [self._step(name, arguments, dict(parameters))]

    def _step(self, name: str, arguments: Sequence[int], parameters: dict[str, Any], places: np.ndarray | None = None) -> int:
        if places is None and name not in self._covered:
            raise Uncovered(f"{one_line(name)} {_UNCOVERED}")
        # What is known becomes a number where it meets one.
        used = tuple(self._constant(self._known[index]) if index in self._known else index for index in arguments)
        self.steps.append(Step(name, used, self._new(), parameters, places))
        return self._count - 1

    def _moved(self, equation: Any, arguments: list[int], shapes: list[tuple[int, ...]]) -> list[int]:
        """A move as an index: the primitive, run on the places of its numbers. What is known says where, as of a gather."""
        name = equation.primitive.name
        places: list[Any] = list(range(len(arguments)))
        start, fixed = 0, set(places[_PLACES[name]] if name in _PLACES else ())
        if any(arguments[i] not in self._known for i in fixed):
            raise Uncovered(f"{name} at places that depend on directions or parameters {_UNCOVERED}")
        for i, shape in enumerate(shapes):
            if i in fixed:
                places[i] = self._known[arguments[i]]
                continue
            size = int(np.prod(shape, dtype=int))
            places[i] = np.arange(start, start + size).reshape(shape)
            start += size
        # What is read beyond the ends is no place.
        parameters = equation.params | ({"fill_value": -1} if "fill_value" in equation.params else {})
        with jax.ensure_compile_time_eval():
            found = equation.primitive.bind(*places, **parameters)
        found = found if equation.primitive.multiple_results else [found]
        columns = [np.asarray(part).reshape(-1) for part in found]
        if any(np.any((column < 0) | (column >= start)) for column in columns):
            raise Uncovered(f"{name} out of bounds {_UNCOVERED}")
        data = [index for i, index in enumerate(arguments) if i not in fixed]
        return [self._step("take", data, {}, column) for column in columns]

    def _taken(self, index: int, places: np.ndarray) -> int:
        return self._step("take", [index], {}, places)

    def _columns(self, index: int, shape: tuple[int, ...], axes: Sequence[int]) -> list[int]:
        """The numbers at each place along these axes."""
        places = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)
        kept = [axis for axis in range(len(shape)) if axis not in axes]
        columns = places.transpose([*axes, *kept]).reshape(-1, int(np.prod([shape[axis] for axis in kept], dtype=int)))
        return [self._taken(index, column) for column in columns]

    def _joined(self, columns: list[int], shape: tuple[int, ...], axis: int) -> int:
        """The columns along an axis as one value of this shape: `_columns` undone."""
        places = np.arange(int(np.prod(shape, dtype=int))).reshape((shape[axis], *shape[:axis], *shape[axis + 1 :]))
        return self._step("take", columns, {}, np.moveaxis(places, 0, axis).reshape(-1))

    def _running(self, name: str, index: int, shape: tuple[int, ...], axis: int, reverse: bool) -> int:
        columns = self._columns(index, shape, [axis])[:: -1 if reverse else 1]
        for i in range(1, len(columns)):
            columns[i] = self._step(name, [columns[i - 1], columns[i]], {})
        return self._joined(columns[:: -1 if reverse else 1], shape, axis)

    def _sorted(self, index: int, shape: tuple[int, ...], axis: int) -> int:
        """By as many rounds of exchanges between neighbours as there are numbers."""
        columns = self._columns(index, shape, [axis])
        for round_ in range(len(columns)):
            for i in range(round_ % 2, len(columns) - 1, 2):
                pair = [columns[i], columns[i + 1]]
                columns[i], columns[i + 1] = self._step("min", pair, {}), self._step("max", pair, {})
        return self._joined(columns, shape, axis)

    def _scan(self, equation: Any, arguments: list[int]) -> list[int]:
        """A loop with a known number of rounds, one after the other."""
        parameters = equation.params
        constants, carried = parameters["num_consts"], parameters["num_consts"] + parameters["num_carry"]
        carry, rows = arguments[constants:carried], []
        jaxpr, rounds = parameters["jaxpr"], range(parameters["length"])
        slices = [
            self._rows(index, atom.aval.shape)
            for index, atom in zip(arguments[carried:], equation.invars[carried:], strict=True)
        ]
        for i in reversed(rounds) if parameters["reverse"] else rounds:
            given = [*arguments[:constants], *carry, *(part[i] for part in slices)]
            results = self._inline(jaxpr.jaxpr, jaxpr.consts, given)
            carry = results[: len(carry)]
            rows.append(results[len(carry) :])
        if parameters["reverse"]:
            rows.reverse()
        outputs = equation.outvars[len(carry) :]
        return [
            *carry,
            *(
                self._joined(list(column), atom.aval.shape, 0)
                for column, atom in zip(zip(*rows, strict=True), outputs, strict=True)
            ),
        ]

    def _rows(self, index: int, shape: tuple[int, ...]) -> list[int]:
        if index in self._known:
            return [self._know(row) for row in self._known[index]]
        return self._columns(index, shape, [0])

    def _folded(self, name: str, parts: list[int]) -> int:
        total = parts[0]
        for part in parts[1:]:
            total = self._step(name, [total, part], {})
        return total

    def _dot(self, arguments: list[int], shapes: list[tuple[int, ...]], dimensions: Any) -> int:
        (contract, batch) = dimensions
        places = []
        for shape, summed, common in zip(shapes, contract, batch, strict=True):
            free = [axis for axis in range(len(shape)) if axis not in (*summed, *common)]
            grid = np.arange(int(np.prod(shape, dtype=int))).reshape(shape).transpose([*common, *free, *summed])
            sizes = [[shape[axis] for axis in axes] for axes in (common, free, summed)]
            places.append(grid.reshape([int(np.prod(size, dtype=int)) for size in sizes]))
        left, right = np.broadcast_arrays(places[0][:, :, None], places[1][:, None])
        left, right = (part.reshape(-1, part.shape[-1]).T for part in (left, right))
        products = [
            self._step("mul", [self._taken(arguments[0], a), self._taken(arguments[1], b)], {})
            for a, b in zip(left, right, strict=True)
        ]
        return self._folded("add", products)

    def run(
        self,
        inputs: Sequence[Any],
        constant: Callable[[np.ndarray], Any],
        take: Callable[[list[Any], np.ndarray], Any],
        apply: Callable[[Step, list[Any]], Any],
    ) -> Any:
        """The result, from values of wi, wo and the parameters; how constants, moves and operations are made of them."""
        values: dict[int, Any] = dict(enumerate(inputs)) | {index: constant(value) for index, value in self.constants.items()}
        for step, done in zip(self.steps, self._last_uses(), strict=True):
            arguments = [values[index] for index in step.arguments]
            values[step.out] = apply(step, arguments) if step.places is None else take(arguments, step.places)
            for index in done:
                del values[index]
        return values[self.result]

    def _last_uses(self) -> list[list[int]]:
        """After each step, what is not needed any more."""
        if not hasattr(self, "_done"):
            seen, done = {self.result}, []
            for step in reversed(self.steps):
                done.append([index for index in dict.fromkeys(step.arguments) if index not in seen])
                seen.update(step.arguments)
            self._done = done[::-1]
        return self._done


def taken(parts: list[list[Any]], places: np.ndarray) -> list[Any]:
    """For `Program.run`, of values that are lists of numbers: a move."""
    together = [one for part in parts for one in part]
    return [together[place] for place in places]


def rows_of(arguments: list[list[Any]]) -> list[tuple[Any, ...]]:
    """The arguments of an operation number by number; of a single number as often as the others have numbers."""
    size = max(map(len, arguments))
    return list(zip(*(part if len(part) == size else part * size for part in arguments), strict=True))
