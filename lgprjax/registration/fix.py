"""The result of a registration: a fix with a code. A code is data; a bad scan raises nothing."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float, Int

WRONG_M = 0.3
"""An ok fix farther from the truth than this, in metres, is wrong: the nominal 1 ft of the Husky's requirements."""


class Code(IntEnum):
    """Why a fix may or may not be used. Only ``OK`` is a position."""

    OK = 0
    LOW_CORRELATION = 1
    AMBIGUOUS = 2
    EDGE = 3
    OFF_MAP = 4
    LOW_OVERLAP = 5
    NON_FINITE = 6
    NO_WINDOW = 7

    @property
    def label(self) -> str:
        """The name in tables and files."""
        return self.name.lower()


class Fix(NamedTuple):
    """Pose of the array's centre in the map, with measures of its quality.

    In a batch every field has a leading axis. The pose is (east_m, north_m, height_m above ground, yaw_rad,
    roll_rad), the covariance in that order; inside jit along and cross of the tile replace east and north.

    Attributes:
        pose: best pose; NaN without one.
        covariance: covariance of the pose, from the curvature of the correlation at its peak.
        correlation: correlation at the best pose.
        runner_up: score (correlation times the root of the overlap) of the best rival: a separate peak, refined like
            the best.
        margin: the best pose's score minus the runner-up's.
        noise_floor: noise floor: standard deviation of the score over the rest of the region.
        overlap_channels: number of channels of the last scan on the map.
        overlap: share of all valid traces of the template on the map.
        code: ``Code`` of the fix.
        p_false: probability that foreign ground would have passed the whole search as well; 1 if nothing was tried,
            NaN for a single scan judged by thresholds alone.
        window_m: length of the matched window; 0 for the scan alone.
    """

    pose: Float[Array | np.ndarray, "*batch 5"]
    covariance: Float[Array | np.ndarray, "*batch 5 5"]
    correlation: Float[Array | np.ndarray, "*batch"]
    runner_up: Float[Array | np.ndarray, "*batch"]
    margin: Float[Array | np.ndarray, "*batch"]
    noise_floor: Float[Array | np.ndarray, "*batch"]
    overlap_channels: Int[Array | np.ndarray, "*batch"]
    overlap: Float[Array | np.ndarray, "*batch"]
    code: Int[Array | np.ndarray, "*batch"]
    p_false: Float[Array | np.ndarray, "*batch"]
    window_m: Float[Array | np.ndarray, "*batch"]


def sigmas_along_cross(
    covariance: Float[np.ndarray, "scan 5 5"], yaw_rad: Float[np.ndarray, " scan"]
) -> tuple[Float[np.ndarray, " scan"], Float[np.ndarray, " scan"]]:
    """Standard deviations along and across a heading, of covariances in east and north."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    east, north, both = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 0, 1]
    along = cos**2 * east + sin**2 * north + 2 * cos * sin * both
    cross = sin**2 * east + cos**2 * north - 2 * cos * sin * both
    return np.sqrt(along), np.sqrt(cross)


def blank_fixes(scans: int) -> Fix:
    """Fixes of scans that have none of their own."""

    def empty(*shape: int) -> Float[np.ndarray, "..."]:
        return np.full((scans, *shape), np.nan, np.float64)

    return Fix(
        pose=empty(5),
        covariance=empty(5, 5),
        correlation=empty(),
        runner_up=empty(),
        margin=empty(),
        noise_floor=empty(),
        overlap_channels=np.zeros(scans, np.int32),
        overlap=np.zeros(scans, np.float32),
        code=np.full(scans, Code.NO_WINDOW, np.int32),
        p_false=np.ones(scans),
        window_m=empty(),
    )
