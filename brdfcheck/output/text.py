"""Reports and fits as text: plain lines where the output goes to a file or a pipe, tables where a person looks on.

The plain lines hold ASCII only, are never cut, and start with the BRDF's name and its verdict.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from brdfcheck.messages import one_line
from brdfcheck.verdict import words

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from brdfcheck.brdf.catalog import Entry
    from brdfcheck.fits.factor import FactorFit
    from brdfcheck.fits.ladder import Rung
    from brdfcheck.verdict import Report

_STYLES = {"CONSERVES": "green", "VIOLATES": "bold red", "UNDECIDED": "bold yellow", "ERROR": "bold red"}
# Below this width a report takes two lines of a table, below the other one a paragraph.
_WIDE, _NARROW = 140, 80


# --- plain lines ---


def tolerance_line(tolerance: float) -> str:
    """What the verdicts mean, with the tolerance."""
    return (
        f"largest directional albedo over all parameters and angles; tolerance {words.exact(tolerance)}:"
        f" conserves where albedo + error <= 1 + {words.exact(tolerance)}"
    )


def plain_line(report: Report, name_width: int = 0, claim: str | None = None) -> str:
    """One report in one line, with what was claimed where that is known."""
    parts = [f"{report.name:<{name_width}}", f"{words.verdict_text(report):<9}"]
    if report.unread:
        return "  ".join((*parts, "could not be read"))
    parts.append(f"albedo {words.albedo_text(report)}")
    if words.place_text(report):
        parts.append(f"at {words.place_text(report)}")
    interval = words.interval_text(report)
    if interval:
        parts.append(f"exceeds 1 for {interval}")
    if report.findings:
        parts.append(words.plural(len(report.findings), "finding", "findings"))
    if report.ranges:
        parts.append(f"over {words.ranges_text(report.ranges)}")
    parts += [f"{report.evaluations} evaluations", f"{report.seconds:.2f} s", report.engine]
    if report.basis != "none":
        parts.append(words.basis_text(report))
    if claim is not None:
        parts.append(f'claimed "{claim}"')
    if report.known is not None:
        parts.append(f"known: {one_line(report.known)}")
    return "  ".join(parts)


def remark_lines(reports: Iterable[Report]) -> list[str]:
    """The findings and the notes in full, one a line, each with the name of its BRDF."""
    return [
        f"{kind}: {report.name}: {one_line(text).removeprefix(f'{report.name}: ')}"
        for report in reports
        for kind, texts in (("error" if report.unread else "finding", report.findings), ("note", report.notes))
        for text in texts
    ]


def summary_line(counts: dict[str, int], seconds: float, tolerance: float) -> str:
    """The last line of a check."""
    parts = [
        words.plural(counts["conserve"], "conserves", "conserve"),
        words.plural(counts["violate"], "violates", "violate"),
        f"{counts['undecided']} undecided",
    ]
    if counts["unread"]:
        parts.append(f"{counts['unread']} could not be read")
    if counts["with_findings"]:
        parts.append(words.plural(counts["with_findings"], "has findings", "have findings"))
    if counts["known"]:
        parts.append(f"{counts['known']} known")
    if counts["stale"]:
        parts.append(f"{words.plural(counts['stale'], 'baseline entry', 'baseline entries')} out of date")
    return f"{', '.join(parts)} in {seconds:.1f} s (tolerance {words.exact(tolerance)})"


def entry_line(entry: Entry, name_width: int = 0) -> str:
    """One entry of the catalogue in one line."""
    kind = "validated" if entry.validated else "published"
    text = f"{entry.name:<{name_width}}  {kind}  {words.ranges_text(entry.family.ranges)}  {entry.formula}  [{entry.source}]"
    return text if entry.validated else f'{text}  claimed "{entry.claim}"'


def columns(rows: Sequence[Sequence[str]], right: Container[int] = ()) -> list[str]:
    """Rows of cells as lines with the columns below each other; `right`: the columns that end below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if i in right else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


# --- fits ---


def fit_lines(fit: FactorFit) -> list[str]:
    """A fit: the factor, constants to copy, the largest and the smallest albedo, the verdict, and what there is to remark."""
    report, factor = fit.report, fit.factor
    sampled = "" if fit.objective == "minimax" else f", {fit.sampling} sampling"
    low, high = map(words.exact, fit.n)
    told = f"factor {describe(factor, 10)}  ({fit.objective}{sampled} over n={low}:{high})"
    if fit.constant:
        report = replace(report, parameters={name: value for name, value in report.parameters.items() if name != "n"})
        told = f"constant {1 / float(factor.B):.10g}  ({fit.objective})"  # pyright: ignore[reportAttributeAccessIssue]
    lines = [
        f"{fit.name}  {told}",
        f"  to copy   {_copied(fit)}",
    ]
    if fit.proved is not None:
        lines.append(
            f"  proved    {describe(fit.proved, 10)}  has E <= 1 at every angle and n of the range (brdfcheck certify)"
        )
    if fit.objective != "minimax":
        peak = fit.history[0].peak
        raised = peak > 1 + report.tolerance
        said = f"reaches {peak:.10f}: B was enlarged until it conserves" if raised else "conserves already"
        lines.append(f"  as fitted {describe(fit.fitted, 10)}  {said}")
    smallest = f"{fit.smallest:.10f}" if fit.smallest >= 1e-4 else f"{fit.smallest:.5g}"
    lines += [
        f"  largest   albedo {words.albedo_text(report)}  at {words.place_text(report)}",
        f"  smallest  albedo {smallest}  at {f'n={fit.smallest_n:.6g}, ' if not fit.constant else ''}normal incidence",
        f"  verdict   {report.verdict.name} over all angles (tolerance {words.exact(report.tolerance)})",
    ]
    if fit.remark:
        lines.append(f"  remark    {fit.remark}")
    return [*lines, *(f"  {line}" for line in remark_lines([report]))]


