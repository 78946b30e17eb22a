"""A configuration with its BRDFs: dimensions, chunks, and which program computes which chunk.

Everything here follows from the configuration alone, so that every process that sees the same configuration, on whatever
machine, cuts it into the same chunks and computes each of them by the same program.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from brdfcheck.messages import UsageError, one_line
from brdfcheck.runtime import double_precision
from brdfcheck.sweep import subjects
from brdfcheck.sweep.cells import channels
from brdfcheck.sweep.config import ANGLES, CHOICES, Axis, Config
from brdfcheck.sweep.subjects import Source, Subject

# Cells of a chunk where the configuration says nothing, (at least, at most), by what a cell costs: some tens of
# nanoseconds, some microseconds, some milliseconds (twice), up to a second. A killed sweep loses some seconds of work.
_CELLS = {
    "table": (20_000, 250_000),
    "zonal": (1_000, 20_000),
    "half-vector": (32, 512),
    "rule": (32, 512),
    "adaptive": (1, 32),
}
# Between those bounds a sweep is cut into about this many chunks.
_CHUNKS = 32
# Parts of the exponents up to which tables are made.
_PROGRAMS = 16
# Bytes of a cell in the store: albedo, error, evaluations.
_CELL_BYTES = 24


@dataclass(frozen=True)
class Dimension:
    """One dimension of the results. `static`: each value has a program of its own, and chunks of one."""

    name: str
    axis: Axis
    static: bool
    chunk: int

    def __len__(self) -> int:
        return len(self.axis)

    @property
    def chunks(self) -> int:
        """How many chunks lie along it."""
        return -(-len(self) // self.chunk)


@dataclass(frozen=True)
class Chunk:
    """One chunk: its number in C order, its place in the grid of chunks, and its part of each dimension."""

    index: int
    place: tuple[int, ...]
    slices: tuple[slice, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(part.stop - part.start for part in self.slices)

    @property
    def cells(self) -> int:
        return math.prod(self.shape)


class Plan:
    """What is to be computed. UsageError where the BRDF and the axes do not fit together.

    `config`: the configuration; `places`: where users' files are that are not at their path from its folder.
    """

    def __init__(self, config: Config, places: Mapping[str, Path] | None = None):
        self.config = config
        modules: dict[str, ModuleType] = {}
        self._sources: dict[str, Source] = {}
        for name in config.axes["brdf"].values:
            try:
                self._sources[name] = subjects.find(name, config.folder, modules, places or {})
            except UsageError as error:
                raise config.fail("brdf", str(error)) from None
        static = {name for name in config.axes if name in CHOICES or self._is_static(name)}
        self._axes = {name: self._with_whole_numbers(axis) if name in static else axis for name, axis in config.axes.items()}
        self.static = tuple(name for name in self._axes if name in static)
        self.numeric = tuple(name for name in self._axes if name not in static)
        engines = {self.engine(combination) for combination in self._combinations()}
        self.channels = self._channels()
        # The programs and files are known now; what is left is how to cut.
        self.sources = subjects.source_files(self._sources)
        self.dimensions = self._dimensions(engines)
        self.held = {name: axis for name, axis in self._axes.items() if axis.held}

    # --- what is swept ---

    def _is_static(self, name: str) -> bool:
        """True where a parameter is part of the structure of the BRDF: words, truth values, declared whole numbers."""
        axis = self.config.axes[name]
        if name in ANGLES:
            return False
        if isinstance(axis.values, tuple) and isinstance(axis.values[0], (str, bool)):
            if any(name in source.numbers for source in self._sources.values()):
                raise self.config.fail(f"axes.{name}", f"must hold numbers; got {axis.values[0]!r}")
            return True
        listed = isinstance(axis.values, tuple)
        return any(name in (source.whole if listed else source.integers) for source in self._sources.values())

    def _with_whole_numbers(self, axis: Axis) -> Axis:
        if isinstance(axis.values, tuple) or axis.name in CHOICES:
            return axis
        wrong = [value for value in axis.values if value != int(value)]
        if wrong:
            raise self.config.fail(f"axes.{axis.name}", f"must be whole numbers; got {wrong[0]:g}")
        return Axis(axis.name, tuple(int(value) for value in axis.values), axis.held, axis.written)

    def values(self, name: str) -> np.ndarray:
        """The values of an axis: float64, int64, booleans or strings."""
        values = self._axes[name].values
        if isinstance(values[0], str):
            return np.array(values, dtype=np.dtypes.StringDType())
        if name not in self.static:
            return np.array([float(value) for value in values])
        return np.array(values)

    def _combinations(self) -> Iterator[tuple[int, ...]]:
        return itertools.product(*(range(len(self._axes[name])) for name in self.static))

    def settings(self, combination: tuple[int, ...]) -> dict[str, Any]:
        """The static settings and parameters behind indices along the static axes."""
        values = {name: self._axes[name].values[i] for name, i in zip(self.static, combination, strict=True)}
        return {name: float(value) if isinstance(value, np.floating) else value for name, value in values.items()}

    @functools.lru_cache(maxsize=256)  # noqa: B019 - a plan lives as long as its process
    def subject(self, combination: tuple[int, ...]) -> Subject:
        """The BRDF with the static parameters at these indices."""
        settings = self.settings(combination)
        parameters = {name: value for name, value in settings.items() if name not in CHOICES}
        ranges = {}
        for name in self.numeric:
            if name not in ANGLES:
                values = self.values(name)
                ranges[name] = (float(values.min()), float(values.max()))
        try:
            return subjects.subject(self._sources[settings["brdf"]], parameters, ranges)
        except UsageError as error:
            raise self.config.fail("axes", str(error)) from None

    @functools.lru_cache(maxsize=256)  # noqa: B019
    def engine(self, combination: tuple[int, ...]) -> str:
        """How cells are computed: "table", "zonal", "half-vector", "adaptive" or "rule"."""
        settings = self.settings(combination)
        rule, offered = settings["rule"], self.subject(combination).engine
        if rule == "default":
            exponents = [name for name in self.numeric if not self._axes[name].held and name not in ANGLES]
            turns = "azimuth" in self.numeric and not self._axes["azimuth"].held
            table = offered == "zonal" and exponents == ["n"] and not turns
            # Each part of the exponents is a program: not for chunks that the configuration wants to be slivers.
            table = table and len(self._axes["n"]) <= _PROGRAMS * self.config.chunks.get("n", _CELLS["table"][1])
            return "table" if table else offered
        if rule == offered or rule.partition(":")[0] == "adaptive":
            self.tolerance(settings)
            return rule.partition(":")[0]
        found, brdf = self.rule(rule), self._example(combination)
        if not found.takes(brdf):
            raise self.config.fail("rule", f"{settings['brdf']} does not fit the rule {rule!r}, which needs {found.needs}")
        return "rule"

    def rule(self, text: str) -> Any:
        """The rule of `brdfcheck.quadrature.closed_form` behind "name" or "name:setting". UsageError where there is none."""
        from brdfcheck.quadrature.registry import RULES

        name, colon, setting = text.partition(":")
        if name not in RULES:
            raise self.config.fail("rule", f"unknown rule {name!r}; allowed: default, {', '.join(RULES)}")
        rule: Any = RULES[name]
        if not colon:
            return rule()
        kind = type(rule.ladder[0])
        try:
            return rule(kind(setting))
        except (TypeError, ValueError) as error:
            example = f"{name}:{rule.ladder[-1]:g}"
            raise self.config.fail("rule", f"the setting of {text!r}: {one_line(error)}; as in {example!r}") from None

    def tolerance(self, settings: Mapping[str, Any]) -> float:
        """What engine 3 aims at: the setting of the rule, else rtol, else 1e-8."""
        setting = settings["rule"].partition(":")[2]
        return self.rule(settings["rule"]).setting if setting else settings.get("rtol", 1e-8)

    def _example(self, combination: tuple[int, ...]) -> Any:
        """The BRDF at the first value of every axis."""
        numbers = {name: float(self.values(name)[0]) for name in self.numeric if name not in ANGLES}
        with double_precision():
            return self.subject(combination).build(**numbers)

    def _channels(self) -> int | None:
        """How many channels the results have; None for scalar BRDFs."""
        found: dict[int | None, Any] = {}
        for combination in self._combinations():
            found.setdefault(channels(self, combination), self.settings(combination)["brdf"])
        if len(found) > 1:
            shown = ", ".join(f"{name} has {count or 'none'}" for count, name in found.items())
            raise self.config.fail("brdf", f"the BRDFs differ in their channels: {shown}")
        return next(iter(found))

    # --- how it is cut ---

    def _dimensions(self, engines: set[str]) -> tuple[Dimension, ...]:
        least, most = (min(_CELLS[engine][i] for engine in engines) for i in (0, 1))
        names = [name for name in self.numeric if not self._axes[name].held]
        total = math.prod(len(self._axes[name]) for name in names)
        left = max(1, min(max(total // _CHUNKS, least), most) // (self.channels or 1))
        sizes: dict[str, int] = {}
        # A table is cheapest with all exponents in one chunk: its nodes are paid for once a cosine.
        order = sorted(names, key=lambda name: name == "n" and "table" in engines)
        for name in reversed(order):
            sizes[name] = self.config.chunks.get(name, min(left, len(self._axes[name])))
            left = max(1, left // sizes[name])
        dimensions = []
        for name, axis in self._axes.items():
            if axis.held:
                continue
            if name in self.static and self.config.chunks.get(name, 1) != 1:
                raise self.config.fail(f"chunks.{name}", f"must be 1: each value of {name} has a program of its own")
            dimensions.append(Dimension(name, axis, name in self.static, sizes.get(name, 1)))
        return tuple(dimensions)

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(dimension) for dimension in self.dimensions)

    @property
    def grid(self) -> tuple[int, ...]:
        """How many chunks lie along each dimension."""
        return tuple(dimension.chunks for dimension in self.dimensions)

    @property
    def chunk_shape(self) -> tuple[int, ...]:
        return tuple(dimension.chunk for dimension in self.dimensions)

    @property
    def cells(self) -> int:
        return math.prod(self.shape)

    @property
    def chunks(self) -> int:
        return math.prod(self.grid)

    @property
    def chunk_cells(self) -> int:
        return math.prod(self.chunk_shape)

    def size(self, cells: int) -> int:
        """Bytes of the results of so many cells."""
        return cells * (_CELL_BYTES if self.channels is None else 16 * self.channels + 8)

    def chunk(self, index: int) -> Chunk:
        """The chunk of that number, in C order."""
        place = tuple(int(i) for i in np.unravel_index(index, self.grid)) if self.grid else ()
        slices = tuple(
            slice(i * dimension.chunk, min((i + 1) * dimension.chunk, len(dimension)))
            for i, dimension in zip(place, self.dimensions, strict=True)
        )
        return Chunk(index, place, slices)

    def combination(self, chunk: Chunk) -> tuple[int, ...]:
        """The indices of a chunk along the static axes."""
        starts = {dimension.name: part.start for dimension, part in zip(self.dimensions, chunk.slices, strict=True)}
        return tuple(starts.get(name, 0) for name in self.static)

    def program(self, chunk: Chunk) -> tuple[Any, ...]:
        """What the program of a chunk depends on: chunks of one program can be computed side by side."""
        combination = self.combination(chunk)
        if self.engine(combination) != "table":
            return combination, None
        # The nodes of a table follow from its exponents.
        place = dict(zip((dimension.name for dimension in self.dimensions), chunk.slices, strict=True))["n"]
        return combination, (place.start, place.stop)

    def programs(self) -> Iterator[tuple[tuple[int, ...], tuple[range, ...]]]:
        """For each program in turn, its static indices, and along each dimension which chunks it computes."""
        for combination in self._combinations():
            at = dict(zip(self.static, combination, strict=True))
            places = [range(at[d.name], at[d.name] + 1) if d.static else range(d.chunks) for d in self.dimensions]
            names = [dimension.name for dimension in self.dimensions]
            if self.engine(combination) != "table":
                yield combination, tuple(places)
                continue
            axis = names.index("n")
            for part in places[axis]:  # see `program`
                yield combination, (*places[:axis], range(part, part + 1), *places[axis + 1 :])

    def cells_of(self, places: tuple[range, ...]) -> int:
        """How many cells the chunks at these places have, counted along each dimension."""
        ends = [(p[0] * d.chunk, min((p[-1] + 1) * d.chunk, len(d))) for p, d in zip(places, self.dimensions, strict=True)]
        return math.prod(last - first for first, last in ends)

    def missing(self, done: Container[int]) -> Iterator[Chunk]:
        """The chunks whose numbers are not in `done`, program by program. Holds none of them."""
        for _, places in self.programs():
            for place in itertools.product(*places):
                index = int(np.ravel_multi_index(place, self.grid)) if place else 0
                if index not in done:
                    yield self.chunk(index)

    def waves(self, chunks: Iterable[Chunk], width: int) -> Iterator[list[Chunk]]:
        """The chunks, in program order, at most `width` at a time, and only such as share a program."""
        for _, group in itertools.groupby(chunks, self.program):
            while wave := list(itertools.islice(group, width)):
                yield wave

    # --- what a process elsewhere needs ---

    def document(self) -> dict[str, Any]:
        """Everything that the results depend on besides versions, ready for JSON."""
        document = self.config.document()
        document["chunks"] = {dimension.name: dimension.chunk for dimension in self.dimensions}
        document["dimensions"] = [dimension.name for dimension in self.dimensions]
        if self.sources:
            document["files"] = {
                path: {name: subjects.digest(text) for name, text in texts.items()} for path, texts in self.sources.items()
            }
        return document
