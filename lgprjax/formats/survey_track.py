"""Tracks of surveys: a straight line from an origin, and the heading along a measured path."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyproj
from jaxtyping import Float

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats.drive import NavigationTrack
from lgprjax.formats.profile import Assumed
from lgprjax.formats.travel import SmoothedTravel, smoothed_travel

# A survey's clock does not matter: scans are timed as if walked at this speed.
SURVEY_SPEED_MPS = 1.0
CLOCK_ASSUMED: Assumed = {"time": "unknown", "speed": f"{SURVEY_SPEED_MPS:g} m/s"}
FIRST_SAMPLE = "the first sample"
# Notes on unused input.
UNUSED_PLACE = "the latitude and longitude given were not used: the lines have their own positions"
TRACK_ASSUMED: Assumed = {"roll": "taken as 0", "position sigma": "not recorded", "heading sigma": "not recorded"}
# Headings are computed over this length of path: centimetres of noise then change them by a degree or two at most.
CHORD_M = 1.0
_GEOD = pyproj.Geod(ellps="WGS84")


class SurveyOrigin(NamedTuple):
    """Origin of a survey, WGS-84, and the direction of its lines, clockwise from true north."""

    latitude_deg: float
    longitude_deg: float
    heading_deg: float

    def check(self) -> None:
        """Raise ``ArgumentError`` unless this is a place on the earth."""
        limits = {"latitude_deg": (self.latitude_deg, 90.0), "longitude_deg": (self.longitude_deg, 360.0)}
        for name, (value, limit) in limits.items():
            if not abs(value) <= limit:
                raise ArgumentError(name, f"degrees from {-limit:g} to {limit:g}", f"{value:g}")
        if not np.isfinite(self.heading_deg):
            raise ArgumentError("heading_deg", "degrees", f"{self.heading_deg:g}")

    def assumed(self) -> Assumed:
        """Whether this is the default place, used when none is given."""
        stands_in = (self.latitude_deg, self.longitude_deg) == (0.0, 0.0)
        return {"place on the earth": "latitude 0, longitude 0"} if stands_in else {}

    def ahead(self, distance_m: float) -> "SurveyOrigin":
        """The place a distance ahead."""
        longitude, latitude, back = _GEOD.fwd(self.longitude_deg, self.latitude_deg, self.heading_deg, distance_m)
        return SurveyOrigin(latitude, longitude, (back + 180.0) % 360.0)


def unused_zone(utm_zone: str, why: str) -> str:
    """Note that a given zone was not used."""
    return f"the UTM zone {utm_zone} was not used: {why}"


def time_zero_assumed(time_zero_ns: float, window_ns: float) -> Assumed:
    """Assumption on the time zero of a format that does not record it: the first sample, unless one is given.

    Args:
        time_zero_ns: time from the first sample to time zero.
        window_ns: time from the first sample to the end of the last.

    Raises:
        ArgumentError: the time zero is not a number, or after the last sample.
    """
    if not (np.isfinite(time_zero_ns) and time_zero_ns < window_ns):
        raise ArgumentError("time_zero_ns", f"a number below the {window_ns:g} ns of a trace", f"{time_zero_ns:g}")
    return {} if time_zero_ns else {"time zero": FIRST_SAMPLE}


def utm_projection(utm_zone: str) -> pyproj.Proj:
    """Projection of a zone such as ``19N``. Raises ``ArgumentError`` if invalid."""
    parts = re.fullmatch(r"(\d{1,2})([NS])", utm_zone.strip().upper())
    if parts is None or not 1 <= int(parts[1]) <= 60:
        expected = "a number from 1 to 60 and the hemisphere, N or S, such as 19N"
        raise ArgumentError("utm_zone", expected, repr(utm_zone))
    return pyproj.Proj(proj="utm", zone=int(parts[1]), ellps="WGS84", south=parts[2] == "S")


def check_utm(file: Path, place: str, east_m: Float[np.ndarray, "..."], north_m: Float[np.ndarray, "..."]) -> None:
    """Raise ``InputError`` for metres that no UTM zone has."""
    east, north = ((float(values.min()), float(values.max())) for values in (east_m, north_m))

    def fits(easting: tuple[float, float], northing: tuple[float, float]) -> bool:
        return easting[0] >= 1e5 and easting[1] <= 9e5 and northing[0] >= 0.0 and northing[1] <= 1e7

    if fits(east, north):
        return
    found = f"eastings {east[0]:.6g} to {east[1]:.6g}, northings {north[0]:.6g} to {north[1]:.6g}"
    hint = "; are they exchanged?" if fits(north, east) else ""
    raise InputError(file, place, "UTM metres (easting 100000 to 900000, northing 0 to 10000000)", found + hint)


def straight_track(
    along_m: Float[np.ndarray, " scan"], place: SurveyOrigin, time_s: Float[np.ndarray, " scan"]
) -> NavigationTrack:
    """Poses on the geodesic that leaves a place along its heading; ``along_m`` may fall and be negative."""
    count = len(along_m)
    longitude, latitude = np.full(count, place.longitude_deg), np.full(count, place.latitude_deg)
    heading = np.full(count, place.heading_deg)
    longitudes, latitudes, back = _GEOD.fwd(longitude, latitude, heading, along_m)
    return track(time_s, np.asarray(latitudes), np.asarray(longitudes), (np.asarray(back) + 180.0) % 360.0)


def track(
    time_s: Float[np.ndarray, " scan"],
    latitude_deg: Float[np.ndarray, " scan"],
    longitude_deg: Float[np.ndarray, " scan"],
    heading_deg: Float[np.ndarray, " scan"],
    height_m: Float[np.ndarray, " scan"] | None = None,
) -> NavigationTrack:
    """Poses without roll, at height 0 if none is given. A survey states no sigmas (``TRACK_ASSUMED``)."""
    zeros = np.zeros(len(time_s))
    return NavigationTrack(
        time_s=time_s,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        height_m=zeros if height_m is None else height_m,
        heading_deg=heading_deg,
        roll_deg=zeros,
    )


def distances_m(
    latitude_deg: Float[np.ndarray, " scan"], longitude_deg: Float[np.ndarray, " scan"]
) -> Float[np.ndarray, " scan"]:
    """Cumulative length of a path, from 0."""
    steps = _GEOD.inv(longitude_deg[:-1], latitude_deg[:-1], longitude_deg[1:], latitude_deg[1:])[2]
    return np.concatenate([[0.0], np.cumsum(steps)])


def path_lengths_m(
    kind: str, x: Float[np.ndarray, " trace"], y: Float[np.ndarray, " trace"]
) -> Float[np.ndarray, " trace"]:
    """Cumulative length of a path, m from 0, in ``degrees`` (x longitude) or in metres of a plane."""
    if kind == "degrees":
        return distances_m(y, x)
    return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])


def path_headings_deg(
    latitude_deg: Float[np.ndarray, " scan"],
    longitude_deg: Float[np.ndarray, " scan"],
    travel_m: Float[np.ndarray, " scan"],
) -> Float[np.ndarray, " scan"]:
    """Heading of the vehicle along its path, clockwise from true north, in [0, 360).

    ``travel_m`` is signed: where it falls the vehicle reverses and its heading is opposite to its motion. While
    standing it keeps its heading. For this the path is unfolded as if every step had been driven forward, and the
    heading is the direction of a chord of it.

    Raises:
        ValueError: the path never moves.
    """
    plane = pyproj.Proj(proj="aeqd", ellps="WGS84", lat_0=float(latitude_deg[0]), lon_0=float(longitude_deg[0]))
    east_north = np.stack(plane(longitude_deg, latitude_deg), axis=1)
    travelled = np.diff(travel_m)
    unrolled = np.cumsum(np.diff(east_north, axis=0) * np.sign(travelled)[:, None], axis=0)
    length_m = np.cumsum(np.abs(travelled))
    moving = np.abs(travelled) > 0
    knots = np.concatenate([[0.0], length_m[moving]])
    points = np.concatenate([np.zeros((1, 2)), unrolled[moving]])
    at = np.concatenate([[0.0], length_m])
    ahead, behind = (
        np.stack([np.interp(at + half, knots, points[:, axis]) for axis in (0, 1)], axis=1)
        for half in (CHORD_M / 2, -CHORD_M / 2)
    )
    chord = ahead - behind
    known = np.flatnonzero(np.hypot(chord[:, 0], chord[:, 1]) > 0)
    if not known.size:
        raise ValueError("the path never moves")
    held = known[np.clip(np.searchsorted(known, np.arange(len(at)), side="right") - 1, 0, None)]
    # Meridians converge: true north deviates from the plane's by this much.
    turn_deg = (longitude_deg - longitude_deg[0] + 180.0) % 360.0 - 180.0
    convergence_deg = turn_deg * np.sin(np.deg2rad(latitude_deg))
    headings: np.ndarray = (np.rad2deg(np.arctan2(chord[held, 0], chord[held, 1])) + convergence_deg) % 360.0
    return headings


def travel_along_path(
    latitude_deg: Float[np.ndarray, " scan"], longitude_deg: Float[np.ndarray, " scan"]
) -> SmoothedTravel:
    """Travel of a vehicle that never reverses, by its positions: steps along its heading, smoothed, never falling.

    The length of the path itself would be too long: every step of it has the positions' noise.

    Raises:
        ValueError: the path never moves.
    """
    heading = np.radians(path_headings_deg(latitude_deg, longitude_deg, distances_m(latitude_deg, longitude_deg)))
    azimuth, _, step_m = _GEOD.inv(longitude_deg[:-1], latitude_deg[:-1], longitude_deg[1:], latitude_deg[1:])
    halfway = np.unwrap(heading)
    along_m = step_m * np.cos(np.radians(azimuth) - 0.5 * (halfway[1:] + halfway[:-1]))
    smooth = smoothed_travel(np.arange(len(heading), dtype=np.float64), np.concatenate([[0.0], np.cumsum(along_m)]))
    return smooth._replace(distance_m=np.maximum.accumulate(smooth.distance_m))
