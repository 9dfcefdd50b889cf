"""The filter of a skid-steer vehicle over drawn drives: many lanes at once, one compilation a shape."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.navigation import (
    GateRules,
    SkidEstimate,
    SkidFilterInfo,
    SkidFilterState,
    SkidMotion,
    SkidObservations,
    default_skid_model,
    init_skid_filter,
    step_skid_filter,
)
from navigation.skid_drives import ANTENNA_X_M, ANTENNA_Y_M, TRACK_M

MODEL = default_skid_model(track_m=TRACK_M, gnss_x_m=ANTENNA_X_M, gnss_y_m=ANTENNA_Y_M)


class Filtered(NamedTuple):
    """What the filter made of drives; leading axes tick (or the last of each group of ticks) and run."""

    estimate: SkidEstimate
    since_fix_s: Float[Array, "tick run"]
    info: SkidFilterInfo


def begin(start_m: Float[np.ndarray, "run 2"]) -> SkidFilterState:
    """Filters at the start, one a run."""
    return jax.vmap(lambda at: init_skid_filter(MODEL, at[0], at[1]))(jnp.asarray(start_m, jnp.float32))


def filter_lanes(
    rules: GateRules, state: SkidFilterState, motions: SkidMotion, observations: SkidObservations, *, every: int = 1
) -> tuple[SkidFilterState, Filtered]:
    """All lanes through all ticks; of every ``every`` ticks the estimate at the end, and all infos."""
    groups = motions.step_s.shape[0] // every
    given = jax.tree.map(
        lambda leaf: leaf[: groups * every].reshape(groups, every, *leaf.shape[1:]), (motions, observations)
    )
    driven: tuple[SkidFilterState, Filtered] = scan_lanes(rules, state, given)
    return driven


@jax.jit
def scan_lanes(
    rules: GateRules, state: SkidFilterState, given: tuple[SkidMotion, SkidObservations]
) -> tuple[SkidFilterState, Filtered]:
    step = jax.vmap(step_skid_filter, in_axes=(None, None, 0, 0, 0))

    def one(
        state: SkidFilterState, tick: tuple[SkidMotion, SkidObservations]
    ) -> tuple[SkidFilterState, SkidFilterInfo]:
        after: tuple[SkidFilterState, SkidFilterInfo] = step(MODEL, rules, state, *tick)
        return after

    def group(state: SkidFilterState, ticks: tuple[SkidMotion, SkidObservations]) -> tuple[SkidFilterState, Filtered]:
        state, info = jax.lax.scan(one, state, ticks)
        return state, Filtered(state.estimate, state.gates.since_accepted_s[:, 0], info)

    driven: tuple[SkidFilterState, Filtered] = jax.lax.scan(group, state, given)
    return driven


def pose_errors(
    truth: Float[np.ndarray, "tick run 3"], estimate: SkidEstimate
) -> tuple[Float[np.ndarray, "tick run 3"], Float[np.ndarray, "tick run 3 3"]]:
    """Errors of x, y and yaw, the last within half a turn, and what the filter says of them."""
    error = truth - np.asarray(estimate.mean, np.float64)[..., :3]
    error[..., 2] = np.angle(np.exp(1j * error[..., 2]))
    return error, np.asarray(estimate.covariance, np.float64)[..., :3, :3]
