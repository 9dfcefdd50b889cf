"""The pass that is being driven: its last strips, each with the pose and the error that places were crossed with."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.coverage.tool import Tool, ToolMoment, tool_centre

STRIPS = 32
"""Kept of a pass."""
_LARGEST_HEADING_RAD = 0.06
"""Sigma of the heading beyond which nothing is claimed: the errors are no longer small angles."""
_TIGHTEST_RADPM = 0.2
"""Curvature of a sweep; the moments of a tighter turn are taken one by one."""
_JITTER_RAD = 0.03
"""Corrections of the heading on the spot that are no turn."""


class Strip(NamedTuple):
    """Pose at a moment of a pass; a leading axis where there are several.

    Attributes:
        x_m, y_m, yaw_rad: of the reference point.
        along_m, turned_rad: way of the reference point and turn since the pass began.
        covariance: of forward, left and yaw, in the body's axes.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    along_m: Float[Array, "..."]
    turned_rad: Float[Array, "..."]
    covariance: Float[Array, "... 3 3"]


class RunningPass(NamedTuple):
    """A pass so far.

    Attributes:
        going: the last moment belongs to a pass.
        now: the last moment of one.
        low, high: the moments farthest back and farthest on, along the way.
        strips: of even distance, newest first.
        strip_count: of those that belong to this pass.
        begun_here: the oldest of them is the pass's first moment.
    """

    going: Bool[Array, "..."]
    now: Strip
    low: Strip
    high: Strip
    strips: Strip
    strip_count: Int32[Array, "..."]
    begun_here: Bool[Array, "..."]


def init_pass() -> RunningPass:
    """No pass yet; one lane."""
    zero = jnp.float32(0.0)
    nowhere = Strip(zero, zero, zero, zero, zero, jnp.eye(3, dtype=jnp.float32))
    strips = jax.tree.map(lambda part: jnp.broadcast_to(part, (STRIPS, *part.shape)), nowhere)
    no = jnp.asarray(False)
    begun = RunningPass(no, nowhere, nowhere, nowhere, strips, jnp.int32(0), no)
    # A step that is given its state up wants memory of its own for each part.
    separate: RunningPass = jax.tree.map(jnp.array, begun)
    return separate


def step_pass(tool: Tool, spacing_m: float, past: RunningPass, moment: ToolMoment) -> RunningPass:
    """The pass with one more moment; it is not ``going`` where that moment counts for nothing.

    A moment counts if the tool is on and its pose and covariance can be used. A new pass begins with it where the last
    one did not count, or where the tool cannot have swept on from there: it moved by more than its length, the body
    turned more than in a gentle curve, or it came back over its own way.

    Args:
        tool: its rectangle.
        spacing_m: of the strips.
        past: the pass before.
        moment: one lane.
    """
    counts = moment.on & _usable(moment)
    last = past.now
    x, y, yaw = (
        jnp.where(counts, new, old)
        for new, old in zip((moment.x_m, moment.y_m, moment.yaw_rad), (last.x_m, last.y_m, last.yaw_rad), strict=True)
    )
    turn = jnp.arctan2(jnp.sin(yaw - last.yaw_rad), jnp.cos(yaw - last.yaw_rad))
    middle = last.yaw_rad + 0.5 * turn
    along = last.along_m + jnp.cos(middle) * (x - last.x_m) + jnp.sin(middle) * (y - last.y_m)
    turned = last.turned_rad + turn
    # Singular values of an unusable covariance are kept out of everything: the last good one stands in.
    covariance = jnp.where(counts, _in_body_axes(moment.covariance, yaw), last.covariance)
    here = Strip(x, y, yaw, along, turned, covariance)

    newest = jax.tree.map(lambda part: part[0], past.strips)
    before, after = (tool_centre(tool, at.x_m, at.y_m, at.yaw_rad) for at in (last, here))
    way_m = jnp.hypot(after[0] - before[0], after[1] - before[1])
    turns = jnp.abs(turned - newest.turned_rad) > tightest_radpm(tool) * jnp.abs(along - newest.along_m) + _JITTER_RAD
    back = jnp.minimum(past.high.along_m - along, along - past.low.along_m) > 0.25 * tool.length_m
    begins = ~past.going | (way_m > tool.length_m) | turns | back
    zero = jnp.float32(0.0)
    here = here._replace(along_m=jnp.where(begins, zero, along), turned_rad=jnp.where(begins, zero, turned))

    pushes = counts & (begins | (jnp.abs(here.along_m - newest.along_m) >= spacing_m))
    longer = jax.tree.map(lambda one, all_: jnp.concatenate([one[None], all_[:-1]]), here, past.strips)
    count = jnp.where(begins, 0, past.strip_count)
    lost = pushes & (count == STRIPS)
    return RunningPass(
        going=counts,
        now=here,
        low=_choose(begins | (here.along_m < past.low.along_m), here, past.low),
        high=_choose(begins | (here.along_m > past.high.along_m), here, past.high),
        strips=_choose(pushes, longer, past.strips),
        strip_count=jnp.where(pushes, jnp.minimum(count + 1, STRIPS), count).astype(jnp.int32),
        begun_here=begins | (past.begun_here & ~lost),
    )


