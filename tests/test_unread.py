"""What cannot be read is an error of its own: the other BRDFs are judged, and every output says both."""

from __future__ import annotations

import json
import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import projects
import pytest
from projects import Write
from shared import Run

from brdfcheck.brdf.subject import resolve
from brdfcheck.cli import ExitCode
from brdfcheck.messages import UsageError
from brdfcheck.output import sarif
from brdfcheck.verdict import Report, Verdict

write = projects.write

# A name that cannot be read: what is said of it, and the line at which code hosts show it, of the file or of the list.
UNREAD = {
    "raises.py:f": ("cannot import raises.py: line 3: NameError: name 'z' is not defined", "raises.py", 3),
    "raises.py:*": ("cannot import raises.py: line 3: NameError: name 'z' is not defined", "raises.py", 3),
    "leaves.py:f": ("cannot import leaves.py: line 1: it calls sys.exit(3) while being imported", "leaves.py", 1),
    "gone.py:f": ("there is no file 'gone.py'", "brdfcheck.toml", None),
    "mine.py:gone": ("mine.py has no object 'gone'", "brdfcheck.toml", None),
    "mine.py:matt": ("the parameter k must be given a range", "brdfcheck.toml", None),
    "broken.brdf": ("the file has no '::begin shader'", "brdfcheck.toml", None),
    "broken.glsl:f": ("broken.glsl:2:10: error: 'q' is not defined", "broken.glsl", 2),
    "lambertt": ("unknown BRDF 'lambertt'; did you mean lambert", "brdfcheck.toml", None),
    "mine.xyz:f": ("there is no reader for files that end in '.xyz'", "brdfcheck.toml", None),
}


@pytest.fixture
def files(write: Write) -> None:
    write("raises.py", "x = 1\n\ny = z\n")
    write("leaves.py", "raise SystemExit(3)\n")
    write("broken.brdf", "analytic\n")
    write("broken.glsl", "float f(vec3 L, vec3 V) {\n  return q;\n}\n")


def listed(*targets: str) -> str:
    return 'effort = "quick"\n' + "".join(f'[[subjects]]\ntarget = "{target}"\n' for target in targets)


def test_the_other_subjects_are_judged_and_every_report_is_written(
    run: Run, write: Write, here: Path, files: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / ".git").mkdir()
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    write("brdfcheck.toml", listed("lambert", *UNREAD, "mine.py:bright"))
    words = ["--json", "r.json", "--sarif", "r.sarif", "--junitxml", "r.xml", "--badge", "b.json", "--html", "r.html"]
    code, out, err = run("check", *words)
    assert code == ExitCode.USAGE_ERROR, "what could not be judged wins over what violates"
    assert "internal" not in err
    rows = [line.split()[:2] for line in out.splitlines()[1 : len(UNREAD) + 3]]
    assert rows == [["lambert", "CONSERVES"], *([name, "ERROR"] for name in UNREAD), ["mine.py:bright", "VIOLATES"]]
    assert f"1 conserves, 1 violates, 0 undecided, {len(UNREAD)} could not be read" in out
    record = json.loads((here / "r.json").read_text())
    assert (record["summary"]["exit_code"], record["summary"]["unread"]) == (4, len(UNREAD))
    found = {result["name"]: result for result in record["results"]}
    assert list(found) == ["lambert", *UNREAD, "mine.py:bright"]
    (log,) = json.loads((here / "r.sarif").read_text())["runs"]
    assert log["invocations"][0]["exitCode"] == 4
    results = {one["message"]["text"].partition(": ")[0]: one for one in log["results"]}
    suite = ElementTree.parse(here / "r.xml").getroot()
    assert (suite.get("errors"), suite.get("failures")) == (str(len(UNREAD)), "1")
    tests = {case.get("name"): case for case in suite.iter("testcase")}
    page = (here / "r.html").read_text()
    assert f"{len(UNREAD)} could not be read" in page
    for index, (name, (said, file, line)) in enumerate(UNREAD.items(), 1):
        line = 2 * (index + 1) if line is None else line
        assert found[name]["unread"], name
        assert not found[name]["passed"]
        assert said in found[name]["findings"][0]
        assert f"brdfcheck.toml: subjects[{index}]: " in found[name]["findings"][0]
        assert results[name]["ruleId"] == "brdf/not-evaluated"
        assert said in results[name]["message"]["text"]
        physical = results[name]["locations"][0]["physicalLocation"]
        assert (physical["artifactLocation"]["uri"], physical["region"]["startLine"]) == (file, line)
        problem = tests[name].find("error")
        assert problem is not None
        assert said in str(problem.get("message"))
        assert (tests[name].get("file"), tests[name].get("line")) == (file, str(line))
        assert f"error: {name}: " in out
        assert f"::error file={file},line={line},title=brdfcheck%3A {name.replace(':', '%3A')}::ERROR: " in out
    assert not found["mine.py:bright"]["unread"]
    assert results["mine.py:bright"]["ruleId"] == "energy/violates"
    assert results["mine.py:bright"]["locations"][0]["physicalLocation"] == {
        "artifactLocation": {"uri": "mine.py", "uriBaseId": "%SRCROOT%"}, "region": {"startLine": 8}
    }  # fmt: skip
    assert tests["mine.py:bright"].find("failure") is not None
    assert (tests["mine.py:bright"].get("file"), tests["mine.py:bright"].get("line")) == ("mine.py", "8")
    badge = json.loads((here / "b.json").read_text())
    message = f"1 of {len(UNREAD) + 2} violates"
    assert badge == {"schemaVersion": 1, "label": "energy", "message": message, "color": "red"}


