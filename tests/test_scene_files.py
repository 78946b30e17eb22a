"""Scenes in documents: what is refused says the key, the value and what is allowed; what is outside of RGB is cut off."""

import numpy as np
import pytest
import trimesh
from selection import few

from brdfcheck.documents import read_document
from brdfcheck.messages import UsageError
from brdfcheck.scene.artistic import Metal
from brdfcheck.scene.cameras import Orthographic, Perspective
from brdfcheck.scene.files import parse_scene
from brdfcheck.scene.images import rgb_of_spectrum
from brdfcheck.scene.lights import Distant
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.meshes import icosphere
from brdfcheck.scene.smooth import render_mesh
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.tracing import Plane, trace

LIGHTS = [{"kind": "distant", "direction": [1, 1, 1]}]
MATT = {"kind": "surface", "terms": [{"brdf": "lambert", "tint": 0.5}]}
GREEN = {"wavelengths": [500, 510, 520, 530, 540], "reflectance": [0, 0, 1, 0, 0]}
SQUARE = [[-1, -1, 3], [1, -1, 3], [1, 1, 3], [-1, 1, 3]]


def scene(**changes):
    return parse_scene({"size": 16, "material": MATT, "lights": LIGHTS} | changes)


def glossy(**parameters):
    return {"kind": "surface", "terms": [{"brdf": "phong", "tint": 0.3} | parameters]}


# --- files that a scene names ---

TETRAHEDRON = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def from_file(folder, name, **changes):
    geometry = {"kind": "mesh", "file": name}
    return parse_scene({"size": 16, "material": MATT, "lights": LIGHTS, "geometry": geometry} | changes, folder=folder)


@pytest.mark.parametrize("ending", few(["obj", "ply", "stl", "glb"], ("glb",)))
def test_meshes_of_files_are_the_meshes_that_were_written(tmp_path, ending):
    trimesh.creation.icosphere(2).export(tmp_path / f"ball.{ending}")
    read = from_file(tmp_path, f"ball.{ending}")
    assert read.mesh.vertices.shape == (162, 3)  # stl has a vertex for each corner
    made = scene(geometry={"kind": "icosphere", "level": 2})
    np.testing.assert_allclose(read.render(), made.render(), atol=2e-3)
    flat = {"kind": "mesh", "file": f"ball.{ending}", "shading": "flat"}
    np.testing.assert_allclose(
        from_file(tmp_path, "", geometry=flat).render(),
        scene(geometry={"kind": "icosphere", "level": 2, "shading": "flat"}).render(),
        atol=2e-4,
    )


def test_meshes_of_one_file_are_joined_where_they_are(tmp_path):
    there = trimesh.transformations.translation_matrix([0.5, 0, 0])
    together = trimesh.Scene()
    for matrix in (np.eye(4), there):
        together.add_geometry(trimesh.creation.box((0.4, 0.4, 0.4)), transform=matrix)
    together.export(tmp_path / "two.glb")
    mesh = from_file(tmp_path, "two.glb").mesh
    assert (len(mesh.vertices), len(mesh.faces)) == (16, 24)
    assert float(mesh.vertices[:, 0].min()) == pytest.approx(-0.2)
    assert float(mesh.vertices[:, 0].max()) == pytest.approx(0.7)


