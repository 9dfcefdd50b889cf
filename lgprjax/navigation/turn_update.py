"""A delta heading against the estimate of a skid-steer vehicle: believed, whatever the wheels say, but not blindly.

Wheels slip, so a turn beyond the gate is the INS's; what the two disagree by stays in doubt, so that an INS that lies
costs the heading and not the truth.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.arc_reach import wrap_yaw
from lgprjax.navigation.gates import GateRules, GateState, judge
from lgprjax.navigation.kalman import correct, reopen, weigh
from lgprjax.navigation.observations import HEADING
from lgprjax.navigation.skid_innovations import InsEpoch, hear, turn_innovation
from lgprjax.navigation.skid_model import SKID_STATES, TURNED, YAW, SkidEstimate, SkidModel
from lgprjax.navigation.skid_motion import skid_rates
from lgprjax.navigation.skid_observations import DeltaHeading, SkidMotion

IS_YAW = np.arange(len(SKID_STATES)) == YAW
"""Picks the yaw among the states."""


class Fate(NamedTuple):
    """What became of one observation.

    Attributes:
        nis: normalised innovation squared; zero where nothing was offered.
        offered: valid, finite, new and in time.
        accepted: used.
        reacquired: used although beyond the gate.
    """

    nis: Float[Array, ""]
    offered: Bool[Array, ""]
    accepted: Bool[Array, ""]
    reacquired: Bool[Array, ""]


class Turned(NamedTuple):
    """Estimate, gates and the end of the last delta heading after a tick's, and what became of it."""

    estimate: SkidEstimate
    gates: GateState
    epoch: InsEpoch
    fate: Fate


def update_turn(
    model: SkidModel,
    rules: GateRules,
    estimate: SkidEstimate,
    gates: GateState,
    epoch: InsEpoch,
    motion: SkidMotion,
    delta: DeltaHeading,
) -> Turned:
    """The estimate after the tick's delta heading, if there is one, and the count of the next one's turn.

    Args:
        model, rules: of the filter.
        estimate, gates, epoch: at the tick's end, before it.
        motion: the tick's; its numbers are finite.
        delta: may hold anything where it is not valid.
    """
    heard = hear(model, epoch, motion, delta)
    innovation = turn_innovation(model, estimate, motion, epoch, delta, heard)
    weighed = weigh(estimate.covariance, innovation)
    nowhere = jnp.zeros(2, jnp.float32)
    verdict, gates = judge(rules, gates, HEADING, heard.usable, weighed.nis, nowhere, nowhere)
    mean, covariance = correct(*estimate, innovation, weighed, verdict.accepted & ~verdict.reacquired)
    # Beyond the gate the wheels learn nothing from it, and half of what the two disagree by is added to the sigma
    # itself, not to its square: disagreements of one cause have one sign.
    apart = jnp.where(verdict.reacquired, innovation.residual[0], 0.0)
    half, sigma = 0.5 * jnp.abs(apart), jnp.sqrt(jnp.maximum(covariance[YAW, YAW], 0.0))
    mean = jnp.where(IS_YAW, wrap_yaw(mean + apart), mean)
    covariance = covariance + jnp.diag(jnp.where(IS_YAW, half * (half + 2.0 * sigma), 0.0))
    _, yaw_rate_radps = skid_rates(model, SkidEstimate(mean, covariance), motion)
    begun = heard.late_s * yaw_rate_radps - mean[TURNED]
    mean, covariance = reopen(mean, covariance, {TURNED: begun}, {TURNED: jnp.zeros_like(begun)}, heard.ends)
    ended = InsEpoch(
        jnp.where(heard.ends, heard.late_s, epoch.since_s),
        jnp.where(heard.ends, yaw_rate_radps, epoch.yaw_rate_radps),
    )
    fate = Fate(weighed.nis, heard.usable, verdict.accepted, verdict.reacquired)
    return Turned(SkidEstimate(mean, covariance), gates, ended, fate)
