"""The subjects of a project: its file, known violations, a first draft."""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import projects
import pytest
from projects import GATE, MINE, Write
from shared import Run

from brdfcheck.cli import ExitCode
from brdfcheck.gate import config
from brdfcheck.gate.baseline import judged, needed, updated
from brdfcheck.gate.config import Known
from brdfcheck.messages import UsageError
from brdfcheck.verdict.checks import CHECKS

write, reports = projects.write, projects.reports

# --- the file ---


def test_the_subjects_are_checked_where_no_name_is_given(run: Run, write: Write, here: Path) -> None:
    write("brdfcheck.toml", GATE)
    out = run.failed("check", "--json", "found.json")
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
    run.passed("check", "-k", "matt")
    out = run.passed("check", "--no-config", "-k", "lambert")
    assert "lambert " in out
    assert "mine.py" not in out


def test_a_project_is_found_from_its_folders(write: Write, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write("pyproject.toml", '[project]\nname = "x"\n')
    write("deep/er/x", "")
    monkeypatch.chdir(here / "deep" / "er")
    (here / ".git").mkdir()
    assert config.find() is None
    write("pyproject.toml", '[[tool.brdfcheck.subjects]]\ntarget = "mine.py:bright"\n')
    assert config.find().requests()[0].names == (os.path.join("..", "..", "mine.py:bright"),)
    monkeypatch.chdir(here / "deep")
    write("pyproject.toml", '[[tool.brdfcheck.subjects]]\ntarget = "deep/mine.py:f"\n')
    assert config.find().requests()[0].names == ("mine.py:f",), "as seen from here, not by way of the root"
    monkeypatch.chdir(here / "deep" / "er")
    (here / "deep" / ".git").mkdir()
    assert config.find() is None


def test_of_two_lists_in_a_folder_none_is_passed_over(run: Run, write: Write) -> None:
    write("brdfcheck.toml", '[[subjects]]\ntarget = "lambert"\n')
    write("pyproject.toml", '[project]\nname = "x"\n')
    run.passed("check")
    write("pyproject.toml", '[[tool.brdfcheck.subjects]]\ntarget = "mine.py:bright"\n')
    assert "brdfcheck.toml and pyproject.toml both list BRDFs" in run.refused("check")
    run.passed("check", "--config", "brdfcheck.toml")


@pytest.mark.parametrize("text", ["tool = 3", "[tool]\nbrdfcheck = 3"])
def test_a_pyproject_that_has_no_table_there(run: Run, write: Write, text: str) -> None:
    write("pyproject.toml", text)
    assert "must be a table; got 3" in run.refused("check")


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
        ("subjects = []", "subjects: must have at least one entry"),
        ('[[subjects]]\ntarget = "a.py:f"\novr = {}', "unknown key 'ovr'; did you mean over?"),
        ('[[subjects]]\ntarget = "a.py:f"\nover = { n = [3, 1] }', "subjects[0].over.n: LO must not exceed HI; got [3, 1]"),
        ('[[subjects]]\ntarget = "a.py:f"\ncos_theta = [1, 0.5]', "subjects[0].cos_theta: LO must not exceed HI"),
        ('[[subjects]]\ntarget = "a.py:f"\nover = { n = [1, 3] }\nhold = { n = 1 }', "n is both in over and in hold"),
        ('[[subjects]]\ntarget = "a.py:f"\ncos_theta = [0, 2]', "must run within 0 and 1"),
        ('[[subjects]]\ntarget = "a.py:f"\nexpect = { violates = 1.1 }', "reason: is missing"),
        ('[[subjects]]\ntarget = "a.py:f"\nexpect = { reason = "so" }', "must say what is accepted"),
        ('[[subjects]]\ntarget = "a.py:f"\neffort = "slow"', "must be one of 'quick', 'normal' or 'thorough'; got 'slow'"),
        ('[[subjects]]\ntarget = "gone.py:f"', "there is no file 'gone.py'"),
        ('[[subjects]]\ntarget = "mine.py:matt"', "the parameter k must be given a range"),
        ('[[subjects]]\ntarget = ""', "target: must not be empty"),
        ('[[subjects]]\ntarget = "a.py:f"\nover = { n = 3 }', "over.n: must be a range [LO, HI], or { values = [...] }"),
        ('[[subjects]]\ntarget = "a.py:f"\nover = { n = [1, inf] }', "over.n[1]: must be finite; got inf"),
        ('[[subjects]]\ntarget = "a.py:f"\nhold = { n = [1] }', "hold.n: must be a number, true or false, or the 2 to 4"),
        ('[[subjects]]\ntarget = "a.py:f"\nexpect = "fails"', 'expect: must be "conserves" or { violates = ALBEDO, reason'),
        (
            '[[subjects]]\ntarget = "a.py:f"\nexpect = { findings = ["recip"], reason = "x" }',
            "findings[0]: must be one of 'rec",
        ),
        ('[[subjects]]\ntarget = "a.py:f"\nexpect = { violates = nan, reason = "x" }', "violates: must be above 1; got nan"),
        ('[[subjects]]\ntarget = "a.py:f"\nexpect = { violates = 2, reason = " " }', "expect.reason: must not be empty"),
        ("][", "is not TOML"),
    ],
)
def test_4_with_one_line_for_what_is_wrong(run: Run, write: Write, text: str, said: str) -> None:
    write("brdfcheck.toml", text)
    line = run.refused("check")
    assert said in line
    assert line.startswith("brdfcheck: brdfcheck.toml")


