"""Evidence in a record besides cells: task, people, finds, and control points that check the GNSS base.

It is written by hand as TOML and stored in the record's provenance. A control point is a mark of known coordinates that
the machine's own receiver measures before and after a session: the difference is an error that all positions of the
session share, and that no filter on board can detect.
"""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from lgprjax.config import BrokenRuleError, ConfigTable, TableKey, fill_table
from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.frames import LocalFrame

UNCHECKED_SIGMA_M = 0.05
"""Standard deviation per axis of a session's shared error without control points: a base within 10 cm."""
MOUNT_SIGMA_M = 0.01
"""Standard deviation of the mounting of antenna and tool, always added to the error from control points."""
_FAR_M = 5.0


class ControlPoint(ConfigTable):
    """A control point: its known and its measured position.

    Attributes:
        name: name of the mark.
        latitude_deg, longitude_deg: known position.
        measured_latitude_deg, measured_longitude_deg: position by the machine's receiver, from the same base.
        when: whether it was measured before or after the session.
        run: folder of the session; ``None``: all sessions.
        sigma_m: standard deviation of the measurement, per axis.
    """

    name: str = Field(min_length=1)
    latitude_deg: float = Field(ge=-90.0, le=90.0)
    longitude_deg: float = Field(ge=-180.0, le=180.0)
    measured_latitude_deg: float = Field(ge=-90.0, le=90.0)
    measured_longitude_deg: float = Field(ge=-180.0, le=180.0)
    when: Literal["before", "after"]
    run: str | None = None
    sigma_m: float = Field(default=0.01, ge=0.0, le=1.0)


class Find(ConfigTable):
    """A find, or a detonation.

    Attributes:
        kind: find or detonation.
        time_utc: time in UTC, ISO 8601.
        latitude_deg, longitude_deg: position.
        note: free text.
    """

    kind: Literal["find", "detonation"]
    time_utc: str
    latitude_deg: float = Field(ge=-90.0, le=90.0)
    longitude_deg: float = Field(ge=-180.0, le=180.0)
    note: str = ""

    @model_validator(mode="after")
    def _dated(self) -> "Find":
        try:
            datetime.fromisoformat(self.time_utc)
        except ValueError:
            raise BrokenRuleError("time_utc", "ISO 8601, such as 2026-03-01T10:12:00", self.time_utc) from None
        return self

    @property
    def utc(self) -> str:
        """The time with its zone; UTC if none is stated."""
        time = datetime.fromisoformat(self.time_utc)
        return (time if time.tzinfo is not None else time.replace(tzinfo=UTC)).astimezone(UTC).isoformat()


class Evidence(ConfigTable):
    """A file of evidence.

    Attributes:
        task, hazard_area: numbers or names of the task and of the hazard area.
        machine: identity of the machine.
        operator: name of the operator.
        control_point, find: control points, and finds or detonations.
    """

    task: str = ""
    hazard_area: str = ""
    machine: str = ""
    operator: str = ""
    control_point: list[ControlPoint] = Field(default_factory=list)
    find: list[Find] = Field(default_factory=list)


class SharedError(NamedTuple):
    """Error shared by all positions of a session.

    Attributes:
        sigma_m: standard deviation per axis, added to every covariance.
        east_m, north_m: mean of measured minus known position; NaN without control points. It is not corrected.
        points: number of measurements.
        before, after: whether a point was measured before, and after the session.
        change_m: change from before to after; NaN unless both were measured.
    """

    sigma_m: float
    east_m: float
    north_m: float
    points: int
    before: bool
    after: bool
    change_m: float

    @property
    def sentence(self) -> str:
        """The error as a sentence."""
        if not self.points:
            return f"no control point was measured: sigma grows by an assumed {100.0 * self.sigma_m:.1f} cm per axis"
        east_cm, north_cm = (round(100.0 * each, 1) + 0.0 for each in (self.east_m, self.north_m))
        off = f"{east_cm:.1f} cm east, {north_cm:.1f} cm north off"
        missing = [word for word, there in (("before", self.before), ("after", self.after)) if not there]
        told = f", none measured {' or '.join(missing)} the session" if missing else ""
        changed = "" if math.isnan(self.change_m) else f", changed by {100.0 * self.change_m:.1f} cm"
        measured = f"control points measured {self.points} time{'s' if self.points > 1 else ''}"
        return f"{measured}: {off}{changed}{told}; sigma grows by {100.0 * self.sigma_m:.1f} cm per axis"


