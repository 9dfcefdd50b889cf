"""The control threshold that a logged drive tells of: from the turns that were commanded and those that were made.

For every threshold the vehicle's yaw rate is that of the commands it would have obeyed, some time late and through a
lag, times a gain, plus a bias. The threshold, delay and lag that leave the least of the measured yaw rate unexplained
are the vehicle's; the interval holds every threshold that explains it nearly as well. Residuals of a log remember each
other, and so many of them count as one.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.tuning.arcs import serial_memory
from lgprjax.tuning.estimate import Estimate, NotExcitedError

_CANDIDATES = 80
_DELAYS_S = np.arange(0.0, 1.01, 0.1)
_LAGS_S = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8])
_LEAST_RECORDS = 200
_CHI_95 = 3.84
_FEW = 20
"""Independent records, fewer of which say nothing."""


class ThresholdFit(NamedTuple):
    """What was found.

    Attributes:
        found: the vehicle ignores small commands: no threshold explains the log clearly worse.
        threshold_mps: of the wheels' difference; the interval reaches over the commands that were not given.
        delay_s, lag_s: from a command to the turn.
        unexplained: share of the yaw rate's variance that is left; without: the same for no threshold.
    """

    found: bool
    threshold_mps: Estimate
    delay_s: float
    lag_s: float
    unexplained: float
    without: float


def fit_threshold(
    time_s: Float[np.ndarray, " record"],
    yaw_rad: Float[np.ndarray, " record"],
    turn_mps: Float[np.ndarray, " record"],
) -> ThresholdFit:
    """Fit the control threshold of a drive.

    Args:
        time_s: increasing, evenly but for a few records.
        yaw_rad: of the body; full turns are taken out.
        turn_mps: commanded difference of the wheels, right less left.

    Raises:
        NotExcitedError: fewer than 200 records, something that is no number, or commands that never change.
    """
    if len(time_s) < _LEAST_RECORDS:
        raise NotExcitedError("control threshold", f"{_LEAST_RECORDS} records or more", f"{len(time_s)}")
    if not all(np.isfinite(column).all() for column in (time_s, yaw_rad, turn_mps)):
        raise NotExcitedError("control threshold", "numbers", "others")
    sizes = np.unique(np.abs(turn_mps))
    if len(sizes) < _FEW:
        raise NotExcitedError("control threshold", "commands of many sizes", f"{len(sizes)}")
    step_s = float(np.median(np.diff(time_s)))
    rate = np.diff(np.unwrap(yaw_rad)) / np.diff(time_s)
    # Half-way between the commands that were given; more cannot be told apart.
    places = np.unique(np.linspace(0, len(sizes) - 1, _CANDIDATES).round().astype(int))
    candidates = np.append(0.0, 0.5 * (sizes[places][1:] + sizes[places][:-1]))
    # A delay and a lag may change places: the lag's recursion runs once for all delays.
    obeyed = [_obeyed(turn_mps[:-1], candidates, step_s, lag) for lag in _LAGS_S]
    late = [round(delay / step_s) for delay in _DELAYS_S]
    left = np.array([[_unexplained(rate, _later(way, shift)) for way in obeyed] for shift in late])
    delay, lag, best = np.unravel_index(np.argmin(left), left.shape)
    profile = left.min(axis=(0, 1))
    residual = _residual(rate, _later(obeyed[lag], late[delay])[:, best])
    memory = serial_memory(residual[None], np.ones((1, len(residual)), bool), 2)
    independent = len(rate) / memory
    near = profile <= profile[best] * (1.0 + _CHI_95 / max(independent, 1.0))
    # A threshold between two candidates is like the nearer one: the interval ends at their neighbours.
    first, last = np.flatnonzero(near)[[0, -1]]
    low, high = candidates[max(first - 1, 0)], candidates[min(last + 1, len(candidates) - 1)]
    value = float(candidates[best])
    found = bool(not near[0] and value > 0.0 and independent > _FEW)
    return ThresholdFit(
        found,
        Estimate(value, float(high - low) / 3.92, float(low), float(high)),
        float(_DELAYS_S[delay]),
        float(_LAGS_S[lag]),
        float(profile[best]),
        float(profile[0]),
    )


def _obeyed(
    turn_mps: Float[np.ndarray, " record"], threshold_mps: Float[np.ndarray, " candidate"], step_s: float, lag_s: float
) -> Float[np.ndarray, "record candidate"]:
    """The commands that each threshold lets through, through a lag."""
    through = np.where(np.abs(turn_mps)[:, None] >= threshold_mps, turn_mps[:, None], 0.0)
    if lag_s == 0.0:
        return through
    keep = float(np.exp(-step_s / lag_s))
    value = np.zeros(len(threshold_mps))
    lagged = np.empty_like(through)
    for number, now in enumerate(through):
        value = now + keep * (value - now)
        lagged[number] = value
    return lagged


def _later(obeyed: Float[np.ndarray, "record candidate"], records: int) -> Float[np.ndarray, "record candidate"]:
    """The same so many records later, from nothing."""
    return np.concatenate([np.zeros((records, obeyed.shape[1])), obeyed[: len(obeyed) - records]])


def _unexplained(
    rate: Float[np.ndarray, " record"], obeyed: Float[np.ndarray, "record candidate"]
) -> Float[np.ndarray, " candidate"]:
    """Share of the yaw rate's variance that no gain and bias explain."""
    x, y = obeyed - obeyed.mean(axis=0), rate - rate.mean()
    explained = (y @ x) ** 2 / np.maximum(np.sum(x * x, axis=0) * (y @ y), 1e-30)
    return np.asarray(1.0 - explained)


def _residual(rate: Float[np.ndarray, " record"], obeyed: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    x, y = obeyed - obeyed.mean(), rate - rate.mean()
    return np.asarray(y - (x @ y) / max(x @ x, 1e-30) * x)
