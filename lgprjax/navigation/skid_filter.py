"""The filter of a skid-steer vehicle: one tick of prediction, delta heading, fix, and the heading's start or restart.

Wheels every tick, the INS and GNSS when they speak (MF section 2). Algebra and gates are those of the filter of the
counter-steered vehicle.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.arc_reach import wrap_yaw
from lgprjax.navigation.gates import NEVER_S, GateRules, GateState, advance_gates, default_rules, init_gates, judge
from lgprjax.navigation.heading_start import (
    HeadingStart,
    KeptFix,
    StartedHeading,
    Way,
    init_heading_start,
    step_heading_start,
)
from lgprjax.navigation.kalman import correct, reopen, weigh
from lgprjax.navigation.observations import GNSS, HEADING, GnssObservation
from lgprjax.navigation.skid_innovations import (
    InsEpoch,
    antenna_reach,
    fix_innovation,
    fix_usable,
    fix_variance,
)
from lgprjax.navigation.skid_model import (
    SLIP_AHEAD,
    SLOW_X,
    SLOW_Y,
    UNKNOWN_YAW_VARIANCE,
    YAW,
    SkidEstimate,
    SkidModel,
    X,
    Y,
    init_skid_estimate,
)
from lgprjax.navigation.skid_motion import predict_skid, skid_rates
from lgprjax.navigation.skid_observations import SkidMotion, SkidObservations
from lgprjax.navigation.turn_update import IS_YAW, Fate, update_turn
from lgprjax.vehicle import WheelSpeeds

_BLIND_S = 1.0
"""An INS that has been silent for longer does not steady the way of a heading start."""
_OTHER_RECEIVER = 4.0
"""A fix whose reported variance differs by this factor does not share its slow error with the one before."""


class LastHeard(NamedTuple):
    """What was last heard of each sensor.

    Attributes:
        wheels: finite speeds.
        epoch: of the INS.
        fix_m: position of the newest fix.
        fix_s: how long before the tick's end it was taken.
        fix_variance: that it reported, m²; zero before the first.
    """

    wheels: WheelSpeeds
    epoch: InsEpoch
    fix_m: Float[Array, "... 2"]
    fix_s: Float[Array, "..."]
    fix_variance: Float[Array, "..."]


class SkidFilterState(NamedTuple):
    """The estimate at the tick's end, and what gates, heading start and sensors leave behind."""

    estimate: SkidEstimate
    gates: GateState
    start: HeadingStart
    last: LastHeard


class SkidFilterInfo(NamedTuple):
    """What became of a tick, by source in the order of ``SKID_SOURCES`` where there are two values.

    Attributes:
        heading_known: the yaw may be used.
        heading_started: it became known in this tick.
        heading_restarted: it was known, and straight fixes replaced it.
        nis: normalised innovation squared; zero where nothing was offered.
        offered: valid, finite, new and in time.
        accepted: used.
        reacquired: used although beyond the gate.
    """

    heading_known: Bool[Array, "..."]
    heading_started: Bool[Array, "..."]
    heading_restarted: Bool[Array, "..."]
    nis: Float[Array, "... 2"]
    offered: Bool[Array, "... 2"]
    accepted: Bool[Array, "... 2"]
    reacquired: Bool[Array, "... 2"]


def skid_rules() -> GateRules:
    """Gates for GNSS at 1 Hz, the sixth reject in a row taken back, and for an INS that is always believed."""
    rules = default_rules()
    return rules._replace(
        reacquire_after=rules.reacquire_after.at[GNSS].set(5).at[HEADING].set(0), forget_s=jnp.float32(5.0)
    )


def init_skid_filter(model: SkidModel, x_m: Float[Array, ""], y_m: Float[Array, ""]) -> SkidFilterState:
    """The filter at the start: about where, and heading unknown."""
    zero, never = jnp.float32(0.0), jnp.float32(NEVER_S)
    last = LastHeard(WheelSpeeds(zero, zero), InsEpoch(never, zero), jnp.full(2, never), never, zero)
    return SkidFilterState(init_skid_estimate(model, x_m, y_m), init_gates(), init_heading_start(), last)


def step_skid_filter(
    model: SkidModel, rules: GateRules, state: SkidFilterState, motion: SkidMotion, observations: SkidObservations
) -> tuple[SkidFilterState, SkidFilterInfo]:
    """One tick: the motion, then what INS and GNSS say. One lane; hundreds under ``vmap``.

    A wheel speed that is no number is taken for the last one that was; a tick of no sensible length for none.

    Args:
        model: of vehicle and sensors.
        rules: of the gates.
        state: at the tick's start.
        motion: over the tick.
        observations: taken within it, or before and late; a slot that is not valid may hold anything.
    """
    motion = _finite(motion, state.last.wheels)
    step = motion.step_s
    epoch = state.last.epoch._replace(since_s=state.last.epoch.since_s + step)
    estimate = predict_skid(model, state.estimate, motion)
    gates = advance_gates(rules, state.gates, step)
    turned = update_turn(model, rules, estimate, gates, epoch, motion, observations.delta_heading)
    turn = wrap_yaw(turned.estimate.mean[YAW] - state.estimate.mean[YAW])
    wheels = WheelSpeeds(motion.left_mps, motion.right_mps)
    last = state.last._replace(wheels=wheels, epoch=turned.epoch, fix_s=state.last.fix_s + step)
    heard = SkidFilterState(turned.estimate, turned.gates, state.start, last)
    return _hear_fix(model, rules, heard, motion, turn, observations.gnss, turned.fate)


