"""The syntax tree of a shader. `at` is where a node begins in the source's text."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Node:
    """Anything that has a place in the text."""

    at: int


@dataclass(slots=True)
class Number(Node):
    """A literal; `kind` is float, int, uint or bool."""

    value: float
    kind: str


@dataclass(slots=True)
class Name(Node):
    """A variable."""

    name: str


@dataclass(slots=True)
class Unary(Node):
    """An operator before its operand."""

    operator: str
    operand: Node


@dataclass(slots=True)
class Step(Node):
    """``x++`` or ``x--``; `before`: ``++x`` or ``--x``."""

    operator: str
    operand: Node
    before: bool


@dataclass(slots=True)
class Binary(Node):
    """An operator between two operands."""

    operator: str
    left: Node
    right: Node


@dataclass(slots=True)
class Ternary(Node):
    """``condition ? yes : no``."""

    condition: Node
    yes: Node
    no: Node


@dataclass(slots=True)
class Assign(Node):
    """``target = value``, or with an operator: ``target += value``."""

    operator: str
    target: Node
    value: Node


@dataclass(slots=True)
class Comma(Node):
    """``first, second``: the value of the last one."""

    parts: list[Node]


DEDUCED = "let"
"""The type of a variable that has the type of its first value."""


@dataclass(slots=True)
class TypeName(Node):
    """A type as it is written; `sizes`: its own array sizes, outermost first, None for ``[]``."""

    name: str
    sizes: list[Node | None]


@dataclass(slots=True)
class Call(Node):
    """A function or a constructor, with its arguments."""

    name: str
    arguments: list[Node]


@dataclass(slots=True)
class Construct(Node):
    """A constructor of an array type, or a cast."""

    type: TypeName
    arguments: list[Node]


@dataclass(slots=True)
class Braces(Node):
    """``{a, b, c}`` as an initial value."""

    parts: list[Node]


@dataclass(slots=True)
class Index(Node):
    """``base[index]``."""

    base: Node
    index: Node


@dataclass(slots=True)
class Member(Node):
    """``base.name``: a field or a swizzle."""

    base: Node
    name: str


@dataclass(slots=True)
class Method(Node):
    """``base.name(...)``."""

    base: Node
    name: str
    arguments: list[Node]


# --- declarations and statements ---


@dataclass(slots=True)
class Declarator(Node):
    """One variable of a declaration."""

    name: str
    sizes: list[Node | None]
    value: Node | None


@dataclass(slots=True)
class StructDef(Node):
    """A struct and its fields."""

    name: str
    fields: list[Declaration]


@dataclass(slots=True)
class Declaration(Node):
    """Variables of one type."""

    qualifiers: list[str]
    type: TypeName
    variables: list[Declarator]


@dataclass(slots=True)
class Parameter(Node):
    """A parameter of a function; `way` is in, out or inout."""

    way: str
    type: TypeName
    name: str
    constant: bool = False


@dataclass(slots=True)
class Block(Node):
    """Statements in braces."""

    statements: list[Node]


@dataclass(slots=True)
class Function(Node):
    """A function; a prototype has no body."""

    type: TypeName
    name: str
    parameters: list[Parameter]
    body: Block | None


@dataclass(slots=True)
class Expression(Node):
    """An expression as a statement."""

    value: Node


@dataclass(slots=True)
class If(Node):
    """``if (condition) yes else no``."""

    condition: Node
    yes: Node
    no: Node | None


@dataclass(slots=True)
class Loop(Node):
    """All loops: `test_first` is False for ``do``."""

    start: Node | None
    condition: Node | None
    step: Node | None
    body: Node
    test_first: bool = True


@dataclass(slots=True)
class Case(Node):
    """A group of statements of a switch, behind its labels; None stands for ``default``."""

    labels: list[Node | None]
    statements: list[Node] = field(default_factory=list)


@dataclass(slots=True)
class Switch(Node):
    """``switch (value) {...}``."""

    value: Node
    cases: list[Case]


@dataclass(slots=True)
class Jump(Node):
    """``break``, ``continue`` or ``discard``."""

    word: str


@dataclass(slots=True)
class Return(Node):
    """``return value``."""

    value: Node | None
