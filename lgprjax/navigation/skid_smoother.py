"""The estimate of a skid-steer vehicle smoothed: a forward pass of the filter, and one back (Rauch et al. 1965).

A record may know what the vehicle could not: the fix at the end of a drop-out tells of the way to it. A tick of the
filter is more than a step and a measurement. The count of the turn starts anew with each delta heading, so the count
before it is told by the other states and by what it was; and where a state was let go (a heading that started, a fix
that was followed against the estimate, another receiver) nothing is carried back across.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.navigation import kalman
from lgprjax.navigation.observations import GNSS, HEADING, GateRules
from lgprjax.navigation.skid_filter import (
    SkidFilterInfo,
    SkidFilterState,
    hear_turn,
    other_receiver,
    step_skid_filter,
)
from lgprjax.navigation.skid_model import (
    SKID_STATES,
    TURNED,
    SkidEstimate,
    SkidModel,
    SkidMotion,
    SkidObservations,
    skid_transition,
)

_OTHERS = np.array([each for each in range(len(SKID_STATES)) if each != TURNED])


class SmoothedDrive(NamedTuple):
    """A drive, forward and back; a leading axis of ticks.

    Attributes:
        filtered: as it was live; smoothed: with all that came later.
        info: of the forward pass.
        broken: ticks across which nothing is carried back.
        jump_m: by how much a fix that was followed against the estimate moved it; else 0.
    """

    filtered: SkidEstimate
    smoothed: SkidEstimate
    info: SkidFilterInfo
    broken: Bool[Array, " tick"]
    jump_m: Float[Array, " tick"]


class _Tick(NamedTuple):
    """What the way back needs of a tick: its motion, and the stages after it."""

    motion: SkidMotion
    counted: SkidEstimate
    ends: Bool[Array, ""]
    followed: Bool[Array, ""]
    broken: Bool[Array, ""]


def smooth_skid(
    model: SkidModel,
    rules: GateRules,
    start: SkidFilterState,
    motions: SkidMotion,
    observations: SkidObservations,
) -> SmoothedDrive:
    """A drive smoothed; unbatched, use ``vmap`` for more.

    Args:
        model, rules: of the filter.
        start: its state before the first tick.
        motions, observations: of each tick.
    """

    def forward(state: SkidFilterState, tick: tuple[SkidMotion, SkidObservations]) -> tuple[SkidFilterState, tuple]:  # type: ignore[type-arg]
        motion, observed = tick
        finite, turned = hear_turn(model, rules, state, motion, observed.delta_heading)
        after, info = step_skid_filter(model, rules, state, motion, observed)
        one, other = state.last.fix_variance, after.last.fix_variance
        changed = other_receiver(other, one)
        broken = info.reacquired[GNSS] | info.heading_started | info.heading_restarted | changed
        broken = broken | ~info.heading_known | ~state.start.known
        moved = after.estimate.mean[:2] - turned.estimate.mean[:2]
        jump_m = jnp.where(info.reacquired[GNSS] & state.start.known, jnp.hypot(moved[0], moved[1]), 0.0)
        kept = _Tick(finite, turned.counted, turned.ends, info.reacquired[HEADING], broken)
        return after, (after.estimate, info, kept, jump_m)

    _, (filtered, info, ticks, jump_m) = jax.lax.scan(forward, start, (motions, observations))
    smoothed = kalman.smooth(filtered, lambda *args: _step_back(model, *args), (ticks,))
    return SmoothedDrive(filtered, smoothed, info, ticks.broken, jump_m)


def contradicted_m(drive: SmoothedDrive) -> Float[np.ndarray, " tick"]:
    """By how much later evidence contradicts each tick's estimate: one drive's, on the host.

    A fix that is followed against the estimate says that it was wrong some time since the last fix that was believed:
    of all that time no more is claimed than a position as uncertain as the jump.
    """
    accepted = np.asarray(drive.info.accepted)[:, GNSS]
    jump_m = np.asarray(drive.jump_m)
    wrong = np.zeros(len(jump_m))
    for tick in np.flatnonzero(jump_m > 0.0):
        earlier = np.flatnonzero(accepted[:tick])
        begin = int(earlier[-1]) if len(earlier) else 0
        wrong[begin : tick + 1] = np.maximum(wrong[begin : tick + 1], jump_m[tick])
    return wrong


def _step_back(model: SkidModel, later: SkidEstimate, before: SkidEstimate, tick: _Tick) -> SkidEstimate:
    """The smoothed estimate a tick before ``later``."""
    transition = skid_transition(model, before, tick.motion)
    predicted = kalman.predict(before.covariance, transition)
    # A turn that the INS was followed in against the wheels is one that the filter was told, with doubt added.
    doubt = jnp.where(tick.followed, jnp.diagonal(tick.counted.covariance - predicted.covariance), 0.0)
    transition = transition._replace(
        mean=jnp.where(tick.followed, tick.counted.mean, transition.mean),
        noise=transition.noise + jnp.diag(jnp.maximum(doubt, 0.0)),
    )
    return kalman.wrapped(kalman.step_back(_before_count(later, tick), before, transition, tick.broken))


def _before_count(later: SkidEstimate, tick: _Tick) -> SkidEstimate:
    """The smoothed estimate before the count of the turn started anew: of the count by what the others tell."""
    filtered = tick.counted
    others = filtered.covariance[_OTHERS][:, _OTHERS]
    row = kalman.regression(others, filtered.covariance[_OTHERS][:, TURNED : TURNED + 1])[0]
    told = jnp.zeros((len(SKID_STATES), len(_OTHERS)), jnp.float32)
    told = told.at[_OTHERS, np.arange(len(_OTHERS))].set(1.0).at[TURNED].set(row)
    rest = jnp.maximum(filtered.covariance[TURNED, TURNED] - row @ others @ row, 0.0)
    mean = filtered.mean + told @ kalman.apart(later.mean, filtered.mean)[_OTHERS]
    covariance = told @ later.covariance[_OTHERS][:, _OTHERS] @ told.T
    covariance = covariance.at[TURNED, TURNED].add(rest)
    return SkidEstimate(jnp.where(tick.ends, mean, later.mean), jnp.where(tick.ends, covariance, later.covariance))
