"""Commands as processes: side by side with a core each, one at a time with all, and ended when nobody waits for them."""

from __future__ import annotations

import contextlib
import os
import sys
import time

import pytest
from selection import few

from brdfcheck import processes
from brdfcheck.cores import available_cores

TELL = "import os; print(sorted(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else '')"


def python(program: str) -> tuple[str, ...]:
    return (sys.executable, "-c", program)


def test_how_each_ended():
    commands = {
        "good": python("print('fine')"),
        "bad": python("print('first'); raise RuntimeError('boom')"),
        "silent": python("import sys; sys.exit(7)"),
        "killed": python("import os, signal; os.kill(os.getpid(), signal.SIGKILL)"),
    }
    found = {end.name: end for end in processes.run_all(commands, side_by_side=True)}
    assert set(found) == set(commands)
    assert (found["good"].code, found["good"].output) == (0, "fine\n")
    assert (found["bad"].code, found["bad"].last_words) == (1, "RuntimeError: boom")
    assert (found["silent"].code, found["silent"].last_words) == (7, "ended with exit code 7")
    assert found["killed"].last_words == "ended by signal 9"
    assert all(end.seconds > 0 for end in found.values())


@pytest.mark.parametrize(
    ("output", "code", "words"),
    [
        ("warning\n", -11, "ended by signal 11"),
        ("Traceback ...\nValueError: no\n----\nFor simplicity, frames are left out.\n", 1, "ValueError: no"),
        ("jax.errors.JaxRuntimeError: INVALID\nmore\n", 1, "jax.errors.JaxRuntimeError: INVALID"),
        ("only words\n\n", 2, "only words"),
    ],
)
def test_last_words(output, code, words):
    assert processes.Finished("x", code, 1.0, output).last_words == words


def test_as_many_at_once_as_there_are_cores(tmp_path, monkeypatch):
    """Each waits for the other; on one core too, where tests share the cores."""
    monkeypatch.setattr(processes, "available_cores", lambda: [available_cores()[0]] * 2)
    wait = "import os, sys, time\nopen(sys.argv[1], 'w').close()\nwhile not os.path.exists(sys.argv[2]): time.sleep(.02)"
    paths = [str(tmp_path / name) for name in "ab"]
    commands = {"a": (*python(wait), *paths), "b": (*python(wait), *paths[::-1])}
    assert [end.code for end in processes.run_all(commands, side_by_side=True)] == [0, 0]


def test_nothing_to_run():
    assert list(processes.run_all({}, side_by_side=True)) == []


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system binds no process")
def test_side_by_side_each_has_a_core_and_alone_it_has_all():
    commands = {str(i): python(TELL + "; import time; time.sleep(.3)") for i in range(4)}
    before = available_cores()
    seen = [end.output.strip() for end in processes.run_all(commands, side_by_side=True)]
    assert set(seen) == {f"[{core}]" for core in before[:4]}
    (end,) = processes.run_all({"one": python(TELL)}, side_by_side=False)
    assert end.output.strip() == str(before)
    assert available_cores() == before


def test_side_by_side_no_one_takes_the_whole_accelerator(monkeypatch):
    monkeypatch.delenv("XLA_PYTHON_CLIENT_PREALLOCATE", raising=False)
    tell = python("import os; print(os.environ.get('XLA_PYTHON_CLIENT_PREALLOCATE'))")
    for side_by_side, told in ((True, "false"), (False, "None")):
        (end,) = processes.run_all({"one": tell}, side_by_side=side_by_side)
        assert end.output.strip() == told
    monkeypatch.setenv("XLA_PYTHON_CLIENT_PREALLOCATE", "true")
    (end,) = processes.run_all({"one": tell}, side_by_side=True)
    assert end.output.strip() == "true"


def test_one_at_a_time_in_their_order(tmp_path):
    log = tmp_path / "log"
    commands = {
        name: python(f"import time\nf = open({str(log)!r}, 'a')\nf.write('<{name}'); f.flush(); time.sleep(.1); f.write('>')")
        for name in "cab"
    }
    assert [end.name for end in processes.run_all(commands, side_by_side=False)] == ["c", "a", "b"]
    assert log.read_text() == "<c><a><b>"


@pytest.mark.parametrize("side_by_side", few([True, False], (True,)))
@pytest.mark.parametrize("stubborn", few([True, False], (True,)))
def test_who_leaves_ends_the_processes(tmp_path, monkeypatch, side_by_side, stubborn):
    monkeypatch.setattr(processes, "_GRACE", 1.0)
    ignore = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\n" if stubborn else ""
    sleeper = f"{ignore}import os, time\nopen('PID', 'w').write(str(os.getpid())); time.sleep(60)"
    commands = {"quick": python("pass")}
    commands |= {name: python(sleeper.replace("PID", str(tmp_path / name))) for name in ("slow", "slower", "slowest")}
    began = time.monotonic()
    with contextlib.closing(processes.run_all(commands, side_by_side=side_by_side)) as ends:
        assert next(ends).name == "quick"
        while not (tmp_path / "slow").exists() or not (tmp_path / "slow").read_text():
            time.sleep(0.05)
        time.sleep(0.2)
    assert time.monotonic() - began < 40
    for file in tmp_path.iterdir():
        with pytest.raises(ProcessLookupError):
            os.kill(int(file.read_text()), 0)
    # On more than two cores all three were begun, in one at a time only the next.
    assert side_by_side or len(list(tmp_path.iterdir())) == 1
