"""Runs from standstill to standstill, the way that pedals make of their commands, and the odometer's metre."""

from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.robust import combine, robust_line
from lgprjax.tuning.straight import speed_mps
from lgprjax.vehicle.pedals import DriveState, Pedal, Pedals, init_drive, step_drive
from lgprjax.vehicle.signals import DriveSignals

PEDAL_NAMES = (
    *("throttle.pre_tension", "throttle.dead_zone", "throttle.gain_mps2", "throttle.lag_s"),
    *("brake.pre_tension", "brake.dead_zone", "brake.gain_mps2", "brake.lag_s"),
    *("rolling_mps2", "drag_per_s"),
)
STANDING_MPS = 0.05
STANDING_S = 0.6
RELEASED = 0.005
LARGEST_GAP_S = 0.5
LEAST_WAY_M = 0.5
LEAST_FIXES = 30


class PedalRuns(NamedTuple):
    """Commands of the records that belong to runs.

    Attributes:
        record: index of each in the log.
        run: number of its run, from 0.
        step_s: to the next record of the run; 0 at the last.
        throttle, brake: commands, held to the next record.
        runs: number of them.
    """

    record: Int[np.ndarray, " record"]
    run: Int[np.ndarray, " record"]
    step_s: Float[np.ndarray, " record"]
    throttle: Float[np.ndarray, " record"]
    brake: Float[np.ndarray, " record"]
    runs: int


def cut_runs(signals: DriveSignals, what: str) -> PedalRuns:
    """Runs of a log, each from the middle of a standstill to the middle of the next; those with a gap are left out.

    Args:
        signals: of the log.
        what: is calibrated, for the error.

    Raises:
        NotExcitedError: no commands, no run, or a pedal that is not stepped to two values in them.
    """
    if signals.throttle is None or signals.brake is None:
        missing = "throttle commands" if signals.throttle is None else "brake commands"
        raise NotExcitedError(what, missing, "none in the log")
    known = np.flatnonzero(np.isfinite(signals.travel_m) & np.isfinite(signals.throttle) & np.isfinite(signals.brake))
    time_s = signals.time_s[known]
    # A vehicle that creeps off is as slow as one that stands; but it has been given throttle.
    released = signals.throttle[known] <= np.min(signals.throttle[known], initial=1.0) + RELEASED
    cuts = _standstill_middles(time_s, released & (np.abs(speed_mps(signals))[known] < STANDING_MPS))
    kept: list[Int[np.ndarray, " record"]] = []
    for start, stop in pairwise(cuts):
        inside = known[start:stop]
        whole = np.max(np.diff(signals.time_s[inside]), initial=0.0) < LARGEST_GAP_S
        if whole and np.ptp(signals.travel_m[inside]) > LEAST_WAY_M:
            kept.append(inside)
    if not kept:
        raise NotExcitedError(what, "runs from standstill to standstill", "none without a gap")
    record = np.concatenate(kept)
    run = np.repeat(np.arange(len(kept)), [inside.size for inside in kept])
    for name, command in (("throttle", signals.throttle), ("brake", signals.brake)):
        levels = np.unique(command[record].round(2))
        if np.count_nonzero(levels > 0.0) < 2:
            raise NotExcitedError(what, f"{name} stepped to two values or more", f"{levels[levels > 0.0].tolist()}")
    step_s = np.append(np.diff(signals.time_s[record]), 0.0)
    step_s[np.append(np.diff(run) != 0, True)] = 0.0
    return PedalRuns(record, run, step_s, signals.throttle[record], signals.brake[record], len(kept))


def predict_way(
    runs: PedalRuns, value: Float[np.ndarray, "lane parameter"]
) -> tuple[Float[np.ndarray, "lane record"], Float[np.ndarray, "lane parameter record"]]:
    """Way since the start of the run at every record, and its derivative by every parameter of ``PEDAL_NAMES``."""
    told = (runs.step_s, runs.throttle, runs.brake, np.diff(runs.run, prepend=-1) != 0)
    way, slope = _way_and_slope(
        jnp.asarray(value.T, jnp.float32), *(jnp.asarray(part, jnp.float32) for part in told[:3]), jnp.asarray(told[3])
    )
    return np.asarray(way, np.float64).T, np.asarray(slope, np.float64).transpose(2, 0, 1)


