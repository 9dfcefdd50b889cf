"""The look-ahead distance: tuned on trial courses by gradient, and limit cycles that a short one brings."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from lgprjax.tuning.robust import NotExcitedError
from lgprjax.vehicle import (
    Chassis,
    LookAhead,
    Path,
    RolloutLane,
    RolloutMetrics,
    RolloutSpec,
    Servo,
    anchor_lead_m,
    look_ahead_m,
    phase_margin_rad,
    roll_out,
    start_rollout,
    torque_share,
)

# Criteria of a look-ahead: error and oscillation over courses, offsets and speeds, and the phase margin.


class TunedVehicle(NamedTuple):
    """The vehicle that a look-ahead is for; scalars.

    Attributes:
        chassis: its geometry and limits, which the law knows.
        servo: that turns its wheels.
        supply_v: at the servo: a lower one for a study of reduced torque.
    """

    chassis: Chassis
    servo: Servo
    supply_v: Float[Array, ""]


@dataclass(frozen=True, eq=False)
class TrialCourses:
    """Courses, each driven at every speed from every offset. Static: equal courses share their compiled programs.

    Attributes:
        paths: courses.
        speeds_mps: forward.
        offsets_m: of the anchor at the start, left positive.
        duration_s: of each drive.
        step_s: of the simulation.
        effort_m2: weight of the wheels' movement in the cost: so many metres of error a radian a metre.
        least_margin_rad: phase margin that lag and delay must leave; 30° is the usual least.
        longest_delay_s: that a servo may have.
    """

    paths: tuple[Path, ...]
    speeds_mps: tuple[float, ...]
    offsets_m: tuple[float, ...] = (0.0, 3.0, -3.0)
    duration_s: float = 25.0
    step_s: float = 0.05
    effort_m2: float = 2.0
    least_margin_rad: float = float(np.radians(30.0))
    longest_delay_s: float = 0.2

    @cached_property
    def _content(self) -> tuple[Any, ...]:
        paths = [np.asarray(leaf).tobytes() for path in self.paths for leaf in path]
        return (*paths, *(getattr(self, field.name) for field in fields(self) if field.name != "paths"))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TrialCourses) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)


class LookAheadCosts(NamedTuple):
    """A look-ahead at each speed, means over courses and offsets.

    Attributes:
        cost_m: error and weighted effort.
        error_m: RMS of the anchor's distance from the path.
        cycle_m: amplitude of what is left to and fro at the end of the drives.
        effort_radpm: movement of the wheels a metre.
        margin_rad: phase margin on a straight path.
    """

    cost_m: Float[Array, "*look speed"]
    error_m: Float[Array, "*look speed"]
    cycle_m: Float[Array, "*look speed"]
    effort_radpm: Float[Array, "*look speed"]
    margin_rad: Float[Array, "*look speed"]


def judge(vehicle: TunedVehicle, trials: TrialCourses, schedule: LookAhead) -> LookAheadCosts:
    """Drive all trials with a look-ahead, or with many: fields of ``schedule`` are scalars or one value a look-ahead.

    Differentiable in the schedule but for ``cycle_m``.
    """
    looks = jnp.shape(schedule.short_m)
    speed = jnp.asarray(trials.speeds_mps, jnp.float32)
    offset = jnp.asarray(trials.offsets_m, jnp.float32)
    shape = (*looks, len(speed), len(offset))

    def over(values: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
        """Values along one axis of the batch; a scalar serves all."""
        wanted = [1] * len(shape)
        if jnp.ndim(values):
            wanted[axis] = -1
        return jnp.broadcast_to(jnp.reshape(values, wanted), shape).reshape(-1)

    every = jax.tree.map(lambda field: over(field, 0), schedule)
    lane = RolloutLane(
        vehicle.chassis, vehicle.chassis, vehicle.servo, vehicle.supply_v, over(speed, len(looks)), every
    )
    slots = int(np.ceil(trials.longest_delay_s / trials.step_s))
    spec = RolloutSpec(steps=round(trials.duration_s / trials.step_s), step_s=trials.step_s, delay_slots=slots)
    found = []
    for path in trials.paths:
        zero = jnp.zeros(int(np.prod(shape)), jnp.float32)
        start = start_rollout(path, lane, zero, over(offset, len(looks) + 1), zero, delay_slots=slots)
        found.append(roll_out(spec, path, lane, start)[1])
    # A mean over courses and offsets, one value a look-ahead and speed.
    mean: RolloutMetrics = jax.tree.map(
        lambda *fields: jnp.mean(jnp.stack(fields).reshape(len(fields), *shape), axis=(0, -1)), *found
    )
    return LookAheadCosts(
        mean.rms_m + trials.effort_m2 * mean.effort_radpm,
        mean.rms_m,
        mean.cycle_m,
        mean.effort_radpm,
        margins(vehicle, schedule, speed),
    )


def margins(vehicle: TunedVehicle, schedule: LookAhead, speed_mps: Float[Array, " speed"]) -> Float[Array, "..."]:
    """Phase margin of each look-ahead at each speed, with the servo's lag at its supply and its delay."""
    fields = jax.tree.map(lambda field: jnp.asarray(field)[..., None], schedule)
    speed = jnp.broadcast_to(speed_mps, (*jnp.shape(schedule.short_m), len(speed_mps)))
    ahead = look_ahead_m(fields, speed)
    lag_s = vehicle.servo.lag_s / torque_share(vehicle.servo, vehicle.supply_v)
    return phase_margin_rad(ahead, anchor_lead_m(vehicle.chassis), speed, lag_s, vehicle.servo.delay_s)


