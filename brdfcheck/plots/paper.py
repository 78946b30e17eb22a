"""What all figures share: the house style, numbers, axes, the line at 1, labels that do not collide."""

from __future__ import annotations

import contextlib
import math
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import Affine2D, ScaledTranslation, blended_transform_factory

from brdfcheck.plots.styles import Style, ink, superscript

TOP = 6.0  # an axis of albedos ends here, whatever a lobe reaches
_LABEL = 0.155  # inches a direct label
_MOST_LABELS = 14
_LONGEST = 42  # characters of a name
_LEAST_WIDTH = 4.6  # inches of the axes
_HOUSE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.labelsize": 9.5,
    "axes.titlesize": 10.0,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#444444",
    "axes.axisbelow": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.unicode_minus": True,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.color": "#333333",
    "ytick.color": "#333333",
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 3.6,
    "lines.linewidth": 1.7,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "hatch.linewidth": 0.6,
    "figure.dpi": 100,
    "figure.constrained_layout.use": True,
    "text.parse_math": False,  # a name may hold a dollar
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "brdfcheck",
    "pdf.fonttype": 42,
}


@contextlib.contextmanager
def house_style() -> Iterator[None]:
    """The house's settings of matplotlib within the block, whatever the user's own are."""
    with matplotlib.style.context(["default", _HOUSE]), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn with boxes; in SVG it is text, and whole.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from")
        yield


def empty(width: float, height: float) -> Figure:
    """A figure without axes, in inches, that belongs to no window."""
    return Figure(figsize=(width, height))


# --- numbers ---


def text_of(value: float, digits: int = 5) -> str:
    """A number as one writes it: 14.303, 1000, 6.7·10²⁸."""
    if not math.isfinite(value):
        return "not a number" if math.isnan(value) else "infinity" if value > 0 else "−infinity"
    if value != 0 and not 1e-4 <= abs(value) < 1e6:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        text = f"10{superscript(int(power))}"
        return text if mantissa == "1" else f"{mantissa}·{text}".replace("-", "−")
    text = f"{value:.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:.{digits}g}"
    return text.replace("-", "−")


def degrees(cosine: float) -> str:
    """The angle of incidence with this cosine, in degrees."""
    angle = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
    return f"{angle:.3g}°" if angle < 89.95 or angle == 90 else f"{angle:.5g}°"


def floats(values: Any) -> np.ndarray:
    """Numbers of a record, in which NaN and infinities are words."""
    return np.array([float("nan") if value is None else float(value) for value in values])


def wrapped(text: str, width: float, size: float) -> str:
    """The text in lines that fit into `width` inches at `size` points, broken between words where that is possible."""
    return "\n".join(textwrap.wrap(text, max(int(width * 72 / (0.6 * size)), 8), break_on_hyphens=False)) or text


def label_of(curve: Mapping[str, Any]) -> str:
    """What a curve is called in a figure: without the folders of a file, and not without end."""
    name = str(curve.get("label") or curve["name"].rpartition("/")[2])
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST // 3]}…{name[-(2 * _LONGEST) // 3 :]}"


def power_tick(value: float) -> str:
    """A tick of a long axis: 0.1, 1, 10, 10², 10³."""
    exponent = math.log10(value) if value > 0 else 0.0
    if abs(exponent - round(exponent)) > 1e-9 or -2 <= exponent <= 1:
        return text_of(value, 6)
    return f"10{superscript(round(exponent))}"


# --- axes ---


class _WithOne(MaxNLocator):
    """Round ticks, and one at 1: that line has a name."""

    def tick_values(self, vmin: float, vmax: float) -> Any:
        ticks = np.asarray(super().tick_values(vmin, vmax))
        if len(ticks) > 1 and vmin < 1 < vmax and np.min(np.abs(ticks - 1)) > 1e-9:
            ticks = np.sort(np.append(ticks[np.abs(ticks - 1) > 0.35 * (ticks[1] - ticks[0])], 1.0))
        return ticks


