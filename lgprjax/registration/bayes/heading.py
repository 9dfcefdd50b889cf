"""The heading's own error: the turn that brings the path of dead reckoning onto the filter's places (host side).

With a heading 12° off and stated to 0.3°, the filter's places leave dead reckoning by 0.2 m aside a metre. Over eight
metres the turn is measured to some 0.9°: enough to tell such a log from one that states its error rightly.
"""

import numpy as np
from jaxtyping import Float

_WINDOW_M, _LEAST_M = 8.0, 1.5  # of travel
_SURE = 1e-2  # largest p_false of a place that is used
_PLACE_M = 0.03  # error of places, alike over the metres that the filter remembers
_WANDER_M = 0.02  # of dead reckoning, per root of a metre
_WRONG_RAD = np.radians(10.0)  # of a log whose heading is not as stated
_PRIOR = 1e-3  # probability of such a log


def turn_between(
    reckoned_m: Float[np.ndarray, "stop 2"], place_m: Float[np.ndarray, "stop 2"], sigma_yaw_rad: float
) -> tuple[float, float]:
    """The turn that brings a path onto places, if the log's heading is more probably wrong than as stated.

    Source: orthogonal Procrustes problem in the plane (Schönemann, 1966); a choice between two normal distributions.

    Args:
        reckoned_m, place_m: of the same stops, by odometry and heading, and by the filter.
        sigma_yaw_rad: standard deviation of heading, as stated.

    Returns:
        turn and its standard deviation, radians; zeros for a heading that is as stated, and for too short a path.
    """
    if not len(reckoned_m):
        return 0.0, 0.0
    path, place = reckoned_m - reckoned_m.mean(axis=0), place_m - place_m.mean(axis=0)
    # That of evenly spaced points of a line is its length over the root of 12.
    radius_m = float(np.sqrt(np.mean(np.sum(path**2, axis=1))))
    length_m = radius_m * np.sqrt(12.0)
    if length_m < _LEAST_M:
        return 0.0, 0.0
    aside = np.sum(path[:, 0] * place[:, 1] - path[:, 1] * place[:, 0])
    measured = float(np.arctan2(aside, np.sum(path * place)))
    noise2 = (_PLACE_M / radius_m) ** 2 + _WANDER_M**2 / length_m
    right2, wrong2 = noise2 + sigma_yaw_rad**2, noise2 + _WRONG_RAD**2
    odds = 0.5 * measured**2 * (1.0 / right2 - 1.0 / wrong2) + 0.5 * np.log(right2 / wrong2) + np.log(_PRIOR)
    if odds < 0.0:
        return 0.0, 0.0
    return measured * _WRONG_RAD**2 / wrong2, float(np.sqrt(noise2))


class HeadingError:
    """Correction of a drive's headings and dead reckoning, measured anew after every chunk of stops.

    Attributes:
        turn_rad, sigma_rad: in use, see ``turn_between``.
    """

    def __init__(self) -> None:
        self.turn_rad, self.sigma_rad = 0.0, 0.0
        self._path = np.zeros((0, 5))  # travel, dead reckoning and place of the last stops
        self._from_m, self._to_m = np.zeros(2), np.zeros(2)

    @property
    def used(self) -> bool:
        """A turn is in use, or has been."""
        return self.turn_rad != 0.0 or bool(np.any(self._from_m != self._to_m))

    def corrected_m(self, reckoned_m: Float[np.ndarray, "stop 2"]) -> Float[np.ndarray, "stop 2"]:
        """Dead reckoning turned about the stop from which on the turn is in use, which stays where it was."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        away = reckoned_m - self._from_m
        turned = np.stack([cos * away[:, 0] - sin * away[:, 1], sin * away[:, 0] + cos * away[:, 1]], axis=1)
        return np.asarray(self._to_m + turned)

    def hear(
        self,
        path_m: Float[np.ndarray, " stop"],
        reckoned_m: Float[np.ndarray, "stop 2"],
        place_m: Float[np.ndarray, "stop 2"],
        p_false: Float[np.ndarray, " stop"],
        sigma_yaw_rad: float,
    ) -> None:
        """Measure the turn from a chunk of stops and those before; it is in use from the last one on.

        Args:
            path_m: travel.
            reckoned_m, place_m, sigma_yaw_rad: see ``turn_between``; dead reckoning as recorded.
            p_false: of the places.
        """
        fresh = np.concatenate([path_m[:, None], reckoned_m, place_m], axis=1)[p_false < _SURE]
        path = np.concatenate([self._path, fresh])
        self._path = path[path[:, 0] >= path_m[-1] - _WINDOW_M]
        turn_rad, self.sigma_rad = turn_between(self._path[:, 1:3], self._path[:, 3:], sigma_yaw_rad)
        if turn_rad != self.turn_rad:
            self._to_m, self._from_m = self.corrected_m(reckoned_m[-1:])[0], reckoned_m[-1].copy()
            self.turn_rad = turn_rad
