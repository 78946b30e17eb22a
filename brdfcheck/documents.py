"""Documents that users write: TOML files, read and checked with one set of messages.

A document is described by models (`Model`): what is unknown, missing, of a wrong type or out of range is a `UsageError` in one
line, which names the file, the place in it, what is allowed and what was given.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import pydantic
from pydantic_core import PydanticCustomError

from brdfcheck.folders import readable
from brdfcheck.messages import UsageError, did_you_mean, one_line

_LONGEST = 60
# The words for what pydantic calls by the names of Python; of a type of error that is not here its own message is told.
_WORDS = {
    "missing": "is missing",
    "bool_type": "must be true or false",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "finite_number": "must be finite",
    "string_type": "must be a string",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "greater_than": "must be above {gt:.10g}",
    "greater_than_equal": "must be at least {ge:.10g}",
    "less_than": "must be below {lt:.10g}",
    "less_than_equal": "must be at most {le:.10g}",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
    "string_too_short": "must have at least {min_length} characters",
    "literal_error": "must be one of {expected}",
    "union_tag_invalid": "must be one of {expected_tags}",
    "union_tag_not_found": "needs the key {discriminator}",
}

# Of what must not be empty.
_ONE = {"too_short": "must have at least one entry", "string_too_short": "must not be empty"}

_M = TypeVar("_M", bound="Model")


class Model(pydantic.BaseModel):
    """A table of a document. Keys that it does not have are refused, and nothing is converted but whole numbers to floats.

    A validator that raises ValueError gives its own words. A field that is a tuple is ``Annotated[tuple[...], Strict(False)]``:
    documents have lists.
    """

    model_config = pydantic.ConfigDict(
        extra="forbid", strict=True, frozen=True, arbitrary_types_allowed=True, allow_inf_nan=False
    )

    @pydantic.model_validator(mode="before")
    @classmethod
    def _known(cls, given: Any) -> Any:
        """Refuses a key that the table does not have: here its model says which ones it has."""
        if isinstance(given, Mapping) and cls.model_config.get("extra") == "forbid":
            for key in given:
                if key not in cls.model_fields:
                    raise PydanticCustomError("unknown_key", "{words}", {"words": _unknown_key(key, cls.model_fields)})
        return given


def validated(model: type[_M], document: Mapping[str, Any], label: str) -> _M:
    """The document as `model`. UsageError, which begins with `label`, for the first thing that is wrong in it."""
    try:
        return model.model_validate(dict(document))
    except pydantic.ValidationError as errors:
        # What is unknown comes first: a mistyped key also makes another one missing.
        first = min(errors.errors(), key=lambda error: error["type"] != "unknown_key")
        raise UsageError(f"{label}: {_told(document, first)}") from None


def shown(value: Any) -> str:
    """A value of a document, for messages."""
    try:
        text = one_line(repr(value))
    except ValueError:  # Python writes no integer of more than 4300 digits
        return "an integer of thousands of digits"
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def _unknown_key(key: Any, allowed: Iterable[str]) -> str:
    """What is said of a key that a table does not have."""
    hint = did_you_mean(str(key), allowed, most=1, cutoff=0.6)
    return f"unknown key {shown(key)}; {hint}{' ' if hint else ''}allowed: {', '.join(allowed)}"


def _told(document: Any, error: Any) -> str:
    kind, place = error["type"], _place(document, error["loc"], missing=error["type"] == "missing")
    context = error.get("ctx", {})
    if kind == "value_error":
        words = one_line(context["error"])
    elif kind in _ONE and context["min_length"] == 1:
        words = _ONE[kind]
    else:
        words = _WORDS[kind].format(**context) if kind in _WORDS else one_line(error["msg"])
    return _at(place, words if kind in ("missing", "unknown_key") else f"{words}; got {shown(error['input'])}")


def _place(document: Any, location: tuple[Any, ...], missing: bool) -> list[str | int]:
    """The keys of a location; pydantic puts names of alternatives between them."""
    place: list[str | int] = []
    for position, step in enumerate(location):
        last = missing and position == len(location) - 1
        inside = isinstance(document, Mapping) and step in document
        inside |= isinstance(document, list | tuple) and isinstance(step, int) and step < len(document)
        if inside:
            document = document[step]
        if inside or last:
            place.append(step)
    return place


def _at(place: list[str | int], words: str) -> str:
    text = ""
    for step in place:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else str(step)
    return f"{text}: {words}" if text else words


def read_text(path: str | Path) -> tuple[str, Callable[[str], str]]:
    """The text of a file, and what gives a text this file's line ends and, where it has one, its byte order mark.

    Editors on Windows write ``\\r\\n`` and the mark, which TOML does not have. OSError, UnicodeDecodeError.
    """
    text = Path(path).read_bytes().decode("utf-8")
    mark = "\ufeff" if text.startswith("\ufeff") else ""
    windows = 0 < text.count("\r\n") == text.count("\n")
    text = text.removeprefix(mark)

    def own(changed: str) -> str:
        return mark + (changed.replace("\n", "\r\n") if windows else changed)

    return text.replace("\r\n", "\n") if windows else text, own


def read_document(path: str | Path) -> tuple[dict[str, Any], str]:
    """What a TOML file says, and its name for messages. UsageError where there is none, or where it is not TOML."""
    label = one_line(path)
    with readable(path, "a TOML file", pipes=True):
        try:
            text, _ = read_text(path)
        except UnicodeDecodeError:
            raise UsageError(f"{label} is not a text file in UTF-8") from None
    try:
        return tomllib.loads(text), label
    except (ValueError, RecursionError) as error:  # also numbers of more digits than Python reads
        raise UsageError(f"{label} is not TOML: {one_line(error)}") from None
