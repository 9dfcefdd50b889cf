"""The closed loop, tick by tick: vehicle, sensors, fusion, health, planner, law, limiter, and round again.

A tick has two halves: ``move`` (what the world does: the last command drives the vehicle, the sensors see it) and
``decide`` (what runs on board: fusion, health, the drifting frame, the autopilot). Between them stands the radar:
registration of rendered scans, or fixes drawn from an error model. Both halves are one lane, more by ``vmap``; the
controller never sees the true pose; only the driver does, who brings the vehicle to where it may be engaged.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from lgprjax.autopilot import (
    AutopilotInputs,
    step_autopilot,
)
from lgprjax.navigation import (
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    Motion,
    Observations,
    OdometerObservation,
    Reaction,
    RoutePath,
    step_navigator,
)
from lgprjax.scene import (
    Readings,
    read_live_sensors,
    step_plant,
)
from lgprjax.simulation.loop.loop_state import Decision, LoopSetup, LoopSpec, LoopState
from lgprjax.vehicle import VehiclePose


def move(spec: LoopSpec, setup: LoopSetup, state: LoopState, key: PRNGKeyArray) -> tuple[LoopState, Readings]:
    """The world's half of a tick."""
    plant = step_plant(
        setup.plant,
        setup.terrain,
        state.plant,
        state.command.front_rad,
        state.command.throttle,
        state.command.brake,
        state.gear,
        spec.tick_s,
    )
    tick = state.tick + 1
    sensors, readings = read_live_sensors(
        setup.sensors,
        setup.faults,
        state.sensors,
        key,
        plant.pose,
        plant.speed_mps,
        plant.yaw_rate_radps,
        tick,
        spec.tick_s,
    )
    return state._replace(plant=plant, sensors=sensors, tick=tick), readings


def decide(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    state: LoopState,
    readings: Readings,
    lgpr: LgprObservation,
    p_false: Float[Array, ""],
) -> tuple[LoopState, Decision]:
    """The half that runs on board.

    Args:
        spec, setup, route: of the lane.
        state: after ``move``.
        readings: of this tick.
        lgpr: this tick's fix, if there is one.
        p_false: of its match, see ``step_health``; NaN where no scan was matched.
    """
    step_s = jnp.float32(spec.tick_s)
    motion = Motion(readings.yaw_rate_radps, step_s)
    observations = observe(setup, readings, lgpr)
    navigator, navigated = step_navigator(
        setup.navigator, state.navigator, motion, observations, p_false, fusion=spec.fusion
    )
    judged = navigated.health
    sound_s = jnp.where(judged.reaction == Reaction.CONTINUE, state.sound_s + step_s, 0.0)
    engaged = state.engaged | (sound_s > setup.settled_s)
    true = state.plant.pose
    pose_route = VehiclePose(
        *(jnp.where(engaged, ours, his) for ours, his in zip(navigated.pose_route, true, strict=True))
    )
    stopping = state.stopping | (engaged & (judged.reaction == Reaction.STOP))
    inputs = AutopilotInputs(
        pose_route,
        navigated.speed_mps,
        jnp.where(stopping, Reaction.STOP.value, jnp.where(engaged, judged.reaction, 0)).astype(jnp.int32),
        jnp.where(engaged, judged.speed_cap_mps, jnp.inf).astype(jnp.float32),
        jnp.float32(0.0),
        jnp.asarray(True),
        jnp.asarray(True),
        setup.set_speed_mps,
        # Measured by the potentiometer, whose errors are small beside the servo's play.
        state.plant.servo.wheel_rad,
    )
    autopilot, command, why = step_autopilot(setup.autopilot, route, state.autopilot, inputs, step_s)
    state = state._replace(
        navigator=navigator,
        autopilot=autopilot,
        command=command,
        gear=why.plan.gear,
        engaged=engaged,
        sound_s=sound_s,
        stopping=stopping,
    )
    return state, Decision(pose_route, navigated, why)


def observe(setup: LoopSetup, readings: Readings, lgpr: LgprObservation) -> Observations:
    """Readings as the filter takes them, all at the tick's end."""
    zero = jnp.float32(0.0)
    noise = setup.noise
    covariance = lgpr.covariance + noise.lgpr_yaw_rad2 * jnp.diag(jnp.asarray([0.0, 0.0, 1.0], jnp.float32))
    return Observations(
        GnssObservation(
            readings.gnss_m[0],
            readings.gnss_m[1],
            noise.gnss_m2 * jnp.eye(2, dtype=jnp.float32),
            zero,
            readings.gnss_valid,
        ),
        HeadingObservation(readings.heading_rad, noise.heading_rad2, zero, readings.heading_valid),
        OdometerObservation(readings.odometer_mps, noise.odometer_m2ps2, readings.odometer_valid),
        lgpr._replace(covariance=covariance),
    )
