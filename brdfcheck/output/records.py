"""Results <-> files: JSON with a schema version, JUnit XML, annotations for GitHub, and writing without leaving halves.

Pure functions; nothing here computes an albedo.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import platform
import re
import stat
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brdfcheck import __version__
from brdfcheck.interruption import Cleanup

if TYPE_CHECKING:
    from brdfcheck.verdict import Report
    from brdfcheck.verdict.side_checks import Witness

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


def to_json_object(report: Report) -> dict[str, Any]:
    """All fields of a report, ready for strict JSON. Angles are in radians unless the key says degrees."""
    side = report.side
    return {
        "name": report.name,
        "verdict": report.verdict.name,
        "passed": report.passed,
        "albedo": number(report.albedo),
        "error": number(report.error),
        "least": number(report.least),
        "parameters": {name: number(value) for name, value in report.parameters.items()},
        "cos_theta": number(report.cos_theta),
        "angle_degrees": number(report.angle),
        "azimuth": number(report.azimuth),
        "tolerance": number(report.tolerance),
        "ranges": {name: [number(low), number(high)] for name, (low, high) in report.ranges.items()},
        "above": None if report.above is None else [[number(low), number(high)] for low, high in report.above],
        "side": None
        if side is None
        else {
            "reciprocity": number(side.reciprocity),
            "minimum": number(side.minimum),
            "nonfinite": int(side.nonfinite),
            "pairs": int(side.pairs),
            "reciprocal": bool(side.reciprocal),
            "positive": bool(side.positive),
            "passed": bool(side.passed),
            **{
                name: None if witness is None else _witness_object(witness)
                for name, witness in (("unequal", side.unequal), ("lowest", side.lowest), ("broken", side.broken))
            },
        },
        "checks": [
            {"name": check.name, "value": number(check.value), "passed": check.passed, "words": check.words}
            for check in report.checks
        ],
        "engine": report.engine,
        "anisotropic": report.anisotropic,
        "evaluations": int(report.evaluations),
        "seconds": number(report.seconds),
        "findings": list(report.findings),
        "notes": list(report.notes),
        "basis": report.basis,
        "points": int(report.points),
        "climbs": int(report.climbs),
        "settled": bool(report.settled),
        "width": {name: number(value) for name, value in report.width.items()},
        "unbounded": report.unbounded,
        "channel": report.channel,
        "channels": int(report.channels),
        "effort": report.effort,
    }


def _witness_object(witness: Witness) -> dict[str, Any]:
    return {
        "parameters": [number(value) for value in witness.parameters],
        "wi": [number(value) for value in witness.wi],
        "wo": [number(value) for value in witness.wo],
        "value": number(witness.value),
        "swapped": None if witness.swapped is None else number(witness.swapped),
    }


def _witness(record: Mapping[str, Any] | None) -> Witness | None:
    from brdfcheck.verdict.side_checks import Witness

    if record is None:
        return None
    parameters, wi, wo = (tuple(float(value) for value in record[name]) for name in ("parameters", "wi", "wo"))
    swapped = record["swapped"]
    return Witness(parameters, wi, wo, float(record["value"]), None if swapped is None else float(swapped))


def from_json_object(record: Mapping[str, Any]) -> Report:
    """The report that `to_json_object` wrote. KeyError where a field is missing."""
    from brdfcheck.verdict import Report, Verdict
    from brdfcheck.verdict.checks import Check
    from brdfcheck.verdict.side_checks import SideChecks

    side = record["side"]
    return Report(
        name=record["name"],
        verdict=Verdict[record["verdict"]],
        albedo=float(record["albedo"]),
        error=float(record["error"]),
        least=float(record.get("least", "nan")),
        parameters={name: float(value) for name, value in record["parameters"].items()},
        cos_theta=float(record["cos_theta"]),
        azimuth=float(record["azimuth"]),
        tolerance=float(record["tolerance"]),
        ranges={name: (float(low), float(high)) for name, (low, high) in record["ranges"].items()},
        above=None if record["above"] is None else tuple((float(low), float(high)) for low, high in record["above"]),
        side=None
        if side is None
        else SideChecks(
            float(side["reciprocity"]),
            float(side["minimum"]),
            side["nonfinite"],
            side["pairs"],
            side["reciprocal"],
            side["positive"],
            *(_witness(side[name]) for name in ("unequal", "lowest", "broken")),
        ),
        checks=tuple(
            Check(check["name"], float(check["value"]), check["passed"], check["words"]) for check in record.get("checks", ())
        ),
        engine=record["engine"],
        anisotropic=record["anisotropic"],
        evaluations=record["evaluations"],
        seconds=float(record["seconds"]),
        findings=tuple(record["findings"]),
        notes=tuple(record["notes"]),
        basis=record["basis"],
        points=record["points"],
        climbs=record["climbs"],
        settled=record["settled"],
        width={name: float(value) for name, value in record["width"].items()},
        unbounded=record["unbounded"],
        channel=record["channel"],
        channels=record["channels"],
        effort=record["effort"],
    )


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
    """Strict JSON text, with a newline at its end."""
    return json.dumps(record, indent=2, allow_nan=False) + "\n"


def count(reports: Iterable[Report]) -> dict[str, int]:
    """How many conserve, violate, are undecided; and how many have findings besides."""
    reports = list(reports)
    verdicts = [report.verdict.name for report in reports]
    return {
        "conserve": verdicts.count("CONSERVES"),
        "violate": verdicts.count("VIOLATES"),
        "undecided": verdicts.count("UNDECIDED"),
        "with_findings": sum(bool(report.findings) for report in reports),
        "failed": sum(not report.passed for report in reports),
    }


# --- JUnit XML ---


def xml_text(text: str) -> str:
    """`text` without the characters that XML cannot hold."""
    return _NOT_XML.sub("?", text)


def to_junit(reports: Sequence[Report], messages: Sequence[str], *, seconds: float, classnames: Sequence[str]) -> str:
    """JUnit XML: one test case for each report, in which `messages` says in one line what was found.

    A BRDF that could not be evaluated is an error, any other one that did not pass a failure.
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
    for report, message, classname in zip(reports, messages, classnames, strict=True):
        case = ElementTree.SubElement(
            suite,
            "testcase",
            {
                "classname": xml_text(classname),
                "name": xml_text(report.name),
                "time": f"{report.seconds:.3f}",
            },
        )
        if not report.passed:
            tag = "error" if math.isnan(report.albedo) else "failure"
            kind = "finding" if report.verdict.name == "CONSERVES" else report.verdict.name
            bad = ElementTree.SubElement(case, tag, {"type": kind, "message": xml_text(message)})
            bad.text = xml_text("\n".join((message, *report.findings, *report.notes)))
        ElementTree.SubElement(case, "system-out").text = xml_text(message)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


# --- GitHub ---


def github_error(title: str, message: str, *, file: str | None = None, line: int | None = None) -> str:
    """The line that makes GitHub annotate a run; with `file` and `line`, at that place of the sources."""
    properties: dict[str, str] = {}
    if file is not None:
        properties["file"] = file
        if line is not None:
            properties["line"] = str(line)
    properties["title"] = title
    shown = ",".join(f"{name}={_github_property(value)}" for name, value in properties.items())
    return f"::error {shown}::{_github_data(message)}"


def _github_data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _github_property(text: str) -> str:
    return _github_data(text).replace(":", "%3A").replace(",", "%2C")


# --- files ---


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
    data = content.encode("utf-8") if isinstance(content, str) else content
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
