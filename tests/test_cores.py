"""The cores that this process may use, and binding to one."""

from __future__ import annotations

import os
import sys
import threading

import pytest
from threadpoolctl import threadpool_info

from brdfcheck import cores


def test_the_cores_are_those_of_the_affinity(monkeypatch):
    assert cores.available_cores() == sorted(set(cores.available_cores())) != []
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {5, 3}, raising=False)
    assert cores.available_cores() == [3, 5]
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    assert cores.available_cores() == [0, 1, 2]


def test_one_core_is_one_core_for_every_thread():
    before = cores.available_cores()
    seen, go = [], threading.Event()

    def look() -> None:
        go.wait(20)
        seen.append(cores.available_cores())

    thread = threading.Thread(target=look)
    thread.start()
    threads = [library["num_threads"] for library in threadpool_info()]
    with cores.on_one_core():
        assert cores.available_cores() == before[:1]
        assert all(library["num_threads"] == 1 for library in threadpool_info())
        go.set()
        thread.join()
    assert seen == [before[:1]]
    assert cores.available_cores() == before
    assert [library["num_threads"] for library in threadpool_info()] == threads


def test_side_by_side_is_one_after_the_other_inside(monkeypatch):
    monkeypatch.setattr(cores, "available_cores", lambda: [0, 1])
    inside = cores.side_by_side(lambda _: cores.side_by_side(lambda _: threading.get_ident(), range(3)), range(4))
    assert all(len({*one}) == 1 for one in inside)
    assert threading.get_ident() not in {one[0] for one in inside}


def test_how_long_threads_keep_the_lock_is_what_it_was(monkeypatch):
    monkeypatch.setattr(cores, "available_cores", lambda: [0, 1])
    before = sys.getswitchinterval()
    first, second = threading.Event(), threading.Event()

    def other() -> None:
        cores.side_by_side(lambda _: first.set() or second.wait(20), range(2))

    thread = threading.Thread(target=other)

    def both(place: int) -> float:
        if place == 0:
            thread.start()
            assert first.wait(20)
        return sys.getswitchinterval()

    assert cores.side_by_side(both, range(2))[0] < before
    assert sys.getswitchinterval() < before
    second.set()
    thread.join()
    assert sys.getswitchinterval() == before


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="threads are not bound on this system")
def test_a_bound_thread_leaves_the_others_where_they_are():
    before, seen = cores.available_cores(), []

    def bound() -> None:
        cores.bind_thread(before[-1])
        seen.append(cores.available_cores())

    thread = threading.Thread(target=bound)
    thread.start()
    thread.join()
    assert seen == [before[-1:]]
    assert cores.available_cores() == before


def test_where_the_system_binds_nothing_nothing_happens(monkeypatch):
    before = cores.available_cores()
    monkeypatch.delattr(os, "sched_setaffinity", raising=False)
    cores.bind_thread(before[0])
    with cores.on_one_core():
        assert cores.available_cores() == before
