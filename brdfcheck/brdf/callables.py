"""Any function f(wi, wo) as something that can be evaluated on many directions at once: JAX where it can be traced.

What is wrong with a user's function is a `Finding` about that function: it raises, returns the wrong shape, or is not
real. NaN, infinite and negative values are passed on; they are judged where they are integrated.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.blame import Finding, told
from brdfcheck.brdf.calling import name_of
from brdfcheck.brdf.ways import Caller, calm, sample
from brdfcheck.runtime import double_precision, understood

BLOCK = 1144
"""Directions of a row: what a program takes for one incidence. Rows must begin at multiples of `ALIGNED` bytes."""
# Rows a program takes, and how many at a time: it stops where a request ends. So a function compiles one program, whatever is
# asked, and a small request is cheap. On a CPU a row at a time stays in the fastest memory and on one core: XLA gains nothing
# by sharing so little work out. The rows may be any of so many more rows of directions, the `TABLE`.
_ROWS, _GROUP, _GROUP_ON_CPU = 64, 64, 1
TABLE = 256
"""Of how many rows of directions `sums` chooses without a copy."""
# Seconds for a row from which on threads are worth their while.
_HEAVY = 7e-5
# Bytes at whose multiples an array must begin for XLA to use it where it lies.
ALIGNED = 64
# Numbers (rows x directions x channels) that a program may return: bounds the memory of functions with many channels.
_MOST_NUMBERS = 2**22
# Directions in one call of a numpy function: what it makes of them, also all pairs by a slip, must fit into memory.
_NUMPY_CALL = 5 * BLOCK
# For how many rows calls of numpy functions are prepared together.
_ROWS_OF_CALLS = 32
# How many directions are compared with themselves alone.
_COMPARED = 20
# Numbers from which on an array is a table.
_LARGE = 2**14


def constant(brdf: Callable[..., Any]) -> Callable[[], Callable[..., Any]]:
    """A family of one, which messages call by the name of `brdf`."""

    def build() -> Callable[..., Any]:
        return brdf

    build.__name__ = name_of(brdf)
    return with_options_of(brdf, build)


def with_options_of(first: Any, second: Callable[..., Any]) -> Callable[..., Any]:
    """The second one, which is to be compiled like the first: `compiler_options`, where it has them."""
    if hasattr(first, "compiler_options"):
        second.compiler_options = first.compiler_options  # pyright: ignore[reportFunctionMemberAccess]
    return second


class Evaluator(Caller):
    """A family of BRDFs, ``build(**parameters) -> f(wi, wo)``, evaluated on arrays of directions.

    Four ways, of which the first that works is taken: one JAX program for all parameters; plain Python with numpy arrays, which
    `slow` reports and a log message announces; and for functions that take `single` pairs of directions, a program again, by
    jax.vmap, or a call for each pair. A family without parameters is built before it is traced. `epsilon` is the rounding of
    the answers' type, `channels` their last axis (None for one number a direction), `alone` says that each direction is
    evaluated as if it were the only one.

    Raises Finding where the BRDF raises or returns something that is not a number, or numbers, for each direction.
    """

    def __init__(self, build: Callable[..., Any], parameters: Mapping[str, float]):
        super().__init__(build, parameters)
        self.alone = False
        # Whether the program has been traced: by the thread that asks, for a function may read what belongs to that.
        self.traced = False
        self._options = understood(getattr(build, "compiler_options", None))
        self._fastest = np.inf
        self.epsilon = float(jnp.finfo(self.dtype).eps)
        most = max(1, min(_ROWS, _MOST_NUMBERS // (BLOCK * (self.channels or 1))))
        self._group = min(_GROUP_ON_CPU if jax.default_backend() == "cpu" else _GROUP, most)
        self._rows = most // self._group * self._group
        if not self.slow:
            self._compile()

    def evaluated_alone(self) -> bool:
        """From now on evaluate each direction as if it were the only one. False where that would take forever (numpy)."""
        if not self.slow:
            self.alone = True
            self._compile()
        return not self.slow

    # --- programs ---

    def _members(self) -> tuple[Any, Callable[[Any, Any], Callable[..., Any]]]:
        """The large arrays of the BRDF on the device, and (arrays, parameters) -> BRDF.

        A table is an argument of a program: as a part of it, it would be compiled, and kept on disk with it.
        """
        if self.names:
            return None, lambda _, parameters: self.brdf(tuple(parameters[i] for i in range(len(self.names))))
        large, rest = eqx.partition(self.brdf(()), lambda leaf: eqx.is_array_like(leaf) and np.size(leaf) > _LARGE)
        with double_precision():
            return jax.tree.map(jnp.asarray, large), lambda held, _: eqx.combine(held, rest)

    def _compile(self) -> None:
        held, member = self._members()

        def row(held: Any, parameters: Any, turn: Any, wi: Any, wo: Any) -> Any:
            function = member(held, parameters)
            c, s = turn[0], turn[1]
            # Components come as arrays of their own, which XLA fuses better than triples.
            light = jnp.stack([jnp.broadcast_to(part, (BLOCK,)) for part in wi], axis=-1)
            view = jnp.stack([c * wo[0] - s * wo[1], s * wo[0] + c * wo[1], wo[2]], axis=-1)
            if self.alone:
                alone = jax.vmap(lambda i, o: jnp.reshape(function(i[None], o[None]), shape[2:]))
                return alone(light, view).astype(self.dtype)
            values = jnp.asarray(function(light, view))
            return (values if values.ndim else jnp.broadcast_to(values, (BLOCK,))).astype(self.dtype)

        group = self._group
        shape = (self._rows, BLOCK) if self.channels is None else (self._rows, BLOCK, self.channels)

        def program(held: Any, groups: Any, which: Any, wo: Any, *arguments: Any) -> Any:
            def step(index: Any, values: Any) -> Any:
                mine, some = jax.tree.map(
                    lambda part: jax.lax.dynamic_slice_in_dim(part, index * group, group), (which, arguments)
                )
                # On a CPU a slice, which XLA reads where it lies; a gather it does not.
                views = jax.tree.map(
                    lambda part: jax.lax.dynamic_slice_in_dim(part, mine[0], 1) if group == 1 else part[mine], wo
                )
                found = jax.vmap(lambda wo, parameters, turn, wi: row(held, parameters, turn, wi, wo))(views, *some)
                return jax.lax.dynamic_update_slice_in_dim(values, found, index * group, 0)

            return jax.lax.fori_loop(0, groups, step, jnp.zeros(shape, self.dtype))

        self.traced = False
        self._program = functools.partial(jax.jit(program, compiler_options=self._options), held)

    @property
    def heavy(self) -> bool:
        """True where a program spends so much time on a row that threads gain more by sharing rows than Python's lock costs."""
        return self.traced and self._fastest > _HEAVY

    def space(self, rows: int) -> np.ndarray:
        """Room for the directions of so many rows, (3, at least rows, BLOCK): what a program takes as it is, without a copy."""
        space = aligned((3, rows + TABLE, BLOCK))  # what is not written to costs no memory
        space[:, rows : rows + self._group] = 1 / np.sqrt(3)  # evaluated with the last group
        return space

    def rows(self, parameters: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """f for rows of directions: parameters (rows, names), wi (3, rows) or (3, rows, BLOCK), wo (3, rows or more, BLOCK).

        Returns shape (rows, BLOCK, channels or 1).
        """
        still = np.tile([1.0, 0.0], (len(parameters), 1))
        pieces = self._pieces(parameters)
        return np.concatenate([self._evaluate(rows, parameters, still, wi, wo[:, rows.start :]) for rows in pieces])

    def sums(
        self,
        parameters: np.ndarray,
        wi: np.ndarray,
        azimuth: np.ndarray,
        wo: np.ndarray,
        weight: np.ndarray,
        which: np.ndarray,
        note: Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], None],
    ) -> np.ndarray:
        """Weighted sums over blocks of directions: (points, blocks, sums, channels or 1).

        parameters (points, names), wi (points, 3), azimuth (points,): by how much the directions are turned. Of tables of
        directions, wo (3, rows, BLOCK), of at least tables x blocks rows, and weight (tables, blocks, sums, BLOCK), `which`
        (points,) says the one of each point; tables of more than `TABLE` rows are copied. What is not finite counts as 0.
        `note` is called with (points, wo, values, finite, weight) of each piece that holds a value below 0 or one that is not
        finite: shapes (rows,), (rows, 3, BLOCK), (rows, BLOCK, channels) twice, (rows, BLOCK).
        """
        points, blocks = len(parameters), weight.shape[1]
        point = np.repeat(np.arange(points), blocks)
        table = (which[:, None] * blocks + np.arange(blocks)).ravel()
        turn = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)[point]
        count, weight = weight.shape[2], weight.reshape(-1, *weight.shape[2:])
        parameters, light = parameters[point], wi.T[:, point]
        sums = np.empty((len(point), count, self.channels or 1))
        for rows in self._pieces(parameters):
            values, share = self._evaluate(rows, parameters, turn, light, wo, table), weight[table[rows]]
            with np.errstate(all="ignore"):
                found = np.matmul(share, values)
            if not np.all(np.isfinite(found)) or values.min() < 0:
                finite = np.isfinite(values)
                values = np.where(finite, values, 0)
                found = np.matmul(share, values)
                view = np.stack(_turned(turn[rows], wo[:, table[rows]]), axis=1)
                note(point[rows], view, values, finite, share.max(axis=1))
            sums[rows] = found
        return sums.reshape(points, blocks, count, -1)

    def _pieces(self, parameters: np.ndarray) -> list[slice]:
        """Rows that are evaluated together."""
        count, most = len(parameters), min(self._rows, _ROWS_OF_CALLS) if self.slow else self._rows
        return [slice(i, min(i + most, count)) for i in range(0, count, most)]

    def _calls(self, parameters: np.ndarray) -> Iterator[tuple[int, int]]:
        """From where to where rows of the same parameters go, which a numpy function is given in one call."""
        change = np.flatnonzero(np.any(parameters[1:] != parameters[:-1], axis=1)) + 1
        most = max(1, _NUMPY_CALL // BLOCK)
        for low, high in pairwise([0, *change.tolist(), len(parameters)]):
            yield from ((i, min(i + most, high)) for i in range(low, high, most))

    def _evaluate(
        self,
        rows: slice,
        parameters: np.ndarray,
        turn: np.ndarray,
        wi: np.ndarray,
        wo: np.ndarray,
        table: np.ndarray | None = None,
    ) -> np.ndarray:
        """One of the `_pieces` of rows: parameters and turn count them on axis 0, wi on axis 1; `table` says their rows of wo.

        None: these are the first ones, in order. Returns shape (rows, BLOCK, channels or 1).
        """
        count = rows.stop - rows.start
        mine = np.arange(count) if table is None else table[rows]
        if self.slow:
            view = np.stack(_turned(turn[rows], wo[:, mine]))
            light = np.array(np.broadcast_to(wi[:, rows] if wi.ndim == 3 else wi[:, rows, None], view.shape))
            place = parameters[rows]
            with calm():
                calls = [
                    self._numpy_call(place[low], *(part[:, low:high].reshape(3, -1).T for part in (light, view)), own=True)
                    for low, high in self._calls(place)
                ]
            return np.concatenate(calls).reshape(count, BLOCK, -1)
        # Where each direction has a light of its own there is no table to choose from.
        size, first = TABLE if wi.ndim == 2 else self._rows, int(mine.min())
        if int(mine.max()) - first < size:
            wo, mine = wo[:, first:], mine - first
        else:  # rows from all over a table that no program takes as a whole
            wo, mine = wo[:, mine], np.arange(count)
        which, parameters, turn, light = jax.tree.map(
            lambda part: _filled_up(part, self._rows), (mine, parameters[rows], turn[rows], tuple(wi[:, rows]))
        )
        views = tuple(_filled_up(part[:size], size) for part in wo)
        began = time.perf_counter()
        try:
            with calm():
                values = np.asarray(self._program(-(-count // self._group), which, views, parameters, turn, light))[:count]
        except Exception as error:
            raise Finding(f"{self.name} raised {told(error)}") from error
        self._fastest = min(self._fastest, (time.perf_counter() - began) / count)
        self.traced |= wi.ndim == 2
        return values.reshape(count, BLOCK, -1)

    def bind(self, parameters: Mapping[str, float]) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """f for these parameters: (wi, wo) of shape (k, 3) each, float64 -> values of shape (k,) or (k, channels)."""
        place = np.array([[float(parameters[name]) for name in self.names]])

        def evaluate(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            count = len(wo)
            if self.slow:
                parts = [
                    self._numpy_call(place[0], wi[i : i + _NUMPY_CALL], wo[i : i + _NUMPY_CALL])
                    for i in range(0, count, _NUMPY_CALL)
                ]
                values = np.concatenate(parts)
            else:
                rows = -(-count // BLOCK)
                view = in_rows(wo, self.space(rows))
                # One light for all needs no copies.
                light = np.broadcast_to(wi[0, :, None], (3, rows)) if wi.strides[0] == 0 else in_rows(wi)
                values = self.rows(np.repeat(place, rows, axis=0), light, view).reshape(rows * BLOCK, -1)[:count]
            return values[:, 0] if self.channels is None else values

        return evaluate

    def _numpy_call(self, parameters: np.ndarray, wi: np.ndarray, wo: np.ndarray, *, own: bool = False) -> np.ndarray:
        values = self.called(parameters, wi, wo, own=own)
        channels = self.shape_of(values, len(wi))
        if channels is not None and channels != self.channels:
            raise Finding(f"{self.name} returned {self.channels or 1} channels for 2 directions, {channels} for {len(wi)}")
        values = values if values.dtype.kind == "f" else values.astype(float)
        return (values if values.ndim else np.broadcast_to(values, len(wi))).reshape(len(wi), -1)

    # --- is a batch what its directions are one by one? ---

    def disagreement(self, *places: Mapping[str, float]) -> str | None:
        """What is wrong where a batch of directions is not what its directions are alone, in other orders and batches.

        At the first of the places (parameters) many directions are compared; at the others, where a term may count that is
        nothing at the first, some. Raises Finding where a batch is not even what it was before.
        """
        alone = self._alone()
        counts = (_COMPARED if number == 0 else _COMPARED // 4 for number in range(len(places)))
        told = (self._disagreement(place, alone, count) for place, count in zip(places, counts, strict=True))
        return next(filter(None, told), None)

    def _disagreement(
        self, parameters: Mapping[str, float], alone: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray], count: int
    ) -> str | None:
        place = np.array([float(parameters[name]) for name in self.names])
        wi, wo = sample()
        bound = self.bind(parameters)

        def together(order: np.ndarray) -> np.ndarray:
            return bound(wi[order], wo[order]).reshape(len(order), -1)

        order = np.arange(len(wi))
        first = together(order)
        scale = np.maximum(np.abs(first), np.max(np.abs(first), initial=0.0) * 1e-9)
        # At an end of a range a function may round more.
        rounding = max(1e-7 if count == _COMPARED else 1e-5, 1e4 * self.epsilon)

        def differs(values: np.ndarray, rows: np.ndarray) -> bool:
            with np.errstate(all="ignore"):
                return bool(np.any(np.abs(values - first[rows]) > rounding * scale[rows]))

        # Each size is a program to compile: for JAX there is one besides that of all requests, plain calls cost nothing.
        apart = any(
            differs(
                np.concatenate([alone(place, wi[i : i + size], wo[i : i + size]) for i in range(0, count, size)]), order[:count]
            )
            for size in ((1, 5) if self.slow else (1,))
        )
        turned = np.random.default_rng(3).permutation(len(wi))
        if not apart and not differs(together(turned), turned):
            return None
        if not self.slow:  # what is drawn at random while JAX traces is a constant of the program: another one has others
            self._compile()
        if differs(together(order), order):
            raise Finding("the same directions give other values at each call: it is random, or keeps state between calls")
        if not apart:
            return "the values depend on the order in which directions are given"
        return (
            "directions given together have other values than one by one: mostly because a norm, sum or maximum runs over all"
            " directions and not over the three components of each (give it axis=-1, and keepdims=True where it divides a"
            " vector), or because the values depend on the number of directions, or are random"
        )

    def _alone(self) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
        """f for parameters and batches as small as they are given, traced anew: (k, 3) twice -> (k, channels or 1)."""
        if self.slow:
            return self._numpy_call
        held, member = self._members()
        values = jax.jit(lambda held, p, wi, wo: member(held, p)(wi, wo), compiler_options=self._options)
        program = functools.partial(values, held)

        def evaluate(place: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            try:
                with calm():
                    values = np.asarray(program([np.asarray(value) for value in place], wi, wo))
            except Exception as error:
                raise Finding(f"{self.name} raised {told(error)}") from error
            return np.broadcast_to(values, (len(wi),) if values.ndim == 0 else values.shape).reshape(len(wi), -1)

        return evaluate


def _filled_up(part: np.ndarray, rows: int) -> np.ndarray:
    """As many rows as a program takes; what they hold beyond the last group does not matter."""
    return part if len(part) == rows else part[np.minimum(np.arange(rows), len(part) - 1)]


def in_rows(directions: np.ndarray, space: np.ndarray | None = None) -> np.ndarray:
    """Directions (k, 3) as rows (3, rows, BLOCK), of which the last one is filled up with the last direction."""
    count = len(directions)
    rows = -(-count // BLOCK)
    space = np.empty((3, rows, BLOCK)) if space is None else space
    filled = space.reshape(3, -1)
    filled[:, :count], filled[:, count : rows * BLOCK] = directions.T, directions[-1:].T
    return space


def _turned(turn: np.ndarray, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The components of wo (3, rows, BLOCK), turned about the normal: turn (rows, 2) holds the cosines and sines."""
    (c, s), (x, y, z) = turn.T[:, :, None], wo
    if not np.any(s) and np.all(c == 1):
        return x, y, z
    return c * x - s * y, s * x + c * y, z


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """An empty float64 array that JAX on a CPU takes as it is: others it copies."""
    size = int(np.prod(shape))
    space = np.empty(size + ALIGNED // 8)
    start = -space.ctypes.data % ALIGNED // 8
    return space[start : start + size].reshape(shape)
