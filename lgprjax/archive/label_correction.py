"""Labels of one drive corrected by its fixes on a map that stays where it is.

GNSS and INS keep the shape of a short stretch and lose its place slowly: what a label is wrong by is a random walk
along the way, which the fixes observe, smoothed forward and back (Rauch, Tung and Striebel 1965). Where the labels step
aside and the wheels do not, the walk may step too. Wrong fixes lose their weight by the loss of Geman and McClure
(1985), told at first by the median of their surroundings: they must be the fewer within fifteen metres. Far from all
fixes the labels stay as given.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.frames import wrap_angle
from lgprjax.registration import Code, Fix, Track

_NODE_M = 1.0
_NODE_SCANS = 5  # a node is longer where scans stand far apart
_LEAST_FIXES = 3  # of a node: fewer are not heard
_LEAST_NODES = 3  # with fixes, of those about a node: fewer tell nothing of each other
_ABOUT_NODES = 15
_WALK_M = 0.03  # a root metre, of east and of north
_WALK_RAD = np.radians(0.03)
_LEAST_SIGMA_M = 0.02  # fixes of one metre of ground share most of their errors
_LEAST_SIGMA_RAD = np.radians(0.2)
_STEP = 0.1  # metres a metre by which labels may differ from wheels and heading: more is a step of the labels
_STEPPED_M = 0.1  # from node to node: labels that step so far are not corrected there
_WRONG_M = 0.15  # a fix this far from its neighbours keeps a quarter of its weight
_WRONG_RAD = np.radians(2.0)
_HEARD = 0.25  # of its weight that a node keeps to count as located
_ROUNDS = 6
_SURE_M, _LOST_M = 0.15, 0.26  # sigma up to which labels are corrected in full, and from which they stay as given


class LabelCorrection(NamedTuple):
    """What to add to a drive's labels, one row a scan.

    Attributes:
        offset: east_m, north_m, yaw_rad.
        sigma_m: of the corrected position against the map's ground, of east and of north alike; infinite where it is
            not corrected.
        corrected: by fixes, up to 25 m beyond the last of them and across gaps of 100 m: there sigma reaches 0.15 m.
        between: corrected, and with located places before and after: ground that does not match here has changed.
        located_m: metres of the way on which fixes agree with their neighbours.
    """

    offset: Float[np.ndarray, "scan 3"]
    sigma_m: Float[np.ndarray, " scan"]
    corrected: Bool[np.ndarray, " scan"]
    between: Bool[np.ndarray, " scan"]
    located_m: float

    def applied(self, track: Track) -> Track:
        """The track with corrected poses."""
        pose = track.pose.copy()
        pose[:, [0, 1, 3]] += self.offset
        return track._replace(pose=pose)


def correct_labels(
    track: Track, fix: Fix, beside: Float[np.ndarray, "scan 2 2"], lever_m: tuple[float, float]
) -> LabelCorrection:
    """Smooth corrections of a drive's labels from its fixes.

    Args:
        track: the labels.
        fix: of every scan; only those with code ok are heard.
        beside: part of the fixes' covariances that is not the match's (see ``DriveFixes``).
        lever_m: the array's centre, forward and left of the point that runs along its heading (the rear axle).
    """
    path_m = path_of(track)
    length_m = max(_NODE_M, _NODE_SCANS * float(path_m[-1]) / max(len(path_m) - 1, 1))
    node = (path_m / length_m).astype(np.int64)
    value, variance = _observed(track, fix, beside, node)
    walk = _walk(track, lever_m, path_m, length_m, len(value))
    off = _from_surroundings(value)
    value[~np.isfinite(off[:, 0])] = np.nan
    weight = _weights(off)
    smooth, spread = value, variance
    for _ in range(_ROUNDS):
        smooth, spread = _smoothed(value, variance / np.maximum(weight, 1e-9)[:, None], walk)
        weight = _weights(value - smooth)
    located = weight >= _HEARD
    sigma_m = np.sqrt(spread[:, 0]) if located.any() else np.full(len(value), np.inf)
    share = np.clip((_LOST_M - sigma_m) / (_LOST_M - _SURE_M), 0.0, 1.0)
    # Within a node that labels step in, nobody knows on which side of the step a scan stands.
    stepped = walk[:, 0] > _STEPPED_M**2
    corrected = (sigma_m <= _SURE_M) & ~stepped & ~np.append(stepped[1:], False)
    between = np.logical_or.accumulate(located) & np.logical_or.accumulate(located[::-1])[::-1] & corrected
    at_m = (np.arange(len(value)) + 0.5) * length_m
    return LabelCorrection(
        offset=np.stack([np.interp(path_m, at_m, share * column) for column in smooth.T], axis=1),
        sigma_m=np.where(corrected, sigma_m, np.inf)[node],
        corrected=corrected[node],
        between=between[node],
        located_m=float(located.sum()) * length_m,
    )


def path_of(track: Track) -> Float[np.ndarray, " scan"]:
    """Metres driven since the first scan; reverse counts as way too."""
    return np.asarray(np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0]))))


def _observed(
    track: Track, fix: Fix, beside: Float[np.ndarray, "scan 2 2"], node: Int[np.ndarray, " scan"]
) -> tuple[Float[np.ndarray, "node 3"], Float[np.ndarray, "node 3"]]:
    """Median of fix less label at each node, and its variance; NaN and infinite where there are too few fixes."""
    off = np.asarray(fix.pose, np.float64)[:, [0, 1, 3]] - track.pose[:, [0, 1, 3]]
    off[:, 2] = wrap_angle(off[:, 2])
    covariance = np.asarray(fix.covariance, np.float64)
    place = 0.5 * np.trace(covariance[:, :2, :2] - beside, axis1=1, axis2=2)
    ok = (np.asarray(fix.code) == Code.OK) & np.isfinite(off).all(axis=1) & np.isfinite(place)
    scans = np.flatnonzero(ok)
    count = int(node[-1]) + 1
    value, variance = np.full((count, 3), np.nan), np.full((count, 3), np.inf)
    heard, first, many = np.unique(node[scans], return_index=True, return_counts=True)
    for number, low, fixes in zip(heard, first, many, strict=True):
        if fixes >= _LEAST_FIXES:
            own = scans[low : low + fixes]
            value[number] = np.median(off[own], axis=0)
            variance[number, :2] = _LEAST_SIGMA_M**2 + np.median(place[own])
            variance[number, 2] = _LEAST_SIGMA_RAD**2 + np.median(covariance[own, 3, 3])
    return value, variance


def _walk(
    track: Track, lever_m: tuple[float, float], path_m: Float[np.ndarray, " scan"], length_m: float, count: int
) -> Float[np.ndarray, "node 3"]:
    """Variance that the correction may gain from the node before to each node."""
    scan = np.minimum(np.searchsorted(path_m, (np.arange(count) + 0.5) * length_m), len(path_m) - 1)
    yaw = track.pose[scan, 3]
    cos, sin = np.cos(yaw), np.sin(yaw)
    x_m, y_m = lever_m
    axle = track.pose[scan, :2] - np.stack([cos * x_m - sin * y_m, sin * x_m + cos * y_m], axis=1)
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    wheels = np.diff(track.travel_m[scan])[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    step_m = np.linalg.norm(np.diff(axle, axis=0) - wheels, axis=1)
    out = np.zeros((count, 3))
    out[1:, :2] = (_WALK_M**2 * length_m + np.maximum(step_m - _STEP * length_m, 0.0) ** 2)[:, None]
    out[1:, 2] = _WALK_RAD**2 * length_m
    return out


def _from_surroundings(value: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, "node 3"]:
    """Of each node from the median of those about it; NaN where nothing was observed, or by too few."""
    off = np.full_like(value, np.nan)
    for number in np.flatnonzero(np.isfinite(value[:, 0])):
        about = value[max(number - _ABOUT_NODES, 0) : number + _ABOUT_NODES + 1]
        about = about[np.isfinite(about[:, 0])]
        if len(about) >= _LEAST_NODES:
            off[number] = value[number] - np.median(about, axis=0)
    return off


def _weights(off: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, " node"]:
    """Geman and McClure's; 0 where nothing was observed."""
    squared = (off[:, 0] ** 2 + off[:, 1] ** 2) / _WRONG_M**2 + (off[:, 2] / _WRONG_RAD) ** 2
    return np.asarray(np.nan_to_num(1.0 / (1.0 + squared) ** 2))


def _smoothed(
    value: Float[np.ndarray, "node 3"], variance: Float[np.ndarray, "node 3"], walk: Float[np.ndarray, "node 3"]
) -> tuple[Float[np.ndarray, "node 3"], Float[np.ndarray, "node 3"]]:
    """Mean and variance of a random walk at every node from all observations."""
    count = len(value)
    mean, spread = np.zeros((count, 3)), np.zeros((count, 3))
    here, wide = np.zeros(3), np.full(3, 1e6)
    for number in range(count):
        wide = wide + walk[number]
        if np.isfinite(value[number, 0]):
            gain = wide / (wide + variance[number])
            here, wide = here + gain * (value[number] - here), wide * (1.0 - gain)
        mean[number], spread[number] = here, wide
    for number in range(count - 2, -1, -1):
        ahead = spread[number] + walk[number + 1]
        gain = spread[number] / ahead
        mean[number] += gain * (mean[number + 1] - mean[number])
        spread[number] += gain**2 * (spread[number + 1] - ahead)
    return mean, spread
