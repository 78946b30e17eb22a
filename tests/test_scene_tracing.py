"""Ray tracing: Snell's law to rounding, closed forms, and an independent tracer in plain numpy."""

from __future__ import annotations

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import numpy_tracer as plain
import pytest
from numpy_raster import camera_rays
from selection import few
from shared import equations

from brdfcheck import geometry
from brdfcheck.brdf.microfacet import boundary_reflectance
from brdfcheck.brdf.transmission import RoughDielectric
from brdfcheck.brdf.two_sides import bsdf
from brdfcheck.geometry import reflected
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.scene import tracing
from brdfcheck.scene.artistic import Translucent
from brdfcheck.scene.cameras import Orthographic, Perspective
from brdfcheck.scene.lights import Ambient, Distant, Environment, Point, Polygon
from brdfcheck.scene.materials import Surface, Term
from brdfcheck.scene.shading import shade
from brdfcheck.scene.tracing import Plane, Sphere, composed, trace

# As in a tracer's program: operation by operation, each shape would compile dozens of small ones.
refracted = jax.jit(geometry.refracted, static_argnames="axis")
trace64 = functools.partial(trace, dtype=jnp.float64, least_weight=0.0)


@functools.cache
def matt(*color):
    return Surface(Term("lambert", color))


def of(brdf, tint=1.0, **parameters):
    return Surface(Term(brdf, tint, **parameters), allow_unvalidated=True)


def lamp(position, power):
    return Point(position, power, constant_attenuation=0, quadratic_attenuation=1)


# Reflection and refraction


def travelling(count, seed):
    """Unit vectors that go down, a quarter of them along the surface to 1e-6 or less, a quarter straight."""
    random = np.random.default_rng(seed)
    cosine = random.uniform(0, 1, count)
    cosine[::4] = 10 ** random.uniform(-12, -6, cosine[::4].size)
    cosine[1::4] = 1 - 10 ** random.uniform(-14, -6, cosine[1::4].size)
    azimuth, sine = random.uniform(0, 2 * np.pi, count), np.sqrt((1 - cosine) * (1 + cosine))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), -cosine])


@pytest.mark.parametrize("ratio", few([1 / 2.4, 1 / 1.5, 1.0, 1.33, 1.5, 2.4], (1 / 1.5, 1.0, 2.4)))
def test_snells_law_to_rounding(ratio):
    travel, normal = travelling(400, 1), np.array([0, 0, 1.0])[:, None]
    onward, passes = refracted(jnp.asarray(travel), jnp.asarray(normal), jnp.asarray(ratio), axis=0)
    onward, passes = np.asarray(onward), np.asarray(passes)
    # Into the denser side everything passes, however grazing.
    np.testing.assert_array_equal(passes, (ratio <= 1) | (ratio * np.hypot(*travel[:2]) < 1))
    assert passes.any()
    assert passes.all() == (ratio <= 1)
    np.testing.assert_allclose(np.linalg.norm(onward, axis=0), 1, rtol=3e-16 * 4)
    # The part along the boundary is multiplied by the ratio of the indices, component by component.
    np.testing.assert_allclose(onward[:2, passes], ratio * travel[:2, passes], rtol=1e-15)
    assert np.all(onward[2, passes] < 0)
    # Where nothing passes, the direction is the mirror's.
    mirror = np.asarray(reflected(jnp.asarray(travel), jnp.asarray(normal), axis=0))
    np.testing.assert_allclose(onward[:, ~passes], mirror[:, ~passes], atol=1e-15)
    np.testing.assert_array_equal(mirror, travel * np.array([1, 1, -1.0])[:, None])
    # And back the same way; along the surface that is the critical angle, where rounding decides.
    passes = passes & (travel[2] < -1e-4)
    back, returns = refracted(jnp.asarray(-onward[:, passes]), -jnp.asarray(normal), jnp.asarray(1 / ratio), axis=0)
    assert np.all(returns)
    np.testing.assert_allclose(np.asarray(back)[:2], -travel[:2, passes], rtol=1e-14)


