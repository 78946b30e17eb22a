"""Expressions of a shader, by precedence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.dialect import Dialect
from brdfcheck.brdf.readers.glsl.errors import ShaderError, mistake
from brdfcheck.brdf.readers.glsl.kinds import NAMED
from brdfcheck.brdf.readers.glsl.lexer import Token, tokens
from brdfcheck.brdf.readers.glsl.namespaces import flattened
from brdfcheck.brdf.readers.glsl.preprocessor import Source

# How tightly the operators between two operands bind.
_BINDING = {
    operator: strength
    for strength, operators in enumerate(
        ("||", "^^", "&&", "|", "^", "&", "== !=", "< > <= >=", "<< >>", "+ -", "* / %"),
        start=1,
    )
    for operator in operators.split()
}
_ASSIGNMENTS = frozenset(("=", *(f"{operator}=" for operator in ("+", "-", "*", "/", "%", "&", "|", "^", "<<", ">>"))))
BUILTIN_TYPES = frozenset(
    (
        *NAMED,
        *(
            f"{prefix}sampler{kind}"
            for prefix in ("", "i", "u")
            for kind in ("1D", "2D", "3D", "Cube", "2DRect", "1DArray", "2DArray", "Buffer", "2DMS", "2DMSArray")
        ),
        *(f"sampler{kind}Shadow" for kind in ("1D", "2D", "Cube", "2DRect", "1DArray", "2DArray")),
    )
)
STATEMENTS = ("if", "for", "while", "do", "switch", "return")
"""Words that begin a statement."""
JUMPS = ("break", "continue", "discard")
"""Words that are one."""
RESERVED = frozenset(
    (*STATEMENTS, *JUMPS, "case", "const", "default", "else", "false", "in", "inout", "out", "struct", "true", "uniform")
)
"""Words that are no names."""
_MOST_DEPTH = 60


class Expressions:
    """Reads expressions from a list of tokens. `types`: names that stand for types at this place."""

    def __init__(self, source: Source, dialect: Dialect):
        self.source, self.dialect = source, dialect
        self.types = set(BUILTIN_TYPES) | set(dialect.types)
        self.aliases = dict(dialect.types)
        self._tokens = flattened(tokens(source), source) if dialect.spread else tokens(source)
        self._next = 0
        self._depth = 0

    # --- tokens ---

    @property
    def now(self) -> Token:
        """The token that comes next."""
        return self._tokens[self._next]

    def ahead(self, count: int) -> Token:
        """A later token."""
        return self._tokens[min(self._next + count, len(self._tokens) - 1)]

    def take(self) -> Token:
        """The next token, and move on."""
        token = self.now
        self._next = min(self._next + 1, len(self._tokens) - 1)
        return token

    def is_next(self, *words: str) -> bool:
        """True where one of these operators or words comes next."""
        return self.now.kind in ("operator", "name") and self.now.text in words

    def accept(self, *words: str) -> Token | None:
        """The next token where it is one of these."""
        return self.take() if self.is_next(*words) else None

    def expect(self, word: str) -> Token:
        """This token; otherwise the file is wrong."""
        if not self.is_next(word):
            raise self.mistake(f"expected {word!r} before {self.now.shown}")
        return self.take()

    def name(self, what: str) -> Token:
        """A name that is not that of a type."""
        if self.now.kind != "name":
            raise self.mistake(f"expected {what} before {self.now.shown}")
        if self.now.text in BUILTIN_TYPES:
            raise self.mistake(f"expected {what}; {self.now.text!r} is a type")
        if self.now.text in RESERVED:
            raise self.mistake(f"expected {what}; {self.now.text!r} is a word of the language")
        return self.take()

    def mistake(self, message: str, at: int | None = None) -> ShaderError:
        """What is wrong at the next token unless another place is given, to be raised."""
        return mistake(self.source.position(self.now.at if at is None else at), message)

    @contextmanager
    def deeper(self) -> Iterator[None]:
        """Once more inside of something. What is too deep is refused, before Python runs out of its stack."""
        self._depth += 1
        if self._depth > _MOST_DEPTH:
            raise self.mistake(f"nested more than {_MOST_DEPTH} deep")
        yield
        self._depth -= 1

    # --- types ---

    def is_type(self) -> bool:
        """True where the name of a type comes next."""
        return self.now.kind == "name" and self.now.text in self.types

    def type_name(self) -> syntax.TypeName:
        """A type, with array sizes of its own."""
        if not self.is_type():
            raise self.mistake(f"expected a type before {self.now.shown}")
        token = self.take()
        if self.dialect.spread and self.accept("<"):  # Texture2D<float4>
            self.skip_to(">")
        return syntax.TypeName(token.at, self.aliases.get(token.text, token.text), self.sizes())

    def skip_to(self, word: str) -> None:
        """Leave out everything up to this token, and it."""
        while not self.accept(word):
            if self.take().kind == "end":
                raise self.mistake(f"expected {word!r} before the end of the file")

    def sizes(self) -> list[syntax.Node | None]:
        """``[3][]`` and so on."""
        found: list[syntax.Node | None] = []
        while self.accept("["):
            found.append(None if self.is_next("]") else self.conditional())
            self.expect("]")
        return found

    # --- expressions ---

    def expression(self) -> syntax.Node:
        """A whole expression, with commas."""
        first = self.assignment()
        if not self.is_next(","):
            return first
        parts = [first]
        while self.accept(","):
            parts.append(self.assignment())
        return syntax.Comma(first.at, parts)

    def assignment(self) -> syntax.Node:
        """An expression without commas."""
        with self.deeper():
            left = self.conditional()
            if self.now.kind == "operator" and self.now.text in _ASSIGNMENTS:
                operator = self.take()
                left = syntax.Assign(operator.at, operator.text, left, self.assignment())
        return left

    def conditional(self) -> syntax.Node:
        """``a ? b : c`` and what binds more tightly."""
        condition = self._binary(1)
        question = self.accept("?")
        if not question:
            return condition
        with self.deeper():
            yes = self.expression()
            self.expect(":")
            no = self.assignment()
        return syntax.Ternary(question.at, condition, yes, no)

    def _binary(self, least: int) -> syntax.Node:
        left = self._unary()
        while self.now.kind == "operator" and _BINDING.get(self.now.text, 0) >= least:
            operator = self.take()
            left = syntax.Binary(operator.at, operator.text, left, self._binary(_BINDING[operator.text] + 1))
        return left

    def _unary(self) -> syntax.Node:
        token = self.now
        if self.accept("-", "+", "!", "~"):
            with self.deeper():
                operand = self._unary()
            return syntax.Unary(token.at, token.text, operand)
        if self.accept("++", "--"):
            with self.deeper():
                operand = self._unary()
            return syntax.Step(token.at, token.text, operand, True)
        if self.dialect.spread and self.is_next("(") and self.ahead(1).text in self.types and self.ahead(2).text in (")", "["):
            self.take()
            kind = self.type_name()
            self.expect(")")
            with self.deeper():
                operand = self._unary()
            return syntax.Construct(token.at, kind, [operand])
        return self._postfix(self._primary())

    def _postfix(self, base: syntax.Node) -> syntax.Node:
        links = 0
        while self.now.kind == "operator":
            token = self.now
            if self.accept("["):
                index = self.expression()
                self.expect("]")
                base = syntax.Index(token.at, base, index)
            elif self.accept("."):
                member = self.name("a field or a swizzle")
                if self.accept("("):
                    base = syntax.Method(member.at, base, member.text, self.arguments())
                else:
                    base = syntax.Member(member.at, base, member.text)
            elif self.accept("++", "--"):
                base = syntax.Step(token.at, token.text, base, False)
            else:
                break
            links += 1
            if links > _MOST_DEPTH:
                raise self.mistake(f"nested more than {_MOST_DEPTH} deep")
        return base

    def arguments(self) -> list[syntax.Node]:
        """Arguments up to the closing parenthesis, the opening one is taken."""
        found: list[syntax.Node] = []
        if self.accept(")"):
            return found
        if self.is_next("void") and self.ahead(1).text == ")":
            self.take()
        else:
            found.append(self.assignment())
            while self.accept(","):
                found.append(self.assignment())
        self.expect(")")
        return found

    def _primary(self) -> syntax.Node:
        token = self.now
        if token.kind == "float":
            self.take()
            return syntax.Number(token.at, float(token.text.rstrip("fFlLhH")), "float")
        if token.kind == "int":
            return self._whole(self.take())
        if self.accept("("):
            with self.deeper():
                inner = self.expression()
                self.expect(")")
            return inner
        if self.is_next("true", "false"):
            self.take()
            return syntax.Number(token.at, float(token.text == "true"), "bool")
        if self.is_type():
            kind = self.type_name()
            if not self.is_next("("):
                raise self.mistake(f"expected '(' after the type {token.text!r}")
            self.take()
            with self.deeper():
                arguments = self.arguments()
            if kind.sizes:
                return syntax.Construct(token.at, kind, arguments)
            return syntax.Call(token.at, kind.name, arguments)
        if token.kind == "name":
            self.take()
            if not self.accept("("):
                return syntax.Name(token.at, token.text)
            with self.deeper():
                arguments = self.arguments()
            return syntax.Call(token.at, token.text, arguments)
        raise self.mistake(f"expected an expression before {token.shown}")

    def _whole(self, token: Token) -> syntax.Number:
        text = token.text.rstrip("uU")
        unsigned = text != token.text
        try:
            value = int(text, 16 if text[:2] in ("0x", "0X") else 8 if text[0] == "0" else 10) if len(text) < 40 else 2**32
        except ValueError:
            raise self.mistake(f"{token.text!r} is no octal number", token.at) from None
        if value >= 2**32:
            raise self.mistake(f"{one_word(token.text)} does not fit into 32 bits", token.at)
        if not unsigned and value >= 2**31:
            value -= 2**32  # the same bits
        return syntax.Number(token.at, value, "uint" if unsigned else "int")

    def initial(self) -> syntax.Node:
        """What a variable begins with: an expression, or a list in braces."""
        token = self.accept("{")
        if not token:
            return self.assignment()
        with self.deeper():
            parts: list[syntax.Node] = []
            while not self.is_next("}"):
                parts.append(self.initial())
                if not self.accept(","):
                    break
            self.expect("}")
        return syntax.Braces(token.at, parts)


def one_word(text: str) -> str:
    """A long word, shortened for a message."""
    return text if len(text) <= 24 else text[:20] + "..."
