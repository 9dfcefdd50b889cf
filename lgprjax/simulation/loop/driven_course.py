"""A course driven in closed loop with full registration: every scan rendered, searched, fused, steered by."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.formats import MapFile
from lgprjax.navigation import (
    LgprObservation,
    PlanCode,
    RoutePath,
    RouteSpeeds,
    RouteTrack,
    acquire,
    find_starts,
    legs_of_track,
    make_route_path,
)
from lgprjax.registration import POOLED, Chance, RegisterOptions
from lgprjax.scene import Readings
from lgprjax.simulation.loop.closed_loop import decide, move
from lgprjax.simulation.loop.loop_state import LoopSetup, LoopSpec, LoopState, start_loop
from lgprjax.simulation.loop.loop_tick import LoopTick, told_tick
from lgprjax.simulation.loop.off_road import Course
from lgprjax.simulation.loop.radar_loop import RadarLoop
from lgprjax.simulation.loop.tracking_error import TrackingError, tracking_error
from lgprjax.vehicle import VehiclePose

_STARTS_AT_M = 2.0
_START_MPS = 2.0
_BELIEVED_OFF_M = 0.3
_END_M = 3.0


class DrivenCourse(NamedTuple):
    """One drive of a course; ticks of the loop, the driver's lead-in among them.

    Attributes:
        tick: what was kept of each tick.
        anchor_m: true places of the anchor in the map's frame.
        baseline_m: true places of the baseline's anchor there.
        codes: of every scan that was searched.
        fix_error: of every ok fix: along and across the true heading (m), and of the heading (rad).
        fix_sigma: what each of them says of itself.
        fix_match: strength and probability of a false match of each of them.
        fix_travel_m: way driven at each ok fix.
        finished: the route was driven to its end.
    """

    tick: LoopTick
    anchor_m: Float[np.ndarray, "tick 2"]
    baseline_m: Float[np.ndarray, "point 2"]
    codes: Int[np.ndarray, " scan"]
    fix_error: Float[np.ndarray, "fix 3"]
    fix_sigma: Float[np.ndarray, "fix 3"]
    fix_match: Float[np.ndarray, "fix 2"]
    fix_travel_m: Float[np.ndarray, " fix"]
    finished: bool

    @property
    def engaged(self) -> Bool[np.ndarray, " tick"]:
        """Ticks that the autopilot drove."""
        return np.asarray(self.tick.engaged, bool)

    @property
    def tracking(self) -> TrackingError:
        """Of what the autopilot drove."""
        return tracking_error(self.anchor_m[self.engaged], self.baseline_m)


def route_of_map(source: MapFile, setup: LoopSetup, speeds: RouteSpeeds) -> RoutePath:
    """The first baseline of a map as a route for the setup's vehicle."""
    first = source.drive == 0
    legs, gear = legs_of_track(RouteTrack(source.path.name, source.pose[first, :2], source.pose[first, 3]))
    return make_route_path(legs, gear, setup.autopilot.chassis, speeds, name=source.path.name)


