"""Numbers and ranges of a command line. What is wrong is a `UsageError` in one line: the value, and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Iterable

from brdfcheck.brdf.subject import Range
from brdfcheck.messages import UsageError, one_line


def parse_number(text: str, what: str) -> float:
    """A finite number. UsageError, starting with `what`, otherwise."""
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{what}: {text.strip()!r} is not a number") from None
    if not math.isfinite(value):
        raise UsageError(f"{what}: must be finite; got {text.strip()}")
    return value


def parse_range(text: str, what: str) -> Range:
    """``LO:HI``, or ``V`` for V:V. UsageError, starting with `what`, otherwise."""
    parts = text.split(":")
    if len(parts) > 2 or not all(part.strip() for part in parts):
        raise UsageError(f"{what}: must be LO:HI or a single value; got {text!r}")
    low, high = parse_number(parts[0], what), parse_number(parts[-1], what)
    if low > high:
        raise UsageError(f"{what}: LO must not exceed HI; got {low:g} > {high:g}")
    return low, high


def parse_over(options: Iterable[str]) -> dict[str, Range]:
    """The values of ``--over``: NAME=LO:HI or NAME=V each. UsageError for anything else and for a name given twice."""
    ranges: dict[str, Range] = {}
    for option in options:
        name, equals, bounds = option.partition("=")
        name = name.strip()
        if not equals or not name.isidentifier():
            raise UsageError(f"--over {one_line(option)!r}: must be NAME=LO:HI or NAME=VALUE, as in --over n=1:1000")
        if name in ranges:
            raise UsageError(f"--over {one_line(option)}: the parameter {name!r} is given twice")
        ranges[name] = parse_range(bounds, f"--over {one_line(option)}")
    return ranges


def parse_cosines(text: str | None) -> Range | None:
    """The value of ``--cos-theta``: LO:HI within 0:1."""
    if text is None:
        return None
    low, high = parse_range(text, f"--cos-theta {one_line(text)}")
    if low < 0 or high > 1:
        raise UsageError(f"--cos-theta {one_line(text)}: must lie within 0:1")
    return low, high
