"""float32 beside float64: how far values and albedos of single precision are off, and what naive formulas lose in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe
from brdfcheck.brdf.lobes import BinomialPower, Phong
from brdfcheck.quadrature import albedo as directional

# Values count from this share of the largest on: below, a relative error means nothing to an eye.
_SEEN = 1e-4
_DARK = 1 / 255


def distinct() -> list[str]:
    """The catalogue's entries with a lobe of their own: of those that differ by their factor only, the first."""
    found: dict[Any, str] = {}
    for entry in (entry for entry in catalog.entries() if entry.family.surface is None):
        values = {name: (low + high) / 2 for name, (low, high) in entry.family.ranges.items()}
        core = entry.family.build(**values).core
        if getattr(core, "convention", "") != "published":  # Cook-Torrance as printed is four times the other
            found.setdefault(jax.tree.structure(core), entry.name)
    return list(found.values())


def both(brdf: AbstractBRDF) -> tuple[Any, Any]:
    """The lobe of a BRDF, without its factors, in float32, and in float64 with the same numbers."""
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), brdf.core)
    return single, jax.tree.map(lambda leaf: leaf.astype(jnp.float64), single)


def profile_error(single: Any, double: Any) -> float:
    """The largest relative error of the values of `single` where they are at least 1e-4 of the largest.

    Lobes about an axis are compared at versines, microfacet lobes at pairs of directions about their facets.
    """
    if isinstance(single, AbstractZonalLobe):
        versine = np.geomspace(1e-9, 1, 20_001).astype(np.float32)
        arguments = (versine,)
        functions = single.profile, double.profile
    else:
        random = np.random.default_rng(1)
        tilt, turn, theta = (random.random(20_000) for _ in range(3))
        tangent, theta = float(double.width()) * np.sqrt(-np.log1p(-tilt)), theta * np.pi / 2
        half = np.stack([tangent * np.cos(2 * np.pi * turn), tangent * np.sin(2 * np.pi * turn), np.ones_like(turn)], -1)
        half /= np.linalg.norm(half, axis=-1, keepdims=True)
        wi = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], -1)
        wo = 2 * np.sum(wi * half, -1, keepdims=True) * half - wi
        arguments = wi.astype(np.float32), wo.astype(np.float32)
        functions = single, double
    ours = np.asarray(functions[0](*map(jnp.asarray, arguments)), float)
    true = np.asarray(functions[1](*(jnp.asarray(part, float) for part in arguments)))
    seen = np.abs(true) >= _SEEN * np.max(np.abs(true))
    with np.errstate(invalid="ignore"):
        return float(np.max(np.nan_to_num(np.abs(ours[seen] / true[seen] - 1), nan=np.inf, posinf=np.inf)))


def albedo_errors(single: Callable[..., Any], double: Any, angles: Sequence[float], **options: Any) -> dict[str, Any]:
    """By angle of incidence (degrees): ``albedo``, ``error`` (relative, inf on overflow) and ``bar`` (float64's added).

    `options` are those of `albedo`, for the float32 one.
    """
    mu = np.cos(np.radians(angles)).astype(np.float32)
    ours, true = directional.albedo(single, jnp.asarray(mu), **options), directional.albedo(double, jnp.asarray(mu, float))
    size = np.asarray(true.value)
    with np.errstate(invalid="ignore"):
        error = np.nan_to_num(np.abs(np.asarray(ours.value, float) - size) / size, nan=np.inf, posinf=np.inf)
        bar = np.nan_to_num((np.asarray(ours.error, float) + np.asarray(true.error)) / size, nan=np.inf, posinf=np.inf)
    return {"engine": ours.engine, "albedo": size.tolist(), "error": error.tolist(), "bar": bar.tolist()}


def naive_forms(exponents: Sequence[float], samples: int) -> dict[str, Any]:
    """What textbooks write, in float32, beside ours; all from versines, of which the naive forms make the cosine first.

    ``power``: by form, the largest relative error where c^n >= 1/255, one an exponent: ``pow``, ``exp-log``, ``power`` (ours),
    ``sum`` (the 16th power of 1 + (n/16)(c-1)), ``binomial`` (ours). ``flushed``: the angle (degrees; of `samples` from 0 to
    90) from which c^n is 0. ``angle`` (radians), and the relative errors of its recovery by ``acos`` and by ``asin`` (ours).
    """
    power: dict[str, list[float]] = {}
    flushed = []
    for n in exponents:
        versine = np.geomspace(1e-3 / n, min(5.5 / n, 0.99), 5001).astype(np.float32)
        v, n32 = jnp.asarray(versine), jnp.float32(n)
        c = 1 - v
        forms = {
            "pow": (c**n32, Phong(n)),
            "exp-log": (jnp.exp(n32 * jnp.log(c)), Phong(n)),
            "power": (Phong(n32).profile(v), Phong(n)),
            "sum": (jnp.maximum(1 + n32 / 16 * (c - 1), 0) ** 16, BinomialPower(n)),
            "binomial": (BinomialPower(n32).profile(v), BinomialPower(n)),
        }
        for name, (value, lobe) in forms.items():
            true = np.asarray(lobe.profile(jnp.asarray(versine, float)))
            seen = true >= _DARK
            power.setdefault(name, []).append(float(np.max(np.abs(np.asarray(value, float) - true)[seen] / true[seen])))
        angle = np.linspace(0, 90, samples)[:-1]
        lobe = Phong(n32).profile(jnp.asarray(2 * np.sin(np.radians(angle) / 2) ** 2, jnp.float32))
        gone = np.flatnonzero(np.asarray(lobe) == 0)
        flushed.append(float(angle[gone[0]]) if len(gone) else 90.0)
    angle = np.geomspace(1e-5, 1, 61)
    versine = (2 * np.sin(angle / 2) ** 2).astype(np.float32)
    exact = 2 * np.arcsin(np.sqrt(versine.astype(float) / 2))
    v = jnp.asarray(versine)
    found = {"acos": jnp.arccos(1 - v), "asin": 2 * jnp.arcsin(jnp.sqrt(v / 2))}
    recovered = {name: np.abs(np.asarray(value, float) / exact - 1).tolist() for name, value in found.items()}
    return {"power": power, "flushed": flushed, "angle": angle.tolist(), **recovered}
