"""The counter-steered vehicle in the control loop: driven along a route by LGPR, GNSS and INS."""

import math
from typing import Any

from lgprjax.autopilot import Check, Event, Limited
from lgprjax.autopilot.watch_findings import REFUSING, Severity, Watch, describe
from lgprjax.autopilot.watch_line import BoxState
from lgprjax.navigation import PlanCode, Reaction
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.checks import CheckItem
from lgprjax.runtime.control.mode_keeper import CUT, PEDALS
from lgprjax.runtime.control.panel import Panel, words_of
from lgprjax.runtime.control.pilot import Ordered, Pilot
from lgprjax.runtime.control.processes import Processes
from lgprjax.runtime.control.rows import plan_row, prior_row, whole
from lgprjax.runtime.control.senses import Sensed, Senses
from lgprjax.runtime.control.setup import Loaded
from lgprjax.runtime.control.vehicle_kind import Frame, Look, Operator, Wish
from lgprjax.runtime.control.watches import Sent, Watched, Watches
from lgprjax.runtime.records import Kind, Record, fix_row

_OLD_NS = 300_000_000
_DEGRADED_MPS = 2.0
_SCANS_NS = 200_000_000
_LINE = Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.DEFAULTS_ACT | Watch.SECOND_SENDER
_PLACES = {
    PlanCode.FOLLOWING: Event.ROUTE_NEAR,
    PlanCode.AT_CUSP: Event.ROUTE_NEAR,
    PlanCode.DONE: Event.ROUTE_OFF,
    PlanCode.OFF_ROUTE: Event.ROUTE_OFF,
    PlanCode.AMBIGUOUS: Event.ROUTE_AMBIGUOUS,
    PlanCode.WRONG_HEADING: Event.ROUTE_WRONG_HEADING,
    PlanCode.LOST: Event.ROUTE_OFF,
    PlanCode.NON_FINITE: Event.ROUTE_OFF,
}

_NOTHING = Sensed(0.0, math.nan, math.inf, None, None, None, math.nan, math.nan, None, False, math.inf)


