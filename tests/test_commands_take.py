"""What `check` takes, every command takes: functions of arrays and of one pair, shaders with options, files that do not fit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray
from shared import Run, picture

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.cli import ExitCode
from brdfcheck.messages import UsageError
from brdfcheck.scene import images, presets
from brdfcheck.scene.functions import brdf_of
from brdfcheck.scene.materials import Term
from brdfcheck.scene.white_furnace import furnace_excess, furnace_largest
from brdfcheck.sweep import Plan
from brdfcheck.sweep.config import parse, read_config

MINE = """
import math, brdfcheck
import jax.numpy as jnp

def pair(wi, wo, n=10):
    c = wi[2] * wo[2] - wi[0] * wo[0] - wi[1] * wo[1]
    return (n + 2) / (2 * math.pi) * c**n if c > 0 else 0.0

def bright(wi, wo):
    return 1.25 / math.pi if wi[2] > 0 else 0.0

def loop(wi, wo):
    return math.fabs(0.5) / math.pi

def rgb(wi, wo):
    return [0.2 / math.pi, 0.4 / math.pi, 1.1 / math.pi]

class Matt:
    def __init__(self, k):
        self.k = k
    def eval(self, wi, wo):
        return self.k / math.pi + 0 * wi[2]

def rendered(wi, wo):
    return wi[..., 2] / math.pi

def broken(wi, wo):
    return wi[..., 2] * undefined_name

@brdfcheck.bsdf
def paper(wi, wo, through):
    return jnp.where(wi[..., 2] * wo[..., 2] < 0, through, 1 - through) / math.pi
