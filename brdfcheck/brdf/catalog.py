"""Every BRDF the package knows: the validated ones, which must conserve, and the published claims, which are audited."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from brdfcheck.brdf.factors import BlinnPhongExact, Factor, Normalized, PerCosine, PhongExact
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lambert, Lyon, Phong, Schlick
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.brdf.transmission import LambertTransmission, RoughDielectric, SmoothDielectric, ThinSheet
from brdfcheck.brdf.two_sides import transmitting
from brdfcheck.messages import UnknownName, did_you_mean

_POWERS = {"n": (1.0, 1000.0)}
_INDICES = (1.1, 2.5)
_BOUNDARY = (
    "F D G / (4 (N.L)(N.V)), and through the surface (1-F) D G |L.H| |V.H| eta_o^2 / (|N.L| |N.V| (eta_i L.H + eta_o V.H)^2)"
)
_ROUGH = {"alpha": (0.05, 1.0), "eta": _INDICES}
_UP_TO_89_DEGREES = (float(np.cos(np.radians(89))), 1.0)
_OURS = "brdfcheck: maximises the minimum albedo over factors (n+A)/B with E <= 1 on n in [1, 1000], rounded to the safe side"


@dataclass(frozen=True)
class Entry:
    """A family with its formula and source. `claim` is what the source says of it (published entries only)."""

    family: Family
    formula: str
    source: str
    claim: str = ""

    @property
    def name(self) -> str:
        """The name used on the command line."""
        return self.family.name

    @property
    def validated(self) -> bool:
        """True for the BRDFs that must conserve; False for the literature's claims."""
        return not self.claim


def _entry(
    name: str,
    build: Callable[..., Any],
    ranges: Mapping,
    formula: str,
    source: str,
    claim: str = "",
    cos_theta: tuple[float, float] = (0.0, 1.0),
) -> Entry:
    return Entry(Family(name, build, ranges, cos_theta), formula, source, claim)


def _transmits(name: str, build: Callable[..., Any], ranges: Mapping, formula: str, source: str) -> Entry:
    return Entry(transmitting(Family(name, build, ranges), (0.0, 1.0)), formula, source)


def _fitted(lobe: Callable[..., Any], A: float, B: float) -> Callable[..., Any]:
    # A and B are numbers, not arrays: nothing of JAX is made when the module is imported.
    return lambda n: Normalized(lobe(n), Factor(A, B))


_MIRROR, _HALF = "mirror", "half"
_FITTED: tuple[tuple[str, Callable[..., Any], str, float, float], ...] = (
    ("blinn-phong-fitted", BlinnPhong, "(N.H)^n", 7.8025, 26.716),
    ("schlick-mirror", Schlick, "c/(n - n c + c), c = R.V", 15.531, 34.623),
    ("schlick-half", lambda n: Schlick(n, _HALF), "c/(n - n c + c), c = N.H", 38.8824, 114.0752),
    ("kuijk-blake-mirror", KuijkBlake, "piecewise quadratic in the angle between R and V", 10.685, 24.802),
    ("kuijk-blake-half", lambda n: KuijkBlake(n, _HALF), "piecewise quadratic in the angle between N and H", 33.543, 99.649),
    ("lyon-1-half", lambda n: Lyon(n, 1), "max(0, 1 - n |N-H|^2/4)^2", 4.8516, 19.5884),
    ("lyon-2-half", lambda n: Lyon(n, 2), "max(0, 1 - n |N-H|^2/8)^4", 6.0133, 22.9294),
    ("lyon-3-half", lambda n: Lyon(n, 3), "max(0, 1 - n |N-H|^2/16)^8", 6.7875, 25.0021),
    ("lyon-1-mirror", lambda n: Lyon(n, 1, _MIRROR), "max(0, 1 - n |R-V|^2/4)^2", 0.8831, 4.537),
    ("lyon-2-mirror", lambda n: Lyon(n, 2, _MIRROR), "max(0, 1 - n |R-V|^2/8)^4", 1.2137, 5.492),
    ("lyon-3-mirror", lambda n: Lyon(n, 3, _MIRROR), "max(0, 1 - n |R-V|^2/16)^8", 1.4378, 6.0846),
    ("binomial-power-half", BinomialPower, "max(0, 1 + (n/16)(N.H - 1))^16", 7.2427, 26.1702),
    (
        "binomial-power-mirror",
        lambda n: BinomialPower(n, form=_MIRROR),
        "max(0, 1 + (n/16)(R.V - 1))^16",
        1.5705,
        6.4179,
    ),
)
_PROPOSAL = "proposal of a 16th-power lobe with the factor (n+6)/24.55 (Ukrainian paper on energy-correct BRDFs)"
_COOK = "Cook & Torrance 1982; Beckmann facets, V-cavities"


