"""Frames: the published examples both ways, what a stream of bytes is cut into, what never goes out."""

import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.wire import LARGEST_PAYLOAD, MESSAGES, Frame, FrameParser, RefusalReason, RefusedBytes, decode, encode
from runtime.line_vectors import MESSAGES as BY_HAND
from runtime.line_vectors import PATH, document, frame_of, head_of, payload_of

_DOCUMENT: dict[str, Any] = json.loads(PATH.read_text(encoding="utf-8"))
_GOOD = _DOCUMENT["good"]
_HEAD = ("mode", "session", "sequence", "stamp_us", "ttl_ms")
_DRIVE = {"front_rad": 0.25, "throttle": 0.5, "brake": 0.0, "engage": 3}
_COMMAND = frame_of(0x20, payload_of("drive_command", _DRIVE), head_of(7, 1, 1000, 200))


def _fields(vector: dict[str, Any]) -> dict[str, Any]:
    values: dict[str, Any] = {name: math.nan if value == "nan" else value for name, value in vector["fields"].items()}
    return values | ({"data": bytes.fromhex(values["data"])} if "data" in values else {})


def _same(left: dict[str, Any], right: dict[str, Any]) -> bool:
    return left.keys() == right.keys() and all(
        left[name] == right[name] or (left[name] != left[name] and right[name] != right[name]) for name in left
    )


def test_published_examples_are_those_made_by_hand() -> None:
    assert document() == _DOCUMENT
    assert {vector["name"] for vector in _GOOD} == set(BY_HAND) == set(MESSAGES)
    for name in MESSAGES:
        assert len([vector for vector in _GOOD if vector["name"] == name]) >= 2


def test_examples_both_ways() -> None:
    for vector in _GOOD:
        raw = bytes.fromhex(vector["hex"])
        frame = decode(raw)
        assert (frame.raw, frame.name) == (raw, vector["name"])
        assert [getattr(frame, name) for name in (*_HEAD, "flags")] == [vector[name] for name in (*_HEAD, "flags")]
        assert _same(frame.fields, _fields(vector)), vector
        if "nan" not in vector["fields"].values():
            assert encode(vector["name"], _fields(vector), **{name: vector[name] for name in _HEAD}) == raw


def test_bad_examples() -> None:
    for vector in _DOCUMENT["bad"]:
        raw = bytes.fromhex(vector["hex"])
        parser = FrameParser()
        found = parser.feed(raw)
        if vector["verdict"] == "waits":
            assert found == []
        else:
            first = found[0]
            assert isinstance(first, RefusedBytes)
            assert RefusalReason(first.reason).name.lower() == vector["verdict"], vector
            assert first.data == raw[: len(first.data)]
            assert parser.counts.total() == len(found)
        with pytest.raises(ValueError, match="frame"):
            decode(raw)
        # What went wrong never costs the frame after it: a whole further one brings out what was held back.
        after = parser.feed(_COMMAND) + parser.feed(_COMMAND)
        assert [item.raw for item in after if isinstance(item, Frame)][-1] == _COMMAND


def test_a_number_of_a_device_may_be_none_but_is_never_sent() -> None:
    nan = next(vector for vector in _GOOD if "nan" in vector["fields"].values())
    assert math.isnan(decode(bytes.fromhex(nan["hex"])).number("potentiometer_v"))
    for value in (math.nan, math.inf, -math.inf, 1e39):
        with pytest.raises(ValueError, match=r"drive_command\.front_rad"):
            _encode("drive_command", _DRIVE | {"front_rad": value})


def test_fields_that_cannot_be_sent() -> None:
    changes: list[tuple[str, Any]] = [
        ("engage", 256),
        ("engage", -1),
        ("engage", 1.0),
        ("brake", b"1"),
        ("brakes", 1.0),
    ]
    for name, value in changes:
        with pytest.raises(ValueError, match=f"drive_command.{name}"):
            _encode("drive_command", _DRIVE | {name: value})
    with pytest.raises(ValueError, match="drive_wish"):
        _encode("drive_wish", _DRIVE)
    with pytest.raises(ValueError, match=r"drive_command\.throttle"):
        _encode("drive_command", {key: value for key, value in _DRIVE.items() if key != "throttle"})


def test_headers_and_scans_that_cannot_be_sent() -> None:
    for name, value in (("session", 0), ("session", 2**32), ("sequence", -1), ("ttl_ms", 65536), ("stamp_us", 2**64)):
        with pytest.raises(ValueError, match=name):
            _encode("drive_command", _DRIVE, **{name: value})
    scan = {"scan": 1, "channels": 2, "samples": 3, "valid": 3, "data": bytes(6)}
    assert decode(_encode("radar_scan", scan)).fields == scan
    with pytest.raises(ValueError, match=r"radar_scan\.data"):
        _encode("radar_scan", scan | {"data": bytes(5)})
    with pytest.raises(ValueError, match=str(LARGEST_PAYLOAD)):
        _encode("radar_scan", scan | {"samples": 4096, "data": bytes(8192)})
    with pytest.raises(TypeError, match="data"):
        decode(_encode("radar_scan", scan)).number("data")


