"""The worked area, live: for each cell the probability that the tool was over it, updated ten times per second.

Each moment judges a patch of cells around the tool and no others, so its cost does not grow with the field. A cell
takes pose and error from the strip of the pass that it was crossed with, the beginning and the end from the pass so
far; its probability rises while the tool leaves it behind. The map keeps the largest value of any pass: the errors of
two passes are related, so their chances of missing a cell must not be multiplied.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.coverage.field import CellGrid, Tool, ToolMoment, tool_centre

# The pass that is being driven: its last strips, each with the pose and the error that places were crossed with.

STRIPS = 32
"""Kept of a pass."""
_LARGEST_HEADING_RAD = 0.06
"""Standard deviation of the heading beyond which no cell is claimed, because errors are no longer small angles."""
_TIGHTEST_RADPM = 0.2
"""Curvature of a sweep; the moments of a tighter turn are taken one by one."""
_JITTER_RAD = 0.03
"""Corrections of the heading on the spot that are no turn."""


class WorkedStrip(NamedTuple):
    """Pose at a moment of a pass, or with a leading axis for several.

    Attributes:
        x_m, y_m, yaw_rad: pose of the reference point.
        along_m, turned_rad: way of the reference point and turn since the pass began.
        covariance: covariance of forward, left and yaw, in the body's axes.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    along_m: Float[Array, "..."]
    turned_rad: Float[Array, "..."]
    covariance: Float[Array, "... 3 3"]


class RunningPass(NamedTuple):
    """The current pass.

    Attributes:
        going: whether the last moment belongs to a pass.
        now: last moment of the pass.
        low, high: moments farthest back and farthest on along the way.
        strips: moments at even distances, newest first.
        strip_count: number of strips that belong to this pass.
        begun_here: whether the oldest of them is the pass's first moment.
    """

    going: Bool[Array, "..."]
    now: WorkedStrip
    low: WorkedStrip
    high: WorkedStrip
    strips: WorkedStrip
    strip_count: Int32[Array, "..."]
    begun_here: Bool[Array, "..."]


def init_pass() -> RunningPass:
    """Initial state without a pass; one batch element."""
    zero = jnp.float32(0.0)
    nowhere = WorkedStrip(zero, zero, zero, zero, zero, jnp.eye(3, dtype=jnp.float32))
    strips = jax.tree.map(lambda part: jnp.broadcast_to(part, (STRIPS, *part.shape)), nowhere)
    no = jnp.asarray(False)
    begun = RunningPass(
        going=no, now=nowhere, low=nowhere, high=nowhere, strips=strips, strip_count=jnp.int32(0), begun_here=no
    )
    # A step with donated state needs separate memory for each part.
    separate: RunningPass = jax.tree.map(jnp.array, begun)
    return separate


def step_pass(tool: Tool, spacing_m: float, past: RunningPass, moment: ToolMoment) -> RunningPass:
    """The pass with one more moment; it is not ``going`` if that moment does not count.

    A moment counts if the tool is on and its pose and covariance can be used. A new pass begins with it if the last one
    did not count, or if the tool cannot have swept from there: it moved by more than its length, the body turned more
    than in a gentle curve, or it came back over its own way.

    Args:
        tool: rectangle of the tool.
        spacing_m: spacing of the strips.
        past: pass before the moment.
        moment: moment of one batch element.
    """
    counts = moment.on & usable_moment(moment)
    last = past.now
    x, y, yaw = (
        jnp.where(counts, new, old)
        for new, old in zip((moment.x_m, moment.y_m, moment.yaw_rad), (last.x_m, last.y_m, last.yaw_rad), strict=True)
    )
    turn = jnp.arctan2(jnp.sin(yaw - last.yaw_rad), jnp.cos(yaw - last.yaw_rad))
    middle = last.yaw_rad + 0.5 * turn
    along = last.along_m + jnp.cos(middle) * (x - last.x_m) + jnp.sin(middle) * (y - last.y_m)
    turned = last.turned_rad + turn
    # An unusable covariance is replaced by the last good one, to keep singular values out.
    covariance = jnp.where(counts, covariance_in_body(moment.covariance, yaw), last.covariance)
    here = WorkedStrip(x, y, yaw, along, turned, covariance)

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


