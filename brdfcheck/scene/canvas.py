"""What pictures are rendered on, and what they share: directions of lights and a matt and glossy surface."""

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

    def checks(self, squares: int = 8, low: float = 0.15, high: float = 0.75) -> np.ndarray:
        """A chequered background at the size at which is rendered."""
        square = np.arange(self.size[0]) * squares // self.size[0]
        board = np.where((square[:, None] + square) % 2, high, low).astype(np.float32)
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
