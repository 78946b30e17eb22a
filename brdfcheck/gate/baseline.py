"""Known violations: which reports they cover, what is left of them, and how the file that lists them is brought up to date."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date
from typing import TYPE_CHECKING, Any

from brdfcheck.documents import read_text
from brdfcheck.gate.config import OTHER, Gate, Known
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.verdict import Report

# By how much of what is known to exceed 1 a violation must have shrunk for the entry to be out of date.
_LESS = 0.99


def defects(report: Report) -> list[str]:
    """The names of the findings of a report: of the checks that did not pass, and `OTHER` where there are more."""
    found = [check.name for check in report.checks if not check.passed]
    return found + [OTHER] * (len(report.findings) > len(found))


def judged(reports: Sequence[Report], known: Known | None, *, part: bool = False) -> list[Report]:
    """The reports on one subject, which pass where what they found is known; notes say what is new or no longer so.

    What is known need be found in one of them only: a subject may be many values, or all that a file offers. The one with the
    largest albedo notes what is in none, unless the reports are on `part` of the subject.
    """
    if known is None:
        return list(reports)
    gone = _gone(reports, known) if not part and all(report.basis != "none" for report in reports) else []
    largest = max(range(len(reports)), key=lambda index: (not reports[index].passed, reports[index].albedo), default=0)
    found = []
    for index, report in enumerate(reports):
        if worse := _worse(report, known):
            text = f"the known violation does not cover {', '.join(worse)}"
            found.append(replace(report, notes=(*report.notes, text)))
            continue
        stale = bool(gone) and index == largest
        notes = (f"the known violation is {'gone' if report.passed else 'smaller'}: {', '.join(gone)}",) if stale else ()
        reason = None if report.passed else known.reason
        found.append(replace(report, known=reason, stale=stale, notes=(*report.notes, *notes)))
    return found


def _worse(report: Report, known: Known) -> list[str]:
    """What of a report is not known, in words."""
    worse: list[str] = []
    verdict, slack = report.verdict.name, report.tolerance
    if report.basis == "none":
        return ["a BRDF that cannot be evaluated"]
    surely = math.inf if report.unbounded else report.albedo - report.error
    if verdict == "VIOLATES" and (known.violates is None or surely > known.violates + slack):
        limit = "none" if known.violates is None else f"{known.violates:.10g}"
        worse.append(f"an albedo of {report.albedo:.10g} (known: {limit})")
    if verdict == "UNDECIDED" and known.violates is None and not known.undecided:
        worse.append("a verdict that is undecided")
    return worse + [f"the finding {name!r}" for name in defects(report) if name not in known.findings]


def _gone(reports: Sequence[Report], known: Known) -> list[str]:
    """What is known and in none of the reports, in words."""
    gone: list[str] = []
    verdicts = {report.verdict.name for report in reports}
    if known.violates is not None and verdicts == {"CONSERVES"}:
        gone.append(f"it conserves energy (known: {known.violates:.10g})")
    elif known.violates is not None and all(
        report.albedo + report.error - 1 < _LESS * (known.violates - 1) for report in reports
    ):
        gone.append(f"its largest albedo is {max(report.albedo for report in reports):.10g} (known: {known.violates:.10g})")
    if known.undecided and "UNDECIDED" not in verdicts:
        gone.append("it is decided")
    names = {name for report in reports for name in defects(report)}
    return gone + [f"no finding {name!r}" for name in known.findings if name not in names]


def needed(reports: Sequence[Report], before: Known | None, *, part: bool = False) -> Known | None:
    """The violation to know for these reports on one subject; None where it has none. The reason is that of `before`.

    Of what could not be evaluated, or read, nothing has been found out, nor where the reports are on `part` of the subject of
    the rest: there what was known stays, and what is found is added.
    """
    able = [report for report in reports if report.basis != "none"]
    kept = before if part or len(able) < len(reports) else None
    above = [math.inf if report.unbounded else report.albedo for report in able if report.verdict.name == "VIOLATES"]
    undecided = any(report.verdict.name == "UNDECIDED" for report in able)
    names: list[Any] = list(dict.fromkeys(name for report in able for name in defects(report)))
    if kept is not None:
        above += [] if kept.violates is None else [kept.violates]
        undecided |= kept.undecided
        names = list(dict.fromkeys([*kept.findings, *names]))
    if not (above or undecided or names):
        return None
    today = f"found on {date.today().isoformat()}; say here why it is accepted"
    return Known(
        # With ten digits, so that a file shows no more than an error bar leaves.
        violates=None if not above else math.inf if math.isinf(max(above)) else math.ceil(max(above) * 1e10) / 1e10,
        undecided=undecided,
        findings=names,
        reason=today if before is None else before.reason,
    )


# --- the file ---


def updated(gate: Gate, known: Mapping[int, Known | None]) -> str:
    """The text of the project's file in which the subjects of these indices expect that; nothing else in it changes.

    UsageError, with what to write, where the file is not written subject by subject as ``[[...subjects]]``.
    """
    import tomllib

    text, own = read_text(gate.path)
    starts = gate.heads(text)
    wanted = tomllib.loads(text)
    subjects: Any = wanted
    for key in (*gate.prefix, "subjects"):
        subjects = subjects[key]
    advice = "; ".join(
        f"of {subjects[index]['target']}: {'no expect' if value is None else _line(value)}" for index, value in known.items()
    )
    for index, value in known.items():
        subjects[index].pop("expect", None)
        if value is not None:
            subjects[index]["expect"] = value.model_dump(exclude_defaults=True)
    if len(starts) == len(subjects):
        for index in sorted(known, reverse=True):
            text = _with(text, starts[index], known[index])
        try:
            if tomllib.loads(text) == wanted:
                return own(text)
        except tomllib.TOMLDecodeError:
            pass
    raise UsageError(f"{gate.path.name} is not written so that it can be edited here; change the subjects yourself, {advice}")


def _with(text: str, start: int, known: Known | None) -> str:
    """The text, in which the table that begins at `start` expects that."""
    following = re.compile(r"^[ \t]*\[", re.M).search(text, start)
    end = following.start() if following else len(text)
    table = re.sub(r"^[ \t]*expect[ \t]*=[^\n]*\n?", "", text[start:end], flags=re.M)
    if known is not None:
        body = table.rstrip()
        # Comments at the end of a table belong to the next one.
        lines = body.split("\n")
        last = max((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), default=0)
        lines.insert(last + 1, _line(known))
        table = "\n".join(lines) + (table[len(body) :] or "\n")
    return text[:start] + table + text[end:]


def _line(known: Known) -> str:
    """``expect = { ... }`` as TOML."""
    parts = (
        [f"violates = {'inf' if math.isinf(known.violates) else repr(known.violates)}"] if known.violates is not None else []
    )
    parts += ["undecided = true"] if known.undecided else []
    parts += [f"findings = {json.dumps(known.findings)}"] if known.findings else []
    return f"expect = {{ {', '.join((*parts, f'reason = {json.dumps(one_line(known.reason), ensure_ascii=False)}'))} }}"
