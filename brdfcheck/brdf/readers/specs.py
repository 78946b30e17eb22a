"""How a BRDF in a file is named: ``path/to/FILE`` or ``path/to/FILE:OBJECT``; or one of another program, ``PROGRAM:NAME``."""

from __future__ import annotations

import os
import re

TABLES = (".binary", ".bsdf")
"""Endings of measured files, which have no parameters."""
SUFFIXES = (".py", ".brdf", ".glsl", ".frag", ".glslf", ".fs", ".hlsl", ".slang", ".mtlx", *TABLES)
"""Endings of files for which there is a reader."""
PREFIXES = ("materialx:", "mitsuba:")
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


def suffix_of(spec: str) -> str:
    """The ending of the file, in lower case; the beginning of a name of another program."""
    prefix = next((prefix for prefix in PREFIXES if spec.startswith(prefix)), None)
    return prefix or os.path.splitext(split_spec(spec)[0])[1].lower()


def is_file_spec(name: str) -> bool:
    """True for what looks like ``file.py:object`` or a path rather than a catalogue name."""
    return ":" in name or "/" in name or os.sep in name or bool(_ENDING.search(name))
