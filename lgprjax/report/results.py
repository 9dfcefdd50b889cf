"""The records for pictures and tables: plain NumPy, filled after a registration."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped
from matplotlib.axes import Axes

from lgprjax.frames import along_cross
from lgprjax.report.style import BLUE, INK, MUTED, VERMILLION, label_decades, picture, write_caption

CODES = ("ok", "low_correlation", "ambiguous", "edge", "off_map", "low_overlap", "non_finite", "no_window")
"""Labels of ``registration.Code`` in its order; repeated here so that pictures need no accelerator library."""

LEAST_P = 1e-38
"""Smaller probabilities are drawn as this one."""


@dataclass(frozen=True, kw_only=True)
class DriveResult:
    """One drive registered against one map. Positions are local metres around ``origin``; NaN if missing.

    Attributes:
        name, map_name: names of drive and map, for titles.
        origin: latitude_deg, longitude_deg of the local frame's anchor.
        milliseconds_per_scan: wall time of the registration, divided by the scans.
        time_s, distance_m: time and travel since the drive's start; reverse adds to the travel.
        east_m, north_m: position of the fixes.
        prior_east_m, prior_north_m, heading_rad: start of the search; yaw counter-clockwise from east.
        sigma_along_m, sigma_cross_m: standard deviations of the fixes along and across the heading.
        correlation, margin: correlation and margin of fixes of any code; no margin without a runner-up in the region.
        p_false: probability that foreign ground would have passed the same search; 1 if nothing was found.
        code: labels from ``CODES``.
        yaw_rad: yaw of the fixes, for a picture of the heading error.
        sigma_yaw_rad: standard deviation of the yaw, for the bands around it.
        gnss_gap: mask of scans at which GNSS/INS was silent for a second, or its sigma three times its best.
        truth_east_m, truth_north_m, truth_yaw_rad: true pose; all three, or none.
        correlation_at_truth: score of a perfect search.
        baseline_tracks: east_m, north_m of each drive the map was built from.
        remarks: further remarks for the report, one line each.
        place_assumed: whether the geographic position of the drive, or of the map, is assumed.
        impostor: whether it was recorded over foreign ground, so that every ``ok`` is wrong.
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
    remarks: tuple[str, ...] = ()
    place_assumed: bool = False
    impostor: bool = False

    def __post_init__(self) -> None:
        if unknown := set(np.unique(self.code)) - set(CODES):
            raise ValueError(f"unknown codes: {', '.join(sorted(map(str, unknown)))}")
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
        """Scans that were registered: a window's fix belongs to its last scan, the others have none."""
        return np.asarray(self.code != "no_window")


@dataclass(frozen=True, kw_only=True)
class MatchExample:
    """Strips of one channel: the live drive, the map where it was matched, and the map elsewhere.

    All three have the same gain, so that they can be subtracted.

    Attributes:
        baseline, live, beside: amplitudes of the map at the match, of the drive, and of the map elsewhere.
        beside_m: distance of ``beside`` from the matched place.
        distance_m: distance along the strip.
        time_ns: two-way travel time of the samples.
        channel: number of the channel; 0 is the leftmost.
        correlation, margin: correlation and margin of the fix.
        lag_m: along-track shift at which live and baseline agree best.
        gain: processing of the amplitudes, for the caption.
        window_m: first and last distance of the fix's scans, drawn as a box.
        wave_speed_m_per_ns: wave speed, which converts travel time to depth.
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
    """Correlation over a grid of positions, the rest of the pose fixed at its best.

    The box is aligned with the axes: a search region rotated from north needs along and cross axes.

    Attributes:
        x_m, y_m: evenly spaced positions, relative to ``origin``.
        correlation: correlation at each position; NaN off the map.
        half_width_m: half width of the search box around the prior, in x and y.
        prior, best, second, truth: positions; ``second`` is the runner-up.
        at_best: correlation of the fix, if known.
        prior_sigma_m, prior_tilt_rad: standard deviations along the axes of the prior's ellipse, and their rotation
            from x and y.
        origin: description of the zero of the axes.
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
    at_best: float | None = None
    second: tuple[float, float] | None = None
    truth: tuple[float, float] | None = None
    axes: tuple[str, str] = ("east", "north")
    prior_tilt_rad: float = 0.0


