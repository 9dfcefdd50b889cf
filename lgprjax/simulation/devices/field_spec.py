"""What a run of the devices in a field is asked for: SPEC.json."""

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lgprjax.errors import InputError


class FieldSpec(BaseModel):
    """A run of the devices in a field. Paths are as the program's working folder has them.

    Attributes:
        anchor: latitude and longitude (degrees) and height of the plan's frame, which poses are in.
        start: pose of the reference point at which the vehicle stands.
        track_m, gnss_x_m, gnss_y_m, threshold_mps: of the true vehicle.
        wheel_scale: what the tracks' sensors read too much by, as a share.
        seed: of slips and errors.
        ports: where the devices' addresses are written to.
        truth: where the truth is written to at the end.
        script: what the operator does.
        faults: what goes wrong.
        rate: world's seconds in one of the computer's.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    anchor: tuple[float, float, float]
    start: tuple[float, float, float]
    track_m: float = Field(gt=0.0)
    gnss_x_m: float = 0.0
    gnss_y_m: float = 0.0
    threshold_mps: float = Field(default=0.0, ge=0.0)
    wheel_scale: float = Field(default=0.02, gt=-0.5, lt=0.5)
    seed: int = 2
    ports: str
    truth: str
    script: list[dict[str, Any]] = []
    faults: list[dict[str, Any]] = []
    rate: float = Field(default=1.0, gt=0.0, le=10.0)


def is_field_spec(path: Path) -> bool:
    """Whether a file asks for devices in a field; what cannot be read does not."""
    try:
        return "anchor" in json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False


def read_field_spec(path: Path) -> FieldSpec:
    """A spec from its file.

    Raises:
        InputError: a key is unknown, missing or not as expected.
    """
    try:
        return FieldSpec.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(path, place, first["msg"], repr(first["input"])[:60]) from None
