"""One search for a drive, a window and a vehicle: evidence gathered scan by scan until it is enough.

Every few centimetres of travel a scan becomes a surface over the lattice of prior errors (``surfaces``). At each of
them all windows of the ladder are judged, and the shortest whose match foreign ground would not have given, but for the
risk that is accepted, makes the fix. A drive needs no window length of its own: good ground is known after a scan or a
metre, ground under snow after four.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.frames import body_to_local
from lgprjax.radar import LIGHT_SPEED_M_PER_NS, WAVE_SPEED_M_PER_NS, ArrayGeometry, CoefficientBasis, centre_of
from lgprjax.registration.chance import Chance, ladder_of, p_foreign, p_rival
from lgprjax.registration.correlation import OFF_MAP_SCORE, Template, score_each
from lgprjax.registration.finish import Finished, Region, finish_best
from lgprjax.registration.fix import Code, Fix
from lgprjax.registration.integrity import MIN_OVERLAP
from lgprjax.registration.labels import covariance_beside_match
from lgprjax.registration.live import LiveChain, LiveScans
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.prepared import Aspect, PreparedGround
from lgprjax.registration.surfaces import Peaks, ScanBatch, WindowBatch, scan_surfaces, window_peaks
from lgprjax.registration.tiles import to_tile

_SLACK_M = 0.5  # what a prior may wander from the lattice's middle before the lattice follows
_SMOOTH_M = 2.0  # of travel over which the prior's distance from dead reckoning is told
_SPACING = 0.3  # of the wavelength, from stop to stop
_BATCH = 16
_ENDS = 32
_CHUNK_M = 4.0  # of travel that is judged before scale and region are reconsidered
_LOST_M = 8.0  # without a place after which a region of twice the side is tried
SCALES = np.arange(0.925, 1.1301, 0.015)
"""Time scales that are tried where no place is known."""
_NEAR_SCALES = np.array([-0.02, 0.0, 0.02])
_NEAR_TRIED, _ALL_TRIED = 2.0, 7.0  # independent ones of these scales, as neighbours score alike
_NEAR_M = 0.5
_FLOOR_M = 6.0  # of travel over which the noise floor is told; in wavelengths where these are longer than a metre
_PROBED = 32
_CARRIED_M = 0.3  # what a carried place may be wrong by at once
_CONTESTED = 0.05  # probability of being only a likeness of a place elsewhere, above which no place is carried on
_DRIFT = 0.05  # share of the travel that odometry and heading may lead astray
_DECOYS = 384
_TILE_ROOM_M = 0.5
_TURN_RAD = np.radians(15.0)
_LEAST_GAIN = 0.5  # of the noise floor, over the last probes together
_SCALE_STEP = 0.0025  # a fortieth of a wavelength at forty wavelengths' depth
_AGAIN = 0.01
_FORGET = 0.75  # of what the last probes said, from probe to probe of a lost drive
_FINE_TRACES = 192  # of a window that the finish takes


def decoy_reach_m(wavelength_m: float) -> float:
    """How far beyond the region decoys lie: some dozen independent places ahead and behind."""
    return max(7.0, 8.0 * wavelength_m)


class Stops(NamedTuple):
    """Scans that stand for their stretch of travel, in order: history first.

    Attributes:
        number: of the scan in its drive.
        filtered: traces as recorded, track filter applied.
        coefficients, valid: of each trace, at the time scale of that moment.
        pose, speed_mps, sigma_yaw_rad: of the prior.
        reckoned_m: the array's centre by odometry and heading alone.
        path_m: travel.
        leg: number of the stretch over which travel is known.
    """

    number: Int[np.ndarray, " stop"]
    filtered: Float[np.ndarray, "stop channel recorded"]
    coefficients: Float[np.ndarray, "stop channel coefficient"]
    valid: Bool[np.ndarray, "stop channel"]
    pose: Float[np.ndarray, "stop 5"]
    speed_mps: Float[np.ndarray, " stop"]
    sigma_yaw_rad: Float[np.ndarray, " stop"]
    reckoned_m: Float[np.ndarray, "stop 2"]
    path_m: Float[np.ndarray, " stop"]
    leg: Int[np.ndarray, " stop"]


@dataclass(frozen=True)
class Plan:
    """Sizes of a search on a map.

    Attributes:
        spacing_m: of travel from stop to stop.
        lattice_m: step of the lattice of prior errors, forward and left.
        windows_m: lengths tried.
        history: stops that the longest window reaches back.
        members: scans of a window that the finish takes.
    """

    spacing_m: float
    lattice_m: Float[np.ndarray, "2"]
    windows_m: tuple[float, ...]
    history: int
    members: int

    @staticmethod
    def of(prepared: PreparedGround, options: RegisterOptions) -> "Plan":
        """Plan of a search."""
        wavelength_m = prepared.ground.description.settings.wavelength_m
        windows_m = ladder_of(wavelength_m) if options.window_m is None else (options.window_m,)
        longest_m = max(windows_m)
        spacing_m = _SPACING * wavelength_m if longest_m > 0.0 else 0.0
        history = int(np.ceil(longest_m / spacing_m)) + 2 if longest_m > 0.0 else 0
        channels = len(prepared.array.x_m)
        members = 1 if longest_m <= 0.0 else int(np.clip(_FINE_TRACES // channels, 8, 64))
        return Plan(spacing_m, prepared.step_m, windows_m, history, members)

    def points(self, half_m: float) -> tuple[int, int]:
        """Of a lattice, forward and left, that reaches so far to all sides."""
        forward, left = (2 * int(np.ceil(half_m / step_m)) + 1 for step_m in self.lattice_m)
        return forward, left


class Judged(NamedTuple):
    """The window chosen at each stop.

    Attributes:
        window: number in the ladder.
        peak: fields of ``Peaks`` of that window.
        p_false, p_rival: see ``chance``.
        code: a ``Code``.
        first: first stop of the window.
        origin_m: lattice's middle, east and north from dead reckoning.
        step: lattice points to a side.
    """

    window: Int[np.ndarray, " stop"]
    peak: Peaks
    p_false: Float[np.ndarray, " stop"]
    p_rival: Float[np.ndarray, " stop"]
    code: Int[np.ndarray, " stop"]
    first: Int[np.ndarray, " stop"]
    error_m: Float[np.ndarray, "stop 2"]


class EvidenceSearch:
    """Search of one drive.

    Args:
        prepared: ground of the map for the drive's array.
        chain: of the drive.
        options: what the user decided.
        chance: of the map.
    """

    def __init__(self, prepared: PreparedGround, chain: LiveChain, options: RegisterOptions, chance: Chance) -> None:
        self._prepared, self._ground, self._chain = prepared, prepared.ground, chain
        self._options, self._chance = options, chance
        self.plan = Plan.of(prepared, options)
        self._centre = np.array(centre_of(prepared.array))
        self._left_m = prepared.array.y_m - self._centre[1]
        self._wavelength_m = self._ground.description.settings.wavelength_m
        # Half a step of height is a twentieth of a period: the finish finds the rest.
        period_ns = self._wavelength_m / WAVE_SPEED_M_PER_NS
        count = int(np.ceil(options.height_m / (LIGHT_SPEED_M_PER_NS * period_ns / 40.0)))
        self._heights_m = (options.height_m * (np.arange(count) * (2.0 / count) + (1.0 / count - 1.0))).astype(
            np.float32
        )
        self._planes = count + 2
        self._stops: Stops | None = None
        self._surfaces: Float[np.ndarray, "stop plane forward left"] | None = None
        self._decoys: Float[np.ndarray, "stop plane decoy"] | None = None
        self._power: Float[np.ndarray, " stop"] | None = None
        self._floor = np.zeros((2, 0, len(self.plan.windows_m)))
        self._facing_rad = 0.0
        self._origin_m: Float[np.ndarray, 2] | None = None
        self._tile: int | None = None
        self._next_m = -np.inf
        self._half_m = options.search_half_m()
        self._wide = False
        self._ready = 0
        self._seen_m = 0.0
        self._tried_m = -np.inf
        self._probed_m = -np.inf
        self._lately = np.zeros(len(SCALES))
        self._bend = np.zeros(2)
        self._scales = 1.0
        self._error_m: Float[np.ndarray, 2] | None = None
        self.time_scale = 1.0 if options.time_scale is None else options.time_scale

    def choose(self, scans: LiveScans) -> Int[np.ndarray, " stop"]:
        """Which scans become stops: those nearest to equal steps of travel."""
        if self.plan.spacing_m <= 0.0:
            return np.arange(len(scans.number))
        chosen = []
        ahead = np.diff(scans.path_m, append=scans.path_m[-1:])
        for scan, path_m in enumerate(scans.path_m):
            if path_m + 0.5 * ahead[scan] >= self._next_m:
                chosen.append(scan)
                self._next_m = max(self._next_m, path_m - 0.5 * self.plan.spacing_m) + self.plan.spacing_m
        return np.asarray(chosen, dtype=int)

    def feed(
        self, scans: LiveScans
    ) -> tuple[Int[np.ndarray, " stop"], Fix, Float[np.ndarray, "stop 2 2"], Float[np.ndarray, " stop"]]:
        """Stops among these scans (positions in the block), their fixes in the map's frame, the part of each covariance
        that is not the match's, and the time scale."""
        chosen = self.choose(scans)
        fresh = stops_of(scans, chosen, self._prepared.array, self._ground.basis)
        before = 0 if self._stops is None else len(self._stops.number)
        stops = (
            fresh if self._stops is None else Stops(*(np.concatenate(f) for f in zip(self._stops, fresh, strict=True)))
        )
        if not len(chosen):
            return chosen, blank_fixes(0), np.zeros((0, 2, 2)), np.zeros(0)
        if before == 0:
            self._seen_m = float(stops.path_m[0])
        half_m = self._options.search_half_m(scans.track.sigma_m)
        if half_m != self._half_m:
            self._half_m, self._surfaces = half_m, None
        self._floor = np.concatenate([self._floor, np.zeros((2, len(chosen), len(self.plan.windows_m)))], axis=1)
        judged, scale = self._judge_all(stops, before)
        fix, beside = self._finish(stops, before, judged)
        keep = max(0, len(stops.number) - self.plan.history)
        self._stops = Stops(*(field[keep:] for field in stops))
        self._floor = self._floor[:, keep:]
        if self._surfaces is not None and self._decoys is not None and self._power is not None:
            self._surfaces, self._decoys, self._power = self._surfaces[keep:], self._decoys[keep:], self._power[keep:]
        self._ready -= keep
        return chosen, fix, beside, scale

    def highest(
        self, scans: LiveScans
    ) -> tuple[Float[np.ndarray, " stop"], Float[np.ndarray, "stop window"], Float[np.ndarray, "stop window"]]:
        """Score in units of the noise floor of every window's best place, whatever it may be worth.

        Returns:
            travel of each stop; z, NaN where a window does not fit or no map lies below; area of its region on the map.
        """
        stops = stops_of(scans, self.choose(scans), self._prepared.array, self._ground.basis)
        astray = self._astray(stops)
        self._floor = np.zeros((2, len(stops.number), len(self.plan.windows_m)))
        z, area_m2 = [], []
        low, count = 0, len(stops.number)
        while low < count:
            self._follow(stops, astray, low)
            off = np.any(np.abs(astray[low:count] - self._origin_m) > _SLACK_M, axis=1)
            high = min(low + _ENDS, low + int(np.argmax(off)) if off.any() else count)
            peaks, _, first, _ = self._peaks(stops, low, high, astray)
            told = (first >= 0) & (peaks.score > OFF_MAP_SCORE) & (peaks.floor < 0.5)
            z.append(np.where(told, peaks.score / peaks.floor, np.nan))
            area_m2.append(peaks.area * np.prod(self.plan.lattice_m))
            low = high
        return stops.path_m, np.concatenate(z), np.concatenate(area_m2)

    def _astray(self, stops: Stops) -> Float[np.ndarray, "stop 2"]:
        """Prior less dead reckoning at each stop: the median over the last metres, so that a GNSS's noise is none."""
        apart = stops.pose[:, :2] - stops.reckoned_m
        begin = np.searchsorted(stops.path_m, stops.path_m - _SMOOTH_M)
        return np.stack([np.median(apart[low : at + 1], axis=0) for at, low in enumerate(begin)])

    def _judge_all(self, stops: Stops, before: int) -> tuple[Judged, Float[np.ndarray, " stop"]]:
        """Judge every stop from ``before`` on, a few metres at a time, and the time scale of each."""
        astray = self._astray(stops)
        count = len(stops.number)
        parts, scales = [], []
        low = before
        while low < count:
            self._follow(stops, astray, low)
            assert self._origin_m is not None
            off = np.any(np.abs(astray[low:count] - self._origin_m) > _SLACK_M, axis=1)
            off |= stops.path_m[low:count] > stops.path_m[low] + _CHUNK_M
            high = min(low + _ENDS, low + int(np.argmax(off)) if off.any() else count)
            judged = self._judge(stops, low, high, astray)
            if self._reconsider(stops, high, judged, astray):
                judged = self._judge(stops, low, high, astray)
                self._note(stops, high, judged)
            parts.append(judged)
            scales.append(np.full(high - low, self.time_scale))
            low = high
        whole: Judged = jax.tree.map(lambda *fields: np.concatenate(fields), *parts)
        return whole, np.concatenate(scales)

    def _follow(self, stops: Stops, astray: Float[np.ndarray, "stop 2"], low: int) -> None:
        """Move the lattice where the prior has left its middle, and turn the decoys with the vehicle."""
        yaw = float(stops.pose[low, 3])
        if abs(np.mod(yaw - self._facing_rad + np.pi, 2.0 * np.pi) - np.pi) > _TURN_RAD:
            self._facing_rad, self._surfaces = yaw, None
        if self._origin_m is not None and np.all(np.abs(astray[low] - self._origin_m) <= _SLACK_M):
            return
        ahead = astray[low : low + _ENDS]
        near = np.median(ahead[np.all(np.abs(ahead - astray[low]) <= _SLACK_M, axis=1)], axis=0)
        self._origin_m = near if np.all(np.abs(astray[low] - near) <= _SLACK_M) else astray[low].copy()
        self._surfaces = None

    def _note(self, stops: Stops, high: int, judged: Judged) -> bool:
        """Remember the last place that was believed; whether there was one."""
        ok = np.flatnonzero(judged.code == Code.OK)
        if not len(ok):
            return False
        self._seen_m = float(stops.path_m[high - len(judged.code) + ok[-1]])
        self._error_m = judged.error_m[ok[-1]]
        return True

    def _reconsider(self, stops: Stops, high: int, judged: Judged, astray: Float[np.ndarray, "stop 2"]) -> bool:
        """Region and time scale after some metres; whether these are to be judged once more with others."""
        found = self._note(stops, high, judged)
        here_m = float(stops.path_m[high - 1])
        if self._wide and found:
            off = np.abs(judged.error_m[judged.code == Code.OK] - astray[high - 1]).max()
            if off < self._half_m - _SLACK_M:
                self._wide, self._surfaces = False, None
        lost = not found or here_m - self._seen_m > _CHUNK_M
        # A prior that is wrong enough has no map below it: that is no reason not to look farther.
        on_map = bool(np.any(judged.peak.overlap >= MIN_OVERLAP))
        again = on_map and self._options.time_scale is None and self._probe(stops, high, lost, here_m)
        at_edge = np.mean(judged.code == Code.EDGE) > 0.25
        if lost and not again and not self._wide and (at_edge or self._overdue(here_m)):
            self._wide, self._surfaces, self._tried_m = True, None, here_m
            return True
        if self._wide and not found and not again:
            self._wide, self._surfaces = False, None
        return again

    def _overdue(self, here_m: float) -> bool:
        """Whether a wider region is to be tried: no place for a while, and not tried just now."""
        return here_m - self._seen_m > _LOST_M and here_m - self._tried_m > 0.9 * _CHUNK_M

    def _probe(self, stops: Stops, high: int, lost: bool, here_m: float) -> bool:
        """Try other time scales on the last metres: a few about the last one, all where no place is known.

        Returns:
            whether the scale has changed so much that what was judged with it is to be judged again.
        """
        last = high - 1
        if here_m - self._probed_m < (_CHUNK_M / 2 if lost else _CHUNK_M) - self.plan.spacing_m:
            return False
        leg = int(np.searchsorted(stops.leg, stops.leg[last]))
        first = max(leg, int(np.searchsorted(stops.path_m, here_m - _CHUNK_M)))
        if here_m - stops.path_m[first] < 0.4 * _CHUNK_M:
            return False
        self._probed_m = here_m
        near = not lost and self._error_m is not None
        scales = self.time_scale + _NEAR_SCALES if near else SCALES
        assert self._origin_m is not None
        middle = self._origin_m if self._error_m is None or not near else self._error_m
        half_m = _NEAR_M if near else self._half_m
        points = self.plan.points(half_m + (0.0 if near else _SLACK_M))
        # Every second stop is enough to compare scales.
        at = np.arange(first, high)[::-2][::-1]
        rows = _PROBED
        at = at[-rows:]
        score, noise = np.zeros(len(scales)), np.ones(len(scales))
        for number, scale in enumerate(scales):
            own = self._chain.coefficients(stops.filtered[at], stops.valid[at], float(scale))
            surfaces, decoys, power = self._surfaces_of(stops, at, own, middle, points)
            fill = rows - len(at)
            peaks = jax.device_get(
                window_peaks(
                    np.concatenate([surfaces, np.zeros((fill, *surfaces.shape[1:]), np.float32)]),
                    np.concatenate([decoys, np.zeros((fill, *decoys.shape[1:]), np.float32)]),
                    np.concatenate([power, np.zeros(fill, np.float32)]),
                    WindowBatch(
                        np.zeros((1, 1), np.int32),
                        np.full(1, len(at) - 1, np.int32),
                        np.asarray([points], np.float32) // 2,
                        np.full(1, half_m, np.float32),
                        np.zeros((1, 2), np.float32),
                        np.zeros(1, np.float32),
                    ),
                    self.plan.lattice_m.astype(np.float32),
                    np.float32(0.6 * self._wavelength_m),
                    np.float32(MIN_OVERLAP),
                    near=(1, 1),
                )[0]
            )
            score[number] = float(peaks.score[0, 0])
            noise[number] = float(peaks.floor[0, 0]) or float(peaks.scatter[0, 0]) or 0.5
        if np.min(score) <= OFF_MAP_SCORE:
            return False
        before = self.time_scale
        if near:
            # A parabola through the last probes together: scores of one alone scatter by more than they fall.
            self._bend = _FORGET * self._bend + np.polyfit(scales - 1.0, score, 2)[:2]
            peak = 1.0 - 0.5 * self._bend[1] / self._bend[0] if self._bend[0] < 0.0 else float(scales[np.argmax(score)])
            peak = float(np.clip(peak, scales[0], scales[-1]))
            # Not for what scatter alone would promise.
            gain = np.polyval([*self._bend, 0.0], peak - 1.0) - np.polyval([*self._bend, 0.0], before - 1.0)
            step = peak - before if gain > _LEAST_GAIN * np.median(noise) else 0.0
        else:
            self._lately = _FORGET * self._lately + score / np.median(noise)
            best_one = int(np.argmax(self._lately))
            now = float(np.interp(before, SCALES, self._lately))
            # Scatter alone prefers one scale or another by about a noise floor.
            step = float(SCALES[best_one]) - before if self._lately[best_one] > now + 1.0 else 0.0
        self.time_scale = round((before + step) / _SCALE_STEP) * _SCALE_STEP
        if self.time_scale != before:
            self._scales = _NEAR_TRIED if near else _ALL_TRIED
        if abs(self.time_scale - before) < _AGAIN:
            return False
        self._bend[:] = 0.0
        stops.coefficients[:high] = self._chain.coefficients(stops.filtered[:high], stops.valid[:high], self.time_scale)
        self._surfaces = None
        return True

    @property
    def _points(self) -> tuple[int, int]:
        return self.plan.points(self._half_m * (2.0 if self._wide else 1.0) + _SLACK_M)

    def _extend(self, stops: Stops, high: int) -> None:
        """Surfaces of the stops up to ``high`` that have none yet."""
        if self._surfaces is None:
            have = max(0, high - _ENDS - self.plan.history)
            self._surfaces = np.zeros((have, self._planes, *self._points), np.float32)
            self._decoys = np.zeros((have, self._planes, _DECOYS), np.float32)
            self._power = np.zeros(have, np.float32)
        have = len(self._surfaces)
        if high <= have:
            return
        at = np.arange(have, high)
        bare = at[at >= self._ready]
        if len(bare):
            stops.coefficients[bare] = self._chain.coefficients(
                stops.filtered[bare], stops.valid[bare], self.time_scale
            )
            self._ready = high
        assert self._origin_m is not None
        made, decoys, power = self._surfaces_of(stops, at, stops.coefficients[at], self._origin_m, self._points)
        self._surfaces = np.concatenate([self._surfaces, made])
        self._decoys = np.concatenate([self._decoys, decoys])
        self._power = np.concatenate([self._power, power])

    def _surfaces_of(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        coefficients: Float[np.ndarray, "stop channel coefficient"],
        origin_m: Float[np.ndarray, "2"],
        points: tuple[int, int],
    ) -> tuple[
        Float[np.ndarray, "stop plane forward left"], Float[np.ndarray, "stop plane decoy"], Float[np.ndarray, " stop"]
    ]:
        out = np.zeros((len(at), self._planes, *points), np.float32)
        decoys = np.zeros((len(at), self._planes, _DECOYS), np.float32)
        power = np.zeros(len(at), np.float32)
        reach_m = float(np.max(self._middle(points)))
        centre = stops.reckoned_m[at] + origin_m
        tiles = self._tiles_at(centre, reach_m)
        known = np.flatnonzero(tiles >= 0)
        if not len(known):
            return out, decoys, power
        for aspect, rows in self._prepared.aspects(tiles[known], stops.pose[at[known], 3], stops.speed_mps[at[known]]):
            rows = known[rows]
            for low in range(0, len(rows), _BATCH):
                some = rows[low : low + _BATCH]
                surfaces, apart, loud = self._on_tile(stops, at[some], coefficients[some], centre[some], aspect, points)
                out[some], decoys[some], power[some] = (part[: len(some)] for part in (surfaces, apart, loud))
        return out, decoys, power

    def _on_tile(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        coefficients: Float[np.ndarray, "stop channel coefficient"],
        centre: Float[np.ndarray, "stop 2"],
        aspect: Aspect,
        points: tuple[int, int],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        ground, ready = self._ground, self._prepared.at(aspect)
        frame = ground.frame(aspect.tile)
        aside = _turn(self._facing_rad - frame[2])
        axes = self.plan.lattice_m[:, None] * aside
        half = self._middle(points) @ aside
        rows = np.concatenate([at, np.full(_BATCH - len(at), at[0])])
        middle = np.concatenate([centre, np.tile(centre[:1], (_BATCH - len(at), 1))])
        placed = to_tile(np.concatenate([middle, stops.pose[rows, 2:]], axis=1), frame)[:, :2]
        corner = placed - half
        pose = stops.pose[rows]
        above = (
            pose[:, 2, None] + self._left_m * np.sin(pose[:, 4, None]) - ground.source.height_reference_m[aspect.tile]
        )
        surfaces, decoys, loud = scan_surfaces(
            ready.columns,
            ground.components,
            ScanBatch(
                np.concatenate([coefficients, np.tile(coefficients[:1], (_BATCH - len(at), 1, 1))]),
                stops.valid[rows],
                above.astype(np.float32),
                corner.astype(np.float32),
            ),
            axes.astype(np.float32),
            (self._decoys_about @ aside + half).astype(np.float32),
            self._heights_m,
            ground.basis.angular_frequency_rad_per_ns,
            points=points,
        )
        return np.asarray(surfaces), np.asarray(decoys), np.asarray(loud)

    def _middle(self, points: tuple[int, int]) -> Float[np.ndarray, "2"]:
        """Forward and left, in metres, from a lattice's first point to its middle."""
        return np.asarray((np.asarray(points) // 2) * self.plan.lattice_m)

    @property
    def _decoys_about(self) -> Float[np.ndarray, "decoy 2"]:
        """Forward and left of places beyond the region: evenly ahead and behind, as far to the sides as it is."""
        number = np.arange(_DECOYS)
        forward, left = np.mod(0.5 + number * 0.7548776662, 1.0), np.mod(0.5 + number * 0.5698402910, 1.0)
        least_m = self._half_m + self._wavelength_m
        ahead = np.where(number % 2 == 0, 1.0, -1.0) * (least_m + forward * decoy_reach_m(self._wavelength_m))
        # Half of them on the vehicle's own line: a map may be no wider than that.
        pitch_m = self._ground.description.channel_pitch_m
        aside = np.where(number % 4 < 2, self._half_m + 0.5, 0.5 * pitch_m)
        return np.stack([ahead, (2.0 * left - 1.0) * aside], axis=1)

    def _tiles_at(self, places_m: Float[np.ndarray, "stop 2"], reach_m: float) -> Int[np.ndarray, " stop"]:
        """Tile of each place; -1 for none. Asked for anew every half metre: a tile holds more than it must."""
        out = np.full(len(places_m), -1)
        asked: Float[np.ndarray, 2] | None = None
        for row, place in enumerate(places_m):
            if asked is None or np.max(np.abs(place - asked)) > _TILE_ROOM_M:
                self._tile = self._ground.tile_holding(self._tile, place, reach_m + _TILE_ROOM_M)
                asked = place
            out[row] = -1 if self._tile is None else self._tile
        return out

    def _judge(self, stops: Stops, low: int, high: int, astray: Float[np.ndarray, "stop 2"]) -> Judged:
        whole, near, first, centre = self._peaks(stops, low, high, astray)
        return self._decide(stops, whole, near, first, np.arange(low, high), centre)

    def _peaks(
        self, stops: Stops, low: int, high: int, astray: Float[np.ndarray, "stop 2"]
    ) -> tuple[Peaks, Peaks, Int[np.ndarray, "end window"], Float[np.ndarray, "end 2"]]:
        """Peaks of all windows that end at some stops, in the whole region and near the last place; first stops of the
        windows, and lattice points of the priors."""
        plan, lattice_m, points = self.plan, self.plan.lattice_m, self._points
        half_m = self._half_m * (2.0 if self._wide else 1.0)
        self._extend(stops, high)
        at = np.arange(low, high)
        first = self._first_of(stops, at)
        # One shape: as many surfaces as the longest window and a full batch take.
        held = plan.history + _ENDS
        begin = max(0, high - held)
        pad = held - (high - begin)
        assert self._surfaces is not None
        assert self._decoys is not None
        assert self._power is not None
        assert self._origin_m is not None
        surfaces = np.concatenate([self._surfaces[begin:high], np.zeros((pad, *self._surfaces.shape[1:]), np.float32)])
        decoys = np.concatenate([self._decoys[begin:high], np.zeros((pad, *self._decoys.shape[1:]), np.float32)])
        power = np.concatenate([self._power[begin:high], np.zeros(pad, np.float32)])
        fill = _ENDS - len(at)
        ends = np.concatenate([at, np.full(fill, at[-1])])
        starts = np.concatenate([first, np.tile(first[-1:], (fill, 1))])
        centre = ((astray[ends] - self._origin_m) @ _turn(self._facing_rad).T + self._middle(points)) / lattice_m
        carried_m = _CARRIED_M + _DRIFT * np.abs(stops.path_m[ends] - self._seen_m)
        carried = centre if self._error_m is None else self._point_of(self._error_m, points)[None]
        both: tuple[Peaks, Peaks] = jax.device_get(
            window_peaks(
                surfaces,
                decoys,
                power,
                WindowBatch(
                    np.where(starts >= 0, starts - begin, -1).astype(np.int32),
                    (ends - begin).astype(np.int32),
                    centre.astype(np.float32),
                    np.full(_ENDS, half_m, np.float32),
                    np.broadcast_to(carried, (_ENDS, 2)).astype(np.float32),
                    carried_m.astype(np.float32),
                ),
                lattice_m.astype(np.float32),
                np.float32(0.6 * self._wavelength_m),
                np.float32(MIN_OVERLAP),
                near=plan.points(_CARRIED_M + _DRIFT * _LOST_M),
            )
        )
        whole, near = (jax.tree.map(lambda field: np.asarray(field)[: len(at)], peaks) for peaks in both)
        floor = self._settled_floor(stops, at, whole)
        return whole._replace(floor=floor), near._replace(floor=floor), first, centre[: len(at)]

    def _settled_floor(
        self, stops: Stops, at: Int[np.ndarray, " end"], peaks: Peaks
    ) -> Float[np.ndarray, "end window"]:
        """Noise floors over the last metres together: decoys of one place are few, and each stop brings others.

        Where hardly any decoy lay on the map, chance is told from what the region itself holds far from its best place;
        where that is too little as well, as little is believed as can be.
        """
        self._floor[:, at] = peaks.floor, peaks.scatter
        begin = np.searchsorted(stops.path_m, stops.path_m[at] - _FLOOR_M * max(1.0, self._wavelength_m))
        told = np.pad(np.cumsum(self._floor > 0.0, axis=1), [(0, 0), (1, 0), (0, 0)])
        total = np.pad(np.cumsum(self._floor**2, axis=1), [(0, 0), (1, 0), (0, 0)])
        count: Int[np.ndarray, "kind end window"] = told[:, at + 1] - told[:, begin]
        mean = np.sqrt((total[:, at + 1] - total[:, begin]) / np.maximum(count, 1))
        return np.where(count[0] > 0, mean[0], np.where(count[1] > 0, mean[1], 0.5))

    def _weigh(
        self, peaks: Peaks, first: Int[np.ndarray, "end window"], scales: float
    ) -> tuple[Float[np.ndarray, "end window"], Float[np.ndarray, "end window"]]:
        """Probabilities that foreign ground, and that a rival, would have given these peaks; 1 where there is none."""
        known = (first >= 0) & (peaks.score > OFF_MAP_SCORE)
        z = np.where(known, peaks.score / peaks.floor, 0.0)
        rival = np.where(peaks.rival > OFF_MAP_SCORE, peaks.rival / peaks.floor, 0.0)
        area_m2 = peaks.area * np.prod(self.plan.lattice_m)
        chance = self._chance.for_windows(self.plan.windows_m, self._wavelength_m)
        foreign = np.where(known, p_foreign(z, area_m2, chance, scales * len(self.plan.windows_m)), 1.0)
        rivals = np.where(known, p_rival(z, rival), 1.0)
        own, risk = self._options.own_thresholds, self._options.risk
        if own is not None:
            foreign = np.where(z >= own.strength_by_chance, np.minimum(foreign, risk), np.maximum(foreign, 2.0 * risk))
            rivals = np.where(z - rival >= own.margin_by_chance, 0.0, 1.0)
        return foreign, rivals

    def _point_of(self, error_m: Float[np.ndarray, "2"], points: tuple[int, int]) -> Float[np.ndarray, "2"]:
        """Lattice point of an error of the prior, east and north from dead reckoning."""
        assert self._origin_m is not None
        about_m = (error_m - self._origin_m) @ _turn(self._facing_rad).T
        return np.asarray((about_m + self._middle(points)) / self.plan.lattice_m)

    def _first_of(self, stops: Stops, at: Int[np.ndarray, " end"]) -> Int[np.ndarray, "end window"]:
        """First stop of each window that ends at each stop; -1 where its leg is not that long yet."""
        begin = np.searchsorted(stops.leg, stops.leg[at])
        # What lies before the history is forgotten: the longest window reaches just so far.
        out = np.full((len(at), len(self.plan.windows_m)), -1)
        for number, length_m in enumerate(self.plan.windows_m):
            wanted_m = stops.path_m[at] - length_m
            whole = (stops.path_m[begin] <= wanted_m + 0.5 * self.plan.spacing_m + 1e-6) | (length_m <= 0.0)
            inside = np.searchsorted(stops.path_m, wanted_m - 1e-6)
            inside = at if length_m <= 0.0 else np.maximum(inside, begin)
            out[:, number] = np.where(whole, inside, -1)
        return out

    def _decide(
        self,
        stops: Stops,
        whole: Peaks,
        near: Peaks,
        first: Int[np.ndarray, "end window"],
        at: Int[np.ndarray, " end"],
        centre: Float[np.ndarray, "end 2"],
    ) -> Judged:
        half_m, points = self._half_m * (2.0 if self._wide else 1.0), self._points
        since_m = stops.path_m[at] - self._seen_m
        foreign, rivals = self._weigh(whole, first, self._scales)
        off_m = np.max(np.abs(whole.point - centre[:, None]) * self.plan.lattice_m, axis=-1)
        at_edge = whole.at_rim | (off_m > half_m)
        risk = self._options.risk
        known = (first >= 0) & (whole.score > OFF_MAP_SCORE)
        good = known & (foreign <= risk) & (rivals <= risk) & ~at_edge
        # Once there is a place, the next is looked for about it: few places that foreign ground could match. What is
        # about as good elsewhere contests it.
        held = (self._error_m is not None) & (since_m <= _LOST_M)
        near_foreign, near_rivals = self._weigh(near, first, 1.0)
        astray = np.linalg.norm((whole.point - near.point) * self.plan.lattice_m, axis=-1)
        elsewhere = np.where(astray > 0.6 * self._wavelength_m, whole.score, whole.rival)
        here, there = (np.asarray(score / near.floor, dtype=np.float64) for score in (near.score, elsewhere))
        against = p_rival(here, there) > _CONTESTED
        carried = known & held[:, None] & (near_foreign <= risk) & (near_rivals <= risk) & ~near.at_rim & ~against
        taken = carried & ~good
        pick = taken[..., None]
        whole = Peaks(*(np.where(pick if a.ndim == 3 else taken, b, a) for a, b in zip(whole, near, strict=True)))
        foreign, rivals = np.where(taken, near_foreign, foreign), np.where(taken, near_rivals, rivals)
        at_edge, good = at_edge & ~taken, good | taken
        worst = np.where(known, np.maximum(foreign, rivals) + at_edge, 3.0)
        chosen = np.where(good.any(axis=1), np.argmax(good, axis=1), np.argmin(worst, axis=1))
        row = np.arange(len(at))
        peak: Peaks = jax.tree.map(lambda field: field[row, chosen], whole)
        foreign, rivals, begin = foreign[row, chosen], rivals[row, chosen], first[row, chosen]
        finite = np.array([np.mean(stops.valid[max(b, 0) : e + 1]) for b, e in zip(begin, at, strict=True)])
        code = np.full(len(at), int(Code.OK))
        for applies, reason in (
            (rivals > risk, Code.AMBIGUOUS),
            (at_edge[row, chosen], Code.EDGE),
            (foreign > risk, Code.LOW_CORRELATION),
            (peak.overlap < MIN_OVERLAP, Code.LOW_OVERLAP),
            (peak.overlap <= 0.0, Code.OFF_MAP),
            (finite < MIN_OVERLAP, Code.NON_FINITE),
            (begin < 0, Code.NO_WINDOW),
        ):
            code = np.where(applies, int(reason), code)
        assert self._origin_m is not None
        about_m = peak.point * self.plan.lattice_m - self._middle(points)
        error_m = about_m @ _turn(self._facing_rad) + self._origin_m
        return Judged(chosen, peak, foreign, rivals, code, begin, np.asarray(error_m))

    def score_at(
        self, scans: LiveScans, at: Int[np.ndarray, " stop"], truth: Float[np.ndarray, "stop 5"]
    ) -> Float[np.ndarray, " stop"]:
        """Correlation of scans by themselves at poses of the map's frame; NaN off the map."""
        out = np.full(len(at), np.nan)
        known = np.flatnonzero(np.isfinite(truth[:, 0]))
        live = self._chain.coefficients(scans.filtered[at], scans.valid[at], self.time_scale)
        tile: int | None = None
        tiles = np.full(len(at), -1)
        for row in known:
            tile = self._ground.tile_holding(tile, truth[row, :2], 1.0)
            tiles[row] = -1 if tile is None else tile
        known = known[tiles[known] >= 0]
        yaw, speed = truth[:, 3], scans.track.speed_mps[at]
        array = self._prepared.array
        for aspect, rows in self._prepared.aspects(tiles[known], yaw[known], speed[known]):
            for low in range(0, len(rows), _BATCH):
                some = known[rows[low : low + _BATCH]]
                full = np.concatenate([some, np.full(_BATCH - len(some), some[0])])
                x_m = array.x_m - self._centre[0] + speed[full, None] * array.time_offset_s
                offset = np.stack([x_m, np.broadcast_to(self._left_m, x_m.shape)], axis=-1)
                frame = self._ground.frame(aspect.tile)
                valid = scans.valid[at][full]
                template = Template(
                    *(jnp.asarray(part) for part in (live[full], offset.astype(np.float32), valid, valid))
                )
                scores = score_each(
                    self._prepared.at(aspect).tile,
                    template,
                    to_tile(truth[full], frame).astype(np.float32),
                    np.float32(self._ground.source.height_reference_m[aspect.tile]),
                    self._ground.basis.angular_frequency_rad_per_ns,
                )
                out[some] = np.asarray(scores)[: len(some)]
        return out

    def _finish(self, stops: Stops, before: int, judged: Judged) -> tuple[Fix, Float[np.ndarray, "stop 2 2"]]:
        """Refine every candidate; fixes in the map's frame."""
        count = len(judged.code)
        fixes = blank_fixes(count)
        fixes.code[:] = judged.code
        at = before + np.arange(count)
        place = stops.reckoned_m[at] + judged.error_m
        candidate = np.flatnonzero((judged.peak.score > OFF_MAP_SCORE) & (judged.first >= 0))
        tiles = np.full(count, -1)
        tiles[candidate] = self._tiles_at(place[candidate], 1.0)
        candidate = candidate[tiles[candidate] >= 0]
        fixes.p_false[candidate] = judged.p_false[candidate]
        fixes.window_m[candidate] = np.asarray(self.plan.windows_m)[judged.window[candidate]]
        for aspect, rows in self._prepared.aspects(
            tiles[candidate], stops.pose[at[candidate], 3], stops.speed_mps[at[candidate]]
        ):
            rows = candidate[rows]
            for low in range(0, len(rows), _BATCH):
                some = rows[low : low + _BATCH]
                self._finish_some(stops, at, place, judged, aspect, some, fixes)
        beside = covariance_beside_match(self._prepared, tiles, fixes, self._options.odometer_sigma)
        if self._options.own_thresholds is not None:
            fixes.covariance[:] *= self._options.own_thresholds.sigma_scale**2
        fixes.covariance[:, :2, :2] += np.nan_to_num(beside)
        return fixes, beside

    def _finish_some(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        place: Float[np.ndarray, "stop 2"],
        judged: Judged,
        aspect: Aspect,
        some: Int[np.ndarray, " candidate"],
        fixes: Fix,
    ) -> None:
        ground = self._ground
        frame = ground.frame(aspect.tile)
        rows = np.concatenate([some, np.full(_BATCH - len(some), some[0])])
        last, first = at[rows], judged.first[rows]
        member = np.round(np.linspace(last, first, self.plan.members, axis=1)).astype(int)
        fresh = np.diff(member, axis=1, prepend=last[:, None] + 1) != 0
        template = templates_of(stops, self._prepared.array, last, member, fresh)
        prior = stops.pose[last]
        start = np.concatenate([place[rows], stops.pose[last, 2:]], axis=1)
        start[:, 2] += self._heights_m[judged.peak.height[rows]]
        half = self._options.half_width(stops.sigma_yaw_rad[last], self._half_m)
        half[:, :2] = np.maximum(half[:, :2], np.abs(place[rows] - prior[:, :2]) + self._wavelength_m)
        level = [(0, 0), (0, 1)]
        found: Finished = jax.device_get(
            finish_best(
                self._prepared.at(aspect).tile,
                np.float32(ground.source.height_reference_m[aspect.tile]),
                ground.basis.angular_frequency_rad_per_ns,
                template,
                np.pad(to_tile(start, frame), level).astype(np.float32),
                Region(
                    jnp.asarray(np.pad(to_tile(prior, frame), level), dtype=jnp.float32),
                    jnp.asarray(half, dtype=jnp.float32),
                    jnp.asarray(stops.number[last], dtype=jnp.uint32),
                ),
                judged.peak.floor[rows].astype(np.float32),
                np.float32(MIN_OVERLAP),
                heading=self.plan.members * len(self._left_m) > 1,
                pitch=self._options.pitch_deg > 0.0,
                swarm=self._options.swarm,
                seed=np.uint32(self._options.seed),
            )
        )
        found = jax.tree.map(lambda field: np.asarray(field)[: len(some)], found)
        pose, covariance = fixes_to_map(np.asarray(found.pose), np.asarray(found.covariance), frame)
        fixes.pose[some], fixes.covariance[some] = pose, covariance
        fixes.correlation[some] = found.correlation
        score = np.asarray(judged.peak.score)[some]
        fixes.runner_up[some] = np.maximum(np.asarray(judged.peak.rival)[some], -1.0)
        fixes.margin[some] = score - fixes.runner_up[some]
        fixes.scatter[some] = np.asarray(judged.peak.floor)[some]
        fixes.overlap[some], fixes.overlap_channels[some] = found.overlap, found.overlap_channels
        # The climb must end where it began: a peak of its own, not a slope that leads off the map.
        away = np.hypot(*(pose[:, :2] - place[some]).T)
        left = (found.unfinished & (judged.code[some] == Code.OK)) | (away > 0.6 * self._wavelength_m)
        lost = ~np.isfinite(pose[:, 0])
        fixes.code[some] = np.where(
            lost,
            int(Code.LOW_OVERLAP),
            np.where(left & (judged.code[some] == Code.OK), int(Code.EDGE), judged.code[some]),
        )


def _turn(angle_rad: float) -> Float[np.ndarray, "2 2"]:
    """What a row of forward and left is multiplied by to be one of east and north."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, sin], [-sin, cos]])


def stops_of(
    scans: LiveScans, chosen: Int[np.ndarray, " stop"], array: ArrayGeometry, basis: CoefficientBasis
) -> Stops:
    """Stops of these scans, their coefficients yet to be made."""
    track, valid = scans.track, scans.valid[chosen]
    yaw = track.pose[chosen, 3]
    lever = np.stack(body_to_local(np.zeros(len(yaw)), np.zeros(len(yaw)), yaw, *centre_of(array)), axis=1)
    return Stops(
        scans.number[chosen],
        scans.filtered[chosen],
        np.zeros((*valid.shape, 2 * len(basis.angular_frequency_rad_per_ns)), np.float32),
        valid,
        track.pose[chosen],
        track.speed_mps[chosen],
        track.sigma_yaw_rad[chosen],
        scans.dead_reckoned_m[chosen] + lever,
        scans.path_m[chosen],
        track.leg[chosen],
    )


def templates_of(
    stops: Stops,
    array: ArrayGeometry,
    last: Int[np.ndarray, " end"],
    member: Int[np.ndarray, "end member"],
    fresh: Bool[np.ndarray, "end member"],
) -> Template:
    """Traces of the members about the last scan's centre, in its body frame: odometry and heading place the scans, and
    within a scan each channel stands where the vehicle had come when the switch matrix reached it.

    Args:
        stops: the scans.
        array: of the drive.
        last: scan that each template ends with.
        member: scans of each template, the last one first.
        fresh: members to use.
    """
    centre = centre_of(array)
    yaw = stops.pose[:, 3]
    apart = stops.reckoned_m[member] - stops.reckoned_m[last][:, None]
    body_x = array.x_m - centre[0] + stops.speed_mps[member][..., None] * array.time_offset_s
    body_y = np.broadcast_to(array.y_m - centre[1], body_x.shape)
    own = yaw[member][..., None]
    east = apart[..., 0, None] + np.cos(own) * body_x - np.sin(own) * body_y
    north = apart[..., 1, None] + np.sin(own) * body_x + np.cos(own) * body_y
    cos, sin = np.cos(yaw[last])[:, None, None], np.sin(yaw[last])[:, None, None]
    offset = np.stack([cos * east + sin * north, cos * north - sin * east], axis=-1)
    count, members, channels = east.shape
    valid = stops.valid[member] & fresh[..., None]
    coefficients = np.where(valid[..., None], stops.coefficients[member], 0.0)
    first = np.zeros((count, members, channels), bool)
    first[:, 0] = True
    return Template(
        jnp.asarray(coefficients.reshape(count, members * channels, -1), dtype=jnp.float32),
        jnp.asarray(offset.reshape(count, -1, 2), dtype=jnp.float32),
        jnp.asarray(valid.reshape(count, -1)),
        jnp.asarray(first.reshape(count, -1)),
    )


def blank_fixes(scans: int) -> Fix:
    """Fixes of scans that have none of their own."""

    def empty(*shape: int) -> Float[np.ndarray, "..."]:
        return np.full((scans, *shape), np.nan, np.float64)

    return Fix(
        pose=empty(5),
        covariance=empty(5, 5),
        correlation=empty(),
        runner_up=empty(),
        margin=empty(),
        scatter=empty(),
        overlap_channels=np.zeros(scans, np.int32),
        overlap=np.zeros(scans, np.float32),
        code=np.full(scans, Code.NO_WINDOW, np.int32),
        p_false=np.ones(scans),
        window_m=empty(),
    )


def fixes_to_map(
    pose: Float[np.ndarray, "end 5"], covariance: Float[np.ndarray, "end 5 5"], frame: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "end 5"], Float[np.ndarray, "end 5 5"]]:
    """Poses of a tile's frame in that of the map."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.eye(5)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    moved = np.asarray(pose, dtype=np.float64) @ turn.T + np.array([east, north, 0.0, yaw, 0.0])
    return moved, turn @ np.asarray(covariance, dtype=np.float64) @ turn.T
