"""Colours and files: spectra against colour-science's own integration, PNG and EXR read back by other readers, bytes."""

from __future__ import annotations

import hashlib
import io
import warnings

import numpy as np
import pytest
from PIL import Image
from shared import picture

from brdfcheck.scene import images
from brdfcheck.scene.images import encode_srgb, rgb_of_spectrum

IMAGE = np.random.default_rng(0).uniform(-0.1, 1.2, (3, 21, 34)).astype(np.float32)
WAVELENGTHS, ORANGE = [380, 550, 600, 780], [0.05, 0.1, 0.8, 0.9]


def colour_science():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("colour")


def test_srgb_curve():
    np.testing.assert_allclose(encode_srgb([0, 0.0031308, 0.5, 1]), [0, 0.04044994, 0.73535698, 1], atol=1e-8)
    np.testing.assert_allclose(encode_srgb([-1, 2, np.nan, np.inf]), [0, 1, 0, 1], atol=1e-15)


@pytest.mark.parametrize("illuminant", ["D65", "A", "E"])
def test_white_is_white_and_grey_is_grey_under_every_light(illuminant):
    colour_science()
    for observer in ("CIE RGB", "CIE XYZ"):
        for share in (1.0, 0.18):
            found = rgb_of_spectrum([300, 900], [share, share], illuminant=illuminant, observer=observer)
            np.testing.assert_allclose(found, share, rtol=1e-12)


def test_colours_of_spectra():
    colour = colour_science()
    orange = rgb_of_spectrum(WAVELENGTHS, ORANGE)
    nodes = np.arange(380, 781)
    spectrum = colour.SpectralDistribution(dict(zip(nodes, np.interp(nodes, WAVELENGTHS, ORANGE), strict=True)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tristimulus = colour.sd_to_XYZ(spectrum, illuminant=colour.SDS_ILLUMINANTS["D65"], method="Integration") / 100
        expected = colour.XYZ_to_RGB(tristimulus, "sRGB", apply_cctf_encoding=False)
    np.testing.assert_allclose(orange, expected, atol=5e-4)
    # The CIE RGB integrals by hand, from the table of the observer.
    matching = colour.MSDS_CMFS["Wright & Guild 1931 2 Degree RGB CMFs"]
    light = colour.SDS_ILLUMINANTS["A"]
    power = np.interp(matching.wavelengths, light.wavelengths, light.values)
    seen = np.interp(matching.wavelengths, WAVELENGTHS, ORANGE) * power
    expected = (matching.values.T @ seen) / (matching.values.T @ power)
    found = rgb_of_spectrum(WAVELENGTHS, ORANGE, illuminant="A", observer="CIE RGB")
    np.testing.assert_allclose(found, expected, atol=2e-3)
    assert found[0] > found[1] > found[2]


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (([400], [1]), {}, "at least two rising wavelengths"),
        (([500, 400], [1, 1]), {}, "at least two rising wavelengths"),
        (([400, 500], [1, -0.1]), {}, "reflectances must be finite and >= 0; the smallest is -0.1"),
        (([400, 500], [1, 1]), {"observer": "dog"}, "observer must be one of CIE RGB, CIE XYZ"),
        (([400, 500], [1, 1]), {"illuminant": "D99"}, "illuminant must be one of A, "),
    ],
)
def test_bad_spectra_are_refused(arguments, options, words):
    colour_science()
    with pytest.raises(ValueError, match=words):
        rgb_of_spectrum(*arguments, **options)


@pytest.mark.parametrize("bits", [8, 16])
def test_png_holds_the_srgb_codes(bits, tmp_path):
    path = tmp_path / "image.png"
    images.write_image(path, IMAGE, bits=bits)
    found, top = picture(path), 2**bits - 1
    assert (found.shape, found.dtype) == ((21, 34, 3), f"uint{bits}")
    np.testing.assert_array_equal(found, np.rint(encode_srgb(np.moveaxis(IMAGE, 0, -1)) * top))
    assert found.min() == 0
    assert found.max() == top
    with Image.open(path) as other:
        other.load()
        assert other.info["srgb"] == 0
        np.testing.assert_allclose(np.asarray(other), found / (1 if bits == 8 else 257), atol=1)


def test_exr_holds_the_linear_numbers(tmp_path):
    import OpenEXR

    path = tmp_path / "image.exr"
    images.write_image(path, IMAGE, metadata={"scene": "sphere", "n": 10})
    with OpenEXR.File(str(path)) as file:
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, np.moveaxis(IMAGE, 0, -1))
        assert file.header()["brdfcheck.scene"] == "sphere"
        assert file.header()["brdfcheck.n"] == "10"


