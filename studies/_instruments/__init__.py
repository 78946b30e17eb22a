"""What the studies measure and draw with."""

from __future__ import annotations

import signal
import sys


class Unheard:
    """A context manager: processes that are started within it, from this thread, never hear of Ctrl-C.

    For workers, which would each print a traceback; whoever started them ends them.
    """

    def __enter__(self) -> None:
        if sys.platform != "win32":
            self._before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})

    def __exit__(self, *_: object) -> None:
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, self._before)
