"""Frames: WGS-84 on the host, local east-north-up metres in computation, the vehicle's body.

See docs/conventions.md: headings are compass degrees clockwise from true north on the host, yaw is
radians counter-clockwise from east in computation; x forward, y left, z up. Everything here is float64 NumPy:
float32 degrees have an ulp of about half a metre and never reach the device.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from pyproj import Transformer

Array1 = Float[np.ndarray, " scan"]


@dataclass(frozen=True)
class LocalFrame:
    """East-north-up metres around a float64 WGS-84 anchor (topocentric: exact at any distance).

    Attributes:
        latitude_deg, longitude_deg: the anchor, degrees.
        height_m: ellipsoidal height of the anchor, metres.
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float

    @cached_property
    def _transform(self) -> Transformer:
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lon_0={self.longitude_deg!r} "
            f"+lat_0={self.latitude_deg!r} +h_0={self.height_m!r}"
        )

    def to_local(self, latitude_deg: Array1, longitude_deg: Array1, height_m: Array1) -> tuple[Array1, Array1, Array1]:
        """East, north and up, metres, of WGS-84 points."""
        east, north, up = self._transform.transform(longitude_deg, latitude_deg, height_m)
        return np.asarray(east), np.asarray(north), np.asarray(up)

    def to_geodetic(self, east_m: Array1, north_m: Array1, up_m: Array1) -> tuple[Array1, Array1, Array1]:
        """Latitude and longitude, degrees, and ellipsoidal height, metres, of local points."""
        longitude, latitude, height = self._transform.transform(east_m, north_m, up_m, direction="INVERSE")
        return np.asarray(latitude), np.asarray(longitude), np.asarray(height)

    def yaw_of_heading(self, heading_deg: Array1, longitude_deg: Array1) -> Array1:
        """Yaw (radians from local east) of a compass heading at a longitude; meridians converge."""
        return wrap_angle(np.pi / 2 - np.radians(heading_deg) + self._convergence(longitude_deg))

    def heading_of_yaw(self, yaw_rad: Array1, longitude_deg: Array1) -> Array1:
        """Compass heading in [0, 360) of a yaw at a longitude."""
        heading = np.degrees(np.pi / 2 - yaw_rad + self._convergence(longitude_deg))
        turned = np.mod(heading, 360.0)  # of a tiny negative angle, 360 itself
        return np.asarray(np.where(turned >= 360.0, 0.0, turned))

    def _convergence(self, longitude_deg: Array1) -> Array1:
        """Angle, radians, from the anchor's east to the east of the point's own meridian."""
        turn = np.radians(longitude_deg - self.longitude_deg)
        return np.asarray(np.arctan2(np.sin(np.radians(self.latitude_deg)) * np.sin(turn), np.cos(turn)))


def wrap_angle(angle_rad: Array1) -> Array1:
    """The same angle in [-pi, pi)."""
    wrapped = np.mod(angle_rad + np.pi, 2 * np.pi) - np.pi
    return np.asarray(np.where(wrapped >= np.pi, -np.pi, wrapped))


def body_to_local(east_m: Array1, north_m: Array1, yaw_rad: Array1, x_m: float, y_m: float) -> tuple[Array1, Array1]:
    """East and north of the body point (x_m forward, y_m left) of vehicles at the given poses."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return east_m + cos * x_m - sin * y_m, north_m + sin * x_m + cos * y_m


def along_cross(east_m: Array1, north_m: Array1, yaw_rad: Array1) -> tuple[Array1, Array1]:
    """A difference of places along a heading, and across it to the left."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return cos * east_m + sin * north_m, cos * north_m - sin * east_m
