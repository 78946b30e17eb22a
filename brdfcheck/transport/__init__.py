"""What an albedo above 1 does to a scene: four solvers of L = Le + K L on the same closed enclosures.

    room = transport.box((1.0, 1.0, 0.5), (16, 16, 8))              # 1,024 patches, closed forms
    light = room.on_wall(4, 1.0)                                    # radiosity emitted by the floor
    transport.direct(room, light, reflectance=0.7)                  # value, error, residual, cost, message
    transport.krylov(room, light, 0.7); transport.progressive(room, light, 0.7); transport.neumann_series(room, light, 0.7)
    transport.trace(room, light, 0.7, key=jax.random.key(0))        # Monte Carlo paths, any lobe of the catalogue

`angular_operator` is the transport of one BRDF inside a sphere, where it depends on the angle of incidence alone; its
spectral radius is the largest that any enclosure with otherwise loss-free walls can have. Names are imported when used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from brdfcheck.transport.angular import AngularOperator as AngularOperator
    from brdfcheck.transport.angular import angular_operator as angular_operator
    from brdfcheck.transport.completion import Completed as Completed
    from brdfcheck.transport.completion import completed as completed
    from brdfcheck.transport.enclosures import Balance as Balance
    from brdfcheck.transport.enclosures import Box as Box
    from brdfcheck.transport.enclosures import Enclosure as Enclosure
    from brdfcheck.transport.enclosures import Sphere as Sphere
    from brdfcheck.transport.enclosures import box as box
    from brdfcheck.transport.enclosures import cylinder as cylinder
    from brdfcheck.transport.enclosures import enclosure as enclosure
    from brdfcheck.transport.enclosures import polyhedron as polyhedron
    from brdfcheck.transport.enclosures import sphere as sphere
    from brdfcheck.transport.form_factors import FormFactor as FormFactor
    from brdfcheck.transport.form_factors import coaxial_disks as coaxial_disks
    from brdfcheck.transport.form_factors import inside_sphere as inside_sphere
    from brdfcheck.transport.form_factors import parallel_rectangles as parallel_rectangles
    from brdfcheck.transport.form_factors import perpendicular_rectangles as perpendicular_rectangles
    from brdfcheck.transport.neumann import neumann_series as neumann_series
    from brdfcheck.transport.neumann import truncation_bound as truncation_bound
    from brdfcheck.transport.paths import energy_after_bounces as energy_after_bounces
    from brdfcheck.transport.paths import trace as trace
    from brdfcheck.transport.polygon import patch_form_factor as patch_form_factor
    from brdfcheck.transport.polygon import point_to_polygon as point_to_polygon
    from brdfcheck.transport.radiosity import direct as direct
    from brdfcheck.transport.radiosity import krylov as krylov
    from brdfcheck.transport.radiosity import progressive as progressive
    from brdfcheck.transport.solution import Radius as Radius
    from brdfcheck.transport.solution import Solution as Solution
    from brdfcheck.transport.solution import Status as Status
    from brdfcheck.transport.solution import spectral_radius as spectral_radius

_HOME = {
    "AngularOperator": "angular",
    "Balance": "enclosures",
    "Box": "enclosures",
    "Completed": "completion",
    "Enclosure": "enclosures",
    "FormFactor": "form_factors",
    "Radius": "solution",
    "Solution": "solution",
    "Sphere": "enclosures",
    "Status": "solution",
    "angular_operator": "angular",
    "box": "enclosures",
    "coaxial_disks": "form_factors",
    "completed": "completion",
    "cylinder": "enclosures",
    "direct": "radiosity",
    "enclosure": "enclosures",
    "energy_after_bounces": "paths",
    "inside_sphere": "form_factors",
    "krylov": "radiosity",
    "neumann_series": "neumann",
    "parallel_rectangles": "form_factors",
    "patch_form_factor": "polygon",
    "perpendicular_rectangles": "form_factors",
    "point_to_polygon": "polygon",
    "polyhedron": "enclosures",
    "progressive": "radiosity",
    "spectral_radius": "solution",
    "sphere": "enclosures",
    "trace": "paths",
    "truncation_bound": "neumann",
}
__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"brdfcheck.transport.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
