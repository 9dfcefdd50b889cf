"""A new vehicle is calibrated by prompts: hidden numbers, files, order, interruption, refusals."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from canon.calibration import DRIVEN_BEFORE, KIT_FILE, Calibrated, calibrated, without_steering, write_kit
from canon.commands import run, succeed
from lgprjax.formats import VehicleLog, flat_keys, read_run, read_vehicle
from lgprjax.run_records import PLAN, Record, RecordKind, Source, unpack
from lgprjax.wire import decode


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Calibrated:
    """After all steps."""
    return calibrated(tmp_path_factory)


@pytest.fixture(scope="module")
def kit(tmp_path_factory: pytest.TempPathFactory) -> Calibrated:
    """After the steering's steps; the others were done before."""
    return calibrated(tmp_path_factory, but_steering=True)


@pytest.fixture
def again(tmp_path: Path) -> Path:
    """The calibrated vehicle with its configuration, to be changed. Returns the vehicle file."""
    write_kit(tmp_path)
    return Path(shutil.copy(KIT_FILE, tmp_path / "kit.vehicle.toml"))


@pytest.mark.long
def test_the_numbers_of_a_hidden_vehicle_are_inside_their_intervals(whole: Calibrated) -> None:
    found, truths = read_vehicle(whole.vehicle).found, DRIVEN_BEFORE.truth
    assert set(truths) <= set(found)
    held = read_vehicle(KIT_FILE).found
    assert set(held) == set(found)
    for path in truths:
        values = (found[path].low, held[path].high, held[path].low, found[path].high)
        low, held_high, held_low, high = (float(str(value)) for value in values)
        assert low <= held_high, path
        assert held_low <= high, path
    # Of 20 intervals of 95 %, one is outside on average.
    check_intervals(whole, truths, most_outside=2)


def test_the_steerings_numbers_are_inside_their_intervals(kit: Calibrated) -> None:
    told = read_vehicle(kit.vehicle).found
    assert set(told) == set(read_vehicle(KIT_FILE).found)
    truths = {path: truth for path, truth in DRIVEN_BEFORE.truth.items() if told[path].study == "servo"}
    assert len(truths) == 4
    # Two of four intervals of 95 % are outside in one of seventy vehicles.
    check_intervals(kit, truths, most_outside=1)


def check_intervals(kit: Calibrated, truths: dict[str, float], most_outside: int) -> None:
    """All intervals but a few hold the truth, none is far from it, and each says something."""
    found = read_vehicle(kit.vehicle).found
    outside = []
    for path, truth in truths.items():
        low, high = found[path].low, found[path].high
        assert isinstance(low, float)
        assert isinstance(high, float)
        outside += [path] if not low <= truth <= high else []
        # An interval that says nothing contains everything.
        assert high - low < 0.25 * abs(truth) + 0.06, path
        assert abs(0.5 * (low + high) - truth) < high - low, path
    assert len(outside) <= most_outside, outside


def test_nothing_is_open_afterwards_and_what_is_assumed_is_named(kit: Calibrated) -> None:
    vehicle = read_vehicle(kit.vehicle)
    assert vehicle.assumed == ["steering.stall_v", "pursuit.anchor_m"]
    assert vehicle.steering.nominal_v == pytest.approx(24.0, abs=0.1)
    assert vehicle.steering.largest_wheel_angle_rad == pytest.approx(np.radians(32.0), rel=0.04)
    said = succeed("calibrate", kit.vehicle, "--list")
    assert "open" not in said
    assert said.rstrip().endswith("result: steps that are due: none")
    succeed("check", kit.vehicle)


@pytest.mark.long
def test_each_step_leaves_its_drive_log_and_pictures(whole: Calibrated) -> None:
    steps = ["straight", "half_turns", "steering", "pedals"]
    for step in steps:
        succeed("check", whole.folder / f"{step}.drive.h5")
    drawn = {path.name.split(".")[0] for path in whole.folder.glob("*.png")}
    assert drawn == {*steps, "look_ahead"}
    assert not list(whole.folder.glob("scratch*"))


def test_a_step_leaves_its_drive_log_and_picture(kit: Calibrated) -> None:
    succeed("check", kit.folder / "steering.drive.h5")
    assert {path.name.split(".")[0] for path in kit.folder.glob("*.png")} == {"steering"}
    assert not list(kit.folder.glob("scratch*"))


def test_the_steering_step_stays_within_its_limits(kit: Calibrated) -> None:
    (folder,) = kit.folder.glob("steering-*")
    plans = np.array([np.frombuffer(r.payload, PLAN)[0] for r in _records(folder) if r.kind is RecordKind.PLAN], PLAN)
    assert np.abs(plans["command"][:, 0]).max() <= 0.2 + 1e-6
    assert not plans["command"][:, 1:].any()
    assert set(plans["engage"].tolist()) <= {0, 1}


