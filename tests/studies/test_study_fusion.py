"""The study of the filter's noises, from drive logs and fixes to a vehicle file; drives drawn from known noises."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lgprjax.errors import InputError
from lgprjax.formats import (
    NavigationTrack,
    OdometryTrack,
    VehicleFile,
    VehicleLog,
    load_schema,
    read_fix_poses,
    read_fixes,
    read_study,
    write_fixes,
    write_vehicle,
    write_vehicle_log,
)
from lgprjax.frames import LocalFrame
from lgprjax.tuning.studies.navigation import tick_drive
from lgprjax.tuning.studies.steering import FinishedStudy, run_study
from model_drives import TICK_S, draw_drive, usual_model
from refusals import refusal_in

_FRAME = LocalFrame(46.0, 11.0, 300.0)
# The least that a fit of nine noises takes.
_SECONDS = 100.0
# A log's positions are those of the rear axle, and its clock is the radar's.
_TRUE = usual_model(
    zero_slip_m=0.63 * 3.8 / 1.63,
    gnss_x_m=0.0,
    gnss_y_m=0.0,
    acceleration_noise=0.3,
    side_noise=0.03,
    initial_clock_s=1e-4,
    initial_position_m=0.02,
    initial_yaw_rad=0.002,
)
_FILE = VehicleFile.model_validate(
    {
        "name": "drawn",
        "steering_kind": "counter_steer",
        "chassis": {"wheelbase_m": 3.8},
        "steering": {"rear_ratio": 0.63, "largest_wheel_angle_rad": 0.5},
        "array": {"x_m": 6.5},
        "navigation": {"acceleration_noise": 0.8, "side_noise": 0.1},
    }
)


def _track(time_s: np.ndarray, x: np.ndarray, y: np.ndarray, yaw: np.ndarray, **sigmas: np.ndarray) -> NavigationTrack:
    latitude, longitude, height = _FRAME.to_geodetic(x, y, np.zeros_like(x))
    heading = _FRAME.heading_of_yaw(yaw, longitude)
    return NavigationTrack(time_s, latitude, longitude, height, heading, np.zeros_like(x), **sigmas)


def _write_drive(folder: Path, name: str, seed: int, *, fix_error_m: float = 0.0) -> Path:
    """A drawn drive as a log without radar, and its fixes beside it."""
    drawn = draw_drive(_TRUE, seed, seconds=_SECONDS)
    seen, states = drawn.observations, drawn.states
    time_s = TICK_S * np.arange(1, len(states) + 1)
    fixed = np.asarray(seen.gnss.valid)
    known = time_s[fixed]
    metres, degrees = np.full(known.size, 0.02), np.full(known.size, np.degrees(0.002))
    navigation = _track(
        known,
        *(np.asarray(v, np.float64)[fixed] for v in (seen.gnss.x_m, seen.gnss.y_m, seen.heading.yaw_rad)),
        sigma_east_m=metres,
        sigma_north_m=metres,
        sigma_height_m=metres,
        sigma_heading_deg=degrees,
        sigma_roll_deg=degrees,
    )
    # The gyro's mean over a tick as a signal of two records a tick; its distance is that of the wheels.
    rate = np.repeat(np.asarray(drawn.motions.yaw_rate_radps, np.float64), 2)
    edges = np.append(0.0, time_s)
    log_s = np.stack([edges[:-1] + 1e-6, edges[1:]], axis=1).ravel()
    distance = np.append(0.0, np.cumsum(np.asarray(seen.odometer.speed_mps, np.float64)) * TICK_S)
    log = VehicleLog(
        name,
        "2026-01-01T00:00:00+00:00",
        navigation,
        OdometryTrack(edges, distance),
        _track(time_s, states[:, 0], states[:, 1], states[:, 2]),
        {"time_s": log_s, "yaw_rate_radps": rate},
        None,
        {},
    )
    path = folder / f"{name}.drive.h5"
    write_vehicle_log(path, log)
    scans = np.flatnonzero(np.asarray(seen.lgpr.valid))
    x, y, yaw = (np.asarray(v, np.float64)[scans] for v in seen.lgpr[:3])
    x, y = np.random.default_rng(seed).normal(0.0, fix_error_m, (2, len(scans))) + [x, y]
    latitude, longitude, height = _FRAME.to_geodetic(x, y, np.zeros_like(x))
    none = np.zeros(scans.size)
    columns = {
        "scan": np.arange(scans.size),
        "time_s": time_s[scans],
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "height_m": height,
        "heading_deg": _FRAME.heading_of_yaw(yaw, longitude),
        "roll_deg": none,
        "sigma_along_m": none + 0.04,
        "sigma_cross_m": none + 0.04,
        "correlation": none + 0.9,
        "margin": none + 0.3,
        "overlap_channels": np.full(scans.size, 12),
        "code": np.full(scans.size, "ok"),
    }
    spread = np.diag([0.04, 0.04, 0.02, 0.01, 0.01]) ** 2
    attributes = {
        "name": name,
        "map": "drawn",
        "t0_utc": log.t0_utc,
        "anchor_latitude_deg": _FRAME.latitude_deg,
        "anchor_longitude_deg": _FRAME.longitude_deg,
        "anchor_height_m": _FRAME.height_m,
        "provenance": {},
    }
    write_fixes(
        folder / f"{name}.fixes.csv",
        folder / f"{name}.fixes.h5",
        pd.DataFrame(columns),
        attributes=attributes,
        pose_m=np.stack([x, y, none, yaw, none], axis=1),
        covariance=np.tile(spread, (scans.size, 1, 1)).astype(np.float32),
    )
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fusion")
    for seed, name in enumerate(("one", "two")):
        _write_drive(folder, name, seed)
    write_vehicle(folder / "x.vehicle.toml", _FILE)
    # Wheels whose speed over a tick is wrong by 0.03 m/s.
    (folder / "fusion.toml").write_text(
        'name = "fusion"\nkind = "fusion"\nvehicle = "x.vehicle.toml"\n'
        'logs = ["one.drive.h5"]\nheld_out = ["two.drive.h5"]\n'
        f"[options]\ntick_s = {TICK_S}\nodometer_sigma_m = {0.03 * TICK_S / np.sqrt(2.0)}\n"
    )
    return folder


@pytest.fixture(scope="module")
def finished(folder: Path) -> FinishedStudy:
    return run_study(read_study(folder / "fusion.toml"))


def test_ticks_hold_what_was_drawn(folder: Path) -> None:
    path = folder / "one.drive.h5"
    ticked = tick_drive(VehicleLog.open(path), path, folder / "one.fixes.h5", tick_s=TICK_S)
    drawn = draw_drive(_TRUE, 0, seconds=_SECONDS)
    # The ticks begin with the first position.
    skipped = 2
    seen, wanted = ticked.drive.observations, drawn.observations
    origin = [float(v[1]) for v in (wanted.gnss.x_m, wanted.gnss.y_m)]
    for source in ("gnss", "lgpr"):
        got, true = getattr(seen, source), getattr(wanted, source)
        valid = np.asarray(true.valid)[skipped : skipped + len(ticked.time_s)]
        np.testing.assert_array_equal(got.valid, valid)
        for column, start in (("x_m", origin[0]), ("y_m", origin[1])):
            moved = np.asarray(getattr(true, column))[skipped : skipped + valid.size][valid] - start
            np.testing.assert_allclose(np.asarray(getattr(got, column))[valid], moved, atol=1e-3)
    np.testing.assert_allclose(
        ticked.drive.motions.yaw_rate_radps[1:-1],
        drawn.motions.yaw_rate_radps[skipped + 1 : skipped + len(ticked.time_s) - 1],
        atol=2e-4,
    )
    assert ticked.truth is not None
    np.testing.assert_allclose(ticked.truth[0, 2], drawn.states[skipped, 2], atol=1e-6)
    assert np.isfinite(ticked.p_false).sum() == int(np.asarray(seen.lgpr.valid).sum())


def test_noises_go_into_the_vehicle_file_with_intervals(finished: FinishedStudy) -> None:
    for name in ("acceleration_noise", "side_noise"):
        found = finished.vehicle.found[f"navigation.{name}"]
        assert isinstance(found.low, float)
        assert isinstance(found.high, float)
        assert found.low < float(getattr(_TRUE, name)) < found.high < 1.6 * found.low
        assert found.study == "fusion"
        assert found.log == "one.drive.h5"
    known = {entry.path for entry in load_schema("vehicle").keys}
    assert set(finished.outcome.found) <= known


def test_held_out_drive_judges(finished: FinishedStudy) -> None:
    figures = {figure.name: figure.value for figure in finished.outcome.figures}
    prefix = "held out, two.drive.h5"
    for source in ("gnss", "heading", "odometer", "lgpr"):
        assert figures[f"{prefix}: NIS of {source}"] == pytest.approx(1.0, abs=0.15)
        assert figures[f"{prefix}: {source}, rejected"] <= 2
    errors = [figures[f"{prefix}: {what}, position, rms"] for what in ("filter", "smoother", "threshold switch")]
    assert errors[1] < errors[0] < errors[2] < 1.0


def test_a_held_out_drive_with_worse_fixes_contradicts(folder: Path) -> None:
    """Fixes that lie eight times as far off as they say, or nowhere near."""
    table = (folder / "fusion.toml").read_text()
    for name, error_m in (("worse", 0.3), ("nowhere", 5.0)):
        _write_drive(folder, name, 1, fix_error_m=error_m)
        (folder / f"{name}.toml").write_text(table.replace("two.drive.h5", f"{name}.drive.h5"))
        with pytest.raises(InputError) as caught:
            run_study(read_study(folder / f"{name}.toml"))
        assert "lgpr" in refusal_in(caught.value).place


def test_log_without_fixes_or_gyro_is_one_line(folder: Path, tmp_path: Path) -> None:
    path = folder / "one.drive.h5"
    lonely = tmp_path / "lonely.drive.h5"
    lonely.write_bytes(path.read_bytes())
    write_vehicle(tmp_path / "x.vehicle.toml", _FILE)
    table = 'name = "s"\nkind = "fusion"\nvehicle = "x.vehicle.toml"\nlogs = ["lonely.drive.h5"]\n'
    (tmp_path / "s.toml").write_text(table)
    with pytest.raises(InputError) as caught:
        run_study(read_study(tmp_path / "s.toml"))
    assert "lonely.fixes.h5" in str(caught.value)
    # A vehicle does not know what lies ahead.
    known, (_, spread) = read_fixes(folder / "one.fixes.h5"), read_fix_poses(folder / "one.fixes.h5")
    names = ("name", "map", "t0_utc", "anchor_latitude_deg", "anchor_longitude_deg", "anchor_height_m", "provenance")
    write_fixes(
        tmp_path / "lonely.fixes.csv",
        tmp_path / "lonely.fixes.h5",
        known.assign(smoothed=1),
        attributes={name: known.attrs[name] for name in names},
        covariance=spread,
    )
    with pytest.raises(InputError) as caught:
        run_study(read_study(tmp_path / "s.toml"))
    assert refusal_in(caught.value).place == "smoothed"
    log = VehicleLog.open(path)
    with pytest.raises(InputError) as caught:
        tick_drive(VehicleLog(**{**log.__dict__, "vehicle": None}), path, None)
    assert "yaw_rate_radps" in str(caught.value)
