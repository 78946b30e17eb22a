"""The cores that this process may use, and how it, a thread or other processes are bound to some of them.

XLA starts a thread for each core that it finds and its programs wait for them all: processes that share the cores then wait
for each other (two processes on two cores spent half of their time so). With a core for each nobody waits.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def available_cores() -> list[int]:
    """The cores that this process may use."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


def bind_thread(*cores: int) -> None:
    """Bind the calling thread, and every thread and process that it starts from now on, to these cores.

    Where the system cannot do that, nothing happens.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)


@contextlib.contextmanager
def on_one_core() -> Iterator[None]:
    """Bind every thread of this process to one core: those of XLA too, which it started on all of them.

    Where the system cannot do that, nothing happens. Linear algebra has one thread then: several on one core spin in wait for
    each other (a rule of 512 nodes from numpy took 20 times as long).
    """
    from threadpoolctl import threadpool_limits  # looks at all libraries that are loaded

    before = available_cores()
    _bind_process(before[:1])
    try:
        with threadpool_limits(1):
            yield
    finally:
        _bind_process(before)


def _bind_process(some: Iterable[int]) -> None:
    if not hasattr(os, "sched_setaffinity"):
        return
    for thread in os.listdir("/proc/self/task") if os.path.isdir("/proc/self/task") else ("0",):
        with contextlib.suppress(ProcessLookupError):  # it has ended
            os.sched_setaffinity(int(thread), set(some))


_inside = threading.local()
# Seconds after which a thread gives up Python's lock while several share it; what it was before; how many requests share it.
_SWITCH, _before = 2e-4, 5e-3
_sharing = 0
_counting = threading.Lock()


def side_by_side(function: Callable[[Any], Any], pieces: Sequence[Any], *, most: int = 8) -> list[Any]:
    """`function` of all pieces, on as many cores as there are, but no more than `most`.

    What the function itself runs in this way runs on its core.
    """
    workers = min(len(available_cores()), len(pieces), most)
    if workers < 2 or getattr(_inside, "worker", False):
        return [function(piece) for piece in pieces]
    with _short_switches():
        return list(threads(workers, "brdfcheck-pieces").map(function, pieces))


def threads(count: int, name: str) -> ThreadPoolExecutor:
    """So many threads that wait for work. Who waits for threads in one of them needs others, of another name."""
    return _threads(count, name, tuple(available_cores()), os.getpid())


@functools.lru_cache(maxsize=8)
def _threads(count: int, name: str, cores: tuple[int, ...], process: int) -> ThreadPoolExecutor:
    """On these cores, and of `process`: a child that is forked has none of its parent's."""
    return ThreadPoolExecutor(count, name, initializer=lambda: setattr(_inside, "worker", True))


@contextlib.contextmanager
def _short_switches() -> Iterator[None]:
    """Let whoever comes back from a program wait less for Python's lock where another thread holds it: by default 5 ms."""
    global _before, _sharing
    with _counting:
        _sharing += 1
        if _sharing == 1:
            _before = sys.getswitchinterval()
            sys.setswitchinterval(_SWITCH)
    try:
        yield
    finally:
        with _counting:
            _sharing -= 1
            if not _sharing:
                sys.setswitchinterval(_before)