@jax.jit
def _way_and_slope(
    value: Float[Array, "parameter lane"],
    step_s: Float[Array, " record"],
    throttle: Float[Array, " record"],
    brake: Float[Array, " record"],
    fresh: Bool[Array, " record"],
) -> tuple[Float[Array, "record lane"], Float[Array, "parameter record lane"]]:
    def way(value: Float[Array, "parameter lane"]) -> Float[Array, "record lane"]:
        return _way(value, step_s, throttle, brake, fresh)

    directions = jnp.eye(value.shape[0], dtype=value.dtype)[:, :, None] * jnp.ones((1, 1, value.shape[1]), value.dtype)
    moved, back = jax.vmap(lambda direction: jax.jvp(way, (value,), (direction,)), out_axes=(None, 0))(directions)
    return moved, back


def _way(
    value: Float[Array, "parameter lane"],
    step_s: Float[Array, " record"],
    throttle: Float[Array, " record"],
    brake: Float[Array, " record"],
    fresh: Bool[Array, " record"],
) -> Float[Array, "record lane"]:
    pedals = Pedals(Pedal(*value[:4]), Pedal(*value[4:8]), value[8], value[9])
    still = init_drive(jnp.zeros_like(value[0]))

    def step(
        carry: tuple[DriveState, Float[Array, " lane"]], told: tuple[Array, Array, Array, Array]
    ) -> tuple[tuple[DriveState, Float[Array, " lane"]], Float[Array, " lane"]]:
        state, way_m = jax.tree.map(
            lambda rest, on: jnp.where(told[3], rest, on), (still, jnp.zeros_like(value[0])), carry
        )
        # A step of no length, at a run's end, would divide by it.
        state, gone_m = step_drive(state, pedals, told[1], told[2], jnp.maximum(told[0], 1e-6))
        return (state, way_m + gone_m), way_m

    ways: Float[Array, "record lane"] = jax.lax.scan(
        step, (still, jnp.zeros_like(value[0])), (step_s, throttle, brake, fresh)
    )[1]
    return ways


def odometer_scale(signals: DriveSignals) -> Estimate | None:
    """Metres by the fixes over metres by the odometer; None where the log has too few fixes.

    The way between fixes is that along the heading: a curve does no harm.
    """
    fixed = np.isfinite(signals.east_m) & np.isfinite(signals.north_m) & np.isfinite(signals.yaw_rad)
    fixed &= np.isfinite(signals.travel_m)
    if np.count_nonzero(fixed) < LEAST_FIXES:
        return None
    east, north, yaw = signals.east_m[fixed], signals.north_m[fixed], signals.yaw_rad[fixed]
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    ahead = np.diff(east) * np.cos(middle) + np.diff(north) * np.sin(middle)
    fit = robust_line(signals.travel_m[fixed], np.append(0.0, np.cumsum(ahead)), serial=True)
    return combine(fit, np.array([0.0, 1.0]))


def _standstill_middles(
    time_s: Float[np.ndarray, " record"], standing: Bool[np.ndarray, " record"]
) -> Int[np.ndarray, " cut"]:
    """Index of the record in the middle of each standstill that lasts."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], standing, [False]]).astype(np.int8)))
    first, last = edges[::2], edges[1::2] - 1
    lasting = time_s[last] - time_s[first] >= STANDING_S
    return np.asarray((first[lasting] + last[lasting]) // 2)


def levelled(runs: PedalRuns, way_m: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    """Less its mean over each run: where a run begins is not known better than its records."""
    mean = np.bincount(runs.run, way_m) / np.bincount(runs.run)
    return np.asarray(way_m - mean[runs.run])
