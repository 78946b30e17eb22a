"""What a renderer can compute instead of looking it up: a table's albedo, average and split sum as small rational functions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from brdfcheck.fits.compensation import SMALLEST, Compensation
from brdfcheck.fits.rational import rounded
from brdfcheck.fits.renderer import RendererTable, average_albedo
from brdfcheck.fits.surface import AlbedoFit, fit_albedo, fit_row, fit_share
from brdfcheck.numerics import averaging

# Panels, and Gauss nodes in each, of an average of fitted values, which have an edge where they reach 1.
_PANELS, _NODES = 64, 3
# What a fit's error may be larger by between the points where it was measured, and what a program in float32 rounds.
_BETWEEN, _SINGLE = 1.02, 1e-5


@dataclass(frozen=True)
class CompensationFit:
    """The compensation of Kulla and Conty by the functions alone, so that it conserves.

    The albedo counts as `raised` above its function, at most 1, and the average of what is lost then as `margin` above its own
    function `lost`. `loss`: how much is still lost, at most on the grid of the table's compensation.
    """

    albedo: AlbedoFit
    lost: AlbedoFit
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
    white: AlbedoFit | None = None
    share: AlbedoFit | None = None
    average: AlbedoFit | None = None
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
        average = fit_row(found.family, lambda parameters: average_albedo(found.family, parameters))
    albedo = fit_albedo(found.family, degree=degree)
    added = None if compensation is None else _fit_compensation(table, albedo, compensation)
    return CompactFits(albedo, white, share, average, added)


def _fit_compensation(table: RendererTable, albedo: AlbedoFit, compensation: Compensation) -> CompensationFit:
    points, values = compensation.cover.seen
    held = points[:, 0] >= albedo.parameter_range[0]
    above = float(np.max((values - albedo(*points.T))[held]))
    raised = rounded(_BETWEEN * max(above, albedo.max_error) + _SINGLE)

    def lost(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _lost(albedo, raised, parameters), np.zeros(len(parameters))

    average = fit_row(table.sources.family, lost, cheap=True)
    fit = CompensationFit(albedo, average, raised, rounded(_BETWEEN * average.max_error + _SINGLE))
    return replace(fit, loss=compensation.cover.loss(fit))


def _lost(albedo: AlbedoFit, raised: float, parameters: np.ndarray) -> np.ndarray:
    """The averages of what is lost at these parameters where the albedo counts as `raised` above its fit."""
    mu, weights = averaging(_NODES, _PANELS)
    return np.maximum(1 - raised - albedo(parameters[:, None], mu), 0) @ weights
