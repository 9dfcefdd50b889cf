"""Configuration files: common base of their tables, and their error messages.

A table is a pydantic model derived from ``ConfigTable``, or a frozen dataclass of a numeric package, which does not
depend on files and is filled by ``DataclassTables``. Every error becomes one ``InputError`` that names file, place,
expected and found value. Items of a list count from 1.
"""

import difflib
import math
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model
from pydantic.fields import FieldInfo

from lgprjax.errors import InputError

Limits = Mapping[str, tuple[float, float]]
"""Closed range of each number of a dataclass, by field name."""


class ConfigTable(BaseModel):
    """A table of a file: unknown keys are refused, types are strict, and instances are immutable."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class RuleViolation(NamedTuple):
    """A violated rule: dotted path of the place, expected and found value."""

    place: str
    expected: str
    found: str


class BrokenRuleError(ValueError):
    """Error of a validator; the enclosing table's path is prepended to the place.

    Args:
        place: path below the validated value; empty for the value itself.
        expected: description of the expected value.
        found: description of the value found; ``None``: the value itself.
    """

    def __init__(self, place: str, expected: str, found: str | None = None) -> None:
        super().__init__(f"{place}: expected {expected}, found {found}")
        self.place, self.expected, self.found = place, expected, found


@dataclass(frozen=True)
class TableKey:
    """File and path of a value, such as ``drive[2].lane_m``."""

    file: Path
    path: str = ""

    def at(self, key: str) -> "TableKey":
        """The place of a key of the table at this place."""
        return TableKey(self.file, _joined(self.path, key))

    def refuse(self, expected: str, found: str) -> InputError:
        """The error for a wrong value at this place."""
        return InputError(self.file, self.path or "file", expected, found)


Table = TypeVar("Table", bound=BaseModel)
Config = TypeVar("Config")


def fill_table(kind: type[Table], place: TableKey, table: object, *, known: Iterable[str] = ()) -> Table:
    """Fill a model from a table.

    Args:
        kind: class of the model.
        place: file and path of the table.
        table: table parsed from TOML or JSON.
        known: keys that the caller reads itself; they are suggested for misspelt keys.

    Raises:
        InputError: the value is not a table, a key is unknown or missing, a value has a wrong type or is out of range,
            or a rule between values is violated. Unknown keys are reported first, because a missing key may be
            misspelt.
    """
    try:
        return kind.model_validate(as_table(place, table))
    except ValidationError as error:
        first = next(violations(kind, error, known=known))
        raise InputError(place.file, _joined(place.path, first.place) or "file", first.expected, first.found) from None


def violations(kind: type[BaseModel], error: ValidationError, *, known: Iterable[str] = ()) -> Iterator[RuleViolation]:
    """Violated rules with their descriptions, unknown keys first."""
    problems = error.errors()
    for problem in sorted(problems, key=lambda problem: problem["type"] != "extra_forbidden"):
        cause = problem.get("ctx", {}).get("error")
        below = cause.place if isinstance(cause, BrokenRuleError) else ""
        yield RuleViolation(_joined(_path_of(problem["loc"]), below), *_in_words(kind, dict(problem), known))


def as_table(place: TableKey, value: object) -> dict[str, Any]:
    """The value as a table.

    Raises:
        InputError: the value is not a table.
    """
    if not isinstance(value, dict):
        raise place.refuse("a table", say(value))
    return value


def refuse_unknown(place: TableKey, table: Mapping[str, object], known: Iterable[str]) -> None:
    """Raises ``InputError`` for the first unknown key; names the most similar known one."""
    names = list(dict.fromkeys(known))
    for key in table:
        if key not in names:
            raise place.at(key).refuse(nearest(key, names, "a key"), "an unknown key")


def nearest(name: str, known: Iterable[str], what: str) -> str:
    """Expected text for an unknown name: the most similar one, or all."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, 1, 0.6)
    return f"{what}, perhaps {close[0]}" if close else f"{what} among {', '.join(names) or 'none'}"


def say(value: object) -> str:
    """Text of a value for error messages."""
    if isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        return "an array of tables"
    text = repr(value) if not isinstance(value, dict) else "a table"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _joined(path: str, key: str) -> str:
    return f"{path}{'' if not path or not key or key.startswith('[') else '.'}{key}"


def _path_of(loc: tuple[int | str, ...]) -> str:
    path = ""
    for part in loc:
        path = _joined(path, part if isinstance(part, str) else f"[{part + 1}]")
    return path


# A pydantic error in words.

_TYPES = {
    "float": "a number",
    "int": "a whole number",
    "string": "a text",
    "bool": "true or false",
    "list": "a list",
    "tuple": "a list",
    "dict": "a table",
    "model": "a table",
}
_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number")


