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
    STATES,
    YAW,
    FilterModel,
    NavEstimate,
    X,
    Y,
    init_estimate,
    pose_of,
    step_local,
)
from lgprjax.navigation.kalman import (
    Innovation,
    Pair,
    Reach,
    Row,
    Weighed,
    innovation_of,
    reach,
    reopen,
    turned,
    usable,
    wrap_yaw,
)
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

# The filter's algebra: prediction of 13 states over a tick; updates are in ``kalman``.
#
# The derivatives of a tick's motion touch three rows of the covariance: they are written out by rows, so that a tick of
# hundreds of batch elements stays elementwise.


class Transition(NamedTuple):
    """Propagation of small errors over a tick.

    Attributes:
        pose_rows: derivatives of x, y and yaw after the tick by the states before it.
        decay: of the states after the pose: one, or the decay of a Gauss-Markov error.
        yaw_noise: derivatives of x, y and yaw by a turn of the body.
    """

    pose_rows: Float[Array, "3 13"]
    decay: Float[Array, " 10"]
    yaw_noise: Float[Array, " 3"]


def transition_of(model: FilterModel, estimate: NavEstimate, motion: MotionInput) -> Transition:
    """The derivatives of a tick at the estimate before it; ``transition_matrix`` has them as a matrix."""
    mean, step = estimate.mean, motion.step_s
    travel, turn = mean[SPEED] * step, (motion.yaw_rate_radps - mean[RATE_BIAS]) * step
    nowhere = jnp.zeros_like(travel)
    arc = reach(travel, turn, model.zero_slip_m, nowhere, nowhere)
    cos, sin = jnp.cos(mean[YAW]), jnp.sin(mean[YAW])
    at, by_travel, by_turn = (turned(cos, sin, part) for part in (arc.at_m, arc.by_travel, arc.by_turn_m))
    rows = jnp.zeros((3, len(STATES)), mean.dtype)
    rows = rows.at[X, X].set(1.0).at[Y, Y].set(1.0).at[YAW, YAW].set(1.0)
    rows = rows.at[X, YAW].set(-at[1]).at[Y, YAW].set(at[0])
    rows = rows.at[X, SPEED].set(step * by_travel[0]).at[Y, SPEED].set(step * by_travel[1])
    bias = -step * jnp.stack([*by_turn, jnp.ones_like(step)])
    gnss, lgpr = _error_decay(model, travel, step)
    decay = jnp.concatenate([jnp.ones(LGPR_LEVER_Y - YAW), jnp.stack([gnss, gnss, lgpr, lgpr])])
    return Transition(rows.at[:, RATE_BIAS].set(bias), decay, jnp.stack([*by_turn, jnp.ones_like(step)]))


def transition_matrix(transition: Transition) -> Float[Array, "13 13"]:
    """F, the derivatives of all states after a tick by those before it."""
    rest = jnp.concatenate([jnp.zeros((len(transition.decay), 3)), jnp.diag(transition.decay)], axis=1)
    return jnp.concatenate([transition.pose_rows, rest])


def predict(model: FilterModel, estimate: NavEstimate, motion: MotionInput) -> NavEstimate:
    """The estimate a tick later, before its observations.

    Speed, bias, scale, clock and lever wander before the motion, which happens at the speed of the tick's end: so that
    an observation of some age is evaluated by going back along the same arc. The gyro's noise turns the body about the
    zero-slip point; side noise and the errors' own come after.

    Args:
        model: of vehicle and sensors.
        estimate: at the tick's start.
        motion: the tick's.
    """
    transition = transition_of(model, estimate, motion)
    mean, step = estimate.mean, motion.step_s
    rate = motion.yaw_rate_radps - mean[RATE_BIAS]
    pose = step_local(pose_of(estimate), mean[SPEED], rate, model.zero_slip_m, step)
    moved = jnp.concatenate([jnp.stack([*pose]), mean[YAW + 1 :] * transition.decay])
    wandered = estimate.covariance + jnp.diag(_wander(model) * step)
    half = _apply(transition, wandered)
    covariance = _apply(transition, half.T)
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    turn = model.yaw_rate_noise * jnp.sqrt(step) * transition.yaw_noise
    side = model.side_noise * jnp.sqrt(step) * jnp.stack([-sin, cos, jnp.zeros_like(sin)])
    noise = jnp.outer(turn, turn) + jnp.outer(side, side)
    errors = jnp.stack([model.gnss_error_sigma_m] * 2 + [model.lgpr_error_sigma_m] * 2)
    fresh = errors * errors * (1.0 - transition.decay[-4:]) * (1.0 + transition.decay[-4:])
    injected = jnp.pad(noise, (0, len(STATES) - 3)) + jnp.diag(jnp.pad(fresh, (len(STATES) - 4, 0)))
    # Rounding leaves the two halves apart by a digit; here they are brought together once a tick.
    covariance = 0.5 * (covariance + covariance.T) + injected
    return NavEstimate(moved, covariance)


