"""Curves from files: records of `plot --json` and `study`, fits, and the stores of sweeps. Nothing is computed with JAX.

What is wrong with a file is a `UsageError` in one line that names it.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from brdfcheck.brdf.readers.specs import SUFFIXES
from brdfcheck.messages import UsageError, one_line
from brdfcheck.output.records import SCHEMA, SCHEMA_VERSION, number
from brdfcheck.verdict.report import TOLERANCE

Curve = dict[str, Any]

_ABOVE = 1 + TOLERANCE
_MOST = 40  # curves from one store
_MAXIMISED = ("azimuth", "channel")  # of which the largest albedo counts
_NEEDED = {
    "albedo-vs-n": ("parameter", "range", "x", "albedo"),
    "albedo-vs-angle": ("at", "x", "albedo"),
    "heatmap": ("parameter", "range", "x", "cosines", "albedo"),
    "factor": ("parameter", "range", "x", "albedo", "factor", "exact"),
}


def is_curve_file(word: str) -> bool:
    """True for what is a record or a store rather than a BRDF: by its name, or because it is there and no file of BRDFs."""
    bare = word.rstrip("/" + os.sep)
    if bare.endswith((".json", ".zarr")):
        return True
    if bare.lower().endswith(SUFFIXES) or not os.path.exists(word) or ":" in word:
        return False
    from brdfcheck.brdf import catalog  # a folder may have the name of a lobe

    return word not in catalog.names()


def read(path: str, kind: str) -> tuple[list[Curve], list[Curve]]:
    """The curves of a file for a figure of `kind`, and the fits in it with their settings, whose curves are computed later."""
    record = _record(path)
    if record.get("schema") != SCHEMA or not isinstance(record.get("results"), list):
        raise UsageError(f"{path}: not a record of brdfcheck (plot --json, fit --json, a study, or a folder written by sweep)")
    if isinstance(record.get("schema_version"), int) and record["schema_version"] > SCHEMA_VERSION:
        raise UsageError(f"{path}: written by a newer brdfcheck (schema {record['schema_version']}; known: {SCHEMA_VERSION})")
    results = [result for result in record["results"] if isinstance(result, dict)]
    if record.get("command") == "fit":
        if kind not in ("factor", "albedo-vs-n"):
            raise UsageError(f"{path}: a fit can be plotted as factor or albedo-vs-n, not as {kind}")
        return [], [result | {"settings": record.get("settings")} for result in results]
    curves = [result for result in results if result.get("kind") in _NEEDED]
    if not curves:
        command = one_line(record.get("command", "?"))
        raise UsageError(f"{path}: the record of brdfcheck {command} holds no curves; those of plot --json and study do")
    for curve in curves:
        _refuse(path, curve)
    same = [_filled(curve) for curve in curves if curve["kind"] == kind]
    if same:
        return same, []
    made = [_from_record(curve, kind) for curve in curves]
    found = [curve for part in made for curve in part]
    if not found:
        held = ", ".join(dict.fromkeys(curve["kind"] for curve in curves))
        raise UsageError(f"{path}: holds no curve for {kind}; it holds {held}")
    return found, []


def _record(path: str) -> dict[str, Any]:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise UsageError(f"there is no file {path!r}") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read {path!r}: {getattr(error, 'strerror', None) or 'it is not a text file'}") from None
    try:
        record = json.loads(text)
    except ValueError as error:
        raise UsageError(f"{path}: not JSON: {one_line(error)}") from None
    if not isinstance(record, dict):
        raise UsageError(f"{path}: not a record of brdfcheck, but a JSON {type(record).__name__}")
    return record


def _refuse(path: str, curve: Mapping[str, Any]) -> None:
    """UsageError where a curve cannot be drawn."""
    name, kind = one_line(curve.get("name", "?")), curve["kind"]
    missing = [key for key in ("name", *_NEEDED[kind]) if curve.get(key) is None]
    if missing:
        raise UsageError(f"{path}: the curve {name} has no {missing[0]!r}")
    try:
        x = np.array([float(value) for value in curve["x"]])
        shape = (len(x),) if kind != "heatmap" else (len(x), len(curve["cosines"]))
        for key in ("albedo", "factor", "exact"):
            if key in curve and np.array([_floats(row) for row in curve[key]]).shape != shape:
                raise ValueError(f"{key} and x differ in length")
        if not x.size or not np.all(np.diff(x) > 0) or not np.all(np.isfinite(x)):
            raise ValueError("x does not rise")
        [(float(low), float(high)) for low, high in curve.get("above") or ()]
        [float(bound) for bound in [*(curve.get("range") or ()), *(curve.get("cos_theta") or ())]]
        if kind == "albedo-vs-angle":
            {name: float(value) for name, value in curve["at"].items()}
    except (TypeError, ValueError, AttributeError) as error:
        raise UsageError(f"{path}: the curve {name} is damaged: {one_line(error)}") from None


def _floats(row: Any) -> Any:
    return [float(value) for value in row] if isinstance(row, list) else float(row)


def _filled(curve: Curve) -> Curve:
    """What a figure asks for and an older or foreign record may lack."""
    return {"above": [], "cos_theta": [0.0, 1.0], "label": None, "largest": None, "held": {}, **curve}


def _from_record(curve: Curve, kind: str) -> list[Curve]:
    """A curve of another kind as one of `kind`, where the numbers are there."""
    curve = _filled(curve)
    if curve["kind"] == "factor" and kind == "albedo-vs-n":
        return [{**curve, "kind": kind}]
    if curve["kind"] == "heatmap" and kind != "factor":
        x, mu = np.array(curve["x"], float), np.array(curve["cosines"], float)
        values = np.array([_floats(row) for row in curve["albedo"]])
        return from_grid(kind, curve["name"], curve["parameter"], x, mu, values)
    return []


# --- grids ---


def from_grid(
    kind: str,
    name: str,
    parameter: str,
    x: np.ndarray,
    mu: np.ndarray,
    values: np.ndarray,
    *,
    label: str | None = None,
    wanted: Sequence[float] | None = None,
) -> list[Curve]:
    """Curves of a grid of albedos (x, cos theta), both rising. `wanted`: values of x for curves over angles.

    Ends of intervals are interpolated between the samples.
    """
    known = np.where(np.isnan(values), -np.inf, values)
    base: Curve = {
        "name": name,
        "label": label,
        "formula": None,
        "engine": "grid",
        "parameter": parameter,
        "range": [float(x[0]), float(x[-1])],
        "held": {},
        "cos_theta": [float(mu[0]), float(mu[-1])],
        "verdict": None,
        "kind": kind,
    }

    def curve(axis: np.ndarray, top: np.ndarray, peak: Sequence[Any], **columns: Any) -> Curve:
        """What is above 1 along the axis, and largest at the peak."""
        i, j = peak
        largest = {
            "albedo": number(float(values[i, j])),
            "error": None,
            "at": {parameter: float(x[i])},
            "cos_theta": float(mu[j]),
        }
        return {**base, **columns, "above": _crossings(axis, top), "largest": largest}

    if kind == "albedo-vs-angle":
        if wanted is None:
            rows_shown = np.unique(np.linspace(0, len(x) - 1, 5).round().astype(int)).tolist()
        else:
            rows_shown = list(dict.fromkeys(int(np.argmin(np.abs(x - value))) for value in wanted))
        base |= {"parameter": None, "range": None}
        return [
            curve(mu, row, (i, np.argmax(known[i])), at={parameter: float(x[i])}, x=rounded(mu), albedo=rounded(row))
            for i, row in zip(rows_shown, values[rows_shown], strict=True)
        ]
    peak, top = np.unravel_index(np.argmax(known), known.shape), np.max(known, axis=1)
    top = np.where(np.isneginf(top), np.nan, top)
    if kind == "albedo-vs-n":
        worst = np.where(np.isnan(top), np.nan, mu[np.argmax(known, axis=1)])
        return [curve(x, top, peak, x=rounded(x), albedo=rounded(top), worst_cos_theta=rounded(worst))]
    if kind != "heatmap" or min(known.shape) < 2:
        return []
    return [curve(x, top, peak, x=rounded(x), cosines=rounded(mu), albedo=[rounded(line) for line in values])]


def rounded(values: Any, digits: int = 12) -> list[Any]:
    """The values as numbers of a record: more digits than any figure shows, and half the file."""
    return [number(float(f"{value:.{digits}g}")) for value in np.asarray(values, float).ravel()]


def stretches(x: np.ndarray, inside: np.ndarray, edge: Callable[[int], float]) -> list[tuple[float, float]]:
    """Where `inside` holds, as intervals of x; ``edge(i)`` is where it changes between the samples i and i + 1."""
    ends = [float(x[0])] if inside[0] else []
    ends += [float(edge(int(i))) for i in np.flatnonzero(inside[1:] != inside[:-1])]
    ends += [float(x[-1])] if inside[-1] else []
    return list(zip(ends[::2], ends[1::2], strict=True))


def _crossings(x: np.ndarray, values: np.ndarray) -> list[list[float]]:
    """Intervals of x in which the values exceed 1, linear between the samples (geometric where x spans decades)."""
    long = x[0] > 0 and x[-1] / x[0] >= 15
    place = np.log(x) if long else x

    def edge(i: int) -> float:
        first, second = values[i] - 1, values[i + 1] - 1
        part = first / (first - second) if np.isfinite(first) and np.isfinite(second) else 0.5
        crossing = place[i] + part * (place[i + 1] - place[i])
        return np.exp(crossing) if long else crossing

    return [list(ends) for ends in stretches(x, values > _ABOVE, edge)]


# --- stores ---


def from_store(
    path: str,
    kind: str,
    *,
    wanted: Sequence[float] | None = None,
    n: tuple[float, float] | None = None,
    cos_theta: tuple[float, float] | None = None,
) -> list[Curve]:
    """The curves of a sweep's store: one for each value of its dimensions besides the parameter and cos_theta.

    The parameter is n, or where there is none the longest dimension of numbers. Of azimuths and channels the largest albedo
    counts. `n`, `cos_theta`: only these ranges; `wanted`: exponents of curves over angles.
    """
    if kind == "factor":
        raise UsageError(f"{path}: a sweep holds albedos; plot its factors by the names of the BRDFs")
    with _opened(path) as data:
        table = data["albedo"]
        parameter = _parameter(table)
        if parameter is None or "cos_theta" not in table.dims:
            have = ", ".join(str(axis) for axis in table.dims if axis not in _MAXIMISED) or "none"
            raise UsageError(f"{path}: a plot of a sweep needs the dimension cos_theta and one of numbers, as n; it has {have}")
        if parameter != "n" and (n is not None or wanted is not None):
            raise UsageError(f"{path}: --n is for sweeps over n; this one is over {parameter}")
        for name, bounds in ((parameter, n), ("cos_theta", cos_theta)):
            table = table.sortby(name)
            if bounds is not None:
                table = table.sel({name: (table[name] >= bounds[0]) & (table[name] <= bounds[1])})
                if not table.sizes[name]:
                    raise UsageError(f"{path}: holds no {name} within {bounds[0]:g}:{bounds[1]:g}")
        others = [str(axis) for axis in table.dims if axis not in (parameter, "cos_theta", *_MAXIMISED)]
        count = math.prod(table.sizes[axis] for axis in others)
        if count > _MOST:
            raise UsageError(f"{path}: {count} curves over {', '.join(others)} are too many for one figure (at most {_MOST})")
        x, mu = (np.asarray(table[name].values, float) for name in (parameter, "cos_theta"))
        curves: list[Curve] = []
        for index in np.ndindex(*(table.sizes[axis] for axis in others)):
            part = table.isel(dict(zip(others, index, strict=True)))
            with _damage_told(path):
                part.load()
            # The largest of some and an unknown one is unknown.
            values = part.max([axis for axis in _MAXIMISED if axis in part.dims], skipna=False)
            values = np.asarray(values.transpose(parameter, "cos_theta").values, float)
            if not np.all(np.isnan(values)):
                place = {
                    axis: part.coords[axis].item() if axis in part.coords else i for axis, i in zip(others, index, strict=True)
                }
                label = _label(place) or Path(path).resolve().name.removesuffix(".zarr")
                curves += from_grid(kind, label, parameter, x, mu, values, label=label, wanted=wanted)
    if not curves:
        few = kind == "heatmap" and min(len(x), len(mu)) < 2
        raise UsageError(
            f"{path}: "
            + (f"a heat map needs two values of {parameter} and cos_theta" if few else "the sweep holds no albedo yet")
        )
    return curves


def _parameter(table: Any) -> str | None:
    """The dimension that a figure runs over besides the angle; None where there is none of numbers."""
    numeric = [
        str(axis)
        for axis in table.dims
        if axis not in ("cos_theta", "rtol", *_MAXIMISED) and axis in table.coords and table.coords[axis].dtype.kind in "fiu"
    ]
    return "n" if "n" in numeric else max(numeric, key=lambda axis: table.sizes[axis], default=None)


def _label(place: Mapping[str, Any]) -> str:
    """What a curve of a store is called: BRDFs by their names, other dimensions by name and value."""
    return ", ".join(str(value) if isinstance(value, str) else f"{axis}={value:g}" for axis, value in place.items())


def _opened(path: str) -> Any:
    """A store, of whose results nothing is read yet."""
    import warnings

    import xarray

    if not any((Path(path) / name).is_file() for name in ("zarr.json", ".zgroup", ".zmetadata")):
        raise UsageError(f"{path}: the folder holds no Zarr store of brdfcheck sweep")
    with _damage_told(path), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = xarray.open_zarr(path, chunks=None)
    if "albedo" not in data:
        raise UsageError(f"{path}: the store holds no variable albedo")
    return data


@contextlib.contextmanager
def _damage_told(path: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # whatever zarr and xarray make of a damaged store
        raise UsageError(f"{path}: cannot read the store: {type(error).__name__}: {one_line(error)}") from None