def test_refraction_in_any_frame_and_layout():
    random = np.random.default_rng(2)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    travel = travelling(60, 3)
    here, _ = refracted(jnp.asarray(travel), jnp.array([[0], [0], [1.0]]), jnp.asarray(1 / 1.5), axis=0)
    there, _ = refracted(jnp.asarray((turn @ travel).T), jnp.asarray(turn[:, 2]), jnp.full(60, 1 / 1.5))
    np.testing.assert_allclose(there, (turn @ np.asarray(here)).T, atol=2e-15)
    single, passes = refracted(jnp.array([0.6, 0, -0.8], jnp.float32), jnp.array([0, 0, 1], jnp.float32), jnp.float32(0.5))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, [0.3, 0, -np.sqrt(0.91)], rtol=2e-7)
    assert passes


# Closed forms


def box(material, **shares):
    """The cube [-2, 2]^3, walls inward, as outward normals of what is solid."""
    return [Plane(2 * side * axis, -side * axis, material, **shares) for axis in np.eye(3) for side in (-1.0, 1.0)]


@pytest.mark.parametrize(
    ("depth", "dtype"),
    [(4, jnp.float32), *(pytest.param(depth, jnp.float64, marks=pytest.mark.slow) for depth in (0, 9))],
)
def test_mirrors_in_a_closed_room_are_a_geometric_series(depth, dtype):
    share, albedo = np.array([0.9, 0.5, 0.0]), np.array([0.8, 0.5, 0.3])
    room = box(matt(*albedo), mirror=share)
    camera = Perspective((0.3, -0.2, 1.1), (0.0, 0.1, -1.0), field_of_view=100.0)
    image = trace(room, (Ambient(1.0),), camera, size=(20, 20), depth=depth, least_weight=0.0, dtype=dtype)
    expected = (1 - share) * albedo * sum(share**m for m in range(depth + 1))
    tolerance = 2e-6 if dtype == jnp.float32 else 1e-14
    np.testing.assert_allclose(np.moveaxis(np.asarray(image), 0, -1), np.broadcast_to(expected, (20, 20, 3)), atol=tolerance)
    assert image.dtype == dtype


@pytest.mark.parametrize("form", few(["shares", "term"], ("term",)))
@pytest.mark.parametrize("index", few([1.33, 1.5, 2.4, 0.8], (1.5, 0.8)))
def test_glass_before_white_vanishes_but_for_the_depth_limit(index, form):
    # The angle inside a sphere is the same at every bounce, so what is still inside after d of them is (1 - F) F^(d-1).
    camera, size = Orthographic(half_height=1.0), (40, 40)
    x, y = ((np.arange(40) + 0.5) / 20 - 1) * np.ones((40, 1)), (1 - (np.arange(40) + 0.5) / 20)[:, None]
    square = x**2 + y**2
    cosine = np.sqrt(np.maximum(1 - square, 0))
    for depth in (1, 5):
        glass = {"transparency": 1.0, "index": index} if form == "shares" else {"material": of("dielectric", eta=index)}
        ball = Sphere((0, 0, 0), 1.0, **glass)
        image = trace64((ball,), (), camera, size=size, depth=depth, background=1.0)
        share = np.asarray(boundary_reflectance(cosine, jnp.asarray(index)))
        missing = np.where(square < 1, (1 - share) * share ** (depth - 1), 0)
        np.testing.assert_allclose(np.asarray(image), np.broadcast_to(1 - missing, (3, 40, 40)), atol=2e-12)


