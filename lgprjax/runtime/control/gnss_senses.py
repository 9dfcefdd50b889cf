"""What the GNSS/INS says: positions in a local frame, attitudes and turning rates, with the times they are of."""

import math
from typing import NamedTuple

import numpy as np

from lgprjax.frames import LocalFrame
from lgprjax.runtime.config import SensorsTable
from lgprjax.runtime.gnss_samples import GnssSample, Position, Quality, read_gnss
from lgprjax.runtime.records import Record
from lgprjax.runtime.stamps import TimeScale, WeekClock

_LOOSE_M = 2.0


class Place(NamedTuple):
    """A position of the antenna in the local frame.

    Attributes:
        time_ns: of its measuring.
        x_m, y_m, up_m: east, north and up of the frame's anchor.
        sigma_m: white, an axis; of a fixed position that of the configuration, else as reported, at least that.
        reported_m: sigma as reported, at least that of the configuration, whatever the quality.
        quality: of the position.
    """

    time_ns: int
    x_m: float
    y_m: float
    up_m: float
    sigma_m: float
    reported_m: float
    quality: Quality


class Attitude(NamedTuple):
    """A heading as yaw in the local frame, and roll, positive right side down."""

    time_ns: int
    yaw_rad: float
    roll_rad: float


class TurnRate(NamedTuple):
    """A yaw rate, counter-clockwise positive, and when it arrived."""

    arrival_ns: int
    radps: float


class GnssTick(NamedTuple):
    """What came in a tick; ``None`` and empty where nothing did."""

    place: Place | None
    attitude: Attitude | None
    rates: list[TurnRate]


class GnssSenses:
    """The line's messages, taken one by one.

    Args:
        frame: of map or plan; without one the first position becomes its anchor.
        sensors: of the configuration.

    Attributes:
        place, attitude: the newest of all; ``None`` before the first.
        frame: that they are in; ``None`` before the first position where none was given.
    """

    def __init__(self, frame: LocalFrame | None, sensors: SensorsTable) -> None:
        self.frame, self._sensors = frame, sensors
        # Positions are older than attitudes when they come: each kind has a clock of its own.
        self._clocks: dict[tuple[str, TimeScale], WeekClock] = {}
        self._longitude_deg = 0.0 if frame is None else frame.longitude_deg
        self.place: Place | None = None
        self.attitude: Attitude | None = None
        self._rates: list[TurnRate] = []
        self._new_place = self._new_attitude = False
        self._accuracy_m = math.nan

    def take(self, record: Record) -> None:
        """A message of the line."""
        sample = read_gnss(record.payload)
        if sample is None:
            return
        if sample.position is not None:
            self._take_position(sample, sample.position, record.mono_ns)
        if sample.accuracy is not None:
            self._accuracy_m = sample.accuracy.sigma_m
        if sample.attitude is not None and self.frame is not None:
            turned = sample.attitude
            time_ns = self._time_of("attitude", sample.scale, turned.tow_s, record.mono_ns)
            if time_ns is not None:
                heading = np.array([turned.heading_deg])
                yaw = float(self.frame.yaw_of_heading(heading, np.array([self._longitude_deg]))[0])
                roll = math.radians(turned.roll_deg) if math.isfinite(turned.roll_deg) else 0.0
                self.attitude = Attitude(time_ns, yaw, roll)
                self._new_attitude = True
        if sample.rate is not None:
            self._rates.append(TurnRate(record.mono_ns, sample.rate.yaw_rate_radps))

    def end_tick(self) -> GnssTick:
        """What is new; it is no longer."""
        rates, self._rates = self._rates, []
        tick = GnssTick(self.place if self._new_place else None, self.attitude if self._new_attitude else None, rates)
        self._new_place = self._new_attitude = False
        return tick

    def _take_position(self, sample: GnssSample, told: Position, arrival_ns: int) -> None:
        time_ns = self._time_of("position", sample.scale, told.tow_s, arrival_ns)
        if time_ns is None or told.quality is Quality.NONE:
            return
        if self.frame is None:
            self.frame = LocalFrame(told.latitude_deg, told.longitude_deg, told.height_m)
        east, north, up = self.frame.to_local(
            np.array([told.latitude_deg]), np.array([told.longitude_deg]), np.array([told.height_m])
        )
        least = self._sensors.gnss_sigma_m
        reported = told.sigma_m if math.isfinite(told.sigma_m) else self._accuracy_m
        # Without a word of how good it is, a position that is not fixed is one of metres.
        loose = max(least, reported) if math.isfinite(reported) else _LOOSE_M
        fixed = told.quality is Quality.FIXED
        honest = least if fixed and not math.isfinite(reported) else loose
        self._longitude_deg = told.longitude_deg
        self.place = Place(
            time_ns,
            float(east[0]),
            float(north[0]),
            float(up[0]),
            least if fixed else loose,
            honest,
            told.quality,
        )
        self._new_place = True

    def _time_of(self, what: str, scale: TimeScale, tow_s: float, arrival_ns: int) -> int | None:
        """By the sample's stamp; a message without one is as old as its way is long."""
        if scale is TimeScale.NONE or not math.isfinite(tow_s):
            return arrival_ns
        delay_s = self._sensors.gnss_delay_s if what == "position" else 0.0
        clock = self._clocks.setdefault((what, scale), WeekClock(scale, delay_s))
        return clock.feed(tow_s, arrival_ns)
