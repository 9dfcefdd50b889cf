"""Studies of logged runs through ``lgprjax tune``: tracking, the loop, the look-ahead; wrong logs and held-out ones."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli.test_tune import run
from lgprjax.errors import InputError
from lgprjax.formats import Study, VehicleLog, check_file, read_study, read_vehicle
from lgprjax.studies.steering import FinishedStudy, run_study

_TUNING = Path(__file__).parents[2] / "tuning"
_VEHICLE = _TUNING / "tracking.vehicle.toml"
_KINDS = (
    "straight",
    "encoder",
    "wheel_angle",
    "rear_ratio",
    "yaw_gain",
    "servo",
    "pedals",
    "tracking",
    "loop",
    "fusion",
)
# Which drive fits which study; a drive with nothing but pedals goes straight, and palm tree and turns both hold turns.
_FITS = {
    ("straight", "straight"),
    ("straight", "pedals"),
    ("encoder", "standing"),
    ("wheel_angle", "palm_tree"),
    ("rear_ratio", "palm_tree"),
    ("rear_ratio", "turns"),
    ("yaw_gain", "turns"),
    ("servo", "steering"),
    ("pedals", "pedals"),
    ("loop", "steering"),
}
_LOGS = ("straight", "standing", "palm_tree", "turns", "steering", "pedals")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drives by the autopilot, and calibration drives."""
    folder = tmp_path_factory.mktemp("logged")
    assert run("simulate", _TUNING / "tracking_drives.toml", "-o", folder) == 0
    only = [word for name in _LOGS for word in ("--only", name)]
    assert run("simulate", _TUNING / "drives.toml", "-o", folder, *only) == 0
    return folder


def study(kind: str, logs: Path, *names: str, held_out: tuple[str, ...] = (), **options: object) -> Study:
    fit, judge = (tuple(logs / f"{name}.drive.h5" for name in group) for group in (names, held_out))
    return Study(Path("s.toml"), kind, kind, _VEHICLE, None, fit, judge, options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def loop(logs: Path) -> FinishedStudy:
    return run_study(study("loop", logs, "first", "second", held_out=("held_out",)))


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
    (tmp_path / "t.toml").write_text(
        f'name = "t"\nkind = "tracking"\nvehicle = "{_VEHICLE}"\nlogs = ["{logs / "second.drive.h5"}"]\n'
    )
    assert run("tune", tmp_path / "t.toml", "-o", tmp_path / "out", "--json", tmp_path / "t.json") == 0
    # Nothing of the vehicle was found: there is no new file of it.
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"t.tracking.png"}
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
    names = ", ".join(f'"{logs / name}.drive.h5"' for name in ("first", "second"))
    (tmp_path / "l.toml").write_text(
        f'name = "l"\nkind = "look_ahead"\nvehicle = "{_VEHICLE}"\nlogs = [{names}]\n'
        '[options]\ndraws = 256\nsteps = 15\ncourses = ["line"]\n'
    )
    assert run("tune", tmp_path / "l.toml", "-o", tmp_path / "out", "--json", tmp_path / "l.json") == 0
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
    assert any(note.startswith("next: ") for note in table["notes"])


@pytest.mark.parametrize("kind", _KINDS)
def test_a_log_of_the_wrong_kind_is_refused(kind: str, logs: Path) -> None:
    for name in _LOGS:
        if (kind, name) in _FITS:
            continue
        with pytest.raises(InputError, match=r"expected .*, found "):
            run_study(study(kind, logs, name))


def test_a_drive_log_is_no_run_of_a_field(logs: Path) -> None:
    with pytest.raises(InputError):
        run_study(study("threshold", logs, "first"))


def test_nothing_is_written_that_a_held_out_log_contradicts(logs: Path, tmp_path: Path) -> None:
    """The same turns by a vehicle with another rear ratio."""
    other = (_TUNING / "drives.toml").read_text().replace("rear = 0.63", "rear = 0.5")
    (tmp_path / "other.toml").write_text(other)
    assert run("simulate", tmp_path / "other.toml", "-o", tmp_path / "logs", "--only", "turns") == 0
    table = f'name = "k"\nkind = "rear_ratio"\nvehicle = "{_VEHICLE}"\nlogs = ["{logs / "turns.drive.h5"}"]\n'
    (tmp_path / "good.toml").write_text(table)
    (tmp_path / "bad.toml").write_text(table + 'held_out = ["logs/turns.drive.h5"]\n')
    assert run("tune", tmp_path / "good.toml", "-o", tmp_path / "good") == 0
    with pytest.raises(InputError, match=r"steering.rear_ratio, held out: expected .* no vehicle file is written"):
        run_study(read_study(tmp_path / "bad.toml"))
    assert run("tune", tmp_path / "bad.toml", "-o", tmp_path / "out") == 1
    assert not (tmp_path / "out" / _VEHICLE.name).exists()