@pytest.mark.slow
def test_total_internal_reflection_under_water():
    # An eye under water sees the sky in a disk of the critical angle, and around it the black ground mirrored.
    water = Plane((0, 0, 0), (0, 0, 1), transparency=1.0, index=1.33)
    camera = Perspective((0, 0, -1.0), (0, 0, 0), field_of_view=140.0)
    image = np.asarray(trace64((water,), (), camera, size=(60, 60), depth=1, background=(1.0, 0.5, 0.25)))
    _, directions = camera_rays((0, 0, -1), (0, 0, 0), (0, 1, 0), (60, 60), field_of_view=140.0)
    sky = 1.33 * np.sqrt(1 - directions[..., 2] ** 2) < 1
    assert 0.05 < sky.mean() < 0.5
    # Whatever is reflected leaves the scene too, so under one sky all is as bright: with a ground it is not.
    np.testing.assert_allclose(image[0], 1, atol=1e-12)
    ground = Plane((0, 0, -3), (0, 0, 1), matt(1.0, 1.0, 1.0))
    image = np.asarray(trace64((water, ground), (), camera, size=(60, 60), depth=1, background=1.0))
    expected = [[1 - plain.fresnel(cosine, 1.33, 1)[0] for cosine in row] for row in directions[..., 2]]
    np.testing.assert_allclose(image[0], expected, atol=1e-13)
    assert np.all((image[0] > 0) == sky)


def test_shadows_are_where_they_must_be():
    # A ball under a light straight above it: the disk under it is dark, all else is lit; a light below the ball is not
    # in its shadow, nor one whose distance ends before it.
    floor, ball = Plane((0, 0, 0), (0, 0, 1), matt(0.5, 0.5, 0.5)), Sphere((0, 0, 3), 1.0, matt(0.5, 0.5, 0.5))
    camera = Perspective((0.0, -6.0, 1.2), (0, 0, 0), (0, 0, 1), field_of_view=40.0)
    size = (50, 50)
    origins, directions = camera_rays((0, -6, 1.2), (0, 0, 0), (0, 0, 1), size, field_of_view=40.0)
    distance = np.where(directions[..., 2] < 0, -origins[..., 2] / directions[..., 2], np.nan)
    spot = origins + distance[..., None] * directions
    on_floor = (distance > 0) & (distance < 20)
    radius = np.linalg.norm(spot[..., :2], axis=-1)
    image = np.asarray(trace64((floor, ball), (Distant((0, 0, 1.0), np.pi),), camera, size=size))[0]
    np.testing.assert_allclose(image[on_floor], np.where(radius[on_floor] < 1, 0, 0.5), atol=1e-14)
    assert np.any(radius[on_floor] < 1)
    for height, shadow in ((1.5, None), (6.0, 3 / np.sqrt(8) * 6 / 3)):
        image = np.asarray(trace64((floor, ball), (lamp((0, 0, height), 1.0),), camera, size=size))[0]
        # The cone from (0, 0, h) around the ball meets the floor at h tan(asin(1 / (h - 3))).
        limit = 0 if shadow is None else height * np.tan(np.arcsin(1 / (height - 3)))
        lit = 0.5 / np.pi * height / (height**2 + radius**2) ** 1.5
        np.testing.assert_allclose(image[on_floor], np.where(radius < limit, 0, lit)[on_floor], atol=1e-13)


@pytest.mark.parametrize("dtype", few([jnp.float32, jnp.float64], (jnp.float32,)))
def test_a_sphere_does_not_shadow_its_lit_side(dtype):
    ball, light = Sphere((100.0, 50.0, -30.0), 3.0, matt(0.5, 0.4, 0.3)), Distant((1.0, 1.0, 1.0), 2.0)
    camera = Perspective((100.0, 50.0, 0.0), (100.0, 50.0, -30.0), field_of_view=14.0)
    with_shadows, without = (
        trace((ball,), (light,), camera, size=(64, 64), shadows=shadows, dtype=dtype) for shadows in (True, False)
    )
    np.testing.assert_array_equal(with_shadows, without)
    assert np.asarray(without).max() > 0.2


# What transmits


