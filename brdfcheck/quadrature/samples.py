r"""How far a table may be trusted: its albedo by the nearest sample beside that by interpolation, over all angles.

Between samples a distance h apart a smooth f is known up to terms in $h^2$. Over an interval around a sample, with a weight w
that vanishes at the ends of the range, linear interpolation is off by $\frac{h^2}{12} \int w f''$, the nearest sample by
$-\frac{h^2}{24} \int w f'' - \frac{h^2}{12} \int w' f' = \frac{h^2}{24} \int w f''$. So to this order the albedo by linear
interpolation is off by twice its difference to that by the nearest sample. The error bar takes three times the difference.
"""

from __future__ import annotations

import numpy as np

from brdfcheck.numerics import unit_vectors
from brdfcheck.quadrature.pointwise import GRAZING, PointwiseAlbedo

TIMES = 3
"""How many times the difference of the two look-ups the error bar holds."""
# Nodes in the square root of the half angle, of which a bin of a MERL file holds eight, and in the azimuth; of an isotropic
# table and of an anisotropic one, which is asked at more places.
NODES = ((720, 180), (360, 90))


def bars(albedo: PointwiseAlbedo, cos_theta: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """How far the albedos of a table are from known at cosines and azimuths (places,), besides the error of their quadrature.

    Shape (places, channels); 0 for what is no table.
    """
    if albedo.table is None:
        return np.zeros((len(cos_theta), 1))
    return compared(albedo, cos_theta, azimuth)[2]


def compared(albedo: PointwiseAlbedo, cos_theta: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Albedos by linear and by nearest look-up, (places, channels, 2) by `albedos`, and the bar (places, channels)."""
    linear = albedos(albedo, cos_theta, azimuth)
    nearest = albedos(albedo.nearest, cos_theta, azimuth)
    difference = nearest - linear
    return linear, nearest, TIMES * np.abs(difference.mean(axis=-1)) + np.abs(difference[..., 0] - difference[..., 1])


def albedos(
    albedo: PointwiseAlbedo, cos_theta: np.ndarray, azimuth: np.ndarray, nodes: tuple[int, int] | None = None
) -> np.ndarray:
    """Albedos by a rule over the half vector, for either half of its azimuths: (places, channels, 2).

    The jumps of a table by the nearest sample lie along its half angles, where a rule over directions would not know of them.
    """
    assert albedo.evaluator is not None
    evaluate = albedo.evaluator.bind({})
    x, turn = ((np.arange(count) + 0.5) / count for count in nodes or NODES[albedo.anisotropic])
    half, turn = np.pi / 2 * x[:, None] ** 2, 2 * np.pi * turn
    normal = np.stack(np.broadcast_arrays(np.sin(half) * np.cos(turn), np.sin(half) * np.sin(turn), np.cos(half)), axis=-1)
    solid = np.sin(half) * (np.pi * x[:, None]) * (2 * np.pi / (len(x) * len(turn)))
    found = []
    for mu, phi in zip(np.maximum(cos_theta, GRAZING), azimuth, strict=True):
        wi = unit_vectors(mu, phi)
        cosine = normal @ wi
        wo = 2 * cosine[..., None] * normal - wi
        # dwo = 4 (wi.H) dH
        weight = 4 * cosine * np.broadcast_to(solid, cosine.shape) * wo[..., 2]
        lit = (cosine > 0) & (wo[..., 2] > 0)
        values = evaluate(np.broadcast_to(wi, wo.shape)[lit], wo[lit])
        values = weight[lit, None] * values.reshape(len(values), -1)
        odd = np.broadcast_to(np.arange(len(turn)) % 2 == 1, lit.shape)[lit]
        found.append(np.stack([2 * values[~odd].sum(axis=0), 2 * values[odd].sum(axis=0)], axis=-1))
        albedo.evaluations += len(values)
    return np.array(found)
