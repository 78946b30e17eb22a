"""The artistic models of Yokoi, Ito, Tsuruoka and Miyake: colours in [0, 1], as printed, angles by their own equations."""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.scene.lights import AbstractLight
from brdfcheck.scene.shading import AbstractMaterial, Meeting, Place, meetings
from brdfcheck.scene.vectors import SMOOTHEST, checked, color_of, power, scalar, spread

Profile = Callable[[Array], Array]
"""How bright a highlight is by the cosine of the angle between the mirror direction and the view, 1 at 1."""


def _backdrop(behind: Any) -> Array:
    array = checked(behind, "behind")
    return array if array.ndim > 1 and array.shape[0] == 3 else color_of(behind, "behind")


class AbstractHighlighted(AbstractMaterial):
    r"""A matt body with a white highlight, $C = C_1 + w \cos^n a\,(1 - C_1)$ for each light; these are Distant, Point or Spot.

    White at the centre of a full highlight, whatever lies under it.
    """

    base: Float[Array, " 3"] = eqx.field(converter=partial(color_of, name="base", high=1))
    d: Float[Array, ""] = eqx.field(converter=partial(scalar, name="d", high=1), default=0.5, kw_only=True)
    w: Float[Array, ""] = eqx.field(converter=partial(scalar, name="w", high=1), default=1.0, kw_only=True)
    n: Float[Array, ""] = eqx.field(converter=partial(scalar, name="n"), default=10.0, kw_only=True)

    @abc.abstractmethod
    def under(self, own: Float[Array, "3 ..."], place: Place) -> Float[Array, "3 ..."]:
        """C1, what lies under the highlights, from the body's own colour."""

    def color(self, lights: Sequence[AbstractLight], place: Place) -> Float[Array, "3 ..."]:
        return self.painted(lights, place, lambda cosine: power(cosine, self.n))

    def painted(self, lights: Sequence[AbstractLight], place: Place, profile: Profile) -> Float[Array, "3 ..."]:
        """The colour with another profile of the highlight. ValueError for lights without a direction."""
        found, dimensions = meetings(lights, place, type(self).__name__), len(place.shape)
        # d + (1 - d) cos theta, over several lights d + (1 - d) sum a_l cos theta_l.
        lit = sum(spread(meeting.intensity, dimensions) * (meeting.falloff * meeting.cos_light) for meeting in found)
        dark = 1 - self.under((self.d + (1 - self.d) * lit) * spread(self.base, dimensions), place)
        for meeting in found:
            share = self.w * meeting.falloff * profile(meeting.mirror_view)
            dark = dark * (1 - spread(meeting.intensity, dimensions) * share)
        return 1 - dark


@final
class Highlight(AbstractHighlighted):
    r"""Opaque with a white highlight, (4): $C = C_1 + w \cos^n a\,(1 - C_1)$, $C_1 = [d + (1-d)\cos\theta] C_0$.

    a is the angle between the mirror direction and the view. `base`: C0 in [0, 1]; d, w in [0, 1]; n >= 0. A light's
    intensity is its share a_l; with several lights the shares of the cosine add up and highlights cover one another.
    ValueError for values outside these ranges and for lights other than Distant, Point and Spot.
    """

    def under(self, own: Float[Array, "3 ..."], place: Place) -> Float[Array, "3 ..."]:
        return own


@final
class Translucent(AbstractHighlighted):
    r"""Translucent over what lies behind, (6) and (8): `Highlight` with $C_1 = (1-t) C_B + t [d + (1-d)\cos\theta] C_0$.

    $t = t_h (1 - \cos b)^{t_p}$ is the opacity, b the angle between normal and view: clearer where it faces the eye. `behind`:
    C_B, a number, RGB, or an image (3, ...) of the shape that is shaded (`over` gives it later). t_h in [0, 1], t_p >= 0;
    the rest as for `Highlight`.
    """

    behind: Float[Array, "3 ..."] = eqx.field(converter=_backdrop, default=0.0, kw_only=True)
    t_h: Float[Array, ""] = eqx.field(converter=partial(scalar, name="t_h", high=1), default=0.8, kw_only=True)
    t_p: Float[Array, ""] = eqx.field(converter=partial(scalar, name="t_p"), default=1.0, kw_only=True)

    def over(self, behind: Any) -> Translucent:
        """The same material over another background."""
        return eqx.tree_at(lambda material: material.behind, self, _backdrop(behind))

    def under(self, own: Float[Array, "3 ..."], place: Place) -> Float[Array, "3 ..."]:
        t = self.t_h * power(1 - jnp.clip(place.cos_view, 0, 1), self.t_p)
        return (1 - t) * spread(self.behind, len(place.shape)) + t * own


