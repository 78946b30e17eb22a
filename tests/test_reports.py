"""Committed reports against the studies that are to have made them: a report of another study's text is stale."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

import brdfcheck
from brdfcheck import studies

REPORTS = Path(brdfcheck.__file__).parent.parent / "reports"
STUDIES = studies.find()


def record(name: str) -> dict[str, Any]:
    return json.loads((REPORTS / name / "record.json").read_text())


@pytest.mark.parametrize("name", list(STUDIES))
def test_a_report_is_of_the_study_as_it_is(name):
    study, kept = STUDIES[name], record(name)
    again = f"run brdfcheck study {name} --out reports"
    assert kept["question"] == study.question, again
    assert kept["answer"] == study.answer, again
    assert kept["settings"]["size"] == "full", again


def test_the_budgets_are_of_the_scenes_of_the_study():
    spec = importlib.util.spec_from_file_location("scene_budget", STUDIES["scene_budget"].path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    kept = {result["name"]: result for result in record("scene_budget")["results"]}
    assert list(kept) == list(module.SCENES), "run brdfcheck study scene_budget --out reports"
    for name, scene in module.SCENES.items():
        size = scene["size"]
        assert kept[name]["settings"]["size"] == [size, size], name
        assert kept[name]["settings"]["bits"] == scene.get("output", {}).get("bits", 8), name