def test_the_same_image_gives_the_same_bytes():
    for make in (lambda: images.png_bytes(IMAGE, 8), lambda: images.png_bytes(IMAGE, 16), lambda: images.exr_bytes(IMAGE)):
        assert hashlib.sha256(make()).digest() == hashlib.sha256(make()).digest()
    assert b"tIME" not in images.png_bytes(IMAGE)


def test_a_contact_sheet_is_pixel_for_pixel_with_its_labels():
    rows = [[np.full((3, 40, 60), 0.1 * (3 * i + j), np.float32) for j in range(3)] for i in range(2)]
    bare = images.contact_sheet(rows)
    assert bare.shape == (3, 2 * 48 + 8, 3 * 68 + 8)
    for i in range(2):
        for j in range(3):
            np.testing.assert_array_equal(bare[:, 8 + 48 * i : 48 + 48 * i, 8 + 68 * j : 68 + 68 * j], rows[i][j])
    texts = {"columns": ["2", "4", "6"], "labels": ["low", "high"], "across": "exponent n", "down": "row"}
    sheet = images.contact_sheet(rows, **texts)
    top, left = sheet.shape[1] - bare.shape[1], sheet.shape[2] - bare.shape[2]
    np.testing.assert_array_equal(sheet[:, top + 8 : top + 48, left + 8 : left + 68], rows[0][0])
    assert np.all(sheet[:, :top].min() == 0)  # ink
    other = images.contact_sheet(rows, **texts | {"columns": ["2", "4", "8"]})
    changed = np.nonzero(np.any(sheet != other, axis=0))
    assert changed[1].min() > left + 2 * 68  # over the last column only
    assert changed[0].max() < top + 8
    image = Image.open(io.BytesIO(images.png_bytes(sheet)))
    assert image.size == sheet.shape[:0:-1]


def test_titles_wider_than_their_pictures_take_room_and_do_not_meet():
    tile = np.full((3, 20, 20), 0.5, np.float32)
    titles = ["binomial-power-half", "kuijk-blake-mirror"]
    sheet = images.contact_sheet([[tile, tile]], columns=titles)
    ink = np.nonzero((sheet[0] < 0.4).any(axis=0))[0]  # darker than the pictures: the text alone
    other = np.nonzero((images.contact_sheet([[tile, tile]], columns=[titles[0], ""])[0] < 0.4).any(axis=0))[0]
    assert ink.min() > 0
    assert ink.max() < sheet.shape[2] - 1
    second = ink[ink > other.max()]
    assert second.min() - other.max() > 6  # a gap between the two
    left, right = (np.nonzero(sheet[0, -20] == 0.5)[0][part] for part in (slice(20), slice(20, None)))
    for found, text in ((left, other), (right, second)):  # each picture below the middle of its title
        assert abs((found[0] + found[-1]) - (text.min() + text.max())) <= 6
    long = "highlight on a facet's centre: what Gouraud shading leaves of it"
    ink = np.nonzero((images.contact_sheet([[tile]], across=long, labels=["two\nlines"])[0] < 0.4).any(axis=0))[0]
    assert ink.min() > 0
    assert ink.max() < images.contact_sheet([[tile]], across=long, labels=["two\nlines"]).shape[2] - 1
    assert (
        images.contact_sheet([[tile]], labels=["two\nlines"]).shape < images.contact_sheet([[tile]], labels=["two lines"]).shape
    )


@pytest.mark.parametrize(
    ("act", "error", "words"),
    [
        (lambda folder: images.write_image(folder / "a.jpg", IMAGE), ValueError, "must end in"),
        (
            lambda folder: images.write_image(folder / "no" / "a.png", IMAGE),
            OSError,
            "cannot write .*: the folder .* does not exist",
        ),
        (lambda folder: images.write_image(folder / "a.png", IMAGE, bits=12), ValueError, "bits must be 8 or 16; got 12"),
        (lambda folder: images.write_image(folder / "a.png", IMAGE[0]), ValueError, r"shape \(3, height, width\)"),
        (lambda folder: images.contact_sheet([[IMAGE], [IMAGE, IMAGE]]), ValueError, "rows of equal length"),
        (lambda folder: images.contact_sheet([[IMAGE, IMAGE[:, 1:]]]), ValueError, "one size"),
        (lambda folder: images.contact_sheet([[IMAGE]], columns=["a", "b"]), ValueError, "columns must be 1 texts; got 2"),
    ],
)
def test_bad_files_and_sheets_are_refused(act, error, words, tmp_path):
    with pytest.raises(error, match=words):
        act(tmp_path)
    assert not list(tmp_path.iterdir())
