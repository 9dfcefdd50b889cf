"""The corrected position as NMEA: read by pynmeagps, and followed by a process that knows nothing else."""

import io
import json
import math
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from pynmeagps import NMEAReader

from lgprjax.formats import MapFile
from lgprjax.frames import LocalFrame
from lgprjax.navigation import OF_GNSS, Reason
from lgprjax.run_records import POSE, Record, RecordKind, Source, pack
from lgprjax.runtime.config import OutputTable, PortTable, RuntimeConfig, read_config, write_config
from lgprjax.runtime.control.compiled import TickResult
from lgprjax.runtime.control.counter_steer import pose_row, quality_of
from lgprjax.runtime.main import process_command
from lgprjax.runtime.output.nmea import Given, NmeaOutlets, given_of, horizontal_covariance, sentences
from lgprjax.runtime.output.program import ADDRESS_FILE
from lgprjax.runtime.process import RINGS, Heartbeats
from lgprjax.runtime.ring import Ring
from lgprjax.runtime.service import SUPERVISOR
from runtime.line_ends import pty_line, read_now

_METRES_A_DEGREE = 111_320.0


def _read(data: bytes) -> dict[str, object]:
    found = {}
    for line in data.splitlines(keepends=True):
        message = NMEAReader.parse(line)
        found[message.msgID] = message
    return found


@pytest.mark.parametrize("heading_deg", [30.0, 200.0])
def test_the_covariance_is_the_ellipse_turned_from_the_heading(heading_deg: float) -> None:
    """By a matrix: the heading is clockwise from north, and across it lies to its right."""
    given = Given(1.8e9, 42.0, -71.0, 30.0, heading_deg, 0.5, 0.02, 4)
    ahead = np.array([np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))])
    across = np.array([ahead[1], -ahead[0]])
    expected = 0.5**2 * np.outer(ahead, ahead) + 0.02**2 * np.outer(across, across)
    ee, en, nn = horizontal_covariance(given)
    np.testing.assert_allclose([[ee, en], [en, nn]], expected, atol=1e-12)


def test_a_client_too_many_is_turned_away_and_the_others_go_on(config: RuntimeConfig) -> None:
    outlets = NmeaOutlets(config, OutputTable(nmea_port=0))
    assert outlets.address is not None
    clients = []
    try:
        for _ in range(9):
            clients.append(socket.create_connection(outlets.address, timeout=5.0))
            outlets.send(b"one\n", 0.0)
        outlets.send(b"two\n", 0.0)
        heard = [client.recv(100) for client in clients]
        assert heard[8] == b""
        outlets.send(b"later\n", 0.0)
        assert all(client.recv(100).endswith(b"later\n") for client in clients[:8])
    finally:
        for client in clients:
            client.close()
        outlets.close()


def test_a_reader_of_receivers_reads_it() -> None:
    rng = np.random.default_rng(1)
    for number in range(10):
        latitude, longitude = rng.uniform(-89.0, 89.0), rng.uniform(-180.0, 180.0)
        if number % 4 == 0:
            # Minutes that round to 60, and degrees of few digits.
            latitude, longitude = math.floor(latitude) + 1.0 - 1e-11, rng.uniform(-1.0, 1.0)
        heading = 359.9997 if number % 5 == 0 else rng.uniform(0.0, 360.0)
        along, cross = rng.uniform(0.005, 3.0, 2)
        height = rng.uniform(-400.0, 8000.0)
        given = Given(1.8e9 + rng.uniform(0.0, 86400.0), latitude, longitude, height, heading, along, cross, 4)
        found = _read(sentences(given))
        gga, hdt, gst = (found[name] for name in ("GGA", "HDT", "GST"))
        assert abs(gga.lat - latitude) * _METRES_A_DEGREE < 0.001  # type: ignore[attr-defined]
        assert abs(gga.lon - longitude) * _METRES_A_DEGREE < 0.001  # type: ignore[attr-defined]
        assert (gga.quality, gga.alt) == (4, pytest.approx(height, abs=6e-4))  # type: ignore[attr-defined]
        seconds = gga.time.hour * 3600 + gga.time.minute * 60 + gga.time.second + 1e-6 * gga.time.microsecond  # type: ignore[attr-defined]
        assert abs((seconds - given.utc_s + 43200.0) % 86400.0 - 43200.0) < 0.006
        assert abs((hdt.headingT - heading + 180.0) % 360.0 - 180.0) < 6e-4  # type: ignore[attr-defined]
        assert 0.0 <= hdt.headingT < 360.0  # type: ignore[attr-defined]
        # The variance of north by turning the ellipse, east likewise.
        turned = math.radians(heading)
        north = math.sqrt((along * math.cos(turned)) ** 2 + (cross * math.sin(turned)) ** 2)
        east = math.sqrt((along * math.sin(turned)) ** 2 + (cross * math.cos(turned)) ** 2)
        assert gst.stdLat == pytest.approx(north, abs=6e-4)  # type: ignore[attr-defined]
        assert gst.stdLong == pytest.approx(east, abs=6e-4)  # type: ignore[attr-defined]
        assert gst.stdMajor == pytest.approx(max(along, cross), abs=6e-4)  # type: ignore[attr-defined]


