"""A first drive is recorded without a map: radar, GNSS/INS and odometry of simulated devices, in lock step."""

import json
import os
import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from canon.commands import run, succeed
from canon.map import built_with_many_grounds
from canon.record import Recorded, record, write_record
from cli.processes import ROOT, quick
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, NavigationTrack, VehicleLog, read_run
from lgprjax.frames import along_cross
from lgprjax.mapping import open_route, waypoints_of
from lgprjax.run_records import RecordKind, Source, unpack
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.drive_log import drive_of_run
from lgprjax.simulation.drives import SITE_FRAME
from refusals import refused


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Twenty-five seconds by hand at two metres per second."""
    return record(tmp_path_factory.mktemp("record"), 25.0)


def errors_of(run: Recorded, track: NavigationTrack) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors of poses against the simulated vehicle: along, across in metres, heading in degrees."""
    clock = read_run(run.folder).clock
    assert clock is not None
    at_ns = clock[1] + 1e9 * track.time_s
    east, north, _ = SITE_FRAME.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    yaw = SITE_FRAME.yaw_of_heading(track.heading_deg, track.longitude_deg)
    with np.load(run.folder / "truth.npz") as truth:
        x, y, turned = (
            np.interp(at_ns, truth["mono_ns"], values)
            for values in (truth["x_m"], truth["y_m"], np.unwrap(truth["yaw_rad"]))
        )
    along, across = along_cross(east - x, north - y, turned)
    return along, across, np.degrees((yaw - turned + np.pi) % (2.0 * np.pi) - np.pi)


def test_the_recording_is_a_sound_drive_log_close_to_the_truth(recorded: Recorded) -> None:
    succeed("check", recorded.drive)
    with DriveLog.open(recorded.drive) as log:
        along, across, heading_deg = errors_of(recorded, log.description.navigation)
        travel_m = np.ptp(log.description.odometry.distance_m)
        assert log.scans > 450
        assert log.description.array.x_m.mean() == pytest.approx(6.2)
    # RTK with 1 cm of white noise; the INS heading wanders by a tenth of a degree.
    assert np.sqrt(np.mean(across**2)) < 0.025
    assert np.sqrt(np.mean(along**2)) < 0.025
    assert np.abs(heading_deg).max() < 0.5
    assert travel_m == pytest.approx(46.0, abs=3.0)


def test_nothing_was_sent_to_the_vehicle(recorded: Recorded) -> None:
    sent = [unpack(data) for _, data in read_run(recorded.folder)]
    sent = [record for record in sent if record.kind is RecordKind.PORT_OUT]
    assert {record.source for record in sent} == {Source.RADAR}


def test_its_run_folder_is_a_map_with_a_route(recorded: Recorded, tmp_path: Path) -> None:
    database = tmp_path / "first.map.h5"
    assert str(recorded.drive) in recorded.said
    with built_with_many_grounds():
        succeed("map", "build", recorded.folder, "-o", database)
    (route,) = json.loads(succeed("route", "list", database, "--json", "-"))["routes"]
    assert route["route"] == "record"
    # A drive that began at standstill has no kink there.
    vehicle = ROOT / "onboard" / "made_up.vehicle.toml"
    said = succeed("route", "select", database, "record", "--vehicle", vehicle, "-o", tmp_path / "first.route.toml")
    assert re.search(r"\d+\.\d m", said)


