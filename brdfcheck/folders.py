"""Where things are kept between processes. Imports nothing heavy."""

from __future__ import annotations

import os
from pathlib import Path


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
