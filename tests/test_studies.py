"""Studies: each runs at its small size, is drawn from its record alone, and says in its docstring what it found."""

from __future__ import annotations

import ast
import functools
import json
import os
import re
import shutil
from typing import Any

import pytest
from selection import few
from shared import ROOT, strict_json

from brdfcheck import processes, studies
from brdfcheck.processes import Finished

STUDIES = studies.find()
# Seconds of studies that may take more than two minutes: two check large shaders, one is a process for each family, twice, one
# asks every other package.
LONG = {"shader_corpus": 180, "user_brdfs": 480, "materialx_surfaces": 240, "work_precision": 200}


@functools.cache
def small(name: str) -> dict[str, Any]:
    """The record of a study at its small size, measured once."""
    return studies.record_of(STUDIES[name], "small")


@pytest.mark.parametrize("name", list(STUDIES))
def test_a_study_is_a_short_file_with_question_command_and_answer(name):
    study = STUDIES[name]
    text = study.path.read_text()
    assert study.question.endswith("?")
    assert re.search(r"\d", study.answer)  # measured
    assert "ANSWER" not in text  # a place kept free for what was to be measured
    assert f"brdfcheck study {name}" in ast.get_docstring(ast.parse(text))
    lines = [
        line for line in text.splitlines() if not re.match(r" *(from|import) ", line)
    ]  # how many names it needs is no matter
    assert len(lines) <= 145
    # Of the package only what is public; of the other studies nothing.
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            assert not (node.module or "").startswith("studies")
            assert not any(alias.name.startswith("_") and alias.name != "__version__" for alias in node.names)
        if isinstance(node, ast.Import):
            assert not any(alias.name in STUDIES for alias in node.names)


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    return tmp_path_factory.mktemp("reports")


# The one that other tests look at, too.
FAST = ("raw_albedo",)


@pytest.mark.parametrize("name", few(STUDIES, FAST))
def test_the_small_size_runs(name, reports):
    study = STUDIES[name]
    record = small(name)
    place = studies.write_report(study, record, reports)
    files = os.listdir(place)
    assert set(studies.FILES) <= set(files)
    written = strict_json((place / "record.json").read_text())
    assert written["schema"] == "brdfcheck-results"
    assert written["settings"]["size"] == "small"
    assert {"versions", "device", "results", "summary", "question", "answer"} <= set(written)
    assert (place / "record.json").stat().st_size < 300_000
    page = (place / "summary.md").read_text()
    assert page.startswith(f"# {study.question}\n")
    assert "![" in page
    # What a report has besides is shown on its page, or linked from it.
    assert set(files) == set(studies.FILES[:1] + studies.FILES[3:]) | set(re.findall(r"\]\(([^):]+)\)", page))
    # The report is a function of the record.
    first = {file: (place / file).read_bytes() for file in files}
    studies.write_report(study, written, reports)
    assert {file: (place / file).read_bytes() for file in files} == first
    assert "<text" in (place / "figure.svg").read_text()


def test_what_the_studies_found():
    """The numbers of the docstrings, from the small sizes."""
    record = small("raw_albedo")
    assert record["summary"]["crossing"] == pytest.approx(18.588, abs=1e-3)
    assert dict(zip(record["summary"]["exponents"], record["summary"]["albedo"], strict=True))[17] == pytest.approx(
        1.0690, abs=5e-5
    )


def test_the_command_writes_a_report_and_the_gallery(run, here, monkeypatch):
    """Of the record that was measured above."""

    found = small("raw_albedo")

    def measured(study, size, given):
        assert (study.name, size, given) == ("raw_albedo", "small", ())
        return found

    monkeypatch.setattr(studies, "record_of", measured)
    code, out, err = run("study", "raw_albedo", "--size", "small", "--out", "deep/er")
    assert (code, err) == (0, "")
    report, gallery = out.splitlines()
    assert report.startswith("raw_albedo  ")
    assert report.endswith("wrote deep/er/raw_albedo: record.json, figure.png, figure.svg, summary.md")
    assert gallery == "wrote deep/er/README.md"
    assert sorted(os.listdir("deep/er/raw_albedo")) == ["figure.png", "figure.svg", "record.json", "summary.md"]
    assert run("plot", "albedo-vs-n", "deep/er/raw_albedo/record.json")[0] == 0


