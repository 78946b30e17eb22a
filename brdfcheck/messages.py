"""What messages are made of. Imports nothing, so that a mistyped command is answered at once."""

from __future__ import annotations


class UsageError(Exception):
    """What the user typed cannot be done. The message is one line that names the value and what is allowed."""


def one_line(text: object) -> str:
    """`text` on one line and without control characters, so that it can be part of a message."""
    words = " ".join(str(text).split())
    return "".join(character for character in words if character.isprintable())