"""
SHADER = """
uniform float k = 0.5;
vec3 f(vec3 a, vec3 b) { return vec3(k / 3.141592653589793 * GAIN * b.z); }
"""
SWITCHED = """\
analytic
::begin parameters
bool half 0
::end parameters
::begin shader
vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y) { return vec3(half ? 0.1 : 0.2); }
::end shader
"""
OPTIONS = ("--args", "V,L", "--returns", "brdf*cos", "-D", "GAIN=1.0")


@pytest.fixture
def files(here: Path) -> Path:
    (here / "mine.py").write_text(MINE)
    (here / "lobe.glsl").write_text(SHADER)
    return here


# --- render ---


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("mine.py:pair", ("--set", "n=5")),
        pytest.param("mine.py:Matt", ("--set", "k=0.5"), marks=pytest.mark.slow),
        pytest.param("mine.py:rendered", ("--returns", "brdf*cos"), marks=pytest.mark.slow),
        pytest.param("lobe.glsl:f", OPTIONS, marks=pytest.mark.slow),
        ("mine.py:paper", ("--set", "through=0.5")),
        pytest.param("dielectric", ("--set", "eta=1.5"), marks=pytest.mark.slow),
    ],
)
def test_a_sphere_and_a_furnace_of_any_brdf(run: Run, files: Path, name: str, options: tuple[str, ...]) -> None:
    for kind in ("sphere", "furnace"):
        words = ("--brdf", name, *options, "--size", "12", "--quality", "draft", "-o", f"{kind}.png")
        assert "wrote" in run.silent("render", kind, *words)
    sphere = picture(files / "sphere.png")
    assert sphere.shape == (12, 12, 3)
    assert sphere.max() > 60


@pytest.mark.parametrize("n", [4.0, pytest.param(30.0, marks=pytest.mark.slow), 500.0])
def test_a_highlight_is_seen_whole(run: Run, here: Path, n: float) -> None:
    def render(target: str) -> str:
        words = ("--brdf", "phong", "--set", f"n={n}", "--size", "96", "--quality", "draft", "-o", target)
        return run.passed("render", "sphere", *words)

    said = render("s.png")
    shown = picture(here / "s.png")[..., 0]
    assert shown.max() == 255
    assert np.count_nonzero(shown == 255) <= 0.2 * np.count_nonzero(shown > 127), "no disc of white"
    assert len(np.unique(shown)) > 15
    assert "so that it is darkened" in said
    import OpenEXR

    render("s.exr")
    with OpenEXR.File(str(here / "s.exr")) as file:
        numbers = file.channels()["RGB"].pixels[..., 0]
    assert numbers.max() > n / 4, "the numbers themselves are not touched"
    assert f"{numbers.max():.3g} times as bright as a matt white sphere" in said
    # The order of brightness stays, and what is below 1 is in proportion to what it was.
    order = np.argsort(numbers, axis=None, kind="stable")
    assert np.all(np.diff(shown.ravel()[order].astype(int)) >= 0)
    tail = (numbers > 0.05) & (numbers < 1)
    ratio = images.tone_mapped(np.stack([numbers] * 3))[0][0][tail] / numbers[tail]
    assert np.ptp(ratio) < 1e-6
    assert ratio.max() >= 0.5 - 1e-6


def test_a_matt_sphere_is_shown_as_it_is(run: Run, here: Path) -> None:
    words = ("--brdf", "lambert", "--set", "reflectance=1", "--size", "24", "--quality", "draft", "-o", "s.png")
    assert "darkened" not in run("render", "sphere", *words)[1]
    lit = presets.render_brdf("sphere", brdf_of("lambert", {"reflectance": 1.0}), "", 24, "draft")
    np.testing.assert_array_equal(picture(here / "s.png").reshape(24, 24, 3), images.codes(lit))


def test_the_tone_curve_is_continuous() -> None:
    row = np.broadcast_to(np.linspace(0, 1, 9, dtype=np.float32), (3, 1, 9))
    for most in (0.5, 1.0, 1.5, 2.0, 2.0001, 3.0, 1e6):
        found, measured = images.tone_mapped(row * np.float32(most))
        assert measured == pytest.approx(most)
        assert found.max() == pytest.approx(min(most, 1.0), rel=1e-6)
    just_above, two = images.tone_mapped(row * np.float32(2.0001))[0], images.tone_mapped(row * np.float32(2))[0]
    np.testing.assert_allclose(just_above, two, atol=1e-3)
    colored = np.array([3.0, 1.5, 0.3], np.float32).reshape(3, 1, 1)
    mapped = images.tone_mapped(colored)[0].ravel()
    np.testing.assert_allclose(mapped / mapped[0], [1, 0.5, 0.1], rtol=1e-5)


def test_a_furnace_shows_what_is_reflected(files: Path) -> None:
    for name, expected in (("bright", 1.25), ("loop", 0.5), ("rgb", [0.2, 0.4, 1.1])):
        brdf = brdf_of(f"{files}/mine.py:{name}", {})
        excess, covered = furnace_excess(brdf, {}, 7)
        middle = excess[..., 3, 3]
        np.testing.assert_allclose(middle, np.array(expected) - 1, atol=1e-4)
        assert covered[3, 3] == 1
        assert furnace_largest(brdf) == pytest.approx(np.max(expected), abs=1e-4)
        image = presets.render_brdf("furnace", brdf, name, 7, "draft")
        assert image.shape[0] == 3
    # A name is what it is for `check`.
    assert furnace_largest(f"{files}/mine.py:loop") == pytest.approx(0.5, abs=1e-4)
    assert furnace_largest("Lambert", {"reflectance": 0.4}) == pytest.approx(0.4, abs=1e-4)
    with pytest.raises(KeyError, match="these are sphere, furnace"):
        presets.render_brdf("cube", brdf, name)


def test_a_furnace_calls_a_function_of_numpy_for_many_pixels_at_once() -> None:
    sizes = []

    def matt(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        sizes.append(len(wi))
        return np.where(np.asarray(wi)[..., 2] > 0, 0.25, 0.0)

    brdf = brdf_of(matt, {})
    sizes.clear()
    excess, _ = furnace_excess(brdf, {}, 48)
    assert excess[24, 24] == pytest.approx(np.pi / 4 - 1, abs=1e-4)
    assert np.mean(sizes) > 4 * 8192  # the directions of one pixel


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("sphere",), "sphere: say of which BRDF, as in --brdf mine.py:glossy"),
        (("sphere", "--brdf", "Phong"), "Phong: the parameter n must be given as a number: --set n=VALUE"),
        (("mine.py:pair",), "mine.py:pair is no preset: say how to show it, as in render sphere --brdf mine.py:pair"),
        (("sphere", "--brdf", "phong", "--set", "n=1", "--set", "n=2"), "--set: the parameter 'n' is given twice"),
        (("sphere", "--brdf", "phong", "--set", "n=x"), "--set: n=x: 'x' is not a number"),
        (("phong",), "phong is no preset: say how to show it, as in render sphere --brdf phong"),
        (("sphere", "--brdf", "phong", "--set", "n=1:5"), "--set n=1:5: a picture is of one BRDF; give n one value"),
        (("sphere", "--brdf", "mine.py:pair", "--set", "q=1"), "mine.py:pair has no parameter 'q'; its parameters: n"),
        (("sphere", "--brdf", "mine.py:pair", "-D", "X"), "-D, -I and --args are for shader files; mine.py:pair is Python"),
        (("furnace", "--brdf", "mine.py:broken"), "NameError: name 'undefined_name' is not defined (mine.py:28)"),
        (
            ("furnace", "--brdf", "thing.xyz"),
            "there is no reader for files that end in '.xyz'; a BRDF of your own is read from",
        ),
        (("sphere", "--brdf", "dielectric", "--set", "eta=1.5", "--set", "below=1"), "below is for the white furnace"),
        (("lobes", "--brdf", "phong"), "--brdf goes with sphere or furnace; got 'lobes'"),
        (("lobes", "--set", "n=1"), "--set goes with --brdf"),
        (("scene.toml", "--returns", "brdf*cos"), "-D, -I, --args and --returns go with --brdf; a scene says it in its file"),
        (("sphere", "--brdf", "phong", "--set", "n=1", "--size", "2x3"), "a preset is made of squares"),
    ],
)
def test_what_a_picture_refuses(run: Run, files: Path, words: tuple[str, ...], message: str) -> None:
    assert message in run.refused("render", *words, "-o", "x.png")
    assert not (files / "x.png").exists()


def test_a_scene_says_how_a_file_is_read(run: Run, files: Path) -> None:
    reading = 'reading = { returns = "brdf*cos", args = "V,L", defines = { GAIN = "2.0" } }'
    lights = '[[lights]]\nkind = "distant"\ndirection = [0, 0, 1]\nintensity = 3.141592653589793\n'
    terms = f'terms = [{{ brdf = "lobe.glsl:f", k = 0.25, {reading} }}]\n'
    text = f'allow_unvalidated = true\nsize = 3\n[material]\nkind = "surface"\n{terms}{lights}'
    (files / "scene.toml").write_text(text)
    run.silent("render", "scene.toml", "--quality", "draft", "-o", "scene.exr")
    how = Reading({"GAIN": "2.0"}, (), ("V", "L"), "brdf*cos")
    term = Term(f"{files}/lobe.glsl:f", k=0.25, reading=how)
    assert term.brdf(np.array([0.6, 0, 0.8]), np.array([0, 0, 1.0]))[0] == pytest.approx(0.5 / np.pi)
    with pytest.raises(UsageError, match="--returns is for functions in files; got phong"):
        Term("phong", n=3, reading=Reading(returns="brdf*cos"))
    (files / "wrong.toml").write_text(text.replace("brdf*cos", "cos"))
    message = "material.terms[0].reading.returns: must be one of 'brdf' or 'brdf*cos'"
    assert message in run.refused("render", "wrong.toml", "-o", "x.png")


def test_a_scene_of_glass(run: Run, files: Path) -> None:
    text = 'size = 4\nbackground = 0.5\nallow_unvalidated = true\nlights = [{ kind = "ambient" }]\n'
    text += '[material]\nkind = "surface"\nterms = [{ brdf = "dielectric", eta = 1.5 }]\n'
    (files / "scene.toml").write_text(text)
    run.silent("render", "scene.toml", "--quality", "draft", "-o", "scene.png")
    assert np.ptp(picture(files / "scene.png").astype(int)) < 4  # before a uniform ground a clear ball is not seen
    (files / "scene.toml").write_text(text + '[geometry]\nkind = "icosphere"\nlevel = 1\n')
    assert "SmoothDielectric sends light on in one direction" in run.refused("render", "scene.toml", "-o", "x.png")


# --- sweep ---


def swept(run: Run, files: Path, text: str, *words: str) -> np.ndarray:
    (files / "config.toml").write_text(text)
    run.passed("sweep", "config.toml", "--out", "store.zarr", *words)
    return xarray.open_zarr("store.zarr").albedo.values


def test_a_sweep_of_a_shader_with_options(run: Run, files: Path) -> None:
    text = 'brdf = "lobe.glsl:f"\n[axes]\nk = [0.25, 0.5]\ncos_theta = [0.5, 1]\n'
    table = '[reading]\nreturns = "brdf*cos"\nargs = "V,L"\ndefines = { GAIN = "1.0" }\n'
    found = swept(run, files, text, *OPTIONS)
    np.testing.assert_allclose(found, np.broadcast_to([[[0.25]], [[0.5]]], (2, 2, 3)), rtol=1e-7)
    # The same, said in the file, is the same sweep.
    (files / "config.toml").write_text(text + table)
    assert "4 were there" in run.passed("sweep", "config.toml", "--out", "store.zarr")
    document = read_config("config.toml").document()
    assert document["reading"] == {"returns": "brdf*cos", "args": "V,L", "defines": {"GAIN": "1.0"}}
    assert parse(document, folder=files).document() == document
    again = ("sweep", "config.toml", "--returns", "brdf*cos")
    assert "say it, too; leave out one of them" in run.refused(*again, "--out", "store.zarr")
    run.refused(*again, "--out", "other.zarr", "-D", "GAIN=2")


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("half = false", None),
        ("half = [true, false]", None),
        ("half = 0.5", "half is a bool: 0, 1 or 0:1; got 0.5"),
        ('half = "x"', "a.brdf: half takes numbers; got 'x'"),
    ],
)
def test_a_sweep_of_a_switch(run: Run, files: Path, value: str, told: str | None) -> None:
    (files / "a.brdf").write_text(SWITCHED)
    (files / "config.toml").write_text(f'brdf = "a.brdf"\n[axes]\n{value}\ncos_theta = 1\n')
    words = ("sweep", "config.toml", "--out", "s.zarr", "--dry-run")
    assert run.passed(*words) if told is None else told in run.refused(*words)


NAMES = """
import jax.numpy as jnp

