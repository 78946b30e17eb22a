"""The subjects of a project, known violations, and the cache of verdicts."""

from __future__ import annotations

import importlib
import json
import os
import sys
import textwrap
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import pytest

import brdfcheck
from brdfcheck.brdf import catalog
from brdfcheck.cli import ExitCode, project
from brdfcheck.gate import cache, config, sources
from brdfcheck.gate.baseline import judged, needed, updated
from brdfcheck.gate.config import Known
from brdfcheck.gate.requests import Case, Request, cases
from brdfcheck.messages import UsageError
from brdfcheck.output.records import plain

Run = Callable[..., tuple[int, str, str]]
Write = Callable[..., Path]

MINE = """
    from brdfcheck import Lambert
    from gray_of_mine import GRAY

    def matt(k):
        return Lambert(GRAY * k)

    def bright():
        return Lambert(1.05)

    _hidden = 3
    """
GATE = """
    effort = "quick"        # for all

    [[subjects]]
    target = "mine.py:matt"
    over = { k = { values = [0.25, 1] } }

    # why it is bright
    [[subjects]]
    target = "mine.py:bright"
    [[subjects]]
    target = "lambert"
    """


@pytest.fixture
def write(here: Path) -> Write:
    """Writes a file into the test's folder."""

    def write(name: str, text: str) -> Path:
        path = here / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(textwrap.dedent(text))
        return path

    write("mine.py", MINE)
    write("gray_of_mine.py", "GRAY = 0.5\n")
    forget("gray_of_mine")
    return write


