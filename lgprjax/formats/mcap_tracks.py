"""Navigation and odometry of a drive from the rows of a recording's topics."""

import math
from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.errors import InputError
from lgprjax.formats.drive import NavigationTrack, OdometryTrack
from lgprjax.formats.plausible import (
    known_sigma,
    lengths_disagree,
    of_one_recording,
    path_length_m,
    plausible_positions,
    reach_in_time_m,
)
from lgprjax.formats.profile import Assumed
from lgprjax.formats.ros import (
    IMU,
    NAV_SAT_FIX,
    ODOMETRY,
    POSE,
    UNKNOWN_M2,
    UNKNOWN_RAD2,
    is_kind,
    yaw_and_roll,
)
from lgprjax.formats.survey_track import distances_m, path_headings_deg
from lgprjax.formats.travel import SmoothedTravel, smoothed_travel
from lgprjax.frames import LocalFrame, wrap_angle

# Topics of a recording for a drive: stamps and numbers, a row a message.

_NO_FIX = -1
_NO_ORIENTATION = -1.0
_LATEST_NS = 1 << 62
_ROLL, _YAW = 21, 35
"""Variances of roll and yaw in the covariance of a pose, row by row."""


class TopicRows:
    """Rows of one topic in the order of the file.

    The stamp in the header is used. If none of a topic's messages has one, the times of recording are; if only some
    have none (a sensor without time yet), these are left out.

    Attributes:
        topic, kind: topic and type of the messages.
        columns: number of values per row.
        left_out: number of messages without usable values.
        unstamped, undated, repeated, unordered: number of rows without a stamp; with a stamp of another day than most;
            with a repeated stamp; and earlier than a previous one.
    """

    def __init__(self, topic: str, kind: str, columns: int) -> None:
        self.topic = topic
        self.kind = kind
        self.columns = columns
        self.left_out = self.unstamped = self.undated = self.repeated = self.unordered = 0
        self._stamp_ns = array("q")
        self._log_ns = array("q")
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._stamp_ns)

    def add(self, values: Mapping[str, Any], log_ns: int) -> bool:
        """Add a message: its stamp, and its numbers if it is one of navigation. Returns whether it has them."""
        try:
            row = row_of(self.kind, values) if self.columns else ()
            stamp_ns = 1_000_000_000 * int(values["header.stamp.sec"]) + int(values["header.stamp.nanosec"])
            numbers = None if row is None else array("d", row)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError):
            numbers = None  # members are missing from the definition, or of another kind
        if numbers is None or not abs(stamp_ns) < _LATEST_NS:
            self.left_out += 1
            return False
        self._stamp_ns.append(stamp_ns)
        self._log_ns.append(log_ns)
        self._values.extend(numbers)
        return True

    @property
    def header_clock(self) -> bool:
        """Whether the headers' stamps are used, not the times of recording."""
        return bool(np.any(self._has_stamp()))

    def lag_s(self) -> float:
        """Median time from stamp to recording, s; zero without stamps."""
        has = self._has_stamp()
        if not np.any(has):
            return 0.0
        return float(np.median(np.asarray(self._log_ns)[has] - np.asarray(self._stamp_ns)[has])) / 1e9

    def order(self) -> Int[np.ndarray, " kept"]:
        """Rows to keep, by rising stamps; of equal stamps the first in the file."""
        times, has = self._times_ns(), self._has_stamp()
        stamped = np.flatnonzero(has | (not np.any(has)))
        usable = stamped[of_one_recording(times[stamped])]
        rising = usable[np.argsort(times[usable], kind="stable")]
        first = np.diff(times[rising], prepend=-1) != 0
        self.unstamped, self.undated = len(self) - len(stamped), len(stamped) - len(usable)
        self.repeated = int(np.count_nonzero(~first))
        self.unordered = int(np.count_nonzero(np.diff(times[usable]) < 0))
        return np.asarray(rising[first])

    def sorted(self) -> tuple[Int[np.ndarray, " kept"], Float[np.ndarray, "kept column"]]:
        """Stamps, Unix time in ns, strictly rising, and their rows."""
        order = self.order()
        return self._times_ns()[order], np.asarray(self._values).reshape(len(self), self.columns)[order]

    def _times_ns(self) -> Int[np.ndarray, " row"]:
        return np.asarray(self._stamp_ns if self.header_clock else self._log_ns).view(np.int64)

    def _has_stamp(self) -> np.ndarray:
        stamp, log = np.asarray(self._stamp_ns), np.asarray(self._log_ns)
        # Time zero itself is a stamp if it was recorded then: drives of unknown date begin there.
        return np.asarray((stamp > 0) | ((stamp == 0) & (log == 0)))


