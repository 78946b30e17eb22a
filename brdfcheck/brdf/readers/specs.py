"""The kinds of files that BRDFs are read from, one row for each reader, and how a BRDF in a file is named."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Reader:
    """A kind of file, told by the ending of its name or by what that begins with.

    `example`: how it is named; `needs`: the package it needs, None for the plain installation; its name in lower case is the
    extra of this package that installs it. `reads`: what reads it, in this folder: it takes the full spec, of a shader its
    parts and how to read it, of a Python file also the modules loaded so far; it makes an `AbstractFile`, of a Python file
    something callable and its full name. `asks`: that the options of shader files are for it; `functions`: that it reads
    functions, which return what ``--returns`` says; `prefix`: how names begin that are for it and are not those of a file.
    """

    name: str
    suffixes: tuple[str, ...]
    example: str
    needs: str | None
    reads: str
    asks: bool = False
    functions: bool = True
    prefix: str = ""


_SHADER = "glsl.shader:ShaderFile"
READERS = (
    Reader("Python", (".py",), "mine.py:brdf", None, "python:load_object"),
    Reader("BRDF Explorer", (".brdf",), "mine.brdf", None, _SHADER, asks=True),
    Reader("GLSL", (".glsl", ".frag", ".glslf", ".fs"), "mine.glsl:FUNCTION", None, _SHADER, asks=True),
    Reader("HLSL", (".hlsl",), "mine.hlsl:FUNCTION", None, _SHADER, asks=True),
    Reader("Slang", (".slang",), "mine.slang:FUNCTION", None, _SHADER, asks=True),
    Reader(
        "MaterialX",
        (".mtlx",),
        "mine.mtlx[:NODE] or materialx:NODE",
        "MaterialX",
        "materialx:MaterialXFile",
        functions=False,
        prefix="materialx:",
    ),
    Reader("Mitsuba", (), "mitsuba:PLUGIN", "mitsuba", "mitsuba.reader:PlugInFile", functions=False, prefix="mitsuba:"),
    Reader("MERL", (".binary",), "measured.binary", None, "tables.merl:MerlFile", functions=False),
    Reader("RGL", (".bsdf",), "measured.bsdf", None, "tables.rgl:RglFile", functions=False),
)
SUFFIXES = tuple(suffix for reader in READERS for suffix in reader.suffixes)
"""Endings of files for which there is a reader."""
PREFIXES = tuple(reader.prefix for reader in READERS if reader.prefix)
"""Beginnings of names that stand for what another program knows, and for no file."""
# What ends like the name of a file; no name of the catalogue does.
_ENDING = re.compile(r"\.[A-Za-z]\w{0,9}$")


def split_spec(spec: str) -> tuple[str, str | None]:
    """``path/to/file.py:object`` -> (path, object); the object is None where only a file is given."""
    if spec.startswith(PREFIXES):
        return spec, None
    path, colon, name = spec.rpartition(":")
    if not colon or name.lower().endswith(SUFFIXES) or "/" in name:
        return spec, None
    return path, name


def is_file_spec(name: str) -> bool:
    """True for what looks like ``file.py:object`` or a path rather than a catalogue name."""
    return ":" in name or "/" in name or os.sep in name or bool(_ENDING.search(name))
