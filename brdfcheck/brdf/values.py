"""What a parameter is given: a range, values that are checked one by one, or the components of a vector. Imports nothing."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

Range = tuple[float, float]


class Values(tuple[float, ...]):
    """Several values of a parameter, each of which is checked by itself."""


def components(name: str, values: Sequence[float]) -> dict[str, Range]:
    """The components of a vector, as parameters that are held: ``ks.r``, ``ks.g``, ``ks.b``; of two numbers x and y."""
    letters = "rgba" if len(values) > 2 else "xy"
    return {f"{name}.{letter}": (value, value) for letter, value in zip(letters, values, strict=False)}
