"""``lgprjax tune`` on a recorded run of a field: the control threshold, and the limit cycle about the lines."""

import json
import re
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from drawn_field import MONO_NS, UTC_NS, VEHICLE
from formats.run_log_sample import RUN, head_bytes, own_bytes, record_bytes
from lgprjax.formats import read_vehicle
from refusals import printed_refusal
from studies.commands import run
from tuning.swinging_drive import Drive, swinging_drive

# As data_schema/run_log.toml has it, written down once more.
_SKID_PLAN = np.dtype(
    [
        *(("mode", "u1"), ("reaction", "u1"), ("known", "u1"), ("reasons", "<u4"), ("limited", "<u4")),
        *(("pose", "<f8", (3,)), ("sigma", "<f4", (3,)), ("speed_mps", "<f4"), ("cross_m", "<f4")),
        *(("heading_error_rad", "<f4"), ("to_go_m", "<f4"), ("line", "<i4"), ("command", "<f4", (2,))),
        *(("tool", "u1"), ("depth_m", "<f4"), ("engage", "u1"), ("watch", "<u4"), ("found", "<u4")),
        ("severity", "u1"),
    ]
)
_PLAN, _CONTROL, _MANUAL, _SPEED = 14, 10, 5, 4


def write_run(folder: Path, drive: Drive) -> None:
    """A run whose ticks drove so, after some in which the operator did."""
    rows = np.zeros(len(drive.time_s), _SKID_PLAN)
    rows["mode"] = np.where(drive.time_s < 5.0, _MANUAL, _SPEED)
    rows["pose"][:, 2], rows["cross_m"] = drive.yaw_rad, drive.cross_m
    rows["command"] = 0.45 + 0.5 * drive.turn_mps[:, None] * np.array([-1.0, 1.0])
    # A turn, a line, another turn, and a line too short to swing on.
    rows["line"] = np.select([drive.time_s < 40.0, drive.time_s < 225.0, drive.time_s < 230.0], [-1, 0, -1], 1)
    folder.mkdir()
    parts = [head_bytes(0, 0, utc_ns=UTC_NS, mono_ns=MONO_NS, run=RUN), own_bytes(0, run=RUN, dropped={})]
    for number, (row, at_s) in enumerate(zip(rows, drive.time_s, strict=True), 1):
        head = struct.pack("<BBHIQ", _PLAN, _CONTROL, 0, number, MONO_NS + round(1e9 * float(at_s)))
        parts.append(record_bytes(number, head + row.tobytes(), run=RUN))
    parts.append(own_bytes(len(rows) + 1, run=RUN, end="ended"))
    (folder / "0000.lgprun").write_bytes(b"".join(parts))


def tune(
    folder: Path, drive: Drive, *, vehicle: str = VEHICLE, logs: str = '["run"]', held_out: Drive | None = None
) -> int:
    write_run(folder / "run", drive)
    (folder / "v.vehicle.toml").write_text(vehicle)
    table = f'name = "s"\nkind = "threshold"\nvehicle = "v.vehicle.toml"\nlogs = {logs}\n'
    if held_out is not None:
        write_run(folder / "judge", held_out)
        table += 'held_out = ["judge"]\n'
    (folder / "s.toml").write_text(table)
    return run("tune", folder / "s.toml", "-o", folder / "out", "--json", folder / "s.json")


def test_threshold_and_swing_of_a_run_are_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tune(tmp_path, swinging_drive(1, threshold_mps=0.3)) == 0
    found = read_vehicle(tmp_path / "out" / "v.vehicle.toml")
    assert found.skid_steer.threshold_mps == pytest.approx(0.3, rel=0.1)
    interval = found.found["skid_steer.threshold_mps"]
    assert isinstance(interval.low, float)
    assert isinstance(interval.high, float)
    assert interval.low <= 0.3 <= interval.high
    assert "1 of 1" in capsys.readouterr().out
    figures = {figure["name"]: figure["value"] for figure in json.loads((tmp_path / "s.json").read_text())["figures"]}
    assert 0.05 < figures["run: swing about the line, peak to peak"] < 1.5
    assert 2.0 < figures["run: period of the swing"] < 60.0


def test_a_vehicle_that_obeys_keeps_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tune(tmp_path, swinging_drive(2, threshold_mps=0.0)) == 0
    assert read_vehicle(tmp_path / "out" / "v.vehicle.toml").skid_steer.threshold_mps is None
    assert "0 of 1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("fitted_mps", "held_mps", "fits"), [(0.3, 0.31, True), (0.3, 0.6, False), (0.3, 0.0, False), (0.0, 0.3, False)]
)
def test_nothing_is_written_that_a_held_out_run_contradicts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], fitted_mps: float, held_mps: float, fits: bool
) -> None:
    drives = (swinging_drive(seed, threshold_mps=each) for seed, each in ((1, fitted_mps), (2, held_mps)))
    assert tune(tmp_path, next(drives), held_out=next(drives)) == (0 if fits else 1)
    assert (tmp_path / "out" / "v.vehicle.toml").exists() == fits
    if not fits:
        refusal = printed_refusal(capsys.readouterr().err)
        assert "threshold_mps" in refusal.place
        found = [float(number) for number in re.findall(r"0\.\d+", refusal.found)]
        assert found[:1] == ([pytest.approx(held_mps, rel=0.15)] if held_mps else [])


@pytest.mark.parametrize(
    ("changes", "place", "value"),
    [
        ({"vehicle": VEHICLE.replace('skid_steer"', 'counter_steer"')}, "steering_kind", "skid_steer"),
        ({"logs": '["run", "run2"]'}, "logs", "2"),
        ({"logs": '["nowhere"]'}, "folder", ""),
    ],
)
def test_what_tells_nothing_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict[str, str], place: str, value: str
) -> None:
    vehicle, logs = changes.get("vehicle", VEHICLE), changes.get("logs", '["run"]')
    assert tune(tmp_path, swinging_drive(3, threshold_mps=0.3, records=300), vehicle=vehicle, logs=logs) == 1
    printed_refusal(capsys.readouterr().err).check(place, value)


def test_the_example_study_reads_the_run_of_a_field(tmp_path: Path) -> None:
    """The vehicle goes straight only while it is steered a little, and obeys."""
    root = Path(__file__).parents[2]
    for name in ("tuning", "onboard"):
        shutil.copytree(root / name, tmp_path / name)
    runs = tmp_path / "out" / "onboard" / "runs"
    runs.mkdir(parents=True)
    write_run(runs / "field", swinging_drive(4, threshold_mps=0.0, veer_radps=0.01))
    assert run("tune", tmp_path / "tuning" / "threshold.toml", "-o", tmp_path / "out" / "tuned") == 0
    (written,) = (tmp_path / "out" / "tuned").glob("*.vehicle.toml")
    assert "skid_steer.threshold_mps" not in read_vehicle(written).found
