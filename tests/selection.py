"""What of a table of parameters runs every time."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from typing import Any

import pytest


def few(values: Iterable[Any], fast: Container[Any], name: Callable[[Any], Any] | None = None) -> list[Any]:
    """One parameter for each value; those whose name is not among `fast` repeat the kind of one that is: they are slow.

    The name is the value itself, or what `name` makes of it.
    """
    return [
        pytest.param(value, id=None if name is None else str(name(value)), marks=[] if word in fast else [pytest.mark.slow])
        for value in values
        for word in [value if name is None else name(value)]
    ]
