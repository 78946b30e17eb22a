"""How files are read, as a table of a TOML file: the options of the command line by the names of `brdfcheck.load`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.documents import Model
from brdfcheck.messages import UsageError


class ReadingTable(Model):
    """``reading = { returns = "brdf*cos", args = "N,L,V", defines = { FAST = 0 }, folders = ["include"] }``."""

    returns: Literal["brdf", "brdf*cos"] = "brdf"
    args: str = ""
    defines: dict[str, str | int | float] = {}  # noqa: RUF012 - pydantic copies it
    folders: list[str] = []  # noqa: RUF012

    def reading(self, label: str) -> Reading:
        """The `Reading` that the table describes. UsageError, which begins with `label`, where it is none."""
        roles = tuple(self.args.split(",")) if self.args.strip() else ()
        try:
            return Reading({name: str(value) for name, value in self.defines.items()}, tuple(self.folders), roles, self.returns)
        except UsageError as error:
            raise UsageError(f"{label}: reading: {error}") from error


def beside(reading: Reading, folder: Path) -> Reading:
    """The reading of files in `folder`: where includes are looked for is seen from there."""
    return Reading(reading.defines, tuple(str(folder / part) for part in reading.folders), reading.arguments, reading.returns)


def as_table(reading: Reading) -> dict[str, Any]:
    """What a document says of a reading: only what is not as usual."""
    given: dict[str, Any] = {"returns": reading.returns} if reading.per_cosine else {}
    given |= {"args": ",".join(reading.arguments)} if reading.arguments else {}
    given |= {"defines": dict(reading.defines)} if reading.defines else {}
    return given | ({"folders": list(reading.folders)} if reading.folders else {})
