"""What no match sees: what the map's own positions are wrong by, and the odometer that lays out a window."""

import numpy as np
from jaxtyping import Float, Int

from lgprjax.radar import centre_of
from lgprjax.registration.fix import Fix
from lgprjax.registration.prepared import PreparedGround


def covariance_beside_match(
    prepared: PreparedGround, tiles: Int[np.ndarray, " end"], fix: Fix, odometer_sigma: float
) -> Float[np.ndarray, "end 2 2"]:
    """Part of the covariances of east and north that is not the match's; NaN where there is no fix.

    A window lies half its length behind the scan that its fix stands on; an odometer that counts too much by some share
    puts it off by that share of the way, along the heading.

    Args:
        prepared: the map and the array.
        tiles: that each fix was made on; -1 for none.
        fix: their poses in the map's frame.
        odometer_sigma: of the odometer's scale, as a share.
    """
    yaw, window_m = np.asarray(fix.pose)[:, 3], np.asarray(fix.window_m)
    heading = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    along_m2 = (0.5 * window_m * odometer_sigma) ** 2
    out = along_m2[:, None, None] * heading[:, :, None] * heading[:, None, :]
    for tile in np.unique(tiles[tiles >= 0]):
        rows = np.flatnonzero(tiles == tile)
        out[rows] += label_variance(prepared, int(tile), np.asarray(fix.pose)[rows])[:, None, None] * np.eye(2)
    return np.asarray(out)


def label_variance(prepared: PreparedGround, tile: int, pose: Float[np.ndarray, "end 5"]) -> Float[np.ndarray, " end"]:
    """Variance, square metres, of the map's positions under each fix, of east and of north alike.

    Where baselines overlap, the ground is their mean, and their errors, which are independent, average out: with w_d
    the share of the channels that hear baseline d, the variance is the sum of (w_d sigma_d)².

    Args:
        prepared: the map and the array.
        tile: of the fixes.
        pose: theirs, in the map's frame.
    """
    ground = prepared.ground
    lanes = ground.lanes(tile)
    if not len(lanes):
        return np.zeros(len(pose))
    east, north, yaw = ground.frame(tile)
    cross_m = (pose[:, 1] - north) * np.cos(yaw) - (pose[:, 0] - east) * np.sin(yaw)
    left_m = (prepared.array.y_m - centre_of(prepared.array)[1])[None] * np.cos(pose[:, 3] - yaw)[:, None]
    place = (cross_m[:, None] + left_m)[:, None]
    heard = (place >= lanes[None, :, :1]) & (place <= lanes[None, :, 1:])
    share = np.mean(heard / np.maximum(heard.sum(axis=1, keepdims=True), 1), axis=2)
    sigma_m = np.asarray(ground.description.label_sigma_m)
    # Channels off all lanes (a crossing road, a curve) hear some baseline: whichever, it is no better than the rest.
    missing = 1.0 - share.sum(axis=1)
    return np.asarray(np.sum((share * sigma_m) ** 2, axis=1) + missing**2 * np.max(sigma_m**2))
