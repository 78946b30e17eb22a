"""What pictures are made with: a canvas, false colours with their scale, curves in a square, pictures below one another.

Images are linear RGB of shape (3, height, width), as in `brdfcheck.scene.images`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.smooth import render_shadings
from brdfcheck.scene.sphere import sphere_image

Image = Float[np.ndarray, "3 height width"]

QUALITIES: Mapping[str, int] = MappingProxyType({"draft": 1, "normal": 2, "high": 4})
"""Samples along each side of a pixel."""


@dataclass(frozen=True)
class Canvas:
    """Renders squares of `side` pixels, each the mean of samples x samples."""

    side: int
    samples: int = 2
    done: Callable[[], None] = lambda: None
    """Called after each picture."""

    @property
    def size(self) -> tuple[int, int]:
        """The size at which is rendered."""
        return self.side * self.samples, self.side * self.samples

    def mean(self, image: Any) -> Image:
        """The mean of the samples of each pixel, in linear light."""
        mean = averaged(image, self.samples)
        self.done()
        return mean

    def sphere(self, material: Any, lights: Any, camera: Any = None, **options: Any) -> Image:
        return self.mean(sphere_image(material, lights, camera, size=self.size, **options))

    def meshes(
        self, mesh: Any, camera: Any, material: Any, lights: Any, shadings: Sequence[str], **options: Any
    ) -> list[Image]:
        """The mesh under several shadings."""
        images = render_shadings(mesh, camera, material, lights, shadings, size=self.size, **options)
        return [self.mean(image) for image in images]

    def checks(self) -> np.ndarray:
        """A chequered background at the size at which is rendered."""
        square = np.arange(self.size[0]) * 8 // self.size[0]
        board = np.where((square[:, None] + square) % 2, 0.75, 0.15).astype(np.float32)
        return np.broadcast_to(board, (3, *board.shape))


def averaged(image: Any, samples: int) -> Float[np.ndarray, "... height width"]:
    """The mean of squares of samples x samples pixels, of shape (..., height, width)."""
    array = np.asarray(image, np.float32)
    *channels, height, width = array.shape
    return array.reshape(*channels, height // samples, samples, width // samples, samples).mean(axis=(-3, -1))


UPPER_RIGHT, LEFT, BELOW = (1.0, 1.0, 1.0), (-1.0, 0.1, 0.2), (-0.1, -1.0, 0.2)


def matt_and_glossy(tint: Any = (0.55, 0.2, 0.1), gloss: float = 0.12, n: float = 60.0) -> Surface:
    """A matt term and a glossy one, whose sum conserves."""
    return Surface(Term("lambert", tint), Term("blinn-phong", gloss, n=n))


# --- pictures that show numbers ---

_LEAST, _MOST = 1e-4, 4.0
_TEXT, _MARGIN = 13, 8  # pixels


def _linear(srgb: Any) -> np.ndarray:
    srgb = np.asarray(srgb, float)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def false_color(excess: Float[Any, "..."], least: float = _LEAST, most: float = _MOST) -> Float[np.ndarray, "3 ..."]:
    """An excess of `least` to `most` on a logarithmic scale from purple to yellow; a smaller one white, a loss grey to black.

    Grey is 1 + excess in sRGB: black where nothing comes back. Beyond `most` it stays yellow.
    """
    from matplotlib import colormaps

    excess = np.nan_to_num(np.asarray(excess, float), nan=-1.0)
    place = np.log(np.maximum(excess, least) / least) / np.log(most / least)
    hot = np.moveaxis(np.asarray(colormaps["plasma"](np.clip(place, 0, 1)))[..., :3], -1, 0)
    return _linear(np.where(excess < least, np.clip(1 + excess, 0, 1), hot))


def _drawn(height: int, width: int, draw: Any) -> np.ndarray:
    """A white image with what ``draw(canvas, font)`` puts on it."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.new("RGB", (width, height), "white")
    draw(ImageDraw.Draw(image), ImageFont.load_default(_TEXT))
    return _linear(np.moveaxis(np.asarray(image, float) / 255, -1, 0))


