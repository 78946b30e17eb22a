"""The subjects of a project: ``[tool.brdfcheck]`` of pyproject.toml, or brdfcheck.toml, which has the same without that prefix.

    [tool.brdfcheck]
    effort = "quick"                        # optional, for all subjects: effort, tolerance, rtol, cache

    [[tool.brdfcheck.subjects]]
    target = "mine.py:glossy"               # what `brdfcheck check` takes; files as seen from this one
    over = { n = [1, 200] }                 # ranges; { values = [1, 10, 100] } checks each value by itself
    hold = { ks = 0.5 }                     # values; of a vector a list
    cos_theta = [0.1, 1]                    # and tolerance, rtol, effort, reading = { returns = "brdf*cos" }
    expect = { violates = 1.0752, reason = "kept for old scenes" }     # by default "conserves"

What is wrong with the file is a `UsageError` in one line that names the place, the value and what is allowed. Imports nothing
that is heavy.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Strict,
    StringConstraints,
    Tag,
    field_validator,
    model_validator,
)

from brdfcheck.brdf.readers.specs import PREFIXES, is_file_spec, split_spec
from brdfcheck.brdf.readers.table import ReadingTable, beside
from brdfcheck.brdf.values import Range, Values, components
from brdfcheck.documents import Model, read_document, read_text, shown, validated
from brdfcheck.gate.requests import Request
from brdfcheck.messages import UsageError
from brdfcheck.verdict.checks import CHECKS, TOLD

OWN, SHARED = "brdfcheck.toml", "pyproject.toml"
"""Where the subjects of a project are looked for, in this order."""


def _rising(bounds: Range) -> Range:
    if bounds[0] > bounds[1]:
        raise ValueError("LO must not exceed HI")
    return bounds


_Bounds = Annotated[tuple[float, float], Strict(False), AfterValidator(_rising)]
_Numbers = Annotated[list[float], Strict(False)]
_Tolerance = Annotated[float, Field(ge=0, le=0.5)]
_Rtol = Annotated[float, Field(ge=1e-16, le=0.5)]
_Effort = Literal["quick", "normal", "thorough"]
OTHER = "other"
"""What a finding is called that comes from no check by name."""


def _finding(name: Any) -> Any:
    """The name, if it is that of a check that can fail, or `OTHER`."""
    names = [*(check for check in CHECKS if check not in TOLD), OTHER]
    if name not in names:
        raise ValueError(f"must be one of {', '.join(map(repr, names[:-1]))} or {OTHER!r}")
    return name


class Each(Model):
    """Values of a parameter that are checked one by one."""

    values: Annotated[_Numbers, Field(min_length=1, max_length=1000)]


class Known(Model):
    """A violation that is accepted: how large it may be, the findings that may come with it, and why.

    `violates`: the largest albedo, ``inf`` where it grows without bound; `undecided`: no verdict is accepted too; `findings`:
    names of checks that may fail, as reports have them.
    """

    violates: float | None = Field(None, gt=1, allow_inf_nan=True)
    undecided: bool = False
    findings: list[Annotated[str, BeforeValidator(_finding)]] = []  # noqa: RUF012 - pydantic copies it
    reason: Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]

    @model_validator(mode="after")
    def _something(self) -> Known:
        if self.violates is None and not self.undecided and not self.findings:
            raise ValueError("must say what is accepted: violates = ALBEDO, undecided = true or findings = [CHECK, ...]")
        return self


def _like(words: str, *fits: Callable[[Any], bool]) -> BeforeValidator:
    """Refuses what none of these fits, with `words`: of alternatives pydantic would name but one."""

    def checked(given: Any) -> Any:
        if not any(fit(given) for fit in fits):
            raise ValueError(words)
        return given

    return BeforeValidator(checked)


def _is_table(given: Any) -> bool:
    return isinstance(given, Mapping | Model)


def _is_list(least: int, most: int) -> Callable[[Any], bool]:
    return lambda given: isinstance(given, list | tuple) and least <= len(given) <= most


_Over = Annotated[
    Annotated[Each, Tag("table")] | Annotated[_Bounds, Tag("list")],
    Discriminator(lambda given: "table" if _is_table(given) else "list"),
    _like("must be a range [LO, HI], or { values = [...] }; one value is for hold", _is_table, _is_list(2, 2)),
]
_Held = Annotated[
    Annotated[bool, Tag("bool")] | Annotated[float, Tag("number")] | Annotated[_Numbers, Tag("list")],
    Discriminator(lambda given: "bool" if isinstance(given, bool) else "list" if isinstance(given, list | tuple) else "number"),
    _like(
        "must be a number, true or false, or the 2 to 4 components of a vector",
        lambda given: isinstance(given, bool | int | float),
        _is_list(2, 4),
    ),
]
_Expected = Annotated[
    Annotated[Known, Tag("table")] | Annotated[Literal["conserves"], Tag("text")],
    Discriminator(lambda given: "table" if _is_table(given) else "text"),
    _like('must be "conserves" or { violates = ALBEDO, reason = "..." }', _is_table, lambda given: given == "conserves"),
]


class Options(Model):
    """How a BRDF is checked: what a subject and the marker of pytest say of one."""

    over: dict[str, _Over] = {}  # noqa: RUF012
    hold: dict[str, _Held] = {}  # noqa: RUF012
    cos_theta: _Bounds | None = None
    tolerance: _Tolerance | None = None
    rtol: _Rtol | None = None
    effort: _Effort | None = None
    reading: ReadingTable = ReadingTable()
    expect: _Expected = "conserves"

    @field_validator("cos_theta")
    @classmethod
    def _cosines(cls, bounds: Range | None) -> Range | None:
        if bounds is not None and not (bounds[0] >= 0 and bounds[1] <= 1):
            raise ValueError("must run within 0 and 1")
        return bounds

    @model_validator(mode="after")
    def _once(self) -> Options:
        for name in self.over:
            if name in self.hold:
                raise ValueError(f"{name} is both in over and in hold")
        return self

    def ranges(self) -> dict[str, Range | Values]:
        """What parameters run over, as `brdfcheck.brdf.subject.resolve` takes it."""
        found: dict[str, Range | Values] = {}
        for name, bounds in self.over.items():
            found[name] = Values(bounds.values) if isinstance(bounds, Each) else bounds
        for name, value in self.hold.items():
            if isinstance(value, list):
                found |= components(name, value)
            else:
                found[name] = (float(value), float(value))
        return found


class Subject(Options):
    """A BRDF of the project."""

    target: str = Field(min_length=1)


class Document(Model):
    """All that a project says."""

    subjects: Annotated[list[Subject], Strict(False), Field(min_length=1)]
    tolerance: _Tolerance | None = None
    rtol: _Rtol | None = None
    effort: _Effort | None = None
    cache: bool = True


@dataclass(frozen=True)
class Gate:
    """The subjects of a project. `path`: the file that says so; `prefix`: the table in it."""

    path: Path
    document: Document
    prefix: tuple[str, ...] = field(default=())

    def requests(self, **given: Any) -> list[Request]:
        """What is to be checked, in the order of the file; `given`: tolerance, rtol, effort, which go before the file's."""
        folder = self.path.parent
        text, _ = read_text(self.path)
        lines = [text.count("\n", 0, start) + 1 for start in self.heads(text)]
        if len(lines) != len(self.document.subjects):  # written in another way: in one list, say
            lines = [1] * len(self.document.subjects)
        found = []
        for index, (subject, line) in enumerate(zip(self.document.subjects, lines, strict=True)):
            label = f"{self.path.name}: subjects[{index}]"
            options: dict[str, Any] = {}
            for key in ("tolerance", "rtol", "effort"):
                said = (given.get(key), getattr(subject, key), getattr(self.document, key))
                options[key] = next((value for value in said if value is not None), None)
            options["effort"] = options["effort"] or "normal"
            reading = beside(subject.reading.reading(label), _near(folder))
            expect = None if subject.expect == "conserves" else subject.expect
            found.append(
                Request(
                    (placed(subject.target, folder),),
                    subject.ranges(),
                    subject.cos_theta,
                    reading,
                    **options,
                    expect=expect,
                    index=index,
                    label=label,
                    place=(os.path.relpath(self.path), line),
                )
            )
        return found

    def heads(self, text: str) -> list[int]:
        """Where the ``[[subjects]]`` end in the text of the file."""
        name = r"\.".join((*self.prefix, "subjects"))
        return [match.end() for match in re.finditer(rf"^[ \t]*\[\[[ \t]*{name}[ \t]*\]\][^\n]*$", text, re.M)]


