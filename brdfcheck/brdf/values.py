"""What a parameter is given: a range, values that are checked one by one, or the components of a vector."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from brdfcheck.messages import UsageError, written

if TYPE_CHECKING:
    from brdfcheck.brdf.subject import Target

Range = tuple[float, float]


class Values(tuple[float, ...]):
    """Several values of a parameter, each of which is checked by itself."""


class Part(tuple[float, float]):
    """A component of a vector that is held, as a range of no length. `vector`: what that is called, `count`: of how many."""

    vector: str
    count: int


def components(name: str, values: Sequence[float]) -> dict[str, Range]:
    """The components of a vector, as parameters that are held: ``ks.r``, ``ks.g``, ``ks.b``; of two numbers x and y."""
    letters = "rgba" if len(values) > 2 else "xy"
    parts: dict[str, Range] = {}
    for letter, value in zip(letters, values, strict=False):
        part = parts[f"{name}.{letter}"] = Part((value, value))
        part.vector, part.count = name, len(values)
    return parts


def by_value(
    make: Callable[[dict[str, Range]], list[Target]], ranges: Mapping[str, Range | Values], known: Iterable[str]
) -> list[Target]:
    """The targets that `make` makes of ranges, for each value of the parameters that have several `Values`.

    `known`: the names of the parameters: where components of one are among them it is a vector, whose components the values
    are. UsageError where these are too many.
    """
    several = {name: bounds for name, bounds in ranges.items() if isinstance(bounds, Values)}
    held: dict[str, Range] = {name: bounds for name, bounds in ranges.items() if not isinstance(bounds, Values)}
    if not several:
        return make(held)
    parts = set(known)
    for name in [name for name, values in several.items() if components(name, values).keys() & parts]:
        values = several.pop(name)
        if len(values) > 4:
            raise UsageError(f"{name}: a vector has at most 4 components; got {len(values)}")
        held |= components(name, values)
    found: dict[str, Target] = {}
    for place in itertools.product(*several.values()):
        one = {name: (value, value) for name, value in zip(several, place, strict=True)}
        for target in make(held | one):
            family, own = target.family, {**target.family.held, **target.family.ranges}
            called = " ".join((family.name, *(f"{name}={written(low)}" for name, (low, _) in one.items() if name in own)))
            named_so = dataclasses.replace(family, name=called)
            found.setdefault(called, dataclasses.replace(target, family=named_so, entry=family.name))
    return list(found.values())