def row_of(kind: str, values: Mapping[str, Any]) -> tuple[float, ...] | None:
    """Numbers of a message of navigation; ``None`` if it has none.

    Positions: latitude and longitude (degrees), height (m), variances east, north and up (m², NaN: not known). All
    others: yaw and roll (rad) and their variances (rad², NaN: not known); odometry adds x and y (m) and speed (m/s).

    Raises:
        KeyError: the message's definition lacks a member.
    """
    if is_kind(kind, NAV_SAT_FIX):
        return _position(values)
    if is_kind(kind, IMU):
        covariance = values["orientation_covariance"]
        if covariance[0] == _NO_ORIENTATION:
            return None
        yaw, roll = _angles(values, "orientation")
        return None if math.isnan(yaw) else (yaw, roll, *_variances(covariance, 8, 0))
    yaw, roll = _angles(values, "pose.pose.orientation")
    attitude = (yaw, roll, *_variances(values["pose.covariance"], _YAW, _ROLL))
    if is_kind(kind, POSE):
        return None if math.isnan(yaw) else attitude
    places = (values["pose.pose.position.x"], values["pose.pose.position.y"], values["twist.twist.linear.x"])
    return (*attitude, *places) if all(map(math.isfinite, places)) else None


COLUMNS = {NAV_SAT_FIX: 6, IMU: 4, POSE: 4, ODOMETRY: 7}
"""Length of a row by the type of its message."""


def _position(values: Mapping[str, Any]) -> tuple[float, ...] | None:
    latitude, longitude, height = values["latitude"], values["longitude"], values["altitude"]
    if values["status.status"] == _NO_FIX or not (math.isfinite(latitude) and math.isfinite(longitude)):
        return None
    covariance = values["position_covariance"]
    known = values["position_covariance_type"] > 0  # zero for a sigma is judged with the others
    variances = (_known(covariance[i], UNKNOWN_M2) if known else math.nan for i in (0, 4, 8))
    return (latitude, longitude, height, *variances)


def _angles(values: Mapping[str, Any], path: str) -> tuple[float, float]:
    return yaw_and_roll(*(values[f"{path}.{axis}"] for axis in "xyzw"))


def _variances(covariance: np.ndarray, yaw: int, roll: int) -> tuple[float, float]:
    if not np.any(covariance):
        return math.nan, math.nan  # by the messages' definitions, all zero means unknown
    return _known(covariance[yaw], UNKNOWN_RAD2), _known(covariance[roll], UNKNOWN_RAD2)


def _known(variance: float, unknown: float) -> float:
    """A variance; NaN if its value means "unknown"."""
    return float(variance) if variance < unknown else math.nan


# Headings are not interpolated over longer gaps than this, nor over more than three usual steps of a slow source.
_LONGEST_GAP_S = 1.0
_TRAVEL_MARGIN = 2.0
"""Positions may be this much farther apart than the odometer's travel: wheels slip, and odometers have scales."""
_MOST_AGREE = 0.8
"""Share of the positions that travel must allow to judge the others: else the odometer is doubted."""


class McapAssumed(NamedTuple):
    """Quantities missing in a recording's messages, given by the user.

    Attributes:
        gnss_m: position of the GNSS antenna: forward and left of the rear axle, above the ground.
        gnss_sigma_m: standard deviation of positions without a covariance in the message; ``None`` if unknown.
        heading_sigma_deg: standard deviation of headings and rolls without one; ``None`` if unknown.
    """

    gnss_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gnss_sigma_m: float | None = None
    heading_sigma_deg: float | None = None


class TrackAttitude(NamedTuple):
    """Yaw counter-clockwise from true east, roll, radians, and their variances, at the requested times."""

    yaw_rad: Float[np.ndarray, " position"]
    roll_rad: Float[np.ndarray, " position"]
    yaw_variance: Float[np.ndarray, " position"]
    roll_variance: Float[np.ndarray, " position"]


