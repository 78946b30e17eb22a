"""Where results go: stdout, files, a table for a person, a progress bar."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any, TextIO

from brdfcheck.messages import UsageError


class Output:
    """Where results go: a table for a person, plain lines for a file or a pipe, JSON alone on stdout for ``--json -``.

    While it is open, whatever a user's code prints goes to stderr.
    """

    def __init__(self, json: str | None):
        self._stdout = sys.stdout
        self.human: TextIO = sys.stderr if json == "-" else sys.stdout
        self.is_terminal = self.human.isatty()
        self._console: Any = None

    @property
    def console(self) -> Any:
        """The terminal, for tables."""
        if self._console is None:
            from rich.console import Console

            self._console = Console(file=self.human, markup=False, highlight=False, emoji=False, soft_wrap=False)
        return self._console

    def line(self, text: str = "") -> None:
        """One line for a person or for grep."""
        self._write(self.human, text + "\n")

    def stdout(self, text: str) -> None:
        """Text for stdout, whoever reads it."""
        self._write(self._stdout, text)

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
    def waiting(self, text: str) -> Iterator[Callable[[str], None]]:
        """A line on a terminal while something takes its time, gone afterwards; gives what to call with a new text."""
        stream = self.terminal()
        if stream is None:
            yield lambda text: None
            return
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False))
        console = Console(file=stream)
        with Progress(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False) as line:
            task = line.add_task(text)
            yield lambda text: line.update(task, description=text)

    @contextlib.contextmanager
    def progress(self, count: int, doing: str) -> Iterator[Callable[[], None]]:
        """A bar with the time left, on a terminal; `doing` says what for; gives what to call for each that is done."""
        stream = self.terminal()
        if stream is None:
            yield lambda: None
            return
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeRemainingColumn,
        )

        bar: Progress = Progress(
            SpinnerColumn(),
            TextColumn(doing),
            BarColumn(bar_width=32),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=Console(file=stream),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        with bar:
            task = bar.add_task("", total=count)
            yield lambda: bar.advance(task)


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
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def save(path: str, content: str | bytes, option: str) -> None:
    """Write a file whole or not at all. UsageError, which names the option, where that is not possible."""
    from brdfcheck.records import write_atomically

    try:
        write_atomically(path, content)
    except OSError as error:
        raise UsageError(f"{option}: cannot write {path!r}: {error.strerror or error}") from None
