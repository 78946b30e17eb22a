"""Which rule gives the most digits of an albedo for its time, and which ones never arrive?

Command: ``brdfcheck study work_precision``. Three minutes on two cores.

Answer: the exact-azimuth rule, everywhere: 14 digits from 80 to 212 evaluations, a tenth of a millisecond by itself and 10
microseconds in a batch, whatever the exponent and the angle, and the half-vector rule for the Beckmann needle (14 digits in
4,416). From a million evaluations product rules, lattices and Monte Carlo have at most four digits of a needle of n = 10^5; of
the Beckmann needle Monte Carlo by the lobe, ours and Mitsuba's, has three and the others at most one; scipy, quadax and
torchquad have none of that one, and most claim to. In float32 all that arrive have 6 to 7 digits.

References: ball arithmetic (Arb) of the one-dimensional integrals, the Beckmann needle by slope-space integrals; none of the
contenders. Times: on one core, the fastest of three, of one albedo by itself and of 64 in one call. Peers take part where they
are installed (``pip install 'brdfcheck[peers]'``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from _instruments import charts
from _instruments.charts import ROUNDING
from _instruments.peers import PEERS, mitsuba_peer
from _instruments.work_precision import Case, measure_all, single
from brdfcheck import CookTorrance, KuijkBlake, Phong, plots
from brdfcheck.output import records
from brdfcheck.quadrature import RULES
from brdfcheck.studies import table

# (case, lobe, parameter, cos theta, albedo with factor 1)
CASES = (
    ("smooth: Phong n = 10, cos θ = 0.7", "Phong", 10.0, 0.7, 0.3666790309883656274900),
    ("sharp: Phong n = 1000, cos θ = 0.7", "Phong", 1000.0, 0.7, 0.004389450813398912429958),
    ("needle: Phong n = 10⁵, cos θ = 0.7", "Phong", 1e5, 0.7, 4.398141752190666441489e-5),
    ("grazing: Phong n = 100, cos θ = 10⁻⁴", "Phong", 100.0, 1e-4, 0.002454423997688288404610),
    ("kinked: Kuijk-Blake n = 100, cos θ = 0.7", "KuijkBlake", 100.0, 0.7, 0.04519036441947223608951),
    ("Beckmann needle: m = cos θ = 1/64", "Beckmann", 1 / 64, 1 / 64, 0.9136679211844224),
)
# Of these in float32 too: smooth, sharp, needle.
SINGLE = (0, 1, 2)
MOST_SECONDS = 0.1


def run(size: str = "full") -> dict[str, Any]:
    """All rules through their settings on all cases, and on three of them in float32 too."""
    build = {"Phong": Phong, "KuijkBlake": KuijkBlake, "Beckmann": lambda m: CookTorrance(m, masking="smith-separable")}
    cases = [Case(name, lobe, build[lobe](value), value, mu, exact) for name, lobe, value, mu, exact in CASES]
    # Beside the wide cases the narrow ones: a row of panels each.
    cases = [*cases[:3], *(single(cases[index]) for index in SINGLE), *cases[3:]] if size == "full" else cases[:1]
    present = {name: peer for name, peer in PEERS.items() if peer.missing() is None}
    results: list[dict[str, Any]] = []
    limit, ladder = (MOST_SECONDS, 4) if size == "full" else (0.05, 2)
    for case in cases:
        rules = [*RULES.values(), *present.values()]
        if "float32" in case.name or "kinked" in case.name:
            # To rules of samples rounding and kinks are noise; peers take no float32, and are shown on sharper lobes.
            rules = [rule for rule in RULES.values() if rule.family not in ("montecarlo", "quasi-montecarlo")]
        if size == "small":
            rules = [RULES[name] for name in ("cosine-monte-carlo", "gauss-product", "zonal", "closed-form")]
        results += records.plain(measure_all(rules, case, most_seconds=limit, settings=ladder))
    ran = {result["rule"] for result in results}
    settings = {
        "missing_peers": {name: peer.missing() for name, peer in PEERS.items() if name not in present},
        "most_seconds": limit,
        "mitsuba_variant": [Path(part).name for part in mitsuba_peer.variant()] if "mitsuba" in ran else None,
    }
    packages = list(dict.fromkeys(peer.package for name, peer in PEERS.items() if name in ran))
    return {"settings": settings, "results": results, "summary": {"measurements": len(results)}, "packages": packages}


def plot(record: dict[str, Any]) -> Any:
    """One panel a case: error against seconds of an albedo in a batch, the frontier bold."""
    return charts.figure(record["results"], "batched_seconds")


def pictures(record: dict[str, Any]) -> dict[str, bytes]:
    """The same against seconds of one albedo by itself, where all that is fast stands at the cost of a call."""
    return {"one-call.png": plots.to_bytes(charts.figure(record["results"]), ".png")}


def summary(record: dict[str, Any]) -> str:
    """For each case: what each rule reaches, and what the first digits cost."""
    points, settings = record["results"], record["settings"]
    cases = list(dict.fromkeys(point["case"] for point in points))
    rules = list(dict.fromkeys(point["rule"] for point in points))

    def best(rule: str, case: str) -> str:
        own = [point for point in points if point["rule"] == rule and point["case"] == case and point["error"] != "NaN"]
        if not own:
            return "-"
        point = min(own, key=lambda point: (max(point["error"], ROUNDING[point["dtype"]]), point["warm_seconds"]))
        times = " / ".join(f"{point[f'{name}_seconds'] * 1e3:.2g}" for name in ("warm", "batched"))
        return f"{point['error']:.0e} / {point['evaluations']} / {times}"

    text = table(("rule", *cases), [(f"`{rule}`", *(best(rule, case) for case in cases)) for rule in rules])
    lies = [
        (point["case"], f"`{point['rule']}` {point['setting']}", f"{point['error']:.1e}", f"{point['claimed']:.1e}")
        for point in points
        if point["claimed"] != "NaN" and point["error"] != "NaN" and point["error"] > 4 * point["claimed"] + 1e-15
    ]
    lied = table(("case", "rule", "relative error", "claimed"), lies) if lies else "None."
    # Of peers of one package one message is enough.
    missing = "; ".join(dict.fromkeys(map(str, settings["missing_peers"].values()))) or "none"
    variant = f" Mitsuba ran as {': '.join(settings['mitsuba_variant'])}." if settings["mitsuba_variant"] else ""
    compiled = max(points, key=lambda point: point["compile_seconds"])
    return (
        "Smallest relative error reached (those below 16 units in the last place count as equal) / evaluations / milliseconds"
        " of one albedo by itself / of each of 64 in a call (warm; a setting that takes longer than"
        f" {settings['most_seconds']:g} s ends its ladder):\n\n{text}\n\n"
        "By itself: ![the same against seconds of one albedo](one-call.png)\n\n"
        f"Claimed errors that were too small by more than a factor of 4:\n\n{lied}\n\nWhat a first call compiles is not in"
        f" these times; the longest was {compiled['compile_seconds']:.0f} s for `{compiled['rule']}`.\n\n"
        f"Peers that were not installed: {missing}.{variant}"
    )
