"""The navigation filter: one tick of prediction, gates and updates."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation import kalman
from lgprjax.navigation.counter_steer_model import (
    GNSS_ERROR_X,
    GNSS_ERROR_Y,
    LGPR_CLOCK,
    LGPR_ERROR_X,
    LGPR_ERROR_Y,
    LGPR_LEVER_X,
    LGPR_LEVER_Y,
    ODOMETER_SCALE,
    RATE_BIAS,
    SPEED,
    YAW,
    FilterModel,
    NavEstimate,
    X,
    Y,
    init_estimate,
)
from lgprjax.navigation.kalman import Innovation, reach, turned
from lgprjax.navigation.observations import (
    GNSS,
    HEADING,
    LGPR,
    ODOMETER,
    SOURCES,
    GateRules,
    GateState,
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    Observations,
    OdometerObservation,
    advance_gates,
    count_conflict,
    init_gates,
    judge,
)
from lgprjax.vehicle import VehiclePose


def transition_of(model: FilterModel, estimate: NavEstimate, motion: MotionInput) -> kalman.Transition:
    """A tick at the estimate before it.

    Speed, bias, scale, clock and lever wander before the motion, which happens at the speed of the tick's end: so that
    an observation of some age is evaluated by going back along the same arc. The gyro's noise turns the body about the
    zero-slip point; side noise and the errors' own come after.
    """
    step = motion.step_s
    # The errors fade over the way driven, which is no function of the states: they are small.
    way = jnp.abs(estimate.mean[SPEED]) * step
    gnss, lgpr = jnp.exp(-step / model.gnss_error_s), jnp.exp(-way / model.lgpr_error_m)
    decay = jnp.stack([gnss, gnss, lgpr, lgpr])

    def move(mean: Float[Array, " 13"], noise: Float[Array, " 12"]) -> Float[Array, " 13"]:
        walked = mean[SPEED:GNSS_ERROR_X] + noise[:6]
        turn = (motion.yaw_rate_radps - walked[RATE_BIAS - SPEED]) * step + noise[6]
        nowhere = jnp.zeros_like(turn)
        at = reach(walked[0] * step, turn, model.zero_slip_m, nowhere, nowhere)
        x, y = turned(jnp.cos(mean[YAW]), jnp.sin(mean[YAW]), at)
        yaw = mean[YAW] + turn
        aside = jnp.stack([x - jnp.sin(yaw) * noise[7], y + jnp.cos(yaw) * noise[7], turn])
        return jnp.concatenate([mean[:SPEED] + aside, walked, mean[GNSS_ERROR_X:] * decay + noise[8:]])

    walks = [model.acceleration_noise, model.rate_bias_walk, model.odometer_scale_walk, model.clock_walk]
    white = jnp.stack([*walks, model.lever_walk, model.lever_walk, model.yaw_rate_noise, model.side_noise])
    errors = jnp.stack([model.gnss_error_sigma_m] * 2 + [model.lgpr_error_sigma_m] * 2)
    fresh = errors * jnp.sqrt((1.0 - decay) * (1.0 + decay))
    return kalman.linearise(move, estimate.mean, jnp.concatenate([white * jnp.sqrt(step), fresh]))


def transition_matrix(transition: kalman.Transition) -> Float[Array, "13 13"]:
    """F, the derivatives of all states after a tick by those before it."""
    return transition.matrix


def predict(model: FilterModel, estimate: NavEstimate, motion: MotionInput) -> NavEstimate:
    """The estimate a tick later, before its observations."""
    return kalman.predict(estimate.covariance, transition_of(model, estimate, motion))


def update(estimate: NavEstimate, innovation: Innovation) -> NavEstimate:
    """The estimate after an observation without a gate; one that is not offered changes nothing."""
    return kalman.correct(estimate, innovation, kalman.weigh(estimate, innovation), innovation.offered)


# Innovations of each source.
#
# An observation of age τ was taken where the vehicle was τ before the tick's end: the pose moves back along body
# velocity and yaw rate, which is exact within a tick.


def gnss_innovation(
    model: FilterModel, estimate: NavEstimate, motion: MotionInput, observation: GnssObservation
) -> Innovation:
    """Of the antenna's position."""
    age = _clean(observation)

    def expect(mean: Float[Array, " 13"]) -> Float[Array, " 2"]:
        place = _seen(model, motion, mean, age, model.gnss_x_m, model.gnss_y_m)[:YAW]
        return place + mean[GNSS_ERROR_X : GNSS_ERROR_Y + 1]

    observed = jnp.stack([observation.x_m, observation.y_m])
    return kalman.innovation_of(estimate.mean, expect, observed, observation.covariance, kalman.usable(observation))


