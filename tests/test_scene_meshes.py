"""Meshes: topology, normals, deformation, interpolation, and the failures of smooth shading by number."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy_raster import averaged_normals
from selection import few

from brdfcheck.scene import failures
from brdfcheck.scene.meshes import (
    Mesh,
    corrugated,
    face_normals,
    face_vectors,
    icosphere,
    latitude_longitude_sphere,
    vertex_normals,
    zigzag,
)
from brdfcheck.scene.raster import INTERPOLATIONS, area_weights, interpolated, oblique_weights, scan_line_weights

TETRAHEDRON = ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
CLOSED = {
    "tetrahedron": lambda: Mesh(*TETRAHEDRON),
    "icosphere 0": lambda: icosphere(0),
    "icosphere 2": lambda: icosphere(2),
    "smallest globe": lambda: latitude_longitude_sphere(2, 3),
    "globe": lambda: latitude_longitude_sphere(9, 14),
}
SHEETS = {"zigzag": lambda: zigzag(3, rows=2), "corrugated": lambda: corrugated(3, segments=5, rows=3)}


def directed_edges(mesh):
    faces = np.asarray(mesh.faces)
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_are_closed_and_face_outwards(name):
    mesh = CLOSED[name]()
    edges = directed_edges(mesh)
    # Every edge runs once in each direction: closed, and turned alike everywhere. V - E + F = 2: a sphere.
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(edge) for edge in edges} == {tuple(edge[::-1]) for edge in edges}
    assert len(mesh.vertices) - len(edges) // 2 + len(mesh.faces) == 2
    # The divergence theorem: the enclosed volume is positive, the vector areas add up to nothing.
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    assert np.linalg.det(corners).sum() > 0
    np.testing.assert_allclose(np.asarray(face_vectors(mesh)).sum(0), 0, atol=1e-13)


@pytest.mark.parametrize("name", SHEETS)
def test_sheets_have_one_border_and_look_up(name):
    mesh = SHEETS[name]()
    edges = directed_edges(mesh)
    assert len(np.unique(edges, axis=0)) == len(edges)
    border = {tuple(edge) for edge in edges} - {tuple(edge[::-1]) for edge in edges}
    assert len(mesh.vertices) - (len(edges) + len(border)) // 2 + len(mesh.faces) == 1  # a disk
    assert np.all(np.asarray(face_normals(mesh))[:, 2] > 0)
    np.testing.assert_allclose(np.asarray(face_vectors(mesh))[:, 2].sum() / 2, 4, rtol=1e-12)  # it covers [-1, 1]^2


def test_sizes_and_spheres():
    for level in range(4):
        assert icosphere(level).faces.shape == (20 * 4**level, 3)
    assert latitude_longitude_sphere(7, 11).faces.shape == (2 * 11 * 6, 3)
    for mesh in (icosphere(3), latitude_longitude_sphere(7, 11)):
        np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, rtol=1e-14)
    # The volume of inscribed polyhedra tends to the ball's like the square of the edge, a factor of 4 per level.
    missing = [
        4 / 3 * np.pi - np.linalg.det(np.asarray(m.vertices)[np.asarray(m.faces)]).sum() / 6 for m in map(icosphere, (3, 4))
    ]
    assert missing[0] / missing[1] == pytest.approx(4, rel=0.02)
    assert zigzag(3, slope=0.5, rows=2).faces.shape == (2 * 6 * 2, 3)
    slopes = np.asarray(face_normals(zigzag(3, slope=0.5, rows=2)))
    np.testing.assert_allclose(np.abs(slopes[:, 0] / slopes[:, 2]), 0.5, rtol=1e-12)
    steepest = np.asarray(face_normals(corrugated(2, slope=0.5, segments=64)))
    # The chord of a sine over 1/64 of its wave, from where it is steepest.
    assert np.abs(steepest[:, 0] / steepest[:, 2]).max() == pytest.approx(0.5 * np.sin(np.pi / 32) / (np.pi / 32), rel=1e-12)


# Few faces, poles with thin ones, and a border.
@pytest.mark.parametrize("weighting", ["unit", "area"])
@pytest.mark.parametrize("name", few([*CLOSED, *SHEETS], ("tetrahedron", "smallest globe", "zigzag")))
def test_vertex_normals_are_those_of_a_plain_loop(name, weighting):
    mesh = {**CLOSED, **SHEETS}[name]()
    expected = averaged_normals(np.asarray(mesh.vertices), np.asarray(mesh.faces), by_area=weighting == "area")
    np.testing.assert_allclose(vertex_normals(mesh, weighting), expected, atol=1e-14)


def test_deformation_keeps_the_topology_and_recomputes_normals():
    sphere = icosphere(2)
    stretch = np.array([2.0, 1.0, 0.5])
    ellipsoid = Mesh(sphere.vertices * stretch, sphere.faces)
    np.testing.assert_array_equal(ellipsoid.faces, sphere.faces)
    expected = averaged_normals(np.asarray(sphere.vertices) * stretch, np.asarray(sphere.faces), by_area=False)
    np.testing.assert_allclose(vertex_normals(ellipsoid), expected, atol=1e-14)
    # They point along the ellipsoid's gradient x / a^2, not along the sphere's.
    gradient = np.asarray(sphere.vertices) / stretch
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    assert np.sum(vertex_normals(ellipsoid) * gradient, axis=1).min() > 0.98
    assert np.sum(vertex_normals(sphere) * gradient, axis=1).min() < 0.9
    # Turning the mesh turns the normals.
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])
    turned = vertex_normals(Mesh(ellipsoid.vertices @ turn.T, ellipsoid.faces))
    np.testing.assert_allclose(turned, expected @ turn.T, atol=1e-14)


@pytest.mark.parametrize("weighting", few(["unit", "area"], ("area",)))
def test_gradients_of_normals(weighting):
    mesh, direction = corrugated(2, segments=4, rows=1), np.random.default_rng(1).normal(size=(18, 3))

    @jax.jit
    def height(vertices):
        return jnp.sum(jnp.sin(3 * vertex_normals(Mesh(vertices, mesh.faces), weighting)))

    along = np.sum(jax.grad(height)(mesh.vertices) * direction)
    step = 1e-6
    central = (height(mesh.vertices + step * direction) - height(mesh.vertices - step * direction)) / (2 * step)
    assert along == pytest.approx(float(central), rel=1e-7)


GOOD = [[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0, 0], [1, 0, 0], [np.nan, 1, 0]], [[0, 1, 2]], "vertices must be finite; got .* in row 2"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], "vertices must be finite; got .* in row 2"),
        (GOOD, [[0, 1, 3]], "vertices 0 to 2; face 0"),
        (GOOD, [[0, 1, 2], [0, -1, 2]], "vertices 0 to 2; face 1"),
        (GOOD, [[0, 1, 1]], "must have an area; face 0"),
        ([[0, 0, 0], [1, 1, 1], [3, 3, 3]], [[0, 1, 2]], "must have an area; face 0"),
        ([[1, 2, 3], [1.1, 2.2, 3.3], [1.3, 2.6, 3.9]], [[0, 1, 2]], "must have an area; face 0"),
        ([*GOOD, [5, 5, 5]], [[0, 1, 2]], "vertex 3 belongs to none"),
        (GOOD, [[0.0, 1.0, 2.0]], "integers"),
        (GOOD, [[0, 1, 2, 0]], "rows of three"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], "rows of three"),
        (np.zeros((0, 3)), np.zeros((0, 3), int), "rows of three"),
    ],
)
def test_bad_meshes_are_refused(vertices, faces, message):
    with pytest.raises(ValueError, match=message):
        Mesh(vertices, faces)


def test_small_and_needle_triangles_are_not_degenerate():
    Mesh(np.array(GOOD) * 1e-12, [[0, 1, 2]])
    Mesh([[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]], [[0, 1, 2]])
    with pytest.raises(ValueError, match="must have an area"):
        Mesh(jnp.asarray([[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]], jnp.float32), [[0, 1, 2]])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: icosphere(-1), "level must be an integer from 0 to 8; got -1"),
        (lambda: icosphere(1.5), "level"),  # pyright: ignore[reportArgumentType]
        (lambda: latitude_longitude_sphere(1, 8), "rows"),
        (lambda: latitude_longitude_sphere(4, 2), "columns"),
        (lambda: zigzag(0), "waves"),
        (lambda: zigzag(slope=0.0), "slope must be finite and > 0; got 0.0"),
        (lambda: corrugated(slope=np.nan), "slope"),
        (lambda: corrugated(segments=2), "segments"),
        (lambda: vertex_normals(icosphere(0), "angle"), "weighting must be unit or area"),  # pyright: ignore[reportArgumentType]
        (lambda: Mesh(icosphere(0).vertices * np.array([1, 1, 0.0]), icosphere(0).faces), "must have an area"),
        (lambda: vertex_normals(Mesh(GOOD, [[0, 1, 2], [0, 2, 1]])), "vertex 0 cancel"),
        (lambda: failures.interpolated_contrast(zigzag(rows=1)), "border"),
        (lambda: failures.mach_bands(icosphere(0), light=(0, 0, 0)), "the direction must not have length 0"),
        (lambda: failures.silhouette_bleed(icosphere(0), (np.inf, 0, 0)), "the direction must be"),
        (lambda: failures.mach_bands(icosphere(0), "smooth"), "shading must be one of flat"),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# Interpolation


def triangle(seed):
    random = np.random.default_rng(seed)
    corners = random.normal(size=(3, 2))
    while abs(np.linalg.det(corners[1:] - corners[0])) < 0.1:
        corners = random.normal(size=(3, 2))
    inside = random.dirichlet(np.ones(3), 40).T
    return corners, inside, random.normal(size=(3, 4))


@pytest.mark.slow
@given(st.integers(0, 10_000))
def test_three_interpolations_agree_on_triangles(seed):
    corners, shares, values = triangle(seed)
    at = corners.T @ shares
    spread = np.broadcast_to(corners[..., None], (3, 2, 40))
    for method in INTERPOLATIONS.values():
        np.testing.assert_allclose(method(spread, at), shares, atol=2e-13)
        np.testing.assert_allclose(interpolated(method(corners, at), values), values.T @ shares, atol=2e-12)


def test_scan_lines_on_quadrilaterals_are_what_the_formula_says():
    # A trapezium with two horizontal sides: t_l = t_r = y, then linear in x.
    corners, values = np.array([[0.0, 0.0], [4.0, 0.0], [3.0, 1.0], [1.0, 1.0]]), np.array([1.0, 2.0, 5.0, 7.0])
    x, y = 1.7, 0.6
    left, right = (1 - y) * 1 + y * 7, (1 - y) * 2 + y * 5
    expected = left + (right - left) * (x - y) / (4 - y - y)
    found = jax.jit(lambda *given: interpolated(scan_line_weights(*given), values))(corners, np.array([x, y]))
    assert found == pytest.approx(expected, rel=1e-14)


@pytest.mark.slow
def test_scan_lines_depend_on_the_rotation_of_quadrilaterals_only():
    angle = np.radians([0.0, 10, 30, 44, 45, 90])
    square, saddle = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]), np.array([0.0, 1, 0, 1])
    found = failures.turned_quadrilateral(square, saddle, np.zeros(2), angle)
    # At the centre, the line cuts the left and right sides at tan(angle): 1/2 upright, 1 standing on a corner.
    np.testing.assert_allclose(found, [*(1 + np.tan(angle[:5])) / 2, 0.5], atol=1e-12)
    assert np.ptp(found) == pytest.approx(0.5, abs=1e-12)
    corners, shares, values = triangle(5)
    for share in shares.T[:4]:
        turned = failures.turned_quadrilateral(corners, values[:, 0], share @ corners, np.linspace(0, 6, 50))
        np.testing.assert_allclose(turned, share @ values[:, 0], rtol=1e-11, atol=1e-12)


def test_interpolation_outside_its_domain_is_finite():
    flat, at = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), np.array([0.3, 0.4])
    for method in (area_weights, oblique_weights):
        weights, slopes = jax.jit(lambda *given, method=method: (method(*given), jax.jacobian(method)(*given)))(flat, at)
        np.testing.assert_array_equal(weights, [1, 0, 0])
        assert np.all(np.isfinite(slopes))
    np.testing.assert_array_equal(jax.jit(scan_line_weights)(flat, np.array([0.3, 5.0])), 0)


@pytest.mark.parametrize("name", few(INTERPOLATIONS, ("scan-line",)))
def test_gradients_of_interpolation(name):
    corners, shares, values = triangle(7)
    at, move = corners.T @ shares[:, 0], np.random.default_rng(2).normal(size=(3, 2))

    @jax.jit
    def value(moved):
        return jnp.sum(interpolated(INTERPOLATIONS[name](moved, at), values) ** 2)

    central = (value(corners + 1e-6 * move) - value(corners - 1e-6 * move)) / 2e-6
    assert np.sum(jax.grad(value)(jnp.asarray(corners)) * move) == pytest.approx(float(central), rel=1e-7)


# Failures of smooth shading, to the digits that are known of them


def test_averaged_normals_of_a_sphere_are_off():
    mesh = icosphere(2)
    for weighting, degrees in (("unit", 0.76), ("area", 1.35)):
        cosine = np.sum(np.asarray(vertex_normals(mesh, weighting)) * np.asarray(mesh.vertices), axis=1)
        assert round(float(np.degrees(np.arccos(cosine.min()))), 2) == degrees


def test_the_lost_highlight():
    mesh = icosphere(2)
    assert round(float(np.degrees(failures.facet_circumradius(mesh))), 1) == 10.8
    np.testing.assert_allclose(failures.lost_highlight(mesh, np.array([10.0, 100, 1000])), [0.836, 0.167, 0], atol=5e-4)
    # It is cos^n of the circumradius: the vertices of the worst facet are its nearest ones.
    assert failures.lost_highlight(mesh, 50.0) == pytest.approx(np.cos(failures.facet_circumradius(mesh)) ** 50, rel=1e-12)
    assert failures.lost_highlight(mesh, jnp.ones((2, 3))).shape == (2, 3)


@pytest.mark.slow
def test_the_zigzag_loses_its_folds_and_the_corrugation_keeps_its_waves():
    assert failures.facet_contrast(zigzag()) == pytest.approx(2 * np.sin(np.radians(25)) * np.sin(np.arctan(0.9)), rel=1e-13)
    assert round(float(failures.facet_contrast(zigzag())), 3) == 0.565
    assert failures.interpolated_contrast(zigzag()) == pytest.approx(0, abs=1e-15)
    # At the ends of the folds too, where a vertex has fewer faces on one side if all diagonals run alike.
    folds = zigzag(3, rows=1)
    inner = np.abs(np.asarray(folds.vertices)[:, 0]) < 0.9
    for weighting in ("unit", "area"):
        np.testing.assert_allclose(np.asarray(vertex_normals(folds, weighting))[inner, :2], 0, atol=1e-15)
    wave = corrugated()
    assert failures.facet_contrast(wave) > 0.55
    assert failures.interpolated_contrast(wave) > 0.55


@pytest.mark.slow
def test_the_silhouette_bleeds():
    found = [float(failures.silhouette_bleed(icosphere(level))) for level in (1, 2, 3, 4)]
    # Vertices on the far side reach about the sine of a facet's height behind the silhouette: halved with each level.
    assert found[0] > 0.2
    np.testing.assert_allclose(np.array(found[:-1]) / found[1:], 2, rtol=0.1)
    by_hand = icosphere(2)
    view = np.array([0.3, 0.2, 1.0]) / np.sqrt(1.13)
    front = np.asarray(face_normals(by_hand)) @ view > 0
    normals = averaged_normals(np.asarray(by_hand.vertices), np.asarray(by_hand.faces), by_area=False)
    assert found[1] == pytest.approx(-(normals @ view)[np.asarray(by_hand.faces)[front]].min(), rel=1e-12)
    assert failures.silhouette_bleed(by_hand, (0, 0, 1)) == pytest.approx(0, abs=1e-12)


@pytest.mark.slow
def test_mach_bands_remain():
    profiles = {shading: failures.mach_bands(icosphere(3), shading) for shading in ("flat", "gouraud", "phong")}
    step = np.diff(profiles["flat"].position)[0]
    flat = profiles["flat"]
    # Flat shading jumps in value; Gouraud and Phong only in slope, and keep jumping there when the samples lie closer.
    assert len(flat.edge) > 20
    assert np.abs(flat.value_jump).max() > 0.05
    assert np.abs(flat.slope_jump).max() == 0
    for shading in ("gouraud", "phong"):
        profile = profiles[shading]
        assert np.abs(profile.value_jump).max() < 3 * step
        assert np.abs(profile.slope_jump).max() > 0.1
    finer = failures.mach_bands(icosphere(3), "phong", samples=16384)
    assert np.abs(finer.slope_jump).max() == pytest.approx(np.abs(profiles["phong"].slope_jump).max(), rel=0.03)
    # Between two edges the slope of Gouraud shading is one number.
    gouraud = profiles["gouraud"]
    between = np.searchsorted(gouraud.edge[3:5], gouraud.position)
    assert np.ptp(gouraud.slope[:-1][(between[:-2] == 1) & (between[2:] == 1)][:-1]) < 1e-9
    # Ever finer facets make the jumps smaller, and the exact sphere has none.
    coarse = failures.mach_bands(icosphere(1))
    assert np.abs(coarse.slope_jump).max() > 2 * np.abs(gouraud.slope_jump).max()
