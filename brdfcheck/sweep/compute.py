"""Chunks of cells: one compiled program for each set of static settings, sharded over the devices of the machine.

A wave is as many chunks as there are devices: along the mesh axis "chunks" each device computes one whole chunk, always
of the same shape (what hangs over the end of an axis is filled up and cut off again). So a device runs the same program
on the same numbers whoever computes beside it, and the results do not depend on how many devices there are, on the order
of the chunks, or on where a sweep was interrupted.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from brdfcheck.brdf.callables import Evaluator, Finding
from brdfcheck.messages import UsageError, one_line
from brdfcheck.quadrature.albedo import batched
from brdfcheck.quadrature.functions import adaptive_albedo
from brdfcheck.quadrature.registry import engine_of
from brdfcheck.quadrature.tables import albedo_table
from brdfcheck.runtime import double_precision
from brdfcheck.sweep.cells import CELL, dtype_of, evaluator, of_cell
from brdfcheck.sweep.config import ANGLES, CHOICES
from brdfcheck.sweep.plan import Chunk, Plan
from brdfcheck.sweep.subjects import of_type

_AXIS = "chunks"
# Compiled programs kept; chunks come in the order of their programs.
_KEPT = 8
# Cells looked at to estimate how long a chunk takes.
_SAMPLE = {"zonal": 512, "half-vector": 4, "rule": 4, "adaptive": 3}


@dataclass(frozen=True)
class Result:
    """One computed chunk: arrays of its shape (albedo and error with a trailing channel axis for RGB), and its time.

    `seconds`: wall time that its device spent on it, without the compilation of its program.
    """

    index: int
    albedo: np.ndarray
    error: np.ndarray
    evaluations: np.ndarray
    seconds: float


class Computer:
    """Computes the chunks of a plan on local devices. `devices`: all of them by default.

    `compiling` is the time spent on compiling so far, in seconds. May be called from several threads. Functions (engine 3)
    are integrated on the host, chunk by chunk.
    """

    def __init__(self, plan: Plan, devices: Sequence[Any] | None = None):
        self.plan = plan
        self.mesh = Mesh(np.array(jax.local_devices() if devices is None else devices), (_AXIS,))
        self.compiling = 0.0
        self._programs: OrderedDict[tuple[Any, ...], Callable] = OrderedDict()
        self._lock = threading.Lock()
        self._local = threading.local()

    @property
    def width(self) -> int:
        """Chunks computed side by side."""
        return self.mesh.size

    def __call__(self, wave: Sequence[Chunk]) -> list[Result]:
        """The results of at most `width` chunks that share a program. UsageError where a user's BRDF fails."""
        combination = self.plan.combination(wave[0])
        engine = self.plan.engine(combination)
        with double_precision():  # whatever the process runs in; float32 is an axis
            if engine == "adaptive":
                return [self._on_the_host(chunk, combination) for chunk in wave]
            return self._on_the_mesh(wave, combination, engine)

    def lanes(self, chunk: Chunk) -> int:
        """How many chunks like this one are computed at a time."""
        return 1 if self.plan.engine(self.plan.combination(chunk)) == "adaptive" else self.width

    def sample(self, chunk: Chunk) -> tuple[float, float]:
        """Seconds to compile the program of a chunk, and seconds a cell, measured on a few of its cells."""
        combination = self.plan.combination(chunk)
        engine = self.plan.engine(combination)
        with double_precision():
            began = time.perf_counter()
            if engine == "adaptive":
                cells = _some(_flat(self.plan, chunk), _SAMPLE[engine])
                self._integrals(combination, {name: column[:1] for name, column in cells.items()})
                middle = time.perf_counter()
                self._integrals(combination, cells)
                count = len(cells["cos_theta"])
            else:
                if engine == "table":
                    part, count = _table_inputs(self.plan, chunk, combination), chunk.cells
                else:
                    part = _some(_cell_inputs(self.plan, chunk, combination), _SAMPLE[engine])
                    count = len(part["cos_theta"])
                inputs = {name: np.stack([values] * self.width) for name, values in part.items()}
                program = self._compile(chunk, combination, engine, inputs)
                self._run(program, inputs)
                middle = time.perf_counter()
                self._run(program, inputs)
            return middle - began, (time.perf_counter() - middle) / count

    # --- engines 1 and 2 ---

    def _on_the_mesh(self, wave: Sequence[Chunk], combination: tuple[int, ...], engine: str) -> list[Result]:
        prepare, finish = (_table_inputs, _table_outputs) if engine == "table" else (_cell_inputs, _cell_outputs)
        parts = [prepare(self.plan, chunk, combination) for chunk in wave]
        parts += [parts[-1]] * (self.width - len(parts))
        inputs = {name: np.stack([part[name] for part in parts]) for name in parts[0]}
        with self._lock:
            key = self.plan.program(wave[0])
            if key not in self._programs:
                began = time.perf_counter()
                self._programs[key] = self._compile(wave[0], combination, engine, inputs)
                self.compiling += time.perf_counter() - began
                if len(self._programs) > _KEPT:
                    self._programs.popitem(last=False)
            self._programs.move_to_end(key)
            program = self._programs[key]
        began = time.perf_counter()
        value, error, count = self._run(program, inputs)
        seconds = time.perf_counter() - began
        return [
            Result(
                chunk.index,
                *finish(self.plan, chunk, value[i], error[i]),
                _counts(chunk, count[i]),
                seconds,
            )
            for i, chunk in enumerate(wave)
        ]

    def _run(self, program: Callable, inputs: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
        sharding = NamedSharding(self.mesh, PartitionSpec(_AXIS))
        outputs = program({name: jax.device_put(values, sharding) for name, values in inputs.items()})
        return tuple(np.asarray(output) for output in outputs)

    def _compile(self, chunk: Chunk, combination: tuple[int, ...], engine: str, inputs: dict[str, np.ndarray]) -> Callable:
        function = (_table if engine == "table" else _cells)(self.plan, chunk, combination)

        def of_one(inputs: dict[str, Any]) -> tuple[Any, ...]:
            """What one device sees: one chunk, with a leading axis of length 1."""
            value, error, count = function({name: values[0] for name, values in inputs.items()})
            return value[None], error[None], jnp.asarray(count)[None]

        sharding = NamedSharding(self.mesh, PartitionSpec(_AXIS))
        shapes = {name: jax.ShapeDtypeStruct(values.shape, values.dtype, sharding=sharding) for name, values in inputs.items()}
        part = PartitionSpec(_AXIS)
        sharded = jax.shard_map(of_one, mesh=self.mesh, in_specs=(part,), out_specs=part, check_vma=False)
        return jax.jit(sharded).lower(shapes).compile()

    # --- engine 3 ---

    def _on_the_host(self, chunk: Chunk, combination: tuple[int, ...]) -> Result:
        began = time.perf_counter()
        values, errors, counts = self._integrals(combination, _flat(self.plan, chunk))
        value, error = _cell_outputs(self.plan, chunk, values, errors)
        return Result(chunk.index, value, error, counts.reshape(chunk.shape), time.perf_counter() - began)

    def _integrals(self, combination: tuple[int, ...], numbers: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
        """Albedo, error and evaluations of cells, one adaptive integral each."""
        settings, evaluator = self.plan.settings(combination), self._evaluator(combination)
        values, errors, counts = [], [], []
        for i, mu in enumerate(numbers["cos_theta"]):
            row = {name: float(column[i]) for name, column in numbers.items() if name not in ANGLES}
            turn = float(numbers["azimuth"][i]) if "azimuth" in numbers else 0.0
            try:
                bound = _rounded(evaluator.bind(row), settings["precision"])
                answer = adaptive_albedo(bound, mu, turn, self.plan.tolerance(settings))
            except Finding as error:
                shown = ", ".join(f"{name}={value:g}" for name, value in {**row, "cos_theta": float(mu)}.items())
                raise UsageError(f"{settings['brdf']} at {shown}: {one_line(error)}") from None
            values.append(np.asarray(answer.value))
            errors.append(np.asarray(answer.error))
            counts.append(int(answer.evaluations))
        return np.asarray(values), np.asarray(errors), np.asarray(counts, np.int64)

    def _evaluator(self, combination: tuple[int, ...]) -> Evaluator:
        # One for each thread: an evaluator keeps its latest program.
        found = self._local.__dict__.setdefault("evaluators", {})
        if combination not in found:
            found.clear()
            found[combination] = evaluator(self.plan, combination)
        return found[combination]


def _rounded(evaluate: Callable, precision: str) -> Callable:
    """The function with its values rounded to float32, where that is asked for: the error bars then say so."""
    if precision == "float64":
        return evaluate
    return lambda wi, wo: evaluate(wi, wo).astype(np.float32)


# --- cells one by one ---


def _some(columns: dict[str, np.ndarray], count: int) -> dict[str, np.ndarray]:
    """At most `count` cells, spread over the chunk."""
    size = len(columns["cos_theta"])
    rows = np.unique(np.linspace(0, size - 1, min(count, size)).astype(int))
    return {name: column[rows] for name, column in columns.items()}


def _flat(plan: Plan, chunk: Chunk) -> dict[str, np.ndarray]:
    """The numbers of each cell of a chunk, in C order: held ones, and those of its part of the numeric dimensions."""
    numeric = [(dimension, part) for dimension, part in zip(plan.dimensions, chunk.slices, strict=True) if not dimension.static]
    grids = np.meshgrid(*(plan.values(dimension.name)[part] for dimension, part in numeric), indexing="ij")
    columns = {dimension.name: grid.ravel() for (dimension, _), grid in zip(numeric, grids, strict=True)}
    for name in plan.numeric:
        if name not in columns:
            columns[name] = np.full(chunk.cells, plan.values(name)[0])
    return columns


def _cell_inputs(plan: Plan, chunk: Chunk, combination: tuple[int, ...]) -> dict[str, np.ndarray]:
    columns = _flat(plan, chunk)
    columns.pop("azimuth", None)  # lobes of these engines do not turn with the surface
    dtype = dtype_of(plan, combination)
    columns = {name: column.astype(dtype) for name, column in columns.items()}
    if plan.engine(combination) == "rule":
        # Where a cell lies among all cells: chance that neither the chunks nor the devices have a say in.
        places = np.ix_(*(np.arange(part.start, part.stop) for part in chunk.slices))
        columns[CELL] = np.ravel_multi_index(places, plan.shape).ravel() if places else np.zeros(1, np.int64)
    padding = (0, plan.chunk_cells - chunk.cells)
    return {name: np.pad(column, padding, mode="edge") for name, column in columns.items()}


def _counts(chunk: Chunk, count: np.ndarray) -> np.ndarray:
    """Evaluations of each cell of a chunk, from those of each cell in a row or from one number for all."""
    if count.ndim:
        return count[: chunk.cells].reshape(chunk.shape).astype(np.int64)
    return np.full(chunk.shape, count, np.int64)


def _cell_outputs(plan: Plan, chunk: Chunk, value: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    trailing = () if plan.channels is None else (plan.channels,)
    value, error = (np.asarray(part[: chunk.cells], np.float64) for part in (value, error))
    return value.reshape(chunk.shape + trailing), error.reshape(chunk.shape + trailing)


def _cells(plan: Plan, chunk: Chunk, combination: tuple[int, ...]) -> Callable:
    function = of_cell(plan, combination)
    # Rules bound their memory themselves, for one cell.
    batch = 1 if plan.engine(combination) == "rule" else engine_of(plan.subject(combination).template).batch

    def cells(inputs: dict[str, Any]) -> tuple[Any, Any, Any]:
        value, error, count = batched(function, inputs, inputs["cos_theta"].size, batch)
        return value, error, count

    return cells


# --- tables over n and cos theta ---


def _table_inputs(plan: Plan, chunk: Chunk, combination: tuple[int, ...]) -> dict[str, np.ndarray]:
    names = [dimension.name for dimension in plan.dimensions]
    if "cos_theta" not in names:
        return {"cos_theta": plan.values("cos_theta").astype(dtype_of(plan, combination))}
    at = names.index("cos_theta")
    cosines = plan.values("cos_theta")[chunk.slices[at]]
    padding = (0, plan.dimensions[at].chunk - len(cosines))
    return {"cos_theta": np.pad(cosines, padding, mode="edge").astype(dtype_of(plan, combination))}


def _table_outputs(plan: Plan, chunk: Chunk, value: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    names = [dimension.name for dimension in plan.dimensions if not dimension.static]
    size = dict(zip((dimension.name for dimension in plan.dimensions), chunk.shape, strict=True)).get("cos_theta", 1)
    trailing = () if plan.channels is None else (plan.channels,)

    def placed(part: np.ndarray) -> np.ndarray:
        part = np.asarray(part[:, :size], np.float64)
        if names.index("n") > (names.index("cos_theta") if "cos_theta" in names else -1) and "cos_theta" in names:
            part = np.swapaxes(part, 0, 1)
        return np.ascontiguousarray(part).reshape(chunk.shape + trailing)

    return placed(value), placed(error)


def _table(plan: Plan, chunk: Chunk, combination: tuple[int, ...]) -> Callable:
    subject, settings = plan.subject(combination), plan.settings(combination)
    dtype = dtype_of(plan, combination)
    place = dict(zip((dimension.name for dimension in plan.dimensions), chunk.slices, strict=True))
    exponents = plan.values("n")[place["n"]]
    held = {name: float(plan.values(name)[0]) for name in plan.numeric if name not in (*CHOICES, *ANGLES) and name != "n"}

    def family(n: Any) -> Any:
        return of_type(subject.build(n=n, **held), dtype)

    def table(inputs: dict[str, Any]) -> tuple[Any, Any, Any]:
        answer = albedo_table(family, exponents, inputs["cos_theta"], rtol=settings.get("rtol"))
        return answer.value, answer.error, answer.evaluations

    return table
