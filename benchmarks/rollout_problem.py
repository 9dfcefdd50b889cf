"""What all programs of the rollout benchmark drive: one path, lanes drawn from a seed, as plain arrays in a file."""

from pathlib import Path as FilePath
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.vehicle import (
    Chassis,
    Path,
    ProportionalRear,
    RolloutLane,
    RolloutSpec,
    RolloutState,
    Servo,
    constant_look_ahead,
    path_from_curvature,
    start_rollout,
    torque_share,
    yaw_gain,
)

STEP_S = 0.05
TOLERANCE_M = 0.10
TAIL_M = 30.0
SUPPLY_V = 12.0
COLUMNS = (
    "wheelbase_m",
    "anchor_m",
    "ratio",
    "largest_rad",
    "v_char_mps",
    "lag_s",
    "rate_radps",
    "dead_band_rad",
    "backlash_rad",
    "speed_mps",
    "look_ahead_m",
    "offset_m",
)


class RolloutProblem(NamedTuple):
    """Lanes on a path.

    Attributes:
        rows: of the path's table, [row, 5].
        spacing_m: of its arcs.
        lanes: [column, lane], columns as in ``COLUMNS``.
    """

    rows: Float[np.ndarray, "row 5"]
    spacing_m: float
    lanes: Float[np.ndarray, "column lane"]


def make_problem(lanes: int, steps: int, seed: int) -> RolloutProblem:
    """A winding road, 12 m its least radius, long enough for all steps; vehicles that differ in every number.

    Wheelbase, anchor and k scatter about stand-ins; speeds are 2 to 5 m/s, starts up to 3 m beside the path.
    """
    rng = np.random.default_rng(seed)
    length_m = 1.3 * 5.0 * STEP_S * steps + 20.0
    middle = (np.arange(int(np.ceil(length_m / 0.25))) + 0.5) * 0.25
    curvature = np.sin(middle / 9.0) * np.sin(middle / 31.0) / 12.0
    path = path_from_curvature(curvature, spacing_m=0.25)
    low_high = {
        "wheelbase_m": (3.6, 4.0),
        "anchor_m": (6.2, 6.8),
        "ratio": (0.60, 0.66),
        "largest_rad": (0.55, 0.65),
        "v_char_mps": (15.0, 30.0),
        "lag_s": (0.05, 0.30),
        "rate_radps": (0.4, 0.8),
        "dead_band_rad": (0.0, 0.003),
        "backlash_rad": (0.0, 0.003),
        "speed_mps": (2.0, 5.0),
        "look_ahead_m": (4.0, 8.0),
        "offset_m": (-3.0, 3.0),
    }
    drawn = np.stack([rng.uniform(*low_high[name], lanes) for name in COLUMNS]).astype(np.float32)
    return RolloutProblem(np.asarray(path.rows), 0.25, drawn)


def save_problem(file: FilePath, problem: RolloutProblem) -> None:
    """As npz."""
    with file.open("wb") as out:
        np.savez(out, rows=problem.rows, spacing_m=problem.spacing_m, lanes=problem.lanes)


def load_problem(file: FilePath) -> RolloutProblem:
    """From npz."""
    with np.load(file) as found:
        return RolloutProblem(found["rows"], float(found["spacing_m"]), found["lanes"])


def as_rollout(problem: RolloutProblem, steps: int) -> tuple[RolloutSpec, Path, RolloutLane, RolloutState]:
    """The problem as this project takes it."""
    lane_count = problem.lanes.shape[1]
    column = dict(zip(COLUMNS, (jnp.asarray(values) for values in problem.lanes), strict=True))
    zero = jnp.float32(0.0)
    body = Chassis(
        column["wheelbase_m"],
        column["anchor_m"],
        ProportionalRear(column["ratio"]),
        column["largest_rad"],
        column["v_char_mps"],
    )
    servo = Servo(
        column["lag_s"],
        column["rate_radps"],
        zero,
        column["dead_band_rad"],
        column["backlash_rad"],
        zero,
        jnp.float32(SUPPLY_V),
        zero,
    )
    lane = RolloutLane(
        body, body, servo, jnp.float32(SUPPLY_V), column["speed_mps"], constant_look_ahead(column["look_ahead_m"])
    )
    path = Path(
        jnp.asarray(problem.rows),
        jnp.float32(problem.spacing_m),
        jnp.float32(problem.spacing_m * (len(problem.rows) - 2)),
        zero,
    )
    still = jnp.zeros(lane_count, jnp.float32)
    start = start_rollout(path, lane, still, column["offset_m"], still)
    return RolloutSpec(steps, STEP_S, tolerance_m=TOLERANCE_M, tail_m=TAIL_M), path, lane, start


class FlatLanes(NamedTuple):
    """The problem as a program of loops takes it: what does not change from step to step worked out, as in ours.

    Attributes:
        state: [field, lane], in the order of ``numba_math.STATE_FIELDS``.
        inputs: [field, lane], in the order of ``numba_math.INPUT_FIELDS``.
    """

    state: Float[np.ndarray, "field lane"]
    inputs: Float[np.ndarray, "field lane"]


def as_flat(problem: RolloutProblem, steps: int) -> FlatLanes:
    """The same lanes and starts."""
    spec, _, lane, start = as_rollout(problem, steps)
    zero = jnp.zeros_like(start.x_m)
    far = jnp.full_like(zero, jnp.inf)
    state = (start.x_m, start.y_m, start.cos_yaw, start.sin_yaw, start.arc_m, zero, zero, zero)
    sums = (zero, zero, zero, far, -far, zero, zero)
    body, servo = lane.believed, lane.servo
    gain = yaw_gain(body.characteristic_speed_mps, lane.speed_mps)
    assert isinstance(body.rear, ProportionalRear)
    ratio = body.rear.ratio
    most = servo.rate_radps * torque_share(servo, lane.supply_v) * spec.step_s
    inputs = (
        ratio,
        body.anchor_m / body.wheelbase_m,
        1.0 / gain,
        body.largest_angle_rad,
        jnp.tan(body.largest_angle_rad),
        jnp.tan(ratio * body.largest_angle_rad),
        servo.dead_band_rad,
        1.0 - jnp.exp(-spec.step_s / servo.lag_s),
        -most,
        most,
        0.5 * servo.backlash_rad,
        lane.look_ahead.short_m,
        lane.speed_mps * spec.step_s,
        gain,
        1.0 / body.wheelbase_m,
    )
    return FlatLanes(np.stack([*state, *sums]).astype(np.float32), np.stack(inputs).astype(np.float32))
