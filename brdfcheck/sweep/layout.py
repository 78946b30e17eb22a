"""The store of a sweep before its first chunk: metadata, coordinates, and what the bytes depend on besides the plan."""

from __future__ import annotations

import functools
import hashlib
import json
import math
import subprocess
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.storage import MemoryStore

from brdfcheck.output import records
from brdfcheck.sweep.plan import Plan

FORMAT = 2
MARK = "brdfcheck_sweep"
RESULTS = ("albedo", "error", "evaluations")
# The file that makes a folder a store.
ROOT = "zarr.json"
CHECKSUM = "CRC-32 of the chunk's files, written last"
_PACKAGE = Path(__file__).resolve().parent.parent
# What a sweep computes with: modules and folders. Others may change between a run and its continuation.
_COMPUTING = (
    "geometry", "numerics", "runtime", "cores", "folders", "messages", "documents", "interruption", "brdf", "quadrature",
    "sweep",
)  # fmt: skip
_LONG_NAMES = {
    "n": "exponent",
    "m": "root mean square slope of the facets",
    "alpha": "roughness of the facets",
    "k": "order of the binomial power",
    "w": "doublings of Lyon's lobe",
    "reflectance": "diffuse reflectance",
    "f0": "reflectance at normal incidence",
    "cos_theta": "cosine of the angle of incidence",
    "azimuth": "azimuth of incidence",
    "brdf": "BRDF",
    "rule": "quadrature rule",
    "precision": "floating-point type computed in",
    "rtol": "relative accuracy aimed at",
}
_CONVENTION = (
    "directional albedo E(wi) = integral of f(wi, wo) (N.wo) over wo, wi fixed; never clamped; error bounds the absolute error"
)


@functools.cache
def source_digest() -> str:
    """SHA-256 of the modules that a sweep computes with, in hexadecimal."""
    files = [file for name in _COMPUTING for file in sorted((_PACKAGE / name).rglob("*.py")) or [_PACKAGE / f"{name}.py"]]
    state = hashlib.sha256()
    for file in files:
        state.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return state.hexdigest()


def source_commit() -> str:
    """The commit of this package's checkout, "-dirty" where the package was changed since; "unknown" where it has none."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(_PACKAGE), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", "__init__.py")  # an environment inside somebody's checkout is no checkout of ours
        return git("rev-parse", "HEAD") + ("-dirty" if git("status", "--porcelain", "--", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def facts() -> dict[str, Any]:
    """What must be the same in every process that adds to a store: versions, source, the kind of device but not how many."""
    return {"versions": records.versions("zarr", "numcodecs"), "source": source_digest(), "device": records.device()}


def differences(theirs: Any, ours: Any, who: str = "the store") -> list[str]:
    """In words, where two JSON objects differ; `who` has the first."""
    left, right = dict(_leaves(theirs)), dict(_leaves(ours))
    return [
        f"{key}: {who} has {_cut(left.get(key, 'none'))}, here it is {_cut(right.get(key, 'none'))}"
        for key in dict.fromkeys((*left, *right))
        if left.get(key) != right.get(key)
    ]


def _leaves(value: Any, where: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, dict) and not {"linspace", "geomspace"} & set(value):
        for key, part in value.items():
            yield from _leaves(part, f"{where}.{key}" if where else key)
    else:
        yield where, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _cut(text: str) -> str:
    return text if len(text) <= 100 else f"{text[:97]}..."


def files(plan: Plan, commit: str) -> dict[str, bytes]:
    """Every file of the store of `plan` without its chunks, the root metadata first; `commit`: of this package's source."""
    known = facts()
    contents: dict[str, Any] = {}
    memory = MemoryStore(contents)
    attributes = {
        MARK: FORMAT,
        "title": "Directional albedo by brdfcheck sweep",
        "convention": _CONVENTION,
        "settings": json.dumps(plan.document(), sort_keys=True),
        "versions": json.dumps(known["versions"], sort_keys=True),
        "device": json.dumps(known["device"], sort_keys=True),
        "source_digest": known["source"],
        "source_commit": commit,
    }
    group = zarr.create_group(memory, attributes=attributes)

    def add(name: str, shape: Any, dtype: Any, chunks: Any, names: list[str], text: str, **options: Any) -> Any:
        about = {"units": options.pop("units", "1"), "long_name": text, **options.pop("about", {})}
        return group.create_array(
            name, shape=shape, dtype=dtype, chunks=chunks, dimension_names=names, attributes=about,
            **{"compressors": None, "config": {"write_empty_chunks": True}, **options},
        )  # fmt: skip

    def add_values(name: str, values: np.ndarray, text: str, **options: Any) -> None:
        names = [name] if values.ndim else []
        add(name, values.shape, values.dtype, values.shape, names, text, **options)[...] = values if values.ndim else values[()]

    for axis in (*plan.held, *plan.dimensions):
        values, text = axis.values.reshape(()) if axis.held else axis.values, _LONG_NAMES.get(axis.name, axis.name)
        add_values(axis.name, values, text, units="rad" if axis.name == "azimuth" else "1")
    for axis in plan.dimensions:
        if axis.chunk > 1 or not axis.static:
            starts = np.arange(0, len(axis), axis.chunk)
            add_values(f"{axis.name}_chunk", starts, f"index along {axis.name} at which the chunk begins")
    add_values("stored_variable", np.array(RESULTS, np.dtypes.StringDType()), "variable of a chunk")
    trailing = () if plan.channels is None else (plan.channels,)
    if trailing:
        add_values("channel", np.arange(plan.channels or 0), "channel of the BRDF")
    about = {"coordinates": " ".join(axis.name for axis in plan.held)} if plan.held else {}
    names = [axis.name for axis in plan.dimensions]
    places = [axis.name if axis.static else f"{axis.name}_chunk" for axis in plan.dimensions]
    for name, text in (
        ("albedo", "directional albedo"),
        ("error", "bound on the absolute error of the directional albedo"),
    ):
        channel = ["channel"] * len(trailing)
        shapes = plan.shape + trailing, "float64", plan.chunk_shape + trailing
        add(name, *shapes, names + channel, text, fill_value=math.nan, about=about)
    # Digits of albedos do not compress; evaluations are mostly one number.
    text = "evaluations of the BRDF for one incidence"
    add("evaluations", plan.shape, "int64", plan.chunk_shape, names, text, fill_value=0, about=about, compressors="auto")
    ones, text = (1,) * len(plan.grid), "wall time of a chunk on its device"
    add("seconds", plan.grid, "float64", ones, places, text, units="s", fill_value=math.nan, about=about)
    count = len(RESULTS)
    sums = (*plan.grid, count), "uint32", (*ones, count), [*places, "stored_variable"]
    add("checksum", *sums, CHECKSUM, fill_value=0, about=about)
    with warnings.catch_warnings():
        # All metadata in one file: xarray opens the store with one look. Zarr 3 reads it, but has not yet blessed it.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        zarr.consolidate_metadata(memory)
    return {ROOT: contents[ROOT].to_bytes(), **{key: data.to_bytes() for key, data in contents.items()}}
