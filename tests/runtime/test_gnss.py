"""GNSS/INS: messages cut out of bytes, and what they say, against messages built by other libraries and by hand."""

import math
import random
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pynmeagps import NMEAMessage
from pyubx2 import GET, UBXMessage

from lgprjax.runtime.gnss import GnssParser, GnssSample, Quality, is_position, read_gnss
from lgprjax.runtime.stamps import GnssTimeScale
from lgprjax.wire import KEPT, RefusalReason, RefusedBytes


def _sentence(body: str) -> bytes:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}".encode()


def _ubx(kind: bytes, payload: bytes) -> bytes:
    body = kind + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + body + bytes([a, b])


def _pvt(**changes: Any) -> bytes:
    fields: dict[str, Any] = {"iTOW": 345678900, "fixType": 3, "gnssFixOk": 1, "carrSoln": 2, "hMSL": 40000, "hAcc": 14}
    fields |= {"lat": 42.3601234, "lon": -71.0589123, "height": 12345}
    return bytes(UBXMessage("NAV", "NAV-PVT", GET, **(fields | changes)).serialize())


def _att(**changes: Any) -> bytes:
    fields = {"iTOW": 1000, "roll": -2.5, "pitch": 1.0, "heading": 271.25, "accRoll": 0.1, "accHeading": 0.0625}
    return bytes(UBXMessage("NAV", "NAV-ATT", GET, **(fields | changes)).serialize())


def _ins(**changes: Any) -> bytes:
    fields = {"version": 1, "zAngRateValid": 1, "iTOW": 604799999, "zAngRate": -9.5}
    return bytes(UBXMessage("ESF", "ESF-INS", GET, **(fields | changes)).serialize())


def _relative(**changes: Any) -> bytes:
    fields: dict[str, Any] = {"version": 1, "iTOW": 5000, "relPosHeading": 359.5, "accHeading": 0.25, "carrSoln": 2}
    fields |= dict.fromkeys(("relPosValid", "relPosHeadingValid", "isMoving"), 1)
    return bytes(UBXMessage("NAV", "NAV-RELPOSNED", GET, **(fields | changes)).serialize())


def _read(raw: bytes) -> GnssSample:
    sample = read_gnss(raw)
    assert sample is not None
    assert [part is None for part in sample[1:]].count(False) == 1
    assert is_position(raw) == (sample.position is not None)
    return sample


def test_nav_pvt() -> None:
    position = _read(_pvt()).position
    assert position is not None
    assert _read(_pvt()).scale is GnssTimeScale.GPS_WEEK
    assert position.tow_s == 345678.9
    assert position.latitude_deg == pytest.approx(42.3601234, abs=1e-9)
    assert position.longitude_deg == pytest.approx(-71.0589123, abs=1e-9)
    assert (position.height_m, position.sigma_m, position.quality) == (12.345, 0.014, Quality.FIXED)


def test_quality_of_nav_pvt() -> None:
    qualities: list[tuple[dict[str, int], Quality]] = [
        ({"carrSoln": 1}, Quality.FLOAT),
        ({"carrSoln": 0}, Quality.SINGLE),
        ({"fixType": 4}, Quality.FIXED),
        ({"fixType": 2}, Quality.NONE),
        ({"fixType": 1}, Quality.NONE),
        ({"fixType": 5}, Quality.NONE),
        ({"gnssFixOk": 0}, Quality.NONE),
        ({"invalidLlh": 1}, Quality.NONE),
        ({"carrSoln": 3}, Quality.NONE),
    ]
    for changes, quality in qualities:
        position = _read(_pvt(**changes)).position
        assert position is not None
        assert position.quality is quality, changes
        # What is not a position is no number: nobody can take it for one.
        assert math.isnan(position.latitude_deg) == (quality is Quality.NONE)
        assert math.isnan(position.height_m) == (quality is Quality.NONE)


def test_sigma_that_is_not_told_is_no_number() -> None:
    for told in (0, 2**32 - 1):
        position = _read(_pvt(hAcc=told)).position
        assert position is not None
        assert math.isnan(position.sigma_m)


def test_nav_att_by_hand() -> None:
    payload = struct.pack("<IB3xiiiIII", 1000, 0, -250000, 100000, 27125000, 10000, 10000, 6250)
    sample = _read(_ubx(b"\x01\x05", payload))
    assert sample.attitude == pytest.approx((1.0, 271.25, -2.5, 0.0625))
    without_roll = _read(_att(accRoll=0.0)).attitude
    assert without_roll is not None
    assert math.isnan(without_roll.roll_deg)
    full_circle = _read(_att(heading=360.0)).attitude
    assert full_circle is not None
    assert full_circle.heading_deg == 0.0


