"""What a check leaves besides its lines: JUnit, SARIF, a badge, a page; for check, audit and view."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from brdfcheck import __version__
from brdfcheck.cli import words
from brdfcheck.cli.app import start
from brdfcheck.cli.output import Output
from brdfcheck.cores import side_by_side

if TYPE_CHECKING:
    from brdfcheck.brdf.subject import Target
    from brdfcheck.fits.slices import Slices
    from brdfcheck.gate.requests import Case
    from brdfcheck.verdict import Report

_log = logging.getLogger("brdfcheck")
# Numbers in all tables of a page: 2.7 bytes each, so that a page stays below 300 kB.
_CELLS = 56_000

JUnit = Annotated[str | None, words.file("--junitxml", ends=(".xml",), bare=True, help="Write the results as JUnit XML.")]
Sarif = Annotated[
    str | None,
    words.file("--sarif", ends=(".sarif", ".json"), bare=True, help="Write what is wrong as SARIF 2.1.0, for code hosts."),
]
Badge = Annotated[
    str | None, words.file("--badge", ends=(".json",), bare=True, help="Write a badge as JSON, an endpoint for shields.io.")
]
Html = Annotated[
    str | None,
    words.file(
        "--html",
        ends=(".html", ".htm"),
        help="Write a page to look through: verdicts, heat maps of the albedo, white furnaces.",
    ),
]


@dataclass(frozen=True)
class Files:
    """The files that a check writes besides `json`, by option. UsageError where two are the same one."""

    json: str | None = None
    junitxml: str | None = None
    sarif: str | None = None
    badge: str | None = None
    html: str | None = None

    def __post_init__(self) -> None:
        words.refuse_same({f"--{name}": path for name, path in vars(self).items()})

    def write(
        self,
        output: Output,
        cases: Sequence[Case],
        reports: Sequence[Report],
        *,
        jobs: int,
        seconds: float,
        exit_code: int,
        claims: Mapping[str, str] | None = None,
    ) -> None:
        """Write what was asked for. UsageError where that is not possible."""
        from brdfcheck.output import records, sarif
        from brdfcheck.verdict.words import message

        places = [case.place for case in cases]
        if self.junitxml:
            messages = [message(report) for report in reports]
            classes = ["brdfcheck.user" if case.file else "brdfcheck.catalog" for case in cases]
            text = records.to_junit(reports, messages, seconds=seconds, classnames=classes, places=places)
            output.save(self.junitxml, text, "--junitxml")
        if self.sarif:
            output.save(self.sarif, sarif.to_sarif(reports, places, exit_code=exit_code), "--sarif")
        if self.badge:
            output.save(self.badge, records.to_json(records.badge(records.count(reports))), "--badge")
        if self.html:
            output.save(self.html, _page(output, cases, reports, jobs, claims), "--html")


def _page(
    output: Output,
    cases: Sequence[Case],
    reports: Sequence[Report],
    jobs: int,
    claims: Mapping[str, str] | None,
) -> str:
    from brdfcheck.output.html import Entry, heading, page

    start()  # where all verdicts were known, nothing has been computed before
    targets = [_target(case) for case in cases]
    with output.progress("drawing", len(cases), every=10) as advance:
        room = max(400, _CELLS // len(cases))

        def drawn(pair: tuple[Target, Report]) -> Slices | None:
            found = _slices(*pair, room)
            advance()
            return found

        tables = side_by_side(drawn, list(zip(targets, reports, strict=True)), most=jobs)
    entries = [
        Entry(report.name, table, report, _facts(case, report))
        for case, report, table in zip(cases, reports, tables, strict=True)
    ]
    said = heading(reports)
    if claims:
        said = f"What the literature claims: {said[0].lower() + said[1:] if len(reports) > 1 else said}"
    return page(entries, heading=said, lines=[made()], claims=claims, provenance=versions())


def made() -> str:
    """When, and by which version."""
    return f"{datetime.now().astimezone().isoformat(sep=' ', timespec='minutes')}, brdfcheck {__version__}"


def versions() -> str:
    """What the numbers of a page may depend on, in a line."""
    from brdfcheck.output import records

    device = records.device()
    parts = [f"{name} {version}" for name, version in records.versions().items()]
    return f"Computed with {', '.join(parts)} on {device['kind']} ({device['system']}, {device['machine']})."


def _target(case: Case) -> Target:
    """What is drawn; of a verdict from the cache it is read now."""
    from brdfcheck.gate.requests import cases

    found = case if case.target is not None else next(one for one in cases(case.request) if one.name == case.name)
    assert found.target is not None
    return found.target


def _slices(target: Target, report: Report, room: int) -> Slices | None:
    """Slices through the place of the largest albedo; None where a user's BRDF cannot be evaluated."""
    if report.basis == "none":
        return None
    from brdfcheck.fits.slices import slices

    cosine = 1.0 if math.isnan(report.cos_theta) else report.cos_theta
    azimuth = 0.0 if math.isnan(report.azimuth) else report.azimuth
    try:
        return slices(target.family, report.parameters, cosine, azimuth, cells=room)
    except (Exception, SystemExit):
        if target.file is None:
            raise
        _log.debug("%s cannot be tabulated", report.name, exc_info=True)
        return None


def _facts(case: Case, report: Report) -> dict[str, str]:
    """Where a BRDF comes from, why what was found is accepted, and the command that checks it again."""
    from brdfcheck.brdf import catalog

    facts: dict[str, str] = {}
    if report.known is not None:
        facts["Accepted"] = report.known
    if case.file is not None:
        facts["Defined in"] = f"{case.file}:{case.line}" if case.line else case.file
    elif case.entry is not None:
        entry = catalog.entry(case.entry)
        facts |= {"Formula": entry.formula, "Source": entry.source}
    return facts | {"Check it again": case.request.command}


def address(path: str) -> str:
    """The URL of a file."""
    return Path(path).resolve().as_uri()
