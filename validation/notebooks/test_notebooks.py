"""Each notebook runs from a fresh clone, and finds what it says that it finds."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from canon.notebooks import ROOT, run_notebook
from lgprjax.formats import VehicleFile, check_file, read_cover_plan, read_vehicle, read_worked
from lgprjax.simulation import read_vehicle_plan


def test_the_field_of_the_notebook_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, _ = run_notebook("coverage_record", tmp_path, monkeypatch)
    record, plan = read_worked(folder / "field.worked.h5"), read_cover_plan(folder / "field.cover.geojson")
    assert abs(plan.pattern.field.area_m2 - 12.0 * 9.0) < 0.1
    assert len(record.stops.run) == 1
    processed = np.count_nonzero(record.cells.state[0] == 2) * record.cells.cell_m**2
    # The tool also worked a strip as long as itself beyond both ends of every line.
    assert 100.0 < processed < 108.0 + 10 * 2 * 1.2 * 0.6
    assert {path.suffix for path in (folder / "export").iterdir()} == {
        *(".csv", ".geojson", ".gpkg", ".html", ".kml", ".zip")
    }


def test_the_first_registration_is_right_and_refuses_the_impostor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, printed = run_notebook("first_registration", tmp_path, monkeypatch)
    assert "'impostor': 0}" in printed
    (fixes_cm,) = re.findall(r"fixes ([\d.]+) cm", printed)
    assert float(fixes_cm) < 5.0


def test_accuracy_is_that_of_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, printed = run_notebook("accuracy", tmp_path, monkeypatch)
    found = re.findall(r"'live' on '(\w+)': \d+ scans, (\d+) of (\d+) searched are ok, at most ([\d.]+) m off", printed)
    assert [name for name, *_ in found] == ["left", "right", "both"]
    for _, ok, searched, off_m in found:
        assert int(ok) > 0.95 * int(searched)
        assert float(off_m) < 0.3


def test_an_archive_gains_by_baselines_that_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, _ = run_notebook("archive", tmp_path, monkeypatch)
    before, after = (pd.read_csv(folder / name / "archive.csv", index_col="drive") for name in ("before", "after"))
    assert before["ok"]["elsewhere"] == after["ok"]["elsewhere"] == 0
    for drive in ("clear", "snow", "years"):
        assert after["ok"][drive] >= before["ok"][drive] > 0
        assert after["correlation_ok"][drive] > before["correlation_ok"][drive] + 0.05
        assert after["ok"][drive] > 0.7 * after["tried"][drive]


def test_lines_of_ones_own_radar_are_located(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, printed = run_notebook("own_radar", tmp_path, monkeypatch)
    assert check_file(folder / "site.map.h5") == []
    ((along, across),) = re.findall(r"off by (-?[\d.]+) m along the lines, (-?[\d.]+) m across", printed)
    assert abs(float(along) - 0.4) < 0.06
    assert abs(float(across) + 0.1) < 0.06


def test_the_faults_of_the_drive_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, printed = run_notebook("drive_health", tmp_path, monkeypatch)
    assert "sound: 1819 scans, 65 m: good" in printed
    for name in ("dropped_scans", "dead_channels", "odometer_scale"):
        assert f"faulty: bad: {name}" in printed
    assert "sound: bad" not in printed


def _holds_truth(vehicle: VehicleFile, number: str, study: str, truth: float) -> None:
    found = vehicle.found[number]
    assert isinstance(found.low, float)
    assert isinstance(found.high, float)
    assert found.study == study
    assert found.low < truth < found.high


def test_calibration_drives_become_a_vehicle_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, printed = run_notebook("own_vehicle", tmp_path, monkeypatch)
    (path,) = folder.glob("*.vehicle.toml")
    assert check_file(path) == []
    vehicle = read_vehicle(path)
    truth = read_vehicle_plan(ROOT / "tuning" / "drives.toml").vehicle
    assert isinstance(truth.rear, float)
    _holds_truth(vehicle, "steering.rear_ratio", "rear_ratio", truth.rear)
    _holds_truth(vehicle, "steering.potentiometer_v_per_rad", "wheel_angle", truth.potentiometer_per_rad_v[0])
    _holds_truth(vehicle, "steering.encoder_counts_per_rad", "encoder", truth.encoder_counts_per_rad)
    _holds_truth(vehicle, "steering.lag_s", "servo", truth.lag_s)
    assert vehicle.pursuit.short_m is not None
    assert vehicle.pursuit.long_m is not None
    assert 0.0 < vehicle.pursuit.short_m < vehicle.pursuit.long_m
    by_heading, by_angles = re.findall(r"k by [a-z ]+: ([\d.]+) to ([\d.]+)", printed)
    assert float(by_heading[0]) < float(by_angles[1])
    assert float(by_angles[0]) < float(by_heading[1])


def test_the_noises_of_the_filter_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (path,) = run_notebook("fusion", tmp_path, monkeypatch)[0].glob("*.vehicle.toml")
    assert check_file(path) == []
    sensors = read_vehicle_plan(ROOT / "tuning" / "drives.toml").drives[-1].sensors
    _holds_truth(read_vehicle(path), "navigation.yaw_rate_noise", "fusion", sensors.yaw_rate_noise)


def test_logged_runs_become_a_vehicle_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, _ = run_notebook("first_tracking", tmp_path, monkeypatch)
    vehicle = read_vehicle(folder / "tracking.vehicle.toml")
    truth = read_vehicle_plan(ROOT / "tuning" / "tracking_drives.toml").vehicle
    assert vehicle.steering.lag_s == pytest.approx(truth.lag_s, rel=0.1)
    assert vehicle.steering.largest_wheel_rate_radps == pytest.approx(truth.rate_radps, rel=0.05)
    assert vehicle.steering.rear_ratio == pytest.approx(truth.rear, abs=0.04)
    assert vehicle.pursuit.weak_exponent is not None
    assert vehicle.pursuit.weak_exponent > 0.1


def test_logs_that_do_not_tell_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, printed = run_notebook("what_logs_tell", tmp_path, monkeypatch)
    assert "largest rate of the servo: not determined" in printed
    assert "vehicle file: full" in printed


def test_a_weak_servo_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, printed = run_notebook("weak_servo", tmp_path, monkeypatch)
    assert "gentle - torque of the servo against the vehicle file: not observable" in printed
    assert "first, second - torque of the servo against the vehicle file: weak" in printed
