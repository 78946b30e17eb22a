"""What messages are made of. Imports next to nothing, so that a mistyped command is answered at once."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class UsageError(ValueError):
    """What the user typed cannot be done. The message is one line that names the value and what is allowed."""


class UnknownName(UsageError, KeyError):
    """There is nothing of that name. The message names the nearest ones."""

    __str__ = Exception.__str__  # a KeyError shows its message in quotes


class SweepError(Exception):
    """The machine or the store stands in the way: disk full, a damaged store, a lost cluster. One line that says what to do.

    What is already in the store stays there.
    """


def one_of(value: Any, allowed: Iterable[str], name: str) -> Any:
    """`value` itself; ValueError, which names what is allowed, where it is none of that."""
    if value not in (known := tuple(allowed)):
        raise ValueError(f"{name} must be one of {', '.join(known)}; got {value!r}")
    return value


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "", *, most: int = 2, cutoff: float = 0.4) -> str:
    """A question that names at most so many of the known names that resemble this one; `otherwise` where none does."""
    import difflib

    near = difflib.get_close_matches(name, tuple(known), most, cutoff)
    return f"did you mean {' or '.join(filter(None, (', '.join(near[:-1]), near[-1])))}?" if near else otherwise


def written(value: float) -> str:
    """The number as one would type it, with all of its digits."""
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def one_line(text: object) -> str:
    """`text` on one line and without control characters, so that it can be part of a message.

    Bytes of the command line that the locale's encoding lacks are read as UTF-8, else shown as numbers.
    """
    words = " ".join(_readable(str(text)).split())
    return "".join(character for character in words if character.isprintable())


def _readable(text: str) -> str:
    """`text` without the surrogates that Python makes of such bytes."""
    try:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # surrogates of another origin
        return text.encode("utf-8", "backslashreplace").decode("utf-8")
