"""The pytest plug-in: BRDFs as tests.

``@pytest.mark.brdf(over={"n": (1, 1000)})`` on a function that returns a BRDF, or that is a family in the parameters that
`over` names; the fixture ``brdfcheck`` with ``brdfcheck.assert_conserves(f, n=(1, 1000))``; and the subjects of the project's
pyproject.toml or brdfcheck.toml (`brdfcheck.gate.config`) as tests in their files.

Imports nothing but pytest: what checks is imported by the first test that needs it. It changes no setting of the process.
"""

from __future__ import annotations

import inspect
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from brdfcheck.gate.requests import Request
    from brdfcheck.gate.testing import Checker, Subjects

_SUBJECTS = pytest.StashKey["Subjects | None"]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option of the plug-in."""
    group = parser.getgroup("brdfcheck", "energy conservation of BRDFs")
    group.addoption("--brdfcheck-no-cache", action="store_true", help="check BRDFs of the project again that have not changed")


def pytest_configure(config: pytest.Config) -> None:
    """The marker."""
    config.addinivalue_line(
        "markers",
        "brdf(over, hold, cos_theta, tolerance, rtol, effort, returns, expect): the function returns a BRDF, which must"
        " conserve energy while parameters run over the ranges in over; those that are arguments of the function are its own",
    )


# --- functions ---


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Parameters of a family are arguments that no fixture has to give."""
    marker = metafunc.definition.get_closest_marker("brdf")
    for key in ("over", "hold") if marker is not None else ():
        given = marker.kwargs.get(key) if marker is not None else None
        for name, bounds in given.items() if isinstance(given, dict) else ():
            if name in inspect.signature(metafunc.function).parameters:
                parts = bounds if isinstance(bounds, tuple | list) else [bounds]
                metafunc.parametrize(name, [None], ids=[f"{name}={':'.join(map(str, parts))}"])


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """What a marked function returns is checked."""
    marker = pyfuncitem.get_closest_marker("brdf")
    if marker is None:
        return None
    from brdfcheck.gate import testing

    _told(pyfuncitem, lambda: testing.marked(pyfuncitem.obj, pyfuncitem.funcargs, marker.args, marker.kwargs))
    return True


@pytest.fixture(name="brdfcheck")
def _checker(request: pytest.FixtureRequest) -> Checker:
    """`assert_conserves(brdf, n=(1, 1000), ...)` and `check(...)`, as those of the package, in double precision.

    Where it fails, the message has the command that repeats it and a picture.
    """
    from brdfcheck.gate.testing import Checker

    def told(work: Any) -> Any:
        __tracebackhide__ = True  # the line that matters is the test's
        return _told(request.node, work, trace=True)

    return Checker(told)


def _told(item: pytest.Item, work: Any, *, trace: bool = False) -> Any:
    """What `work` returns; where it fails, the words of the failure, with the command and the picture.

    `trace`: with the line of the test that called it.
    """
    from brdfcheck.gate.testing import Failure

    __tracebackhide__ = True
    try:
        return work()
    except Failure as failure:
        # The id of a test begins with its file as seen from the root, from which pytest need not have been started.
        file = os.path.relpath(item.path, item.config.invocation_params.dir)
        words = failure.words(["pytest", f"{file}::{item.nodeid.partition('::')[2]}"], _folder(item))
    pytest.fail(words, pytrace=trace)


def _folder(item: pytest.Item) -> Path | None:
    """A new folder below pytest's temporary one, for pictures."""
    factory = getattr(item.config, "_tmp_path_factory", None)
    return None if factory is None else factory.mktemp("brdfcheck")


# --- the subjects of the project ---


def _subjects(config: pytest.Config) -> Subjects | None:
    """The subjects of the project whose root is pytest's; None where it says nothing of BRDFs."""
    if _SUBJECTS not in config.stash:
        root = config.rootpath
        shared = root / "pyproject.toml"
        named = (root / "brdfcheck.toml").is_file() or (shared.is_file() and b"tool.brdfcheck" in shared.read_bytes())
        config.stash[_SUBJECTS] = None
        if named:
            from brdfcheck.gate.testing import subjects
            from brdfcheck.messages import UsageError

            try:
                config.stash[_SUBJECTS] = subjects(root, not config.getoption("--brdfcheck-no-cache"))
            except UsageError as error:
                raise pytest.UsageError(f"brdfcheck: {error}") from None
    return config.stash[_SUBJECTS]


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """What is wrong with the project's file is said before anything is collected."""
    _subjects(session.config)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """The subjects in a file, or for the project's own file those in none."""
    found = _subjects(parent.config)
    if found is None or os.path.realpath(file_path) not in found.files:
        return None
    return _File.from_parent(parent, path=file_path)


class _File(pytest.File):
    """A file that holds subjects, or lists those that are in none."""

    def collect(self) -> Iterator[pytest.Item]:
        found = _subjects(self.config)
        for name, request in found.tests(os.path.realpath(self.path)).items() if found is not None else ():
            yield _Subject.from_parent(self, name=name, request=request)


class _Subject(pytest.Item):
    """A subject of the project. It passes where its BRDFs conserve energy, or violate it as is known."""

    def __init__(self, *, request: Request, **options: Any):
        super().__init__(**options)
        self._asked = request

    def runtest(self) -> None:
        found = _subjects(self.config)
        assert found is not None

        def work() -> None:
            file, line = self._asked.place
            for text in found.check(self._asked):
                # At the entry that is out of date, and not where the BRDF is.
                where = str(Path(found.folder, file)) if file is not None else str(self.path)
                warnings.warn_explicit(pytest.PytestWarning(text), None, where, line or 1)

        _told(self, work)

    def reportinfo(self) -> tuple[Path, int, str]:
        return self.path, 0, f"brdfcheck: {self.name}"
