"""The control loop without clock, ports or files: records of a tick in, records out. A replay runs the same.

Order of a tick: what came is taken, the watches judge it, the modes move, the compiled step decides, the command goes
out, and what it found out is told to the modes in the same tick, so that no command is engaged against a finding.
"""

import json
import math
from typing import Any

import numpy as np

from lgprjax.autopilot import Check, Event, Limited, refusal_of
from lgprjax.autopilot.watch_findings import Severity, Watch, describe
from lgprjax.autopilot.watch_line import BoxState
from lgprjax.navigation import Reaction
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.checks import CheckItem, SystemChecks
from lgprjax.runtime.control.compiled import TickResult
from lgprjax.runtime.control.happenings import DIED, RELAUNCHED, Seen, Told, events_of
from lgprjax.runtime.control.mode_keeper import CUT, PEDALS, STEERING, Happened, ModeKeeper
from lgprjax.runtime.control.panel import REFUSALS, Panel, words_of
from lgprjax.runtime.control.pilot import Ordered, Pilot
from lgprjax.runtime.control.rows import plan_row, prior_row, whole
from lgprjax.runtime.control.senses import Sensed, Senses
from lgprjax.runtime.control.setup import Loaded
from lgprjax.runtime.control.watches import Sent, Watched, Watches
from lgprjax.runtime.link import Sender
from lgprjax.runtime.records import FIX, Kind, Record, Source
from lgprjax.runtime.wire import decode

_COMMAND_TTL_MS = 200
_LIGHT_TTL_MS = 500
_OLD_S = 0.5
_OLD_NS = 300_000_000
_DEGRADED_MPS = 2.0
_STATE_TICKS = 5
_LATE_TICKS = 3
_LATE_WINDOW = 50
_TICK_NS = 20_000_000
_SCANS_NS = 200_000_000


