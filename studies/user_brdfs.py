"""How long does `check` take for BRDFs as users write them, and does brute force ever find a larger albedo?

Command: ``brdfcheck study user_brdfs``. For an older version's times, ``--given`` the folder of its checkout.

Answer: 3 to 14 seconds on two cores, 4 in the median, 1.7 times as fast as before in the median, 11 times at best and as fast
at worst; brute force finds no larger albedo in any of 14 families, before it did in one.

Twelve kinds of BRDF in plain JAX or numpy (_instruments/user_families.py), two in two forms, over all their parameters. Each
check is a process, timed from start to end on all cores, with an empty cache of compiled programs; beside an older version,
and below four seconds, with what it leaves, too. Brute force (_instruments/user_scan.py) shares nothing with the package:
Sobol points over parameters, cosine and azimuth, denser around the best, a fixed product rule at each; its error is that of
the rule.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import brdfcheck
from _instruments import user_checks, user_families, user_scan
from brdfcheck.cores import available_cores
from brdfcheck.plots import paper
from brdfcheck.studies import table

ALONE = True  # times programs on all cores
GIVEN = "the folder of an older version's checkout"
SMALL = ("minnaert", "oren_nayar_numpy")
BARS = {"before": "#BBBBBB", "now": "#0072B2", "kept": "#56B4E9"}


def run(size: str = "full", given: Sequence[str | Path] = ()) -> dict[str, Any]:
    """All families (small: two of them, fewer points): checks now and before, and brute force."""
    here, baseline = Path(brdfcheck.__file__).parents[1], given[0] if given else None
    if baseline and not Path(baseline, "brdfcheck", "__init__.py").is_file():
        raise ValueError(f"a folder that holds the package brdfcheck is needed; got {str(baseline)!r}")
    results, full = [], size == "full"
    rules = {name: user_scan.Rule(user_families.FAMILIES[name]) for name in (user_families.FAMILIES if full else SMALL)}
    # Brute force first, each family on a core of its own: checks, which are timed, want the machine for themselves.
    with ThreadPoolExecutor(len(available_cores())) as pool:
        points = [1 << (8 if not full else 10 if rule.subject.numpy else 13) for rule in rules.values()]
        scans = list(pool.map(user_scan.scan, rules.values(), points))
    for (name, rule), found in zip(rules.items(), scans, strict=True):
        subject, answers = rule.subject, {"now": user_checks.check(name, here, kept=baseline is not None)}
        answers |= {"before": user_checks.check(name, Path(baseline))} if baseline else {}
        flags = {part: user_checks.faults(answer, found, rule) for part, answer in answers.items()}
        if {answer["verdict"] for answer in answers.values()} == {"CONSERVES", "VIOLATES"}:
            flags["both"] = [f"{answers['now']['verdict']} now, {answers['before']['verdict']} before"]
        about = {"label": subject.label, "source": subject.build.__doc__, "ranges": subject.ranges}
        ratio = answers["before"]["seconds"] / answers["now"]["seconds"] if baseline else None
        results.append({"name": name, **about, **answers, "scan": found, "ratio": ratio, "flags": flags})
    summary = {"families": len(results), "flagged": [row["name"] for row in results if row["flags"]["now"]]}
    summary["baseline_seconds"] = sum(row["before"]["seconds"] for row in results) if baseline else 0.0
    if baseline:
        told = {key: [row["name"] for row in results if row["flags"].get(key)] for key in ("before", "both")}
        ratio = statistics.median(row["ratio"] for row in results)
        summary |= {"median_ratio": ratio, "flagged_before": told["before"], "contradict": told["both"]}
    settings = {"version": user_checks.version(here), "baseline": user_checks.version(Path(baseline)) if baseline else None}
    return {"settings": settings, "results": results, "summary": summary}


def plot(record: dict[str, Any]) -> Any:
    """A group of bars a family: seconds before, now, and now with programs kept; the verdicts beside them."""
    rows = record["results"]
    times = {part: [row[part]["seconds"] for row in rows if part in row] for part in BARS if part != "kept"}
    times["kept"] = [row["now"]["kept_seconds"] or math.nan for row in rows]
    shown = [part for part in BARS if not all(map(math.isnan, times[part]))]
    longest = max(max(filter(math.isfinite, times[part])) for part in shown)
    with paper.house_style():
        figure = paper.empty(8.2, 0.15 * (len(shown) + 0.8) * len(rows) + 1.0)
        axes = figure.subplots()
        for place, part in enumerate(shown):
            heights = [row + (place - (len(shown) - 1) / 2) * 0.26 for row in range(len(rows))]
            bars = axes.barh(heights, times[part], 0.24, color=BARS[part])
            axes.bar_label(bars, [f"{time:.3g} s" if time > 0 else "" for time in times[part]], padding=3, fontsize=7)
        for place, row in enumerate(rows):
            now, flagged = row["now"], row["flags"]["now"] + row["flags"].get("both", [])
            ratio = f", {row['ratio']:.2g} times the speed" if row["ratio"] else ""
            text = f"{now['verdict']}{ratio}\n{_albedo(now)}{'; see the table' if flagged else ''}"
            axes.text(1.01, place, text, transform=axes.get_yaxis_transform(), fontsize=7, va="center",
                      color="#D55E00" if flagged else "#333333")  # fmt: skip
        names = {"before": f"before ({record['settings']['baseline']})", "now": "now", "kept": "now, programs kept"}
        handles = [axes.barh([0], [0], color=BARS[part])[0] for part in shown]
        figure.legend(handles, [names[part] for part in shown], loc="outside upper center", ncol=3)
        axes.set(xscale="log", xlim=(0.5, 2 * longest), ylim=(len(rows) - 0.4, -0.6), xlabel="seconds of a process")
        ticks = [tick for tick in (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if tick < 2 * longest]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        axes.set_yticks(range(len(rows)), [f"{row['label']}\n{', '.join(row['ranges'])}" for row in rows], fontsize=7.5)
        axes.tick_params(axis="y", length=0)
    return figure


def _albedo(answer: dict[str, Any] | None) -> str:
    if not answer:
        return "-"
    albedo = float(answer["albedo"])
    return "grows without bound" if math.isinf(albedo) else f"{albedo:.8g} ± {float(answer['error']):.0e}"


def summary(record: dict[str, Any]) -> str:
    """The times and the answers as tables, and which exclude each other."""
    times, answers, told = [], [], []
    for row in record["results"]:
        now, before, found, label = row["now"], row.get("before"), row["scan"], row["label"]
        seconds = (now["seconds"], now["kept_seconds"], before["seconds"] if before else None, row["ratio"])
        numbers = ("-" if value is None else f"{value:.2f}" for value in seconds)
        times.append((label, str(len(row["ranges"])), *numbers, f"{now['evaluations']:.2g}", str(now.get("points") or "-")))
        seen = f"{found['value']:.8g} ± {found['error']:.0e}" + (", without bound" if found["unbounded"] else "")
        place = ", ".join(f"{name}={value:.4g}" for name, value in found["parameters"].items())
        verdicts = now["verdict"], _albedo(now), before["verdict"] if before else "-", _albedo(before)
        answers.append((label, *verdicts, seen, f"{place}, cos {found['cos_theta']:.4g}"))
        told += [f"- {label}, {when}: {text}" for when, texts in row["flags"].items() for text in texts]
        told += [f"- {label}, now: finding: {text}" for text in now["findings"]]
    old, heading = record["settings"]["baseline"], "Answers that exclude each other, and findings:"
    text = f"Before: {old}, median ratio {record['summary']['median_ratio']:.2f}." if old else "No older version was given."
    header = ("family", "parameters", "seconds", "with programs kept", "before", "ratio", "evaluations", "points")
    header_of_answers = ("family", "verdict", "largest albedo", "verdict before", "largest before", "seen by brute force", "at")
    tables = f"{table(header, times)}\n\n{table(header_of_answers, answers)}"
    return "\n\n".join((text, tables, heading, "\n".join(told) or "None."))
