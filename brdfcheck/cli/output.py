"""Where results go: stdout, files, a table for a person, a progress bar."""

from __future__ import annotations

import contextlib
import io
import math
import os
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, TextIO

from brdfcheck.interruption import Cleanup
from brdfcheck.messages import UsageError, one_line

_given: ContextVar[tuple[TextIO, str]] = ContextVar("_given")


@contextlib.contextmanager
def results_alone(arguments: Sequence[str]) -> Iterator[None]:
    """Within it, while the command with these arguments runs, stdout is for `Output`: what is printed goes to stderr."""
    before = _given.set((sys.stdout, shlex.join(["brdfcheck", *arguments])))
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _given.reset(before)


class Output:
    """Where results go: a table for a person, plain lines for a file or a pipe, JSON alone on stdout for ``--json -``.

    `json`: what ``--json`` says. `alone`: stdout is for something else, so that the lines for a person go to stderr. `quiet`:
    how far the work is is not told. `command`: the command line, as it was given.
    """

    def __init__(self, json: str | None = None, *, alone: bool = False, quiet: bool = False):
        self._stdout, self.command = _given.get((sys.stdout, ""))
        self._json, self._quiet, self._began = json, quiet, time.perf_counter()
        self.human: TextIO = sys.stderr if alone or json == "-" else self._stdout
        self.is_terminal = self.human.isatty()
        self._console: Any = None

    @property
    def console(self) -> Any:
        """The terminal, for tables."""
        if self._console is None:
            from rich.console import Console

            self._console = Console(file=self.human, markup=False, highlight=False, emoji=False, soft_wrap=False)
        return self._console

    @property
    def seconds(self) -> float:
        """How long it has been there."""
        return time.perf_counter() - self._began

    def line(self, text: str = "") -> None:
        """One line for a person or for grep."""
        self._write(self.human, text + "\n")

    def save(self, path: str, content: str | bytes, option: str) -> None:
        """Write a file whole or not at all, or text to stdout for "-".

        UsageError, which names the `option`, where that is not possible.
        """
        from brdfcheck.output.records import write_atomically

        if path == "-":
            self._write(self._stdout, str(content))
            return
        with refused(option, path):
            write_atomically(path, content)

    def write_json(self, record: Callable[[], Mapping[str, Any]]) -> None:
        """Write what `record` returns where ``--json`` says. UsageError where that is not possible."""
        from brdfcheck.output.records import to_json

        if self._json is not None:
            self.save(self._json, to_json(record()), "--json")

    @staticmethod
    def _write(stream: TextIO, text: str) -> None:
        try:
            with quiet_when_unread(stream):
                stream.write(text)
                stream.flush()
        except OSError as error:
            raise UsageError(f"cannot write to {stream.name}: {error.strerror or error}") from None

    def terminal(self) -> TextIO | None:
        """Where a person may watch: stderr or stdout, if it is a terminal."""
        return next((stream for stream in (sys.stderr, self._stdout) if stream.isatty()), None)

    @contextlib.contextmanager
    def progress(self, doing: str, count: int | None = None, every: float = math.inf) -> Iterator[Progress]:
        """How far a command is: on a terminal a line that moves, elsewhere one on stderr each `every` seconds.

        With a `count` of things to do a bar with the time left, and `doing` before what is said; without, what is said is the
        line, and `doing` its first text.
        """

        def columns(parts: Any) -> tuple[Any, ...]:
            left = parts.TimeRemainingColumn(), parts.TextColumn("left")
            counted = parts.TextColumn(doing), parts.BarColumn(bar_width=32), parts.MofNCompleteColumn(), *left
            return () if count is None else counted

        with moving(None if self._quiet else self.terminal(), columns) as bar:
            if bar is None:
                prefix = "" if count is None else doing
                yield Progress(lambda: None, _now_and_then(prefix, math.inf if self._quiet else every))
                return
            task = bar.add_task(doing if count is None else "", total=count)
            yield Progress(lambda: bar.advance(task), lambda text: bar.update(task, description=text))


@dataclass(frozen=True)
class Progress:
    """What a command calls as it goes: the object itself for each thing that is done, `say` with how far the next one is."""

    advance: Callable[[], None]
    say: Callable[[str], None]

    def __call__(self) -> None:
        self.advance()


@contextlib.contextmanager
def moving(stream: TextIO | None, columns: Callable[[Any], tuple[Any, ...]], **options: Any) -> Iterator[Any]:
    """rich's progress on a terminal, gone afterwards, with these `columns` of rich's module between spinner and text.

    None where there is no terminal.
    """
    if stream is None:
        yield None
        return
    from rich import progress as parts
    from rich.console import Console

    shown = parts.SpinnerColumn(), *columns(parts), parts.TextColumn("{task.description}", markup=False)
    console = Console(file=stream)
    options |= {"console": console, "transient": True, "redirect_stdout": False, "redirect_stderr": False}
    bar = parts.Progress(*shown, **options)
    with left_clean(stream), bar:
        yield bar


def _now_and_then(doing: str, every: float) -> Callable[[str], None]:
    """A line on stderr, at most one each `every` seconds; the first one after as long."""
    last = time.monotonic()
    lock = threading.Lock()

    def say(text: str) -> None:
        nonlocal last
        with lock:
            if time.monotonic() - last < every:
                return
            last = time.monotonic()
        with contextlib.suppress(OSError, ValueError):
            print(f"{doing} {text}".strip(), file=sys.stderr, flush=True)

    return say


def left_clean(stream: TextIO) -> Cleanup:
    """Where the command is interrupted within it, the line that moves on a terminal is removed and the cursor shown again."""
    return Cleanup(lambda: os.write(stream.fileno(), b"\r\x1b[2K\x1b[?25h"))


@contextlib.contextmanager
def refused(option: str, path: str) -> Iterator[None]:
    """What the system refuses within it, as a UsageError that names the option and the path."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{option}: cannot write {path!r}: {error.strerror or one_line(error)}") from None


@contextlib.contextmanager
def open_streams() -> Iterator[None]:
    """Standard output and error, where the process has none (Python then has None), are open, on nothing."""
    with contextlib.ExitStack() as stack:
        for stream, redirect in ((sys.stdout, contextlib.redirect_stdout), (sys.stderr, contextlib.redirect_stderr)):
            if stream is None:
                nowhere = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))
                stack.enter_context(redirect(nowhere))
        yield


def has_display() -> bool:
    """False where no window can be opened, and only a browser in the terminal, which would take the terminal over."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class _Unfailing(io.FileIO):
    """A file that drops what it cannot write."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


def unfailing(stream: TextIO | None) -> Any:
    """The same stream, but what cannot be written is dropped: messages, and what a user's code prints, are not the work."""
    try:
        if stream is None:
            return None
        raw = _Unfailing(stream.fileno(), "w", closefd=False)
    except (OSError, ValueError):  # it is no file of the system's
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(raw), encoding=stream.encoding, errors=stream.errors, newline="\n", line_buffering=True
    )


@contextlib.contextmanager
def quiet_when_unread(stream: TextIO) -> Iterator[None]:
    """Where the reader has gone (``| head``), the work goes on and the output goes nowhere."""
    try:
        yield
    except BrokenPipeError:
        discard(stream)


def discard(stream: TextIO) -> None:
    """Let what is still to be written to a stream go nowhere, also what Python itself writes at its end."""
    with contextlib.suppress(OSError, ValueError):
        number = stream.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)
