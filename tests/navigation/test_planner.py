"""Following a route: no change of branch, no creeping, nothing past a cusp, the same either way."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import (
    PlanCode,
    PlannerSettings,
    PlannerState,
    RoutePath,
    RouteSpeeds,
    choose,
    find_starts,
    make_route_path,
    planner_settings,
    step_planner,
)
from lgprjax.vehicle import Path, VehiclePose, eight_course, path_from_curvature
from navigation.planner_drives import CHASSIS, LEAD_M, POSITION_M, YAW_RAD, Driven, beside, drive, twice_round

SETTINGS = planner_settings(5.0)
LANES, STEPS = 100, 400
SLOW = RouteSpeeds(cruise_mps=5.0)
one_step = jax.jit(step_planner)
find_all = jax.jit(jax.vmap(find_starts, in_axes=(None, None, None, 0, None)))
choose_all = jax.jit(jax.vmap(choose))
find_one = jax.jit(find_starts)


def at(x_m: float, y_m: float, yaw_rad: float) -> VehiclePose:
    """A rear axle's pose from where the anchor stands."""
    lead = float(CHASSIS.anchor_m)
    return VehiclePose(
        jnp.float32(x_m - lead * np.cos(yaw_rad)), jnp.float32(y_m - lead * np.sin(yaw_rad)), jnp.float32(yaw_rad)
    )


def state_at(
    arc_m: float, pose: VehiclePose, *, leg: int = 0, travel: float = 1.0, facing: float = 1.0
) -> PlannerState:
    numbers = (jnp.float32(each) for each in (arc_m, travel, facing))
    arc, way, faces = numbers
    return PlannerState(jnp.int32(leg), arc, way, faces, pose, jnp.int32(PlanCode.FOLLOWING))


def three_point() -> RoutePath:
    """Forward 25 m along x, back on a curve to the left of 20 m, forward on a curve of 25 m."""
    back = path_from_curvature(np.full(80, 0.06), start=(25.0, 0.0, np.pi))
    end = np.asarray(back.rows, np.float64)[-1]
    heading = np.arctan2(end[3], end[2]) + np.pi
    on = path_from_curvature(np.full(100, 0.02), start=(end[0], end[1], heading))
    return make_route_path([path_from_curvature(np.zeros(100)), back, on], [1, -1, 1], CHASSIS, SLOW)


def turned_over(path: Path) -> Path:
    """The same ground the other way, from the rows' own ends."""
    rows = np.asarray(path.rows, np.float64)
    end = rows[-1]
    heading = np.arctan2(end[3], end[2]) + np.pi
    return path_from_curvature(-rows[1:-1, 4][::-1], start=(end[0], end[1], heading))


THREE_POINT = three_point()
_CURVES = 0.05 * np.sin(np.arange(300) / 30.0)
BENT = make_route_path([path_from_curvature(_CURVES)], [1], CHASSIS, SLOW)
OVER = make_route_path([turned_over(path_from_curvature(_CURVES))], [1], CHASSIS, SLOW)
IMAGE = make_route_path([path_from_curvature(-_CURVES)], [1], CHASSIS, SLOW)


def pose_beside(arc_m: float, facing: float, offset_m: float, error_rad: float) -> VehiclePose:
    """Beside the bent route."""
    numbers = (np.array([each]) for each in (arc_m, facing, offset_m, error_rad))
    return VehiclePose(*(each[0] for each in beside(BENT, 0, *numbers)))


def drive_from(
    route: RoutePath,
    arc_m: np.ndarray,
    facing: np.ndarray,
    seed: int,
    *,
    gear: float = 1.0,
    following: PlannerSettings = SETTINGS,
) -> tuple[Driven, np.ndarray]:
    """Lanes from random places beside the route, at random speeds, and the arc length each should have come to."""
    rng = np.random.default_rng(seed)
    lanes = len(arc_m)
    pose = beside(route, 0, arc_m, facing, rng.uniform(-1.0, 1.0, lanes), rng.uniform(-0.17, 0.17, lanes))
    starts = find_all(route, SETTINGS, CHASSIS, pose, jnp.float32(gear))
    # The operator knows on which of several branches he stands.
    apart = np.abs(np.asarray(starts.arc_m) - arc_m[:, None])
    if float(route.legs.laps_per_m[0]) > 0.0:
        apart = np.minimum(apart, np.abs(float(route.legs.length_m[0]) - apart))
    number = np.argmin(np.where(starts.valid, apart, np.inf), axis=1)
    assert apart[np.arange(lanes), number].max() < 0.01
    state, code = choose_all(starts, jnp.asarray(number))
    assert np.all(np.asarray(code) == PlanCode.FOLLOWING)
    np.testing.assert_array_equal(state.facing, facing)
    cruise = jnp.asarray(rng.uniform(1.0, 5.0, lanes), jnp.float32)
    driven = drive(STEPS, route, following, CHASSIS, state, pose, cruise, jnp.float32(1.0), jax.random.key(seed))
    return driven, np.asarray(state.arc_m) + np.asarray(state.travel) * np.asarray(driven.way_m, np.float64)


