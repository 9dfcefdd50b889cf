"""The skid-steer vehicle as it is: hydraulics that are late, a control threshold, sides that slip, turns that slide."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from lgprjax.vehicle.arc import VehiclePose
from lgprjax.vehicle.control_threshold import obeyed_wheels
from lgprjax.vehicle.skid_steer import WheelSpeeds, body_rates, drive_skid_arc


class SkidPlant(NamedTuple):
    """A vehicle. Fields are float32 scalars or one value a lane.

    Attributes:
        track_m: effective, of this ground.
        delay_s: from a command to its first effect; lag_s: time constant of a side's speed after that.
        threshold_mps: difference of the commanded wheels below which it does not turn; 0 obeys everything.
        slip_sigma, slip_m: of either side: the ground passes by less than the wheel turns, by a share that is a
            Gauss-Markov process over the side's way.
        slide_m: the point that does not move aside in a turn stands so far before the track's midpoint.
        wander: random walk of the heading, rad/√m; along, aside: of the position, m/√m: stones and ruts.
    """

    track_m: Float[Array, "..."]
    delay_s: Float[Array, "..."]
    lag_s: Float[Array, "..."]
    threshold_mps: Float[Array, "..."]
    slip_sigma: Float[Array, "..."]
    slip_m: Float[Array, "..."]
    slide_m: Float[Array, "..."]
    wander: Float[Array, "..."]
    along: Float[Array, "..."]
    aside: Float[Array, "..."]


class SkidPlantState(NamedTuple):
    """Where the vehicle is and what it waits for.

    Attributes:
        pose: of the track's midpoint, true.
        wheels: as they turn.
        waiting: commands without effect yet, the newest first; the longest delay and one more.
        slip: of the left and the right side.
        left_m, right_m: ways that the wheels have turned.
        speed_mps, yaw_rate_radps: over the last step.
    """

    pose: VehiclePose
    wheels: WheelSpeeds
    waiting: Float[Array, "slot 2"]
    slip: Float[Array, "2"]
    left_m: Float[Array, ""]
    right_m: Float[Array, ""]
    speed_mps: Float[Array, ""]
    yaw_rate_radps: Float[Array, ""]


def default_skid_plant(*, track_m: float) -> SkidPlant:
    """A small tracked machine with a hydraulic drive; usual sizes, no maker's figures, no control threshold."""
    values = (track_m, 0.1, 0.2, 0.0, 0.015, 10.0, 0.05, 0.003, 0.0, 0.0)
    return SkidPlant(*(jnp.float32(value) for value in values))


def init_skid_plant(plant: SkidPlant, pose: VehiclePose, key: PRNGKeyArray, *, delay_slots: int) -> SkidPlantState:
    """Standing at a pose, slips drawn; one lane. ``delay_slots``: steps of the longest delay."""
    zero = jnp.zeros_like(pose.x_m)
    slip = plant.slip_sigma * jax.random.normal(key, (2,))
    waiting = jnp.zeros((delay_slots + 1, 2), jnp.float32)
    return SkidPlantState(pose, WheelSpeeds(zero, zero), waiting, slip, zero, zero, zero, zero)


def step_skid_plant(
    plant: SkidPlant, state: SkidPlantState, command: WheelSpeeds, key: PRNGKeyArray, step_s: float
) -> SkidPlantState:
    """The vehicle after ``step_s`` of a constant command; one lane, more by ``vmap``.

    Args:
        plant: the vehicle.
        state: before.
        command: wheel speeds.
        key: of this step's noise.
        step_s: of the control loop.
    """
    noise = jax.random.normal(key, (5,))
    waiting = jnp.concatenate([jnp.stack(command)[None], state.waiting[:-1]])
    late = jnp.clip(jnp.round(plant.delay_s / step_s).astype(jnp.int32), 0, waiting.shape[0] - 1)
    told = obeyed_wheels(plant.threshold_mps, WheelSpeeds(waiting[late, 0], waiting[late, 1]))
    slow = plant.lag_s > 0.0
    share = jnp.where(slow, 1.0 - jnp.exp(-step_s / jnp.where(slow, plant.lag_s, 1.0)), 1.0)
    left, right = (was + share * (now - was) for was, now in zip(state.wheels, told, strict=True))
    ways = jnp.abs(jnp.stack([left, right])) * step_s
    keep = jnp.exp(-ways / plant.slip_m)
    slip = keep * state.slip + plant.slip_sigma * jnp.sqrt(1.0 - keep * keep) * noise[:2]
    ground = WheelSpeeds(left * (1.0 - slip[0]), right * (1.0 - slip[1]))
    speed, yaw_rate = body_rates(plant.track_m, ground)
    pose = drive_skid_arc(state.pose, plant.track_m, ground, jnp.float32(step_s))
    # About a point ahead of the midpoint the midpoint itself swings out.
    root_m = jnp.sqrt(jnp.abs(speed) * step_s)
    pushed = plant.along * root_m * noise[3]
    slid = plant.aside * root_m * noise[4] - plant.slide_m * yaw_rate * step_s
    yaw, turned = pose.yaw_rad, plant.wander * root_m * noise[2]
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    pose = VehiclePose(pose.x_m + cos * pushed - sin * slid, pose.y_m + sin * pushed + cos * slid, yaw + turned)
    return SkidPlantState(
        pose,
        WheelSpeeds(left, right),
        waiting,
        slip,
        state.left_m + left * step_s,
        state.right_m + right * step_s,
        speed,
        (pose.yaw_rad - state.pose.yaw_rad) / step_s,
    )
