"""What continuous integration reads: SARIF, a badge, JUnit with file and line, the action and the pre-commit hook."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shlex
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest
from shared import ROOT

import brdfcheck
from brdfcheck.output import records, sarif
from brdfcheck.verdict import Report, Verdict
from brdfcheck.verdict.checks import CHECKS
from brdfcheck.verdict.parts import Check
from brdfcheck.verdict.words import reason_text

GOOD = Report("mine.py:good", Verdict.CONSERVES, {}, albedo=0.5, error=1e-9, cos_theta=1.0, basis="search")
UNEQUAL = Check("reciprocal", 0.5, False, "not reciprocal: 0.5 of the larger")
BAD = dataclasses.replace(
    GOOD,
    name="mine.py:bad",
    verdict=Verdict.VIOLATES,
    albedo=1.25,
    least=1.25,
    ranges={"n": (1.0, 10.0)},
    parameters={"n": 3.0},
    above=((2.0, 4.0),),
    checks=(UNEQUAL,),
    findings=(UNEQUAL.words, "no data:\nhalf of it"),
)
LOST = Report("mine.py:lost", Verdict.UNDECIDED, {}, findings=("cannot be evaluated: ValueError",))
OPEN = dataclasses.replace(GOOD, name="mine.py:open", verdict=Verdict.UNDECIDED, albedo=inf)
# An id never changes: code hosts know a finding by it.
IDS = {
    "energy/violates",
    "energy/undecided",
    "brdf/not-evaluated",
    "brdf/finding",
    "check/reciprocal",
    "check/positive",
    "check/finite",
    "check/pdf",
    "check/weight",
}


def log(reports: list[Report], places: list[Any], **more: Any) -> dict[str, Any]:
    return json.loads(sarif.to_sarif(reports, places, **more))


def results(reports: list[Report], places: list[Any], **more: Any) -> list[dict[str, Any]]:
    return log(reports, places, **more)["runs"][0]["results"]


def test_sarif_has_a_result_for_each_defect(tmp_path: Path) -> None:
    file = tmp_path / "a folder" / "mine.py"
    file.parent.mkdir()
    file.write_text("")
    places = [(str(file), line) for line in (1, 7, None, 3)]
    found = results([GOOD, BAD, LOST, OPEN], places, folder=str(tmp_path))
    assert [result["ruleId"] for result in found] == [
        "energy/violates",
        "check/reciprocal",
        "brdf/finding",
        "brdf/not-evaluated",
        "energy/undecided",
    ]
    assert found[0]["message"]["text"].startswith(
        "mine.py:bad: albedo 1.2500000000 +- 1e-09 at n=3 angle=0 deg; exceeds 1 for n=2..4"
    )
    assert found[2]["message"]["text"] == "mine.py:bad: no data: half of it"
    assert [result["level"] for result in found] == ["error", "error", "warning", "error", "warning"]
    lines = []
    for result in found:
        (location,) = result["locations"]
        physical = location["physicalLocation"]
        assert physical["artifactLocation"] == {"uri": "a%20folder/mine.py", "uriBaseId": "%SRCROOT%"}
        lines.append(physical["region"]["startLine"])
        assert location["logicalLocations"][0]["fullyQualifiedName"].startswith("mine.py:")
    assert lines == [7, 7, 7, 1, 3]
    assert found[4]["properties"]["albedo"] == "Infinity"


@pytest.mark.parametrize(
    ("report", "why"),
    [
        (BAD, "the albedo exceeds 1 by more than its own error"),
        (LOST, "the BRDF could not be evaluated"),
        (OPEN, "the search did not settle: narrow the ranges, or give it more effort"),
        (
            dataclasses.replace(OPEN, albedo=1.0, settled=True),
            "the error bar contains 1: ask for more accuracy or allow a tolerance",
        ),
        (dataclasses.replace(OPEN, albedo=-0.1, settled=True), "the albedo is negative throughout"),
        (dataclasses.replace(OPEN, albedo=nan), "the albedo is not a number"),
    ],
)
def test_why_the_verdict_is_what_it_is(report: Report, why: str) -> None:
    assert reason_text(report) == why
    if report.verdict is Verdict.UNDECIDED and report is not LOST:
        (found,) = results([report], [(None, None)])
        assert found["message"]["text"].startswith(f"mine.py:open: {why}: albedo ")


def test_sarif_rules() -> None:
    run = log([BAD, LOST, OPEN], [(None, None)] * 3, exit_code=1)["runs"][0]
    rules = run["tool"]["driver"]["rules"]
    assert {rule["id"] for rule in rules} == IDS
    assert {f"check/{name}" for name in CHECKS} - IDS == {"check/sides"}, "a check that is told and never fails"
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
        assert rules[result["ruleIndex"]]["defaultConfiguration"]["level"] == result["level"]
    assert run["invocations"] == [{"executionSuccessful": True, "exitCode": 1}]


def test_a_new_check_is_a_rule_of_its_own() -> None:
    failed = Check("new thing", 1.0, False, "it is new")
    report = dataclasses.replace(GOOD, checks=(failed,), findings=(failed.words,))
    run = log([report], [(None, None)])["runs"][0]
    assert [result["ruleId"] for result in run["results"]] == ["check/new thing"]
    assert run["tool"]["driver"]["rules"][-1]["id"] == "check/new thing"


def test_a_fingerprint_is_of_the_defect_and_not_of_its_numbers(tmp_path: Path) -> None:
    def prints(report: Report, line: int = 1, folder: Path = tmp_path) -> list[str]:
        place = (str(Path(folder, "mine.py")), line)
        return [found["partialFingerprints"]["brdfcheck/v1"] for found in results([report], [place], folder=str(folder))]

    first = prints(BAD)
    assert len(set(first)) == len(first) == 3
    moved = dataclasses.replace(BAD, albedo=1.26, least=1.26, parameters={"n": 3.1}, seconds=9.0)
    assert prints(moved, line=40) == first
    assert prints(dataclasses.replace(BAD, name=f"{tmp_path}/mine.py:bad")) == first
    assert not set(prints(dataclasses.replace(BAD, name="mine.py:worse"))) & set(first)
    assert not set(prints(dataclasses.replace(BAD, ranges={"n": (1.0, 20.0)}))) & set(first)


def test_what_is_known_and_accepted_is_suppressed() -> None:
    found = results([dataclasses.replace(BAD, known="a reason"), OPEN], [(None, None)] * 2)
    assert [result["level"] for result in found] == ["note"] * 3 + ["warning"], "GitHub reads levels, and no suppressions"
    assert found[0]["message"]["text"].endswith(" (accepted: a reason)")
    assert [result.get("suppressions") for result in found] == [[{"kind": "external", "justification": "a reason"}]] * 3 + [
        None
    ]


def test_sarif_of_the_catalogue_and_of_plug_ins_has_no_file() -> None:
    for place in ((None, None), ("mitsuba:principled", None)):
        (location,) = results([dataclasses.replace(BAD, findings=())], [place])[0]["locations"]
        assert "physicalLocation" not in location


def test_sarif_of_a_file_outside_is_absolute(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("")
    (tmp_path / "project").mkdir()
    found = results([OPEN], [(str(tmp_path / "mine.py"), 3)], folder=str(tmp_path / "project"))
    artifact = found[0]["locations"][0]["physicalLocation"]["artifactLocation"]
    assert artifact == {"uri": (tmp_path / "mine.py").as_uri()}


def test_sarif_obeys_its_schema(tmp_path: Path) -> None:
    """By the classes that were generated from the schema of OASIS."""
    schema = pytest.importorskip("pydantic_sarif.model", reason="pydantic-sarif, which has the schema, is not installed")
    (tmp_path / "mine.py").write_text("")
    place = (str(tmp_path / "mine.py"), 3)
    known = dataclasses.replace(BAD, known="a reason")
    written = log([GOOD, BAD, known, LOST, OPEN], [(None, None), place, place, place, (None, None)], exit_code=1)
    name = "StaticAnalysisResultsFormatSarifVersion210JsonSchema"
    model = getattr(schema, name)
    model.model_validate(written)
    # It does say no: to an unknown key, and to a result without a message.
    for broken in ({**written, "run": []}, {**written, "runs": [{**written["runs"][0], "results": [{"ruleId": "x"}]}]}):
        with pytest.raises(ValueError, match=r"validation error"):
            model.model_validate(broken)


@pytest.mark.parametrize(
    ("reports", "message", "color"),
    [
        ([GOOD], "conserved", "brightgreen"),
        ([GOOD, GOOD], "2 conserve", "brightgreen"),
        ([BAD, BAD, OPEN], "2 of 3 violate", "red"),
        ([GOOD, LOST], "1 of 2 undecided", "yellow"),
        ([GOOD, dataclasses.replace(GOOD, findings=("x",))], "1 of 2 with findings", "orange"),
        ([GOOD, dataclasses.replace(BAD, known="a reason")], "1 of 2 violates, known", "green"),
    ],
)
def test_badge(reports: list[Report], message: str, color: str) -> None:
    badge = records.badge(records.count(reports))
    assert (badge["message"], badge["color"]) == (message, color)


def test_junit_says_nothing_of_places_that_are_not_known() -> None:
    text = records.to_junit([GOOD], ["fine"], seconds=1, classnames=["x"])
    (case,) = ElementTree.fromstring(text).findall(".//testcase")
    assert set(case.attrib) == {"classname", "name", "time"}


# --- the action and the hook ---


def yaml(name: str) -> Any:
    return pytest.importorskip("yaml").safe_load((ROOT / name).read_text())


def options(command: str) -> set[str]:
    from typer.main import get_command

    from brdfcheck.cli import process

    found = get_command(process.app).commands[command]  # pyright: ignore[reportAttributeAccessIssue]
    return {option for parameter in found.params for option in parameter.opts}


def test_the_action_gives_check_what_it_takes() -> None:
    action = yaml("action.yml")
    assert action["runs"]["using"] == "composite"
    steps = action["runs"]["steps"]
    script = "\n".join(step.get("run", "") for step in steps)
    assert set(re.findall(r"(?<![\w-])--[a-z]+", script)) <= options("check")
    used = set(re.findall(r"inputs\.([\w-]+)", (ROOT / "action.yml").read_text()))
    assert used == set(action["inputs"])
    # What somebody writes into an input is data of the script, not a part of it.
    assert "${{ inputs" not in script
    for step in steps:
        assert step.get("uses", "@v").rpartition("@")[2]
        assert "run" not in step or step["shell"] == "bash"
    for output in action["outputs"].values():
        (identity,) = re.findall(r"steps\.(\w+)\.outputs", output["value"])
        assert identity in {step.get("id") for step in steps}


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize("code", [0, 1, 4])
def test_the_action_in_a_shell(tmp_path: Path, code: int) -> None:
    """Its own script, with a stand-in for the program that notes its arguments."""
    program = tmp_path / "brdfcheck"
    kept = "" if code == 4 else "touch out/brdfcheck.sarif out/brdfcheck.html\n"
    program.write_text(f'#!/bin/bash\nprintf "%s\\n" "$@" > arguments\n{kept}exit {code}\n')
    program.chmod(0o755)
    (script,) = [step["run"] for step in yaml("action.yml")["runs"]["steps"] if step.get("id") == "check"]
    environment = {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "TARGETS": "a.py:f *.brdf $(touch hacked)",
        "OPTIONS": "--over n=1:2",
        "REPORTS": "out",
        "GITHUB_OUTPUT": str(tmp_path / "output"),
    }
    subprocess.run(["bash", "-eo", "pipefail", "-c", script], cwd=tmp_path, env=environment, check=True)
    given = (tmp_path / "arguments").read_text().split("\n")
    assert given[:7] == ["check", "a.py:f", "*.brdf", "$(touch", "hacked)", "--over", "n=1:2"]
    assert not (tmp_path / "hacked").exists()
    written = [] if code == 4 else ["sarif=out/brdfcheck.sarif", "html=out/brdfcheck.html"]
    assert (tmp_path / "output").read_text().splitlines() == [f"exit-code={code}", *written]


def test_the_docs_name_a_version_that_does_not_move() -> None:
    text = (ROOT / "docs" / "reports.md").read_text()
    named = re.findall(r"(?:OWNER/brdfcheck@|rev: )(\S+)", text)
    assert named == [f"v{brdfcheck.__version__}"] * 2


def test_a_name_without_an_ending_is_taken(run: Any, here: Path) -> None:
    words = shlex.split("--sarif sarif --junitxml junit --badge badge --json json")
    run.silent("check", "lambert", "--effort", "quick", *words)
    assert json.loads((here / "sarif").read_text())["version"] == "2.1.0"
    run.passed("check", "lambert", "--effort", "quick", "--sarif", "r.sarif.json")


def test_the_hook_runs_check() -> None:
    (hook,) = yaml(".pre-commit-hooks.yaml")
    assert hook["language"] == "python"
    words = shlex.split(hook["entry"])
    assert words[:2] == ["brdfcheck", "check"]
    assert {word for word in words if word.startswith("--")} <= options("check")
    assert re.compile(hook["files"]).search("shaders/disney.brdf")
    assert not re.compile(hook["files"]).search("mine.py")
