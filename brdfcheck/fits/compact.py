"""What a renderer can compute instead of looking it up: a table's albedo, average and split sum as small rational functions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import ArrayLike, Float

from brdfcheck.fits.grids import Sampler
from brdfcheck.fits.rational import RationalSurface, best_surface, lower_bound, rounded
from brdfcheck.fits.renderer import RendererTable, average_albedo
from brdfcheck.fits.surface import AlbedoFit, fit_albedo, fit_share
from brdfcheck.runtime import double_precision

# By whether a cell is dear: values that are fitted, and those that the fit is measured on.
_SIZES = ((33, 129), (9, 17))
# Degrees of numerator and denominator of the average.
_DEGREE = (4, 2)


@dataclass(frozen=True)
class AverageFit:
    """The average albedo as a rational function of v = (x - centre) scale, with x = 1/sqrt(parameter + 1) where `root`.

    `max_error`: the largest error on `checked` values of the range, with the bar of the average.
    """

    parameter: str
    bounds: tuple[float, float]
    root: bool
    centre: float
    scale: float
    surface: RationalSurface
    max_error: float
    checked: int

    def __call__(self, parameter: Float[ArrayLike, "..."]) -> np.ndarray:
        """The average albedo; arguments outside of the range are moved to its ends."""
        x = np.clip(np.asarray(parameter, float), *self.bounds)
        v = ((1 / np.sqrt(x + 1) if self.root else x) - self.centre) * self.scale
        return self.surface(np.zeros_like(v), v)


@dataclass(frozen=True)
class CompactFits:
    """`albedo` of the target, its `average`, and the `share` of the bias in the albedo `white` of the target with F = 1.

    `white` is None where it is `albedo`; `average` and `share` where the table has none. With S the share, the bias is S times
    the white albedo, the scale 1 - S times it, and both are off by `split_sum_error` at most.
    """

    albedo: AlbedoFit
    white: AlbedoFit | None
    share: AlbedoFit | None
    average: AverageFit | None

    @property
    def split_sum_error(self) -> float | None:
        """The error of the white albedo, where nothing exceeds 1, and that of the share together."""
        white = self.white or self.albedo
        return None if self.share is None else white.max_error + self.share.max_error * (1 + white.max_error)


def compact_fits(table: RendererTable, degree: tuple[int, int] | None = None) -> CompactFits:
    """The fits of a table's quantities, over the whole range from its first node on. `degree`, raises: as for `fit_albedo`."""
    found = table.sources
    share, white = None, None
    if table.bias is not None and found.white is not None and found.bias is not None:
        share = fit_share(found.white, found.bias, degree)
        white = None if found.white is found.family else fit_albedo(found.white, degree=degree)
    average = _fit_average(table) if table.average is not None else None
    return CompactFits(fit_albedo(found.family, degree=degree), white, share, average)


def _fit_average(table: RendererTable) -> AverageFit:
    family, parameter = table.sources.family, table.sources.parameter
    low, high = family.ranges[parameter]
    root = low >= 0 and high > 10
    with double_precision():
        few, many = (1, 1) if low == high else _SIZES[Sampler(family, None).albedo.effort > 1]
        t = (1 - np.cos(np.pi * np.arange(few) / max(few - 1, 1))) / 2, np.linspace(0, 1, many)
        # Evenly in what the fit is a function of.
        ends = [1 / np.sqrt(end + 1) if root else end for end in (low, high)]
        x = ends[0] + (ends[1] - ends[0]) * np.concatenate(t)
        p = np.clip(1 / x**2 - 1 if root else x, low, high)
        order = np.argsort(p)
        found = average_albedo(family, p[order])
        values, bars = (part[np.argsort(order)] for part in found)
        centre, scale = rounded(sum(ends) / 2), rounded(2 / abs(ends[1] - ends[0])) if low < high else 1.0
        v = (x - centre) * scale
        degree = _DEGREE if low < high else (0, 0)
        surface = best_surface(np.zeros(few), v[:few], values[:few], degree).surface
        if lower_bound(surface.denominator) <= 0:
            surface = best_surface(np.zeros(few), v[:few], values[:few], (sum(degree), 0)).surface
    fit = AverageFit(parameter, (low, high), root, centre, scale, surface, 0.0, many)
    error = float(np.max(np.abs(fit(p[few:]) - values[few:]) + bars[few:]))
    return replace(fit, max_error=error)
