"""Health of a recorded drive: radar, clock, odometry and GNSS, each figure against a stated limit."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.formats import (
    DriveLog,
    NavigationTrack,
    OdometryTrack,
    TraceRecording,
    VehicleLog,
    assumed_in_words,
    assumed_of,
)
from lgprjax.formats.store import open_store, reading
from lgprjax.formats.travel import mend_travel
from lgprjax.frames import LocalFrame
from lgprjax.recordings.radar_health import radar_figures, sweep_blocks, sweep_figures
from lgprjax.recordings.signals import RecordingTraits, SignalBlocks, SignalReducer, block_edges, regular_scans
from lgprjax.recordings.verdicts import Findings, HealthFigure, Stretch, Verdict, figure, not_recorded, runs, worst

# Figures of a drive's clock, odometry and GNSS/INS.

_WINDOW_M = 8  # odometry and GNSS are compared over this travel: noise of 5 cm makes less than 1 %
_GOOD_SIGMA_M = 0.1  # where GNSS is better than this, it can judge the odometer
_LOST_SIGMA_M = 0.5  # three of these are the default search: beyond, the prior may miss the true place
_JUMP_LAG_S = 0.1
_JUMP_M = (0.2, 0.5)
_SLIP_PERCENT = (2.0, 4.0)
_TRAVEL_JUMP_M = (0.1, 5.0)  # bridged, it costs a second of windows at most; beyond, the position is lost


def clock_figures(time_s: Float[np.ndarray, " scan"], path_m: Float[np.ndarray, " scan"]) -> list[HealthFigure]:
    """Dropped scans and jitter of the time stamps.

    Args:
        time_s: scan times.
        path_m: metres travelled since the first scan.
    """
    interval, moved = np.diff(time_s), np.diff(path_m)
    usual, usual_m = _local_median(interval), _local_median(moved)
    late = interval >= 1.5 * usual
    # Wheel-triggered scans stop with the vehicle: a gap in time alone counts only where the clock is steady.
    steady = float(np.median(np.abs(interval - np.median(interval)))) < 0.1 * float(np.median(interval))
    gap = late & ((moved >= 1.5 * usual_m) | steady)
    lost = np.where(gap, np.round(interval / usual) - 1.0, 0.0)
    where = tuple(
        Stretch(float(time_s[a]), float(time_s[b + 1]), float(path_m[a]), float(path_m[b + 1])) for a, b in runs(gap)
    )
    apart = np.abs(interval - usual)[~late] / float(np.median(interval))
    jitter = 100.0 * float(np.percentile(apart, 95.0)) if len(apart) else 0.0
    return [
        figure(
            "dropped_scans",
            100.0 * float(lost.sum() / (len(time_s) + lost.sum())),
            "%",
            (0.5, 2.0),
            f"scans missing in gaps between time stamps ({int(lost.sum())} scans, {len(where)} gaps)",
            where,
        ),
        figure(
            "time_jitter",
            jitter,
            "%",
            (10.0, 30.0),
            "95th percentile of the difference between neighbouring scan intervals, relative to the usual interval",
        ),
    ]


def _local_median(values: Float[np.ndarray, " interval"]) -> Float[np.ndarray, " interval"]:
    """Median over the ten neighbours to each side."""
    padded = np.pad(values, 10, mode="reflect" if len(values) > 10 else "edge")
    out = np.empty_like(values)
    for start in range(0, len(values), 4096):
        part = padded[start : start + 4096 + 20]
        out[start : start + 4096] = np.median(np.lib.stride_tricks.sliding_window_view(part, 21), axis=1)
    return out


def jump_figures(
    odometry: OdometryTrack, time_s: Float[np.ndarray, " scan"], path_m: Float[np.ndarray, " scan"]
) -> list[HealthFigure]:
    """Odometry steps that no vehicle can drive; empty without any.

    Args:
        odometry: odometry of the drive.
        time_s, path_m: scan times, and distances travelled.
    """
    mended = mend_travel(odometry.time_s, odometry.distance_m)
    jumps = [*mended.bridged, *mended.broken]
    if not jumps:
        return []
    where = []
    for jump in sorted(jumps):
        metres = np.interp([jump.start_s, jump.stop_s], time_s, path_m)
        where.append(Stretch(jump.start_s, jump.stop_s, float(metres[0]), float(metres[1])))
    return [
        figure(
            "travel_jump",
            max(abs(jump.metres) for jump in jumps),
            "m",
            _TRAVEL_JUMP_M,
            f"largest odometry step that no vehicle can drive (position jump): "
            f"{len(mended.bridged)} bridged at local speed, {len(mended.broken)} left open",
            tuple(where),
        )
    ]


def motion_figures(
    navigation: NavigationTrack,
    odometry: OdometryTrack,
    time_s: Float[np.ndarray, " scan"],
    path_m: Float[np.ndarray, " scan"],
) -> tuple[list[HealthFigure], list[tuple[str, str]]]:
    """Figures of GNSS/INS and odometry, and the names of those that could not be measured, with the reason.

    Args:
        navigation, odometry: navigation and odometry of the drive.
        time_s, path_m: scan times, and distances travelled.
    """
    names = ("gnss_sigma", "gnss_outage", "gnss_jump", "odometer_scale", "odometer_slip")
    inside = (navigation.time_s >= odometry.time_s[0]) & (navigation.time_s <= odometry.time_s[-1])
    if inside.sum() < 3:
        return [], [(name, "GNSS/INS and odometry do not overlap in time") for name in names]
    at_s = navigation.time_s[inside]

    def places(mask: Bool[np.ndarray, " interval"]) -> tuple[Stretch, ...]:
        out = []
        for a, b in runs(mask):
            metres = np.interp([at_s[a], at_s[b + 1]], time_s, path_m)
            out.append(Stretch(float(at_s[a]), float(at_s[b + 1]), float(metres[0]), float(metres[1])))
        return tuple(out)

    figures: list[HealthFigure] = []
    missing: list[tuple[str, str]] = []
    interval = np.diff(at_s)
    lost = interval > max(1.0, 5.0 * float(np.median(interval)))
    good = ~lost
    if navigation.sigma_east_m is None or navigation.sigma_north_m is None:
        missing.append(("gnss_sigma", "the log has no sigmas"))
    else:
        sigma = np.maximum(navigation.sigma_east_m, navigation.sigma_north_m)[inside]
        lost |= np.maximum(sigma[1:], sigma[:-1]) > _LOST_SIGMA_M
        good &= np.maximum(sigma[1:], sigma[:-1]) <= _GOOD_SIGMA_M
        figures.append(
            figure(
                "gnss_sigma",
                float(np.percentile(sigma, 95.0)),
                "m",
                (0.25, _LOST_SIGMA_M),
                "95th percentile of the horizontal sigma stated by GNSS/INS (the larger of east and north)",
                places(np.maximum(sigma[1:], sigma[:-1]) >= 0.25),
            )
        )
    figures.append(
        figure(
            "gnss_outage",
            float(interval[lost].sum()),
            "s",
            (0.5, 10.0),
            f"time with a sigma above {_LOST_SIGMA_M:g} m or without a record",
            places(lost),
        )
    )
    # GNSS steps projected on the INS heading: their sum telescopes, so noise is not rectified and reverse keeps its
    # sign.
    frame = LocalFrame(*(float(v[0]) for v in (navigation.latitude_deg, navigation.longitude_deg, navigation.height_m)))
    east, north, _ = frame.to_local(navigation.latitude_deg, navigation.longitude_deg, navigation.height_m)
    east, north = east[inside], north[inside]
    yaw = np.unwrap(frame.yaw_of_heading(navigation.heading_deg, navigation.longitude_deg))[inside]
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    travel = np.interp(at_s, odometry.time_s, odometry.distance_m)
    forward = np.diff(east) * np.cos(middle) + np.diff(north) * np.sin(middle)
    left = np.diff(north) * np.cos(middle) - np.diff(east) * np.sin(middle)
    step = _jumps(forward - np.diff(travel), left, np.abs(np.diff(travel)), interval)
    jumped = step >= _JUMP_M[0]
    figures.append(
        figure(
            "gnss_jump",
            float(step.max()),
            "m",
            _JUMP_M,
            f"largest position step in {_JUMP_LAG_S:g} s that odometry contradicts (a tenth of the travel allowed)",
            places(jumped),
        )
    )
    judged = good & ~jumped
    ratio, centre_s = _ratios(travel, forward, at_s, judged, _WINDOW_M)
    if len(ratio) < 3:
        why = f"fewer than three windows of {_WINDOW_M} m with a sigma of {_GOOD_SIGMA_M:g} m or better"
        return figures, [*missing, ("odometer_scale", why), ("odometer_slip", why)]
    # Of single metres: slip touches more windows than metres.
    scale = float(np.median(_ratios(travel, forward, at_s, judged, 1)[0]))
    slip = 100.0 * np.abs(ratio / scale - 1.0)
    metres = np.interp(centre_s, time_s, path_m)
    slipped = tuple(
        Stretch(float(centre_s[a]), float(centre_s[b]), float(metres[a]), float(metres[b]))
        for a, b in runs(slip >= _SLIP_PERCENT[0])
    )
    figures += [
        figure(
            "odometer_scale",
            100.0 * abs(scale - 1.0),
            "%",
            (1.0, 3.0),
            f"odometry over GNSS travel, median of single metres: {100.0 * (scale - 1.0):+.2f} %",
        ),
        figure(
            "odometer_slip",
            float(slip.max()),
            "%",
            _SLIP_PERCENT,
            f"worst window of {_WINDOW_M} m: odometry over GNSS travel against the drive's median",
            slipped,
        ),
    ]
    return figures, missing


def _jumps(
    forward_m: Float[np.ndarray, " interval"],
    left_m: Float[np.ndarray, " interval"],
    travel_m: Float[np.ndarray, " interval"],
    interval_s: Float[np.ndarray, " interval"],
) -> Float[np.ndarray, " interval"]:
    """Position steps beyond odometry, each interval together with those of the next tenth of a second."""
    lag = max(1, round(_JUMP_LAG_S / float(np.median(interval_s))))

    def over_lag(values: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(values)])
        last = np.minimum(np.arange(len(values)) + lag, len(values))
        return np.asarray(total[last] - total[:-1])

    step = np.hypot(over_lag(forward_m), over_lag(left_m)) - 0.1 * over_lag(travel_m)
    return np.asarray(np.maximum(step, 0.0))


def _ratios(
    travel_m: Float[np.ndarray, " navigation"],
    forward_m: Float[np.ndarray, " interval"],
    at_s: Float[np.ndarray, " navigation"],
    good: Bool[np.ndarray, " interval"],
    window_m: int,
) -> tuple[Float[np.ndarray, " window"], Float[np.ndarray, " window"]]:
    """Odometry over GNSS travel in windows a metre apart where GNSS can judge, and the times of their middles."""
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(travel_m)))])
    came = np.concatenate([[0.0], np.cumsum(forward_m)])
    doubt = np.concatenate([[0], np.cumsum(~good)])
    node = np.searchsorted(path, np.arange(0.0, path[-1] + 1e-9, 1.0))
    node = np.minimum(node, len(path) - 1)
    a, b = node[:-window_m], node[window_m:]
    # Signed: noise at standstill and reversing within the window add path length, but no displacement.
    gone = came[b] - came[a]
    use = (doubt[b] == doubt[a]) & (np.abs(gone) > 0.5 * window_m)
    a, b = a[use], b[use]
    middle = np.interp(0.5 * (path[a] + path[b]), path, at_s)
    return np.asarray((travel_m[b] - travel_m[a]) / gone[use]), middle


_MEASURED_ON = {
    "dropped_scans": ("time",),
    "time_jitter": ("time",),
    "travel_jump": ("speed",),
    "gnss_sigma": ("position sigma",),
    "gnss_outage": ("time", "position"),
    "gnss_jump": ("position", "odometry"),
    "odometer_scale": ("position", "odometry"),
    "odometer_slip": ("position", "odometry"),
}
"""Quantities that an importer may have assumed, by the figures that mean nothing then: an assumed clock never drops a
scan, and travel derived from positions agrees with them.
"""


class DriveHealth(NamedTuple):
    """Health figures of a drive log.

    Attributes:
        name: name of the drive.
        kind: ``traces``, ``sweeps``, or ``no radar``.
        scans, channels: number of scans and channels of the recording.
        duration_s, travel_m: time and distance from the first scan to the last; reverse counts as travel.
        figures: figures, measured or with the verdict ``not recorded``.
        not_measured: names of figures that this drive does not permit, with the reason.
        assumed: assumptions for unrecorded quantities, by quantity.
    """

    name: str
    kind: str
    scans: int
    channels: int
    duration_s: float
    travel_m: float
    figures: tuple[HealthFigure, ...]
    not_measured: tuple[tuple[str, str], ...]
    assumed: dict[str, str]

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all recorded figures; ``not recorded`` without any."""
        judged = [entry.verdict for entry in self.figures if entry.verdict != "not recorded"]
        return worst(judged) if judged else "not recorded"

    def figure(self, name: str) -> HealthFigure:
        """The figure of this name. Raises ``KeyError`` if it was not measured."""
        for entry in self.figures:
            if entry.name == name:
                return entry
        raise KeyError(name)

    def as_json(self) -> dict[str, object]:
        """Plain values, for JSON; non-finite numbers become null."""
        figures = []
        for entry in self.figures:
            row: dict[str, object] = dict(entry._asdict())
            for name in ("value", "look", "bad"):
                row[name] = row[name] if np.isfinite(getattr(entry, name)) else None
            row["where"] = [stretch._asdict() for stretch in entry.where]
            figures.append(row)
        return {
            **self._asdict(),
            "verdict": self.verdict,
            "figures": figures,
            "not_measured": [{"name": name, "why": why} for name, why in self.not_measured],
        }


