"""What results depend on besides their configuration: versions, the source of this package, the kind of device."""

from __future__ import annotations

import functools
import hashlib
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from brdfcheck.output import records

_PACKAGE = Path(__file__).resolve().parent.parent
# What a sweep computes with: modules and folders. Others may change between a run and its continuation.
_COMPUTING = (
    "geometry", "numerics", "runtime", "cores", "messages", "documents", "interruption", "brdf", "quadrature", "sweep",
)  # fmt: skip


def versions() -> dict[str, str]:
    """The versions that the bytes of a store may depend on."""
    found = records.versions()
    for package in ("zarr", "numcodecs"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


@functools.cache
def source_digest() -> str:
    """SHA-256 of the modules that a sweep computes with, in hexadecimal."""
    files = [file for name in _COMPUTING for file in sorted((_PACKAGE / name).rglob("*.py")) or [_PACKAGE / f"{name}.py"]]
    state = hashlib.sha256()
    for file in files:
        state.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return state.hexdigest()


def source_commit() -> str:
    """The commit of this package's checkout, "-dirty" where the package was changed since; "unknown" where it has none."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(_PACKAGE), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()

    try:
        # A virtual environment inside somebody's checkout is no checkout of ours.
        git("ls-files", "--error-unmatch", "__init__.py")
        return git("rev-parse", "HEAD") + ("-dirty" if git("status", "--porcelain", "--", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def device() -> dict[str, str]:
    """The kind of device; two kinds may differ in the last digit. How many there are changes nothing."""
    import jax

    first = jax.local_devices()[0]
    return {"platform": first.platform, "kind": first.device_kind, "machine": platform.machine()}


def facts() -> dict[str, Any]:
    """All of it but the commit: what must be the same in every process that adds to a store."""
    return {"versions": versions(), "source": source_digest(), "device": device()}
