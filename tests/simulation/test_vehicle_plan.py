"""The drives file: what is wrong is told by its key; degrees are radians; fixes beside logs that ask."""

from pathlib import Path

import numpy as np
import pytest

from lgprjax.formats import VehicleLog, check_file, read_fixes
from lgprjax.formats.fixes import read_fix_poses
from lgprjax.simulation import is_vehicle_plan, read_vehicle_plan, write_vehicle_logs
from refusals import refused

_DRIVES = """
kind = "vehicle_drives"
seed = 3
[vehicle]
rear = 0.55
[[drive]]
name = "standing"
manoeuvre = "standing"
pause_s = 1.5
[[drive]]
name = "straight"
manoeuvre = "straight"
length_m = 90
speed_mps = 3
weave_deg = 0.5
"""
_STANDING = 'manoeuvre = "standing"\npause_s = 1.5'
_COURSE = 'manoeuvre = "course"\nspeed_mps = 3.0\nradii_m = [20.0]\n'


@pytest.mark.parametrize(
    ("old", "new", "place", "values"),
    [
        ("pause_s = 1.5", "pause = 1.5", "drive[1].pause", ["pause_s"]),
        ("pause_s = 1.5", "pause_s = 0", "drive[1].pause_s", ["0.5", "120"]),
        ('"standing"\npause', '"spinning"\npause', "drive[1].manoeuvre", ["spinning"]),
        ("length_m = 90\n", "", "drive[2].length_m", []),
        ("weave_deg = 0.5", "weave_deg = 50", "drive[2].weave_deg", ["0", "11"]),
        ("weave_deg = 0.5", "weave_deg = 0.5\nweave_rad = 0.01", "drive[2].weave_deg", ["weave_rad"]),
        ("rear = 0.55", "rear = 55.0", "vehicle.rear", ["0", "1", "55"]),
        ("rear = 0.55", "stall_v = 24.0", "vehicle.stall_v", ["nominal_v", "24"]),
        ("rear = 0.55", "brake = [0.1, 0.2, 6.0, 0.25]", "vehicle.brake", []),
        ("seed = 3", "seed = -3", "seed", ["0", "-3"]),
        ('name = "straight"', 'name = "standing"', "drive[2].name", ["standing"]),
        ("[vehicle]", "[sensors]\nrecord_hz = 30.0\n[vehicle]", "sensors.record_hz", ["100", "30"]),
        ("[vehicle]", "[sensors]\noutlier_share = 2.0\n[vehicle]", "sensors.outlier_share", ["0", "2"]),
        ("[vehicle]", "[sensors]\nfix_hz = 0.0\n[vehicle]", "sensors.fix_hz", ["0.1", "100"]),
        ("[vehicle]", "[sensors]\nfix_hz = 30.0\n[vehicle]", "sensors.fix_hz", ["100", "30"]),
        ("pause_s = 1.5", 'fixes = "hail"', "drive[1].fixes", ["hail"]),
        ("pause_s = 1.5", "fixes = true", "drive[1].fixes", ["True"]),
        ("pause_s = 1.5", 'radar = "hail"', "drive[1].radar", ["hail"]),
        ("pause_s = 1.5", 'radar = "snow"', "drive[1].radar", ["tracking", "course", "standing"]),
        (_STANDING, _COURSE + 'radar = "snow"\nfixes = "clear"', "drive[1].fixes", ["register", "clear"]),
        (_STANDING, _COURSE + 'radar = "snow"', "vehicle_file", ["array"]),
        ("seed = 3", "seed = 3\nvehicle_file = 3", "vehicle_file", ["3"]),
    ],
)
def test_what_is_wrong_is_told_by_its_key(tmp_path: Path, old: str, new: str, place: str, values: list[str]) -> None:
    assert old in _DRIVES
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES.replace(old, new, 1))
    with refused(place, *values, file=path):
        read_vehicle_plan(path)


def test_degrees_are_radians_and_the_servo_has_its_vehicles_voltage(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES)
    assert is_vehicle_plan(path)
    assert not is_vehicle_plan(Path(__file__).parents[2] / "sites" / "weather.toml")
    degrees = read_vehicle_plan(path).drives[1].manoeuvre
    radians = _DRIVES.replace("weave_deg = 0.5", f"weave_rad = {float(np.radians(0.5))!r}")
    path.write_text(radians.replace("rear = 0.55", "nominal_v = 48.0\nstall_v = 24.0"))
    found = read_vehicle_plan(path)
    np.testing.assert_allclose(found.drives[1].manoeuvre.wanted_rad, degrees.wanted_rad, atol=1e-12)
    assert all(np.all(drive.manoeuvre.supply_v == 48.0) for drive in found.drives)


