"""Stepped-frequency drives end to end: the traces of a generated site as such a radar would have recorded them."""

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from canon.map import of_many_grounds
from canon.site import Site, registered_once
from lgprjax.batch import RegisteredDrive, fix_example, register_log
from lgprjax.formats import DriveLog, DriveWriter, MapFile
from lgprjax.mapping import build_map
from lgprjax.radar import default_chain, sweep_chain
from lgprjax.recordings import recording_of
from lgprjax.recordings.drives import at_levels, depth_level, level_ratio
from lgprjax.registration import Code, RegisterOptions, Track
from lgprjax.scene import RadarConfig
from lgprjax.scene.render import ReceiverConfig, time_gain
from recordings.sweep_drives import FREQUENCIES_HZ, write_sweeps
from refusals import refused

OPTIONS = RegisterOptions(search_m=1.5)
LIVE_SCANS = 400


def registered(database: Path, drive: Path, options: RegisterOptions = OPTIONS) -> RegisteredDrive:
    with MapFile.open(database) as source, DriveLog.open(drive) as log:
        return register_log(source, log, options)


def right(drive: RegisteredDrive) -> tuple[float, float]:
    """Share of fixes that are ok, and their cross-track RMS."""
    assert drive.truth is not None
    ok = np.asarray(drive.fix.code) == Code.OK
    off, yaw = np.asarray(drive.fix.pose)[:, :2] - drive.truth[:, :2], drive.truth[:, 3]
    cross = (np.cos(yaw) * off[:, 1] - np.sin(yaw) * off[:, 0])[ok]
    assert np.max(np.hypot(off[ok, 0], off[ok, 1]), initial=0.0) < 0.3
    return float(ok.mean()), float(np.sqrt(np.mean(cross**2)))


