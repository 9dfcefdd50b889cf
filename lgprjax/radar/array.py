"""Where the antennas of an array are, and when within a scan each of them is switched on."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class ArrayGeometry(NamedTuple):
    """Antenna positions in the body frame (x forward, y left, origin at the rear axle). Channel 0 is leftmost.

    Attributes:
        x_m: forward position of each channel's phase centre, metres.
        y_m: leftward position of each channel's phase centre, metres; falling with the channel number.
        time_offset_s: delay of each channel after the scan's own time, seconds (the switch matrix steps
            through the channels within one scan).
        height_m: nominal height of the array above the ground, metres.
    """

    x_m: Float[np.ndarray, " channel"]
    y_m: Float[np.ndarray, " channel"]
    time_offset_s: Float[np.ndarray, " channel"]
    height_m: float


def centre_of(array: ArrayGeometry) -> tuple[float, float]:
    """Centre (x_m, y_m) of the array in the body frame: the point a fix's position refers to."""
    return float(np.mean(array.x_m)), float(np.mean(array.y_m))


def uniform_array(
    channels: int, pitch_m: float, *, x_m: float = 0.0, height_m: float = 0.0, scan_period_s: float = 0.0
) -> ArrayGeometry:
    """Evenly spaced array centred on the body's x axis, its channels switched evenly over ``scan_period_s``."""
    index = np.arange(channels, dtype=np.float64)
    return ArrayGeometry(
        x_m=np.full(channels, x_m),
        y_m=((channels - 1) / 2 - index) * pitch_m,
        time_offset_s=index / channels * scan_period_s,
        height_m=height_m,
    )
