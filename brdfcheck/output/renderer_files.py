"""Tables for renderers as files: CSV, NPY, EXR, DDS and a C++ header, with provenance in the file or beside it.

Rows run over the parameter, columns over cos theta: u = cos theta and v = parameter of a texture whose first texel is the
smallest of both. Values are never clamped; beside each quantity is its error bar, where the format has room for it.
"""

from __future__ import annotations

import itertools
import os
import struct
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from brdfcheck.fits.compact import CompensationFit
from brdfcheck.fits.compensation import Compensation
from brdfcheck.fits.renderer import RendererTable
from brdfcheck.output import records
from brdfcheck.output.source import comment, identifier, number
from brdfcheck.output.table_files import csv_text, npy_bytes, table_metadata, texts, write_beside
from brdfcheck.verdict.report import Report
from brdfcheck.verdict.words import message

KINDS = ("csv", "npy", "exr", "dds", "hpp")
Texture = Literal["dfg", "albedo", "compensation"]
# Of each texture its two channels.
_PAIRS: dict[str, tuple[str, str]] = {
    "dfg": ("scale", "bias"),
    "albedo": ("E", "average"),
    "compensation": ("compensation.E", "compensation.average"),
}
_QUANTITIES = {
    "E": "directional albedo",
    "average": "average albedo 2 int E(mu) mu dmu, the same along a row",
    "scale": "scale of the split sum: with Schlick's Fresnel term the albedo is F0 scale + bias",
    "bias": "bias of the split sum",
    "compensation.E": "E raised so that the compensation of Kulla and Conty conserves with linear look-ups",
    "compensation.average": "average of compensation.E as it is looked up, at most 1 - 1e-6: 1 less it is a divisor",
}
# DXGI_FORMAT_R32G32_FLOAT, D3D10_RESOURCE_DIMENSION_TEXTURE2D, and the flags of a texture with a pitch.
_R32G32_FLOAT, _TEXTURE2D, _FLAGS, _FOURCC, _TEXTURE = 16, 3, 0x100F, 0x4, 0x1000


def quantities(table: RendererTable, compensation: Compensation | None = None) -> dict[str, np.ndarray]:
    """All that is written, by name, each (parameter, cos_theta): values, and bars as ``error.NAME``."""
    found = {}
    for name, (value, bar) in table.channels.items():
        found |= {name: value, f"error.{name}": bar}
    if compensation is not None:
        wide = np.repeat(compensation.average[:, None], compensation.energy.shape[1], axis=1)
        found |= {"compensation.E": compensation.energy, "compensation.average": wide}
    return found


def texture_of(table: RendererTable, compensation: Compensation | None, texture: Texture | None) -> tuple[str, str]:
    """The names of the two channels of a texture; by default the split sum, or without one the albedo. ValueError without."""
    names = quantities(table, compensation)
    pair = _PAIRS[texture or ("dfg" if "scale" in names else "albedo")]
    missing = [name for name in pair if name not in names]
    if missing:
        raise ValueError(f"the texture {texture or 'albedo'} needs {missing[0]}, which this table does not have")
    return pair


def renderer_metadata(
    table: RendererTable,
    compensation: Compensation | None = None,
    functions: CompensationFit | None = None,
    reports: Mapping[str, Report] | None = None,
    *,
    command: str | None = None,
) -> dict[str, Any]:
    """What a reader must know, ready for strict JSON: target, axes, quantities, bars, versions.

    `functions`: the compensation by functions, `reports`: what the search said of the BRDF with each of the compensations.
    """
    found, family = table.sources, table.sources.family
    names = quantities(table, compensation)
    record = table_metadata(table.grid, command or f"brdfcheck.fits.renderer.renderer_table({family.name!r})")
    record |= {
        "schema": "brdfcheck-renderer-table",
        "formula": found.formula,
        "quantity": {name: text for name, text in _QUANTITIES.items() if name in names},
        "channels": list(names),
        "resampling": table.placement,
        "range_0": list(map(float, table.bounds)),
        "parameter": found.mapping or f"{found.parameter}, as the target has it",
        "held": records.plain(dict(family.held)),
        "max_error": {
            name.removeprefix("error."): float(np.max(part)) for name, part in names.items() if name.startswith("error.")
        },
    }
    if table.why:
        record["no_split_sum"] = table.why
    if compensation is not None:
        (begins, ends), *_ = compensation.family.ranges.values()
        made = {
            "excess_with_E_itself": compensation.excess,
            "largest_loss": compensation.loss,
            "measured_on": compensation.cover.missed.shape,
            "range": (begins, ends),
            "check": {name: message(report) for name, report in (reports or {}).items()} or None,
        }
        if functions is not None:
            made["functions"] = {"largest_loss": functions.loss, "albedo_raised": functions.raised}
        record["compensation"] = records.plain(made)
    return record


