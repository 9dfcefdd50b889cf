"""The study file: which numbers of which vehicle are to be found on which logs."""

from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lgprjax.errors import InputError
from lgprjax.files import load_toml

Kind = Literal[
    "straight", "encoder", "wheel_angle", "rear_ratio", "yaw_gain", "servo", "pedals", "look_ahead", "fusion"
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
