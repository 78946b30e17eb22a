"""Ray tracing of spheres and planes: mirrors, glass, bodies that one sees through, shadows.

Every hit sends a ray to where its mirror image is and one through the boundary, so that rays make a binary tree. All pixels
of a block walk through that tree in step, depth first: the state is one pending pair of rays for each level, whatever the
depth, and a branch that no pixel of the block takes is skipped. A scene without glass has no second branch and one without
mirrors no tree at all: what it lacks is not compiled.

A ray knows on which object it starts. Where it meets that object again then follows without a tolerance: a plane never, a
sphere on the other end of the chord.
"""

from __future__ import annotations

import abc
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.brdf.base import of_type
from brdfcheck.brdf.transmission import AbstractSmooth, SmoothDielectric
from brdfcheck.geometry import reflected, refracted
from brdfcheck.scene.artistic import Translucent
from brdfcheck.scene.cameras import AbstractCamera, Size, checked_size
from brdfcheck.scene.lights import AbstractLight, AbstractRayLight
from brdfcheck.scene.shading import AbstractMaterial, shade
from brdfcheck.scene.sphere import refuse_inside, sphere_image
from brdfcheck.scene.vectors import Vector, color_of, integer, scalar, unit, vector_of

# Pixels that walk through the tree together: few enough that a block of sky ends at once, enough to keep the loops wide.
_BLOCK = 8192
# Of a tree with two branches 2^(depth + 1) - 1 nodes are visited, or skipped, which is not free.
_DEEPEST = 9

Field = Float[Array, "3 pixels"]


def _share(name: str) -> Callable[[Any], Array | None]:
    return lambda part: None if part is None else color_of(part, name, 1)


class AbstractBody(eqx.Module):
    """A shape with a material and what it does to rays: `mirror` and `transparency` are shares of the light, RGB in [0, 1].

    The rest, 1 - mirror - transparency, is shaded with the material. Of the transparent share the exact Fresnel reflectance
    goes to the mirror image and what remains through the boundary, into the index of refraction `index` on the inner side
    (below a plane) from 1 on the outer. None: the body does not have it; without a material the rest is black. A material's
    own `glass` is followed in the same way. The lower side of a BSDF is the inner one.
    """

    mirror: Float[Array, " 3"] | None = eqx.field(converter=_share("mirror"), default=None, kw_only=True)
    transparency: Float[Array, " 3"] | None = eqx.field(converter=_share("transparency"), default=None, kw_only=True)
    index: Float[Array, ""] = eqx.field(
        converter=functools.partial(scalar, name="index", above=True), default=1.5, kw_only=True
    )

    def __check_init__(self) -> None:
        material, parts = self.material, (self.mirror, self.transparency)
        if not (material is None or isinstance(material, AbstractMaterial)):
            raise TypeError(f"a material of brdfcheck.scene.materials is needed; got {type(material).__name__}")
        if not any(isinstance(part, Tracer) for part in parts):
            shares = np.stack([np.zeros(3) if part is None else np.asarray(part, float) for part in parts])
            worst = int(np.argmax(np.sum(shares, axis=0)))
            if np.sum(shares[:, worst]) > 1 + 1e-6:
                given = " and ".join(f"{share:.6g}" for share in shares[:, worst])
                raise ValueError(f"mirror and transparency must add up to at most 1; got {given}")
        if self.transparency is not None and isinstance(material, Translucent):
            raise ValueError("a Translucent material lets light through by its own equation; leave transparency out")
        if self.transparency is not None and material is not None and material.glass is not None:
            raise ValueError("the material has a smooth term that light goes through; leave transparency out")

    @property
    @abc.abstractmethod
    def material(self) -> AbstractMaterial | None:
        """What is shaded of it."""

    @abc.abstractmethod
    def distance(self, origin: Field, travel: Field, starts: Array) -> Float[Array, " pixels"]:
        """How far the ray goes until it meets the body; inf where it does not. `starts`: True where it starts on the body."""

    @abc.abstractmethod
    def normal(self, point: Field) -> Field:
        """The outward unit normal at points of the body."""

    @abc.abstractmethod
    def anywhere(self) -> Float[Array, " 3"]:
        """Some point of the body."""

    @property
    def seen_through(self) -> bool:
        """True where the ray goes straight on through the material, equation (8), and its far side is not seen."""
        return isinstance(self.material, Translucent)

    @property
    def own(self) -> Array:
        """The share of the light that the material has, shape (3,)."""
        parts = (part for part in (self.mirror, self.transparency) if part is not None)
        return jnp.ones_like(self.anywhere()) - sum(parts)

    @property
    def glass(self) -> tuple[Array, AbstractSmooth] | None:
        """The share, RGB, of the light that meets a smooth surface which reflects and refracts it, and that surface."""
        if self.transparency is not None:
            return self.transparency, SmoothDielectric(self.index)
        glass = None if self.material is None else self.material.glass
        return glass and (self.own * glass[0], glass[1])


