"""What every table of a vehicle file obeys, and a rule between numbers that a file breaks."""

from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict


class FileTable(BaseModel):
    """A table of a file: no key that it does not know, no text where a number belongs."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class Problem(NamedTuple):
    """A rule between numbers that a file breaks."""

    place: str
    expected: str
    found: str


class BrokenRuleError(ValueError):
    """What a validator raises: pydantic adds the table that it stands in."""

    def __init__(self, place: str, expected: str, found: str) -> None:
        super().__init__(f"{place}: expected {expected}, found {found}")
        self.problem = Problem(place, expected, found)


def flat_keys(table: dict[str, Any]) -> dict[str, Any]:
    """Keys by their dotted path. Of ``found`` each number's table is a path of its own: ``found.PATH.low``."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        if not isinstance(value, dict):
            flat[name] = value
            continue
        for key, inner in value.items():
            if name == "found" and isinstance(inner, dict):
                flat |= {f"{name}.{key}.{last}": deepest for last, deepest in inner.items()}
            else:
                flat[f"{name}.{key}"] = inner
    return flat


def as_list(value: Any) -> list[Any]:
    """A list as it is, anything else as a list of one."""
    return value if isinstance(value, list) else [value]
