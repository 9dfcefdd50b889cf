"""Polarity and time zero of a drive against its map, found from the match: altered on purpose, and not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from canon.site import Site
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.batch.register import reversed_track
from lgprjax.formats import DriveLog, DriveWriter, MapFile, TraceRecording
from lgprjax.registration import RegisterOptions, Track

SCANS = 500


def altered(
    site: Site, target: Path, *, name: str = "live", sign: int = 1, later_ns: float = 0.0, imported: bool = True
) -> Path:
    """The first metres of a drive with traces turned about, and a header whose time zero is so much too early."""
    with DriveLog.open(site.logs[name]) as log:
        description = log.description
        recording = description.recording
        assert isinstance(recording, TraceRecording)
        traces, valid = log.read_traces(0, SCANS)
        moved = replace(recording, zero_level=0.0, time_zero_ns=recording.time_zero_ns - later_ns)
        provenance = description.provenance | ({"lines": []} if imported else {})
        description = replace(description, recording=moved, provenance=provenance)
        with DriveWriter.create(target, description, channels=log.channels, dtype=np.float32) as writer:
            writer.append(log.scan_time_s[:SCANS], sign * traces, valid)
    return target


def register(site: Site, drive: Path) -> RegisteredDrive:
    with MapFile.open(site.map) as source, DriveLog.open(drive) as log:
        return register_log(source, log, RegisterOptions(search_m=1.5))


def ok_and_off_m(drive: RegisteredDrive) -> tuple[float, float]:
    """Share of ok scans after the first four metres, and the largest error of those."""
    assert drive.truth is not None
    late = drive.track.travel_m > drive.track.travel_m[0] + 4.0
    ok = (drive.table["code"].to_numpy() == "ok") & late
    off_m = np.hypot(*(np.asarray(drive.fix.pose)[:, :2] - drive.truth[:, :2]).T)
    return float(ok.sum() / late.sum()), float(off_m[ok].max(initial=0.0))


def test_an_altered_drive_is_found_and_told(site: Site, tmp_path: Path) -> None:
    drive = register(site, altered(site, tmp_path / "a.drive.h5", sign=-1, later_ns=-4.0))
    found = drive.alignment
    assert found.sign == -1
    # Hypotheses lie a fifth of a period apart, 0.7 ns, and the search in height takes up half a nanosecond.
    assert found.later_ns == pytest.approx(-4.0, abs=0.75)
    assert found.told is not None
    assert f"{found.later_ns:+.2f} ns" in found.told
    assert 0.0 < found.chance <= 1e-6
    share, worst_m = ok_and_off_m(drive)
    assert share > 0.9
    assert worst_m < 0.3


def test_a_line_walked_back_has_its_places_by_travel_at_any_speed() -> None:
    """Brisk, a stop, slow: what the odometer says between two scans is how far apart their places are."""
    step_m = np.concatenate([np.full(200, 0.05), np.zeros(100), np.full(200, 0.02)])
    travel_m = np.cumsum(step_m)
    pose = np.zeros((len(travel_m), 5))
    pose[:, 0] = 3.0 + travel_m
    none = np.full(len(travel_m), np.nan)
    leg = np.zeros(len(travel_m), np.int64)
    back = reversed_track(Track(pose, travel_m, step_m / 0.01, np.full(len(travel_m), 0.01), none, leg))
    np.testing.assert_allclose(back.pose[:, 0] - back.travel_m, 3.0 + travel_m[-1] + travel_m[0], atol=1e-9)
    assert back.pose[0, 0] > back.pose[-1, 0]