def test_closed_meshes_that_look_inwards_are_turned_and_open_ones_have_two_sides(tmp_path):
    TETRAHEDRON.export(tmp_path / "right.ply")
    turned = TETRAHEDRON.copy()
    turned.invert()
    turned.export(tmp_path / "turned.ply")
    camera = {"camera": {"kind": "orthographic", "eye": [2, 2, 2]}}
    right, other = (from_file(tmp_path, name, **camera) for name in ("right.ply", "turned.ply"))
    np.testing.assert_allclose(right.render(), other.render(), atol=1e-6)
    assert "cull" not in right.options
    trimesh.Trimesh(TETRAHEDRON.vertices, TETRAHEDRON.faces[:3]).export(tmp_path / "open.ply")
    assert from_file(tmp_path, "open.ply").options == {"cull": False}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.ply", None, "there is no file '.*none.ply'"),
        ("a.ply", b"not a mesh", "cannot read '.*a.ply' as a mesh: "),
        ("a.txt", b"v 0 0 0", "cannot read '.*a.txt' as a mesh: "),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "cannot read|has no triangles"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n", "triangles must have an area; face 0"),
    ],
)
def test_files_that_are_no_meshes_are_refused_in_one_line(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(UsageError, match=f"^scene: geometry: {words}|^scene: geometry: '.*': {words}") as caught:
        from_file(tmp_path, name)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_function_of_a_file_is_a_term(tmp_path):
    (tmp_path / "mine.py").write_text("def matt(wi, wo, albedo):\n    return albedo / 3.141592653589793 + 0 * wi[..., 2]\n")
    (tmp_path / "s.toml").write_text(
        'size = 16\n[material]\nkind = "surface"\nterms = [{ brdf = "mine.py:matt", albedo = 0.5 }]\n'
        '[[lights]]\nkind = "distant"\ndirection = [1, 1, 1]\n'
    )
    read = parse_scene(*read_document(tmp_path / "s.toml"))
    assert read.named_files
    np.testing.assert_allclose(read.render(), scene().render(), atol=1e-6)
    for terms, words in (
        ([{"brdf": "mine.py:matt"}], r"terms\[0\]: .*mine.py:matt: the parameter albedo must be given as a number$"),
        ([{"brdf": "mine.py:shiny"}], r"terms\[0\]: .*mine.py has no object 'shiny'; it offers matt"),
        ([{"brdf": "other.py:matt"}], r"terms\[0\]: there is no file '.*other.py'"),
        (
            [{"brdf": "mine.py:matt", "albedo": 2}],
            "mine.py:matt is not validated .VIOLATES: albedo 2 .* allow_unvalidated = true",
        ),
    ):
        with pytest.raises(UsageError, match=words):
            parse_scene({"material": {"kind": "surface", "terms": terms}, "lights": LIGHTS}, str(tmp_path / "s.toml"))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"material": glossy(n="a")}, r"terms\[0\]: phong: n must be one number; got 'a'"),
        ({"geometry": {"kind": "sphere", "radius": "big"}}, "radius must be one number; got 'big'"),
        ({"geometry": {"kind": "sphere", "center": "here"}}, "center must be three components, x, y and z; got 'here'"),
        ({"size": [True, 5]}, "size: must be a number of pixels or .height, width., each from 1 to 16384; got .True, 5."),
        (
            {"material": {"kind": "metal", "base": 1, "lobes": []}},
            r"lobes must be pairs of weight and slope, at least one; got \[\]",
        ),
        ({"lights": [{"kind": "distant", "direction": [0, 0, 1e-50]}]}, "direction must not have length 0"),
        ({"lights": [{"kind": "distant", "direction": [0, 0, 1e50]}]}, "direction must be finite in single precision"),
        ({"lights": [LIGHTS[0] | {"intensity": 1e300}]}, r"lights\[0\]: intensity must be finite in single precision"),
        ({"lights": [LIGHTS[0] | {"intensity": 3e38}] * 10}, "of 256 pixels are not finite in single precision"),
        ({"lights": [{"kind": "polygon", "vertices": [[0, 0, 1], [1, 0]]}]}, "vertices must be at least 3 rows of three"),
        ({"lights": [{"kind": "polygon", "vertices": [[0, 0, 1e300], *SQUARE]}]}, r"<= 3.4e\+38; got \[0.0, .*\] in row 0"),
        ({"material": glossy(n=10**400)}, r"phong: n must be finite in single precision, <= 3.4e\+38; got 10000"),
        ({"material": glossy(n=10**5000)}, "got an integer of thousands of digits"),
        ({"material": {"kind": "metal", "base": 1, "lobes": [[0.1, 1e-20]]}}, "the slope m must be finite and >= 1e-09"),
        ({"geometry": {"kind": "sphere", "radius": 1e-50}}, "geometry: radius must be finite and > 0; got 1e-50"),
        ({"camera": {"kind": "perspective", "eye": [0, 0, 1e300]}}, "camera: eye must be finite in single precision"),
        ({"background": 1e39}, "background must be finite in single precision"),
        (
            {"geometry": {"kind": "icosphere"}, "camera": {"kind": "perspective", "target": [0, 0, 9]}},
            "the camera at .* is turned away from the mesh: 162 of 162 vertices are behind it",
        ),
    ],
)
def test_bad_values_are_refused_in_one_line_with_their_key(changes, words):
    with pytest.raises((UsageError, ValueError), match=words) as caught:
        scene(**changes).render()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200


