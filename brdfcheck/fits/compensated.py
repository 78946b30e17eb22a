"""`check` of a BRDF with its multiple-scattering compensation, by the albedos of the two parts."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.fits.compensation import Lookup
from brdfcheck.quadrature.frozen import Frozen
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.runtime import double_precision
from brdfcheck.verdict.report import Report, judge, reported
from brdfcheck.verdict.supremum import supremum

TOLERANCE = 1e-5
"""How far above 1 a compensated BRDF may reflect: cells are divided until what they hold is known to half of that."""
# The accuracy of the albedo of a function.
_RTOL = 1e-6


def checked(family: Family, added: Lookup) -> Report:
    """The verdict on the BRDFs of a family of one parameter with a compensation, by the search of `check`.

    `added`: the albedo of what is added, which is what a function of two directions would integrate to, but known by itself: so
    the albedo of the sum is as accurate as that of the family, and look-ups have their edges along the axes, which the search
    is told.
    """
    start = time.perf_counter()
    with double_precision():
        albedo = _Compensated(family, added)
        worst = supremum(
            albedo,
            threshold=1 + TOLERANCE,
            rtol=None if albedo.fast else _RTOL,
            intervals=False,
            effort="quick",
            axial=albedo.fast and albedo.single,
        )
    return reported(
        family,
        judge(worst.value, worst.error, TOLERANCE, least=worst.least, settled=worst.settled),
        worst,
        albedo,
        name=f"{family.name} with compensation",
        tolerance=TOLERANCE,
        seconds=time.perf_counter() - start,
        effort="quick",
    )


class _Compensated(PointwiseAlbedo):
    """The albedo of a family of one parameter, and of what is added to it."""

    def __init__(self, family: Family, added: Lookup):
        super().__init__(family)
        self._added = added

    @property
    def monotone(self) -> bool:
        """What holds of the family holds no longer."""
        return False

    @functools.cached_property
    def bounded(self) -> bool:
        """Nor does this."""
        return False

    @property
    def single(self) -> bool:
        """True where there are no channels, of which one or another may be the largest."""
        ((low, _),) = self.family.ranges.values()
        return super().channels(np.array([[low]]), np.ones(1), np.zeros(1))[0].ndim == 1

    def channels(
        self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, *, rtol: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        return self.more(super().channels(parameters, cos_theta, azimuth, rtol=rtol), parameters, cos_theta)

    def estimated_channels(
        self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, level: int, *, both: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        found = super().estimated_channels(parameters, cos_theta, azimuth, level, both=both)
        return self.more(found, parameters, cos_theta)

    def frozen(self, parameters: np.ndarray, cos_theta: float, azimuth: float, rtol: float) -> Frozen:
        return _Frozen(self, parameters, cos_theta, azimuth, rtol)

    def more(
        self, found: tuple[np.ndarray, np.ndarray], parameters: np.ndarray, cos_theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values and errors with what is added."""
        value, error = found
        added = self._added(parameters[:, 0], cos_theta)
        return value + added.reshape(added.shape + (1,) * (value.ndim - 1)), error


class _Frozen(Frozen):
    """The same beside a place."""

    def __init__(self, albedo: _Compensated, parameters: np.ndarray, cos_theta: float, azimuth: float, rtol: float):
        super().__init__(albedo, parameters, cos_theta, azimuth, rtol)
        self._more: Callable[..., Any] = albedo.more
        (self.value,), (self.error,) = self._more(
            (np.array([self.value]), np.array([self.error])), parameters[None], np.array([cos_theta])
        )

    def __call__(self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._more(super().__call__(parameters, cos_theta, azimuth), parameters, cos_theta)