def cos_theta(cos_theta):
    return lambda wi, wo: cos_theta / jnp.pi + 0 * wi[..., 2]

def target(target):
    return lambda wi, wo: target / jnp.pi + 0 * wi[..., 2]

def azimuth(azimuth):
    return lambda wi, wo: azimuth / jnp.pi + 0 * wi[..., 2]

def whole(wi, wo, n: int = 3):
    return sum(wi[..., 2] * 0 + 0.1 for _ in range(n)) / jnp.pi
"""


def test_parameters_that_are_called_like_something_else(run: Run, files: Path) -> None:
    (files / "names.py").write_text(NAMES)
    for name in ("cos_theta", "target"):
        out = run.passed("certify", f"names.py:{name}", "--over", f"{name}=0.5:0.7", "--seconds", "0.5")
        assert f"for every {name} from 0.5 to 0.7" in out
    (files / "config.toml").write_text('brdf = "names.py:azimuth"\n[axes]\ncos_theta = 1\nazimuth = [0.5, 0.7]\n')
    told = run.refused("sweep", "config.toml", "--out", "s.zarr", "--dry-run")
    assert "the axis azimuth is that of incidence; rename the parameter" in told


def test_a_fit_over_whole_numbers_says_so(run: Run, files: Path) -> None:
    (files / "names.py").write_text(NAMES)
    told = run.refused("fit", "names.py:whole")
    assert "names.py:whole: n is a whole number" in told
    assert "as in --n 3" in told
    run.passed("fit", "names.py:whole", "--n", "3")


def test_a_scene_gives_a_vector_its_numbers(files: Path) -> None:
    (files / "v.glsl").write_text("uniform vec3 ks;\nvec3 f(vec3 L, vec3 V) { return ks / 3.141592653589793; }\n")
    term = Term(f"{files}/v.glsl", ks=(1, 0.5, 0.25))
    up = np.array([[0.0, 0.0, 1.0]])
    np.testing.assert_allclose(np.pi * term.brdf(up, up), [[1, 0.5, 0.25]], rtol=1e-6)
    with pytest.raises(ValueError, match="ks has 3 components; got 2 numbers"):
        Term(f"{files}/v.glsl", ks=[1, 0.5])


def test_a_sweep_of_functions_of_one_pair_by_a_rule(files: Path) -> None:
    by_rule = {"brdf": "mine.py:pair", "rule": "gauss-product:16", "axes": {"n": [10.5], "cos_theta": [1]}}
    assert Plan(parse(by_rule, folder=files)).channels is None
    with pytest.raises(UsageError, match="--returns is for functions in files; got phong"):
        Plan(parse({"brdf": "phong", "axes": {"n": [1], "cos_theta": [1]}, "reading": {"returns": "brdf*cos"}}))


# --- plot and fit ---


def test_a_switch_has_a_curve_at_its_ends_and_none_between(run: Run, files: Path) -> None:
    (files / "a.brdf").write_text(SWITCHED)
    out = run.passed("plot", "albedo-vs-angle", "a.brdf", "--cos-theta", "1", "--samples", "3", "-o", "a.svg")
    assert [line.split()[1] for line in out.splitlines()[:-1]] == ["half=0", "half=1"]


def test_both_sides_of_what_transmits_are_plotted_and_a_table_says_which_it_holds(run: Run, files: Path) -> None:
    for kind in ("albedo-vs-n", "heatmap"):
        out = run.passed("plot", kind, "thin-sheet", "--over", "index=1.5", "--samples", "3", "-o", "a.svg")
        assert [line.split("  ")[0] for line in out.splitlines()[:-1]] == ["thin-sheet below=0", "thin-sheet below=1"]
    several = "index, clear run over ranges; hold all but one, as in --over clear=VALUE"
    assert several in run.refused("plot", "albedo-vs-n", "thin-sheet", "-o", "b.svg")
    out = run.passed("table", "thin-sheet", "--over", "clear=0.2:0.8", "--over", "index=1.5", "--size", "2x2", "-o", "t.csv")
    assert "note         below is held at 0" in out
    (files / "config.toml").write_text('brdf = "thin-sheet"\n[axes]\nindex = 1.5\nclear = 0.5\ncos_theta = 1\n')
    assert "needs an axis below, as in below = [0, 1] or below = 1" in run("sweep", "config.toml", "--dry-run")[2]


def test_a_plot_of_what_holds_the_cosine(run: Run, files: Path) -> None:
    words = ("--returns", "brdf*cos", "--cos-theta", "0.2:0.5", "--samples", "3", "-o", "a.svg")
    out = run.passed("plot", "albedo-vs-angle", "mine.py:rendered", *words)
    assert "mine.py:rendered  nowhere above 1  largest 1 at" in out


@pytest.mark.slow
def test_a_fit_is_plotted_as_it_was_made(run: Run, files: Path) -> None:
    (files / "s.glsl").write_text("float f(vec3 L, vec3 V, float n, float k) { return k * pow(V.z, n) * L.z * L.z; }")
    held = ("--n", "1:2", "--set", "k=1", "--returns", "brdf*cos", "--json", "fit.json")
    assert run("fit", "s.glsl", *held)[0] in (ExitCode.PASSED, ExitCode.FAILED)
    run.passed("plot", "albedo-vs-n", "fit.json", "--samples", "3", "-o", "a.svg", "--json", "a.json")
    largest = float(json.loads((files / "fit.json").read_text())["results"][0]["peak"])
    assert max(map(float, json.loads((files / "a.json").read_text())["results"][0]["albedo"])) == pytest.approx(
        largest, abs=1e-6
    )


# --- tracebacks ---


def test_debug_shows_where_a_function_failed(run: Run, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code, out, err = run("check", "mine.py:broken")
    assert (code, err) == (ExitCode.FAILED, "")
    assert "finding: mine.py:broken: broken raised NameError: name 'undefined_name' is not defined (mine.py:28)" in out
    code, _, err = run("check", "mine.py:broken", "--debug")
    assert code == ExitCode.FAILED
    assert "Traceback" in err
    assert "return wi[..., 2] * undefined_name" in err
    assert "Traceback" not in run("check", "mine.py:broken")[2]
    assert (
        "return wi[..., 2] * undefined_name" in run("render", "sphere", "--brdf", "mine.py:broken", "-o", "x.png", "--debug")[2]
    )
    monkeypatch.setenv("BRDFCHECK_DEBUG", "1")
    assert "Traceback" in run("check", "mine.py:broken")[2]
