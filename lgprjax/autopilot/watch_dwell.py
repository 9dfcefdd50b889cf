"""How long something has held: what turns readings of one tick into a finding, and keeps a finding from flickering."""

import math
from typing import NamedTuple

NOMINAL_STEP_S = 0.02
LONGEST_STEP_S = 0.04
"""What one tick counts for at most: one reading after a pause proves no more than any other."""


class Dwell(NamedTuple):
    """A finding in the making.

    Attributes:
        seconds: for so long its condition has held, or, once it is on, has not.
        on: it is found.
    """

    seconds: float = 0.0
    on: bool = False


def counted_step_s(step_s: float) -> float:
    """What a tick counts for: its length up to the longest; the nominal one where it is negative or no number."""
    return min(step_s, LONGEST_STEP_S) if step_s >= 0.0 else NOMINAL_STEP_S


def step_dwell(dwell: Dwell, holds: bool, step_s: float, *, on_s: float, off_s: float = 1.0) -> Dwell:
    """On after its condition held for ``on_s``, off after it has not for ``off_s``; a tick counts with ``step_s``."""
    if holds == dwell.on:
        return dwell if dwell.seconds == 0.0 else Dwell(0.0, dwell.on)
    seconds = dwell.seconds + step_s
    # Sums of steps fall short of their limit by rounding.
    if seconds >= (off_s if dwell.on else on_s) - 1e-9:
        return Dwell(0.0, holds)
    return Dwell(seconds, dwell.on)


def beyond(value: float, bound: float) -> bool:
    """Whether a magnitude exceeds its bound; no number does."""
    return not abs(value) <= bound


def wrap_rad(angle_rad: float) -> float:
    """An angle between −π and π; no number stays none."""
    return math.remainder(angle_rad, math.tau) if math.isfinite(angle_rad) else math.nan