@final
class Sphere(AbstractBody):
    """A sphere. ValueError unless the numbers are finite, radius and index > 0 and the shares add up to at most 1."""

    center: Float[Array, " 3"] = eqx.field(converter=functools.partial(vector_of, name="center", zero=True))
    radius: Float[Array, ""] = eqx.field(converter=functools.partial(scalar, name="radius", above=True))
    material: AbstractMaterial | None = None

    def distance(self, origin: Field, travel: Field, starts: Array) -> Float[Array, " pixels"]:
        way = origin - self.center[:, None]
        along = jnp.sum(way * travel, axis=0)
        # By the distance of the ray's line from the centre: r^2 - |way|^2 + along^2 would cancel far away.
        across = way - along * travel
        square = self.radius**2 - jnp.sum(across * across, axis=0)
        half = jnp.sqrt(jnp.where(square > 0, square, 1))
        near, far = -along - half, -along + half
        found = jnp.where(near > 0, near, jnp.where(far > 0, far, jnp.inf))
        elsewhere = jnp.where(square > 0, found, jnp.inf)
        return jnp.where(starts, jnp.where(along < 0, -2 * along, jnp.inf), elsewhere)

    def normal(self, point: Field) -> Field:
        return (point - self.center[:, None]) / self.radius

    def anywhere(self) -> Float[Array, " 3"]:
        return self.center + self.radius * jnp.asarray([0, 0, 1], self.center.dtype)


@final
class Plane(AbstractBody):
    """The plane through `point` with the outward `normal_direction`, of any length. ValueError as for `Sphere`."""

    point: Float[Array, " 3"] = eqx.field(converter=functools.partial(vector_of, name="point", zero=True))
    normal_direction: Float[Array, " 3"] = eqx.field(converter=functools.partial(vector_of, name="normal_direction"))
    material: AbstractMaterial | None = None

    def _unit(self) -> Array:
        return jnp.stack(unit(self.normal_direction))

    def distance(self, origin: Field, travel: Field, starts: Array) -> Float[Array, " pixels"]:
        normal = self._unit()[:, None]
        towards = jnp.sum(travel * normal, axis=0)
        height = jnp.sum((self.point[:, None] - origin) * normal, axis=0)
        found = height / jnp.where(towards != 0, towards, 1)
        return jnp.where(~starts & (towards != 0) & (found > 0), found, jnp.inf)

    def normal(self, point: Field) -> Field:
        return jnp.broadcast_to(self._unit()[:, None], point.shape)

    def anywhere(self) -> Float[Array, " 3"]:
        return self.point


class _Ray(NamedTuple):
    """Rays of the pixels of a block: from where, whereto, what their colour counts for, on which body they start."""

    origin: Field
    travel: Field
    weight: Field
    body: Array


@final
class _Shadowed(AbstractRayLight):
    """A light of which a share arrives."""

    light: AbstractRayLight
    share: Float[Array, " pixels"]

    @property
    def intensity(self) -> Float[Array, " 3"]:
        return self.light.intensity

    def arriving(self, point: Vector) -> tuple[Vector, Float[Array, "..."]]:
        direction, falloff = self.light.arriving(point)
        return direction, falloff * self.share


