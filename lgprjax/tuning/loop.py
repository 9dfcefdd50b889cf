"""Identification of the steering loop from ordinary drives: servo, rear ratio and yaw gain, and what stays unknown.

Two outputs are compared with the log: the front wheel angle, which the servo makes of its commands, and the yaw rate,
which the chassis makes of that angle and the speed. The vehicle file is the prior: a number that the drives do not show
keeps the file's value and width. The largest rate of the servo is not regular (a drive that never reaches it only says
that it is higher), so the posterior is taken along a grid of rates, with the other numbers conditional on each.

Where the motor stands as commands begin is not known to better than play, noise and commands still under way, and a
servo at its rate's limit carries that on to the end of its turn: each drive's own is found with the numbers, and counts
in their intervals.

Errors of the signals need not be white: the information of a number is divided by the scatter of its score over blocks
of six seconds (Liang and Zeger, 1986), outliers are clipped (Huber, 1964).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.vehicle.actuators import Servo, ServoState, init_servo, servo_pace, turn_servo

NAMES = (
    *("lag_s", "delay_s", "rate_radps", "dead_band_rad", "asymmetry"),
    *("rear_ratio", "slip_s2pm2", "zero_rad", "gyro_late_s"),
)
"""What is fitted; ``slip_s2pm2`` is 1 / V_CHAR², the last two belong to the sensors."""
_DELAY, RATE, ASYMMETRY = (NAMES.index(name) for name in ("delay_s", "rate_radps", "asymmetry"))
RATIO, SLIP = (NAMES.index(name) for name in ("rear_ratio", "slip_s2pm2"))
_ALL = np.arange(len(NAMES))
_CHASSIS = np.arange(RATIO, NAMES.index("zero_rad") + 1)
BY_FACTOR = np.array([name in ("lag_s", "rate_radps") for name in NAMES])
"""Of these numbers, width and place are in the logarithm."""
WIDTH = np.array([0.6, 0.05, 0.45, 0.004, 0.05, 0.2, 0.004, 0.02, 0.06])
"""Standard deviation of each number about the vehicle file's before any drive; of lag and rate in their logarithm."""
STEP_S = 0.02
BLOCK = 300
"""Steps of a block: errors in different blocks are taken as independent. Where their
correlation time is 1.5 s, the variance comes out 25 % too small with blocks of 6 s, and 35 % with blocks of 4 s; longer
blocks leave too few of them."""
PADDING, LANES = 4096, 2
"""Steps and drives are padded to whole multiples of these: few shapes are compiled."""
AROUND_S = 1.0
"""From a step to those whose speed makes the slip: beyond the 0.4 s that the odometer's speeds are taken over."""
_HUBER = 1.345
_LATEST_S = 2.0
"""Delays of the model reach no further, to either side."""
_HALVINGS = 32
_START_RAD = 0.02
"""Standard deviation of where the motor stands as commands begin, about the angle measured there."""
_START_ROUNDS = 5
_ROUNDS = 30
_NODE_ROUNDS = 6
_AT_REST = 1e-3
_LARGEST_DAMPING = 1e5
_NODES, _BEYOND = 13, 4
"""Rates of the grid: within ``_SPAN`` standard errors of the likeliest, and higher, at growing distances."""
_STARTS = np.array([-1.0, -0.2, 0.6])
_SPAN, _PRIOR_SPAN = 4.0, 3.0
REACHED_SHARE = 0.7
"""Of the largest rate: drives that turn the wheels no faster only bound it from below."""
ODOMETER_SHARE = 0.005
"""Standard deviation of the odometer's scale: drives cannot separate it from the rear ratio or slip."""


class LoopPrior(NamedTuple):
    """The vehicle before the drives.

    Attributes:
        value: in the order of ``NAMES``.
        width: standard deviation of each, of lag and rate of their logarithm.
        wheelbase_m, backlash_rad: taken as given.
    """

    value: Float[Array, " number"]
    width: Float[Array, " number"]
    wheelbase_m: Float[Array, ""]
    backlash_rad: Float[Array, ""]


