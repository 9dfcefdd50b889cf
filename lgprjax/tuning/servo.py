"""Identification of the steering servo: lag, delay, dead band and rate from commands and measured wheel angles.

The differentiable model is fitted by Levenberg-Marquardt from several starts, with Huber weights; the particle swarm
searches the same box for the same cost without a derivative. Where both end at the same place it is the best one.
Play at the wheels and dead band of the motor look much alike in a log: the play is taken as given, from the encoder's
calibration.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.pso import SwarmConfig, run_swarm
from lgprjax.tuning.arcs import serial_memory
from lgprjax.tuning.robust import Estimate, NotExcitedError, estimate
from lgprjax.vehicle.actuators import Servo, ServoState, init_servo, step_servo, torque_share
from lgprjax.vehicle.sensors import DriveSignals

# A log of the servo as its model sees it, and the model's wheel angle as a function of the numbers sought.

NAMES = ("lag_s", "delay_s", "dead_band_rad", "rate_radps", "asymmetry", "zero_rad")
"""Fitted parameters: of the servo, and the wheel angle sensor's reading with straight wheels."""
LOW = np.array([0.003, 0.0, 0.0, 0.02, -0.5, -0.1])
HIGH = np.array([1.5, 0.5, 0.1, 5.0, 0.5, 0.1])
_BY_FACTOR = np.array([True, False, False, True, False, False])
STEP_S = 0.01
_LEAST_S = 5.0
_SETTLING_S = 2.0
_LONGEST_GAP_S = 0.2


class ServoLog(NamedTuple):
    """Commands on the model's steps, and where the records lie between them.

    Attributes:
        servo: known properties: play, and the remaining torque.
        command_rad, share: what holds from each step on.
        at: steps from the first to each record.
        used: records that count: not those for which the model does not know the state.
        start_rad: of the wheels.
    """

    servo: Servo
    command_rad: Float[Array, " step"]
    share: Float[Array, " step"]
    at: Float[Array, " record"]
    used: Bool[Array, " record"]
    start_rad: Float[Array, ""]


def servo_log(signals: DriveSignals, measured_rad: Float[np.ndarray, " record"], servo: Servo) -> ServoLog:
    """A command holds from its record to the next, and through a gap; data after a gap do not count.

    Args:
        signals: with commands and, where the servo's torque depends on it, the supply.
        measured_rad: front wheel angle of every record.
        servo: its play and voltages.

    Raises:
        NotExcitedError: commands are missing or hardly vary, or the log is too short.
    """
    if signals.command_rad is None:
        raise NotExcitedError("servo", "steering commands", "none in the log")
    known = np.isfinite(signals.command_rad) & np.isfinite(signals.time_s)
    time_s, command = signals.time_s[known], signals.command_rad[known]
    if len(time_s) < 50 or time_s[-1] - time_s[0] < _LEAST_S:
        raise NotExcitedError("servo", f"{_LEAST_S:g} s of commands, 50 of them", f"{len(time_s)} commands")
    if np.ptp(command) < 0.02:
        raise NotExcitedError("servo", "commands over 0.02 rad or more", f"over {np.ptp(command):.4f} rad")
    steps = int(np.ceil((time_s[-1] - time_s[0]) / STEP_S)) + 1
    step_time_s = time_s[0] + STEP_S * np.arange(steps)
    held = np.searchsorted(time_s, step_time_s + 1e-6, side="right") - 1
    share = np.ones(len(time_s))
    if signals.supply_v is not None:
        share = np.asarray(torque_share(servo, jnp.asarray(signals.supply_v[known], jnp.float32)), np.float64)
    at = np.clip((signals.time_s - time_s[0]) / STEP_S, 0.0, steps - 1.0)
    gaps = np.flatnonzero(np.diff(time_s) > _LONGEST_GAP_S)
    settled = signals.time_s > time_s[0] + 0.25 * _SETTLING_S
    for gap in gaps:
        settled &= (signals.time_s <= time_s[gap]) | (signals.time_s > time_s[gap + 1] + _SETTLING_S)
    used = settled & np.isfinite(measured_rad)
    if used.sum() < 50:
        raise NotExcitedError("servo", "50 wheel angles or more between gaps", f"{used.sum()}")
    first = measured_rad[np.isfinite(measured_rad)][:5]
    return ServoLog(
        servo,
        jnp.asarray(command[held], jnp.float32),
        jnp.asarray(share[held], jnp.float32),
        jnp.asarray(at, jnp.float32),
        jnp.asarray(used),
        jnp.float32(np.median(first)),
    )


