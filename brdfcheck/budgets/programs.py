"""Compiled programs of plans: the picture, the work it takes, and its time beside another's."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe
from brdfcheck.brdf.lobes import Lambert
from brdfcheck.budgets.knobs import Plan, plain
from brdfcheck.budgets.room import at_middle, irradiance, room_numbers
from brdfcheck.budgets.scenes import Scene
from brdfcheck.operations import program_of, work_of
from brdfcheck.quadrature.polar import Order
from brdfcheck.quadrature.zonal import zonal_weights
from brdfcheck.scene.cameras import WHOLE, Part
from brdfcheck.scene.lights import Ambient, Environment, Polygon
from brdfcheck.scene.materials import Surface
from brdfcheck.scene.meshes import Mesh, icosphere, vertex_normals
from brdfcheck.scene.raster import rasterise
from brdfcheck.scene.shading import shade
from brdfcheck.scene.smooth import SHADINGS
from brdfcheck.scene.sphere import seen_sphere
from brdfcheck.scene.vectors import Vector, dot, spread

Image = Float[np.ndarray, "3 height width"]
# Of points, normals and views in three fields each, or arrays of the shape (3, ...).
Shader = Callable[[Any, Any, Any], Array]

# Points that are shaded at once.
_BLOCK = 2**14
# The numbers that say what is seen where.
_SHOWN = ("camera", "center", "radius", "vertices", "faces", "background")
# Lights that bring nothing to terms that are not matt.
_MATT_ONLY = (Ambient, Polygon)
# Side of the windows in which the rasteriser walks over the box around a face.
_WINDOW = 16


class Picture(NamedTuple):
    """A picture in linear light, and where the object is seen in it."""

    image: Image
    covered: Bool[np.ndarray, "height width"]


@dataclass
class Program:
    """A compiled plan with its numbers. Programs of one `key` take the same time.

    `frame`: where not all pixels are shaded, the background that the others are drawn over, again in each picture.
    """

    compiled: Any
    numbers: Any
    key: Any
    frame: Array | None = None

    def image(self) -> Image:
        """The picture in linear light, in the program's own precision."""
        return np.array(self._drawn())  # a copy: the next picture is drawn into the same frame

    def seconds(self) -> float:
        """The time of one picture."""
        began = time.perf_counter()
        self._drawn().block_until_ready()
        return time.perf_counter() - began

    def _drawn(self) -> Array:
        drawn = self.compiled(self.numbers, self.frame)
        if self.frame is not None:
            self.frame = drawn
        return drawn


