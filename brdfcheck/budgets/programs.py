"""Compiled programs of plans: the picture, the operations it takes, and the time.

All programs of one scene are timed in one run, one after the other in each round, so that what else the machine does falls upon
all of them alike; a cost is the median over the rounds of a time over that of the dearest program in the same round.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from brdfcheck.brdf import AbstractZonalLobe
from brdfcheck.budgets.knobs import Plan, plain
from brdfcheck.budgets.scenes import Room, Scene
from brdfcheck.factors import peel
from brdfcheck.lobes import Lambert
from brdfcheck.quadrature.polar import Order
from brdfcheck.quadrature.zonal import zonal_weights
from brdfcheck.scene.lights import Ambient, Environment
from brdfcheck.scene.materials import Surface
from brdfcheck.scene.meshes import icosphere
from brdfcheck.scene.shading import shade
from brdfcheck.scene.smooth import shade_mesh
from brdfcheck.scene.sphere import seen_sphere
from brdfcheck.scene.values import dot, spread
from brdfcheck.transport import box

Image = Float[np.ndarray, "3 height width"]

_CEILING = 5
# A transcendental function is worth about so many additions, a window of the rasteriser as many.
_TRANSCENDENTAL, _WINDOW = 8, 16 * 16 * 20
# Pixels whose albedo is integrated at once.
_BLOCK = 2**14
# Seconds that all programs are timed for, about, and the fewest and most rounds.
_LONGEST, _FEWEST, _MOST = 2.0, 5, 101
_LEAST_NOISE = 0.15


@dataclass
class Program:
    """A compiled plan with its numbers. `work`: operations, counted in the program before it is optimised, times bytes.

    Programs of one `key` take the same time.
    """

    compiled: Any
    numbers: Any
    work: float
    key: Any

    def image(self) -> Image:
        """The picture in linear light, in the program's own precision."""
        return np.asarray(self.compiled(self.numbers))

    def covered(self) -> Bool[np.ndarray, "height width"]:
        """Where the object is seen: before a background that no colour equals."""
        behind = jnp.full_like(self.numbers["background"], -1)
        return np.asarray(self.compiled({**self.numbers, "background": behind})[0]) > -1

    def seconds(self) -> float:
        """The time of one picture."""
        began = time.perf_counter()
        self.compiled(self.numbers).block_until_ready()
        return time.perf_counter() - began


@dataclass
class Compiler:
    """Programs of the plans of one scene. What differs in numbers only is compiled once."""

    scene: Scene
    _known: dict[Any, tuple[Any, float]] = field(default_factory=dict)

    def program(self, plan: Plan) -> Program:
        """The plan, compiled. ValueError for lights and materials that do not go together."""
        dtype = jnp.dtype(plan.dtype)
        numbers = jax.tree.map(
            lambda leaf: jnp.asarray(leaf, dtype) if eqx.is_inexact_array(leaf) else leaf,
            _numbers(self.scene, plan),
        )
        every = plan.bounces is None
        structure = (jax.tree.structure(numbers), plan.dtype, plan.facets, every, plan.quadrature)
        if structure not in self._known:
            lowered = jax.jit(lambda numbers: _picture(self.scene, plan, numbers)).lower(numbers)
            analysis = lowered.cost_analysis() or {}
            work = analysis.get("flops", 0.0) + _TRANSCENDENTAL * analysis.get("transcendentals", 0.0)
            work += _WINDOW * len(numbers["faces"]) if plan.facets is not None else 0  # of loops the body is counted once
            self._known[structure] = lowered.compile(), work * dtype.itemsize
        compiled, work = self._known[structure]
        if self.scene.room is not None:
            patches = len(numbers["emission"])
            work += dtype.itemsize * (2 / 3 * patches**3 if plan.bounces is None else 2 * patches**2 * plan.bounces)
        return Program(compiled, numbers, work, (structure, plan.bounces))


def _numbers(scene: Scene, plan: Plan) -> dict[str, Any]:
    picture = scene.picture
    numbers = {"material": plain(plan.material), "lights": plan.lights, "camera": picture.camera}
    numbers["background"] = jnp.asarray(picture.background)
    if plan.facets is None:
        options = picture.options
        numbers["center"], numbers["radius"] = (
            jnp.asarray(options.get(name, default), float) for name, default in (("center", (0.0, 0.0, 0.0)), ("radius", 1.0))
        )
    else:
        mesh = picture.mesh if plan.facets[0] is None else icosphere(plan.facets[0], jnp.float32)
        assert mesh is not None
        numbers |= {"vertices": mesh.vertices, "faces": mesh.faces}
    return numbers | (_room_numbers(scene.room, plan.bounces) if scene.room is not None else {})


def _room_numbers(room: Room, bounces: int | None) -> dict[str, Any]:
    cube = box(cells=room.cells)
    return {
        "bounces": jnp.asarray(bounces or 0, jnp.int32),
        "factors": cube.form_factors,
        "emission": cube.on_wall(_CEILING, room.emission),
        "areas": cube.areas / jnp.sum(cube.areas),
        "reflectance": jnp.asarray(room.reflectance),
    }


