"""The look-ahead over speed and torque of a vehicle that is known as far as its logs tell: tuned over draws of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from lgprjax.tuning.look_ahead import TrialCourses, _Shape, schedule_of
from lgprjax.tuning.loop import NAMES, STEP_S, LoopLogs, LoopPrior, loop_model, places_of
from lgprjax.tuning.loop_fit import LoopFit
from lgprjax.vehicle import (
    Chassis,
    LookAhead,
    ProportionalRear,
    RolloutLane,
    RolloutSpec,
    Servo,
    anchor_lead_m,
    look_ahead_m,
    phase_margin_rad,
    rear_angle,
    roll_out,
    start_rollout,
    stretched_look_ahead,
)


class DrawnVehicles(NamedTuple):
    """Vehicles that the logs allow.

    Attributes:
        chassis, servo: one value a draw; the servo's nominal supply is 1, so that supplies are shares of its torque.
        believed: what the law on board goes by.
    """

    chassis: Chassis
    servo: Servo
    believed: Chassis


class WeakSchedule(NamedTuple):
    """A look-ahead over speed that grows as torque falls.

    Attributes:
        look_ahead: at full torque.
        exponent: the look-ahead is multiplied by the torque's share to minus this power.
    """

    look_ahead: LookAhead
    exponent: Float[Array, "..."]


@dataclass(frozen=True)
class DrawnTuning:
    """How the schedule is sought.

    Attributes:
        shares: of the torque that it is tuned for, 1 first; the least is the least that it is valid for.
        steps, batch, rate: of Adam: steps, draws in each, and rate of change in logarithms.
        margin_draws: share of the draws that must have the required phase margin.
    """

    shares: tuple[float, ...] = (1.0, 0.7, 0.43)
    steps: int = 60
    batch: int = 32
    rate: float = 0.06
    margin_draws: float = 0.95


class DrawnCosts(NamedTuple):
    """A schedule over draws, speeds and shares: means over courses and offsets.

    Attributes:
        cost_m: error and weighted effort; error_m: RMS alone.
        cycle_m: amplitude of the oscillation over the last stretch, the largest of the courses.
        margin_rad: phase margin on a straight path.
        left_m: offset from a straight path up to which dead band and play stop the wheels.
    """

    cost_m: Float[Array, "draw speed share"]
    error_m: Float[Array, "draw speed share"]
    cycle_m: Float[Array, "draw speed share"]
    margin_rad: Float[Array, "draw speed share"]
    left_m: Float[Array, "draw speed share"]


class TunedOnDraws(NamedTuple):
    """The schedule found.

    Attributes:
        schedule: over speed and torque.
        least_share: of the torque down to which it was tuned.
        judged: over all draws.
        speeds_mps, shares: axes of that.
        best_m: look-ahead that would be best for each draw at each speed, at full torque.
        low_m, high_m: that 95 % of the draws would want, by speed.
        history_m: cost with the penalty, step by step.
    """

    schedule: WeakSchedule
    least_share: float
    judged: DrawnCosts
    speeds_mps: Float[np.ndarray, " speed"]
    shares: Float[np.ndarray, " share"]
    best_m: Float[np.ndarray, "draw speed"]
    low_m: Float[np.ndarray, " speed"]
    high_m: Float[np.ndarray, " speed"]
    history_m: Float[np.ndarray, " step"]


def drawn_vehicles(chassis: Chassis, prior: LoopPrior, draws: Float[Array, "draw number"]) -> DrawnVehicles:
    """Vehicles of drawn numbers, driven by the law of ``chassis``."""
    number = dict(zip(NAMES, draws.T, strict=True))
    one = jnp.ones(len(draws), jnp.float32)
    drawn = Chassis(
        chassis.wheelbase_m * one,
        chassis.anchor_m * one,
        ProportionalRear(number["rear_ratio"]),
        chassis.largest_angle_rad * one,
        jax.lax.rsqrt(jnp.maximum(number["slip_s2pm2"], 1e-6)),
    )
    servo = Servo(
        lag_s=number["lag_s"],
        rate_radps=number["rate_radps"],
        delay_s=number["delay_s"],
        dead_band_rad=number["dead_band_rad"],
        backlash_rad=prior.backlash_rad * one,
        asymmetry=number["asymmetry"],
        nominal_v=one,
        stall_v=0.0 * one,
    )
    return DrawnVehicles(drawn, servo, chassis)


def judge_drawn(
    vehicles: DrawnVehicles, trials: TrialCourses, schedule: WeakSchedule, shares: Float[Array, " share"]
) -> DrawnCosts:
    """Drive every trial with every draw at every share of the torque. Differentiable in the schedule."""
    speeds, offsets = (jnp.asarray(v, jnp.float32) for v in (trials.speeds_mps, trials.offsets_m))
    draws = vehicles.servo.lag_s.shape[0]
    shape = (draws, len(speeds), len(shares), len(offsets))
    ahead = _lengths(schedule, speeds, shares)
    return _driven(vehicles, trials, jnp.broadcast_to(ahead[None], shape[:3]), shares)


def _lengths(
    schedule: WeakSchedule, speeds_mps: Float[Array, " speed"], shares: Float[Array, " share"]
) -> Float[Array, "speed share"]:
    held = stretched_look_ahead(schedule.look_ahead, schedule.exponent, shares[None, :], jnp.min(shares))
    return look_ahead_m(held, speeds_mps[:, None])


def _driven(
    vehicles: DrawnVehicles,
    trials: TrialCourses,
    ahead: Float[Array, "draw speed share"],
    shares: Float[Array, " share"],
) -> DrawnCosts:
    """Every trial with a look-ahead for each draw, speed and share."""
    speeds, offsets = (jnp.asarray(v, jnp.float32) for v in (trials.speeds_mps, trials.offsets_m))
    shape = (*ahead.shape, len(offsets))

    def over(values: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
        wanted = [1] * len(shape)
        wanted[axis] = -1
        return jnp.broadcast_to(jnp.reshape(values, wanted), shape).reshape(-1)

    flat_ahead = jnp.broadcast_to(ahead[..., None], shape).reshape(-1)
    zero = jnp.zeros_like(flat_ahead)
    chassis, servo = (jax.tree.map(lambda field: over(field, 0), part) for part in (vehicles.chassis, vehicles.servo))
    lane = RolloutLane(
        chassis,
        vehicles.believed,
        servo,
        over(shares, 2),
        over(speeds, 1),
        LookAhead(flat_ahead, flat_ahead, zero, zero),
    )
    slots = int(np.ceil(trials.longest_delay_s / trials.step_s))
    spec = RolloutSpec(steps=round(trials.duration_s / trials.step_s), step_s=trials.step_s, delay_slots=slots)
    runs = []
    for path in trials.paths:
        start = start_rollout(path, lane, zero, over(offsets, 3), zero, delay_slots=slots)
        runs.append(roll_out(spec, path, lane, start))
    error = jnp.mean(jnp.stack([m.rms_m for _, m in runs]).reshape(len(runs), *shape), axis=(0, -1))
    effort = jnp.mean(jnp.stack([m.effort_radpm for _, m in runs]).reshape(len(runs), *shape), axis=(0, -1))
    cycle = jnp.max(jnp.stack([m.cycle_m for _, m in runs]).reshape(len(runs), *shape), axis=(0, -1))
    lag = vehicles.servo.lag_s[:, None, None] / shares[None, None]
    lead = anchor_lead_m(vehicles.chassis)[:, None, None]
    delay = vehicles.servo.delay_s[:, None, None]
    margin = phase_margin_rad(ahead, lead, speeds[None, :, None], lag, delay)
    slope = rear_angle(vehicles.chassis.rear, jnp.zeros_like(vehicles.servo.lag_s))[1]
    stuck = vehicles.servo.dead_band_rad + 0.5 * vehicles.servo.backlash_rad
    bend = ((1.0 + slope) * stuck / vehicles.chassis.wheelbase_m)[:, None, None]
    left = ahead * (0.5 * ahead + lead) * bend
    return DrawnCosts(error + trials.effort_m2 * effort, error, cycle, margin, left)


SETTLED_M = 0.1
"""Amplitude of an oscillation above which a schedule is said not to settle."""
_PENALTY = 5.0
"""Cost of leaving e times what may be left: steep beside what it saves. By ratio: by the metre, a slow speed that could
settle would be given up for a centimetre at a fast one that cannot."""
_LEFT_SHARE = 0.75
"""Of ``SETTLED_M`` that dead band and play may leave: lag and delay carry the vehicle on by some tenths of it."""
_EXPONENT = 0.5
"""Of the torque's share, where the tuner begins."""
_MORE = 1.0 + 1e-4
"""Single precision does not take a length that suffices for one that does not."""
_LADDER_M = np.geomspace(0.8, 20.0, 10)
_LONGEST_M = 100.0
_SLICE = 512


