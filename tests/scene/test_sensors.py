"""Odometer and GNSS/INS against the truth: size and memory of the errors, jumps, outages, slip, streams."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene.motion import DriveMotion, DrivePlan, plan_motion, poses_at
from lgprjax.scene.road import RoadConfig, make_road
from lgprjax.scene.sensors import NavigationErrors, PoseTrack, gauss_markov, observe_drive

PLAN = DrivePlan(0.0, 60.0, lane_m=0.2)
LONG = plan_motion(DrivePlan(0.0, 270.0, wander_m=0.0), 0)  # 60 s due east
# Without the slow errors, so that what an event adds stands alone.
BARE = NavigationErrors(
    rate_hz=10.0,
    position_sigma_m=0.0,
    height_sigma_m=0.0,
    heading_sigma_rad=0.0,
    roll_sigma_rad=0.0,
    odometer_scale_error=0.0,
    odometer_noise_m=0.0,
)


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


def test_a_bias_shifts_the_whole_track_and_the_sigmas_are_those_of_the_errors() -> None:
    errors = NavigationErrors(rate_hz=10.0, position_sigma_m=0.01, height_sigma_m=0.03)
    (_, plain), (_, biased) = (observe_drive(LONG, replace(errors, position_bias_m=b), 3) for b in ((0, 0), (1, -0.5)))
    np.testing.assert_allclose(biased.pose - plain.pose, [[1.0, -0.5, 0, 0, 0]] * len(plain.pose), atol=1e-12)
    expected = [0.01, 0.01, 0.03, np.radians(0.3), np.radians(0.1)]
    np.testing.assert_array_equal(_sigma(plain), np.tile(expected, (len(plain.time_s), 1)))


def test_an_outage_carries_on_from_the_last_error_and_ends_at_once() -> None:
    plain_errors = NavigationErrors(rate_hz=10.0)
    _, plain = observe_drive(LONG, plain_errors, 1)
    _, track = observe_drive(LONG, replace(plain_errors, outages_s=((20.0, 40.0),)), 1)
    out = (track.time_s >= 20.0) & (track.time_s < 40.0)
    np.testing.assert_array_equal(track.pose[~out], plain.pose[~out])
    np.testing.assert_array_equal(_sigma(track)[~out], _sigma(plain)[~out])
    np.testing.assert_array_equal(track.pose[:, 4], plain.pose[:, 4])  # gravity holds roll
    truth = poses_at(LONG, track.time_s)
    held = (track.pose - truth)[out][:, :4] - (plain.pose - truth)[out][0, :4]
    np.testing.assert_allclose(held[0], 0.0, atol=1e-12)
    assert np.abs(held[:5, :3]).max() < 0.01
    assert np.all(np.abs(held[-1, :2]) > 0)
    grown = np.diff(_sigma(track)[out], axis=0)
    assert np.all(grown[1:, :4] > 0)  # a step of the walk moves the place from the next sample on
    assert np.all(grown[0, :3] == 0)


def test_the_error_of_an_outage_grows_as_documented() -> None:
    walk, turn = 0.01, 0.001
    errors = replace(BARE, outages_s=((10.0, 50.0),), velocity_walk=walk, heading_walk=turn)
    wrong, sigma = _errors_over_seeds(LONG, errors, 300)
    for since in (10.0, 20.0, 39.9):
        at = round((10.0 + since) * 10)
        along = walk * since**1.5 / np.sqrt(3)
        across = np.hypot(walk, 4.5 * turn) * since**1.5 / np.sqrt(3)
        documented = [along, across, along, turn * np.sqrt(since), 0.0]
        np.testing.assert_allclose(sigma[at], documented, rtol=0.02)
        np.testing.assert_allclose(wrong[:, at].std(axis=0), documented, rtol=0.15)
    np.testing.assert_array_equal(wrong[:, 500:], 0.0)


def test_on_a_curve_too_the_reported_sigma_is_that_of_the_errors() -> None:
    road = make_road(1, RoadConfig(length_m=270.0, arcs=((270.0, 1 / 80),)))
    motion = plan_motion(DrivePlan(0.0, 270.0), 0, road)
    errors = replace(BARE, outages_s=((0.0, 60.0),), velocity_walk=0.001, heading_walk=0.001)
    wrong, sigma = _errors_over_seeds(motion, errors, 300)
    for at in (150, 300, 599):
        np.testing.assert_allclose(wrong[:, at, :4].std(axis=0), sigma[at, :4], rtol=0.15)
    assert sigma[400, 0] > 1.3 * sigma[400, 1]  # half-way round, the path has led north: heading moves it east


def test_a_heading_error_turns_the_rest_of_the_path_about_its_place() -> None:
    """One step of heading, everything else off: integrated here by driving the wrong way."""
    road = make_road(1, RoadConfig(length_m=270.0, arcs=((270.0, 1 / 80),)))
    motion = plan_motion(DrivePlan(0.0, 270.0, wander_m=0.0), 0, road)
    errors = replace(BARE, rate_hz=50.0, outages_s=((5.0, 55.0),), velocity_walk=0.0, heading_walk=1e-4)
    _, track = observe_drive(motion, errors, 4)
    out = (track.time_s >= 5.0) & (track.time_s < 55.0)
    true, seen = poses_at(motion, track.time_s)[out], track.pose[out]
    yaw = 0.5 * (seen[1:, 3] + seen[:-1, 3])
    step = np.linalg.norm(np.diff(true[:, :2], axis=0), axis=1)
    driven = np.cumsum(step[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=1), axis=0) + true[0, :2]
    displaced = np.abs(seen[1:, :2] - true[1:, :2]).max()
    assert displaced > 0.02
    np.testing.assert_allclose(seen[1:, :2], driven, atol=0.02 * displaced)


def test_a_jump_displaces_the_track_for_its_time_and_gives_nothing_away() -> None:
    plain_errors = NavigationErrors(rate_hz=10.0)
    jumps = replace(plain_errors, jump_start_s=(10.0, 30.0), jump_held_s=5.0)
    (odometer, plain), (same, track) = (observe_drive(LONG, e, 1) for e in (plain_errors, jumps))
    np.testing.assert_array_equal(odometer.distance_m, same.distance_m)
    moved = track.pose - plain.pose
    inside = [(track.time_s >= t) & (track.time_s < t + 5.0) for t in (10.0, 30.0)]
    np.testing.assert_array_equal(moved[~(inside[0] | inside[1])], 0.0)
    np.testing.assert_array_equal(moved[:, 2:], 0.0)
    for held in inside:
        assert held.sum() == 50
        np.testing.assert_allclose(moved[held, :2], np.tile(moved[held, :2][0], (50, 1)), atol=1e-12)
    assert np.abs(moved[inside[0]][0, :2] - moved[inside[1]][0, :2]).min() > 0.01
    np.testing.assert_array_equal(_sigma(track), _sigma(plain))
    _, told = observe_drive(LONG, replace(jumps, jump_sigma_factor=3.0), 1)
    np.testing.assert_allclose(_sigma(told)[inside[0], :2], 0.15)
    np.testing.assert_array_equal(_sigma(told)[:, 2:], _sigma(plain)[:, 2:])


def test_jumps_have_their_rate_and_size() -> None:
    wrong, _ = _errors_over_seeds(
        LONG, replace(BARE, rate_hz=5.0, jumps_per_hour=60.0, jump_held_s=0.5, jump_sigma_m=3.0), 400
    )
    jumped = np.abs(np.diff(wrong[..., 0], axis=1)) > 0
    # A jump comes and goes; one in a minute is drawn a drive, some too late to end within it.
    assert jumped.sum() / 2 / 400 == pytest.approx(1.0, abs=0.15)
    sizes = wrong[..., :2][np.abs(wrong[..., 0]) > 0]
    np.testing.assert_allclose(sizes.std(axis=0), 3.0, rtol=0.12)


def test_random_outages_and_slips_have_their_rate_and_length() -> None:
    errors = replace(BARE, rate_hz=5.0, outages_per_hour=30.0, outage_held_s=4.0, slips_per_hour=30.0, slip_held_s=2.0)
    out, slipped = [], []
    for seed in range(300):
        odometer, track = observe_drive(LONG, errors, seed)
        out.append(np.mean(_sigma(track)[:, 3] > 0))
        slipped.append(odometer.distance_m[-1] - 4.5 * odometer.time_s[-1])
    # Half an event a minute, now and then one over another or past the end: a little less than their sum.
    assert 0.75 < np.mean(out) / (0.5 * 4.0 / 60.0) < 1.1
    assert 0.8 < np.mean(slipped) / (0.5 * 2.0 * 0.1 * 4.5) < 1.1
    assert abs(np.corrcoef(out, slipped)[0, 1]) < 0.2  # each from a stream of its own


def test_slip_is_what_the_odometer_reads_beyond_the_way() -> None:
    errors = replace(BARE, rate_hz=100.0, slips_s=((10.0, 12.0), (11.0, 13.0), (30.005, 30.505)), slip_fraction=0.2)
    odometer, _ = observe_drive(LONG, errors, 1)
    beyond = odometer.distance_m - 4.5 * odometer.time_s
    corners, values = [0.0, 10.0, 13.0, 30.005, 30.505, 62.0], np.array([0.0, 0.0, 3.0, 3.0, 3.5, 3.5])
    np.testing.assert_allclose(beyond, 0.2 * 4.5 * np.interp(odometer.time_s, corners, values), atol=1e-9)


def test_the_slow_part_of_the_scale_has_its_sigma_and_memory() -> None:
    motion = plan_motion(DrivePlan(0.0, 20_000.0, speed_mps=10.0, wander_m=0.0), 0)
    odometer, _ = observe_drive(motion, replace(BARE, odometer_drift=0.01, odometer_drift_s=2.0), 3)
    scale = np.diff(odometer.distance_m) / np.diff(odometer.time_s) / 10.0 - 1
    assert scale.std() == pytest.approx(0.01, rel=0.1)
    assert np.corrcoef(scale[:-20], scale[20:])[0, 1] == pytest.approx(np.exp(-1), abs=0.05)


def test_the_encoder_counts_whole_steps() -> None:
    plain, counted = (observe_drive(LONG, replace(BARE, odometer_step_m=m), 1)[0].distance_m for m in (0.0, 0.02))
    counts = counted / 0.02
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.all((plain - counted > -1e-9) & (plain - counted < 0.02))


def test_the_tracks_may_have_different_rates_and_an_outage_draws_the_same_however_many_came_before() -> None:
    plain_errors = NavigationErrors(rate_hz=10.0, outages_s=((40.0, 50.0),))
    _, plain = observe_drive(LONG, plain_errors, 1)
    odometer, track = observe_drive(LONG, replace(plain_errors, odometer_rate_hz=200.0), 1)
    np.testing.assert_array_equal(track.pose, plain.pose)
    np.testing.assert_allclose(np.diff(odometer.time_s), 0.005, atol=1e-12)
    assert odometer.time_s[-1] >= LONG.duration_s
    noise = odometer.distance_m - 1.005 * 4.5 * odometer.time_s
    assert noise.std() == pytest.approx(0.002, rel=0.05)
    _, two = observe_drive(LONG, replace(plain_errors, outages_s=((5.0, 15.0), (40.0, 50.0))), 1)
    np.testing.assert_array_equal(plain.pose[200:], two.pose[200:])
    assert not np.array_equal(plain.pose[:200], two.pose[:200])


def test_each_effect_draws_from_its_own_stream() -> None:
    """What is wrong with the receiver leaves odometer and roll alone; what is wrong with the odometer, the receiver."""
    errors = NavigationErrors(
        rate_hz=10.0, odometer_drift=0.01, slips_per_hour=300.0, jumps_per_hour=200.0, outages_per_hour=100.0
    )
    steady = replace(errors, jumps_per_hour=0.0, outages_per_hour=0.0)
    odometer, track = observe_drive(LONG, steady, 2)
    receiver: dict[str, Any] = {
        "jumps_per_hour": 600.0,
        "outages_per_hour": 300.0,
        "jump_start_s": (20.0,),
        "outages_s": ((20.0, 21.0),),
    }
    for name, value in receiver.items():
        same, changed = observe_drive(LONG, replace(steady, **{name: value}), 2)
        np.testing.assert_array_equal(same.distance_m, odometer.distance_m)
        np.testing.assert_array_equal(changed.pose[:, 4], track.pose[:, 4])
        assert 0.0 < np.all(changed.pose == track.pose, axis=1).mean() < 1.0
    odometer, track = observe_drive(LONG, errors, 2)
    wheels: dict[str, Any] = {
        "odometer_drift": 0.02,
        "slips_per_hour": 600.0,
        "slips_s": ((20.0, 21.0),),
        "odometer_step_m": 0.1,
    }
    for name, value in wheels.items():
        read, alike = observe_drive(LONG, replace(errors, **{name: value}), 2)
        np.testing.assert_array_equal(alike.pose, track.pose)
        np.testing.assert_array_equal(_sigma(alike), _sigma(track))
        assert not np.array_equal(read.distance_m, odometer.distance_m)


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ({"rate_hz": 0.0}, "0.0"),
        ({"odometer_rate_hz": -1.0}, "-1.0"),
        ({"outages_s": ((5.0, 5.0),)}, "5.0"),
        ({"slips_s": ((5.0, 4.0),)}, "4.0"),
    ],
)
def test_errors_that_cannot_be_are_refused(change: dict[str, float], value: str) -> None:
    with pytest.raises(ValueError, match=value):
        observe_drive(LONG, replace(BARE, **change), 0)  # type: ignore[arg-type]


def _errors_over_seeds(
    motion: DriveMotion, errors: NavigationErrors, seeds: int
) -> tuple[Float[np.ndarray, "seed time 5"], Float[np.ndarray, "time 5"]]:
    tracks = [observe_drive(motion, errors, seed)[1] for seed in range(seeds)]
    truth = poses_at(motion, tracks[0].time_s)
    return np.stack([track.pose - truth for track in tracks]), _sigma(tracks[0])


def _sigma(track: PoseTrack) -> Float[np.ndarray, "time 5"]:
    assert track.sigma is not None
    return track.sigma
