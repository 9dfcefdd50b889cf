"""Estimates along a drive from its own matches: the time scale, and the errors of height, heading and roll.

Both are causal, and the same for a whole drive and on board.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.radar import LIGHT_SPEED_M_PER_NS, ArrayGeometry
from lgprjax.registration.judge import RegisterOptions
from lgprjax.registration.refine import FEW_CHANNELS, PRIOR

# The time scale of a drive relative to the map, estimated from its own matches.
#
# Causal, and the same for a whole drive and for a vehicle: every few metres the last metres are matched at other
# scales: a few around the present one where a place is known, all of them otherwise.

SCALES = np.arange(0.925, 1.1301, 0.015)
"""Time scales tried while no place is known."""
_NEAR = np.array([-0.02, 0.0, 0.02])
NEAR_TRIED, _ALL_TRIED = 2.0, 7.0  # independent ones of these scales, as neighbours score alike
_LEAST_GAIN = 0.5  # of the noise floor, averaged over the last probes
_STEP = 0.0025  # a fortieth of a wavelength at forty wavelengths' depth
_AGAIN = 0.01
_UNFOLLOWED, _FOLLOWED = 0.02, 0.005  # sigma of a scale, at first and once it has been followed along the drive
_FORGET = 0.75  # weight of earlier probes, from probe to probe


class TimeScaleEstimate:
    """The present time scale, and the results of the last probes.

    Attributes:
        value: present scale.
        tried, least_tried: number of independent scales from which the match was chosen, and its lower limit.
        sigma: standard deviation of the scale; it falls as the scale is tracked, because only depth separates height
            and scale.
        probed_m: travel at the last probe.
    """

    def __init__(self, value: float) -> None:
        self.value, self.tried, self.probed_m = value, 1.0, -np.inf
        self.least_tried = 1.0
        self.sigma = _UNFOLLOWED
        self._lately = np.zeros(len(SCALES))
        self._bend = np.zeros(2)

    def scales(self, *, near: bool) -> Float[np.ndarray, " scale"]:
        """Scales to try."""
        return self.value + _NEAR if near else SCALES

    def take(self, score: Float[np.ndarray, " scale"], floor: Float[np.ndarray, " scale"], *, near: bool) -> bool:
        """Update from the scores of a probe.

        Args:
            score: score of the best place at each of ``scales``.
            floor: noise floor at each of ``scales``.
            near: whether scales around the present one were tried.

        Returns:
            Whether the scale has changed so much that stops judged with it must be judged again.
        """
        before, noise, scales = self.value, float(np.median(floor)), self.scales(near=near)
        if near:
            # A parabola through the last probes together: scores of one alone scatter by more than they fall.
            self._bend = _FORGET * self._bend + np.polyfit(scales - 1.0, score, 2)[:2]
            peak = 1.0 - 0.5 * self._bend[1] / self._bend[0] if self._bend[0] < 0.0 else float(scales[np.argmax(score)])
            peak = float(np.clip(peak, scales[0], scales[-1]))
            # Not for a gain that noise alone would give.
            gain = np.polyval([*self._bend, 0.0], peak - 1.0) - np.polyval([*self._bend, 0.0], before - 1.0)
            step = peak - before if gain > _LEAST_GAIN * noise else 0.0
        else:
            self._lately = _FORGET * self._lately + score / noise
            best = int(np.argmax(self._lately))
            now = float(np.interp(before, SCALES, self._lately))
            # Noise alone prefers one scale or another by about a noise floor.
            step = float(SCALES[best]) - before if self._lately[best] > now + 1.0 else 0.0
        self.value = round((before + step) / _STEP) * _STEP
        self.sigma = max(_FORGET * self.sigma, _FOLLOWED) if near else _UNFOLLOWED
        if self.value != before:
            self.tried = max(self.least_tried, NEAR_TRIED if near else _ALL_TRIED)
        if abs(self.value - before) < _AGAIN:
            return False
        self._bend[:] = 0.0
        return True


# Height, heading and roll, held against what the log claims of them.
#
# A single scan of an array a metre wide observes heading to a degree or so, which is no check of an INS that claims
# 0.3. Scans of some metres together are one: a wrong heading turns them all alike. Each match therefore gives its
# information on height, heading and roll, the prior's taken off, and their sum over the last metres is what the ground
# says by itself. Until that is sharper than the claim, the claim is not relied on; where the two contradict each other,
# the ground holds.

WIDEST = np.array([0.25, np.radians(15.0), np.radians(6.0)])
"""Half widths in height, heading and roll about a prior that nothing is known of."""
_CONTRADICTED = 2.0  # standard deviations between ground and claim
_HELD = 1.0  # the same, below which a contradicted claim holds again
_UNCHECKED = 1.2  # standard deviations of the ground's own estimate that a claim may be wrong by
_MEMORY_M = 8.0  # of travel over which evidence fades: an INS drifts
_HEADINGS = np.radians([-12.0, -8.0, -4.0, 4.0, 8.0, 12.0])
_SUPPOSED = np.array([0.03, np.radians(3.0), np.radians(2.0)])  # sigmas of offsets found by trial
_MOVED = np.array([0.01, np.radians(0.4), np.radians(0.4)])  # below which a correction is not worth new surfaces
BOUNCE_M = 0.015
"""Standard deviation of the unmeasured height of the map's own antennas above the ground, m."""
_DEPTH = 1.0 / 3.0  # of a profile, at which its echoes are on the mean


