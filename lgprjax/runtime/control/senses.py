"""What the control loop knows of the world by its lines: messages in, the numbers of a tick out.

Nothing here reads a clock: times are those with which messages arrived and the tick's own, so that a recording of them
gives the same numbers again.
"""

import math
from typing import NamedTuple

import numpy as np

from lgprjax.frames import LocalFrame
from lgprjax.runtime.config import SensorsTable
from lgprjax.runtime.control.gnss_senses import Attitude, GnssSenses, Place, TurnRate
from lgprjax.runtime.records import Kind, Record, Source, fix_row
from lgprjax.runtime.stamps import StampClock
from lgprjax.runtime.wire import Frame, decode

_RATE_OLD_S = 0.1
_FIX_OLD_S = 0.25
_OK = 0


class Wheels(NamedTuple):
    """The last drive_status, and when it was so on this computer's clock."""

    time_ns: int
    frame: Frame

    def number(self, name: str) -> float:
        """A field that is a number."""
        return float(self.frame.number(name))

    def bits(self, name: str) -> int:
        """A field of bits."""
        return int(self.frame.number(name))


class Sensed(NamedTuple):
    """What came since the last tick, and what is known at its end.

    Attributes:
        step_s: since the last tick.
        yaw_rate_radps: mean of the gyro over the tick, its last value, or NaN where that is old.
        rate_age_s: of the newest value.
        place, attitude, fix: new in this tick; ``None`` where there is none. The fix is a row of ``FIX``.
        p_false: of the newest match, see ``FIX``; NaN where nothing was matched, or where it is not known.
        odometer_mps: mean speed since the last drive_status of the tick before; NaN where none came.
        wheels: the last drive_status; ``None`` before the first.
        foot_on_brake: in any drive_status since the last tick.
        wheels_age_s: since it arrived.
    """

    step_s: float
    yaw_rate_radps: float
    rate_age_s: float
    place: Place | None
    attitude: Attitude | None
    fix: np.void | None
    p_false: float
    odometer_mps: float
    wheels: Wheels | None
    foot_on_brake: bool
    wheels_age_s: float


class Senses:
    """The lines' messages, taken one by one.

    Args:
        frame: of the map.
        sensors: of the configuration.
    """

    def __init__(self, frame: LocalFrame, sensors: SensorsTable) -> None:
        self._gnss = GnssSenses(frame, sensors)
        self._box = StampClock()
        self.wheels: Wheels | None = None
        self.fix: np.void | None = None
        self.travel_m = 0.0
        self._odometer: tuple[int, float] | None = None
        self._wheels_arrived_ns = 0
        self._rate = TurnRate(0, math.nan)
        self._new_fix = self._foot = False
        self._p_false = math.nan
        self._tick_ns = 0

    @property
    def place(self) -> Place | None:
        """The newest position of all."""
        return self._gnss.place

    @property
    def attitude(self) -> Attitude | None:
        """The newest attitude of all."""
        return self._gnss.attitude

    def take(self, record: Record) -> None:
        """A message: of the GNSS/INS, of the drive-by-wire box, or a fix. Others are not for the senses."""
        if record.kind is Kind.FIX:
            self._take_fix(fix_row(record.payload))
        elif record.kind is Kind.PORT_IN and record.source is Source.GNSS:
            self._gnss.take(record)
        elif record.kind is Kind.PORT_IN and record.source is Source.DRIVE_BY_WIRE:
            frame = decode(record.payload)
            time_ns = self._box.feed(frame.stamp_us, record.mono_ns) if frame.name == "drive_status" else None
            if time_ns is not None:
                self.wheels = Wheels(time_ns, frame)
                self._wheels_arrived_ns = record.mono_ns
                self._foot |= bool(int(frame.number("pedals")) & 1)

    def end_tick(self, now_ns: int) -> Sensed:
        """Everything since the last tick; what was new is no longer."""
        step_s = (now_ns - self._tick_ns) / 1e9 if self._tick_ns else 0.0
        self._tick_ns = now_ns
        gnss = self._gnss.end_tick()
        if gnss.rates:
            self._rate = gnss.rates[-1]
        rate_age_s = (now_ns - self._rate.arrival_ns) / 1e9
        rate = float(np.mean([each.radps for each in gnss.rates])) if gnss.rates else self._rate.radps
        sensed = Sensed(
            step_s,
            rate if rate_age_s <= _RATE_OLD_S else math.nan,
            rate_age_s,
            gnss.place,
            gnss.attitude,
            self._fresh_fix(now_ns),
            self._p_false,
            self._mean_speed(),
            self.wheels,
            self._foot,
            (now_ns - self._wheels_arrived_ns) / 1e9,
        )
        self._new_fix = self._foot = False
        self._p_false = math.nan
        return sensed

    def _take_fix(self, fix: np.void) -> None:
        # A scan that was compared with no ground, before the first window or off the map, says nothing of any.
        if math.isfinite(float(fix["correlation"])):
            self._p_false = float(fix["p_false"])
        if int(fix["code"]) == _OK:
            self.fix = fix
            self._new_fix = True

    def _fresh_fix(self, now_ns: int) -> np.void | None:
        if not self._new_fix or self.fix is None:
            return None
        return self.fix if (now_ns - int(self.fix["scan_ns"])) / 1e9 <= _FIX_OLD_S else None

    def _mean_speed(self) -> float:
        """Between the box's own stamps, which do not jitter as arrivals do."""
        if self.wheels is None:
            return math.nan
        before, here = self._odometer, (self.wheels.time_ns, self.wheels.number("odometer_m"))
        self._odometer = here
        if before is None or here[0] <= before[0] or here[0] - before[0] > 500_000_000:
            return math.nan
        way = here[1] - before[1]
        if not math.isfinite(way):
            return math.nan
        self.travel_m += way
        return way / ((here[0] - before[0]) / 1e9)
