"""Signals on the vehicle's clock: right places, one record a fix, nothing across a gap; files as chassis and servo."""

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from lgprjax.formats import NavigationTrack, OdometryTrack, RearMap, VehicleFile, VehicleLog
from lgprjax.formats.vehicle import ChassisTable, PursuitTable, SteeringTable
from lgprjax.frames import LocalFrame
from lgprjax.recordings import chassis_of, servo_of
from lgprjax.scene.vehicle_drive import VehicleFixes
from lgprjax.simulation.vehicle_logs import write_vehicle_fixes
from lgprjax.tuning.studies import signals_of
from lgprjax.vehicle import MeasuredRear, ProportionalRear, rear_angle, torque_share
from refusals import refused

_FRAME = LocalFrame(48.1, 11.5, 520.0)
_SPEED_MPS, _YAW_RAD = 2.0, 0.7


def _log(fix_s: np.ndarray, odometer_s: np.ndarray, vehicle_s: np.ndarray) -> VehicleLog:
    """Straight on at a constant speed; signals are functions of time, so that each value can be told by eye."""
    east, north = fix_s * _SPEED_MPS * np.cos(_YAW_RAD), fix_s * _SPEED_MPS * np.sin(_YAW_RAD)
    latitude, longitude, height = _FRAME.to_geodetic(east, north, 0.0 * east)
    yaw = _YAW_RAD + 0.01 * fix_s
    sigma = np.full(fix_s.shape, 0.5)
    track = NavigationTrack(
        *(fix_s, latitude, longitude, height, _FRAME.heading_of_yaw(yaw, longitude), 0.0 * fix_s),
        *(0.03 + 0.0 * sigma, 0.04 + 0.0 * sigma, sigma, sigma, sigma),
    )
    signals = {"time_s": vehicle_s, "wheel_angle_rad": 0.1 * vehicle_s, "encoder_counts": (10 * vehicle_s).astype(int)}
    odometry = OdometryTrack(odometer_s, _SPEED_MPS * odometer_s)
    return VehicleLog("test", "2024-05-01T12:00:00Z", track, odometry, None, signals, None, {})


def test_signals_are_those_of_the_log() -> None:
    found = signals_of(_log(np.arange(101) * 0.1, np.arange(1001) * 0.01, np.arange(501) * 0.02))
    fixed = np.isfinite(found.east_m)
    np.testing.assert_array_equal(np.flatnonzero(fixed), np.arange(0, 501, 5))
    way_m = found.time_s[fixed] * _SPEED_MPS
    # Metres are about the first fix, whose meridian is the anchor's here.
    np.testing.assert_allclose(found.east_m[fixed], way_m * np.cos(_YAW_RAD), atol=1e-6)
    np.testing.assert_allclose(found.north_m[fixed], way_m * np.sin(_YAW_RAD), atol=1e-6)
    np.testing.assert_allclose(found.yaw_rad[fixed], _YAW_RAD + 0.01 * found.time_s[fixed], atol=1e-7)
    np.testing.assert_allclose(found.travel_m, found.time_s * _SPEED_MPS, atol=1e-9)
    np.testing.assert_allclose(found.sigma_position_m, np.sqrt((0.03**2 + 0.04**2) / 2.0))
    np.testing.assert_allclose(found.sigma_yaw_rad, np.radians(0.5))
    assert found.front_rad is not None
    np.testing.assert_array_equal(found.front_rad, 0.1 * found.time_s)
    assert found.encoder_counts is not None
    assert found.encoder_counts.dtype == np.float64
    assert found.command_rad is None
    assert found.potentiometer_v is None