def parameter_axis(axes: Axes, curves: Sequence[Mapping[str, Any]], scale: str | None) -> str:
    """Set up the parameter axis for these curves. Returns its name; ValueError where they do not share one."""
    names = {curve["parameter"]: curve["name"] for curve in reversed(curves)}
    if len(names) > 1:
        (one, first), (other, second) = list(names.items())[:2]
        raise ValueError(f"{first} runs over {one}, {second} over {other}: one figure has one axis; plot them apart")
    (parameter,) = names
    low = min(float(curve["range"][0]) for curve in curves)
    high = max(float(curve["range"][1]) for curve in curves)
    if low == high:  # one value: room for a marker
        low, high = (low / 1.5, low * 1.5) if low > 0 else (-0.5, 0.5)
    if scale == "log" and low <= 0:
        raise ValueError(f"a logarithmic axis must start above 0; {parameter} starts at {low:g}")
    logarithmic = scale == "log" or (scale is None and low > 0 and high / low >= 15)
    if logarithmic:
        axes.set_xscale("log")
        decades = math.log10(high / low)
        subs = (1.0,) if decades > 2.2 else (1.0, 2.0, 5.0)
        axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=20))
        axes.xaxis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=20))
        axes.xaxis.set_minor_formatter(NullFormatter())
    long = logarithmic and high / low > 1e4
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: power_tick(value) if long else text_of(value, 6)))
    axes.set_xlim(low, high)
    words = {"n": "exponent n", "m": "slope m", "alpha": "roughness α", "reflectance": "reflectance"}
    axes.set_xlabel(words.get(parameter, str(parameter)))
    return str(parameter)


def cosine_axis(axes: Axes, top: Axes, curves: Sequence[Mapping[str, Any]]) -> None:
    """The cosine of incidence, from normal incidence on the left to grazing on the right; degrees at the top."""
    low = min(float(curve["cos_theta"][0]) for curve in curves)
    high = max(float(curve["cos_theta"][1]) for curve in curves)
    if low == high:
        low, high = max(low - 0.05, 0.0), min(high + 0.05, 1.0)
    if low < 0.03:
        low = 0.0
    axes.set_xlim(high, low)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: text_of(round(value, 6), 6)))
    axes.set_xlabel("cos θ, from normal to grazing incidence")
    angles = [0, 30, 45, 60, 70, 80, 90] if high - low > 0.4 else np.arange(0, 91, 5 if high - low > 0.1 else 1).tolist()
    shown = [angle for angle in angles if low - 1e-9 <= math.cos(math.radians(angle)) <= high + 1e-9]
    second = top.secondary_xaxis("top", functions=(lambda x: x, lambda x: x))
    second.xaxis.set_major_locator(FixedLocator([math.cos(math.radians(angle)) for angle in shown]))
    second.xaxis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{math.degrees(math.acos(min(max(value, 0.0), 1.0))):.0f}°")
    )
    second.tick_params(length=2.5, labelsize=7.5)
    second.spines["top"].set_visible(False)


def albedo_axis(
    axes: Axes, curves: Sequence[Mapping[str, Any]], limits: tuple[float, float] | None, key: str = "albedo"
) -> list[str]:
    """The albedo axis with the line at 1. Returns what to say about curves that leave it."""
    values = [floats(np.ravel(curve[key])) for curve in curves]
    finite = np.concatenate([value[np.isfinite(value)] for value in values])
    low, high = (float(np.min(finite)), float(np.max(finite))) if finite.size else (0.0, 1.0)
    if limits is None:
        bottom = min(low, 0.97)
        top = max(high, 1.01, 1 + 0.08 * (1 - max(bottom, 0)))
        top = min(top, TOP)
        room = 0.05 * (top - min(bottom, top))
        bottom = 0.0 if 0 <= bottom < 0.25 * top else max(bottom, -TOP) - room
        limits = (bottom, top + (room if top < TOP else 0.0))
    axes.set_ylim(*limits)
    axes.yaxis.set_major_locator(_WithOne(7, steps=[1, 2, 2.5, 5, 10]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: text_of(round(value, 9), 7)))
    if limits[0] <= 1 <= limits[1]:
        axes.axhline(1, color="black", linewidth=1.0, zorder=2.2)
    axes.grid(True)
    said = []
    for curve, value in zip(curves, values, strict=True):
        if np.any(value > limits[1] * (1 + 1e-12)):
            x = floats(curve["x"])
            index = int(np.argmax(np.where(np.isnan(value), -np.inf, value)))
            axis = "cos θ" if curve["kind"] == "albedo-vs-angle" else curve["parameter"]
            # Where the search has found no bound, the largest sample is as large as it happens to be.
            endless = np.isinf(value[index]) or math.isinf(float((curve.get("largest") or {}).get("albedo", 0)))
            what = "grows without bound" if endless else f"reaches {text_of(float(value[index]), 3)}"
            said.append(f"{label_of(curve)} {what} {'towards' if endless else 'at'} {axis} = {text_of(x[index], 4)}")
        elif np.any(np.isnan(value)) and not np.any(np.isfinite(value)):
            said.append(f"{label_of(curve)} is not a number")
    if not said:
        return []
    more = [f"and {len(said) - 4} more curves leave it"] if len(said) > 4 else []
    return [f"axis cut at {text_of(limits[1])}:", *(f"{line} ↑" for line in said[:4]), *more]


