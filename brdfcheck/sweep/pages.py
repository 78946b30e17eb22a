"""A store as a page: heat maps of the albedos that a sweep has computed. Nothing is computed here."""

from __future__ import annotations

import math
import os
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from brdfcheck.fits.slices import AZIMUTH, Axis, Slices
from brdfcheck.output.html import Entry, page
from brdfcheck.verdict.report import TOLERANCE

if TYPE_CHECKING:
    import xarray

# Numbers in all tables of a page, rows and angles of a slice, values of the other axes (as many as fit), and how many BRDFs, or
# precisions and rules of them, have a place of their own.
_CELLS = 56_000
_ROWS, _ANGLES = 48, 64
_VALUES = (7, 5, 4, 3, 2, 1)
_MOST = 24
_ENDLESS = 1e300


def sweep_page(out: str | os.PathLike[str], *, provenance: str = "") -> str:
    """The page of a complete store: for each BRDF (precision, rule...) the largest albedo of the grid and slices through it.

    Of long axes a part of the values is shown, the place of the largest albedo among them.
    """
    import xarray

    with xarray.open_zarr(os.fspath(out), chunks=None) as store:
        data, albedo = store[["albedo", "error"]], store["albedo"]
        texts = [str(name) for name in albedo.dims if name != "channel" and albedo[name].dtype.kind not in "fiu"]
        which = list(np.ndindex(*(albedo.sizes[name] for name in texts)))
        room = _CELLS // min(len(which), _MOST)
        entries = [_entry(data.isel(dict(zip(texts, indices, strict=True))), room) for indices in which[:_MOST]]
        title = os.path.basename(os.path.normpath(os.fspath(out)))
        lines = [f"{albedo.size} albedos; the largest of a grid is no verdict: between its nodes it may be larger"]
        if len(which) > _MOST:
            lines.append(f"the first {_MOST} of {len(which)} combinations of {', '.join(texts)}")
        return page(entries, heading=f"Albedos of the sweep {title}", lines=lines, provenance=provenance)


def _entry(data: xarray.Dataset, room: int) -> Entry:
    """One BRDF: numeric axes are left."""
    albedo = data["albedo"]
    names = [str(name) for name in albedo.dims if name != "channel"]
    place, facts = _largest(albedo, names)
    said = {str(name): albedo[name].item() for name in albedo.coords if albedo[name].ndim == 0}
    name = ", ".join(str(value) for key, value in said.items() if isinstance(value, str)) or "albedo"
    held = {key: value for key, value in said.items() if not isinstance(value, str)}
    wide = [name for name in names if albedo.sizes[name] > 1 and name != "cos_theta"]
    wide.sort(key=lambda name: name == AZIMUTH)
    row, others = (wide[0], wide[1:]) if wide else (None, [])
    channels = albedo.sizes.get("channel", 1)
    full = channels * min(_ANGLES, albedo.sizes.get("cos_theta", 1)) * (1 if row is None else min(_ROWS, albedo.sizes[row]))
    values = next((values for values in _VALUES if values ** len(others) * full <= room), 1)
    kept = {
        name: _kept(albedo.sizes[name], {row: _ROWS, "cos_theta": _ANGLES}.get(name, values), place[name]) for name in names
    }
    axes = {name: _axis(name, np.asarray(albedo[name].values, float), kept[name], place[name]) for name in names}
    angles, _ = axes.get("cos_theta") or _axis("cos_theta", np.array([held.get("cos_theta", 1.0)]), np.array([0]), 0)
    order = [*others, *(name for name in ("channel", row, "cos_theta") if name in albedo.dims)]
    shown = data.isel({name: indices for name, (_, indices) in axes.items()}).transpose(*order, ...).load()
    shape = [*(len(axes[name][1]) for name in others), channels, 1 if row is None else len(axes[row][1]), -1]
    table, error = (np.asarray(shown[name].values, float).reshape(shape) for name in ("albedo", "error"))
    # What is no number is shown as such, whatever its bar. JSON has no infinity for the bar of a number that is not known.
    with np.errstate(invalid="ignore"):
        error = np.where(np.isfinite(table), np.minimum(error / np.maximum(1, np.abs(table)), _ENDLESS), 0.0)
    tables = {key: table[key] for key in np.ndindex(table.shape[:-3])}
    errors = {key: float(np.nanmax(error[key], initial=0.0)) for key in tables}
    slices = Slices(angles, axes[row][0] if row else None, tuple(axes[name][0] for name in others), tables, errors)
    facts |= {"held": ", ".join(f"{key}={value:g}" for key, value in held.items())} if held else {}
    return Entry(name, slices, None, facts)


def _largest(albedo: xarray.DataArray, names: list[str]) -> tuple[dict[str, int], dict[str, str]]:
    """Where the largest albedo lies, and in words what the grid holds; read a chunk at a time, for a store may be large."""
    sizes = [albedo.sizes[name] for name in albedo.dims]
    chunks = albedo.encoding.get("preferred_chunks") or {}
    steps = [chunks.get(name, size) for name, size in zip(albedo.dims, sizes, strict=True)]
    best, where, above, lost = -math.inf, [0] * len(sizes), 0, 0
    for corner in product(*(range(0, size, step) for size, step in zip(sizes, steps, strict=True))):
        block = {name: slice(low, low + step) for name, low, step in zip(albedo.dims, corner, steps, strict=True)}
        values = albedo.isel(block).values
        above += int(np.count_nonzero(values > 1 + TOLERANCE))
        lost += int(np.count_nonzero(~np.isfinite(values)))
        finite = np.where(np.isfinite(values), values, -math.inf)
        if finite.size and float(finite.max()) > best:
            best = float(finite.max())
            where = [
                low + int(index) for low, index in zip(corner, np.unravel_index(finite.argmax(), finite.shape), strict=True)
            ]
    place = {str(name): index for name, index in zip(albedo.dims, where, strict=True)}
    shown = " ".join(f"{name}={float(albedo[name].values[place[name]]):.6g}" for name in names)
    facts = {
        "Largest on the grid": f"{best:.10g}" if math.isfinite(best) else "not a number",
        "Where": shown,
        "Above 1": str(above),
        "Cells": str(albedo.size),
    }
    return place, facts | ({"Not finite": str(lost)} if lost else {})


def _kept(size: int, most: int, at: int) -> np.ndarray:
    """Indices of an axis, spread over it, `at` among them."""
    if size <= most:
        return np.arange(size)
    if most == 1:
        return np.array([at])
    found = np.unique(np.linspace(0, size - 1, most).round().astype(int))
    inner = found[1:-1] if 0 < at < size - 1 and len(found) > 2 else found
    inner[np.argmin(np.abs(inner - at))] = at
    return np.unique(found)


def _axis(name: str, values: np.ndarray, kept: np.ndarray, at: int) -> tuple[Axis, np.ndarray]:
    """The axis of these values, rising, and the indices in the store in that order. Cosines become angles in degrees."""
    shown = values[kept]
    if name == "cos_theta":
        shown = np.degrees(np.arccos(np.clip(shown, 0, 1)))
    elif name == AZIMUTH:
        shown = np.degrees(shown)
    order = np.argsort(shown, kind="stable")
    shown, indices = shown[order], kept[order]
    even = name in ("cos_theta", AZIMUTH) and len(shown) > 1
    position = (shown - shown[0]) / (shown[-1] - shown[0]) if even else np.linspace(0, 1, len(shown))
    label = "angle" if name == "cos_theta" else name
    return Axis(label, shown, position, int(np.argmax(indices == at)) if at in indices else 0), indices
