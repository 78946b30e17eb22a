"""Reports as SARIF 2.1.0 (OASIS), the format in which code hosts take the results of static analysis.

A result for each thing that is wrong with a BRDF; what passes has none. A rule's id never changes its meaning, and a result's
fingerprint depends on the rule, the BRDF and its ranges alone, so that a finding stays the same one when lines move or an
albedo changes in its last digits; of results that would have the same one, the second and later are counted.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from brdfcheck import __version__
from brdfcheck.folders import repository
from brdfcheck.messages import one_line
from brdfcheck.output import records
from brdfcheck.verdict import words

if TYPE_CHECKING:
    from brdfcheck.verdict import Report

VERSION = "2.1.0"
SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
Place = tuple[str | None, int | None]
"""The file in which a BRDF is defined and the line; None where that is not known."""

_ROOT = "%SRCROOT%"
_FINGERPRINT = "brdfcheck/v1"
# Rule id: (its name, its level, what is wrong, what to do). That of a check is "check/" and the check's name.
_RULES: dict[str, tuple[str, str, str, str]] = {
    "energy/violates": (
        "EnergyGain",
        "error",
        "The BRDF reflects more light than it receives.",
        "The directional albedo exceeds 1 by more than its error bar. Normalise the BRDF (brdfcheck fit), or narrow its"
        " parameters to the range in which it conserves energy.",
    ),
    "energy/undecided": (
        "EnergyUndecided",
        "warning",
        "Whether the BRDF conserves energy could not be decided.",
        "The message says why. Allow more effort (--effort thorough), narrow the ranges, or allow a tolerance.",
    ),
    "brdf/not-evaluated": (
        "NotEvaluated",
        "error",
        "The BRDF could not be read or evaluated.",
        "The message says what is wrong and where.",
    ),
    "brdf/finding": ("Finding", "warning", "The BRDF has a defect.", "The message says which."),
    "check/reciprocal": (
        "NotReciprocal",
        "error",
        "The BRDF is not reciprocal.",
        "f(wi, wo) must equal f(wo, wi). The message names a pair of directions at which it does not.",
    ),
    "check/positive": (
        "Negative",
        "error",
        "The BRDF is negative.",
        "The message names a pair of directions at which it is; clamp it, or mend the term that goes below zero.",
    ),
    "check/finite": (
        "NotFinite",
        "error",
        "The BRDF is NaN or infinite.",
        "The message names a pair of directions at which it is.",
    ),
    "check/pdf": (
        "PdfNotNormalised",
        "error",
        "The density of the samples is no probability density.",
        "It must integrate to at most 1, and to 0 below an opaque surface.",
    ),
    "check/weight": (
        "WeightMismatch",
        "error",
        "The weights of the samples disagree with the BRDF.",
        "The weight of a sample must be f |cos| over its density.",
    ),
}


def defects(report: Report) -> Iterator[tuple[str, str]]:
    """What is wrong, as (rule id, message) in one line each; nothing for a report that passed."""
    failed = {found.words: f"check/{found.name}" for found in report.checks if not found.passed}
    if report.verdict.name == "VIOLATES":
        yield "energy/violates", _energy(report)
    elif report.verdict.name == "UNDECIDED" and report.basis != "none":
        yield "energy/undecided", f"{words.reason_text(report)}: {_energy(report)}"
    for finding in report.findings:
        usual = "brdf/not-evaluated" if report.basis == "none" else "brdf/finding"
        yield failed.get(finding, usual), one_line(finding)


def _energy(report: Report) -> str:
    """The verdict in a sentence, without the findings, which are results of their own."""
    text = f"albedo {words.albedo_text(report)}"
    if words.place_text(report):
        text += f" at {words.place_text(report)}"
    if words.interval_text(report):
        text += f"; exceeds 1 for {words.interval_text(report)}"
    return f"{text} (tolerance {words.exact(report.tolerance)}; {one_line(words.basis_text(report))})"


def to_sarif(reports: Sequence[Report], places: Sequence[Place], *, exit_code: int = 0, folder: str | None = None) -> str:
    """The SARIF log of these reports, each with the `places` where its BRDF is defined.

    Files within `folder` (by default the repository) are named relative to it, as code hosts need it.
    """
    root = os.path.realpath(folder or repository())
    results = [
        _result(rule, message, report, place, root)
        for report, place in zip(reports, places, strict=True)
        for rule, message in defects(report)
    ]
    seen: dict[str, int] = {}
    for result in results:
        key = result["partialFingerprints"][_FINGERPRINT]
        seen[key] = seen.get(key, 0) + 1
        # The second name is the only one that GitHub looks at: without it all results of a line are one to it.
        result["partialFingerprints"] = dict.fromkeys((_FINGERPRINT, "primaryLocationLineHash"), f"{key}:{seen[key]}")
    ids = list(_RULES)
    ids += [rule for rule in dict.fromkeys(result["ruleId"] for result in results) if rule not in _RULES]
    for result in results:
        result["ruleIndex"] = ids.index(result["ruleId"])
    driver = {
        "name": "brdfcheck",
        "version": __version__,
        "semanticVersion": __version__,
        "shortDescription": {"text": "Does this BRDF conserve energy?"},
        "rules": [_rule(name) for name in ids],
    }
    run = {
        "tool": {"driver": driver},
        "automationDetails": {"id": "brdfcheck/check/"},
        "columnKind": "unicodeCodePoints",
        "originalUriBaseIds": {_ROOT: {"description": {"text": "the root of the repository"}}},
        "invocations": [{"executionSuccessful": True, "exitCode": int(exit_code)}],
        "results": results,
    }
    return records.to_json({"$schema": SCHEMA, "version": VERSION, "runs": [run]})


def _rule(name: str) -> dict[str, Any]:
    what = name.rpartition("/")[2]
    title, level, text, help_text = _RULES.get(
        name, (what.title(), "error", f"The BRDF does not pass the check {what!r}.", "The message says why.")
    )
    return {
        "id": name,
        "name": title,
        "shortDescription": {"text": text},
        "fullDescription": {"text": text},
        "help": {"text": help_text},
        "defaultConfiguration": {"level": level},
    }


def _result(rule: str, message: str, report: Report, place: Place, root: str) -> dict[str, Any]:
    subject, logical = _subject(report.name, root), {"fullyQualifiedName": records.xml_text(report.name), "kind": "function"}
    location: dict[str, Any] = {"logicalLocations": [logical]}
    physical = _physical(place, root)
    if physical:
        location["physicalLocation"] = physical
    key = "\0".join((rule, subject, words.ranges_text(report.ranges)))
    level, known = _RULES[rule][1] if rule in _RULES else "error", {}
    if report.known is not None:
        # What a project knows and accepts is told, but as suppressed; for GitHub, which reads no suppressions, as a mere note.
        level, known = "note", {"suppressions": [{"kind": "external", "justification": report.known}]}
        message += f" (accepted: {one_line(report.known)})"
    return {
        "ruleId": rule,
        "level": level,
        "message": {"text": f"{report.name}: {message}"},
        "locations": [location],
        "partialFingerprints": {_FINGERPRINT: hashlib.sha256(key.encode("utf-8", "replace")).hexdigest()},
        "properties": _numbers(report),
        **known,
    }


def _subject(name: str, root: str) -> str:
    """The name of a BRDF, that of its file relative to the root: the same on every machine."""
    path, colon, rest = name.partition(":")
    if not os.path.isabs(path):
        return name.replace(os.sep, "/")
    return f"{os.path.relpath(os.path.realpath(path), root)}{colon}{rest}".replace(os.sep, "/")


def _physical(place: Place, root: str) -> dict[str, Any] | None:
    file, line = place
    if file is None or not os.path.isfile(file):  # a plug-in of another program is no file
        return None
    path = Path(os.path.realpath(file))
    if path.is_relative_to(root):
        artifact = {"uri": quote(os.fsencode(path.relative_to(root).as_posix())), "uriBaseId": _ROOT}
    else:
        artifact = {"uri": path.as_uri()}
    return {"artifactLocation": artifact, "region": {"startLine": line or 1}}


def _numbers(report: Report) -> Mapping[str, Any]:
    """The numbers behind a result, for those who read more than its message."""
    albedo = {} if math.isnan(report.albedo) else {"albedo": records.number(report.albedo)}
    return {
        "verdict": report.verdict.name,
        **albedo,
        **records.plain(
            {
                "error": report.error,
                "parameters": report.parameters,
                "cosTheta": report.cos_theta,
                "tolerance": report.tolerance,
                "basis": report.basis,
            }
        ),
    }
