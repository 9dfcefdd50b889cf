"""What a look-ahead is judged by: error and oscillation over courses, offsets and speeds, and the margin it leaves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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
class Trials:
    """Courses, and what is driven on each: every speed from every offset. Compiled in: one object, one compile.

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


class Judged(NamedTuple):
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


def judge(vehicle: TunedVehicle, trials: Trials, schedule: LookAhead) -> Judged:
    """Drive all trials with a look-ahead, or with many: fields of ``schedule`` are scalars or one value a look-ahead.

    Differentiable in the schedule but for ``cycle_m``.
    """
    looks = jnp.shape(schedule.short_m)
    speed = jnp.asarray(trials.speeds_mps, jnp.float32)
    offset = jnp.asarray(trials.offsets_m, jnp.float32)
    shape = (*looks, len(speed), len(offset))

    def over(values: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
        """Values along one axis of the lanes, as lanes; a scalar serves all."""
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
    return Judged(
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


def sweep_look_ahead(vehicle: TunedVehicle, trials: Trials, look_ahead_m: Sequence[float]) -> Judged:
    """The sweep surface (LL figs. 20, 21): every look-ahead at every speed, each the same at all speeds."""
    length = jnp.asarray(look_ahead_m, jnp.float32)
    zero = jnp.zeros_like(length)
    return judge(vehicle, trials, LookAhead(length, length, zero, zero))