def forget(module: str) -> None:
    """As in a new process: the module is imported again."""
    sys.modules.pop(module, None)


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], list[Path]]]:
    """Verdicts are kept in a folder of their own; lists them. JAX is as users have it."""
    monkeypatch.setenv("BRDFCHECK_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv(cache.SWITCH)
    jax.config.update("jax_numpy_dtype_promotion", "standard")
    yield lambda: sorted((tmp_path / "cache" / "verdicts").glob("??/*.json"))
    jax.config.update("jax_numpy_dtype_promotion", "strict")


# --- the file ---


def test_the_subjects_are_checked_where_no_name_is_given(run: Run, write: Write, here: Path) -> None:
    write("brdfcheck.toml", GATE)
    code, out, _ = run("check", "--json", "found.json")
    assert code == ExitCode.FAILED
    found = json.loads((here / "found.json").read_text())
    assert [result["name"] for result in found["results"]] == [
        "mine.py:matt k=0.25", "mine.py:matt k=1", "mine.py:bright", "lambert",
    ]  # fmt: skip
    assert [float(result["albedo"]) for result in found["results"]] == pytest.approx([0.125, 0.5, 1.05, 1.0])
    assert {result["effort"] for result in found["results"]} == {"quick"}
    assert [(result.get("file"), result.get("line")) for result in found["results"]] == [
        ("mine.py", 5), ("mine.py", 5), ("mine.py", 8), (None, None),
    ]  # fmt: skip
    assert "3 conserve, 1 violates" in out
    assert run("check", "-k", "matt")[0] == ExitCode.PASSED
    code, out, _ = run("check", "--no-config", "-k", "lambert")
    assert code == ExitCode.PASSED
    assert "1 conserves" in out


def test_a_project_is_found_from_its_folders(write: Write, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write("pyproject.toml", '[project]\nname = "x"\n')
    write("deep/er/x", "")
    monkeypatch.chdir(here / "deep" / "er")
    (here / ".git").mkdir()
    assert config.find() is None
    write("pyproject.toml", '[[tool.brdfcheck.subjects]]\ntarget = "mine.py:bright"\n')
    found = config.find()
    assert found is not None
    assert found.requests()[0].names == (os.path.join("..", "..", "mine.py:bright"),)
    (here / "deep" / ".git").mkdir()
    assert config.find() is None


def test_what_a_subject_says_is_what_is_asked(write: Write) -> None:
    write(
        "brdfcheck.toml",
        """
        tolerance = 1e-6
        [[subjects]]
        target = "a/shader.glsl:f"
        over = { n = [1, 5] }
        hold = { ks = [1, 0.5, 0.2], on = true, m = 3 }
        cos_theta = [0.1, 1]
        effort = "thorough"
        reading = { returns = "brdf*cos", args = "N,L,V", folders = ["inc"] }
        """,
    )
    found = config.find()
    assert found is not None
    (request,) = found.requests(tolerance=1e-3)
    ranges = {"n": (1, 5), "ks.r": (1, 1), "ks.g": (0.5, 0.5), "ks.b": (0.2, 0.2), "on": (1, 1), "m": (3, 3)}
    assert dict(request.over) == ranges
    assert (request.tolerance, request.effort, request.cos_theta) == (1e-3, "thorough", (0.1, 1))
    assert found.requests()[0].tolerance == 1e-6
    assert request.command == (
        "brdfcheck check a/shader.glsl:f --over n=1:5 --over ks.r=1 --over ks.g=0.5 --over ks.b=0.2 --over on=1 --over m=3"
        " --cos-theta 0.1:1 -I inc --args N,L,V --returns 'brdf*cos' --tolerance 0.001 --effort thorough"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "subjects: is missing"),
        ("subjects = []", "subjects: must have at least 1 entries"),
        ('[[subjects]]\ntarget = "a.py:f"\novr = {}', "unknown key 'ovr'; did you mean over?"),
        ('[[subjects]]\ntarget = "a.py:f"\nover = { n = [3, 1] }', "n: LO must not exceed HI"),
        ('[[subjects]]\ntarget = "a.py:f"\nover = { n = [1, 3] }\nhold = { n = 1 }', "n is both in over and in hold"),
        ('[[subjects]]\ntarget = "a.py:f"\ncos_theta = [0, 2]', "must run within 0 and 1"),
        ('[[subjects]]\ntarget = "a.py:f"\nexpect = { violates = 1.1 }', "reason: is missing"),
        ('[[subjects]]\ntarget = "a.py:f"\nexpect = { reason = "so" }', "must say what is accepted"),
        ('[[subjects]]\ntarget = "a.py:f"\neffort = "slow"', "must be one of 'quick', 'normal' or 'thorough'; got 'slow'"),
        ('[[subjects]]\ntarget = "gone.py:f"', "there is no file 'gone.py'"),
        ('[[subjects]]\ntarget = "mine.py:matt"', "the parameter k must be given a range"),
        ("][", "is not TOML"),
    ],
)
def test_4_with_one_line_for_what_is_wrong(run: Run, write: Write, text: str, said: str) -> None:
    write("brdfcheck.toml", text)
    code, out, err = run("check")
    assert (code, out) == (ExitCode.USAGE_ERROR, "")
    assert said in err
    assert err.startswith("brdfcheck: brdfcheck.toml")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--over", "n=1"], "--over: without names the subjects of brdfcheck.toml are checked"),
        (["--config", "brdfcheck.toml", "--no-config"], "cannot go together"),
        (["lambert", "--config", "brdfcheck.toml"], "give no names"),
        (["lambert", "--update-baseline"], "give no names"),
        (["--no-config", "--update-baseline"], "there is none"),
        (["--config", "gone.toml"], "there is no file 'gone.toml'"),
        (["--no-config", "--watch"], "are in no file"),
    ],
)
def test_4_for_options_that_do_not_go_together(run: Run, write: Write, words: list[str], said: str) -> None:
    write("brdfcheck.toml", GATE)
    code, _, err = run("check", *words)
    assert code == ExitCode.USAGE_ERROR
    assert said in err


# --- lists and whole files ---


