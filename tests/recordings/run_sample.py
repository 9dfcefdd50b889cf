"""A recorded run made by hand of a generated drive: what a vehicle would have recorded that drove it by itself."""

import json
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from canon.site import Site
from formats.run_log_sample import head_bytes, own_bytes, record_bytes
from lgprjax.formats import DriveLog, MapFile, SweepRecording, TraceRecording

MONO_NS = 10**12
"""Monotonic time of the drive's second 0."""
LEAST_DELAY_S = 0.003

VEHICLE = """
schema = "lgprjax.vehicle"
schema_version = "1.2"
name = "test"
serial_number = "T1"
steering_kind = "counter_steer"
[array]
x_m = {x_m}
height_m = {height_m}
{channels}
"""
CONFIG = """
name = "test"
vehicle = "v.vehicle.toml"
map = "m.map.h5"
routes = ["r.route.toml"]
[ports]
drive_by_wire = { url = "/dev/null" }
controller = { url = "/dev/null" }
gnss = { url = "/dev/null" }
radar = { url = "/dev/null" }
[sensors]
gnss_sigma_m = 0.02
"""
_PORT_IN, _PRIOR, _PLAN = 2, 7, 12
_BOX, _RADAR, _CONTROL = 1, 4, 10


class Sent(NamedTuple):
    """A record of the run and when it came, ns."""

    mono_ns: int
    data: bytes


def frame(kind: int, payload: bytes, *, session: int, sequence: int, stamp_us: int) -> bytes:
    covered = struct.pack("<BBHBBIIQH", 1, kind, len(payload), 3, 0, session, sequence, stamp_us, 0) + payload
    return b"\xa5\x5a" + covered + struct.pack("<I", zlib.crc32(covered))


def record(kind: int, source: int, mono_ns: int, payload: bytes) -> Sent:
    return Sent(mono_ns, struct.pack("<BBHIQ", kind, source, 0, 7, mono_ns) + payload)


def run_of_drive(site: Site, name: str, folder: Path, *, anew: str = "") -> None:
    """Record a drive of the site as a run, with what ``lgprjax recover`` needs beside it.

    Halfway the radar describes itself once more: as before, or with ``anew``: ``description`` or ``look-up``.
    """
    folder.mkdir()
    rng = np.random.default_rng(3)
    with DriveLog.open(site.logs[name]) as log, MapFile.open(site.map) as source:
        sent = [*_radar(log, rng, anew), *_box(log, rng), *_decided(log, source)]
        place = log.description.array
        known, channels = log.description.recording, ""
        if isinstance(known, SweepRecording):
            gain, delay_ns = (list(map(float, part)) for part in known.response)
            channels = f"channel_gain = {gain}\nchannel_delay_ns = {delay_ns}"
        vehicle = VEHICLE.format(x_m=float(np.mean(place.x_m)), height_m=place.height_m, channels=channels)
    sent.sort(key=lambda each: each.mono_ns)
    parts, number = [head_bytes(0, 0, mono_ns=MONO_NS), own_bytes(0, dropped={"control_log": 0})], 1
    for each in sent:
        parts.append(record_bytes(number, each.data))
        number += 1
    parts.append(own_bytes(number, end="ended"))
    (folder / "0000.lgprun").write_bytes(b"".join(parts))
    (folder / "config.toml").write_text(CONFIG)
    original = folder.parent / "CONFIG.toml"
    original.write_text(CONFIG)
    (folder / "run.json").write_text(json.dumps({"config": str(original)}))
    (folder.parent / "v.vehicle.toml").write_text(vehicle)
    (folder.parent / "m.map.h5").symlink_to(site.map)


def _radar(log: DriveLog, rng: np.random.Generator, anew: str) -> list[Sent]:
    """Scans as they come: late by 3 ms or more, stamped by a clock of the radar's own that drifts."""
    told = log.description.recording
    begun = MONO_NS + int(1e9 * log.scan_time_s[0]) - 10**8
    kind, scans = (0x12, _trace_scans(log)) if isinstance(told, TraceRecording) else (0x15, _sweep_scans(log))
    sent = [
        record(_PORT_IN, _RADAR, begun + number, frame(each, payload, session=9, sequence=number, stamp_us=1))
        for number, (each, payload) in enumerate(_describes(log))
    ]
    for scan, (at_s, payload) in enumerate(zip(log.scan_time_s, scans, strict=True)):
        if scan == log.scans // 2:
            for each, described in _describes(log, anew):
                raw = frame(each, described, session=9, sequence=scan, stamp_us=1)
                sent.append(record(_PORT_IN, _RADAR, sent[-1].mono_ns + 1, raw))
        mono_ns = MONO_NS + int(1e9 * at_s)
        stamp_us = 77_000_000 + int((mono_ns - MONO_NS) * (1 + 5e-5)) // 1000
        raw = frame(kind, payload, session=9, sequence=scan + 2, stamp_us=stamp_us)
        late_s = LEAST_DELAY_S + (0.0 if scan % 50 == 0 else rng.exponential(0.002))
        # A line keeps the order.
        arrival_ns = max(mono_ns + int(1e9 * late_s), sent[-1].mono_ns + 1)
        sent.append(record(_PORT_IN, _RADAR, arrival_ns, raw))
    return sent


