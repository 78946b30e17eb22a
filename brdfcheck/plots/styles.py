"""How each BRDF is drawn, for life: the colour and the marker say which lobe, the dashes which variant of it.

The colours are those of Okabe & Ito (2008), without the yellow, which vanishes on paper, and a few dark ones. They
stay apart for every kind of colour vision; markers and dashes tell the curves apart in greyscale.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

Dashes = tuple[float, ...]


class Style(NamedTuple):
    """Colour, dashes (lengths on and off, in line widths; empty: solid) and marker of a curve."""

    color: str
    dashes: Dashes
    marker: str


LOBES: dict[str, tuple[str, str]] = {
    "Lambert": ("#545454", "_"),
    "Phong": ("#0072B2", "o"),
    "Blinn-Phong": ("#E69F00", "s"),
    "Schlick": ("#009E73", "^"),
    "Kuijk-Blake": ("#CC79A7", "D"),
    "Lyon": ("#56B4E9", "v"),
    "binomial power": ("#D55E00", "P"),
    "Cook-Torrance": ("#000000", "X"),
    "Beckmann-Smith": ("#332288", "p"),
    "GGX": ("#663311", "*"),
    "dielectric": ("#940EF4", "H"),
}
DASHES: tuple[Dashes, ...] = (
    (),
    (5, 1.6),
    (1.2, 1.4),
    (7, 1.6, 1.2, 1.6),
    (3, 1.2, 3, 1.2, 1, 1.2),
    (12, 2),
)
# One line for an entry of the catalogue: its lobe, and which of the dashes. A test fails where one is missing.
VARIANTS: dict[str, tuple[str, int]] = {
    "lambert": ("Lambert", 0),
    "phong": ("Phong", 0),
    "phong-pdf": ("Phong", 1),
    "phong-classical": ("Phong", 2),
    "blinn-phong": ("Blinn-Phong", 0),
    "blinn-phong-fitted": ("Blinn-Phong", 1),
    "blinn-phong-6": ("Blinn-Phong", 2),
    "blinn-phong-8": ("Blinn-Phong", 3),
    "blinn-phong-ndf": ("Blinn-Phong", 4),
    "blinn-phong-linear": ("Blinn-Phong", 5),
    "schlick-mirror": ("Schlick", 0),
    "schlick-half": ("Schlick", 1),
    "schlick-phong-factor": ("Schlick", 2),
    "kuijk-blake-mirror": ("Kuijk-Blake", 0),
    "kuijk-blake-half": ("Kuijk-Blake", 1),
    "kuijk-blake-phong-factor": ("Kuijk-Blake", 2),
    "lyon-1-half": ("Lyon", 0),
    "lyon-2-half": ("Lyon", 1),
    "lyon-3-half": ("Lyon", 2),
    "lyon-1-mirror": ("Lyon", 3),
    "lyon-2-mirror": ("Lyon", 4),
    "lyon-3-mirror": ("Lyon", 5),
    "binomial-power-published": ("binomial power", 0),
    "binomial-power-half": ("binomial power", 1),
    "binomial-power-raw": ("binomial power", 5),
    "binomial-power-mirror": ("binomial power", 2),
    "binomial-power-unclamped": ("binomial power", 3),
    "cook-torrance": ("Cook-Torrance", 0),
    "cook-torrance-published": ("Cook-Torrance", 1),
    "cook-torrance-no-masking": ("Cook-Torrance", 2),
    "beckmann-smith": ("Beckmann-Smith", 0),
    "beckmann-smith-correlated": ("Beckmann-Smith", 1),
    "ggx": ("GGX", 0),
    "dielectric": ("dielectric", 0),
    "rough-dielectric-beckmann": ("dielectric", 1),
    "rough-dielectric-ggx": ("dielectric", 2),
    "thin-sheet": ("dielectric", 3),
    "lambert-transmission": ("Lambert", 1),
}
# A lobe with a factor fitted to it is named after both: "lyon-1-half, minimax".
FITS: dict[str, Dashes] = {
    "minimax": (4, 1, 1, 1),
    "least-squares": (2.2, 1),
    "reciprocal": (6, 1, 1, 1, 1, 1),
}
# For BRDFs of your own: dark colours that no lobe has.
_GUESTS = ("#117733", "#999933", "#5E3C99", "#AA3377", "#2F4B4B")
_GUEST_MARKERS = ("h", "d", "<", ">", "8")


def style_of(name: str) -> Style:
    """The style of a catalogue entry, or one drawn from the name for a BRDF of your own: the same in every figure."""
    if name in VARIANTS:
        lobe, variant = VARIANTS[name]
        color, marker = LOBES[lobe]
        return Style(color, DASHES[variant], marker)
    lobe, _, objective = name.partition(", ")
    if lobe in VARIANTS and objective in FITS:
        return style_of(lobe)._replace(dashes=FITS[objective])
    return _guest(name)


def _guest(name: str, more: int = 0) -> Style:
    ticket = zlib.crc32(name.rpartition("/")[2].encode()) + more
    color = ticket % len(_GUESTS)
    rest = ticket // len(_GUESTS)
    return Style(_GUESTS[color], DASHES[rest % len(DASHES)], _GUEST_MARKERS[(color + rest // len(DASHES)) % 5])


def styles(names: Iterable[str]) -> dict[str, Style]:
    """The styles of the curves of one figure. Of two guests with the same one, the second gives way."""
    found: dict[str, Style] = {}
    for name in names:
        style, guest = style_of(name), name not in found and name.partition(", ")[0] not in VARIANTS
        for more in range(1, 152):  # then every style is taken
            if not guest or style not in found.values():
                break
            style = _guest(name, more)
        found.setdefault(name, style)
    return found


def looks(curves: Sequence[Mapping[str, Any]]) -> list[Style]:
    """The style of each curve: its BRDF's, from light to dark along the curves where there are several of one BRDF."""
    names = [curve["name"] for curve in curves]
    known = styles(names)
    found = []
    for index, name in enumerate(names):
        style, others = known[name], names.count(name) - 1
        if others:
            dark = 0.0 if style.color == "#000000" else 0.45
            style = style._replace(color=shade(style.color, -0.55 + (0.55 + dark) * names[:index].count(name) / others))
        found.append(style)
    return found


def shade(color: str, part: float) -> str:
    """`color` mixed with white (part < 0) or black (part > 0); -1 is white, 1 is black."""
    channels = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    target = 0 if part > 0 else 255
    mixed = [round(channel + (target - channel) * abs(part)) for channel in channels]
    return "#" + "".join(f"{channel:02X}" for channel in mixed)


def ink(color: str) -> str:
    """`color`, darkened until text in it reads well on white."""
    while _luminance(color) > 0.18:
        color = shade(color, 0.12)
    return color


def _luminance(color: str) -> float:
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def superscript(exponent: int) -> str:
    """An exponent in plain characters, which any output format draws as text: ⁻¹⁶."""
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
