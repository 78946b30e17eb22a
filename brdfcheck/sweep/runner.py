"""Running a sweep: what is missing in the store is computed, here or on a cluster, and written chunk by chunk."""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brdfcheck.sweep.compute import Computer, Result
from brdfcheck.sweep.config import Config, read_config
from brdfcheck.sweep.plan import Chunk, Plan
from brdfcheck.sweep.store import Store

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class Progress:
    """How far a sweep has come: cells and chunks in the store, and `cells_before`, those that were there when it began."""

    cells: int
    chunks: int
    cells_before: int


@dataclass(frozen=True)
class Summary:
    """What a run did: chunks and cells computed by it and found by it, files repaired, seconds; `compiling` is part of it.

    On a cluster `compiling` is 0: the workers keep no count. `not_a_number` and `infinite`: how many albedos of the whole
    store are.
    """

    computed: int
    found: int
    cells: int
    repaired: int
    seconds: float
    compiling: float
    not_a_number: int
    infinite: int


@dataclass(frozen=True)
class Estimate:
    """What a sweep would take: seconds for what is not yet in the store, of which `compiling`, both estimated.

    `memory`: bytes of the chunks in hand at a time. `size`: bytes of the finished store. `found`: chunks that are there.
    """

    seconds: float
    compiling: float
    memory: int
    size: int
    found: int


def fill(
    plan: Plan,
    out: str | os.PathLike[str],
    *,
    scheduler: str | None = None,
    repair: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Summary:
    """Compute the chunks of `plan` that the store `out` lacks, and write them. Raises UsageError and SweepError.

    `scheduler`: the address of a Dask scheduler; without one, the devices of this machine. `repair`: compute damaged chunks
    again, which are an error otherwise. `progress` is called at the beginning and after each chunk.
    """
    began = time.perf_counter()
    computer = None
    with contextlib.ExitStack() as stack:
        cluster = None
        if scheduler is not None:  # a wrong address leaves no empty store behind
            from brdfcheck.sweep.cluster import Cluster

            cluster = stack.enter_context(Cluster(scheduler))
        store = stack.enter_context(Store(out, plan, repair=repair))
        found, cells_found = len(store.done), sum(plan.chunk(index).cells for index in store.done)
        results: Iterator[Result] = iter(())
        if found < plan.chunks:
            missing = plan.missing(frozenset(store.done))
            if cluster is None:
                computer = Computer(plan)
                results = itertools.chain.from_iterable(map(computer, plan.waves(missing, computer.width)))
            else:
                results = cluster.results(plan, missing)
        cells = cells_found
        say = progress or (lambda _: None)
        say(Progress(cells, found, cells_found))
        for result in results:
            store.write(result)
            cells += plan.chunk(result.index).cells
            say(Progress(cells, len(store.done), cells_found))
        return Summary(
            computed=plan.chunks - found,
            found=found,
            cells=cells - cells_found,
            repaired=store.repaired,
            seconds=time.perf_counter() - began,
            compiling=computer.compiling if computer is not None else 0.0,
            not_a_number=store.not_a_number,
            infinite=store.infinite,
        )


def run_sweep(
    config: str | os.PathLike[str] | Config,
    out: str | os.PathLike[str],
    *,
    scheduler: str | None = None,
    repair: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> xarray.Dataset:
    """Albedos over a grid of parameters, angles and settings, written to the Zarr store `out` and opened by xarray.

    `config`: a TOML file (see `brdfcheck.sweep.config`) or a `Config`. The dataset has the dimensions of the configuration:
    `albedo` and `error` (with a trailing `channel` for RGB), `evaluations`, and `seconds` over the grid of chunks. What is
    in the store already is kept: interrupted at any moment and called again, it resumes, and the result is byte-identical.
    `progress` is called at the beginning and after each chunk.

    Raises UsageError for a configuration that is wrong or does not match the store, SweepError where the disk is full,
    the store is damaged (`repair` mends it), or the cluster at `scheduler` is lost.
    """
    import xarray

    plan = Plan(config if isinstance(config, Config) else read_config(Path(config)))
    fill(plan, out, scheduler=scheduler, repair=repair, progress=progress)
    return xarray.open_zarr(os.fspath(out), chunks=None)


def estimate(plan: Plan, out: str | os.PathLike[str] | None) -> Estimate:
    """Measure a little of a sweep to say what all of it would take. Creates nothing.

    Raises what the sweep would raise for a store that is there and does not fit.
    """
    found: set[int] = set()
    if out is not None:
        store = Store(out, plan)
        store.look()
        found = store.done
    computer = Computer(plan)
    there: Counter[Any] = Counter()
    for chunk in map(plan.chunk, found):
        there[plan.compiled(chunk)] += chunk.cells
    # By what is compiled, not chunk by chunk: a dry run is for sweeps that are too large.
    kinds: dict[tuple[Any, ...], list[tuple[Chunk, int]]] = {}
    for program, places in plan.pieces():
        first = plan.at(tuple(place[0] for place in places))
        cells = plan.cells_of(places) - there[plan.compiled(first)]
        if cells:
            kinds.setdefault(tuple(program.settings[name] for name in ("brdf", "rule", "precision")), []).append((first, cells))
    seconds = compiling = 0.0
    for pieces in kinds.values():
        half = len(pieces) // 2
        compile_one, per_cell = computer.sample(pieces[half][0])
        if half:  # the first of its kind is slower by what is traced and imported once
            compiling += compile_one
            compile_one, per_cell = computer.sample(pieces[half - 1][0])
            compiling -= compile_one
        compiling += compile_one * len(pieces)
        seconds += per_cell * sum(cells for _, cells in pieces)
    memory = plan.size(plan.chunk_cells) * computer.width
    return Estimate(seconds + compiling, compiling, memory, plan.size(plan.cells), len(found))
