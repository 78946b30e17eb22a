"""Namespaces of HLSL and Slang: a file without them, where no two of them have the same name in them."""

from __future__ import annotations

from brdfcheck.brdf.readers.glsl.errors import mistake
from brdfcheck.brdf.readers.glsl.lexer import Token
from brdfcheck.brdf.readers.glsl.preprocessor import Source

_DECLARES = ("(", "=", ";", ",", "[", "{", ":")
"""What comes after a name that is declared, outside of parentheses; before it there is another word, mostly its type."""


def flattened(tokens: list[Token], source: Source) -> list[Token]:
    """The tokens without ``namespace name { }`` and ``name::``, and ``struct`` for ``class``.

    ShaderError where a name is declared in two namespaces, or in one and outside: which one is meant would be lost.
    """
    found: list[Token] = []
    known: set[str] = set()
    declared: dict[str, str] = {}
    open_at: list[tuple[str, int]] = []  # the namespaces around, and the braces before each
    braces = parentheses = 0
    index = 0
    while index < len(tokens):
        token, after = tokens[index], tokens[index + 1 : index + 3]
        text = [part.text for part in after]
        opens = token.text == "namespace" and not (found and found[-1].text == "using")
        if opens and after and (after[0].kind == "name" or after[0].text == "{"):
            index += 1
            first = index
            while tokens[index].kind == "name" or tokens[index].text in (":", "."):
                known.add(tokens[index].text)
                index += 1
            if tokens[index].text != "{":
                raise mistake(source.position(tokens[index].at), f"expected '{{' before {tokens[index].shown}")
            own = [part.text for part in tokens[first:index] if part.kind == "name"]
            path = "::".join((*(name for name, _ in open_at[-1:]), *own))
            open_at.append((path, braces))
            braces += 1
            index += 1
            continue
        if token.kind == "name" and token.text in known and text == [":", ":"]:
            index += 3
            continue
        braces += {"{": 1, "}": -1}.get(token.text, 0)
        parentheses += {"(": 1, ")": -1}.get(token.text, 0)
        index += 1
        if token.text == "}" and open_at and braces == open_at[-1][1]:
            open_at.pop()
            continue
        level = open_at[-1][1] + 1 if open_at else 0
        typed = bool(found) and found[-1].kind == token.kind == "name" and text[:1] != [] and text[0] in _DECLARES
        if typed and braces == level and not parentheses:
            own = open_at[-1][0] if open_at else ""
            if declared.setdefault(token.text, own) != own:
                message = f"{token.text!r} is in two namespaces, which are read as one: rename one"
                raise mistake(source.position(token.at), message)
        is_class = token.text == "class" and bool(after) and after[0].kind == "name"
        found.append(token._replace(text="struct") if is_class else token)
    if open_at:
        raise mistake(source.position(tokens[-1].at), "expected '}' before the end of the file")
    return found