@pytest.mark.slow
def test_a_matt_sheet_is_lit_from_behind():
    # E T / pi, whatever the light, on either side; what a polygon brings is that on its side.
    sheet = Plane((0, 0, 0), (0, 0, 1), of("lambert-transmission", (1.0, 0.5, 0.2), albedo=0.9, through=2 / 3))
    square = Polygon([(1.0, 1, 2), (-1, 1, 2), (-1, -1, 2), (1, -1, 2)], 3.0)
    for side, share in ((1.0, 0.3), (-1.0, 0.6)):
        camera = Perspective((0.0, 0.0, 3 * side), (0.0, 0.0, 0.0), (0, 1, 0), field_of_view=1.0)
        for light, expected in (
            (Distant((0.6, 0.0, 0.8), 2.0), 1.6),
            (lamp((0.0, 0.0, 2.0), 8.0), 2.0),
            (square, 3 * float(square.irradiance(np.zeros(3), np.array([0.0, 0.0, 1.0])))),
        ):
            image = np.asarray(trace64([sheet], [light], camera, size=(1, 1)))[:, 0, 0]
            np.testing.assert_allclose(image, np.array([1.0, 0.5, 0.2]) * share * expected / np.pi, rtol=1e-12)


def test_what_loses_nothing_vanishes_in_a_furnace():
    clear, paper = of("thin-sheet", index=1.5, clear=1.0), of("lambert-transmission", albedo=1.0, through=0.3)
    mixed = Surface(Term(clear.terms[0].brdf, 0.25), Term(paper.terms[0].brdf, 0.75), allow_unvalidated=True)
    bodies = [Sphere((-0.6, 0, -1), 0.8, paper), Plane((0, 0, -3), (0, 0.1, 1), mixed), Plane((0, 0, 0), (0.1, 0, 1), clear)]
    image = trace64(bodies, [Environment(1.0)], Orthographic(half_height=1.2), size=(20, 20), depth=8, background=1.0)
    # Less than R^4 is left between the panes, R at up to 12 degrees.
    np.testing.assert_allclose(image, 1, atol=1e-6)


@pytest.mark.slow
def test_a_pane_dims_its_shadow_by_what_it_stops():
    floor, pane = (
        Plane((0, 0, 0), (0, 0, 1), matt(1.0, 1.0, 1.0)),
        Plane((0, 0, 1), (0, 0, 1), of("thin-sheet", index=1.5, clear=0.5)),
    )
    camera = Perspective((0.0, 0.0, 0.9), (0.0, 0.0, 0.0), (0, 1, 0), field_of_view=1.0)
    image = np.asarray(trace64([floor, pane], [Distant((0.6, 0.0, 0.8), np.pi)], camera, size=(1, 1)))
    passing = pane.material.terms[0].brdf.weights(jnp.asarray(0.8))[1]
    np.testing.assert_allclose(image[:, 0, 0], 0.8 * float(passing), rtol=1e-6)


@pytest.mark.parametrize("form", few(["lobe", "radiance", "numpy"], ("radiance", "numpy")))
def test_a_rough_boundary_under_a_light_on_either_side(form):
    lobe = RoughDielectric(0.4, 1.5)
    functions = {
        "radiance": bsdf(lambda wi, wo: lobe(wo, wi), eta=1.5, scale="radiance"),
        "numpy": bsdf(lambda wi, wo: np.asarray(lobe(np.asarray(wi), np.asarray(wo))), eta=1.5),
    }
    material = of(functions.get(form, lobe))
    for side, height in ((1.0, 0.7), (1.0, -0.7), (-1.0, 0.9), (-1.0, -0.9)):
        light = np.array([0.3, 0.1, height])
        light, view = light / np.linalg.norm(light), np.array([-0.28, 0.0, 0.96 * side])
        normal, below = (0.0, 0.0, side), jnp.asarray(side < 0)
        found = shade(material, [Distant(light, 2.0)], np.zeros(3), tuple(map(jnp.asarray, normal)), tuple(view), below)
        expected = 2 * abs(light[2]) * float(lobe(light, view))
        assert expected > 1e-3
        np.testing.assert_allclose(found, expected, rtol=1e-6)
        if form != "lobe":
            continue
        white = shade(material, [Environment(1.0)], np.zeros(3), tuple(map(jnp.asarray, normal)), tuple(view), below)
        np.testing.assert_allclose(white, float(albedo(lobe.lit(float(side < 0)), 0.96).value), atol=1e-4)


