"""Sweeps on a Dask cluster: a scheduler here, workers here and in processes of their own, which come, fit, and die."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import projects
import pytest
from shared import ROOT, contents

from brdfcheck import cli
from brdfcheck.messages import SweepError, UsageError
from brdfcheck.sweep import Plan, cluster, fill, layout, parse, read_config

dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")

SWEEP = projects.SWEEP.replace("240", "160").replace("[axes]", 'rule = "zonal"\n[axes]')
USER = """
import helper

def lambertian(wi, wo, rho):
    return helper.scale(rho) + 0 * wo[..., 2]
"""
HERE = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "protocol": "tcp", "host": "127.0.0.1",
        "dashboard_address": ":0", "silence_logs": 50}  # fmt: skip


@pytest.fixture
def boss() -> Iterator[Any]:
    """A scheduler on loopback with one worker in this process, which soon gives up asking a dead one for its results."""
    with dask.config.set({"distributed.comm.timeouts.connect": "3s"}), distributed.LocalCluster(**HERE) as running:
        yield running


@pytest.fixture
def worker() -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Starts workers in processes of their own, which end with the test."""
    started: list[subprocess.Popen[bytes]] = []

    def more(address: str, path: Path = ROOT) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "PYTHONPATH": str(path), "JAX_PLATFORMS": "cpu"}
        command = [sys.executable, "-m", "dask", "worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        started.append(subprocess.Popen(command, env=environment, cwd=path, **quiet))
        return started[-1]

    yield more
    for running in started:
        running.kill()
        running.wait()


@pytest.fixture
def config(tmp_path) -> Path:
    (tmp_path / "c.toml").write_text(SWEEP)
    return tmp_path / "c.toml"


def workers_of(boss: Any, count: int) -> list[str]:
    """The addresses of its workers, once there are so many."""
    deadline = time.monotonic() + 60
    while len(boss.scheduler.workers) < count and time.monotonic() < deadline:
        time.sleep(0.1)
    return list(boss.scheduler.workers)


def test_a_killed_worker_loses_nothing(boss, worker, config, tmp_path):
    plan, killed = Plan(read_config(config)), []
    other = worker(boss.scheduler_address)
    assert len(workers_of(boss, 2)) == 2

    def kill(progress: Any) -> None:
        if progress.chunks >= 25 and not killed:
            killed.append(progress.chunks)
            other.kill()

    summary = fill(plan, tmp_path / "s", scheduler=boss.scheduler_address, progress=kill)
    assert summary.computed == 160
    assert killed[0] < 160
    fill(plan, tmp_path / "alone")
    assert contents(tmp_path / "s", seconds=False) == contents(tmp_path / "alone", seconds=False)


@pytest.mark.slow
def test_a_task_that_the_scheduler_forgets_is_given_out_again(boss, config, tmp_path, monkeypatch):
    plan, given = Plan(read_config(config)), []
    submit = distributed.Client.submit

    def cancelled(self: Any, *arguments: Any, **options: Any) -> Any:
        given.append(submit(self, *arguments, **options))
        if len(given) in (10, 11, 40):
            given[-1].cancel()
        return given[-1]

    monkeypatch.setattr(distributed.Client, "submit", cancelled)
    assert fill(plan, tmp_path / "s", scheduler=boss.scheduler_address).computed == 160
    assert len(given) == 163
    fill(plan, tmp_path / "alone")
    assert contents(tmp_path / "s", seconds=False) == contents(tmp_path / "alone", seconds=False)


def test_results_that_are_always_lost_end_the_sweep(boss, config, tmp_path, monkeypatch):
    submit = distributed.Client.submit

    def cancelled(self: Any, *arguments: Any, **options: Any) -> Any:
        future = submit(self, *arguments, **options)
        future.cancel()
        return future

    monkeypatch.setattr(distributed.Client, "submit", cancelled)
    with pytest.raises(SweepError, match=r"^results are lost again and again .* run again to continue$"):
        fill(Plan(read_config(config)), tmp_path / "s", scheduler=boss.scheduler_address)


def test_users_files_travel_to_the_workers(boss, tmp_path):
    """A worker has a folder of its own, with what it was sent."""
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "helper.py").write_text("import math\ndef scale(rho):\n    return rho / math.pi\n")
    (mine / "mine.py").write_text(USER)
    document = {"brdf": "mine.py:lambertian", "axes": {"rho": [0.25, 0.5, 1.0], "cos_theta": 0.5}, "chunks": {"rho": 1}}
    plan = Plan(parse(document, folder=mine))
    fill(plan, tmp_path / "alone")
    (mine / "helper.py").unlink()
    (mine / "mine.py").unlink()
    fill(plan, tmp_path / "s", scheduler=boss.scheduler_address)
    assert contents(tmp_path / "s", seconds=False) == contents(tmp_path / "alone", seconds=False)


