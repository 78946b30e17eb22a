"""What the tests of several files do in the same way."""

from __future__ import annotations

import contextlib
import copy
import functools
import json
import operator
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import png
import pytest

from brdfcheck import cli
from brdfcheck.cli import ExitCode

ROOT = Path(__file__).parent.parent


class Run:
    """The fixture `run`: commands in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]):
        self._capsys = capsys

    def __call__(self, *words: str) -> tuple[int, str, str]:
        """(exit code, stdout, stderr)."""
        return cli.run(words), *self._capsys.readouterr()

    def passed(self, *words: str) -> str:
        """What a command prints that ends with 0."""
        return self._ended(ExitCode.PASSED, words)

    def silent(self, *words: str) -> str:
        """The same of one that says nothing on stderr."""
        code, out, err = self(*words)
        assert (code, err) == (ExitCode.PASSED, ""), out
        return out

    def failed(self, *words: str) -> str:
        """What a command prints that ends with 1."""
        return self._ended(ExitCode.FAILED, words)

    def refused(self, *words: str) -> str:
        """The line of a command that cannot do what it is asked: it ends with 4 and prints nothing else."""
        code, out, err = self(*words)
        assert (code, out) == (ExitCode.USAGE_ERROR, ""), out + err
        (line,) = err.splitlines()
        assert line.startswith("brdfcheck: ")
        return line

    def _ended(self, expected: ExitCode, words: tuple[str, ...]) -> str:
        code, out, err = self(*words)
        assert code == expected, out + err
        return out


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


def fresnel(cosine: np.ndarray, ratio: float) -> np.ndarray:
    """The unpolarised reflectance as the mean of the two polarisations; `ratio`: far index over near index."""
    sine = np.sqrt(1 - cosine**2) / ratio
    inner = np.sqrt(np.maximum(1 - sine**2, 1e-30))
    across = ((cosine - ratio * inner) / (cosine + ratio * inner)) ** 2
    along = ((ratio * cosine - inner) / (ratio * cosine + inner)) ** 2
    return np.where(sine < 1, (across + along) / 2, 1.0)


def equations(program: Any) -> Iterator[Any]:
    """All equations of a traced program and of those inside it."""
    for equation in program.eqns:
        yield equation
        for part in jax.tree.leaves(tuple(equation.params.values()), is_leaf=lambda part: hasattr(part, "eqns")):
            if hasattr(part, "eqns"):
                yield from equations(part)


def replaced(record: Any, path: Sequence[Any], value: Any) -> Any:
    """A copy of a record, with another value at one place."""
    other = copy.deepcopy(record)
    functools.reduce(operator.getitem, path[:-1], other)[path[-1]] = value
    return other


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


def process(*arguments: object, environment: Mapping[str, str] | None = None, **options: Any) -> Any:
    """Python with these arguments, which finds the package; what it prints is text to be read, unless it is said otherwise."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options}
    variables = {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})}
    return subprocess.Popen([sys.executable, *map(str, arguments)], env=variables, **options)


def python(*arguments: object, **options: Any) -> tuple[int, str, str]:
    """The same once it has ended: (exit code, stdout, stderr)."""
    with process(*arguments, **options) as running:
        out, err = running.communicate(timeout=200)
    return running.returncode, out, err


def shown_by(terminal: int) -> bytes:
    """All that a pseudo-terminal is told, until nobody has its other end any more."""
    shown = b""
    with contextlib.suppress(OSError):  # how Linux says that the other end has closed
        while part := os.read(terminal, 65536):
            shown += part
    os.close(terminal)
    return shown


def wait_for(file: Path) -> str:
    """The text of a file, once it is there."""
    deadline = time.monotonic() + 60
    while not (file.exists() and file.read_text()):
        assert time.monotonic() < deadline, file
        time.sleep(0.01)
    return file.read_text()


def picture(path: Path) -> np.ndarray:
    """The codes of a PNG, (height, width, 3), as another reader has them: of 8 or 16 bits."""
    width, height, rows, info = png.Reader(bytes=path.read_bytes()).read()
    codes = np.array([list(row) for row in rows]).reshape(height, width, info["planes"])
    return codes.astype({8: np.uint8, 16: np.uint16}[info["bitdepth"]])
