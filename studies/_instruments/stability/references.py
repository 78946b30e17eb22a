"""The matrix of stability: its lobes, and albedos with derivatives that come from elsewhere than the rules."""

from __future__ import annotations

import csv
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lyon, Phong, Schlick
from brdfcheck.brdf.microfacet import GGX, CookTorrance

_MATRIX = Path(__file__).resolve().parents[2] / "stability.csv"
# The names of the references, and what builds the lobe from its exponent or slope.
LOBES: Mapping[str, Callable[[Any], Any]] = {
    "phong": Phong,
    "blinn": BlinnPhong,
    "schlick": Schlick,
    "schlick_half": lambda n: Schlick(n, "half"),
    "kb": KuijkBlake,
    "kb_half": lambda n: KuijkBlake(n, "half"),
    "lyon1": lambda n: Lyon(n, 1),
    "lyon1_mirror": lambda n: Lyon(n, 1, "mirror"),
    "lyon2": lambda n: Lyon(n, 2),
    "lyon2_mirror": lambda n: Lyon(n, 2, "mirror"),
    "lyon3": lambda n: Lyon(n, 3),
    "lyon3_mirror": lambda n: Lyon(n, 3, "mirror"),
    "lyon4_mirror": lambda n: Lyon(n, 4, "mirror"),
    "lyon5": lambda n: Lyon(n, 5),
    "lyon5_mirror": lambda n: Lyon(n, 5, "mirror"),
    "lyon6": lambda n: Lyon(n, 6),
    "lyon6_mirror": lambda n: Lyon(n, 6, "mirror"),
    "binomial4": lambda n: BinomialPower(n, 4),
    "binomial8": lambda n: BinomialPower(n, 8),
    "binomial8_mirror": lambda n: BinomialPower(n, 8, "mirror"),
    "binomial8_unclamped": lambda n: BinomialPower(n, 8, clamped=False),
    "binomial8_mirror_unclamped": lambda n: BinomialPower(n, 8, "mirror", clamped=False),
    "binomial16": BinomialPower,
    "binomial16_mirror": lambda n: BinomialPower(n, form="mirror"),
    "binomial16_unclamped": lambda n: BinomialPower(n, clamped=False),
    "binomial16_mirror_unclamped": lambda n: BinomialPower(n, form="mirror", clamped=False),
    "binomial32": lambda n: BinomialPower(n, 32),
    "binomial64": lambda n: BinomialPower(n, 64),
    "cook-torrance": CookTorrance,
    "beckmann-smith": lambda m: CookTorrance(m, masking="smith-separable"),
    "beckmann-smith-correlated": lambda m: CookTorrance(m, masking="smith-correlated"),
    "ggx": GGX,
}
MICROFACETS = ("cook-torrance", "beckmann-smith", "beckmann-smith-correlated", "ggx")
# One lobe of each kind: power, tail, kinks in both forms, a rebound, masking with and without kinks, facets with a tail.
KINDS = ("phong", "schlick", "kb_half", "lyon1_mirror", "binomial16_unclamped", "cook-torrance", "ggx")


def label(lobe: str) -> str:
    """The name of a reference as a figure shows it: "Lyon w = 1, mirror"."""
    fixed = {
        "phong": "Phong",
        "blinn": "Blinn-Phong",
        "cook-torrance": "Cook-Torrance",
        "beckmann-smith": "Beckmann-Smith",
        "beckmann-smith-correlated": "Beckmann-Smith, correlated",
        "ggx": "GGX",
    }
    if lobe in fixed:
        return fixed[lobe]
    family, *rest = lobe.split("_")
    name, digits = family.rstrip("0123456789"), family.lstrip("abcdefghijklmnopqrstuvwxyz")
    built: Any = LOBES[lobe](1.0)
    called = {"schlick": "Schlick", "kb": "Kuijk-Blake", "lyon": f"Lyon w = {digits}", "binomial": f"binomial k = {digits}"}
    return ", ".join((called[name], built.form, *(["unclamped"] if "unclamped" in rest else [])))


@dataclass(frozen=True)
class Reference:
    """The albedo of a lobe at its parameters (rows) and cosines of incidence (columns), and how far it may be off.

    `slopes`: its derivatives, by what is varied: "n" for n dE/dn (or m dE/dm), "theta" for dE/dtheta, to 1e-6 of the larger of
    themselves and E. At 90 degrees it is that from below; of microfacets the one that `quadrature.half_vector` defines, in
    float32 under the name "theta, float32".
    """

    lobe: str
    parameters: np.ndarray
    cosines: np.ndarray
    albedo: np.ndarray
    radius: np.ndarray
    slopes: Mapping[str, np.ndarray]

    def slope(self, by: str, dtype: Any) -> np.ndarray:
        """The derivative by "n" or "theta" as it is defined in a precision."""
        return self.slopes.get(f"{by}, {np.dtype(dtype).name}", self.slopes[by])


def read_references(lobes: Container[str] | None = None) -> dict[str, Reference]:
    """The references of these lobes, or of all: a full grid for each lobe."""
    numbers = ("albedo", "radius", "by_logarithm", "by_angle", "by_angle_float32")
    cells: dict[str, dict[tuple[float, float], list[float]]] = {}
    with open(_MATRIX, newline="", encoding="utf-8") as source:
        for row in (row for row in csv.DictReader(source) if lobes is None or row["lobe"] in lobes):
            place = (float(row["n"]), float(row["cos_theta"]))
            cells.setdefault(row["lobe"], {})[place] = [float(row[name]) for name in numbers]
    found = {}
    for lobe, values in cells.items():
        parameters = np.array(sorted({n for n, _ in values}))
        cosines = np.array(sorted({mu for _, mu in values}, reverse=True))
        grid = np.array([[values[n, mu] for mu in cosines] for n in parameters])
        slopes = {"n": grid[..., 2], "theta": grid[..., 3], "theta, float32": grid[..., 4]}
        found[lobe] = Reference(lobe, parameters, cosines, grid[..., 0], grid[..., 1], slopes)
    return found