class LoopLogs(NamedTuple):
    """Drives on even steps, padded; leading axis drive.

    Attributes:
        command_rad: holds from each step on.
        share: of the servo's torque, by the supply.
        speed_mps: along the body.
        front_rad, yaw_rate_radps: measured; finite.
        front_used, yaw_used: where they count.
        placed: where the servo stands as the wheels are measured: at the first step, while nothing is commanded, and
            as commands begin.
    """

    command_rad: Float[Array, "drive step"]
    share: Float[Array, "drive step"]
    speed_mps: Float[Array, "drive step"]
    front_rad: Float[Array, "drive step"]
    yaw_rate_radps: Float[Array, "drive step"]
    front_used: Bool[Array, "drive step"]
    yaw_used: Bool[Array, "drive step"]
    placed: Bool[Array, "drive step"]


class LoopPosterior(NamedTuple):
    """Deviation of the numbers from the prior, in units of its width.

    Attributes:
        place: at each rate of the grid; its own place among them.
        weight: of the rates; sums to one.
        root: lower Cholesky factor of the others' covariance at that rate; the rate's row and column are 0.
        scale: of the residuals: front angle and yaw rate of each drive.
        memory: by how many times the score of a number scatters more than white noise would.
        blocks: that the intervals rest on.
        limit_share: of the largest rate, at its likeliest value, that the wheels' model reached in each drive.
        left: step that the chassis' numbers would still take, in standard errors of the one that moves most.
    """

    place: Float[Array, "rate number"]
    weight: Float[Array, " rate"]
    root: Float[Array, "rate number number"]
    scale: Float[Array, "drive 2"]
    memory: Float[Array, " number"]
    blocks: Float[Array, ""]
    limit_share: Float[Array, " drive"]
    left: Float[Array, ""]


def values_of(prior: LoopPrior, place: Float[Array, "*n number"]) -> Float[Array, "*n number"]:
    """Numbers at places in units of the prior's width."""
    value, width, by_factor = (jnp.broadcast_to(part, place.shape) for part in (prior.value, prior.width, BY_FACTOR))
    moved = place * width
    return jnp.where(by_factor, value * jnp.exp(moved), value + moved)


def places_of(prior: LoopPrior, values: Float[Array, "*n number"]) -> Float[Array, "*n number"]:
    """Places of numbers: the inverse of ``values_of``."""
    value, width, by_factor = (jnp.broadcast_to(part, values.shape) for part in (prior.value, prior.width, BY_FACTOR))
    ratio = jnp.where(by_factor, values / jnp.where(by_factor, value, 1.0), 1.0)
    return jnp.where(by_factor, jnp.log(ratio), values - value) / width


def loop_model(
    prior: LoopPrior, logs: LoopLogs, place: Float[Array, " number"], start_rad: float | Float[Array, ""] = 0.0
) -> tuple[Float[Array, "drive step"], Float[Array, "drive step"]]:
    """Front angle as its sensor reads it, and yaw rate without a bias, at every step.

    Args:
        prior: what the numbers are counted from.
        logs: the drives.
        place: of the numbers.
        start_rad: from the angles measured where the servo is placed to where its motor stands.
    """
    lag, delay, rate, dead_band, asymmetry, ratio, slip, zero, late = values_of(prior, place)
    still = jnp.zeros_like(lag)
    servo = Servo(
        lag_s=lag,
        rate_radps=rate,
        delay_s=still,
        dead_band_rad=jnp.maximum(dead_band, 0.0),
        backlash_rad=prior.backlash_rad,
        asymmetry=asymmetry,
        nominal_v=jnp.ones_like(lag),
        stall_v=still,
    )

    def step(state: ServoState, inputs: tuple[Array, Array, Array, Array]) -> tuple[ServoState, Array]:
        command, share, measured, placed = inputs
        wheel = jnp.where(placed, measured, state.wheel_rad)
        # The play hides where the motor stands from the wheels, until they turn.
        motor = jnp.where(placed, measured + start_rad, state.motor_rad)
        placed_state = state._replace(motor_rad=motor, wheel_rad=wheel)
        return turn_servo(placed_state, servo_pace(servo, share, STEP_S), command), wheel

    measured = logs.front_rad.T - zero
    _, wheel = jax.lax.scan(step, init_servo(measured[0]), (logs.command_rad.T, logs.share.T, measured, logs.placed.T))
    wheel = _later(wheel.T, delay)
    # The odometer's noise moves the yaw rate of the model, not the vehicle's. Were slip taken at the same speed, it
    # would be fitted to make the model deaf to that noise, and k with it; a second before and after, it is another.
    around = 0.5 * (_later(logs.speed_mps, AROUND_S) + _later(logs.speed_mps, -AROUND_S))
    gain = 1.0 / (1.0 + slip * around**2)
    yaw_rate = gain * logs.speed_mps * (jnp.tan(wheel) + jnp.tan(ratio * wheel)) / prior.wheelbase_m
    return wheel + zero, _later(yaw_rate, late)


