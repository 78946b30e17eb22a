"""The parameters of a shader: what can be given from outside, and as which numbers of the family."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from brdfcheck.brdf.family import interval, no_range, not_whole, shown
from brdfcheck.brdf.readers.glsl.arithmetic import convert
from brdfcheck.brdf.readers.glsl.kinds import Scalar, Struct, Type, Vector, kind_of
from brdfcheck.brdf.values import Part
from brdfcheck.messages import UsageError

_COMPONENTS = ("xyzw", "rgba")


@dataclass(frozen=True)
class Knob:
    """A parameter. `bounds`: its range where the file gives one.

    `default`: a number for each component where the file gives any; `plain`: what it is where nothing is said and a file
    gives no range, as colours are white. `idle`: the BRDF does not depend on it. `key`: of a compiled shader, the slot of a
    uniform, or the place of an argument, and for a field of a struct the way to it.
    """

    name: str
    type: Type
    bounds: tuple[float, float] | None = None
    default: tuple[float, ...] | None = None
    plain: tuple[float, ...] | None = None
    idle: bool = False
    key: tuple[str, int, tuple[int, ...]] = ("uniform", 0, ())

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return self.type.leaves

    @property
    def components(self) -> list[tuple[str, int]]:
        """The names under which its components are given, and which one each is."""
        if not isinstance(self.type, Vector):
            return []
        return [(f"{self.name}.{letters[i]}", i) for i in range(self.size) for letters in _COMPONENTS]


def fields_of(kind: Type, name: str, path: tuple[int, ...] = ()) -> list[tuple[str, Type, tuple[int, ...]]] | None:
    """The numbers and vectors of a type, by names as in ``surface.roughness``; None where it holds anything else."""
    if isinstance(kind, (Scalar, Vector)):
        return [(name, kind, path)]
    if not isinstance(kind, Struct):
        return None
    found: list[tuple[str, Type, tuple[int, ...]]] = []
    for place, (field_name, inner) in enumerate(kind.fields):
        parts = fields_of(inner, f"{name}.{field_name}", (*path, place))
        if parts is None:
            return None
        found += parts
    return found


def at_path(value: Any, path: tuple[int, ...]) -> Any:
    """The field of a struct."""
    return value if not path else at_path(value[path[0]], path[1:])


def placed(whole: Any, path: tuple[int, ...], value: Any) -> Any:
    """A struct with another value in one of its fields."""
    if not path:
        return value
    place = path[0]
    return (*whole[:place], placed(whole[place], path[1:], value), *whole[place + 1 :])


@dataclass
class Settings:
    """What the parameters are.

    `parts`: by knob, for each component a number where it is held, the name of the family's parameter where it runs, or None;
    `shown`: what is held, for reports; `defaults`: where those that run start.
    """

    parts: dict[str, list[float | str | None]] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    shown: dict[str, float] = field(default_factory=dict)
    switches: set[str] = field(default_factory=set)
    defaults: dict[str, float] = field(default_factory=dict)

    def values(self, knob: Knob, numbers: Mapping[str, Any]) -> Any:
        """The value of a knob for numbers of the family's parameters."""
        kind = str(kind_of(knob.type))
        leaves = [_leaf(numbers[part] if isinstance(part, str) else part, kind) for part in self.parts[knob.name]]
        return leaves[0] if isinstance(knob.type, Scalar) else tuple(leaves)


def _leaf(number: Any, kind: str) -> Any:
    if isinstance(number, jax.Array):
        number = number.astype(float)
        return number >= 0.5 if kind == "bool" else convert(number, kind)
    value = np.float64(number)
    return np.bool_(value >= 0.5) if kind == "bool" else convert(value, kind)


def names_of(knobs: Iterable[Knob]) -> list[str]:
    """All names that can be given."""
    return [name for knob in knobs for name in (knob.name, *(part for part, _ in knob.components))]


def missing(knobs: Iterable[Knob]) -> list[str]:
    """The knobs that must be given."""
    return [knob.name for knob in knobs if (knob.bounds, knob.default, knob.plain) == (None,) * 3 and not knob.idle]


def settle(knobs: list[Knob], given: Mapping[str, Any], spec: str, no_parameter: Callable[..., str]) -> Settings:
    """What the knobs are for these ranges: (LO, HI) or for a vector a number for each component. UsageError, NoRange."""
    known, sizes = names_of(knobs), {knob.name: knob.size for knob in knobs if isinstance(knob.type, Vector)}
    for name, bounds in given.items():
        if isinstance(bounds, Part) and bounds.vector in sizes and bounds.count != (size := sizes[bounds.vector]):
            raise UsageError(f"{spec}: {bounds.vector} has {size} components; got {bounds.count} numbers")
        if name not in known:
            raise UsageError(no_parameter(spec, name, [knob.name for knob in knobs]))
    settings = Settings()
    absent: list[Knob] = []
    for knob in knobs:
        parts: list[float | str | None] = [*(knob.plain or knob.default or [0.0 if knob.idle else None] * knob.size)]
        settings.parts[knob.name] = parts
        whole = given.get(knob.name, knob.bounds)
        if knob.name in given and isinstance(knob.type, Vector) and len(tuple(given[knob.name])) == knob.size != 2:
            for i, number in enumerate(given[knob.name]):
                parts[i] = interval(f"{knob.name}.{_COMPONENTS[0][i]}", (number, number))[0]
            whole = None
        elif knob.name in given and isinstance(knob.type, Vector) and knob.size == 2 and not _is_range(given[knob.name]):
            raise UsageError(f"{spec}: give {knob.name}.x and {knob.name}.y")
        if whole is not None:
            _settled(settings, knob, knob.name, whole, range(knob.size), spec)
        for part, i in knob.components:
            if part in given:
                _settled(settings, knob, part, given[part], [i], spec)
        if None in parts:
            absent.append(knob)
        elif not (knob.idle and knob.name not in given):
            settings.shown |= _shown(knob, parts)
    if absent:
        raise no_range(spec, [knob.name for knob in absent])
    return settings


def _is_range(bounds: Any) -> bool:
    low, high = bounds
    return low <= high


def _settled(settings: Settings, knob: Knob, name: str, bounds: Any, places: Iterable[int], spec: str) -> None:
    """Hold these components of a knob, or let them run together."""
    low, high = interval(name, bounds)
    kind = kind_of(knob.type)
    if kind in ("int", "uint") and (low != high or low != int(low)):
        raise not_whole(spec, name, (low, high))
    if kind == "bool" and not {low, high} <= {0.0, 1.0}:
        raise UsageError(f"{spec}: {name} is a bool: 0, 1 or 0:1; got {shown((low, high))}")
    for i in places:
        settings.parts[knob.name][i] = low if low == high else name
    if low < high:
        settings.ranges[name] = (low, high)
        if knob.default is not None and low <= knob.default[0] <= high:
            settings.defaults[name] = knob.default[0]
        if kind == "bool":
            settings.switches.add(name)


def _shown(knob: Knob, parts: list[float | str | None]) -> dict[str, float]:
    """A knob by its name where its components are one number, else by those; nothing where any of them runs."""
    numbers = [part for part in parts if isinstance(part, float)]
    if len(numbers) < len(parts):
        return {}
    if len(set(numbers)) == 1:
        return {knob.name: numbers[0]}
    return {f"{knob.name}.{_COMPONENTS[1 if knob.plain else 0][i]}": number for i, number in enumerate(numbers)}
