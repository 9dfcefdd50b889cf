"""Turns: that they end where they should, against small steps; their lengths against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lgprjax.coverage.turns import HeadlandTurn, Pose, dubins_ways, one_handed_turn, poses_along, turn_points

ANGLE = st.floats(-math.pi, math.pi)
PLACE = st.floats(-20.0, 20.0)


def walk(start: Pose, pieces: np.ndarray, steps: int = 4000) -> np.ndarray:
    """Where pieces lead, by midpoint steps."""
    x, y, yaw = start
    for length, curvature in pieces:
        step = length / steps
        yaws = yaw + curvature * step * (np.arange(steps) + 0.5)
        x, y, yaw = x + step * np.cos(yaws).sum(), y + step * np.sin(yaws).sum(), yaw + curvature * length
    return np.array([x, y, yaw])


@settings(deadline=None, max_examples=15)
@given(x=PLACE, y=PLACE, yaw=ANGLE, end_x=PLACE, end_y=PLACE, end_yaw=ANGLE, radius_m=st.floats(0.3, 8.0))
def test_every_dubins_way_ends_in_the_pose_asked_for(
    x: float, y: float, yaw: float, end_x: float, end_y: float, end_yaw: float, radius_m: float
) -> None:
    start, end = Pose(x, y, yaw), Pose(end_x, end_y, end_yaw)
    ways = dubins_ways(start, end, radius_m)
    assert len(ways) >= 2
    lengths = [way[:, 0].sum() for way in ways]
    assert lengths == sorted(lengths)
    for way in ways:
        assert np.all(way[:, 0] >= 0.0)
        np.testing.assert_allclose(np.abs(way[:, 1][way[:, 1] != 0.0]), 1.0 / radius_m)
        last = walk(start, way)
        assert np.hypot(last[0] - end_x, last[1] - end_y) < 1e-4 * radius_m + 1e-6
        assert abs(math.remainder(last[2] - end_yaw, 2.0 * math.pi)) < 1e-6
    assert lengths[0] >= math.hypot(end_x - x, end_y - y) - 1e-9
    # The way back, driven the other way round, is as long.
    back = dubins_ways(Pose(end_x, end_y, end_yaw + math.pi), Pose(x, y, yaw + math.pi), radius_m)
    assert math.isclose(back[0][:, 0].sum(), lengths[0], rel_tol=1e-6, abs_tol=1e-6)


@settings(deadline=None, max_examples=15)
@given(radius_m=st.floats(0.5, 6.0), share=st.floats(0.02, 1.9), hand=st.sampled_from([1.0, -1.0]))
def test_between_close_lines_the_shortest_turn_is_the_bulb_of_the_closed_form(
    radius_m: float, share: float, hand: float
) -> None:
    apart_m = share * radius_m
    way = dubins_ways(Pose(0.0, 0.0, 0.0), Pose(0.0, hand * apart_m, math.pi), radius_m)[0]
    # Three circles: the outer ones 2R + w apart, the middle one touching both.
    lean = math.acos((2.0 * radius_m + apart_m) / (4.0 * radius_m))
    np.testing.assert_allclose(way[:, 0].sum(), radius_m * (math.pi + 4.0 * lean), rtol=1e-9)
    np.testing.assert_allclose(way[:, 1] * radius_m, [-hand, hand, -hand])
    poses = poses_along(Pose(0.0, 0.0, 0.0), way, np.linspace(0.0, way[:, 0].sum(), 20_001))
    depth_m = radius_m + math.sqrt(4.0 * radius_m**2 - (radius_m + apart_m / 2.0) ** 2)
    np.testing.assert_allclose(poses[:, 0].max(), depth_m, rtol=1e-6)


@pytest.mark.parametrize("apart_m", [-7.0, 4.0])
def test_a_one_handed_turn_is_two_quarters_and_what_lies_between(apart_m: float) -> None:
    pieces = one_handed_turn(apart_m, 2.0)
    last = walk(Pose(1.0, 2.0, 0.5), pieces)
    np.testing.assert_allclose(last[:2] - [1.0, 2.0], apart_m * np.array([-math.sin(0.5), math.cos(0.5)]), atol=1e-6)
    assert math.isclose(last[2], 0.5 + math.copysign(math.pi, apart_m))
    assert math.isclose(pieces[:, 0].sum(), 2.0 * math.pi + abs(apart_m) - 4.0)
    assert len(pieces) == (1 if abs(apart_m) == 4.0 else 3)


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**31))
def test_poses_along_pieces_are_those_of_small_steps_and_go_straight_on_beyond(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pieces = np.stack([rng.uniform(0.0, 4.0, 5), rng.choice([0.0, 0.5, -0.8], 5)], axis=1)
    start = Pose(*rng.uniform(-3.0, 3.0, 3))
    total = pieces[:, 0].sum()
    assume(total > 1.0)
    poses = poses_along(start, pieces, np.array([-2.0, 0.0, total, total + 3.0]))
    np.testing.assert_allclose(poses[1], start, atol=1e-12)
    np.testing.assert_allclose(
        poses[0], poses[1] - 2.0 * np.array([math.cos(start.yaw_rad), math.sin(start.yaw_rad), 0.0])
    )
    np.testing.assert_allclose(poses[2], walk(start, pieces), atol=1e-5)
    yaw = poses[2, 2]
    np.testing.assert_allclose(poses[3], poses[2] + 3.0 * np.array([math.cos(yaw), math.sin(yaw), 0.0]), atol=1e-12)
    part = rng.uniform(0.0, total)
    cut = np.minimum(pieces[:, 0], np.maximum(part - np.concatenate([[0.0], np.cumsum(pieces[:-1, 0])]), 0.0))
    np.testing.assert_allclose(
        poses_along(start, pieces, np.array([part]))[0], walk(start, np.stack([cut, pieces[:, 1]], axis=1)), atol=1e-5
    )


def test_a_turn_tells_its_length_its_tightest_arc_and_its_points() -> None:
    turn = HeadlandTurn(Pose(0.0, 0.0, 0.0), np.array([[1.0, 0.0], [math.pi, 0.5], [2.0, -0.25]]))
    assert math.isclose(turn.length_m, 3.0 + math.pi)
    assert math.isclose(turn.tightest_radius_m, 2.0)
    assert HeadlandTurn(turn.start, turn.pieces[:1]).tightest_radius_m == math.inf
    points = turn_points(turn, 0.5)
    steps = np.hypot(*np.diff(points, axis=0).T)
    assert steps.max() <= 0.5
    np.testing.assert_array_equal(points[0], [0.0, 0.0])
    np.testing.assert_allclose(points[-1], walk(turn.start, turn.pieces)[:2], atol=1e-5)
