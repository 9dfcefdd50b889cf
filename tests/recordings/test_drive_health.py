"""Faults put into copies of a sound drive are found where they were put, and the sound drive is called good."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from canon.site import Site
from lgprjax.formats import (
    DriveDescription,
    DriveLog,
    DriveWriter,
    OdometryTrack,
    SweepRecording,
    TraceRecording,
    import_lines,
)
from lgprjax.radar.array import uniform_array
from lgprjax.recordings import DriveHealth, HealthFigure, drive_health


class Recording(NamedTuple):
    """A drive that a test may damage."""

    description: DriveDescription
    time_s: np.ndarray
    traces: np.ndarray
    valid: np.ndarray


@pytest.fixture(scope="module")
def recorded(site: Site) -> Recording:
    with DriveLog.open(site.logs["baseline_left"]) as log:
        traces, valid = log.read_traces(0, log.scans)
        return Recording(log.description, log.scan_time_s, (traces + 128.0).astype(np.uint8), valid)


def measured(path: Path, drive: Recording) -> DriveHealth:
    with DriveWriter.create(
        path, drive.description, channels=drive.traces.shape[1], dtype=drive.traces.dtype
    ) as writer:
        writer.append(drive.time_s, drive.traces, drive.valid)
    with DriveLog.open(path) as log:
        return drive_health(log)


def fallen(health: DriveHealth) -> set[str]:
    """Names of the figures that are judged, and not as good."""
    return {figure.name for figure in health.figures if figure.verdict in ("look", "bad")}


def reaches(figure: HealthFigure, start_m: float, stop_m: float, within_m: float) -> None:
    """The figure's stretches begin and end at these metres."""
    assert min(stretch.start_m for stretch in figure.where) == pytest.approx(start_m, abs=within_m)
    assert max(stretch.stop_m for stretch in figure.where) == pytest.approx(stop_m, abs=within_m)


def test_sound_drives_are_called_good(site: Site) -> None:
    for path in site.logs.values():
        with DriveLog.open(path) as log:
            health = drive_health(log)
        assert fallen(health) == set()
        assert health.verdict == "good"
        assert health.not_measured == ()


def test_noise_is_what_was_added(recorded: Recording, tmp_path: Path) -> None:
    """Two channels of pure noise of known RMS beside silence: the estimate has no ground to confuse it."""
    rng = np.random.default_rng(3)
    traces = np.zeros((640, 4, 200), np.float32)
    traces[:, :, 20:24] = 1000.0
    traces += 5.0 * rng.normal(size=traces.shape).astype(np.float32)
    traces[:, 2] += np.sqrt(75.0) * rng.normal(size=(640, 200)).astype(np.float32)
    recording = TraceRecording(0.16, 4.0, 0.0, 2.5e8, 200)
    description = replace(recorded.description, recording=recording, array=uniform_array(4, 0.127))
    health = measured(
        tmp_path / "noise.drive.h5", Recording(description, recorded.time_s[:640], traces, np.ones((640, 4), bool))
    )
    # 10 over 5 counts: 6 dB.
    assert health.figure("noisy_channel").value == pytest.approx(6.02, abs=0.3)
    assert [stretch.channel for stretch in health.figure("noisy_channel").where] == [2]
    assert health.figure("heard_time").value < 2.0


def test_gain_ramp(recorded: Recording, tmp_path: Path) -> None:
    """A fifth more gain at the end than at the start: quarters of the drive differ by three quarters of it."""
    ramp = np.linspace(0.8, 1.0, len(recorded.traces))[:, None, None]
    traces = np.clip(np.round((recorded.traces - 128.0) * ramp + 128.0), 0, 255).astype(np.uint8)
    health = measured(tmp_path / "ramp.drive.h5", recorded._replace(traces=traces))
    figure = health.figure("gain_drift")
    assert figure.verdict == "look"
    assert figure.value == pytest.approx(100.0 * 0.15 / 0.9, abs=2.0)
    assert fallen(health) == {"gain_drift"}


