"""What a recording holds of each topic that a drive can be made of: stamps and numbers, a row a message."""

import math
from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lgprjax.formats.ros_messages import IMU, NAV_SAT_FIX, ODOMETRY, POSE, is_kind, yaw_and_roll

_NO_FIX = -1
_NO_ORIENTATION = -1.0
_LATEST_NS = 1 << 62
_ROLL, _YAW = 21, 35
"""Variances of roll and yaw in the covariance of a pose, row by row."""


class TopicRows:
    """Rows of one topic in the order of the file.

    A stamp in the header counts. Where none of a topic's messages has one, the times of recording do; where only some
    have none (a sensor that had not heard of the time yet), these are left out.

    Attributes:
        topic, kind: of the messages.
        columns: numbers a row.
        left_out: messages without usable values.
        unstamped, repeated, unordered: rows without a stamp; with a stamp that another had; earlier than one before.
    """

    def __init__(self, topic: str, kind: str, columns: int) -> None:
        self.topic = topic
        self.kind = kind
        self.columns = columns
        self.left_out = self.unstamped = self.repeated = self.unordered = 0
        self._stamp_ns = array("q")
        self._log_ns = array("q")
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._stamp_ns)

    def add(self, values: Mapping[str, Any], log_ns: int) -> bool:
        """Take a message: its stamp, and its numbers where it is one of navigation. Whether it held them."""
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
        """Whether the headers' stamps count, not the times of recording."""
        return bool(np.any(self._has_stamp()))

    def lag_s(self) -> float:
        """Median time from stamp to recording, s; zero where there are no stamps."""
        has = self._has_stamp()
        if not np.any(has):
            return 0.0
        return float(np.median(np.asarray(self._log_ns)[has] - np.asarray(self._stamp_ns)[has])) / 1e9

    def order(self) -> Int[np.ndarray, " kept"]:
        """Rows to keep, by rising stamps; of those of one stamp the first in the file."""
        times, has = self._times_ns(), self._has_stamp()
        usable = np.flatnonzero(has | (not np.any(has)))
        rising = usable[np.argsort(times[usable], kind="stable")]
        first = np.diff(times[rising], prepend=-1) != 0
        self.unstamped = len(self) - len(usable)
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
        # Time zero itself is a stamp where it was recorded then: drives whose moment is not known begin there.
        return np.asarray((stamp > 0) | ((stamp == 0) & (log == 0)))


def row_of(kind: str, values: Mapping[str, Any]) -> tuple[float, ...] | None:
    """Numbers of a message of navigation; ``None`` where it holds none.

    Positions: latitude and longitude (degrees), height (m), variances east, north and up (m², NaN: not known). All
    others: yaw and roll (rad) and their variances (rad², NaN: not known); odometry adds x and y (m) and speed (m/s).

    Raises:
        KeyError: its definition lacks a member.
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
    if values["status.status"] == _NO_FIX or not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0):
        return None
    covariance = values["position_covariance"]
    known = values["position_covariance_type"] > 0
    variances = (float(covariance[i]) if known else math.nan for i in (0, 4, 8))
    return (latitude, longitude, height, *variances)


def _angles(values: Mapping[str, Any], path: str) -> tuple[float, float]:
    return yaw_and_roll(*(values[f"{path}.{axis}"] for axis in "xyzw"))


def _variances(covariance: np.ndarray, yaw: int, roll: int) -> tuple[float, float]:
    if not np.any(covariance):
        return math.nan, math.nan  # as the messages' definitions have it: all zero is not known
    return float(covariance[yaw]), float(covariance[roll])
