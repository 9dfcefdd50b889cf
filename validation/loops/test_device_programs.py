"""The program of the devices end to end: its ports opened as the runtime opens them, its truth read at the end."""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import serial

from canon.map import of_many_grounds
from lgprjax.formats import MapFile
from lgprjax.mapping import build_map
from lgprjax.simulation.loop.loop_setup import cross_track_m
from lgprjax.simulation.loop.off_road import OffRoad, make_course, scene_frame_of
from simulation.devices.host_frames import Status, drive_command, host_frame, read_frame, read_status

_COURSE = OffRoad(2, 30.0, scan_share=6)
_ROOT = Path(__file__).resolve().parents[2]


def _write_spec(folder: Path, database: Path) -> Path:
    spec = {
        "seed": _COURSE.seed,
        "length_m": _COURSE.length_m,
        "scan_share": _COURSE.scan_share,
        "drive_seed": 102,
        "map": str(database),
        "ports": str(folder / "ports.json"),
        "truth": str(folder / "truth.npz"),
        "script": [{"at_s": 0.5, "do": "press", "button": "plus", "for_s": 20.0}],
    }
    path = folder / "spec.json"
    path.write_text(json.dumps(spec), encoding="utf-8")
    return path


def _statuses(data: bytes) -> list[Status]:
    """All whole statuses from the first on; the line may have begun in the middle of one."""
    first = data.index(b"\xa5\x5a\x01\x21")
    size = 26 + struct.calcsize("<IBHHfiffBffdf") + 4
    return [read_status(data[at : at + size]) for at in range(first, len(data) - size + 1, size)]


def test_a_host_finds_its_devices(tmp_path: Path) -> None:
    course = make_course(_COURSE, tmp_path)
    database = tmp_path / "course.map.h5"
    build_map([course.baseline], database, measure=of_many_grounds)
    spec = _write_spec(tmp_path, database)
    environment = {**os.environ, "PYTHONPATH": str(_ROOT)}
    program = subprocess.Popen(
        [sys.executable, "-m", "lgprjax.simulation.devices", str(spec)],
        env=environment,
        stderr=subprocess.PIPE,
    )
    try:
        told, scans = _drive(program, tmp_path / "ports.json")
        program.send_signal(signal.SIGTERM)
        _, said = program.communicate(timeout=60.0)
    finally:
        program.kill()
        program.wait()
    # A machine that is busy is told of, and that is all that is told.
    assert all(line.startswith(b"devices: ") for line in said.splitlines())
    assert program.returncode == 0
    statuses = _statuses(told["drive_by_wire"])
    assert len(statuses) > 100
    assert statuses[-1].command_sequence > 20
    # The last command pressed on through the pty, and the wheels moved.
    assert statuses[-1].engaged == 3
    buttons = read_frame(told["controller"][-32:])
    assert struct.unpack("<H", buttons.payload)[0] & 16
    assert b"\xb5\x62\x01\x07" in told["gnss"]
    head = scans.index(b"\xa5\x5a\x01\x12")
    scan = read_frame(scans[head : head + 26 + 12 + 11 * 369 + 4])
    assert struct.unpack_from("<IHH", scan.payload)[1:] == (11, 369)
    with np.load(tmp_path / "truth.npz") as truth:
        assert len(truth["mono_ns"]) > 40
        assert truth["front_rad"].max() > 0.05
        assert abs(truth["mono_ns"][-1] - time.monotonic_ns()) < 60e9
        with MapFile.open(database) as source:
            track = scene_frame_of(source.description.frame).to_map(course.anchor_m[::6])
        assert np.abs(cross_track_m(track, truth["baseline_m"])).max() < 0.002
        assert truth["cpu_s"] > 0.0


def _drive(program: "subprocess.Popen[bytes]", ports: Path) -> tuple[dict[str, bytes], bytes]:
    """Open the ports, command for three seconds; what came."""
    until_s = time.monotonic() + 300.0
    while not ports.exists():
        assert program.poll() is None
        assert time.monotonic() < until_s
        time.sleep(0.05)
    address = json.loads(ports.read_text(encoding="utf-8"))
    lines = {
        name: serial.serial_for_url(address[name], 921600, timeout=0)
        for name in ("drive_by_wire", "controller", "gnss")
    }
    told = dict.fromkeys(lines, b"")
    scans = b""
    port = int(address["radar"].rsplit(":", 1)[1])
    with socket.create_connection(("127.0.0.1", port)) as radar:
        radar.settimeout(0.0)
        now_ns = time.monotonic_ns()
        radar.sendall(host_frame(0x10, struct.pack("<BI", 1, 0), 0, now_ns))
        began_s = time.monotonic()
        for number in range(150):
            engage = 0 if number < 40 else 3
            lines["drive_by_wire"].write(drive_command(number, time.monotonic_ns(), engage, front_rad=0.3))
            while time.monotonic() < began_s + 0.02 * number:
                time.sleep(0.002)
            for name, line in lines.items():
                told[name] += line.read(1 << 16)
            try:
                scans += radar.recv(1 << 20)
            except BlockingIOError:
                continue
    for line in lines.values():
        line.close()
    return told, scans