def odometry_track(path: Path, odometry: TopicRows, t0_ns: int) -> OdometryTrack:
    """Signed travel by an odometer: its steps along its own heading, or its speeds if it has no positions.

    Raises:
        InputError: fewer than two messages, or neither orientations nor speeds.
    """
    ns, rows = odometry.sorted()
    if len(ns) < 2:
        raise InputError(path, odometry.topic, "at least 2 messages", str(len(ns)))
    time_s = (ns - t0_ns) / 1e9
    yaw, x_m, y_m, speed_mps = rows[:, 0], rows[:, 4], rows[:, 5], rows[:, 6]
    steps_m = _steps_m(x_m, y_m, yaw)
    if not (np.all(np.isfinite(steps_m)) and np.any(steps_m)):
        if np.any(np.diff(x_m) ** 2 + np.diff(y_m) ** 2) and not np.any(speed_mps):
            raise InputError(path, odometry.topic, "orientations or speeds", "positions only")
        steps_m = 0.5 * (speed_mps[1:] + speed_mps[:-1]) * np.diff(time_s)
    return OdometryTrack(time_s, np.concatenate([[0.0], np.cumsum(steps_m)]))


def navigation_track(
    path: Path,
    position: TopicRows,
    attitude: TopicRows | None,
    odometry: OdometryTrack | None,
    t0_ns: int,
    assumed: McapAssumed,
) -> tuple[NavigationTrack, tuple[str, ...]]:
    """Poses of the body origin at the times of the positions, and what was left out, in words.

    Positions that are not plausible, and those with a gap before the next heading, are left out. Without a source of
    headings they follow the path, and the roll is zero. Sigmas that neither a message nor the user states stay absent.

    Raises:
        InputError: fewer than two positions, the heading cannot be determined, or only some messages have a covariance
            that is not assumed.
    """
    ns, rows = position.sorted()
    kept, notes = _plausible_rows(position.topic, (ns - t0_ns) / 1e9, rows, odometry)
    ns, rows = ns[kept], rows[kept]
    if len(ns) < 2 and notes:
        raise InputError(path, position.topic, "at least 2 plausible positions", f"{len(ns)}: {notes[0]}")
    if attitude is not None:
        found, covered = _attitude_at(attitude, ns)
        ns, rows = ns[covered], rows[covered]
        found = TrackAttitude(*(part[covered] for part in found))
    if len(ns) < 2:
        beside = "" if attitude is None else f" within the time span of {attitude.topic}"
        raise InputError(path, position.topic, f"at least 2 positions{beside}", str(len(ns)))
    time_s = (ns - t0_ns) / 1e9
    if attitude is None:
        found = _attitude_of_path(path, position.topic, time_s, rows, odometry)
    place = position.topic
    sigmas_m = [_sigma(path, place, v, assumed.gnss_sigma_m, "--gnss-sigma-m") for v in rows[:, 3:6].T]
    degrees = None if assumed.heading_sigma_deg is None else np.radians(assumed.heading_sigma_deg)
    place = place if attitude is None else attitude.topic
    sigmas_rad = [_sigma(path, place, v, degrees, "--heading-sigma-deg") for v in found[2:]]
    latitude, longitude, height = _body_origin(rows, found, assumed.gnss_m)
    track = NavigationTrack(
        time_s=time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=np.mod(90.0 - np.degrees(found.yaw_rad), 360.0),
        roll_deg=np.degrees(found.roll_rad),
        sigma_east_m=sigmas_m[0],
        sigma_north_m=sigmas_m[1],
        sigma_height_m=sigmas_m[2],
        sigma_heading_deg=None if sigmas_rad[0] is None else np.degrees(sigmas_rad[0]),
        sigma_roll_deg=None if sigmas_rad[1] is None else np.degrees(sigmas_rad[1]),
    )
    return track, notes


