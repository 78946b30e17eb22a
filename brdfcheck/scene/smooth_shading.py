"""What smooth shading loses, in pictures: highlights, silhouettes, slopes, folds, and how a square is turned."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.scene import failures, meshes
from brdfcheck.scene.cameras import Orthographic
from brdfcheck.scene.canvas import GROUND, Canvas, Image, color_scale, colored, curve, matt_and_glossy, stacked
from brdfcheck.scene.images import contact_sheet
from brdfcheck.scene.lights import Ambient, Distant
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.raster import area_weights, interpolated, scan_line_weights

_LEVELS = (0, 1, 2, 3)


def _single(mesh_level: int) -> meshes.Mesh:
    return meshes.icosphere(mesh_level, jnp.float32)


def _faces(level: int) -> str:
    return f"{20 * 4**level} faces"


def worst_facet(mesh: meshes.Mesh) -> Float[np.ndarray, " 3"]:
    """The normal of the facet whose vertices are farthest from it, on a mesh of the unit sphere."""
    normals = np.asarray(meshes.face_normals(mesh), float)
    return normals[np.argmin((normals @ np.asarray(mesh.vertices, float).T).max(axis=1))]


def towards_facet(mesh: meshes.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors to the eye and to a light, 20 degrees to either side of the worst facet: its normal is their half vector."""
    axis = worst_facet(mesh)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side *= np.tan(np.radians(20)) / np.linalg.norm(side)
    return tuple((axis + sign * side) / np.linalg.norm(axis + side) for sign in (1, -1))  # pyright: ignore[reportReturnType]


def gouraud_phong(canvas: Canvas) -> Image:
    """Flat, Gouraud and Phong shading of finer and finer spheres, turned so that a highlight is on a facet."""
    n, shadings = 100.0, ("flat", "gouraud", "phong")
    material = matt_and_glossy((0.5, 0.12, 0.08), 0.08, n)
    columns, pictures = [], []
    for level in _LEVELS:
        mesh = _single(level)
        view, light = towards_facet(mesh)
        camera, lights = Orthographic(5 * view, up=np.cross(view, light)), [Distant(light, 0.7 * np.pi)]
        pictures.append(canvas.meshes(mesh, camera, material, lights, shadings, background=0.02))
        pictures[-1].append(canvas.sphere(material, lights, camera, background=0.02))
        reach = np.degrees(float(failures.facet_circumradius(mesh)))
        columns.append(f"{_faces(level)}, {reach:.1f}°\nleft: {float(failures.lost_highlight(mesh, n)):.1%}")
    across = f"angle from a facet's centre to its corners; what Gouraud shading leaves of a highlight there, n = {n:g}"
    return contact_sheet(list(zip(*pictures, strict=True)), columns=columns, labels=(*shadings, "exact"), across=across)


_ASIDE = np.array([0.3, 0.2, 1.0])


def silhouette_bleed(canvas: Canvas) -> Image:
    """Spheres lit from straight behind, in false colour."""
    camera, lights, shadings = Orthographic(5 * _ASIDE), [Distant(-_ASIDE, np.pi)], ("gouraud", "phong")
    white, columns, pictures = Surface(Term("lambert", 1.0)), [], []
    for level in _LEVELS[:3]:
        mesh = _single(level)
        columns.append(f"{_faces(level)}: up to {float(failures.silhouette_bleed(mesh, _ASIDE)):.2f}")
        (covered,) = canvas.meshes(mesh, camera, white, [Ambient(1.0)], ("flat",))
        images = canvas.meshes(mesh, camera, white, lights, shadings)
        pictures.append([colored(image[0], covered[0], 1e-3, 1.0) for image in images])
    covered, exact = (canvas.sphere(white, light, camera)[0] for light in ([Ambient(1.0)], lights))
    pictures.append([colored(exact, covered, 1e-3, 1.0)] * 2)
    across = "light straight from behind: none of it should be seen, all that is coloured is wrong"
    sheet = contact_sheet(list(zip(*pictures, strict=True)), columns=(*columns, "exact"), labels=shadings, across=across)
    return stacked(sheet, color_scale(sheet.shape[2], "what is reflected; white: less than 0.001", 1e-3, 1.0))


def mach_bands(canvas: Canvas) -> Image:
    """Along one line: the value and its slope under each shading."""
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


def sheets(canvas: Canvas) -> Image:
    """A zigzag and a corrugated sheet by facets and by averaged normals."""
    white = Surface(Term("lambert", 0.9))
    camera, lights = Orthographic((0.0, -2.0, 5.0), half_height=1.1), [Distant((np.sin(np.radians(25)), 0.0, 0.906), np.pi)]
    sheets = {"zigzag": meshes.zigzag(), "corrugated": meshes.corrugated()}
    columns = [
        f"{name}: {float(failures.facet_contrast(mesh)):.3f}, {float(failures.interpolated_contrast(mesh)):.3f}"
        for name, mesh in sheets.items()
    ]
    pictures = [canvas.meshes(mesh, camera, white, lights, ("flat", "gouraud"), background=0.02) for mesh in sheets.values()]
    across = "contrast of facets, of averaged normals"
    return contact_sheet(list(zip(*pictures, strict=True)), columns=columns, labels=("flat", "gouraud"), across=across)


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


def quadrilaterals(canvas: Canvas) -> Image:
    """A square turned: scan lines beside two triangles."""
    axis = (np.arange(canvas.size[0]) + 0.5) / canvas.size[0] * 2.1 - 1.05
    at, ground = jnp.stack(jnp.meshgrid(axis, -axis)), np.array(GROUND)[:, None, None]
    columns, pictures = [], []
    for degrees in (0, 15, 30, 45):
        angle = jnp.asarray(np.radians(degrees))
        inside, *ways = _turned_square(at, angle)
        # Cut: rounding goes below 0.
        pictures.append([canvas.mean(np.where(inside, np.clip(way, 0, 1), ground)) for way in ways])
        centre = failures.turned_quadrilateral(jnp.asarray(_CORNERS), jnp.asarray(_COLORS), jnp.zeros(2), angle)
        columns.append(f"{degrees} degrees: {float(centre):.2f}")
    across = "a square turned, its corners 0, 1, 0, 1: what the centre is by scan lines"
    return contact_sheet(
        list(zip(*pictures, strict=True)), columns=columns, labels=("scan lines", "two triangles"), across=across
    )
