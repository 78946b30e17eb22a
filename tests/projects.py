"""A small project, for the tests of what concerns projects."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import pytest

import brdfcheck
from brdfcheck.gate import cache

Write = Callable[..., Path]

SWEEP = """
brdf = "phong"
[axes]
n = { geomspace = [1, 1000, 60] }
cos_theta = { linspace = [0.05, 1, 240] }
[chunks]
cos_theta = 1
"""
"""A sweep of 240 chunks."""
SCENE = """
size = 48
[matters]
pixel = "1/255"
[material]
kind = "surface"
terms = [{ brdf = "lambert", tint = [0.6, 0.3, 0.1] }, { brdf = "blinn-phong", tint = 0.1, n = 30 }]
[[lights]]
kind = "distant"
direction = [1, 1, 2]
"""
"""A picture, and what matters in it for a budget."""
MINE = """
    from brdfcheck import Lambert
    from gray_of_mine import GRAY

    def matt(k):
        return Lambert(GRAY * k)

    def bright():
        return Lambert(1.05)

    _hidden = 3
    """
GATE = """
    effort = "quick"        # for all

    [[subjects]]
    target = "mine.py:matt"
    over = { k = { values = [0.25, 1] } }

    # why it is bright
    [[subjects]]
    target = "mine.py:bright"
    [[subjects]]
    target = "lambert"
    """


@pytest.fixture
def write(here: Path) -> Write:
    """Writes a file into the test's folder."""

    def write(name: str, text: str) -> Path:
        path = here / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(textwrap.dedent(text))
        return path

    write("mine.py", MINE)
    write("gray_of_mine.py", "GRAY = 0.5\n")
    forget("gray_of_mine")
    return write


def forget(module: str) -> None:
    """As in a new process: the module is imported again."""
    sys.modules.pop(module, None)


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], list[Path]]]:
    """Verdicts are kept in a folder of their own; lists them. JAX is as users have it."""
    monkeypatch.setenv("BRDFCHECK_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv(cache.SWITCH)
    jax.config.update("jax_numpy_dtype_promotion", "standard")
    yield lambda: sorted((tmp_path / "cache" / "verdicts").glob("??/*.json"))
    jax.config.update("jax_numpy_dtype_promotion", "strict")


@pytest.fixture(scope="module")
def reports() -> dict[str, Any]:
    return {
        "bright": brdfcheck.check(brdfcheck.Lambert(1.05), effort="quick"),
        "matt": brdfcheck.check(brdfcheck.Lambert(0.5), effort="quick"),
        "one_way": brdfcheck.check("phong-classical", n=(5, 5), effort="quick"),
    }
