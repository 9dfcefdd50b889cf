"""How well a course was driven: the anchor's true track against the baseline anchor's true track, interpolated.

Both tracks are the truth of the scene: what the map's labels or the fusion are wrong by is in the figure, as it is in
the vehicle's track. The distance is to the baseline's line, not to its nearest point, which would overstate it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

FOOT_M = 0.3048
_BACK, _ON = 60, 240
"""Points of the baseline searched behind and ahead of the last nearest one."""


class TrackingError(NamedTuple):
    """Figures of one drive.

    Attributes:
        rms_m: root mean square over the way driven.
        largest_m: anywhere.
        within_foot: share of the way with less than a foot.
        way_m: driven.
    """

    rms_m: float
    largest_m: float
    within_foot: float
    way_m: float


def cross_track_m(
    track_m: Float[np.ndarray, "tick 2"], baseline_m: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, " tick"]:
    """Distance of every place of a track from the line through a baseline, left positive; float64.

    The search goes on from the last nearest piece, so that a baseline that crosses itself is followed.

    Args:
        track_m: in driving order, beginning near the baseline's start.
        baseline_m: in driving order, at most a few decimetres apart.
    """
    pieces = np.diff(baseline_m, axis=0)
    square = np.maximum(np.sum(pieces**2, axis=1), 1e-12)
    out = np.empty(len(track_m))
    at = 0
    for number, place in enumerate(track_m):
        low, high = max(at - _BACK, 0), min(at + _ON, len(pieces))
        from_start = place - baseline_m[low:high]
        share = np.clip(np.sum(from_start * pieces[low:high], axis=1) / square[low:high], 0.0, 1.0)
        gap = from_start - share[:, None] * pieces[low:high]
        nearest = int(np.argmin(np.sum(gap**2, axis=1)))
        at = low + nearest
        side = pieces[at, 0] * gap[nearest, 1] - pieces[at, 1] * gap[nearest, 0]
        out[number] = np.copysign(np.hypot(*gap[nearest]), side)
    return out


def tracking_error(track_m: Float[np.ndarray, "tick 2"], baseline_m: Float[np.ndarray, "point 2"]) -> TrackingError:
    """Figures of a track against a baseline, each place weighed by the way to the next."""
    cross = cross_track_m(track_m, baseline_m)
    way = np.append(np.hypot(*np.diff(track_m, axis=0).T), 0.0)
    total = max(float(way.sum()), 1e-9)
    return TrackingError(
        float(np.sqrt(np.sum(cross**2 * way) / total)),
        float(np.abs(cross).max()),
        float(np.sum(way[np.abs(cross) < FOOT_M]) / total),
        total,
    )