def test_what_of_a_spectrum_is_outside_of_rgb_is_cut_off():
    pytest.importorskip("colour")
    raw = rgb_of_spectrum(GREEN["wavelengths"], GREEN["reflectance"])
    assert raw.min() < -0.01
    terms = [{"brdf": "lambert", "tint": GREEN}]
    (term,) = scene(material={"kind": "surface", "terms": terms}).material.terms
    np.testing.assert_allclose(term.tint, np.maximum(raw, 0), atol=1e-7)


def test_a_polygon_may_light_matt_terms_only():
    terms = [{"brdf": "lambert", "tint": 0.5}, {"brdf": "phong", "tint": 0.3, "n": 20}]
    mixed, square = {"kind": "surface", "terms": terms}, {"kind": "polygon", "vertices": SQUARE, "intensity": 2}
    with pytest.raises(ValueError, match=r"lights\[0\]: a Polygon light .* a light that is matt_only reaches"):
        scene(material=mixed, lights=[square]).render()
    both = scene(material=mixed, lights=[square | {"matt_only": True}]).render()
    np.testing.assert_array_equal(both, scene(lights=[square]).render())
    assert both.max() > 0.05


@pytest.mark.parametrize("length", [1e-30, 1e-20, 1e20, 1e30])
def test_directions_count_by_their_direction_only(length):
    def image(z):
        lights = [
            {"kind": "distant", "direction": [z, 0, z]},
            {"kind": "spot", "position": [0, 0, 5], "spot_direction": [0, 0.1 * z, -z], "spot_exponent": 3},
        ]
        return scene(lights=lights, camera={"kind": "orthographic", "up": [0, z, 0]}).render()

    np.testing.assert_allclose(image(length), image(1.0), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    "background",
    [float("nan"), -1, (0, 0, -0.1), np.full((3, 8, 8), np.inf), "white", (1, 2)],
    ids=lambda value: str(value)[:12],
)
def test_bad_backgrounds_are_refused(background):
    surface, light = Surface(Term("lambert", 0.5)), [Distant((0, 0, 1))]
    for draw in (
        lambda: sphere_image(surface, light, size=(8, 8), background=background),
        lambda: render_mesh(icosphere(0), Orthographic(), surface, light, size=(8, 8), background=background),
    ):
        with pytest.raises(ValueError, match="background must be"):
            draw()


@pytest.mark.slow
def test_bad_normals_of_a_mesh_are_refused():
    mesh, surface, light = icosphere(0), Surface(Term("lambert", 0.5)), [Distant((0, 0, 1))]
    for normals, words in (
        (np.zeros((12, 3)), "normals must be unit vectors; that of vertex 0 has the length 0"),
        (np.full((12, 3), np.nan), r"normals must be finite; got \[nan, nan, nan\] in row 0"),
        (np.ones((5, 3)), r"normals must be unit vectors, of shape \(12, 3\) as the vertices; got \[\[1.0, "),
        ("smooth", "normals must be unit vectors, of shape"),
    ):
        with pytest.raises(ValueError, match=words):
            render_mesh(mesh, Orthographic(), surface, light, size=(8, 8), normals=normals)
    usual = render_mesh(mesh, Orthographic(), surface, light, size=(8, 8))
    np.testing.assert_allclose(render_mesh(mesh, Orthographic(), surface, light, size=(8, 8), normals=mesh.vertices), usual)


@pytest.mark.parametrize("lobes", [[], [[]], [[[]]], 5, None, "ab", [(1,)]])
def test_a_metal_needs_pairs(lobes):
    with pytest.raises(ValueError, match="lobes"):
        Metal(1, lobes)


@pytest.mark.parametrize("length", [1e-25, 1e25])
def test_a_plane_counts_by_the_direction_of_its_normal_only(length):
    def image(length):
        plane = Plane((0, -1, 0), (0, length, 0.2 * length), Surface(Term("lambert", 0.5)))
        return trace([plane], [Distant((0, 1, 1))], Perspective(), size=(16, 16), depth=0)

    np.testing.assert_allclose(image(length), image(1.0), rtol=1e-5)
    assert image(length).max() > 0.05
