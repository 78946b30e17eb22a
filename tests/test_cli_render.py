"""``brdfcheck render``: what it writes, and how it refuses."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import Run, picture

from brdfcheck.documents import read_document
from brdfcheck.messages import UsageError
from brdfcheck.scene import files as scene_files
from brdfcheck.scene import presets
from brdfcheck.scene.images import encode_srgb

SCENE = """
size = [12, 16]
background = 0.1

[geometry]
kind = "sphere"

[camera]
kind = "perspective"
eye = [0, 1, 5]

[material]
kind = "surface"
terms = [{ brdf = "lambert", tint = [0.6, 0.2, 0.1] }, { brdf = "phong", tint = 0.3, n = 50 }]

[[lights]]
kind = "spot"
position = [0, 0, 4]
spot_direction = [0, 0, -1]
spot_exponent = 2

[[lights]]
kind = "ambient"
intensity = [0.1, 0.1, 0.2]
"""


# --- presets ---


def test_the_list_names_every_preset(run: Run) -> None:
    out = run.silent("render", "--list")
    assert [line.split()[0] for line in out.splitlines()] == list(presets.PRESETS)
    assert all(preset.caption in out for preset in presets.PRESETS.values())


def test_a_preset_is_written_as_png_of_8_and_16_bit_and_exr(run: Run, here: Path) -> None:
    options = ("render", "figure-10", "--size", "20", "--quality", "draft")
    out = run.passed(*options, "-o", "a.png")
    assert out.startswith("wrote a.png: 20 x 20 pixels (height x width) in ")
    image = np.moveaxis(presets.render_preset("figure-10", 20, "draft"), 0, -1)
    eight = picture(here / "a.png")
    assert eight.dtype == np.uint8
    np.testing.assert_array_equal(eight, np.rint(encode_srgb(image) * 255))
    run.passed(*options, "-o", "b.PNG", "--bits", "16")
    sixteen = picture(here / "b.PNG")
    assert sixteen.dtype == np.uint16
    np.testing.assert_array_equal(sixteen, np.rint(encode_srgb(image) * 65535))
    run.passed(*options, "-o", "c.exr")
    import OpenEXR

    with OpenEXR.File(str(here / "c.exr")) as file:
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, image)
        assert file.header()["brdfcheck.rendered"] == "figure-10"


# --- scenes ---


@pytest.mark.slow
def test_the_scene_in_the_help_is_one(run: Run) -> None:
    text = run("render", "--help")[1]
    scene = scene_files.parse_scene(tomllib.loads(text[text.index("scene.toml:\n") + 12 : text.index("Only material")]))
    assert (scene.size, scene.options, len(scene.lights)) == ((512, 512), {"shading": "phong"}, 1)
    assert np.ptp(scene.render((16, 16))) > 0.1


def test_a_scene_is_what_its_numbers_say(run: Run, here: Path) -> None:
    (here / "scene.toml").write_text(SCENE)
    out = run.passed("render", "scene.toml", "-o", "scene.exr", "--quality", "draft")
    assert "wrote scene.exr: 12 x 16 pixels (height x width) in " in out
    import OpenEXR

    with OpenEXR.File(str(here / "scene.exr")) as file:
        pixels = file.channels()["RGB"].pixels
    scene = scene_files.parse_scene(*read_document(here / "scene.toml"))
    np.testing.assert_array_equal(pixels, np.moveaxis(scene.render(), 0, -1))
    np.testing.assert_allclose(pixels[0, 0], 0.1, rtol=1e-6)
    # A spot reaches nothing outside its cone, 45 degrees; ambient light everything that is matt.
    assert pixels[6, 8, 0] > 0.1
    run.passed("render", "scene.toml", "-o", "large.png", "--size", "8x10")
    assert picture(here / "large.png").shape == (8, 10, 3)


def changed(**parts: Any) -> dict[str, Any]:
    return {**tomllib.loads(SCENE), **parts}


def test_every_light_on_a_matt_sphere_and_a_colour_from_its_spectrum() -> None:
    pytest.importorskip("colour")
    red = {"wavelengths": [400, 570, 600, 700], "reflectance": [0.1, 0.1, 0.7, 0.7]}
    lights = [
        {"kind": "environment", "intensity": 0.1},
        {"kind": "point", "position": [1, 1, 3], "quadratic_attenuation": 1},
        {"kind": "polygon", "vertices": [[2, -1, -1], [2, 1, -1], [2, 1, 1]], "two_sided": True},
        {"kind": "distant", "direction": [0, 0, 1]},
    ]
    document = changed(material={"kind": "surface", "terms": [{"brdf": "lambert", "tint": red}]}, lights=lights, size=9)
    image = scene_files.parse_scene(document).render()
    assert image[0, 4, 4] > 3 * image[2, 4, 4] > 0


def test_a_brdf_that_does_not_conserve_needs_a_word(run: Run, here: Path) -> None:
    text = SCENE.replace('"phong", tint = 0.3', '"blinn-phong-8", tint = 0.3')
    (here / "scene.toml").write_text(text)
    err = run.refused("render", "scene.toml", "-o", "a.png")
    assert "material: blinn-phong-8 is not validated (VIOLATES: albedo 1.0752" in err
    assert "allow_unvalidated = true" in err
    (here / "scene.toml").write_text("allow_unvalidated = true\n" + text)
    run.passed("render", "scene.toml", "-o", "a.png")


def material(**parts: Any) -> dict[str, Any]:
    return {"material": {"kind": "surface", "terms": [{"brdf": "lambert", "tint": 0.5, **parts}]}}


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"size": "big"}, "scene: size: must be a number of pixels or [height, width], each from 1 to 16384; got 'big'"),
        ({"size": [0, 4]}, "scene: size: must be a number of pixels or [height, width]"),
        ({"background": -1}, "scene: background must be finite and >= 0; got -1"),
        ({"background": [1, 2]}, "scene: background must be a number or three"),
        ({"lights": [{"kind": "distant", "direction": [0, 0, 0]}]}, "lights[0]: direction must not have length 0"),
        ({"lights": [{"kind": "point", "position": [0, 0, 1], "intensity": float("nan")}]}, "intensity must be finite"),
        ({"lights": [{"kind": "polygon", "vertices": [[0, 0, 1], [1, 0, 1]]}]}, "needs at least 3 vertices"),
        (
            {"camera": {"kind": "perspective", "field_of_view": 200}},
            "field_of_view must be finite and > 0 and <= 179.99; got 200",
        ),
        ({"geometry": {"kind": "icosphere", "level": 99}}, "geometry: level must be an integer from 0 to 8; got 99"),
        (material(brdf="fong"), "material.terms[0]: unknown BRDF 'fong'; did you mean"),
        (material(n=3), "material.terms[0]: lambert has no parameter 'n'"),
        (material(fresnel="x"), "fresnel must be one of none, exact, schlick; got 'x'"),
        (material(tint=2.0), "the surface reflects up to 2 of the light in channel R"),
        (
            {"material": {"kind": "metal", "base": 0.5, "lobes": 3}},
            "material: lobes must be pairs of weight and slope, at least one; got 3",
        ),
        ({"material": {"kind": "highlight", "base": 2}}, "material: base must be finite and >= 0 and <= 1; got 2"),
    ],
)
def test_scenes_that_are_wrong_name_the_key_and_what_is_allowed(parts: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError) as caught:
        scene_files.parse_scene(changed(**parts))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_only_rendering_finds_out(run: Run, here: Path) -> None:
    (here / "scene.toml").write_text(SCENE.replace("eye = [0, 1, 5]", "eye = [0, 0.1, 0.5]"))
    assert "the camera is inside the sphere" in run.refused("render", "scene.toml", "-o", "a.png")
    text = SCENE.replace('kind = "ambient"', 'kind = "polygon"\nvertices = [[2, -1, -1], [2, 1, -1], [2, 1, 1]]')
    (here / "scene.toml").write_text(text)
    err = run.refused("render", "scene.toml", "-o", "a.png")
    assert "lights[1]: a Polygon light has a closed form on matt terms only; this surface has Phong" in err
    assert "=True" not in err
    # Each number is one of single precision, and two lights together are none.
    light = '[[lights]]\nkind = "distant"\ndirection = [0, 1, 5]\nintensity = 3e38\n'
    (here / "scene.toml").write_text(SCENE[: SCENE.index("[[lights]]")].replace("tint = 0.3", "tint = 0.4") + 2 * light)
    assert "pixels are not finite in single precision" in run.refused("render", "scene.toml", "-o", "a.png")
    assert not (here / "a.png").exists()
