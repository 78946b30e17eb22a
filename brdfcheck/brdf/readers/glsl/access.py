"""Parts of values: elements, fields, swizzles, as values and as what is assigned to; and assignments."""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.arithmetic import choose, known
from brdfcheck.brdf.readers.glsl.context import Context, converting
from brdfcheck.brdf.readers.glsl.errors import did_you_mean, mistake
from brdfcheck.brdf.readers.glsl.kinds import (
    Array,
    Matrix,
    Opaque,
    Scalar,
    Struct,
    Type,
    Vector,
    kind_of,
    numeric,
    rebuilt,
    vector,
)
from brdfcheck.brdf.readers.glsl.machine import Machine
from brdfcheck.brdf.readers.glsl.scopes import Routine, Typed, constant_of

_SWIZZLES = ("xyzw", "rgba", "stpq")
# Up to this many elements, choosing one after the other beats a table.
_FEW = 4


class Accesses(Context):
    """Compiles what reaches into values. `constants`: variables with a known value, by slot; `used`: those that are read."""

    constants: dict[int, Any]
    used: set[int]
    caller: Routine | None
    routines: dict[str, list[Routine]]

    @abc.abstractmethod
    def combined(self, operator: str, left: Typed, right: Typed, at: int) -> Typed:
        """Two operands and what stands between them."""

    # --- elements ---

    def _index(self, node: syntax.Index) -> Typed:
        base, index = self.value(node.base), self.value(node.index)
        if isinstance(base.type, Opaque):  # one of several
            return base
        if kind_of(index.type) not in ("int", "uint") or not isinstance(index.type, Scalar):
            if not (self.dialect.spread and isinstance(index.type, Scalar) and numeric(index.type)):
                raise self.mistake(node.index.at, f"an index must be int or uint; got {index.type}")
            index = Typed(Scalar("int"), converting(index, Scalar("int")))
        kind: Type
        if isinstance(base.type, Array):
            kind, size = base.type.element, base.type.size or 0
        elif isinstance(base.type, Matrix):
            kind, size = base.type.column, base.type.columns
        elif isinstance(base.type, Vector):
            kind, size = Scalar(base.type.kind), base.type.size
        else:
            raise self.mistake(node.at, f"{base.type} has no elements")
        fixed = constant_of(index.run)
        if fixed is not None and not 0 <= int(fixed) < size:
            raise self.mistake(node.index.at, f"the index {int(fixed)} lies outside of {base.type}: from 0 to {size - 1}")
        position = self.source.position(node.at)

        def checked(machine: Machine) -> Any:
            where = index.run(machine)
            if known(where) and not 0 <= int(where) < size:
                raise mistake(position, f"the index {int(where)} lies outside of {base.type}: from 0 to {size - 1}")
            if not known(where):
                machine.spend(position, kind.leaves)
                machine.traced += kind.leaves
            return where

        def run(machine: Machine) -> Any:
            return _element(base.run(machine), checked(machine))

        def locate(machine: Machine) -> Any:
            get, put = base.locate[1](machine)
            where = checked(machine)
            return (lambda: _element(get(), where)), (lambda value: put(_with_element(get(), where, value)))

        return Typed(kind, run, base.locate and (base.locate[0], locate), base.locked)

    # --- fields and swizzles ---

    def _member(self, node: syntax.Member) -> Typed:
        base, name = self.value(node.base), node.name
        if isinstance(base.type, Struct):
            names = [field for field, _ in base.type.fields]
            if name not in names:
                raise self.mistake(
                    node.at, f"{base.type} has no field {name!r}{did_you_mean(name, names)}; it has {', '.join(names)}"
                )
            place = names.index(name)
            return self._part(base, base.type.fields[place][1], (place,), whole=True)
        size = base.type.size if isinstance(base.type, Vector) else 1
        letters = next((word for word in _SWIZZLES if set(name) <= set(word)), None)
        scalar = isinstance(base.type, Scalar) and base.type.kind != "void" and self.dialect.spread
        if not (isinstance(base.type, Vector) or scalar) or letters is None or len(name) > 4:
            allowed = f"; allowed are up to four of {_SWIZZLES[0][:size]}" if isinstance(base.type, Vector) else ""
            raise self.mistake(node.at, f"{base.type} has no {name!r}{allowed}")
        places = tuple(letters.index(letter) for letter in name)
        if max(places) >= size:
            raise self.mistake(node.at, f"{base.type} has no component {name[places.index(max(places))]!r}")
        kind = vector(str(kind_of(base.type)), len(places))
        if scalar:
            return Typed(kind, lambda m: base.run(m) if len(places) == 1 else (base.run(m),) * len(places))
        found = self._part(base, kind, places, whole=len(places) == 1)
        if len(set(places)) < len(places):
            return found._replace(locked="a swizzle that names a component twice cannot be assigned to")
        return found

    def _part(self, base: Typed, kind: Type, places: tuple[int, ...], *, whole: bool) -> Typed:
        """Some parts of a tuple; `whole`: the one part itself, not a tuple of one."""

        def of(value: Any) -> Any:
            return value[places[0]] if whole else tuple(value[place] for place in places)

        def locate(machine: Machine) -> Any:
            get, put = base.locate[1](machine)

            def replace(value: Any) -> None:
                parts = list(get())
                for place, part in zip(places, (value,) if whole else value, strict=True):
                    parts[place] = part
                put(tuple(parts))

            return (lambda: of(get())), replace

        return Typed(kind, lambda m: of(base.run(m)), base.locate and (base.locate[0], locate), base.locked)

    def _method(self, node: syntax.Method) -> Typed:
        base = self.value(node.base)
        method = f"{base.type}.{node.name}"
        if isinstance(base.type, Struct) and method in self.routines:
            return self.call(syntax.Call(node.at, method, [node.base, *node.arguments]))
        if isinstance(base.type, Opaque):
            raise self.mistake(
                node.at, f"{node.name}() cannot be evaluated: a BRDF may depend only on directions and parameters"
            )
        size = base.type.size if isinstance(base.type, (Array, Vector)) else None
        size = base.type.columns if isinstance(base.type, Matrix) else size
        if node.name != "length" or node.arguments or size is None:
            raise self.mistake(node.at, f"{base.type} has no method {node.name!r}; arrays have length()")
        return Typed(Scalar("int"), lambda m: np.int32(size))

    # --- assignments ---

    def target(self, typed: Typed, at: int) -> Callable[[Machine], Any]:
        """What finds (get, set) of something that can be assigned to; refused where it cannot."""
        if typed.locate is None:
            raise self.mistake(at, "this is no variable: it cannot be assigned to")
        if typed.locked:
            raise self.mistake(at, typed.locked)
        self.names.written(typed.locate[0])
        return typed.locate[1]

    def _assign(self, node: syntax.Assign) -> Typed:
        target = self.typed(node.target)
        locate = self.target(target, node.at)
        value = self.value(node.value)
        if node.operator == "=":
            run = self.converted(value, target.type, node.value.at, "what is assigned")

            def plain(machine: Machine) -> Any:
                found = run(machine)
                locate(machine)[1](found)
                return found

            return Typed(target.type, plain)
        before = Typed(target.type, lambda m: m.operands[-1])
        combined = self.combined(node.operator[:-1], before, value, node.at)
        if combined.type != target.type and not (self.dialect.spread and self.fits(combined.type, target.type) is not None):
            raise self.mistake(node.at, f"{node.operator!r} would make a {combined.type} of a {target.type}")
        new = converting(combined, target.type)

        def run_operator(machine: Machine) -> Any:
            get, put = locate(machine)
            machine.operands.append(get())
            found = new(machine)
            machine.operands.pop()
            put(found)
            return found

        return Typed(target.type, run_operator)

    def _step(self, node: syntax.Step) -> Typed:
        target = self.typed(node.operand)
        locate = self.target(target, node.at)
        if not numeric(target.type):
            raise self.mistake(node.at, f"{node.operator!r} takes numbers; got {target.type}")
        sign = 1 if node.operator == "++" else -1

        def run(machine: Machine) -> Any:
            get, put = locate(machine)
            before = get()
            after = jax.tree.map(lambda x: x + x.dtype.type(1) if sign > 0 else x - x.dtype.type(1), before)
            put(after)
            return after if node.before else before

        return Typed(target.type, run)


