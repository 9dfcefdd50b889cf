"""Sweeps over the wire are the same numbers as sweeps from a drive log: calibrated, looked up, dead channels found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lgprjax.formats import DriveLog, SweepRecording, complex_rows, read_vehicle, write_radar_calibration
from lgprjax.radar import sweep_chain
from lgprjax.recordings.drives import SweepDrive
from lgprjax.registration import TRACK_SCANS
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.registration.scans import (
    RadarDescription,
    RadarSelf,
    SweepDescription,
    SweepReader,
    TraceReader,
)
from lgprjax.runtime.registration.search import reader_of
from lgprjax.wire import Frame, Sender, Value, decode
from refusals import refused
from runtime.swept_log import write_swept_log

_CHANNELS, _STEPS, _SCANS = 5, 41, 96
_DEAD, _SILENT_SCAN = 3, 70
_BLOCK = 4


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> DriveLog:
    """A drive of echoes at random depths, its receiver drifting by 20 %, with a dead channel and a silent scan."""
    rng = np.random.default_rng(11)
    frequencies = 1e8 + 5e6 * np.arange(_STEPS)
    delays = rng.uniform(3e-9, 60e-9, size=(_SCANS, _CHANNELS, 12))
    echoes = rng.normal(size=delays.shape)[..., None] * np.exp(-2j * np.pi * delays[..., None] * frequencies)
    drift = (np.linspace(1.0, 1.2, _SCANS) * np.exp(0.5j * np.linspace(0.0, 1.0, _SCANS)))[:, None, None]
    coupling = 4.0 * np.exp(-2j * np.pi * 2e-9 * frequencies)
    path = 0.5 * np.exp(-2j * np.pi * 12e-9 * frequencies)
    sweeps = ((echoes.sum(axis=2) + coupling) * drift).astype(np.complex64)
    calibration = (path * drift[:, 0]).astype(np.complex64)
    sweeps[:, _DEAD] = 1e-5 * (rng.normal(size=(_SCANS, _STEPS, 2)) @ [1.0, 1.0j])
    calibration[_SILENT_SCAN] = 0.0
    lookup = np.tile(coupling, (_CHANNELS, 1)).astype(np.complex64)
    gain, delay = rng.uniform(0.9, 1.1, _CHANNELS), rng.uniform(-0.3, 0.3, _CHANNELS)
    recording = SweepRecording(frequencies, lookup, path.astype(np.complex64), 12.0, gain, delay)
    file = tmp_path_factory.mktemp("swept") / "swept.drive.h5"
    write_swept_log(file, sweeps, calibration, recording)
    return DriveLog.open(file)


def _recording(log: DriveLog) -> SweepRecording:
    assert isinstance(log.description.recording, SweepRecording)
    return log.description.recording


def _config(folder: Path, radar: str) -> RuntimeConfig:
    lines = '[ports.{}]\nurl = "socket://127.0.0.1:1"\n'
    ports = "".join(lines.format(name) for name in ("drive_by_wire", "controller", "gnss", "radar"))
    named = 'name = "x"\nvehicle = "v.vehicle.toml"\nmap = "m.map.h5"\nroutes = ["r.route.toml"]\n'
    (folder / "x.run.toml").write_text(f"{named}{ports}[radar]\n{radar}\n", encoding="utf-8")
    return read_config(folder / "x.run.toml")


def test_a_calibration_replaces_what_radar_and_vehicle_file_say(log: DriveLog, tmp_path: Path) -> None:
    """Other look-up and delays than the radar's; a channel that could not be calibrated is not used."""
    known, radar = _recording(log), SweepDescription(_CHANNELS, _STEPS, 1e8, 5e6, 12.0, 1.0 / 126.0)
    assert known.channel_delay_ns is not None
    made = replace(known, channel_delay_ns=-known.channel_delay_ns, lookup_sweeps=0.5 * known.lookup_sweeps)
    made = replace(made, channel_valid=np.arange(_CHANNELS) != 1)
    write_radar_calibration(tmp_path / "own.radar.h5", made, {})
    vehicle = read_vehicle(Path(__file__).parents[2] / "onboard" / "made_up.vehicle.toml")
    config, frames = _config(tmp_path, 'calibration = "own.radar.h5"'), _frames(log, 8)
    said = RadarSelf(calibrated=True)
    sender = Sender(9)
    rows: dict[str, Value] = {"rows": _CHANNELS + 1, "steps": _STEPS, "width": 8, "scale": 1.0}
    described = {"channels": _CHANNELS, "steps": _STEPS, "first_khz": 100_000, "step_khz": 5000}
    told = {**described, "group_delay_ps": 12_000, "scan_period_us": 7937}
    said.take(decode(sender.frame("radar_sweep_description", told, mode=0, mono_ns=0)))
    assert said.complete
    for level in (1.0, 2.0):  # a look-up that changes does not matter
        data = np.full(2 * _STEPS * (_CHANNELS + 1), level, "<f4").tobytes()
        said.take(decode(sender.frame("radar_lookup", {**rows, "data": data}, mode=0, mono_ns=1)))
    recorded, valid = reader_of(config, vehicle, radar, said.lookup).read(frames[:TRACK_SCANS])
    other, usable = SweepReader(radar, made, TRACK_SCANS, "").read(frames[:TRACK_SCANS])
    assert not valid[:, 1].any()
    np.testing.assert_array_equal(valid, usable)
    np.testing.assert_allclose(recorded, other, rtol=1e-6)
    with refused("sweeps", "51 steps", found=f"{_STEPS} steps", file="own.radar.h5"):
        reader_of(config, vehicle, radar._replace(steps=51), None)
    with refused("radar.calibration", file="x.run.toml"):
        reader_of(config, vehicle, RadarDescription(_CHANNELS, 369, 0.1, 5.0, 127.5, 1.0 / 126.0), None)
    with refused("radar.look_up", found="true"):
        _config(tmp_path, 'calibration = "own.radar.h5"\nlook_up = true')


