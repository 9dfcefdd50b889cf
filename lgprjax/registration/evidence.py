"""The search: scans accumulate until a fix is certain enough; one driver for drives, windows and vehicles.

Every few centimetres of travel a scan becomes a surface over the lattice of prior errors (``surfaces``). At each, all
windows of the ladder are judged, and the shortest whose match has a false-match probability below the accepted risk
makes the fix. No window length has to be chosen: good ground is recognised within a metre, that under snow
after four.

Where a place is known, the next is searched for around it alone; every few metres the whole region is searched for a
place that is as good.
"""

from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Float, Int

from lgprjax.registration.candidates import ChosenWindows, StopFixes
from lgprjax.registration.coarse import Peaks, WindowBatch, window_peaks
from lgprjax.registration.estimates import (
    FAR_TRIED,
    AttitudeEstimate,
    Look,
    TimeScaleEstimate,
    better_attitude,
    unknown_attitude,
)
from lgprjax.registration.fix import Code, Fix, blank_fixes
from lgprjax.registration.judge import Chance, RegisterOptions
from lgprjax.registration.lattice import HELD_M, SLACK_M, ErrorLattice, RunningSums, Surfaces
from lgprjax.registration.queries import (
    LiveChain,
    LiveScans,
    SearchSizes,
    Stops,
    rotation,
    stops_of,
    turned,
)
from lgprjax.registration.score import OFF_MAP_SCORE
from lgprjax.registration.template_bank import PreparedGround
from lgprjax.registration.windows import APART, FLOOR_M, LOST_M, KnownPlace, WindowJudge

_SMOOTH_M = 2.0  # of travel over which the prior's offset from dead reckoning is estimated
_BATCH, _ENDS = 16, 32  # scans scored together, and window ends judged together
CHUNK_M = 4.0  # of travel judged before scale and region are reconsidered
_MOST_KEPT = 256  # stops kept for it, beyond those of the longest window: at standstill every scan may be one
_COMPARED = 16  # stops of the last metres that time scales, and other places, are compared over
CARRIED_M = 0.3  # error that a carried place may have from the start
DRIFT = 0.05  # error of odometry and heading, as a share of the travel
_ASIDE_M = 0.25  # from the centre of its lattice, at which the lattice follows a tracked place


