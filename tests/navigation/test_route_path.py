"""From a recorded track to legs: noise goes, curvature stays, cusps are found, bends limit the speed."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.errors import InputError
from lgprjax.navigation import (
    RouteSpeeds,
    RouteTrack,
    is_closed,
    largest_curvature_radpm,
    leg_point,
    legs_of_track,
    make_route_path,
)
from lgprjax.vehicle import Path, arc_course, path_from_curvature, path_point
from navigation.planner_drives import CHASSIS, LEAD_M
from refusals import refusal_in, refused

FAST = RouteSpeeds(cruise_mps=5.0)


def circle(radius_m: float, turn_rad: float, step_m: float, sigma_m: float, seed: int = 0) -> RouteTrack:
    way = np.arange(0.0, radius_m * turn_rad, step_m)
    points = radius_m * np.stack([np.sin(way / radius_m), 1.0 - np.cos(way / radius_m)], axis=1)
    noise = sigma_m * np.random.default_rng(seed).standard_normal(points.shape)
    return RouteTrack("circle", points + noise, way / radius_m)


@pytest.mark.parametrize("radius_m", [8.0, 40.0])
def test_a_centimetre_of_noise_goes_and_constant_curvature_stays(radius_m: float) -> None:
    radii, bends = [], []
    for seed in range(6):
        legs, gears = legs_of_track(circle(radius_m, 40.0 / radius_m, 0.05, 0.01, seed))
        assert gears == [1]
        rows = np.asarray(legs[0].rows, np.float64)[13:-13]
        radii.append(np.hypot(rows[:, 0], rows[:, 1] - radius_m) - radius_m)
        bends.append(rows[:, 4] - 1.0 / radius_m)
    assert np.std(np.concatenate(radii)) < 4e-3
    assert abs(np.mean(radii)) < 1.2e-3
    assert np.std(np.concatenate(bends)) < 8e-3
    assert abs(np.mean(bends)) < 5e-4


def test_without_noise_the_bias_is_below_a_millimetre_and_nothing_is_cut_off() -> None:
    legs, _ = legs_of_track(circle(8.0, 5.0, 0.1, 0.0))
    rows = np.asarray(legs[0].rows, np.float64)[1:]
    assert np.abs(np.hypot(rows[:, 0], rows[:, 1] - 8.0) - 8.0).max() < 2e-3
    np.testing.assert_allclose(legs[0].length_m, 39.9, atol=0.02)
    np.testing.assert_allclose(rows[12:-12, 4], 0.125, atol=5e-4)


def three_point(sigma_m: float) -> RouteTrack:
    """Forward 20 m, a stand, back 12 m on a curve, forward 15 m straight: every 8 cm, with noise."""
    rng = np.random.default_rng(7)
    forward = np.arange(0.0, 20.0, 0.08)
    back = np.arange(0.0, 12.0, 0.08)
    on = np.arange(0.0, 15.0, 0.08)
    turn = back / 15.0
    x = 20.0 - 15.0 * np.sin(turn)
    y = 15.0 * (1.0 - np.cos(turn))
    yaw = -turn
    ahead = np.stack([x[-1] + on * np.cos(yaw[-1]), y[-1] + on * np.sin(yaw[-1])], axis=1)
    stand = np.tile([[20.0, 0.0]], (40, 1))
    points = np.concatenate([np.stack([forward, 0.0 * forward], axis=1), stand, np.stack([x, y], axis=1), ahead])
    yaws = np.concatenate([np.zeros(len(forward) + 40), yaw, np.full(len(on), yaw[-1])])
    return RouteTrack("shunt", points + sigma_m * rng.standard_normal(points.shape), yaws)


@pytest.mark.parametrize("sigma_m", [0.0, 0.01])
def test_cusps_cut_a_track_into_legs_with_gears(sigma_m: float) -> None:
    legs, gears = legs_of_track(three_point(sigma_m))
    assert gears == [1, -1, 1]
    np.testing.assert_allclose([float(leg.length_m) for leg in legs], [20.0, 12.0, 15.0], atol=0.35)
    for before, after in itertools.pairwise(legs):
        # The end of a leg is the start of the next one, turned round.
        end, start = np.asarray(before.rows, np.float64)[-1], np.asarray(after.rows, np.float64)[1]
        assert np.hypot(*(end[:2] - start[:2])) < 0.15
        assert end[2] * start[2] + end[3] * start[3] < -0.97


def test_turned_over_gears_stay_and_the_order_turns() -> None:
    track = three_point(0.0)
    legs, gears = legs_of_track(track)
    over, over_gears = legs_of_track(track.reversed())
    assert over_gears == gears[::-1]
    for one, other in zip(legs, over[::-1], strict=True):
        middle, same = (path_point(path, path.length_m / 2.0) for path in (one, other))
        np.testing.assert_allclose((middle.x_m, middle.y_m), (same.x_m, same.y_m), atol=0.1)
        np.testing.assert_allclose((middle.cos, middle.sin), (-same.cos, -same.sin), atol=0.02)


def test_a_track_that_is_no_route_is_refused_with_its_place() -> None:
    way = 0.1 * np.arange(200)
    points, yaw = np.stack([way, 0.0 * way], axis=1), 0.0 * way
    with refused("point 7", found="nan", file="t"):
        legs_of_track(RouteTrack("t", np.where(np.arange(200)[:, None] == 7, np.nan, points), yaw))
    gone = range(50, 180)
    with refused("4.9 m along the route", 10, found=13.1):
        legs_of_track(RouteTrack("t", np.delete(points, gone, 0), np.delete(yaw, gone)))
    for count, found_m in ((15, "1.40"), (1, "0.00")):
        with refused("points", 2, found=found_m):
            legs_of_track(RouteTrack("t", points[:count], yaw[:count]))


def test_ending_where_it_began_wants_place_and_heading() -> None:
    track = circle(12.0, 2.0 * np.pi, 0.1, 0.0)
    assert is_closed(track.points_m, track.yaw_rad)
    assert not is_closed(track.points_m[:600], track.yaw_rad[:600])
    assert not is_closed(track.points_m, track.yaw_rad + np.linspace(0.0, 1.0, len(track.yaw_rad)))


def test_the_tightest_circle_of_the_anchor_is_that_of_its_radius_about_the_turn_centre() -> None:
    # Straight from the axles' normals: front 0.6 rad, rear 0.63 × 0.6 rad the other way, 3.8 m apart.
    front, rear = np.tan(0.6), np.tan(0.63 * 0.6)
    centre_x = 3.8 * rear / (front + rear)
    assert largest_curvature_radpm(CHASSIS) == pytest.approx(1.0 / np.hypot(3.8 / (front + rear), 6.5 - centre_x), 1e-5)
    assert pytest.approx(6.5 - 3.8 * 0.63 / 1.63) == LEAD_M


def test_a_bend_that_the_vehicle_cannot_drive_is_refused_with_its_place() -> None:
    tightest = largest_curvature_radpm(CHASSIS)

    def legs(factor: float) -> list[Path]:
        bend = np.concatenate([np.zeros(200), np.full(40, factor * tightest), np.zeros(80)])
        return [path_from_curvature(np.zeros(80)), path_from_curvature(bend, start=(20.0, 0.0, np.pi))]

    assert int(make_route_path(legs(1.0), [1, -1], CHASSIS, FAST).leg_count) == 2
    with pytest.raises(InputError) as error:
        make_route_path(legs(1.15), [1, -1], CHASSIS, FAST, name="road")
    refusal = refusal_in(error.value)
    refusal.check(None, f"{1.0 / tightest:.2f}", file="road", found=f"{1.0 / tightest / 1.15:.2f}")
    # 20 m of the first leg and 50 m of the second, and then some.
    assert 70.0 <= float(refusal.place.split()[0]) < 73.0
    assert int(make_route_path(legs(1.15), [1, -1], None, FAST).leg_count) == 2


def test_legs_that_do_not_fit_together_are_refused() -> None:
    straight, ring = path_from_curvature(np.zeros(80)), arc_course(12.0, 2.0 * np.pi)
    for legs, gears in (([], []), ([straight], [2]), ([straight], [1, 1])):
        with refused("legs", found=gears):
            make_route_path(legs, gears, CHASSIS, FAST)
    with refused("legs", found=2):
        make_route_path([ring, straight], [1, 1], CHASSIS, FAST)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with refused("cruise_mps", found=f"{bad:g}"):
            RouteSpeeds(cruise_mps=bad)


def test_routes_of_like_length_have_one_shape_and_padding_goes_straight_on() -> None:
    short, long = (make_route_path([path_from_curvature(np.full(n, 0.01))], [1], CHASSIS, FAST) for n in (520, 900))
    assert short.legs.rows.shape == long.legs.rows.shape == (1, 1024, 5)
    legs = [path_from_curvature(np.zeros(80))] * 3
    three = make_route_path(legs, [1, -1, 1], CHASSIS, FAST)
    assert three.legs.rows.shape == (4, 512, 5)
    assert int(three.leg_count) == 3
    # Beyond the end the table is the straight continuation, inside its rows and beyond the last of them.
    end = path_point(path_from_curvature(np.full(520, 0.01)), jnp.float32(130.0))
    for beyond in (0.1, 7.3, 60.0, 200.0):
        on = leg_point(short, jnp.int32(0), jnp.float32(130.0 + beyond))
        np.testing.assert_allclose(
            (on.x_m, on.y_m), (end.x_m + beyond * end.cos, end.y_m + beyond * end.sin), atol=1e-3
        )
        assert float(on.curvature_radpm) == 0.0


def test_every_leg_is_looked_up_as_its_own_path() -> None:
    first, second = (
        path_from_curvature(bend * np.sin(np.arange(300) / 20.0), start=(3.0, 1.0, 0.4)) for bend in (0.05, -0.08)
    )
    route = make_route_path([first, second], [1, -1], CHASSIS, FAST)
    for leg, path in enumerate((first, second)):
        for arc in (-3.0, 0.0, 0.2, 33.37, 74.9, 80.0):
            here, there = leg_point(route, jnp.int32(leg), jnp.float32(arc)), path_point(path, jnp.float32(arc))
            np.testing.assert_allclose(np.asarray(here), np.asarray(there), atol=2e-5)


def test_speed_falls_before_a_bend_and_rises_after_it_as_the_limits_say() -> None:
    radius = 7.0
    bend = np.concatenate([np.zeros(200), np.full(80, 1.0 / radius), np.zeros(200)])
    speeds = RouteSpeeds(cruise_mps=6.0, lateral_mps2=1.0, change_mps2=0.4)
    route = make_route_path([path_from_curvature(bend)], [1], CHASSIS, speeds)
    speed = np.asarray(route.speed_mps, np.float64)[0, 1:481]
    way = 0.25 * np.arange(480)
    np.testing.assert_allclose(speed[210:270], np.sqrt(1.0 * radius), rtol=1e-5)
    # At d from the bend v² is a R + 2 a' d; the mean over two metres makes the bend begin up to a metre later.
    away = np.maximum(np.maximum(50.0 - way, way + 0.25 - 70.0), 0.0)
    least, most = (np.minimum(np.sqrt(radius + 2.0 * 0.4 * (away + late)), 6.0) for late in (-0.25, 1.0))
    assert np.all((speed > least - 1e-4) & (speed < most + 1e-4))
    assert speed.max() <= 6.0
    assert np.abs(np.diff(speed**2)).max() <= 2.0 * 0.4 * 0.25 + 1e-5
    np.testing.assert_allclose(speed, speed[::-1], atol=1e-3)


def test_a_closed_leg_slows_before_its_end_for_a_bend_after_its_start() -> None:
    # A stadium that begins just before one of its half circles.
    half, straight = np.full(64, np.pi / 16.0), np.zeros(120)
    bend = np.concatenate([np.zeros(8), half, straight, half, np.zeros(112)])
    route = make_route_path([path_from_curvature(bend, closed=True)], [1], None, RouteSpeeds(5.0, change_mps2=0.3))
    count = len(bend)
    square = np.asarray(route.speed_mps, np.float64)[0, 1 : count + 1] ** 2
    around = np.append(square, square[0])
    assert np.abs(np.diff(around)).max() <= 2.0 * 0.3 * 0.25 + 1e-5
    assert square[-1] < 0.6 * square.max()
