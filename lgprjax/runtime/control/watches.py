"""All watches, run in each tick: actuators, line, odometer, heading, path and buttons."""

import math
from typing import NamedTuple

from lgprjax.autopilot import Event
from lgprjax.autopilot.chassis_monitors import (
    ChassisWatchState,
    PedalReading,
    PedalWatchState,
    ServoWatchState,
    WheelSensorState,
    init_wheel_sensors,
    step_chassis_watch,
    step_pedal_watch,
    step_servo_watch,
    step_wheel_sensors,
)
from lgprjax.autopilot.monitors import (
    FINDINGS,
    Dwell,
    LineWatchState,
    MotionState,
    PathWatchState,
    Severity,
    Watch,
    counted_step_s,
    curvature,
    severity_of,
    step_dwell,
    step_limit_watch,
    step_line_watch,
    step_motion,
    step_path_watch,
    yaw_gain,
)
from lgprjax.autopilot.operator_monitors import ButtonState, OperatorContact, step_buttons
from lgprjax.autopilot.position_monitors import (
    HeadingCheck,
    HeadingWatchState,
    MonitoredPosition,
    OdometerWatchState,
    step_heading_watch,
    step_odometer_watch,
)
from lgprjax.autopilot.torque import TorqueState, step_torque
from lgprjax.formats import VehicleFile
from lgprjax.runtime.config import ControlTable, RuntimeConfig
from lgprjax.runtime.control.modes import PEDALS, STEERING
from lgprjax.runtime.control.senses import BoxStatus, Sensed, chassis_belief, pedals_belief, wheel_belief

ODOMETER = Watch.ODOMETER_DEAD | Watch.ODOMETER_REVERSED | Watch.ODOMETER_SLIPS | Watch.SPEED_UNKNOWN
_TOLD = STEERING | PEDALS
_DOUBT_S = 3.0
"""Time for which wheels found bad stay distrusted while engaged: with GNSS gone the finding clears
although nothing has improved, and their zero would end a controlled stop at speed."""


class SentCommand(NamedTuple):
    """The command of the last tick."""

    front_rad: float
    throttle: float
    brake: float
    engage: int


class Watched(NamedTuple):
    """Results of the watches in a tick.

    Attributes:
        bits: findings.
        severity: largest severity of the findings.
        events: events of buttons, pedals, hands and motion, in their order.
        front_rad: angle of the front wheels by the potentiometer.
        yaw_rate_radps: yaw rate by the gyro, or without one by the wheels.
        speed_known: whether the odometer may be used.
    """

    bits: Watch
    severity: Severity
    events: list[Event]
    front_rad: float
    yaw_rate_radps: float
    speed_known: bool


class SharedWatches:
    """Watches common to all vehicles: the box's line, the buttons, the motion.

    Args:
        control: control table of the configuration.
        bits: bits of ``engage`` with which the computer controls the vehicle.
        tests_brake: whether the vehicle has a brake, which must have passed its test.
    """

    def __init__(self, control: ControlTable, bits: int, *, tests_brake: bool) -> None:
        self._control, self._bits = control, bits
        self._untested = Watch(0) if tests_brake else Watch.BRAKE_UNTESTED
        self._line, self._motion, self._buttons = LineWatchState(), MotionState(), ButtonState()

    def step(
        self,
        *,
        status_age_s: float,
        box: tuple[int, int],
        engage: int,
        statuses: tuple[int, ...],
        controller_age_s: float,
        hands: OperatorContact,
        speed_mps: float,
        step_s: float,
    ) -> tuple[Watch, list[Event]]:
        """A tick: findings, and events of buttons and motion, in their order.

        Args:
            status_age_s: age of the box's newest status; infinite before the first.
            box: bits of its state and of the functions that it holds engaged.
            engage: bits of the last command.
            statuses: buttons of the controller since the last tick, oldest first.
            controller_age_s: time since the newest status of the controller; infinite before the first.
            hands: contacts of the operator on the vehicle.
            speed_mps: trusted speed, else NaN.
            step_s: time since the last tick.
        """
        state, held = box
        self._line, bits = step_line_watch(
            self._line,
            status_age_s=status_age_s,
            box_state=state,
            box_engaged=held,
            commanded_engaged=engage & self._bits,
            step_s=step_s,
        )
        self._buttons, pressed, found = step_buttons(
            self._buttons,
            statuses=statuses,
            controller_age_s=controller_age_s,
            hands=hands,
            override_torque_nm=self._control.override_torque_nm,
            engaged=bool(engage & self._bits),
            step_s=step_s,
        )
        self._motion, moved = step_motion(
            self._motion, speed_mps=speed_mps, fastest_engage_mps=self._control.fastest_engage_mps, step_s=step_s
        )
        return (bits | found) & ~self._untested, [*pressed, *moved]


