"""The Zarr store of a sweep: a folder that grows chunk by chunk, and is whole at every moment.

Every file is written under another name and renamed, so it is there as a whole or not at all. A chunk is albedo, error,
evaluations and seconds, and last its entry in `checksum`, the CRC-32 of the results' files: it counts as computed only once
that is in place. A killed process leaves at most files without a checksum, which are written again.

The bytes follow from the configuration, versions and kind of device, but for two things: the files below ``seconds/c``, which
are measurements, and the commit noted in the attributes, which is that of the first run.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import shutil
import warnings
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.storage import MemoryStore

from brdfcheck.interruption import Cleanup
from brdfcheck.messages import UsageError, one_line
from brdfcheck.sweep import provenance
from brdfcheck.sweep.compute import Result
from brdfcheck.sweep.errors import SweepError
from brdfcheck.sweep.plan import Chunk, Plan

FORMAT = 1
_MARK = "brdfcheck_sweep"
_RESULTS = ("albedo", "error", "evaluations")
_PARTIAL = ".partial"
_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))

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


class Store:
    """The store of `plan` in `folder`. Use as a context manager: one process at a time may write.

    `done`: the numbers of the chunks that are there, each verified by its checksum. UsageError for a folder that is
    something else, belongs to other settings or versions, cannot be written, or is in use; SweepError where the store is
    damaged (`repair` makes what is damaged be written again) or the disk is full.
    """

    def __init__(self, folder: str | os.PathLike[str], plan: Plan, *, repair: bool = False):
        self.folder = Path(folder)
        self.plan = plan
        self.repair = repair
        self.done: set[int] = set()
        self.repaired = 0
        self._memory = MemoryStore()
        self._arrays: dict[str, Any] = {}
        self._locked: int | None = None

    def __enter__(self) -> Store:
        try:
            self._open()
        except BaseException:
            self._unlock()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._unlock()

    def look(self) -> None:
        """Read what is there, without leaving a trace: for a dry run. Raises what opening would."""
        if not self.folder.exists() or (self.folder.is_dir() and self._is_unfinished()):
            return
        with _reading(self.folder):
            self._read()

    def _open(self) -> None:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise UsageError(f"--out: {self.folder} is a file; a store is a folder") from None
        except (OSError, ValueError) as error:
            raise _unwritable(self.folder, error) from None
        self._lock()
        if self._is_unfinished():
            self._create()
            return
        with _reading(self.folder):
            for leftover in self.folder.rglob(f".*{_PARTIAL}"):
                leftover.unlink(missing_ok=True)
            self._read()
        if len(self.done) < self.plan.chunks:
            try:
                _write(self.folder / ".brdfcheck-trial", b"")
                (self.folder / ".brdfcheck-trial").unlink()
            except (OSError, SweepError) as error:
                raise _unwritable(self.folder, error) from None

    # --- one writer ---

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # Windows: two runs on one store are not noticed
            return
        try:
            self._locked = os.open(self.folder, os.O_RDONLY)
            fcntl.flock(self._locked, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(f"--out: another process is writing to {self.folder}") from None
        except OSError:  # a file system without locks
            return

    def _unlock(self) -> None:
        if self._locked is not None:
            os.close(self._locked)  # which also gives the lock back; so does the end of a process, however it ends
            self._locked = None

    # --- creating ---

    def _is_unfinished(self) -> bool:
        """True for an empty folder, and for one whose creation was interrupted: zarr.json is its last file."""
        with _reading(self.folder):
            names = {entry.name for entry in self.folder.iterdir()}
        known = {*_RESULTS, "seconds", "checksum"}
        begun = any((self.folder / name / "c").exists() for name in known)
        if "zarr.json" in names or (self.repair and begun):
            return False
        ours = {key.split("/")[0] for key in self._files({})}
        if not all(name in ours or name.endswith(_PARTIAL) for name in names):
            if known <= names:
                raise self._damaged("zarr.json", "is missing")
            raise UsageError(f"--out: {self.folder} is not empty and holds no sweep: give another folder")
        if begun:
            raise self._damaged("zarr.json", "is missing")
        return True

    def _create(self) -> None:
        for entry in self.folder.iterdir():
            with contextlib.suppress(OSError):
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        attributes = self._attributes(provenance.source_commit())
        try:
            for key, data in self._files(attributes).items():
                _write(self.folder / key, data)
        except OSError as error:
            raise _unwritable(self.folder, error) from None

    def _attributes(self, commit: str) -> dict[str, Any]:
        facts = provenance.facts()
        return {
            _MARK: FORMAT,
            "title": "Directional albedo by brdfcheck sweep",
            "convention": _CONVENTION,
            "settings": json.dumps(self.plan.document(), sort_keys=True),
            "versions": json.dumps(facts["versions"], sort_keys=True),
            "device": json.dumps(facts["device"], sort_keys=True),
            "source_digest": facts["source"],
            "source_commit": commit,
        }

    def _files(self, attributes: Mapping[str, Any]) -> dict[str, bytes]:
        """Every file of a store without chunks, the one that makes it a store last."""
        memory = MemoryStore()
        group = zarr.create_group(memory, attributes=dict(attributes))
        plan = self.plan
        held = [name for name in plan.held]
        scalars = " ".join(held)

        def add(name: str, values: np.ndarray, dimensions: list[str], units: str, long_name: str) -> None:
            array = group.create_array(
                name,
                shape=values.shape,
                dtype=values.dtype,
                chunks=values.shape,
                dimension_names=dimensions,
                attributes={"units": units, "long_name": long_name},
                compressors=None,
                config={"write_empty_chunks": True},
            )
            array[...] = values if values.ndim else values[()]

        for name in (*plan.held, *(dimension.name for dimension in plan.dimensions)):
            values = plan.values(name)
            dimensions = [] if name in plan.held else [name]
            units = "rad" if name == "azimuth" else "1"
            add(name, values[0:1].reshape(()) if name in plan.held else values, dimensions, units, _LONG_NAMES.get(name, name))
        for dimension in plan.dimensions:
            if dimension.chunk > 1 or not dimension.static:
                starts = np.arange(0, len(dimension), dimension.chunk)
                text = f"index along {dimension.name} at which the chunk begins"
                add(f"{dimension.name}_chunk", starts, [f"{dimension.name}_chunk"], "1", text)
        add("stored_variable", np.array(_RESULTS, np.dtypes.StringDType()), ["stored_variable"], "1", "variable of a chunk")
        trailing = () if plan.channels is None else (plan.channels,)
        if plan.channels is not None:
            add("channel", np.arange(plan.channels), ["channel"], "1", "channel of the BRDF")
        names = [dimension.name for dimension in plan.dimensions]
        places = [dimension.name if dimension.static else f"{dimension.name}_chunk" for dimension in plan.dimensions]
        channel = ["channel"] if trailing else []
        ones = (1,) * len(plan.grid)
        for name, dtype, shape, chunks, dimensions, fill, units, text in (
            ("albedo", "float64", plan.shape + trailing, plan.chunk_shape + trailing, names + channel, math.nan, "1",
             "directional albedo"),
            ("error", "float64", plan.shape + trailing, plan.chunk_shape + trailing, names + channel, math.nan, "1",
             "bound on the absolute error of the directional albedo"),
            ("evaluations", "int64", plan.shape, plan.chunk_shape, names, 0, "1",
             "evaluations of the BRDF for one incidence"),
            ("seconds", "float64", plan.grid, ones, places, math.nan, "s", "wall time of a chunk on its device"),
            ("checksum", "uint32", (*plan.grid, len(_RESULTS)), (*ones, len(_RESULTS)), [*places, "stored_variable"], 0, "1",
             "CRC-32 of the chunk's files, written last"),
        ):  # fmt: skip
            group.create_array(
                name,
                shape=shape,
                dtype=dtype,
                chunks=chunks,
                fill_value=fill,
                dimension_names=dimensions,
                attributes={"units": units, "long_name": text, **({"coordinates": scalars} if scalars else {})},
                # Digits of albedos do not compress; evaluations are mostly one number.
                compressors="auto" if name == "evaluations" else None,
                config={"write_empty_chunks": True},
            )
        with warnings.catch_warnings():
            # All metadata in one file: xarray opens the store with one look. Zarr 3 reads it, but has not yet blessed it.
            warnings.filterwarnings("ignore", message="Consolidated metadata")
            zarr.consolidate_metadata(memory)
        files = _contents(memory)
        root = files.pop("zarr.json")
        return {**files, "zarr.json": root}

    # --- reading what is there ---

    def _read(self) -> None:
        if not self.folder.is_dir():
            raise UsageError(f"--out: {self.folder} is not a folder; a store is a folder")
        attributes = self._compared()
        if attributes is None:
            attributes = self._rebuilt()
        for key, data in self._files(self._attributes(attributes["source_commit"])).items():
            path = self.folder / key
            found = path.read_bytes() if path.is_file() else None
            if found == data:
                continue
            if not self.repair:
                raise self._damaged(key, "is missing" if found is None else "is damaged")
            self.repaired += 1
            _write(path, data)
        for index in self._marked():
            if self._verified(self.plan.chunk(index)):
                self.done.add(index)

    def _marked(self) -> list[int]:
        """The numbers of the chunks that have a checksum, by what is in its folder: few of many may be there."""
        top, grid = self.folder / "checksum" / "c", self.plan.grid
        found = []
        for file in sorted(top.rglob("0")):
            parts = file.relative_to(top).parts
            if len(parts) != len(grid) + 1 or not all(part.isdecimal() for part in parts):
                continue
            place = tuple(map(int, parts[:-1]))
            if all(i < count for i, count in zip(place, grid, strict=True)) and file.is_file():
                found.append(int(np.ravel_multi_index(place, grid)) if place else 0)
        return sorted(found)

    def _rebuilt(self) -> dict[str, Any]:
        """The attributes anew, where their file is lost and everything else that describes the store is that of this plan.

        What the plan does not say is the commit. SweepError where something else is damaged too.
        """
        attributes = self._attributes("unknown")
        for key, data in self._files(attributes).items():
            path = self.folder / key
            if key != "zarr.json" and (path.read_bytes() if path.is_file() else None) != data:
                raise self._damaged("zarr.json", f"is lost, and {key} is not that of this configuration", mend=False)
        return attributes

    def _compared(self) -> dict[str, Any] | None:
        """The attributes of the store, None where they are lost and may be written again.

        UsageError where they are not those of this plan in this process.
        """
        path = self.folder / "zarr.json"
        if not path.exists():
            if self.repair:
                return None
            raise self._damaged("zarr.json", "is missing")
        try:
            attributes = json.loads(path.read_text(encoding="utf-8")).get("attributes", {})
            if _MARK not in attributes:
                raise UsageError(f"--out: {self.folder} is a Zarr store, but not one of a sweep: give another folder")
            known = {name: json.loads(attributes[name]) for name in ("settings", "versions", "device")}
            known["source"] = attributes["source_digest"]
            known["format"] = attributes[_MARK]
            assert isinstance(attributes["source_commit"], str)
        except (ValueError, KeyError, TypeError, AttributeError, AssertionError):
            if self.repair:
                return None
            raise self._damaged("zarr.json", "is damaged") from None
        own = {"settings": self.plan.document(), **provenance.facts(), "format": FORMAT}
        own = json.loads(json.dumps(own))
        differences = _differences(known["settings"], own["settings"], "")
        if differences:
            raise UsageError(f"--out: {self.folder} was made by another configuration: {'; '.join(differences)}")
        for name in ("format", "versions", "source", "device"):
            differences += _differences(known[name], own[name], name)
        if differences:
            commit = attributes["source_commit"]
            raise UsageError(
                f"--out: {self.folder} was begun by other software (commit {commit}): {'; '.join(differences)};"
                " continue with that, or give another folder"
            )
        return attributes

    def _verified(self, chunk: Chunk) -> bool:
        """True where a chunk is there as a whole. SweepError where it once was, but for a repair."""
        marker = self.folder / self._key("checksum", chunk)
        if not marker.is_file():
            return False
        sums = np.frombuffer(marker.read_bytes(), "<u4") if marker.stat().st_size == 4 * len(_RESULTS) else None
        trouble = None
        if sums is None:
            trouble = self._key("checksum", chunk), "is damaged"
        else:
            for name, expected in zip(_RESULTS, sums, strict=True):
                path = self.folder / self._key(name, chunk)
                if not path.is_file():
                    trouble = self._key(name, chunk), "is missing"
                elif zlib.crc32(path.read_bytes()) != expected:
                    trouble = self._key(name, chunk), "is damaged"
                if trouble:
                    break
            if trouble is None:
                trouble = self._mistimed(chunk)
        if trouble is None:
            return True
        if not self.repair:
            raise self._damaged(*trouble)
        self.repaired += 1
        return False

    def _mistimed(self, chunk: Chunk) -> tuple[str, str] | None:
        """What is wrong with the time of a chunk. A checksum of it would make the checksums a measurement too."""
        path = self.folder / self._key("seconds", chunk)
        if not path.is_file():
            return self._key("seconds", chunk), "is missing"
        data = path.read_bytes()
        if len(data) != 8 or not 0 <= np.frombuffer(data, "<f8")[0] < math.inf:
            return self._key("seconds", chunk), "is damaged"
        return None

    def _damaged(self, key: str, what: str, *, mend: bool = True) -> SweepError:
        advice = (
            "run again with --repair to write it again; everything else is kept"
            if mend
            else "put it back from a copy, or give another folder; the chunks are untouched"
        )
        return SweepError(f"the store is damaged: {self.folder / key} {what}; {advice}")

    # --- writing chunks ---

    def _key(self, name: str, chunk: Chunk) -> str:
        place: tuple[int, ...] = chunk.place
        if name == "checksum" or (name in ("albedo", "error") and self.plan.channels is not None):
            place = (*place, 0)
        return "/".join((name, "c", *map(str, place)))

    def write(self, result: Result) -> None:
        """Add one chunk, whole. SweepError where that fails; then the chunk does not count."""
        chunk = self.plan.chunk(result.index)
        assert result.albedo.shape[: len(chunk.shape)] == chunk.shape
        place = tuple(slice(i, i + 1) for i in chunk.place)
        sums = []
        try:
            for name in _RESULTS:
                data = self._encoded(name, chunk, chunk.slices, getattr(result, name))
                sums.append(zlib.crc32(data))
                _write(self.folder / self._key(name, chunk), data)
            seconds = np.reshape(result.seconds, (1,) * len(place))
            _write(self.folder / self._key("seconds", chunk), self._encoded("seconds", chunk, place, seconds))
            total = np.array(sums, np.uint32).reshape((1,) * len(place) + (len(_RESULTS),))
            marker = self._encoded("checksum", chunk, (*place, slice(None)), total)
            _write(self.folder / self._key("checksum", chunk), marker)
        except OSError as error:
            raise SweepError(f"cannot write to {self.folder}: {error.strerror or error}; run again to continue") from None
        self.done.add(result.index)

    def _encoded(self, name: str, chunk: Chunk, place: tuple[slice, ...], values: np.ndarray) -> bytes:
        """The bytes of a chunk's file, as Zarr makes them."""
        if name not in self._arrays:
            if not self._arrays:
                for key, data in self._files({}).items():
                    if key.endswith("zarr.json"):
                        _put(self._memory, key, data)
            with zarr.config.set({"array.write_empty_chunks": True}):  # a chunk of NaN is a result, too
                self._arrays[name] = zarr.open_array(self._memory, path=name, mode="r+", zarr_format=3)
        self._arrays[name][place if place else ...] = values if place else values.reshape(())[()]
        return self._memory._store_dict.pop(self._key(name, chunk)).to_bytes()


