"""What scans see of a BRDF's values on their way: the smallest, and those that are not finite."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

# The cosine of a direction above which the sign of a value is not that of a rounding.
_STEEP = 1e-5


class Place(NamedTuple):
    """Where a value of the BRDF was seen, parameters and directions, and the value."""

    parameters: tuple[float, ...]
    wi: tuple[float, ...]
    wo: tuple[float, ...]
    value: float


@dataclass
class Seen:
    """What the scans saw of a function's values on the way: the smallest, and those that are not finite."""

    smallest: Place | None = None
    nonfinite: int = 0
    values: int = 0
    first_nonfinite: Place | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def note(
        self, parameters: np.ndarray, wi: np.ndarray, wo: np.ndarray, values: np.ndarray, finite: np.ndarray, weight: np.ndarray
    ) -> np.ndarray:
        """Keep what a piece of a scan says of the BRDF itself: (rows, ...) each, see `Evaluator.sums`.

        Returns the rows of which most is not finite: their sums are none.
        """

        def place(index: tuple[np.intp, ...], value: float) -> Place:
            row, node, _ = index
            return Place(tuple(parameters[row].tolist()), tuple(wi[row].tolist()), tuple(wo[row, :, node].tolist()), value)

        with self._lock:
            # Where both directions graze, rounding alone makes a sign: such pairs are for the side checks, which know of it.
            told = (np.minimum(wi[:, None, 2], wo[:, 2]) > _STEEP)[..., None]
            low = np.unravel_index(np.argmin(np.where(told, values, 0)), values.shape)
            if told[low[:2]] and values[low] < 0 and (self.smallest is None or values[low] < self.smallest.value):
                self.smallest = place(low, float(values[low]))
            broken = ~finite & (weight > 0)[..., None]
            if np.any(broken):
                self.nonfinite += int(np.count_nonzero(broken))
                self.first_nonfinite = self.first_nonfinite or place(
                    np.unravel_index(np.argmax(broken), broken.shape), float("nan")
                )
        return np.flatnonzero(np.count_nonzero(broken.any(axis=2), axis=1) > np.count_nonzero(weight > 0, axis=1) / 2)
