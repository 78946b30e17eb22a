"""The Zarr store of a sweep: a folder that grows chunk by chunk, and is whole at every moment.

Every file is written under another name and renamed, so it is there as a whole or not at all. A chunk is albedo, error,
evaluations and seconds, and last its entry in `checksum`, the CRC-32 of the results' files: it counts as computed only once
that is in place. A killed process leaves at most files without a checksum, which are written again.

What a folder is, is told by what is in its files, never by their names alone. The first file of a new store is its root
metadata under another name, and renaming it is the last step of creation. A folder in between belongs to this program only
where every file in it holds what this plan puts there, or the beginning of that; otherwise it is refused as it is. Of files
under temporary names, only such beginnings are written over.

The bytes follow from the configuration, versions and kind of device, but for two things: the files below ``seconds/c``, which
are measurements, and the commit noted in the attributes, which is that of the first run.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import json
import math
import os
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
# The file that makes a folder a store, and its name while the other files are being written.
_ROOT, _UNFINISHED = "zarr.json", "zarr.json.unfinished"
_CHECKSUM = "CRC-32 of the chunk's files, written last"
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

    `done`: the numbers of the chunks that are there, each verified by its checksum; `not_a_number` and `infinite`: how many
    of their albedos are. UsageError for a folder that is something else, belongs to other settings or versions, cannot be
    written, or is in use; SweepError where the store is damaged (`repair` makes what is damaged be written again) or the
    disk is full.
    """

    def __init__(self, folder: str | os.PathLike[str], plan: Plan, *, repair: bool = False):
        self.folder = Path(folder)
        self.plan = plan
        self.repair = repair
        self.done: set[int] = set()
        self.repaired = 0
        self.not_a_number = 0
        self.infinite = 0
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
        self._refuse_place()
        with _reading(self.folder):
            if not os.path.lexists(self.folder):
                return
            if not self.folder.is_dir():
                raise UsageError(f"--out: {self.folder} is not a folder; a store is a folder")
            if not self._is_unfinished():
                self._read()

    def _open(self) -> None:
        self._refuse_place()
        try:
            self.folder.mkdir(exist_ok=True)
        except FileExistsError:
            raise UsageError(f"--out: {self.folder} is a file; a store is a folder") from None
        except OSError as error:
            raise _unwritable(self.folder, error) from None
        self._lock()
        with _reading(self.folder):
            unfinished = self._is_unfinished()
            if not unfinished:
                self._read()
        if not os.access(self.folder, os.W_OK) and len(self.done) < self.plan.chunks:
            raise UsageError(f"--out: cannot write {str(self.folder)!r}: the folder is not writable")
        if unfinished:
            try:
                self._create()
            except OSError as error:
                raise _unwritable(self.folder, error) from None

    def _refuse_place(self) -> None:
        """UsageError where there can be no folder. One in a misspelt folder is not made, as no command makes a file there."""
        try:
            os.lstat(self.folder)
        except FileNotFoundError:
            parent = Path(os.path.realpath(self.folder)).parent
            if not parent.exists():
                raise UsageError(f"--out: cannot write {str(self.folder)!r}: the folder {parent} does not exist") from None
        except (OSError, ValueError) as error:
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
        """True for an empty folder, and for one in which the creation of this store was interrupted; False for a store.

        UsageError for anything else.
        """
        if (self.folder / _ROOT).is_file():
            return False
        begun = self.folder / _UNFINISHED
        if begun.is_file():
            attributes = self._compared(begun)
            if attributes is None or not self._holds_only(self._new_files(attributes["source_commit"])):
                raise self._no_sweep()
            return True
        if self._has_arrays():
            if not self.repair:
                raise self._damaged(_ROOT, "is missing")
            return False
        names = os.listdir(self.folder)
        if names and not (names == [_partial(begun).name] and self._is_begun_root(_partial(begun))):
            raise self._no_sweep()
        return True

    def _no_sweep(self) -> UsageError:
        return UsageError(f"--out: {self.folder} is not empty and holds no sweep: give another folder")

    def _has_arrays(self) -> bool:
        """True where the arrays of a sweep are there, of whatever plan."""
        path = self.folder / "checksum" / "zarr.json"
        return path.is_file() and _CHECKSUM.encode() in path.read_bytes()

    def _holds_only(self, files: Mapping[str, bytes]) -> bool:
        """True where each entry of the folder is one of these files, the beginning of one that is not there, or on the way."""
        ways = {parent.as_posix() for key in files for parent in Path(key).parents}
        beginnings = {_partial(Path(key)).as_posix(): key for key in files}
        for place, folders, names in os.walk(self.folder):
            where = Path(place).relative_to(self.folder)
            if any((where / name).as_posix() not in ways or Path(place, name).is_symlink() for name in folders):
                return False
            for name in names:
                key, path = (where / name).as_posix(), Path(place, name)
                if key in files:
                    known = _is_beginning(path, files[key]) and path.stat().st_size == len(files[key])
                else:
                    whole = beginnings.get(key)
                    known = whole is not None and not (self.folder / whole).exists() and _is_beginning(path, files[whole])
                if not known:
                    return False
        return True

    def _is_begun_root(self, path: Path) -> bool:
        """True for the beginning of the root metadata of any sweep: what comes before its settings is the same in all."""
        head = self._new_files("")[_UNFINISHED].partition(b'"settings"')[0]
        if not _is_regular(path):
            return False
        data = path.read_bytes()
        return data.startswith(head) or head.startswith(data)

    def _create(self) -> None:
        begun = self.folder / _UNFINISHED
        if begun.exists():
            commit = json.loads(begun.read_text(encoding="utf-8"))["attributes"]["source_commit"]
        else:
            commit = provenance.source_commit()
            if os.path.lexists(_partial(begun)) and self._is_begun_root(_partial(begun)):
                _partial(begun).unlink()
        for key, data in self._new_files(commit).items():
            if not (self.folder / key).exists():
                _write(self.folder / key, data)
        os.replace(begun, self.folder / _ROOT)

    def _new_files(self, commit: str) -> dict[str, bytes]:
        """The files of a store without chunks by their names during its creation, in the order in which they are written."""
        files = self._files(self._attributes(commit))
        return {_UNFINISHED: files.pop(_ROOT), **files}

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
        """Every file of a store without chunks."""
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
             _CHECKSUM),
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
        return _contents(memory)

    # --- reading what is there ---

    def _read(self) -> None:
        root = self.folder / _ROOT
        attributes = self._compared(root) if root.is_file() else None
        if attributes is None:
            if root.is_file() and _MARK.encode() not in root.read_bytes() and not self._has_arrays():
                raise self._no_sweep()
            if not self.repair:
                raise self._damaged(_ROOT, "is damaged")
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
            if key != _ROOT and (path.read_bytes() if path.is_file() else None) != data:
                raise self._damaged(_ROOT, f"is lost, and {key} is not that of this configuration", mend=False)
        return attributes

    def _compared(self, root: Path) -> dict[str, Any] | None:
        """The attributes in a file of root metadata, None where they cannot be read.

        UsageError where they are not those of this plan in this process.
        """
        try:
            attributes = json.loads(root.read_text(encoding="utf-8")).get("attributes", {})
            if _MARK not in attributes:
                raise UsageError(f"--out: {self.folder} is a Zarr store, but not one of a sweep: give another folder")
            known = {name: json.loads(attributes[name]) for name in ("settings", "versions", "device")}
            known["source"] = attributes["source_digest"]
            known["format"] = attributes[_MARK]
            assert isinstance(attributes["source_commit"], str)
        except (ValueError, KeyError, TypeError, AttributeError, AssertionError):
            return None
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
        """True where a chunk is there as a whole, and is counted. SweepError where it once was, but for a repair."""
        marker = self.folder / self._key("checksum", chunk)
        if not marker.is_file():
            return False
        sums = np.frombuffer(marker.read_bytes(), "<u4") if marker.stat().st_size == 4 * len(_RESULTS) else None
        trouble, files = None, {}
        if sums is None:
            trouble = self._key("checksum", chunk), "is damaged"
        else:
            for name, expected in zip(_RESULTS, sums, strict=True):
                path = self.folder / self._key(name, chunk)
                if not path.is_file():
                    trouble = self._key(name, chunk), "is missing"
                elif zlib.crc32(files.setdefault(name, path.read_bytes())) != expected:
                    trouble = self._key(name, chunk), "is damaged"
                if trouble:
                    break
            if trouble is None:
                trouble = self._mistimed(chunk)
        if trouble is None:
            trailing = () if self.plan.channels is None else (self.plan.channels,)
            albedo = np.frombuffer(files["albedo"], "<f8").reshape(self.plan.chunk_shape + trailing)
            self._count(albedo[tuple(slice(size) for size in chunk.shape)])  # what hangs over the end is filled up with NaN
            return True
        if not self.repair:
            raise self._damaged(*trouble)
        self.repaired += 1
        return False

    def _count(self, albedo: np.ndarray) -> None:
        self.not_a_number += int(np.isnan(albedo).sum())
        self.infinite += int(np.isinf(albedo).sum())

    def _mistimed(self, chunk: Chunk) -> tuple[str, str] | None:
        """What is wrong with the time of a chunk. A checksum of it would make the checksums a measurement too."""
        path = self.folder / self._key("seconds", chunk)
        if not path.is_file():
            return self._key("seconds", chunk), "is missing"
        if not _is_time(path.read_bytes(), 0.0, math.inf):
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
            timed = self.folder / self._key("seconds", chunk)
            _discard_time(_partial(timed))
            _write(timed, self._encoded("seconds", chunk, place, seconds))
            total = np.array(sums, np.uint32).reshape((1,) * len(place) + (len(_RESULTS),))
            marker = self._encoded("checksum", chunk, (*place, slice(None)), total)
            _write(self.folder / self._key("checksum", chunk), marker)
        except OSError as error:
            raise SweepError(f"cannot write to {self.folder}: {error.strerror or error}; run again to continue") from None
        self._count(result.albedo)
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


