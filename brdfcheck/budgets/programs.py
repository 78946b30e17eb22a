"""Compiled programs of plans: the picture, the work it takes, and its time beside another's."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from brdfcheck.budgets.grid import Grid
from brdfcheck.budgets.knobs import Plan, plain
from brdfcheck.budgets.room import at_middle, room_numbers
from brdfcheck.budgets.scenes import Scene
from brdfcheck.budgets.shaders import BLOCK, Shader, point_shader, shader_of, split
from brdfcheck.operations import program_of, work_of
from brdfcheck.scene.cameras import WHOLE, Part
from brdfcheck.scene.lights import Ambient, Polygon
from brdfcheck.scene.materials import Surface
from brdfcheck.scene.meshes import Mesh, icosphere, vertex_normals
from brdfcheck.scene.raster import WINDOW, rasterise
from brdfcheck.scene.smooth import SHADINGS
from brdfcheck.scene.sphere import seen_sphere
from brdfcheck.scene.vectors import Vector, spread

Image = Float[np.ndarray, "3 height width"]
# The numbers that say what is seen where.
_SPHERE = ("camera", "center", "radius")
_SHOWN = (*_SPHERE, "vertices", "faces", "background")
# Lights that bring nothing to terms that are not matt.
_MATT_ONLY = (Ambient, Polygon)


class Picture(NamedTuple):
    """A picture in linear light, and where the object is seen in it."""

    image: Image
    covered: Bool[np.ndarray, "height width"]


@dataclass
class Program:
    """A compiled plan with its numbers, a list: JAX takes a tree of lights and materials apart in each call, in 10 to 30
    microseconds. Programs of one `key` take the same time.

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
        leaves, tree = jax.tree.flatten(numbers)

        def picture(leaves: Any, frame: Array | None) -> Array:
            return _picture(self.scene, plan, jax.tree.unflatten(tree, leaves), frame)

        if structure not in self._known:
            self._known[structure] = jax.jit(picture, donate_argnums=1).lower(leaves, frame).compile()
        return Program(self._known[structure], leaves, (structure, plan.bounces), frame)

    def picture(self, plan: Plan) -> Picture:
        """The picture of a plan by steps that plans share: what is seen where, how its points look, both together.

        So many pictures need few programs. They differ from those of `program` by rounding alone.
        """
        numbers, dtype = self._numbers(plan), plan.dtype
        shading = plan.facets and plan.facets[1]
        shown = {name: value for name, value in self._filled(numbers).items() if name in _SHOWN}
        see = self._jit(("see", plan.facets is None, plan.window, dtype), partial(_sight, self.scene, plan))
        sight = self._once(("sight", _object(plan), plan.window, dtype), lambda: see(shown))
        points, shape = self._once(("points", plan.facets, plan.window, dtype), lambda: self._points(plan, shown, sight))
        room = None
        if self.scene.room is not None:
            given = {name: numbers[name] for name in ("room", "bounces")}
            step = self._jit(("moments", plan.bounces is None, dtype), lambda given: _moments(plan, given))
            room = self._once(("moments", plan.bounces, plan.cells, dtype, "found"), lambda: step(given))

        def look(material: Any, lights: Any, room: Any, block: Array) -> Array:
            return point_shader(plan, material, lights, room)(*map(Vector._make, block))

        def in_blocks(step: Any, blocks: list[np.ndarray], shape: tuple[int, ...], *given: Any) -> np.ndarray:
            found = np.concatenate([step(*given, block) for block in blocks], axis=1)
            return found[:, : math.prod(shape)].reshape(3, *shape)

        def colours(lights: Any, room: Any, *where: Any) -> np.ndarray:
            def part(*given: Any) -> np.ndarray:
                key = ("look", jax.tree.structure(given), dtype, plan.quadrature, plan.table)
                return in_blocks(self._jit(key, look), *where, *given)

            material = numbers["material"]
            if not isinstance(material, Surface):
                return part(material, lights, room)
            # What each light brings to each term adds up: a program for each kind of both does for all of them.
            terms = [(Surface(term, allow_unvalidated=True), term.matt) for term in material.terms]
            pairs = [
                (one, (light,), None) for one, matt in terms for light in lights
                if matt or not isinstance(light, _MATT_ONLY)
            ]  # fmt: skip
            rest = [(one, (), room) for one, matt in terms if matt and room is not None]
            return sum((part(*pair) for pair in [*pairs, *rest]), np.zeros((3, *where[1]), dtype))

        coarse, fine = split(plan, numbers["lights"], room is not None)
        colour: Any = 0 if plan.grid and not fine else colours(fine, None if plan.grid else room, points, shape)
        if count := plan.grid:
            held = self._jit(("grid", count, dtype), lambda shown: Grid.of(shown, count).places())
            where = self._once(("held", count, dtype), lambda: self._blocks(held(shown)))

            def between(shown: Any, held: Any, block: Array) -> Array:
                return Grid.of(shown, count).between(held, Vector(*block[1]))

            step = self._jit(("between", count, dtype), between)
            colour = colour + in_blocks(step, points, shape, shown, colours(coarse, room, *where))

        def show(shown: Any, sight: Any, colours: Array) -> Array:
            return _drawn(self.scene, plan, shown, sight, lambda *_: colours)

        image = self._jit(("show", shading, plan.window, dtype), show)(shown, sight, colour)
        covered = np.zeros(self.scene.picture.size, bool)
        covered[_part(plan)] = sight[0] if plan.facets is None else sight[0].covered
        return Picture(np.asarray(image), covered)

    def _points(self, plan: Plan, shown: Any, sight: Any) -> tuple[list[np.ndarray], tuple[int, ...]]:
        """What is shaded, as `_blocks` has it."""
        key = ("places", plan.facets and plan.facets[1], plan.window, plan.dtype)
        return self._blocks(self._jit(key, partial(_place, self.scene, plan))(shown, sight))

    def _blocks(self, place: Any) -> tuple[list[np.ndarray], tuple[int, ...]]:
        """Points, normals and views, shape (3, 3, points), in blocks of one size; the shape of their fields."""
        fields = np.stack(np.broadcast_arrays(*_fields(place)))
        rows, size = fields.reshape(9, -1), min(BLOCK, math.prod(self.scene.picture.size))
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

    def _jit(self, key: Any, function: Callable[..., Any]) -> Any:
        return self._once(key, lambda: jax.jit(function))

    def seeing(self, plan: Plan) -> tuple[float, int]:
        """The work of finding what is seen where, and how many points are shaded. By facets and precision alone."""
        found, _ = self._seen(plan)
        numbers = self._numbers(replace(plan, dtype="float64"))
        sight, loops = partial(_sight, self.scene, plan), _loops(self.scene, numbers)
        work = self._work(("finding", _object(plan), plan.window), plan.dtype, sight, numbers, loops=loops)
        black = partial(_drawn, self.scene, plan, shader=_black)
        drawing = self._work(("drawing", plan.facets, plan.window), plan.dtype, black, numbers, found)
        return work + drawing, _points(self.scene, plan)

    def _seen(self, plan: Plan) -> tuple[Any, Any]:
        """The shapes of what is seen where, and of the points, normals and views that are shaded."""
        numbers = self._numbers(replace(plan, dtype="float64"))
        sight, place = partial(_sight, self.scene, plan), partial(_place, self.scene, plan)
        found = self._once(("shapes", _object(plan), plan.window), lambda: jax.eval_shape(sight, numbers))
        return found, self._once(("place", plan.facets, plan.window), lambda: jax.eval_shape(place, numbers, found))

    def _work(self, key: Any, dtype: str, function: Any, *arguments: Any, loops: tuple[float, ...] = ()) -> float:
        """The work of a function of numbers in float64 if it is computed in `dtype`, traced once for all of them."""
        program = self._once(("traced", *key), lambda: program_of(function, *arguments))
        return self._once(("work", *key, dtype), lambda: work_of(program, loops, jnp.dtype(dtype).itemsize))

    def shading(self, plan: Plan) -> float:
        """The work at one point that is seen. By materials, lights, the rule for the albedo, and precision alone."""
        _, fine = split(plan, plan.lights, self.scene.room is not None)
        work = self._lit(plan, fine, self.scene.room is not None and plan.grid is None)
        return work if plan.grid is None else work + self._grid(plan, plan.grid)[1]

    def grid(self, plan: Plan) -> float:
        """The work of all points of a grid, 0 where there is none."""
        if (count := plan.grid) is None:
            return 0.0
        coarse, _ = split(plan, plan.lights, self.scene.room is not None)
        return self._grid(plan, count)[0] + count**2 * self._lit(plan, coarse, self.scene.room is not None)

    def _grid(self, plan: Plan, count: int) -> tuple[float, float]:
        """The work of laying a grid out, and of a pixel between its points."""

        def between(sphere: Any, place: Any) -> Array:
            return Grid.of(sphere, count).between(jnp.zeros((3, count, count)), Vector(*place[1]))

        def both() -> tuple[float, float]:
            exact, numbers, place = self._everywhere(plan)
            sphere = {name: numbers[name] for name in _SPHERE}
            laid = self._work(("grid", count), plan.dtype, lambda sphere: Grid.of(sphere, count).places(), sphere)
            return laid, self._work(("between", count), plan.dtype, between, sphere, place) / _points(self.scene, exact)

        return self._once(("grid works", count, plan.dtype), both)

    def _everywhere(self, plan: Plan) -> tuple[Plan, Any, Any]:
        """Whatever of the scene is seen, shaded in every pixel: the same plan, numbers and places whatever is asked first."""
        exact = replace(plan, facets=None if plan.facets is None else (None, "phong"), dtype="float64", window=None, grid=None)
        return exact, self._numbers(exact), self._seen(exact)[1]

    def _lit(self, plan: Plan, some: Sequence[Any], room: bool) -> float:
        """The work at one point, of some of the plan's lights: the same whatever their numbers are, and the grid."""
        shapes = [(jax.tree.structure(light), str(jax.tree.map(jnp.shape, light))) for light in some]
        key = ("lit", jax.tree.structure(plan.material), *shapes, room, plan.quadrature, plan.table, plan.dtype)
        return self._once(key, lambda: self._lit_anew(plan, some, room))

    def _lit_anew(self, plan: Plan, some: Sequence[Any], room: bool) -> float:
        exact, numbers, place = self._everywhere(replace(plan, lights=tuple(some)))
        material, moments = numbers["material"], jnp.ones(10) if room else None

        def work(lights: tuple[Any, ...]) -> float:
            parts = {"material": material, "lights": lights}
            key = ("shading", jax.tree.structure(parts), room, plan.quadrature, plan.table)
            shader = lambda parts, place: point_shader(exact, parts["material"], parts["lights"], moments)(*place)  # noqa: E731
            return self._work(key, plan.dtype, shader, parts, place) / _points(self.scene, exact)

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
        return self._work(key, plan.dtype, partial(at_middle, bounces=plan.bounces), numbers)

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
    return seen, (1 + side / WINDOW) ** 2


_icosphere = cache(icosphere)


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
        return numbers | {"center": jnp.asarray(picture.center, float), "radius": jnp.asarray(picture.radius, float)}
    mesh = _mesh(scene, plan)
    return numbers | {"vertices": mesh.vertices, "faces": mesh.faces}


def _picture(scene: Scene, plan: Plan, numbers: Mapping[str, Any], frame: Array | None) -> Array:
    moments = None if scene.room is None else _moments(plan, numbers)
    return _drawn(scene, plan, numbers, _sight(scene, plan, numbers), shader_of(plan, numbers, moments), frame)


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