def from_box(u: Float[Array, "6"]) -> Float[Array, "6"]:
    """The numbers at a place in the box [-1, 1]: lag and rate by factors, the others evenly."""
    low, high = jnp.asarray(LOW, jnp.float32), jnp.asarray(HIGH, jnp.float32)
    share = 0.5 * (u + 1.0)
    ratio = jnp.where(_BY_FACTOR, high / jnp.where(_BY_FACTOR, low, 1.0), 1.0)
    return jnp.where(_BY_FACTOR, low * ratio**share, low + share * (high - low))


def to_box(value: Float[np.ndarray, "*lane 6"]) -> Float[np.ndarray, "*lane 6"]:
    """The place of numbers in the box."""
    factor = np.log(np.where(_BY_FACTOR, value / np.where(_BY_FACTOR, LOW, 1.0), 1.0)) / np.log(
        np.where(_BY_FACTOR, HIGH / np.where(_BY_FACTOR, LOW, 1.0), 2.0)
    )
    return np.asarray(2.0 * np.where(_BY_FACTOR, factor, (value - LOW) / (HIGH - LOW)) - 1.0)


def per_box(u: Float[np.ndarray, "*lane 6"]) -> Float[np.ndarray, "*lane 6"]:
    """Derivative of the numbers by the place in the box."""
    share = 0.5 * (u + 1.0)
    ratio = np.where(_BY_FACTOR, HIGH / np.where(_BY_FACTOR, LOW, 1.0), 2.0)
    return np.asarray(0.5 * np.where(_BY_FACTOR, LOW * ratio**share * np.log(ratio), HIGH - LOW))


def wheel_angles(log: ServoLog, u: Float[Array, "6"]) -> Float[Array, " record"]:
    """Modelled sensor readings at the records, for parameters at a place in the box.

    A servo that hears its commands late does all that it does late: the delay is taken of the angles, between steps
    too. Blended commands, at the rate's limit, would hide what part of a step it is.
    """
    lag, delay, dead_band, rate, asymmetry, zero = from_box(u)
    servo = log.servo._replace(
        lag_s=lag, rate_radps=rate, delay_s=jnp.zeros_like(lag), dead_band_rad=dead_band, asymmetry=asymmetry
    )

    def step(state: ServoState, inputs: tuple[Array, Array]) -> tuple[ServoState, Array]:
        return step_servo(state, servo, inputs[0], inputs[1], STEP_S), state.wheel_rad

    _, wheel = jax.lax.scan(step, init_servo(log.start_rad - zero), (log.command_rad, log.share))
    at = jnp.clip(log.at - delay / STEP_S, 0.0, len(wheel) - 1.0)
    before = jnp.clip(jnp.floor(at), 0.0, len(wheel) - 2.0)
    index = before.astype(jnp.int32)
    low, high = wheel[index], wheel[index + 1]
    angles: Float[Array, " record"] = low + (at - before) * (high - low) + zero
    return angles


_HUBER = 1.345
_ROUNDS = 30
_SWARM = SwarmConfig(particles=48, iterations=300)
_STARTS = np.array(
    [[lag, delay, 0.003, rate, 0.0, 0.0] for lag in (0.05, 0.3) for delay in (0.02, 0.15) for rate in (0.2, 1.5)]
)
_SHOWN_BY = {
    "lag_s": "quick steps of the command, recorded ten times a second or more",
    "delay_s": "quick steps of the command, recorded ten times a second or more",
    "dead_band_rad": "small steps of the command and a slow sweep",
    "rate_radps": "larger steps of the command, such that the wheels turn as fast as they can",
    "asymmetry": "larger steps of the command to both sides, such that the wheels turn as fast as they can",
}
"""What to drive for a number that makes no difference to a log."""
_AGREE = 1.0
_FOLLOWS = 0.2
"""Standard errors that swarm and gradient may lie apart, and the share of the angles' spread that the model may leave
unexplained in a wheel that follows at all."""


