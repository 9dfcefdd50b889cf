"""The time scale of a drive: how much longer the wave's way in the ground takes today, told from its own matches.

Causal, and the same for a whole drive and for a vehicle: every few metres the last ones are matched at other scales, at
a few about the present one where a place is known, at all where none is.
"""

import numpy as np
from jaxtyping import Float

SCALES = np.arange(0.925, 1.1301, 0.015)
"""Time scales that are tried where no place is known."""
_NEAR = np.array([-0.02, 0.0, 0.02])
_NEAR_TRIED, _ALL_TRIED = 2.0, 7.0  # independent ones of these scales, as neighbours score alike
_LEAST_GAIN = 0.5  # of the noise floor, over the last probes together
_STEP = 0.0025  # a fortieth of a wavelength at forty wavelengths' depth
_AGAIN = 0.01
_FORGET = 0.75  # of what the last probes said, from probe to probe


class TimeScale:
    """The time scale now, and what the last probes said of it.

    Attributes:
        value: the scale.
        tried: independent scales that a match of today was chosen from.
        probed_m: travel at the last probe.
    """

    def __init__(self, value: float) -> None:
        self.value, self.tried, self.probed_m = value, 1.0, -np.inf
        self._lately = np.zeros(len(SCALES))
        self._bend = np.zeros(2)

    def scales(self, *, near: bool) -> Float[np.ndarray, " scale"]:
        """Scales to try."""
        return self.value + _NEAR if near else SCALES

    def take(self, score: Float[np.ndarray, " scale"], floor: Float[np.ndarray, " scale"], *, near: bool) -> bool:
        """Follow the scores of a probe.

        Args:
            score: of the best place at each of ``scales``.
            floor: noise floor of each.
            near: scales about the present one were tried.

        Returns:
            whether the scale has changed so much that what was judged with it is to be judged again.
        """
        before, noise, scales = self.value, float(np.median(floor)), self.scales(near=near)
        if near:
            # A parabola through the last probes together: scores of one alone scatter by more than they fall.
            self._bend = _FORGET * self._bend + np.polyfit(scales - 1.0, score, 2)[:2]
            peak = 1.0 - 0.5 * self._bend[1] / self._bend[0] if self._bend[0] < 0.0 else float(scales[np.argmax(score)])
            peak = float(np.clip(peak, scales[0], scales[-1]))
            # Not for what scatter alone would promise.
            gain = np.polyval([*self._bend, 0.0], peak - 1.0) - np.polyval([*self._bend, 0.0], before - 1.0)
            step = peak - before if gain > _LEAST_GAIN * noise else 0.0
        else:
            self._lately = _FORGET * self._lately + score / noise
            best = int(np.argmax(self._lately))
            now = float(np.interp(before, SCALES, self._lately))
            # Scatter alone prefers one scale or another by about a noise floor.
            step = float(SCALES[best]) - before if self._lately[best] > now + 1.0 else 0.0
        self.value = round((before + step) / _STEP) * _STEP
        if self.value != before:
            self.tried = _NEAR_TRIED if near else _ALL_TRIED
        if abs(self.value - before) < _AGAIN:
            return False
        self._bend[:] = 0.0
        return True