def _first(bodies: Sequence[AbstractBody], ray: _Ray) -> tuple[Array, Array]:
    """(distance, number of the body) of what each ray meets first; (inf, -1) for nothing."""
    nearest, number = jnp.full_like(ray.origin[0], jnp.inf), jnp.full_like(ray.body, -1)
    for k, body in enumerate(bodies):
        distance = body.distance(ray.origin, ray.travel, ray.body == k)
        if body.seen_through:
            # It is entered, not left: from within, equation (8) has been applied already.
            at = ray.origin + jnp.where(distance < jnp.inf, distance, 0) * ray.travel
            distance = jnp.where(jnp.sum(body.normal(at) * ray.travel, axis=0) > 0, jnp.inf, distance)
        closer = distance < nearest
        nearest, number = jnp.where(closer, distance, nearest), jnp.where(closer, k, number)
    return nearest, number


def _lit(bodies: Sequence[AbstractBody], light: AbstractLight, point: Field, k: int) -> AbstractLight:
    """The light as it arrives at points of body k past all bodies, straight; what is transparent takes its share only."""
    if not isinstance(light, AbstractRayLight):
        return light
    towards, _ = light.arriving(Vector(*point))
    direction = jnp.stack([jnp.broadcast_to(part, point[0].shape) for part in towards])
    position = getattr(light, "position", None)
    reach = jnp.inf if position is None else jnp.sqrt(jnp.sum((position[:, None] - point) ** 2, axis=0))
    share = jnp.ones_like(point[0])
    for j, body in enumerate(bodies):
        distance = body.distance(point, direction, jnp.full(point[0].shape, j == k))
        blocked = distance < reach
        passing: Any = 0.0 if body.transparency is None else jnp.mean(body.transparency)
        if body.material is not None and body.material.glass is not None and body.glass is not None:
            share_of, surface = body.glass
            met = jnp.sum(body.normal(point + jnp.where(blocked, distance, 0) * direction) * direction, axis=0)
            passing = jnp.mean(share_of) * surface.weights(jnp.clip(jnp.abs(met), 0, 1), met > 0)[1]
        if isinstance(body.material, Translucent):
            passing = 1 - body.material.t_h
        share = share * jnp.where(blocked, passing, 1)
    return _Shadowed(light, share)


def _branches(bodies: Sequence[AbstractBody]) -> tuple[bool, bool]:
    """Whether a body of the scene sends rays to mirror images, and whether one sends them through."""
    through = any(body.seen_through or body.glass is not None for body in bodies)
    return any(body.mirror is not None or body.glass is not None for body in bodies), through