# Against the other tracer

BODIES = [
    {"point": (0, -1, 0), "normal": (0, 1, 0), "color": (0.6, 0.5, 0.4), "mirror": 0.2},
    {"point": (0, 0, -3), "normal": (0.2, 0.1, 2), "color": (0.2, 0.6, 0.3)},
    {"center": (-1.1, 0, 0), "radius": 1.0, "color": (0.9, 0.3, 0.2), "mirror": (0.6, 0.5, 0.4)},
    {"center": (1.0, -0.2, 0.8), "radius": 0.8, "color": (0.1, 0.1, 0.9), "transparency": (0.9, 0.8, 0.7), "index": 1.5},
    {"center": (0.2, 0.9, 1.2), "radius": 0.4, "transparency": 1.0, "index": 0.7},
]
LIGHTS = [{"direction": (1.0, 2.0, 1.5), "power": 2.0}, {"position": (-1.0, 3.0, 2.0), "power": 9.0}]
SIZE = (27, 33)
PLACE = {"eye": (0.5, 0.8, 6.0), "target": (0.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0)}


def scene(bodies, lights):
    made = []
    for body in bodies:
        shares = {name: body[name] for name in ("mirror", "transparency", "index") if name in body}
        material = matt(*body["color"]) if "color" in body else None
        shape = (Sphere, "center", "radius") if "center" in body else (Plane, "point", "normal")
        made.append(shape[0](body[shape[1]], body[shape[2]], material, **shares))
    return made, [Distant(*row.values()) if "direction" in row else lamp(*row.values()) for row in lights]


def as_arrays(rows):
    return [{name: np.array(value, float) if np.ndim(value) else value for name, value in row.items()} for row in rows]


@pytest.mark.parametrize(
    ("kind", "depth"),
    [
        ("orthographic", 2),
        *(pytest.param(*row, marks=pytest.mark.slow) for row in (("perspective", 0), ("perspective", 4), ("orthographic", 4))),
    ],
)
def test_images_are_those_of_another_tracer(kind, depth):
    size = SIZE
    opening = {"field_of_view": 40.0} if kind == "perspective" else {"half_height": 1.9}
    camera = (Perspective if kind == "perspective" else Orthographic)(**PLACE, **opening)
    bodies, lights = scene(BODIES, LIGHTS)
    shadows = depth != 2
    found = np.asarray(trace64(bodies, lights, camera, size=size, depth=depth, background=(0.3, 0.4, 0.6), shadows=shadows))
    rays = camera_rays(*PLACE.values(), size, **opening)
    expected = plain.image(as_arrays(BODIES), as_arrays(LIGHTS), *rays, depth, (0.3, 0.4, 0.6), shadows)
    assert np.ptp(expected) > 0.3
    np.testing.assert_allclose(np.moveaxis(found, 0, -1), expected, atol=1e-9)


def mixed(render=trace64):
    bodies, lights = scene(BODIES, LIGHTS)
    return np.asarray(render(bodies, lights, Perspective(**PLACE, field_of_view=40.0), size=SIZE, depth=4, background=0.3))


@pytest.mark.slow
def test_single_precision_and_small_weights_change_little():
    exact, single = mixed(), mixed(trace)
    assert single.dtype == np.float32
    difference = np.abs(exact - single).max(0)
    assert np.mean(difference > 2e-3) < 0.01  # pixels on edges fall to the other side
    assert np.median(difference) < 1e-5


@pytest.mark.slow
def test_blocks_do_not_show(monkeypatch):
    whole = mixed()
    monkeypatch.setattr(tracing, "_BLOCK", 100)
    np.testing.assert_allclose(mixed(), whole, atol=1e-13)


# Programs and derivatives


