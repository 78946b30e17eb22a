"""Scenes in TOML: one object with its material, under lights, before a camera. `brdfcheck render --help` shows one.

The keys are the parameters of the classes in `brdfcheck.scene`. A colour may be a spectrum: { wavelengths = [400, 700],
reflectance = [0.2, 0.8] } in nm. Of a saturated one, what RGB lights and screens cannot show is cut off: components below 0
or above the largest reflectance. `brdfcheck.scene.colour.rgb_of_spectrum` gives the numbers as they are. What is wrong is a
`UsageError` in one line that names the key and what is allowed.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from brdfcheck.documents import read_document
from brdfcheck.messages import UsageError, one_line
from brdfcheck.scene import lights, materials, meshes
from brdfcheck.scene.cameras import AbstractCamera, Orthographic, Perspective, Size, checked_size
from brdfcheck.scene.colour import rgb_of_spectrum
from brdfcheck.scene.interpolation import INTERPOLATIONS
from brdfcheck.scene.smooth import SHADINGS, render_mesh
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.vectors import color_of, scalar, shown, vector_of

_KEYS = ("size", "background", "allow_unvalidated", "geometry", "camera", "material", "lights")
_LIGHTS: dict[str, Callable[..., Any]] = {
    "ambient": lights.Ambient,
    "environment": lights.Environment,
    "distant": lights.Distant,
    "point": lights.Point,
    "spot": lights.Spot,
    "polygon": lights.Polygon,
}
_CAMERAS: dict[str, Callable[..., Any]] = {"orthographic": Orthographic, "perspective": Perspective}
_MATERIALS: dict[str, Callable[..., Any]] = {
    "surface": materials.Surface,
    "highlight": materials.Highlight,
    "translucent": materials.Translucent,
    "metal": materials.Metal,
}
_MESHES: dict[str, Callable[..., meshes.Mesh]] = {
    "icosphere": meshes.icosphere,
    "latitude-longitude": meshes.latitude_longitude_sphere,
    "zigzag": meshes.zigzag,
    "corrugated": meshes.corrugated,
}
_MESH_OPTIONS: dict[str, Sequence[str]] = {
    "shading": tuple(SHADINGS),
    "weighting": ("unit", "area"),
    "interpolation": tuple(INTERPOLATIONS),
}


@dataclass(frozen=True)
class Scene:
    """One object before a camera. `mesh` None: the exact sphere; `options`: for `render_mesh` or `sphere_image`."""

    material: Any
    lights: tuple[lights.AbstractLight, ...]
    camera: AbstractCamera
    size: Size = (512, 512)
    background: Any = 0.0
    mesh: meshes.Mesh | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def render(self, size: Size | None = None) -> Float[np.ndarray, "3 height width"]:
        """The linear image in float32, at `size` or the scene's own.

        ValueError for lights or places that do not fit, and for numbers that make it leave the range of single precision.
        """
        size = self.size if size is None else checked_size(size)
        if self.mesh is None:
            image = sphere_image(self.material, self.lights, self.camera, size=size, background=self.background, **self.options)
        else:
            image = render_mesh(
                self.mesh, self.camera, self.material, self.lights, size=size, background=self.background, **self.options
            )
        image = np.asarray(image)
        lost = np.count_nonzero(~np.all(np.isfinite(image), axis=0))
        if lost:
            raise ValueError(
                f"{lost} of {size[0] * size[1]} pixels are not finite in single precision: numbers of the scene are too large,"
                " or too small, taken together"
            )
        return image


def read_scene(path: str | Path) -> Scene:
    """The scene in a TOML file. UsageError where there is none, or where something in it is wrong."""
    return parse_scene(*read_document(path))


def parse_scene(
    document: Mapping[str, Any], label: str = "scene", *, validated: bool = False, others: Sequence[str] = ()
) -> Scene:
    """The scene in a document with the keys of the TOML file. UsageError where something in it is wrong.

    `validated`: for users of scenes who take no BRDF that does not conserve; the messages then name no way around it.
    `others`: keys that the document may have besides, which are not read here.
    """
    if validated and document.get("allow_unvalidated", False) is not False:
        raise UsageError(f"{label}: allow_unvalidated has no place here: what does not conserve energy is never chosen")
    _refuse_unknown(document, [key for key in (*_KEYS, *others) if not (validated and key == "allow_unvalidated")], label)
    for key in ("material", "lights"):
        if key not in document:
            raise UsageError(f"{label}: {key} is missing; a scene needs a [material] and [[lights]]")
    listed = document["lights"]
    if not isinstance(listed, list):
        raise UsageError(f"{label}: lights must be a list of tables, each below [[lights]]; got {shown(listed)}")
    allow = document.get("allow_unvalidated", False)
    if not isinstance(allow, bool):
        raise UsageError(f"{label}: allow_unvalidated must be true or false; got {shown(allow)}")
    size = document.get("size", 512)
    size = (size, size) if isinstance(size, int) and not isinstance(size, bool) else size
    if not isinstance(size, list | tuple):
        raise UsageError(f"{label}: size must be a number of pixels or [height, width]; got {shown(size)}")
    geometry = _table(document, "geometry", label, {"kind": "sphere"})
    mesh, options = _geometry(geometry, f"{label}: geometry")
    return Scene(
        material=_material(_table(document, "material", label), allow, validated, f"{label}: material"),
        lights=tuple(_made(one, _LIGHTS, f"{label}: lights[{i}]") for i, one in enumerate(listed)),
        camera=_made(_table(document, "camera", label, {"kind": "orthographic"}), _CAMERAS, f"{label}: camera"),
        size=_try(f"{label}: size", checked_size, tuple(size)),
        background=_try(label, lambda: np.asarray(color_of(_color(document.get("background", 0.0)), "background"))),
        mesh=mesh,
        options=options,
    )


def _geometry(table: Mapping[str, Any], place: str) -> tuple[meshes.Mesh | None, dict[str, Any]]:
    kind = _kind(table, ("sphere", *_MESHES), place)
    given = {key: value for key, value in table.items() if key != "kind"}
    if kind == "sphere":
        _refuse_unknown(given, ("center", "radius"), f"{place} (sphere)")
        _try(place, vector_of, given.get("center", (0, 0, 0)), "center", zero=True)
        _try(place, scalar, given.get("radius", 1), "radius", above=True)
        return None, given
    options = {key: given.pop(key) for key in _MESH_OPTIONS if key in given}
    for key, value in options.items():
        if value not in _MESH_OPTIONS[key]:
            raise UsageError(f"{place}.{key} must be one of {', '.join(_MESH_OPTIONS[key])}; got {shown(value)}")
    parameters = {name: part for name, part in inspect.signature(_MESHES[kind]).parameters.items() if name != "dtype"}
    _refuse_unfit(given, parameters, f"{place} ({kind})", tuple(_MESH_OPTIONS))
    # Sheets have two sides.
    options |= {"cull": False} if kind in ("zigzag", "corrugated") else {}
    return _try(place, lambda: _MESHES[kind](**given, dtype=jnp.float32)), options


def _material(table: Mapping[str, Any], allow_unvalidated: bool, validated: bool, place: str) -> Any:
    if _kind(table, tuple(_MATERIALS), place) != "surface":
        return _made(table, _MATERIALS, place)
    _refuse_unknown(table, ("kind", "terms"), f"{place} (surface)")
    listed = table.get("terms")
    if not isinstance(listed, list) or not listed or not all(isinstance(term, dict) for term in listed):
        raise UsageError(
            f'{place}.terms must be a list of tables, as in [{{ brdf = "phong", tint = 0.5, n = 50 }}]; got {shown(listed)}'
        )
    terms = []
    for number, one in enumerate(listed):
        where = f"{place}.terms[{number}]"
        if not isinstance(one.get("brdf"), str):
            raise UsageError(f"{where}.brdf must be a catalogue name (brdfcheck list); got {shown(one.get('brdf'))}")
        terms.append(_try(where, lambda one=one: materials.Term(**_colors(one))))

    def surface() -> materials.Surface:
        try:
            return materials.Surface(*terms, allow_unvalidated=allow_unvalidated)
        except materials.NotConserving as error:
            if validated:
                raise ValueError(error.advice()) from None
            # What the Python argument is called is a key here.
            raise ValueError(str(error).replace("allow_unvalidated=True", "allow_unvalidated = true")) from None

    return _try(place, surface)


def _made(table: Any, kinds: Mapping[str, Callable[..., Any]], place: str) -> Any:
    """What a table's kind makes of its other keys."""
    kind = _kind(table, tuple(kinds), place)
    parameters = inspect.signature(kinds[kind]).parameters
    given = {key: value for key, value in table.items() if key != "kind"}
    _refuse_unfit(given, parameters, f"{place} ({kind})")
    for name, parameter in parameters.items():
        if isinstance(parameter.default, bool) and not isinstance(given.get(name, False), bool):
            raise UsageError(f"{place}.{name} must be true or false; got {shown(given[name])}")
    if kind == "metal" and not (isinstance(given["lobes"], list) and all(isinstance(lobe, list) for lobe in given["lobes"])):
        raise UsageError(f"{place}.lobes must be pairs, as in [[0.013, 0.2], [0.1, 0.4]]; got {shown(given['lobes'])}")
    return _try(place, lambda: kinds[kind](**_colors(given)))