def _plausible_rows(
    topic: str,
    time_s: Float[np.ndarray, " position"],
    rows: Float[np.ndarray, "position 6"],
    odometry: OdometryTrack | None,
) -> tuple[Bool[np.ndarray, " position"], tuple[str, ...]]:
    """Plausible positions, and what was left out, in words. Longitudes are brought to -180 to 180 in place."""
    variance = np.max(rows[:, 3:5], axis=1, initial=0.0)
    sigma_m = np.sqrt(known_sigma(variance))
    judged = plausible_positions(rows[:, 0], rows[:, 1], reach_in_time_m(time_s), sigma_m)
    rows[:, 1] = judged.longitude_deg
    notes = []
    if odometry is not None:
        way_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(odometry.distance_m)))])
        by_travel = plausible_positions(
            rows[:, 0], rows[:, 1], _TRAVEL_MARGIN * np.interp(time_s, odometry.time_s, way_m), sigma_m
        )
        doubted = np.count_nonzero(by_travel.kept) < _MOST_AGREE * np.count_nonzero(judged.kept)
        if doubted:
            notes.append(f"{topic}: the odometry contradicts most positions: is its scale right?")
        else:
            judged = by_travel
        inside = judged.kept & (time_s >= odometry.time_s[0]) & (time_s <= odometry.time_s[-1])
        if np.count_nonzero(inside) > 1:
            span_s = time_s[inside][[0, -1]]
            travel_m = float(np.diff(np.interp(span_s, odometry.time_s, way_m))[0])
            least_m = max(1.0, 10.0 * float(np.nan_to_num(np.nanmedian(np.append(sigma_m, 0.0)))))
            path_m = path_length_m(rows[inside, 0], rows[inside, 1], least_m)
            if lengths_disagree(travel_m, path_m) and abs(travel_m - path_m) > least_m:
                said = f"the positions are {path_m:.1f} m long, the odometry {travel_m:.1f} m"
                notes.append(f"{topic}: {said}: travel is that of the odometry, check its scale and unit")
    if judged.left_out:
        notes.append(f"{topic}: {judged.in_words()}")
    kept, has_height = judged.kept, np.isfinite(rows[:, 2])
    if np.any(has_height[kept]) and not np.all(has_height[kept]):
        notes.append(f"{topic}: left out {np.count_nonzero(kept & ~has_height)} positions without a height")
        kept = kept & has_height
    return kept, tuple(notes)


def tracks_assumed(
    position: TopicRows, attitude: TopicRows | None, travelled: SmoothedTravel | None, given: McapAssumed
) -> Assumed:
    """Assumptions about the tracks, for quantities without a message; ``travelled``: without an odometer."""
    _, rows = position.sorted()
    assumed: Assumed = {}
    if travelled is not None:
        assumed["odometry"] = travelled.in_words()
    if attitude is None:
        assumed |= {"heading": "along the path", "roll": "taken as 0"}
    if np.all(np.isnan(rows[:, 2])):
        assumed["height"] = "taken as 0"
    if not np.all(rows[:, 3:5] > 0.0):
        assumed["position sigma"] = _stands_in(given.gnss_sigma_m, "m")
    turns = None if attitude is None else attitude.sorted()[1]
    if turns is None or not np.all(turns[np.isfinite(turns[:, 0]), 2] > 0.0):
        assumed["heading sigma"] = _stands_in(given.heading_sigma_deg, "degrees")
    return assumed


def _stands_in(sigma: float | None, unit: str) -> str:
    return "not recorded" if sigma is None else f"{sigma:g} {unit} as given, where no message states it"


def travel_along(navigation: NavigationTrack) -> SmoothedTravel:
    """Signed travel by the positions themselves, along the heading: jitter while standing cancels."""
    frame = LocalFrame(
        float(navigation.latitude_deg[0]), float(navigation.longitude_deg[0]), float(navigation.height_m[0])
    )
    east, north, _ = frame.to_local(navigation.latitude_deg, navigation.longitude_deg, navigation.height_m)
    yaw = frame.yaw_of_heading(navigation.heading_deg, navigation.longitude_deg)
    along_m = np.concatenate([[0.0], np.cumsum(_steps_m(east, north, yaw))])
    return smoothed_travel(navigation.time_s, along_m)


def _steps_m(
    x_m: Float[np.ndarray, " row"], y_m: Float[np.ndarray, " row"], yaw_rad: Float[np.ndarray, " row"]
) -> Float[np.ndarray, " step"]:
    """Steps along the heading halfway: negative in reverse."""
    halfway = yaw_rad[:-1] + 0.5 * wrap_angle(np.diff(yaw_rad))
    return np.asarray(np.diff(x_m) * np.cos(halfway) + np.diff(y_m) * np.sin(halfway))


