"""The two frames: a correction moves the path by just itself, at a limited rate, and never the vehicle."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.navigation import FrameOffset, SlewLimits, anchor_frame, slew_frame, step_local, to_global, to_local
from lgprjax.vehicle import Turn, VehiclePose, drive_arc

STEP_S = 1.0 / 21.0
LIMITS = SlewLimits(jnp.float32(0.3), jnp.float32(0.05))
COUNT = 200
_RNG = np.random.default_rng(1)
FRAMES, PLACES, OTHERS = (_RNG.uniform([-500, -500, -3], [500, 500, 3], (COUNT, 3)).T for _ in range(3))
# Corrections, the first of them none.
NEAR = np.append(np.zeros((1, 3)), _RNG.uniform([-5, -5, -0.375], [5, 5, 0.375], (COUNT - 1, 3)), axis=0).T


def pose(values: np.ndarray) -> VehiclePose:
    return VehiclePose(*jnp.asarray(values, jnp.float32))


def numbers(any_pose: Any) -> np.ndarray:
    return np.asarray(any_pose, np.float64)


def apart(one: Any, other: Any) -> tuple[float, float]:
    """Largest distance and angle between poses."""
    difference = numbers(one) - numbers(other)
    return float(np.hypot(*difference[:2]).max()), float(np.abs(np.angle(np.exp(1j * difference[2]))).max())


def turned(angle: np.ndarray, way: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angle) * way[0] - np.sin(angle) * way[1], np.sin(angle) * way[0] + np.cos(angle) * way[1]])


def test_poses_go_to_the_local_frame_and_back_and_an_anchored_frame_makes_two_one() -> None:
    offset = FrameOffset(*pose(FRAMES))
    distance, turn = apart(to_global(offset, to_local(offset, pose(PLACES))), pose(PLACES))
    assert distance < 5e-4
    assert turn < 2e-6
    anchored = anchor_frame(pose(PLACES), pose(OTHERS))
    distance, turn = apart(to_local(anchored, pose(PLACES)), pose(OTHERS))
    assert distance < 5e-4
    assert turn < 2e-6
    expected = OTHERS[:2] - turned(OTHERS[2] - PLACES[2], PLACES[:2])
    np.testing.assert_allclose(numbers(anchored)[:2], expected, atol=5e-4)


def test_a_correction_moves_the_path_by_itself_and_never_the_vehicle() -> None:
    """A new estimate of the map pose, off by a correction in the body, shows the path moved by its opposite."""
    estimate, local = PLACES, OTHERS
    corrected = estimate + np.append(turned(estimate[2], NEAR[:2]), NEAR[2:], axis=0)
    before, after = (anchor_frame(pose(at), pose(local)) for at in (estimate, corrected))
    # The vehicle stands where it stood: each frame puts its own estimate at the same local pose.
    assert apart(to_local(after, pose(corrected)), to_local(before, pose(estimate)))[0] < 1e-3
    # A path point 3 m ahead of the old estimate, seen in the body before and after.
    ahead = np.array([[3.0], [0.0]])
    point = np.append(estimate[:2] + turned(estimate[2], ahead), estimate[2:], axis=0)
    seen = [turned(-local[2], numbers(to_local(frame, pose(point)))[:2] - local[:2]) for frame in (before, after)]
    np.testing.assert_allclose(seen[0], np.broadcast_to(ahead, (2, COUNT)), atol=1e-3)
    np.testing.assert_allclose(seen[1], turned(-NEAR[2], ahead - NEAR[:2]), atol=1e-3)


def test_a_slewed_path_keeps_its_limits_at_the_vehicle() -> None:
    offset, vehicle = FrameOffset(*pose(FRAMES)), pose(OTHERS)
    here = to_global(offset, vehicle)
    wanted = anchor_frame(here, pose(OTHERS + NEAR))
    moved, left = slew_frame(offset, wanted, vehicle, LIMITS, jnp.float32(STEP_S))
    distance, turn = apart(to_local(moved, here), vehicle)
    assert distance <= 0.3 * STEP_S + 1e-3
    assert turn <= 0.05 * STEP_S + 2e-6
    assert np.all(np.asarray(left) >= np.hypot(*NEAR[:2]) - 0.3 * STEP_S - 2e-3)


def test_a_slewed_frame_arrives_while_the_vehicle_drives() -> None:
    """It takes what the limits ask for and a little more, and then is the wanted offset itself."""
    corrections = np.array([(0.8, -0.6, 0.0), (0.0, 0.0, 0.3), (-2.0, 1.0, -0.2), (1e-3, 0.0, 1e-4)]).T
    lanes = corrections.shape[1]
    offset = FrameOffset(*pose(np.repeat([[30.0], [-20.0], [0.5]], lanes, axis=1)))
    at = pose(np.repeat([[100.0], [50.0], [1.0]], lanes, axis=1))
    wanted = anchor_frame(to_global(offset, at), pose(numbers(at) + corrections))
    speed, rate, ahead = (jnp.full(lanes, value, jnp.float32) for value in (2.0, 0.1, 1.5))

    def tick(carry: Any, _: Any) -> tuple[Any, Any]:
        frame, vehicle = carry
        here = to_global(frame, vehicle)
        frame, left = slew_frame(frame, wanted, vehicle, LIMITS, jnp.float32(STEP_S))
        seen = to_local(frame, here)
        moved = jnp.hypot(seen.x_m - vehicle.x_m, seen.y_m - vehicle.y_m)
        return (frame, step_local(vehicle, speed, rate, ahead, jnp.float32(STEP_S))), (frame, left, moved)

    _, (frames, left, moved) = jax.jit(lambda: jax.lax.scan(tick, (offset, at), length=420))()
    assert float(moved.max()) <= 0.3 * STEP_S + 1e-4
    np.testing.assert_array_equal(left[-1], 0.0)
    np.testing.assert_array_equal(numbers(jax.tree.map(lambda leaf: leaf[-1], frames)), numbers(wanted))
    arrived = np.argmax((numbers(frames)[[0, 2]] == numbers(wanted)[[0, 2], None]).all(axis=0), axis=0)
    way_s, turn_s = np.hypot(*corrections[:2]) / 0.3, np.abs(corrections[2]) / 0.05
    # A path that still has to turn leaves the vehicle, or comes to it, by the angle times its way.
    chased_s = 2.0 * corrections[2] ** 2 / (2.0 * 0.05) / 0.3
    assert np.all(np.maximum(way_s - chased_s, turn_s) - STEP_S <= (arrived + 1) * STEP_S + 1e-3)
    assert np.all((arrived + 1) * STEP_S <= np.maximum(way_s, turn_s) + chased_s + 2.0 * STEP_S)


def test_dead_reckoning_is_the_arc_of_the_wheels() -> None:
    """Against the rollout at constant wheel angles; and back again."""
    rng = np.random.default_rng(2)
    speed, curvature, ahead = rng.uniform([-10.0, -0.875, 0.125], [10.0, 0.875, 3.0], (COUNT, 3)).T
    curvature[:2] = 0.0, 1e-7
    start = pose(np.stack([np.full(COUNT, 3.0), np.full(COUNT, -2.0), rng.uniform(-3.0, 3.0, COUNT)]))
    told, bend, slip = (jnp.asarray(each, jnp.float32) for each in (speed, curvature, ahead))
    # The rear axle's side step a metre is minus x_c κ, which is what the wheels' tangent says there.
    expected = drive_arc(start, 0.5 * told, Turn(bend, slip * bend))
    reached = step_local(start, told, told * bend, slip, jnp.float32(0.5))
    distance, off = apart(reached, expected)
    assert distance < 3e-5
    assert off < 2e-6
    assert apart(step_local(reached, told, told * bend, slip, jnp.float32(-0.5)), start)[0] < 3e-5