@pytest.mark.slow
def test_one_program_for_all_numbers(monkeypatch):
    calls, meet = [], tracing._meet
    monkeypatch.setattr(tracing, "_meet", lambda *arguments: calls.append(1) or meet(*arguments))
    for value in (0.3, 0.6, 0.9):
        bodies = [
            Plane((0, -value, 0), (0, 1, value), matt(value, 0.5, 0.5)),
            Sphere((0, 0, value), value, transparency=value, index=1 + value),
        ]
        camera = Perspective((0, value, 5.0), field_of_view=30 * value)
        trace(bodies, (Distant((1, value, 1)),), camera, size=(9, 13), background=value, least_weight=value / 1000)
        calls.append(0)
    assert calls == [1, 0, 0, 0]


def test_what_a_scene_lacks_is_not_compiled():
    def primitives(bodies, shadows):
        light = Distant((1.0, 1.0, 1.0))
        made = eqx.filter_make_jaxpr(lambda b: trace(b, (light,), Orthographic(), size=(8, 8), shadows=shadows))(bodies)[0]
        return [equation.primitive.name for equation in equations(made)]

    ball = Sphere((0, 0, 0), 1.0, matt(0.5, 0.5, 0.5))
    plain_ball, shadowed = primitives((ball,), False), primitives((ball,), True)
    mirror = primitives((Sphere((0, 0, 0), 1.0, matt(0.5, 0.5, 0.5), mirror=0.1),), False)
    glass = primitives((Sphere((0, 0, 0), 1.0, matt(0.5, 0.5, 0.5), transparency=0.1),), False)
    # A loop over the blocks; another over the tree of rays only where there is one.
    assert [found.count("scan") for found in (plain_ball, shadowed, mirror, glass)] == [1, 1, 2, 2]
    assert plain_ball.count("sqrt") < shadowed.count("sqrt")
    assert mirror.count("sqrt") < glass.count("sqrt")
    assert len(plain_ball) < len(shadowed)
    assert len(plain_ball) < len(mirror) < len(glass)
    assert len(primitives((Sphere((0, 0, 0), 1.0, mirror=0.1),), False)) < len(mirror)


@pytest.mark.slow
def test_gradients_forwards_and_backwards():
    # A view without edges that move: the eye looks into the glass ball, which fills the image, over a wide floor.
    start = {
        "index": np.array(1.4),
        "glass": np.array([0.9, 0.8, 0.7]),
        "mirror": np.array([0.3, 0.2, 0.1]),
        "color": np.array([0.5, 0.6, 0.7]),
        "light": np.array([0.2, 0.3, 1.0]),
        "lamp": np.array([1.0, 5.0, 4.0]),
    }
    camera = Perspective((0.0, 0.0, 2.4), field_of_view=25.0)

    @jax.jit
    def energy(numbers):
        wall = Plane((0, 0, -9), (0, 0, 1), Surface(Term("lambert", numbers["color"])), mirror=numbers["mirror"])
        behind = Plane((0, 0, 30), (0, 0, -1), Surface(Term("lambert", 0.5)))
        ball = Sphere((0, 0, 0), 1.0, transparency=numbers["glass"], index=numbers["index"])
        lights = (Distant(numbers["light"]), lamp(numbers["lamp"], 50.0))
        return jnp.mean(trace64((wall, behind, ball), lights, camera, size=(6, 7), depth=3, shadows=False) ** 2)

    gradient = jax.jit(jax.grad(energy))(start)
    forwards = jax.jit(lambda moves: jax.jvp(energy, (start,), (moves,))[1])
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))
    random = np.random.default_rng(6)
    step = 1e-6
    for name in start:
        move = random.normal(size=start[name].shape)
        there, back = (energy({**start, name: start[name] + s * move}) for s in (step, -step))
        central = float(there - back) / (2 * step)
        assert abs(central) > 1e-5
        assert float(np.sum(gradient[name] * move)) == pytest.approx(central, rel=1e-6)
        zero = {key: np.zeros_like(value) for key, value in start.items()}
        assert float(forwards({**zero, name: move})) == pytest.approx(central, rel=1e-6)


