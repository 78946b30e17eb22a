"""What is asked of BRDFs, and what came of it: verdicts from the cache where they are known, else what is to be checked.

Imports nothing heavy: what is in the cache needs no BRDF.
"""

from __future__ import annotations

import logging
import math
import os
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import TYPE_CHECKING, Any

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.values import Range, Values
from brdfcheck.messages import UsageError, written

if TYPE_CHECKING:
    from brdfcheck.brdf.subject import Target
    from brdfcheck.gate.config import Known
    from brdfcheck.verdict import Report


_log = logging.getLogger("brdfcheck")


@dataclass(frozen=True)
class Request:
    """BRDFs that are checked under the same options; those of a project one at a time.

    `names`, `over`, `cos_theta`, `reading`: as for `brdfcheck.brdf.subject.resolve`; `tolerance`: None for that of each family;
    `expect`: the violation that is accepted, None for none; `part`: some BRDFs of the subject were left out; `index`: which of
    the project's subjects it is, `label`: how messages call it, `place`: the file and line that list it.
    """

    names: tuple[str, ...]
    over: Mapping[str, Range | Values] = field(default_factory=dict)
    cos_theta: Range | None = None
    reading: Reading = field(default_factory=Reading)
    tolerance: float | None = None
    rtol: float | None = None
    effort: str = "normal"
    expect: Known | None = None
    index: int | None = None
    label: str = ""
    place: tuple[str | None, int | None] = (None, None)
    part: bool = False

    @property
    def asked(self) -> dict[str, Any]:
        """All that a verdict depends on besides sources, as plain values."""
        return {
            "names": list(self.names),
            "over": [[name, type(bounds).__name__ == "Values", list(bounds)] for name, bounds in self.over.items()],
            "cos_theta": self.cos_theta and list(self.cos_theta),
            "reading": {key: dict(value) if isinstance(value, Mapping) else value for key, value in vars(self.reading).items()},
            "tolerance": self.tolerance,
            "rtol": self.rtol,
            "effort": self.effort,
        }

    @property
    def command(self) -> str:
        """The command that asks for the same."""
        words = ["brdfcheck", "check", *self.names]
        for name, bounds in self.over.items():
            if isinstance(bounds, Values):
                text = ",".join(map(written, bounds))
            else:
                text = ":".join(map(written, dict.fromkeys(bounds)))
            words += ["--over", f"{name}={text}"]
        words += ["--cos-theta", ":".join(map(written, self.cos_theta))] if self.cos_theta else []
        words += self.reading.command
        words += ["--tolerance", written(self.tolerance)] if self.tolerance is not None else []
        words += ["--rtol", written(self.rtol)] if self.rtol is not None else []
        return shlex.join(words + (["--effort", self.effort] if self.effort != "normal" else []))

    def apart(self) -> list[Request]:
        """A request for each name, where one does not depend on the others: ranges and options must belong to one of them."""
        if len(self.names) < 2 or self.over or not self.reading.is_plain:
            return [self]
        return [replace(self, names=(name,)) for name in self.names]


@dataclass(frozen=True)
class Case:
    """One BRDF of a request: what is to be checked, or the `report` that is known.

    `name`: what reports call it; `file`, `line`: where it is defined, as for `Target`; `entry`: its name in the catalogue, None
    for what is not in it.
    """

    request: Request
    name: str
    file: str | None
    line: int | None
    entry: str | None
    target: Target | None = None
    report: Report | None = None

    @property
    def place(self) -> tuple[str | None, int | None]:
        """The file and line at which to show what is wrong: the BRDF's, or where it is in no file, those that list it.

        What cannot be read for a reason that is in no line of its file is shown where it is listed, too.
        """
        known = self.file is not None and os.path.isfile(self.file)
        listed = self.target is not None and self.target.unread and self.line is None and self.request.place[0] is not None
        return (self.file, self.line) if known and not listed else self.request.place

    @property
    def tolerance(self) -> float:
        """How far above 1 its albedo may lie."""
        if self.report is not None:
            return self.report.tolerance
        assert self.target is not None
        return self.target.family.tolerance if self.request.tolerance is None else self.request.tolerance


def evaluated(case: Case, say: Callable[[str], None]) -> Report:
    """The report on a case: what is known, or `check`; for a user's BRDF, whatever it raises becomes a finding.

    `say` is called with how far the search is.
    """
    if case.report is not None:
        return case.report
    from brdfcheck.brdf.blame import told
    from brdfcheck.verdict.checking import check, unusable

    target, request = case.target, case.request
    assert target is not None

    def watch(points: int, best: float) -> None:
        so_far = f", largest albedo so far {best:.6g}" if math.isfinite(best) else ""
        say(f"{case.name}: {points} points{so_far}")

    began = time.perf_counter()
    options: Any = {"tolerance": case.tolerance, "effort": request.effort}
    if target.unread:
        return replace(unusable(target.family, target.finding or "", **options), unread=True)
    try:
        return check(target, rtol=request.rtol, watch=watch, **options)
    except (Exception, SystemExit) as error:
        if target.file is None:
            raise
        _log.debug("%s cannot be evaluated", case.name, exc_info=True)
        text = f"cannot be evaluated: {told(error)}"
        return unusable(target.family, text, seconds=time.perf_counter() - began, **options)


def cases(request: Request, modules: dict[str, ModuleType] | None = None, *, others_go_on: bool = False) -> list[Case]:
    """The BRDFs of a request, whose files are read now. UsageError, which begins with the request's label.

    `modules`: users' Python files loaded so far, which load only once; `others_go_on`: what cannot be read is a case too, whose
    target is `unread`. What is wrong with the options of several names remains an error.
    """
    from brdfcheck.brdf import catalog
    from brdfcheck.brdf.subject import resolve, unread_target

    how = request.over, request.cos_theta, request.reading, modules
    try:
        targets = resolve(request.names, *how, others_go_on=others_go_on)
    except UsageError as error:
        if others_go_on and len(request.names) == 1:
            targets = [unread_target(request.names[0], error)]
        elif request.label:
            raise UsageError(f"{request.label}: {error}") from error
        else:
            raise
    if request.label:
        targets = [replace(one, finding=f"{request.label}: {one.finding}") if one.unread else one for one in targets]
    found = []
    for target in targets:
        name = target.entry or target.family.name
        entry = name if target.file is None and name in catalog.names() else None
        found.append(Case(request, target.family.name, target.file, target.line, entry, target))
    return found