def test_a_list_of_values_and_a_whole_file(run: Run, write: Write, here: Path) -> None:
    code, _, _ = run("check", "mine.py:*", "--over", "k=0.5,1,2", "--effort", "quick", "--json", "found.json")
    assert code == ExitCode.FAILED
    names = [result["name"] for result in json.loads((here / "found.json").read_text())["results"]]
    assert names == ["mine.py:matt k=0.5", "mine.py:bright", "mine.py:matt k=1", "mine.py:matt k=2"]
    write("mine.py", MINE + '    __all__ = ["matt"]\n')
    assert "bright" not in run("check", "mine.py:*", "--over", "k=1")[1]
    write("none.py", "x = 3\n")
    assert "none.py:*: it defines no public callable" in run("check", "none.py:*")[2]
    assert "only Python files are taken whole" in run("check", "none.glsl:*")[2]


def test_a_list_for_a_vector_is_its_components(run: Run, write: Write, here: Path) -> None:
    write("flat.glsl", "uniform vec3 ks; uniform float n;\nvec3 f(vec3 L, vec3 V) { return ks * n / 3.141592653589793; }\n")
    words = ("--over", "ks=0.3,0.2,0.1", "--over", "n=1,2", "--effort", "quick", "--json", "found.json")
    assert run("check", "flat.glsl:f", *words)[0] == ExitCode.PASSED
    found = json.loads((here / "found.json").read_text())["results"]
    assert [(result["name"], round(result["albedo"], 9)) for result in found] == [
        ("flat.glsl:f n=1", 0.3),
        ("flat.glsl:f n=2", 0.6),
    ]
    assert "ks: a vector has at most 4 components; got 5" in run("check", "flat.glsl:f", "--over", "ks=1,1,1,1,1")[2]


def test_a_class_of_this_package_has_an_origin(run: Run, here: Path) -> None:
    assert run("check", "Lambert", "--over", "reflectance=0.5,1", "--json", "found.json")[0] == ExitCode.PASSED
    found = json.loads((here / "found.json").read_text())["results"]
    assert [result["origin"] for result in found] == ["name", "name"]


def test_quiet_says_only_what_does_not_pass(run: Run, write: Write) -> None:
    write("brdfcheck.toml", GATE)
    assert run("check", "-q", "-k", "matt") == (ExitCode.PASSED, "", "")
    code, out, err = run("check", "--quiet")
    assert code == ExitCode.FAILED
    assert err == ""
    assert [line.split()[0] for line in out.splitlines()] == ["mine.py:bright", "3"]


# --- known violations ---


@pytest.fixture(scope="module")
def reports() -> dict[str, Any]:
    return {
        "bright": brdfcheck.check(brdfcheck.Lambert(1.05), effort="quick"),
        "matt": brdfcheck.check(brdfcheck.Lambert(0.5), effort="quick"),
        "one_way": brdfcheck.check("phong-classical", n=(5, 5), effort="quick"),
    }


def known(**given: Any) -> Known:
    return Known(**given, reason="so it is")


def test_a_known_violation_passes_until_it_is_worse_or_gone(reports: dict[str, Any]) -> None:
    bright, matt = reports["bright"], reports["matt"]
    assert not judged(bright, None).passed
    same = judged(bright, known(violates=1.05))
    assert same.passed
    assert (same.known, same.stale) == ("so it is", False)
    worse = judged(bright, known(violates=1.04))
    assert not worse.passed
    assert "does not cover an albedo of 1.05 (known: 1.04)" in worse.notes[-1]
    less = judged(bright, known(violates=1.06))
    assert less.passed
    assert less.stale
    assert "smaller: its largest albedo is 1.05 (known: 1.06)" in less.notes[-1]
    gone = judged(matt, known(violates=1.05))
    assert gone.passed
    assert (gone.known, gone.stale) == (None, True)
    assert "the known violation is gone: it conserves energy" in gone.notes[-1]
    assert not judged(replace(bright, basis="none"), known(violates=2.0)).passed


def test_known_findings_are_known_by_their_names(reports: dict[str, Any]) -> None:
    report = reports["one_way"]
    assert [check.name for check in report.checks if not check.passed] == ["reciprocal"]
    assert not judged(report, known(violates=100.0)).passed
    assert judged(report, known(violates=100.0, findings=["reciprocal"])).passed
    extra = judged(report, known(violates=100.0, findings=["reciprocal", "positive"]))
    assert extra.passed
    assert "no finding 'positive'" in extra.notes[-1]


