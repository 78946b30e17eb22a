"""What a check says: the verdict, the largest albedo with its place and error bar, and what it rests on."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from brdfcheck.verdict import words
from brdfcheck.verdict.parts import Check, Doubt, SideChecks, degrees

if TYPE_CHECKING:
    from brdfcheck.brdf.family import Family
    from brdfcheck.quadrature.pointwise import PointwiseAlbedo
    from brdfcheck.verdict.supremum import Supremum

TOLERANCE = 1e-9
"""How far above 1 an albedo may lie and still count as conserving."""


class Verdict(enum.Enum):
    """Three answers, because an error bar can straddle the line."""

    CONSERVES = "the albedo stays at or below 1"
    VIOLATES = "the albedo exceeds 1 by more than its own error"
    UNDECIDED = "the error bar contains 1: ask for more accuracy or allow a tolerance"


@dataclass(frozen=True)
class Report:
    """What `check` found out about a family of BRDFs. True where it passed: ``assert check(brdf)`` works.

    `albedo` +- `error` is the largest directional albedo, and `least` what it is at least; `parameters`, `cos_theta`, `azimuth`
    (radians) say where. `above`: where the family's single parameter makes it exceed 1 (None: not looked for). `side`:
    reciprocity, minimum, NaN/Inf (None where the BRDF could not be evaluated); `checks`: what each check beside the albedo
    measured, and whether that passes. `findings`: defects, in words; `notes`: remarks. `name` is the family's, `engine` that of
    the rule, which made so many `evaluations` in `seconds`; `anisotropic`: the azimuth of incidence matters.

    What the answer rests on: `basis` ("proof" where `brdfcheck.certify` proves the verdict, whatever the tolerance; "theorem"
    where one holds, and `theorem` says which; else "search", or "single precision" for a search over values in float32, whose
    rounding the error bar holds), `effort`, `points` looked at, `climbs` begun, `settled` (the last scan found nothing higher,
    and no climb was left unfinished that might yet cross 1), and `width`: the widest region that the search may have missed,
    for each parameter as a part of its range, for "angle", "azimuth" and "view" (the reflected directions of a function, at one
    incidence) in degrees, and for "cell" as a part of all ranges at once. `unbounded` says where the albedo grows without bound
    (`albedo` is then infinite). `channel`: of `channels`, the one with the largest albedo (None: there is one only). `doubt`:
    of a measured table, what the samples leave open and how much of the error bar that is (None for anything else).

    `known`: why what was found is accepted (None: it is not, or nothing was found); `stale`: more is accepted than was found.
    `unread`: the BRDF could not be read, so that nothing was checked; `findings` says why.
    """

    name: str
    verdict: Verdict
    ranges: Mapping[str, tuple[float, float]]
    tolerance: float = TOLERANCE
    albedo: float = math.nan
    error: float = math.nan
    least: float = math.nan
    parameters: Mapping[str, float] = field(default_factory=dict)
    cos_theta: float = math.nan
    azimuth: float = math.nan
    above: tuple[tuple[float, float], ...] | None = None
    side: SideChecks | None = None
    checks: tuple[Check, ...] = ()
    engine: str = "none"
    anisotropic: bool = False
    evaluations: int = 0
    seconds: float = 0.0
    findings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    basis: str = "none"
    theorem: str | None = None
    points: int = 0
    climbs: int = 0
    settled: bool = False
    width: Mapping[str, float] = field(default_factory=dict)
    unbounded: str | None = None
    channel: int | None = None
    channels: int = 1
    effort: str = "normal"
    doubt: Doubt | None = None
    known: str | None = None
    stale: bool = False
    unread: bool = False

    @property
    def passed(self) -> bool:
        """True where the family conserves energy and has no other defect, or where what it has is known."""
        return self.known is not None or (self.verdict is Verdict.CONSERVES and not self.findings)

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        lines = [f"{self.name}: {words.message(self)}", f"  {words.basis_text(self)}"]
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])

    @property
    def angle(self) -> float:
        """The worst angle of incidence in degrees."""
        return degrees(self.cos_theta)


def judge(
    value: float, error: float, tolerance: float = TOLERANCE, *, least: float | None = None, settled: bool = True
) -> Verdict:
    """The verdict on a largest albedo `value` +- `error`, which may lie above 1 by the `tolerance`; NaN is UNDECIDED.

    `least`: what the albedo is at least, where that is known better than by the error bar, which may hold places that are not
    resolved. A search that has not `settled` never conserves.
    """
    surely = value - error if least is None else least
    if surely > 1 + tolerance or value == math.inf:
        return Verdict.VIOLATES
    return Verdict.CONSERVES if settled and value + error <= 1 + tolerance else Verdict.UNDECIDED


def reported(
    family: Family, verdict: Verdict, worst: Supremum | None = None, albedo: PointwiseAlbedo | None = None, **more: Any
) -> Report:
    """The report on a family: `worst` is what a search of `albedo` found, and without it nothing could be evaluated.

    `more`: fields of the report that neither of them knows, or knows otherwise.
    """
    found: dict[str, Any] = {
        "name": family.name,
        "verdict": verdict,
        "ranges": {**{name: (value, value) for name, value in family.held.items()}, **family.ranges},
    }
    if worst is not None:
        same = (
            "error", "least", "cos_theta", "azimuth", "above", "basis", "theorem", "points", "climbs", "settled", "width",
            "unbounded", "channel", "channels",
        )  # fmt: skip
        found |= {name: getattr(worst, name) for name in same}
        found |= {"albedo": worst.value, "parameters": {**family.held, **worst.parameters}}
    if albedo is not None:
        found |= {"engine": albedo.engine_name, "anisotropic": albedo.anisotropic, "evaluations": albedo.evaluations}
    return Report(**found | more)
