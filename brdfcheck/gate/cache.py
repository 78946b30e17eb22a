"""Verdicts that are known already, kept in the user's cache folder: what has not changed is not checked again.

A verdict is kept under a digest of all that it depends on: the sources of the BRDF (`brdfcheck.gate.sources`), what was asked
of it, this package, and the versions of what computes. Where any of that cannot be told, nothing is kept and nothing is found.
Nothing here raises: an entry that is damaged, or a folder that cannot be written, only costs time.
"""

from __future__ import annotations

import functools
import hashlib
import json
import logging
import os
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brdfcheck import __version__
from brdfcheck.folders import cache_folder
from brdfcheck.gate.requests import Case, Request
from brdfcheck.gate.sources import Doubt, Tampering, digest, sources

if TYPE_CHECKING:
    from brdfcheck.verdict import Report

_log = logging.getLogger("brdfcheck")

SWITCH = "BRDFCHECK_VERDICTS"
"""The environment variable that switches the cache off where it is 0."""
FORMAT = 1
# Packages whose version a verdict may depend on besides those of any result, and variables that begin so.
_PACKAGES = ("jaxtyping", "pcpp", "MaterialX")
_VARIABLES = ("JAX_", "XLA_", "CUDA_VISIBLE_DEVICES", "JAXTYPING_", "EQX_")
# What tests may change in JAX, as it is for everybody else.
_USUAL = {
    "jax_numpy_dtype_promotion": "standard",
    "jax_numpy_rank_promotion": "allow",
    "jax_default_matmul_precision": None,
    "jax_default_device": None,
    "jax_disable_jit": False,
    "jax_debug_nans": False,
    "jax_debug_infs": False,
}
# Entries that nobody has asked for as long, in seconds, are removed.
_KEPT = 90 * 24 * 3600


def folder() -> Path:
    """Where verdicts are kept: the folder "verdicts" beside the compiled programs."""
    return cache_folder() / "verdicts"