@dataclass
class Compiler:
    """Programs of the plans of one scene, and their work. What differs in numbers only is compiled and traced once.

    Work is counted in multiplications of float64. What is seen does not depend on how it is shaded, nor the work at a point on
    how many there are, nor the room on either: so the works of many combinations follow from few traces.
    """

    scene: Scene
    _known: dict[Any, Any] = field(default_factory=dict)

    def program(self, plan: Plan) -> Program:
        """The plan, compiled. ValueError for lights and materials that do not go together."""
        numbers = self._numbers(plan)
        structure = (jax.tree.structure(numbers), replace(plan, material=None, lights=(), bounces=plan.bounces is None))
        # Outside of a window there is the background, whatever is drawn: a frame is filled with it once.
        frame = None if plan.window is None else jnp.array(_behind(self.scene, numbers))

        def picture(numbers: Any, frame: Array | None) -> Array:
            return _picture(self.scene, plan, numbers, frame)

        if structure not in self._known:
            self._known[structure] = jax.jit(picture, donate_argnums=1).lower(numbers, frame).compile()
        return Program(self._known[structure], numbers, (structure, plan.bounces), frame)

    def picture(self, plan: Plan) -> Picture:
        """The picture of a plan by steps that plans share: what is seen where, how its points look, both together.

        So many pictures need few programs. They differ from those of `program` by rounding alone.
        """
        numbers, dtype = self._numbers(plan), plan.dtype
        shading = plan.facets and plan.facets[1]
        shown = {name: value for name, value in self._filled(numbers).items() if name in _SHOWN}

        def see(shown: Any) -> Any:
            return _sight(self.scene, plan, shown)

        sight = self._once(
            ("sight", _object(plan), plan.window, dtype),
            lambda: self._jit(("see", plan.facets is None, plan.window, dtype), see)(shown),
        )
        points, shape = self._once(("points", plan.facets, plan.window, dtype), lambda: self._points(plan, shown, sight))
        room = None
        if self.scene.room is not None:
            given = {name: numbers[name] for name in ("room", "bounces")}
            step = self._jit(("moments", plan.bounces is None, dtype), lambda given: _moments(plan, given))
            room = self._once(("moments", plan.bounces, plan.cells, dtype, "found"), lambda: step(given))

        def look(material: Any, lights: Any, room: Any, block: Array) -> Array:
            return _shader(plan, {"material": material, "lights": lights}, room)(*map(Vector._make, block))

        def colours(material: Any, lights: Any, room: Any = None) -> np.ndarray:
            key = ("look", jax.tree.structure((material, lights, room)), dtype, plan.quadrature, plan.table)
            blocks = [self._jit(key, look)(material, lights, room, block) for block in points]
            return np.concatenate(blocks, axis=1)[:, : math.prod(shape)]

        material, lights = numbers["material"], numbers["lights"]
        if isinstance(material, Surface):
            # What each light brings to each term adds up: a program for each kind of both does for all of them.
            terms = [(Surface(term, allow_unvalidated=True), term.matt) for term in material.terms]
            pairs = [(one, (light,)) for one, matt in terms for light in lights if matt or not isinstance(light, _MATT_ONLY)]
            rest = [(one, (), room) for one, matt in terms if matt and room is not None]
            colour = sum((colours(*pair) for pair in [*pairs, *rest]), np.zeros((3, math.prod(shape)), dtype))
        else:
            colour = colours(material, lights, room)

        def show(shown: Any, sight: Any, colours: Array) -> Array:
            return _drawn(self.scene, plan, shown, sight, lambda *_: colours)

        image = self._jit(("show", shading, plan.window, dtype), show)(shown, sight, colour.reshape(3, *shape))
        covered = np.zeros(self.scene.picture.size, bool)
        covered[_part(plan)] = sight[0] if plan.facets is None else sight[0].covered
        return Picture(np.asarray(image), covered)

    def _points(self, plan: Plan, shown: Any, sight: Any) -> tuple[list[np.ndarray], tuple[int, ...]]:
        """Points, normals and views, shape (3, 3, points), in blocks of one size; the shape of their fields."""

        def places(shown: Any, sight: Any) -> Array:
            return jnp.stack(jnp.broadcast_arrays(*_fields(_place(self.scene, plan, shown, sight))))

        fields = np.asarray(
            self._jit(("places", plan.facets and plan.facets[1], plan.window, plan.dtype), places)(shown, sight)
        )
        rows, size = fields.reshape(9, -1), min(_BLOCK, math.prod(self.scene.picture.size))
        rows = np.pad(rows, ((0, 0), (0, -rows.shape[1] % size)), mode="edge")
        return [block.reshape(3, 3, -1) for block in np.split(rows, rows.shape[1] // size, axis=1)], fields.shape[1:]

    def _filled(self, numbers: dict[str, Any]) -> dict[str, Any]:
        """A mesh with faces of no area, none of which is drawn, to the size of the scene's own: the same programs show it."""
        mesh = self.scene.picture.mesh
        if mesh is None or "faces" not in numbers:
            return numbers
        own = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
        return numbers | {name: np.pad(numbers[name], ((0, most - len(numbers[name])), (0, 0))) for name, most in own.items()}

    def _once(self, key: Any, make: Callable[[], Any]) -> Any:
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    def _jit(self, key: Any, function: Callable[..., Array]) -> Any:
        return self._once(key, lambda: jax.jit(function))

    def seeing(self, plan: Plan) -> tuple[float, int]:
        """The work of finding what is seen where, and how many points are shaded. By facets and precision alone."""
        found, _ = self._seen(plan)
        numbers = self._numbers(replace(plan, dtype="float64"))

        def sight(numbers: Any) -> Any:
            return _sight(self.scene, plan, numbers)

        def black(numbers: Any, found: Any) -> Any:
            return _drawn(self.scene, plan, numbers, found, _black)

        loops = _loops(self.scene, numbers)
        work = self._work(("finding", _object(plan), plan.window), plan.dtype, sight, numbers, loops=loops)
        drawing = self._work(("drawing", plan.facets, plan.window), plan.dtype, black, numbers, found)
        return work + drawing, _points(self.scene, plan)

    def _seen(self, plan: Plan) -> tuple[Any, Any]:
        """The shapes of what is seen where, and of the points, normals and views that are shaded."""
        numbers = self._numbers(replace(plan, dtype="float64"))
        found = self._once(
            ("shapes", _object(plan), plan.window),
            lambda: jax.eval_shape(lambda numbers: _sight(self.scene, plan, numbers), numbers),
        )

        place = self._once(
            ("place", plan.facets, plan.window),
            lambda: jax.eval_shape(lambda numbers, found: _place(self.scene, plan, numbers, found), numbers, found),
        )
        return found, place

    def _work(self, key: Any, dtype: str, function: Any, *arguments: Any, loops: tuple[float, ...] = ()) -> float:
        """The work of a function of numbers in float64 if it is computed in `dtype`, traced once for all of them."""
        program = self._once(("traced", *key), lambda: program_of(function, *arguments))
        return self._once(("work", *key, dtype), lambda: work_of(program, loops, jnp.dtype(dtype).itemsize))

    def shading(self, plan: Plan) -> float:
        """The work at one point. By materials, lights, the rule for the albedo, and precision alone."""
        # Of any facets those of the scene, shaded in every pixel: the same number whatever is asked for first.
        exact = replace(plan, facets=None if plan.facets is None else (None, "phong"), dtype="float64", window=None)
        numbers = self._numbers(exact)
        material, moments = numbers["material"], None if self.scene.room is None else jnp.ones(10)
        place, points = self._seen(exact)[1], _points(self.scene, exact)

        def work(lights: tuple[Any, ...]) -> float:
            parts = {"material": material, "lights": lights}
            key = ("shading", jax.tree.structure(parts), plan.quadrature, plan.table)
            shader = lambda parts, place: _shader(exact, parts, moments)(*place)  # noqa: E731
            return self._work(key, plan.dtype, shader, parts, place) / points

        # Lights of one kind cost alike, each after the first of them.
        kinds: dict[Any, list[Any]] = {}
        for light in numbers["lights"]:
            kinds.setdefault((jax.tree.structure(light), str(jax.tree.map(jnp.shape, light))), []).append(light)
        firsts = tuple(lights[0] for lights in kinds.values())
        more = [(len(lights) - 1) * (work((*firsts, lights[0])) - work(firsts)) for lights in kinds.values() if len(lights) > 1]
        return work(firsts) + sum(more)

    def room(self, plan: Plan) -> float:
        """The work of the light's bounces between the walls of a room, 0 where there is none."""
        if self.scene.room is None:
            return 0.0
        numbers = self._numbers(replace(plan, dtype="float64"))["room"]
        key = ("bounces", plan.bounces, plan.cells)
        return self._work(key, plan.dtype, lambda room: at_middle(room, plan.bounces), numbers)

    def _numbers(self, plan: Plan) -> dict[str, Any]:
        dtype, numbers = jnp.dtype(plan.dtype), _of_scene(self.scene, plan)
        if self.scene.room is not None:
            room = self.scene.room.model_copy(update={"cells": plan.cells or self.scene.room.cells})
            numbers["room"] = self._once(("room", room.cells), lambda: room_numbers(room))
        numbers = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype) if eqx.is_inexact_array(leaf) else leaf, numbers)
        return numbers | ({"bounces": jnp.asarray(plan.bounces or 0, jnp.int32)} if self.scene.room is not None else {})


