"""Albedo against the cosine of incidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from brdfcheck.plots import exponent, paper
from brdfcheck.plots.styles import Style, styles

# Labels of more curves than these find no place beside the axes.
_MOST = 40


def figure(
    curves: Sequence[Mapping[str, Any]], *, scale: str | None, limits: tuple[float, float] | None, title: str | None
) -> Figure:
    """One curve a BRDF and value of its parameter: a colour a lobe, from light to dark along the parameter."""
    if scale == "log":
        raise ValueError("the cosine of incidence has a linear axis: it starts at 0")
    if len(curves) > _MOST:
        raise ValueError(f"{len(curves)} curves do not fit into one figure of angles, at most {_MOST} do: choose some of them")
    with paper.house_style():
        look = looks(curves)
        named = [{**curve, "label": _label(curve, curves)} for curve in curves]
        edges = [(float(curve["cos_theta"][0]), float(curve["cos_theta"][1])) for curve in curves]
        found = paper.violations(named, look, edges)
        whole, axes, strip = paper.frame(len(found), height=min(max(4.0, 0.17 * len(curves) + 0.6), 7.5))
        paper.cosine_axis(axes, strip or axes, curves)
        axes.set_ylabel("directional albedo E")
        lines = paper.albedo_axis(axes, named, limits)
        # The right end is grazing incidence: the samples come in rising cosines.
        turned = [{**curve, "x": curve["x"][::-1], "albedo": curve["albedo"][::-1]} for curve in named]
        exponent.draw(axes, turned, look, "albedo")
        paper.note(axes, lines)
        if title:
            (strip or axes).set_title(title, pad=10)
        paper.direct_labels(axes, exponent.labels(turned, look, "albedo"))
        paper.show_intervals(axes, strip, found, "E > 1\nfor θ", angles=True)
        return whole


def looks(curves: Sequence[Mapping[str, Any]]) -> list[Style]:
    """The style of each curve: its BRDF's, lighter or darker where there are several of one BRDF."""
    known = styles(curve["name"] for curve in curves)
    total: dict[str, int] = {}
    for curve in curves:
        total[curve["name"]] = total.get(curve["name"], 0) + 1
    seen: dict[str, int] = {}
    result = []
    for curve in curves:
        name = curve["name"]
        index = seen.get(name, 0)
        seen[name] = index + 1
        style = known[name]
        result.append(style._replace(color=paper.faded(style.color, index, total[name])))
    return result


def _label(curve: Mapping[str, Any], curves: Sequence[Mapping[str, Any]]) -> str:
    at = ", ".join(f"{name} = {paper.text_of(float(value), 4)}" for name, value in curve["at"].items())
    if len({other["name"] for other in curves}) == 1 and at and len(curves) > 1:
        return at
    return f"{paper.label_of(curve)}, {at}" if at else paper.label_of(curve)