def test_its_run_folder_is_a_route_without_a_map(recorded: Recorded, tmp_path: Path) -> None:
    vehicle = ROOT / "onboard" / "made_up.vehicle.toml"
    (listed,) = json.loads(succeed("route", "list", recorded.folder, "--json", "-"))["routes"]
    assert (listed["route"], listed["ends_where_it_began"]) == ("record", False)
    whole, length_m = tmp_path / "whole.route.toml", listed["length_m"]
    succeed("route", "select", recorded.folder, "record", "--vehicle", vehicle, "-o", whole)
    for suffix in ("csv", "gpx", "geojson"):
        succeed("route", "export", whole, "-o", tmp_path / f"w.{suffix}")
        name = "w" if suffix == "csv" else "record"
        again = tmp_path / f"{suffix}.route.toml"
        succeed("route", "select", tmp_path / f"w.{suffix}", name, "--vehicle", vehicle, "-o", again)
        places = []
        for route in (whole, again):
            _, laid, source = open_route(route)
            points = waypoints_of(laid, source)
            level = np.zeros(len(points.leg))
            places.append(np.stack(SITE_FRAME.to_local(points.latitude_deg, points.longitude_deg, level)[:2], axis=1))
        away = np.hypot(*(places[1][:, None] - places[0][None]).transpose(2, 0, 1)).min(axis=1)
        # Each within half a spacing of a point of the other.
        assert away.max() < 0.13
        assert len(places[0]) == pytest.approx(len(places[1]), abs=1)

    # Stretches join to the whole in their order, and in no other.
    for name, bounds in (("a", (0.0, 15.0)), ("b", (15.0, length_m))):
        limits = ("--from-m", bounds[0], "--to-m", bounds[1])
        succeed("route", "select", recorded.folder, "record", *limits, "-o", tmp_path / f"{name}.route.toml")
    parts = [tmp_path / f"{name}.route.toml" for name in ("a", "b")]
    assert "2 routes" in succeed("route", "export", *parts, "-o", tmp_path / "joined.gpx")
    (joined,) = json.loads(succeed("route", "list", tmp_path / "joined.gpx", "--json", "-"))["routes"]
    assert joined["length_m"] == pytest.approx(length_m, abs=0.3)
    refusal = run("route", "export", *reversed(parts), "-o", tmp_path / "wrong.gpx").refusal
    refusal.check("start", 10, 45, file=parts[0])
    assert not (tmp_path / "wrong.gpx").exists()


def test_a_drive_by_gnss_alone_records_a_baseline(tmp_path: Path) -> None:
    """No map: the simulated course gives waypoints, the vehicle drives them, and its radar's scans are kept."""
    text = (ROOT / "onboard" / "gnss.run.toml").read_text(encoding="utf-8")
    text = text.replace('"front_steer.vehicle.toml"', f'"{ROOT / "onboard" / "front_steer.vehicle.toml"}"')
    text = text.replace("length_m = 150.0", "length_m = 60.0").replace("../out/onboard/", "")
    radar = 'radar = { url = "socket://127.0.0.1:1" }\n[radar]\nchannel_pitch_m = 0.127\n'
    text = text.replace("[sensors]", f"{radar}[sensors]")
    config = quick(text, tmp_path / "gnss.run.toml")
    figures = json.loads(succeed("run", config, "--simulate", "--lockstep", "--for-s", 90, "--json", "-"))
    assert figures["tracking_rms_m"] < 0.10
    assert figures["searched"] == 0
    (folder,) = (tmp_path / "runs").iterdir()
    with DriveLog.open(folder / "gnss.drive.h5") as log:
        assert log.scans > 300
        plan = log.description.plan
        assert plan is not None
        assert np.abs(plan["cross_track_m"][plan["speed_mps"] > 3.0]).max() < 0.3048
    (route,) = json.loads(succeed("route", "list", folder, "--json", "-"))["routes"]
    assert route["length_m"] > 50.0


