"""How a file is read, where it does not say so itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from brdfcheck.messages import UsageError, one_line

RETURNS = ("brdf", "brdf*cos")
"""What a function may return: the BRDF, or the BRDF times the cosine at the light."""


@dataclass(frozen=True)
class Reading:
    """Options for files of BRDFs that are not Python.

    `defines`: macros; `folders`: where includes are looked for; `arguments`: the roles L, V, N, X, Y of a function's arguments,
    in its order (any other word stands for a parameter); `returns`: one of `RETURNS`. UsageError for anything else.
    """

    defines: Mapping[str, str] = field(default_factory=dict)
    folders: tuple[str, ...] = ()
    arguments: tuple[str, ...] = ()
    returns: str = "brdf"

    def __post_init__(self) -> None:
        if self.returns not in RETURNS:
            raise UsageError(f"what a function returns is {' or '.join(RETURNS)}; got {one_line(self.returns)!r}")
        for name in self.defines:
            if not (name.isascii() and name.isidentifier()):
                raise UsageError(f"{one_line(name)!r} is no name of a macro")

    @property
    def is_plain(self) -> bool:
        """True where nothing is asked for."""
        return not (self.defines or self.folders or self.arguments) and self.returns == RETURNS[0]
