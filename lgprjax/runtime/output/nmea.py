"""The corrected position as NMEA 0183: GGA, HDT and GST, over TCP or a serial line, as a receiver sends them."""

import contextlib
import math
import socket
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
import serial

from lgprjax.errors import InputError
from lgprjax.frames import LocalFrame
from lgprjax.runtime.config import OutputTable, RuntimeConfig

_MOST_CLIENTS = 8
_REOPEN_S = 1.0


class Given(NamedTuple):
    """A position for output.

    Attributes:
        utc_s: time of the pose, seconds since 1970.
        latitude_deg, longitude_deg, height_m: WGS-84 position of the vehicle's antenna; height above the ellipsoid.
        heading_deg: heading of the vehicle, clockwise from true north.
        sigma_along_m, sigma_cross_m: standard deviations along and across the heading.
        quality: as in GGA: 0 none, 4 fixed, 5 float, 6 dead reckoning or doubtful.
    """

    utc_s: float
    latitude_deg: float
    longitude_deg: float
    height_m: float
    heading_deg: float
    sigma_along_m: float
    sigma_cross_m: float
    quality: int


def horizontal_covariance(given: Given) -> tuple[float, float, float]:
    """Variance of east, covariance, and variance of north, square metres: the ellipse turned from the heading."""
    heading, along_m2, cross_m2 = math.radians(given.heading_deg), given.sigma_along_m**2, given.sigma_cross_m**2
    sin, cos = math.sin(heading), math.cos(heading)
    return (
        along_m2 * sin**2 + cross_m2 * cos**2,
        (along_m2 - cross_m2) * sin * cos,
        along_m2 * cos**2 + cross_m2 * sin**2,
    )


def sentences(given: Given) -> bytes:
    """GGA, HDT and GST of one moment. Without a position the fields are empty and the quality is 0.

    The altitude is the height above the ellipsoid, with an empty separation; satellites and HDOP are constants, 12 and
    1.0, because some autopilots refuse fewer satellites or a larger HDOP. GST has the actual error.
    """
    time = _clock(given.utc_s)
    numbers = given[1:7]
    if given.quality == 0 or not all(map(math.isfinite, numbers)):
        return b"".join(
            _framed(body) for body in (f"GPGGA,{time},,,,,0,00,,,M,,M,,", "GPHDT,,T", f"GPGST,{time},,,,,,,")
        )
    place = f"{_degrees(given.latitude_deg, 2)},{'NS'[given.latitude_deg < 0.0]}"
    place += f",{_degrees(given.longitude_deg, 3)},{'EW'[given.longitude_deg < 0.0]}"
    along, cross = given.sigma_along_m, given.sigma_cross_m
    east2, _, north2 = horizontal_covariance(given)
    north, east = math.sqrt(north2), math.sqrt(east2)
    # The larger axis of the error ellipse is along the heading or across it.
    turned = given.heading_deg if along >= cross else given.heading_deg + 90.0
    ellipse = f"{max(along, cross):.3f},{min(along, cross):.3f},{round(turned, 1) % 180.0:.1f}"
    bodies = (
        f"GPGGA,{time},{place},{given.quality},12,1.0,{given.height_m:.3f},M,,M,,",
        f"GPHDT,{round(given.heading_deg, 3) % 360.0:.3f},T",
        f"GPGST,{time},{math.hypot(north, east):.3f},{ellipse},{north:.3f},{east:.3f},",
    )
    return b"".join(_framed(body) for body in bodies)


def _framed(body: str) -> bytes:
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode("ascii")


def _clock(utc_s: float) -> str:
    moment = datetime.fromtimestamp(round(utc_s, 2), UTC)
    return f"{moment:%H%M%S}.{moment.microsecond // 10_000:02d}"


def _degrees(value: float, digits: int) -> str:
    """Degrees and minutes; seven decimals of a minute are 0.2 mm."""
    minutes = round(abs(value) * 60.0, 7)
    whole = int(minutes // 60.0)
    return f"{whole:0{digits}d}{minutes - 60.0 * whole:010.7f}"


class NmeaOutlets:
    """Receivers of the sentences: clients of a TCP port, and a serial line. A slow client does not delay the others.

    Raises:
        InputError: listening at the port fails.
    """

    def __init__(self, config: RuntimeConfig, table: OutputTable) -> None:
        self._table = table
        self._clients: list[socket.socket] = []
        self._listener: socket.socket | None = None
        self._serial: serial.SerialBase | None = None
        self._opened_s = -math.inf
        if table.nmea_port is not None:
            try:
                self._listener = socket.create_server((table.nmea_host, table.nmea_port))
            except OSError as error:
                found = f"{table.nmea_host}:{table.nmea_port}: {error.strerror or error}"
                raise InputError(config.file, "output.nmea_port", "an address to listen at", found) from None
            self._listener.setblocking(False)

    @property
    def address(self) -> tuple[str, int] | None:
        """Address and port of the listener."""
        return None if self._listener is None else self._listener.getsockname()[:2]

    def send(self, data: bytes, now_s: float) -> None:
        """Send data to all receivers; slow clients are disconnected."""
        if self._listener is not None:
            with contextlib.suppress(OSError):
                client, _ = self._listener.accept()
                if len(self._clients) < _MOST_CLIENTS:
                    client.setblocking(False)
                    self._clients.append(client)
                else:
                    client.close()
        for client in [*self._clients]:
            try:
                whole = client.send(data) == len(data)
            except OSError:
                whole = False
            if not whole:
                client.close()
                self._clients.remove(client)
        self._send_serial(data, now_s)

    def close(self) -> None:
        """Disconnect all receivers."""
        for client in self._clients:
            client.close()
        if self._listener is not None:
            self._listener.close()
        if self._serial is not None:
            self._serial.close()

    def _send_serial(self, data: bytes, now_s: float) -> None:
        table = self._table.nmea_serial
        if table is None:
            return
        try:
            if self._serial is None:
                if now_s - self._opened_s < _REOPEN_S:
                    return
                self._opened_s = now_s
                self._serial = serial.serial_for_url(table.url, table.baud, write_timeout=0.05)
            self._serial.write(data)
        except (OSError, ValueError, serial.SerialException):
            if self._serial is not None:
                with contextlib.suppress(OSError, serial.SerialException):
                    self._serial.close()
            self._serial = None


def given_of(row: np.void, frame: LocalFrame, utc_s: float) -> Given:
    """A record ``pose`` of the map's frame, at its time. Its height is above the frame's origin, as its place is."""
    x, y, yaw = (np.array([value]) for value in row["pose"])
    up = np.array([float(row["height_m"])])
    # Before the first height the place is known all the same.
    latitude, longitude, height = frame.to_geodetic(x, y, np.nan_to_num(up))
    return Given(
        utc_s=utc_s,
        latitude_deg=float(latitude[0]),
        longitude_deg=float(longitude[0]),
        height_m=float(height[0]) if np.isfinite(up[0]) else math.nan,
        heading_deg=float(frame.heading_of_yaw(yaw, longitude)[0]),
        sigma_along_m=float(row["sigma_along_m"]),
        sigma_cross_m=float(row["sigma_cross_m"]),
        quality=int(row["quality"]),
    )
