"""The kinds of files that BRDFs are read from: one row for each reader."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from brdfcheck.brdf.readers.base import OPTIONS, Reading
from brdfcheck.brdf.readers.specs import PREFIXES, SUFFIXES, split_spec, suffix_of
from brdfcheck.messages import UsageError, one_line

Modules = dict[str, ModuleType]


@dataclass(frozen=True)
class Reader:
    """A kind of file, told by the ending of its name or by what that begins with.

    `load` takes the full spec, how to read it, and the Python modules loaded so far; it returns what the file holds, something
    callable or an `AbstractFile`, and its full name. `example`: how it is named; `needs`: the package it needs and the extra of
    this package that installs it, None for the plain installation; `asks`: that the options of shader files are for it;
    `functions`: that it reads functions, which return what ``--returns`` says; `prefix`: how names begin that are for it and
    are not those of a file.
    """

    name: str
    suffixes: tuple[str, ...]
    example: str
    needs: tuple[str, str] | None
    load: Callable[[str, Reading, Modules], tuple[Any, str]]
    asks: bool = True
    functions: bool = True
    prefix: str = ""


def _python(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.python import load_object

    del reading
    return load_object(spec, modules)


def _shader(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.glsl.shader import ShaderFile

    del modules
    file = ShaderFile(*split_spec(spec), reading)
    return file, file.spec


def _materialx(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.materialx import MaterialXFile

    del reading, modules
    file = MaterialXFile(spec)
    return file, file.spec


def _mitsuba(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    from brdfcheck.brdf.readers.mitsuba.reader import PlugInFile

    del reading, modules
    file = PlugInFile(spec.partition(":")[2])
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


READERS = (
    Reader("Python", (".py",), "mine.py:brdf", None, _python, asks=False),
    Reader("BRDF Explorer", (".brdf",), "mine.brdf", None, _shader),
    Reader("GLSL", (".glsl", ".frag", ".glslf", ".fs"), "mine.glsl:FUNCTION", None, _shader),
    Reader("HLSL", (".hlsl",), "mine.hlsl:FUNCTION", None, _shader),
    Reader("Slang", (".slang",), "mine.slang:FUNCTION", None, _shader),
    Reader(
        "MaterialX",
        (".mtlx",),
        "mine.mtlx[:NODE] or materialx:NODE",
        ("MaterialX", "materialx"),
        _materialx,
        asks=False,
        functions=False,
        prefix="materialx:",
    ),
    Reader("Mitsuba", (), "mitsuba:PLUGIN", ("mitsuba", "mitsuba"), _mitsuba, asks=False, functions=False, prefix="mitsuba:"),
    Reader("MERL", (".binary",), "measured.binary", None, _merl, asks=False, functions=False),
    Reader("RGL", (".bsdf",), "measured.bsdf", None, _rgl, asks=False, functions=False),
)
assert {suffix for reader in READERS for suffix in reader.suffixes} == set(SUFFIXES)
assert {reader.prefix for reader in READERS} - {""} == set(PREFIXES)


def load_file(spec: str, reading: Reading, modules: Modules) -> tuple[Any, str]:
    """What a file holds, and its full name. UsageError where no reader knows the file, or the reader refuses it."""
    suffix = suffix_of(spec)
    known = (reader for reader in READERS if suffix in reader.suffixes or (reader.prefix and spec.startswith(reader.prefix)))
    reader = next(known, None)
    if reader is None:
        kinds = "; ".join(
            f"{reader.name} ({', '.join(reader.suffixes) or reader.prefix}), as {reader.example}" for reader in READERS
        )
        what = f"files that end in {suffix!r}" if suffix else "a file without an ending"
        # As modules are named in Python: mine:glossy, or mine.glossy.
        path, name = split_spec(spec) if ":" in spec else spec.rpartition(".")[::2]
        if name and os.path.isfile(f"{path}.py") and not os.path.exists(spec):
            raise UsageError(f"{one_line(spec)!r}: there is no reader for {what}; did you mean {path}.py:{name}?")
        raise UsageError(f"{one_line(spec)!r}: there is no reader for {what}; a BRDF of your own is read from {kinds}")
    if reading.for_shaders and not reader.asks:
        raise UsageError(f"{OPTIONS} are for shader files; {one_line(spec)} is {reader.name}")
    if reading.per_cosine and not reader.functions:
        raise UsageError(f"--returns is for functions; {one_line(spec)} is {reader.name}")
    if reader.needs is not None and find_spec(reader.needs[0]) is None:
        package, extra = reader.needs
        raise UsageError(f"{one_line(spec)}: {reader.name} needs the package {package}: pip install 'brdfcheck[{extra}]'")
    return reader.load(spec, reading, modules)