def _object(plan: Plan) -> Any:
    """What of the scene is seen: the exact sphere, its own mesh, or an icosphere of a level."""
    return "sphere" if plan.facets is None else plan.facets[0]


def _points(scene: Scene, plan: Plan) -> int:
    """How many points are shaded."""
    top, bottom, left, right = plan.window or (0, scene.picture.size[0], 0, scene.picture.size[1])
    pixels = (bottom - top) * (right - left)
    if plan.facets is None or plan.facets[1] == "phong":
        return pixels
    mesh = _mesh(scene, plan)
    return len(mesh.faces) if plan.facets[1] == "flat" else len(mesh.vertices)


def _loops(scene: Scene, numbers: Mapping[str, Any]) -> tuple[float, ...]:
    """Rounds of the rasteriser's loops: of the faces half are seen, each in the windows of its box, twice its own area.

    As if the object filled the picture.
    """
    if "faces" not in numbers:
        return ()
    seen = len(numbers["faces"]) / 2
    side = (2 * scene.picture.size[0] * scene.picture.size[1] / seen) ** 0.5
    return seen, (1 + side / _WINDOW) ** 2


_icosphere = functools.cache(icosphere)


def _mesh(scene: Scene, plan: Plan) -> Mesh:
    assert plan.facets is not None
    mesh = scene.picture.mesh if plan.facets[0] is None else _icosphere(plan.facets[0], jnp.float32)
    assert mesh is not None
    return mesh


