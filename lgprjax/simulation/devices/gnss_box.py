"""A u-blox receiver with INS: NAV-PVT, NAV-ATT and ESF-INS, built by pyubx2."""

import datetime
from typing import NamedTuple

from pyubx2 import GET, UBXMessage

WEEK_S = 604_800
POSITION_LATENCY_NS, ATTITUDE_LATENCY_NS = 30_000_000, 5_000_000
"""From the time that a message is of to its leaving."""
_EPOCH = datetime.datetime(1980, 1, 6)  # GPS time is no zone's
_LEAP_S = 18.0


class Position(NamedTuple):
    """A fix: WGS-84 of the antenna, speed over ground, and how good; solution: 2 fixed, 1 float, 0 single."""

    latitude_deg: float
    longitude_deg: float
    height_m: float
    speed_mps: float
    course_deg: float
    sigma_m: float
    solution: int


class Attitude(NamedTuple):
    """What the INS says: roll (right side down), compass heading, yaw rate counter-clockwise, acceleration forward.

    ``valid``: else the fields are marked as not to be used.
    """

    roll_rad: float
    heading_deg: float
    yaw_rate_radps: float
    acceleration_mps2: float
    speed_mps: float
    valid: bool


class GnssClock:
    """GNSS time as the receiver shows it.

    Args:
        offset_s: GNSS time since its epoch, s, when the world's clock shows 0.
    """

    def __init__(self, offset_s: float) -> None:
        self.offset_s = offset_s

    def time_s(self, now_ns: int) -> float:
        """GNSS time since its epoch."""
        return self.offset_s + 1e-9 * now_ns

    def itow_ms(self, now_ns: int) -> int:
        """Time of week."""
        return round(1e3 * self.time_s(now_ns)) % (1000 * WEEK_S)


def position_message(clock: GnssClock, time_ns: int, fix: Position) -> bytes:
    """NAV-PVT of a moment of the world's clock."""
    moment = _EPOCH + datetime.timedelta(seconds=clock.time_s(time_ns) - _LEAP_S)
    sigma_mm = round(1e3 * fix.sigma_m)
    # pyubx2 takes degrees where UBX scales them; every other field in UBX's own units.
    message = UBXMessage(
        "NAV",
        "NAV-PVT",
        GET,
        iTOW=clock.itow_ms(time_ns),
        year=moment.year,
        month=moment.month,
        day=moment.day,
        hour=moment.hour,
        min=moment.minute,
        second=moment.second,
        validDate=1,
        validTime=1,
        fullyResolved=1,
        nano=1000 * moment.microsecond,
        fixType=3,
        gnssFixOk=1,
        diffSoln=int(fix.solution > 0),
        carrSoln=fix.solution,
        numSV=18,
        lon=fix.longitude_deg,
        lat=fix.latitude_deg,
        height=round(1e3 * fix.height_m),
        hMSL=round(1e3 * fix.height_m),
        hAcc=sigma_mm,
        vAcc=2 * sigma_mm,
        gSpeed=round(1e3 * fix.speed_mps),
        headMot=fix.course_deg,
        sAcc=50,
        headAcc=2.0,
    )
    return bytes(message.serialize())


def attitude_messages(clock: GnssClock, time_ns: int, attitude: Attitude) -> bytes:
    """NAV-ATT and ESF-INS of a moment of the world's clock; UBX's body axes are x forward, y right, z down."""
    itow_ms = clock.itow_ms(time_ns)
    valid = int(attitude.valid)
    degree = 57.29577951308232
    told = UBXMessage(
        "NAV",
        "NAV-ATT",
        GET,
        iTOW=itow_ms,
        version=0,
        roll=degree * attitude.roll_rad if valid else 0.0,
        heading=attitude.heading_deg if valid else 0.0,
        # What UBX says where it knows nothing: half a turn.
        accRoll=0.1 if valid else 180.0,
        accPitch=0.1 if valid else 180.0,
        accHeading=0.13 if valid else 180.0,
    )
    rates = UBXMessage(
        "ESF",
        "ESF-INS",
        GET,
        version=1,
        xAngRateValid=0,
        yAngRateValid=0,
        zAngRateValid=valid,
        xAccelValid=valid,
        yAccelValid=valid,
        zAccelValid=0,
        iTOW=itow_ms,
        zAngRate=-degree * attitude.yaw_rate_radps if valid else 0.0,
        xAccel=attitude.acceleration_mps2 if valid else 0.0,
        yAccel=-attitude.speed_mps * attitude.yaw_rate_radps if valid else 0.0,
    )
    return bytes(told.serialize() + rates.serialize())
