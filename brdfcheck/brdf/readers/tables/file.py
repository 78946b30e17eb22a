"""A file that holds a measured BRDF: mapped into memory, checked, and without parameters."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.readers.base import AbstractFile
from brdfcheck.brdf.readers.specs import split_spec
from brdfcheck.brdf.tables import AbstractTable
from brdfcheck.folders import readable
from brdfcheck.messages import UsageError, one_line


def mistake(path: str, message: str) -> UsageError:
    """What is wrong with a file, to be raised."""
    return UsageError(f"{one_line(path)}: {one_line(message)}")


def mapped(path: str) -> np.ndarray:
    """The bytes of a file, mapped into memory and not read yet. UsageError where that cannot be done."""
    with readable(path, "a file"):
        if Path(path).stat().st_size == 0:
            raise mistake(path, "is empty")
        return np.memmap(path, np.uint8, "r")


class AbstractTableFile(AbstractFile):
    """A file with one BRDF and no parameters. `table` is what it holds. UsageError where it is not in its format."""

    def __init__(self, spec: str):
        path, name = split_spec(spec)
        if name is not None:
            raise UsageError(f"{one_line(path)}:{one_line(name)}: a measured file holds one BRDF: give {one_line(path)} alone")
        self.spec, self.path, self.files = path, path, (path,)
        self.table = self.read(mapped(path))

    @abc.abstractmethod
    def read(self, data: np.ndarray) -> AbstractTable:
        """The BRDF in the bytes of a file. UsageError where there is none."""

    def family(
        self, ranges: Mapping[str, Any], cos_theta: tuple[float, float] | None, no_parameter: Callable[..., str]
    ) -> Family:
        """The family of one that is the table. UsageError for any range."""
        for name in ranges:
            raise UsageError(no_parameter(self.path, name, ()))

        def build() -> AbstractTable:
            return self.table

        build.__name__ = Path(self.path).name
        return Family(self.path, build, {}, (0.0, 1.0) if cos_theta is None else cos_theta)