def weigh(estimate: NavEstimate, innovation: Innovation) -> Weighed:
    """Gain and normalised innovation squared of an observation of one to three components."""
    return kalman.weigh(estimate.covariance, innovation)


def correct(estimate: NavEstimate, innovation: Innovation, weighed: Weighed, use: Bool[Array, ""]) -> NavEstimate:
    """The estimate after an observation, by Joseph's form, where it is used; if not, it stays what it is."""
    return NavEstimate(*kalman.correct(*estimate, innovation, weighed, use))


def update(estimate: NavEstimate, innovation: Innovation) -> NavEstimate:
    """The estimate after an observation without a gate; one that is not offered changes nothing."""
    return correct(estimate, innovation, weigh(estimate, innovation), innovation.offered)


def _wander(model: FilterModel) -> Float[Array, " 13"]:
    """Variances per second of the states with a random walk."""
    sigmas = jnp.zeros(len(STATES)).at[SPEED].set(model.acceleration_noise).at[RATE_BIAS].set(model.rate_bias_walk)
    sigmas = sigmas.at[ODOMETER_SCALE].set(model.odometer_scale_walk).at[LGPR_CLOCK].set(model.clock_walk)
    sigmas = sigmas.at[LGPR_LEVER_X].set(model.lever_walk).at[LGPR_LEVER_Y].set(model.lever_walk)
    return sigmas * sigmas


