"""What a run of the devices is asked for: SPEC.json."""

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lgprjax.errors import InputError


class StageSpec(BaseModel):
    """A run of the devices. Paths are as the program's working folder has them.

    Attributes:
        seed, length_m, scan_share: of the course, see ``OffRoad``.
        weather: of the day.
        drive_seed: of the day and of all errors.
        map: the course's map, whose frame poses are in.
        ports: where the devices' addresses are written to.
        truth: where the truth is written to at the end.
        script: what the driver does.
        faults: what goes wrong.
        start_m: way along the baseline at which the vehicle stands.
        rate: world's seconds in one of the computer's.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int
    length_m: float = Field(gt=0.0)
    scan_share: Literal[1, 2, 3, 4, 5, 6] = 1
    weather: Literal["clear", "snow", "rain", "frost", "years", "repaired"] = "clear"
    drive_seed: int
    map: str
    ports: str
    truth: str
    script: list[dict[str, Any]] = []
    faults: list[dict[str, Any]] = []
    start_m: float = Field(default=2.0, ge=0.0)
    rate: float = Field(default=1.0, gt=0.0, le=10.0)


def read_spec(path: Path) -> StageSpec:
    """A spec from its file.

    Raises:
        InputError: it is missing, no JSON, or a key is unknown, missing or not as expected.
    """
    try:
        return StageSpec.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(path, place, first["msg"], repr(first["input"])[:60]) from None
    except ValueError as error:
        raise InputError(path, "file", "JSON", str(error)) from None