def _partial(path: Path, number: int = 1) -> Path:
    """The name under which a file is written."""
    return path.with_name(f".{path.name}{'' if number == 1 else f'.{number}'}.partial")


def _is_regular(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _is_beginning(path: Path, data: bytes) -> bool:
    """True for a file that holds the beginning of `data`, or all of it: what a killed process leaves."""
    return _is_regular(path) and path.stat().st_size <= len(data) and data.startswith(path.read_bytes())


def _is_time(data: bytes, least: float, most: float) -> bool:
    return len(data) == 8 and bool(least <= np.frombuffer(data, "<f8")[0] < most)


def _discard_time(partial: Path) -> None:
    """Remove what a killed process left of the time of a chunk: not what it will be now, but a time (1 ns to 4 months)."""
    if _is_regular(partial) and partial.stat().st_size == 8 and _is_time(partial.read_bytes(), 1e-9, 1e7):
        partial.unlink()


def _write(path: Path, data: bytes) -> None:
    """The file as a whole or not at all. SweepError where the disk is full, OSError for other trouble."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # What is at that name is ours where it holds the beginning of these data; otherwise it is somebody's and stays.
        names = (_partial(path, number) for number in itertools.count(1))
        partial = next(name for name in names if not os.path.lexists(name) or _is_beginning(name, data))
        with Cleanup(lambda: os.unlink(partial)):
            try:
                with open(partial, "wb") as stream:
                    stream.write(data)
                os.replace(partial, path)
            except OSError:  # what is there now is what was written here
                partial.unlink(missing_ok=True)
                raise
    except OSError as error:
        if error.errno in _FULL:
            raise _full(path) from None
        raise


def _full(path: Path) -> SweepError:
    return SweepError(f"the disk is full: cannot write {path}; make room and run again to continue")


@contextlib.contextmanager
def _reading(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise SweepError(f"cannot read or mend {error.filename or folder}: {error.strerror or one_line(error)}") from None


def _unwritable(folder: Path, error: Exception) -> UsageError:
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
