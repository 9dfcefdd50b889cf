"""Records of a run and frames within them: read as the specifications say."""

import struct
import tomllib
import zlib

import numpy as np

from lgprjax.files import schema_text
from lgprjax.formats.run_log import frame_data, frame_name, frame_type, read_run_record
from lgprjax.run_records import Record, RecordKind, Source, pack, payload_type
from recordings.run_sample import frame

_PAYLOADS = {
    "fix": "<qIBbH4f5d25df",
    "prior": "<qB3d5d",
    "plan": "<BBBII3d6f3fBIB",
    "cover": "<3d9f3fBfBiHB",
    "skid_plan": "<BBBII3d3f4fi2fBfBIIB",
}


def test_kinds_and_sources_are_those_of_the_schema() -> None:
    table = tomllib.loads(schema_text("run_log"))
    assert {kind.name.lower(): kind.value for kind in RecordKind} == {
        name: entry["code"] for name, entry in table["kinds"].items()
    }
    assert {source.name.lower(): source.value for source in Source} == table["sources"]
    for kind in RecordKind:
        assert read_run_record(pack(Record(kind, Source.MONITOR, 3, 4, b"x"))) == (kind, Source.MONITOR, 3, 4, b"x")
    whole = Record(RecordKind.TICK, Source.COVERAGE, 0x01020304, 0x05060708090A0B0C, b"")
    assert pack(whole) == bytes([5, 16, 0, 0, 4, 3, 2, 1, 12, 11, 10, 9, 8, 7, 6, 5])
    assert read_run_record(b"short") is None
    assert read_run_record(bytes([99]) + bytes(15)) is None


def test_payloads_are_packed_without_gaps() -> None:
    for name, layout in _PAYLOADS.items():
        numbers = [1 + at % 100 for at in range(len(struct.unpack(layout, bytes(struct.calcsize(layout)))))]
        row = np.frombuffer(struct.pack(layout, *numbers), payload_type(name))[0]
        found = np.concatenate([np.ravel(row[field]) for field in payload_type(name).names or ()])
        assert found.tolist() == numbers, name


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
