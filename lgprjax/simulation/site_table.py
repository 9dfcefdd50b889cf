"""Tables of a site file as frozen dataclasses: every key, type and range is checked, each error is one line."""

import difflib
import math
import types
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from lgprjax.errors import InputError
from lgprjax.simulation.site_limits import ASCENDING, LIMITS

Config = TypeVar("Config")


@dataclass(frozen=True)
class Place:
    """Where in which file a value stands: ``drive[2].lane_m``."""

    file: Path
    path: str = ""

    def at(self, key: str) -> "Place":
        """A key of the table here."""
        return Place(self.file, f"{self.path}.{key}" if self.path else key)

    def refuse(self, expected: str, found: str) -> InputError:
        """The error to raise."""
        return InputError(self.file, self.path or "file", expected, found)


def fill_config(
    kind: type[Config],
    place: Place,
    table: object,
    *,
    base: Config | None = None,
    elsewhere: Iterable[str] = (),
    withheld: Mapping[str, str] | None = None,
) -> Config:
    """A dataclass from a table.

    Args:
        table: as TOML gives it. An angle whose field ends in ``_rad`` may be given in degrees, ending in ``_deg``.
        base: what the keys that are not there keep; None: the dataclass's defaults.
        elsewhere: keys of this table that are not the dataclass's and are read by the caller.
        withheld: fields that a site file does not set here, and where they come from.

    Raises:
        InputError: no table, a key that is unknown or missing, a type or a range that is wrong.
    """
    entries, withheld = as_table(place, table), withheld or {}
    hints = get_type_hints(kind)
    known = [f.name for f in fields(kind) if f.name not in withheld]  # type: ignore[arg-type]
    refuse_unknown(place, entries, [*known, *elsewhere, *(_degrees(name) for name in known)], withheld)
    values: dict[str, Any] = {}
    for name in known:
        given = [key for key in dict.fromkeys((name, _degrees(name))) if key in entries and key not in elsewhere]
        if len(given) > 1:
            raise place.at(given[1]).refuse(f"{given[0]} or {given[1]}", "both")
        for key in given:
            inner = None if base is None else getattr(base, name)
            scale = 1.0 if key == name else math.pi / 180
            values[name] = _convert(hints[name], place.at(key), entries[key], kind, name, inner, scale)
    if base is not None:
        return replace(base, **values)  # type: ignore[type-var]
    for f in fields(kind):  # type: ignore[arg-type]
        if f.name in known and f.name not in values and f.default is MISSING:
            raise place.at(f.name).refuse("a value", "none")
    return kind(**values)


def as_table(place: Place, value: object) -> dict[str, Any]:
    """The value, which must be a table.

    Raises:
        InputError: it is not.
    """
    if not isinstance(value, dict):
        raise place.refuse("a table", _say(value))
    return value


def refuse_unknown(
    place: Place, table: Mapping[str, object], known: Iterable[str], withheld: Mapping[str, str] | None = None
) -> None:
    """Raises ``InputError`` for the first key that is not known; names the nearest one that is."""
    names = list(dict.fromkeys(known))
    for key in table:
        if key in names:
            continue
        if withheld and key in withheld:
            raise place.at(key).refuse(withheld[key], "this key")
        raise place.at(key).refuse(nearest(key, names, "a key"), "an unknown key")


def nearest(name: str, known: Iterable[str], what: str) -> str:
    """What was expected instead of an unknown name: the close one, or all there are."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, 1, 0.6)
    return f"{what}, perhaps {close[0]}" if close else f"{what} among {', '.join(names) or 'none'}"


def _degrees(name: str) -> str:
    return name.removesuffix("_rad") + "_deg" if name.endswith("_rad") else name


def _convert(hint: Any, place: Place, value: object, kind: type, name: str, base: object, scale: float) -> Any:
    """A value of the type that the hint says; a pair or list of numbers is held to its limits number by number."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (types.UnionType, Union):  # X | None: TOML has no None
        return _convert(next(i for i in inner if i is not types.NoneType), place, value, kind, name, base, scale)
    if is_dataclass(hint):
        return fill_config(hint, place, value, base=base)  # type: ignore[arg-type]
    if origin is tuple:
        return _convert_tuple(inner, place, value, kind, name, scale)
    if hint is str:
        if not isinstance(value, str) or not value:
            raise place.refuse("a text", _say(value))
        return value
    whole = hint is int
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        raise place.refuse("a whole number" if whole else "a number", _say(value))
    low, high = LIMITS.get(kind, {}).get(name, (-math.inf, math.inf))
    number = value if whole else float(value) * scale
    if not (math.isfinite(number) and low <= number <= high):
        raise place.refuse(_between(low / scale, high / scale), _say(value))
    return number


def _convert_tuple(
    inner: tuple[Any, ...], place: Place, value: object, kind: type, name: str, scale: float
) -> tuple[Any, ...]:
    many = inner[-1] is Ellipsis
    due = "a list" if many else f"a list of {len(inner)}"
    if not isinstance(value, list) or (not many and len(value) != len(inner)):
        raise place.refuse(due, _say(value))
    items = tuple(
        _convert(inner[0], Place(place.file, f"{place.path}[{number}]"), item, kind, name, None, scale)
        for number, item in enumerate(value, 1)
    )
    if name in ASCENDING and not many and not items[0] < items[1]:
        raise place.refuse("[from, to] with from before to", _say(value))
    return items


def _between(low: float, high: float) -> str:
    if math.isinf(high):
        return "a finite number" if math.isinf(low) else f"{low:.6g} or more"
    return f"{low:.6g} to {high:.6g}"


def _say(value: object) -> str:
    text = repr(value) if not isinstance(value, dict) else "a table"
    return text if len(text) <= 60 else f"{text[:57]}..."
