"""Tables of the albedo as CSV, NPY or EXR (linear float), with their provenance in the file or beside it.

Rows run over the parameter, columns over cos theta; values are the quadrature's, with the factor, never clamped.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brdfcheck.fits.grids import AlbedoGrid, formula_of
from brdfcheck.messages import one_line
from brdfcheck.output import records
from brdfcheck.output.text import describe

KINDS = ("csv", "npy", "exr")
SCHEMA = "brdfcheck-table"
SCHEMA_VERSION = 1


def table_metadata(table: AlbedoGrid, command: str | None = None) -> dict[str, Any]:
    """What a table's reader must know, ready for strict JSON: quantity, convention, factor, clamp, axes, error, versions."""
    factor = "none: the lobe's albedo as it is"
    if table.factored:
        factor = f"included: {'it varies with the parameter' if table.factor is None else describe(table.factor, 9)}"
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "name": table.family.name,
        "formula": formula_of(table.family),
        "form": table.form,
        "quantity": "directional albedo E = integral of f(wi, wo) (N.wo) over all wo, wi fixed, cos_theta = N.wi",
        "unit": "none, linear",
        "factor": factor,
        "clamp": "none: values above 1 are values above 1",
        "axis_0": table.parameter,
        "axis_1": "cos_theta",
        "placement": table.placement,
        "shape": list(table.values.shape),
        **records.plain(
            {
                "range_0": table.family.ranges[table.parameter],
                "range_1": table.family.cos_theta,
                "nodes_0": table.nodes,
                "nodes_1": table.cos_theta,
                "largest_value": np.max(table.values),
                "max_error": np.max(table.errors),
            }
        ),
        "engine": table.engine,
        "command": command or f"brdfcheck.fits.grids.tabulate({table.family.name!r})",
        "versions": records.versions(),
    }


def write_table(
    path: str | os.PathLike[str], table: AlbedoGrid, kind: str | None = None, *, command: str | None = None
) -> None:
    """Write a table (from `brdfcheck.fits.grids.tabulate`) whole or not at all. `kind`: one of `KINDS`, else the file's ending.

    * csv: lines ``# key: value`` of metadata, the last of them naming the columns; then a row for each parameter, which comes
      first, and the albedos, 17 digits. ``numpy.loadtxt(path, delimiter=",")`` reads it.
    * npy: float64 (parameter, cos_theta), and the metadata as JSON beside it in PATH.json.
    * exr: float32 channel Y, cos_theta to the right, the parameter down; each item of the metadata a string in the header.

    Raises ValueError for an unknown kind, OSError where the file cannot be written.
    """
    suffix = Path(path).suffix.removeprefix(".").lower()
    kind = suffix if kind is None else kind
    if kind not in KINDS:
        raise ValueError(f"the kind of a table must be one of {', '.join(KINDS)}; got {kind!r}")
    metadata = table_metadata(table, command)
    if kind == "csv":
        columns = [table.parameter, *(f"{mu:.17g}" for mu in table.cos_theta)]
        rows = ((node, *row) for node, row in zip(table.nodes, table.values, strict=True))
        records.write_atomically(path, csv_text(metadata, columns, rows))
    elif kind == "npy":
        write_beside(path, npy_bytes(table.values), metadata)
    else:
        records.write_atomically(path, records.exr_bytes({"Y": table.values}, texts(metadata)))


def npy_bytes(values: np.ndarray) -> bytes:
    """An NPY file of float64."""
    stream = io.BytesIO()
    np.save(stream, np.ascontiguousarray(values, dtype="<f8"), allow_pickle=False)
    return stream.getvalue()


def write_beside(path: str | os.PathLike[str], content: bytes, metadata: Mapping[str, Any]) -> None:
    """Write a file whose format has no room for metadata, and these as JSON in PATH.json."""
    records.write_atomically(f"{os.fspath(path)}.json", records.to_json(metadata))
    records.write_atomically(path, content)


def texts(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Each item on one line: strings as they are, the rest as JSON."""
    return {
        key: one_line(value) if isinstance(value, str) else json.dumps(value, allow_nan=False)
        for key, value in metadata.items()
    }


def csv_text(metadata: Mapping[str, Any], columns: Iterable[str], rows: Iterable[Iterable[float]]) -> str:
    """A CSV: the metadata as comments, the last of which names the columns, and the numbers with 17 digits."""
    lines = [f"# {key}: {text}" for key, text in texts(metadata).items()]
    lines.append(f"# {','.join(columns)}")
    lines += [",".join(f"{value:.17g}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"
