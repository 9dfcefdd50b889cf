"""The published examples of the wire protocol, made by hand from ``data_schema/wire.toml`` alone.

``python tests/runtime/line_vectors.py`` writes ``data_schema/wire_vectors.json``.
"""

import json
import struct
import zlib
from pathlib import Path
from typing import Any

PATH = Path(__file__).parents[2] / "data_schema" / "wire_vectors.json"

Table = dict[str, Any]

# Name, type, layout of the payload, names in order; bytes follow where the last name is `data`. A line may go on.
_FIELDS = """
radar_command 0x10 <BI action scan_period_us
radar_sweep_plan 0x11 <IIH first_khz step_khz steps
radar_scan 0x12 <IHHI scan channels samples valid data
radar_health 0x13 <BHfI state errors temperature_c dropped
radar_description 0x14 <HHIifI channels samples sample_interval_ps time_zero_ps zero_level scan_period_us
radar_sweep 0x15 <IHHHIf scan rows steps width valid scale data
radar_sweep_description 0x16 <HHIIiI channels steps first_khz step_khz group_delay_ps scan_period_us
radar_lookup 0x17 <HHHf rows steps width scale data
drive_command 0x20 <fffB front_rad throttle brake engage
drive_status 0x21 <IBHHfiffBffdf command_sequence engaged state refused potentiometer_v encoder_counts supply_v
    torque_nm pedals throttle brake odometer_m speed_mps
drive_test 0x22 <B test
skid_command 0x24 <ffBfB left_mps right_mps tool depth_m engage
skid_status 0x25 <IBHHffddBfff command_sequence engaged state refused left_mps right_mps left_m right_m tool
    tool_rpm depth_m supply_v
controller_status 0x30 <H buttons
controller_light 0x31 <B light
"""
MESSAGES: dict[str, tuple[int, str, list[str]]] = {
    name: (int(kind, 16), layout, names)
    for name, kind, layout, *names in map(str.split, _FIELDS.replace("\n    ", " ").strip().splitlines())
}


def payload_of(name: str, fields: Table) -> bytes:
    """The payload of a message; bytes are given as hex, a number that is none as ``nan``."""
    _, layout, names = MESSAGES[name]
    values = [fields[field] for field in names]
    bulk = bytes.fromhex(values.pop()) if names[-1] == "data" else b""
    return struct.pack(layout, *[float("nan") if value == "nan" else value for value in values]) + bulk


def frame_of(kind: int, payload: bytes, head: Table, version: int = 1) -> bytes:
    """A whole frame."""
    chosen = (head["mode"], head["flags"], head["session"], head["sequence"], head["stamp_us"], head["ttl_ms"])
    body = struct.pack("<BBHBBIIQH", version, kind, len(payload), *chosen)
    return b"\xa5\x5a" + body + payload + struct.pack("<I", zlib.crc32(body + payload))


def head_of(session: int, sequence: int, stamp_us: int, ttl_ms: int = 0, mode: int = 3, flags: int = 0) -> Table:
    """The header's numbers that a sender chooses."""
    numbers = (mode, flags, session, sequence, stamp_us, ttl_ms)
    return dict(zip(("mode", "flags", "session", "sequence", "stamp_us", "ttl_ms"), numbers, strict=True))


