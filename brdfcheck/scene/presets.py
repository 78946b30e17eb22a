"""Pictures by name: the seed's figures, the white furnace, lobes, lights, and what smooth shading loses.

A preset is a caption, a side in pixels and a function of a `Canvas`, which renders at that side with several samples to a
pixel. Sheets of several pictures have that side for each. Lights of sheets of one kind are the same; what is exposed
differently says so.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF
from brdfcheck.messages import UnknownName, did_you_mean, one_of
from brdfcheck.scene.artistic import Highlight, Metal, Translucent
from brdfcheck.scene.cameras import Orthographic, Perspective, checked_size
from brdfcheck.scene.canvas import (
    BELOW,
    LEFT,
    QUALITIES,
    UPPER_RIGHT,
    Canvas,
    Image,
    color_scale,
    colored,
    matt_and_glossy,
    stacked,
)
from brdfcheck.scene.images import contact_sheet
from brdfcheck.scene.lights import Ambient, Distant, Environment, Point, Polygon, Spot
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.smooth_shading import gouraud_phong, mach_bands, quadrilaterals, sheets, silhouette_bleed
from brdfcheck.scene.tracing import Plane, Sphere, composed, trace
from brdfcheck.scene.white_furnace import furnace, furnace_of, furnace_validated


@dataclass(frozen=True)
class Preset:
    """A picture: what it shows, the side of each of its squares in pixels, and how it is made."""

    caption: str
    side: int
    make: Callable[[Canvas], Any]


OF_ONE: Mapping[str, Callable[[Canvas, Any, str], Image]] = MappingProxyType(
    {"sphere": lambda canvas, brdf, label: sphere_of(canvas, brdf), "furnace": furnace_of}
)
"""Pictures of one BRDF, by their names: of a canvas, the BRDF, and a label for it."""


def sphere_of(canvas: Canvas, brdf: AbstractBRDF | AbstractBSDF) -> Image:
    """A sphere of one BRDF, validated or not, under one light: white where a matt white one would be.

    What transmits has a light behind it, too, as if each point were alone; what is smooth is traced, with balls behind it.
    """
    surface = Surface(Term(brdf), allow_unvalidated=True)
    lights = [Distant(UPPER_RIGHT, np.pi)]
    if surface.glass is not None:
        behind = [Sphere(place, 0.45, Highlight(color)) for place, color in zip(_BEHIND, (_RED, _GOLD, BLUE), strict=True)]
        bodies, camera = (Sphere((0.0, 0.0, 0.0), 1.0, surface), *behind), Orthographic()
        return canvas.mean(trace(bodies, lights, camera, size=canvas.size, depth=6, background=0.5, shadows=False))
    if isinstance(brdf, AbstractBSDF):
        lights.append(Distant(_FROM_BEHIND, np.pi))
    return canvas.sphere(surface, lights, background=_GREY)


def named(name: str) -> Preset:
    """The preset of that name. KeyError, naming the nearest ones, where there is none."""
    if name in PRESETS:
        return PRESETS[name]
    hint = did_you_mean(name, PRESETS, f"the presets are {', '.join(PRESETS)}")
    raise UnknownName(f"unknown preset {name!r}; {hint}")


def render_preset(
    name: str, size: int | None = None, quality: str = "normal", progress: Callable[[int], None] = lambda count: None
) -> Image:
    """The preset's picture, linear RGB as float32, `size` pixels the side of each square in it (None: its own).

    `progress` is called with the number of pictures that are done, after each.
    KeyError for an unknown name, ValueError for a size that is none or a quality that is not one of `QUALITIES`.
    """
    preset = named(name)
    return _rendered(preset.make, preset.side if size is None else size, quality, progress)


def render_brdf(
    kind: str,
    brdf: AbstractBRDF | AbstractBSDF,
    label: str,
    size: int = 256,
    quality: str = "normal",
    progress: Callable[[int], None] = lambda count: None,
) -> Image:
    """One BRDF as one of `OF_ONE`: linear RGB as float32. `label`: what the picture calls it; else as `render_preset`."""
    if kind not in OF_ONE:
        raise UnknownName(f"{kind!r} is no picture of one BRDF; these are {', '.join(OF_ONE)}")
    return _rendered(lambda canvas: OF_ONE[kind](canvas, brdf, label), size, quality, progress)


def _rendered(make: Callable[[Canvas], Any], side: int, quality: str, progress: Callable[[int], None]) -> Image:
    one_of(quality, QUALITIES, "quality")
    checked_size((side, side))
    count = itertools.count(1)
    return np.asarray(make(Canvas(side, QUALITIES[quality], lambda: progress(next(count)))), np.float32)


BLUE, _RED, _GOLD = (0.1, 0.3, 0.8), (0.8, 0.12, 0.1), (1.0, 0.72, 0.25)
_GREY = 0.1
_FROM_BEHIND = (-1.0, 0.4, -0.8)
_BEHIND = ((-0.5, 0.35, -2.0), (0.55, 0.3, -2.5), (0.0, -0.5, -3.0))


def row_of(values: Sequence[float], name: str, material: Callable[[float], Any]) -> Callable[[Canvas], Image]:
    """One sphere for each value of a parameter."""

    def make(canvas: Canvas) -> Image:
        light = [Distant(UPPER_RIGHT)]
        row = [canvas.sphere(material(value), light, background=_GREY) for value in values]
        return contact_sheet([row], columns=[f"{name} = {value:g}" for value in values])

    return make


def translucent_sheet(
    rows: Sequence[float], columns: Sequence[float], build: Callable[..., Any], names: tuple[str, str]
) -> Any:
    """Translucent spheres before a chequered ground: two parameters, down and across."""

    def make(canvas: Canvas) -> Image:
        behind, light = canvas.checks(), [Distant(UPPER_RIGHT)]
        sheet = [[canvas.sphere(build(r, c, behind), light, background=behind) for c in columns] for r in rows]
        return contact_sheet(
            sheet,
            columns=[f"{names[1]} = {c:g}" for c in columns],
            labels=[f"{names[0]} = {r:g}" for r in rows],
        )

    return make


def figure_9_spheres() -> tuple[Sphere, ...]:
    """The opaque and translucent spheres of the seed's figure 9: w = 1, n = 10, t_h = .8, t_p = 1."""
    look = {"w": 1.0, "n": 10.0}
    return (
        Sphere((-0.35, 0.3, -1.0), 0.6, Highlight(_RED, **look)),
        Sphere((0.6, 0.68, 0.2), 0.35, Highlight(_GOLD, **look)),
        Sphere((0.1, -0.2, 0.6), 0.6, Translucent((0.3, 0.6, 0.9), t_h=0.8, t_p=1.0, **look)),
        Sphere((-0.5, -0.5, 1.6), 0.35, Translucent((0.4, 0.9, 0.5), t_h=0.8, t_p=1.0, **look)),
    )