def sweep_look_ahead(vehicle: TunedVehicle, trials: TrialCourses, look_ahead_m: Sequence[float]) -> LookAheadCosts:
    """The sweep surface (LL figs. 20, 21): every look-ahead at every speed, each the same at all speeds."""
    length = jnp.asarray(look_ahead_m, jnp.float32)
    zero = jnp.zeros_like(length)
    return judge(vehicle, trials, LookAhead(length, length, zero, zero))


_PENALTY_M = 20.0
"""Cost of a radian of missing phase margin: steep compared with any possible reduction of the error."""

_FIRST_M = np.geomspace(0.8, 24.0, 24)


@dataclass(frozen=True)
class GradientConfig:
    """How far the gradient is followed.

    Attributes:
        steps: of Adam.
        rate: of change, in the logarithm of lengths and speeds; it falls to nothing along a cosine.
    """

    steps: int = 100
    rate: float = 0.05


_USUAL = GradientConfig()


class TunedLookAhead(NamedTuple):
    """A look-ahead found.

    Attributes:
        schedule: over speed.
        judged: by the same trials; its margins are those asked for or more.
        cost_m: mean over speeds, which was made least.
        history_m: cost with the penalty, step by step.
    """

    schedule: LookAhead
    judged: LookAheadCosts
    cost_m: float
    history_m: Float[np.ndarray, " step"]


class _Shape(NamedTuple):
    """A schedule in numbers without limits: logarithms of the short length, of what the long one has more, of the slow
    speed and of the span to the fast one."""

    short: Float[Array, "..."]
    more: Float[Array, "..."]
    slow: Float[Array, "..."]
    span: Float[Array, "..."]


def tune_look_ahead(vehicle: TunedVehicle, trials: TrialCourses, config: GradientConfig = _USUAL) -> TunedLookAhead:
    """Least mean cost over the trials' speeds, with the required phase margin at each of them.

    The start is read off a coarse sweep; the gradient goes through every step of every drive. What margin is still
    missing at the end is made up by lengthening the look-ahead.

    Raises:
        ValueError: fewer than two speeds, a delay longer than the trials', or no look-ahead of the sweep leaves the
            margin at some speed.
    """
    speeds = np.asarray(trials.speeds_mps)
    if len(np.unique(speeds)) < 2:
        raise ValueError("a look-ahead over speed needs trials at two speeds or more")
    if float(vehicle.servo.delay_s) > trials.longest_delay_s:
        found = f"{float(vehicle.servo.delay_s):g} s"
        raise ValueError(f"trials are made for delays of up to {trials.longest_delay_s:g} s, the servo's is {found}")
    theta = _first(vehicle, trials)
    rates = optax.cosine_decay_schedule(config.rate, config.steps)
    optimiser = optax.adam(rates)
    state, best, history = optimiser.init(theta), theta, []
    for _ in range(config.steps):
        value, gradient = _slope(trials, vehicle, theta)
        history.append(float(value))
        if history[-1] <= min(history):
            best = theta
        # A drive on the edge of stability has a gradient of any size.
        gradient = jax.tree.map(lambda field: jnp.clip(jnp.nan_to_num(field), -1.0, 1.0), gradient)
        # Optax raises floats to the power of its integer count.
        with jax.numpy_dtype_promotion("standard"):
            update, state = optimiser.update(gradient, state)
        theta = optax.apply_updates(theta, update)
    schedule = _long_enough(vehicle, trials, schedule_of(best))
    judged = judge(vehicle, trials, schedule)
    return TunedLookAhead(schedule, judged, float(jnp.mean(judged.cost_m)), np.array(history))


def schedule_of(shape: _Shape) -> LookAhead:
    """The look-ahead of free numbers."""
    short, slow = jnp.exp(shape.short), jnp.exp(shape.slow)
    return LookAhead(short, short + jnp.exp(shape.more), slow, slow + jnp.exp(shape.span))


