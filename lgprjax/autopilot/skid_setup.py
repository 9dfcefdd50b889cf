"""What the step of a skid-steer vehicle is set up with, and settings to begin with."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.autopilot.edge_ahead import StopRules
from lgprjax.autopilot.skid_health import SkidHealthRules, default_skid_health
from lgprjax.autopilot.skid_limiter import SkidLimiterRules
from lgprjax.coverage.carrot import CarrotSettings, default_carrot
from lgprjax.coverage.tool import Tool
from lgprjax.navigation.gates import GateRules
from lgprjax.navigation.skid_filter import skid_rules
from lgprjax.navigation.skid_model import SkidModel
from lgprjax.vehicle.skid_steer import SkidSteer

_STOP_SHARE = 0.75
"""Of the wheels' fastest change, what a stop is reckoned with: it must be kept on the road as well."""
_RISE_SHARE = 0.5


class SkidSetup(NamedTuple):
    """The vehicle as it is believed to be, and the settings of the parts.

    Attributes:
        vehicle: its limits.
        tool: its rectangle.
        model, rules: of the filter and its gates.
        health: when navigation stops the vehicle.
        carrot: of the guidance.
        limiter: of the commands.
        stop: how it stops, for the fence.
        rise_mps2: how fast the speed is raised, and lowered where nothing hurries.
        threshold_mps: difference of the wheels below which the vehicle ignores a turn, to be made up for; 0: none.
        depth_m: asked of the tool.
    """

    vehicle: SkidSteer
    tool: Tool
    model: SkidModel
    rules: GateRules
    health: SkidHealthRules
    carrot: CarrotSettings
    limiter: SkidLimiterRules
    stop: StopRules
    rise_mps2: Float[Array, "..."]
    threshold_mps: Float[Array, "..."]
    depth_m: Float[Array, "..."]


def skid_setup(
    vehicle: SkidSteer,
    tool: Tool,
    model: SkidModel,
    *,
    depth_m: float,
    deepest_m: float,
    threshold_mps: float = 0.0,
    reaction_s: float = 0.5,
    carrot: CarrotSettings | None = None,
) -> SkidSetup:
    """Settings for a small machine at walking speed; those of the parts follow from the vehicle's limits.

    Args:
        vehicle, tool, model: as measured.
        depth_m: that the tool is asked for; deepest_m: that it may ever be asked for.
        threshold_mps: of the wheels' difference, or a little more.
        reaction_s: from a fix to the wheels: age of the pose, tick, delay and lag.
        carrot: of the guidance; None for the usual one.
    """
    return SkidSetup(
        vehicle=vehicle,
        tool=tool,
        model=model,
        rules=skid_rules(),
        health=default_skid_health(),
        carrot=default_carrot(smallest_radius_m=float(vehicle.smallest_radius_m)) if carrot is None else carrot,
        limiter=SkidLimiterRules(
            vehicle.largest_wheel_mps,
            vehicle.wheel_rate_mps2,
            jnp.float32(deepest_m),
            jnp.float32(0.2),
            vehicle.wheel_rate_mps2,
        ),
        stop=StopRules(
            jnp.float32(reaction_s), _STOP_SHARE * vehicle.wheel_rate_mps2, jnp.float32(0.05), jnp.float32(3.0)
        ),
        rise_mps2=_RISE_SHARE * vehicle.wheel_rate_mps2,
        threshold_mps=jnp.float32(threshold_mps),
        depth_m=jnp.float32(depth_m),
    )
