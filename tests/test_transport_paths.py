"""Paths against radiosity and closed forms; the angular operator of a BRDF against its albedo and against paths."""

from __future__ import annotations

import functools
import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

import brdfcheck
from brdfcheck import BlinnPhong, CookTorrance, Factor, Lambert, Normalized, Phong, PhongExact, transport
from brdfcheck.brdf import catalog
from brdfcheck.transport import Status, angular

KEY = jax.random.key(7)
PUBLISHED = Normalized(BlinnPhong(8.76), Factor(8, 8 * np.pi))


@functools.cache
def published():
    """Its angular operator."""
    return transport.angular_operator(PUBLISHED)


def entry(name, value):
    (parameter,) = catalog.entry(name).family.ranges
    return catalog.entry(name).family.build(**{parameter: value})


def scores(found, exact):
    error = np.asarray(found.error)
    return (np.asarray(found.value) - exact) / np.where(error > 0, error, 1e-15)


# --- diffuse walls ---


@pytest.mark.slow
def test_paths_solve_the_equation_of_patches_with_an_honest_error():
    cube = transport.box()
    exact = np.array([0.40938030] * 4 + [1.28654972, 0.40926241])
    all_scores = []
    for seed in range(8):
        found = transport.trace(cube, cube.on_wall(4, 1.0), 0.7, key=jax.random.key(seed), paths=2**15, equation="patches")
        assert found.ok
        all_scores.append(scores(found, exact))
    z = np.array(all_scores)
    # Standard errors of 32 groups: the scores follow Student's t with 31 degrees of freedom.
    assert np.max(np.abs(z)) < 5
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.3
    assert np.max(found.error) < 0.004


@pytest.mark.slow
def test_paths_solve_the_light_itself():
    """On one wall, one patch: the mean over the wall of the light, which finer and finer patches come to."""
    cube = transport.box()
    found = transport.trace(cube, cube.on_wall(4, 1.0), 0.7, key=KEY, paths=2**18)
    means = []
    for cells in (6, 12):
        fine = transport.box(cells=cells)
        value = np.asarray(transport.krylov(fine, fine.on_wall(4, 1.0), 0.7).value)
        means.append(value.reshape(6, -1).mean(axis=1))
    left = np.abs(means[1] - means[0])
    assert np.all(np.abs(np.asarray(found.value) - means[1]) < 4 * np.asarray(found.error) + left)
    # Which is not what one patch a wall says.
    coarse = np.asarray(transport.direct(cube, cube.on_wall(4, 1.0), 0.7).value)
    assert np.max(np.abs(scores(found, coarse))) > 10


@pytest.mark.parametrize("rho", few([0.5, 0.9, 0.99], (0.9,)))
def test_integrating_sphere_and_furnace(rho):
    room = transport.sphere(4, 2)
    emission = np.array([1.0, 0, 0, 0.5, 0, 0, 0, 0])
    exact = emission + rho * np.mean(emission) / (1 - rho)
    found = transport.trace(room, emission, rho, key=KEY, paths=2**14)
    assert found.ok
    assert np.max(np.abs(scores(found, exact))) < 4.5
    assert np.max(found.error) < 0.03 * np.max(exact)
    furnace = transport.trace(transport.box((1.0, 2.0, 0.5)), 0.2, rho, key=KEY, paths=2**14)
    assert np.max(np.abs(scores(furnace, 0.2 / (1 - rho)))) < 4.5
    assert furnace.cost > 2**14


def test_reflectances_of_patches_and_of_the_brdf_multiply():
    room = transport.sphere(4, 2)
    rho = np.array([0.2, 0.9, 0.0, 1.1, 0.5, 0.7, 0.3, 0.6])
    emission = np.array([0.0, 0, 1, 0, 0, 0, 0, 0])
    exact = emission + 0.8 * rho * np.mean(emission) / (1 - np.mean(0.8 * rho))
    found = transport.trace(room, emission, rho, brdf=Lambert(0.8), key=KEY, paths=2**16)
    assert np.max(np.abs(scores(found, exact))) < 4.5
    assert np.asarray(found.value)[2] == 1  # black: its own light alone


def test_only_the_key_is_random():
    cube = transport.box()
    light = cube.on_wall(4, 1.0)
    first, again, other = (transport.trace(cube, light, 0.7, key=key, paths=4096) for key in (KEY, KEY, jax.random.key(8)))
    assert np.array_equal(first.value, again.value)
    assert not np.array_equal(first.value, other.value)


