"""Scenes with what a budget needs to know besides: the output, what matters, and the room around the object.

The file is that of ``brdfcheck render`` (`brdfcheck.scene.files`) and three tables more, each optional:

    [output]
    bits = 8                     # 8 or 16
    transfer = "srgb"            # or "linear"

    [matters]
    pixel = "0.5/255"            # the largest error of a pixel, in units of full scale; by default half a step of the output
    energy = 0.01                # the largest relative error of the sum of all pixels, in linear light; by default any
    silhouette = false           # leave out pixels that only one of two images covers; by default true: they count

    [room]                       # a closed cube with the object, small, in its middle: its walls light the matt terms
    reflectance = 0.7            # of its walls, below 1
    emission = 1.5               # radiosity of its ceiling, at +y
    cells = 4                    # patches along an edge

The full model is the scene as it is written; of an icosphere, fewer faces than its level has are tried besides.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brdfcheck.documents import read_document
from brdfcheck.messages import UsageError, one_line
from brdfcheck.scene import files as scene_files
from brdfcheck.scene.materials import Surface

TRANSFERS = ("srgb", "linear")
OWN = ("output", "matters", "room")
"""The tables of a scene that ``brdfcheck.scene.files`` does not read."""
_MOST_PIXELS = 2**24


@dataclass(frozen=True)
class Room:
    """A closed cube: `reflectance` of all walls in [0, 1), radiosity `emission` of the ceiling (+y), `cells` along an edge."""

    reflectance: float
    emission: float
    cells: int = 4


@dataclass(frozen=True)
class Scene:
    """What is rendered, what it is shown on, and what matters.

    `pixel`: tolerance of a pixel in units of full scale, after the transfer curve; `energy`: of the image's sum, relative.
    `facets`: an icosphere, of which there are ones with fewer faces.
    """

    picture: scene_files.Scene
    label: str = "scene"
    bits: int = 8
    transfer: str = "srgb"
    pixel: float = 0.5 / 255
    energy: float = math.inf
    silhouette: bool = True
    room: Room | None = None
    facets: bool = False


def tolerance_of(value: Any, name: str = "tolerance") -> float:
    """A number in [0, 1] or a fraction of full scale as a text, "0.5/255". ValueError for anything else."""
    parts = value.split("/") if isinstance(value, str) else [value]
    try:
        if any(isinstance(part, bool) for part in parts):
            raise ValueError
        numbers = [float(part) for part in parts]
        result = numbers[0] / numbers[1] if len(numbers) == 2 else numbers[0]
        good = len(numbers) < 3 and 0 <= result <= 1
    except (ValueError, TypeError, ZeroDivisionError):
        good, result = False, 0.0
    if not good:
        raise ValueError(
            f'{name} must be a number from 0 to 1 or a fraction, as in "0.5/255"; got {one_line(repr(value))[:60]}'
        )
    return result


def read_scene(path: str | Path) -> Scene:
    """The scene in a TOML file. UsageError where there is none, or where something in it is wrong."""
    return parse_scene(*read_document(path))


def parse_scene(document: Mapping[str, Any], label: str = "scene") -> Scene:
    """The scene in a document with the keys of the TOML file. UsageError where something in it is wrong."""
    picture = scene_files.parse_scene(document, label, validated=True, others=OWN)
    if picture.size[0] * picture.size[1] > _MOST_PIXELS:
        raise UsageError(f"{label}: size must be at most {_MOST_PIXELS} pixels in all; got {picture.size}")
    output = _table(document, "output", label, ("bits", "transfer"))
    bits, transfer = output.get("bits", 8), output.get("transfer", "srgb")
    if isinstance(bits, bool) or bits not in (8, 16):
        raise UsageError(f"{label}: output.bits must be 8 or 16; got {_shown(bits)}")
    if transfer not in TRANSFERS:
        raise UsageError(f"{label}: output.transfer must be one of {', '.join(TRANSFERS)}; got {_shown(transfer)}")
    matters = _table(document, "matters", label, ("pixel", "energy", "silhouette"))
    silhouette = matters.get("silhouette", True)
    if not isinstance(silhouette, bool):
        raise UsageError(f"{label}: matters.silhouette must be true or false; got {_shown(silhouette)}")
    try:
        pixel = tolerance_of(matters.get("pixel", 0.5 / (2**bits - 1)), "matters.pixel")
        energy = tolerance_of(matters["energy"], "matters.energy") if "energy" in matters else math.inf
    except ValueError as error:
        raise UsageError(f"{label}: {error}") from None
    geometry = document.get("geometry", {})
    facets = isinstance(geometry, Mapping) and geometry.get("kind") == "icosphere"
    room = _room(document, picture, label)
    return Scene(picture, label, bits, transfer, pixel, energy, silhouette, room, facets)


def _room(document: Mapping[str, Any], picture: scene_files.Scene, label: str) -> Room | None:
    if "room" not in document:
        return None
    table = _table(document, "room", label, ("reflectance", "emission", "cells"))
    for key in ("reflectance", "emission"):
        value = table.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
            raise UsageError(f"{label}: room.{key} must be a finite number >= 0; got {_shown(value)}")
    if not table["reflectance"] < 1:
        raise UsageError(
            f"{label}: room.reflectance must be below 1; got {table['reflectance']}: in a closed room the light would grow"
            " from bounce to bounce without end"
        )
    cells = table.get("cells", 4)
    if isinstance(cells, bool) or not isinstance(cells, int) or not 1 <= cells <= 12:
        raise UsageError(f"{label}: room.cells must be an integer from 1 to 12; got {_shown(cells)}")
    if not isinstance(picture.material, Surface) or not any(term.matt for term in picture.material.terms):
        raise UsageError(f"{label}: a room lights matt terms of a surface; the material has none")
    return Room(float(table["reflectance"]), float(table["emission"]), cells)


def _table(document: Mapping[str, Any], key: str, label: str, allowed: tuple[str, ...]) -> Mapping[str, Any]:
    table = document.get(key, {})
    if not isinstance(table, Mapping):
        raise UsageError(f"{label}: {key} must be a table, below [{key}]; got {_shown(table)}")
    for name in table:
        if name not in allowed:
            raise UsageError(f"{label}: {key}: unknown key {_shown(name)}; allowed: {', '.join(allowed)}")
    return table


def _shown(value: Any) -> str:
    text = one_line(repr(value))
    return text if len(text) <= 60 else f"{text[:57]}..."
