"""Images and files: PNG of 8 and 16 bit in sRGB, EXR with the linear numbers, contact sheets with labelled axes.

Images are linear RGB of shape (3, height, width), the top row first. The same image gives the same bytes.
"""

from __future__ import annotations

import importlib
import io
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from brdfcheck.messages import one_of
from brdfcheck.output import records

KINDS = ("png", "exr")
_MARGIN, _TEXT = 8, 15  # pixels


def _checked(image: Any) -> Float[np.ndarray, "3 height width"]:
    array = np.asarray(image)
    if array.ndim != 3 or array.shape[0] != 3 or not array.size:
        raise ValueError(f"an image has shape (3, height, width); got {array.shape}")
    return array


def codes(image: Any, bits: int = 8) -> np.ndarray:
    """The image as sRGB codes of 8 or 16 bit, shape (height, width, 3). ValueError for other bits or another shape."""
    if bits not in (8, 16):
        raise ValueError(f"bits must be 8 or 16; got {bits!r}")
    scaled = np.rint(encode_srgb(_checked(image)) * (2**bits - 1))
    return np.ascontiguousarray(np.moveaxis(scaled, 0, -1).astype(np.uint8 if bits == 8 else np.uint16))


def tone_mapped(image: Any) -> tuple[Float[np.ndarray, "3 height width"], float]:
    """(the image with its brightest pixel at 1, the largest number M in it), for pictures whose highlights exceed 1.

    Up to M = 2 it is divided by M. A brighter one is halved, and what is then above 1/2 runs along a logarithm that goes on
    with the same slope and ends at 1: matt parts keep their shading, and a highlight of any height its shape. Pixels keep
    their colour; an image without anything above 1 stays as it is.
    """
    array = _checked(image)
    most = float(np.max(array, where=np.isfinite(array), initial=0.0))
    if most <= 2:
        return array / np.float32(max(most, 1.0)), most
    steep = most
    for _ in range(60):  # by Newton's method steep = log(1 + steep (M - 1)), so that the slopes are equal at 1
        steep -= (steep - np.log1p(steep * (most - 1))) / (1 - (most - 1) / (1 + steep * (most - 1)))
    height = np.max(array, axis=0)
    beyond = 0.5 + 0.5 * np.log1p(steep * np.maximum(height - 1, 0)) / np.log1p(steep * (most - 1))
    scale = np.where(height > 1, beyond / np.maximum(height, 1), 0.5)
    return np.asarray(array * scale, np.float32), most


def png_bytes(image: Any, bits: int = 8) -> bytes:
    """A PNG of the image in sRGB, marked as such. Values outside [0, 1] are cut off. ValueError as for `codes`."""
    import png

    array = codes(image, bits)
    height, width, _ = array.shape
    stream = io.BytesIO()
    writer = png.Writer(width, height, greyscale=False, bitdepth=bits, compression=9)  # pyright: ignore[reportArgumentType]
    writer.write(stream, array.reshape(height, 3 * width))
    # pypng has no word for it: after the signature and the header, 8 and 25 bytes: the chunk that says sRGB, perceptual intent.
    return stream.getvalue()[:33] + _SRGB + stream.getvalue()[33:]


_SRGB = bytes.fromhex("00000001 73524742 00 aece1ce9")


def exr_bytes(image: Any, metadata: Mapping[str, Any] | None = None) -> bytes:
    """An EXR of the linear numbers as float32 channels R, G, B; `metadata` becomes strings in the header."""
    channels = dict(zip("RGB", _checked(image), strict=True))
    return records.exr_bytes(channels, {key: str(value) for key, value in (metadata or {}).items()})


def write_image(path: str | os.PathLike[str], image: Any, *, bits: int = 8, metadata: Mapping[str, Any] | None = None) -> None:
    """Write an image whole or not at all, by the file's ending: .png (sRGB, 8 or 16 `bits`) or .exr (linear float32).

    ValueError for another ending, bits or shape; OSError, naming the file, where it cannot be written.
    """
    kind = Path(path).suffix.removeprefix(".").lower()
    if kind not in KINDS:
        raise ValueError(f"the name of an image must end in .png or .exr; got {os.fspath(path)!r}")
    refused = records.refuse_output(os.fspath(path))
    if refused is not None:
        raise OSError(f"cannot write {os.fspath(path)}: {refused}")
    records.write_atomically(path, png_bytes(image, bits) if kind == "png" else exr_bytes(image, metadata))


