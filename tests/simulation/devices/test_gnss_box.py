"""The receiver's messages, read back by pyubx2's reader and by hand."""

import datetime
import io
import math
import struct

import pytest
from pyubx2 import UBXReader

from lgprjax.simulation.devices.sensors import GnssClock, GnssFix, InsReading, attitude_messages, position_message

_WEEK_S = 604_800.0


def test_a_position_reads_as_it_was() -> None:
    clock = GnssClock(2400 * _WEEK_S + 345_600.25)
    data = position_message(clock, 500_000_000, GnssFix(42.0012345, -71.0098765, 31.234, 4.47, 123.456, 0.014, 2))
    _, read = UBXReader(io.BytesIO(data)).read()
    assert (read.identity, read.fixType, read.gnssFixOk, read.carrSoln) == ("NAV-PVT", 3, 1, 2)
    assert (read.lat, read.lon) == (pytest.approx(42.0012345, abs=5e-8), pytest.approx(-71.0098765, abs=5e-8))
    # By UBX's own layout: iTOW first, hAcc at 40, in ms and mm.
    assert struct.unpack_from("<I", data, 6)[0] == 345_600_750
    assert struct.unpack_from("<I", data, 6 + 40)[0] == 14
    assert struct.unpack_from("<i", data, 6 + 32)[0] == 31_234
    date = datetime.datetime(1980, 1, 6) + datetime.timedelta(weeks=2400, seconds=345_600.75 - 18.0)
    assert (read.year, read.month, read.day, read.hour) == (date.year, date.month, date.day, date.hour)


def test_axes_point_down() -> None:
    data = attitude_messages(GnssClock(0.0), 0, InsReading(0.02, 271.5, 0.1, 0.5, 4.0, valid=True))
    (_, attitude), (_, rates) = UBXReader(io.BytesIO(data))
    assert (attitude.identity, rates.identity) == ("NAV-ATT", "ESF-INS")
    assert attitude.heading == pytest.approx(271.5, abs=1e-5)
    assert attitude.roll == pytest.approx(math.degrees(0.02), abs=1e-5)
    assert rates.zAngRateValid == 1
    # A turn to the left is negative about an axis that points down, and pushes to the left.
    assert rates.zAngRate == pytest.approx(-math.degrees(0.1), abs=1e-3)
    assert rates.yAccel == pytest.approx(-0.4, abs=0.01)


def test_what_is_not_valid_says_so() -> None:
    data = attitude_messages(GnssClock(0.0), 0, InsReading(0.02, 271.5, 0.1, 0.5, 4.0, valid=False))
    (_, attitude), (_, rates) = UBXReader(io.BytesIO(data))
    assert (rates.zAngRateValid, rates.zAngRate) == (0, 0)
    assert attitude.accHeading >= 180.0


def test_weeks_roll_over() -> None:
    clock = GnssClock(2401 * _WEEK_S - 1.0)
    assert [clock.itow_ms(at) for at in (0, 999_000_000, 1_000_000_000)] == [604_799_000, 604_799_999, 0]