def test_a_new_check_may_be_known(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write("brdfcheck.toml", '[[subjects]]\ntarget = "a.py:f"\nexpect = { findings = ["bright", "other"], reason = "x" }')
    with pytest.raises(UsageError, match=r"must be one of 'reciprocal', .*, 'weight' or 'other'; got 'bright'"):
        config.read(path)
    monkeypatch.setitem(CHECKS, "bright", CHECKS["positive"])
    gate = config.read(path)
    assert gate.requests()[0].expect.findings == ["bright", "other"]


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
    assert said in run.refused("check", *words)


# --- lists and whole files ---


def test_a_list_of_values_and_a_whole_file(run: Run, write: Write, here: Path) -> None:
    run.failed("check", "mine.py:*", "--over", "k=0.5,1,2", "--effort", "quick", "--json", "found.json")
    names = [result["name"] for result in json.loads((here / "found.json").read_text())["results"]]
    assert names == ["mine.py:matt k=0.5", "mine.py:bright", "mine.py:matt k=1", "mine.py:matt k=2"]
    assert "bright" not in run.passed("check", "mine.py:*", "--over", "k=1", "--effort", "quick", "-k", "Matt")
    assert "no name contains 'gloss'" in run("check", "mine.py:*", "-k", "gloss")[2]
    write("mine.py", MINE + '__all__ = ["matt"]\n')
    out = run.passed("check", "mine.py:*", "--over", "k=1", "--effort", "quick")
    assert "mine.py:matt" in out
    assert "bright" not in out
    write("none.py", "x = 3\n")
    assert "none.py:*: it defines no public callable" in run("check", "none.py:*")[2]
    assert "only Python files are taken whole" in run("check", "none.glsl:*")[2]


@pytest.mark.slow
def test_a_list_for_a_vector_is_its_components(run: Run, write: Write, here: Path) -> None:
    write("flat.glsl", "uniform vec3 ks; uniform float n;\nvec3 f(vec3 L, vec3 V) { return ks * n / 3.141592653589793; }\n")
    words = ("--over", "ks=0.3,0.2,0.1", "--over", "n=1,2", "--effort", "quick", "--json", "found.json")
    run.passed("check", "flat.glsl:f", *words)
    found = json.loads((here / "found.json").read_text())["results"]
    assert [(result["name"], round(result["albedo"], 9)) for result in found] == [
        ("flat.glsl:f n=1", 0.3),
        ("flat.glsl:f n=2", 0.6),
    ]
    assert "ks: a vector has at most 4 components; got 5" in run("check", "flat.glsl:f", "--over", "ks=1,1,1,1,1")[2]


def test_a_vector_takes_as_many_numbers_as_it_has(run: Run, write: Write) -> None:
    write("flat.glsl", "uniform vec3 ks; uniform float n;\nvec3 f(vec3 L, vec3 V) { return ks * n / 3.141592653589793; }\n")
    for words in (
        ("check", "flat.glsl:f", "--over", "n=1"),
        ("certify", "flat.glsl:f", "--over", "n=1"),
        ("table", "flat.glsl:f", "-o", "t.csv", "--over", "n=1:2"),
        ("plot", "albedo-vs-angle", "flat.glsl:f", "--over", "n=1"),
        ("fit", "flat.glsl:f"),
    ):
        for numbers, count in (("1,2", 2), ("1,2,3,4", 4)):
            code, _, told = run(*words, "--over", f"ks={numbers}")
            assert (code, f"ks has 3 components; got {count} numbers" in told) == (ExitCode.USAGE_ERROR, True), told
    code, _, told = run("render", "furnace", "--brdf", "flat.glsl:f", "--set", "ks=1,2", "--set", "n=1", "-o", "x.png")
    assert (code, "ks has 3 components; got 2 numbers" in told) == (ExitCode.USAGE_ERROR, True), told


def test_a_file_is_imported_once_however_many_of_it_are_checked(run: Run, write: Write) -> None:
    write("mine.py", MINE + 'print("imported")\n')
    write("brdfcheck.toml", GATE)
    assert run("check")[2].splitlines().count("imported") == 1


def test_a_class_of_this_package_has_an_origin(run: Run, here: Path) -> None:
    run.passed("check", "Lambert", "--over", "reflectance=0.5,1", "--json", "found.json")
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


def known(**given: Any) -> Known:
    return Known(**given, reason="so it is")


def alone(report: Any, expected: Known | None) -> Any:
    (found,) = judged([report], expected)
    return found


def test_what_is_known_need_be_found_in_one_report_of_a_subject_only(reports: dict[str, Any]) -> None:
    bright, matt, one_way = (reports[name] for name in ("bright", "matt", "one_way"))
    found = judged([matt, bright, matt], known(violates=1.05))
    assert [(report.passed, report.stale, report.known) for report in found] == [
        (True, False, None), (True, False, "so it is"), (True, False, None),
    ]  # fmt: skip
    less = judged([matt, bright, matt], known(violates=1.06))
    assert [report.stale for report in less] == [False, True, False], "told once, of the largest"
    assert "smaller: its largest albedo is 1.05 (known: 1.06)" in less[1].notes[-1]
    gone = judged([matt, matt], known(violates=1.05, findings=["reciprocal"]))
    assert [report.stale for report in gone] == [True, False]
    assert "no finding 'reciprocal'" in gone[0].notes[-1]
    both = judged([one_way, matt], known(violates=100.0, findings=["reciprocal"]))
    assert "reciprocal" not in both[0].notes[-1]


def test_a_known_violation_passes_until_it_is_worse_or_gone(reports: dict[str, Any]) -> None:
    bright, matt = reports["bright"], reports["matt"]
    assert not alone(bright, None).passed
    same = alone(bright, known(violates=1.05))
    assert same.passed
    assert (same.known, same.stale) == ("so it is", False)
    worse = alone(bright, known(violates=1.04))
    assert not worse.passed
    assert "does not cover an albedo of 1.05 (known: 1.04)" in worse.notes[-1]
    less = alone(bright, known(violates=1.06))
    assert less.passed
    assert less.stale
    assert "smaller: its largest albedo is 1.05 (known: 1.06)" in less.notes[-1]
    gone = alone(matt, known(violates=1.05))
    assert gone.passed
    assert (gone.known, gone.stale) == (None, True)
    assert "the known violation is gone: it conserves energy" in gone.notes[-1]
    assert not alone(replace(bright, basis="none"), known(violates=2.0)).passed


def test_known_findings_are_known_by_their_names(reports: dict[str, Any]) -> None:
    report = reports["one_way"]
    assert [check.name for check in report.checks if not check.passed] == ["reciprocal"]
    assert not alone(report, known(violates=100.0)).passed
    assert alone(report, known(violates=100.0, findings=["reciprocal"])).passed
    extra = alone(report, known(violates=100.0, findings=["reciprocal", "positive"]))
    assert extra.passed
    assert "no finding 'positive'" in extra.notes[-1]


def test_the_baseline_is_written_and_taken_away(run: Run, write: Write, here: Path) -> None:
    path = write("brdfcheck.toml", GATE)
    before = path.read_text()
    assert "brdfcheck.toml: 1 known, 1 changed" in run.passed("check", "--update-baseline")
    found = tomllib.loads(path.read_text())["subjects"][1]["expect"]
    assert found["violates"] == pytest.approx(1.05, abs=1e-9)
    assert found["violates"] >= 1.05
    (line,) = [line for line in path.read_text().splitlines() if line.startswith("expect")]
    assert path.read_text().replace(line + "\n", "") == before
    path.write_text(path.read_text().replace(found["reason"], "old scenes"))
    out = run.passed("check")
    assert "known: old scenes" in out
    assert "1 violates, 0 undecided, 1 known" in out
    write("mine.py", MINE.replace("1.05", "0.95"))
    out = run.passed("check", "-q")
    assert "the known violation is gone" in out
    assert "1 baseline entry out of date" in out
    run.passed("check", "--update-baseline")
    assert path.read_text() == before


ALL = '[[subjects]]\ntarget = "mine.py:*"\nexpect = { violates = 1.06, findings = ["reciprocal"], reason = "old scenes" }\n'
SHINY = (
    MINE
    + """
    def one_way():
        return lambda wi, wo: 0.1 * wi[..., 2] * wo[..., 2] ** 0

    __all__ = ["bright", "one_way", "zero"]

    def zero():
        return Lambert(0.0)
    """
)


def test_what_a_filter_leaves_out_is_still_known(run: Run, write: Write) -> None:
    write("mine.py", SHINY)
    path = write("brdfcheck.toml", ALL)
    assert "out of date" not in run.passed("check", "-k", "bright")
    assert "1 known, 0 changed" in run.passed("check", "-k", "zero", "--update-baseline")
    assert path.read_text() == ALL


def test_what_cannot_be_evaluated_at_present_is_still_known(run: Run, write: Write) -> None:
    write("mine.py", SHINY.replace("0.1 * wi", "1 / 0 * wi"))
    path = write("brdfcheck.toml", ALL)
    run("check", "--update-baseline")
    found = tomllib.loads(path.read_text())["subjects"][0]["expect"]
    assert found["findings"] == ["reciprocal"]
    assert found["reason"] == "old scenes"
    assert found["violates"] == pytest.approx(1.06)


def test_what_the_baseline_accepts_from_now_on_is_no_failure(run: Run, write: Write) -> None:
    write("brdfcheck.toml", GATE)
    code, out, _ = run("check", "--update-baseline", "--quiet")
    assert (code, out) == (ExitCode.PASSED, "brdfcheck.toml: 1 known, 1 changed\n")
    out = run.passed("check", "--update-baseline", "--no-cache")
    (row,) = [line for line in out.splitlines() if line.startswith("mine.py:bright ")]
    assert "known: found on " in row


def test_a_stale_entry_is_a_warning_on_github(run: Run, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    write("brdfcheck.toml", '[[subjects]]\ntarget = "mine.py:bright"\nexpect = { violates = 2, reason = "so" }\n')
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    out = run.passed("check")
    assert "::warning file=brdfcheck.toml,line=1,title=brdfcheck%3A mine.py%3Abright::the known violation is smaller" in out


@pytest.mark.slow
def test_code_hosts_get_a_place_for_every_subject_as_seen_from_the_repository(
    run: Run, write: Write, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / ".git").mkdir()
    write(
        "a part/mine.py",
        "def bright(wi, wo):\n    return 0.5 + 0 * wi[..., 2]\n\ndef one_way(wi, wo):\n    return 0.1 * wi[..., 2]\n",
    )
    write(
        "a part/brdfcheck.toml",
        'effort = "quick"\n\n[[subjects]]\ntarget = "blinn-phong-8"\nover = { n = [8, 9] }\n'
        '[[subjects]]\ntarget = "mine.py:bright"\n[[subjects]]\ntarget = "mine.py:bright"\ncos_theta = [0.5, 1]\n'
        '[[subjects]]\ntarget = "mine.py:one_way"\n',
    )
    monkeypatch.chdir(here / "a part")
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    out = run.failed("check", "--sarif", "r.sarif", "--junitxml", "r.xml")
    marks = [line for line in out.splitlines() if line.startswith("::error")]
    assert [mark.split(",title")[0] for mark in marks] == [
        "::error file=a part/brdfcheck.toml,line=3",
        "::error file=a part/mine.py,line=1",
        "::error file=a part/mine.py,line=1",
        "::error file=a part/mine.py,line=4",
    ]
    assert "::not reciprocal: " in marks[-1], "what is wrong comes first"
    (log,) = json.loads((here / "a part/r.sarif").read_text())["runs"]
    found = [result["locations"][0]["physicalLocation"] for result in log["results"]]
    assert [place["artifactLocation"]["uri"] for place in found] == ["a%20part/brdfcheck.toml"] + ["a%20part/mine.py"] * 3
    assert found[0]["region"] == {"startLine": 3}
    prints = [result["partialFingerprints"] for result in log["results"]]
    assert len({one["primaryLocationLineHash"] for one in prints}) == len(prints), "GitHub takes equal ones for one alert"
    assert 'file="brdfcheck.toml" line="3"' in (here / "a part/r.xml").read_text()


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
    if name:
        with pytest.raises(UsageError, match=f"change the subjects yourself, of {name}: expect = {{ violates = 1.5, reason"):
            updated(gate, {0: known(violates=1.5)})
    else:
        assert tomllib.loads(updated(gate, {0: known(violates=1.5)}))["x"] == "[[subjects]]\n"


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_file_of_windows_stays_one(write: Write, mark: str) -> None:
    """Its line ends and its byte order mark are as they were, but for the line that is written."""
    path = write("brdfcheck.toml", "")
    path.write_bytes((mark + GATE.replace("\n", "\r\n")).encode())
    gate = config.read(path)
    text = updated(gate, {1: known(violates=1.5)})
    (line,) = [line for line in text.split("\r\n") if line.startswith("expect")]
    assert text.replace(f"{line}\r\n", "").encode() == path.read_bytes()


def test_what_is_needed_holds_every_report_of_a_subject(reports: dict[str, Any]) -> None:
    found = needed(list(reports.values()), None)
    assert found.violates == pytest.approx(reports["one_way"].albedo)
    assert found.findings == ["reciprocal"]
    assert needed([reports["matt"]], found) is None
    assert needed([reports["bright"]], known(violates=3)).reason == "so it is"  # pyright: ignore[reportOptionalMemberAccess]
    for report in reports.values():
        assert alone(report, found).passed


# --- init ---

LOOKS = """
    import not_there
    class Matt:
        def __init__(self, albedo):
            self.albedo = albedo
        def eval(self, wi, wo):
            return self.albedo
    def plain(wi, wo, n, gain=1):
        return 0
    def factory(alpha, *, k):
        return lambda light, view: alpha
    def help(x):
        return x
    def _hidden(wi, wo):
        return 0
    """


def test_init_lists_what_it_finds_and_runs_nothing(run: Run, write: Write, here: Path) -> None:
    write("looks.py", LOOKS)
    write("mine.py", "raise SystemExit('was run')\ndef f(wi, wo):\n    return 0.25 + 0 * wi[..., 2]\n")
    write(
        "é.py",
        "def turned(theta_i, phi_i, theta_o, phi_o): return 0.1\ndef f(V, L, N, X, Y, m): return 0\ndef g(l, N): return 0\n",
    )
    write("sub/half.glsl", "uniform float k = 0.5; vec3 half_(vec3 L, vec3 V) { return vec3(k / 3.1415926); }\n")
    write("sub/helper.glsl", "float h(float x) { return x; }\n")
    write(".venv/lib/bad.py", "def f(wi, wo): return 0\n")
    write("env/pyvenv.cfg", "")
    write("env/bad.py", "def f(wi, wo): return 0\n")
    write("test_bad.py", "def f(wi, wo): return 0\n")
    code, shown, err = run("init", "--dry-run")
    assert code == ExitCode.PASSED
    assert not (here / "brdfcheck.toml").exists()
    assert "would write brdfcheck.toml: 7 BRDFs, 2 of them commented out until you give their ranges" in err
    run.passed("init")
    text = (here / "brdfcheck.toml").read_text()
    assert text == shown
    assert "bad" not in text
    assert "# Left out: sub/helper.glsl: " in text
    found = tomllib.loads(text)
    assert [subject["target"] for subject in found["subjects"]] == [
        "looks.py:plain", "mine.py:f", "é.py:turned", "é.py:f", "sub/half.glsl:half_",
    ]  # fmt: skip
    assert 'target = "é.py:f"\nover = { m = [' in text, "what goes with the directions is no parameter"
    assert found["subjects"][0]["over"] == {"n": [1, 1000]}
    assert "brdfcheck.toml lists the BRDFs of this folder already" in run.refused("init")
    # The lines that lack a range are as they are meant once they have one.
    lines = text.replace("[LO, HI]", "[0, 1]").splitlines()
    told = ("# Replace", "# What", "# A vio", "# brdf", "# L")
    whole = "\n".join(line.removeprefix("# ") for line in lines if not line.startswith(told))
    assert [subject["target"] for subject in tomllib.loads(whole)["subjects"]][:3] == [
        "looks.py:Matt", "looks.py:plain", "looks.py:factory",
    ]  # fmt: skip
    assert tomllib.loads(whole)["subjects"][2]["over"] == {"alpha": [0.05, 1], "k": [0, 1]}


OURS = """
    import brdfcheck as bc
    from brdfcheck import Factor, Phong as P
    a = P(10)
    b = bc.lobes.Lambert(0.5)
    family = bc.load("phong", n=(1, 50))
    factor, report, _hidden = Factor(2, 3), bc.check(a), P(3)
    hers = bc.check(a)
    def made(n):
        return bc.Normalized(P(n), Factor(2, 6.3))
    """


def test_init_lists_what_is_made_of_this_package(run: Run, write: Write, here: Path) -> None:
    write("ours.py", OURS)
    run.passed("init")
    found = tomllib.loads((here / "brdfcheck.toml").read_text())["subjects"]
    ours = [name for subject in found if (name := subject["target"]).startswith("ours.py")]
    assert ours == ["ours.py:a", "ours.py:b", "ours.py:family", "ours.py:made"]


def test_init_adds_to_a_pyproject(run: Run, write: Write, here: Path) -> None:
    path = write("pyproject.toml", '[project]\nname = "x"  # kept')
    run.passed("init")
    assert path.read_text().startswith('[project]\nname = "x"  # kept\n\n#')
    assert [subject.target for subject in config.find().document.subjects] == ["mine.py:bright"]
    assert "pyproject.toml lists the BRDFs" in run("init")[2]
    for name in ("mine.py", "gray_of_mine.py", "pyproject.toml"):
        (here / name).unlink()
    assert run("init")[0] == ExitCode.NOTHING_TO_CHECK