def test_a_tracking_drive_ends_with_its_course(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    tracking = '[[drive]]\nname = "t"\nmanoeuvre = "tracking"\nlook_ahead_m = 3.0\nspeed_mps = 4.0\n'
    path.write_text(_DRIVES + tracking + "radii_m = [9, -9, 9, -9]\n")
    write_vehicle_logs(read_vehicle_plan(path), tmp_path / "logs", only=["t"])
    log = VehicleLog.open(tmp_path / "logs" / "t.drive.h5")
    assert log.plan is not None
    # It begins where the course does: only from the next record on it is beside it.
    assert np.isfinite(log.plan["cross_track_m"][1:]).all()


def test_seeds_go_by_the_name(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES)
    standing, straight = read_vehicle_plan(path).drives
    assert standing.seed != straight.seed
    path.write_text(_DRIVES.replace('"standing"\nmanoeuvre', '"first"\nmanoeuvre'))
    assert read_vehicle_plan(path).drives[1].seed == straight.seed


def test_a_drive_that_asks_for_fixes_has_them_beside_its_log(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES.replace("weave_deg = 0.5", 'weave_deg = 0.5\nfixes = "clear"'))
    plan = read_vehicle_plan(path)
    folder = tmp_path / "logs"
    write_vehicle_logs(plan, folder)
    names = ["standing.drive.h5", "straight.drive.h5", "straight.fixes.csv", "straight.fixes.h5"]
    assert sorted(made.name for made in folder.iterdir()) == names
    assert [finding for name in names for finding in check_file(folder / name)] == []
    log, table = VehicleLog.open(folder / "straight.drive.h5"), read_fixes(folder / "straight.fixes.h5")
    assert log.vehicle is not None
    assert log.vehicle["yaw_rate_radps"].shape == log.vehicle["time_s"].shape
    assert log.truth is not None
    good = (table["code"] == "ok").to_numpy()
    assert good.mean() > 0.5
    # The array is 6.2 m ahead of the rear axle: against the truth, in level metres of the plan's frame.
    times = table["time_s"].to_numpy()[good]
    held = (log.truth.latitude_deg, log.truth.longitude_deg, log.truth.height_m)
    true = plan.frame.to_local(*(np.interp(times, log.truth.time_s, v) for v in held))
    columns = ("latitude_deg", "longitude_deg", "height_m")
    found = plan.frame.to_local(*(table[name].to_numpy()[good] for name in columns))
    ahead = np.hypot(found[0] - true[0], found[1] - true[1])
    assert ahead.mean() == pytest.approx(6.2, abs=0.03)
    pose, covariance = read_fix_poses(folder / "straight.fixes.h5")
    assert pose is not None
    assert covariance is not None
    np.testing.assert_allclose(pose[good][:, 0], found[0], atol=1e-4)
    assert np.isfinite(covariance[good]).all()
    # Nothing is written where one of the outputs exists.
    for made in folder.glob("*.drive.h5"):
        made.unlink()
    with refused("output", "--force", file="straight.fixes.csv"):
        write_vehicle_logs(plan, folder)
    assert not list(folder.glob("*.drive.h5"))


def test_a_drive_begun_beside_its_course_comes_to_it(tmp_path: Path) -> None:
    """Commands of the law, replayed by the vehicle: both begin with straight wheels."""
    path = tmp_path / "drives.toml"
    drive = 'manoeuvre = "tracking"\nspeed_mps = 3.0\nradii_m = [20.0]\nlook_ahead_m = 4.0\noffset_m = 0.6'
    path.write_text(_DRIVES.replace(_STANDING, drive))
    log = VehicleLog.open(write_vehicle_logs(read_vehicle_plan(path), tmp_path, only=["standing"])["standing"])
    assert log.plan is not None
    offset = log.plan["cross_track_m"]
    assert np.nanmax(offset) == pytest.approx(0.6, abs=0.01)
    assert np.abs(offset[-20:]).max() < 0.2


def test_a_driver_by_hand_gives_no_commands(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES.replace(_STANDING, _COURSE))
    log = VehicleLog.open(write_vehicle_logs(read_vehicle_plan(path), tmp_path, only=["standing"])["standing"])
    assert log.vehicle is not None
    assert "steering_command_rad" not in log.vehicle
    assert not np.isin(log.vehicle["mode"], [3, 4]).any()
