"""What the pytest plug-in does once a test needs it: checks, and says in words and a picture what did not pass.

Everything runs in double precision whatever the process does, and leaves its settings alone.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brdfcheck.brdf.readers.specs import PREFIXES, is_file_spec, split_spec
from brdfcheck.gate.baseline import judged
from brdfcheck.gate.cache import Verdicts
from brdfcheck.gate.config import Gate, find, options_of
from brdfcheck.gate.requests import Case, Request, cases, evaluated
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.brdf.family import Family
    from brdfcheck.verdict import Report

Found = Sequence[tuple["Report", "Family | None"]]


class Failure(AssertionError):
    """BRDFs that did not pass, or what was wrong with the question. `command`: what repeats it, where that is known."""

    def __init__(self, reports: Found, trouble: str = "", command: str | None = None):
        super().__init__(trouble or "\n".join(str(report) for report, _ in reports))
        self._reports, self._trouble, self._command = reports, trouble, command

    def words(self, command: Sequence[str], folder: Path | None) -> str:
        """The message: for each BRDF verdict, place, value, bar, findings, basis; the command; a picture in `folder`."""
        from brdfcheck.verdict import words

        if self._trouble:
            return self._trouble
        lines: list[str] = []
        for index, (report, family) in enumerate(self._reports):
            # What conserves energy has failed by its findings, which the first line must say: it is all that summaries show.
            found = (
                f"{words.plural(len(report.findings), 'finding', 'findings')}; " if report.verdict.name == "CONSERVES" else ""
            )
            lines.append(f"{report.name}: {found}{report.verdict.name} ({words.reason_text(report)})")
            place = words.place_text(report)
            lines.append(f"  largest albedo  {words.albedo_text(report)}{f' at {place}' if place else ''}")
            if interval := words.interval_text(report):
                lines.append(f"  exceeds 1 for   {interval}")
            lines.append(f"  tolerance       {words.exact(report.tolerance)}")
            lines.append(f"  rests on        {words.basis_text(report)}")
            lines += [f"  finding         {one_line(text)}" for text in report.findings]
            lines += [f"  note            {one_line(text)}" for text in report.notes]
            if family is not None and folder is not None and report.basis != "none":
                lines.append(f"  picture         {_picture(report, family, folder / f'albedo-{index}.png')}")
        return "\n".join([*lines, f"  repeat with     {self._command or shlex.join(command)}"])


def _picture(report: Report, family: Family, path: Path) -> str:
    """Draw the albedo against the angle at the worst parameters into a file. Returns its name, or why there is none."""
    from brdfcheck import plots
    from brdfcheck.output import curves

    worst: dict[str, Any] = {name: report.parameters[name] for name in family.ranges if name in report.parameters}
    try:
        with _double(), contextlib.redirect_stdout(None):
            curve = curves.albedo_vs_angle(family, samples=65, **worst)
            figure = plots.figure("albedo-vs-angle", [curve], title=f"{report.name}: {report.verdict.name}")
            path.write_bytes(plots.to_bytes(figure, path.suffix))
    except Exception as error:  # a picture is no reason to fail in another way
        return f"none: {type(error).__name__}: {one_line(error)}"
    return str(path)


def _double() -> contextlib.AbstractContextManager[object]:
    from brdfcheck.runtime import double_precision

    return double_precision()


class Checker:
    """What the fixture gives. `told`: runs something, and words its failure for pytest."""

    def __init__(self, told: Callable[[Callable[[], Any]], Any]):
        self._told = told

    def check(self, brdf: Any, **options: Any) -> Report:
        """`brdfcheck.check`, in double precision."""
        __tracebackhide__ = True
        from brdfcheck.verdict.checking import check

        with _double():
            return check(brdf, **options)

    def assert_conserves(self, brdf: Any, **options: Any) -> Report:
        """`brdfcheck.assert_conserves`: the report, or the test fails."""
        __tracebackhide__ = True
        return self._told(functools.partial(self._asserted, brdf, options))

    def _asserted(self, brdf: Any, options: Mapping[str, Any]) -> Report:
        __tracebackhide__ = True
        from brdfcheck.brdf.subject import as_target

        others = {"cos_theta", "tolerance", "rtol", "intervals", "effort", "watch"}
        ranges = {name: value for name, value in options.items() if name not in others}
        with _double():
            target = as_target(brdf, ranges, options.get("cos_theta"))
        rest = {name: options[name] for name in options.keys() & others - {"cos_theta"}}
        report = self.check(target, **rest)
        if not report.passed:
            raise Failure([(report, target.family)])
        return report


def marked(
    function: Callable[..., Any], arguments: Mapping[str, Any], positional: Sequence[Any], given: Mapping[str, Any]
) -> None:
    """Check what a marked function returns, or the family that it is. `arguments`: values of its fixtures. Failure."""
    from brdfcheck.brdf.signatures import signature_of
    from brdfcheck.brdf.subject import as_target, resolve
    from brdfcheck.brdf.values import by_value

    name = getattr(function, "__name__", "the function")
    try:
        if positional:
            raise UsageError(f'{name}: pytest.mark.brdf takes keywords, as in over={{"n": (1, 100)}}')
        options = options_of(given, f"{name}: pytest.mark.brdf")
        ranges = options.ranges()
        reading = options.reading.reading(name)
        how = None if reading.is_plain else reading
        names = [part for part in inspect.signature(function).parameters if part in arguments]
        own = {part for part in names if part in options.over or part in options.hold}
        fixtures = {part: arguments[part] for part in names if part not in own}
        with _double():
            if own:
                value: Any = functools.partial(function, **fixtures)
                value.__name__ = name
            else:
                value = function(**fixtures)
            if value is None:
                raise UsageError(f"{name} must return a BRDF, as pytest.mark.brdf says; it returned nothing")
            if isinstance(value, str):
                targets = resolve([value], ranges, options.cos_theta, how)
            else:
                known = signature_of(value).names
                targets = by_value(lambda one: [as_target(value, one, options.cos_theta, how)], ranges, known)
    except (UsageError, TypeError) as error:
        raise Failure([], one_line(error)) from error
    expect = None if options.expect == "conserves" else options.expect
    checking = {"tolerance": options.tolerance, "rtol": options.rtol, "effort": options.effort or "normal"}
    request = Request((name,), ranges, expect=expect, **checking)
    found = [Case(request, target.family.name, target.file, target.line, None, target) for target in targets]
    _judge(request, found, None)


def _judge(request: Request, found: Sequence[Case], verdicts: Verdicts | None, command: str | None = None) -> list[str]:
    """What is out of date in the known violation. Failure where a case does not pass."""
    with _double():
        raw = [evaluated(case, lambda text: None) for case in found]
        if verdicts is not None and all(case.report is None for case in found):
            verdicts.keep(request, found, raw)
    reports = judged(raw, request.expect)
    bad = [(report, case) for report, case in zip(reports, found, strict=True) if not report.passed]
    if bad:
        families = {case.name: case.target for case in found}
        if any(target is None for target in families.values()):
            with _double():
                families = {case.name: case.target for case in cases(request)}
        wanted = [(report, target.family if (target := families.get(case.name)) else None) for report, case in bad]
        raise Failure(wanted, command=command)
    return [f"{report.name}: {report.notes[-1]}" for report in reports if report.stale]


@dataclass(frozen=True)
class Subjects:
    """The subjects of a project: `files` has those of each file; `modules`: users' Python files loaded so far."""

    gate: Gate
    files: Mapping[str, Sequence[Request]]
    verdicts: Verdicts
    folder: Path
    modules: dict[str, Any] = field(default_factory=dict)

    def tests(self, file: str) -> dict[str, Request]:
        """The subjects of a file by the names of their tests: the BRDF's own, in ``file.py:*`` of each that the file offers.

        For these the file is imported, as pytest imports the files of other tests; where that fails one test says so.
        """
        found: dict[str, Request] = {}
        for subject in self.files[file]:
            for request in self._each(subject) if subject.names[0].endswith(":*") else [subject]:
                path, part = split_spec(request.names[0])
                name = (part or Path(path).stem) if _in_a_file(request.names[0]) else request.names[0]
                count = sum(other.partition(" #")[0] == name for other in found)
                found[f"{name} #{count + 1}" if count else name] = request
        return found

    def _each(self, subject: Request) -> list[Request]:
        """A request for each BRDF of a file, with the ranges of its parameters; the subject itself where it cannot be read."""
        from brdfcheck.brdf.signatures import signature_of
        from brdfcheck.brdf.subject import named, spread

        try:
            with contextlib.chdir(self.folder), _double():
                names = spread(subject.names[0], self.modules)
                signatures = [signature_of(named(name, self.modules)[0], subject.over) for name in names]
        except UsageError:
            return [subject]
        # A parameter of none of them is a mistake, which each of them tells.
        shared = {name for signature in signatures for name in signature.names}
        found = []
        for name, own in zip(names, signatures, strict=True):
            over = {key: bounds for key, bounds in subject.over.items() if key in own.names or own.open or key not in shared}
            found.append(replace(subject, names=(name,), over=over))
        return found

    def check(self, request: Request) -> list[str]:
        """What is out of date in the known violation of a subject. Failure where it does not pass.

        What is known of a whole file need be found in one of its BRDFs only, so that one by itself does not say.
        """
        with contextlib.chdir(self.folder):
            try:
                with _double():
                    found = self.verdicts.found(request) or cases(request, self.modules)
            except UsageError as error:
                raise Failure([], one_line(error)) from error
            stale = _judge(request, found, self.verdicts, request.command)
            return stale if any(request is one for own in self.files.values() for one in own) else []


def _in_a_file(target: str) -> bool:
    return is_file_spec(target) and not target.startswith(PREFIXES)


def subjects(root: Path, cache: bool) -> Subjects | None:
    """The subjects of the project in `root`. UsageError where its file is wrong."""
    gate = find(root)
    if gate is None:
        return None
    files: dict[str, list[Request]] = {}
    for request in gate.requests():
        (target,) = request.names
        path = split_spec(target)[0] if _in_a_file(target) else str(gate.path)
        files.setdefault(os.path.realpath(path), []).append(request)
    return Subjects(gate, files, Verdicts(cache and gate.document.cache), Path.cwd())
