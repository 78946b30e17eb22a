"""A shader's text as tokens."""

from __future__ import annotations

import re
from typing import NamedTuple

from brdfcheck.brdf.readers.glsl.errors import mistake
from brdfcheck.brdf.readers.glsl.preprocessor import Source

_FLOAT = r"(?:(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)(?:lf|LF|[fFhH])?|\d+[fFhH](?!\w)"
_OPERATORS = r"<<=|>>=|\+\+|--|<<|>>|[<>=!]=|&&|\|\||\^\^|[-+*/%&|^]=|[()\[\]{}.,;:?+\-*/%<>=!~&|^]"
_TOKEN = re.compile(
    rf"(?P<space>\s+)|(?P<float>{_FLOAT})|(?P<int>0[xX][0-9a-fA-F]+[uU]?|\d+[uU]?)|(?P<name>[A-Za-z_]\w*)"
    rf"|(?P<operator>{_OPERATORS})",
    re.ASCII,
)


class Token(NamedTuple):
    """A word of a shader. `kind`: float, int, name, operator or end; `at`: where it begins in the source's text."""

    kind: str
    text: str
    at: int

    @property
    def shown(self) -> str:
        """The token in a message."""
        return "the end of the file" if self.kind == "end" else repr(self.text)


def tokens(source: Source) -> list[Token]:
    """All tokens of a source, and one that stands for its end. ShaderError for what is none."""
    found: list[Token] = []
    at, text = 0, source.text
    while at < len(text):
        match = _TOKEN.match(text, at)
        if text.startswith("/*", at):
            raise mistake(source.position(at), "this comment has no end: '*/' is missing")
        if match is None:
            raise mistake(source.position(at), f"unexpected character {text[at]!r}")
        kind, word = str(match.lastgroup), match.group()
        if kind != "space":
            if kind in ("float", "int") and re.match(r"[\w.]", text[match.end() : match.end() + 1]):
                rest = re.match(r"[\w.]*", text[match.end() :])
                raise mistake(source.position(at), f"{word + (rest.group() if rest else '')!r} is no number")
            found.append(Token(kind, word, at))
        at = match.end()
    found.append(Token("end", "", max(len(text) - 1, 0)))
    return found