def way_curvatures(
    tool: Tool, spacing_m: float, running: RunningPass
) -> tuple[Float[Array, " entry"], Bool[Array, " entry"]]:
    """Curvature of the path around the last moment, then around each strip; and whether it is known.

    It is the smallest curvature of the surrounding stretches of half a tool, two before and two after as far as they
    were driven; 0 if they differ in sign. With fewer than two, at the start of a pass, it is unknown. A correction of
    the heading is a jump within one stretch only, and so makes no curve. For a strip some of the way after it must be
    known, because a curve may have ended there; the last moment claims nothing ahead.
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
    told = jnp.sum(known, axis=0) >= 2
    same = same & told & (after_known | jnp.asarray(place == 0))
    least = jnp.min(jnp.where(known, jnp.abs(curvatures), jnp.inf), axis=0)
    sign = jnp.where(jnp.any(curvatures > 0.0, axis=0), 1.0, -1.0)
    return jnp.where(same, sign * jnp.minimum(least, tightest_radpm(tool)), 0.0), told


def tightest_radpm(tool: Tool) -> float:
    """Tightest curvature of a sweep: the turn's centre stays well outside the tool."""
    return min(_TIGHTEST_RADPM, 0.5 / (0.5 * tool.width_m + abs(tool.left_m)))


def usable_moment(moment: ToolMoment) -> Bool[Array, ""]:
    """Whether all numbers are finite, the covariance is positive definite, and the heading is known."""
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