def _copied(fit: FactorFit) -> str:
    """Constants with few digits that still conserve: the factor falls with B and rises with A; where B < 0, the reverse."""
    a, b = float(fit.factor.A), float(fit.factor.B)  # pyright: ignore[reportAttributeAccessIssue]
    if fit.constant or a > 1e5 * max(fit.n[1], 1):
        value = (fit.n[0] + a) / b
        step = 10.0 ** (math.floor(math.log10(value)) - 4)
        why = "" if fit.constant else "; n makes no difference"
        return f"the constant {math.floor(value / step + 1e-9) * step:.5g}  (rounded to the safe side{why})"
    # Of n + A so many digits are kept at the end of the range where it is smallest.
    least = -a - fit.n[1] if b < 0 else a + fit.n[0]
    large = _rounded(abs(b), 5, up=True)
    digits = math.floor(math.log10(abs(a))) - math.floor(math.log10(least)) + 4 if a and least > 0 else 5
    offset = _rounded(abs(a), digits, up=b > 0 > a)
    return f"A = {'-' if a < 0 else ''}{offset}, B = {'-' if b < 0 else ''}{large}  (rounded to the safe side)"


def _rounded(value: float, digits: int, *, up: bool) -> str:
    """`value` >= 0 with so many digits after its first, rounded up or down."""
    if value == 0:
        return "0"
    places = digits - math.floor(math.log10(value))
    # What a constant lies off a round number by rounding must not cost a digit.
    scaled = value * 10.0**places
    whole = math.ceil(scaled - 1e-6) if up else math.floor(scaled + 1e-6)
    text = f"{whole / 10.0**places:.{max(places, 0)}f}"
    return text if len(text) < 20 else f"{whole / 10.0**places:.{max(digits, 1)}e}"


def describe(factor: Any, digits: int = 6) -> str:
    """The factor as a formula in n, or its kind where it has none that is short."""
    from brdfcheck.brdf.factors import AbstractFactor, RationalFactor

    if isinstance(factor, RationalFactor):  # a person reads powers more easily than Horner's rule
        parts = [_polynomial(part.tolist(), digits) for part in (factor.numerator, factor.denominator)]
        return f"({parts[0]})/({parts[1]})"
    text = factor.formula(lambda value: f"{value:.{digits}g}") if isinstance(factor, AbstractFactor) else None
    return text or type(factor).__name__


def _polynomial(coefficients: Sequence[float], digits: int) -> str:
    terms = []
    for power in range(len(coefficients) - 1, -1, -1):
        value = coefficients[power]
        letter = "" if power == 0 else "n" if power == 1 else f"n^{power}"
        sign = ("-" if value < 0 else "") if not terms else (" - " if value < 0 else " + ")
        terms.append(f"{sign}{abs(value):.{digits}g}{' ' if letter else ''}{letter}")
    return "".join(terms)


def ladder_lines(rungs: Sequence[Rung]) -> list[str]:
    """The rungs of a ladder of factors below each other; no line where there are none."""
    if not rungs:
        return []
    rows = [("form", "constants", "operations", "ns", "largest loss", "at n", "verdict", "factor")]
    for rung in rungs:
        lossless = rung.lost < 1e-12
        rows.append(
            (
                rung.form,
                str(rung.constants),
                str(rung.operations),
                f"{rung.nanoseconds:.1f}" if rung.nanoseconds >= 0.1 else "<0.1",
                "none" if lossless else f"{rung.lost:.3g}",
                "-" if lossless else f"{rung.smallest_n:.5g}",
                rung.verdict.name,
                describe(rung.factor),
            )
        )
    return ["  ladder", *(f"    {line}" for line in columns(rows, right=range(1, 6)))]


# --- tables ---


def _text(content: str, style: str = "") -> Text:
    from rich.text import Text

    return Text(content, style=style)


def _table() -> Table:
    from rich import box
    from rich.table import Table

    return Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")


def _stacked(console: Console, rows: Iterable[Sequence[tuple[str, str]]]) -> None:
    """Paragraphs: the first line holds the name and the verdict, the others are indented."""
    from rich.padding import Padding
    from rich.text import Text

    for head, *details in rows:
        for row, (content, style) in enumerate((head, *details)):
            if content:
                console.print(Padding(Text(content, style=style), (0, 0, 0, 2 if row else 0)))