def figure_9(canvas: Canvas) -> Image:
    """The same spheres by equation (8), by rays, and by rays with shadows."""
    spheres, lights, camera = figure_9_spheres(), [Distant(UPPER_RIGHT)], Orthographic()
    scene = {"size": canvas.size, "background": 0.5}
    painted = composed(spheres, lights, camera, **scene)
    traced = trace(spheres, lights, camera, shadows=False, **scene)
    shadowed = trace(spheres, lights, camera, shadows=True, **scene)
    apart = float(np.abs(np.asarray(painted) - np.asarray(traced)).max())
    columns = ("equation (8)", f"rays: differ by {apart:.0e}", "rays with shadows")
    return contact_sheet([[canvas.mean(image) for image in (painted, traced, shadowed)]], columns=columns)


_EXPOSURE = 0.75  # of the metals: their highlights reach 1.3
_METALS: dict[str, tuple[Any, str, Sequence[tuple[Any, float]]]] = {
    "10": ([(0.013, 0.2), (0.1, 0.4)], "facets", [(UPPER_RIGHT, 1), (LEFT, 1)]),
    "11": (
        [[(0.013, 0.2), (0.1, 0.4)], [(0.1, 0.4)], [(0.1, 0.4)]],
        "facets",
        [(UPPER_RIGHT, 1), (LEFT, 0.7), (BELOW, 0.7)],
    ),
    "12": ([[(1, 13)], [(1, 8)], [(1, 8)]], "half", [(UPPER_RIGHT, 1), (LEFT, 0.4), (BELOW, 0.4)]),
    "13": ([[(0.2, 20), (0.8, 3)], [(1, 2)], [(1, 2)]], "mirror", [(UPPER_RIGHT, 1), (LEFT, 0.4), (BELOW, 0.4)]),
}


def metal(figure: str) -> Callable[[Canvas], Image]:
    """A metal sphere of one of the figures 10 to 13, under its lights."""

    def make(canvas: Canvas) -> Image:
        lobes, form, lights = _METALS[figure]
        metal = Metal(_GOLD, lobes, d=0.05, form=form)  # pyright: ignore[reportArgumentType]
        image = canvas.sphere(metal, [Distant(direction, a) for direction, a in lights], background=_GREY / _EXPOSURE)
        return np.float32(_EXPOSURE) * image

    return make