class EvidenceSearch:
    """Search of one drive.

    Args:
        prepared: ground of the map for the drive's array.
        chain: conversion of the drive's scans.
        options: options of the search.
        chance: chance of a false match on the map.
        block_scans: largest number of scans per call of ``feed``. With ``options.track`` fixes do not depend on the
            division of scans into blocks.
    """

    def __init__(
        self,
        prepared: PreparedGround,
        chain: LiveChain,
        options: RegisterOptions,
        chance: Chance,
        block_scans: int = _ENDS,
    ) -> None:
        self._prepared, self._ground, self._chain = prepared, prepared.ground, chain
        self._options = options
        self.plan = SearchSizes.of(prepared, options)
        self._wavelength_m = self._ground.description.settings.wavelength_m
        # On board each stop is decided with the scans so far, whether or not another follows in its block.
        batch, self._ends = min(_BATCH, block_scans), 1 if options.track else min(_ENDS, block_scans)
        self._lattice = ErrorLattice(prepared, self.plan, options, batch)
        self._fixes = StopFixes(prepared, self._lattice, self.plan, options, chance.sigma_scale, batch)
        self._scale = TimeScaleEstimate(1.0 if options.time_scale is None else options.time_scale)
        self._attitude = AttitudeEstimate(
            options,
            len(prepared.array.x_m),
            self._wavelength_m,
            self._fixes.sigma_scale,
            # Nothing has been followed yet.
            self._unknown_attitude(),
            fed_back=options.track,
        )
        # The drive's dead reckoning, turned by the estimated heading error.
        self._turn, self._shift_m = np.eye(2), np.zeros(2)
        self._stops: Stops | None = None
        self._surfaces: RunningSums | None = None
        width_m = float(np.ptp(prepared.array.y_m))
        self._windows = WindowJudge(
            width_m, self._wavelength_m, self.plan, options, chance, self._lattice, self._attitude
        )
        self._next_m = -np.inf
        self._ready = 0
        self._tried_m = -np.inf
        self._start: tuple[Float[np.ndarray, 2], float] | None = None
        self._checked_m = -np.inf

    @property
    def _place(self) -> KnownPlace:
        return self._windows.place

    def _unknown_attitude(self) -> Float[np.ndarray, "3"]:
        profile_ns = len(self._ground.basis.gain) * self._ground.description.settings.sample_interval_ns
        scale_sigma = self._scale.sigma if self._options.time_scale is None else 0.0
        return unknown_attitude(self._prepared.array, profile_ns, scale_sigma)

    @property
    def history(self) -> int:
        """Stops of the longest window."""
        return self.plan.history

    def begin_at(self, place_m: Float[np.ndarray, "2"], until_m: float, time_scale: float) -> None:
        """Begin at a known place of the first scan, in the map's frame, and at a time scale: search about the place
        alone, up to this travel. Every window must hold against the whole region, and all attitudes, all the same.
        """
        self._start = place_m, until_m
        self._scale.value = time_scale
        self._scale.tried = self._scale.least_tried = FAR_TRIED

    def choose(self, scans: LiveScans) -> Int[np.ndarray, " stop"]:
        """Choose the scans that become stops: those nearest to equal steps of travel, or the next after each."""
        if self.plan.spacing_m <= 0.0:
            return np.arange(len(scans.number))
        chosen = []
        ahead = np.diff(scans.path_m, append=scans.path_m[-1:])
        if self._options.track:
            ahead = np.zeros(len(ahead))
        for scan, path_m in enumerate(scans.path_m):
            if path_m + 0.5 * ahead[scan] >= self._next_m:
                chosen.append(scan)
                self._next_m = max(self._next_m, path_m - 0.5 * self.plan.spacing_m) + self.plan.spacing_m
        return np.asarray(chosen, dtype=int)

    def feed(
        self, scans: LiveScans
    ) -> tuple[Int[np.ndarray, " stop"], Fix, Float[np.ndarray, "stop 2 2"], Float[np.ndarray, " stop"]]:
        """Stops among these scans (positions in the block) that were searched, their fixes in the map's frame, the part
        of each covariance due to map and odometer, and the time scale.
        """
        chosen = self.choose(scans)
        fresh = self._corrected(stops_of(scans, chosen, self._prepared.array, self._ground.basis))
        before = 0 if self._stops is None else len(self._stops.number)
        stops = (
            fresh if self._stops is None else Stops(*(np.concatenate(f) for f in zip(self._stops, fresh, strict=True)))
        )
        if scans.background is not None:
            earlier = np.where(stops.valid[:before, :, None], scans.background, np.float32(0.0))
            stops.filtered[:before] -= earlier
        if self._stops is None and len(chosen):
            self._windows.place = KnownPlace(seen_m=float(stops.path_m[0]))
        self._windows.make_room(len(chosen))
        answered, fix, beside, scale = chosen[:0], blank_fixes(0), np.zeros((0, 2, 2)), np.zeros(0)
        # Scans before the background is known wait, to be part of later windows.
        if scans.settled and len(chosen):
            half_m = self._options.search_half_m(scans.track.sigma_m)
            if half_m != self._lattice.half_m:
                self._lattice.half_m, self._surfaces = half_m, None
            if self._start is not None:
                (place_m, until_m), self._start = self._start, None
                error_m = place_m - stops.reckoned_m[0]
                found_in = (2.0 * half_m) ** 2, self._windows.trials * self._scale.tried
                self._windows.place = KnownPlace(error_m, until_m, np.inf, found_in)
                self._checked_m = until_m - CHUNK_M
                self._hold(error_m)
            if self._options.track and scans.background is not None:
                # Those before it in earlier blocks have no fix either.
                waits = int(np.searchsorted(scans.path_m[chosen], scans.settled_m))
                answered, before = chosen[waits:], before + waits
            else:
                answered = chosen
            if len(answered):
                fix, beside, scale = self._judge_all(stops, before)
        keep = self._dropped(stops)
        self._stops = Stops(*(field[keep:] for field in stops))
        self._windows.drop(keep)
        self._ready -= keep
        if self._surfaces is not None:
            self._surfaces.renumber(keep)
        return answered, fix, beside, scale

    def _dropped(self, stops: Stops) -> int:
        """Stops farther back than any window reaches; on board, than any noise floor or probe does, too.

        There an even number of them: some of a window are chosen by rounding their positions, halves to even.
        """
        if not len(stops.number) or not self._options.track:
            return max(0, len(stops.number) - self.plan.history)
        reach_m = max(CHUNK_M, FLOOR_M * max(1.0, self._wavelength_m))
        recent = len(stops.number) - int(np.searchsorted(stops.path_m, stops.path_m[-1] - reach_m))
        return max(0, len(stops.number) - max(self.plan.history, min(recent, _MOST_KEPT))) // 2 * 2

    def score_at(
        self, scans: LiveScans, at: Int[np.ndarray, " stop"], truth: Float[np.ndarray, "stop 5"]
    ) -> Float[np.ndarray, " stop"]:
        """Correlation of scans by themselves at poses of the map's frame; NaN off the map."""
        live = self._chain.coefficients(scans.filtered[at], scans.valid[at], self._scale.value)
        return self._fixes.score_at(scans, at, live, truth)

    def highest(
        self, scans: LiveScans
    ) -> tuple[Float[np.ndarray, " stop"], Float[np.ndarray, "stop window"], Float[np.ndarray, "stop window"]]:
        """Score in units of the noise floor at every window's best place, accepted or not.

        Returns:
            travel of each stop; z, NaN where a window does not fit or there is no map; area of its region on the map.
        """
        stops = stops_of(scans, self.choose(scans), self._prepared.array, self._ground.basis)
        astray = self._astray(stops)
        self._windows.make_room(len(stops.number))
        z, area_m2 = [], []
        low, count = 0, len(stops.number)
        while low < count:
            self._follow(stops, astray, low)
            off = np.any(np.abs(astray[low:count] - self._lattice.origin_m) > SLACK_M, axis=1)
            high = min(low + self._ends, low + int(np.argmax(off)) if off.any() else count)
            peaks, _, first, _ = self._peaks(stops, low, high, astray)
            conclusive = (first >= 0) & (peaks.score > OFF_MAP_SCORE) & (peaks.floor < 0.5)
            z.append(np.where(conclusive, peaks.score / peaks.floor, np.nan))
            area_m2.append(peaks.area * np.prod(self.plan.lattice_m))
            low = high
        return stops.path_m, np.concatenate(z), np.concatenate(area_m2)

    def _astray(self, stops: Stops) -> Float[np.ndarray, "stop 2"]:
        """Prior minus dead reckoning at each stop: the median over the last metres, to suppress the noise of GNSS."""
        apart = stops.pose[:, :2] - stops.reckoned_m
        # Of one leg only, because without known travel dead reckoning restarts anywhere.
        begin = np.searchsorted(stops.path_m, stops.path_m - _SMOOTH_M)
        begin = np.maximum(begin, np.searchsorted(stops.leg, stops.leg))
        return np.stack([np.median(apart[low : at + 1], axis=0) for at, low in enumerate(begin)])

    def _corrected(self, stops: Stops) -> Stops:
        """Stops with the corrections of heading, height and roll that were found so far."""
        pose = stops.pose.copy()
        pose[:, 2:5] += self._attitude.applied
        return stops._replace(pose=pose, reckoned_m=stops.reckoned_m @ self._turn.T + self._shift_m)

    def _correct(self, stops: Stops, at: int) -> None:
        """Correct all stops by the present attitude estimate; dead reckoning is turned about stop ``at``."""
        wanted = self._attitude.correction()
        if wanted is None:
            return
        more = wanted - self._attitude.applied
        self._attitude.applied = wanted
        corrected, about_m = turned(stops, more, at), stops.reckoned_m[at].copy()
        stops.pose[:], stops.reckoned_m[:] = corrected.pose, corrected.reckoned_m
        turn = rotation(more[1])
        self._turn, self._shift_m = turn @ self._turn, turn @ (self._shift_m - about_m) + about_m
        self._surfaces = None

    def _judge_all(
        self, stops: Stops, before: int
    ) -> tuple[Fix, Float[np.ndarray, "stop 2 2"], Float[np.ndarray, " stop"]]:
        """Fixes of every stop from ``before`` on, a few metres at a time, with the part of each covariance due to map
        and odometer, and the time scale. Each stretch begins with the time scale and attitude estimated on the previous
        one.
        """
        astray = self._astray(stops)
        count = len(stops.number)
        fixes, besides, scales = [], [], []
        low = before
        while low < count:
            if low and stops.leg[low] != stops.leg[low - 1]:
                # Without known travel the place is unknown too.
                self._windows.place = KnownPlace(seen_m=float(stops.path_m[low]))
                self._hold(None)
            self._follow(stops, astray, low)
            off = np.any(np.abs(astray[low:count] - self._lattice.origin_m) > SLACK_M, axis=1)
            off |= stops.leg[low:count] != stops.leg[low]
            off |= stops.path_m[low:count] > stops.path_m[low] + CHUNK_M
            high = min(low + self._ends, low + int(np.argmax(off)) if off.any() else count)
            judged = self._judge(stops, low, high, astray)
            # At most three rounds: released, then another time scale, then a wider region.
            while self._reconsider(stops, high, judged, astray):
                judged = self._judge(stops, low, high, astray)
            fix, beside = self._fixes.finish(stops, low, judged, self._attitude)
            fixes.append(fix)
            besides.append(beside)
            scales.append(np.full(high - low, self._scale.value))
            applied = self._attitude.applied
            self._correct(stops, high - 1)
            if applied is not self._attitude.applied:
                astray = self._astray(stops)
            low = high
        whole: Fix = jax.tree.map(lambda *fields: np.concatenate(fields), *fixes)
        return whole, np.concatenate(besides), np.concatenate(scales)

    def _follow(self, stops: Stops, astray: Float[np.ndarray, "stop 2"], low: int) -> None:
        if self._lattice.follow(stops, astray, low, low + self._ends):
            self._surfaces = None

    def _widen(self, wide: bool) -> None:
        self._lattice.wide, self._surfaces = wide, None

    def _note(self, stops: Stops, high: int, judged: ChosenWindows) -> bool:
        """Remember the last accepted place, and where it was first found; True if there was one."""
        ok = np.flatnonzero(judged.code == Code.OK)
        if not len(ok):
            return False
        path_m = stops.path_m[high - len(judged.code) + ok]
        for one in (0, -1):
            area = float(judged.peak.area[ok[one]])
            self._windows.take(float(path_m[one]), judged.error_m[ok[one]], area, self._scale.tried)
        return True

    def _reconsider(self, stops: Stops, high: int, judged: ChosenWindows, astray: Float[np.ndarray, "stop 2"]) -> bool:
        """Reconsider region and time scale after some metres; True if the metres must be judged again."""
        found = self._note(stops, high, judged)
        here_m = float(stops.path_m[high - 1])
        held = self._lattice.place_m is not None
        if held and (here_m - self._place.seen_m > 0.5 * CHUNK_M or self._contested(stops, high, astray, CHUNK_M)):
            self._hold(None)
            return True
        if self._lattice.wide and found:
            off = np.abs(judged.error_m[judged.code == Code.OK] - astray[high - 1]).max()
            if off < self._lattice.half_m - SLACK_M:
                self._widen(False)
        lost = not held and (not found or here_m - self._place.seen_m > CHUNK_M)
        # A prior may be wrong enough to be off the map: that is no reason not to search farther.
        on_map = bool(np.any(judged.peak.overlap >= self.plan.min_overlap))
        again = on_map and self._options.time_scale is None and self._probe(stops, high, lost, here_m)
        at_edge = np.mean(judged.code == Code.EDGE) > 0.25
        if lost and not again and not self._lattice.wide and (at_edge or self._overdue(here_m)):
            self._widen(True)
            self._tried_m = here_m
            return True
        if self._lattice.wide and not found and not again:
            self._widen(False)
        if found and not again and self._may_hold and not self._contested(stops, high, astray, 0.25 * CHUNK_M):
            self._hold(self._place.error_m)
        return again

    @property
    def _may_hold(self) -> bool:
        """Whether to start tracking a place: none is tracked yet, or it has left the centre of its lattice."""
        # User thresholds were calibrated on the whole region and require a margin over all of it.
        by_region = self._lattice.wide or self.plan.history == 0 or self._options.own_thresholds is not None
        if self._place.error_m is None or by_region:
            return False
        held = self._lattice.place_m
        return held is None or bool(np.max(np.abs(self._place.error_m - held)) > _ASIDE_M)

    def _hold(self, place_m: Float[np.ndarray, "2"] | None) -> None:
        """Search around this place alone, or in the whole region again."""
        self._lattice.place_m, self._surfaces = place_m, None

    def _last_metres(self, stops: Stops, high: int) -> int:
        """First stop of the last metres of one leg."""
        leg = int(np.searchsorted(stops.leg, stops.leg[high - 1]))
        return max(leg, int(np.searchsorted(stops.path_m, stops.path_m[high - 1] - CHUNK_M)))

    def _contested(self, stops: Stops, high: int, astray: Float[np.ndarray, "stop 2"], every_m: float) -> bool:
        """Whether the region around the prior holds another place about as good as the accepted one, or nothing
        conclusive; checked only after some travel.
        """
        here_m = float(stops.path_m[high - 1])
        if here_m - self._checked_m < every_m - self.plan.spacing_m:
            return self._lattice.place_m is None
        self._checked_m = here_m
        at = _some(self._last_metres(stops, high), high)
        compared = self._compared(stops, at, astray[high - 1])
        if compared is None:
            return True
        self._windows.elsewhere = compared[1]
        return self._windows.contested(*compared)

    def _compared(
        self, stops: Stops, at: Int[np.ndarray, " stop"], prior_m: Float[np.ndarray, "2"]
    ) -> tuple[float, float] | None:
        """z of the accepted place, and of the best other one in the whole region; None where nothing is conclusive."""
        assert self._place.error_m is not None
        whole_points = self.plan.points(self._lattice.half_m + SLACK_M)
        near = self._one_window(stops, at, stops.coefficients[at], self._place.error_m, HELD_M)
        whole = self._one_window(stops, at, stops.coefficients[at], prior_m, self._lattice.half_m + SLACK_M)
        if whole.floor == 0.0:
            return None
        there_m = self._lattice.error_of(np.asarray(whole.point), prior_m, whole_points)
        here_at_m = self._lattice.error_of(np.asarray(near.point), self._place.error_m, self.plan.points(HELD_M))
        apart = self._windows.apart(there_m, here_at_m)
        return float(near.score / whole.floor), float((whole.score if apart else whole.rival) / whole.floor)

    def _one_window(
        self,
        stops: Stops,
        at: Int[np.ndarray, " stop"],
        coefficients: Float[np.ndarray, "stop channel coefficient"],
        middle_m: Float[np.ndarray, "2"],
        half_m: float,
        heights_m: Float[np.ndarray, " height"] | None = None,
    ) -> Peaks:
        """Peaks of one window of some stops over another lattice, and of other heights where these are given."""
        points = self.plan.points(half_m)
        surfaces = self._lattice.surfaces_of(stops, at, coefficients, middle_m, points, heights_m)
        whole = Surfaces(*(field.sum(axis=0, dtype=np.float64).astype(np.float32)[None, None] for field in surfaces))
        window = WindowBatch(
            *whole,
            np.full((1, 1), len(at), np.int32),
            np.asarray([points], np.float32) // 2,
            np.full(1, half_m, np.float32),
            np.zeros((1, 2), np.float32),
            np.zeros(1, np.float32),
        )
        peaks, _ = self._peaks_of(window, 1, near=(1, 1))
        return Peaks(*(field[0, 0] for field in peaks))

    def _overdue(self, here_m: float) -> bool:
        """Whether to try a wider region: no place for a while, and not tried just now."""
        return here_m - self._place.seen_m > LOST_M and here_m - self._tried_m > 1.9 * CHUNK_M

    def _probe(self, stops: Stops, high: int, lost: bool, here_m: float) -> bool:
        """Try other time scales on the last metres: a few around the present one, or all if no place is known.

        Returns:
            Whether the stops must be judged again.
        """
        scale = self._scale
        if here_m - scale.probed_m < (CHUNK_M / 2 if lost else CHUNK_M) - self.plan.spacing_m:
            return False
        first = self._last_metres(stops, high)
        if here_m - stops.path_m[first] < 0.4 * CHUNK_M:
            return False
        scale.probed_m = here_m
        known_m = None if lost else self._place.error_m
        near, middle = known_m is not None, self._lattice.origin_m if known_m is None else known_m
        half_m = HELD_M if near else self._lattice.half_m + SLACK_M
        at = _some(first, high)
        # A wrong height delays the wave as a scale does: without a match both are tried together.
        # User thresholds were calibrated without.
        far = not near and self._attitude.may_be_far and self._options.own_thresholds is None
        heights_m = self._lattice.wide_heights_m if far else self._lattice.heights_m

        def look(tried: Stops, each: float, heights_m: Float[np.ndarray, " height"]) -> Look:
            own = self._chain.coefficients(tried.filtered[at], tried.valid[at], each)
            peaks = self._one_window(tried, at, own, middle, half_m, heights_m)
            floor = float(peaks.floor) or float(peaks.region_floor) or 0.5
            there_m = self._lattice.error_of(np.asarray(peaks.point), middle, self.plan.points(half_m))
            return Look(float(peaks.score), floor, float(heights_m[int(peaks.height)]), there_m)

        looks = [look(stops, float(each), heights_m) for each in scale.scales(near=near)]
        score, floor = np.array([[each.score, each.floor] for each in looks]).T
        if min(score) <= OFF_MAP_SCORE:
            return False
        changed = scale.take(score, floor, near=near)
        self._attitude.unknown = self._unknown_attitude()
        if far:
            changed |= self._suppose(stops, high, look)
        if not changed:
            return False
        stops.coefficients[:high] = self._chain.coefficients(stops.filtered[:high], stops.valid[:high], scale.value)
        self._surfaces = None
        return True

    def _suppose(
        self, stops: Stops, high: int, look: Callable[[Stops, float, Float[np.ndarray, " height"]], Look]
    ) -> bool:
        """Try heights and headings far from the prior's on the last metres; True if one was taken.

        None is taken if another one about as good leads to another place.
        """
        scale, lattice, applied = self._scale.value, self._lattice, self._attitude.applied
        present = look(stops, scale, lattice.heights_m)
        looks, offsets = [present], [applied]
        far = self._attitude.headings
        for heading in np.unique([applied[1], *([0.0] if len(far) else []), *far]):
            more = np.array([0.0, heading - applied[1], 0.0])
            looks.append(look(turned(stops, more, high - 1), scale, lattice.wide_heights_m))
            offsets.append(applied + more + np.array([looks[-1].height_m, 0.0, 0.0]))
        best = better_attitude(looks, APART * self._wavelength_m)
        if best is None:
            return False
        self._attitude.suppose(offsets[best])
        self._scale.tried = max(self._scale.tried, FAR_TRIED)
        self._correct(stops, high - 1)
        return True

    def _make_ready(self, stops: Stops, high: int) -> None:
        """Coefficients of the stops up to ``high`` at the present time scale; missing ones are computed."""
        if high > self._ready:
            bare = np.arange(max(self._ready, 0), high)
            stops.coefficients[bare] = self._chain.coefficients(
                stops.filtered[bare], stops.valid[bare], self._scale.value
            )
            self._ready = high

    def _extend(self, stops: Stops, high: int) -> RunningSums:
        """Sums of the surfaces of the stops up to ``high``, of no more than windows that end in one batch need. Missing
        ones are computed.
        """
        begin = max(0, high - self.plan.history - self._ends)
        if self._surfaces is None:
            self._surfaces = RunningSums(self._lattice.blank(0), begin, self.plan.history + self._ends)
        if high > self._surfaces.end:
            at = np.arange(self._surfaces.end, high)
            self._make_ready(stops, high)
            self._surfaces.append(self._lattice.surfaces_of(stops, at, stops.coefficients[at]))
        return self._surfaces

    def _judge(self, stops: Stops, low: int, high: int, astray: Float[np.ndarray, "stop 2"]) -> ChosenWindows:
        whole, near, first, centre = self._peaks(stops, low, high, astray)
        at = np.arange(low, high)
        if self._lattice.place_m is not None:
            return self._windows.decide_held(stops, whole, first, at, self._scale.tried)
        return self._windows.decide(stops, whole, near, first, at, centre, self._scale.tried)

    def _peaks(
        self, stops: Stops, low: int, high: int, astray: Float[np.ndarray, "stop 2"]
    ) -> tuple[Peaks, Peaks, Int[np.ndarray, "end window"], Float[np.ndarray, "end 2"]]:
        """Peaks of all windows that end at some stops, in the whole region and near the last place; first stops of the
        windows, and lattice points of the priors."""
        plan, lattice = self.plan, self._lattice
        sums = self._extend(stops, high)
        at = np.arange(low, high)
        first = self._windows.first_of(stops, at)
        fill = self._ends - len(at)
        ends = np.concatenate([at, np.full(fill, at[-1])])
        starts = np.concatenate([first, np.tile(first[-1:], (fill, 1))])
        centre = lattice.point_of(astray[ends])
        carried_m = CARRIED_M + DRIFT * np.abs(stops.path_m[ends] - self._place.seen_m)
        carried = np.broadcast_to(
            centre[0] if self._place.error_m is None else lattice.point_of(self._place.error_m), (len(ends), 2)
        )
        alone = lattice.place_m is not None
        whole, near = self._peaks_of(
            WindowBatch(
                *sums.over(starts, ends),
                np.where(starts >= 0, ends[:, None] + 1 - starts, 0).astype(np.int32),
                (carried if alone else centre).astype(np.float32),
                (carried_m if alone else np.full(len(ends), lattice.region_m)).astype(np.float32),
                carried.astype(np.float32),
                carried_m.astype(np.float32),
            ),
            len(at),
            near=(1, 1) if alone else plan.points(CARRIED_M + DRIFT * LOST_M),
        )
        whole, near = (jax.tree.map(lambda field: field[: len(at)], peaks) for peaks in (whole, near))
        whole, near = self._windows.settled(stops, at, first, whole, near)
        return whole, near, first, centre[: len(at)]

    def _peaks_of(self, windows: WindowBatch, count: int, *, near: tuple[int, int]) -> tuple[Peaks, Peaks]:
        """Peaks of the first ``count`` ends, on the host."""
        both: tuple[Peaks, Peaks] = jax.device_get(
            window_peaks(
                windows,
                self.plan.lattice_m.astype(np.float32),
                np.float32(APART * self._wavelength_m),
                np.float32(self.plan.min_overlap),
                near=near,
                count=np.int32(count),
            )
        )
        return both


def _some(first: int, stop: int) -> Int[np.ndarray, " stop"]:
    """A subset of the stops, evenly spaced."""
    return np.unique(np.linspace(first, stop - 1, _COMPARED).round().astype(int))
