"""Poses in the frame of a tile."""

import numpy as np
from jaxtyping import Float


def to_tile(pose: Float[np.ndarray, "batch 5"], frame: Float[np.ndarray, "3"]) -> Float[np.ndarray, "batch 5"]:
    """Poses of the map's frame in that of a tile."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    out = pose.copy()
    out[:, 0] = cos * (pose[:, 0] - east) + sin * (pose[:, 1] - north)
    out[:, 1] = cos * (pose[:, 1] - north) - sin * (pose[:, 0] - east)
    out[:, 3] = np.mod(pose[:, 3] - yaw + np.pi, 2 * np.pi) - np.pi
    return out
