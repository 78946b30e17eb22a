"""Figures: what they say, that nothing collides or is cut off, and that their bytes do not change."""

from __future__ import annotations

import io
import itertools
import math
import re
import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from selection import few
from shared import ROOT, python

from brdfcheck import plots
from brdfcheck.brdf import catalog
from brdfcheck.plots import panels, paper
from brdfcheck.plots.styles import DASHES, FITS, LOBES, VARIANTS, ink, style_of, styles


def exponent_curve(name="phong", values=None, above=(), x=None, **changes):
    x = np.geomspace(1, 1000, 40) if x is None else x
    values = np.full(len(x), 0.9) if values is None else values
    return {
        "kind": "albedo-vs-n", "name": name, "label": None, "parameter": "n", "range": [float(x[0]), float(x[-1])],
        "cos_theta": [0.0, 1.0], "x": list(x), "albedo": [float(value) for value in values], "held": {},
        "above": [list(interval) for interval in above],
        "largest": {"albedo": float(np.nanmax(values)), "at": {"n": float(x[0])}, "cos_theta": 1.0}, **changes,
    }  # fmt: skip


def angle_curve(name="phong", n=10.0, above=(), **changes):
    mu = np.linspace(0, 1, 30)
    return {
        "kind": "albedo-vs-angle", "name": name, "label": None, "parameter": None, "range": None, "at": {"n": n},
        "cos_theta": [0.0, 1.0], "x": mu.tolist(), "albedo": (0.2 + mu).tolist(), "above": [list(a) for a in above],
        "largest": {"albedo": 1.2, "at": {"n": n}, "cos_theta": 1.0}, **changes,
    }  # fmt: skip


def heat_curve(name="phong", top=1.3):
    x, mu = np.geomspace(1, 1000, 12), np.linspace(0, 1, 9)
    values = top * np.outer(np.linspace(0.3, 1, 12), 0.2 + 0.8 * mu)
    return {
        "kind": "heatmap", "name": name, "label": None, "parameter": "n", "range": [1.0, 1000.0], "cos_theta": [0.0, 1.0],
        "x": x.tolist(), "cosines": mu.tolist(), "albedo": values.tolist(), "above": [[200.0, 1000.0]] if top > 1 else [],
        "largest": {"albedo": top, "at": {"n": 1000.0}, "cos_theta": 1.0},
    }  # fmt: skip


def texts(figure):
    root = ElementTree.fromstring(plots.to_bytes(figure, ".svg"))
    return ["".join(node.itertext()) for node in root.iter("{http://www.w3.org/2000/svg}text")]


PUBLISHED = exponent_curve("binomial-power-published", np.linspace(0.8, 1.1, 40), [(14.303005, 23.056068)])


# --- styles ---


def test_every_entry_of_the_catalogue_has_its_own_style():
    assert set(VARIANTS) == set(catalog.names())
    assert len({style_of(name)[:2] for name in VARIANTS}) == len(VARIANTS)
    assert len({marker for _, marker in LOBES.values()}) == len(LOBES)
    assert len(set(DASHES)) == len(DASHES)
    assert not set(DASHES) & set(FITS.values())


