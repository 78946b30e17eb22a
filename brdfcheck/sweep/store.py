"""The Zarr store of a sweep: a folder that grows chunk by chunk, and is whole at every moment.

Every file is written under another name and renamed, so it is there as a whole or not at all. The root metadata come first and
make the folder a store. A chunk is albedo, error, evaluations and seconds, and last its entry in `checksum`, the CRC-32 of the
results' files: it counts as computed only once that is in place. A killed process leaves at most files without a checksum,
which are written again, and one under another name, which goes when the file itself is written, where it holds its beginning.

What a folder is, is told by what is in its files, never by their names alone. Until the first chunk is there it must hold
nothing but what this plan puts there; otherwise it is refused as it is.

The bytes follow from the configuration, versions and kind of device, but for two things: the files below ``seconds/c``, which
are measurements, and the commit noted in the attributes, which is that of the first run.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.storage import LocalStore

from brdfcheck.messages import SweepError, UsageError, one_line
from brdfcheck.output import records
from brdfcheck.sweep import layout
from brdfcheck.sweep.compute import Result
from brdfcheck.sweep.layout import CHECKSUM, MARK, RESULTS, ROOT, differences
from brdfcheck.sweep.plan import Chunk, Plan

_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))


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
        self.repaired = self.not_a_number = self.infinite = 0
        self._arrays: dict[str, Any] = {}
        self._left: dict[Path, list[Path]] = {}
        self._locked: int | None = None

    def __enter__(self) -> Store:
        try:
            self._open()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._locked is not None:
            os.close(self._locked)  # which also gives the lock back; so does the end of a process, however it ends
            self._locked = None

    def look(self) -> None:
        """Read what is there, without leaving a trace: for a dry run. Raises what opening would."""
        if self._is_there():
            with _telling(self.folder):
                self._read()

    def _open(self) -> None:
        try:
            if not self._is_there():
                self.folder.mkdir()
        except OSError as error:
            raise self._unwritable(error) from None
        self._lock()
        with _telling(self.folder):
            files, left = self._read()
            if not os.access(self.folder, os.W_OK) and len(self.done) < self.plan.chunks:
                raise UsageError(f"--out: cannot write {str(self.folder)!r}: the folder is not writable")
            for path in left:
                path.unlink()
            for path, data in ((self.folder / key, data) for key, data in files.items()):
                if path.is_symlink():  # what it leads to stays
                    path.unlink()
                path.parent.mkdir(parents=True, exist_ok=True)
                records.write_atomically(path, data)

    def _is_there(self) -> bool:
        """False where there is nothing yet. UsageError where there can be no folder, or where it is something else.

        One in a misspelt folder is not made, as no command makes a file there.
        """
        try:
            os.lstat(self.folder)
        except FileNotFoundError:
            parent = Path(os.path.realpath(self.folder)).parent
            if not parent.exists():
                raise UsageError(f"--out: cannot write {str(self.folder)!r}: the folder {parent} does not exist") from None
            return False
        except (OSError, ValueError) as error:
            raise self._unwritable(error) from None
        if not self.folder.is_dir():
            raise UsageError(f"--out: {self.folder} is a file; a store is a folder")
        return True

    def _unwritable(self, error: Exception) -> UsageError:
        return UsageError(f"--out: cannot write {str(self.folder)!r}: {getattr(error, 'strerror', None) or one_line(error)}")

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

    # --- reading what is there ---

    def _read(self) -> tuple[dict[str, bytes], list[Path]]:
        """Look at all that is there; the metadata that have to be written, and what killed processes left of these."""
        root = self.folder / ROOT
        attributes = self._compared(root) if root.is_file() else None
        if attributes is None and self._has_arrays():
            if not self.repair:
                raise self._damaged(ROOT, "is damaged" if root.exists() else "is missing")
            attributes = {"source_commit": "unknown"}
            others = [key for key in self._wrong(layout.files(self.plan, "unknown")) if key != ROOT]
            if others:  # what else describes the store must be what the configuration gives, or it may be another's
                advice = "put it back from a copy, or give another folder; the chunks are untouched"
                raise self._damaged(ROOT, f"is lost, and {others[0]} is not that of this configuration", advice)
        files = layout.files(self.plan, layout.source_commit() if attributes is None else attributes["source_commit"])
        wrong = self._wrong(files)
        marked = [] if attributes is None else self._marked()
        if wrong and not marked:  # empty, or killed while it was created
            return wrong, self._beginnings(files if attributes else {ROOT: files[ROOT]})
        if wrong and not self.repair:
            key = next(iter(wrong))
            raise self._damaged(key, "is damaged" if (self.folder / key).exists() else "is missing")
        self.repaired += len(wrong)
        for path in self.folder.rglob("*.partial"):
            if match := re.fullmatch(r"(\d+|c)\.[0-9a-f]{32}\.partial", path.name):
                self._left.setdefault(path.with_name(match[1]), []).append(path)
        for index in marked:
            if self._verified(self.plan.chunk(index)):
                self.done.add(index)
        return wrong, []

    def _compared(self, root: Path) -> dict[str, Any] | None:
        """The attributes in the root metadata, None where they cannot be read.

        UsageError where they are not those of this plan in this process.
        """
        try:
            attributes = json.loads(root.read_text(encoding="utf-8")).get("attributes", {})
            if MARK not in attributes:
                raise UsageError(f"--out: {self.folder} is a Zarr store, but not one of a sweep: give another folder")
            known = {name: json.loads(attributes[name]) for name in ("settings", "versions", "device")}
            known |= {"source": attributes["source_digest"], "format": attributes[MARK]}
            commit = str(attributes["source_commit"])
        except UsageError:
            raise
        except (ValueError, KeyError, TypeError, AttributeError):
            return None
        own = json.loads(json.dumps({"settings": self.plan.document(), "format": layout.FORMAT, **layout.facts()}))
        found = differences(known.pop("settings"), own.pop("settings"))
        if found:
            raise UsageError(f"--out: {self.folder} was made by another configuration: {'; '.join(found)}")
        found = differences(known, own)
        if found:
            raise UsageError(
                f"--out: {self.folder} was begun by other software (commit {commit}): {'; '.join(found)};"
                " continue with that, or give another folder"
            )
        return attributes

    def _has_arrays(self) -> bool:
        """True where the arrays of a sweep are there, of whatever plan."""
        path = self.folder / "checksum" / "zarr.json"
        return path.is_file() and CHECKSUM.encode() in path.read_bytes()

    def _wrong(self, files: Mapping[str, bytes]) -> dict[str, bytes]:
        """Those of these files that are not there, or not like this."""
        return {key: data for key, data in files.items() if _bytes(self.folder / key) != data}

    def _beginnings(self, files: Mapping[str, bytes]) -> list[Path]:
        """What a killed process left of these files under other names. UsageError where the folder holds anything else."""
        ways = {parent.as_posix() for key in files for parent in Path(key).parents}
        found = []
        for place, folders, names in os.walk(self.folder):
            where = Path(place).relative_to(self.folder)
            strange = [name for name in folders if (where / name).as_posix() not in ways or Path(place, name).is_symlink()]
            beside = [data for key, data in files.items() if Path(key).parent == where]
            for name in names:
                path, whole = Path(place, name), files.get((where / name).as_posix())
                begun = re.fullmatch(r"\.brdfcheck-.*\.tmp", name) is not None
                # Nothing else is read: it may be of any size.
                data = _bytes(path) if (begun or whole is not None) and not path.is_symlink() else None
                if begun and any(_begins(data, one) for one in beside):
                    found.append(path)
                elif data is None or data != whole:
                    strange.append(name)
            if strange:
                raise UsageError(f"--out: {self.folder} is not empty and holds no sweep: give another folder")
        return found

    def _marked(self) -> list[int]:
        """The numbers of the chunks that have a checksum, by what is in its folder: few of many may be there."""
        top, grid = self.folder / "checksum" / "c", self.plan.grid
        found = []
        for file in top.rglob("0"):
            *parts, _ = file.relative_to(top).parts
            if len(parts) == len(grid) and all(part.isdecimal() for part in parts) and file.is_file():
                place = tuple(map(int, parts))
                if all(i < count for i, count in zip(place, grid, strict=True)):
                    found.append(self.plan.at(place).index)
        return sorted(found)

    def _verified(self, chunk: Chunk) -> bool:
        """True where a chunk is there as a whole, and is counted. SweepError where it once was, but for a repair."""
        files = {name: _bytes(self._path(name, chunk)) for name in (*RESULTS, "seconds", "checksum")}
        sums = files["checksum"] or b""
        right = {name: None if data is None else zlib.crc32(data) for name, data in files.items()}
        wanted = dict(zip(RESULTS, np.frombuffer(sums, "<u4").tolist(), strict=True)) if len(sums) == 4 * len(RESULTS) else {}
        bad = ["checksum"] if not wanted else [name for name in RESULTS if right[name] != wanted[name]]
        # A checksum of the time would make the checksums a measurement too.
        bad += [] if _is_time(files["seconds"]) else ["seconds"]
        if not bad:
            trailing = () if self.plan.channels is None else (self.plan.channels,)
            albedo = np.frombuffer(files["albedo"] or b"", "<f8").reshape(self.plan.chunk_shape + trailing)
            self._count(albedo[tuple(slice(size) for size in chunk.shape)])  # what hangs over the end is filled up with NaN
        elif not self.repair:
            path = self._path(bad[0], chunk)
            raise self._damaged(str(path.relative_to(self.folder)), "is missing" if files[bad[0]] is None else "is damaged")
        else:
            self.repaired += 1
        return not bad

    def _count(self, albedo: np.ndarray) -> None:
        self.not_a_number += int(np.isnan(albedo).sum())
        self.infinite += int(np.isinf(albedo).sum())

    def _damaged(self, key: str, what: str, advice: str = "") -> SweepError:
        advice = advice or "run again with --repair to write it again; everything else is kept"
        return SweepError(f"the store is damaged: {self.folder / key} {what}; {advice}")

    # --- writing chunks ---

    def _path(self, name: str, chunk: Chunk) -> Path:
        channel = name in ("albedo", "error") and self.plan.channels is not None
        place = (*chunk.place, 0) if channel or name == "checksum" else chunk.place
        return self.folder.joinpath(name, "c", *map(str, place))

    def write(self, result: Result) -> None:
        """Add one chunk, whole. SweepError where that fails; then the chunk does not count."""
        chunk = self.plan.chunk(result.index)
        place = tuple(slice(i, i + 1) for i in chunk.place)
        with _telling(self.folder):
            self._path("checksum", chunk).unlink(missing_ok=True)
            sums = [self._put(name, chunk, tuple(chunk.parts.values()), getattr(result, name)) for name in RESULTS]
            self._put("seconds", chunk, place, np.full((1,) * len(place), result.seconds))
            self._put("checksum", chunk, (*place, slice(None)), np.array(sums, np.uint32).reshape((1,) * len(place) + (-1,)))
        self._count(result.albedo)
        self.done.add(result.index)

    def _put(self, name: str, chunk: Chunk, place: tuple[slice, ...], values: np.ndarray) -> int:
        """Write a chunk of an array, which Zarr does under another name. The CRC-32 of its file."""
        if name not in self._arrays:
            with zarr.config.set({"array.write_empty_chunks": True}):  # a chunk of NaN is a result, too
                self._arrays[name] = zarr.open_array(LocalStore(self.folder), path=name, mode="r+", zarr_format=3)
        path = self._path(name, chunk)
        path.unlink(missing_ok=True)  # Zarr would read what is there, to fill up what hangs over the end
        self._arrays[name][place or ...] = values
        data = path.read_bytes()
        for left in self._left.pop(path, ()):
            begun = _bytes(left)
            # The time was another one, but was one: between a nanosecond and four months.
            if _begins(begun, data) or (name == "seconds" and _is_time(begun, 1e-9, 1e7)):
                left.unlink()
        return zlib.crc32(data)


def _bytes(path: Path) -> bytes | None:
    """What is in a file, None where there is none."""
    return path.read_bytes() if path.is_file() else None


def _begins(part: bytes | None, data: bytes) -> bool:
    return part is not None and data.startswith(part)


def _is_time(data: bytes | None, least: float = 0.0, most: float = math.inf) -> bool:
    return data is not None and len(data) == 8 and bool(least <= np.frombuffer(data, "<f8")[0] < most)


@contextlib.contextmanager
def _telling(folder: Path) -> Iterator[None]:
    """SweepError for what the operating system refuses."""
    try:
        yield
    except OSError as error:
        path = error.filename or folder
        if error.errno in _FULL:
            raise SweepError(f"the disk is full: cannot write {path}; make room and run again to continue") from None
        raise SweepError(f"cannot read or write {path}: {error.strerror or one_line(error)}; run again to continue") from None
