"""What a run that only records shows: rates, silence, travel, a recorder that failed; and that it sends nothing."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage

from lgprjax.run_records import COVER, Record, RecordKind, Source, ToolBits, pack
from lgprjax.runtime.choices import Choices
from lgprjax.runtime.config import CoverageTable, PortsTable, PortTable, RuntimeConfig, read_config
from lgprjax.runtime.control.record import STATE_TICKS, RecordCore
from lgprjax.runtime.display.board import Board
from lgprjax.runtime.preflight import check_recordable
from lgprjax.runtime.radargram import ROWS, LiveColumns
from lgprjax.wire import MESSAGES, Sender
from refusals import refused

_TICK_NS = 20_000_000


def config_of(*lines: str) -> RuntimeConfig:
    ports = PortsTable(**{name: PortTable(url="/dev/null") for name in lines})
    return RuntimeConfig(file=Path("record.run.toml"), name="record", mode="record", ports=ports)


def position(at_s: float, north_m: float) -> bytes:
    message = UBXMessage(
        "NAV", "NAV-PVT", GET, iTOW=round(1000 * at_s), fixType=3, gnssFixOk=1, carrSoln=2, hAcc=14,
        lat=42.0 + north_m / 111_194.9, lon=-71.0, height=10_000,
    )  # fmt: skip
    return bytes(message.serialize())


class Lines:
    """A core and a clock: a tick of 20 ms at a time."""

    def __init__(self, *lines: str) -> None:
        self.core, self.tick, self.now_ns = RecordCore(config_of(*lines)), 0, 10**9
        self.out: list[Record] = []
        self._box = Sender(7)

    def run(
        self, seconds: float, *, north_mps: float = 0.0, gnss: bool = True, odometer_mps: float | None = None
    ) -> None:
        for _ in range(round(50 * seconds)):
            self.tick, self.now_ns = self.tick + 1, self.now_ns + _TICK_NS
            at_s, came = self.now_ns / 1e9, []
            if gnss and self.tick % 5 == 0:
                came.append(self._in(Source.GNSS, position(at_s, north_mps * at_s)))
            if odometer_mps is not None:
                came.append(self._in(Source.DRIVE_BY_WIRE, self._status(odometer_mps * at_s)))
            self.out += self.core.step(self.tick, self.now_ns, came)

    def tell(self, **note: Any) -> None:
        self.core.step(self.tick, self.now_ns, [
            Record(RecordKind.EVENT, Source.SUPERVISOR, 0, self.now_ns, json.dumps(note).encode())
        ])  # fmt: skip

    @property
    def state(self) -> dict[str, Any]:
        return self.core.state(self.tick, self.now_ns)

    def _in(self, source: Source, raw: bytes) -> Record:
        return Record(RecordKind.PORT_IN, source, self.tick, self.now_ns, raw)

    def _status(self, odometer_m: float) -> bytes:
        return status(self._box, odometer_m, self.now_ns)


def status(sender: Sender, odometer_m: float, mono_ns: int) -> bytes:
    numbers = {field.name: 0 for field in MESSAGES["drive_status"].numbers}
    return sender.frame("drive_status", {**numbers, "odometer_m": odometer_m}, mode=0, mono_ns=mono_ns)


def test_it_gives_out_states_alone() -> None:
    lines = Lines("gnss", "radar")
    lines.run(2.0, north_mps=2.0)
    assert {record.kind for record in lines.out} == {RecordKind.STATE}
    assert len(lines.out) == 100 // STATE_TICKS


def test_rates_and_silence_of_each_line() -> None:
    lines = Lines("gnss", "radar")
    lines.run(4.0)
    assert lines.state["lines"]["gnss"]["rate_hz"] == pytest.approx(10.0, abs=0.6)
    assert any(text.startswith("radar") for text in lines.state["warnings"])
    lines.tell(scans=40)
    assert lines.state["scans"] == 40
    assert not any(text.startswith("radar") for text in lines.state["warnings"])
    lines.run(3.0, gnss=False)
    assert lines.state["lines"]["gnss"]["age_s"] == pytest.approx(3.0, abs=0.2)
    assert lines.state["lines"]["gnss"]["rate_hz"] == 0.0
    assert {text.split(":")[0] for text in lines.state["warnings"]} == {"gnss", "radar"}


def test_travel_is_that_of_the_odometer_else_of_the_positions() -> None:
    by_positions = Lines("gnss")
    by_positions.run(10.0, north_mps=2.0)
    assert by_positions.state["travel_m"] == pytest.approx(20.0, abs=0.6)
    assert by_positions.state["speed_mps"] == pytest.approx(2.0, abs=0.05)
    both = Lines("gnss", "drive_by_wire")
    both.run(10.0, north_mps=2.0, odometer_mps=2.2)
    assert both.state["travel_m"] == pytest.approx(22.0, abs=0.1)
    trail = np.array(both.core.state(100, both.now_ns)["path"])
    assert np.hypot(*np.diff(trail, axis=0).T).max() < 0.8


def test_a_recorder_that_failed_is_the_mode_that_is_shown() -> None:
    lines = Lines("gnss")
    assert lines.state["mode"] == "BOOT"
    lines.tell(ready="recorder")
    assert lines.state["mode"] == "RECORD"
    lines.tell(died="recorder")
    assert lines.state["mode"] == "RECORD_LOST"
    lines.tell(ready="recorder")
    assert lines.state["mode"] == "RECORD"


def scan(value: int) -> bytes:
    rng = np.random.default_rng(value)
    data = rng.integers(0, 256, (3, 64), np.uint8).tobytes()
    fields: dict[str, int | float | bytes] = {"scan": value, "channels": 3, "samples": 64, "valid": 7, "data": data}
    return Sender(3).frame("radar_scan", fields, mode=0, mono_ns=value)


def test_the_newest_scan_is_a_column_of_the_page_once() -> None:
    columns = LiveColumns()
    assert columns.column() is None
    for number in range(5):
        columns.take(scan(number))
    column = columns.column()
    assert column is not None
    assert column.shape == (ROWS,)
    assert np.ptp(column) > 50
    assert columns.column() is None
    for odd in (np.zeros(0), np.full(64, np.nan)):
        columns.add(odd)
    assert columns.column() is None
    board = Board()
    records = [Record(RecordKind.PORT_IN, Source.RADAR, 0, 1, scan(number)) for number in (8, 9)]
    board.take_scans([*map(pack, records), b"short"])
    said = json.loads(board.text(5, 0, with_path=False))
    assert len(said["column"]) == ROWS
    assert board.refused_states == 1
    board.take_scans([])
    assert "column" not in json.loads(board.text(6, 0, with_path=False))


CART = """
schema = "lgprjax.vehicle"
schema_version = "1.4"
name = "cart"
steering_kind = "skid_steer"
[skid_steer]
track_m = 0.7
[tool]
width_m = 0.5
length_m = 0.3
ahead_m = 0.4
[navigation]
gnss_x_m = 0.3
"""
_LATE_S = 6.0


class Cart(Lines):
    """A hand cart that is pulled north, and what its core gives out."""

    def __init__(self, folder: Path, anchor: list[float] | None = None) -> None:
        (folder / "cart.vehicle.toml").write_text(CART)
        config = config_of("gnss").model_copy(
            update={"file": folder / "cart.run.toml", "vehicle": "cart.vehicle.toml", "coverage": CoverageTable()}
        )
        self.core, self.tick, self.now_ns = RecordCore(config, anchor), 0, 10**9
        self.out: list[Record] = []
        self._box = Sender(7)

    def covers(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and their times, s."""
        found = [record for record in self.out if record.kind is RecordKind.COVER]
        rows = np.array([np.frombuffer(record.payload, COVER)[0] for record in found])
        return rows, np.array([1e-9 * record.mono_ns for record in found])

    def events(self) -> list[dict[str, Any]]:
        return [json.loads(record.payload) for record in self.out if record.kind is RecordKind.EVENT]


