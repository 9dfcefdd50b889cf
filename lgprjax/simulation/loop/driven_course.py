"""A course driven in closed loop with full registration: every scan rendered, searched, fused, steered by."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.formats import MapFile
from lgprjax.frames import along_cross, wrap_angle
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
    step_local,
)
from lgprjax.navigation.counter_steer_model import RATE_BIAS, SPEED, YAW
from lgprjax.radar import trace_operators
from lgprjax.registration import (
    POOLED,
    Chance,
    Code,
    LiveBlock,
    RegisterOptions,
    Registration,
    Track,
    ground_map_for,
    sigmas_along_cross,
)
from lgprjax.registration.bayes import Likelihood
from lgprjax.scene import Day, LiveRadar, Readings, ReceiverFaults, SensorFaults, draw_springs
from lgprjax.simulation.loop.closed_loop import LoopTick, decide, move, tick_record
from lgprjax.simulation.loop.loop_setup import LoopSetup, LoopSpec, LoopState, TrackingError, start_loop, tracking_error
from lgprjax.simulation.loop.off_road import OffRoad, OffRoadCourse, SceneFrame, scene_frame_of
from lgprjax.vehicle import VehiclePose

# The radar's part of a closed loop: scans rendered at the true pose, registered from the estimated one.

_ROLL_SIGMA_RAD = 0.1 * np.pi / 180.0
_LEAST_YAW_SIGMA_RAD = 0.1 * np.pi / 180.0


class TickFix(NamedTuple):
    """Result of a tick's scans.

    Attributes:
        observation: the last accepted fix, if there is one.
        p_false: probability that the last match is false, accepted or not, see ``Fix``; NaN without a match.
        codes: codes of the searched scans.
        error: true errors of the accepted fixes along and across the true heading and in heading, in the map's frame.
        reported: standard deviations that the accepted fixes report for these three.
        match: strength of the accepted fixes, and their probability of a false match.
    """

    observation: LgprObservation
    p_false: float
    codes: list[int]
    error: Float[np.ndarray, "fix 3"]
    reported: Float[np.ndarray, "fix 3"]
    match: Float[np.ndarray, "fix 2"]


class RadarLoop:
    """One live drive's radar on a course, registered scan by scan.

    Args:
        course: course of the drive.
        source: map of the course.
        options: options of the search.
        day: day of the drive.
        seed: seed of the drive's faults and springs.
        ticks: largest number of ticks.
        tick_s: tick of the loop.
        zero_slip_m: zero-slip point of the vehicle, from its filter.
        chance: chance of a false match on the map.
        likelihood: likelihood of map and array, for a search by filter.

    Raises:
        ValueError: a tick is not a whole number of the course's scans.
    """

    def __init__(
        self,
        course: OffRoadCourse,
        source: MapFile,
        options: RegisterOptions,
        *,
        day: Day,
        seed: int,
        ticks: int,
        tick_s: float,
        zero_slip_m: float,
        chance: Chance = POOLED,
        likelihood: Likelihood | None = None,
    ) -> None:
        self._course, self._tick_s, self._scans = course, tick_s, _scans_a_tick(course.spec, tick_s)
        self.frame: SceneFrame = scene_frame_of(source.description.frame)
        self._radar = LiveRadar(
            course.ground,
            day,
            course.road,
            course.array,
            draw_springs(course.plan, seed),
            scans=(ticks + 1) * self._scans,
            seed=seed,
            faults=ReceiverFaults(),
        )
        # As on board, each stop is judged separately.
        options = replace(options, track=True)
        ground = ground_map_for(source, options)
        known, kept = self._radar.radar, len(source.description.gain)
        operators = trace_operators(
            known.samples,
            known.sample_step_ns,
            known.time_zero_ns,
            source.description.settings,
            kept,
            height_m=course.array.height_m,
        )
        array = course.array._replace(zero_slip_m=zero_slip_m)
        self._search = Registration(
            ground,
            operators,
            array,
            options,
            chance=chance,
            likelihood=likelihood,
            recorded=known.samples,
            block_scans=self._scans,
        )
        self._rng = np.random.default_rng([seed, 31])
        self._roll_error = _ROLL_SIGMA_RAD * self._rng.normal()
        self._travel_m = 0.0

    def fix(
        self,
        before: LoopState,
        after: LoopState,
        setup: LoopSetup,
        readings: Readings,
        *,
        heard: bool = True,
    ) -> TickFix:
        """Scans of one tick: recorded along the true path from ``before`` to ``after``, searched around GNSS/INS.

        Args:
            before, after: state of the loop before and after ``move``.
            setup: setup of the loop.
            readings: sensor readings of the tick.
            heard: whether the radar works in this tick; if not, its filter keeps its state.
        """
        share = np.arange(self._scans) / self._scans  # each scan within the tick, its channels after it
        seen = _Seen(*np.asarray(_see(setup, before, after, readings, np.float32(self._tick_s)), np.float64))
        odometer = float(seen.odometer[0])
        travel = self._travel_m + odometer * self._tick_s * share
        self._travel_m += odometer * self._tick_s
        if not heard:
            return _unmatched()
        number = int(seen.odometer[3]) * self._scans
        truth = _between(seen.before, seen.after, self._instants(share))
        scene = np.concatenate([self.frame.to_scene(truth[..., :2]), truth[..., 2:] + self.frame.turn_rad], axis=-1)
        recorded = self._radar.record(number, scene, float(seen.odometer[2]) + self._course.spec.array_x_m)
        prior = self._prior(seen, share, recorded.roll_rad)
        sigma_yaw = max(float(seen.odometer[1]), _LEAST_YAW_SIGMA_RAD)
        kept = recorded.received
        block = LiveBlock(
            recorded.recorded[kept].astype(np.float32) - 128.0,
            np.ones((int(kept.sum()), len(self._course.array.x_m)), bool),
            Track(
                prior[kept],
                travel[kept],
                np.full(kept.sum(), odometer),
                np.full(kept.sum(), sigma_yaw),
                np.full(kept.sum(), np.nan),  # as on board: a prior states no covariance of its position
                np.zeros(kept.sum(), np.int64),
            ),
        )
        if not kept.any():
            return _unmatched()
        found = self._search.feed(block).fix
        codes = np.asarray(found.code)
        ok = np.flatnonzero(codes == Code.OK)
        p_false, correlation = np.asarray(found.p_false), np.asarray(found.correlation)
        strength = correlation * np.sqrt(np.maximum(np.asarray(found.overlap), 0.0))
        matched = p_false[np.isfinite(correlation)]
        centre = _array_pose(_between(seen.before, seen.after, share)[kept], self._course.spec.array_x_m)
        error = _error(np.asarray(found.pose)[ok], centre[ok])
        observation = _no_fix()
        if len(ok):
            last = ok[-1]
            at = np.array([0, 1, 3])
            pose = np.asarray(found.pose)[last]
            observation = _observation(
                pose[at],
                np.asarray(found.covariance)[last][np.ix_(at, at)],
                self._tick_s * (1.0 - share[kept][last]),
                valid=True,
            )
        covariance = np.asarray(found.covariance)[ok]
        reported = np.stack([*sigmas_along_cross(covariance, centre[ok, 2]), np.sqrt(covariance[:, 3, 3])], axis=1)
        last_match = float(matched[-1]) if len(matched) else float("nan")
        match = np.stack([strength, p_false], axis=1)[ok]
        return TickFix(observation, last_match, codes.tolist(), error, reported, match)

    def _instants(self, share: Float[np.ndarray, " scan"]) -> Float[np.ndarray, "scan channel"]:
        return np.asarray(share[:, None] + self._course.array.time_offset_s[None] / self._tick_s)

    def _prior(
        self, seen: "_Seen", share: Float[np.ndarray, " scan"], roll_rad: Float[np.ndarray, " scan"]
    ) -> Float[np.ndarray, "scan 5"]:
        """Start of each scan's search: pose of the array's centre by ``search_pose``."""
        centre = _array_pose(_between(seen.start, seen.end, share), self._course.spec.array_x_m)
        keep = np.exp(-self._tick_s / 20.0)
        self._roll_error = keep * self._roll_error + np.sqrt(1 - keep**2) * _ROLL_SIGMA_RAD * self._rng.normal()
        height = np.full(len(share), self._course.array.height_m)
        return np.stack([centre[:, 0], centre[:, 1], height, centre[:, 2], roll_rad + self._roll_error], axis=1)


def _scans_a_tick(spec: OffRoad, tick_s: float) -> int:
    scans = tick_s * spec.scan_hz
    if scans < 0.5 or abs(scans - round(scans)) > 1e-6:
        found = f"scan_share {spec.scan_share} makes {scans:g}"
        raise ValueError(f"a tick of {tick_s:.4g} s holds a whole number of scans, one or more: {found}")
    return round(scans)


class _Seen(NamedTuple):
    """Inputs of a tick's search, fetched at once: rows of four numbers; the fourth of a pose is unused.

    Attributes:
        before, after: true poses of the rear axle at the start and the end of the tick.
        start, end: start poses of the search at the start and the end of the tick.
        odometer: odometer speed, sigma of the GNSS/INS heading, position of the rear axle along the road, and tick.
    """

    before: Float[np.ndarray, "4"]
    after: Float[np.ndarray, "4"]
    start: Float[np.ndarray, "4"]
    end: Float[np.ndarray, "4"]
    odometer: Float[np.ndarray, "4"]


@jax.jit
def _see(
    setup: LoopSetup, before: LoopState, after: LoopState, readings: Readings, tick_s: Float[Array, ""]
) -> Float[Array, "5 4"]:
    estimate = before.onboard.navigator.reckoned.estimate
    start = before.onboard.navigator.search_pose
    rate = readings.yaw_rate_radps - estimate.mean[RATE_BIAS]
    end = step_local(start, estimate.mean[SPEED], rate, setup.navigator.model.zero_slip_m, tick_s)
    sigma = jnp.sqrt(estimate.covariance[YAW, YAW])
    odometer = jnp.stack([readings.odometer_mps, sigma, before.plant.along_m, before.tick.astype(jnp.float32)])
    poses = [jnp.stack([*pose, jnp.zeros_like(tick_s)]) for pose in (before.plant.pose, after.plant.pose, start, end)]
    return jnp.stack([*poses, odometer])


def _between(
    start: Float[np.ndarray, "4"], end: Float[np.ndarray, "4"], share: Float[np.ndarray, "*scan"]
) -> Float[np.ndarray, "*scan 3"]:
    """Poses within a tick: a fifth of a metre, so that a straight line is a millimetre's fraction off."""
    return np.asarray(start[:3] + share[..., None] * (end - start)[:3])