class Watches:
    """The watches' states.

    Args:
        config: configuration of the run.
        vehicle: contents of the vehicle file.

    Raises:
        InputError: a number required by the watches is not in the file.
    """

    def __init__(self, config: RuntimeConfig, vehicle: VehicleFile) -> None:
        path = config.path(config.vehicle)
        self._shared = SharedWatches(config.control, _TOLD, tests_brake=vehicle.speed_control)
        self._wheel, self._chassis = wheel_belief(vehicle, path), chassis_belief(vehicle, path)
        self._pedals = pedals_belief(vehicle, path)
        self._sensors: WheelSensorState = init_wheel_sensors()
        self._servo, self._rear, self._pedal = ServoWatchState(), ChassisWatchState(), PedalWatchState()
        self._odometer, self._path = OdometerWatchState(), PathWatchState()
        self._heading, self._torque = HeadingWatchState(), TorqueState()
        self._doubt, self._blind, self._above = Dwell(), Dwell(), Dwell()
        self._session = 0

    @property
    def torque_share(self) -> float:
        """Measured remaining share of the servo's torque."""
        return self._torque.share

    def step(
        self,
        sensed: Sensed,
        sent: SentCommand,
        now_ns: int,
        *,
        statuses: tuple[int, ...],
        controller_age_s: float,
        heading_rad: float,
        cross_track_m: float,
        estimated_mps: float,
        limit_mps: float,
    ) -> Watched:
        """Run a tick.

        Args:
            sensed: sensor data of the tick.
            sent: command of the last tick.
            now_ns: time of this tick, ns.
            statuses: buttons of the controller since the last tick, oldest first.
            controller_age_s: time since the newest status; infinite before the first.
            heading_rad: heading by GNSS/INS, NaN without one.
            cross_track_m: cross-track offset of the last tick.
            estimated_mps: speed by navigation in the last tick; NaN before there is a pose.
            limit_mps: speed limit of the last tick; NaN before there is a pose.
        """
        time_s, step_s = now_ns / 1e9, sensed.step_s
        steers = bool(sent.engage & STEERING)
        bits, front = Watch(0), math.nan
        speed, speed_known = math.nan, False
        wheels = sensed.wheels
        hands = OperatorContact(0.0, False)
        if wheels is not None:
            if wheels.frame.session != self._session:
                # A restarted box counts from zero.
                self._session = wheels.frame.session
                self._sensors, self._odometer = init_wheel_sensors(), OdometerWatchState()
            speed = wheels.number("speed_mps")
            hands = OperatorContact(wheels.number("torque_nm"), sensed.foot_on_brake)
            position = _position(sensed)
            speed_known, found = self._step_speed(sensed, wheels, position, heading_rad, time_s, sent)
            bits |= found
            front, found = self._step_wheels(wheels, sensed, sent, speed, speed_known)
            bits |= found
        self._path, found = step_path_watch(self._path, engaged=steers, cross_track_m=cross_track_m, step_s=step_s)
        bits |= found
        believed_mps = self._believed_mps(speed, bits, steers or bool(sent.engage & PEDALS), estimated_mps, step_s)
        if self._pedals is None:
            self._above, found = step_limit_watch(
                self._above, engaged=steers, speed_mps=believed_mps, limit_mps=limit_mps, step_s=step_s
            )
            bits |= found
        found, events = self._shared.step(
            status_age_s=math.inf if wheels is None else sensed.wheels_age_s,
            box=(0, 0) if wheels is None else (wheels.bits("state"), wheels.bits("engaged")),
            engage=sent.engage,
            statuses=statuses,
            controller_age_s=controller_age_s,
            hands=hands,
            speed_mps=believed_mps,
            step_s=step_s,
        )
        bits |= found
        rate = sensed.yaw_rate_radps
        if not math.isfinite(rate) and math.isfinite(front + speed):
            rate = speed * curvature(self._chassis, front) * yaw_gain(self._chassis, speed)
        return Watched(
            bits, severity_of(bits, FINDINGS), events, front, rate if math.isfinite(rate) else 0.0, speed_known
        )

    def _believed_mps(self, speed_mps: float, bits: Watch, engaged: bool, estimated_mps: float, step_s: float) -> float:
        """Speed for the detection of standstill: the wheels' while they are trusted.

        Else navigation's, which relies on GNSS; without GNSS NaN, which counts as too fast and never as standstill.
        """
        off_s, step_s = (_DOUBT_S if engaged else 0.0), counted_step_s(step_s)
        self._doubt = step_dwell(self._doubt, bool(bits & ODOMETER), step_s, on_s=0.0, off_s=off_s)
        self._blind = step_dwell(self._blind, bool(bits & Watch.SPEED_UNKNOWN), step_s, on_s=0.0, off_s=off_s)
        if self._blind.on:
            return math.nan
        return estimated_mps if self._doubt.on else speed_mps

    def _step_speed(
        self,
        sensed: Sensed,
        wheels: BoxStatus,
        position: MonitoredPosition | None,
        heading_rad: float,
        time_s: float,
        sent: SentCommand,
    ) -> tuple[bool, Watch]:
        """Odometer, heading and pedals, which depend on each other."""
        step_s, speed, way = sensed.step_s, wheels.number("speed_mps"), wheels.number("odometer_m")
        fix_yaw = None if sensed.fix is None else float(sensed.fix["pose"][3])
        found = Watch(0)
        if math.isfinite(heading_rad):
            self._heading, found = step_heading_watch(
                self._heading,
                time_s=time_s,
                odometer_m=way,
                heading_rad=heading_rad,
                position=position,
                fix_heading_rad=fix_yaw,
            )
        engaged = bool(sent.engage & PEDALS)
        self._odometer, more = step_odometer_watch(
            self._odometer,
            time_s=time_s,
            odometer_m=way,
            speed_mps=speed,
            heading_rad=heading_rad,
            heading_confirmed=self._heading.check is HeadingCheck.CONFIRMED,
            position=position,
            thrust_mps2=self._pedal.throttle.effect_mps2 if engaged else 0.0,
            step_s=step_s,
        )
        known = not more & ODOMETER
        found |= more
        if self._pedals is not None:
            self._pedal, more = step_pedal_watch(
                self._pedals,
                self._pedal,
                engaged=engaged,
                command=PedalReading(sent.throttle, sent.brake),
                measured=PedalReading(wheels.number("throttle"), wheels.number("brake")),
                speed_mps=speed,
                speed_trusted=known,
                step_s=step_s,
            )
            found |= more
        return known, found

    def _step_wheels(
        self, wheels: BoxStatus, sensed: Sensed, sent: SentCommand, speed_mps: float, speed_known: bool
    ) -> tuple[float, Watch]:
        """Wheel sensors, servo and rear steering."""
        self._sensors, angles, bits = step_wheel_sensors(
            self._wheel,
            self._sensors,
            wheels.number("potentiometer_v"),
            wheels.number("encoder_counts"),
            sensed.step_s,
        )
        self._servo, found = step_servo_watch(
            self._wheel,
            self._servo,
            angles,
            wheels.number("supply_v"),
            engaged=bool(wheels.bits("engaged") & STEERING),
            command_rad=sent.front_rad,
            step_s=sensed.step_s,
        )
        self._torque = step_torque(
            self._wheel,
            self._torque,
            self._servo,
            front_rad=angles.front_rad,
            supply_v=wheels.number("supply_v"),
            engaged=bool(wheels.bits("engaged") & STEERING),
            step_s=sensed.step_s,
        )
        self._rear, more = step_chassis_watch(
            self._chassis,
            self._rear,
            front_rad=angles.front_rad,
            yaw_rate_radps=sensed.yaw_rate_radps,
            speed_mps=speed_mps,
            speed_trusted=speed_known,
            step_s=sensed.step_s,
        )
        return angles.front_rad, bits | found | more


def _position(sensed: Sensed) -> MonitoredPosition | None:
    place = sensed.place
    return None if place is None else MonitoredPosition(place.time_ns / 1e9, place.x_m, place.y_m, place.sigma_m)
