"""Colours from spectra, and from linear light to a screen."""

from __future__ import annotations

import importlib
import warnings
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

Observer = Literal["CIE RGB", "CIE XYZ"]
_OBSERVERS = {"CIE RGB": "Wright & Guild 1931 2 Degree RGB CMFs", "CIE XYZ": "CIE 1931 2 Degree Standard Observer"}


def encode_srgb(linear: Any) -> Float[np.ndarray, "..."]:
    """Linear light to the sRGB transfer curve (IEC 61966-2-1), both in [0, 1]; values outside are cut off, NaN is 0."""
    value = np.clip(np.nan_to_num(np.asarray(linear, np.float64), nan=0.0), 0, 1)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def rgb_of_spectrum(
    wavelengths: Any, reflectance: Any, *, illuminant: str = "D65", observer: Observer = "CIE XYZ"
) -> Float[np.ndarray, " 3"]:
    r"""The colour of a reflectance spectrum under an illuminant, linear, where a perfect white is (1, 1, 1).

    $R = \int \bar r C I\, d\lambda$ and G, B likewise (Yokoi et al., eq. 2), with C the `reflectance` at the rising
    `wavelengths` (nm; between them a straight line, beyond them the end values) and I the illuminant, over 1 nm steps.

    * observer "CIE RGB": the integrals themselves over those of white: the primaries of the colour-matching functions;
    * observer "CIE XYZ": X, Y, Z likewise, then linear sRGB, adapted from the illuminant's white to D65 (Bradford).

    Saturated colours may have components below 0 or above 1. Needs colour-science (``pip install 'brdfcheck[colour]'``):
    ImportError without it. ValueError for spectra that are not finite, negative or of unequal length, or unknown names.
    """
    wavelengths, reflectance = np.asarray(wavelengths, float), np.asarray(reflectance, float)
    good = wavelengths.ndim == 1 and wavelengths.size > 1 and wavelengths.shape == reflectance.shape
    if not (good and np.all(np.isfinite(wavelengths)) and np.all(np.diff(wavelengths) > 0)):
        raise ValueError("a spectrum is at least two rising wavelengths in nm and as many reflectances")
    if not np.all(np.isfinite(reflectance) & (reflectance >= 0)):
        raise ValueError(f"reflectances must be finite and >= 0; the smallest is {np.min(reflectance):g}")
    if observer not in _OBSERVERS:
        raise ValueError(f"observer must be one of {', '.join(_OBSERVERS)}; got {observer!r}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what colour-science itself could use and does not find
        try:
            colour = importlib.import_module("colour")  # not this file, which bears its name
        except ImportError as error:
            raise ImportError("colours from spectra need colour-science: pip install 'brdfcheck[colour]'") from error
        if illuminant not in colour.SDS_ILLUMINANTS:
            raise ValueError(f"illuminant must be one of {', '.join(colour.SDS_ILLUMINANTS)}; got {illuminant!r}")
        matching = colour.MSDS_CMFS[_OBSERVERS[observer]]
        light = colour.SDS_ILLUMINANTS[illuminant]
        nodes = np.arange(matching.wavelengths[0], matching.wavelengths[-1] + 0.5)
        bars = np.stack([np.interp(nodes, matching.wavelengths, column) for column in matching.values.T])
        power = np.interp(nodes, light.wavelengths, light.values, left=0, right=0)
        seen = bars @ (np.interp(nodes, wavelengths, reflectance) * power)
        white = bars @ power
        if observer == "CIE RGB":
            return seen / white
        to_xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
        adapted = colour.chromatic_adaptation(
            seen / white[1], white / white[1], to_xyz @ np.ones(3), method="Von Kries", transform="Bradford"
        )
        return np.asarray(np.linalg.solve(to_xyz, adapted))
