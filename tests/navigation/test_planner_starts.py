"""Where a drive begins: the nearest place of the right heading, the operator's choice, or a clear no."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import (
    PlanCode,
    RoutePath,
    RouteSpeeds,
    acquire,
    choose,
    find_starts,
    make_route_path,
    planner_settings,
)
from lgprjax.vehicle import VehiclePose, eight_course, path_from_curvature
from navigation.planner_drives import CHASSIS, LEAD_M, beside, twice_round
from rollout_lanes import ANCHOR_M

SETTINGS = planner_settings(5.0)
SLOW = RouteSpeeds(cruise_mps=5.0)
LANES = 100
find_all = jax.jit(jax.vmap(find_starts, in_axes=(None, None, None, 0)))
acquire_all = jax.jit(jax.vmap(acquire))
find_one = jax.jit(find_starts)


def dense(route: RoutePath) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Arc length, position, heading and curvature of a lone leg, from its rows in float64, 0.25 m apart."""
    rows = np.asarray(route.legs.rows, np.float64)[0]
    count = round(float(route.legs.length_m[0]) / float(route.legs.spacing_m[0]))
    arc = np.arange(count + 1) * float(route.legs.spacing_m[0])
    used = rows[1 : count + 2]
    return arc, used[:, :2], np.arctan2(used[:, 3], used[:, 2]), used[:, 4]


def pose_at(x_m: float, y_m: float, yaw_rad: float) -> VehiclePose:
    x, y = x_m - ANCHOR_M * np.cos(yaw_rad), y_m - ANCHOR_M * np.sin(yaw_rad)
    return VehiclePose(jnp.float32(x), jnp.float32(y), jnp.float32(yaw_rad))


@pytest.mark.parametrize("course", ["twice round", "figure of eight"])
def test_a_start_is_asked_for_where_two_would_do_and_nowhere_else(course: str) -> None:
    route = twice_round() if course == "twice round" else make_route_path([eight_course(12.0)], [1], CHASSIS, SLOW)
    length = float(route.legs.length_m[0])
    rng = np.random.default_rng(11)
    true_arc, facing = rng.uniform(0.0, length, LANES), rng.choice([-1.0, 1.0], LANES)
    pose = beside(route, 0, true_arc, facing, rng.uniform(-2.0, 2.0, LANES), rng.uniform(-0.5, 0.5, LANES))
    starts = find_all(route, SETTINGS, CHASSIS, pose)
    state, code = acquire_all(starts)
    asked, began = np.asarray(code) == PlanCode.AMBIGUOUS, np.asarray(code) == PlanCode.FOLLOWING
    assert np.all(asked | began)

    # Every point of the dense route whose heading fits, and how much nearer than all others the nearest stretch is.
    arc, place, heading, bend = dense(route)
    lap = length if float(route.legs.laps_per_m[0]) > 0.0 else np.inf
    for lane in range(LANES):
        x, y, yaw = (float(each[lane]) for each in pose)
        anchor = np.array([x + ANCHOR_M * np.cos(yaw), y + ANCHOR_M * np.sin(yaw)])
        away = np.hypot(*(place - anchor).T)
        errors = [
            yaw - (heading + turn - np.arcsin(sign * LEAD_M * bend)) for sign, turn in ((1.0, 0.0), (-1.0, np.pi))
        ]
        error = np.min([np.abs(np.angle(np.exp(1j * each))) for each in errors], axis=0)
        sure = error < np.pi / 4 - 0.05
        best = int(np.argmin(np.where(sure, away, np.inf)))
        apart = np.abs(arc - arc[best])
        apart = np.minimum(apart, np.abs(lap - apart))
        lows = np.concatenate([[True], np.diff(away) < 0.0]) & np.concatenate([np.diff(away) > 0.0, [True]])
        rivals = lows & (apart > 3.0) & (away < away[best] + 1.4)
        if began[lane]:
            assert not np.any(rivals & sure)
            at = float(state.arc_m[lane])
            assert (
                min(abs(at - arc[best]), abs(lap - abs(at - arc[best]))) < 0.3
                or abs(float(starts.distance_m[lane, 0]) - away[best]) < 0.02
            )
        else:
            assert np.any(lows & (apart > 1.5) & (error < np.pi / 4 + 0.05) & (away < away[best] + 1.6))
    # On the circle that is driven twice it is always asked; far from it on the straights never.
    if course == "twice round":
        assert np.all(asked[(true_arc > 32.0) & (true_arc < 204.0)])
        assert np.all(began[true_arc < 12.0])
        assert 0.5 < asked.mean() < 0.95
    else:
        assert asked.mean() < 0.1
    np.testing.assert_array_equal(np.asarray(state.facing)[began], facing[began])
    np.testing.assert_array_equal(np.asarray(state.travel)[began], facing[began])
    assert np.all(np.asarray(state.code)[asked] == PlanCode.AMBIGUOUS)