def test_workers_with_other_software_are_refused(boss, config, tmp_path, monkeypatch, capsys):
    def elsewhere() -> dict[str, Any]:
        facts = layout.facts()
        return {**facts, "versions": {**facts["versions"], "brdfcheck": "9.9"}, "devices": 1}

    command = ["sweep", str(config), "--out", str(tmp_path / "s"), "--scheduler", boss.scheduler_address]
    with monkeypatch.context() as patched:
        patched.setattr(cluster, "facts_here", elsewhere)
        assert cli.run(command) == cli.ExitCode.USAGE_ERROR
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("brdfcheck: --scheduler: ")
    assert "does not fit: versions.brdfcheck: the worker has 9.9, here it is" in last
    assert not (tmp_path / "s").exists()
    # One that comes later compares for itself.
    ours = json.loads(json.dumps(layout.facts()))
    ours["device"]["kind"] = "abacus"
    with pytest.raises(UsageError, match=r"does not fit: device.kind: the worker has \S+, here it is abacus"):
        cluster.compute_here("", ours, [0])


def test_a_worker_without_this_package_is_refused(worker, config, tmp_path, capsys):
    other = tmp_path / "other" / "brdfcheck"
    other.mkdir(parents=True)
    (other / "__init__.py").write_text("")
    with distributed.LocalCluster(**{**HERE, "n_workers": 0}) as boss:
        worker(boss.scheduler_address, other.parent)
        assert len(workers_of(boss, 1)) == 1
        code = cli.run(["sweep", str(config), "--out", str(tmp_path / "s"), "--scheduler", boss.scheduler_address])
    assert code == cli.ExitCode.USAGE_ERROR
    assert "has no such brdfcheck" in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "s").exists()


def test_a_scheduler_without_workers_and_its_loggers(config, tmp_path, monkeypatch, capsys):
    """No logger of Dask keeps a level of its own: some have one from the start, and a configuration may give one to any."""
    names = ("distributed", "distributed.client", "distributed.comm", "tornado.application")
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    monkeypatch.setattr(cluster, "_FIRST_WORKER", 0.5)
    try:
        with distributed.LocalCluster(**{**HERE, "n_workers": 0}) as boss:
            loggers[2].setLevel(logging.DEBUG)
            address = boss.scheduler_address
            code = cli.run(["sweep", str(config), "--out", str(tmp_path / "s"), "--scheduler", address])
        assert code == cli.ExitCode.USAGE_ERROR
        assert f"{address} has no workers; start some with: dask worker {address}" in capsys.readouterr().err
        assert [logger.getEffectiveLevel() for logger in loggers] == [logging.CRITICAL] * 4
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("tcp://127.0.0.1:9", "no scheduler answers at tcp://127.0.0.1:9; start one with: dask scheduler"),
        ("nonsense", "'nonsense' is no address"),
        ("host:port", "'host:port' is no address"),
        ("", "the address is empty"),
        (None, "needs Dask: pip install 'brdfcheck[cluster]'"),
    ],
)
def test_addresses_where_no_scheduler_is(address, message, config, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cluster, "_ANSWER", 1.0)
    if address is None:
        monkeypatch.setitem(sys.modules, "distributed", None)
    code = cli.run(["sweep", str(config), "--out", str(tmp_path / "s"), "--scheduler", address or ""])
    assert code == cli.ExitCode.USAGE_ERROR
    assert f"--scheduler{'' if address is None else ':'} {message}" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_a_lost_cluster_keeps_what_was_computed(config, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(cluster, "_ANSWER", 1.0)
    plan, boss, closed = Plan(read_config(config)), distributed.LocalCluster(**HERE), []

    def close(progress: Any) -> None:
        if progress.chunks >= 5 and not closed:
            closed.append(progress.chunks)
            boss.close()

    try:
        with pytest.raises(SweepError, match=r"lost the scheduler at tcp://.*; the chunks computed so far are kept: run again"):
            fill(plan, tmp_path / "s", scheduler=boss.scheduler_address, progress=close)
    finally:
        boss.close()
    assert capfd.readouterr().err == "", "what Dask has to say is said by the error"
    assert 5 <= closed[0] < 160
    summary = fill(plan, tmp_path / "s")
    assert summary.found >= closed[0]
    assert summary.found + summary.computed == 160
