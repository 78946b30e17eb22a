"""Surfaces of MaterialX as families of BRDFs, against formulas written out here, and what is refused in one line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shaders import write

import brdfcheck
from brdfcheck import cli, load
from brdfcheck.brdf.readers import registry
from brdfcheck.brdf.subject import resolve
from brdfcheck.cli import ExitCode
from brdfcheck.messages import UsageError

pytest.importorskip("MaterialX", reason="needs the extra 'materialx': pip install 'brdfcheck[materialx]'")

SURFACES = ("open_pbr_surface", "standard_surface", "gltf_pbr", "UsdPreviewSurface", "disney_principled")
LIGHT = np.array([[0.6, 0.0, 0.8], [0.0, 0.96, 0.28], [-0.8, 0.0, 0.6]])
VIEW = np.array([[0.0, 0.6, 0.8], [0.48, 0.64, 0.6], [0.8, 0.36, 0.48]])

MATTE = """<?xml version="1.0"?>
<materialx version="1.39">
  <oren_nayar_diffuse_bsdf name="diffuse" type="BSDF">
    <input name="color" type="color3" value="0.5, 0.25, 0.125" />
  </oren_nayar_diffuse_bsdf>
  <uniform_edf name="lamp" type="EDF"><input name="color" type="color3" value="5, 5, 5" /></uniform_edf>
  <surface name="matte" type="surfaceshader">
    <input name="bsdf" type="BSDF" nodename="diffuse" />
    <input name="edf" type="EDF" nodename="lamp" />
  </surface>
</materialx>
"""
METALS = """<?xml version="1.0"?>
<materialx version="1.39">
  <gltf_pbr name="SR_gold" type="surfaceshader">
    <input name="base_color" type="color3" value="0.9, 0.7, 0.3" />
    <input name="roughness" type="float" nodename="rough" />
  </gltf_pbr>
  <multiply name="rough" type="float">
    <input name="in1" type="float" value="0.5" /><input name="in2" type="float" value="0.8" />
  </multiply>
  <gltf_pbr name="SR_worn" type="surfaceshader">
    <input name="base_color" type="color3" nodename="picture" />
  </gltf_pbr>
  <image name="picture" type="color3"><input name="file" type="filename" value="scratches.png" /></image>
  <surfacematerial name="gold" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="SR_gold" />
  </surfacematerial>
</materialx>
"""


def gltf_metal(colour: np.ndarray, roughness: float, light_from: np.ndarray = LIGHT, to_view: np.ndarray = VIEW) -> np.ndarray:
    """The metal of gltf_pbr: GGX with alpha = roughness², Smith's correlated masking, Schlick's Fresnel term, and the energy
    compensation of Turquin 2019 by MaterialX's rational fit of the albedo in the view direction."""
    alpha, half = roughness**2, light_from + to_view
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    light, view, normal = light_from[:, 2], to_view[:, 2], half[:, 2]
    fresnel = colour + (1 - colour) * (1 - np.sum(to_view * half, -1)[:, None]) ** 5
    density = alpha**2 / (np.pi * (1 - (1 - alpha**2) * normal**2) ** 2)
    slopes = [np.sqrt(alpha**2 + (1 - alpha**2) * cosine**2) for cosine in (light, view)]
    masking = 2 * light * view / (slopes[0] * view + slopes[1] * light)
    table = """0.1003 0.9345 1 1  -0.6303 -2.323 -1.765 0.2281  9.748 2.229 8.263 15.94  -2.038 -3.748 11.53 -55.83
        29.34 1.424 28.96 13.08  -8.245 -0.7684 -7.507 41.26  -26.44 1.436 -36.11 54.9  19.99 0.2913 15.86 300.2
        -5.448 0.6286 33.37 -285.1"""
    terms = np.stack([alpha**j * view**i for i, j in ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2), (2, 2))])
    fit = np.reshape([float(word) for word in table.split()], (9, 4)).T @ terms
    single = np.clip(fit[0] / fit[2], 0, 1) + np.clip(fit[1] / fit[3], 0, 1)
    compensation = 1 + fresnel * ((1 - single) / single)[:, None]
    return fresnel * compensation * (density * masking / (4 * light * view))[:, None]


def at(family: Any, **numbers: float) -> np.ndarray:
    return np.asarray(family.build(**numbers)(LIGHT, VIEW))


