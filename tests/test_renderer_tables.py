"""Tables for renderers: their values against other ways to compute them, every file read back, the functions compiled."""

from __future__ import annotations

import functools
import json
import re
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import measured
import numpy as np
import pytest
from problems import brute_force
from shared import Run, compiled

from brdfcheck import GGX, CookTorrance, albedo
from brdfcheck.cli import ExitCode
from brdfcheck.fits.compact import CompactFits, compact_fits
from brdfcheck.fits.compensated import TOLERANCE, checked
from brdfcheck.fits.compensation import Compensation, averages, compensation, looked_up
from brdfcheck.fits.renderer import RendererTable, average_albedo, renderer_table
from brdfcheck.messages import UsageError
from brdfcheck.output.renderer_files import KINDS, quantities, renderer_metadata, write_renderer_table
from brdfcheck.output.source import read_back, source_text
from brdfcheck.verdict import Verdict

CPP = shutil.which("c++") or shutil.which("g++")
COMPILER = pytest.mark.skipif(CPP is None, reason="no C++ compiler")

MINE = """
import jax.numpy as jnp
from brdfcheck import GGX

def facets(alpha, F0):
    return lambda wi, wo: GGX(alpha, F0, fresnel="schlick")(wi, wo)

def exact(alpha, F0):
    return lambda wi, wo: GGX(alpha, F0, fresnel="dielectric")(wi, wo)

def plain(wi, wo, F0, k):
    return k * (F0 + (1 - F0) * 0.25) / jnp.pi + 0 * wi[..., 2]

def square(wi, wo, F0, k):
    return k * F0 * F0 / jnp.pi + 0 * wi[..., 2]

def bright(wi, wo, k):
    return k / jnp.pi + 0 * wi[..., 2]

def grey(wi, wo):
    return 0.3 / jnp.pi + 0 * wi[..., 2]

def narrow(wi, wo, k):
    return (0.5 + 0.6 * jnp.exp(-(((k - 0.5031) / 0.01) ** 2))) / jnp.pi + 0 * wi[..., 2]
"""
SHADER = """
uniform float k = 0.5;
uniform vec3 F0 = vec3(0.04);
vec3 f(vec3 L, vec3 V) { return (F0 + (vec3(1.0) - F0) * 0.25) * k / 3.141592653589793; }
"""


# Other tables of a lobe have this size or one of 3 x 4: each size compiles its own programs.
@pytest.fixture(scope="module")
def table() -> RendererTable:
    return renderer_table("ggx", {"roughness": (0.0, 1.0)}, size=(6, 5))


@pytest.fixture(scope="module")
def added(table: RendererTable) -> Compensation:
    return compensation(table)


@pytest.fixture(scope="module")
def fits(table: RendererTable, added: Compensation) -> CompactFits:
    return compact_fits(table, (3, 2), added)  # a small one: what is tested is the text and what it says of itself


@pytest.fixture
def mine(here: Path) -> Path:
    (here / "mine.py").write_text(MINE)
    (here / "shader.glsl").write_text(SHADER)
    return here


# --- values ---


def test_the_split_sum_is_linear_in_f0_and_right(table):
    i, j = 4, 2
    alpha, mu = float(table.grid.nodes[i]) ** 2, float(table.grid.cos_theta[j])
    assert alpha == pytest.approx(0.5625, abs=1e-15)
    shares = np.array([0.0, 0.04, 0.5, 1.0])
    for f0, ours in zip(shares, albedo(GGX(alpha, shares, fresnel="schlick"), mu).value, strict=True):
        value = f0 * table.scale[0][i, j] + table.bias[0][i, j]
        assert value == pytest.approx(brute_force(GGX(alpha, f0, fresnel="schlick"), mu, count=200), abs=2e-5)
        assert value == pytest.approx(float(ours), abs=1e-9)
    assert np.all(table.scale[0] + table.bias[0] <= 1 + 1e-8)


def test_a_known_corner():
    """Beckmann or GGX, whose albedo at normal incidence and alpha = 1 is 1 - ln 2; ends are nodes."""
    found = renderer_table("ggx", {"roughness": (0.5, 1.0)}, size=(3, 4), placement="ends")
    assert found.grid.nodes.tolist() == [0.5, 0.75, 1.0]
    assert found.grid.cos_theta.tolist() == pytest.approx([0, 1 / 3, 2 / 3, 1], abs=1e-15)
    assert abs(found.grid.values[2, 3] - (1 - np.log(2))) <= found.grid.errors[2, 3]
    assert "ends included" in found.grid.placement