def _entries() -> tuple[Entry, ...]:
    two_pi, eight_pi = 2 * np.pi, 8 * np.pi
    return (
        _entry("lambert", Lambert, {"reflectance": (0.0, 1.0)}, "k_d / pi", "Lambert 1760"),
        _entry(
            "phong", lambda n: Normalized(Phong(n), PhongExact()), {"n": (0.01, 1e5)},
            "(n+2)/(2 pi) (R.V)^n", "Phong 1975; factor Lafortune & Willems 1994",
        ),
        _entry(
            "blinn-phong", lambda n: Normalized(BlinnPhong(n), BlinnPhongExact()), {"n": (0.01, 1e5)},
            "(n+2)(n+4)/(8 pi (2^(-n/2) + n)) (N.H)^n", "Blinn 1977; factor Giesen 2009",
        ),
        *(
            _entry(name, _fitted(lobe, A, B), _POWERS, f"(n+{A:g})/{B:g} {formula}", _OURS)
            for name, lobe, formula, A, B in _FITTED
        ),
        _entry(
            "cook-torrance", lambda m: CookTorrance(m), {"m": (0.05, 1.0)},
            "F (D/pi) G / (4 (N.L)(N.V)), F = 1", f"{_COOK}; a quarter of the printed form",
        ),
        _entry(
            "beckmann-smith", lambda m: CookTorrance(m, masking="smith-separable"), {"m": (0.05, 1.0)},
            "D G1(wi) G1(wo) / (4 (N.L)(N.V))", "Beckmann facets, Smith 1967 masking, separable",
        ),
        _entry(
            "beckmann-smith-correlated", lambda m: CookTorrance(m, masking="smith-correlated"), {"m": (0.05, 1.0)},
            "D / (4 (N.L)(N.V) (1 + Lambda(wi) + Lambda(wo)))", "Beckmann facets, height-correlated Smith masking",
        ),
        _entry(
            "ggx", lambda alpha: GGX(alpha), {"alpha": (0.05, 1.0)},
            "D G / (4 (N.L)(N.V)), height-correlated", "Trowbridge & Reitz 1975, Walter et al. 2007",
        ),
        _transmits(
            "lambert-transmission",
            lambda albedo, through: LambertTransmission(albedo * (1 - through), albedo * through),
            {"albedo": (0.0, 1.0), "through": (0.0, 1.0)},
            "albedo (1 - through) / pi, and through the surface albedo through / pi", "Lambert 1760, on both sides",
        ),
        _transmits(
            "thin-sheet", lambda index, clear: ThinSheet(index, clear), {"index": (1.05, 2.5), "clear": (0.0, 1.0)},
            "R = F + T F a, T = (1-F)^2 a / (1 - F^2 a^2), a = clear^(1/cos)", "Fresnel, all reflections between two faces",
        ),
        _transmits(
            "dielectric", lambda eta: SmoothDielectric(eta), {"eta": _INDICES},
            "R = F, T = 1 - F, with total reflection", "Fresnel, unpolarised",
        ),
        _transmits(
            "rough-dielectric-beckmann", lambda alpha, eta: RoughDielectric(alpha, eta, "beckmann"), _ROUGH,
            _BOUNDARY,
            "Walter et al. 2007, Beckmann facets, Smith masking",
        ),
        _transmits(
            "rough-dielectric-ggx", lambda alpha, eta: RoughDielectric(alpha, eta, "ggx"), _ROUGH,
            _BOUNDARY,
            "Walter et al. 2007, GGX facets, Smith masking",
        ),
        _entry(
            "binomial-power-raw", lambda n: BinomialPower(n), _POWERS, "max(0, 1 + (n/16)(N.H - 1))^16", _PROPOSAL,
            "breaks the law for n in [1, 17] only",
        ),
        _entry(
            "binomial-power-published", _fitted(BinomialPower, 6.0, 24.55), _POWERS,
            "(n+6)/24.55 max(0, 1 + (n/16)(N.H - 1))^16", _PROPOSAL, "conserves for n in [1, 1000]",
        ),
        _entry(
            "binomial-power-unclamped", _fitted(lambda n: BinomialPower(n, clamped=False), 6.0, 24.55), _POWERS,
            "(n+6)/24.55 (1 + (n/16)(N.H - 1))^16", f"{_PROPOSAL}, as printed: without max(0, .)",
            "conserves for n in [1, 1000]",
        ),
        _entry(
            "blinn-phong-6", _fitted(BlinnPhong, 6.0, eight_pi), _POWERS, "(n+6)/(8 pi) (N.H)^n",
            "comparison curve of the 16th-power proposal", "conserves for n in [1, 1000]",
        ),
        _entry(
            "blinn-phong-8", _fitted(BlinnPhong, 8.0, eight_pi), _POWERS, "(n+8)/(8 pi) (N.H)^n",
            "in wide use in real-time rendering", "normalised",
        ),
        _entry(
            "blinn-phong-ndf", _fitted(BlinnPhong, 2.0, two_pi), _POWERS, "(n+2)/(2 pi) (N.H)^n",
            "common mistake: the factor of the facet distribution", "normalised",
        ),
        _entry(
            "blinn-phong-linear", _fitted(BlinnPhong, 0.0856832 / 0.0397436, 1 / 0.0397436), _POWERS,
            "(0.0397436 n + 0.0856832) (N.H)^n", "Gotanda, least-squares line", "conserves",
        ),
        _entry(
            "phong-pdf", _fitted(Phong, 1.0, two_pi), _POWERS, "(n+1)/(2 pi) (R.V)^n",
            "factor of the sampling density, which lacks the cosine", "conserves",
        ),
        _entry(
            "phong-classical", lambda n: PerCosine(Normalized(Phong(n), PhongExact())), _POWERS,
            "(n+2)/(2 pi) (R.V)^n / (N.L), up to 89 degrees", "Phong 1975 read as a BRDF: the shading term has no cosine",
            "normalised", _UP_TO_89_DEGREES,
        ),
        _entry(
            "schlick-phong-factor", _fitted(Schlick, 2.0, two_pi), _POWERS, "(n+2)/(2 pi) c/(n - n c + c), c = R.V",
            "Schlick 1994 with the factor of the power that it replaces", "stands in for the cosine power",
        ),
        _entry(
            "kuijk-blake-phong-factor", _fitted(KuijkBlake, 2.0, two_pi), _POWERS,
            "(n+2)/(2 pi) times the piecewise quadratic", "Kuijk & Blake 1989 with the factor of the power that it replaces",
            "stands in for the cosine power",
        ),
        _entry(
            "cook-torrance-published", lambda m: CookTorrance(m, convention="published"), {"m": (0.05, 1.0)},
            "F D G / (pi (N.L)(N.V)), D without its 1/pi, F = 1", _COOK, "physical reflectance",
        ),
        _entry(
            "cook-torrance-no-masking", lambda m: CookTorrance(m, masking="none"), {"m": (0.05, 1.0)},
            "F (D/pi) / (4 (N.L)(N.V)), F = 1, up to 89 degrees", "Cook & Torrance 1982 with G left out",
            "masking is a detail", _UP_TO_89_DEGREES,
        ),
    )  # fmt: skip