def test_dead_and_weak_channels_and_opposite_polarity(recorded: Recording, tmp_path: Path) -> None:
    """Channel 3 falls silent over the second half of the drive: its trace stands still at the zero level."""
    traces = recorded.traces.astype(np.float32) - 128.0
    traces[:, 5] *= 0.3
    traces[:, 8] *= -1.0
    traces = np.clip(np.round(traces + 128.0), 0, 255).astype(np.uint8)
    traces[len(traces) // 2 :, 3] = 128
    health = measured(tmp_path / "dead.drive.h5", recorded._replace(traces=traces))
    dead, weak, polarity = (health.figure(name) for name in ("dead_channels", "weak_channel", "polarity"))
    assert dead.value == 1.0
    assert {stretch.channel for stretch in dead.where} == {3}
    reaches(dead, 0.5 * health.travel_m, health.travel_m, 3.0)
    assert weak.value == pytest.approx(20.0 * np.log10(0.3), abs=2.5)
    assert 5 in {stretch.channel for stretch in weak.where}
    assert polarity.value < -0.9
    assert polarity.verdict == "bad"
    assert {stretch.channel for stretch in polarity.where} == {8}
    assert {"dead_channels", "stuck_channel", "weak_channel", "polarity"} <= fallen(health)
    # As plain numbers and names.
    plain = health.as_json()
    assert plain["verdict"] == "bad"
    figures = plain["figures"]
    assert isinstance(figures, list)
    row = next(row for row in figures if row["name"] == "dead_channels")
    assert (row["value"], row["unit"], row["verdict"]) == (1.0, "channels", "bad")
    assert row["where"][0]["channel"] == 3


def test_dropped_non_finite_and_invalid_scans(recorded: Recording, tmp_path: Path) -> None:
    keep = np.ones(len(recorded.traces), bool)
    keep[200:230] = False
    keep[700] = False
    traces, valid = recorded.traces.astype(np.float32), recorded.valid.copy()
    traces[300:310, 2, 7] = np.nan
    valid[500:520, 4] = False
    damaged = Recording(recorded.description, recorded.time_s[keep], traces[keep], valid[keep])
    health = measured(tmp_path / "dropped.drive.h5", damaged)
    figure = health.figure("dropped_scans")
    # By the stamps: the generated receiver loses a scan now and then by itself.
    lost, scans = int(np.sum(np.round(np.diff(damaged.time_s) * 126.0) - 1.0)), len(damaged.time_s)
    assert lost >= 31
    assert figure.value == pytest.approx(100.0 * lost / (scans + lost), abs=1e-9)
    assert figure.verdict == "bad"
    gaps = {(stretch.start_s, stretch.stop_s) for stretch in figure.where}
    assert gaps >= {(recorded.time_s[199], recorded.time_s[230]), (recorded.time_s[699], recorded.time_s[701])}
    assert health.figure("non_finite_scans").value == pytest.approx(100.0 * 10 / scans)
    assert health.figure("invalid_scans").value == pytest.approx(100.0 * 20 / scans)
    spacing_m = health.travel_m / len(recorded.time_s)
    reaches(health.figure("invalid_scans"), 500 * spacing_m, 520 * spacing_m, 3.0)
    assert fallen(health) == {"dropped_scans", "non_finite_scans", "invalid_scans"}


def test_clipping(recorded: Recording, tmp_path: Path) -> None:
    """The ground doubled in size over a quarter of the drive: late samples meet the rails, and those are counted."""
    traces = recorded.traces.copy()
    low, high = len(traces) // 2, 3 * len(traces) // 4
    late = np.clip(128.0 + 6.0 * (traces[low:high, :, 90:].astype(np.float32) - 128.0), 0, 255)
    traces[low:high, :, 90:] = late.astype(np.uint8)
    health = measured(tmp_path / "clipped.drive.h5", recorded._replace(traces=traces))
    figure = health.figure("clipped_traces")
    rails = (traces[:, :, 90:] == 0) | (traces[:, :, 90:] == 255)
    assert figure.value == pytest.approx(100.0 * rails.any(axis=2).mean(), abs=0.3)
    assert figure.verdict != "good"
    reaches(figure, 0.5 * health.travel_m, 0.75 * health.travel_m, 3.0)


def test_bursts(recorded: Recording, tmp_path: Path) -> None:
    """A transmitter nearby: twenty scans in a hundred-scan stretch full of noise."""
    rng = np.random.default_rng(5)
    traces = recorded.traces.astype(np.int16)
    hit = rng.choice(np.arange(400, 500), 20, replace=False)
    traces[hit] += np.round(40.0 * rng.normal(size=traces[hit].shape)).astype(np.int16)
    health = measured(tmp_path / "bursts.drive.h5", recorded._replace(traces=np.clip(traces, 0, 255).astype(np.uint8)))
    figure = health.figure("bursts")
    assert figure.verdict != "good"
    spacing_m = health.travel_m / len(traces)
    reaches(figure, 400 * spacing_m, 500 * spacing_m, 4.5)


def test_wheel_slip(recorded: Recording, tmp_path: Path) -> None:
    """Wheels turn 5 % more between 12 and 24 m."""
    odometry = recorded.description.odometry
    extra = 0.05 * np.clip(odometry.distance_m - 12.0, 0.0, 12.0)
    slipped = replace(recorded.description, odometry=OdometryTrack(odometry.time_s, odometry.distance_m + extra))
    figure = measured(tmp_path / "slip.drive.h5", recorded._replace(description=slipped)).figure("odometer_slip")
    assert figure.value == pytest.approx(5.0, abs=1.5)
    assert figure.verdict != "good"
    reaches(figure, 12.0, 24.6, 2.5)


def test_gnss_jump_and_outage(recorded: Recording, tmp_path: Path) -> None:
    """A metre to the north at 4 s, and back at 5 s: where two stretches begin. Then sigma of 3 m for two seconds."""
    track = recorded.description.navigation
    assert track.sigma_east_m is not None
    away = (track.time_s >= 4.0) & (track.time_s < 5.0)
    jumped = replace(track, latitude_deg=track.latitude_deg + away / 111_000.0)
    description = replace(recorded.description, navigation=jumped)
    health = measured(tmp_path / "jump.drive.h5", recorded._replace(description=description))
    figure = health.figure("gnss_jump")
    assert figure.value == pytest.approx(1.0, abs=0.1)
    assert figure.verdict == "bad"
    assert [round(stretch.stop_s, 1) for stretch in figure.where] == [4.0, 5.0]
    # A jump is not taken for slip.
    assert fallen(health) == {"gnss_jump"}
    sigma = np.where((track.time_s >= 3.0) & (track.time_s <= 5.0), 3.0, track.sigma_east_m)
    description = replace(recorded.description, navigation=replace(track, sigma_east_m=sigma))
    health = measured(tmp_path / "outage.drive.h5", recorded._replace(description=description))
    figure = health.figure("gnss_outage")
    assert figure.value == pytest.approx(2.0, abs=0.05)
    (stretch,) = figure.where
    assert (stretch.start_s, stretch.stop_s) == pytest.approx((3.0, 5.0), abs=0.02)
    assert health.figure("odometer_slip").verdict == "good"


def sweeps_of(recorded: Recording, *, scans: int = 640) -> tuple[DriveDescription, np.ndarray, np.ndarray]:
    """Stepped-frequency sweeps of a direct wave, a few echoes and noise; calibration path of known delay."""
    rng = np.random.default_rng(11)
    frequencies_hz = np.linspace(1e8, 4e8, 61)
    phase = -2j * np.pi * frequencies_hz
    lookup = np.tile(np.exp(phase * 10e-9), (3, 1)).astype(np.complex64)
    calibration = (0.5 * np.exp(phase * 4e-9)).astype(np.complex64)
    travel = np.arange(scans) * 0.036
    echo_ns = 40.0 + 8.0 * np.sin(travel[:, None] / 2.0 + np.arange(3))
    clean = np.exp(phase * 10e-9) + 0.2 * np.exp(phase * 1e-9 * echo_ns[..., None])
    noise = 0.003 * (rng.normal(size=clean.shape) + 1j * rng.normal(size=clean.shape))
    quiet = 0.001 * (rng.normal(size=(scans, 61)) + 1j * rng.normal(size=(scans, 61)))
    description = replace(
        recorded.description,
        array=uniform_array(3, 0.127),
        recording=SweepRecording(frequencies_hz, lookup, calibration),
        truth=None,
    )
    return description, (clean + noise).astype(np.complex64), (calibration + quiet).astype(np.complex64)


def measured_sweeps(
    path: Path, description: DriveDescription, sweeps: np.ndarray, calibration: np.ndarray
) -> DriveHealth:
    time_s = np.arange(len(sweeps)) / 126.0
    with DriveWriter.create(path, description, channels=sweeps.shape[1], dtype=np.complex64) as writer:
        writer.append_sweeps(time_s, sweeps, calibration)
    with DriveLog.open(path) as log:
        return drive_health(log)


def test_drift_is_told_from_drift_that_calibration_takes_out(recorded: Recording, tmp_path: Path) -> None:
    """Receiver gain and phase drift alike in all channels: seen in the calibration channel, gone after it. Where the
    antennas' own path drifts the calibration channel stands, and what remains is reported."""
    description, sweeps, calibration = sweeps_of(recorded)
    health = measured_sweeps(tmp_path / "sweeps.drive.h5", description, sweeps, calibration)
    assert health.kind == "sweeps"
    assert fallen(health) == set()
    # Noise of 0.001 a component on a level of 0.5: -51 dB.
    assert health.figure("calibration_noise").value == pytest.approx(20 * np.log10(0.001 * np.sqrt(2) / 0.5), abs=0.5)
    drift = np.linspace(1.0, 0.8, len(sweeps)) * np.exp(1j * np.radians(np.linspace(0.0, 40.0, len(sweeps))))
    drifting = (sweeps * drift[:, None, None]).astype(np.complex64)
    seen = (calibration * drift[:, None]).astype(np.complex64)
    health = measured_sweeps(tmp_path / "d.drive.h5", description, drifting, seen)
    assert health.figure("calibration_drift").value == pytest.approx(20 * np.log10(1.0 / 0.8), abs=0.2)
    assert health.figure("calibration_phase").value == pytest.approx(40.0, abs=3.0)
    assert fallen(health) == {"calibration_drift", "calibration_phase"}
    health = measured_sweeps(tmp_path / "r.drive.h5", description, drifting, calibration)
    assert health.figure("remaining_phase").value == pytest.approx(40.0, abs=4.0)
    assert health.figure("gain_drift").value == pytest.approx(100.0 * 0.15 / 0.9, abs=2.0)
    assert fallen(health) == {"remaining_phase", "gain_drift"}


def test_narrow_interference(recorded: Recording, tmp_path: Path) -> None:
    """A transmitter at one frequency: on all the time, it is a line; keyed now and then, bursts."""
    description, sweeps, calibration = sweeps_of(recorded)
    rng = np.random.default_rng(2)
    line = sweeps.copy()
    line[:, :, 30] += (0.05 * np.exp(2j * np.pi * rng.uniform(size=line.shape[:2]))).astype(np.complex64)
    health = measured_sweeps(tmp_path / "line.drive.h5", description, line, calibration)
    # 0.05 squared over the noise's 2 (0.003)^2, and the noise itself.
    assert health.figure("narrow_line").value == pytest.approx(10 * np.log10(0.05**2 / (2 * 0.003**2) + 1), abs=1.5)
    keyed = sweeps.copy()
    hit = np.arange(205, 300, 6)
    keyed[hit, :, 30] += np.complex64(0.1)
    health = measured_sweeps(tmp_path / "keyed.drive.h5", description, keyed, calibration)
    figure = health.figure("narrow_bursts")
    assert figure.verdict != "good"
    spacing_m = health.travel_m / len(sweeps)
    reaches(figure, 205 * spacing_m, 300 * spacing_m, 2.0)


_CLOCK = {"dropped_scans", "time_jitter"}
_WAY = {"gnss_jump", "odometer_scale", "odometer_slip"}


@pytest.mark.parametrize(
    ("assumed", "due"),
    [
        ({"time": "unknown"}, {*_CLOCK, "gnss_outage"}),
        ({"position": "straight from the origin"}, {*_WAY, "gnss_outage"}),
        ({"roll": "taken as 0", "heading": "along the path", "height": "taken as 0"}, set[str]()),
    ],
)
def test_what_was_made_up_is_neither_good_nor_bad(
    recorded: Recording, tmp_path: Path, assumed: dict[str, str], due: set[str]
) -> None:
    """Scans that are lacking, wheels that slip and a position that jumps: said of what was recorded, and only of it."""
    keep = np.ones(len(recorded.traces), bool)
    keep[200:260] = False
    track, odometry = recorded.description.navigation, recorded.description.odometry
    away = (track.time_s >= 4.0) & (track.time_s < 5.0)
    spoiled = replace(
        recorded.description,
        navigation=replace(track, latitude_deg=track.latitude_deg + away / 111_000.0),
        odometry=OdometryTrack(odometry.time_s, 1.1 * odometry.distance_m),
        provenance={"assumed": assumed},
    )
    damaged = Recording(spoiled, recorded.time_s[keep], recorded.traces[keep], recorded.valid[keep])
    health = measured(tmp_path / "made_up.drive.h5", damaged)
    unjudged = {figure.name for figure in health.figures if figure.verdict == "not recorded"}
    assert unjudged == due
    assert fallen(health) == {"dropped_scans", "gnss_jump", "odometer_scale"} - due
    assert health.assumed == assumed
    for name in due:
        entry = health.figure(name)
        assert np.isnan(entry.value)
        assert entry.where == ()
        assert next(iter(assumed)) in entry.meaning
    # No JSON reader is given a number that was not measured.
    rows = health.as_json()["figures"]
    assert isinstance(rows, list)
    assert {row["name"] for row in rows if row["value"] is None} == due


def test_a_lines_own_radar_is_all_that_is_judged(recorded: Recording, tmp_path: Path) -> None:
    """An overall verdict counts what was recorded alone: a dead channel makes it bad, a made-up clock nothing."""
    assumed = dict.fromkeys(("time", "speed", "odometry", "position", "position sigma"), "unknown")
    description = replace(recorded.description, provenance={"assumed": assumed})
    sound = recorded._replace(description=description)
    health = measured(tmp_path / "sound.drive.h5", sound)
    assert health.verdict == "good"
    assert {f.name for f in health.figures if f.verdict == "not recorded"} == {
        *_CLOCK,
        *_WAY,
        "gnss_sigma",
        "gnss_outage",
    }
    traces = recorded.traces.copy()
    traces[:, 3] = 128
    assert measured(tmp_path / "dead.drive.h5", sound._replace(traces=traces)).verdict == "bad"
    no_sigma = replace(description, navigation=replace(description.navigation, sigma_east_m=None, sigma_north_m=None))
    bare = measured(tmp_path / "bare.drive.h5", recorded._replace(description=no_sigma))
    assert bare.figure("gnss_sigma").verdict == "not recorded"
    assert bare.not_measured == ()


@pytest.mark.real
def test_the_line_of_opposite_polarity_is_named(real_data: Path, tmp_path: Path) -> None:
    lines = [real_data / "gpr_o_parallel_lines" / f"XLINE{number:02d}.DT1" for number in range(25)]
    import_lines(lines, line_spacing_m=0.2, polarity="keep", output=tmp_path / "lines.drive.h5")
    with DriveLog.open(tmp_path / "lines.drive.h5") as log:
        health = drive_health(log)
    polarity = health.figure("polarity")
    assert polarity.value < -0.8
    assert {stretch.channel for stretch in polarity.where} == {24}
    # What is not good besides: lines of unequal length, and ground that sinks into noise early.
    assert fallen(health) == {"polarity", "invalid_scans", "heard_time"}
