#!/usr/bin/env python3
"""Which rule gives the most digits of an albedo for its time, and which ones never arrive?

Command: ``brdfcheck study work_precision`` (or ``python studies/work_precision.py``). 2 minutes on two cores.

Answer: the exact-azimuth rule, everywhere: 15 digits from 120 to 240 evaluations, whatever the exponent and the angle, and
the half-vector rule for the Beckmann needle (14 digits in 7,500). What knows nothing of the lobe needs 10^4 evaluations for a
smooth lobe, has no digit or four of a needle of n = 10^5, and never sees the Beckmann needle at grazing incidence.

References: ball arithmetic (Arb) of the one-dimensional integrals, the Beckmann needle by slope-space integrals; none of the
contenders. Peers take part where they are installed (``pip install 'brdfcheck[peers]'``).
"""

from __future__ import annotations

from typing import Any

# (case, lobe, parameter, cos theta, albedo with factor 1)
CASES = (
    ("smooth: Phong n = 10, cos θ = 0.7", "Phong", 10.0, 0.7, 0.3666790309883656274900),
    ("sharp: Phong n = 1000, cos θ = 0.7", "Phong", 1000.0, 0.7, 0.004389450813398912429958),
    ("needle: Phong n = 10⁵, cos θ = 0.7", "Phong", 1e5, 0.7, 4.398141752190666441489e-5),
    ("grazing: Phong n = 100, cos θ = 0.01", "Phong", 100.0, 0.01, 0.002771588772830686606407),
    ("grazing: Phong n = 100, cos θ = 10⁻⁴", "Phong", 100.0, 1e-4, 0.002454423997688288404610),
    ("kinked: Kuijk-Blake n = 100, cos θ = 0.7", "KuijkBlake", 100.0, 0.7, 0.04519036441947223608951),
    ("Beckmann needle: m = cos θ = 1/64", "Beckmann", 1 / 64, 1 / 64, 0.9136679211844224),
)
SINGLE = (0,)


def run(size: str = "full") -> dict[str, Any]:
    """All rules through their settings on all cases, and on one of them in float32 too."""
    from brdfcheck import CookTorrance, KuijkBlake, Phong
    from brdfcheck.peers import PEERS
    from brdfcheck.quadrature import RULES
    from brdfcheck.work_precision import Case, measure_all, single

    build = {"Phong": Phong, "KuijkBlake": KuijkBlake, "Beckmann": lambda m: CookTorrance(m, masking="smith-separable")}
    cases = [Case(name, lobe, build[lobe](value), value, mu, exact) for name, lobe, value, mu, exact in CASES]
    cases = cases + [single(cases[index]) for index in SINGLE] if size == "full" else cases[:1]
    present = {name: peer for name, peer in PEERS.items() if peer.missing() is None}
    results: list[dict[str, Any]] = []
    for case in cases:
        rules = [*RULES.values(), *present.values()]
        if "float32" in case.name:  # what knows rounding only as noise need not be compiled again
            rules = [rule for rule in RULES.values() if rule.family not in ("montecarlo", "quasi-montecarlo")]
        if size == "small":
            rules = [RULES[name] for name in ("cosine-monte-carlo", "gauss-product", "zonal", "closed-form")]
        limit, settings = (0.1, 4) if size == "full" else (0.05, 2)
        results += [point.to_json_object() for point in measure_all(rules, case, most_seconds=limit, settings=settings)]
    missing = {name: peer.missing() for name, peer in PEERS.items() if name not in present}
    return {"settings": {"missing_peers": missing}, "results": results, "summary": {"measurements": len(results)}}


def plot(record: dict[str, Any]) -> Any:
    """One panel a case: error against seconds, the frontier bold."""
    from brdfcheck.plots import precision

    return precision.figure(record["results"])


def summary(record: dict[str, Any]) -> str:
    """For each case: what each rule reaches, and what the first digits cost."""
    from brdfcheck.studies import table

    points = record["results"]
    cases = list(dict.fromkeys(point["case"] for point in points))
    rules = list(dict.fromkeys(point["rule"] for point in points))

    def best(rule: str, case: str) -> str:
        own = [point for point in points if point["rule"] == rule and point["case"] == case and point["error"] != "NaN"]
        if not own:
            return "-"
        point = min(own, key=lambda point: (point["error"], point["warm_seconds"]))
        return f"{point['error']:.0e} / {point['evaluations']} / {point['warm_seconds'] * 1e3:.2f}"

    text = table(("rule", *cases), [(f"`{rule}`", *(best(rule, case) for case in cases)) for rule in rules])
    lies = [
        (point["case"], f"`{point['rule']}` {point['setting']}", f"{point['error']:.1e}", f"{point['claimed']:.1e}")
        for point in points
        if point["claimed"] != "NaN" and point["error"] != "NaN" and point["error"] > 4 * point["claimed"] + 1e-15
    ]
    lied = table(("case", "rule", "relative error", "claimed"), lies) if lies else "None."
    missing = "; ".join(str(message) for message in record["settings"]["missing_peers"].values()) or "none"
    return (
        "Smallest relative error reached / evaluations / milliseconds (warm, one albedo; a setting that takes longer than 0.2 s"
        f" ends its ladder):\n\n{text}\n\nClaimed errors that were too small by more than a factor of 4:\n\n{lied}\n\n"
        f"Peers that were not installed: {missing}."
    )


if __name__ == "__main__":
    from brdfcheck.studies import main

    main(__file__)
