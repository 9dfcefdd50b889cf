"""Poses and antennas by hand: heading along the path, roll, time offsets, curves, hills and rough roads."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.radar.array import uniform_array
from lgprjax.scene.motion import (
    DrivePlan,
    antennas_on_road,
    ground_up_at,
    place_antennas,
    place_on_road,
    plan_motion,
    poses_at,
    scan_times,
)
from lgprjax.scene.road import RoadConfig, make_road, roughness_value, wave_value

PLAN = DrivePlan(0.0, 60.0, lane_m=0.2)
STILL = replace(PLAN, wander_m=0.0, height_sigma_m=0.0, roll_sigma_rad=0.0)
CURVY = RoadConfig(length_m=300.0, curvature_rms_per_m=1 / 100, heading_deg=-40.0)
HILLY = replace(CURVY, grade_rms=0.03, bank_rms_rad=0.02)
CIRCLE = RoadConfig(length_m=100.0, arcs=((100.0, 1 / 80),))


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
    # On a straight road they stand in the road's frame as in the local one, wander and roll among it.
    motion = plan_motion(replace(PLAN, direction=direction), 3)
    placed = place_antennas(poses_at(motion, time_s[:, None] + array.time_offset_s[None]), array)
    np.testing.assert_allclose(antennas_on_road(motion, time_s, array), placed, rtol=0, atol=1e-13)


def test_a_lane_of_a_circle_is_a_circle_driven_at_the_speed_asked_for() -> None:
    motion = plan_motion(replace(STILL, lane_m=0.5), 0, make_road(1, CIRCLE))
    assert motion.duration_s == pytest.approx(60.0 * (79.5 / 80) / 4.5, rel=1e-9)
    time_s = scan_times(motion)
    np.testing.assert_allclose(np.diff(time_s), 1 / 126, atol=1e-12)
    assert time_s[0] == 0.0
    assert 0.0 <= motion.duration_s - time_s[-1] < 1 / 126
    angle = 4.5 * time_s / 79.5
    poses = poses_at(motion, time_s)
    np.testing.assert_allclose(poses[:, 0], 79.5 * np.sin(angle), atol=1e-8)
    np.testing.assert_allclose(poses[:, 1], 80.0 - 79.5 * np.cos(angle), atol=1e-8)
    np.testing.assert_allclose(poses[:, 3], angle, atol=1e-9)
    np.testing.assert_allclose(poses[:, [2, 4]], 0.0, atol=1e-15)


@pytest.mark.parametrize("direction", [1, -1])
def test_on_a_curved_hilly_road_too_it_runs_along_its_heading_at_its_speed(direction: int) -> None:
    motion = plan_motion(DrivePlan(0.0, 300.0, direction, lane_m=-1.0), 3, make_road(5, HILLY))
    time_s, step_s = scan_times(motion)[5:-5], 1e-4
    before, now, after = (poses_at(motion, time_s + dt) for dt in (-step_s, 0.0, step_s))
    velocity = (after[:, :2] - before[:, :2]) / (2 * step_s)
    climb = (ground_up_at(motion, time_s + step_s) - ground_up_at(motion, time_s - step_s)) / (2 * step_s)
    np.testing.assert_allclose(np.hypot(np.linalg.norm(velocity, axis=1), climb), 4.5, atol=2e-3)
    heading = np.stack([np.cos(now[:, 3]), np.sin(now[:, 3])], axis=-1)
    np.testing.assert_allclose(velocity / np.linalg.norm(velocity, axis=1)[:, None], heading, atol=1e-6)
    assert np.ptp(np.unwrap(now[:, 3])) > 0.3
    assert np.abs(climb).max() > 0.1


def test_both_directions_pass_the_same_places_of_a_road() -> None:
    there, back = (plan_motion(replace(PLAN, direction=d), 7, make_road(5, HILLY)) for d in (1, -1))
    time_s = np.linspace(1.0, 12.0, 50)
    outward, homeward = poses_at(there, time_s), poses_at(back, back.duration_s - time_s)
    np.testing.assert_allclose(homeward[:, :3], outward[:, :3], atol=1e-9)
    np.testing.assert_allclose(homeward[:, 4], -outward[:, 4], atol=1e-12)
    np.testing.assert_allclose(np.cos(homeward[:, 3] - outward[:, 3]), -1.0, atol=1e-12)
    np.testing.assert_allclose(ground_up_at(back, back.duration_s - time_s), ground_up_at(there, time_s), atol=1e-9)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_curve_leads_away_from_under_the_antennas(direction: int) -> None:
    array = uniform_array(3, 0.5, x_m=3.0, height_m=0.3)  # y = +0.5, 0, -0.5
    motion = plan_motion(replace(STILL, direction=direction), 0, make_road(1, CIRCLE))
    time_s = scan_times(motion)
    along, cross = place_on_road(motion, time_s)
    # Seen from the circle's centre the axle lies 79.8 m away; forward of it and aside make a right triangle.
    aside = 79.8 - direction * array.y_m
    expected_cross = np.broadcast_to(80.0 - np.hypot(aside, 3.0), (len(time_s), 3))
    expected_along = along[:, None] + direction * 80.0 * np.arctan2(3.0, aside)[None]
    placed = antennas_on_road(motion, time_s, array)
    np.testing.assert_allclose(cross, 0.2, atol=1e-12)
    np.testing.assert_allclose(placed[..., 0], expected_along, atol=1e-7)
    np.testing.assert_allclose(placed[..., 1], expected_cross, atol=1e-7)
    np.testing.assert_allclose(placed[..., 2], 0.3, atol=1e-12)


def test_the_road_carries_the_vehicle_so_grade_and_bank_leave_the_antennas_height_alone() -> None:
    array = uniform_array(3, 0.5, x_m=3.0, height_m=0.3)
    road = make_road(5, HILLY)
    motion, level = (plan_motion(PLAN, 3, r) for r in (road, make_road(5, CURVY)))
    time_s = np.linspace(0.0, 12.0, 40)
    along, _ = place_on_road(motion, time_s)
    bank = wave_value(road.bank_rad, along)
    assert np.abs(bank).max() > 0.01
    own = wave_value(motion.roll, along)
    np.testing.assert_allclose(poses_at(motion, time_s)[:, 4], own + bank, atol=1e-15)
    expected = 0.3 + wave_value(motion.height, along)[:, None] + array.y_m[None] * np.sin(own)[:, None]
    np.testing.assert_allclose(antennas_on_road(motion, time_s, array)[..., 2], expected, atol=1e-12)
    np.testing.assert_allclose(ground_up_at(level, time_s), 0.0, atol=1e-15)
    assert motion.duration_s > level.duration_s  # a hill is longer than its plan


def test_roughness_comes_off_the_height_and_is_the_same_both_ways() -> None:
    array = uniform_array(5, 0.3, height_m=0.3)  # above the rear axle, all channels at once
    smooth, rough = make_road(1, RoadConfig()), make_road(1, RoadConfig(roughness_rms_m=0.003))
    there, back = (plan_motion(replace(STILL, direction=d), 0, rough) for d in (1, -1))
    time_s = scan_times(there)
    plain = antennas_on_road(plan_motion(STILL, 0, smooth), time_s, array)
    outward = antennas_on_road(there, time_s, array)
    homeward = antennas_on_road(back, back.duration_s - time_s, array)[:, ::-1]
    np.testing.assert_allclose(outward, homeward, atol=1e-9)
    sunk = roughness_value(rough.roughness, plain[..., 0], plain[..., 1])
    np.testing.assert_allclose(outward[..., 2], plain[..., 2] - sunk, atol=1e-15)
    assert sunk.std() == pytest.approx(0.003, rel=0.25)


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ({"lane_m": 81.0}, "81.0"),
        ({"stop_m": 113.0}, "112.0"),
        ({"stop_m": 0.0}, "start_m"),
        ({"direction": 0}, "direction"),
        ({"speed_mps": 0.0}, r"0\.0 m/s"),
        ({"scan_rate_hz": -1.0}, "-1.0 Hz"),
    ],
)
def test_a_plan_that_cannot_be_driven_is_refused(change: dict[str, float], value: str) -> None:
    """A lane beyond a curve's centre and a stop beyond the road too."""
    with pytest.raises(ValueError, match=value):
        plan_motion(replace(STILL, **change), 0, make_road(1, CIRCLE))  # type: ignore[arg-type]
