"""Plug-ins of Mitsuba 3: reading them, their values, deltas, transmission, density and weights."""

from __future__ import annotations

import importlib.util
import json

import numpy as np
import pytest
from shared import python

import brdfcheck
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.microfacet import GGX
from brdfcheck.brdf.readers import registry
from brdfcheck.brdf.readers.mitsuba import runtime
from brdfcheck.brdf.subject import as_target, load
from brdfcheck.messages import UsageError
from brdfcheck.quadrature.albedo import albedo as exact_albedo
from brdfcheck.quadrature.functions import adaptive_albedo
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.scene.functions import brdf_of
from brdfcheck.verdict import check
from brdfcheck.verdict.checks import CHECKS, Evidence
from brdfcheck.verdict.precision import rounding

needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed: pip install brdfcheck[mitsuba]"
)
SCENE = """<scene version="3.0.0">
    <default name="rough" value="0.25"/>
    <texture type="uniform" id="grey"><float name="value" value="0.4"/></texture>
    <bsdf type="diffuse" id="wall"><ref id="grey" name="reflectance"/></bsdf>
    <bsdf type="twosided" id="metal"><bsdf type="roughconductor">
        <string name="distribution" value="ggx"/><string name="material" value="none"/><float name="alpha" value="$rough"/>
    </bsdf></bsdf>
</scene>"""


def at(family: Family, cosine: float, **numbers: float) -> tuple[float, float]:
    """The albedo at one place and its error bar."""
    place = {name: numbers.get(name, low) for name, (low, _) in family.ranges.items()}
    found = adaptive_albedo(family.build(**place), cosine, 0.0, 1e-5, slow=True)
    return float(found.value), float(found.error)


def refused(spec: str, **ranges: tuple[float, float]) -> str:
    with pytest.raises(UsageError) as caught:
        load(spec, **ranges)
    text = str(caught.value)
    assert "\n" not in text
    return text


@needs_mitsuba
def test_matte_is_white_unless_it_is_given():
    assert at(load("mitsuba:diffuse"), 0.5)[0] == pytest.approx(1, abs=2e-6)
    assert at(load("mitsuba:diffuse", reflectance=(0.3, 0.3)), 0.5)[0] == pytest.approx(0.3, abs=1e-6)
    assert at(load('mitsuba:{"type": "diffuse", "reflectance": 0.7}'), 0.5)[0] == pytest.approx(0.7, abs=2e-6)
    coloured = load("mitsuba:diffuse", reflectance=(0.2, 0.5, 0.7)).build()
    np.testing.assert_allclose(adaptive_albedo(coloured, 0.5, 0.0, 1e-5, slow=True).value, (0.2, 0.5, 0.7), rtol=1e-5)


@needs_mitsuba
@pytest.mark.parametrize("alpha", [0.3, 0.05])
def test_the_error_bar_holds_single_precision(alpha):
    family = load('mitsuba:{"type": "roughconductor", "distribution": "ggx"}', alpha=(alpha, alpha))
    found, error = at(family, 0.4)
    error += rounding(PointwiseAlbedo(family), {}, 0.4, 0.0)
    lobe = GGX(alpha, masking="smith-separable")
    truth = exact_albedo(lobe, 0.4)
    assert abs(found - float(truth.value)) <= error + float(truth.error)
    assert error < 1e-4


@needs_mitsuba
def test_a_parameter_runs():
    family = load("mitsuba:principled", roughness=(0.1, 1.0))
    assert dict(family.ranges) == {"roughness": (0.1, 1.0)}
    assert family.tolerance == 1e-5
    # An own value for each number, in any order: one plug-in serves them all.
    first, second = at(family, 0.3, roughness=0.5), at(family, 0.3, roughness=0.9)
    assert at(family, 0.3, roughness=0.5) == first != second
    assert first[0] == pytest.approx(1.123, abs=1e-3)