def _of_free(
    trials: TrialCourses,
    shares: tuple[float, ...],
    needed_m: Float[Array, "speed share"],
    free: tuple[_Shape, Array],
) -> WeakSchedule:
    """Long enough whatever the numbers are: the tuner moves along the bound, where a penalty would hold it in place."""
    schedule = WeakSchedule(schedule_of(free[0]), jax.nn.softplus(free[1]))
    return lengthened(schedule, needed_m, *(jnp.asarray(v, jnp.float32) for v in (trials.speeds_mps, shares)))


@partial(jax.jit, static_argnums=(0, 1))
def _slope(
    trials: TrialCourses,
    shares: tuple[float, ...],
    vehicles: DrawnVehicles,
    needed_m: Float[Array, "speed share"],
    free: tuple[_Shape, Array],
) -> tuple[Float[Array, ""], tuple[_Shape, Array]]:
    def price(free: tuple[_Shape, Array]) -> Float[Array, ""]:
        schedule = _of_free(trials, shares, needed_m, free)
        judged = judge_drawn(vehicles, trials, schedule, jnp.asarray(shares, jnp.float32))
        beyond = jnp.log(jnp.maximum(judged.left_m / (_LEFT_SHARE * SETTLED_M), 1.0))
        return jnp.mean(judged.cost_m) + _PENALTY * jnp.mean(beyond)

    return jax.value_and_grad(price)(free)