@pytest.mark.slow
def test_averages():
    lambert = renderer_table("lambert", {"reflectance": (0.25, 0.75)}, size=(2, 2), placement="ends")
    assert lambert.average[0] == pytest.approx([0.25, 0.75], abs=1e-13)
    assert lambert.scale is None
    assert "no microfacet lobe" in lambert.why
    # n = 2 with (n+2)/2pi: E = (1+mu)^2/4, whose average is 17/24.
    phong = renderer_table("phong", {"n": (2.0, 4.0)}, size=(2, 3), placement="ends")
    assert phong.grid.values[0] == pytest.approx([0.25, 0.5625, 1], abs=1e-12)
    assert abs(phong.average[0][0] - 17 / 24) <= phong.average[1][0] < 1e-8


def test_the_bars_of_an_average_hold(table):
    """Against 200 Gauss nodes on each of two panels, one of them the layer at grazing incidence."""
    node = table.grid.nodes[1]
    x, w = np.polynomial.legendre.leggauss(60)
    total = 0.0
    for low, high in ((0, node**2), (node**2, 8 * node**2), (8 * node**2, 1)):
        mu = low + (high - low) * (x + 1) / 2
        total += float(np.sum(np.asarray(albedo(GGX(node**2), mu).value) * 2 * mu * w / 2 * (high - low)))
    assert abs(table.average[0][1] - total) <= table.average[1][1]


@pytest.mark.slow
def test_a_target_with_a_fresnel_term_of_its_own():
    """E is the target's, the split sum that of its facets."""
    from brdfcheck import Family

    build = functools.partial(CookTorrance, masking="smith-separable")
    found = renderer_table(Family("metal", lambda m: build(m, 0.9), {"m": (0.3, 0.6)}), size=(2, 3))
    m, mu = found.grid.nodes[1], found.grid.cos_theta[1]
    assert found.grid.values[1, 1] == pytest.approx(float(albedo(build(m, 0.9), mu).value), abs=1e-9)
    white = found.scale[0][1, 1] + found.bias[0][1, 1]
    assert white == pytest.approx(float(albedo(build(m), mu).value), abs=1e-9)
    with pytest.raises(UsageError, match="facets with F = 1"):
        compensation(found)


@pytest.mark.slow
def test_functions_with_f0(mine):
    found = renderer_table("mine.py:plain", {"k": (0.0, 1.0)}, size=(2, 2))
    assert found.grid.family.held == {"F0": 1.0}
    for part, share in ((found.grid.values, 1), (found.scale[0], 0.75), (found.bias[0], 0.25)):
        assert part == pytest.approx(np.array([[0.25, 0.25], [0.75, 0.75]]) * share, abs=1e-6)
    square = renderer_table("mine.py:square", {"k": (0.0, 1.0)}, size=(2, 2))
    assert square.scale is None
    assert "not linear in F0" in square.why


@pytest.mark.slow
def test_a_function_of_facets_has_the_split_sum_of_ours(mine):
    held = renderer_table("mine.py:plain", {"k": (0.0, 1.0), "F0": (0.0, 0.0)}, size=(2, 2))
    assert held.grid.values[1] == pytest.approx([0.1875, 0.1875], abs=1e-6)
    assert held.bias[0][1] == pytest.approx([0.1875, 0.1875], abs=1e-6)
    found = renderer_table("mine.py:facets", {"roughness": (0.5, 1.0)}, size=(2, 2))
    assert found.sources.mapping == "alpha = roughness^2"
    ours = renderer_table("ggx", {"roughness": (0.5, 1.0)}, size=(2, 2))
    for name, (value, bar) in found.channels.items():
        assert np.max(np.abs(value - ours.channels[name][0])) <= np.max(bar) + 1e-8, name
    assert np.max(found.channels["bias"][1]) < 1e-5
    exact = renderer_table("mine.py:exact", {"roughness": (0.5, 1.0)}, size=(2, 2))
    assert "not linear in F0" in exact.why


def test_a_shader(mine):
    shader = renderer_table("shader.glsl:f", {"k": (0.0, 1.0)}, size=(2, 2))
    for part, share in ((shader.grid.values, 1), (shader.scale[0], 0.75), (shader.bias[0], 0.25)):
        assert part == pytest.approx(np.array([[0.25, 0.25], [0.75, 0.75]]) * share, abs=1e-6)


