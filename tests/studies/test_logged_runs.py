"""Studies of logged runs through ``lgprjax tune``: tracking, the loop, the look-ahead; wrong logs and held-out ones."""

import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from formats.run_log_sample import head_bytes, own_bytes, record_bytes
from lgprjax.errors import InputError
from lgprjax.formats import Study, VehicleLog, check_file, read_fixes, read_study, read_vehicle
from lgprjax.formats.fixes import read_fix_poses
from lgprjax.frames import LocalFrame
from lgprjax.run_records import payload_type
from lgprjax.tuning.logged_look_ahead import SETTLED_M
from lgprjax.tuning.studies.needs import NEEDS
from lgprjax.tuning.studies.steering import FinishedStudy, run_study
from recordings.run_sample import MONO_NS, record
from recordings.run_sample import frame as frame_of
from refusals import refused
from studies.commands import run

_TUNING = Path(__file__).parents[2] / "tuning"
_VEHICLE = _TUNING / "tracking.vehicle.toml"
_FLAIL = _TUNING.parent / "onboard" / "made_up_flail.vehicle.toml"
# Which log fits which study; a drive with nothing but pedals goes straight, one of steps of the steering does so for
# half of its time, palm tree and turns both hold turns, and an autopilot that begins beside its path steps the command.
_FITS = {
    "straight": ("straight", "pedals", "steering"),
    "encoder": ("standing",),
    "wheel_angle": ("palm_tree",),
    "rear_ratio": ("palm_tree", "turns"),
    "rear_map": ("standing", "palm_tree", "turns", "first"),
    "yaw_gain": ("turns",),
    "servo": ("steering", "first"),
    "pedals": ("pedals",),
    "tracking": ("first", "run"),
    "loop": ("steering", "first", "run"),
    "look_ahead": ("steering", "first", "run"),
    "fusion": (),  # one drive is too short for its noises
    "threshold": (),
}
_LOGS = ("straight", "standing", "palm_tree", "turns", "steering", "pedals")
_ALL_LOGS = (*_LOGS, "first", "run")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drives by the autopilot, and calibration drives."""
    base = tmp_path_factory.mktemp("logged")
    shutil.copytree(_TUNING, base / "tuning")
    # Where the shipped studies look for them.
    folder = base / "out" / "drives"
    driven = ("first", "second", "held_out")
    assert run("simulate", _TUNING / "tracking_drives.toml", "-o", folder, "--only", *driven) == 0
    assert run("simulate", _TUNING / "drives.toml", "-o", folder, "--only", *_LOGS) == 0
    assert all((folder / f"{name}.drive.h5").is_file() for name in _LOGS)
    return folder


@pytest.fixture(scope="module")
def recorded(logs: Path) -> np.ndarray:
    """The second drive as a run's records beside the logs; the offsets while the autopilot steered."""
    return write_run_of(logs / "second", logs / "run")


def shipped(logs: Path, name: str) -> Path:
    """A study as it is shipped, beside the drives."""
    return logs.parents[1] / "tuning" / f"{name}.toml"


def study(kind: str, logs: Path, *names: str, held_out: tuple[str, ...] = (), **options: object) -> Study:
    fit, judge = (tuple(logs / f"{name}.drive.h5" for name in group) for group in (names, held_out))
    return Study(Path("s.toml"), kind, kind, _VEHICLE, None, fit, judge, options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def loop(logs: Path) -> FinishedStudy:
    return run_study(read_study(shipped(logs, "loop")))


def test_the_loop_of_ordinary_drives_is_that_of_the_vehicle(loop: FinishedStudy) -> None:
    truths = {
        "steering.lag_s": 0.2,
        "steering.delay_s": 0.08,
        "steering.rear_ratio": 0.6,
        "steering.characteristic_speed_mps": 18.0,
    }
    for path, truth in truths.items():
        found = loop.outcome.found[path]
        assert not isinstance(found, list)
        assert found.value == pytest.approx(truth, rel=0.15), path
        assert found.high - found.low < truth
    rate = loop.outcome.found["steering.largest_wheel_rate_radps"]
    assert not isinstance(rate, list)
    assert rate.value == pytest.approx(0.45, rel=0.04)
    figures = {figure.name: figure.value for figure in loop.outcome.figures}
    driven, rolled = (figures[f"held out, held_out.drive.h5: offset {how}, rms"] for how in ("as driven", "by rollout"))
    assert rolled == pytest.approx(driven, rel=0.2)


def test_tracking_is_that_of_the_truth(logs: Path, tmp_path: Path) -> None:
    assert run("tune", shipped(logs, "tracking"), "-o", tmp_path / "out", "--json", tmp_path / "t.json") == 0
    # Nothing of the vehicle was found: there is no new file of it.
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"tracking.tracking.png"}
    figures = {figure["name"]: figure for figure in json.loads((tmp_path / "t.json").read_text())["figures"]}
    plan = VehicleLog.open(logs / "second.drive.h5").plan
    assert plan is not None
    offset = plan["cross_track_m"][np.isfinite(plan["cross_track_m"])]
    assert figures["second.drive.h5: offset, rms"]["value"] == pytest.approx(np.sqrt(np.mean(offset**2)), rel=0.1)
    assert figures["engaged at -3 m: share that settled within 0.1 m"]["value"] == 1.0
    assert 0.0 < figures["engaged at -3 m: overshoot, median"]["value"] < 0.4
    assert not [name for name in figures if name.startswith("driver")]
    assert not [name for name in figures if "limit cycle" in name]


