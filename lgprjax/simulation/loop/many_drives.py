"""Closed loops with fixes from an error model: thousands of drives at once, compiled whole."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Key, PRNGKeyArray

from lgprjax.navigation import LgprObservation, RoutePath
from lgprjax.scene import FixErrors, FixErrorState, SensorFaults, during, step_fix_errors
from lgprjax.simulation.loop.closed_loop import LoopSums, LoopTick, add_tick, decide, move, tick_record
from lgprjax.simulation.loop.loop_setup import LoopSetup, LoopSpec, LoopState


@partial(jax.jit, static_argnums=(0, 8), static_argnames="traced")
def run_lane(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    errors: FixErrors,
    state: LoopState,
    fix_state: FixErrorState,
    sums: LoopSums,
    key: PRNGKeyArray,
    ticks: int,
    *,
    traced: bool = False,
) -> tuple[LoopState, FixErrorState, LoopSums, LoopTick | None]:
    """Simulate ``ticks`` ticks of one drive."""
    element = partial(_tick, spec, setup, route, errors, traced=traced)
    numbers = jnp.arange(ticks)
    (state, fix_state, sums), trace = lax.scan(
        lambda carried, number: element(*carried, jax.random.fold_in(key, number)), (state, fix_state, sums), numbers
    )
    return state, fix_state, sums, trace


@partial(jax.jit, static_argnums=(0, 8))
def run_lanes(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    errors: FixErrors,
    state: LoopState,
    fix_state: FixErrorState,
    sums: LoopSums,
    keys: Key[Array, " drive"],
    ticks: int,
) -> tuple[LoopState, FixErrorState, LoopSums]:
    """The same for many drives: states, sums and keys have a leading axis, setup, route and errors are theirs all."""

    def one(
        state: LoopState, fix_state: FixErrorState, sums: LoopSums, key: PRNGKeyArray
    ) -> tuple[LoopState, FixErrorState, LoopSums]:
        ended, fixes, grown, _ = run_lane(spec, setup, route, errors, state, fix_state, sums, key, ticks)
        return ended, fixes, grown

    drives: tuple[LoopState, FixErrorState, LoopSums] = jax.vmap(one)(state, fix_state, sums, keys)
    return drives


def _tick(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    errors: FixErrors,
    state: LoopState,
    fix_state: FixErrorState,
    sums: LoopSums,
    key: PRNGKeyArray,
    *,
    traced: bool = False,
) -> tuple[tuple[LoopState, FixErrorState, LoopSums], LoopTick | None]:
    sensor_key, fix_key = jax.random.split(key)
    before = state
    state, readings = move(spec, setup, state, sensor_key)
    way_m = state.plant.travel_m - before.plant.travel_m
    fix_state, error = step_fix_errors(errors, fix_state, fix_key, way_m)
    time_s = state.tick.astype(jnp.float32) * spec.tick_s
    lgpr, p_false = draw_fix(setup, errors, fix_state, error, state, time_s)
    state, decision = decide(spec, setup, route, state, readings, lgpr, p_false)
    tick = tick_record(setup, route, state, decision, lgpr)
    sums = add_tick(sums, tick, state, before, way_m)
    return (state, fix_state, sums), (tick if traced else None)


def draw_fix(
    setup: LoopSetup,
    errors: FixErrors,
    fix_state: FixErrorState,
    error: Float[Array, "3"],
    state: LoopState,
    time_s: Float[Array, ""],
) -> tuple[LgprObservation, Float[Array, ""]]:
    """A fix of this tick with its error, faults included, and the probability that its match is false."""
    pose, faults = state.plant.pose, setup.faults
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    wrong = _wrong_place(faults, time_s)
    x = pose.x_m + cos * (setup.navigator.model.array_x_m + error[0]) - sin * error[1] + wrong[0]
    y = pose.y_m + sin * (setup.navigator.model.array_x_m + error[0]) + cos * error[1] + wrong[1]
    along, cross, yaw = (sigma * sigma for sigma in errors.reported_sigma)
    covariance = jnp.stack(
        [
            jnp.stack([cos * cos * along + sin * sin * cross, cos * sin * (along - cross), jnp.zeros_like(yaw)]),
            jnp.stack([cos * sin * (along - cross), sin * sin * along + cos * cos * cross, jnp.zeros_like(yaw)]),
            jnp.stack([jnp.zeros_like(yaw), jnp.zeros_like(yaw), yaw]),
        ]
    )
    lost = during(faults.lgpr_lost_s, time_s)
    fade = jnp.where(during(faults.lgpr_faded_s, time_s), faults.lgpr_faded, 1.0)
    # The tail of a noise floor falls with the square of the strength; where the ground gives no fix, the best match is
    # no better than chance.
    p_false = jnp.where(fix_state.found, errors.p_false ** (fade * fade), 1.0)
    valid = fix_state.found & ~lost & (p_false <= setup.navigator.health.risk)
    zero = jnp.float32(0.0)
    return LgprObservation(x, y, pose.yaw_rad + error[2], covariance, zero, valid), jnp.where(lost, jnp.nan, p_false)


def _wrong_place(faults: SensorFaults, time_s: Float[Array, ""]) -> Float[Array, "2"]:
    return jnp.where(during(faults.lgpr_wrong_s, time_s), faults.lgpr_wrong_m, 0.0)