def way_curvatures(tool: Tool, spacing_m: float, running: RunningPass) -> Float[Array, " entry"]:
    """Curvature of the way about the last moment, then about each strip.

    It is the smallest of those of the stretches of half a tool around, two before and two after as far as they were
    driven; 0 where they differ in sign or are fewer than two. A correction of the heading is a jump within one stretch
    only, and so makes no curve. About a strip some of the way after it must be known, for a curve may have ended there;
    the last moment claims nothing of what comes.
    """
    place, reach = np.arange(STRIPS + 1), max(1, math.ceil(0.5 * tool.length_m / spacing_m))
    along, turned = (
        jnp.concatenate([now[None], strips])
        for now, strips in (
            (running.now.along_m, running.strips.along_m),
            (running.now.turned_rad, running.strips.turned_rad),
        )
    )

    def stretch(newer: np.ndarray, older: np.ndarray) -> tuple[Float[Array, " entry"], Bool[Array, " entry"]]:
        new, old = np.clip(newer, 0, STRIPS), np.clip(older, 0, STRIPS)
        way = along[new] - along[old]
        known = jnp.asarray((newer < older) & (older <= STRIPS)) & (old <= running.strip_count)
        known = known & (jnp.abs(way) > 0.5 * spacing_m)
        return jnp.where(known, (turned[new] - turned[old]) / jnp.where(known, way, 1.0), 0.0), known

    after, after_known = stretch(np.maximum(place - reach, 0), place)
    further = stretch(np.maximum(place - 2 * reach, 0), np.maximum(place - reach, 0))
    parts = [(after, after_known), further, stretch(place, place + reach), stretch(place + reach, place + 2 * reach)]
    curvatures, known = (jnp.stack(part) for part in zip(*parts, strict=True))
    same = jnp.all((curvatures > 0.0) | ~known, axis=0) | jnp.all((curvatures < 0.0) | ~known, axis=0)
    enough = (jnp.sum(known, axis=0) >= 2) & (after_known | jnp.asarray(place == 0))
    least = jnp.min(jnp.where(known, jnp.abs(curvatures), jnp.inf), axis=0)
    sign = jnp.where(jnp.any(curvatures > 0.0, axis=0), 1.0, -1.0)
    return jnp.where(same & enough, sign * jnp.minimum(least, tightest_radpm(tool)), 0.0)


def tightest_radpm(tool: Tool) -> float:
    """Tightest curvature of a sweep: the turn's centre stays well outside the tool."""
    return min(_TIGHTEST_RADPM, 0.5 / (0.5 * tool.width_m + abs(tool.left_m)))


def _usable(moment: ToolMoment) -> Bool[Array, ""]:
    """Numbers all of them, a covariance that is positive definite, and a heading that is known."""
    covariance = 0.5 * (moment.covariance + moment.covariance.T)
    variances = jnp.diagonal(covariance)
    finite = jnp.all(jnp.isfinite(covariance)) & jnp.isfinite(moment.x_m + moment.y_m + moment.yaw_rad)
    scale = jax.lax.rsqrt(jnp.where(variances > 0.0, variances, 1.0))
    xy, xa = covariance[0, 1] * scale[0] * scale[1], covariance[0, 2] * scale[0] * scale[2]
    ya = covariance[1, 2] * scale[1] * scale[2]
    volume = 1.0 + 2.0 * xy * xa * ya - xy * xy - xa * xa - ya * ya
    definite = jnp.all(variances > 0.0) & (jnp.abs(xy) < 1.0) & (volume > 0.0)
    usable: Array = finite & definite & (variances[2] <= _LARGEST_HEADING_RAD**2)
    return usable


def _in_body_axes(covariance: Float[Array, "3 3"], yaw_rad: Float[Array, ""]) -> Float[Array, "3 3"]:
    cos, sin, zero, one = jnp.cos(yaw_rad), jnp.sin(yaw_rad), jnp.float32(0.0), jnp.float32(1.0)
    axes = jnp.stack([jnp.stack([cos, sin, zero]), jnp.stack([-sin, cos, zero]), jnp.stack([zero, zero, one])])
    symmetric = 0.5 * (covariance + covariance.T)
    turned: Array = jnp.matmul(jnp.matmul(axes, symmetric, precision="highest"), axes.T, precision="highest")
    return turned


def _choose(which: Bool[Array, ""], one: Strip, other: Strip) -> Strip:
    chosen: Strip = jax.tree.map(lambda a, b: jnp.where(which, a, b), one, other)
    return chosen