def _in_words(kind: type[BaseModel], problem: dict[str, Any], known: Iterable[str]) -> tuple[str, str]:
    """Descriptions of the expected and the found value of a pydantic error."""
    what, context, found = str(problem["type"]), problem.get("ctx", {}), say(problem["input"])
    *above, last = problem["loc"] or ("",)
    cause = context.get("error")
    if isinstance(cause, BrokenRuleError):
        return cause.expected, found if cause.found is None else cause.found
    if what == "missing":
        return "a value", "none"
    if what == "extra_forbidden":
        table = _table_at(kind, tuple(above))
        names = [*(table.model_fields if table else ()), *(() if above else known)]
        return nearest(str(last), names, "a key"), "an unknown key"
    if what in _BOUNDS:
        return _range_in_words(_bounds_at(kind, problem["loc"])), found
    if what == "literal_error":
        return str(context["expected"]), found
    if what in ("too_short", "too_long", "string_too_short"):
        bounds = _bounds_at(kind, problem["loc"])
        least, most = bounds.get("min_length", 0), bounds.get("max_length", math.inf)
        size = f"{least}" if least == most else f"{least} or more" if math.isinf(most) else f"{least} to {most}"
        return f"a text of {size} characters" if what.startswith("string") else f"a list of {size}", found
    if what == "string_pattern_mismatch":
        return f"a text that matches {context['pattern']}", found
    for name, words in _TYPES.items():
        if what.startswith(f"{name}_"):
            return words, found
    return str(problem["msg"]).removeprefix("Value error, "), found


def _table_at(kind: type[BaseModel], above: tuple[int | str, ...]) -> type[BaseModel] | None:
    """The model at a path below another model."""
    if not above:
        return kind
    field = _field_at(kind, above)
    found = [] if field is None else [inner for inner in _inside(field.annotation) if _is_model(inner)]
    return found[0] if found else None


def _field_at(kind: type[BaseModel], loc: tuple[int | str, ...]) -> FieldInfo | None:
    """The field of the innermost model on a path."""
    names = [part for part in loc if isinstance(part, str)]
    field = None
    table: type[BaseModel] | None = kind
    for name in names:
        if table is None or name not in table.model_fields:
            return field
        field = table.model_fields[name]
        models = [inner for inner in _inside(field.annotation) if _is_model(inner)]
        table = models[0] if models else None
    return field


def _is_model(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, BaseModel)


def _inside(hint: Any) -> Iterator[Any]:
    yield hint
    for inner in get_args(hint):
        yield from _inside(inner)


def _bounds_at(kind: type[BaseModel], loc: tuple[int | str, ...]) -> dict[str, Any]:
    """Constraints on a field, or on the items of its list if the path ends in an index."""
    field = _field_at(kind, loc)
    if field is None:
        return {}
    of_items = [inner for inner in _inside(field.annotation) if isinstance(inner, FieldInfo)]
    return {
        name: getattr(one, name)
        for source in (of_items if isinstance(loc[-1], int) else [field])
        for one in source.metadata
        for name in ("gt", "ge", "lt", "le", "min_length", "max_length")
        if getattr(one, name, None) is not None
    }


def _range_in_words(bounds: dict[str, Any]) -> str:
    if "ge" in bounds and "le" in bounds:
        return between(bounds["ge"], bounds["le"])
    words = {"gt": "more than", "ge": "at least", "lt": "less than", "le": "at most"}
    parts = [f"{word} {bounds[name]:g}" for name, word in words.items() if name in bounds]
    return " and ".join(parts) or "a finite number"


def between(low: float, high: float) -> str:
    """A closed range in words."""
    if math.isinf(high):
        return "a finite number" if math.isinf(low) else f"{low:.6g} or more"
    return f"{low:.6g} to {high:.6g}"


# Dataclasses of the numeric packages as tables of a file.


# Types created at run time, which a type checker cannot follow.
_TUPLE: Any = tuple
_ANNOTATED: Any = Annotated


