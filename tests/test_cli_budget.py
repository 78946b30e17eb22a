"""``brdfcheck budget`` from the words to the files, and all ways in which it refuses."""

from __future__ import annotations

import json

import pytest
from shared import Run

SCENE = """
size = 16
[output]
bits = 8
[material]
kind = "metal"
base = [1.0, 0.7, 0.3]
lobes = [[0.02, 0.2]]
[[lights]]
kind = "distant"
direction = [1, 1, 1]
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_how_far_it_is_is_said_where_there_is_no_terminal(scene, run: Run, monkeypatch):
    monkeypatch.setattr("brdfcheck.cli.budget._EVERY", 0)
    code, _, err = run("budget", str(scene))
    assert code == 0
    assert f"measuring {scene} with power of R.V (16)\n" in err
    assert f"choosing for {scene}: " in err


def test_a_budget_with_all_its_files(scene, tmp_path, run: Run):
    files = {name: tmp_path / name for name in ("b.json", "chart.svg", "images.png")}
    options = ["--json", str(files["b.json"]), "-o", str(files["chart.svg"]), "--images", str(files["images.png"])]
    lines = run.silent("budget", str(scene), "--tolerance", "0.5/255", *options).splitlines()
    assert lines[0].split()[:3] == ["knob", "chosen", "error,"]
    assert lines[1].startswith("metal")
    assert any(line.startswith("verified") for line in lines)
    assert any(line.startswith("time") and "full model" in line for line in lines)
    record = json.loads(files["b.json"].read_text())
    assert record["schema"] == "brdfcheck-results"
    assert record["summary"]["verified"]["pixel"] <= 0.5 / 255
    assert set(record["summary"]["chosen"]) == {"metal", "precision"}
    assert [row["knob"] for row in record["results"]] == ["metal", "precision"]
    assert {"rung", "error", "cost", "dearer", "ladder"} <= set(record["results"][0])
    assert "<svg" in files["chart.svg"].read_text()
    assert files["images.png"].read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("bits = 8", "bits = 12", "output.bits: must be one of 8 or 16; got 12"),
        ("size = 16", "size = 0", "size"),
        ("size = 16", "size = ", "is not TOML"),
        ('kind = "distant"\ndirection = [1, 1, 1]', 'kind = "ambient"', "Metal is lit by Distant, Point and Spot lights only"),
        ("[output]", '[geometry]\nkind = "sphere"\nradius = 9\n[output]', "inside the sphere"),
        ("[output]", "[room]\nreflectance = 1.2\nemission = 1\n[output]", "room.reflectance: must be below 1; got 1.2"),
    ],
)
def test_wrong_scenes(scene, run: Run, old, new, message):
    assert old in SCENE
    scene.write_text(SCENE.replace(old, new))
    line = run.refused("budget", str(scene))
    assert message in line
    assert "scene.toml" in line


def test_a_picture_that_does_not_repeat(scene, run: Run, monkeypatch):
    from brdfcheck.budgets.measure import measure

    measured = measure(scene)
    verified = measured.verified
    monkeypatch.setattr(type(measured), "verified", lambda self, one, image: verified(one, image + 0.1))
    assert "rendered again, the chosen combination errs" in run.failed("budget", str(scene))
