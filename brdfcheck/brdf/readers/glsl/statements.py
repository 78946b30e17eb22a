"""Statements, compiled."""

from __future__ import annotations

from typing import Any

import jax

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.arithmetic import either, known, opposite
from brdfcheck.brdf.readers.glsl.calls import Calls
from brdfcheck.brdf.readers.glsl.context import converting
from brdfcheck.brdf.readers.glsl.kinds import MOST_LEAVES, VOID, Array, Opaque, Scalar, Struct, Type, kind_of
from brdfcheck.brdf.readers.glsl.machine import LoopPlan, Machine, Run
from brdfcheck.brdf.readers.glsl.scopes import Routine, constant_of


class Statements(Calls):
    """Compiles statements. `_within`: what the statement stands in, loops and switches, innermost last."""

    _within: list[str]
    _returned: list[bool]

    def statement(self, node: syntax.Node) -> Run:
        """One statement."""
        return getattr(self, f"_do_{type(node).__name__.lower()}")(node)

    def block(self, nodes: list[syntax.Node]) -> Run:
        """Statements one after the other, without a scope of their own."""
        return _in_turn([self.statement(node) for node in nodes])

    def _do_block(self, node: syntax.Block) -> Run:
        with self.names.inner():
            return self.block(node.statements)

    def _scoped(self, node: syntax.Node) -> Run:
        with self.names.inner():
            return self.statement(node)

    def _do_expression(self, node: syntax.Expression) -> Run:
        return self.typed(node.value).run

    def _do_if(self, node: syntax.If) -> Run:
        condition = self.condition(node.condition, "the condition of an if")
        yes = self._scoped(node.yes)
        no = None if node.no is None else self._scoped(node.no)
        return lambda machine: machine.branch(condition(machine), yes, no)

    def _do_return(self, node: syntax.Return) -> Run:
        routine = self.caller
        if routine is None:
            raise self.mistake(node.at, "'return' outside of a function")
        self._returned[-1] = True
        slot = routine.result_slot
        if node.value is None:
            if routine.result != VOID:
                raise self.mistake(node.at, f"{routine.name}() returns {routine.result}: a value is missing")
            return lambda machine: machine.leave(None, None)
        value = self.typed(node.value)
        if routine.result == VOID:
            if value.type != VOID:
                raise self.mistake(node.at, f"{routine.name}() returns nothing; got {value.type}")
            inner = value.run

            def nothing(machine: Machine) -> None:
                inner(machine)
                machine.leave(None, None)

            return nothing
        run = self.converted(value, routine.result, node.value.at, f"what {routine.name}() returns")
        return lambda machine: machine.leave(slot, run(machine))

    def _do_jump(self, node: syntax.Jump) -> Run:
        if node.word == "discard":
            raise self.mistake(node.at, "'discard' has no meaning here: there is no pixel to leave out; return a value")
        if not (self._within if node.word == "break" else "loop" in self._within):
            raise self.mistake(node.at, f"{node.word!r} stands in no loop{' or switch' if node.word == 'break' else ''}")
        word = node.word
        return lambda machine: machine.jump(word)

    # --- declarations ---

    def _do_structdef(self, node: syntax.StructDef) -> Run:
        self.define_struct(node)
        return lambda machine: None

    def define_struct(self, node: syntax.StructDef) -> None:
        """A new type in the innermost scope."""
        fields: list[tuple[str, Type]] = []
        for line in node.fields:
            for variable in line.variables:
                kind = self.type_of(line.type, variable.sizes)
                if isinstance(kind, Opaque) or kind == VOID or kind.leaves == 0:
                    raise self.mistake(variable.at, f"the field {variable.name!r} cannot be {kind}")
                if variable.name in dict(fields):
                    raise self.mistake(variable.at, f"the struct {node.name!r} has two fields {variable.name!r}")
                if variable.value is not None:
                    raise self.mistake(variable.at, "a field cannot have a value of its own")
                fields.append((variable.name, kind))
        found = Struct(node.name, tuple(fields), node.at)
        if found.leaves > MOST_LEAVES:
            raise self.mistake(node.at, f"the struct {node.name!r} is larger than {MOST_LEAVES} numbers")
        self.names.structs[-1][node.name] = found

    def _do_declaration(self, node: syntax.Declaration) -> Run:
        outside = {"uniform", "in", "out", "inout", "attribute", "varying"} & set(node.qualifiers)
        if outside:
            raise self.mistake(node.at, f"{outside.pop()!r} belongs outside of functions")
        return _in_turn([self._declared(node, variable) for variable in node.variables])

    def _declared(self, node: syntax.Declaration, variable: syntax.Declarator) -> Run:
        if node.type.name == syntax.DEDUCED and variable.value is not None:
            kind = self.value(variable.value).type
        else:
            kind = self.type_of(node.type, variable.sizes)
        if kind == VOID:
            raise self.mistake(variable.at, f"the variable {variable.name!r} cannot be void")
        constant = "const" in node.qualifiers
        if variable.name in self.names.variables[-1]:
            raise self.mistake(variable.at, f"{variable.name!r} is declared twice")
        value: Run | None = None
        if variable.value is not None:
            typed = self.initial(variable.value, kind)
            kind, value = typed.type, typed.run
        elif constant:
            raise self.mistake(variable.at, f"the constant {variable.name!r} has no value")
        if isinstance(kind, Opaque):
            raise self.mistake(variable.at, f"{kind} can only be a uniform or a parameter")
        if isinstance(kind, Array) and kind.size is None:
            raise self.mistake(variable.at, f"how many elements has {variable.name!r}?")
        fixed = constant_of(value) if constant and value is not None else None
        added = self.names.add(variable.name, kind, f"{variable.name!r} is constant" if constant else "")
        slot, zero = added.slot, kind.zero()
        if fixed is not None and all(known(leaf) for leaf in jax.tree.leaves(fixed)):
            self.constants[slot] = fixed
        weight = kind.leaves // 16
        position = self.source.position(variable.at)

        def run(machine: Machine) -> None:
            machine.spend(position, 1 + weight)
            machine.declare(slot, zero if value is None else value(machine))

        return run

    # --- loops and switches ---

    def _do_loop(self, node: syntax.Loop) -> Run:
        with self.names.inner() as scope, self.names.noting() as (writes, calls, declared):
            start = None if node.start is None else self.statement(node.start)
            own = frozenset(variable.slot for variable in scope.values())
            condition = None if node.condition is None else self.condition(node.condition, "the condition of a loop")
            step = None if node.step is None else self.typed(node.step).run
            self._within.append("loop")
            self._returned.append(False)
            with self.names.noting() as (changed, _, _):
                body = self._scoped(node.body)
            self._within.pop()
            returned = self._returned.pop()
        self._returned[-1] = self._returned[-1] or returned
        endless = condition is None or (isinstance(node.condition, syntax.Number) and bool(node.condition.value))
        if isinstance(node.start, syntax.Declaration):
            declared -= own

        def slots() -> list[int]:
            return sorted((writes | changed_by(calls)) - declared)

        routine = self.caller
        result: tuple[int | None, Type] | None = None
        if returned and routine is not None:
            result = (routine.result_slot, routine.result)
        counted = bool(own) and not own & changed
        plan = LoopPlan(
            self.source.position(node.at), start, condition, step, body, node.test_first, endless, slots, own, result, counted
        )
        return lambda machine: machine.loop(plan)

    def _do_switch(self, node: syntax.Switch) -> Run:
        value = self.value(node.value)
        if kind_of(value.type) not in ("int", "uint") or not isinstance(value.type, Scalar):
            raise self.mistake(node.at, f"a switch takes int or uint; got {value.type}")
        seen: set[int] = set()
        groups: list[tuple[list[int], bool, Run]] = []
        defaults = 0
        self._within.append("switch")
        with self.names.inner():
            for case in node.cases:
                labels: list[int] = []
                for label in case.labels:
                    if label is None:
                        defaults += 1
                        continue
                    labels.append(self._label(label, value.type, seen))
                groups.append((labels, None in case.labels, self.block(case.statements)))
        self._within.pop()
        if defaults > 1:
            raise self.mistake(node.at, "a switch has one 'default' at most")
        inner = value.run

        def run(machine: Machine) -> None:
            chosen = inner(machine)
            hits: list[Any] = []
            anywhere: Any = False
            for labels, _, _ in groups:
                hit: Any = False
                for label in labels:
                    same = chosen == chosen.dtype.type(label)
                    hit = either(hit, bool(same) if known(same) else same)
                hits.append(hit)
                anywhere = either(anywhere, hit)
            rest = opposite(anywhere)
            cases = [
                (either(hit, rest) if default else hit, part) for hit, (_, default, part) in zip(hits, groups, strict=True)
            ]
            machine.switch(cases, False if defaults else rest)

        return run

    def _label(self, node: syntax.Node, wanted: Type, seen: set[int]) -> int:
        typed = self.value(node)
        value = constant_of(typed.run)
        if kind_of(typed.type) not in ("int", "uint") or not isinstance(typed.type, Scalar) or value is None:
            raise self.mistake(node.at, "a label must be a constant whole number")
        number = int(constant_of(converting(typed, wanted)))
        if number in seen:
            raise self.mistake(node.at, f"two labels are {number}")
        seen.add(number)
        return number


def _in_turn(runs: list[Run]) -> Run:
    """What runs one after the other, as long as there are lanes under way."""

    def run(machine: Machine) -> None:
        for part in runs:
            if machine.active is False:
                return
            part(machine)

    return run


def changed_by(calls: list[Routine]) -> set[int]:
    """The variables outside of them that these functions may change, and what they call in turn."""
    found: set[int] = set()
    seen: set[int] = set()
    waiting = list(calls)
    while waiting:
        routine = waiting.pop()
        if id(routine) not in seen:
            seen.add(id(routine))
            found |= routine.writes
            waiting += routine.calls
    return found
