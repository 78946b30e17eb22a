"""The pytest plug-in, in sessions of its own."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import matplotlib.figure  # noqa: F401 - sessions in this process forget what they import
import pytest
from test_docs import files

import brdfcheck
import brdfcheck.gate.testing
import brdfcheck.output.curves
import brdfcheck.plots.panels
import brdfcheck.verdict.checking

pytest_plugins = ["pytester"]

PLUGIN = ("-p", "brdfcheck.pytest_plugin")
MINE = """
    from brdfcheck import Lambert

    def matt(k):
        return Lambert(k)

    def bright():
        return Lambert(1.05)

    def one_way(wi, wo):
        return 0.3 * wi[..., 2]
    """
Run = Callable[..., pytest.RunResult]


@pytest.fixture
def session(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs pytest with the plug-in, and no other that happens to be installed, in this process."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    monkeypatch.delitem(sys.modules, "mine", raising=False)  # of other tests
    pytester.makepyfile(mine=MINE)
    return lambda *words: pytester.runpytest_inprocess(*PLUGIN, *words)


@pytest.mark.slow
def test_functions_that_return_a_brdf_or_are_a_family(pytester: pytest.Pytester, session: Run) -> None:
    pytester.makepyfile(
        """
        import pytest
        from mine import bright, matt

        @pytest.fixture
        def scale():
            return 1.02

        @pytest.mark.brdf(over={"k": (0.1, 1)}, effort="quick")
        def test_returned():
            return matt

        @pytest.mark.brdf(over={"k": (0.1, 1)}, effort="quick")
        def test_family(k, scale):
            return matt(k * scale)

        @pytest.mark.brdf(hold={"k": 0.5}, effort="quick")
        @pytest.mark.parametrize("extra", [0.25, 0.75])
        class TestAll:
            def test_method(self, k, extra):
                return matt(k + extra)

        @pytest.mark.brdf(effort="quick")
        def test_named():
            return "mine.py:bright"

        @pytest.mark.brdf(effort="quick", expect={"violates": 1.05000001, "reason": "old scenes"})
        def test_known():
            return bright()

        @pytest.mark.xfail(strict=True)
        @pytest.mark.brdf(effort="quick")
        def test_expected():
            return bright()

        def test_of_another_kind():
            pass
        """
    )
    result = session("-v")
    result.assert_outcomes(passed=4, failed=3, xfailed=1)
    result.stdout.fnmatch_lines(
        [
            "*::test_returned PASSED*",
            "*::test_family[[]k=0.1:1[]] FAILED*",
            "*::TestAll::test_method[[]k=0.5-0.25[]] PASSED*",
            "*::TestAll::test_method[[]k=0.5-0.75[]] FAILED*",
            "*::test_named FAILED*",
            "*::test_known PASSED*",
        ]
    )


def test_a_failure_says_all_there_is_to_say(pytester: pytest.Pytester, session: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    pytester.makepyfile(
        """
        import pytest
        from mine import one_way

        @pytest.mark.brdf(over={"k": (0.5, 1.25)}, effort="quick")
        def test_family(k):
            from mine import matt
            return matt(k)

        def test_fixture(brdfcheck):
            brdfcheck.assert_conserves(one_way, effort="quick")
        """
    )
    # The command must repeat it from where pytest was started, which need not be the root.
    monkeypatch.chdir(pytester.mkdir("below"))
    result = session("--basetemp", str(pytester.path / "base"), "--rootdir", str(pytester.path), "..")
    result.assert_outcomes(failed=2)
    text = result.stdout.str()
    result.stdout.fnmatch_lines(
        [
            "test_family: VIOLATES (*",
            "  largest albedo  1.2500000000 +- * at k=1.25 angle=0 deg",
            "  exceeds 1 for   k=1..1.25",
            "  tolerance       1e-9",
            "  rests on        theorem: *",
            "  picture         *albedo-0.png",
            "  repeat with     pytest '../test_a_failure_says_all_there_is_to_say.py::test_family[[]k=0.5:1.25[]]'",
            ">       brdfcheck.assert_conserves(one_way, effort=*quick*)",
            "*one_way: 1 finding; CONSERVES *",
            "*finding         not reciprocal: * at wi=(*), wo=(*)*",
            "*repeat with     pytest ../*::test_fixture",
        ]
    )
    # A set: where the variable CI is set, pytest's own summary has each failure once more.
    pictures = {Path(line.split()[-1]) for line in text.splitlines() if line.lstrip("E ").startswith("picture")}
    assert len(pictures) == 2
    for picture in pictures:
        assert picture.is_relative_to(pytester.path / "base")
        assert picture.read_bytes().startswith(b"\x89PNG")
    assert "testing.py" not in text  # the plug-in's own frames
    assert "pytest_plugin.py" not in text


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("matt, k=(5, 1)", "UsageError: the range of k is empty: 5 > 1"),
        ("matt", "NoRange: matt: the parameter k must be given a range"),
        ("matt, k=(1, 5), effort='slow'", "ValueError: effort must be one of quick, normal, thorough; got 'slow'"),
        ("3", "TypeError: a BRDF must be callable"),
        ("'gone.py:f'", "UsageError: there is no file 'gone.py'"),
    ],
)
def test_what_is_wrong_with_a_question_is_one_line_below_the_one_that_asks_it(
    pytester: pytest.Pytester, session: Run, call: str, said: str
) -> None:
    pytester.makepyfile(
        f"""
        import brdfcheck as package
        from mine import matt

        def test_fixture(brdfcheck):
            brdfcheck.assert_conserves({call})

        def test_check(brdfcheck):
            brdfcheck.check({call})

        def test_package():
            package.assert_conserves({call})
        """
    )
    result = session("--no-showlocals", "-rN")
    result.assert_outcomes(failed=3)
    lines = [line for line in result.stdout.lines if line.strip()]
    for door in ("brdfcheck.assert_conserves", "brdfcheck.check", "package.assert_conserves"):
        (asked,) = [index for index, line in enumerate(lines) if line == f">       {door}({call})"]
        error = (
            lines[asked + 1].removeprefix("E       ").removeprefix("brdfcheck.messages.").removeprefix("brdfcheck.brdf.family.")
        )
        assert error.startswith(said)
        assert lines[asked + 2].startswith("test_what_is_wrong_with_a_question")


@pytest.mark.parametrize(
    ("marker", "body", "said"),
    [
        ("ovr={}", "return matt", "unknown key 'ovr'; did you mean over?"),
        ("{}", "return matt", "takes keywords"),
        ("over={'k': (2, 1)}", "return matt", "pytest.mark.brdf: over.k: LO must not exceed HI; got (2, 1)"),
        ("effort='quick'", "pass", "must return a BRDF"),
        ("effort='quick'", "return 3", "a BRDF must be callable"),
        ("effort='quick'", "return matt", "the parameter k must be given a range"),
    ],
)
def test_what_is_wrong_with_a_marker_is_one_line(
    pytester: pytest.Pytester, session: Run, marker: str, body: str, said: str
) -> None:
    pytester.makepyfile(f"import pytest\nfrom mine import matt\n\n@pytest.mark.brdf({marker})\ndef test_it():\n    {body}\n")
    result = session()
    result.assert_outcomes(failed=1)
    assert said in result.stdout.str()
    assert "Traceback" not in result.stdout.str()


def test_the_process_stays_as_it_is(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("PYTHONPATH", str(Path(brdfcheck.__file__).parent.parent))
    pytester.makepyfile(mine=MINE)
    pytester.makepyfile(
        """
        import sys, pytest

        def test_nothing_heavy_is_imported():
            heavy = ("jax", "numpy", "pydantic", "matplotlib", "typer", "brdfcheck.gate")
            assert [name for name in heavy if name in sys.modules] == []

        @pytest.mark.brdf(over={"n": (1, 30)}, effort="quick")
        def test_double_precision():
            return "blinn-phong"

        def test_single_precision_is_left():
            import jax, jax.numpy as jnp
            assert jnp.zeros(1).dtype == "float32"
            assert jax.config.jax_compilation_cache_dir is None
        """
    )
    pytester.runpytest_subprocess(*PLUGIN).assert_outcomes(passed=3)


# --- the subjects of a project ---

GATE = """
[[tool.brdfcheck.subjects]]
target = "mine.py:matt"
over = {{ k = {{ values = [0.5, 1] }} }}
effort = "quick"

