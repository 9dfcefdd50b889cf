"""What the filter of a skid-steer vehicle believes of vehicle and sensors: 12 states, their noises, the estimate.

| state | what it is |
| --- | --- |
| x, y, yaw | pose of the track's midpoint in the local east-north frame; the yaw is kept within half a turn of zero |
| turned | how far the body has turned since the INS last spoke: a delta heading observes it whatever the tick |
| scale | the ground passes under both sides by one plus this times what the wheels say |
| turn scale | in a turn the body turns by one plus this times what wheels and nominal track say |
| slip left, right | of either side, beside the scale: Gauss-Markov processes over the side's way |
| slip ahead | the point of the body that does not move aside in a turn stands so far before the midpoint |
| drift | the INS turns the heading by this a second |
| slow error x, y | the part of the GNSS error that stays for minutes, in its sigmas: Gauss-Markov over time |

All is float32 on the device. ``turned`` is a difference of headings kept as a state of its own: the difference of two
yaws known to a degree would lose the microradians that the INS resolves.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation import kalman
from lgprjax.navigation.kalman import reach, turned, wrap_yaw
from lgprjax.navigation.observations import GnssObservation
from lgprjax.vehicle import VehiclePose, WheelSpeeds, body_rates

SKID_STATES = (
    "x_m",
    "y_m",
    "yaw_rad",
    "turned_rad",
    "scale",
    "turn_scale",
    "slip_left",
    "slip_right",
    "slip_ahead_m",
    "drift_radps",
    "slow_error_x",
    "slow_error_y",
)
"""Names of the states, in order."""
X, Y, YAW, TURNED, SCALE, TURN_SCALE, SLIP_LEFT, SLIP_RIGHT, SLIP_AHEAD, DRIFT, SLOW_X, SLOW_Y = range(12)

UNKNOWN_YAW_VARIANCE = 3.29
"""Of a heading that may be any, rad²: a twelfth of a full turn squared."""


class SkidModel(NamedTuple):
    """Geometry and noises of the filter. Every field is a float32 scalar that may be traced and tuned.

    Noises grow with the way driven, which is speed times step (MF section 2), and with the time for the sensors.

    Attributes:
        track_m: nominal effective track.
        gnss_x_m, gnss_y_m: antenna in the body, forward and left of the track's midpoint.
        along_noise, side_noise: random walk of the position along and across the body axis, m/√m.
        yaw_noise, yaw_rest_noise: random walk of the yaw against the wheels, rad/√m, and rad/√s even at rest.
        scale_walk: 1/√m.
        turn_scale_walk: 1/√rad of turn.
        least_turn_radps: well below it what the wheels differ by is noise, of which no turn scale is to be learnt.
        slip_sigma, slip_m: standard deviation and correlation length of either side's slip.
        slip_ahead_walk_m: m/√rad of turn.
        ins_noise: white noise of the INS heading rate, rad/√s.
        ins_clock_s: standard deviation of where in a tick a delta heading ends.
        drift_walk: rad/s/√s.
        fastest_turn_radps: a delta heading beyond it is no turn of this vehicle.
        gnss_slow_share: of the variance that a fix reports, the part that is slow; the rest is white.
        gnss_slow_s: correlation time of the slow part.
        oldest_fix_s: older fixes are not used.
        initial_position_m, initial_scale, initial_turn_scale, initial_slip_ahead_m, initial_drift_radps: standard
            deviations at the start; the heading is unknown then.
        start_pair_m: least way between two fixes of the heading start.
        start_rms_rad: largest RMS of its headings (MF: 1.5°).
        lost_yaw_rad: standard deviation of the heading from which on it counts as unknown and is started anew.
        contradiction_rad: a heading that straight fixes contradict by more, and by 4 sigmas, is started anew.
        gnss_scale: by which the sigma that a fix reports is multiplied.
        ins_turn_noise: of the INS, with the turn: rad/√rad.
    """

    track_m: Float[Array, "..."]
    gnss_x_m: Float[Array, "..."]
    gnss_y_m: Float[Array, "..."]
    along_noise: Float[Array, "..."]
    side_noise: Float[Array, "..."]
    yaw_noise: Float[Array, "..."]
    yaw_rest_noise: Float[Array, "..."]
    scale_walk: Float[Array, "..."]
    turn_scale_walk: Float[Array, "..."]
    least_turn_radps: Float[Array, "..."]
    slip_sigma: Float[Array, "..."]
    slip_m: Float[Array, "..."]
    slip_ahead_walk_m: Float[Array, "..."]
    ins_noise: Float[Array, "..."]
    ins_clock_s: Float[Array, "..."]
    drift_walk: Float[Array, "..."]
    fastest_turn_radps: Float[Array, "..."]
    gnss_slow_share: Float[Array, "..."]
    gnss_slow_s: Float[Array, "..."]
    oldest_fix_s: Float[Array, "..."]
    initial_position_m: Float[Array, "..."]
    initial_scale: Float[Array, "..."]
    initial_turn_scale: Float[Array, "..."]
    initial_slip_ahead_m: Float[Array, "..."]
    initial_drift_radps: Float[Array, "..."]
    start_pair_m: Float[Array, "..."]
    start_rms_rad: Float[Array, "..."]
    lost_yaw_rad: Float[Array, "..."]
    contradiction_rad: Float[Array, "..."]
    gnss_scale: Float[Array, "..."]
    ins_turn_noise: Float[Array, "..."]


SkidEstimate = kalman.Estimate
"""Of the states in the order of ``SKID_STATES``."""


def default_skid_model(*, track_m: float, gnss_x_m: float, gnss_y_m: float) -> SkidModel:
    """A model for a slow tracked or wheeled machine with RTK GNSS and an INS as in MF; the geometry has no default.

    The INS drifts by 1.8 µrad in 0.1 s (MF) with 30 µrad of noise in that time. The other noises are assumptions of the
    usual size, not identified on a vehicle: wheels off by 2 %, each side slipping by 1.5 % over some 10 m, a track that
    is not known better than 15 %, 5 mm of side slip in a metre, and fixes of which two fifths of the variance that they
    report stay for a minute.

    Args:
        track_m: nominal effective track.
        gnss_x_m, gnss_y_m: antenna in the body, forward and left of the track's midpoint.
    """
    return SkidModel(
        track_m=jnp.float32(track_m),
        gnss_x_m=jnp.float32(gnss_x_m),
        gnss_y_m=jnp.float32(gnss_y_m),
        along_noise=jnp.float32(0.003),
        side_noise=jnp.float32(0.005),
        yaw_noise=jnp.float32(0.004),
        yaw_rest_noise=jnp.float32(0.001),
        scale_walk=jnp.float32(1e-4),
        turn_scale_walk=jnp.float32(0.005),
        least_turn_radps=jnp.float32(0.05),
        slip_sigma=jnp.float32(0.015),
        slip_m=jnp.float32(10.0),
        slip_ahead_walk_m=jnp.float32(0.003),
        ins_noise=jnp.float32(1e-4),
        ins_clock_s=jnp.float32(0.002),
        drift_walk=jnp.float32(1e-6),
        fastest_turn_radps=jnp.float32(2.0),
        gnss_slow_share=jnp.float32(0.4),
        gnss_slow_s=jnp.float32(60.0),
        oldest_fix_s=jnp.float32(1.0),
        initial_position_m=jnp.float32(1.0),
        initial_scale=jnp.float32(0.02),
        initial_turn_scale=jnp.float32(0.15),
        initial_slip_ahead_m=jnp.float32(0.1),
        initial_drift_radps=jnp.float32(1.8e-5),
        start_pair_m=jnp.float32(0.5),
        start_rms_rad=jnp.float32(0.02618),
        lost_yaw_rad=jnp.float32(0.0873),
        contradiction_rad=jnp.float32(0.0873),
        gnss_scale=jnp.float32(1.0),
        ins_turn_noise=jnp.float32(0.0),
    )


def cautious_skid_model(*, track_m: float, gnss_x_m: float, gnss_y_m: float) -> SkidModel:
    """The model that vehicles drive with: noises that hold where ground and sensors follow none of its laws.

    Slopes, soil and the tool's load slip more than ``default_skid_model`` has it, GNSS has bursts that it does not tell
    of, the INS a scale of its own. The numbers make the normalised error squared of ``scene.other_laws`` about one in
    the mean over drawn fields (``docs/worked_area.md``).

    Args:
        track_m, gnss_x_m, gnss_y_m: as for ``default_skid_model``.
    """
    return default_skid_model(track_m=track_m, gnss_x_m=gnss_x_m, gnss_y_m=gnss_y_m)._replace(
        side_noise=jnp.float32(0.015),
        along_noise=jnp.float32(0.010),
        yaw_noise=jnp.float32(0.006),
        slip_sigma=jnp.float32(0.025),
        initial_drift_radps=jnp.float32(1e-4),
        drift_walk=jnp.float32(3e-6),
        gnss_scale=jnp.float32(1.4),
        ins_turn_noise=jnp.float32(0.002),
    )


def init_skid_estimate(model: SkidModel, x_m: Float[Array, ""], y_m: Float[Array, ""]) -> SkidEstimate:
    """The estimate at the start: a position within the model's sigma, and a heading that may be any."""
    variances = jnp.zeros(len(SKID_STATES), jnp.float32)
    variances = variances.at[X].set(model.initial_position_m**2).at[Y].set(model.initial_position_m**2)
    variances = variances.at[YAW].set(UNKNOWN_YAW_VARIANCE).at[SCALE].set(model.initial_scale**2)
    variances = variances.at[TURN_SCALE].set(model.initial_turn_scale**2)
    variances = variances.at[SLIP_LEFT].set(model.slip_sigma**2).at[SLIP_RIGHT].set(model.slip_sigma**2)
    variances = variances.at[SLIP_AHEAD].set(model.initial_slip_ahead_m**2).at[DRIFT].set(model.initial_drift_radps**2)
    variances = variances.at[SLOW_X].set(1.0).at[SLOW_Y].set(1.0)
    return SkidEstimate(jnp.zeros(len(SKID_STATES), jnp.float32).at[X].set(x_m).at[Y].set(y_m), jnp.diag(variances))


