"""The study file, with the numbers to fit and the logs, and the thresholds file."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import AfterValidator, ConfigDict, Field

from lgprjax.config import BrokenRuleError, ConfigTable, TableKey, fill_table
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
    "tracking",
    "loop",
    "look_ahead",
    "fusion",
    "threshold",
]  # in the order in which a new vehicle needs them
KINDS: tuple[Kind, ...] = get_args(Kind)


class _StudyTable(ConfigTable):
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    kind: Kind
    vehicle: str
    serial_number: str | None = None
    logs: list[str] = Field(default_factory=list)
    held_out: list[str] = Field(default_factory=list)
    options: dict[str, Any] = Field(default_factory=dict)


class Study(NamedTuple):
    """Contents of a study file; paths are ready to open.

    Attributes:
        file: path of the study file.
        name: name of the outputs.
        kind: kind of study, which sets the numbers to fit.
        vehicle: path of the initial vehicle file.
        serial_number: serial number of the vehicle; ``None`` if the study has none.
        logs: drive logs to fit.
        held_out: held-out drive logs, which test the fit.
        options: options of this kind of study.
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
        InputError: the file is missing or not TOML; a key is unknown, missing or of a wrong type; a log both fits and
            judges.
    """
    file = Path(path)
    table = load_toml(file)
    if table.get("schema") == "lgprjax.vehicle":
        raise InputError(
            file, "file", "a study: name, kind, vehicle, logs", "a vehicle file (the key vehicle of a study names it)"
        )
    if "ports" in table:
        raise InputError(file, "file", "a study: name, kind, vehicle, logs", "the configuration of a run (lgprjax run)")
    study = fill_table(_StudyTable, TableKey(file), table)
    for name in study.held_out:
        if name in study.logs:
            raise InputError(file, "held_out", "held-out logs that the fit does not use", name)
    folder = file.parent
    return Study(
        file=file,
        name=study.name,
        kind=study.kind,
        vehicle=folder / study.vehicle,
        serial_number=study.serial_number,
        logs=tuple(folder / name for name in study.logs),
        held_out=tuple(folder / name for name in study.held_out),
        options=study.options,
    )


# Thresholds as a small TOML file, with the data behind them.

_NAMES = ("strength_by_chance", "margin_by_chance", "overlap", "sigma_scale")


def _nothing_absolute(value: float) -> float:
    if value != 0.0:
        expected = "0 (thresholds are in noise-floor units only; calibrate again with lgprjax thresholds)"
        raise BrokenRuleError("", expected)
    return value


_Absolute = Annotated[float, AfterValidator(_nothing_absolute)]
_Threshold = Annotated[float, Field(ge=0.0, lt=1e6)]


class _Thresholds(ConfigTable):
    """Table of thresholds. ``strength`` and ``margin`` of version 1.0, absolute least score and lead, are ignored."""

    model_config = ConfigDict(extra="ignore")

    strength_by_chance: _Threshold
    margin_by_chance: _Threshold
    overlap: _Threshold
    sigma_scale: _Threshold
    strength: _Absolute = 0.0
    margin: _Absolute = 0.0


class _ThresholdsFile(ConfigTable):
    """File of thresholds; later minor versions may have more keys."""

    model_config = ConfigDict(extra="ignore")

    schema_name: Literal["lgprjax.thresholds"] = Field(alias="schema")
    version: str = Field(pattern=r"^1\.\d+$")
    window_m: float
    thresholds: _Thresholds


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
        path: path of the output.
        thresholds: thresholds by name, as defined in ``registration.Thresholds``.
        window_m, search_m: window and search region of the registrations to which they apply.
        found_on: counts, names and the risk on which they are based.
        force: whether to replace an existing output.

    Raises:
        InputError: the output cannot be written, or exists.
    """
    lines = ['schema = "lgprjax.thresholds"', 'version = "1.1"']
    lines += [f"window_m = {window_m!r}", f"search_m = {search_m!r}", ""]
    lines += ["[thresholds]", *(f"{name} = {float(thresholds[name])!r}" for name in _NAMES), "", "[found_on]"]
    for name, value in found_on.items():
        # A JSON string is a TOML string: names of files may hold quotes.
        lines.append(f"{name} = {json.dumps(value)}")
    with atomic_output(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_thresholds(path: str | Path, window_m: float) -> dict[str, float]:
    """Thresholds by name.

    Args:
        path: path of the file.
        window_m: window of the registration; thresholds for another window do not apply.

    Raises:
        InputError: the file is not a file of thresholds, a threshold is missing or not a number, they are for other
            windows, or an older file requires an absolute score or margin.
    """
    place = TableKey(Path(path))
    held = fill_table(_ThresholdsFile, place, load_toml(path))
    if held.window_m != window_m:
        raise place.at("window_m").refuse(f"{window_m:g}, as --window-m says", f"{held.window_m:g}")
    return {name: getattr(held.thresholds, name) for name in _NAMES}