def drive_course(
    course: Course,
    source: MapFile,
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    options: RegisterOptions,
    *,
    weather: str,
    seed: int,
    chance: Chance = POOLED,
    progress: Callable[[int], None] = lambda _: None,
) -> DrivenCourse:
    """Drive a course's route from its start to its end.

    A driver brings the vehicle on its way until navigation is sound, the autopilot does the rest.

    Args:
        course, source: that is driven, and its map.
        spec, setup, route: of the loop.
        options: of the search.
        weather: of the day, see ``WEATHER``.
        seed: of the day, the faults of the radar, and all noise.
        chance: of the map.
        progress: told of every tick.
    """
    length_m = float(route.legs.length_m[0])
    ticks = int(1.3 * length_m / float(setup.set_speed_mps) / spec.tick_s) + 200
    radar = RadarLoop(
        course,
        source,
        options,
        weather=weather,
        day_seed=7919 * course.spec.seed + seed,
        seed=seed,
        ticks=ticks,
        tick_s=spec.tick_s,
        chance=chance,
    )
    true, along_m = _start_of(source, course)
    planner, code = acquire(find_starts(route, setup.autopilot.planner, setup.autopilot.chassis, true))
    if int(code) != PlanCode.FOLLOWING:
        raise ValueError(f"the vehicle does not find its start: {PlanCode(int(code)).name}")
    begin, noise = jax.random.split(jax.random.key(seed))
    off = _BELIEVED_OFF_M * np.random.default_rng([seed, 41]).normal(size=2)
    believed = VehiclePose(true.x_m + jnp.float32(off[0]), true.y_m + jnp.float32(off[1]), true.yaw_rad)
    state = start_loop(spec, setup, planner, true, believed, jnp.float32(_START_MPS), jnp.float32(along_m), begin)
    told: list[Float[np.ndarray, " number"]] = []
    codes: list[int] = []
    errors, sigmas, matches, travelled = [], [], [], []
    silent_s = np.asarray(setup.faults.lgpr_lost_s)
    finished = False
    for number in range(ticks):
        before = state
        state, readings = _move(spec, setup, state, noise, np.int32(number))
        heard = not silent_s[0] <= (number + 1) * spec.tick_s < silent_s[1]
        found = radar.fix(before, state, setup, readings, heard=heard)
        state, row = _decide(spec, setup, route, state, readings, found.observation, np.float32(found.p_false))
        told.append(np.asarray(row))
        codes += found.codes
        errors.append(found.error)
        sigmas.append(found.reported)
        matches.append(found.match)
        travelled += [float(told[-1][_TRAVEL])] * len(found.error)
        progress(1)
        tick = _row_as_tick(told[-1][:_TRAVEL])
        finished = float(tick.to_go_m) < _END_M or int(tick.code) == PlanCode.DONE
        stands = abs(float(tick.speed_mps)) < 0.05
        if finished or (stands and bool(tick.stopping)):
            break
    kept = _row_as_tick(np.stack(told)[:, :_TRAVEL])
    x_m, y_m, yaw = (np.asarray(part, np.float64) for part in (kept.x_m, kept.y_m, kept.yaw_rad))
    lead = course.spec.array_x_m
    return DrivenCourse(
        kept,
        np.stack([x_m + lead * np.cos(yaw), y_m + lead * np.sin(yaw)], axis=1),
        radar.frame.to_map(course.anchor_m),
        np.asarray(codes),
        np.concatenate(errors),
        np.concatenate(sigmas),
        np.concatenate(matches),
        np.asarray(travelled),
        finished,
    )


def _start_of(source: MapFile, course: Course) -> tuple[VehiclePose, float]:
    """Rear axle with the anchor on the first baseline, a little on from its start; and its place along the road."""
    stations = source.pose[source.drive == 0]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(stations[:, :2], axis=0).T))])
    at = int(np.searchsorted(way, _STARTS_AT_M))
    x_m, y_m, yaw = stations[at, 0], stations[at, 1], stations[at, 3]
    lead = course.spec.array_x_m
    pose = VehiclePose(*(jnp.float32(v) for v in (x_m - lead * np.cos(yaw), y_m - lead * np.sin(yaw), yaw)))
    return pose, course.plan.start_m + float(way[at])


@partial(jax.jit, static_argnums=0)
def _move(
    spec: LoopSpec, setup: LoopSetup, state: LoopState, key: PRNGKeyArray, number: Int[Array, ""]
) -> tuple[LoopState, Readings]:
    return move(spec, setup, state, jax.random.fold_in(key, number))


@partial(jax.jit, static_argnums=0)
def _decide(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    state: LoopState,
    readings: Readings,
    lgpr: LgprObservation,
    p_false: Float[Array, ""],
) -> tuple[LoopState, Float[Array, " number"]]:
    """``decide``, and the tick's figures with the travel in one row: fetched at once."""
    state, decision = decide(spec, setup, route, state, readings, lgpr, p_false)
    tick = told_tick(setup, route, state, decision, lgpr)
    numbers = [jnp.ravel(leaf).astype(jnp.float32) for leaf in (*tick, state.plant.travel_m)]
    return state, jnp.concatenate(numbers)


_SIZES = {"error_m": 2, "accepted": 4}
_TRAVEL = -1


def _row_as_tick(rows: Float[np.ndarray, "*tick number"]) -> LoopTick:
    """Rows as ``_decide`` made them, without the travel, as figures of ticks."""
    fields, at = [], 0
    for name in LoopTick._fields:
        size = _SIZES.get(name, 1)
        fields.append(rows[..., at] if size == 1 else rows[..., at : at + size])
        at += size
    tick: LoopTick = LoopTick._make(fields)
    whole = {name: getattr(tick, name).astype(np.int64) for name in ("reaction", "reasons", "code")}
    return tick._replace(**whole)
