"""Poses in the frame of a tile, and back."""

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


def fixes_to_map(
    pose: Float[np.ndarray, "end 5"], covariance: Float[np.ndarray, "end 5 5"], frame: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "end 5"], Float[np.ndarray, "end 5 5"]]:
    """Poses of a tile's frame in that of the map."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.eye(5)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    moved = np.asarray(pose, dtype=np.float64) @ turn.T + np.array([east, north, 0.0, yaw, 0.0])
    return moved, turn @ np.asarray(covariance, dtype=np.float64) @ turn.T
