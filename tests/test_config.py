"""The one base of configuration files: each mistake in its place, in words, with what was expected and found."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, model_validator

from lgprjax.config import BrokenRuleError, ConfigTable, DataclassTables, TableKey, fill_table
from lgprjax.errors import InputError

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
    ("table", "words"),
    [
        ({}, "name: expected a value, found none"),
        (3, "file: expected a table, found 3"),
        ({"nam": "a"}, "nam: expected a key, perhaps name, found an unknown key"),
        ({"name": "a", "line": {"ulr": "abc"}}, "line.ulr: expected a key, perhaps url, found an unknown key"),
        ({"name": "a", "lines": [{"url": "abc"}, {}]}, "lines[2].url: expected a value, found none"),
        ({"name": "a", "lines": [{"url": "abc", "x": 1}]}, "lines[1].x: expected a key among baud, url, found an"),
        ({"name": "a", "line": 3}, "line: expected a table, found 3"),
        ({"name": "a", "lines": {}}, "lines: expected a list, found a table"),
        ({"name": 3}, "name: expected a text, found 3"),
        ({"name": "A"}, "name: expected a text that matches ^[a-z]+$, found 'A'"),
        ({"name": "a", "speed_mps": "1"}, "speed_mps: expected a number, found '1'"),
        ({"name": "a", "speed_mps": True}, "speed_mps: expected a number, found True"),
        ({"name": "a", "speed_mps": 4}, "speed_mps: expected 0 to 3, found 4"),
        ({"name": "a", "share": 1.0}, "share: expected more than 0.5 and less than 1, found 1.0"),
        ({"name": "a", "order": "left"}, "order: expected 'up' or 'down', found 'left'"),
        ({"name": "a", "loud": 1}, "loud: expected true or false, found 1"),
        ({"name": "a", "line": {"url": "abc", "baud": 1.5}}, "line.baud: expected a whole number, found 1.5"),
        ({"name": "a", "line": {"url": "a"}}, "line.url: expected a text of 3 or more characters, found 'a'"),
        ({"name": "a", "knots": [1.0]}, "knots: expected a list of 2, found [1.0]"),
        ({"name": "a", "knots": [1.0, 3.0]}, "knots[2]: expected 0 to 2, found 3.0"),
        ({"name": "a", "words": []}, "words: expected a table, found []"),
        ({"name": "a", "loud": True, "speed_mps": 0.0}, "speed_mps: expected 0.1 or more of a loud one, found"),
    ],
)
def test_each_mistake_of_a_model_is_one_line(table: object, words: str) -> None:
    with pytest.raises(InputError) as refused:
        fill_table(Machine, PLACE, table)
    assert str(refused.value).startswith(f"x.toml: {words}")
    assert "\n" not in str(refused.value)


def test_a_place_within_a_file_stands_before_that_of_the_model() -> None:
    with pytest.raises(InputError, match=r"^x\.toml: options\.lines\[1\]\.url: expected a value, found none$"):
        fill_table(Machine, PLACE.at("options"), {"name": "a", "lines": [{}]})
    with pytest.raises(InputError, match=r"options\.nmae: expected a key, perhaps name"):
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
    ("table", "words"),
    [
        ({"seed": 10}, "seed: expected 0 to 9, found 10"),
        ({"tilt_deg": 6}, "tilt_deg: expected 0 to 5.72958, found 6"),
        ({"tilt_deg": 1, "tilt_rad": 0.01}, "tilt_deg: expected tilt_rad or tilt_deg, found both"),
        ({"span_m": [2, 1]}, "span_m: expected [from, to] with from before to, found [2, 1]"),
        ({"span_m": [2]}, "span_m: expected a list of 2, found [2]"),
        ({"layers_m": [1.0, float("inf")]}, "layers_m[2]: expected a finite number, found inf"),
        ({"cover": {}}, "cover.thickness_m: expected a value, found none"),
        ({"colour": 1}, "colour: expected a key among cover, layers_m, seed"),
        ({"other": 1}, "other: expected the other section, found this key"),
    ],
)
def test_each_mistake_of_a_dataclass_is_one_line(table: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as refused:
        TABLES.fill(Ground, PLACE, table, withheld={"other": "the other section"})
    assert str(refused.value).startswith(f"x.toml: {words}")