def _array_pose(axle: Float[np.ndarray, "scan 3"], array_x_m: float) -> Float[np.ndarray, "scan 3"]:
    x = axle[:, 0] + array_x_m * np.cos(axle[:, 2])
    y = axle[:, 1] + array_x_m * np.sin(axle[:, 2])
    return np.stack([x, y, axle[:, 2]], axis=1)


def _error(found: Float[np.ndarray, "fix 5"], truth: Float[np.ndarray, "fix 3"]) -> Float[np.ndarray, "fix 3"]:
    """Along and across the true heading, and of the heading."""
    east, north = (found[:, :2] - truth[:, :2]).T
    along, cross = along_cross(east, north, truth[:, 2])
    return np.stack([along, cross, wrap_angle(found[:, 3] - truth[:, 2])], axis=1)


def _unmatched() -> TickFix:
    return TickFix(_no_fix(), float("nan"), [], np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)))


def _no_fix() -> LgprObservation:
    return _observation(np.zeros(3), np.eye(3), 0.0, valid=False)


def _observation(
    pose: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "3 3"], age_s: float, *, valid: bool
) -> LgprObservation:
    # NumPy arrays, which a compiled function takes directly: transfers of each would cost as much as the call.
    numbers = [*(np.float32(part) for part in pose), covariance.astype(np.float32), np.float32(age_s), np.bool_(valid)]
    return LgprObservation(*(cast("Array", number) for number in numbers))


