"""Pictures by name: the seed's figures, the white furnace, lobes, lights, and what smooth shading loses.

A preset is a caption, a side in pixels and a function of a `Canvas`, which renders at that side with several samples to a
pixel. Sheets of several pictures have that side for each. Lights of sheets of one kind are the same; what is exposed
differently says so.
"""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from brdfcheck.messages import UnknownName
from brdfcheck.scene.cameras import checked_size
from brdfcheck.scene.canvas import QUALITIES, Canvas, Image
from brdfcheck.scene.figures import BLUE, figure_9, glass, lights, lobes, metal, polygon_light, row_of, translucent_sheet
from brdfcheck.scene.materials import Highlight, Translucent
from brdfcheck.scene.smooth_shading import gouraud_phong, mach_bands, quadrilaterals, sheets, silhouette_bleed
from brdfcheck.scene.white_furnace import furnace, furnace_validated


@dataclass(frozen=True)
class Preset:
    """A picture: what it shows, the side of each of its squares in pixels, and how it is made."""

    caption: str
    side: int
    make: Callable[[Canvas], Any]


def named(name: str) -> Preset:
    """The preset of that name. KeyError, naming the nearest ones, where there is none."""
    if name in PRESETS:
        return PRESETS[name]
    near = difflib.get_close_matches(name, PRESETS, n=2, cutoff=0.4)
    hint = f"did you mean {' or '.join(near)}?" if near else f"the presets are {', '.join(PRESETS)}"
    raise UnknownName(f"unknown preset {name!r}; {hint}")


def render_preset(
    name: str, size: int | None = None, quality: str = "normal", progress: Callable[[int], None] = lambda count: None
) -> Image:
    """The preset's picture, linear RGB as float32, `size` pixels the side of each square in it (None: its own).

    `progress` is called with the number of pictures that are done, after each.
    KeyError for an unknown name, ValueError for a size that is none or a quality that is not one of `QUALITIES`.
    """
    preset = named(name)
    if quality not in QUALITIES:
        raise ValueError(f"quality must be one of {', '.join(QUALITIES)}; got {quality!r}")
    side = preset.side if size is None else size
    checked_size((side, side))
    count = itertools.count(1)
    return np.asarray(preset.make(Canvas(side, QUALITIES[quality], lambda: progress(next(count)))), np.float32)


_YOKOI = "Yokoi et al., figure"
_PRESETS: dict[str, Preset] = {
    "figure-5": Preset(
        f"{_YOKOI} 5: highlight (4), exponent n, w = 1",
        128,
        row_of((2, 4, 6, 8, 10, 20, 40, 60, 80, 100), "n", lambda n: Highlight(BLUE, n=n)),
    ),
    "figure-6": Preset(
        f"{_YOKOI} 6: highlight (4), weight w, n = 10",
        128,
        row_of((1, 0.8, 0.6, 0.4, 0.2), "w", lambda w: Highlight(BLUE, w=w)),
    ),
    "figure-7": Preset(
        f"{_YOKOI} 7: translucent (8), opacity t_h",
        128,
        translucent_sheet(
            (0, 0.5),
            (0.2, 0.4, 0.6, 0.8, 1.0),
            lambda t_p, t_h, behind: Translucent(BLUE, t_h=t_h, t_p=t_p, behind=behind),
            ("t_p", "t_h"),
        ),
    ),
    "figure-8": Preset(
        f"{_YOKOI} 8: translucent (8), exponent t_p of the opacity",
        128,
        translucent_sheet(
            (0.8,),
            (0, 0.5, 1.0, 1.5, 2.0),
            lambda t_h, t_p, behind: Translucent(BLUE, t_h=t_h, t_p=t_p, behind=behind),
            ("t_h", "t_p"),
        ),
    ),
    "figure-9": Preset(f"{_YOKOI} 9: opaque and translucent spheres, by equation (8) and by rays", 256, figure_9),
    "figure-10": Preset(f"{_YOKOI} 10: metal (12), two lights; exposure 0.75", 256, metal("10")),
    "figure-11": Preset(f"{_YOKOI} 11: metal (12), secondary lights from left and below; exposure 0.75", 256, metal("11")),
    "figure-12": Preset(f"{_YOKOI} 12: metal (15), powers of N.H; exposure 0.75", 256, metal("12")),
    "figure-13": Preset(f"{_YOKOI} 13: metal (16), powers of R.V; exposure 0.75", 256, metal("13")),
    "furnace": Preset("white furnace: published BRDFs beside the validated ones; the excess in false colour", 97, furnace),
    "furnace-validated": Preset("white furnace of every validated BRDF: none glows", 81, furnace_validated),
    "lobes": Preset("lobes at equal n under one light; light scaled by 2 pi/(n+2)", 144, lobes),
    "lights": Preset("one surface under every kind of light; under the polygon its matt part alone", 160, lights),
    "polygon-light": Preset("a square light beside a matt sphere, clipped at its horizon and not", 224, polygon_light),
    "gouraud-phong": Preset("flat, Gouraud and Phong shading at 20 to 1280 faces", 176, gouraud_phong),
    "silhouette-bleed": Preset("colour of the far side at the silhouette of a mesh lit from behind", 176, silhouette_bleed),
    "mach-bands": Preset("jumps of the slope that smooth shading leaves", 208, mach_bands),
    "quadrilaterals": Preset("scan-line interpolation in a square depends on how it is turned", 160, quadrilaterals),
    "sheets": Preset("averaged normals: a zigzag vanishes, a corrugation stays", 224, sheets),
    "glass": Preset("mirror, glass and matt spheres by rays: Fresnel, Snell, shadows", 384, glass),
}

PRESETS: Mapping[str, Preset] = MappingProxyType(_PRESETS)
"""Every preset by its name."""
