"""The known place, and the choice of the window for a fix.

At every stop all windows of the ladder have their best place. This module pools the noise floor of each, weighs its
probability of being false, and chooses the shortest that meets the risk.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.registration.candidates import ChosenWindows
from lgprjax.registration.coarse import Peaks
from lgprjax.registration.estimates import NEAR_TRIED, AttitudeEstimate
from lgprjax.registration.fix import Code
from lgprjax.registration.judge import MIN_OVERLAP, PIECE_M, Chance, RegisterOptions, p_foreign, p_rival
from lgprjax.registration.lattice import ErrorLattice
from lgprjax.registration.queries import SearchSizes, Stops
from lgprjax.registration.score import OFF_MAP_SCORE

LOST_M = 8.0  # without a place after which a region of twice the side is tried
FLOOR_M = 6.0  # of travel over which the noise floor is estimated; in wavelengths where these are longer than a metre
_CONTESTED = 0.05  # probability that a place only resembles the true one, above which it is not carried on
_NARROW = 0.5  # of the wavelength: width of an array that may be off the map without being noticed
# An array narrower than a wavelength sees one stone or one dipping layer in all its channels alike, for metres: where a
# place is looked for anew, foreign ground was taken for the map's in 2 of 101 pieces, at a probability of 1e-4 by tails
# that the map's own pieces are too few to show.
_ALIKE = 100.0
_RIM_POWER = 1.5  # of the risk, within one piece, for a match at the map's edge
APART = 0.6  # of the wavelength: places closer than this are the same place
_AGREED = 0.3  # of the wavelength: within which windows of one stop must lead to one place
_UNCONFIRMED_RAD = np.radians(6.0)  # half width of the region of headings


class KnownPlace(NamedTuple):
    """The last accepted place of a drive.

    Attributes:
        error_m: east and north of it, less dead reckoning; None before there is one.
        seen_m: travel where it was accepted last; that of the first stop before there is one.
        found_m: travel at which it was found, -inf without a place.
        found_in: area in square metres, and time scales and attitudes, among which it was found.
    """

    error_m: Float[np.ndarray, "2"] | None = None
    seen_m: float = 0.0
    found_m: float = -np.inf
    found_in: tuple[float, float] = (0.0, 1.0)


class WindowJudge:
    """Judges the windows of one drive.

    Args:
        width_m: width of the array.
        wavelength_m: wavelength in the soil.
        plan, options: sizes and options of the search.
        chance: chance of a false match on the map.
        lattice: error lattice of the drive.
        attitude: estimate of the priors' attitude errors.

        Attributes:
        place: last accepted place.
        elsewhere: z of the best other place of the whole region, at its last search.
        trials: trials per search for a place; more than one for a narrow array.
        measures_edges: whether the array is wider than the ground's correlation length, so that it can measure how much
            of it is beyond the map's edge.
    """

    def __init__(
        self,
        width_m: float,
        wavelength_m: float,
        plan: SearchSizes,
        options: RegisterOptions,
        chance: Chance,
        lattice: ErrorLattice,
        attitude: AttitudeEstimate,
    ) -> None:
        self._plan, self._options, self._lattice, self._attitude = plan, options, lattice, attitude
        self._wavelength_m = wavelength_m
        self._chance = chance.for_windows(plan.windows_m, wavelength_m)
        self.trials = _ALIKE if width_m < wavelength_m else 1.0
        self.measures_edges = width_m > _NARROW * wavelength_m
        self.place, self.elsewhere = KnownPlace(), 0.0
        self._floor = np.zeros((4, 0, len(plan.windows_m)))

    def make_room(self, stops: int) -> None:
        """Extend the state by the next stops."""
        self._floor = np.concatenate([self._floor, np.zeros((4, stops, len(self._plan.windows_m)))], axis=1)

    def drop(self, stops: int) -> None:
        """Forget the first stops."""
        self._floor = self._floor[:, stops:]

    def take(self, here_m: float, error_m: Float[np.ndarray, "2"], points: float, tried: float) -> None:
        """Take a place; a new one was found among the given numbers of lattice points and trials."""
        found_m, found_in, known = self.place.found_m, self.place.found_in, self.place.error_m
        if known is None or here_m - self.place.seen_m > LOST_M:
            found_m = here_m
            found_in = (points * float(np.prod(self._plan.lattice_m)), self.trials * tried)
        elif self.apart(error_m, known):
            # Found about a known place, it is no surer than that one was.
            found_m = max(here_m, found_m)
            area_m2 = points * float(np.prod(self._plan.lattice_m))
            found_in = max(area_m2, found_in[0]), max(self.trials * tried, found_in[1])
        self.place = KnownPlace(error_m, here_m, found_m, found_in)

    def apart(self, one_m: Float[np.ndarray, "2"], other_m: Float[np.ndarray, "2"]) -> bool:
        """Whether two places are not the same one."""
        return float(np.linalg.norm(one_m - other_m)) > APART * self._wavelength_m

    def contested(self, here: float, there: float) -> bool:
        """Whether another place, with this z, is about as good as the accepted one."""
        return bool(p_rival(np.array([here]), np.array([there]))[0] > _CONTESTED)

    def first_of(self, stops: Stops, at: Int[np.ndarray, " end"]) -> Int[np.ndarray, "end window"]:
        """First stop of each window that ends at each stop; -1 if its leg is not long enough yet.

        A leg shorter than a window is matched whole with it, once it is longer than the next shorter window by a
        quarter, so that all ground counts after a drive's start or a gap in travel.
        """
        begin = np.searchsorted(stops.leg, stops.leg[at])
        # Stops before the history are dropped: the longest window reaches no farther.
        out = np.full((len(at), len(self._plan.windows_m)), -1)
        for number, length_m in enumerate(self._plan.windows_m):
            least_m = max(0.5 * length_m, 1.25 * self._plan.windows_m[number - 1]) if number else length_m
            long = stops.path_m[at] - stops.path_m[begin] >= least_m - 0.5 * self._plan.spacing_m - 1e-6
            inside = np.searchsorted(stops.path_m, stops.path_m[at] - length_m - 1e-6)
            inside = at if length_m <= 0.0 else np.maximum(inside, begin)
            out[:, number] = np.where(long, inside, -1)
        return out

    def settled_floor(
        self, stops: Stops, at: Int[np.ndarray, " end"], first: Int[np.ndarray, "end window"], peaks: Peaks
    ) -> Float[np.ndarray, "end window"]:
        """Noise floors pooled over the last metres: one place has few decoys, and each stop adds others.

        A window that its leg is too short for yet has none. One that holds less than its length takes those of windows
        that do so as well, which are higher by the root of what they lack. Where hardly any decoy was on the map, the
        floor is estimated from the region itself, far from its best place; where that is too little as well, the most
        cautious value is used.
        """
        members = at[:, None] + 1 - first
        leg_m = stops.path_m[at] - stops.path_m[np.searchsorted(stops.leg, stops.leg[at])]
        whole = leg_m[:, None] >= np.asarray(self._plan.windows_m) - 0.5 * self._plan.spacing_m - 1e-6
        both = np.where(first >= 0, [peaks.floor, peaks.region_floor] * np.sqrt(members), 0.0)
        # By decoys and by the region, of all windows; the same of those of full length.
        self._floor[:, at] = np.concatenate([both, np.where(whole, both, 0.0)])
        begin = np.searchsorted(stops.path_m, stops.path_m[at] - FLOOR_M * max(1.0, self._wavelength_m))
        conclusive = np.pad(np.cumsum(self._floor > 0.0, axis=1), [(0, 0), (1, 0), (0, 0)])
        total = np.pad(np.cumsum(self._floor**2, axis=1), [(0, 0), (1, 0), (0, 0)])
        count: Int[np.ndarray, "kind end window"] = conclusive[:, at + 1] - conclusive[:, begin]
        mean = np.sqrt((total[:, at + 1] - total[:, begin]) / np.maximum(count, 1) / members)
        count, mean = np.where(whole, count[2:], count[:2]), np.where(whole, mean[2:], mean[:2])
        return np.where(count[0] > 0, mean[0], np.where(count[1] > 0, mean[1], 0.5))

    def settled(
        self, stops: Stops, at: Int[np.ndarray, " end"], first: Int[np.ndarray, "end window"], whole: Peaks, near: Peaks
    ) -> tuple[Peaks, Peaks]:
        """Peaks in the whole region and near the last place with pooled noise floors, and with open sides only where
        the array cannot measure them.
        """
        floor = self.settled_floor(stops, at, first, whole)
        whole, near = whole._replace(floor=floor), near._replace(floor=floor)
        if self.measures_edges:
            nowhere = np.zeros_like(whole.open_sides)
            whole, near = whole._replace(open_sides=nowhere), near._replace(open_sides=nowhere)
        return whole, near

    def weigh(
        self,
        peaks: Peaks,
        first: Int[np.ndarray, "end window"],
        tried: float,
        chose: Bool[np.ndarray, "end window"] | None = None,
    ) -> tuple[Float[np.ndarray, "end window"], Float[np.ndarray, "end window"]]:
        """Probabilities that foreign ground, and that a rival, would have produced these peaks; 1 without a peak.

        Around a known place, windows that ``chose`` it count as searched as widely as it was, however small the region
        is now. ``tried`` is the number of time scales and attitudes tried. ``chose`` is ``None`` while no place is
        known.
        """
        known = (first >= 0) & (peaks.score > OFF_MAP_SCORE)
        z = np.where(known, peaks.score / peaks.floor, 0.0)
        rival = np.where(peaks.rival > OFF_MAP_SCORE, peaks.rival / peaks.floor, 0.0)
        area_m2 = peaks.area * np.prod(self._plan.lattice_m)
        trials = np.full(z.shape, tried if chose is not None else self.trials * tried)
        if chose is not None:
            area_m2 = np.where(chose, np.maximum(area_m2, self.place.found_in[0]), area_m2)
            trials = np.where(chose, np.maximum(trials, self.place.found_in[1]), trials)
        foreign = np.where(known, p_foreign(z, area_m2, self._chance, trials * len(self._plan.windows_m)), 1.0)
        rivals = np.where(known, p_rival(z, rival), 1.0)
        own, risk = self._options.own_thresholds, self._options.risk
        if own is not None:
            foreign = np.where(z >= own.strength_by_chance, np.minimum(foreign, risk), np.maximum(foreign, 2.0 * risk))
            rivals = np.where(z - rival >= own.margin_by_chance, 0.0, 1.0)
        return foreign, rivals

    def chose(self, stops: Stops, first: Int[np.ndarray, "end window"]) -> Bool[np.ndarray, "end window"]:
        """Windows with ground by which the present place was found, which confirm nothing."""
        return np.asarray(stops.path_m[np.maximum(first, 0)] <= self.place.found_m)

    def beyond(self, peaks: Peaks, foreign: Float[np.ndarray, "end window"]) -> Bool[np.ndarray, "end window"]:
        """Windows whose true place may be beyond the map's edge.

        Ground next to a map resembles its outermost line, less with distance, and a long enough window finds the
        resemblance significant. A place at the edge itself is evident within one piece.
        """
        piece_m = PIECE_M * max(1.0, self._wavelength_m)
        long = np.asarray(self._plan.windows_m) > piece_m
        one_side = (peaks.open_sides == 1) | (peaks.open_sides == 2)
        return np.asarray(one_side & (long | (foreign > self._options.risk**_RIM_POWER)))

    def decide_held(
        self,
        stops: Stops,
        peaks: Peaks,
        first: Int[np.ndarray, "end window"],
        at: Int[np.ndarray, " end"],
        tried: float,
    ) -> ChosenWindows:
        """Choose among windows searched around a known place alone; as ``decide``."""
        risk = self._options.risk
        foreign, rivals = self.weigh(peaks, first, min(tried, NEAR_TRIED), self.chose(stops, first))
        at_edge = np.asarray(peaks.at_rim) | self.beyond(peaks, foreign)
        good = (first >= 0) & (foreign <= risk) & (rivals <= risk) & ~at_edge
        # The reported runner-up is that of the whole region when it was last searched.
        peaks = peaks._replace(rival=np.maximum(peaks.rival, self.elsewhere * peaks.floor))
        return self.chosen(stops, at, first, peaks, foreign, rivals, at_edge, good)

    def decide(
        self,
        stops: Stops,
        whole: Peaks,
        near: Peaks,
        first: Int[np.ndarray, "end window"],
        at: Int[np.ndarray, " end"],
        centre: Float[np.ndarray, "end 2"],
        tried: float,
    ) -> ChosenWindows:
        """Choose among windows searched in the whole region, and near the last place.

        Args:
            stops: the scans.
            whole, near: peaks of both.
            first: stop of each window.
            at: stops that they end at.
            centre: lattice points of the priors.
            tried: time scales and attitudes.
        """
        since_m = stops.path_m[at] - self.place.seen_m
        foreign, rivals = self.weigh(whole, first, tried)
        off_m = np.max(np.abs(whole.point - centre[:, None]) * self._plan.lattice_m, axis=-1)
        at_edge = whole.at_rim | (off_m > self._lattice.region_m) | self.beyond(whole, foreign)
        risk = self._options.risk
        known = (first >= 0) & (whole.score > OFF_MAP_SCORE)
        if len(self._plan.windows_m) > 1 and self._options.own_thresholds is None:
            # One strong stone is one scan: a place is found by more.
            foreign = np.where(np.arange(foreign.shape[1]) == 0, 1.0, foreign)
        good = known & (foreign <= risk) & (rivals <= risk) & ~at_edge
        # Once there is a place, the next is searched for around it: few places that foreign ground could match. A place
        # about as good elsewhere contests it.
        held = (self.place.error_m is not None) & (since_m <= LOST_M)
        near_foreign, near_rivals = self.weigh(near, first, min(tried, NEAR_TRIED), self.chose(stops, first))
        astray = np.linalg.norm((whole.point - near.point) * self._plan.lattice_m, axis=-1)
        elsewhere = np.where(astray > APART * self._wavelength_m, whole.score, whole.rival)
        here, there = (np.asarray(score / near.floor, dtype=np.float64) for score in (near.score, elsewhere))
        against = p_rival(here, there) > _CONTESTED
        near_edge = near.at_rim | self.beyond(near, near_foreign)
        carried = known & held[:, None] & (near_foreign <= risk) & (near_rivals <= risk) & ~near_edge & ~against
        taken = carried & ~good
        pick = taken[..., None]
        whole = Peaks(*(np.where(pick if a.ndim == 3 else taken, b, a) for a, b in zip(whole, near, strict=True)))
        foreign, rivals = np.where(taken, near_foreign, foreign), np.where(taken, near_rivals, rivals)
        return self.chosen(stops, at, first, whole, foreign, rivals, at_edge & ~taken, good | taken)

    def chosen(
        self,
        stops: Stops,
        at: Int[np.ndarray, " end"],
        first: Int[np.ndarray, "end window"],
        peaks: Peaks,
        foreign: Float[np.ndarray, "end window"],
        rivals: Float[np.ndarray, "end window"],
        at_edge: Bool[np.ndarray, "end window"],
        good: Bool[np.ndarray, "end window"],
    ) -> ChosenWindows:
        """The shortest accepted window at each end, of more than a scan until the ground has confirmed the heading, or
        the best of the declined ones, with its code.
        """
        risk, known = self._options.risk, (first >= 0) & (peaks.score > OFF_MAP_SCORE)
        worst = np.where(known, np.maximum(foreign, rivals) + at_edge, 3.0)
        # A single scan hardly determines a heading that the ground has not confirmed yet; a longer window does.
        unsure = self._attitude.half_width(stops.sigma_yaw_rad[at])[:, 1] > _UNCONFIRMED_RAD
        if self._options.own_thresholds is None:
            good = good & self._agreed(peaks, good)
        several = good & ~(unsure[:, None] & (np.arange(good.shape[1]) == 0) & good[:, 1:].any(axis=1, keepdims=True))
        chosen = np.where(good.any(axis=1), np.argmax(several, axis=1), np.argmin(worst, axis=1))
        row = np.arange(len(at))
        peak: Peaks = jax.tree.map(lambda field: field[row, chosen], peaks)
        foreign, rivals, begin = foreign[row, chosen], rivals[row, chosen], first[row, chosen]
        finite = np.array([np.mean(stops.valid[max(b, 0) : e + 1]) for b, e in zip(begin, at, strict=True)])
        code = np.full(len(at), int(Code.OK))
        for applies, reason in (
            (rivals > risk, Code.AMBIGUOUS),
            (at_edge[row, chosen], Code.EDGE),
            (foreign > risk, Code.LOW_CORRELATION),
            (peak.overlap < self._plan.min_overlap, Code.LOW_OVERLAP),
            (peak.overlap <= 0.0, Code.OFF_MAP),
            (finite < MIN_OVERLAP, Code.NON_FINITE),
            (begin < 0, Code.NO_WINDOW),
        ):
            code = np.where(applies, int(reason), code)
        error_m = self._lattice.error_of(np.asarray(peak.point))
        offset = self._lattice.heights_m[peak.height][:, None] * np.eye(1, 5, 2)
        return ChosenWindows(
            window=chosen, peak=peak, p_false=foreign, code=code, first=begin, error_m=error_m, offset=offset
        )

    def _agreed(self, peaks: Peaks, good: Bool[np.ndarray, "end window"]) -> Bool[np.ndarray, "end window"]:
        """Accepted windows that lead to the place of the longest of them: a short one at a strong stone may not."""
        longest = good.shape[1] - 1 - np.argmax(good[:, ::-1], axis=1)
        place = np.asarray(peaks.point)[np.arange(len(good)), longest]
        off_m = np.linalg.norm((peaks.point - place[:, None]) * self._plan.lattice_m, axis=-1)
        return np.asarray(off_m <= _AGREED * self._wavelength_m)
