"""The records that pictures and tables are made from: plain NumPy, filled by whoever ran the registration."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped

from lgprjax.frames import along_cross

CODES = ("ok", "low_correlation", "ambiguous", "edge", "off_map", "low_overlap", "non_finite", "no_window")
"""Labels of ``registration.Code`` in its order; repeated here so that pictures need no accelerator library."""

LEAST_P = 1e-38
"""Smaller probabilities are drawn as this one."""


@dataclass(frozen=True, kw_only=True)
class DriveResult:
    """One drive registered against one map. Positions are local metres about ``origin``; NaN where there is none.

    Attributes:
        name, map_name: as they stand in titles.
        origin: latitude_deg, longitude_deg of the local frame's anchor.
        milliseconds_per_scan: wall time of the registration, divided by the scans.
        time_s, distance_m: since the drive's start; distance is travel, not a coordinate.
        east_m, north_m: of the fixes.
        prior_east_m, prior_north_m, heading_rad: where the search began; yaw counter-clockwise from east.
        sigma_along_m, sigma_cross_m: of the fixes, about the heading.
        correlation, margin: of the fixes, at whatever code; no margin where the region holds no runner-up.
        p_false: probability that ground which is not the map's would have passed the same search; 1 where nothing was
            found.
        code: labels out of ``CODES``.
        yaw_rad: of the fixes, if the picture is to show the heading error.
        sigma_yaw_rad: of the fixes, for the bands about it.
        gnss_gap: scans at which GNSS/INS was silent for a second, or its sigma three times its best.
        truth_east_m, truth_north_m, truth_yaw_rad: all three, or none.
        correlation_at_truth: what a perfect search would have found.
        baseline_tracks: east_m, north_m of each drive the map was built from.
        prior_sigma_m: standard deviation of the prior's position, per axis.
        remarks: what else a reader of the report must know, a line each.
        place_assumed: whether nobody said where on the earth the drive, or the map, lies.
        impostor: recorded over ground that is not the map's, so that every ``ok`` is wrong.
    """

    name: str
    map_name: str
    origin: tuple[float, float]
    milliseconds_per_scan: float
    time_s: Float[np.ndarray, " scan"]
    distance_m: Float[np.ndarray, " scan"]
    east_m: Float[np.ndarray, " scan"]
    north_m: Float[np.ndarray, " scan"]
    prior_east_m: Float[np.ndarray, " scan"]
    prior_north_m: Float[np.ndarray, " scan"]
    heading_rad: Float[np.ndarray, " scan"]
    sigma_along_m: Float[np.ndarray, " scan"]
    sigma_cross_m: Float[np.ndarray, " scan"]
    correlation: Float[np.ndarray, " scan"]
    margin: Float[np.ndarray, " scan"]
    p_false: Float[np.ndarray, " scan"]
    code: Shaped[np.ndarray, " scan"]
    yaw_rad: Float[np.ndarray, " scan"] | None = None
    sigma_yaw_rad: Float[np.ndarray, " scan"] | None = None
    gnss_gap: Bool[np.ndarray, " scan"] | None = None
    truth_east_m: Float[np.ndarray, " scan"] | None = None
    truth_north_m: Float[np.ndarray, " scan"] | None = None
    truth_yaw_rad: Float[np.ndarray, " scan"] | None = None
    correlation_at_truth: Float[np.ndarray, " scan"] | None = None
    baseline_tracks: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    prior_sigma_m: float | None = None
    remarks: tuple[str, ...] = ()
    place_assumed: bool = False
    impostor: bool = False

    def __post_init__(self) -> None:
        if unknown := set(np.unique(self.code)) - set(CODES):
            raise ValueError(f"codes that no fix has: {', '.join(sorted(map(str, unknown)))}")
        truth = (self.truth_east_m, self.truth_north_m, self.truth_yaw_rad)
        if any(part is None for part in truth) and any(part is not None for part in truth):
            raise ValueError("truth needs east, north and yaw together")

    @property
    def has_truth(self) -> bool:
        """Whether the true poses are known."""
        return self.truth_yaw_rad is not None

    @property
    def ok(self) -> Shaped[np.ndarray, " scan"]:
        """Scans whose fix is a position."""
        return np.asarray(self.code == "ok")

    @property
    def tried(self) -> Shaped[np.ndarray, " scan"]:
        """Scans that were registered: a window's fix stands on its last scan, the others were never asked."""
        return np.asarray(self.code != "no_window")


@dataclass(frozen=True, kw_only=True)
class MatchExample:
    """Strips of one channel: the live drive, the map where it was matched, and the map off that place.

    All three carry the same gain, so that they may be subtracted.

    Attributes:
        baseline, live, beside: amplitudes.
        beside_m: how far off the matched place ``beside`` was taken.
        distance_m: along the strip.
        time_ns: two-way travel time of the samples.
        channel: 0 is the leftmost.
        correlation, margin: of the fix.
        lag_m: along-track shift at which live and baseline agree best.
        gain: what was done to the amplitudes, for the caption.
        window_m: first and last distance of the scans that the fix was made from; boxed.
        wave_speed_m_per_ns: turns travel time into depth.
    """

    baseline: Float[np.ndarray, "trace sample"]
    live: Float[np.ndarray, "trace sample"]
    beside: Float[np.ndarray, "trace sample"]
    beside_m: float
    distance_m: Float[np.ndarray, " trace"]
    time_ns: Float[np.ndarray, " sample"]
    channel: int
    correlation: float
    margin: float
    lag_m: float
    gain: str
    window_m: tuple[float, float] | None = None
    wave_speed_m_per_ns: float = 0.1


@dataclass(frozen=True, kw_only=True)
class CorrelationSurface:
    """Correlation over a grid of positions, everything else of the pose held at its best.

    The box lies along the axes: a search region turned against north wants along and cross axes.

    Attributes:
        x_m, y_m: evenly spaced positions, relative to ``origin``.
        correlation: NaN off the map.
        half_width_m: of the search box about the prior, in x and y.
        prior, best, second, truth: positions; ``second`` is the runner-up.
        prior_sigma_m: along the axes of its ellipse; ``prior_tilt_rad`` is how far these are turned from x and y.
        origin: what the zero of the axes is.
        axes: names of x and y: east and north, or along and cross.
    """

    x_m: Float[np.ndarray, " i"]
    y_m: Float[np.ndarray, " j"]
    correlation: Float[np.ndarray, "i j"]
    half_width_m: tuple[float, float]
    prior: tuple[float, float]
    prior_sigma_m: tuple[float, float]
    best: tuple[float, float]
    origin: str
    second: tuple[float, float] | None = None
    truth: tuple[float, float] | None = None
    axes: tuple[str, str] = ("east", "north")
    prior_tilt_rad: float = 0.0


class TrackErrors(NamedTuple):
    """Fix minus reference of every scan, whatever its code: along is forward, cross is to the left.

    The reference is the truth and its heading where the truth is known, else the prior.
    """

    along_m: Float[np.ndarray, " scan"]
    cross_m: Float[np.ndarray, " scan"]


def track_errors(result: DriveResult) -> TrackErrors:
    """Split what the fixes lie off their reference into along-track and cross-track."""
    reference = (result.truth_east_m, result.truth_north_m, result.truth_yaw_rad)
    east, north, yaw = (
        prior if true is None else true
        for true, prior in zip(reference, (result.prior_east_m, result.prior_north_m, result.heading_rad), strict=True)
    )
    return TrackErrors(*along_cross(result.east_m - east, result.north_m - north, yaw))
