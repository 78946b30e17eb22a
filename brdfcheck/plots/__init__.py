"""Figures from records: nothing is computed here, and what computes (JAX) is never imported.

`figure` makes a matplotlib Figure of the curves of `brdfcheck.output.curves`, `to_bytes` a file. One record gives the same
bytes in every process. Figures do not belong to pyplot: nothing global changes, nothing has to be closed.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The kinds of curves, and what draws them.
KINDS = {"albedo-vs-n": "exponent", "albedo-vs-angle": "angle", "heatmap": "heatmap", "factor": "factor"}
FORMATS = (".svg", ".png", ".pdf")
_DPI = 200
# How many colours pages are tried with, and the root mean square of the change (of 255) that hardly shows.
_COLOURS, _HARDLY = (32, 64, 128, 256), 2.5
# From which difference it is another colour, and the share of pixels that may have one.
_ANOTHER, _FEW = 40, 1e-5
# Dates and versions would change the bytes of an unchanged figure.
_METADATA = {
    ".svg": {"Date": None, "Creator": None},
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def figure(
    kind: str,
    curves: Sequence[Mapping[str, Any]],
    *,
    scale: str | None = None,
    limits: tuple[float, float] | None = None,
    title: str | None = None,
) -> Figure:
    """The figure of `kind` (one of `KINDS`) with these curves, all of that kind.

    `scale`: ``"log"`` or ``"linear"`` parameter axis; by default logarithmic where the range is long and starts above 0.
    `limits`: (bottom, top) of the albedo axis; by default it holds the curves but ends at 6, and says so. `title`: a line
    above. ValueError where the curves do not fit into one figure: different parameters, a logarithmic axis through 0, none at
    all.
    """
    from brdfcheck.plots import panels, paper

    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}; got {kind!r}")
    if not curves:
        raise ValueError("there is no curve to plot")
    wrong = [curve["name"] for curve in curves if curve["kind"] != kind]
    if wrong:
        raise ValueError(f"{wrong[0]} is not a curve of the kind {kind}")
    if scale not in (None, "log", "linear"):
        raise ValueError(f"scale must be log or linear; got {scale!r}")
    with paper.house_style():
        return getattr(panels, KINDS[kind])(curves, scale, limits, title)


def to_bytes(figure: Figure, suffix: str, *, widest: int | None = None) -> bytes:
    """The figure as a file of the format `suffix`, one of `FORMATS`. The same bytes each time.

    `widest`: for pages that are kept, how many pixels across a PNG may have; images in an SVG get few colours.
    ValueError for another suffix.
    """
    from brdfcheck.plots import paper

    if suffix not in FORMATS:
        raise ValueError(f"the suffix must be one of {', '.join(FORMATS)}; got {suffix!r}")
    stream = io.BytesIO()
    dpi = _DPI if widest is None else min(_DPI, widest / figure.get_figwidth())
    with paper.house_style():
        figure.savefig(stream, format=suffix[1:], dpi=dpi, metadata=_METADATA[suffix])
    if suffix != ".svg" or widest is None:
        return stream.getvalue()
    text = _EMBEDDED.sub(lambda png: base64.b64encode(with_few_colours(base64.b64decode(png[0]))), stream.getvalue())
    return _short(text)


def _short(svg: bytes) -> bytes:
    """The same figure in half the space, coordinates rounded to a tenth of a point."""
    text = _PATHS.sub(lambda path: _DIGITS.sub(rb"\1", path[0]), svg)
    # Pairs of numbers that follow a line's or a move's are lines.
    text = _INDENT.sub(b"\n", _LINES.sub(lambda run: run[0].replace(b" \nL ", b" "), text))
    # Names are numbers: the library's are of coordinates to the last bit, in which two layouts of a figure may differ.
    named = {name for name, _ in _NAMED.findall(text)}
    numbers = {name: b"n%d" % number for number, name in enumerate(n for n in _ID.findall(text) if n in named)}
    text = _ID.sub(lambda name: b' id="%s"' % numbers[name[1]] if name[1] in numbers else b"", text)
    text = _NAMED.sub(lambda name: b"#%s%s" % (numbers.get(name[1], name[1]), name[2]), text)
    # Each marker carries its style: they are rules, each written once.
    styles = {style: b"s%d" % number for number, style in enumerate(dict.fromkeys(_STYLE.findall(text)))}
    rules = b"".join(b"\n.%s{%s}" % (name, style) for style, name in styles.items())
    text = _STYLE.sub(lambda style: b' class="%s"' % styles[style[1]], text)
    return text.replace(b"</style>", rules + b"</style>", 1)


# Coordinates of paths and of markers.
_PATHS, _DIGITS = re.compile(rb' (?:d|x|y)="[^"]*"'), re.compile(rb"(\.\d)\d+")
_LINES, _INDENT = re.compile(rb"[ML] \S+ \S+(?: \nL \S+ \S+)+"), re.compile(rb"\n +")
_ID, _NAMED, _STYLE = re.compile(rb' id="([^"]*)"'), re.compile(rb'#([^")]+)([")])'), re.compile(rb' style="([^"]*)"')
_EMBEDDED = re.compile(rb"(?<=data:image/png;base64,)[^\"]+")


def with_few_colours(png: bytes, widest: int | None = None) -> bytes:
    """A PNG with as few colours as hardly show, 256 at most, in a third of the space: for pages that are kept.

    Shading that needs them all is dithered. What is wider than `widest` pixels is made smaller.
    """
    import numpy as np
    from PIL import Image

    image = Image.open(io.BytesIO(png)).convert("RGB")
    if widest is not None and image.width > widest:
        image = image.resize((widest, round(image.height * widest / image.width)), Image.Resampling.LANCZOS)
    fewer = image
    for colours in _COLOURS:
        palette = image.quantize(colours, Image.Quantize.MEDIANCUT)
        fewer = image.quantize(
            palette=palette, dither=Image.Dither.FLOYDSTEINBERG if colours == _COLOURS[-1] else Image.Dither.NONE
        )
        differences = np.asarray(image, float) - np.asarray(fewer.convert("RGB"), float)
        # In the mean a small patch of a colour of its own, as in a legend, counts for nothing: none may be another colour.
        # What is off only along edges, a pixel wide, is no patch.
        other = np.abs(differences).max(axis=-1) > _ANOTHER
        patch = other[1:-1, 1:-1] & other[:-2, 1:-1] & other[2:, 1:-1] & other[1:-1, :-2] & other[1:-1, 2:]
        if np.sqrt(np.mean(differences * differences)) < _HARDLY and np.sum(patch) <= _FEW * other.size:
            break
    stream = io.BytesIO()
    fewer.save(stream, "PNG", optimize=True)
    return stream.getvalue()
