"""The same chunks on a Dask cluster: workers compute, the process with the store writes.

Workers need this package, but no file of the user's and no shared file system: the configuration and the texts of users'
files travel with the tasks. A task names its chunks and its results name them again, so it does not matter who computes
what, how often, or in which order; Dask gives the tasks of a worker that dies to the others.
"""

from __future__ import annotations

import asyncio
import atexit
import collections
import contextlib
import functools
import json
import logging
import queue
import shutil
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from brdfcheck.messages import SweepError, UsageError, one_line
from brdfcheck.runtime import use_compilation_cache
from brdfcheck.sweep import config
from brdfcheck.sweep.compute import Computer, Result
from brdfcheck.sweep.layout import differences, facts
from brdfcheck.sweep.plan import Chunk, Plan

# Seconds to wait for an answer of the scheduler, for a first worker, for another worker once all have gone, and for the
# transfer of a result.
_ANSWER, _FIRST_WORKER, _NEW_WORKER, _RESULT = 5.0, 10.0, 30.0, 120.0
# Results waiting for the store, for each thread of the cluster: what bounds the memory of the process that writes.
_AHEAD = 2
# How often a task is given out again whose results are lost, as they may be when a worker or a connection breaks off.
_AGAIN = 3
_KEPT = "the chunks computed so far are kept: run again to continue"
# What is raised where nobody answers.
_GONE = (OSError, TimeoutError, asyncio.CancelledError)


# --- what runs on a worker ---


_lock = threading.RLock()