def title_above(axes: Axes, text: str) -> None:
    """A title that stays within the figure: in several lines where it is long. Names beside the axes must be drawn before."""
    figure: Any = axes.figure
    title = axes.set_title(text, pad=10)
    for characters in range(len(text), 7, -1):
        figure.draw_without_rendering()
        extent, page = title.get_window_extent(), figure.bbox
        over = max(page.x0 - extent.x0, extent.x1 - page.x1)
        if over <= 0:
            return
        # What is too long is so on the longest line, which is in the middle.
        longest = max(map(len, title.get_text().split("\n")))
        fits = int(longest * (1 - 2 * over / extent.width))
        title.set_text("\n".join(textwrap.wrap(text, max(min(fits, characters), 8), break_on_hyphens=False)))


def note(axes: Axes, lines: Sequence[str]) -> None:
    """Small print below the axis."""
    if lines:
        head, *rest = lines
        text = "\n".join([f"{head} {rest[0]}" if rest else head, *rest[1:]])
        axes.set_xlabel(f"{axes.get_xlabel()}\n")
        axes.annotate(
            text, (0, 0), (0, -33), xycoords="axes fraction", textcoords="offset points", va="top", ha="left",
            fontsize=7.5, color="#444444",
        )  # fmt: skip


def line_of(axes: Axes, x: np.ndarray, y: np.ndarray, style: Style, index: int, count: int, **options: Any) -> None:
    """One curve, with a few markers that stand at other places than those of its neighbours."""
    marked: dict[str, Any] = marker_of(style)
    if len(x) == 1:
        marked["markersize"] *= 1.7
    else:
        # At equal distances along the axis, not along the samples, which are dense where something happens.
        places = np.array([along(axes, value) for value in x])
        wanted = (np.arange(4) + (index + 0.5) / max(count, 1)) / 4
        marked["markevery"] = sorted({int(np.argmin(np.abs(places - place))) for place in wanted})
    width = options.pop("linewidth", 1.7 if count < 12 else 1.3)
    axes.plot(x, y, linewidth=width, **{"zorder": 3, **stroke_of(style), **marked, **options})


def stroke_of(style: Style) -> dict[str, Any]:
    """The line's options."""
    return {"color": style.color, "linestyle": (0, style.dashes) if style.dashes else "-"}


def marker_of(style: Style) -> dict[str, Any]:
    """The marker's options. Crosses and stars look smaller than disks of their size."""
    size = 6.0 if style.marker in "PX*" else 4.4
    return {"marker": style.marker, "markersize": size, "markeredgecolor": "white", "markeredgewidth": 0.5}


def along(axes: Axes, value: float) -> float:
    """Where on the x axis, from 0 to 1, without asking for a layout."""
    low, high = axes.get_xlim()
    if axes.get_xscale() == "log":
        low, high, value = math.log(low), math.log(high), math.log(max(value, 1e-300))
    return (value - low) / (high - low)


def keep_width(axes: Axes) -> None:
    """Widen the figure where names on the right have left the axes too little room."""
    figure: Any = axes.figure
    for _ in range(2):
        figure.draw_without_rendering()
        missing = _LEAST_WIDTH - axes.get_window_extent().width / figure.dpi
        if missing <= 0.01:
            return
        figure.set_size_inches(figure.get_figwidth() + missing, figure.get_figheight())
    figure.draw_without_rendering()


# --- labels ---


@dataclass
class Label:
    """A curve's name and the height, in the data, at which it ends on the right; `under` ranks equal ends."""

    text: str
    style: Style
    end: float
    under: float = 0.0