# --- lobes, lights, rays ---

_LOBES = ("phong", "schlick-mirror", "kuijk-blake-mirror", "blinn-phong", "lyon-2-half", "binomial-power-half")


def lobes(canvas: Canvas) -> Image:
    """Six lobes at three exponents in false colour, each light scaled by 2 pi/(n+2): of tails nothing is seen in grey."""
    rows, exponents = [], (10.0, 100.0, 1000.0)
    covered = canvas.sphere(Surface(Term("lambert", 1.0)), [Ambient(1.0)])[0]
    for n in exponents:
        light = [Distant(UPPER_RIGHT, 2 * np.pi / (n + 2))]
        spheres = [canvas.sphere(Surface(Term(name, n=n)), light) for name in _LOBES]
        rows.append([colored(sphere[0], covered, 1e-3, 1.0) for sphere in spheres])
    sheet = contact_sheet(rows, columns=_LOBES, labels=[f"n = {n:g}" for n in exponents])
    return stacked(sheet, color_scale(sheet.shape[2], "what is reflected; white: less than 0.001", 1e-3, 1.0))


_SQUARE = ((1.4, -1.0, -1.0), (1.4, 1.0, -1.0), (1.4, 1.0, 1.0), (1.4, -1.0, 1.0))


def lights(canvas: Canvas) -> Image:
    """One surface under each kind of light, and under three together."""
    surface, matt = matt_and_glossy(), Surface(Term("lambert", (0.55, 0.2, 0.1)))
    ambient = Ambient(0.3)
    distant = Distant(UPPER_RIGHT, 0.8 * np.pi)
    point = Point((0.9, 0.9, 1.2), 1.5, constant_attenuation=0, quadratic_attenuation=1)
    spot = Spot((1.0, 1.0, 2.0), (-1.0, -1.0, -1.6), 0.9 * np.pi, spot_cutoff=14.0, spot_exponent=20.0)
    scenes = {
        "ambient": (surface, [ambient]),
        "distant": (surface, [distant]),
        "point": (surface, [point]),
        "spot": (surface, [spot]),
        "polygon: matt part": (matt, [Polygon(_SQUARE, 1.5)]),
        "environment": (surface, [Environment(0.8)]),
        "ambient + spot + left": (surface, [ambient, spot, Distant(LEFT, (0.2, 0.4, 0.9))]),
    }
    row = [canvas.sphere(*scene, background=0.02) for scene in scenes.values()]
    return contact_sheet([row], columns=tuple(scenes))


def polygon_light(canvas: Canvas) -> Image:
    """A square light that sinks below the horizon of a sphere: clipped, not clipped, the difference."""
    matt, camera = Surface(Term("lambert", 0.9)), Perspective((0.6, 0.5, 5.0), field_of_view=25.0)
    images = [
        canvas.sphere(matt, [Polygon(_SQUARE, 1.2, horizon_clipping=clipped)], camera, background=0.02)
        for clipped in (True, False)
    ]
    covered = canvas.sphere(Surface(Term("lambert", 1.0)), [Ambient(1.0)], camera)[0]
    difference = colored(np.abs(images[1] - images[0]).max(axis=0), covered, 1e-3, 1.0)
    sheet = contact_sheet([[*images, difference]], columns=("clipped", "not clipped", "difference"))
    return stacked(sheet, color_scale(sheet.shape[2], "difference of the radiance; white: less than 0.001", 1e-3, 1.0))


def glass(canvas: Canvas) -> Image:
    """Mirror, glass and matt spheres on a plane, by rays."""
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), Surface(Term("lambert", 0.6)))
    bodies = (
        floor,
        Sphere((-0.8, -0.3, -0.6), 0.7, mirror=0.85),
        Sphere((0.5, -0.45, 0.6), 0.55, transparency=1.0, index=1.5),
        Sphere((1.0, -0.5, -1.2), 0.5, matt_and_glossy()),
        Sphere((-0.35, -0.8, 1.3), 0.2, matt_and_glossy((0.1, 0.3, 0.6))),
    )
    camera = Perspective((0.0, 0.6, 5.5), (0.0, -0.4, 0.0), field_of_view=30.0)
    lights = [Ambient(0.15), Distant((1.0, 2.0, 1.0), 0.9 * np.pi)]
    return canvas.mean(trace(bodies, lights, camera, size=canvas.size, depth=6, background=(0.35, 0.5, 0.7)))


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
    "lobes": Preset("lobes at equal n under one light, in false colour; light scaled by 2 pi/(n+2)", 144, lobes),
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