def _colors(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _color(value) for key, value in table.items()}


def _color(value: Any) -> Any:
    """A colour's numbers from its spectrum; anything else as it is."""
    if isinstance(value, Mapping) and "wavelengths" in value:
        _refuse_unknown(value, ("wavelengths", "reflectance", "illuminant", "observer"), "spectrum")
        rgb = rgb_of_spectrum(**{"reflectance": (), **value})
        # A perfect white is 1 in all components: outside of what lies between is what RGB cannot show.
        return np.clip(rgb, 0, np.max(value["reflectance"]))
    return value


def _try(place: str, make: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
    """``make(*arguments, **options)``; what it refuses names the place."""
    try:
        return make(*arguments, **options)
    except (UsageError, KeyError, ValueError, TypeError, ImportError, OverflowError) as error:
        raise UsageError(f"{place}: {one_line(error.args[0])}") from None


def _table(document: Mapping[str, Any], key: str, label: str, default: Mapping[str, Any] | None = None) -> Mapping[str, Any]:
    table = document.get(key, default)
    if not isinstance(table, Mapping):
        raise UsageError(f"{label}: {key} must be a table, below [{key}]; got {shown(table)}")
    return table


def _kind(table: Any, kinds: Sequence[str], place: str) -> str:
    if not isinstance(table, Mapping):
        raise UsageError(f"{place} must be a table with a kind; got {shown(table)}")
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise UsageError(f"{place}.kind must be one of {', '.join(kinds)}; got {shown(kind)}")
    return kind


def _refuse_unfit(table: Mapping[str, Any], parameters: Mapping[str, Any], place: str, others: Sequence[str] = ()) -> None:
    """UsageError for a key that is no parameter and not one of the others, and where one is missing that has no default."""
    _refuse_unknown(table, (*parameters, *others), place)
    for name, parameter in parameters.items():
        if parameter.default is parameter.empty and name not in table:
            raise UsageError(f"{place}: {name} is missing; its keys: {', '.join((*parameters, *others))}")


def _refuse_unknown(table: Mapping[str, Any], allowed: Sequence[str], place: str) -> None:
    for key in table:
        if key not in allowed:
            near = difflib.get_close_matches(key, allowed, n=1, cutoff=0.6)
            hint = f"did you mean {near[0]}? allowed:" if near else "allowed:"
            raise UsageError(f"{place}: unknown key {shown(key)}; {hint} {', '.join(allowed)}")