@partial(jax.jit, static_argnums=0)
def _slope(trials: TrialCourses, vehicle: TunedVehicle, shape: _Shape) -> tuple[Float[Array, ""], _Shape]:
    """Cost with the penalty, and its gradient."""
    return jax.value_and_grad(lambda free: _penalised(vehicle, trials, free))(shape)


def _penalised(vehicle: TunedVehicle, trials: TrialCourses, shape: _Shape) -> Float[Array, ""]:
    judged = judge(vehicle, trials, schedule_of(shape))
    missing = jnp.maximum(trials.least_margin_rad - judged.margin_rad, 0.0)
    return jnp.mean(judged.cost_m) + _PENALTY_M * jnp.mean(missing)


def _first(vehicle: TunedVehicle, trials: TrialCourses) -> _Shape:
    """Least cost at each speed of a coarse sweep, as a schedule from the slowest speed to the fastest."""
    swept = sweep_look_ahead(vehicle, trials, _FIRST_M.tolist())
    enough = np.asarray(swept.margin_rad) >= trials.least_margin_rad
    speeds = np.asarray(trials.speeds_mps)
    if not enough.any(axis=0).all():
        none = ", ".join(f"{v:g}" for v in speeds[~enough.any(axis=0)])
        raise ValueError(f"at {none} m/s no look-ahead up to {_FIRST_M[-1]:g} m leaves the required phase margin")
    best = _FIRST_M[np.argmin(np.where(enough, np.asarray(swept.cost_m), np.inf), axis=0)]
    slowest, fastest = int(np.argmin(speeds)), int(np.argmax(speeds))
    short, long = best[slowest], max(best[fastest], 1.05 * best[slowest])
    numbers = (short, long - short, speeds[slowest], speeds[fastest] - speeds[slowest])
    return _Shape(*(jnp.float32(np.log(number)) for number in numbers))


def _long_enough(vehicle: TunedVehicle, trials: TrialCourses, schedule: LookAhead) -> LookAhead:
    """The schedule lengthened by the least factor of a fine ladder that leaves every margin."""
    factors = jnp.asarray(np.geomspace(1.0, 4.0, 400), jnp.float32)
    longer = LookAhead(
        factors * schedule.short_m,
        factors * schedule.long_m,
        schedule.slow_mps + 0.0 * factors,
        schedule.fast_mps + 0.0 * factors,
    )
    left = margins(vehicle, longer, jnp.asarray(trials.speeds_mps, jnp.float32))
    enough = np.asarray(jnp.all(left >= trials.least_margin_rad, axis=-1))
    if not enough.any():
        raise ValueError("no multiple of the look-ahead leaves the required phase margin")
    first = int(np.argmax(enough))
    return LookAhead(*(field[first] for field in longer))


# Whether a logged drive swings about its line for good: a limit cycle, its size and its period (MF section 4).
#
# Noise and the damped swings that it feeds do not repeat: over half a period a limit cycle is its own mirror image,
# over a whole one it is itself. Autocorrelation at both lags, over enough periods, separates the two; slow wandering
# and the noise of single records are filtered out before.

_PERIODS = 4.0
"""Fewer of them are no cycle yet."""
_REPEATS = 0.5
"""Least correlation of the offset with itself a period later, and least of its opposite half a period later."""
_LASTS = 0.5
"""Least share of the swing's size in the weaker half of the log over that in the stronger one."""
_ANSWER_S = 10.0
_STEP_S = 0.1
_SHORTEST_S, _LONGEST_S = 2.0, 120.0


class LimitCycle(NamedTuple):
    """Result.

    Attributes:
        found: the vehicle swings for good.
        peak_to_peak_m: of the swing: median over its periods.
        period_s: of it.
        periods: how many the log holds.
        repeats: correlation with itself a period later; mirrored: with its opposite half a period later.
        lasts: size in the weaker half of the log over that in the stronger one.
    """

    found: bool
    peak_to_peak_m: float
    period_s: float
    periods: float
    repeats: float
    mirrored: float
    lasts: float


