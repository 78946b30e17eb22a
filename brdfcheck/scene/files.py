"""Scenes in TOML: one object with its material, under lights, before a camera. `brdfcheck render --help` shows one.

The keys are the parameters of the classes in `brdfcheck.scene`; what numbers may be, these say. A colour may be a spectrum:
{ wavelengths = [400, 700], reflectance = [0.2, 0.8] } in nm. Of a saturated one, what RGB lights and screens cannot show is
cut off: components below 0 or above the largest reflectance. `brdfcheck.scene.images.rgb_of_spectrum` gives the numbers as
they are. A mesh of a file, ``file = "bunny.ply"``, and a BRDF of one's own, ``brdf = "mine.py:glossy"``, are looked for in the
scene's folder. What is wrong is a `UsageError` in one line that names the key and what is allowed.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Union

import jax.numpy as jnp
import numpy as np
import pydantic
from jaxtyping import Float

from brdfcheck.brdf.readers.specs import is_file_spec
from brdfcheck.brdf.readers.table import ReadingTable, beside
from brdfcheck.documents import Model, validated
from brdfcheck.messages import UsageError, one_line
from brdfcheck.scene import artistic, lights, materials, meshes
from brdfcheck.scene.cameras import AbstractCamera, Orthographic, Perspective, Size, checked_size
from brdfcheck.scene.images import rgb_of_spectrum
from brdfcheck.scene.raster import INTERPOLATIONS
from brdfcheck.scene.smooth import SHADINGS, render_mesh
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.tracing import Sphere, trace
from brdfcheck.scene.vectors import color_of, scalar, vector_of

_BOUNCES = 6  # of light in a clear sphere


@dataclass(frozen=True)
class Scene:
    """One object before a camera: a mesh, with `options` for `render_mesh`, or the exact sphere of this center and radius.

    `named_files`: it was made of other files than its own, which may change while it stays what it is.
    """

    material: Any
    lights: tuple[lights.AbstractLight, ...]
    camera: AbstractCamera
    size: Size = (512, 512)
    background: Any = 0.0
    center: Any = (0.0, 0.0, 0.0)
    radius: Any = 1.0
    mesh: meshes.Mesh | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    named_files: bool = False

    def render(self, size: Size | None = None) -> Float[np.ndarray, "3 height width"]:
        """The linear image in float32, at `size` or the scene's own.

        ValueError for lights or places that do not fit, and for numbers that make it leave the range of single precision.
        """
        size = self.size if size is None else checked_size(size)
        options = {"size": size, "background": self.background}
        if self.mesh is not None:
            image = render_mesh(self.mesh, self.camera, self.material, self.lights, **options, **self.options)
        elif self.material.glass is not None:
            ball = Sphere(self.center, self.radius, self.material)
            image = trace((ball,), self.lights, self.camera, depth=_BOUNCES, **options)
        else:
            options |= {"center": self.center, "radius": self.radius}
            image = sphere_image(self.material, self.lights, self.camera, **options)
        image = np.asarray(image)
        lost = np.count_nonzero(~np.all(np.isfinite(image), axis=0))
        if lost:
            raise ValueError(
                f"{lost} of {size[0] * size[1]} pixels are not finite in single precision: numbers of the scene are too large,"
                " or too small, taken together"
            )
        return image


def _sphere(center: Any = (0.0, 0.0, 0.0), radius: Any = 1.0) -> dict[str, Any]:
    """Where the exact sphere is, as fields of a `Scene`."""
    return {"center": vector_of(center, "center", zero=True), "radius": scalar(radius, "radius", above=True)}


# --- what a document may say ---

_MAKERS: dict[Any, Callable[..., Any]] = {}


def _table(kind: str, make: Callable[..., Any], **more: Any) -> Any:
    """The model of a table of this kind: the parameters of `make`, which checks numbers itself, and `more` fields."""
    fields: dict[str, Any] = {"kind": (Literal[kind], ...)}  # pyright: ignore[reportInvalidTypeForm]
    for name, parameter in inspect.signature(make).parameters.items():
        default = ... if parameter.default is parameter.empty else parameter.default
        if name != "dtype":
            fields[name] = (bool if isinstance(default, bool) else Any, default)
    model = pydantic.create_model(kind, __base__=Model, **(fields | more))
    _MAKERS[model] = make
    return model


def _one_of(*models: Any) -> Any:
    return Annotated[Union[models], pydantic.Field(discriminator="kind")]  # noqa: UP007


class _Term(Model):
    model_config = pydantic.ConfigDict(extra="allow")  # the parameters of its BRDF

    brdf: str
    tint: Any = 1.0
    fresnel: Any = "none"
    reading: ReadingTable | None = None  # of the file that its BRDF is in


class _Surface(Model):
    kind: Literal["surface"]
    terms: list[_Term] = pydantic.Field(min_length=1)


class _Spectrum(Model):
    wavelengths: list[float]
    reflectance: list[float]
    illuminant: str = "D65"
    observer: str = "CIE XYZ"


_OPTIONS: dict[str, Any] = {
    "shading": (Literal[tuple(SHADINGS)], "phong"),
    "weighting": (Literal["unit", "area"], "unit"),
    "interpolation": (Literal[tuple(INTERPOLATIONS)], "area"),
}
_GEOMETRY = _one_of(
    _table("sphere", _sphere),
    _table("icosphere", meshes.icosphere, **_OPTIONS),
    _table("latitude-longitude", meshes.latitude_longitude_sphere, **_OPTIONS),
    _table("zigzag", meshes.zigzag, **_OPTIONS),
    _table("corrugated", meshes.corrugated, **_OPTIONS),
    _table("mesh", meshes.read_mesh, file=(str, ...), **_OPTIONS),
)
_CAMERA = _one_of(_table("orthographic", Orthographic), _table("perspective", Perspective))
_ARTISTIC = (artistic.Highlight, artistic.Translucent, artistic.Metal)
_MATERIAL = _one_of(_Surface, *(_table(kind.__name__.lower(), kind) for kind in _ARTISTIC))
_LIGHTS = (lights.Ambient, lights.Environment, lights.Distant, lights.Point, lights.Spot, lights.Polygon)
_LIGHT = _one_of(*(_table(kind.__name__.lower(), kind) for kind in _LIGHTS))


def _size(value: Any) -> Size:
    try:
        return checked_size((value, value) if isinstance(value, int) else tuple(value))
    except (TypeError, ValueError):
        raise ValueError("must be a number of pixels or [height, width], each from 1 to 16384") from None


SceneTable: Any = pydantic.create_model(
    "SceneTable",
    __base__=Model,
    size=(Annotated[Any, pydantic.AfterValidator(_size)], (512, 512)),
    background=(Any, 0.0),
    geometry=(_GEOMETRY, None),
    camera=(_CAMERA, None),
    material=(_MATERIAL, ...),
    lights=(list[_LIGHT], ...),  # pyright: ignore[reportInvalidTypeForm]
)
"""What a document says of a scene: the keys of the TOML file but `allow_unvalidated`. `scene_of` makes a scene of it."""


def parse_scene(
    document: Mapping[str, Any], label: str = "scene", *, others: Sequence[str] = (), folder: Path | None = None
) -> Scene:
    """The scene in a document with the keys of the TOML file.

    `label`: the document's name in messages, for a file its path. `others`: keys that the document may have besides, which are
    not read here. `folder`: where files that the scene names are looked for, by default that of `label`.

    Raises UsageError where something in the document is wrong.
    """
    more = {"allow_unvalidated": (bool, False), **{name: (Any, None) for name in others}}
    model: Any = pydantic.create_model("Scene", __base__=SceneTable, **more)
    table: Any = validated(model, document, label)
    return scene_of(table, label, folder, allow_unvalidated=table.allow_unvalidated)


def scene_of(
    table: Any, label: str, folder: Path | None = None, *, allow_unvalidated: bool = False, way_out: bool = True
) -> Scene:
    """The scene that a `SceneTable` describes; `label` and `folder` as for `parse_scene`.

    `allow_unvalidated`: also of BRDFs that do not conserve. `way_out`: whether messages say how to allow them.

    Raises UsageError where a number of the table is wrong.
    """
    folder = Path(label).parent if folder is None else folder
    shape = _made(table.geometry, f"{label}: geometry", folder) if table.geometry else {}
    if isinstance(shape, meshes.Mesh):
        options = table.geometry.model_dump(include=set(_OPTIONS), exclude_unset=True)
        options |= {"cull": False} if meshes.border(shape).size else {}  # sheets have two sides
        shape = {"mesh": shape, "options": options}
    named_files = getattr(table.geometry, "kind", "") == "mesh"
    if isinstance(table.material, _Surface):
        named_files |= any(is_file_spec(term.brdf) for term in table.material.terms)
        material = _surface(table.material, f"{label}: material", folder, allow_unvalidated, way_out)
    else:
        material = _made(table.material, f"{label}: material")
    background = _color(table.background, f"{label}: background")
    return Scene(
        material=material,
        lights=tuple(_made(light, f"{label}: lights[{i}]") for i, light in enumerate(table.lights)),
        camera=Orthographic() if table.camera is None else _made(table.camera, f"{label}: camera"),
        size=table.size,
        background=_try(label, lambda: np.asarray(color_of(background, "background"))),
        named_files=named_files,
        **shape,
    )


# --- what is made of it ---


def _made(table: Model, place: str, folder: Path | None = None) -> Any:
    """What a table's kind makes of its other keys."""
    given = {name: _color(getattr(table, name), f"{place}.{name}") for name in table.model_fields_set - {"kind", *_OPTIONS}}
    make = _MAKERS[type(table)]
    if folder is not None and "file" in given:
        given["file"] = folder / given["file"]
    if "dtype" in inspect.signature(make).parameters:
        given["dtype"] = jnp.float32
    return _try(place, lambda: make(**given))