def _meet(
    bodies: Sequence[AbstractBody], lights: Sequence[AbstractLight], background: Array, ray: _Ray, shadows: bool
) -> tuple[Field, tuple[_Ray, ...]]:
    """What the rays add to their pixels, and the rays that go on: to the mirror image, and through the boundary."""
    alive = jnp.any(ray.weight > 0, axis=0)
    distance, number = _first(bodies, ray)
    hit = alive & (number >= 0)
    point = ray.origin + jnp.where(hit, distance, 0) * ray.travel
    nothing = jnp.zeros_like(point)
    color = jnp.where(hit, nothing, background)
    mirrored = through = _Ray(point, ray.travel, nothing, number)
    for k, body in enumerate(bodies):
        here = hit & (number == k)
        # Where the body is not, anything of length 1: what is computed in vain must not spoil a gradient.
        outward = jnp.where(here, body.normal(point), -ray.travel)
        inside = jnp.sum(outward * ray.travel, axis=0) > 0
        facing = jnp.where(inside, -outward, outward)
        matter, own, glass = body.material and body.material.matter, body.own[:, None], body.glass
        if matter is not None:
            place = jnp.where(here, point, body.anywhere()[:, None])

            def shaded(
                matter: Any = matter, k: int = k, place: Field = place, facing: Field = facing, inside: Array = inside
            ) -> tuple[Field, Field]:
                arriving = [_lit(bodies, light, place, k) for light in lights] if shadows else lights
                if not isinstance(matter, Translucent):
                    return shade(matter, arriving, place, facing, -ray.travel, inside), nothing
                # Equation (8) is linear in what lies behind: its value over black, and what white behind adds to it.
                over = [shade(matter.over(behind), arriving, place, facing, -ray.travel) for behind in (0.0, 1.0)]
                return over[0], over[1] - over[0]

            value, behind = jax.lax.cond(jnp.any(here), shaded, lambda: (nothing, nothing))
            color = color + jnp.where(here, own * value, 0)
            if body.seen_through:
                through = through._replace(weight=jnp.where(here, ray.weight * own * behind, through.weight))
        share = nothing if body.mirror is None else nothing + body.mirror[:, None]
        if glass is not None:
            tint, surface = glass[0][:, None], glass[1]
            reflectance, passing = surface.weights(-jnp.sum(facing * ray.travel, axis=0), inside)
            onward, passes = refracted(ray.travel, facing, jnp.where(inside, surface.eta, 1 / surface.eta), axis=0)
            share = share + tint * reflectance
            passed = ray.weight * tint * jnp.where(passes, passing, 0)
            through = through._replace(
                travel=jnp.where(here, onward, through.travel), weight=jnp.where(here, passed, through.weight)
            )
        if body.mirror is not None or glass is not None:
            mirrored = mirrored._replace(
                travel=jnp.where(here, reflected(ray.travel, facing, axis=0), mirrored.travel),
                weight=jnp.where(here, ray.weight * share, mirrored.weight),
            )
    return ray.weight * color, tuple(part for part, used in zip((mirrored, through), _branches(bodies), strict=True) if used)


def _tree(depth: int, branches: int) -> np.ndarray:
    """(level, branch) of all nodes of the tree, depth first; the ray from the eye is (0, 0)."""
    rows = [(0, 0)]

    def visit(level: int) -> None:
        for branch in range(branches if level <= depth else 0):
            rows.append((level, branch))
            visit(level + 1)

    visit(1)
    return np.array(rows, np.int32)


