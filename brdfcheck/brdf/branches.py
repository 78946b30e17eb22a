"""A function of one pair of directions that chooses by ``if``, as a JAX program.

It is run once for each way through its branches, with tracers; what each way returns is chosen by the conditions that led
there. ``and``, ``or``, ``min``, ``max`` and ``assert`` are branches too: they ask a number whether it is true.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

_MOST = 64  # ways: those of six independent branches

_lock, _local = threading.RLock(), threading.local()


class TooManyWays(Exception):
    """There are more ways through a function than are followed: a loop that ends by a condition, for one."""


class _Way:
    """One way through a function: the decisions that it begins with, and all that are asked for; where it is new, False."""

    def __init__(self, begin: tuple[bool, ...]):
        self.begin, self.conditions = begin, []

    def decide(self, condition: Any) -> bool:
        self.conditions.append(condition)
        return self.decisions[len(self.conditions) - 1]

    @property
    def decisions(self) -> tuple[bool, ...]:
        return self.begin + (False,) * (len(self.conditions) - len(self.begin))

    def taken(self) -> Any:
        """Where it is taken, as a truth value of JAX."""
        found: Any = True
        for condition, decision in zip(self.conditions, self.decisions, strict=True):
            found = jnp.logical_and(found, condition if decision else jnp.logical_not(condition))
        return found


@contextlib.contextmanager
def _along(way: _Way) -> Iterator[None]:
    """Within it, a tracer of this thread that is asked whether it is true answers as the way says."""
    plain = Tracer.__bool__

    def answer(self: Any) -> bool:
        try:
            return plain(self)
        except jax.errors.TracerBoolConversionError:
            if getattr(_local, "way", None) is None:
                raise
            return _local.way.decide(self)

    with _lock:
        before = getattr(_local, "way", None)
        _local.way, Tracer.__bool__ = way, answer
        try:
            yield
        finally:
            _local.way, Tracer.__bool__ = before, plain


def by_branches(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function for tracers, whatever it chooses by.

    Where a way through it ends without a value (None, or a failed ``assert``) the value is not a number. Raises TooManyWays,
    what `jnp.asarray` raises for answers that are no numbers, and what the function raises.
    """

    def chosen(*arguments: Any) -> Any:
        ahead: list[tuple[bool, ...]] = [()]
        found: list[tuple[_Way, Any]] = []
        while ahead:
            way = _Way(ahead.pop())
            with _along(way):
                try:
                    value = function(*arguments)
                except AssertionError:
                    value = None
            found.append((way, value))
            new = range(len(way.begin), len(way.conditions))
            ahead += [(*way.decisions[:count], True) for count in new]
            if len(found) + len(ahead) > _MOST:
                raise TooManyWays(f"more than {_MOST} ways through {function}")
        if all(value is None for _, value in found):
            raise TypeError(f"{function} returns nothing")
        if len(found) == 1:
            return jnp.asarray(found[0][1])
        # Plain numbers have no precision of their own.
        kinds = {value.dtype for _, value in found if jnp.issubdtype(getattr(value, "dtype", int), jnp.inexact)}
        kind = jnp.result_type(*kinds) if kinds else jnp.asarray(0.0).dtype
        values = jnp.asarray(np.nan, kind)
        for way, value in found:
            if value is not None:
                values = jnp.where(way.taken(), jnp.asarray(value).astype(kind), values)
        return values

    return chosen
