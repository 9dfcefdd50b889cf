"""Inputs of the control loop from its lines: messages in, the numbers of a tick out.

Nothing here reads a clock: times are arrival times and the tick's own, so that a recording gives the same numbers
again.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lgprjax.autopilot.monitors import (
    ChassisBelief,
    Knots,
    PedalBelief,
    PedalsBelief,
    WheelBelief,
    linear_wheel_map,
    proportional_rear,
)
from lgprjax.errors import InputError
from lgprjax.formats import VehicleFile
from lgprjax.frames import LocalFrame
from lgprjax.run_records import Record, RecordKind, Source, fix_row
from lgprjax.runtime.config import SensorsTable
from lgprjax.runtime.gnss import GnssPosition, GnssSample, Quality, read_gnss
from lgprjax.runtime.stamps import GnssTimeScale, StampClock, WeekClock
from lgprjax.wire import Frame, decode

# GNSS/INS data: positions in a local frame, attitudes and turn rates, with their times.

_LOOSE_M = 2.0
_STATED_NS = 2_000_000_000
"""Time for which an accuracy from a separate message is used for later positions."""

_ROLL_OLD_NS = 500_000_000

_Epoch = tuple[GnssTimeScale, float]


class LocalPosition(NamedTuple):
    """A position of the antenna in the local frame.

    Attributes:
        time_ns: time of measurement, ns.
        x_m, y_m, up_m: east, north and up of the frame's anchor.
        sigma_m: white standard deviation per axis; for a fixed position from the configuration, else as reported, at
            least that.
        reported_m: reported standard deviation, at least that of the configuration, for any quality.
        quality: quality of the position.
    """

    time_ns: int
    x_m: float
    y_m: float
    up_m: float
    sigma_m: float
    reported_m: float
    quality: Quality


class LocalAttitude(NamedTuple):
    """A heading as yaw in the local frame, and roll, positive right side down; the yaw's sigma is NaN if unstated."""

    time_ns: int
    yaw_rad: float
    roll_rad: float
    sigma_yaw_rad: float = math.nan


class TurnRate(NamedTuple):
    """A yaw rate, counter-clockwise positive, and when it arrived."""

    arrival_ns: int
    radps: float


class GnssTick(NamedTuple):
    """Data of a tick; ``None`` and empty if missing."""

    place: LocalPosition | None
    attitude: LocalAttitude | None
    rates: list[TurnRate]


class _Stated(NamedTuple):
    """The accuracy of a position, from a separate message; the quality is that position's."""

    sigma_m: float
    quality: Quality
    arrival_ns: int