def test_the_baseline_is_written_and_taken_away(run: Run, write: Write, here: Path) -> None:
    path = write("brdfcheck.toml", GATE)
    before = path.read_text()
    code, out, _ = run("check", "--update-baseline")
    assert code == ExitCode.PASSED
    assert "brdfcheck.toml: 1 known, 1 changed" in out
    found = tomllib.loads(path.read_text())["subjects"][1]["expect"]
    assert found["violates"] == pytest.approx(1.05, abs=1e-9)
    assert found["violates"] >= 1.05
    (line,) = [line for line in path.read_text().splitlines() if line.startswith("expect")]
    assert path.read_text().replace(line + "\n", "") == before
    path.write_text(path.read_text().replace(found["reason"], "old scenes"))
    code, out, _ = run("check")
    assert code == ExitCode.PASSED
    assert "known: old scenes" in out
    assert "1 violates, 0 undecided, 1 known" in out
    write("mine.py", MINE.replace("1.05", "0.95"))
    code, out, _ = run("check", "-q")
    assert code == ExitCode.PASSED
    assert "the known violation is gone" in out
    assert "1 baseline entry out of date" in out
    assert run("check", "--update-baseline")[0] == ExitCode.PASSED
    assert path.read_text() == before


def test_a_stale_entry_is_a_warning_on_github(run: Run, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    write("brdfcheck.toml", '[[subjects]]\ntarget = "mine.py:bright"\nexpect = { violates = 2, reason = "so" }\n')
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    code, out, _ = run("check")
    assert code == ExitCode.PASSED
    assert "::warning file=mine.py,line=8,title=brdfcheck%3A mine.py%3Abright::the known violation is smaller" in out


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('x = """\n[[subjects]]\n"""\n', ""),
        ('subjects = [{ target = "lambert" }, { target = "phong" }]\n', "lambert"),
    ],
)
def test_a_file_that_cannot_be_edited_is_left_alone(write: Write, text: str, name: str) -> None:
    path = write("pyproject.toml", f"[tool.brdfcheck]\n{text}" if name else f'{text}[[tool.brdfcheck.subjects]]\ntarget="a"\n')
    gate = config.read(path)
    assert gate is not None
    if name:
        with pytest.raises(UsageError, match=f"change the subjects yourself, of {name}: expect = {{ violates = 1.5, reason"):
            updated(gate, {0: known(violates=1.5)})
    else:
        assert tomllib.loads(updated(gate, {0: known(violates=1.5)}))["x"] == "[[subjects]]\n"


def test_what_is_needed_holds_every_report_of_a_subject(reports: dict[str, Any]) -> None:
    found = needed(list(reports.values()), None)
    assert found is not None
    assert found.violates == pytest.approx(reports["one_way"].albedo)
    assert found.findings == ["reciprocal"]
    assert needed([reports["matt"]], found) is None
    assert needed([reports["bright"]], known(violates=3)).reason == "so it is"  # pyright: ignore[reportOptionalMemberAccess]
    for report in reports.values():
        assert judged(report, found).passed


# --- sources ---


def doubt(text: str, write: Write) -> str:
    write("other.py", text)
    try:
        sources.sources(["other.py:f"])
    except sources.Doubt as found:
        return str(found)
    return ""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import math, numpy as np\nfrom jax import numpy as jnp\nx = np.pi", ""),
        ("from gray_of_mine import GRAY", ""),
        ("import os", "imports os"),
        ("def f():\n    import random", "random"),
        ("import numpy as np\nx = np.random.rand()", "uses random"),
        ("import numpy as np\nx = np.load('lut.npy')", "uses load"),
        ("from numpy import load as get", "uses load"),
        ("x = open('lut.txt')", "uses open"),
        ("import jax\njax.config.update('jax_debug_nans', True)", "uses config"),
        ("x = exec", "uses exec"),
        ("import my_installed_package", "imports my_installed_package, which is not beside it"),
        ("def f(:", "is not Python"),
    ],
)
def test_a_file_that_reaches_further_is_in_doubt(write: Write, text: str, said: str) -> None:
    found = doubt(text, write)
    assert said in found
    assert bool(said) == bool(found)