def test_a_serial_line_gives_the_same_and_holds_nobody_up(config: RuntimeConfig) -> None:
    """Read by pynmeagps at the other end of a pseudo-terminal; one that nobody reads, or that goes, costs moments."""
    given = [
        Given(1.8e9 + 0.1 * number, 42.0, -71.0 + 1e-6 * number, 30.0, 10.0, 0.02, 0.02, 4) for number in range(20)
    ]
    with pty_line() as line:
        outlets = NmeaOutlets(config, OutputTable(nmea_serial=PortTable(url=line.path, baud=115200)))
        try:
            for each in given:
                outlets.send(sentences(each), each.utc_s)
            reader = NMEAReader(io.BytesIO(read_now(line.fd)))
            messages = [message for _, message in reader]
            assert [message.msgID for message in messages] == ["GGA", "HDT", "GST"] * len(given)
            places = [message.lon for message in messages[::3]]
            np.testing.assert_allclose(places, [each.longitude_deg for each in given], atol=1e-8)
            begun_s = time.monotonic()
            for number in range(40):
                outlets.send(sentences(given[0]), 3e9 + number)
            # Full after some kilobytes; then each further moment waits for the write's limit at most.
            assert time.monotonic() - begun_s < 40 * 0.05 + 2.0
        finally:
            outlets.close()
    # Nothing is there any more: told as nothing, and tried again later.
    gone = NmeaOutlets(config, OutputTable(nmea_serial=PortTable(url=line.path, baud=115200)))
    gone.send(sentences(given[0]), 0.0)
    gone.close()


def test_no_position_is_said_to_be_none() -> None:
    given = Given(1.8e9, 42.0, -71.0, 30.0, 10.0, 0.02, 0.02, 4)
    for broken in (
        given._replace(quality=0),
        given._replace(latitude_deg=math.nan),
        given._replace(sigma_cross_m=math.inf),
    ):
        found = _read(sentences(broken))
        assert found["GGA"].quality == 0  # type: ignore[attr-defined]
        assert found["GGA"].lat == ""  # type: ignore[attr-defined]
        assert found["HDT"].headingT == ""  # type: ignore[attr-defined]


def _result(**values: float) -> TickResult:
    usual = TickResult(*[0.0] * len(TickResult._fields))
    return usual._replace(**{"sigma_along_m": 0.03, "sigma_cross_m": 0.02, **values})


def test_the_quality_is_no_better_than_what_bounds_the_error() -> None:
    qualities: list[tuple[dict[str, float], int]] = [
        ({}, 4),
        ({"reasons": float(Reason.GNSS_SILENT), "bounded": 1.0}, 4),
        ({"reasons": float(Reason.GNSS_SILENT)}, 5),
        ({"sigma_along_m": 0.2}, 5),
        ({"sigma_along_m": 0.6}, 6),
        ({"reasons": float(Reason.CONFLICT), "bounded": 0.0}, 6),
        ({"reasons": float(OF_GNSS | Reason.POSITION_LOST)}, 6),
        ({"sigma_cross_m": math.nan}, 0),
        ({"fused_x_m": math.inf}, 0),
    ]
    for values, quality in qualities:
        assert quality_of(_result(**values)) == quality, values


def test_the_position_is_that_of_the_antenna() -> None:
    row = np.frombuffer(pose_row(_result(fused_x_m=5.0, fused_yaw_rad=math.pi / 2), 7, 3.0, (2.0, 0.5)), POSE)[0]
    np.testing.assert_allclose(row["pose"], [4.5, 2.0, math.pi / 2], atol=1e-6)


