"""The servo's torque as measured on board, and the look-ahead that follows it; the servo here is a plain loop."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from autopilot.test_step import CONFIG, one_step, winding_route
from autopilot.test_watch_numbers import WHEEL
from lgprjax.autopilot import init_autopilot
from lgprjax.autopilot.chassis_monitors import ServoWatchState, WheelAngles, step_servo_watch
from lgprjax.autopilot.step import AutopilotInputs
from lgprjax.autopilot.torque import TorqueState, step_torque
from lgprjax.navigation import PlanCode, Reaction, lost_planner
from lgprjax.vehicle import LookAhead, VehiclePose, stretched_look_ahead
from rollout_lanes import ANCHOR_M

TICK_S = 0.02


def driven(share: float, size_rad: float, supply_v: float = 24.0, seconds: float = 40.0) -> list[float]:
    """Shares tick by tick while a servo with a share of its torque is sent steps of a size, ten seconds apart."""
    watch, state, wheel, found = ServoWatchState(), TorqueState(), 0.0, []
    waiting = [0.0] * round(WHEEL.delay_s / TICK_S)
    for tick in range(round(seconds / TICK_S)):
        command = size_rad if (tick * TICK_S) % 10.0 < 5.0 else -size_rad
        waiting.append(command)
        wrong = waiting.pop(0) - wheel
        most = WHEEL.rate_radps * share * TICK_S
        wheel += min(max(wrong * (1.0 - math.exp(-TICK_S * share / WHEEL.lag_s)), -most), most)
        angles = WheelAngles(wheel, math.nan)
        watch, _ = step_servo_watch(WHEEL, watch, angles, supply_v, engaged=True, command_rad=command, step_s=TICK_S)
        state = step_torque(WHEEL, state, watch, front_rad=wheel, supply_v=supply_v, engaged=True, step_s=TICK_S)
        found.append(state.share)
    return found


@pytest.mark.parametrize("share", [1.0, 0.7, 0.43])
def test_torque_is_measured_where_the_servo_must_turn_fast(share: float) -> None:
    assert driven(share, 0.4)[-1] == pytest.approx(share, abs=0.08)


def test_small_steps_tell_nothing_and_change_nothing() -> None:
    assert min(driven(0.6, 0.03)) == 1.0


def test_supply_tells_by_itself_and_slowly() -> None:
    shares = driven(1.0, 0.0, supply_v=16.0)
    assert shares[-1] == pytest.approx(6.0 / 14.0, abs=0.01)
    assert np.max(np.abs(np.diff(shares))) < 0.02
    assert driven(1.0, 0.0, supply_v=math.nan)[-1] == 1.0


def ahead_of(share: float, exponent: float, least: float) -> float:
    zero = jnp.float32(0.0)
    pose = VehiclePose(zero - ANCHOR_M + 10.0, zero, zero)
    planner = lost_planner()._replace(pose=pose, arc_m=jnp.float32(10.0), code=jnp.int32(PlanCode.FOLLOWING))
    config = CONFIG._replace(weak_exponent=jnp.float32(exponent), least_share=jnp.float32(least))
    speed, engaged = jnp.float32(4.0), jnp.asarray(True)
    inputs = AutopilotInputs(
        pose, speed, jnp.int32(Reaction.CONTINUE), jnp.float32(np.inf), zero, engaged, engaged, speed, zero
    )
    inputs = inputs._replace(torque_share=jnp.float32(share))
    state = init_autopilot(planner, speed, zero)
    return float(one_step(config, winding_route(), state, inputs)[1].look_ahead_m)


def test_look_ahead_grows_within_the_study_s_limits() -> None:
    full = ahead_of(1.0, 0.6, 0.43)
    assert full == pytest.approx(3.0 + 2.0 * 3.0 / 5.0, rel=1e-6)
    assert ahead_of(0.5, 0.6, 0.43) == pytest.approx(full * 0.5**-0.6, rel=1e-5)
    # Below what was studied it grows no further; a share that is no number is the least; without a study nothing grows.
    assert ahead_of(0.1, 0.6, 0.43) == pytest.approx(full * 0.43**-0.6, rel=1e-5)
    assert ahead_of(math.nan, 0.6, 0.43) == pytest.approx(full * 0.43**-0.6, rel=1e-5)
    assert ahead_of(0.3, 0.0, 1.0) == full


def test_a_schedule_at_full_torque_is_the_schedule_to_the_bit() -> None:
    schedule = LookAhead(*(jnp.float32(v) for v in (1.177, 2.043, 2.76, 4.44)))
    one = jnp.float32(1.0)
    for exponent in (0.0, 0.62):
        assert stretched_look_ahead(schedule, jnp.float32(exponent), one, one) == schedule
