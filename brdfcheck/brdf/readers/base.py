"""What a reader makes of a file, and how it is told what the file does not say itself."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from brdfcheck.brdf.readers.specs import is_file_spec
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.brdf.family import Family

RETURNS = ("brdf", "brdf*cos")
"""What a function may return: the BRDF, or the BRDF times the cosine at the light."""
OPTIONS = "-D, -I and --args"
"""The options of a `Reading` that are for shader files alone, for messages."""


@dataclass(frozen=True)
class Reading:
    """How files are read: of functions what they return, and of shader files the rest.

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
        roles = tuple(part.strip() for part in self.arguments)
        if roles and not ({"L", "V"} <= set(roles) and all(roles)):
            told = f"must name the arguments in order, L and V among them, as in L,V,N; got {one_line(','.join(roles))!r}"
            raise UsageError(f"--args: {told}")
        object.__setattr__(self, "arguments", roles)

    @property
    def record(self) -> dict[str, Any]:
        """The options that differ from the usual ones, for records of what was done."""
        usual = Reading()
        return (
            {} if self.is_plain else {"reading": {key: value for key, value in vars(self).items() if value != vars(usual)[key]}}
        )

    @property
    def command(self) -> list[str]:
        """The options as words of a command line."""
        words = [part for name, value in self.defines.items() for part in ("-D", f"{name}={value}")]
        words += [part for folder in self.folders for part in ("-I", folder)]
        words += ["--args", ",".join(self.arguments)] if self.arguments else []
        return words + (["--returns", self.returns] if self.returns != RETURNS[0] else [])

    @property
    def is_plain(self) -> bool:
        """True where nothing is asked for."""
        return not (self.for_shaders or self.per_cosine)

    @property
    def for_shaders(self) -> bool:
        """True where something is asked for that only shader files have."""
        return bool(self.defines or self.folders or self.arguments)

    @property
    def per_cosine(self) -> bool:
        """True where functions return the BRDF times the cosine at the light."""
        return self.returns != RETURNS[0]


class AbstractFile(abc.ABC):
    """A file that has been read and holds a BRDF with parameters.

    `spec`: its name; `path`, `line`: where the BRDF is; `files`: all that were read for it; `names`: what ranges can be given
    for; `required`: for which they must be; `whole`: which of them are whole numbers.
    """

    spec: str
    path: str
    line: int | None = None
    files: tuple[str, ...]
    names: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    whole: frozenset[str] = frozenset()

    @abc.abstractmethod
    def family(
        self, ranges: Mapping[str, Any], cos_theta: tuple[float, float] | None, no_parameter: Callable[..., str]
    ) -> Family:
        """The family over these ranges. `no_parameter` words that a name is unknown. UsageError where they do not belong."""


def refuse_reading(reading: Reading, values: Mapping[str, Any]) -> None:
    """UsageError where a reading is for none of these: names, and what they stand for."""
    from brdfcheck.brdf.family import Family

    what = ""
    if reading.for_shaders and not any(isinstance(value, AbstractFile) for value in values.values()):
        what = f"{OPTIONS} are for shader files"
    elif reading.per_cosine and not any(is_file_spec(name) and not isinstance(value, Family) for name, value in values.items()):
        what = "--returns is for functions in files"
    if what:
        raise UsageError(f"{what}; got {', '.join(values)}")
