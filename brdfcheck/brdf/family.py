"""A family of BRDFs: how to build one from its parameters, and the ranges the parameters run over."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from brdfcheck.brdf.values import Part
from brdfcheck.messages import UsageError


class NoRange(UsageError):
    """Parameters that have no range. `names`: theirs."""

    def __init__(self, message: str, names: Iterable[str]):
        super().__init__(message)
        self.names = tuple(names)


@dataclass(frozen=True)
class Family:
    """``build(**parameters)`` gives a BRDF for parameters within `ranges` (closed intervals) and cosines within `cos_theta`.

    `held`: parameters that `build` holds itself, so that reports can name them. `switches`: parameters that take the two ends
    of their range and nothing between. `defaults`: what parameters are where one member of the family is wanted and nothing is
    said, by default the low ends of their ranges. `pointwise`: builds what owes reciprocity, where `build` holds more than
    that (what is transmitted, deltas). `surface`: of what transmits, builds the BSDF of which `build` makes what is lit from
    one side; `pointwise` is then on the whole sphere. `tolerance`: how far above 1 an albedo may lie where nothing is said;
    `notes`: what every report on it says. Raises ValueError where a bound is not finite or an interval is empty.
    """

    name: str
    build: Callable[..., Any]
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    cos_theta: tuple[float, float] = (0.0, 1.0)
    held: Mapping[str, float] = field(default_factory=dict)
    switches: frozenset[str] = frozenset()
    defaults: Mapping[str, float] = field(default_factory=dict)
    pointwise: Callable[..., Any] | None = None
    surface: Callable[..., Any] | None = None
    tolerance: float = 1e-9
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, bounds in {**self.ranges, "cos_theta": self.cos_theta}.items():
            interval(name, bounds)
        if not 0 <= self.cos_theta[0] <= self.cos_theta[1] <= 1:
            raise UsageError(f"cos_theta must run within 0:1; got {self.cos_theta[0]:g}:{self.cos_theta[1]:g}")


def interval(name: str, bounds: Any) -> tuple[float, float]:
    """The range of a parameter as two numbers. UsageError where it is not that, not finite or empty."""
    try:
        low, high = (float(bound) for bound in bounds)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the range of {name} must be two numbers (LO, HI); got {bounds!r}") from error
    if not (math.isfinite(low) and math.isfinite(high)):
        raise UsageError(f"the range of {name} must be finite; got {low:g}:{high:g}")
    if low > high:
        raise UsageError(f"the range of {name} is empty: {low:g} > {high:g}")
    return bounds if isinstance(bounds, Part) else (low, high)


def not_whole(name: str, parameter: str, bounds: tuple[float, float]) -> UsageError:
    """What is said of a whole number that is given a range or a fraction, to be raised."""
    return UsageError(f"{name}: {parameter} is a whole number: give one, as in --over {parameter}=2; got {shown(bounds)}")


def shown(bounds: tuple[float, float]) -> str:
    """A range as one gives it: LO:HI, or a number."""
    return ":".join(f"{bound:g}" for bound in dict.fromkeys(bounds))


def no_range(name: str, parameters: Sequence[str], advice: str = "") -> NoRange:
    """What is said of parameters that have no range and need one, to be raised."""
    plural = "parameters" if len(parameters) > 1 else "parameter"
    example = " ".join(f"--over {parameter}=LO:HI" for parameter in parameters)
    python = ", ".join(f"{parameter}=(LO, HI)" for parameter in parameters)
    words = f"the {plural} {', '.join(parameters)} must be given a range: {example}, in Python {python}{advice}"
    return NoRange(f"{name}: {words}", parameters)


def corners(bounds: Iterable[Iterable[float]], most: int) -> list[tuple[float, ...]]:
    """The corners of a box: all of them, or where these are more than `most` so many, drawn from all, opposite ones first."""
    ends = [tuple(dict.fromkeys(pair)) for pair in bounds]
    total = math.prod(map(len, ends))
    if total <= most:
        return list(product(*ends))
    numbers = [0, total - 1, *random.Random(0).sample(range(1, total - 1), most - 2)]
    found = []
    for number in numbers:
        corner = []
        for pair in ends:
            number, which = divmod(number, len(pair))
            corner.append(pair[which])
        found.append(tuple(corner))
    return found


def examples(ranges: Sequence[tuple[float, float]]) -> list[tuple[float, ...]]:
    """Where a family is asked for what it is: in the middle, off it and at corners (somewhere it may be nothing at all)."""
    inside = [tuple((1 - part) * low + part * high for low, high in ranges) for part in (0.5, 0.37)]
    drawn = random.Random(5)
    tilted = [tuple(drawn.uniform(low, high) for low, high in ranges) for _ in range(12)]
    return list(dict.fromkeys([*inside, *tilted, *corners(ranges, 64)]))


@dataclass(frozen=True)
class Refusal:
    """Why a family cannot be built at a corner of its box. `ours`: one of this package's classes refused the values."""

    parameters: Mapping[str, float]
    error: BaseException
    ours: bool


# At how many corners a family is built before it is asked for more.
_CORNERS = 64
# Modules that call a family's factory: what goes wrong in the call itself is no refusal of a lobe.
_CALLERS = frozenset(("brdfcheck.brdf.family", "brdfcheck.brdf.subject"))


def refusal(family: Family) -> Refusal | None:
    """Build the family at the corners of its box: a lobe's own checks see numbers there, and tracers later."""
    for corner in corners(family.ranges.values(), _CORNERS):
        parameters = dict(zip(family.ranges, corner, strict=True))
        try:
            family.build(**parameters)
        except (Exception, SystemExit) as error:
            last = error.__traceback__
            while last is not None and last.tb_next is not None:
                last = last.tb_next
            module = "" if last is None else str(last.tb_frame.f_globals.get("__name__", ""))
            return Refusal(parameters, error, module.startswith("brdfcheck.") and module not in _CALLERS)
    return None
