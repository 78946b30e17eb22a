"""What a renderer can compute instead of looking it up: a table's albedo, average and split sum as small rational functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import ArrayLike, Float

from brdfcheck.fits.compensation import SMALLEST, Compensation
from brdfcheck.fits.grids import Sampler
from brdfcheck.fits.rational import RationalSurface, best_surface, lower_bound, rounded
from brdfcheck.fits.renderer import RendererTable, average_albedo
from brdfcheck.fits.surface import AlbedoFit, bounded, fit_albedo, fit_share, lobatto, within_one
from brdfcheck.numerics import averaging
from brdfcheck.runtime import double_precision

# By whether a cell is dear: values that are fitted, and those that the fit is measured on.
_SIZES = ((33, 129), (9, 17))
# Degrees of numerator and denominator of the average.
_DEGREE = (4, 2)
# Panels, and Gauss nodes in each, of an average of fitted values, which have an edge where they reach 1.
_PANELS, _NODES = 64, 3
# What a fit's error may be larger by between the points where it was measured, and what a program in float32 rounds.
_BETWEEN, _SINGLE = 1.02, 1e-5


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
    clamped: bool = False

    def __call__(self, parameter: Float[ArrayLike, "..."]) -> np.ndarray:
        """The average albedo; arguments outside of the range are moved to its ends."""
        x = np.clip(np.asarray(parameter, float), *self.bounds)
        v = ((1 / np.sqrt(x + 1) if self.root else x) - self.centre) * self.scale
        return bounded(self.surface(np.zeros_like(v), v), self.clamped)


@dataclass(frozen=True)
class CompensationFit:
    """The compensation of Kulla and Conty by the functions alone, so that it conserves.

    The albedo counts as `raised` above its function, at most 1, and the average of what is lost then as `margin` above its own
    function `lost`. `loss`: how much is still lost, at most on the grid of the table's compensation.
    """

    albedo: AlbedoFit
    lost: AverageFit
    raised: float
    margin: float
    loss: float = 0.0

    def __call__(self, parameter: np.ndarray, mu: np.ndarray) -> np.ndarray:
        """The albedo of what is added, at points."""
        numbers, which = np.unique(parameter, return_inverse=True)
        share = _lost(self.albedo, self.raised, numbers) / np.clip(self.lost(numbers) + self.margin, SMALLEST, 1)
        added = np.maximum(1 - self.raised - self.albedo(parameter, mu), 0) * share[which]
        return np.where(parameter < self.albedo.parameter_range[0], 0, added)


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
    compensation: CompensationFit | None = None

    @property
    def split_sum_error(self) -> float | None:
        """The error of the white albedo, where nothing exceeds 1, and that of the share together."""
        white = self.white or self.albedo
        return None if self.share is None else white.max_error + self.share.max_error * (1 + white.max_error)


def compact_fits(
    table: RendererTable, degree: tuple[int, int] | None = None, compensation: Compensation | None = None
) -> CompactFits:
    """The fits of a table's quantities, over the whole range from where there is a BRDF on.

    With the table's `compensation` also what it is by functions. `degree`, raises: as for `fit_albedo`.
    """
    found = table.sources
    share, white = None, None
    if table.bias is not None and found.white is not None and found.bias is not None:
        share = fit_share(found.white, found.bias, degree)
        white = None if found.white is found.family else fit_albedo(found.white, degree=degree)
    average = None
    if table.average is not None:
        family = found.family
        with double_precision():
            sizes = _SIZES[Sampler(family, None).albedo.effort > 1]
            average = _fit_average(table, lambda values: average_albedo(family, values), sizes)
    albedo = fit_albedo(found.family, degree=degree)
    added = None if compensation is None else _fit_compensation(table, albedo, compensation)
    return CompactFits(albedo, white, share, average, added)


def _fit_average(
    table: RendererTable, function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], sizes: tuple[int, int]
) -> AverageFit:
    """The fit of a function of the parameter, which gives values and bars."""
    family, parameter = table.sources.family, table.sources.parameter
    low, high = family.ranges[parameter]
    root = low >= 0 and high > 10
    with double_precision():
        few, many = (2, 1) if low == high else sizes  # a constant is p / q: two coefficients
        t = lobatto(few), np.linspace(0, 1, many)
        # Evenly in what the fit is a function of.
        ends = [1 / np.sqrt(end + 1) if root else end for end in (low, high)]
        x = ends[0] + (ends[1] - ends[0]) * np.concatenate(t)
        p = np.clip(1 / x**2 - 1 if root else x, low, high)
        order = np.argsort(p)
        values, bars = (part[np.argsort(order)] for part in function(p[order]))
        centre, scale = rounded(sum(ends) / 2), rounded(2 / abs(ends[1] - ends[0])) if low < high else 1.0
        v = (x - centre) * scale
        degree = _DEGREE if low < high else (0, 0)
        surface = best_surface(np.zeros(few), v[:few], values[:few], degree).surface
        if lower_bound(surface.denominator) <= 0:
            surface = best_surface(np.zeros(few), v[:few], values[:few], (sum(degree), 0)).surface
    fit = AverageFit(parameter, (low, high), root, centre, scale, surface, 0.0, many, within_one(values, bars))
    error = float(np.max(np.abs(fit(p[few:]) - values[few:]) + bars[few:]))
    return replace(fit, max_error=error)


def _fit_compensation(table: RendererTable, albedo: AlbedoFit, compensation: Compensation) -> CompensationFit:
    points, values = compensation.cover.seen
    held = points[:, 0] >= albedo.parameter_range[0]
    above = float(np.max((values - albedo(*points.T))[held]))
    raised = rounded(_BETWEEN * max(above, albedo.max_error) + _SINGLE)

    def lost(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _lost(albedo, raised, parameters), np.zeros(len(parameters))

    average = _fit_average(table, lost, _SIZES[0])
    fit = CompensationFit(albedo, average, raised, rounded(_BETWEEN * average.max_error + _SINGLE))
    return replace(fit, loss=compensation.cover.loss(fit))


def _lost(albedo: AlbedoFit, raised: float, parameters: np.ndarray) -> np.ndarray:
    """The averages of what is lost at these parameters where the albedo counts as `raised` above its fit."""
    mu, weights = averaging(_NODES, _PANELS)
    return np.maximum(1 - raised - albedo(parameters[:, None], mu), 0) @ weights
