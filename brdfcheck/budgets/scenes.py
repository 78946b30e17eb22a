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
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from jaxtyping import Float

from brdfcheck.documents import Model, read_document, shown, validated
from brdfcheck.messages import UsageError
from brdfcheck.scene import files as scene_files
from brdfcheck.scene.images import encode_srgb
from brdfcheck.scene.materials import Surface

OWN = ("output", "matters", "room")
"""The tables of a scene that ``brdfcheck.scene.files`` does not read."""
_MOST_PIXELS = 2**24


def tolerance_of(value: Any) -> float:
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
        raise ValueError(f'tolerance must be a number from 0 to 1 or a fraction, as in "0.5/255"; got {shown(value)}')
    return result


def _part(value: Any) -> float:
    try:
        return tolerance_of(value)
    except ValueError:
        raise ValueError('must be a number from 0 to 1 or a fraction, as in "0.5/255"') from None


_Tolerance = Annotated[Any, pydantic.AfterValidator(_part)]


class Output(Model):
    """On what a picture is shown: `bits` of a component, after which transfer curve."""

    bits: Literal[8, 16] = 8
    transfer: Literal["srgb", "linear"] = "srgb"


class Matters(Model):
    """What matters: `pixel` and `energy` are tolerances; None: half a step of the output, and any."""

    pixel: _Tolerance = None
    energy: _Tolerance = math.inf
    silhouette: bool = True


class Room(Model):
    """A closed cube: `reflectance` of all walls in [0, 1), radiosity `emission` of the ceiling (+y), `cells` along an edge."""

    # At 1 the light would grow from bounce to bounce without end.
    reflectance: float = pydantic.Field(ge=0, lt=1)
    emission: float = pydantic.Field(ge=0)
    cells: int = pydantic.Field(4, ge=1, le=12)


def _few(size: scene_files.Size) -> scene_files.Size:
    if size[0] * size[1] > _MOST_PIXELS:
        raise ValueError(f"must be at most {_MOST_PIXELS} pixels in all")
    return size


_TABLE: Any = pydantic.create_model(
    "Budget",
    __base__=scene_files.SceneTable,
    __validators__={"few": pydantic.field_validator("size")(_few)},
    output=(Output, Output()),
    matters=(Matters, Matters()),
    room=(Room, None),
)


@dataclass(frozen=True, eq=False)  # what is computed of one is kept by its identity
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

    def shown(self, linear: Any) -> Float[np.ndarray, "..."]:
        """Linear light after the transfer curve, in [0, 1]."""
        return encode_srgb(linear) if self.transfer == "srgb" else np.clip(linear, 0, 1)


def read_scene(path: str | Path) -> Scene:
    """The scene in a TOML file. UsageError where there is none, or where something in it is wrong."""
    document, label = read_document(path)
    return parse_scene(document, label, folder=Path(path).parent)


def parse_scene(document: Mapping[str, Any], label: str = "scene", *, folder: Path | None = None) -> Scene:
    """The scene in a document with the keys of the TOML file.

    `label`: the document's name in messages, for a file its path. `folder`: where files that the scene names are looked for, by
    default that of `label`.

    Raises UsageError where something in the document is wrong.
    """
    if document.get("allow_unvalidated", False) is not False:
        raise UsageError(f"{label}: allow_unvalidated has no place here: what does not conserve energy is never chosen")
    table: Any = validated(_TABLE, {key: value for key, value in document.items() if key != "allow_unvalidated"}, label)
    picture = scene_files.scene_of(table, label, folder, way_out=False)
    material, output, matters = picture.material, table.output, table.matters
    if table.room is not None and not (isinstance(material, Surface) and any(term.matt for term in material.terms)):
        raise UsageError(f"{label}: a room lights matt terms of a surface; the material has none")
    if isinstance(material, Surface) and any(term.transmits for term in material.terms):
        raise UsageError(f"{label}: budgets and rooms are for surfaces that only reflect; the material transmits")
    pixel = 0.5 / (2**output.bits - 1) if matters.pixel is None else matters.pixel
    facets = table.geometry is not None and table.geometry.kind == "icosphere"
    return Scene(picture, label, output.bits, output.transfer, pixel, matters.energy, matters.silhouette, table.room, facets)
