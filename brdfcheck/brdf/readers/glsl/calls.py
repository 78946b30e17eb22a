"""Calls: which function is meant, what its arguments become, and what comes back."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.arithmetic import choose, known
from brdfcheck.brdf.readers.glsl.constructors import Constructors
from brdfcheck.brdf.readers.glsl.context import converting
from brdfcheck.brdf.readers.glsl.errors import did_you_mean
from brdfcheck.brdf.readers.glsl.foreign import FOREIGN
from brdfcheck.brdf.readers.glsl.kinds import NAMED, Scalar, Type
from brdfcheck.brdf.readers.glsl.library import BUILTINS, MEANINGLESS, Builtin
from brdfcheck.brdf.readers.glsl.machine import Machine, Run
from brdfcheck.brdf.readers.glsl.scopes import Routine, Typed


class Calls(Constructors):
    """Compiles calls. `calls`: who calls whom, and where; `_waiting`: what is called and has to be compiled yet."""

    calls: dict[int, list[tuple[Routine, int]]]
    _waiting: list[Routine]

    def call(self, node: syntax.Call) -> Typed:
        """A call of a function or of a constructor, compiled."""
        kind = self.names.struct(node.name) or NAMED.get(node.name)
        arguments = [self.typed(argument) for argument in node.arguments]
        if kind is not None:
            return self.construct(kind, arguments, node)
        for argument, part in zip(arguments, node.arguments, strict=True):
            if argument.type == Scalar("void"):
                raise self.mistake(part.at, "this function returns nothing")
        this = self.names.find("this")
        if this is not None and (method := f"{this.type}.{node.name}") in self.routines:
            return self.call(syntax.Call(node.at, method, [syntax.Name(node.at, "this"), *node.arguments]))
        name = node.name
        own = self.routines.get(name, [])
        routine = self._best(name, [(item, item.types, item.ways) for item in own], arguments, node, quiet=True)
        if routine is not None:
            return self._user(routine, arguments, node)
        name = self.dialect.functions.get(name, name)
        forms = [*(FOREIGN.get(name, ()) if self.dialect.spread else ()), *BUILTINS.get(name, ())]
        if not own and name in MEANINGLESS:
            raise self.mistake(node.at, f"{node.name}() cannot be evaluated: {MEANINGLESS[name]}")
        found = self._best(name, [(item, item.types, item.ways) for item in forms], arguments, node, quiet=bool(own))
        if found is not None:
            return self._builtin(found, arguments, node)
        if own:
            self._best(name, [(item, item.types, item.ways) for item in own], arguments, node, quiet=False)
        names = [*self.routines, *BUILTINS, *(FOREIGN if self.dialect.spread else ())]
        raise self.mistake(node.at, f"there is no function {node.name!r}{did_you_mean(node.name, names)}")

    _call = call

    def _best(
        self, name: str, forms: list[tuple[Any, Any, Any]], arguments: list[Typed], node: syntax.Call, *, quiet: bool
    ) -> Any:
        """The form that takes the arguments with the fewest conversions. None where `quiet` and none does."""
        if not forms:
            return None
        given = [argument.type for argument in arguments]
        ranked: list[tuple[int, Any]] = []
        for form, types, ways in forms:
            steps = [self._steps(a, b, way) for a, b, way in zip(given, types, ways, strict=False)]
            if len(types) == len(given) and None not in steps:
                ranked.append((sum(step or 0 for step in steps), form))
        if ranked:
            least = min(cost for cost, _ in ranked)
            winners = [form for cost, form in ranked if cost == least]
            if len(winners) > 1 and least > 0 and not self.dialect.spread:
                raise self.mistake(
                    node.at, f"{name}() is ambiguous for ({', '.join(map(str, given))}): {len(winners)} forms fit equally"
                )
            return winners[0]
        if quiet:
            return None
        shown = ", ".join(map(str, given))
        if len(forms) == 1:
            form, types, _ = forms[0]
            wanted = form.signature if isinstance(form, Routine) else ", ".join(map(str, types))
            if len(types) != len(given):
                plural = "argument" if len(types) == 1 else "arguments"
                raise self.mistake(node.at, f"{name}() takes {len(types)} {plural} ({wanted}); got {len(given)}")
            raise self.mistake(node.at, f"{name}() takes ({wanted}); got ({shown})")
        counts = sorted({len(types) for _, types, _ in forms})
        if len(given) not in counts:
            words = " or ".join(map(str, counts))
            raise self.mistake(
                node.at, f"{name}() takes {words} {'argument' if counts == [1] else 'arguments'}; got {len(given)}"
            )
        some = "; ".join(f"({', '.join(map(str, types))})" for _, types, _ in forms[:4])
        raise self.mistake(node.at, f"no form of {name}() takes ({shown}); there are {some}{'; ...' if len(forms) > 4 else ''}")

    def _steps(self, given: Type, wanted: Type, way: str) -> int | None:
        if way == "in":
            return self.fits(given, wanted)
        back = self.fits(wanted, given)
        if way == "out" or back is None:
            return back
        forth = self.fits(given, wanted)
        return None if forth is None else max(forth, back)

    def _places(self, ways: Any, types: Any, arguments: list[Typed], node: syntax.Call) -> list[Any]:
        """For each argument what goes in (None: nothing), what finds the place for what comes out, and what makes that fit."""
        found: list[Any] = []
        for way, kind, argument, part in zip(ways, types, arguments, node.arguments, strict=True):
            into = None if way == "out" else converting(argument, kind)
            locate = None if way == "in" else self.target(argument, part.at)
            found.append((into, locate, converting(Typed(kind, lambda m: m.operands[-1]), argument.type)))
        return found

    def _builtin(self, form: Builtin, arguments: list[Typed], node: syntax.Call) -> Typed:
        places, run = self._places(form.ways, form.types, arguments, node), form.run
        cost = sum(kind.leaves for kind in form.types)
        position = self.source.position(node.at)
        outputs = [(locate, back) for _, locate, back in places if locate is not None]
        inputs = [into for into, _, _ in places if into is not None]

        def evaluate(machine: Machine) -> Any:
            spots = [(locate(machine), back) for locate, back in outputs]
            values = [into(machine) for into in inputs]
            machine.spend(position)
            if any(not known(leaf) for value in values for leaf in jax.tree.leaves(value)):
                machine.traced += cost
            found = run(machine, *values)
            if not outputs:
                return found
            for ((_, put), back), value in zip(spots, found[1:], strict=True):
                put(_back(machine, back, value))
            return found[0]

        return Typed(form.result, evaluate)

    def _user(self, routine: Routine, arguments: list[Typed], node: syntax.Call) -> Typed:
        if routine.body is None:
            raise self.mistake(node.at, f"{routine.name}() is declared and nowhere defined")
        self.calls.setdefault(id(self.caller), []).append((routine, node.at))
        self.names.called(routine)
        self.wanted(routine)
        places = self._places(routine.ways, routine.types, arguments, node)
        position = self.source.position(node.at)

        def run(machine: Machine) -> Any:
            machine.spend(position)
            spots = [None if locate is None else locate(machine) for _, locate, _ in places]
            values = [
                kind.zero() if into is None else into(machine) for (into, _, _), kind in zip(places, routine.types, strict=True)
            ]
            result = perform(machine, routine, values)
            for spot, (_, _, back), slot in zip(spots, places, routine.slots, strict=True):
                if spot is not None:
                    spot[1](_back(machine, back, machine.state[slot]))
            return result

        return Typed(routine.result, run)

    def wanted(self, routine: Routine) -> None:
        """Note that a function has to be compiled."""
        if routine.compiled is None and not any(item is routine for item in self._waiting):
            self._waiting.append(routine)


def _back(machine: Machine, back: Run, value: Any) -> Any:
    machine.operands.append(value)
    found = back(machine)
    machine.operands.pop()
    return found


def perform(machine: Machine, routine: Routine, values: list[Any]) -> Any:
    """Run a function with these arguments."""
    if routine.compiled is None:
        raise KeyError(routine.name)  # nothing is known of it yet
    entry = machine.active
    for slot, value in zip(routine.slots, values, strict=True):
        machine.declare(slot, value)
    if routine.result_slot is not None:
        machine.state[routine.result_slot] = None
    routine.compiled(machine)
    lost, machine.active = machine.active, entry
    if routine.result_slot is None:
        return ()
    found = machine.state[routine.result_slot]
    found = routine.result.zero() if found is None else found
    # Lanes that come to the end without a return have no value.
    if lost is False:
        return found
    return jax.tree.map(lambda x: choose(lost, np.float64(np.nan), x) if x.dtype.kind == "f" else x, found)
