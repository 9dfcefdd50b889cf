"""``lgprjax tune`` and the drives that it works on: a new vehicle file, pictures, figures; one line where it cannot."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from canon.commands import run, succeed
from lgprjax.formats import VehicleLog, check_file, read_vehicle, write_vehicle_log

_DRIVES = """
kind = "vehicle_drives"
seed = 3
serial_number = "A-17"
[vehicle]
wheelbase_m = 3.2
rear = 0.55
characteristic_speed_mps = 25.0
potentiometer_straight_v = 2.5
potentiometer_per_rad_v = [1.8]
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
[[drive]]
name = "tree"
manoeuvre = "palm_tree"
pause_s = 0.5
[[drive]]
name = "turns"
manoeuvre = "turns"
speeds_mps = [1.5, 4, 6, 8]
angles_deg = [5, -5]
[[drive]]
name = "steering"
manoeuvre = "steering_steps"
sizes_deg = [2, 8]
speed_mps = 2
hold_s = 2
[[drive]]
name = "pedals"
manoeuvre = "pedal_steps"
throttles = [0.3, 0.5, 0.4, 0.6, 0.35]
brakes = [0.4, 0.6, 0.5, 0.35, 0.3]
"""
_VEHICLE = """
schema = "lgprjax.vehicle"
schema_version = "1.1"
name = "test"
steering_kind = "counter_steer"
serial_number = "A-17"
[chassis]
wheelbase_m = 3.2
[steering]
largest_wheel_angle_rad = 0.5236
potentiometer_v_per_rad = 1.8
rear_ratio = 0.55
characteristic_speed_mps = 25.0
nominal_v = 24.0
stall_v = 10.0
backlash_rad = 0.00524
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drives and a vehicle file."""
    path = tmp_path_factory.mktemp("tune")
    (path / "drives.toml").write_text(_DRIVES)
    (path / "a.vehicle.toml").write_text(_VEHICLE)
    succeed("simulate", path / "drives.toml", "-o", path / "logs")
    return path


def study(folder: Path, name: str, kind: str, log: str, **keys: str) -> Path:
    path = folder / f"{name}.toml"
    lines = [f'name = "{name}"', f'kind = "{kind}"', f'logs = ["{log}"]']
    lines += [f"{key} = {value}" for key, value in {"vehicle": '"a.vehicle.toml"', **keys}.items()]
    path.write_text("\n".join(lines))
    return path


def test_drives_are_logs_without_radar(folder: Path) -> None:
    for name in ("standing", "straight", "tree", "turns", "steering", "pedals"):
        assert check_file(folder / "logs" / f"{name}.drive.h5") == []
    log = VehicleLog.open(folder / "logs" / "straight.drive.h5")
    assert log.serial_number == "A-17"
    assert log.truth is not None
    # Each is at the true place but for its noise: 2 cm are 1.8e-7 degrees of latitude.
    truth = np.interp(log.navigation.time_s, log.truth.time_s, log.truth.latitude_deg)
    assert np.std(log.navigation.latitude_deg - truth) * 111_000.0 == pytest.approx(0.02, rel=0.15)


def test_a_study_gives_a_new_vehicle_file(folder: Path, tmp_path: Path) -> None:
    before = (folder / "a.vehicle.toml").read_bytes()
    path = study(folder, "enc", "encoder", "logs/standing.drive.h5", serial_number='"A-17"')
    said = succeed("tune", path, "-o", tmp_path / "out", "--json", tmp_path / "enc.json")
    assert "steering.encoder_counts_per_rad" in said
    assert (folder / "a.vehicle.toml").read_bytes() == before
    vehicle = read_vehicle(tmp_path / "out" / "a.vehicle.toml")
    found = vehicle.found["steering.encoder_counts_per_rad"]
    assert isinstance(found.low, float)
    assert isinstance(found.high, float)
    assert found.low < 12000.0 < found.high
    assert (found.study, found.log) == ("enc", "standing.drive.h5")
    assert vehicle.steering.rear_ratio == 0.55
    assert imread(tmp_path / "out" / "enc.encoder.png").std() > 0.01
    figures = json.loads((tmp_path / "enc.json").read_text())
    assert figures["found"]["steering.encoder_counts_per_rad"]["low"] == found.low
    assert "--force" in run("tune", path, "-o", tmp_path / "out").refusal.expected
    succeed("tune", path, "-o", tmp_path / "out", "--force")
    # Over the study's own vehicle file never.
    assert run("tune", path, "-o", folder, "--force").status == 1
    assert (folder / "a.vehicle.toml").read_bytes() == before


def test_a_palm_tree_is_judged_by_the_truth(folder: Path, tmp_path: Path) -> None:
    path = study(folder, "tree", "wheel_angle", "logs/tree.drive.h5")
    succeed("tune", path, "-o", tmp_path / "out")
    vehicle = read_vehicle(tmp_path / "out" / "a.vehicle.toml")
    assert vehicle.wheel_map is not None
    volts = vehicle.wheel_map.first_v + vehicle.wheel_map.step_v * np.arange(len(vehicle.wheel_map.front_rad))
    wrong_deg = np.degrees(vehicle.wheel_map.front_rad - (volts - 2.5) / 1.8)
    assert np.sqrt(np.mean(wrong_deg**2)) < 0.2
    assert {p.name for p in (tmp_path / "out").glob("*.png")} == {"tree.palm_tree.png", "tree.wheel_angle.png"}


@pytest.mark.parametrize(
    ("kind", "log", "truths"),
    [
        ("rear_ratio", "tree", {"steering.rear_ratio": (0.55, 0.01)}),
        ("straight", "straight", {"steering.straight_potentiometer_v": (2.5, 0.002)}),
    ],
)
def test_studies_find_the_vehicle_that_was_driven(  # every kind: tests/studies
    folder: Path, tmp_path: Path, kind: str, log: str, truths: dict[str, tuple[float, float]]
) -> None:
    succeed("tune", study(folder, kind, kind, f"logs/{log}.drive.h5"), "-o", tmp_path / "out")
    vehicle = read_vehicle(tmp_path / "out" / "a.vehicle.toml")
    for place, (truth, away) in truths.items():
        table, _, key = place.partition(".")
        value = getattr(getattr(vehicle, table), key)
        assert abs(value - truth) < away, place
        found = vehicle.found[place]
        assert isinstance(found.low, float)
        assert isinstance(found.high, float)
        assert found.low < value < found.high
        assert found.high - found.low < 4.0 * away
    (picture,) = (tmp_path / "out").glob("*.png")
    assert imread(picture).std() > 0.01


def test_measured_rear_angles_become_a_map(folder: Path, tmp_path: Path) -> None:
    path = study(folder, "rear", "rear_ratio", "logs/standing.drive.h5", options='{ method = "rear_map" }')
    assert " k " in succeed("tune", path, "-o", tmp_path / "out")
    vehicle = read_vehicle(tmp_path / "out" / "a.vehicle.toml")
    assert vehicle.rear_map is not None
    front = vehicle.rear_map.first_rad + vehicle.rear_map.step_rad * np.arange(len(vehicle.rear_map.rear_rad))
    np.testing.assert_allclose(vehicle.rear_map.rear_rad, 0.55 * front, atol=2e-3)


def test_logs_that_do_not_tell_enough_are_refused(folder: Path, tmp_path: Path) -> None:
    for kind, log, place, value in (
        ("straight", "standing", "straight potentiometer value", "40 m"),
        ("encoder", "straight", "encoder against potentiometer", ""),
        ("servo", "tree", "/vehicle/steering_command_rad", ""),
        ("pedals", "tree", "throttle and brake", ""),
        ("yaw_gain", "tree", "turning tests", ""),
    ):
        done = run("tune", study(folder, "no", kind, f"logs/{log}.drive.h5"), "-o", tmp_path / "out")
        assert done.status == 1
        done.refusal.check(place, value)
    assert not (tmp_path / "out").exists()


def test_the_pedals_of_a_kit_that_only_steers_are_refused(folder: Path, tmp_path: Path) -> None:
    text = _VEHICLE.replace("[chassis]", "speed_control = false\n[chassis]")
    (folder / "only.vehicle.toml").write_text(text)
    path = study(folder, "only", "pedals", "logs/pedals.drive.h5", vehicle='"only.vehicle.toml"')
    run("tune", path, "-o", tmp_path / "out").refusal.check("speed_control", file="only.vehicle.toml")


def test_another_vehicle_is_refused(folder: Path, tmp_path: Path) -> None:
    path = study(folder, "other", "encoder", "logs/standing.drive.h5", serial_number='"B-1"')
    run("tune", path, "-o", tmp_path / "out").refusal.check("serial_number", file=path)
    log = VehicleLog.open(folder / "logs" / "standing.drive.h5")
    write_vehicle_log(tmp_path / "b.drive.h5", VehicleLog(**{**vars(log), "serial_number": "B-1"}))
    path = study(folder, "other", "encoder", str(tmp_path / "b.drive.h5"))
    run("tune", path, "-o", tmp_path / "out").refusal.check("/vehicle@serial_number", file="b.drive.h5")


@pytest.mark.parametrize(
    ("old", "new", "file", "place", "value"),
    [
        ("kind =", "sort =", "bad.toml", "sort", "held_out, kind, logs"),
        ('"encoder"', '"angle"', "bad.toml", "kind", "'straight', 'encoder'"),
        ('name = "bad"', 'name = "a b"', "bad.toml", "name", "a b"),
        ("logs =", "log =", "bad.toml", "log", "logs"),
        ('logs = ["x.drive.h5"]', "logs = []", "bad.toml", "logs", ""),
        ("x.drive.h5", "none.drive.h5", "none.drive.h5", "file", ""),
        ("a.vehicle.toml", "b.vehicle.toml", "b.vehicle.toml", "file", ""),
        ("kind", "held_out = ['x.drive.h5']\nkind", "bad.toml", "held_out", ""),
        ("kind", "options = 3\nkind", "bad.toml", "options", "3"),
        ("logs", "options = { degree = 2 }\nlogs", "bad.toml", "options.degree", "encoder"),
    ],
)
def test_a_bad_study_is_one_line(
    folder: Path, tmp_path: Path, old: str, new: str, file: str, place: str, value: str
) -> None:
    path = study(folder, "bad", "encoder", "x.drive.h5")
    if "degree" in new:
        path = study(folder, "bad", "encoder", "logs/standing.drive.h5")
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    done = run("tune", path, "-o", tmp_path / "out")
    assert done.status == 1
    done.refusal.check(place, value, file=file)
