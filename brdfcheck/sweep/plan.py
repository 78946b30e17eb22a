"""A configuration with its BRDFs: dimensions, chunks, and which program computes which chunk.

Everything here follows from the configuration alone, so that every process that sees the same configuration, on whatever
machine, cuts it into the same chunks and computes each of them by the same program.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import math
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe, of_type
from brdfcheck.brdf.callables import Evaluator, Finding
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.subject import refuse_reading
from brdfcheck.brdf.tables import table_in
from brdfcheck.brdf.ways import Caller
from brdfcheck.messages import UsageError, one_line
from brdfcheck.quadrature.pointwise import TABULATED, PointwiseAlbedo
from brdfcheck.quadrature.registry import engine_of
from brdfcheck.runtime import double_precision
from brdfcheck.sweep import subjects
from brdfcheck.sweep.config import ANGLES, CHOICES, Axis, Config
from brdfcheck.sweep.subjects import DEFAULT, Method, Subject

# Between the bounds of its method a sweep is cut into about this many chunks.
_CHUNKS = 32
# Parts of the exponents up to which tables are made: each is a program.
_PROGRAMS = 16
CELL = "cell index"
"""The name under which a cell's function is given its number: where rules that draw at random begin."""


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

    `config`: the configuration; `places`: where users' files are that are not at their path from its folder. A combination is
    the indices along the static axes, whose values each need a program of their own. `shape` counts cells along each dimension,
    `grid` chunks; `cells` and `chunks` all of them, `chunk_cells` those of a whole chunk of `chunk_shape`.
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
        static = {name for name in config.axes if name in CHOICES or self._is_static(name)}
        self._axes = {name: self._with_whole_numbers(axis) if name in static else axis for name, axis in config.axes.items()}
        self.static = tuple(name for name in self._axes if name in static)
        self.numeric = tuple(name for name in self._axes if name not in static)
        self._parameters = tuple(name for name in self.numeric if name not in ANGLES)
        combinations = list(itertools.product(*(range(len(self._axes[name])) for name in self.static)))
        methods = [self.method(combination) for combination in combinations]
        if "rtol" in config.axes and DEFAULT not in config.axes["rule"].values:
            raise config.fail("rtol", f"is for the rule {DEFAULT!r}; others have a setting, as in adaptive:1e-6")
        channels = {self._channels(combination): self.settings(combination)["brdf"] for combination in combinations}
        if len(channels) > 1:
            shown = ", ".join(f"{name} has {count or 'none'}" for count, name in channels.items())
            raise config.fail("brdf", f"the BRDFs differ in their channels: {shown}")
        (self.channels,) = channels
        self._combinations = combinations
        # The files are known now; what is left is how to cut.
        self.sources = subjects.source_files(self._sources)
        self.dimensions = self._dimensions(methods)
        self.held = tuple(name for name, axis in self._axes.items() if axis.held)
        self.shape = tuple(map(len, self.dimensions))
        self.chunk_shape = tuple(dimension.chunk for dimension in self.dimensions)
        self.grid = tuple(dimension.chunks for dimension in self.dimensions)
        self.cells, self.chunk_cells, self.chunks = map(math.prod, (self.shape, self.chunk_shape, self.grid))

    # --- what is swept ---

    def _is_static(self, name: str) -> bool:
        """True where a parameter is part of the structure of the BRDF: words, truth values, declared whole numbers."""
        values, sources = self.config.axes[name].values, self._sources.values()
        if name in ANGLES:
            return False
        listed = isinstance(values, tuple)
        if listed and isinstance(values[0], str | bool):
            if not all(source.takes_words(name) for source in sources):
                raise self.config.fail(f"axes.{name}", f"must hold numbers; got {values[0]!r}")
            return True
        whole = [source.signature.integers | (source.signature.whole if listed else frozenset()) for source in sources]
        return any(name in names for names in whole)

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
        return np.asarray(values, None if name in self.static else float)

    def settings(self, combination: tuple[int, ...]) -> dict[str, Any]:
        """The static settings and parameters of a combination."""
        values = {name: self._axes[name].values[i] for name, i in zip(self.static, combination, strict=True)}
        return {name: float(value) if isinstance(value, np.floating) else value for name, value in values.items()}

    def dtype(self, combination: tuple[int, ...]) -> np.dtype:
        """The precision of the cells of a combination."""
        return np.dtype(self.settings(combination)["precision"])

    @functools.lru_cache(maxsize=256)  # noqa: B019 - a plan lives as long as its process
    def subject(self, combination: tuple[int, ...]) -> Subject:
        """The BRDF of a combination. UsageError where it does not take the parameters."""
        settings = self.settings(combination)
        parameters = {name: value for name, value in settings.items() if name not in CHOICES}
        ranges = {name: (float(self.values(name).min()), float(self.values(name).max())) for name in self._parameters}
        try:
            return subjects.subject(self._sources[settings["brdf"]], parameters, ranges)
        except UsageError as error:
            raise self.config.fail("axes", str(error)) from None

    @functools.lru_cache(maxsize=256)  # noqa: B019
    def method(self, combination: tuple[int, ...]) -> Method:
        """How the cells of a combination are computed. UsageError where there is no such rule or it does not take the BRDF."""
        settings, template = self.settings(combination), self.subject(combination).template
        example = self._example(combination)
        rtol = settings.get("rtol", None if table_in(example) is None else TABULATED)
        try:
            rule = subjects.rule_of(settings["rule"], rtol, template)
        except ValueError as error:
            raise self.config.fail("rule", str(error)) from None
        if not rule.on_host and not rule.takes(example):
            raise self.config.fail(
                "rule", f"{settings['brdf']} does not fit the rule {settings['rule']!r}, which needs {rule.needs}"
            )
        swept = [name for name in self.numeric if not self._axes[name].held and name != "cos_theta"]
        table = isinstance(template, AbstractZonalLobe) and swept == ["n"]
        table = table and rule == engine_of(template).at(settings.get("rtol"))
        # Not for chunks that the configuration wants to be slivers: each part of the exponents would be a program.
        table = table and len(self._axes["n"]) <= _PROGRAMS * self.config.chunks.get("n", len(self._axes["n"]))
        return subjects.method(rule, template, table=table)

    def _example(self, combination: tuple[int, ...]) -> Any:
        """The BRDF of a combination at the first of all values."""
        with double_precision():
            return self.subject(combination).build(**{name: float(self.values(name)[0]) for name in self._parameters})

    def cell(self, combination: tuple[int, ...]) -> Any:
        """A function of a cell's numbers, by axis and `CELL`, that gives the `Estimate` of the combination's rule."""
        build, dtype, rule = self.subject(combination).build, self.dtype(combination), self.method(combination).rule
        caller = None if isinstance(self._example(combination), AbstractBRDF) else self._caller(combination)

        def cell(numbers: dict[str, Any]) -> Any:
            brdf = build(**{name: numbers[name] for name in self._parameters})
            if isinstance(brdf, AbstractBRDF):
                brdf = of_type(brdf, dtype)
            elif caller is not None:
                brdf = caller.brdf([numbers[name] for name in self._parameters])
                brdf = subjects.turned(brdf, numbers["azimuth"]) if "azimuth" in numbers else brdf
            key = jax.random.key(self.config.seed)
            for part in (numbers[CELL] >> 32, numbers[CELL] & 0xFFFFFFFF):
                key = jax.random.fold_in(key, part.astype(jnp.uint32))
            return rule(brdf, numbers["cos_theta"], key=key if rule.random else None)

        return cell

    def evaluator(self, combination: tuple[int, ...]) -> Evaluator:
        """The BRDF of a combination as the adaptive rule sees it. UsageError where it cannot be evaluated."""
        return self._called(Evaluator, combination)

    @functools.lru_cache(maxsize=256)  # noqa: B019
    def _caller(self, combination: tuple[int, ...]) -> Caller:
        """How the functions of a combination are called: with arrays of directions, or one pair at a time."""
        return self._called(Caller, combination)

    def _called(self, kind: Any, combination: tuple[int, ...]) -> Any:
        middle = {name: float(self.values(name).min() + self.values(name).max()) / 2 for name in self._parameters}
        try:
            with double_precision():
                return kind(self.subject(combination).build, middle)
        except Finding as error:
            raise self.config.fail("brdf", one_line(error)) from error

    def is_table(self, combination: tuple[int, ...]) -> bool:
        """True where the BRDF of a combination is known at samples only."""
        return not self._parameters and table_in(self.subject(combination).build()) is not None

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def samples(self, combination: tuple[int, ...]) -> PointwiseAlbedo:
        """The table of a combination, for its error bars."""
        return PointwiseAlbedo(Family(self.settings(combination)["brdf"], self.subject(combination).build))

    def _channels(self, combination: tuple[int, ...]) -> int | None:
        """How many channels the BRDF of a combination has; None where it gives one number."""
        if self.method(combination).rule.on_host:
            return self.evaluator(combination).channels
        with double_precision():
            shapes: dict[str, Any] = {name: jax.ShapeDtypeStruct((), self.dtype(combination)) for name in self.numeric}
            shapes[CELL] = jax.ShapeDtypeStruct((), np.int64)
            try:
                shape = jax.eval_shape(self.cell(combination), shapes).value.shape
            except Exception as error:
                settings = self.settings(combination)
                text = f"{settings['brdf']} cannot be traced by JAX, which the rule {settings['rule']!r} needs"
                raise self.config.fail("rule", f"{text} ({type(error).__name__}: {one_line(error)})") from None
        return shape[0] if shape else None

    # --- how it is cut ---

    def _dimensions(self, methods: list[Method]) -> tuple[Dimension, ...]:
        least, most = (min(method.cells[i] for method in methods) for i in (0, 1))
        names = [name for name in self.numeric if not self._axes[name].held]
        total = math.prod(len(self._axes[name]) for name in names)
        left = max(1, min(max(total // _CHUNKS, least), most) // (self.channels or 1))
        sizes: dict[str, int] = {}
        # A table is cheapest with all exponents in one chunk: its nodes are paid for once a cosine.
        tables = any(method.table for method in methods)
        order = sorted(names, key=lambda name: name == "n" and tables)
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

    def size(self, cells: int) -> int:
        """Bytes of the results of so many cells."""
        return cells * (16 * (self.channels or 1) + 8)

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
        return tuple(self.along(name, chunk).start for name in self.static)

    def along(self, name: str, chunk: Chunk) -> slice:
        """A chunk's part of an axis."""
        parts = {dimension.name: part for dimension, part in zip(self.dimensions, chunk.slices, strict=True)}
        return parts.get(name, slice(0, 1))

    def program(self, chunk: Chunk) -> tuple[Any, ...]:
        """What the program of a chunk depends on: chunks of one program can be computed side by side."""
        combination = self.combination(chunk)
        # The nodes of a table follow from its exponents.
        return combination, self.along("n", chunk).start if self.method(combination).table else None

    def programs(self) -> Iterator[tuple[tuple[int, ...], tuple[range, ...]]]:
        """For each program in turn, its static indices, and along each dimension which chunks it computes."""
        for combination in self._combinations:
            at = dict(zip(self.static, combination, strict=True))
            places = [range(at[d.name], at[d.name] + 1) if d.static else range(d.chunks) for d in self.dimensions]
            if self.method(combination).table:  # see `program`
                axis = [dimension.name for dimension in self.dimensions].index("n")
                for part in places[axis]:
                    yield combination, (*places[:axis], range(part, part + 1), *places[axis + 1 :])
            else:
                yield combination, tuple(places)

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
                path: {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
                for path, texts in self.sources.items()
            }
        return document