_CATALOG = {entry.name: entry for entry in _entries()}
_BUILT_IN = frozenset(_CATALOG)


def built_in(name: str) -> bool:
    """True for an entry of this package, False for one that was registered."""
    return name in _BUILT_IN


def register(entry: Entry) -> None:
    """Add an entry, for this process: its name is then known wherever one of the catalogue is. ValueError for a known name.

    A lobe of one's own: its class (`AbstractZonalLobe` or `AbstractMicrofacetLobe`) and
    ``register(Entry(Family("mine", Mine, {"n": (1, 1000)}), formula, source))``.
    """
    if entry.name in _CATALOG:
        raise ValueError(f"there is a BRDF {entry.name!r} already")
    _CATALOG[entry.name] = entry


def entries() -> tuple[Entry, ...]:
    """All entries: the validated ones first, then the published claims, then those that were registered."""
    return tuple(_CATALOG.values())


def names() -> tuple[str, ...]:
    """The names of all entries."""
    return tuple(_CATALOG)


def entry(name: str) -> Entry:
    """The entry of that name. UnknownName (a KeyError), with the nearest ones, where there is none."""
    try:
        return _CATALOG[name]
    except KeyError:
        hint = did_you_mean(name.lower(), names(), "'brdfcheck list' shows the names (brdfcheck.catalog.names())", most=3)
        raise UnknownName(f"unknown BRDF {name!r}; {hint}") from None


@functools.cache
def exponent_family(name: str) -> Callable[[Any], Any]:
    """n -> BRDF for an entry whose only parameter is its exponent (or slope). ValueError for other entries.

    The same callable each time: compiled programs are known by it.
    """
    return of_one_number(entry(name).family)


def of_one_number(family: Family) -> Callable[[Any], Any]:
    """number -> BRDF for a family of one parameter. ValueError for others."""
    if len(family.ranges) != 1:
        raise ValueError(f"{family.name} has {len(family.ranges)} parameters; a table needs exactly one")
    (parameter,) = family.ranges
    return lambda value: family.build(**{parameter: value})
