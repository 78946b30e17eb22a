"""How far a table may be trusted at all angles, and what its samples leave open: see `brdfcheck.quadrature.samples`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from brdfcheck.brdf.tables import AbstractTable
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.samples import NODES, albedos, compared
from brdfcheck.verdict.parts import Doubt
from brdfcheck.verdict.supremum import Supremum

# Cosines of incidence (of an isotropic table, of an anisotropic one) and azimuths at which they are compared.
_COSINES, _TURNS = (65, 17), 8
# How many channels are searched, and at how many cosines it is seen which reflect most.
_CHANNELS, _COARSE = 8, 9


def searched(albedo: PointwiseAlbedo) -> tuple[PointwiseAlbedo, list[int]]:
    """The albedo that is worth a search, and which channels that is of: of many (spectra), the few that reflect most."""
    channels = 1 if albedo.evaluator is None else albedo.evaluator.channels or 1
    if albedo.table is None or channels <= _CHANNELS:
        return albedo, list(range(channels))
    highest = albedos(albedo, *_angles(albedo, _COARSE), NODES[1]).mean(axis=-1).max(axis=0)
    chosen = sorted(np.argsort(-highest)[:_CHANNELS].tolist())
    return albedo.reading(albedo.table.of_channels(chosen)), chosen


def doubted(albedo: PointwiseAlbedo, table: AbstractTable, worst: Supremum) -> tuple[Supremum, Doubt]:
    """The largest albedo with a bar that holds both look-ups, and what that is made of and leaves open at all angles."""
    mu, azimuth = _angles(albedo, _COSINES[albedo.anisotropic])
    places = np.append(worst.cos_theta, mu), np.append(worst.azimuth, azimuth)
    linear, nearest, bar = compared(albedo, *places)
    high, low = linear.mean(axis=-1) + bar, linear.mean(axis=-1) - bar
    # The worst place is the first, and of each place the worst channel counts.
    own = int(np.argmax(linear[0].mean(axis=-1)))
    error = worst.error + float(bar[0, own])
    reach = np.max(high, axis=1)
    reach[0] = max(reach[0], worst.value + error)
    least = max(worst.value - error, float(np.max(low)))
    guess, filled = table.filled(), None
    if guess is not None:
        filled = max(float(np.max(albedos(albedo.reading(guess), *places).mean(axis=-1) + bar)), worst.value + error)
    widest, samples = int(np.argmax(reach)), table.samples
    return replace(worst, error=error, least=least), Doubt(
        layout=samples.layout,
        quadrature=worst.error,
        linear=float(linear[0, own].mean()),
        nearest=float(nearest[0, own].mean()),
        reach=float(reach[widest]),
        reach_cos_theta=float(places[0][widest]),
        samples=samples.count,
        missing=samples.missing,
        where=samples.where,
        guess=samples.guess,
        filled=filled,
        channel=samples.channels[own] if samples.channels else "",
    )


def _angles(albedo: PointwiseAlbedo, count: int) -> tuple[np.ndarray, np.ndarray]:
    """So many cosines, dense at both ends, with the azimuths that matter: (places,) both."""
    low, high = albedo.family.cos_theta
    turns = _TURNS if albedo.anisotropic else 1
    cosines = low + (high - low) * np.sin(np.linspace(0, np.pi / 2, count)) ** 2
    mu, azimuth = np.meshgrid(cosines, np.arange(turns) * 2 * np.pi / turns, indexing="ij")
    return mu.ravel(), azimuth.ravel()
