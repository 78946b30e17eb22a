"""Checks a certificate of `brdfcheck certify` for a lobe, by other formulas and another arithmetic than those that made it.

`python studies/verify_certificate.py FILE`: exit code 0 where it is proved, 1 and one line where not. Theorems: docs/proofs.md.
"""

import json
import sys
from decimal import Decimal, getcontext
from fractions import Fraction as Q
from functools import cache
from itertools import pairwise
from math import ceil, factorial, inf

UNIT, getcontext().prec = 10**120, 140


class Ball:
    """A rational number and how far the true one may be from it; exact until something irrational, or too long, comes in."""

    def __init__(self, mid, rad=Q(0)):
        if rad or Q(mid).denominator > UNIT**2:
            mid, rad = Q(round(mid * UNIT), UNIT), Q(ceil(rad * UNIT) + 1, UNIT)
        self.mid, self.rad, self.low, self.high = mid, rad, mid - rad, mid + rad

    def __add__(self, other):
        other = other if isinstance(other, Ball) else Ball(other)
        return Ball(self.mid + other.mid, self.rad + other.rad)

    def __mul__(self, other):
        other = other if isinstance(other, Ball) else Ball(other)
        return Ball(self.mid * other.mid, abs(self.mid) * other.rad + self.rad * (abs(other.mid) + other.rad))

    __radd__, __rmul__ = __add__, __mul__

    def power(self, k):
        half = self.power(k // 2) if k > 1 else Ball(1)
        return half * half * self if k % 2 else half * half


# Of atan(1/q), an alternating series, off by less than the next term; then Gauss's formula for pi.
ATANS = [Ball(sum(Q((-1) ** i, (2 * i + 1) * q ** (2 * i + 1)) for i in range(60)), Q(1, q**120)) for q in (18, 57, 239)]
PI = 48 * ATANS[0] + 32 * ATANS[1] + -20 * ATANS[2]
ROOT = Ball(Q(Decimal("0.5").sqrt()), Q(1, UNIT))
NAMES = {"constant": "reflectance/pi", "kuijk-blake": "Kuijk and Blake's lobe of {0}", "power": "({0})^n"}
NAMES |= {"schlick": "c/(n - n c + c) with c = {0}", "truncated-power": "{2}1 - n (1 - {0})/{1})^{1}"}


def need(condition, why):
    if not condition:
        raise ValueError(why)


def number(text):
    """Decimals or a quotient, as certificates write them: 1e999999999 would fill the memory."""
    need(set(text) <= set("-./0123456789") and len(text) < 999, "numbers are decimals or quotients, without exponents")
    return Q(text)


def caps(x):
    """1 - cos min(y, pi) integrated twice over y from 0 to x, over x."""
    series = (Q((-1) ** (k + 1) * x ** (2 * k + 1)) / factorial(2 * k + 2) for k in range(1, 56))
    return x + -1 * PI + (PI * PI + -4) * (1 / (2 * x)) if x > PI.low else Ball(sum(series), Q(1, UNIT))


def raw(lobe, n):
    """The albedo at normal incidence of a lobe without its factor, over pi: the integral over the cosine c from c0 to 1."""
    mirror, kind, k = lobe["form"] == "mirror", lobe["kind"], lobe.get("k")
    c0, weight, wave = (Ball(Q(0)), [0, 2], 2) if mirror else (ROOT, [0, -8, 0, 16], 4)
    if kind == "constant" or n == 0:
        return Ball(Q(1))
    if kind == "power":  # the antiderivative at 1, and at 1/sqrt 2 with u = 2^(-n/2)
        u = Ball(Q((Decimal(2).ln() * -n.numerator / (2 * n.denominator)).exp()), Q(1, UNIT))
        return Ball(2 / (n + 2)) if mirror else 16 / (n + 4) - 8 / (n + 2) + (4 / (n + 2) - 4 / (n + 4)) * u
    if kind == "kuijk-blake":  # a mixture of caps: the mean over the triangle (p, q, 0), a divided difference
        p, q = wave * (100 * n + 560) / (9 * n * n + 520 * n), wave * (10 * n + 650) / (50 * n + 317)
        return (caps(q) + -1 * caps(p)) * (1 / (q - p))
    if kind == "schlick":  # of c^j/(n - (n-1) c), by recursion from the moments of c
        parts = [Q(1, j + 1) * (1 + -1 * c0.power(j + 1)) for j in range(len(weight) + 1)]
        moments, d, x = parts[:], n - 1, n + (1 - n) * c0
        parts[0] = Ball(Q((Decimal(x.mid.numerator) / x.mid.denominator).ln()), x.rad / x.low + Q(1, UNIT)) * (1 / (d or 1))
        for j in range(len(weight) if d else 0):
            parts[j + 1] = (n * parts[j] + -1 * moments[j]) * (1 / d)
        return sum((w * part for w, part in zip(weight, parts[1:], strict=True)), Ball(0))
    rate, powers, s0 = n / k, [], 1 + n / k * (c0 + -1)
    s0 = Ball(Q(0)) if lobe["clamped"] and s0.high <= 0 else s0
    for w in reversed(weight):  # the weight as a polynomial in s = 1 - rate (1 - c), by Horner's rule
        powers = [a / rate + b * (1 - 1 / rate) for a, b in zip([0, *powers], [*powers, 0], strict=True)]
        powers[0] += w
    return sum((a / rate * Q(1, k + i + 1) * (1 + -1 * s0.power(k + i + 1)) for i, a in enumerate(powers)), Ball(0))


def check(c):
    """What the numbers of a certificate prove, in its words. ValueError where they do not."""
    need(c["lobe"]["kind"] in NAMES, f"only {', '.join(NAMES)} are checked here: try brdfcheck certify --verify")
    lobe, factor, conserves, parts = c["lobe"], c["factor"], c["verdict"] == "CONSERVES", []
    ((x, (lo, hi)),), k, clamped = c["range"].items(), lobe.get("k", 1), lobe.get("clamped", True)
    low, high, limit = number(lo), inf if hi == "inf" else number(hi), inf if clamped is True else k
    need(type(k) is int and k > 0 and (clamped is True or (clamped is False and k % 2 == 0)), "k, or whether it is clamped")
    need(0 <= low <= high and (high <= limit or not conserves), "the range, or the lobe rises with its angle")
    steady = lobe["kind"] == "power" and lobe["form"] == "mirror"  # (n + A)/(n + 2) is monotone
    lambert = lobe["kind"] == "constant" and factor == {"A": "0", "B": "1", "pi": 1}
    need(x == ("reflectance" if lambert else "n") and (lambert or lobe["kind"] != "constant"), "the parameter")
    name = NAMES[lobe["kind"]].format({"mirror": "R.V", "half": "N.H"}[lobe["form"]], k, "max(0, " if clamped else "(")
    if exact := (conserves, factor) == (True, "reciprocal of the albedo"):
        formula = f"{name}, divided by its albedo at normal incidence,"
        parts = [f"at most 1 for every n from {lo} to {hi} at every angle of incidence, and 1 at normal incidence"]
    else:
        A, slope = number(factor.get("constant") or factor["A"]), "constant" not in factor
        scale = {1: Ball(Q(1)), 0: PI}[factor.get("pi", 0)] * (1 / number(factor.get("B", "1")))
        need(scale.low > 0, "B must be positive")
        gain, at, albedo = (lambda n: slope * n + A), cache(lambda n: raw(lobe, n)), lambda n: scale * gain(n) * at(n)
        form = ("(n + {A})/({B} pi)" if factor["pi"] else "(n + {A})/{B}") if slope else "{constant}"
        formula = name if lambert else f"{form.format(**factor)} {name}"
    for piece in [] if exact else c["cover"]:
        below, place = {"at most 1": (True, "every angle of"), "above 1": (False, "normal")}[piece["albedo"]]
        nodes, onwards = [number(n) for n in piece["nodes"]], {True: True, False: False}[piece["onwards"]]
        need(all(v.high <= 1 if below else v.low > 1 for v in map(albedo, nodes)), "a node is on the other side of 1")
        for a, b in pairwise(nodes):  # below its chord, above the chords of the halves prolonged: raw albedos are convex in n
            e, f, g = map(at, (a, (a + b) / 2, b))
            mixed = (gain(a) * g.high + gain(b) * e.high) / 2 * scale.high  # of Bernstein's coefficients the one not at an end
            least = min(gain(a) * (2 * f + -1 * g).low, gain(b) * (2 * f + -1 * e).low, gain((a + b) / 2) * f.low) * scale.low
            need(a < b and (steady or (mixed <= 1 if below else least > 1)), f"the box from {a} to {b} is not shown")
        # Onwards: all falls; the limit; (m + 2)(m + 4) >= 8 s (m + A)(m + u) with (m + A) u falling; the weight peaks at c = 1.
        n, s, peak = nodes[-1], scale.high, Q(k, k + 1) * (2 if lobe["form"] == "mirror" else 8)
        power = 2 * s <= 1 if steady else n + A >= 3 and 8 * s <= 1 and 2 * n + 6 >= 8 * s * (2 * n + A)
        tails = {"power": power, "truncated-power": clamped and n > 0 and s * peak * max(1 + A / (n or 1), 1) <= 1}
        end, last = (high, hi) if onwards else (nodes[-1], piece["nodes"][-1])
        need(not onwards or (below and (tails.get(lobe["kind"]) if slope else clamped)), f"past {nodes[-1]} it is not shown")
        need(low <= nodes[0] and nodes[-1] <= end <= high and (end <= limit or not below), "the boxes are out of range")
        parts.append(f"{piece['albedo']} for every {x} from {piece['nodes'][0]} to {last} at {place} incidence")
    covered = len(parts) == 1 and parts[0].startswith(f"at most 1 for every {x} from {lo} to {hi} at")
    if not conserves:
        (least, most), n = c["point"]["albedo"], number(c["point"][x])
        ball = albedo(n)
        need(1 < number(least) <= ball.low <= ball.high <= number(most) and low <= n <= high, "the point")
        parts.insert(0, f"in [{least}, {most}] for {x} = {c['point'][x]} at normal incidence")
    proved = {"schema": "brdfcheck-certificate", "schema_version": 1, "verdict": "CONSERVES" if conserves else "VIOLATES"}
    proved |= {"formula": formula, "theorems": ["normal incidence"] + ["convex in n"] * (not exact)}
    proved["statement"] = f"The directional albedo of {formula} is {'; it is '.join(parts)}."
    need({key: c[key] for key in proved} == proved and (covered or not conserves), f"proved is: {proved}")
    return f"{proved['verdict']}: {proved['statement']}"


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as file:
        try:
            print("proved:", check(json.load(file)))
        except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
            sys.exit(f"rejected: {type(error).__name__}: {error}")
