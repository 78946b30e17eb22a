"""A loaded plug-in of Mitsuba: its numbers, and its value, density and samples at arrays of directions.

Mitsuba's `eval` holds the cosine at the light. Light is taken in its importance mode, in which what is transmitted carries no
factor for the narrowing of beams: R + T is then the energy, R + (eta_t / eta_i)^2 T of the radiance mode.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from brdfcheck.brdf.readers.mitsuba.runtime import LOCK, mitsuba_module

_SIDES = np.array([1.0, 1.0, -1.0])


class PlugIn:
    """A BSDF of Mitsuba, of which one set of numbers is in place at a time.

    `transmits`: light gets through; `deltas`: parts of it are mirrors, clear panes or holes, which `eval` leaves out.
    """

    def __init__(self, bsdf: Any):
        mitsuba = mitsuba_module()
        self._mitsuba, self._bsdf = mitsuba, bsdf
        self.knobs = mitsuba.traverse(bsdf)
        self._values: dict[str, Any] = {}
        self._scalar = mitsuba.variant().startswith("scalar")
        self._energy = mitsuba.BSDFContext(mitsuba.TransportMode.Importance)
        flags = mitsuba.BSDFFlags
        mirrors = int(flags.DeltaReflection) | int(flags.DeltaTransmission)
        every = [int(bsdf.flags(index)) for index in range(bsdf.component_count())]
        # What goes straight through has a method of its own: masks do not sample it as a component.
        self._open = any(kind & int(flags.Null) for kind in every)
        self.transmits = self._open or bool(mitsuba.has_flag(bsdf.flags(), flags.Transmission))
        self.deltas = any(kind & int(flags.Delta) for kind in every)
        # Samples and their density, of all that is no delta.
        self._smooth = mitsuba.BSDFContext()
        if any(kind & mirrors for kind in every):
            self._smooth.type_mask = int(flags.All) & ~int(flags.Delta)
        self._delta_contexts = []
        for index in (index for index, kind in enumerate(every) if kind & mirrors):
            context = mitsuba.BSDFContext(mitsuba.TransportMode.Importance)
            context.component = index
            self._delta_contexts.append(context)

    def put(self, values: Mapping[str, Any]) -> None:
        """Put numbers in place: a float, or three for a colour, by the key of `knobs`."""
        changed = {key: value for key, value in values.items() if self._values.get(key) != value}
        if not changed:
            return
        for key, value in changed.items():
            self.knobs[key] = list(value) if isinstance(value, tuple) else value
            self._values[key] = value
        self.knobs.update()

    def cosine_values(self, wi: np.ndarray, wo: np.ndarray, channels: int) -> np.ndarray:
        """f |cos theta_o|, without deltas, of the first channels: (k, 3) twice -> (k, channels), float32."""
        return self._each(lambda surface, out: self._bsdf.eval(self._energy, surface, out), wi, wo, channels)

    def radiance_values(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """`cosine_values` as a path tracer sees them, which samples: in the radiance mode."""
        return self._each(lambda surface, out: self._bsdf.eval(self._smooth, surface, out), wi, wo, 3)

    def density(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """The density in 1/sr with which wo is sampled, deltas left out: (k, 3) twice -> (k,), float32."""
        return self._each(lambda surface, out: self._bsdf.pdf(self._smooth, surface, out), wi, wo, 0)[:, 0]

    def delta_weight(self, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What all deltas reflect, and what they transmit: (k, 3) -> (k, 3) twice."""
        unique, back = np.unique(wi, axis=0, return_inverse=True)
        found = np.zeros((2, len(unique), 3))
        middle = np.full((len(unique), 3), 0.5)
        for context in self._delta_contexts:
            out, weight, _ = self._sampled(context, unique, middle)
            through = out[:, 2] * unique[:, 2] < 0
            weight = np.where(np.isfinite(out).all(axis=1, keepdims=True), weight, 0)
            found[0, ~through] += weight[~through]
            found[1, through] += weight[through]
        if self._open:
            through = self._each(lambda surface, _: self._bsdf.eval_null_transmission(surface), unique, unique, 3)
            found[1] += through
        return found[0][back.ravel()], found[1][back.ravel()]

    def samples(self, wi: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Directions sampled for three uniform numbers each, their weights and densities: (k, 3), (k, 3), (k,)."""
        return self._sampled(self._smooth, wi, numbers)

    def _sampled(self, context: Any, wi: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mitsuba = self._mitsuba
        if not self._scalar:
            one, two = self._floats(numbers[:, 0]), mitsuba.Point2f(self._floats(numbers[:, 1]), self._floats(numbers[:, 2]))
            sample, weight = self._bsdf.sample(context, self._surface(wi), one, two)
            parts = (sample.wo, weight, sample.pdf)
            out, weight, pdf = (np.array(part, float).reshape(-1, len(numbers) if np.size(part) > 3 else 1) for part in parts)
            out, weight, pdf = (np.broadcast_to(part, (len(part), len(numbers))) for part in (out, weight, pdf))
            return out.T, weight.T, pdf[0]
        rows = []
        for light, (first, second, third) in zip(wi, numbers.tolist(), strict=True):
            sample, weight = self._bsdf.sample(context, self._surface(light), first, [second, third])
            rows.append((*sample.wo, *weight, sample.pdf))
        found = np.array(rows, float)
        return found[:, :3], found[:, 3:6], found[:, 6]

    def _floats(self, values: np.ndarray) -> Any:
        return self._mitsuba.Float(np.ascontiguousarray(values, np.float32))

    def _surface(self, wi: np.ndarray) -> Any:
        """A flat piece of surface seen from wi: one direction in the scalar variant, else (k, 3)."""
        mitsuba = self._mitsuba
        surface = mitsuba.SurfaceInteraction3f()
        surface.sh_frame = mitsuba.Frame3f([0, 0, 1])
        surface.n = [0, 0, 1]
        surface.t = 1.0
        surface.dp_du, surface.dp_dv = [1, 0, 0], [0, 1, 0]
        surface.wi = wi.tolist() if wi.ndim == 1 else mitsuba.Vector3f(*(self._floats(part) for part in wi.T))
        return surface

    def _each(self, call: Any, wi: np.ndarray, wo: np.ndarray, channels: int) -> np.ndarray:
        """What a call gives for each direction, (k, channels): the first channels of a colour, or a number (0 channels)."""
        count = len(wo)
        if not self._scalar:
            out = self._mitsuba.Vector3f(*(self._floats(part) for part in wo.T))
            found = np.array(call(self._surface(wi), out), np.float32)
            found = found.reshape(3 if channels else 1, -1)[: channels or 1]
            return np.broadcast_to(found, (len(found), count)).T
        found = np.empty((count, channels or 1), np.float32)
        # Lights mostly come in runs of the same.
        changes = np.flatnonzero(np.any(wi[1:] != wi[:-1], axis=1)) + 1
        for start, end in pairwise([0, *changes.tolist(), count]):
            surface = self._surface(wi[start])
            values = [call(surface, out) for out in wo[start:end].tolist()]
            if channels:
                for channel in range(channels):
                    found[start:end, channel] = [value[channel] for value in values]
            else:
                found[start:end, 0] = values
        return found


class PlugInBRDF:
    """f(wi, wo) of a plug-in with numbers in place, in single precision; what is transmitted is folded up, deltas are spread.

    wi is where the surface is seen from. `below`: from inside. `whole`: with what is transmitted, at the mirror image of its
    direction in the surface, and with the deltas as a matte reflection of the same albedo: its albedo is the plug-in's.
    Otherwise only what is reflected smoothly, which is what reciprocity is about. Returns (k,) for `channels` 1, else (k, 3).
    """

    def __init__(self, plugin: PlugIn, values: Mapping[str, Any], channels: int, *, below: bool = False, whole: bool = True):
        self.plugin, self._values, self._channels = plugin, dict(values), channels
        self._side, self._whole = (_SIDES if below else np.ones(3)), whole
        self.transmits, self.mirrors = plugin.transmits, plugin.deltas

    def __call__(self, wi: Any, wo: Any) -> np.ndarray:
        wi, wo = np.broadcast_arrays(np.asarray(wi, float), np.asarray(wo, float))
        lit = wo[:, 2] > 0
        with LOCK:
            self.plugin.put(self._values)
            light = wi * self._side
            flux = np.array(self.plugin.cosine_values(light, wo * self._side, self._channels), float)
            if self._whole and self.plugin.transmits:
                flux += self.plugin.cosine_values(light, wo * self._side * _SIDES, self._channels)
            values = np.where(lit[:, None], flux / np.where(lit, wo[:, 2], 1)[:, None], 0)
            if self._whole and self.plugin.deltas:
                values += np.add(*self.plugin.delta_weight(light))[:, : self._channels] / np.pi
        values = values.astype(np.float32)
        return values[:, 0] if self._channels == 1 else values

    def density(self, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        """The density of sampling wo, above and below the surface: (k, 3) twice -> (k,), in 1/sr."""
        with LOCK:
            self.plugin.put(self._values)
            return self.plugin.density(wi * self._side, wo * self._side)

    def samples(self, wi: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """For wi (k, 3) and uniform numbers (k, 3): directions, weights, densities, and f |cos| there: (k, 3) but (k,)."""
        with LOCK:
            self.plugin.put(self._values)
            out, weight, _ = self.plugin.samples(wi * self._side, numbers)
            safe = np.where(np.isfinite(out), out, 0.0)
            return (
                safe * self._side,
                weight,
                self.plugin.density(wi * self._side, safe),
                self.plugin.radiance_values(wi * self._side, safe),
            )

    def deltas(self, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the deltas reflect and transmit: (k, 3) -> (k, 3) twice."""
        with LOCK:
            self.plugin.put(self._values)
            return self.plugin.delta_weight(wi * self._side)