def test_a_matte_surface_is_its_colour_over_pi_and_does_not_glow(tmp_path: Path) -> None:
    family = load(write(tmp_path, MATTE, "a.mtlx"))
    assert at(family) == pytest.approx(np.tile([0.5 / np.pi, 0.25 / np.pi, 0.125 / np.pi], (3, 1)), rel=1e-12)


def test_a_metal_is_ggx_with_the_energy_compensation_of_the_package() -> None:
    family = load("materialx:gltf_pbr", roughness=(0.1, 1))
    assert dict(family.ranges) == {"roughness": (0.1, 1)}
    for roughness in (0.3, 0.8):
        assert at(family, roughness=roughness) == pytest.approx(gltf_metal(np.ones(3), roughness), rel=1e-7)


def test_a_document_gives_colours_and_what_is_linked(tmp_path: Path) -> None:
    path = write(tmp_path, METALS, "a.mtlx")
    expected = gltf_metal(np.array([0.9, 0.7, 0.3]), 0.4)
    for name in ("SR_gold", "gold"):
        family = load(f"{path}:{name}")
        assert family.name == f"{path}:SR_gold"
        assert at(family) == pytest.approx(expected, rel=1e-7)
    # The nodes before the surface have parameters; an input that is given is no longer linked.
    colour = (0.9, 0.7, 0.3)
    assert at(load(f"{path}:gold", rough_in1=(0.25, 0.25))) == pytest.approx(gltf_metal(np.array(colour), 0.2), rel=1e-7)
    assert at(load(f"{path}:gold", roughness=(0.7, 0.7))) == pytest.approx(gltf_metal(np.array(colour), 0.7), rel=1e-7)
    assert at(load(f"{path}:SR_worn", base_color=colour)) == pytest.approx(gltf_metal(np.array(colour), 1.0), rel=1e-7)


@pytest.mark.slow
def test_a_surface_in_a_node_graph_has_what_the_graph_gives(tmp_path: Path) -> None:
    surface = METALS[METALS.index("  <gltf_pbr") : METALS.index("  <multiply")].replace(
        'nodename="rough"', 'interfacename="gloss"'
    )
    head = '<materialx version="1.39"><nodegraph name="graph"><input name="gloss" type="float" value="0.4" />'
    tail = '<output name="out" type="surfaceshader" nodename="SR_gold" /></nodegraph></materialx>'
    path = write(tmp_path, head + surface + tail, "a.mtlx")
    expected = gltf_metal(np.array([0.9, 0.7, 0.3]), 0.4)
    for spec in (path, f"{path}:graph", f"{path}:SR_gold"):
        assert at(load(spec)) == pytest.approx(expected, rel=1e-7)
    assert "did you mean 'graph'?; it has SR_gold, graph" in refusal(f"{path}:grap")


def test_colours_are_taken_from_their_space(tmp_path: Path) -> None:
    grey = MATTE.replace('value="0.5, 0.25, 0.125"', 'value="0.5, 0.25, 0.125" colorspace="srgb_texture"')
    linear = ((np.array([0.5, 0.25, 0.125]) + 0.055) / 1.055) ** 2.4
    assert at(load(write(tmp_path, grey, "a.mtlx"))) == pytest.approx(np.tile(linear / np.pi, (3, 1)), rel=1e-6)
    assert "does not know the colour space 'srgb_textur'" in refusal(
        write(tmp_path, grey.replace("_texture", "_textur"), "b.mtlx")
    )


@pytest.mark.slow
def test_colours_are_white_but_for_those_that_are_off() -> None:
    held = load("materialx:standard_surface").held
    assert held["base_color"] == 1
    assert "transmission_scatter" not in held
    assert "sheen_color" not in load("materialx:gltf_pbr").held
    assert load("materialx:standard_surface", base_color=(0.5, 0.4, 0.3)).held["base_color.g"] == 0.4


@pytest.mark.slow
@pytest.mark.parametrize("name", SURFACES)
def test_every_surface_can_be_evaluated(name: str) -> None:
    values = at(load(f"materialx:{name}"))
    assert values.shape == (3, 3)
    assert (values > 0).all()
    # White and without a coat: a matte part and a specular one, far from a mirror's needle.
    assert (values < 1).all()