def test_fixes_of_the_array_are_places_of_the_rear_axle(tmp_path: Path) -> None:
    """Displaced from the navigation by 3 m to the north, at 30 Hz; their own headings, 5° off, are not used."""
    time_s = np.arange(301) / 30.0
    yaw, ahead_m = _YAW_RAD + 0.01 * time_s, 6.0
    east = time_s * _SPEED_MPS * np.cos(_YAW_RAD) + ahead_m * np.cos(yaw)
    north = 3.0 + time_s * _SPEED_MPS * np.sin(_YAW_RAD) + ahead_m * np.sin(yaw)
    pose = np.stack([east, north, 0.0 * east, yaw + np.radians(5.0), 0.0 * east], axis=1)
    found = np.arange(301) % 30 != 0
    spread = np.tile(np.diag([0.03, 0.04, 0.05, 0.01, 0.01]) ** 2, (301, 1, 1))
    fixes = VehicleFixes(time_s, found, pose, spread, (0.03, 0.04), 0.8, 1e-9)
    write_vehicle_fixes(tmp_path, "test", fixes, _FRAME, t0_utc="2024-05-01T12:00:00Z", provenance={})
    log = _log(np.arange(101) * 0.1, np.arange(1001) * 0.01, np.arange(501) * 0.02)
    signals = signals_of(log, fixes=tmp_path / "test.fixes.h5", array_x_m=ahead_m)
    placed = np.isfinite(signals.east_m)
    # One of neighbouring fixes, which share their errors; none before the first.
    assert placed.sum() == 100
    way_m = signals.time_s[placed] * _SPEED_MPS
    np.testing.assert_allclose(signals.east_m[placed], way_m * np.cos(_YAW_RAD), atol=1e-5)
    np.testing.assert_allclose(signals.north_m[placed], 3.0 + way_m * np.sin(_YAW_RAD), atol=1e-5)
    np.testing.assert_allclose(signals.yaw_rad[placed], _YAW_RAD + 0.01 * signals.time_s[placed], atol=1e-7)
    np.testing.assert_allclose(signals.sigma_position_m, np.sqrt((0.03**2 + 0.04**2) / 2.0), rtol=1e-6)


def test_a_fix_between_records_is_moved_to_the_nearest() -> None:
    found = signals_of(_log(0.003 + np.arange(101) * 0.1, np.arange(1001) * 0.02, np.arange(501) * 0.02))
    fixed = np.isfinite(found.east_m)
    # The first record lies before the first fix: nothing is drawn beyond the ends.
    np.testing.assert_array_equal(np.flatnonzero(fixed), np.arange(5, 501, 5))
    first_m = 0.003 * _SPEED_MPS
    expected = found.time_s[fixed] * _SPEED_MPS * np.cos(_YAW_RAD) - first_m * np.cos(_YAW_RAD)
    np.testing.assert_allclose(found.east_m[fixed], expected, atol=1e-5)


def test_nothing_is_drawn_across_gaps() -> None:
    fix_s, odometer_s = np.arange(101) * 0.1, np.arange(1001) * 0.01
    fix_s = fix_s[(fix_s <= 3.0) | (fix_s > 4.95)] + 0.004
    odometer_s = odometer_s[(odometer_s <= 7.001) | (odometer_s > 7.999)]
    found = signals_of(_log(fix_s, odometer_s, np.arange(501) * 0.02))
    assert not np.any((found.time_s > 7.005) & (found.time_s < 7.995))
    assert np.count_nonzero(found.time_s > 8.1) == 95
    fixed_s = found.time_s[np.isfinite(found.east_m)]
    # Fixes at 3.004 s and 5.004 s bound the gap: the record at 3.00 s lies before it, that at 5.00 s within.
    assert not np.any((fixed_s > 3.01) & (fixed_s < 5.01))
    assert np.any(np.abs(fixed_s - 3.0) < 1e-9)
    assert np.any(np.abs(fixed_s - 5.1) < 1e-9)
    np.testing.assert_array_equal(np.isfinite(found.yaw_rad), np.isfinite(found.east_m))


