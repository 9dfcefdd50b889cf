"""What the radar is told before it scans, in its order, and what it reports in words."""

import json
from pathlib import Path
from typing import Any

import pytest

from lgprjax.run_records import RecordKind, unpack
from lgprjax.runtime.config import RadarTable, SweepTable
from lgprjax.runtime.port import Port
from lgprjax.runtime.registration.search import RadarLine
from lgprjax.runtime.ring import Ring
from lgprjax.scene.propagation import RadarConfig
from lgprjax.simulation.devices.boxes import DeviceSender
from lgprjax.simulation.devices.sensors import RadarBox, RadarState
from lgprjax.wire import Frame, decode


class FakePort(Port[Frame]):
    """A port that keeps what is written."""

    def __init__(self) -> None:
        self.written: list[bytes] = []
        self.closed = False

    def write(self, data: bytes) -> bool:
        self.written.append(data)
        return True

    def take(self) -> list[Any]:
        return []

    def take_refused(self) -> list[Any]:
        return []

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def rings(tmp_path: Path) -> tuple[Ring, Ring]:
    return Ring.create(tmp_path / "log", 1 << 20), Ring.create(tmp_path / "control", 1 << 16)


def health(state: int, errors: int = 0) -> Frame:
    box = RadarBox(DeviceSender(3, 0), RadarConfig(), 11, 1.0 / 126.0)
    box.state, box.errors = RadarState(state), errors
    return decode(box.health(1_000_000))


def told(port: FakePort) -> list[tuple[str, int]]:
    """Messages and their first number."""
    frames = [decode(raw) for raw in port.written]
    return [(frame.name, int(frame.number(next(iter(frame.fields))))) for frame in frames]


def line_of(table: RadarTable, rings: tuple[Ring, Ring]) -> tuple[RadarLine, FakePort]:
    port = FakePort()
    now_s = [100.0]

    def later() -> int:
        now_s[0] += 1.5
        return round(1e9 * now_s[0])

    return RadarLine(port, table, *rings, later), port


def test_sweep_plan_calibration_and_look_up_come_before_the_start(rings: tuple[Ring, Ring]) -> None:
    table = RadarTable(sweep=SweepTable(first_khz=100_000, step_khz=1500, steps=201), calibrate=True, look_up=True)
    line, port = line_of(table, rings)
    line.order()
    assert port.written == []
    assert line.preparing
    for state in (0, 2, 2, 0, 3, 0, 1, 1):
        line.take(health(state))
        line.order()
    plan = ("radar_sweep_plan", 100_000)
    assert told(port) == [
        plan, ("radar_command", 2), plan, ("radar_command", 3), plan, ("radar_command", 1)
    ]  # fmt: skip
    line.close()
    assert told(port)[-1] == ("radar_command", 0)
    assert port.closed


def test_a_radar_that_scans_already_is_left_as_it_is(rings: tuple[Ring, Ring]) -> None:
    line, port = line_of(RadarTable(calibrate=True), rings)
    line.take(health(1))
    line.order()
    assert port.written == []
    assert not line.preparing


def test_without_orders_it_is_told_to_start_at_once_and_again(rings: tuple[Ring, Ring]) -> None:
    line, port = line_of(RadarTable(scan_period_us=7937), rings)
    line.order()
    line.order()
    assert told(port) == [("radar_command", 1)] * 2
    assert decode(port.written[0]).number("scan_period_us") == 7937


def test_its_errors_are_told_to_control_in_words(rings: tuple[Ring, Ring]) -> None:
    line, _ = line_of(RadarTable(), rings)
    for errors in (0, 3, 0):
        line.take(health(1, errors))
    records = [unpack(message) for message in rings[1].take()]
    assert [record.kind for record in records] == [RecordKind.EVENT] * 2
    first, second = (json.loads(record.payload)["radar"] for record in records)
    assert len(set(first)) == 2
    assert second == []
