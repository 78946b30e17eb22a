"""What may be simplified in a scene: knobs, each a ladder of rungs from the cheapest to the dearest, and what they build.

A scene offers only the knobs that it has. The full model is the scene as it is written, in float64, all light bounces summed,
the albedo under a surrounding integrated in every pixel. A stand-in for the cosine power comes with a factor; whether the BRDF
that they make conserves energy is checked as always, by `brdfcheck.scene.materials.Surface`. `Highlight` and `Translucent` are
colours in [0, 1] and no BRDFs, for which the law says nothing: a stand-in there is judged by its error alone.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import AbstractZonalLobe
from brdfcheck.brdf.factors import Constant, Normalized, exact_factor
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lyon, Phong, Schlick
from brdfcheck.budgets.scenes import Scene
from brdfcheck.scene.artistic import Highlight, Metal, Translucent
from brdfcheck.scene.lights import AbstractLight, AbstractRayLight, Distant, Environment, Point, Polygon
from brdfcheck.scene.materials import NotConserving, Surface, Term
from brdfcheck.scene.shading import AbstractMaterial, Place
from brdfcheck.scene.vectors import Vector


@dataclass(frozen=True)
class Knob:
    """A ladder of rungs by name, from the cheapest to the dearest. `title`: what the knob is, for a person."""

    name: str
    title: str
    rungs: tuple[str, ...]


Choice = Mapping[str, str]
"""The chosen rung of each knob, by name."""

LOBES: Mapping[str, Callable[[Any, str], AbstractZonalLobe]] = MappingProxyType({
    "Schlick": Schlick,
    **{f"Lyon w={w}": lambda n, form, w=w: Lyon(n, w, form) for w in (1, 2, 3)},
    "Kuijk-Blake": KuijkBlake,
    **{f"binomial k={k}": lambda n, form, k=k: BinomialPower(n, k, form) for k in (4, 8, 16, 64)},
    "power": lambda n, form: (Phong if form == "mirror" else BlinnPhong)(n),
})  # fmt: skip
# Their factors: that of the power, the best two constants for n from 1 to 1000, the one that makes the albedo 1 at 0 degrees.
_FACTORS = ("factor of the power", "two constants", "exact factor")
_FITTED = MappingProxyType({
    "Schlick": "schlick", "Lyon w=1": "lyon-1", "Lyon w=2": "lyon-2", "Lyon w=3": "lyon-3", "Kuijk-Blake": "kuijk-blake",
    "binomial k=16": "binomial-power",
})  # fmt: skip
_BOUNCES = (0, 1, 2, 4, 8, 16, 32)
_CELLS = (2, 4, 8)
_QUADRATURE = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
_TABLES = (8, 32, 128)
_GRIDS = (24, 36, 72, 108)
# A grid of points is tried where it is less than this part of the pixels around the object.
_MOST_GRID = 1 / 4
# A box around the object is tried where it is less than this part of the picture.
_MOST_WINDOW = 0.9
_FEW = 8  # numbers of lights of which each is tried
_SHADINGS = ("flat", "Gouraud", "Phong")
_SPHERE = "the sphere itself"
PRECISIONS = ("float16", "float32", "float64")
_FRESNELS = ("none", "schlick", "exact")


def _power_terms(material: Any) -> list[Term]:
    terms = material.terms if isinstance(material, Surface) else ()
    return [term for term in terms if isinstance(term.brdf, Normalized) and isinstance(term.brdf.lobe, Phong | BlinnPhong)]


def _is_facets(term: Term) -> bool:
    return term.name == "cook-torrance"


def _surrounded(scene: Scene) -> list[Term]:
    """Glossy terms under a surrounding: what they reflect of it depends on the angle of view alone."""
    material = scene.picture.material
    surrounded = any(isinstance(light, Environment) for light in scene.picture.lights)
    return [term for term in material.terms if not term.matt] if surrounded and isinstance(material, Surface) else []


def knobs_of(scene: Scene) -> tuple[Knob, ...]:
    """The knobs that a scene has."""
    material, lights = scene.picture.material, scene.picture.lights
    found: list[Knob] = []
    if _power_terms(material):
        # The factor's error depends on the lobe, so the two are one knob; at a given n it is a number, which costs nothing.
        names = [
            f"{lobe}, {factor}" for lobe in LOBES if lobe != "power" for factor in _FACTORS
            if lobe in _FITTED or factor != _FACTORS[1]
        ]  # fmt: skip
        constants = [f"power, {_FACTORS[1]}"] * all(term.brdf.core.form == "half" for term in _power_terms(material))
        found.append(Knob("lobe", "lobe and factor", (*names, *constants, f"power, {_FACTORS[2]}")))
    elif isinstance(material, Highlight | Translucent):
        found.append(Knob("lobe", "lobe", tuple(LOBES)))
    fresnels = {term.fresnel for term in material.terms} - {"none"} if isinstance(material, Surface) else set()
    if fresnels:
        dearest = max(_FRESNELS.index(name) for name in fresnels)
        names = ("constant", "Schlick", "exact")
        found.append(Knob("fresnel", "Fresnel term", names[: dearest + 1]))
    if isinstance(material, Metal) and material.form == "facets":
        found.append(Knob("metal", "metal", ("power of R.V (16)", "power of N.H (15)", "microfacets (12)")))
    elif isinstance(material, Surface) and any(_is_facets(term) for term in material.terms):
        found.append(Knob("metal", "metal", ("power of N.H", "microfacets")))
    near = [light for light in lights if isinstance(light, Point | Polygon)]
    if near:
        polygons = [light for light in near if isinstance(light, Polygon)]
        rungs = ["distant"] + ["point"] * bool(polygons)
        rungs += ["polygon, unclipped"] * any(light.horizon_clipping for light in polygons)
        found.append(Knob("light", "light model", (*rungs, "polygon" if polygons else "point")))
    if (mesh := scene.picture.mesh) is not None:
        # Up to what the scene says itself.
        written = str(scene.picture.options.get("shading", "phong"))
        shadings = _SHADINGS[: [name.lower() for name in _SHADINGS].index(written) + 1]
        levels = range(_level(len(mesh.faces)) + 1) if scene.facets else ()
        if scene.facets:
            rungs = tuple(f"{20 * 4**level} faces, {shading}" for level in levels for shading in shadings)
            # What an icosphere stands for needs no search for the face that is seen.
            found.append(Knob("facets", "facets and interpolation", (_SPHERE, *rungs)))
        elif len(shadings) > 1:
            found.append(Knob("shading", "interpolation", shadings))
    top, bottom, left, right = _window(scene)
    inside = (bottom - top) * (right - left)
    if inside < _MOST_WINDOW * math.prod(scene.picture.size):
        around = f"box {top}:{bottom}, {left}:{right}"
        found.append(Knob("window", "pixels shaded", (around, "all")))
    grids = [count for count in _GRIDS if mesh is None and count**2 < _MOST_GRID * inside]
    if grids:
        found.append(Knob("grid", "points shaded", (*(f"{count} x {count}" for count in grids), "each pixel")))
    if scene.room is not None:
        found.append(Knob("bounces", "bounces of light", (*(str(count) for count in _BOUNCES), "all")))
        counts = (*(count for count in _CELLS if count < scene.room.cells), scene.room.cells)
        found.append(Knob("cells", "patches of a wall", tuple(f"{count} x {count}" for count in counts)))
    if glossy := _surrounded(scene):
        # Of lobes about an axis a rule in one dimension gives the albedo.
        simple = all(term.fresnel == "none" and isinstance(term.brdf.core, AbstractZonalLobe) for term in glossy)
        rungs = [f"{count} nodes" for count in _QUADRATURE if simple]
        rungs += [f"table of {count}" for count in _TABLES if count < math.prod(scene.picture.size)]
        found.append(Knob("surrounding", "albedo under the surrounding", (*rungs, "furnace")))
    if len(lights) > 1:
        # Of many lights not every number.
        counts = {len(lights), *(count for count in range(1, len(lights)) if count <= _FEW or count % (1 + count // _FEW) == 0)}
        found.append(Knob("lights", "lights", tuple(f"{count} of {len(lights)}" for count in sorted(counts))))
    return (*found, Knob("precision", "precision", PRECISIONS))


def _window(scene: Scene) -> tuple[int, int, int, int]:
    """Rows and columns (from, to) of a box of pixels around the object."""
    picture = scene.picture
    if picture.mesh is not None:
        points = np.asarray(picture.mesh.vertices, float).T
    else:
        # Corners of a polyhedron around the sphere.
        polar, azimuth = np.meshgrid(np.linspace(0, np.pi, 33), np.linspace(0, 2 * np.pi, 64))
        unit = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]).reshape(3, -1)
        points = _center(scene)[:, None] + 1.02 * float(picture.radius) * unit
    shown = jax.jit(lambda camera, points: camera.project(points, picture.size))(picture.camera, jnp.asarray(points))
    if not np.all(shown.in_front):
        return 0, picture.size[0], 0, picture.size[1]
    x, y = np.asarray(shown.screen, float)
    ends = [
        int(np.clip(end, 0, most))
        for axis, most in zip((y, x), picture.size, strict=True)
        for end in (np.floor(axis.min()) - 1, np.ceil(axis.max()) + 1)
    ]
    return ends[0], ends[1], ends[2], ends[3]


def _level(faces: int) -> int:
    return round(np.log(faces / 20) / np.log(4))


@dataclass(frozen=True)
class Plan:
    """What a choice makes of a scene, ready to be compiled.

    `facets`: (level of an icosphere or None for the scene's own mesh, shading), None for the exact sphere. `bounces`: None for
    all.
    `cells`: patches along an edge of the room, None for the scene's own.
    `window`: rows and columns of the picture that are shaded, None for all. `grid`: points along an edge of the grid of the
    sphere that is shaded instead, None for each pixel.
    `quadrature`: nodes of the albedo in a panel, None to integrate the BRDF itself. `table`: at how many cosines what is
    reflected of a surrounding is computed, to be looked up in each pixel; None to compute it there.
    """

    material: Any
    lights: tuple[Any, ...]
    dtype: str
    facets: tuple[int | None, str] | None = None
    bounces: int | None = None
    cells: int | None = None
    quadrature: int | None = None
    table: int | None = None
    window: tuple[int, int, int, int] | None = None
    grid: int | None = None


def plan_of(scene: Scene, choice: Choice) -> Plan:
    """The plan of a choice. ValueError, with the reason, where a BRDF of it does not conserve energy or has no such factor."""
    numbers: dict[str, Any] = {name: tuple(map(int, re.findall(r"\d+", rung))) for name, rung in choice.items()}

    def number(name: str, word: str = "") -> int | None:
        """The first one in the rung of a knob; None where it has none, or lacks the `word`."""
        return numbers[name][0] if numbers.get(name) and word in choice[name] else None

    facets = None
    if (faces := number("facets")) is not None:
        facets = (_level(faces), choice["facets"].rpartition(", ")[2].lower())
    elif scene.picture.mesh is not None and "facets" not in choice:
        facets = (None, choice.get("shading", str(scene.picture.options.get("shading", "phong"))).lower())
    lights = _lights(scene, choice.get("light", "polygon"))
    if (count := number("lights")) is not None:
        lights = tuple(lights[i] for i in sorted(_by_strength(scene)[:count]))
    return Plan(
        _material_of(scene, tuple(item for item in choice.items() if item[0] in ("lobe", "fresnel", "metal"))),
        lights,
        choice.get("precision", "float64"),
        facets,
        number("bounces"),
        number("cells"),
        number("surrounding", "nodes"),
        number("surrounding", "table"),
        numbers.get("window") or None,
        number("grid"),
    )


def plain(material: AbstractMaterial) -> AbstractMaterial:
    """The same surface with factors as numbers and without names, so that what shades alike is one compiled program."""

    def number(term: Term) -> Term:
        brdf = term.brdf
        if isinstance(brdf, Normalized):
            brdf = Normalized(brdf.lobe, Constant(brdf.scale()))
        return Term(brdf, term.tint, fresnel=term.fresnel)

    return Surface(*map(number, material.terms), allow_unvalidated=True) if isinstance(material, Surface) else material


def refusal_of(scene: Scene, choice: Choice) -> str:
    """Why the materials of a choice may not be used: the sum of their BRDFs does not conserve energy. Empty where it does."""
    material = plan_of(scene, choice).material
    if isinstance(material, Surface):
        try:
            Surface(*material.terms)
        except NotConserving as error:
            return error.reason
    return ""


# --- materials ---


@functools.lru_cache(256)
def _material_of(scene: Scene, choice: tuple[tuple[str, str], ...]) -> AbstractMaterial:
    return _material(scene.picture.material, dict(choice))


def _material(material: Any, choice: Choice) -> AbstractMaterial:
    if isinstance(material, Surface):
        terms = [_term(term, choice) for term in material.terms]
        for term, own in zip(terms, material.terms, strict=True):
            if term is not own:
                Surface(term)  # refuses, with the reason, a BRDF that does not conserve
        # The sum is checked when it is about to be chosen.
        return Surface(*terms, allow_unvalidated=True)
    if isinstance(material, Highlight | Translucent) and choice.get("lobe", "power") != "power":
        return Painted(material, LOBES[choice["lobe"]](material.n, "mirror"))
    if isinstance(material, Metal) and choice.get("metal", "microfacets (12)") != "microfacets (12)":
        return _power_metal(material, mirror="(16)" in choice["metal"])
    return material


def _term(term: Term, choice: Choice) -> Term:
    fresnel = {"constant": "none", "Schlick": "schlick", "exact": "exact"}[choice.get("fresnel", "exact")]
    # Never a dearer one than the scene's own.
    fresnel = min(term.fresnel, fresnel, key=_FRESNELS.index)
    lobe, _, factor = choice.get("lobe", f"power, {_FACTORS[2]}").partition(", ")
    core = term.brdf.core
    if _is_facets(term) and choice.get("metal") == "power of N.H":
        # The power with the curvature of Beckmann's distribution at its centre.
        exponent = jnp.maximum(2 / (core.m * core.m) - 2, 0.01)
        return Term("blinn-phong", term.tint, fresnel=fresnel, n=exponent)
    if not isinstance(core, Phong | BlinnPhong) or not isinstance(term.brdf, Normalized):
        return _again(term, fresnel)
    form, n = core.form, core.n
    if lobe == "power" and factor == _FACTORS[2]:
        return _again(term, fresnel)
    if factor == _FACTORS[1]:
        name = "blinn-phong-fitted" if lobe == "power" else f"{_FITTED[lobe]}-{form}"
        return Term(name, term.tint, fresnel=fresnel, n=n)
    model = LOBES[lobe](n, form)
    if factor == _FACTORS[0]:
        scale = term.brdf.factor
    else:
        scale = exact_factor(model)
        assert scale is not None, "every stand-in has a closed form"
    return Term(Normalized(model, scale), term.tint, fresnel=fresnel)


def _again(term: Term, fresnel: str) -> Term:
    """The term with this Fresnel factor; by name where it has one, so that its family's check counts."""
    if fresnel == term.fresnel:
        return term
    core = term.brdf.core
    names = catalog.entry(term.name).family.ranges if term.name else {}
    if term.name and all(hasattr(core, name) for name in names):
        return Term(term.name, term.tint, fresnel=fresnel, **{name: getattr(core, name) for name in names})
    return Term(term.brdf, term.tint, fresnel=fresnel)


def _power_metal(metal: Metal, *, mirror: bool) -> Metal:
    r"""(12) as (15) or (16), with the height and the curvature of each distribution at its centre.

    $e^{-\tan^2 a/m^2}/(m^2 \cos^4 a)$ has the height 1/m^2 and the curvature of $\cos^n a$ with n = 2/m^2 - 4. In the plane of
    incidence the half vector turns half as far as the mirror direction, so the mirror form takes a quarter of that.
    """
    parts = []
    for part in metal.lobes:
        weight, slope = part[:, 0], part[:, 1]
        exponent = jnp.maximum(2 / slope**2 - 4, 0) / (4 if mirror else 1)
        parts.append(jnp.stack([weight / slope**2, exponent], axis=1))
    return Metal(metal.base, parts, d=metal.d, form="mirror" if mirror else "half")


@final
class Painted(AbstractMaterial):
    """`Highlight` (4) or `Translucent` (8) with a stand-in for the cosine power, in the mirror form."""

    model: Highlight | Translucent
    lobe: AbstractZonalLobe

    def color(self, lights: Any, place: Place) -> Float[Array, "3 ..."]:
        """As the model's own, with the lobe's profile for the power. ValueError for lights without a direction."""

        def profile(cosine: Array) -> Array:
            return jnp.where(cosine > 0, self.lobe.profile(jnp.clip(1 - cosine, 0, 1)), 0)

        return self.model.painted(lights, place, profile)


# --- lights ---


def _center(scene: Scene) -> np.ndarray:
    return np.asarray(scene.picture.center, float)


@functools.lru_cache(16)
def _lights(scene: Scene, model: str) -> tuple[AbstractLight, ...]:
    return tuple(_light(light, model, _center(scene)) for light in scene.picture.lights)


@functools.lru_cache(16)
def _by_strength(scene: Scene) -> list[int]:
    """The numbers of the lights, from the one that is brightest at the object's centre."""
    strength = [float(jnp.sum(_irradiance(light, _center(scene)))) for light in scene.picture.lights]
    return sorted(range(len(strength)), key=lambda i: -strength[i])


def _light(light: AbstractLight, model: str, center: np.ndarray) -> AbstractLight:
    """The light in a simpler model that agrees with it at the object's centre."""
    if isinstance(light, Polygon) and model == "polygon, unclipped":
        sides = {"two_sided": light.two_sided, "matt_only": light.matt_only}
        return Polygon(light.vertices, light.intensity, horizon_clipping=False, **sides)
    if not isinstance(light, Point | Polygon) or model.startswith("polygon") or (isinstance(light, Point) and model == "point"):
        return light
    middle, way, distance = _towards(light, center)
    intensity = _irradiance(light, center)
    if model == "point":
        return Point(middle, intensity * distance**2, constant_attenuation=0.0, quadratic_attenuation=1.0)
    return Distant(way, intensity)


def _towards(light: Point | Polygon, center: np.ndarray) -> tuple[Array, Array, Array]:
    """The light's middle, the vector to it from the object's centre, and its distance."""
    middle = light.position if isinstance(light, Point) else jnp.mean(light.vertices, axis=0)
    way = middle - jnp.asarray(center, middle.dtype)
    return middle, way, jnp.sqrt(jnp.sum(way * way))


def _irradiance(light: AbstractLight, center: np.ndarray) -> Float[Array, " 3"]:
    """Of a surface at the object's centre that faces the light."""
    if isinstance(light, AbstractRayLight):
        return light.intensity * light.arriving(Vector(*center.tolist()))[1]
    if isinstance(light, Polygon):
        _, way, distance = _towards(light, center)
        return light.intensity * light.irradiance(Vector(*jnp.asarray(center, way.dtype)), Vector(*(way / distance)))
    return light.intensity * jnp.pi  # the same radiance from everywhere
