"""Ctrl-C ends a command at once, whatever the command is doing: one line, exit code 2.

Python's own way, KeyboardInterrupt in the main thread, comes late while native code compiles, is dropped where it meets a
callback or a destructor ("Exception ignored in"), and becomes any other error in the middle of an import. So the process of a
command does not raise it. A thread waits for the signal, stops the main thread, tidies up, and ends the process.

Imports almost nothing: what is imported before `watch` is not yet protected.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import NoReturn

# The exit code of an interrupted command, as for pytest.
EXIT_CODE = 2
# Seconds that the main thread has to stop before the tidying begins, that the tidying has, and that the last line has.
_STOPPING, _TIDYING, _WRITING = 0.25, 1.2, 0.3

_actions: list[Cleanup] = []
_stops: list[None] = []  # one for each time that the main thread was stopped
_left: list[int] = []  # the exit code, once the main thread has come to its end
_ending = _thread.allocate_lock()  # taken by whoever ends the process: the main thread at its end, or Ctrl-C
_writing = _thread.allocate_lock()  # taken by the thread that writes the line
_at_work = _thread.allocate_lock()  # held until the main thread has stopped


class Cleanup:
    """A context manager: `action` is called where the process is interrupted within it (see `watch`).

    The action runs in a thread of its own while the main thread stands still, whatever locks that holds: so it must not import
    anything, nor write to Python's streams (`say` does not). It has a second.
    """

    def __init__(self, action: Callable[[], object]):
        self._action = action

    def __call__(self) -> None:
        """Run the action, whatever it raises."""
        try:
            self._action()
        except BaseException:
            return

    def __enter__(self) -> Cleanup:
        _actions.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        _actions.remove(self)


def say(text: str) -> None:
    """Write a line to the standard error of the process, past Python's streams and their locks."""
    try:
        os.write(2, f"{text}\n".encode())
    except OSError:  # nobody reads it
        return


def watch() -> None:
    """From now on Ctrl-C ends this process with `EXIT_CODE` and the line "brdfcheck: interrupted", the second one at once.

    For processes that run one command and nothing else, from their main thread; a library leaves its caller's handlers alone.
    Does nothing where Ctrl-C is ignored, as in the background of a shell script, or has a handler.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return
    _at_work.acquire()
    signal.signal(signal.SIGINT, _stop)
    reading, writing = os.pipe()
    if sys.platform != "win32":  # where it need not be, and cannot
        os.set_blocking(writing, False)
    # Python's C handler writes there at once, whatever the main thread is doing.
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    _thread.start_new_thread(_listen, (reading,))


def leave(code: int) -> NoReturn:
    """End the process with this exit code at once, unless it is being interrupted, which then ends it."""
    _left.append(code)
    if _ending.acquire(blocking=False):
        os._exit(code)
    while True:
        time.sleep(60)


def _listen(reading: int) -> None:
    """Wait for signals, each of which is one byte, its number."""
    while os.read(reading, 1)[0] != signal.SIGINT:
        pass
    _begin()
    while os.read(reading, 1)[0] != signal.SIGINT:
        pass
    _end()


def _stop(*_: object) -> None:
    """The handler, in the main thread, where it stops; it begins the end itself, should something have taken the pipe away."""
    _stops.append(None)
    if len(_stops) == 1:
        _begin()
        _at_work.release()
    else:
        _end()
    while not _left:
        time.sleep(60)


def _begin() -> None:
    """Begin to end the process. Both threads that hear of a signal call this, for whoever is first."""
    if _ending.acquire(blocking=False):
        _thread.start_new_thread(_tidy, ())


def _tidy() -> None:
    _thread.start_new_thread(_end, (_TIDYING,))
    _at_work.acquire(timeout=_STOPPING)
    for action in reversed(_actions.copy()):
        action()
    # Workers that others have started would wait for work for ever.
    active = getattr(sys.modules.get("multiprocessing"), "active_children", None)  # None too in the middle of its import
    for child in active() if active is not None else ():
        child.kill()
    _end()


def _end(after: float = 0.0) -> None:
    time.sleep(after)
    # Where the lock cannot be had, the line cannot be written: its reader has stopped reading.
    if _writing.acquire(timeout=_WRITING):
        say("brdfcheck: interrupted")
    os._exit(EXIT_CODE)
