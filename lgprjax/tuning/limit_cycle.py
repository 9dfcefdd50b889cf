"""Whether a logged drive swings about its line for good: a limit cycle, its size and its period (MF section 4).

Noise and the damped swings that it feeds do not repeat: over half a period a limit cycle is its own mirror image, over
a whole one it is itself. Autocorrelation at both lags, over enough periods, tells the two apart; slow wandering and the
noise of single records are filtered out before.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.tuning.estimate import NotExcitedError

_PERIODS = 4.0
"""Fewer of them are no cycle yet."""
_REPEATS = 0.5
"""Least correlation of the offset with itself a period later, and least of its opposite half a period later."""
_LASTS = 0.5
"""Least share of the swing's size in the weaker half of the log over that in the stronger one."""
_ANSWER_S = 10.0
_STEP_S = 0.1
_SHORTEST_S, _LONGEST_S = 2.0, 120.0


class LimitCycle(NamedTuple):
    """What was found.

    Attributes:
        found: the vehicle swings for good.
        peak_to_peak_m: of the swing: median over its periods.
        period_s: of it.
        periods: how many the log holds.
        repeats: correlation with itself a period later; mirrored: with its opposite half a period later.
        lasts: size in the weaker half of the log over that in the stronger one.
    """

    found: bool
    peak_to_peak_m: float
    period_s: float
    periods: float
    repeats: float
    mirrored: float
    lasts: float


def find_limit_cycle(
    time_s: Float[np.ndarray, " record"],
    cross_m: Float[np.ndarray, " record"],
    *,
    bend_radpm: Float[np.ndarray, " record"] | None = None,
    least_m: float = 0.05,
) -> LimitCycle:
    """Look for a limit cycle in a drive along a line or a route.

    Args:
        time_s: increasing; records may be uneven.
        cross_m: from the line or route, to the left.
        bend_radpm: curvature of the route where the vehicle is: what follows it up to ten seconds later is no swing of
            the vehicle's own. None for a straight line.
        least_m: peak to peak that counts.

    Raises:
        NotExcitedError: a log of less than four times the shortest period that is looked for, or no numbers.
    """
    if len(time_s) < 2 or not (np.isfinite(time_s).all() and np.isfinite(cross_m).all()):
        raise NotExcitedError("limit cycle", "finite records", "others or none")
    span_s = float(time_s[-1] - time_s[0])
    if span_s < 2.0 * _PERIODS * _SHORTEST_S:
        raise NotExcitedError("limit cycle", f"a log of {2.0 * _PERIODS * _SHORTEST_S:.0f} s", f"{span_s:.1f} s")
    even_s = np.arange(time_s[0], time_s[-1], _STEP_S)
    offset = np.interp(even_s, time_s, cross_m)
    offset = _smooth(offset, 0.25 * _SHORTEST_S)
    bends = np.zeros(len(even_s)) if bend_radpm is None else np.interp(even_s, time_s, bend_radpm)
    offset = _unforced(offset, bends)
    longest = min(_LONGEST_S, span_s / _PERIODS)
    correlation = _autocorrelation(offset, int(longest / _STEP_S) + 1)
    lag = _first_peak(correlation)
    if lag is None:
        return LimitCycle(False, 0.0, float("nan"), 0.0, 0.0, 0.0, 0.0)
    period_s = lag * _STEP_S
    sizes = _peak_to_peak(offset, lag)
    halves = np.median(sizes[: (len(sizes) + 1) // 2]), np.median(sizes[len(sizes) // 2 :])
    size, lasts = float(np.median(sizes)), float(min(halves) / max(max(halves), 1e-12))
    repeats, mirrored = float(correlation[lag]), float(-correlation[lag // 2])
    found = size >= least_m and repeats >= _REPEATS and mirrored >= _REPEATS and lasts >= _LASTS
    return LimitCycle(bool(found), size, period_s, span_s / period_s, repeats, mirrored, lasts)


def _smooth(values: Float[np.ndarray, " time"], over_s: float) -> Float[np.ndarray, " time"]:
    """Running mean, the ends over what there is."""
    width = max(int(over_s / _STEP_S) // 2, 1)
    summed = np.concatenate([[0.0], np.cumsum(values)])
    low = np.maximum(np.arange(len(values)) - width, 0)
    high = np.minimum(np.arange(len(values)) + width + 1, len(values))
    return np.asarray((summed[high] - summed[low]) / (high - low))


def _unforced(offset: Float[np.ndarray, " time"], bends: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """The offset without its trend and without what answers to the route's bends."""
    even = np.linspace(-1.0, 1.0, len(offset))
    shifts = np.arange(0, int(_ANSWER_S / _STEP_S) + 1, int(1.0 / _STEP_S))
    answers = [np.concatenate([np.zeros(shift), bends[: len(bends) - shift]]) for shift in shifts]
    columns = np.stack([np.ones_like(even), even, *answers], axis=1)
    return np.asarray(offset - columns @ np.linalg.lstsq(columns, offset, rcond=None)[0])


def _autocorrelation(values: Float[np.ndarray, " time"], lags: int) -> Float[np.ndarray, " lag"]:
    """Correlation of the values with themselves by lag, each over what overlaps."""
    result = np.ones(lags)
    for lag in range(1, lags):
        ahead, behind = values[lag:], values[:-lag]
        result[lag] = np.sum(ahead * behind) / max(np.sqrt(np.sum(ahead**2) * np.sum(behind**2)), 1e-30)
    return result


def _first_peak(correlation: Float[np.ndarray, " lag"]) -> int | None:
    """Lag of the highest correlation after it was first negative, no shorter than the shortest period."""
    negative = np.flatnonzero(correlation < 0.0)
    if len(negative) == 0:
        return None
    start = max(int(negative[0]), int(_SHORTEST_S / _STEP_S))
    if start >= len(correlation) - 1:
        return None
    later = correlation[start:]
    # Multiples of the period are as high: the first that comes near the highest is the period.
    near = np.flatnonzero((later[1:-1] >= later[:-2]) & (later[1:-1] >= later[2:]) & (later[1:-1] >= 0.9 * later.max()))
    return None if len(near) == 0 else start + 1 + int(near[0])


def _peak_to_peak(values: Float[np.ndarray, " time"], period: int) -> Float[np.ndarray, " period"]:
    """Range within each whole period."""
    whole = values[: len(values) // period * period].reshape(-1, period)
    return np.asarray(np.ptp(whole, axis=1))
