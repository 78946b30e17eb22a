"""``python -m brdfcheck`` and the console script: the command ``brdfcheck``.

Nothing is imported before Ctrl-C is watched for but what that takes: the imports of a command last a second.
"""

from __future__ import annotations

import gc
import os

try:
    from brdfcheck import interruption
except BaseException as error:
    # Before Python 3.12 what is raised while the members of an enumeration are named becomes the cause of another error.
    if KeyboardInterrupt not in (type(error), type(error.__cause__)):
        raise
    os.write(2, b"brdfcheck: interrupted\n")
    os._exit(2)

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import NoReturn


def script() -> NoReturn:
    """The console script: the command with the arguments of the process, which ends with it."""
    _open_standard_files()
    interruption.watch()
    # Importing and tracing make many objects, hardly any of them garbage: looked for less often, a command is a tenth quicker.
    gc.set_threshold(10_000)
    from brdfcheck.cli.process import script

    script()


def _open_standard_files() -> None:
    """Standard input, output and error are open, if on nothing: the next file to be opened would else take their place."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number.
            os.set_inheritable(os.open(os.devnull, os.O_RDONLY if number == 0 else os.O_WRONLY), True)


if __name__ == "__main__":
    script()
