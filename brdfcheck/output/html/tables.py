"""Slices of the albedo as the script of a page reads them: 16 bits a value, so that a page stays small."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from brdfcheck.fits.slices import Axis, Slices
from brdfcheck.verdict.words import channel_text

NO_VALUE = 65535
"""The code of what is no finite number; the others count from 0 to one less."""
# How much finer the codes are at 1 than far from it.
_FINER = 10
# Channels that differ by less are drawn as one.
_SAME = 1e-9


def squeezed(values: Any) -> np.ndarray:
    """arsinh(10 (E - 1)): even steps of it are finest at E = 1, and a table may hold 1.0001 and a million."""
    return np.arcsinh(_FINER * (np.asarray(values, float) - 1))


def encoded(table: np.ndarray, low: float, high: float) -> str:
    """A table as base64 of little-endian 16-bit codes, evenly spaced between two `squeezed` values."""
    finite = np.isfinite(table)
    part = (squeezed(np.where(finite, table, 0)) - low) / (high - low)
    codes = np.where(finite, np.rint(np.clip(part, 0, 1) * (NO_VALUE - 1)), NO_VALUE)
    return base64.b64encode(codes.astype("<u2").tobytes()).decode("ascii")


def table_object(slices: Slices, tolerance: float) -> dict[str, Any]:
    """All that the script needs to draw slices. What lies above 1 + `margin` counts as above 1."""
    tables = {key: _one_if_alike(table) for key, table in slices.tables.items()}
    count = max(len(table) for table in tables.values())
    tables = {key: table if len(table) == count else np.repeat(table, count, axis=0) for key, table in tables.items()}
    finite = np.concatenate([table[np.isfinite(table)] for table in tables.values()] + [np.zeros(0)])
    low, high = (float(bound) for bound in squeezed([finite.min(), finite.max()])) if len(finite) else (0.0, 1.0)
    high = high if high > low else low + 1.0
    step = (high - low) / (NO_VALUE - 1)  # of the codes: a tenth of it at E = 1, elsewhere no more than it as a part of E or 1
    return {
        "angles": _axis(slices.angles),
        "rows": None if slices.rows is None else _axis(slices.rows),
        "others": [_axis(axis) for axis in slices.others],
        "channels": ["E"] if count == 1 else [channel_text(index, count) for index in range(count)],
        "low": low,
        "high": high,
        "margin": max(tolerance, step / _FINER),
        "rounding": _short(step / 2, 2),
        "errors": {_key(key): _short(error, 2) for key, error in slices.errors.items()},
        "tables": {_key(key): [encoded(channel, low, high) for channel in table] for key, table in tables.items()},
    }


def _one_if_alike(table: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        alike = np.all(np.abs(table - table[:1]) <= _SAME * np.maximum(1, np.abs(table[:1])))
    return table[:1] if alike else table


def _key(indices: tuple[int, ...]) -> str:
    return ",".join(map(str, indices))


def _axis(axis: Axis) -> dict[str, Any]:
    return {
        "name": axis.name,
        "values": [_short(value, 7) for value in axis.values],
        "position": [_short(value, 5) for value in axis.position],
        "at": axis.at,
    }


def _short(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