def direct_labels(axes: Axes, labels: Sequence[Label]) -> None:
    """Each name beside the right end of its curve, pushed apart where they would collide; a legend where they are too many.

    In either case a sample of the line stands by the name: in greyscale colours alone would not do.
    """
    figure = axes.figure
    figure.draw_without_rendering()  # pyright: ignore[reportAttributeAccessIssue]
    height = axes.get_window_extent().height / figure.dpi  # pyright: ignore[reportAttributeAccessIssue]
    bottom, top = axes.get_ylim()
    known = [bottom if math.isnan(label.end) else min(max(label.end, bottom), top) for label in labels]
    # Through the axes' own scale, linear or logarithmic.
    left = axes.get_xlim()[0]
    places = axes.transAxes.inverted().transform(axes.transData.transform([(left, end) for end in known]))
    ends = [float(place) for place in places[:, 1]]
    order = sorted(range(len(labels)), key=lambda i: (ends[i], labels[i].under))
    step = _LABEL / height
    spread = apart([ends[i] for i in order], step)
    shift = max((abs(place - ends[i]) for i, place in zip(order, spread, strict=True)), default=0.0)
    if len(labels) > _MOST_LABELS or len(labels) * step > 1.02 or shift > 0.45:
        _legend(axes, [labels[i] for i in reversed(order)], height)
        keep_width(axes)
        return
    for i, place in zip(order, spread, strict=True):
        label = labels[i]
        _offset_line(axes, [(0, ends[i]), (9, place)], color="#999999", linewidth=0.6)
        name_beside(axes, label.text, label.style, place)
    keep_width(axes)


def name_beside(axes: Axes, text: str, style: Style, place: float) -> None:
    """A name right of the axes at this fraction of their height, with a sample of its line."""
    _offset_line(axes, [(10, place), (33, place)], linewidth=1.7, **stroke_of(style))
    _offset_line(axes, [(21.5, place)], color=style.color, **marker_of(style))
    axes.annotate(
        text, (1.0, place), (37, 0), xycoords="axes fraction", textcoords="offset points", ha="left", va="center",
        fontsize=8.0, color=ink(style.color), annotation_clip=False,
    )  # fmt: skip


def _offset_line(axes: Axes, points: Sequence[tuple[float, float]], **options: Any) -> None:
    """A line through (points of the page right of the axes, height as a fraction of the axes)."""
    figure = axes.figure
    assert figure is not None
    # The right edge of the axes as it follows the layout: ScaledTranslation asks the transform anew whenever it has changed.
    right = Affine2D().scale(1 / 72) + figure.dpi_scale_trans + ScaledTranslation(1, 0, axes.transAxes)  # pyright: ignore
    transform = blended_transform_factory(right, axes.transAxes)
    x, y = zip(*points, strict=True)
    axes.add_artist(Line2D(x, y, transform=transform, clip_on=False, zorder=4, **options))


def _legend(axes: Axes, labels: Sequence[Label], height: float) -> None:
    looks = ((label.text, stroke_of(label.style) | marker_of(label.style)) for label in labels)
    handles = [Line2D([], [], label=text, linewidth=1.5, **look) for text, look in looks]
    rows = max(int(height / 0.17), 1)
    columns = math.ceil(len(handles) / rows)
    axes.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, ncols=columns, labelspacing=0.35,
        columnspacing=1.2,
    )  # fmt: skip


def apart(places: Sequence[float], gaps: float | np.ndarray, least: float = 0.0, most: float = 1.0) -> np.ndarray:
    """Places moved as little as need be, until each is its gap beyond the one before and all are from `least` to `most`."""
    if not places:
        return np.zeros(0)
    offsets = np.append(0.0, np.cumsum(np.broadcast_to(gaps, len(places) - 1)))
    # Isotonic regression: each place is the largest, over where a bunch begins, of the smallest mean, over where it ends.
    total = np.append(0.0, np.cumsum(places - offsets))
    first, last = np.indices((len(places),) * 2)
    means = np.where(first <= last, (total[last + 1] - total[first]) / np.maximum(last - first + 1, 1), np.inf)
    least_means = np.minimum.accumulate(means[:, ::-1], axis=1)[:, ::-1]
    moved = np.max(np.where(first <= last, least_means, -np.inf), axis=0)
    return np.clip(moved, least, max(most - offsets[-1], least)) + offsets


def decades(ticks: Callable[..., object], powers: Iterable[int]) -> None:
    """Ticks at powers of ten, by the method of axes that sets them."""
    places = list(powers)
    ticks([10.0**k for k in places], ["1" if k == 0 else f"10{superscript(k)}" for k in places])