class CounterSteer:
    """See ``VehicleKind``.

    Args:
        config: of the run.
        loaded: its files.

    Attributes:
        pilot: navigation and autopilot; senses: what came.

    Raises:
        InputError: the vehicle file lacks a number.
    """

    def __init__(self, config: RuntimeConfig, loaded: Loaded) -> None:
        self.senses = Senses(loaded.frame, config.sensors)
        self.pilot = Pilot(loaded, config.control, config.sensors)
        self._watches = Watches(config, loaded.vehicle)
        self._panel = Panel(loaded.routes)
        self._sent = Sent(0.0, 0.0, 0.0, 0)
        self._fix_ns: int | None = None
        self._now_ns = 0
        self._sensed: Sensed = _NOTHING
        self._watched = Watched(Watch(0), Severity.CONTINUE, [], math.nan, 0.0, False)

    @property
    def lock_mps(self) -> float:
        """As fast as it drives."""
        speed = self.pilot.result.speed_mps
        return speed if math.isfinite(speed) else 0.0

    def warm_up(self) -> None:
        """Compile all that a tick may need."""
        self.pilot.warm_up()

    def take(self, record: Record, tick: int) -> None:
        """A message of the box or the GNSS/INS, or a fix."""
        self.senses.take(record)
        if record.kind is Kind.FIX:
            fix = fix_row(record.payload)
            self._fix_ns = record.mono_ns
            self._panel.take_fix(tick, int(fix["code"]), float(fix["correlation"]))

    def feel(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of what came."""
        self._now_ns = now_ns
        self._sensed = sensed = self.senses.end_tick(now_ns)
        place, attitude = self.senses.place, self.senses.attitude
        self._watched = watched = self._watches.step(
            sensed,
            self._sent,
            now_ns,
            statuses=operator.statuses,
            controller_age_s=operator.age_s,
            heading_rad=math.nan if attitude is None or now_ns - attitude.time_ns > _OLD_NS else attitude.yaw_rad,
            cross_track_m=self.pilot.result.offset_m,
        )
        if not self.pilot.started and place is not None and attitude is not None:
            self.pilot.start(place, attitude, watched.front_rad)
        return watched.events

    def look(self, *, decided: bool) -> Look:
        """As it is now."""
        result, watched, wheels = self.pilot.result, self._watched, self._sensed.wheels
        limited = whole(result.limited) if decided else 0
        # Before the box was first heard its silence is the checks' affair.
        heard = wheels is not None
        bits = watched.bits if heard else watched.bits & ~Watch.LINE_SILENT
        severity = watched.severity if heard else Severity.CONTINUE
        place, attitude, now_s = self.senses.place, self.senses.attitude, self._now_ns / 1e9
        ages = [
            now_s - (0.0 if place is None else place.time_ns / 1e9),
            now_s - (0.0 if attitude is None else attitude.time_ns / 1e9),
            self._sensed.wheels_age_s if heard else math.inf,
        ]
        contradicted = bool(bits & Watch.HEADING_CONTRADICTED)
        return Look(
            self.pilot.started,
            Event.ROUTE_WRONG_HEADING if contradicted else _PLACES[self.pilot.code],
            bool(bits & Watch.HEADING_UNCONFIRMED) or contradicted,
            whole(result.reaction, int(Reaction.STOP)),
            max(ages),
            not bits & _LINE,
            severity,
            severity >= Severity.MANUAL and bool(bits & ~_LINE),
            watched.severity is Severity.EMERGENCY,
            bool(bits & REFUSING),
            bool(limited & Limited.MANUAL_REQUESTED),
            [*describe(watched.bits), *words_of(result), *_limits(limited)],
        )

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Every system check as it stands."""
        wheels, found = self._sensed.wheels, self._watched.bits
        state = BoxState.NO_POWER if wheels is None else BoxState(wheels.bits("state"))
        line = Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.ACTUATOR_FAULT
        sensors = Watch.POTENTIOMETER_RANGE | Watch.POTENTIOMETER_STUCK | Watch.WHEEL_SENSORS_APART
        place, attitude = self.senses.place, self.senses.attitude
        second = bool(found & Watch.SECOND_SENDER)
        here = self.pilot.started and place is not None and attitude is not None
        unrecorded = processes.silent("recorder") and processes.mandatory
        return [
            CheckItem(Check.SECOND_MASTER, not second, "another sender commands the drive-by-wire box"),
            CheckItem(
                Check.DRIVE_BY_WIRE,
                wheels is not None and not found & line,
                "; ".join(describe(found & line)) or "the drive-by-wire box is silent",
            ),
            CheckItem(
                Check.STEERING_SENSORS,
                wheels is not None and math.isfinite(self._watched.front_rad) and not found & sensors,
                "; ".join(describe(found & sensors)) or "no wheel angle",
            ),
            CheckItem(Check.GNSS_INS, here, "no position or no heading"),
            CheckItem(Check.LGPR, not processes.silent("registration"), "the registration process is not ready"),
            CheckItem(Check.STORAGE, not unrecorded, "nothing is being recorded"),
            CheckItem(Check.BRAKE, bool(state & BoxState.BRAKE_TESTED), "the braking test has not passed"),
        ]

    def decide(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""
        watched, sensed = self._watched, self._sensed
        if not watched.speed_known:
            sensed = sensed._replace(odometer_mps=math.nan)
        slow = wish.slowly or watched.severity is Severity.DEGRADE or self._scans_missing
        ordered = Ordered(
            wish.engaged,
            wish.drives,
            wish.stop,
            _DEGRADED_MPS if slow else math.inf,
            wish.set_speed_mps,
            watched.front_rad,
            max(sensed.wheels_age_s, min(sensed.rate_age_s, sensed.wheels_age_s)),
            watched.yaw_rate_radps,
        )
        self.pilot.step(sensed, ordered, now_ns)

    def command(self, engage: int) -> Frame:
        """What is sent."""
        result = self.pilot.result
        numbers = (result.front_rad, result.throttle, result.brake)
        if not all(math.isfinite(number) for number in numbers):
            # Only before there is a pose, when nothing can be engaged.
            front = self._watched.front_rad if math.isfinite(self._watched.front_rad) else 0.0
            numbers, engage = (front, 0.0, 0.0), engage & CUT
        front, throttle, brake = numbers
        if not engage & PEDALS:
            throttle = brake = 0.0
        self._sent = Sent(front, throttle, brake, engage)
        return Frame("drive_command", self._sent._asdict())

    def rows(self, now_ns: int, mode: int) -> list[tuple[Kind, bytes]]:
        """The prior for registration, and the plan."""
        result, attitude = self.pilot.result, self.senses.attitude
        rows: list[tuple[Kind, bytes]] = []
        if self.pilot.started:
            prior = prior_row(
                result,
                now_ns,
                roll_rad=0.0 if attitude is None else attitude.roll_rad,
                yaw_rate_radps=self._sensed.yaw_rate_radps,
                travel_m=self.senses.travel_m,
            )
            rows.append((Kind.PRIOR, prior))
        return [*rows, (Kind.PLAN, plan_row(result, self._watched, self._sent, mode=mode, code=self.pilot.code))]

    def state(self, tick: int) -> dict[str, Any]:
        """What the display shows of it."""
        return self._panel.state(tick, self.pilot.route, self.pilot.result)

    def warnings(self) -> list[str]:
        """What the operator should know."""
        missing = ["no scans: radar, its line or registration"] if self._scans_missing else []
        return [*describe(self._watched.bits), *missing]

    def refusal_text(self) -> str:
        """The modes say it."""
        return ""

    def notes(self) -> list[dict[str, Any]]:
        """None."""
        return []

    def release(self, engage: int) -> Frame:
        """The last command of all."""
        return Frame("drive_command", Sent(self._sent.front_rad, 0.0, 0.0, engage)._asdict())

    def leave(self) -> None:
        """The operator drives."""
        self.pilot.leave()

    def choose(self, name: str) -> bool:
        """Another route."""
        return self.pilot.choose(name)

    @property
    def _scans_missing(self) -> bool:
        """No scan has been searched for a while: the radar, its line, or the registration process."""
        return self._fix_ns is not None and self._now_ns - self._fix_ns > _SCANS_NS


def _limits(limited: int) -> list[str]:
    bad = Limited(limited) & (Limited.NOT_FINITE | Limited.STALE | Limited.MANUAL_REQUESTED)
    return [f"command: {str(bit.name).lower().replace('_', ' ')}" for bit in bad]