class ServoSolution(NamedTuple):
    """Where the search by gradient ended.

    Attributes:
        u: place in the box.
        value: the numbers there.
        cost: Huber's, of the residuals over their scale.
        scale_rad: robust scale of the residuals.
        residual_rad: measured less model.
        jacobian: derivative of the model's angle by the place in the box.
    """

    u: Float[Array, "6"]
    value: Float[Array, "6"]
    cost: Float[Array, ""]
    scale_rad: Float[Array, ""]
    residual_rad: Float[Array, " record"]
    jacobian: Float[Array, "record 6"]


class ServoFit(NamedTuple):
    """The servo of a log.

    Attributes:
        lag_s, delay_s, dead_band_rad, rate_radps, asymmetry: as in ``Servo``.
        zero_rad: reading of the wheel angle sensor with the wheels straight.
        servo: with the values found, and play and voltages as given.
        swarm: what the particle swarm found, in the order of the six numbers above.
        apart: largest difference of the swarm's numbers from those by gradient, in standard errors.
        agree: whether that is below one.
        model_rad: wheel angle of the fitted servo at every record.
        scale_rad: noise of the measured angle about it.
        memory: records that stand for one, residuals being serially correlated; 1 for white noise. It is in the
            intervals; far above 1 it says that the servo is not as the model.
    """

    lag_s: Estimate
    delay_s: Estimate
    dead_band_rad: Estimate
    rate_radps: Estimate
    asymmetry: Estimate
    zero_rad: Estimate
    servo: Servo
    swarm: Float[np.ndarray, "6"]
    apart: float
    agree: bool
    model_rad: Float[np.ndarray, " record"]
    scale_rad: float
    memory: float


def fit_servo(signals: DriveSignals, measured_rad: Float[np.ndarray, " record"], given: Servo) -> ServoFit:
    """Fit the servo's numbers.

    Args:
        signals: with commands: steps of several sizes, large ones so that the rate shows, and sweeps.
        measured_rad: front wheel angle of every record: by its sensor, or by the steering map from the potentiometer.
        given: play and voltages of the servo; its other numbers are not looked at.

    Raises:
        NotExcitedError: commands are missing, too short or too small, the wheels do not follow them, or one of the
            numbers makes no difference to the log.
    """
    log = servo_log(signals, measured_rad, given)
    measured = jnp.asarray(np.where(np.isfinite(measured_rad), measured_rad, 0.0), jnp.float32)
    solved = jax.vmap(lambda u: solve_servo(log, measured, u, rounds=_ROUNDS))(
        jnp.asarray(to_box(_STARTS), jnp.float32)
    )
    best = jax.tree.map(lambda leaf: leaf[int(np.nanargmin(np.asarray(solved.cost * solved.scale_rad**2)))], solved)
    used = np.asarray(log.used)
    spread = float(np.std(measured_rad[used]))
    if not float(best.scale_rad) < _FOLLOWS * spread:
        found = f"one that leaves {float(best.scale_rad):.3f} of {spread:.3f} rad unexplained"
        raise NotExcitedError("servo", "a wheel angle that follows the commands", found)
    estimates, memory = servo_estimates(best, used)
    swarm = np.asarray(from_box(_search(log, measured, best.scale_rad)), np.float64)
    apart = max(abs(swarm[n] - found.value) / found.sigma for n, found in enumerate(estimates))
    values = [jnp.float32(found.value) for found in estimates[:5]]
    lag, delay, dead_band, rate, asymmetry, zero = estimates
    return ServoFit(
        lag_s=lag,
        delay_s=delay,
        dead_band_rad=dead_band,
        rate_radps=rate,
        asymmetry=asymmetry,
        zero_rad=zero,
        servo=given._replace(**dict(zip(NAMES[:5], values, strict=True))),
        swarm=swarm,
        apart=apart,
        agree=apart < _AGREE,
        model_rad=np.asarray(jax.jit(wheel_angles)(log, best.u), np.float64),
        scale_rad=float(best.scale_rad),
        memory=memory,
    )


