"""The Husky's own fusion (LL): the LGPR-corrected pose while the correlation is good enough, else that of GNSS/INS.

A good fix replaces the pose; between fixes it is carried by dead reckoning. What LL leaves open is set here. Whether a
fix is good enough is judged by the probability that ground which is not the map's would have matched as well: what a
correlation is worth differs from ground to ground. A fix must be better to take over than to stay, and after the last
good fix it is carried for a while before GNSS/INS has the word again. The pose jumps where the sources differ: the
drifting frame takes care of that, as with any other estimate.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.drifting_frame import step_local
from lgprjax.navigation.observations import LgprObservation, Motion
from lgprjax.vehicle import VehiclePose

_HYSTERESIS = 0.01
"""To take over, a match must be false with a hundredth of the probability that lets it stay. At a risk of 1e-4 two
decades are about one standard deviation of a normal noise floor: its tail falls there by 1.9 decades each, by 2.3 where
the match is the best of some hundred places."""


class SwitchSettings(NamedTuple):
    """When to believe which source, and where the array stands. Scalars.

    Attributes:
        enter_p_false: probability of a false match up to which a fix lets LGPR take over.
        stay_p_false: up to which it is good enough once LGPR has the word; at least ``enter_p_false``.
        hold_s: after the last good fix, the pose is carried for so long.
        zero_slip_m: from the rear axle forward to the point that moves along the body axis.
        array_x_m, array_y_m: the array's centre in the body, forward and left of the rear axle.
    """

    enter_p_false: Float[Array, "..."]
    stay_p_false: Float[Array, "..."]
    hold_s: Float[Array, "..."]
    zero_slip_m: Float[Array, "..."]
    array_x_m: Float[Array, "..."]
    array_y_m: Float[Array, "..."]


class SwitchState(NamedTuple):
    """What is carried from tick to tick; ``pose`` is the answer.

    Attributes:
        pose: of the rear axle in the map's frame: the carried one on LGPR, else that of GNSS/INS.
        on_lgpr: which.
        carried: the last good fix, dead reckoned to now; without meaning while off LGPR.
        since_good_s: since that fix arrived; infinite before the first.
    """

    pose: VehiclePose
    on_lgpr: Bool[Array, "..."]
    carried: VehiclePose
    since_good_s: Float[Array, "..."]


def switch_settings(
    risk: float, *, zero_slip_m: Float[Array, "..."], array_x_m: Float[Array, "..."], array_y_m: Float[Array, "..."]
) -> SwitchSettings:
    """The switch at the risk of a fix; the last good one is carried for a second. Geometry: see ``SwitchSettings``."""
    enter, stay, hold = (jnp.float32(value) for value in (_HYSTERESIS * risk, risk, 1.0))
    return SwitchSettings(enter, stay, hold, zero_slip_m, array_x_m, array_y_m)


def init_switch(gnss_ins_pose: VehiclePose) -> SwitchState:
    """On GNSS/INS, no fix seen yet."""
    off = jnp.zeros(jnp.shape(gnss_ins_pose.x_m), bool)
    return SwitchState(gnss_ins_pose, off, gnss_ins_pose, jnp.where(off, 0.0, jnp.inf).astype(jnp.float32))


def step_switch(
    settings: SwitchSettings,
    state: SwitchState,
    motion: Motion,
    speed_mps: Float[Array, "..."],
    gnss_ins_pose: VehiclePose,
    lgpr: LgprObservation,
    p_false: Float[Array, "..."],
) -> SwitchState:
    """The state after a tick.

    Args:
        settings: thresholds and geometry.
        state: before the tick.
        motion: yaw rate and length of the tick.
        speed_mps: forward, by the odometer.
        gnss_ins_pose: of the rear axle at the tick's end, as GNSS/INS have it.
        lgpr: the tick's fix of the array's centre, if there is one; brought forward by its age.
        p_false: probability that ground which is not the map's would have matched as well as the fix; where it is NaN,
            no fix is good enough.
    """
    rate, slip = motion.yaw_rate_radps, settings.zero_slip_m
    carried = step_local(state.carried, speed_mps, rate, slip, motion.step_s)
    cos, sin = jnp.cos(lgpr.yaw_rad), jnp.sin(lgpr.yaw_rad)
    seen = VehiclePose(
        lgpr.x_m - cos * settings.array_x_m + sin * settings.array_y_m,
        lgpr.y_m - sin * settings.array_x_m - cos * settings.array_y_m,
        lgpr.yaw_rad,
    )
    now = step_local(seen, speed_mps, rate, slip, lgpr.age_s)
    asked = jnp.where(state.on_lgpr, settings.stay_p_false, settings.enter_p_false)
    good = lgpr.valid & (p_false <= asked)
    carried = VehiclePose(*(jnp.where(good, new, old) for new, old in zip(now, carried, strict=True)))
    since_s = jnp.where(good, lgpr.age_s, state.since_good_s + motion.step_s)
    # Off LGPR only a fix that is good enough to take over leads back to it.
    on_lgpr = good | (state.on_lgpr & (since_s <= settings.hold_s))
    pose = VehiclePose(*(jnp.where(on_lgpr, ours, other) for ours, other in zip(carried, gnss_ins_pose, strict=True)))
    return SwitchState(pose, on_lgpr, carried, since_s)
