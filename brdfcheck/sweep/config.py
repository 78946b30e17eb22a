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

A rule is "default", the best that the BRDF offers, or a name of `brdfcheck.quadrature.registry`, as it is or with its setting:
"zonal", "gauss-product:64". `seed` (0 by default) is for rules that draw at random.

What is wrong with the file is a `UsageError` in one line that names the place, the value and what is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from brdfcheck.documents import read_document
from brdfcheck.messages import UsageError, one_line

PRECISIONS = ("float64", "float32")
# What may be an axis besides the parameters of the BRDF, in the order of the store's dimensions.
CHOICES = ("brdf", "rule", "precision", "rtol")
ANGLES = ("cos_theta", "azimuth")
# Names that the store uses itself.
RESERVED = frozenset(("albedo", "error", "evaluations", "seconds", "checksum", "channel", "stored_variable"))
_KEYS = (*CHOICES, "seed", "axes", "chunks")
_ALIASES = {"exact-azimuth": "zonal"}
_SPACES = ("linspace", "geomspace")
_LISTS = ("list", "values")
_MOST = 10_000_000
_EXAMPLE = "as in n = { geomspace = [1, 1000, 400] }, n = [1, 10, 100] or n = 10"


@dataclass(frozen=True)
class Axis:
    """One axis, or one held value. `values`: floats (an array), or integers, strings or truth values (a tuple).

    `written` is what the file says, in one canonical form.
    """

    name: str
    values: Any
    held: bool
    written: Any

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True)
class Config:
    """A checked configuration.

    `seed`: for rules that draw at random. `folder`: where the files of users' BRDFs are looked for; `label`: its name in
    messages.
    """

    axes: Mapping[str, Axis]
    chunks: Mapping[str, int] = field(default_factory=dict)
    seed: int = 0
    folder: Path = field(default_factory=Path)
    label: str = "config"

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the axes that are parameters of the BRDF."""
        return tuple(name for name in self.axes if name not in CHOICES and name not in ANGLES)

    def document(self) -> dict[str, Any]:
        """The configuration in one canonical form, ready for JSON; `parse` understands it."""
        choices = {name: self.axes[name].written for name in CHOICES if name in self.axes}
        axes = {name: axis.written for name, axis in self.axes.items() if name not in CHOICES}
        return {**choices, "seed": self.seed, "axes": axes, **({"chunks": dict(self.chunks)} if self.chunks else {})}

    def fail(self, where: str, text: str) -> UsageError:
        """The error to raise for something wrong at `where`."""
        return _error(self.label, where, text)


def read_config(path: str | Path) -> Config:
    """The configuration in a TOML file. UsageError where there is none, or where something in it is wrong."""
    document, label = read_document(path)
    return parse(document, folder=Path(path).resolve().parent, label=label)


def parse(document: Mapping[str, Any], *, folder: Path | None = None, label: str = "config") -> Config:
    """The configuration in a document with the keys of the TOML file. UsageError where something in it is wrong."""
    unknown = [key for key in document if key not in _KEYS]
    if unknown:
        hint = f"; axes go below [axes], {_EXAMPLE}" if isinstance(document[unknown[0]], (dict, list, int, float)) else ""
        raise _error(label, "", f"unknown key {_shown(unknown[0])}; allowed: {', '.join(_KEYS)}{hint}")
    table = document.get("axes", {})
    if not isinstance(table, Mapping):
        raise _error(label, "axes", f"must be a table, {_EXAMPLE}; got {_shown(table)}")
    specs: dict[str, Any] = {name: document[name] for name in CHOICES if name in document}
    for key, spec in table.items():
        name = key.replace("-", "_").replace(" ", "_")
        if name in specs:
            raise _error(label, f"axes.{key}", "is given twice")
        specs[name] = spec
    if "brdf" not in specs:
        raise _error(label, "", 'no BRDF given: brdf = "NAME", a catalogue name (brdfcheck list) or file.py:object')
    if "cos_theta" not in specs:
        raise _error(label, "axes", "no axis cos_theta, as in cos_theta = { linspace = [0.05, 1, 90] }")
    specs = {"rule": "default", "precision": "float64", **specs}
    order = [*(name for name in CHOICES if name in specs), *(name for name in specs if name not in CHOICES)]
    axes = {name: _axis(label, name, specs[name], f"axes.{name}" if name in table else name) for name in order}
    for value in axes["precision"].values:
        if value not in PRECISIONS:
            raise _error(label, "precision", f"unknown precision {_shown(value)}; allowed: {', '.join(PRECISIONS)}")
    seed = document.get("seed", 0)
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**32:
        raise _error(label, "seed", f"must be a whole number from 0 to {2**32 - 1}; got {_shown(seed)}")
    _check_range(label, axes, "cos_theta", 0, 1)
    if "rtol" in axes and not all(0 < value < 1 for value in axes["rtol"].values):
        wrong = next(value for value in axes["rtol"].values if not 0 < value < 1)
        raise _error(label, "rtol", f"must lie above 0 and below 1; got {wrong:g}")
    return Config(axes, _chunks(label, document.get("chunks", {}), axes), seed, folder or Path(), label)


def _chunks(label: str, table: Any, axes: Mapping[str, Axis]) -> dict[str, int]:
    if not isinstance(table, Mapping):
        raise _error(label, "chunks", f"must be a table of sizes, as in cos_theta = 30; got {_shown(table)}")
    chunks: dict[str, int] = {}
    for key, size in table.items():
        name = key.replace("-", "_").replace(" ", "_")
        if name not in axes or axes[name].held:
            allowed = ", ".join(axis.name for axis in axes.values() if not axis.held)
            raise _error(label, f"chunks.{key}", f"there is no such axis; the axes are {allowed or '(none)'}")
        if isinstance(size, bool) or not isinstance(size, int) or size < 1:
            raise _error(label, f"chunks.{key}", f"must be a whole number, at least 1; got {_shown(size)}")
        chunks[name] = min(size, len(axes[name]))
    return chunks


def _axis(label: str, name: str, spec: Any, where: str) -> Axis:
    if not name.isidentifier():
        raise _error(label, where, f"{_shown(name)} is not the name of a parameter")
    if name in RESERVED or name.endswith("_chunk"):
        raise _error(label, where, f"the store uses the name {name!r} itself; rename the parameter")
    if isinstance(spec, Mapping):
        forms = (*_SPACES, *_LISTS)
        if len(spec) != 1 or next(iter(spec)) not in forms:
            given = ", ".join(map(_shown, spec)) or "nothing"
            raise _error(label, where, f"must have exactly one of {', '.join(forms)}, {_EXAMPLE}; got {given}")
        ((form, arguments),) = spec.items()
        if form in _SPACES:
            if name in CHOICES and name != "rtol":
                raise _error(label, where, f"must be a list of names; got {form}")
            return _space(label, name, form, arguments, f"{where}.{form}")
        if not isinstance(arguments, (list, tuple)):
            raise _error(label, where, f"{form} must be a list; got {_shown(arguments)}")
        return _listed(label, name, list(arguments), where, held=False)
    if isinstance(spec, (list, tuple)):
        return _listed(label, name, list(spec), where, held=False)
    return _listed(label, name, [spec], where, held=True)


def _listed(label: str, name: str, values: list[Any], where: str, *, held: bool) -> Axis:
    if not values:
        raise _error(label, where, "the axis is empty")
    if len(values) > _MOST:
        raise _error(label, where, f"the axis has {len(values)} values; at most {_MOST} are allowed")
    words = [isinstance(value, (str, bool)) for value in values]
    if name in ("brdf", "rule", "precision"):
        wrong = [value for value in values if not isinstance(value, str) or not value.strip()]
        if wrong:
            raise _error(label, where, f"must be a name or a list of names; got {_shown(wrong[0])}")
    if any(words):
        if name in ANGLES or name == "rtol" or not all(type(value) is type(values[0]) for value in values):
            wrong = next(value for value, word in zip(values, words, strict=True) if word)
            raise _error(label, where, f"must hold numbers; got {_shown(wrong)}")
        names = tuple(_ALIASES.get(value, value) if name == "rule" else value for value in values)
        if len(set(names)) < len(names):
            twice = next(value for i, value in enumerate(names) if value in names[:i])
            raise _error(label, where, f"{_shown(twice)} is given twice")
        return Axis(name, names, held, names[0] if held else list(names))
    numbers = [_number(label, value, where) for value in values]
    _refuse_twice(label, where, np.array(numbers))
    if all(isinstance(value, int) for value in values) and name not in ANGLES and name != "rtol":
        return Axis(name, tuple(values), held, values[0] if held else list(values))
    return Axis(name, np.array(numbers), held, numbers[0] if held else numbers)


def _space(label: str, name: str, form: str, arguments: Any, where: str) -> Axis:
    if not isinstance(arguments, (list, tuple)) or len(arguments) != 3:
        raise _error(label, where, f"must be [first, last, how many]; got {_shown(arguments)}")
    first, last = (_number(label, value, where) for value in arguments[:2])
    count = arguments[2]
    if isinstance(count, bool) or not isinstance(count, int) or count < 0:
        raise _error(label, where, f"the number of values must be a whole number; got {_shown(count)}")
    if count == 0:
        raise _error(label, where, "the axis is empty")
    if count > _MOST:
        raise _error(label, where, f"the axis has {count} values; at most {_MOST} are allowed")
    if form == "geomspace" and not (first > 0 and last > 0):
        wrong = first if first <= 0 else last
        raise _error(label, where, f"first and last must be above 0; got {wrong:g}")
    with np.errstate(all="ignore"):
        values = (np.linspace if form == "linspace" else np.geomspace)(first, last, count)
    if not np.all(np.isfinite(values)):
        raise _error(label, where, f"the values must be finite; from {first:g} to {last:g} they overflow")
    _refuse_twice(label, where, values)
    return Axis(name, values, False, {form: [first, last, count]})


def _refuse_twice(label: str, where: str, values: np.ndarray) -> None:
    """An axis is an index: a value that is there twice could not be selected."""
    found, counts = np.unique(values, return_counts=True)
    if found.size < values.size:
        raise _error(label, where, f"{found[np.argmax(counts > 1)]:.17g} is given twice")


def _number(label: str, value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise _error(label, where, f"must hold numbers; got {_shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        raise _error(label, where, f"the number {_shown(value)} is too large") from None
    if not math.isfinite(number):
        raise _error(label, where, f"the values must be finite; got {number:g}")
    return number


def _check_range(label: str, axes: Mapping[str, Axis], name: str, low: float, high: float) -> None:
    values = np.asarray(axes[name].values)
    wrong = values[(values < low) | (values > high)]
    if wrong.size:
        raise _error(label, f"axes.{name}", f"must lie in [{low:g}, {high:g}]; got {wrong[0]:g}")


def _shown(value: Any) -> str:
    text = one_line(repr(value))
    return text if len(text) <= 60 else f"{text[:57]}..."


def _error(label: str, where: str, text: str) -> UsageError:
    return UsageError(f"{label}: {where}: {text}" if where else f"{label}: {text}")
