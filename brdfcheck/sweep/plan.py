"""A configuration with its BRDFs: dimensions, chunks, and which program computes which chunk.

Everything here follows from the configuration alone, so that every process that sees the same configuration, on whatever
machine, cuts it into the same chunks and computes each of them by the same program.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from brdfcheck.brdf.readers.base import refuse_reading
from brdfcheck.messages import UsageError
from brdfcheck.sweep import subjects
from brdfcheck.sweep.config import ANGLES, CHOICES, Axis, Config
from brdfcheck.sweep.program import DEFAULT, Program

# Between the bounds of its programs a sweep is cut into about this many chunks.
_CHUNKS = 32


@dataclass(frozen=True)
class Chunk:
    """One chunk: its number in C order, its place in the grid of chunks, and its part of each dimension, by name."""

    index: int
    place: tuple[int, ...]
    parts: Mapping[str, slice]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(part.stop - part.start for part in self.parts.values())

    @property
    def cells(self) -> int:
        return math.prod(self.shape)

    def along(self, name: str) -> slice:
        """Its part of any axis, held ones included."""
        return self.parts.get(name, slice(0, 1))


class Plan:
    """What is to be computed. UsageError where the BRDF and the axes do not fit together.

    `config`: the configuration; `places`: where users' files are that are not at their path from its folder. `held`: the axes
    given as one value; `dimensions`: all others; `numbers`: those of either whose values a program takes. `shape` counts cells
    along each dimension, `grid` chunks; `cells` and `chunks` all of them, `chunk_cells` those of a whole `chunk_shape`.
    """

    def __init__(self, config: Config, places: Mapping[str, Path] | None = None):
        self.config = config
        modules: dict[str, ModuleType] = {}
        try:
            self._sources = {
                name: subjects.find(name, config.folder, modules, places or {}, config.reading)
                for name in config.axes["brdf"].values
            }
            refuse_reading(config.reading, {name: source.value for name, source in self._sources.items()})
        except UsageError as error:
            raise config.fail("brdf", str(error)) from None
        axes = [self._settled(axis) for axis in config.axes.values()]
        self.numbers = {axis.name: axis for axis in axes if not axis.static}
        self._static = {axis.name: axis.values.tolist() for axis in axes if axis.static}
        self._programs: dict[tuple[int, ...], Program] = {}
        for place in itertools.product(*(range(len(values)) for values in self._static.values())):
            settings = {name: values[i] for (name, values), i in zip(self._static.items(), place, strict=True)}
            self._programs[place] = Program(config, self._sources[settings["brdf"]], place, settings, self.numbers)
        if "rtol" in config.axes and DEFAULT not in self._static["rule"]:
            raise config.fail("rtol", f"is for the rule {DEFAULT!r}; others have a setting, as in adaptive:1e-6")
        channels = {program.channels(): program.settings["brdf"] for program in self._programs.values()}
        if len(channels) > 1:
            shown = ", ".join(f"{name} has {count or 'none'}" for count, name in channels.items())
            raise config.fail("brdf", f"the BRDFs differ in their channels: {shown}")
        (self.channels,) = channels
        # The files are known now; what is left is how to cut.
        self.sources = subjects.source_files(self._sources)
        self.held = tuple(axis for axis in axes if axis.held)
        self.dimensions = self._cut([axis for axis in axes if not axis.held])
        self.numbers |= {axis.name: axis for axis in self.dimensions if not axis.static}
        self.shape = tuple(map(len, self.dimensions))
        self.chunk_shape = tuple(axis.chunk for axis in self.dimensions)
        self.grid = tuple(axis.chunks for axis in self.dimensions)
        self.cells, self.chunk_cells, self.chunks = map(math.prod, (self.shape, self.chunk_shape, self.grid))

    def _settled(self, axis: Axis) -> Axis:
        """The axis with its values as the BRDFs take them.

        Words, truth values and declared whole numbers are part of the structure of a BRDF: they are static, as choices are.
        """
        name, values, sources = axis.name, axis.values, self._sources.values()
        if name in CHOICES:
            return replace(axis, static=True)
        if isinstance(values[0], str | np.bool):
            if not all(source.takes_words(name) for source in sources):
                raise self.config.fail(f"axes.{name}", f"must hold numbers; got {values.tolist()[0]!r}")
            return replace(axis, static=True)
        listed = values.dtype.kind != "f"
        whole = [source.signature.integers | (source.signature.whole if listed else frozenset()) for source in sources]
        if name in ANGLES or not any(name in names for names in whole):
            return replace(axis, values=values.astype(float))
        wrong = [value for value in values.tolist() if value != int(value)]
        if wrong:
            raise self.config.fail(f"axes.{name}", f"must be whole numbers; got {wrong[0]:g}")
        return replace(axis, values=np.array([int(value) for value in values.tolist()]), static=True)

    # --- how it is cut ---

    def _cut(self, axes: list[Axis]) -> tuple[Axis, ...]:
        """The axes with their chunks."""
        programs = self._programs.values()
        least, most = (min(program.cells[i] for program in programs) for i in (0, 1))
        free = [axis for axis in axes if not axis.static]
        left = max(1, min(max(math.prod(map(len, free)) // _CHUNKS, least), most) // (self.channels or 1))
        sizes: dict[str, int] = {}
        # A table is cheapest with all exponents in one chunk: its nodes are paid for once a cosine.
        tables = any(program.table for program in programs)
        for axis in sorted(free, key=lambda axis: axis.name == "n" and tables)[::-1]:
            sizes[axis.name] = self.config.chunks.get(axis.name, min(left, len(axis)))
            left = max(1, left // sizes[axis.name])
        for axis in axes:
            if axis.static and self.config.chunks.get(axis.name, 1) != 1:
                raise self.config.fail(f"chunks.{axis.name}", f"must be 1: each value of {axis.name} has a program of its own")
        return tuple(replace(axis, chunk=sizes.get(axis.name, 1)) for axis in axes)

    def size(self, cells: int) -> int:
        """Bytes of the results of so many cells."""
        return cells * (16 * (self.channels or 1) + 8)

    def chunk(self, index: int) -> Chunk:
        """The chunk of that number, in C order."""
        return self.at(tuple(int(i) for i in np.unravel_index(index, self.grid)) if self.grid else ())

    def at(self, place: tuple[int, ...]) -> Chunk:
        """The chunk at that place in the grid of chunks."""
        parts = {
            axis.name: slice(i * axis.chunk, min((i + 1) * axis.chunk, len(axis)))
            for i, axis in zip(place, self.dimensions, strict=True)
        }
        return Chunk(int(np.ravel_multi_index(place, self.grid)) if place else 0, place, parts)

    def program(self, chunk: Chunk) -> Program:
        """What computes a chunk."""
        return self._programs[tuple(chunk.along(name).start for name in self._static)]

    def compiled(self, chunk: Chunk) -> tuple[Any, ...]:
        """What is compiled for a chunk depends on this: chunks that share it can be computed side by side."""
        program = self.program(chunk)
        # The nodes of a table follow from its exponents.
        return program.place, chunk.along("n").start if program.table else None

    def pieces(self) -> Iterator[tuple[Program, tuple[range, ...]]]:
        """For all that is compiled in turn, its program, and along each dimension which chunks it computes."""
        for program in self._programs.values():
            at = dict(zip(self._static, program.place, strict=True))
            places = [range(at[a.name], at[a.name] + 1) if a.static else range(a.chunks) for a in self.dimensions]
            if program.table:  # see `compiled`
                axis = [axis.name for axis in self.dimensions].index("n")
                for part in places[axis]:
                    yield program, (*places[:axis], range(part, part + 1), *places[axis + 1 :])
            else:
                yield program, tuple(places)

    def cells_of(self, places: tuple[range, ...]) -> int:
        """How many cells the chunks at these places have, counted along each axis."""
        ends = [(p[0] * d.chunk, min((p[-1] + 1) * d.chunk, len(d))) for p, d in zip(places, self.dimensions, strict=True)]
        return math.prod(last - first for first, last in ends)

    def missing(self, done: Container[int]) -> Iterator[Chunk]:
        """The chunks whose numbers are not in `done`, in the order of `pieces`. Holds none of them."""
        for _, places in self.pieces():
            yield from (chunk for chunk in map(self.at, itertools.product(*places)) if chunk.index not in done)

    def waves(self, chunks: Iterable[Chunk], width: int) -> Iterator[list[Chunk]]:
        """The chunks, in that order, at most `width` at a time, and only such as share what is compiled."""
        for _, group in itertools.groupby(chunks, self.compiled):
            while wave := list(itertools.islice(group, width)):
                yield wave

    # --- what a process elsewhere needs ---

    def document(self) -> dict[str, Any]:
        """Everything that the results depend on besides versions, ready for JSON."""
        document = self.config.document()
        document["chunks"] = {axis.name: axis.chunk for axis in self.dimensions}
        document["dimensions"] = [axis.name for axis in self.dimensions]
        if self.sources:
            document["files"] = {
                path: {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
                for path, texts in self.sources.items()
            }
        return document