@functools.lru_cache(maxsize=4)
def _computer(payload: str) -> Computer:
    use_compilation_cache()
    task = json.loads(payload)
    folder = Path(tempfile.mkdtemp(prefix="brdfcheck-sweep-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    places = {}
    for i, (path, texts) in enumerate(task["files"].items()):
        (folder / str(i)).mkdir()
        for name, text in texts.items():
            (folder / str(i) / name).write_bytes(text.encode("latin-1"))
        places[path] = folder / str(i) / Path(path).name
    return Computer(Plan(config.parse(task["config"], folder=folder, label=task["label"]), places))


def facts_here() -> dict[str, Any]:
    """What this process would compute with, for comparison, and how many devices it has."""
    import jax

    return {**facts(), "devices": jax.local_device_count()}


def compute_here(payload: str, ours: dict[str, Any], indices: Sequence[int]) -> list[Result]:
    """The chunks of these numbers, computed in this process for the configuration in `payload`.

    UsageError where its software or its device are not those of the process that writes.
    """
    _refuse("a worker", facts(), ours)
    with _lock:  # users' files are imported once
        computer = _computer(payload)
    plan = computer.plan
    return [result for wave in plan.waves(map(plan.chunk, indices), computer.width) for result in computer(wave)]


def _refuse(worker: str, theirs: dict[str, Any], ours: dict[str, Any]) -> None:
    found = differences({name: theirs[name] for name in ours}, ours, "the worker")
    if found:
        raise UsageError(f"--scheduler: {worker} does not fit: {'; '.join(found)}")


# --- what runs where the store is ---


class Cluster:
    """The workers of the scheduler at `address`, as a context manager.

    UsageError where Dask is not installed, no scheduler answers, it has no workers, or a worker has other software.
    """

    def __init__(self, address: str):
        try:
            import distributed
        except ImportError:
            raise UsageError("--scheduler needs Dask: pip install 'brdfcheck[cluster]'") from None
        _silence("distributed", "tornado", "asyncio")
        if not address.strip():  # Dask would start a cluster of its own
            raise UsageError("--scheduler: the address is empty; it looks like tcp://10.0.0.1:8786")
        self._address = address
        try:
            self._client: Any = distributed.Client(address, timeout=_ANSWER, set_as_default=False)
        except (OSError, TimeoutError):
            raise UsageError(f"--scheduler: no scheduler answers at {address}; start one with: dask scheduler") from None
        except (ValueError, TypeError) as error:
            text = f"--scheduler: {address!r} is no address, as in tcp://10.0.0.1:8786: {one_line(error)}"
            raise UsageError(text) from None
        try:
            self._devices = self._checked_workers()
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):  # the scheduler may have gone
            self._client.close(timeout=2)

    def _checked_workers(self) -> int:
        """Wait for the first worker, compare all that are there with this process, and return the most devices one has."""
        address = self._address
        try:
            self._client.wait_for_workers(1, timeout=_FIRST_WORKER)
        except TimeoutError:
            raise UsageError(f"--scheduler: {address} has no workers; start some with: dask worker {address}") from None
        answers = self._client.run(facts_here, on_error="return")
        for worker, theirs in answers.items():
            if isinstance(theirs, BaseException):
                raise _failure(f"the worker {worker}", theirs)
            _refuse(f"the worker {worker}", theirs, facts())
        return max((theirs["devices"] for theirs in answers.values()), default=1)

    def results(self, plan: Plan, chunks: Iterable[Chunk]) -> Iterator[Result]:
        """These chunks (in program order) as they come, in any order, each once. SweepError where the cluster is lost."""
        payload = json.dumps({"config": plan.config.document(), "label": plan.config.label, "files": plan.sources})
        ours = facts()
        batches = ([chunk.index for chunk in wave] for wave in plan.waves(chunks, self._devices))
        waiting: dict[Any, list[int]] = {}
        again = collections.Counter[int]()
        finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        alive = time.monotonic()

        def give(batch: list[int]) -> None:
            future = self._client.submit(compute_here, payload, ours, batch, pure=False, retries=0)
            waiting[future] = batch
            future.add_done_callback(finished.put)

        while True:
            while len(waiting) < _AHEAD * max(1, self._threads()) and (batch := next(batches, None)) is not None:
                give(batch)
            if not waiting:
                return
            try:
                future = finished.get(timeout=1.0)
            except queue.Empty:
                if self._threads():
                    alive = time.monotonic()
                elif time.monotonic() - alive > (_NEW_WORKER if self._client.status == "running" else _ANSWER):
                    raise self._lost() from None
                continue
            alive = time.monotonic()
            batch, results = waiting.pop(future), self._answer(future)
            if results is None:
                if again[batch[0]] == _AGAIN or not self._threads():
                    raise self._lost()
                again[batch[0]] += 1
                give(batch)
                continue
            assert [result.index for result in results] == batch
            future.release()
            yield from results

    def _threads(self) -> int:
        """How many chunks the cluster computes at a time; 0 where it has no workers or does not answer."""
        if self._client.status != "running":
            return 0
        try:
            return sum(self._client.nthreads().values())
        except _GONE:
            return 0

    def _lost(self) -> SweepError:
        what = "all workers have gone from the scheduler" if self._client.status == "running" else "lost the scheduler"
        what = "results are lost again and again on their way from the scheduler" if self._threads() else what
        return SweepError(f"{what} at {self._address}; {_KEPT}")

    def _answer(self, future: Any) -> list[Result] | None:
        """The results of a task that has ended; None where they are lost on their way."""
        from distributed import KilledWorker

        if future.status not in ("finished", "error"):
            return None
        try:
            return future.result(timeout=_RESULT)
        except UsageError:
            raise
        except KilledWorker:
            text = "one worker after another died while it computed the same chunk (out of memory?)"
            raise SweepError(f"{text}; {_KEPT}") from None
        except _GONE:
            return None
        except Exception as error:
            raise _failure(f"a worker of {self._address}", error) from None


def _silence(*packages: str) -> None:
    """No log of these packages below CRITICAL: what they have to say is said here, in one line.

    Dask gives some of their loggers a level of their own, such as distributed.client; its configuration may do so with any.
    """
    for name in (*packages, *logging.root.manager.loggerDict):
        if name.partition(".")[0] in packages:
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _failure(worker: str, error: BaseException) -> Exception:
    """What is raised where a worker raises something that is no message. Dask wraps failed imports in other errors."""
    text = f"{type(error).__name__}: {error} {error.__cause__!r}"
    if any(name in text for name in ("ModuleNotFoundError", "ImportError", "AttributeError")):
        return UsageError(f"--scheduler: {worker} has no such brdfcheck: {one_line(error)}")
    return SweepError(f"{worker} failed: {type(error).__name__}: {one_line(error)}; {_KEPT}")