def test_what_was_recorded_before_a_power_cut_is_kept(recorded: Recorded, tmp_path: Path) -> None:
    cut = tmp_path / "cut"
    shutil.copytree(recorded.folder, cut)
    (cut / "record.drive.h5").unlink()
    segment = sorted(cut.glob("*.lgprun"))[-1]
    whole = segment.read_bytes()
    segment.write_bytes(whole[: len(whole) // 2])
    succeed("recover", cut, "-o", tmp_path / "saved.drive.h5")
    with DriveLog.open(tmp_path / "saved.drive.h5") as saved, DriveLog.open(recorded.drive) as log:
        assert 0.4 < saved.scans / log.scans < 0.6


def test_its_events_ask_for_no_drive(recorded: Recorded) -> None:
    events = json.loads(succeed("events", recorded.folder, "--json", "-"))
    assert (events["shortfall"], events["engaged"], events["end"]) == (None, False, "ended")


def test_it_has_no_commands_to_replay(recorded: Recorded) -> None:
    done = run("run", recorded.folder / "simulated.run.toml", "--replay", recorded.folder)
    assert done.status == 1
    done.refusal.check("mode", "drive", found="record")


def test_without_ins_and_radar_there_are_tracks(tmp_path: Path) -> None:
    """Positions alone give headings once the vehicle moves; without radar it is a log for calibration."""
    changes = (
        ('radar = { url = "socket://127.0.0.1:1" }\n', ""),
        ("script = [", 'faults = [{ at_s = 0.0, kind = "ins_off", for_s = 1000.0 }]\nscript = ['),
    )
    made = record(tmp_path, 20.0, *changes)
    log = VehicleLog.open(made.drive)
    along, across, heading_deg = errors_of(made, log.navigation)
    assert np.sqrt(np.mean(along**2)) < 0.04
    assert np.sqrt(np.mean(across**2)) < 0.04
    assert np.sqrt(np.mean(heading_deg**2)) < 4.0


@pytest.mark.parametrize(
    ("changes", "place", "named"),
    [
        ([('mode = "record"', 'mode = "record"\nmap = "x.map.h5"')], "map, routes, coverage", "record"),
        ([("gnss = {", "# gnss = {"), ("radar = {", "# radar = {")], "ports", "gnss or radar"),
        ([('mode = "record"', 'mode = "drive"')], "map, routes, coverage", "routes"),
        ([('mode = "record"', 'mode = "drive"'), ("controller = {", "# controller = {")], "ports.controller", "record"),
    ],
    ids=["map", "lines", "drive", "controller"],
)
def test_configurations_say_what_their_mode_needs(
    tmp_path: Path, changes: list[tuple[str, str]], place: str, named: str
) -> None:
    with refused(place, named, file="record.run.toml"):
        read_config(write_record(tmp_path, *changes))


def test_channels_of_unknown_spacing_are_no_drive(recorded: Recorded, tmp_path: Path) -> None:
    config: RuntimeConfig = read_config(recorded.folder / "simulated.run.toml")
    unknown = config.model_copy(update={"radar": config.radar.model_copy(update={"channel_pitch_m": None})})
    with pytest.raises(InputError) as error:
        drive_of_run(read_run(recorded.folder), unknown, tmp_path / "x.drive.h5")
    assert "channel_pitch_m" in error.value.expected
    assert not (tmp_path / "x.drive.h5").exists()


def test_a_run_that_still_records_is_no_baseline_yet(recorded: Recorded, tmp_path: Path) -> None:
    """Its drive log would hold a part of it, and later maps would use that."""
    running = tmp_path / "running"
    shutil.copytree(recorded.folder, running)
    segment = sorted(running.glob("*.lgprun"))[-1]
    segment.write_bytes(segment.read_bytes()[: 3 * segment.stat().st_size // 4])
    # However busy the machine is, the recorder wrote just now.
    soon = time.time() + 600.0
    os.utime(segment, (soon, soon))
    done = run("map", "build", running, "-o", tmp_path / "m.map.h5")
    assert done.status == 1
    done.refusal.check("run", file=running)
    long_ago = time.time() - 60.0
    os.utime(running / "record.drive.h5", (long_ago - 60.0, long_ago - 60.0))
    os.utime(segment, (long_ago, long_ago))
    with DriveLog.open(running / "record.drive.h5") as log:
        before = log.scans
    run("map", "build", running, "-o", tmp_path / "m.map.h5", "--travel-time-ns", "2")
    # Whatever becomes of the map: the log is that of the records that are there.
    with DriveLog.open(running / "record.drive.h5") as log:
        assert log.scans < before


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (("channel_pitch_m = 0.127", "# channel_pitch_m = 0.127"), "radar.channel_pitch_m"),
        (("x.vehicle.toml", "nowhere.vehicle.toml"), None),
    ],
    ids=["pitch", "vehicle"],
)
def test_what_a_drive_log_needs_is_asked_before_the_drive(
    tmp_path: Path, change: tuple[str, str], place: str | None
) -> None:
    vehicle = str(ROOT / "onboard" / "record.vehicle.toml")
    old = change[0] if place else vehicle
    done = run("run", write_record(tmp_path, (old, change[1])), "--simulate", "--lockstep", "--for-s", 5)
    assert done.status == 1
    assert place is None or done.refusal.place == place
    assert not (tmp_path / "runs").exists()