def drive_health(log: DriveLog, progress: Callable[[int], None] = lambda _: None) -> DriveHealth:
    """Measure a drive log, streaming: some hundred numbers per second of recording are kept.

    Args:
        log: traces or sweeps.
        progress: called with the number of scans done since the last call.

    Raises:
        InputError: the radar data are damaged.
    """
    time_s, odometry = log.scan_time_s, log.description.odometry
    travel_m = np.interp(time_s, odometry.time_s, odometry.distance_m)
    path_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(travel_m)))])
    figures = clock_figures(time_s, path_m)
    is_traces = isinstance(log.description.recording, TraceRecording)
    if is_traces:
        blocks = trace_blocks(log, progress)
    else:
        blocks, calibration = sweep_blocks(log, progress)
        figures += sweep_figures(blocks, calibration, time_s, path_m)
    signal, lacking = radar_figures(blocks, time_s, path_m)
    figures += jump_figures(odometry, time_s, path_m)
    motion, unknown = motion_figures(log.description.navigation, odometry, time_s, path_m)
    assumed = assumed_of(log.description.provenance)
    measured, lacking = _as_recorded([*figures, *signal, *motion], [*lacking, *unknown], assumed)
    return DriveHealth(
        name=log.description.name,
        kind="traces" if is_traces else "sweeps",
        scans=log.scans,
        channels=log.channels,
        duration_s=float(time_s[-1] - time_s[0]),
        travel_m=float(path_m[-1]),
        figures=tuple(measured),
        not_measured=tuple(lacking),
        assumed=assumed,
    )


