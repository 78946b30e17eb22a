"""How many cells a second does a sweep compute, on one core and two, in one process and on a cluster?

Command: ``brdfcheck study sweep_throughput``. Under two minutes on two cores; the
cluster's part needs the extra 'cluster'.

Answer: a table of 10^7 cells takes 1.8 s on one core with its compiling, 15 million cells a second without, and 22 million on
two. Cells of a microfacet lobe are 7,800 a second on one core, 1.4 times as many on two. From one worker of a cluster to two it
is 1.7 times as many (1,740, 2,950 a second); these short runs take 2 to 3 s more than in one process.

Cheap cells: phong, 5000 exponents by 2000 cosines, a table. Expensive cells: GGX, one by one. Local runs are processes on so
many cores, with as many devices; they tell compiling apart. Workers have a thread each and run the sweep twice, into two
stores; the second time they have compiled already.
"""

from __future__ import annotations

import contextlib
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from matplotlib.ticker import MaxNLocator

from brdfcheck.cores import available_cores
from brdfcheck.plots import paper
from brdfcheck.processes import run_all
from brdfcheck.studies import table
from brdfcheck.sweep import Plan, fill, parse

ALONE = True  # times programs on all cores
SIZES = {"small": ((60, 50), 24), "full": ((5000, 2000), 6000)}
LOCAL = """
import json, os, sys
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + f" --xla_force_host_platform_device_count={sys.argv[1]}"
import brdfcheck
from brdfcheck.cores import available_cores, bind_thread
from brdfcheck.sweep import Plan, fill, parse
cores, config, out = int(sys.argv[1]), sys.argv[2], sys.argv[3]
bind_thread(*available_cores()[:cores])
brdfcheck.use_x64()
done = fill(Plan(parse(json.loads(config))), out)
print(json.dumps([done.cells, done.seconds, done.compiling]))
"""


def run(size: str) -> dict[str, Any]:
    """Cells, seconds and seconds of compiling of every way to run the two sweeps."""
    (exponents, cosines), dear = SIZES[size]
    table = {"brdf": "phong", "axes": {"n": {"geomspace": [1, 1000, exponents]}, "cos_theta": {"linspace": [0, 1, cosines]}}}
    facets = {"brdf": "ggx", "axes": {"alpha": {"linspace": [0.1, 1, dear // 4]}, "cos_theta": [0.1, 0.4, 0.7, 1.0]}}
    cores = len(available_cores())
    results, skipped = [], []
    with tempfile.TemporaryDirectory(prefix="brdfcheck-study-") as folder:
        for cells, config in (("cheap", table), ("dear", facets)):
            for count in (1, 2)[:cores]:
                results.append(_local(cells, config, count, Path(folder, f"{cells}{count}")))
        if cores < 2:
            skipped.append("two cores: this machine has one")
        try:
            for count in (1, 2)[:cores]:
                results.append(_cluster(facets, count, Path(folder)))
        except ImportError:
            skipped.append("the cluster: pip install 'brdfcheck[cluster]'")
    rates = {f"{r['cells']}, {r['way']} {r['count']}": round(r["rate"], 1) for r in results}
    return {"settings": {"cores": cores}, "results": results, "summary": {"cells_per_second": rates, "skipped": skipped}}


def _row(cells: str, way: str, count: int, number: int, seconds: float, starting: float) -> dict[str, Any]:
    rate = number / max(seconds - starting, 1e-9)
    return {"cells": cells, "way": way, "count": count, "number": number, "seconds": seconds, "starting": starting,
            "rate": rate}  # fmt: skip


def _local(cells: str, config: dict[str, Any], count: int, out: Path) -> dict[str, Any]:
    command = [sys.executable, "-c", LOCAL, str(count), json.dumps(config), str(out)]
    (done,) = run_all({cells: command}, side_by_side=False)
    if done.code:
        raise RuntimeError(f"a sweep on {count} cores failed: {done.last_words}")
    return _row(cells, "cores", count, *json.loads(done.output.splitlines()[-1]))


def _cluster(config: dict[str, Any], count: int, folder: Path) -> dict[str, Any]:
    """Workers on this machine. What the first of two runs takes longer is their compiling."""
    from distributed import LocalCluster

    plan, seconds = Plan(parse(config)), []
    options = {"threads_per_worker": 1, "processes": True, "dashboard_address": ":0", "silence_logs": 50}
    with contextlib.closing(LocalCluster(n_workers=count, **options)) as cluster:
        for turn in range(2):
            began = time.perf_counter()
            fill(plan, folder / f"cluster{count}-{turn}", scheduler=cluster.scheduler_address)
            seconds.append(time.perf_counter() - began)
    return _row("dear", "workers", count, plan.cells, seconds[0], max(seconds[0] - seconds[1], 0.0))


def plot(record: dict[str, Any]) -> Any:
    """A bar for each way, one panel for the cheap cells and one for the expensive ones."""
    figure = paper.empty(6.9, 2.9)
    with paper.house_style():
        panels = figure.subplots(1, 2)
        for axes, cells in zip(panels, ("cheap", "dear"), strict=True):
            rows = [result for result in record["results"] if result["cells"] == cells]
            names, rates = [_name(row) for row in rows], [row["rate"] for row in rows]
            colors = ["#56B4E9" if row["way"] == "workers" else "#0072B2" for row in rows]
            bars = axes.barh(names, rates, color=colors, height=0.6)
            axes.bar_label(bars, [f"{rate / 1e6:.2f} million" if rate > 1e6 else f"{rate:,.0f}" for rate in rates], padding=3)
            axes.set(xlim=(0, 1.5 * max(rates)), xlabel="cells a second, without compiling")
            axes.xaxis.set_major_locator(MaxNLocator(4))
            axes.xaxis.set_major_formatter(lambda rate, _: f"{rate / 1e6:g} million" if rate >= 1e6 else f"{rate:,.0f}")
            axes.grid(True, axis="x")
            axes.set_title(
                {"cheap": "cheap cells: Phong, as a table", "dear": "expensive cells: GGX, one by one"}[cells], fontsize=10
            )
            axes.invert_yaxis()
        figure.tight_layout()
    return figure


def _name(row: dict[str, Any]) -> str:
    return f"{row['count']} {row['way'] if row['count'] > 1 else row['way'].removesuffix('s')}"


def summary(record: dict[str, Any]) -> str:
    """The runs as a table, and what was left out."""
    rows = [
        (f"{r['cells']}: {r['number']}", _name(r), f"{r['seconds']:.2f}", f"{r['starting']:.2f}",
         f"{r['rate']:.4g}", f"{r['rate'] / r['count']:.4g}")
        for r in record["results"]
    ]  # fmt: skip
    text = table(("cells", "on", "seconds in all", "of it compiling", "cells a second", "a second and core"), rows)
    return text + "".join(f"\n\nLeft out: {part}." for part in record["summary"]["skipped"])