class ControlCore:
    """One run's control loop.

    Args:
        config: of the run.
        loaded: its files.
        session: of the frames sent.
        after_death: see ``ModeKeeper``.

    Attributes:
        modes: the mode machine; pilot: navigation and autopilot; senses: what came.
        unrecorded: messages that found no room on their way to the recorder; for the display.

    Raises:
        InputError: the vehicle file lacks a number.
    """

    def __init__(self, config: RuntimeConfig, loaded: Loaded, *, session: int, after_death: bool) -> None:
        self._config = config
        self.senses = Senses(loaded.frame, config.sensors)
        self.pilot = Pilot(loaded, config.control, config.sensors)
        self.modes = ModeKeeper(after_death=after_death, speed_step_mps=config.control.set_speed_step_mps)
        self._after_death = after_death
        self._watches = Watches(config, loaded.vehicle)
        self._panel = Panel(loaded.routes)
        self._checks = SystemChecks()
        # One numbering a line, one session a start.
        self._box, self._controller = Sender(session), Sender(session)
        self._told = Told()
        self._sent = Sent(0.0, 0.0, 0.0, 0)
        self._tick = 0
        self._last_ns = 0
        self._late: list[int] = []
        self._buttons: list[int] = []
        self._controller_ns: int | None = None
        self._fix_ns: int | None = None
        self._alive: dict[str, bool] = {}
        self._monitor: dict[str, Any] = {}
        self._recorder_lost = False
        self.unrecorded = 0
        self._booted = False
        self._out: list[Record] = []

    def step(self, tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        """A tick.

        Args:
            tick: its number, from 1.
            now_ns: monotonic.
            came: since the last tick, in the order in which it was taken.

        Returns:
            what is to be sent (PORT_OUT, PRIOR, STATE) and recorded (PLAN, EVENT), in this order of making.
        """
        self._tick, self._out = tick, []
        self._count_late(now_ns)
        for record in came:
            self._take(record, now_ns)
        sensed = self.senses.end_tick(now_ns)
        watched = self._watch(sensed, now_ns)
        self._start_pilot(watched)
        if not self._booted:
            self._booted = True
            self._tell(Event.BOOT_DONE, now_ns)
            if self._after_death:
                self._tell(Event.CONTROL_RELAUNCHED, now_ns)
        for event in watched.events:
            self._tell(event, now_ns)
        self._run_checks(sensed, watched, now_ns)
        self._notice(sensed, watched, now_ns, self.pilot.result, limited=0)
        if not watched.speed_known:
            sensed = sensed._replace(odometer_mps=math.nan)
        result = self.pilot.step(sensed, self._ordered(sensed, watched), now_ns)
        self._notice(sensed, watched, now_ns, result, limited=whole(result.limited))
        self._command(result, watched, now_ns)
        self._rows(sensed, result, watched, now_ns)
        if tick % _STATE_TICKS == 0:
            self._show(result, watched, now_ns)
        return self._out

    def release(self, now_ns: int) -> Record:
        """The last command of all: nothing engaged, a cut power left cut."""
        fields = {"front_rad": self._sent.front_rad, "throttle": 0.0, "brake": 0.0, "engage": self.modes.engage & CUT}
        mode = int(self.modes.mode)
        frame = self._box.frame("drive_command", fields, mode=mode, mono_ns=now_ns, ttl_ms=_COMMAND_TTL_MS)
        return Record(Kind.PORT_OUT, Source.DRIVE_BY_WIRE, self._tick + 1, now_ns, frame)

    def look(self, sensed: Sensed, watched: Watched) -> list[CheckItem]:
        """Every system check as it stands."""
        wheels = sensed.wheels
        state = BoxState.NO_POWER if wheels is None else BoxState(wheels.bits("state"))
        line = Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.ACTUATOR_FAULT
        sensors = Watch.POTENTIOMETER_RANGE | Watch.POTENTIOMETER_STUCK | Watch.WHEEL_SENSORS_APART
        silent = [name for name in ("recorder", "registration") if not self._alive.get(name, False)]
        place, attitude = self.senses.place, self.senses.attitude
        second = bool(watched.bits & Watch.SECOND_SENDER)
        here = self.pilot.started and place is not None and attitude is not None
        return [
            CheckItem(Check.SECOND_MASTER, not second, "another sender commands the drive-by-wire box"),
            CheckItem(
                Check.DRIVE_BY_WIRE,
                wheels is not None and not watched.bits & line,
                "; ".join(describe(watched.bits & line)) or "the drive-by-wire box is silent",
            ),
            CheckItem(
                Check.STEERING_SENSORS,
                wheels is not None and math.isfinite(watched.front_rad) and not watched.bits & sensors,
                "; ".join(describe(watched.bits & sensors)) or "no wheel angle",
            ),
            CheckItem(Check.GNSS_INS, here, "no position or no heading"),
            CheckItem(Check.LGPR, "registration" not in silent, "the registration process is not ready"),
            CheckItem(Check.STORAGE, "recorder" not in silent or not self._mandatory, "nothing is being recorded"),
            CheckItem(Check.BRAKE, bool(state & BoxState.BRAKE_TESTED), "the braking test has not passed"),
        ]

    @property
    def _mandatory(self) -> bool:
        return self._config.recording.mandatory

    @property
    def _scans_missing(self) -> bool:
        """No scan has been searched for a while: the radar, its line, or the registration process."""
        return self._fix_ns is not None and self._last_ns - self._fix_ns > _SCANS_NS

    def _take(self, record: Record, now_ns: int) -> None:
        match record.kind:
            case Kind.PORT_IN:
                if record.source is Source.CONTROLLER:
                    self._controller_ns = record.mono_ns
                    self._buttons.append(int(decode(record.payload).number("buttons")))
                else:
                    self.senses.take(record)
            case Kind.FIX:
                self.senses.take(record)
                fix = np.frombuffer(record.payload, FIX)[0]
                self._fix_ns = record.mono_ns
                self._panel.take_fix(self._tick, int(fix["code"]), float(fix["correlation"]))
            case Kind.EVENT:
                self._take_note(json.loads(record.payload), now_ns)
            case Kind.MONITOR:
                self._monitor = json.loads(record.payload)
            case Kind.REQUEST:
                self._choose(str(json.loads(record.payload).get("select_route")), now_ns)

    def _take_note(self, note: dict[str, Any], now_ns: int) -> None:
        """What the supervisor says of a process."""
        if note.get("died") in DIED:
            name = str(note["died"])
            known, self._alive[name] = self._alive.get(name), False
            if known is not None:
                self._tell(DIED[name], now_ns)
        elif note.get("left") in DIED:
            # It is not started again. What that means was said with its deaths, or it ended in order.
            self._alive[str(note["left"])] = False
        elif note.get("ready") in RELAUNCHED:
            name = str(note["ready"])
            known, self._alive[name] = self._alive.get(name), True
            if known is False:
                self._tell(RELAUNCHED[name], now_ns)
        self._recorder_lost = self._mandatory and self._alive.get("recorder") is False

    def _choose(self, name: str, now_ns: int) -> None:
        """Another route: only while the operator drives."""
        if self.modes.engage & (STEERING | PEDALS):
            self._event(now_ns, {"refused": "route", "why": "a route is chosen while the operator drives"})
        elif self.pilot.choose(name):
            self._event(now_ns, {"route": name})
        else:
            self._event(now_ns, {"refused": "route", "why": f"no route that can be driven: {name[:80]}"})

    def _watch(self, sensed: Sensed, now_ns: int) -> Watched:
        statuses, self._buttons = tuple(self._buttons), []
        controller_ns, attitude = self._controller_ns, self.senses.attitude
        return self._watches.step(
            sensed,
            self._sent,
            now_ns,
            statuses=statuses,
            controller_age_s=math.inf if controller_ns is None else (now_ns - controller_ns) / 1e9,
            heading_rad=math.nan if attitude is None or now_ns - attitude.time_ns > _OLD_NS else attitude.yaw_rad,
            cross_track_m=self.pilot.result.offset_m,
        )

    def _start_pilot(self, watched: Watched) -> None:
        place, attitude = self.senses.place, self.senses.attitude
        if not self.pilot.started and place is not None and attitude is not None:
            self.pilot.start(place, attitude, watched.front_rad)

    def _run_checks(self, sensed: Sensed, watched: Watched, now_ns: int) -> None:
        now_s = now_ns / 1e9
        if self.modes.checks_asked:
            self.modes.checks_asked = False
            self._checks.begin(now_s)
        starting = "registration" not in self._alive
        verdict = self._checks.step(now_s, lambda: self.look(sensed, watched), starting=starting)
        if verdict is True:
            self._tell(Event.CHECKS_PASSED, now_ns)
        elif isinstance(verdict, CheckItem):
            self._event(now_ns, {"check": verdict.check.name, "why": verdict.reason})
            self._tell(Event.CHECKS_FAILED, now_ns, check=verdict.check)
        if self._checks.brake_test_due(now_s):
            self._port_out(
                Source.DRIVE_BY_WIRE,
                self._box.frame(
                    "drive_test", {"test": 1}, mode=self.modes.mode, mono_ns=now_ns, ttl_ms=_COMMAND_TTL_MS
                ),
                now_ns,
            )

    def _notice(self, sensed: Sensed, watched: Watched, now_ns: int, result: TickResult, *, limited: int) -> None:
        """Tell the mode machine what has changed."""
        modes, pilot = self.modes, self.pilot
        now_s = now_ns / 1e9
        place, attitude = self.senses.place, self.senses.attitude
        ages = [
            now_s - (0.0 if place is None else place.time_ns / 1e9),
            now_s - (0.0 if attitude is None else attitude.time_ns / 1e9),
            math.inf if sensed.wheels is None else sensed.wheels_age_s,
            now_s - (self._controller_ns or 0) / 1e9,
        ]
        # Before the box was first heard its silence is the checks' affair.
        unheard = Watch.LINE_SILENT if sensed.wheels is None else Watch(0)
        seen = Seen(
            modes.mode,
            modes.state.place,
            pilot.started,
            pilot.code,
            whole(result.reaction, int(Reaction.STOP)),
            max(ages) < _OLD_S,
            watched.bits & ~unheard,
            watched.severity if not unheard else Severity.CONTINUE,
            limited,
            len(self._late) >= _LATE_TICKS,
            self._recorder_lost,
        )
        # Asked before the events, which release what was engaged.
        emergency = watched.severity is Severity.EMERGENCY and bool(modes.engage & (STEERING | PEDALS | CUT))
        self._told, events = events_of(self._told, seen)
        for event in events:
            why: list[str] = []
            if event in (Event.ERROR_RAISED, Event.HEALTH_STOP, Event.DRIVE_BY_WIRE_DIED, Event.SOURCE_MISSING):
                why = [*describe(watched.bits), *words_of(result), *_limits(limited)]
                why += ["the control loop is late"] if seen.late else []
            self._tell(event, now_ns, why=why)
        if emergency:
            modes.cut()

    def _ordered(self, sensed: Sensed, watched: Watched) -> Ordered:
        modes = self.modes
        slow = watched.severity is Severity.DEGRADE or self._scans_missing
        return Ordered(
            bool(modes.engage & STEERING),
            bool(modes.engage & PEDALS),
            modes.stopping,
            _DEGRADED_MPS if slow else math.inf,
            modes.set_speed_mps,
            watched.front_rad,
            max(sensed.wheels_age_s, min(sensed.rate_age_s, sensed.wheels_age_s)),
            watched.yaw_rate_radps,
        )

    def _command(self, result: TickResult, watched: Watched, now_ns: int) -> None:
        engage = self.modes.engage
        numbers = (result.front_rad, result.throttle, result.brake)
        if not all(math.isfinite(number) for number in numbers):
            # Only before there is a pose, when nothing can be engaged.
            front = watched.front_rad if math.isfinite(watched.front_rad) else 0.0
            numbers, engage = (front, 0.0, 0.0), engage & CUT
        front, throttle, brake = numbers
        if not engage & PEDALS:
            throttle = brake = 0.0
        fields = {"front_rad": front, "throttle": throttle, "brake": brake, "engage": engage}
        mode = int(self.modes.mode)
        frame = self._box.frame("drive_command", fields, mode=mode, mono_ns=now_ns, ttl_ms=_COMMAND_TTL_MS)
        self._port_out(Source.DRIVE_BY_WIRE, frame, now_ns)
        self._sent = Sent(front, throttle, brake, engage)
        if self._tick % _STATE_TICKS == 0:
            light = {"light": int(self.modes.lit)}
            frame = self._controller.frame("controller_light", light, mode=mode, mono_ns=now_ns, ttl_ms=_LIGHT_TTL_MS)
            self._port_out(Source.CONTROLLER, frame, now_ns)

    def _rows(self, sensed: Sensed, result: TickResult, watched: Watched, now_ns: int) -> None:
        """The prior for registration, and the plan."""
        attitude = self.senses.attitude
        if self.pilot.started:
            prior = prior_row(
                result,
                now_ns,
                roll_rad=0.0 if attitude is None else attitude.roll_rad,
                yaw_rate_radps=sensed.yaw_rate_radps,
                travel_m=self.senses.travel_m,
            )
            self._out.append(Record(Kind.PRIOR, Source.CONTROL, self._tick, now_ns, prior))
        plan = plan_row(result, watched, self._sent, mode=int(self.modes.mode), code=self.pilot.code)
        self._out.append(Record(Kind.PLAN, Source.CONTROL, self._tick, now_ns, plan))

    def _show(self, result: TickResult, watched: Watched, now_ns: int) -> None:
        modes = self.modes
        refusal = modes.state.refusal
        stands = refusal_of(modes.state)
        told = {
            "time_s": now_ns / 1e9,
            "mode": modes.mode.name,
            "mode_since_s": now_ns / 1e9 - modes.since_s,
            "warnings": [
                *describe(watched.bits),
                *(["no scans: radar, its line or registration"] if self._scans_missing else []),
                *self._monitor.get("warnings", []),
            ],
            "refusal": stands.name,
            "refusal_text": REFUSALS[stands] or REFUSALS[refusal],
            "faults": [str(fault.name).lower() for fault in modes.state.faults],
            "checks": [
                {"check": item.check.name, "good": item.good, "why": item.reason} for item in self._checks.items
            ],
            "set_speed_mps": modes.set_speed_mps if modes.engage & PEDALS else None,
            "override": modes.state.override_pressed,
            "estop": modes.state.estop_pressed,
            "processes": {name: "ready" if alive else "dead" for name, alive in self._alive.items()},
            "monitor": self._monitor,
            "recording": {"lost": self.unrecorded},
        }
        payload = self._panel.state(self._tick, self.pilot.route, told, result)
        self._out.append(Record(Kind.STATE, Source.CONTROL, self._tick, now_ns, payload))

    def _tell(self, event: Event, now_ns: int, *, check: Check = Check.NONE, why: list[str] | None = None) -> None:
        speed = self.pilot.result.speed_mps
        happened: Happened | None = self.modes.tell(
            event, now_ns / 1e9, speed if math.isfinite(speed) else 0.0, check=check
        )
        if happened is not None:
            self._event(now_ns, {**happened._asdict(), **({"why": why} if why else {})})
        if event is Event.OVERRIDE_PRESSED:
            # The operator drives: where he then is, the planner is to find anew.
            self.pilot.leave()

    def _event(self, now_ns: int, told: dict[str, Any]) -> None:
        self._out.append(Record(Kind.EVENT, Source.CONTROL, self._tick, now_ns, json.dumps(told).encode()))

    def _port_out(self, line: Source, frame: bytes, now_ns: int) -> None:
        self._out.append(Record(Kind.PORT_OUT, line, self._tick, now_ns, frame))

    def _count_late(self, now_ns: int) -> None:
        """Ticks that began more than a period late, of the last second."""
        if self._last_ns and now_ns - self._last_ns > 2 * _TICK_NS:
            self._late.append(self._tick)
        self._last_ns = now_ns
        self._late = [tick for tick in self._late if tick > self._tick - _LATE_WINDOW]


def _limits(limited: int) -> list[str]:
    bad = Limited(limited) & (Limited.NOT_FINITE | Limited.STALE | Limited.MANUAL_REQUESTED)
    return [f"command: {str(bit.name).lower().replace('_', ' ')}" for bit in bad]
