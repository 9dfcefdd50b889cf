"""The step in which a skid-steer command is born: what turns the tool off, what stops, what leaves no trace."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.autopilot import SkidCommand, SkidInfo, SkidLimited, SkidOrders, SkidState, init_skid, pad_fence, step_skid
from lgprjax.autopilot.skid_step import judge_skid_health
from lgprjax.coverage import PatternSettings
from lgprjax.navigation import DeltaHeading, GnssObservation, Reaction, Reason, SkidMotion, SkidObservations
from lgprjax.navigation.skid_model import YAW, Y
from lgprjax.simulation.field_loop import made_up_field_world, made_up_tool, rectangle_course

SETUP = made_up_field_world().setup
COURSE = rectangle_course(12.0, 6.0, PatternSettings(1.2, 0.15, "boustrophedon", 1.5, 6.0, 1.2), made_up_tool())
SPEED_MPS, STEP_S = 0.4, 0.02
LINE_Y_M = 0.6


@jax.jit
def step(
    fence: jax.Array, state: SkidState, motion: SkidMotion, seen: SkidObservations, orders: SkidOrders
) -> tuple[SkidState, SkidCommand, SkidInfo]:
    return step_skid(SETUP, COURSE.route, fence, state, motion, seen, orders)


def number(value: float) -> jax.Array:
    return jnp.asarray(value, jnp.float32)


def motion(speed_mps: float = SPEED_MPS) -> SkidMotion:
    return SkidMotion(number(speed_mps), number(speed_mps), number(STEP_S))


def seen(x_m: float | None = None, *, speaks: bool = False) -> SkidObservations:
    """A fix of an antenna 0.2 m ahead of a place on the line, or none; an INS that speaks of no turn, or is silent."""
    fix = GnssObservation(
        number(0.2 + (x_m or 0.0)),
        number(LINE_Y_M),
        0.0004 * jnp.eye(2, dtype=jnp.float32),
        number(0.0),
        jnp.asarray(x_m is not None),
    )
    return SkidObservations(fix, DeltaHeading(number(0.0), number(0.1), jnp.asarray(speaks)))


def orders(**changes: float | bool) -> SkidOrders:
    usual: dict[str, float | bool] = {
        "engaged": True,
        "drives": True,
        "stop": False,
        "speed_cap_mps": np.inf,
        "set_speed_mps": SPEED_MPS,
        "age_s": 0.0,
        "left_mps": SPEED_MPS,
        "right_mps": SPEED_MPS,
    }
    told = usual | changes
    return SkidOrders(**{name: jnp.asarray(to) if isinstance(to, bool) else number(to) for name, to in told.items()})


@pytest.fixture(scope="module")
def on_line() -> SkidState:
    """Driven along the first line by hand until the heading is known, then engaged for two seconds."""
    state = init_skid(SETUP, number(-8.0), number(LINE_Y_M))
    x_m = -8.0
    for tick in range(1, 1051):
        x_m += SPEED_MPS * STEP_S
        by_hand = tick <= 950
        told = orders(engaged=not by_hand, drives=not by_hand)
        observed = seen(x_m if tick % 50 == 0 else None, speaks=tick % 5 == 0)
        state, _, info = step(COURSE.fence, state, motion(), observed, told)
    assert bool(info.filter.heading_known)
    assert int(info.reaction) != Reaction.STOP
    return state


def test_it_drives_the_line_with_the_tool_on(on_line: SkidState) -> None:
    _, command, info = step(COURSE.fence, on_line, motion(), seen(), orders())
    assert float(command.tool) == 1.0
    assert float(command.depth_m) == pytest.approx(0.15)
    assert 0.5 * float(command.left_mps + command.right_mps) == pytest.approx(SPEED_MPS, rel=0.05)
    assert int(info.plan.line) == 0
    assert not bool(info.edge_predicted)
    assert not bool(info.stops)


@pytest.mark.parametrize("change", [{"engaged": False}, {"drives": False}, {"stop": True}])
def test_the_tool_is_off_and_the_vehicle_slows(on_line: SkidState, change: dict[str, bool]) -> None:
    _, command, _ = step(COURSE.fence, on_line, motion(), seen(), orders(**change))
    assert float(command.tool) == 0.0
    if "engaged" not in change:
        slower = float(on_line.limiter.last.left_mps) - 0.6 * STEP_S
        assert float(command.left_mps) == pytest.approx(slower, abs=2e-3)


@pytest.mark.parametrize(("off_m", "tool"), [(0.4, 1.0), (0.6, 0.0), (-0.6, 0.0)])
def test_the_tool_is_off_beside_its_line(on_line: SkidState, off_m: float, tool: float) -> None:
    estimate = on_line.filter.estimate
    moved = estimate._replace(mean=estimate.mean.at[Y].add(off_m))
    state = on_line._replace(filter=on_line.filter._replace(estimate=moved))
    far = pad_fence(200.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))
    _, command, info = step(far, state, motion(), seen(), orders())
    assert float(info.plan.cross_m) == pytest.approx(off_m, abs=0.05)
    assert bool(info.plan.tool_on)
    assert float(command.tool) == tool


def test_not_engaged_the_command_follows_the_wheels_and_the_carrot_waits(on_line: SkidState) -> None:
    told = orders(engaged=False, drives=False, left_mps=0.11, right_mps=0.23)
    state, command, info = step(COURSE.fence, on_line, motion(), seen(), told)
    np.testing.assert_allclose(command[:2], (0.11, 0.23), rtol=1e-6)
    assert int(info.limited) == 0
    np.testing.assert_array_equal(state.carrot.arc_m, on_line.carrot.arc_m)


def test_an_unknown_heading_stops_with_the_tool_off() -> None:
    state = init_skid(SETUP, number(3.0), number(LINE_Y_M))
    _, command, info = step(COURSE.fence, state, motion(0.0), seen(), orders())
    assert float(command.tool) == 0.0
    assert int(info.reaction) == Reaction.STOP
    assert int(info.reasons) & Reason.HEADING_LOST


def test_too_large_a_sigma_stops(on_line: SkidState) -> None:
    estimate = on_line.filter.estimate
    wide = estimate._replace(covariance=estimate.covariance.at[1, 1].set(0.31**2))
    state = on_line._replace(filter=on_line.filter._replace(estimate=wide))
    far = pad_fence(200.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))
    _, command, info = step(far, state, motion(), seen(), orders())
    assert int(info.reasons) & Reason.TOO_UNCERTAIN
    assert not bool(info.edge_predicted)
    assert float(info.sigma_m) == pytest.approx(0.31, abs=0.01)
    assert float(command.tool) == 0.0


def test_gnss_that_is_gone_degrades_and_does_not_stop(on_line: SkidState) -> None:
    state = on_line
    for _ in range(80):
        state, command, info = step(COURSE.fence, state, motion(), seen(), orders())
    assert int(info.reasons) & Reason.GNSS_SILENT
    assert int(info.reaction) == Reaction.DEGRADE
    assert float(command.tool) == 1.0
    assert float(command.left_mps) < 0.9 * SPEED_MPS


def test_the_less_is_known_the_slower_and_at_last_it_waits_for_a_position(on_line: SkidState) -> None:
    """The cap falls with sigma, to nothing; a position that comes lets it go on, with nothing engaged anew."""
    rules, estimate = SETUP.health, on_line.filter.estimate
    gates = on_line.filter.gates._replace(since_offered_s=on_line.filter.gates.since_offered_s.at[0].set(20.0))
    _, _, info = step(COURSE.fence, on_line, motion(), seen(), orders())
    caps = []
    for sigma_m in (0.03, 0.06, 0.07, 0.08, 0.09, 0.099, 0.2):
        wide = jnp.diag(jnp.full(2, sigma_m**2, jnp.float32))
        told = estimate._replace(covariance=estimate.covariance.at[:2, :2].set(wide))
        health = judge_skid_health(rules, told, gates, info.filter, number(STEP_S))
        assert int(health.reaction) == Reaction.DEGRADE
        assert bool(int(health.reasons) & Reason.UNCERTAIN) == (float(health.speed_cap_mps) == 0.0)
        caps.append(float(health.speed_cap_mps))
    np.testing.assert_allclose(caps, [0.3, 0.3, 0.225, 0.15, 0.075, 0.0, 0.0], atol=1e-6)


def test_it_slows_down_while_uncertain_positions_come(on_line: SkidState) -> None:
    rules, estimate, gates = SETUP.health, on_line.filter.estimate, on_line.filter.gates
    gates = gates._replace(
        since_offered_s=jnp.zeros_like(gates.since_offered_s), since_accepted_s=jnp.zeros_like(gates.since_accepted_s)
    )
    _, _, info = step(COURSE.fence, on_line, motion(), seen(), orders())
    caps = []
    for sigma_m in (0.03, 0.07, 0.09):
        wide = jnp.diag(jnp.full(2, sigma_m**2, jnp.float32))
        told = estimate._replace(covariance=estimate.covariance.at[:2, :2].set(wide))
        caps.append(float(judge_skid_health(rules, told, gates, info.filter, number(STEP_S)).speed_cap_mps))
    np.testing.assert_allclose(caps, [np.inf, 0.225, 0.075], atol=1e-6)


def test_it_waits_and_goes_on_by_itself(on_line: SkidState) -> None:
    estimate = on_line.filter.estimate
    wide = estimate._replace(covariance=estimate.covariance.at[:2, :2].set(0.12**2 * jnp.eye(2, dtype=jnp.float32)))
    state = on_line._replace(filter=on_line.filter._replace(estimate=wide))
    for tick in range(150):
        state, command, info = step(COURSE.fence, state, motion(0.0), seen(speaks=tick % 5 == 0), orders())
    assert int(info.reaction) == Reaction.DEGRADE
    assert float(command.left_mps) == pytest.approx(0.0, abs=1e-3)
    assert float(command.tool) == 1.0
    x_m = float(state.filter.estimate.mean[0])
    for tick in range(1, 201):
        place = x_m + 1e-4 * tick if tick % 50 == 0 else None
        state, command, info = step(COURSE.fence, state, motion(0.0), seen(place, speaks=tick % 5 == 0), orders())
    assert int(info.reaction) == Reaction.CONTINUE
    assert float(command.left_mps) > 0.2


def test_a_foretold_edge_stops_until_nothing_is_engaged(on_line: SkidState) -> None:
    x_m = float(on_line.filter.estimate.mean[0])
    close = pad_fence(np.array([[-20.0, -20.0], [x_m + 1.6, -20.0], [x_m + 1.6, 20.0], [-20.0, 20.0]]))
    state, command, info = step(close, on_line, motion(), seen(), orders())
    assert bool(info.edge_predicted)
    assert float(command.tool) == 0.0
    state, _, info = step(COURSE.fence, state, motion(), seen(), orders())
    assert bool(info.edge_predicted)
    state, _, info = step(COURSE.fence, state, motion(), seen(), orders(engaged=False, drives=False))
    assert not bool(info.edge_predicted)


def test_what_is_no_number_is_held_once_and_then_asks_for_manual(on_line: SkidState) -> None:
    bad = orders(set_speed_mps=np.nan)
    state, command, info = step(COURSE.fence, on_line, motion(), seen(), bad)
    assert int(info.limited) & SkidLimited.NOT_FINITE
    np.testing.assert_array_equal(command.left_mps, on_line.limiter.last.left_mps)
    state, command, info = step(COURSE.fence, state, motion(), seen(), bad)
    assert int(info.limited) & SkidLimited.MANUAL_REQUESTED
    assert float(command.tool) == 0.0
    assert np.isfinite(float(command.left_mps))


def test_an_estimate_that_is_no_number_stops(on_line: SkidState) -> None:
    estimate = on_line.filter.estimate
    broken = estimate._replace(mean=estimate.mean.at[YAW].set(jnp.nan))
    state = on_line._replace(filter=on_line.filter._replace(estimate=broken))
    _, command, info = step(COURSE.fence, state, motion(), seen(), orders())
    assert int(info.reaction) == Reaction.STOP
    assert float(command.tool) == 0.0
    assert np.isfinite(float(command.left_mps))


def test_an_old_pose_is_no_command(on_line: SkidState) -> None:
    _, _, info = step(COURSE.fence, on_line, motion(), seen(), orders(age_s=0.3))
    assert int(info.limited) & SkidLimited.STALE
