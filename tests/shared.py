"""What the tests of several files do in the same way."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Run = Callable[..., tuple[int, str, str]]
"""The fixture `run`: (exit code, stdout, stderr) of a command."""


def strict_json(text: str) -> Any:
    """What JSON says; ValueError for NaN and Infinity, which it does not have."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not strict JSON")

    return json.loads(text, parse_constant=refuse)


def contents(folder: Path, *, seconds: bool = True) -> dict[str, bytes | None]:
    """All files with their contents, and all empty folders; a sweep's measurements only where they are asked for."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file() or not os.listdir(path)]
    found = {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in paths}
    return {name: data for name, data in found.items() if seconds or not name.startswith("seconds/c")}


def direction(cosine: Any, azimuth: Any = 0.0) -> np.ndarray:
    """Unit vectors (..., 3) at these cosines and azimuths, in double precision."""
    cosine, azimuth = np.broadcast_arrays(np.asarray(cosine, float), np.asarray(azimuth, float))
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


def compiled(command: Sequence[str], source: str, file: Path, points: np.ndarray) -> np.ndarray:
    """What a program in `file` prints, which reads pairs of numbers. `command`: the compiler with its options."""
    file.write_text(source)
    program = file.with_suffix("")
    built = subprocess.run(
        [*command, str(file), "-o", str(program), "-lm"], capture_output=True, text=True, timeout=60, check=False
    )
    assert built.returncode == 0, built.stderr
    given = "".join(f"{p:.17g} {mu:.17g}\n" for p, mu in points)
    ran = subprocess.run([str(program)], input=given, capture_output=True, text=True, timeout=60, check=True)
    return np.array([[float(word) for word in line.split()] for line in ran.stdout.splitlines()])