def _surface(table: _Surface, place: str, folder: Path, allow_unvalidated: bool, way_out: bool) -> materials.Surface:
    terms = []
    for number, one in enumerate(table.terms):
        where = f"{place}.terms[{number}]"
        given = {name: _color(getattr(one, name), f"{where}.{name}") for name in one.model_fields_set - {"reading"}}
        if is_file_spec(one.brdf):
            given["brdf"] = str(folder / one.brdf)
        if one.reading is not None:
            given["reading"] = beside(one.reading.reading(where), folder)
        terms.append(_try(where, lambda given=given: materials.Term(**given)))

    def surface() -> materials.Surface:
        try:
            return materials.Surface(*terms, allow_unvalidated=allow_unvalidated)
        except materials.NotConserving as error:
            # What the Python argument is called is a key here.
            words = str(error).replace("allow_unvalidated=True", "allow_unvalidated = true") if way_out else error.advice()
            raise ValueError(words) from None

    return _try(place, surface)


def _color(value: Any, place: str) -> Any:
    """A colour's numbers from its spectrum; anything else as it is."""
    if not isinstance(value, Mapping):
        return value
    spectrum = validated(_Spectrum, value, place)
    rgb = _try(place, lambda: rgb_of_spectrum(**spectrum.model_dump()))
    # A perfect white is 1 in all components: outside of what lies between is what RGB cannot show.
    return np.clip(rgb, 0, max(spectrum.reflectance))


def _try(place: str, make: Callable[[], Any]) -> Any:
    """What is made; what is refused names the place."""
    try:
        return make()
    except (KeyError, ValueError, TypeError, ImportError, OverflowError) as error:
        raise UsageError(f"{place}: {one_line(error.args[0])}") from error
