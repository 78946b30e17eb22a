"""Pictures by name: the seed's figures, the white furnace, lobes, lights, and what smooth shading loses.

A preset is a caption, a side in pixels and a function of a `Canvas`, which renders at that side with several samples to a
pixel. Sheets of several pictures have that side for each. Lights of sheets of one kind are the same; what is exposed
differently says so.
"""

from __future__ import annotations

import difflib
import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from brdfcheck import albedo, catalog
from brdfcheck.factors import Constant, Normalized, PerCosine, peel
from brdfcheck.scene import failures, meshes
from brdfcheck.scene.cameras import Orthographic, Perspective, checked_size
from brdfcheck.scene.drawing import color_scale, curve, false_color, stacked
from brdfcheck.scene.furnace import directional_albedo
from brdfcheck.scene.images import contact_sheet
from brdfcheck.scene.interpolation import area_weights, interpolated, scan_line_weights
from brdfcheck.scene.lights import Ambient, Distant, Environment, Point, Polygon, Spot
from brdfcheck.scene.materials import Highlight, Metal, Surface, Term, Translucent
from brdfcheck.scene.smooth import render_shadings
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.tracing import Plane, Sphere, composed, trace

Image = Float[np.ndarray, "3 height width"]

QUALITIES: Mapping[str, int] = MappingProxyType({"draft": 1, "normal": 2, "high": 4})
"""Samples along each side of a pixel."""


@dataclass(frozen=True)
class Canvas:
    """Renders squares of `side` pixels, each the mean of samples x samples."""

    side: int
    samples: int = 2
    done: Callable[[], None] = lambda: None
    """Called after each picture."""

    @property
    def size(self) -> tuple[int, int]:
        """The size at which is rendered."""
        return self.side * self.samples, self.side * self.samples

    def mean(self, image: Any) -> Image:
        """The mean of the samples of each pixel, in linear light."""
        mean = averaged(image, self.samples)
        self.done()
        return mean

    def sphere(self, material: Any, lights: Any, camera: Any = None, **options: Any) -> Image:
        return self.mean(sphere_image(material, lights, camera, size=self.size, **options))

    def meshes(
        self, mesh: Any, camera: Any, material: Any, lights: Any, shadings: Sequence[str], **options: Any
    ) -> list[Image]:
        """The mesh under several shadings."""
        images = render_shadings(mesh, camera, material, lights, shadings, size=self.size, **options)
        return [self.mean(image) for image in images]

    def checks(self, squares: int = 8, low: float = 0.15, high: float = 0.75) -> np.ndarray:
        """A chequered background at the size at which is rendered."""
        square = np.arange(self.size[0]) * squares // self.size[0]
        board = np.where((square[:, None] + square) % 2, high, low).astype(np.float32)
        return np.broadcast_to(board, (3, *board.shape))