def servo_estimates(solved: ServoSolution, used: Bool[np.ndarray, " record"]) -> tuple[list[Estimate], float]:
    """The six numbers with their intervals, and the memory of the residuals.

    Raises:
        NotExcitedError: one of the numbers makes no difference.
    """
    u, scale = np.asarray(solved.u, np.float64), float(solved.scale_rad)
    jacobian, residual = (
        np.asarray(solved.jacobian, np.float64)[used],
        np.asarray(solved.residual_rad, np.float64)[used],
    )
    for name, size in zip(NAMES, np.linalg.norm(jacobian, axis=0), strict=True):
        if size < 3.0 * scale:
            raise NotExcitedError("servo", _SHOWN_BY.get(name, "wheels that turn"), f"no wheel angle shows its {name}")
    clipped = np.clip(residual, -_HUBER * scale, _HUBER * scale)
    inside = float(np.mean(np.abs(residual) <= _HUBER * scale))
    memory = serial_memory((clipped / scale)[None], np.ones((1, len(clipped)), dtype=bool), len(u))
    variance = memory * float(np.sum(clipped**2)) / (len(clipped) - len(u)) / inside**2
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    sigma = np.sqrt(np.diag(covariance)) * per_box(u)
    values = np.asarray(solved.value, np.float64)
    raw = [estimate(float(v), float(s), len(clipped) / memory - len(u)) for v, s in zip(values, sigma, strict=True)]
    return [
        e._replace(low=max(e.low, lo), high=min(e.high, hi)) for e, lo, hi in zip(raw, LOW, HIGH, strict=True)
    ], memory


@partial(jax.jit, static_argnames="rounds")
def solve_servo(
    log: ServoLog, measured_rad: Float[Array, " record"], start: Float[Array, "6"], *, rounds: int
) -> ServoSolution:
    """Levenberg-Marquardt from one start within the box; the damping falls with every step that gains."""

    def look(u: Float[Array, "6"]) -> tuple[Array, Array]:
        residual = jnp.where(log.used, measured_rad - wheel_angles(log, u), 0.0)
        return residual, _scale(residual, log)

    def body(_: Int[Array, ""], carry: tuple[Array, Array]) -> tuple[Array, Array]:
        u, damping = carry
        residual, scale = look(u)
        jacobian = jnp.where(log.used[:, None], jax.jacfwd(lambda at: wheel_angles(log, at))(u), 0.0)
        weight = jnp.minimum(1.0, _HUBER * scale / jnp.maximum(jnp.abs(residual), 1e-12))
        normal = (jacobian * weight[:, None]).T @ jacobian
        size = jnp.diagonal(normal) + 1e-9
        step = jnp.linalg.solve(normal + damping * jnp.diag(size), jacobian.T @ (weight * residual))
        trial = jnp.clip(u + jnp.clip(step, -0.5, 0.5), -1.0, 1.0)
        better = _cost(look(trial)[0], scale) < _cost(residual, scale)
        return jnp.where(better, trial, u), jnp.where(better, 0.2, 5.0) * damping

    u, _ = jax.lax.fori_loop(0, rounds, body, (start, jnp.float32(0.01)))
    residual, scale = look(u)
    jacobian = jax.jacfwd(lambda at: wheel_angles(log, at))(u)
    return ServoSolution(u, from_box(u), _cost(residual, scale), scale, residual, jacobian)


@jax.jit
def _search(log: ServoLog, measured_rad: Float[Array, " record"], scale_rad: Float[Array, ""]) -> Float[Array, "6"]:
    """Best place of the box by particle swarm, for the cost of residuals of this scale."""
    first, second = jax.random.split(jax.random.key(0))
    cloud = jax.random.uniform(first, (_SWARM.particles, len(NAMES)), minval=-1.0, maxval=1.0)

    def score(u: Float[Array, "particle 6"]) -> Float[Array, " particle"]:
        angles = jax.vmap(lambda at: wheel_angles(log, at))(u)
        residual = jnp.where(log.used[None], measured_rad[None] - angles, 0.0)
        return -jax.vmap(lambda row: _cost(row, scale_rad))(residual)

    return run_swarm(second, cloud, score, jnp.ones(len(NAMES), dtype=bool), config=_SWARM).position


def _cost(residual_rad: Float[Array, " record"], scale_rad: Float[Array, ""]) -> Float[Array, ""]:
    score = jnp.abs(residual_rad) / scale_rad
    return jnp.sum(jnp.where(score <= _HUBER, 0.5 * score * score, _HUBER * (score - 0.5 * _HUBER)))


def _scale(residual_rad: Float[Array, " record"], log: ServoLog) -> Float[Array, ""]:
    """Median absolute residual of the records used, as a standard deviation."""
    ordered = jnp.sort(jnp.where(log.used, jnp.abs(residual_rad), jnp.inf))
    count = jnp.sum(log.used)
    return jnp.maximum(1.4826 * 0.5 * (ordered[(count - 1) // 2] + ordered[count // 2]), 1e-6)
