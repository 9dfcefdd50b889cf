"""Poses and antennas by hand: heading along the path, roll, time offsets, odometer and navigation."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.radar.array import uniform_array
from lgprjax.scene.motion import DrivePlan, place_antennas, plan_motion, poses_at, scan_times
from lgprjax.scene.sensors import NavigationErrors, gauss_markov, observe_drive

PLAN = DrivePlan(0.0, 60.0, lane_m=0.2)
STILL = replace(PLAN, wander_m=0.0, height_sigma_m=0.0, roll_sigma_rad=0.0)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_rear_axle_runs_along_its_own_heading(direction: int) -> None:
    motion = plan_motion(replace(PLAN, direction=direction), 3)
    time_s, step_s = scan_times(motion)[5:-5], 1e-4
    before, now, after = (poses_at(motion, time_s + dt) for dt in (-step_s, 0.0, step_s))
    velocity = (after[:, :2] - before[:, :2]) / (2 * step_s)
    heading = np.stack([np.cos(now[:, 3]), np.sin(now[:, 3])], axis=-1)
    # The arc table is linear over 2 cm: the speed wavers by the path's stretch within a cell, no more.
    np.testing.assert_allclose(velocity, PLAN.speed_mps * heading, atol=2e-3)
    assert np.sign(heading[:, 0]).tolist() == [direction] * len(time_s)


def test_wander_and_bounce_have_the_size_asked_for() -> None:
    poses = poses_at(plan_motion(replace(PLAN, stop_m=2000.0), 1), np.arange(0.0, 440.0, 0.1))
    assert poses[:, 1].mean() == pytest.approx(0.2, abs=2e-3)
    assert poses[:, 1].std() == pytest.approx(0.03, rel=0.1)
    assert poses[:, 2].std() == pytest.approx(0.01, rel=0.1)
    assert poses[:, 4].std() == pytest.approx(np.radians(0.3), rel=0.1)


def test_antennas_stand_where_body_and_roll_put_them() -> None:
    array = uniform_array(3, 0.5, x_m=3.0, height_m=0.3)  # y = +0.5, 0, -0.5
    east, north, height, yaw, roll = 10.0, -2.0, 0.02, np.pi / 2, 0.1
    pose = np.broadcast_to([east, north, height, yaw, roll], (1, 3, 5))
    placed = place_antennas(pose, array)[0]
    half, rise = 0.5 * np.cos(0.1), 0.5 * np.sin(0.1)
    # Facing north: forward is north, left is west; right side down lifts the left end.
    expected = [(10.0 - half, 1.0, 0.32 + rise), (10.0, 1.0, 0.32), (10.0 + half, 1.0, 0.32 - rise)]
    np.testing.assert_allclose(placed, expected, atol=1e-12)


@pytest.mark.parametrize("direction", [1, -1])
def test_each_channel_is_taken_at_its_own_instant(direction: int) -> None:
    array = uniform_array(11, 0.127, x_m=3.0, height_m=0.3, scan_period_s=1 / 126)
    motion = plan_motion(replace(STILL, direction=direction), 0)
    time_s = scan_times(motion)
    placed = place_antennas(poses_at(motion, time_s[:, None] + array.time_offset_s[None]), array)
    start_m = 0.0 if direction > 0 else 60.0
    run_m = 4.5 * (time_s[:, None] + np.arange(11)[None] / 11 / 126)
    np.testing.assert_allclose(placed[..., 0], start_m + direction * (run_m + 3.0), atol=1e-9)
    np.testing.assert_allclose(
        placed[..., 1], np.broadcast_to(0.2 + direction * array.y_m, placed.shape[:2]), atol=1e-9
    )
    np.testing.assert_allclose(placed[..., 2], 0.3, atol=1e-12)


def test_the_ground_is_left_at_the_same_bounce_and_mirrored_roll_on_the_way_back() -> None:
    there, back = (plan_motion(replace(PLAN, direction=d), 7) for d in (1, -1))
    outward = poses_at(there, np.array([2.0]))[0]
    homeward = poses_at(back, np.array([back.duration_s - 2.0]))[0]
    np.testing.assert_allclose(homeward[:3], outward[:3], atol=1e-9)
    assert homeward[4] == pytest.approx(-outward[4], abs=1e-9)
    assert np.cos(homeward[3] - outward[3]) == pytest.approx(-1.0, abs=1e-9)


def test_scans_last_from_one_end_to_the_other() -> None:
    motion = plan_motion(STILL, 0)
    time_s = scan_times(motion)
    np.testing.assert_allclose(np.diff(time_s), 1 / 126, atol=1e-12)
    assert time_s[0] == 0.0
    assert 0.0 <= motion.duration_s - time_s[-1] < 1 / 126
    assert poses_at(motion, np.array([motion.duration_s]))[0, 0] == pytest.approx(60.0)


def test_the_odometer_agrees_with_the_truth_up_to_its_scale_and_noise() -> None:
    motion = plan_motion(PLAN, 3)
    odometer, _ = observe_drive(motion, NavigationErrors(), 3)
    inside = odometer.time_s <= motion.duration_s
    dense = poses_at(motion, np.linspace(0.0, motion.duration_s, 20_001))
    run_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(dense[:, :2], axis=0), axis=1)))
    true_m = np.interp(odometer.time_s[inside], np.linspace(0.0, motion.duration_s, 20_001), run_m)
    wrong_m = odometer.distance_m[inside] - 1.005 * true_m
    assert np.abs(wrong_m).max() < 0.01
    assert wrong_m.std() == pytest.approx(0.002, rel=0.1)
    assert odometer.time_s[-1] >= motion.duration_s


def test_navigation_errors_have_their_sigma_and_memory() -> None:
    keep = float(np.exp(-1 / 50))
    process = gauss_markov(np.random.default_rng(0), np.array([0.05, 2.0]), keep, 200_000)
    np.testing.assert_allclose(process.std(axis=0), [0.05, 2.0], rtol=0.05)
    for column in process.T:
        assert np.corrcoef(column[:-50], column[50:])[0, 1] == pytest.approx(np.exp(-1), abs=0.05)


def test_a_navigation_bias_shifts_the_whole_track() -> None:
    motion = plan_motion(PLAN, 3)
    _, plain = observe_drive(motion, NavigationErrors(), 3)
    _, biased = observe_drive(motion, NavigationErrors(position_bias_m=(1.0, -0.5)), 3)
    np.testing.assert_allclose(biased.pose - plain.pose, [[1.0, -0.5, 0, 0, 0]] * len(plain.pose), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"stop_m": 0.0}, "start_m"),
        ({"direction": 0}, "direction"),
        ({"speed_mps": 0.0}, "positive"),
        ({"scan_rate_hz": -1.0}, "positive"),
    ],
)
def test_a_plan_that_cannot_be_driven_is_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan_motion(replace(PLAN, **change), 0)  # type: ignore[arg-type]