class TrackErrors(NamedTuple):
    """Fix minus reference of every scan, of any code: along is forward, cross is to the left.

    The reference is the truth and its heading if known, else the prior.
    """

    along_m: Float[np.ndarray, " scan"]
    cross_m: Float[np.ndarray, " scan"]


def track_errors(result: DriveResult) -> TrackErrors:
    """Split the fixes' deviation from their reference into along-track and cross-track."""
    reference = (result.truth_east_m, result.truth_north_m, result.truth_yaw_rad)
    east, north, yaw = (
        prior if true is None else true
        for true, prior in zip(reference, (result.prior_east_m, result.prior_north_m, result.heading_rad), strict=True)
    )
    return TrackErrors(*along_cross(result.east_m - east, result.north_m - north, yaw))


# Times of a running system's stages: a histogram for each stage, with its deadline.

_BINS = 120
_LEAST_MS = 1e-3
"""Lower limit, so that a stage below the clock's resolution has a place on a logarithmic axis."""


@dataclass(frozen=True)
class StageTimes:
    """Times of one stage.

    Attributes:
        name: name of the stage.
        milliseconds: duration of each event; non-finite values are left out.
        deadline_ms: deadline; ``None`` without one.
    """

    name: str
    milliseconds: Float[np.ndarray, " event"]
    deadline_ms: float | None = None


@dataclass(frozen=True, kw_only=True)
class TimingPicture:
    """Stages of one system.

    Attributes:
        title: title of the picture.
        stages: stages in the order of processing, at least one.
        note: measurement and machine, for the caption.
    """

    title: str
    stages: tuple[StageTimes, ...]
    note: str


def draw_timing(timing: TimingPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw a histogram a stage over one logarithmic axis, with median, 99th percentile, largest and deadline.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    times = [_measured(stage) for stage in timing.stages]
    everything = np.concatenate([*times, [stage.deadline_ms for stage in timing.stages if stage.deadline_ms]])
    low, high = (everything.min(), everything.max()) if everything.size else (1.0, 1.0)
    bins = np.geomspace(0.8 * low, 1.25 * high, _BINS + 1)
    with picture(path, 9.0, 2.0 + 1.35 * len(times), force) as figure:
        rows = figure.subplots(len(times), 1, sharex=True, squeeze=False)[:, 0]
        for axes, stage, values in zip(rows, timing.stages, times, strict=True):
            _draw_stage(axes, stage, values, bins)
        rows[-1].set_xscale("log")
        rows[-1].set_xlim(bins[0], bins[-1])
        label_decades(rows[-1].xaxis)
        rows[-1].set_xlabel("time (ms)")
        figure.supylabel("events (the highest of each row as high as the row)", fontsize=9.0)
        figure.suptitle(timing.title)
        write_caption(
            figure,
            f"{timing.note} Dotted: median and 99th percentile. Dashed: deadline; hatched beyond it.",
        )


def _draw_stage(axes: Axes, stage: StageTimes, values: Float[np.ndarray, " event"], bins: np.ndarray) -> None:
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_yticks([])
    deadline = stage.deadline_ms
    if deadline is not None:
        axes.axvline(deadline, color=INK, linewidth=1.4, linestyle=(0, (4, 2)))
    if not values.size:
        axes.set_title(f"{stage.name}: no event", fontweight="bold", fontsize=9.5)
        return
    late = values > (np.inf if deadline is None else deadline)
    # A bin cut by the deadline shows both parts stacked.
    kept, beyond = (np.histogram(values[part], bins)[0] for part in (~late, late))
    axes.stairs(kept, bins, fill=True, facecolor=BLUE)
    axes.stairs(
        kept + beyond,
        bins,
        baseline=kept,
        fill=True,
        facecolor=VERMILLION,
        hatch="////",
        edgecolor="white",
        linewidth=0.0,
    )
    middle, rare = np.percentile(values, [50.0, 99.0])
    for at in (middle, rare):
        axes.axvline(at, color=MUTED, linewidth=1.0, linestyle=":")
    text = f"{stage.name}: median {middle:.3g}, p99 {rare:.3g}, largest {values.max():.3g} ms of {len(values)}"
    if deadline is not None:
        text += f"; {int(late.sum())} over {deadline:g} ms"
    axes.set_title(text, fontweight="bold", fontsize=9.5)


def _measured(stage: StageTimes) -> Float[np.ndarray, " event"]:
    values = np.asarray(stage.milliseconds, np.float64)
    return np.maximum(values[np.isfinite(values)], _LEAST_MS)