def _later(values: Float[Array, "drive step"], late_s: float | Float[Array, ""]) -> Float[Array, "drive step"]:
    """The same some time later, or earlier where negative; linear between steps, constant beyond the ends."""
    steps, most = values.shape[1], round(_LATEST_S / STEP_S)
    ahead = jnp.clip(-jnp.asarray(late_s, jnp.float32) / STEP_S, -most, most)
    whole = jnp.floor(ahead)
    first = whole.astype(jnp.int32) + most
    # Two slices: fetching each step by its own index takes many times longer.
    padded = jnp.pad(values, ((0, 0), (most, most + 1)), mode="edge")
    low, high = (jax.lax.dynamic_slice_in_dim(padded, at, steps, axis=1) for at in (first, first + 1))
    return low + (ahead - whole) * (high - low)


def _count(used: Bool[Array, "drive step"]) -> Float[Array, " drive"]:
    return jnp.maximum(jnp.sum(used.astype(jnp.float32), axis=-1), 1.0)


class _Looked(NamedTuple):
    """Residuals at a place, their weights and derivatives; columns of ``jacobian`` are numbers."""

    score: Float[Array, "output drive step"]
    pull: Float[Array, "output drive step"]
    inside: Float[Array, "output drive step"]
    jacobian: Float[Array, "output drive step number"]
    scale: Float[Array, "output drive"]
    cost: Float[Array, ""]


def _residuals(
    logs: LoopLogs,
    model: tuple[Float[Array, "drive step"], Float[Array, "drive step"]],
    scale: Float[Array, "output drive"] | None,
) -> tuple[Float[Array, "output drive step"], Float[Array, "output drive"]]:
    """Measured less model over its scale, the gyro's bias taken out; 0 where not used."""
    used = jnp.stack([logs.front_used, logs.yaw_used])
    left = jnp.stack([logs.front_rad, logs.yaw_rate_radps]) - jnp.stack(model)
    left = jnp.where(used, left, 0.0)
    # The bias: a clipped mean of each drive's yaw rates.
    first = _middle(left[1], used[1])
    widest = 2.0 * _spread(left[1], used[1], first)[:, None]
    near = jnp.clip(left[1] - first[:, None], -widest, widest)
    bias = first + jnp.sum(jnp.where(used[1], near, 0.0), axis=-1) / _count(used[1])
    left = jnp.where(used, left - jnp.stack([jnp.zeros_like(bias), bias])[..., None], 0.0)
    if scale is None:
        scale = jnp.stack([_spread(one, of, _middle(one, of)) for one, of in zip(left, used, strict=True)])
    return left / scale[..., None], scale