def test_neighbours_count_to_any_depth(write: Write, here: Path) -> None:
    write("pkg_of_mine/__init__.py", "from .deep import x\n")
    write("pkg_of_mine/deep.py", "from last_of_mine import x\n")
    write("last_of_mine.py", "x = 1\n")
    write("other.py", "import pkg_of_mine\n")
    assert set(sources.sources(["other.py:f"])) == {
        "other.py", "pkg_of_mine/__init__.py", "pkg_of_mine/deep.py", "last_of_mine.py",
    }  # fmt: skip
    write("last_of_mine.py", "import time\n")
    with pytest.raises(sources.Doubt, match="imports time"):
        sources.sources(["other.py:f"])


def test_includes_count_and_those_by_macros_are_in_doubt(write: Write) -> None:
    write("s.glsl", '#include "a.inc"\n#if 0\n  #  include <b.inc>\n#endif\n')
    write("a.inc", "float x;\n")
    write("inc/b.inc", '#include "c.inc"\n')
    write("inc/c.inc", "float y;\n")
    found = sources.sources(["s.glsl:f"], ["inc"])
    assert {path.name for path in found.values()} == {"s.glsl", "a.inc", "b.inc", "c.inc"}
    with pytest.raises(sources.Doubt, match=r"b\.inc, which is not there"):
        sources.sources(["s.glsl:f"])
    write("s.glsl", "#define A <b.inc>\n#include A\n")
    with pytest.raises(sources.Doubt, match="depends on macros"):
        sources.sources(["s.glsl:f"], ["inc"])
    with pytest.raises(sources.Doubt, match="Mitsuba"):
        sources.sources(["mitsuba:principled"])


# --- the cache ---


def test_what_has_not_changed_is_not_checked_again(
    run: Run, write: Write, kept: Callable[[], list[Path]], monkeypatch: pytest.MonkeyPatch
) -> None:
    write("brdfcheck.toml", GATE)
    first = run("check", "--json", "-")[1]
    assert len(kept()) == 3
    counted: list[str] = []
    module = importlib.import_module("brdfcheck.verdict.check")
    original = module.check_family

    def counting(family: Any, **options: Any) -> Any:
        counted.append(family.name)
        return original(family, **options)

    monkeypatch.setattr(module, "check_family", counting)
    second = run("check", "--json", "-")[1]
    assert counted == []
    one, two = json.loads(first), json.loads(second)
    assert [result.pop("cached") for result in two["results"]] == [True] * 4
    assert [result.pop("cached") for result in one["results"]] == [False] * 4
    assert one["results"] == two["results"]
    # A neighbour counts: both BRDFs of mine.py are checked again, and that of the catalogue is not.
    write("gray_of_mine.py", "GRAY = 0.75\n")
    forget("gray_of_mine")
    out = run("check")[1]
    assert sorted(counted) == ["mine.py:bright", "mine.py:matt k=0.25", "mine.py:matt k=1"]
    assert "1 of 4 from the cache" in out
    assert "albedo 0.7500000000" in out
    for words in (["--no-cache"], ["--tolerance", "1e-6"], ["--effort", "normal"]):
        counted.clear()
        run("check", "-k", "bright", *words)
        assert counted == ["mine.py:bright"], words
    counted.clear()
    monkeypatch.setenv(cache.SWITCH, "0")
    run("check", "-k", "bright")
    assert counted == ["mine.py:bright"]


def test_an_entry_that_is_damaged_costs_time_only(run: Run, write: Write, kept: Callable[[], list[Path]]) -> None:
    assert run("check", "lambert")[0] == ExitCode.PASSED
    (entry,) = kept()
    for damage in ("albino", "{"):
        entry.write_text(entry.read_text().replace("albedo", damage))
        code, out, _ = run("check", "lambert")
        assert code == ExitCode.PASSED
        assert "cache" not in out
    assert "all from the cache" in run("check", "lambert")[1]