class DataclassTables:
    """Dataclasses filled from tables; fields are numbers, texts, tuples of them, and dataclasses.

    Each has a pydantic model with the same fields, all optional, because a base may supply missing values.

    Args:
        limits: ranges of each dataclass's numbers; numbers without a range need only be finite.
        rising: names of fields that are, or are lists of, [from, to].
    """

    def __init__(self, limits: Mapping[type, Limits], rising: frozenset[str] = frozenset()) -> None:
        self._limits, self._rising = limits, rising
        self._made: dict[tuple[type[Any], frozenset[str]], type[ConfigTable]] = {}

    def fill(
        self,
        kind: type[Config],
        place: TableKey,
        table: object,
        *,
        base: Config | None = None,
        elsewhere: Iterable[str] = (),
        withheld: Mapping[str, str] | None = None,
    ) -> Config:
        """Fill a dataclass from a table.

        Args:
            kind: class of the dataclass.
            place: file and path of the table.
            table: table parsed from TOML. An angle whose field ends in ``_rad`` may be given in degrees, ending in
                ``_deg``.
            base: values of missing keys; ``None``: the dataclass's defaults.
            elsewhere: other keys of this table, which the caller reads.
            withheld: fields that the file must not set here, with their actual source.

        Raises:
            InputError: as for ``fill_table``.
        """
        entries, withheld, elsewhere = as_table(place, table), withheld or {}, tuple(elsewhere)
        for key in entries:
            if key in withheld:
                raise place.at(key).refuse(withheld[key], "this key")
        given = {key: value for key, value in entries.items() if key not in elsewhere}
        held = fill_table(self._table_of(kind, frozenset(withheld)), place, given, known=elsewhere)
        return self._filled(kind, place, held, base, frozenset(withheld))

    def _table_of(self, kind: type[Any], without: frozenset[str] = frozenset()) -> type[ConfigTable]:
        if (kind, without) in self._made:
            return self._made[kind, without]
        held: dict[str, Any] = {}
        for name, hint in _hints_of(kind).items():
            if name in without:
                continue
            low, high = self._limits.get(kind, {}).get(name, (-math.inf, math.inf))
            held[name] = (self._field(hint, name, low, high), None)
            if name.endswith("_rad"):
                held[_degrees(name)] = (self._field(hint, name, math.degrees(low), math.degrees(high)), None)
        made = self._made[kind, without] = create_model(kind.__name__, __base__=ConfigTable, **held)
        return made

    def _filled(
        self,
        kind: type[Config],
        place: TableKey,
        held: BaseModel,
        base: Config | None,
        withheld: frozenset[str] = frozenset(),
    ) -> Config:
        """The dataclass of a model.

        Raises:
            InputError: an angle is given twice, or a value is missing that has no default.
        """
        values: dict[str, Any] = {}
        for name, hint in _hints_of(kind).items():
            given = [key for key in dict.fromkeys((name, _degrees(name))) if key in held.model_fields_set]
            if len(given) > 1:
                raise place.at(given[1]).refuse(f"{given[0]} or {given[1]}", "both")
            for key in given:
                scale = 1.0 if key == name else math.pi / 180
                values[name] = self._value(hint, place.at(key), getattr(held, key), getattr(base, name, None), scale)
        if base is not None:
            return replace(base, **values)  # type: ignore[type-var]
        for f in fields(kind):  # type: ignore[arg-type]
            if f.name not in values and f.name not in withheld and f.default is MISSING:
                raise place.at(f.name).refuse("a value", "none")
        return kind(**values)

    def _value(self, hint: Any, place: TableKey, value: Any, base: Any, scale: float) -> Any:
        if isinstance(value, tuple):
            return tuple(
                self._value(hint, TableKey(place.file, f"{place.path}[{number}]"), item, None, scale)
                for number, item in enumerate(value, 1)
            )
        if isinstance(value, BaseModel):
            kind = cast(type[Any], next(inner for inner in _inside(hint) if is_dataclass(inner)))
            return self._filled(kind, place, value, base)
        return value * scale if scale != 1.0 else value

    def _field(self, hint: Any, name: str, low: float, high: float) -> Any:
        origin, inner = get_origin(hint), get_args(hint)
        if origin in (types.UnionType, Union):  # X | None: TOML has no None
            return self._field(next(one for one in inner if one is not types.NoneType), name, low, high)
        if is_dataclass(hint):
            return self._table_of(cast(type[Any], hint))
        if origin is tuple:
            item, many = self._field(inner[0], name, low, high), inner[-1] is Ellipsis
            items = _TUPLE[item, ...] if many else _TUPLE[(item,) * len(inner)]
            rules: list[Any] = [BeforeValidator(_as_tuple(None if many else len(inner)))]
            rules += [AfterValidator(_rising)] if name in self._rising and not many else []
            return _ANNOTATED[(items, *rules)]
        return Annotated[hint, Field(min_length=1) if hint is str else AfterValidator(_within(low, high))]


def _hints_of(kind: type[Any]) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {f.name: hints[f.name] for f in fields(kind)}


def _degrees(name: str) -> str:
    return name.removesuffix("_rad") + "_deg" if name.endswith("_rad") else name


def _as_tuple(size: int | None) -> Callable[[Any], Any]:
    def checked(value: Any) -> Any:
        if not isinstance(value, list) or size not in (None, len(value)):
            raise BrokenRuleError("", "a list" if size is None else f"a list of {size}")
        return tuple(value)

    return checked


def _within(low: float, high: float) -> Callable[[float], float]:
    def checked(value: float) -> float:
        if not (math.isfinite(value) and low <= value <= high):
            raise BrokenRuleError("", between(low, high))
        return value

    return checked


def _rising(value: tuple[Any, ...]) -> tuple[Any, ...]:
    if not value[0] < value[1]:
        raise BrokenRuleError("", "[from, to] with from before to")
    return value