@pytest.mark.long
def test_the_pedal_step_stays_within_its_limits(whole: Calibrated) -> None:
    log = VehicleLog.open(whole.folder / "pedals.drive.h5")
    assert log.vehicle is not None
    throttle, brake = log.vehicle["throttle"], log.vehicle["brake"]
    assert not np.any((throttle > 0.0) & (brake > 0.0))
    time_s, way_m = log.odometry.time_s, log.odometry.distance_m
    speed = np.gradient(np.interp(log.vehicle["time_s"], time_s, way_m), log.vehicle["time_s"])
    # Up to the throttle that follows the proof of the brake: the first brake from more than half a metre a second.
    proof = np.flatnonzero((brake > 0.0) & (speed > 0.5))[0]
    next_throttle = proof + np.flatnonzero(throttle[proof:] > 0.0)[0]
    assert 1.0 < speed[:next_throttle].max() < 2.0
    assert speed.max() < 4.0
    # Brake before throttle.
    assert np.flatnonzero(brake > 0.0)[0] < np.flatnonzero(throttle > 0.0)[0]


@pytest.mark.parametrize("step", ["steering", pytest.param("pedals", marks=pytest.mark.long)])
def test_override_in_the_middle_ends_it_and_the_step_is_repeated(again: Path, step: str) -> None:
    script = 'script = [{ at_s = 12.0, do = "press", button = "override" }]\n'
    before = again.read_bytes()
    write_kit(again.parent, script=script)
    again.write_bytes(before)
    done = run("calibrate", again, "--simulate", "--step", step)
    assert done.status == 1
    assert "not enough" in done.out
    # Nothing is written, the recording is kept.
    assert again.read_bytes() == before
    (folder,) = (again.parent / "calibration" / "kit").glob(f"{step}-*")
    records = list(_records(folder))
    pressed = next(
        r.mono_ns
        for r in records
        if r.kind is RecordKind.EVENT and json.loads(r.payload).get("event") == "OVERRIDE_PRESSED"
    )
    sent = [r for r in records if r.kind is RecordKind.PORT_OUT and r.source is Source.DRIVE_BY_WIRE]
    assert any(_engage(r.payload) for r in sent if r.mono_ns < pressed)
    assert not any(_engage(r.payload) for r in sent if r.mono_ns >= pressed)


def _engage(raw: bytes) -> int:
    frame = decode(raw)
    return int(frame.number("engage")) if "engage" in frame.fields else 0


def _records(folder: Path) -> Iterator[Record]:
    return (unpack(data) for _, data in read_run(folder))


def test_a_calibration_goes_on_with_what_is_left(again: Path) -> None:
    again.write_text(without_steering(again.read_text(encoding="utf-8")), encoding="utf-8")
    said = succeed("calibrate", again, "--list")
    assert said.rstrip().endswith("due: steering")


def test_a_run_names_the_numbers_that_are_open(tmp_path: Path) -> None:
    vehicle = write_kit(tmp_path)
    config = tmp_path / "kit.run.toml"
    text = config.read_text(encoding="utf-8").replace('mode = "record"', 'map = "x.map.h5"\nroutes = ["x.route.toml"]')
    config.write_text(
        text.replace("[sensors]", 'radar = { url = "socket://127.0.0.1:1" }\n[sensors]'), encoding="utf-8"
    )
    done = run("run", config, "--simulate", "--for-s", 1)
    assert done.status == 1
    done.refusal.check("pursuit.anchor_m", "calibrate", found="steering.lag_s", file=vehicle)


def test_a_step_asks_for_what_it_needs_before(tmp_path: Path) -> None:
    vehicle = write_kit(tmp_path)
    done = run("calibrate", vehicle, "--simulate", "--step", "steering")
    assert done.status == 1
    done.refusal.check("steering.encoder_counts_per_rad", "half_turns", found="open", file=vehicle)
    assert not (tmp_path / "calibration").exists()


@pytest.mark.parametrize("change", ["none", "two", "real"])
def test_the_connections_are_found_or_asked_for(tmp_path: Path, change: str) -> None:
    vehicle = write_kit(tmp_path)
    config = tmp_path / "kit.run.toml"
    if change == "none":
        config.unlink()
    elif change == "two":
        other = config.read_text(encoding="utf-8").replace(
            'gnss = { url = "/dev/null" }', 'gnss = { url = "/dev/ttyS9" }'
        )
        (tmp_path / "other.run.toml").write_text(other, encoding="utf-8")
    done = run("calibrate", vehicle, *([] if change == "real" else ["--simulate"]))
    assert done.status == 1
    place, named = ("simulation", "--simulate") if change == "real" else ("configuration", "--config")
    done.refusal.check(place, named)


def test_numbers_have_a_state_in_the_vehicle_file(kit: Calibrated) -> None:
    vehicle = read_vehicle(kit.vehicle)
    held = flat_keys(vehicle.model_dump(exclude_none=True, exclude={"found"}))
    assert set(vehicle.assumed) <= set(held)
    assert not set(vehicle.assumed) & set(vehicle.found)