@needs_mitsuba
def test_elements_of_scene_files(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    wall = as_target(f"mitsuba:{path}#wall")
    assert (wall.file, at(wall.family, 0.5)[0]) == (str(path), pytest.approx(0.4, abs=1e-6))
    twin = load('mitsuba:{"type": "roughconductor", "distribution": "ggx", "alpha": 0.25}')
    assert at(load(f"mitsuba:{path}#metal"), 0.4)[0] == pytest.approx(at(twin, 0.4)[0], abs=1e-6)
    assert "wall, metal" in refused(f"mitsuba:{path}")
    assert "'roof'" in refused(f"mitsuba:{path}#roof")
    path.write_text('<scene version="3.0.0"><bsdf type="twosided" id="a"><ref id="a"/></bsdf></scene>')
    assert "circle" in refused(f"mitsuba:{path}#a")
    path.write_text("<scene")
    assert "not XML" in refused(f"mitsuba:{path}#a")


@needs_mitsuba
def test_scene_files_are_put_together_as_mitsuba_does(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "metal.xml").write_text(
        """<scene version="3.0.0"><default name="r" value="0.9"/><default name="ru" value="0.7"/><include filename="grey.xml"/>
        <bsdf type="roughconductor" id="metal"><float name="alpha" value="$ru"/><string name="material" value="none"/>
        <ref id="colour" name="specular_reflectance"/></bsdf></scene>"""
    )
    (tmp_path / "parts" / "grey.xml").write_text('<scene version="3.0.0"><rgb id="colour" value="$r, $r, $r"/></scene>')
    path = tmp_path / "scene.xml"
    path.write_text(
        """<scene version="3.0.0"><default name="r" value="0.5"/><include filename="parts/metal.xml"/>
        <alias id="metal" as="tin"/><integer name="unused" value="$spp"/></scene>"""
    )
    twin = load('mitsuba:{"type": "roughconductor", "alpha": 0.7, "material": "none", "specular_reflectance": [0.5, 0.5, 0.5]}')
    for name in ("#metal", "#tin", ""):
        family = load(f"mitsuba:{path}{name}")
        assert family.name == f"mitsuba:{path}{name or '#metal'}"
        assert at(family, 0.4)[0] == pytest.approx(at(twin, 0.4)[0], abs=1e-6)
    wrong = {
        '<alias id="a" as="b"/><bsdf type="diffuse" id="a"/>': "there is nothing with the id 'a' above its <alias>",
        '<include filename="scene.xml"/>': "it includes itself, or more than 100 files",
        '<include filename="lost.xml"/>': "lost.xml'",
        '<bsdf type="$kind" id="a"/><default name="kind" value="diffuse"/>': '$kind has no value: write <default name="kind"',
    }
    for text, says in wrong.items():
        path.write_text(f'<scene version="3.0.0">{text}</scene>')
        assert says in refused(f"mitsuba:{path}")


@needs_mitsuba
def test_mirrors_count_and_need_not_be_reciprocal_pairs():
    mirror = load("mitsuba:conductor", specular_reflectance=(0.6, 0.6))
    assert at(mirror, 0.3)[0] == pytest.approx(0.6, abs=1e-6)
    point = PointwiseAlbedo(load("mitsuba:plastic"))
    assert CHECKS["reciprocal"](Evidence(point, {})).passed  # of what is smooth


@needs_mitsuba
@pytest.mark.parametrize("below", [0, 1])
def test_what_is_transmitted_counts(below):
    value, error = at(load("mitsuba:dielectric", below=(below, below)), 0.8)
    assert abs(value - 1) <= error + 1e-6
    rough = load('mitsuba:{"type": "roughdielectric", "alpha": 0.3, "int_ior": 1.5, "ext_ior": 1.0}', below=(below, below))
    assert 0.95 < at(rough, 0.8)[0] < 1
    hole = load('mitsuba:{"type": "mask", "opacity": 0.3, "b": {"type": "diffuse", "reflectance": 0.5}}', below=(below, below))
    assert at(hole, 0.8)[0] == pytest.approx(0.7 if below else 0.85, abs=1e-5)


@needs_mitsuba
@pytest.mark.slow
def test_both_sides_are_told():
    family = load("mitsuba:dielectric")
    assert family.switches == {"below"}
    told = CHECKS["sides"](Evidence(PointwiseAlbedo(family), {"below": 0.0}, 0.8))
    # Fresnel at cosine 0.8 from either side of the plug-in's default glass in air, 1.5046 / 1.000277.
    assert "from above: R = 0.0444" in told.words
    assert "from below: R = 0.1173" in told.words


@needs_mitsuba
@pytest.mark.slow
def test_the_density_of_rough_plastic_leaks():
    evidence = Evidence(
        PointwiseAlbedo(load("mitsuba:roughplastic", alpha=(0.6, 0.6))), {"alpha": 0.6, "diffuse_reflectance": 1.0}
    )
    assert CHECKS["pdf"](evidence).passed == runtime.variant()[0].startswith("scalar")
    assert CHECKS["weight"](evidence).passed


class Sampler:
    """Matte, sampled by the cosine; `leak` of the density is below the surface, weights are `gain` times too large."""

    transmits = False

    def __init__(self, leak: float, gain: float):
        self.leak, self.gain = leak, gain

    def __call__(self, wi, wo):
        return np.full(np.asarray(wo).shape[:1], 0.5 / np.pi, np.float32)

    def density(self, wi, wo):
        return np.where(wo[:, 2] > 0, 1, self.leak) * np.abs(wo[:, 2]) / np.pi

    def samples(self, wi, numbers):
        radius, angle = np.sqrt(numbers[:, 1]), 2 * np.pi * numbers[:, 2]
        out = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - numbers[:, 1])], axis=1)
        flux = np.repeat(0.5 * out[:, 2:] / np.pi, 3, axis=1)
        return out, np.full(out.shape, 0.5 * self.gain), self.density(wi, out), flux


