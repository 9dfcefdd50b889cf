"""Message definitions and CDR, held against the library that ROS users have and against bytes laid out by hand."""

import re
import struct
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

from formats.mcap_sample import DEFINITIONS
from lgprjax.formats.ros import (
    FIX_QUALITY,
    IMAGE,
    IMU,
    NAV_SAT_FIX,
    ODOMETRY,
    POSE,
    RADAR_ARRAY,
    RADAR_SCAN,
    MessageLayout,
    RosField,
    definition_of,
    layout_of,
    layout_to_write,
    pose_covariance,
    quaternion_of,
    rotation_of,
    yaw_and_roll,
)

_OURS = (FIX_QUALITY, IMAGE, IMU, NAV_SAT_FIX, ODOMETRY, POSE, RADAR_ARRAY, RADAR_SCAN)
_RULE = "=" * 80 + "\n"
_ALPHABET = "CDEFGHIJKLMNOP"
# Each message holds the next one twice: eight thousand members in all.
_ENDLESS = "".join(f"{_RULE}MSG: a/{a}\n{b} x\n{b} y\n" for a, b in pairwise(_ALPHABET))


def _drawn(layout: MessageLayout, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)

    def one(code: str, count: int) -> np.ndarray:
        dtype = np.dtype(code)
        if dtype.kind == "f":
            return rng.normal(size=count).astype(dtype)
        return rng.integers(np.iinfo(dtype).min, np.iinfo(dtype).max, count, dtype=dtype, endpoint=True)

    values: dict[str, Any] = {}
    for path, code, size in layout.fields:
        if code == "s":
            values[path] = "grün" * int(rng.integers(0, 3))
        elif size is None:
            values[path] = one(code, 1)[0].item()
        else:
            values[path] = one(code, size or int(rng.integers(0, 6)))
    return values


def _nested(values: dict[str, Any]) -> dict[str, Any]:
    """The same values as messages within messages, arrays as lists."""
    out: dict[str, Any] = {}
    for path, value in values.items():
        *parents, name = path.split(".")
        place = out
        for parent in parents:
            place = place.setdefault(parent, {})
        if isinstance(value, np.ndarray):
            value = value.tobytes() if value.dtype == np.uint8 else value.tolist()
        place[name] = value
    return out


def _member(message: SimpleNamespace, path: str) -> Any:
    for name in path.split("."):
        message = getattr(message, name)
    return message


@pytest.mark.parametrize("kind", _OURS)
def test_written_and_read_as_the_library_does(kind: str) -> None:
    layout, text = layout_to_write(kind), definition_of(kind)
    values = _drawn(layout, 1)
    data = layout.encode(values)
    assert data == serialize_dynamic(kind, text)[kind](_nested(values))
    message = generate_dynamic(kind, text)[kind](data)
    again = layout.decode(data)
    for path, value in values.items():
        theirs = _member(message, path)
        np.testing.assert_array_equal(np.asarray(list(theirs)) if isinstance(value, np.ndarray) else theirs, value)
        np.testing.assert_array_equal(again[path], value)


def test_definitions_as_recorders_write_them_lay_out_like_ours() -> None:
    """With comments, constants, defaults and names without a package."""
    for kind, definition in DEFINITIONS.items():
        own = next(each for each in _OURS if each.endswith(kind.rpartition("/")[2]))
        assert layout_of(kind, definition) == layout_to_write(own), kind


def test_a_position_byte_by_byte() -> None:
    """From the rules of CDR alone: a text is counted with its end, numbers stand at multiples of their size."""
    data = b"\0\1\0\0" + struct.pack("<iI", 1700000000, 250) + struct.pack("<I", 4) + b"gps\0"
    data += struct.pack("<b", -1) + b"\0" + struct.pack("<H", 9) + b"\0" * 4
    data += struct.pack("<12d", 47.5, 8.25, 430.0, *range(9)) + b"\2"
    values = layout_to_write(NAV_SAT_FIX).decode(data)
    assert values["header.stamp.sec"] == 1700000000
    assert (values["header.frame_id"], values["status.status"], values["status.service"]) == ("gps", -1, 9)
    assert (values["latitude"], values["longitude"], values["altitude"]) == (47.5, 8.25, 430.0)
    np.testing.assert_array_equal(values["position_covariance"], np.arange(9.0))
    assert values["position_covariance_type"] == 2
    assert layout_to_write(NAV_SAT_FIX).encode(values) == data


def test_big_endian_is_read() -> None:
    layout = layout_of("a/B", "uint8 flag\nfloat64 x\nint16[] y\nstring z")
    data = b"\0\0\0\0" + b"\7" + b"\0" * 7 + struct.pack(">d", 2.5) + struct.pack(">I3h", 3, -1, 2, 300)
    data += b"\0\0" + struct.pack(">I", 3) + b"ab\0"
    values = layout.decode(data)
    assert (values["flag"], values["x"], values["z"]) == (7, 2.5, "ab")
    np.testing.assert_array_equal(values["y"], [-1, 2, 300])


