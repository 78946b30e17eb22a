"""Results -> files: JSON with a schema version, JUnit XML, annotations for GitHub, and writing without leaving halves.

Pure functions; nothing here computes an albedo.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import platform
import re
import shutil
import stat
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brdfcheck import __version__
from brdfcheck.folders import repository
from brdfcheck.interruption import Cleanup
from brdfcheck.verdict.words import verdict_text

if TYPE_CHECKING:
    from brdfcheck.fits.factor import FactorFit
    from brdfcheck.verdict import Report

SCHEMA = "brdfcheck-results"
SCHEMA_VERSION = 1

_count = itertools.count(1)
# What XML 1.0 does not allow, even escaped.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


# --- JSON ---


def number(value: float) -> float | int | str:
    """`value` for strict JSON: NaN and infinities, which JSON does not have, become the strings float() understands."""
    if isinstance(value, int):
        return value
    value = float(value)
    if math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


def plain(value: Any) -> Any:
    """Any value as what strict JSON has: objects, lists, texts, numbers, true, false, null.

    Of a dataclass all fields, of an enum its name, of an array nested lists. TypeError for what is none of these.
    """
    if isinstance(value, Enum):
        return value.name
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return number(value)
    tolist = getattr(value, "tolist", None)
    if callable(tolist):  # an array or a number of numpy or JAX
        return plain(tolist())
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def to_json_object(report: Report) -> dict[str, Any]:
    """All fields of a report, ready for strict JSON. Angles are in radians unless the key says degrees."""
    record = plain(report) | {"passed": report.passed, "angle_degrees": number(report.angle)}
    if report.side is not None:
        record["side"]["passed"] = report.side.passed
    return record


def factor_object(factor: Any) -> dict[str, Any]:
    """The form and the constants of a factor, ready for strict JSON."""
    return {"form": type(factor).__name__, **plain(factor)}


def fit_object(fit: FactorFit) -> dict[str, Any]:
    """All fields of a fit but its family, with its report; ready for strict JSON."""
    own: dict[str, Any] = {
        "factor": factor_object(fit.factor),
        "fitted": factor_object(fit.fitted),
        "report": to_json_object(fit.report),
        "proved": None if fit.proved is None else factor_object(fit.proved),
    }
    own["history"] = [plain({**vars(step), "factor": factor_object(step.factor)}) for step in fit.history]
    return {name: own[name] if name in own else plain(value) for name, value in vars(fit).items() if name != "family"}


def versions(*packages: str) -> dict[str, str]:
    """The versions that a result may depend on; `packages`: of other packages that took part in it."""
    found = {"brdfcheck": __version__, "python": platform.python_version()}
    for package in dict.fromkeys(("jax", "jaxlib", "numpy", "scipy", "equinox", "optimistix", "lineax", *packages)):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def device() -> dict[str, Any]:
    """The device that JAX computes on."""
    import jax

    first = jax.devices()[0]
    return {
        "platform": first.platform,
        "kind": first.device_kind,
        "system": platform.system(),
        "machine": platform.machine(),
    }


def document(
    command: str,
    results: Sequence[Mapping[str, Any]],
    *,
    settings: Mapping[str, Any],
    summary: Mapping[str, Any],
    packages: Iterable[str] = (),
) -> dict[str, Any]:
    """The whole record of a command: schema, settings, versions, device, results, summary. `packages` as for `versions`."""
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "command": command,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "settings": dict(settings),
        "versions": versions(*packages),
        "device": device(),
        "summary": dict(summary),
        "results": list(results),
    }


def to_json(record: Mapping[str, Any]) -> str:
    """Strict JSON text of anything `plain` takes, with a newline at its end."""
    return json.dumps(plain(record), indent=2, allow_nan=False) + "\n"


def count(reports: Iterable[Report]) -> dict[str, int]:
    """How many conserve, violate, are undecided, could not be read; how many have findings; how many are known already."""
    reports = list(reports)
    verdicts = [report.verdict.name for report in reports if not report.unread]
    return {
        "conserve": verdicts.count("CONSERVES"),
        "violate": verdicts.count("VIOLATES"),
        "undecided": verdicts.count("UNDECIDED"),
        "unread": sum(report.unread for report in reports),
        "with_findings": sum(bool(report.findings) and not report.unread for report in reports),
        "known": sum(report.known is not None for report in reports),
        "stale": sum(report.stale for report in reports),
        "failed": sum(not report.passed for report in reports),
    }


# --- JUnit XML ---


def xml_text(text: str) -> str:
    """`text` without the characters that XML cannot hold."""
    return _NOT_XML.sub("?", text)


def to_junit(
    reports: Sequence[Report],
    messages: Sequence[str],
    *,
    seconds: float,
    classnames: Sequence[str],
    places: Sequence[tuple[str | None, int | None]] | None = None,
) -> str:
    """JUnit XML: one test case for each report, in which `messages` says in one line what was found.

    `places`: file and line where each BRDF is defined, as attributes of its test case (None: not known). A BRDF that could not
    be evaluated is an error, any other one that did not pass a failure.
    """
    errors = sum(math.isnan(report.albedo) for report in reports)
    failures = sum(not report.passed for report in reports) - errors
    totals = {
        "tests": str(len(reports)),
        "failures": str(failures),
        "errors": str(errors),
        "skipped": "0",
        "time": f"{seconds:.3f}",
    }
    root = ElementTree.Element("testsuites", {"name": "brdfcheck", **totals})
    suite = ElementTree.SubElement(
        root,
        "testsuite",
        {"name": "brdfcheck", **totals, "timestamp": datetime.now(UTC).isoformat(timespec="seconds").split("+")[0]},
    )
    properties = ElementTree.SubElement(suite, "properties")
    for name, value in versions().items():
        ElementTree.SubElement(properties, "property", {"name": name, "value": value})
    places = [(None, None)] * len(reports) if places is None else places
    for report, message, classname, (file, line) in zip(reports, messages, classnames, places, strict=True):
        case = ElementTree.SubElement(
            suite,
            "testcase",
            {
                "classname": xml_text(classname),
                "name": xml_text(report.name),
                **({} if file is None else {"file": xml_text(file)}),
                **({} if line is None else {"line": str(line)}),
                "time": f"{report.seconds:.3f}",
            },
        )
        if not report.passed:
            tag = "error" if math.isnan(report.albedo) else "failure"
            kind = "finding" if report.verdict.name == "CONSERVES" else verdict_text(report)
            bad = ElementTree.SubElement(case, tag, {"type": kind, "message": xml_text(message)})
            bad.text = xml_text("\n".join((message, *report.findings, *report.notes)))
        ElementTree.SubElement(case, "system-out").text = xml_text(message)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


# --- badge ---


def badge(counts: Mapping[str, int]) -> dict[str, Any]:
    """A badge in the JSON that shields.io takes from an endpoint (schema version 1); `counts` as `count` gives them."""
    total = counts["conserve"] + counts["violate"] + counts["undecided"] + counts["unread"]
    if counts["violate"]:
        message, color = f"{counts['violate']} of {total} {'violates' if counts['violate'] == 1 else 'violate'}", "red"
    elif counts["unread"]:
        message, color = f"{counts['unread']} of {total} could not be read", "red"
    elif counts["undecided"]:
        message, color = f"{counts['undecided']} of {total} undecided", "yellow"
    elif counts["with_findings"]:
        message, color = f"{counts['with_findings']} of {total} with findings", "orange"
    else:
        message, color = "conserved" if total == 1 else f"{total} conserve", "brightgreen"
    if not counts["failed"] and counts["known"]:
        message, color = f"{message}, known", "green"
    return {"schemaVersion": 1, "label": "energy", "message": message, "color": color}


# --- GitHub ---


def github_error(title: str, message: str, *, file: str | None = None, line: int | None = None, kind: str = "error") -> str:
    """The line that makes GitHub annotate a run; with `file` and `line`, at that place. `kind`: or "warning", "notice".

    GitHub takes files as seen from the root of the repository.
    """
    properties: dict[str, str] = {}
    if file is not None:
        path, root = Path(file).resolve(), repository().resolve()
        properties["file"] = path.relative_to(root).as_posix() if path.is_relative_to(root) else file
        if line is not None:
            properties["line"] = str(line)
    properties["title"] = title
    shown = ",".join(f"{name}={_github_property(value)}" for name, value in properties.items())
    return f"::{kind} {shown}::{_github_data(message)}"


def _github_data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _github_property(text: str) -> str:
    return _github_data(text).replace(":", "%3A").replace(",", "%2C")


# --- files ---


def exr_bytes(channels: Mapping[str, Any], metadata: Mapping[str, str]) -> bytes:
    """An EXR of float32 channels by name, each of shape (height, width); `metadata` becomes strings in the header."""
    import numpy as np
    import OpenEXR

    header: dict[str, Any] = {f"brdfcheck.{key}": text for key, text in metadata.items()}
    header |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = {name: np.ascontiguousarray(channel, dtype=np.float32) for name, channel in channels.items()}
    with tempfile.TemporaryDirectory(prefix="brdfcheck-") as folder, Cleanup(lambda: shutil.rmtree(folder)):
        path = Path(folder, "image.exr")
        with OpenEXR.File(header, pixels) as file:
            file.write(str(path))
        return path.read_bytes()


def refuse_output(path: str) -> str | None:
    """Why nothing can be written to `path`, or None. Leaves no trace, so that it can be asked before the work."""
    if not path.strip():
        return "the file name is empty"
    if path.endswith(("/", os.sep)):
        return "it names a folder"
    target = os.path.realpath(path)
    try:
        mode = os.stat(path).st_mode if os.path.exists(path) else None
        if mode is not None and stat.S_ISDIR(mode):
            return "it is a folder"
        if mode is not None and not os.access(path, os.W_OK):
            return "the file is not writable"
        if mode is not None and not stat.S_ISREG(mode):
            return None  # a device or a pipe
        folder = Path(target).parent
        if not folder.exists():
            return f"the folder {folder} does not exist"
        if not folder.is_dir():
            return f"{folder} is not a folder"
        _try(_temporary(folder))
        if mode is None:  # the name itself may be impossible: too long, say
            _try(target)
    except (OSError, ValueError) as error:
        return str(getattr(error, "strerror", None) or error)
    return None


def _try(path: str | Path) -> None:
    """Create a file that is not there, and remove it."""
    with Cleanup(lambda: os.path.getsize(path) or os.unlink(path)):  # with contents, it would be somebody else's
        with open(path, "x", encoding="utf-8"):
            pass
        os.unlink(path)


def _temporary(folder: Path) -> Path:
    return folder / f".brdfcheck-{os.getpid()}-{next(_count)}.tmp"


def write_atomically(path: str | os.PathLike[str], content: str | bytes) -> None:
    """Write `content` to `path` as a whole or not at all: a reader never sees half a file. OSError where that fails."""
    target = Path(os.path.realpath(path))
    # Names of files may hold bytes of no encoding, which are shown as numbers.
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    if target.exists() and not target.is_file():  # a device or a pipe cannot be replaced
        target.write_bytes(data)
        return
    temporary = _temporary(target.parent)
    with Cleanup(lambda: os.unlink(temporary)):
        try:
            with open(temporary, "xb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            if target.exists():
                os.chmod(temporary, stat.S_IMODE(os.stat(target).st_mode))
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