def averaged(image: Any, samples: int) -> Float[np.ndarray, "... height width"]:
    """The mean of squares of samples x samples pixels, of shape (..., height, width)."""
    array = np.asarray(image, np.float32)
    *channels, height, width = array.shape
    return array.reshape(*channels, height // samples, samples, width // samples, samples).mean(axis=(-3, -1))


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
    raise KeyError(f"unknown preset {name!r}; {hint}")


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


# --- the seed's figures: Yokoi, Ito, Tsuruoka, Miyake ---

_BLUE, _RED, _GOLD = (0.1, 0.3, 0.8), (0.8, 0.12, 0.1), (1.0, 0.72, 0.25)
_UPPER_RIGHT, _LEFT, _BELOW = (1.0, 1.0, 1.0), (-1.0, 0.1, 0.2), (-0.1, -1.0, 0.2)
_GREY = 0.1


def _row(values: Sequence[float], name: str, material: Callable[[float], Any]) -> Callable[[Canvas], Image]:
    """One sphere for each value of a parameter."""

    def make(canvas: Canvas) -> Image:
        light = [Distant(_UPPER_RIGHT)]
        row = [canvas.sphere(material(value), light, background=_GREY) for value in values]
        return contact_sheet([row], columns=[f"{name} = {value:g}" for value in values])

    return make


def _translucent(rows: Sequence[float], columns: Sequence[float], build: Callable[..., Any], names: tuple[str, str]) -> Any:
    def make(canvas: Canvas) -> Image:
        behind, light = canvas.checks(), [Distant(_UPPER_RIGHT)]
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


def _figure_9(canvas: Canvas) -> Image:
    spheres, lights, camera = figure_9_spheres(), [Distant(_UPPER_RIGHT)], Orthographic()
    scene = {"size": canvas.size, "background": 0.5}
    painted = composed(spheres, lights, camera, **scene)
    traced = trace(spheres, lights, camera, shadows=False, **scene)
    shadowed = trace(spheres, lights, camera, shadows=True, **scene)
    apart = float(np.abs(np.asarray(painted) - np.asarray(traced)).max())
    columns = ("equation (8)", f"rays: differ by {apart:.0e}", "rays with shadows")
    return contact_sheet([[canvas.mean(image) for image in (painted, traced, shadowed)]], columns=columns)


_EXPOSURE = 0.75  # of the metals: their highlights reach 1.3
_METALS: dict[str, tuple[Any, str, Sequence[tuple[Any, float]]]] = {
    "10": ([(0.013, 0.2), (0.1, 0.4)], "facets", [(_UPPER_RIGHT, 1), (_LEFT, 1)]),
    "11": (
        [[(0.013, 0.2), (0.1, 0.4)], [(0.1, 0.4)], [(0.1, 0.4)]],
        "facets",
        [(_UPPER_RIGHT, 1), (_LEFT, 0.7), (_BELOW, 0.7)],
    ),
    "12": ([[(1, 13)], [(1, 8)], [(1, 8)]], "half", [(_UPPER_RIGHT, 1), (_LEFT, 0.4), (_BELOW, 0.4)]),
    "13": ([[(0.2, 20), (0.8, 3)], [(1, 2)], [(1, 2)]], "mirror", [(_UPPER_RIGHT, 1), (_LEFT, 0.4), (_BELOW, 0.4)]),
}


def _metal(figure: str) -> Callable[[Canvas], Image]:
    def make(canvas: Canvas) -> Image:
        lobes, form, lights = _METALS[figure]
        metal = Metal(_GOLD, lobes, d=0.05, form=form)  # pyright: ignore[reportArgumentType]
        image = canvas.sphere(metal, [Distant(direction, a) for direction, a in lights], background=_GREY / _EXPOSURE)
        return np.float32(_EXPOSURE) * image

    return make


# --- the white furnace ---

_ENVIRONMENT = 0.4  # a sphere that returns 2.5 times the light is white
_USUAL = {"n": 20.0, "m": 0.3, "alpha": 0.3, "reflectance": 1.0}
# (published, its parameters where the excess is of interest, the validated one of the same lobe)
PAIRS: tuple[tuple[str, dict[str, float], str], ...] = (
    ("binomial-power-raw", {"n": 4}, "binomial-power-half"),
    ("binomial-power-published", {"n": 17.85}, "binomial-power-half"),
    ("binomial-power-unclamped", {"n": 40}, "binomial-power-half"),
    ("blinn-phong-6", {"n": 20}, "blinn-phong"),
    ("blinn-phong-8", {"n": 8.76}, "blinn-phong"),
    ("blinn-phong-ndf", {"n": 100}, "blinn-phong"),
    ("blinn-phong-linear", {"n": 20}, "blinn-phong"),
    ("phong-pdf", {"n": 20}, "phong"),
    ("phong-classical", {"n": 4}, "phong"),
    ("schlick-phong-factor", {"n": 100}, "schlick-mirror"),
    ("kuijk-blake-phong-factor", {"n": 9}, "kuijk-blake-mirror"),
    ("cook-torrance-published", {"m": 0.4}, "cook-torrance"),
    ("cook-torrance-no-masking", {"m": 0.4}, "cook-torrance"),
)
"""What was published beside the validated BRDF of the same lobe."""


_USUAL_SIDE = 2.1  # of what the usual camera sees; the sphere's radius is 1


@functools.lru_cache(maxsize=2)
def _distances(side: int, samples: int = 1) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, "n n"]]:
    """The squared distances from the sphere's centre that a square of pixels has, and which of them each sample has.

    Inside the disc all samples of a pixel have its centre's: the albedo is smooth there, and an edge is not. Those that miss
    the sphere have the number -1. Distances are sums of two squares of whole numbers, so that many pixels share one.
    """
    count = side * samples
    own = 2 * np.arange(count) + 1 - count  # in half samples from the middle
    center = np.repeat(samples * (2 * np.arange(side) + 1 - side), samples)
    limit = (2 * count / _USUAL_SIDE) ** 2
    square, within = own[:, None] ** 2 + own**2, center[:, None] ** 2 + center**2
    reach = np.abs(center) + samples
    inside = reach[:, None] ** 2 + reach**2 < limit
    whole = np.where(inside, within, square)
    found, number = np.unique(np.where(whole < limit, whole, -1), return_inverse=True)
    hit = found >= 0
    return found[hit] / limit, number.reshape(count, count) - int(not hit.all())


