"""Radar and controller boxes against data_schema/wire.toml, by frames made by hand."""

import struct

import numpy as np
import pytest

from lgprjax.scene import SweepPlan
from lgprjax.scene.propagation import RadarConfig
from lgprjax.simulation.devices.boxes import ControllerBox, DeviceSender, buttons_of
from lgprjax.simulation.devices.sensors import PROCESSING_NS, RadarBox, RadarState, RecordedScan, SweepForm
from simulation.devices.host_frames import MS, host_frame, read_frame

_PERIOD_NS = 7_936_508


def _radar() -> RadarBox:
    return RadarBox(DeviceSender(9, 0), RadarConfig(), 11, 1.0 / 126.0)


def _tell(box: RadarBox, action: int, sequence: int, now_ns: int, period_us: int = 0) -> None:
    box.receive(host_frame(0x10, struct.pack("<BI", action, period_us), sequence, now_ns), now_ns)


def _scan(number: int) -> RecordedScan:
    data = np.arange(11 * 369, dtype=np.int64).reshape(11, 369) + number
    return RecordedScan(number, number * _PERIOD_NS, data.astype(np.uint8))


def test_scans_leave_when_they_are_done_stamped_with_their_start() -> None:
    box = _radar()
    _tell(box, 1, 0, 10 * _PERIOD_NS)
    box.put([_scan(9), _scan(10), RecordedScan(11, 11 * _PERIOD_NS, None), _scan(12)])
    # The one of before the start is left.
    assert box.due(11 * _PERIOD_NS + PROCESSING_NS - 1000) == []
    frames = [read_frame(data) for _, data in box.due(14 * _PERIOD_NS)]
    assert [frame.stamp_us for frame in frames] == [10 * _PERIOD_NS // 1000, 12 * _PERIOD_NS // 1000]
    scan, channels, samples, valid = struct.unpack_from("<IHHI", frames[1].payload)
    assert (scan, channels, samples, valid) == (2, 11, 369, 0x7FF)
    assert frames[1].payload[12:] == _scan(12).data.tobytes()  # type: ignore[union-attr]
    assert box.dropped == 1


def test_it_stops_and_numbers_anew() -> None:
    box = _radar()
    _tell(box, 1, 0, 0)
    box.put([_scan(0), _scan(1)])
    _tell(box, 0, 1, 1)
    assert box.due(1000 * MS) == []
    box.put([_scan(5)])
    _tell(box, 1, 2, 90 * _PERIOD_NS)
    box.put([_scan(90)])
    ((_, data),) = box.due(1000 * MS)
    assert struct.unpack_from("<I", read_frame(data).payload)[0] == 0


def test_a_longer_period_leaves_scans_out_and_numbers_go_on() -> None:
    box = _radar()
    told = read_frame(box.descriptions(5000)[0])
    assert told.kind == 0x14
    assert struct.unpack("<HHIifI", told.payload) == (11, 369, 160, 4000, 128.0, 7937)
    _tell(box, 1, 0, 0)
    box.put([_scan(number) for number in range(4)])
    _tell(box, 1, 1, 4 * _PERIOD_NS, period_us=2 * 7937)
    box.put([_scan(number) for number in range(4, 9)])
    numbers = [struct.unpack_from("<I", read_frame(data).payload)[0] for _, data in box.due(1000 * MS)]
    assert numbers == [0, 1, 2, 3, 4, 5, 6]
    assert struct.unpack("<HHIifI", read_frame(box.descriptions(0)[0]).payload)[5] == 15873


def test_sweeps_are_sent_as_counts_and_described_with_their_look_up() -> None:
    plan, rng = SweepPlan(steps=9), np.random.default_rng(4)
    counts = rng.integers(-(2**13), 2**13, size=(4, 9, 2))
    lookup = (rng.normal(size=(4, 9, 2)) @ [1.0, 1.0j]).astype(np.complex64)
    box = RadarBox(DeviceSender(9, 0), RadarConfig(), 3, 1.0 / 126.0, SweepForm(plan, lookup))
    first, second = map(read_frame, box.descriptions(5000))
    assert first.kind == 0x16
    assert struct.unpack("<HHIIiI", first.payload) == (3, 9, 100_000, 5_000, 6000, 7937)
    assert second.kind == 0x17
    assert struct.unpack_from("<HHHf", second.payload) == (4, 9, 8, 1.0)
    np.testing.assert_array_equal(np.frombuffer(second.payload[10:], "<c8").reshape(4, 9), lookup)
    _tell(box, 1, 0, 0)
    step = 2.0 * 3.0 / 2**14
    box.put([RecordedScan(0, 0, (counts @ [step, step * 1j]).astype(np.complex64))])
    ((_, data),) = box.due(1000 * MS)
    told = read_frame(data)
    assert told.kind == 0x15
    scan, rows, steps, width, valid, scale = struct.unpack_from("<IHHHIf", told.payload)
    assert (scan, rows, steps, width, valid) == (0, 4, 9, 4, 7)
    assert scale == pytest.approx(step, rel=1e-6)
    np.testing.assert_array_equal(np.frombuffer(told.payload[18:], "<i2").reshape(4, 9, 2), counts)


def test_calibrating_takes_a_second() -> None:
    box = _radar()
    _tell(box, 2, 0, 0)
    box.due(900 * MS)
    assert struct.unpack("<BHfI", read_frame(box.health(0)).payload)[0] == 2
    box.due(1000 * MS)
    assert box.state is RadarState.IDLE


def test_buttons_have_their_bits_and_the_light_goes_out_when_nobody_feeds_it() -> None:
    box = ControllerBox(DeviceSender(3, 0))
    for pressed, bits in (
        ("", 2),
        ("override", 1),
        ("steering plus", 2 | 8 | 16),
        ("estop minus brake_tap", 2 | 4 | 32 | 64),
    ):
        told = read_frame(box.status(20 * MS, buttons_of(set(pressed.split()))))
        assert (told.kind, told.stamp_us, struct.unpack("<H", told.payload)[0]) == (0x30, 20_000, bits)
    box.receive(host_frame(0x31, b"\x01", 0, 0, mode=6, ttl_ms=500), 0)
    assert box.lit(499 * MS)
    assert not box.lit(501 * MS)
    assert read_frame(box.status(0, 2)).mode == 6