def read_evidence(path: str | Path) -> Evidence:
    """Read a file of evidence.

    Raises:
        InputError: missing, not TOML, a key or a value that is not as expected, or a control point measured far away.
    """
    file = Path(path)
    held = fill_table(Evidence, TableKey(file), load_toml(file))
    for number, point in enumerate(held.control_point, start=1):
        away_m = float(np.hypot(*_residual_m(point)))
        if away_m > _FAR_M:
            expected = f"within {_FAR_M:g} m of the mark"
            raise InputError(file, f"control_point[{number}]", expected, f"{away_m:.1f} m: {point.name}")
    return held


def shared_error(points: Sequence[ControlPoint], run: str | None = None) -> SharedError:
    """Shared error of a session, estimated from control points.

    The mean residual is not corrected, because the mark or the base may be wrong: it counts in full, as one sigma. The
    change from before to after counts as well, and so does the uncertainty of the measurements. Without a point both
    before and after, sigma is at least that of an unchecked session.

    Args:
        points: control points of the evidence.
        run: folder of the session; points of other sessions are left out.
    """
    own = [each for each in points if each.run is None or each.run == run]
    if not own:
        return SharedError(
            sigma_m=UNCHECKED_SIGMA_M,
            east_m=math.nan,
            north_m=math.nan,
            points=0,
            before=False,
            after=False,
            change_m=math.nan,
        )
    residual = np.array([_residual_m(each) for each in own])
    mean = residual.mean(axis=0)
    early = np.array([each.when == "before" for each in own])
    both = bool(early.any() and not early.all())
    change_m = float(np.hypot(*(residual[~early].mean(axis=0) - residual[early].mean(axis=0)))) if both else math.nan
    measured_m2 = float(np.mean([each.sigma_m**2 for each in own])) / len(own)
    spread_m2 = float(residual.var(axis=0, ddof=1).max()) / len(own) if len(own) > 1 else 0.0
    moved_m2 = 0.0 if math.isnan(change_m) else change_m**2
    sigma_m = math.sqrt(float(np.max(mean**2)) + moved_m2 + max(measured_m2, spread_m2) + MOUNT_SIGMA_M**2)
    if not both:
        sigma_m = max(sigma_m, UNCHECKED_SIGMA_M)
    return SharedError(
        sigma_m=sigma_m,
        east_m=float(mean[0]),
        north_m=float(mean[1]),
        points=len(own),
        before=bool(early.any()),
        after=not bool(early.all()),
        change_m=change_m,
    )


def evidence_json(held: Evidence, runs: Sequence[str]) -> dict[str, Any]:
    """Evidence as JSON for the provenance of a record."""
    told = held.model_dump(mode="json")
    told["find"] = [{**each.model_dump(mode="json"), "time_utc": each.utc} for each in held.find]
    errors = {run: shared_error(held.control_point, run) for run in runs}
    told["shared_error"] = {
        run: {"sigma_m": round(each.sigma_m, 4), "sentence": each.sentence} for run, each in errors.items()
    }
    return told


def shared_error_lines(evidence: dict[str, Any]) -> list[tuple[str, str]]:
    """Label and sentence on the GNSS base for each run of a record's evidence; one line if all runs agree."""
    told = {run: str(each["sentence"]) for run, each in evidence.get("shared_error", {}).items()}
    if len(told) > 1 and len(set(told.values())) == 1:
        return [("base, every run", next(iter(told.values())))]
    return [(f"base, {run}", sentence) for run, sentence in told.items()]


def _residual_m(point: ControlPoint) -> tuple[float, float]:
    """Measured minus known position, east and north, m."""
    return residual_of(point.model_dump())


def residual_of(point: dict[str, Any]) -> tuple[float, float]:
    """Measured minus known position, east and north, m, of a control point of a record."""
    frame = LocalFrame(float(point["latitude_deg"]), float(point["longitude_deg"]), 0.0)
    latitude, longitude = (np.array([float(point[f"measured_{name}_deg"])]) for name in ("latitude", "longitude"))
    east, north, _ = frame.to_local(latitude, longitude, np.zeros(1))
    return float(east[0]), float(north[0])