def has_radar(path: Path) -> bool:
    """Whether a drive log holds radar data: ``drive_health`` measures it; else ``vehicle_health``."""
    with open_store(path) as store:
        return "/radar" in store


def vehicle_health(log: VehicleLog) -> DriveHealth:
    """Measure odometry and GNSS/INS of a drive without radar."""
    odometry = log.odometry
    path_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(odometry.distance_m)))])
    motion, unknown = motion_figures(log.navigation, odometry, odometry.time_s, path_m)
    assumed = assumed_of(log.provenance)
    radar = [("radar and its clock", "a drive without radar")]
    figures = [*jump_figures(odometry, odometry.time_s, path_m), *motion]
    measured, lacking = _as_recorded(figures, [*radar, *unknown], assumed)
    return DriveHealth(
        name=log.name,
        kind="no radar",
        scans=0,
        channels=0,
        duration_s=float(odometry.time_s[-1] - odometry.time_s[0]),
        travel_m=float(path_m[-1]),
        figures=tuple(measured),
        not_measured=tuple(lacking),
        assumed=assumed,
    )


def _as_recorded(figures: list[HealthFigure], lacking: list[tuple[str, str]], assumed: dict[str, str]) -> Findings:
    """Figures and the names of missing ones, with those of assumed quantities judged as ``not recorded``."""

    def unrecorded(name: str) -> HealthFigure | None:
        made_up = {each: assumed[each] for each in _MEASURED_ON.get(name, ()) if each in assumed}
        return not_recorded(name, f"not recorded by an instrument: {assumed_in_words(made_up)}") if made_up else None

    judged = [unrecorded(entry.name) or entry for entry in figures]
    judged += [entry for name, _ in lacking if (entry := unrecorded(name))]
    return judged, [(name, why) for name, why in lacking if not unrecorded(name)]


