"""The one base of configuration files: each mistake in its place, with what was expected and found."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, model_validator

from lgprjax.config import BrokenRuleError, ConfigTable, DataclassTables, TableKey, fill_table
from refusals import refused

PLACE = TableKey(Path("x.toml"))


class Line(ConfigTable):
    url: str = Field(min_length=3)
    baud: int = Field(default=9600, gt=0, lt=1 << 20)


class Machine(ConfigTable):
    name: str = Field(pattern="^[a-z]+$")
    speed_mps: float = Field(default=1.0, ge=0.0, le=3.0)
    share: float | None = Field(default=None, gt=0.5, lt=1.0)
    order: Literal["up", "down"] = "up"
    loud: bool = False
    line: Line | None = None
    lines: list[Line] = Field(default_factory=list)
    knots: list[Annotated[float, Field(ge=0.0, le=2.0)]] = Field(default=[0.0, 1.0], min_length=2, max_length=2)
    words: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _no_crawling(self) -> "Machine":
        if self.loud and self.speed_mps < 0.1:
            raise BrokenRuleError("speed_mps", "0.1 or more of a loud one")
        return self


@pytest.mark.parametrize(
    ("table", "place", "values"),
    [
        ({}, "name", ()),
        (3, "file", (3,)),
        ({"nam": "a"}, "nam", ("name",)),
        ({"name": "a", "line": {"ulr": "abc"}}, "line.ulr", ("url",)),
        ({"name": "a", "lines": [{"url": "abc"}, {}]}, "lines[2].url", ()),
        ({"name": "a", "lines": [{"url": "abc", "x": 1}]}, "lines[1].x", ("baud, url",)),
        ({"name": "a", "line": 3}, "line", (3,)),
        ({"name": "a", "lines": {}}, "lines", ("list", "table")),
        ({"name": 3}, "name", (3,)),
        ({"name": "A"}, "name", ("^[a-z]+$", "'A'")),
        ({"name": "a", "speed_mps": "1"}, "speed_mps", ("number", "'1'")),
        ({"name": "a", "speed_mps": True}, "speed_mps", ("number", "True")),
        ({"name": "a", "speed_mps": 4}, "speed_mps", ("0 to 3", 4)),
        ({"name": "a", "share": 1.0}, "share", (0.5, 1, 1.0)),
        ({"name": "a", "order": "left"}, "order", ("'up'", "'down'", "'left'")),
        ({"name": "a", "loud": 1}, "loud", ("true", "false", 1)),
        ({"name": "a", "line": {"url": "abc", "baud": 1.5}}, "line.baud", ("whole", 1.5)),
        ({"name": "a", "line": {"url": "a"}}, "line.url", (3, "'a'")),
        ({"name": "a", "knots": [1.0]}, "knots", (2, "[1.0]")),
        ({"name": "a", "knots": [1.0, 3.0]}, "knots[2]", ("0 to 2", 3.0)),
        ({"name": "a", "words": []}, "words", ("table", "[]")),
        ({"name": "a", "loud": True, "speed_mps": 0.0}, "speed_mps", (0.1,)),
    ],
)
def test_each_mistake_of_a_model_is_one_line(table: object, place: str, values: tuple[object, ...]) -> None:
    with refused(place, *values, file="x.toml"):
        fill_table(Machine, PLACE, table)


def test_a_place_within_a_file_stands_before_that_of_the_model() -> None:
    with refused("options.lines[1].url", file="x.toml"):
        fill_table(Machine, PLACE.at("options"), {"name": "a", "lines": [{}]})
    with refused("options.nmae", "name", file="x.toml"):
        fill_table(Machine, PLACE.at("options"), {"nmae": "a"})


@dataclass(frozen=True)
class Cover:
    thickness_m: float
    index: float = 1.5


@dataclass(frozen=True)
class Ground:
    seed: int = 1
    tilt_rad: float = 0.0
    span_m: tuple[float, float] = (0.0, 1.0)
    layers_m: tuple[float, ...] = ()
    cover: Cover | None = None


TABLES = DataclassTables({Ground: {"tilt_rad": (0.0, 0.1), "seed": (0, 9)}}, rising=frozenset({"span_m"}))


def test_a_dataclass_keeps_what_is_not_given() -> None:
    base = Ground(seed=3, cover=Cover(0.2, 1.3))
    held = TABLES.fill(Ground, PLACE, {"tilt_deg": 1.0, "cover": {"index": 2}}, base=base)
    assert held.tilt_rad == pytest.approx(math.radians(1.0))
    assert replace(held, tilt_rad=0.0) == Ground(seed=3, cover=Cover(0.2, 2.0))
    assert TABLES.fill(Ground, PLACE, {"layers_m": [1, 2.5]}) == Ground(layers_m=(1.0, 2.5))


@pytest.mark.parametrize(
    ("table", "place", "values"),
    [
        ({"seed": 10}, "seed", ("0 to 9", 10)),
        ({"tilt_deg": 6}, "tilt_deg", ("0 to 5.72958", 6)),
        ({"tilt_deg": 1, "tilt_rad": 0.01}, "tilt_deg", ("tilt_rad or tilt_deg",)),
        ({"span_m": [2, 1]}, "span_m", ("[from, to]", "[2, 1]")),
        ({"span_m": [2]}, "span_m", (2, "[2]")),
        ({"layers_m": [1.0, float("inf")]}, "layers_m[2]", ("finite", "inf")),
        ({"cover": {}}, "cover.thickness_m", ()),
        ({"colour": 1}, "colour", ("cover, layers_m, seed",)),
        ({"other": 1}, "other", ("section_2",)),
    ],
)
def test_each_mistake_of_a_dataclass_is_one_line(table: dict[str, Any], place: str, values: tuple[object, ...]) -> None:
    with refused(place, *values, file="x.toml"):
        TABLES.fill(Ground, PLACE, table, withheld={"other": "section_2"})