@pytest.fixture(scope="module")
def sweeps(site: Site, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("sweeps")
    return {
        name: write_sweeps(
            log, folder / f"{name}.drive.h5", day, scans=None if name.startswith("baseline") else LIVE_SCANS
        )
        for day, (name, log) in enumerate(site.logs.items())
    }


@pytest.fixture(scope="module")
def sweep_map(sweeps: dict[str, Path]) -> Path:
    database = sweeps["live"].parent / "sweeps.map.h5"
    build_map([sweeps["baseline_left"], sweeps["baseline_right"]], database, measure=of_many_grounds)
    return database


@pytest.fixture(scope="module")
def traces(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same scans of the live drive as traces."""
    path = tmp_path_factory.mktemp("traces") / "live.drive.h5"
    with DriveLog.open(site.logs["live"]) as log:
        samples, _ = log.read_traces(0, LIVE_SCANS)
        with DriveWriter.create(path, log.description, channels=log.channels, dtype=np.uint8) as writer:
            writer.append(log.scan_time_s[:LIVE_SCANS], (samples + 128.0).astype(np.uint8))
    return path


@pytest.fixture(scope="module")
def plain(site: Site, tmp_path_factory: pytest.TempPathFactory) -> RegisteredDrive:
    """Drive and map both of traces."""
    return registered_once(tmp_path_factory, site, "live")


@pytest.fixture(scope="module")
def by_sweeps(sweep_map: Path, sweeps: dict[str, Path]) -> RegisteredDrive:
    """Drive and map both of sweeps."""
    return registered(sweep_map, sweeps["live"])


def check_like(drive: RegisteredDrive, plain: RegisteredDrive) -> None:
    """About as many fixes as by traces, as good, and at the same places."""
    share, cross_m = right(drive)
    ok = np.asarray(plain.fix.code)[:LIVE_SCANS] == Code.OK
    assert share >= ok.mean() - 0.06
    assert cross_m <= 0.04
    both = ok & (np.asarray(drive.fix.code) == Code.OK)
    apart = np.asarray(drive.fix.pose)[both, :2] - np.asarray(plain.fix.pose)[:LIVE_SCANS][both, :2]
    assert np.sqrt(np.mean(apart**2)) < 0.02


def test_sweeps_are_located_like_traces(
    sweep_map: Path, sweeps: dict[str, Path], by_sweeps: RegisteredDrive, plain: RegisteredDrive
) -> None:
    check_like(by_sweeps, plain)
    with MapFile.open(sweep_map) as source, DriveLog.open(sweeps["live"]) as log:
        assert source.provenance["recording"] == "sweeps"
        assert len(source.description.gain) * source.description.settings.sample_interval_ns <= 60.0
        example = fix_example(source, log, by_sweeps, OPTIONS, 300)
    assert example is not None
    live, under = (part.ravel() for part in (example.strips.live, example.strips.baseline))
    assert live @ under / np.sqrt((live @ live) * (under @ under)) > 0.5


def test_other_ground_is_refused(sweep_map: Path, sweeps: dict[str, Path]) -> None:
    assert not np.any(np.asarray(registered(sweep_map, sweeps["impostor"]).fix.code) == Code.OK)


def test_sweeps_and_traces_are_located_on_maps_of_the_other(
    site: Site, sweep_map: Path, sweeps: dict[str, Path], traces: Path, plain: RegisteredDrive
) -> None:
    check_like(registered(site.map, sweeps["live"]), plain)
    check_like(registered(sweep_map, traces), plain)


def test_baselines_of_both_kinds_have_one_level_over_depth(site: Site, sweeps: dict[str, Path], tmp_path: Path) -> None:
    """Of traces and sweeps the levels differ by the receiver's gain over time, by 40 dB and more."""
    database = tmp_path / "both.map.h5"
    build_map([site.logs["baseline_left"], sweeps["baseline_right"]], database, measure=None)
    with MapFile.open(database) as source:
        left, right = (
            np.sqrt(np.mean(source.read_stations(np.flatnonzero(source.drive == drive)).profile ** 2, axis=(0, 1)))
            for drive in (0, 1)
        )
    ratio_db = 20.0 * np.log10(right / left)
    assert np.ptp(ratio_db[np.isfinite(ratio_db)]) < 20.0


def test_without_its_calibration_channel_a_drive_takes_longer_windows(
    sweeps: dict[str, Path], sweep_map: Path, by_sweeps: RegisteredDrive, tmp_path: Path
) -> None:
    """The drift is no decoration: divided by one calibration sweep for all scans, every match is worth less."""
    path = tmp_path / "frozen.drive.h5"
    with DriveLog.open(sweeps["live"]) as log:
        recorded, calibration, _ = log.read_sweeps(0, log.scans)
        with DriveWriter.create(path, log.description, channels=log.channels, dtype=np.complex64) as writer:
            writer.append_sweeps(log.scan_time_s, recorded, np.repeat(calibration[:1], log.scans, axis=0))
    frozen = registered(sweep_map, path)
    assert np.nanmean(frozen.fix.window_m) > 1.2 * np.nanmean(by_sweeps.fix.window_m)
    assert np.nanmedian(frozen.fix.correlation) < np.nanmedian(by_sweeps.fix.correlation) - 0.03


def test_faults_say_so_and_disturb_nobody(sweeps: dict[str, Path], sweep_map: Path, tmp_path: Path) -> None:
    """NaN scans, a dead calibration channel for two scans, and a channel that is noise."""
    path, rng = tmp_path / "faults.drive.h5", np.random.default_rng(1)
    with DriveLog.open(sweeps["live"]) as log:
        recorded, calibration, _ = log.read_sweeps(0, 300)
        recorded[:, 3] = rng.normal(size=(300, 61)) + 1j * rng.normal(size=(300, 61))
        recorded[100:104] = np.nan
        calibration[150:152, 20] = 0.0
        calibration[153] = np.nan
        with DriveWriter.create(path, log.description, channels=log.channels, dtype=np.complex64) as writer:
            writer.append_sweeps(log.scan_time_s[:300], recorded, calibration)
    with DriveLog.open(path) as log:
        (block,) = recording_of(log).blocks(300)
        bad = [100, 101, 102, 103, 150, 151, 153]
        assert np.flatnonzero(~block.valid.any(axis=1)).tolist() == bad
        assert np.isfinite(block.recorded[block.valid]).all()
    drive = registered(sweep_map, path)
    assert np.mean(np.asarray(drive.fix.code)[40:] == Code.OK) > 0.8
    assert right(drive)[0] > 0.0
    assert np.nanmax(drive.fix.overlap_channels) == 10


def test_a_drive_reads_the_same_from_anywhere(sweeps: dict[str, Path]) -> None:
    with DriveLog.open(sweeps["live"]) as log:
        recording = recording_of(log)
        whole = list(recording.blocks(256))
        assert [block.start for block in whole] == [0, 256]
        assert len(whole[1].recorded) == LIVE_SCANS - 256
        later = next(recording.blocks(50, 200))
        assert later.start == 200
        np.testing.assert_allclose(later.recorded, whole[0].recorded[200:250], rtol=1e-6)
        np.testing.assert_array_equal(later.valid, whole[0].valid[200:250])


@pytest.mark.parametrize(
    ("changes", "values"),
    [
        ({"frequencies_hz": np.geomspace(100e6, 400e6, 61)}, ("2.337", "9.136 MHz")),
        ({"lookup_calibration_sweep": np.zeros(61, np.complex64)}, (61,)),
    ],
)
def test_sweeps_that_no_profile_can_be_made_of(
    site: Site, tmp_path: Path, changes: dict[str, Any], values: tuple[object, ...]
) -> None:
    path = write_sweeps(site.logs["live"], tmp_path / "a.drive.h5", 0, scans=100, changes=changes)
    with refused(f"/radar/{next(iter(changes))}", *values):
        build_map([path], tmp_path / "a.map.h5")
    assert not (tmp_path / "a.map.h5").exists()


def test_a_band_that_cannot_serve_the_map_is_refused(site: Site, tmp_path: Path, sweeps: dict[str, Path]) -> None:
    with DriveLog.open(sweeps["live"]) as log:
        recording = recording_of(log)
        recording.operator(default_chain(250e6, 0.035), 50)
        with refused("/radar/frequencies_hz", "270 to 1800 MHz", found="100 to 400 MHz"):
            recording.operator(default_chain(900e6, 0.035), 50)
        with refused(None, "--centre-frequency-mhz", found=250):
            build_map([sweeps["live"]], tmp_path / "a.map.h5", centre_frequency_hz=250e6)
    with DriveLog.open(site.logs["live"]) as log:
        recording_of(log).operator(sweep_chain(FREQUENCIES_HZ, 0.035), 50)
        with refused(None, "0.0966 ns", found="0.16 ns"):
            recording_of(log).operator(default_chain(4.5e9, 0.035), 50)


def test_depth_is_bounded(site: Site, sweeps: dict[str, Path]) -> None:
    settings = sweep_chain(FREQUENCIES_HZ, 0.035)
    for path, deepest_ns in ((sweeps["live"], 60.0), (site.logs["live"], 369 * 0.16 - 4.0)):
        with DriveLog.open(path) as log:
            recording = recording_of(log)
            assert recording.samples(settings, None) == int(deepest_ns / settings.sample_interval_ns)
            assert recording.samples(settings, 25.0) == int(25.0 / settings.sample_interval_ns)
            assert recording.samples(settings, 1e4) > recording.samples(settings, 25.0)


def test_levels_are_told_by_travel_and_matched(traces: Path, sweeps: dict[str, Path]) -> None:
    """The two kinds' levels differ by the receiver's gain over time, by 40 dB and more, and not once matched."""
    settings, levels = sweep_chain(FREQUENCIES_HZ, 0.035), []
    for path in (traces, sweeps["live"]):
        with DriveLog.open(path) as log:
            recording, scans = recording_of(log), log.scans
            travel_m = np.arange(scans) * 0.035
            zero = np.zeros(scans)
            track = Track(np.zeros((scans, 5)), travel_m, zero, zero, zero, np.zeros(scans, np.int64))
            levels.append(depth_level(recording, recording.operator(settings, 50), track, 4.0))
    ratio = level_ratio(*levels)
    time_ns = np.arange(50) * settings.sample_interval_ns
    gain = np.interp(
        time_ns, np.arange(369) * 0.16 - 4.0, np.asarray(time_gain(RadarConfig(), ReceiverConfig()), np.float64)
    )
    reached = (time_ns > 6.0) & (time_ns < 40.0)
    step_db = np.diff(20 * np.log10((ratio / gain)[reached]))
    assert gain[reached].max() / gain[reached].min() > 50.0
    # The eight bits' own noise stands in the level of the traces; else the ratio is the gain up to one factor.
    assert np.ptp(20 * np.log10((ratio / gain)[reached])) < 6.0
    assert np.abs(step_db).max() < 3.0
    matched = np.asarray(at_levels(jnp.ones((2, 50)), levels[0], levels[1]))
    np.testing.assert_allclose(matched[0] / matched[0].max(), ratio / ratio.max(), rtol=1e-5)
