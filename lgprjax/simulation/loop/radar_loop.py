"""The radar's part of a closed loop: scans rendered where the vehicle truly is, registered where it believes to be."""

from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.formats import MapFile
from lgprjax.frames import along_cross, wrap_angle
from lgprjax.navigation import LgprObservation, pose_of, step_local
from lgprjax.navigation.filter_model import RATE_BIAS, SPEED, YAW
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
from lgprjax.scene import WEATHER, Faults, LiveRadar, Readings, draw_springs
from lgprjax.simulation.loop.loop_state import LoopSetup, LoopState
from lgprjax.simulation.loop.off_road import Course, SceneFrame, scene_frame_of

_ROLL_SIGMA_RAD = 0.1 * np.pi / 180.0
_LEAST_YAW_SIGMA_RAD = 0.1 * np.pi / 180.0


class TickFix(NamedTuple):
    """What the scans of a tick gave.

    Attributes:
        observation: the last ok fix, if there is one.
        p_false: of the last match, ok or not, see ``Fix``; NaN where nothing was matched.
        codes: of each scan that was searched.
        error: of the ok fixes, along and across the true heading and of the heading, against the truth in the map's
            frame.
        reported: what those fixes say of themselves, the same three, standard deviations.
        match: their strength, and their probability of a false match.
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
        course: that is driven.
        source: its map.
        weather, day_seed: of the live day, see ``WEATHER``.
        options: of the search.
        seed: of the drive's faults and springs.
        ticks: that it may last.
        tick_s: of the loop.
        chance: of the map.
    """

    def __init__(
        self,
        course: Course,
        source: MapFile,
        options: RegisterOptions,
        *,
        weather: str,
        day_seed: int,
        seed: int,
        ticks: int,
        tick_s: float,
        chance: Chance = POOLED,
    ) -> None:
        self._course, self._tick_s = course, tick_s
        self.frame: SceneFrame = scene_frame_of(source.description.frame)
        self._scans = round(tick_s * course.spec.scan_hz)
        self._radar = LiveRadar(
            course.ground,
            WEATHER[weather](day_seed),
            course.road,
            course.array,
            draw_springs(course.plan, seed),
            scans=(ticks + 1) * self._scans,
            seed=seed,
            faults=Faults(),
        )
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
        self._search = Registration(
            ground, operators, course.array, options, chance=chance, recorded=known.samples, block_scans=self._scans
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
        """Scans of one tick: recorded along the true way from ``before`` to ``after``, searched about GNSS/INS.

        Args:
            before, after: the loop's state before and after ``move``.
            setup: of the loop.
            readings: of the tick.
            heard: whether the radar works in this tick; where it does not, its filter keeps its state.
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
            recorded.traces[kept].astype(np.float32) - 128.0,
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
        """Where GNSS/INS have the array's centre at each scan."""
        centre = _array_pose(_between(seen.start, seen.end, share), self._course.spec.array_x_m)
        keep = np.exp(-self._tick_s / 20.0)
        self._roll_error = keep * self._roll_error + np.sqrt(1 - keep**2) * _ROLL_SIGMA_RAD * self._rng.normal()
        height = np.full(len(share), self._course.array.height_m)
        return np.stack([centre[:, 0], centre[:, 1], height, centre[:, 2], roll_rad + self._roll_error], axis=1)


class _Seen(NamedTuple):
    """What a tick's search needs of the loop, fetched at once: four numbers a row, the last of a pose's unused.

    Attributes:
        before, after: true poses of the rear axle at the tick's ends.
        start, end: where GNSS/INS have it.
        odometer: its speed, the sigma of the GNSS/INS heading, the rear axle's place along the road, the tick.
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
    estimate = before.navigator.reckoned.estimate
    start = pose_of(estimate)
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
    # NumPy's, as a compiled function takes them: a transfer of each would cost as much as the call.
    numbers = [*(np.float32(part) for part in pose), covariance.astype(np.float32), np.float32(age_s), np.bool_(valid)]
    return LgprObservation(*(cast("Array", number) for number in numbers))
