"""The simulated box of a skid-steer vehicle against wire.toml: what it obeys, its defaults, its remote control."""

import struct
from pathlib import Path

import pytest

from lgprjax.simulation.devices.boxes import DeviceSender, SkidActing, SkidBox, SkidMeasured
from lgprjax.simulation.devices.faults import Moment, RunningFaults, Schedule, read_items
from lgprjax.simulation.devices.field_stage import ToolState, step_tool
from simulation.devices.host_frames import MS, host_frame, read_frame

STATUS = "<IBHHffddBfff"
REMOTE = SkidActing(0.2, 0.2, None)
MEASURED = SkidMeasured(0.5, 0.25, 1.5, -2.5, True, 400.0, 0.125, 24.0)


def command(sequence: int, now_ns: int, engage: int, *, session: int = 77) -> bytes:
    payload = struct.pack("<ffBfB", 0.5, 0.25, 1, 0.125, engage)
    return host_frame(0x24, payload, sequence, now_ns, session=session)


def box_that_drives() -> SkidBox:
    box = SkidBox(DeviceSender(5, 0))
    box.receive(command(0, 0, 0), 0)
    box.receive(command(1, 20 * MS, 1), 20 * MS)
    return box


def state_of(box: SkidBox, now_ns: int) -> tuple[int, int, int]:
    """Sequence, engaged and state of a status."""
    told = read_frame(box.status(now_ns, MEASURED))
    assert told.kind == 0x25
    sequence, engaged, state, *_ = struct.unpack(STATUS, told.payload)
    return sequence, engaged, state


def test_it_drives_only_after_a_command_that_engages_nothing() -> None:
    box = SkidBox(DeviceSender(5, 0))
    box.receive(command(0, 0, 1), 0)
    assert box.acting(0, REMOTE, 24.0) == REMOTE
    assert state_of(box, 0) == (0, 0, 1)
    box.receive(command(1, 20 * MS, 0), 20 * MS)
    assert box.acting(20 * MS, REMOTE, 24.0) == REMOTE
    box.receive(command(2, 40 * MS, 1), 40 * MS)
    assert box.acting(40 * MS, REMOTE, 24.0) == SkidActing(0.5, 0.25, 0.125)
    assert state_of(box, 40 * MS) == (2, 1, 0)


def test_its_status_says_what_is_measured() -> None:
    told = struct.unpack(STATUS, read_frame(box_that_drives().status(30 * MS, MEASURED)).payload)
    assert told[4:] == (0.5, 0.25, 1.5, -2.5, 1, 400.0, 0.125, 24.0)


def test_a_command_ends_and_the_remote_control_has_the_vehicle() -> None:
    box = box_that_drives()
    assert box.acting(219 * MS, REMOTE, 24.0).left_mps == 0.5
    assert box.acting(221 * MS, REMOTE, 24.0) == REMOTE
    assert state_of(box, 221 * MS)[1:] == (0, 1)
    box.receive(command(2, 230 * MS, 1), 230 * MS)
    assert box.acting(230 * MS, REMOTE, 24.0) == REMOTE


def test_a_cut_power_lets_nobody_drive() -> None:
    box = box_that_drives()
    box.receive(command(2, 40 * MS, 4), 40 * MS)
    assert box.acting(40 * MS, REMOTE, 24.0) == SkidActing(0.0, 0.0, None)
    assert state_of(box, 40 * MS)[1:] == (4, 1)
    box.receive(command(3, 60 * MS, 0), 60 * MS)
    assert box.acting(60 * MS, REMOTE, 24.0) == REMOTE


def test_three_bad_frames_and_another_sender_are_told() -> None:
    box = box_that_drives()
    box.receive(command(9, 30 * MS, 1, session=78), 30 * MS)
    assert state_of(box, 30 * MS)[2] & 4
    bad = bytearray(command(2, 40 * MS, 1))
    bad[30] ^= 1
    box.receive(bytes(bad) * 3, 40 * MS)
    assert box.acting(40 * MS, REMOTE, 24.0) == REMOTE
    assert state_of(box, 40 * MS)[2] & 2
    assert state_of(box, 40 * MS)[2] & 256 == 0
    box.acting(50 * MS, REMOTE, 5.0)
    assert state_of(box, 50 * MS)[2] & 256


def test_the_tool_takes_a_moment_and_its_faults_show() -> None:
    sound, faults = ToolState(), RunningFaults()
    for _ in range(60):
        sound = step_tool(sound, 0.15, faults, 0.01)
    assert sound.turns
    assert sound.depth_m == pytest.approx(0.15)
    items = [{"kind": "tool_stops", "at_way_m": 0.0}]
    known = {"tool_stops": ()}
    faults.run(read_items(Path("x"), "", items, key="kind", known=known, lasts_s={}))
    stopped = step_tool(sound, 0.15, faults, 0.05)
    assert not stopped.turns
    raised = step_tool(sound, None, RunningFaults(), 0.1)
    assert raised.depth_m == pytest.approx(0.09)


def test_a_fault_begins_again_every_so_often_and_another_after_arrivals() -> None:
    rows = [
        {"kind": "off", "at_s": 10.0, "for_s": 2.0, "every_s": 30.0},
        {"kind": "there", "at_arrival": 2, "for_s": 1.0},
    ]
    known: dict[str, tuple[str, ...]] = {"off": (), "there": ()}
    schedule = Schedule(read_items(Path("x"), "", rows, key="kind", known=known, lasts_s={}))
    on: dict[str, list[int]] = {"off": [], "there": []}
    for second in range(80):
        moment = Moment(float(second), float(second), 0.0, 0, 0.0, 2 if second >= 50 else 1)
        for item in schedule.step(moment):
            on[item.name].append(second)
    assert on["off"] == [10, 11, 40, 41, 70, 71]
    assert on["there"] == [50]