def _picture(scene: Scene, plan: Plan, numbers: Mapping[str, Any]) -> Array:
    picture, lights = scene.picture, list(numbers["lights"])
    material, camera, background = numbers["material"], numbers["camera"], numbers["background"]
    if scene.room is not None:
        lights.append(Ambient(_ambient(numbers, plan.bounces is None)))
    surroundings = [light for light in lights if isinstance(light, Environment) and plan.quadrature is not None]
    others = [light for light in lights if not any(light is one for one in surroundings)]

    def shader(point: Any, normal: Any, view: Any) -> Array:
        color = shade(material, others, point, normal, view)
        for light in surroundings:
            color = color + _surrounded(material, light, dot(normal, view), plan.quadrature or 0)
        return color

    if plan.facets is None:
        hit, point, normal, view = seen_sphere(camera, numbers["center"], numbers["radius"], picture.size)
        return jnp.where(hit, shader(point, normal, view), spread(background, 2) if background.ndim else background)
    mesh = eqx.tree_at(
        lambda mesh: (mesh.vertices, mesh.faces),
        icosphere(0) if picture.mesh is None else picture.mesh,
        (numbers["vertices"], numbers["faces"]),
    )
    options = dict(picture.options)
    options["shading"] = plan.facets[1]
    return shade_mesh(mesh, camera, shader, size=picture.size, background=background, **options)


def _ambient(numbers: Mapping[str, Any], every: bool) -> Array:
    """The mean radiance of the walls after so many bounces, or after all of them, shape (3,)."""
    factors, emission = numbers["factors"], numbers["emission"]
    if every:
        kernel = jnp.eye(len(emission), dtype=emission.dtype) - numbers["reflectance"] * factors
        radiosity = jnp.linalg.solve(kernel, emission)
    else:

        def bounce(_: Any, radiosity: Array) -> Array:
            return emission + numbers["reflectance"] * (factors @ radiosity)

        radiosity = jax.lax.fori_loop(0, numbers["bounces"], bounce, emission)
    mean = jnp.sum(numbers["areas"] * radiosity) / jnp.asarray(np.pi, emission.dtype)
    return jnp.broadcast_to(mean, (3,))


def _surrounded(material: Surface, light: Environment, cosine: Array, nodes: int) -> Array:
    """What a surface reflects of a uniform surrounding: the albedos of its terms, by a rule in one dimension."""
    total = jnp.zeros((3,) + (1,) * cosine.ndim, cosine.dtype)
    for term in material.terms:
        core, scale = peel(term.brdf)
        if isinstance(core, Lambert):
            total = total + spread(light.intensity * term.albedo().astype(cosine.dtype), cosine.ndim)
        elif isinstance(core, AbstractZonalLobe):
            core = jax.tree.map(lambda leaf: leaf.astype(cosine.dtype) if eqx.is_inexact_array(leaf) else leaf, core)

            def albedo(mu: Array, core: AbstractZonalLobe = core) -> Array:
                order = Order(nodes, nodes)
                versines, weights = zonal_weights(core.form, mu, core.breaks(), core.width(), (order,))
                return jnp.sum(weights[0] * core.profile(versines)) * core.amplitude()

            flat = jnp.clip(cosine, 0, 1).reshape(-1)
            value = jax.lax.map(albedo, flat, batch_size=min(_BLOCK, flat.size)).reshape(cosine.shape)
            factor = jnp.asarray(scale(jnp.ones((), cosine.dtype)), cosine.dtype)
            total = total + spread(light.intensity * term.tint, cosine.ndim) * (factor * value)
    return total


@dataclass(frozen=True)
class Times:
    """Seconds of each program (median), costs over the dearest one's time, and the noise of such a cost."""

    seconds: list[float]
    costs: list[float]
    noise: float


def timed(programs: Sequence[Program], dearest: int, longest: float = _LONGEST) -> Times:
    """Time the programs round by round for about `longest` seconds; the one numbered `dearest` twice, which shows the noise.

    The noise is how far the median of the second is from the first, twice, or what its spread says, and at least 15 %: so far
    the medians of two runs of small pictures were seen apart on a shared machine.
    """
    keys = [program.key for program in programs]
    unique = sorted({keys.index(key) for key in keys})
    for i in unique:
        programs[i].seconds()
    pace = sum(programs[i].seconds() for i in unique)
    rounds = int(np.clip(longest / pace, _FEWEST, _MOST))
    table, twin = np.empty((rounds, len(programs))), np.empty(rounds)
    for r in range(rounds):
        for i in unique:
            table[r, [key == keys[i] for key in keys]] = programs[i].seconds()
        twin[r] = programs[dearest].seconds()
    reference = (table[:, dearest] + twin) / 2
    ratios = twin / table[:, dearest]
    quarters = np.quantile(ratios, (0.25, 0.75))
    noise = max(_LEAST_NOISE, 2 * abs(float(np.median(ratios)) - 1), float(quarters[1] - quarters[0]) / rounds**0.5)
    costs = np.median(table / reference[:, None], axis=0)
    costs[dearest] = 1.0
    return Times(np.median(table, axis=0).tolist(), costs.tolist(), noise)