class GnssSenses:
    """Takes the line's messages one by one.

    Args:
        frame: frame of map or plan; ``None``: the first position becomes its anchor.
        sensors: sensor table of the configuration.
        level: whether positions are projected at the height of the frame's anchor, as for a route without heights.

        Attributes:
        place, attitude: newest position and attitude; ``None`` before the first.
        frame: frame of the positions; ``None`` before the first position if none was given.
    """

    def __init__(self, frame: LocalFrame | None, sensors: SensorsTable, *, level: bool = False) -> None:
        self.frame, self._sensors, self._level = frame, sensors, level
        # Positions are older than attitudes on arrival: each kind has its own clock.
        self._clocks: dict[tuple[str, GnssTimeScale], WeekClock] = {}
        self._longitude_deg = 0.0 if frame is None else frame.longitude_deg
        self.place: LocalPosition | None = None
        self.attitude: LocalAttitude | None = None
        self._roll: tuple[float, int] | None = None
        self._rates: list[TurnRate] = []
        self._new_place = self._new_attitude = False
        # Accuracies come before or after their position: the newest of each, and the newest matching pair.
        self._told: tuple[_Epoch, float] | None = None
        self._place_epoch: _Epoch | None = None
        self._stated: _Stated | None = None

    def take(self, record: Record) -> None:
        """Take a message of the line."""
        sample = read_gnss(record.payload)
        if sample is None:
            return
        if sample.position is not None:
            self._take_position(sample, sample.position, record.mono_ns)
        if sample.accuracy is not None:
            self._take_accuracy((sample.scale, sample.accuracy.tow_s), sample.accuracy.sigma_m, record.mono_ns)
        if sample.attitude is not None and self.frame is not None:
            turned = sample.attitude
            time_ns = self._time_of("attitude", sample.scale, turned.tow_s, record.mono_ns)
            if time_ns is not None:
                heading = np.array([turned.heading_deg])
                yaw = float(self.frame.yaw_of_heading(heading, np.array([self._longitude_deg]))[0])
                if math.isfinite(turned.roll_deg):
                    self._roll = math.radians(turned.roll_deg), record.mono_ns
                # A heading without roll (HDT, when PASHR is sent too) takes the roll of the previous message.
                roll = 0.0 if self._roll is None or record.mono_ns - self._roll[1] > _ROLL_OLD_NS else self._roll[0]
                self.attitude = LocalAttitude(time_ns, yaw, roll, math.radians(turned.sigma_heading_deg))
                self._new_attitude = True
        if sample.rate is not None:
            self._rates.append(TurnRate(record.mono_ns, sample.rate.yaw_rate_radps))

    def end_tick(self) -> GnssTick:
        """New data, which are then marked as seen."""
        rates, self._rates = self._rates, []
        tick = GnssTick(self.place if self._new_place else None, self.attitude if self._new_attitude else None, rates)
        self._new_place = self._new_attitude = False
        return tick

    def _take_position(self, sample: GnssSample, stated: GnssPosition, arrival_ns: int) -> None:
        time_ns = self._time_of("position", sample.scale, stated.tow_s, arrival_ns)
        if time_ns is None or not math.isfinite(stated.height_m):
            return
        if self.frame is None:
            self.frame = LocalFrame(stated.latitude_deg, stated.longitude_deg, stated.height_m)
        height_m = self.frame.height_m if self._level else stated.height_m
        east, north, up = self.frame.to_local(
            np.array([stated.latitude_deg]), np.array([stated.longitude_deg]), np.array([height_m])
        )
        epoch, own_m = (sample.scale, stated.tow_s), stated.sigma_m
        # A position with its own accuracy ignores that of another message.
        self._place_epoch = None if math.isfinite(own_m) else epoch
        reported_m = own_m if math.isfinite(own_m) else self._stated_m(epoch, stated.quality, arrival_ns)
        self._longitude_deg = stated.longitude_deg
        self.place = LocalPosition(
            time_ns,
            float(east[0]),
            float(north[0]),
            float(up[0]),
            *self._sigmas_m(stated.quality, reported_m),
            stated.quality,
        )
        self._new_place = True

    def _take_accuracy(self, epoch: _Epoch, sigma_m: float, arrival_ns: int) -> None:
        self._told = (epoch, sigma_m)
        place = self.place
        if place is not None and epoch == self._place_epoch:
            self._stated = _Stated(sigma_m, place.quality, arrival_ns)
            sigma, reported = self._sigmas_m(place.quality, sigma_m)
            self.place = place._replace(sigma_m=sigma, reported_m=reported)

    def _stated_m(self, epoch: _Epoch, quality: Quality, arrival_ns: int) -> float:
        """The accuracy of a position that states none itself; NaN if unknown.

        An accuracy often follows its position: until it comes, that of the previous position holds, but only briefly
            and
        only for the same quality, because the first position after a loss of the fix is metres off, not the centimetre
        of the last fixed one.
        """
        if self._told is not None and self._told[0] == epoch:
            self._stated = _Stated(self._told[1], quality, arrival_ns)
        stated = self._stated
        if stated is None or stated.quality is not quality or arrival_ns - stated.arrival_ns >= _STATED_NS:
            return math.nan
        return stated.sigma_m

    def _sigmas_m(self, quality: Quality, reported_m: float) -> tuple[float, float]:
        """``sigma_m`` and ``reported_m`` of a position; ``reported_m`` NaN: no stated accuracy."""
        least, fixed = self._sensors.gnss_sigma_m, quality is Quality.FIXED
        # Without a stated accuracy, a position that is not fixed has metres of error.
        loose = max(least, reported_m) if math.isfinite(reported_m) else _LOOSE_M
        return least if fixed else loose, least if fixed and not math.isfinite(reported_m) else loose

    def _time_of(self, what: str, scale: GnssTimeScale, tow_s: float, arrival_ns: int) -> int | None:
        """Monotonic time of a sample by its stamp; a message without one has its arrival time."""
        if scale is GnssTimeScale.NONE or not math.isfinite(tow_s):
            return arrival_ns
        delay_s = self._sensors.gnss_delay_s if what == "position" else 0.0
        clock = self._clocks.setdefault((what, scale), WeekClock(scale, delay_s))
        return clock.feed(tow_s, arrival_ns)


