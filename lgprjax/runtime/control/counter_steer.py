"""The counter-steered vehicle in the control loop: driven along a route by LGPR, GNSS and INS."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from lgprjax.autopilot import Check, Event, Limited
from lgprjax.autopilot.monitors import FINDINGS, REFUSING, BoxState, Severity, Watch, describe
from lgprjax.navigation import OF_GNSS, OF_LGPR, PlanCode, Reaction, Reason
from lgprjax.registration import Code
from lgprjax.run_records import PLAN, POSE, PRIOR, Record, RecordKind, fix_row
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.compiled import TickResult
from lgprjax.runtime.control.modes import CUT, PEDALS, CheckItem
from lgprjax.runtime.control.pilot import Ordered, Pilot, is_sure
from lgprjax.runtime.control.places import Place, line_of, same_place
from lgprjax.runtime.control.senses import NOTHING_SENSED, LocalAttitude, LocalPosition, Sensed, Senses
from lgprjax.runtime.control.setup import LaidRoute, Loaded
from lgprjax.runtime.control.vehicle_kind import (
    LINE,
    Operator,
    OutgoingFrame,
    Processes,
    VehicleStatus,
    Wish,
    box_checks,
)
from lgprjax.runtime.control.watches import SentCommand, Watched, Watches
from lgprjax.runtime.words import ARRIVED, limited_words, reason_words, whole

# The control loop's state for the display.


_OLD_TICKS = 25
"""Half a second: what the page shows of a scan is not older."""


class Panel:
    """Keeps display data in addition to the tick's numbers.

    Args:
        routes: routes of the configuration.
        lgpr: whether there is a map to match scans with.
    """

    def __init__(self, routes: list[LaidRoute], *, lgpr: bool = True) -> None:
        self._routes, self._lgpr = routes, lgpr
        self._listed = [
            {"name": route.name, "length_m": round(route.length_m, 1), "problem": route.problem or None}
            for route in routes
        ]
        self._lines = [line_of(route.path) for route in routes]
        self._codes: list[tuple[int, bool]] = []
        self._decided = self._searched = -_OLD_TICKS
        self._shown = -1
        self._path_tick = 0
        self.code: str | None = None
        self.correlation = math.nan

    def take_fix(self, tick: int, code: int, correlation: float) -> None:
        """Take a searched scan. Those between the stops of a search have no fix of their own, and change nothing."""
        self._searched = tick
        if code != Code.NO_WINDOW:
            self._decided = tick
            self._codes.append((tick, code == Code.OK))
        elif tick - self._decided < _OLD_TICKS:
            return
        self.code, self.correlation = Code(code).name.lower(), correlation

    def state(self, tick: int, route: int, result: TickResult, places: Sequence[Place] = ()) -> dict[str, Any]:
        """Display state of a tick, in addition to the modes.

        Args:
            tick: number of the tick.
            route: number of the chosen route.
            result: numbers of the step.
            places: candidate places, if the operator chooses between several.
        """
        self._codes = [known for known in self._codes if known[0] > tick - 500]
        share = sum(good for _, good in self._codes) / len(self._codes) if self._codes else None
        old = tick - self._searched > _OLD_TICKS
        state: dict[str, Any] = {
            "route": self._routes[route].name,
            "routes": self._listed,
            "speed_mps": result.speed_mps,
            "cap_mps": result.cap_mps,
            "cross_track_m": result.offset_m,
            "to_go_m": result.to_go_m,
            "heading_error_deg": math.degrees(result.heading_error_rad),
            "lgpr": self._lgpr,
            "bounded_by": [
                name for name, flag in (("LGPR", result.bounded), ("GNSS", result.gnss_bounded)) if flag == 1.0
            ],
            "correlation": math.nan if old else self.correlation,
            "code": None if old else self.code,
            "ok_share": share,
            "sigma_along_m": result.sigma_along_m,
            "sigma_cross_m": result.sigma_cross_m,
            "pose": [result.x_m, result.y_m, result.yaw_rad],
            "gnss_pose": [result.reckoned_x_m, result.reckoned_y_m, result.reckoned_yaw_rad],
            "reaction": Reaction(int(result.reaction)).name if math.isfinite(result.reaction) else None,
            "reasons": reason_words(result.reasons),
            "front_rad": result.front_rad,
            "throttle": result.throttle,
            "brake": result.brake,
        }
        line = self._lines[route]
        if line is not None:
            # In the order along the route: a letter keeps its place while the vehicle moves.
            ordered = sorted(places, key=lambda place: (place.at_m, place.travel))
            state["places"] = [{"place": place.words, **line.ahead(place)} for place in ordered]
        if route != self._shown or tick - self._path_tick >= 100:
            self._shown, self._path_tick = route, tick
            state["path"] = self._routes[route].points
        return state


# Rows of a tick for other processes: the prior for registration, the plan for the recording.


def prior_row(
    result: TickResult, now_ns: int, *, valid: bool, roll_rad: float, yaw_rate_radps: float, travel_m: float
) -> bytes:
    """``PRIOR``: from where the map is searched; without a yaw rate the vehicle is assumed not to turn."""
    row = np.zeros((), PRIOR)
    row["time_ns"], row["valid"] = now_ns, valid
    row["pose"] = (result.search_x_m, result.search_y_m, result.search_yaw_rad)
    row["roll_rad"], row["sigma_yaw_rad"] = roll_rad, result.reckoned_yaw_sigma_rad
    row["speed_mps"], row["travel_m"] = result.speed_mps, travel_m
    row["yaw_rate_radps"] = yaw_rate_radps if math.isfinite(yaw_rate_radps) else 0.0
    return row.tobytes()


def plan_row(result: TickResult, watched: Watched, sent: SentCommand, *, mode: int, code: PlanCode) -> bytes:
    """``PLAN``: decision of a tick; before there is a pose navigation requests a stop."""
    row = np.zeros((), PLAN)
    row["mode"], row["code"] = mode, int(code)
    row["reaction"] = whole(result.reaction, int(Reaction.STOP))
    row["reasons"], row["limited"] = whole(result.reasons), whole(result.limited)
    row["pose"] = (result.x_m, result.y_m, result.yaw_rad)
    row["sigma_cross_m"], row["speed_mps"] = result.sigma_cross_m, result.speed_mps
    row["wanted_mps"], row["cross_track_m"] = result.wanted_mps, result.offset_m
    row["to_go_m"], row["front_rad"] = result.to_go_m, watched.front_rad
    row["command"], row["engage"] = (sent.front_rad, sent.throttle, sent.brake), sent.engage
    row["watch"], row["severity"] = int(watched.bits), int(watched.severity)
    return row.tobytes()


_GOOD_M, _USABLE_M = 0.1, 0.5
"""Standard deviations up to which a position is given out as fixed, and as float."""
_DOUBTED = Reason.CONFLICT | Reason.CONFLICT_LASTS | Reason.REACQUIRED | Reason.NON_FINITE
_TICKS_HZ = 50


def quality_of(result: TickResult) -> int:
    """Quality of the corrected position, as in GGA; never better than what bounds its error.

    4: LGPR, or uncontradicted GNSS, bounds it to 0.1 m; 5: one of them bounds it to 0.5 m; 6: dead
    reckoning, or GNSS and LGPR contradict each other; 0: none.
    """
    numbers = (result.fused_x_m, result.fused_y_m, result.fused_yaw_rad, result.sigma_along_m, result.sigma_cross_m)
    if not all(math.isfinite(number) for number in numbers):
        return 0
    reasons, sigma_m = whole(result.reasons), max(result.sigma_along_m, result.sigma_cross_m)
    if reasons & (_DOUBTED | Reason.POSITION_LOST | Reason.HEADING_LOST) or not sigma_m <= _USABLE_M:
        return 6
    bounded = result.bounded == 1.0 or not reasons & OF_GNSS
    return 4 if bounded and sigma_m <= _GOOD_M else 5


def pose_row(result: TickResult, now_ns: int, height_m: float, antenna_m: tuple[float, float]) -> bytes:
    """``POSE`` record: the corrected position of the vehicle's GNSS antenna, in place of a receiver's position.

    Args:
        result: result of the tick.
        now_ns: time of the tick, ns.
        height_m: height of the last position.
        antenna_m: antenna forward and left of the rear axle, m.
    """
    row = np.zeros((), POSE)
    cos, sin = math.cos(result.fused_yaw_rad), math.sin(result.fused_yaw_rad)
    ahead, left = antenna_m
    row["time_ns"], row["quality"] = now_ns, quality_of(result)
    row["pose"] = (
        result.fused_x_m + cos * ahead - sin * left,
        result.fused_y_m + sin * ahead + cos * left,
        result.fused_yaw_rad,
    )
    row["height_m"], row["speed_mps"] = height_m, result.speed_mps
    row["sigma_along_m"], row["sigma_cross_m"] = result.sigma_along_m, result.sigma_cross_m
    return row.tobytes()


_OLD_NS = 300_000_000
_SCANS_NS = 200_000_000
_TRAVEL_OLD_S = 0.1
_SCANS = "no scans: radar, its connection or registration"
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


def degrading(result: TickResult) -> float:
    """The reasons that slow the vehicle down: without those of a source while the other one bounds the error."""
    excused = (OF_GNSS if result.bounded == 1.0 else 0) | (OF_LGPR if result.gnss_bounded == 1.0 else 0)
    return whole(result.reasons) & ~excused


class CounterSteer:
    """See ``VehicleKind``.

    Args:
        config: configuration of the run.
        loaded: files of the run.

    Attributes:
        pilot: navigation and autopilot.
        senses: received messages.
        speed_control: whether the vehicle has speed control, by its file.

    Raises:
        InputError: the vehicle file lacks a number.
    """

    def __init__(self, config: RuntimeConfig, loaded: Loaded) -> None:
        self.speed_control = loaded.vehicle.speed_control
        self.senses = Senses(loaded.frame, config.sensors, level=not config.map)
        self.pilot = Pilot(loaded, config.control, config.sensors)
        self._watches = Watches(config, loaded.vehicle)
        self._panel = Panel(loaded.routes, lgpr=bool(config.map))
        self._step_mps, self._slow_mps = config.control.set_speed_step_mps, config.control.slow_mps
        self._has_radar = config.ports.radar is not None
        self._sent = SentCommand(0.0, 0.0, 0.0, 0)
        self._antenna_m = (float(loaded.setup.navigator.model.gnss_x_m), float(loaded.setup.navigator.model.gnss_y_m))
        self._every = None if config.output is None else _TICKS_HZ // config.output.rate_hz
        self._ticks = 0
        # The travel of an earlier process is unrelated to this one's.
        self._travel_lost = True
        self._fix_ns: int | None = None
        self._now_ns = 0
        self._sensed: Sensed = NOTHING_SENSED
        self._watched = Watched(Watch(0), Severity.CONTINUE, [], math.nan, 0.0, False)

    @property
    def lock_mps(self) -> float:
        """The present speed; a step of the buttons while standing."""
        speed = self.pilot.result.speed_mps
        return max(speed, self._step_mps) if math.isfinite(speed) else self._step_mps

    def warm_up(self) -> None:
        """Compile all that a tick may need."""
        self.pilot.warm_up()

    def take(self, record: Record, tick: int) -> None:
        """A message of the box or the GNSS/INS, or a fix."""
        self.senses.take(record)
        if record.kind is RecordKind.FIX:
            fix = fix_row(record.payload)
            self._fix_ns = record.mono_ns
            self._panel.take_fix(tick, int(fix["code"]), float(fix["correlation"]))

    def update(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of the messages."""
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
            estimated_mps=self.pilot.result.speed_mps,
            limit_mps=self.pilot.result.wanted_mps,
        )
        if not self.pilot.started and place is not None and attitude is not None and is_sure(attitude):
            self.pilot.start(place, attitude, watched.front_rad)
        return watched.events

    def status(self, *, decided: bool) -> VehicleStatus:
        """Present status."""
        result, watched, wheels = self.pilot.result, self._watched, self._sensed.wheels
        limited = Limited(whole(result.limited) if decided else 0)
        # Before the box was first received the checks handle its silence.
        received = wheels is not None
        bits = watched.bits if received else watched.bits & ~Watch.LINE_SILENT
        severity = watched.severity if received else Severity.CONTINUE
        place, attitude = self.senses.place, self.senses.attitude
        ages = {
            # Where LGPR alone bounds the error, a position by GNSS is not needed.
            "no position from GNSS": 0.0 if result.bounded == 1.0 else self._age_s(place),
            "no heading": self._age_s(attitude),
            "drive-by-wire box is silent": self._sensed.wheels_age_s if received else math.inf,
        }
        done = [ARRIVED[0]] if self.pilot.code is PlanCode.DONE else []
        contradicted = bool(bits & Watch.HEADING_CONTRADICTED)
        return VehicleStatus(
            started=self.pilot.started,
            place=Event.ROUTE_WRONG_HEADING if contradicted else _PLACES[self.pilot.code],
            doubtful=bool(bits & Watch.HEADING_UNCONFIRMED) or contradicted,
            reaction=whole(result.reaction, int(Reaction.STOP)),
            ages_s=ages,
            line=not bits & LINE,
            severity=severity,
            manual=severity >= Severity.MANUAL and bool(bits & ~LINE),
            emergency=watched.severity is Severity.EMERGENCY,
            refuses=bool(bits & REFUSING),
            failed=bool(limited & Limited.MANUAL_REQUESTED),
            why=[*done, *describe(watched.bits, FINDINGS), *reason_words(result.reasons), *limited_words(limited)],
        )

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Present state of every system check."""
        wheels, found = self._sensed.wheels, self._watched.bits
        state = BoxState.NO_POWER if wheels is None else BoxState(wheels.bits("state"))
        sensors = Watch.POTENTIOMETER_RANGE | Watch.POTENTIOMETER_STUCK | Watch.WHEEL_SENSORS_APART
        place, attitude = self.senses.place, self.senses.attitude
        here = self.pilot.started and place is not None and attitude is not None
        unrecorded = processes.silent("recorder") and processes.mandatory
        tested = CheckItem(Check.BRAKE, bool(state & BoxState.BRAKE_TESTED), "the braking test has not passed")
        lgpr = not processes.silent("registration")
        return [
            *box_checks(found, received=wheels is not None),
            CheckItem(
                Check.STEERING_SENSORS,
                wheels is not None and math.isfinite(self._watched.front_rad) and not found & sensors,
                "; ".join(describe(found & sensors, FINDINGS)) or "no wheel angle",
            ),
            CheckItem(Check.GNSS_INS, here, "no position or no heading"),
            *([CheckItem(Check.LGPR, lgpr, "the registration process is not ready")] if self._has_radar else []),
            CheckItem(Check.STORAGE, not unrecorded, "nothing is being recorded"),
            *([tested] if self.speed_control else []),
        ]

    def step(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""
        watched, sensed = self._watched, self._sensed
        if not watched.speed_known:
            sensed = sensed._replace(odometer_mps=math.nan)
        slow = wish.slowly or watched.severity is Severity.DEGRADE or self._missed
        ordered = Ordered(
            steering_engaged=wish.engaged,
            speed_engaged=wish.drives,
            stop=wish.stop,
            speed_cap_mps=self._slow_mps if slow else math.inf,
            set_speed_mps=wish.set_speed_mps,
            front_rad=watched.front_rad,
            age_s=sensed.wheels_age_s,
            yaw_rate_radps=watched.yaw_rate_radps,
            torque_share=self._watches.torque_share,
        )
        self.pilot.step(sensed, ordered, now_ns)

    def command(self, engage: int) -> OutgoingFrame:
        """Command to send."""
        result = self.pilot.result
        numbers = (result.front_rad, result.throttle, result.brake)
        if not all(math.isfinite(number) for number in numbers):
            # Only before there is a pose, when nothing can be engaged.
            front = self._watched.front_rad if math.isfinite(self._watched.front_rad) else 0.0
            numbers, engage = (front, 0.0, 0.0), engage & CUT
        front, throttle, brake = numbers
        if not engage & PEDALS:
            throttle = brake = 0.0
        self._sent = SentCommand(front, throttle, brake, engage)
        return OutgoingFrame("drive_command", self._sent._asdict())

    def rows(self, now_ns: int, mode: int) -> list[tuple[RecordKind, bytes]]:
        """The prior for registration, and the plan."""
        result, attitude = self.pilot.result, self.senses.attitude
        rows: list[tuple[RecordKind, bytes]] = []
        self._travel_lost |= self._sensed.travel_lost
        # While the box is silent the travel is unknown: scans wait until its odometer is received.
        if self.pilot.started and self._sensed.wheels_age_s <= _TRAVEL_OLD_S:
            prior = prior_row(
                result,
                now_ns,
                valid=not self._travel_lost,
                roll_rad=0.0 if attitude is None else attitude.roll_rad,
                yaw_rate_radps=self._sensed.yaw_rate_radps,
                travel_m=self.senses.travel_m,
            )
            rows.append((RecordKind.PRIOR, prior))
            self._travel_lost = False
        self._ticks += 1
        if self._every is not None and self._ticks % self._every == 0:
            height_m = math.nan if self.senses.place is None else self.senses.place.up_m
            rows.append((RecordKind.POSE, pose_row(result, now_ns, height_m, self._antenna_m)))
        return [*rows, (RecordKind.PLAN, plan_row(result, self._watched, self._sent, mode=mode, code=self.pilot.code))]

    def state(self, tick: int) -> dict[str, Any]:
        """State for the display."""
        taken = same_place(self._offered, self.pilot.place)
        return {
            **self._panel.state(tick, self.pilot.route, self.pilot.result, self._offered),
            "limit_mps": math.nan if self.speed_control else self.pilot.result.wanted_mps,
            "place": None if self.pilot.place is None else self.pilot.place.words,
            "taken": None if taken is None else taken.words,
            "look_ahead_m": self.pilot.result.look_ahead_m,
            "torque_share": self._watches.torque_share,
        }

    def warnings(self) -> list[str]:
        """Warnings to the operator."""
        return [*describe(self._watched.bits, FINDINGS), *([_SCANS] if self._scans_missing else [])]

    def inhibit_text(self) -> str:
        """The text of the modes."""
        return ""

    def slow(self) -> list[str]:
        """Reasons of the speed cap: watches, health, missing scans."""
        result, watched = self.pilot.result, self._watched
        cause = watched.severity is Severity.DEGRADE
        slows = Watch(sum(bit for bit in watched.bits if FINDINGS[bit].severity is Severity.DEGRADE))
        words = describe(slows, FINDINGS) if cause else []
        words += [_SCANS] if self._missed else []
        return [*words, *(reason_words(degrading(result)) if result.reaction == Reaction.DEGRADE else [])]

    def notes(self) -> list[dict[str, Any]]:
        """The place on the route that was taken of several."""
        begun, self.pilot.begun = self.pilot.begun, None
        return [] if begun is None else [{"place": begun.words}]

    def release(self, engage: int) -> OutgoingFrame:
        """The last command of all."""
        return OutgoingFrame("drive_command", SentCommand(self._sent.front_rad, 0.0, 0.0, engage)._asdict())

    def leave(self) -> None:
        """The operator drives."""
        self.pilot.leave()

    def choose(self, name: str, place: str) -> bool:
        """Another route, or another place on it."""
        return self.pilot.choose(name, place)

    def next_place(self, by: int) -> dict[str, str] | None:
        """Choose the next of the places where the vehicle may be."""
        return self.pilot.next_place(by)

    @property
    def _offered(self) -> list[Place]:
        """Places to choose between: none while one is driven from."""
        return self.pilot.places if len(self.pilot.places) > 1 and not self._sent.engage else []

    def _age_s(self, sensed: LocalPosition | LocalAttitude | None) -> float:
        return math.inf if sensed is None else (self._now_ns - sensed.time_ns) / 1e9

    @property
    def _scans_missing(self) -> bool:
        """Whether no scan has been searched for a while: the radar, its line, or the registration process."""
        return self._fix_ns is not None and self._now_ns - self._fix_ns > _SCANS_NS

    @property
    def _missed(self) -> bool:
        """Whether scans are missing without a substitute."""
        return self._scans_missing and self.pilot.result.gnss_bounded != 1.0