def color_scale(
    width: int, title: str, least: float = _LEAST, most: float = _MOST, grey: bool = False
) -> Float[np.ndarray, "3 height width"]:
    """The scale of `false_color` from `least` to `most`, with its decades written below and `title` above.

    `grey`: left of it the scale of what is less than 1. It is wider than `width` where the title asks for that.
    """
    from PIL import ImageFont

    height, bar = 58, 14
    width = max(width, int(ImageFont.load_default(_TEXT).getlength(title)) + 2 * _MARGIN)
    left, right = _MARGIN + width // 12, width - width // 12 - _MARGIN
    first = left  # of the colours
    if grey:
        first = left + (right - left) // 3
    shades = first - left - 5 * _TEXT  # the numbers of the two scales need room
    decades = np.arange(np.ceil(np.log10(least) - 1e-9), np.log10(most) + 1e-9)
    ticks = sorted({*(10.0**decades), most})

    def draw(canvas: Any, font: Any) -> None:
        canvas.text((width / 2, 2), title, "black", font=font, anchor="ma")
        marks = [(first + (right - first - 1) * np.log(tick / least) / np.log(most / least), tick) for tick in ticks]
        marks += [(left + (shades - 1) * reflected, reflected) for reflected in (0, 0.5, 1) if grey]
        for x, number in marks:
            canvas.line([(x, 22 + bar), (x, 26 + bar)], "black")
            canvas.text((x, 27 + bar), f"{number:g}", "black", font=font, anchor="ma")

    image = _drawn(height, width, draw)
    values = np.geomspace(least, most, right - first)
    image[:, 22 : 22 + bar, first:right] = false_color(values, least, most)[:, None]
    if grey:
        image[:, 22 : 22 + bar, left : left + shades] = false_color(np.linspace(-1, 0, shades), least, most)[:, None]
    return image


def curve(
    side: int, x: Float[Any, " k"], y: Float[Any, " k"], low: float, high: float, span: tuple[float, float] | None = None
) -> Float[np.ndarray, "3 side side"]:
    """A curve in a square whose width is `span` (None: all of x); `low`, `high` and the middle are marked."""
    first, last = (np.min(x), np.max(x)) if span is None else span

    def draw(canvas: Any, font: Any) -> None:
        levels = [(level, float((high - level) / (high - low) * (side - 1))) for level in (low, (low + high) / 2, high)]
        for _, height in levels:
            canvas.line([(0, height), (side, height)], (200, 200, 200))
        across = (np.asarray(x) - first) / (last - first) * (side - 1)
        up = np.clip((high - np.asarray(y)) / (high - low), -0.1, 1.1) * (side - 1)
        canvas.line(list(zip(across.tolist(), up.tolist(), strict=True)), "black", width=max(side // 150, 1))
        for level, height in levels:  # last, and with a white edge: a curve behind a number leaves it legible
            place = (2, min(max(height - 8, 8), side - 9))
            canvas.text(
                place, f"{level:g}", (110, 110, 110), font=font, anchor="lm", stroke_width=2, stroke_fill=(255, 255, 255)
            )

    return _drawn(side, side, draw)


def stacked(*images: Any) -> Float[np.ndarray, "3 height width"]:
    """Images below one another, in the middle of white where they are narrower than the widest."""
    arrays = [np.asarray(image, np.float32) for image in images]
    width = max(array.shape[2] for array in arrays)
    sides = [(width - array.shape[2], (width - array.shape[2]) // 2) for array in arrays]
    return np.concatenate(
        [
            np.pad(array, ((0, 0), (0, 0), (left, spare - left)), constant_values=1)
            for array, (spare, left) in zip(arrays, sides, strict=True)
        ],
        axis=1,
    )


GROUND = (0.55, 0.68, 0.85)  # pale blue: what is not the object


def colored(excess: Float[np.ndarray, "n n"], covered: Float[np.ndarray, "n n"], *scale: float) -> Float[np.ndarray, "3 n n"]:
    """An excess in false colour where a pixel is `covered` by half or more, and the ground elsewhere.

    Both are means over the samples of a pixel, the excess 0 beside the object. The excess is averaged, not its colour: a
    mean of colours is on no scale.
    """
    inside = covered >= 0.5
    mean = excess / np.where(inside, covered, 1)
    return np.where(inside, false_color(mean, *scale), np.array(GROUND)[:, None, None]).astype(np.float32)
