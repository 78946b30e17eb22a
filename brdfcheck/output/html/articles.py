"""What a page says of one BRDF, in HTML: its row in the table of verdicts, and its article."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from brdfcheck.verdict import words

if TYPE_CHECKING:
    from brdfcheck.output.html.page import Entry
    from brdfcheck.verdict import Report
    from brdfcheck.verdict.parts import Witness

_SIGNS = "\u00b1", "\u00b0"


def verdict_row(report: Report, identity: str, claim: str | None) -> str:
    """The row of a report, with what was claimed where that is known; cells sort by their keys."""
    cells = [] if claim is None else [_cell(claim)]
    size = "" if math.isnan(report.albedo) else repr(float(report.albedo)).replace("inf", "Infinity")
    cells += [
        _cell(_pill(report), key=words.verdict_text(report), markup=True),
        _cell(words.albedo_text(report, _SIGNS[0]), key=size, kind="number" if math.isfinite(report.albedo) else ""),
        _cell(words.place_text(report, _SIGNS[1])),
        _cell(words.interval_text(report)),
        _cell({"none": "nothing", "single precision": "search, float32"}.get(report.basis, report.basis)),
        _cell(str(len(report.findings)) if report.findings else "", key=str(len(report.findings)), kind="number"),
        _cell(f"{report.seconds:.2f}", kind="number"),
    ]
    return f'<tr><th scope="row"><a href="#{identity}">{escape(report.name)}</a></th>{"".join(cells)}</tr>'


def _cell(text: str, *, key: str | None = None, kind: str = "", markup: bool = False) -> str:
    attributes = (f' class="{kind}"' if kind else "") + (f' data-key="{escape(key)}"' if key is not None else "")
    return f"<td{attributes}>{text if markup else escape(text)}</td>"


def _pill(report: Report) -> str:
    known = ' <span class="pill neutral">accepted</span>' if report.known is not None else ""
    word = words.verdict_text(report)
    return f'<span class="pill {word}">{word}</span>{known}'


def article(entry: Entry, identity: str, index: int) -> str:
    """All there is to say of one BRDF, and the place where the script draws its table (the one with this index)."""
    report = entry.report
    bad = " bad" if report is not None and not report.passed else ""
    parts = [f'<article class="card{bad}" id="{identity}" data-index="{index}">']
    parts.append(f'<div class="title"><h2>{escape(entry.name)}</h2>{"" if report is None else _pill(report)}</div>')
    if report is not None:
        parts.append(f'<p class="lead">{escape(_lead(report))}</p>')
    drawn = '<div class="explorer"></div>' if entry.slices is not None else '<p class="small">No table of its albedo.</p>'
    parts.append(drawn)
    if report is not None:
        parts += _findings(report)
    facts = {**({} if report is None else _facts(report)), **_by_channel(entry), **entry.facts}
    parts.append("<dl>" + "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in facts.items()) + "</dl>")
    if report is not None:
        parts += _checks(report)
        parts += [f'<p class="small">Note: {escape(note)}</p>' for note in report.notes]
    return "\n".join([*parts, "</article>"])


def _lead(report: Report) -> str:
    if report.unread:
        return "It could not be read, and was not checked."
    text = f"{'The' if report.unbounded else 'Largest'} albedo {words.albedo_text(report, _SIGNS[0])}"
    if words.place_text(report, _SIGNS[1]):
        text += f" at {words.place_text(report, _SIGNS[1])}"
    if words.interval_text(report):
        text += f"; it exceeds 1 for {words.interval_text(report)}"
    return text + "."


def _facts(report: Report) -> dict[str, str]:
    facts = {
        "Verdict": f"{words.verdict_text(report)}: {words.reason_text(report)}",
        "It rests on": words.basis_text(report),
        "Over": words.ranges_text(report.ranges) or "no parameters",
        "Tolerance": words.exact(report.tolerance),
        "Engine": f"{report.engine}, {words.count_text(report.evaluations)} evaluations, {report.seconds:.2f} s",
        "Effort": report.effort,
    }
    if report.channels > 1:
        facts["Channels"] = f"{report.channels}"
        if report.channel is not None:
            facts["Channels"] += f"; the largest albedo is that of {words.channel_text(report.channel, report.channels)}"
    return facts


def _by_channel(entry: Entry) -> dict[str, str]:
    """The largest value of each channel in the tables, where there are several."""
    if entry.slices is None:
        return {}
    each = [
        [float(np.max(channel[np.isfinite(channel)], initial=-np.inf)) for channel in table]
        for table in entry.slices.tables.values()
    ]
    most = np.max(each, axis=0)
    if len(most) < 2:
        return {}
    return {"Largest by channel": ", ".join(f"{words.channel_text(i, len(most))} {value:.4f}" for i, value in enumerate(most))}


def _findings(report: Report) -> Iterable[str]:
    if not report.findings:
        return []
    witnesses = _witnesses(report)
    items = []
    for finding in report.findings:
        witness = witnesses.get(finding)
        picture = "" if witness is None else _directions(witness)
        items.append(f"<li>{picture}<p>{escape(finding)}</p></li>")
    return [f"<h3>{'Error' if report.unread else 'Findings'}</h3>\n<ul class='findings'>{''.join(items)}</ul>"]


def _witnesses(report: Report) -> dict[str, Witness]:
    """The pair of directions behind each finding that has one."""
    if report.side is None:
        return {}
    shown = {"reciprocal": report.side.unequal, "positive": report.side.lowest, "finite": report.side.broken}
    failed = {found.name: found.words for found in report.checks if not found.passed}
    return {failed[name]: witness for name, witness in shown.items() if witness is not None and name in failed}


def _directions(witness: Witness) -> str:
    """The hemisphere from above, its rings 30 degrees apart, and the two directions on it."""
    marks = []
    for name, direction in (("wi", witness.wi), ("wo", witness.wo)):
        x, y = _seen_from_above(direction)
        place = f'x1="0" y1="0" x2="{x:.2f}" y2="{y:.2f}"'
        above = y - 7 if name == "wi" else y + 13
        marks.append(
            f'<g class="{name}"><line {place} stroke-width="1.4"/><circle cx="{x:.2f}" cy="{y:.2f}" r="3.4"/>'
            f'<text x="{min(max(x, -48), 48):.2f}" y="{above:.2f}" text-anchor="middle">{name}</text></g>'
        )
    rings = "".join(f'<circle class="ring" r="{radius}"/>' for radius in (16, 32, 48))
    told = "; ".join(
        f"{name} at {math.degrees(math.acos(min(max(direction[2], -1), 1))):.3g} degrees from the normal"
        for name, direction in (("wi", witness.wi), ("wo", witness.wo))
    )
    return f'<svg viewBox="-66 -66 132 132" role="img" aria-label="{escape(told)}">{rings}{"".join(marks)}</svg>'


def _seen_from_above(direction: tuple[float, ...]) -> tuple[float, float]:
    angle = math.acos(min(max(direction[2], -1.0), 1.0))
    sine = math.hypot(direction[0], direction[1])
    radius = 48 * angle / (math.pi / 2)
    return (radius * direction[0] / sine, -radius * direction[1] / sine) if sine > 0 else (0.0, 0.0)


def _checks(report: Report) -> list[str]:
    if not report.checks:
        return []
    rows = "".join(
        f'<tr><th scope="row">{escape(found.name)}</th>'
        f'<td class="{"passed" if found.passed else "failed"}">{"passed" if found.passed else "failed"}</td>'
        f"<td>{escape(found.words)}</td></tr>"
        for found in report.checks
    )
    head = '<tr><th scope="col">Check</th><th scope="col">Result</th><th scope="col">Measured</th></tr>'
    return [
        f'<h3>Checks beside the albedo</h3>\n<div class="wide"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>'
    ]
