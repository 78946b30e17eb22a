"""Documents: one line for what is wrong, with its place, what is allowed and what was given."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, Strict, field_validator

from brdfcheck.documents import Model, validated
from brdfcheck.messages import UsageError

Triple = Annotated[tuple[float, float, float], Strict(False)]


class Distant(Model):
    kind: Literal["distant"]
    direction: Triple


class Point(Model):
    kind: Literal["point"]
    position: Triple
    intensity: float = Field(1.0, gt=0)


class Room(Model):
    reflectance: float = Field(ge=0, lt=1)
    cells: int = Field(4, ge=1, le=12)
    closed: bool = True
    style: Literal["white", "grey"] = "white"

    @field_validator("style")
    @classmethod
    def not_grey(cls, value: str) -> str:
        if value == "grey":
            raise ValueError("grey is sold out")
        return value


class House(Model):
    name: str
    rooms: dict[str, Room] = Field(default_factory=dict)
    lights: list[Annotated[Distant | Point, Field(discriminator="kind")]] = Field(default_factory=list)


POINT = {"kind": "point", "position": [0, 1, 2]}


def test_what_is_right_is_a_model() -> None:
    house = validated(House, {"name": "a", "rooms": {"x": {"reflectance": 0}}, "lights": [POINT]}, "f.toml")
    assert house.rooms["x"].reflectance == 0.0
    assert house.lights[0] == Point(kind="point", position=(0, 1, 2))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"nmae": 1, "name": None}, "f: unknown key 'nmae'; did you mean name? allowed: name, rooms, lights"),
        ({"name": None}, "f: name: is missing"),
        ({"name": 3}, "f: name: must be a string; got 3"),
        ({"rooms": 1}, "f: rooms: must be a table; got 1"),
        ({"rooms": {"x": 2}}, "f: rooms.x: must be a table; got 2"),
        ({"rooms": {"x": {"reflectance": 1}}}, "f: rooms.x.reflectance: must be below 1; got 1"),
        ({"rooms": {"x": {"reflectance": True}}}, "f: rooms.x.reflectance: must be a number; got True"),
        ({"rooms": {"x": {"reflectance": float("nan")}}}, "f: rooms.x.reflectance: must be finite; got nan"),
        ({"rooms": {"x": {"reflectance": 0, "cells": 2.5}}}, "f: rooms.x.cells: must be a whole number; got 2.5"),
        ({"rooms": {"x": {"reflectance": 0, "cells": 0}}}, "f: rooms.x.cells: must be at least 1; got 0"),
        ({"rooms": {"x": {"reflectance": 0, "closed": 1}}}, "f: rooms.x.closed: must be true or false; got 1"),
        ({"rooms": {"x": {"reflectance": 0, "style": "red"}}}, "f: rooms.x.style: must be one of 'white' or 'grey'; got 'red'"),
        ({"rooms": {"x": {"reflectance": 0, "style": "grey"}}}, "f: rooms.x.style: grey is sold out; got 'grey'"),
        (
            {"rooms": {"x": {"reflectance": 0, "sky": 1}}},
            "f: rooms.x: unknown key 'sky'; allowed: reflectance, cells, closed, style",
        ),
        ({"lights": [POINT, {"position": 1}]}, "f: lights[1]: needs the key 'kind'; got {'position': 1}"),
        ({"lights": [{"kind": "sun"}]}, "f: lights[0]: must be one of 'distant', 'point'; got {'kind': 'sun'}"),
        (
            {"lights": [POINT | {"colour": 1}]},
            "f: lights[0]: unknown key 'colour'; allowed: kind, position, intensity",
        ),
        ({"lights": [{"kind": "distant"}]}, "f: lights[0].direction: is missing"),
        ({"lights": [POINT | {"position": [0, 1]}]}, "f: lights[0].position[2]: is missing"),
        ({"lights": [POINT | {"position": [0, 1, "2"]}]}, "f: lights[0].position[2]: must be a number; got '2'"),
        ({"lights": [POINT | {"position": "a" * 99}]}, f"f: lights[0].position: must be a list; got '{'a' * 56}..."),
    ],
)
def test_what_is_wrong_is_one_line(changes: dict[str, Any], said: str) -> None:
    document = {key: value for key, value in ({"name": "a"} | changes).items() if value is not None}
    with pytest.raises(UsageError) as error:
        validated(House, document, "f")
    assert str(error.value) == said
