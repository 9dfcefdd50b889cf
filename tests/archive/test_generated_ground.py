"""Accuracy and refusal on generated ground, prior wrong by a metre. Figures: docs/performance.md."""

from pathlib import Path

import numpy as np
import pytest

from generated import Site, make_site, register_site
from lgprjax.archive import RegisteredDrive, build_map, register_log
from lgprjax.formats import DriveLog, DriveWriter, MapFile, TraceRecording
from lgprjax.registration import Code, RegisterOptions, ground_map_for
from lgprjax.registration.batches import WindowLayout
from lgprjax.registration.match import match_scans
from lgprjax.registration.prepared import PreparedGround


def programs() -> int:
    """Compiled programs of the search so far."""
    return int(match_scans._cache_size())  # type: ignore[attr-defined]


def errors_m(drive: RegisteredDrive) -> tuple[np.ndarray, np.ndarray]:
    """Along and cross of fix less truth, by the truth's own heading."""
    assert drive.truth is not None
    off, yaw = np.asarray(drive.fix.pose)[:, :2] - drive.truth[:, :2], drive.truth[:, 3]
    return np.cos(yaw) * off[:, 0] + np.sin(yaw) * off[:, 1], np.cos(yaw) * off[:, 1] - np.sin(yaw) * off[:, 0]


@pytest.fixture(scope="module")
def live(site: Site) -> RegisteredDrive:
    return register_site(site, "live")


def test_a_clear_second_day_is_located(live: RegisteredDrive) -> None:
    ok = live.table["code"].to_numpy() == "ok"
    along, cross = errors_m(live)
    at_truth = float(np.nanmedian(live.correlation_at_truth))
    rms = float(np.sqrt(np.mean(cross[ok] ** 2)))
    print(f"clear day: {ok.mean():.3f} ok, cross-track RMS {rms:.3f} m, median r at the truth {at_truth:.2f}")
    assert ok.mean() >= 0.85
    assert rms <= 0.04
    assert np.max(np.abs(along[ok])) < 0.3
    # Not an easy ground chosen to please: the plain score at the truth is what the site is made for.
    assert 0.65 <= at_truth <= 0.85


def test_prior_was_wrong_by_a_metre(live: RegisteredDrive) -> None:
    assert live.truth is not None
    off = np.hypot(*(live.track.pose[:, :2] - live.truth[:, :2]).T)
    assert np.median(off) == pytest.approx(1.0, abs=0.15)


def test_one_program_serves_the_whole_drive(site: Site, live: RegisteredDrive) -> None:
    """Every tile, block and batch of another drive on the same map: nothing compiles."""
    assert live.table is not None
    before = programs()
    register_site(site, "impostor")
    assert programs() == before


def test_blocks_do_not_change_fixes(site: Site, live: RegisteredDrive, monkeypatch: pytest.MonkeyPatch) -> None:
    """Codes equal and poses within 1 mm when the drive is fed in blocks of another size."""
    monkeypatch.setattr("lgprjax.archive.registering.BLOCK_SCANS", 300)
    other = register_site(site, "live")
    assert list(other.table["code"]) == list(live.table["code"])
    off = np.abs(np.asarray(other.fix.pose)[:, :2] - np.asarray(live.fix.pose)[:, :2])
    assert np.nanmax(off) < 1e-3


@pytest.mark.parametrize("window_m", [0.0, 0.5])
def test_memory_bound_does_not_change_fixes(site: Site, live: RegisteredDrive, window_m: float) -> None:
    """Codes equal and poses within 1 mm in batches of another size: other neighbours, other shapes."""
    small = RegisterOptions(search_m=1.5, window_m=window_m, memory_mb=1.0)
    large = RegisterOptions(search_m=1.5, window_m=window_m)
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        prepared = PreparedGround(ground_map_for(source, small), log.description.array)
        sizes = [WindowLayout.of(prepared, options).ends for options in (small, large)]
        drive = register_log(source, log, small)
        other = live if window_m == 0.0 else register_log(source, log, large)
    assert 1 <= sizes[0] <= sizes[1] // 2
    assert list(other.table["code"]) == list(drive.table["code"])
    assert np.nanmax(np.abs(np.asarray(other.fix.pose)[:, :2] - np.asarray(drive.fix.pose)[:, :2])) < 1e-3


