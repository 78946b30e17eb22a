"""The figures 5 to 13 of Yokoi, Ito, Tsuruoka, Miyake: highlights, translucent bodies and metal on spheres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from brdfcheck.scene.cameras import Orthographic
from brdfcheck.scene.canvas import BELOW, LEFT, UPPER_RIGHT, Canvas, Image
from brdfcheck.scene.images import contact_sheet
from brdfcheck.scene.lights import Distant
from brdfcheck.scene.materials import Highlight, Metal, Translucent
from brdfcheck.scene.tracing import Sphere, composed, trace

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
