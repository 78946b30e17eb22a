"""Mitsuba itself: which of its variants this machine can run, chosen once, and the lock under which it is called."""

from __future__ import annotations

import functools
import glob
import importlib
import mmap
import os
import re
import threading
from typing import Any

from brdfcheck.messages import UsageError, one_line

# The oldest LLVM that the llvm variants run on (15 ends the whole process), and where Debian and others put its library.
_OLDEST_LLVM = 16
_LLVM = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
)
# A function that LLVM's C interface has had since version 16: a file that holds its name is new enough.
_SINCE_16 = b"LLVMGetVersion"

LOCK = threading.RLock()
"""Held while Mitsuba computes: several BRDFs may be checked at a time, and its just-in-time compiler has one state."""


def llvm_library() -> str | None:
    """The path of an LLVM shared library of version 16 or newer: `$DRJIT_LIBLLVM_PATH`, else the newest one found.

    None where there is none, or the one named is older. Nothing is loaded to find out.
    """
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    if named:
        return named if _is_new_enough(named) else None
    found = []
    for path in (path for pattern in _LLVM for path in glob.glob(pattern)):
        version = re.search(r"libLLVM(?:-|\.so\.)(\d+)", os.path.basename(path))
        if version and int(version[1]) >= _OLDEST_LLVM:
            found.append((int(version[1]), path))
    return max(found)[1] if found else None


def _is_new_enough(path: str) -> bool:
    try:
        with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            return content.find(_SINCE_16) >= 0
    except (OSError, ValueError):  # not there, or empty
        return False


@functools.cache
def variant() -> tuple[str, str]:
    """The variant of Mitsuba that is used, and why. Sets it, once.

    It is the one that a program has set already, where that computes in RGB on the CPU; else llvm, else scalar.
    """
    mitsuba = importlib.import_module("mitsuba")
    if mitsuba.variant() in ("scalar_rgb", "llvm_ad_rgb"):
        return mitsuba.variant(), "set before"
    library = llvm_library()
    if library is not None and "llvm_ad_rgb" in mitsuba.variants():
        os.environ["DRJIT_LIBLLVM_PATH"] = library
        mitsuba.set_variant("llvm_ad_rgb")
        return "llvm_ad_rgb", library
    mitsuba.set_variant("scalar_rgb")
    return "scalar_rgb", "no LLVM shared library of version 16 or newer: apt-get install libllvm19, or set DRJIT_LIBLLVM_PATH"


def mitsuba_module() -> Any:
    """Mitsuba with its variant set. UsageError where it cannot be loaded."""
    try:
        name, _ = variant()
        mitsuba = importlib.import_module("mitsuba")
        if mitsuba.variant() != name:  # variants are set for a thread
            mitsuba.set_variant(name)
    except (ImportError, RuntimeError) as error:
        raise UsageError(f"Mitsuba cannot be used: {one_line(error)}") from None
    return mitsuba
