"""``lgprjax radar`` and what uses its file: imports, recovered runs, the vehicle; two arrays that are made alike."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from canon.commands import run, succeed
from canon.record import record
from canon.site import Site
from lgprjax.formats import DriveLog, DriveWriter, SweepRecording, TraceRecording, read_radar_calibration
from lgprjax.formats.store import attribute_of
from lgprjax.runtime.config import read_config
from lgprjax.runtime.preflight import preflight
from lgprjax.scene import WEATHER, RadarConfig
from lgprjax.scene.render import ReceiverConfig, ReceiverFaults, draw_response, time_gain
from recordings.run_sample import run_of_drive
from recordings.standing_array import StandingArray

_FIELD = 0.05
"""Echoes of the site's ground relative to the direct coupling."""


def calibrate(array: StandingArray, folder: Path) -> Path:
    """Two recordings of the standing array, and the commands that calibrate it."""
    folder.mkdir()
    array.write_run(folder / "empty", array.record(0.0, 300, 1))
    array.write_run(folder / "plate", array.record(array.plate(0.45), 300, 2))
    succeed("radar", "lookup", folder / "empty", "-o", folder / "empty.radar.h5")
    plate = ("radar", "plate", folder / "plate", "--lookup", folder / "empty.radar.h5")
    printed = succeed(*plate, "-o", folder / "own.radar.h5")
    for check in ("saturation", "noise_floor", "calibration_drift", "plate_echo", "disagreeing_channels"):
        assert check in printed
    for name in ("empty", "own"):
        assert (folder / f"{name}.radar.png").read_bytes()[:4] == b"\x89PNG"
        succeed("check", folder / f"{name}.radar.h5")
    return folder / "own.radar.h5"


def driven(array: StandingArray, source: Path, target: Path, day: int, scans: int) -> Path:
    """A drive of the site as the array records it; its log has the radar's own look-up, and no gains and delays."""
    with DriveLog.open(source) as log:
        known, scans = log.description.recording, min(scans, log.scans)
        assert isinstance(known, TraceRecording)
        traces, _ = log.read_traces(0, scans)
        time_ns = np.arange(known.samples) * known.sample_interval_ns - known.time_zero_ns
        field = (traces / time_gain(RadarConfig(), ReceiverConfig())) @ array.late(time_ns)
        rows = array.numbers(array.record(_FIELD * field / np.abs(field).std(), scans, day))
        start = array.numbers(array.record(0.0, 64, day + 50)).astype(np.complex128)
        empty = np.mean(start[:, :-1] / start[:, -1:], axis=0) * start[0, -1]
        own = SweepRecording(array.hz, empty.astype(np.complex64), start[0, -1].astype(np.complex64), array.cable_ns)
        description = replace(log.description, recording=own)
        with DriveWriter.create(target, description, channels=array.channels, dtype=np.complex64) as writer:
            writer.append_sweeps(log.scan_time_s[:scans], rows[:, :-1], rows[:, -1])
    return target


def test_a_recovered_run_has_the_calibration(site: Site, tmp_path: Path) -> None:
    """In place of the look-up of its radar, which was taken anew halfway; the run's configuration names it, or the
    command.
    """
    array, folder = StandingArray(11, noise=5e-4, full_scale=8.0), tmp_path / "run"
    calibration = calibrate(array, tmp_path / "a")
    log = driven(array, site.logs["live"], tmp_path / "swept.drive.h5", 7, 120)
    run_of_drive(site._replace(logs={"live": log}), "live", folder, anew="look-up")
    command = ("recover", folder, "--vehicle", tmp_path / "v.vehicle.toml")
    succeed(*command, "-o", tmp_path / "without.drive.h5")
    succeed(*command, "--calibration", calibration, "-o", tmp_path / "named.drive.h5")
    configured = (folder / "config.toml").read_text() + f'[radar]\ncalibration = "{calibration}"\n'
    (folder / "config.toml").write_text(configured)
    succeed(*command, "-o", tmp_path / "configured.drive.h5")
    scans = {}
    for name in ("without", "named", "configured"):
        with DriveLog.open(tmp_path / f"{name}.drive.h5") as made:
            known, scans[name] = made.description.recording, made.scans
            assert isinstance(known, SweepRecording)
            if name != "without":
                assert known.channel_delay_ns is not None
                np.testing.assert_allclose(known.channel_delay_ns, array.delay_ns - array.delay_ns.mean(), atol=0.05)
                assert made.description.provenance["calibration"] == calibration.name
    assert scans["named"] == scans["configured"] > scans["without"] + 40
    other = calibrate(replace(array, steps=51), tmp_path / "b")
    run(*command, "--calibration", other, "-o", tmp_path / "x.drive.h5").refusal.check("sweeps", found="51", file=other)
    assert not (tmp_path / "x.drive.h5").exists()