def test_esf_ins_turns_the_sign() -> None:
    # z points down in the receiver's axes: -9.5 deg/s about it is counter-clockwise seen from above.
    sample = _read(_ins())
    assert sample.rate == pytest.approx((604799.999, math.radians(9.5)))
    by_hand = struct.pack("<I4xIiiiiii", 0x0401, 2000, 0, 0, 9500, 0, 0, 0)
    assert _read(_ubx(b"\x10\x15", by_hand)).rate == pytest.approx((2.0, -math.radians(9.5)))


def test_heading_between_two_antennas() -> None:
    attitude = _read(_relative()).attitude
    assert attitude is not None
    assert (attitude.tow_s, attitude.heading_deg) == (5.0, 359.5)
    assert attitude.sigma_heading_deg == pytest.approx(0.25, abs=2e-5)
    assert math.isnan(attitude.roll_deg)


def test_what_says_nothing_of_use() -> None:
    messages = [
        _pvt(iTOW=604800000),
        _pvt(lat=90.1),
        _pvt(lon=-180.1),
        _pvt(height=2**31 - 1),
        _att(accHeading=0.0),
        _att(heading=-1.0),
        _att(heading=361.0),
        _att(iTOW=2**32 - 1),
        _ins(zAngRateValid=0),
        _ins(zAngRate=1001.0),
        _relative(relPosHeadingValid=0),
        _relative(isMoving=0),
        _relative(carrSoln=1),
        _pvt()[:-1],
        _pvt()[:-1] + b"\0",
        _ubx(b"\x01\x07", bytes(3)),
        _ubx(b"\x01\x05", b""),
        _ubx(b"\x01\x07", _pvt()[6:-10]),
        _ubx(b"\x10\x15", _ins()[6:-2] + bytes(4)),
        _ubx(b"\x0a\x04", bytes(40)),
        _sentence("GNHDT,,T"),
        _sentence("GNHDT,nan,T"),
        _sentence("GNHDT,361,T"),
        _sentence("GNHDT,-inf,T"),
        _sentence("GNHDT,12.5,M"),
        _sentence("GNHDT"),
        _sentence("GNTHS,12.5,V"),
        _sentence("GNROT,1.0,V"),
        _sentence("GNROT,nan,A"),
        _sentence("GNGGA,123519,4807.0,N,01131.0,W,4,08,0.9,,M,,M,,"),
        _sentence("GNGGA,246000,4807.0,N,01131.0,W,4,08,0.9,1,M,1,M,,"),
        _sentence("GNGGA,123561,4807.0,N,01131.0,W,4,08,0.9,1,M,1,M,,"),
        _sentence("GNGGA,,4807.0,N,01131.0,W,4,08,0.9,1,M,1,M,,"),
        _sentence("GNGGA,123519,9907.0,N,01131.0,W,4,08,0.9,1,M,1,M,,"),
        _sentence("GNGGA,123519,,N,01131.0,W,4,08,0.9,1,M,1,M,,"),
        _sentence("GNGST,123519,1,2,3,4,,0.02,0.03"),
        _sentence("GNGST,123519,1,2,3,4,0,0,0"),
        _sentence("GNZDA,160012.71,11,03,2004,-1,00"),
        _sentence("PASHR,RTK,1"),
        _sentence("PASHR,123519.20,123.4,M,-1.2,0.5,,0.01,0.01,0.05,2,1"),
        b"",
        b"$",
        b"\xb5\x62",
        b"$GNHDT,12.5,T*00",
    ]
    assert [raw for raw in messages if read_gnss(raw) is not None] == []


def test_gga() -> None:
    sample = _read(_sentence("GNGGA,123519.20,4807.0380,S,01131.0600,W,4,08,0.9,545.4,M,46.9,M,,"))
    assert sample.scale is GnssTimeScale.UTC_DAY
    position = sample.position
    assert position is not None
    assert position.tow_s == pytest.approx(12 * 3600 + 35 * 60 + 19.2)
    assert position.latitude_deg == pytest.approx(-(48 + 7.038 / 60), abs=1e-9)
    assert position.longitude_deg == pytest.approx(-(11 + 31.06 / 60), abs=1e-9)
    assert position.height_m == pytest.approx(592.3)
    assert (math.isnan(position.sigma_m), position.quality) == (True, Quality.FIXED)