def heading_innovation(estimate: NavEstimate, motion: MotionInput, observation: HeadingObservation) -> Innovation:
    """Of the yaw; it depends on no lever."""
    age = _clean(observation)

    def expect(mean: Float[Array, " 13"]) -> Float[Array, " 1"]:
        return (mean[YAW] - age * (motion.yaw_rate_radps - mean[RATE_BIAS]))[None]

    noise, offered = observation.variance[None, None], kalman.usable(observation)
    return kalman.innovation_of(estimate.mean, expect, observation.yaw_rad[None], noise, offered, angle=0)


def odometer_innovation(estimate: NavEstimate, observation: OdometerObservation) -> Innovation:
    """Of the forward speed times one plus the scale."""

    def expect(mean: Float[Array, " 13"]) -> Float[Array, " 1"]:
        return (mean[SPEED] * (1.0 + mean[ODOMETER_SCALE]))[None]

    noise, offered = observation.variance[None, None], kalman.usable(observation)
    return kalman.innovation_of(estimate.mean, expect, observation.speed_mps[None], noise, offered)


def lgpr_innovation(
    model: FilterModel, estimate: NavEstimate, motion: MotionInput, observation: LgprObservation
) -> Innovation:
    """Of the pose of the array's centre, by the clock later than its stamp."""
    age = _clean(observation)

    def expect(mean: Float[Array, " 13"]) -> Float[Array, " 3"]:
        lever = (model.array_x_m + mean[LGPR_LEVER_X], model.array_y_m + mean[LGPR_LEVER_Y])
        pose = _seen(model, motion, mean, age + mean[LGPR_CLOCK], *lever)
        return pose + jnp.append(mean[LGPR_ERROR_X : LGPR_ERROR_Y + 1], 0.0)

    noise = observation.covariance
    # Of two parts each: a covariance that is none would make the estimate's one none as well.
    apart = noise**2 < jnp.diagonal(noise)[:, None] * jnp.diagonal(noise)[None, :]
    sound = jnp.all(jnp.diagonal(noise) > 0.0) & jnp.all(apart | jnp.eye(len(noise), dtype=bool))
    observed = jnp.stack([observation.x_m, observation.y_m, observation.yaw_rad])
    return kalman.innovation_of(estimate.mean, expect, observed, noise, kalman.usable(observation) & sound, angle=YAW)


def _seen(
    model: FilterModel,
    motion: MotionInput,
    mean: Float[Array, " 13"],
    age_s: Float[Array, ""],
    x_m: Float[Array, ""],
    y_m: Float[Array, ""],
) -> Float[Array, " 3"]:
    """Place of a body point some time before the tick's end, and the yaw then."""
    turn = -age_s * (motion.yaw_rate_radps - mean[RATE_BIAS])
    way = reach(-age_s * mean[SPEED], turn, model.zero_slip_m, x_m, y_m)
    x, y = turned(jnp.cos(mean[YAW]), jnp.sin(mean[YAW]), way)
    return mean[: YAW + 1] + jnp.stack([x, y, turn])


def _clean(observation: GnssObservation | HeadingObservation | LgprObservation) -> Float[Array, ""]:
    """The age, or zero if it is not finite."""
    return jnp.where(observation.valid & jnp.isfinite(observation.age_s), observation.age_s, 0.0)


class FilterState(NamedTuple):
    """The estimate at the tick's end and the state of the gates."""

    estimate: NavEstimate
    gates: GateState


class FilterInfo(NamedTuple):
    """Outcome of a tick's observations, by source in the order of ``SOURCES``.

    Attributes:
        nis: normalised innovation squared; zero if nothing was offered.
        offered: valid and finite.
        accepted: used.
        reacquired: used although beyond the gate.
    """

    nis: Float[Array, "... 4"]
    offered: Bool[Array, "... 4"]
    accepted: Bool[Array, "... 4"]
    reacquired: Bool[Array, "... 4"]


def init_filter(model: FilterModel, pose: VehiclePose, speed_mps: Float[Array, ""]) -> FilterState:
    """The filter at the start, at a pose of the rear axle and a forward speed known within the model's sigmas."""
    return FilterState(init_estimate(model, pose, speed_mps), init_gates())


