"""Where a plug-in comes from: a name, a dictionary in JSON, or an element of a scene file."""

from __future__ import annotations

import json
import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from brdfcheck.brdf.readers.mitsuba.runtime import mitsuba_module
from brdfcheck.folders import readable
from brdfcheck.messages import UsageError, one_line

# What Mitsuba puts before its messages: the place in its own source.
_OWN_SOURCE = re.compile(r"\[\w+\.(?:cpp|h):\d+\]\s*")
_NAME = re.compile(r"[A-Za-z][\w-]*")
# How deep elements may refer to others, and how many files a scene may include.
_DEEPEST, _MOST_FILES = 32, 100
_PARAMETER = re.compile(r"\$\w+")
_METALS = ("conductor", "roughconductor")


@dataclass(frozen=True)
class Source:
    """A plug-in that can be loaded, perhaps several times. `spec`: its full name; `load`: with these properties besides.

    `files`: the scene and what it includes, empty where it is none.
    """

    spec: str
    name: str
    load: Callable[[Mapping[str, Any]], Any]
    files: tuple[str, ...] = ()


def find(words: str) -> Source:
    """What ``NAME``, ``{...}`` or ``FILE.xml#ID`` stands for. UsageError where it is none of them, or cannot be read."""
    spec = f"mitsuba:{words}"
    if words.lstrip().startswith("{"):
        return _of_json(words, spec)
    path, _, identity = words.partition("#")
    if path.lower().endswith(".xml"):
        return _of_file(path, identity or None)
    if not _NAME.fullmatch(words):
        raise UsageError(
            f"{one_line(spec)!r}: give the name of a plug-in, as in mitsuba:principled, an element of a scene file,"
            ' mitsuba:FILE.xml#ID, or a dictionary, mitsuba:{"type": "principled", "roughness": 0.3}'
        )
    return Source(spec, words, lambda more: loaded({"type": words, **_usual(words, more), **more}, spec))


def loaded(properties: dict[str, Any], spec: str) -> Any:
    """The BSDF that Mitsuba makes of a dictionary. UsageError where it refuses it."""
    return _bsdf(lambda mitsuba: mitsuba.load_dict(properties), spec)


def _bsdf(load: Callable[[Any], Any], spec: str) -> Any:
    mitsuba = mitsuba_module()
    try:
        found = load(mitsuba)
    except Exception as error:  # whatever a plug-in throws: it is about what the user wrote
        message = one_line(_OWN_SOURCE.sub("", str(error))).rstrip(": ")
        raise UsageError(f"{one_line(spec)}: Mitsuba says: {message}") from None
    if not isinstance(found, mitsuba.BSDF):
        raise UsageError(f"{one_line(spec)}: this is a {type(found).__name__}, not a BSDF of Mitsuba")
    return found