def _describes(log: DriveLog, anew: str = "") -> list[tuple[int, bytes]]:
    """Types and payloads of what the radar says of itself; ``anew`` with twice the interval, or half the look-up."""
    told = log.description.recording
    longer, lower = 2 if anew == "description" else 1, 0.5 if anew == "look-up" else 1.0
    if isinstance(told, TraceRecording):
        shape, step_ps = (log.channels, log.samples), longer * round(1e3 * told.sample_interval_ns)
        zero_ps, level = round(1e3 * told.time_zero_ns), told.zero_level
        return [(0x14, struct.pack("<HHIifI", *shape, step_ps, zero_ps, level, 7937))]
    hz = told.frequencies_hz
    first_khz, step_khz = round(1e-3 * hz[0]), round(1e-3 * (hz[1] - hz[0]))
    delay_ps = round(1e3 * told.group_delay_ns)
    rows = lower * np.concatenate([told.lookup_sweeps, told.lookup_calibration_sweep[None]])
    return [
        (0x16, struct.pack("<HHIIiI", log.channels, len(hz), first_khz, longer * step_khz, delay_ps, 7937)),
        (0x17, struct.pack("<HHHf", *rows.shape, 8, 1.0) + rows.astype("<c8").tobytes()),
    ]


def _bits(valid: np.ndarray) -> int:
    return int(np.sum(valid.astype(np.int64) << np.arange(len(valid))))


def _trace_scans(log: DriveLog) -> list[bytes]:
    """Payloads of ``radar_scan``."""
    told = log.description.recording
    assert isinstance(told, TraceRecording)
    traces, valid = log.read_traces(0, log.scans)
    samples = np.clip(traces + told.zero_level, 0, 255).astype(np.uint8)
    return [
        struct.pack("<IHHI", scan, *one.shape, _bits(valid[scan])) + one.tobytes() for scan, one in enumerate(samples)
    ]


def _sweep_scans(log: DriveLog) -> list[bytes]:
    """Payloads of ``radar_sweep``, numbers of 8 bytes."""
    sweeps, calibration, valid = log.read_sweeps(0, log.scans)
    rows = np.concatenate([sweeps, calibration[:, None]], axis=1).astype("<c8")
    return [
        struct.pack("<IHHHIf", scan, *one.shape, 8, _bits(valid[scan]), 1.0) + one.tobytes()
        for scan, one in enumerate(rows)
    ]


def _box(log: DriveLog, rng: np.random.Generator) -> list[Sent]:
    """A hundred status frames a second; in the middle the box starts anew and counts from zero."""
    odometry = log.description.odometry
    times = np.arange(odometry.time_s[0], odometry.time_s[-1], 0.01)
    travel = np.interp(times, odometry.time_s, odometry.distance_m)
    middle, sent = len(times) // 2, []
    for number, at_s in enumerate(times):
        anew = number >= middle
        metres = travel[number] - (travel[middle] if anew else 0.0)
        payload = struct.pack("<IBHHfiffBffdf", number, 3, 0, 0, 2.5, number, 12.5, 0.1, 0, 0.25, 0.0, metres, 2.0)
        stamp_us = number * 10_000 + (0 if anew else 5_000_000)
        raw = frame(0x21, payload, session=5 + anew, sequence=number, stamp_us=stamp_us)
        late_ns = int(1e9 * (0.001 + (0.0 if number % 20 == 0 else rng.exponential(0.001))))
        sent.append(record(_PORT_IN, _BOX, MONO_NS + int(1e9 * at_s) + late_ns, raw))
    return sent


def _decided(log: DriveLog, source: MapFile) -> list[Sent]:
    """Priors and plans fifty times a second; the first prior of all is not valid."""
    track, local, odometry = log.description.navigation, source.description.frame, log.description.odometry
    east, north, _ = local.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    yaw = np.unwrap(local.yaw_of_heading(track.heading_deg, track.longitude_deg))
    sent = []
    for number, at_s in enumerate(np.arange(track.time_s[0], track.time_s[-1], 0.02)):
        x_m, y_m, angle = (float(np.interp(at_s, track.time_s, values)) for values in (east, north, yaw))
        roll = float(np.interp(at_s, track.time_s, np.radians(track.roll_deg)))
        mono_ns = MONO_NS + int(1e9 * at_s)
        travel_m, before_m = np.interp([at_s, at_s - 0.02], odometry.time_s, odometry.distance_m)
        speed_mps = (travel_m - before_m) / 0.02
        prior = struct.pack("<qB8d", mono_ns, number > 0, x_m, y_m, angle, roll, 0.001, speed_mps, 0.01, travel_m)
        plan = struct.pack(
            "<BBBII3d6f3fBIB", 4, 1, 2, 3, 4, x_m, y_m, angle, 0.05, 2.0, 2.2, -0.1, 30.0, 0.02, 0.03, 0.2, 0.0, 3, 0, 0
        )
        sent.append(record(_PRIOR, _CONTROL, mono_ns + 10_000, prior))
        if number >= 10:
            sent.append(record(_PLAN, _CONTROL, mono_ns + 20_000, plan))
    return sent
