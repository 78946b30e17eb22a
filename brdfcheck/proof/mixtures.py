r"""Certificates of sums: made of the certificates of the parts.

With weights $w_j \ge 0$ that add up to at most 1 at every incidence, $E = \sum_j w_j E_j \le 1$ if every $E_j \le 1$. In a
Fresnel blend $\min(F_i, F_o) \le F_i$ and $1 - \max(F_i, F_o) \le 1 - F_i$, which depend on the incidence alone and sum to 1.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.mixtures import FresnelBlend, Mixture
from brdfcheck.proof.certificate import CONSERVES, Certificate, Ends, document, over, range_record
from brdfcheck.proof.cover import NotProved, written
from brdfcheck.proof.reading import Unknown, exact, from_symbols
from brdfcheck.proof.terms import Terms, corners, terms_of, words

KINDS = ("mixture", "fresnel blend")


def certificate(family: Family, ends: Mapping[str, Ends], prove: Callable[[Family], Certificate]) -> Certificate | None:
    """The certificate of a sum over `ends`, by `prove` for its parts; None for anything else.

    Unknown where a weight is not a number, where weights add up to more than 1, or where a part is not proved to conserve.
    """
    names = tuple(family.ranges)
    try:
        brdf, jaxpr = from_symbols(family, jax.tree.leaves)
    except (Exception, SystemExit):  # whatever a user's factory throws; who reads formulas says what is wrong
        return None
    if type(brdf) not in (Mixture, FresnelBlend):
        return None
    reached = _reached(jaxpr, names) if names else []
    sizes = [len(jax.tree.leaves(part)) for part in _parts(brdf)]
    parts = []
    for j, start in enumerate(np.cumsum([0, *sizes[:-1]])):
        own = set().union(*reached[start : start + sizes[j]])
        parts.append(prove(_part(family, j, {name: bounds for name, bounds in family.ranges.items() if name in own})))
    if type(brdf) is Mixture:
        if isinstance(brdf.weights, Tracer):
            weights: list[Any] = terms_of(family, "a weight", lambda mixture: mixture.weights)
            weights = [weight.get("", "0") if set(weight) <= {""} else weight for weight in weights]
        else:
            weights = [written(exact(w, "a weight")) for w in np.asarray(brdf.weights)]
        lobe: dict[str, Any] = {"kind": "mixture", "weights": weights}
    else:
        fixed = not isinstance(brdf.f0, Tracer)
        if not fixed and not _is_input(jaxpr, jaxpr.outvars[sum(sizes)], names):
            raise Unknown(f"{family.name}: f0 does not go into FresnelBlend as it is")
        lobe = {"kind": "fresnel blend", "f0": written(exact(brdf.f0, "f0")) if fixed else "f0"}
    return assembled(lobe, [part.record for part in parts], {name: ends[name] for name in names})


def _parts(brdf: Any) -> Sequence[Any]:
    return brdf.parts if isinstance(brdf, Mixture) else (brdf.coat, brdf.base)


def _part(family: Family, j: int, ranges: Mapping[str, tuple[float, float]]) -> Family:
    """The part of this number as a family over the parameters that it depends on."""
    others = {name: low for name, (low, _) in family.ranges.items() if name not in ranges}

    def build(**values: Any) -> Any:
        return _parts(family.build(**others, **values))[j]

    return dataclasses.replace(family, name=f"part {j + 1} of {family.name}", build=build, ranges=dict(ranges))


def _reached(jaxpr: Any, names: Sequence[str]) -> list[set[str]]:
    """For each result of a jaxpr, the parameters that it is made of."""
    of: dict[Any, set[str]] = {variable: {name} for variable, name in zip(jaxpr.invars, names, strict=True)}

    def known(atom: Any) -> set[str]:
        return set() if hasattr(atom, "val") else of.get(atom, set())

    for equation in jaxpr.eqns:
        found = set().union(*map(known, equation.invars))
        of.update((variable, found) for variable in equation.outvars)
    return [known(atom) for atom in jaxpr.outvars]


def _is_input(jaxpr: Any, variable: Any, names: Sequence[str]) -> bool:
    """Is it the parameter f0, converted at most?"""
    makers = {out: equation for equation in jaxpr.eqns for out in equation.outvars}
    while variable in makers and makers[variable].primitive.name == "convert_element_type":
        variable = makers[variable].invars[0]
    return "f0" in names and variable is jaxpr.invars[list(names).index("f0")]


def assembled(lobe: Mapping[str, Any], parts: Sequence[Mapping[str, Any]], ranges: Mapping[str, Ends]) -> Certificate:
    """The certificate of a sum from those of its parts, which have been checked. NotProved where it does not follow."""
    for part in parts:
        if part["verdict"] != CONSERVES:
            raise NotProved(f"a part does not conserve, which says nothing of the sum: {part['statement']}")
    formulas = [_formula(part, range_record(ranges)) for part in parts]
    if lobe["kind"] == "mixture":
        weights: list[Terms] = [{"": weight} if isinstance(weight, str) else weight for weight in lobe["weights"]]
        least = min(value for weight in weights for _, value in corners("weight", [weight], ranges))
        most = max(value for _, value in corners("sum of weights", weights, ranges))
        shown = [words(weight) for weight in weights]
        if len(weights) != len(parts) or least < 0 or most > 1:
            raise NotProved(f"the weights of a mixture must be >= 0 and add up to at most 1; got {', '.join(shown)}")
        shown = [text if " " not in text else f"({text})" for text in shown]
        formula = " + ".join(f"{weight} [{part}]" for weight, part in zip(shown, formulas, strict=True))
        theorem = "mixture"
    else:
        low, high = ranges["f0"] if lobe["f0"] == "f0" else (Fraction(lobe["f0"]),) * 2
        if low < 0 or high is None or high > 1:
            raise NotProved("f0 must be from 0 to 1")
        coat, base = formulas
        formula = f"min(F(L), F(V)) [{coat}] + (1 - max(F(L), F(V))) [{base}] with Schlick's F"
        formula += " of every f0" if lobe["f0"] == "f0" else f" of f0 = {lobe['f0']}"
        theorem = "Fresnel blend"
    return document(
        CONSERVES,
        f"The directional albedo of {formula} is at most 1 for {over(ranges)} at every angle of incidence.",
        formula=formula,
        lobe=dict(lobe),
        range=range_record(ranges),
        theorems=[theorem],
        parts=[{key: value for key, value in part.items() if key != "versions"} for part in parts],
    )


def _formula(part: Mapping[str, Any], ranges: Mapping[str, list[str]]) -> str:
    """The formula of a part with what it holds fixed. NotProved where a parameter of the sum has another range in it."""
    held = []
    for name, (low, high) in part["range"].items():
        if ranges.get(name) != [low, high]:
            if low != high:
                raise NotProved(f"a part is proved over another range of {name}")
            held.append(f"{name} = {low}")
    return part["formula"] + f" with {', '.join(held)}" * bool(held)