def refusal(spec: str, **ranges: Any) -> str:
    with pytest.raises(UsageError) as caught:
        resolve([spec], ranges, None)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_names_that_are_not_there(tmp_path: Path) -> None:
    path = write(tmp_path, METALS, "a.mtlx")
    assert "did you mean 'open_pbr_surface'?" in refusal("materialx:open_pbr_surfac")
    assert "did you mean 'SR_gold'?; it has SR_gold, SR_worn, gold" in refusal(f"{path}:SR_gol")
    assert "has 2 surfaces: name one, as in" in refusal(path)
    assert "no parameter 'rouhness'" in refusal("materialx:gltf_pbr", rouhness=(0, 1))
    assert "roughness runs within 0:1, as MaterialX defines it; got 0:2" in refusal("materialx:gltf_pbr", roughness=(0, 2))
    assert "the image 'picture' has no value" in refusal(f"{path}:SR_worn")
    assert "linked inputs: base_color" in refusal(f"{path}:SR_worn")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="base_color"', 'name="base_colour"', "gltf_pbr has no input 'base_colour'; did you mean 'base_color'?"),
        ("gltf_pbr", "gltf_pbt", "MaterialX defines no surface 'gltf_pbt'; did you mean 'gltf_pbr'?"),
        ('"base_color" type="color3"', '"base_color" type="color4"', "'base_color' of gltf_pbr is a color3; got 'color4'"),
        ("0.9, 0.7, 0.3", "0.9, 0.7, nan", "is a color3 of finite numbers; got '0.9, 0.7, nan'"),
        ("0.9, 0.7, 0.3", "red", "is a color3 of finite numbers"),
        ('nodename="rough"', 'nodename="nowhere"', "'SR_gold/roughness' is linked to 'nowhere', which is not there"),
    ],
)
def test_documents_that_are_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert message in refusal(f"{write(tmp_path, METALS.replace(old, new), 'a.mtlx')}:SR_gold")


def test_files_that_are_no_documents(tmp_path: Path) -> None:
    assert "there is no file" in refusal(str(tmp_path / "b.mtlx"))
    assert "no MaterialX document" in refusal(write(tmp_path, "<materialx", "a.mtlx"))
    assert "has no surface" in refusal(write(tmp_path, '<materialx version="1.39"></materialx>', "c.mtlx"))
    unlit = (
        MATTE.replace("oren_nayar_diffuse_bsdf", "uniform_edf").replace('type="BSDF"', 'type="EDF"').replace('"bsdf"', '"edf2"')
    )
    assert "input" in refusal(write(tmp_path, unlit, "d.mtlx"))


def test_without_the_package_a_line_says_how_to_install_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(registry, "find_spec", lambda name: None)
    for spec in (write(tmp_path, METALS, "a.mtlx"), "materialx:gltf_pbr"):
        assert cli.run(["check", spec]) == ExitCode.USAGE_ERROR
        error = capsys.readouterr().err
        assert re.fullmatch(
            r"brdfcheck: .*: MaterialX needs the package MaterialX: pip install 'brdfcheck\[materialx\]'\n", error
        )


@pytest.mark.slow
def test_the_verdict_of_a_white_metal_is_that_of_its_formula() -> None:
    # Nodes crowd at the horizon and in the plane of incidence, where the lobe is narrow at this angle.
    cosine, (nodes, weights) = 0.1, np.polynomial.legendre.leggauss(160)
    nodes, weights = (nodes + 1) / 2, weights / 2
    up, azimuth = np.repeat(nodes**2, 160), np.tile(np.pi * nodes**3, 160)
    measure = np.outer(weights * 2 * nodes, weights * 3 * nodes**2).ravel() * 2 * np.pi
    across = np.sqrt(1 - up**2)
    view = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), up], -1)
    light = np.broadcast_to(np.array([np.sqrt(1 - cosine**2), 0.0, cosine]), view.shape)
    expected = np.sum(gltf_metal(np.ones(3), 0.5, light, view)[:, 0] * up * measure)
    report = brdfcheck.check("materialx:gltf_pbr", cos_theta=(cosine, cosine), effort="quick", roughness=(0.5, 0.5))
    assert report.verdict.name == "VIOLATES"
    assert report.albedo == pytest.approx(expected, rel=1e-6)
    assert expected > 1.02


@pytest.mark.slow
def test_the_command_line_ends_as_for_any_violation(capsys: pytest.CaptureFixture[str]) -> None:
    code = cli.run(["check", "materialx:gltf_pbr", "--over", "roughness=0.5", "--cos-theta", "0.1:0.1", "--effort", "quick"])
    assert code == ExitCode.FAILED
    assert re.search(r"materialx:gltf_pbr +VIOLATES +albedo 1\.", capsys.readouterr().out)