def _contents(memory: MemoryStore) -> dict[str, bytes]:
    return {key: value.to_bytes() for key, value in memory._store_dict.items()}


def _put(memory: MemoryStore, key: str, data: bytes) -> None:
    from zarr.core.buffer import default_buffer_prototype

    memory._store_dict[key] = default_buffer_prototype().buffer.from_bytes(data)


def _write(path: Path, data: bytes) -> None:
    """The file as a whole or not at all. SweepError where the disk is full, OSError for other trouble."""
    partial = path.with_name(f".{path.name}{_PARTIAL}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with Cleanup(lambda: os.unlink(partial)):
            with open(partial, "wb") as stream:
                stream.write(data)
            os.replace(partial, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        if error.errno in _FULL:
            raise SweepError(f"the disk is full: cannot write {path}; make room and run again to continue") from None
        raise


@contextlib.contextmanager
def _reading(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise SweepError(f"cannot read or mend {error.filename or folder}: {error.strerror or one_line(error)}") from None


def _unwritable(folder: Path, error: Exception) -> UsageError:
    if isinstance(error, SweepError):
        raise error
    return UsageError(f"--out: cannot write {str(folder)!r}: {getattr(error, 'strerror', None) or one_line(error)}")


def _differences(stored: Any, own: Any, where: str) -> list[str]:
    """In words, where two JSON objects differ."""
    if stored == own and json.dumps(stored) == json.dumps(own):
        return []
    if isinstance(stored, dict) and isinstance(own, dict) and not _is_spec(stored) and not _is_spec(own):
        found = []
        for key in dict.fromkeys((*stored, *own)):
            inner = f"{where}.{key}" if where else key
            if key not in stored:
                found.append(f"{inner}: the store has none, here it is {_shown(own[key])}")
            elif key not in own:
                found.append(f"{inner}: the store has {_shown(stored[key])}, here there is none")
            else:
                found += _differences(stored[key], own[key], inner)
        return found
    return [f"{where}: the store has {_shown(stored)}, here it is {_shown(own)}"]


def _is_spec(value: dict[str, Any]) -> bool:
    return len(value) == 1 and next(iter(value)) in ("linspace", "geomspace")


def _shown(value: Any) -> str:
    if isinstance(value, dict) and _is_spec(value):
        ((form, arguments),) = value.items()
        return f"{form} {_shown(arguments)}"
    text = json.dumps(value, ensure_ascii=False) if not isinstance(value, str) else value
    return text if len(text) <= 100 else f"{text[:97]}..."
