"""How far a table may be trusted at all angles, and what its samples leave open: see `brdfcheck.quadrature.samples`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from brdfcheck.brdf.tables import AbstractTable
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.samples import NODES, TIMES, albedos, compared
from brdfcheck.verdict.supremum import Supremum

# Cosines of incidence (of an isotropic table, of an anisotropic one) and azimuths at which they are compared.
_COSINES, _TURNS = (65, 17), 8
# How many channels are searched, and at how many cosines it is seen which reflect most.
_CHANNELS, _COARSE = 8, 9


@dataclass(frozen=True)
class Doubt:
    """What is not known of the albedo of a table, because its values are known at samples only.

    `linear` and `nearest` are the albedos by the two look-ups at the worst place, by one rule; `quadrature` is what the bar of
    the report holds besides `TIMES` their difference. `reach`: what the albedo may be at any angle, with the bar there;
    `reach_cos_theta`: where. `layout`: what the samples are; `missing` of `samples` have no data, most of them `where`.
    `filled`: what the albedo may be where these have a value that errs on the high side, `guess` (None: all have data).
    `channel`: what the worst channel is called, nothing where that is known.
    """

    layout: str
    quadrature: float
    linear: float
    nearest: float
    reach: float
    reach_cos_theta: float
    samples: int
    missing: int
    where: str
    guess: str
    filled: float | None
    channel: str

    @property
    def most(self) -> float:
        """What the albedo may be at any angle, whatever the samples without data are."""
        return self.reach if self.filled is None else max(self.reach, self.filled)

    @property
    def findings(self) -> list[str]:
        """What is wrong with the data."""
        if not self.missing:
            return []
        share = 100 * self.missing / self.samples
        return [
            f"no data: {self.missing} of the {self.samples} samples that a light and a viewer above the surface can meet"
            f" ({share:.2g} %), {self.where}. They count as 0, so that the albedo is a lower bound; with {self.guess} in their"
            f" place it may reach {self.filled:.4g}"
        ]

    @property
    def notes(self) -> list[str]:
        """What the error bar holds, and what the worst channel is called."""
        angle = np.degrees(np.arccos(self.reach_cos_theta))
        channel = [f"the channel is {self.channel}"] if self.channel else []
        return [
            f"a table ({self.layout}): the albedo there is {self.linear:.6g} by linear and {self.nearest:.6g} by nearest"
            f" look-up; the error bar holds {TIMES} times their difference and {self.quadrature:.2g} of the quadrature. With"
            f" such bars it may reach {self.reach:.4g}, at {angle:.3g} deg",
            *channel,
        ]


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
