"""Commands run as processes: side by side with a core for each, or one at a time with all cores."""

from __future__ import annotations

import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass

from brdfcheck.cores import available_cores, bind_thread
from brdfcheck.interruption import Cleanup

# The first process that uses an accelerator would take most of its memory.
_SHARED = {"XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
# Seconds that a process has to end itself once it is told of an interruption.
_GRACE = 0.8


@dataclass(frozen=True)
class Finished:
    """How a process ended: its exit status (negative: the signal that ended it), its seconds, and what it wrote."""

    name: str
    code: int
    seconds: float
    output: str

    @property
    def last_words(self) -> str:
        """The error of its traceback, else the last line that it wrote; how it ended, where that says more."""
        if self.code < 0:
            return f"ended by signal {-self.code}"
        lines = [line.rstrip() for line in self.output.splitlines() if line.strip()]
        # After a traceback there may be notes.
        errors = [line for line in lines if re.match(r"[A-Za-z_][\w.]*(Error|Exception|Interrupt|Exit|Warning)\b", line)]
        return (errors or [line.strip() for line in lines] or [f"ended with exit code {self.code}"])[-1]


def run_all(commands: Mapping[str, Sequence[str]], *, side_by_side: bool) -> Generator[Finished, None, None]:
    """Run the commands by name, begun in their order, and give how each ended as soon as it has.

    Side by side: as many at once as this process has cores, each bound to one of its own. Otherwise one after the other, each
    on all of them. An exception in the caller, or closing the iterator, ends the processes: they are interrupted, and killed
    where that is not enough. So does Ctrl-C where it is watched for.
    """
    cores: queue.SimpleQueue[int | None] = queue.SimpleQueue()
    places = available_cores() if side_by_side else [None]
    for core in places:
        cores.put(core)
    lock, ended = threading.Lock(), False
    running: dict[str, subprocess.Popen[str]] = {}

    def run(name: str) -> Finished | None:
        core = cores.get()
        try:
            if core is not None:
                bind_thread(core)  # and with it the process that it starts
            began = time.perf_counter()
            with lock:
                if ended:
                    return None
                process = subprocess.Popen(
                    commands[name], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                    errors="backslashreplace", env={**(_SHARED if side_by_side else {}), **os.environ},
                )  # fmt: skip
                running[name] = process
            output, _ = process.communicate()
            del running[name]
            return Finished(name, process.returncode, time.perf_counter() - began, output)
        finally:
            cores.put(core)

    def end() -> None:
        nonlocal ended
        with lock:
            ended = True
        _end(list(running.values()))

    with Cleanup(end), ThreadPoolExecutor(len(places), "brdfcheck-process") as pool:
        futures = [pool.submit(run, name) for name in commands]
        try:
            for future in as_completed(futures):
                result = future.result()
                assert result is not None
                yield result
        finally:
            end()
            pool.shutdown(wait=False, cancel_futures=True)


def _end(processes: Sequence[subprocess.Popen[str]]) -> None:
    for process in processes:
        if sys.platform == "win32":  # which knows of no interruption from outside
            process.terminate()
        else:
            process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + _GRACE
    for process in processes:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