@pytest.mark.slow
def test_what_the_study_of_incidence_found():
    ratios = small("incidence")["summary"]["ratios"]
    assert ratios["phong"]["ratio"] == pytest.approx(1, abs=1e-9)
    assert ratios["phong-classical"]["ratio"] == pytest.approx(18.74, abs=0.01)
    assert ratios["beckmann-smith"]["angle_degrees"] > 80


# What of a study's record is a time, in nanoseconds or seconds; all studies have the seconds of the whole.
TIMES = re.compile(r'"[^"]*(seconds|nanoseconds|one_core|cells_per_second)[^"]*": ')


def test_studies_that_measure_time_have_the_machine_for_themselves():
    """But for those that time programs on one core and say so."""
    alone = {name for name, study in STUDIES.items() if study.alone}
    expected = {"limit", "shading_cost", "sweep_throughput", "user_brdfs"}
    assert expected == alone
    for name in STUDIES:
        text = (ROOT / "reports" / name / "record.json").read_text()
        times = {match.group(0) for match in TIMES.finditer(text)} - {'"seconds": '}
        if times and name not in alone:
            assert "on one core" in ast.get_docstring(ast.parse(STUDIES[name].path.read_text())), times


def test_several_studies_are_processes_of_their_own(tmp_path, monkeypatch):
    begun = []

    def finished(commands, *, side_by_side):
        begun.append((list(commands), side_by_side))
        yield from (Finished(name, 0, 1.0, "") for name in commands)

    monkeypatch.setattr(processes, "run_all", finished)
    names = ("raw_albedo", "stability", "limit", "renders", "sweep_throughput")
    ends = studies.run_all([STUDIES[name] for name in names], "small", tmp_path)
    assert [end.name for end in ends] == ["limit", "sweep_throughput", "renders", "stability", "raw_albedo"]
    # Those that measure time as given; the others as long as they took for the report, the longest first.
    assert begun == [(["limit", "sweep_throughput"], False), (["renders", "stability", "raw_albedo"], True)]


@pytest.mark.slow
def test_the_report_of_a_process_is_the_one_of_this_one(tmp_path):
    chosen = [STUDIES["raw_albedo"], STUDIES["factor_objectives"]]
    assert {end.name: end.code for end in studies.run_all(chosen, "small", tmp_path)} == dict.fromkeys(
        ("raw_albedo", "factor_objectives"), 0
    )
    for study in chosen:
        ours, theirs = small(study.name), json.loads((tmp_path / study.name / "record.json").read_text())
        assert json.loads(studies.to_json(ours["results"])) == theirs["results"]


# --- the gallery ---


def test_the_gallery_shows_every_report_in_order(tmp_path):
    for name in ("beta", "alpha", "broken", "foreign"):
        (tmp_path / name).mkdir()
        record = {"study": name, "question": f"What of {name}?", "answer": "Much.", "settings": {"size": "full"}}
        record["summary"] = {"seconds": 11.0, "cores": 3}
        text = {"broken": "{", "foreign": "[]"}.get(name, json.dumps(record))
        (tmp_path / name / "record.json").write_text(text)
    page = studies.write_gallery(tmp_path)
    text = page.read_text()
    assert page.name == "README.md"
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["What of alpha?", "What of beta?"]
    assert "[![What of alpha?](alpha/figure.png)](alpha/summary.md)" in text
    assert " took 1.1 minutes together, counted for each core that they had." in text
    studies.write_gallery(tmp_path)
    assert page.read_text() == text