@pytest.mark.parametrize("course", ["twice round", "figure of eight"])
def test_no_change_of_branch_in_a_hundred_drives_either_way(course: str) -> None:
    route = twice_round() if course == "twice round" else make_route_path([eight_course(12.0)], [1], CHASSIS, SLOW)
    rng = np.random.default_rng(2)
    arc = rng.uniform(0.0, float(route.legs.length_m[0]), LANES)
    driven, true_arc = drive_from(route, arc, rng.choice([-1.0, 1.0], LANES), 3)
    # The planner saw each step before the way of the step was driven. The way of a wandering anchor is not quite the
    # route's: a metre in up to 190 m. Another branch is 88 m away.
    wrong = np.abs(np.asarray(driven.state.arc_m, np.float64)[1:] - true_arc[:-1])
    assert wrong.max() < 1.5
    assert set(np.unique(driven.plan.code)) <= {PlanCode.FOLLOWING, PlanCode.DONE}
    assert np.asarray(driven.way_m)[-1].max() > 150.0
    late = np.asarray(driven.plan.offset_m)[150:]
    assert np.abs(late).max() < 0.9


def test_the_position_threshold_keeps_the_branch_where_the_window_holds_another() -> None:
    # A window of just a lap to either side: its outermost points lie on the other lap, at the very same places.
    route = twice_round()
    wide = SETTINGS._replace(search_m=jnp.float32(88.0))
    rng = np.random.default_rng(8)
    arc, facing = rng.uniform(40.0, 196.0, LANES), rng.choice([-1.0, 1.0], LANES)
    changed = {}
    for threshold in (2.0, 1e9):
        following = wide._replace(position_threshold_m=jnp.float32(threshold))
        driven, true_arc = drive_from(route, arc, facing, 9, following=following)
        wrong = np.abs(np.asarray(driven.state.arc_m)[1:] - true_arc[:-1])
        changed[threshold] = int(np.sum(wrong.max(axis=0) > 44.0))
    assert changed[2.0] == 0
    assert changed[1e9] > LANES // 2


def test_backwards_along_the_route_the_look_ahead_is_long_enough() -> None:
    # Entered with 5 m, with which reversing is unstable: 2 |l − x_c| is 10.1 m here.
    route = make_route_path([path_from_curvature(0.02 * np.sin(np.arange(900) / 60.0))], [1], CHASSIS, SLOW)
    arc = np.linspace(100.0, 200.0, LANES)
    driven, true_arc = drive_from(route, arc, np.ones(LANES), 4, gear=-1.0)
    assert np.all(np.asarray(driven.plan.gear) == -1.0)
    assert np.all(np.asarray(driven.speed_mps)[50] < 0.0)
    assert np.abs(np.asarray(driven.state.arc_m)[1:] - true_arc[:-1]).max() < 1.5
    goal = np.hypot(np.asarray(driven.plan.ahead_m), np.asarray(driven.plan.left_m))
    assert goal.min() > 2.0 * LEAD_M
    assert np.abs(np.asarray(driven.plan.offset_m)[200:]).max() < 0.6


@pytest.fixture(scope="module")
def manoeuvre() -> tuple[RoutePath, Driven]:
    """Forward, back and forward again by lanes that begin on the first leg, half of them; the others from the end."""
    route = THREE_POINT
    rng = np.random.default_rng(5)
    first = beside(route, 0, np.full(LANES, 4.0), np.ones(LANES), rng.uniform(-0.3, 0.3, LANES), np.zeros(LANES))
    last = beside(route, 2, np.full(LANES, 21.0), -np.ones(LANES), rng.uniform(-0.3, 0.3, LANES), np.zeros(LANES))
    along = np.arange(LANES) % 2 == 0
    pose = VehiclePose(*(jnp.where(jnp.asarray(along), one, other) for one, other in zip(first, last, strict=True)))
    starts = find_all(route, SETTINGS, CHASSIS, pose, jnp.float32(1.0))
    number = np.argmax(np.asarray(starts.leg) == np.where(along, 0, 2)[:, None], axis=1)
    state, code = choose_all(starts, jnp.asarray(number))
    assert np.all(np.asarray(code) == PlanCode.FOLLOWING)
    np.testing.assert_array_equal(state.travel, np.where(along, 1.0, -1.0))
    cruise = jnp.full(LANES, 2.5, jnp.float32)
    return route, drive(STEPS + 200, route, SETTINGS, CHASSIS, state, pose, cruise, jnp.float32(1.0), jax.random.key(6))


