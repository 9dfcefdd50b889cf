"""Is a recorded drive sound? Radar, clock, odometry and GNSS of a drive log, each figure against a stated limit."""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lgprjax.archive.motion_health import clock_figures, jump_figures, motion_figures
from lgprjax.archive.radar_health import radar_figures
from lgprjax.archive.signal_blocks import Recorded, SignalBlocks, SignalReducer, block_edges, regular_scans
from lgprjax.archive.sweep_health import sweep_blocks, sweep_figures
from lgprjax.archive.verdicts import Findings, HealthFigure, Verdict, not_recorded, worst
from lgprjax.formats import DriveLog, TraceRecording, assumed_in_words, assumed_of
from lgprjax.formats.store import open_store, reading

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
"""Quantities that an importer may have made up, by the figures that say nothing then: a made-up clock never drops a
scan, and travel that was made from positions agrees with them."""


class DriveHealth(NamedTuple):
    """What a drive log says about the soundness of its recording.

    Attributes:
        name: of the drive.
        kind: ``traces`` or ``sweeps``.
        scans, channels: of the recording.
        duration_s, travel_m: from the first scan to the last; travel counts reverse as travel.
        figures: measured, or of the verdict ``not recorded``.
        not_measured: names of figures that this drive does not allow, and why.
        assumed: what no instrument recorded, and what stands in for it.
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
        """The worst verdict of all figures, what was not recorded left out."""
        return worst([entry.verdict for entry in self.figures])

    def figure(self, name: str) -> HealthFigure:
        """The figure of this name. Raises ``KeyError`` where it was not measured."""
        for entry in self.figures:
            if entry.name == name:
                return entry
        raise KeyError(name)

    def as_json(self) -> dict[str, object]:
        """Plain values, for JSON; what is not a finite number is null."""
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
    """Measure a drive log, streaming: some hundred numbers a second of recording are kept.

    Args:
        log: traces or sweeps.
        progress: told the number of scans done since the last call.

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


def _as_recorded(figures: list[HealthFigure], lacking: list[tuple[str, str]], assumed: dict[str, str]) -> Findings:
    """Figures, and names of those that are lacking, but those of what was made up judged as ``not recorded``."""

    def unrecorded(name: str) -> HealthFigure | None:
        made_up = {each: assumed[each] for each in _MEASURED_ON.get(name, ()) if each in assumed}
        return not_recorded(name, f"no instrument recorded {assumed_in_words(made_up)}") if made_up else None

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
        # A receiver's converter fills bytes and shorts; of a wider type nobody meets the rails.
        limits = np.iinfo(dtype)
        rails = (limits.min - recording.zero_level, limits.max - recording.zero_level)
    recorded = Recorded(
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