def test_what_cannot_be_told_is_not_kept(run: Run, write: Write, kept: Callable[[], list[Path]]) -> None:
    write("timed.py", "import time\nfrom brdfcheck import Lambert\ndef f():\n    return Lambert(time.time() % 0.5)\n")
    write("raises.py", "def f(wi, wo):\n    raise RuntimeError('no')\n")
    run("check", "timed.py:f", "raises.py:f", "--effort", "quick")
    assert kept() == []
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    run("check", "lambert")
    assert kept() == []


def test_a_file_that_changes_while_it_is_checked_is_not_kept(
    write: Write, kept: Callable[[], list[Path]], here: Path, reports: dict[str, Any]
) -> None:
    verdicts, request = cache.Verdicts(), Request(("mine.py:bright",))
    assert verdicts.found(request) is None
    write("mine.py", MINE.replace("1.05", "1.5"))
    found = cases(request)
    verdicts.keep(request, found, [reports["bright"]])
    assert kept() == []
    forget("gray_of_mine")
    fresh = cache.Verdicts()
    assert fresh.found(request) is None
    fresh.keep(request, found, [reports["bright"]])
    assert len(kept()) == 1
    known_again = cache.Verdicts().found(request)
    assert known_again is not None
    assert plain(known_again[0].report) == plain(reports["bright"])
    # A module that mine.py imports had been imported by somebody else before: who knows when.
    cases(request)
    late = cache.Verdicts()
    kept()[0].unlink()
    assert late.found(request) is None
    late.keep(request, found, [reports["bright"]])
    assert kept() == []


def test_versions_options_and_registered_names_are_part_of_it(
    kept: Callable[[], list[Path]], monkeypatch: pytest.MonkeyPatch, reports: dict[str, Any]
) -> None:
    keys = set()
    requests = [Request(("lambert",)), Request(("phong",)), Request(("phong",), {"n": (1.0, 2.0)})]
    for request in requests:
        keys.add(cache.Verdicts()._key(request)[0])
    monkeypatch.setenv("XLA_FLAGS", "--xla_something")
    keys.add(cache.Verdicts()._key(requests[0])[0])
    monkeypatch.delenv("XLA_FLAGS")
    monkeypatch.setattr(cache, "_package", lambda: "another version")
    keys.add(cache.Verdicts()._key(requests[0])[0])
    assert len(keys) == 5


def test_a_name_that_was_registered_is_not_kept(
    kept: Callable[[], list[Path]], monkeypatch: pytest.MonkeyPatch, reports: dict[str, Any]
) -> None:
    entry = catalog.entry("lambert")
    monkeypatch.setitem(catalog._CATALOG.entries, "somebody", replace(entry, family=replace(entry.family, name="somebody")))
    verdicts = cache.Verdicts()
    for name in ("somebody", "lambert"):
        request = Request((name,))
        assert verdicts.found(request) is None
        verdicts.keep(request, [Case(request, name, None, None, name)], [reports["matt"]])
        assert len(kept()) == (name == "lambert")


# --- watching ---


def test_a_file_that_is_saved_is_checked_again(write: Write, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs: list[int] = []
    request = Request(("mine.py:bright",))
    looks = iter([None, "gray_of_mine.py", None, "mine.py", KeyboardInterrupt])

    def pause() -> None:
        found = next(looks)
        if found is KeyboardInterrupt:
            raise KeyboardInterrupt
        if isinstance(found, str):
            write(found, (here / found).read_text() + "\n# saved\n")

    with pytest.raises(KeyboardInterrupt):
        project.again(lambda: runs.append(1), lambda: sources.watched(request.names), pause)
    assert len(runs) == 3
    assert "watching 2 files" in capsys.readouterr().err


def test_what_is_in_doubt_is_watched_with_its_neighbours(write: Write) -> None:
    write("doubtful.py", "import os\n")
    assert {path.name for path in sources.watched(["doubtful.py:f"])} == {"doubtful.py", "mine.py", "gray_of_mine.py"}
    assert sources.watched(["lambert"]) == set()
