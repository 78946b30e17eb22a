"""Words of a command line that are more than a number or a choice: what each may be, and in one line what is wrong with it.

Each function but `file` is a `parser` of typer: it takes the text and returns the value, or raises `typer.BadParameter`, to
which the name of the option is added where the command ends. Imports nothing heavy: a mistyped word is answered at once.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from typer import BadParameter, Option

from brdfcheck.brdf.values import Range, Values, components
from brdfcheck.messages import UsageError, one_line

MOST_PIXELS = 8192  # samples along a side of a picture


class Interval(NamedTuple):
    """A closed interval."""

    low: float
    high: float


class Setting(NamedTuple):
    """A parameter of a BRDF, and what it runs over."""

    name: str
    bounds: Interval


class Components(NamedTuple):
    """A parameter that is a vector, and the numbers at which its components are held."""

    name: str
    values: tuple[float, ...]


class Exponents(NamedTuple):
    """A range of exponents, or a few of them and the range they span."""

    bounds: Interval
    values: tuple[float, ...] | None


class Size(NamedTuple):
    """Pixels of a picture."""

    height: int
    width: int


def number(text: str) -> float:
    """A finite number. BadParameter otherwise."""
    try:
        value = float(text)
    except ValueError:
        raise BadParameter(f"{one_line(text)!r} is not a number") from None
    if not math.isfinite(value):
        raise BadParameter(f"must be finite; got {one_line(text)}")
    return value


def interval(text: str) -> Interval:
    """``LO:HI``, or ``VALUE`` for VALUE:VALUE. BadParameter otherwise."""
    parts = text.split(":")
    if len(parts) > 2 or not all(part.strip() for part in parts):
        raise BadParameter(f"must be LO:HI or a single value; got {one_line(text)!r}")
    low, high = number(parts[0]), number(parts[-1])
    if low > high:
        raise BadParameter(f"LO must not exceed HI; got {low:g} > {high:g}")
    return Interval(low, high)


def within(least: float, most: float = math.inf) -> Callable[[str], Interval]:
    """The parser of an `interval` within these bounds."""

    def parse(text: str) -> Interval:
        bounds = interval(text)
        if bounds.low < least or bounds.high > most:
            allowed = f"within {least:g}:{most:g}" if math.isfinite(most) else f"at {least:g} or above"
            raise BadParameter(f"must lie {allowed}; got {one_line(text)}")
        return bounds

    return parse


def exponent_list(text: str) -> Exponents:
    """``LO:HI``, or a list as in ``1,10,100``. BadParameter otherwise."""
    if "," not in text:
        return Exponents(interval(text), None)
    values = tuple(dict.fromkeys(map(number, text.split(","))))
    return Exponents(Interval(min(values), max(values)), values)


def setting(text: str) -> Setting | Components:
    """``NAME=LO:HI`` or ``NAME=VALUE``; for a vector ``NAME=R,G,B``, or ``NAME.r=VALUE``. BadParameter otherwise."""
    name, equals, bounds = text.partition("=")
    if not equals or not all(part.isidentifier() for part in name.strip().split(".")):
        raise BadParameter(f"must be NAME=LO:HI or NAME=VALUE, as in n=1:1000; got {one_line(text)!r}")
    try:
        if "," in bounds and ":" not in bounds:
            return Components(name.strip(), tuple(map(number, bounds.split(","))))
        return Setting(name.strip(), interval(bounds))
    except BadParameter as error:
        raise BadParameter(f"{one_line(text)}: {error.message}") from None


def open_setting(text: str) -> Setting | Components:
    """A `setting` whose upper end may be ``inf``. BadParameter otherwise."""
    if not text.endswith(":inf"):
        return setting(text)
    name, (low, _) = setting(text.removesuffix(":inf"))
    return Setting(name, Interval(low, math.inf))


def together(settings: Iterable[Setting | Components] | None, *, lists: bool = False, option: str = "--over") -> dict[str, Any]:
    """The parameters and their ranges; a vector by its components. UsageError, naming the option, where one is given twice.

    `lists`: what may be a vector may also be a list of values, which the BRDF has to tell: it stays one, as `Values`.
    """
    ranges: dict[str, Range | Values] = {}
    pairs: list[tuple[str, Range | Values]] = []
    for item in settings or ():
        if isinstance(item, Setting):
            pairs.append((item.name, item.bounds))
        elif lists:
            pairs.append((item.name, Values(item.values)))
        elif len(item.values) > 4:
            raise UsageError(f"{option} {item.name}: a vector has at most 4 components; got {len(item.values)}")
        else:
            pairs += components(item.name, item.values).items()
    for name, bounds in pairs:
        if name in ranges:
            raise UsageError(f"{option}: the parameter {name!r} is given twice")
        ranges[name] = bounds
    return ranges


def macro(text: str) -> tuple[str, str]:
    """``NAME`` or ``NAME=VALUE`` of a macro; without a value it is 1. BadParameter otherwise."""
    name, equals, value = text.partition("=")
    if not (name.isascii() and name.isidentifier()):
        raise BadParameter(f"must be NAME or NAME=VALUE; got {one_line(text)!r}")
    return name, value if equals else "1"


def share(text: str) -> float:
    """A number from 0 to 1, or a fraction as in ``0.5/255``. BadParameter otherwise."""
    parts = [number(part) for part in text.split("/")]
    whole = parts[1] if len(parts) == 2 else 1.0
    if len(parts) > 2 or whole == 0 or not 0 <= parts[0] / whole <= 1:
        raise BadParameter(f"must be a number from 0 to 1 or a fraction, as in 0.5/255; got {one_line(text)!r}")
    return parts[0] / whole


def size(text: str) -> Size:
    """A side of a square, as in ``512``, or height and width, as in ``384x512``. BadParameter otherwise."""
    parts = text.lower().split("x")
    if len(parts) < 3 and all(part.isascii() and part.isdigit() for part in parts):
        sides = Size(int(parts[0][:9]), int(parts[-1][:9]))
        if min(sides) >= 1 and max(sides) <= MOST_PIXELS:
            return sides
    raise BadParameter(f"must be SIDE or HEIGHTxWIDTH, whole numbers from 1 to {MOST_PIXELS}; got {one_line(text)!r}")


def file(*names: str, help: str, ends: tuple[str, ...], bare: bool = False, stdout: bool = False) -> Any:
    """The option of these names for a file to write, which ends in one of `ends`; `stdout`: it may be "-".

    `bare`: the ending does not choose the format, and a name may have none.
    """
    wanted = " or ".join(filter(None, (", ".join(ends[:-1]), *ends[-1:])))

    def parse(text: str) -> str:
        if stdout and text == "-":
            return text
        ending = Path(text).suffix.lower()
        if ending not in ends and not (bare and not ending):
            raise BadParameter(f"must end in {wanted}; got {one_line(text)!r}")
        trouble = trouble_with(text)
        if trouble:
            raise BadParameter(trouble)
        return text

    return Option(*names, metavar="FILE", parser=parse, help=help)


def trouble_with(path: str) -> str | None:
    """Why nothing can be written to this file, or None."""
    from brdfcheck.output.records import refuse_output

    try:
        trouble = "give the name of a file" if path == "-" else refuse_output(path)
    except ValueError as error:  # no name of any file
        trouble = str(error)
    return f"cannot write {one_line(path)!r}: {one_line(trouble)}" if trouble else None


def refuse_same(outputs: Mapping[str, str | None]) -> None:
    """UsageError where two of the options {option: path} name the same file, or both of them standard output."""
    seen: dict[str, str] = {}
    for option, path in outputs.items():
        if path is None:
            continue
        first = seen.setdefault(path if path == "-" else os.path.realpath(path), option)
        if first != option:
            raise UsageError(f"{first} and {option} cannot both write to {'standard output' if path == '-' else path}")
