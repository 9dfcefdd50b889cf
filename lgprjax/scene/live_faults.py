"""What goes wrong with the sensors of a closed loop, and when."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class SensorFaults(NamedTuple):
    """Faults by time since the start of the drive: intervals [from, to) in seconds, or a moment from which they last.

    Attributes:
        gnss_lost_s: no positions.
        gnss_frozen_s: the receiver repeats its last one.
        gnss_jump_s, gnss_jump_m: from this moment on positions are wrong by this, east and north.
        gnss_drift_s, gnss_drift_mps: from this moment on they drift away, as by a spoofer.
        heading_lost_s: no INS heading.
        odometer_lost_s: no odometry.
        slip_s, slip: the wheels turn by this share more than the ground passes.
        lgpr_lost_s: no scans.
        lgpr_wrong_s, lgpr_wrong_m: fixes lie on a wrong place, confidently, east and north.
        lgpr_faded_s, lgpr_faded: the strength of every match falls to this share; how far above the noise floor
            that is decides whether fixes fail.
    """

    gnss_lost_s: Float[Array, "... 2"]
    gnss_frozen_s: Float[Array, "... 2"]
    gnss_jump_s: Float[Array, "..."]
    gnss_jump_m: Float[Array, "... 2"]
    gnss_drift_s: Float[Array, "..."]
    gnss_drift_mps: Float[Array, "... 2"]
    heading_lost_s: Float[Array, "... 2"]
    odometer_lost_s: Float[Array, "... 2"]
    slip_s: Float[Array, "... 2"]
    slip: Float[Array, "..."]
    lgpr_lost_s: Float[Array, "... 2"]
    lgpr_wrong_s: Float[Array, "... 2"]
    lgpr_wrong_m: Float[Array, "... 2"]
    lgpr_faded_s: Float[Array, "... 2"]
    lgpr_faded: Float[Array, "..."]


def no_faults() -> SensorFaults:
    """Nothing goes wrong; ``_replace`` what should."""
    never, nothing = jnp.full(2, jnp.inf, jnp.float32), jnp.zeros(2, jnp.float32)
    late, zero, one = jnp.float32(jnp.inf), jnp.float32(0.0), jnp.float32(1.0)
    return SensorFaults(
        never, never, late, nothing, late, nothing, never, never, never, zero, never, never, nothing, never, one
    )


def during(interval_s: Float[Array, "2"], time_s: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether a moment lies in an interval."""
    return (time_s >= interval_s[0]) & (time_s < interval_s[1])
