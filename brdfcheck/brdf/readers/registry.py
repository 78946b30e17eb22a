"""The kinds of files that BRDFs are read from: one row for each reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from brdfcheck.brdf.readers.base import OPTIONS, Reading
from brdfcheck.brdf.readers.specs import SUFFIXES, split_spec, suffix_of
from brdfcheck.messages import UsageError, one_line

Modules = dict[str, ModuleType]


@dataclass(frozen=True)
class Reader:
    """A kind of file. `load` takes the full spec, how to read it, and the Python modules loaded so far.

    It returns what the file holds, something callable or an `AbstractFile`, and its full name. `example`: how it is named;
    `needs`: what of this package has to be installed for it; `asks`: that the options of a `Reading` are for it.
    """

    name: str
    suffixes: tuple[str, ...]
    example: str
    needs: str
    load: Callable[[str, Reading, Modules], tuple[Any, str]]
    asks: bool = True


def _python(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.python import load_object

    del reading
    return load_object(spec, modules)


def _shader(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.glsl.shader import ShaderFile

    del modules
    file = ShaderFile(*split_spec(spec), reading)
    return file, file.spec


def _merl(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.tables.merl import MerlFile

    del reading, modules
    file = MerlFile(*split_spec(spec))
    return file, file.spec


def _rgl(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.tables.rgl import RglFile

    del reading, modules
    file = RglFile(*split_spec(spec))
    return file, file.spec


_PLAIN = "the plain installation"
READERS = (
    Reader("Python", (".py",), "mine.py:brdf", _PLAIN, _python, asks=False),
    Reader("BRDF Explorer", (".brdf",), "mine.brdf", _PLAIN, _shader),
    Reader("GLSL", (".glsl", ".frag", ".glslf", ".fs"), "mine.glsl:FUNCTION", _PLAIN, _shader),
    Reader("HLSL", (".hlsl",), "mine.hlsl:FUNCTION", _PLAIN, _shader),
    Reader("Slang", (".slang",), "mine.slang:FUNCTION", _PLAIN, _shader),
    Reader("MERL", (".binary",), "measured.binary", _PLAIN, _merl, asks=False),
    Reader("RGL", (".bsdf",), "measured.bsdf", _PLAIN, _rgl, asks=False),
)
assert {suffix for reader in READERS for suffix in reader.suffixes} == set(SUFFIXES)


def load_file(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    """What a file holds, and its full name. UsageError where no reader knows the file, or the reader refuses it."""
    suffix = suffix_of(spec)
    reader = next((reader for reader in READERS if suffix in reader.suffixes), None)
    if reader is None:
        kinds = "; ".join(f"{reader.name} ({', '.join(reader.suffixes)}), as {reader.example}" for reader in READERS)
        what = f"files that end in {suffix!r}" if suffix else "a file without an ending"
        raise UsageError(f"{one_line(spec)!r}: there is no reader for {what}; a BRDF of your own is read from {kinds}")
    if not (reader.asks or reading.is_plain):
        raise UsageError(f"{OPTIONS} are for shader files; {one_line(spec)} is {reader.name}")
    return reader.load(spec, reading, modules)
