"""What to sweep over: a TOML file, read and checked before anything heavy is imported.

    brdf = "binomial-power-half"            # a catalogue name, a class of this package, or mine.py:glossy; or a list of them
    precision = ["float32", "float64"]      # optional, like rule and rtol: one value, or a list, which makes an axis

    [axes]
    n = { geomspace = [1, 1000, 400] }      # first, last, how many
    cos_theta = { linspace = [0.05, 1, 90] }
    k = [4, 8, 16]                          # or { list = [...] }
    w = 2                                   # one value: held, no axis

    [chunks]                                # optional
    cos_theta = 30

    [reading]                               # optional, of files, as the options of a command are
    returns = "brdf*cos"                    # and args = "N,L,V", defines = { FAST = 0 }, folders = ["include"]

A rule is "default", the best that the BRDF offers and what `rtol` is for, or a name of `brdfcheck.quadrature.registry`, as it
is or with its setting: "zonal", "gauss-product:64". `seed` (0 by default) is for rules that draw at random.

What is wrong with the file is a `UsageError` in one line that names the place, the value and what is allowed.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Strict, Tag, model_validator

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.readers.table import ReadingTable, as_table
from brdfcheck.documents import Model, read_document, shown, validated
from brdfcheck.messages import UsageError

# What may be an axis besides the parameters of the BRDF, in the order of the store's dimensions.
CHOICES = ("brdf", "rule", "precision", "rtol")
ANGLES = ("cos_theta", "azimuth")
PRECISIONS = ("float64", "float32")
# What must lie between two numbers, and whether these belong to it.
_WITHIN = {"cos_theta": (0.0, 1.0, True), "rtol": (0.0, 1.0, False)}
# Names that the store uses itself.
_RESERVED = frozenset(("albedo", "error", "evaluations", "seconds", "checksum", "channel", "stored_variable"))
_ALIASES = {"exact-azimuth": "zonal"}
_SPACES = {"linspace": np.linspace, "geomspace": np.geomspace}
_MOST = 10_000_000
_EXAMPLE = "as in n = { geomspace = [1, 1000, 400] }, n = [1, 10, 100] or n = 10"


def _plain(value: Any) -> Any:
    if not isinstance(value, int | float | str):
        raise ValueError("must hold numbers, texts or truth values")
    if not isinstance(value, str) and not abs(value) <= sys.float_info.max:
        raise ValueError("the values must be finite")
    return value


def _way(spec: Any) -> str:
    """How an axis is given."""
    return "form" if isinstance(spec, Mapping) else "list" if isinstance(spec, list | tuple) else "one"


_Value = Annotated[Any, AfterValidator(_plain)]
_Values = Annotated[list[_Value], Strict(False), Field(min_length=1, max_length=_MOST)]
_Count = Annotated[int, Field(ge=1, le=_MOST)]
_Positive = Annotated[float, Field(gt=0)]


class _Form(Model):
    """An axis as a table."""

    linspace: Annotated[tuple[float, float, _Count], Strict(False)] | None = None
    geomspace: Annotated[tuple[_Positive, _Positive, _Count], Strict(False)] | None = None
    list: _Values | None = None
    values: _Values | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> _Form:
        if len(self.model_fields_set) != 1:
            raise ValueError(f"must have exactly one of {', '.join(_Form.model_fields)}, {_EXAMPLE}")
        return self


_Axis = Annotated[
    Annotated[_Form, Tag("form")] | Annotated[_Values, Tag("list")] | Annotated[_Value, Tag("one")], Discriminator(_way)
]


class _Document(Model):
    """The keys of the file."""

    brdf: _Axis
    rule: _Axis = "default"
    precision: _Axis = "float64"
    rtol: _Axis | None = None
    seed: int = Field(0, ge=0, lt=2**32)
    axes: dict[str, _Axis] = Field(default_factory=dict)
    chunks: dict[str, Annotated[int, Field(ge=1)]] = Field(default_factory=dict)
    reading: ReadingTable | None = None


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis, or one held value. `values`: floats, integers, strings or truth values; `written`: what the file says.

    The latter in one canonical form. What a plan finds out: `static`, each value has a program of its own, and chunks of one;
    `chunk`, how many values are in a chunk.
    """

    name: str
    values: np.ndarray
    held: bool
    written: Any
    static: bool = False
    chunk: int = 1

    def __len__(self) -> int:
        return len(self.values)

    @property
    def chunks(self) -> int:
        """How many chunks lie along it."""
        return -(-len(self) // self.chunk)


@dataclass(frozen=True)
class Config:
    """A checked configuration.

    `axes`: parameters, angles and settings by name; `chunks`: how many values of an axis are computed together. `seed`: for
    rules that draw at random. `folder`: where the files of users' BRDFs are looked for; `label`: its name in messages.
    `reading`: how these files are read, its folders seen from that one.
    """

    axes: Mapping[str, Axis]
    chunks: Mapping[str, int] = field(default_factory=dict)
    seed: int = 0
    folder: Path = field(default_factory=Path)
    label: str = "config"
    reading: Reading = field(default_factory=Reading)

    def document(self) -> dict[str, Any]:
        """The configuration in one canonical form, ready for JSON; `parse` understands it."""
        choices = {name: self.axes[name].written for name in CHOICES if name in self.axes}
        axes = {name: axis.written for name, axis in self.axes.items() if name not in CHOICES}
        more = {"chunks": dict(self.chunks), "reading": as_table(self.reading)}
        return {**choices, "seed": self.seed, "axes": axes, **{name: table for name, table in more.items() if table}}

    def fail(self, where: str, text: str) -> UsageError:
        """The error to raise for something wrong at `where`."""
        return UsageError(f"{self.label}: {where}: {text}")


def read_config(path: str | Path, reading: Reading | None = None) -> Config:
    """The configuration in a TOML file. UsageError where there is none, or where something in it is wrong.

    `reading`: how files of BRDFs are read, with folders as seen from the working directory, in place of what the file says.
    """
    document, label = read_document(path)
    config = parse(document, folder=Path(path).resolve().parent, label=label)
    if reading is None or reading.is_plain:
        return config
    if not config.reading.is_plain:
        raise UsageError(f"{label}: reading: the options -D, -I, --args and --returns say it, too; leave out one of them")
    seen = tuple(os.path.relpath(part, config.folder) for part in reading.folders)
    return dataclasses.replace(config, reading=dataclasses.replace(reading, folders=seen))


def parse(document: Mapping[str, Any], *, folder: Path | None = None, label: str = "config") -> Config:
    """The configuration in a document with the keys of the TOML file.

    `folder`: where users' files are, the working directory by default; `label`: what messages begin with. UsageError where
    something in the document is wrong.
    """
    given = validated(_Document, document, label)
    specs = [(name, name, getattr(given, name)) for name in CHOICES if getattr(given, name) is not None]
    axes: dict[str, Axis] = {}
    for name, place, spec in (*specs, *((_identifier(key), f"axes.{key}", spec) for key, spec in given.axes.items())):
        try:
            if name in axes or (name in CHOICES and place != name):
                raise ValueError("belongs above [axes]" if name in CHOICES else "is given twice")
            axes[name] = _axis(name, spec)
        except ValueError as error:
            raise UsageError(f"{label}: {place}: {error}") from None
    if "cos_theta" not in axes:
        raise UsageError(f"{label}: axes.cos_theta: is missing, as in cos_theta = {{ linspace = [0.05, 1, 90] }}")
    chunks = {}
    for key, size in given.chunks.items():
        name = _identifier(key)
        if name not in axes or axes[name].held:
            known = ", ".join(axis.name for axis in axes.values() if not axis.held) or "(none)"
            raise UsageError(f"{label}: chunks.{key}: there is no such axis; the axes are {known}")
        chunks[name] = min(size, len(axes[name]))
    reading = Reading() if given.reading is None else given.reading.reading(label)
    return Config(axes, chunks, given.seed, folder or Path(), label, reading)


def _identifier(key: str) -> str:
    return key.replace("-", "_").replace(" ", "_")


def _axis(name: str, spec: Any) -> Axis:
    """An axis from what the document says of it. ValueError where the values do not go together or leave their range."""
    if not all(part.isidentifier() for part in name.split(".")):
        raise ValueError(f"{shown(name)} is not the name of a parameter")
    if name in _RESERVED or name.endswith("_chunk"):
        raise ValueError(f"the store uses the name {name!r} itself; rename the parameter")
    if isinstance(spec, _Form):
        (form,) = spec.model_fields_set
        arguments = getattr(spec, form)
        if form in _SPACES and name in CHOICES and name != "rtol":
            raise ValueError(f"must be a name or a list of names; got {form}")
        if form in _SPACES:
            with np.errstate(all="ignore"):
                values = _SPACES[form](*arguments)
            return Axis(name, _checked(name, values), False, {form: list(arguments)})
        spec = arguments
    held = not isinstance(spec, list)
    values = [spec] if held else spec
    if name in CHOICES and name != "rtol":
        wrong = [value for value in values if not isinstance(value, str) or not value.strip()]
        if wrong:
            raise ValueError(f"must be a name or a list of names; got {shown(wrong[0])}")
        wrong = [value for value in values if name == "precision" and value not in PRECISIONS]
        if wrong:
            raise ValueError(f"unknown precision {shown(wrong[0])}; allowed: {', '.join(PRECISIONS)}")
        values = [_ALIASES.get(value, value) for value in values]
    written = values[0] if held else values
    words = [value for value in values if isinstance(value, str | bool)]
    if words:
        if name in (*ANGLES, "rtol") or len({type(value) for value in values}) > 1:
            raise ValueError(f"must hold numbers; got {shown(words[0])}")
        if len(set(values)) < len(values):
            raise ValueError(f"{shown(next(value for value in values if values.count(value) > 1))} is given twice")
        return Axis(name, np.array(values, np.dtypes.StringDType() if isinstance(words[0], str) else bool), held, written)
    numbers = _checked(name, np.array(values, float))
    if all(isinstance(value, int) for value in values) and name not in (*ANGLES, "rtol"):
        return Axis(name, np.array(values), held, written)
    return Axis(name, numbers, held, float(numbers[0]) if held else numbers.tolist())


def _checked(name: str, values: np.ndarray) -> np.ndarray:
    """The values of an axis, which is an index: one that is there twice could not be selected."""
    if not np.all(np.isfinite(values)):
        raise ValueError("the values must be finite; they overflow")
    found, counts = np.unique(values, return_counts=True)
    if found.size < values.size:
        raise ValueError(f"{found[np.argmax(counts > 1)]:.17g} is given twice")
    low, high, closed = _WITHIN.get(name, (-np.inf, np.inf, True))
    wrong = values[(values < low) | (values > high) if closed else (values <= low) | (values >= high)]
    if wrong.size:
        bounds = f"in [{low:g}, {high:g}]" if closed else f"above {low:g} and below {high:g}"
        raise ValueError(f"must lie {bounds}; got {wrong[0]:g}")
    return values
