"""Throttle and brake: runs cut from a log, a first estimate, and the fit.

The log is cut at standstills into runs. A run's way by odometer is what the pedals' model makes of the commands: all
parameters of both pedals are fitted to all runs at once, by damped Gauss-Newton steps with Huber weights on the
derivative of the model itself. Where the log has fixes they say what a metre of the odometer is worth.
"""

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.tuning.robust import Estimate, NotExcitedError, combine, estimate, independent_share, robust_line
from lgprjax.tuning.sensors import speed_mps
from lgprjax.vehicle.actuators import DriveState, Pedal, Pedals, init_drive, step_drive
from lgprjax.vehicle.sensors import DriveSignals

# Runs from standstill to standstill, the modelled distance of pedal commands, and the odometer's scale.

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
LAGS = np.array([name.endswith("lag_s") for name in PEDAL_NAMES])
COMMAND_SIGMA_S = 0.005
"""Half the period of the box's status: when within it a command began to act is not known."""


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
    # A vehicle that creeps off is as slow as a standing one, but with throttle.
    released = signals.throttle[known] <= np.min(signals.throttle[known], initial=1.0) + RELEASED
    cuts = _standstill_middles(time_s, released & (np.abs(speed_mps(signals))[known] < STANDING_MPS))
    kept: list[Int[np.ndarray, " record"]] = []
    for start, stop in pairwise(cuts):
        inside = known[start:stop]
        whole = np.max(np.diff(signals.time_s[inside]), initial=0.0) < LARGEST_GAP_S
        if whole and np.ptp(signals.travel_m[inside]) > LEAST_WAY_M:
            kept.append(inside)
    if not kept:
        raise NotExcitedError(what, "runs from standstill to standstill without gaps", "none")
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
    """Way since the start of the run at every record, and its derivative by every parameter of ``PEDAL_NAMES``.

    How far friction holds a pedal at a standstill depends on the run before; after a part of the log that belongs to no
    run it is not known, and the pedals are taken as released.
    """
    fresh = np.diff(runs.run, prepend=-1) != 0
    commanded = (runs.step_s, runs.throttle, runs.brake)
    way, slope = _way_and_slope(
        jnp.asarray(value.T, jnp.float32),
        *(jnp.asarray(part, jnp.float32) for part in commanded),
        jnp.asarray(fresh),
        jnp.asarray(fresh & (np.diff(runs.record, prepend=-2) != 1)),
    )
    return np.asarray(way, np.float64).T, np.asarray(slope, np.float64).transpose(2, 0, 1)


@jax.jit
def _way_and_slope(
    value: Float[Array, "parameter lane"],
    step_s: Float[Array, " record"],
    throttle: Float[Array, " record"],
    brake: Float[Array, " record"],
    fresh: Bool[Array, " record"],
    unknown: Bool[Array, " record"],
) -> tuple[Float[Array, "record lane"], Float[Array, "parameter record lane"]]:
    def way(value: Float[Array, "parameter lane"]) -> Float[Array, "record lane"]:
        return _way(value, step_s, throttle, brake, fresh, unknown)

    directions = jnp.eye(value.shape[0], dtype=value.dtype)[:, :, None] * jnp.ones((1, 1, value.shape[1]), value.dtype)
    moved, back = jax.vmap(lambda direction: jax.jvp(way, (value,), (direction,)), out_axes=(None, 0))(directions)
    return moved, back


