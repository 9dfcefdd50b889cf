"""The navigation filter: one tick of prediction, gates and updates."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.error_state import correct, predict, weigh
from lgprjax.navigation.filter_model import (
    GNSS_ERROR_X,
    GNSS_ERROR_Y,
    SPEED,
    YAW,
    FilterModel,
    NavEstimate,
    X,
    Y,
    init_estimate,
)
from lgprjax.navigation.gates import GateRules, GateState, advance_gates, count_conflict, init_gates, judge
from lgprjax.navigation.innovations import gnss_innovation, heading_innovation, lgpr_innovation, odometer_innovation
from lgprjax.navigation.kalman import Innovation, reopen
from lgprjax.navigation.observations import GNSS, HEADING, LGPR, ODOMETER, SOURCES, Motion, Observations
from lgprjax.vehicle import VehiclePose


class FilterState(NamedTuple):
    """The estimate at the tick's end and what the gates remember."""

    estimate: NavEstimate
    gates: GateState


class FilterInfo(NamedTuple):
    """What became of a tick's observations, by source in the order of ``SOURCES``.

    Attributes:
        nis: normalised innovation squared; zero where nothing was offered.
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
    model: FilterModel, rules: GateRules, state: FilterState, motion: Motion, observations: Observations
) -> tuple[FilterState, FilterInfo]:
    """One tick: the motion, then each source in turn past its gate. One lane; hundreds under ``vmap``.

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
    source: int, model: FilterModel, estimate: NavEstimate, motion: Motion, observations: Observations
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
    """The position observed and the one expected, for the sources that observe one."""
    if source not in (GNSS, LGPR):
        return jnp.zeros(2), jnp.zeros(2)
    slot = observations.gnss if source == GNSS else observations.lgpr
    fix = jnp.where(innovation.offered, jnp.stack([slot.x_m, slot.y_m]), 0.0)
    return fix, fix - innovation.residual[:2]


def _let_go(source: int, estimate: NavEstimate, innovation: Innovation, reacquired: Bool[Array, ""]) -> NavEstimate:
    """The estimate with the states that a source observes directly moved by what it says, and known only from now on.

    Their covariances go, and their variances become a hundred times that of the observation, plus a square metre, 0.04
    square radians or 1 m²/s²: so much larger than what the update leaves of them that they hold no weight, and not so
    large that float32 loses it.
    """
    letting = {GNSS: (X, Y), HEADING: (YAW,), ODOMETER: (SPEED,), LGPR: (X, Y, YAW)}[source]
    moves = {state: innovation.residual[part] for part, state in enumerate(letting)}
    variances = {
        state: (0.04 if state == YAW else 1.0) + 100.0 * innovation.noise[part, part]
        for part, state in enumerate(letting)
    }
    return NavEstimate(*reopen(*estimate, moves, variances, reacquired))
