"""Lobes side by side, one surface under every kind of light, and a room of mirror, glass and matt spheres."""

from __future__ import annotations

import numpy as np

from brdfcheck.scene.cameras import Perspective
from brdfcheck.scene.canvas import LEFT, UPPER_RIGHT, Canvas, Image, matt_and_glossy
from brdfcheck.scene.drawing import color_scale, colored, stacked
from brdfcheck.scene.images import contact_sheet
from brdfcheck.scene.lights import Ambient, Distant, Environment, Point, Polygon, Spot
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.tracing import Plane, Sphere, trace

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
