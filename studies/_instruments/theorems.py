"""The figure of docs/proofs.md: the limacon of the theorem on normal incidence, and the boxes of a proof."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import Any

import numpy as np

from brdfcheck.plots import paper, to_bytes
from brdfcheck.proof.cover import BELOW, Claim, LinearFactor, cover
from brdfcheck.proof.intervals import lower, upper
from brdfcheck.proof.lobes import TruncatedPower

PALETTE = ("#0072B2", "#D55E00")


def picture() -> bytes:
    """Both panels as a PNG."""
    with paper.house_style():
        figure = paper.empty(8.2, 4.2)
        left, right = figure.subplots(1, 2)
        _limacon(left)
        _boxes(right)
    return to_bytes(figure, ".png")


def _limacon(axes: Any) -> None:
    """Where the cap of half vectors around N sends light from theta, projected on the surface."""
    cap, theta = 30.0, 70.0
    phi, half, angle = np.linspace(-np.pi, np.pi, 1001), np.radians(cap), np.radians(theta)
    radius = 2 * np.sin(half) * (np.cos(half) * np.cos(angle) + np.sin(half) * np.sin(angle) * np.cos(phi))
    x, y = radius * np.cos(phi) - np.sin(angle), radius * np.sin(phi)
    above = radius * np.cos(half) >= np.sin(half) * np.cos(angle)  # N.V = 2 (L.H) cos G - cos theta
    axes.plot(np.cos(phi), np.sin(phi), color="0.6", linewidth=0.8)
    axes.text(-0.7, 0.76, "horizon", color="0.4", ha="right")
    axes.plot(np.sin(2 * half) * np.cos(phi), np.sin(2 * half) * np.sin(phi), color=PALETTE[0], label="along the normal")
    axes.plot(np.where(above, x, np.nan), np.where(above, y, np.nan), color=PALETTE[1], label=f"from {theta:g} degrees")
    axes.plot(
        np.where(above, np.nan, x), np.where(above, np.nan, y), color=PALETTE[1], linestyle=":", label="below the horizon"
    )
    axes.set(aspect="equal", xlabel="x of V", ylabel="y of V", title=f"V for all H within {cap:g} degrees of N")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncol=1)


def _boxes(axes: Any) -> None:
    """The albedo with the published factor, and what its proof knows of it on each box."""
    claim = Claim(TruncatedPower("half", 16), LinearFactor(Fraction(6), Fraction("24.55")))
    low, high = 0.81, 1.02
    for piece in cover(claim, Fraction(1), Fraction(1000)):
        below = piece.side == BELOW
        for a, b in itertools.pairwise(piece.nodes):
            e, f, g = map(claim.profile.albedo, (a, (a + b) / 2, b))
            if below:  # Bernstein's coefficients
                mixed = (claim.gain(a) * g + claim.gain(b) * e) * Fraction(1, 2)
                bound = max(map(upper, (claim.albedo(a), mixed, claim.albedo(b))))
            else:
                values = (claim.gain(a) * (2 * f - g), claim.albedo((a + b) / 2), claim.gain(b) * (2 * f - e))
                bound = min(map(lower, values))
            look = {"color": PALETTE[0 if below else 1], "alpha": 0.3, "linewidth": 0.6}
            axes.fill_between([float(a), float(b)], float(bound), low if below else high, **look)
        if piece.onwards:  # by one test
            axes.fill_between([float(piece.nodes[-1]), 1000], 1.0, low, color=PALETTE[0], alpha=0.3, linewidth=0.6)
    n = np.geomspace(1, 1000, 400)
    axes.plot(n, [float(upper(claim.albedo(Fraction(x)))) for x in n], color="k", linewidth=1, label="the albedo")
    axes.axhline(1, color="black", linewidth=0.6)
    axes.fill_between([], [], [], color=PALETTE[0], alpha=0.3, label="it is proved to lie in here, up to 1")
    axes.fill_between([], [], [], color=PALETTE[1], alpha=0.3, label="it is proved to lie in here, above 1")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncol=1)
    axes.set(xscale="log", ylim=(low, high), xlabel="n", ylabel="albedo along the normal", title="(n + 6)/24.55: proved boxes")
    axes.set_xticks((1, 10, 100, 1000), ("1", "10", "100", "1000"))
    axes.minorticks_off()
