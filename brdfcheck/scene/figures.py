"""The figures 5 to 13 of Yokoi, Ito, Tsuruoka, Miyake; lobes and lights side by side; mirror, glass and matt spheres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from brdfcheck.scene.cameras import Orthographic, Perspective
from brdfcheck.scene.canvas import BELOW, LEFT, UPPER_RIGHT, Canvas, Image, color_scale, colored, matt_and_glossy, stacked
from brdfcheck.scene.images import contact_sheet
from brdfcheck.scene.lights import Ambient, Distant, Environment, Point, Polygon, Spot
from brdfcheck.scene.materials import Highlight, Metal, Surface, Term, Translucent
from brdfcheck.scene.tracing import Plane, Sphere, composed, trace

BLUE, _RED, _GOLD = (0.1, 0.3, 0.8), (0.8, 0.12, 0.1), (1.0, 0.72, 0.25)
_GREY = 0.1


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
    """Six lobes at three exponents, each light scaled by 2 pi/(n+2)."""
    rows, exponents = [], (10.0, 100.0, 1000.0)
    for n in exponents:
        light = [Distant(UPPER_RIGHT, 2 * np.pi / (n + 2))]
        rows.append([canvas.sphere(Surface(Term(name, n=n)), light, background=0.02) for name in _LOBES])
    return contact_sheet(rows, columns=_LOBES, labels=[f"n = {n:g}" for n in exponents])


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