@partial(jax.jit, static_argnums=(0, 1))
def _judged(
    trials: TrialCourses, shares: tuple[float, ...], vehicles: DrawnVehicles, schedule: WeakSchedule
) -> DrawnCosts:
    return judge_drawn(vehicles, trials, schedule, jnp.asarray(shares, jnp.float32))


@partial(jax.jit, static_argnums=0)
def _at_length(trials: TrialCourses, vehicles: DrawnVehicles, ahead: Float[Array, ""]) -> DrawnCosts:
    draws = vehicles.servo.lag_s.shape[0]
    return _driven(vehicles, trials, jnp.broadcast_to(ahead, (draws, len(trials.speeds_mps), 1)), jnp.ones(1))


def tune_on_draws(vehicles: DrawnVehicles, trials: TrialCourses, config: DrawnTuning | None = None) -> TunedOnDraws:
    """Least mean cost over draws, speeds and shares of the torque, by gradient through every step of every drive.

    A look-ahead that leaves the phase margin and still settles within ``SETTLED_M`` is preferred to one of less cost:
    a long one is as good in a drive's first seconds and leaves more in the end.
    Schedules with which too few draws have the required phase margin are lengthened before they are driven: no more
    than that, and only at the speeds that want it. Each step of Adam takes other draws; the result is judged on all.

    Raises:
        ValueError: fewer than two speeds, a delay longer than the trials', or no length leaves the margin.
    """
    config = config or DrawnTuning()
    speeds = np.asarray(trials.speeds_mps)
    if len(np.unique(speeds)) < 2:
        raise ValueError("a look-ahead over speed needs trials at two speeds or more")
    longest = float(np.max(np.asarray(vehicles.servo.delay_s)))
    if longest > trials.longest_delay_s:
        raise ValueError(
            f"trials are made for delays of up to {trials.longest_delay_s:g} s, draws go to {longest:.3f} s"
        )
    # One offset decides which look-ahead is best; the schedule itself is judged from all of them.
    one = replace(trials, offsets_m=(max(trials.offsets_m, key=abs),))
    best = _best_lengths(vehicles, one)
    middle = np.median(best, axis=0)
    slow, fast = int(np.argmin(speeds)), int(np.argmax(speeds))
    short, long = middle[slow], max(middle[fast], 1.05 * middle[slow])
    needed = jnp.asarray(_needed_lengths(vehicles, trials, config), jnp.float32)
    numbers = (short, long - short, speeds[slow], speeds[fast] - speeds[slow])
    free = (_Shape(*(jnp.float32(np.log(number)) for number in numbers)), jnp.float32(np.log(np.expm1(_EXPONENT))))
    optimiser = optax.adam(optax.cosine_decay_schedule(config.rate, config.steps))
    state, history = optimiser.init(free), []
    count = len(best)
    for number in range(config.steps):
        at = (np.arange(config.batch) + number * config.batch) % count
        some = _taken(vehicles, at)
        value, gradient = _slope(trials, config.shares, some, needed, free)
        history.append(float(value))
        gradient = jax.tree.map(lambda field: jnp.clip(jnp.nan_to_num(field), -1.0, 1.0), gradient)
        with jax.numpy_dtype_promotion("standard"):
            update, state = optimiser.update(gradient, state)
        free = optax.apply_updates(free, update)
    schedule = _of_free(trials, config.shares, needed, free)
    judged = _over_draws(lambda some: _judged(trials, config.shares, some, schedule), vehicles)
    low, high = np.percentile(best, [2.5, 97.5], axis=0)
    return TunedOnDraws(
        schedule=schedule,
        least_share=min(config.shares),
        judged=judged,
        speeds_mps=speeds,
        shares=np.array(config.shares),
        best_m=best,
        low_m=low,
        high_m=high,
        history_m=np.array(history),
    )