@pytest.mark.parametrize(("leak", "gain", "failed"), [(0, 1, set()), (0.01, 1, {"pdf"}), (0, 1.01, {"weight"})])
def test_wrong_samplers_are_caught(leak, gain, failed):
    evidence = Evidence(PointwiseAlbedo(Family("sampler", lambda: Sampler(leak, gain))), {})
    made = {name: CHECKS[name](evidence) for name in ("pdf", "weight")}
    assert {name for name, found in made.items() if not found.passed} == failed
    assert CHECKS["sides"](evidence) is None


def test_lobes_and_functions_have_no_sampler():
    evidence = Evidence(PointwiseAlbedo(Family("plain", lambda: lambda wi, wo: np.full(len(wo), 0.1))), {})
    assert CHECKS["pdf"](evidence) is None
    assert "pdf" not in {found.name for found in check("phong", n=(2, 2)).checks}


@needs_mitsuba
@pytest.mark.parametrize(
    ("spec", "ranges", "says"),
    [
        ("mitsuba:nope", {}, "nope"),
        ("mitsuba:", {}, "mitsuba:principled"),
        ("mitsuba:sphere", {}, "not a BSDF"),
        ("mitsuba:nowhere.xml#a", {}, "there is no file"),
        ('mitsuba:{"type": "diffuse"', {}, "not JSON"),
        ('mitsuba:{"reflectance": 1}', {}, "must name its plug-in"),
        ('mitsuba:{"type": "diffuse", "shine": 1}', {}, "shine"),
        ("mitsuba:diffuse", {"shine": (0, 1)}, "its parameters: reflectance"),
        ("mitsuba:diffuse", {"below": (0, 1)}, "transmits nothing"),
        ("mitsuba:dielectric", {"below": (0.2, 0.5)}, "below is 0"),
    ],
)
def test_what_cannot_be_read_is_told_in_a_line(spec, ranges, says):
    assert says in refused(spec, **ranges)


def test_without_mitsuba_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(registry, "find_spec", lambda package: None)
    assert refused("mitsuba:diffuse") == "mitsuba:diffuse: Mitsuba needs the package mitsuba: pip install 'brdfcheck[mitsuba]'"


def test_the_command_ends_with_4():
    code, out, err = python("-m", "brdfcheck", "check", "mitsuba:no such thing")
    assert (code, out, len(err.strip().splitlines())) == (4, "", 1)


def test_the_llvm_library_is_looked_for(monkeypatch, tmp_path):
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    for name in ("libLLVM-14.so.1", "libLLVM-15.so"):
        (tmp_path / name).write_bytes(b"LLVMGetGlobalContext")
    monkeypatch.setattr(runtime, "_LLVM", (str(tmp_path / "libLLVM*.so*"),))
    assert runtime.llvm_library() is None  # too old
    for name in ("libLLVM-16.so.1", "libLLVM.so.19.1"):
        (tmp_path / name).write_bytes(b"LLVMGetGlobalContext\0LLVMGetVersion")
    assert runtime.llvm_library() == str(tmp_path / "libLLVM.so.19.1")
    for name, found in (("libLLVM-15.so", None), ("libLLVM-16.so.1", str(tmp_path / "libLLVM-16.so.1")), ("nowhere", None)):
        monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / name))
        assert runtime.llvm_library() == found


@needs_mitsuba
@pytest.mark.slow
def test_verdicts_say_what_they_rest_on(tmp_path):
    record = tmp_path / "record.json"
    assert python("-m", "brdfcheck", "check", "mitsuba:diffuse", "--json", record)[0] == 0
    (result,) = json.loads(record.read_text())["results"]
    assert (result["verdict"], result["basis"]) == ("CONSERVES", "single precision")
    violates = brdfcheck.check("mitsuba:principled", effort="quick")
    assert (violates.verdict.name, violates.tolerance, violates.basis) == ("VIOLATES", 1e-5, "single precision")


@needs_mitsuba
def test_a_picture_under_lights_shows_no_mirror_as_if_it_were_matt():
    with pytest.raises(UsageError, match="mitsuba:conductor has what the plug-in alone can follow"):
        brdf_of("mitsuba:conductor", {})
    assert brdf_of("mitsuba:conductor", {}, furnace=True).name == "mitsuba:conductor"