@pytest.mark.slow
def test_a_measured_table_is_one_row(mine):
    path = measured.write(mine, "metal.bsdf", measured.rgl_bytes(0.5, np.linspace(0, 1.5, 9)))
    found = renderer_table(path, size=(4, 2))
    assert found.grid.values.shape == (1, 2)
    exact = [measured.ggx_albedo(0.5, mu) for mu in found.grid.cos_theta]
    assert np.all(np.abs(found.grid.values[0] - exact) <= found.grid.errors[0] + 2e-3)
    assert np.all(found.grid.errors < 0.05)
    write_renderer_table(mine / "metal.csv", found, "csv")
    assert np.array_equal(read_csv(mine / "metal.csv", found)["E"], found.grid.values)


def test_what_is_no_table(mine):
    cases = {
        ("ggx", ("alpha", 0.1, 1.0), ("roughness", 0.1, 1.0)): "alpha and roughness have ranges",
        ("ggx", ("beta", 0.1, 1.0)): "no parameter 'beta'",
        ("phong", ("n", -2.0, 3.0)): "n must be finite and >= 0",
        ("mine.py:plain", ("F0", 0.1, 1.0)): "k must be given a range",
        ("mine.py:missing",): "missing",
    }
    for (name, *ranges), words in cases.items():
        with pytest.raises(UsageError, match=words):
            renderer_table(name, {key: (low, high) for key, low, high in ranges}, size=(3, 3))
    for options, words in (({"size": (1, 4)}, "size must be"), ({"placement": "middle"}, "centres, ends; got 'middle'")):
        with pytest.raises(ValueError, match=words):
            renderer_table("ggx", **options)


# --- compensation ---


def test_the_average_of_what_is_looked_up():
    mu, rows = np.array([0.25, 0.75]), np.array([[0.2, 0.8], [0.5, 0.5]])
    x = (np.arange(200_000) + 0.5) / 200_000
    for row, value in zip(rows, averages(mu, rows), strict=True):
        assert value == pytest.approx(np.mean(2 * x * np.interp(x, mu, row)), abs=1e-9)


def test_the_compensated_albedo_is_1_less_what_the_look_up_is_above(table, added):
    """A function of two directions integrated, against 1 + E - E looked up; and the table of E as it is exceeds 1."""
    assert 0.001 < added.excess < 0.3
    assert 0 <= added.loss < 0.3
    assert np.all(added.energy >= table.grid.values)
    for part in (added.energy, added.average):
        assert np.array_equal(part, part.astype(np.float32))  # what files hold is what was searched
    mu, roughness = np.array([0.8]), float(table.grid.nodes[3])
    row, mean = jnp.asarray(added.energy[3]), float(added.average[3])
    lobe = GGX(roughness**2)

    def both(wi, wo):
        lost = [1 - jnp.interp(w[..., 2], table.grid.cos_theta, row) for w in (wi, wo)]
        return lobe(wi, wo) + jnp.where((wi[..., 2] > 0) & (wo[..., 2] > 0), lost[0] * lost[1] / (jnp.pi * (1 - mean)), 0)

    value = albedo(both, mu, rtol=1e-6)
    own = np.asarray(albedo(lobe, mu).value)
    expected = 1 + own - np.interp(mu, table.grid.cos_theta, added.energy[3])
    assert np.all(np.abs(value.value - expected) <= 2e-6)
    assert own + added(np.array([roughness]), mu) == pytest.approx(expected, abs=1e-6)
    assert np.all(expected < 1)
    # Between the nodes of both axes nothing exceeds 1, at places that were not looked at; below the first node neither.
    for number in np.linspace(*added.family.ranges["roughness"], 7):
        angles = np.linspace(0.01, 1, 23)
        total = np.asarray(albedo(GGX(number**2), angles).value) + added(np.full(23, number), angles)
        assert np.max(total) <= 1 + 1e-7


def test_looking_up_is_linear_between_nodes_and_level_beyond():
    nodes, mu, values = np.array([1.0, 2.0, 4.0]), np.array([0.25, 0.75]), np.arange(6.0).reshape(3, 2)
    at = np.array([[0.0, 0.0], [1.5, 0.5], [3.0, 0.75], [9.0, 1.0], [2.0, 0.25]])
    assert looked_up(nodes, mu, values, *at.T).tolist() == [0.0, 1.5, 4.0, 5.0, 2.0]
    assert looked_up(np.array([0.0]), mu, values[:1], np.zeros(2), np.array([0.5, 0.0])).tolist() == [0.5, 0.0]


