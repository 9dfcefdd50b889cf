"""Rollouts: beside a tracker in float64, the figures of a steady circle, offsets that settle, lanes as one or many."""

import os
import subprocess
import sys
from pathlib import Path as FilePath
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import tree_map

from lgprjax.vehicle import (
    Chassis,
    LookAhead,
    MeasuredRear,
    Path,
    ProportionalRear,
    RolloutLane,
    RolloutSpec,
    RolloutState,
    Servo,
    arc_course,
    constant_look_ahead,
    ideal_servo,
    look_ahead_m,
    path_from_curvature,
    roll_out,
    roll_out_many,
    roll_out_traced,
    start_rollout,
    steer_exact,
)
from lgprjax.vehicle.rollout import prepare_law, steer_lane
from rollout_lanes import ANCHOR_M, Plain, begin, chassis, one_lane

SPEC = RolloutSpec(400)


def sine_curve() -> tuple[Path, np.ndarray]:
    """A path whose curvature is a sine of the way, and the same curve by a sum in float64, a point a millimetre."""
    count, spacing = 480, 0.25
    curvature = 0.05 * np.sin((np.arange(count) + 0.5) * spacing / 12.0)
    fine = np.repeat(curvature, 250)
    heading = np.concatenate([[0.0], np.cumsum(fine * 1e-3)])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x, y = np.cumsum(np.cos(middle) * 1e-3), np.cumsum(np.sin(middle) * 1e-3)
    return path_from_curvature(curvature), np.concatenate([[[0.0, 0.0]], np.stack([x, y], axis=-1)])


def lanes(count: int, seed: int = 0) -> RolloutLane:
    rng = np.random.default_rng(seed)

    def draw(low: float, high: float) -> jax.Array:
        return jnp.asarray(rng.uniform(low, high, count), jnp.float32)

    body = Chassis(draw(3.6, 4.0), draw(6.0, 7.0), ProportionalRear(draw(0.6, 0.66)), draw(0.5, 0.7), draw(15.0, 30.0))
    servo = Servo(
        draw(0.05, 0.3), draw(0.3, 0.8), draw(0.0, 0.15), draw(0.0, 0.004), draw(0.0, 0.004), draw(-0.1, 0.1),
        jnp.float32(12.0), jnp.float32(6.0),
    )  # fmt: skip
    schedule = LookAhead(draw(4.0, 5.0), draw(6.0, 9.0), jnp.float32(2.0), jnp.float32(6.0))
    return RolloutLane(body, body, servo, draw(10.0, 13.0), draw(2.0, 6.0), schedule)


def begin_many(path: Path, lane: RolloutLane, count: int, *, delay_slots: int = 0) -> RolloutState:
    offset = jnp.linspace(-3.0, 3.0, count, dtype=jnp.float32)
    zero = jnp.zeros(count, jnp.float32)
    return start_rollout(path, lane, zero, offset, zero, delay_slots=delay_slots)


@pytest.mark.parametrize(
    ("speed_mps", "look_ahead_m", "offset_m", "parts"),
    [
        (4.47, 5.0, 2.0, {}),
        (4.47, 6.0, -3.0, {"lag_s": 0.3, "rate_radps": 0.35, "dead_band_rad": 0.004, "v_char_mps": 15.0}),
        # Reversing, a goal further off than twice the anchor's lead.
        (-2.2, 14.0, 0.5, {}),
    ],
)
def test_rollout_is_that_of_a_plain_tracker(
    speed_mps: float, look_ahead_m: float, offset_m: float, parts: dict[str, Any]
) -> None:
    path, curve = sine_curve()
    start_m = 90.0 if speed_mps < 0.0 else 0.0
    true = chassis(v_char_mps=parts.get("v_char_mps", np.inf))
    servo = ideal_servo(parts.get("lag_s", 0.0), parts.get("rate_radps", np.inf))
    servo = servo._replace(dead_band_rad=jnp.float32(parts.get("dead_band_rad", 0.0)))
    lane = one_lane(look_ahead_m, speed_mps, true=true, servo=servo)
    start = begin(path, lane, offset_m, start_m)
    yaw = float(np.arctan2(start.sin_yaw, start.cos_yaw))
    final, _, trace = roll_out_traced(SPEC, path, lane, start)
    pose = (float(start.x_m), float(start.y_m), yaw)
    plain = Plain(curve, look_ahead_m, speed_mps, pose, near=round(1e3 * start_m), **parts)
    x, y, yaw = plain.run(SPEC.steps)
    # The tracker's foot and goal are points a millimetre apart.
    np.testing.assert_allclose((final.x_m, final.y_m), (x, y), atol=2e-3)
    np.testing.assert_allclose((final.cos_yaw, final.sin_yaw), (np.cos(yaw), np.sin(yaw)), atol=5e-4)
    np.testing.assert_allclose(trace.offset_m, plain.offsets, atol=2e-3)
    np.testing.assert_allclose(trace.front_rad, plain.wheels, atol=1.5e-3)


