"""A report in words: the pieces of which lines, tables, messages and ``str(report)`` are made. ASCII only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from brdfcheck.brdf.family import shown
from brdfcheck.messages import one_line

if TYPE_CHECKING:
    from brdfcheck.verdict.report import Report


def exact(value: float) -> str:
    """A number as short as it can be said, 1e-9 rather than 1e-09."""
    mantissa, letter, exponent = f"{value:.6g}".partition("e")
    return f"{mantissa}e{int(exponent)}" if letter else mantissa


def verdict_text(report: Report) -> str:
    """The verdict in one word; what could not be read has none."""
    return "ERROR" if report.unread else report.verdict.name


def albedo_text(report: Report, plus_minus: str = "+-") -> str:
    """The largest albedo and its error bar, with the digits that the error bar leaves (at most ten)."""
    if math.isnan(report.cos_theta):
        return "unknown"
    if math.isnan(report.albedo):
        return "not a number"
    if not math.isfinite(report.albedo):
        return f"grows without bound {report.unbounded}" if report.unbounded else "infinite"
    most = 10 if report.tolerance >= 1e-10 else 16
    digits = most
    if report.error > 0 and math.isfinite(report.error):
        digits = min(max(2 - math.ceil(math.log10(report.error)), 2), most)
    value = f"{report.albedo:.{digits}f}" if abs(report.albedo) < 1e6 else f"{report.albedo:.10g}"
    text = f"{value} {plus_minus} {report.error:.2g}"
    # The bar holds places that are not resolved, too; what decides is what is known of this one.
    if report.verdict.name == "VIOLATES" and report.albedo - report.error <= 1 + report.tolerance < report.least:
        text += f", at least {_above_one(report.least)}"
    return text


def _above_one(value: float) -> str:
    """A number above 1 with as many digits as show that, rounded down."""
    digits = min(max(1 - math.floor(math.log10(value - 1)), 2), 16)
    return f"{math.floor(value * 10**digits + 1e-6) / 10**digits:.{digits}f}"


def place_text(report: Report, degree: str = " deg") -> str:
    """Where the albedo is largest: the parameters, the angle of incidence, and the azimuth where it matters."""
    if "=" in (report.unbounded or ""):  # a pole has said where it is
        return ""
    if math.isnan(report.cos_theta):
        return ""
    return " ".join(filter(None, (parameters_text(report), angles_text(report, degree))))


def parameters_text(report: Report) -> str:
    """The parameters where the albedo is largest, and the channel where there are several."""
    parts = [f"{name}={value:.6g}" for name, value in report.parameters.items()]
    if report.channel is not None:
        parts.append(f"channel={channel_text(report.channel, report.channels)}")
    return " ".join(parts)


def channel_text(channel: int, count: int) -> str:
    """A channel by the name it has where there are three of them, else by its number."""
    return ("red", "green", "blue")[channel] if count == 3 else str(channel)


def angles_text(report: Report, degree: str) -> str:
    """The angle of incidence, and the azimuth where it matters."""
    parts = [f"angle={report.angle:.5g}{degree}"]
    if report.anisotropic:
        parts.append(f"azimuth={math.degrees(report.azimuth):.5g}{degree}")
    return " ".join(parts)


def ranges_text(ranges: Any) -> str:
    """The box of parameters, as ``--over`` takes it."""
    return " ".join(f"{name}={shown(bounds)}" for name, bounds in ranges.items())


def interval_text(report: Report) -> str:
    """The parameters for which some angle exceeds 1, or nothing."""
    swept = [name for name, (low, high) in report.ranges.items() if low < high]
    if not report.above or len(swept) != 1:
        return ""
    return f"{swept[0]}=" + ", ".join(f"{low:.6g}..{high:.6g}" for low, high in report.above)


def count_text(evaluations: int) -> str:
    """A count in three digits: 780k, 1.2M."""
    for unit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if evaluations >= unit:
            return f"{evaluations / unit:.3g}{letter}"
    return str(evaluations)


def plural(count: int, singular: str, many: str) -> str:
    """``1 violates``, ``2 violate``."""
    return f"{count} {singular if count == 1 else many}"


def message(report: Report) -> str:
    """In one line what was found out, for annotations and test reports; what is wrong comes first."""
    if report.unread:
        return f"{verdict_text(report)}: {'; '.join(map(one_line, report.findings))}"
    text = f"{report.verdict.name}: albedo {albedo_text(report)}"
    if place_text(report):
        text += f" at {place_text(report)}"
    interval = interval_text(report)
    if interval:
        text += f"; exceeds 1 for {interval}"
    text += f" (tolerance {exact(report.tolerance)})"
    parts = (text, *map(one_line, report.findings))
    return "; ".join(parts if report.verdict.name != "CONSERVES" else (*parts[1:], text))


def reason_text(report: Report) -> str:
    """Why the verdict is what it is."""
    if report.verdict.name != "UNDECIDED":
        return report.verdict.value
    if report.basis == "none":
        return f"the BRDF could not be {'read' if report.unread else 'evaluated'}"
    if math.isnan(report.albedo):
        return "the albedo is not a number"
    if not report.settled:
        return "the search did not settle: narrow the ranges, or give it more effort"
    if report.albedo + report.error < 0:
        return "the albedo is negative throughout"
    return report.verdict.value


def basis_text(report: Report) -> str:
    """What the answer rests on, in a few words: a theorem or a search, how large it was, and what it could have missed."""
    if report.basis == "none":
        return "nothing could be evaluated"
    kind = "search in single precision" if report.basis == "single precision" else report.basis
    looked = f"{kind}, {count_text(report.points)} points, {plural(report.climbs, 'climb', 'climbs')}"
    if report.basis == "theorem":
        over = "" if "angle" in report.width else " over the parameters"
        looked = f"theorem: {report.theorem}, {count_text(report.points)} points{over}"
    if report.basis == "proof":
        proved = "above 1 at one point" if report.verdict.name == "VIOLATES" else "at most 1"
        return f"proof: {proved} in exact arithmetic (brdfcheck certify), {count_text(report.points)} points for the largest"
    if not report.settled:
        looked += ", not settled"
    missed = width_text(report.width)
    return f"{looked}, could miss {missed}" if missed else looked


def width_text(width: Mapping[str, float]) -> str:
    """The widest region that a search may have missed: as a part of each range, or of all at once."""
    percent = {name: f"{100 * value:.{3 if value > 0.99 else 2}g} %" for name, value in width.items()}
    parts = []
    for name, value in width.items():
        if name in ("angle", "azimuth", "view"):
            parts.append(f"{value:.2g} deg of the {name}")
        elif name != "cell":
            parts.append(f"{percent[name]} of {'the ' if ' ' in name else ''}{name}")
    several = [f"{percent['cell']} of all at once"] if "cell" in width else []
    return " or ".join([", ".join(parts), *several]) if parts else ""
