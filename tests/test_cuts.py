"""Boxes are halved, and cut in four towards an end at which something sits."""

from __future__ import annotations

import numpy as np
import pytest

from brdfcheck.quadrature.boxes import Boxes
from brdfcheck.quadrature.cuts import Cuts, halvings_of, pieces_of


def one_box() -> Boxes:
    return Boxes(np.array([[1.0, 5.0]]), np.array([[8.0, 2.0]]), np.zeros((1, 9)))


@pytest.mark.parametrize(("piece", "ends"), [(0, [0, 1 / 8, 1 / 4, 1 / 2, 1]), (1, [0, 1 / 2, 3 / 4, 7 / 8, 1])])
def test_the_third_cut_towards_the_same_end_makes_four_pieces(piece: int, ends: list[float]):
    boxes, cuts, axis, error = one_box(), Cuts.none(1), np.array([0]), np.array([1.0])
    for _ in range(2):
        ways = cuts.ways(axis, error, 1e-3)
        assert (ways.item(), pieces_of(ways), halvings_of(ways)) == (0, 2, 1)
        boxes, cuts = cuts.applied(boxes, axis, error, ways)
        boxes, cuts, error = boxes.taken(np.array([piece])), cuts.taken(np.array([piece])), error / 2
    ways = cuts.ways(axis, error, 1e-3)
    assert (ways.item(), pieces_of(ways), halvings_of(ways)) == (2 * piece - 1, 4, 3)
    low, size = boxes.low[0], boxes.size[0]
    boxes, cuts = cuts.applied(boxes, axis, error, ways)
    np.testing.assert_allclose(boxes.low[:, 0], low[0] + size[0] * np.array(ends[:-1]))
    np.testing.assert_allclose(boxes.size[:, 0], size[0] * np.diff(ends))
    np.testing.assert_array_equal(boxes.low[:, 1], low[1])
    np.testing.assert_array_equal(boxes.size[:, 1], size[1])
    # The piece at that end goes on like that, the others begin anew.
    end = 3 * piece
    again = cuts.ways(np.zeros(4, int), error / 2, 1e-3)
    assert again[end] == 2 * piece - 1
    assert not np.any(np.delete(again, end))


def test_boxes_are_halved_where_that_helps_and_where_they_are_many():
    cuts = Cuts(np.array([[-5, 0]]), np.array([1.0]))
    axis = np.array([0])
    assert cuts.ways(axis, np.array([0.5]), 1e-3) == -1
    assert cuts.ways(axis, np.array([0.01]), 1e-3) == 0  # two more halvings leave 1e-6
    assert cuts.ways(axis, np.array([0.5]), 0.2) == 0
    assert cuts.ways(np.array([1]), np.array([0.5]), 1e-3) == 0  # across the other axis
    many = Cuts(np.tile(cuts.runs, (100, 1)), np.ones(100))
    assert not np.any(many.ways(np.zeros(100, int), np.full(100, 0.5), 1e-3))
