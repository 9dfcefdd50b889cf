"""The path of the rear axle that wheel angles make, and wheel angles from it.

The axle moves at the angle −atan(G tan ψ) to the body, G being the yaw gain of the speed, so that its path is less bent
than the turn is: by Gκ / √(1 + (G tan ψ)²). With G = 1 that is 1 / √(y_c² + x_c²) of the turn centre (x_c, y_c).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.vehicle.chassis import Chassis, ProportionalRear, turn_of, yaw_gain

_POINTS = 601
_BEYOND = 1.3
"""Of the largest angle, to either side: a curvature with noise has an angle too."""


class AxleTrack(NamedTuple):
    """Table over front angles.

    Attributes:
        front_rad: rising.
        curvature_radpm: of the rear axle's path.
        slip_rad: its direction less the body's.
    """

    front_rad: Float[np.ndarray, " angle"]
    curvature_radpm: Float[np.ndarray, "stretch angle"]
    slip_rad: Float[np.ndarray, "stretch angle"]


def axle_track(chassis: Chassis, speed_mps: Float[np.ndarray, " stretch"]) -> AxleTrack:
    """Path of the rear axle over front angles, at each speed of the axle along its path."""
    largest = _BEYOND * float(chassis.largest_angle_rad)
    front = jnp.linspace(-largest, largest, _POINTS)
    turn = turn_of(chassis, front)
    bend, tangent = (np.asarray(part, np.float64)[None] for part in turn)
    forward = np.broadcast_to(speed_mps[:, None], (len(speed_mps), _POINTS))
    for _ in range(2):
        gain = np.asarray(yaw_gain(chassis.characteristic_speed_mps, jnp.asarray(forward, jnp.float32)), np.float64)
        forward = speed_mps[:, None] / np.hypot(1.0, gain * tangent)
    return AxleTrack(
        np.asarray(front, np.float64), gain * bend / np.hypot(1.0, gain * tangent), -np.arctan(gain * tangent)
    )


def front_of_curvature(
    track: AxleTrack, curvature_radpm: Float[np.ndarray, " stretch"]
) -> tuple[Float[np.ndarray, " stretch"], Float[np.ndarray, " stretch"]]:
    """Front angle of each curvature, and dφ/dc; at the ends of the table beyond it."""
    rows, last = np.arange(len(curvature_radpm)), _POINTS - 1
    after = np.clip(np.sum(track.curvature_radpm < curvature_radpm[:, None], axis=1), 1, last)
    low, high = track.curvature_radpm[rows, after - 1], track.curvature_radpm[rows, after]
    slope = (track.front_rad[after] - track.front_rad[after - 1]) / (high - low)
    front = track.front_rad[after - 1] + slope * (
        np.clip(curvature_radpm, *track.curvature_radpm[:, [0, last]].T) - low
    )
    return front, slope


def rear_axle_slip(
    chassis: Chassis, ratio: float, speed_mps: float, curvature_radpm: Float[np.ndarray, " step"]
) -> Float[np.ndarray, " step"]:
    """Direction of the rear axle's path less the body's, at curvatures of that path, were k the ratio."""
    track = axle_track(chassis._replace(rear=ProportionalRear(jnp.float32(ratio))), np.array([speed_mps]))
    return np.asarray(np.interp(curvature_radpm, track.curvature_radpm[0], track.slip_rad[0]))