def unknown_attitude(array: ArrayGeometry, profile_ns: float, scale_sigma: float) -> Float[np.ndarray, "3"]:
    """Least standard deviations of height, heading and roll for any log: matches measure them relative to a map whose
    baselines bounced independently, and an array may span two of them; and delays grow with the time scale as they do
    with the height.

    Args:
        array: array of the drive.
        profile_ns: length of the map's profiles.
        scale_sigma: standard deviation of the time scale; 0 if it is given.
    """
    late_ns = scale_sigma * _DEPTH * profile_ns
    height_m = np.hypot(BOUNCE_M, 0.5 * LIGHT_SPEED_M_PER_NS * late_ns)
    return np.array([height_m, 0.0, BOUNCE_M / max(float(np.ptp(array.y_m)), BOUNCE_M)])


class AttitudeEstimate:
    """Offsets of the true height, heading and roll from the log's, in that order.

    Arrays of few channels do not observe heading and roll; for them the log's values are used.

    Args:
        options: options with the assumed half widths of the log's errors.
        channels: number of channels of the array.
        wavelength_m: wavelength; matches within one wavelength share their errors.
        sigma_scale: factor on the sigmas of matches.
        unknown: see ``unknown_attitude``; for a time scale that has not been tracked yet.
        fed_back: whether the prior's heading comes from a filter that uses these fixes. It is not corrected here as
            well, because two corrections, one delayed, would oscillate.

    Attributes:
        applied: corrections applied to the priors.
        unknown: see ``unknown_attitude``; it changes with the knowledge of the time scale.
    """

    def __init__(
        self,
        options: RegisterOptions,
        channels: int,
        wavelength_m: float,
        sigma_scale: float,
        unknown: Float[np.ndarray, "3"],
        *,
        fed_back: bool = False,
    ) -> None:
        self._fed_back = np.array([False, fed_back, False])
        self._options, self._wavelength_m, self._sigma_scale = options, wavelength_m, sigma_scale
        self.unknown = self._unfollowed = unknown
        self._few = channels <= FEW_CHANNELS
        self._information = np.zeros((3, 3))
        self._towards = np.zeros(3)
        self._travelled_m: float | None = None
        self._contradicted: Bool[np.ndarray, 3] = np.zeros(3, bool)
        self.applied: Float[np.ndarray, 3] = np.zeros(3)

    @property
    def unobserved(self) -> Float[np.ndarray, "3"]:
        """``unknown`` as stated by a fix.

        If the log's height was wrong, height and time scale were found together and may be confused with each other.
        """
        return np.where([self.applied[0] != 0.0, False, False], self._unfollowed, self.unknown)

    def half_width(self, sigma_yaw_rad: Float[np.ndarray, " scan"]) -> Float[np.ndarray, "scan 3"]:
        """Half widths of the search in height, heading and roll about the corrected priors."""
        claimed = self.claimed(sigma_yaw_rad)
        if self._few:
            return claimed
        mean, sigma = self._ground()
        wanted = np.hypot(claimed, 3.0 * _UNCHECKED * sigma) + np.where(self._fed_back, np.abs(mean), 0.0)
        return np.asarray(np.minimum(wanted, np.maximum(WIDEST, claimed)))

    def take(
        self,
        offset: Float[np.ndarray, "fix 3"],
        covariance: Float[np.ndarray, "fix 3 3"],
        half_width: Float[np.ndarray, "fix 3"],
        path_m: Float[np.ndarray, " fix"],
        window_m: Float[np.ndarray, " fix"],
        sigma_yaw_rad: Float[np.ndarray, " fix"],
    ) -> None:
        """Take accepted matches, in order.

        Args:
            offset: offset of each match from its corrected prior.
            covariance: covariance of the offset, prior included, not scaled.
            half_width: half widths of its search.
            path_m: travel at each match.
            window_m: length of the matched window.
            sigma_yaw_rad: stated standard deviation of the prior's heading.
        """
        if self._few or not len(offset):
            return
        for each in range(len(offset)):
            whole = np.linalg.inv(covariance[each])
            level, turn = np.linalg.eigh(whole - np.diag(np.asarray(PRIOR[2:5]) / half_width[each] ** 2))
            own = (turn * np.maximum(level, 0.0)) @ turn.T
            moved_m = 0.0 if self._travelled_m is None else max(path_m[each] - self._travelled_m, 0.0)
            # Matches of the same ground add no information.
            fresh = 1.0
            if self._travelled_m is not None:
                fresh = min(1.0, moved_m / max(float(window_m[each]), self._wavelength_m))
            fresh /= self._sigma_scale**2
            fade = np.exp(-moved_m / _MEMORY_M)
            self._travelled_m = float(path_m[each])
            self._information = fade * self._information + fresh * own
            self._towards = fade * self._towards + fresh * (whole @ offset[each] + own @ self.applied)
        mean, sigma = self._ground()
        claimed = self.claimed(sigma_yaw_rad[-1:])[0] / 3.0
        away = np.abs(mean) / np.hypot(sigma, claimed)
        self._contradicted = away > np.where(self._contradicted, _HELD, _CONTRADICTED)

    def correction(self) -> Float[np.ndarray, "3"] | None:
        """Offsets that priors should be corrected by from now on; None while the present ones will do."""
        mean, _ = self._ground()
        wanted = np.where(self._contradicted & ~self._fed_back, mean, 0.0)
        return wanted if np.any(np.abs(wanted - self.applied) > _MOVED) else None

    def suppose(self, offset: Float[np.ndarray, "3"]) -> None:
        """Take offsets that were found by trial, where nothing matched with the present ones, as far as they go."""
        self._information = np.diag(_SUPPOSED**-2.0)
        self._towards = (self._information + np.diag(np.asarray(PRIOR[2:5]) / WIDEST**2)) @ offset
        self._contradicted = np.abs(offset) > _MOVED

    @property
    def may_be_far(self) -> bool:
        """Whether the array can observe attitudes far from the prior's."""
        return not self._few

    @property
    def headings(self) -> Float[np.ndarray, " heading"]:
        """Offsets of heading to try where nothing matches."""
        return _HEADINGS[:0] if self._fed_back.any() else _HEADINGS

    def claimed(self, sigma_yaw_rad: Float[np.ndarray, " scan"]) -> Float[np.ndarray, "scan 3"]:
        """Half widths as the log has them, and what it cannot know."""
        return np.asarray(np.hypot(self._options.half_width(sigma_yaw_rad, 1.0)[:, 2:5], 3.0 * self.unknown))

    def _ground(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Offsets by the ground alone, and their standard deviations."""
        covariance = np.linalg.inv(self._information + np.diag(np.asarray(PRIOR[2:5]) / WIDEST**2))
        return covariance @ self._towards, np.sqrt(np.diag(covariance))


# Attitudes far from the prior's, tried without a match.

_FAR_GAIN = 1.5  # least improvement of the match by another attitude, noise floors
# Share of the best attitude's score from which an attitude with another place contests it. Attitudes are tried in
# steps; the true one may be between two of them, so that its place scores less than a wrong one.
_FAR_RIVAL = 0.75

FAR_TRIED = 15.0
"""Number of independent headings and heights among those tried."""


class Look(NamedTuple):
    """The highest score of a window over a region, its noise floor, height, and place as an error of the prior."""

    score: float
    floor: float
    height_m: float
    place_m: Float[np.ndarray, "2"]

    @property
    def z(self) -> float:
        """Score in noise floors."""
        return self.score / self.floor


def better_attitude(looks: Sequence[Look], apart_m: float) -> int | None:
    """Which of some attitudes to take instead of the present one; None for that.

    Args:
        looks: one for each attitude, the present one first.
        apart_m: places closer than this are the same place.
    """
    best = looks[int(np.argmax([look.z for look in looks]))]
    if best.z <= looks[0].z + _FAR_GAIN:
        return None
    others = [look.z for look in looks if np.linalg.norm(look.place_m - best.place_m) > apart_m]
    if others and max(others) > _FAR_RIVAL * best.z:
        return None
    return next(number for number, look in enumerate(looks) if look is best)