def _alike(brdf: Any) -> Any:
    """The BRDF in single precision with its factor as a number: lobes of one kind are then one compiled program."""
    if isinstance(brdf, PerCosine):
        return PerCosine(_alike(brdf.base))
    core, scale = peel(brdf)
    if hasattr(core, "n"):
        brdf = Normalized(core, Constant(scale(1.0)))
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), brdf)


_integrated = eqx.filter_jit(directional_albedo)
_AT_ONCE = 512  # angles in one call, whatever the size of the picture: no other program for another number of them


def _reflected(name: str, parameters: Mapping[str, float], cosine: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """What a catalogue BRDF reflects of a uniform surrounding of radiance 1, integrated at each cosine."""
    brdf = _alike(catalog.entry(name).family.build(**parameters))
    padded = np.pad(cosine, (0, -cosine.size % _AT_ONCE), mode="edge").astype(np.float32).reshape(-1, _AT_ONCE)
    return np.concatenate([_integrated(brdf, jnp.asarray(part)) for part in padded])[: cosine.size]


@functools.lru_cache(maxsize=128)
def _ratios(name: str, parameters: tuple[tuple[str, float], ...], side: int, samples: int) -> Float[np.ndarray, " k"]:
    """`_reflected` at each of the `_distances`."""
    return _reflected(name, dict(parameters), np.sqrt(1 - _distances(side, samples)[0]))


def furnace_largest(name: str, parameters: Mapping[str, float]) -> float:
    """The most that a catalogue BRDF reflects of a uniform surrounding of radiance 1, of all whole degrees from 0 to 89.

    Some published forms have no largest value at 90 degrees, and the brightest pixel of a picture depends on its size.
    """
    return float(_reflected(name, parameters, np.cos(np.radians(np.arange(90.0)))).max())


def _disc(colors: Float[np.ndarray, "3 k"], ground: Any, side: int, samples: int) -> Image:
    """A colour for each of the `_distances`, before a ground of one colour, each pixel the mean of its samples."""
    _, number = _distances(side, samples)
    ground = np.broadcast_to(np.asarray(ground, np.float32), (3,))[:, None]
    return averaged(np.concatenate([colors, ground], axis=1, dtype=np.float32)[:, number], samples)  # -1 is the last


def furnace_tile(name: str, parameters: Mapping[str, float], side: int, samples: int = 1) -> Image:
    """The sphere of a catalogue BRDF in a uniform surrounding of radiance 0.4, before it, as `sphere_image` shows it.

    Integrated at every distance from the centre that a pixel has: 27 times fewer than pixels on a side of 512. More
    `samples` smooth the edge. KeyError for an unknown name, ValueError for bad parameters or a side that is none.
    """
    checked_size((side, side))
    ratios = _ratios(name, tuple(parameters.items()), side, samples)
    return _disc(np.broadcast_to(_ENVIRONMENT * ratios, (3, ratios.size)), _ENVIRONMENT, side, samples)


def furnace_excess(name: str, parameters: Mapping[str, float], side: int) -> Float[np.ndarray, "side side"]:
    """How much more than its surroundings each pixel of `furnace_tile` shows, as a share; 0 beside the sphere."""
    checked_size((side, side))
    ratios = _ratios(name, tuple(parameters.items()), side, 1)
    return np.append(ratios - 1, np.float32(0))[_distances(side)[1]]


_GROUND = (0.55, 0.68, 0.85)  # pale blue: what is not the sphere


def _colored(excess: Float[np.ndarray, "n n"], covered: Float[np.ndarray, "n n"], *scale: float) -> Image:
    """An excess in false colour where a pixel is `covered` by half or more, and the ground elsewhere.

    Both are means over the samples of a pixel, the excess 0 beside the object. The excess is averaged, not its colour: a
    mean of colours is on no scale.
    """
    inside = covered >= 0.5
    mean = excess / np.where(inside, covered, 1)
    return np.where(inside, false_color(mean, *scale), np.array(_GROUND)[:, None, None]).astype(np.float32)


def _false_tile(name: str, parameters: Mapping[str, float], side: int, samples: int) -> Image:
    """The excess in false colour."""
    number = _distances(side, samples)[1]
    excess = np.append(_ratios(name, tuple(parameters.items()), side, samples) - 1, np.float32(0))[number]
    return _colored(averaged(excess, samples), averaged(number >= 0, samples))


def _furnace_pair(canvas: Canvas, name: str, parameters: Mapping[str, float]) -> list[Image]:
    pair = [make(name, parameters, canvas.side, canvas.samples) for make in (furnace_tile, _false_tile)]
    canvas.done()
    return pair


def _numbers(parameters: Mapping[str, float]) -> str:
    return ", ".join(f"{key} = {value:g}" for key, value in parameters.items())


def _share(most: float) -> str:
    if most > 2:
        return f"{most:.3g} times"
    return f"+{most - 1:.2%}" if most - 1 > 1e-5 else "conserves"


_SCALE = "what is reflected beyond 1; from white to black: less and less than 1"


def _furnace(canvas: Canvas) -> Image:
    # First what returns all light and vanishes: the validated lobes of the others lose some away from the normal.
    white, whiter = {"reflectance": 1.0}, {"reflectance": 1.2}
    rows = [_furnace_pair(canvas, "lambert", white) + _furnace_pair(canvas, "lambert", whiter)]
    labels = [f"lambert, reflectance = 1, beside 1.2: {_share(furnace_largest('lambert', whiter))}"]
    for name, parameters, validated in PAIRS:
        rows.append(_furnace_pair(canvas, validated, parameters) + _furnace_pair(canvas, name, parameters))
        label = f"{name}, {_numbers(parameters)}: {_share(furnace_largest(name, parameters))}"
        if name == "phong-classical":  # not reciprocal, and the furnace gathers over the direction of the light
            other = float(albedo(catalog.entry(name).family.build(**parameters), np.cos(np.radians(89.0))).value)
            label += f"\n(summed over views, light at 89 degrees: {other:.3g} times)"
        labels.append(label)
    columns, down = ("validated", "excess", "published", "excess"), "the largest of 0 to 89 degrees"
    sheet = contact_sheet(rows, columns=columns, labels=labels, down=down)
    return stacked(sheet, color_scale(sheet.shape[2], _SCALE))


def _furnace_validated(canvas: Canvas) -> Image:
    tiles, labels = [], []
    for entry in catalog.entries():
        if entry.validated:
            values = {name: _USUAL[name] for name in entry.family.ranges}
            tiles.append(_furnace_pair(canvas, entry.name, values))
            labels.append(f"{entry.name}, {_numbers(values)}")
    half = len(tiles) // 2
    columns = ("furnace", "excess")
    sheets = [contact_sheet(tiles[part], columns=columns, labels=labels[part]) for part in (slice(half), slice(half, 2 * half))]
    sheet = np.concatenate(sheets, axis=2)
    return stacked(sheet, color_scale(sheet.shape[2], _SCALE))


# --- lobes and lights ---

_LOBES = ("phong", "schlick-mirror", "kuijk-blake-mirror", "blinn-phong", "lyon-2-half", "binomial-power-half")


def _lobes(canvas: Canvas) -> Image:
    rows, exponents = [], (10.0, 100.0, 1000.0)
    for n in exponents:
        light = [Distant(_UPPER_RIGHT, 2 * np.pi / (n + 2))]
        rows.append([canvas.sphere(Surface(Term(name, n=n)), light, background=0.02) for name in _LOBES])
    return contact_sheet(rows, columns=_LOBES, labels=[f"n = {n:g}" for n in exponents])


def _matt_and_glossy(tint: Any = (0.55, 0.2, 0.1), gloss: float = 0.12, n: float = 60.0) -> Surface:
    return Surface(Term("lambert", tint), Term("blinn-phong", gloss, n=n))


_SQUARE = ((1.4, -1.0, -1.0), (1.4, 1.0, -1.0), (1.4, 1.0, 1.0), (1.4, -1.0, 1.0))


def _lights(canvas: Canvas) -> Image:
    surface, matt = _matt_and_glossy(), Surface(Term("lambert", (0.55, 0.2, 0.1)))
    ambient = Ambient(0.3)
    distant = Distant(_UPPER_RIGHT, 0.8 * np.pi)
    point = Point((0.9, 0.9, 1.2), 1.5, constant_attenuation=0, quadratic_attenuation=1)
    spot = Spot((1.0, 1.0, 2.0), (-1.0, -1.0, -1.6), 0.9 * np.pi, spot_cutoff=14.0, spot_exponent=20.0)
    scenes = {
        "ambient": (surface, [ambient]),
        "distant": (surface, [distant]),
        "point": (surface, [point]),
        "spot": (surface, [spot]),
        "polygon: matt part": (matt, [Polygon(_SQUARE, 1.5)]),
        "environment": (surface, [Environment(0.8)]),
        "ambient + spot + left": (surface, [ambient, spot, Distant(_LEFT, (0.2, 0.4, 0.9))]),
    }
    row = [canvas.sphere(*scene, background=0.02) for scene in scenes.values()]
    return contact_sheet([row], columns=tuple(scenes))


def _polygon_light(canvas: Canvas) -> Image:
    matt, camera = Surface(Term("lambert", 0.9)), Perspective((0.6, 0.5, 5.0), field_of_view=25.0)
    images = [
        canvas.sphere(matt, [Polygon(_SQUARE, 1.2, horizon_clipping=clipped)], camera, background=0.02)
        for clipped in (True, False)
    ]
    covered = canvas.sphere(Surface(Term("lambert", 1.0)), [Ambient(1.0)], camera)[0]
    difference = _colored(np.abs(images[1] - images[0]).max(axis=0), covered, 1e-3, 1.0)
    sheet = contact_sheet([[*images, difference]], columns=("clipped", "not clipped", "difference"))
    return stacked(sheet, color_scale(sheet.shape[2], "difference of the radiance; white: less than 0.001", 1e-3, 1.0))


# --- smooth shading ---

_LEVELS = (0, 1, 2, 3)


def _single(mesh_level: int) -> meshes.Mesh:
    return meshes.icosphere(mesh_level, jnp.float32)


def _turned(columns: Sequence[Sequence[Image]]) -> list[list[Image]]:
    """Rows of columns."""
    return [list(row) for row in zip(*columns, strict=True)]


def _faces(level: int) -> str:
    return f"{20 * 4**level} faces"


def worst_facet(mesh: meshes.Mesh) -> Float[np.ndarray, " 3"]:
    """The normal of the facet whose vertices are farthest from it, on a mesh of the unit sphere."""
    normals = np.asarray(meshes.face_normals(mesh), float)
    return normals[np.argmin((normals @ np.asarray(mesh.vertices, float).T).max(axis=1))]


def towards_facet(mesh: meshes.Mesh, degrees: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors to the eye and to a light, `degrees` to either side of the worst facet: its normal is their half vector."""
    axis = worst_facet(mesh)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side *= np.tan(np.radians(degrees)) / np.linalg.norm(side)
    return tuple((axis + sign * side) / np.linalg.norm(axis + side) for sign in (1, -1))  # pyright: ignore[reportReturnType]


def _gouraud_phong(canvas: Canvas) -> Image:
    n, shadings = 100.0, ("flat", "gouraud", "phong")
    material = _matt_and_glossy((0.5, 0.12, 0.08), 0.08, n)
    columns, pictures = [], []
    for level in _LEVELS:
        mesh = _single(level)
        view, light = towards_facet(mesh)
        camera, lights = Orthographic(5 * view, up=np.cross(view, light)), [Distant(light, 0.7 * np.pi)]
        pictures.append(canvas.meshes(mesh, camera, material, lights, shadings, background=0.02))
        pictures[-1].append(canvas.sphere(material, lights, camera, background=0.02))
        reach = np.degrees(float(failures.facet_circumradius(mesh)))
        columns.append(f"{_faces(level)}, {reach:.1f} deg: {float(failures.lost_highlight(mesh, n)):.3f}")
    across = f"degrees from a facet's centre to its corners: what Gouraud shading leaves of a highlight there, n = {n:g}"
    return contact_sheet(_turned(pictures), columns=columns, labels=(*shadings, "exact"), across=across)


_ASIDE = np.array([0.3, 0.2, 1.0])


def _bleed(canvas: Canvas) -> Image:
    camera, lights = Orthographic(5 * _ASIDE), [Distant(-_ASIDE, np.pi)]
    white = Surface(Term("lambert", 1.0))
    columns, pictures, shadings = [], [], ("gouraud", "phong")
    for level in _LEVELS[:3]:
        columns.append(f"{_faces(level)}: up to {float(failures.silhouette_bleed(_single(level), _ASIDE)):.2f}")
        pictures.append(canvas.meshes(_single(level), camera, white, lights, shadings))
    pictures.append([canvas.sphere(white, lights, camera)] * 2)
    across = "light straight from behind: all that is seen is wrong"
    return contact_sheet(_turned(pictures), columns=(*columns, "exact"), labels=shadings, across=across)


def _mach_bands(canvas: Canvas) -> Image:
    mesh, height, reach = meshes.icosphere(1), 0.1, 1.25
    white, lights = Surface(Term("lambert", 1.0)), [Distant(_ASIDE, np.pi)]
    camera = Orthographic(half_height=reach)
    columns, curves, shadings = [], [], ("flat", "gouraud", "phong")
    images = canvas.meshes(mesh, camera, white, lights, shadings, background=0.02)
    for shading in shadings:
        found = failures.mach_bands(mesh, shading, _ASIDE, height=height)
        kind = "value" if shading == "flat" else "slope"
        columns.append(f"{shading}: {kind} jumps {found.largest(kind):.2f}")
        slope = np.append(found.slope, found.slope[-1])
        # Where the value itself jumps there is no slope.
        curves.append((found.position, found.value, np.where(np.abs(slope) < 10, slope, 0)))
    images.append(canvas.sphere(white, lights, camera, background=0.02))
    columns.append("exact")
    x = np.linspace(-0.9, 0.9, 2001)
    value = np.maximum(_ASIDE @ [x, np.full_like(x, height), np.sqrt(1 - x * x - height * height)], 0)
    value /= np.linalg.norm(_ASIDE)
    curves.append((x, value, np.gradient(value, x)))
    most = float(np.ceil(max(np.abs(slope).max() for _, _, slope in curves)))
    row = int((reach - height) / (2 * reach) * canvas.side)
    for image in images:
        image[:, row, ::3] = np.array([[0.8], [0.0], [0.0]])
    rows = [
        images,
        [curve(canvas.side, x, value, 0, 1, span=(-reach, reach)) for x, value, _ in curves],
        [curve(canvas.side, x, slope, -most, most, span=(-reach, reach)) for x, _, slope in curves],
    ]
    across = "along the dotted line; jumps at |x| < 0.8, away from the silhouette"
    return contact_sheet(rows, columns=columns, labels=(_faces(1), "value", "slope"), across=across)


def _sheets(canvas: Canvas) -> Image:
    white = Surface(Term("lambert", 0.9))
    camera, lights = Orthographic((0.0, -2.0, 5.0), half_height=1.1), [Distant((np.sin(np.radians(25)), 0.0, 0.906), np.pi)]
    sheets = {"zigzag": meshes.zigzag(), "corrugated": meshes.corrugated()}
    columns = [
        f"{name}: {float(failures.facet_contrast(mesh)):.3f}, {float(failures.interpolated_contrast(mesh)):.3f}"
        for name, mesh in sheets.items()
    ]
    pictures = [canvas.meshes(mesh, camera, white, lights, ("flat", "gouraud"), background=0.02) for mesh in sheets.values()]
    across = "contrast of facets, of averaged normals"
    return contact_sheet(_turned(pictures), columns=columns, labels=("flat", "gouraud"), across=across)


_CORNERS, _COLORS = ((-0.7, -0.7), (0.7, -0.7), (0.7, 0.7), (-0.7, 0.7)), (0.0, 1.0, 0.0, 1.0)


@jax.jit
def _turned_square(at: Float[Array, "2 n n"], angle: Float[Array, ""]) -> tuple[Array, Array, Array]:
    """Points in a turned square with colours at its corners: whether they are inside, by scan lines, by two triangles."""
    turn = jnp.array([[jnp.cos(angle), -jnp.sin(angle)], [jnp.sin(angle), jnp.cos(angle)]])
    corners, colors = jnp.asarray(_CORNERS) @ turn.T, jnp.asarray(_COLORS)
    own = jnp.tensordot(turn.T, at, 1)
    halves = [interpolated(area_weights(corners[part], at), colors[part]) for part in np.array([[0, 1, 2], [0, 2, 3]])]
    inside = jnp.max(jnp.abs(own), axis=0) <= _CORNERS[2][0]
    return inside, interpolated(scan_line_weights(corners, at), colors), jnp.where(own[0] > own[1], *halves)


def _quadrilaterals(canvas: Canvas) -> Image:
    axis = (np.arange(canvas.size[0]) + 0.5) / canvas.size[0] * 2.1 - 1.05
    at, ground = jnp.stack(jnp.meshgrid(axis, -axis)), np.array(_GROUND)[:, None, None]
    columns, pictures = [], []
    for degrees in (0, 15, 30, 45):
        angle = jnp.asarray(np.radians(degrees))
        inside, *ways = _turned_square(at, angle)
        # Cut: rounding goes below 0.
        pictures.append([canvas.mean(np.where(inside, np.clip(way, 0, 1), ground)) for way in ways])
        centre = failures.turned_quadrilateral(jnp.asarray(_CORNERS), jnp.asarray(_COLORS), jnp.zeros(2), angle)
        columns.append(f"{degrees} degrees: {float(centre):.2f}")
    across = "a square turned, its corners 0, 1, 0, 1: what the centre is by scan lines"
    return contact_sheet(_turned(pictures), columns=columns, labels=("scan lines", "two triangles"), across=across)


# --- rays ---


def _glass(canvas: Canvas) -> Image:
    floor = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0), Surface(Term("lambert", 0.6)))
    bodies = (
        floor,
        Sphere((-0.8, -0.3, -0.6), 0.7, mirror=0.85),
        Sphere((0.5, -0.45, 0.6), 0.55, transparency=1.0, index=1.5),
        Sphere((1.0, -0.5, -1.2), 0.5, _matt_and_glossy()),
        Sphere((-0.35, -0.8, 1.3), 0.2, _matt_and_glossy((0.1, 0.3, 0.6))),
    )
    camera = Perspective((0.0, 0.6, 5.5), (0.0, -0.4, 0.0), field_of_view=30.0)
    lights = [Ambient(0.15), Distant((1.0, 2.0, 1.0), 0.9 * np.pi)]
    return canvas.mean(trace(bodies, lights, camera, size=canvas.size, depth=6, background=(0.35, 0.5, 0.7)))


_YOKOI = "Yokoi et al., figure"
_PRESETS: dict[str, Preset] = {
    "figure-5": Preset(
        f"{_YOKOI} 5: highlight (4), exponent n, w = 1", 128,
        _row((2, 4, 6, 8, 10, 20, 40, 60, 80, 100), "n", lambda n: Highlight(_BLUE, n=n)),
    ),
    "figure-6": Preset(
        f"{_YOKOI} 6: highlight (4), weight w, n = 10", 128,
        _row((1, 0.8, 0.6, 0.4, 0.2), "w", lambda w: Highlight(_BLUE, w=w)),
    ),
    "figure-7": Preset(
        f"{_YOKOI} 7: translucent (8), opacity t_h", 128,
        _translucent(
            (0, 0.5), (0.2, 0.4, 0.6, 0.8, 1.0),
            lambda t_p, t_h, behind: Translucent(_BLUE, t_h=t_h, t_p=t_p, behind=behind), ("t_p", "t_h"),
        ),
    ),
    "figure-8": Preset(
        f"{_YOKOI} 8: translucent (8), exponent t_p of the opacity", 128,
        _translucent(
            (0.8,), (0, 0.5, 1.0, 1.5, 2.0),
            lambda t_h, t_p, behind: Translucent(_BLUE, t_h=t_h, t_p=t_p, behind=behind), ("t_h", "t_p"),
        ),
    ),
    "figure-9": Preset(f"{_YOKOI} 9: opaque and translucent spheres, by equation (8) and by rays", 256, _figure_9),
    "figure-10": Preset(f"{_YOKOI} 10: metal (12), two lights; exposure 0.75", 256, _metal("10")),
    "figure-11": Preset(f"{_YOKOI} 11: metal (12), secondary lights from left and below; exposure 0.75", 256, _metal("11")),
    "figure-12": Preset(f"{_YOKOI} 12: metal (15), powers of N.H; exposure 0.75", 256, _metal("12")),
    "figure-13": Preset(f"{_YOKOI} 13: metal (16), powers of R.V; exposure 0.75", 256, _metal("13")),
    "furnace": Preset("white furnace: published BRDFs beside the validated ones; the excess in false colour", 97, _furnace),
    "furnace-validated": Preset("white furnace of every validated BRDF: none glows", 81, _furnace_validated),
    "lobes": Preset("lobes at equal n under one light; light scaled by 2 pi/(n+2)", 144, _lobes),
    "lights": Preset("one surface under every kind of light; under the polygon its matt part alone", 160, _lights),
    "polygon-light": Preset("a square light beside a matt sphere, clipped at its horizon and not", 224, _polygon_light),
    "gouraud-phong": Preset("flat, Gouraud and Phong shading at 20 to 1280 faces", 176, _gouraud_phong),
    "silhouette-bleed": Preset("colour of the far side at the silhouette of a mesh lit from behind", 176, _bleed),
    "mach-bands": Preset("jumps of the slope that smooth shading leaves", 208, _mach_bands),
    "quadrilaterals": Preset("scan-line interpolation in a square depends on how it is turned", 160, _quadrilaterals),
    "sheets": Preset("averaged normals: a zigzag vanishes, a corrugation stays", 224, _sheets),
    "glass": Preset("mirror, glass and matt spheres by rays: Fresnel, Snell, shadows", 384, _glass),
}  # fmt: skip

PRESETS: Mapping[str, Preset] = MappingProxyType(_PRESETS)
"""Every preset by its name."""