_RATE_OLD_S = 0.1
_FIX_OLD_S = 0.25
_STATUS_OLD_S = 0.5
_FASTEST_MPS = 60.0
_OK = 0


class BoxStatus(NamedTuple):
    """A status of the drive-by-wire box: its time on this computer's clock, and its arrival."""

    time_ns: int
    arrival_ns: int
    frame: Frame

    def number(self, name: str) -> float:
        """A field that is a number."""
        return float(self.frame.number(name))

    def bits(self, name: str) -> int:
        """A field of bits."""
        return int(self.frame.number(name))


class LineSenses:
    """Sensor data common to all vehicles: GNSS/INS and the newest status of the box.

    Args:
        frame: frame of map or plan; ``None``: the first position becomes its anchor.
        sensors: sensor table of the configuration.
        message: name of the box's status message.
        level: see ``GnssSenses``.

    Attributes:
        box: newest status; ``None`` before the first.
    """

    def __init__(self, frame: LocalFrame | None, sensors: SensorsTable, message: str, *, level: bool = False) -> None:
        self._gnss, self._stamps, self._message = GnssSenses(frame, sensors, level=level), StampClock(), message
        self.box: BoxStatus | None = None
        self._tick_ns = 0

    @property
    def place(self) -> LocalPosition | None:
        """Newest position."""
        return self._gnss.place

    @property
    def attitude(self) -> LocalAttitude | None:
        """Newest attitude."""
        return self._gnss.attitude

    @property
    def frame(self) -> LocalFrame | None:
        """Frame of the positions; ``None`` before the first if none was given."""
        return self._gnss.frame

    def take(self, record: Record) -> None:
        """A message of the GNSS/INS or of the drive-by-wire box. Others are not for the senses."""
        if record.source is Source.GNSS:
            self._gnss.take(record)
        elif record.source is Source.DRIVE_BY_WIRE:
            frame = decode(record.payload)
            time_ns = self._stamps.feed(frame.stamp_us, record.mono_ns) if frame.name == self._message else None
            if time_ns is not None:
                before, self.box = self.box, BoxStatus(time_ns, record.mono_ns, frame)
                self._take_status(self.box, anew=before is not None and before.frame.session != frame.session)

    def _take_status(self, box: BoxStatus, *, anew: bool) -> None:
        """Take a status; ``anew``: whether the box restarted and counts from zero."""

    def _step_s(self, now_ns: int) -> float:
        """A tick ends: since the last one."""
        step_s = (now_ns - self._tick_ns) / 1e9 if self._tick_ns else 0.0
        self._tick_ns = now_ns
        return step_s

    def _box_age_s(self, now_ns: int) -> float:
        """Since the newest status arrived; infinite before the first."""
        return math.inf if self.box is None else (now_ns - self.box.arrival_ns) / 1e9