def _frames(log: DriveLog, width: int) -> list[Frame]:
    sweeps, calibration, _ = log.read_sweeps(0, log.scans)
    sender, frames = Sender(9), []
    for number, rows in enumerate(np.concatenate([sweeps, calibration[:, None]], axis=1)):
        parts = np.stack([rows.real, rows.imag], axis=-1)
        scale = 1.0 if width == 8 else float(np.abs(parts).max()) / 32767.0
        data = (parts.astype("<f4") if width == 8 else np.round(parts / scale).astype("<i2")).tobytes()
        fields: dict[str, Value] = {"rows": _CHANNELS + 1, "steps": _STEPS, "width": width, "scale": scale}
        fields |= {"scan": number, "valid": 31, "data": data}
        frame = sender.frame("radar_sweep", fields, mode=0, mono_ns=number)
        frames.append(decode(frame))
    return frames


def _reader(log: DriveLog, **changes: int) -> SweepReader:
    known = _recording(log)
    radar = SweepDescription(_CHANNELS, _STEPS, 1e8, 5e6, 12.0, 1.0 / 126.0)._replace(**changes)
    return SweepReader(radar, known, _BLOCK, "socket://radar:1")


@pytest.mark.parametrize(("width", "off"), [(8, 1e-6), (4, 2e-3)])
def test_frames_give_what_the_drive_log_gives(log: DriveLog, width: int, off: float) -> None:
    reader, frames = _reader(log), _frames(log, width)
    blocks = [reader.read(frames[low : low + _BLOCK]) for low in range(0, _SCANS, _BLOCK)]
    recorded, valid = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    offline = next(SweepDrive(log, _recording(log)).blocks(_SCANS))
    # A dead channel is known after the 64 scans by which a drive log is judged too.
    known = np.arange(_SCANS) >= 64
    np.testing.assert_array_equal(valid[known], offline.valid[known])
    assert not valid[_SILENT_SCAN].any()
    assert not valid[known, _DEAD].any()
    living = offline.valid
    level = np.abs(offline.recorded[living]).max()
    assert np.abs(recorded[living] - offline.recorded[living]).max() <= off * level


def test_the_matrices_are_those_of_the_drive_log(log: DriveLog) -> None:
    settings = sweep_chain(_recording(log).frequencies_hz, 0.04)
    operators = _reader(log).operators(settings, 200, 0.3)
    offline = SweepDrive(log, _recording(log)).operator(settings, 200)
    np.testing.assert_allclose(np.asarray(operators(1.0)), np.asarray(offline), atol=1e-7)
    assert np.asarray(operators(1.03)).shape == (2 * _STEPS, 200)


def test_a_scan_of_traces_of_another_size_is_none_and_its_neighbours_are_what_they_were() -> None:
    rng, channels, samples = np.random.default_rng(5), 11, 369
    sender = Sender(9)

    def scan(number: int, channels: int, samples: int) -> Frame:
        data = rng.integers(0, 256, channels * samples, dtype=np.uint8).tobytes()
        fields: dict[str, Value] = {"scan": number, "channels": channels, "samples": samples, "valid": 2047}
        return decode(sender.frame("radar_scan", {**fields, "data": data}, mode=0, mono_ns=number))

    reader = TraceReader(RadarDescription(channels, samples, 0.1, 5.0, 127.5, 1.0 / 126.0))
    good = [scan(number, channels, samples) for number in range(3)]
    other, fewer = scan(3, channels, 368), scan(4, 9, samples)
    # As many bytes as it should have are no proof of its shape.
    turned = scan(5, samples, channels)
    alone, usable = reader.read(good)
    traces, valid = reader.read([good[0], other, good[1], fewer, turned, good[2]])
    assert traces.dtype == np.float32
    assert usable.all()
    np.testing.assert_array_equal(traces[[0, 2, 5]], alone)
    assert valid.all(axis=1).tolist() == valid.any(axis=1).tolist() == [True, False, True, False, False, True]
    assert not traces[[1, 3, 4]].any()
    data = good[0].fields["data"]
    assert isinstance(data, bytes)
    np.testing.assert_array_equal(alone[0].ravel(), np.frombuffer(data, np.uint8).astype(np.float32) - 127.5)


def test_what_does_not_fit_is_one_line_or_no_data(log: DriveLog) -> None:
    with refused("radar_lookup", "(6, 41)", found="(5, 41)"):
        _reader(log, channels=6)
    frame = _frames(log, 4)[0]
    with pytest.raises(ValueError, match=r"\b2\b"):
        complex_rows(frame._replace(fields={**frame.fields, "width": 2}))
    short = frame._replace(fields={**frame.fields, "steps": 20, "data": bytes(6 * 20 * 4)})
    unknown = frame._replace(fields={**frame.fields, "width": 2, "data": bytes(6 * 41 * 2)})
    good = _reader(log).read([frame, frame, frame])
    recorded, valid = _reader(log).read([frame, unknown, frame])
    np.testing.assert_array_equal(recorded[[0, 2]], good[0][[0, 2]])
    assert valid.any(axis=1).tolist() == [True, False, True]
    assert not _reader(log).read([short])[1].any()
    narrow = sweep_chain(np.linspace(8e8, 2e9, 61), 0.04)
    with refused("radar_sweep_description", 950, 1850, found="100 to 300 MHz"):
        _reader(log).operators(narrow, 200, 0.3)