def covariance_in_body(covariance: Float[Array, "3 3"], yaw_rad: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Covariance of east, north and yaw as that of forward, left and yaw."""
    cos, sin, zero, one = jnp.cos(yaw_rad), jnp.sin(yaw_rad), jnp.float32(0.0), jnp.float32(1.0)
    axes = jnp.stack([jnp.stack([cos, sin, zero]), jnp.stack([-sin, cos, zero]), jnp.stack([zero, zero, one])])
    symmetric = 0.5 * (covariance + covariance.T)
    turned: Array = jnp.matmul(jnp.matmul(axes, symmetric, precision="highest"), axes.T, precision="highest")
    return turned


def _turned(covariance: Float[Array, "place 3 3"], turn_rad: Float[Array, " place"]) -> Float[Array, "place 3 3"]:
    """Covariance in the body's axes after a turn: the error is fixed to the ground while the body turns."""
    cos, sin = jnp.cos(turn_rad), jnp.sin(turn_rad)
    forward = cos[:, None] * covariance[:, 0] + sin[:, None] * covariance[:, 1]
    left = cos[:, None] * covariance[:, 1] - sin[:, None] * covariance[:, 0]
    rows = jnp.stack([forward, left, covariance[:, 2]], axis=1)
    forward = cos[:, None] * rows[:, :, 0] + sin[:, None] * rows[:, :, 1]
    left = cos[:, None] * rows[:, :, 1] - sin[:, None] * rows[:, :, 0]
    return jnp.stack([forward, left, rows[:, :, 2]], axis=2)


def _choose(which: Bool[Array, ""], one: WorkedStrip, other: WorkedStrip) -> WorkedStrip:
    chosen: WorkedStrip = jax.tree.map(lambda a, b: jnp.where(which, a, b), one, other)
    return chosen


# The probability that one pass of the tool reached a place, its pose known with errors (MF section 3).
#
# The error of the pose is one draw from its covariance, the same while the tool crosses the place. In the tool's axes
# the place then comes from ahead and leaves behind. Where it is r ahead of the tool's centre it is seen
#
#     Z(r) = e_left + (A + r) e_yaw − v − κ (A (r + ε) + (r² − ε²)/2)
#
# to the right of it: v its offset to the left as it crosses the centre, A how far the tool is ahead of the reference
# point, κ the curvature of its way (the arc is taken exactly), ε = e_forward − y e_yaw the error along the way, y the
# place's offset from the reference point. The pass reached it if |Z(r)| ≤ half the width at an r that the tool's
# length, the beginning and the end of the pass allow: first − ε ≥ r ≥ last − ε, |r| ≤ half the length.
#
# Over that range Z is least and largest at its ends, so a bound holds if it holds at one of them. With Z in the middle
# of the range and the part of e_yaw that is not related to it, each end leaves Z in the middle a bound that moves a
# little; the larger one is taken with its mean and variance (Clark 1961). So all but ε is in closed form, and ε is
# summed over nodes of Gauss and Legendre.

_TAIL = 4.0
"""Sigmas of the along-track error that are counted: the rest, 6 in 100,000, is never claimed."""
_STEEPEST = 0.95
"""Correlation of the errors along and aside beyond which the nodes no longer see it."""
_LEAST_M2 = 1e-10
_NODES = np.stack(np.polynomial.legendre.leggauss(12), axis=1)


class Passing(NamedTuple):
    """Motion of places through the tool's axes at the estimated pose; any leading axes.

    Attributes:
        covariance: covariance of forward (m), left (m) and yaw (rad) while the tool crosses the place.
        left_m: offset of the place from the tool's centre as it crosses the tool's axis.
        curvature_radpm: curvature of the place's way; 0 on a straight pass.
        first_m, last_m: distance of the place ahead of the tool's centre at the beginning and at the end of the pass.
    """

    covariance: Float[Array, "... 3 3"]
    left_m: Float[Array, "..."]
    curvature_radpm: Float[Array, "..."]
    first_m: Float[Array, "..."]
    last_m: Float[Array, "..."]


def pass_probability(tool: Tool, passing: Passing) -> Float[Array, "..."]:
    """Probability that the tool was over each place between the beginning and the end of a pass.

    Args:
        tool: rectangle of the tool.
        passing: motion of the places; covariances must be positive definite.
    """
    half_length = 0.5 * tool.length_m
    side = passing.left_m + tool.left_m
    # On an arc the axes of the error turn with the body: the error along the way at the pass's start or end counts.
    end_m = jnp.where(
        passing.last_m > -half_length,
        jnp.clip(passing.last_m, -half_length, half_length),
        jnp.where(passing.first_m < half_length, jnp.clip(passing.first_m, -half_length, half_length), 0.0),
    )
    along, error = _errors(tool, passing.covariance, side, passing.curvature_radpm, end_m)
    # Of second order, on average: a turned lever is shorter, and a turned body moves aside while it moves aside.
    yaw = passing.covariance[..., 2, 2]
    drop = 0.5 * tool.ahead_m * yaw + passing.covariance[..., 1, 2]
    first, last = passing.first_m - drop, passing.last_m - drop
    left = passing.left_m + 0.5 * side * yaw

    sigma = jnp.sqrt(along)
    low = jnp.clip((last - half_length) / sigma, -_TAIL, _TAIL)
    high = jnp.clip((first + half_length) / sigma, -_TAIL, _TAIL)
    half_span = 0.5 * jnp.maximum(high - low, 0.0)

    def part(node: Float[Array, "2"]) -> Float[Array, "..."]:
        standard = low + half_span * (1.0 + node[0])
        shift_m = sigma * standard
        behind, before = jnp.maximum(last - shift_m, -half_length), jnp.minimum(first - shift_m, half_length)
        reached = _aside(tool, left, passing.curvature_radpm, error, shift_m, behind, before)
        return node[1] * half_span * _density(standard) * reached

    total = jnp.sum(jax.vmap(part)(jnp.asarray(_NODES, jnp.float32)), axis=0)
    return jnp.clip(total, 0.0, 1.0)


class _Aside(NamedTuple):
    """Errors to the left and of yaw given the along-track error: regression slopes, and the remaining covariance."""

    left_slope: Float[Array, "..."]
    yaw_slope_radpm: Float[Array, "..."]
    left_m2: Float[Array, "..."]
    left_yaw_m: Float[Array, "..."]
    yaw_rad2: Float[Array, "..."]


def _errors(
    tool: Tool,
    covariance: Float[Array, "... 3 3"],
    side: Float[Array, "..."],
    curvature_radpm: Float[Array, "..."],
    end_m: Float[Array, "..."],
) -> tuple[Float[Array, "..."], _Aside]:
    """Variance of the along-track error at an offset from the reference point, and the others given it.

    On an arc it is the error along the way where the place is ``end_m`` ahead of the tool's centre; those to the left
    and of yaw are such that left + r yaw is the error where it is r ahead.
    """
    ahead, yaw = tool.ahead_m, covariance[..., 2, 2]
    forward_yaw, left_yaw = covariance[..., 0, 2], covariance[..., 1, 2]
    along = covariance[..., 0, 0] - 2.0 * side * forward_yaw + side * side * yaw
    left = covariance[..., 1, 1] + 2.0 * ahead * left_yaw + ahead * ahead * yaw
    along_yaw, left_turned = forward_yaw - side * yaw, left_yaw + ahead * yaw
    both = covariance[..., 0, 1] - side * left_yaw + ahead * along_yaw
    turn = curvature_radpm * end_m
    along = jnp.maximum(along - 2.0 * turn * both + turn * turn * left, _LEAST_M2)
    both, along_yaw = both - turn * left, along_yaw - turn * left_turned
    turns = curvature_radpm * curvature_radpm * ahead
    scale = 1.0 - turns * end_m
    yaw = yaw + turns * (2.0 * left_turned + turns * left)
    along_yaw, left_turned = along_yaw + turns * both, scale * (left_turned + turns * left)
    both, left = scale * both, scale * scale * left
    most = _STEEPEST * jnp.sqrt(along * jnp.maximum(left, _LEAST_M2))
    both = jnp.clip(both, -most, most)
    given = _Aside(
        left_slope=both / along,
        yaw_slope_radpm=along_yaw / along,
        left_m2=left - both * both / along,
        left_yaw_m=left_turned - both * along_yaw / along,
        yaw_rad2=jnp.maximum(yaw - along_yaw * along_yaw / along, 0.0),
    )
    return along, given


def _aside(
    tool: Tool,
    left_m: Float[Array, "..."],
    curvature_radpm: Float[Array, "..."],
    error: _Aside,
    shift_m: Float[Array, "..."],
    behind: Float[Array, "..."],
    before: Float[Array, "..."],
) -> Float[Array, "..."]:
    """Probability of the width, given the error along the way; r goes from ``behind`` to ``before``."""

    def expected(r: Float[Array, "..."]) -> Float[Array, "..."]:
        turned = tool.ahead_m * (r + shift_m) + 0.5 * (r * r - shift_m * shift_m)
        root = jnp.sqrt(jnp.maximum(1.0 - 2.0 * turned * curvature_radpm * curvature_radpm, 0.0))
        drawn = (error.left_slope + r * error.yaw_slope_radpm) * shift_m
        return drawn - left_m - 2.0 * curvature_radpm * turned / (1.0 + root)

    middle, half_span = 0.5 * (behind + before), 0.5 * (before - behind)
    # Z in the middle of the range, and the parts of the yaw that are correlated with it and independent of it.
    shared = error.left_yaw_m + middle * error.yaw_rad2
    middle_m2 = jnp.maximum(error.left_m2 + middle * (error.left_yaw_m + shared), _LEAST_M2)
    slope = jnp.clip(half_span * shared / middle_m2, -0.5, 0.5)
    rest_rad2 = jnp.maximum(error.yaw_rad2 - shared * shared / middle_m2, 0.0)
    ends = _Ends(
        expected(behind), expected(before), 1.0 / (1.0 - slope), 1.0 / (1.0 + slope), half_span * jnp.sqrt(rest_rad2)
    )
    half_width = 0.5 * tool.width_m
    within = _cumulative_of_larger(ends, half_width, middle_m2)
    mirrored = ends._replace(behind=-ends.behind, before=-ends.before)
    beyond = 1.0 - _cumulative_of_larger(mirrored, half_width, middle_m2)
    return jnp.maximum(within - beyond, 0.0)


class _Ends(NamedTuple):
    """Z at both ends of the range.

    Attributes:
        behind, before: expected values of Z.
        behind_gain, before_gain: change of Z in the middle per metre at the end.
        spread_m: standard deviation due to the independent part of the yaw, with opposite signs at the two ends.
    """

    behind: Float[Array, "..."]
    before: Float[Array, "..."]
    behind_gain: Float[Array, "..."]
    before_gain: Float[Array, "..."]
    spread_m: Float[Array, "..."]


def _cumulative_of_larger(
    ends: _Ends, bound_m: float | Float[Array, ""], middle_m2: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Probability that Z is below a bound at one end at least.

    Each end leaves Z in the middle a bound of its own, which moves with the rest of the yaw; the larger one counts, and
    its mean and variance are those of the larger of two normal values (Clark 1961).
    """
    one, other = ends.behind_gain * (bound_m - ends.behind), ends.before_gain * (bound_m - ends.before)
    apart, spread = one - other, ends.spread_m * (ends.behind_gain + ends.before_gain)
    ratio = apart / jnp.maximum(spread, 1e-9)
    share = _cumulative(ratio)
    width = apart * (2.0 * share - 1.0) + 2.0 * spread * _density(ratio)
    moved = share * ends.behind_gain * ends.behind_gain + (1.0 - share) * ends.before_gain * ends.before_gain
    variance = 0.25 * (apart * apart - width * width) + moved * ends.spread_m * ends.spread_m
    return _cumulative(0.5 * (one + other + width) * jax.lax.rsqrt(middle_m2 + jnp.maximum(variance, 0.0)))


def _density(standard: Float[Array, "..."]) -> Float[Array, "..."]:
    return float(1.0 / np.sqrt(2.0 * np.pi)) * jnp.exp(-0.5 * standard * standard)


def _cumulative(standard: Float[Array, "..."]) -> Float[Array, "..."]:
    return 0.5 + 0.5 * jax.lax.erf(float(np.sqrt(0.5)) * standard)


_REACH_WIDTHS = 0.5
"""Extent of the patch beyond the tool, in tool widths: with larger errors nothing could be claimed."""

_FAR_RAD = 0.5
_FIXED_SHARE = 0.97
"""Share of a strip's lateral variance below which the present variance is better; changes by rounding stay above."""


class WorkedState(NamedTuple):
    """The map, and the current pass.

    Attributes:
        probability: probability that the tool was over the cell's centre, by the best pass so far.
        running: current pass.
    """

    probability: Float[Array, "north east"]
    running: RunningPass


def init_worked(grid: CellGrid) -> WorkedState:
    """Initial state without worked cells."""
    return WorkedState(jnp.zeros(grid.shape, jnp.float32), init_pass())


@partial(jax.jit, static_argnames=("grid", "tool"), donate_argnames="state")
def step_worked(
    grid: CellGrid,
    tool: Tool,
    state: WorkedState,
    moment: ToolMoment,
    shared_sigma_m: float | Float[Array, ""] = 0.0,
) -> WorkedState:
    """The map with one more moment.

    Nothing is claimed for a moment that does not count (see ``step_pass``), nor between moments that the tool cannot
    have swept between.

    Args:
        grid: grid of the map.
        tool: rectangle of the tool, as plain numbers.
        state: state before the moment; its buffers are donated.
        moment: moment of one batch element; more by ``vmap``.
        shared_sigma_m: see ``run_worked``.
    """
    return _step(grid, tool, state, moment, shared_sigma_m)


@partial(jax.jit, static_argnames=("grid", "tool"))
def run_worked(
    grid: CellGrid,
    tool: Tool,
    state: WorkedState,
    moments: ToolMoment,
    shared_sigma_m: float | Float[Array, ""] = 0.0,
) -> WorkedState:
    """The map after moments with a leading axis of time: the same step for each in order.

    Args:
        grid: grid of the map.
        tool: rectangle of the tool, as plain numbers.
        state: state before the moments.
        moments: moments in order.
        shared_sigma_m: standard deviation per axis of the error common to all positions, which no filter sees: of the
            base, and of the tool's mounting. It is added to every moment's covariance as if it were independent.
    """

    def step(carried: WorkedState, moment: ToolMoment) -> tuple[WorkedState, None]:
        return _step(grid, tool, carried, moment, shared_sigma_m), None

    worked: WorkedState = jax.lax.scan(step, state, moments)[0]
    return worked


def _step(
    grid: CellGrid, tool: Tool, state: WorkedState, moment: ToolMoment, shared_sigma_m: float | Float[Array, ""]
) -> WorkedState:
    shared_m2 = jnp.square(jnp.asarray(shared_sigma_m, jnp.float32))
    moment = moment._replace(
        covariance=moment.covariance + shared_m2 * jnp.diag(jnp.array([1.0, 1.0, 0.0], jnp.float32))
    )
    reach_m = 0.5 * math.hypot(tool.width_m, tool.length_m) + _REACH_WIDTHS * tool.width_m
    # The strips extend as far back as the patch, for any corner.
    spacing_m = math.sqrt(2.0) * reach_m / (STRIPS - 2)
    running = step_pass(tool, spacing_m, state.running, moment)

    side = 2 * math.ceil(reach_m / grid.cell_m) + 1
    rows, columns = min(side, grid.north_cells), min(side, grid.east_cells)
    middle_x, middle_y = tool_centre(tool, running.now.x_m, running.now.y_m, running.now.yaw_rad)
    first_row = _first_cell(middle_y - grid.north_m, grid.cell_m, rows, grid.north_cells)
    first_column = _first_cell(middle_x - grid.east_m, grid.cell_m, columns, grid.east_cells)
    # Relative to the slice's own corner, which the border may have moved, so that no cell is confused with another.
    north = grid.north_m + grid.cell_m * (first_row.astype(jnp.float32) + jnp.arange(rows, dtype=jnp.float32) + 0.5)
    east = grid.east_m + grid.cell_m * (first_column.astype(jnp.float32) + jnp.arange(columns, dtype=jnp.float32) + 0.5)
    x = jnp.broadcast_to(east[None, :], (rows, columns)).ravel()
    y = jnp.broadcast_to(north[:, None], (rows, columns)).ravel()

    passing, known = _crossed(tool, spacing_m, running, x, y)
    # At the border the slice is moved away from a tool that is beyond it: cells out of the tool's reach are not
    # claimed. The formulas hold near the tool; across the centre of a tight turn they are meaningless.
    near = jnp.maximum(jnp.abs(x - middle_x), jnp.abs(y - middle_y)) <= reach_m + grid.cell_m
    claims = known & near & running.going
    claimed = jnp.where(claims, pass_probability(tool, passing), 0.0).reshape(rows, columns)
    old = jax.lax.dynamic_slice(state.probability, (first_row, first_column), (rows, columns))
    new = jax.lax.dynamic_update_slice(state.probability, jnp.maximum(old, claimed), (first_row, first_column))
    return WorkedState(new, running)


def _first_cell(offset_m: Float[Array, ""], cell_m: float, size: int, cells: int) -> Array:
    """First cell of a slice around an offset, within the grid."""
    first = jnp.round(offset_m / cell_m) - 0.5 * size
    return jnp.clip(first, 0.0, float(cells - size)).astype(jnp.int32)


def _crossed(
    tool: Tool,
    spacing_m: float,
    running: RunningPass,
    x_m: Float[Array, " place"],
    y_m: Float[Array, " place"],
) -> tuple[Passing, Bool[Array, " place"]]:
    """Motion of the tool over places, by the strip with the nearest axis; and mask of places that the strips cover."""
    strips, now = running.strips, running.now

    def joined(one: Float[Array, ""], many: Float[Array, " strip"]) -> Float[Array, " entry"]:
        return jnp.concatenate([one[None], many])

    yaw, along, turned = (
        joined(getattr(now, name), getattr(strips, name)) for name in ("yaw_rad", "along_m", "turned_rad")
    )
    covariance = jnp.concatenate([now.covariance[None], strips.covariance])
    centre_x, centre_y = tool_centre(tool, joined(now.x_m, strips.x_m), joined(now.y_m, strips.y_m), yaw)
    curvature, told = way_curvatures(tool, spacing_m, running)
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)

    there = jnp.concatenate([jnp.ones(1, bool), jnp.arange(STRIPS) < running.strip_count])
    ahead = x_m[:, None] * cos[None] + y_m[:, None] * sin[None] - (cos * centre_x + sin * centre_y)[None]
    nearest = jnp.argmin(jnp.where(there[None], jnp.abs(ahead), jnp.inf), axis=1)
    # A new fix improves the tool's position at this moment, but not its path to it.
    aside = covariance[:, 1, 1] + tool.ahead_m * (2.0 * covariance[:, 1, 2] + tool.ahead_m * covariance[:, 2, 2])
    fixed = (jnp.abs(ahead[:, 0]) <= 0.5 * tool.length_m) & (aside[0] < _FIXED_SHARE * aside[nearest])
    # The map keeps its largest value: a claim made with an unknown curvature taken as straight would stay.
    alone = fixed | ~told[nearest]
    nearest = jnp.where(alone, 0, nearest)

    away_x, away_y = x_m - centre_x[nearest], y_m - centre_y[nearest]
    ahead_m = cos[nearest] * away_x + sin[nearest] * away_y
    left_m = cos[nearest] * away_y - sin[nearest] * away_x
    side = tool.left_m + left_m
    # From the strip's pose on the same arc to where the place crosses the tool's axis, as the arc has it.
    here = curvature[nearest] / (1.0 - curvature[nearest] * side)
    reach = ahead_m * (2.0 * tool.ahead_m + ahead_m)
    root = jnp.sqrt(jnp.maximum(1.0 + here * here * reach, 0.25))
    bend = here / root
    turn = jnp.arctan(here * (tool.ahead_m + ahead_m)) - jnp.arctan(bend * tool.ahead_m)

    def ahead_at(along_m: Float[Array, ""], turned_rad: Float[Array, ""]) -> Float[Array, " place"]:
        way, turned_back = along[nearest] - along_m, turned[nearest] - turned_rad
        # Far from the place it does not matter by how much.
        angle = jnp.clip(turned_back, -_FAR_RAD, _FAR_RAD)
        sine = jnp.sinc(angle / math.pi)
        return ahead_m + (way - side * turned_back) * sine - (tool.ahead_m + ahead_m) * (1.0 - jnp.cos(angle))

    first = ahead_at(running.low.along_m, running.low.turned_rad)
    last = ahead_at(running.high.along_m, running.high.turned_rad)
    passing = Passing(
        covariance=_turned(covariance[nearest], turn),
        left_m=left_m - here * reach / (1.0 + root),
        curvature_radpm=bend,
        first_m=jnp.where(alone, ahead_m, first),
        last_m=jnp.where(alone, ahead_m, last),
    )
    # Behind the oldest strip only the pass's beginning is known.
    lost = (nearest == running.strip_count) & ~running.begun_here & (ahead_m < -spacing_m)
    return passing, ~lost
