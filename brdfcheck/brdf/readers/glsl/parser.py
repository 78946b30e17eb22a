"""Declarations and statements of a shader: its text as a syntax tree."""

from __future__ import annotations

import dataclasses

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.dialect import Dialect
from brdfcheck.brdf.readers.glsl.lexer import Token
from brdfcheck.brdf.readers.glsl.operators import JUMPS, STATEMENTS, Expressions
from brdfcheck.brdf.readers.glsl.preprocessor import Source

_FOREIGN = frozenset(
    (
        *("static", "inline", "groupshared", "extern", "public", "internal", "private", "differentiable", "no_diff"),
        *("nointerpolation", "row_major", "column_major", "precise", "shared"),
    )
)
"""Words that only HLSL and Slang use: elsewhere they may be names."""
_SKIPPED = ("import", "__exported", "__include", "module", "implementing", "using")
_UNREAD = {
    "template": "templates", "__generic": "generics", "extension": "extensions", "enum": "enums", "property": "properties",
    "func": "functions that begin with func", "__init": "constructors",
}  # fmt: skip
"""What HLSL and Slang have besides."""
_QUALIFIERS = _FOREIGN | frozenset(
    (
        *("const", "uniform", "in", "out", "inout", "attribute", "varying", "centroid", "flat", "smooth", "noperspective"),
        *("invariant", "highp", "mediump", "lowp", "volatile"),
    )
)


def parse(source: Source, dialect: Dialect) -> list[syntax.Node]:
    """Everything at the top of a source, in order. ShaderError where it has no syntax tree."""
    return _Parser(source, dialect).file()