def test_the_look_ahead_comes_from_logs_with_its_interval(logs: Path, tmp_path: Path) -> None:
    whole = shipped(logs, "look_ahead_logs").read_text()
    assert "draws = 1024 " in whole
    quick = shipped(logs, "quick_look_ahead")
    quick.write_text(whole.replace("draws = 1024 ", 'draws = 256\nsteps = 15\ncourses = ["line"] '))
    assert run("tune", quick, "-o", tmp_path / "out", "--json", tmp_path / "l.json") == 0
    target = tmp_path / "out" / _VEHICLE.name
    assert check_file(target) == []
    pursuit = read_vehicle(target).pursuit
    assert pursuit.short_m is not None
    assert pursuit.weak_exponent is not None
    assert 0.5 < pursuit.short_m < 4.0
    assert 0.1 < pursuit.weak_exponent < 2.0
    assert pursuit.least_torque_share == 0.43
    table = json.loads((tmp_path / "l.json").read_text())
    assert table["logs"] == ["first.drive.h5", "second.drive.h5"]
    best = next(figure for figure in table["figures"] if figure["name"].startswith("best at 4.47"))
    assert best["low"] <= best["value"] <= best["high"]
    # What to drive next, and by how much that narrows it.
    assert any("%" in note and "43%" not in note for note in table["notes"])
    weak = [figure for figure in table["figures"] if "oscillation left" in figure["name"] and "43%" in figure["name"]]
    unsettled = [note for note in table["notes"] if f"{SETTLED_M:g} m" in note]
    assert weak
    assert any("43%" in note for note in unsettled) == any(figure["high"] > SETTLED_M for figure in weak)


def test_the_rear_map_of_a_constant_ratio_is_a_line(logs: Path) -> None:
    found = run_study(read_study(shipped(logs, "rear_map"))).vehicle.rear_map
    assert found is not None
    front = found.first_rad + found.step_rad * np.arange(len(found.rear_rad))
    np.testing.assert_allclose(found.rear_rad, 0.63 * front, atol=2e-3)


def test_every_kind_of_study_has_an_example() -> None:
    studies = [read_study(path) for path in _TUNING.glob("*.toml") if "logs = [" in path.read_text()]
    kinds = {"rear_map" if each.options.get("method") == "rear_map" else each.kind for each in studies}
    assert kinds == set(NEEDS)


def test_every_kind_of_study_is_tried_on_every_kind_of_log() -> None:
    assert set(_FITS) == set(NEEDS)
    assert {name for names in _FITS.values() for name in names} == set(_ALL_LOGS)


@pytest.mark.parametrize("kind", _FITS)
def test_a_log_of_the_wrong_kind_is_refused(kind: str, logs: Path, recorded: np.ndarray) -> None:
    del recorded
    for name in _ALL_LOGS:
        if name in _FITS[kind]:
            continue
        asked = study(kind, logs)
        if kind == "rear_map":  # a method of its own
            asked = study("rear_ratio", logs, method="rear_map")
        if kind == "threshold":  # of a vehicle that could have such a run
            asked = asked._replace(vehicle=_FLAIL)
        path = logs / (name if name == "run" else f"{name}.drive.h5")
        with pytest.raises(InputError) as told:
            run_study(asked._replace(logs=(path,)))
        # Of the log, or of the fixes that are not beside it.
        assert told.value.file.startswith(str(logs / name))


def test_nothing_is_written_that_a_held_out_drive_contradicts(logs: Path, tmp_path: Path) -> None:
    """Turns and a palm tree of a vehicle with another rear ratio, and a drive whose rear wheels do not steer."""
    other = (_TUNING / "drives.toml").read_text().replace("rear = 0.63", "rear = 0.7")
    (tmp_path / "other.toml").write_text(other)
    assert run("simulate", tmp_path / "other.toml", "-o", tmp_path, "--only", "turns", "palm_tree") == 0
    table = f'name = "k"\nkind = "rear_ratio"\nvehicle = "{_VEHICLE}"\nlogs = ["{logs / "turns.drive.h5"}"]\n'
    (tmp_path / "good.toml").write_text(table)
    (tmp_path / "bad.toml").write_text(table + 'held_out = ["turns.drive.h5"]\n')
    assert run("tune", tmp_path / "good.toml", "-o", tmp_path / "good") == 0
    assert (tmp_path / "good" / _VEHICLE.name).exists()
    with refused("steering.rear_ratio, held out"):
        run_study(read_study(tmp_path / "bad.toml"))
    assert run("tune", tmp_path / "bad.toml", "-o", tmp_path / "out") == 1
    assert not (tmp_path / "out" / _VEHICLE.name).exists()
    rear = study("rear_ratio", logs, "palm_tree", method="rear_map")
    # Its turns reach over part of the map only.
    run_study(rear._replace(held_out=(logs / "turns.drive.h5",)))
    with refused("rear_map, held out"):
        run_study(rear._replace(held_out=(tmp_path / "palm_tree.drive.h5",)))
    other = (_TUNING / "tracking_drives.toml").read_text().replace("rear = 0.6", "rear = 0.0")
    (tmp_path / "tracking.toml").write_text(other)
    assert run("simulate", tmp_path / "tracking.toml", "-o", tmp_path, "--only", "held_out") == 0
    with refused("yaw rate, held out"):
        run_study(study("loop", logs, "first")._replace(held_out=(tmp_path / "held_out.drive.h5",)))


