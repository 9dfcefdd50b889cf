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
from jaxtyping import Array, Float

from lgprjax.vehicle import VehiclePose

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


class SkidEstimate(NamedTuple):
    """Mean and covariance of the states, in the order of ``SKID_STATES``; the covariance is symmetric."""

    mean: Float[Array, "... 12"]
    covariance: Float[Array, "... 12 12"]


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