def skid_pose(estimate: SkidEstimate) -> VehiclePose:
    """Pose of the track's midpoint; while the heading is unknown its yaw says nothing."""
    return VehiclePose(estimate.mean[..., X], estimate.mean[..., Y], estimate.mean[..., YAW])


def skid_pose_covariance(estimate: SkidEstimate) -> Float[Array, "... 3 3"]:
    """Covariance of x, y and yaw."""
    return estimate.covariance[..., : YAW + 1, : YAW + 1]


# What the filter of a skid-steer vehicle is given in a tick: wheel speeds, and at most one fix and one delta heading.
#
# Each source comes at its own rate and time (MF section 2): wheels every tick, the INS ten times a second, GNSS once.
# A slot that is not valid may hold anything, NaN too.


class SkidMotion(NamedTuple):
    """Wheel speeds as measured, means over the tick.

    Attributes:
        left_mps, right_mps: negative backwards.
        step_s: length of the tick.
    """

    left_mps: Float[Array, "..."]
    right_mps: Float[Array, "..."]
    step_s: Float[Array, "..."]


class DeltaHeading(NamedTuple):
    """How far the INS says that the body has turned, counter-clockwise.

    Attributes:
        turn_rad: since the one before it.
        span_s: the time from that one to this one, by the INS.
        valid: whether one ended within the tick.
    """

    turn_rad: Float[Array, "..."]
    span_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class SkidObservations(NamedTuple):
    """A tick's slots."""

    gnss: GnssObservation
    delta_heading: DeltaHeading