def _of_scene(scene: Scene, plan: Plan) -> dict[str, Any]:
    picture = scene.picture
    numbers = {"material": plain(plan.material), "lights": plan.lights, "camera": picture.camera}
    numbers["background"] = jnp.asarray(picture.background)
    if plan.facets is None:
        options = picture.options
        numbers["center"], numbers["radius"] = (
            jnp.asarray(options.get(name, default), float) for name, default in (("center", (0.0, 0.0, 0.0)), ("radius", 1.0))
        )
        return numbers
    mesh = _mesh(scene, plan)
    return numbers | {"vertices": mesh.vertices, "faces": mesh.faces}


def _picture(scene: Scene, plan: Plan, numbers: Mapping[str, Any], frame: Array | None) -> Array:
    moments = None if scene.room is None else _moments(plan, numbers)
    return _drawn(scene, plan, numbers, _sight(scene, plan, numbers), _shader(plan, numbers, moments), frame)


def _shader(plan: Plan, numbers: Mapping[str, Any], moments: Array | None) -> Shader:
    """What a point looks like, in a room whose radiance at the object has these `moments`, if there is one."""
    lights, material = list(numbers["lights"]), numbers["material"]
    simpler = plan.quadrature is not None or plan.table is not None
    surroundings = [light for light in lights if isinstance(light, Environment) and simpler]
    others = [light for light in lights if not any(light is one for one in surroundings)]

    def shader(point: Any, normal: Any, view: Any) -> Array:
        color = shade(material, others, point, normal, view)
        if surroundings and plan.table is not None:
            color = color + _looked_up(material, surroundings, dot(normal, view), plan.table)
        elif surroundings:
            for light in surroundings:
                color = color + _surrounded(material, light, dot(normal, view), plan.quadrature or 0)
        if moments is not None:
            arriving = irradiance(moments, Vector(*normal)) / np.pi
            matt = sum((term.albedo() for term in material.terms if term.matt), jnp.zeros((), arriving.dtype))
            color = color + spread(matt, arriving.ndim) * arriving
        return color

    return shader


def _moments(plan: Plan, numbers: Mapping[str, Any]) -> Array:
    """Those of the radiance at the object in the room."""
    return at_middle(numbers["room"], None if plan.bounces is None else numbers["bounces"])


def _sight(scene: Scene, plan: Plan, numbers: Mapping[str, Any]) -> Any:
    """What is seen where: of the sphere as `seen_sphere` says it, of a mesh its fragments and the normals at its vertices."""
    picture, camera = scene.picture, numbers["camera"]
    if plan.facets is None:
        return seen_sphere(camera, numbers["center"], numbers["radius"], picture.size, _part(plan))
    mesh, options = Mesh(numbers["vertices"], numbers["faces"]), picture.options
    given = {name: options[name] for name in ("cull", "interpolation") if name in options}
    return rasterise(mesh, camera, picture.size, part=_part(plan), **given), vertex_normals(
        mesh, options.get("weighting", "unit")
    )


