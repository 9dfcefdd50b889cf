"""Carrot and pursuit on a route of plain geometry: angles by NumPy, drives by exact arcs."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from lgprjax.coverage import CarrotPlan, CarrotSettings, CarrotState, default_carrot, init_carrot
from lgprjax.coverage.guidance import pursuit_along, step_carrot
from lgprjax.vehicle import VehiclePose, drive_skid_arc, wheel_speeds

from .made_route import LINE_M, RADIUS_M, made_route

ROUTE = made_route()
STEP_S, SPEED_MPS, TRACK_M = 0.05, 0.4, 1.0
LAWS = {"carrot": step_carrot, "pursuit": pursuit_along}
MIDWAY = init_carrot()._replace(begun=jnp.asarray(True), carrot_m=jnp.float32(11.2), arc_m=jnp.float32(10.0))


def settings(**changes: float) -> CarrotSettings:
    return default_carrot(smallest_radius_m=1.5)._replace(**{name: jnp.float32(to) for name, to in changes.items()})


def pose(x_m: float, y_m: float, yaw_rad: float) -> VehiclePose:
    return VehiclePose(*(jnp.float32(value) for value in (x_m, y_m, yaw_rad)))


@partial(jax.jit, static_argnums=0)
def once(
    law: str, settings: CarrotSettings, state: CarrotState, pose: VehiclePose, step_s: Float[Array, ""]
) -> tuple[CarrotState, CarrotPlan]:
    return LAWS[law](settings, ROUTE, state, pose, jnp.float32(SPEED_MPS), step_s)


@partial(jax.jit, static_argnums=0)
def drive(law: str, settings: CarrotSettings, start: VehiclePose) -> tuple[VehiclePose, CarrotPlan]:
    """A drive of 190 s without lag or slip, slowed where the plan says so."""

    def step(carried, _):  # type: ignore[no-untyped-def]
        state, pose = carried
        state, plan = LAWS[law](settings, ROUTE, state, pose, jnp.float32(SPEED_MPS), jnp.float32(STEP_S))
        speed = jnp.minimum(jnp.float32(SPEED_MPS), plan.speed_limit_mps)
        wheels = wheel_speeds(jnp.float32(TRACK_M), speed, plan.yaw_rate_radps * speed / SPEED_MPS)
        return (state, drive_skid_arc(pose, jnp.float32(TRACK_M), wheels, jnp.float32(STEP_S))), (pose, plan)

    driven: tuple[VehiclePose, CarrotPlan] = jax.lax.scan(step, (init_carrot(), start), None, 3800)[1]
    return driven


def wanted_curvature(x_m: float, y_m: float, yaw_rad: float, told: CarrotSettings) -> float:
    """P e + D de/ds on the first line, the carrot 1.2 m ahead of the foot, the change by a small step of both."""

    def error(x: float, y: float, carrot: float) -> float:
        return float(np.arctan2(-y, carrot - x))

    small = 1e-5
    ahead = x_m + 1.2
    moved = error(x_m + small * np.cos(yaw_rad), y_m + small * np.sin(yaw_rad), ahead + small)
    change = (moved - error(x_m, y_m, ahead)) / small
    return float(told.proportional_per_m) * error(x_m, y_m, ahead) + float(told.derivative) * change


@pytest.mark.parametrize(("y_m", "yaw_rad"), [(0.2, 0.0), (-0.1, 0.1), (0.05, -0.2)])
def test_the_law_is_that_of_the_angles(y_m: float, yaw_rad: float) -> None:
    told = settings()
    _, plan = once("carrot", told, MIDWAY, pose(10.0, y_m, yaw_rad), jnp.float32(0.0))
    expected = SPEED_MPS * wanted_curvature(10.0, y_m, yaw_rad, told)
    assert float(plan.yaw_rate_radps) == pytest.approx(expected, abs=2e-4)
    assert float(plan.cross_m) == pytest.approx(y_m, abs=1e-5)
    assert float(plan.heading_error_rad) == pytest.approx(yaw_rad, abs=1e-5)


def test_pursuit_is_the_pid_of_two_over_the_distance_and_two_for_small_errors() -> None:
    told = settings(proportional_per_m=2.0 / 1.2, derivative=2.0, lead_s=0.0)
    at = pose(10.0, 0.01, 0.005)
    by_pid, by_arc = (once(law, told, MIDWAY, at, jnp.float32(0.0))[1].yaw_rate_radps for law in LAWS)
    assert float(by_pid) == pytest.approx(float(by_arc), rel=2e-3)
    assert abs(float(by_arc)) > 1e-3


def test_the_carrot_waits_for_the_vehicle() -> None:
    told = settings()
    state, plan = once("carrot", told, init_carrot(), pose(-1.4, 0.3, 0.0), jnp.float32(STEP_S))
    assert float(state.carrot_m) == 0.0
    assert not bool(state.begun)
    assert not bool(plan.tool_on)
    state, _ = once("carrot", told, state, pose(-1.0, 0.3, 0.0), jnp.float32(STEP_S))
    assert bool(state.begun)
    # No faster than half as fast again as the vehicle.
    assert 0.0 < float(state.carrot_m) <= 1.5 * SPEED_MPS * STEP_S + 1e-6


def test_a_vehicle_that_has_passed_the_carrot_takes_it_along() -> None:
    state = init_carrot()
    for _ in range(10):
        state, plan = once("carrot", settings(), state, pose(2.0, 2.5, 0.0), jnp.float32(STEP_S))
    assert bool(state.begun)
    assert float(plan.yaw_rate_radps) < 0.0


@pytest.mark.parametrize("law", list(LAWS))
def test_the_whole_route_is_driven_to_its_end(law: str) -> None:
    where, plan = drive(law, settings(), pose(-3.0, 0.3, 0.1))
    x, y = np.asarray(where.x_m, np.float64), np.asarray(where.y_m, np.float64)
    done = np.asarray(plan.done)
    assert done[-1]
    assert np.hypot(x[-1] - 0.0, y[-1] - 2.0 * RADIUS_M) < 0.1
    # Beside the route by plain geometry: the lines, and the circle about (20, 4).
    beside = np.where(x > LINE_M, np.hypot(x - LINE_M, y - RADIUS_M) - RADIUS_M, np.minimum(np.abs(y), np.abs(y - 8.0)))
    settled = np.arange(len(x)) > 25.0 / STEP_S
    assert np.abs(beside[settled & ~done]).max() < {"carrot": 0.06, "pursuit": 0.15}[law]
    on = np.asarray(plan.tool_on)
    clear = (np.abs(x - LINE_M) > 0.2) & (x > 0.2) & ~done
    np.testing.assert_array_equal(on[clear], (x < LINE_M)[clear])
    assert set(np.asarray(plan.line)[on]) == {0, 1}


def test_a_pose_that_is_no_number_leaves_no_trace() -> None:
    state, plan = once("carrot", settings(integral_per_m2=0.2), MIDWAY, pose(np.nan, 0.0, 0.0), jnp.float32(STEP_S))
    assert np.isnan(float(plan.yaw_rate_radps))
    assert all(np.isfinite(np.asarray(leaf, np.float64)).all() for leaf in state)
    assert float(state.arc_m) == 10.0


def test_the_integral_takes_out_what_stays_and_does_not_wind_up() -> None:
    told = settings(integral_per_m2=0.3)
    state = MIDWAY
    for _ in range(200):
        state, plan = once("carrot", told, state, pose(10.0, 0.1, 0.0), jnp.float32(STEP_S))
    without = wanted_curvature(10.0, 0.1, 0.0, told)
    gained = float(plan.yaw_rate_radps) / SPEED_MPS - without
    assert gained == pytest.approx(0.3 * np.arctan2(-0.1, 1.2) * 200 * STEP_S * SPEED_MPS, rel=0.05)
    for _ in range(400):
        state, plan = once("carrot", told, state, pose(10.0, 0.1, 0.0), jnp.float32(STEP_S))
    gained = float(plan.yaw_rate_radps) / SPEED_MPS - without
    assert gained == pytest.approx(-0.25 * float(told.largest_curvature_radpm), rel=0.05)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("x_m", [12.0, 18.0])
def test_a_vehicle_that_the_operator_drove_on_does_not_swerve_when_engaged_again(law: str, x_m: float) -> None:
    """Its route was begun: the lookahead point that it left behind would steer it away from its line."""
    told, state, at = settings(), MIDWAY, np.array([x_m, 0.05, 0.0])
    for _ in range(round(20.0 / STEP_S)):
        state, plan = once(law, told, state, pose(*at), jnp.float32(STEP_S))
        at[2] += float(plan.yaw_rate_radps) * STEP_S
        at[:2] += SPEED_MPS * STEP_S * np.array([np.cos(at[2]), np.sin(at[2])])
        if at[0] > LINE_M - 1.5:
            break
        assert abs(at[1]) <= 0.06
