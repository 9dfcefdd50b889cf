"""The first heading of a vehicle without a compass: driven straight, and told by pairs of fixes (MF section 2).

The vehicle's own way is reckoned in a frame of its own from wheels and INS. Fixes and the antenna's places in that
frame make pairs; the turn from the one to the other is the heading, whatever the lever of the antenna and whether the
vehicle went forward or back. The pairs share no fix and lie apart, so that the RMS about their mean tells an error.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lgprjax.navigation.arc_reach import reach, turned, wrap_yaw
from lgprjax.navigation.error_state import LARGEST_COURSE_RADPM
from lgprjax.navigation.skid_model import SkidModel
from lgprjax.vehicle import VehiclePose

PAIRS = 4
"""Headings in the history; twice as many fixes are kept."""
_ODD_LENGTH = 0.25
"""Fixes whose distance differs so much from the way driven tell of a receiver or of wheels, not of a heading."""


class HeadingStart(NamedTuple):
    """A straight way and its fixes, the newest last.

    Attributes:
        known: whether the filter's heading counts as known.
        own: pose of the midpoint in the frame of the way, which begins where the way does.
        time_s: since the way began.
        fix_m: the fixes kept.
        antenna_m: the antenna's places in the frame of the way then.
        own_yaw_rad: yaw in that frame then.
        fix_variance: what they reported, m², the mean of both axes.
        fix_s: when they were taken.
        taken: how many have been kept.
    """

    known: Bool[Array, "..."]
    own: VehiclePose
    time_s: Float[Array, "..."]
    fix_m: Float[Array, "... 8 2"]
    antenna_m: Float[Array, "... 8 2"]
    own_yaw_rad: Float[Array, "... 8"]
    fix_variance: Float[Array, "... 8"]
    fix_s: Float[Array, "... 8"]
    taken: Int[Array, "..."]


class Way(NamedTuple):
    """A tick's way by wheels and INS.

    Attributes:
        travel_m, turn_rad: of the body.
        slip_ahead_m: of the point that does not move aside.
        step_s: length of the tick.
    """

    travel_m: Float[Array, "..."]
    turn_rad: Float[Array, "..."]
    slip_ahead_m: Float[Array, "..."]
    step_s: Float[Array, "..."]


class KeptFix(NamedTuple):
    """A fix as the start sees it.

    Attributes:
        fix_m: position of the antenna.
        reach_m: forward and left of the midpoint at the tick's end, where the antenna was when it was taken.
        turned_rad: the body's turn from then to the tick's end.
        variance: that it reports, m².
        age_s: at the tick's end.
        offered: whether there is one.
    """

    fix_m: Float[Array, " 2"]
    reach_m: tuple[Float[Array, ""], Float[Array, ""]]
    turned_rad: Float[Array, ""]
    variance: Float[Array, ""]
    age_s: Float[Array, ""]
    offered: Bool[Array, ""]


class StartedHeading(NamedTuple):
    """What the pairs say.

    Attributes:
        yaw_rad: of the body at the tick's end.
        variance: rad².
        rms_rad: of the history about its mean.
        ready: a new fix completed a history that is to be believed.
    """

    yaw_rad: Float[Array, ""]
    variance: Float[Array, ""]
    rms_rad: Float[Array, ""]
    ready: Bool[Array, ""]


def init_heading_start() -> HeadingStart:
    """Nothing driven, nothing known."""
    zero, rows = jnp.float32(0.0), 2 * PAIRS
    many, places = jnp.zeros(rows, jnp.float32), jnp.zeros((rows, 2), jnp.float32)
    own = VehiclePose(zero, zero, zero)
    return HeadingStart(jnp.asarray(False), own, zero, places, places, many, many, many, jnp.int32(0))


def step_heading_start(
    model: SkidModel, start: HeadingStart, way: Way, fix: KeptFix, blind: Bool[Array, ""]
) -> tuple[HeadingStart, StartedHeading]:
    """One tick: the way goes on, begins anew where it bends, and takes a fix that lies far enough from the last.

    Args:
        model: of vehicle and sensors.
        start: so far.
        way: the tick's.
        fix: the tick's.
        blind: without INS: the way bends unseen as the sides slip.
    """
    moved = _drive(start, way)
    x, y = turned(jnp.cos(moved.own.yaw_rad), jnp.sin(moved.own.yaw_rad), fix.reach_m)
    antenna = jnp.stack([moved.own.x_m + x, moved.own.y_m + y])
    apart_m = jnp.hypot(*(antenna - moved.antenna_m[-1]))
    bend = jnp.abs(moved.own.yaw_rad - moved.own_yaw_rad[-1])
    straight = (moved.taken == 0) | (bend <= LARGEST_COURSE_RADPM * jnp.maximum(apart_m, model.start_pair_m))
    moved = moved._replace(taken=jnp.where(straight, moved.taken, 0))
    takes = fix.offered & ((moved.taken == 0) | (apart_m >= model.start_pair_m))
    kept = moved._replace(
        fix_m=_push(moved.fix_m, jnp.where(fix.offered, fix.fix_m, 0.0), takes),
        antenna_m=_push(moved.antenna_m, antenna, takes),
        own_yaw_rad=_push(moved.own_yaw_rad, moved.own.yaw_rad - fix.turned_rad, takes),
        fix_variance=_push(moved.fix_variance, fix.variance, takes),
        fix_s=_push(moved.fix_s, moved.time_s - fix.age_s, takes),
        taken=jnp.where(takes, jnp.minimum(moved.taken + 1, 2 * PAIRS), moved.taken),
    )
    found = _heading_of(model, kept, blind)
    return kept, found._replace(ready=found.ready & takes)


def _drive(start: HeadingStart, way: Way) -> HeadingStart:
    """The own pose a tick on; before the first fix the frame stays at the vehicle."""
    nowhere = jnp.zeros_like(way.travel_m)
    at = reach(way.travel_m, way.turn_rad, way.slip_ahead_m, nowhere, nowhere).at_m
    x, y = turned(jnp.cos(start.own.yaw_rad), jnp.sin(start.own.yaw_rad), at)
    begun = start.taken > 0
    ahead = VehiclePose(start.own.x_m + x, start.own.y_m + y, start.own.yaw_rad + way.turn_rad)
    own = VehiclePose(*(jnp.where(begun, value, 0.0) for value in ahead))
    return start._replace(own=own, time_s=jnp.where(begun, start.time_s + way.step_s, 0.0))


def _heading_of(model: SkidModel, start: HeadingStart, blind: Bool[Array, ""]) -> StartedHeading:
    """The mean turn from the pairs of the own frame to those of the fixes, and how far it can be trusted."""
    own = start.antenna_m[PAIRS:] - start.antenna_m[:PAIRS]
    seen = start.fix_m[PAIRS:] - start.fix_m[:PAIRS]
    crossed = own[:, 0] * seen[:, 1] - own[:, 1] * seen[:, 0]
    along = own[:, 0] * seen[:, 0] + own[:, 1] * seen[:, 1]
    offset = _direction(along.sum(), crossed.sum())
    rms = jnp.sqrt(jnp.mean(wrap_yaw(_direction(along, crossed) - offset) ** 2))
    own_m, seen_m = jnp.hypot(own[:, 0], own[:, 1]), jnp.hypot(seen[:, 0], seen[:, 1])
    as_long = jnp.all(jnp.abs(seen_m - own_m) <= _ODD_LENGTH * own_m)
    full = start.taken >= 2 * PAIRS
    base_m = jnp.where(full, jnp.maximum(own_m.mean(), model.start_pair_m), model.start_pair_m)
    apart_s = jnp.mean(start.fix_s[PAIRS:] - start.fix_s[:PAIRS])
    reported = start.fix_variance.mean()
    white = 2.0 * (1.0 - model.gnss_slow_share) * reported / PAIRS
    slow = -2.0 * model.gnss_slow_share * reported * jnp.expm1(-jnp.maximum(apart_s, 0.0) / model.gnss_slow_s)
    aside = model.side_noise**2 * base_m
    bent = jnp.where(blind, 2.0 * (model.slip_sigma * base_m / model.track_m) ** 2 + model.yaw_noise**2 * base_m, 0.0)
    variance = jnp.maximum((white + slow + aside) / (base_m * base_m) + bent, rms * rms / PAIRS)
    ready = full & as_long & (rms <= model.start_rms_rad)
    return StartedHeading(wrap_yaw(offset + start.own.yaw_rad), variance, rms, ready)


def _direction(along: Float[Array, "..."], crossed: Float[Array, "..."]) -> Float[Array, "..."]:
    """The angle between two directions, zero where there is none."""
    return jnp.arctan2(crossed, jnp.where((along == 0.0) & (crossed == 0.0), 1.0, along))


def _push(rows: Float[Array, "8 ..."], row: Float[Array, "..."], takes: Bool[Array, ""]) -> Float[Array, "8 ..."]:
    """The rows with a new one last where it is taken."""
    return jnp.where(takes, jnp.concatenate([rows[1:], row[None]]), rows)
