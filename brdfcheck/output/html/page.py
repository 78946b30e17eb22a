"""The page itself: verdicts as a table, an article for each BRDF, and the script and style that go with them.

What is read is HTML and needs no script; the script draws, sorts, and shows one article at a time. A content security policy
lets run what this file holds, by its hash, and nothing else, and lets it load nothing.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from string import Template

from brdfcheck import __version__
from brdfcheck.fits.slices import Slices
from brdfcheck.output import records
from brdfcheck.output.html.articles import article, verdict_row
from brdfcheck.output.html.tables import table_object
from brdfcheck.verdict import Report, Verdict


@dataclass(frozen=True)
class Entry:
    """A BRDF of a page: its name, slices of its albedo (None: there are none), the report on it, and what else is known.

    `facts`: name and text of each. A sweep has no `report`: its largest albedo is that of a grid, and no verdict.
    """

    name: str
    slices: Slices | None = None
    report: Report | None = None
    facts: Mapping[str, str] = field(default_factory=dict)


def heading(reports: Sequence[Report]) -> str:
    """The answer in one sentence."""
    counts = records.count(reports)
    if len(reports) == 1:
        report = reports[0]
        if report.unread:
            return f"{report.name} could not be read"
        said = {
            Verdict.CONSERVES: "conserves energy",
            Verdict.VIOLATES: "does not conserve energy",
            Verdict.UNDECIDED: "is undecided",
        }[report.verdict]
        return f"{report.name} {said}{', but has defects' if report.findings and report.verdict is Verdict.CONSERVES else ''}"
    defects = sum(bool(report.findings) and report.verdict is Verdict.CONSERVES for report in reports)
    parts = [
        (counts["violate"], "does not conserve energy", "do not conserve energy"),
        (counts["undecided"], "is undecided", "are undecided"),
        (counts["unread"], "could not be read", "could not be read"),
        (defects, "has other defects", "have other defects"),
    ]
    found = [part for part in parts if part[0]]
    if not found:
        return f"All {len(reports)} BRDFs conserve energy"
    (first, *verb), *rest = found
    said = [f"{first} of {len(reports)} BRDFs {verb[first > 1]}"]
    return ", ".join([*said, *(f"{number} {verb[number > 1]}" for number, *verb in rest)])


def page(
    entries: Sequence[Entry],
    *,
    heading: str,
    lines: Sequence[str] = (),
    claims: Mapping[str, str] | None = None,
    provenance: str = "",
) -> str:
    """The page as text, to be written as UTF-8. `lines` stand below the heading, `claims` say by name what was published."""
    ids = _ids([entry.name for entry in entries])
    data = [
        None
        if entry.slices is None
        else table_object(entry.slices, 0.0 if entry.report is None else entry.report.tolerance)
        | {"judged": entry.report is not None}
        for entry in entries
    ]
    # Within a script a "<" could end it.
    text = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    style, script = _file("report.css"), _file("tables.js") + "\n" + _file("view.js")
    articles = [article(entry, identity, index) for index, (entry, identity) in enumerate(zip(entries, ids, strict=True))]
    return Template(_file("report.html")).substitute(
        policy=escape(policy(script, style)),
        version=escape(__version__),
        title=escape(f"{heading} \u00b7 brdfcheck"),
        heading=escape(heading),
        summary=_chips(entries) + "".join(f'<p class="meta">{escape(line)}</p>\n' for line in lines),
        body=_table(entries, ids, claims) + "\n".join(articles),
        provenance=escape(provenance),
        data=text,
        style=style,
        script=script,
    )


def policy(script: str, style: str) -> str:
    """The content security policy of a page with this script and style: these two, by their hashes, and nothing else."""
    code, looks = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (script, style))
    allowed = f"script-src 'sha256-{code}'; style-src 'sha256-{looks}'"
    return f"default-src 'none'; {allowed}; base-uri 'none'; form-action 'none'"


def _file(name: str) -> str:
    return resources.files("brdfcheck.output.html").joinpath(name).read_text(encoding="utf-8")


def _ids(names: Sequence[str]) -> list[str]:
    """A fragment for each name: readable, and no two alike."""
    found: list[str] = []
    for name in names:
        short = re.sub(r"[^A-Za-z0-9._-]+", "-", name.rpartition("/")[2]).strip("-") or "brdf"
        found.append(short if short not in found and short != "data" else f"{short}-{len(found) + 1}")
    return found


def _chips(entries: Sequence[Entry]) -> str:
    reports = [entry.report for entry in entries if entry.report is not None]
    if not reports:
        return ""
    counts = records.count(reports)
    said = [
        (counts["conserve"], f"conserve{'s' * (counts['conserve'] == 1)} energy", "CONSERVES"),
        (counts["violate"], f"violate{'s' * (counts['violate'] == 1)} it", "VIOLATES"),
        (counts["undecided"], "undecided", "UNDECIDED"),
        (counts["unread"], "could not be read", "ERROR"),
        (counts["with_findings"], "with findings", "UNDECIDED"),
        (counts["known"], "known and accepted", "neutral"),
    ]
    items = "".join(f'<li class="pill {kind}">{number} {text}</li>' for number, text, kind in said if number)
    return f'<ul class="chips">{items}</ul>\n'


def _table(entries: Sequence[Entry], ids: Sequence[str], claims: Mapping[str, str] | None) -> str:
    if all(entry.report is None for entry in entries):
        names = list(dict.fromkeys(name for entry in entries for name in entry.facts))
        heads = ["BRDF", *names]
        rows = [
            f'<tr><th scope="row"><a href="#{identity}">{escape(entry.name)}</a></th>'
            + "".join(f"<td>{escape(entry.facts.get(name, ''))}</td>" for name in names)
            + "</tr>"
            for entry, identity in zip(entries, ids, strict=True)
        ]
    else:
        heads = ["BRDF", *(["Claimed"] if claims else []), "Verdict", "Largest albedo", "Where", "Exceeds 1 for"]
        heads += ["Rests on", "Findings", "Seconds"]
        rows = [
            verdict_row(entry.report, identity, None if claims is None else claims.get(entry.name, ""))
            for entry, identity in zip(entries, ids, strict=True)
            if entry.report is not None
        ]
    head = "".join(f'<th scope="col"><button type="button">{escape(text)}</button></th>' for text in heads)
    return (
        '<section class="card"><div class="wide"><table class="verdicts">\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{chr(10).join(rows)}\n</tbody></table></div></section>\n"
    )
