"""A whole shader: its globals and functions, and how one of them is run on directions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.arithmetic import known
from brdfcheck.brdf.readers.glsl.calls import perform
from brdfcheck.brdf.readers.glsl.dialect import Dialect
from brdfcheck.brdf.readers.glsl.errors import Position, mistake
from brdfcheck.brdf.readers.glsl.kinds import VOID, Array, Opaque, Type
from brdfcheck.brdf.readers.glsl.machine import Machine, Run
from brdfcheck.brdf.readers.glsl.parser import parse
from brdfcheck.brdf.readers.glsl.preprocessor import Source
from brdfcheck.brdf.readers.glsl.scopes import Routine, constant_of
from brdfcheck.brdf.readers.glsl.statements import Statements

# Functions that call each other, one inside the other.
_MOST_CALLS = 30


@dataclass(frozen=True)
class Uniform:
    """A variable of the file that is given from outside. `default`: its value in the file, None where it has none."""

    name: str
    type: Type
    slot: int
    default: Any
    position: Position

    @property
    def start(self) -> Any:
        """Its value where none is given."""
        return self.type.zero() if self.default is None else self.default


class Program(Statements):
    """A shader, compiled as far as it is asked for: what nobody calls may hold what has no meaning here.

    `given`: variables that are there without being declared, with their types. Raises ShaderError.
    """

    def __init__(self, source: Source, dialect: Dialect, given: Mapping[str, Type]):
        super().__init__(source, dialect)
        self.routines, self.calls, self.constants, self.used = {}, {}, {}, set()
        self.caller = None
        self.uniforms: dict[str, Uniform] = {}
        self._within, self._returned = [], [False]
        self._globals: list[Run] = []
        self._waiting = []
        nowhere = Position(source.position(0).file, 0, 0)
        for name, kind in given.items():
            slot = self.names.add(name, kind, f"the parameter {name!r} cannot be assigned to").slot
            self.uniforms[name] = Uniform(name, kind, slot, None, nowhere)
        try:
            for part in parse(source, dialect):
                getattr(self, f"_top_{type(part).__name__.lower()}")(part)
        except RecursionError:
            raise mistake(nowhere, "nested too deeply") from None

    # --- the top of the file ---

    def _top_structdef(self, node: syntax.StructDef) -> None:
        self.define_struct(node)

    def _top_function(self, node: syntax.Function) -> None:
        result = self.type_of(node.type)
        types = tuple(self.type_of(parameter.type) for parameter in node.parameters)
        for parameter, kind in zip(node.parameters, types, strict=True):
            if kind == VOID or (isinstance(kind, Array) and kind.size is None):
                raise self.mistake(parameter.at, f"a parameter cannot be {kind}")
        ways = tuple(parameter.way for parameter in node.parameters)
        forms = self.routines.setdefault(node.name, [])
        routine = next((form for form in forms if form.types == types), None)
        if routine is None:
            routine = Routine(node, result, types, ways)
            forms.append(routine)
        elif routine.result != result:
            raise self.mistake(node.at, f"{node.name}({routine.signature}) returned {routine.result} before, now {result}")
        if node.body is not None:
            if routine.body is not None:
                raise self.mistake(node.at, f"{node.name}({routine.signature}) is defined twice")
            routine.node, routine.body, routine.ways, routine.horizon = node, node.body, ways, self.names.slot

    def _top_declaration(self, node: syntax.Declaration) -> None:
        outside = {"uniform", "in", "out", "inout", "attribute", "varying", "extern"} & set(node.qualifiers)
        if self.dialect.spread and not {"static", "const"} & set(node.qualifiers):
            outside = {"uniform"}
        for variable in node.variables:
            kind = self.type_of(node.type, variable.sizes)
            # What a shader is given by a pipeline may have the name of a parameter of the file.
            if variable.name in self.uniforms and outside:
                continue
            if outside or isinstance(kind, Opaque):
                way = next((word for word in ("uniform", "in", "attribute") if word in outside), "")
                self._outside(variable, kind, way)
            else:
                self._globals.append(self._declared(node, variable))

    def _outside(self, variable: syntax.Declarator, kind: Type, way: str) -> None:
        if variable.name in self.names.variables[0]:
            raise self.mistake(variable.at, f"{variable.name!r} is declared twice")
        default = None
        if variable.value is not None and not isinstance(kind, Opaque):
            typed = self.initial(variable.value, kind)
            kind, default = typed.type, constant_of(typed.run)
            if default is None or not all(known(leaf) for leaf in jax.tree.leaves(default)):
                raise self.mistake(variable.at, f"what {variable.name!r} begins with must be constant")
        what = {"in": "input"}.get(way, way)
        locked = f"the {what} {variable.name!r} cannot be assigned to" if way else ""
        slot = self.names.add(variable.name, kind, locked).slot
        self.uniforms[variable.name] = Uniform(variable.name, kind, slot, default, self.source.position(variable.at))

    # --- functions ---

    def compile(self, routine: Routine) -> None:
        """A function, and all that it calls. Raises ShaderError."""
        try:
            self.wanted(routine)
            while self._waiting:
                self._compile_one(self._waiting[0])
                self._waiting.pop(0)
            for first in (routine, *(called for called, _ in self.calls.get(id(None), ()))):
                self._refuse_recursion(first)
        except RecursionError:
            raise mistake(self.source.position(routine.node.at), "nested too deeply") from None

    def _compile_one(self, routine: Routine) -> None:
        node = routine.node
        assert routine.body is not None
        with self.names.only_global(), self.names.inner() as scope, self.names.noting() as (writes, calls, declared):
            slots: list[int] = []
            for parameter, kind in zip(node.parameters, routine.types, strict=True):
                if parameter.name in scope:
                    raise self.mistake(parameter.at, f"there are two parameters {parameter.name!r}")
                name = parameter.name or f" {len(slots)}"
                locked = f"the parameter {name!r} is constant" if parameter.constant else ""
                slots.append(self.names.add(name, kind, locked).slot)
            routine.slots = tuple(slots)
            routine.result_slot = None if routine.result == VOID else self.names.new_slot(routine.result)
            before, self.caller = self.caller, routine
            self._returned.append(False)
            # The parameters and the body share a scope.
            body = self.block(routine.body.statements)
            returned = self._returned.pop()
            self.caller = before
        if routine.result != VOID and not returned:
            raise self.mistake(node.at, f"{routine.name}() returns {routine.result}, and there is no return in it")
        routine.writes, routine.calls, routine.compiled = writes - declared, calls, body

    def _refuse_recursion(self, routine: Routine) -> None:
        depth: dict[int, int] = {}
        path: list[int] = []
        stack: list[tuple[Routine, int]] = [(routine, 0)]
        while stack:
            now, index = stack.pop()
            if index == 0:
                path.append(id(now))
            called = self.calls.get(id(now), [])
            if index < len(called):
                stack.append((now, index + 1))
                other, at = called[index]
                if id(other) in path:
                    whose = "itself" if other is now else f"{now.name}(), which calls it"
                    raise self.mistake(at, f"{other.name}() calls {whose}; GLSL has no recursion: use a loop")
                if id(other) not in depth:
                    stack.append((other, 0))
                else:
                    self._deep(depth[id(other)] + len(path), at)
            else:
                path.pop()
                depth[id(now)] = 1 + max((depth[id(other)] for other, _ in called), default=0)
                self._deep(depth[id(now)] + len(path), now.node.at)

    def _deep(self, depth: int, at: int) -> None:
        if depth > _MOST_CALLS:
            raise self.mistake(at, f"functions call each other more than {_MOST_CALLS} deep")

    # --- running ---

    def run(
        self, routine: Routine, arguments: list[Any], values: Mapping[int, Any], shape: tuple[int, ...]
    ) -> tuple[Any, Machine]:
        """A function's result, and the machine that it ran on. `values`: those of the uniforms, by slot."""
        machine = Machine(shape)
        position = self.source.position(routine.node.at)
        with np.errstate(all="ignore"):
            try:
                for uniform in self.uniforms.values():
                    machine.declare(uniform.slot, values.get(uniform.slot, uniform.start))
                for declare in self._globals:
                    declare(machine)
                return perform(machine, routine, arguments), machine
            except RecursionError:
                raise mistake(position, "nested too deeply") from None

    def definitions(self, name: str | None = None) -> Iterable[Routine]:
        """The functions that are defined, in the order of the file; those of one name."""
        for key, forms in self.routines.items():
            if name is None or name in (key, key.rpartition(".")[2]):  # a method, perhaps without its struct
                yield from (form for form in forms if form.body is not None)
