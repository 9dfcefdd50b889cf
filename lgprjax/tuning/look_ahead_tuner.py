"""A look-ahead over speed, found by gradient under the limit that the steering's lag and delay set."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from lgprjax.tuning.look_ahead_trials import Judged, Trials, TunedVehicle, judge, margins, sweep_look_ahead
from lgprjax.vehicle import LookAhead

_PENALTY_M = 20.0
"""Cost of a radian of missing phase margin: steep beside any error that is to be gained by it."""

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
    judged: Judged
    cost_m: float
    history_m: Float[np.ndarray, " step"]


class _Shape(NamedTuple):
    """A schedule in numbers without limits: logarithms of the short length, of what the long one has more, of the slow
    speed and of the span to the fast one."""

    short: Float[Array, "..."]
    more: Float[Array, "..."]
    slow: Float[Array, "..."]
    span: Float[Array, "..."]


def tune_look_ahead(vehicle: TunedVehicle, trials: Trials, config: GradientConfig = _USUAL) -> TunedLookAhead:
    """Least mean cost over the trials' speeds, with the phase margin asked for at each of them.

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


def cost_of(vehicle: TunedVehicle, trials: Trials, schedule: LookAhead) -> Float[Array, "..."]:
    """Mean cost over the speeds; infinite where a margin is missing. What a brute-force search compares."""
    judged = judge(vehicle, trials, schedule)
    enough = jnp.all(judged.margin_rad >= trials.least_margin_rad, axis=-1)
    return jnp.where(enough, jnp.mean(judged.cost_m, axis=-1), jnp.inf)


def schedule_of(shape: _Shape) -> LookAhead:
    """The look-ahead of free numbers."""
    short, slow = jnp.exp(shape.short), jnp.exp(shape.slow)
    return LookAhead(short, short + jnp.exp(shape.more), slow, slow + jnp.exp(shape.span))


@partial(jax.jit, static_argnums=0)
def _slope(trials: Trials, vehicle: TunedVehicle, shape: _Shape) -> tuple[Float[Array, ""], _Shape]:
    """Cost with the penalty, and its gradient."""
    return jax.value_and_grad(lambda free: _penalised(vehicle, trials, free))(shape)


def _penalised(vehicle: TunedVehicle, trials: Trials, shape: _Shape) -> Float[Array, ""]:
    judged = judge(vehicle, trials, schedule_of(shape))
    missing = jnp.maximum(trials.least_margin_rad - judged.margin_rad, 0.0)
    return jnp.mean(judged.cost_m) + _PENALTY_M * jnp.mean(missing)


def _first(vehicle: TunedVehicle, trials: Trials) -> _Shape:
    """Least cost at each speed of a coarse sweep, as a schedule from the slowest speed to the fastest."""
    swept = sweep_look_ahead(vehicle, trials, _FIRST_M.tolist())
    enough = np.asarray(swept.margin_rad) >= trials.least_margin_rad
    speeds = np.asarray(trials.speeds_mps)
    if not enough.any(axis=0).all():
        none = ", ".join(f"{v:g}" for v in speeds[~enough.any(axis=0)])
        raise ValueError(f"at {none} m/s no look-ahead up to {_FIRST_M[-1]:g} m leaves the phase margin asked for")
    best = _FIRST_M[np.argmin(np.where(enough, np.asarray(swept.cost_m), np.inf), axis=0)]
    slowest, fastest = int(np.argmin(speeds)), int(np.argmax(speeds))
    short, long = best[slowest], max(best[fastest], 1.05 * best[slowest])
    numbers = (short, long - short, speeds[slowest], speeds[fastest] - speeds[slowest])
    return _Shape(*(jnp.float32(np.log(number)) for number in numbers))


def _long_enough(vehicle: TunedVehicle, trials: Trials, schedule: LookAhead) -> LookAhead:
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
        raise ValueError("no multiple of the look-ahead leaves the phase margin asked for")
    first = int(np.argmax(enough))
    return LookAhead(*(field[first] for field in longer))