def test_the_committed_reports_are_full_size_and_linked():
    gallery = ROOT / "reports" / "README.md"
    text = gallery.read_text()
    linked = set(re.findall(r"\]\(([^)]+)\)", text))
    assert linked
    for link in linked:
        assert (gallery.parent / link).is_file(), link
    seconds = 0.0
    for path in gallery.parent.glob("*/record.json"):
        record = json.loads(path.read_text())
        assert record["settings"]["size"] == "full", path
        assert path.stat().st_size < 300_000, path
        assert f"({path.parent.name}/figure.png)" in text, path
        # What older versions took is not this one's.
        own = record["summary"]["seconds"] - record["summary"].get("baseline_seconds", 0)
        on_two_cores = own * record["summary"]["cores"] / 2
        assert on_two_cores < LONG.get(path.parent.name, 120), path
        seconds += on_two_cores
        # A report of another study's text is stale.
        study = STUDIES[path.parent.name]
        assert (record["question"], record["answer"]) == (study.question, study.answer), f"run brdfcheck study {study.name}"
    assert seconds < 25 * 60
    assert {path.parent.name for path in gallery.parent.glob("*/record.json")} == set(STUDIES)


def test_the_budgets_are_of_the_scenes_of_the_study():
    scenes = studies.load(STUDIES["scene_budget"]).SCENES
    kept = json.loads((ROOT / "reports" / "scene_budget" / "record.json").read_text())["results"]
    assert [result["name"] for result in kept] == list(scenes)
    for result, scene in zip(kept, scenes.values(), strict=True):
        assert result["settings"]["size"] == [scene["size"]] * 2, result["name"]
        assert result["settings"]["bits"] == scene.get("output", {}).get("bits", 8), result["name"]


# --- where the studies are ---


def test_in_a_checkout_and_in_an_installation(tmp_path, monkeypatch):
    assert studies.folder() == ROOT / "studies"
    package = tmp_path / "site-packages" / "brdfcheck"
    (package / "_studies").mkdir(parents=True)
    monkeypatch.setattr(studies, "__file__", str(package / "studies.py"))
    assert studies.folder() == package / "_studies"
    shutil.rmtree(package / "_studies")
    (tmp_path / "site-packages" / "studies").mkdir()  # another project's
    assert studies.folder() is None
    assert studies.find() == {}


# --- pieces ---


def test_figures_show_names_whole_and_waste_no_room():
    record = json.loads((ROOT / "reports" / "published_tables" / "record.json").read_text())
    figure = studies.load(STUDIES["published_tables"]).plot(record)
    titles = ["".join(axes.get_title().split("\n")[:-1]) for axes in figure.axes]
    assert [title for title in titles if title] == [result["name"] for result in record["results"]]
    (bars,) = (
        studies.load(STUDIES["materialx_surfaces"])
        .plot({"results": [{"name": "a", "verdict": "VIOLATES", "albedo": albedo} for albedo in (0.5, 1.5)]})
        .axes
    )
    assert 1.5 < bars.get_xlim()[1] < 1.8
    (bars,) = (
        studies.load(STUDIES["shader_corpus"])
        .plot({"results": [{"name": "a", "verdict": "VIOLATES", "albedo": "Infinity"}]})
        .axes
    )
    assert bars.get_xlim()[1] == pytest.approx(4.12)


def test_records_are_for_reading_too():
    record = {"x": [1, 2.5, -3e-9, "NaN"], "nested": [[1, 2], [3, 4]], "words": ["a", "b, c"], "empty": [], "text": "[1,\n 2]"}
    text = studies.to_json(record)
    assert json.loads(text) == record
    assert '"x": [1, 2.5, -3e-09, "NaN"]' in text
    assert "[3, 4]" in text


def test_a_file_that_is_no_study(tmp_path):
    path = tmp_path / "odd.py"
    path.write_text('"""What?"""\ndef run(size): ...\n')
    study = studies._described(path)
    assert (study.question, study.answer) == ("What?", "")
    with pytest.raises(ValueError, match="the study odd has no function plot"):
        studies.load(study)
    with pytest.raises(ValueError, match="size must be one of small, full"):
        studies.record_of(STUDIES["raw_albedo"], "huge")


def test_tables():
    assert studies.table(("a", "b"), [("1", "x|y")]) == "| a | b |\n| --- | --- |\n| 1 | x\\|y |"