def _element(value: Any, index: Any) -> Any:
    """The element at an index, which JAX may not know yet: then out of a table."""
    if known(index):
        return value[int(index)]
    first, size = value[0], len(value)
    columns = [jax.tree.leaves(part) for part in value]
    if size <= _FEW:
        found = [_chosen([column[leaf] for column in columns], index) for leaf in range(len(columns[0]))]
        return rebuilt(first, iter(found))
    where = jnp.clip(index.astype(jnp.int32), 0, size - 1)
    found = []
    for leaf in range(len(columns[0])):
        entries = [column[leaf] for column in columns]
        if known(*entries):
            found.append(jnp.asarray(np.array(entries))[where])
        else:
            table = jnp.stack(jnp.broadcast_arrays(*map(jnp.asarray, (*entries, where)))[:-1])
            at = jnp.broadcast_to(where, table.shape[1:])
            found.append(jnp.take_along_axis(table, at[None], axis=0)[0])
    return rebuilt(first, iter(found))


def _chosen(entries: list[Any], index: Any) -> Any:
    found = entries[0]
    for place, entry in enumerate(entries[1:], start=1):
        found = choose(index >= place, entry, found)
    return found


def _with_element(value: Any, index: Any, new: Any) -> Any:
    """The tuple with another element at an index."""
    if known(index):
        place = int(index)
        return (*value[:place], new, *value[place + 1 :])

    def at(place: int, before: Any) -> Any:
        return jax.tree.map(lambda x, y: choose(index == place, x, y), new, before)

    return tuple(at(place, before) for place, before in enumerate(value))
