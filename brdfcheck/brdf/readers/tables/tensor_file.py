"""Tensor files, in which the RGL database keeps its tables: named arrays one after the other.

"tensor_file" and a zero byte; the version, bytes 1 and 0; how many arrays there are (uint32). Of each array: the length of its
name (uint16) and the name, its dimensions (uint16), the kind of its numbers (uint8), where it begins in the file (uint64), its
shape (uint64 each). All little-endian.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np

from brdfcheck.brdf.readers.tables.file import mistake
from brdfcheck.messages import one_line

MAGIC = b"tensor_file\0"
_LONGEST = 64
KINDS = dict(enumerate(("u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f2", "<f4", "<f8"), start=1))
"""What numbers an array holds, by their number in the file."""


def read_arrays(data: np.ndarray, path: str) -> dict[str, np.ndarray]:
    """The arrays of a tensor file, as views of its bytes. UsageError where they are not what the format allows."""
    if bytes(data[: len(MAGIC)]) != MAGIC:
        raise mistake(path, "is no tensor file: it does not begin with 'tensor_file'")
    place = len(MAGIC)

    def taken(form: str, what: str) -> tuple[Any, ...]:
        nonlocal place
        size = struct.calcsize("<" + form)
        if place + size > len(data):
            raise mistake(path, f"is truncated: it ends within {what}")
        found = struct.unpack("<" + form, bytes(data[place : place + size]))
        place += size
        return found

    major, minor, count = taken("BBI", "the header")
    if (major, minor) != (1, 0):
        raise mistake(path, f"is a tensor file of version {major}.{minor}; version 1.0 is read")
    arrays: dict[str, np.ndarray] = {}
    for number in range(count):
        what = f"the description of array {number + 1} of {count}"
        (length,) = taken("H", what)
        if length > _LONGEST:
            raise mistake(path, f"{what} has a name of {length} bytes; at most {_LONGEST} are read")
        name = one_line(taken(f"{length}s", what)[0].decode("utf-8", "backslashreplace"))
        dimensions, kind, offset = taken("HBQ", what)
        shape = taken(f"{dimensions}Q", what)
        if kind not in KINDS:
            raise mistake(path, f"the array {name!r} has numbers of kind {kind}; kinds 1 to {max(KINDS)} are known")
        if name in arrays:
            raise mistake(path, f"the array {name!r} is there twice")
        if dimensions > 8:
            raise mistake(path, f"the array {name!r} has {dimensions} dimensions; at most 8 are read")
        dtype = np.dtype(KINDS[kind])
        end = offset + math.prod(shape) * dtype.itemsize
        if end > len(data):
            sizes = " x ".join(map(str, shape)) or "1"
            raise mistake(path, f"the array {name!r} ({sizes}) ends at byte {end}; the file has {len(data)}: it is truncated")
        # An array with nothing in it may claim any size besides.
        full = end > offset
        arrays[name] = np.frombuffer(data[offset:end].data, dtype).reshape(shape) if full else np.empty(0, dtype)
    return arrays