def _taken(vehicles: DrawnVehicles, at: np.ndarray) -> DrawnVehicles:
    """Some of the draws."""
    chassis, servo = (jax.tree.map(lambda field: field[at], part) for part in (vehicles.chassis, vehicles.servo))
    return DrawnVehicles(chassis, servo, vehicles.believed)


def _over_draws(call: Callable[[DrawnVehicles], DrawnCosts], vehicles: DrawnVehicles) -> DrawnCosts:
    """In slices of one size, so that one program serves any number of draws."""
    count = len(np.asarray(vehicles.servo.lag_s))
    size = min(_SLICE, count)
    parts = []
    for low in range(0, count, size):
        at = np.minimum(np.arange(low, low + size), count - 1)
        found = call(_taken(vehicles, at))
        parts.append(jax.tree.map(lambda field, low=low: np.asarray(field)[: count - low], found))
    joined: DrawnCosts = jax.tree.map(lambda *fields: np.concatenate(fields), *parts)
    return joined


def _best_lengths(vehicles: DrawnVehicles, trials: TrialCourses) -> Float[np.ndarray, "draw speed"]:
    """Each draw's own best look-ahead with its margin, between the rungs of a ladder by a parabola."""
    rungs = [_over_draws(partial(_at_length, trials, ahead=jnp.float32(m)), vehicles) for m in _LADDER_M]
    cost = np.stack([np.asarray(rung.cost_m)[..., 0] for rung in rungs])
    margin = np.stack([np.asarray(rung.margin_rad)[..., 0] for rung in rungs])
    enough = margin >= trials.least_margin_rad
    if not enough.any(axis=0).all(axis=0).any():
        raise ValueError(f"no look-ahead up to {_LADDER_M[-1]:g} m leaves the required phase margin")
    cost = np.where(enough | (np.arange(len(rungs))[:, None, None] == len(rungs) - 1), cost, np.inf)
    at = np.argmin(cost, axis=0)
    inner = np.clip(at, 1, len(rungs) - 2)
    left, mid, right = (np.take_along_axis(cost, (inner + d)[None], axis=0)[0] for d in (-1, 0, 1))
    with np.errstate(invalid="ignore"):
        bend = left - 2.0 * mid + right
        shift = np.where(np.isfinite(bend) & (bend > 0.0), 0.5 * (left - right) / np.where(bend > 0.0, bend, 1.0), 0.0)
    step = np.log(_LADDER_M[1] / _LADDER_M[0])
    place = np.where(at == inner, inner + np.clip(np.nan_to_num(shift), -0.5, 0.5), at)
    return np.asarray(_LADDER_M[0] * np.exp(step * place))


