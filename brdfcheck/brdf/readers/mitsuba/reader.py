"""A plug-in of Mitsuba as a family of BRDFs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.readers.base import AbstractFile
from brdfcheck.brdf.readers.glsl.kinds import FLOAT, Vector
from brdfcheck.brdf.readers.glsl.knobs import Knob, Settings, names_of, settle
from brdfcheck.brdf.readers.mitsuba.plugin import PlugIn, PlugInBRDF
from brdfcheck.brdf.readers.mitsuba.runtime import variant
from brdfcheck.brdf.readers.mitsuba.sources import find
from brdfcheck.brdf.two_sides import BELOW
from brdfcheck.brdf.ways import sample
from brdfcheck.messages import UsageError

TOLERANCE = 1e-5
"""How far above 1 an albedo may lie that is computed in single precision."""
_COLOUR = Vector("float", 3)
_WHITE = (1.0, 1.0, 1.0)
_COLOURS = ("reflectance", "transmittance", "color")


def _is_colour(name: str) -> bool:
    return name.endswith(_COLOURS)


class PlugInFile(AbstractFile):
    """A plug-in that has been loaded. UsageError where there is none of that name, or Mitsuba is not installed.

    Its parameters are the numbers and colours that Mitsuba's `traverse` shows, without the ``.value`` at their end; what is not
    given is as the plug-in has it, but colours that nobody gave are white.
    """

    def __init__(self, spec: str):
        self._source = find(spec.partition(":")[2])
        self.spec, self.files = self._source.spec, self._source.files
        self.path = self.files[0] if self.files else self.spec
        self._knobs, self._keys = self._seen(self._loaded({}))
        self.names = (*names_of(self._knobs), BELOW)

    def _loaded(self, more: Mapping[str, Any]) -> PlugIn:
        """The plug-in with colours in place of the greys that nobody gave."""
        plain = PlugIn(self._source.load(more))
        if self.files:
            return plain
        colours = {}
        for key in plain.knobs.keys():  # noqa: SIM118 (Mitsuba's parameters are no dictionary)
            name = key.removesuffix(".value")
            if _is_colour(name) and "." not in name:
                colours[name] = {"type": "rgb", "value": list(_WHITE)}
        # What the user gave stays: it comes after these.
        return PlugIn(self._source.load({**colours, **more})) if colours else plain

    def _seen(self, plugin: PlugIn) -> tuple[list[Knob], dict[str, str]]:
        """The parameters, and by their names Mitsuba's keys for them."""
        knobs: list[Knob] = []
        keys: dict[str, str] = {}
        for key in plugin.knobs.keys():  # noqa: SIM118
            value = plugin.knobs[key]
            name = key.removesuffix(".value")
            if isinstance(value, (bool, int, str)):
                continue
            try:
                numbers = tuple(np.array(value, float).ravel().tolist())
            except (TypeError, ValueError):
                continue
            kind = type(value).__name__
            if kind.startswith("Color3") and len(numbers) == 3:
                knobs.append(Knob(name, _COLOUR, default=numbers))
            elif kind.lower() == "float" and len(numbers) == 1:
                knobs.append(Knob(name, FLOAT, default=numbers))
            else:  # textures and transformations
                continue
            keys[name] = key
        return knobs, keys

    def family(
        self, ranges: Mapping[str, Any], cos_theta: tuple[float, float] | None, no_parameter: Callable[..., str]
    ) -> Family:
        """The family over these ranges. UsageError where they do not belong to it."""
        own = {name: bounds for name, bounds in ranges.items() if name != BELOW}
        known = names_of(self._knobs)
        for name in own:
            if name not in known:
                raise UsageError(no_parameter(self.spec, name, [knob.name for knob in self._knobs]))
        plugin, knobs, keys = self._switched_on(own)
        if plugin.transmits:
            knobs = [*knobs, Knob(BELOW, FLOAT, bounds=(0.0, 1.0))]
        elif BELOW in ranges:
            raise UsageError(f"{self.spec} transmits nothing: light comes from above only, without --over {BELOW}=...")
        settings = settle(knobs, dict(ranges), self.spec, no_parameter)
        if settings.shown.get(BELOW, 0.0) not in (0.0, 1.0) or settings.ranges.get(BELOW, (0.0, 1.0)) != (0.0, 1.0):
            raise UsageError(f"{self.spec}: {BELOW} is 0 (light from above), 1 (from below) or 0:1 (both)")
        if BELOW in settings.ranges:
            settings.switches.add(BELOW)

        def made(numbers: Mapping[str, Any], *, whole: bool, channels: int) -> PlugInBRDF:
            values = {knob.name: settings.values(knob, numbers) for knob in knobs}
            below = float(values.pop(BELOW, 0.0)) >= 0.5
            put = {
                keys[name]: tuple(map(float, value)) if isinstance(value, tuple) else float(value)
                for name, value in values.items()
            }
            return PlugInBRDF(plugin, put, channels, below=below, whole=whole)

        middle = {name: 0.5 * low + 0.5 * high for name, (low, high) in settings.ranges.items()}
        channels = 1 if _is_grey(made(middle, whole=True, channels=3), knobs, settings) else 3

        def build(**numbers: Any) -> PlugInBRDF:
            return made(numbers, whole=True, channels=channels)

        def reflected(**numbers: Any) -> PlugInBRDF:
            return made(numbers, whole=False, channels=channels)

        build.__name__ = reflected.__name__ = self._source.name
        told = {name: value for name, value in settings.shown.items() if _is_colour(name.partition(".")[0]) or name in ranges}
        return Family(
            self.spec,
            build,
            settings.ranges,
            (0.0, 1.0) if cos_theta is None else cos_theta,
            told,
            switches=frozenset(settings.switches),
            defaults=settings.defaults,
            pointwise=reflected if plugin.transmits or plugin.deltas else None,
            tolerance=TOLERANCE,
            notes=(f"Mitsuba's {variant()[0]}: single precision",),
        )

    def _switched_on(self, own: Mapping[str, Any]) -> tuple[PlugIn, list[Knob], dict[str, str]]:
        """The plug-in with the parts that these parameters ask for: it may leave out what its properties give as 0."""
        given = {name: 0.5 * float(bounds[0]) + 0.5 * float(bounds[1]) for name, bounds in own.items() if len(bounds) == 2}
        given = {name: value for name, value in given.items() if value and "." not in name and not _is_colour(name)}
        try:
            plugin = self._loaded(given)
        except UsageError:  # a parameter that is no property of that name: `traverse` alone knows it
            plugin = self._loaded({})
        knobs, keys = self._seen(plugin)
        before = {knob.name for knob in self._knobs}
        if before - set(keys):  # other properties, other parameters
            plugin = self._loaded({})
            knobs, keys = self._seen(plugin)
        return plugin, [knob for knob in knobs if knob.name in before], keys


def _is_grey(brdf: PlugInBRDF, knobs: list[Knob], settings: Settings) -> bool:
    """True where no colour has components that differ, and what else is coloured, as a texture, does not show at directions."""
    for knob in knobs:
        if isinstance(knob.type, Vector) and len(set(settings.parts[knob.name])) > 1:
            return False
    values = brdf(*sample())
    return bool(np.all(values == values[:, :1]))