def _usual(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """What a plug-in is where nothing is said: a metal reflects everything."""
    fresnel = any(key in given for key in ("material", "eta", "k"))
    return {"material": "none"} if name in _METALS and not fresnel else {}


def _of_json(text: str, spec: str) -> Source:
    try:
        content = json.loads(text, parse_int=float)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{one_line(spec)}: this is not JSON: {one_line(error)}") from None
    kind = content.get("type") if isinstance(content, dict) else None
    if not isinstance(kind, str) or not kind:
        raise UsageError(f'{one_line(spec)}: the dictionary must name its plug-in, as in {{"type": "principled"}}')
    given = {key: _property(value) for key, value in content.items()}
    return Source(spec, kind, lambda more: loaded({**_usual(kind, given), **more, **given}, spec))


def _property(value: Any) -> Any:
    """Three numbers are a colour; what else there is, Mitsuba judges."""
    if isinstance(value, list):
        return {"type": "rgb", "value": value}
    if isinstance(value, dict) and value.get("type") != "rgb":
        return {key: _property(part) for key, part in value.items()}
    return value


@dataclass
class _Scene:
    """A scene file as it is read, from top to bottom: like Mitsuba, what is said below has no effect above."""

    files: list[str]
    parameters: dict[str, str]
    named: dict[str, Any]

    def read(self, path: str) -> Any:
        """The root of a file, its parameters in place, its includes put in. UsageError."""
        self.files.append(path)
        if len(self.files) > _MOST_FILES:
            raise UsageError(f"{one_line(self.files[0])}: it includes itself, or more than {_MOST_FILES} files")
        with readable(path, "a scene file"):
            try:
                root = ElementTree.parse(path).getroot()
            except (ElementTree.ParseError, LookupError) as error:  # a LookupError: an encoding that Python does not know
                raise UsageError(f"{one_line(path)}: this is not XML: {one_line(error)}") from None
        return self._filled_in(root, path)

    def _filled_in(self, element: Any, path: str) -> Any:
        for key, text in element.attrib.items():
            for name in sorted(self.parameters, key=len, reverse=True) if "$" in text else ():
                text = text.replace(f"${name}", self.parameters[name])
            element.set(key, text)
        name = element.get("id", "")
        if element.tag == "default":
            self.parameters.setdefault(element.get("name", ""), element.get("value", ""))
        elif element.tag == "alias":
            if name not in self.named:
                raise UsageError(f"{one_line(path)}: there is nothing with the id {one_line(name)!r} above its <alias>")
            self.named[element.get("as", "")] = self.named[name]
        elif name and element.tag != "ref":
            self.named[name] = element
        parts: list[Any] = []
        for part in element:
            self._filled_in(part, path)
            parts += self.read(self._found(part.get("filename", ""), path)) if part.tag == "include" else [part]
        element[:] = parts
        return element

    def _found(self, name: str, path: str) -> str:
        """An included file, looked for beside the file that includes it, and beside the scene."""
        places = [os.path.join(os.path.dirname(place), name) for place in (path, self.files[0])]
        return next((place for place in places if os.path.exists(place)), places[0])


def _of_file(path: str, identity: str | None) -> Source:
    scene = _Scene([], {}, {})
    root, named = scene.read(path), scene.named
    materials = {name: element for name, element in named.items() if element.tag == "bsdf"}
    if identity is not None:
        element = materials.get(identity)
    else:
        one = len(set(map(id, materials.values()))) == 1  # whatever its aliases
        element = root if root.tag == "bsdf" else next(iter(materials.values())) if one else None
    if element is None:
        choices = f"it has {', '.join(map(one_line, materials))}" if materials else "it has no <bsdf> with an id"
        what = "say which <bsdf> is meant, as in FILE.xml#ID" if identity is None else f"there is no <bsdf id={identity!r}>"
        raise UsageError(f"{one_line(path)}: {one_line(what)}; {choices}")
    identity = identity or element.get("id")
    spec = f"mitsuba:{path}" + (f"#{identity}" if identity else "")
    whole = _resolved(element, named, path, 0)
    whole.set("version", root.get("version", "3.0.0"))
    for part in whole.iter():
        if unknown := next((found[0] for text in part.attrib.values() if (found := _PARAMETER.search(text))), None):
            raise UsageError(
                f'{one_line(spec)}: {unknown} has no value: write <default name="{unknown[1:]}" value="..."/> above'
            )
    text = ElementTree.tostring(whole, encoding="unicode")
    folders = list(dict.fromkeys(os.path.dirname(os.path.abspath(file)) for file in scene.files))

    def load(more: Mapping[str, Any]) -> Any:
        del more  # what a file says holds

        def of_text(mitsuba: Any) -> Any:
            for folder in folders:
                mitsuba.file_resolver().append(folder)
            return mitsuba.load_string(text)

        return _bsdf(of_text, spec)

    return Source(spec, element.get("type", Path(path).stem), load, tuple(scene.files))


def _resolved(element: Any, named: Mapping[str, Any], path: str, depth: int) -> Any:
    """A copy of an element in which references are what they refer to."""
    if depth > _DEEPEST:
        raise UsageError(f"{one_line(path)}: references go around in a circle, or are more than {_DEEPEST} deep")
    found = ElementTree.Element(element.tag, {key: value for key, value in element.attrib.items() if key != "id"})
    for part in element:
        if part.tag == "ref":
            target = named.get(part.get("id", ""))
            if target is None:
                raise UsageError(f"{one_line(path)}: there is nothing with the id {one_line(part.get('id', ''))!r} to refer to")
            inner = _resolved(target, named, path, depth + 1)
            if part.get("name"):
                inner.set("name", part.get("name", ""))
        else:
            inner = _resolved(part, named, path, depth + 1)
        found.append(inner)
    return found