[[tool.brdfcheck.subjects]]
target = "mine.py:bright"
effort = "quick"
{expect}

[[tool.brdfcheck.subjects]]
target = "shaders/flat.brdf"
cos_theta = [0.5, 0.5]
effort = "quick"

[[tool.brdfcheck.subjects]]
target = "lambert"
"""
FLAT = """analytic
::begin parameters
float k 0 1 0.5
::end parameters
::begin shader
vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y) { return vec3(k / 3.141592653589793); }
::end shader
"""


@pytest.fixture
def project(pytester: pytest.Pytester) -> Callable[[str], None]:
    def project(expect: str = "") -> None:
        (pytester.path / "pyproject.toml").write_text(GATE.format(expect=expect) + "[tool.pytest.ini_options]\n")
        (pytester.path / "shaders").mkdir(exist_ok=True)
        (pytester.path / "shaders" / "flat.brdf").write_text(FLAT)

    return project


def test_subjects_are_tests_in_their_files(pytester: pytest.Pytester, session: Run, project: Callable[[str], None]) -> None:
    project("")
    result = session("-v")
    result.assert_outcomes(passed=3, failed=1)
    result.stdout.fnmatch_lines(
        [
            "mine.py::matt PASSED*",
            "mine.py::bright FAILED*",
            "pyproject.toml::lambert PASSED*",
            "shaders/flat.brdf::flat PASSED*",
            "*  repeat with     brdfcheck check mine.py:bright --effort quick",
        ]
    )
    for words, found in (("shaders",), ["shaders/flat.brdf::flat"]), (("mine.py::matt",), ["mine.py::matt"]):
        lines = session("--collect-only", "-q", *words).stdout.lines
        assert [line for line in lines if "::" in line] == found
    session("-p", "no:brdfcheck.pytest_plugin").assert_outcomes()


def test_a_known_violation_passes_and_warns_when_it_is_out_of_date(
    pytester: pytest.Pytester, session: Run, project: Callable[[str], None]
) -> None:
    project('expect = { violates = 1.05000001, reason = "old scenes" }')
    session("mine.py").assert_outcomes(passed=2)
    project('expect = { violates = 1.5, reason = "old scenes" }')
    result = session("mine.py", "-W", "always")
    result.assert_outcomes(passed=2, warnings=1)
    assert "the known violation is smaller: its largest albedo is 1.05 (known: 1.5)" in result.stdout.str()
    # At the line of the project's file that lists it.
    result.stdout.fnmatch_lines([f"*{pytester.path / 'pyproject.toml'}:7: PytestWarning: *"])


def test_a_whole_file_is_a_test_for_each_of_its_brdfs(pytester: pytest.Pytester, session: Run) -> None:
    pytester.makepyfile(one="def single(wi, wo):\n    return 0.1 + 0 * wi[..., 2]\n", lost="x = y\n")
    subject = '[[subjects]]\ntarget = "{}"\neffort = "quick"\n{}\n'
    known = 'over = { k = [0.5, 1] }\nexpect = { violates = 1.05000001, findings = ["reciprocal"], reason = "old scenes" }'
    (pytester.path / "brdfcheck.toml").write_text(
        subject.format("mine.py:*", known)
        + subject.format("mine.py:bright", "")
        + subject.format("lost.py:*", "")
        + subject.format("one.py:*", "over = { m = [1, 2] }")
    )
    lines = session("--collect-only", "-q").stdout.lines
    assert [line for line in lines if "::" in line] == [
        "lost.py::*", "mine.py::matt", "mine.py::bright", "mine.py::one_way", "mine.py::bright #2", "one.py::single",
    ]  # fmt: skip
    result = session("-v", "-W", "always")
    result.assert_outcomes(passed=3, failed=3, warnings=0)
    result.stdout.fnmatch_lines(
        [
            "lost.py::[*] FAILED*",
            "mine.py::matt PASSED*",
            "mine.py::bright PASSED*",
            "mine.py::one_way PASSED*",
            "mine.py::bright #2 FAILED*",
            "one.py::single FAILED*",
        ]
    )
    assert "cannot import lost.py: line 1: NameError" in result.stdout.str()
    assert "one.py:single has no parameter 'm'" in result.stdout.str()
    for words in (("mine.py::matt",), ("-k", "matt")):
        result = session(*words)
        result.assert_outcomes(passed=1, deselected=0 if "::" in words[0] else 5)


def test_a_project_that_is_wrong_is_said_in_one_line(pytester: pytest.Pytester, session: Run) -> None:
    (pytester.path / "brdfcheck.toml").write_text('[[subjects]]\ntarget = "mine.py:matt"\novr = 3\n')
    result = session()
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert "brdfcheck.toml: subjects[0]: unknown key 'ovr'" in result.stderr.str()
    (pytester.path / "brdfcheck.toml").write_text('[[subjects]]\ntarget = "mine.py:matt"\n')
    result = session()
    result.assert_outcomes(failed=1)
    assert "the parameter k must be given a range" in result.stdout.str()


@pytest.mark.slow
def test_with_xdist(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, project: Callable[[str], None]) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("PYTHONPATH", str(Path(brdfcheck.__file__).parent.parent))
    monkeypatch.setenv("BRDFCHECK_VERDICTS", "1")
    monkeypatch.setenv("BRDFCHECK_CACHE", str(pytester.path / "cache"))
    for name in ("PYTEST_XDIST_WORKER", "PYTEST_XDIST_WORKER_COUNT", "PYTEST_XDIST_TESTRUNUID"):
        monkeypatch.delenv(name, raising=False)
    project("")
    pytester.makepyfile(mine=MINE)
    pytester.makepyfile(
        """
        import pytest

        @pytest.mark.brdf(over={"k": (0.5, 1)}, effort="quick")
        def test_family(k):
            from mine import matt
            return matt(k)
        """
    )
    result = pytester.runpytest_subprocess(*PLUGIN, "-p", "xdist", "-n", "2")
    result.assert_outcomes(passed=4, failed=1)
    # All that is of files that are understood is in the cache now.
    assert len(list((pytester.path / "cache" / "verdicts").glob("??/*.json"))) == 4


@pytest.mark.slow
def test_the_tests_of_the_docs(pytester: pytest.Pytester, session: Run) -> None:
    for name, text in files().items():
        if name in ("mine.py", "test_mine.py"):
            (pytester.path / name).write_text(text)
    session().assert_outcomes(passed=3)


def test_the_entry_point_names_the_plugin() -> None:
    root = Path(brdfcheck.__file__).parent.parent
    points = tomllib.loads((root / "pyproject.toml").read_text())["project"]["entry-points"]["pytest11"]
    assert points == {"brdfcheck": PLUGIN[1]}