class _Parser(Expressions):
    def file(self) -> list[syntax.Node]:
        """Everything, up to the end."""
        parts: list[syntax.Node] = []
        while self.now.kind != "end":
            self._top(parts)
        return parts

    def _top(self, parts: list[syntax.Node]) -> None:
        """One declaration or function of the file."""
        if self.accept(";"):
            return
        if self.dialect.spread:
            self._attributes()
            if self.accept("cbuffer"):
                self._buffer(parts)
                return
            if self._of_slang():
                return
        if self._precision():
            return
        qualifiers = self._qualifiers()
        if qualifiers and self.accept(";"):  # layout(...) in;
            return
        if qualifiers and self.now.kind == "name" and not self.is_type() and self.ahead(1).text == "{":
            self._interface(parts, qualifiers)
            return
        if self.is_next("struct"):
            self._struct(parts)
            if self.accept(";"):
                return
            made = next(part for part in reversed(parts) if isinstance(part, syntax.StructDef))
            kind = syntax.TypeName(made.at, made.name, [])
        else:
            kind = self._declared_type()
        name = self.name("a name")
        if self.is_next("("):
            parts.append(self._function(kind, name))
        else:
            parts.append(self._variables(qualifiers, kind, name))

    def _of_slang(self) -> bool:
        """What names other files, other names of types, and interfaces, which say nothing that is not said again."""
        if self.is_next(*_SKIPPED) and self.ahead(1).kind == "name":
            self.skip_to(";")
        elif self.is_next("interface") and self.ahead(1).kind == "name":
            self.skip_to("{")
            depth = 1
            while depth and self.now.kind != "end":
                depth += {"{": 1, "}": -1}.get(self.take().text, 0)
        elif self.is_next("typedef") and self.ahead(1).kind == "name":
            self.take()
            kind, name = self._declared_type(), self.name("a name")
            self._alias(name, kind)
        elif self.is_next("typealias") and self.ahead(2).text == "=":
            self.take()
            name = self.name("a name")
            self.expect("=")
            self._alias(name, self._declared_type())
        else:
            return False
        return True

    def _alias(self, name: Token, kind: syntax.TypeName) -> None:
        if kind.sizes:
            raise self.mistake("another name for an array has no meaning here", name.at)
        self.types.add(name.text)
        self.aliases[name.text] = kind.name
        self.expect(";")

    def _declared_type(self) -> syntax.TypeName:
        if self.dialect.spread and (self.is_next(*_UNREAD) or self.ahead(2).text == "<"):
            what = _UNREAD.get(self.now.text, "generics")
            raise self.mistake(f"{what} are not read: functions and structs are, written for types that have a name")
        if self.now.kind == "name" and not self.is_type() and self.ahead(1).kind == "name":
            raise self.mistake(f"there is no type {self.now.text!r}")
        if not self.is_type():
            raise self.mistake(f"expected a declaration before {self.now.shown}")
        return self.type_name()

    def _attributes(self) -> None:
        """``[numthreads(8, 8, 1)]`` and the like, which mean nothing here."""
        while self.is_next("[") and self.ahead(1).kind == "name":
            while self.now.kind != "end" and not self.accept("]"):
                self.take()

    def _precision(self) -> bool:
        """``precision highp float;``"""
        if not (self.is_next("precision") and self.ahead(1).text in ("highp", "mediump", "lowp")):
            return False
        self.take()
        self.take()
        self.type_name()
        self.expect(";")
        return True

    def _qualifiers(self) -> list[str]:
        found: list[str] = []
        while self.now.kind == "name":
            word = self.now.text
            if word == "layout":
                self.take()
                self.expect("(")
                while self.now.kind != "end" and not self.is_next(")"):
                    self.take()
                self.expect(")")
                found.append(word)
            elif word in _QUALIFIERS and (word not in _FOREIGN or self.dialect.spread or self.ahead(1).kind == "name"):
                found.append(self.take().text)
            else:
                break
        return found

    def _struct(self, parts: list[syntax.Node]) -> None:
        at = self.expect("struct").at
        name = Token("name", f"struct at {at}", at) if self.is_next("{") else self.name("the name of the struct")
        fields: list[syntax.Declaration] = []
        methods: list[syntax.Function] = []
        if self.dialect.spread and self.is_next("<"):
            raise self.mistake("generics are not read: write the struct for types that have a name")
        if self.dialect.spread and self.accept(":"):  # the interfaces that it has
            self.skip_to("{")
        else:
            self.expect("{")
        while not self.is_next("}"):
            changes = self.is_next("[") and self.ahead(1).text == "mutating"
            if self.dialect.spread:
                self._attributes()
            static = "static" in (qualifiers := self._qualifiers())
            kind, field = self._declared_type(), self.name("a field")
            if self.dialect.spread and self.is_next("("):
                method = self._function(kind, field._replace(text=f"{name.text}.{field.text}"))
                own = syntax.Parameter(name.at, "inout" if changes else "in", syntax.TypeName(name.at, name.text, []), "this")
                own.constant = not changes
                methods.append(method if static else dataclasses.replace(method, parameters=[own, *method.parameters]))
            elif static:
                parts.append(self._variables(qualifiers, kind, field))
            else:
                fields.append(self._variables([], kind, field))
        self.expect("}")
        if not (fields or methods):
            raise self.mistake(f"the struct {name.text!r} has no fields", name.at)
        self.types.add(name.text)
        parts.append(syntax.StructDef(name.at, name.text, fields))
        parts += methods

    def _buffer(self, parts: list[syntax.Node]) -> None:
        """``cbuffer Name : register(b0) { float roughness; };``: its members are uniforms."""
        self.name("a name")
        self._semantic()
        self._members(parts, ["uniform"])
        self.accept(";")

    def _interface(self, parts: list[syntax.Node], qualifiers: list[str]) -> None:
        """``uniform Block { float roughness; };``: its members are uniforms, those of ``... } name;`` ``name.roughness``."""
        block = self.take()
        members: list[syntax.Node] = []
        self._members(members, qualifiers)
        if self.accept(";") or self.now.kind != "name" or self.dialect.spread:
            parts += members
            return
        fields = [member for member in members if isinstance(member, syntax.Declaration)]
        parts.append(syntax.StructDef(block.at, block.text, fields))
        parts.append(self._variables(qualifiers, syntax.TypeName(block.at, block.text, []), self.name("a name")))

    def _members(self, parts: list[syntax.Node], qualifiers: list[str]) -> None:
        self.expect("{")
        while not self.is_next("}"):
            self._qualifiers()
            kind = self._declared_type()
            parts.append(self._variables(qualifiers, kind, self.name("a field")))
        self.expect("}")

    def _semantic(self) -> None:
        """``: SV_Target`` or ``: register(b0)``, which mean nothing here."""
        if self.dialect.spread and self.accept(":"):
            self.name("a semantic")
            if self.accept("("):
                self.arguments()

    def _variables(self, qualifiers: list[str], kind: syntax.TypeName, name: Token) -> syntax.Declaration:
        """The rest of a declaration, whose first name is taken, with its semicolon."""
        found = [self._declarator(name)]
        while self.accept(","):
            found.append(self._declarator(self.name("a name")))
        if not self.is_next(";"):
            raise self.mistake(f"expected ';' before {self.now.shown}")
        self.take()
        return syntax.Declaration(name.at, qualifiers, kind, found)

    def _declarator(self, name: Token) -> syntax.Declarator:
        sizes = self.sizes()
        self._semantic()
        return syntax.Declarator(name.at, name.text, sizes, self.initial() if self.accept("=") else None)

    def _function(self, kind: syntax.TypeName, name: Token) -> syntax.Function:
        self.expect("(")
        parameters: list[syntax.Parameter] = []
        if self.is_next("void") and self.ahead(1).text == ")":
            self.take()
        while not self.is_next(")"):
            if parameters:
                self.expect(",")
            parameters.append(self._parameter())
        self.expect(")")
        self._semantic()
        if self.accept(";"):
            return syntax.Function(name.at, kind, name.text, parameters, None)
        return syntax.Function(name.at, kind, name.text, parameters, self._block())

    def _parameter(self) -> syntax.Parameter:
        qualifiers = self._qualifiers()
        if not self.is_type():
            raise self.mistake(f"expected the type of a parameter before {self.now.shown}")
        kind = self.type_name()
        named = self.now.kind == "name"
        token = self.name("a parameter") if named else self.now
        kind.sizes = [*self.sizes(), *kind.sizes]
        self._semantic()
        way = "inout" if {"in", "out"} <= set(qualifiers) else next((w for w in qualifiers if w in ("inout", "out")), "in")
        return syntax.Parameter(token.at, way, kind, token.text if named else "", "const" in qualifiers)

    # --- statements ---

    def _block(self) -> syntax.Block:
        brace = self.expect("{")
        with self.deeper():
            found: list[syntax.Node] = []
            while not self.is_next("}"):
                if self.now.kind == "end":
                    raise self.mistake("expected '}' before the end of the file")
                self._statement(found)
            self.expect("}")
        return syntax.Block(brace.at, found)

    def _single(self) -> syntax.Node:
        """One statement, as behind an if."""
        found: list[syntax.Node] = []
        at = self.now.at
        with self.deeper():
            self._statement(found)
        return found[0] if len(found) == 1 else syntax.Block(at, found)

    def _statement(self, found: list[syntax.Node]) -> None:
        if self.dialect.spread:
            self._attributes()
        token = self.now
        if self.accept(";"):
            return
        if self.is_next("{"):
            found.append(self._block())
        elif self.is_next("struct"):
            self._struct(found)
            if isinstance(found[-1], syntax.Function):
                raise self.mistake("a struct within a function has no methods here", found[-1].at)
            if not self.accept(";"):
                name = getattr(found[-1], "name", "")
                found.append(self._variables([], syntax.TypeName(token.at, name, []), self.name("a name")))
        elif token.kind == "name" and token.text in STATEMENTS:
            found.append(getattr(self, f"_{token.text}")(self.take().at))
        elif self.accept(*JUMPS):
            self.expect(";")
            found.append(syntax.Jump(token.at, token.text))
        elif self.is_next("case", "default"):
            raise self.mistake(f"{token.text!r} belongs into a switch")
        elif self.is_next("else"):
            raise self.mistake("'else' without an 'if'")
        elif self._declares():
            found.append(self._declaration())
        elif not self._precision():
            value = self.expression()
            self.expect(";")
            found.append(syntax.Expression(token.at, value))

    def _declares(self) -> bool:
        """True where a declaration comes next: a qualifier, or a type and a name."""
        if self.now.kind != "name":
            return False
        if self._deduces():
            return True
        if self.now.text in _QUALIFIERS and self.now.text not in ("in", "out", "inout"):
            return self.ahead(1).kind == "name"
        if not self.is_type():
            if self.ahead(1).kind == "name" and self.now.text != "precision":
                raise self.mistake(f"there is no type {self.now.text!r}")
            return False
        count = 1
        while self.ahead(count).text == "[":
            while self.ahead(count).text != "]" and self.ahead(count).kind != "end":
                count += 1
            count += 1
        return self.ahead(count).kind == "name"

    def _deduces(self) -> bool:
        """``let x = 1;`` and ``var x : float = 1;`` of Slang."""
        return self.dialect.spread and self.is_next("let", "var") and self.ahead(2).text in ("=", ":")

    def _declaration(self) -> syntax.Declaration:
        if self._deduces():
            at, name = self.take().at, self.name("a name")
            kind = self.type_name() if self.accept(":") else syntax.TypeName(at, syntax.DEDUCED, [])
            return self._variables([], kind, name)
        qualifiers = self._qualifiers()
        kind = self._declared_type()
        return self._variables(qualifiers, kind, self.name("a name"))

    def _if(self, at: int) -> syntax.If:
        self.expect("(")
        condition = self.expression()
        self.expect(")")
        yes = self._single()
        return syntax.If(at, condition, yes, self._single() if self.accept("else") else None)

    def _for(self, at: int) -> syntax.Node:
        self.expect("(")
        start: list[syntax.Node] = []
        self._statement(start)
        condition, declared = (None, None) if self.is_next(";") else self._condition()
        self.expect(";")
        step = None if self.is_next(")") else self.expression()
        self.expect(")")
        loop = syntax.Loop(at, start[0] if start else None, condition, step, self._single())
        return syntax.Block(at, [declared, loop]) if declared else loop

    def _while(self, at: int) -> syntax.Node:
        self.expect("(")
        condition, declared = self._condition()
        self.expect(")")
        loop = syntax.Loop(at, None, condition, None, self._single())
        return syntax.Block(at, [declared, loop]) if declared else loop

    def _condition(self) -> tuple[syntax.Node, syntax.Declaration | None]:
        """The condition of a loop. ``bool b = value`` is ``b = value``, and a declaration of b before the loop."""
        if not self._declares():
            return self.expression(), None
        self._qualifiers()
        kind, name = self.type_name(), self.name("a name")
        equals = self.expect("=")
        value = syntax.Assign(equals.at, "=", syntax.Name(name.at, name.text), self.assignment())
        declared = syntax.Declaration(name.at, [], kind, [syntax.Declarator(name.at, name.text, [], None)])
        return value, declared

    def _do(self, at: int) -> syntax.Loop:
        body = self._single()
        self.expect("while")
        self.expect("(")
        condition = self.expression()
        self.expect(")")
        self.expect(";")
        return syntax.Loop(at, None, condition, None, body, test_first=False)

    def _return(self, at: int) -> syntax.Return:
        value = None if self.is_next(";") else self.expression()
        self.expect(";")
        return syntax.Return(at, value)

    def _switch(self, at: int) -> syntax.Switch:
        self.expect("(")
        value = self.expression()
        self.expect(")")
        self.expect("{")
        cases: list[syntax.Case] = []
        with self.deeper():
            while not self.is_next("}"):
                label = self.now
                if self.accept("case"):
                    kind: syntax.Node | None = self.conditional()
                elif self.accept("default"):
                    kind = None
                else:
                    if not cases:
                        raise self.mistake(f"expected 'case' or 'default' before {label.shown}")
                    self._statement(cases[-1].statements)
                    continue
                self.expect(":")
                if cases and not cases[-1].statements:
                    cases[-1].labels.append(kind)
                else:
                    cases.append(syntax.Case(label.at, [kind]))
            self.expect("}")
        return syntax.Switch(at, value, cases)
