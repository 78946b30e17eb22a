"""Images and files: PNG of 8 and 16 bit in sRGB, EXR with the linear numbers, contact sheets with labelled axes.

Images are linear RGB of shape (3, height, width), the top row first. The same image gives the same bytes.
"""

from __future__ import annotations

import io
import math
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from brdfcheck.interruption import Cleanup
from brdfcheck.output import records
from brdfcheck.scene.colour import encode_srgb

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
    import OpenEXR

    channels = np.ascontiguousarray(_checked(image), dtype=np.float32)
    header: dict[str, Any] = {f"brdfcheck.{key}": str(value) for key, value in (metadata or {}).items()}
    header |= {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with tempfile.TemporaryDirectory(prefix="brdfcheck-") as folder, Cleanup(lambda: shutil.rmtree(folder)):
        path = Path(folder, "image.exr")
        with OpenEXR.File(header, dict(zip("RGB", channels, strict=True))) as file:
            file.write(str(path))
        return path.read_bytes()


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
    ground: float = 1.0,
) -> Float[np.ndarray, "3 height width"]:
    """Images of one size in rows and columns, pixel for pixel, as one linear image on a ground of that grey.

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

    lines = (bool(columns) + bool(across)) * (_TEXT + _MARGIN)
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
        draw.text((first + column * (cell + _MARGIN) + cell / 2, lines), text, 255, font=font, anchor="md")
    draw.text((_MARGIN, lines), down, 255, font=font, anchor="ld")
    for row, text in enumerate(labels):
        place = (left, lines + _MARGIN + row * (high + _MARGIN) + high / 2)
        draw.text(place, text, 255, font=font, anchor="rm", align="right")
    ink = 0.0 if ground > 0.2 else 1.0
    sheet = np.repeat((ground + (ink - ground) * np.asarray(mask, np.float32) / 255)[None], 3, axis=0)
    for i, row in enumerate(images):
        for j, image in enumerate(row):
            top, start = lines + _MARGIN + i * (high + _MARGIN), first + j * (cell + _MARGIN) + (cell - wide) // 2
            sheet[:, top : top + high, start : start + wide] = image
    return sheet