def no_skid_observations() -> SkidObservations:
    """One lane's slots, both empty."""
    zero, no = jnp.float32(0.0), jnp.asarray(False)
    return SkidObservations(
        GnssObservation(zero, zero, jnp.eye(2, dtype=jnp.float32), zero, no), DeltaHeading(zero, zero, no)
    )


# How the states of a skid-steer vehicle move on by a tick: the exact arc, and its noise.
#
# The wheels say how far each side went; scale, slip and turn scale say what the ground saw of it. Noise grows with the
# way, so with speed and step (MF section 2), and a vehicle that stands hardly grows less certain.


def skid_rates(
    model: SkidModel, estimate: SkidEstimate, motion: SkidMotion
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Forward speed, m/s, and yaw rate, rad/s, as the estimate has them from the wheel speeds."""
    mean = estimate.mean
    over_ground = WheelSpeeds(
        motion.left_mps * (1.0 + mean[SCALE] + mean[SLIP_LEFT]),
        motion.right_mps * (1.0 + mean[SCALE] + mean[SLIP_RIGHT]),
    )
    speed_mps, yaw_rate_radps = body_rates(model.track_m, over_ground)
    return speed_mps, yaw_rate_radps * (1.0 + _turn_share(model, motion) * mean[TURN_SCALE])


def skid_transition(model: SkidModel, estimate: SkidEstimate, motion: SkidMotion) -> kalman.Transition:
    """A tick at the estimate before it.

    Args:
        model: of vehicle and sensors.
        estimate: at the tick's start.
        motion: the tick's; its numbers are finite.
    """
    step = motion.step_s
    sides_m = jnp.abs(jnp.stack([motion.left_mps, motion.right_mps])) * step
    way, turns = sides_m.mean(), jnp.abs(motion.right_mps - motion.left_mps) * step / model.track_m
    slips, slow = sides_m / model.slip_m, step / model.gnss_slow_s
    none = jnp.zeros_like(slips)
    # A tick in correlation lengths or times of the states after the pose; none for those that do not fade.
    ages = jnp.concatenate([none, slips, none, jnp.stack([slow, slow])])

    def move(mean: Float[Array, " 12"], noise: Float[Array, " 11"]) -> Float[Array, " 12"]:
        speed_mps, yaw_rate_radps = skid_rates(model, estimate._replace(mean=mean), motion)
        turn = yaw_rate_radps * step + noise[0]
        nowhere = jnp.zeros_like(turn)
        at = reach(speed_mps * step, turn, mean[SLIP_AHEAD], nowhere, nowhere)
        x, y = turned(jnp.cos(mean[YAW]), jnp.sin(mean[YAW]), at)
        yaw = wrap_yaw(mean[YAW] + turn)
        along, left = turned(jnp.cos(yaw), jnp.sin(yaw), (noise[1], noise[2]))
        pose = jnp.stack([mean[X] + x + along, mean[Y] + y + left, yaw, mean[TURNED] + turn])
        return jnp.concatenate([pose, mean[SCALE:] * jnp.exp(-ages) + noise[3:]])

    fresh = -jnp.expm1(-2.0 * ages)
    variances = jnp.stack([
        model.yaw_noise**2 * way + model.yaw_rest_noise**2 * step,
        model.along_noise**2 * way,
        model.side_noise**2 * way,
        model.scale_walk**2 * way,
        model.turn_scale_walk**2 * turns,
        model.slip_sigma**2 * fresh[SLIP_LEFT - SCALE],
        model.slip_sigma**2 * fresh[SLIP_RIGHT - SCALE],
        model.slip_ahead_walk_m**2 * turns,
        model.drift_walk**2 * step,
        fresh[SLOW_X - SCALE],
        fresh[SLOW_Y - SCALE],
    ])  # fmt: skip
    return kalman.linearise(move, estimate.mean, jnp.sqrt(variances))


def predict_skid(model: SkidModel, estimate: SkidEstimate, motion: SkidMotion) -> SkidEstimate:
    """The estimate a tick later, before its observations."""
    return kalman.predict(estimate.covariance, skid_transition(model, estimate, motion))


def _turn_share(model: SkidModel, motion: SkidMotion) -> Float[Array, ""]:
    """How much of the turn scale holds: all of it in a turn, nothing where the sides differ by no more than noise.

    A factor fitted to noise would be drawn to minus one on every straight line.
    """
    square = ((motion.right_mps - motion.left_mps) / model.track_m) ** 2
    return square / (square + model.least_turn_radps**2)