MetalForm = Literal["facets", "half", "mirror"]


@final
class Metal(AbstractMaterial):
    r"""Metal under several lights, $C = \{d + \sum_l a_l S_l\} C_0$; the light's intensity is a_l.

    * form "facets", (12): $S = D G / (N \cdot V)$, $D = \sum_j w_j e^{-\tan^2 a/m_j^2} / (m_j^2 \cos^4 a)$, G of V-cavities;
    * form "half", (15): $S = \sum_j w_j (N \cdot H)^{n_j}$;
    * form "mirror", (16): $S = \sum_j w_j (R \cdot V)^{n_j}$.

    `lobes`: pairs (w_j, m_j) or (w_j, n_j) for all lights, ``[(0.013, 0.2), (0.1, 0.4)]``, or one such list for each light,
    in their order. A power's base below 0 counts as 0; a light below the horizon still adds its power, as printed. With
    (14), d + sum w_j / m_j^2 near 1, the centre of the highlight shows C0.

    Raises ValueError for values outside these ranges, m below 1e-9, an unknown form, as many lists as neither one nor the
    lights, or lights other than Distant, Point and Spot.
    """

    base: Float[Array, " 3"]
    d: Float[Array, ""]
    lobes: tuple[Float[Array, "j 2"], ...]
    form: MetalForm = eqx.field(static=True)

    def __init__(self, base: Any, lobes: Any, *, d: Any = 0.05, form: MetalForm = "facets"):
        if form not in ("facets", "half", "mirror"):
            raise ValueError(f"form must be one of facets, half, mirror; got {form!r}")
        self.base, self.d, self.form = color_of(base, "base", 1), scalar(d, "d", 0, 1), form
        pairs = f"pairs of weight and {'slope' if form == 'facets' else 'exponent'}, at least one"
        try:
            single = np.ndim(lobes[0][0]) == 0
        except (TypeError, IndexError, KeyError, ValueError):
            single = True
        parts = [lobes] if single else lobes
        self.lobes = tuple(checked(part, "lobes", shapes=[(None, 2)], what=pairs) for part in parts)
        for part in self.lobes if form == "facets" else ():
            checked(part[:, 1], "the slope m", SMOOTHEST)

    def color(self, lights: Sequence[AbstractLight], place: Place) -> Float[Array, "3 ..."]:
        found, dimensions = meetings(lights, place, "Metal"), len(place.shape)
        if len(self.lobes) not in (1, len(found)):
            raise ValueError(f"a metal has lobes for all lights or for each; got {len(self.lobes)} for {len(found)} lights")
        total = self.d
        for meeting, lobes in zip(found, self.lobes * (len(found) if len(self.lobes) == 1 else 1), strict=True):
            if self.form == "facets":
                value = _facets(meeting, place, lobes)
            else:
                cosine = meeting.normal_half if self.form == "half" else meeting.mirror_view
                value = sum(weight * power(cosine, n) for weight, n in lobes)
            total = total + spread(meeting.intensity, dimensions) * (meeting.falloff * value)
        return total * spread(self.base, dimensions)


def _facets(meeting: Meeting, place: Place, lobes: Array) -> Array:
    """D G / (N.V); 1/(N.V) goes into the minimum of G, so that nothing is 0/0 at grazing angles."""
    n_h = jnp.clip(meeting.normal_half, 1e-4, 1)
    square = n_h * n_h
    tangent = (1 - square) / square
    density = sum(w * jnp.exp(-tangent / (m * m)) / (m * m) for w, m in lobes) / (square * square)
    v_h = meeting.light_half
    masked = jnp.minimum(jnp.minimum(v_h, 2 * n_h * meeting.cos_light) / place.seen, 2 * n_h) / v_h
    return density * masked
