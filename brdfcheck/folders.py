"""Where things are kept between processes. Imports nothing heavy."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from brdfcheck.messages import UsageError, one_line


def cache_folder() -> Path:
    """Where compiled programs and verdicts are kept: ``$BRDFCHECK_CACHE``, else ``brdfcheck`` in the user's cache folder."""
    named = os.environ.get("BRDFCHECK_CACHE")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "brdfcheck"


def repository() -> Path:
    """The folder from which code hosts name files: the nearest one with a .git, else the current one."""
    here = Path.cwd()
    return next((folder for folder in (here, *here.parents) if (folder / ".git").exists()), here)


@contextlib.contextmanager
def readable(path: str | Path, kind: str, *, pipes: bool = False) -> Iterator[None]:
    """Within it a user's file is read. UsageError where there is none, or no ordinary one, or the system refuses it.

    `kind`: what to give in place of a folder. `pipes`: it need not be an ordinary file.
    """
    label = one_line(path)
    try:
        if os.path.isdir(path):
            raise UsageError(f"{label} is a folder; give {kind}")
        if not os.path.exists(path):
            raise UsageError(f"there is no file {label!r}")
        if not (pipes or os.path.isfile(path)):
            raise UsageError(f"{label} is no ordinary file")
        yield
    except UsageError:
        raise
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read {label!r}: {getattr(error, 'strerror', None) or one_line(error)}") from None