_DRAWN_FAULTS = ("odometer_lost_s", "lgpr_wrong_s", "lgpr_faded_s")
"""Drawn fixes alone are wrong or faded on demand; the search between them goes by the odometer."""
_STARTS_AT_M = 2.0
_START_MPS = 2.0
_BELIEVED_OFF_M = 0.3
_END_M = 3.0


class DrivenCourse(NamedTuple):
    """One drive of a course; ticks of the loop, including the driver's lead-in.

    Attributes:
        tick: record of each tick.
        anchor_m: true positions of the anchor in the map's frame.
        baseline_m: true positions of the baseline's anchor in the map's frame.
        codes: codes of the searched scans.
        fix_error: errors of each accepted fix along and across the true heading (m), and in heading (rad).
        fix_sigma: standard deviations reported by each accepted fix.
        fix_match: strength and probability of a false match of each accepted fix.
        fix_travel_m: distance driven at each accepted fix.
        finished: whether the route was driven to its end.
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
        """Mask of ticks under autopilot."""
        return np.asarray(self.tick.engaged, bool)

    @property
    def tracking(self) -> TrackingError:
        """Tracking error of the part driven by the autopilot."""
        return tracking_error(self.anchor_m, self.baseline_m, self.engaged)


def route_of_map(source: MapFile, setup: LoopSetup, speeds: RouteSpeeds) -> RoutePath:
    """The first baseline of a map as a route for the setup's vehicle."""
    first = source.drive == 0
    legs, gear = legs_of_track(RouteTrack(source.path.name, source.pose[first, :2], source.pose[first, 3]))
    return make_route_path(legs, gear, setup.autopilot.chassis, speeds, name=source.path.name)


