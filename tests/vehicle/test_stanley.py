"""The laws that are there for comparison, in closed loop, against what their own mathematics says."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.vehicle import RolloutLane, RolloutSpec, arc_course, line_course, roll_out_traced, steer_stanley
from rollout_lanes import begin, chassis, one_lane

L = 3.8


def lane(anchor_m: float, k: float, speed_mps: float = 3.0) -> RolloutLane:
    return one_lane(5.0, speed_mps, true=chassis(k, anchor_m, largest_rad=0.7))


def test_stanley_brings_the_front_axle_onto_a_line_at_its_own_rate() -> None:
    """A small offset e of the front axle falls as e' = −gain e, whatever the rear wheels do (v ≫ 0.5 m/s)."""
    path, vehicle = line_course(300.0), lane(L, 0.63, 20.0)
    start = begin(path, vehicle, 0.2)
    spec = RolloutSpec(steps=400, step_s=0.01, law="stanley", stanley_gain_ps=0.8)
    trace = roll_out_traced(spec, path, vehicle, start)[2]
    offset = np.asarray(trace.offset_m, np.float64)
    rate = -np.polyfit(0.01 * np.arange(300), np.log(offset[:300]), 1)[0]
    assert rate == pytest.approx(0.8 * 20.0 / 20.5, rel=0.02)


def test_stanley_holds_an_arc() -> None:
    """The front wheels lie along the path's tangent there: no steady error of the front axle."""
    path, vehicle = arc_course(15.0, 2 * np.pi), lane(L, 0.63)
    start = begin(path, vehicle, 1.0)
    trace = roll_out_traced(RolloutSpec(steps=1000, step_s=0.04, law="stanley"), path, vehicle, start)[2]
    assert abs(float(trace.offset_m[0])) == pytest.approx(1.0, abs=1e-3)
    assert abs(float(trace.offset_m[-1])) < 0.03


def test_stanley_by_hand_and_its_limit() -> None:
    body = lane(L, 0.0).chassis
    front = steer_stanley(body, jnp.float32(0.1), jnp.float32(-0.4), jnp.float32(2.0), 1.5)
    assert float(front) == pytest.approx(0.1 + np.arctan(1.5 * -0.4 / 2.5), rel=1e-6)
    assert float(steer_stanley(body, jnp.float32(2.0), jnp.float32(3.0), jnp.float32(2.0), 1.5)) == pytest.approx(0.7)
