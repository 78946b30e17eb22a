"""Where the boxes of an adaptive integral are cut: in half, or towards an end at which something sits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brdfcheck.numerics import Columns
from brdfcheck.quadrature.boxes import Boxes

# Cut in half; or in four, towards the lower end: each piece half as long as the one before, which stands for so many halvings.
_HALVES, _TOWARDS = np.array([0, 0.5, 1]), np.array([0, 0.125, 0.25, 0.5, 1])
_HALVINGS = 3
# In how many cuts in a row it must have been the same end; and in how large a round values cost more than the round itself.
_STREAK, _FEW = 2, 16


@dataclass(frozen=True)
class Cuts(Columns):
    """How boxes came to be, which says how they are cut next."""

    # (boxes, 2): how often in a row each was the lower (negative) or the upper piece of a cut across either axis.
    runs: np.ndarray
    # (boxes,): how large the error was of the box of which it is a piece.
    error: np.ndarray

    @classmethod
    def none(cls, count: int) -> Cuts:
        """Of boxes that were not cut."""
        return cls(np.zeros((count, 2), int), np.full(count, np.inf))

    def ways(self, axis: np.ndarray, error: np.ndarray, enough: float) -> np.ndarray:
        """In which way to cut across axes (boxes,) where errors are so large: 0 in half, -1 and 1 in four towards an end.

        In four where halving would have to be done again and again to bring the error below `enough`.
        """
        run = self.runs[np.arange(len(axis)), axis]
        left = error * np.minimum(error / self.error, 1) ** (_HALVINGS - 1)  # if halving helps as much as it did
        return np.where((np.abs(run) >= _STREAK) & (left > enough) & (len(axis) <= _FEW), np.sign(run), 0)

    def applied(self, boxes: Boxes, axis: np.ndarray, error: np.ndarray, ways: np.ndarray) -> tuple[Boxes, Cuts]:
        """The pieces of boxes that are cut in these ways."""
        run = self.runs[np.arange(len(axis)), axis]
        parts = []
        for way, stops, after in (
            (0, _HALVES, (np.minimum(run, 0) - 1, np.maximum(run, 0) + 1)),
            (-1, _TOWARDS, (run - _HALVINGS, 0 * run, 0 * run, 0 * run)),
            (1, 1 - _TOWARDS[::-1], (0 * run, 0 * run, 0 * run, run + _HALVINGS)),
        ):
            some = np.flatnonzero(ways == way)
            runs = np.tile(self.runs[some], (len(after), 1))
            runs[np.arange(len(runs)), np.tile(axis[some], len(after))] = np.stack(after)[:, some].ravel()
            parts.append((boxes.taken(some).pieces(axis[some], stops), Cuts(runs, np.tile(error[some], len(after)))))
        pieces, cuts = zip(*parts, strict=True)
        return pieces[0].joined(*pieces[1:]), cuts[0].joined(*cuts[1:])


def pieces_of(ways: np.ndarray) -> np.ndarray:
    """How many pieces the ways of cutting make."""
    return np.where(ways == 0, len(_HALVES), len(_TOWARDS)) - 1


def halvings_of(ways: np.ndarray) -> np.ndarray:
    """For how many halvings each way stands."""
    return np.where(ways == 0, 1, _HALVINGS)
