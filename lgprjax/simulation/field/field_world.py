"""A field to be worked in simulation: the world, what runs on board, the route and its fence."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.autopilot.fence import fence_of_route
from lgprjax.autopilot.skid_setup import SkidSetup, skid_setup
from lgprjax.autopilot.skid_step import Guidance
from lgprjax.coverage.cover_route import CoverRoute, lay_pattern
from lgprjax.coverage.field import Field, field_of_polygon
from lgprjax.coverage.pattern import plan_pattern
from lgprjax.coverage.pattern_settings import PatternSettings
from lgprjax.coverage.tool import Tool
from lgprjax.navigation.skid_model import default_skid_model
from lgprjax.scene.skid_plant import SkidPlant, default_skid_plant
from lgprjax.scene.skid_sensors import SkidSensors, default_skid_sensors
from lgprjax.vehicle.skid_steer import SkidSteer

TICK_S = 0.02
MOMENT_TICKS = 5
"""What is kept of a drive is kept ten times a second."""
SPARE_M = 0.8
"""Between what the route needs beyond the perimeter and the fence."""
_TRACK_M = 1.1
_GNSS_X_M = 0.2


@dataclass(frozen=True)
class FieldSpec:
    """What is the same for all lanes, and compiled in.

    Attributes:
        moments: of 0.1 s, how many.
        guidance: law.
        delay_slots: ticks of the plant's longest delay.
        run_up_m: the driver starts so far before the route and drives straight until the heading is known.
    """

    moments: int
    guidance: Guidance = "carrot"
    delay_slots: int = 30
    run_up_m: float = 16.0


class FieldWorld(NamedTuple):
    """World and vehicle, and what runs on board; every lane draws its own track, slips and errors of sensors.

    Attributes:
        plant, sensors: the world's; track_sigma: share by which a lane's track differs from the plant's.
        setup: of the step.
        set_speed_mps: that the operator locked.
    """

    plant: SkidPlant
    sensors: SkidSensors
    track_sigma: Float[Array, ""]
    setup: SkidSetup
    set_speed_mps: Float[Array, ""]


class FieldCourse(NamedTuple):
    """A field, the route over it and its fence."""

    field: Field
    route: CoverRoute
    fence: Float[Array, "corner 2"]


def made_up_tool() -> Tool:
    """A flail of 1.2 m before the tracks."""
    return Tool(1.2, 0.3, 1.2, 0.0)


def made_up_field_world(*, set_speed_mps: float = 0.45, off_s: float = 0.0, every_s: float = 90.0) -> FieldWorld:
    """A made-up mini-flail: no number is a real machine's.

    Args:
        set_speed_mps: MF: 0.11 to 0.45 m/s.
        off_s, every_s: GNSS is silent for the last ``off_s`` of every ``every_s``.
    """
    one = jnp.float32
    sensors = default_skid_sensors(tick_s=TICK_S, gnss_x_m=_GNSS_X_M, gnss_y_m=0.0)
    vehicle = SkidSteer(one(_TRACK_M), one(0.9), one(0.8), one(1.5))
    model = default_skid_model(track_m=_TRACK_M, gnss_x_m=_GNSS_X_M, gnss_y_m=0.0)
    return FieldWorld(
        default_skid_plant(track_m=_TRACK_M)._replace(
            slide_m=one(0.08), wander=one(0.004), along=one(0.003), aside=one(0.005)
        ),
        sensors._replace(off_s=one(off_s), every_s=one(every_s)),
        one(0.12),
        skid_setup(vehicle, made_up_tool(), model, depth_m=0.15, deepest_m=0.3),
        one(set_speed_mps),
    )


def rectangle_course(
    length_m: float,
    width_m: float,
    settings: PatternSettings,
    tool: Tool,
) -> FieldCourse:
    """A rectangle with its south-west corner at the origin, lines along its length.

    Raises:
        InputError: the pattern does not fit.
    """
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    field = field_of_polygon(corners, name="field")
    route = lay_pattern(plan_pattern(field, settings, name="field"))
    return FieldCourse(field, route, fence_of_route(field.perimeter_m, route, tool, spare_m=SPARE_M))