def _needed_lengths(
    vehicles: DrawnVehicles, trials: TrialCourses, config: DrawnTuning
) -> Float[np.ndarray, "speed share"]:
    """The least look-ahead with which enough draws have the required phase margin, by speed and share of the torque."""
    lead, lag, delay = (
        np.asarray(part)[:, None, None]
        for part in (anchor_lead_m(vehicles.chassis), vehicles.servo.lag_s, vehicles.servo.delay_s)
    )
    numbers = (lead, np.asarray(trials.speeds_mps)[:, None], lag / np.asarray(config.shares), delay)
    alike = [jnp.asarray(part, jnp.float32) for part in np.broadcast_arrays(*numbers)]
    least, most = jnp.zeros_like(alike[0]), jnp.full_like(alike[0], _LONGEST_M)
    for _ in range(24):
        middle = 0.5 * (least + most)
        enough = phase_margin_rad(middle, *alike) >= trials.least_margin_rad
        least, most = jnp.where(enough, least, middle), jnp.where(enough, middle, most)
    needed = np.quantile(np.asarray(most, np.float64), config.margin_draws, axis=0, method="higher")
    for speed, share in np.argwhere(needed > 0.99 * _LONGEST_M):
        where = f"{trials.speeds_mps[speed]:g} m/s and {config.shares[share]:.0%} of the torque"
        raise ValueError(f"at {where} no look-ahead up to {_LONGEST_M:g} m leaves the required phase margin")
    return np.asarray(needed)


def lengthened(
    schedule: WeakSchedule,
    needed_m: Float[Array, "speed share"],
    speeds_mps: Float[Array, " speed"],
    shares: Float[Array, " share"],
) -> WeakSchedule:
    """A schedule that is nowhere too short: where a speed wants more, its nearer end is raised. Differentiable."""
    held = schedule.look_ahead
    wanted = _MORE * jnp.max(needed_m * shares[None, :] ** schedule.exponent, axis=1)
    ramp = jnp.clip((speeds_mps - held.slow_mps) / (held.fast_mps - held.slow_mps), 0.0, 1.0)
    short, long = held.short_m, held.long_m
    for number in range(len(speeds_mps)):
        near, far = 1.0 - ramp[number], ramp[number]
        more = jnp.maximum(wanted[number] - near * short - far * long, 0.0) / jnp.maximum(near, far)
        short, long = short + jnp.where(near >= far, more, 0.0), long + jnp.where(near >= far, 0.0, more)
    return schedule._replace(look_ahead=held._replace(short_m=short, long_m=jnp.maximum(short, long)))


# Which experiment would narrow the recommended look-ahead most.

EXPERIMENT_S = 30.0


