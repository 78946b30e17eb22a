"""README and docs: every command of brdfcheck in them runs, and so does every piece of Python."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from measured import lambert, merl_bytes, rgl_bytes, write
from selection import few
from shared import ROOT

from brdfcheck import cli, studies
from brdfcheck.cli import ExitCode

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# What makes a command short enough for a test (`test_catalog` checks and audits all), what takes long all the same, and what is
# tested elsewhere: with its answer, below, where there is a
# cluster, MaterialX or Mitsuba, and what never ends or changes a file.
ONE_ANGLE = "--effort quick --cos-theta 0.5"
SHORTER = {
    "render furnace -o furnace.png": "--size 24 --quality draft",
    "check": "-k phong",
    "check mine.py:glossy --over n=1:200": ONE_ANGLE,
    "check mine.py:glossy --over n=1:200 --html report.html": "--effort quick",
    "check glossy.brdf --over n=5 --over ks=1,0.5,0.2 --over halved=0": ONE_ANGLE,
    "check gold-paint.binary --cos-theta 0.1:1": ONE_ANGLE,
    "check lobe.glsl:shade --over n=1:50 --returns brdf*cos": "--effort quick",
    "check lobe.glsl:shade --over GAIN=0:1 --returns brdf*cos --args N,L,V": ONE_ANGLE,
    "check ways.py:Material --over albedo=0:1 --returns brdf*cos": ONE_ANGLE,
    "check ways.py:by_half --over n=20": ONE_ANGLE,
    "check ways.py:one_pair": ONE_ANGLE,
    "check rough-dielectric-ggx --over alpha=0.1:1 --over eta=1.3:1.7": ONE_ANGLE,
    "check sheet.py:paper --over through=0:1": ONE_ANGLE,
    "check sheet.py:paper --over through=0.2 --over below=1": ONE_ANGLE,
    "check --config gate.toml": "-k glossy.brdf",
    "table ggx --over roughness=0.1:1 --size 16x16 -o dfg.dds": "--size 4x4",
    "table ggx --over roughness=0.2:1 --size 16x16 --compensation -o E.hpp": "--size 4x4",
    "audit": "-k phong-pdf",
    "audit -k phong --html audit.html": "-k phong-pdf",
}
LONG = (
    "render furnace", "budget scene.toml", "fit gold-paint", "plot albedo-vs-angle gold-paint", "check material_rgb",
    "fit binomial-power-half --ladder",  # test_cli_fit has another lobe's
    # Like others on the page, or like what the tests of tables, figures, pictures, measured files and pages run.
    "plot albedo-vs-n", "render scene.toml", "sweep config.toml --out albedo.zarr --html",
    "table ggx --over roughness=0.1:1 --size 16x16 -o dfg.glsl", "check gold-paint", "check glossy.brdf --effort quick",
    "check --config gate.toml -k lobe", "check lobe.glsl:shade --over n=1:50", "check mine.py:glossy --over n=1:200 --html",
    "check 'mine.py:*'", "check mine.py:glossy --over n=1,10,100", "fit ggx", "table ggx --over roughness=0:1",
    "check rough-dielectric-ggx",
)  # fmt: skip
ELSEWHERE = ("blinn.glsl", "--scheduler", "--update-baseline", "--watch", "material.mtlx:gold", "materialx:", "mitsuba:")
# Sizes in Python, and those that a test needs.
SMALLER = {
    "(16, 16, 8)": "(4, 4, 2)",
    "size=(8, 8)": "size=(3, 3)",
    "n=(1, 200))": 'n=(1, 200), effort="quick", cos_theta=(0.5, 0.5))',
}


def files() -> dict[str, str]:
    """The files that the pages show: `name`: and a fenced block."""
    found = {}
    for page in PAGES:
        for name, text in re.findall(r"^`(\S+)`:\n\n```\w+\n(.*?)^```", page.read_text(), re.M | re.S):
            assert found.setdefault(name, text) == text, name
    return found


@pytest.fixture(scope="module")
def measured_files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """What stands for the measured files that the pages name; one of MERL has 35 MB."""
    folder = tmp_path_factory.mktemp("measured")
    rgl = rgl_bytes(0.5, np.radians([0, 20, 40, 60, 75, 88]), size=12, finer=24, colours=(0.3, 0.2, 0.1))
    named = {word for command in commands() for word in command.split() if word.endswith((".binary", ".bsdf"))}
    return [Path(write(folder, name, merl_bytes(lambert(0.5)) if name.endswith(".binary") else rgl)) for name in named]


def commands() -> list[str]:
    lines = [line for page in PAGES for line in page.read_text().splitlines() if line.startswith("    brdfcheck ")]
    return list(dict.fromkeys(re.split(r"\s{2,}", line.strip())[0].removeprefix("brdfcheck ") for line in lines))


def programs() -> list[tuple[str, str]]:
    """Page and text of each block of Python that is not a file."""
    shown = set(files().values())
    return [
        (page.name, text)
        for page in PAGES
        for text in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)
        if text not in shown
    ]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Path]:
    for name, text in files().items():
        for shown, shorter in {"1000, 400]": "1000, 4]", "1, 90]": "1, 3]", "[8, 16]": "[16]"}.items():  # of a sweep
            text = text.replace(shown, shorter)
        (tmp_path / name).write_text(text)
    if re.search(r"\.(binary|bsdf)\b", request.node.name):
        for file in request.getfixturevalue("measured_files"):
            (tmp_path / file.name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    yield tmp_path
    sys.modules.pop("mine", None)


def test_the_pages_show_something() -> None:
    assert {"mine.py", "config.toml", "scene.toml"} <= set(files())
    assert len(commands()) > 25
    assert len(programs()) >= 5
    front = (ROOT / "README.md").read_text().splitlines()
    assert len(front) <= 180
    assert max(map(len, front)) <= 128


@pytest.mark.parametrize("command", few(commands(), [command for command in commands() if not command.startswith(LONG)]))
def test_a_command_runs(command: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = shlex.split(command)
    if any(word.startswith(ELSEWHERE) for word in words):
        return
    if words[0] == "study":  # tests/test_studies.py runs them
        assert words[1] in ("list", "all", *studies.find()), command
        return
    if command == "plot factor fit.json":
        assert cli.run(["fit", "binomial-power-half", "--json", "fit.json"]) == ExitCode.PASSED
    code = cli.run([*words, *shlex.split(SHORTER.get(command, ""))])
    assert code == ExitCode.PASSED, "".join(capsys.readouterr())


def test_the_first_command_of_the_readme_answers_what_is_printed_there(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, *_ = [line for line in (ROOT / "README.md").read_text().splitlines() if line.startswith("    brdfcheck ")]
    (printed,) = re.findall(r"^```text\n(.*)\n```", (ROOT / "README.md").read_text(), re.M)
    assert cli.run(shlex.split(first)[1:]) == ExitCode.FAILED
    found = capsys.readouterr().out.splitlines()[1]
    number = re.compile(r"[0-9]+(?:\.[0-9]+)?(?:e-[0-9]+)?")
    said, wanted = ([float(text) for text in number.findall(line)] for line in (found, printed))
    assert number.sub("0", found).startswith(number.sub("0", printed))
    albedo, bar, *place = wanted
    assert said[:2] == [pytest.approx(albedo, abs=bar), pytest.approx(bar, rel=0.5)]
    assert said[2 : len(wanted)] == pytest.approx(place, abs=1e-3)


@pytest.mark.parametrize(
    ("page", "text"),
    [pytest.param(page, text, marks=[pytest.mark.slow] if page == "studies.md" else []) for page, text in programs()],
)
def test_python_runs(page: str, text: str, here: Path) -> None:
    if "open_zarr" in text:
        assert cli.run(["sweep", "config.toml", "--out", "albedo.zarr"]) == ExitCode.PASSED
    for shown, smaller in SMALLER.items():
        text = text.replace(shown, smaller)
    exec(compile(text, page, "exec"), {"__name__": "page"})


def test_links_and_pictures_are_there() -> None:
    for page in PAGES:
        prose = re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text(), flags=re.M | re.S)
        for target in re.findall(r"\]\(([^)#]+)\)", prose):
            assert (page.parent / target).exists(), (page.name, target)