_SCAN = {"scan": 4711, "channels": 3, "samples": 4, "valid": 5, "data": "000102037e7f80818000ff01"}
_SWEEP = [4711, 2, 1, 4, 1, 0.5, "0100feff0a00f6ff"]
_STATUS = [4294967295, 3, 128, 65535, 2.5, -1200, 24.5, -0.75, 1, 0.125, 0.5, -1609.344, -4.5]
_DEFAULTS = [17, 0, 11, 3, "nan", 2147483647, 0.0, 0.0, 0, 0.0, 0.5, 0.0, 0.0]
_VALUES: list[tuple[str, list[Any]]] = [
    ("radar_command", [1, 0]),
    ("radar_command", [3, 7937]),
    ("radar_sweep_plan", [100000, 1500, 201]),
    ("radar_sweep_plan", [4294967295, 0, 65535]),
    ("radar_scan", list(_SCAN.values())),
    ("radar_scan", [0, 1, 1, 1, "a5"]),
    ("radar_health", [1, 0, 41.5, 0]),
    ("radar_health", [4, 31, -20.25, 4294967295]),
    ("radar_description", [11, 369, 200, 3000, 127.0, 7937]),
    ("radar_description", [1, 8191, 1, -2147483648, 0.0, 0]),
    ("radar_sweep", _SWEEP),
    ("radar_sweep", [0, 1, 1, 8, 1, 1.0, "0000803f000000c0"]),
    ("radar_sweep_description", [11, 61, 100000, 5000, 12000, 7937]),
    ("radar_sweep_description", [1, 65535, 1, 4294967295, -2147483648, 0]),
    ("radar_lookup", [2, 1, 4, 0.25, "ff7f008000000100"]),
    ("radar_lookup", [1, 1, 8, 1.0, "0000000000000080"]),
    ("drive_command", [0.25, 0.5, 0.0, 3]),
    ("drive_command", [-0.5, 0.0, 1.0, 7]),
    ("drive_status", _STATUS),
    ("drive_status", _DEFAULTS),
    ("drive_test", [1]),
    ("drive_test", [0]),
    ("skid_command", [0.5, -0.25, 1, 0.125, 1]),
    ("skid_command", [0.0, 0.0, 0, 0.0, 4]),
    ("skid_status", [12, 1, 0, 2, 0.5, 0.375, 1609.344, -0.5, 1, 412.5, 0.125, 24.5]),
    ("skid_status", [0, 0, 33, 65535, "nan", 0.0, 0.0, 0.0, 0, 0.0, -0.25, 0.0]),
    ("controller_status", [2]),
    ("controller_status", [130]),
    ("controller_status", [125]),
    ("controller_light", [1]),
    ("controller_light", [0]),
]


def good_frames() -> list[Table]:
    """Two or more frames of every message, with what they say."""
    frames = []
    for number, (name, values) in enumerate(_VALUES):
        fields = dict(zip(MESSAGES[name][2], values, strict=True))
        # The last one's header holds the largest numbers.
        last = number == len(_VALUES) - 1
        head = (
            head_of(2**32 - 1, 2**32 - 1, 2**64 - 1, 65535, 255)
            if last
            else head_of(0x01020304 + number, number, 10**12 + number, 200 * (number % 2), number % 8)
        )
        raw = frame_of(MESSAGES[name][0], payload_of(name, fields), head)
        frames.append({"name": name, **head, "fields": fields, "hex": raw.hex()})
    return frames


def bad_frames() -> list[Table]:
    """Bytes that are no frame to be acted upon, and the first reason to be told."""
    head = head_of(7, 0, 1000, 200)
    payload = payload_of("drive_command", dict(zip(MESSAGES["drive_command"][2], [0.25, 0.5, 0.0, 3], strict=True)))
    good = frame_of(0x20, payload, head)
    scan = payload_of("radar_scan", _SCAN)
    sweep = payload_of("radar_sweep", dict(zip(MESSAGES["radar_sweep"][2], _SWEEP, strict=True)))
    longest = struct.pack("<IHHI", 0, 1, 8181, 1) + bytes(8181)
    cases: list[tuple[str, str, bytes]] = [
        ("one bit of the payload flipped", "crc", good[:27] + bytes([good[27] ^ 1]) + good[28:]),
        ("one bit of the CRC flipped", "crc", good[:-1] + bytes([good[-1] ^ 0x80])),
        ("one bit of the session flipped", "crc", good[:8] + bytes([good[8] ^ 4]) + good[9:]),
        ("a CRC that leaves the version out", "crc", good[:-4] + struct.pack("<I", zlib.crc32(good[3:-4]))),
        ("version 2", "version", frame_of(0x20, payload, head, version=2)),
        ("no sync", "no_sync", good[2:]),
        ("sync turned round", "no_sync", b"\x5a\xa5" + good[2:]),
        ("an unknown message", "type", frame_of(0x7F, payload, head)),
        ("a payload one byte short, of a right CRC", "length", frame_of(0x20, payload[:-1], head)),
        ("a payload one byte long, of a right CRC", "length", frame_of(0x20, payload + b"\0", head)),
        ("longer than the largest payload", "length", frame_of(0x12, longest, head)),
        ("fewer bytes than channels times samples", "payload", frame_of(0x12, scan[:-1], head)),
        ("fewer bytes than rows times steps times width", "payload", frame_of(0x15, sweep[:-1], head)),
        ("not whole yet", "waits", good[:-1]),
    ]
    return [{"why": why, "verdict": verdict, "hex": raw.hex()} for why, verdict, raw in cases]


