"""How far do published factors miss the line, and where?

Command: ``python studies/first_look.py`` (writes reports/first_look/). About 10 s on two cores.

Answer: the 16th-power lobe with (n+6)/24.55, published as conserving, exceeds 1 for n in [14.30, 23.06] by up to 0.16 %
(n = 17.85); Blinn-Phong with (n+8)/(8 pi) by up to 7.5 % (n = 8.76). The exact factors sit on the line, the fitted ones
stay below it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

NAMES = {
    "binomial-power-published": "binomial power, (n+6)/24.55",
    "binomial-power-half": "binomial power, fitted",
    "blinn-phong-8": "Blinn-Phong, (n+8)/(8π)",
    "blinn-phong-6": "Blinn-Phong, (n+6)/(8π)",
    "blinn-phong": "Blinn-Phong, exact",
}
COLORS = {
    "binomial-power-published": "#c1272d",
    "binomial-power-half": "#1f6f8b",
    "blinn-phong-8": "#e08214",
    "blinn-phong-6": "#5e8c31",
    "blinn-phong": "#333333",
}
FOLDER = Path(__file__).parent.parent / "reports" / "first_look"


def run(size: int = 400) -> dict[str, Any]:
    """Albedo at normal incidence against the exponent (`size` exponents), and the verdict over all angles."""
    import brdfcheck

    n = np.geomspace(1, 1000, size)
    curves, verdicts = {}, {}
    for name in NAMES:
        table = brdfcheck.albedo_table(name, n, np.array([1.0]))
        curves[name] = {"albedo": np.asarray(table.value)[:, 0].tolist(), "error": float(np.max(table.error))}
        report = brdfcheck.check(name, n=(1, 1000))
        verdicts[name] = {
            "verdict": report.verdict.name,
            "albedo": report.albedo,
            "error": report.error,
            "n": report.parameters["n"],
            "angle_degrees": report.angle,
            "above_1_for_n": report.above,
        }
    return {"question": "largest albedo against the exponent", "n": n.tolist(), "curves": curves, "verdicts": verdicts}


def plot(record: dict[str, Any]) -> Any:
    """The record as a matplotlib figure: the whole range on the left, the line at 1 on the right."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (whole, near) = plt.subplots(1, 2, figsize=(11, 4.4), constrained_layout=True)
    n = np.array(record["n"])
    for name, label in NAMES.items():
        albedo = np.array(record["curves"][name]["albedo"])
        for axes in (whole, near):
            # The exact one lies on the line at 1 and must stay visible there.
            on_the_line = {"linewidth": 4.5, "alpha": 0.45} if name == "blinn-phong" else {"linewidth": 1.8}
            axes.plot(n, albedo, color=COLORS[name], label=label, **on_the_line)
    published = record["verdicts"]["binomial-power-published"]
    albedo = np.array(record["curves"]["binomial-power-published"]["albedo"])
    near.fill_between(n, 1, albedo, where=(albedo > 1).tolist(), color=COLORS["binomial-power-published"], alpha=0.25)
    low, high = published["above_1_for_n"][0]
    near.annotate(
        f"published as conserving:\n{published['albedo']:.5f} at n = {published['n']:.2f},\n"
        f"above 1 for n in [{low:.2f}, {high:.2f}]",
        xy=(published["n"], published["albedo"]),
        xytext=(1.3, 1.0036),
        fontsize=9,
        arrowprops={"arrowstyle": "->", "color": "#555555"},
    )
    for axes in (whole, near):
        axes.axhline(1, color="black", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_xlim(1, 1000)
        axes.set_xlabel("exponent n")
        axes.grid(True, alpha=0.25)
    whole.set_ylabel("directional albedo at normal incidence")
    whole.set_ylim(0.74, 1.1)
    whole.set_title("normalised lobes and the line at 1", fontsize=11)
    whole.legend(fontsize=8.5, loc="lower right")
    near.set_ylim(0.993, 1.008)
    near.set_title("the same, close to the line", fontsize=11)
    return figure


def summary(record: dict[str, Any]) -> str:
    """The verdicts as a Markdown table."""
    rows = ["| BRDF | verdict | largest albedo | at n | angle | above 1 for n in |", "|---|---|---|---|---|---|"]
    for name, verdict in record["verdicts"].items():
        above = ", ".join(f"[{low:.2f}, {high:.2f}]" for low, high in verdict["above_1_for_n"] or []) or "-"
        rows.append(
            f"| `{name}` | {verdict['verdict']} | {verdict['albedo']:.10f} ± {verdict['error']:.1e} | {verdict['n']:.2f}"
            f" | {verdict['angle_degrees']:.1f}° | {above} |"
        )
    return "\n".join(["# First look: factors against the line at 1", "", "![albedo against n](figure.png)", "", *rows, ""])


def main() -> None:
    """Run, and write record.json, figure.png and summary.md."""
    from brdfcheck.precision import use_x64

    use_x64()
    record = run()
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "record.json").write_text(json.dumps(record, indent=1) + "\n")
    plot(record).savefig(FOLDER / "figure.png", dpi=110, metadata={"Software": None})
    (FOLDER / "summary.md").write_text(summary(record))


if __name__ == "__main__":
    main()
