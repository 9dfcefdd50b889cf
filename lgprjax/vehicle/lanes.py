"""What a rollout takes and gives: its spec, its lanes, their state, their trace.

A lane is one vehicle with its own numbers; a batch is a leading axis of every field. What drives (``chassis``) and what
the law takes it for (``believed``) are two fields: errors of k, of the yaw gain or of the anchor are studied by making
them differ.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.vehicle.chassis import Chassis
from lgprjax.vehicle.look_ahead import LookAhead
from lgprjax.vehicle.path import Path, path_point
from lgprjax.vehicle.servo import Servo, ServoState, init_servo


@dataclass(frozen=True)
class RolloutSpec:
    """What is the same for all lanes of a rollout, and compiled in.

    Attributes:
        steps: how many.
        step_s: of each; the vehicle may turn by up to half a radian in one.
        law: pursuit, exact (LL eq. 2) or closed form (LL eq. 3); or, for comparison, Stanley's, which wants the anchor
            at the front axle. Plain pure pursuit is the exact law of a chassis with the anchor at the rear axle, k = 0.
        stanley_gain_ps: of Stanley's law alone.
        delay_slots: steps of the longest delay that a servo has.
        tolerance_m: of the settling distance.
        tail_m: last stretch of travel, in which a limit cycle is looked for.
    """

    steps: int
    step_s: float = 0.05
    law: Literal["exact", "closed", "stanley"] = "exact"
    stanley_gain_ps: float = 1.0
    delay_slots: int = 0
    tolerance_m: float = 0.10
    tail_m: float = 30.0

    def __post_init__(self) -> None:
        if self.steps < 1 or not self.step_s > 0.0:
            raise ValueError(f"a rollout takes at least one step of positive time, not {self.steps} of {self.step_s} s")


class RolloutLane(NamedTuple):
    """A vehicle, what it is taken for, and how it is to drive. Fields are scalars or one value a lane.

    Attributes:
        chassis: that drives; its largest angle limits nothing here, the believed one does.
        believed: that the law reckons with. Infinite characteristic speed: nothing is fed forward.
        servo: turns the wheels.
        supply_v: at the servo.
        speed_mps: along the body axis, constant; negative in reverse.
        look_ahead: over speed.
    """

    chassis: Chassis
    believed: Chassis
    servo: Servo
    supply_v: Float[Array, "..."]
    speed_mps: Float[Array, "..."]
    look_ahead: LookAhead


class RolloutState(NamedTuple):
    """Where a lane is.

    Attributes:
        x_m, y_m: rear axle.
        cos_yaw, sin_yaw: heading; carried as these, turned by each arc.
        arc_m: of the foot of the true anchor on the path.
        advance_m: of the foot in the last step: where to look for it in the next.
        servo: wheels and what they wait for.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    cos_yaw: Float[Array, "..."]
    sin_yaw: Float[Array, "..."]
    arc_m: Float[Array, "..."]
    advance_m: Float[Array, "..."]
    servo: ServoState


class RolloutTrace(NamedTuple):
    """What a lane did, step by step, as it stood when each step began; the wheels as they stood at its end.

    Attributes:
        x_m, y_m, yaw_rad: pose of the rear axle.
        arc_m, offset_m: of the anchor along and from the path, left positive.
        command_rad, front_rad: of the front wheels, asked for and reached.
        reachable: the goal was.
    """

    x_m: Float[Array, "step ..."]
    y_m: Float[Array, "step ..."]
    yaw_rad: Float[Array, "step ..."]
    arc_m: Float[Array, "step ..."]
    offset_m: Float[Array, "step ..."]
    command_rad: Float[Array, "step ..."]
    front_rad: Float[Array, "step ..."]
    reachable: Bool[Array, "step ..."]


def start_rollout(
    path: Path,
    lane: RolloutLane,
    arc_m: Float[Array, "..."],
    offset_m: Float[Array, "..."],
    heading_rad: Float[Array, "..."],
    *,
    delay_slots: int = 0,
) -> RolloutState:
    """A lane at rest beside its path, wheels straight.

    Args:
        path: to be followed.
        lane: whose true anchor is placed.
        arc_m: along the path.
        offset_m: from it, positive to the left.
        heading_rad: error of heading, from the path's direction to the left.
        delay_slots: as in the spec.
    """
    foot = path_point(path, arc_m)
    turned_cos, turned_sin = jnp.cos(heading_rad), jnp.sin(heading_rad)
    cos, sin = foot.cos * turned_cos - foot.sin * turned_sin, foot.sin * turned_cos + foot.cos * turned_sin
    lead = lane.chassis.anchor_m
    x, y = foot.x_m - foot.sin * offset_m - lead * cos, foot.y_m + foot.cos * offset_m - lead * sin
    zero = jnp.zeros_like(x)
    return RolloutState(x, y, cos, sin, arc_m + zero, zero, init_servo(zero, delay_slots=delay_slots))