@pytest.mark.parametrize("rho", few([1.0, 1.01], (1.01,)))
def test_paths_that_would_never_end_are_refused(rho):
    cube = transport.box()
    found = transport.trace(cube, cube.on_wall(4, 1.0), rho, key=KEY)
    assert found.status is Status.DIVERGES
    assert np.all(np.isnan(found.value))
    assert found.cost == 0
    # With a lobe the angular operator says so: (n + 60) / 8 pi is far too much.
    wall = Normalized(BlinnPhong(3.0), Factor(60, 8 * np.pi))
    refused = transport.trace(transport.sphere(2), np.array([1.0, 0]), rho, brdf=wall, key=KEY, paths=4096)
    assert refused.status is Status.DIVERGES
    assert np.all(np.isnan(refused.value))


@pytest.mark.slow
def test_paths_under_way_and_a_radius_that_is_not_known():
    light = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
    sphere, wall = transport.sphere(4, 2), Normalized(Phong(3.0), PhongExact())
    still = transport.trace(sphere, light, 0.9, brdf=wall, key=KEY, paths=4096, max_bounces=2)
    assert still.status is Status.STILL_MOVING
    assert "allow more bounces" in still.message
    assert np.all(np.isnan(still.value))
    assert np.all(np.isinf(still.error))
    ended = transport.trace(sphere, light, 0.9, brdf=wall, key=KEY, paths=4096, max_bounces=2000)
    assert ended.ok
    assert ended.radius.lower > 0.5
    # One wall of a sphere above 1: the bounds are too far apart to say, and the value comes with that.
    unknown = transport.trace(
        sphere, light, [1.6, 1.6, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2], brdf=wall, key=KEY, paths=4096, max_bounces=2000
    )
    assert unknown.status in (Status.UNDECIDED, Status.HEAVY)
    assert np.all(np.isfinite(unknown.value))


# --- lobes ---


@pytest.mark.slow
@pytest.mark.parametrize("brdf", [entry("schlick-half", 6.0), CookTorrance(0.6)], ids=["lobe", "facets"])
def test_both_samplings_give_the_same_light(brdf):
    room = transport.sphere(4, 2)
    light = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
    lobe, cosine = (
        transport.trace(room, light, 0.8, brdf=brdf, key=KEY, paths=2**15, sampling=sampling) for sampling in ("lobe", "cosine")
    )
    assert lobe.ok
    spread = np.hypot(np.asarray(lobe.error), np.asarray(cosine.error))
    assert np.max(np.abs(np.asarray(lobe.value - cosine.value)) / spread) < 4.5
    # Energy: what all bounces together leave is the sum over the powers of the angular operator.
    operator = transport.angular_operator(brdf, nodes=96, azimuths=192)
    bounces = np.arange(400)
    evenly = np.asarray(operator.energy(bounces) @ (2 * operator.cos_theta * operator.weight))
    reflected = np.mean(light) * np.sum((0.8**bounces * evenly)[1:])
    total = float(room.mean(lobe.value - light))
    assert total == pytest.approx(reflected, abs=6 * float(np.linalg.norm(lobe.error)) / 8)


@pytest.mark.slow
def test_a_sharp_lobe_is_sampled_where_it_is():
    room = transport.sphere(4, 2)
    light = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
    brdf = Normalized(Phong(60.0), PhongExact())
    lobe, cosine = (
        transport.trace(room, light, 0.9, brdf=brdf, key=KEY, paths=2**15, sampling=sampling) for sampling in ("lobe", "cosine")
    )
    assert lobe.ok
    assert cosine.status is Status.HEAVY
    assert "sample by lobe" in cosine.message
    assert np.mean(cosine.error) > 4 * np.mean(lobe.error)


@pytest.mark.slow
@pytest.mark.parametrize("beam", [False, True])
def test_energy_after_bounces_is_that_of_the_angular_operator(beam):
    operator = published()
    powers = np.asarray(operator.energy(np.arange(17)))
    exact = powers[:, -1] if beam else powers @ np.asarray(2 * operator.cos_theta * operator.weight)
    found = transport.energy_after_bounces(transport.sphere(4, 2), PUBLISHED, 16, key=KEY, paths=2**16, beam=beam)
    z = (np.asarray(found.mean) - exact)[1:] / np.asarray(found.error)[1:]
    assert found.mean[0] == exact[0] == 1
    assert np.max(np.abs(z)) < 4.5
    assert np.all(found.error[1:] < 0.03 * found.mean[1:])
    if beam:  # the excess at normal incidence, in the first bounce
        assert exact[1] == pytest.approx(1.0752, abs=1e-4)
        assert exact[2] < 1


