"""What a file holds, by the reader for its kind."""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from brdfcheck.brdf.readers.base import OPTIONS, Reading
from brdfcheck.brdf.readers.specs import PREFIXES, READERS, split_spec
from brdfcheck.messages import UsageError, one_line


def load_file(spec: str, reading: Reading, modules: dict[str, ModuleType]) -> tuple[Any, str]:
    """What a file holds, and its full name. UsageError where no reader knows the file, or the reader refuses it."""
    prefix = next((prefix for prefix in PREFIXES if spec.startswith(prefix)), None)
    suffix = prefix or os.path.splitext(split_spec(spec)[0])[1].lower()
    reader = next((reader for reader in READERS if suffix and suffix in (*reader.suffixes, reader.prefix)), None)
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
    if reader.needs is not None and find_spec(reader.needs) is None:
        install = f"pip install 'brdfcheck[{reader.needs.lower()}]'"
        raise UsageError(f"{one_line(spec)}: {reader.name} needs the package {reader.needs}: {install}")
    module, _, function = reader.reads.partition(":")
    read = getattr(import_module(f"{__package__}.{module}"), function)
    if suffix == ".py":
        return read(spec, modules)
    file = read(*split_spec(spec), reading) if reader.asks else read(spec)
    return file, file.spec