def test_what_cannot_be_calibrated_leaves_nothing(tmp_path: Path) -> None:
    array = StandingArray(11)
    array.write_run(tmp_path / "empty", array.record(0.0, 100, 1))
    array.write_run(tmp_path / "moved", array.record(array.plate(0.5) * np.linspace(0, 1, 100)[:, None, None], 100, 2))
    output = tmp_path / "x.radar.h5"
    for words, place in (
        (("lookup", tmp_path / "moved"), "remaining_drift"),
        (("lookup", tmp_path / "empty", tmp_path / "empty"), "sweeps"),
    ):
        run("radar", *words, "-o", output).refusal.check(place)
    lookup = tmp_path / "l.radar.h5"
    succeed("radar", "lookup", tmp_path / "empty", "-o", lookup)
    nothing = run("radar", "plate", tmp_path / "empty", "--lookup", lookup, "-o", output)
    nothing.refusal.check("plate_echo", "-25 dB", file=tmp_path / "empty")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "l.radar.h5", "l.radar.png", "moved"]
    run("radar", "lookup", tmp_path / "empty", "-o", lookup).refusal.check("output", "--force", file=lookup)
    run("radar", "lookup", tmp_path / "empty", "-o", tmp_path / "x.h5").refusal.check("-o", ".radar.h5")
    with h5py.File(lookup) as store:
        provenance = json.loads(str(attribute_of(store, "provenance")))
    assert {each["name"] for each in provenance["checks"]} >= {"saturation", "noise_floor"}


def test_a_crew_calibrates_the_radar_of_a_run(tmp_path: Path) -> None:
    """Runs in mode record of simulated devices, by commands alone: the channels' gains and delays are the simulated
    ones, and the next run's drive log has them.
    """
    standing = ("script = [{", "#")
    runs = {}
    for in_view in ("empty", "plate"):
        swept = ("seed = 2\n", f'seed = 2\nrecording = "sweeps"\nin_view = "{in_view}"\n')
        runs[in_view] = record(tmp_path / in_view, 4.0, swept, standing).folder
    lookup, made = tmp_path / "l.radar.h5", tmp_path / "x.radar.h5"
    succeed("radar", "lookup", runs["empty"], "-o", lookup)
    succeed("radar", "plate", runs["plate"], "--lookup", lookup, "-o", made)
    known, day = read_radar_calibration(made), WEATHER["clear"](7919 * 2 + 102)
    true = draw_response(day, len(known.response.gain), ReceiverFaults())
    np.testing.assert_allclose(known.response.gain, true.gain / true.gain.mean(), rtol=0.01)
    np.testing.assert_allclose(known.response.delay_ns, true.delay_ns - true.delay_ns.mean(), atol=0.05)
    assert np.ptp(true.delay_ns) > 0.05
    configured = ("[radar]\n", '[radar]\ncalibration = "../x.radar.h5"\n')
    driven_by_hand = record(tmp_path / "drive", 4.0, ("seed = 2\n", 'seed = 2\nrecording = "sweeps"\n'), configured)
    with DriveLog.open(driven_by_hand.drive) as log:
        recording = log.description.recording
    assert isinstance(recording, SweepRecording)
    checks = preflight(read_config(tmp_path / "drive" / "record.run.toml"))
    assert next(each for each in checks if each.name == "radar calibration").good
    np.testing.assert_array_equal(recording.channel_gain, known.channel_gain)
    np.testing.assert_array_equal(recording.lookup_sweeps, known.lookup_sweeps)
