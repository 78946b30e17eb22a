"""The table of integrals with known values: lobes by the names of `references/zonal.csv`, and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from _instruments.stability import references
from brdfcheck.brdf.microfacet import GGX, CookTorrance

REFERENCES = Path(__file__).parent / "references"

LOBES = {
    name: references.LOBES[name]
    for name in (
        "phong", "blinn", "schlick", "schlick_half", "kb", "kb_half", "lyon1", "lyon2", "lyon3", "lyon1_mirror", "lyon2_mirror",
        "lyon3_mirror", "lyon4_mirror", "binomial8", "binomial16", "binomial16_mirror", "binomial16_unclamped",
        "binomial16_mirror_unclamped",
    )
}  # fmt: skip


def rows(name: str) -> Any:
    """A file of references, each column by its name."""
    return np.genfromtxt(REFERENCES / name, delimiter=",", names=True, dtype=None, encoding="utf-8").view(np.recarray)


def zonal_tables() -> dict[str, Any]:
    """Ball-arithmetic values by lobe name: n, cos_theta, albedo."""
    found = rows("zonal.csv")
    return {str(name): found[found.lobe == name] for name in np.unique(found.lobe)}


def facet_tables() -> dict[tuple[str, str, float], Any]:
    """Slope-space values by (distribution, masking, f0): m, cos_theta, albedo."""
    found = rows("microfacet.csv")
    kinds = found[["distribution", "masking", "f0"]]
    return {kind.item(): found[kinds == kind] for kind in np.unique(kinds)}


def facet_lobe(distribution: str, masking: str, f0: float) -> Callable[[Any], Any]:
    """m -> BRDF for a key of `facet_tables`."""
    if distribution == "beckmann":
        return lambda m: CookTorrance(m, f0, masking=masking)
    return lambda m: GGX(m, f0, masking=masking)


PHONG_POLYNOMIALS: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    # (n+2)/(2 pi) times the albedo at even n is a polynomial in mu = cos theta.
    2: lambda mu: (1 + mu) ** 2 / 4,
    4: lambda mu: 3 / 16 + mu / 2 + 3 * mu**2 / 8 - mu**4 / 16,
    6: lambda mu: 5 / 32 + mu / 2 + 15 * mu**2 / 32 - 5 * mu**4 / 32 + mu**6 / 32,
}


def slope_at_normal(values: Callable[[np.ndarray], Any], reach: float = 0.3) -> float:
    """dE/dcos(theta) at normal incidence from values alone: a polynomial in theta, odd powers included, up to `reach`."""
    theta = reach * (1 - np.cos(np.pi * np.arange(33) / 32)) / 2
    series = np.polynomial.chebyshev.Chebyshev.fit(theta, np.asarray(values(np.cos(theta))), 16)
    return -float(series.deriv(2)(0.0))


def brute_force(brdf: Callable[..., Any], cos_theta: float, azimuth: float = 0.0, count: int = 500) -> float:
    """A plain product rule over the hemisphere of wo: knows neither kinks nor lobes. Good to about 1e-5 for wide lobes."""
    x, w = np.polynomial.legendre.leggauss(count)
    z = (x + 1) / 2
    phi = 2 * np.pi * (np.arange(count) + 0.5) / count
    sine = np.sqrt(1 - z**2)
    wo = np.stack(np.broadcast_arrays(sine[:, None] * np.cos(phi), sine[:, None] * np.sin(phi), z[:, None] + 0 * phi), axis=-1)
    s = np.sqrt(1 - cos_theta**2)
    wi = np.array([s * np.cos(azimuth), s * np.sin(azimuth), cos_theta])
    values = np.asarray(eqx.filter_jit(brdf)(jnp.asarray(wi), jnp.asarray(wo)))
    return float(np.sum(w[:, None] / 2 * values * z[:, None]) * 2 * np.pi / count)