@eqx.filter_jit
def _trace(
    bodies: tuple[AbstractBody, ...],
    lights: tuple[AbstractLight, ...],
    camera: AbstractCamera,
    background: Array,
    least_weight: Array,
    static: tuple[Size, int, bool, Any, int],
) -> Array:
    size, depth, shadows, dtype, most = static
    bodies, lights, background, least_weight = of_type((bodies, lights, background, least_weight), dtype)
    pixels = size[0] * size[1]
    count = min(most, pixels)
    blocks = -(-pixels // count)

    def in_blocks(field: Array) -> Array:
        padded = jnp.pad(field.reshape(3, pixels), ((0, 0), (0, blocks * count - pixels)), mode="edge")
        return padded.reshape(3, blocks, count).swapaxes(0, 1)

    branches = sum(_branches(bodies))
    tree = jnp.asarray(_tree(depth, branches))

    def block(eye_rays: tuple[Array, Array]) -> Array:
        origin, travel = eye_rays
        first = _Ray(origin, travel, jnp.ones_like(origin), jnp.full(count, -1, jnp.int32))
        if not branches:
            return _meet(bodies, lights, background, first, shadows)[0]

        def visit(state: tuple[Array, _Ray], node: Array) -> tuple[tuple[Array, _Ray], None]:
            color, pending = state
            level, branch = node
            ray = jax.tree.map(lambda field: field[level, branch], pending)
            ray = ray._replace(weight=jnp.where(jnp.max(ray.weight, axis=0) > least_weight, ray.weight, 0))
            nothing = ray._replace(weight=jnp.zeros_like(ray.weight))
            more, children = jax.lax.cond(
                jnp.any(ray.weight > 0),
                lambda: _meet(bodies, lights, background, ray, shadows),
                lambda: (jnp.zeros_like(color), (nothing,) * branches),
            )
            pending = jax.tree.map(lambda field, *parts: field.at[level + 1].set(jnp.stack(parts)), pending, *children)
            return (color + more, pending), None

        # One level more than is read: the children of the last one are written there.
        pending = jax.tree.map(lambda part: jnp.zeros((depth + 2, branches, *part.shape), part.dtype).at[0, 0].set(part), first)
        return jax.lax.scan(visit, (jnp.zeros_like(origin), pending), tree)[0][0]

    image = jax.lax.map(block, tuple(in_blocks(field) for field in camera.rays(size, dtype)))
    return image.swapaxes(0, 1).reshape(3, blocks * count)[:, :pixels].reshape(3, *size)


def trace(
    bodies: Sequence[AbstractBody],
    lights: Sequence[AbstractLight],
    camera: AbstractCamera,
    *,
    size: Size,
    depth: int = 4,
    background: Any = 0.0,
    shadows: bool = True,
    least_weight: Any = 1e-4,
    dtype: Any = jnp.float32,
) -> Float[Array, "3 height width"]:
    """Linear image of shape (3, height, width): rays from the eye, followed over at most `depth` mirrors and boundaries.

    `bodies`: of `Sphere` and `Plane`; `lights` and `camera`: of `brdfcheck.scene`; `size`: pixels (height, width); `dtype`: in
    which it is computed.
    What rays would bring after `depth` of them counts as black, and a ray whose share of the pixel is at most `least_weight`
    is not followed. Rays that leave the scene bring `background`, a number or RGB. With `shadows`, the light of Distant,
    Point and Spot lights is stopped by bodies; transparent ones pass their share of it, straight. Numbers are traced: another
    depth is another program, another index of refraction is not. jit and both modes of differentiation go through it.

    Bodies must not overlap. Raises ValueError where the camera is inside a sphere, for no body at all, a depth that is no
    integer from 0 to 9, or bad values; TypeError for something that is no body or no light.
    """
    if not bodies or not all(isinstance(body, AbstractBody) for body in bodies):
        raise TypeError(f"a scene is made of Sphere and Plane; got {', '.join(type(b).__name__ for b in bodies) or 'nothing'}")
    if not all(isinstance(light, AbstractLight) for light in lights):
        raise TypeError(f"lights are those of brdfcheck.scene.lights; got {', '.join(type(x).__name__ for x in lights)}")
    depth = integer(depth, "depth", 0, _DEEPEST)
    for number, body in enumerate(bodies):
        if isinstance(body, Sphere):
            refuse_inside(camera.eye, body.center, body.radius, f"sphere {number}")
    static = (checked_size(size), depth, bool(shadows), jnp.dtype(dtype), _BLOCK)
    share = scalar(least_weight, "least_weight")
    return _trace(tuple(bodies), tuple(lights), camera, color_of(background, "background")[:, None], share, static)


def composed(
    spheres: Sequence[Sphere],
    lights: Sequence[AbstractLight],
    camera: AbstractCamera,
    *,
    size: Size,
    background: Any = 0.0,
    dtype: Any = jnp.float32,
) -> Float[Array, "3 height width"]:
    """The spheres painted over one another from the farthest to the nearest, translucent ones by equation (8): no rays.

    What `trace` computes of the same spheres without mirrors, glass and shadows. ValueError for a sphere with one of these
    or without a material, and as for `sphere_image`.
    """
    for number, sphere in enumerate(spheres):
        if sphere.material is None or sphere.mirror is not None or sphere.transparency is not None:
            raise ValueError(f"sphere {number} must have a material and neither mirror nor transparency to be painted")
    depths = [float(camera.in_frame(sphere.center[:, None])[0][2, 0]) for sphere in spheres]
    image = jnp.broadcast_to(color_of(background, "background")[:, None, None], (3, *checked_size(size))).astype(dtype)
    for _, sphere in sorted(zip(depths, spheres, strict=True), key=lambda pair: -pair[0]):
        material = sphere.material
        if isinstance(material, Translucent):
            material = material.over(image)
        if material is not None:
            place = {"center": sphere.center, "radius": sphere.radius}
            image = sphere_image(material, lights, camera, size=size, background=image, dtype=dtype, **place)
    return image