def test_a_recorded_run_is_a_log(logs: Path, recorded: np.ndarray) -> None:
    """The loop is that of the drive log, the tracking that of the truth."""
    fit = run_study(study("loop", logs)._replace(logs=(logs / "run",)))
    lag = fit.outcome.found["steering.lag_s"]
    assert not isinstance(lag, list)
    assert lag.value == pytest.approx(0.2, rel=0.15)
    tracked = run_study(study("tracking", logs)._replace(logs=(logs / "run",)))
    figures = {figure.name: figure.value for figure in tracked.outcome.figures}
    assert figures["run: offset, rms"] == pytest.approx(np.sqrt(np.mean(recorded**2)), rel=0.1)


def write_run_of(log_path: Path, folder: Path) -> np.ndarray:
    """Records of a drive log and its fixes; the offsets while the autopilot steered."""
    log = VehicleLog.open(log_path.with_suffix(".drive.h5"))
    vehicle, plan, track = log.vehicle, log.plan, log.navigation
    assert vehicle is not None
    assert plan is not None
    frame = LocalFrame(float(track.latitude_deg[0]), float(track.longitude_deg[0]), 0.0)
    east, north, _ = frame.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    yaw = np.unwrap(frame.yaw_of_heading(track.heading_deg, track.longitude_deg))
    sent = []
    for number, at_s in enumerate(vehicle["time_s"]):
        x, y, angle = (float(np.interp(at_s, track.time_s, part)) for part in (east, north, yaw))
        rate, mode = float(vehicle["yaw_rate_radps"][number]), int(vehicle["mode"][number])
        metres = float(np.interp(at_s, log.odometry.time_s, log.odometry.distance_m))
        off = float(np.interp(at_s, plan["time_s"], plan["cross_track_m"]))
        front, command = float(vehicle["wheel_angle_rad"][number]), float(vehicle["steering_command_rad"][number])
        now = MONO_NS + int(1e9 * at_s)
        status = struct.pack("<IBHHfiffBffdf", number, 3, 0, 0, 2.5, number, 24.0, 0.1, 0, 0.25, 0.0, metres, 2.0)
        raw = frame_of(0x21, status, session=5, sequence=number, stamp_us=int(1e6 * at_s))
        sent.append(record(2, 1, now, raw))
        prior = struct.pack("<qB8d", now, 1, x, y, angle, 0.0, 0.002, 4.5, rate, metres)
        sent.append(record(7, 10, now + 10_000, prior))
        row = (mode, 1, 0, 0, 0, x, y, angle, 0.05, 4.5, 4.5, off, 30.0, front, command, 0.2, 0.0, 3, 0, 0)
        sent.append(record(12, 10, now + 20_000, struct.pack("<BBBII3d6f3fBIB", *row)))
    _, covariance = read_fix_poses(log_path.with_suffix(".fixes.h5"))
    table = read_fixes(log_path.with_suffix(".fixes.h5"))
    assert covariance is not None
    longitude = table["longitude_deg"].to_numpy()
    fix_x, fix_y, _ = frame.to_local(table["latitude_deg"].to_numpy(), longitude, table["height_m"].to_numpy())
    heading = frame.yaw_of_heading(table["heading_deg"].to_numpy(), longitude)
    for at in np.flatnonzero(table["code"].to_numpy() == "ok"):
        fix = np.zeros((), payload_type("fix"))
        fix["scan_ns"], fix["scan"], fix["code"] = MONO_NS + int(1e9 * table["time_s"].to_numpy()[at]), at, 0
        fix["pose"] = (fix_x[at], fix_y[at], 0.0, heading[at], 0.0)
        fix["covariance"] = covariance[at]
        sent.append(record(6, 11, int(fix["scan_ns"]) + 20_000_000, fix.tobytes()))
    folder.mkdir()
    parts = [head_bytes(0, 0, mono_ns=MONO_NS), own_bytes(0, dropped={})]
    ordered = sorted(sent, key=lambda one: one.mono_ns)
    parts += [record_bytes(number, one.data) for number, one in enumerate(ordered, 1)]
    parts.append(own_bytes(len(ordered) + 1, end="ended"))
    (folder / "0000.lgprun").write_bytes(b"".join(parts))
    return np.asarray(plan["cross_track_m"][np.isfinite(plan["cross_track_m"])])
