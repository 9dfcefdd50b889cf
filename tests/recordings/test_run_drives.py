"""Recorded runs as drive logs: what was recorded stands in them, and they are used like any other."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from canon.map import of_many_grounds
from canon.site import Site
from formats.run_log_sample import head_bytes, record_bytes
from lgprjax.batch import register_log
from lgprjax.formats import (
    DriveLog,
    MapFile,
    SweepRecording,
    TraceRecording,
    VehicleFile,
    VehicleLog,
    check_file,
    read_run,
    read_vehicle,
)
from lgprjax.mapping import build_map
from lgprjax.recordings import write_run_drive
from lgprjax.recordings.run_signals import device_times, rising, signals_of_run
from lgprjax.registration import RegisterOptions
from recordings.run_sample import LEAST_DELAY_S, MONO_NS, frame, record, run_of_drive
from recordings.sweep_drives import write_sweeps
from refusals import refused

_DRIVE = "live"


@pytest.fixture(scope="module")
def run(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "recorded"
    run_of_drive(site, _name(site), folder)
    return folder


@pytest.fixture(scope="module")
def vehicle(run: Path) -> VehicleFile:
    return read_vehicle(run.parent / "v.vehicle.toml")


@pytest.fixture(scope="module")
def recovered(site: Site, run: Path, vehicle: VehicleFile) -> Path:
    path = run.parent / "recovered.drive.h5"
    with MapFile.open(site.map) as source:
        made = write_run_drive(run, path, source=source, vehicle=vehicle, position_sigma_m=0.02)
    with DriveLog.open(site.logs[_name(site)]) as log:
        assert log.scans - 20 <= made.scans <= log.scans
        assert made.scans + made.left_out == log.scans
    return path


def _name(site: Site) -> str:
    return next(name for name in site.logs if name.startswith(_DRIVE))


def test_scans_come_back(site: Site, recovered: Path) -> None:
    assert check_file(recovered) == []
    with DriveLog.open(site.logs[_name(site)]) as due, DriveLog.open(recovered) as found:
        # Scans at both ends, where nothing tells the place, are left out.
        first = int(np.argmin(np.abs(due.scan_time_s + LEAST_DELAY_S - found.scan_time_s[0])))
        last = first + found.scans
        np.testing.assert_allclose(found.scan_time_s, due.scan_time_s[first:last] + LEAST_DELAY_S, atol=1e-3)
        traces, valid = found.read_traces(0, found.scans)
        due_traces, due_valid = due.read_traces(first, last)
        np.testing.assert_array_equal(traces, due_traces)
        np.testing.assert_array_equal(valid, due_valid)
        one, other = found.description.recording, due.description.recording
        assert isinstance(one, TraceRecording)
        assert isinstance(other, TraceRecording)
        assert (one.sample_interval_ns, one.time_zero_ns) == pytest.approx(
            (other.sample_interval_ns, other.time_zero_ns), abs=1e-3
        )
        assert one.centre_frequency_hz == pytest.approx(other.centre_frequency_hz)
        np.testing.assert_allclose(found.description.array.y_m, due.description.array.y_m, atol=1e-9)
        np.testing.assert_allclose(
            found.description.array.time_offset_s, due.description.array.time_offset_s, atol=1e-6
        )


def test_the_track_comes_back(site: Site, recovered: Path) -> None:
    with DriveLog.open(site.logs[_name(site)]) as log:
        due = log.description
    found = VehicleLog.open(recovered)
    assert found.t0_utc == "2027-01-15T08:00:00+00:00"
    assert found.serial_number == "T1"
    at = found.navigation.time_s
    for name, per_m in (("latitude_deg", 111_000.0), ("longitude_deg", 82_000.0), ("roll_deg", 1.0)):
        values = np.interp(at, due.navigation.time_s, getattr(due.navigation, name))
        np.testing.assert_allclose(getattr(found.navigation, name) * per_m, values * per_m, atol=1e-3)
    heading = np.interp(at, due.navigation.time_s, np.unwrap(due.navigation.heading_deg, period=360.0))
    np.testing.assert_allclose((found.navigation.heading_deg - heading + 180.0) % 360.0 - 180.0, 0.0, atol=1e-3)
    # The map's ground and the live drive's height differ by what GNSS is wrong by.
    height = np.interp(at, due.navigation.time_s, due.navigation.height_m)
    assert np.max(np.abs(found.navigation.height_m - height)) < 0.3
    assert found.navigation.sigma_east_m is not None
    assert set(found.navigation.sigma_east_m) == {0.02}
    # One distance, although the box counted anew.
    travel = np.interp(found.odometry.time_s, due.odometry.time_s, due.odometry.distance_m)
    np.testing.assert_allclose(found.odometry.distance_m, travel, atol=0.05)


def test_signals_and_decisions_of_the_vehicle_come_back(recovered: Path) -> None:
    log = VehicleLog.open(recovered)
    signals = log.vehicle
    assert signals is not None
    assert 95 < 1.0 / np.median(np.diff(signals["time_s"])) < 105
    for name, value in (
        ("steering_potentiometer_v", 2.5),
        ("supply_v", 12.5),
        ("wheel_angle_rad", 0.02),
        ("steering_command_rad", 0.03),
        ("throttle", 0.2),
        ("brake", 0.0),
        ("yaw_rate_radps", 0.01),
        ("mode", 4),
    ):
        np.testing.assert_allclose(signals[name], value, rtol=1e-6)
    assert np.all(np.diff(signals["encoder_counts"]) >= 1)
    assert log.plan is not None
    due = {
        **{"sigma_cross_m": 0.05, "speed_mps": 2.0, "wanted_mps": 2.2, "cross_track_m": -0.1, "to_go_m": 30.0},
        **{"code": 2, "reaction": 1},
    }
    for name, value in due.items():
        np.testing.assert_allclose(log.plan[name], value, rtol=1e-6)
    # Driven by the same pose that navigation had.
    for name in ("latitude_deg", "longitude_deg"):
        known = np.interp(log.plan["time_s"], log.navigation.time_s, getattr(log.navigation, name))
        np.testing.assert_allclose(log.plan[name], known, atol=1e-8)


def test_it_registers_like_the_drive_itself_and_makes_a_map(site: Site, recovered: Path, tmp_path: Path) -> None:
    with MapFile.open(site.map) as source, DriveLog.open(recovered) as log:
        found = register_log(source, log, RegisterOptions(search_m=1.5))
    with DriveLog.open(site.logs[_name(site)]) as log:
        truth = log.description.truth
    assert truth is not None
    good = found.table[found.table["code"] == "ok"]
    assert len(good) > 0.6 * len(found.table)
    # The array's centre is 3 m before the rear axle, whose true place the simulator knows.
    east = (good["longitude_deg"] - np.interp(good["time_s"], truth.time_s, truth.longitude_deg)) * 82_600.0
    north = (good["latitude_deg"] - np.interp(good["time_s"], truth.time_s, truth.latitude_deg)) * 111_080.0
    yaw = np.radians(90.0 - np.interp(good["time_s"], truth.time_s, np.unwrap(truth.heading_deg, period=360.0)))
    along = east * np.cos(yaw) + north * np.sin(yaw)
    cross = north * np.cos(yaw) - east * np.sin(yaw)
    assert abs(np.median(along) - 3.0) < 0.1
    assert abs(np.median(cross)) < 0.1
    build_map([recovered], tmp_path / "again.map.h5", measure=of_many_grounds)
    assert check_file(tmp_path / "again.map.h5") == []


@pytest.mark.parametrize("anew", ["description", "look-up"])
def test_scans_of_another_description_are_left_out(site: Site, anew: str, tmp_path: Path) -> None:
    """Halfway the radar starts with another interval, or with a look-up taken anew: as many samples, other ground."""
    name, path = _name(site), tmp_path / "a.drive.h5"
    if anew == "look-up":
        write_sweeps(site.logs[name], tmp_path / "sweeps.drive.h5", 5, scans=200)
        site = site._replace(logs={name: tmp_path / "sweeps.drive.h5"})
    run_of_drive(site, name, tmp_path / "run", anew=anew)
    vehicle = read_vehicle(tmp_path / "v.vehicle.toml")
    with MapFile.open(site.map) as source, DriveLog.open(site.logs[name]) as due:
        made = write_run_drive(tmp_path / "run", path, source=source, vehicle=vehicle, position_sigma_m=0.02)
        half = due.scans // 2
        assert half - 20 <= made.scans <= half
        assert made.left_out == due.scans - made.scans
        with DriveLog.open(path) as found:
            assert found.scan_time_s[-1] == pytest.approx(due.scan_time_s[half - 1] + LEAST_DELAY_S, abs=1e-3)
            one, other = found.description.recording, due.description.recording
        if isinstance(one, TraceRecording) and isinstance(other, TraceRecording):
            assert one.sample_interval_ns == pytest.approx(other.sample_interval_ns, abs=1e-3)
        else:
            assert isinstance(one, SweepRecording)
            assert isinstance(other, SweepRecording)
            np.testing.assert_allclose(one.lookup_sweeps, other.lookup_sweeps, rtol=1e-6)
    assert check_file(path) == []


def test_a_run_without_scans(site: Site, run: Path, vehicle: VehicleFile, tmp_path: Path) -> None:
    folder = _only(run, tmp_path / "run", lambda data: data[1] != 4)
    path = tmp_path / "a.drive.h5"
    with MapFile.open(site.map) as source:
        assert write_run_drive(folder, path, source=source, vehicle=vehicle, position_sigma_m=0.1).scans == 0
    assert check_file(path) == []
    assert VehicleLog.open(path).vehicle is not None


def test_without_places_or_an_array_nothing_is_made(
    site: Site, run: Path, vehicle: VehicleFile, tmp_path: Path
) -> None:
    path = tmp_path / "a.drive.h5"
    with MapFile.open(site.map) as source:
        for name, kept, place in (
            ("priors", lambda data: data[0] != 7, "prior"),
            ("box", lambda data: data[1] != 1, "drive_status"),
        ):
            folder = _only(run, tmp_path / name, kept)
            with refused(None, place):
                write_run_drive(folder, path, source=source, vehicle=vehicle, position_sigma_m=0.1)
        bare = vehicle.model_copy(update={"array": type(vehicle.array)()})
        with refused(None, "x_m", "height_m"):
            write_run_drive(run, path, source=source, vehicle=bare, position_sigma_m=0.1)
    assert not path.exists()


def test_times_of_a_device() -> None:
    rng = np.random.default_rng(1)
    true_ns = MONO_NS + np.arange(6000, dtype=np.int64) * 10_000_000
    arrival_ns = true_ns + 2_000_000 + (rng.exponential(3e6, 6000)).astype(np.int64)
    session = np.repeat([4, 9], 3000)
    start_us = np.where(session == 4, 123, 2**40)
    stamp_us = (start_us + (true_ns - MONO_NS) * (1 - 1e-4) // 1000).astype(np.int64)
    found = device_times(session, stamp_us, arrival_ns)
    assert np.all(found <= arrival_ns)
    # Late by the line's least delay, whatever clock and drift.
    assert np.max(np.abs(found - true_ns - 2_000_000)) < 1_200_000
    assert list(rising(np.array([3, 1, 4, 4, 9, 5, 10]), np.array([1, 1, 1, 1, 0, 1, 1], bool))) == [
        *(True, False, True, False),
        *(False, True, True),
    ]


def test_pedals_act_when_the_box_says_that_it_has_taken_their_command(tmp_path: Path) -> None:
    """Sent by the 20 ms, taken 30 ms later; a control process that is started anew counts from zero again."""
    sent, told, taken = [], [], []
    for tick in range(300):
        now_ns = MONO_NS + tick * 10**7
        number = (tick // 2) % 90
        if tick % 2 == 0:
            pedals = struct.pack("<fffB", 0.1, 0.001 * tick, 0.0005 * tick, 3)
            raw = frame(0x20, pedals, session=8 + tick // 180, sequence=number, stamp_us=tick * 10_000)
            sent.append(record(3, 1, now_ns + 1, raw))
        has = tick // 2 * 2 - 4 if tick >= 4 else None
        taken.append(np.nan if has is None else 0.001 * has)
        number = 7777 if has is None else (has // 2) % 90
        payload = struct.pack("<IBHHfiffBffdf", number, 3, 0, 0, 2.5, tick, 12.5, 0.1, 0, 0.25, 0.0, 0.01 * tick, 1.0)
        told.append(record(2, 1, now_ns, frame(0x21, payload, session=5, sequence=tick, stamp_us=tick * 10_000)))
    folder = tmp_path / "run"
    folder.mkdir()
    parts = [head_bytes(0, 0, mono_ns=MONO_NS)]
    for number, each in enumerate(sorted([*sent, *told], key=lambda each: each.mono_ns)):
        parts.append(record_bytes(number, each.data))
    (folder / "0000.lgprun").write_bytes(b"".join(parts))
    found = signals_of_run(read_run(folder))
    np.testing.assert_allclose(found.pedals, np.outer(taken, [1.0, 0.5]), rtol=1e-6)


def _only(run: Path, folder: Path, kept: Callable[[bytes], bool]) -> Path:
    """The run with those records only whose bytes are wanted."""
    folder.mkdir()
    parts = [head_bytes(0, 0, mono_ns=MONO_NS)]
    parts += [record_bytes(number, data) for number, data in read_run(run) if kept(data)]
    (folder / "0000.lgprun").write_bytes(b"".join(parts))
    return folder