class Sensed(NamedTuple):
    """Data since the last tick, and the state at its end.

    Attributes:
        step_s: time since the last tick.
        yaw_rate_radps: mean of the gyro over the tick, its last value, or NaN if that is old.
        place, attitude, fix: new data of this tick; ``None`` if missing. The fix is a row of ``FIX``.
        p_false: probability that the fix, else the newest match, is false, see ``FIX``; NaN without a match, or if
            unknown.
        odometer_mps: mean speed since the last drive_status of the previous tick; NaN without one.
        travel_lost: whether the box restarted, or its odometer jumped, so that the travel meanwhile is unknown.
        wheels: last drive_status; ``None`` before the first.
        foot_on_brake: whether a foot was on the brake in any drive_status since the last tick.
        wheels_age_s: time since the arrival of the last drive_status; infinite before the first.
    """

    step_s: float
    yaw_rate_radps: float
    place: LocalPosition | None
    attitude: LocalAttitude | None
    fix: np.void | None
    p_false: float
    odometer_mps: float
    travel_lost: bool
    wheels: BoxStatus | None
    foot_on_brake: bool
    wheels_age_s: float


NOTHING_SENSED = Sensed(
    step_s=0.0,
    yaw_rate_radps=math.nan,
    place=None,
    attitude=None,
    fix=None,
    p_false=math.nan,
    odometer_mps=math.nan,
    travel_lost=False,
    wheels=None,
    foot_on_brake=False,
    wheels_age_s=math.inf,
)
"""State before the first tick."""


class Senses(LineSenses):
    """Takes the lines' messages one by one.

    Args:
        frame: frame of the map or the routes; ``None``: the first position becomes its anchor.
        sensors: sensor table of the configuration.
        level: see ``GnssSenses``.
    """

    def __init__(self, frame: LocalFrame | None, sensors: SensorsTable, *, level: bool = False) -> None:
        super().__init__(frame, sensors, "drive_status", level=level)
        self.fix: np.void | None = None
        self.travel_m = 0.0
        self._odometer: tuple[int, float] | None = None
        self._rate = TurnRate(0, math.nan)
        self._new_fix = self._foot = self._lost = False
        self._p_false = math.nan

    def take(self, record: Record) -> None:
        """Take a message of the GNSS/INS or the drive-by-wire box, or a fix. Others are ignored."""
        if record.kind is RecordKind.FIX:
            self._take_fix(fix_row(record.payload))
        elif record.kind is RecordKind.PORT_IN:
            super().take(record)

    def _take_status(self, box: BoxStatus, *, anew: bool) -> None:
        self._foot |= bool(box.bits("pedals") & 1)
        if anew:
            self._odometer, self._lost = None, True

    def end_tick(self, now_ns: int) -> Sensed:
        """Everything since the last tick, which is then marked as seen."""
        step_s = self._step_s(now_ns)
        gnss = self._gnss.end_tick()
        if gnss.rates:
            self._rate = gnss.rates[-1]
        rate_age_s = (now_ns - self._rate.arrival_ns) / 1e9
        rate = float(np.mean([each.radps for each in gnss.rates])) if gnss.rates else self._rate.radps
        odometer_mps = self._mean_speed()
        sensed = Sensed(
            step_s=step_s,
            yaw_rate_radps=rate if rate_age_s <= _RATE_OLD_S else math.nan,
            place=gnss.place,
            attitude=gnss.attitude,
            fix=self._fresh_fix(now_ns),
            p_false=self._p_false,
            odometer_mps=odometer_mps,
            travel_lost=self._lost,
            wheels=self.box,
            foot_on_brake=self._foot,
            wheels_age_s=self._box_age_s(now_ns),
        )
        self._new_fix = self._foot = self._lost = False
        self._p_false = math.nan
        return sensed

    def _take_fix(self, fix: np.void) -> None:
        ok = int(fix["code"]) == _OK
        # A scan compared with no ground, before the first window or off the map, is no evidence; nor is one that was
        # declined for a fix of the same tick.
        if ok or (math.isfinite(float(fix["correlation"])) and not self._new_fix):
            self._p_false = float(fix["p_false"])
        if ok:
            self.fix = fix
            self._new_fix = True

    def _fresh_fix(self, now_ns: int) -> np.void | None:
        if not self._new_fix or self.fix is None:
            return None
        return self.fix if (now_ns - int(self.fix["scan_ns"])) / 1e9 <= _FIX_OLD_S else None

    def _mean_speed(self) -> float:
        """Mean speed from the box's own stamps, which do not jitter like arrivals, m/s."""
        if self.box is None:
            return math.nan
        before, here = self._odometer, (self.box.time_ns, self.box.number("odometer_m"))
        if not math.isfinite(here[1]):
            return math.nan
        self._odometer = here
        if before is None or here[0] <= before[0]:
            return math.nan
        way, step_s = here[1] - before[1], (here[0] - before[0]) / 1e9
        if abs(way) > _FASTEST_MPS * step_s:
            self._lost = True
            return math.nan
        # The odometer continues to count while no status arrives.
        self.travel_m += way
        return way / step_s if step_s <= _STATUS_OLD_S else math.nan


