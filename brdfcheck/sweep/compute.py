"""Chunks of cells: what is compiled for each program once, sharded over the devices of the machine.

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
from brdfcheck.brdf.blame import Finding
from brdfcheck.brdf.callables import Evaluator
from brdfcheck.messages import UsageError, one_line
from brdfcheck.quadrature.albedo import batched
from brdfcheck.quadrature.functions import adaptive_albedo
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.samples import bars
from brdfcheck.quadrature.tables import albedo_table
from brdfcheck.runtime import double_precision
from brdfcheck.sweep.config import ANGLES
from brdfcheck.sweep.plan import Chunk, Plan
from brdfcheck.sweep.program import CELL, Program

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
        self._compiled: OrderedDict[tuple[Any, ...], Callable] = OrderedDict()
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
            if self.plan.program(wave[0]).rule.on_host:
                return [self._on_the_host(chunk, part) for chunk, part in zip(wave, parts, strict=True)]
            inputs = self._placed(parts)
            with self._lock:
                key = self.plan.compiled(wave[0])
                if key not in self._compiled:
                    began = time.perf_counter()
                    self._compiled[key] = self._compile(wave[0], inputs)
                    self.compiling += time.perf_counter() - began
                    if len(self._compiled) > _KEPT:
                        self._compiled.popitem(last=False)
                self._compiled.move_to_end(key)
                compiled = self._compiled[key]
            began = time.perf_counter()
            outputs = _run(compiled, inputs)
            seconds = time.perf_counter() - began
            return [
                Result(chunk.index, *_outputs(self.plan, chunk, *(output[i] for output in outputs)), seconds)
                for i, chunk in enumerate(wave)
            ]

    def sample(self, chunk: Chunk) -> tuple[float, float]:
        """Seconds to compile the program of a chunk, and seconds a cell, measured on a few of its cells.

        The latter on all devices, where these compute side by side.
        """
        program = self.plan.program(chunk)
        with double_precision():
            part, count = _inputs(self.plan, chunk), chunk.cells
            if program.sample is not None and program.sample < count:
                rows = np.linspace(0, count - 1, program.sample).astype(int)  # spread over the chunk
                part, count = {name: column[rows] for name, column in part.items()}, program.sample
            began = time.perf_counter()
            if program.rule.on_host:
                width = 1
                self._integrals(program, {name: column[:1] for name, column in part.items()})
                middle = time.perf_counter()
                self._integrals(program, part)
            else:
                width, inputs = self.width, self._placed([part])
                compiled = self._compile(chunk, inputs)
                _run(compiled, inputs)
                middle = time.perf_counter()
                _run(compiled, inputs)
            return middle - began, (time.perf_counter() - middle) / (count * width)

    # --- on the devices ---

    def _placed(self, parts: list[dict[str, np.ndarray]]) -> dict[str, jax.Array]:
        """The inputs of a wave on the devices, filled up with the last ones."""
        parts = parts + [parts[-1]] * (self.width - len(parts))
        sharding = NamedSharding(self.mesh, PartitionSpec(_AXIS))
        return {name: jax.device_put(np.stack([part[name] for part in parts]), sharding) for name in parts[0]}

    def _compile(self, chunk: Chunk, inputs: dict[str, jax.Array]) -> Callable:
        program = self.plan.program(chunk)
        function = _table(self.plan, program, chunk) if program.table else _cells(program)

        def of_one(inputs: dict[str, Any]) -> tuple[Any, ...]:
            """What one device sees: one chunk, with a leading axis of length 1."""
            answer = function({name: values[0] for name, values in inputs.items()})
            return tuple(jnp.asarray(part)[None] for part in (answer.value, answer.error, answer.evaluations))

        part = PartitionSpec(_AXIS)
        sharded = jax.shard_map(of_one, mesh=self.mesh, in_specs=(part,), out_specs=part, check_vma=False)
        return jax.jit(sharded).lower(inputs).compile()

    # --- on the host ---

    def _on_the_host(self, chunk: Chunk, numbers: dict[str, np.ndarray]) -> Result:
        began = time.perf_counter()
        outputs = self._integrals(self.plan.program(chunk), {name: part[: chunk.cells] for name, part in numbers.items()})
        return Result(chunk.index, *_outputs(self.plan, chunk, *outputs), time.perf_counter() - began)

    def _integrals(self, program: Program, numbers: dict[str, np.ndarray]) -> tuple[np.ndarray, ...]:
        """Albedo, error and evaluations of cells, one adaptive integral each."""
        evaluator, samples = self._evaluating(program)
        answers = []
        for i, mu in enumerate(numbers["cos_theta"]):
            row = {name: float(column[i]) for name, column in numbers.items() if name not in (*ANGLES, CELL)}
            turn = float(numbers["azimuth"][i]) if "azimuth" in numbers else 0.0
            try:
                bound = _rounded(evaluator.bind(row), program.dtype)
                answers.append(adaptive_albedo(bound, float(mu), turn, program.rule.setting))
            except Finding as error:
                shown = ", ".join(f"{name}={value:g}" for name, value in {**row, "cos_theta": float(mu)}.items())
                raise UsageError(f"{program.settings['brdf']} at {shown}: {one_line(error)}") from error
        value, error, count = (np.array([np.asarray(getattr(a, part)) for a in answers]) for part in _PARTS)
        if samples is not None:
            error = error + bars(samples, numbers["cos_theta"], numbers.get("azimuth", np.zeros(len(value))))
        return value, error, count

    def _evaluating(self, program: Program) -> tuple[Evaluator, PointwiseAlbedo | None]:
        """What evaluates the BRDF, and what is known at samples only once more, for its error bars."""
        # One for each thread: an evaluator keeps its latest program.
        found = self._local.__dict__.setdefault("evaluating", {})
        if program.place not in found:
            found.clear()
            found[program.place] = program.evaluator(), program.samples() if program.tabulated else None
        return found[program.place]


def _run(compiled: Callable, inputs: dict[str, jax.Array]) -> tuple[np.ndarray, ...]:
    return tuple(np.asarray(output) for output in compiled(inputs))


def _rounded(evaluate: Callable, dtype: np.dtype) -> Callable:
    """The function with its values rounded to `dtype`: the error bars then say so."""
    return evaluate if dtype == np.float64 else lambda wi, wo: evaluate(wi, wo).astype(dtype)


def _inputs(plan: Plan, chunk: Chunk) -> dict[str, np.ndarray]:
    """What the program of a chunk computes with, always of the same length.

    Of a table the cosines; else the numbers of each cell by axis, in C order, and its place among all cells, so that neither
    the chunks nor the devices have a say in chance.
    """
    program = plan.program(chunk)
    dtype = np.dtype(float) if program.rule.on_host else program.dtype
    if program.table:
        columns = {"cos_theta": plan.numbers["cos_theta"].values[chunk.along("cos_theta")]}
        length = plan.numbers["cos_theta"].chunk
    else:
        places = np.meshgrid(*(np.arange(part.start, part.stop) for part in chunk.parts.values()), indexing="ij", sparse=True)
        at = dict(zip(chunk.parts, places, strict=True))
        columns = {
            name: np.broadcast_to(axis.values[at.get(name, 0)], chunk.shape).ravel() for name, axis in plan.numbers.items()
        }
        length = plan.chunk_cells
    columns = {name: column.astype(dtype) for name, column in columns.items()}
    if not program.table:
        columns[CELL] = np.ravel_multi_index(tuple(places), plan.shape).ravel() if places else np.zeros(1, np.int64)
    return {name: np.pad(column, (0, length - len(column)), mode="edge") for name, column in columns.items()}


def _outputs(plan: Plan, chunk: Chunk, value: Any, error: Any, count: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Albedo, error and evaluations in the shape of a chunk, from those of its program."""
    table, names = plan.program(chunk).table, list(chunk.parts)

    def placed(part: Any) -> np.ndarray:
        part = np.asarray(part)
        if not table:
            part = part[: chunk.cells]
        else:
            cosines = chunk.along("cos_theta")
            part = part[:, : cosines.stop - cosines.start]
            if "cos_theta" in names and names.index("cos_theta") < names.index("n"):
                part = np.swapaxes(part, 0, 1)
        return np.ascontiguousarray(part, np.float64).reshape(chunk.shape + (() if plan.channels is None else (plan.channels,)))

    count = np.asarray(count, np.int64)
    counts = count[: chunk.cells].reshape(chunk.shape) if count.ndim else np.full(chunk.shape, count)
    return placed(value), placed(error), counts


def _cells(program: Program) -> Callable:
    cell = program.cell()
    return lambda inputs: batched(cell, inputs, inputs[CELL].size, program.batch)


def _table(plan: Plan, program: Program, chunk: Chunk) -> Callable:
    exponents = plan.numbers["n"].values[chunk.along("n")]
    held = {name: float(axis.values[0]) for name, axis in plan.numbers.items() if name not in (*ANGLES, "n")}

    def family(n: Any) -> Any:
        return of_type(program.build(n=n, **held), program.dtype)

    return lambda inputs: albedo_table(family, exponents, inputs["cos_theta"], rtol=program.settings.get("rtol"))
