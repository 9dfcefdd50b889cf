"""The compiled part of a commanded manoeuvre: the limiter, which follows the wheels while nothing is engaged."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.autopilot.limiter import Command, LimiterRules, LimiterState, init_limiter, limit_command

# Assumed, while the vehicle's own are open.
_RULES = LimiterRules(
    largest_front_rad=jnp.float32(0.0),
    # Faster than any servo of a heavy vehicle, so that its own rate shows.
    front_rate_radps=jnp.float32(2.0),
    throttle_rate_per_s=jnp.float32(1.0),
    brake_rate_per_s=jnp.float32(4.0),
    oldest_s=jnp.float32(0.2),
    default_brake=jnp.float32(0.5),
    release_rate_radps=jnp.float32(0.1),
)


class ManoeuvreNumbers(NamedTuple):
    """Numbers of a tick.

    Attributes:
        front_rad, throttle, brake: wanted.
        age_s: of the box's status behind them.
        step_s: since the last tick.
        measured_rad: of the front wheels; NaN if unknown.
        engaged: 1 while the computer steers, else 0.
        largest_rad: of a command to either side.
    """

    front_rad: float
    throttle: float
    brake: float
    age_s: float
    step_s: float
    measured_rad: float
    engaged: float
    largest_rad: float


@jax.jit
def step_manoeuvre(
    state: LimiterState, numbers: Float[Array, " number"]
) -> tuple[LimiterState, Float[Array, " result"]]:
    """State, and front angle, throttle, brake and what was done to them as bits of ``Limited``.

    Args:
        state: of the last tick.
        numbers: ``ManoeuvreNumbers`` as a vector.
    """
    told: Any = ManoeuvreNumbers(*numbers)
    measured = jnp.where(jnp.isfinite(told.measured_rad), told.measured_rad, 0.0)
    held = jax.tree.map(lambda on, off: jnp.where(told.engaged > 0.5, on, off), state, init_limiter(measured))
    wanted = Command(jnp.where(told.engaged > 0.5, told.front_rad, measured), told.throttle, told.brake)
    rules = _RULES._replace(largest_front_rad=jnp.where(told.engaged > 0.5, told.largest_rad, jnp.inf))
    state, command, bits = limit_command(rules, held, wanted, told.age_s, told.step_s)
    return state, jnp.stack([*command, bits.astype(jnp.float32)])
