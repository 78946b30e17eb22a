"""What a version of brdfcheck says of a family, in a fresh process, and whether that agrees with brute force."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

FAMILIES = Path(__file__).resolve().with_name("user_families.py")
# With the fields that older reports lack, and a module that had another name.
CHECK = """
import json, runpy, sys
import brdfcheck
try:
    from brdfcheck.runtime import use_compilation_cache
except ImportError:
    from brdfcheck.precision import use_compilation_cache

brdfcheck.use_x64()
use_compilation_cache()
subject = runpy.run_path(sys.argv[1])["FAMILIES"][sys.argv[2]]
report = brdfcheck.check(subject.build, **subject.ranges)
fields = ("albedo", "error", "parameters", "cos_theta", "azimuth", "engine", "evaluations", "findings", "notes",
          "basis", "points", "climbs", "settled", "width")
answer = {name: getattr(report, name, None) for name in fields}
answer |= {"verdict": report.verdict.name, "package": brdfcheck.__file__}
print(json.dumps(answer, default=lambda value: float(value) if hasattr(value, "__float__") else str(value)))
"""
# How far the albedo at a cosine of 1e-9, where brute force ends, may be from its limit.
_LIMIT = 1e-6
# Seconds of a check in which compiling programs, half a second or so, is a small part.
_LONG = 4


def check(name: str, folder: Path, *, kept: bool = False) -> dict[str, Any]:
    """What the package in `folder` says of a family, and the seconds of its process with an empty cache of programs.

    `kept`: run it a second time, with the cache that the first run left, where programs are no small part of the time.
    RuntimeError where a process fails.
    """
    seconds: list[float] = []
    answer: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="brdfcheck-study-") as cache:
        environment = {**os.environ, "PYTHONPATH": str(folder.resolve()), "BRDFCHECK_CACHE": cache}
        # -P: what lies beside a study is no module to import.
        command = [sys.executable, "-P", "-c", CHECK, str(FAMILIES), name]
        while not seconds or (kept and len(seconds) < 2 and seconds[0] < _LONG):
            began = time.perf_counter()
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
            seconds.append(time.perf_counter() - began)
            if done.returncode:
                words = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
                raise RuntimeError(f"the check of {name} failed: {words[-1]}")
            answer = json.loads(done.stdout, parse_constant=str)  # as records have NaN and infinities
    package = Path(answer.pop("package")).resolve()
    if not package.is_relative_to(folder.resolve()):
        raise RuntimeError(f"the process was to use the package in {folder}; it used {package.parent}")
    return {"seconds": seconds[0], "kept_seconds": seconds[1] if len(seconds) > 1 else None, **answer}


def faults(answer: dict[str, Any], found: dict[str, Any], rule: Any) -> list[str]:
    """Where an answer of `check` and brute force (`found`, and what its `rule` gives elsewhere) exclude each other."""
    value, error = float(answer["albedo"]), float(answer["error"])
    if math.isnan(value) or math.isnan(error):
        return ["the albedo is not a number"]
    if found["unbounded"]:
        violates = answer["verdict"] == "VIOLATES"
        return [] if violates else [f"{answer['verdict']}, but the albedo grows without bound towards grazing incidence"]
    told = [f"{found['nonfinite']} albedos by brute force were not finite"] if found["nonfinite"] else []
    if not found["value"] - found["error"] <= value + error:
        told.append(f"a larger albedo was seen: {found['value']:.10g} at cos {found['cos_theta']:.4g}, {found['parameters']}")
    there, width = rule.at(answer["parameters"], answer["cos_theta"], answer["azimuth"])
    if not value - error <= max(there + width, found["value"] + found["error"]) + _LIMIT:
        told.append(f"such an albedo was not seen: {there:.10g} at the place of {value:.10g}")
    if answer["verdict"] == "CONSERVES" and found["value"] - found["error"] > 1 + 1e-9:
        told.append("CONSERVES, but an albedo above 1 was seen")
    return told


def version(folder: Path) -> str:
    """The commit of a checkout; "unknown" where there is none."""
    if not (folder / ".git").exists():
        return "unknown"
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "unknown"