def test_damaged_scans_say_so_and_disturb_nobody(site: Site, live: RegisteredDrive, tmp_path: Path) -> None:
    """A drive with NaN scans and a dead channel: the scans say so, all others are as before."""
    damaged = tmp_path / "damaged.drive.h5"
    with DriveLog.open(site.logs["live"]) as log:
        recording = log.description.recording
        assert isinstance(recording, TraceRecording)
        traces, _ = log.read_traces(0, 300)
        traces = traces + np.float32(recording.zero_level)
        traces[100:104] = np.nan
        traces[:, 3] = np.nan
        with DriveWriter.create(damaged, log.description, channels=log.channels, dtype=np.float32) as writer:
            writer.append(log.scan_time_s[:300], traces)
    with MapFile.open(site.map) as source, DriveLog.open(damaged) as log:
        drive = register_log(source, log, RegisterOptions(search_m=1.5))
    code = np.asarray(drive.fix.code)
    assert list(code[100:104]) == [Code.NON_FINITE] * 4
    assert np.mean(code[10:100] == Code.OK) > 0.85
    assert np.mean(code[110:] == Code.OK) > 0.85
    assert np.nanmax(drive.fix.overlap_channels) == 10
    ok = (code == Code.OK) & (np.asarray(live.fix.code)[:300] == Code.OK)
    off = np.asarray(drive.fix.pose)[ok, :2] - np.asarray(live.fix.pose)[:300][ok, :2]
    assert np.median(np.abs(off)) < 0.02


def test_windows_are_at_least_as_good(site: Site) -> None:
    """Half-metre windows: a fix each sixteenth of a window, the scans between say no_window."""
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        drive = register_log(source, log, RegisterOptions(search_m=1.5, window_m=0.5))
    code = drive.table["code"].to_numpy()
    tried = code != "no_window"
    assert 0.3 < tried.mean() < 1.0
    assert not tried[: int(0.5 / (4.5 / 126)) - 1].any()
    assert np.mean(code[tried] == "ok") > 0.93
    _, cross = errors_m(drive)
    assert np.sqrt(np.mean(cross[code == "ok"] ** 2)) < 0.04


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.campaign)])
def test_no_impostor_is_called_ok(seed: int, tmp_path: Path) -> None:
    """Two roads of 60 m: 2,520 scans over ground that is not the map's, none of them ok (10,072: ``make campaign``)."""
    road = make_site(tmp_path, seed, 60.0)
    drive = register_site(road, "impostor")
    code = np.asarray(drive.fix.code)
    strength = np.asarray(drive.fix.correlation) * np.sqrt(np.asarray(drive.fix.overlap))
    print(f"impostor {seed}: {len(code)} scans, highest strength {np.nanmax(strength):.3f}")
    assert len(code) > 1250
    assert np.sum(code == Code.OK) == 0


def test_one_baseline_is_a_map(site: Site, tmp_path: Path) -> None:
    """One baseline is a map too: the lane beside it overlaps in part, and what is ok is right."""
    database = tmp_path / "one.map.h5"
    build_map([site.logs["baseline_left"]], database)
    with MapFile.open(database) as source, DriveLog.open(site.logs["live"]) as log:
        drive = register_log(source, log, RegisterOptions(search_m=1.5))
    ok = np.asarray(drive.fix.code) == Code.OK
    along, cross = errors_m(drive)
    assert ok.mean() > 0.75
    assert np.max(np.hypot(along[ok], cross[ok])) < 0.3
