"""The two frames: a correction moves the path by just itself, at a limited rate, and never the vehicle."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.navigation import FrameOffset, SlewLimits, anchor_frame, slew_frame, step_local, to_global, to_local
from lgprjax.vehicle import Turn, VehiclePose, drive_arc

STEP_S = 1.0 / 21.0
LIMITS = SlewLimits(jnp.float32(0.3), jnp.float32(0.05))
metres = st.floats(-500.0, 500.0, width=32)
angles = st.floats(-3.0, 3.0, width=32)
Triple = tuple[float, float, float]
triples = st.tuples(metres, metres, angles)
near = st.tuples(st.floats(-5.0, 5.0, width=32), st.floats(-5.0, 5.0, width=32), st.floats(-0.375, 0.375, width=32))

anchored, localised, globalised, slewed = (
    jax.jit(function) for function in (anchor_frame, to_local, to_global, slew_frame)
)


def pose(values: Triple) -> VehiclePose:
    return VehiclePose(*(jnp.float32(value) for value in values))


def numbers(any_pose: Any) -> np.ndarray:
    return np.asarray([float(part) for part in any_pose])


def apart(one: Any, other: Any) -> tuple[float, float]:
    difference = numbers(one) - numbers(other)
    return float(np.hypot(*difference[:2])), float(abs(np.angle(np.exp(1j * difference[2]))))


def turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@settings(max_examples=100, deadline=None)
@given(triples, triples)
def test_poses_go_to_the_local_frame_and_back(frame: Triple, at: Triple) -> None:
    offset = FrameOffset(*pose(frame))
    back = globalised(offset, localised(offset, pose(at)))
    distance, turn = apart(back, pose(at))
    assert distance < 5e-4
    assert turn < 2e-6


@settings(max_examples=100, deadline=None)
@given(triples, triples)
def test_an_anchored_frame_makes_both_poses_one(here: Triple, there: Triple) -> None:
    offset = anchored(pose(here), pose(there))
    distance, turn = apart(localised(offset, pose(here)), pose(there))
    assert distance < 5e-4
    assert turn < 2e-6
    expected = np.asarray(there[:2]) - turned(there[2] - here[2]) @ np.asarray(here[:2])
    np.testing.assert_allclose(numbers(offset)[:2], expected, atol=5e-4)


@settings(max_examples=60, deadline=None)
@given(triples, triples, near)
def test_a_correction_moves_the_path_by_itself_and_never_the_vehicle(
    estimate: Triple, local: Triple, correction: Triple
) -> None:
    """A new estimate of the map pose, off by a correction in the body, shows the path moved by its opposite."""
    corrected = np.asarray(estimate, np.float64)
    corrected[:2] += turned(estimate[2]) @ np.asarray(correction[:2])
    corrected[2] += correction[2]
    before, after = (anchored(pose(tuple(at)), pose(local)) for at in (estimate, corrected))
    # The vehicle stands where it stood: each frame puts its own estimate at the same local pose.
    assert apart(localised(after, pose(tuple(corrected))), localised(before, pose(estimate)))[0] < 1e-3
    # A path point 3 m ahead of the old estimate, seen in the body before and after.
    point = np.asarray(estimate[:2]) + turned(estimate[2]) @ np.array([3.0, 0.0])
    seen = []
    for frame in (before, after):
        placed = localised(frame, pose((float(point[0]), float(point[1]), estimate[2])))
        seen.append(turned(-local[2]) @ (numbers(placed)[:2] - np.asarray(local[:2])))
    expected = turned(-correction[2]) @ (np.array([3.0, 0.0]) - np.asarray(correction[:2]))
    np.testing.assert_allclose(seen[0], [3.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(seen[1], expected, atol=1e-3)


@settings(max_examples=60, deadline=None)
@given(triples, triples, near)
def test_a_slewed_path_keeps_its_limits_at_the_vehicle(frame: Triple, local: Triple, correction: Triple) -> None:
    offset, vehicle = FrameOffset(*pose(frame)), pose(local)
    wanted = anchored(globalised(offset, vehicle), pose(tuple(np.asarray(local) + np.asarray(correction))))
    here = globalised(offset, vehicle)
    moved, left = slewed(offset, wanted, vehicle, LIMITS, jnp.float32(STEP_S))
    distance, turn = apart(localised(moved, here), vehicle)
    assert distance <= 0.3 * STEP_S + 1e-3
    assert turn <= 0.05 * STEP_S + 2e-6
    assert float(left) >= max(0.0, np.hypot(*correction[:2]) - 0.3 * STEP_S - 2e-3)


@pytest.mark.parametrize("correction", [(0.8, -0.6, 0.0), (0.0, 0.0, 0.3), (-2.0, 1.0, -0.2), (1e-3, 0.0, 1e-4)])
def test_a_slewed_frame_arrives_while_the_vehicle_drives(correction: Triple) -> None:
    """It takes what the limits ask for and a little more, and then is the wanted offset itself."""
    offset, at = FrameOffset(*pose((30.0, -20.0, 0.5))), pose((100.0, 50.0, 1.0))
    target = numbers(at) + np.asarray(correction)
    wanted = anchored(globalised(offset, at), pose((float(target[0]), float(target[1]), float(target[2]))))
    speed, rate, ahead = jnp.float32(2.0), jnp.float32(0.1), jnp.float32(1.5)

    def tick(carry: Any, _: Any) -> tuple[Any, Any]:
        frame, vehicle = carry
        here = to_global(frame, vehicle)
        frame, left = slew_frame(frame, wanted, vehicle, LIMITS, jnp.float32(STEP_S))
        seen = to_local(frame, here)
        moved = jnp.hypot(seen.x_m - vehicle.x_m, seen.y_m - vehicle.y_m)
        return (frame, step_local(vehicle, speed, rate, ahead, jnp.float32(STEP_S))), (frame, left, moved)

    _, (frames, left, moved) = jax.jit(lambda: jax.lax.scan(tick, (offset, at), length=420))()
    assert float(moved.max()) <= 0.3 * STEP_S + 1e-4
    way_s, turn_s = np.hypot(*correction[:2]) / 0.3, abs(correction[2]) / 0.05
    arrived = int(np.argmax(np.asarray(frames.x_m == wanted.x_m) & np.asarray(frames.yaw_rad == wanted.yaw_rad)))
    assert float(left[-1]) == 0.0
    np.testing.assert_array_equal(numbers(jax.tree.map(lambda leaf: leaf[-1], frames)), numbers(wanted))
    # A path that still has to turn leaves the vehicle, or comes to it, by the angle times its way.
    chased_s = 2.0 * correction[2] ** 2 / (2.0 * 0.05) / 0.3
    assert max(way_s - chased_s, turn_s) - STEP_S <= (arrived + 1) * STEP_S + 1e-3
    assert (arrived + 1) * STEP_S <= max(way_s, turn_s) + chased_s + 2.0 * STEP_S


@settings(max_examples=60, deadline=None)
@given(st.floats(-10.0, 10.0, width=32), st.floats(-0.875, 0.875, width=32), st.floats(0.125, 3.0, width=32), angles)
def test_dead_reckoning_is_the_arc_of_the_wheels(speed: float, curvature: float, ahead: float, yaw: float) -> None:
    """Against the rollout at constant wheel angles; and back again."""
    start, rate = pose((3.0, -2.0, yaw)), jnp.float32(speed * curvature)
    # The rear axle's side step a metre is minus x_c κ, which is what the wheels' tangent says there.
    turn = Turn(jnp.float32(curvature), jnp.float32(ahead * curvature))
    expected = drive_arc(start, jnp.float32(speed * 0.5), turn)
    reached = step_local(start, jnp.float32(speed), rate, jnp.float32(ahead), jnp.float32(0.5))
    distance, off = apart(reached, expected)
    assert distance < 3e-5
    assert off < 2e-6
    home = step_local(reached, jnp.float32(speed), rate, jnp.float32(ahead), jnp.float32(-0.5))
    assert apart(home, start)[0] < 3e-5
