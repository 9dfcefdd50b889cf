"""The study file, which says what is to be found on which logs, and the thresholds file."""

import json
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.formats.store import atomic_output

Kind = Literal[
    "straight",
    "encoder",
    "wheel_angle",
    "rear_ratio",
    "yaw_gain",
    "servo",
    "pedals",
    "look_ahead",
    "fusion",
    "threshold",
]  # in the order in which a new vehicle needs them


class _StudyTable(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    kind: Kind
    vehicle: str
    serial_number: str | None = None
    logs: list[str] = []
    held_out: list[str] = []
    options: dict[str, Any] = {}


class Study(NamedTuple):
    """A study as its file tells it; paths are ready to be opened.

    Attributes:
        file: the study's own.
        name: names its outputs.
        kind: what is to be found.
        vehicle: the vehicle file to begin with.
        serial_number: of the vehicle that is meant; ``None`` where the study does not say.
        logs: drive logs to fit.
        held_out: drive logs that judge the fit and take no part in it.
        options: what only this kind of study has.
    """

    file: Path
    name: str
    kind: Kind
    vehicle: Path
    serial_number: str | None
    logs: tuple[Path, ...]
    held_out: tuple[Path, ...]
    options: dict[str, Any]


def read_study(path: str | Path) -> Study:
    """A study from its file. Paths in it are relative to the file's folder.

    Raises:
        InputError: the file is missing or no TOML; a key is unknown, missing or of a wrong type; a log both fits and
            judges.
    """
    file = Path(path)
    table = load_toml(file)
    try:
        study = _StudyTable.model_validate(table)
    except ValidationError as error:
        raise _refusal(file, dict(error.errors()[0])) from None
    for name in study.held_out:
        if name in study.logs:
            raise InputError(file, "held_out", "logs that take no part in the fit", name)
    folder = file.parent
    return Study(
        file,
        study.name,
        study.kind,
        folder / study.vehicle,
        study.serial_number,
        tuple(folder / name for name in study.logs),
        tuple(folder / name for name in study.held_out),
        study.options,
    )


def _refusal(file: Path, problem: dict[str, Any]) -> InputError:
    place = ".".join(str(part) for part in problem["loc"])
    known = ", ".join(_StudyTable.model_fields)
    expected, found = {
        "missing": ("a value", "none"),
        "extra_forbidden": (f"a key among {known}", "an unknown key"),
    }.get(problem["type"], (str(problem["msg"]), repr(problem["input"])[:60]))
    return InputError(file, place, expected, found)


# Thresholds as a small TOML file, with what they were found on.

_SCHEMA = "lgprjax.thresholds"
_NAMES = ("strength_by_chance", "margin_by_chance", "overlap", "sigma_scale")
_ABSOLUTE = ("strength", "margin")
"""Of version 1.0: least score and lead as such. Nothing is asked of them any more."""


def write_thresholds(
    path: str | Path,
    thresholds: dict[str, float],
    *,
    window_m: float,
    search_m: float,
    found_on: dict[str, float | int | str],
    force: bool,
) -> None:
    """Write ``X.thresholds.toml``.

    Args:
        path: the output.
        thresholds: by name; what each means stands in ``registration.Thresholds``.
        window_m, search_m: of the registrations that they hold for.
        found_on: counts, names and the risk that were behind them.
        force: replace an output that exists.

    Raises:
        InputError: the output cannot be written, or exists.
    """
    lines = [f'schema = "{_SCHEMA}"', 'version = "1.1"', f"window_m = {window_m!r}", f"search_m = {search_m!r}", ""]
    lines += ["[thresholds]", *(f"{name} = {float(thresholds[name])!r}" for name in _NAMES), "", "[found_on]"]
    for name, value in found_on.items():
        # A JSON string is a TOML string: names of files may hold quotes.
        lines.append(f"{name} = {json.dumps(value)}")
    with atomic_output(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_thresholds(path: str | Path, window_m: float) -> dict[str, float]:
    """Thresholds by name.

    Args:
        path: the file.
        window_m: of the registration that they are for; thresholds of another window do not hold.

    Raises:
        InputError: not a file of thresholds, one is missing or no number, they are for other windows, or an older file
            asks for an absolute score or lead.
    """
    held = load_toml(path)
    if held.get("schema") != _SCHEMA:
        raise InputError(path, "schema", _SCHEMA, repr(held.get("schema")))
    if not str(held.get("version", "")).startswith("1."):
        raise InputError(path, "version", "1.x", repr(held.get("version")))
    if held.get("window_m") != window_m:
        raise InputError(path, "window_m", f"{window_m:g}, as --window-m says", repr(held.get("window_m")))
    table = held.get("thresholds")
    values = table if isinstance(table, dict) else {}
    for name in _NAMES:
        value = values.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 1e6:
            raise InputError(path, f"thresholds.{name}", "a number of at least 0", repr(value))
    for name in _ABSOLUTE:
        if values.get(name, 0.0) != 0.0:
            expected = "0: fixes are judged in units of the noise floor alone; calibrate again with lgprjax thresholds"
            raise InputError(path, f"thresholds.{name}", expected, repr(values[name]))
    return {name: float(values[name]) for name in _NAMES}