LOBES = [name for name in catalog.names() if catalog.entry(name).validated and len(catalog.entry(name).family.ranges) == 1]


@pytest.mark.slow
@pytest.mark.parametrize(("sampling", "name"), [*(("lobe", name) for name in LOBES), ("cosine", "phong"), ("cosine", "ggx")])
def test_paths_reflect_every_lobe_of_the_catalogue_as_its_angular_operator(name, sampling):
    ((low, high),) = catalog.entry(name).family.ranges.values()
    brdf = entry(name, 0.5 * (low + min(high, 12.0)))
    operator = transport.angular_operator(brdf)
    exact = np.asarray(operator.energy(np.arange(5)) @ (2 * operator.cos_theta * operator.weight))
    found = transport.energy_after_bounces(transport.sphere(4, 2), brdf, 4, key=KEY, paths=2**14, sampling=sampling)
    z = (np.asarray(found.mean) - exact)[1:] / np.asarray(found.error)[1:]
    assert np.max(np.abs(z)) < 4.5
    assert np.all(found.error[1:] < 0.05 * found.mean[1:])


@pytest.mark.slow
def test_a_box_keeps_less_than_the_sphere():
    """The largest radius of all enclosures is the sphere's: after many bounces a box has lost more, or as much."""
    found = transport.energy_after_bounces(transport.box(), PUBLISHED, 16, key=KEY, paths=2**16)
    rate = (found.mean[16] / found.mean[8]) ** (1 / 8)
    radius = published().spectral_radius().value
    assert rate < radius + 0.005
    assert rate > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_the_energy_between_diffuse_walls_is_left_to_rounding_only(dtype):
    """Lambert's lobe is the cosine: nothing scatters, whatever the sampling, and the error is that of the sums."""
    room, exact = transport.sphere(2, dtype=dtype), float(jnp.asarray(0.8, dtype)) ** np.arange(101)
    for sampling in ("lobe", "cosine"):
        found = transport.energy_after_bounces(room, Lambert(0.8), 100, key=KEY, paths=2**14, sampling=sampling)
        off = np.abs(np.asarray(found.mean, float) - exact)
        assert np.all(off <= 3 * np.asarray(found.error))
        assert np.all(np.asarray(found.error)[1:] <= 1e3 * np.finfo(dtype).eps * exact[1:])
        assert np.all(np.asarray(found.error)[1:] > np.finfo(dtype).eps * exact[1:])


# --- the ends of the catalogue ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("phong", value) for value in (0.01, 2e4, 1e5)),
        *(("blinn-phong", value) for value in (0.01, 1e5)),
        ("ggx", 0.05),
        ("schlick-mirror", 1000.0),
    ],
)
def test_what_conserves_is_never_said_to_diverge(name, value):
    brdf = entry(name, value)
    light = np.array([6.0, 0, 0, 0, 0, 0])
    found = transport.trace(transport.sphere(6), light, 0.9, brdf=brdf, key=KEY, paths=4096)
    assert found.ok, found.message
    # Schur's bound: the largest albedo. Rows of a lobe too narrow for the nodes add up to it all the same.
    assert found.radius.lower <= found.radius.upper <= 0.9 * (1 + 1e-12)
    for nodes in ({}, {"nodes": 96, "azimuths": 192}):
        operator = transport.angular_operator(brdf, **nodes)
        exact = brdfcheck.albedo(brdf, operator.cos_theta)
        assert np.asarray(operator.albedo()) == pytest.approx(np.asarray(exact.value), abs=1e-12)
        radius = operator.spectral_radius()
        mean_square = float(jnp.sum(2 * operator.weight * operator.cos_theta * exact.value**2))
        assert np.sqrt(mean_square) - 1e-7 <= radius.lower <= radius.upper <= float(jnp.max(exact.value + exact.error)) + 1e-12
        assert operator.energy([1000])[0, -1] <= 1 + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), [("phong", 3000.0), ("ggx", 0.05)])