def contact_sheet(
    rows: Sequence[Sequence[Any]],
    *,
    columns: Sequence[str] = (),
    labels: Sequence[str] = (),
    across: str = "",
    down: str = "",
) -> Float[np.ndarray, "3 height width"]:
    """Images of one size in rows and columns, pixel for pixel, as one linear image on white.

    `columns` and `labels` are written over the columns and before the rows; `across` and `down` name the two axes. Columns
    are as far apart as the longest of their titles is wide.
    ValueError for rows that differ in length, images that differ in size, or as many labels as do not fit.
    """
    from PIL import Image, ImageDraw, ImageFont

    images = [[_checked(image) for image in row] for row in rows]
    if not images or len({len(row) for row in images}) != 1 or not images[0]:
        raise ValueError(f"a contact sheet has rows of equal length; got {[len(row) for row in images]}")
    if len({image.shape for row in images for image in row}) != 1:
        raise ValueError(f"the images of a contact sheet have one size; got {sorted({i.shape for r in images for i in r})}")
    for name, given, wanted in (("columns", columns, len(images[0])), ("labels", labels, len(images))):
        if given and len(given) != wanted:
            raise ValueError(f"{name} must be {wanted} texts; got {len(given)}")
    font = ImageFont.load_default(_TEXT)

    def length(text: str) -> int:
        return max(math.ceil(font.getlength(line)) for line in text.split("\n"))

    high_titles = max((text.count("\n") + 1 for text in columns), default=0)
    lines = (high_titles + bool(across)) * (_TEXT + _MARGIN)
    left = max(map(length, [*labels, down]))
    left += _MARGIN * bool(left)
    _, high, wide = images[0][0].shape
    cell = max([wide, *(length(text) + _MARGIN for text in columns)])  # a title may need more than its picture
    body = max(len(images[0]) * (cell + _MARGIN) - _MARGIN, length(across))
    first = left + _MARGIN + (body - len(images[0]) * (cell + _MARGIN) + _MARGIN) // 2
    height, width = lines + len(images) * (high + _MARGIN), left + _MARGIN + body
    mask = Image.new("L", (width + _MARGIN, height + _MARGIN))
    draw: Any = ImageDraw.Draw(mask)
    draw.text((left + _MARGIN + body / 2, _MARGIN), across, 255, font=font, anchor="ma")
    for column, text in enumerate(columns):
        draw.text((first + column * (cell + _MARGIN) + cell / 2, lines), text, 255, font=font, anchor="md", align="center")
    draw.text((_MARGIN, lines), down, 255, font=font, anchor="ld")
    for row, text in enumerate(labels):
        place = (left, lines + _MARGIN + row * (high + _MARGIN) + high / 2)
        draw.text(place, text, 255, font=font, anchor="rm", align="right")
    sheet = np.repeat((1 - np.asarray(mask, np.float32) / 255)[None], 3, axis=0)
    for i, row in enumerate(images):
        for j, image in enumerate(row):
            top, start = lines + _MARGIN + i * (high + _MARGIN), first + j * (cell + _MARGIN) + (cell - wide) // 2
            sheet[:, top : top + high, start : start + wide] = image
    return sheet


# --- colours from spectra ---


Observer = Literal["CIE RGB", "CIE XYZ"]
_OBSERVERS = {"CIE RGB": "Wright & Guild 1931 2 Degree RGB CMFs", "CIE XYZ": "CIE 1931 2 Degree Standard Observer"}


def encode_srgb(linear: Any) -> Float[np.ndarray, "..."]:
    """Linear light to the sRGB transfer curve (IEC 61966-2-1), both in [0, 1]; values outside are cut off, NaN is 0."""
    value = np.clip(np.nan_to_num(np.asarray(linear, np.float64), nan=0.0), 0, 1)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def rgb_of_spectrum(
    wavelengths: Any, reflectance: Any, *, illuminant: str = "D65", observer: Observer = "CIE XYZ"
) -> Float[np.ndarray, " 3"]:
    r"""The colour of a reflectance spectrum under an illuminant, linear, where a perfect white is (1, 1, 1).

    $R = \int \bar r C I\, d\lambda$ and G, B likewise (Yokoi et al., eq. 2), with C the `reflectance` at the rising
    `wavelengths` (nm; between them a straight line, beyond them the end values) and I the illuminant, over 1 nm steps.

    * observer "CIE RGB": the integrals themselves over those of white: the primaries of the colour-matching functions;
    * observer "CIE XYZ": X, Y, Z likewise, then linear sRGB, adapted from the illuminant's white to D65 (Bradford).

    Saturated colours may have components below 0 or above 1. Needs colour-science (``pip install 'brdfcheck[colour]'``):
    ImportError without it. ValueError for spectra that are not finite, negative or of unequal length, or unknown names.
    """
    wavelengths, reflectance = np.asarray(wavelengths, float), np.asarray(reflectance, float)
    good = wavelengths.ndim == 1 and wavelengths.size > 1 and wavelengths.shape == reflectance.shape
    if not (good and np.all(np.isfinite(wavelengths)) and np.all(np.diff(wavelengths) > 0)):
        raise ValueError("a spectrum is at least two rising wavelengths in nm and as many reflectances")
    if not np.all(np.isfinite(reflectance) & (reflectance >= 0)):
        raise ValueError(f"reflectances must be finite and >= 0; the smallest is {np.min(reflectance):g}")
    one_of(observer, _OBSERVERS, "observer")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what colour-science itself could use and does not find
        try:
            colour = importlib.import_module("colour")
        except ImportError as error:
            raise ImportError("colours from spectra need colour-science: pip install 'brdfcheck[colour]'") from error
        if illuminant not in colour.SDS_ILLUMINANTS:  # which reads names whatever their case
            raise ValueError(f"illuminant must be one of {', '.join(colour.SDS_ILLUMINANTS)}; got {illuminant!r}")
        matching = colour.MSDS_CMFS[_OBSERVERS[observer]]
        light = colour.SDS_ILLUMINANTS[illuminant]
        nodes = np.arange(matching.wavelengths[0], matching.wavelengths[-1] + 0.5)
        bars = np.stack([np.interp(nodes, matching.wavelengths, column) for column in matching.values.T])
        power = np.interp(nodes, light.wavelengths, light.values, left=0, right=0)
        seen = bars @ (np.interp(nodes, wavelengths, reflectance) * power)
        white = bars @ power
        if observer == "CIE RGB":
            return seen / white
        to_xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
        adapted = colour.chromatic_adaptation(
            seen / white[1], white / white[1], to_xyz @ np.ones(3), method="Von Kries", transform="Bradford"
        )
        return np.asarray(np.linalg.solve(to_xyz, adapted))