def find_limit_cycle(
    time_s: Float[np.ndarray, " record"],
    cross_m: Float[np.ndarray, " record"],
    *,
    bend_radpm: Float[np.ndarray, " record"] | None = None,
    least_m: float = 0.05,
) -> LimitCycle:
    """Look for a limit cycle in a drive along a line or a route.

    Args:
        time_s: increasing; records may be uneven.
        cross_m: from the line or route, to the left.
        bend_radpm: curvature of the route where the vehicle is: what follows it up to ten seconds later is no swing of
            the vehicle's own. None for a straight line.
        least_m: peak to peak that counts.

    Raises:
        NotExcitedError: a log of less than four times the shortest period that is looked for, or no numbers.
    """
    if len(time_s) < 2 or not (np.isfinite(time_s).all() and np.isfinite(cross_m).all()):
        raise NotExcitedError("limit cycle", "finite records", "no records, or values that are not finite")
    span_s = float(time_s[-1] - time_s[0])
    if span_s < 2.0 * _PERIODS * _SHORTEST_S:
        raise NotExcitedError("limit cycle", f"a log of {2.0 * _PERIODS * _SHORTEST_S:.0f} s", f"{span_s:.1f} s")
    even_s = np.arange(time_s[0], time_s[-1], _STEP_S)
    offset = np.interp(even_s, time_s, cross_m)
    offset = _smooth(offset, 0.25 * _SHORTEST_S)
    bends = np.zeros(len(even_s)) if bend_radpm is None else np.interp(even_s, time_s, bend_radpm)
    offset = _unforced(offset, bends)
    longest = min(_LONGEST_S, span_s / _PERIODS)
    correlation = _autocorrelation(offset, int(longest / _STEP_S) + 1)
    lag = _first_peak(correlation)
    if lag is None:
        return LimitCycle(
            found=False, peak_to_peak_m=0.0, period_s=float("nan"), periods=0.0, repeats=0.0, mirrored=0.0, lasts=0.0
        )
    period_s = lag * _STEP_S
    sizes = _peak_to_peak(offset, lag)
    halves = np.median(sizes[: (len(sizes) + 1) // 2]), np.median(sizes[len(sizes) // 2 :])
    size, lasts = float(np.median(sizes)), float(min(halves) / max(max(halves), 1e-12))
    repeats, mirrored = float(correlation[lag]), float(-correlation[lag // 2])
    found = size >= least_m and repeats >= _REPEATS and mirrored >= _REPEATS and lasts >= _LASTS
    return LimitCycle(
        found=bool(found),
        peak_to_peak_m=size,
        period_s=period_s,
        periods=span_s / period_s,
        repeats=repeats,
        mirrored=mirrored,
        lasts=lasts,
    )


def _smooth(values: Float[np.ndarray, " time"], over_s: float) -> Float[np.ndarray, " time"]:
    """Running mean, shorter at the ends."""
    width = max(int(over_s / _STEP_S) // 2, 1)
    summed = np.concatenate([[0.0], np.cumsum(values)])
    low = np.maximum(np.arange(len(values)) - width, 0)
    high = np.minimum(np.arange(len(values)) + width + 1, len(values))
    return np.asarray((summed[high] - summed[low]) / (high - low))


def _unforced(offset: Float[np.ndarray, " time"], bends: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """The offset without its trend and without the response to the route's bends."""
    even = np.linspace(-1.0, 1.0, len(offset))
    shifts = np.arange(0, int(_ANSWER_S / _STEP_S) + 1, int(1.0 / _STEP_S))
    answers = [np.concatenate([np.zeros(shift), bends[: len(bends) - shift]]) for shift in shifts]
    columns = np.stack([np.ones_like(even), even, *answers], axis=1)
    return np.asarray(offset - columns @ np.linalg.lstsq(columns, offset, rcond=None)[0])


def _autocorrelation(values: Float[np.ndarray, " time"], lags: int) -> Float[np.ndarray, " lag"]:
    """Correlation of the values with themselves by lag, each over what overlaps."""
    result = np.ones(lags)
    for lag in range(1, lags):
        ahead, behind = values[lag:], values[:-lag]
        result[lag] = np.sum(ahead * behind) / max(np.sqrt(np.sum(ahead**2) * np.sum(behind**2)), 1e-30)
    return result


def _first_peak(correlation: Float[np.ndarray, " lag"]) -> int | None:
    """Lag of the highest correlation after it was first negative, no shorter than the shortest period."""
    negative = np.flatnonzero(correlation < 0.0)
    if len(negative) == 0:
        return None
    start = max(int(negative[0]), int(_SHORTEST_S / _STEP_S))
    if start >= len(correlation) - 1:
        return None
    later = correlation[start:]
    # Multiples of the period are as high: the first that comes near the highest is the period.
    near = np.flatnonzero((later[1:-1] >= later[:-2]) & (later[1:-1] >= later[2:]) & (later[1:-1] >= 0.9 * later.max()))
    return None if len(near) == 0 else start + 1 + int(near[0])


def _peak_to_peak(values: Float[np.ndarray, " time"], period: int) -> Float[np.ndarray, " period"]:
    """Range within each whole period."""
    whole = values[: len(values) // period * period].reshape(-1, period)
    return np.asarray(np.ptp(whole, axis=1))
