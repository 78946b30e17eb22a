"""Sweeps on a Dask cluster of real processes on this machine: workers come, fit, and die."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from brdfcheck import cli
from brdfcheck.messages import UsageError
from brdfcheck.sweep import cluster

pytest.importorskip("distributed")

ROOT = Path(__file__).parent.parent
SWEEP = """
brdf = "phong"
rule = "zonal"
[axes]
n = { geomspace = [1, 1000, 60] }
cos_theta = { linspace = [0.05, 1, 160] }
[chunks]
cos_theta = 1
"""
USER = """
import helper

def lambertian(wi, wo, rho):
    return helper.scale(rho) + 0 * wo[..., 2]
"""


def start(*arguments: str, path: Path = ROOT) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(path), "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    return subprocess.Popen(
        command, env=environment, cwd=path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )  # fmt: skip


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory) -> Iterator[str]:
    """The address of a scheduler on loopback."""
    file = tmp_path_factory.mktemp("dask") / "scheduler.json"
    running = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    try:
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(0.2)

        yield json.loads(file.read_text())["address"]
    finally:
        running.kill()
        running.wait()


@pytest.fixture
def workers(scheduler) -> Iterator[Callable[..., list[subprocess.Popen[bytes]]]]:
    """Starts workers, which end with the test."""
    started: list[subprocess.Popen[bytes]] = []

    def more(count: int, path: Path = ROOT) -> list[subprocess.Popen[bytes]]:
        new = [start("worker", scheduler, "--nthreads", "1", "--no-nanny", path=path) for _ in range(count)]
        started.extend(new)
        return new

    yield more
    for worker in started:
        worker.terminate()
    for worker in started:
        with contextlib.suppress(subprocess.TimeoutExpired):
            worker.wait(10)
        worker.kill()
        worker.wait()


def sweep(*arguments: object) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-m", "brdfcheck", "sweep", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def contents(folder: Path) -> dict[str, bytes]:
    files = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: data for name, data in files.items() if not name.startswith("seconds/c")}


def test_a_killed_worker_loses_nothing(scheduler, workers, tmp_path):
    config, out, alone = tmp_path / "c.toml", tmp_path / "s", tmp_path / "alone"
    config.write_text(SWEEP)
    first, _ = workers(2)
    running = sweep(config, "--out", out, "--scheduler", scheduler)
    while running.poll() is None and len(list(out.glob("checksum/c/0/*/0"))) < 25:
        time.sleep(0.005)
    assert running.poll() is None, running.communicate()
    first.send_signal(signal.SIGKILL)
    assert len(list(out.glob("checksum/c/0/*/0"))) < 160
    stdout, stderr = running.communicate(timeout=200)
    assert running.returncode == 0, stderr
    assert "160 of 160 chunks computed" in stdout
    running = sweep(config, "--out", alone)
    assert running.communicate(timeout=200)
    assert running.returncode == 0
    assert contents(out) == contents(alone)


def test_users_files_travel_to_the_workers(scheduler, workers, tmp_path):
    (tmp_path / "helper.py").write_text("import math\ndef scale(rho):\n    return rho / math.pi\n")
    (tmp_path / "mine.py").write_text(USER)
    config = tmp_path / "c.toml"
    config.write_text('brdf = "mine.py:lambertian"\n[axes]\nrho = [0.25, 0.5, 1.0]\ncos_theta = 0.5\n[chunks]\nrho = 1\n')
    workers(1)
    for arguments in (("--out", tmp_path / "s", "--scheduler", scheduler), ("--out", tmp_path / "alone")):
        running = sweep(config, *arguments)
        _, stderr = running.communicate(timeout=200)
        assert running.returncode == 0, stderr
    assert contents(tmp_path / "s") == contents(tmp_path / "alone")


@pytest.mark.parametrize("kind", ["another version", "none"])
def test_workers_with_other_software_are_refused(kind, scheduler, workers, tmp_path):
    other = tmp_path / "other" / "brdfcheck"
    if kind == "none":
        other.mkdir(parents=True)
        (other / "__init__.py").write_text("")
    else:
        shutil.copytree(ROOT / "brdfcheck", other, ignore=shutil.ignore_patterns("__pycache__"))
        text = (other / "__init__.py").read_text()
        (other / "__init__.py").write_text(text.replace('__version__ = "', '__version__ = "9.'))
    (tmp_path / "c.toml").write_text(SWEEP)
    workers(1, other.parent)
    running = sweep(tmp_path / "c.toml", "--out", tmp_path / "s", "--scheduler", scheduler)
    _, stderr = running.communicate(timeout=100)
    assert running.returncode == cli.ExitCode.USAGE_ERROR, stderr
    expected = "has no such brdfcheck" if kind == "none" else "does not fit: brdfcheck: the worker has 9."
    assert expected in stderr.splitlines()[-1]
    assert stderr.splitlines()[-1].startswith("brdfcheck: --scheduler: ")
    assert not (tmp_path / "s").exists()


def test_a_scheduler_without_workers(scheduler, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cluster, "_FIRST_WORKER", 1.0)
    (tmp_path / "c.toml").write_text(SWEEP)
    code = cli.run(["sweep", str(tmp_path / "c.toml"), "--out", str(tmp_path / "s"), "--scheduler", scheduler])
    assert code == cli.ExitCode.USAGE_ERROR
    assert f"{scheduler} has no workers; start some with: dask worker {scheduler}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("tcp://127.0.0.1:9", "no scheduler answers at tcp://127.0.0.1:9; start one with: dask scheduler"),
        ("nonsense", "'nonsense' is no address"),
        ("host:port", "'host:port' is no address"),
        ("", "the address is empty"),
    ],
)
def test_addresses_where_no_scheduler_is(address, message, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cluster, "_ANSWER", 1.0)
    (tmp_path / "c.toml").write_text(SWEEP)
    code = cli.run(["sweep", str(tmp_path / "c.toml"), "--out", str(tmp_path / "s"), "--scheduler", address])
    assert code == cli.ExitCode.USAGE_ERROR
    assert f"--scheduler: {message}" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_without_dask_it_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    (tmp_path / "c.toml").write_text(SWEEP)
    code = cli.run(["sweep", str(tmp_path / "c.toml"), "--out", str(tmp_path / "s"), "--scheduler", "tcp://127.0.0.1:9"])
    assert code == cli.ExitCode.USAGE_ERROR
    assert "pip install 'brdfcheck[cluster]'" in capsys.readouterr().err


def test_no_logger_of_dask_has_a_level_of_its_own(scheduler, tmp_path, monkeypatch):
    """Some have from the start, and a configuration may give one to any."""
    loggers = [
        logging.getLogger(name) for name in ("distributed", "distributed.client", "distributed.comm", "tornado.application")
    ]
    levels = [logger.level for logger in loggers]
    try:
        loggers[2].setLevel(logging.DEBUG)
        monkeypatch.setattr(cluster, "_FIRST_WORKER", 0.1)
        with pytest.raises(UsageError, match="has no workers"):
            cluster.Cluster(scheduler)
        assert [logger.getEffectiveLevel() for logger in loggers] == [logging.CRITICAL] * 4
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def test_a_lost_cluster_keeps_what_was_computed(workers, tmp_path, scheduler):
    config, out = tmp_path / "c.toml", tmp_path / "s"
    config.write_text(SWEEP)
    own = tmp_path / "scheduler.json"
    boss = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(own))
    try:
        while not own.exists() or not own.read_text():
            time.sleep(0.1)
        worker = start("worker", "--scheduler-file", str(own), "--nthreads", "1", "--no-nanny")
        try:
            running = sweep(config, "--out", out, "--scheduler", json.loads(own.read_text())["address"])
            while running.poll() is None and len(list(out.glob("checksum/c/0/*/0"))) < 5:
                time.sleep(0.005)
            boss.kill()
            _, stderr = running.communicate(timeout=100)
            assert running.returncode == cli.ExitCode.INTERNAL_ERROR, stderr
            *others, last = stderr.splitlines()
            assert last.startswith("brdfcheck: lost the scheduler at ")
            assert last.endswith("run again to continue")
            assert not [line for line in others if " of 160 chunks, " not in line]
        finally:
            worker.kill()
            worker.wait()
    finally:
        boss.kill()
        boss.wait()
    workers(1)
    running = sweep(config, "--out", out, "--scheduler", scheduler)
    stdout, stderr = running.communicate(timeout=200)
    assert running.returncode == 0, stderr
    assert "were there" in stdout