def conversation() -> list[Table]:
    """What a host makes of frames that come over the line of the drive-by-wire box, one after the other."""
    steps: list[Table] = []

    def came(arrival_us: int, verdict: str, head: Table, name: str = "drive_status") -> None:
        values = next(values for kind, values in _VALUES if kind == name)
        fields = dict(zip(MESSAGES[name][2], values, strict=True))
        raw = frame_of(MESSAGES[name][0], payload_of(name, fields), head)
        steps.append({"arrival_us": arrival_us, "verdict": verdict, "hex": raw.hex()})

    came(1_000_000, "no_session", head_of(0, 0, 500_000, 100))
    came(1_010_000, "accepted", head_of(7, 100, 510_000, 100))
    came(1_011_000, "repeated", head_of(7, 100, 510_000, 100))
    came(1_012_000, "repeated", head_of(7, 99, 500_000, 100))
    came(1_020_000, "accepted", head_of(7, 103, 520_000, 100))
    came(1_025_000, "wrong_line", head_of(7, 104, 525_000, 100), "controller_status")
    came(1_026_000, "wrong_line", head_of(7, 104, 526_000, 100), "drive_command")
    came(1_030_000, "second_sender", head_of(8, 0, 530_000, 100))
    came(1_200_000, "stale", head_of(7, 104, 540_000, 100))
    came(1_201_000, "accepted", head_of(7, 105, 540_000))
    came(1_202_000, "accepted", head_of(7, 106, 702_000, 100))
    came(1_210_000, "from_future", head_of(7, 107, 9_710_000, 100))
    came(1_220_000, "accepted", head_of(7, 108, 720_000, 100))
    came(1_419_000, "second_sender", head_of(9, 0, 0, 100))
    came(1_421_000, "accepted", head_of(9, 1, 2_000, 100))
    came(1_700_000, "remembered_session", head_of(7, 109, 1_200_000, 100))
    came(1_710_000, "accepted", head_of(9, 2, 291_000, 100))
    return steps


def document() -> Table:
    """All of ``data_schema/wire_vectors.json``."""
    return {
        "schema": "lgprjax.wire_vectors",
        "version": "1.2",
        "description": "Examples of data_schema/wire.toml. Verdicts of bad bytes: no_sync, version, length, crc, type, "
        "payload; waits: no verdict before more bytes arrive. Bytes are hex; nan is not a number.",
        "good": good_frames(),
        "bad": bad_frames(),
        "conversation": {
            "description": "frames in this order on the line of the drive-by-wire box, at host clock time "
            "arrival_us; missed counts the missing sequence numbers",
            "line": "drive_by_wire",
            "missed": 2,
            "steps": conversation(),
        },
    }


if __name__ == "__main__":
    PATH.write_text(json.dumps(document(), indent=1) + "\n", encoding="utf-8")