def test_the_operator_chooses_among_the_places_and_only_among_them() -> None:
    route = twice_round()
    # On the circle, 20 m into the first lap.
    pose = VehiclePose(
        *(each[0] for each in beside(route, 0, np.array([50.0]), *(np.array([v]) for v in (1.0, 0.4, 0.0))))
    )
    starts = find_one(route, SETTINGS, CHASSIS, pose)
    assert starts.code == PlanCode.AMBIGUOUS
    np.testing.assert_allclose(np.sort(np.asarray(starts.arc_m)[np.asarray(starts.valid)]), [50.0, 138.0], atol=0.02)
    for number in (0, 1):
        state, code = choose(starts, number)
        assert code == state.code == PlanCode.FOLLOWING
        np.testing.assert_allclose(state.arc_m, starts.arc_m[number])
    for number in (2, -1, 99):
        state, code = choose(starts, number)
        assert code == state.code == PlanCode.AMBIGUOUS


def test_two_legs_at_a_cusp_are_two_places() -> None:
    back = path_from_curvature(np.full(80, 0.06), start=(25.0, 0.0, np.pi))
    route = make_route_path([path_from_curvature(np.zeros(100)), back], [1, -1], CHASSIS, SLOW)
    starts = find_one(route, SETTINGS, CHASSIS, pose_at(24.5, 0.0, 0.0))
    assert starts.code == PlanCode.AMBIGUOUS
    valid = np.asarray(starts.valid)
    found = sorted(zip(np.asarray(starts.leg)[valid].tolist(), np.asarray(starts.facing)[valid].tolist(), strict=True))
    assert found == [(0, 1.0), (1, 1.0)]
    # Early on the first leg nothing else is near.
    assert find_one(route, SETTINGS, CHASSIS, pose_at(5.0, 0.5, 0.0)).code == PlanCode.FOLLOWING


def test_a_start_is_refused_for_a_reason() -> None:
    route = make_route_path([path_from_curvature(np.zeros(100))], [1], CHASSIS, SLOW)
    for x_m, y_m, yaw_rad, expected in (
        (10.0, 9.9, 0.1, PlanCode.FOLLOWING),
        (10.0, 10.1, 0.1, PlanCode.OFF_ROUTE),
        (-9.9, 0.0, 0.0, PlanCode.FOLLOWING),
        (-10.1, 0.0, 0.0, PlanCode.OFF_ROUTE),
        (10.0, 0.5, np.pi / 4 + 0.02, PlanCode.WRONG_HEADING),
        (10.0, 0.5, -np.pi / 2, PlanCode.WRONG_HEADING),
        (10.0, 0.5, np.pi - 0.1, PlanCode.FOLLOWING),
        (np.nan, 0.5, 0.0, PlanCode.NON_FINITE),
        (10.0, 0.5, np.nan, PlanCode.NON_FINITE),
    ):
        starts = find_one(route, SETTINGS, CHASSIS, pose_at(x_m, y_m, yaw_rad))
        state, code = acquire(starts)
        assert code == state.code == expected, (x_m, y_m, yaw_rad)
        assert bool(starts.valid[0]) == (expected == PlanCode.FOLLOWING)
        assert all(np.all(np.isfinite(np.asarray(each, np.float64))) for each in jax.tree.leaves(state))