def report_table(console: Console, reports: Sequence[Report], claims: Sequence[str] | None = None) -> None:
    """The reports (of an audit: with what was claimed) as a table that fits the terminal."""
    from rich.text import Text

    plus_minus, degree = ("\u00b1", "\u00b0") if console.encoding.lower().startswith("utf") else ("+-", " deg")
    claimed = claims if claims is not None else [""] * len(reports)
    if console.width < _NARROW:
        _stacked(
            console,
            (
                (
                    (f"{report.name}  {words.verdict_text(report)}", _STYLES[words.verdict_text(report)]),
                    (f"claimed: {claim}" if claim else "", ""),
                    (f"albedo {words.albedo_text(report, plus_minus)}", ""),
                    (f"at {words.place_text(report, degree)}" if words.place_text(report) else "", ""),
                    (f"exceeds 1 for {words.interval_text(report)}" if words.interval_text(report) else "", "red"),
                    (_effort(report), "dim"),
                )
                for report, claim in zip(reports, claimed, strict=True)
            ),
        )
        return
    wide = console.width >= (_WIDE if claims is None else _WIDE + 24)
    table = _table()
    # Catalogue names stay whole; a long path of a user's file may be folded.
    longest = max((len(report.name) for report in reports), default=0)
    table.add_column("BRDF", no_wrap=wide, overflow="fold", min_width=min(longest, 25))
    if claims is not None and wide:
        table.add_column("Claimed", overflow="fold")
    table.add_column("Verdict", no_wrap=True)
    table.add_column("Largest albedo", no_wrap=True)
    table.add_column("Where", overflow="fold")
    if wide:
        table.add_column("Exceeds 1 for", overflow="fold")
        table.add_column("Evaluations", justify="right", no_wrap=True)
        table.add_column("Seconds", justify="right", no_wrap=True)
        table.add_column("Engine", no_wrap=True)
    for report, claim in zip(reports, claimed, strict=True):
        verdict = Text(words.verdict_text(report), style=_STYLES[words.verdict_text(report)])
        if not wide:
            verdict.append(f"\n{report.seconds:.2f} s", style="not bold dim white")
        if report.known is not None:
            verdict.append("\nknown", style="not bold dim white")
        if report.findings and not report.unread:
            verdict.append("\n" + words.plural(len(report.findings), "finding", "findings"), style="bold red")
        albedo, place = _text(words.albedo_text(report, plus_minus)), _text(words.place_text(report, degree))
        name = _text(report.name)
        if wide:
            cells = [name, *([_text(claim)] if claims is not None else []), verdict, albedo, place]
            cells += [_text(words.interval_text(report)), _text(words.count_text(report.evaluations))]
            table.add_row(*cells, _text(f"{report.seconds:.2f}"), _text(report.engine))
            continue
        # Two lines for a report; what it cost is on the second one.
        name.append(f"\n  {report.engine}", style="dim")
        if claim:
            name.append(f"\n  claimed: {claim}", style="italic")
        albedo.append(f"\n{words.count_text(report.evaluations)} evaluations", style="dim")
        if report.parameters:
            place = _text(f"{words.parameters_text(report)}\n{words.angles_text(report, degree)}")
        if words.interval_text(report):
            place.append(f"\n> 1 for {words.interval_text(report)}", style="red")
        table.add_row(name, verdict, albedo, place)
    console.print(table)


def _effort(report: Report) -> str:
    return f"{words.count_text(report.evaluations)} evaluations, {report.seconds:.2f} s, {report.engine}"


def remarks(console: Console, reports: Iterable[Report]) -> None:
    """What the answers of a table rest on, and its findings and notes, below it."""
    reports = list(reports)
    for report in reports:
        if not report.unread:
            console.print(_text(f"{report.name}: {one_line(words.basis_text(report))}", "dim"))
    for line in remark_lines(reports):
        finding = line.startswith(("finding", "error"))
        console.print(_text(line, "red" if finding else "dim"))


def entry_table(console: Console, entries: Sequence[Entry]) -> None:
    """The catalogue as a table that fits the terminal."""
    if console.width < 100:
        _stacked(
            console,
            (
                (
                    (entry.name, "bold"),
                    (entry.formula, ""),
                    (f"for {words.ranges_text(entry.family.ranges)}", ""),
                    (entry.source, "dim"),
                    (f"claimed: {entry.claim}" if entry.claim else "", "italic"),
                )
                for entry in entries
            ),
        )
        return
    table = _table()
    published = any(entry.claim for entry in entries)
    for title in ("BRDF", "Range", "Formula", *(("Claimed",) if published else ()), "Source"):
        table.add_column(title, overflow="fold", no_wrap=title in ("BRDF", "Range"))
    for entry in entries:
        cells = [entry.name, words.ranges_text(entry.family.ranges), entry.formula]
        cells += [entry.claim] if published else []
        table.add_row(*(_text(cell) for cell in (*cells, entry.source)))
    console.print(table)