def test_legs_follow_each_other_and_the_gear_changes_only_at_a_stand(manoeuvre: tuple[RoutePath, Driven]) -> None:
    _, driven = manoeuvre
    leg, code = np.asarray(driven.state.leg), np.asarray(driven.plan.code)
    along = np.arange(LANES) % 2 == 0
    np.testing.assert_array_equal(leg[0], np.where(along, 0, 2))
    np.testing.assert_array_equal(leg[-1], np.where(along, 2, 0))
    assert set(np.unique(np.diff(leg, axis=0)[:, along])) == {0, 1}
    assert set(np.unique(np.diff(leg, axis=0)[:, ~along])) == {0, -1}
    assert np.all(code[-1] == PlanCode.DONE)
    gear = np.asarray(driven.plan.gear)
    np.testing.assert_array_equal(gear, np.where(leg == 1, -1.0, 1.0))
    step, lane = np.nonzero(np.diff(gear, axis=0))
    assert len(step) == 2 * LANES
    assert np.abs(np.asarray(driven.speed_mps)[step, lane]).max() < 0.1


def test_it_stands_at_cusps_and_at_the_end(manoeuvre: tuple[RoutePath, Driven]) -> None:
    _, driven = manoeuvre
    leg, to_go = np.asarray(driven.state.leg), np.asarray(driven.plan.to_go_m)
    changes, lane = np.nonzero(np.diff(leg, axis=0))
    assert np.abs(to_go[changes, lane]).max() < 0.6
    assert np.abs(to_go[-1]).max() < 0.6
    assert np.abs(np.asarray(driven.speed_mps)[-1]).max() == 0.0
    limit = np.asarray(driven.plan.speed_limit_mps)
    assert np.all(limit <= np.maximum(np.sqrt(2.0 * 0.5 * np.maximum(to_go, 0.0)), 0.3) + 1e-4)


def test_goal_is_never_past_a_cusp() -> None:
    for arc_m, offset_m, error_rad, ahead_m in (
        (0.0, 0.0, 0.0, 1.0), (12.3, -0.8, 0.3, 9.0), (20.0, 0.5, -0.3, 14.0), (24.6, 0.8, 0.1, 14.0),
    ):  # fmt: skip
        pose = at(arc_m, offset_m, error_rad)
        following = SETTINGS._replace(look_ahead_m=jnp.float32(ahead_m))
        _, plan = one_step(THREE_POINT, following, CHASSIS, state_at(arc_m, pose), pose, jnp.float32(1.0))
        # The first leg is the x axis up to 25 m, and goes on as such; the next one turns back from there.
        goal = complex(float(plan.ahead_m), float(plan.left_m)) * np.exp(1j * error_rad) + complex(arc_m, offset_m)
        np.testing.assert_allclose((goal.real, goal.imag), (arc_m + ahead_m, 0.0), atol=2e-4)
        np.testing.assert_allclose(plan.to_go_m, 25.0 - arc_m, atol=1e-3)


def mirrored(pose: VehiclePose) -> VehiclePose:
    return VehiclePose(pose.x_m, -pose.y_m, -pose.yaw_rad)


@pytest.mark.parametrize(("arc_m", "offset_m", "error_rad"), [(8.0, 1.5, -0.4), (33.3, -1.2, 0.25), (60.0, 0.0, 0.0)])
def test_the_route_turned_over_and_its_mirror_image_give_the_same_plan(
    arc_m: float, offset_m: float, error_rad: float
) -> None:
    pose = pose_beside(arc_m, -1.0, offset_m, error_rad)
    speed = jnp.float32(2.0)
    _, plan = one_step(BENT, SETTINGS, CHASSIS, state_at(arc_m, pose, travel=-1.0, facing=-1.0), pose, speed)
    _, other = one_step(OVER, SETTINGS, CHASSIS, state_at(75.0 - arc_m, pose), pose, speed)
    _, image = one_step(
        IMAGE, SETTINGS, CHASSIS, state_at(arc_m, mirrored(pose), travel=-1.0, facing=-1.0), mirrored(pose), speed
    )
    # Where two rows meet either one's curvature may count: 0.0017 rad/m from row to row here.
    same = {"ahead_m": 1e-3, "left_m": 1e-3, "offset_m": 1e-3, "to_go_m": 1e-3, "gear": 0.0}
    same |= {"curvature_radpm": 2e-3, "heading_error_rad": 1e-2}
    for name, tolerance in same.items():
        np.testing.assert_allclose(getattr(plan, name), getattr(other, name), atol=tolerance, err_msg=name)
    signs = {"left_m": -1.0, "offset_m": -1.0, "heading_error_rad": -1.0, "curvature_radpm": -1.0}
    for name in (*same, "speed_limit_mps"):
        np.testing.assert_allclose(
            getattr(image, name), signs.get(name, 1.0) * getattr(plan, name), atol=3e-4, err_msg=name
        )
    np.testing.assert_allclose(plan.offset_m, -offset_m, atol=5e-3)
    # Half of what the route turns within a row at its sharpest, 0.05 rad/m over 0.25 m.
    np.testing.assert_allclose(plan.heading_error_rad, error_rad, atol=6.3e-3)


