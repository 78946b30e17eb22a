"""Precision and compilation cache. Called by entry points (CLI, studies), never on import."""

from __future__ import annotations

import contextlib
import functools
import importlib
import os
import warnings
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from brdfcheck.folders import cache_folder


def use_x64() -> None:
    """Switch JAX to float64 for the whole process."""
    jax.config.update("jax_enable_x64", True)


def double_precision(wanted: bool = True) -> contextlib.AbstractContextManager[object]:
    """float64 within a ``with`` block, whatever the process runs in: for users' functions, whose error bars depend on it.

    `wanted` False: what `is_double` said elsewhere, for threads, to which a ``with`` block of another one does not extend.
    """
    if hasattr(jax, "enable_x64"):
        return jax.enable_x64(wanted)
    return importlib.import_module("jax.experimental").enable_x64(wanted)  # JAX before 0.8


STRAIGHT_LINE = {"xla_cpu_use_fusion_emitters": False}
"""Compiler options for long programs without loops whose values alone are wanted: on a CPU five times as fast.

Derivatives of such programs are not to be trusted under it (jax 0.10: a wrong sign was seen).
"""


@functools.lru_cache(maxsize=8)
def _understood(options: tuple[tuple[str, Any], ...]) -> bool:
    try:
        jax.jit(lambda x: x + 1, compiler_options=dict(options))(np.float32(0))
    except Exception:  # an XLA that lacks it
        return False
    return True


def understood(options: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Compiler options where this XLA knows them all, else None."""
    return dict(options) if options and _understood(tuple(sorted(options.items()))) else None


def is_double() -> bool:
    """True where new arrays of this thread are float64."""
    return bool(jax.config.read("jax_enable_x64"))


def use_compilation_cache() -> None:
    """Keep compiled programs between processes. Without a writable folder, programs are compiled each time."""
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if not os.access(folder, os.W_OK):
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # Another process or thread may be writing the entry that is read: then the program is compiled, no need for words.
    warnings.filterwarnings("ignore", message=".*persistent compilation cache.*")
    # JAX skips programs that compile in under a second unless told otherwise; all of ours do.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