def _encode(name: str, fields: dict[str, Any], **head: int) -> bytes:
    given = {"mode": 2, "session": 7, "sequence": 1, "stamp_us": 1000, "ttl_ms": 200} | head
    return encode(name, fields, **given)


def test_frames_are_found_again_after_garbage() -> None:
    scan = bytes.fromhex(next(vector["hex"] for vector in _GOOD if vector["name"] == "radar_scan"))
    # A sync too many, half a frame, a head that promises 8192 bytes of a scan, and a frame in a frame that is cut.
    promise = b"\xa5\x5a\x01\x12\x00\x20"
    stream = (
        b"\xa5" + _COMMAND + b"\xa5\xa5\x5a" + scan + _COMMAND[:20] + _COMMAND + promise + scan + bytes(8300) + _COMMAND
    )
    whole = FrameParser().feed(stream)
    raws = [item.raw for item in whole if isinstance(item, Frame)]
    assert raws == [_COMMAND, scan, _COMMAND, scan, _COMMAND]
    one_by_one = FrameParser()
    slow = [item for byte in stream for item in one_by_one.feed(bytes([byte]))]
    assert [item.raw for item in slow if isinstance(item, Frame)] == raws


def test_a_length_with_a_flipped_bit_holds_nothing_back() -> None:
    # 4096 + 13 bytes of a command: seconds of a slow line, were they waited for.
    torn = _COMMAND[:5] + bytes([_COMMAND[5] ^ 0x10]) + _COMMAND[6:]
    found = FrameParser().feed(torn + _COMMAND)
    assert [type(item) for item in found] == [RefusedBytes, Frame]
    assert found[0] == RefusedBytes(RefusalReason.LENGTH, torn)


_KINDS = {
    "B": st.integers(0, 2**8 - 1),
    "H": st.integers(0, 2**16 - 1),
    "I": st.integers(0, 2**32 - 1),
    "i": st.integers(-(2**31), 2**31 - 1),
    "f": st.floats(width=32, allow_nan=False, allow_infinity=False),
    "d": st.floats(allow_nan=False, allow_infinity=False),
}


@st.composite
def _messages(draw: st.DrawFn) -> tuple[str, dict[str, Any], dict[str, int]]:
    name = draw(st.sampled_from(sorted(BY_HAND)))
    _, layout, names = BY_HAND[name]
    fields: dict[str, Any] = {key: draw(_KINDS[code]) for key, code in zip(names, layout[1:], strict=False)}
    if name == "radar_scan":
        fields |= {"channels": draw(st.integers(0, 11)), "samples": draw(st.integers(0, 400))}
        fields["data"] = draw(st.randoms()).randbytes(fields["channels"] * fields["samples"])
    elif name in ("radar_sweep", "radar_lookup"):
        sizes = {
            "rows": draw(st.integers(0, 12)),
            "steps": draw(st.integers(0, 80)),
            "width": draw(st.sampled_from([4, 8])),
        }
        fields |= sizes | {"data": draw(st.randoms()).randbytes(sizes["rows"] * sizes["steps"] * sizes["width"])}
    limits = {"mode": 2**8, "session": 2**32, "sequence": 2**32, "stamp_us": 2**64, "ttl_ms": 2**16}
    head = {key: draw(st.integers(key == "session", limit - 1)) for key, limit in limits.items()}
    return name, fields, head


@given(_messages(), st.binary(max_size=40), st.integers(5, 200))
@settings(max_examples=30, deadline=None)
def test_round_trip(message: tuple[str, dict[str, Any], dict[str, int]], garbage: bytes, chunk: int) -> None:
    name, fields, head = message
    raw = encode(name, fields, **head)
    as_text = {key: value.hex() if isinstance(value, bytes) else value for key, value in fields.items()}
    assert raw == frame_of(BY_HAND[name][0], payload_of(name, as_text), head | {"flags": 0})
    assert decode(raw).fields == fields
    stream = garbage + raw
    parser = FrameParser()
    found = [item for at in range(0, len(stream), chunk) for item in parser.feed(stream[at : at + chunk])]
    # 8 KiB of nothing end whatever the garbage has begun.
    found += parser.feed(bytes(8300))
    assert raw in [item.raw for item in found if isinstance(item, Frame)]
