"""Studies of a table of one's own, made by a plain plant: what they find, and what they say of a wrong file."""

from pathlib import Path

import numpy as np
import pytest

from lgprjax.formats import Study, check_file, read_study
from lgprjax.tuning.studies.steering import run_study
from refusals import printed_refusal, refused
from studies.commands import run

BASE_M, SPEED_MPS = 2.6, 1.8
_DOCS = Path(__file__).parents[2] / "docs"
_TUNING = Path(__file__).parents[2] / "tuning"
_VEHICLE = """schema = "lgprjax.vehicle"
schema_version = "1.2"
name = "mine"
serial_number = "MINE-1"
steering_kind = "counter_steer"
[chassis]
wheelbase_m = 2.6
[steering]
rear_ratio = 0.5
largest_wheel_angle_rad = 0.5
"""
_COLUMNS = {
    "time": ("stamp", "s"),
    "speed": ("speed", "m/s"),
    "latitude": ("lat", "deg"),
    "longitude": ("lon", "deg"),
    "heading": ("heading", "deg"),
    "yaw_rate": ("gyro", "deg/s"),
    "wheel_angle": ("front", "deg"),
    "rear_wheel_angle": ("rear", "deg"),
    "steering_command": ("command", "deg"),
}


def write_log(folder: Path, ratio: float, *, rear_scale: float = 1.0) -> Path:
    """Arcs to both sides at one speed, without a potentiometer."""
    draw, step_s, seconds = np.random.default_rng(8), 0.05, 180.0
    time_s = step_s * np.arange(int(seconds / step_s))
    levels = np.array([0.1, -0.1, 0.25, -0.25, 0.4, -0.4, 0.3, -0.3, 0.2, -0.2, 0.35, -0.35])
    command = levels[(time_s / 15.0).astype(int) % len(levels)]
    front = np.zeros(len(time_s))
    for row in range(1, len(time_s)):
        front[row] = front[row - 1] + (command[row - 1] - front[row - 1]) * (1.0 - np.exp(-step_s / 0.3))
    rate = SPEED_MPS * (np.tan(front) + np.tan(ratio * front)) / BASE_M
    yaw = 0.3 + step_s * np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))])
    # The rear wheels counter-steer, so that the axle moves to the right of the body in a left turn.
    away = yaw - np.arctan(np.tan(ratio * front))
    east, north = (
        np.concatenate([[0.0], np.cumsum(SPEED_MPS * step_s * 0.5 * (way[1:] + way[:-1]))])
        for way in (np.cos(away) / np.cos(ratio * front), np.sin(away) / np.cos(ratio * front))
    )
    columns = {
        "stamp": time_s,
        "lat": 48.2 + (north + 0.015 * draw.normal(size=len(time_s))) / 111_206.0,
        "lon": 16.4 + (east + 0.015 * draw.normal(size=len(time_s))) / (111_413.0 * np.cos(np.radians(48.2))),
        "heading": (90.0 - np.degrees(yaw) + 0.2 * draw.normal(size=len(time_s))) % 360.0,
        "speed": SPEED_MPS + 0.03 * draw.normal(size=len(time_s)),
        "gyro": np.degrees(rate) + 0.15 * draw.normal(size=len(time_s)),
        "front": np.degrees(front) + 0.1 * draw.normal(size=len(time_s)),
        "rear": -np.degrees(ratio * front) + 0.1 * draw.normal(size=len(time_s)),
        "command": np.degrees(command),
    }
    rows = "\n".join(",".join(f"{value:.9f}" for value in row) for row in np.stack(list(columns.values()), axis=1))
    (folder / "log.csv").write_text(",".join(columns) + "\n" + rows + "\n")
    text = 'serial_number = "MINE-1"\nt0_utc = "2026-05-01T08:00:00Z"\n'
    for name, (column, unit) in _COLUMNS.items():
        text += f'[signals.{name}]\ncolumn = "{column}"\nunit = "{unit}"\n'
        text += f"scale = {rear_scale}\n" if name == "rear_wheel_angle" else ""
    (folder / "columns.toml").write_text(text)
    (folder / "mine.vehicle.toml").write_text(_VEHICLE)
    log = folder / "log.drive.h5"
    assert run("import", "signals", folder / "log.csv", "--columns", folder / "columns.toml", "-o", log) == 0
    return log


def study(kind: str, log: Path, **options: object) -> Study:
    vehicle = log.with_name("mine.vehicle.toml")
    return Study(Path("s.toml"), kind, kind, vehicle, "MINE-1", (log,), (), options)  # type: ignore[arg-type]


def test_the_front_angle_cuts_the_turns_of_a_log_without_potentiometer(tmp_path: Path) -> None:
    ratio = np.random.default_rng(21).uniform(0.3, 0.6)
    log = write_log(tmp_path, ratio)
    found = run_study(study("rear_ratio", log, method="heading")).outcome.found["steering.rear_ratio"]
    assert not isinstance(found, list)
    # 0.005: the plant's steps and its metres a degree are no better.
    assert found.low - 0.005 < ratio < found.high + 0.005
    # One speed tells no slip: refused before any arc is fitted.
    with refused(found="1.8 to 1.8 m/s"):
        run_study(study("yaw_gain", log))


def test_rear_wheels_of_the_wrong_sign_are_said_to_be(tmp_path: Path) -> None:
    log = write_log(tmp_path, 0.4, rear_scale=-1.0)
    for method in ("wheel_angles", "rear_map"):
        with refused(file="log.drive.h5", found="k = -0.40"):
            run_study(study("rear_ratio", log, method=method))


def test_a_vehicle_file_and_a_study_are_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with refused(file="made_up.vehicle.toml"):
        read_study(_TUNING / "made_up.vehicle.toml")
    assert run("simulate", _TUNING / "k_ratio.toml", "-o", tmp_path / "x") == 1
    printed_refusal(capsys.readouterr().err).check(file="k_ratio.toml", found="lgprjax tune")


def test_the_least_vehicle_file_of_the_page_is_one_and_a_missing_header_is_named(tmp_path: Path) -> None:
    page = (_DOCS / "own_vehicle.md").read_text(encoding="utf-8")
    text = page.partition("```toml\n")[2].partition("```")[0]
    file = tmp_path / "least.vehicle.toml"
    file.write_text(text)
    assert not check_file(file)
    file.write_text(text[text.index("name") :])
    (finding,) = check_file(file)
    assert "lgprjax.vehicle" in finding.expected