def _error_decay(
    model: FilterModel, travel_m: Float[Array, ""], step_s: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Decay of the GNSS error over a tick's time, and of the LGPR error over its travel in either direction."""
    return jnp.exp(-step_s / model.gnss_error_s), jnp.exp(-jnp.abs(travel_m) / model.lgpr_error_m)


def _apply(transition: Transition, matrix: Float[Array, "13 13"]) -> Float[Array, "13 13"]:
    """F times a matrix: three rows are sums of five, the others are scaled."""
    pose = matrix[: YAW + 1]
    for state in (YAW, SPEED, RATE_BIAS):
        weight = transition.pose_rows[:, state]
        if state == YAW:
            weight = weight.at[YAW].set(0.0)
        pose = pose + jnp.outer(weight, matrix[state])
    return jnp.concatenate([pose, transition.decay[:, None] * matrix[YAW + 1 :]])


# Expected observations of each source: innovation, its derivatives by the states, and its noise.
#
# Derivatives are kept as the few states that an observation depends on. An observation of age τ was taken where the
# vehicle was τ before the tick's end: the pose moves back along body velocity and yaw rate, which is exact within a
# tick.


def gnss_innovation(
    model: FilterModel, estimate: NavEstimate, motion: MotionInput, observation: GnssObservation
) -> Innovation:
    """Of the antenna's position."""
    age, (back, along, rate) = _clean(observation, observation.age_s), _body_motion(estimate, motion)
    at = reach(-age * along, -age * rate, model.zero_slip_m, model.gnss_x_m, model.gnss_y_m)
    (x, y), (row_x, row_y) = _position(estimate, at, age, back)
    row_x[GNSS_ERROR_X] = row_y[GNSS_ERROR_Y] = jnp.float32(1.0)
    expected = jnp.stack([x + estimate.mean[GNSS_ERROR_X], y + estimate.mean[GNSS_ERROR_Y]])
    observed = jnp.stack([observation.x_m, observation.y_m])
    return innovation_of(observed - expected, (row_x, row_y), observation.covariance, usable(observation))


def heading_innovation(estimate: NavEstimate, motion: MotionInput, observation: HeadingObservation) -> Innovation:
    """Of the yaw; it depends on no lever."""
    age, (_, _, rate) = _clean(observation, observation.age_s), _body_motion(estimate, motion)
    residual = wrap_yaw(observation.yaw_rad - (estimate.mean[YAW] - age * rate))
    row = {YAW: jnp.float32(1.0), RATE_BIAS: age}
    return innovation_of(residual[None], (row,), observation.variance[None, None], usable(observation))


def odometer_innovation(estimate: NavEstimate, observation: OdometerObservation) -> Innovation:
    """Of the forward speed times one plus the scale."""
    speed, scale = estimate.mean[SPEED], 1.0 + estimate.mean[ODOMETER_SCALE]
    residual = observation.speed_mps - speed * scale
    row = {SPEED: scale, ODOMETER_SCALE: speed}
    return innovation_of(residual[None], (row,), observation.variance[None, None], usable(observation))


def lgpr_innovation(
    model: FilterModel, estimate: NavEstimate, motion: MotionInput, observation: LgprObservation
) -> Innovation:
    """Of the pose of the array's centre, by the clock later than its stamp."""
    mean = estimate.mean
    back, along, rate = _body_motion(estimate, motion)
    age = _clean(observation, observation.age_s) + mean[LGPR_CLOCK]
    lever = (model.array_x_m + mean[LGPR_LEVER_X], model.array_y_m + mean[LGPR_LEVER_Y])
    at = reach(-age * along, -age * rate, model.zero_slip_m, *lever)
    (x, y), rows = _position(estimate, at, age, back)
    cos, sin = back
    # A later time means less travel and turn.
    clock = turned(
        cos,
        sin,
        (
            -along * at.by_travel[0] - rate * at.by_turn_m[0],
            -along * at.by_travel[1] - rate * at.by_turn_m[1],
        ),
    )
    lever_x, lever_y = turned(cos, sin, (at.cos, at.sin)), turned(cos, sin, (-at.sin, at.cos))
    for axis, row in enumerate(rows):
        row[LGPR_CLOCK], row[LGPR_LEVER_X], row[LGPR_LEVER_Y] = clock[axis], lever_x[axis], lever_y[axis]
        row[(LGPR_ERROR_X, LGPR_ERROR_Y)[axis]] = jnp.float32(1.0)
    turn_row = {YAW: jnp.float32(1.0), RATE_BIAS: age, LGPR_CLOCK: -rate}
    residual = jnp.stack(
        [
            observation.x_m - x - mean[LGPR_ERROR_X],
            observation.y_m - y - mean[LGPR_ERROR_Y],
            wrap_yaw(observation.yaw_rad - (mean[YAW] - age * rate)),
        ]
    )
    noise = observation.covariance
    # Of two parts each: a covariance that is none would make the estimate's one none as well.
    apart = noise**2 < jnp.diagonal(noise)[:, None] * jnp.diagonal(noise)[None, :]
    sound = jnp.all(jnp.diagonal(noise) > 0.0) & jnp.all(apart | jnp.eye(len(noise), dtype=bool))
    return innovation_of(residual, (*rows, turn_row), noise, usable(observation) & sound)


def _body_motion(estimate: NavEstimate, motion: MotionInput) -> tuple[Pair, Float[Array, ""], Float[Array, ""]]:
    """Cosine and sine of the yaw, forward speed, and yaw rate without the gyro's bias."""
    yaw = estimate.mean[YAW]
    return (jnp.cos(yaw), jnp.sin(yaw)), estimate.mean[SPEED], motion.yaw_rate_radps - estimate.mean[RATE_BIAS]


def _position(estimate: NavEstimate, at: Reach, age_s: Float[Array, ""], yaw: Pair) -> tuple[Pair, tuple[Row, Row]]:
    """Position of a body point before the tick's end, and its derivatives by pose, speed and bias."""
    cos, sin = yaw
    one = jnp.float32(1.0)
    x, y = turned(cos, sin, at.at_m)
    travel, turn = turned(cos, sin, at.by_travel), turned(cos, sin, at.by_turn_m)
    row_x = {X: one, YAW: -y, SPEED: -age_s * travel[0], RATE_BIAS: age_s * turn[0]}
    row_y = {Y: one, YAW: x, SPEED: -age_s * travel[1], RATE_BIAS: age_s * turn[1]}
    return (estimate.mean[X] + x, estimate.mean[Y] + y), (row_x, row_y)


def _clean(
    observation: GnssObservation | HeadingObservation | LgprObservation, age_s: Float[Array, ""]
) -> Float[Array, ""]:
    """The age, or zero if it is not finite."""
    return jnp.where(observation.valid & jnp.isfinite(age_s), age_s, 0.0)


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
        judged = weigh(estimate, innovation).nis
        fix, seen = _places(source, observations, innovation)
        verdict, gates = judge(rules, gates, source, innovation.offered, judged, fix, seen)
        opened = _let_go(source, estimate, innovation, verdict.reacquired)
        again = _innovation_of(source, model, opened, motion, observations)
        estimate = correct(opened, again, weigh(opened, again), verdict.accepted)
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
    return NavEstimate(*reopen(*estimate, moves, variances, reacquired))


# A whole drive at once: the filter forward, then back by Rauch, Tung and Striebel (1965).
#
# For labelling baselines and for judging the filter: every tick's estimate uses earlier and later observations. One
# drive per call; several of equal length by ``vmap``. A drive is padded by ticks of no length without observations,
# which change nothing.

# Added to a correlation matrix, whose diagonal is 1: the precision of its entries in float32.
_RIDGE = 1e-6


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

    def back(
        later: NavEstimate, tick: tuple[NavEstimate, MotionInput, Bool[Array, ""]]
    ) -> tuple[NavEstimate, NavEstimate]:
        smoothed = _step_back(model, later, *tick)
        return smoothed, smoothed

    last = jax.tree.map(lambda leaf: leaf[-1], filtered)
    before = jax.tree.map(lambda leaf: leaf[:-1], filtered)
    after = jax.tree.map(lambda leaf: leaf[1:], (motions, restarted))
    smoothed = jax.lax.scan(back, last, (before, *after), reverse=True)[1]
    whole: NavEstimate = jax.tree.map(lambda many, one: jnp.concatenate([many, one[None]]), smoothed, last)
    return whole


def _step_back(
    model: FilterModel, later: NavEstimate, filtered: NavEstimate, motion: MotionInput, restarted: Bool[Array, ""]
) -> NavEstimate:
    """The smoothed estimate a tick before ``later``; ``motion`` is that of the tick between."""
    predicted = predict(model, filtered, motion)
    transition = transition_matrix(transition_of(model, filtered, motion))
    noise = predict(model, filtered._replace(covariance=jnp.zeros_like(filtered.covariance)), motion).covariance
    sigma = jnp.sqrt(jnp.maximum(jnp.diagonal(predicted.covariance), 1e-20))
    identity = jnp.eye(sigma.size, dtype=sigma.dtype)
    correlation = predicted.covariance / (sigma[:, None] * sigma[None, :]) + _RIDGE * identity
    forward = transition @ filtered.covariance
    gain = jax.scipy.linalg.solve(correlation, forward / sigma[:, None], assume_a="pos").T / sigma[None, :]
    gain = jnp.where(restarted, 0.0, gain)
    # A sum of squares: rounding cannot make it indefinite, as the difference of the textbook's form would.
    kept = identity - gain @ transition
    covariance = kept @ filtered.covariance @ kept.T + gain @ (noise + later.covariance) @ gain.T
    mean = filtered.mean + gain @ (later.mean - predicted.mean)
    return NavEstimate(mean, 0.5 * (covariance + covariance.T))
