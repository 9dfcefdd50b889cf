"""Pauses of a steering wheel turned at standstill: where it was held, and the side that it came from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.tuning.robust import clipped_mean
from lgprjax.tuning.straight import speed_mps
from lgprjax.vehicle.signals import DriveSignals

LEAST_PAUSE_S = 0.8
SETTLED_S = 0.2
JITTER_COUNTS = 2.0
LARGEST_SPEED_MPS = 0.1
LEAST_TURN = 0.01


class Pauses(NamedTuple):
    """Where the wheel was held.

    Attributes:
        time_s: middle of each pause.
        counts: encoder, mean.
        potentiometer_v: mean, spikes aside.
        direction: +1 where the counts rose before the pause, −1 where they fell.
    """

    time_s: Float[np.ndarray, " pause"]
    counts: Float[np.ndarray, " pause"]
    potentiometer_v: Float[np.ndarray, " pause"]
    direction: Float[np.ndarray, " pause"]


def find_pauses(signals: DriveSignals, what: str) -> Pauses:
    """Pauses at standstill, in order of time; the first, which came from an unknown side, is left out.

    Args:
        signals: of a log with encoder and potentiometer.
        what: is calibrated, for the error.

    Raises:
        NotExcitedError: encoder or potentiometer are missing, the vehicle did not stand, or the counts do not change.
    """
    if signals.encoder_counts is None or signals.potentiometer_v is None:
        missing = "encoder counts" if signals.encoder_counts is None else "potentiometer voltages"
        raise NotExcitedError(what, missing, "none in the log")
    counts, volts = signals.encoder_counts, signals.potentiometer_v
    usable = np.isfinite(counts) & np.isfinite(volts)
    standing = usable & (np.abs(speed_mps(signals)) < LARGEST_SPEED_MPS)
    if np.count_nonzero(standing) < 2:
        raise NotExcitedError(what, "a vehicle that stands", "one that moves in every record")
    turned = float(np.ptp(counts[standing]))
    if turned < JITTER_COUNTS / LEAST_TURN:
        raise NotExcitedError(what, "a wheel turned at standstill", f"{turned:.0f} counts of turning")
    moved = np.abs(np.diff(counts, prepend=np.nan)) > JITTER_COUNTS
    late = np.diff(signals.time_s, prepend=-np.inf) > LEAST_PAUSE_S
    run = np.cumsum(moved | late | ~standing | ~np.concatenate([[False], standing[:-1]]))
    used = np.flatnonzero(standing)
    starts = np.flatnonzero(np.diff(run[used], prepend=-1))
    stops = np.append(starts[1:], used.size)
    found = []
    for start, stop in zip(starts, stops, strict=True):
        inside = used[start:stop]
        time_s = signals.time_s[inside]
        if time_s[-1] - time_s[0] < LEAST_PAUSE_S:
            continue
        held = inside[time_s >= time_s[0] + SETTLED_S]
        if held.size >= 5:
            found.append((signals.time_s[held].mean(), counts[held].mean(), clipped_mean(volts[held])))
    times, places, means = np.array(found).reshape(-1, 3).T
    change = np.diff(places)
    # A pause that a jump of a few counts cuts in two is still one place: it came from where the first part came from.
    arrived = np.abs(change) > LEAST_TURN * turned
    return Pauses(times[1:][arrived], places[1:][arrived], means[1:][arrived], np.sign(change)[arrived])