def test_a_hand_cart_is_mapped_where_it_was(tmp_path: Path) -> None:
    cart = Cart(tmp_path)
    cart.run(40.0, north_mps=0.4)
    rows, at_s = cart.covers()
    counts = (rows["tool"] & ToolBits.COUNTS) != 0
    # A way of 3.5 m tells the heading, and what is mapped waits for six seconds.
    assert 40.0 - _LATE_S - counts.sum() / 10.0 == pytest.approx(3.5 / 0.4 + 1.0, abs=3.0)
    assert np.all(np.diff(at_s) > 0.0)
    assert at_s[-1] == pytest.approx(cart.now_ns / 1e9 - _LATE_S, abs=0.05)
    (anchor,) = (event["anchor"] for event in cart.events() if "anchor" in event)
    start_m = (anchor[0] - 42.0) * 111_194.9
    # The reference point is 0.3 m behind the antenna; degrees of the receiver are whole 1e-7, 1.1 cm.
    north = 0.4 * at_s - start_m - 0.3
    assert np.abs(rows["y_m"] - north)[counts].max() < 0.03
    assert np.abs(rows["x_m"])[counts].max() < 0.02
    assert np.abs(rows["yaw_rad"] - np.pi / 2)[counts].max() < 0.02
    assert np.nanmedian(rows["speed_mps"][counts]) == pytest.approx(0.4, abs=0.02)
    field = cart.state["field"]
    assert field["heading_known"]
    assert 0.0 < field["mapped_sigma_m"] < field["sigma_m"] < 0.1
    assert 0.0 < field["mapped_sigma_heading_deg"] < field["sigma_heading_deg"] < 5.0
    assert field["mapped_after_s"] == pytest.approx(_LATE_S)
    # It stands, and may be turned on the spot unseen: nothing from there on counts.
    cart.out.clear()
    stood_s = cart.now_ns / 1e9
    for _ in range(100):
        cart.run(0.1, north_mps=0.4 * stood_s / (cart.now_ns / 1e9 + 0.1))
    rows, at_s = cart.covers()
    assert not ((rows["tool"] & ToolBits.COUNTS) != 0)[at_s > stood_s].any()