def test_bounds_from_few_nodes_contain_the_radius_from_many(name, value):
    exact = transport.angular_operator(entry(name, value)).spectral_radius()
    for nodes in (24, 96):
        few = transport.angular_operator(entry(name, value), nodes=nodes, azimuths=2 * nodes).spectral_radius()
        assert few.lower <= exact.upper
        assert exact.lower <= few.upper
    assert exact.upper - exact.lower < 1e-6


def test_azimuths_of_needles():
    """A needle at either end of the half turn, of any width, and what is smooth: all by one rule."""
    phi, weight = angular._azimuths(512)
    assert np.sum(weight) == pytest.approx(np.pi, rel=1e-15)
    assert np.sum(weight * np.cos(3 * phi) ** 2) == pytest.approx(np.pi / 2, rel=1e-11)
    for width in (0.3, 1e-2, 1e-4, 1e-6):
        exact = np.sqrt(np.pi) / 2 * width
        assert np.sum(weight * np.exp(-((phi / width) ** 2))) == pytest.approx(exact, rel=1e-6)
        # Evenly spaced azimuths miss the narrow ones.
    even = (np.arange(512) + 0.5) * np.pi / 512
    assert np.sum(np.exp(-((even / 1e-4) ** 2))) * np.pi / 512 < 1e-10


@pytest.mark.slow
def test_a_function_of_your_own_and_one_that_is_not_reciprocal():
    brdf = Normalized(Phong(2e4), PhongExact())
    own = transport.angular_operator(lambda wi, wo: brdf(wi, wo), nodes=16, azimuths=64)
    assert np.asarray(own.albedo()) == pytest.approx(np.asarray(brdfcheck.albedo(brdf, own.cos_theta).value), abs=1e-6)
    assert own.reciprocal()
    one_way = transport.angular_operator(lambda wi, wo: (0.5 + wi[..., 2]) / np.pi, nodes=16, azimuths=64)
    assert not one_way.reciprocal()
    radius = one_way.spectral_radius()
    # (T h)(mu) = (0.5 + mu) 2 int h mu dmu: of rank one.
    assert radius.lower - 1e-9 <= 0.5 + 2 / 3 <= radius.upper + 1e-9


# --- the angular operator ---


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("phong", 300.0), ("ggx", 0.5),
        *(
            pytest.param(*row, marks=pytest.mark.slow)
            for row in (("phong", 1.0), ("blinn-phong", 1000.0), ("kuijk-blake-half", 20.0))
        ),
    ],
)  # fmt: skip
def test_the_angular_operator_has_the_albedo_of_its_brdf(name, value):
    brdf = entry(name, value)
    operator = transport.angular_operator(brdf)
    inside = np.asarray(operator.cos_theta) > 0.02  # nearer to grazing a fixed rule is not enough for needles
    off = np.abs(np.asarray(operator.albedo()) - np.asarray(brdfcheck.albedo(brdf, operator.cos_theta).value))
    assert np.max(off[inside]) < 2e-4
    radius = operator.spectral_radius()
    # Between the mean albedo (the quotient of the constant) and the largest one (Schur's bound).
    mean = float(jnp.sum(2 * operator.weight * operator.cos_theta * operator.albedo()))
    assert mean - 1e-9 <= radius.value <= float(jnp.max(operator.albedo())) + 1e-9


@pytest.mark.slow
def test_the_radius_against_an_eigensolver_and_lambert():
    operator = published()
    exact = np.max(np.abs(np.linalg.eigvals(np.asarray(operator.matrix))))
    found = operator.spectral_radius()
    assert found.lower - 1e-12 <= exact <= found.upper + 1e-12
    assert found.value == pytest.approx(0.7618235, abs=1e-6)
    assert transport.angular_operator(Lambert(0.37)).spectral_radius().value == pytest.approx(0.37, rel=1e-12)
    assert transport.angular_operator(entry("binomial-power-published", 17.85)).spectral_radius().upper < 0.71


def test_otherwise_loss_free_walls():
    # A lobe that conserves keeps its energy for ever.
    valid = transport.angular_operator(entry("blinn-phong-fitted", 8.76))
    for remainder in ("diffuse", "mirror"):
        operator = published().completed(remainder)
        assert np.asarray(operator.albedo()) == pytest.approx(np.maximum(np.asarray(published().albedo()), 1), abs=1e-12)
        radius = operator.spectral_radius()
        assert radius.lower > 1.0036
        late = operator.energy([1000, 1001])
        assert late[1, 0] / late[0, 0] == pytest.approx(float(radius.value), rel=1e-6)
        assert np.asarray(valid.completed(remainder).energy([10_000])) == pytest.approx(1, abs=1e-9)


