r"""The limit of an albedo at grazing incidence, from its values at decades of the cosine.

Towards grazing, albedos behave like a + b mu^p, or they grow without bound like mu^-p or -log(mu). On decades the differences
of a + b mu^p have the constant ratio q = 10^-p: Aitken's extrapolation is exact for any p, square roots and tenth powers too.
Done twice it takes the next power along, mu beside a square root.
Where q is not small, a slow power or a + b / log(1/mu)^p, or where the differences change their sign, cosines are taken whose
logarithms double: there powers are gone, and the differences of powers of the logarithm have a constant ratio. Where q does
not stay below 1 the values are followed to cosines so small that no guard of the form max(mu, 1e-12) holds them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

# Cosines from which the limit is taken, and those at which a growth must go on to count as one without bound.
LAST_DECADES = 10.0 ** -np.arange(5.0, 12.0)
_BEYOND = 10.0 ** -np.array([12.0, 15.0, 20.0, 30.0])
# Differences of successive decades with a ratio below this have a limit; above it they grow like a logarithm or faster.
_SLOWEST = 0.93
# A ratio above this (mu^0.45) is slow. The ladder for it ends where the squares of the cosines are numbers still.
_SLOW = 0.35
# How many times the last difference may be left to go where the differences are too small to tell: for mu^0.02 it is 21.
_UNKNOWN = 25.0
_FAR = 10.0 ** -(9.375 * 2.0 ** np.arange(5))


def grazing_limit(albedo: Callable[[float], tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """The limit of `albedo` (cosine -> value, error; scalars or channels) as the cosine goes to 0, and its error.

    inf +- inf where it grows without bound; nan +- inf where the values are none.
    """
    # From the far end: mostly the last decades agree within their errors, and that is all that is needed.
    found: dict[float, tuple[np.ndarray, np.ndarray]] = {}

    def at(cosine: float) -> tuple[np.ndarray, np.ndarray]:
        if cosine not in found:
            value, error = albedo(cosine)
            found[cosine] = np.asarray(value, float), np.asarray(error, float)
        return found[cosine]

    (value, error), (before, _) = at(LAST_DECADES[-1]), at(LAST_DECADES[-3])
    with np.errstate(all="ignore"):
        change = np.abs(value - before)
    if np.all(change <= np.maximum(2 * error, 1e-14)):
        return value, error + _UNKNOWN * change
    values, errors = (np.stack(part) for part in zip(*(at(cosine) for cosine in LAST_DECADES), strict=True))
    flat, flat_errors = values.reshape(len(values), -1), errors.reshape(len(values), -1)
    pairs = [extrapolated(flat[:, i], flat_errors[:, i]) for i in range(flat.shape[1])]
    limits, bars = np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])
    rising = np.isposinf(limits)
    slow = np.array([_creeps(flat[:, i], flat_errors[:, i]) for i in range(len(limits))])
    if np.any(rising | slow):
        far, far_errors = (np.stack(part).reshape(len(_FAR), -1) for part in zip(*(at(cosine) for cosine in _FAR), strict=True))
        for i in np.flatnonzero(slow):
            limits[i], bars[i] = _creeping(far[:, i], far_errors[:, i], limits[i], bars[i])
    if np.any(rising):
        farther = [at(cosine) for cosine in _BEYOND]
        ladder = np.log10([LAST_DECADES[-1], *_BEYOND])
        for i in np.flatnonzero(rising):
            values = np.array([flat[-1, i], *(np.ravel(value)[i] for value, _ in farther)])
            bars_beyond = np.array([flat_errors[-1, i], *(np.ravel(error)[i] for _, error in farther)])
            if not _goes_on(ladder, values, bars_beyond):
                # It is held somewhere, and the last value is as near to the limit as can be told; or it grows ever more slowly.
                last = np.flatnonzero(np.isfinite(values))[-1]
                spread = np.abs(values[last] - values[max(last - 1, 0)])
                limits[i], bars[i] = _creeping(
                    far[:, i], far_errors[:, i], float(values[last]), float(bars_beyond[last] + spread)
                )
    return limits.reshape(value.shape), bars.reshape(value.shape)


def extrapolated(values: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """The limit of values at the cosines `LAST_DECADES`, with its error; inf where their differences do not shrink."""
    if not np.all(np.isfinite(values[-4:])):
        return (np.inf, np.inf) if np.any(np.isposinf(values[-4:])) else (np.nan, np.inf)
    steps = np.diff(values)
    noise = errors[1:] + errors[:-1]
    last, error = values[-1], errors[-1]
    told = np.abs(steps) > 4 * noise
    with np.errstate(all="ignore"):
        ratios = steps[1:] / steps[:-1]
    if abs(steps[-1]) <= 2 * noise[-1] or not np.all(told[-3:]):  # hardly more change than the errors allow
        known = ratios[told[1:] & told[:-1]]
        q = float(np.clip(np.max(known), 0, _SLOWEST)) if known.size else 1.0
        return last, error + abs(steps[-1]) * min(4 / max(1 - q, 1e-9), _UNKNOWN)
    if ratios[-1] <= 0 or ratios[-2] <= 0:  # it wobbles
        return last, error + float(np.max(np.abs(steps[-3:])))
    if ratios[-1] >= _SLOWEST:
        return (np.inf, np.inf) if steps[-1] > 0 else (last, np.inf)
    once, once_errors = _aitken(values, errors)
    limit, bar = once[-1], once_errors[-1] + 2 * abs(once[-1] - once[-2])
    # What is left is the next power of the cosine; where it is seen, it goes the same way. Neither what this changes nor what
    # the last decade does is a bound by itself: with a logarithm, or two powers of a size, either is small by chance.
    twice, twice_errors = _aitken(once, once_errors)
    again = twice_errors[-1] + abs(twice[-1] - limit) + abs(twice[-1] - twice[-2])
    return (twice[-1], again) if again < bar else (limit, bar)


def _creeps(values: np.ndarray, errors: np.ndarray) -> bool:
    """True where the differences of decades shrink slowly somewhere, or change their sign."""
    if not np.all(np.isfinite(values[-4:])):
        return False
    steps, told = np.diff(values), np.abs(np.diff(values)) > 4 * (errors[1:] + errors[:-1])
    with np.errstate(all="ignore"):
        slow = ~((steps[1:] / steps[:-1] > 0) & (steps[1:] / steps[:-1] < _SLOW))
    return bool(np.all(told[-2:]) and np.any(slow & told[1:] & told[:-1]))


def _creeping(values: np.ndarray, errors: np.ndarray, limit: float, bar: float) -> tuple[float, float]:
    """The limit of values on a ladder of logarithms that double, with its error; inf where they go on as before.

    `limit` +- `bar` is what the decades said, which holds where the ladder says nothing.
    """
    known = int(np.argmin(np.append(np.isfinite(values), False)))
    values, errors = values[:known], errors[:known]
    steps, noise = np.diff(values), errors[1:] + errors[:-1]
    if known == len(_FAR) and abs(steps[-1]) <= 4 * noise[-1]:  # a slow power of the cosine, or held by a guard
        return float(values[-1]), float(errors[-1] + 3 * abs(steps[-1]))
    if known < len(_FAR) - 1 or steps[-2] * steps[-1] <= 0:  # arithmetic breaks down on the way
        return limit, bar + (_UNKNOWN * abs(limit - float(values[0])) if known else 0)
    ratio = steps[-1] / steps[-2]
    if ratio >= _SLOWEST:
        return (np.inf, np.inf) if steps[-1] > 0 else (float(values[-1]), np.inf)
    once, once_errors = _aitken(values, errors)
    left = abs(once[-1] - values[-1])
    bar = once_errors[-1] + 2 * abs(once[-1] - once[-2]) + 0.2 * left
    # A power of the cosine has gone long before: each of its differences is as the square of the one before.
    last = errors[-1] + 3 * abs(steps[-1]) * ratio / (1 - ratio)
    return (float(values[-1]), float(last)) if last < bar else (float(once[-1]), float(bar))


def _aitken(values: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Aitken's extrapolation of each three successive values, and what the errors make of it; inf where it says nothing."""
    steps, noise = np.diff(values), errors[1:] + errors[:-1]
    with np.errstate(all="ignore"):
        q = steps[1:] / steps[:-1]
        limits = values[2:] + steps[1:] * q / (1 - q)
        amplified = errors[2:] * (1 + 2 * (q / (1 - q)) ** 2 + 2 / (1 - q))
        known = (q > 0) & (q < _SLOWEST) & (np.abs(steps[1:]) > 4 * noise[1:]) & np.isfinite(limits)
    return np.where(known, limits, values[2:]), np.where(known, amplified, np.inf)


def _goes_on(ladder: np.ndarray, values: np.ndarray, errors: np.ndarray) -> bool:
    """True where values on a ladder of log10(cosine) rise at each rung as fast as before, or faster."""
    if np.any(np.isposinf(values)):
        return True
    finite = np.isfinite(values)
    values, errors, ladder = values[finite], errors[finite], ladder[finite]
    if len(values) < 3:
        return False
    rates = np.diff(values) / -np.diff(ladder)
    known = np.diff(values) > 4 * (errors[1:] + errors[:-1])
    return bool(np.all(rates > 0) and rates[-1] >= 0.7 * rates[0] and known[-1])
