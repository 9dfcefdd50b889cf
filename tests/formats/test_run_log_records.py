"""Records of a run and frames within them: read as the specifications say, which are the runtime's own."""

import struct
import zlib

import numpy as np

from batch.run_sample import frame
from lgprjax.formats.run_log import frame_data, frame_name, frame_type, payload_type, read_run_record
from lgprjax.runtime import messages as records


def test_records_are_those_of_the_runtime() -> None:
    for name, due in (("fix", records.FIX), ("prior", records.PRIOR), ("plan", records.PLAN)):
        assert payload_type(name) == due
    for kind in records.RecordKind:
        packed = records.pack(records.Record(kind, records.Source.MONITOR, 3, 4, b"x"))
        assert read_run_record(packed) == (kind.name.lower(), "monitor", 3, 4, b"x")
    for source in records.Source:
        packed = records.pack(records.Record(records.RecordKind.TICK, source, 0, 0, b""))
        found = read_run_record(packed)
        assert found is not None
        assert found.source == source.name.lower()
    assert read_run_record(b"short") is None
    assert read_run_record(bytes([99]) + bytes(15)) is None


def test_frames_are_read_as_specified() -> None:
    payload = struct.pack("<IHHI", 8, 2, 3, 3) + b"abcdef"
    raw = frame(0x12, payload, session=1, sequence=2, stamp_us=3)
    assert frame_name(raw) == "radar_scan"
    assert frame_data(raw, "radar_scan") == b"abcdef"
    head = np.frombuffer(raw, frame_type("radar_scan"), 1)[0]
    names = ("session", "sequence", "stamp_us", "scan", "channels", "samples", "valid")
    assert [int(head[name]) for name in names] == [1, 2, 3, 8, 2, 3, 3]
    status = struct.pack("<IBHHfiffBffdf", 1, 2, 3, 4, 0.5, -6, 7.5, 8.5, 9, 0.25, 0.75, -10.5, 11.5)
    box = np.frombuffer(frame(0x21, status, session=1, sequence=2, stamp_us=3), frame_type("drive_status"), 1)[0]
    found = [box[name].item() for name in ("potentiometer_v", "encoder_counts", "odometer_m", "speed_mps")]
    assert found == [0.5, -6, -10.5, 11.5]
    for spoilt in (raw[:-1], raw[:-5] + b"x" + raw[-4:], raw[1:], b"", b"\xa5\x5a", raw[:3] + b"\x99" + raw[4:]):
        assert frame_name(spoilt) is None
    short = b"\x01\x12" + bytes(22)
    assert frame_name(b"\xa5\x5a" + short + struct.pack("<I", zlib.crc32(short))) is None
