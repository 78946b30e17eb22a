"""Names and what they stand for at a place of the program."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.kinds import Type
from brdfcheck.brdf.readers.glsl.machine import Machine, Run


class Typed(NamedTuple):
    """A compiled expression: its type, what runs it, and where it can be assigned to, what finds it (get, set).

    `locked`: why it cannot be assigned to, where that has a reason of its own.
    """

    type: Type
    run: Run
    locate: Any = None
    locked: str = ""


@dataclass(frozen=True)
class Variable:
    """A variable: its type, its slot of the machine, and whether it may be assigned to."""

    name: str
    type: Type
    slot: int
    locked: str = ""


@dataclass
class Routine:
    """A function of the file. `compiled` runs its body, which may change the variables `writes` and calls `calls`.

    `horizon`: the last of the global variables that stand before it.
    """

    node: syntax.Function
    result: Type
    types: tuple[Type, ...]
    ways: tuple[str, ...]
    body: syntax.Block | None = None
    slots: tuple[int, ...] = ()
    result_slot: int | None = None
    horizon: int = 0
    compiled: Run | None = None
    writes: set[int] = field(default_factory=set)
    calls: list[Routine] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Its name."""
        return self.node.name

    @property
    def signature(self) -> str:
        """Its parameters, for messages."""
        return ", ".join(f"{way} {kind}" if way != "in" else str(kind) for way, kind in zip(self.ways, self.types, strict=True))


@dataclass
class Names:
    """The scopes that are open, innermost last: variables and structs. `slot` counts the variables of the program."""

    variables: list[dict[str, Variable]] = field(default_factory=lambda: [{}])
    structs: list[dict[str, Any]] = field(default_factory=lambda: [{}])
    slot: int = 0
    # What loops and functions that are being compiled may change, what they call, and what is declared inside of them.
    writes: list[set[int]] = field(default_factory=list)
    calls: list[list[Routine]] = field(default_factory=list)
    declared: list[set[int]] = field(default_factory=list)
    kinds: dict[int, Type] = field(default_factory=dict)

    @contextmanager
    def inner(self) -> Iterator[dict[str, Variable]]:
        """A scope inside of the innermost one."""
        self.variables.append({})
        self.structs.append({})
        try:
            yield self.variables[-1]
        finally:
            self.variables.pop()
            self.structs.pop()

    @contextmanager
    def only_global(self) -> Iterator[None]:
        """Outside of all scopes but that of the file: where a function begins."""
        kept = self.variables, self.structs
        self.variables, self.structs = self.variables[:1], self.structs[:1]
        try:
            yield
        finally:
            self.variables, self.structs = kept

    @contextmanager
    def noting(self) -> Iterator[tuple[set[int], list[Routine], set[int]]]:
        """What is written to, called and declared within the block."""
        noted: tuple[set[int], list[Routine], set[int]] = set(), [], set()
        stacks: tuple[Any, ...] = (self.writes, self.calls, self.declared)
        for stack, new in zip(stacks, noted, strict=True):
            stack.append(new)
        try:
            yield noted
        finally:
            for stack in stacks:
                stack.pop()

    def find(self, name: str) -> Variable | None:
        """The variable of this name that counts here."""
        return next((scope[name] for scope in reversed(self.variables) if name in scope), None)

    def struct(self, name: str) -> Any:
        """The struct of this name that counts here."""
        return next((scope[name] for scope in reversed(self.structs) if name in scope), None)

    def new_slot(self, kind: Type) -> int:
        """A slot of the machine for a value of this type."""
        self.slot += 1
        self.kinds[self.slot] = kind
        for declared in self.declared:
            declared.add(self.slot)
        return self.slot

    def add(self, name: str, kind: Type, locked: str = "") -> Variable:
        """A new variable in the innermost scope."""
        variable = Variable(name, kind, self.new_slot(kind), locked)
        self.variables[-1][name] = variable
        return variable

    def written(self, slot: int) -> None:
        """Note that a variable may be changed here."""
        for writes in self.writes:
            writes.add(slot)

    def called(self, routine: Routine) -> None:
        """Note that a function is called here."""
        for calls in self.calls:
            calls.append(routine)

    def all(self) -> list[str]:
        """All names of variables that can be seen here."""
        return [name for scope in self.variables for name in scope]


def constant_of(run: Run) -> Any:
    """The value of an expression where it is a number that needs no variables; else None."""
    try:
        with np.errstate(all="ignore"):
            return run(Machine(()))
    except KeyError:
        return None