class Experiment(NamedTuple):
    """A drive to make next.

    Attributes:
        what: in words.
        narrows: share by which it is expected to narrow the interval of the look-ahead.
    """

    what: str
    narrows: float


def next_experiments(fit: LoopFit, tuned: TunedOnDraws, draws: Float[Array, "draw number"]) -> tuple[Experiment, ...]:
    """Experiments, the one that would narrow the look-ahead's interval most first.

    The best look-ahead of each draw is regressed on its numbers; an experiment adds its Fisher information at the
    posterior's mean, of a log as noisy as those that there are.
    """
    place = np.asarray(places_of(fit.prior, jnp.asarray(draws)), np.float64)
    place = place[:, np.std(place, axis=0) >= 0.0]
    wanted = np.log(tuned.best_m).mean(axis=1)
    centred = place - place.mean(axis=0)
    covariance = np.cov(centred.T) + 1e-9 * np.eye(len(NAMES))
    slope = np.linalg.lstsq(centred, wanted - wanted.mean(), rcond=None)[0]
    before = float(slope @ covariance @ slope)
    scale = np.maximum(np.median(fit.scale, axis=0), 1e-5)
    memory = np.maximum(np.asarray(fit.posterior.memory, np.float64), 1.0)
    found = []
    for what, command, speed in _experiments(float(tuned.speeds_mps.min()), float(tuned.speeds_mps.max())):
        jacobian = _sensitivity(fit.prior, jnp.asarray(place.mean(axis=0), jnp.float32), command, speed)
        rows = np.asarray(jacobian, np.float64).reshape(2, -1, len(NAMES)) / scale[:, None, None]
        information = np.einsum("osp,osq->pq", rows, rows) / (memory[:, None] * memory[None, :])
        after = float(slope @ np.linalg.inv(np.linalg.inv(covariance) + information) @ slope)
        found.append(Experiment(what, 1.0 - np.sqrt(after / before) if before > 0.0 else 0.0))
    return tuple(sorted(found, key=lambda one: -one.narrows))


def _experiments(slow_mps: float, fast_mps: float) -> list[tuple[str, Float[Array, " step"], float]]:
    time_s = STEP_S * np.arange(round(EXPERIMENT_S / STEP_S))
    steps = 0.2 * np.sign(np.sin(2.0 * np.pi * time_s / 6.0))
    slalom = 0.06 * np.sin(2.0 * np.pi * time_s / 4.0)
    turns = np.interp(time_s, [0.0, 3.0, 12.0, 18.0, 27.0, 30.0], [0.0, 0.05, 0.05, -0.05, -0.05, 0.0])
    return [
        (
            f"steps of the steering command of 11° to both sides, at {slow_mps:g} m/s",
            jnp.asarray(steps, jnp.float32),
            slow_mps,
        ),
        (f"a slalom of 3.5° with a period of 4 s, at {slow_mps:g} m/s", jnp.asarray(slalom, jnp.float32), slow_mps),
        (f"steady turns of 3° to both sides, at {fast_mps:g} m/s", jnp.asarray(turns, jnp.float32), fast_mps),
    ]


@jax.jit
def _sensitivity(
    prior: LoopPrior, place: Float[Array, " number"], command: Float[Array, " step"], speed: Float[Array, ""]
) -> Float[Array, "output step number"]:
    one = jnp.ones_like(command)[None]
    true = one > 0.0
    first = jnp.arange(len(command))[None] == 0
    logs = LoopLogs(
        command_rad=command[None],
        share=one,
        speed_mps=speed * one,
        front_rad=0.0 * one,
        yaw_rate_radps=0.0 * one,
        front_used=true,
        yaw_used=true,
        placed=first,
    )
    slopes: Float[Array, "output step number"] = jnp.stack(
        [part[0] for part in jax.jacfwd(lambda at: loop_model(prior, logs, at))(place)]
    )
    return slopes