def test_members_of_all_forms() -> None:
    text = "uint8 KIND=3\nstring<=8 name\nint32[<=4] some 1\nfloat32[2] two\nbool on True # yes = no\nbool[] ons\n"
    text += f"string[] texts\nbuiltin_interfaces/Duration span\nNothing empty\n{_RULE}MSG: a/Nothing\n# none\n"
    fields = layout_of("a/msg/B", text).fields
    assert fields == (
        RosField("name", "s", None),
        RosField("some", "i", 0),
        RosField("two", "f", 2),
        RosField("on", "?", None),
        RosField("ons", "?", 0),
        RosField("texts", "s", 0),
        RosField("span.sec", "i", None),
        RosField("span.nanosec", "I", None),
        RosField("empty.structure_needs_at_least_one_member", "B", None),
    )
    values = {"name": "x", "two": [1.0, 2.0], "on": True, "ons": [True, False], "texts": ["a", "", "bcd"]}
    again = MessageLayout(fields).decode(MessageLayout(fields).encode(values))
    assert again["texts"] == ["a", "", "bcd"]
    assert again["on"] is True
    assert list(again["ons"]) == [True, False]
    assert len(again["some"]) == 0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("Other x", "a/Other"),
        ("B b", "a/B"),
        ("wstring x", "a/wstring"),
        (f"geometry_msgs/Point[] points\n{_RULE}MSG: geometry_msgs/Point\nfloat64 x", "points"),
        ("float64", "'float64'"),
        ("float64[ x", r"float64\["),
        (f"float64 x\n{_RULE}float64 y", "message in"),
        (f"C c\n{_ENDLESS}{_RULE}MSG: a/P\nint8 x", "definition"),
    ],
)
def test_definitions_that_cannot_be_read(text: str, value: str) -> None:
    with pytest.raises(ValueError, match=value):
        layout_of("a/B", text)


def test_a_message_cut_anywhere_is_none() -> None:
    for kind in (ODOMETRY, RADAR_SCAN):
        layout = layout_to_write(kind)
        data = layout.encode(_drawn(layout, 3))
        for length in range(len(data)):
            with pytest.raises(ValueError, match=r"\w"):
                layout.decode(data[:length])


def test_unknown_members_and_sizes_are_not_written() -> None:
    layout = layout_of("a/B", "float64[3] x")
    with pytest.raises(KeyError, match="y"):
        layout.encode({"x": [1.0, 2.0, 3.0], "y": 1.0})
    with pytest.raises(ValueError, match=r"x.*3.*2"):
        layout.encode({"x": [1.0, 2.0]})


def test_angles() -> None:
    """A rotation matrix made of the axes: x forward, y left, z up; a roll lifts the left side."""
    for yaw, roll in ((0.3, 0.1), (-3.0, -0.4), (2.0, 0.0), (np.pi, 0.2)):
        q = quaternion_of(yaw, roll)
        x, y, z, w = (q[axis] for axis in "xyzw")
        forward = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
        left = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
        np.testing.assert_allclose(forward, [np.cos(yaw), np.sin(yaw), 0.0], atol=1e-12)
        np.testing.assert_allclose(left[2], np.sin(roll), atol=1e-12)
        np.testing.assert_allclose(rotation_of(yaw, roll)[:, :2], np.stack([forward, left], axis=1), atol=1e-12)
        np.testing.assert_allclose(rotation_of(yaw, roll)[:, 2], np.cross(forward, left), atol=1e-12)
        again = yaw_and_roll(x, y, z, w)
        np.testing.assert_allclose(np.exp(1j * np.array(again)), np.exp(1j * np.array([yaw, roll])), atol=1e-12)
    # A pitch of half a radian on top changes neither.
    pitch = np.array([np.cos(0.25), np.sin(0.25)])
    yaw_half = np.array([np.cos(0.4), np.sin(0.4)])
    turned = (-yaw_half[1] * pitch[1], yaw_half[0] * pitch[1], yaw_half[1] * pitch[0], yaw_half[0] * pitch[0])
    np.testing.assert_allclose(yaw_and_roll(*map(float, turned)), (0.8, 0.0), atol=1e-12)
    assert np.isnan(yaw_and_roll(0.0, 0.0, 0.0, 0.0)[0])


def test_covariance_of_a_pose_in_the_order_of_ros() -> None:
    """East, north, height, yaw, roll to x, y, z, roll, pitch, yaw."""
    own = np.arange(25.0).reshape(5, 5)
    theirs = pose_covariance(own)
    names, order = ("x", "y", "z", "yaw", "roll"), ("x", "y", "z", "roll", "pitch", "yaw")
    for row, one in enumerate(names):
        for column, other in enumerate(names):
            assert theirs[order.index(one), order.index(other)] == own[row, column]
    assert theirs[4, 4] > 1.0
    assert not np.any(np.delete(theirs[4], 4))


def test_the_documented_definitions_are_those_written() -> None:
    page = (Path(__file__).parents[2] / "docs" / "transfer.md").read_text(encoding="utf-8")
    blocks = dict(re.findall(r"^### (\w+)\n\n```rosmsg\n(.*?)```", page, re.MULTILINE | re.DOTALL))
    for kind in (RADAR_SCAN, RADAR_ARRAY, FIX_QUALITY):
        own = definition_of(kind).partition("=" * 80)[0]
        assert own.partition("\n")[2] == blocks[kind.rpartition("/")[2]]
