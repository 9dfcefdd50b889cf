"""What is told of the work: control points widen what is claimed less, finds and people stand in the record."""

import math
from pathlib import Path

import numpy as np
import pytest

from lgprjax.errors import InputError
from lgprjax.frames import LocalFrame
from lgprjax.worked.evidence import (
    MOUNT_SIGMA_M,
    UNCHECKED_SIGMA_M,
    ControlPoint,
    Evidence,
    evidence_json,
    read_evidence,
    shared_error,
)
from refusals import refusal_in

FRAME = LocalFrame(40.0, -100.0, 0.0)


def point(when: str, east_m: float, north_m: float, *, run: str | None = None, name: str = "A") -> ControlPoint:
    """A mark measured so far off."""
    latitude, longitude, _ = FRAME.to_geodetic(np.array([0.0, east_m]), np.array([0.0, north_m]), np.zeros(2))
    degrees = {
        "latitude_deg": float(latitude[0]), "longitude_deg": float(longitude[0]),
        "measured_latitude_deg": float(latitude[1]), "measured_longitude_deg": float(longitude[1]),
    }  # fmt: skip
    return ControlPoint.model_validate({"name": name, "when": when, "run": run, **degrees})


def test_what_control_points_say_of_the_base() -> None:
    found = shared_error([point("before", 0.03, -0.04), point("after", 0.03, -0.04)])
    assert (found.east_m, found.north_m) == pytest.approx((0.03, -0.04), abs=1e-5)
    # The larger axis in full, the measurements by their mean, the mounts.
    assert found.sigma_m == pytest.approx(math.sqrt(0.04**2 + 0.01**2 / 2 + MOUNT_SIGMA_M**2), abs=1e-5)
    assert found.change_m == pytest.approx(0.0, abs=1e-6)
    moved = shared_error([point("before", 0.0, 0.0), point("after", 0.06, 0.0)])
    assert moved.change_m == pytest.approx(0.06, abs=1e-5)
    # Half of the change is the mean, all of it is in sigma, and the spread about the mean.
    spread_m2 = (2 * 0.03**2) / 2
    assert moved.sigma_m == pytest.approx(math.sqrt(0.03**2 + 0.06**2 + spread_m2 + MOUNT_SIGMA_M**2), abs=1e-5)
    right = shared_error([point("before", 0.0, 0.0), point("after", 0.0, 0.0)])
    assert right.sigma_m < 0.02 < UNCHECKED_SIGMA_M


def test_who_does_not_measure_both_times_is_no_surer_than_who_does_not_measure() -> None:
    assert shared_error([]).sigma_m == UNCHECKED_SIGMA_M
    half = shared_error([point("before", 0.0, 0.0)])
    assert half.sigma_m == UNCHECKED_SIGMA_M
    assert half.sentence != shared_error([]).sentence
    # Points of another session tell nothing of this one.
    points = [point("before", 0.2, 0.0, run="one"), point("after", 0.2, 0.0, run="one")]
    assert shared_error(points, "two").sigma_m == UNCHECKED_SIGMA_M
    assert shared_error(points, "one").sigma_m > 0.2
    told = evidence_json(Evidence(control_point=points), ["one", "two"])
    assert set(told["shared_error"]) == {"one", "two"}


def test_a_file_is_read_and_its_faults_are_named(tmp_path: Path) -> None:
    text = """
task = "T-7"
hazard_area = "HA 12"
machine = "flail 3"
operator = "A. N."
[[find]]
kind = "detonation"
time_utc = "2026-03-01T12:30:00+02:00"
latitude_deg = 40.0
longitude_deg = -100.0
[[control_point]]
name = "M1"
when = "before"
latitude_deg = 40.0
longitude_deg = -100.0
measured_latitude_deg = 40.0000001
measured_longitude_deg = -100.0
"""
    path = tmp_path / "e.toml"
    path.write_text(text)
    held = read_evidence(path)
    assert (held.task, held.hazard_area, held.find[0].utc) == ("T-7", "HA 12", "2026-03-01T10:30:00+00:00")
    for old, new, expected in (
        ("M1", "", "name"),
        ("2026-03-01T12:30:00+02:00", "noon", "time_utc"),
        ("40.0000001", "40.001", "control_point[1]"),
        ("task =", "tusk =", "tusk"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError) as caught:
            read_evidence(path)
        assert expected in refusal_in(caught.value).place