STEADY: dict[str, tuple[float, float, dict[str, Any]]] = {
    "k of 0.60 believed": (-2.9, 0.05, {"law": "closed", "believed": chassis(0.60)}),
    # The note's 14.6 and 1.1 cm hold the zero-slip point where it is for small angles; here it moves with the wheels.
    "yaw gain ignored": (14.6, 0.4, {"law": "closed", "true": chassis(v_char_mps=20.0), "believed": chassis()}),
    "yaw gain fed forward, exact": (0.0, 0.02, {"true": chassis(v_char_mps=20.0)}),
}


@pytest.mark.parametrize("case", STEADY)
def test_steady_error_on_a_circle(case: str) -> None:
    """Radius 12 m, chord of 5 m to the goal, 10 mph: outward errors of the anchor in centimetres."""
    expected_cm, within_cm, how = STEADY[case]
    path = arc_course(12.0, 2 * np.pi)
    lane = one_lane(24.0 * np.arcsin(5.0 / 24.0), true=how.get("true"), believed=how.get("believed"))
    spec = RolloutSpec(800, law=how.get("law", "exact"))
    final, metrics = roll_out(spec, path, lane, begin(path, lane))
    x, y = final.x_m + ANCHOR_M * final.cos_yaw, final.y_m + ANCHOR_M * final.sin_yaw
    error_cm = 100.0 * (np.hypot(x, y - 12.0) - 12.0)
    np.testing.assert_allclose(error_cm, expected_cm, atol=within_cm)
    assert float(metrics.cycle_m) < 2e-3


def test_lane_law_is_the_exact_law() -> None:
    rng = np.random.default_rng(5)
    count = 2000

    def draw(low: float, high: float) -> jax.Array:
        return jnp.asarray(rng.uniform(low, high, count), jnp.float32)

    measured = MeasuredRear(
        jnp.float32(-0.8), jnp.float32(0.2), jnp.asarray(0.6 * np.tan(np.linspace(-0.8, 0.8, 9)) / 1.2, jnp.float32)
    )
    for rear in (ProportionalRear(draw(0.0, 1.0)), measured):
        body = Chassis(draw(2.0, 6.0), draw(0.0, 10.0), rear, draw(0.3, 0.7), draw(10.0, 30.0))
        ahead, left, gain = draw(-8.0, 15.0), draw(-8.0, 8.0), draw(0.8, 1.0)
        exact = steer_exact(body, ahead, left, gain)
        found = steer_lane(prepare_law(body, gain), ahead / body.wheelbase_m, left / body.wheelbase_m)
        differ = np.asarray(found.reachable != exact.reachable)
        # A goal on the very edge of what is reachable may fall to either side by rounding.
        assert differ.mean() < 0.002
        assert 0.2 < np.asarray(exact.reachable).mean() < 0.95
        np.testing.assert_allclose(
            np.asarray(found.front_rad)[~differ], np.asarray(exact.front_rad)[~differ], atol=2e-5
        )


def test_look_ahead_is_constant_linear_constant() -> None:
    schedule = LookAhead(jnp.float32(4.0), jnp.float32(10.0), jnp.float32(2.0), jnp.float32(5.0))
    speeds = jnp.asarray([0.0, 2.0, 3.0, 4.0, 5.0, 9.0, -4.0], jnp.float32)
    np.testing.assert_allclose(look_ahead_m(schedule, speeds), [4, 4, 6, 8, 10, 10, 8], rtol=1e-6)
    np.testing.assert_allclose(look_ahead_m(constant_look_ahead(jnp.float32(6.0)), speeds), 6.0)


def test_lanes_of_a_batch_are_lanes_by_themselves_and_under_vmap() -> None:
    path, _ = sine_curve()
    count, slots = 5, 3
    lane = tree_map(lambda leaf: jnp.broadcast_to(leaf, (count,)), lanes(count))
    start = begin_many(path, lane, count, delay_slots=slots)
    spec = RolloutSpec(60, delay_slots=slots)
    batch = roll_out(spec, path, lane, start)
    in_lanes = start._replace(servo=start.servo._replace(waiting_rad=start.servo.waiting_rad.T))
    mapped = jax.vmap(roll_out, in_axes=(None, None, 0, 0))(spec, path, lane, in_lanes)
    for one, other in zip(batch[1], mapped[1], strict=True):
        np.testing.assert_allclose(one, other, rtol=2e-4, atol=2e-5)
    alone = roll_out(spec, path, *tree_map(lambda leaf: leaf[3], (lane, in_lanes)))
    np.testing.assert_allclose(alone[0].x_m, batch[0].x_m[3], atol=2e-4)
    np.testing.assert_allclose(alone[1].rms_m, batch[1].rms_m[3], rtol=2e-4)