# Tables that exceeded 1 between their nodes, by up to 0.02: the largest value in a cell is not in its middle, nodes cannot be
# raised above 1, and below the first node look-ups are level.
CONSERVING = [
    ("ggx", (0.0, 1.0), (6, 5), "centres"),  # the fixtures
    pytest.param("blinn-phong-6", (1.0, 100.0), (6, 5), "ends", marks=pytest.mark.slow),
    pytest.param("ggx", (0.1, 1.0), (6, 5), "ends", marks=pytest.mark.slow),
    pytest.param("ggx", (0.0, 1.0), (13, 40), "centres", marks=pytest.mark.slow),
    pytest.param("cook-torrance", (0.1, 1.0), (16, 16), "ends", marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("name", "bounds", "size", "placement"), CONSERVING)
def test_the_search_finds_no_albedo_above_1_and_is_sure_of_it(name, bounds, size, placement, added):
    parameter = {"ggx": "roughness", "cook-torrance": "m", "blinn-phong-6": "n"}[name]
    own = (name, bounds, size, placement) == CONSERVING[0]
    found = added if own else compensation(renderer_table(name, {parameter: bounds}, size=size, placement=placement))
    report = checked(found.family, found)
    assert report.verdict is Verdict.CONSERVES
    assert report.albedo == pytest.approx(1, abs=1e-6)
    assert report.error < 1e-6
    assert report.tolerance == TOLERANCE
    assert found.family.ranges[parameter][1] == bounds[1]
    assert found.family.ranges[parameter][0] <= max(bounds[0], 0.01)


@pytest.mark.slow
def test_where_nothing_is_lost_the_compensation_is_a_number_in_single_precision():
    """A mirror returns all: 1 - E and 1 - average are nothing, and the renderer's quotient was 0/0."""
    found = compensation(renderer_table("ggx", {"roughness": (0.0, 0.05)}, size=(5, 6)))
    energy, average = np.float32(found.energy), np.float32(found.average)
    assert np.max(energy) == 1
    with np.errstate(all="raise"):
        added = (1 - energy) ** 2 / (np.float32(np.pi) * (1 - average[:, None]))
    assert np.all((added >= 0) & np.isfinite(added))
    assert 0 <= found.loss < 3e-3  # of which most is that the first row conserves below itself, too


def test_a_violation_between_the_nodes_is_found():
    """blinn-phong-8 exceeds 1 at n = 8.76; none of the nodes does."""
    found = renderer_table("blinn-phong-8", {"n": (1.0, 100.0)}, size=(6, 5))
    assert np.max(found.grid.values) < 0.99
    with pytest.raises(UsageError, match=r"albedo is 1.0752 at n=8.76\d*, cos_theta=1: above 1"):
        compensation(found)


@pytest.mark.slow
def test_a_violation_in_a_hundredth_of_the_range_of_a_function_is_found(mine):
    with pytest.raises(UsageError, match=r"albedo is 1\.1 at k=0\.5031"):
        compensation(renderer_table("mine.py:narrow", {"k": (0.0, 1.0)}, size=(4, 4)))


def test_check_of_the_table_of_E_itself(table, added):
    plain = np.minimum(table.grid.values, 1)
    mean = averages(table.grid.cos_theta, plain)
    report = checked(added.family, replace(added, energy=plain, average=mean, returned=mean))
    assert report.verdict is Verdict.VIOLATES
    assert report.albedo > 1.1


@pytest.mark.slow
def test_a_function_with_its_compensation(mine):
    """Of a function neither look-ups nor the written functions exceed 1, though the search may not be sure of it."""
    found = renderer_table("mine.py:facets", {"roughness": (0.5, 1.0)}, size=(3, 3))
    added = compensation(found)
    text = source_text("glsl", compact_fits(found, (3, 2), added), "mine")
    for what in (added, read_back(text, "mine", "roughness")):
        report = checked(added.family, what)
        assert report.verdict is not Verdict.VIOLATES
        assert report.albedo <= 1 + TOLERANCE


def test_the_written_functions_conserve(table, added, fits):
    """As their text is read; without what the albedo is raised by, they exceed 1."""
    text = source_text("glsl", fits, "ggx")
    written = read_back(text, "ggx", "roughness")
    at = np.random.default_rng(3).random((50, 2))
    assert written(*at.T) == pytest.approx(fits.compensation(*at.T), abs=1e-6)
    report = checked(added.family, written)
    assert report.verdict is Verdict.CONSERVES
    assert report.error < 1e-6
    assert "the albedo of the sum is at most 1" in " ".join(text.lower().replace("//", " ").split())
    bare = replace(fits, compensation=replace(fits.compensation, raised=0.0, margin=0.0))
    report = checked(added.family, read_back(source_text("glsl", bare, "ggx"), "ggx", "roughness"))
    assert report.verdict is Verdict.VIOLATES
    assert report.albedo > 1.001
    assert 0 < fits.compensation.loss < 0.3


def test_what_is_written_stays_between_0_and_1_where_all_albedos_do(fits):
    p, mu = np.meshgrid(np.linspace(0, 1, 65), np.linspace(0, 1, 65))
    assert fits.albedo.clamped
    assert fits.share.clamped
    assert np.min(fits.share(p, mu)) == 0 > np.min(replace(fits.share, clamped=False)(p, mu))
    surface = replace(fits.albedo.surface, numerator=1.01 * fits.albedo.surface.numerator)
    high = replace(fits.albedo, surface=surface)
    assert np.max(high(p, mu)) == 1 < np.max(replace(high, clamped=False)(p, mu))
    text = source_text("glsl", CompactFits(high))
    assert "return clamp(value, 0.0, 1.0);" in text
    assert "Within [0, 1]" in text
    assert "clamp(value" not in source_text("glsl", CompactFits(replace(high, clamped=False)))
    violating = renderer_table("blinn-phong-8", {"n": (8.0, 10.0)}, size=(6, 5))
    assert not compact_fits(violating, (2, 1)).albedo.clamped


# --- files ---


def read_csv(path: Path, table: RendererTable) -> dict[str, np.ndarray]:
    lines = path.read_text().splitlines()
    comments = [line for line in lines if line.startswith("#")]
    names = comments[-1].removeprefix("# ").split(",")
    data = np.loadtxt(path, delimiter=",")
    shape = table.grid.values.shape
    assert names[:2] == [table.grid.parameter, "cos_theta"]
    assert np.array_equal(data[:, 0].reshape(shape)[:, 0], table.grid.nodes)
    assert np.array_equal(data[:, 1].reshape(shape)[0], table.grid.cos_theta)
    assert "# clamp: none: values above 1 are values above 1" in comments
    return {name: column.reshape(shape) for name, column in zip(names[2:], data.T[2:], strict=True)}


def read_npy(path: Path) -> dict[str, np.ndarray]:
    metadata = json.loads(Path(f"{path}.json").read_text())
    data = np.load(path, allow_pickle=False)
    assert data.dtype == np.float64
    return dict(zip(metadata["channels"], data, strict=True))


def read_exr(path: Path) -> tuple[dict[str, np.ndarray], dict]:
    import OpenEXR

    with OpenEXR.File(str(path)) as image:
        header = dict(image.header())
        return {name: channel.pixels for name, channel in image.channels().items()}, header


def read_dds(path: Path) -> np.ndarray:
    """By the documentation of the format: magic, DDS_HEADER, DDS_HEADER_DXT10, rows."""
    data = path.read_bytes()
    magic, size, flags, height, width, pitch, depth, levels = struct.unpack("<4s7I", data[:32])
    assert (magic, size, flags, depth, levels) == (b"DDS ", 124, 0x1 | 0x2 | 0x4 | 0x8 | 0x1000, 0, 1)
    assert pitch == 8 * width
    format_size, format_flags, code = struct.unpack("<2I4s", data[76:88])
    assert (format_size, format_flags, code) == (32, 4, b"DX10")
    assert struct.unpack("<I", data[108:112]) == (0x1000,)
    assert struct.unpack("<5I", data[128:148]) == (16, 3, 0, 1, 0)  # R32G32_FLOAT, 2D, one
    assert len(data) == 148 + 8 * width * height
    return np.frombuffer(data, "<f4", offset=148).reshape(height, width, 2)


def test_every_file_reads_back(table, added, tmp_path):
    parts = quantities(table, added)
    assert list(parts) == [
        "E", "error.E", "average", "error.average", "scale", "error.scale", "bias", "error.bias",
        "compensation.E", "compensation.average",
    ]  # fmt: skip
    metadata = renderer_metadata(table, added, command="the command")
    for kind in KINDS:
        write_renderer_table(tmp_path / f"t.{kind}", table, kind, added, metadata=metadata)
    for name, values in read_csv(tmp_path / "t.csv", table).items():
        assert np.array_equal(values, parts[name]), name
    for name, values in read_npy(tmp_path / "t.npy").items():
        assert np.array_equal(values, parts[name]), name
    pixels, header = read_exr(tmp_path / "t.exr")
    assert set(pixels) == set(parts)
    for name, values in pixels.items():
        assert np.array_equal(values, parts[name].astype(np.float32)), name
    assert header["brdfcheck.command"] == "the command"
    assert json.loads(header["brdfcheck.max_error"])["E"] == np.max(table.grid.errors)
    image = read_dds(tmp_path / "t.dds")
    assert np.array_equal(image, np.stack([parts["scale"], parts["bias"]], axis=-1).astype(np.float32))
    beside = json.loads((tmp_path / "t.dds.json").read_text())
    assert beside["channels"] == ["scale", "bias"]
    assert beside["resampling"] == "centres"
    assert beside["range_0"] == [0, 1]
    assert beside["parameter"] == "alpha = roughness^2"
    assert beside["compensation"]["measured_on"] == [15, 13]
    assert "alpha" in metadata["formula"] or "D G" in metadata["formula"]
    write_renderer_table(tmp_path / "a.dds", table, "dds", added, texture="compensation")
    assert np.array_equal(read_dds(tmp_path / "a.dds")[..., 0], added.energy.astype(np.float32))
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for kind in KINDS:
        write_renderer_table(tmp_path / f"t.{kind}", table, kind, added, metadata=metadata)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == first
    with pytest.raises(ValueError, match="csv, npy, exr, dds, hpp; got 'png'"):
        write_renderer_table(tmp_path / "t.png", table, "png")


def computed(folder: Path, source: str, points: np.ndarray) -> np.ndarray:
    """What a C++ program prints, which reads pairs of numbers."""
    strict = ["-std=c++11", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused-function", "-Wno-unused-variable"]
    return compiled([str(CPP), *strict], source, folder / "program.cpp", points)


def program(text: str, values: str) -> str:
    main = f'int main() {{ double p, mu; while (std::scanf("%lf %lf", &p, &mu) == 2) {{ {values} }} return 0; }}\n'
    return f"#include <cstdio>\n{text}\n{main}"


def points_of(table: RendererTable) -> np.ndarray:
    random = np.random.default_rng(1).random((40, 2))
    return np.concatenate([[(p, mu) for p in table.grid.nodes for mu in table.grid.cos_theta], random, [(-1, 2), (3, -1)]])


@COMPILER
def test_the_header_compiles_and_looks_up(table, tmp_path):
    for placement in ("centres", "ends"):
        own = table
        if placement == "ends":
            own = renderer_table("ggx", {"roughness": (0.2, 1.0)}, size=(3, 4), placement="ends")
        write_renderer_table(tmp_path / "t.hpp", own, "hpp")
        text = (tmp_path / "t.hpp").read_text().replace("#pragma once", "")
        values = 'std::printf("%.9g %.9g %.9g\\n", look_up(E, p, mu), look_up(average, p), look_up(bias, p, mu));'
        points = points_of(own)
        found = computed(tmp_path, program(text, f"using namespace ggx_table; {values}"), points)
        p, mu = points.T
        grid = own.grid

        def looked_up(values: np.ndarray, p: np.ndarray = p, mu: np.ndarray = mu, grid: object = grid) -> list[float]:
            return [
                float(np.interp(a, grid.nodes, [np.interp(b, grid.cos_theta, row) for row in values]))
                for a, b in zip(p, mu, strict=True)
            ]

        for column, part in zip(found.T, (grid.values, own.average[0][:, None] + 0 * grid.values, own.bias[0]), strict=True):
            assert np.max(np.abs(column - looked_up(part))) <= 1e-6
        assert np.max(np.abs(found[: grid.values.size, 0] - grid.values.ravel())) <= 2.5e-7  # at the nodes, in float


# What C++ lacks of GLSL and HLSL; with -fsingle-precision-constant its literals would be float, which they are there.
SHIM = """
#include <cmath>
struct vec2 { float x, y; vec2(float a, float b) : x(a), y(b) {} };
typedef vec2 float2;
static float clamp(double x, double low, double high) { return static_cast<float>(x < low ? low : x > high ? high : x); }
static float sqrt(float x) { return std::sqrt(x); }
"""


@COMPILER
@pytest.mark.parametrize("kind", ["glsl", "hlsl", "h"])
def test_the_functions_compile_and_are_as_near_as_they_say(table, fits, kind, tmp_path):
    text = source_text(kind, fits, "ggx", facts=["a fact"], command="the command")
    assert text.startswith("// a fact\n")
    assert "the command" in text
    pair = "double s, b; ggx_dfg(p, mu, &s, &b);"
    if kind != "h":
        pair = "vec2 pair = ggx_dfg(p, mu); double s = pair.x, b = pair.y;"
        text = SHIM + re.sub(r"^(float2?|vec2) ", r"static \1 ", text, flags=re.M)
    more = "ggx_compensation(p, mu, 0.25)"
    numbers = f"(double)ggx_albedo(p, mu), (double)ggx_average(p), s, b, (double){more}"
    values = f'{pair} std::printf("%.17g %.17g %.17g %.17g %.17g\\n", {numbers});'
    points = points_of(table)
    albedo_, average, scale, bias, extra = computed(tmp_path, program(text, values), points).T
    rounding = 1e-12 if kind == "h" else 3e-5
    assert np.max(np.abs(albedo_ - fits.albedo(*points.T))) <= rounding
    assert np.max(np.abs(average - fits.average(points[:, 0]))) <= rounding
    made = fits.compensation
    lost = [np.maximum(1 - made.raised - fits.albedo(points[:, 0], part), 0) for part in (points[:, 1], 0.25)]
    divisor = np.clip(made.lost(points[:, 0]) + made.margin, 1e-6, 1)
    expected = np.where(points[:, 0] < fits.albedo.parameter_range[0], 0, lost[0] * lost[1] / (np.pi * divisor))
    assert np.max(np.abs(extra - expected)) <= 30 * rounding
    assert np.all(extra >= 0)
    cells = table.grid.values.size
    own = [part.ravel() for part in (table.grid.values, table.scale[0], table.bias[0])]
    errors = [np.max(np.abs(part[:cells] - exact)) for part, exact in zip((albedo_, scale, bias), own, strict=True)]
    assert errors[0] <= fits.albedo.max_error + rounding
    assert max(errors[1:]) <= fits.split_sum_error + rounding
    assert fits.albedo.max_error < 0.02
    assert fits.split_sum_error < 0.05
    p = np.linspace(*fits.average.parameter_range, 50)
    assert np.max(np.abs(fits.average(p) - average_albedo(table.sources.family, p)[0])) <= 1.02 * fits.average.max_error


# --- the command ---


def test_the_command(run: Run, mine: Path) -> None:
    words = ("table", "ggx", "--over", "roughness=0:1", "--size", "3x4", "-o", "E.npy", "-o", "dfg.dds")
    code, out, err = run(*words, "--json", "table.json")
    assert (code, err) == (ExitCode.PASSED, "")
    assert "3 x 4 cells, roughness=0:1 (alpha = roughness^2), centres (half-vector)" in out
    assert re.search(r"^  bias +\d\.\d+ to \d\.\d+, error bar at most \d", out, re.M)
    assert out.endswith("  wrote        E.npy\n  wrote        dfg.dds\n")
    assert read_npy(mine / "E.npy")["E"].shape == (3, 4)
    assert read_dds(mine / "dfg.dds").shape == (3, 4, 2)
    record = json.loads((mine / "table.json").read_text())
    assert record["results"][0]["max_error"]["E"] < 1e-8
    made = json.loads((mine / "E.npy.json").read_text())["command"]
    before = (mine / "E.npy").read_bytes()
    assert run(*made.split()[1:])[0] == ExitCode.PASSED
    assert (mine / "E.npy").read_bytes() == before


def test_the_recorded_command_makes_the_same_files(run: Run, mine: Path) -> None:
    words = ("table", "ggx", "--over", "roughness=0.3:1", "--size", "3x4", "--compensation", "--check", "-o", "E.npy")
    code, out, err = run(*words, "--json", "table.json")
    assert (code, err) == (ExitCode.PASSED, "")
    assert re.search(r"^  check        look-ups: CONSERVES, largest albedo 1\.0+ \+- \S+ at .*, tolerance 1e-5$", out, re.M)
    record = json.loads((mine / "E.npy.json").read_text())
    assert "CONSERVES" in record["compensation"]["check"]["look-ups"]
    assert json.loads((mine / "table.json").read_text())["results"][0]["check"]["look-ups"]["verdict"] == "CONSERVES"
    before = [(mine / name).read_bytes() for name in ("E.npy", "E.npy.json")]
    assert run(*record["command"].split()[1:])[0] == ExitCode.PASSED
    assert [(mine / name).read_bytes() for name in ("E.npy", "E.npy.json")] == before


def test_what_check_refutes_is_not_written(run: Run, mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("brdfcheck.fits.compensation.raised", lambda nodes, cosines, table, known: np.minimum(table, 1))
    words = ("table", "ggx", "--over", "roughness=0.3:1", "--size", "3x4", "--compensation", "-o", "E.npy")
    code, out, _ = run(*words, "--check", "--json", "table.json")
    assert code == ExitCode.FAILED
    assert "look-ups: VIOLATES" in out
    assert out.endswith("  not written  E.npy\n")
    assert not (mine / "E.npy").exists()
    assert not (mine / "E.npy.json").exists()
    assert json.loads((mine / "table.json").read_text())["results"][0]["files"] == []


REFUSED = {
    ("ggx", "-o", "E.png"): "must end in .csv, .npy, .exr, .dds, .hpp, .glsl, .hlsl or .h",
    ("ggx",): "Missing option",
    ("ggx", "-o", "missing/E.exr"): "does not exist",
    ("ggx", "-o", "E.npy", "-o", "E.npy"): "cannot both write",
    ("ggx", "--size", "1x4", "-o", "E.csv"): "size must be two whole numbers >= 2",
    ("ggx", "--check", "-o", "E.csv"): "give --compensation too",
    ("nothing", "-o", "E.csv"): "nothing",
    ("lambert", "--texture", "dfg", "-o", "E.dds"): "no microfacet lobe",
    ("ggx", "--texture", "dfg", "-o", "E.npy"): "give -o FILE.dds too",
    ("lambert", "--texture", "compensation", "-o", "E.dds"): "needs compensation.E",
    ("ggx", "--over", "roughness=-1:1", "-o", "E.csv"): "roughness must be >= 0",
    ("ggx", "--over", "alpha=0.1:1", "--over", "roughness=0:1", "-o", "E.csv"): "rows run over one parameter",
    ("ggx", "--over", "roughness=0.3:1", "--cos-theta", "0.1:1", "--compensation", "-o", "E.csv"): "needs all angles",
    ("mine.py:bright", "--over", "k=0:2", "--compensation", "-o", "E.csv"): "the albedo is 2 at k=2, cos_theta=",
    ("mine.py:grey", "--over", "k=0:2", "-o", "E.csv"): "k",
}


@pytest.mark.parametrize("words", REFUSED, ids=" ".join)
def test_what_is_refused_in_one_line_and_nothing_written(words: tuple[str, ...], run: Run, mine: Path) -> None:
    before = sorted(mine.iterdir())
    code, _, err = run("table", *words, *(() if "--size" in words else ("--size", "3x4")))
    assert code == ExitCode.USAGE_ERROR
    assert REFUSED[words] in err
    assert len(err.strip().splitlines()) <= 3
    assert "Traceback" not in err
    assert [path for path in sorted(mine.iterdir()) if path.name != "__pycache__"] == before


def test_a_function_that_fails_is_a_finding(run: Run, mine: Path) -> None:
    (mine / "bad.py").write_text("def f(wi, wo):\n    return wi[..., 2] * undefined\n")
    code, out, err = run("table", "bad.py:f", "--size", "2x2", "-o", "E.csv")
    assert code == ExitCode.FAILED
    assert "undefined" in out + err
    assert not (mine / "E.csv").exists()


def test_functions_of_one_row(run: Run, here: Path) -> None:
    # "1 coefficients need at least as many points" it was, and no file was written.
    assert run("table", "lambert", "--over", "reflectance=0.5", "-o", "l.glsl", "-o", "l.csv")[0] == ExitCode.PASSED
    assert "lambert_average" in (here / "l.glsl").read_text()
    assert (here / "l.csv").exists()