class Verdicts:
    """The cache of one command. `wanted` False, or ``BRDFCHECK_VERDICTS=0``: nothing is found and nothing is kept."""

    def __init__(self, wanted: bool = True):
        self.wanted = wanted and os.environ.get(SWITCH, "1") != "0"
        # What others had imported before, and how this command found each file first.
        self._before = frozenset(sys.modules)
        self._seen: dict[Path, str] = {}
        self._keys: dict[int, str] = {}

    def found(self, request: Request) -> list[Case] | None:
        """The cases of a request with their reports; None where they are not known."""
        if not self.wanted:
            return None
        try:
            key, _ = self._key(request)
            self._keys[id(request)] = key
            path = _path(key)
            entries = json.loads(path.read_bytes())
            cases = [
                Case(request, entry["name"], entry["file"], entry["line"], entry["entry"], report=_report(entry))
                for entry in entries
            ]
            if not cases:
                raise ValueError("the entry is empty")
            os.utime(path)
        except Doubt as doubt:
            self.wanted = self.wanted and not isinstance(doubt, Tampering)
            _log.debug("%s: no verdict is kept: %s", " ".join(request.names), doubt)
            return None
        except FileNotFoundError:
            return None
        except Exception:  # a damaged entry is as good as none
            _log.debug("%s: the verdict cannot be read", " ".join(request.names), exc_info=True)
            return None
        return cases

    def keep(self, request: Request, cases: Sequence[Case], reports: Sequence[Report]) -> None:
        """Keep the reports on all cases of a request, if they are sure to come out the same again."""
        before = self._keys.pop(id(request), None)
        if not self.wanted or before is None or any(report.basis == "none" for report in reports):
            return
        try:
            key, files = self._key(request)
            if key != before:
                raise Doubt("a file has changed meanwhile")
            self._refuse_others(request, files)
            entries = [_entry(case, report) for case, report in zip(cases, reports, strict=True)]
            for entry in entries:  # what would not come out of the cache as it went in does not go in
                _report(entry)
            _write(_path(key), json.dumps(entries))
        except Doubt as doubt:
            _log.debug("%s: no verdict is kept: %s", " ".join(request.names), doubt)
        except Exception:
            _log.debug("%s: the verdict cannot be kept", " ".join(request.names), exc_info=True)

    def _key(self, request: Request) -> tuple[str, dict[str, Path]]:
        """The digest of all that the verdict depends on, and the sources. Doubt where it cannot be told."""
        files = sources(request.names, request.reading.folders)
        contents = digest(files)
        for name, found in contents:
            if self._seen.setdefault(files[name].resolve(), found) != found:
                raise Doubt(f"{name} has changed since this process looked at it first")
        jax: Any = sys.modules.get("jax")
        if jax is not None:
            changed = [flag for flag, usual in _USUAL.items() if getattr(jax.config, flag, usual) != usual]
            if changed:
                raise Doubt(f"{changed[0]} is not what it usually is")
        # Versions, and what the environment tells them.
        around = _versions() | {name: value for name, value in os.environ.items() if name.startswith(_VARIABLES)}
        asked = json.dumps([FORMAT, request.asked, contents, _package(), around], sort_keys=True)
        return hashlib.sha256(asked.encode()).hexdigest(), files

    def _refuse_others(self, request: Request, files: dict[str, Path]) -> None:
        """Doubt where a module that a user's file imports is another one, or a name of the catalogue is not ours."""
        from brdfcheck.brdf import catalog

        for name in request.names:
            if name in catalog.names() and not catalog.built_in(name):
                raise Doubt(f"{name} was registered by somebody")
        for name, path in files.items():
            module = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".") if name.endswith(".py") else ""
            if module in self._before:
                raise Doubt(f"{module} had been imported before")
            file = getattr(sys.modules.get(module), "__file__", None)
            if file is not None and Path(file).resolve() != path.resolve():
                raise Doubt(f"{module} is another module than {path}")


def _path(key: str) -> Path:
    return folder() / key[:2] / f"{key}.json"


def _write(path: Path, text: str) -> None:
    """Write an entry; where its folder is new, entries that nobody wants any more are removed."""
    from brdfcheck.output.records import write_atomically

    if not path.parent.is_dir():
        path.parent.mkdir(parents=True, exist_ok=True)
        for old in folder().glob("??/*.json"):
            if time.time() - old.stat().st_mtime > _KEPT:
                old.unlink(missing_ok=True)
    write_atomically(path, text)


def _entry(case: Case, report: Report) -> dict[str, Any]:
    from brdfcheck.output.records import plain

    return {"name": case.name, "file": case.file, "line": case.line, "entry": case.entry, "report": plain(report)}


def _report(entry: dict[str, Any]) -> Report:
    """The report of an entry. Doubt where it does not say the same as the entry."""
    from brdfcheck.output.records import plain
    from brdfcheck.verdict.report import Verdict

    said = entry["report"]
    report = _adapter().validate_python({**said, "verdict": Verdict[said["verdict"]]})
    if plain(report) != said:
        raise Doubt("the report does not come out of the cache as it went in")
    return report


@functools.cache
def _adapter() -> Any:
    """What makes a `Report` of plain values again."""
    import pydantic

    from brdfcheck.verdict.report import Report

    return pydantic.TypeAdapter(Report)


@functools.cache
def _package() -> str:
    """A digest of this package's own files: an installation that is edited has no version that tells."""
    total = hashlib.sha256(__version__.encode())
    root = Path(__file__).parent.parent
    for path in sorted(root.rglob("*.py")):
        total.update(path.relative_to(root).as_posix().encode())
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


@functools.cache
def _versions() -> dict[str, str]:
    from brdfcheck.output.records import versions

    return {**versions(*_PACKAGES), "python": sys.version, "machine": platform.platform()}
