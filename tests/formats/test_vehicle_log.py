"""Drive logs without radar: written, read, refused where a radar recording is needed."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from formats.samples import make_description, make_track, write_drive
from lgprjax.formats import DriveLog, DriveWriter, OdometryTrack, VehicleLog, check_file, write_vehicle_log
from refusals import refused


def _log() -> VehicleLog:
    time_s = np.arange(4.0) * 0.5
    return VehicleLog(
        name="palm tree",
        t0_utc="2024-05-01T12:00:00Z",
        navigation=make_track(),
        odometry=OdometryTrack(np.arange(4.0), np.array([0.0, 1.0, 0.5, 2.0])),
        truth=make_track(4, sigmas=False),
        vehicle={
            "time_s": time_s,
            "steering_command_rad": 0.1 * time_s,
            "wheel_angle_rad": 0.2 * time_s,
            "rear_wheel_angle_rad": -0.1 * time_s,
            "supply_v": 24.0 + time_s,
            "encoder_counts": np.array([5.0, -7.0, 12.0, 3e9]),
        },
        serial_number="A-17",
        provenance={"made_by": "test"},
    )


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    log = _log()
    write_vehicle_log(path, log)
    assert check_file(path) == []
    found = VehicleLog.open(path)
    assert (found.name, found.t0_utc, found.serial_number) == (log.name, log.t0_utc, "A-17")
    assert found.provenance == log.provenance
    assert found.vehicle is not None
    assert log.vehicle is not None
    assert set(found.vehicle) == set(log.vehicle)
    for name, values in log.vehicle.items():
        np.testing.assert_array_equal(found.vehicle[name], values)
    np.testing.assert_array_equal(found.navigation.latitude_deg, log.navigation.latitude_deg)
    np.testing.assert_array_equal(found.odometry.distance_m, log.odometry.distance_m)
    assert found.truth is not None
    with h5py.File(path) as store:
        assert "radar" not in store
        assert store["/vehicle/steering_command_rad"].attrs["unit"] == b"rad"


def test_a_reader_of_radar_says_that_there_is_none(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    write_vehicle_log(path, _log())
    with refused("/radar", file=path):
        DriveLog.open(path)
    # A radar needs its array.
    write_drive(tmp_path / "b.drive.h5")
    with h5py.File(tmp_path / "b.drive.h5", "r+") as store:
        del store["/array"]
    assert [(finding.place, finding.found) for finding in check_file(tmp_path / "b.drive.h5")] == [("/array", "none")]


def test_a_drive_with_radar_is_read_too(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    description = replace(make_description(), serial_number="A-17")
    with DriveWriter.create(path, description, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(2.0), np.zeros((2, 3, 8), np.uint8))
    found = VehicleLog.open(path)
    assert found.serial_number == "A-17"
    assert found.vehicle is not None
    np.testing.assert_array_equal(found.vehicle["mode"], [0, 1, 1])
    with DriveLog.open(path) as log:
        assert log.description.serial_number == "A-17"


def test_an_older_log_is_still_read(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    with h5py.File(path, "r+") as store:
        store.attrs["schema_version"] = "1.1"
    assert check_file(path) == []
    with DriveLog.open(path) as log:
        assert log.description.serial_number is None
    assert VehicleLog.open(path).serial_number is None


@pytest.mark.parametrize(
    ("change", "place", "value"),
    [
        ({"vehicle": {"time_s": np.arange(2.0), "speed": np.arange(2.0)}}, "vehicle", "speed"),
        ({"vehicle": {"time_s": np.array([1.0, 0.0])}}, "/vehicle/time_s", "1 of 2"),
        ({"vehicle": {"supply_v": np.zeros(2)}}, "/vehicle/time_s", "none"),
        ({"t0_utc": "noon"}, "/@t0_utc", "noon"),
    ],
)
def test_a_bad_log_is_not_written(tmp_path: Path, change: dict[str, object], place: str, value: str) -> None:
    with refused(place, value):
        write_vehicle_log(tmp_path / "a.drive.h5", replace(_log(), **change))  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_an_output_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    write_vehicle_log(path, _log())
    with refused("output", "--force"):
        write_vehicle_log(path, _log())
    write_vehicle_log(path, replace(_log(), name="again"), force=True)
    assert VehicleLog.open(path).name == "again"