def _behind(scene: Scene, numbers: Mapping[str, Any]) -> Array:
    return jnp.broadcast_to(spread(numbers["background"], 2), (3, *scene.picture.size))


def _drawn(
    scene: Scene, plan: Plan, numbers: Mapping[str, Any], sight: Any, shader: Shader, frame: Array | None = None
) -> Array:
    """The picture of what is seen, over the background or a `frame` that is filled with it."""
    if plan.facets is None:
        covered, *place = sight
        image = shader(*place)
    else:
        fragments, normals = sight
        mesh = Mesh(numbers["vertices"], numbers["faces"])
        covered, image = fragments.covered, SHADINGS[plan.facets[1]](mesh, numbers["camera"], fragments, normals, shader)
    behind, (rows, columns) = _behind(scene, numbers), _part(plan)
    shown = jnp.where(covered, image, behind[:, rows, columns])
    return shown if plan.window is None else (behind if frame is None else frame).at[:, rows, columns].set(shown)


def _part(plan: Plan) -> Part:
    """The rows and columns of the picture that are shaded."""
    if plan.window is None:
        return WHOLE
    top, bottom, left, right = plan.window
    return slice(top, bottom), slice(left, right)


def _fields(place: Any) -> list[Array]:
    return [field for vector in place for field in vector]


def _black(*place: Any) -> Array:
    fields = _fields(place)
    return jnp.zeros((3, *jnp.broadcast_shapes(*map(jnp.shape, fields))), fields[0].dtype)


def _place(scene: Scene, plan: Plan, numbers: Mapping[str, Any], sight: Any) -> Any:
    """The points, normals and views that are shaded."""
    caught: list[Any] = []

    def catch(*place: Any) -> Array:
        caught.append(place)
        return _black(*place)

    _drawn(scene, plan, numbers, sight, catch)
    return caught[0]


def _looked_up(material: Surface, lights: Sequence[Environment], cosine: Array, entries: int) -> Array:
    """What a surface reflects of uniform surroundings, between its values at `entries` equidistant cosines of the view."""
    mu = jnp.linspace(0, 1, entries, dtype=cosine.dtype)
    zero, one = jnp.zeros_like(mu), jnp.ones_like(mu)
    view = Vector(jnp.sqrt(1 - mu * mu), zero, mu)
    table = shade(material, lights, Vector(zero, zero, zero), Vector(zero, zero, one), view)
    place = jnp.clip(cosine, 0, 1) * (entries - 1)
    below = jnp.minimum(place.astype(jnp.int32), entries - 2)
    share = place - below.astype(place.dtype)
    return table[:, below] * (1 - share) + table[:, below + 1] * share


def _surrounded(material: Surface, light: Environment, cosine: Array, nodes: int) -> Array:
    """What a surface reflects of a uniform surrounding: the albedos of its terms, by a rule in one dimension."""
    total = jnp.zeros((3,) + (1,) * cosine.ndim, cosine.dtype)
    for term in material.terms:
        brdf, core = term.brdf, term.brdf.core
        if isinstance(core, Lambert):
            total = total + spread(light.intensity * term.albedo().astype(cosine.dtype), cosine.ndim)
        elif isinstance(core, AbstractZonalLobe) and isinstance(brdf, AbstractBRDF):
            core = jax.tree.map(lambda leaf: leaf.astype(cosine.dtype) if eqx.is_inexact_array(leaf) else leaf, core)

            def albedo(mu: Array, core: AbstractZonalLobe = core) -> Array:
                order = Order(nodes, nodes)
                versines, weights = zonal_weights(core.form, mu, core.breaks(), core.width(), (order,))
                return jnp.sum(weights[0] * core.profile(versines)) * core.amplitude()

            flat = jnp.clip(cosine, 0, 1).reshape(-1)
            value = jax.lax.map(albedo, flat, batch_size=min(_BLOCK, flat.size)).reshape(cosine.shape)
            factor = jnp.asarray(brdf.gain(jnp.ones((), cosine.dtype)), cosine.dtype)
            total = total + spread(light.intensity * term.tint, cosine.ndim) * (factor * value)
    return total