def test_a_cart_that_is_taken_up_keeps_its_frame_and_its_level(tmp_path: Path) -> None:
    """Of a process that died: kept in memory, asked for again."""
    first = Cart(tmp_path)
    asked = json.dumps({"select_level": 0.99}).encode()
    request = Record(RecordKind.REQUEST, Source.DISPLAY, 1, first.now_ns, asked)
    first.run(1.0)
    first.out += first.core.step(first.tick + 1, first.now_ns, [request])
    wrong = request._replace(payload=json.dumps({"select_level": 1.5}).encode())
    first.out += first.core.step(first.tick + 2, first.now_ns, [wrong])
    assert first.events()[-2] == {"level": 0.99}
    assert first.events()[-1]["refused"] == "level"
    choices = Choices(tmp_path)
    choices.keep([record for record in first.out if record.kind is RecordKind.EVENT])
    again = Choices(tmp_path)
    assert again.level == 0.99
    assert [json.loads(record.payload) for record in again.again()] == [{"select_level": 0.99}]
    second = Cart(tmp_path, again.anchor)
    second.run(2.0, north_mps=5.0)
    assert second.core.frame == first.core.frame
    assert not [event for event in second.events() if "anchor" in event]


def test_a_cart_has_a_receiver_and_a_tool_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "cart.vehicle.toml").write_text(CART)
    text = 'name = "c"\nmode = "record"\nvehicle = "cart.vehicle.toml"\n[coverage]\n{}\n[ports]\n'
    file = tmp_path / "cart.run.toml"
    gnss, box = 'gnss = { url = "/dev/null" }\n', 'drive_by_wire = { url = "/dev/null" }\n'
    file.write_text(text.format("") + gnss)
    assert check_recordable(read_config(file)).endswith("0.5 m wide")
    for wrong in (text.format("") + gnss + box, text.format('plan = "x.cover.geojson"') + gnss, text.format("") + box):
        file.write_text(wrong)
        with refused("map, routes, coverage", file=file):
            read_config(file)
    file.write_text(text.format("") + gnss)
    (tmp_path / "cart.vehicle.toml").write_text(CART.replace("width_m = 0.5", ""))
    with refused("tool.width_m", file=tmp_path / "cart.vehicle.toml"):
        check_recordable(read_config(file))