@pytest.mark.parametrize("over", [(), ("--over", "k=1"), ("--over", "k=1,2")])
def test_so_it_is_with_names_on_the_command_line(run: Run, here: Path, files: None, over: tuple[str, ...]) -> None:
    """With ranges the names are one request."""
    names = ("raises.py:f", "mine.py:matt" if over else "lambert", "lambertt", "broken.glsl:f", "raises.py:*")
    code, out, _ = run("check", *names, *over, "--json", "r.json", "--badge", "b.json", "-q")
    assert code == ExitCode.USAGE_ERROR
    results = json.loads((here / "r.json").read_text())["results"]
    judged = {result["name"] for result in results if not result["unread"]}
    values = over[-1:] and over[-1].removeprefix("k=").split(",")
    assert judged == ({"lambert"} if not over else {f"mine.py:matt k={k}" for k in values} if len(values) > 1 else {names[1]})
    assert [result["name"] for result in results if result["unread"]] == [name for name in names if name != names[1]]
    lost = len(names) - 1
    assert json.loads((here / "b.json").read_text())["message"] == f"{lost} of {lost + len(judged)} could not be read"
    assert "CONSERVES" not in out
    assert out.count("ERROR") == lost


def test_what_every_name_shares_is_still_a_mistake_of_the_command(run: Run, write: Write) -> None:
    code, out, err = run("check", "lambert", "ggx", "--over", "q=1:2")
    assert (code, out) == (ExitCode.USAGE_ERROR, "")
    assert "none of the BRDFs has a parameter 'q'" in err
    # What could not be read may be what a range is for.
    code, out, _ = run("check", "gone.py:f", "lambert", "--over", "q=1:2", "--effort", "quick")
    assert code == ExitCode.USAGE_ERROR
    assert "1 conserves, 0 violate, 0 undecided, 1 could not be read" in out


@pytest.mark.parametrize("listing", [True, False])
def test_one_name_alone_is_said_in_one_line_once_the_reports_are_written(
    run: Run, write: Write, here: Path, files: None, listing: bool
) -> None:
    write("brdfcheck.toml", listed("raises.py:f"))
    code, out, err = run("check", *([] if listing else ["raises.py:f"]), "--sarif", "r.sarif", "--json", "r.json")
    assert (code, out) == (ExitCode.USAGE_ERROR, "")
    assert err.count("\n") == 1
    where = "brdfcheck.toml: subjects[0]: " if listing else ""
    assert err.startswith(f"brdfcheck: {where}cannot import raises.py: line 3: NameError")
    (result,) = json.loads((here / "r.sarif").read_text())["runs"][0]["results"]
    assert result["locations"][0]["physicalLocation"]["region"] == {"startLine": 3}
    assert json.loads((here / "r.json").read_text())["summary"]["unread"] == 1