def drive_course(
    course: OffRoadCourse,
    source: MapFile,
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    options: RegisterOptions,
    *,
    day: Day,
    seed: int,
    chance: Chance = POOLED,
    likelihood: Likelihood | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> DrivenCourse:
    """Drive a course's route from its start to its end.

    A driver drives until navigation is sound; the autopilot does the rest.

    Args:
        course, source: course of the drive, and its map.
        spec, setup, route: settings, setup and route of the loop.
        options: options of the search.
        day: day of the drive.
        seed: seed of the radar's faults and of all noise.
        chance: chance of a false match on the map.
        likelihood: likelihood of map and array, for a search by filter.
        progress: function called for every tick.

    Raises:
        ValueError: a fault does not exist in a real search or is unknown to it, or there is no start on the route.
    """
    _refuse_drawn_faults(setup.faults)
    length_m = float(route.legs.length_m[0])
    ticks = int(1.3 * length_m / float(setup.set_speed_mps) / spec.tick_s) + 200
    radar = RadarLoop(
        course,
        source,
        options,
        day=day,
        seed=seed,
        ticks=ticks,
        tick_s=spec.tick_s,
        zero_slip_m=float(setup.navigator.model.zero_slip_m),
        chance=chance,
        likelihood=likelihood,
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
        tick=kept,
        anchor_m=np.stack([x_m + lead * np.cos(yaw), y_m + lead * np.sin(yaw)], axis=1),
        baseline_m=radar.frame.to_map(course.anchor_m),
        codes=np.asarray(codes),
        fix_error=np.concatenate(errors),
        fix_sigma=np.concatenate(sigmas),
        fix_match=np.concatenate(matches),
        fix_travel_m=np.asarray(travelled),
        finished=finished,
    )


def _refuse_drawn_faults(faults: SensorFaults) -> None:
    for name in _DRAWN_FAULTS:
        if float(getattr(faults, name)[0]) < np.inf:
            raise ValueError(f"{name}: a course with full registration has no such fault")


def _start_of(source: MapFile, course: OffRoadCourse) -> tuple[VehiclePose, float]:
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
    tick = tick_record(setup, route, state, decision, lgpr)
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