# --- programs ---


@pytest.mark.slow
def test_float32_stays_float32():
    room = transport.sphere(2, 2, dtype=jnp.float32)
    found = transport.trace(room, [1.0, 0, 0, 0], 0.5, brdf=Normalized(Phong(5.0), PhongExact()), key=KEY, paths=4096)
    assert found.value.dtype == found.error.dtype == jnp.float32
    single = Normalized(Phong(jnp.float32(5)), Factor(jnp.float32(2), jnp.float32(2 * np.pi)))
    operator = transport.angular_operator(single)
    assert operator.matrix.dtype == jnp.float32
    assert operator.spectral_radius().value == pytest.approx(
        float(transport.angular_operator(Normalized(Phong(5.0), PhongExact())).spectral_radius().value), rel=1e-5
    )


@pytest.mark.slow
def test_no_number_recompiles():
    traces, first = [], 0

    class Listening(logging.Handler):
        def emit(self, record):
            if "jit(_walk)" in record.getMessage():
                traces.append(record.getMessage())

    listener = Listening()
    logging.getLogger("jax").addHandler(listener)
    try:
        for i, n in enumerate((3.0, 5.0, 9.0)):
            room, wall = transport.box((1.0, 1.0 + i, 1.0)), Normalized(Phong(n), PhongExact())
            with jax.log_compiles(True):
                transport.trace(
                    room, room.on_wall(0, 1.0 + i), 0.3 + 0.1 * i, brdf=wall, key=jax.random.key(i), paths=4096 * (i + 1),
                    max_bounces=100 + i,
                )  # fmt: skip
            first = len(traces) if i == 0 else first
    finally:
        logging.getLogger("jax").removeHandler(listener)
    assert first > 0
    assert len(traces) == first


@pytest.mark.parametrize(
    ("kind", "call", "says"),
    [
        (ValueError, lambda box: transport.trace(box, 1.0, 0.5, key=None), "key must be one key of jax.random.key; got None"),
        (ValueError, lambda box: transport.trace(box, 1.0, 0.5, key=3), "key must be one key of jax.random.key; got 3"),
        (ValueError, lambda box: transport.trace(box, 0.0, 0.5, key=KEY), "nothing emits"),
        (ValueError, lambda box: transport.trace(box, 1.0, -0.5, key=KEY), "reflectance must be finite and >= 0; got -0.5"),
        (ValueError, lambda box: transport.trace(box, 1.0, key=KEY, paths=0), "paths must be a whole number >= 1; got 0"),
        (ValueError, lambda box: transport.trace(box, 1.0, key=KEY, sampling="x"), "one of lobe, cosine; got 'x'"),
        (ValueError, lambda box: transport.trace(box, 1.0, key=KEY, equation="x"), "one of continuous, patches; got 'x'"),
        (
            ValueError,
            lambda box: transport.trace(box, 1.0, key=KEY, equation="patches", brdf=PUBLISHED),
            "the equation of patches is for diffuse walls",
        ),
        (ValueError, lambda box: transport.trace(box, 1.0, key=KEY, brdf=Lambert([0.1, 0.2])), "paths carry one channel"),
        (TypeError, lambda box: transport.trace(transport.cylinder(), 1.0, 0.5, key=KEY), "need a sphere or a box"),
        (TypeError, lambda box: transport.trace(box, 1.0, 0.5, key=KEY, brdf=lambda i, o: 1), "about an axis or one made of"),
        (ValueError, lambda box: transport.energy_after_bounces(box, PUBLISHED, 0, key=KEY), "bounces must be a whole number"),
        (ValueError, lambda box: transport.angular_operator(PUBLISHED, nodes=0), "nodes must be a whole number >= 1; got 0"),
        (TypeError, lambda box: transport.angular_operator(3), "must be callable"),
        (ValueError, lambda box: transport.angular_operator(Lambert()).completed("x"), "one of diffuse, mirror; got 'x'"),
        (ValueError, lambda box: transport.angular_operator(Lambert()).energy([2, 1]), "whole numbers >= 0 that rise"),
    ],
)
def test_wrong_arguments(kind, call, says):
    with pytest.raises(kind, match=says) as caught:
        call(transport.box())
    assert "\n" not in str(caught.value)