def _way(
    value: Float[Array, "parameter lane"],
    step_s: Float[Array, " record"],
    throttle: Float[Array, " record"],
    brake: Float[Array, " record"],
    fresh: Bool[Array, " record"],
    unknown: Bool[Array, " record"],
) -> Float[Array, "record lane"]:
    pedals = Pedals(Pedal(*value[:4]), Pedal(*value[4:8]), value[8], value[9])
    still = init_drive(jnp.zeros_like(value[0]))

    def step(
        carry: tuple[DriveState, Float[Array, " lane"]], commanded: tuple[Array, Array, Array, Array, Array]
    ) -> tuple[tuple[DriveState, Float[Array, " lane"]], Float[Array, " lane"]]:
        state, way_m = carry
        speed, way_m = (jnp.where(commanded[3], 0.0, on) for on in (state.speed_mps, way_m))
        state = jax.tree.map(lambda rest, on: jnp.where(commanded[4], rest, on), still, state._replace(speed_mps=speed))
        # A step of no length, at a run's end, would divide by it.
        state, gone_m = step_drive(state, pedals, commanded[1], commanded[2], jnp.maximum(commanded[0], 1e-6))
        return (state, way_m + gone_m), way_m

    ways: Float[Array, "record lane"] = jax.lax.scan(
        step, (still, jnp.zeros_like(value[0])), (step_s, throttle, brake, fresh, unknown)
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
    """Index of the record in the middle of each lasting standstill."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], standing, [False]]).astype(np.int8)))
    first, last = edges[::2], edges[1::2] - 1
    lasting = time_s[last] - time_s[first] >= STANDING_S
    return np.asarray((first[lasting] + last[lasting]) // 2)


def levelled(runs: PedalRuns, way_m: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    """Less its mean over each run: where a run begins is not known better than its records."""
    mean = np.bincount(runs.run, way_m) / np.bincount(runs.run)
    return np.asarray(way_m - mean[runs.run])


# Where the fit of the pedals starts: the best of a grid of pre-tensions and lags, by what the vehicle accelerates.
#
# Given pre-tension, dead zone and lag of both pedals the acceleration is linear in the rest. The distance itself is no
# guide so far from the solution: a model that stops too early, or never moves off, has no useful gradient.

PRE_TENSIONS = (0.02, 0.06, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3, 0.4)
LAGS_S = (0.1, 0.25, 0.5, 1.0)
DEAD_SHARE = 0.4
FINER = ((0.02, 1.5, 0.3), (0.01, 1.25, 0.15), (0.005, 1.1, 0.08))
SPAN_S = 0.4
LEAST_SPEED_MPS = 0.2


Candidates = Float[np.ndarray, "candidate 3"]
"""Pre-tension, dead zone and lag of a pedal."""

Effects = tuple[Candidates, Float[np.ndarray, "candidate row"]]
"""Candidates with their response to the commands."""


def pedal_start(runs: PedalRuns, travel_m: Float[np.ndarray, " record"], what: str) -> Float[np.ndarray, " parameter"]:
    """Parameters, in the order of ``PEDAL_NAMES``, to start a fit from.

    Accelerations are second differences of the way over twice ``SPAN_S``; the same differences of the twice summed
    effect stand against them.

    Args:
        runs: commands.
        travel_m: way by odometer, at their records.
        what: is calibrated, for the error.

    Raises:
        NotExcitedError: the vehicle hardly moves in them.
    """
    # The second difference of a spike would be the largest of all: medians of five take it away.
    travel_m = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(travel_m, 2, mode="edge"), 5), axis=1)
    step_s = float(np.median(runs.step_s[runs.step_s > 0.0]))
    span = max(1, round(SPAN_S / step_s))
    span_s = span * step_s
    first = travel_m[span:-span] - travel_m[: -2 * span]
    second = travel_m[2 * span :] - travel_m[span:-span]
    moving = np.minimum(first, second) > LEAST_SPEED_MPS * span_s
    moving &= runs.run[2 * span :] == runs.run[: -2 * span]
    if np.count_nonzero(moving) < 10:
        raise NotExcitedError(
            what,
            "10 or more moving samples between standstills",
            f"{np.count_nonzero(moving) * step_s:.1f} s of driving",
        )
    wanted = ((second - first) / span_s**2)[moving]
    plain = np.stack([-np.ones(wanted.size), -((second + first) / (2.0 * span_s))[moving]])

    def effects(throttles: Candidates, brakes: Candidates) -> tuple[Effects, Effects]:
        thrust = _accelerations(runs.throttle, throttles, step_s, span)[:, moving]
        return (throttles, thrust), (brakes, -_accelerations(runs.brake, brakes, step_s, span)[:, moving])

    coarse = _product(PRE_TENSIONS, (DEAD_SHARE,), LAGS_S)
    both = effects(coarse, coarse)
    best = _best(wanted, plain, *both, np.ones(wanted.size, bool))
    if best.size:
        (_, thrust), (_, braked) = effects(best[None, [0, 1, 3]], best[None, [4, 5, 7]])
        left = np.abs(wanted - best[[2, 6, 8, 9]] @ np.vstack([thrust, braked, plain]))
        agreeing = left <= 4.0 / 0.6745 * np.median(left)
        best = _best(wanted, plain, *both, agreeing)
    for change, factor, share in FINER:
        if best.size:
            near = (_around(best[first : first + 4], change, factor, share) for first in (0, 4))
            best = _best(wanted, plain, *effects(*near), agreeing)
    if best.size == 0:
        raise NotExcitedError(
            what,
            "a vehicle that accelerates with throttle and slows with brake",
            "no effect of throttle, brake or both",
        )
    return best


def _product(pre_tensions: Iterable[float], shares: Iterable[float], lags_s: Iterable[float]) -> Candidates:
    pre, share, lag = (np.ravel(grid) for grid in np.meshgrid(*map(list, (pre_tensions, shares, lags_s))))
    return np.stack([pre, share * pre, lag], axis=1)


def _around(pedal: Float[np.ndarray, "4"], change: float, factor: float, share: float) -> Candidates:
    """Neighbours of a candidate: (pre-tension, dead zone, gain, lag), the gain apart."""
    pre, dead, _, lag = pedal
    shares = np.clip(dead / pre + np.array([-share, 0.0, share]), 0.05, 1.0)
    return _product(np.maximum(pre + np.array([-change, 0.0, change]), 0.01), shares, (lag / factor, lag, lag * factor))


def _best(
    wanted: Float[np.ndarray, " row"],
    plain: Float[np.ndarray, "2 row"],
    throttles: Effects,
    brakes: Effects,
    agreeing: Bool[np.ndarray, " row"],
) -> Float[np.ndarray, " parameter"]:
    """The pair that leaves least of the agreeing accelerations, with its gains and resistances; empty for none."""
    features = np.vstack([throttles[1], brakes[1], plain, wanted])[:, agreeing]
    product = features @ features.T
    one, two = (grid.ravel() for grid in np.indices((len(throttles[0]), len(brakes[0]))))
    last = len(features) - 1
    used = np.stack([one, len(throttles[0]) + two, np.full(one.size, last - 2), np.full(one.size, last - 1)], axis=1)
    square = product[used[:, :, None], used[:, None, :]] + 1e-9 * wanted.size * np.eye(4)
    side = product[used, last]
    answer = np.linalg.solve(square, side[..., None])[..., 0]
    left = np.where((answer[:, :2] > 0.0).all(axis=1), -np.sum(answer * side, axis=1), np.inf)
    least = int(np.argmin(left))
    if not np.isfinite(left[least]):
        return np.zeros(0)
    throttle, brake = throttles[0][one[least]], brakes[0][two[least]]
    thrust, braked, *rest = answer[least]
    return np.array([*throttle[:2], thrust, throttle[2], *brake[:2], braked, brake[2], *rest])


def _accelerations(
    command: Float[np.ndarray, " record"], candidates: Candidates, step_s: float, span: int
) -> Float[np.ndarray, "candidate row"]:
    """Mean effect of a gain of 1 over the rows' two spans, weighted as by second differences of the distance."""
    pre_tension, dead_zone, lag_s = candidates.T
    pressed, effect = np.zeros(pre_tension.size), np.zeros(pre_tension.size)
    course = np.empty((pre_tension.size, command.size))
    keep = np.exp(-step_s / lag_s)
    for record, commanded in enumerate(command):
        course[:, record] = effect
        taut = commanded - pre_tension
        pressed = np.maximum(np.clip(pressed, taut, taut + dead_zone), 0.0)
        effect = pressed + keep * (effect - pressed)
    way = _summed(_summed(course))
    return np.asarray((way[:, 2 * span :] - 2.0 * way[:, span:-span] + way[:, : -2 * span]) / span**2)


def _summed(course: Float[np.ndarray, "candidate record"]) -> Float[np.ndarray, "candidate record"]:
    """Sum of trapezoids up to each record, in steps."""
    middle = 0.5 * (course[:, 1:] + course[:, :-1])
    return np.concatenate([np.zeros((len(course), 1)), np.cumsum(middle, axis=1)], axis=1)


WHAT = "throttle and brake"
ROUNDS = 60
HUBER = 2.0
POSITIVE = np.array([name.endswith((".gain_mps2", ".lag_s")) for name in PEDAL_NAMES])
LARGEST_CHANGE = np.array([0.05, 0.05, 0.5, 0.5, 0.05, 0.05, 0.5, 0.5, 0.1, 0.1])
# Without any dead zone a rising command would have two derivatives by it.
LEAST = np.array([0.0, 1e-3, 1e-3, 1e-3, 0.0, 1e-3, 1e-3, 1e-3, -1.0, -1.0])
MOST = np.array([0.9, 0.9, 50.0, 5.0, 0.9, 0.9, 50.0, 5.0, 5.0, 1.0])
LARGEST_SIGMA = np.array([0.05, 0.05, 1.0, 0.3, 0.05, 0.05, 2.0, 0.3, 0.2, 0.1])


class PedalFit(NamedTuple):
    """One pedal, named as ``lgprjax.vehicle.Pedal``: commands are 0 to 1."""

    pre_tension: Estimate
    dead_zone: Estimate
    gain_mps2: Estimate
    lag_s: Estimate


class PedalsFit(NamedTuple):
    """Both pedals.

    Attributes:
        throttle, brake: of each.
        rolling_mps2, drag_per_s: what slows the vehicle without them.
        metres_per_odometer_metre: by the fixes; None where the log has none, and accelerations are in the odometer's
            metres.
        rms_m: of the way in a run about the model's.
        runs: number of runs from standstill to standstill that were used.
    """

    throttle: PedalFit
    brake: PedalFit
    rolling_mps2: Estimate
    drag_per_s: Estimate
    metres_per_odometer_metre: Estimate | None
    rms_m: float
    runs: int


class WayFit(NamedTuple):
    """Parameters fitted to the distances of several batch elements, in the order of ``PEDAL_NAMES``.

    Attributes:
        value: of each parameter.
        sigma: standard error.
        degrees: of freedom.
        rms_m: of the residuals.
    """

    value: Float[np.ndarray, "lane parameter"]
    sigma: Float[np.ndarray, "lane parameter"]
    degrees: Float[np.ndarray, " lane"]
    rms_m: Float[np.ndarray, " lane"]


def fit_pedals(signals: DriveSignals) -> PedalsFit:
    """Throttle and brake, from runs that start at standstill with steps of either command.

    Each command must be stepped to two values at least, and part of one be taken back, for the dead zone to show.

    Args:
        signals: of the log: commands and odometer, and fixes with heading where there are any.

    Raises:
        NotExcitedError: a signal is missing, the vehicle did not move or did not stand between, or the steps leave a
            parameter open: the message names it.
    """
    runs = cut_runs(signals, WHAT)
    scale = odometer_scale(signals)
    fit = fit_way(runs, _by_fixes(signals, runs, scale)[None])
    value = fit.value[0]
    way_m = float(np.ptp(signals.travel_m[runs.record]))
    if fit.rms_m[0] > 0.05 * way_m:
        raise NotExcitedError(WHAT, "a distance that the commands explain", f"a difference of {fit.rms_m[0]:.2f} m rms")
    # A parameter at its limit, or with no finite error, is as open as one with a large error.
    known = (fit.sigma[0] < LARGEST_SIGMA) & (value < MOST)
    if not known.all():
        open_names = ", ".join(name for name, commanded in zip(PEDAL_NAMES, known, strict=True) if not commanded)
        raise NotExcitedError(WHAT, "steps that determine every parameter", f"undetermined: {open_names}")
    sigma = np.hypot(fit.sigma[0], _timing_sigma(runs, fit.value))
    found = [
        _in_metres(name, estimate(float(v), float(s), fit.degrees[0]), scale, fit.degrees[0])
        for name, v, s in zip(PEDAL_NAMES, value, sigma, strict=True)
    ]
    return PedalsFit(
        throttle=PedalFit(*found[:4]),
        brake=PedalFit(*found[4:8]),
        rolling_mps2=found[8],
        drag_per_s=found[9],
        metres_per_odometer_metre=scale,
        rms_m=float(fit.rms_m[0]),
        runs=runs.runs,
    )


def fit_way(runs: PedalRuns, travel_m: Float[np.ndarray, "lane record"]) -> WayFit:
    """Fit the parameters to the distances of batch elements with the same commands.

    Args:
        runs: commands and runs, from ``cut_runs``.
        travel_m: by odometer, at the records of ``runs``.
    """
    lanes = travel_m.shape[0]
    value = np.tile(pedal_start(runs, travel_m[0], WHAT), (lanes, 1))
    damping = np.full(lanes, 1e-3)
    way, slope = predict_way(runs, value)
    raw = travel_m - way
    residual = _levelled(runs, raw, np.ones_like(raw))
    for _ in range(ROUNDS):
        weight = _huber(residual)
        residual, level_slope = _levelled(runs, raw, weight), _levelled(runs, slope, weight[:, None])
        unit_slope = level_slope * _unit(value)[..., None]
        # A damped step is always small; the undamped one shows the distance to convergence.
        settled = _small(_step(unit_slope, residual, weight, np.full(lanes, 1e-10)), unit_slope, residual)
        if (settled | (damping > 1e9)).all():
            break
        # A step that a limit would cut is taken along the limit: those that press against it stay out.
        step = _step(unit_slope, residual, weight, damping)
        pressed = ((value <= LEAST) & (step < 0.0)) | ((value >= MOST) & (step > 0.0))
        step = _step(np.where(pressed[..., None], 0.0, unit_slope), residual, weight, damping)
        trial = _moved(value, step)
        way, trial_slope = predict_way(runs, trial)
        trial_raw = travel_m - way
        trial_residual = _levelled(runs, trial_raw, weight)
        better = (weight * trial_residual**2).sum(axis=1) < (weight * residual**2).sum(axis=1)
        value, slope, raw, residual = _take(
            better, (trial, trial_slope, trial_raw, trial_residual), (value, slope, raw, residual)
        )
        damping = np.where(better, 0.1 * damping, 5.0 * damping)
    weight = _huber(residual)
    return _way_fit(runs, value, _levelled(runs, slope, weight[:, None]), _levelled(runs, raw, weight))


def _timing_sigma(runs: PedalRuns, value: Float[np.ndarray, "1 parameter"]) -> Float[np.ndarray, " parameter"]:
    """Change of the fit where a pedal acts later by ``COMMAND_SIGMA_S``: a longer lag, and another gain with it."""
    way, slope = predict_way(runs, value)
    even = np.ones_like(way)
    level_slope = _levelled(runs, slope, even[:, None])[0]
    share = COMMAND_SIGMA_S / np.maximum(runs.step_s, COMMAND_SIGMA_S)
    fresh = np.diff(runs.run, prepend=-1) != 0

    def moved(pedal: str) -> Float[np.ndarray, " parameter"]:
        command = getattr(runs, pedal)
        late = command + share * (np.where(fresh, command, np.roll(command, 1)) - command)
        later, _ = predict_way(runs._replace(**{pedal: late}), value)
        difference = _levelled(runs, later - way, even)[0]
        return np.asarray(np.linalg.lstsq(level_slope.T, difference, rcond=None)[0])

    # The fit may give a delay to the dead zone; the lag is not known better for that.
    both = np.hypot(moved("throttle"), moved("brake"))
    return np.asarray(np.maximum(both, np.where(LAGS, COMMAND_SIGMA_S, 0.0)))


def _by_fixes(signals: DriveSignals, runs: PedalRuns, scale: Estimate | None) -> Float[np.ndarray, " record"]:
    """Way at the records of the runs, in metres of the odometer over the whole log: by the fixes its scale differs from
    run to run.
    """
    way_m = signals.travel_m[runs.record].astype(np.float64)
    parts = [runs.record[runs.run == run] for run in range(runs.runs)]
    own = [odometer_scale(jax.tree.map(lambda values, part=part: values[part], signals)) for part in parts]
    known = [each for each in own if each is not None]
    if scale is None or len(known) < 3:
        return np.asarray(way_m)
    noise = np.mean([each.sigma**2 for each in known])
    # What the scales scatter beyond their own errors; each is trusted as far as that is the larger.
    wander = max(float(np.var([each.value for each in known], ddof=1) - noise), 0.0)
    for run, each in enumerate(own):
        if each is not None and wander > 0.0:
            inside = runs.run == run
            worth = 1.0 + wander / (wander + each.sigma**2) * (each.value / scale.value - 1.0)
            way_m[inside] = way_m[inside][0] + worth * (way_m[inside] - way_m[inside][0])
    return np.asarray(way_m)


def _in_metres(name: str, odometer: Estimate, scale: Estimate | None, degrees: float) -> Estimate:
    """Accelerations in metres of the fixes; what else there is does not depend on the odometer's."""
    if scale is None or not name.endswith("_mps2"):
        return odometer
    sigma = float(np.hypot(odometer.sigma * scale.value, odometer.value * scale.sigma))
    return estimate(odometer.value * scale.value, sigma, degrees)


def _levelled(
    runs: PedalRuns, signal: Float[np.ndarray, "... record"], weight: Float[np.ndarray, "... record"]
) -> Float[np.ndarray, "... record"]:
    """Less its mean over each run: where a run begins is not known better than its records."""
    starts = np.flatnonzero(np.diff(runs.run, prepend=-1))
    mean = np.add.reduceat(weight * signal, starts, axis=-1) / np.add.reduceat(weight, starts, axis=-1)
    return np.asarray(signal - np.repeat(mean, np.diff(np.append(starts, runs.run.size)), axis=-1))


def _scale(residual: Float[np.ndarray, "lane record"]) -> Float[np.ndarray, "lane 1"]:
    return np.asarray(np.maximum(np.median(np.abs(residual), axis=1, keepdims=True) / 0.6745, 1e-9))


def _huber(residual: Float[np.ndarray, "lane record"]) -> Float[np.ndarray, "lane record"]:
    return np.asarray(np.minimum(1.0, HUBER * _scale(residual) / np.maximum(np.abs(residual), 1e-300)))


def _unit(value: Float[np.ndarray, "lane parameter"]) -> Float[np.ndarray, "lane parameter"]:
    """What a step of 1 changes: gains and lags step by their logarithm, and so stay positive."""
    return np.where(POSITIVE, value, 1.0)


def _moved(
    value: Float[np.ndarray, "lane parameter"], step: Float[np.ndarray, "lane parameter"]
) -> Float[np.ndarray, "lane parameter"]:
    """After a step, of bounded length and within the limits."""
    step = step / np.maximum(1.0, np.max(np.abs(step) / LARGEST_CHANGE, axis=1, keepdims=True))
    trial = np.clip(np.where(POSITIVE, value * np.exp(step), value + step), LEAST, MOST)
    return np.asarray(trial)


def _step(
    slope: Float[np.ndarray, "lane parameter record"],
    residual: Float[np.ndarray, "lane record"],
    weight: Float[np.ndarray, "lane record"],
    damping: Float[np.ndarray, " lane"],
) -> Float[np.ndarray, "lane parameter"]:
    heavy = slope * weight[:, None]
    square = heavy @ slope.swapaxes(1, 2)
    length = np.sqrt(np.maximum(np.einsum("lpp->lp", square), 1e-12))
    unit = square / (length[:, :, None] * length[:, None, :]) + damping[:, None, None] * np.eye(length.shape[1])
    side = np.einsum("lpr,lr->lp", heavy, residual) / length
    return np.asarray(np.linalg.solve(unit, side[..., None])[..., 0] / length)


def _small(
    step: Float[np.ndarray, "lane parameter"],
    slope: Float[np.ndarray, "lane parameter record"],
    residual: Float[np.ndarray, "lane record"],
) -> Bool[np.ndarray, " lane"]:
    """Whether the step changes the distance by less than a fifth of the error due to one parameter."""
    moved = np.einsum("lp,lpr->lr", step, slope)
    allowed = 0.2 * _scale(residual)[:, 0] / np.sqrt(residual.shape[1])
    return np.asarray(np.sqrt(np.mean(moved**2, axis=1)) < allowed)


def _take(
    better: Bool[np.ndarray, " lane"], new: tuple[np.ndarray, ...], old: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, ...]:
    def choose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.where(better.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    return tuple(choose(a, b) for a, b in zip(new, old, strict=True))


def _way_fit(
    runs: PedalRuns,
    value: Float[np.ndarray, "lane parameter"],
    slope: Float[np.ndarray, "lane parameter record"],
    residual: Float[np.ndarray, "lane record"],
) -> WayFit:
    """Errors of an M-estimate whose records count as many as are independent."""
    scale = _scale(residual)
    pull = np.clip(residual / scale, -HUBER, HUBER)
    steep = np.mean(np.abs(residual) < HUBER * scale, axis=1)
    share = np.array([independent_share(lane) for lane in pull])
    degrees = share * residual.shape[1] - value.shape[1] - runs.runs
    variance = scale[:, 0] ** 2 * np.sum(pull**2, axis=1) / (np.maximum(degrees, 1e-9) * steep**2)
    square = slope @ slope.swapaxes(1, 2)
    length = np.sqrt(np.maximum(np.einsum("lpp->lp", square), 1e-12))
    # The ridge leaves unobservable parameters with an error of its size.
    inverse = np.linalg.inv(square / (length[:, :, None] * length[:, None, :]) + 1e-10 * np.eye(length.shape[1]))
    sigma = np.sqrt(variance[:, None] * np.einsum("lpp->lp", inverse)) / length
    return WayFit(value, sigma, np.maximum(degrees, 3.0), np.sqrt(np.mean(residual**2, axis=1)))
