"""What is wrong with a shader file, as a compiler says it: file, line, column, one line of words."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import NamedTuple

from brdfcheck.messages import UsageError, one_line


class Position(NamedTuple):
    """A place in a file; lines and columns count from 1. A line of 0 stands for the file as a whole."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}" if self.line else self.file


class ShaderError(UsageError):
    """A mistake in a shader, or something in it that has no meaning for one pair of directions. The message is one line."""


def mistake(position: Position, message: str) -> ShaderError:
    """What is wrong at a place, to be raised."""
    return ShaderError(f"{one_line(position)}: error: {one_line(message)}")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A hint at the nearest of the known names, or nothing."""
    near = get_close_matches(name, sorted(set(known)), 1, 0.75)
    return f"; did you mean {near[0]!r}?" if near else ""
