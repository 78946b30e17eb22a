"""What all tests share: double precision, strict types, a compilation cache of their own, few random examples."""

from __future__ import annotations

import atexit
import gc
import itertools
import os
import shutil
import signal
import sys
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Before anything of the package runs, and inherited by the processes that tests start.
if "BRDFCHECK_CACHE" not in os.environ:
    os.environ["BRDFCHECK_CACHE"] = tempfile.mkdtemp(prefix="brdfcheck-tests-")
    atexit.register(shutil.rmtree, os.environ["BRDFCHECK_CACHE"], ignore_errors=True)

# A verdict that is known already would hide what a test is about; `test_gate` switches the cache on.
os.environ["BRDFCHECK_VERDICTS"] = "0"

# Workers that share the cores get one each, before numpy and JAX start a thread for each core that they find: these would wait
# for each other.
if "PYTEST_XDIST_WORKER" in os.environ:
    from brdfcheck.cores import available_cores, bind_thread

    if int(os.environ["PYTEST_XDIST_WORKER_COUNT"]) >= len(available_cores()):
        bind_thread(available_cores()[int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw")) % len(available_cores())])

import jax
import pytest
from hypothesis import HealthCheck, settings
from shared import Run

from brdfcheck.runtime import use_compilation_cache, use_x64

use_x64()
use_compilation_cache()
jax.config.update("jax_numpy_dtype_promotion", "strict")

# Where a shell started the tests in the background, they and what they start would ignore Ctrl-C, which tests send.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile(
    "brdfcheck",
    max_examples=25,
    deadline=None,  # the first example compiles
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile("brdfcheck")


_TESTS = itertools.count(1)


def _maps() -> int:
    """How many memory maps this process has; 0 where the system does not say."""
    try:
        with open("/proc/self/maps", "rb") as file:
            return sum(1 for _ in file)
    except OSError:
        return 0


def pytest_collection_finish() -> None:
    """What is there by now stays: the collector of garbage need not go through it again and again."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A worker begins with whole files side by side, so that programs and fixtures of a file are made once; idle, it takes over
    tests of another one. Another `--dist` than the usual one is kept."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log) if config.getoption("dist") == "load" else None


@pytest.fixture(autouse=True)
def _no_annotations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests say for themselves whether they run as if on GitHub or with debugging."""
    for name in ("GITHUB_ACTIONS", "BRDFCHECK_DEBUG", "FORCE_COLOR", "NO_COLOR"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, the working directory of the test, in which a user's file may be imported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    return Run(capsys)


@pytest.fixture
def mine(here: Path, request: pytest.FixtureRequest) -> str:
    """The file mine.py with what the module of the test has as MINE."""
    path = here / "mine.py"
    path.write_text(textwrap.dedent(request.module.MINE))
    return str(path)


@pytest.fixture
def as_users_have_it() -> Iterator[None]:
    """Users mix types: what the tests forbid is allowed here."""
    with jax.numpy_dtype_promotion("standard"):
        yield


@pytest.fixture(autouse=True, scope="module")
def _programs_of_one_file() -> Iterator[None]:
    """What the next file needs again comes from the compilation cache."""
    yield
    jax.clear_caches()


@pytest.fixture(autouse=True)
def _memory_maps() -> Iterator[None]:
    """A compiled program holds tens of memory maps, and a process may have 65,530: beyond, nothing can be allocated."""
    yield
    if next(_TESTS) % 8 == 0 and _maps() > 20_000:
        jax.clear_caches()
        gc.collect()