def step_filter(
    model: FilterModel, rules: GateRules, state: FilterState, motion: MotionInput, observations: Observations
) -> tuple[FilterState, FilterInfo]:
    """One tick: the motion, then each source in turn past its gate. Unbatched; use ``vmap`` for more.

    Args:
        model: of vehicle and sensors.
        rules: of the gates.
        state: at the tick's start.
        motion: over the tick.
        observations: taken within it; a slot that is not valid may hold anything.
    """
    estimate = predict(model, state.estimate, motion)
    gates = advance_gates(rules, state.gates, motion.step_s)
    nis, offered, accepted, reacquired = [], [], [], []
    for source in range(len(SOURCES)):
        innovation = _innovation_of(source, model, estimate, motion, observations)
        judged = kalman.weigh(estimate, innovation).nis
        fix, seen = _places(source, observations, innovation)
        verdict, gates = judge(rules, gates, source, innovation.offered, judged, fix, seen)
        opened = _let_go(source, estimate, innovation, verdict.reacquired)
        again = _innovation_of(source, model, opened, motion, observations)
        estimate = kalman.correct(opened, again, kalman.weigh(opened, again), verdict.accepted)
        nis.append(judged)
        offered.append(innovation.offered)
        accepted.append(verdict.accepted)
        reacquired.append(verdict.reacquired)
    error = jnp.hypot(estimate.mean[GNSS_ERROR_X], estimate.mean[GNSS_ERROR_Y]) / model.gnss_error_sigma_m
    gates = count_conflict(rules, gates, error, motion.step_s)
    info = FilterInfo(jnp.stack(nis), jnp.stack(offered), jnp.stack(accepted), jnp.stack(reacquired))
    return FilterState(estimate, gates), info


def _innovation_of(
    source: int, model: FilterModel, estimate: NavEstimate, motion: MotionInput, observations: Observations
) -> Innovation:
    if source == GNSS:
        return gnss_innovation(model, estimate, motion, observations.gnss)
    if source == HEADING:
        return heading_innovation(estimate, motion, observations.heading)
    if source == ODOMETER:
        return odometer_innovation(estimate, observations.odometer)
    return lgpr_innovation(model, estimate, motion, observations.lgpr)


def _places(
    source: int, observations: Observations, innovation: Innovation
) -> tuple[Float[Array, " 2"], Float[Array, " 2"]]:
    """Observed and expected position, for the sources that observe one."""
    if source not in (GNSS, LGPR):
        return jnp.zeros(2), jnp.zeros(2)
    slot = observations.gnss if source == GNSS else observations.lgpr
    fix = jnp.where(innovation.offered, jnp.stack([slot.x_m, slot.y_m]), 0.0)
    return fix, fix - innovation.residual[:2]


def _let_go(source: int, estimate: NavEstimate, innovation: Innovation, reacquired: Bool[Array, ""]) -> NavEstimate:
    """The estimate with the states that a source observes directly reset to its observation.

    Their covariances are cleared, and their variances become a hundred times that of the observation, plus a square
    metre, 0.04 square radians or 1 m²/s²: so much larger than after the update that the prior has no weight, yet not so
    large that float32 loses precision.
    """
    letting = {GNSS: (X, Y), HEADING: (YAW,), ODOMETER: (SPEED,), LGPR: (X, Y, YAW)}[source]
    moves = {state: innovation.residual[part] for part, state in enumerate(letting)}
    variances = {
        state: (0.04 if state == YAW else 1.0) + 100.0 * innovation.noise[part, part]
        for part, state in enumerate(letting)
    }
    return kalman.reopen(estimate, moves, variances, reacquired)


# A whole drive at once: the filter forward, then back by Rauch, Tung and Striebel (1965).
#
# For labelling baselines and for judging the filter: every tick's estimate uses earlier and later observations. One
# drive per call; several of equal length by ``vmap``. A drive is padded by ticks of no length without observations,
# which change nothing.


def filter_drive(
    model: FilterModel, rules: GateRules, start: FilterState, motions: MotionInput, observations: Observations
) -> tuple[NavEstimate, FilterInfo]:
    """Estimates after each tick of a drive, and the outcome of the observations; leading axis tick.

    Args:
        model, rules: of the filter.
        start: before the first tick.
        motions, observations: leading axis tick.
    """

    def step(
        state: FilterState, tick: tuple[MotionInput, Observations]
    ) -> tuple[FilterState, tuple[NavEstimate, FilterInfo]]:
        state, info = step_filter(model, rules, state, *tick)
        return state, (state.estimate, info)

    driven: tuple[NavEstimate, FilterInfo] = jax.lax.scan(step, start, (motions, observations))[1]
    return driven


def smooth_estimates(
    model: FilterModel, filtered: NavEstimate, motions: MotionInput, restarted: Bool[Array, " tick"]
) -> NavEstimate:
    """The backward pass over estimates of a forward pass.

    Args:
        model: of the filter.
        filtered: after each tick.
        motions: of each tick.
        restarted: ticks across which nothing is propagated back.
    """

    def back(later: NavEstimate, before: NavEstimate, motion: MotionInput, restarted: Bool[Array, ""]) -> NavEstimate:
        return kalman.step_back(later, before, transition_of(model, before, motion), restarted)

    return kalman.smooth(filtered, back, (motions, restarted))
