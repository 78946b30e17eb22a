"""Enclosures: closed, reciprocal, balanced; their walls where their form factors say they are; open ones refused."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from brdfcheck import transport

CUBE = np.array(list(np.ndindex(2, 2, 2)), float)
# In the order of the walls of a box.
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TETRAHEDRON = (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float), [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])

ENCLOSURES = {
    "cube": lambda: transport.box(),
    "box": lambda: transport.box((1.0, 2.0, 0.5), (2, 3, 4)),
    "sphere": lambda: transport.sphere(5, 4, radius=2.0),
    "cylinder": lambda: transport.cylinder(0.5, 2.0, rings=3, bands=7),
    "polyhedron": lambda: transport.polyhedron(*TETRAHEDRON, divisions=2),
}


@pytest.mark.parametrize("name", few(ENCLOSURES, ("cube", "sphere", "cylinder")))
def test_closed_and_reciprocal(name):
    room = ENCLOSURES[name]()
    assert np.max(np.abs(np.sum(room.form_factors, axis=1) - 1)) < 4e-15
    exchange = np.asarray(room.areas)[:, None] * np.asarray(room.form_factors)
    assert np.max(np.abs(exchange - exchange.T)) < 1e-15
    assert np.min(exchange) >= 0
    before = room.balance
    assert max(before.reciprocity, before.row_sums, before.change) < (1e-5 if name == "polyhedron" else 1e-13)
    assert before.change <= room.uncertainty
    assert float(room.mean(jnp.ones(room.patches))) == pytest.approx(1, rel=1e-15)


def test_areas():
    assert np.sum(ENCLOSURES["box"]().areas) == pytest.approx(2 * (1 * 2 + 2 * 0.5 + 1 * 0.5))
    assert np.sum(ENCLOSURES["sphere"]().areas) == pytest.approx(16 * np.pi)
    assert np.sum(ENCLOSURES["cylinder"]().areas) == pytest.approx(2 * np.pi * 0.25 + 2 * np.pi * 0.5 * 2)
    assert np.sum(ENCLOSURES["polyhedron"]().areas) == pytest.approx(1.5 + np.sqrt(3) / 2)


def test_the_cube_of_the_facts():
    factors = np.asarray(transport.box().form_factors)
    assert factors[0] == pytest.approx([0, 0.1998248957, *[0.2000437761] * 4], abs=5e-11)
    assert factors[5, 4] == pytest.approx(0.1998248957, abs=5e-11)


@pytest.mark.slow
def test_polyhedra_agree_with_the_closed_forms():
    exact = transport.box(cells=2)
    found = transport.polyhedron(CUBE, FACES, divisions=2)
    # The quarters of a face are in another order: compare what each patch sees, sorted.
    assert np.max(np.abs(np.sort(found.form_factors) - np.sort(exact.form_factors))) < found.uncertainty < 1e-6
    whole = transport.polyhedron(CUBE, FACES, order=24)
    assert np.max(np.abs(whole.form_factors - transport.box().form_factors)) < whole.uncertainty < 1e-9


def test_cylinder_against_its_disks():
    can = transport.cylinder(1.0, 1.0)
    assert can.form_factors[0, 2] == pytest.approx(0.3819660, abs=5e-8)
    # The sum over the rings of a finer can is the disk of the coarse one.
    fine = transport.cylinder(1.0, 1.0, rings=6, bands=8)
    exchange = np.asarray(fine.areas)[:, None] * np.asarray(fine.form_factors)
    blocks = [slice(0, 6), slice(6, 14), slice(14, 20)]
    coarse = np.array([[np.sum(exchange[a, b]) for b in blocks] for a in blocks]) / np.asarray(can.areas)[:, None]
    assert coarse == pytest.approx(np.asarray(can.form_factors), abs=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "sphere"])
def test_rays_land_where_the_form_factors_say(name):
    """Cosine-distributed rays from evenly spread points of a patch: the frequencies of the patches they hit."""
    room = ENCLOSURES[name]()
    count = 60_000
    for patch in (0, room.patches // 2, room.patches - 1):
        draws = jax.random.uniform(jax.random.key(patch), (4, count))
        point, normal = room.point(jnp.full(count, patch, np.int32), draws[:2].T)
        ring, turn = jnp.sqrt(draws[2]), 2 * np.pi * draws[3]
        first = jnp.cross(normal, jnp.roll(normal, 1, axis=-1))
        first = first / jnp.linalg.norm(first, axis=-1, keepdims=True)
        direction = (
            (ring * jnp.cos(turn))[:, None] * first
            + (ring * jnp.sin(turn))[:, None] * jnp.cross(normal, first)
            + jnp.sqrt(1 - draws[2])[:, None] * normal
        )
        place, inwards, hit = room.hit(point, direction)
        share = np.bincount(np.asarray(hit), minlength=room.patches) / count
        expected = np.asarray(room.form_factors[patch])
        spread = np.sqrt(expected * (1 - expected) / count)
        assert np.all(np.abs(share - expected) < 4.5 * spread + 1e-12), patch
        # The ray meets the wall from its front, and the wall is where its patches are.
        assert np.all(np.sum(np.asarray(inwards * direction), axis=-1) < 1e-12)
        if name == "sphere":
            assert np.linalg.norm(np.asarray(place), axis=-1) == pytest.approx(2.0)
        else:
            off = np.minimum(np.abs(np.asarray(place)), np.abs(np.asarray(place) - np.asarray(room.size)))
            assert np.max(np.min(off, axis=-1)) < 1e-14


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box", "sphere"])
def test_a_point_of_a_patch_is_found_on_it(name):
    room = ENCLOSURES[name]()
    patch = jnp.arange(room.patches, dtype=np.int32)
    point, normal = room.point(patch, jnp.full((room.patches, 2), 0.37))
    # From straight across to the point: the ray arrives on the patch.
    other, _, _ = room.hit(point, normal)
    back, _, found = room.hit(other, -normal)
    assert np.array_equal(found, patch)
    assert np.max(np.abs(back - point)) < 1e-12


def test_on_wall():
    room = transport.box((1.0, 2.0, 0.5), (2, 3, 4))
    counts = [int(jnp.sum(room.on_wall(wall, 2.0) == 2)) for wall in range(6)]
    assert counts == [12, 12, 8, 8, 6, 6]
    assert float(jnp.sum(sum(room.on_wall(wall, 1.0) for wall in range(6)))) == room.patches
    assert float(jnp.sum(room.areas * room.on_wall(2, 1.0))) == pytest.approx(0.5)


def test_precision_is_chosen():
    room = transport.box(cells=3, dtype=jnp.float32)
    assert {leaf.dtype for leaf in jax.tree.leaves(room)} == {jnp.dtype("float32")}
    # Made in float64 and rounded once.
    exact = np.asarray(transport.box(cells=3).form_factors)
    assert np.max(np.abs(np.asarray(room.form_factors, float) - exact)) <= 2**-24 * np.max(exact)
    assert room.uncertainty >= np.finfo(np.float32).eps


def test_what_is_slightly_off_is_balanced_and_said():
    exact = np.asarray(transport.box(cells=2).form_factors)
    generator = np.random.default_rng(0)
    off = exact * (1 + 2e-4 * generator.uniform(-1, 1, exact.shape))
    room = transport.enclosure(off, np.ones(24))
    assert 1e-6 < room.balance.row_sums == pytest.approx(np.max(np.abs(np.sum(off, axis=1) - 1)), rel=1e-6)
    assert room.balance.reciprocity == pytest.approx(np.max(np.abs(off - off.T)))
    assert np.max(np.sum(np.abs(np.asarray(room.form_factors) - exact), axis=1)) < 2 * room.balance.change
    assert np.max(np.abs(np.sum(room.form_factors, axis=1) - 1)) < 4e-15
    # The balanced ones are nearer to the truth than those that were given.
    assert np.linalg.norm(room.form_factors - exact) < np.linalg.norm(off - exact)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (
            lambda: transport.polyhedron(CUBE, FACES[:-1]),
            "open along 4 edges, the first between the vertices 1 and 3: of what its walls send out, 0.2 escapes",
        ),
        (lambda: transport.polyhedron(CUBE, [face[::-1] for face in FACES]), "turn it: counterclockwise from outside"),
        (lambda: transport.polyhedron(CUBE, [*FACES[:-1], FACES[-1][::-1]]), "the same way: turn one of them"),
        (lambda: transport.polyhedron(CUBE, [*FACES[:-1], (1, 5, 7, 9)]), "a vertex that does not exist; there are 8"),
        (lambda: transport.polyhedron(CUBE, [*FACES[:-1], (1, 5, 5)]), "different vertex numbers"),
        (lambda: transport.polyhedron(CUBE, FACES, divisions=0), "divisions must be a whole number >= 1; got 0"),
        (
            lambda: transport.enclosure([[0, 0.8], [0.8, 0]], [1, 1]),
            r"the enclosure is open: of what leaves patch 0, 0.2 escapes \(row sum 0.8\), of all light 0.2",
        ),
        (lambda: transport.enclosure([[0.5, 0.7], [0.7, 0.5]], [1, 1]), "patch 0 sends out 1.2 times what leaves it"),
        (lambda: transport.enclosure([[0, 1], [1, 0]], [1, 2]), "for the patches 0 and 1 they are 1 and 2"),
        (lambda: transport.enclosure([[0, 1], [1, 0]], [1, -1]), "areas must be finite and > 0; got -1"),
        (lambda: transport.enclosure([[2, -1], [-1, 2]], [1, 1]), "form factors must be finite and >= 0; got -1"),
        (lambda: transport.enclosure([[0, 1]], [1]), r"must be \(patches, patches\)"),
        (lambda: transport.box((1, 1)), "size must be three lengths"),
        (lambda: transport.box((1, 0, 1)), "size must be finite and > 0; got 0"),
        (lambda: transport.box(cells=(1, 2)), r"cells must be one number or three; got \(1, 2\)"),
        (lambda: transport.box(cells=0), "cells must be a whole number >= 1; got 0"),
        (lambda: transport.box().on_wall(6, 1.0), "wall must be a whole number from 0 to 5; got 6"),
        (lambda: transport.sphere(0), "bands must be a whole number >= 1; got 0"),
        (lambda: transport.sphere(1), "at least 2 patches"),
        (lambda: transport.sphere(4, radius=-1), "radius must be finite and > 0; got -1"),
        (lambda: transport.cylinder(height=np.nan), "height must be finite and > 0; got nan"),
    ],
)
def test_wrong_arguments(call, says):
    with pytest.raises(ValueError, match=says) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_dent_is_refused():
    # A pyramid on a cube is convex no more where its tip is pushed in.
    corners = np.concatenate([CUBE, [[0.5, 0.5, 0.8]]])
    faces = [*FACES[:-1], (1, 5, 8), (5, 7, 8), (7, 3, 8), (3, 1, 8)]
    with pytest.raises(ValueError, match="it must be convex: all walls see each other"):
        transport.polyhedron(corners, faces)
    corners[-1, 2] = 1.3
    house = transport.polyhedron(corners, faces, order=8)
    assert house.patches == 9
    assert house.balance.row_sums < house.uncertainty
