"""The words of every command: what they may be, and in one line what is wrong with them; help and version."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import get_args

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from shared import Run, python

import brdfcheck
from brdfcheck import cli
from brdfcheck.cli import words
from brdfcheck.messages import UsageError, written

COMMANDS = ("check", "init", "audit", "view", "certify", "fit", "table", "plot", "sweep", "render", "budget", "study", "list")


# --- what is wrong, command by command ---

BAD = {
    "": [
        ("", "no command given; the commands are check, init, audit, view, certify, fit, table"),
        ("chekc", "'chekc'"),
        ("--frobnicate", "--frobnicate"),
    ],
    "check": [
        ("--frobnicate", "--frobnicate"),
        ("--over", "Option '--over' requires an argument (see brdfcheck check --help)"),
        ("fong", "unknown BRDF 'fong'; did you mean phong"),
        ("absent.py:f", "there is no file 'absent.py'"),
        ("phong --over n", "--over: must be NAME=LO:HI or NAME=VALUE, as in n=1:1000; got 'n'"),
        ("phong --over n=5:1", "--over: n=5:1: LO must not exceed HI; got 5 > 1"),
        ("phong --over n=nan:1", "must be finite; got nan"),
        ("phong --over n=1:x", "--over: n=1:x: 'x' is not a number"),
        ("phong --over n=1:2 --over n=1", "--over: the parameter 'n' is given twice"),
        ("phong --over n=-1:2", "n must be finite and >= 0; got -1"),
        ("ggx --over alpha=0:1", "alpha must be finite and > 0"),
        ("phong --over m=1:2", "no parameter 'm'; its parameters: n"),
        ("phong --cos-theta 0:2", "--cos-theta: must lie within 0:1; got 0:2"),
        ("phong --cos-theta -1:1", "--cos-theta: must lie within 0:1; got -1:1"),
        ("phong --cos-theta 1:0", "--cos-theta: LO must not exceed HI"),
        ("phong --tolerance -1", "--tolerance: must be at least 0; got -1"),
        ("phong --tolerance 1", "--tolerance: must be at most 0.5; got 1"),
        ("phong --tolerance nan", "--tolerance: must be at most 0.5; got nan"),
        ("phong --tolerance much", "--tolerance: must be a number; got much"),
        ("phong --rtol 0", "--rtol: must be at least 1e-16; got 0"),
        ("phong --rtol inf", "--rtol: must be at most 0.5; got inf"),
        ("phong --effort best", "--effort: 'best' is not one of 'quick', 'normal', 'thorough'"),
        ("phong --jobs 0", "--jobs: must be at least 1; got 0"),
        ("phong --jobs=", "--jobs: must be a whole number; got nothing"),
        ("phong --json a\0b", "--json: cannot write 'ab': embedded null byte"),
        ("phong --jobs x", "--jobs: must be a whole number; got x"),
        ("phong -j 1.5", "--jobs: must be a whole number; got 1.5"),
        ("phong --json absent/out.json", "--json: cannot write 'absent/out.json': the folder"),
        ("phong --json .", "--json: cannot write '.': it is a folder"),
        ("phong --json o.xml", "--json: must end in .json; got 'o.xml'"),
        ("phong --sarif o.svg", "--sarif: must end in .sarif or .json; got 'o.svg'"),
        ("phong --junitxml o.txt", "--junitxml: must end in .xml; got 'o.txt'"),
        ("phong --badge o.svg", "--badge: must end in .json; got 'o.svg'"),
        ("phong --junitxml -", "--junitxml: cannot write '-': give the name of a file"),
        ("phong --json same --junitxml ./same", "--json and --junitxml cannot both write to ./same"),
        ("phong --json a.json --sarif a.json", "--json and --sarif cannot both write to a.json"),
        ("phong --html page.txt", "must end in .html or .htm; got 'page.txt'"),
        ("phong --html no/a.html", "--html: cannot write 'no/a.html': the folder"),
    ],
    "view": [("phong --effort quik", "--effort: 'quik'"), ("phong -o page.png", "must end in .html or .htm"), ("", "NAME")],
    "sweep": [("config.toml --dry-run --html a.html", "--html is made of a store that is filled")],
    "audit": [("--effort quik", "--effort: 'quik'"), ("--json absent/out.json", "does not exist"), ("phong", "phong")],
    "list": [("--json absent/out.json", "does not exist"), ("phong", "phong")],
    "certify": [
        ("", "give a BRDF to certify, or --verify FILE"),
        ("fong", "unknown BRDF 'fong'; did you mean phong"),
        ("phong --over n=1:inf:inf", "--over: n=1:inf: must be finite; got inf"),
        ("phong --over n=inf:inf", "--over: n=inf: must be finite; got inf"),
    ],
    "fit": [
        ("", "Missing argument 'NAME'"),
        ("lambert", "lambert has no exponent n to normalise over; it has reflectance"),
        ("ggx", "ggx has no exponent n"),
        ("phon", "unknown BRDF 'phon'; did you mean phong"),
        ("phong --n 5:1", "--n: LO must not exceed HI; got 5 > 1"),
        ("phong --n -1:1", "--n: must lie at 0 or above; got -1:1"),
        ("phong --n a:b", "--n: 'a' is not a number"),
        ("phong --n 1:inf", "--n: must be finite"),
        ("phong --objective best", "--objective: 'best' is not one of 'minimax', 'least-squares', 'reciprocal'"),
        ("phong --sampling random", "--sampling: 'random' is not one of"),
        ("phong --sampling linear", "--sampling goes with --objective least-squares or reciprocal"),
        ("phong --over n=3", "give the exponents with --n"),
        ("phong --over k=3", "has no parameter 'k'"),
        ("phong --export png x.png", "--export: 'png' is not one of 'glsl', 'c', 'csv', 'npy', 'exr'"),
        ("phong --export exr -", "--export exr: cannot write '-': give the name of a file"),
        ("phong --export c", "requires 2 arguments"),
        ("phong --export c absent/a.c", "--export c: cannot write 'absent/a.c'"),
        ("phong --export c - --json -", "--export and --json cannot both write to standard output"),
        ("phong --export npy a --json a.json", "--export and --json cannot both write to a.json"),
        ("phong --json absent/a.json", "--json: cannot write"),
    ],
    "plot": [
        ("", "Missing argument 'KIND'"),
        ("albedo-vs-m phong", "KIND: 'albedo-vs-m' is not one of 'albedo-vs-n', 'albedo-vs-angle', 'heatmap', 'factor'"),
        ("heatmap", "Missing argument 'NAME|FILE"),
        ("heatmap fong", "unknown BRDF 'fong'; did you mean phong"),
        ("heatmap absent.json", "there is no file 'absent.json'"),
        ("heatmap absent.zarr", "there is no file 'absent.zarr'"),
        ("heatmap absent.py:f", "there is no file 'absent.py'"),
        ("heatmap .", "holds no Zarr store"),
        ("heatmap phong -o x.jpg", "--output: must end in .svg, .png or .pdf; got 'x.jpg'"),
        ("heatmap phong -o -", "must end in .svg, .png or .pdf"),
        ("heatmap phong -o absent/x.svg", "does not exist"),
        ("heatmap phong -o x.svg --json ./x.svg", "--json: must end in .json; got './x.svg'"),
        ("heatmap phong --json absent/x.json", "does not exist"),
        ("heatmap phong --scale cubic", "--scale: 'cubic' is not one of 'log', 'linear'"),
        ("heatmap phong --samples 1", "--samples: must be at least 3; got 1"),
        ("heatmap phong --samples 20001", "--samples: must be at most 20000; got 20001"),
        ("heatmap phong --samples x", "--samples: must be a whole number; got x"),
        ("heatmap phong --y 2:1", "--y: LO must not exceed HI; got 2 > 1"),
        ("heatmap phong --y 1", "--y: LO must be below HI; got 1"),
        ("heatmap phong --n 1:2 --over n=1", "--n and --over n=... cannot go together"),
        ("heatmap phong --n 5:1", "--n: LO must not exceed HI; got 5 > 1"),
        ("heatmap phong --n 1,2", "--n: a list of exponents is for albedo-vs-angle; heatmap takes LO:HI"),
        ("heatmap phong --n 3", "needs a range of n"),
        ("heatmap phong --cos-theta 0:2", "within 0:1"),
        ("albedo-vs-angle phong --n 1,x", "--n: 'x' is not a number"),
        ("albedo-vs-angle phong --n -1", "n must be finite and >= 0; got -1"),
        ("albedo-vs-n phong --n 0:9 --scale log", "must start above 0"),
        ("albedo-vs-n phong ggx --samples 3", "one figure has one axis"),
        ("factor ggx", "ggx has no factor"),
        ("albedo-vs-n phong --over m=1:2", "no parameter 'm'"),
    ],
    "study": [
        ("", "say which study"),
        ("raw-albedos", "unknown study 'raw-albedos'; did you mean raw_albedo"),
        ("xyz", "the studies are "),
        ("all raw_albedo", "give 'list', 'all', or study names, not a mixture"),
        ("raw_albedo --size huge", "--size: 'huge' is not one of 'small', 'full'"),
        ("raw_albedo --out=", "--out: must be the name of a folder; got ''"),
        ("raw_albedo --out=a\0b", "--out: must be the name of a folder; got 'ab'"),
        (f"raw_albedo --out {__file__}", "is not a folder"),
    ],
    "render": [
        ("", "say what to render: a preset's name (brdfcheck render --list) or a scene's file"),
        ("furnac -o a.png", "unknown preset 'furnac'; did you mean furnace"),
        ("zzz -o a.png", "unknown preset 'zzz'; the presets are figure-5, "),
        ("figure-5", "-o: say where the picture goes"),
        ("figure-5 -o a.jpg", "--output: must end in .png or .exr; got 'a.jpg'"),
        ("figure-5 -o no/a.png", "--output: cannot write 'no/a.png': the folder"),
        ("figure-5 -o a.png --size 0", "--size: must be SIDE or HEIGHTxWIDTH, whole numbers from 1 to 8192; got '0'"),
        ("figure-5 -o a.png --size 2x3x4", "--size: must be SIDE or HEIGHTxWIDTH, whole numbers from 1 to 8192; got '2x3x4'"),
        ("figure-5 -o a.png --size 99999999999", "whole numbers from 1 to 8192; got '99999999999'"),
        ("figure-5 -o a.png --size 2x3", "--size: a preset is made of squares; give one number of PIXELS, not 2x3"),
        ("figure-5 -o a.png --size 4096 --quality high", "--size: must be at most 2048 pixels at --quality high; got 4096"),
        ("figure-5 -o a.png --quality best", "--quality: 'best' is not one of 'draft', 'normal', 'high'"),
        ("figure-5 -o a.png --bits 12", "--bits: '12' is not one of '8', '16'"),
        ("figure-5 -o a.exr --bits 16", "--bits goes with a .png"),
        ("figure-5 --list", "--list renders nothing"),
        ("none.toml -o a.png", "there is no file 'none.toml'"),
        (".toml -o a.png", ".toml is a folder; give a TOML file"),
        ("binary.toml -o a.png", "binary.toml is not a text file in UTF-8"),
        ("broken.toml -o a.png", "broken.toml is not TOML: "),
    ],
    "budget": [
        ("", "Missing argument 'SCENE.toml'"),
        ("none.toml", "there is no file 'none.toml'"),
        ("none.toml --tolerance x", "--tolerance: 'x' is not a number"),
        ("none.toml --tolerance -1", "--tolerance: must be a number from 0 to 1 or a fraction, as in 0.5/255; got '-1'"),
        ("none.toml --tolerance 1/0", "--tolerance: must be a number from 0 to 1"),
        ("none.toml --tolerance 1/2/3", "--tolerance: must be a number from 0 to 1"),
        ("none.toml -o chart.txt", "--output: must end in .png, .svg or .pdf; got 'chart.txt'"),
        ("none.toml --images x.exr", "--images: must end in .png; got 'x.exr'"),
        ("none.toml --json absent/b.json", "--json: cannot write"),
        ("none.toml --json same.png -o same.png", "--json: must end in .json; got 'same.png'"),
        ("none.toml --size 3", "No such option"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("command", "line", "message"), [(name, *pair) for name, pairs in BAD.items() for pair in pairs])
def test_4_and_one_line_for_bad_words(run: Run, here: Path, command: str, line: str, message: str) -> None:
    (here / ".toml").mkdir()
    (here / "binary.toml").write_bytes(b"\xff\xfe")
    (here / "broken.toml").write_text("size = ")
    before = set(os.listdir(here))
    said = run.refused(*command.split(), *line.split())
    assert message in said
    assert said.isprintable()
    assert set(os.listdir(here)) == before


def test_debug_shows_where_a_word_was_refused(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BRDFCHECK_DEBUG", "1")
    _, _, err = run("check", "phong", "--jobs", "0")
    assert err.startswith("Traceback")
    assert err.splitlines()[-1].startswith("brdfcheck: --jobs: must be at least 1; got 0")


# --- the grammar of ranges, parameters, sizes, shares ---

names = st.from_regex(r"[A-Za-z_][A-Za-z_0-9]{0,8}", fullmatch=True)
numbers = st.floats(allow_nan=False, allow_infinity=False)


@given(names, numbers, numbers)
def test_ranges_are_read_exactly(name: str, first: float, second: float) -> None:
    low, high = sorted((first, second))
    assert words.setting(f"{name}={low!r}:{high!r}") == (name, (low, high))
    assert words.setting(f" {name} = {low!r}") == (name, (low, low))
    assert words.interval(f"{written(low)} : {written(high)}") == (low, high)
    if low < high:
        with pytest.raises(typer.BadParameter, match="LO must not exceed HI"):
            words.interval(f"{high!r}:{low!r}")


@given(st.text(max_size=20))
def test_any_other_text_is_refused_in_one_line(text: str) -> None:
    for parse in (words.setting, words.interval, words.exponent_list, words.share, words.size):
        message = ""
        try:
            parse(text)
        except typer.BadParameter as error:
            message = error.message
        assert message.isprintable()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("n", "must be NAME=LO:HI"),
        ("=1:2", "must be NAME=LO:HI"),
        ("2n=1:2", "must be NAME=LO:HI"),
        ("n=", "must be LO:HI"),
        ("n=1:", "must be LO:HI"),
        ("n=:1", "must be LO:HI"),
        ("n=1:2:3", "must be LO:HI"),
        ("n=one:2", "'one' is not a number"),
        ("n=nan:2", "must be finite; got nan"),
        ("n=1:inf", "must be finite; got inf"),
        ("n=5:1", "5 > 1"),
    ],
)
def test_bad_ranges_say_what_is_allowed(text: str, message: str) -> None:
    with pytest.raises(typer.BadParameter, match=message):
        words.setting(text)


def test_small_grammars() -> None:
    assert words.within(0, 1)("0.1:1") == (0.1, 1.0)
    assert words.within(0)("3") == (3.0, 3.0)
    assert words.exponent_list("10,1,10,2") == ((1.0, 10.0), (10.0, 1.0, 2.0))
    assert words.exponent_list("1:9") == ((1.0, 9.0), None)
    assert words.share("0.5/255") == 0.5 / 255
    assert words.share("1") == 1
    assert math.isclose(words.share("-1/-2"), 0.5)
    assert words.size("384x512") == (384, 512)
    assert words.size("64") == (64, 64)
    assert words.together(None) == {}
    with pytest.raises(UsageError, match="'n' is given twice"):
        words.together([words.setting("n=1:2"), words.setting("n=3")])


# --- help and version ---


@pytest.mark.parametrize("command", ["", *COMMANDS])
@pytest.mark.parametrize("option", ["--help", "-h"])
def test_help_has_examples_and_what_is_allowed(run: Run, command: str, option: str) -> None:
    out = run.silent(*command.split(), option)
    assert "Examples:" in out
    assert f"  brdfcheck {command or 'check'}" in out
    assert max(map(len, out.splitlines())) <= 100
    assert "..." not in out.partition("Options:")[2].partition("  Examples:")[0]  # nothing is cut off
    allowed = {
        "check": ("<quick|normal|thorough>", "0<=x<=0.5", "[x>=1]"),
        "fit": ("<minimax|least-squares|reciprocal>", "<geometric|linear|integers>", "glsl|c|csv|npy|exr FILE"),
        "plot": ("<log|linear>", "3<=x<=20000", "albedo-vs-angle"),
        "render": ("<draft|normal|high>", "<8|16>", "HEIGHTxWIDTH"),
        "study": ("<small|full>",),
        "budget": ("[matters]", "0.5/255"),
    }
    for text in allowed.get(command, ()):
        assert text in out


def test_nothing_heavy_is_imported_to_read_words() -> None:
    codes = {
        "--version": 0, "check --help": 0, "chekc": 4, "check --frob": 4, "plot pie phong": 4, "check phong --over n=1:x": 4,
        "render figure-5 -o a.png --size x": 4,
    }  # fmt: skip
    program = f"import sys\nfrom brdfcheck import cli\nfor line, code in {codes!r}.items():\n"
    program += "    assert cli.run(line.split()) == code, line\n"
    program += "    assert not {'jax', 'numpy', 'matplotlib', 'scipy'} & set(sys.modules), line\n"
    code, out, err = python("-c", program)
    assert code == 0, err
    assert out.startswith(f"brdfcheck {brdfcheck.__version__}\n")


def test_every_command_is_asked_here() -> None:
    assert tuple(command.name for command in cli.app.app.registered_commands) == COMMANDS


def test_the_choices_are_those_of_what_does_the_work() -> None:
    """They are written down again, so that they can be read without importing it."""
    from brdfcheck import plots, studies
    from brdfcheck.cli import check, fit, plot, render, study
    from brdfcheck.fits import factor
    from brdfcheck.output import table_files
    from brdfcheck.scene import canvas
    from brdfcheck.verdict import supremum

    assert get_args(get_args(get_args(check.Effort)[0])[0]) == tuple(supremum.EFFORTS)
    assert get_args(fit.Objective) == tuple(factor.OBJECTIVES)
    assert get_args(fit.Sampling) == tuple(factor.SAMPLINGS)
    assert tuple(fit.Kind) == ("glsl", "c", *table_files.KINDS)
    assert get_args(plot.Kind) == tuple(plots.KINDS)
    assert get_args(render.Quality) == tuple(canvas.QUALITIES)
    assert get_args(study.Size) == studies.SIZES
