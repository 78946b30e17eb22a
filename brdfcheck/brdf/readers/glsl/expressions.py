"""Expressions, compiled: types are checked once, what is left is a function of the machine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from brdfcheck.brdf.readers.glsl import arithmetic, matrices, syntax
from brdfcheck.brdf.readers.glsl.access import Accesses
from brdfcheck.brdf.readers.glsl.arithmetic import both, choose, either, known, opposite
from brdfcheck.brdf.readers.glsl.context import converting, literal
from brdfcheck.brdf.readers.glsl.errors import ShaderError, did_you_mean
from brdfcheck.brdf.readers.glsl.kinds import (
    BOOL,
    KINDS,
    Matrix,
    Scalar,
    Struct,
    Type,
    Vector,
    conversion,
    kind_of,
    numeric,
    with_kind,
)
from brdfcheck.brdf.readers.glsl.machine import Machine, Run
from brdfcheck.brdf.readers.glsl.scopes import Typed

_ARITHMETIC: dict[str, Callable[..., Any]] = {
    "+": lambda m, a, b: arithmetic.add(a, b),
    "-": lambda m, a, b: arithmetic.subtract(a, b),
    "*": lambda m, a, b: arithmetic.multiply(a, b),
    "/": arithmetic.divide,
    "%": arithmetic.remainder,
    "<<": lambda m, a, b: arithmetic.shift_left(a, b),
    ">>": lambda m, a, b: arithmetic.shift_right(a, b),
    "&": lambda m, a, b: a & b,
    "|": lambda m, a, b: a | b,
    "^": lambda m, a, b: a ^ b,
}
_COMPARED: dict[str, Callable[..., Any]] = {
    "<": lambda m, a, b: a < b,
    ">": lambda m, a, b: a > b,
    "<=": lambda m, a, b: a <= b,
    ">=": lambda m, a, b: a >= b,
    "==": lambda m, a, b: a == b,
    "!=": lambda m, a, b: a != b,
}
_WHOLE = frozenset(("%", "<<", ">>", "&", "|", "^"))
_MOST_CHAIN = 300
_RANK = {"bool": 0, "int": 1, "uint": 2, "float": 3}


class Expressions(Accesses):
    """Compiles expressions."""

    def _number(self, node: syntax.Number) -> Typed:
        kind = KINDS[node.kind]
        return Typed(Scalar(node.kind), literal(kind(node.value) if node.kind in ("float", "bool") else kind(int(node.value))))

    def _name(self, node: syntax.Name) -> Typed:
        variable, this = self.names.find(node.name), self.names.find("this")
        fields = dict(this.type.fields) if this is not None and isinstance(this.type, Struct) else {}
        # In a method, after what is its own and before what is the file's.
        if node.name in fields and variable is self.names.variables[0].get(node.name):
            return self._member(syntax.Member(node.at, syntax.Name(node.at, "this"), node.name))
        horizon = None if self.caller is None or self.dialect.spread else self.caller.horizon
        late = horizon is not None and variable is self.names.variables[0].get(node.name)
        if variable is None or (late and variable.slot > (horizon or 0)):
            if node.name.startswith("gl_"):
                raise self.mistake(
                    node.at, f"{node.name} has no value here: a BRDF may depend only on directions and parameters"
                )
            near = did_you_mean(node.name, set(self.names.all()) - {node.name})
            raise self.mistake(node.at, f"{node.name!r} is not defined{near}")
        slot = variable.slot
        self.used.add(slot)

        def locate(machine: Machine) -> Any:
            return (lambda: machine.state[slot]), (lambda value: machine.assign(slot, value))

        def run(machine: Machine) -> Any:
            return machine.state[slot]

        constant = self.constants.get(slot)
        return Typed(variable.type, run if constant is None else literal(constant), (slot, locate), variable.locked)

    def _braces(self, node: syntax.Braces) -> Typed:
        raise self.mistake(node.at, "a list in braces may only be what a variable begins with")

    def _comma(self, node: syntax.Comma) -> Typed:
        parts = [self.typed(part) for part in node.parts]
        runs = [part.run for part in parts]

        def run(machine: Machine) -> Any:
            return [part(machine) for part in runs][-1]

        return Typed(parts[-1].type, run)

    # --- operators ---

    def _unary(self, node: syntax.Unary) -> Typed:
        typed, operator = self.value(node.operand), node.operator
        kind, run = kind_of(typed.type), typed.run
        if operator == "!":
            if typed.type != BOOL and not (self.dialect.spread and isinstance(typed.type, (Scalar, Vector))):
                raise self.mistake(node.at, f"'!' takes a bool; got {typed.type}")
            wanted = with_kind(typed.type, "bool")
            inner = converting(typed, wanted)
            return Typed(wanted, lambda m: jax.tree.map(lambda x: np.bool_(not x) if known(x) else ~x, inner(m)))
        if operator == "~":
            if kind not in ("int", "uint"):
                raise self.mistake(node.at, f"'~' takes whole numbers; got {typed.type}")
            return Typed(typed.type, lambda m: jax.tree.map(lambda x: ~x, run(m)))
        if not numeric(typed.type):
            raise self.mistake(node.at, f"{operator!r} takes numbers; got {typed.type}")
        return Typed(typed.type, run if operator == "+" else lambda m: jax.tree.map(lambda x: -x, run(m)))

    def _binary(self, node: syntax.Binary) -> Typed:
        # From the left, without a call for each operator: chains may be long.
        chain: list[syntax.Binary] = []
        left: syntax.Node = node
        while isinstance(left, syntax.Binary):
            chain.append(left)
            left = left.left
        if len(chain) > _MOST_CHAIN:
            raise self.mistake(node.at, f"more than {_MOST_CHAIN} operators in a row")
        typed = self.value(left)
        for link in reversed(chain):
            typed = self.combined(link.operator, typed, self.value(link.right), link.at)
        return typed

    def combined(self, operator: str, left: Typed, right: Typed, at: int) -> Typed:
        """Two operands and what stands between them."""
        if operator in ("&&", "||", "^^"):
            return self._logic(operator, left, right, at)
        if operator in ("==", "!=") and not self.dialect.spread:
            return self._equality(operator, left, right, at)
        if operator in _COMPARED:
            plain = isinstance(left.type, Scalar) and isinstance(right.type, Scalar)
            if not (self.dialect.spread or (plain and numeric(left.type) and numeric(right.type))):
                raise self._mismatch(operator, left, right, at)
            shape, a, b = self._shaped(operator, left, right, at)
            return Typed(with_kind(shape, "bool"), _componentwise(_COMPARED[operator], a, b, 1))
        return self._arithmetic(operator, left, right, at)

    def _mismatch(self, operator: str, left: Typed, right: Typed, at: int) -> ShaderError:
        return self.mistake(at, f"{operator!r} does not take {left.type} and {right.type}")

    def _logic(self, operator: str, left: Typed, right: Typed, at: int) -> Typed:
        for side in (left, right):
            if side.type != BOOL and not (self.dialect.spread and isinstance(side.type, Scalar)):
                raise self.mistake(at, f"{operator!r} takes bool and bool; got {left.type} and {right.type}")
        a, b = converting(left, BOOL), converting(right, BOOL)

        def run(machine: Machine) -> Any:
            first = a(machine)
            if operator == "^^":
                second = b(machine)
                return np.bool_(first != second) if known(first, second) else first != second
            if known(first):
                return first if bool(first) == (operator == "||") else b(machine)
            second = machine.under(first if operator == "&&" else opposite(first), b)
            found = both(first, second) if operator == "&&" else either(first, second)
            return np.bool_(found) if known(found) else found

        return Typed(BOOL, run)

    def _equality(self, operator: str, left: Typed, right: Typed, at: int) -> Typed:
        a, b = left.run, right.run
        if left.type != right.type:
            if conversion(left.type, right.type) is not None:
                a = converting(left, right.type)
            elif conversion(right.type, left.type) is not None:
                b = converting(right, left.type)
            else:
                raise self._mismatch(operator, left, right, at)
        if left.type.leaves == 0:
            raise self._mismatch(operator, left, right, at)
        equal = operator == "=="

        def run(machine: Machine) -> Any:
            found: Any = True
            for x, y in zip(jax.tree.leaves(a(machine)), jax.tree.leaves(b(machine)), strict=True):
                found = both(found, x == y)
            found = found if equal else opposite(found)
            return np.bool_(found) if known(found) else found

        return Typed(BOOL, run)

    def _shaped(self, operator: str, left: Typed, right: Typed, at: int) -> tuple[Type, Run, Run]:
        """The common type of two operands that are taken component by component, and what gives them."""
        kinds = kind_of(left.type), kind_of(right.type)
        if None in kinds or "void" in kinds:
            raise self._mismatch(operator, left, right, at)
        if "bool" in kinds and not self.dialect.spread:
            raise self._mismatch(operator, left, right, at)
        kind = max((str(part) for part in kinds), key=_RANK.__getitem__)
        if kind == "bool" and operator in _ARITHMETIC:
            kind = "int"
        sizes = [side.type.size if isinstance(side.type, Vector) else 1 for side in (left, right)]
        if sizes[0] != sizes[1] and min(sizes) > 1:
            if not self.dialect.spread:
                raise self._mismatch(operator, left, right, at)
            sizes = [min(sizes)] * 2
        shape = Vector(kind, max(sizes)) if max(sizes) > 1 else Scalar(kind)
        a, b = (converting(side, shape if isinstance(side.type, Vector) else Scalar(kind)) for side in (left, right))
        return shape, a, b

    def _arithmetic(self, operator: str, left: Typed, right: Typed, at: int) -> Typed:
        if isinstance(left.type, Matrix) or isinstance(right.type, Matrix):
            return self._with_matrix(operator, left, right, at)
        shifted = operator in ("<<", ">>") and {kind_of(left.type), kind_of(right.type)} == {"int", "uint"}
        if shifted and not self.dialect.spread:  # the count may be of the other kind
            wanted = with_kind(right.type, str(kind_of(left.type)))
            right = Typed(wanted, converting(right, wanted))
        shape, a, b = self._shaped(operator, left, right, at)
        whole = kind_of(shape) in ("int", "uint")
        if operator in _WHOLE and not whole and not (operator == "%" and self.dialect.spread):
            raise self._mismatch(operator, left, right, at)
        return Typed(shape, _componentwise(_ARITHMETIC[operator], a, b, shape.leaves))

    def _with_matrix(self, operator: str, left: Typed, right: Typed, at: int) -> Typed:
        a, b = left.type, right.type
        first = left.run if kind_of(a) == "float" else converting(left, with_kind(a, "float")) if numeric(a) else None
        second = right.run if kind_of(b) == "float" else converting(right, with_kind(b, "float")) if numeric(b) else None
        if first is None or second is None or operator in _WHOLE:
            raise self._mismatch(operator, left, right, at)
        function = _ARITHMETIC[operator]
        result: Type
        run: Callable[..., Any]
        columns = a.columns if isinstance(a, Matrix) else 0
        if isinstance(a, Scalar) or isinstance(b, Scalar):
            result = b if isinstance(a, Scalar) else a
            run = lambda m, x, y: _spread(lambda p, q: function(m, p, q), x, y)  # noqa: E731
        elif a == b and (operator != "*" or self.dialect.spread):
            result, run = a, lambda m, x, y: jax.tree.map(lambda p, q: function(m, p, q), x, y)
        elif operator == "*" and isinstance(a, Matrix) and isinstance(b, Matrix) and columns == b.rows:
            result, run = Matrix(b.columns, a.rows), lambda m, x, y: matrices.product(x, y)
        elif operator == "*" and isinstance(a, Matrix) and b == Vector("float", columns):
            result, run = a.column, lambda m, x, y: matrices.times_vector(x, y)
        elif operator == "*" and isinstance(b, Matrix) and a == Vector("float", b.rows):
            result, run = Vector("float", b.columns), lambda m, x, y: matrices.vector_times(x, y)
        else:
            raise self._mismatch(operator, left, right, at)
        apply, cost = run, a.leaves * b.leaves

        def both_sides(machine: Machine) -> Any:
            machine.traced += cost
            return apply(machine, first(machine), second(machine))

        return Typed(result, both_sides)

    def _ternary(self, node: syntax.Ternary) -> Typed:
        yes, no = self.value(node.yes), self.value(node.no)
        asked = self.typed(node.condition)
        if self.dialect.spread and isinstance(asked.type, Vector):
            return self._by_component(asked, yes, no, node)
        condition = self.condition(node.condition, "what stands before '?'")
        kind = yes.type
        if yes.type != no.type:
            forth, back = self.fits(yes.type, no.type), self.fits(no.type, yes.type)
            if forth is None and back is None:
                raise self.mistake(node.at, f"'?:' needs two values of one type; got {yes.type} and {no.type}")
            kind = no.type if back is None or (forth is not None and forth < back) else yes.type
        first, second = converting(yes, kind), converting(no, kind)

        def run(machine: Machine) -> Any:
            mask = condition(machine)
            if known(mask):
                return (first if mask else second)(machine)
            chosen = machine.under(mask, first)
            other = machine.under(opposite(mask), second)
            return jax.tree.map(lambda x, y: choose(mask, x, y), chosen, other)

        return Typed(kind, run)

    def _by_component(self, asked: Typed, yes: Typed, no: Typed, node: syntax.Ternary) -> Typed:
        """``v > 0 ? a : b`` of HLSL with a vector v: each component for itself."""
        kinds = sorted((str(kind_of(yes.type)), str(kind_of(no.type))), key=lambda kind: _RANK.get(kind, 0))
        kind = with_kind(asked.type, kinds[-1])
        masks = self.converted(asked, with_kind(asked.type, "bool"), node.at, "what stands before '?'")
        first = self.converted(yes, kind, node.at, "what stands behind '?'")
        second = self.converted(no, kind, node.at, "what stands behind ':'")
        return Typed(kind, lambda m: jax.tree.map(choose, masks(m), first(m), second(m)))


def _spread(function: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """A function on all pairs of components; a scalar goes with each component of the other."""
    if isinstance(a, tuple):
        if isinstance(b, tuple):
            return tuple(_spread(function, x, y) for x, y in zip(a, b, strict=True))
        return tuple(_spread(function, x, b) for x in a)
    if isinstance(b, tuple):
        return tuple(_spread(function, a, y) for y in b)
    return function(a, b)


def _componentwise(function: Callable[..., Any], a: Run, b: Run, cost: int) -> Run:
    def run(machine: Machine) -> Any:
        x, y = a(machine), b(machine)
        if isinstance(x, tuple) or isinstance(y, tuple):
            machine.traced += cost
            return _spread(lambda p, q: function(machine, p, q), x, y)
        if not known(x, y):
            machine.traced += 1
        found = function(machine, x, y)
        return found

    return run