def _near(folder: Path) -> Path:
    """The folder as seen from here."""
    return Path(os.path.relpath(folder))


def placed(target: str, folder: Path) -> str:
    """A target as seen from here; its file is meant as seen from `folder`."""
    if target.startswith("mitsuba:") and ".xml" in target:
        return f"mitsuba:{os.path.relpath(folder / target.removeprefix('mitsuba:'))}"
    if target.startswith(PREFIXES) or not is_file_spec(target):
        return target
    path, name = split_spec(target)
    near = path if os.path.isabs(path) else os.path.relpath(folder / path)
    return near if name is None else f"{near}:{name}"


def read(path: str | Path) -> Gate | None:
    """What a file says of subjects; None for a pyproject.toml that says nothing. UsageError where it is wrong."""
    document, label = read_document(path)
    prefix: tuple[str, ...] = ()
    if Path(path).name == SHARED:
        prefix = ("tool", "brdfcheck")
        for key in prefix:
            document = document.get(key, {})
            if not isinstance(document, dict):
                raise UsageError(f"{label}: {key} must be a table; got {shown(document)}")
        if not document:
            return None
        label = f"{label}: [tool.brdfcheck]"
    return Gate(Path(path).resolve(), validated(Document, document, label), prefix)


def find(folder: Path | None = None) -> Gate | None:
    """The subjects of the project that `folder` (by default the current one) is in: of the nearest file up to its root.

    The root is where there is a .git. UsageError where the file is wrong, and where two files of one folder list subjects.
    """
    folder = Path.cwd() if folder is None else folder
    for here in (folder, *folder.parents):
        found = [gate for name in (OWN, SHARED) if (here / name).is_file() and (gate := read(_near(here) / name)) is not None]
        if len(found) > 1:
            raise UsageError(f"{OWN} and {SHARED} both list BRDFs: put them into one of the two, or choose one with --config")
        if found:
            return found[0]
        if (here / ".git").exists():
            break
    return None


def options_of(given: Mapping[str, Any], label: str) -> Options:
    """Options from Python, where ranges are tuples. UsageError, which begins with `label`, where they are wrong."""
    rest = {key: value for key, value in given.items() if key != "returns"}
    if "returns" in given:
        rest["reading"] = {"returns": given["returns"]}
    return validated(Options, rest, label)
