"""On which files a verdict depends, the cache of verdicts, and checking again when a file is saved."""

from __future__ import annotations

import importlib
import json
import os
import signal
import textwrap
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import projects
import pytest
from projects import GATE, MINE, Write, forget
from shared import Run, process, python, wait_for

from brdfcheck.brdf import catalog
from brdfcheck.cli import ExitCode, project
from brdfcheck.gate import cache, config, sources
from brdfcheck.gate.requests import Case, Request, cases
from brdfcheck.output.records import plain

write, kept, reports = projects.write, projects.kept, projects.reports

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
        ("from numpy import *\nx = load('lut.npy')", "uses load"),
        ("import numpy as np\nx = getattr(np, 'lo' + 'ad')('lut.npy')", "uses getattr"),
        ("import numpy as np\nx = np.os.getcwd()", "uses os"),
        ("import operator, numpy as np\nx = operator.methodcaller('load', 'lut.npy')(np)", "uses methodcaller"),
        ("x = __builtins__['open']('lut.txt')", "uses __builtins__"),
        ("from brdfcheck.documents import read_document as read\nx = read('lut.toml')", "uses documents"),
        ("import my_installed_package", "imports my_installed_package, which is not beside it"),
        ("class A:\n    def __init__(self):\n        self.x = 1", ""),
        ("import numpy as np\nnp.pi = 3", "sets pi of something that others may use"),
        ("from brdfcheck.lobes import Phong\ndel Phong.profile", "sets profile"),
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
    for name, text in (("d.mtlx", "<xi:include href='x.mtlx'/>"), ("d.MTLX", "<xi:include/>"), ("d.xyz", "")):
        write(name, text)
        with pytest.raises(sources.Doubt, match=r"includes other documents|kind whose files"):
            sources.sources([name])
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
    module = importlib.import_module("brdfcheck.verdict.checking")
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


def test_what_is_known_needs_no_jax(run: Run, write: Write, kept: Callable[[], list[Path]]) -> None:
    """A verdict from the cache costs what reading a few files does: what computes takes a second to import."""
    write("brdfcheck.toml", GATE)
    first = run("check")
    code = (
        "import sys; from brdfcheck.cli.process import run; code = run(['check']);"
        " print([name for name in ('jax', 'numpy', 'scipy') if name in sys.modules]); sys.exit(code)"
    )
    ended, out, err = python("-c", code)
    assert "all from the cache" in out, err
    assert out.splitlines()[-1] == "[]"
    assert ended == first[0]


def test_an_entry_that_is_damaged_costs_time_only(run: Run, write: Write, kept: Callable[[], list[Path]]) -> None:
    run.passed("check", "lambert")
    (entry,) = kept()
    whole = entry.read_text()
    for damage in (whole.replace("albedo", "albino"), whole.replace("albedo", "{"), "[]", "null", ""):
        entry.write_text(damage)
        assert "cache" not in run.passed("check", "lambert")
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
    monkeypatch.setitem(catalog._CATALOG, "somebody", replace(entry, family=replace(entry.family, name="somebody")))
    verdicts = cache.Verdicts()
    for name in ("somebody", "lambert"):
        request = Request((name,))
        assert verdicts.found(request) is None
        verdicts.keep(request, [Case(request, name, None, None, name)], [reports["matt"]])
        assert len(kept()) == (name == "lambert")


def test_beside_a_file_that_changes_others_nothing_is_kept(
    write: Write, kept: Callable[[], list[Path]], reports: dict[str, Any]
) -> None:
    write("patch_of_mine.py", "import numpy as np\n\nnp.pi = 3\nf = print\n")
    for second, count in (("mine.py:matt", 1), ("patch_of_mine.py:f", 0)):
        for entry in kept():
            entry.unlink()
        forget("gray_of_mine")
        verdicts, request = cache.Verdicts(), Request(("mine.py:bright",))
        for asked in (request, Request((second,))):
            assert verdicts.found(asked) is None
        verdicts.keep(request, [Case(request, "bright", None, None, "mine.py:bright")], [reports["bright"]])
        assert len(kept()) == count


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


def test_one_file_is_no_files(write: Write, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def pause() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        project.again(lambda: None, lambda: {here / "mine.py"}, pause)
    assert "watching 1 file;" in capsys.readouterr().err


def test_watching_is_a_process_that_checks_again(write: Write, here: Path) -> None:
    with process("-m", "brdfcheck", "check", "mine.py:bright", "--effort", "quick", "--watch") as watch:
        try:
            first = [watch.stdout.readline() for _ in range(3)]
            while "watching 2 files" not in (line := watch.stderr.readline()):
                assert line.startswith("checking "), line  # on a machine that is slow
            write("mine.py", MINE.replace("1.05", "0.75"))
            second = [watch.stdout.readline() for _ in range(3)]
            watch.send_signal(signal.SIGINT)
            assert watch.wait(20) == ExitCode.INTERRUPTED
        finally:
            watch.kill()
    assert "VIOLATES" in first[1]
    assert "albedo 0.7500000000" in second[1]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="looks for processes in /proc")
def test_ctrl_c_ends_a_watch_and_what_it_runs_with_one_line(write: Write) -> None:
    with process("-m", "brdfcheck", "check", "mine.py:bright", "--watch", start_new_session=True) as watch:
        try:
            wait_for(Path(f"/proc/{watch.pid}/task/{watch.pid}/children"))
            os.killpg(watch.pid, signal.SIGINT)  # as a terminal does
            _, told = watch.communicate(timeout=20)
        finally:
            watch.kill()
    assert watch.returncode == ExitCode.INTERRUPTED
    assert told == "brdfcheck: interrupted\n"


def test_a_subject_that_is_new_is_watched_too(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write("brdfcheck.toml", GATE)
    write("later.py", "def late():\n    return 1\n")
    seen: list[set[str]] = []

    def twice(run: Callable[[], object], files: Callable[[], set[Path]], pause: Callable[[], object]) -> None:
        for text in ("", '[[subjects]]\ntarget = "later.py:late"\n', "[["):
            path.write_text(textwrap.dedent(GATE) + text)
            seen.append({file.name for file in files()})

    monkeypatch.setattr(project, "again", twice)
    gate = config.read(path)
    project.watched(gate.requests(), gate)
    before = {"brdfcheck.toml", "mine.py", "gray_of_mine.py"}
    assert seen == [before, before | {"later.py"}, before | {"later.py"}]  # the last one is not TOML


def test_what_is_in_doubt_is_watched_with_its_neighbours(write: Write) -> None:
    write("doubtful.py", "import os\n")
    assert {path.name for path in sources.watched(["doubtful.py:f"])} == {"doubtful.py", "mine.py", "gray_of_mine.py"}
    assert sources.watched(["lambert"]) == set()