def test_the_height_given_is_above_the_ellipsoid() -> None:
    anchor_m = 500.0
    frame = LocalFrame(48.0, 11.0, anchor_m)
    # An antenna 1.2 m above the anchor's height and a kilometre away, as the control loop has it.
    truth = (48.008, 11.006, anchor_m + 1.2)
    x, y, up = (float(each[0]) for each in frame.to_local(*(np.array([each]) for each in truth)))
    result = _result(fused_x_m=x, fused_y_m=y, fused_yaw_rad=0.5)
    row = np.frombuffer(pose_row(result, 7, up, (0.0, 0.0)), POSE)[0]
    given = given_of(row, frame, 1.8e9)
    assert given.height_m == pytest.approx(truth[2], abs=0.001)
    assert (given.latitude_deg, given.longitude_deg) == pytest.approx(truth[:2], abs=1e-8)
    assert f",{truth[2]:.3f},M,,M,," in sentences(given).decode()
    unknown = given_of(np.frombuffer(pose_row(result, 7, math.nan, (0.0, 0.0)), POSE)[0], frame, 1.8e9)
    assert math.isnan(unknown.height_m)
    assert (unknown.latitude_deg, unknown.longitude_deg) == pytest.approx(truth[:2], abs=1e-7)
    assert _read(sentences(unknown))["GGA"].quality == 0  # type: ignore[attr-defined]


_FOLLOWER = """
import json, socket, sys
from pynmeagps import NMEAReader
host, port = sys.argv[1].split(":")
seen = []
with socket.create_connection((host, int(port)), timeout=20.0) as line:
    reader = NMEAReader(line)
    heading = sigma = None
    while len(seen) < 12:
        _, message = reader.read()
        if message.msgID == "GGA":
            place = (message.lat, message.lon, message.quality, message.alt)
        elif message.msgID == "HDT":
            heading = message.headingT
        elif message.msgID == "GST":
            seen.append((*place, heading, message.stdLat))
print(json.dumps(seen))
"""


def test_a_process_that_only_knows_nmea_follows(config: RuntimeConfig, tmp_path: Path) -> None:
    file, rings = tmp_path / "output.run.toml", tmp_path / "rings"
    rings.mkdir()
    write_config(file, config.model_copy(update={"output": OutputTable(nmea_port=0)}))
    Heartbeats(rings)
    for name, size in RINGS.items():
        Ring.create(rings / name, size)
    poses = Ring(rings / "poses")
    command = process_command("output", read_config(file), rings, tmp_path, False)
    sent: list[tuple[float, float, float]] = []
    with subprocess.Popen(command, env={**os.environ, SUPERVISOR: str(os.getpid())}) as process:
        try:
            address, given_up_s = rings / ADDRESS_FILE, time.monotonic() + 60.0
            while not address.exists() and time.monotonic() < given_up_s:
                time.sleep(0.05)
            where = address.read_text(encoding="ascii")
            with subprocess.Popen([sys.executable, "-c", _FOLLOWER, where], stdout=subprocess.PIPE, text=True) as other:
                began_s = time.monotonic()
                while other.poll() is None and time.monotonic() - began_s < 40.0:
                    x, y, yaw = 0.4 * len(sent), 0.1 * len(sent), 0.01 * len(sent)
                    result = _result(fused_x_m=x, fused_y_m=y, fused_yaw_rad=yaw)
                    payload = pose_row(result, time.monotonic_ns(), 30.0, (0.0, 0.0))
                    poses.put(pack(Record(RecordKind.POSE, Source.CONTROL, 1, time.monotonic_ns(), payload)))
                    sent.append((x, y, yaw))
                    time.sleep(0.05)
                assert other.stdout is not None
                seen = json.loads(other.stdout.read())
        finally:
            process.terminate()
    with MapFile.open(config.path(config.map)) as source:
        frame = source.description.frame
    latitude, longitude, height = (np.array([row[column] for row in seen]) for column in (0, 1, 3))
    east, north, up = frame.to_local(latitude, longitude, height)
    np.testing.assert_allclose(up, 30.0, atol=0.001)
    way = np.array(sent)
    at = np.argmin(np.abs(way[:, 0][None] - east[:, None]), axis=1)
    # Every one of them, in order, to a millimetre.
    np.testing.assert_array_equal(np.diff(at), 1)
    assert np.abs(np.stack([east, north], axis=1) - way[at, :2]).max() < 0.001
    turned = frame.yaw_of_heading(np.array([row[4] for row in seen]), longitude)
    assert np.abs((turned - way[at, 2] + math.pi) % (2.0 * math.pi) - math.pi).max() < 2e-5
    assert {row[2] for row in seen} == {4}