def test_quality_of_gga_and_the_minute_of_a_leap_second() -> None:
    for told, quality in enumerate((0, 1, 1, 1, 3, 2, 0, 0, 0)):
        position = _read(_sentence(f"GNGGA,123519,4807.0,N,01131.0,W,{told},08,0.9,1,M,2,M,,")).position
        assert position is not None
        assert position.quality == quality, told
    position = _read(_sentence("GNGGA,235960.20,4807.0,N,01131.0,W,4,08,0.9,1,M,2,M,,")).position
    assert position is not None
    assert position.tow_s == pytest.approx(86400.2)


def test_other_sentences() -> None:
    gst = _read(_sentence("GNGST,000001.5,1,2,3,4,0.03,0.04,0.1")).accuracy
    assert gst == pytest.approx((1.5, 0.05 / math.sqrt(2.0)))
    for body, heading in (("GNHDT,360.0,T", 0.0), ("GPTHS,12.5,A", 12.5)):
        sample = _read(_sentence(body))
        assert sample.scale is GnssTimeScale.NONE
        assert sample.attitude is not None
        assert sample.attitude.heading_deg == heading
        assert math.isnan(sample.attitude.tow_s)
    # Bow to port is negative: counter-clockwise.
    rate = _read(_sentence("GNROT,-60.0,A")).rate
    assert rate is not None
    assert rate.yaw_rate_radps == pytest.approx(math.radians(1.0))
    attitude = _read(_sentence("PASHR,123519.20,123.4,T,-1.2,0.5,,0.01,0.01,0.05,2,1")).attitude
    assert attitude == pytest.approx((45319.2, 123.4, -1.2, 0.05))


def _built() -> list[bytes]:
    nmea = NMEAMessage("GN", "HDT", GET, headingT=12.5, headingTu="T")
    return [
        _pvt(),
        _att(),
        nmea.serialize().rstrip(),
        _ins(),
        _sentence("GNROT,-60.0,A"),
        _ubx(b"\x02\x15", bytes(800)),
    ]


def test_messages_are_cut_out_of_a_stream() -> None:
    messages = _built()
    stream = b"".join(raw + (b"\r\n" if raw[:1] == b"$" else b"") for raw in messages)
    whole = GnssParser()
    assert whole.feed(stream) == messages
    slow = GnssParser()
    assert [item for byte in stream for item in slow.feed(bytes([byte]))] == messages
    assert whole.counts.total() == slow.counts.total() == 0


def test_garbage_between_messages_is_refused_and_costs_none() -> None:
    messages = _built()
    garbage = [
        b"\xb5",
        b"$GN",
        b"$GNHDT,1.0,T*00\r\n",
        _att()[:20],
        _att()[:-1] + b"\xff",
        b"\xd3\x00\x01\xff",
        b"$" * 300,
    ]
    garbage += [b"$" + b"A" * 300, b"\xb5\x62\x01\x07\xff\xff", b"*", b"$GNHDT,12.5,T\r\n"]
    chosen = random.Random(4)
    stream, expected = b"", []
    for _ in range(200):
        message = chosen.choice(messages)
        stream += chosen.choice(garbage) + message + b"\r\n"
        expected.append(message)
    # A false head may have promised bytes to come: these let everything go.
    parser = GnssParser()
    found = parser.feed(stream + bytes(5000))
    assert [item for item in found if isinstance(item, bytes)] == expected
    refused = [item for item in found if isinstance(item, RefusedBytes)]
    assert len(refused) == parser.counts.total() >= 200
    assert set(parser.counts) == {RefusalReason.NO_SYNC, RefusalReason.LENGTH, RefusalReason.CRC, RefusalReason.CUT}
    assert all(0 < len(item.data) <= KEPT for item in refused)


@given(
    st.sampled_from(_built()), st.lists(st.tuples(st.integers(0, 99), st.integers(0, 255)), max_size=4), st.booleans()
)
@settings(max_examples=100, deadline=None)
def test_no_bytes_raise(raw: bytes, changes: list[tuple[int, int]], mended: bool) -> None:
    changed = bytearray(raw)
    for at, value in changes:
        changed[at % len(raw)] = value
    text = bytes(changed)
    # With checksums made right again, the fields themselves are put to the test.
    if mended and text[:2] == b"\xb5\x62":
        text = _ubx(text[2:4], text[6:-2])
    elif mended and text[:1] == b"$":
        text = _sentence(text[1:-3].decode("latin-1"))
    sample = read_gnss(text)
    if sample is not None and sample.position is not None and sample.position.quality:
        assert abs(sample.position.latitude_deg) <= 90.0
    if sample is not None and sample.attitude is not None:
        assert 0.0 <= sample.attitude.heading_deg < 360.0