def _middle(values: Float[Array, "drive step"], used: Bool[Array, "drive step"]) -> Float[Array, " drive"]:
    """Median of each drive, by halving the range that holds it: sorting takes many times longer."""
    wanted = jnp.sum(used, axis=-1) // 2
    least, most = (
        jnp.min(values, axis=-1, where=used, initial=jnp.inf),
        jnp.max(values, axis=-1, where=used, initial=-jnp.inf),
    )

    def halve(_: Int[Array, ""], bounds: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bounds
        middle = 0.5 * (low + high)
        above = jnp.sum(used & (values <= middle[:, None]), axis=-1) > wanted
        return jnp.where(above, low, middle), jnp.where(above, middle, high)

    _, found = jax.lax.fori_loop(0, _HALVINGS, halve, (least, most))
    return jax.lax.stop_gradient(jnp.where(jnp.any(used, axis=-1), found, 0.0))


def _spread(
    values: Float[Array, "drive step"], used: Bool[Array, "drive step"], middle: Float[Array, " drive"]
) -> Float[Array, " drive"]:
    """Median absolute deviation as a standard deviation."""
    return jnp.maximum(1.4826 * _middle(jnp.abs(values - middle[:, None]), used), 1e-5)


def _slopes(
    logs: LoopLogs, slopes: Float[Array, "output drive step number"], scale: Float[Array, "output drive"]
) -> Float[Array, "output drive step number"]:
    """Derivatives of the model as those of its residuals are: over their scale, the gyro's bias taken out."""
    used = jnp.stack([logs.front_used, logs.yaw_used])[..., None]
    slopes = jnp.where(used, slopes / scale[..., None, None], 0.0)
    mean = jnp.sum(slopes[1], axis=1) / _count(logs.yaw_used)[:, None]
    return slopes.at[1].set(jnp.where(used[1], slopes[1] - mean[:, None], 0.0))


def _started(
    score: Float[Array, "output drive step"], start: Float[Array, "output drive step"]
) -> tuple[Float[Array, "output drive step"], Float[Array, ""]]:
    """Residuals with each drive's likeliest start, by Huber's weights, and the cost of all; ``start``: slopes by it."""
    moved = jnp.zeros((1, score.shape[1], 1))
    for _ in range(_START_ROUNDS):
        weight = _HUBER / jnp.maximum(jnp.abs(score - start * moved), _HUBER) * start
        normal = jnp.sum(weight * start, axis=(0, 2), keepdims=True) + _START_RAD**-2.0
        moved = jnp.sum(weight * score, axis=(0, 2), keepdims=True) / normal
    score = score - start * moved
    return score, _huber(score) + 0.5 * jnp.sum((moved / _START_RAD) ** 2)


def _huber(score: Float[Array, "..."]) -> Float[Array, ""]:
    size = jnp.abs(score)
    return jnp.sum(jnp.where(size <= _HUBER, 0.5 * size**2, _HUBER * (size - 0.5 * _HUBER)))


def _look(
    prior: LoopPrior,
    logs: LoopLogs,
    place: Float[Array, " number"],
    scale: Float[Array, "output drive"] | None,
    free: Int[np.ndarray, " free"] = _ALL,
) -> _Looked:
    """At a place, with derivatives by the numbers that are free, each with the starts that go with it."""

    def model(part: Float[Array, " column"]) -> tuple[Array, Array]:
        made = jnp.stack(loop_model(prior, logs, place.at[free].set(part[:-1]), part[-1]))
        return made, made

    slopes, made = jax.jacfwd(model, has_aux=True)(jnp.append(place[free], 0.0))
    score, scale = _residuals(logs, (made[0], made[1]), scale)
    slopes = _slopes(logs, slopes, scale)
    start, slopes = slopes[..., -1], slopes[..., :-1]
    score, cost = _started(score, start)
    inside = jnp.where(jnp.stack([logs.front_used, logs.yaw_used]) & (jnp.abs(score) <= _HUBER), 1.0, 0.0)
    normal = jnp.sum(inside * start**2, axis=(0, 2)) + _START_RAD**-2.0
    along = jnp.einsum("ods,ods,odsp->dp", inside, start, slopes) / normal[:, None]
    slopes = slopes - start[..., None] * along[None, :, None]
    return _Looked(score, jnp.clip(score, -_HUBER, _HUBER), inside, slopes, scale, cost)


def _cost(
    prior: LoopPrior, logs: LoopLogs, place: Float[Array, " number"], scale: Float[Array, "output drive"]
) -> Float[Array, ""]:
    """Of the residuals at a place, with each drive's likeliest start."""
    made, slopes = jax.jvp(
        lambda start: jnp.stack(loop_model(prior, logs, place, start)), (jnp.zeros(()),), (jnp.ones(()),)
    )
    score, _ = _residuals(logs, (made[0], made[1]), scale)
    return _started(score, _slopes(logs, slopes[..., None], scale)[..., 0])[1]


def _solve(
    prior: LoopPrior,
    logs: LoopLogs,
    start: Float[Array, " number"],
    free: Int[np.ndarray, " free"],
    memory: Float[Array, " number"],
    rounds: int,
) -> Float[Array, " number"]:
    """Levenberg-Marquardt of the numbers that are free, until it rests; the prior is a residual like any other.

    Where a score scatters more than white noise would, the drives hold less information on its number, and the prior
    counts for more by the square: so that the place belongs to the interval.
    """
    held = memory**2

    def body(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        place, damping, _, count = carry
        seen = _look(prior, logs, place, None, free)
        weight = jnp.where(seen.score == 0.0, 1.0, seen.pull / jnp.where(seen.score == 0.0, 1.0, seen.score))
        normal = jnp.einsum("ods,odsp,odsq->pq", weight, seen.jacobian, seen.jacobian) + jnp.diag(held[free])
        gradient = jnp.einsum("ods,odsp->p", seen.pull, seen.jacobian) - held[free] * place[free]
        step = jnp.linalg.solve(normal + damping * jnp.diag(jnp.diagonal(normal)), gradient)
        trial = place.at[free].set(jnp.clip(place[free] + jnp.clip(step, -0.7, 0.7), -5.0, 5.0))
        price = _cost(prior, logs, trial, seen.scale)
        better = price + 0.5 * jnp.sum(held * trial**2) < seen.cost + 0.5 * jnp.sum(held * place**2)
        moved = jnp.where(better, jnp.max(jnp.abs(trial - place)), 1.0)
        return jnp.where(better, trial, place), jnp.where(better, 0.2, 6.0) * damping, moved, count + 1

    def restless(carry: tuple[Array, Array, Array, Array]) -> Array:
        _, damping, moved, count = carry
        return (count < rounds) & (moved > _AT_REST) & (damping < _LARGEST_DAMPING)

    begin = (start, jnp.float32(0.01), jnp.float32(1.0), jnp.int32(0))
    found: Float[Array, " number"] = jax.lax.while_loop(restless, body, begin)[0]
    return found


@jax.jit
def identify(prior: LoopPrior, logs: LoopLogs) -> LoopPosterior:
    """The posterior of the numbers from all drives together.

    Starts, and rates of the grid, are solved one after another: each holds derivatives of every step of every drive.
    """
    count = len(NAMES)
    others = jnp.ones(count).at[RATE].set(0.0)
    starts = jnp.zeros((len(_STARTS), count)).at[:, RATE].set(jnp.asarray(_STARTS, jnp.float32))
    solved = jax.lax.map(lambda at: _solve(prior, logs, at, _ALL, jnp.ones(count), _ROUNDS), starts)
    scale = residual_scale(prior, logs, solved[2]).T
    costs = jax.lax.map(lambda at: _cost(prior, logs, at, scale) + 0.5 * jnp.sum(at**2), solved)
    # Times, rate, asymmetry and dead band are not regular and may stop a solution before the chassis' numbers rest.
    best = _solve(prior, logs, solved[jnp.argmin(costs)], _CHASSIS, jnp.ones(count), _ROUNDS)
    seen = _look(prior, logs, best, None)
    memory, blocks = _memory(logs, seen)
    wheel, _ = loop_model(prior, logs, best)
    turning = jnp.abs(jnp.diff(wheel, axis=1)) / STEP_S / logs.share[:, 1:]
    likeliest = values_of(prior, best)
    # Readings that the servo is placed by jump as their noise does.
    turned = logs.front_used & (_later(logs.placed.astype(jnp.float32), likeliest[_DELAY]) == 0.0)
    fastest = jnp.max(jnp.where(turned[:, 1:], turning, 0.0), axis=1)
    reached = jnp.max(fastest) >= REACHED_SHARE * likeliest[RATE]
    sigma = jnp.sqrt(jnp.linalg.inv(_information(seen, memory) + jnp.eye(count))[RATE, RATE])
    # A limit that was touched for some steps is contradicted by a lower one, and by no higher one: standard errors do
    # not say where the likelihood ends.
    near = jnp.minimum(_SPAN * sigma, _PRIOR_SPAN)
    far = jnp.maximum((_PRIOR_SPAN - best[RATE]) / near, 1.5) ** (jnp.arange(1.0, _BEYOND + 1.0) / _BEYOND)
    from_best = near * jnp.concatenate([jnp.linspace(-1.0, 1.0, _NODES), far])
    unseen = jnp.linspace(-_PRIOR_SPAN, _PRIOR_SPAN, _NODES + _BEYOND)
    node = jnp.where(reached, best[RATE] + from_best, unseen)

    def along(rate: Float[Array, ""]) -> tuple[Array, Array, Array, Array, Array]:
        place = _solve(prior, logs, best.at[RATE].set(rate), np.delete(_ALL, RATE), memory, _NODE_ROUNDS)
        place = _solve(prior, logs, place, _CHASSIS, memory, _ROUNDS)
        found = _look(prior, logs, place, seen.scale)
        information = _information(found, memory) * others[:, None] * others[None, :]
        covariance = jnp.linalg.inv(information + jnp.eye(count))
        root = jnp.linalg.cholesky(covariance) * others[:, None]
        # In the chassis' numbers alone: one that is not regular rests where its slope is not 0.
        pull = jnp.einsum("ods,odsp->p", found.pull, found.jacobian) - memory**2 * place
        inner = _information(found, jnp.ones(count)) + jnp.diag(memory**2)
        step = jnp.linalg.solve(inner[np.ix_(_CHASSIS, _CHASSIS)], pull[_CHASSIS])
        left = jnp.max(jnp.abs(step) / jnp.sqrt(jnp.diagonal(covariance)[_CHASSIS]))
        volume = jnp.sum(jnp.log(jnp.diagonal(root) + 1.0 - others))
        cost = found.cost / memory[RATE] ** 2
        return place, root, left, cost, cost + 0.5 * jnp.sum(place**2) - volume

    places, roots, left, cost, price = jax.lax.map(along, node)
    # Drives that do not reach the rate say nothing of higher ones, whatever their noise does. Of lower ones they do: a
    # slower servo had not turned as fast. How fast it turned is the model's, and may be more than the servo did.
    slower = values_of(prior, places)[:, RATE] < jnp.max(fastest)
    price = jnp.where(reached, price, 0.5 * node**2 + jnp.where(slower, jnp.maximum(cost - cost[-1], 0.0), 0.0))
    weight = jax.nn.softmax(jnp.log(jnp.asarray(jnp.gradient(node))) - (price - jnp.min(price)))
    limit = fastest / likeliest[RATE]
    return LoopPosterior(
        place=places,
        weight=weight,
        root=roots,
        scale=seen.scale.T,
        memory=memory,
        blocks=blocks,
        limit_share=limit,
        left=weight @ left,
    )


@jax.jit
def residual_scale(prior: LoopPrior, logs: LoopLogs, place: Float[Array, " number"]) -> Float[Array, "drive 2"]:
    """Robust scale of front angle and yaw rate about the model of a place, each drive by itself."""
    return _residuals(logs, loop_model(prior, logs, place), None)[1].T


def _blocks(values: Float[Array, "output drive step number"]) -> Float[Array, "block number"]:
    """Sums over blocks of a drive; both outputs of a block belong together."""
    drives, steps, count = values.shape[1:]
    missing = -steps % BLOCK
    padded = jnp.pad(jnp.sum(values, axis=0), ((0, 0), (0, missing), (0, 0)))
    return jnp.sum(padded.reshape(drives, -1, BLOCK, count), axis=2).reshape(-1, count)


def _memory(logs: LoopLogs, seen: _Looked) -> tuple[Float[Array, " number"], Float[Array, ""]]:
    """Scatter of each number's score over its expectation for white noise of Huber's kind, and the blocks with data.

    A number that few blocks show has left nothing of its score in them: what it would scatter by comes the more from
    the correlations of the signals' errors, which all of the drive shows.
    """
    scores = _blocks(seen.pull[..., None] * seen.jacobian)
    used = jnp.stack([logs.front_used, logs.yaw_used]).astype(jnp.float32)
    blocks = jnp.sum(_blocks(used[..., None])[:, 0] > 0.25 * BLOCK).astype(jnp.float32)
    parts = _blocks(seen.inside[..., None] * seen.jacobian**2)
    bread = jnp.maximum(jnp.sum(parts, axis=0), 1e-6)
    ratio = jnp.sum(scores**2, axis=0) * blocks / jnp.maximum(blocks - len(NAMES), 1.0) / bread
    errors = _correlations(seen.pull) / jnp.maximum(jnp.sum(used, axis=2, keepdims=True), 1.0)
    taper = jnp.linspace(2.0, 0.0, BLOCK + 1)[:-1].at[0].set(1.0)
    alike = jnp.einsum("odl,odlp,l->p", errors, _correlations(seen.jacobian), taper) / bread
    alike = jnp.maximum(alike, 1.0)
    shown = bread**2 / jnp.maximum(jnp.sum(parts**2, axis=0), 1e-12) - 1.0
    less = alike + (ratio - alike) * shown / (shown + 20.0)
    return jnp.sqrt(jnp.where(ratio < alike, less, ratio)), blocks


def _correlations(values: Float[Array, "output drive step *number"]) -> Float[Array, "output drive lag *number"]:
    """Sums of products of values with those some steps later, up to the length of a block."""
    size = 1 << (values.shape[2] + BLOCK - 1).bit_length()
    spectrum = jnp.abs(jnp.fft.rfft(values, size, axis=2)) ** 2
    return jnp.fft.irfft(spectrum, size, axis=2)[:, :, :BLOCK]


def _information(seen: _Looked, memory: Float[Array, " number"]) -> Float[Array, "number number"]:
    bread = jnp.einsum("ods,odsp,odsq->pq", seen.inside, seen.jacobian, seen.jacobian)
    return bread / (memory[:, None] * memory[None, :])


@partial(jax.jit, static_argnames="count")
def draw_loops(
    prior: LoopPrior, posterior: LoopPosterior, key: PRNGKeyArray, *, count: int
) -> Float[Array, "draw number"]:
    """Numbers drawn from the posterior; none is negative that cannot be."""
    first, second, third = jax.random.split(key, 3)
    rate = posterior.place[:, RATE]
    share = jnp.cumsum(posterior.weight)
    # Between the middles of neighbouring rates, evenly.
    at = jnp.interp(
        jax.random.uniform(first, (count,)), share - 0.5 * posterior.weight, jnp.arange(len(rate), dtype=jnp.float32)
    )
    below = jnp.clip(jnp.floor(at), 0.0, len(rate) - 2.0)
    index, part = below.astype(jnp.int32), (at - below)[:, None]
    middle = (1.0 - part) * posterior.place[index] + part * posterior.place[index + 1]
    nearest = jnp.where(part[:, 0] > 0.5, index + 1, index)
    normal = jax.random.normal(second, (count, len(NAMES)))
    freedom = jnp.maximum(posterior.blocks - len(NAMES), 3.0)
    wider = jnp.sqrt(freedom / (2.0 * jax.random.gamma(third, 0.5 * freedom, (count, 1))))
    place = middle + jnp.einsum("dpq,dq->dp", posterior.root[nearest], normal) * wider
    values = values_of(prior, place)
    scale = ODOMETER_SHARE * jax.random.normal(jax.random.fold_in(third, 1), (count,))
    values = values.at[:, RATIO].add(scale * (1.0 + values[:, RATIO]))
    values = values.at[:, SLIP].multiply((1.0 + scale) ** 2)
    least = jnp.asarray([[1e-3, 0.0, 1e-3, 0.0, -0.5, 0.0, 0.0, -1.0, -1.0]], jnp.float32)
    return jnp.maximum(values, least)