def test_chunks_change_nothing_and_compile_once() -> None:
    path, _ = sine_curve()
    lane = lanes(23)
    start = begin_many(path, lane, 23, delay_slots=3)
    spec = RolloutSpec(60, delay_slots=3)
    whole = roll_out(spec, path, lane, start)
    cache: Any = roll_out
    before = cache._cache_size()
    for seed_shift in (0.0, 0.25):
        moved = start._replace(x_m=start.x_m + jnp.float32(seed_shift))
        for one, other in zip(
            jax.tree.leaves(roll_out_many(spec, path, lane, moved, chunk=8)),
            jax.tree.leaves(roll_out(spec, path, lane, moved) if seed_shift else whole),
            strict=True,
        ):
            assert one.shape == other.shape
            np.testing.assert_allclose(one, other, rtol=1e-4, atol=2e-4)
    assert cache._cache_size() == before + 1


_ON_THREE_DEVICES = """
import jax
import numpy as np
from lgprjax.vehicle import roll_out, roll_out_many, rollout
from test_rollout import RolloutSpec, begin_many, lanes, sine_curve

used = set()
plain = rollout.roll_out
def seen(spec, path, lane, start):
    used.update(start.x_m.devices())
    return plain(spec, path, lane, start)
rollout.roll_out = seen
path, _ = sine_curve()
lane = lanes(50)
start = begin_many(path, lane, 50)
many = jax.tree.leaves(roll_out_many(RolloutSpec(30), path, lane, start, chunk=8))
whole = jax.tree.leaves(plain(RolloutSpec(30), path, lane, start))
apart = max(float(np.max(np.abs(one - np.asarray(other)))) for one, other in zip(many, whole) if one.size)
print(len(jax.devices()), len(used), apart < 2e-4)
"""


def test_chunks_are_spread_over_all_devices() -> None:
    environment = {
        **os.environ,
        "XLA_FLAGS": "--xla_force_host_platform_device_count=3",
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(FilePath(__file__).parent), *sys.path]),
    }
    command = [sys.executable, "-c", _ON_THREE_DEVICES]
    told = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=True)
    assert told.stdout.split() == ["3", "3", "True"]


def test_measured_rear_wheels_drive_as_their_ratio() -> None:
    path, _ = sine_curve()
    knots = jnp.asarray(0.63 * np.linspace(-0.8, 0.8, 17), jnp.float32)
    measured = chassis()._replace(rear=MeasuredRear(jnp.float32(-0.8), jnp.float32(0.1), knots))
    start = begin_many(path, one_lane(), 17)
    # As many lanes as knots: nothing may take the knots for lanes.
    found, _ = roll_out_many(RolloutSpec(80), path, one_lane(true=measured), start, chunk=5)
    expected, _ = roll_out(RolloutSpec(80), path, one_lane(), start)
    np.testing.assert_allclose(found.x_m, expected.x_m, atol=2e-4)
    np.testing.assert_allclose(found.y_m, expected.y_m, atol=2e-4)


def cost(numbers: jax.Array, path: Path, offset_m: jax.Array) -> Any:
    """RMS and effort of a rollout by look-ahead, lag, believed k and V_CHAR, in the numbers' precision."""

    def cast(tree: Any) -> Any:
        return tree_map(lambda leaf: leaf.astype(numbers.dtype), tree)

    body, course = cast(chassis()), cast(path)
    true = body._replace(characteristic_speed_mps=numbers[3])
    believed = body._replace(rear=ProportionalRear(numbers[2]))
    servo = cast(ideal_servo())._replace(lag_s=numbers[1])
    one, zero = jnp.ones((), numbers.dtype), jnp.zeros((), numbers.dtype)
    lane = RolloutLane(true, believed, servo, one, 4.0 * one, constant_look_ahead(numbers[0]))
    _, metrics = roll_out(RolloutSpec(150), course, lane, start_rollout(course, lane, zero, offset_m, zero))
    return metrics.rms_m + metrics.effort_radpm


def test_gradients_are_those_of_finite_differences() -> None:
    """Central differences in float64 of the same code; without any error the gradient is zero, not none."""
    path, _ = sine_curve()
    numbers = np.array([6.0, 0.25, 0.61, 18.0])
    valued = jax.jit(jax.value_and_grad(cost))
    slope = np.asarray(valued(jnp.asarray(numbers, jnp.float32), path, jnp.float32(1.0))[1])
    straight = path_from_curvature(np.zeros(480))
    value, none = valued(jnp.asarray(numbers, jnp.float32), straight, jnp.float32(0.0))
    assert float(value) == 0.0
    np.testing.assert_array_equal(none, 0.0)
    with jax.enable_x64(True):
        steps = 1e-5 * np.eye(4)
        ends = jax.jit(jax.vmap(cost, in_axes=(0, None, None)))(
            jnp.asarray(np.concatenate([numbers + steps, numbers - steps])), path, jnp.ones(())
        )
        high, low = np.asarray(ends).reshape(2, 4)
    np.testing.assert_allclose(slope, (high - low) / 2e-5, rtol=0.01, atol=1e-4)


def test_specs_that_cannot_run_are_refused() -> None:
    for steps, step_s in ((0, 0.05), (10, 0.0)):
        with pytest.raises(ValueError, match=f"{steps}.*{step_s}"):
            RolloutSpec(steps, step_s=step_s)