def write_renderer_table(
    path: str | os.PathLike[str],
    table: RendererTable,
    kind: str,
    compensation: Compensation | None = None,
    *,
    texture: Texture | None = None,
    metadata: Mapping[str, Any] | None = None,
) -> None:
    """Write a table whole or not at all, in one of `KINDS`. `metadata`: by default those of `renderer_metadata`.

    * csv: comments with the metadata, the last of them names the columns; a row for each cell, 17 digits.
    * npy: float64 (channels, parameter, cos_theta); names and metadata in PATH.json.
    * exr: float32 channels by name, the metadata as strings in the header.
    * dds: two channels by `texture_of`, uncompressed R32G32 float with a DX10 header; metadata in PATH.json.
    * hpp: C++11, constexpr float arrays and an inline linear look-up.

    Raises ValueError for an unknown kind or a texture that the table does not have, OSError where the file cannot be written.
    """
    if kind not in KINDS:
        raise ValueError(f"the kind of a table must be one of {', '.join(KINDS)}; got {kind!r}")
    metadata = renderer_metadata(table, compensation) if metadata is None else metadata
    parts = quantities(table, compensation)
    if kind == "csv":
        grid = table.grid
        cells = itertools.product(enumerate(grid.nodes), enumerate(grid.cos_theta))
        rows = ((node, mu, *(part[i, j] for part in parts.values())) for (i, node), (j, mu) in cells)
        records.write_atomically(path, csv_text(metadata, [grid.parameter, "cos_theta", *parts], rows))
    elif kind == "npy":
        write_beside(path, npy_bytes(np.stack(list(parts.values()))), metadata)
    elif kind == "exr":
        records.write_atomically(path, records.exr_bytes(parts, texts(metadata)))
    elif kind == "dds":
        pair = texture_of(table, compensation, texture)
        pixels = np.stack([parts[name] for name in pair], axis=-1)
        write_beside(path, dds_bytes(pixels), {**metadata, "channels": list(pair), "format": "R32G32_FLOAT, uncompressed"})
    else:
        records.write_atomically(path, _header(table, parts, metadata))


def dds_bytes(pixels: np.ndarray) -> bytes:
    """A DDS file of one image (height, width, 2), uncompressed R32G32 float, rows from the top, with a DX10 header."""
    height, width, _ = pixels.shape
    caps = struct.pack("<5I", _TEXTURE, 0, 0, 0, 0)
    pixel_format = struct.pack("<2I4s5I", 32, _FOURCC, b"DX10", 0, 0, 0, 0, 0)
    header = struct.pack("<7I44x", 124, _FLAGS, height, width, 8 * width, 0, 1) + pixel_format + caps
    dx10 = struct.pack("<5I", _R32G32_FLOAT, _TEXTURE2D, 0, 1, 0)
    return b"DDS " + header + dx10 + np.ascontiguousarray(pixels, dtype="<f4").tobytes()


def _header(table: RendererTable, parts: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> str:
    grid = table.grid
    rows, columns = grid.values.shape
    known = {"nodes_0", "nodes_1", "schema", "schema_version"}
    lines = [line for key, text in texts(metadata).items() if key not in known for line in comment(f"{key}: {text}")]
    text = "".join(lines) + "#pragma once\n\n"
    text += f"namespace {identifier(grid.family.name)}_table {{\n\nconstexpr int rows = {rows}, columns = {columns};\n"
    low, high = table.bounds
    for name, part in parts.items():
        if name.startswith("error."):
            text += f"constexpr float {name.removeprefix('error.')}_error = {_float(float(np.max(part)))};\n"
    for name, part in parts.items():
        word = name.replace(".", "_")
        if name.endswith("average"):
            text += f"\nconstexpr float {word}[rows] = {{\n{_row(part[:, 0])}\n}};\n"
        elif not name.startswith("error."):
            body = ",\n".join(f"{{\n{_row(row)}\n}}" for row in part)
            text += f"\nconstexpr float {word}[rows][columns] = {{\n{body}\n}};\n"
    half = "* count - 0.5f" if table.placement == "centres" else "* (count - 1)"
    mu_low, mu_high = grid.family.cos_theta
    text += f"""
// Where a value of [low, high] lies between the nodes, level beyond the first and the last one.
inline float position(float value, float low, float high, int count) {{
    float x = high > low ? (value - low) / (high - low) {half} : 0.0f;
    return x < 0.0f ? 0.0f : x > count - 1 ? static_cast<float>(count - 1) : x;
}}

// Linear look-up by {grid.parameter} in [{low:g}, {high:g}]: one of the averages.
inline float look_up(const float (&table)[rows], float parameter) {{
    float y = position(parameter, {_float(low)}, {_float(high)}, rows);
    int i = static_cast<int>(y), k = i + 1 < rows ? i + 1 : i;
    return table[i] + (y - i) * (table[k] - table[i]);
}}

// Linear look-up by {grid.parameter} in [{low:g}, {high:g}] and cos_theta in [{mu_low:g}, {mu_high:g}].
inline float look_up(const float (&table)[rows][columns], float parameter, float cos_theta) {{
    float y = position(parameter, {_float(low)}, {_float(high)}, rows);
    float x = position(cos_theta, {_float(mu_low)}, {_float(mu_high)}, columns);
    int i = static_cast<int>(y), k = i + 1 < rows ? i + 1 : i;
    int j = static_cast<int>(x), m = j + 1 < columns ? j + 1 : j;
    float first = table[i][j] + (x - j) * (table[i][m] - table[i][j]);
    float second = table[k][j] + (x - j) * (table[k][m] - table[k][j]);
    return first + (y - i) * (second - first);
}}

}}  // namespace
"""
    return text


def _float(value: float) -> str:
    return f"{number(float(f'{value:.9g}'))}f"


def _row(values: np.ndarray) -> str:
    words = [_float(float(value)) for value in values]
    return ",\n".join("    " + ", ".join(words[start : start + 8]) for start in range(0, len(words), 8))