def trace_blocks(log: DriveLog, progress: Callable[[int], None]) -> SignalBlocks:
    """Reduce a log of time traces. Raises ``InputError`` for damaged data."""
    recording = log.description.recording
    assert isinstance(recording, TraceRecording)
    with open_store(log.path) as store, reading(log.path, "/radar/traces"):
        dtype = store["/radar/traces"].dtype
    counts = dtype.kind in "iu"
    rails = None
    if counts and dtype.itemsize <= 2:
        # A receiver's converter fills bytes and shorts; values of a wider type never reach its limits.
        limits = np.iinfo(dtype)
        rails = (limits.min - recording.zero_level, limits.max - recording.zero_level)
    recorded = RecordingTraits(
        samples=recording.samples,
        interval_ns=recording.sample_interval_ns,
        # Where the log does not say: a wavelet of a thirtieth of the record.
        frequency_hz=recording.centre_frequency_hz or 30e9 / (recording.samples * recording.sample_interval_ns),
        rails=rails,
        half_count=0.5 if counts else 0.0,
    )
    reducer = SignalReducer(log.channels, recorded)
    regular, edges = regular_scans(log.scan_time_s), block_edges(log.scans)
    for start, stop in pairwise(edges):
        known = log.non_finite_scans
        traces, valid = log.read_traces(start, stop)
        reducer.feed(np.where(valid[..., None], traces, 0.0), valid, log.non_finite_scans - known, regular[start:stop])
        progress(stop - start)
    return reducer.result(edges)