@jax.jit
def stand(state: PlannerState, poses: VehiclePose) -> tuple[PlannerState, jax.Array]:
    def step(state: PlannerState, pose: VehiclePose) -> tuple[PlannerState, jax.Array]:
        state, _ = step_planner(BENT, SETTINGS, CHASSIS, state, pose, jnp.float32(0.0))
        return state, state.arc_m

    return jax.lax.scan(step, state, poses)


def test_standing_still_with_noise_the_arc_does_not_creep() -> None:
    rng = np.random.default_rng(7)
    for arc_m, offset_m in ((5.0, -4.0), (42.0, 0.0), (70.0, 4.0)):
        exact = pose_beside(arc_m, 1.0, offset_m, 0.0)
        scatter = np.array([POSITION_M, POSITION_M, YAW_RAD])[:, None] * rng.standard_normal((3, 3000))
        scatter[:, -1] = 0.0
        poses = VehiclePose(*(each + jnp.asarray(more, jnp.float32) for each, more in zip(exact, scatter, strict=True)))
        final, arcs = stand(state_at(arc_m, exact), poses)
        # The last pose is without noise: 3,000 noisy ones must have left nothing behind.
        np.testing.assert_allclose(final.arc_m, arc_m, atol=2e-3)
        assert np.abs(np.asarray(arcs) - arc_m).max() < 0.5


def test_a_pose_that_is_no_number_leaves_the_state_and_asks_for_no_speed() -> None:
    pose = at(10.0, 0.2, 0.0)
    before, _ = one_step(THREE_POINT, SETTINGS, CHASSIS, state_at(10.0, pose), pose, jnp.float32(1.0))
    for bad in (pose._replace(x_m=jnp.float32(np.nan)), pose._replace(yaw_rad=jnp.float32(np.inf))):
        after, plan = one_step(THREE_POINT, SETTINGS, CHASSIS, before, bad, jnp.float32(1.0))
        assert plan.code == PlanCode.NON_FINITE
        assert float(plan.speed_limit_mps) == 0.0
        assert all(np.isfinite(float(each)) for each in plan)
        np.testing.assert_allclose(jax.tree.leaves(after), jax.tree.leaves(before), atol=1e-5)
        assert one_step(THREE_POINT, SETTINGS, CHASSIS, after, pose, jnp.float32(1.0))[1].code == 0


def test_off_the_route_by_more_than_ten_metres_it_stays_lost_until_asked() -> None:
    state = state_at(10.0, at(10.0, 0.0, 0.0))
    for offset, expected in ((9.9, 0), (10.1, PlanCode.OFF_ROUTE), (0.0, PlanCode.OFF_ROUTE)):
        state, plan = one_step(THREE_POINT, SETTINGS, CHASSIS, state, at(10.0, offset, 0.0), jnp.float32(1.0))
        assert plan.code == expected
        assert (float(plan.speed_limit_mps) > 0.0) == (expected == 0)
    starts = find_one(THREE_POINT, SETTINGS, CHASSIS, at(10.0, 0.0, 0.0))
    state, code = choose(starts, 0)
    assert code == PlanCode.FOLLOWING
    assert one_step(THREE_POINT, SETTINGS, CHASSIS, state, at(10.0, 0.0, 0.0), jnp.float32(1.0))[1].code == 0


def test_turned_round_it_says_so_and_goes_on_when_that_has_passed() -> None:
    state = state_at(10.0, at(10.0, 0.0, 0.0))
    for yaw, expected in ((1.0, 0), (2.5, PlanCode.WRONG_HEADING), (0.1, 0)):
        state, plan = one_step(THREE_POINT, SETTINGS, CHASSIS, state, at(10.0, 0.0, yaw), jnp.float32(1.0))
        assert plan.code == expected
        np.testing.assert_allclose(plan.heading_error_rad, yaw, atol=1e-5)
        np.testing.assert_allclose(state.arc_m, 10.0, atol=1e-4)
