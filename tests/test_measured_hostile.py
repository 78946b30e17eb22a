"""Measured files that are not what they say, or that something has damaged: one line, no traceback, little time and memory."""

from __future__ import annotations

import os
import random
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from measured import MERL, lambert, merl_bytes, rgl_arrays, tensor_file, write
from shared import Run

from brdfcheck import load
from brdfcheck.cli import ExitCode
from brdfcheck.messages import UsageError

ARRAYS = rgl_arrays(0.5, np.radians([0.0, 40, 80]), size=4, finer=8)
HEADER = np.array(MERL, "<i4").tobytes()
WHOLE = 12 + 3 * 8 * 90 * 90 * 180


def changed(**arrays: np.ndarray | None) -> bytes:
    """A good RGL file with other arrays (None: without)."""
    return tensor_file({name: array for name, array in {**ARRAYS, **arrays}.items() if array is not None})


def described(offset: int = 100, shape: tuple[int, ...] = (4,), kind: int = 10, name: bytes = b"ndf", count: int = 1) -> bytes:
    """A tensor file with one description."""
    head = b"tensor_file\0" + struct.pack("<BBI", 1, 0, count)
    head += struct.pack(f"<H{len(name)}sHBQ{len(shape)}Q", len(name), name, len(shape), kind, offset, *shape)
    return head.ljust(200, b"\0")