def test_the_filter_keeps_a_whole_file_whose_names_are_not_known(run: Run, write: Write, files: None) -> None:
    write("brdfcheck.toml", listed("raises.py:*", "mine.py:bright", "lambert"))
    code, out, _ = run("check", "-k", "lambert")
    assert code == ExitCode.USAGE_ERROR
    assert [line.split()[:2] for line in out.splitlines()[1:3]] == [["raises.py:*", "ERROR"], ["lambert", "CONSERVES"]]


def test_a_known_violation_stays_while_its_file_cannot_be_read(run: Run, write: Write, here: Path) -> None:
    text = listed("lambert", "mine.py:bright") + 'expect = { violates = 1.06, reason = "old scenes" }\n'
    path = write("brdfcheck.toml", text)
    write("mine.py", "raise ValueError('half written')\n")
    code, out, _ = run("check", "--update-baseline")
    assert code == ExitCode.USAGE_ERROR
    assert "half written" in out
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (".", ". is a folder; give a file in it"),
        ("below", "below is a folder; give a file in it, or list its BRDFs with brdfcheck init"),
        ("mine:bright", "there is no reader for a file without an ending; did you mean mine.py:bright?"),
        ("mine.bright", "there is no reader for files that end in '.bright'; did you mean mine.py:bright?"),
        ("GONE.PY:bright", "there is no file 'GONE.PY'"),
        ("wide.py:f", "cannot import wide.py: it is not text in UTF-8: it holds zero bytes"),
        ("pipe.py:f", "pipe.py is no ordinary file"),
    ],
)
def test_what_one_types_by_mistake(run: Run, write: Write, here: Path, name: str, said: str) -> None:
    (here / "below").mkdir()
    (here / "wide.py").write_text("f = 3\n", encoding="utf-16")
    os.mkfifo(here / "pipe.py")
    code, out, err = run("check", name)
    assert (code, out) == (ExitCode.USAGE_ERROR, "")
    assert said in err


@pytest.mark.skipif(os.name != "posix", reason="names of files are text")
def test_a_name_that_is_no_text_is_in_every_report(run: Run, here: Path) -> None:
    """Python reads such bytes as surrogates, which no file can hold; JAX names no function after them."""
    name = os.fsdecode(b"odd\xff.py")
    (here / name).write_text("def f(wi, wo):\n    return 0.1 + 0 * wi[..., 2]\n")
    # Quiet, for the stream of a test holds no surrogates either; that of the command shows them as numbers.
    words = ["--json", "r.json", "--junitxml", "r.xml", "--html", "r.html", "--effort", "quick", "--quiet"]
    code, out, err = run("check", f"{name}:f", *words)
    assert (code, out, err) == (ExitCode.PASSED, "", "")
    (report,) = json.loads((here / "r.json").read_text())["results"]
    assert (report["name"], report["verdict"]) == (f"{name}:f", "CONSERVES")
    assert "odd\\udcff.py:f" in (here / "r.html").read_text()
    lost = Report(f"{name}:f", Verdict.UNDECIDED, {}, findings=("cannot be evaluated",))
    (result,) = json.loads(sarif.to_sarif([lost], [(name, 1)], folder="."))["runs"][0]["results"]
    assert result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "odd%FF.py"


def test_a_file_that_cannot_be_imported_is_tried_once(run: Run, write: Write) -> None:
    write("loud.py", "print('tried')\nx = y\n")
    write("brdfcheck.toml", listed("loud.py:f", "lambert", "loud.py:*", "loud.py:g"))
    code, out, err = run("check")
    assert code == ExitCode.USAGE_ERROR
    assert out.count("cannot import loud.py: line 2") == 3
    assert err.splitlines().count("tried") == 1


def test_a_name_that_is_given_twice_is_checked_once(run: Run) -> None:
    code, out, _ = run("check", "lambert", "lambert", "--effort", "quick")
    assert code == ExitCode.PASSED
    assert "1 conserves, 0 violate" in out


def test_names_may_be_strict(write: Write, files: None) -> None:
    given: Any = {"k": (1.0, 1.0)}
    with pytest.raises(UsageError, match=r"raises\.py"):
        resolve(["mine.py:matt", "raises.py:f"], given, None)
    matt, lost = resolve(["mine.py:matt", "raises.py:f"], given, None, others_go_on=True)
    assert (matt.unread, lost.unread, lost.file, lost.line) == (False, True, "raises.py", 3)