def _finite(motion: SkidMotion, wheels: WheelSpeeds) -> SkidMotion:
    sound = jnp.isfinite(motion.step_s) & (motion.step_s > 0.0)
    return SkidMotion(
        jnp.where(jnp.isfinite(motion.left_mps), motion.left_mps, wheels.left_mps),
        jnp.where(jnp.isfinite(motion.right_mps), motion.right_mps, wheels.right_mps),
        jnp.where(sound, motion.step_s, 0.0),
    )


def _try_start(
    model: SkidModel,
    state: SkidFilterState,
    motion: SkidMotion,
    turn: Float[Array, ""],
    fix: GnssObservation,
    offered: Bool[Array, ""],
) -> tuple[HeadingStart, StartedHeading]:
    """The heading start a tick on: it sees every fix that is offered, also those that a wrong heading shuts out."""
    speed_mps, yaw_rate_radps = skid_rates(model, state.estimate, motion)
    age = jnp.where(offered, fix.age_s, 0.0)
    way = Way(speed_mps * motion.step_s, turn, state.estimate.mean[SLIP_AHEAD], motion.step_s)
    at = antenna_reach(model, state.estimate, motion, age)
    kept = KeptFix(jnp.stack([fix.x_m, fix.y_m]), at, age * yaw_rate_radps, fix_variance(fix, offered), age, offered)
    blind = state.gates.since_accepted_s[HEADING] > _BLIND_S
    return step_heading_start(model, state.start, way, kept, blind)


def _hear_fix(
    model: SkidModel,
    rules: GateRules,
    state: SkidFilterState,
    motion: SkidMotion,
    turn: Float[Array, ""],
    fix: GnssObservation,
    ins: Fate,
) -> tuple[SkidFilterState, SkidFilterInfo]:
    """The tick's fix: to the heading start first, which needs no heading, then past its gate into the estimate."""
    place, before = jnp.stack([fix.x_m, fix.y_m]), state.last
    offered = fix_usable(model, fix, before.fix_s) & jnp.any(place != before.fix_m)
    start, found = _try_start(model, state, motion, turn, fix, offered)
    mean, covariance = state.estimate
    off = wrap_yaw(found.yaw_rad - mean[YAW])
    limit = jnp.maximum(model.contradiction_rad, 4.0 * jnp.sqrt(found.variance + covariance[YAW, YAW]))
    starts, restarts = found.ready & ~start.known, found.ready & start.known & (jnp.abs(off) > limit)
    known = start.known | starts
    mean, covariance = reopen(mean, covariance, {YAW: off}, {YAW: found.variance}, starts | restarts)
    mean = jnp.where(IS_YAW, wrap_yaw(mean), mean)
    any_yaw, zero, one = jnp.float32(UNKNOWN_YAW_VARIANCE), jnp.float32(0.0), jnp.float32(1.0)
    mean, covariance = reopen(mean, covariance, {YAW: zero}, {YAW: any_yaw}, offered & ~known)
    variance = fix_variance(fix, offered)
    other = (variance > _OTHER_RECEIVER * before.fix_variance) | (before.fix_variance > _OTHER_RECEIVER * variance)
    slow = {SLOW_X: -mean[SLOW_X], SLOW_Y: -mean[SLOW_Y]}
    mean, covariance = reopen(mean, covariance, slow, {SLOW_X: one, SLOW_Y: one}, offered & other)
    estimate = SkidEstimate(mean, covariance)

    innovation = fix_innovation(model, estimate, motion, fix, offered)
    # Without a heading, or with a new one, the place before says nothing: the vehicle is where the fix says.
    free = ~known | starts | restarts
    nis = jnp.where(free, 0.0, weigh(covariance, innovation).nis)
    seen = jnp.where(offered, place, 0.0)
    verdict, gates = judge(rules, state.gates, GNSS, offered, nis, seen, seen - innovation.residual)
    moves = {X: innovation.residual[0], Y: innovation.residual[1]}
    variances = {X: 1.0 + 100.0 * innovation.noise[0, 0], Y: 1.0 + 100.0 * innovation.noise[1, 1]}
    estimate = SkidEstimate(*reopen(mean, covariance, moves, variances, verdict.reacquired | (offered & free)))
    again = fix_innovation(model, estimate, motion, fix, offered)
    estimate = SkidEstimate(*correct(*estimate, again, weigh(estimate.covariance, again), verdict.accepted))

    # Not "above": a variance that is no number must not count as a known heading.
    known = known & (estimate.covariance[YAW, YAW] <= model.lost_yaw_rad**2)
    last = before._replace(
        fix_m=jnp.where(offered, place, before.fix_m),
        fix_s=jnp.where(offered, fix.age_s, before.fix_s),
        fix_variance=jnp.where(offered, variance, before.fix_variance),
    )
    gnss = Fate(nis, offered, verdict.accepted, verdict.reacquired)
    fates = [jnp.stack(pair) for pair in zip(gnss, ins, strict=True)]
    info = SkidFilterInfo(known, starts & known, restarts, *fates)
    return SkidFilterState(estimate, gates, start._replace(known=known), last), info