# The watches' model of a vehicle, from its file.


def wheel_belief(vehicle: VehicleFile, path: Path) -> WheelBelief:
    """Steering.

    Raises:
        InputError: a number required by the watches is not in the file.
    """
    stated = vehicle.steering
    largest = _needed(path, "steering.largest_wheel_angle_rad", stated.largest_wheel_angle_rad)
    if vehicle.wheel_map is not None:
        held = vehicle.wheel_map
        angles = Knots(held.first_v, held.step_v, tuple(held.front_rad))
    else:
        angles = linear_wheel_map(
            _needed(path, "steering.straight_potentiometer_v", stated.straight_potentiometer_v),
            _needed(path, "steering.potentiometer_v_per_rad", stated.potentiometer_v_per_rad),
            largest,
        )
    return WheelBelief(
        angle_of_volts=angles,
        encoder_counts_per_rad=_needed(path, "steering.encoder_counts_per_rad", stated.encoder_counts_per_rad),
        largest_rad=largest,
        lag_s=_needed(path, "steering.lag_s", stated.lag_s),
        rate_radps=_needed(path, "steering.largest_wheel_rate_radps", stated.largest_wheel_rate_radps),
        delay_s=stated.delay_s or 0.0,
        dead_band_rad=stated.dead_band_rad or 0.0,
        backlash_rad=stated.backlash_rad or 0.0,
        nominal_v=_needed(path, "steering.nominal_v", stated.nominal_v),
        stall_v=_needed(path, "steering.stall_v", stated.stall_v),
    )


def chassis_belief(vehicle: VehicleFile, path: Path) -> ChassisBelief:
    """Steering geometry.

    Raises:
        InputError: a number required by the watches is not in the file.
    """
    if vehicle.rear_map is not None:
        held = vehicle.rear_map
        rear = Knots(held.first_rad, held.step_rad, tuple(held.rear_rad))
    else:
        rear = proportional_rear(_needed(path, "steering.rear_ratio", vehicle.steering.rear_ratio))
    speed = vehicle.steering.characteristic_speed_mps
    return ChassisBelief(
        _needed(path, "chassis.wheelbase_m", vehicle.chassis.wheelbase_m), rear, math.inf if speed is None else speed
    )


def pedals_belief(vehicle: VehicleFile, path: Path) -> PedalsBelief | None:
    """Both pedals; ``None`` where the kit only steers.

    Raises:
        InputError: a number required by the watches is not in the file.
    """
    if not vehicle.speed_control:
        return None
    throttle, brake = (
        PedalBelief(
            *(
                _needed(path, f"{name}.{key}", getattr(table, key))
                for key in ("pre_tension", "dead_zone", "gain_mps2", "lag_s")
            )
        )
        for name, table in (("throttle", vehicle.throttle), ("brake", vehicle.brake))
    )
    slows = vehicle.resistance
    return PedalsBelief(
        throttle,
        brake,
        _needed(path, "resistance.rolling_mps2", slows.rolling_mps2),
        _needed(path, "resistance.drag_per_s", slows.drag_per_s),
    )


def _needed(path: Path, place: str, value: float | None) -> float:
    if value is None:
        raise InputError(path, place, "a number (run the study that estimates it first)", "none")
    return value