def with_value(name: str, value: float) -> np.ndarray:
    array = ARRAYS[name].copy()
    array.flat[array.size // 2] = value
    return array


GOOD = changed()
REFUSED: dict[str, tuple[str, bytes, str]] = {
    "empty": ("x.binary", b"", "is empty"),
    "short": ("x.binary", b"abc", "3 bytes, shorter than the header"),
    "dimensions": ("x.binary", np.array([90, 90, 181], "<i4").tobytes(), "dimensions 90 x 90 x 181; a MERL"),
    "huge dimensions": ("x.binary", b"\xff\xff\xff\x7f" * 3 + b"\0" * 50, "dimensions 2147483647"),
    "truncated": ("x.binary", HEADER + b"\0" * 800, f"is truncated: 812 bytes; a MERL file has {WHOLE}"),
    "no tensor file": ("x.bsdf", b"PNG" + GOOD, "does not begin with 'tensor_file'"),
    "another version": ("x.bsdf", GOOD[:12] + b"\2" + GOOD[13:], "version 2.0; version 1.0 is read"),
    "header cut": ("x.bsdf", GOOD[:15], "ends within the header"),
    "description cut": ("x.bsdf", GOOD[:30], "ends within the description of array 1 of"),
    "data cut": ("x.bsdf", GOOD[:-40], "it is truncated"),
    "many arrays": ("x.bsdf", described(count=2**32 - 1), "kinds 1 to|ends within|there twice|has no array"),
    "long name": ("x.bsdf", described(name=b"n" * 65), "has a name of 65 bytes; at most 64 are read"),
    "vast": ("x.bsdf", described(shape=(2**63, 2**62)), r"the array 'ndf' \(9223372036854775808 x .* is truncated"),
    "vast and empty": ("x.bsdf", described(shape=(2**63, 0)), "has no array 'phi_i'; it holds 'ndf'"),
    "far": ("x.bsdf", described(offset=2**64 - 1), "is truncated"),
    "kind": ("x.bsdf", described(kind=77), "numbers of kind 77; kinds 1 to 11"),
    "dimensions of an array": ("x.bsdf", described(shape=(1,) * 12), "has 12 dimensions"),
    "control characters": ("x.bsdf", described(name=b"a\n\x1b[2Jb", kind=99), "the array 'a "),
    "no vndf": ("x.bsdf", changed(vndf=None), "has no array 'vndf'; it holds 'description'"),
    "no values": ("x.bsdf", changed(rgb=None), "has no array 'spectra'"),
    "flat values": ("x.bsdf", changed(rgb=ARRAYS["rgb"][0]), "'rgb' has the shape 3 x 3 x 4 x 4; expected 5 dimensions"),
    "two channels": ("x.bsdf", changed(rgb=ARRAYS["rgb"][:, :, :2]), "expected three channels"),
    "other lights": ("x.bsdf", changed(vndf=ARRAYS["vndf"][:, :2]), "'vndf' has the shape 1 x 2 x 8 x 8; expected 1 x 3"),
    "one row": ("x.bsdf", changed(ndf=ARRAYS["ndf"][:1]), "'ndf' has the shape 1 x 8; expected rows x columns, 2 or more"),
    "falling": ("x.bsdf", changed(theta_i=ARRAYS["theta_i"][::-1].copy()), "'theta_i' must rise"),
    "degrees": ("x.bsdf", changed(theta_i=np.degrees(ARRAYS["theta_i"])), "within 1.571 radians of 0; got 0, 40, 80"),
    "NaN": ("x.bsdf", changed(rgb=with_value("rgb", np.nan)), r"1 of 144 values of 'rgb' are NaN or infinite; the first is"),
    "infinite": ("x.bsdf", changed(vndf=with_value("vndf", np.inf)), "1 of 192 values of 'vndf' are NaN or infinite"),
    "negative facets": ("x.bsdf", changed(ndf=with_value("ndf", -2)), r"'ndf' must not be negative; got -2 at \[4, 0\]"),
    "no facets": ("x.bsdf", changed(vndf=0 * ARRAYS["vndf"]), r"'vndf' of light \[0, 0\] is 0 everywhere"),
    "nothing known": ("x.bsdf", changed(rgb=0 * ARRAYS["rgb"] - 1), "holds no data: all of 'rgb' is negative"),
    "wavelengths": (
        "x.bsdf",
        changed(rgb=None, spectra=ARRAYS["rgb"], wavelengths=np.ones(4, np.float32)),
        "'wavelengths' has the shape 4; expected as many as the 3 of the spectra",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "content", "words"), REFUSED.values(), ids=REFUSED)
def test_it_is_refused_in_one_line(name: str, content: bytes, words: str, here: Path) -> None:
    write(here, name, content)
    with pytest.raises(UsageError, match=words) as caught:
        load(name)
    message = str(caught.value)
    assert message.startswith(f"{name}: ")
    assert message.isprintable()
    assert len(message) < 400


def test_the_good_file_is_read() -> None:
    """Else the refusals above would prove nothing."""
    assert tensor_file(ARRAYS) == GOOD


def test_the_command_line_says_it_in_one_line(here: Path, run: Run) -> None:
    write(here, "good.bsdf", GOOD)
    assert load("good.bsdf").build() is not None
    write(here, "bad.binary", b"abc")
    (here / "folder.bsdf").mkdir()
    os.mkfifo(here / "pipe.binary")
    for name, words in (
        ("bad.binary", "is not a MERL file"),
        ("nowhere.bsdf", "there is no file"),
        ("folder.bsdf", "is a folder"),
        ("pipe.binary", "is no ordinary file"),
        ("good.bsdf:red", "holds one BRDF"),
    ):
        for command in (["check"], ["plot", "albedo-vs-angle"], ["fit"]):
            code, out, err = run(*command, name)
            assert code == ExitCode.USAGE_ERROR
            assert not out
            assert err.count("\n") == 1, err
            assert words in err, err
    assert not list(here.glob("*.svg"))
    code, _, err = run("check", "good.bsdf", "-D", "A=1")
    assert code == ExitCode.USAGE_ERROR
    assert "are for shader files" in err


def test_values_that_are_no_numbers_are_counted(here: Path) -> None:
    content = bytearray(merl_bytes(lambert(0.5)))
    for place in (12 + 8 * 90 * 90 * 180 + 8 * 181, WHOLE - 8):  # green [0, 1, 1], and the last one
        content[place : place + 8] = struct.pack("<d", float("nan"))
    write(here, "x.binary", bytes(content))
    with pytest.raises(UsageError, match=r"2 of 4374000 values are NaN or infinite; the first is G \[0, 1, 1\]"):
        load("x.binary")
    with open(here / "x.binary", "ab") as file:
        file.write(b"more")
    with pytest.raises(UsageError, match="is too long"):
        load("x.binary")
    write(here, "none.binary", HEADER + np.full((WHOLE - 12) // 8, -1.0).tobytes())
    with pytest.raises(UsageError, match="holds no data"):
        load("none.binary")


def mutated(seed: int) -> bytes:
    """A good RGL file with some bytes changed, cut, doubled or moved; mostly where the descriptions are."""
    rng = random.Random(seed)
    data = bytearray(GOOD)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        place = rng.randrange(len(data) if rng.random() < 0.3 else min(len(data), 500))
        kind = rng.randrange(5)
        if kind == 0:
            data[place] = rng.randrange(256)
        elif kind == 1:
            data[place : place + 8] = rng.choice((b"\xff" * 8, b"\0" * 8, b"\0" * 7 + b"\x80", struct.pack("<d", np.nan)))
        elif kind == 2:
            del data[place : place + rng.choice((1, 4, 8, 1000))]
        elif kind == 3:
            data[place:place] = data[place : place + rng.choice((1, 8, 40))]
        else:
            data[place] ^= 1 << rng.randrange(8)
        data = data or bytearray(1)
    return bytes(data)


def mutated_merl(seed: int) -> bytes:
    """The beginning of a MERL file, with some of it changed."""
    rng = random.Random(seed)
    data = bytearray(HEADER + bytes(rng.randrange(256) for _ in range(rng.randrange(60))))
    for _ in range(rng.randrange(4)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data[: rng.randrange(len(data) + 1)])


def answer(name: str) -> str | None:
    """What is said of a file that is refused."""
    try:
        load(name)
    except UsageError as error:
        return str(error)
    return None


def fuzzed(seeds: range, here: Path) -> int:
    """How many of the mutated files are read all the same; anything but a `UsageError` of one line ends the test."""
    read, wi = 0, np.array([[0.6, 0, 0.8], [0, 0, 1.0]])
    for seed in seeds:
        for name, content in (("x.bsdf", mutated(seed)), ("x.binary", mutated_merl(seed))):
            write(here, name, content)
            began = time.perf_counter()
            said = answer(name)
            assert time.perf_counter() - began < 5, (seed, name)
            if said is None:
                read += 1
                if seed % 40 == 0:
                    assert np.asarray(load(name).build()(wi, wi[::-1])).shape[0] == 2
            else:
                assert said.startswith(f"{name}: "), (seed, name)
                assert said.isprintable(), (seed, name)
                assert len(said) < 600, (seed, name)
    return read


def test_damaged_files_are_answered(here: Path) -> None:
    assert 20 < fuzzed(range(400), here) < 400


@pytest.mark.slow
def test_many_damaged_files_are_answered(here: Path) -> None:
    assert fuzzed(range(400, 10_400), here) > 400


@pytest.mark.slow
def test_damaged_tables_of_full_size_are_answered(here: Path) -> None:
    good = bytearray(merl_bytes(lambert(0.5)))
    for seed in range(60):
        rng = random.Random(seed)
        data = bytearray(good)
        for _ in range(rng.choice((1, 100))):
            data[rng.randrange(12, len(data))] = rng.randrange(256)
        write(here, "x.binary", bytes(data))
        said = answer("x.binary")
        assert said is None or said.isprintable()
