"""Stretches of constant steering in a drive: what a palm tree or a turning test is made of."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.vehicle.signals import DriveSignals

_AROUND_S = 0.25
"""Speed and change of steering are taken over twice this time."""
_STANDING_MPS = 0.1
_MEDIAN_RECORDS = 5
_STEADY_SHARE = 0.002
_SAME_SHARE = 0.01
"""Of the span of the steering signal: the change that is none, and how far values of one setting may lie apart."""


@dataclass(frozen=True)
class StretchRules:
    """What a stretch must have.

    Attributes:
        least_length_m: way of the rear axle.
        least_records: with a position.
        longest_gap_s: without a fix; a longer one ends a stretch.
    """

    least_length_m: float = 3.0
    least_records: int = 12
    longest_gap_s: float = 2.5


class Stretches(NamedTuple):
    """Stretches of a drive, in its order.

    Attributes:
        start, stop: first record of each, and the one after its last.
        sense: 1 forward, -1 in reverse.
        steering, sigma_steering: mean of the steering signal, in its unit, and the standard error of that.
        setting: number of the setting of the steering wheel; stretches that follow each other on one setting share it.
        dropped: how many were left out, by reason.
    """

    start: Int[np.ndarray, " stretch"]
    stop: Int[np.ndarray, " stretch"]
    sense: Float[np.ndarray, " stretch"]
    steering: Float[np.ndarray, " stretch"]
    sigma_steering: Float[np.ndarray, " stretch"]
    setting: Int[np.ndarray, " stretch"]
    dropped: dict[str, int]


def find_stretches(
    signals: DriveSignals, steering: Float[np.ndarray, " record"], rules: StretchRules | None = None
) -> Stretches:
    """Stretches in one driving direction at one setting of the steering.

    A record of the steering signal that is far off does not end a stretch, and neither does a short gap. A record
    without position or steering (NaN) is no record.

    Args:
        signals: of the drive.
        steering: any signal that follows the front wheels: volts, counts or radians.
        rules: what a stretch must have.

    Raises:
        NotExcitedError: there is no stretch at all.
    """
    rules = rules or StretchRules()
    known = np.flatnonzero(np.isfinite(signals.east_m + signals.north_m + signals.travel_m + steering))
    if len(known) < rules.least_records:
        raise NotExcitedError("drive", f"{rules.least_records} records with position and steering", f"{len(known)}")
    time_s, travel_m, value = signals.time_s[known], signals.travel_m[known], steering[known]
    level = _running_median(value)
    noise = 1.4826 * float(np.median(np.abs(np.diff(value, 2)))) / 6**0.5
    span = float(np.ptp(level))
    before, after = time_s - _AROUND_S, time_s + _AROUND_S
    elapsed = np.minimum(after, time_s[-1]) - np.maximum(before, time_s[0])
    speed = (np.interp(after, time_s, travel_m) - np.interp(before, time_s, travel_m)) / elapsed
    change = np.abs(np.interp(after, time_s, level) - np.interp(before, time_s, level))
    sense = np.where(np.abs(speed) > _STANDING_MPS, np.sign(speed), 0.0)
    still = change <= _STEADY_SHARE * span + 5.0 * noise
    label = np.where(still, sense, 0.0)
    ends = (label[1:] != label[:-1]) | (np.diff(time_s) > rules.longest_gap_s)
    edge = np.concatenate([[0], np.flatnonzero(ends) + 1, [len(known)]])
    dropped = {"short": 0, "steering not held": 0}
    kept: list[tuple[int, int, float, float, float]] = []
    for first, last in pairwise(edge):
        if label[first] == 0.0 or last - first < 3:
            continue
        held = level[first:last]
        if abs(travel_m[last - 1] - travel_m[first]) < rules.least_length_m or last - first < rules.least_records:
            dropped["short"] += 1
        elif np.ptp(held) > 2.0 * _SAME_SHARE * span + 8.0 * noise:
            dropped["steering not held"] += 1
        else:
            start, stop = int(known[first]), int(known[last - 1]) + 1
            kept.append((start, stop, float(label[first]), *_mean(steering[start:stop])))
    if not kept:
        found = ", ".join(f"{count} {reason}" for reason, count in dropped.items() if count) or "none"
        expected = f"stretches of {rules.least_length_m:g} m and {rules.least_records} records at one setting"
        raise NotExcitedError("steering", expected, found)
    starts, stops, senses, settings, sigmas = (np.asarray(column) for column in zip(*kept, strict=True))
    number = np.concatenate([[0], np.cumsum(np.abs(np.diff(settings)) > _SAME_SHARE * span + 3.0 * noise)])
    return Stretches(starts, stops, senses, settings, sigmas, number, {why: n for why, n in dropped.items() if n})


def choose_stretches(stretches: Stretches, keep: Bool[np.ndarray, " all"], reason: str) -> Stretches:
    """Those that are to be kept; the others are counted under a reason."""
    dropped = dict(stretches.dropped)
    if not keep.all():
        dropped[reason] = dropped.get(reason, 0) + int(np.sum(~keep))
    columns = {name: getattr(stretches, name)[keep] for name in Stretches._fields[:-1]}
    return stretches._replace(**columns, dropped=dropped)


def _mean(value: Float[np.ndarray, " record"]) -> tuple[float, float]:
    """Mean without spikes, and its standard error, of a signal that is held: every record counts, with a fix or not."""
    known = value[np.isfinite(value)]
    away = np.abs(known - np.median(known))
    held = known[away <= 4.0 * 1.4826 * np.median(away)]
    return float(np.mean(held)), float(np.std(held)) / len(held) ** 0.5


def _running_median(value: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    half = _MEDIAN_RECORDS // 2
    padded = np.concatenate([np.full(half, value[0]), value, np.full(half, value[-1])])
    median: Float[np.ndarray, " record"] = np.median(
        np.lib.stride_tricks.sliding_window_view(padded, _MEDIAN_RECORDS), axis=1
    )
    return median