def test_a_full_turn_of_heading_has_no_jump() -> None:
    log = _log(np.arange(101) * 0.1, np.arange(1001) * 0.01, np.arange(501) * 0.02)
    turned = replace(log.navigation, heading_deg=np.mod(350.0 + 5.0 * np.arange(101), 360.0))
    found = signals_of(replace(log, navigation=turned))
    steps = np.diff(found.yaw_rad[np.isfinite(found.yaw_rad)])
    np.testing.assert_allclose(steps, -np.radians(5.0), atol=1e-6)


def test_a_log_without_signals_is_refused() -> None:
    log = _log(np.arange(11) * 0.1, np.arange(101) * 0.01, np.arange(51) * 0.02)
    with refused("/vehicle", file="a.drive.h5"):
        signals_of(replace(log, vehicle=None), "a.drive.h5")
    late = replace(log, vehicle={"time_s": 100.0 + np.arange(5.0)})
    with refused():
        signals_of(late)


def _vehicle(**steering: float) -> VehicleFile:
    return VehicleFile(
        name="x",
        steering_kind="counter_steer",
        chassis=ChassisTable(wheelbase_m=3.8),
        steering=SteeringTable(largest_wheel_angle_rad=0.5, **steering),
        pursuit=PursuitTable(anchor_m=6.5),
    )


def test_chassis_of_a_file() -> None:
    chassis = chassis_of(_vehicle(rear_ratio=0.63, characteristic_speed_mps=20.0))
    assert isinstance(chassis.rear, ProportionalRear)
    values = (chassis.wheelbase_m, chassis.anchor_m, chassis.rear.ratio, chassis.largest_angle_rad)
    np.testing.assert_allclose(values, (3.8, 6.5, 0.63, 0.5), rtol=1e-6)
    assert float(chassis.characteristic_speed_mps) == 20.0
    assert np.isinf(chassis_of(_vehicle(rear_ratio=0.63)).characteristic_speed_mps)
    measured = RearMap(first_rad=-0.5, step_rad=0.25, rear_rad=[-0.28, -0.15, 0.0, 0.15, 0.28])
    mapped = chassis_of(_vehicle(rear_ratio=0.63).model_copy(update={"rear_map": measured}))
    assert isinstance(mapped.rear, MeasuredRear)
    behind, _ = rear_angle(mapped.rear, jnp.asarray([0.375], jnp.float32))
    np.testing.assert_allclose(behind, [0.215], rtol=1e-5)


def test_a_chassis_with_a_number_missing() -> None:
    for vehicle, place in (
        (_vehicle(), "steering.rear_ratio"),
        (_vehicle(rear_ratio=0.6).model_copy(update={"chassis": ChassisTable()}), "chassis.wheelbase_m"),
        (_vehicle(rear_ratio=0.6).model_copy(update={"pursuit": PursuitTable()}), "pursuit.anchor_m"),
        (VehicleFile(name="x", steering_kind="skid_steer"), "steering_kind"),
    ):
        with refused(place, file="a.vehicle.toml"):
            chassis_of(vehicle, Path("a.vehicle.toml"))


def test_servo_of_a_file() -> None:
    told = {"lag_s": 0.2, "largest_wheel_rate_radps": 0.4, "delay_s": 0.06, "dead_band_rad": 0.003}
    told |= {"backlash_rad": 0.005, "asymmetry": 0.1, "nominal_v": 24.0, "stall_v": 10.0}
    servo = servo_of(_vehicle(**told))
    np.testing.assert_allclose(servo, (0.2, 0.4, 0.06, 0.003, 0.005, 0.1, 24.0, 10.0), rtol=1e-6)
    bare = servo_of(_vehicle(lag_s=0.2, largest_wheel_rate_radps=0.4))
    np.testing.assert_allclose(bare[2:6], 0.0)
    assert float(torque_share(bare, jnp.float32(12.0))) == 1.0
    with refused("steering.stall_v", "nominal_v"):
        servo_of(_vehicle(lag_s=0.2, largest_wheel_rate_radps=0.4, nominal_v=24.0))
    with refused("steering.lag_s"):
        servo_of(_vehicle(largest_wheel_rate_radps=0.4))
