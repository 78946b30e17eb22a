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

from brdfcheck.brdf.base import of_type
from brdfcheck.brdf.callables import Evaluator, Finding
from brdfcheck.messages import UsageError, one_line
from brdfcheck.quadrature.albedo import batched
from brdfcheck.quadrature.functions import adaptive_albedo
from brdfcheck.quadrature.samples import bars
from brdfcheck.quadrature.tables import albedo_table
from brdfcheck.runtime import double_precision
from brdfcheck.sweep.config import ANGLES
from brdfcheck.sweep.plan import CELL, Chunk, Plan

_AXIS = "chunks"
# Compiled programs kept; chunks come in the order of their programs.
_KEPT = 8
_PARTS = ("value", "error", "evaluations")


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
    """Computes the chunks of a plan on all local devices.

    `compiling` is the time spent on compiling so far, in seconds. May be called from several threads. Rules that run on the
    host integrate there, chunk by chunk.
    """

    def __init__(self, plan: Plan):
        self.plan = plan
        self.mesh = Mesh(np.array(jax.local_devices()), (_AXIS,))
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
        with double_precision():  # whatever the process runs in; float32 is an axis
            parts = [_inputs(self.plan, chunk) for chunk in wave]
            if self.plan.method(self.plan.combination(wave[0])).rule.on_host:
                return [self._on_the_host(chunk, part) for chunk, part in zip(wave, parts, strict=True)]
            inputs = self._stacked(parts)
            with self._lock:
                key = self.plan.program(wave[0])
                if key not in self._programs:
                    began = time.perf_counter()
                    self._programs[key] = self._compile(wave[0], inputs)
                    self.compiling += time.perf_counter() - began
                    if len(self._programs) > _KEPT:
                        self._programs.popitem(last=False)
                self._programs.move_to_end(key)
                program = self._programs[key]
            began = time.perf_counter()
            outputs = self._run(program, inputs)
            seconds = time.perf_counter() - began
            return [
                Result(chunk.index, *_outputs(self.plan, chunk, *(output[i] for output in outputs)), seconds)
                for i, chunk in enumerate(wave)
            ]

    def sample(self, chunk: Chunk) -> tuple[float, float]:
        """Seconds to compile the program of a chunk, and seconds a cell, measured on a few of its cells.

        The latter on all devices, where these compute side by side.
        """
        combination = self.plan.combination(chunk)
        method = self.plan.method(combination)
        with double_precision():
            part, count = _inputs(self.plan, chunk), chunk.cells
            if method.sample is not None and method.sample < count:
                rows = np.linspace(0, count - 1, method.sample).astype(int)  # spread over the chunk
                part, count = {name: column[rows] for name, column in part.items()}, method.sample
            began = time.perf_counter()
            if method.rule.on_host:
                width = 1
                self._integrals(combination, {name: column[:1] for name, column in part.items()})
                middle = time.perf_counter()
                self._integrals(combination, part)
            else:
                width, inputs = self.width, self._stacked([part])
                program = self._compile(chunk, inputs)
                self._run(program, inputs)
                middle = time.perf_counter()
                self._run(program, inputs)
            return middle - began, (time.perf_counter() - middle) / (count * width)

    # --- on the devices ---

    def _stacked(self, parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """The inputs of a wave, filled up with the last ones."""
        parts = parts + [parts[-1]] * (self.width - len(parts))
        return {name: np.stack([part[name] for part in parts]) for name in parts[0]}

    def _run(self, program: Callable, inputs: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
        sharding = NamedSharding(self.mesh, PartitionSpec(_AXIS))
        outputs = program({name: jax.device_put(values, sharding) for name, values in inputs.items()})
        return tuple(np.asarray(output) for output in outputs)

    def _compile(self, chunk: Chunk, inputs: dict[str, np.ndarray]) -> Callable:
        table = self.plan.method(self.plan.combination(chunk)).table
        function = (_table if table else _cells)(self.plan, chunk)

        def of_one(inputs: dict[str, Any]) -> tuple[Any, ...]:
            """What one device sees: one chunk, with a leading axis of length 1."""
            answer = function({name: values[0] for name, values in inputs.items()})
            return tuple(jnp.asarray(part)[None] for part in (answer.value, answer.error, answer.evaluations))

        part = PartitionSpec(_AXIS)
        sharding = NamedSharding(self.mesh, part)
        shapes = {name: jax.ShapeDtypeStruct(values.shape, values.dtype, sharding=sharding) for name, values in inputs.items()}
        sharded = jax.shard_map(of_one, mesh=self.mesh, in_specs=(part,), out_specs=part, check_vma=False)
        return jax.jit(sharded).lower(shapes).compile()

    # --- on the host ---

    def _on_the_host(self, chunk: Chunk, numbers: dict[str, np.ndarray]) -> Result:
        began = time.perf_counter()
        outputs = self._integrals(self.plan.combination(chunk), {name: part[: chunk.cells] for name, part in numbers.items()})
        return Result(chunk.index, *_outputs(self.plan, chunk, *outputs), time.perf_counter() - began)

    def _integrals(self, combination: tuple[int, ...], numbers: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
        """Albedo, error and evaluations of cells, one adaptive integral each."""
        settings, tolerance = self.plan.settings(combination), self.plan.method(combination).rule.setting
        evaluator = self._evaluator(combination)
        answers = []
        for i, mu in enumerate(numbers["cos_theta"]):
            row = {name: float(column[i]) for name, column in numbers.items() if name not in (*ANGLES, CELL)}
            turn = float(numbers["azimuth"][i]) if "azimuth" in numbers else 0.0
            try:
                bound = _rounded(evaluator.bind(row), settings["precision"])
                answers.append(adaptive_albedo(bound, float(mu), turn, tolerance))
            except Finding as error:
                shown = ", ".join(f"{name}={value:g}" for name, value in {**row, "cos_theta": float(mu)}.items())
                raise UsageError(f"{settings['brdf']} at {shown}: {one_line(error)}") from error
        value, error, count = (np.array([np.asarray(getattr(a, part)) for a in answers]) for part in _PARTS)
        if self.plan.is_table(combination):
            turns = numbers.get("azimuth", np.zeros(len(value)))
            error = error + bars(self.plan.samples(combination), numbers["cos_theta"], turns)
        return value, error, count

    def _evaluator(self, combination: tuple[int, ...]) -> Evaluator:
        # One for each thread: an evaluator keeps its latest program.
        found = self._local.__dict__.setdefault("evaluators", {})
        if combination not in found:
            found.clear()
            found[combination] = self.plan.evaluator(combination)
        return found[combination]


def _rounded(evaluate: Callable, precision: str) -> Callable:
    """The function with its values rounded to `precision`: the error bars then say so."""
    return evaluate if np.dtype(precision) == float else lambda wi, wo: evaluate(wi, wo).astype(precision)


def _inputs(plan: Plan, chunk: Chunk) -> dict[str, np.ndarray]:
    """What the program of a chunk computes with, always of the same length.

    Of a table the cosines; else the numbers of each cell by axis, in C order, and its place among all cells, so that neither
    the chunks nor the devices have a say in chance.
    """
    combination = plan.combination(chunk)
    method = plan.method(combination)
    dtype = np.dtype(float) if method.rule.on_host else plan.dtype(combination)
    if method.table:
        columns = {"cos_theta": plan.values("cos_theta")[plan.along("cos_theta", chunk)]}
        length = next((part.chunk for part in plan.dimensions if part.name == "cos_theta"), 1)
    else:
        places = np.meshgrid(*(np.arange(part.start, part.stop) for part in chunk.slices), indexing="ij", sparse=True)
        at = {dimension.name: place for dimension, place in zip(plan.dimensions, places, strict=True)}
        columns = {name: np.broadcast_to(plan.values(name)[at.get(name, 0)], chunk.shape).ravel() for name in plan.numeric}
        length = plan.chunk_cells
    columns = {name: column.astype(dtype) for name, column in columns.items()}
    if not method.table:
        columns[CELL] = np.ravel_multi_index(tuple(places), plan.shape).ravel() if places else np.zeros(1, np.int64)
    return {name: np.pad(column, (0, length - len(column)), mode="edge") for name, column in columns.items()}


def _outputs(plan: Plan, chunk: Chunk, value: Any, error: Any, count: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Albedo, error and evaluations in the shape of a chunk, from those of its program."""
    table = plan.method(plan.combination(chunk)).table
    names = [dimension.name for dimension in plan.dimensions]

    def placed(part: Any) -> np.ndarray:
        part = np.asarray(part)
        if not table:
            part = part[: chunk.cells]
        else:
            cosines = plan.along("cos_theta", chunk)
            part = part[:, : cosines.stop - cosines.start]
            if "cos_theta" in names and names.index("cos_theta") < names.index("n"):
                part = np.swapaxes(part, 0, 1)
        return np.ascontiguousarray(part, np.float64).reshape(chunk.shape + (() if plan.channels is None else (plan.channels,)))

    count = np.asarray(count, np.int64)
    counts = count[: chunk.cells].reshape(chunk.shape) if count.ndim else np.full(chunk.shape, count)
    return placed(value), placed(error), counts


def _cells(plan: Plan, chunk: Chunk) -> Callable:
    combination = plan.combination(chunk)
    cell, batch = plan.cell(combination), plan.method(combination).batch
    return lambda inputs: batched(cell, inputs, inputs[CELL].size, batch)


def _table(plan: Plan, chunk: Chunk) -> Callable:
    combination = plan.combination(chunk)
    subject, dtype = plan.subject(combination), plan.dtype(combination)
    exponents = plan.values("n")[plan.along("n", chunk)]
    held = {name: float(plan.values(name)[0]) for name in plan.numeric if name not in (*ANGLES, "n")}
    rtol = plan.settings(combination).get("rtol")

    def family(n: Any) -> Any:
        return of_type(subject.build(n=n, **held), dtype)

    return lambda inputs: albedo_table(family, exponents, inputs["cos_theta"], rtol=rtol)
