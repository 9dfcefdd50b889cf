"""A closed loop made ready: a made-up vehicle, its sensors, and the settings that run on board."""

from dataclasses import dataclass, field, replace

import jax.numpy as jnp

from lgprjax.autopilot import AutopilotConfig, LimiterRules, default_velocity
from lgprjax.navigation import (
    HealthRules,
    NavigatorSetup,
    SlewLimits,
    default_model,
    default_rules,
    health_rules,
    planner_settings,
    switch_settings,
)
from lgprjax.scene import Plant, Terrain, TrueVehicle, live_sensors, no_faults
from lgprjax.scene.vehicle_drive import chassis_of, pedals_of, servo_of
from lgprjax.simulation.loop.loop_state import LoopSetup, LoopSpec, ReportedNoise
from lgprjax.vehicle import LookAhead

_K_ERROR = -0.0008
_SPEED_ERROR_MPS = -0.07
"""What calibration from logs left of k and V_CHAR: believed less true, as tuning/README.md tells of its vehicle."""

_FIX_SLOW_M, _FIX_SLOW_RAD, _FIX_CHANGES_M = 0.02, 0.004, 4.0
"""What neighbouring fixes share, and over what way."""
_LABEL_RAD, _LABEL_CHANGES_M = 0.00175, 90.0
"""What the map's own headings are wrong by, and over what way: of a survey at 0.1° and 10 mph."""


@dataclass(frozen=True)
class LoopVehicle:
    """Vehicle and sensors of a closed loop. None of the numbers is any vehicle's own.

    Attributes:
        vehicle: as it is.
        anchor_m: centre of the array, which is to follow the route, ahead of the rear axle.
        set_speed_mps: that the operator locked.
        gnss_slow_m: how far GNSS wanders from the map's frame, sigma an axis: 3 cm for RTK on one base station.
        risk: probability of a false match up to which a fix is believed.
    """

    vehicle: TrueVehicle = field(default_factory=TrueVehicle)
    anchor_m: float = 6.2
    set_speed_mps: float = 4.4704
    gnss_slow_m: float = 0.3
    risk: float = 1e-4


def loop_setup(spec: LoopSpec, made_of: LoopVehicle, terrain: Terrain) -> LoopSetup:
    """The loop of a vehicle whose calibration is good, not perfect."""
    true = made_of.vehicle
    ratio = true.rear
    believed = replace(
        true,
        rear=ratio + _K_ERROR if isinstance(ratio, float) else ratio,
        characteristic_speed_mps=true.characteristic_speed_mps + _SPEED_ERROR_MPS,
    )
    chassis = chassis_of(true, made_of.anchor_m)
    share = believed.rear if isinstance(believed.rear, float) else 0.0
    zero_slip_m = true.wheelbase_m * share / (1.0 + share)
    sensors = live_sensors(tick_s=spec.tick_s, gnss_x_m=1.0, gnss_slow_m=made_of.gnss_slow_m)
    model = default_model(
        zero_slip_m=zero_slip_m, gnss_x_m=1.0, gnss_y_m=0.0, array_x_m=made_of.anchor_m, array_y_m=0.0
    )._replace(
        gnss_error_sigma_m=sensors.gnss_slow_m,
        gnss_error_s=sensors.gnss_slow_s,
        # Ground that leans lets the vehicle crab for seconds, ruts turn it about another point than its wheels do.
        side_noise=jnp.float32(0.05),
        lgpr_error_sigma_m=jnp.float32(_FIX_SLOW_M),
        lgpr_error_m=jnp.float32(_FIX_CHANGES_M),
        # Measured on the vehicle with a tape and a clock; at one speed the two cannot be told from a place.
        initial_lever_m=jnp.float32(0.02),
        initial_clock_s=jnp.float32(0.005),
    )
    # A heading that is off for a minute at a time is no better than one of it a tick of so much more noise.
    slow = 2.0 * sensors.heading_slow_s / spec.tick_s
    shared_rad2_m = _FIX_CHANGES_M * _FIX_SLOW_RAD**2 + _LABEL_CHANGES_M * _LABEL_RAD**2
    noise = ReportedNoise(
        sensors.gnss_sigma_m**2,
        sensors.heading_sigma_rad**2 + slow * sensors.heading_slow_rad**2,
        sensors.odometer_mps**2,
        jnp.float32(2.0 * shared_rad2_m / (made_of.set_speed_mps * spec.tick_s)),
    )
    limits = LimiterRules(
        largest_front_rad=jnp.float32(true.largest_angle_rad),
        front_rate_radps=jnp.float32(true.rate_radps),
        throttle_rate_per_s=jnp.float32(2.0),
        brake_rate_per_s=jnp.float32(4.0),
        oldest_s=jnp.float32(0.2),
        default_brake=jnp.float32(0.5),
        release_rate_radps=jnp.float32(0.1),
    )
    autopilot = AutopilotConfig(
        chassis_of(believed, made_of.anchor_m),
        pedals_of(true),
        # As the look-ahead study finds it for this vehicle.
        LookAhead(*(jnp.float32(value) for value in (1.18, 2.04, 2.76, 4.44))),
        planner_settings(2.0),
        # Slopes of some per cent ask for a firmer hand than a road.
        default_velocity()._replace(proportional_per_s=jnp.float32(1.5), integral_per_s2=jnp.float32(0.4)),
        limits,
    )
    return LoopSetup(
        plant=Plant(chassis, servo_of(true), pedals_of(true), jnp.float32(true.nominal_v)),
        terrain=terrain,
        sensors=sensors,
        faults=no_faults(),
        navigator=NavigatorSetup(
            model,
            default_rules(),
            switch_settings(
                made_of.risk,
                zero_slip_m=jnp.float32(zero_slip_m),
                array_x_m=jnp.float32(made_of.anchor_m),
                array_y_m=jnp.float32(0.0),
            ),
            SlewLimits(jnp.float32(0.5), jnp.float32(0.05)),
            _rules(spec, sensors.gnss_ticks.item() * spec.tick_s, made_of.risk),
        ),
        noise=noise,
        autopilot=autopilot,
        set_speed_mps=jnp.float32(made_of.set_speed_mps),
        settled_s=jnp.float32(1.0),
    )


def _rules(spec: LoopSpec, gnss_period_s: float, risk: float) -> HealthRules:
    return health_rules(
        gnss_period_s=gnss_period_s,
        heading_period_s=spec.tick_s,
        odometer_period_s=spec.tick_s,
        # The radar's fixes come in stretches: a metre or two of poor ground is no fault.
        lgpr_period_s=0.5,
        risk=risk,
    )
