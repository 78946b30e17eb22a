"""Flat, Gouraud and Phong shading of a mesh on the buffers of the rasteriser.

A shader is any ``shader(point, normal, view) -> rgb`` over component-first fields: it is called once per face (flat), per
vertex (Gouraud 1971) or per pixel (Phong 1975), which is the whole difference between the three.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.messages import one_of
from brdfcheck.scene.cameras import AbstractCamera, Size, checked_size
from brdfcheck.scene.meshes import Mesh, Weighting, face_normals, vertex_normals
from brdfcheck.scene.raster import Fragments, rasterise
from brdfcheck.scene.shading import shade
from brdfcheck.scene.vectors import backdrop_of, checked, unit

Shader = Callable[[Array, Array, Array], Array]
Image = Float[Array, "3 height width"]


def flat(mesh: Mesh, camera: AbstractCamera, fragments: Fragments, normals: Array, shader: Shader) -> Image:
    """One colour for each face, shaded at its centre with its own normal; `normals` are not used."""
    centres = jnp.mean(mesh.vertices[mesh.faces], axis=1).T
    return fragments.of_face(shader(centres, face_normals(mesh).T, camera.view(centres)))


def gouraud(mesh: Mesh, camera: AbstractCamera, fragments: Fragments, normals: Array, shader: Shader) -> Image:
    """Colours at the vertices, interpolated. `normals`: unit, shape (vertices, 3)."""
    points = mesh.vertices.T
    return fragments.interpolate(mesh.faces, shader(points, normals.T, camera.view(points)))


def phong(mesh: Mesh, camera: AbstractCamera, fragments: Fragments, normals: Array, shader: Shader) -> Image:
    """Normals at the vertices, interpolated, made unit again and shaded in each pixel. `normals`: unit, shape (vertices, 3)."""
    points = fragments.interpolate(mesh.faces, mesh.vertices.T)
    return shader(points, jnp.stack(unit(fragments.interpolate(mesh.faces, normals.T))), camera.view(points))


SHADINGS: Mapping[str, Callable[[Mesh, AbstractCamera, Fragments, Array, Shader], Array]] = MappingProxyType(
    {"flat": flat, "gouraud": gouraud, "phong": phong}
)


def shadings_of(
    mesh: Mesh,
    camera: AbstractCamera,
    shader: Shader,
    shadings: Sequence[str],
    *,
    size: Size,
    weighting: Weighting = "unit",
    normals: Float[Array, "vertices 3"] | None = None,
    background: Any = 0.0,
    interpolation: str = "area",
    cull: bool = True,
) -> list[Image]:
    """Linear images (3, height, width), one for each of some of `SHADINGS`: the mesh under `shader`, before `background`.

    What is seen in a pixel is settled once for all. `background` is a number, a colour or an image; `normals`, unit vectors at
    the vertices, stand in for those of `vertex_normals`. For use under jit. ValueError for an unknown shading, and as for
    `rasterise` and `vertex_normals`.
    """
    for shading in shadings:
        one_of(shading, SHADINGS, "shading")
    if normals is None:
        normals = vertex_normals(mesh, weighting)
    fragments = rasterise(mesh, camera, size, cull=cull, interpolation=interpolation)
    images = [SHADINGS[shading](mesh, camera, fragments, normals, shader) for shading in shadings]
    behind = jnp.asarray(background, images[0].dtype)
    return [jnp.where(fragments.covered, image, behind if behind.ndim != 1 else behind[:, None, None]) for image in images]


@eqx.filter_jit
def _render(
    mesh: Mesh, camera: AbstractCamera, material: Any, lights: Any, background: Any, options: dict[str, Any]
) -> list[Image]:
    def shader(point: Array, normal: Array, view: Array) -> Array:
        return shade(material, lights, point, normal, view)

    return shadings_of(mesh, camera, shader, background=background, **options)


def _checked_normals(normals: Any, mesh: Mesh) -> Array:
    shape = mesh.vertices.shape
    array = checked(normals, "normals", -np.inf, shapes=[shape], what=f"unit vectors, of shape {shape} as the vertices")
    if not isinstance(array, Tracer):
        length = np.linalg.norm(np.asarray(array, float), axis=1)
        wrong = np.flatnonzero(~(np.abs(length - 1) <= 1e-3))
        if wrong.size:
            raise ValueError(f"normals must be unit vectors; that of vertex {wrong[0]} has the length {length[wrong[0]]:.6g}")
    return array


@eqx.filter_jit
def _in_front(mesh: Mesh, camera: AbstractCamera) -> Array:
    return camera.project(mesh.vertices.T, (1, 1)).in_front


def refuse_behind(mesh: Mesh, camera: AbstractCamera) -> None:
    """ValueError where part of a mesh lies behind the eye."""
    in_front = _in_front(mesh, camera)
    if not isinstance(in_front, Tracer):
        behind = ~np.asarray(in_front)
        if np.any(behind):
            where = "turned away from the mesh" if np.all(behind) else "inside the mesh or beyond it"
            raise ValueError(
                f"the camera at {np.asarray(camera.eye).tolist()} is {where}: "
                f"{int(behind.sum())} of {behind.size} vertices are behind it"
            )


def render_shadings(
    mesh: Mesh,
    camera: AbstractCamera,
    material: Any,
    lights: Any,
    shadings: Sequence[str] = tuple(SHADINGS),
    *,
    size: Size,
    background: Any = 0.0,
    **options: Any,
) -> list[Image]:
    """`shadings_of` with a material under lights, compiled as one program: numbers are traced, options are not.

    Raises ValueError besides where part of the mesh lies behind the eye: the camera is inside it, or past it; for a
    background that is negative or not finite; for `normals` that are not one unit vector for each vertex.
    """
    size = checked_size(size)
    background = backdrop_of(background, size)
    if options.get("normals") is not None:
        options["normals"] = _checked_normals(options["normals"], mesh)
    refuse_behind(mesh, camera)
    return _render(
        mesh, camera, material, lights, jnp.asarray(background), {"shadings": tuple(shadings), "size": size, **options}
    )


def render_mesh(
    mesh: Mesh, camera: AbstractCamera, material: Any, lights: Any, *, size: Size, shading: str = "phong", **options: Any
) -> Image:
    """`render_shadings` with one shading; ValueError as there."""
    return render_shadings(mesh, camera, material, lights, (shading,), size=size, **options)[0]