@pytest.mark.slow
def test_gradients_are_finite_where_rays_miss_graze_and_shadow():
    bodies, lights = scene(BODIES[:4:3], LIGHTS)

    def energy(parts):
        return jnp.mean(trace(*parts, Perspective(**PLACE, field_of_view=60.0), size=(16, 16), depth=3))

    gradient = eqx.filter_jit(eqx.filter_grad(energy))((bodies, lights))
    leaves = jax.tree.leaves(gradient)
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)
    assert sum(bool(np.any(leaf)) for leaf in leaves) > 10


@pytest.mark.slow
def test_lights_without_a_direction_cast_no_shadow():
    floor = Plane((0, 0, 0), (0, 0, 1), matt(0.5, 0.5, 0.5))
    ball = Sphere((0, 0, 1.5), 1.0, matt(0.5, 0.5, 0.5))
    panel = Polygon([[-1, -1, 4], [-1, 1, 4], [1, 1, 4], [1, -1, 4.0]], 2.0)
    camera = Perspective((3.0, 0.0, 0.7), (0, 0, 0), (0, 0, 1))
    for light in (Ambient(0.5), Environment(0.5), panel):
        dark, bright = (trace64((floor, ball), (light,), camera, size=(16, 16), shadows=shadows) for shadows in (True, False))
        np.testing.assert_array_equal(dark, bright)
        assert np.asarray(bright).max() > 0.05


def ball_trace(camera=None, size=(4, 4), **options):
    return trace((Sphere((0, 0, 0), 1.0, matt(0.5, 0.5, 0.5)),), (), camera or Orthographic(), size=size, **options)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: Sphere((0, 0, np.nan), 1.0), ValueError, "center must be finite"),
        (lambda: Sphere((0, 0), 1.0), ValueError, "center must be three components"),
        (lambda: Sphere((0, 0, 0), 0.0), ValueError, "radius must be finite and > 0"),
        (lambda: Sphere((0, 0, 0), 1.0, mirror=-0.1), ValueError, "mirror must be finite and >= 0"),
        (lambda: Sphere((0, 0, 0), 1.0, mirror=0.7, transparency=0.4), ValueError, "must add up to at most 1; got 0.7 and 0.4"),
        (lambda: Plane((0, 0, 0), (0, 0, 1), mirror=(0, 0.8, 0.1), transparency=(0.9, 0.3, 0)), ValueError, "got 0.8 and 0.3"),
        (lambda: Sphere((0, 0, 0), 1.0, transparency=1.0, index=0.0), ValueError, "index must be finite and > 0; got 0.0"),
        (lambda: Sphere((0, 0, 0), 1.0, transparency=np.inf), ValueError, "transparency must be finite"),
        (lambda: Sphere((0, 0, 0), 1.0, Translucent(0.5), transparency=0.5), ValueError, "leave transparency out"),
        (lambda: Sphere((0, 0, 0), 1.0, "red"), TypeError, "a material of brdfcheck.scene.materials is needed; got str"),
        (lambda: Plane((0, 0, 0), (0, 0, 0)), ValueError, "normal_direction must not have length 0"),
        (lambda: trace((), (), Orthographic(), size=(4, 4)), TypeError, "Sphere and Plane; got nothing"),
        (lambda: trace((3,), (), Orthographic(), size=(4, 4)), TypeError, "Sphere and Plane; got int"),
        (lambda: ball_trace(depth=10), ValueError, "depth must be an integer from 0 to 9"),
        (lambda: ball_trace(depth=True), ValueError, "depth must be"),
        (lambda: ball_trace(size=(4,)), ValueError, "size must be"),
        (lambda: ball_trace(background=-1), ValueError, "background must be"),
        (lambda: ball_trace(least_weight=np.nan), ValueError, "least_weight must be"),
        (lambda: ball_trace(Perspective((0, 0, 0.5))), ValueError, "camera is inside sphere 0: 0.5 from"),
        (lambda: trace((Sphere((0, 0, 0), 1.0),), (3,), Orthographic(), size=(4, 4)), TypeError, "lights"),
        (lambda: composed((Sphere((0, 0, 0), 1.0),), (), Orthographic(), size=(4, 4)), ValueError, "sphere 0 must"),
    ],
)
def test_bad_arguments_are_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()