def _attitude_at(
    attitude: TopicRows, ns: Int[np.ndarray, " position"]
) -> tuple[TrackAttitude, Bool[np.ndarray, " position"]]:
    """Yaw and roll at given times, and whether they are known."""
    own, rows = attitude.sorted()
    known = np.isfinite(rows[:, :2]).all(axis=1)
    own, rows = own[known], rows[known]
    if not len(own):
        return TrackAttitude(*np.zeros((4, len(ns)))), np.zeros(len(ns), dtype=bool)
    own_s, at_s = (own - own[0]) / 1e9, (ns - own[0]) / 1e9
    gaps_s = np.diff(own_s)
    longest_s = max(_LONGEST_GAP_S, 3.0 * float(np.median(gaps_s)) if len(gaps_s) else 0.0)
    after = np.searchsorted(own, ns, side="left")
    inside = (after > 0) & (after < len(own))
    bridged = np.zeros(len(ns), dtype=bool)
    bridged[inside] = gaps_s[after[inside] - 1] <= longest_s
    covered = bridged | (own[np.minimum(after, len(own) - 1)] == ns)
    columns = (np.unwrap(rows[:, 0]), np.unwrap(rows[:, 1]), rows[:, 2], rows[:, 3])
    yaw, roll, *variances = (np.interp(at_s, own_s, column) for column in columns)
    return TrackAttitude(yaw, np.asarray(wrap_angle(roll)), *variances), covered


def _attitude_of_path(
    path: Path,
    topic: str,
    time_s: Float[np.ndarray, " position"],
    rows: Float[np.ndarray, "position 6"],
    odometry: OdometryTrack | None,
) -> TrackAttitude:
    latitude, longitude = rows[:, 0], rows[:, 1]
    travel_m = (
        distances_m(latitude, longitude)
        if odometry is None
        else np.interp(time_s, odometry.time_s, odometry.distance_m)
    )
    try:
        heading_deg = path_headings_deg(latitude, longitude, travel_m)
    except ValueError:
        expected = "a vehicle that moves, or a source of headings"
        raise InputError(path, topic, expected, "a stationary vehicle") from None
    unknown = np.full(len(time_s), np.nan)
    return TrackAttitude(np.radians(90.0 - heading_deg), np.zeros(len(time_s)), unknown, unknown)


def _sigma(
    path: Path, topic: str, variance: Float[np.ndarray, " position"], assumed: float | None, option: str
) -> Float[np.ndarray, " position"] | None:
    known = np.isfinite(known_sigma(variance))
    if assumed is None and not np.any(known):
        return None
    if assumed is None and not np.all(known):
        found = f"none in {np.count_nonzero(~known)} of {len(known)} messages"
        raise InputError(path, topic, f"a covariance, or {option}", found)
    return np.where(known, np.sqrt(np.where(known, variance, 0.0)), assumed or 0.0)


def _body_origin(
    rows: Float[np.ndarray, "position 6"], attitude: TrackAttitude, gnss_m: tuple[float, float, float]
) -> tuple[Float[np.ndarray, " position"], Float[np.ndarray, " position"], Float[np.ndarray, " position"]]:
    """Latitude, longitude and height of the body origin from those of the antenna; unknown heights are 0."""
    latitude, longitude, height = rows[:, 0], rows[:, 1], np.nan_to_num(rows[:, 2], nan=0.0)
    if not any(gnss_m):
        return latitude, longitude, height
    frame = LocalFrame(float(latitude[0]), float(longitude[0]), float(height[0]))
    east, north, up = frame.to_local(latitude, longitude, height)
    yaw = frame.yaw_of_heading(90.0 - np.degrees(attitude.yaw_rad), longitude)
    x_m, y_m, z_m = gnss_m
    cos, sin = np.cos(attitude.roll_rad), np.sin(attitude.roll_rad)
    left_m, above_m = cos * y_m - sin * z_m, sin * y_m + cos * z_m
    return frame.to_geodetic(
        east - np.cos(yaw) * x_m + np.sin(yaw) * left_m,
        north - np.sin(yaw) * x_m - np.cos(yaw) * left_m,
        up - above_m,
    )