# Machado, Oliveira & Fernandes 2009, severity 1: how a colour looks to the colour-blind.
_VISION = {
    "all": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(color):
    parts = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    matrix = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = matrix @ np.clip(rgb, 0, 1) / np.array([0.9505, 1, 1.089])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", list(_VISION))
def test_colours_of_lobes_stay_apart_for_everyone(vision):
    seen = {name: lab(np.array(_VISION[vision]) @ linear(color)) for name, (color, _) in LOBES.items()}
    for one, other in itertools.combinations(seen, 2):
        assert np.linalg.norm(seen[one] - seen[other]) > 15, (one, other)  # a difference of 2 can just be seen


def contrast(color):
    return 1.05 / (0.05 + float(np.array([0.2126, 0.7152, 0.0722]) @ linear(color)))


def test_colours_show_on_paper():
    for color, _ in LOBES.values():
        assert contrast(color) > 2
        assert contrast(ink(color)) > 4.5  # WCAG AA for text


def test_a_style_is_for_life():
    alone, beside = styles(["mine.py:a"])["mine.py:a"], styles(["phong", "mine.py:b", "mine.py:a"])["mine.py:a"]
    assert alone == beside == style_of("/some/where/mine.py:a")
    assert style_of("lyon-1-half, minimax")[::2] == style_of("lyon-1-half")[::2]
    many = styles([f"mine.py:f{i}" for i in range(60)])
    assert len(set(many.values())) == 60
    assert {style.color for style in many.values()}.isdisjoint(color for color, _ in LOBES.values())


# --- what a figure says ---


def test_the_interval_is_labelled_with_its_ends():
    figure = plots.figure("albedo-vs-n", [PUBLISHED])
    said = texts(figure)
    assert any(text.startswith("14.303 … 23.056") for text in said)
    assert "binomial-power-published" in said
    assert "exponent n" in said
    axes = figure.axes[0]
    assert any(np.allclose(line.get_ydata(), 1) and len(line.get_xdata()) == 2 for line in axes.lines)  # the line at 1
    assert axes.collections  # what is above it is shaded
    spans = [patch.get_x() for patch in axes.patches]
    assert any(np.isclose(spans, 14.303005))


def test_edges_several_intervals_and_everything():
    several = exponent_curve("phong", np.linspace(0.9, 1.2, 40), [(1, 2.5), (10, 20), (500, 1000)])
    said = texts(plots.figure("albedo-vs-n", [several]))
    assert "1 (edge) … 2.5" in said
    assert "10 … 20" in said
    assert "500 … 1000 (edge)" in said
    whole = exponent_curve("phong", np.full(40, 1.2), [(1, 1000)])
    assert any(text.startswith("1 … 1000 (all)") for text in texts(plots.figure("albedo-vs-n", [whole])))
    wild = exponent_curve("phong", np.linspace(0.9, 1.2, 40), [(10 + 40 * i, 25 + 40 * i) for i in range(20)])
    said = texts(plots.figure("albedo-vs-n", [wild]))
    assert any(text.startswith("20 intervals: 10 … 25, …, 770 … 785") for text in said)


def test_two_that_violate_are_named_once():
    other = exponent_curve("blinn-phong-8", np.linspace(1.0, 1.2, 40), [(1, 1000)])
    said = texts(plots.figure("albedo-vs-n", [PUBLISHED, other, exponent_curve()]))
    assert said.count("binomial-power-published") == 1  # beside the curve; the strip has a sample of its line
    assert said.count("phong") == 1


def test_one_that_violates_has_no_sample_without_a_name():
    other = exponent_curve("blinn-phong-8", np.linspace(1.0, 1.2, 40), [(1, 1000)])
    for curves, count in (([PUBLISHED, exponent_curve()], 0), ([PUBLISHED, other, exponent_curve()], 2)):
        figure = plots.figure("albedo-vs-n", curves)
        strip = figure.axes[1]
        samples = [line for line in strip.get_lines() if not line.get_transform().contains_branch(strip.transData)]
        assert len(samples) == 2 * count, "a piece of the line and its marker"


def test_what_leaves_the_axis_is_said():
    huge = exponent_curve("binomial-power-unclamped", np.geomspace(0.9, 1e28, 40), [(50, 1000)])
    figure = plots.figure("albedo-vs-n", [huge, exponent_curve()])
    assert figure.axes[0].get_ylim()[1] == paper.TOP
    assert any("axis cut at 6: binomial-power-unclamped reaches 10²⁸ at n = 1000" in text for text in texts(figure))
    many = [exponent_curve(f"mine.py:f{i}", np.geomspace(0.9, 10.0 ** (2 + i), 40), [(50, 1000)]) for i in range(9)]
    assert any("and 5 more curves leave it" in text for text in texts(plots.figure("albedo-vs-n", many)))


def test_an_albedo_without_bound_has_no_largest_sample():
    pole = angle_curve("mine.py:pole", above=[(0.0, 1.0)])
    pole["albedo"] = [1e9, *np.linspace(872, 1, 29).tolist()]
    pole["largest"]["albedo"] = "Infinity"
    said = texts(plots.figure("albedo-vs-angle", [pole]))
    assert any("mine.py:pole, n = 10 grows without bound towards cos θ = 0" in text for text in said)
    assert not any("reaches" in text for text in said)


@pytest.mark.parametrize("curve", [exponent_curve(), angle_curve(above=[(0.0, 1.0)])], ids=["plain", "strip"])
def test_a_long_title_stays_within_the_figure(curve):
    figure = plots.figure(curve["kind"], [curve], title="Albedos of lobes and of their factors " * 4)
    figure.draw_without_rendering()
    (title,) = [axes.title for axes in figure.axes if axes.get_title()]
    extent = title.get_window_extent()
    assert title.get_text().count("\n") >= 1
    assert figure.bbox.x0 <= extent.x0 < extent.x1 <= figure.bbox.x1
    assert extent.y1 <= figure.bbox.y1


def test_few_colours_keep_the_colour_of_a_small_patch():
    from matplotlib.patches import Patch
    from PIL import Image

    with paper.house_style():  # a legend on a page of one hue, on which many words have edges of many colours
        figure = paper.empty(8, 8)
        axes = figure.subplots()
        axes.imshow(np.indices((40, 40)).sum(axis=0) % 7 > 2, cmap="Greens", vmin=-3, vmax=6)
        for i in range(12):
            axes.text(2, 3 * i, "some words in a figure " * 3, color=f"C{i % 3}", fontsize=7 + i / 2)
        figure.legend(handles=[Patch(facecolor="#882255")], labels=["lies"], loc="lower left")
    png = plots.to_bytes(figure, ".png", widest=1200)
    before, after = (
        np.asarray(Image.open(io.BytesIO(file)).convert("RGB"), int) for file in (png, plots.with_few_colours(png))
    )
    patch = (before == (0x88, 0x22, 0x55)).all(axis=-1)
    assert np.sum(patch) > 100
    assert np.abs(after[patch] - (0x88, 0x22, 0x55)).max() <= 20  # it was 35 off


def test_a_page_s_svg_draws_the_same_in_less_space():
    long, short = (plots.to_bytes(plots.figure("albedo-vs-n", [PUBLISHED]), ".svg", widest=w) for w in (None, 1200))

    def drawn(svg: bytes) -> list[tuple[str, dict[str, str], str]]:
        """Every element with its style and its commands, each written out, and its text."""
        root = ElementTree.fromstring(svg)
        (rules,) = (element for element in root.iter() if element.tag.endswith("style"))
        styles = dict(re.findall(r"\.(s\d+)\{([^}]*)\}", rules.text or ""))
        rules.text, found = "", []
        named = set(re.findall(r'#([^")]+)[")]', svg.decode()))
        ids = [element.get("id", "") for element in root.iter()]
        places = {name: place for place, name in enumerate(name for name in ids if name in named)}
        for element in root.iter():
            given = {key: re.sub(r"#([^)]+)", lambda m: f"#{places.get(m[1], m[1])}", text) for key, text in element.items()}
            given.pop("id", None)
            if "class" in given:
                given["style"] = styles[given.pop("class")]
            if "d" in given:
                commands = re.findall(r"([A-Za-z])([^A-Za-z]*)", given["d"])
                pairs = [(name, numbers.split()) for name, numbers in commands]
                # What follows a move's pair of numbers are lines.
                given["d"] = str([
                    ("L" if name == "M" and k else name, numbers[k : k + 2])
                    for name, numbers in pairs for k in range(0, max(len(numbers), 1), 2)
                ])  # fmt: skip
            found.append((element.tag, given, (element.text or "").strip()))
        return found

    rounded = re.sub(rb' (?:d|x|y)="[^"]*"', lambda part: re.sub(rb"(\.\d)\d+", rb"\1", part[0]), long)
    assert drawn(short) == drawn(rounded)
    assert len(short) < 0.7 * len(rounded)
    names = re.findall(rb' id="([^"]*)"', short)
    assert set(re.findall(rb'#([\w-]+)[")]', short)) == set(names)
    assert b"style=" not in short


def test_limits_and_scale():
    figure = plots.figure("albedo-vs-n", [PUBLISHED], scale="linear", limits=(0.99, 1.02), title="Zoom")
    assert figure.axes[0].get_ylim() == (0.99, 1.02)
    assert figure.axes[0].get_xscale() == "linear"
    assert "Zoom" in texts(figure)
    assert plots.figure("albedo-vs-n", [PUBLISHED]).axes[0].get_xscale() == "log"
    from_zero = exponent_curve(x=np.linspace(0, 10, 9), values=np.full(9, 0.5))
    assert plots.figure("albedo-vs-n", [from_zero]).axes[0].get_xscale() == "linear"
    with pytest.raises(ValueError, match="must start above 0"):
        plots.figure("albedo-vs-n", [from_zero], scale="log")


def test_a_single_exponent_is_a_marker():
    one = exponent_curve(x=np.array([17.0]), values=np.array([1.2]), above=[(17, 17)])
    figure = plots.figure("albedo-vs-n", [one])
    low, high = figure.axes[0].get_xlim()
    assert low < 17 < high
    assert any(text.startswith("17, up to 1.2") for text in texts(figure))


def test_angles_run_to_grazing_with_degrees():
    figure = plots.figure("albedo-vs-angle", [angle_curve(n=n, above=[(0.8, 1.0)]) for n in (1.0, 10.0, 100.0)])
    axes = figure.axes[0]
    assert axes.get_xlim() == (1, 0)
    said = texts(figure)
    assert {"0°", "60°", "90°", "n = 1", "n = 10", "n = 100"} <= set(said)
    assert any(text.startswith("0° … 36.9°, cos θ = 1 … 0.8") for text in said)
    with pytest.raises(ValueError, match="linear axis"):
        plots.figure("albedo-vs-angle", [angle_curve()], scale="log")
    assert "phong, n = 10" in texts(plots.figure("albedo-vs-angle", [angle_curve(), angle_curve("ggx")]))


@pytest.mark.parametrize("count", few([1, 3, 6, 11], (1, 11)))
def test_heat_maps(count):
    figure = plots.figure("heatmap", [heat_curve(f"f{i}", top=1.3 if i % 2 == 0 else 0.6) for i in range(count)])
    said = texts(figure)
    assert any(text.startswith("largest 1.3 at n = 1000, 0°") for text in said)
    assert any("E > 1 for n = 200 … 1000" in text for text in said)
    assert {f"f{i}" for i in range(count)} <= set(said)


@pytest.mark.parametrize(
    ("intervals", "tints"),
    [([(10, 50)], 1), ([(1, 1000)], 0), ([(2, 5), (10, 50)], 2), ([(2, 20), (10, 50)], 0), ([(1, 1000), (10, 50)], 0)],
)
def test_a_tint_says_where(intervals, tints):
    """Not over the whole range, and never one on another: the strip above says it then."""
    names = ["phong", "blinn-phong"]
    drawn = [exponent_curve(name, np.full(40, 1.1), [ends]) for name, ends in zip(names, intervals, strict=False)]
    figure = plots.figure("albedo-vs-n", drawn)
    (axes,) = (axes for axes in figure.axes if axes.get_ylabel())
    assert sum(patch.get_zorder() == 0.5 for patch in axes.patches) == tints


@pytest.mark.parametrize(("low", "high"), [(2.0, 4.0), (3.5, 4.0), (1.0, 30.0), (2.1, 80.0), (3.0, 1e4)])
def test_a_heat_map_far_above_1_shows_its_structure(low, high):
    """Whatever the values are, most of them do not share one colour."""
    curve = heat_curve(top=1.0)
    shape = np.shape(curve["albedo"])
    values = np.linspace(low, high, math.prod(shape)).reshape(shape)
    levels, colors = panels._levels([{**curve, "albedo": values.tolist()}], None)
    assert np.all(np.diff(levels) > 0)
    assert len(colors) == len(levels) - 1 == len(set(colors))
    assert 1.0 in levels
    counts = np.histogram(values, [*levels[:-1], np.inf])[0]
    assert counts.max() < 0.7 * values.size


@pytest.mark.parametrize("top", few([0.004, 0.9999, 1.0, 1.0005, 40.0, 1e29, np.nan], (0.004, 1.0005, 1e29, np.nan)))
def test_heat_maps_of_any_height(top):
    curve = heat_curve(top=1.0)
    curve["albedo"] = [[str(top) if np.isnan(top) else top * value for value in row] for row in curve["albedo"]]
    if np.isnan(top):
        curve["albedo"][3][3] = 0.5
    assert len(plots.to_bytes(plots.figure("heatmap", [curve]), ".png")) > 5000


def test_factors():
    x = np.geomspace(1, 1000, 40)
    curve = {**exponent_curve("blinn-phong-8", np.full(40, 1.05), [(1, 1000)]), "kind": "factor"}
    curve |= {"factor": ((x + 8) / 25).tolist(), "exact": ((x + 8) / 25 / 1.05).tolist()}
    said = texts(plots.figure("factor", [curve]))
    assert "factor / largest conserving factor" in said
    assert "factor, 1/sr" in said


def test_what_does_not_fit_into_one_figure():
    slope = {**exponent_curve("ggx"), "parameter": "alpha"}
    with pytest.raises(ValueError, match="one figure has one axis"):
        plots.figure("albedo-vs-n", [exponent_curve(), slope])
    for arguments, words in (
        (("pie", [exponent_curve()]), "kind must be one of"),
        (("albedo-vs-n", []), "no curve"),
        (("heatmap", [exponent_curve()]), "not a curve of the kind heatmap"),
    ):
        with pytest.raises(ValueError, match=words):
            plots.figure(*arguments)
    with pytest.raises(ValueError, match="scale must be log or linear"):
        plots.figure("albedo-vs-n", [exponent_curve()], scale="cubic")
    with pytest.raises(ValueError, match="suffix must be one of"):
        plots.to_bytes(plots.figure("albedo-vs-n", [exponent_curve()]), ".gif")


# --- nothing collides, nothing is cut off ---


def boxes(figure):
    """The places of all texts that are shown, in pixels."""
    figure.canvas.draw()
    found = []
    for axes in figure.axes:
        for text in axes.texts:
            if text.get_text() and text.get_visible():
                found.append((text.get_text(), text.get_window_extent()))
        legend = axes.get_legend()
        if legend:
            found += [(text.get_text(), text.get_window_extent()) for text in legend.get_texts()]
    return found


CROWDS = {
    "one": [PUBLISHED],
    "equal ends": [exponent_curve(name, np.full(40, 0.9)) for name in ("phong", "blinn-phong", "lyon-1-half", "schlick-half")],
    "at the top": [exponent_curve(f"mine.py:f{i}", np.full(40, 1.3), [(1, 1000)]) for i in range(7)],
    "fourteen": [exponent_curve(f"mine.py:f{i}", np.full(40, 0.5 + 0.035 * i)) for i in range(14)],
    "everything": [
        exponent_curve(name, np.linspace(0.8, 0.7 + 0.02 * i, 40), [(14 + i, 30 + 9 * i)] if i > 15 else [])
        for i, name in enumerate(catalog.names())
    ],
    "long names": [exponent_curve(f"/a/very/long/path/{'x' * 90}{i}.py:brdf") for i in range(5)],
    "many ends": [exponent_curve("phong", np.linspace(0.9, 1.1, 40), [(1, 2), (2.1, 2.2), (2.3, 2.4), (900, 1000)])],
}


@pytest.mark.parametrize("crowd", list(CROWDS))
def test_texts_do_not_collide_and_are_inside(crowd):
    figure = plots.figure("albedo-vs-n", CROWDS[crowd])
    found = boxes(figure)
    width, height = figure.get_size_inches() * figure.dpi
    for (one, first), (other, second) in itertools.combinations(found, 2):
        across = min(first.x1, second.x1) - max(first.x0, second.x0)
        along = min(first.y1, second.y1) - max(first.y0, second.y0)
        assert across < 1 or along < 2.5, (one, other)
    for text, box in found:
        assert box.x0 > -1, text
        assert box.x1 < width + 1, text
        assert box.y0 > -1, text
        assert box.y1 < height + 1, text
    assert figure.axes[0].get_window_extent().width / figure.dpi > 4.3  # names do not eat the axes


def test_direct_labels_while_they_fit():
    assert plots.figure("albedo-vs-n", CROWDS["fourteen"]).axes[0].get_legend() is None
    assert plots.figure("albedo-vs-n", CROWDS["everything"]).axes[0].get_legend() is not None


@pytest.mark.parametrize("places", [[], [0.5], [0.5, 0.5, 0.5], [0, 0, 0], [1, 1, 1, 1], [0.1, 0.11, 0.9, 0.91, 0.911]])
def test_labels_move_as_little_as_need_be(places):
    moved = paper.apart(places, 0.1).tolist()
    assert all(later - earlier > 0.1 - 1e-12 for earlier, later in itertools.pairwise(moved))
    assert all(-1e-12 <= place <= 1 + 1e-12 for place in moved)
    if places in ([0.5], [0.1, 0.3]):
        assert moved == places


def test_numbers_as_one_writes_them():
    written = {14.303005: "14.303", 1000: "1000", 6.72e28: "6.72·10²⁸", 1e28: "10²⁸", -0.5: "−0.5", 0: "0", 1e-9: "10⁻⁹"}
    assert {value: paper.text_of(value) for value in written} == written
    assert paper.text_of(float("nan")) == "not a number"
    assert paper.text_of(123456.7) == "123457"


def test_names_are_text_not_mathematics():
    odd = exponent_curve("mine.py:$a_b$ <&> \N{HIRAGANA LETTER A}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = plots.figure("albedo-vs-n", [odd])
    assert "mine.py:$a_b$ <&> \N{HIRAGANA LETTER A}" in texts(figure)
    for suffix in (".png", ".pdf"):
        assert plots.to_bytes(figure, suffix)


def test_curves_with_holes():
    values = np.linspace(0.8, 1.1, 40)
    values[5:9] = np.nan
    assert plots.to_bytes(plots.figure("albedo-vs-n", [exponent_curve(values=values)]), ".svg")
    hole = {**exponent_curve("phong"), "albedo": ["NaN"] * 39 + ["Infinity"], "largest": None}
    assert any("axis cut at" in text for text in texts(plots.figure("albedo-vs-n", [hole])))


# --- bytes ---

_RENDER = """
import hashlib, sys
sys.path.insert(0, "tests")
from test_plots import PUBLISHED, angle_curve, heat_curve
from brdfcheck import plots
for kind, curves in (("albedo-vs-n", [PUBLISHED]), ("albedo-vs-angle", [angle_curve()]), ("heatmap", [heat_curve()])):
    for suffix in plots.FORMATS if kind == "albedo-vs-n" else (".svg",):
        print(kind, suffix, hashlib.sha256(plots.to_bytes(plots.figure(kind, curves), suffix)).hexdigest())
"""


@pytest.mark.slow
def test_the_same_bytes_in_every_process():
    first, second = (
        python("-c", _RENDER, cwd=ROOT, environment={"PYTHONHASHSEED": seed, "SOURCE_DATE_EPOCH": seed}) for seed in ("1", "2")
    )
    assert first == second
    assert (first[0], len(first[1].splitlines())) == (0, 5)


def test_svg_is_text_without_a_date():
    data = plots.to_bytes(plots.figure("albedo-vs-n", [PUBLISHED]), ".svg").decode()
    assert "<text" in data
    assert "<dc:date>" not in data
    assert not re.search(r"20\d\d-\d\d-\d\d", data)


def test_the_settings_of_the_user_do_not_matter():
    import matplotlib

    before = plots.to_bytes(plots.figure("albedo-vs-n", [PUBLISHED]), ".svg")
    with matplotlib.rc_context({"font.size": 20, "lines.linewidth": 9, "axes.facecolor": "red", "savefig.bbox": "tight"}):
        during = plots.to_bytes(plots.figure("albedo-vs-n", [PUBLISHED]), ".svg")
        assert matplotlib.rcParams["font.size"] == 20
    assert before == during


def test_plotting_never_computes():
    code = "import sys, brdfcheck.plots as p, brdfcheck.plots.panels, brdfcheck.output.curve_files"
    code += "; print([m for m in ('jax', 'equinox', 'matplotlib.pyplot') if m in sys.modules])"
    assert python("-c", code)[:2] == (0, "[]\n")
    for path in (ROOT / "brdfcheck" / "plots").glob("*.py"):
        assert not re.search(r"^\s*(import|from) (jax|scipy)", path.read_text(), re.MULTILINE), path
