"""Very many short drives on disk: cut from one simulated drive, each at scans of its own, with the map they lie on."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.formats import DriveLog, DriveWriter, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.mapping import build_map
from lgprjax.simulation import demo_site, write_drives


class ShortDrives(NamedTuple):
    """A map and the drives on it."""

    map: Path
    drives: list[Path]


def make_short_drives(
    folder: Path, count: int, *, length_m: float, scans: int, say: Callable[[str], None]
) -> ShortDrives:
    """Simulate a road, map it by two drives, and cut a third one into many that overlap.

    Args:
        folder: for all files.
        count: of the short drives; no two begin at the same scan.
        length_m: of the road.
        scans: of a short drive.
        say: told what is being done.

    Raises:
        ValueError: the road is too short for so many.
    """
    say(f"simulating a road of {length_m:g} m")
    site = {name: drive for name, drive in demo_site(1, length_m).items() if name != "impostor"}
    logs = write_drives(site, folder)
    database = folder / "road.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], database)
    say(f"cutting {count} drives of {scans} scans")
    with DriveLog.open(logs["live"]) as log:
        starts = np.unique(np.linspace(0, log.scans - scans, count).astype(int))
        if len(starts) < count:
            raise ValueError(f"{log.scans} scans hold no {count} different drives of {scans}")
        drives = [folder / f"drive_{number:04d}.drive.h5" for number in range(count)]
        for start, path in zip(starts, drives, strict=True):
            cut_drive(log, int(start), int(start) + scans, path)
    return ShortDrives(database, drives)


def cut_drive(log: DriveLog, start: int, stop: int, path: Path) -> None:
    """Write the scans from ``start`` to before ``stop`` of a drive of bytes as a drive of their own."""
    time_s, whole = log.scan_time_s[start:stop], log.description
    assert isinstance(whole.recording, TraceRecording)
    traces, valid = log.read_traces(start, stop)
    odometry = _span(whole.odometry.time_s, time_s)
    part = replace(
        whole,
        name=path.name.removesuffix(".drive.h5"),
        navigation=_track(whole.navigation, time_s),
        odometry=OdometryTrack(whole.odometry.time_s[odometry], whole.odometry.distance_m[odometry]),
        truth=None if whole.truth is None else _track(whole.truth, time_s),
        provenance={**whole.provenance, "scans": [start, stop]},
    )
    with DriveWriter.create(path, part, channels=log.channels, dtype=np.uint8) as writer:
        writer.append(time_s, np.round(traces + np.float32(whole.recording.zero_level)).astype(np.uint8), valid)


def _track(track: NavigationTrack, time_s: Float[np.ndarray, " scan"]) -> NavigationTrack:
    kept = _span(track.time_s, time_s)
    columns = {field.name: getattr(track, field.name) for field in fields(track)}
    cut: dict[str, Any] = {name: None if values is None else values[kept] for name, values in columns.items()}
    return NavigationTrack(**cut)


def _span(at_s: Float[np.ndarray, " time"], time_s: Float[np.ndarray, " scan"]) -> slice:
    """What spans the scans, and a moment to both sides."""
    low, high = np.searchsorted(at_s, [time_s[0], time_s[-1]])
    return slice(max(int(low) - 1, 0), int(high) + 2)
