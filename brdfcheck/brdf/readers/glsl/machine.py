"""What runs a shader while JAX traces it: the variables, the mask of the lanes that are under way, and the loops.

A lane is a pair of directions. All lanes go through the program together; where they part, the mask says for which of them a
statement counts. There is no recursion, so each variable of the program has one slot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.readers.glsl.arithmetic import Mask, both, choose, either, known, opposite
from brdfcheck.brdf.readers.glsl.errors import Position, mistake
from brdfcheck.brdf.readers.glsl.kinds import Type, rebuilt

Run = Callable[["Machine"], Any]

# Rounds of a loop that are laid out one after the other, and operations of the program beyond which none is any more: XLA takes
# a second for some hundreds of them.
_UNROLLED, _TRACED = 512, 8_000
# Rounds that are laid out all the same.
_FEW = 16
# Steps of one run of the program, and operations that JAX traces, after which it is refused.
_MOST_STEPS, _MOST_TRACED = 200_000, 40_000
_MOST_ROUNDS = 4096
"""Rounds of a loop that depends on data; lanes that need more end with NaN."""


@dataclass
class LoopPlan:
    """A loop, compiled. `slots` gives the variables from outside that it may change; `own`: those of its head.

    `result`: the slot of the function's result, and its type, where there is a return inside. `counted`: the head alone says
    how many rounds there are.
    """

    position: Position
    start: Run | None
    condition: Run | None
    step: Run | None
    body: Run
    test_first: bool
    endless: bool
    slots: Callable[[], list[int]]
    own: frozenset[int]
    result: tuple[int | None, Type] | None
    counted: bool


@dataclass
class Machine:
    """One run of a program. `shape`: that of the lanes."""

    shape: tuple[int, ...]
    active: Mask = True
    state: dict[int, Any] = field(default_factory=dict)
    steps: int = 0
    traced: int = 0
    # What compound assignments that are under way began with.
    operands: list[Any] = field(default_factory=list)
    _born: dict[int, Mask] = field(default_factory=dict)
    _own: frozenset[int] = frozenset()
    _breaks: list[Mask] = field(default_factory=list)
    _continues: list[Mask] = field(default_factory=list)

    def spend(self, position: Position, count: int = 1) -> None:
        """Count steps. ShaderError where the program has more than can be traced."""
        self.steps += count
        if self.steps > _MOST_STEPS or self.traced > _MOST_TRACED:
            raise mistake(position, "the program is too large when its loops and calls are laid out one after the other")

    # --- variables ---

    def declare(self, slot: int, value: Any) -> None:
        """A new variable. Lanes that are not under way now never see it."""
        self.state[slot] = value
        self._born[slot] = self.active

    def assign(self, slot: int, value: Any) -> None:
        """A new value, for the lanes that are under way."""
        if self.active is True or slot in self._own or self._born.get(slot, True) is self.active:
            self.state[slot] = value
        else:
            self.state[slot] = self.merged(value, self.state[slot])

    def merged(self, value: Any, before: Any) -> Any:
        """A value where the lanes are under way, else what there was before."""
        return jax.tree.map(lambda new, old: choose(self.active, new, old), value, before)

    # --- where lanes part ---

    def branch(self, condition: Any, yes: Run, no: Run | None) -> None:
        """``if``."""
        if known(condition):
            taken = yes if condition else no
            if taken is not None:
                taken(self)
            return
        entry = self.active
        left = []
        for mask, part in ((condition, yes), (opposite(condition), no)):
            here = self.active = both(entry, mask)
            if part is not None and here is not False:
                part(self)
            left.append((here, self.active))
        if all(before is after for before, after in left):
            self.active = entry
        else:
            self.active = either(left[0][1], left[1][1])

    def under(self, mask: Any, run: Run) -> Any:
        """The value of an expression that counts only where the mask holds."""
        entry = self.active
        self.active = both(entry, mask)
        value = run(self)
        self.active = entry
        return value

    def leave(self, slot: int | None, value: Any) -> None:
        """``return``: the lanes that are under way have their result in this slot."""
        if slot is not None:
            before = self.state.get(slot)
            self.state[slot] = value if before is None or self.active is True else self.merged(value, before)
        self.active = False

    def jump(self, word: str) -> None:
        """``break`` or ``continue``."""
        stack = self._breaks if word == "break" else self._continues
        stack[-1] = either(stack[-1], self.active)
        self.active = False

    def switch(self, cases: list[tuple[Mask, Run]], missed: Mask) -> None:
        """Groups of statements with the masks of the lanes that begin there; `missed`: the lanes that begin nowhere."""
        entry = self.active
        self.active = False
        self._breaks.append(False)
        for mask, statements in cases:
            self.active = either(self.active, both(entry, mask))
            if self.active is not False:
                statements(self)
        self.active = either(either(self.active, self._breaks.pop()), both(entry, missed))

    # --- loops ---

    def loop(self, plan: LoopPlan) -> None:
        """Laid out while the condition is a known number, else repeated until no lane is left."""
        if plan.start is not None:
            plan.start(self)
        entry, begin = self.active, (dict(self.state), self.active)
        ended: Mask = False
        if not plan.endless:
            for number in range(_UNROLLED):
                before = dict(self.state), self.active
                left, traced = self._round(plan, ended)
                if traced and plan.test_first:
                    self.state, self.active = before
                    return self._repeat(plan, entry, ended)
                ended = left
                if self.active is False:
                    return self._finish(plan, entry, ended)
                if traced:
                    return self._repeat(plan, entry, ended)
                if self.traced > _TRACED and number >= _FEW:
                    break
            self.state, self.active, ended = dict(begin[0]), begin[1], False
            self._refuse_long(plan)
        return self._repeat(plan, entry, ended)

    def _refuse_long(self, plan: LoopPlan) -> None:
        """ShaderError where the head of a loop alone says that it has too many rounds."""
        if not plan.counted or plan.condition is None or plan.step is None:
            return
        kept = dict(self.state), self.active
        for _ in range(_MOST_ROUNDS + 1):
            going = plan.condition(self)
            if not known(going) or not going:
                break
            plan.step(self)
        else:
            raise mistake(plan.position, f"this loop has more than {_MOST_ROUNDS} rounds")
        self.state, self.active = kept

    def _round(self, plan: LoopPlan, ended: Mask) -> tuple[Mask, bool]:
        """Once through a loop: the lanes that have left it, and whether its condition was no known number."""
        self.spend(plan.position)
        traced = False
        if plan.test_first:
            ended, traced = self._tested(plan, ended)
            if self.active is False:
                return ended, traced
        self._breaks.append(False)
        self._continues.append(False)
        plan.body(self)
        ended = either(ended, self._breaks.pop())
        self.active = either(self.active, self._continues.pop())
        if not plan.test_first and self.active is not False:
            ended, traced = self._tested(plan, ended)
        if plan.step is not None and self.active is not False:
            outer, self._own = self._own, plan.own
            plan.step(self)
            self._own = outer
        return ended, traced

    def _tested(self, plan: LoopPlan, ended: Mask) -> tuple[Mask, bool]:
        if plan.condition is None:
            return ended, False
        condition = plan.condition(self)
        if known(condition):
            if not condition:
                ended, self.active = either(ended, self.active), False
            return ended, False
        ended = either(ended, both(self.active, opposite(condition)))
        self.active = both(self.active, condition)
        return ended, True

    def _finish(self, plan: LoopPlan, entry: Mask, ended: Mask) -> None:
        # Without a return inside, the lanes that come out are those that went in.
        self.active = entry if plan.result is None else ended

    def _repeat(self, plan: LoopPlan, entry: Mask, ended: Mask) -> None:
        """The rest of a loop as a loop of the compiled program."""
        carried = plan.slots()
        if plan.result is not None:
            slot, kind = plan.result
            if slot is not None:
                carried.append(slot)
                if self.state.get(slot) is None:
                    self.state[slot] = kind.zero()
        frame = {slot: self.state[slot] for slot in carried}
        outer = dict(self.state), dict(self._born)

        def spread(value: Any) -> Any:
            return jnp.broadcast_to(jnp.asarray(value), self.shape)

        def packed(active: Mask, ended: Mask) -> Any:
            leaves = [spread(leaf) for slot in carried for leaf in jax.tree.leaves(self.state[slot])]
            return (
                leaves,
                spread(np.bool_(active) if known(active) else active),
                spread(np.bool_(ended) if known(ended) else ended),
            )

        def unpack(leaves: Any) -> None:
            rest = iter(leaves)
            for slot in carried:
                self.state[slot] = rebuilt(frame[slot], rest)

        def going(carry: Any) -> Any:
            return jnp.any(carry[1]) & (carry[3] < _MOST_ROUNDS)

        def body(carry: Any) -> Any:
            unpack(carry[0])
            self.active = carry[1]
            left, _ = self._round(plan, carry[2])
            return *packed(self.active, left), carry[3] + 1

        start = (*packed(self.active, ended), jnp.asarray(0, jnp.int32))
        leaves, active, ended, _ = jax.lax.while_loop(going, body, start)
        self.state, self._born = outer
        # A lane that never came out has no value.
        lost = [jnp.where(active, jnp.nan, leaf) if leaf.dtype.kind == "f" else leaf for leaf in leaves]
        unpack(lost)
        self._finish(plan, entry, ended | active)
